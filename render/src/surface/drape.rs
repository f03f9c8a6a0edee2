//! Simulates a sheet that falls over a ball and comes to rest on the ball and the floor, by position-based
//! dynamics with small steps (Macklin et al. 2019). Distance constraints along and across the threads are
//! stiff; those along the bias and over two cells are compliant. The sheet does not collide with itself.

use glam::Vec3;

/// Number of cells along a side.
const CELLS: usize = 96;
const SIDE: usize = CELLS + 1;
/// Steps per second, and total number of steps.
const RATE: f32 = 1500.0;
const STEPS: usize = 3600;
/// Gravitational acceleration for a sheet of width 1 [1/s^2].
const GRAVITY: f32 = 4.0;
/// Fraction of the speed that remains after one second.
const REMAINING_PER_SECOND: f32 = 0.25;
/// Friction coefficient of ball and floor.
const FRICTION: f32 = 0.45;

/// Compliance of distances along the bias and over two cells, relative to that of the threads.
const BIAS: f32 = 40.0;
const BEND: f32 = 150.0;

/// A distance constraint between two points, and its compliance.
#[derive(Clone, Copy)]
struct Spring {
    ends: [u32; 2],
    length: f32,
    softness: f32,
}

fn index(i: usize, j: usize) -> usize {
    j * SIDE + i
}

fn springs() -> Vec<Spring> {
    let mut springs = Vec::new();
    let cell = 1.0 / CELLS as f32;
    let mut add = |(i, j): (usize, usize), (k, l): (usize, usize), softness: f32| {
        if k < SIDE && l < SIDE {
            let ends = [index(i, j) as u32, index(k, l) as u32];
            let (x, y) = (k as f32 - i as f32, l as f32 - j as f32);
            springs.push(Spring { ends, length: cell * x.hypot(y), softness });
        }
    };
    // Springs without common points follow each other, so that no direction is favored.
    for (di, dj, softness) in [(1, 0, 0.0), (0, 1, 0.0), (2, 0, BEND), (0, 2, BEND)] {
        for odd in 0..2 {
            for j in 0..SIDE {
                for i in 0..SIDE {
                    let along = (i * di + j * dj) / (di * di + dj * dj);
                    if along % 2 == odd {
                        add((i, j), (i + di, j + dj), softness);
                    }
                }
            }
        }
    }
    for odd in 0..2 {
        for j in 0..CELLS {
            for i in (0..CELLS).filter(|i| i % 2 == odd) {
                add((i, j), (i + 1, j + 1), BIAS);
                add((i + 1, j), (i, j + 1), BIAS);
            }
        }
    }
    springs
}

/// Moves a point that lies `deep` inside a body to its surface, and applies friction along the surface.
fn touch(p: &mut Vec3, before: Vec3, normal: Vec3, deep: f32) {
    *p += normal * deep;
    let moved = *p - before;
    let slid = moved - normal * moved.dot(normal);
    let (long, max) = (slid.length(), FRICTION * deep);
    *p -= slid * if long > max { max / long } else { 1.0 };
}

/// Points of a sheet of width 1 after it has fallen over a ball of this radius about the origin, above a
/// floor; and the number of points along a side.
pub(crate) fn fallen(radius: f32, floor: f32) -> (Vec<Vec3>, usize) {
    let springs = springs();
    // The sheet is turned a little and not quite flat, which starts folds without random numbers.
    let (sin, cos) = 0.35f32.sin_cos();
    let mut p: Vec<Vec3> = (0..SIDE * SIDE)
        .map(|k| {
            let at = |n: usize| n as f32 / CELLS as f32 - 0.5;
            let (x, y) = (at(k % SIDE), at(k / SIDE));
            let dip = 0.004 * (9.0 * x + 2.0 * y).sin() * (7.0 * y).cos();
            Vec3::new(cos * x - sin * y, sin * x + cos * y, radius + 0.01 + dip)
        })
        .collect();
    let mut before = p.clone();
    let dt = 1.0 / RATE;
    let retained = REMAINING_PER_SECOND.ln() * dt;
    let retained = 1.0 + retained * (1.0 + 0.5 * retained);
    for _ in 0..STEPS {
        for (p, before) in p.iter_mut().zip(&mut before) {
            let speed = (*p - *before) * retained;
            *before = *p;
            *p += speed - Vec3::Z * (GRAVITY * dt * dt);
        }
        for s in &springs {
            let [a, b] = s.ends.map(|e| e as usize);
            let way = p[b] - p[a];
            let long = way.length();
            let share = 0.5 * (long - s.length) / ((1.0 + s.softness) * long.max(1e-12));
            p[a] += way * share;
            p[b] -= way * share;
        }
        for (p, before) in p.iter_mut().zip(&before) {
            let out = p.length();
            if out < radius {
                touch(p, *before, *p / out.max(1e-12), radius - out);
            }
            if p.z < floor {
                touch(p, *before, Vec3::Z, floor - p.z);
            }
        }
    }
    (p, SIDE)
}
