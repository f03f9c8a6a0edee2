//! Starting curve of a tricot, a warp knit of one bar with open laps.

use super::curves::{HEIGHT, LEAN, LEG, POINTS, StartCurve};
use std::f64::consts::{PI, TAU};

/// A yarn of a tricot: loops on two wales alternately, with underlaps behind both.
pub fn tricot(wale: f64, course: f64, radius: f64) -> StartCurve {
    let leg = LEG * radius;
    let mut points = Vec::new();
    for c in 0..2 {
        // The first loop rises on its right and falls on its left; the second is its mirror image.
        let (middle, mirror) = if c == 0 { (0.5, 1.0) } else { (1.5, -1.0) };
        for i in 0..POINTS {
            // The loop of a knit stitch without sinkers, from the inner foot over the head to the other foot.
            let t = TAU * (0.09 + 0.82 * (i as f64 + 0.5) / POINTS as f64);
            let x = t / TAU - 0.5 + LEAN * (2.0 * t).sin();
            points.push([
                wale * (middle - mirror * x),
                course * (c as f64 + 0.5) - HEIGHT * course * t.cos(),
                -leg * (2.0 * t).cos(),
            ]);
        }
        // The underlap passes behind this loop's feet and rises to the next one.
        let from = points[points.len() - 1];
        let (next, side) = if c == 0 { (1.5, 1.0) } else { (0.5, -1.0) };
        let t: f64 = TAU * (0.09 + 0.41 / POINTS as f64);
        let x = t / TAU - 0.5 + LEAN * (2.0 * t).sin();
        let to =
            [wale * (next + side * x), course * (c as f64 + 1.5) - HEIGHT * course * t.cos(), -leg * (2.0 * t).cos()];
        let steps = POINTS / 4;
        for i in 1..steps {
            let s = i as f64 / steps as f64;
            let w = s * s * (3.0 - 2.0 * s);
            let behind = -2.6 * leg * (PI * s).sin();
            points.push([
                from[0] + w * (to[0] - from[0]),
                from[1] + w * (to[1] - from[1]),
                from[2] + w * (to[2] - from[2]) + behind,
            ]);
        }
    }
    StartCurve { points_um: points, shift: [0, 1], loops: 2.0, yarn: None, needles: vec![0] }
}
