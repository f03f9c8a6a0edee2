//! Flags of `plywave view`.

use clap::Args;
use std::path::PathBuf;

/// `plywave view`.
#[derive(Clone, Debug, Args)]
pub struct ViewArgs {
    /// Ply model (.pwm), cloth (.pwc) or cloth spec (TOML) [default: the ply models that ship].
    pub file: Option<PathBuf>,
    /// Port on this machine; 0 for any that is free.
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub port: u16,
    /// Folder of the viewer's site, instead of the one in the program.
    #[arg(long, value_name = "FOLDER")]
    pub site: Option<PathBuf>,
}
