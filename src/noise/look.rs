//! The look-up of a direction's speckle: first where its factors are in the tiles, then what they are. Between the two a host has other work, while
//! which the memory comes: tiles are larger than the caches near the processor.

use super::{Instance, NoiseTiles, SEAM_RAD, mix};
use crate::simd::{fma, prefetch, signed, sin_cos_half_turns};
use multiversion::{multiversion, target::target_cfg_f};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, PI};

/// Arc tangent of y / x in (-pi, pi], 0 where both are 0; to 3e-7.
#[inline(always)]
fn azimuth<const FMA: bool>(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let top = ax.max(ay);
    let t = if top > 0.0 { ax.min(ay) / top } else { 0.0 };
    let s = t * t;
    let p = COEFFICIENTS.iter().rev().fold(0.0, |p, c| fma::<FMA>(p, s, *c));
    let a = t * p;
    let a = if ay > ax { FRAC_PI_2 - a } else { a };
    let a = if x < 0.0 { PI - a } else { a };
    if y < 0.0 { -a } else { a }
}

/// Least squares on Chebyshev nodes of [0, 1].
const COEFFICIENTS: [f32; 8] = [
    0.999_999_34,
    -0.333_298_62,
    0.199_465_66,
    -0.139_086_32,
    0.096_421_994,
    -0.055_912_323,
    0.021_862_94,
    -0.004_054_559_4,
];

/// Where a direction falls on the patterns of one kind, before it is stretched.
#[derive(Clone, Copy, Debug)]
struct Place {
    u: f32,
    v: f32,
    /// u on the other side of the seam and the share of that side.
    other: f32,
    share: f32,
}

impl Place {
    /// Of an azimuth in [-pi, pi], the cosine that turns it into an arc, and v.
    #[inline(always)]
    fn new(azimuth: f32, cos: f32, v: f32) -> Place {
        let beyond = azimuth - (2.0 * PI).copysign(azimuth);
        // 1/2 at the seam, 0 and flat at its end.
        let t = ((azimuth.abs() - (PI - SEAM_RAD)) / SEAM_RAD).max(0.0).min(1.0);
        Place { u: azimuth * cos, v, other: beyond * cos, share: t * t * (1.5 - t) }
    }
}

/// Where the codes of a kind are at each wavelength.
#[derive(Clone, Copy, Debug)]
struct Spots<const N: usize> {
    /// Places in the codes of the four nodes around: v the slower index.
    at: [[u32; N]; 4],
    /// Where between them.
    v: [f32; N],
    u: [f32; N],
}

/// One tile, mirrored and moved.
#[derive(Clone, Copy, Debug)]
struct Tile {
    /// Place of its first code, and that of its low and step.
    first: u32,
    index: usize,
    rows: u32,
    columns: u32,
    /// Nodes per unit of v and u, and the place of the origin.
    scale: [f32; 2],
    offset: [f32; 2],
}

