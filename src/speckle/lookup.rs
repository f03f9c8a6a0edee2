//! The lookup of a direction's speckle, in two steps: first the position of its factors in the tiles, then
//! their values. Between the two a host does other work while the prefetched memory arrives: tiles are larger
//! than the caches near the processor.

use super::tiles::{Instance, NoiseTiles, SEAM_RAD};
use crate::math::hash::mix64;
use crate::math::simd::{atan2, fma, max, min, prefetch, signed, sin_cos_half_turns};
use multiversion::{multiversion, target::target_cfg_f};
use std::f32::consts::{FRAC_1_PI, PI};

impl NoiseTiles {
    /// The factors of f_refl and f_high in direction `wo` at N wavelengths [um], for one instance. Their mean
    /// over instances is 1.
    ///
    /// A direction that is not finite gives 1. Wavelengths are clamped to a tenth and ten times that of the
    /// tiles; NaN counts as that of the tiles, and a NaN theta_i as 0. No call fails, allocates or panics.
    pub fn factors<const N: usize>(
        &self,
        instance: Instance,
        theta_i: f32,
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> ([f32; N], [f32; N]) {
        Speckle::new(self, instance, theta_i, &lambda_um).look(wo).factors()
    }
}

/// Coordinates of a direction on the patterns of one kind, before stretching.
#[derive(Clone, Copy, Debug)]
struct PatternPoint {
    u: f32,
    v: f32,
    /// u on the other side of the seam, and the share of that side.
    other: f32,
    share: f32,
}

impl PatternPoint {
    /// Coordinates from an azimuth in [-pi, pi], the cosine that scales it to an arc, and v.
    #[inline(always)]
    fn new(azimuth: f32, cos: f32, v: f32) -> PatternPoint {
        let beyond = azimuth - (2.0 * PI).copysign(azimuth);
        // 1/2 at the seam, 0 and flat at its end.
        let t = ((azimuth.abs() - (PI - SEAM_RAD)) / SEAM_RAD).max(0.0).min(1.0);
        PatternPoint { u: azimuth * cos, v, other: beyond * cos, share: t * t * (1.5 - t) }
    }
}

/// 1.5 2^23 plus a whole number below 2^22 stores that number in its low bits, negative ones as their two's
/// complement. Larger values fall somewhere on the tile.
const WHOLE: f32 = 12_582_912.0;

/// Numbers of f_refl and f_high at N wavelengths.
type Lanes<T, const N: usize> = [[T; N]; 2];

/// The patterns of one instance at one latitude and N wavelengths: for each kind the tile, mirrored, shifted
/// and stretched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Speckle<'a, const N: usize> {
    tiles: &'a NoiseTiles,
    /// Sine of theta_i.
    sin_i: f32,
    rows: u32,
    columns: u32,
    /// For each kind the index of the tile's first code; low and step of its codes; position of its origin.
    first: [u32; 2],
    code: [[f32; 2]; 2],
    offset: [[f32; 2]; 2],
    /// Nodes per unit of v and of u.
    per_v: Lanes<f32, N>,
    per_u: Lanes<f32, N>,
    /// s of [`NoiseTiles::fade`].
    fade: Lanes<f32, N>,
}

impl<'a, const N: usize> Speckle<'a, N> {
    #[inline]
    pub(crate) fn new(tiles: &'a NoiseTiles, instance: Instance, theta_i: f32, lambda_um: &[f32; N]) -> Speckle<'a, N> {
        speckle(tiles, instance, theta_i, lambda_um)
    }

    /// Position of the factors of a direction; prefetches their codes.
    #[inline]
    pub(crate) fn look(&self, wo: [f32; 3]) -> Look<'_, N> {
        look(self, wo)
    }

    /// Cell and fraction at (v, u) of one kind at wavelength k. Sizes are powers of two, so masks wrap.
    #[inline(always)]
    fn cell<const FMA: bool>(&self, kind: usize, k: usize, v: f32, u: f32) -> ([u32; 2], [f32; 2]) {
        let v = fma::<FMA>(v, self.per_v[kind][k], self.offset[kind][0]);
        let u = fma::<FMA>(u, self.per_u[kind][k], self.offset[kind][1]);
        let (fv, fu) = (v.floor(), u.floor());
        let (row, column) = ((fv + WHOLE).to_bits() & (self.rows - 1), (fu + WHOLE).to_bits() & (self.columns - 1));
        ([row, column], [v - fv, u - fu])
    }

