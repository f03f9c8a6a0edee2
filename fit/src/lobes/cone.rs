//! Mixtures of cone lobes ([`plywave::ply::cone`]) on a latitude-longitude grid: weighted squared distance to
//! a slice, its gradient, and starts.
//!
//! Both profiles of a lobe have closed integrals, so bins are compared by their means and not at their
//! centers. The mean over a row along s is a difference of erf, and so is the mean over a column along phi
//! (the tilt of s0 within a column is neglected). A ring far narrower than a row then becomes one row of
//! light, as in a table, and only its distance from the row's edges matters to the fit.
//!
//! Where rings lie on an edge, as at every second node of a standard table, rounding puts all light of a ring
//! of zero width into one of the two rows. To follow it, a lobe must move off the edge by two of its own
//! widths, which is a tenth of a degree for the narrowest lobe. The position of a ring within a row is
//! undetermined, so a weak pull keeps the lobe at the cone.

use crate::lobes::sphere::{PaddedSlice, SphereGrid};
use plywave::math::hash::SplitMix64;
use plywave::ply::LobeKind;
use plywave::ply::asg::PARAMS;
use plywave::ply::cone::{CONE_MU_MIN, CONE_MU1_MAX, CONE_MU2_MAX, GRAZING};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Kind of the lobes of a slice: round ones, or cones for this incident latitude.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SliceLobes {
    /// Anisotropic spherical Gaussians.
    #[default]
    Round,
    /// Cones for light incident at `theta_i` [rad].
    Cone {
        /// Incident latitude [rad].
        theta_i: f64,
    },
}

impl SliceLobes {
    /// Lobes of a kind at an incident latitude [rad].
    pub fn new(family: LobeKind, theta_i: f64) -> SliceLobes {
        match family {
            LobeKind::Round => SliceLobes::Round,
            LobeKind::Cone => SliceLobes::Cone { theta_i },
        }
    }

    /// Kind of the lobes.
    pub fn family(self) -> LobeKind {
        match self {
            SliceLobes::Round => LobeKind::Round,
            SliceLobes::Cone { .. } => LobeKind::Cone,
        }
    }
}

/// Bounds of the parameters of a lobe about `start`: axis within half a turn of the start, energies up to
/// `top`.
pub(crate) fn bounds(family: LobeKind, start: &[f64], top: f64) -> ([f64; PARAMS], [f64; PARAMS]) {
    let [(low1, high1), (low2, high2)] = family.bandwidths().map(|(low, high)| (low.ln(), high.ln()));
    let (latitude, turn) = match family {
        LobeKind::Round => (FRAC_PI_2, (start[2] - PI, start[2] + PI)),
        // Range that includes the cones of the steepest fibers.
        LobeKind::Cone => (2.0, (-3.0, 3.0)),
    };
    ([-latitude, start[1] - PI, turn.0, low1, low2, 0.0], [latitude, start[1] + PI, turn.1, high1, high2, top])
}

/// |x| beyond which erf counts as 1: 1 - erf is 1.5e-8.
const FAR: f64 = 4.0;
/// Strength and range [rad] of the pull to the cone. The strength is the largest addition to the squared
/// relative error of a slice.
const PULL: f64 = 2e-5;
const REACH: f64 = 0.03;

/// erf x and exp(-x^2).
fn erf_exp(x: f64) -> (f64, f64) {
    if x.abs() >= FAR { (1f64.copysign(x), 0.0) } else { (libm::erf(x), (-x * x).exp()) }
}

/// A lobe on one column of the grid.
struct Column {
    /// Mean of N over the column, and its derivatives with respect to ln mu1 and phi_z.
    n: f64,
    by_ln_mu1: f64,
    by_phi: f64,
    /// Derivative of s0 with respect to x, and 1 if s0 is free, 0 if it is clamped to [-1, 1].
    by_x: f64,
    sin_x: f64,
    free: f64,
    /// The sum of erf at the ends of [-1, 1], and its derivatives with respect to s0 and ln t.
    all: f64,
    all_by_s0: f64,
    all_by_ln_t: f64,
    /// First row with light, and the row after the last one.
    rows: (usize, usize),
    /// Index of the means over these rows.
    at: usize,
}

/// Mean of M over a row, and its derivatives with respect to s0 and ln mu2, all divided by the sum of erf.
type RowMean = [f64; 3];

struct LobeOnGrid {
    g: f64,
    energy: f64,
    columns: Vec<Column>,
    means: Vec<RowMean>,
}

