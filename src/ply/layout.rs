//! The tensors of a model laid out for the kernels: f32, lobes to lanes of 8, one ghost node around the reflection grid.

use super::PlyData;
use super::kernel::{GROUPS, LANES};
use super::reference::{LEAST_ENERGY, extended};
use crate::asg::PARAMS;

/// Numbers before the spectrum in a node's record: r_d and the energy of f_refl.
pub(super) const HEAD: usize = 2;

/// Arrays of the kernels. Lanes and path lengths beyond the model's own hold zeros.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) nodes_theta: usize,
    pub(super) nodes_h: usize,
    /// Nodes per radian of theta_i, per um of h.
    pub(super) per_theta: f32,
    pub(super) per_h: f32,
    /// Last offset node [um]; the first is its negative.
    pub(super) h_last: f32,
    /// Octets of path lengths, of high-order lanes, of reflection lanes.
    pub(super) path_chunks: usize,
    pub(super) high_chunks: usize,
    pub(super) refl_chunks: usize,
    /// `[8 path_chunks]` path lengths [um].
    pub(super) path: Vec<f32>,
    /// `[M][H][HEAD + 8 path_chunks]`: r_d, energy_refl, energy_high.
    pub(super) nodes: Vec<f32>,
    /// `[M+2][H+2][6][8 refl_chunks]`: reflection lobes, continued linearly by one node on each side.
    pub(super) refl: Vec<f32>,
    /// `[(M-1)/2][(H-1)/2][4][6 + 8 path_chunks][8 high_chunks]`: parameters, then spectrum, of the high-order lobes.
    pub(super) high: Vec<f32>,
    /// Least energy of a lane: [`LEAST_ENERGY`] for lobes, 0 for empty lanes.
    pub(super) least: [[f32; LANES]; GROUPS],
}

impl Layout {
    /// From checked data.
    pub(super) fn new(d: &PlyData) -> Layout {
        let (m, h, _, j) = d.sizes();
        let chunks = |n: usize| n.div_ceil(8);
        let (path_chunks, high_chunks, refl_chunks) = (chunks(j), chunks(d.lobes_high), chunks(d.lobes_refl));
        let mut path: Vec<f32> = d.path_um.iter().map(|v| *v as f32).collect();
        path.resize(8 * path_chunks, 0.0);

        let mut nodes = Vec::with_capacity(m * h * (HEAD + 8 * path_chunks));
        for i in 0..m * h {
            nodes.extend([d.r_d[i] as f32, d.energy_refl[i] as f32]);
            nodes.extend((0..8 * path_chunks).map(|p| if p < j { d.energy_high[i * j + p] as f32 } else { 0.0 }));
        }

        let mut refl = Vec::with_capacity((m + 2) * (h + 2) * PARAMS * 8 * refl_chunks);
        for a in -1..=m as isize {
            for b in -1..=h as isize {
                for k in 0..PARAMS {
                    for l in 0..8 * refl_chunks {
                        let node = |i: usize, j: usize| d.refl[((i * h + j) * d.lobes_refl + l) * PARAMS + k];
                        let row = |i: usize| extended(b, h, &|j| node(i, j));
                        refl.push(if l < d.lobes_refl { extended(a, m, &row) as f32 } else { 0.0 });
                    }
                }
            }
        }

        let corners = (m / 2) * (h / 2) * 4;
        let mut high = Vec::with_capacity(corners * (PARAMS + 8 * path_chunks) * 8 * high_chunks);
        for c in 0..corners {
            let value = |l: usize, k: usize| d.high[(c * d.lobes_high + l) * PARAMS + k];
            let share = |l: usize, p: usize| d.high_path[(c * d.lobes_high + l) * j + p];
            for k in 0..PARAMS {
                high.extend((0..8 * high_chunks).map(|l| if l < d.lobes_high { value(l, k) as f32 } else { 0.0 }));
            }
            for p in 0..8 * path_chunks {
                let lane = |l: usize| if l < d.lobes_high && p < j { share(l, p) as f32 } else { 0.0 };
                high.extend((0..8 * high_chunks).map(lane));
            }
        }

        let mut least = [[0.0; LANES]; GROUPS];
        for (i, v) in least.as_flattened_mut().iter_mut().enumerate() {
            let lobe = if i < 8 * high_chunks { i < d.lobes_high } else { i - 8 * high_chunks < d.lobes_refl };
            *v = if lobe { LEAST_ENERGY as f32 } else { 0.0 };
        }
        Layout {
            nodes_theta: m,
            nodes_h: h,
            per_theta: (m - 1) as f32 / d.theta_i[m - 1] as f32,
            per_h: (h - 1) as f32 / (2.0 * d.h_um[h - 1]) as f32,
            h_last: d.h_um[h - 1] as f32,
            path_chunks,
            high_chunks,
            refl_chunks,
            path,
            nodes,
            refl,
            high,
            least,
        }
    }

    /// Whether 8 lanes for each kind are enough.
    #[inline(always)]
    pub(super) fn small(&self) -> bool {
        self.high_chunks == 1 && self.refl_chunks == 1
    }
}
