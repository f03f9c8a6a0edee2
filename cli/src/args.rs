//! The command line. Angles are in degrees here and nowhere else; offsets are relative to the ply radius.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Simulates how a ply of fibers scatters light, fits a compact model to it, and inspects, checks, compares and plots models.
#[derive(Debug, Parser)]
#[command(name = "plywave", version, max_term_width = 110, disable_help_subcommand = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Say nothing but results and errors.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Print results as JSON.
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of threads; results do not depend on it [default: one a core].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate the scattering of a yarn's ply: spec (TOML) in, table (.pwt) out.
    Simulate(SimulateArgs),
    /// Fit a ply model to a table: table (.pwt) in, model (.pwm) out.
    Fit(FitArgs),
    /// Simulate and fit in one go. Without a spec: polyester, compiled in, at preview quality.
    Build(BuildArgs),
    /// Tell what a table, a model, a fiber or a file of speckle patterns holds.
    Info(InfoArgs),
    /// Evaluate a model at one incidence and one outgoing direction.
    Eval(EvalArgs),
    /// Sample outgoing directions of a model at one incidence, as CSV lines.
    Sample(SampleArgs),
    /// Check a model: furnace, eval against weight times pdf, chi-square of sampling, fit error of every slice. Exit code 1 when one fails.
    Check(CheckArgs),
    /// Compare two models, or two tables, slice by slice. Exit code 1 beyond the tolerance.
    Diff(DiffArgs),
    /// Draw a table or a model as a PNG: false-colour maps, energy budget, fit errors; of speckle patterns curves and covariances.
    Plot(PlotArgs),
    /// Give a model speckle noise: patterns (.pws) and a model (.pwm) in, the model with noise tiles out.
    Noise(NoiseArgs),
    /// Turn a color or a reflectance into the absorption of a model's fibers, by inverting its albedo.
    Color(ColorArgs),
    /// Draw the weave of a fabric: fabric spec (TOML) in, folder with textures (PNG) and a sheet to look at out.
    Weave(WeaveArgs),
    /// Wave optics of parallel fibers.
    Wave(WaveArgs),
    /// Compare wave and ray optics over instances of a ply's cross section: spec (TOML) in, folder with report.json and compare.png out.
    Compare(CompareArgs),
    /// Render a fabric in a ready-made scene: fabric spec (TOML) in, PNG and EXR out.
    Render(RenderArgs),
    /// Render the gallery: the fabrics that ship, front-lit and back-lit, and what each part of the model does to them. A folder of PNGs with an index out.
    Gallery(GalleryArgs),
}

/// Ready-made scenes.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Scene {
    /// A flat sheet lit from the viewer's side.
    Front,
    /// A flat sheet between the viewer and the lamp.
    Back,
    /// A sheet over a ball.
    Drape,
    /// A sheet with parallel folds.
    Folds,
    /// A few yarns from above.
    Swatch,
    /// A flat sheet under equal light from everywhere.
    Furnace,
}

/// `plywave render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Fabric spec (TOML).
    pub fabric: PathBuf,
    /// Scene.
    #[arg(long, value_enum, default_value_t = Scene::Front)]
    pub setup: Scene,
    /// PNG to write, with an EXR of the same name beside it [default: FABRIC's name with .png, in this folder].
    #[arg(long, short, value_name = "PNG")]
    pub output: Option<PathBuf>,
    /// Width of the picture [pixels].
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub width: u32,
    /// Height of the picture [pixels].
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub height: u32,
    /// Samples a pixel.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: u32,
    /// Most scatterings of a path.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub depth: u32,
    /// Width of the cloth [mm] [default: the scene's].
    #[arg(long, value_name = "MM")]
    pub size_mm: Option<f64>,
    /// Mesh in place of the scene's own: Wavefront OBJ with texture coordinates.
    #[arg(long, value_name = "OBJ")]
    pub mesh: Option<PathBuf>,
    /// Cloth to one unit of the mesh's texture coordinates [mm].
    #[arg(long, value_name = "MM", default_value_t = 100.0, requires = "mesh")]
    pub cloth_mm: f64,
    /// Light from afar in place of the scene's own: EXR, latitude and longitude, z up.
    #[arg(long, value_name = "EXR")]
    pub sky: Option<PathBuf>,
    /// One absorption coefficient [1/um] for all yarns in place of their colours; 0 for a white fabric.
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma: Option<f64>,
    /// Light through gaps goes straight on in place of being diffracted, for comparison.
    #[arg(long)]
    pub straight_gaps: bool,
    /// Without speckle, where the models have tiles of it.
    #[arg(long)]
    pub smooth: bool,
    /// Stops by which the PNG is brighter.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Go on with a render that was stopped or had fewer samples.
    #[arg(long)]
    pub resume: bool,
    /// Keep the sums, so that --resume can add samples.
    #[arg(long)]
    pub keep_sums: bool,
}

