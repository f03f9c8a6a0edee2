//! Entries of the boundary equations ([`system`](crate::boundary::system)) at one pair of points: the kernels
//! of all components, from the radial functions.

use crate::C64;
use crate::boundary::kernel::Radial;
use crate::scene::curve::CurvePoint;

/// Components in the order of unknowns at a node.
pub(crate) const COMPONENTS: usize = 4;
/// Index of e, P, h, Q.
pub(crate) const E: usize = 0;
pub(crate) const P: usize = 1;
pub(crate) const H: usize = 2;
pub(crate) const Q: usize = 3;

/// Kernel values at a pair: row component by column component.
pub(crate) type Entries = [[C64; COMPONENTS]; COMPONENTS];

/// Quantities that depend on the pair of points alone.
pub(crate) struct Pair {
    pub r: f64,
    /// Distance vector dotted with the target's normal and tangent, and the source's.
    pub rn: f64,
    pub rt: f64,
    pub rns: f64,
    pub rts: f64,
    /// n.n' and t.n'.
    pub nn: f64,
    pub tn: f64,
}

impl Pair {
    #[inline(always)]
    pub fn new(target: &CurvePoint, source: &CurvePoint) -> Self {
        let (dx, dy) = (target.at[0] - source.at[0], target.at[1] - source.at[1]);
        let ([nx, ny], [sx, sy]) = (target.normal, source.normal);
        Self {
            r: (dx * dx + dy * dy).sqrt(),
            rn: dx * nx + dy * ny,
            rt: dy * nx - dx * ny,
            rns: dx * sx + dy * sy,
            rts: dy * sx - dx * sy,
            nn: nx * sx + ny * sy,
            tn: nx * sy - ny * sx,
        }
    }
}

/// Wavenumbers in the entries [1/um]: in vacuum, and along the fibers.
#[derive(Clone, Copy)]
pub(crate) struct Wavenumbers {
    pub k0: f64,
    pub kz: f64,
}

impl Wavenumbers {
    /// The equations' kernels (on the left-hand side) from the radial sums over media; `q` is
    /// `(t.r)(t'.r)/R^2`.
    #[inline(always)]
    pub fn entries(&self, radial: &Radial, pair: &Pair, q: f64) -> Entries {
        let Radial { g, eg, d, ed } = *radial;
        let per_k0 = 1.0 / self.k0;
        let ratio = self.kz * per_k0;
        // sum s kappa^2 G, over k_0.
        let kk = eg * self.k0 - g * (self.kz * ratio);
        let w = (kk + d * (2.0 * per_k0)) * q - d * (pair.nn * per_k0) - eg * (self.k0 * pair.nn);
        let z = C64::ZERO;
        [
            [ed * pair.rns, kk, d * (-ratio * pair.rts), z],
            [w, d * pair.rn, g * (-self.kz * pair.tn), d * (ratio * pair.rt)],
            [d * (ratio * pair.rts), z, d * pair.rns, kk],
            [eg * (self.kz * pair.tn), d * (-ratio * pair.rt), w, ed * pair.rn],
        ]
    }

    #[inline(always)]
    pub fn regular(&self, radial: &Radial, pair: &Pair) -> Entries {
        self.entries(radial, pair, pair.rt * pair.rts / (pair.r * pair.r))
    }
}