    /// N at a point, bilinear: the scalar form of [`factors`], for the points that it cannot vectorize.
    #[cold]
    #[inline(never)]
    fn value(&self, kind: usize, k: usize, v: f32, u: f32) -> f32 {
        let ([row, column], [v, u]) = self.cell::<false>(kind, k, v, u);
        let (below, right) = ((row + 1) & (self.rows - 1), (column + 1) & (self.columns - 1));
        let node = |row: u32, column: u32| {
            let at = self.first[kind] + row * self.columns + column;
            let code = self.tiles.tiles.get(at as usize).map_or(0.0, |c| f32::from(*c));
            let root = self.code[kind][0] + self.code[kind][1] * code;
            root * root
        };
        let (a, b) = (node(row, column), node(row, right));
        let (c, d) = (node(below, column), node(below, right));
        let (top, bottom) = (a + u * (b - a), c + u * (d - c));
        top + v * (bottom - top)
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn speckle<'a, const N: usize>(
    tiles: &'a NoiseTiles,
    instance: Instance,
    theta_i: f32,
    lambda_um: &[f32; N],
) -> Speckle<'a, N> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let sin_i = if theta_i.abs() <= 4.0 {
        let (s, _, sign) = sin_cos_half_turns::<FMA>(theta_i * FRAC_1_PI);
        signed(s, sign)
    } else {
        beyond(theta_i)
    };
    let reference = tiles.lambda_um as f32;
    // Wavelengths over that of the tiles, and the inverse.
    let (mut lambda, mut stretch) = ([1.0; N], [1.0; N]);
    for k in 0..N {
        let ratio = lambda_um[k] / reference;
        lambda[k] = if ratio.is_nan() { 1.0 } else { min(max(ratio, 0.1), 10.0) };
        stretch[k] = 1.0 / lambda[k];
    }
    let [count, rows, columns] = tiles.sizes;
    let mut x = Speckle {
        tiles,
        sin_i,
        rows: rows as u32,
        columns: columns as u32,
        first: [0; 2],
        code: [[1.0, 0.0]; 2],
        offset: [[0.0; 2]; 2],
        per_v: [[0.0; N]; 2],
        per_u: [[0.0; N]; 2],
        fade: [[0.0; N]; 2],
    };
    for kind in 0..2 {
        // Independent bits for each kind: tile, two offsets of 20 bits, two mirrors.
        let bits = mix64(instance.0 ^ (kind as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let index = kind * count + ((bits >> 42) as usize & (count - 1));
        const UNIT: f32 = 1.0 / (1u32 << 20) as f32;
        x.first[kind] = (index * rows * columns) as u32;
        if let Some(code) = tiles.code.get(2 * index..).and_then(|c| c.first_chunk()) {
            x.code[kind] = *code;
        }
        x.offset[kind] = [
            (bits & 0xf_ffff) as i32 as f32 * UNIT * rows as i32 as f32,
            (bits >> 20 & 0xf_ffff) as i32 as f32 * UNIT * columns as i32 as f32,
        ];
        // The top bits of a float are its signs.
        let (sign_v, sign_u) = ((bits >> 31) as u32 & 1 << 31, (bits >> 32) as u32 & 1 << 31);
        let [step_v, step_u] = tiles.step[kind];
        let (per_v, per_u) = (signed(1.0 / step_v as f32, sign_v), signed(1.0 / step_u as f32, sign_u));
        let [at_0, slope] = tiles.fade[kind].map(|x| x as f32);
        for k in 0..N {
            x.per_v[kind][k] = per_v * stretch[k];
            x.per_u[kind][k] = per_u * stretch[k];
            x.fade[kind][k] = min(max(fma::<FMA>(slope * reference, lambda[k], at_0), 0.0), 1.0);
        }
    }
    x
}

/// Position of the factors of a direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look<'a, const N: usize> {
    speckle: &'a Speckle<'a, N>,
    /// Whether the direction is valid.
    valid: bool,
    /// Whether two neighboring nodes are adjacent in memory.
    plain: bool,
    places: [PatternPoint; 2],
    /// Indices of the left ones of the four nodes around, and fractions of the direction between the nodes.
    top: Lanes<u32, N>,
    bottom: Lanes<u32, N>,
    v: Lanes<f32, N>,
    u: Lanes<f32, N>,
}

