//! Exit positions: the distance from the ply's axis at which an exiting line passes it.
//!
//! Yu 2025, 5.3, lets light exit uniformly over the ply's width. The simulation records, for each azimuth
//! (`table::ExitPositions`), the exit position t from -1 to 1 in units of R: light that passed through little
//! material exits near its entry point. The mean of t is a polynomial of the azimuth,
//! `t = c . (1, x, y, x y, x^2 - y^2)`, where (x, y) is the unit vector of the direction's azimuth in the ply
//! frame. Light that exits around a point P of the ply's cross section, in units of R, has
//! `t = x P_y - y P_x`.
//!
//! There are three such polynomials: for single reflection, for other light of clear fibers, and for other
//! light of dark fibers. Other light at absorption sigma mixes the last two with the weights
//! `v = 1 / (1 + sigma L)` and 1 - v, where L = [`EXIT_LENGTH_UM`]. About the mean, light has the density of
//! [`ExitShape`], whose length is the lateral spread. Clear fibers spread light over the ply. Metal wires,
//! whose first reflection is part of f_high as well, scatter it next to its entry point.

use super::drift::ExitDrift;
use crate::Result;
use crate::io::{Check, Reader, Writer};
use crate::math::simd::{exp2, max, min, signed, sin_cos_half_turns};
use std::sync::LazyLock;

/// Names of the tensors in a model file.
pub(crate) const NAMES: [&str; 2] = ["exit_offset", "exit_length"];
/// Kinds of light: single reflection, other light of clear fibers, other light of dark fibers.
pub const EXIT_KINDS: usize = 3;
/// Number of terms of the polynomial of the azimuth.
pub const EXIT_TERMS: usize = 5;
/// Length L of the dependence on absorption [um], a path through a ply.
pub const EXIT_LENGTH_UM: f64 = 150.0;
/// Maximum coefficient in a file.
const MAX: f64 = 100.0;
/// Lengths of the kinds' densities, in units of R, for models without stored lengths. They are close to the
/// best fit to the cumulative shares that simulations of polyester, silk, cotton and wool record.
pub const USUAL_EXIT_LENGTHS: [f64; EXIT_KINDS] = [0.13, 0.65, 0.18];
/// Minimum and maximum length.
pub const EXIT_LENGTHS: [f64; 2] = [0.02, 4.0];

/// Exit offsets of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct ExitOffsets {
    /// `[M][H][EXIT_KINDS][EXIT_TERMS]`: coefficients of the mean, in units of R, at the nodes of the lobes.
    pub mean: Vec<f64>,
    /// Lengths of the densities about the mean, in units of R, within [`EXIT_LENGTHS`].
    pub length: [f64; EXIT_KINDS],
    /// Displacements along the axis.
    pub drift: ExitDrift,
}

/// Terms of the polynomial at an azimuth with the cosine x and the sine y.
#[inline(always)]
pub fn exit_terms(x: f32, y: f32) -> [f32; EXIT_TERMS] {
    [1.0, x, y, x * y, x * x - y * y]
}

impl ExitOffsets {
    pub(crate) fn write(&self, w: &mut Writer, (m, h, k): (usize, usize, usize)) {
        w.f32(NAMES[0], &[m, h, EXIT_KINDS, EXIT_TERMS], self.mean.iter().map(|v| *v as f32));
        w.f32(NAMES[1], &[EXIT_KINDS], self.length.iter().map(|v| *v as f32));
        self.drift.write(w, m, k);
    }

    pub(crate) fn read(r: &Reader<'_>, (m, h, k): (usize, usize, usize)) -> Result<Option<ExitOffsets>> {
        if !r.has(NAMES[0]) {
            return Ok(None);
        }
        let mut length = [0.0; EXIT_KINDS];
        length.copy_from_slice(&r.f64(NAMES[1], &[EXIT_KINDS])?);
        let mean = r.f64(NAMES[0], &[m, h, EXIT_KINDS, EXIT_TERMS])?;
        Ok(Some(ExitOffsets { mean, length, drift: ExitDrift::read(r, m, k)? }))
    }

    pub(crate) fn check(&self, c: &Check<'_>, (m, h, k): (usize, usize, usize)) -> Result<()> {
        c.len(NAMES[0], self.mean.len(), &[m, h, EXIT_KINDS, EXIT_TERMS])?;
        c.range(NAMES[0], &self.mean, -MAX, MAX)?;
        c.range(NAMES[1], &self.length, EXIT_LENGTHS[0], EXIT_LENGTHS[1])?;
        self.drift.check(c, m, k)
    }
}

