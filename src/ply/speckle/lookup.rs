//! Evaluation of a ply's speckle. The sources around a position are generated once, and their waves are
//! summed for each direction and wavelength. [`super::field`] has the formulas.

use super::field::{NoiseField, TABLE, TABLE_BITS};
use crate::math::hash::mix32;
use crate::math::simd::{atan2, fma, halves, max, min, signed, sin_cos_half_turns};
use crate::ply::PlyPlace;
use multiversion::{multiversion, target::target_cfg_f};
use std::f32::consts::{FRAC_1_PI, PI};

/// Half width of the blend at the seam of a pattern [rad].
pub const SEAM_RAD: f32 = 0.15;
/// Number of sources of a fiber in the window.
const CELLS: usize = 16;
/// Odd number that spreads small integers over 32 bits.
const SPREAD: u32 = 0x9e37_79b9;
/// Steps of the quantiles of the positions across and along, from source to source: 2^32 divided by the root
/// of `x^3 = x + 1`, and by its square.
const STEPS: [u32; 2] = [0xc13f_a9a9, 0x91e1_0da5];

impl NoiseField {
    /// The factors on f_refl and f_high at a position and an offset h [um], in direction `wo` at N
    /// wavelengths [um]. Their mean over positions is 1.
    ///
    /// If the direction or the position is not finite, the factors are 1. Wavelengths are clamped to a tenth
    /// of and ten times the wavelength of the simulated patterns, which also replaces NaN; a NaN theta_i
    /// becomes 0. No call fails, allocates or panics.
    pub fn factors<const N: usize>(
        &self,
        place: &PlyPlace,
        h_um: f32,
        theta_i: f32,
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> ([f32; N], [f32; N]) {
        self.at(place, h_um, theta_i, &lambda_um).map_or(([1.0; N], [1.0; N]), |speckle| speckle.factors(wo))
    }

    /// The patterns at a position; `None` if the footprint averages them out or an input is not finite.
    #[inline(always)]
    pub(crate) fn at<const N: usize>(
        &self,
        place: &PlyPlace,
        h_um: f32,
        theta_i: f32,
        lambda_um: &[f32; N],
    ) -> Option<Speckle<N>> {
        let blur = self.blur(place, h_um);
        if max(blur[0], blur[1]) > 0.0 { Some(speckle(self, place, h_um, theta_i, lambda_um, blur)) } else { None }
    }
}

/// Coordinates of a direction in the pattern of one kind, before the scale by wavelength.
#[derive(Clone, Copy, Debug)]
struct PatternPoint {
    u: f32,
    v: f32,
    /// u on the other side of the seam, and the weight of the blend with it, which is 1 at the seam.
    other: f32,
    blend: f32,
}

impl PatternPoint {
    /// Coordinates from an azimuth in [-pi, pi], the cosine that scales it to an arc, and v.
    #[inline(always)]
    fn new(azimuth: f32, cos: f32, v: f32) -> PatternPoint {
        let beyond = azimuth - (2.0 * PI).copysign(azimuth);
        let t = max(min((azimuth.abs() - (PI - SEAM_RAD)) / SEAM_RAD, 1.0), 0.0);
        PatternPoint { u: azimuth * cos, v, other: beyond * cos, blend: t * t * (3.0 - 2.0 * t) }
    }
}

/// The sources of one kind on a fiber.
#[derive(Clone, Copy, Debug)]
struct Sources {
    /// sqrt(b) w |c|, with [`FiberSources::scale`] included in w.
    size: [f32; CELLS],
    /// Phase of c [half turns].
    phase: [f32; CELLS],
    across_um: [f32; CELLS],
}

/// The sources of a fiber in the window around a position.
#[derive(Clone, Copy, Debug)]
struct FiberSources {
    kinds: [Sources; 2],
    along_um: [f32; CELLS],
    /// Distance of the position from the source in the middle, in cells, and the scale of the weights.
    past: f32,
    scale: f32,
}

impl FiberSources {
    const NONE: FiberSources = FiberSources {
        kinds: [Sources { size: [0.0; CELLS], phase: [0.0; CELLS], across_um: [0.0; CELLS] }; 2],
        along_um: [0.0; CELLS],
        past: 0.0,
        scale: 0.0,
    };

