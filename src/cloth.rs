//! A cloth as a periodic set of ply curves: woven, knitted or read from a file.
//!
//! Each curve is the axis of a ply, or of a bundle of filaments that counts as one: a smooth curve,
//! periodic up to a vector of the [cell](Lattice), with a radius. Nothing here knows of warp and weft: a
//! [`ClothYarn`] only says which yarn of the spec a curve belongs to. [`ClothSpec`] describes a cloth in
//! textile units; `plywave_sim::cloth` makes the curves.

mod between;
mod brightness;
mod bsdf;
mod color_of;
mod cones;
mod curves;
mod draft;
mod dye;
mod far;
mod far_views;
mod file;
mod gap;
mod grid;
mod hair_layer;
mod hairs;
mod lattice;
mod layers;
mod lines;
mod model;
mod named;
mod names;
mod nearest;
mod plies;
mod query;
mod rules;
mod shade;
mod shadow;
mod spec;
mod splines;
mod tensors;
mod terms;
mod thermal;
mod uneven;
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
pub use hairs::Hairs;
pub use lattice::{Buckets, Lattice, whole_times};
pub use layers::Layer;
pub use lines::{ClothLines, LineHit, LineHits, MAX_HITS};
pub use model::ClothModel;
pub use named::NamedWeave;
pub use query::{ClothOptions, ClothQuery, GapLight, Slits};
pub(crate) use query::{to_pattern, to_surface};
#[doc(hidden)]
pub use rules::CLOTH_RULES;
pub use spec::{ClothSpec, ClothWeave, KnitSpec, SourceCurves, Stripe, YarnOfCloth};
pub use tensors::{Tensor, Values};
pub use thermal::Thermal;
pub use units::Count;
pub use uv::UvMap;
pub use weave::{WeaveSpec, YarnColor};
pub use wif::{Wif, WifNote, WifNoteKind, WifSpacing};

/// What `plywave_sim::cloth` makes cloths of; a host needs nothing from here.
#[doc(hidden)]
pub mod making {
    pub use super::between::{
        CLASSES, CLASSES_A_KIND, InterYarn, PAIRS, SIGMA_PER_UM, SIGMAS, Side, class, class_of_hairs,
    };
    pub use super::brightness::albedo;
    pub use super::color_of::NODES as ALBEDO_NODES;
    pub use super::cones::{Cone, NORMS};
    pub use super::far::FarData;
    pub use super::far_views::{FarView, far_view};
    pub use super::hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES, HAIR_NODES, HairLayer, azimuth, once, once_through};
    pub use super::plies::{ClothPlies, beyond, frame, start};
    pub use super::shade::{ClothShade, ClothShadows, is_own};
    pub use super::shadow::{
        AxisAt, BANDS, COLUMNS, LANES, MAX_SHARE, OFFSETS, ROWS, SIZE as SHADOW_BYTES, Toward, exit, z_of,
    };
    pub use super::splines::{At as SplinesAt, COUNT as SPLINES, Several as SeveralSplines};
    pub use super::terms::{FEW, Few, Poly, TERMS, dot, few, terms};
    pub use super::uneven::Uneven;
}
