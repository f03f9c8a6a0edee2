//! Minimization of the energy of a cloth by L-BFGS (Nocedal and Wright 2006, algorithm 7.5), with
//! backtracking to Armijo's condition and a limit on the length of a step.
//!
//! The initial approximation of the inverse Hessian is that of [`System::renew`], renewed as the cloth moves.

use super::energy::System;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Number of past steps in the approximation of the inverse Hessian.
const MEMORY: usize = 10;
/// Number of steps after which the Hessian is approximated again.
const RENEW: usize = 10;
/// Fraction of the predicted decrease that a step must achieve (Armijo condition).
const DECREASE: f64 = 1e-4;
/// Maximum move of a coordinate in a step, over the mean radius.
const MAX_MOVE: f64 = 0.15;
/// Number of lengths that are tried along a direction.
const TRIES: usize = 20;
/// Part of tension over radius that is added to the diagonal of the Hessian, for motions that take no energy:
/// at first, and the largest after which the search ends.
const DAMPING: [f64; 2] = [1e-6, 1e3];

/// Result of a minimization.
#[derive(Clone, Copy, Debug)]
pub struct Minimum {
    /// Maximum absolute component of the gradient, over the tension.
    pub slope: f64,
    /// Number of steps.
    pub steps: usize,
}

/// Step of the coordinates, change of the gradient, and inverse of their product.
type Past = (Vec<f64>, Vec<f64>, f64);

/// Minimizes the energy from the starting point `x`, which is replaced by the minimum. The minimization ends
/// when no component of the gradient exceeds `slope` times the tension, after `steps` steps, or when no step
/// decreases the energy. `go_on` gets the largest component and the point at every step; the result is `None`
/// once it returns `false`.
pub fn minimize(
    system: &mut System<'_>,
    x: &mut [f64],
    slope: f64,
    steps: usize,
    go_on: &mut dyn FnMut(f64, &[f64]) -> bool,
) -> Option<Minimum> {
    let n = x.len();
    let (tension, max_move) = (system.tension, MAX_MOVE * system.radius_um);
    let mut gradient = vec![0.0; n];
    let mut value = system.energy(x, &mut gradient);
    let mut memory: VecDeque<Past> = VecDeque::new();
    let (mut trial, mut new_gradient, mut direction) = (x.to_vec(), vec![0.0; n], vec![0.0; n]);
    let (mut since, mut damping) = (usize::MAX, DAMPING[0]);
    for step in 0..steps {
        let force = largest(&gradient) / tension;
        if force <= slope {
            return Some(Minimum { slope: force, steps: step });
        }
        if !go_on(force, x) {
            return None;
        }
        if since >= RENEW {
            system.renew(x, damping);
            since = 0;
        }
        since += 1;
        descend(system, &gradient, &memory, &mut direction);
        let mut downhill = dot(&direction, &gradient);
        if downhill >= 0.0 || downhill.is_nan() {
            memory.clear();
            descend(system, &gradient, &memory, &mut direction);
            downhill = dot(&direction, &gradient);
        }
        let mut length = (max_move / largest(&direction)).min(1.0);
        if length < 1.0 {
            // Nodes that would move far move less, and the others do not wait for them, unless all together
            // take more energy away.
            clamp(&direction, max_move, &mut trial);
            let clamped = dot(&trial, &gradient);
            if clamped < 0.1 * length * downhill {
                std::mem::swap(&mut trial, &mut direction);
                (length, downhill) = (1.0, clamped);
            }
        }
        let mut is_found = false;
        for _ in 0..TRIES {
            let parts = trial.par_chunks_mut(PART).zip(x.par_chunks(PART)).zip(direction.par_chunks(PART));
            parts.for_each(|((t, x), d)| (0..t.len()).for_each(|i| t[i] = x[i] + length * d[i]));
            let new = system.energy(&trial, &mut new_gradient);
            if new <= value + DECREASE * length * downhill + 1e-13 * value.abs() {
                remember(&mut memory, [&*x, &trial], [&gradient, &new_gradient]);
                x.copy_from_slice(&trial);
                std::mem::swap(&mut gradient, &mut new_gradient);
                value = new;
                is_found = true;
                break;
            }
            // The secant of the slope along the direction.
            let slope = dot(&new_gradient, &direction);
            length *= if slope > 0.0 { (downhill / (downhill - slope)).clamp(0.1, 0.7) } else { 0.5 };
        }
        if is_found {
            damping = (0.9 * damping).max(DAMPING[0]);
        } else {
            memory.clear();
            since = usize::MAX;
            damping *= 100.0;
            if damping > DAMPING[1] {
                return Some(Minimum { slope: force, steps: step });
            }
        }
    }
    Some(Minimum { slope: largest(&gradient) / tension, steps })
}

