//! Simulates a square sheet that falls over a ball and comes to rest on the ball and the floor, by
//! position-based dynamics with small steps (Macklin et al. 2019). Distance constraints along and across the
//! threads are stiff; those along the bias and over two cells are compliant. Points that are far apart on the
//! sheet keep a distance, so that folds lie on each other.

use crate::surface::net::Net;
use glam::{IVec3, Vec3};
use plywave::math::hash::mix64;

/// Number of cells along a side of the coarse sheet, which falls first, and how many times finer the last is.
const COARSE: usize = 60;
const FINER: usize = 2;
/// Steps per second, and numbers of steps of the coarse and of the fine sheet.
const RATE: f32 = 1200.0;
const STEPS: [usize; 2] = [2000, 700];
/// Times that all constraints are met in turn in a step.
const PASSES: usize = 2;
/// Gravitational acceleration for a sheet of width 1 [1/s^2].
const GRAVITY: f32 = 5.0;
/// Fraction of the speed that remains after one second.
const REMAINING_PER_SECOND: f32 = 0.2;
/// Friction coefficient of ball and floor.
const FRICTION: f32 = 0.35;
/// Compliance of distances along the bias and over two cells, relative to that of the threads.
const BIAS: f32 = 30.0;
const BEND: f32 = 400.0;
/// Distance that points of the sheet keep, in cells, and steps between two searches for near points.
const APART: f32 = 0.85;
const SEARCH: usize = 6;

/// What a sheet falls on, and what draws it. Lengths are relative to the sheet's width; the ball's center is
/// the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fall {
    /// Radius of the ball.
    pub ball: f32,
    /// Height of the floor.
    pub floor: f32,
    /// Angle of the sheet's threads to the x axis [rad].
    pub turn: f32,
    /// Acceleration towards the center of the ball relative to gravity, as of hands that draw the sheet
    /// around it.
    pub pull: f32,
}

/// A distance constraint between two points, and its compliance.
#[derive(Clone, Copy)]
struct Spring {
    ends: [u32; 2],
    length: f32,
    softness: f32,
}

/// A square sheet of width 1.
struct Sheet {
    cells: usize,
    points: Vec<Vec3>,
}

impl Sheet {
    fn side(&self) -> usize {
        self.cells + 1
    }

    fn springs(&self) -> Vec<Spring> {
        let side = self.side();
        let cell = 1.0 / self.cells as f32;
        let mut springs = Vec::new();
        let mut add = |(i, j): (usize, usize), (k, l): (usize, usize), softness: f32| {
            if k < side && l < side {
                let ends = [(j * side + i) as u32, (l * side + k) as u32];
                let (x, y) = (k as f32 - i as f32, l as f32 - j as f32);
                springs.push(Spring { ends, length: cell * x.hypot(y), softness });
            }
        };
        // Springs without common points follow each other, so that no direction is favored.
        for (di, dj, softness) in [(1, 0, 0.0), (0, 1, 0.0), (2, 0, BEND), (0, 2, BEND)] {
            for odd in 0..2 {
                for j in 0..side {
                    for i in 0..side {
                        let along = (i * di + j * dj) / (di * di + dj * dj);
                        if along % 2 == odd {
                            add((i, j), (i + di, j + dj), softness);
                        }
                    }
                }
            }
        }
        for odd in 0..2 {
            for j in 0..self.cells {
                for i in (0..self.cells).filter(|i| i % 2 == odd) {
                    add((i, j), (i + 1, j + 1), BIAS);
                    add((i + 1, j), (i, j + 1), BIAS);
                }
            }
        }
        springs
    }

    /// Pairs of points that are nearer than `reach` in space and further on the sheet.
    fn near_pairs(&self, reach: f32) -> Vec<[u32; 2]> {
        // Points of a cell of space are a list that starts at the cell's bucket.
        const BUCKETS: usize = 1 << 15;
        const END: u32 = u32::MAX;
        let bucket = |at: IVec3| {
            let word = mix64((at.x as u64) << 42 ^ (at.y as u64 & 0x1f_ffff) << 21 ^ (at.z as u64 & 0x1f_ffff));
            word as usize % BUCKETS
        };
        let (mut first, mut next) = (vec![END; BUCKETS], vec![END; self.points.len()]);
        let mut pairs = Vec::new();
        let side = self.side();
        for (k, p) in self.points.iter().enumerate() {
            let at = (*p / reach).floor().as_ivec3();
            for d in 0..27 {
                let mut other = first[bucket(at + IVec3::new(d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1))];
                while other != END {
                    let o = other as usize;
                    let apart = (k % side).abs_diff(o % side).max((k / side).abs_diff(o / side));
                    if apart > 2 && self.points[o].distance_squared(*p) < reach * reach {
                        pairs.push([other, k as u32]);
                    }
                    other = next[o];
                }
            }
            let own = bucket(at);
            next[k] = first[own];
            first[own] = k as u32;
        }
        pairs
    }

