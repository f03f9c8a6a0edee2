//! Compares two models: their values, their energies, and the drift of their lobes.

use crate::error::FitError;
use crate::lobes::canonical::canonical_order;
use crate::lobes::model::{GridCell, ScaledLobes, energies, evaluate, high_lobes, refl_lobes};
use crate::lobes::sphere::{Scratch, SphereGrid};
use plywave::ply::LobeKind;
use plywave::ply::PlyData;
use plywave::ply::asg::{Lobe, PARAMS};
use plywave_tables::table::OutgoingGrid;
use rayon::prelude::*;

/// Largest differences that count as equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffTolerance {
    /// Relative L2 distance of a slice.
    pub l2: f64,
    /// Energy of a slice, absolute (1 = the whole beam).
    pub energy: f64,
    /// Rotation of a lobe's axis [rad]; infinite by default, since different lobes may give the same density.
    pub drift_rad: f64,
}

impl Default for DiffTolerance {
    fn default() -> Self {
        DiffTolerance { l2: 0.02, energy: 2e-3, drift_rad: f64::INFINITY }
    }
}

/// Largest differences between matched lobes with at least 2 % of their slice's energy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LobeDrift {
    /// Angle between the axes [rad].
    pub axis_rad: f64,
    /// Difference of ln mu, the larger one of the two bandwidths.
    pub ln_mu: f64,
    /// Difference of the fractions of energy.
    pub share: f64,
}

/// Differences by slice, at the nodes and, for `*_between`, at the centers of the cells.
#[derive(Clone, Debug, PartialEq)]
pub struct DiffReport {
    /// `[M][H]`: relative L2 distance of f_refl.
    pub refl: Vec<f64>,
    /// `[M][H][K]`: relative L2 distance of f_high.
    pub high: Vec<f64>,
    /// `[M-1][H-1]`: relative L2 distance of f_refl at the centers of the cells.
    pub refl_between: Vec<f64>,
    /// `[M-1][H-1]`: relative L2 distance of f_high at sigma = 0 at the centers of the cells.
    pub high_between: Vec<f64>,
    /// Largest difference of r_d and of the energies of f_refl and f_high at sigma_k, over the nodes and the
    /// points halfway between them.
    pub energy: f64,
    /// Drift of the reflection lobes over all nodes; `None` if the models differ in their number.
    pub drift_refl: Option<LobeDrift>,
    /// Drift of the high-order lobes over all nodes; `None` if the models differ in their number.
    pub drift_high: Option<LobeDrift>,
    /// Largest relative L2 distance of all.
    pub worst: f64,
    /// Whether everything is within the tolerance.
    pub equal: bool,
}

/// Bins of the comparison: 4 degrees.
const GRID: OutgoingGrid = OutgoingGrid { theta_o: 45, phi_o: 90 };
/// Slices below this fraction of the brightest one are compared relative to that fraction of it.
const FLOOR: f64 = 1e-3;

struct SliceDiff {
    distance: f64,
    norm: f64,
    drift: Option<LobeDrift>,
}

