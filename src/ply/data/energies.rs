//! Energies of a ply model between its nodes: splines over (theta_i, h) whose coefficients are stored in a
//! model file.
//!
//! Let m(x) be the probability that a line at lateral position x hits a fiber, and g the beam's profile. Then
//! `1 - r_d(h) = (m * g)(h)`, so energies vary over the beam's width, a few um, while lobes vary over the
//! ply's width. Energies therefore have their own grids. They are stored as two quantities:
//!
//! - the missed share `r_d`. Along theta_i it changes as fast as along h where light is parallel to the
//!   tilted fibers at the rim: at `tan(theta_i) = pitch / (2 pi h)` the rim of one side opens. Its grid is
//!   fine in both.
//! - the shares of the light that hits fibers: `q_refl`, and the path-length spectrum `q_high`. Scattering by
//!   a fiber depends little on where the beam hits it, so these are smooth. At sigma = 0 they sum to 1.
//!
//! The energies are `E_refl = (1 - r_d) q_refl` and `E_high = (1 - r_d) q_high`, so
//! `r_d + E_refl + E_high = 1` holds at every incidence.
//!
//! The splines are quadratic B-splines on the nodes of a uniform axis. At a distance f from the nearest node
//! i, with |f| <= 1/2 of a step, the value is
//! `(1/2 - f)^2 / 2 c[i-1] + (3/4 - f^2) c[i] + (1/2 + f)^2 / 2 c[i+1]`. The weights are 0 or more and sum to
//! 1, so values stay within the bounds of the coefficients, and sums of quantities are preserved. The slope
//! is continuous. For a profile blurred by a Gaussian of standard deviation s the error grows with the cube
//! of the step, `4 step^3 |f'''| / (2 pi)^3`: it is 8e-4 of an edge's height at a step of s/2, and 4e-4 at
//! 0.4 s.
//!
//! Beyond the ends the coefficients are extrapolated linearly, `c[-1] = 2 c[0] - c[1]`. At theta_i = 0 they
//! are mirrored, `c(-theta_i, h) = c(theta_i, -h)`.

use super::limits::ENERGY_TOLERANCE;
use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};

/// Maximum number of nodes of an axis.
const MAX_NODES: usize = 4095;

/// Coefficients of a model's energies. Arrays are flat, last index fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyEnergies {
    /// `[A]` latitudes of `miss` [rad], uniform from 0 to the model's last latitude.
    pub miss_theta_i: Vec<f64>,
    /// `[B]` offsets of `miss` [um], uniform over the model's range.
    pub miss_h_um: Vec<f64>,
    /// `[A][B]`: coefficients of r_d, in [0, 1].
    pub miss: Vec<f64>,
    /// `[P]` latitudes of the shares [rad], uniform from 0 to the model's last latitude.
    pub share_theta_i: Vec<f64>,
    /// `[Q]` offsets of the shares [um], uniform over the model's range.
    pub share_h_um: Vec<f64>,
    /// `[P][Q]`: coefficients of q_refl, >= 0.
    pub share_refl: Vec<f64>,
    /// `[P][Q][J]`: coefficients of the path-length spectrum of q_high, >= 0.
    pub share_high: Vec<f64>,
}

/// Energies at one incidence.
#[derive(Clone, Debug, PartialEq)]
pub struct EnergiesAt {
    /// Fraction of the beam that hits no fiber.
    pub r_d: f64,
    /// Energy of f_refl.
    pub refl: f64,
    /// `[J]`: path-length spectrum of the energy of f_high.
    pub high: Vec<f64>,
}

impl EnergiesAt {
    /// Energy of f_high at an absorption [1/um], for spectra over the path lengths `path_um`.
    pub fn high_at(&self, sigma_per_um: f64, path_um: &[f64]) -> f64 {
        self.high.iter().zip(path_um).map(|(e, l)| e * (-sigma_per_um * l).exp()).sum()
    }

    /// Entry `p` of the energies: f_refl for 0, else path length p - 1 of f_high.
    pub(in crate::ply) fn part(&self, p: usize) -> f64 {
        if p == 0 { self.refl } else { self.high[p - 1] }
    }
}

impl PlyEnergies {
    /// Energies at (theta_i, h) [rad, um]. Beyond the grid they are those at its end; theta_i < 0 is
    /// mirrored.
    pub fn at(&self, theta_i: f64, h_um: f64) -> EnergiesAt {
        let h_um = if theta_i < 0.0 { -h_um } else { h_um };
        let missed = Taps::new(&self.miss_theta_i, &self.miss_h_um, theta_i.abs(), h_um);
        let shares = Taps::new(&self.share_theta_i, &self.share_h_um, theta_i.abs(), h_um);
        let r_d = missed.value(&self.miss, 1, 0).clamp(0.0, 1.0);
        let spectrum = self.share_high.len() / self.share_refl.len().max(1);
        EnergiesAt {
            r_d,
            refl: (1.0 - r_d) * shares.value(&self.share_refl, 1, 0).max(0.0),
            high: (0..spectrum).map(|j| (1.0 - r_d) * shares.value(&self.share_high, spectrum, j).max(0.0)).collect(),
        }
    }
}

