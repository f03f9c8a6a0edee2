//! Path tracing with four wavelengths per path: progressive passes over tiles of a film, and the path tracer
//! for a sheet with a scattering function. Direct light is combined with sampled scattering by the power
//! heuristic (Veach 1997, 9.2); Russian roulette and the cut of long paths are in `roulette.rs`.

use crate::camera::Camera;
use crate::film::{Film, PixelSums, Sample};
use crate::numbers::PathNumbers;
use crate::roulette::{CutSums, RouletteState};
use crate::scene::{Scene, SceneHit, SurfacePoint};
use crate::spectrum::{Light4, lambda_at, xyz};
use crate::surface::props::Matte;
use crate::{RenderError, Surface, WAVELENGTHS};
use glam::Vec3;
use plywave::math::hash::{GAMMA, mix64};
use plywave::{Bsdf, BsdfSample};
use rand::RngExt;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of a tile [pixels].
const TILE: u32 = 16;
/// Width of a scattered path's footprint cone relative to the cone that its sampling density stands for.
const SPREAD: f32 = 0.1;

/// Number of samples, depth and seed of a render.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Total samples per pixel.
    pub samples: u32,
    /// Largest number of scatterings of a path; [`crate::MAX_SCATTERINGS`] omits almost no light.
    pub depth: u32,
    /// Seed of the random numbers. A sample of a pixel depends on seed, pixel and its number alone.
    pub seed: u64,
}

/// Position of a pixel and the sums of its new samples.
type Pixel = (u32, u32, PixelSums);

/// Result of tracing a path: its light, the data of its first hit, and the sums for cuts.
pub(crate) struct Traced {
    /// Radiance, by wavelength.
    pub light: Light4,
    /// Albedo of the first hit.
    pub albedo: Light4,
    /// Unit normal on the camera's side and distance [mm] of the first hit.
    pub hit: Option<([f32; 3], f32)>,
    /// Sums that estimate the light that cuts omit.
    pub cut: CutSums,
}

/// A scene through which paths are traced.
pub(crate) trait Tracer: Sync {
    /// Whether the samples of a pixel share one low-discrepancy sequence.
    const EVEN: bool = true;

    /// Traces the light along a ray from the camera: its origin [mm], its unit direction, and the width of a
    /// pixel at unit distance.
    fn trace(&self, options: &RenderOptions, ray: (Vec3, Vec3, f32), lambda: Light4, rng: &mut PathNumbers) -> Traced;
}

/// A scene whose sheet has a scattering function.
struct Sheet<'a, S> {
    scene: &'a Scene,
    surface: &'a S,
}

/// Adds samples to a film in passes until each pixel has `options.samples`. After each pass, `after` receives
/// the film and may write it. Tiles run on the current rayon pool. The picture does not depend on the number
/// of threads or on interruptions.
///
/// # Errors
/// [`RenderError::Stopped`] when `stop` was set, and the errors of `after`.
pub fn render<S: Surface>(
    scene: &Scene,
    camera: &Camera,
    surface: &S,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    render_by(&Sheet { scene, surface }, camera, film, options, stop, after)
}

/// Renders like [`render`], with any tracer.
pub(crate) fn render_by(
    tracer: &impl Tracer,
    camera: &Camera,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    let (width, height) = (film.width(), film.height());
    let across = width.div_ceil(TILE);
    let tiles = across * height.div_ceil(TILE);
    while film.samples() < options.samples {
        let first = film.samples();
        // Passes grow: the first picture appears early, and later passes cost little overhead.
        let count = (first / 2).clamp(1, 16).min(options.samples - first);
        let own: Vec<u32> = (0..tiles).filter(|tile| film.has_tile(*tile)).collect();
        let done: Vec<Option<Vec<Pixel>>> = own
            .into_par_iter()
            .map(|tile| {
                let (x0, y0) = (tile % across * TILE, tile / across * TILE);
                let mut pixels = Vec::with_capacity((TILE * TILE) as usize);
                for y in y0..(y0 + TILE).min(height) {
                    for x in x0..(x0 + TILE).min(width) {
                        if stop.load(Ordering::Relaxed) {
                            return None;
                        }
                        let mut sums = PixelSums::default();
                        for sample in first..first + count {
                            sums.add(&pixel(tracer, camera, options, (x, y), (width, height), sample));
                        }
                        pixels.push((x, y, sums));
                    }
                }
                Some(pixels)
            })
            .collect();
        if stop.load(Ordering::Relaxed) {
            return Err(RenderError::Stopped { done: first, total: options.samples });
        }
        for (x, y, sums) in done.into_iter().flatten().flatten() {
            film.add(x, y, &sums, count);
        }
        film.count(count);
        after(film)?;
    }
    Ok(())
}

