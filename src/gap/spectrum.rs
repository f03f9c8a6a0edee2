//! The spectrum of a beam between two edges, tabulated for sampling: the mass beyond a frequency, and its
//! inverse.
//!
//! The spectrum `|k(f)|^2` is even in f and, beyond its central lobes, falls as 1/f^2, modulated by the
//! interference of the two edges. With `t = |f| / (|f| + g)`, where g is the inverse of the passing width, 64
//! cells uniform in t cover all frequencies: the density per t is bounded, the central lobes are resolved,
//! and a far cell contains many fringes, represented by their mean. Within a cell the tabulated density is
//! uniform in t.

use super::spectra;
use crate::math::faddeeva::Factor;

/// Number of cells of t in [0, 1).
pub(crate) const CELLS: usize = 64;
/// Points and weights of the 8-point Gauss-Legendre rule on [0, 1].
const GAUSS: [[(f32, f32); 4]; 2] = [
    [
        (0.019_855_07, 0.050_614_268),
        (0.101_666_76, 0.111_190_52),
        (0.237_233_8, 0.156_853_32),
        (0.408_282_68, 0.181_341_89),
    ],
    [
        (0.591_717_3, 0.181_341_89),
        (0.762_766_2, 0.156_853_32),
        (0.898_333_25, 0.111_190_52),
        (0.980_144_9, 0.050_614_268),
    ],
];
/// Number of fringes in a cell above which their mean replaces the spectrum.
const FRINGES: f32 = 2.0;
/// Smallest mass of a range that is sampled from the table; below it f is uniform.
const MIN_MASS: f32 = 1e-12;

/// The spectrum of one axis of an aperture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spectrum {
    pub(crate) factor: Factor,
    /// Scale g of f in t [1/um].
    g_per_um: f32,
    /// Mass beyond the borders of the cells, for both signs of f together: 1 at t = 0, 0 at t = 1.
    beyond: [f32; CELLS + 1],
    /// Fourth power of the mean of `sqrt(|f|)` [1/um^2].
    pub(super) root_mean_4: f32,
    /// Twice the standard deviation of the frequencies of the beam without an aperture, `1/(pi w0)` [1/um].
    pub(super) beam_spread: f32,
}

/// The spectrum of one axis of an aperture at a query. Its value is exact. Masses and samples come from a
/// table of the same or of similar edges, whose frequencies are stretched by the ratio of the powers on the
/// two apertures: the ratio of their widths if they are narrow, saturating for apertures wider than the beam.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis<'a> {
    near: &'a Spectrum,
    pub(crate) factor: Factor,
    /// Factor from frequencies to those of the table.
    stretch: f32,
}

impl<'a> Axis<'a> {
    /// The axis for the table's own edges.
    #[inline(always)]
    pub(crate) fn new(table: &'a Spectrum) -> Axis<'a> {
        Axis { near: table, factor: table.factor, stretch: 1.0 }
    }

    /// The axis for edges this far below and above the beam's center [um], from a table of similar edges.
    #[inline(always)]
    pub(crate) fn near(table: &'a Spectrum, before_um: f32, beyond_um: f32) -> Axis<'a> {
        let factor = Factor::about(before_um, beyond_um, table.factor.w0_um());
        Axis { near: table, factor, stretch: factor.power_over(&table.factor) }
    }

    /// Whether any light passes.
    pub(crate) fn passes(&self) -> bool {
        self.near.passes() && self.factor.passes()
    }

    /// The tabulated spectrum.
    pub(super) fn table(&self) -> &'a Spectrum {
        self.near
    }

    /// The range of frequencies between `low` and `high` [1/um].
    #[inline(always)]
    pub(super) fn range(&self, low: f32, high: f32) -> Range {
        self.near.range(low * self.stretch, high * self.stretch)
    }

    /// Density [um] with which [`Axis::sample`] returns `f` in `range`.
    #[inline(always)]
    pub(super) fn pdf(&self, range: &Range, f: f32) -> f32 {
        self.near.pdf(range, f * self.stretch) * self.stretch
    }

    /// Samples a frequency in `range` [1/um], by a number in [0, 1).
    #[inline(always)]
    pub(super) fn sample(&self, range: &Range, u: f32) -> f32 {
        self.near.sample(range, u) / self.stretch
    }
}

/// Frequencies from `low` to `high` [1/um], and the share of the spectrum in that range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    low: f32,
    high: f32,
    beyond_low: f32,
    beyond_high: f32,
    /// Share of the spectrum within the range.
    pub(crate) mass: f32,
}

impl Range {
    const NONE: Range = Range { low: 0.0, high: 0.0, beyond_low: 1.0, beyond_high: 1.0, mass: 0.0 };
}