    /// Moves the sheet for some steps, from rest.
    fn fall(&mut self, on: &Fall, steps: usize) {
        let springs = self.springs();
        let dt = 1.0 / RATE;
        let retained = 1.0 - dt * (1.0 / REMAINING_PER_SECOND).ln();
        let apart = APART / self.cells as f32;
        let mut before = self.points.clone();
        let mut pairs = Vec::new();
        for step in 0..steps {
            for (p, before) in self.points.iter_mut().zip(&mut before) {
                let speed = (*p - *before) * retained;
                *before = *p;
                let out = p.length();
                let pull = if out > on.ball { *p * (on.pull / out.max(1e-6)) } else { Vec3::ZERO };
                *p += speed - (Vec3::Z + pull) * (GRAVITY * dt * dt);
            }
            for _ in 0..PASSES {
                for s in &springs {
                    let [a, b] = s.ends.map(|e| e as usize);
                    let way = self.points[b] - self.points[a];
                    let long = way.length();
                    let share = 0.5 * (long - s.length) / ((1.0 + s.softness) * long.max(1e-12));
                    self.points[a] += way * share;
                    self.points[b] -= way * share;
                }
            }
            if step % SEARCH == 0 {
                pairs = self.near_pairs(1.5 * apart);
            }
            for pair in &pairs {
                let [a, b] = pair.map(|e| e as usize);
                let way = self.points[b] - self.points[a];
                let long = way.length();
                if long < apart {
                    let push = way * (0.25 * (apart - long) / long.max(1e-12));
                    self.points[a] -= push;
                    self.points[b] += push;
                    // Layers that press on each other do not slide freely.
                    let (u, v) = (self.points[a] - before[a], self.points[b] - before[b]);
                    let slid = (u - v) * 0.1;
                    before[a] += slid;
                    before[b] -= slid;
                }
            }
            for (p, before) in self.points.iter_mut().zip(&before) {
                let out = p.length();
                if out < on.ball {
                    touch(p, *before, *p / out.max(1e-12), on.ball - out);
                }
                if p.z < on.floor {
                    touch(p, *before, Vec3::Z, on.floor - p.z);
                }
            }
        }
    }
}

/// Moves a point that lies `deep` inside a body to its surface, and applies friction along the surface.
fn touch(p: &mut Vec3, before: Vec3, normal: Vec3, deep: f32) {
    *p += normal * deep;
    let moved = *p - before;
    let slid = moved - normal * moved.dot(normal);
    let (long, max) = (slid.length(), FRICTION * deep);
    *p -= slid * if long > max { max / long } else { 1.0 };
}

/// A sheet of width 1 at rest.
pub(crate) fn fallen(on: &Fall) -> Net {
    // The sheet is turned a little and not quite flat, which starts folds without random numbers.
    let (sin, cos) = on.turn.sin_cos();
    let side = COARSE + 1;
    let start = |k: usize| {
        let at = |n: usize| n as f32 / COARSE as f32 - 0.5;
        let (x, y) = (at(k % side), at(k / side));
        let dip = 0.004 * (9.0 * x + 2.0 * y).sin() * (7.0 * y).cos() + 0.002 * (23.0 * x - 17.0 * y).sin();
        Vec3::new(cos * x - sin * y, sin * x + cos * y, on.ball + 0.01 + dip)
    };
    let mut sheet = Sheet { cells: COARSE, points: (0..side * side).map(start).collect() };
    sheet.fall(on, STEPS[0]);
    let cells = FINER * COARSE;
    let fine = Net { cells: [COARSE; 2], points: sheet.points }.refined([cells; 2]);
    let mut sheet = Sheet { cells, points: fine.points };
    sheet.fall(on, STEPS[1]);
    Net { cells: [cells; 2], points: sheet.points }
}