/// Compares two models of the same incidences and absorption coefficients.
pub fn diff(a: &PlyData, b: &PlyData, tolerance: &DiffTolerance) -> Result<DiffReport, FitError> {
    for (axis, x, y) in [
        ("theta_i", &a.theta_i, &b.theta_i),
        ("h_um", &a.h_um, &b.h_um),
        ("sigma_per_um", &a.sigma_per_um, &b.sigma_per_um),
    ] {
        if x.len() != y.len() || x.iter().zip(y).any(|(x, y)| (x - y).abs() > 1e-9 * (1.0 + x.abs())) {
            return Err(FitError::Axes { axis, model: x.len(), table: y.len() });
        }
    }
    let sphere = SphereGrid::new(GRID);
    let (rows, columns) = (a.theta_i.len(), a.h_um.len());
    let nodes: Vec<GridCell> =
        (0..rows * columns).map(|k| crate::fit_errors::node_place(k / columns, k % columns, rows, columns)).collect();
    let cells: Vec<GridCell> = (0..(rows - 1) * (columns - 1))
        .map(|k| GridCell { m: k / (columns - 1), s: 0.5, n: k % (columns - 1), t: 0.5 })
        .collect();
    let round = a.family == LobeKind::Round && b.family == LobeKind::Round;
    let compare = |lobes: &(dyn Fn(&PlyData) -> ScaledLobes + Sync), scratch: &mut Scratch| {
        let (x, y) = (lobes(a), lobes(b));
        let (fx, fy) = (evaluate(&sphere, &x, scratch), evaluate(&sphere, &y, scratch));
        SliceDiff {
            distance: sphere.distance2(&fx, &fy).sqrt(),
            norm: sphere.inner(&fx, &fx).max(sphere.inner(&fy, &fy)).sqrt(),
            drift: if round { lobe_drift(&x.params, &y.params) } else { None },
        }
    };
    let slices = |places: &[GridCell], lobes: &(dyn Fn(&PlyData, GridCell) -> ScaledLobes + Sync)| -> Vec<SliceDiff> {
        places
            .par_iter()
            .map_init(Scratch::default, |scratch, &at| compare(&|data: &PlyData| lobes(data, at), scratch))
            .collect()
    };
    let sigma = &a.sigma_per_um;
    let refl = slices(&nodes, &|d, at| refl_lobes(d, at));
    let refl_between = slices(&cells, &|d, at| refl_lobes(d, at));
    let high_between = slices(&cells, &|d, at| high_lobes(d, at, 0.0));
    let by_sigma: Vec<Vec<SliceDiff>> =
        sigma.iter().map(|&s| slices(&nodes, &move |d: &PlyData, at| high_lobes(d, at, s))).collect();

    let brightest = |slices: &[SliceDiff]| slices.iter().map(|s| s.norm).fold(0.0, f64::max);
    let relative = |s: &SliceDiff, top: f64| {
        let scale = s.norm.max(FLOOR * top);
        if scale > 0.0 { s.distance / scale } else { 0.0 }
    };
    let all = |slices: &[SliceDiff]| {
        let top = brightest(slices);
        slices.iter().map(|s| relative(s, top)).collect::<Vec<f64>>()
    };
    let columns_high: Vec<Vec<f64>> = by_sigma.iter().map(|s| all(s)).collect();
    let high: Vec<f64> = (0..nodes.len()).flat_map(|k| columns_high.iter().map(move |c| c[k])).collect();
    let energy = nodes
        .iter()
        .chain(&cells)
        .flat_map(|&at| {
            let (x, y) = (energies(a, at), energies(b, at));
            let high = |s: f64| (x.high_at(s, &a.path_um) - y.high_at(s, &b.path_um)).abs();
            let others = [(x.r_d - y.r_d).abs(), (x.refl - y.refl).abs()];
            sigma.iter().map(|s| high(*s)).chain(others).collect::<Vec<f64>>()
        })
        .fold(0.0, f64::max);
    let drift = |slices: &[SliceDiff]| {
        slices.iter().map(|s| s.drift).reduce(|a, b| {
            let (a, b) = (a?, b?);
            Some(LobeDrift {
                axis_rad: a.axis_rad.max(b.axis_rad),
                ln_mu: a.ln_mu.max(b.ln_mu),
                share: a.share.max(b.share),
            })
        })?
    };
    let (drift_refl, drift_high) = (drift(&refl), by_sigma.first().and_then(|s| drift(s)));
    let (refl, refl_between, high_between) = (all(&refl), all(&refl_between), all(&high_between));
    let worst = [&refl, &high, &refl_between, &high_between].into_iter().flatten().copied().fold(0.0, f64::max);
    let moved = |d: Option<LobeDrift>| d.map_or(0.0, |d| d.axis_rad);
    let equal = worst <= tolerance.l2
        && energy <= tolerance.energy
        && moved(drift_refl).max(moved(drift_high)) <= tolerance.drift_rad
        && worst.is_finite();
    Ok(DiffReport { refl, high, refl_between, high_between, energy, drift_refl, drift_high, worst, equal })
}

/// Matches the round lobes of two mixtures, nearest pairs first, and measures how they differ.
pub fn lobe_drift(a: &[f64], b: &[f64]) -> Option<LobeDrift> {
    if a.len() != b.len() {
        return None;
    }
    let read = |p: &[f64]| canonical_order(&p.chunks_exact(PARAMS).map(Lobe::from_params).collect::<Vec<_>>());
    let (a, b) = (read(a), read(b));
    let total = |l: &[Lobe]| l.iter().map(|l| l.energy).sum::<f64>().max(f64::MIN_POSITIVE);
    let (ea, eb) = (total(&a), total(&b));
    let between = |x: &Lobe, y: &Lobe| {
        let (zx, zy) = (x.frame()[2], y.frame()[2]);
        let cos: f64 = (0..3).map(|k| zx[k] * zy[k]).sum();
        let chord: f64 = (0..3).map(|k| (zx[k] - zy[k]).powi(2)).sum::<f64>().sqrt();
        LobeDrift {
            axis_rad: if cos > 0.5 { 2.0 * (0.5 * chord).min(1.0).asin() } else { cos.clamp(-1.0, 1.0).acos() },
            ln_mu: (x.ln_mu1 - y.ln_mu1).abs().max((x.ln_mu2 - y.ln_mu2).abs()),
            share: (x.energy / ea - y.energy / eb).abs(),
        }
    };
    let mut pairs: Vec<(f64, usize, usize)> = Vec::with_capacity(a.len() * b.len());
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            let d = between(x, y);
            pairs.push((d.axis_rad + 0.3 * d.ln_mu + d.share, i, j));
        }
    }
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)).then(x.2.cmp(&y.2)));
    let (mut used_a, mut used_b) = (vec![false; a.len()], vec![false; b.len()]);
    let mut drift = LobeDrift::default();
    for (_, i, j) in pairs {
        if used_a[i] || used_b[j] {
            continue;
        }
        (used_a[i], used_b[j]) = (true, true);
        if (a[i].energy / ea).max(b[j].energy / eb) >= 0.02 {
            let d = between(&a[i], &b[j]);
            drift.axis_rad = drift.axis_rad.max(d.axis_rad);
            drift.ln_mu = drift.ln_mu.max(d.ln_mu);
            drift.share = drift.share.max(d.share);
        }
    }
    Some(drift)
}
