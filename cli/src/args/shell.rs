//! Flags of what a shell and its manual need.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// `plywave completions`.
#[derive(Clone, Debug, Args)]
pub struct CompletionsArgs {
    /// The shell.
    pub shell: Shell,
}

/// `plywave man`.
#[derive(Clone, Debug, Args)]
pub struct ManArgs {
    /// Folder for the pages of all commands, as share/man/man1 [default: the page of plywave itself, on
    /// standard output].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
}
