//! Lobes of a ply model at one incidence, in f64 and directly from the tensors: an implementation independent
//! of the runtime's, for errors and comparisons.

use crate::lobes::cone::SliceLobes;
use crate::lobes::sphere::{PaddedSlice, Scratch, SphereGrid};
use plywave::math::axis;
use plywave::ply::asg::PARAMS;
use plywave::ply::{EnergiesAt, PlyData};

/// Lobes `[lobes][6]` and the energy to which their sum is scaled.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaledLobes {
    /// Parameters of the lobes, energies before scaling.
    pub params: Vec<f64>,
    /// Energy to which the sum of the lobes is scaled.
    pub energy: f64,
    /// Kind of the lobes.
    pub lobes: SliceLobes,
}

impl ScaledLobes {
    /// Factor that scales the sum of the lobe energies to `energy`; 0 without lobe energy.
    pub fn gain(&self) -> f64 {
        let sum: f64 = self.params.chunks_exact(PARAMS).map(|p| p[5]).sum();
        if sum > 1e-14 { self.energy / sum } else { 0.0 }
    }
}

/// The lobes on the bins of `sphere`, scaled to their energy.
pub(crate) fn evaluate(sphere: &SphereGrid, lobes: &ScaledLobes, scratch: &mut Scratch) -> PaddedSlice {
    sphere.mixture_of(lobes.lobes, &lobes.params, lobes.gain(), scratch)
}

/// Position of a query between nodes: lower index and fraction along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// Lower node of theta_i, at most M - 2.
    pub m: usize,
    /// Fraction towards the next latitude, in [0, 1].
    pub s: f64,
    /// Lower node of h, at most H - 2.
    pub n: usize,
    /// Fraction towards the next offset, in [0, 1].
    pub t: f64,
}

/// The cell of (theta_i >= 0, h), clamped to the nodes.
pub fn locate(data: &PlyData, theta_i: f64, h_um: f64) -> GridCell {
    let (m, s) = axis::locate(theta_i, &data.theta_i);
    let (n, t) = axis::locate(h_um, &data.h_um);
    GridCell { m, s, n, t }
}

/// Reflection lobes at a query: Catmull-Rom over the nodes, extended linearly beyond the rim.
pub fn refl_lobes(data: &PlyData, at: GridCell) -> ScaledLobes {
    let (rows, columns) = (data.theta_i.len(), data.h_um.len());
    let size = data.lobes_refl * PARAMS;
    let mut params = vec![0.0; size];
    for (m, wm) in node_weights(at.m, at.s, rows) {
        for (n, wn) in node_weights(at.n, at.t, columns) {
            let node = &data.refl[(m * columns + n) * size..][..size];
            params.iter_mut().zip(node).for_each(|(p, v)| *p += wm * wn * v);
        }
    }
    for p in params.chunks_exact_mut(PARAMS) {
        for (p, (low, high)) in p[3..5].iter_mut().zip(data.family.bandwidths()) {
            *p = p.clamp(low.ln(), high.ln());
        }
        p[5] = p[5].max(0.0);
    }
    ScaledLobes { params, energy: energies(data, at).refl, lobes: lobes_at(data, at) }
}

/// Nodes and Catmull-Rom weights at fraction `t` beyond node `k` of `count`; a node beyond the rim has the
/// value `2 rim - next`.
fn node_weights(k: usize, t: f64, count: usize) -> [(usize, f64); 4] {
    let (t2, t3) = (t * t, t * t * t);
    let mut w = [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ];
    let mut nodes = [k, k, k + 1, k + 1];
    if k == 0 {
        (w[1], w[2], w[0]) = (w[1] + 2.0 * w[0], w[2] - w[0], 0.0);
    } else {
        nodes[0] = k - 1;
    }
    if k + 2 >= count {
        (w[2], w[1], w[3]) = (w[2] + 2.0 * w[3], w[1] - w[3], 0.0);
    } else {
        nodes[3] = k + 2;
    }
    [(nodes[0], w[0]), (nodes[1], w[1]), (nodes[2], w[2]), (nodes[3], w[3])]
}

/// Kind of the lobes at a query.
fn lobes_at(data: &PlyData, at: GridCell) -> SliceLobes {
    SliceLobes::new(data.family, along(&data.theta_i, at.m, at.s))
}

fn along(axis: &[f64], i: usize, t: f64) -> f64 {
    axis[i] + t * (axis[i + 1] - axis[i])
}

/// Energies of the model at a query.
pub fn energies(data: &PlyData, at: GridCell) -> EnergiesAt {
    data.energies.at(along(&data.theta_i, at.m, at.s), along(&data.h_um, at.n, at.t))
}

/// Energy of f_high at a query and sigma [1/um].
pub fn energy_high(data: &PlyData, at: GridCell, sigma_per_um: f64) -> f64 {
    energies(data, at).high_at(sigma_per_um, &data.path_um)
}

/// High-order lobes at a query and sigma [1/um], from the block that contains the query.
pub fn high_lobes(data: &PlyData, at: GridCell, sigma_per_um: f64) -> ScaledLobes {
    let s = ((at.m % 2) as f64 + at.s) / 2.0;
    let t = ((at.n % 2) as f64 + at.t) / 2.0;
    high_lobes_in_block(data, (at.m / 2, at.n / 2), s, t, at, sigma_per_um)
}

/// High-order lobes of block `(m, n)` at fractions `(s, t)` of the block, scaled to the energy at `at`.
pub fn high_lobes_in_block(
    data: &PlyData,
    block: (usize, usize),
    s: f64,
    t: f64,
    at: GridCell,
    sigma_per_um: f64,
) -> ScaledLobes {
    let (lobes, paths) = (data.lobes_high, data.path_um.len());
    let columns = (data.h_um.len() - 1) / 2;
    let first = (block.0 * columns + block.1) * 4 * lobes;
    let weights = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
    let mut params = vec![0.0; lobes * PARAMS];
    for l in 0..lobes {
        let p = &mut params[l * PARAMS..(l + 1) * PARAMS];
        let mut weight = 0.0;
        for (c, wc) in weights.iter().enumerate() {
            let k = first + c * lobes + l;
            p.iter_mut().zip(&data.high[k * PARAMS..(k + 1) * PARAMS]).for_each(|(p, v)| *p += wc * v);
            let spectrum = &data.high_path[k * paths..(k + 1) * paths];
            weight += wc * spectrum.iter().zip(&data.path_um).map(|(p, l)| p * (-sigma_per_um * l).exp()).sum::<f64>();
        }
        p[5] *= weight;
    }
    ScaledLobes { params, energy: energy_high(data, at, sigma_per_um), lobes: lobes_at(data, at) }
}
