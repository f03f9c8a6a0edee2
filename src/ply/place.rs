//! A position on a ply, and the fibers around the ply that a viewer sees there.
//!
//! Relief and speckle (Yu 2025, Eq. 23) are evaluated at a [`PlyPlace`]. [`FibersAround`] counts the fibers
//! on the surface of a ply from its spec, or from the beam's width if the spec is unknown.

use crate::math::simd::atan2;
use crate::spec::YarnSpec;
use std::f32::consts::TAU;

/// A position on a ply, at which relief and speckle are evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyPlace {
    /// Index of the ply: plies with different indices have different fibers.
    pub ply: u32,
    /// Azimuth of the frame's y axis, which points to the viewer, relative to the fibers [rad]. It is
    /// measured about the ply's axis from a reference that turns with the twist, counterclockwise as seen
    /// from the end of the z axis.
    pub azimuth: f32,
    /// Position along the ply's axis [um], from an origin common to the whole ply.
    pub along_um: f32,
    /// Diameter of the part of the ply that the query covers [um]; 0 for a point.
    pub footprint_um: f32,
}

impl PlyPlace {
    /// A point of a ply: a position with footprint 0.
    pub fn new(ply: u32, azimuth: f32, along_um: f32) -> PlyPlace {
        PlyPlace { ply, azimuth, along_um, footprint_um: 0.0 }
    }

    /// Standard deviation of the footprint along an axis [um], computed as that of a square of the same
    /// width.
    pub(crate) fn deviation_um(&self) -> f32 {
        0.29 * self.footprint_um.max(0.0)
    }
}

/// The fibers around a ply, where a viewer sees them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FibersAround {
    /// Number of fibers.
    pub count: f32,
    /// Distance of the fibers' centers from the ply's axis [um].
    pub ring_um: f32,
}

impl FibersAround {
    /// The fibers around the plies of a spec whose beam hits fibers up to the offset `reach_um` [um]. For a
    /// round ply of several fibers they are the fibers on its surface. For a yarn of several plies and for
    /// other cross sections they are as many as fit side by side around it.
    pub fn of_spec(spec: &YarnSpec, reach_um: f64) -> FibersAround {
        let [a, b] = spec.ply_radii_um();
        let fiber_um = mean_radius_um(spec);
        let fibers = f64::from(spec.ply.fibers);
        let is_round = spec.yarn.plies <= 1 && (a - b).abs() <= 1e-6 * a;
        let (ring_um, max_count) = if is_round {
            // Fitted to packed cross sections: the centers of fibers with highlights lie deeper in loosely
            // packed plies.
            (a - fiber_um * (1.15 + 5.0 * (0.66 - spec.packing_fraction()).max(0.0)), fibers)
        } else {
            (reach_um - fiber_um, fibers * f64::from(spec.yarn.plies.max(1)))
        };
        let ring_um = ring_um.max(0.5 * fiber_um);
        let count = (std::f64::consts::PI * ring_um / fiber_um).round().clamp(1.0, max_count.max(1.0));
        FibersAround { count: count as f32, ring_um: ring_um as f32 }
    }

    /// The fibers around a ply of unknown fibers, each assumed as wide as a beam of this waist [um].
    pub(crate) fn of_beam(w0_um: f64, reach_um: f64) -> FibersAround {
        let ring_um = (0.7 * reach_um).max(0.1 * w0_um);
        let count = (std::f64::consts::PI * ring_um / w0_um).round().clamp(1.0, 1e4);
        FibersAround { count: count as f32, ring_um: ring_um as f32 }
    }

    /// Position around the ply, in fibers from azimuth 0, of the surface visible at an offset [um]. The
    /// center of fiber i is at i + 1/2.
    #[inline]
    pub(crate) fn row(&self, azimuth: f32, h_um: f32) -> f32 {
        let x = (h_um / self.ring_um).clamp(-1.0, 1.0);
        let asin = atan2::<false>(x, (1.0 - x * x).max(0.0).sqrt());
        self.count / TAU * (azimuth - asin)
    }
}

/// Radius of the circle that has the area of a fiber's cross section [um].
pub(super) fn mean_radius_um(spec: &YarnSpec) -> f64 {
    (spec.fiber_area_um2() / std::f64::consts::PI).sqrt()
}
