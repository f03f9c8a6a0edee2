//! Sheets whose cross section is a curve of their own length: a curtain in folds, and a stack of folded
//! sheets. A sheet that is bent along one direction alone does not stretch.

use crate::surface::net::Net;
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Folds of a curtain, and cells of its net along width and length.
const FOLDS: f32 = 8.0;
const CURTAIN_CELLS: [usize; 2] = [1024, 48];

/// A curtain of cloth of width 1 and length `drop` that hangs `hung` wide, in front of the plane y = 0, about
/// the origin. Its cross section at each height is a curve whose direction swings like a sine (a
/// sine-generated curve, Langbein and Leopold 1966), so that arc length is exact.
pub(crate) fn curtain(hung: f32, drop: f32) -> Net {
    let [n, m] = CURTAIN_CELLS;
    let mut points = Vec::with_capacity((n + 1) * (m + 1));
    for j in 0..=m {
        // From the hem, below, to the rod.
        let t = j as f32 / m as f32;
        // Folds are even where they are sewn, at the rod, and wander below.
        let free = 1.0 - t * t;
        let phase = |s: f32| {
            let wander = 0.10 * (TAU * 1.3 * s + 1.0 + 0.9 * t).sin() + 0.05 * (TAU * 3.1 * s + 4.0 - 1.7 * t).sin();
            TAU * (FOLDS * s + free * wander)
        };
        let swing = |s: f32| {
            let uneven = 0.22 * (TAU * 2.3 * s + 0.4).sin() + 0.13 * (TAU * 4.7 * s + 2.0 + t).sin();
            let phase = phase(s);
            (1.0 + free * uneven) * (phase.sin() + 0.12 * (1.0 - free) * (3.0 * phase).sin())
        };
        let middle = |i: usize| (i as f32 + 0.5) / n as f32;
        let width = |most: f32| (0..n).map(|i| (most * swing(middle(i))).cos()).sum::<f32>() / n as f32;
        let (mut low, mut high) = (0.0f32, 2.2);
        for _ in 0..24 {
            let most = 0.5 * (low + high);
            if width(most) > hung { low = most } else { high = most }
        }
        let (mut x, mut y) = (vec![0.0f32; n + 1], vec![0.0f32; n + 1]);
        for i in 0..n {
            let (sin, cos) = (low * swing(middle(i))).sin_cos();
            x[i + 1] = x[i] + cos / n as f32;
            y[i + 1] = y[i] + sin / n as f32;
        }
        let (end, mean) = (y[n], y.iter().sum::<f32>() / (n + 1) as f32);
        for i in 0..=n {
            let tilt = end * (i as f32 / n as f32 - 0.5);
            points.push(Vec3::new(x[i] - 0.5 * x[n], y[i] - mean - tilt, (t - 0.5) * drop));
        }
    }
    Net { cells: CURTAIN_CELLS, points }
}

/// Sheets of a stack, panels that each is folded into, and its depth along the folds over its length.
const SHEETS: usize = 3;
const PANELS: usize = 5;
pub(crate) const STACK_DEPTH: f32 = 0.3;
/// Length of a panel, and distances of two panels where they lie on each other and at their fold.
const PANEL: f32 = 0.94 / PANELS as f32;
const APART: f32 = 0.0042;
const AT_FOLD: f32 = 0.0105;
/// Length over which a fold rises.
const RISE: f32 = 0.022;
const STACK_CELLS: [usize; 2] = [900, 40];
/// Turn about z [rad] and place of each sheet.
const LYING: [(f32, [f32; 2]); SHEETS] = [(0.0, [0.0, 0.0]), (0.045, [0.002, -0.003]), (-0.03, [-0.003, 0.002])];

/// One sheet of a stack, folded into panels along x, before it is turned.
#[derive(Clone, Copy)]
struct Folded {
    number: usize,
}

