//! Relaxation of a cloth: chains of digital elements that minimize their energy.
//!
//! A strand (a ply or a bundle of filaments) is a closed chain of nodes (Wang and Sun 2001; Zhou, Sun and
//! Wang 2004). Its energy has terms for its tension T (or for a held length), for bending, for the cohesion
//! of its yarn, for friction, and for contact with every strand that it overlaps:
//! ```text
//! E = sum T L + B/2 sum kappa^2 l + c/2 sum l |p - mean p|^2 + sum l F(mean p) + k/2 sum overlap^2
//! ```
//! L is the chain's length, l the length of an element, kappa the curvature and c / T the cohesion, which
//! holds the strands of a yarn together (interlacing, friction). F holds the axis of a yarn at its line
//! ([`Hold`]).
//! Elements are straight; two of them overlap by the sum of their radii minus their distance. The distance is
//! softened for parallel elements, so that it is differentiable everywhere.
//! A pressed cloth lies between two planes, with the same contact energy as between strands.
//! The result does not depend on the number of threads: contacts are found in parallel and added in order.

mod contacts;
mod elements;
mod energy;
mod factor;
mod minimize;
mod part;

use contacts::{Middles, contacts, pairs};
pub(super) use elements::{Chain, Elements, Hold, Nodes, Section, Station};
use energy::System;
use minimize::minimize;
pub(super) use part::part;

/// A stage of the relaxation.
struct Stage {
    /// Contact stiffness times mean radius over mean tension.
    stiffness: f64,
    /// Force at which it ends, over the tension.
    force: f64,
    /// Maximum number of steps.
    steps: usize,
    /// Share of the work at its end, on average.
    done: f64,
}

const STAGES: [Stage; 4] = [
    Stage { stiffness: 4.0, force: 1e-2, steps: 600, done: 0.25 },
    Stage { stiffness: 20.0, force: 1e-2, steps: 1000, done: 0.5 },
    Stage { stiffness: 100.0, force: 1e-2, steps: 1000, done: 0.65 },
    Stage { stiffness: 500.0, force: 1e-5, steps: 4000, done: 1.0 },
];
/// Forces at which the stages of [`Rest::Near`] end: over their own before the last, and over the tension.
const NEAR_STAGES: f64 = 3.0;
const NEAR_FORCE: f64 = 1e-3;

/// How exactly forces are balanced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rest {
    /// To 1e-5 of the tension.
    Full,
    /// To 1e-3 of the tension.
    Near,
}
/// Maximum overlap of two strands of a cloth over their mean radius.
pub const MAX_OVERLAP: f64 = 0.02;

/// Result of a relaxation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxed {
    /// Number of nodes.
    pub nodes: usize,
    /// Number of steps of the minimization.
    pub steps: usize,
    /// Maximum unbalanced force on a node, over the mean tension of a strand.
    pub force: f64,
    /// Maximum overlap of two strands over their mean radius.
    pub overlap: f64,
}

/// Relaxes a cloth in stages of increasing contact stiffness. `go_on` is called at every step with the share
/// of the work that is done, an estimate that never goes down; the result is `None` once it returns `false`.
pub(super) fn relax(cloth: &mut Elements, rest: Rest, go_on: &(dyn Fn(f64) -> bool + Sync)) -> Option<Relaxed> {
    follow(cloth, rest, &mut |share, _| go_on(share))
}

