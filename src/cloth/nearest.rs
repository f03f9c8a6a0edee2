//! Where a line is nearest to the curves of a block of pieces, all lanes at once.

use super::grid::{Block, LANES};
use crate::math::simd::{fma, max, min};

/// Most steps of Newton's method, and the step over a piece's length at which it ends, and beyond which its
/// last place is none. Lines across a curve take two, lines along one more.
const ROUNDS: usize = 8;
const CLOSE: f32 = 1e-2;
const AWAY: f32 = 0.05;
/// How far beyond its ends a piece is searched, over its length, and the square of how far beyond its chord
/// a line may be nearest to it.
const SLACK: f32 = 0.25;
const BEYOND2: f32 = 0.16;
/// Squared sine of the angle between line and piece from which on that is looked at.
const ACROSS: f32 = 0.5;

/// Lanes of a block whose chords a line comes near.
pub(super) struct Near {
    counts: [u32; LANES],
    /// Parameter of the piece.
    u: [f32; LANES],
}

/// Where a line is nearest to the curves of a block.
pub(super) struct Found {
    /// Whether the line may hit there.
    pub counts: [u32; LANES],
    /// Parameter of the piece.
    pub u: [f32; LANES],
    /// Last step of the parameter, which `point` and what follows are without.
    pub step: [f32; LANES],
    /// Point from the line's start, first and second derivative.
    pub point: [[f32; LANES]; 3],
    pub d: [[f32; LANES]; 3],
    pub dd: [[f32; LANES]; 3],
    /// Way along the line, and squared distance from it.
    pub way: [f32; LANES],
    pub h2: [f32; LANES],
}

/// Whether any of them is not 0, without a branch for each.
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

/// The lanes whose chords the line comes near on its way from `least` to `most`; `None` where there is none.
#[inline(always)]
pub(super) fn near<const FMA: bool>(
    block: &Block,
    origin: [f32; 3],
    w: [f32; 3],
    [least, most]: [f32; 2],
) -> Option<Near> {
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
        let way = fma::<FMA>(s, dw, ew);
        // Of lines across a piece that are nearest beyond its ends, the place lies in the next one.
        let beyond = if dd > ACROSS * all { (free - s) * (free - s) * dd } else { 0.0 };
        let over = max(max(near2 - block.reach2[l], beyond - BEYOND2 * all), max(least - way, way - most));
        u[l] = s;
        counts[l] = u32::from(over <= 0.0);
    }
    any(&counts).then_some(Near { counts, u })
}

/// Moves the parameters to where the line is nearest to the curves. Lanes that do not get there, or beyond
/// the ends of their piece, count no more.
#[inline(always)]
pub(super) fn refine<const FMA: bool>(block: &Block, origin: [f32; 3], w: [f32; 3], near: &Near) -> Found {
    let none = [0.0f32; LANES];
    let mut found = Found {
        counts: near.counts,
        u: near.u,
        step: none,
        point: [none; 3],
        d: [none; 3],
        dd: [none; 3],
        way: none,
        h2: none,
    };
    let mut moved = none;
    for round in 0..=ROUNDS {
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
        let (mut goes_on, mut is_least) = ([0u32; LANES], [0u32; LANES]);
        for l in 0..LANES {
            let slope = pd[l] - pw[l] * dw[l];
            let straight = d2[l] - dw[l] * dw[l];
            let bend = straight + pdd[l] - pw[l] * ddw[l];
            // Where the distance curves the other way, it may be greatest: the step that a straight curve
            // has.
            is_least[l] = u32::from(bend > 0.0);
            let bend = if bend > 0.1 * d2[l] { bend } else { max(straight, 0.05 * d2[l]) };
            to[l] = min(max(found.u[l] - slope / bend, -SLACK), 1.0 + SLACK);
            moved[l] = (to[l] - found.u[l]).abs();
            goes_on[l] = near.counts[l] & u32::from(moved[l] >= CLOSE);
        }
        let is_last = round == ROUNDS || !any(&goes_on);
        if is_last {
            for l in 0..LANES {
                found.way[l] = pw[l];
                found.h2[l] = max(pp[l] - pw[l] * pw[l], 0.0);
                let u = if round < ROUNDS { to[l] } else { found.u[l] };
                found.step[l] = u - found.u[l];
                found.u[l] = u;
                found.counts[l] = near.counts[l]
                    & is_least[l]
                    & u32::from((moved[l] < AWAY) & (0.0..1.0).contains(&u) & (found.h2[l] < block.reach2[l]));
            }
            break;
        }
        found.u = to;
    }
    found
}
