//! Azimuthal scattering of one fiber by rays, under a beam that is wider than the fiber (Xia 2020, 6: "Ray
//! traced BCSDF").
//!
//! The walk is that of the ply, [`trace_path`], through a section of one straight fiber. For rays only
//! absorption has a length scale, so the fiber is traced at a fixed size that suits the tracer's offsets, and
//! path lengths are scaled back.

use crate::{SingleFiber, WaveError};
use nalgebra::Vector3;
use plywave_runs::RunError;
use plywave_sim::FiberSection;
use plywave_sim::Outline;
use plywave_sim::PlySection;
use plywave_sim::RoughDielectric;
use plywave_sim::ScrewTracer;
use plywave_sim::seeds::stream;
use plywave_sim::{PathEnd, trace_path};
use rand::RngExt;
use std::f64::consts::TAU;

/// Radius of traced fibers [um].
const TRACED_UM: f64 = 10.0;

/// A fiber prepared for tracing.
pub(crate) struct RaySlice {
    fiber: SingleFiber,
    tracer: ScrewTracer,
    surface: RoughDielectric,
    /// Traced size over true size.
    scale: f64,
}

impl RaySlice {
    pub(crate) fn new(fiber: &SingleFiber) -> Result<RaySlice, RunError> {
        if let Some(spec) = &fiber.by_wavelength {
            let what = if spec.is_opaque() { "an opaque fiber" } else { "dispersion" };
            let hint = "use waves; rays trace such fibers in plies".into();
            return Err(WaveError::Unsupported { method: "rays", what: what.into(), hint }.into());
        }
        let section = fiber.section()?;
        let scale = TRACED_UM / section.outer.bounding_radius();
        let scaled = |wall: &Outline| match wall {
            Outline::Circle { radius_um } => Outline::Circle { radius_um: scale * radius_um },
            Outline::Polyline(points) => Outline::Polyline(points.iter().map(|p| p * scale).collect()),
        };
        let section =
            FiberSection { outer: scaled(&section.outer), lumen: section.lumen.as_ref().map(scaled), ..section };
        let ply = PlySection { fibers: vec![section], bound_radius_um: TRACED_UM, twist_per_um: 0.0 };
        let tracer = ScrewTracer::new(&ply).ok_or_else(|| WaveError::Unsupported {
            method: "rays",
            what: "an outline that the tracer cannot resolve".into(),
            hint: "use waves, or a smoother outline".into(),
        })?;
        let surface = RoughDielectric { eta: fiber.body.eta as f32, alpha: fiber.alpha_fiber as f32 };
        Ok(RaySlice { fiber: fiber.clone(), tracer, surface, scale })
    }

    /// Fills `bins` with the scattered light over phi_r - phi_i as a fraction of the light incident on the
    /// fiber [1/rad], bin j centered at `2 pi j / bins`; returns the absorbed fraction. The remaining
    /// fraction is that of killed paths. Incidence is `[theta_i, phi_i]` [rad].
    ///
    /// Rays are stratified over the fiber's shadow, one at random in each of `rays` parts. A ray that misses
    /// the fiber within the tracer's accuracy of the edge counts as undeflected.
    pub(crate) fn trace(
        &self,
        [theta_i, phi_i]: [f64; 2],
        sigma_per_um: f64,
        rays: u64,
        seed: u64,
        place: [u64; 2],
        bins: &mut [f32],
    ) -> f64 {
        let mut rng = stream(seed, place);
        let (sin_t, cos_t) = theta_i.sin_cos();
        let (sin_p, cos_p) = phi_i.sin_cos();
        let dir = -Vector3::new(cos_t * cos_p, cos_t * sin_p, sin_t).cast::<f32>();
        // The shadow exists for every outline of a tracer.
        let [low, high] = self.fiber.shadow_um(phi_i).unwrap_or_default().map(|s| s * self.scale);
        let count = bins.len();
        let mut energy = vec![0.0f64; count];
        let mut absorbed = 0.0;
        let sigma = sigma_per_um / self.scale;
        let back = 3.0 * TRACED_UM / cos_t.max(1e-3);
        for k in 0..rays {
            let s = low + (high - low) * (k as f64 + rng.random::<f64>()) / rays as f64;
            let start = Vector3::new(s * sin_p, -s * cos_p, 0.0).cast::<f32>() - dir * back as f32;
            let (out, weight) = match trace_path(&self.tracer, &self.surface, start, dir, &mut rng) {
                PathEnd::Miss => (dir, 1.0),
                PathEnd::Reflected { dir, .. } => (dir, 1.0),
                PathEnd::High { dir, length_um, .. } => (dir, (-sigma * f64::from(length_um)).exp()),
                PathEnd::Killed => continue,
            };
            absorbed += 1.0 - weight;
            let relative = f64::from(out.y).atan2(f64::from(out.x)) - phi_i;
            let bin = (relative / TAU * count as f64).round().rem_euclid(count as f64) as usize;
            energy[bin.min(count - 1)] += weight;
        }
        let scale = count as f64 / TAU / rays as f64;
        bins.iter_mut().zip(&energy).for_each(|(bin, e)| *bin = (e * scale) as f32);
        absorbed / rays as f64
    }
}
