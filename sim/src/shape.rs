//! Fiber outlines drawn at random from the spec's shape and jitter.
//!
//! Every outline is smooth, simple, counterclockwise and centred on its centroid; vertices lie on the smooth curve.

use crate::error::SimError;
use crate::outline::Outline;
use crate::section::FiberSection;
use nalgebra::Vector2;
use plywave::{FiberSpec, Shape};
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Fewest points of a polyline.
const POINTS: usize = 192;

/// Draw one fiber at the origin.
pub(crate) fn draw<R: Rng>(spec: &FiberSpec, rng: &mut R) -> Result<FiberSection, SimError> {
    let size = (1.0 + spec.size_jitter * normal3(rng)).max(0.2);
    let angle_rad = match spec.angle_jitter_rad {
        Some(sd) => sd * normal3(rng),
        None => rng.random_range(0.0..TAU),
    };
    let vary = 1.0 + spec.shape_jitter * normal3(rng);
    let (outer, lumen) = match &spec.shape {
        Shape::Circle { radius_um } => (Outline::Circle { radius_um: size * radius_um }, None),
        Shape::Ellipse { a_um, b_um } => {
            let stretch = vary.max(0.2).sqrt();
            let (a, b) = (size * a_um * stretch, size * b_um / stretch);
            (curve(POINTS, |t| Vector2::new(a * t.cos(), b * t.sin())), None)
        }
        other => return Err(SimError::BadOutline { what: format!("{other:?}"), mend: "use circle or ellipse".into() }),
    };
    Ok(FiberSection { center_um: Vector2::zeros(), angle_rad, outer, lumen })
}

/// A standard normal number within three standard deviations.
pub(crate) fn normal3<R: Rng>(rng: &mut R) -> f64 {
    loop {
        let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        let x = radius * (TAU * rng.random::<f64>()).cos();
        if x.abs() <= 3.0 {
            return x;
        }
    }
}

/// `n` points of the closed curve `at(t)`, t in [0, 2 pi), of about uniform arc length; each lies on the curve.
fn curve(n: usize, at: impl Fn(f64) -> Vector2<f64>) -> Outline {
    let fine = 16 * n;
    let t = |i: usize| TAU * i as f64 / fine as f64;
    let mut length = vec![0.0; fine + 1];
    for i in 0..fine {
        length[i + 1] = length[i] + (at(t(i + 1)) - at(t(i))).norm();
    }
    let mut i = 0;
    let points = (0..n).map(|k| {
        let s = length[fine] * k as f64 / n as f64;
        while length[i + 1] < s {
            i += 1;
        }
        at(t(i) + (t(i + 1) - t(i)) * (s - length[i]) / (length[i + 1] - length[i]))
    });
    Outline::Polyline(points.collect())
}