type Coefficients = [[f32; EXIT_TERMS]; EXIT_KINDS];

/// Exit offsets laid out for evaluation.
#[derive(Clone, Debug)]
pub(crate) struct ExitTables {
    rows: usize,
    columns: usize,
    per_theta: f32,
    per_h: f32,
    h_first: f32,
    mean: Vec<Coefficients>,
    pub(crate) shapes: [ExitShape; EXIT_KINDS],
}

impl ExitTables {
    /// Lays out the offsets of a model with these axes.
    pub(crate) fn new(exits: &ExitOffsets, theta_i: &[f64], h_um: &[f64]) -> ExitTables {
        let (rows, columns) = (theta_i.len(), h_um.len());
        let of = |at: usize| std::array::from_fn(|i| exits.mean[at * EXIT_TERMS + i] as f32);
        ExitTables {
            rows,
            columns,
            per_theta: ((rows - 1) as f64 / theta_i[rows - 1]) as f32,
            per_h: ((columns - 1) as f64 / (h_um[columns - 1] - h_um[0])) as f32,
            h_first: h_um[0] as f32,
            mean: (0..rows * columns).map(|node| std::array::from_fn(|k| of(EXIT_KINDS * node + k))).collect(),
            shapes: exits.length.map(ExitShape::new),
        }
    }

    /// Offsets at an incidence, bilinear between the nodes. A negative latitude is evaluated for the ply
    /// rotated about y.
    #[inline(always)]
    pub(crate) fn at(&self, theta_i: f32, h_um: f32) -> ExitsAt {
        let (theta, h) = (theta_i.abs(), if theta_i < 0.0 { -h_um } else { h_um });
        let place = |x: f32, count: usize| {
            let x = crate::math::simd::min(crate::math::simd::max(x, 0.0), (count - 1) as f32);
            let node = (x as usize).min(count - 2);
            (node, x - node as f32)
        };
        let (m, s) = place(theta * self.per_theta, self.rows);
        let (n, t) = place((h - self.h_first) * self.per_h, self.columns);
        let mut mean = [[0.0; EXIT_TERMS]; EXIT_KINDS];
        for (node, weight) in [
            (m * self.columns + n, (1.0 - s) * (1.0 - t)),
            (m * self.columns + n + 1, (1.0 - s) * t),
            ((m + 1) * self.columns + n, s * (1.0 - t)),
            ((m + 1) * self.columns + n + 1, s * t),
        ] {
            let of = &self.mean[node];
            for k in 0..EXIT_KINDS {
                for i in 0..EXIT_TERMS {
                    mean[k][i] += weight * of[k][i];
                }
            }
        }
        if theta_i < 0.0 {
            // The rotation maps x to -x and t to -t.
            for c in &mut mean {
                *c = [-c[0], c[1], -c[2], c[3], -c[4]];
            }
        }
        ExitsAt { mean, tan: tan(theta_i) }
    }
}

/// Maximum tangent of a latitude, for light almost along a ply.
const MAX_TAN: f32 = 6.0;

#[inline(always)]
fn tan(theta: f32) -> f32 {
    let (sin, cos, sign) = sin_cos_half_turns::<false>(std::f32::consts::FRAC_1_PI * theta);
    signed(sin, sign) / max(signed(cos, sign), 1.0 / MAX_TAN)
}

/// Where light exits, in units of R. Its line is nearest to the ply's axis at a point `s` further along z
/// than that of the incident line.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExitLine {
    /// Distance along z.
    pub s: f32,
    /// Mean offset t of lines of this kind from the axis, along `z cross w`.
    pub mean: f32,
}

/// Exit offsets at an incidence.
#[derive(Clone, Copy, Debug)]
pub struct ExitsAt {
    mean: Coefficients,
    /// Tangent of the latitude.
    tan: f32,
}