impl<const N: usize> Look<'_, N> {
    /// The factors of f_refl and of f_high.
    #[inline]
    pub(crate) fn factors(&self) -> ([f32; N], [f32; N]) {
        factors(self)
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn look<'a, const N: usize>(speckle: &'a Speckle<'a, N>, wo: [f32; 3]) -> Look<'a, N> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let [x, y, z] = wo;
    let valid = x.abs() <= 2.0 && y.abs() <= 2.0 && z.abs() <= 2.0;
    let [x, y, z] = if valid { wo } else { [0.0, 1.0, 0.0] };
    let alpha = atan2::<FMA>(-x, y);
    let beta = alpha - PI.copysign(alpha);
    let v = z + speckle.sin_i;
    let places = [
        PatternPoint::new(alpha, max(1.0 - 0.25 * v * v, 0.0).sqrt(), v),
        PatternPoint::new(beta, (x * x + y * y).sqrt(), z),
    ];
    let (mut top, mut bottom) = ([[0; N]; 2], [[0; N]; 2]);
    let (mut cell_v, mut cell_u) = ([[0.0; N]; 2], [[0.0; N]; 2]);
    let mut last = 0;
    for kind in 0..2 {
        for k in 0..N {
            let ([row, column], [v, u]) = speckle.cell::<FMA>(kind, k, places[kind].v, places[kind].u);
            let below = (row + 1) & (speckle.rows - 1);
            top[kind][k] = speckle.first[kind] + row * speckle.columns + column;
            bottom[kind][k] = speckle.first[kind] + below * speckle.columns + column;
            (cell_v[kind][k], cell_u[kind][k]) = (v, u);
            last |= u32::from(column + 1 == speckle.columns);
        }
    }
    for (top, bottom) in top.as_flattened().iter().zip(bottom.as_flattened()) {
        prefetch(&speckle.tiles.tiles, *top as usize);
        prefetch(&speckle.tiles.tiles, *bottom as usize);
    }
    Look { speckle, valid, plain: last == 0, places, top, bottom, v: cell_v, u: cell_u }
}

/// The sine of an invalid latitude; 0 for NaN.
#[cold]
#[inline(never)]
fn beyond(theta_i: f32) -> f32 {
    if theta_i.is_finite() { theta_i.sin() } else { 0.0 }
}

