//! Nodes of absorption that all tables of scattered light in a cloth share, and interpolation between them.
//!
//! Energies are tabulated at 8 absorptions sigma [1/um] and interpolated linearly in `v = 1 / (1 + sigma L)`,
//! with L a mean path through a ply [um]. Deep colors, such as the red channel of denim's warp, lie between
//! 0.04 and 3 per um.

use crate::cloth::color::color_of;
use crate::math::simd::{max, min};

/// Nodes of absorption [1/um]; the last one represents infinite absorption. Between the nodes f is linear in
/// `1 / (1 + sigma L)`, with L a mean path through a ply [um]. The nodes are dense near 0, where multiply
/// scattered light falls as the square root of the absorption (Kubelka and Munk).
pub const SIGMA_PER_UM: [f32; SIGMAS] = [0.0, 0.0006, 0.002, 0.005, 0.0115, 0.028, 0.085, 3.0];
/// Number of nodes of absorption.
pub const SIGMAS: usize = 8;
/// L, a mean path through a ply [um].
pub(crate) const LENGTH_UM: f32 = color_of::LENGTH_UM as f32;
/// v at the nodes; the last node represents infinite absorption.
const V: [f32; SIGMAS] = {
    let mut v = [0.0; SIGMAS];
    let mut node = 0;
    while node < SIGMAS - 1 {
        v[node] = 1.0 / (1.0 + SIGMA_PER_UM[node] * LENGTH_UM);
        node += 1;
    }
    v
};

/// Index of the node below an absorption, and the fraction of the way to the next. Values outside of 0 to 1e6
/// are clamped; NaN counts as 0.
#[inline(always)]
pub(crate) fn node_of(sigma: f32) -> (usize, f32) {
    let sigma = min(max(sigma, 0.0), 1e6);
    let v = 1.0 / (1.0 + sigma * LENGTH_UM);
    let mut node = 0;
    for at in &SIGMA_PER_UM[1..SIGMAS - 1] {
        node += usize::from(*at <= sigma);
    }
    (node, (V[node] - v) * PER_V[node])
}

/// Inverse of the difference between v at a node and v at the next.
const PER_V: [f32; SIGMAS] = {
    let mut per = [0.0; SIGMAS];
    let mut node = 0;
    while node < SIGMAS - 1 {
        per[node] = 1.0 / (V[node] - V[node + 1]);
        node += 1;
    }
    per
};

/// Interpolation weights of all nodes at an absorption, clamped to the range of the nodes.
pub(crate) fn sigma_weights(sigma: f32) -> [f32; SIGMAS] {
    let v = |sigma: f32| 1.0 / (1.0 + sigma * LENGTH_UM);
    let sigma = sigma.max(0.0).min(SIGMA_PER_UM[SIGMAS - 1]);
    let node = SIGMA_PER_UM.partition_point(|node| *node <= sigma).clamp(1, SIGMAS - 1) - 1;
    let [low, high] = [SIGMA_PER_UM[node], SIGMA_PER_UM[node + 1]].map(v);
    let t = (low - v(sigma)) / (low - high);
    std::array::from_fn(|i| {
        if i == node {
            1.0 - t
        } else if i == node + 1 {
            t
        } else {
            0.0
        }
    })
}