impl ExitsAt {
    /// Offsets for models that do not store them. Single reflection exits from the ply's wall where a line at
    /// the offset `h`, in units of R, enters it; other light exits from anywhere.
    pub(crate) fn unknown(theta_i: f32, h: f32) -> ExitsAt {
        let h = h.clamp(-1.0, 1.0);
        let mut mean = [[0.0; EXIT_TERMS]; EXIT_KINDS];
        mean[0] = [0.0, (1.0 - h * h).sqrt(), -h, 0.0, 0.0];
        ExitsAt { mean, tan: tan(theta_i) }
    }

    /// Mean lines of the three kinds of light in a direction of the ply frame.
    ///
    /// The point P at which the light is scattered lies on the incident line, so `P_z = P_y tan theta_i`. The
    /// exit line is nearest to the axis at `s = P_z - (P_x x + P_y y) tan theta_o`. How far fibers carry
    /// light along the ply ([`ExitDrift`]) is left to those who follow it from ply to ply.
    #[inline(always)]
    pub fn lines(&self, wo: [f32; 3]) -> [ExitLine; EXIT_KINDS] {
        let squared = wo[0] * wo[0] + wo[1] * wo[1];
        let per = if squared > 1e-8 { 1.0 / squared.sqrt() } else { 0.0 };
        let (x, y) = (wo[0] * per, wo[1] * per);
        let terms = exit_terms(x, y);
        let tan = (wo[2] * per).clamp(-MAX_TAN, MAX_TAN);
        // A loop, because the compiler does not inline a closure of `from_fn`.
        let mut lines = [ExitLine::default(); EXIT_KINDS];
        for (kind, line) in lines.iter_mut().enumerate() {
            let c = &self.mean[kind];
            let mut sum = 0.0;
            for i in 0..EXIT_TERMS {
                sum += c[i] * terms[i];
            }
            let ([px, py], t) = ([-c[2], c[1]], min(max(sum, -1.0), 1.0));
            let s = py * self.tan - (px * x + py * y) * tan;
            *line = ExitLine { s, mean: t };
        }
        lines
    }

    /// Weight v of the kind of clear fibers.
    #[inline(always)]
    pub fn clear_share(sigma_per_um: f32) -> f32 {
        1.0 / (1.0 + EXIT_LENGTH_UM as f32 * sigma_per_um.clamp(0.0, 1e6))
    }
}

/// Number of tabulated means of a shape, from 0 to the maximum.
const MEANS: usize = 65;
const MAX_MEAN: f32 = 0.97;

/// Densities of one length: the distribution of a kind of light across a ply at its exit, by its mean offset.
/// Over the offsets t, from -1 to 1, the density decreases exponentially on both sides of a mode: it is
/// `exp(-|t - mode| / length)` divided by its integral (docs/explain/cloth_model.md, Where light leaves a
/// ply).
#[derive(Clone, Debug)]
pub struct ExitShape {
    /// Mode and length at the tabulated means, both in units of R.
    nodes: [[f32; 2]; MEANS],
    /// Shares of the light at the offsets across the ply, at means from the minimum to the maximum.
    shares: Vec<OffsetShares>,
}

/// Number of equal parts of a ply's width for which shares of light are tabulated.
pub const EXIT_OFFSETS: usize = 7;
/// Shares of light at these parts, from the offset 1 to -1, padded with a zero.
pub type OffsetShares = [f32; EXIT_OFFSETS + 1];
/// Number of means at which they are tabulated.
const SHARES: usize = 257;

impl ExitShape {
    /// The shape of a length in units of R, within [`EXIT_LENGTHS`].
    pub fn new(length: f64) -> ExitShape {
        let mean = |i: usize| f64::from(MAX_MEAN) * i as f64 / (MEANS - 1) as f64;
        let nodes = std::array::from_fn(|i| shape(mean(i), length).map(|v| v as f32));
        let mut shape = ExitShape { nodes, shares: Vec::new() };
        let shares = |i: usize| {
            let density = shape.density(MAX_MEAN * (2.0 * i as f32 / (SHARES - 1) as f32 - 1.0));
            let below = |o: usize| match o {
                0 => 1.0,
                EXIT_OFFSETS => 0.0,
                _ => density.below(1.0 - 2.0 * o as f32 / EXIT_OFFSETS as f32),
            };
            let mut shares = [0.0; EXIT_OFFSETS + 1];
            (0..EXIT_OFFSETS).for_each(|o| shares[o] = below(o) - below(o + 1));
            shares
        };
        shape.shares = (0..SHARES).map(shares).collect();
        shape
    }

