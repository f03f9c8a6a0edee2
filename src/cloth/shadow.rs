//! The table of a place's shadows: the chance that light which leaves a ply in a direction hits no other ply,
//! more of it on the outer side of a bend, less on the inner one.

use crate::math::floor_fraction;
use crate::math::simd::{max, min};
use crate::math::vec3::dot;
use crate::ply::{EXIT_KINDS, ExitDensity};
use multiversion::multiversion;
use std::f32::consts::TAU;

/// Bands of directions in each half of the sphere.
pub const BANDS: usize = 8;
/// Rows of a half of the table: the bands' and the pole's.
pub const ROWS: usize = BANDS + 1;
/// Columns about the normal.
pub const COLUMNS: usize = 16;
/// Offsets across a yarn.
pub const OFFSETS: usize = 7;
/// Numbers of a direction: the offsets, and zeros up to a word.
pub const LANES: usize = 8;
/// Greatest entry: 255 stands for it.
pub const MAX_SHARE: f32 = 1.35;
/// The entry of light that all gets out.
pub(crate) const ALL_FREE: u8 = (255.0 / MAX_SHARE + 0.5) as u8;
/// Bytes of a place.
pub const SIZE: usize = 2 * ROWS * COLUMNS * LANES;

/// Bands of directions: z of band r + 1/2 of a half is that to this power of the band's place in the half.
/// Shadows change most towards the plane.
pub fn z_of(band: f32) -> f32 {
    let t = band / BANDS as f32;
    t * t.sqrt()
}

/// Mean of z over a band: `integral ((r + u) / BANDS)^1.5 du`, u from 0 to 1.
const MEAN_Z: [f32; BANDS] = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235];

/// Of the last band's mean.
const PER_SQUARED_SINE: f32 = 1.0 / (1.0 - MEAN_Z[BANDS - 1] * MEAN_Z[BANDS - 1]);

/// Hit of a z among the bands of a half, 0 to BANDS.
#[inline]
fn band_of(z: f32) -> f32 {
    (two_thirds(z) * BANDS as f32).min(BANDS as f32)
}

/// z^(2/3), z from 0 to 1, to 0.01: two steps of Newton's for the cube root of the root, from a line that is
/// near it.
#[inline]
pub(crate) fn two_thirds(z: f32) -> f32 {
    let root = z.sqrt();
    let mut c = 0.4 + 0.6 * root;
    for _ in 0..2 {
        c -= (c * c * c - root) / (3.0 * c * c);
    }
    c * c * c * c
}

/// Shadows about one place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowsAt<'a> {
    pub(crate) rows: [&'a [u8; SIZE]; 2],
    pub(crate) between: f32,
}

/// A direction, and where the table has it.
#[derive(Clone, Copy, Debug)]
pub struct Toward {
    /// Unit.
    pub b: [f32; 3],
    /// `[row][column]` of the four entries around, and the shares of rows and columns.
    at: [[u16; 2]; 2],
    rows: [f32; 2],
    columns: [f32; 2],
}

impl Toward {
    /// A unit direction.
    #[inline]
    pub fn new(b: [f32; 3]) -> Toward {
        let z = b[2].abs().min(1.0);
        let r = ((band_of(z) - 0.5).max(0.0) as usize).min(BANDS - 1);
        let s = if r + 1 < BANDS {
            // A line through two bands goes on towards the plane.
            (z - MEAN_Z[r]) / (MEAN_Z[r + 1] - MEAN_Z[r])
        } else {
            // Shadows move in proportion to the sine of the tilt.
            1.0 - ((1.0 - z * z) * PER_SQUARED_SINE).sqrt()
        };
        let column = (crate::math::simd::atan2::<false>(b[1], b[0]) / TAU + 1.0) * COLUMNS as f32 - 0.5;
        let (c, t) = floor_fraction(column);
        let columns = [(c as usize) % COLUMNS, (c as usize + 1) % COLUMNS];
        let first = if b[2] < 0.0 { ROWS } else { 0 };
        let at = [r, r + 1].map(|r| columns.map(|c| (((first + r) * COLUMNS + c) * LANES) as u16));
        Toward { b, at, rows: [1.0 - s, s], columns: [1.0 - t, t] }
    }
}

/// Chances of being free in a direction, of light of each kind that leaves so across a ply whose axis lies
/// `off` from the yarn's, over the ply's radius, which is `scale` of half of the yarn's width. The first and
/// the last of them leave at the first place, the other at the second.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
pub(crate) fn free<'a>(
    places: &[ShadowsAt<'a>; 2],
    toward: &Toward,
    exits: &[ExitDensity; EXIT_KINDS],
    off: f32,
    scale: f32,
) -> [f32; EXIT_KINDS] {
    let mut sums = [[0.0f32; LANES]; 2];
    for (sum, place) in sums.iter_mut().zip(places) {
        let shares = [1.0 - place.between, place.between];
        for p in 0..2 {
            for r in 0..2 {
                for c in 0..2 {
                    let w = shares[p] * toward.rows[r] * toward.columns[c];
                    if let Some(lanes) = place.rows[p][usize::from(toward.at[r][c])..].first_chunk::<LANES>() {
                        for l in 0..LANES {
                            sum[l] += w * f32::from(lanes[l]);
                        }
                    }
                }
            }
        }
        for sum in sum {
            *sum = min(max(*sum * (MAX_SHARE / 255.0), 0.0), MAX_SHARE);
        }
    }
    // Offsets of the yarn grow as those of the ply fall; what lies beyond the yarn's width counts as at its
    // rim.
    let per = 1.0 / scale;
    let mut edges = [0.0f32; LANES];
    for (o, edge) in edges.iter_mut().enumerate() {
        *edge = off - per * (2.0 * o as f32 / OFFSETS as f32 - 1.0);
    }
    let mut shares = [0.0; EXIT_KINDS];
    for (i, share) in shares.iter_mut().enumerate() {
        let mut below = [0.0f32; LANES];
        for (below, edge) in below.iter_mut().zip(&edges) {
            *below = exits[i].below(*edge);
        }
        (below[0], below[OFFSETS]) = (1.0, 0.0);
        for o in 0..OFFSETS {
            *share += (below[o] - below[o + 1]) * sums[i % 2][o];
        }
    }
    shares
}

/// Where light in direction `b` leaves the tube of this radius about the axis through `center` along `z`
/// (unit), from a point `p` in it. Along the tube at most ten radii further.
pub fn exit(center: [f32; 3], z: [f32; 3], radius: f32, p: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let q: [f32; 3] = std::array::from_fn(|i| p[i] - center[i]);
    let (qz, bz) = (dot(q, z), dot(b, z));
    let across: [f32; 3] = std::array::from_fn(|i| q[i] - qz * z[i]);
    let turned: [f32; 3] = std::array::from_fn(|i| b[i] - bz * z[i]);
    let a = dot(turned, turned).max(1e-4);
    let half = dot(across, turned);
    let room = (half * half - a * (dot(across, across) - radius * radius)).max(0.0);
    let way = ((room.sqrt() - half) / a).clamp(0.0, 10.0 * radius);
    std::array::from_fn(|i| p[i] + way * b[i])
}

/// Where the axis of a yarn or ply is that light leaves.
pub struct AxisAt<T> {
    /// Its point.
    pub center_um: [f32; 3],
    /// Unit.
    pub axis: [f32; 3],
    /// Curvature vector [1/um].
    pub bend_per_um: [f32; 3],
    /// Radius of the ply [um].
    pub radius_um: f32,
    /// Which it is.
    pub of: T,
}
