//! Path tracing over strands: direct light combines light sampling with fiber sampling by the power
//! heuristic.
//!
//! A path that hits a strand continues from the hit point and cannot hit the same strand again before it is
//! outside, because the fiber model contains all scattering inside. With a table, a path may hit a strand at
//! some wavelengths and pass at others (Xia 2020, 6): one of the two groups is followed, chosen in proportion
//! to its throughput and weighted accordingly; light from a source is attenuated by wavelength. The width at
//! a ray's direction equals that for light in the opposite direction, because extinction is reciprocal.

use super::scene::StrandScene;
use super::{Skip, StrandHit, StrandShape};
use crate::camera::Camera;
use crate::numbers::PathNumbers;
use crate::path::{RenderOptions, Traced, Tracer, render_by};
use crate::roulette::RouletteState;
use crate::spectrum::Light4;
use crate::surface::props::Matte;
use crate::{Film, Prop, RenderError, StrandTree, WAVELENGTHS};
use glam::{DVec3, Vec3};
use plywave::{Bsdf, BsdfSample};
use rand::RngExt;
use std::sync::atomic::AtomicBool;

/// Largest number of strands that a ray passes; it guards against endless loops and is not reached in
/// practice.
const MAX_PASSED: u32 = 100_000;

/// Renders strands by path tracing; arguments are those of [`crate::render`].
///
/// # Errors
/// Those of [`crate::render`].
pub fn render_strands(
    scene: &StrandScene,
    camera: &Camera,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    render_by(scene, camera, film, options, stop, after)
}

/// A ray in flight through strands.
#[derive(Clone, Debug)]
pub(super) struct Flight {
    pub origin: DVec3,
    pub direction: DVec3,
    /// Distance travelled [mm].
    pub after: f64,
    /// Strands that contain the ray's start, which it cannot hit before it is outside.
    pub skips: Vec<Skip>,
}

impl Flight {
    pub fn new(origin: DVec3, direction: DVec3) -> Flight {
        Flight { origin, direction, after: 0.0, skips: Vec::new() }
    }

    pub fn first(&self, tree: &StrandTree, before: f64) -> Option<StrandHit> {
        tree.first(self.origin, self.direction, self.after, before, &self.skips)
    }

    /// Continues behind a hit as if it had not occurred.
    pub fn pass(&mut self, hit: &StrandHit) {
        self.after = hit.t;
        self.skips.retain(|skip| skip.until > hit.t);
        let Skip { strand, until } = hit.leave(self.direction);
        self.skips.push(Skip { strand, until: hit.t + until });
    }

    /// Continues from a hit in another direction.
    fn leave(&mut self, hit: &StrandHit, direction: DVec3) {
        (self.origin, self.direction, self.after) = (hit.position, direction, 0.0);
        self.skips.clear();
        self.skips.push(hit.leave(direction));
    }
}

/// Scattering point of a path: its axes, and how the path leaves it.
pub(super) struct ScatterPoint {
    pub axes: [DVec3; 3],
    pub from: Leaving,
}

pub(super) enum Leaving {
    Strand(StrandHit),
    Prop { position: DVec3, normal: DVec3 },
}

impl ScatterPoint {
    pub fn local(&self, w: DVec3) -> [f32; 3] {
        self.axes.map(|a| a.dot(w) as f32)
    }

    pub fn world(&self, w: [f32; 3]) -> DVec3 {
        let w = w.map(f64::from);
        (self.axes[0] * w[0] + self.axes[1] * w[1] + self.axes[2] * w[2]).normalize_or_zero()
    }

    pub fn position(&self) -> DVec3 {
        match &self.from {
            Leaving::Strand(hit) => hit.position,
            Leaving::Prop { position, .. } => *position,
        }
    }

    pub fn flight(&self, direction: DVec3) -> Flight {
        match &self.from {
            Leaving::Strand(hit) => {
                let mut flight = Flight::new(hit.position, direction);
                flight.leave(hit, direction);
                flight
            }
            Leaving::Prop { position, normal } => {
                let offset = 1e-6 * (1.0 + position.abs().max_element());
                Flight::new(*position + *normal * offset, direction)
            }
        }
    }
}

