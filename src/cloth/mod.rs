//! A cloth as a periodic set of ply curves: woven, knitted or read from a file.
//!
//! Each curve is the axis of a ply, or of a bundle of filaments that is treated as one ply: a smooth curve
//! with a radius, periodic up to a vector of the [cell](Lattice). The module makes no difference between warp
//! and weft: a [`ClothYarn`] only says to which kind of yarn a curve belongs. `plywave_textile::ClothSpec`
//! describes a cloth in textile units, and `plywave_sim::cloth` computes the curves from it.

mod bsdf;
mod color;
mod file;
pub mod geometry;
pub mod light;
mod model;
mod query;
pub mod shade;
mod tensors;
mod uv;
mod yarn_look;

pub use bsdf::ClothBsdf;
pub use color::color_of;
pub use color::color_of::{Brightness, ColorOf};
pub use color::dye::{Channels, ColorReach};
pub use file::pwc::ClothData;
pub use geometry::curves::{ClothCurves, ClothYarn, CurvePoint, MAX_CURVE_POINTS, PlyCurve};
pub use geometry::lattice::{Buckets, Lattice, whole_times};
pub use geometry::lines::{ClothLines, LineHit, LineHits, MAX_HITS};
pub use model::ClothModel;
pub use query::{ClothOptions, ClothQuery, GapLight};
pub use tensors::{Tensor, Values};
pub use uv::UvMap;
pub use yarn_look::{Slits, Unevenness, YarnColor, YarnLook};