    /// Shares of the light at the offsets across the ply, for a mean offset in units of R.
    #[inline(always)]
    pub(crate) fn at_offsets(&self, mean: f32) -> OffsetShares {
        const PER: f32 = 0.5 * (SHARES - 1) as f32 / MAX_MEAN;
        let x = (min(max(mean, -MAX_MEAN), MAX_MEAN) + MAX_MEAN) * PER;
        let node = (x as usize).min(SHARES - 2);
        let (mut shares, s) = ([0.0; EXIT_OFFSETS + 1], x - node as f32);
        if let Some([low, high]) = self.shares.get(node..).and_then(|rows| rows.first_chunk::<2>()) {
            for o in 0..=EXIT_OFFSETS {
                shares[o] = low[o] + s * (high[o] - low[o]);
            }
        }
        shares
    }

    /// Shapes of the [usual lengths](USUAL_EXIT_LENGTHS).
    pub(crate) fn usual() -> &'static [ExitShape; EXIT_KINDS] {
        static SHAPES: LazyLock<[ExitShape; EXIT_KINDS]> = LazyLock::new(|| USUAL_EXIT_LENGTHS.map(ExitShape::new));
        &SHAPES
    }

    /// The share of light that exits a ply at offsets below `t`, in units of R from -1 to 1, for a kind whose
    /// mean offset is `mean` ([`ExitOffsets`]).
    pub fn share_below(&self, mean: f32, t: f32) -> f32 {
        self.density(mean).below(t)
    }

    /// The density with this mean.
    #[inline]
    pub fn density(&self, mean: f32) -> ExitDensity {
        const PER: f32 = (MEANS - 1) as f32 / MAX_MEAN;
        let x = min(mean.abs(), MAX_MEAN) * PER;
        let node = (x as usize).min(MEANS - 2);
        let [a, b] = [self.nodes[node], self.nodes[node + 1]];
        let s = x - node as f32;
        let (mode, length) = ((a[0] + s * (b[0] - a[0])).copysign(mean), a[1] + s * (b[1] - a[1]));
        let per = std::f32::consts::LOG2_E / length;
        let (tail, other) = (exp2::<false>((-1.0 - mode) * per), exp2::<false>((mode - 1.0) * per));
        ExitDensity { mode, per, tail, per_all: 1.0 / (2.0 - tail - other) }
    }

    /// The table of mode and length by the mean, and its shape `[MEANS][2]`.
    pub(crate) fn numbers(&self) -> (&[f32], [usize; 2]) {
        (self.nodes.as_flattened(), [MEANS, 2])
    }
}

/// Mean of the density with this mode and length.
fn mean_of(mode: f64, length: f64) -> f64 {
    // For each side of the mode, of this width: its energy, and its first moment about the mode, in units of
    // the length.
    let [below, above] = [1.0 + mode, 1.0 - mode].map(|width| {
        let tail = (-width / length).exp();
        [1.0 - tail, length - (length + width) * tail]
    });
    mode + (above[1] - below[1]) / (below[0] + above[0])
}

/// Mode and length of the density with a mean of 0 or more. If the mean is too near to the rim for the kind's
/// length, the mode is at the rim and the length is shorter.
fn shape(mean: f64, length: f64) -> [f64; 2] {
    let is_short = mean_of(1.0, length) < mean;
    let (mut low, mut high) = if is_short { (1e-3, length) } else { (0.0, 1.0) };
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let is_beyond = if is_short { mean_of(1.0, middle) < mean } else { mean_of(middle, length) > mean };
        *(if is_beyond { &mut high } else { &mut low }) = middle;
    }
    if is_short { [1.0, low] } else { [low, length] }
}

/// The density of an [`ExitShape`] with one mean.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExitDensity {
    mode: f32,
    /// log2(e) divided by the length.
    per: f32,
    /// The density at the lower rim relative to that at the mode.
    tail: f32,
    /// The reciprocal of the integral, in lengths.
    per_all: f32,
}

impl ExitDensity {
    /// The share that exits at offsets below `t`.
    #[inline]
    pub(crate) fn below(&self, t: f32) -> f32 {
        let t = max(min(t, 1.0), -1.0) - self.mode;
        let e = exp2::<false>(-t.abs() * self.per);
        (if t < 0.0 { e } else { 2.0 - e } - self.tail) * self.per_all
    }