/// As [`relax`]; `go_on` gets the coordinates of all nodes, too.
pub(super) fn follow(cloth: &mut Elements, rest: Rest, go_on: &mut dyn FnMut(f64, &[f64]) -> bool) -> Option<Relaxed> {
    let mut system = System::new(cloth);
    let mut x = cloth.coordinates();
    let mut relaxed = Relaxed { nodes: system.nodes.len(), steps: 0, force: f64::INFINITY, overlap: 0.0 };
    let (mut before, mut share) = (0.0, 0.0f64);
    for stage in STAGES {
        let near = (NEAR_STAGES * stage.force).max(NEAR_FORCE);
        let force = if rest == Rest::Near { near } else { stage.force };
        system.stiffen(stage.stiffness, before < 0.5);
        let mut first = None;
        let mut report = |now: f64, x: &[f64]| {
            let first = *first.get_or_insert(now);
            let part = (first / now).ln() / (first / force).ln().max(1e-9);
            share = share.max(before + (stage.done - before) * part.clamp(0.0, 1.0));
            go_on(share, x)
        };
        let minimum = minimize(&mut system, &mut x, force, stage.steps, &mut report)?;
        relaxed.steps += minimum.steps;
        relaxed.force = minimum.slope;
        before = stage.done;
    }
    let nodes = system.nodes;
    // The planes center a pressed cloth; any other is moved to mean height 0.
    let height = match cloth.thickness_um {
        Some(_) => 0.0,
        None => x.iter().skip(2).step_by(3).sum::<f64>() / nodes.len() as f64,
    };
    for (c, chain) in cloth.chains.iter_mut().enumerate() {
        for (i, p) in chain.points_um.iter_mut().enumerate() {
            *p = Nodes::at(&x, nodes.first[c] + i);
            p[2] -= height;
        }
    }
    relaxed.overlap = overlap(cloth);
    Some(relaxed)
}

/// Maximum overlap of two strands over their mean radius.
pub(super) fn overlap(cloth: &Elements) -> f64 {
    let nodes = Nodes::new(cloth);
    let x = cloth.coordinates();
    let list = pairs(cloth, &nodes, &x, 0.0);
    let (mut middles, mut found) = (Middles::default(), Vec::new());
    middles.fill(&nodes, &x);
    contacts(&nodes, &middles, &list, &x, 0.0, &mut found);
    let of = |contact: &contacts::Contact| {
        let pair = &list[contact.pair as usize];
        contact.overlap / (0.5 * (nodes.radius[pair.a as usize] + nodes.radius[pair.b as usize]))
    };
    found.iter().map(of).fold(0.0, f64::max)
}

