//! Flags of exports.

use super::twin::view;
use clap::{Args, ValueEnum};
use plywave_pipeline::exports::Format;
use std::path::PathBuf;

/// Formats of `plywave export`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// What a lab measures: R, T, openness, color, the five numbers of EN 14501, by angle; .md, .html, .json
    /// or .csv.
    Report,
    /// BSDF of LBNL WINDOW and Radiance between the patches of Klems (.xml).
    Klems,
    /// Tensor tree of Radiance (.xml).
    Tensortree,
    /// Reflection of the face as a measured material of the RGL, for Mitsuba, pbrt and others (.bsdf).
    Rgl,
    /// OpenPBR as MaterialX (.mtlx), with textures over the repeat beside it.
    Openpbr,
    /// A swatch as glTF (.glb).
    Gltf,
    /// A swatch as USD (.usda), with MaterialX beside it.
    Usd,
    /// A node group for Cycles and a swatch, as a Python file for Blender (.py) with textures beside it.
    Blender,
    /// A material for scenes of Mitsuba 3 (.xml), with textures beside it.
    Mitsuba,
}

impl From<ExportFormat> for Format {
    fn from(format: ExportFormat) -> Format {
        match format {
            ExportFormat::Report => Format::Report,
            ExportFormat::Klems => Format::Klems,
            ExportFormat::Tensortree => Format::TensorTree,
            ExportFormat::Rgl => Format::Rgl,
            ExportFormat::Openpbr => Format::OpenPbr,
            ExportFormat::Gltf => Format::Gltf,
            ExportFormat::Usd => Format::Usd,
            ExportFormat::Blender => Format::Blender,
            ExportFormat::Mitsuba => Format::Mitsuba,
        }
    }
}

/// `plywave export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Cloth file (.pwc) or cloth spec (TOML).
    pub cloth: PathBuf,
    /// Format.
    #[arg(long, value_enum)]
    pub to: ExportFormat,
    /// File to write; a report may have several, given one by one, of which each has the format of its ending
    /// [default: CLOTH's name, the format's and its ending, as organza_klems.xml, in this folder].
    #[arg(long, short, value_name = "FILE", num_args = 1)]
    pub output: Vec<PathBuf>,
    /// Replace files that are not of an earlier export to the same format.
    #[arg(long)]
    pub force: bool,
    /// One absorption coefficient [1/um] for all yarns instead of their colors.
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma: Option<f64>,
    /// Absorption coefficient of all yarns below 0.38 um [1/um], for solar numbers and the UPF [default: that
    /// at 0.38 um, and no UPF].
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma_uv: Option<f64>,
    /// Absorption coefficient of all yarns above 0.78 um [1/um], for solar numbers [default: that at 0.78
    /// um].
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    pub sigma_ir: Option<f64>,
    /// Directions of the light in a report, TILT or TILT:AZIMUTH [degrees]: the tilt from the face's normal,
    /// above 90 to the back, and the azimuth from x, the weft, towards y, the warp [default: 0 to 75 by 15,
    /// at 0, 45 and 90, both sides].
    #[arg(long, value_name = "T:A", num_args = 1, value_delimiter = ',', allow_negative_numbers = true, value_parser = view)]
    pub views: Vec<[f64; 2]>,
    /// Samples of each direction of a report [default: 16384].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(256..=1_048_576))]
    pub samples: Option<u32>,
    /// Seed of the samples.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u32,
    /// Squares along an edge of the hemisphere of a tensor tree: 8, 16 or 32 [default: 16].
    #[arg(long, value_name = "N")]
    pub squares: Option<usize>,
    /// Spectra instead of linear sRGB, in an RGL file: for spectral renderers.
    #[arg(long)]
    pub spectral: bool,
    /// Pixels of textures along the longer side of the repeat, 16 to 4096 [default: 256].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub pixels: Option<u32>,
    /// Length of cloth per unit of a surface's texture coordinates in MaterialX, Blender and Mitsuba [mm]
    /// [default: 100].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub cloth_mm: Option<f64>,
}
