//! Latitudes of tables over a fiber's incident light: the nodes that are measured, and the uniform nodes of
//! lookups.
//!
//! The axis is `x = (2 / pi) asin(2 theta / pi)` in [-1, 1]. Its uniform nodes are denser towards the poles,
//! by the root of the distance, because Fresnel's reflectance rises to 1 there. Measurement begins at 17
//! uniform nodes. Wherever the cubic through the two neighbors on either side of a node does not predict its
//! measurement, both intervals beside the node are halved, down to the spacing of the lookup nodes. There are
//! 513 uniform lookup nodes, computed by cubics through the four measured nodes around each; lookups are
//! linear between them.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_2};

/// Numbers of intervals of the axis: at the start of the measurement, and between lookup nodes.
const FIRST: usize = 16;
pub(crate) const PARTS: usize = 512;
/// Distance of the last nodes from the poles [rad], because light at a pole has no azimuth.
const FROM_POLE: f32 = 1e-5;

/// Latitude of a lookup node [rad].
pub(crate) fn latitude(node: usize) -> f32 {
    let x = 2.0 * node as f64 / PARTS as f64 - 1.0;
    let theta = std::f64::consts::FRAC_PI_2 * (std::f64::consts::FRAC_PI_2 * x).sin();
    (theta as f32).clamp(FROM_POLE - FRAC_PI_2, FRAC_PI_2 - FROM_POLE)
}

/// The interval, of `parts` uniform ones of the axis, that contains the latitude `theta` [rad], and the
/// fraction within it. NaN gives the first interval.
pub(crate) fn place(theta: f32, parts: usize) -> (usize, f32) {
    let sin = (FRAC_2_PI * theta).max(-1.0).min(1.0);
    let x = FRAC_2_PI * sin.asin();
    let at = (0.5 * (x + 1.0) * parts as f32).max(0.0).min(parts as f32);
    let k = (at as usize).min(parts - 1);
    (k, at - k as f32)
}

/// Measures at as many nodes as needed. `measure` returns a measurement at a latitude [rad], and `values` the
/// numbers of it that must be accurate. Returns the nodes and measurements in order. The cubic that leaves
/// out a node may differ from its measurement by `max_missed`; that is seven times the error, between nodes,
/// of the cubic through it.
pub(crate) fn measured<T>(
    measure: impl Fn(f32) -> T,
    values: impl Fn(&T) -> Vec<f64>,
    max_missed: f64,
) -> Vec<(usize, T)> {
    let at = |node: usize| (node, measure(latitude(node)));
    let mut all: Vec<(usize, T)> = (0..=FIRST).map(|k| at(k * (PARTS / FIRST))).collect();
    loop {
        let known: Vec<Vec<f64>> = all.iter().map(|(_, t)| values(t)).collect();
        let missed = |k: usize| {
            let others = four_about(k, all.len());
            let weights = lagrange(others.map(|j| all[j].0), all[k].0 as f64);
            let off = |n: usize| (0..4).map(|m| weights[m] * known[others[m]][n]).sum::<f64>() - known[k][n];
            (0..known[k].len()).map(off).any(|off| off.abs() > max_missed)
        };
        let halved: Vec<bool> = (0..all.len()).map(missed).collect();
        let new: Vec<usize> = (1..all.len())
            .filter(|k| (halved[k - 1] || halved[*k]) && all[*k].0 - all[k - 1].0 > 1)
            .map(|k| (all[k].0 + all[k - 1].0) / 2)
            .collect();
        if new.is_empty() {
            return all;
        }
        all.extend(new.into_iter().map(at));
        all.sort_by_key(|(node, _)| *node);
    }
}

/// The four nodes next to node `k` of `count`, without `k`.
fn four_about(k: usize, count: usize) -> [usize; 4] {
    let first = k.saturating_sub(2).min(count - 5);
    std::array::from_fn(|m| if first + m < k { first + m } else { first + m + 1 })
}

/// The four nodes around a lookup node, and their weights in the cubic through them.
pub(crate) fn cubic<T>(all: &[(usize, T)], node: usize) -> [(usize, f64); 4] {
    let next = all.partition_point(|(at, _)| *at < node);
    let first = next.saturating_sub(2).min(all.len() - 4);
    let weights = lagrange(std::array::from_fn(|m| all[first + m].0), node as f64);
    std::array::from_fn(|m| (first + m, weights[m]))
}

/// Values of the Lagrange polynomials of four nodes.
fn lagrange(nodes: [usize; 4], at: f64) -> [f64; 4] {
    let x = nodes.map(|n| n as f64);
    std::array::from_fn(|k| (0..4).filter(|j| *j != k).map(|j| (at - x[j]) / (x[k] - x[j])).product())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latitudes_are_found_again() {
        for node in 1..PARTS {
            let (k, t) = place(latitude(node), PARTS);
            assert!((k as f32 + t - node as f32).abs() < 1e-2, "{node}: {k} {t}");
        }
        assert_eq!(place(f32::NAN, PARTS), (0, 0.0));
        assert_eq!(place(2.0, PARTS), (PARTS - 1, 1.0));
    }

    /// A function that rises within 2 degrees of one pole, and one with a kink, are accurate to 4e-4 between
    /// nodes; a smooth function needs no more than the first nodes.
    #[test]
    fn nodes_are_where_they_are_needed() {
        let slow = |theta: f32| f64::from(theta).cos();
        let steep = |theta: f32| (-(f64::from(FRAC_PI_2 - theta) / 0.03)).exp();
        let kink = |theta: f32| (f64::from(theta) - 0.4).max(0.0);
        for (name, f, max_nodes) in
            [("slow", &slow as &dyn Fn(f32) -> f64, 33), ("steep", &steep, 60), ("kink", &kink, 60)]
        {
            let all = measured(f, |v| vec![*v], 1e-3);
            assert!(all.len() <= max_nodes, "{name}: {} nodes", all.len());
            let fine: Vec<f64> = (0..=PARTS).map(|n| cubic(&all, n).iter().map(|(k, w)| w * all[*k].1).sum()).collect();
            for i in 0..=3000 {
                let theta = FRAC_PI_2 * (i as f32 / 1500.0 - 1.0) * 0.999;
                let (k, t) = place(theta, PARTS);
                let got = fine[k] + f64::from(t) * (fine[k + 1] - fine[k]);
                assert!((got - f(theta)).abs() < 4e-4, "{name} at {theta}: {got}, want {}", f(theta));
            }
        }
    }
}