impl Spectrum {
    /// The spectrum for edges a <= b [um] in a beam of waist w0 [um].
    pub(crate) fn new(a_um: f64, b_um: f64, w0_um: f64) -> Spectrum {
        let factor = Factor::new(a_um, b_um, w0_um);
        let width = (b_um - a_um).max(1e-6 * w0_um);
        let g = (1.0 / width).max(0.25 / w0_um) as f32;
        let mut mass = [0.0f64; CELLS];
        for (i, mass) in mass.iter_mut().enumerate() {
            let (t0, t1) = (i as f32 / CELLS as f32, (i + 1) as f32 / CELLS as f32);
            let (f0, f1) = (g * t0 / (1.0 - t0), g * t1 / (1.0 - t1));
            if i + 1 == CELLS {
                // Beyond the last border the spectrum falls as 1/f^2, so its integral is f0 times its value
                // at f0.
                *mass = f64::from(factor.smooth_spectrum(f0) * f0);
                continue;
            }
            let f = GAUSS.map(|half| half.map(|(x, _)| f0 + x * (f1 - f0)));
            let value = if (f1 - f0) * width as f32 > FRINGES {
                f.map(|half| half.map(|f| factor.smooth_spectrum(f)))
            } else {
                spectra([&factor; 2], [&f[0], &f[1]])
            };
            let mean: f32 = value.iter().flatten().zip(GAUSS.iter().flatten()).map(|(v, (_, w))| v * w).sum();
            *mass = f64::from(mean * (f1 - f0));
        }
        let total: f64 = mass.iter().sum();
        let mut beyond = [0.0; CELLS + 1];
        let mut root_mean = 0.0;
        if factor.passes() && total > 0.0 {
            let mut sum = 0.0;
            // The integral over t of sqrt(f/g) = sqrt(t/(1 - t)).
            let roots = |i: usize| {
                let t = i as f64 / CELLS as f64;
                t.sqrt().asin() - (t * (1.0 - t)).sqrt()
            };
            for i in (0..CELLS).rev() {
                sum += mass[i] / total;
                beyond[i] = sum as f32;
                root_mean += mass[i] / total * CELLS as f64 * (roots(i + 1) - roots(i));
            }
        }
        let root_mean_4 = (f64::from(g) * root_mean * root_mean).powi(2) as f32;
        let beam_spread = (1.0 / (std::f64::consts::PI * w0_um)) as f32;
        Spectrum { factor, g_per_um: g, beyond, root_mean_4, beam_spread }
    }