    /// Generates the sources of fiber `number` of a ply, whose weight in the field is `share`.
    #[inline(always)]
    fn fill<const FMA: bool>(&mut self, field: &NoiseField, of_ply: u32, number: u32, along_um: f32, share: f32) {
        let x = self;
        let key = mix32(of_ply.wrapping_add(number.wrapping_mul(SPREAD)));
        const UNIT: f32 = 1.0 / (1u32 << 24) as f32;
        // The position in cells, with a random origin on each fiber.
        let cell = fma::<FMA>(CELLS as f32 / 4.0 / field.w0_um, along_um, UNIT * (key >> 8) as i32 as f32);
        let whole = cell.floor();
        (x.past, x.scale) = (min(max(cell - whole, 0.0), 1.0), 1.0);
        let mut weights = x.weights::<FMA>();
        let mut squares = [0.0; CELLS];
        for s in 0..CELLS {
            squares[s] = weights[s] * weights[s];
        }
        x.scale = share / halves(squares).sqrt();
        for w in &mut weights {
            *w *= x.scale;
        }
        let lowest = (whole as i32).wrapping_sub(CELLS as i32 / 2 - 1) as u32;
        let shifts = [mix32(key.wrapping_add(1)), mix32(key.wrapping_add(2)), mix32(key.wrapping_add(3))];
        let (mut words, mut quantiles) = ([0; CELLS], [[0; CELLS]; 3]);
        for s in 0..CELLS {
            let cell = lowest.wrapping_add(s as u32);
            words[s] = mix32(key ^ cell.wrapping_mul(SPREAD));
            quantiles[0][s] = shifts[0].wrapping_add(cell.wrapping_mul(STEPS[0]));
            quantiles[1][s] = shifts[1].wrapping_add(cell.wrapping_mul(STEPS[0]));
            quantiles[2][s] = shifts[2].wrapping_add(cell.wrapping_mul(STEPS[1]));
        }
        x.look_up(field, &words, &quantiles);
        for kind in 0..2 {
            let (of, root) = (&mut x.kinds[kind], field.share[kind].sqrt());
            for s in 0..CELLS {
                of.size[s] *= root * weights[s];
                of.phase[s] = (words[s] >> (16 * kind as u32 + TABLE_BITS) & 0x7f) as i32 as f32 * (1.0 / 64.0);
            }
        }
    }

    /// Reads the tables one number at a time, which is faster than gathers of wide registers.
    #[inline(never)]
    fn look_up(&mut self, field: &NoiseField, words: &[u32; CELLS], quantiles: &[[u32; CELLS]; 3]) {
        for s in 0..CELLS {
            self.along_um[s] = position(&field.along_um, quantiles[2][s]);
            for kind in 0..2 {
                let of = &mut self.kinds[kind];
                of.size[s] = field.size[(words[s] >> (16 * kind)) as usize % TABLE];
                of.across_um[s] = position(&field.across_um[kind], quantiles[kind][s]);
            }
        }
    }

    #[inline(always)]
    fn weights<const FMA: bool>(&self) -> [f32; CELLS] {
        let mut weights = [0.0; CELLS];
        for s in 0..CELLS {
            let d = ((s as i32 - (CELLS as i32 / 2 - 1)) as f32 - self.past) * (2.0 / CELLS as f32);
            let open = fma::<FMA>(-d, d, 1.0);
            weights[s] = self.scale * (open * open * open);
        }
        weights
    }
}

/// The patterns at one position, at one latitude and N wavelengths.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Speckle<const N: usize> {
    /// Sine of theta_i.
    sin_i: f32,
    fibers: [FiberSources; 2],
    /// Whether two fibers are visible, or just the first.
    two: bool,
    /// sqrt(1 - b) of each kind.
    constant: [f32; 2],
    /// Phase of a source divided by its position times an angle [half turns / um].
    per_um: [f32; N],
    /// Factors of the contrast: N becomes 1 + fade (N - 1).
    fade: [[f32; N]; 2],
}

