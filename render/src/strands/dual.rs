//! Dual scattering over strands: multiple scattering between strands is estimated from the strands that a
//! shadow ray hits (Zinke 2008; Khungurn 2015, 6).
//!
//! A path ends at its first strand. There, light is sampled from one source and by the fiber's lobes,
//! combined by the power heuristic. The shadow ray passes through all strands that it hits, and each
//! attenuates and spreads the light at its own latitude ([`plywave_fiber::dual_scattering`]). With the
//! effective widths of tables, a strand counts only at the wavelengths at which the ray hits it. Unoccluded
//! light is scattered as in path tracing, including the offset if the scene resolves it.
//!
//! Paths scatter at props as in path tracing, so that a floor receives the light that passes through the
//! strands above it. For the strands, props are sources with a single bounce of the light that reaches them
//! through the strands.
//!
//! The averages over a fiber are computed for [`BINS`] sets of wavelengths and for the mean thickness of the
//! strands. A tapered strand has the transmission of the mean one.

use super::StrandHit;
use super::scene::StrandScene;
use super::trace::{Flight, Leaving, ScatterPoint};
use crate::camera::Camera;
use crate::light::{LightSampling, Sources};
use crate::numbers::PathNumbers;
use crate::path::{RenderOptions, Traced, Tracer, render_by};
use crate::roulette::RouletteState;
use crate::spectrum::{Light4, lambda_at, share_below};
use crate::surface::props::Matte;
use crate::{Film, Prop, RenderError, WAVELENGTHS};
use glam::{DVec3, Vec3};
use plywave::{Bsdf, BsdfSample};
use plywave_fiber::dual_scattering::{DualOptions, DualScattering, Occlusion};
use plywave_fiber::{FiberModel, FiberQuery};
use rand::RngExt;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Number of sets of wavelengths, each with [`WAVELENGTHS`] of them: 64 wavelengths, 6 nm apart.
const BINS: usize = 16;
/// Number of turns in the average over a fiber that is not round.
const TURNS: u32 = 16;
/// Largest number of strands that a camera ray passes.
const MAX_PASSED: u32 = 100_000;

/// Options of dual scattering over strands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrandDualOptions {
    /// Densities, sums and samples. A `turns` of 1 becomes 16 for fibers that are not round.
    pub dual: DualOptions,
    /// Whether the strands behind the shading point are counted; otherwise infinitely many are assumed.
    pub behind: bool,
}

impl Default for StrandDualOptions {
    /// d_f = d_b = 1 with the strands behind counted, the options closest to path tracing
    /// (docs/explain/dual_scattering.md).
    fn default() -> Self {
        let dual = DualOptions { forward_density: 1.0, backward_density: 1.0, ..DualOptions::default() };
        StrandDualOptions { dual, behind: true }
    }
}

/// A scene of strands prepared for dual scattering.
pub struct StrandDual<'a> {
    scene: &'a StrandScene,
    /// Averages, indexed by the position of a path's first wavelength within its quarter of the range.
    bins: Arc<[DualScattering<WAVELENGTHS>]>,
    behind: bool,
    /// Density factor d_f of forward scattering.
    density: f32,
}

impl<'a> StrandDual<'a> {
    /// Computes the averages of the fiber's scattering on the current rayon pool.
    ///
    /// # Errors
    /// [`RenderError::Strands`] for a scene without strands, an option outside its range, and a fiber that
    /// scatters no light.
    pub fn new(scene: &'a StrandScene, options: &StrandDualOptions) -> Result<StrandDual<'a>, RenderError> {
        let refuse = |what: String| RenderError::Strands { file: "dual scattering".into(), what };
        let strands = scene.tree().strands();
        if strands.is_empty() {
            return Err(refuse("the scene has no strands; give some, or trace paths".into()));
        }
        let fiber = scene.fiber();
        let larger = scene.larger(strands.mean_radius_mm());
        let mut dual = options.dual;
        if dual.turns == 1 && !is_round(&fiber.model) {
            dual.turns = TURNS;
        }
        let bins = (0..BINS).into_par_iter().map(|bin| {
            let lambda = wavelengths((bin as f32 + 0.5) / BINS as f32);
            let sigma = lambda.map(|l| larger * fiber.sigma_per_um(l));
            let query = FiberQuery { sigma_per_um: sigma, ..FiberQuery::new([1.0, 0.0, 0.0], lambda) };
            DualScattering::new(&fiber.model, &query, dual).map_err(|e| refuse(e.to_string()))
        });
        let bins = bins.collect::<Result<Vec<_>, _>>()?.into();
        Ok(StrandDual { scene, bins, behind: options.behind, density: dual.forward_density })
    }

    /// The same scene with another [`StrandDualOptions::behind`]; the averages are shared.
    #[must_use]
    pub fn with_behind(&self, behind: bool) -> StrandDual<'a> {
        StrandDual { bins: self.bins.clone(), behind, ..*self }
    }

