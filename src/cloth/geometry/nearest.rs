//! The points at which a line is nearest to the curves of a block of pieces, for all lanes at once.
//!
//! `candidates` tests the line against the chords of the pieces. `refine` runs Newton's method on
//! `(p(u) - x - t w) . p'(u) = 0` for the lanes that pass. Lengths are in um.

use crate::cloth::geometry::grid::{LANES, PieceBlock};
use crate::math::simd::{fma, max, min};

/// Largest number of Newton steps; step, relative to a piece's length, below which the iteration ends; and
/// step above which the result is rejected. Lines across a curve take two steps, lines along it one more.
const ROUNDS: usize = 8;
const CLOSE: f32 = 3e-3;
const AWAY: f32 = 0.05;
/// Distance beyond its ends up to which a piece is searched, relative to its length; and the square of the
/// distance beyond its chord at which a line may be nearest to it.
const SLACK: f32 = 0.25;
const BEYOND2: f32 = 0.16;
/// Squared sine of the angle between line and piece above which that distance is tested.
const ACROSS: f32 = 0.5;

/// Lanes of a block whose chords a line comes near.
pub(crate) struct Candidates {
    counts: [u32; LANES],
    /// Parameter of the piece.
    u: [f32; LANES],
}

/// Nearest points of a line and the curves of a block.
pub(crate) struct Found {
    /// Nonzero if the line may hit the piece.
    pub counts: [u32; LANES],
    /// Parameter of the piece.
    pub u: [f32; LANES],
    /// Last step of the parameter; `point` and the fields below it do not include it.
    pub step: [f32; LANES],
    /// Point of the curve relative to the line's start, first and second derivative.
    pub point: [[f32; LANES]; 3],
    pub d: [[f32; LANES]; 3],
    pub dd: [[f32; LANES]; 3],
    /// Distance along the line, and squared distance from it.
    pub distance: [f32; LANES],
    pub h2: [f32; LANES],
}

/// Whether any lane is nonzero, without a branch per lane.
#[inline(always)]
fn any(of: &[u32; LANES]) -> bool {
    let mut all = 0;
    for l in 0..LANES {
        all |= of[l];
    }
    all != 0
}

/// Dot product.
#[inline(always)]
fn dot3<const FMA: bool>(a: [f32; 3], b: [f32; 3]) -> f32 {
    fma::<FMA>(a[2], b[2], fma::<FMA>(a[1], b[1], a[0] * b[0]))
}

/// The lanes whose chords the line comes near at a distance from `begin_um` to `end_um` along it; `None` if
/// there is no such lane.
#[inline(always)]
pub(crate) fn candidates<const FMA: bool>(
    block: &PieceBlock,
    origin: [f32; 3],
    w: [f32; 3],
    [begin_um, end_um]: [f32; 2],
) -> Option<Candidates> {
    let (mut u, mut counts) = ([0.0f32; LANES], [0u32; LANES]);
    for l in 0..LANES {
        let (p, d) = (&block.cubic[0], [block.chord[0][l], block.chord[1][l], block.chord[2][l]]);
        let e = [p[0][l] - origin[0], p[1][l] - origin[1], p[2][l] - origin[2]];
        let ew = dot3::<FMA>(e, w);
        let dw = dot3::<FMA>(d, w);
        let ed = fma::<FMA>(-ew, dw, dot3::<FMA>(e, d));
        let all = block.chord2[l];
        let dd = fma::<FMA>(-dw, dw, all);
        let ee = fma::<FMA>(-ew, ew, dot3::<FMA>(e, e));
        let free = -ed / max(dd, 1e-6);
        let s = min(max(free, 0.0), 1.0);
        let near2 = fma::<FMA>(s, fma::<FMA>(s, dd, 2.0 * ed), ee);
        let distance = fma::<FMA>(s, dw, ew);
        // For a line across a piece that is nearest beyond the piece's ends, the nearest point belongs to the
        // next piece.
        let beyond = if dd > ACROSS * all { (free - s) * (free - s) * dd } else { 0.0 };
        let over =
            max(max(near2 - block.reach2[l], beyond - BEYOND2 * all), max(begin_um - distance, distance - end_um));
        u[l] = s;
        counts[l] = u32::from(over <= 0.0);
    }
    any(&counts).then_some(Candidates { counts, u })
}