/// Entry of a table of absolute positions, with a sign, at a quantile of 32 bits.
#[inline(always)]
fn position(table: &[f32; TABLE], quantile: u32) -> f32 {
    // The table is read upwards from the median for quantiles above it, and downwards for those below.
    let below = (!quantile as i32 >> 31) as u32;
    signed(table[((quantile ^ below) >> (31 - TABLE_BITS)) as usize % TABLE], below & 1 << 31)
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn speckle<const N: usize>(
    field: &NoiseField,
    place: &PlyPlace,
    h_um: f32,
    theta_i: f32,
    lambda_um: &[f32; N],
    blur: [f32; 2],
) -> Speckle<N> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let sin_i = if theta_i.abs() <= 4.0 {
        let (s, _, sign) = sin_cos_half_turns::<FMA>(theta_i * FRAC_1_PI);
        signed(s, sign)
    } else {
        beyond(theta_i)
    };
    // The visible fiber, or the two that are blended and their weights.
    let row = field.around.row(place.azimuth, h_um) - 0.5;
    let mut first = row.floor();
    let mut t = if field.around.count < 1.5 { 0.0 } else { max(min(2.0 * (row - first) - 0.5, 1.0), 0.0) };
    if t >= 1.0 {
        (first, t) = (first + 1.0, 0.0);
    }
    let (sin, cos, _) = sin_cos_half_turns::<FMA>(0.5 * t * t * (3.0 - 2.0 * t));
    let of_ply = mix32(place.ply ^ field.seed);
    let count = field.around.count;
    let mut x = Speckle {
        sin_i,
        fibers: [FiberSources::NONE; 2],
        two: t > 0.0,
        constant: [(1.0 - field.share[0]).sqrt(), (1.0 - field.share[1]).sqrt()],
        per_um: [0.0; N],
        fade: [[0.0; N]; 2],
    };
    x.fibers[0].fill::<FMA>(field, of_ply, number_of(first, count), place.along_um, cos.abs());
    if x.two {
        x.fibers[1].fill::<FMA>(field, of_ply, number_of(first + 1.0, count), place.along_um, sin.abs());
    }
    for k in 0..N {
        let ratio = lambda_um[k] / field.lambda_um;
        let lambda = field.lambda_um * if ratio.is_nan() { 1.0 } else { min(max(ratio, 0.1), 10.0) };
        x.per_um[k] = 2.0 / lambda;
        for kind in 0..2 {
            let [at_0, slope] = field.fade[kind];
            x.fade[kind][k] = blur[kind] * min(max(fma::<FMA>(slope, lambda, at_0), 0.0), 1.0);
        }
    }
    x
}

/// The number of the fiber in a row; rows beyond the count begin anew.
#[inline(always)]
fn number_of(row: f32, count: f32) -> u32 {
    let at = row - count * (row / count).floor();
    // Rounding may give a number equal to the count.
    if at < count { max(at, 0.0) as u32 } else { 0 }
}

/// The sine of a latitude beyond 4 rad; 0 for NaN and infinity.
#[cold]
#[inline(never)]
fn beyond(theta_i: f32) -> f32 {
    if theta_i.is_finite() { theta_i.sin() } else { 0.0 }
}

/// Sums of every fourth number, which vectorize.
#[inline(always)]
fn quarters(x: &[f32; CELLS]) -> [f32; 4] {
    let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
    for s in 0..8 {
        eight[s] = x[s] + x[s + 8];
    }
    for s in 0..4 {
        four[s] = eight[s] + eight[s + 4];
    }
    four
}

impl<const N: usize> Speckle<N> {
    /// The factors on f_refl and on f_high in a direction.
    #[inline]
    pub(crate) fn factors(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        factors(self, wo)
    }

    /// sqrt(b) g of a kind at a point, at each wavelength. F is the number of visible fibers.
    #[inline(always)]
    fn waves<const FMA: bool, const F: usize>(&self, kind: usize, [u, v]: [f32; 2]) -> [[f32; 2]; N] {
        let (mut re, mut im) = ([[0.0; 4]; N], [[0.0; 4]; N]);
        for k in 0..N {
            let (u, v) = (u * self.per_um[k], v * self.per_um[k]);
            let (mut x, mut y) = ([0.0; CELLS], [0.0; CELLS]);
            for f in 0..F {
                let (fiber, of) = (&self.fibers[f], &self.fibers[f].kinds[kind]);
                for s in 0..CELLS {
                    let turns = fma::<FMA>(of.across_um[s], u, fma::<FMA>(fiber.along_um[s], v, of.phase[s]));
                    let (sin, cos, sign) = sin_cos_half_turns::<FMA>(turns);
                    let size = signed(of.size[s], sign);
                    (x[s], y[s]) = (fma::<FMA>(size, cos, x[s]), fma::<FMA>(size, sin, y[s]));
                }
            }
            (re[k], im[k]) = (quarters(&x), quarters(&y));
        }
        let mut sums = [[0.0; 2]; N];
        for k in 0..N {
            sums[k][0] = (re[k][0] + re[k][2]) + (re[k][1] + re[k][3]);
            sums[k][1] = (im[k][0] + im[k][2]) + (im[k][1] + im[k][3]);
        }
        sums
    }
}