    /// Counts the strands that light from the distance `reach` along a ray passes before it arrives at the
    /// ray's origin, which lies on a strand with this `tangent`.
    fn count(
        &self,
        dual: &DualScattering<WAVELENGTHS>,
        flight: &Flight,
        reach: f64,
        lambda: Light4,
        tangent: DVec3,
        found: &mut Vec<StrandHit>,
    ) -> Occlusion<WAVELENGTHS> {
        self.scene.tree().each(flight.origin, flight.direction, flight.after, reach, &flight.skips, found);
        let mut passed = dual.unoccluded();
        // The light comes from the far end of the ray, so the last hit comes first.
        for hit in found.iter().rev() {
            let hits = self.scene.is_hit(hit, flight.direction, lambda);
            if hits.iter().all(|hits| !hits) {
                continue;
            }
            let before = passed.transmitted;
            // Latitudes are measured from each strand's own root; the drift is that of the strand at the
            // origin.
            let sign = if hit.tangent.dot(tangent) < 0.0 { -1.0 } else { 1.0 };
            passed.drift *= sign;
            passed.pass(dual, hit.tangent.dot(flight.direction).clamp(-1.0, 1.0).asin() as f32, 1.0);
            passed.drift *= sign;
            (0..WAVELENGTHS).filter(|k| !hits[*k]).for_each(|k| passed.transmitted[k] = before[k]);
        }
        passed
    }

    /// Whether a prop occludes a ray before `reach`.
    fn is_blocked(&self, flight: &Flight, reach: f32) -> bool {
        self.scene.prop(flight).is_some_and(|(t, _)| t < reach)
    }

    /// Radiance towards `back` for unit radiance that arrives along `flight` from the distance `reach`.
    fn shade(&self, of: &Shading<'_>, flight: &Flight, reach: f64, found: &mut Vec<StrandHit>) -> Light4 {
        let (scene, w) = (self.scene, flight.direction);
        let tangent = of.place.axes[2];
        let mut passed = self.count(of.dual, flight, reach, of.lambda, tangent, found);
        if self.behind {
            let behind = of.place.flight(-w);
            let until = scene.prop(&behind).map_or(f64::INFINITY, |(t, _)| t.into());
            scene.tree().each(behind.origin, behind.direction, behind.after, until, &behind.skips, found);
            let hits = |hit: &StrandHit| scene.is_hit(hit, behind.direction, of.lambda).contains(&true);
            passed.behind = Some(found.iter().filter(|hit| hits(hit)).count() as u32);
        }
        let (toward, back) = (of.place.local(w), of.place.local(of.back));
        let query = FiberQuery { omega_i: toward, h_rel: None, lambda_um: of.lambda, sigma_per_um: of.sigma };
        let at = of.dual.at(&scene.fiber().model, &query, &passed);
        if !passed.is_direct() {
            return at.radiance(back);
        }
        // By reciprocity, the fiber is evaluated at the offset of the camera's ray.
        let direct = of.fiber.eval(toward);
        let cos = |v: [f32; 3]| (1.0 - v[2] * v[2]).max(0.0).sqrt().max(1e-4);
        let scale = cos(toward) / cos(back);
        let local = at.terms(back).local;
        std::array::from_fn(|k| direct[k] + scale * local[k])
    }

    /// Light that a prop reflects towards strands, if the ray hits one: from one sampled source, through the
    /// strands in between.
    fn of_prop(
        &self,
        dual: &DualScattering<WAVELENGTHS>,
        (position, normal, albedo): (Vec3, DVec3, f32),
        lambda: Light4,
        rng: &mut PathNumbers,
        found: &mut Vec<StrandHit>,
    ) -> Light4 {
        let Some(source) = self.sources().draw(position, lambda, rng) else {
            return [0.0; WAVELENGTHS];
        };
        let (w, reach) = (source.direction.as_dvec3().normalize(), source.reach());
        let cos = w.dot(normal) as f32;
        let flight = beside(position, normal).flight(w);
        if cos <= 0.0 || self.is_blocked(&flight, reach) {
            return [0.0; WAVELENGTHS];
        }
        let passed = self.count(dual, &flight, reach.into(), lambda, normal, found);
        let density = if passed.is_direct() { 1.0 } else { self.density };
        let scale = density * albedo / PI * cos / source.pdf.max(1e-30);
        std::array::from_fn(|k| scale * source.radiance[k] * passed.transmitted[k])
    }

