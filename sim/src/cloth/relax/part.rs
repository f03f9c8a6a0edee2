//! Parting of strands that overlap a little, without forces: each of two moves by half of their overlap, and
//! takes its neighbors along the strand with it.

use super::contacts::{Middles, contacts, pairs};
use super::elements::{Elements, Nodes};

/// Number of nodes to each side of an element that move with it.
const BESIDE: i64 = 1;
/// Distance that nodes may move before neighbors are searched again, over the largest radius.
const SKIN: f64 = 0.2;
/// Largest move of a node in a round, over the largest radius: strands must not pass through each other.
const MOVE: f64 = 0.05;

/// Parts strands that overlap by more than `limit` times their mean radius, in this many rounds at most.
pub fn part(cloth: &mut Elements, limit: f64, rounds: usize) {
    let nodes = Nodes::new(cloth);
    let mut x = cloth.coordinates();
    let largest = cloth.chains.iter().map(|c| c.radius_um).fold(0.0, f64::max);
    let skin_um = SKIN * largest;
    let (mut middles, mut found) = (Middles::default(), Vec::new());
    let mut list = pairs(cloth, &nodes, &x, skin_um);
    let mut searched = x.clone();
    for _ in 0..rounds {
        middles.fill(&nodes, &x);
        contacts(&nodes, &middles, &list, &x, 0.0, &mut found);
        let mut moves = vec![[0.0; 4]; nodes.len()];
        let mut is_apart = true;
        for contact in &found {
            let pair = list[contact.pair as usize];
            let reach = 0.5 * (nodes.radius[pair.a as usize] + nodes.radius[pair.b as usize]);
            let excess = contact.overlap - limit * reach;
            if excess <= 0.0 {
                continue;
            }
            is_apart = false;
            for (element, place, sign) in [(pair.a, contact.s, 0.5), (pair.b, contact.t, -0.5)] {
                let chain = nodes.chain[element as usize] as usize;
                let (first, count) = (nodes.first[chain], nodes.first[chain + 1] - nodes.first[chain]);
                for by in -BESIDE..=BESIDE + 1 {
                    let at = first + (element as i64 - first as i64 + by).rem_euclid(count as i64) as usize;
                    // A parabola of weights about the contact.
                    let weight = 1.0 - ((by as f64 - place) / (BESIDE + 1) as f64).powi(2);
                    let to = &mut moves[at];
                    (0..3).for_each(|k| to[k] += weight * sign * excess * contact.normal[k]);
                    to[3] += weight;
                }
            }
        }
        if is_apart {
            break;
        }
        for (p, moved) in x.chunks_exact_mut(3).zip(&moves) {
            let moved = std::array::from_fn::<f64, 3, _>(|k| moved[k] / moved[3].max(1.0));
            let length = moved.iter().map(|v| v * v).sum::<f64>().sqrt();
            let less = (MOVE * largest / length.max(1e-12)).min(1.0);
            (0..3).for_each(|k| p[k] += less * moved[k]);
        }
        let is_far =
            |(p, q): (&[f64], &[f64])| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>() > 0.25 * skin_um * skin_um;
        if x.chunks_exact(3).zip(searched.chunks_exact(3)).any(is_far) {
            list = pairs(cloth, &nodes, &x, skin_um);
            searched.copy_from_slice(&x);
        }
    }
    for (c, chain) in cloth.chains.iter_mut().enumerate() {
        for (i, p) in chain.points_um.iter_mut().enumerate() {
            *p = Nodes::at(&x, nodes.first[c] + i);
        }
    }
}
