//! Generates strands: a ball of hair, a single fiber, layers, a wisp, a patch of fur, a knitted loop. The
//! same seed generates the same strands.

use super::{Basis, Strands};
use crate::RenderError;
use glam::{Quat, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::Deserialize;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Kind and sizes of generated strands; lengths in mm. In files it is a table whose `kind` is the name in
/// lower case.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum GeneratedStrands {
    /// One straight fiber along x through the origin.
    Single {
        /// Its length.
        length_mm: f32,
    },
    /// Parallel fibers along x in the plane z = 0, with further layers below, each shifted by half the
    /// spacing.
    Layer {
        /// Fibers of a layer.
        count: u32,
        /// Number of layers; default 1.
        #[serde(default = "one")]
        layers: u32,
        /// Distance between center lines.
        spacing_mm: f32,
        /// Length of a fiber.
        length_mm: f32,
    },
    /// Curled hairs that stand on a ball about the origin and bend down.
    Ball {
        /// Number of hairs.
        count: u32,
        /// Radius of the ball.
        ball_mm: f32,
        /// Length of a hair.
        length_mm: f32,
        /// Radius of the curls; default 0.
        #[serde(default)]
        curl_mm: f32,
    },
    /// A wavy lock along the z axis that hangs down from z = 0 and tapers to a point.
    Wisp {
        /// Number of hairs.
        count: u32,
        /// Radius at the root.
        width_mm: f32,
        /// Length of a hair.
        length_mm: f32,
    },
    /// Fur on a square of side `size_mm` in the plane z = 0, combed along x, in tufts.
    Fur {
        /// Number of hairs.
        count: u32,
        /// Side of the square.
        size_mm: f32,
        /// Length of a hair.
        length_mm: f32,
    },
    /// A yarn of fibers along one row of loops of a jersey knit, in the plane z = 0 except at the crossings.
    Loop {
        /// Fibers of the yarn.
        count: u32,
        /// Number of loops; default 3.
        #[serde(default = "three")]
        loops: u32,
        /// Width of a loop.
        width_mm: f32,
        /// Radius of the yarn.
        yarn_mm: f32,
    },
}

fn one() -> u32 {
    1
}

fn three() -> u32 {
    3
}

/// Largest number of control points.
const MAX_MADE: u64 = 200_000_000;

/// Generates strands of radius `radius_mm` with `segments` segments each, as B-splines. Hairs of balls, wisps
/// and fur taper to half their radius at the tips.
///
/// # Errors
/// [`RenderError::Strands`] for more than 200 M points, [`RenderError::TooLarge`].
pub fn make(what: &GeneratedStrands, radius_mm: f32, segments: u32, seed: u64) -> Result<Strands, RenderError> {
    let count = match *what {
        GeneratedStrands::Single { .. } => 1,
        GeneratedStrands::Layer { count, layers, .. } => u64::from(count) * u64::from(layers),
        GeneratedStrands::Ball { count, .. }
        | GeneratedStrands::Wisp { count, .. }
        | GeneratedStrands::Fur { count, .. }
        | GeneratedStrands::Loop { count, .. } => count.into(),
    };
    let points = count.saturating_mul(u64::from(segments) + 3);
    if points > MAX_MADE {
        let what = format!("{points} points of strands; at most {MAX_MADE}");
        return Err(RenderError::Strands { file: "strands".into(), what });
    }
    Strands::check_memory(points)?;
    let mut strands = Strands::new(Basis::BSpline);
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let tufts = Tufts::new(what, &mut rng);
    for k in 0..count {
        let path = path(what, k, &tufts, &mut rng);
        let thin = matches!(
            what,
            GeneratedStrands::Ball { .. } | GeneratedStrands::Wisp { .. } | GeneratedStrands::Fur { .. }
        );
        let points: Vec<[f32; 4]> = (0..=segments)
            .map(|i| {
                let u = i as f32 / segments as f32;
                let p = path(u);
                [p.x, p.y, p.z, if thin { radius_mm * (1.0 - 0.5 * u * u) } else { radius_mm }]
            })
            .collect();
        strands.push_whole(&points, "strands", &format!("strand {}", k + 1))?;
    }
    Ok(strands)
}