    /// Lamps and sky, with both sampling strategies.
    fn sources(&self) -> Sources<'_> {
        Sources { sampling: LightSampling::Both, ..self.scene.sources() }
    }

    fn add(&self, of: &Shading<'_>, throughput: Light4, rng: &mut PathNumbers, light: &mut Light4) {
        let mut found = Vec::new();
        let sources = self.sources();
        if let Some(source) = sources.draw(of.place.position().as_vec3(), of.lambda, rng) {
            let (w, reach) = (source.direction.as_dvec3().normalize(), source.reach());
            let flight = of.place.flight(w);
            if !self.is_blocked(&flight, reach) {
                let f = self.shade(of, &flight, reach.into(), &mut found);
                let weight = sources.sampling.weight_of_sampled(source.pdf, of.fiber.pdf(of.place.local(w)));
                let scale = weight / source.pdf.max(1e-30);
                (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * f[k] * source.radiance[k] * scale);
            }
        }
        // Samples of the fiber's lobes find the light of wide sources in narrow lobes.
        if let BsdfSample::Scattered(sample) = of.fiber.sample(rng.random()) {
            let flight = of.place.flight(of.place.world(sample.w));
            let (origin, direction) = (flight.origin.as_vec3(), flight.direction.as_vec3());
            if let Some(source) = sources.hit(origin, direction, f32::INFINITY, of.lambda)
                && flight.direction != DVec3::ZERO
                && !self.is_blocked(&flight, source.reach())
            {
                let f = self.shade(of, &flight, source.reach().into(), &mut found);
                let scale = sources.sampling.weight_of_hit(sample.pdf, source.pdf) / sample.pdf.max(1e-30);
                (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * f[k] * source.radiance[k] * scale);
            }
        }
        if self.scene.props.iter().all(|prop| prop.albedo <= 0.0) {
            return;
        }
        // Light from props is sampled uniformly over the sphere.
        let z = 2.0 * rng.random::<f32>() - 1.0;
        let (sin, cos) = (TAU * rng.random::<f32>()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        let flight = of.place.flight(Vec3::new(r * cos, r * sin, z).as_dvec3().normalize());
        let Some((t, prop)) = self.scene.prop(&flight) else { return };
        let position = (flight.origin + flight.direction * f64::from(t)).as_vec3();
        let prop_point = (position, prop.normal(position).as_dvec3(), prop.albedo);
        let radiance = self.of_prop(of.dual, prop_point, of.lambda, rng, &mut found);
        if radiance.iter().any(|l| *l > 0.0) {
            let f = self.shade(of, &flight, f64::from(t) * (1.0 - 1e-6), &mut found);
            (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * f[k] * radiance[k] * 2.0 * TAU);
        }
    }
}

/// A shading point on a strand.
struct Shading<'a> {
    place: &'a ScatterPoint,
    dual: &'a DualScattering<WAVELENGTHS>,
    /// The fiber's scattering function for the direction `back`, at the ray's offset.
    fiber: &'a plywave_fiber::FiberBsdf<'a, WAVELENGTHS>,
    lambda: Light4,
    sigma: Light4,
    /// Unit direction back along the ray.
    back: DVec3,
}

/// A scattering point on a prop.
fn beside(position: Vec3, normal: DVec3) -> ScatterPoint {
    let (x, y) = normal.any_orthonormal_pair();
    ScatterPoint { axes: [x, y, normal], from: Leaving::Prop { position: position.as_dvec3(), normal } }
}

/// Ascending wavelengths [um] of a path whose first wavelength is at the fraction `t`, 0 to 1, of its quarter
/// of the range.
fn wavelengths(t: f32) -> Light4 {
    std::array::from_fn(|k| lambda_at((k as f32 + t) / WAVELENGTHS as f32))
}

/// The bin of a path's wavelengths, and the quarter of the range that contains its first one.
fn bin(lambda: Light4) -> (usize, usize) {
    let at = (share_below(lambda[0]).0 * WAVELENGTHS as f32).clamp(0.0, WAVELENGTHS as f32 - 1e-3);
    (((at.fract() * BINS as f32) as usize).min(BINS - 1), at as usize)
}