    /// The density at the offset `t`, which is in [-1, 1].
    pub fn at(&self, t: f32) -> f32 {
        exp2::<false>(-(t - self.mode).abs() * self.per) * self.per_all * self.per * std::f32::consts::LN_2
    }

    /// The offset below which the share `u` exits.
    pub fn draw(&self, u: f32) -> f32 {
        let e = u / self.per_all + self.tail;
        let t = if e < 1.0 { e.log2() } else { -(2.0 - e).max(f32::MIN_POSITIVE).log2() };
        (self.mode + t / self.per).clamp(-1.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The density has the requested mean and is the slope of its cumulative share, and samples follow it.
    #[test]
    fn densities_have_their_mean() {
        const STEPS: usize = 2000;
        for length in [0.05, 0.13, 0.18, 0.65, 4.0] {
            let shape = ExitShape::new(length);
            for mean in [-0.9f32, -0.43, -0.05, 0.0, 0.2, 0.38, 0.61, 0.83] {
                let density = shape.density(mean);
                let (mut all, mut moment, mut drawn) = (0.0f64, 0.0f64, 0.0f64);
                for i in 0..STEPS {
                    let t = (2 * i + 1) as f32 / STEPS as f32 - 1.0;
                    let share = f64::from(density.at(t)) * 2.0 / STEPS as f64;
                    all += share;
                    moment += share * f64::from(t);
                    assert!((f64::from(density.below(t)) - (all - 0.5 * share)).abs() < 2e-3);
                    let u = (i as f32 + 0.5) / STEPS as f32;
                    drawn += f64::from(density.draw(u)) / STEPS as f64;
                    assert!((density.below(density.draw(u)) - u).abs() < 1e-4);
                }
                assert!((all - 1.0).abs() < 1e-3, "{length} {mean}: {all}");
                for found in [moment / all, drawn] {
                    assert!((found - f64::from(mean)).abs() < 3e-3, "{length} {mean}: {found}");
                }
            }
        }
    }

    /// Tabulated shares are those of the density.
    #[test]
    fn shares_are_those_of_the_density() {
        for length in [EXIT_LENGTHS[0], 0.13, 0.65, EXIT_LENGTHS[1]] {
            let shape = ExitShape::new(length);
            let mut worst = 0.0f32;
            for i in 0..=4000 {
                let mean = i as f32 / 2000.0 - 1.0;
                let shares = shape.at_offsets(mean);
                assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{length}, {mean}: {shares:?}");
                for (o, share) in shares[..EXIT_OFFSETS].iter().enumerate() {
                    let edge = |o: usize| shape.share_below(mean, 1.0 - 2.0 * o as f32 / EXIT_OFFSETS as f32);
                    worst = worst.max((share - (edge(o) - edge(o + 1))).abs());
                }
            }
            println!("{length}: {worst:.1e}");
            assert!(worst < if length < 0.1 { 0.05 } else { 3e-3 }, "{length}: {worst}");
        }
    }

    /// A point of the cross section, seen from a rotated ply, is the rotated point.
    #[test]
    fn negative_latitudes_are_turned() {
        let node = |h: f32| -> Coefficients { [[0.1, 0.7, -h, 0.2, 0.05]; EXIT_KINDS] };
        let tables = ExitTables {
            rows: 2,
            columns: 3,
            per_theta: 1.0,
            per_h: 1.0,
            h_first: -1.0,
            mean: [-1.0, 0.0, 1.0, -1.0, 0.0, 1.0].map(node).to_vec(),
            shapes: USUAL_EXIT_LENGTHS.map(ExitShape::new),
        };
        for (h, w) in [(0.5, [0.6, 0.3, 0.2]), (-0.2, [-0.3, -0.8, 0.1f32])] {
            let one = tables.at(0.4, h).lines(w);
            let turned = tables.at(-0.4, -h).lines([-w[0], w[1], -w[2]]);
            for ((a, b), shape) in one.iter().zip(turned).zip(&tables.shapes) {
                assert!((a.s + b.s).abs() < 1e-6, "{a:?} {b:?}");
                for t in [-0.6, 0.1, 0.7] {
                    let all = shape.share_below(a.mean, t) + shape.share_below(b.mean, -t);
                    assert!((all - 1.0).abs() < 1e-5, "{a:?} {b:?}");
                }
            }
        }
    }
}