/// Traces one sample of a pixel.
fn pixel<T: Tracer>(
    tracer: &T,
    camera: &Camera,
    options: &RenderOptions,
    (x, y): (u32, u32),
    (width, height): (u32, u32),
    sample: u32,
) -> Sample {
    let place = u64::from(y) * u64::from(width) + u64::from(x);
    let seed = mix(options.seed, place);
    let mut rng = if T::EVEN { PathNumbers::new(seed, sample) } else { PathNumbers::independent(seed, sample) };
    let (px, py) = (x as f32 + rng.random::<f32>(), y as f32 + rng.random::<f32>());
    let first: f32 = rng.random();
    let lambda: Light4 = std::array::from_fn(|k| lambda_at((first + k as f32 / WAVELENGTHS as f32).fract()));
    let (origin, direction) = camera.ray(px, py, width, height);
    let width_per_mm = camera.pixel_width(height);
    // The tracer draws no random numbers before the first hit, so the first hit does not change the random
    // numbers of the light.
    let Traced { light, albedo, hit, cut } = tracer.trace(options, (origin, direction, width_per_mm), lambda, &mut rng);
    let hit = hit.map(|(normal, t)| (normal, camera.depth(direction, t)));
    Sample { light: xyz(lambda, light), albedo: xyz(lambda, albedo), hit, cut }
}

fn mix(a: u64, b: u64) -> u64 {
    mix64(a ^ b.wrapping_mul(GAMMA).wrapping_add(0x7f4a_7c15))
}

impl<S: Surface> Tracer for Sheet<'_, S> {
    fn trace(&self, options: &RenderOptions, ray: (Vec3, Vec3, f32), lambda: Light4, rng: &mut PathNumbers) -> Traced {
        trace(self.scene, self.surface, options, ray, lambda, rng)
    }
}

