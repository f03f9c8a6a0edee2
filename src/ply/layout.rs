//! The tensors of a model laid out for the kernels: f32, lobes to lanes of 8, one ghost node around the reflection grid.

use super::reference::{LEAST_ENERGY, extended};
use super::{MAX_LOBES, MAX_PATHS, PlyData};
use crate::asg::PARAMS;

/// Numbers before the spectrum in a node's record: r_d and the energy of f_refl.
pub(super) const HEAD: usize = 2;

/// Lanes of each kind and path lengths that a kernel is compiled for.
#[derive(Clone, Copy)]
pub(super) struct Sizes {
    pub(super) high: usize,
    pub(super) refl: usize,
    pub(super) paths: usize,
}

/// The common sizes.
pub(super) const SMALL: Sizes = Sizes { high: 8, refl: 8, paths: 8 };
/// The largest sizes.
pub(super) const LARGE: Sizes = Sizes { high: MAX_LOBES, refl: MAX_LOBES, paths: MAX_PATHS };

/// Arrays of the kernels; H, R and J are the sizes of the kernel that is used. Lanes and path lengths beyond the model's own hold zeros.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) nodes_theta: usize,
    pub(super) nodes_h: usize,
    /// Nodes per radian of theta_i, per um of h.
    pub(super) per_theta: f32,
    pub(super) per_h: f32,
    /// Last offset node [um]; the first is its negative.
    pub(super) h_last: f32,
    /// Number of high-order lobes.
    pub(super) lobes_high: usize,
    /// Whether the small sizes are enough.
    pub(super) small: bool,
    /// `[J]` path lengths [um].
    pub(super) path: Vec<f32>,
    /// `[M][H][HEAD + J]`: r_d, energy_refl, energy_high.
    pub(super) nodes: Vec<f32>,
    /// `[M+2][H+2][6][R]`: reflection lobes, continued linearly by one node on each side.
    pub(super) refl: Vec<f32>,
    /// `[(M-1)/2][(H-1)/2][4]` of `[6][H]` parameters, then `[H][J]` spectra, of the high-order lobes.
    pub(super) high: Vec<f32>,
    /// Least energy of a lane: [`LEAST_ENERGY`] for lobes, 0 for empty lanes.
    pub(super) least: [f32; LARGE.high + LARGE.refl],
}

impl Layout {
    /// From checked data.
    pub(super) fn new(d: &PlyData) -> Layout {
        let (m, h, _, j) = d.sizes();
        let small = d.lobes_high <= SMALL.high && d.lobes_refl <= SMALL.refl && j <= SMALL.paths;
        let size = if small { SMALL } else { LARGE };
        let mut path: Vec<f32> = d.path_um.iter().map(|v| *v as f32).collect();
        path.resize(size.paths, 0.0);

        let mut nodes = Vec::with_capacity(m * h * (HEAD + size.paths));
        for i in 0..m * h {
            nodes.extend([d.r_d[i] as f32, d.energy_refl[i] as f32]);
            nodes.extend((0..size.paths).map(|p| if p < j { d.energy_high[i * j + p] as f32 } else { 0.0 }));
        }

        let mut refl = Vec::with_capacity((m + 2) * (h + 2) * PARAMS * size.refl);
        for a in -1..=m as isize {
            for b in -1..=h as isize {
                for k in 0..PARAMS {
                    for l in 0..size.refl {
                        let node = |i: usize, j: usize| d.refl[((i * h + j) * d.lobes_refl + l) * PARAMS + k];
                        let row = |i: usize| extended(b, h, &|j| node(i, j));
                        refl.push(if l < d.lobes_refl { extended(a, m, &row) as f32 } else { 0.0 });
                    }
                }
            }
        }

        let corners = (m / 2) * (h / 2) * 4;
        let mut high = Vec::with_capacity(corners * (PARAMS + size.paths) * size.high);
        for c in 0..corners {
            let value = |l: usize, k: usize| d.high[(c * d.lobes_high + l) * PARAMS + k];
            let share = |l: usize, p: usize| d.high_path[(c * d.lobes_high + l) * j + p];
            for k in 0..PARAMS {
                high.extend((0..size.high).map(|l| if l < d.lobes_high { value(l, k) as f32 } else { 0.0 }));
            }
            for l in 0..size.high {
                let lane = |p: usize| if l < d.lobes_high && p < j { share(l, p) as f32 } else { 0.0 };
                high.extend((0..size.paths).map(lane));
            }
        }

        let mut least = [0.0; LARGE.high + LARGE.refl];
        for (i, v) in least.iter_mut().enumerate() {
            let lobe = if i < size.high { i < d.lobes_high } else { i - size.high < d.lobes_refl };
            *v = if lobe { LEAST_ENERGY as f32 } else { 0.0 };
        }
        Layout {
            nodes_theta: m,
            nodes_h: h,
            per_theta: (m - 1) as f32 / d.theta_i[m - 1] as f32,
            per_h: (h - 1) as f32 / (2.0 * d.h_um[h - 1]) as f32,
            h_last: d.h_um[h - 1] as f32,
            lobes_high: d.lobes_high,
            small,
            path,
            nodes,
            refl,
            high,
            least,
        }
    }
}
