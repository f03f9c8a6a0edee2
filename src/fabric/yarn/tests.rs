//! The reference implementation of the hit of a line and plies, and what follows from the conventions alone.

use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;

const R: f64 = 50.0;

fn yarn(plies: u32, ply_pitch_um: Option<f64>, handedness: Handedness) -> (Yarn, YarnShape) {
    let shape =
        YarnShape { plies, ply_radius_um: R, ply_pitch_um, handedness, spacing_um: 1000.0, crimp: 0.0, d_cut_um: 20.0 };
    (Yarn::new(&shape, &shape), shape)
}

fn dot64(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross64(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The reference implementation: a walk along the line in small steps until it is within R of the axis of a
/// ply, a true helix; its ply, theta_i and h there.
struct Twin {
    circle: f64,
    turns_per_um: f64,
    plies: u32,
}

impl Twin {
    fn point(&self, turns: f64, ply: u32, s: f64) -> ([f64; 3], [f64; 3]) {
        let k = std::f64::consts::TAU * self.turns_per_um;
        let psi = std::f64::consts::TAU * (turns + f64::from(ply) / f64::from(self.plies)) + k * s;
        let (sin, cos) = psi.sin_cos();
        let length = (1.0 + (self.circle * k).powi(2)).sqrt();
        let tangent = [-self.circle * k * sin / length, self.circle * k * cos / length, 1.0 / length];
        ([self.circle * cos, self.circle * sin, s], tangent)
    }

    /// Point of the ply's axis next to `p`, by Newton's method along the axis from `p`'s own height.
    fn next(&self, turns: f64, ply: u32, p: [f64; 3]) -> ([f64; 3], [f64; 3]) {
        let mut s = p[2];
        for _ in 0..30 {
            let (q, t) = self.point(turns, ply, s);
            let step = dot64([p[0] - q[0], p[1] - q[1], p[2] - q[2]], t) * t[2];
            s += 0.8 * step;
            if step.abs() < 1e-9 {
                break;
            }
        }
        self.point(turns, ply, s)
    }

    fn walk(&self, line: &Line, step: f64) -> Option<(u32, f64, f64)> {
        let w = line.w.map(f64::from);
        let sine = w[0].hypot(w[1]);
        let reach = (self.circle + R) / sine + 2.0 * f64::from(line.origin[0]).abs();
        let mut at = reach;
        while at > -reach {
            let p = [f64::from(line.origin[0]) + at * w[0], at * w[1], at * w[2]];
            let mut least = f64::INFINITY;
            for ply in 0..self.plies {
                let (q, t) = self.next(f64::from(line.turns), ply, p);
                let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                let distance = dot64(d, d).sqrt();
                if distance < R {
                    let x = cross64(w, t);
                    let h = dot64(d, x) / dot64(x, x).sqrt();
                    return Some((ply, dot64(w, t).asin(), h));
                }
                least = least.min(distance - R);
            }
            // No ply is nearer than that; the step keeps the walk going where one is touched.
            at -= least.max(step);
        }
        None
    }
}

fn lines(seed: u64, count: usize, half_width: f32, steepest: f32) -> Vec<Line> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            let cos = sign * (steepest.cos() + (1.0 - steepest.cos()) * rng.random::<f32>());
            let (s, c) = (TAU * rng.random::<f32>()).sin_cos();
            let sine = (1.0 - cos * cos).sqrt();
            let across = (2.0 * rng.random::<f32>() - 1.0) * half_width;
            Line { origin: [across, 0.0, 0.0], w: [sine * c, cos, sine * s], turns: rng.random(), lean: 1.0 }
        })
        .collect()
}

#[test]
fn plies_touch_and_fill_the_width() {
    for plies in 2..=7 {
        let (_, shape) = yarn(plies, None, Handedness::Z);
        let chord = 2.0 * shape.circle_um() * (std::f64::consts::PI / f64::from(plies)).sin();
        assert!((chord - 2.0 * R).abs() < 1e-9, "{plies}: {chord}");
    }
    assert_eq!((yarn(1, None, Handedness::Z).1.width_um(), yarn(2, None, Handedness::Z).1.width_um()), (100.0, 200.0));
}

/// What a line meets of a straight yarn or passes nearest to.
fn meet(yarn: &Yarn, line: &Line) -> YarnHit {
    if yarn.plies == 1 {
        return yarn.meet_one(line);
    }
    let along = |at: f32| Line { origin: std::array::from_fn(|i| line.origin[i] - at * line.w[i]), ..*line };
    let far = 3.0 * yarn.half_width / (line.w[0].hypot(line.w[1])).max(0.02);
    let (mut from, mut walked) = (-far, crate::fabric::walk::Walked::default());
    while from < far {
        let next = yarn.walk(from, far, &[f32::NEG_INFINITY; MAX_PLIES], along);
        from = next.until;
        if next.ply.is_some() {
            walked = next;
        }
        if walked.is_hit {
            break;
        }
    }
    yarn.meet_ply(&along(walked.at), walked.ply.unwrap_or(0), walked.is_hit)
}

