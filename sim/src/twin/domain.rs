//! The traced domain: a rectangle of whole repeats with periodic boundaries.
//!
//! Rays that leave the domain on one side re-enter on the opposite one. Fibers must therefore make whole
//! turns over the length after which a ply closes, which changes their twist by up to half a turn over that
//! length.

use plywave::spec::Shape;
use plywave_textile::YarnSet;

/// Maximum number of quads. They take less than 6 GiB, most of it only during construction of a family's BVH.
pub(super) const MAX_QUADS: f64 = 2.8e7;

/// Fiber pitch of the spec and its traced value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PitchUsed {
    /// Yarn set of the yarns: warp for kind 0, weft for all other kinds.
    pub family: YarnSet,
    /// Pitch of the spec [um].
    pub spec_um: f64,
    /// Traced pitch [um]; above 1e12 for fibers without twist.
    pub used_um: f64,
}

/// The part of the cloth that is traced.
#[derive(Clone, Debug, PartialEq)]
pub struct Domain {
    /// Repeats along x and y.
    pub repeats: [u32; 2],
    /// Size along x and y [um].
    pub size_um: [f64; 2],
    /// Number of yarns of kind 0, and of all other kinds.
    pub yarns: [u32; 2],
    /// Pitch of the fibers in the first yarn of each set that has one.
    pub pitches: Vec<PitchUsed>,
}

/// Estimated number of points of an outline, relative to a circle.
pub(super) fn outline_share(shape: &Shape) -> f64 {
    match *shape {
        Shape::Circle { .. } | Shape::Ellipse { .. } | Shape::RoundedTriangle { .. } | Shape::Stone { .. } => 1.0,
        Shape::HollowCircle { lumen, .. } => 1.0 + lumen,
        Shape::Kidney { lumen, .. } => 1.3 + if lumen > 0.0 { 0.9 } else { 0.0 },
        Shape::Trilobal { .. } | Shape::Polygon { .. } => 2.0,
        Shape::Serrated { .. } => 4.0,
    }
}