/// Blends `waves`, sqrt(b) g on this side of the seam, with that of the other side. Both sides have the same
/// sources, so the power of the blend is not the sum of their powers.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn blend_at_seam<const F: usize, const N: usize>(
    speckle: &Speckle<N>,
    kind: usize,
    at: &PatternPoint,
    waves: &mut [[f32; 2]; N],
) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let (sin, cos, _) = sin_cos_half_turns::<FMA>(0.25 * at.blend);
    let (sin, cos) = (sin.abs(), cos.abs());
    let other = speckle.waves::<FMA, F>(kind, [at.other, at.v]);
    let mut powers = [[0.0; CELLS]; F];
    for f in 0..F {
        let weights = speckle.fibers[f].weights::<FMA>();
        for s in 0..CELLS {
            powers[f][s] = weights[s] * weights[s];
        }
    }
    for k in 0..N {
        let between = (at.u - at.other) * speckle.per_um[k];
        let mut both = [0.0; CELLS];
        for f in 0..F {
            let of = &speckle.fibers[f].kinds[kind];
            for s in 0..CELLS {
                let (_, cos, sign) = sin_cos_half_turns::<FMA>(of.across_um[s] * between);
                both[s] = fma::<FMA>(powers[f][s], signed(cos, sign), both[s]);
            }
        }
        let power = 1.0 + 2.0 * sin * cos * halves(both);
        let scale = 1.0 / max(power, 1e-3).sqrt();
        waves[k][0] = scale * (cos * waves[k][0] + sin * other[k][0]);
        waves[k][1] = scale * (cos * waves[k][1] + sin * other[k][1]);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn factors<const N: usize>(speckle: &Speckle<N>, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let [x, y, z] = wo;
    if !(x.abs() <= 2.0 && y.abs() <= 2.0 && z.abs() <= 2.0) {
        return ([1.0; N], [1.0; N]);
    }
    let alpha = atan2::<FMA>(-x, y);
    let beta = alpha - PI.copysign(alpha);
    let v = z + speckle.sin_i;
    let points = [
        PatternPoint::new(alpha, max(1.0 - 0.25 * v * v, 0.0).sqrt(), v),
        PatternPoint::new(beta, min(x * x + y * y, 1.0).sqrt(), z),
    ];
    let mut factors = [[1.0; N]; 2];
    for kind in 0..2 {
        let at = &points[kind];
        let mut waves;
        if speckle.two {
            waves = speckle.waves::<FMA, 2>(kind, [at.u, at.v]);
            if at.blend > 0.0 {
                blend_at_seam::<2, N>(speckle, kind, at, &mut waves);
            }
        } else {
            waves = speckle.waves::<FMA, 1>(kind, [at.u, at.v]);
            if at.blend > 0.0 {
                blend_at_seam::<1, N>(speckle, kind, at, &mut waves);
            }
        }
        for k in 0..N {
            let [re, im] = waves[k];
            let re = re + speckle.constant[kind];
            let n = fma::<FMA>(re, re, im * im);
            factors[kind][k] = fma::<FMA>(speckle.fade[kind][k], n - 1.0, 1.0);
        }
    }
    (factors[0], factors[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::direction;
    use crate::math::hash::Fnv64;
    use crate::ply::FibersAround;
    use crate::ply::speckle::NoiseSpectrum;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use std::f64::consts::{PI, TAU};

    fn spectrum() -> NoiseSpectrum {
        let mut spectrum = vec![0.0; 2 * 40];
        for (i, kind) in spectrum.chunks_exact_mut(40).enumerate() {
            (kind[0], kind[3], kind[10 + i], kind[30]) = (0.2, 0.1, 0.2, 0.1);
        }
        NoiseSpectrum {
            seed: 5,
            spectrum,
            step_um: [0.2, 0.3],
            share: [0.4, 1.0],
            w0_um: 10.0,
            lambda_um: 0.4,
            fade: [[1.2, -0.5], [0.4, 0.3]],
            contrast: [0.8, 1.0],
        }
    }

    fn field() -> NoiseField {
        spectrum().field(FibersAround { count: 9.0, ring_um: 20.0 })
    }

    /// N of a kind by the sum of the module text, in f64.
    fn reference(
        field: &NoiseField,
        place: &PlyPlace,
        h_um: f64,
        theta_i: f64,
        wo: [f32; 3],
        lambda: f64,
        kind: usize,
    ) -> f64 {
        let [x, y, z] = wo.map(f64::from);
        let (azimuth, cos, v) = match kind {
            0 => {
                let v = z + theta_i.sin();
                ((-x).atan2(y), (1.0 - 0.25 * v * v).max(0.0).sqrt(), v)
            }
            _ => (x.atan2(-y), x.hypot(y), z),
        };
        let row = 9.0 * (f64::from(place.azimuth) - (h_um / 20.0).clamp(-1.0, 1.0).asin()) / TAU - 0.5;
        let t = (2.0 * (row - row.floor()) - 0.5).clamp(0.0, 1.0);
        let turn = 0.5 * PI * t * t * (3.0 - 2.0 * t);
        // Each source has a weight, an absolute value, a phase and two positions.
        let mut sources = Vec::new();
        for (number, share) in [(row.floor(), turn.cos()), (row.floor() + 1.0, turn.sin())] {
            let number = number.rem_euclid(9.0) as u32;
            let key = mix32(mix32(place.ply ^ field.seed).wrapping_add(number.wrapping_mul(0x9e37_79b9)));
            let cell = f64::from(place.along_um) / 2.5 + f64::from(key >> 8) / f64::from(1 << 24);
            let window = |k: i64| (1.0 - ((k as f64 - cell) / 8.0).powi(2)).max(0.0).powi(3);
            let near = cell.floor() as i64 - 10..cell.floor() as i64 + 12;
            let all: f64 = near.clone().map(|k| window(k).powi(2)).sum();
            // Positions of the cells from their quantiles.
            let position = |table: &[f32; TABLE], shift: u32, root: f64, k: i64| {
                let step = (2f64.powi(32) / root).floor() as u32;
                let q = f64::from(mix32(key.wrapping_add(shift)).wrapping_add((k as u32).wrapping_mul(step)))
                    / 2f64.powi(32);
                let at = ((2.0 * q - 1.0).abs() * 512.0) as usize;
                f64::from(table[at.min(511)]).copysign(q - 0.5)
            };
            let plastic: f64 = 1.324_717_957_244_746;
            for k in near.filter(|k| window(*k) > 0.0) {
                let word = mix32(key ^ (k as u32).wrapping_mul(0x9e37_79b9)) >> (16 * kind);
                sources.push((
                    share * window(k) / all.sqrt(),
                    f64::from(field.size[(word & 511) as usize]),
                    TAU * f64::from(word >> 9 & 127) / 128.0,
                    position(&field.across_um[kind], 1 + kind as u32, plastic, k),
                    position(&field.along_um, 3, plastic * plastic, k),
                ));
            }
        }
        assert!((sources.iter().map(|s| s.0 * s.0).sum::<f64>() - 1.0).abs() < 1e-12);
        let g = |u: f64| {
            let wave = |(w, size, phase, x, z): &(f64, f64, f64, f64, f64)| {
                let (sin, cos) = (phase + TAU * (x * u + z * v) / lambda).sin_cos();
                [w * size * cos, w * size * sin]
            };
            sources.iter().map(wave).fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]])
        };
        let mut field_at = g(azimuth * cos);
        let t = (azimuth.abs() - PI + 0.15) / 0.15;
        if t > 0.0 {
            let turn = 0.25 * PI * t * t * (3.0 - 2.0 * t);
            let other = (azimuth - TAU * azimuth.signum()) * cos;
            let both: f64 =
                sources.iter().map(|s| s.0 * s.0 * (TAU * s.3 * (azimuth * cos - other) / lambda).cos()).sum();
            let power = 1.0 + (2.0 * turn).sin() * both;
            let over = g(other);
            field_at = [0, 1].map(|k| (turn.cos() * field_at[k] + turn.sin() * over[k]) / power.max(1e-3).sqrt());
        }
        let b = spectrum().share[kind];
        let n = ((1.0 - b).sqrt() + b.sqrt() * field_at[0]).powi(2) + b * field_at[1].powi(2);
        let [at_0, slope] = spectrum().fade[kind];
        1.0 + (at_0 + slope * lambda).clamp(0.0, 1.0) * (n - 1.0)
    }

    /// The vectorized evaluation agrees with the sum over sources, at the seams too.
    #[test]
    fn factors_are_the_sum_over_sources() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let (field, lambda) = (field(), [0.38, 0.45, 0.55, 0.62, 0.78]);
        let (mut seams, mut worst) = (0, 0.0f64);
        for i in 0..5000 {
            let mut phi = std::f32::consts::TAU * rng.random::<f32>();
            if i % 4 == 0 {
                phi = std::f32::consts::PI * (0.5 + (i / 4 % 2) as f32) + 0.3 * (rng.random::<f32>() - 0.5);
                seams += 1;
            }
            let wo = direction((2.0 * rng.random::<f32>() - 1.0).asin(), phi);
            let theta_i = 3.0 * (rng.random::<f32>() - 0.5);
            let h_um = 36.0 * (rng.random::<f32>() - 0.5);
            let place = PlyPlace::new(i, 12.0 * (rng.random::<f32>() - 0.5), 200.0 * (rng.random::<f32>() - 0.5));
            let (refl, high) = field.factors(&place, h_um, theta_i, wo, lambda);
            for (kind, got) in [refl, high].into_iter().enumerate() {
                for k in 0..lambda.len() {
                    let h = f64::from(h_um);
                    let want = reference(&field, &place, h, f64::from(theta_i), wo, f64::from(lambda[k]), kind);
                    let off = (f64::from(got[k]) - want).abs() / (1.0 + want);
                    worst = worst.max(off);
                    // The tolerance covers phases of a hundred turns in f32, and rows near the rim.
                    assert!(off < 2e-3, "kind {kind}, {wo:?}, {place:?} {h_um}: got {}, want {want}", got[k]);
                }
            }
        }
        println!("{worst:.1e} at most");
        assert!(seams > 1000);
    }

    /// No file contains these tables, so they must never change, on any machine or in any version.
    #[test]
    fn tables_are_the_same_everywhere() {
        let field = field();
        let all = [&field.size, &field.along_um, &field.across_um[0], &field.across_um[1]];
        let bytes: Vec<u8> = all.iter().flat_map(|t| t.iter()).flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!((Fnv64::new().with(&bytes).hex().as_str(), field.seed), ("b5a06b990cce35c0", 1_548_080_446));
        // Complex normal numbers of <|c|^2> = 1, and normal numbers of the standard deviation w0 / 2.
        let mean =
            |t: &[f32; TABLE], power: i32| t.iter().map(|x| f64::from(*x).powi(power)).sum::<f64>() / TABLE as f64;
        assert!((mean(&field.size, 2) - 1.0).abs() < 1e-6 && (mean(&field.size, 4) / 2.0 - 1.0).abs() < 0.02);
        assert!((mean(&field.along_um, 2) / 25.0 - 1.0).abs() < 1e-6);
        assert!((mean(&field.along_um, 4) / (3.0 * 625.0) - 1.0).abs() < 0.03);
    }

    /// A share of 0 and a single position need no special case.
    #[test]
    fn spectra_at_their_borders_make_fields() {
        let mut line = NoiseSpectrum { share: [0.0, 1.0], fade: [[1.0, 0.0]; 2], ..spectrum() };
        line.spectrum = vec![1.0, 0.0, 0.0, 0.5];
        for w0_um in [1e-9, 4000.0] {
            line.w0_um = w0_um;
            line.check(&crate::io::Check("line")).unwrap();
            let field = line.field(FibersAround { count: 1.0, ring_um: 1e-3 });
            for i in 0..1000 {
                let wo = direction(1.5 - 0.003 * i as f32, 0.1 * i as f32);
                let (refl, high) = field.factors(&PlyPlace::new(i, 0.01 * i as f32, 1e3), 5.0, 1e30, wo, [1e-6, 0.5]);
                assert!(refl.iter().all(|n| (n - 1.0).abs() < 1e-6), "{refl:?}");
                assert!(high.iter().all(|n| (0.0..40.0).contains(n)), "{high:?}");
            }
        }
    }
}
