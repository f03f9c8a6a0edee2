//! A place on a ply, and the fibers around the ply that show there.

use crate::math::simd::atan2;
use crate::spec::YarnSpec;
use std::f32::consts::TAU;

/// A place on a ply: its relief and its speckle are asked there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyPlace {
    /// Number of the ply: others have other fibers.
    pub ply: u32,
    /// Azimuth of the viewer, the frame's y axis, among the fibers [rad]: about the ply's axis, from an axis
    /// that turns with the twist, counterclockwise as seen from the end of the z axis.
    pub azimuth: f32,
    /// Place along the ply's axis [um], from any origin that is the same all along the ply.
    pub along_um: f32,
    /// Diameter of the part of the ply that the query stands for [um]; 0 for a point.
    pub footprint_um: f32,
}

impl PlyPlace {
    /// A point of a ply.
    pub fn new(ply: u32, azimuth: f32, along_um: f32) -> PlyPlace {
        PlyPlace { ply, azimuth, along_um, footprint_um: 0.0 }
    }

    /// Standard deviation of the footprint along an axis [um], that of a square of its diameter.
    pub(crate) fn deviation_um(&self) -> f32 {
        0.29 * self.footprint_um.max(0.0)
    }
}

/// The fibers that stand around a ply, where a viewer sees them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FibersAround {
    /// Their number.
    pub count: f32,
    /// Distance of their middles from the axis [um].
    pub ring_um: f32,
}

impl FibersAround {
    /// Of the plies of a spec, whose beam meets fibers up to the offset `reach_um`: of a round ply of several
    /// fibers those on its surface, of yarns of several plies and of other sections as many as are side by
    /// side around them.
    pub fn of_spec(spec: &YarnSpec, reach_um: f64) -> FibersAround {
        let [a, b] = spec.ply_radii_um();
        let fiber_um = mean_radius_um(spec);
        let fibers = f64::from(spec.ply.fibers);
        let is_round = spec.yarn.plies <= 1 && (a - b).abs() <= 1e-6 * a;
        let (ring_um, most) = if is_round {
            // Of packed sections: where fibers with highlights have their middles, deeper in loose plies.
            (a - fiber_um * (1.15 + 5.0 * (0.66 - spec.packing_fraction()).max(0.0)), fibers)
        } else {
            (reach_um - fiber_um, fibers * f64::from(spec.yarn.plies.max(1)))
        };
        let ring_um = ring_um.max(0.5 * fiber_um);
        let count = (std::f64::consts::PI * ring_um / fiber_um).round().clamp(1.0, most.max(1.0));
        FibersAround { count: count as f32, ring_um: ring_um as f32 }
    }

    /// Around a ply of unknown fibers, as wide as a beam of this waist.
    pub(crate) fn of_beam(w0_um: f64, reach_um: f64) -> FibersAround {
        let ring_um = (0.7 * reach_um).max(0.1 * w0_um);
        let count = (std::f64::consts::PI * ring_um / w0_um).round().clamp(1.0, 1e4);
        FibersAround { count: count as f32, ring_um: ring_um as f32 }
    }

    /// How many fibers around, from the place where azimuths begin, lies what shows at an offset [um]: that
    /// of the middle of fiber i is i + 1/2.
    #[inline]
    pub(crate) fn row(&self, azimuth: f32, h_um: f32) -> f32 {
        let x = (h_um / self.ring_um).clamp(-1.0, 1.0);
        let asin = atan2::<false>(x, (1.0 - x * x).max(0.0).sqrt());
        self.count / TAU * (azimuth - asin)
    }
}

/// Radius of a circle as large as a fiber's section [um].
pub(super) fn mean_radius_um(spec: &YarnSpec) -> f64 {
    (spec.fiber_area_um2() / std::f64::consts::PI).sqrt()
}
