//! Flags of the hairs of a cloth.

use clap::Args;
use std::path::PathBuf;

/// `plywave hairs`.
#[derive(Debug, Args)]
pub struct HairsArgs {
    /// Cloth spec (TOML) or cloth file (.pwc) whose yarns have hairs.
    pub cloth: PathBuf,
    /// Mesh to put them on: Wavefront OBJ with texture coordinates [default: a flat sheet].
    pub mesh: Option<PathBuf>,
    /// File to write, Mitsuba's text of curves [default: CLOTH's name with .txt, in this folder].
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Width and height of the sheet; one number for both [mm] [default: 10].
    #[arg(long, value_names = ["W", "H"], num_args = 1..=2, allow_negative_numbers = true, conflicts_with = "mesh")]
    pub size_mm: Vec<f64>,
    /// Length of cloth per unit of the mesh's texture coordinates [um] [default: 100000].
    #[arg(long, value_name = "UM", allow_negative_numbers = true, requires = "mesh")]
    pub um_per_uv: Option<f64>,
    /// Seed of the hairs.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}