impl PlyEnergies {
    /// The energies with coefficients rounded to f32, as in files.
    pub(in crate::ply) fn rounded(&self) -> PlyEnergies {
        let round = |values: &[f64]| values.iter().map(|v| f64::from(*v as f32)).collect();
        PlyEnergies {
            miss: round(&self.miss),
            share_refl: round(&self.share_refl),
            share_high: round(&self.share_high),
            ..self.clone()
        }
    }

    /// Writes the tensors, with coefficients in f32; `j` is the number of path lengths.
    pub(in crate::ply) fn write(&self, w: &mut Writer, j: usize) {
        let (a, b) = (self.miss_theta_i.len(), self.miss_h_um.len());
        let (p, q) = (self.share_theta_i.len(), self.share_h_um.len());
        let singles = |values: &[f64]| values.iter().map(|v| *v as f32).collect::<Vec<_>>().into_iter();
        w.f64("miss_theta_i", &[a], &self.miss_theta_i);
        w.f64("miss_h_um", &[b], &self.miss_h_um);
        w.f32("miss", &[a, b], singles(&self.miss));
        w.f64("share_theta_i", &[p], &self.share_theta_i);
        w.f64("share_h_um", &[q], &self.share_h_um);
        w.f32("share_refl", &[p, q], singles(&self.share_refl));
        w.f32("share_high", &[p, q, j], singles(&self.share_high));
    }

    pub(in crate::ply) fn read(r: &Reader<'_>, j: usize) -> Result<PlyEnergies> {
        let size = |name: &str| r.shape(name, 1).map(|shape| shape[0]);
        let (a, b) = (size("miss_theta_i")?, size("miss_h_um")?);
        let (p, q) = (size("share_theta_i")?, size("share_h_um")?);
        Ok(PlyEnergies {
            miss_theta_i: r.f64("miss_theta_i", &[a])?,
            miss_h_um: r.f64("miss_h_um", &[b])?,
            miss: r.f64("miss", &[a, b])?,
            share_theta_i: r.f64("share_theta_i", &[p])?,
            share_h_um: r.f64("share_h_um", &[q])?,
            share_refl: r.f64("share_refl", &[p, q])?,
            share_high: r.f64("share_high", &[p, q, j])?,
        })
    }

    /// Checks the energies of a model whose nodes end at `last` (theta_i, h), with `j` path lengths.
    pub(in crate::ply) fn check(&self, c: &Check<'_>, last: [f64; 2], j: usize) -> Result<()> {
        let sizes = [
            [("miss_theta_i", &self.miss_theta_i), ("miss_h_um", &self.miss_h_um)],
            [("share_theta_i", &self.share_theta_i), ("share_h_um", &self.share_h_um)],
        ];
        for axes in sizes {
            for ((name, axis), last) in axes.into_iter().zip(last) {
                if !(2..=MAX_NODES).contains(&axis.len()) {
                    let hint = format!("expected 2 to {MAX_NODES}");
                    return Err(invalid(c.0, name, format!("{} values", axis.len()), &hint));
                }
                c.uniform(name, axis)?;
                let end = axis[axis.len() - 1];
                if (end - last).abs() > 1e-6 * last {
                    return Err(invalid(
                        c.0,
                        name,
                        end,
                        &format!("expected to end where the lobes' nodes do, at {last}"),
                    ));
                }
            }
            let ([(theta, t), (h, x)], end) = (axes, last[1]);
            for (name, first, want) in [(theta, t[0], 0.0), (h, x[0], -end)] {
                if (first - want).abs() > 1e-6 * end {
                    return Err(invalid(c.0, &format!("{name}[0]"), first, &format!("expected {want}")));
                }
            }
        }
        let [[a, b], [p, q]] = sizes.map(|axes| axes.map(|(_, axis)| axis.len()));
        for (name, values, shape, limit) in [
            ("miss", &self.miss, &[a, b][..], 1.0),
            ("share_refl", &self.share_refl, &[p, q], 1.0 + ENERGY_TOLERANCE),
            ("share_high", &self.share_high, &[p, q, j], 1.0 + ENERGY_TOLERANCE),
        ] {
            c.len(name, values.len(), shape)?;
            c.range(name, values, 0.0, limit)?;
        }
        for (i, (refl, high)) in self.share_refl.iter().zip(self.share_high.chunks_exact(j)).enumerate() {
            let sum = refl + high.iter().sum::<f64>();
            if sum > 1.0 + ENERGY_TOLERANCE {
                let key = format!("share_refl + share_high at node {i}");
                return Err(invalid(c.0, &key, sum, &format!("expected at most {}", 1.0 + ENERGY_TOLERANCE)));
            }
        }
        Ok(())
    }
}

