//! Flags of families.

use super::build::RunArgs;
use clap::Args;
use std::path::PathBuf;

/// `plywave family`.
#[derive(Debug, Args)]
pub struct FamilyArgs {
    /// Yarn spec with `[family]` (TOML), to make its family; or a family (.pwfam), to extract a model.
    pub input: PathBuf,
    /// File to write [default: INPUT's name with .pwfam for a spec, with .pwm for a family, in this folder].
    #[arg(long, short, value_name = "OUTPUT")]
    pub output: Option<PathBuf>,
    /// Set a parameter of the extracted model: fiber_pitch_um, alpha_fiber or eta. Repeat the flag to set
    /// several; the others are those of the family's spec.
    #[arg(long, value_name = "KEY=VALUE", value_parser = param)]
    pub param: Vec<(String, f64)>,
    /// Initial number of nodes along each axis.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(2..=64))]
    pub nodes: u32,
    /// Largest number of nodes along an axis. Nodes are added where interpolation is worst, until it is as
    /// good as a fit or this number is reached.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(2..=64))]
    pub most_nodes: u32,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Reads `KEY=VALUE`.
fn param(text: &str) -> Result<(String, f64), String> {
    let wrong = "give KEY=VALUE, such as fiber_pitch_um=800";
    let (key, value) = text.split_once('=').ok_or(wrong)?;
    let value: f64 = value.trim().parse().map_err(|_| wrong)?;
    if plywave::ply::FamilyParam::of_name(key.trim()).is_none() {
        return Err("keys are fiber_pitch_um, alpha_fiber and eta".into());
    }
    Ok((key.trim().into(), value))
}