/// `plywave gallery`.
#[derive(Debug, Args)]
pub struct GalleryArgs {
    /// Folder to write: pictures, small ones of them, the fabrics and models they are made of, gallery.json and gallery.md.
    #[arg(long, short, value_name = "FOLDER", default_value = "gallery")]
    pub output: PathBuf,
    /// Small pictures of few samples, and models of few paths: the whole gallery in about a minute.
    #[arg(long)]
    pub quick: bool,
    /// These pictures only; an unknown name lists all.
    #[arg(long, value_name = "NAME", num_args = 1, value_delimiter = ',')]
    pub only: Vec<String>,
    /// Folder of the fabric and yarn specs that ship.
    #[arg(long, value_name = "FOLDER", default_value = "fabrics")]
    pub fabrics: PathBuf,
    /// Skip pictures that are there with the same settings.
    #[arg(long)]
    pub resume: bool,
}

/// `plywave weave`.
#[derive(Debug, Args)]
pub struct WeaveArgs {
    /// Fabric spec (TOML).
    pub fabric: PathBuf,
    /// Folder to write [default: FABRIC's name with .weave, in this folder].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Pixels from one yarn to the next, in the family that lies closer [default: 32, fewer where a repeat would be longer than 4096].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub pixels: Option<u32>,
    /// Textures of the back in place of the face, in the same coordinates.
    #[arg(long)]
    pub back: bool,
}

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
    /// Go on with a run that was stopped, or that had fewer instances and kept its parts; the result is bit for bit that of one that was not.
    #[arg(long)]
    pub resume: bool,
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
    /// Tabulate how one fiber scatters light of every direction and wavelength: spec or scene (TOML) in, fiber (.pwf) out.
    Tabulate(WaveTabulateArgs),
    /// Scatter a wide beam by many instances of a spec's fiber, for the statistics of speckle: spec (TOML) in, patterns (.pws) out.
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
    /// Go on with a run that was stopped; the result is bit for bit that of one that was not.
    #[arg(long)]
    pub resume: bool,
}

/// `plywave wave tabulate`.
#[derive(Debug, Args)]
pub struct WaveTabulateArgs {
    /// Yarn spec, whose mean fiber is taken without jitter, or scene of one fiber (TOML).
    pub spec: PathBuf,
    /// Fiber table to write [default: SPEC's name with .pwf, in this folder].
    #[arg(long, short, value_name = "FIBER")]
    pub output: Option<PathBuf>,
    /// By rays in place of waves.
    #[arg(long)]
    pub rays: bool,
    /// Quality; standard has the sizes of Xia 2020.
    #[arg(long, value_enum, default_value_t = Preset::Standard)]
    pub preset: Preset,
    /// Go on with a run that was stopped; the result is bit for bit that of one that was not.
    #[arg(long)]
    pub resume: bool,
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
    /// Most azimuths phi_i round the fiber, instead of the preset's.
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
    /// Scene (TOML), as docs/format.md tells.
    pub scene: PathBuf,
    /// JSON file to write [default: SCENE's name with .json, in this folder].
    #[arg(long, short, value_name = "OUT")]
    pub output: Option<PathBuf>,
}

/// Quality of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// A quick look: under a minute for polyester.
    Preview,
    /// For use: minutes.
    Standard,
    /// For comparison: hours.
    Reference,
}

impl Preset {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Preset::Preview => "preview",
            Preset::Standard => "standard",
            Preset::Reference => "reference",
        }
    }
}

/// Flags of a simulation.
#[derive(Clone, Debug, Args)]
pub struct RunArgs {
    /// Quality [default: standard; preview when no spec is given].
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Go on with a run that was stopped; the result is bit for bit that of one that was not.
    #[arg(long)]
    pub resume: bool,
    /// Paths per incident latitude, instead of the spec's or the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub paths: Option<u64>,
    /// Geometry instances in the ensemble, instead of the spec's or the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub instances: Option<u32>,
}

