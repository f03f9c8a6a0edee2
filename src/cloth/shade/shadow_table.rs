//! The shadow table at one place of a curve: the probability that light which leaves a ply in a direction
//! escapes without hitting another ply. An entry also weighs the light: more of it leaves on the outer side
//! of a bend and less on the inner side, so that a share can exceed 1.
//!
//! A place has one byte per direction and offset across the yarn. Directions are rows of z (denser towards
//! the plane) times columns of azimuth, for both halves of the sphere; lookups interpolate linearly between
//! them.

use crate::math::floor_fraction;
use crate::math::simd::{max, min};
use crate::math::vec3::dot;
use crate::ply::{EXIT_KINDS, EXIT_OFFSETS, OffsetShares};
use std::f32::consts::TAU;

/// Number of bands of directions in each half of the sphere.
pub const BANDS: usize = 8;
/// Number of rows in a half of the table: one for each band, and one for the pole.
pub const ROWS: usize = BANDS + 1;
/// Number of columns of azimuth.
pub const COLUMNS: usize = 16;
/// Number of offsets across a yarn.
pub const OFFSETS: usize = EXIT_OFFSETS;
/// Entries of a direction: the offsets, padded with zeros to a word.
pub const LANES: usize = 8;
/// The share that the entry 255 represents.
pub const MAX_SHARE: f32 = 1.35;
/// The entry of light that escapes entirely, a share of 1.
pub(crate) const ALL_FREE: u8 = (255.0 / MAX_SHARE + 0.5) as u8;
/// Bytes of a place.
pub const SIZE: usize = 2 * ROWS * COLUMNS * LANES;

/// z at a position among the bands of a half, 0 to [`BANDS`]: (band / BANDS)^1.5. Bands are narrow towards
/// the plane, where shadows change most.
pub fn z_of(band: f32) -> f32 {
    let t = band / BANDS as f32;
    t * t.sqrt()
}

/// Mean of z over each band: `integral ((r + u) / BANDS)^1.5 du`, u from 0 to 1.
pub const MEAN_Z: [f32; BANDS] = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235];

/// Inverse of the squared sine at the mean of the last band.
const PER_SQUARED_SINE: f32 = 1.0 / (1.0 - MEAN_Z[BANDS - 1] * MEAN_Z[BANDS - 1]);

/// Position of z among the bands of a half, 0 to [`BANDS`]: the inverse of [`z_of`].
#[inline(always)]
fn band_of(z: f32) -> f32 {
    (two_thirds(z) * BANDS as f32).min(BANDS as f32)
}

/// Approximates z^(2/3) for z from 0 to 1 with an error below 0.01: two Newton steps for the cube root of the
/// square root, from a linear initial guess.
#[inline(always)]
pub(crate) fn two_thirds(z: f32) -> f32 {
    let root = z.sqrt();
    let mut c = 0.4 + 0.6 * root;
    for _ in 0..2 {
        c -= (c * c * c - root) / (3.0 * c * c);
    }
    c * c * c * c
}

/// The shadow table interpolated between two neighboring places.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowsAt<'a> {
    pub(crate) rows: [&'a [u8; SIZE]; 2],
    pub(crate) between: f32,
}

/// A direction of the light and its position in the table.
#[derive(Clone, Copy, Debug)]
pub struct Toward {
    /// Unit direction.
    pub b: [f32; 3],
    /// `[row][column]` offsets of the four entries around the direction, and the weights of rows and columns.
    at: [[u16; 2]; 2],
    rows: [f32; 2],
    columns: [f32; 2],
}

impl Toward {
    /// Looks up the position of a unit direction.
    #[inline(always)]
    pub fn new(b: [f32; 3]) -> Toward {
        let z = b[2].abs().min(1.0);
        let r = ((band_of(z) - 0.5).max(0.0) as usize).min(BANDS - 1);
        let s = if r + 1 < BANDS {
            // The line through the two lowest bands is extrapolated towards the plane.
            (z - MEAN_Z[r]) / (MEAN_Z[r + 1] - MEAN_Z[r])
        } else {
            // Shadows change in proportion to the sine of the tilt.
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

/// Probabilities of escape in a direction for each kind of light that leaves a ply, given its distribution
/// across the ply. The first and the last kind leave at `places[0]`, the other at `places[1]`.
#[inline(always)]
pub(crate) fn free(
    places: &[ShadowsAt<'_>; 2],
    toward: &Toward,
    exits: &[OffsetShares; EXIT_KINDS],
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
    let mut shares = [0.0; EXIT_KINDS];
    for (i, share) in shares.iter_mut().enumerate() {
        for o in 0..LANES {
            *share += exits[i][o] * sums[i % 2][o];
        }
    }
    shares
}

/// Point where light in direction `b` leaves a tube of this radius about the axis through `center` along the
/// unit vector `z`, from a point `p` inside. The path is clamped to ten radii.
pub fn exit(center: [f32; 3], z: [f32; 3], radius: f32, p: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let q: [f32; 3] = std::array::from_fn(|i| p[i] - center[i]);
    let (qz, bz) = (dot(q, z), dot(b, z));
    let across: [f32; 3] = std::array::from_fn(|i| q[i] - qz * z[i]);
    let turned: [f32; 3] = std::array::from_fn(|i| b[i] - bz * z[i]);
    let a = dot(turned, turned).max(1e-4);
    let half = dot(across, turned);
    let discriminant = (half * half - a * (dot(across, across) - radius * radius)).max(0.0);
    let distance = ((discriminant.sqrt() - half) / a).clamp(0.0, 10.0 * radius);
    std::array::from_fn(|i| p[i] + distance * b[i])
}
