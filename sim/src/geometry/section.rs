//! The cross section of a ply: fibers placed without overlap in the plane z = 0 (Yu 2025, 4.1, Fig. 5a).
//!
//! Along z the whole section rotates rigidly about the axis, so fibers that are separate at z = 0 are
//! separate everywhere.

use crate::error::SimError;
use crate::geometry::fiber_section::FiberSection;
use crate::geometry::outline::Outline;
use crate::geometry::{packing, shape};
use plywave::spec::YarnSpec;
use rand::{Rng, RngExt};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// The cross section of a ply at z = 0; at height z it is rotated by `z * twist_per_um` about the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct PlySection {
    /// The fibers.
    pub fibers: Vec<FiberSection>,
    /// Radius of the smallest circle about the axis that contains all fibers [um].
    pub bound_radius_um: f64,
    /// Twist, `2 pi / pitch` [rad/um]: positive for Z twist, negative for S twist, 0 for parallel fibers.
    pub twist_per_um: f64,
}

impl PlySection {
    /// Draws the fibers of `spec` and packs them. The same seed gives the same section.
    ///
    /// # Errors
    /// [`SimError::CannotPack`] when the fibers do not fit within the ply, [`SimError::BadOutline`] for a
    /// shape that cannot be built.
    pub fn generate(spec: &YarnSpec, seed: u64) -> Result<PlySection, SimError> {
        let mut rng = Pcg64Mcg::new(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835 ^ u128::from(seed) << 1);
        let mut fibers = Vec::new();
        let second = which_second(spec, &mut rng);
        for i in 0..spec.ply.fibers as usize {
            let kind = spec.blend.as_ref().filter(|_| second.contains(&i)).map(|blend| &blend.fiber);
            let fiber = shape::draw(kind.unwrap_or(&spec.fiber), &mut rng)?;
            fibers.push(FiberSection { second: kind.is_some(), ..fiber });
        }
        packing::pack(&mut fibers, spec, &mut rng)?;
        let bound_radius_um = fibers.iter().map(reach).fold(0.0, f64::max);
        Ok(PlySection { fibers, bound_radius_um, twist_per_um: spec.ply.twist().rad_per_um() })
    }

    /// Rotation of the section at height `z_um` [rad].
    pub fn turn(&self, z_um: f64) -> f64 {
        z_um * self.twist_per_um
    }

    /// `[n]`: probability that the line x = `h_um[n]` hits a fiber of a randomly rotated section, the mean
    /// over `turns` equidistant rotations.
    pub fn chance_to_meet(&self, h_um: &[f64], turns: usize) -> Vec<f64> {
        let mut hits = vec![0usize; h_um.len()];
        for k in 0..turns {
            let (sin, cos) = (TAU * (k as f64 + 0.5) / turns as f64).sin_cos();
            // A fiber covers one interval of lines.
            let stretches: Vec<(f64, f64)> = self
                .fibers
                .iter()
                .map(|f| match &f.outer {
                    Outline::Circle { radius_um } => {
                        let x = cos * f.center_um.x - sin * f.center_um.y;
                        (x - radius_um, x + radius_um)
                    }
                    Outline::Polyline(points) => points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
                        let p = f.to_ply(*p);
                        let x = cos * p.x - sin * p.y;
                        (a.min(x), b.max(x))
                    }),
                })
                .collect();
            for (hits, h) in hits.iter_mut().zip(h_um) {
                *hits += usize::from(stretches.iter().any(|(a, b)| a <= h && h <= b));
            }
        }
        hits.into_iter().map(|n| n as f64 / turns.max(1) as f64).collect()
    }

    /// Minimum gap between any two fibers [um], infinite for fewer than two; exact for the stored outlines.
    pub fn min_gap_um(&self) -> f64 {
        let mut min = f64::INFINITY;
        for (i, a) in self.fibers.iter().enumerate() {
            for b in &self.fibers[i + 1..] {
                let bounds = a.outer.bounding_radius() + b.outer.bounding_radius();
                if (a.center_um - b.center_um).norm() - bounds < min {
                    min = min.min(a.min_distance(b));
                }
            }
        }
        min
    }
}

/// Chooses the fibers of the second kind. For n fibers and a share s their number is n s, rounded up or down
/// at random, so that the mean over sections is the share. A ply of one kind draws no random numbers.
fn which_second<R: Rng>(spec: &YarnSpec, rng: &mut R) -> Vec<usize> {
    let Some(blend) = &spec.blend else { return Vec::new() };
    let count = spec.ply.fibers as usize;
    let wanted = ((count as f64 * blend.share + rng.random::<f64>()) as usize).min(count);
    let mut all: Vec<usize> = (0..count).collect();
    for i in 0..wanted {
        all.swap(i, rng.random_range(i..count));
    }
    all.truncate(wanted);
    all
}

/// Maximum distance of a fiber's points from the axis [um].
fn reach(fiber: &FiberSection) -> f64 {
    match &fiber.outer {
        Outline::Circle { radius_um } => fiber.center_um.norm() + radius_um,
        Outline::Polyline(points) => points.iter().map(|&p| fiber.to_ply(p).norm()).fold(0.0, f64::max),
    }
}