    /// The factor's eight numbers, g [1/um] and the masses beyond the borders of the cells, for hosts that
    /// evaluate the spectrum themselves.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = f32> {
        self.factor.numbers().into_iter().chain([self.g_per_um]).chain(self.beyond)
    }

    /// Whether any light passes.
    pub(crate) fn passes(&self) -> bool {
        self.beyond[0] > 0.0
    }

    /// Cell of `f` >= 0, and the fraction of the cell below it.
    #[inline(always)]
    fn place(&self, f: f32) -> (usize, f32) {
        let t = CELLS as f32 * (f / (f + self.g_per_um));
        // NaN becomes 0.
        let i = (t as usize).min(CELLS - 1);
        (i, (t - i as f32).clamp(0.0, 1.0))
    }

    /// Mass beyond `f` >= 0, for both signs together.
    #[inline(always)]
    fn beyond(&self, f: f32) -> f32 {
        let (i, x) = self.place(f);
        self.beyond[i] + x * (self.beyond[i + 1] - self.beyond[i])
    }

    /// Tabulated density at `f` [um].
    #[inline(always)]
    fn density(&self, f: f32) -> f32 {
        let (i, _) = self.place(f.abs());
        let stretch = f.abs() + self.g_per_um;
        0.5 * CELLS as f32 * (self.beyond[i] - self.beyond[i + 1]) * self.g_per_um / (stretch * stretch)
    }

    /// The range of frequencies between `low` and `high` [1/um]; empty if they are not in order or NaN.
    #[inline(always)]
    pub(crate) fn range(&self, low: f32, high: f32) -> Range {
        if low >= high || low.is_nan() || high.is_nan() {
            return Range::NONE;
        }
        let (beyond_low, beyond_high) = (self.beyond(low.abs()), self.beyond(high.abs()));
        let mass = if low < 0.0 && high > 0.0 {
            1.0 - 0.5 * (beyond_low + beyond_high)
        } else {
            0.5 * (beyond_low - beyond_high).abs()
        };
        Range { low, high, beyond_low, beyond_high, mass }
    }

    /// Density [um] with which [`Spectrum::sample`] returns `f` in `range`.
    #[inline(always)]
    pub(crate) fn pdf(&self, range: &Range, f: f32) -> f32 {
        if range.mass > MIN_MASS {
            self.density(f) / range.mass
        } else if range.low < range.high {
            1.0 / (range.high - range.low)
        } else {
            0.0
        }
    }

    /// Samples a frequency in `range` [1/um], by a number in [0, 1).
    #[inline(always)]
    pub(crate) fn sample(&self, range: &Range, u: f32) -> f32 {
        let r = range;
        if r.mass <= MIN_MASS {
            return r.low + u * (r.high - r.low);
        }
        let (sign, beyond) = if r.low < 0.0 && r.high > 0.0 {
            let negative = 0.5 * (1.0 - r.beyond_low);
            let at = u * r.mass;
            if at < negative {
                (-1.0, (1.0 - 2.0 * at).max(r.beyond_low))
            } else {
                (1.0, (1.0 - 2.0 * (at - negative)).max(r.beyond_high))
            }
        } else {
            let sign = if r.low < 0.0 { -1.0 } else { 1.0 };
            (sign, r.beyond_low + u * (r.beyond_high - r.beyond_low))
        };
        (sign * self.inverse(beyond)).clamp(r.low, r.high)
    }

    /// The frequency beyond which the mass is `beyond` [1/um].
    #[inline(always)]
    fn inverse(&self, beyond: f32) -> f32 {
        let mut i = 0;
        let mut step = CELLS / 2;
        while step > 0 {
            if self.beyond[i + step] >= beyond {
                i += step;
            }
            step /= 2;
        }
        let mass = self.beyond[i] - self.beyond[i + 1];
        let x = if mass > 0.0 { ((self.beyond[i] - beyond) / mass).clamp(0.0, 1.0) } else { 0.5 };
        let t = ((i as f32 + x) / CELLS as f32).min(1.0 - f32::EPSILON);
        self.g_per_um * t / (1.0 - t)
    }

    /// Calls `each(low, high, mass)` for the cells of both signs, clipped to `[low, high]`.
    pub(super) fn for_cells(&self, low: f32, high: f32, mut each: impl FnMut(f32, f32, f32)) {
        let border = |i: usize| {
            let t = i as f32 / CELLS as f32;
            if i < CELLS { self.g_per_um * t / (1.0 - t) } else { f32::MAX }
        };
        for i in 0..CELLS {
            for (a, b) in [(-border(i + 1), -border(i)), (border(i), border(i + 1))] {
                let r = self.range(a.max(low), b.min(high));
                if r.mass > 0.0 {
                    each(r.low, r.high, r.mass);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::faddeeva::diffraction_factor;

    const W0: f64 = 10.0;
    const EDGES: [[f64; 2]; 6] = [[-20.0, 20.0], [-1.0, 1.0], [-2.0, 17.0], [3.0, 20.0], [-5.0, 5.0], [-12.0, -11.5]];

    /// The raw masses of the cells sum to 1 (Parseval), and each is the integral of the exact spectrum.
    #[test]
    fn masses_are_integrals_of_the_spectrum() {
        for [a, b] in EDGES {
            let s = Spectrum::new(a, b, W0);
            let power = crate::math::faddeeva::power_between(a, b, W0);
            let spectrum = |f: f64| {
                let k = diffraction_factor(a, b, f, W0);
                (k[0] * k[0] + k[1] * k[1]) / power
            };
            let mut sum = 0.0;
            for i in [0, 3, 10, 25, 40, 55, 61] {
                let f = |i: usize| f64::from(s.g_per_um) * i as f64 / (CELLS - i) as f64;
                let (f0, f1) = (f(i), f(i + 1));
                let n = 20 + (40.0 * (f1 - f0) * (b - a)) as usize;
                let step = (f1 - f0) / n as f64;
                let want: f64 = (0..n).map(|j| spectrum(f0 + (j as f64 + 0.5) * step)).sum::<f64>() * step;
                let got = f64::from(0.5 * (s.beyond[i] - s.beyond[i + 1]));
                assert!((got - want).abs() < 2e-4, "cell {i} of [{a}, {b}]: got {got}, want {want}");
                sum += got;
            }
            assert!(sum > 0.05, "the cells tested hold {sum}");
        }
    }

    #[test]
    fn inverse_inverts() {
        for [a, b] in EDGES {
            let s = Spectrum::new(a, b, W0);
            for (low, high) in [(-1.0, 3.0), (0.01, 0.2), (-2.0, -0.005), (-1e-3, 1e-3)] {
                let r = s.range(low, high);
                let n = 2000;
                let mut last = f32::NEG_INFINITY;
                let mut share = 0.0;
                for i in 0..n {
                    let f = s.sample(&r, (i as f32 + 0.5) / n as f32);
                    assert!(f >= low && f <= high, "{f} not in [{low}, {high}]");
                    assert!(s.pdf(&r, f) > 0.0);
                    share += f32::from(f > 0.5 * (low + high)) / n as f32;
                    last = last.max(f);
                }
                let want = s.range(0.5 * (low + high), high).mass / r.mass;
                assert!((share - want).abs() < 2.0 / n as f32, "[{a}, {b}] {low} {high}: got {share}, want {want}");
            }
        }
    }
}
