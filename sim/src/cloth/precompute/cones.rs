//! Multiple scattering among yarns of one kind alone, from paths: its energies and its cones.
//!
//! Parallel yarns scatter light into a cone about their common axis. A cone has a width, from the median
//! distance of paths from it, an energy as a polynomial of the incident direction, and norms that make it
//! reciprocal (Sinkhorn's scaling).

use super::paths::Escaped;
use super::regression::RegressionSums;
use plywave::cloth::light::{CLASSES, CLASSES_A_KIND, Cone, FEW, Few, NORMS, Poly, SIGMAS, TERMS, few};
use std::f64::consts::PI;

/// Node of absorption at which cones are made reciprocal: clear fibers, which have most of this light.
const NODE: usize = 0;
/// Node of absorption of the widths: light colors, between clear and dark fibers.
const WIDTH_NODE: usize = 1;
/// Bins of the distance from the cone, 0 to 2.
const BINS: usize = 400;
/// Minimum and maximum width.
const WIDTHS: [f64; 2] = [0.02, 2.0];
/// Steps of Sinkhorn's scaling; it has converged before the last ones.
const STEPS: usize = 60;
/// Steps of integrals over the sine of the angle to the axis, and over the angle about the axis.
const SINES: usize = 800;
const ANGLES: usize = 32;

/// Regression sums over paths among parallel yarns.
pub(super) struct Parallel {
    /// `[side][class][sent up, down]`: energies that leave up and down by absorption.
    leaves: [Vec<RegressionSums<FEW>>; 2],
    /// `[side]`: the terms of all beams.
    beams: [RegressionSums<TERMS>; 2],
    /// `[side][class][sent up, down]`: occluded energy times the terms of both polynomials.
    caught: [Vec<[[f64; FEW]; TERMS]>; 2],
    /// `[kind][leaves up, down][bin]`: energies by distance from the cone.
    from_cone: [[[f64; BINS]; 2]; 2],
}

impl Parallel {
    pub fn none() -> Parallel {
        Parallel {
            leaves: [0, 1].map(|_| (0..2 * CLASSES).map(|_| RegressionSums::new(2 * SIGMAS)).collect()),
            beams: [0, 1].map(|_| RegressionSums::new(4)),
            caught: [0, 1].map(|_| vec![[[0.0; FEW]; TERMS]; 2 * CLASSES]),
            from_cone: [[[0.0; BINS]; 2]; 2],
        }
    }

    /// Adds a beam from a side at the terms `t`, with its path unless it was lost.
    pub fn add_beam(&mut self, side: usize, t: &Poly, path: Option<&Escaped>) {
        self.beams[side].add_sample(t);
        let Some(path) = path.filter(|path| path.orders > 0) else { return };
        let few = few(t);
        for (cause, caught) in path.caught.iter().enumerate() {
            for (row, t) in self.caught[side][2 * path.class + cause].iter_mut().zip(t) {
                row.iter_mut().zip(&few).for_each(|(sum, few)| *sum += f64::from(t * few * caught[NODE]));
            }
        }
    }

    /// Adds a path from direction `a` if it has hit several plies. `axes` are the axes of the cloth, 0 or 1,
    /// along which the kinds of yarns run.
    pub fn add(&mut self, side: usize, (a, t): ([f32; 3], &Poly), axes: [usize; 2], path: &Escaped) {
        if path.orders < 2 {
            return;
        }
        let (kind, half) = (path.class / CLASSES_A_KIND, usize::from(!path.up));
        let of_cause = &mut self.leaves[side][2 * path.class + usize::from(!path.sent_up)];
        let few = few(t);
        of_cause.add_sample(&few);
        if path.kinds != 1 << kind {
            return;
        }
        for i in 0..SIGMAS {
            of_cause.add(half * SIGMAS + i, path.weight[kind][i] / path.first[i].max(1e-30), &few);
        }
        let energy = path.weight[kind][WIDTH_NODE];
        let v = (path.d[axes[kind]] + a[axes[kind]]).abs();
        let bin = (f64::from(v) * BINS as f64 / 2.0) as usize;
        self.from_cone[kind][half][bin.min(BINS - 1)] += f64::from(energy);
    }

    pub fn join(&mut self, other: &Parallel) {
        for side in 0..2 {
            self.leaves[side].iter_mut().zip(&other.leaves[side]).for_each(|(sums, other)| sums.join(other));
            self.beams[side].join(&other.beams[side]);
            let others = other.caught[side].as_flattened().as_flattened();
            for (sum, other) in self.caught[side].as_flattened_mut().as_flattened_mut().iter_mut().zip(others) {
                *sum += other;
            }
        }
        let others = other.from_cone.as_flattened().as_flattened();
        for (sum, other) in self.from_cone.as_flattened_mut().as_flattened_mut().iter_mut().zip(others) {
            *sum += other;
        }
    }

    /// `[class][sent up, down][leaves up, down][sigma]`: energy that leaves over the occluded energy.
    pub fn leaves(&self, side: usize) -> Vec<[Few; SIGMAS]> {
        let all: Vec<Few> = self.leaves[side].iter().flat_map(RegressionSums::solve).collect();
        all.as_chunks::<SIGMAS>().0.to_vec()
    }