/// Elements that may touch, with the translation of the second.
#[cfg(test)]
pub(super) fn touching(cloth: &Elements, x: &[f64]) -> Vec<(u32, u32, [f64; 2])> {
    pairs(cloth, &Nodes::new(cloth), x, 0.0).into_iter().map(|pair| (pair.a, pair.b, pair.by)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::woven::woven;
    use plywave::cloth::Lattice;
    use plywave_textile::{ClothSpec, ClothWeave};

    /// Chains across a sheared cell; `wave` bends them [um].
    fn chains(wave: f64, heights: [f64; 3]) -> Elements {
        let lattice = Lattice::new([[100.0, 10.0], [0.0, 120.0]]).unwrap();
        let chain = |z: f64, shift: [i32; 2], length_um| {
            let v = lattice.vector(shift);
            let n = 9;
            let points_um = (0..n)
                .map(|i| {
                    let t = f64::from(i) / f64::from(n);
                    let bend = [wave * (7.0 * t).sin(), 1.7 * wave * (9.0 * t).cos()];
                    [t * v[0] + 20.0 + bend[0], t * v[1] + 30.0, z + bend[1]]
                })
                .collect();
            Chain { points_um, shift, radius_um: 20.0, tension: 1.3, bending: 500.0, length_um }
        };
        let held = (wave > 0.0).then_some(130.0);
        let chains =
            vec![chain(heights[0], [1, 0], None), chain(heights[1], [0, 1], held), chain(heights[2], [1, 0], None)];
        let hold = |slip_um| Hold { across: [0.0, 1.0], line_um: 29.0, slip_um, force_per_um: 0.01 };
        let section = |i: usize| Section {
            station: vec![(0, i, [0, 0]), (2, i, [0, 0])],
            cohesion: 0.01,
            length_um: 10.0,
            hold: Some(hold(if i < 5 { 40.0 } else { 2.0 })),
        };
        Elements { lattice, chains, sections: (0..9).map(section).collect(), thickness_um: Some(70.0) }
    }

    #[test]
    fn the_gradient_is_that_of_the_energy() {
        let cloth = chains(3.0, [0.0, 15.0, 25.0]);
        let mut system = System::new(&cloth);
        system.stiffen(5.0, true);
        let x = cloth.coordinates();
        let (mut g, mut other) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        system.energy(&x, &mut g);
        for i in 0..x.len() {
            let mut y = x.clone();
            y[i] += 1e-5;
            let up = system.energy(&y, &mut other);
            y[i] -= 2e-5;
            let down = system.energy(&y, &mut other);
            let want = (up - down) / 2e-5;
            assert!((g[i] - want).abs() < 1e-5 * (1.0 + want.abs()), "{i}: {} {want}", g[i]);
        }
    }

    /// Of straight chains that do not touch, the factorized matrix is the Hessian: it takes the change of the
    /// gradient along a direction back to the direction.
    #[test]
    fn the_matrix_of_straight_chains_is_the_hessian() {
        let mut cloth = chains(0.0, [-60.0, 0.0, 60.0]);
        cloth.thickness_um = None;
        let mut system = System::new(&cloth);
        system.stiffen(5.0, true);
        let x = cloth.coordinates();
        let along: Vec<f64> = (0..x.len()).map(|i| (0.7 * (i * i) as f64).sin()).collect();
        let mut slopes = [1e-4, -1e-4].map(|step| {
            let y: Vec<f64> = x.iter().zip(&along).map(|(x, v)| x + step * v).collect();
            let mut g = vec![0.0; x.len()];
            system.energy(&y, &mut g);
            g
        });
        let damping = 1e-3;
        assert!(system.renew(&x, damping));
        let own = damping * system.tension / system.radius_um;
        let [up, down] = &mut slopes;
        for i in 0..x.len() {
            // Sections past their slip have no stiffness in either.
            up[i] = (up[i] - down[i]) / 2e-4 + own * along[i];
        }
        system.solve(up);
        let off = up.iter().zip(&along).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3, "{off}");
    }

    fn start(weave: &str) -> Elements {
        let text = format!(
            "name = \"x\"\n[weave]\n{weave}\nends_per_cm = 24\npicks_per_cm = 24\n[warp]\nfiber = \"flax\"\n\
             count = \"20 tex\"\npacking = 0.6\nbundles = 1\n[weft]\nas = \"warp\"\n"
        );
        let spec = ClothSpec::parse(&text, "x").unwrap();
        let Some(ClothWeave::Woven(weave, yarns)) = spec.made() else { panic!("woven") };
        woven(&weave.draft().unwrap(), yarns, [1e4 / 24.0; 2]).unwrap().elements
    }

    /// Weaves come to rest in few steps, their axes near their lines; the share of the work that is done
    /// never goes down.
    #[test]
    fn weaves_come_to_rest() {
        let figure =
            "kind = \"draft\"\nrows = [\"X....XXXX.\", \"..X..XX.XX\", \"....X.XXXX\", \".X...XXX.X\", \"...X.X.XXX\"]";
        for (weave, most) in
            [("kind = \"plain\"", 300), ("kind = \"twill 3/1\"", 300), ("kind = \"satin 5/2\"", 400), (figure, 500)]
        {
            let mut cloth = start(weave);
            let shares = std::sync::Mutex::new(vec![0.0]);
            let go_on = |share| {
                let mut shares = shares.lock().unwrap();
                assert!(share >= *shares.last().unwrap() && share <= 1.0);
                shares.push(share);
                true
            };
            let relaxed = relax(&mut cloth, Rest::Full, &go_on).unwrap();
            println!("{weave}: {relaxed:?}");
            assert!(relaxed.force <= 1e-5 && relaxed.steps < most, "{weave}: {relaxed:?}");
            assert!(relaxed.overlap < MAX_OVERLAP);
            for section in &cloth.sections {
                let hold = section.hold.unwrap();
                let p = cloth.chains[section.station[0].0].points_um[section.station[0].1];
                let off = hold.across[0] * p[0] + hold.across[1] * p[1] - hold.line_um;
                assert!(off.abs() < 4.0 * hold.slip_um, "{weave}: {off} um");
            }
        }
    }
}