/// Centers that the hairs of a patch of fur lean towards, one per cell of a grid.
struct Tufts {
    across: usize,
    centers: Vec<Vec3>,
}

impl Tufts {
    fn new(what: &GeneratedStrands, rng: &mut Pcg64Mcg) -> Tufts {
        let GeneratedStrands::Fur { size_mm, length_mm, .. } = *what else {
            return Tufts { across: 0, centers: Vec::new() };
        };
        let across = ((size_mm / (0.22 * length_mm)).ceil() as usize).clamp(1, 1000);
        let cell = size_mm / across as f32;
        let centers = (0..across * across)
            .map(|i| {
                let [a, b]: [f32; 2] = rng.random();
                let (x, y) = ((i % across) as f32 + a, (i / across) as f32 + b);
                Vec3::new(x * cell - 0.5 * size_mm, y * cell - 0.5 * size_mm, 0.0)
            })
            .collect();
        Tufts { across, centers }
    }

    fn nearest(&self, p: Vec3, size: f32) -> Vec3 {
        let cell = |v: f32| ((v / size + 0.5) * self.across as f32) as isize;
        let (x, y) = (cell(p.x), cell(p.y));
        let inside = |v: isize| (0..self.across as isize).contains(&v);
        (-1..=1)
            .flat_map(|j| (-1..=1).map(move |i| (x + i, y + j)))
            .filter(|(i, j)| inside(*i) && inside(*j))
            .map(|(i, j)| self.centers[j as usize * self.across + i as usize])
            .min_by(|a, b| a.distance_squared(p).total_cmp(&b.distance_squared(p)))
            .unwrap_or(p)
    }
}

/// A uniformly distributed point of the unit disc.
fn disc(rng: &mut Pcg64Mcg) -> [f32; 2] {
    let (r, phi) = (rng.random::<f32>().sqrt(), TAU * rng.random::<f32>());
    [r * phi.cos(), r * phi.sin()]
}

