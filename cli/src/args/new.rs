//! Flags of `plywave new`.

use clap::Args;
use std::path::PathBuf;

/// `plywave new`.
#[derive(Clone, Debug, Args)]
pub struct NewArgs {
    /// Name of a cloth or yarn spec that ships [default: list them].
    pub name: Option<String>,
    /// Folder to write into, made where it is missing [default: this folder].
    #[arg(long, short, value_name = "FOLDER", requires = "name")]
    pub output: Option<PathBuf>,
    /// Write the yarn spec, where a cloth has the same name.
    #[arg(long, requires = "name")]
    pub yarn: bool,
}