/// The direction of L-BFGS (Nocedal and Wright 2006, algorithm 7.4).
fn descend(system: &mut System<'_>, gradient: &[f64], memory: &VecDeque<Past>, direction: &mut [f64]) {
    direction.iter_mut().zip(gradient).for_each(|(d, g)| *d = -g);
    let mut alphas = [0.0; MEMORY];
    for ((s, y, per), alpha) in memory.iter().zip(&mut alphas).rev() {
        *alpha = per * dot(s, direction);
        add(direction, -*alpha, y);
    }
    system.solve(direction);
    for ((s, y, per), alpha) in memory.iter().zip(alphas) {
        let beta = per * dot(y, direction);
        add(direction, alpha - beta, s);
    }
}

/// Adds a step; the vectors of the oldest are reused.
fn remember(memory: &mut VecDeque<Past>, [x, new_x]: [&[f64]; 2], [gradient, new_gradient]: [&[f64]; 2]) {
    let oldest = if memory.len() == MEMORY { memory.pop_front() } else { None };
    let (mut s, mut y, _) = oldest.unwrap_or_else(|| (vec![0.0; x.len()], vec![0.0; x.len()], 0.0));
    subtract(&mut s, new_x, x);
    subtract(&mut y, new_gradient, gradient);
    let sy = dot(&s, &y);
    if sy > 1e-10 * (dot(&y, &y) * dot(&s, &s)).sqrt() {
        memory.push_back((s, y, 1.0 / sy));
    }
}

/// Shortens the moves of nodes to `max_move`.
fn clamp(direction: &[f64], max_move: f64, clamped: &mut [f64]) {
    clamped.copy_from_slice(direction);
    for node in clamped.chunks_exact_mut(3) {
        let longest = largest(node);
        if longest > max_move {
            node.iter_mut().for_each(|d| *d *= max_move / longest);
        }
    }
}

/// Length of the parts that are summed one by one, whatever the number of threads.
const PART: usize = 1 << 14;

fn largest(a: &[f64]) -> f64 {
    a.iter().fold(0.0f64, |m, a| m.max(a.abs()))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let of = |(a, b): (&[f64], &[f64])| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    if a.len() <= PART {
        return of((a, b));
    }
    a.par_chunks(PART).zip(b.par_chunks(PART)).map(of).collect::<Vec<f64>>().iter().sum()
}

fn add(a: &mut [f64], by: f64, b: &[f64]) {
    let of = |(a, b): (&mut [f64], &[f64])| a.iter_mut().zip(b).for_each(|(a, b)| *a += by * b);
    a.par_chunks_mut(PART).zip(b.par_chunks(PART)).for_each(of);
}

fn subtract(to: &mut [f64], a: &[f64], b: &[f64]) {
    let of = |((to, a), b): ((&mut [f64], &[f64]), &[f64])| (0..to.len()).for_each(|i| to[i] = a[i] - b[i]);
    to.par_chunks_mut(PART).zip(a.par_chunks(PART)).zip(b.par_chunks(PART)).for_each(of);
}
