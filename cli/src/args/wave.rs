//! Flags of wave optics.

use super::build::{Preset, ResumeArgs, ShardArgs};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// `plywave compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Yarn spec (TOML).
    pub spec: PathBuf,
    /// Folder to write [default: SPEC's name with .compare, in this folder].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Instances of the cross section.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub instances: u32,
    /// One to eight wavelengths [um].
    #[arg(long, value_name = "UM", num_args = 1..=8, value_delimiter = ',', allow_negative_numbers = true, default_values_t = [0.4, 0.694])]
    pub lambda: Vec<f64>,
    /// One to sixteen offsets of the beam's center over the ply radius.
    #[arg(long, value_name = "H", num_args = 1..=16, value_delimiter = ',', allow_negative_numbers = true, default_values_t = [0.0, 0.5, 0.9])]
    pub h: Vec<f64>,
    /// Incident latitude [degrees], -80 to 80.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, default_value_t = 0.0)]
    pub theta_i: f64,
    /// Absorption coefficient of the fibers [1/um].
    #[arg(long, value_name = "SIGMA", default_value_t = 0.0, allow_negative_numbers = true)]
    pub sigma: f64,
    /// Largest error of the waves' far field, relative to its greatest value.
    #[arg(long, value_name = "TOL", default_value_t = 1e-4)]
    pub tolerance: f64,
    /// Rays of each instance, wavelength and offset.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u64).range(100..=10_000_000_000))]
    pub paths: u64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// What to do with shards of an earlier run, which may have had fewer instances.
    #[command(flatten)]
    pub resume: ResumeArgs,
    /// A share of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
    /// Keep the finished instances beside the folder, so that --resume can add more of them.
    #[arg(long)]
    pub keep_parts: bool,
}

/// `plywave wave`.
#[derive(Debug, Args)]
pub struct WaveArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: WaveCommand,
}

/// The commands of wave optics.
#[derive(Debug, Subcommand)]
pub enum WaveCommand {
    /// Scatter plane waves or beams by fibers: scene (TOML) in, far fields and widths (JSON) out.
    Scatter(WaveScatterArgs),
    /// Tabulate how one fiber scatters light of every direction and wavelength: spec or scene (TOML) in,
    /// fiber (.pwf) out.
    Tabulate(WaveTabulateArgs),
    /// Scatter a wide beam by many instances of a spec's fiber, for the statistics of speckle: spec (TOML)
    /// in, patterns (.pws) out.
    Speckle(WaveSpeckleArgs),
}

/// `plywave wave speckle`.
#[derive(Debug, Args)]
pub struct WaveSpeckleArgs {
    /// Yarn spec (TOML): its fiber with its jitter, turned at random.
    pub spec: PathBuf,
    /// Patterns to write [default: SPEC's name with .pws, in this folder].
    #[arg(long, short, value_name = "PATTERNS")]
    pub output: Option<PathBuf>,
    /// Instances of the fiber.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub instances: u32,
    /// One to thirty-two wavelengths [um], ascending.
    #[arg(long, value_name = "UM", num_args = 1..=32, value_delimiter = ',', allow_negative_numbers = true, default_values_t = [0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7])]
    pub lambda: Vec<f64>,
    /// One to four imaginary indices, the same at every wavelength: clear and absorbing fibers.
    #[arg(long, value_name = "KAPPA", num_args = 1..=4, value_delimiter = ',', allow_negative_numbers = true, default_values_t = [0.0, 0.05])]
    pub kappa: Vec<f64>,
    /// Incident latitude [degrees], -80 to 80.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, default_value_t = 0.0)]
    pub theta_i: f64,
    /// Waist of the beam [um].
    #[arg(long, value_name = "UM", allow_negative_numbers = true, default_value_t = 100.0)]
    pub w0: f64,
    /// Largest error of the far field, relative to its greatest value.
    #[arg(long, value_name = "TOL", allow_negative_numbers = true, default_value_t = 1e-5)]
    pub tolerance: f64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1)]
    pub seed: u64,
    /// What to do with shards of an earlier run.
    #[command(flatten)]
    pub resume: ResumeArgs,
    /// A share of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
}

/// `plywave wave tabulate`.
#[derive(Debug, Args)]
pub struct WaveTabulateArgs {
    /// Yarn spec, whose mean fiber is taken without jitter, or scene of one fiber (TOML).
    pub spec: PathBuf,
    /// Fiber table to write [default: SPEC's name with .pwf, in this folder].
    #[arg(long, short, value_name = "FIBER")]
    pub output: Option<PathBuf>,
    /// Trace rays instead of solving waves.
    #[arg(long)]
    pub rays: bool,
    /// Quality; standard has the sizes of Xia 2020.
    #[arg(long, value_enum, default_value_t = Preset::Standard)]
    pub preset: Preset,
    /// What to do with shards of an earlier run.
    #[command(flatten)]
    pub resume: ResumeArgs,
    /// A share of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
    /// Absorption coefficient of a yarn spec's fiber [1/um].
    #[arg(long, value_name = "SIGMA", default_value_t = 0.0, allow_negative_numbers = true)]
    pub sigma: f64,
    /// Longitudinal width to store [degrees]; hosts may use another.
    #[arg(long, value_name = "DEG", default_value_t = 5.73, allow_negative_numbers = true)]
    pub beta_m: f64,
    /// Bands of wavelength from 0.38 to 0.78 um, instead of the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=400))]
    pub lambdas: Option<u32>,
    /// Latitudes theta_i, instead of the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=900))]
    pub thetas: Option<u32>,
    /// Largest number of azimuths phi_i around the fiber, instead of the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub azimuths: Option<u32>,
    /// Rays of each incidence, instead of the preset's.
    #[arg(long, value_name = "N", requires = "rays", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub ray_count: Option<u64>,
    /// Seed of the rays.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// `plywave wave scatter`.
#[derive(Debug, Args)]
pub struct WaveScatterArgs {
    /// Scene (TOML), as docs/reference/format/wave.md describes.
    pub scene: PathBuf,
    /// JSON file to write [default: SCENE's name with .json, in this folder].
    #[arg(long, short, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// A share of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
}

/// Contrast of noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NoiseContrastArg {
    /// Contrast and covariance of the simulated fibers.
    Measured,
    /// A fully developed speckle, contrast 1 (Yu 2025, Eq. 19-22).
    Full,
}

/// Polarization of the light that noise is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolarizationArg {
    /// The mean of both.
    Unpolarized,
    /// Electric field with a part along the fiber.
    Tm,
    /// Electric field across the fiber.
    Te,
}

/// `plywave noise`.
#[derive(Debug, Args)]
pub struct NoiseArgs {
    /// Patterns of the model's fiber (`plywave wave speckle`), clear and absorbing.
    pub patterns: PathBuf,
    /// Model to add noise to; without it, the statistics are printed and nothing is written.
    #[arg(long, short, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Model to write [default: MODEL's name with -noise.pwm, in this folder].
    #[arg(long, short, value_name = "MODEL", requires = "model")]
    pub output: Option<PathBuf>,
    /// Contrast of the noise.
    #[arg(long, value_enum, default_value_t = NoiseContrastArg::Measured)]
    pub contrast: NoiseContrastArg,
    /// Polarization of the light.
    #[arg(long, value_enum, default_value_t = PolarizationArg::Unpolarized)]
    pub polarization: PolarizationArg,
    /// Fibers in view at once, whose patterns add up.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub fibers: u32,
    /// Waist of the beam on the ply [um] [default: the one of the patterns' spec].
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    pub w0: Option<f64>,
    /// Seed of the sources.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}