impl Tracer for StrandScene {
    fn trace(
        &self,
        options: &RenderOptions,
        (origin, direction, _): (Vec3, Vec3, f32),
        lambda: Light4,
        rng: &mut PathNumbers,
    ) -> Traced {
        let mut flight = Flight::new(origin.as_dvec3(), direction.as_dvec3().normalize());
        let (mut light, mut albedo, mut throughput) = ([0.0; WAVELENGTHS], [0.0; WAVELENGTHS], [1.0f32; WAVELENGTHS]);
        let mut first = None;
        // Density [1/sr] of sampling the current direction; the camera's direction counts as certain.
        let mut pdf = f32::INFINITY;
        let mut roulette = RouletteState::new(options.depth);
        let mut passed = 0;
        while passed < MAX_PASSED {
            let ray = (flight.origin.as_vec3(), flight.direction.as_vec3());
            let prop = self.prop(&flight);
            let hit = flight.first(self.tree(), prop.map_or(f64::INFINITY, |(t, _)| t.into()));
            let reach = hit.as_ref().map_or_else(|| prop.map_or(f32::INFINITY, |(t, _)| t), |hit| hit.t as f32);
            if self.emitted(ray, reach, pdf, lambda, throughput, &mut light) {
                break;
            }
            let next = match (hit, prop) {
                (Some(hit), _) => {
                    let axes = hit.frame(self.reference);
                    let (at, hits) = self.at(&hit, &axes, flight.direction, lambda);
                    if !self.choose(hits, &mut throughput, rng) {
                        flight.pass(&hit);
                        passed += 1;
                        continue;
                    }
                    if first.is_none() {
                        first = Some((self.facing(&hit, flight.direction), hit.t as f32));
                        albedo = at.albedo();
                    }
                    let place = ScatterPoint { axes, from: Leaving::Strand(hit) };
                    let goes_on = roulette.goes_on(&throughput, &light, rng);
                    goes_on.then(|| (self.scatter(&place, &at, lambda, throughput, rng, &mut light), place))
                }
                (None, Some((t, prop))) => {
                    let position = ray.0 + ray.1 * t;
                    let normal = prop.normal(position).as_dvec3();
                    let (x, y) = normal.any_orthonormal_pair();
                    let at = Matte(prop.albedo);
                    if first.is_none() {
                        first = Some((normal.as_vec3().to_array(), t));
                        albedo = [prop.albedo; WAVELENGTHS];
                    }
                    let from = Leaving::Prop { position: position.as_dvec3(), normal };
                    let place = ScatterPoint { axes: [x, y, normal], from };
                    let goes_on = roulette.goes_on(&throughput, &light, rng);
                    goes_on.then(|| (self.scatter(&place, &at, lambda, throughput, rng, &mut light), place))
                }
                (None, None) => break,
            };
            let Some((sample, place)) = next else { break };
            match sample {
                BsdfSample::Scattered(sample) => {
                    (0..WAVELENGTHS).for_each(|k| throughput[k] *= sample.weight[k]);
                    pdf = sample.pdf;
                    let w = place.world(sample.w);
                    if w == DVec3::ZERO || pdf.is_nan() || pdf <= 0.0 {
                        break;
                    }
                    flight = place.flight(w);
                }
                BsdfSample::Straight { weight, .. } => {
                    (0..WAVELENGTHS).for_each(|k| throughput[k] *= weight[k]);
                    flight = place.flight(flight.direction);
                    pdf = f32::INFINITY;
                }
                BsdfSample::Absorbed => break,
            }
            if !roulette.survives(&mut throughput, rng) {
                break;
            }
        }
        let (light, cut) = roulette.end(light, lambda, first.is_some());
        Traced { light, albedo, hit: first, cut }
    }
}

impl StrandScene {
    /// Chooses, where a path hits at some wavelengths and passes at others, which group is followed, in
    /// proportion to its throughput; returns whether the path scatters.
    pub(super) fn choose(&self, hits: [bool; WAVELENGTHS], throughput: &mut Light4, rng: &mut PathNumbers) -> bool {
        let carried = |of: bool| (0..WAVELENGTHS).filter(|k| hits[*k] == of).map(|k| throughput[k]).sum::<f32>();
        let (scattered, straight) = (carried(true), carried(false));
        let all = scattered + straight;
        if scattered <= 0.0 || straight > 0.0 && rng.random::<f32>() * all >= scattered {
            let scale = all / straight.max(1e-30);
            (0..WAVELENGTHS).for_each(|k| throughput[k] *= if hits[k] { 0.0 } else { scale });
            return false;
        }
        if straight > 0.0 {
            let scale = all / scattered;
            (0..WAVELENGTHS).for_each(|k| throughput[k] *= if hits[k] { scale } else { 0.0 });
        }
        true
    }