/// What a simulation traces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Plies {
    /// One ply, as every model needs it.
    One,
    /// All plies of the yarn, path by path: the truth that the yarn's model is measured against.
    Traced,
}

/// `plywave simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// Yarn spec (TOML).
    pub spec: PathBuf,
    /// Table to write [default: SPEC's name with .pwt, in this folder].
    #[arg(long, short, value_name = "TABLE")]
    pub output: Option<PathBuf>,
    /// What to trace, where the spec's yarn has several plies.
    #[arg(long, value_enum, default_value_t = Plies::One)]
    pub plies: Plies,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
}

/// `plywave fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// Table to fit (.pwt).
    pub table: PathBuf,
    /// Model to write [default: TABLE's name with .pwm, in this folder].
    #[arg(long, short, value_name = "MODEL")]
    pub output: Option<PathBuf>,
    /// Quality of the fit [default: the table's].
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Make the model of this spec's yarn in place of that of the table's: of as many plies as it says, made of the fibers and the ply of the
    /// table.
    #[arg(long, value_name = "SPEC")]
    pub spec: Option<PathBuf>,
    /// Write the yarn's table too, made of the ply's where the spec's yarn has several plies.
    #[arg(long, value_name = "TABLE")]
    pub yarn_table: Option<PathBuf>,
}

/// `plywave build`.
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// Yarn spec (TOML) [default: polyester, compiled in].
    pub spec: Option<PathBuf>,
    /// Model to write [default: SPEC's name with .pwm, in this folder].
    #[arg(long, short, value_name = "MODEL")]
    pub output: Option<PathBuf>,
    /// Keep the simulated table too, under the model's name with .pwt.
    #[arg(long)]
    pub keep_table: bool,
    /// Without speckle tiles, which are most of a model's file; preview quality has none.
    #[arg(long, conflicts_with = "speckle")]
    pub smooth: bool,
    /// Speckle patterns (.pws) to make the tiles from, in place of solving for 200 fibers.
    #[arg(long, value_name = "PATTERNS")]
    pub speckle: Option<PathBuf>,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
}

/// `plywave info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Table, model, fiber or speckle patterns.
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
    #[arg(long, value_name = "SIGMA", num_args = 1..=4, value_delimiter = ',', default_values_t = [0.0])]
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
    #[arg(short = 'n', long = "count", value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub count: u64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// `plywave check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Model.
    pub model: PathBuf,
    /// A table to hold the model's slices to, best one of another seed.
    #[arg(long, value_name = "TABLE")]
    pub table: Option<PathBuf>,
    /// Of a yarn of several plies, the traced yarn (`plywave simulate SPEC --plies traced`) to hold the model to, and the table of --table too; a --table that is traced serves as well.
    #[arg(long, value_name = "TABLE")]
    pub twin: Option<PathBuf>,
    /// Largest fit error of an f_refl slice that passes.
    #[arg(long, value_name = "ERROR", default_value_t = 0.2)]
    pub max_error_refl: f64,
    /// Largest fit error of an f_high slice that passes, as a share of its light at sigma = 0.
    #[arg(long, value_name = "ERROR", default_value_t = 0.15)]
    pub max_error_high: f64,
    /// Number of incidences to check.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub incidences: u32,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// `plywave diff`.