impl Folded {
    /// x of the fold between panels `k - 1` and `k` at the place `y` along it.
    fn fold(&self, k: usize, y: f32) -> f32 {
        let seed = (5 * self.number + k) as f32;
        let side = if k % 2 == 1 { 1.0 } else { -1.0 };
        let wave = 0.0022 * (19.0 * y + 1.9 * seed).sin() + 0.0012 * (43.0 * y + 3.1 * seed).sin();
        side * (0.5 * PANEL + 0.0035 * (2.4 * seed).sin()) + wave
    }

    /// Height of panel `k` over the sheet's support: distances to the panels below, each larger at its fold.
    fn height(&self, k: usize, x: f32, y: f32) -> f32 {
        let mut z = APART;
        for j in 1..=k {
            let seed = (5 * self.number + j) as f32;
            let off = ((x - self.fold(j, y)) / RISE).clamp(-4.0, 4.0);
            // Sheets below are pressed.
            let pressed = 0.72 + 0.14 * (self.number as f32) - 0.05 * (j as f32 - 3.0).abs();
            let at_fold = AT_FOLD * pressed * (1.0 + 0.16 * (11.0 * y + 2.0 * seed).sin());
            z += APART * (1.0 + 0.2 * (9.0 * x + 13.0 * y + seed).sin());
            z += (at_fold - APART).max(0.0) * (-off * off).exp();
        }
        z
    }

    /// Points of the cross section at `y`, from the start of the first panel to the end of the last.
    fn section(&self, y: f32) -> Vec<[f32; 2]> {
        let mut points = Vec::new();
        for k in 0..PANELS {
            let start = if k == 0 { -self.fold(1, y) + 0.012 } else { self.fold(k, y) };
            let end = if k + 1 < PANELS { self.fold(k + 1, y) } else { -self.fold(k, y) - 0.016 };
            for i in 0..=160 {
                let x = start + (end - start) * i as f32 / 160.0;
                points.push([x, self.height(k, x, y)]);
            }
            if k + 1 < PANELS {
                let (low, high) = (self.height(k, end, y), self.height(k + 1, end, y));
                let (radius, out) = (0.5 * (high - low), (end - start).signum());
                for i in 1..24 {
                    let (sin, cos) = (PI * i as f32 / 24.0).sin_cos();
                    points.push([end + out * radius * sin, low + radius * (1.0 - cos)]);
                }
            }
        }
        points
    }
}

/// Sheets of length 1 along u, folded into panels, in a stack on the plane z = 0.
pub(crate) fn stack() -> Vec<Net> {
    let below = |number: usize, p: Vec2| -> f32 {
        let height = |number: usize| {
            let (turn, place) = LYING[number];
            let at = Vec2::from_angle(-turn).rotate(p - Vec2::from(place));
            Folded { number }.height(PANELS - 1, at.x, at.y)
        };
        (0..number).map(height).sum()
    };
    let [n, m] = STACK_CELLS;
    let net = |number: usize| {
        let (turn, place) = LYING[number];
        let mut points = Vec::with_capacity((n + 1) * (m + 1));
        for j in 0..=m {
            let y = STACK_DEPTH * (j as f32 / m as f32 - 0.5);
            let section: Vec<Vec3> = Folded { number }
                .section(y)
                .into_iter()
                .map(|[x, z]| {
                    let at = Vec2::from_angle(turn).rotate(Vec2::new(x, y)) + Vec2::from(place);
                    at.extend(z + below(number, at))
                })
                .collect();
            // Equal lengths of cloth along the section.
            let mut lengths = vec![0.0f32];
            for pair in section.windows(2) {
                lengths.push(lengths[lengths.len() - 1] + pair[0].distance(pair[1]));
            }
            let mut k = 0;
            for i in 0..=n {
                let way = lengths[lengths.len() - 1] * i as f32 / n as f32;
                while k + 2 < lengths.len() && lengths[k + 1] < way {
                    k += 1;
                }
                let share = (way - lengths[k]) / (lengths[k + 1] - lengths[k]).max(1e-9);
                points.push(section[k].lerp(section[k + 1], share));
            }
        }
        Net { cells: STACK_CELLS, points }
    };
    (0..SHEETS).map(net).collect()
}