/// Moves the parameters to the points of the curves nearest to the line. Clears lanes that do not converge or
/// leave their piece.
#[inline(always)]
pub(crate) fn refine<const FMA: bool>(
    block: &PieceBlock,
    origin: [f32; 3],
    w: [f32; 3],
    candidates: &Candidates,
) -> Found {
    let none = [0.0f32; LANES];
    let mut found = Found {
        counts: candidates.counts,
        u: candidates.u,
        step: none,
        point: [none; 3],
        d: [none; 3],
        dd: [none; 3],
        distance: none,
        h2: none,
    };
    let mut moved = none;
    for iteration in 0..=ROUNDS {
        let mut sums = [none; 7];
        for k in 0..3 {
            let [c0, c1, c2, c3] = [0, 1, 2, 3].map(|power: usize| &block.cubic[power][k]);
            let (x, w) = (origin[k], w[k]);
            let (mut p, mut d, mut dd) = (none, none, none);
            for l in 0..LANES {
                let u = found.u[l];
                p[l] = fma::<FMA>(u, fma::<FMA>(u, fma::<FMA>(u, c3[l], c2[l]), c1[l]), c0[l] - x);
                d[l] = fma::<FMA>(u, fma::<FMA>(u, 3.0 * c3[l], 2.0 * c2[l]), c1[l]);
                dd[l] = fma::<FMA>(6.0 * u, c3[l], 2.0 * c2[l]);
            }
            for l in 0..LANES {
                sums[0][l] = fma::<FMA>(p[l], w, sums[0][l]);
                sums[1][l] = fma::<FMA>(d[l], w, sums[1][l]);
                sums[2][l] = fma::<FMA>(dd[l], w, sums[2][l]);
                sums[3][l] = fma::<FMA>(p[l], d[l], sums[3][l]);
                sums[4][l] = fma::<FMA>(d[l], d[l], sums[4][l]);
                sums[5][l] = fma::<FMA>(p[l], dd[l], sums[5][l]);
                sums[6][l] = fma::<FMA>(p[l], p[l], sums[6][l]);
            }
            (found.point[k], found.d[k], found.dd[k]) = (p, d, dd);
        }
        let [pw, dw, ddw, pd, d2, pdd, pp] = &sums;
        let mut to = none;
        let (mut continues, mut is_minimum) = ([0u32; LANES], [0u32; LANES]);
        for l in 0..LANES {
            let slope = pd[l] - pw[l] * dw[l];
            let straight = d2[l] - dw[l] * dw[l];
            let bend = straight + pdd[l] - pw[l] * ddw[l];
            // Where the second derivative is negative the distance may be at a maximum; the step then ignores
            // curvature.
            is_minimum[l] = u32::from(bend > 0.0);
            let bend = if bend > 0.1 * d2[l] { bend } else { max(straight, 0.05 * d2[l]) };
            to[l] = min(max(found.u[l] - slope / bend, -SLACK), 1.0 + SLACK);
            moved[l] = (to[l] - found.u[l]).abs();
            continues[l] = candidates.counts[l] & u32::from(moved[l] >= CLOSE);
        }
        let is_last = iteration == ROUNDS || !any(&continues);
        if is_last {
            for l in 0..LANES {
                found.distance[l] = pw[l];
                found.h2[l] = max(pp[l] - pw[l] * pw[l], 0.0);
                let u = if iteration < ROUNDS { to[l] } else { found.u[l] };
                found.step[l] = u - found.u[l];
                found.u[l] = u;
                found.counts[l] = candidates.counts[l]
                    & is_minimum[l]
                    & u32::from((moved[l] < AWAY) & (0.0..1.0).contains(&u) & (found.h2[l] < block.reach2[l]));
            }
            break;
        }
        found.u = to;
    }
    found
}