/// The center line of strand `k`, for u from 0 to 1.
fn path(what: &GeneratedStrands, k: u64, tufts: &Tufts, rng: &mut Pcg64Mcg) -> Box<dyn Fn(f32) -> Vec3> {
    match *what {
        GeneratedStrands::Single { length_mm } => Box::new(move |u| Vec3::X * (length_mm * (u - 0.5))),
        GeneratedStrands::Layer { count, spacing_mm, length_mm, .. } => {
            let (layer, i) = (k / u64::from(count), k % u64::from(count));
            let y = (i as f32 - 0.5 * (count as f32 - 1.0) + if layer % 2 == 1 { 0.5 } else { 0.0 }) * spacing_mm;
            let z = -(layer as f32) * spacing_mm;
            Box::new(move |u| Vec3::new(length_mm * (u - 0.5), y, z))
        }
        GeneratedStrands::Ball { count, ball_mm, length_mm, curl_mm } => {
            // Roots lie on a Fibonacci spiral, with a small random offset.
            let z = 1.0 - 2.0 * (k as f32 + rng.random::<f32>()) / count as f32;
            let phi = k as f32 * 2.399_963 + 0.3 * rng.random::<f32>();
            let r = (1.0 - z * z).max(0.0).sqrt();
            let normal = Vec3::new(r * phi.cos(), r * phi.sin(), z);
            let lean = Vec3::new(rng.random::<f32>() - 0.5, rng.random::<f32>() - 0.5, rng.random::<f32>() - 0.5);
            let length = length_mm * (0.8 + 0.4 * rng.random::<f32>());
            let (turns, phase) = (1.5 + 2.0 * rng.random::<f32>(), TAU * rng.random::<f32>());
            let curl = curl_mm * (0.6 + 0.8 * rng.random::<f32>());
            let (a, b) = normal.any_orthonormal_pair();
            let up = (normal + 0.5 * lean).normalize_or(normal);
            Box::new(move |u| {
                let s = length * u;
                // The hair grows outwards, then bends increasingly down and along the ball.
                let fall = Vec3::NEG_Z * (0.45 * u * s) + up * (s * (1.0 - 0.3 * u));
                let (sin, cos) = (TAU * turns * u + phase).sin_cos();
                let wave = (a * (cos - phase.cos()) + b * (sin - phase.sin())) * (curl * u.sqrt());
                let p = normal * ball_mm + fall + wave;
                // Points inside the ball are moved to its surface.
                let depth = p.length();
                let min = ball_mm * (1.0 + 0.002 * u);
                if depth < min { p * (min / depth.max(1e-6)) } else { p }
            })
        }
        GeneratedStrands::Wisp { width_mm, length_mm, .. } => {
            let [x, y] = disc(rng);
            let root = Vec3::new(x, y, 0.0) * width_mm;
            let stray = rng.random::<f32>().powi(8);
            let [sx, sy] = disc(rng);
            let length = length_mm * (1.0 - 0.12 * rng.random::<f32>());
            let (phase, jitter) = (0.5 * rng.random::<f32>(), rng.random::<f32>() - 0.5);
            Box::new(move |u| {
                let gather = 1.0 - 0.85 * u.powf(1.3);
                let out = Vec3::new(sx, sy, 0.0) * (stray * 2.5 * width_mm * u * u);
                let bend = (TAU * 1.1 * u + 0.3 * phase).sin() * (0.9 * width_mm) * u;
                let twist = Quat::from_rotation_z(1.2 * u + 0.2 * jitter);
                let fine = 0.02 * width_mm * (TAU * (9.0 + 3.0 * jitter) * u + 12.0 * phase).sin() * u;
                twist * (root * gather) + out + Vec3::new(bend + fine, 0.25 * bend, -length * u)
            })
        }
        GeneratedStrands::Fur { size_mm, length_mm, .. } => {
            let [a, b]: [f32; 2] = rng.random();
            let root = Vec3::new(a - 0.5, b - 0.5, 0.0) * size_mm;
            let to = tufts.nearest(root, size_mm) - root;
            let length = length_mm * (0.6 + 0.5 * rng.random::<f32>());
            let turn =
                0.5 * (rng.random::<f32>() - 0.5) + 0.25 * (4.0 * root.x / size_mm + 5.0 * root.y / size_mm).sin();
            let pull = 0.4 + 0.5 * rng.random::<f32>();
            let stand = 0.35 + 0.3 * rng.random::<f32>();
            let (sin, cos) = turn.sin_cos();
            Box::new(move |u| {
                // The hair turns from upright to combed.
                let angle = FRAC_PI_2 * (1.0 - stand) * u;
                let along = length * u;
                let forward = Vec3::new(cos, sin, 0.0) * (along * angle.sin());
                root + forward + Vec3::Z * (along * angle.cos()) + to * (pull * u * u)
            })
        }
        GeneratedStrands::Loop { count, loops, width_mm, yarn_mm } => {
            // Rings of fibers twist about the yarn's axis.
            let r = yarn_mm * ((k as f32 + 0.5) / count as f32).sqrt() * 0.92;
            let (phi, stray) = (k as f32 * 2.399_963, 0.15 * (rng.random::<f32>() - 0.5));
            let wander = TAU * rng.random::<f32>();
            Box::new(move |u| {
                let at = |u: f32| {
                    let t = TAU * (loops as f32 * u);
                    // Peirce's loop: x turns back at the legs, so that neighboring loops interlock.
                    let x = width_mm * (t / TAU - 0.5 * loops as f32) + 0.28 * width_mm * (2.0 * t).sin();
                    let y = -0.75 * width_mm * t.cos();
                    let z = 1.3 * yarn_mm * (2.0 * t).cos();
                    Vec3::new(x, y, z)
                };
                let tangent = (at(u + 1e-3) - at(u - 1e-3)).normalize_or(Vec3::X);
                let side = tangent.cross(Vec3::Z).normalize_or(Vec3::Y);
                let up = side.cross(tangent);
                let turn = phi + PI * 6.0 * loops as f32 * u;
                let r = r * (1.0 + stray * (7.0 * TAU * u + wander).sin());
                at(u) + side * (r * turn.cos()) + up * (r * turn.sin())
            })
        }
    }
}
