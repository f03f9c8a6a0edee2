//! Flags of swatches.

use clap::Args;
use std::path::PathBuf;

/// `plywave swatch`.
#[derive(Debug, Args)]
pub struct SwatchArgs {
    /// Photograph of the face, lit from the front (PNG).
    pub front: PathBuf,
    /// Photograph from the same place with the lamp behind the cloth (PNG).
    pub back: PathBuf,
    /// Cloth spec to write; beside it go a report (.json) and a picture of the fit (.png).
    #[arg(long, short, value_name = "CLOTH.toml")]
    pub output: PathBuf,
    /// Where camera and lamps stood (TOML) [default: camera 80 mm above the cloth, 53 degrees wide, lamps at
    /// (0, 80, 80) and (0, 0, -90) mm].
    #[arg(long, value_name = "FILE")]
    pub geometry: Option<PathBuf>,
    /// Fiber of the yarns, as in a cloth spec [default: cotton; polyester bright for a satin].
    #[arg(long, value_name = "FIBER")]
    pub fiber: Option<String>,
    /// Weave, as in a cloth spec [default: found in the pictures].
    #[arg(long, value_name = "NAME")]
    pub weave: Option<String>,
    /// Mass per area [g/m2].
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    pub g_per_m2: Option<f64>,
    /// Ends (warp yarns) per centimeter [default: found in the pictures].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub ends_per_cm: Option<f64>,
    /// Picks (weft yarns) per centimeter [default: found in the pictures].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub picks_per_cm: Option<f64>,
    /// Count of the yarns, as in a cloth spec, such as "Ne 20" or "30 tex".
    #[arg(long, value_name = "COUNT")]
    pub count: Option<String>,
}