/// Two codes side by side.
#[inline(always)]
fn pair(codes: &[u8], at: u32) -> u32 {
    match codes.get(at as usize..) {
        Some([left, right, ..]) => u32::from(u16::from_le_bytes([*left, *right])),
        _ => 0,
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn factors<const N: usize>(look: &Look<'_, N>) -> ([f32; N], [f32; N]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    if !look.valid {
        return ([1.0; N], [1.0; N]);
    }
    let speckle = look.speckle;
    let mut factors = [[1.0; N]; 2];
    if look.plain {
        let mut codes = [[0; N]; 2];
        let tiles = speckle.tiles.tiles.as_slice();
        for kind in 0..2 {
            for k in 0..N {
                codes[kind][k] = pair(tiles, look.top[kind][k]) | pair(tiles, look.bottom[kind][k]) << 16;
            }
        }
        let (mut low, mut step) = ([[0.0; N]; 2], [[0.0; N]; 2]);
        for kind in 0..2 {
            [low[kind], step[kind]] = [[speckle.code[kind][0]; N], [speckle.code[kind][1]; N]];
        }
        let (low, step, codes) = (low.as_flattened(), step.as_flattened(), codes.as_flattened());
        let (v, u) = (look.v.as_flattened(), look.u.as_flattened());
        for (i, n) in factors.as_flattened_mut().iter_mut().enumerate() {
            // The four nodes: a, b above c, d.
            let a = fma::<FMA>(step[i], (codes[i] & 0xff) as i32 as f32, low[i]);
            let b = fma::<FMA>(step[i], (codes[i] >> 8 & 0xff) as i32 as f32, low[i]);
            let c = fma::<FMA>(step[i], (codes[i] >> 16 & 0xff) as i32 as f32, low[i]);
            let d = fma::<FMA>(step[i], (codes[i] >> 24) as i32 as f32, low[i]);
            let (a, b, c, d) = (a * a, b * b, c * c, d * d);
            let (top, bottom) = (fma::<FMA>(u[i], b - a, a), fma::<FMA>(u[i], d - c, c));
            *n = fma::<FMA>(v[i], bottom - top, top);
        }
    } else {
        for kind in 0..2 {
            for k in 0..N {
                factors[kind][k] = speckle.value(kind, k, look.places[kind].v, look.places[kind].u);
            }
        }
    }
    for kind in 0..2 {
        let place = &look.places[kind];
        if place.share > 0.0 {
            for k in 0..N {
                let other = speckle.value(kind, k, place.v, place.other);
                factors[kind][k] = fma::<FMA>(place.share, other - factors[kind][k], factors[kind][k]);
            }
        }
    }
    let fade = speckle.fade.as_flattened();
    for (n, fade) in factors.as_flattened_mut().iter_mut().zip(fade) {
        *n = fma::<FMA>(*fade, *n - 1.0, 1.0);
    }
    (factors[0], factors[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn tiles(rng: &mut Pcg64Mcg) -> NoiseTiles {
        let sizes = [2, 16, 32];
        let (mut tiles, mut code) = (Vec::new(), Vec::new());
        for _ in 0..2 * sizes[0] {
            let values: Vec<f64> = (0..sizes[1] * sizes[2]).map(|_| rng.random::<f64>()).collect();
            let (codes, scale) = NoiseTiles::code(&values);
            tiles.extend(codes);
            code.extend(scale);
        }
        let fade = [[1.2, -0.5], [0.4, 0.3]];
        NoiseTiles {
            tiles,
            sizes,
            code,
            step: [[0.05, 0.07], [0.04, 0.03]],
            lambda_um: 0.4,
            fade,
            contrast: [[1.0; 2]; 2],
        }
    }

    /// All wavelengths side by side agree with one point after the other, also at the seams and the tiles'
    /// borders.
    #[test]
    fn factors_are_those_of_single_places() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let tiles = tiles(&mut rng);
        let lambda = [0.38, 0.45, 0.55, 0.62, 0.78];
        let (mut seams, mut borders) = (0, 0);
        for i in 0..5000 {
            let phi = std::f32::consts::TAU * rng.random::<f32>();
            let wo = crate::frame::direction((2.0 * rng.random::<f32>() - 1.0).asin(), phi);
            let theta_i = 3.0 * (rng.random::<f32>() - 0.5);
            let speckle = Speckle::new(&tiles, Instance::new(i, [0.0; 2], 1.0), theta_i, &lambda);
            let look = speckle.look(wo);
            borders += u32::from(!look.plain);
            seams += u32::from(look.places.iter().any(|p| p.share > 0.0));
            let (refl, high) = look.factors();
            for (kind, got) in [refl, high].into_iter().enumerate() {
                let place = &look.places[kind];
                for k in 0..lambda.len() {
                    let a = speckle.value(kind, k, place.v, place.u);
                    let b = speckle.value(kind, k, place.v, place.other);
                    let n = a + place.share * (b - a);
                    let fade = (tiles.fade[kind][0] as f32 + tiles.fade[kind][1] as f32 * lambda[k]).clamp(0.0, 1.0);
                    let want = 1.0 + fade * (n - 1.0);
                    assert!((got[k] - want).abs() < 1e-3, "kind {kind}, {wo:?}: got {}, want {want}", got[k]);
                }
            }
        }
        assert!(seams > 300 && borders > 300, "{seams} seams, {borders} borders");
    }

    /// Points far beyond the range in which cells are exact stay on the tile.
    #[test]
    fn any_place_is_on_the_tile() {
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        let tiles = NoiseTiles { step: [[1e-6; 2]; 2], ..tiles(&mut rng) };
        for i in 0..1000 {
            let wo =
                crate::frame::direction(1.5 * (rng.random::<f32>() - 0.5), std::f32::consts::TAU * rng.random::<f32>());
            let (refl, high) = tiles.factors(Instance::new(i, [0.0; 2], 1.0), 1e30, wo, [1e-6, 0.5, f32::NAN]);
            assert!(refl.iter().chain(&high).all(|n| (0.0..10.0).contains(n)), "{refl:?} {high:?}");
        }
    }
}