#[derive(Debug, Args)]
pub struct DiffArgs {
    /// First model or table.
    pub a: PathBuf,
    /// Second model or table. Of tables, the incidences and absorptions that both hold are compared, the noise of both taken off.
    pub b: PathBuf,
    /// Largest relative L2 distance of a slice that passes [default: 0.02].
    #[arg(long, value_name = "TOL")]
    pub tol: Option<f64>,
    /// Largest difference of an energy that passes, as a share of the beam's power [default: 0.002].
    #[arg(long, value_name = "TOL")]
    pub tol_energy: Option<f64>,
    /// Largest turn of a lobe's axis that passes [degrees] [default: any, since different lobes may make one density].
    #[arg(long, value_name = "DEG")]
    pub tol_drift: Option<f64>,
    /// Of tables, leave out offsets beyond this |h/R|, where little light is scattered [default: all].
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    pub max_h_rel: Option<f64>,
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
    /// Model to give noise to; without one the statistics are told and nothing is written.
    #[arg(long, short, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Model to write [default: MODEL's name with -noise.pwm, in this folder].
    #[arg(long, short, value_name = "MODEL", requires = "model")]
    pub output: Option<PathBuf>,
    /// Tiles of each kind: 1, 2, 4 or 8, of half a MiB each.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = tiles)]
    pub tiles: u32,
    /// Contrast of the noise.
    #[arg(long, value_enum, default_value_t = NoiseContrastArg::Measured)]
    pub contrast: NoiseContrastArg,
    /// Light of which polarization.
    #[arg(long, value_enum, default_value_t = PolarizationArg::Unpolarized)]
    pub polarization: PolarizationArg,
    /// Fibers in view at once, whose patterns add up.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub fibers: u32,
    /// Waist of the beam on the ply [um] [default: the one of the patterns' spec].
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    pub w0: Option<f64>,
    /// Seed of the tiles.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

fn tiles(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(n) if [1, 2, 4, 8].contains(&n) => Ok(n),
        _ => Err("must be 1, 2, 4 or 8".into()),
    }
}

/// `plywave color`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("wanted").required(true))]
pub struct ColorArgs {
    /// Model.
    pub model: PathBuf,
    /// Color of the light sent back under D65, encoded sRGB, 0 to 1.
    #[arg(
        long,
        value_name = "R,G,B",
        num_args = 1,
        value_delimiter = ',',
        allow_negative_numbers = true,
        group = "wanted"
    )]
    pub srgb: Vec<f64>,
    /// Reflectances from 0.38 to 0.78 um in equal steps, one for a gray.
    #[arg(long, value_name = "R", num_args = 1..=401, value_delimiter = ',', allow_negative_numbers = true, group = "wanted")]
    pub reflectance: Vec<f64>,
    /// Albedo at this latitude [degrees] [default: under diffuse light].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub theta_i: Option<f64>,
}

/// Part of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// All of the below.
    All,
    /// Maps of f(theta_o, phi_o).
    Maps,
    /// Energy over (theta_i, h).
    Energy,
    /// Fit error (of a table: its noise) over (theta_i, h).
    Errors,
    /// Of a model with noise tiles: f_refl and f_high of one instance beside the smooth ones, in color.
    Noise,
    /// Of a spec: the edge lobes beside the diffraction integral, instead of gaps.
    Edge,
}

/// `plywave plot`.
#[derive(Clone, Debug, Args)]
pub struct PlotArgs {
    /// Table, model, fiber table, speckle patterns (the last two take no other flags), or a yarn spec (.toml): how gaps and the ply's edge diffract its beam.
    pub file: PathBuf,
    /// PNG to write [default: FILE's name with .png, in this folder].
    #[arg(long, short, value_name = "PNG")]
    pub output: Option<PathBuf>,
    /// With a model: the table to set beside it, with the residual.
    #[arg(long, value_name = "TABLE", conflicts_with = "model")]
    pub table: Option<PathBuf>,
    /// With a table: the model to set beside it, with the residual.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Another table or model, drawn below on the same scale: a ply alone and in its yarn, say.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["table", "model"])]
    pub beside: Option<PathBuf>,
    /// One incidence: latitude [degrees], to the nearest node of a table [default: an overview].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub theta_i: Option<f64>,
    /// One incidence: offset of the beam's center over the ply radius, to the nearest node of a table.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    pub h_rel: Option<f64>,
    /// Absorption coefficients [1/um], one to four; the nearest of a table [default: 0 in maps, and one of the table's in the budget].
    #[arg(long, value_name = "SIGMA", num_args = 1..=4, value_delimiter = ',')]
    pub sigma: Vec<f64>,
    /// Decades of the colour scale.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=12))]
    pub decades: u32,
    /// What to draw.
    #[arg(long, value_enum, default_value_t = Part::All)]
    pub part: Part,
    /// With a spec: width and height of one gap [um], and its center's x and y [default: four centered gaps].
    #[arg(long, value_name = "W,H[,X,Y]", num_args = 1, value_delimiter = ',', allow_negative_numbers = true)]
    pub gap: Vec<f64>,
    /// With a spec: tilt of the light from the normal of the gap [degrees].
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub tilt: f64,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn command_line_is_well_formed() {
        super::Cli::command().debug_assert();
    }
}