    /// `[2 kind + leaves up, down]`: mean energies, computed from the same polynomials of occluded and
    /// leaving energy as shading uses, so that the light that cones distribute is reciprocal in total.
    fn energies(&self, side: usize) -> Vec<Poly> {
        let leaves = self.leaves(side);
        let mut sums = RegressionSums::new(4);
        sums.join(&self.beams[side]);
        for class in 0..CLASSES {
            for (cause, half) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let of = leaves[4 * class + 2 * cause + half][NODE];
                let caught = &self.caught[side][2 * class + cause];
                let energy = caught.map(|row| row.iter().zip(&of).map(|(sum, c)| sum * f64::from(*c)).sum());
                sums.add_sums(2 * (class / CLASSES_A_KIND) + half, &energy);
            }
        }
        sums.solve()
    }

    /// Width of the cone of a kind and half, from the median of the distance from the cone.
    fn width(&self, kind: usize, half: usize) -> f64 {
        let bins = &self.from_cone[kind][half];
        let all: f64 = bins.iter().sum();
        let mut sum = 0.0;
        let median = bins.iter().position(|energy| {
            sum += energy;
            sum >= 0.5 * all
        });
        let median = 2.0 * (median.unwrap_or(BINS) as f64 + 0.5) / BINS as f64;
        let [mut low, mut high] = WIDTHS;
        for _ in 0..30 {
            let middle = (low * high).sqrt();
            if share_within(median, middle) > 0.5 { low = middle } else { high = middle }
        }
        low
    }
}

/// Share of light within a distance from a cone of this width. Directions of incidence are distributed like
/// the beams, half uniform and half cosine-weighted. Light is weighted by `sqrt(1 - b^2)`, b its sine along
/// the axis.
fn share_within(distance: f64, width: f64) -> f64 {
    const STEPS: usize = 100;
    let cone = Cone { width: width as f32, ..Cone::NONE };
    let sine = |i: usize| (2 * i + 1) as f64 / STEPS as f64 - 1.0;
    let mut within = 0.0;
    let mut beams = 0.0;
    for a in (0..STEPS).map(sine) {
        let (mut near, mut all) = (0.0, 0.0);
        for b in (0..STEPS).map(sine) {
            let light = f64::from(cone.density((a + b) as f32)) * (1.0 - b * b).sqrt();
            all += light;
            if (a + b).abs() < distance {
                near += light;
            }
        }
        let beam = 0.5 + 2.0 / PI * (1.0 - a * a).sqrt();
        (within, beams) = (within + beam * near / all, beams + beam);
    }
    within / beams
}

/// The cones `[side][kind][leaves up, down]` of all sums.
pub(super) fn cones(found: &Parallel, axes: [usize; 2]) -> [[[Cone; 2]; 2]; 2] {
    let energies = [0, 1].map(|side| found.energies(side));
    let mut cones = [[[Cone::NONE; 2]; 2]; 2];
    for kind in 0..2 {
        for half in 0..2 {
            let width = found.width(kind, half) as f32;
            for side in 0..2 {
                cones[side][kind][half] = Cone { width, energy: energies[side][2 * kind + half], ..Cone::NONE };
            }
            // Reflected light is reciprocal to itself; transmitted light to that of the other side.
            let pairs: &[[usize; 2]] = if half == 0 { &[[0, 0], [1, 1]] } else { &[[0, 1]] };
            for [from, to] in pairs {
                let pair = [cones[*from][kind][half], cones[*to][kind][half]];
                [cones[*from][kind][half], cones[*to][kind][half]] = balanced(pair, axes[kind]);
            }
        }
    }
    cones
}

/// The cones of two sides with their norms N, where each N is the integral over the other cone (Sinkhorn's
/// scaling). A solution exists if as much light goes one way as the other, that is if `integral E cos`
/// agrees. Paths find it to a percent, so E of the second cone is scaled to match the first.
fn balanced(mut cones: [Cone; 2], axis: usize) -> [Cone; 2] {
    let sine = |i: usize| -1.0 + (2 * i + 1) as f64 / SINES as f64;
    // E cos b, integrated about the axis.
    let weights_of = |cone: &Cone| {
        let weight = |i: usize| {
            let s = sine(i);
            let cos = (1.0 - s * s).sqrt();
            let angle = |k: usize| {
                let (up, across) = (PI * (k as f64 + 0.5) / ANGLES as f64).sin_cos();
                let mut b = [0.0, 0.0, (cos * up) as f32];
                (b[axis], b[1 - axis]) = (s as f32, (cos * across) as f32);
                f64::from(cone.energy(b)) * cos * up
            };
            (0..ANGLES).map(angle).sum::<f64>() * PI / ANGLES as f64 * 2.0 / SINES as f64
        };
        (0..SINES).map(weight).collect::<Vec<f64>>()
    };
    let [first, second] = cones.each_ref().map(|cone| weights_of(cone).iter().sum::<f64>());
    if first > 0.0 && second > 0.0 {
        cones[1].energy = cones[1].energy.map(|term| term * (first / second) as f32);
    }
    let weights = cones.each_ref().map(weights_of);
    let mut both = cones;
    let node = |i: usize| 2.0 * i as f64 / (NORMS - 1) as f64 - 1.0;
    let integral = |other: &Cone, weights: &[f64], s: f64| -> f64 {
        let at = |i: usize| {
            let q = other.density((s + sine(i)) as f32);
            weights[i] * f64::from(q / other.norm(sine(i) as f32))
        };
        (0..SINES).map(at).sum()
    };
    for step in 0..STEPS {
        for of in 0..2 {
            let other = both[1 - of];
            for i in 0..NORMS {
                let wanted = integral(&other, &weights[1 - of], node(i)).max(1e-5) as f32;
                let own = &mut both[of].norm[i];
                // The geometric mean converges even if both cones are the same; the last steps are exact.
                *own = if step + 2 < STEPS { (*own * wanted).sqrt() } else { wanted };
            }
            if cones[0] == cones[1] {
                both[1 - of].norm = both[of].norm;
            }
        }
    }
    both
}