/// Whether scattering depends on the relative azimuth alone.
fn is_round(model: &FiberModel) -> bool {
    match model {
        FiberModel::Tabulated(fiber) => fiber.table().symmetry.folds == 0,
        FiberModel::RoughDielectric(fiber) => fiber.parameters().eccentricity == 1.0,
        FiberModel::Dielectric(_) | FiberModel::Opaque(_) | FiberModel::KajiyaKay(_) | FiberModel::Khungurn(_) => true,
    }
}

impl Tracer for StrandDual<'_> {
    fn trace(&self, options: &RenderOptions, ray: (Vec3, Vec3, f32), lambda: Light4, rng: &mut PathNumbers) -> Traced {
        // The averages have their wavelengths in ascending order, so the path's are rotated.
        let (bin, turn) = bin(lambda);
        let up = std::array::from_fn(|k| lambda[(k + WAVELENGTHS - turn) % WAVELENGTHS]);
        let traced = self.follow(options, ray, (&self.bins[bin], up), rng);
        let back = |l: Light4| std::array::from_fn(|k| l[(k + turn) % WAVELENGTHS]);
        Traced { light: back(traced.light), albedo: back(traced.albedo), ..traced }
    }
}

impl StrandDual<'_> {
    fn follow(
        &self,
        options: &RenderOptions,
        (origin, direction, _): (Vec3, Vec3, f32),
        (dual, lambda): (&DualScattering<WAVELENGTHS>, Light4),
        rng: &mut PathNumbers,
    ) -> Traced {
        let scene = self.scene;
        let mut flight = Flight::new(origin.as_dvec3(), direction.as_dvec3().normalize());
        let (mut light, mut albedo, mut throughput) = ([0.0; WAVELENGTHS], [0.0; WAVELENGTHS], [1.0f32; WAVELENGTHS]);
        let mut first = None;
        let mut pdf = f32::INFINITY;
        let mut roulette = RouletteState::new(options.depth);
        let mut passed = 0;
        while passed < MAX_PASSED {
            let prop: Option<(f32, &Prop)> = scene.prop(&flight);
            let hit = flight.first(scene.tree(), prop.map_or(f64::INFINITY, |(t, _)| t.into()));
            let reach = hit.as_ref().map_or_else(|| prop.map_or(f32::INFINITY, |(t, _)| t), |hit| hit.t as f32);
            let ray = (flight.origin.as_vec3(), flight.direction.as_vec3());
            if scene.emitted(ray, reach, pdf, lambda, throughput, &mut light) {
                break;
            }
            if let Some(hit) = hit {
                let axes = hit.frame(scene.reference);
                let (at, hits) = scene.at(&hit, &axes, flight.direction, lambda);
                if !scene.choose(hits, &mut throughput, rng) {
                    flight.pass(&hit);
                    passed += 1;
                    continue;
                }
                if first.is_none() {
                    first = Some((scene.facing(&hit, flight.direction), hit.t as f32));
                    albedo = at.albedo();
                }
                if roulette.goes_on(&throughput, &light, rng) {
                    let sigma = scene.sigma(&hit, lambda);
                    let place = ScatterPoint { axes, from: Leaving::Strand(hit) };
                    let of = Shading { place: &place, dual, fiber: &at, lambda, sigma, back: -flight.direction };
                    self.add(&of, throughput, rng, &mut light);
                }
                break;
            }
            let Some((t, prop)) = prop else { break };
            let position = ray.0 + ray.1 * t;
            let normal = prop.normal(position).as_dvec3();
            if first.is_none() {
                first = Some((normal.as_vec3().to_array(), t));
                albedo = [prop.albedo; WAVELENGTHS];
            }
            let place = beside(position, normal);
            if !roulette.goes_on(&throughput, &light, rng) {
                break;
            }
            let next = scene.scatter(&place, &Matte(prop.albedo), lambda, throughput, rng, &mut light);
            let BsdfSample::Scattered(sample) = next else { break };
            (0..WAVELENGTHS).for_each(|k| throughput[k] *= sample.weight[k]);
            pdf = sample.pdf;
            let w = place.world(sample.w);
            if w == DVec3::ZERO || pdf.is_nan() || pdf <= 0.0 {
                break;
            }
            flight = place.flight(w);
            if !roulette.survives(&mut throughput, rng) {
                break;
            }
        }
        let (light, cut) = roulette.end(light, lambda, first.is_some());
        Traced { light, albedo, hit: first, cut }
    }
}

/// Renders like [`crate::render_strands`], with dual scattering in place of path tracing.
///
/// # Errors
/// Those of [`crate::render`].
pub fn render_strands_dual(
    dual: &StrandDual<'_>,
    camera: &Camera,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    render_by(dual, camera, film, options, stop, after)
}
