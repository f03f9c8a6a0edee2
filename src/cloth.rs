//! A cloth as a periodic set of ply curves: woven, knitted or read from a file.
//!
//! Each curve is the axis of a ply, or of a bundle of filaments that counts as one: a smooth curve,
//! periodic up to a vector of the [cell](Lattice), with a radius. Nothing here knows of warp and weft: a
//! [`ClothYarn`] only says which yarn of the spec a curve belongs to. [`ClothSpec`] describes a cloth in
//! textile units; `plywave_sim::cloth` makes the curves.

mod between;
mod bsdf;
mod color_of;
mod curves;
mod draft;
mod dye;
mod far;
mod file;
mod follow;
mod gap;
mod grid;
mod lattice;
mod layers;
mod lines;
mod make;
mod model;
mod names;
mod nearest;
mod paths;
mod plies;
mod query;
mod regression;
mod rules;
mod shade;
mod shadow;
mod spec;
mod splines;
mod tensors;
mod units;
mod uv;
mod weave;
mod wif;
mod yarn_colors;

pub use bsdf::ClothBsdf;
pub use color_of::ColorOf;
pub use curves::{ClothCurves, ClothYarn, CurvePoint, MAX_CURVE_POINTS, PlyCurve};
pub use draft::{Draft, MAX_THREADS, YarnSet};
pub use dye::{Channels, ColorReach};
pub use file::ClothData;
pub use lattice::{Buckets, Lattice, whole_times};
pub use layers::Layer;
pub use lines::{ClothLines, LineHit, LineHits, MAX_HITS};
pub use model::ClothModel;
pub use query::{ClothOptions, ClothQuery, GapLight, Slits};
pub(crate) use query::{to_pattern, to_surface};
#[doc(hidden)]
pub use rules::CLOTH_RULES;
pub use spec::{ClothSpec, ClothWeave, KnitSpec, SourceCurves, Stripe, YarnOfCloth};
pub use tensors::{Tensor, Values};
pub use units::Count;
pub use uv::UvMap;
pub use weave::{WeaveSpec, YarnColor};
pub use wif::{Wif, WifNote, WifNoteKind, WifSpacing};
