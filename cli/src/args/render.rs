//! Flags of fabrics: rendering, weaving.

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
    /// Paths are followed.
    Path,
    /// Dual scattering: estimated from the strands that shadow rays meet, with an error
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
    /// Fabric spec, or a scene of strands with its own lamps and camera (TOML).
    pub fabric: PathBuf,
    /// Scene for a fabric [default: front].
    #[arg(long, value_enum)]
    pub setup: Option<Scene>,
    /// Picture to write: a .png, with an EXR of the same name beside it, or an .exr alone [default: FABRIC's
    /// name with .png, in this folder].
    #[arg(long, short, value_name = "PNG|EXR")]
    pub output: Option<PathBuf>,
    /// No EXR beside the PNG.
    #[arg(long)]
    pub no_exr: bool,
    /// Width of the picture [pixels].
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub width: u32,
    /// Height of the picture [pixels].
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub height: u32,
    /// Samples a pixel.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: u32,
    /// Most scatterings of a path. Paths are thinned out by chance, so that the default leaves out next to
    /// nothing; a note tells what fewer leave out.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = plywave_render::MAX_SCATTERINGS, value_parser = clap::value_parser!(u32).range(1..=i64::from(plywave_render::MAX_SCATTERINGS)))]
    pub depth: u32,
    /// How light between strands is found [default: path].
    #[arg(long, value_enum)]
    pub integrator: Option<Integrator>,
    /// Width of the cloth, or largest extent of a mesh [mm] [default: the scene's].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub size_mm: Option<f64>,
    /// Mesh in place of the scene's own: Wavefront OBJ with texture coordinates, z up; centered, and scaled
    /// to --size-mm.
    #[arg(long, value_name = "OBJ")]
    pub mesh: Option<PathBuf>,
    /// Cloth to one unit of the mesh's texture coordinates [mm].
    #[arg(long, value_name = "MM", allow_negative_numbers = true, default_value_t = 100.0, requires = "mesh")]
    pub cloth_mm: f64,
    /// Light from afar in place of the scene's own: OpenEXR or Radiance .hdr, in latitude and longitude, z
    /// up; 1 is as bright as a white cloth under it.
    #[arg(long, value_name = "EXR|HDR")]
    pub sky: Option<PathBuf>,
    /// Layer of the EXR that is the sky, where it has several.
    #[arg(long, value_name = "NAME", requires = "sky")]
    pub sky_layer: Option<String>,
    /// Place of the camera in place of the scene's own [mm]: x, y, z, with z up; a flat sheet lies about the
    /// origin at z = 0.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub camera: Option<[f64; 3]>,
    /// Point in the middle of the picture [mm] [default: the scene's, about the origin].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub look: Option<[f64; 3]>,
    /// Direction that is up in the picture [default: the scene's, or z].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple)]
    pub up: Option<[f64; 3]>,
    /// Angle across the picture's height [degrees] [default: the scene's].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub fov: Option<f64>,
    /// One absorption coefficient [1/um] for all yarns in place of their colors; 0 for a white fabric.
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma: Option<f64>,
    /// Light through gaps goes straight on in place of being diffracted, for comparison.
    #[arg(long)]
    pub straight_gaps: bool,
    /// Without speckle, which the models that ship have.
    #[arg(long)]
    pub smooth: bool,
    /// Slits between the fibers of all yarns, this wide [um], 5 at most, in place of those of the spec:
    /// colors of loose cloth before a small lamp.
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    pub slit_um: Option<f64>,
    /// Share of the forward light that goes through these slits [default: 0.25].
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, requires = "slit_um")]
    pub slit_share: Option<f64>,
    /// Leave parts of the model out, for comparison: `layers` (yarns of the layer below catch nothing),
    /// `shadowing` (yarns beside catch nothing), `edges` (light at a ply's edge goes straight on), `slits`
    /// (those of the spec).
    #[arg(long, value_name = "PART", num_args = 1, value_delimiter = ',', value_enum)]
    pub without: Vec<FabricPart>,
    /// Stops by which the PNG is brighter.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f64,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 1)]
    pub seed: u64,
    /// Go on with a render that was stopped or had fewer samples.
    #[arg(long)]
    pub resume: bool,
    /// Keep the sums, so that --resume can add samples.
    #[arg(long)]
    pub keep_sums: bool,
}

/// Parts of the fabric model that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FabricPart {
    /// The layer below.
    Layers,
    /// Neighbors.
    Shadowing,
    /// Diffraction at a ply's edge.
    Edges,
    /// Slits between fibers, of the spec.
    Slits,
    /// The mean over the repeat, for pixels that cover half of it or more.
    Far,
}

/// `plywave weave`.
#[derive(Debug, Args)]
pub struct WeaveArgs {
    /// Fabric spec (TOML).
    pub fabric: PathBuf,
    /// Folder to write [default: FABRIC's name with .weave, in this folder].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Pixels from one yarn to the next, in the family that lies closer [default: 32, fewer where a repeat
    /// would be longer than 4096].
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub pixels: Option<u32>,
    /// Textures of the back in place of the face, in the same coordinates.
    #[arg(long)]
    pub back: bool,
}
