//! The extinction theorem, as a check of solved fields.
//!
//! Inside of a body the sources on all outermost walls cancel the incident light: at any point there
//!
//! ```text
//! 0 = e_inc + integral [d_n' G e - (k_rho^2/k_0) G P - (k_z/k_0) d_t' G h] ds
//! 0 = h_inc + integral [d_n' G h - (k_rho^2/k_0) G Q + (k_z/k_0) d_t' G e] ds
//! ```
//!
//! This is linear in the fields and relative to the incident light. Completely wrong fields, such as zeros,
//! violate it by 1, while their powers may add up (0 = 0 + 0) and the residual of the equations is as small
//! as ever. The sums below share no kernel with the equations.

use crate::boundary::entries::{E, H, P, Q};
use crate::boundary::incident::incident;
use crate::scene::curve::CurvePoint;
use crate::special::Ray;
use crate::{C64, PlaneWave, Polarization, Wave, WaveError};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Maximum number of checked bodies.
const BODIES: usize = 16;
/// Number of an outline's points in the search for a point deep inside.
const SAMPLES: usize = 48;
/// Maximum error of fields at an inside point, in units of the tolerance of far fields, and at the finest
/// tolerances.
const TOLERANCES: f64 = 10.0;
const MIN: f64 = 1e-8;
/// Maximum allowed error in any case: wrong fields have 1.
const MAX: f64 = 0.5;
/// Rounding errors, relative to the incident light.
const ROUNDING: f64 = 1e-11;

/// Points inside of bodies.
pub(crate) struct Probes {
    wave: Wave,
    ray: Ray,
    /// Points, each with the allowed error of the fields.
    points: Vec<([f64; 2], f64)>,
}

impl Probes {
    /// Probes for outermost walls, given by their nodes and the nodes' arc lengths [um].
    pub fn new(wave: &Wave, walls: &[(&[CurvePoint], &[f64])], tolerance: f64) -> Self {
        let count = BODIES.min(walls.len());
        let points = (0..count).into_par_iter().filter_map(|k| {
            let (nodes, weights) = walls[k * walls.len() / count];
            let (at, steps) = deepest(nodes, weights)?;
            // The error of the trapezoidal rule is about exp(-2 pi distance / spacing).
            Some((at, ((TOLERANCES * tolerance).max(MIN) + 30.0 * (-5.5 * steps).exp()).min(MAX)))
        });
        Self { wave: *wave, ray: Ray::new(C64::new(wave.k_rho(), 0.0)), points: points.collect() }
    }

    /// No points: every field passes.
    #[cfg(test)]
    pub fn none(wave: &Wave) -> Self {
        Self::new(wave, &[], 1.0)
    }

    /// Refuses fields that do not cancel the incident light. `densities` are `(e, P, h, Q)` node after node,
    /// `stride` nodes per column, one column per source.
    ///
    /// # Errors
    /// [`WaveError::Uncancelled`].
    pub fn check<'a>(
        &self,
        nodes: &[CurvePoint],
        weights: &[f64],
        densities: &[C64],
        stride: usize,
        sources: impl Iterator<Item = &'a (Polarization, Vec<PlaneWave>)>,
    ) -> Result<(), WaveError> {
        let k_rho = self.wave.k_rho();
        let (per_k0, ratio) = (k_rho * k_rho / self.wave.k0(), self.wave.kz() / self.wave.k0());
        let rows: Vec<Vec<[C64; 3]>> = self
            .points
            .par_iter()
            .map(|(x, _)| {
                let one = |(y, w): (&CurvePoint, &f64)| {
                    let (dx, dy) = (x[0] - y.at[0], x[1] - y.at[1]);
                    let r = dx.hypot(dy);
                    let [h0, h1] = self.ray.hankel01(r);
                    let [nx, ny] = y.normal;
                    // Derivatives by y: G' along -(x - y)/R.
                    let along = C64::I * h1 * (0.25 * k_rho * w / r);
                    [along * (dx * nx + dy * ny), C64::I * h0 * (0.25 * w), along * (dy * nx - dx * ny)]
                };
                nodes.iter().zip(weights).map(one).collect()
            })
            .collect();
        for ((polarization, waves), fields) in sources.zip(densities.chunks(4 * stride)) {
            let light: f64 = waves.iter().map(|w| w.amplitude.norm()).sum();
            let largest = fields[..4 * nodes.len()].iter().map(|v| v.norm_sqr()).fold(0.0, f64::max).sqrt();
            for ((at, allowed), row) in self.points.iter().zip(&rows) {
                let point = CurvePoint { at: *at, normal: [1.0, 0.0], speed: 1.0, curvature: 0.0 };
                let arriving = incident(&self.wave, *polarization, waves, &point);
                let (mut e, mut h) = (arriving[E], arriving[H]);
                let size = largest.max(e.norm()).max(h.norm());
                for (u, [dn, g, dt]) in fields.chunks(4).zip(row) {
                    e += dn * u[E] - g * u[P] * per_k0 - dt * u[H] * ratio;
                    h += dn * u[H] - g * u[Q] * per_k0 + dt * u[E] * ratio;
                }
                let remaining = e.norm().max(h.norm());
                // The comparison is written such that a NaN fails it.
                let cancelled = remaining <= allowed * size + ROUNDING * light;
                if !cancelled {
                    return Err(WaveError::Uncancelled { left: remaining / size, allowed: *allowed });
                }
            }
        }
        Ok(())
    }
}

/// The point inside of a wall, among the middles between points of it, that is farthest from all nodes in
/// steps between them; and these steps.
fn deepest(nodes: &[CurvePoint], weights: &[f64]) -> Option<([f64; 2], f64)> {
    let some: Vec<&CurvePoint> = nodes.iter().step_by(nodes.len().div_ceil(SAMPLES)).collect();
    let mut middles: Vec<([f64; 2], f64)> = Vec::new();
    for (j, a) in some.iter().enumerate() {
        for b in &some[j + 1..] {
            let at = [0.5 * (a.at[0] + b.at[0]), 0.5 * (a.at[1] + b.at[1])];
            let squared = nodes.iter().zip(weights).map(|(p, w)| {
                let (dx, dy) = (p.at[0] - at[0], p.at[1] - at[1]);
                (dx * dx + dy * dy) / (w * w)
            });
            middles.push((at, squared.fold(f64::MAX, f64::min).sqrt()));
        }
    }
    middles.sort_by(|a, b| b.1.total_cmp(&a.1));
    middles.into_iter().find(|(at, _)| winds(nodes, weights, *at))
}

/// Whether a wall goes once around a point: the flux of a charge there through it.
fn winds(nodes: &[CurvePoint], weights: &[f64], at: [f64; 2]) -> bool {
    let flux = |(p, w): (&CurvePoint, &f64)| {
        let (dx, dy) = (p.at[0] - at[0], p.at[1] - at[1]);
        w * (dx * p.normal[0] + dy * p.normal[1]) / (dx * dx + dy * dy)
    };
    nodes.iter().zip(weights).map(flux).sum::<f64>() > PI
}
