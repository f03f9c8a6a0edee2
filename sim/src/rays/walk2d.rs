//! The path walk in 2D: parallel fibers, any incident latitude, one ply instance (Yu 2025, 4.4 and 4.5).
//!
//! Light that hits smooth parallel fibers stays on the specular cone theta_o = -theta_i, so that its
//! distribution is over the azimuth alone. The walk is the same as in 3D, with the same tracer, over a cross
//! section without twist. It serves the comparison with 2D wave optics for one fixed instance, so nothing is
//! rotated at random.

use crate::error::SimError;
use crate::geometry::section::PlySection;
use crate::rays::dielectric::RoughDielectric;
use crate::rays::path::{PathEnd, trace_path};
use crate::rays::screw::ScrewTracer;
use nalgebra::Vector3;
use plywave::spec::GaussianBeam;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

/// Parameters of a 2D walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk2d {
    /// Incident latitude [rad], any sign.
    pub theta_i: f64,
    /// Offset of the beam's center [um].
    pub h_um: f64,
    /// Index of the fibers.
    pub eta: f64,
    /// Roughness of the fibers; 0 keeps the light on the specular cone.
    pub alpha_fiber: f64,
    /// Absorption coefficients [1/um].
    pub sigma_per_um: Vec<f64>,
    /// The beam. Its divergence spreads the azimuth, and the latitude about the cone.
    pub beam: GaussianBeam,
    /// Bins of the azimuth phi_o over [0, 2 pi).
    pub phi_o_bins: usize,
    /// Paths to trace.
    pub paths: u64,
    /// Seed of the paths.
    pub seed: u64,
}

/// Energy densities over the azimuth [1/rad], `values[bin]`; the integral over the azimuth is a fraction of
/// the beam's power.
#[derive(Clone, Debug, PartialEq)]
pub struct Azimuthal {
    /// Light that hit no fiber.
    pub miss: Vec<f64>,
    /// Reflection-only light.
    pub refl: Vec<f64>,
    /// `[sigma][bin]`: all other light.
    pub high: Vec<Vec<f64>>,
    /// Fraction of the beam in killed paths.
    pub killed: f64,
    /// Variance about the specular cone: mean squared distance of theta_o from -theta_i [rad^2], per
    /// scattered path.
    pub cone_spread_rad2: f64,
}

/// Traces the beam of `walk` through `section`, with its fibers taken as parallel.
///
/// # Errors
/// [`SimError::TooCrowded`] when the screw march cannot resolve the section.
pub fn walk_2d(section: &PlySection, walk: &Walk2d) -> Result<Azimuthal, SimError> {
    let straight = PlySection { twist_per_um: 0.0, ..section.clone() };
    let tracer = ScrewTracer::new(&straight).ok_or(SimError::TooCrowded)?;
    let surface = RoughDielectric { eta: walk.eta as f32, alpha: walk.alpha_fiber as f32 };
    let bins = walk.phi_o_bins.max(1);
    let mut out = Azimuthal {
        miss: vec![0.0; bins],
        refl: vec![0.0; bins],
        high: vec![vec![0.0; bins]; walk.sigma_per_um.len()],
        killed: 0.0,
        cone_spread_rad2: 0.0,
    };
    let mut rng = Pcg64Mcg::seed_from_u64(walk.seed);
    let (sin_i, cos_i) = (walk.theta_i as f32).sin_cos();
    let forward = Vector3::new(0.0, -cos_i, -sin_i);
    let across = Vector3::new(0.0, -sin_i, cos_i);
    let (sd, angular_sd) = (walk.beam.sd_um() as f32, walk.beam.angular_sd_rad() as f32);
    let scale = bins as f64 / std::f64::consts::TAU / walk.paths.max(1) as f64;
    let bin = |dir: Vector3<f32>| {
        let phi = dir.y.atan2(dir.x).rem_euclid(std::f32::consts::TAU);
        ((phi / std::f32::consts::TAU * bins as f32) as usize).min(bins - 1)
    };
    let mut scattered = 0.0;
    for _ in 0..walk.paths {
        let normal: [f32; 3] = std::array::from_fn(|_| rng.sample(StandardNormal));
        let x = walk.h_um as f32 + sd * normal[0];
        let dir = (forward + Vector3::x() * (angular_sd * normal[1]) + across * (angular_sd * normal[2])).normalize();
        // The ray starts outside the ply.
        let back = 2.0 * (x.abs() + crate::rays::tracer::Tracer::bound_radius_um(&tracer)) / dir.xy().norm().max(1e-3);
        let end = trace_path(&tracer, &surface, Vector3::new(x, 0.0, 0.0) - dir * back, dir, &mut rng);
        let mut cone = |dir: Vector3<f32>| {
            scattered += 1.0;
            out.cone_spread_rad2 += (f64::from(dir.z.clamp(-1.0, 1.0).asin()) + walk.theta_i).powi(2);
        };
        match end {
            PathEnd::Miss => out.miss[bin(dir)] += scale,
            PathEnd::Reflected { dir, .. } => {
                cone(dir);
                out.refl[bin(dir)] += scale;
            }
            PathEnd::High { dir, length_um, .. } => {
                cone(dir);
                for (high, sigma) in out.high.iter_mut().zip(&walk.sigma_per_um) {
                    high[bin(dir)] += scale * (-sigma * f64::from(length_um)).exp();
                }
            }
            PathEnd::Killed => out.killed += 1.0 / walk.paths as f64,
        }
    }
    out.cone_spread_rad2 /= f64::max(scattered, 1.0);
    Ok(out)
}
