//! Latitudes of tables over a fiber's incident light: the measured nodes, and the uniform nodes for lookups.
//!
//! The axis is `x = (2 / pi) asin(2 theta / pi)` in [-1, 1], whose uniform nodes are denser towards the
//! poles, by the root of the distance: Fresnel's reflectance rises to 1 there. Measuring starts at 17 uniform
//! nodes. Where the cubic through the two neighbors on either side misses the measurement at a node, both
//! parts beside it are halved, down to the spacing of the lookup nodes. Those are 513 uniform ones, from
//! cubics through the four measured nodes about each, and linear between.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_2};

/// Parts of the axis at the start of measuring, and between lookup nodes.
const FIRST: usize = 16;
pub(super) const PARTS: usize = 512;
/// Distance of the last nodes from the poles [rad]: at a pole light has no azimuth.
const FROM_POLE: f32 = 1e-5;

/// Latitude of a lookup node [rad].
pub(super) fn latitude(node: usize) -> f32 {
    let x = 2.0 * node as f64 / PARTS as f64 - 1.0;
    let theta = std::f64::consts::FRAC_PI_2 * (std::f64::consts::FRAC_PI_2 * x).sin();
    (theta as f32).clamp(FROM_POLE - FRAC_PI_2, FRAC_PI_2 - FROM_POLE)
}

/// The part, of `parts` uniform ones of the axis, that contains the latitude `theta` [rad], and the position
/// within it. NaN counts as the first.
pub(super) fn place(theta: f32, parts: usize) -> (usize, f32) {
    let sin = (FRAC_2_PI * theta).max(-1.0).min(1.0);
    let x = FRAC_2_PI * sin.asin();
    let at = (0.5 * (x + 1.0) * parts as f32).max(0.0).min(parts as f32);
    let k = (at as usize).min(parts - 1);
    (k, at - k as f32)
}

/// Measures at as many nodes as needed: `measure` at a latitude [rad] gives a measurement, whose `values`
/// should be known. Returns nodes and measurements, in order. The cubic without a node may miss `most_missed`
/// of it, seven times the error between nodes of the cubic with it.
pub(super) fn measured<T>(
    measure: impl Fn(f32) -> T,
    values: impl Fn(&T) -> Vec<f64>,
    most_missed: f64,
) -> Vec<(usize, T)> {
    let at = |node: usize| (node, measure(latitude(node)));
    let mut all: Vec<(usize, T)> = (0..=FIRST).map(|k| at(k * (PARTS / FIRST))).collect();
    loop {
        let known: Vec<Vec<f64>> = all.iter().map(|(_, t)| values(t)).collect();
        let missed = |k: usize| {
            let others = four_about(k, all.len());
            let weights = lagrange(others.map(|j| all[j].0), all[k].0 as f64);
            let off = |n: usize| (0..4).map(|m| weights[m] * known[others[m]][n]).sum::<f64>() - known[k][n];
            (0..known[k].len()).map(off).any(|off| off.abs() > most_missed)
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

/// Four nodes about a point of the axis, in uniform parts, and their weights: the cubic through them.
pub(super) fn cubic<T>(all: &[(usize, T)], node: usize) -> [(usize, f64); 4] {
    let next = all.partition_point(|(at, _)| *at < node);
    let first = next.saturating_sub(2).min(all.len() - 4);
    let weights = lagrange(std::array::from_fn(|m| all[first + m].0), node as f64);
    std::array::from_fn(|m| (first + m, weights[m]))
}

/// Lagrange's polynomials of four nodes.
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

    /// A function that rises within 2 degrees of one pole, and one with a kink, are known to 4e-4 between
    /// nodes; a smooth one takes no more than the first nodes.
    #[test]
    fn nodes_are_where_they_are_needed() {
        let slow = |theta: f32| f64::from(theta).cos();
        let steep = |theta: f32| (-(f64::from(FRAC_PI_2 - theta) / 0.03)).exp();
        let kink = |theta: f32| (f64::from(theta) - 0.4).max(0.0);
        for (name, f, most) in [("slow", &slow as &dyn Fn(f32) -> f64, 33), ("steep", &steep, 60), ("kink", &kink, 60)]
        {
            let all = measured(f, |v| vec![*v], 1e-3);
            assert!(all.len() <= most, "{name}: {} nodes", all.len());
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