impl Tile {
    /// The tile of a kind for one instance.
    #[inline(always)]
    fn new(tiles: &NoiseTiles, instance: Instance, kind: usize) -> Tile {
        let [count, rows, columns] = tiles.sizes;
        // Independent bits for each kind: tile, two offsets of 20 bits, two mirrors.
        let bits = mix(instance.0 ^ (kind as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let index = kind * count + ((bits >> 42) as usize & (count - 1));
        const UNIT: f32 = 1.0 / (1u32 << 20) as f32;
        let unit = |bits: u64| (bits & 0xf_ffff) as u32 as i32 as f32 * UNIT;
        let sign = |bit: u32| ((bits >> bit & 1) as u32) << 31;
        let [step_v, step_u] = tiles.step[kind];
        Tile {
            first: (index * rows * columns) as u32,
            index,
            rows: rows as u32,
            columns: columns as u32,
            scale: [signed(1.0 / step_v as f32, sign(62)), signed(1.0 / step_u as f32, sign(63))],
            offset: [unit(bits) * rows as f32, unit(bits >> 20) * columns as f32],
        }
    }

    /// Where (v, u) is, times each stretch. Sizes are powers of two, so that masks wrap.
    #[inline(always)]
    fn spots<const FMA: bool, const N: usize>(&self, v: f32, u: f32, stretch: &[f32; N]) -> Spots<N> {
        let mut spots = Spots { at: [[0; N]; 4], v: [0.0; N], u: [0.0; N] };
        // 1.5 2^23 plus a whole number below 2^22 has that number in its low bits, negative ones as their two's complement. What is beyond falls somewhere
        // on the tile.
        const WHOLE: f32 = 12_582_912.0;
        for k in 0..N {
            let v = fma::<FMA>(v * stretch[k], self.scale[0], self.offset[0]);
            let u = fma::<FMA>(u * stretch[k], self.scale[1], self.offset[1]);
            let (fv, fu) = (v.floor(), u.floor());
            let (row, column) = ((fv + WHOLE).to_bits() & (self.rows - 1), (fu + WHOLE).to_bits() & (self.columns - 1));
            let below = (row + 1) & (self.rows - 1);
            let right = (column + 1) & (self.columns - 1);
            let (top, bottom) = (self.first + row * self.columns, self.first + below * self.columns);
            spots.at[0][k] = top + column;
            spots.at[1][k] = top + right;
            spots.at[2][k] = bottom + column;
            spots.at[3][k] = bottom + right;
            (spots.v[k], spots.u[k]) = (v - fv, u - fu);
        }
        spots
    }
}

/// Where the factors of a direction are, for one instance at N wavelengths.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look<const N: usize> {
    /// Whether the direction is one.
    valid: bool,
    stretch: [f32; N],
    places: [Place; 2],
    tiles: [Tile; 2],
    spots: [Spots<N>; 2],
}

impl<const N: usize> Look<N> {
    #[inline]
    pub(super) fn new(
        tiles: &NoiseTiles,
        instance: Instance,
        theta_i: f32,
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> Look<N> {
        look(tiles, instance, theta_i, wo, &lambda_um)
    }

    /// Asks for the memory of the factors.
    #[inline]
    pub(super) fn prefetch(&self, tiles: &NoiseTiles) {
        for spots in &self.spots {
            for at in spots.at[0].iter().chain(&spots.at[2]) {
                prefetch(&tiles.tiles, *at as usize);
            }
        }
    }

    /// The factors of f_refl and of f_high.
    #[inline]
    pub(crate) fn read(&self, tiles: &NoiseTiles) -> ([f32; N], [f32; N]) {
        read(self, tiles)
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn look<const N: usize>(
    tiles: &NoiseTiles,
    instance: Instance,
    theta_i: f32,
    wo: [f32; 3],
    lambda_um: &[f32; N],
) -> Look<N> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let [x, y, z] = wo;
    let valid = x.abs() <= 2.0 && y.abs() <= 2.0 && z.abs() <= 2.0;
    let [x, y, z] = if valid { wo } else { [0.0, 1.0, 0.0] };
    let reference = tiles.lambda_um as f32;
    let mut stretch = [1.0; N];
    for k in 0..N {
        let ratio = reference / lambda_um[k];
        stretch[k] = if ratio.is_nan() { 1.0 } else { ratio.max(0.1).min(10.0) };
    }
    let sin_i = if theta_i.abs() <= 4.0 {
        let (s, _, sign) = sin_cos_half_turns::<FMA>(theta_i * FRAC_1_PI);
        signed(s, sign)
    } else if theta_i.is_finite() {
        theta_i.sin()
    } else {
        0.0
    };
    let alpha = azimuth::<FMA>(-x, y);
    let beta = alpha - PI.copysign(alpha);
    let v = z + sin_i;
    let places =
        [Place::new(alpha, (1.0 - 0.25 * v * v).max(0.0).sqrt(), v), Place::new(beta, (x * x + y * y).sqrt(), z)];
    let of = [Tile::new(tiles, instance, 0), Tile::new(tiles, instance, 1)];
    let spots = [
        of[0].spots::<FMA, N>(places[0].v, places[0].u, &stretch),
        of[1].spots::<FMA, N>(places[1].v, places[1].u, &stretch),
    ];
    Look { valid, stretch, places, tiles: of, spots }
}

/// N at spots of a tile, bilinear.
#[inline(always)]
fn values<const FMA: bool, const N: usize>(tiles: &NoiseTiles, index: usize, spots: &Spots<N>) -> [f32; N] {
    let (low, step) = match tiles.code.get(2 * index..2 * index + 2) {
        Some(code) => (code[0], code[1]),
        None => (1.0, 0.0),
    };
    let mut codes = [[0u8; N]; 4];
    for (codes, at) in codes.iter_mut().zip(&spots.at) {
        for k in 0..N {
            codes[k] = tiles.tiles.get(at[k] as usize).copied().unwrap_or(0);
        }
    }
    let mut values = [0.0; N];
    for k in 0..N {
        let node = |i: usize| {
            let root = fma::<FMA>(step, f32::from(codes[i][k]), low);
            root * root
        };
        let (a, b, c, d) = (node(0), node(1), node(2), node(3));
        let (top, bottom) = (fma::<FMA>(spots.u[k], b - a, a), fma::<FMA>(spots.u[k], d - c, c));
        values[k] = fma::<FMA>(spots.v[k], bottom - top, top);
    }
    values
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn read<const N: usize>(look: &Look<N>, tiles: &NoiseTiles) -> ([f32; N], [f32; N]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    if !look.valid {
        return ([1.0; N], [1.0; N]);
    }
    let mut factors = [[1.0; N]; 2];
    for kind in 0..2 {
        let (place, tile) = (&look.places[kind], &look.tiles[kind]);
        let mut n = values::<FMA, N>(tiles, tile.index, &look.spots[kind]);
        if place.share > 0.0 {
            let other = tile.spots::<FMA, N>(place.v, place.other, &look.stretch);
            let other = values::<FMA, N>(tiles, tile.index, &other);
            for k in 0..N {
                n[k] = fma::<FMA>(place.share, other[k] - n[k], n[k]);
            }
        }
        let [at_0, slope] = tiles.fade[kind].map(|v| v as f32);
        let slope = slope * tiles.lambda_um as f32;
        for k in 0..N {
            let fade = (at_0 + slope / look.stretch[k]).max(0.0).min(1.0);
            factors[kind][k] = fma::<FMA>(fade, n[k] - 1.0, 1.0);
        }
    }
    (factors[0], factors[1])
}