const TWO_PER_ROOT_PI: f64 = std::f64::consts::FRAC_2_SQRT_PI;

impl LobeOnGrid {
    fn new(edges: &[f64], columns: usize, theta_i: f64, p: &[f64]) -> LobeOnGrid {
        let g = theta_i.cos().max(GRAZING);
        let (r1, r2) = ((0.5 * p[3]).exp(), (0.5 * p[4]).exp() / g);
        let step = TAU / columns as f64;
        let (whole, whole_exp) = erf_exp(PI * r1);
        let per = 0.5 / (step * whole) * 2.0;
        let per_root_pi = 0.5 * TWO_PER_ROOT_PI;
        let mut means = Vec::new();
        let reach = FAR / r2;
        let columns = (0..columns)
            .map(|j| {
                let x = (j as f64 + 0.5) * step - p[1];
                let x = x - TAU * (x / TAU).round();
                let (low, high) = (x - 0.5 * step, x + 0.5 * step);
                let ((a0, e0), (a1, e1)) = (erf_exp(r1 * low), erf_exp(r1 * high));
                let n = 0.5 * per * (a1 - a0);
                let by_ln_mu1 = 0.5 * per * per_root_pi * r1 * (high * e1 - low * e0)
                    - n * per_root_pi * PI * r1 * whole_exp / whole;
                let by_phi = -0.5 * per * TWO_PER_ROOT_PI * r1 * (e1 - e0);
                let (sin_x, cos_x) = x.sin_cos();
                let middle = g * (p[0] + p[2] * sin_x) - theta_i.sin();
                let s0 = middle.clamp(-1.0, 1.0);
                let free = if s0 == middle { 1.0 } else { 0.0 };
                let ((top, top_e), (bottom, bottom_e)) = (erf_exp(r2 * (1.0 - s0)), erf_exp(r2 * (-1.0 - s0)));
                let first = edges.partition_point(|e| *e < s0 - reach).saturating_sub(1);
                let end = edges.partition_point(|e| *e < s0 + reach).min(edges.len() - 1).max(first);
                let all = top - bottom;
                let at = means.len();
                if n > 1e-9 {
                    let edge = |k: usize| {
                        let y = r2 * (edges[k] - s0);
                        let (f, e) = erf_exp(y);
                        (f, e, y * e)
                    };
                    let mut below = edge(first);
                    for k in first..end {
                        let above = edge(k + 1);
                        let scale = 1.0 / (all * (edges[k + 1] - edges[k]));
                        means.push([
                            scale * (above.0 - below.0),
                            -scale * TWO_PER_ROOT_PI * r2 * (above.1 - below.1),
                            scale * per_root_pi * (above.2 - below.2),
                        ]);
                        below = above;
                    }
                }
                let rows = if n > 1e-9 { (first, end) } else { (0, 0) };
                Column {
                    n,
                    by_ln_mu1,
                    by_phi,
                    by_x: free * g * p[2] * cos_x,
                    sin_x,
                    free,
                    all,
                    all_by_s0: TWO_PER_ROOT_PI * r2 * (bottom_e - top_e),
                    all_by_ln_t: per_root_pi * r2 * ((1.0 - s0) * top_e + (1.0 + s0) * bottom_e),
                    rows,
                    at,
                }
            })
            .collect();
        LobeOnGrid { g, energy: p[5], columns, means }
    }

    fn means(&self, column: &Column) -> &[RowMean] {
        &self.means[column.at..column.at + column.rows.1 - column.rows.0]
    }

    /// Adds `gain` times the lobe to `model`.
    fn add(&self, gain: f64, model: &mut [f32], padded: usize) {
        for (j, column) in self.columns.iter().enumerate() {
            let scale = gain * self.energy * column.n;
            for (row, mean) in (column.rows.0..).zip(self.means(column)) {
                model[row * padded + j] += (scale * mean[0]) as f32;
            }
        }
    }

    /// Derivatives with respect to the parameters of a cost whose derivatives with respect to the bins are
    /// `by_bin`.
    fn chain(&self, by_bin: &[f32], padded: usize, gradient: &mut [f64]) {
        for (j, column) in self.columns.iter().enumerate() {
            let mut sums = [0.0; 3];
            for (row, mean) in (column.rows.0..).zip(self.means(column)) {
                let by = f64::from(by_bin[row * padded + j]);
                for (sum, mean) in sums.iter_mut().zip(mean) {
                    *sum += by * mean;
                }
            }
            let [value, by_s0, by_ln_t] = sums;
            let by_s0 = by_s0 - value / column.all * column.all_by_s0;
            let by_ln_t = by_ln_t - value / column.all * column.all_by_ln_t;
            let lobe_energy = self.energy * column.n;
            gradient[0] += lobe_energy * by_s0 * column.free * self.g;
            gradient[1] += self.energy * column.by_phi * value - lobe_energy * by_s0 * column.by_x;
            gradient[2] += lobe_energy * by_s0 * column.free * self.g * column.sin_x;
            gradient[3] += self.energy * column.by_ln_mu1 * value;
            gradient[4] += lobe_energy * by_ln_t;
            gradient[5] += column.n * value;
        }
    }
}