/// The coefficients around a point, and their weights.
pub(in crate::ply) struct Taps {
    pub(in crate::ply) at: [usize; 2],
    pub(in crate::ply) weights: [[f64; 3]; 2],
    sizes: [usize; 2],
}

impl Taps {
    pub(in crate::ply) fn new(theta_i: &[f64], h_um: &[f64], t: f64, h: f64) -> Taps {
        let along = |axis: &[f64], x: f64| {
            let last = (axis.len() - 1) as f64;
            let t = ((x - axis[0]) / (axis[axis.len() - 1] - axis[0]) * last).max(0.0).min(last);
            let nearest = (t + 0.5).floor().min(last);
            (nearest as usize, weights(t - nearest))
        };
        let ((m, wm), (n, wn)) = (along(theta_i, t), along(h_um, h));
        Taps { at: [m, n], weights: [wm, wn], sizes: [theta_i.len(), h_um.len()] }
    }

    /// Interpolated entry `k` of arrays `[rows][columns][stride]`.
    pub(in crate::ply) fn value(&self, c: &[f64], stride: usize, k: usize) -> f64 {
        let mut sum = 0.0;
        for (a, wa) in self.weights[0].iter().enumerate() {
            for (b, wb) in self.weights[1].iter().enumerate() {
                let (m, n) = ((self.at[0] + a) as isize - 1, (self.at[1] + b) as isize - 1);
                sum += wa * wb * coefficient(self.sizes, m, n, &|m, n| c[(m * self.sizes[1] + n) * stride + k]);
            }
        }
        sum
    }
}

/// Weights of the nodes before, at and after the node nearest to a point, which is `f` steps beyond that
/// node.
fn weights(f: f64) -> [f64; 3] {
    [0.5 * (0.5 - f) * (0.5 - f), 0.75 - f * f, 0.5 * (0.5 + f) * (0.5 + f)]
}

/// Coefficient (m, n) of a grid, where m and n may be one before the first or one after the last (see the
/// module).
pub(in crate::ply) fn coefficient(
    [rows, columns]: [usize; 2],
    m: isize,
    n: isize,
    of: &dyn Fn(usize, usize) -> f64,
) -> f64 {
    let last = columns as isize - 1;
    if m < 0 {
        return coefficient([rows, columns], -m, last - n, of);
    }
    if m as usize >= rows {
        let at = |m: usize| coefficient([rows, columns], m as isize, n, of);
        return 2.0 * at(rows - 1) - at(rows - 2);
    }
    let m = m as usize;
    if n < 0 {
        2.0 * of(m, 0) - of(m, 1)
    } else if n > last {
        2.0 * of(m, columns - 1) - of(m, columns - 2)
    } else {
        of(m, n as usize)
    }
}

/// Coefficients of the spline that has `values[rows][columns]` at the nodes; both sizes are at least 2.
pub fn spline_coefficients(values: &[f64], rows: usize, columns: usize) -> Vec<f64> {
    let mut c: Vec<f64> = values.chunks_exact(columns).flat_map(|row| filtered(row, None)).collect();
    // Along theta_i the part that is even in h is mirrored at 0, and the odd part changes its sign.
    for n in 0..columns.div_ceil(2) {
        let other = columns - 1 - n;
        let column = |sign: f64| -> Vec<f64> {
            (0..rows).map(|m| 0.5 * (c[m * columns + n] + sign * c[m * columns + other])).collect()
        };
        let (even, odd) = (filtered(&column(1.0), Some(1.0)), filtered(&column(-1.0), Some(-1.0)));
        for m in 0..rows {
            (c[m * columns + n], c[m * columns + other]) = (even[m] + odd[m], even[m] - odd[m]);
        }
    }
    c
}