/// One ply and parallel plies are exact.
#[test]
fn parallel_plies_are_those_of_a_walk_along_the_line() {
    for plies in 1..=7 {
        let (yarn, shape) = yarn(plies, None, Handedness::Z);
        let twin = Twin { circle: shape.circle_um(), turns_per_um: 0.0, plies };
        let mut hits = 0;
        for line in lines(u64::from(plies), 3000, 1.1 * yarn.half_width, 1.5) {
            let met = meet(&yarn, &line);
            let walked = twin.walk(&line, 1e-4);
            // A line that only grazes a ply may be counted either way, by rounding.
            if met.hit != walked.is_some() {
                assert!((met.h.abs() - yarn.radius).abs() < 0.01, "{plies}: {line:?}: {met:?} {walked:?}");
                continue;
            }
            let Some((ply, theta, h)) = walked else { continue };
            hits += 1;
            if ply != met.ply {
                assert!(
                    (h.abs() - R).abs() < 0.01 || (met.h.abs() - 50.0).abs() < 0.01,
                    "{plies}: {line:?}: {met:?} {walked:?}"
                );
                continue;
            }
            let theta_i = met.theta_i(line.w);
            assert!((f64::from(met.h) - h).abs() < 0.01, "{plies}: h {} against {h}", met.h);
            assert!((f64::from(theta_i) - theta).abs() < 1e-4, "{plies}: theta_i {theta_i} against {theta}");
        }
        assert!(hits > 2000, "{plies}: {hits} hits");
    }
}

/// What the straight cylinders cost against true helices: the share of lines that meet another ply or none,
/// and the errors of h and theta_i of the others.
fn against_helices(plies: u32, pitch: f64, handedness: Handedness, steepest: f32, count: usize) -> [f64; 3] {
    let (yarn, shape) = yarn(plies, Some(pitch), handedness);
    let hand = if handedness == Handedness::Z { 1.0 } else { -1.0 };
    let twin = Twin { circle: shape.circle_um(), turns_per_um: hand / pitch, plies };
    let (mut other, mut n, mut h2, mut theta2) = (0.0, 0.0, 0.0, 0.0);
    for line in lines(7 + u64::from(plies), count, yarn.half_width, steepest) {
        let met = meet(&yarn, &line);
        match twin.walk(&line, 1e-3) {
            Some((ply, theta, h)) if met.hit && ply == met.ply => {
                let theta_i = met.theta_i(line.w);
                n += 1.0;
                h2 += (f64::from(met.h) - h).powi(2);
                theta2 += (f64::from(theta_i) - theta).powi(2);
            }
            None if !met.hit => {}
            _ => other += 1.0,
        }
    }
    [other / count as f64, (h2 / n).sqrt() / R, (theta2 / n).sqrt()]
}

/// Angles between line and normal, and what is allowed: about twice what was measured for the worst of these
/// yarns.
#[test]
fn twisted_plies_are_near_true_helices() {
    for (plies, pitch, hand) in
        [(2, 1500.0, Handedness::Z), (3, 1500.0, Handedness::S), (2, 800.0, Handedness::S), (4, 900.0, Handedness::Z)]
    {
        for (steepest, allowed) in [(0.1, [0.01, 0.002, 0.005]), (0.8, [0.01, 0.003, 0.005]), (1.3, [0.01, 0.01, 0.01])]
        {
            let got = against_helices(plies, pitch, hand, steepest, 800);
            println!(
                "{plies} plies, pitch {pitch}, to {steepest} rad: other ply {:.4}, h/R {:.4}, theta_i {:.4} rad",
                got[0], got[1], got[2]
            );
            assert!((0..3).all(|k| got[k] <= allowed[k]), "{plies} plies, pitch {pitch}, to {steepest} rad: {got:?}");
        }
    }
}

/// A ply of Z twist lies like the middle stroke of the letter: seen from above, its upper side leans from the
/// yarn's axis to the right.
#[test]
fn hands_are_those_of_the_letters() {
    for (hand, sign) in [(Handedness::Z, 1.0), (Handedness::S, -1.0)] {
        let (yarn, _) = yarn(2, Some(800.0), hand);
        // Ply 0 is at the top at a quarter turn. Seen from +n with t upwards, -c points right.
        let met = meet(&yarn, &Line { origin: [0.0; 3], w: [0.0, 1.0, 0.0], turns: 0.25, lean: 1.0 });
        assert!(met.hit && met.ply == 0 && met.h.abs() < 1e-4, "{met:?}");
        let lean = (-met.tangent[0] / met.tangent[2]).atan();
        assert!((lean - sign * (TAU * 50.0 / 800.0).atan()).abs() < 1e-5, "{lean}");
    }
}

#[test]
fn yarns_begin_at_turns_of_their_own() {
    let (yarn, _) = yarn(3, Some(800.0), Handedness::Z);
    let bins = 16;
    let mut count = vec![0; bins];
    for index in -2000..2000 {
        for family in 0..2 {
            let turns = yarn.turns(index, family, 0.0);
            assert!((0.0..1.0).contains(&turns));
            count[(turns * bins as f32) as usize] += 1;
        }
    }
    // 500 a bin, with a standard deviation of 22.
    assert!(count.iter().all(|c| (390..610).contains(c)), "{count:?}");
    // A pitch further all plies are where they were.
    let turn = yarn.turns(5, 0, 123.0) - yarn.turns(5, 0, 123.0 + 8000.0);
    assert!(turn.abs() < 1e-4 || (turn.abs() - 1.0).abs() < 1e-4, "{turn}");
}