impl SphereGrid {
    /// [`SphereGrid::mixture`] for either kind of lobes; cones are averaged over the bins.
    pub fn mixture_of(
        &self,
        lobes: SliceLobes,
        params: &[f64],
        gain: f64,
        scratch: &mut crate::lobes::sphere::Scratch,
    ) -> PaddedSlice {
        match lobes {
            SliceLobes::Round => self.mixture(params, gain, scratch),
            SliceLobes::Cone { theta_i } => self.cone_mixture(theta_i, params, gain).0,
        }
    }

    /// [`SphereGrid::cost_gradient`] for either kind of lobes.
    pub fn cost_gradient_of(
        &self,
        lobes: SliceLobes,
        target: &PaddedSlice,
        params: &[f64],
        gain: f64,
        gradient: &mut [f64],
        scratch: &mut crate::lobes::sphere::Scratch,
    ) -> f64 {
        let SliceLobes::Cone { theta_i } = lobes else {
            return self.cost_gradient(target, params, gain, gradient, scratch);
        };
        let (mut model, lobes) = self.cone_mixture(theta_i, params, gain);
        let cost = self.residual(&mut model, target, gain);
        gradient.fill(0.0);
        for (lobe, gradient) in lobes.iter().zip(gradient.chunks_exact_mut(PARAMS)) {
            lobe.chain(model.values(), self.padded(), gradient);
        }
        cost
    }

    fn cone_mixture(&self, theta_i: f64, params: &[f64], gain: f64) -> (PaddedSlice, Vec<LobeOnGrid>) {
        let columns = self.grid().phi_o;
        let mut model = self.pad(&vec![0.0; self.grid().len()], 0.0);
        let padded = self.padded();
        let lobes: Vec<LobeOnGrid> =
            params.chunks_exact(PARAMS).map(|p| LobeOnGrid::new(self.edges(), columns, theta_i, p)).collect();
        for lobe in &lobes {
            lobe.add(gain, model.values_mut(), padded);
        }
        (model, lobes)
    }
}

/// Cost of the pull to the cone for a lobe's offset and slope, and its derivatives with respect to them.
pub(crate) fn pull(p: &[f64]) -> (f64, [f64; 2]) {
    let (mut cost, mut by) = (0.0, [0.0; 2]);
    for (by, x) in by.iter_mut().zip([p[0] / REACH, p[2] / REACH]) {
        let e = (-x * x).exp();
        cost += PULL * (1.0 - e);
        *by = PULL * 2.0 * x * e / REACH;
    }
    (cost, by)
}

/// Light in an azimuth column: energy, mean latitude relative to the cone, and its mean square.
type Ring = [f64; 3];

/// Rings, by column, of light `[theta_o][phi_o]` incident at `theta_i`; negative values count as 0.
pub(crate) fn rings(sphere: &SphereGrid, values: &PaddedSlice, theta_i: f64) -> Vec<Ring> {
    let grid = sphere.grid();
    let (g, values) = (theta_i.cos().max(GRAZING), sphere.unpad(values));
    let mut rings = vec![[0.0; 3]; grid.phi_o];
    for i in 0..grid.theta_o {
        let from = (grid.theta(i).sin() + theta_i.sin()) / g;
        for (j, ring) in rings.iter_mut().enumerate() {
            let e = sphere.solid_angles()[i] * f64::from(values[i * grid.phi_o + j].max(0.0));
            *ring = [ring[0] + e, ring[1] + e * from, ring[2] + e * from * from];
        }
    }
    rings
}