/// Solves `c[i-1] + 6 c[i] + c[i+1] = 8 v[i]` along one axis. The end coefficients are extrapolated linearly,
/// so they equal their values; at the first, `mirrored` instead sets `c[-1] = mirrored c[1]`.
fn filtered(v: &[f64], mirrored: Option<f64>) -> Vec<f64> {
    let last = v.len() - 1;
    let (first, next) = mirrored.map_or((8.0, 0.0), |sign| (6.0, 1.0 + sign));
    let (mut diagonal, mut c) = (vec![first], vec![8.0 * v[0]]);
    let mut above = next;
    for i in 1..=last {
        let (before, here, after) = if i == last { (0.0, 8.0, 0.0) } else { (1.0, 6.0, 1.0) };
        let ratio = before / diagonal[i - 1];
        diagonal.push(here - ratio * above);
        c.push(8.0 * v[i] - ratio * c[i - 1]);
        above = after;
    }
    c[last] /= diagonal[last];
    for i in (0..last).rev() {
        let after = if i == 0 { next } else { 1.0 };
        c[i] = (c[i] - after * c[i + 1]) / diagonal[i];
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(low: f64, high: f64, n: usize) -> Vec<f64> {
        (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect()
    }

    fn grid(rows: usize, columns: usize, f: impl Fn(f64, f64) -> f64) -> PlyEnergies {
        let (theta_i, h_um) = (axis(0.0, 1.4, rows), axis(-70.0, 70.0, columns));
        let values: Vec<f64> =
            theta_i.iter().flat_map(|t| h_um.iter().map(|h| f(*t, *h)).collect::<Vec<_>>()).collect();
        PlyEnergies {
            miss: spline_coefficients(&values, rows, columns),
            share_theta_i: theta_i.clone(),
            share_h_um: h_um.clone(),
            share_refl: vec![0.25; values.len()],
            share_high: vec![0.75; values.len()],
            miss_theta_i: theta_i,
            miss_h_um: h_um,
        }
    }

    /// Upper tail of the normal distribution, as a sum.
    fn tail(t: f64) -> f64 {
        (0..4000).map(|i| t + (f64::from(i) + 0.5) * 0.0025).map(|x| (-0.5 * x * x).exp()).sum::<f64>() * 0.0025
            / std::f64::consts::TAU.sqrt()
    }

    #[test]
    fn the_spline_has_the_values_at_the_nodes() {
        let f = |t: f64, h: f64| 0.5 + 0.3 * (0.7 * t + 0.05 * h).sin();
        let g = grid(9, 15, f);
        for (m, t) in g.miss_theta_i.iter().enumerate() {
            for h in &g.miss_h_um {
                let want = f(*t, *h);
                let got = g.at(*t, *h).r_d;
                assert!((got - want).abs() < 1e-12, "row {m}, h {h}: {got}, want {want}");
            }
        }
        assert_eq!(g.at(-0.3, 20.0), g.at(0.3, -20.0));
        assert_eq!(g.at(9.0, 99.0), g.at(1.4, 70.0));
    }

    /// The edge of a ply in a beam of standard deviation s, which moves with theta_i. Halving the step
    /// divides the error by about 8.
    #[test]
    fn a_blurred_edge_is_found_between_the_nodes() {
        let s = 5.0;
        let f = |t: f64, h: f64| tail((45.0 + 10.0 * t * h.signum() - h.abs()) / s).clamp(0.0, 1.0);
        let worst = |columns: usize| {
            let g = grid(29, columns, f);
            let mut worst = 0.0f64;
            for i in 0..23 {
                for k in 0..230 {
                    let (t, h) = (1.4 * (f64::from(i) + 0.37) / 23.0, -70.0 + 140.0 * (f64::from(k) + 0.5) / 230.0);
                    // At theta_i = 0 the two edges of this profile are discontinuous.
                    if t > 0.15 {
                        worst = worst.max((g.at(t, h).r_d - f(t, h)).abs());
                    }
                }
            }
            worst
        };
        let (coarse, fine) = (worst(29), worst(57));
        assert!(fine < 1.2e-3 && coarse / fine > 5.0, "steps of s: {coarse:.1e}, of s/2: {fine:.1e}");
    }

    #[test]
    fn energies_are_kept_and_slopes_continuous() {
        let g = grid(7, 11, |t, h| if h.abs() > 40.0 { 0.9 - 0.1 * t } else { 0.0 });
        let total = |t: f64, h: f64| {
            let e = g.at(t, h);
            e.r_d + e.refl + e.high.iter().sum::<f64>()
        };
        for i in 0..400 {
            let (t, h) = (1.4 * f64::from(i) / 400.0, 70.0 * (0.37 * f64::from(i)).sin());
            assert!((total(t, h) - 1.0).abs() < 1e-14);
        }
        // Half-way between nodes, where the nearest node changes.
        for h in [-35.0, 7.0, 49.0] {
            let slope = |a: f64, b: f64| (g.at(0.7, h + b).r_d - g.at(0.7, h + a).r_d) / (b - a);
            assert!((slope(-1e-5, 0.0) - slope(0.0, 1e-5)).abs() < 1e-5, "{h}");
        }
    }
}
