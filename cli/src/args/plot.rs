//! Flags of figures.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Part of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// All of the below.
    All,
    /// Maps of f(theta_o, phi_o).
    Maps,
    /// Energy over (theta_i, h).
    Energy,
    /// Fit error (for a table, its noise) over (theta_i, h).
    Errors,
    /// For a model with noise: f_refl and f_high of one instance beside the smooth ones, in color.
    Noise,
    /// For a spec: the edge lobes beside the diffraction integral, instead of gaps.
    Edge,
}

/// `plywave plot`.
#[derive(Clone, Debug, Args)]
pub struct PlotArgs {
    /// Table, model, fiber table, speckle patterns (the last two take no other flags), or a yarn spec
    /// (.toml): how gaps and the ply's edge diffract its beam.
    pub file: PathBuf,
    /// Figure to write, a PNG or an SVG by its ending [default: FILE's name with .png, in this folder].
    #[arg(long, short, value_name = "PNG|SVG")]
    pub output: Option<PathBuf>,
    /// With a model: the table to set beside it, with the residual.
    #[arg(long, value_name = "TABLE", conflicts_with = "model")]
    pub table: Option<PathBuf>,
    /// With a table: the model to set beside it, with the residual.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Another table or model to draw below on the same scale, such as a ply below its yarn.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["table", "model"])]
    pub beside: Option<PathBuf>,
    /// Latitude of one incidence [degrees]; a table uses its nearest node [default: an overview].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub theta_i: Option<f64>,
    /// Offset of one incidence, the beam's center over the ply radius; a table uses its nearest node.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    pub h_rel: Option<f64>,
    /// One to four absorption coefficients [1/um]; a table uses its nearest [default: 0 in maps, and one of
    /// the table's in the budget].
    #[arg(long, value_name = "SIGMA", num_args = 1..=4, value_delimiter = ',')]
    pub sigma: Vec<f64>,
    /// Decades of the color scale.
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