    /// Normal of a strand on the side of the ray's origin.
    pub(super) fn facing(&self, hit: &StrandHit, direction: DVec3) -> [f32; 3] {
        let across = hit.position - hit.center;
        let across = across - hit.tangent * hit.tangent.dot(across);
        let normal = match self.tree().shape() {
            StrandShape::Tube => across.normalize_or(-direction),
            StrandShape::Band => -direction,
        };
        normal.as_vec3().to_array()
    }

    /// The first prop that a ray hits, and its distance [mm].
    pub(super) fn prop(&self, flight: &Flight) -> Option<(f32, &Prop)> {
        let (origin, direction) = (flight.origin.as_vec3(), flight.direction.as_vec3());
        self.props
            .iter()
            .filter_map(|prop| prop.hit(origin, direction).filter(|t| f64::from(*t) > flight.after).map(|t| (t, prop)))
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Adds the light of the source at the end of a ray, if no object occludes it; returns whether the ray
    /// ends.
    pub(super) fn emitted(
        &self,
        (origin, direction): (Vec3, Vec3),
        reach: f32,
        pdf: f32,
        lambda: Light4,
        throughput: Light4,
        light: &mut Light4,
    ) -> bool {
        let Some(source) = self.sources().hit(origin, direction, reach, lambda) else { return reach.is_infinite() };
        let weight = self.sampling.weight_of_hit(pdf, source.pdf);
        (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * weight * source.radiance[k]);
        true
    }

    /// Adds direct light from one source at a point, and samples the next direction.
    pub(super) fn scatter(
        &self,
        place: &ScatterPoint,
        at: &impl Bsdf<WAVELENGTHS>,
        lambda: Light4,
        throughput: Light4,
        rng: &mut PathNumbers,
        light: &mut Light4,
    ) -> BsdfSample<WAVELENGTHS> {
        self.direct(place, at, lambda, throughput, rng, light);
        at.sample(rng.random())
    }

    fn direct(
        &self,
        place: &ScatterPoint,
        at: &impl Bsdf<WAVELENGTHS>,
        lambda: Light4,
        throughput: Light4,
        rng: &mut PathNumbers,
        light: &mut Light4,
    ) {
        let Some(source) = self.sources().draw(place.position().as_vec3(), lambda, rng) else { return };
        let w = source.direction.as_dvec3().normalize();
        let local = place.local(w);
        let (f, own) = at.eval_pdf(local);
        if f.iter().all(|f| *f <= 0.0) {
            return;
        }
        let passes = self.passes(place.flight(w), source.reach(), lambda);
        let weight = self.sampling.weight_of_sampled(source.pdf, own) / source.pdf.max(1e-30);
        (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * f[k] * weight * source.radiance[k] * passes[k]);
    }

    /// Transmission of light from the distance `reach` to the ray's origin, by wavelength: 0 where a strand
    /// occludes it.
    fn passes(&self, mut flight: Flight, reach: f32, lambda: Light4) -> Light4 {
        let (origin, direction) = (flight.origin.as_vec3(), flight.direction.as_vec3());
        let blocks = |prop: &Prop| prop.hit(origin, direction).is_some_and(|t| t < reach);
        let mut passes = [1.0; WAVELENGTHS];
        if self.props.iter().any(blocks) {
            return [0.0; WAVELENGTHS];
        }
        for _ in 0..MAX_PASSED {
            let Some(hit) = flight.first(self.tree(), reach.into()) else { return passes };
            if !self.is_limited() {
                break;
            }
            let hits = self.is_hit(&hit, flight.direction, lambda);
            (0..WAVELENGTHS).filter(|k| hits[*k]).for_each(|k| passes[k] = 0.0);
            if passes.iter().all(|p| *p <= 0.0) {
                break;
            }
            flight.pass(&hit);
        }
        [0.0; WAVELENGTHS]
    }
}
