//! A cloth as a periodic set of ply curves: woven, knitted or read from a file.
//!
//! Each curve is the axis of a ply, or of a bundle of filaments that counts as one: a smooth curve,
//! periodic up to a vector of the [cell](Lattice), with a radius. Nothing here knows of warp and weft: a
//! [`ClothYarn`] only says which yarn of the spec a curve belongs to. [`ClothSpec`] describes a cloth in
//! textile units; `plywave_sim::cloth` makes the curves.

mod curves;
mod dyes;
mod file;
mod follow;
mod gap;
mod grid;
mod lattice;
mod lines;
mod make;
mod model;
mod nearest;
mod plies;
mod rules;
mod shade;
mod spec;
mod surface;
mod tensors;
mod units;

pub use curves::{ClothCurves, ClothYarn, CurvePoint, MAX_CURVE_POINTS, PlyCurve};
pub use file::ClothData;
pub use lattice::{Buckets, Lattice, whole_times};
pub use lines::{ClothLines, LineHit, LineHits, MAX_HITS};
pub use model::ClothModel;
#[doc(hidden)]
pub use rules::CLOTH_RULES;
pub(crate) use shade::ClothShade;
pub use spec::{ClothSpec, ClothWeave, KnitSpec, SourceCurves, Stripe, YarnOfCloth};
pub use surface::ClothSurface;
pub use units::Count;
