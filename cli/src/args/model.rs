//! Flags of asking, checking and comparing models.

use clap::{Args, ValueEnum};
use plywave::cloth::ColorOf;
use std::path::PathBuf;

/// `plywave info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Yarn spec, table, model, fiber or speckle patterns.
    pub file: PathBuf,
}

/// An incidence.
#[derive(Debug, Args)]
pub struct IncidenceArgs {
    /// Incident latitude [degrees], -90 to 90.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub theta_i: f64,
    /// Offset of the beam's center over the ply radius; light still scatters a little beyond 1.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    pub h_rel: f64,
    /// One to four absorption coefficients [1/um].
    #[arg(long, value_name = "SIGMA", num_args = 1..=4, value_delimiter = ',', default_values_t = [0.0], allow_negative_numbers = true)]
    pub sigma: Vec<f64>,
}

/// `plywave eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Model.
    pub model: PathBuf,
    /// Where the light comes from.
    #[command(flatten)]
    pub incidence: IncidenceArgs,
    /// Outgoing latitude [degrees], -90 to 90.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub theta_o: f64,
    /// Outgoing azimuth [degrees]; light comes from 90, exact forward is 270.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub phi_o: f64,
}

/// `plywave sample`.
#[derive(Debug, Args)]
pub struct SampleArgs {
    /// Model.
    pub model: PathBuf,
    /// Where the light comes from.
    #[command(flatten)]
    pub incidence: IncidenceArgs,
    /// Number of samples.
    #[arg(short = 'n', long = "count", value_name = "N", allow_negative_numbers = true, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub count: u64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1)]
    pub seed: u64,
}

/// `plywave check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Model, cloth file or cloth spec. A cloth is only compared with its twin.
    pub model: PathBuf,
    /// Table to compare the model's slices with, preferably of another seed.
    #[arg(long, value_name = "TABLE")]
    pub table: Option<PathBuf>,
    /// Traced yarn (`plywave simulate SPEC --plies traced`) to compare a yarn of several plies with, and also
    /// the table of --table. A traced --table has the same effect.
    #[arg(long, value_name = "TABLE")]
    pub traced: Option<PathBuf>,
    /// Twin of the cloth, which `plywave twin` writes.
    #[arg(long, value_name = "FILE")]
    pub twin: Option<PathBuf>,
    /// Largest fit error of an f_refl slice that passes.
    #[arg(long, value_name = "ERROR", allow_negative_numbers = true, default_value_t = 0.2)]
    pub max_error_refl: f64,
    /// Largest fit error of an f_high slice that passes, as a share of its light at sigma = 0.
    #[arg(long, value_name = "ERROR", allow_negative_numbers = true, default_value_t = 0.15)]
    pub max_error_high: f64,
    /// Number of incidences to check.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub incidences: u32,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1)]
    pub seed: u64,
}

/// `plywave diff`.
#[derive(Debug, Args)]
pub struct DiffArgs {
    /// First model or table.
    pub a: PathBuf,
    /// Second model or table. Models with different nodes are compared at their common incidences, tables at
    /// their common incidences and absorptions, with the noise of both removed.
    pub b: PathBuf,
    /// Largest relative L2 distance of a slice that passes [default: 0.02].
    #[arg(long, value_name = "TOL", allow_negative_numbers = true)]
    pub tol: Option<f64>,
    /// Largest difference of an energy that passes, as a share of the beam's power [default: 0.002].
    #[arg(long, value_name = "TOL", allow_negative_numbers = true)]
    pub tol_energy: Option<f64>,
    /// Largest turn of a lobe's axis that passes [degrees] [default: any, since different lobes may make one
    /// density].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub tol_drift: Option<f64>,
    /// Compare tables only at offsets up to this |h/R|; beyond, little light is scattered [default: all].
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    pub max_h_rel: Option<f64>,
}

/// A color of any form.
fn srgb(text: &str) -> Result<[f64; 3], String> {
    plywave::color::srgb_of_text(text).ok_or_else(|| format!("give {}", plywave::color::SRGB_FORMS))
}

/// `plywave color`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("wanted").required(true))]
pub struct ColorArgs {
    /// Model, cloth file or cloth spec.
    pub model: PathBuf,
    /// Light of a cloth that the color describes [default: that of its spec].
    #[arg(long, value_enum, value_name = "WHAT")]
    pub color_of: Option<ColorOfChoice>,
    /// Target color under D65, encoded sRGB: three numbers from 0 to 1, three whole numbers up to 255, or
    /// hexadecimal digits as in '#c81e28', whose # a shell takes for a comment without quotes and which may
    /// be left out.
    #[arg(long, value_name = "R,G,B|HEX", allow_hyphen_values = true, group = "wanted", value_parser = srgb)]
    pub srgb: Option<[f64; 3]>,
    /// Target reflectances from 0.38 to 0.78 um in equal steps; one value for a gray.
    #[arg(long, value_name = "R", num_args = 1..=401, value_delimiter = ',', allow_negative_numbers = true, group = "wanted")]
    pub reflectance: Vec<f64>,
    /// Use the model's albedo at this latitude [degrees] [default: under diffuse light].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, conflicts_with = "color_of")]
    pub theta_i: Option<f64>,
}

/// What the color of a cloth is a color of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum ColorOfChoice {
    /// The cloth's fibers under a sky all round.
    EvenSky,
    /// The cloth's face, lit from the viewer's side, with dark behind.
    Reflected,
    /// The cloth folded until no light comes through, as a d/8 spectrophotometer reads it.
    Folded,
}

impl From<ColorOfChoice> for ColorOf {
    fn from(choice: ColorOfChoice) -> ColorOf {
        match choice {
            ColorOfChoice::EvenSky => ColorOf::EvenSky,
            ColorOfChoice::Reflected => ColorOf::Reflected,
            ColorOfChoice::Folded => ColorOf::Folded,
        }
    }
}