/// Returns `count` cone lobes whose energies add up to that of the rings: k-means of the azimuth, then the
/// moments of each cluster. `row` is the height of a row [rad].
pub(crate) fn ring_lobes(rings: &[Ring], count: usize, row: f64, seed: u64) -> Vec<[f64; PARAMS]> {
    let columns = rings.len();
    let step = TAU / columns as f64;
    let phi = |j: usize| (j as f64 + 0.5) * step;
    let apart = |a: f64, b: f64| {
        let x = a - b;
        x - TAU * (x / TAU).round()
    };
    let mut stream = SplitMix64(seed);
    let total: f64 = rings.iter().map(|r| r[0]).sum();
    if !(total > 0.0 && total.is_finite()) {
        let p = |l: usize| [0.0, phi(l * columns / count.max(1)), 0.0, 0.0, 6.0, 0.0];
        return (0..count).map(p).collect();
    }
    let mut centers: Vec<f64> = Vec::with_capacity(count);
    let mut nearest = vec![PI; columns];
    for _ in 0..count {
        let weight = |j: usize, nearest: &[f64]| rings[j][0] * nearest[j] * nearest[j];
        let mut remaining = stream.next_f64() * (0..columns).map(|j| weight(j, &nearest)).sum::<f64>();
        let pick = (0..columns).find(|j| {
            remaining -= weight(*j, &nearest);
            remaining < 0.0
        });
        let center = phi(pick.unwrap_or(columns - 1));
        centers.push(center);
        for (j, near) in nearest.iter_mut().enumerate() {
            *near = near.min(apart(phi(j), center).abs());
        }
    }
    let mut label = vec![0; columns];
    for _ in 0..30 {
        let mut sums = vec![(0.0, 0.0); count];
        for j in 0..columns {
            let far = |c: usize| apart(phi(j), centers[c]).abs();
            label[j] = (0..count).min_by(|a, b| far(*a).total_cmp(&far(*b))).unwrap_or(0);
            let sum: &mut (f64, f64) = &mut sums[label[j]];
            *sum = (sum.0 + rings[j][0], sum.1 + rings[j][0] * apart(phi(j), centers[label[j]]));
        }
        for (center, sum) in centers.iter_mut().zip(&sums) {
            if sum.0 > 0.0 {
                *center += sum.1 / sum.0;
            }
        }
    }
    (0..count).map(|c| cluster(rings, &label, c, centers[c], &apart, row)).collect()
}

