//! The traced domain: a rectangle of whole repeats.
//!
//! Rays that leave the domain at one side re-enter at the other, so fibers make whole turns along a ply until
//! it meets itself, and their pitches change by up to half a turn over that length.

use plywave::cloth::YarnSet;
use plywave::spec::Shape;

/// Largest number of quads: they stay below 6 GiB, most of it only while a family's BVH is built.
pub(super) const MAX_QUADS: f64 = 2.8e7;

/// A pitch of the spec's fibers and its traced value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PitchUsed {
    /// Yarn set of the yarns: warp for kind 0, weft for all others.
    pub family: YarnSet,
    /// As in the spec [um].
    pub spec_um: f64,
    /// As traced [um]; above 1e12 for no turn at all.
    pub used_um: f64,
}

/// The part of the cloth that is traced.
#[derive(Clone, Debug, PartialEq)]
pub struct Domain {
    /// Repeats along x and y.
    pub repeats: [u32; 2],
    /// Size along x and y [um].
    pub size_um: [f64; 2],
    /// Yarns of kind 0, and of all other kinds.
    pub yarns: [u32; 2],
    /// Pitch of the fibers in the first yarn of each set that has one.
    pub pitches: Vec<PitchUsed>,
}

/// Estimate of the points of an outline, relative to those of a circle.
pub(super) fn outline_share(shape: &Shape) -> f64 {
    match *shape {
        Shape::Circle { .. } | Shape::Ellipse { .. } | Shape::RoundedTriangle { .. } | Shape::Stone { .. } => 1.0,
        Shape::HollowCircle { lumen, .. } => 1.0 + lumen,
        Shape::Kidney { lumen, .. } => 1.3 + if lumen > 0.0 { 0.9 } else { 0.0 },
        Shape::Trilobal { .. } | Shape::Polygon { .. } => 2.0,
        Shape::Serrated { .. } => 4.0,
    }
}
