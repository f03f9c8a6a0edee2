//! Flags of cloths: rendering, weaving.

use super::build::Preset;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Ready-made scenes.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Scene {
    /// A flat sheet lit from the viewer's side.
    Front,
    /// A flat sheet between the viewer and the lamp.
    Back,
    /// A sheet over a ball.
    Drape,
    /// A curtain before a bright window.
    Curtain,
    /// Three folded sheets on each other.
    Folded,
    /// A sheet drawn around a ball, from near.
    Ball,
    /// A sheet with parallel folds.
    Folds,
    /// A few yarns from above.
    Swatch,
    /// A flat sheet seen from ten degrees above its plane, against the light.
    Grazing,
    /// A flat sheet under equal light from everywhere.
    Furnace,
}

/// How light between strands is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Integrator {
    /// Path tracing.
    Path,
    /// Dual scattering: estimated from the strands that shadow rays hit, with an error
    /// (docs/explain/dual_scattering.md).
    Dual,
}

/// Three numbers with commas between them.
fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers = text.split(',').map(|part| part.trim().parse::<f64>().ok().filter(|v| v.is_finite()));
    let numbers = numbers.collect::<Option<Vec<f64>>>().and_then(|list| list.try_into().ok());
    numbers.ok_or_else(|| "give three numbers, as in 0,-100,50".into())
}

/// `plywave render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Cloth file (.pwc), cloth spec, or a scene of strands with its own lamps and camera (TOML).
    pub cloth: PathBuf,
    /// Scene for a cloth [default: front].
    #[arg(long, value_enum)]
    pub setup: Option<Scene>,
    /// Picture to write: a .png, with an EXR of the same name beside it, or an .exr alone [default: CLOTH's
    /// name with .png, in this folder].
    #[arg(long, short, value_name = "PNG|EXR")]
    pub output: Option<PathBuf>,
    /// Write no EXR beside the PNG.
    #[arg(long)]
    pub no_exr: bool,
    /// Width of the picture [pixels].
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub width: u32,
    /// Height of the picture [pixels].
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub height: u32,
    /// Samples per pixel.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: u32,
    /// Largest number of scatterings of a path. Paths end by Russian roulette, so the default leaves out
    /// almost no light; for smaller numbers a note estimates the light left out.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = plywave_render::MAX_SCATTERINGS, value_parser = clap::value_parser!(u32).range(1..=i64::from(plywave_render::MAX_SCATTERINGS)))]
    pub depth: u32,
    /// Method for the light between strands [default: path].
    #[arg(long, value_enum)]
    pub integrator: Option<Integrator>,
    /// Width of the cloth, or largest extent of a mesh [mm] [default: the scene's].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub size_mm: Option<f64>,
    /// Mesh instead of the scene's own: Wavefront OBJ with texture coordinates, z up; centered, and scaled
    /// to --size-mm.
    #[arg(long, value_name = "OBJ")]
    pub mesh: Option<PathBuf>,
    /// Length of cloth per unit of the mesh's texture coordinates [mm].
    #[arg(long, value_name = "MM", allow_negative_numbers = true, default_value_t = 100.0, requires = "mesh")]
    pub cloth_mm: f64,
    /// Environment map instead of the scene's own light from afar: OpenEXR or Radiance .hdr, in latitude and
    /// longitude, z up; under a uniform map of 1, a white cloth has radiance 1.
    #[arg(long, value_name = "EXR|HDR")]
    pub sky: Option<PathBuf>,
    /// Layer of the EXR that is the sky, where it has several.
    #[arg(long, value_name = "NAME", requires = "sky")]
    pub sky_layer: Option<String>,
    /// Position of the camera [mm]: x, y, z, with z up; a flat sheet lies about the origin at z = 0
    /// [default: the scene's].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub camera: Option<[f64; 3]>,
    /// Point in the middle of the picture [mm] [default: the scene's, about the origin].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub look: Option<[f64; 3]>,
    /// Direction that is up in the picture [default: the scene's, or z].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view [degrees] [default: the scene's].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub fov: Option<f64>,
    /// One absorption coefficient [1/um] for all yarns instead of their colors; 0 for a white cloth.
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma: Option<f64>,
    /// Trace the fibers of the cloth themselves instead of its model, for comparison: by rays, without
    /// diffraction and speckle. It takes much longer.
    #[arg(long, conflicts_with_all = ["straight_gaps", "slit_um", "without"])]
    pub fibers: bool,
    /// Make the scene's lamps this many times as wide, for the same light on the cloth.
    #[arg(long, value_name = "TIMES", allow_negative_numbers = true)]
    pub lamp_scale: Option<f64>,
    /// Let light through gaps go straight on without diffraction, for comparison.
    #[arg(long)]
    pub straight_gaps: bool,
    /// Leave speckle out, which the models that ship have.
    #[arg(long)]
    pub smooth: bool,
    /// Width of slits between the fibers of all yarns [um], at most 5, instead of the spec's; slits give the
    /// colors of loose cloth before a small lamp.
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    pub slit_um: Option<f64>,
    /// Share of the forward light that goes through these slits [default: 0.25].
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, requires = "slit_um")]
    pub slit_share: Option<f64>,
    /// Leave parts of the model out, for comparison: `layers` (yarns of the layer below block no light),
    /// `shadowing` (neighboring yarns block no light), `edges` (light at a ply's edge goes straight on),
    /// `slits` (those of the spec), `uneven` (yarns are even), `relief` (plies are smooth tubes), `far` (the
    /// mean over the cell).
    #[arg(long, value_name = "PART", num_args = 1, value_delimiter = ',', value_enum)]
    pub without: Vec<ClothPart>,
    /// Exposure of the PNG in stops; positive is brighter [default: metered from the picture; 0 for strands
    /// and for the setup furnace].
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    pub exposure: Option<f64>,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1)]
    pub seed: u64,
    /// Continue a render that was stopped or had fewer samples.
    #[arg(long)]
    pub resume: bool,
    /// Delete the sums of a stopped render and start over.
    #[arg(long, conflicts_with = "resume")]
    pub fresh: bool,
    /// Keep the sums, so that --resume can add samples.
    #[arg(long)]
    pub keep_sums: bool,
}

/// Parts of the cloth model that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ClothPart {
    /// The layer below.
    Layers,
    /// Neighbors.
    Shadowing,
    /// Diffraction at a ply's edge.
    Edges,
    /// Slits between fibers, of the spec.
    Slits,
    /// Unevenness of yarns.
    Uneven,
    /// Fibers on the surface of plies.
    Relief,
    /// The mean over the cell, for pixels that cover half of it or more.
    Far,
}

/// `plywave weave`.
#[derive(Debug, Args)]
pub struct WeaveArgs {
    /// Cloth spec (TOML).
    pub cloth: PathBuf,
    /// File to write: the cloth, ready for shading (.pwc), or the curves of its plies (.toml, .bcc, .tg3)
    /// [default: none].
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Least quality of the ply models: others are built, and kept in the cache [default: any; preview for
    /// those that are built].
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Make a quick shape for look development: relaxed less, and of a large draft without forces.
    #[arg(long)]
    pub draft: bool,
    /// End with exit code 1, and write no file, if the cloth did not come to rest.
    #[arg(long)]
    pub strict: bool,
}