/// Light along a ray; `width_per_mm` is the width of its footprint per unit of distance.
fn trace<S: Surface>(
    scene: &Scene,
    surface: &S,
    options: &RenderOptions,
    (mut origin, mut direction, mut width_per_mm): (Vec3, Vec3, f32),
    lambda: Light4,
    rng: &mut PathNumbers,
) -> Traced {
    // Width of the path's footprint [mm], which grows with the distance travelled.
    let mut width = 0.0;
    let mut hit = None;
    let (mut light, mut albedo, mut throughput) = ([0.0; WAVELENGTHS], [0.0; WAVELENGTHS], [1.0f32; WAVELENGTHS]);
    // Density [1/sr] of sampling the current direction; the camera's direction counts as certain.
    let mut pdf = f32::INFINITY;
    let mut roulette = RouletteState::new(options.depth);
    // Number of sources that the last scattering point sampled.
    let mut draws = 1;
    loop {
        let scene_hit = scene.first(origin, direction);
        // Add the lamp or sky that the ray hits, if no surface occludes it.
        let reach = scene_hit.map_or(f32::INFINITY, |m| m.point().t);
        if let Some(source) = scene.sources().hit(origin, direction, reach, lambda) {
            let weight = scene.sampling.weight_of_hit(pdf, source.pdf * draws as f32);
            for k in 0..WAVELENGTHS {
                light[k] += throughput[k] * weight * source.radiance[k];
            }
            break;
        }
        let Some(scene_hit) = scene_hit else { break };
        let point = *scene_hit.point();
        width += width_per_mm * point.t;
        draws = scene.sources().draws(roulette.depth());
        let goes_on = roulette.goes_on(&throughput, &light, rng);
        let (hit_albedo, next) = match scene_hit {
            SceneHit::Sheet(_) => {
                let wo = point.frame.local(-direction);
                // Footprint on the cloth: the geometric mean of the axes of its ellipse.
                let footprint_mm = width / wo[2].abs().max(0.01).sqrt();
                let at = surface.at(point.uv_um, 1000.0 * footprint_mm, wo, lambda);
                (at.albedo(), scatter(scene, &point, &at, goes_on, draws, (lambda, throughput), rng, &mut light))
            }
            SceneHit::Prop(_, albedo) => {
                let at = Matte(albedo);
                let next = scatter(scene, &point, &at, goes_on, draws, (lambda, throughput), rng, &mut light);
                (Bsdf::<WAVELENGTHS>::albedo(&at), next)
            }
        };
        if roulette.depth() == 0 {
            albedo = hit_albedo;
            let normal = point.frame.axes[2];
            let to_camera = if normal.dot(direction) > 0.0 { -normal } else { normal };
            hit = Some((to_camera.to_array(), point.t));
        }
        match next {
            BsdfSample::Scattered(sample) => {
                for k in 0..WAVELENGTHS {
                    throughput[k] *= sample.weight[k];
                }
                pdf = sample.pdf;
                // A direction of density p stands for a cone of solid angle 1 / p; the footprint grows by a
                // share of that cone's width.
                width_per_mm += SPREAD * (1.0 / pdf.max(1e-3)).sqrt();
                direction = point.frame.world(sample.w).normalize_or_zero();
                if direction == Vec3::ZERO || pdf <= 0.0 {
                    break;
                }
            }
            BsdfSample::Straight { weight, .. } => {
                for k in 0..WAVELENGTHS {
                    throughput[k] *= weight[k];
                }
                pdf = f32::INFINITY;
            }
            BsdfSample::Absorbed => break,
        }
        origin = leave(&point, direction);
        if !roulette.survives(&mut throughput, rng) {
            break;
        }
    }
    let (light, cut) = roulette.end(light, lambda, hit.is_some());
    Traced { light, albedo, hit, cut }
}

/// Adds direct light at a scattering point and samples the next direction; the path is absorbed unless
/// `goes_on`.
fn scatter(
    scene: &Scene,
    point: &SurfacePoint,
    at: &impl Bsdf<WAVELENGTHS>,
    goes_on: bool,
    draws: usize,
    (lambda, throughput): (Light4, Light4),
    rng: &mut PathNumbers,
    light: &mut Light4,
) -> BsdfSample<WAVELENGTHS> {
    if !goes_on {
        return BsdfSample::Absorbed;
    }
    direct(scene, point, at, draws, (lambda, throughput), rng, light);
    at.sample(rng.random())
}

/// Start of a ray that leaves the sheet, offset to the side that `direction` points to.
pub(crate) fn leave(point: &SurfacePoint, direction: Vec3) -> Vec3 {
    let offset = 1e-5 * (1.0 + point.position.abs().max_element());
    point.position + point.face * offset.copysign(point.face.dot(direction))
}

/// Adds direct light from each source, or from one of them ([`Sources::draws`]), weighted against sampling of
/// the scattering function.
fn direct(
    scene: &Scene,
    point: &SurfacePoint,
    at: &impl Bsdf<WAVELENGTHS>,
    draws: usize,
    (lambda, throughput): (Light4, Light4),
    rng: &mut PathNumbers,
    light: &mut Light4,
) {
    for number in 0..draws {
        let Some(source) = scene.sources().draw_of((number, draws), point.position, lambda, rng) else { continue };
        let local = point.frame.local(source.direction);
        let (f, own) = at.eval_pdf(local);
        let is_free = || scene.free(leave(point, source.direction), source.direction, source.reach());
        if f.iter().all(|f| *f <= 0.0) || !is_free() {
            continue;
        }
        let pdf = source.pdf * draws as f32;
        let weight = scene.sampling.weight_of_sampled(pdf, own) / pdf.max(1e-30);
        for k in 0..WAVELENGTHS {
            light[k] += throughput[k] * f[k] * weight * source.radiance[k];
        }
    }
}