fn cluster(
    rings: &[Ring],
    label: &[usize],
    c: usize,
    center: f64,
    apart: &dyn Fn(f64, f64) -> f64,
    row: f64,
) -> [f64; PARAMS] {
    let step = TAU / rings.len() as f64;
    // Weighted sums of 1, x^2, latitude, latitude^2, sin x, sin^2 x, and latitude sin x.
    let mut m = [0.0; 7];
    for (j, ring) in rings.iter().enumerate().filter(|(j, _)| label[*j] == c) {
        let x = apart((j as f64 + 0.5) * step, center);
        let (e, s) = (ring[0], x.sin());
        for (m, v) in m.iter_mut().zip([e, e * x * x, ring[1], ring[2], e * s, e * s * s, ring[1] * s]) {
            *m += v;
        }
    }
    let energy = m[0];
    if energy <= 0.0 {
        return [0.0, center, 0.0, 1.0, 6.0, 0.0];
    }
    let m = m.map(|v| v / energy);
    let spread = m[5] - m[4] * m[4];
    let slope = if spread > 1e-6 { ((m[6] - m[4] * m[2]) / spread).clamp(-1.0, 1.0) } else { 0.0 };
    let offset = (m[2] - slope * m[4]).clamp(-1.5, 1.5);
    // The variance due to the rows' height is subtracted; a ring within half a row of the cone counts as on
    // the cone.
    let variance = (m[3] - m[2] * m[2] - slope * slope * spread - row * row / 12.0).max((0.2 * row).powi(2));
    let on_cone = |x: f64| if x.abs() < 0.75 * row { 0.0 } else { x };
    let ln_mu2 = (0.5 / variance).clamp(CONE_MU_MIN, CONE_MU2_MAX).ln();
    // With the variance of a cluster alone, the lobes would leave gaps between clusters.
    let ln_mu1 = (0.3 / m[1].max(step * step / 12.0)).clamp(CONE_MU_MIN, CONE_MU1_MAX).ln();
    [on_cone(offset), center, on_cone(slope), ln_mu1, ln_mu2, energy]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobes::sphere::Scratch;
    use plywave::ply::cone::ConeLobe;
    use plywave_tables::table::OutgoingGrid;

    fn lobes() -> Vec<f64> {
        [
            [0.1, 1.0, 0.2, 1.0, 5.0, 0.4],
            [-0.3, 6.0, -0.5, 3.0, 3.0, 0.3],
            [0.0, -1.0, 0.05, -1.5, 9.0, 0.2],
            [0.9, 4.0, 0.3, 0.0, -2.0, 0.1],
        ]
        .concat()
    }

    /// Bins agree with the mean of the lobes over many points of each bin.
    #[test]
    #[ignore = "slow: 5 s: bins hold means"]
    fn bins_hold_means() {
        let sphere = SphereGrid::new(OutgoingGrid { theta_o: 18, phi_o: 72 });
        for theta_i in [0.0, 0.7, 1.3f64] {
            let got =
                sphere.unpad(&sphere.mixture_of(SliceLobes::Cone { theta_i }, &lobes(), 0.8, &mut Scratch::default()));
            let (points, mut peak, mut worst, mut sum) = (30, 0.0f64, 0.0f64, 0.0);
            for i in 0..18 {
                let (low, high) = (sphere.edges()[i], sphere.edges()[i + 1]);
                for j in 0..72 {
                    let mut want = 0.0;
                    for k in 0..points * points {
                        let (a, b) = ((k / points) as f64 + 0.5, (k % points) as f64 + 0.5);
                        let s = low + (high - low) * a / points as f64;
                        let phi = TAU * (j as f64 + b / points as f64) / 72.0;
                        let c = (1.0 - s * s).sqrt();
                        let v = [c * phi.cos(), c * phi.sin(), s];
                        want += lobes()
                            .chunks_exact(6)
                            .map(|p| 0.8 * ConeLobe::from_params(p).eval(theta_i, v))
                            .sum::<f64>();
                    }
                    want /= (points * points) as f64;
                    let got = f64::from(got[i * 72 + j]);
                    peak = peak.max(want);
                    sum += got * sphere.solid_angles()[i];
                    worst = worst.max((got - want).abs());
                }
            }
            // The tolerance covers the neglected tilt within a column.
            assert!(worst < 0.02 * peak, "{theta_i}: off by {worst}, peak {peak}");
            // The column of a lobe's antipode is cut at its edges instead of at the antipode, which costs
            // some energy.
            assert!((sum - 0.8).abs() < 5e-5, "energy {sum}");
        }
    }

    #[test]
    fn gradient_matches_differences() {
        let sphere = SphereGrid::new(OutgoingGrid { theta_o: 45, phi_o: 90 });
        for theta_i in [0.0, 0.61, 1.45] {
            let on = SliceLobes::Cone { theta_i };
            let (params, mut other) = (lobes(), lobes());
            for (i, p) in other.iter_mut().enumerate() {
                *p += 0.2 * ((i * 7 % 5) as f64 / 5.0 - 0.4);
            }
            let target = sphere.mixture_of(on, &other, 1.0, &mut Scratch::default());
            let mut gradient = vec![0.0; params.len()];
            sphere.cost_gradient_of(on, &target, &params, 0.9, &mut gradient, &mut Scratch::default());
            let scale = gradient.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            for i in 0..params.len() {
                let moved = |by: f64| {
                    let mut p = params.clone();
                    p[i] += by;
                    sphere.distance2(&sphere.mixture_of(on, &p, 0.9, &mut Scratch::default()), &target)
                };
                let step = 1e-3;
                let want = (moved(step) - moved(-step)) / (2.0 * step);
                assert!(
                    (gradient[i] - want).abs() < 3e-3 * scale,
                    "{theta_i} param {i}: got {}, want {want}",
                    gradient[i]
                );
            }
        }
    }

    #[test]
    fn starts_follow_the_rings() {
        let sphere = SphereGrid::new(OutgoingGrid { theta_o: 90, phi_o: 180 });
        let planted = [[0.2, 1.0, 0.1, 3.0, 7.0, 0.3], [-0.1, 4.0, 0.0, 2.0, 6.0, 0.7]];
        let on = SliceLobes::Cone { theta_i: 0.5 };
        let slice = sphere.mixture_of(on, &planted.concat(), 1.0, &mut Scratch::default());
        let mut got = ring_lobes(&rings(&sphere, &slice, 0.5), 2, PI / 90.0, 3);
        got.sort_by(|a, b| a[5].total_cmp(&b[5]));
        for (got, want) in got.iter().zip(&planted) {
            let turn = (got[1] - want[1]).rem_euclid(TAU);
            assert!(turn.min(TAU - turn) < 0.1 && (got[0] - want[0]).abs() < 0.03, "{got:?}, want {want:?}");
            assert!((got[4] - want[4]).abs() < 0.7 && (got[5] - want[5]).abs() < 0.05, "{got:?}, want {want:?}");
        }
    }
}
