//! Path tracing with four wavelengths per path: progressive passes over tiles of a film, and the path tracer
//! for a sheet with a scattering function. Direct light is combined with sampled scattering by the power
//! heuristic (Veach 1997, 9.2); Russian roulette and the cut of long paths are in `roulette.rs`.
//!
//! Where the sheet occludes a source, a *chain* follows the ray through the sheet, and counts where it hits
//! a source after some crossings; paths that were sampled otherwise are weighted against it. Chains are
//! followed by roulette, more often where more light goes straight on and where more light is expected. A
//! path that carries more than it began with branches, so that no sample of a pixel has a large weight. The
//! expected picture stays as it is.

use crate::camera::Camera;
use crate::film::{Film, PixelSums, Sample};
use crate::numbers::PathNumbers;
use crate::roulette::{CutSums, RouletteState};
use crate::scene::{Scene, SceneHit, SurfacePoint};
use crate::spectrum::{Light4, lambda_at, xyz};
use crate::surface::props::Matte;
use crate::{LightSampling, RenderError, Surface, WAVELENGTHS};
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
/// Largest number of layers of the sheet that a chain crosses, and number of samples at the first of them.
const CHAIN: usize = 3;
const SPLITS: u32 = 2;
/// Chance of a chain over the share of the light that goes straight on, and light below which a chain is
/// followed less often.
const OFTEN: f32 = 4.0;
const EXPECTED: f32 = 0.15;
/// Throughput above which a path branches, and the most branches that it gets.
const MAX_CARRIED: f32 = 3.0;
const MAX_BRANCHES: usize = 64;
/// Number of samples that measure how much light goes straight on, and the least cosine that counts as
/// straight.
const PROBES: u32 = 1024;
const STRAIGHT: f32 = 0.998;

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
    /// Share of the light that goes about straight on through the sheet; 0 where no chain is followed.
    openness: f32,
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
    let sheet = Sheet { scene, surface, openness: openness(scene, surface) };
    render_by(&sheet, camera, film, options, stop, after)
}

/// Mean share of the light that goes about straight on through the sheet, over places and directions: for
/// how often it is worth to follow light through it.
fn openness<S: Surface>(scene: &Scene, surface: &S) -> f32 {
    if scene.sampling != LightSampling::Both {
        return 0.0;
    }
    let lambda: Light4 = std::array::from_fn(|k| lambda_at((k as f32 + 0.5) / WAVELENGTHS as f32));
    let mut through = 0.0;
    for sample in 0..PROBES {
        let mut rng = PathNumbers::new(0, sample);
        let [z, phi]: [f32; 2] = rng.random();
        // Directions by the cosine, of either side.
        let (z, side) = (z.sqrt(), if sample % 2 == 0 { 1.0 } else { -1.0 });
        let (sin, cos) = (std::f32::consts::TAU * phi).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        let wo = [r * cos, r * sin, side * z.max(0.05)];
        let at = surface.at(scene.place_on_cloth(rng.random()), 0.0, wo, lambda);
        through += match at.sample(rng.random()) {
            BsdfSample::Scattered(s) if -(0..3).map(|k| s.w[k] * wo[k]).sum::<f32>() > STRAIGHT => s.weight[1],
            BsdfSample::Straight { weight, .. } => weight[1],
            _ => 0.0,
        };
    }
    through / PROBES as f32
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
        trace(self, options, ray, lambda, rng)
    }
}

/// A ray of a path and what the path carries along it.
#[derive(Clone, Copy)]
struct Segment {
    origin: Vec3,
    direction: Vec3,
    /// Width of the path's footprint at the origin [mm], and its growth per unit of distance.
    width: f32,
    width_per_mm: f32,
    throughput: Light4,
    /// Density [1/sr] of sampling the direction; infinite where it is certain, as for the camera's.
    pdf: f32,
    /// Number of sources that the last scattering point sampled.
    draws: usize,
}

impl Segment {
    /// The scattering function of the sheet at the end of this ray.
    fn at<'a, S: Surface>(&self, surface: &'a S, point: &SurfacePoint, lambda: Light4) -> S::At<'a> {
        let wo = point.frame.local(-self.direction);
        // Footprint on the cloth: the geometric mean of the axes of its ellipse.
        let footprint_mm = (self.width + self.width_per_mm * point.t) / wo[2].abs().max(0.01).sqrt();
        surface.at(point.uv_um, 1000.0 * footprint_mm, wo, lambda)
    }

    /// Adds the light of a source that the ray hits.
    fn add_light(&self, weight: f32, radiance: &Light4, light: &mut Light4) {
        for k in 0..WAVELENGTHS {
            light[k] += self.throughput[k] * weight * radiance[k];
        }
    }

    /// The ray after scattering at `point` into `direction`, whose density is `pdf` [1/sr].
    fn scattered(&self, point: &SurfacePoint, direction: Vec3, pdf: f32, weight: Light4, draws: usize) -> Segment {
        Segment {
            origin: leave(point, direction),
            direction,
            width: self.width + self.width_per_mm * point.t,
            // A direction of density p stands for a cone of solid angle 1 / p; the footprint grows by a share
            // of that cone's width.
            width_per_mm: self.width_per_mm + SPREAD * (1.0 / pdf.max(1e-3)).sqrt(),
            throughput: std::array::from_fn(|k| self.throughput[k] * weight[k]),
            pdf,
            draws,
        }
    }

    /// The ray after the outcome of sampling at `point`; `None` where the path ends.
    fn next(&self, point: &SurfacePoint, sample: BsdfSample<WAVELENGTHS>, draws: usize) -> Option<Segment> {
        match sample {
            BsdfSample::Scattered(sample) => {
                let direction = point.frame.world(sample.w).normalize_or_zero();
                let is_direction = direction != Vec3::ZERO && sample.pdf > 0.0;
                is_direction.then(|| self.scattered(point, direction, sample.pdf, sample.weight, draws))
            }
            BsdfSample::Straight { weight, .. } => Some(Segment {
                origin: leave(point, self.direction),
                width: self.width + self.width_per_mm * point.t,
                throughput: std::array::from_fn(|k| self.throughput[k] * weight[k]),
                pdf: f32::INFINITY,
                draws,
                ..*self
            }),
            BsdfSample::Absorbed => None,
        }
    }
}

/// A branch of a path: where it goes on, and the light that it has gathered.
struct Branch {
    segment: Segment,
    roulette: RouletteState,
    shares: Shares,
    light: Light4,
}

/// Light along a ray; `width_per_mm` is the width of its footprint per unit of distance.
fn trace<S: Surface>(
    sheet: &Sheet<'_, S>,
    options: &RenderOptions,
    (origin, direction, width_per_mm): (Vec3, Vec3, f32),
    lambda: Light4,
    rng: &mut PathNumbers,
) -> Traced {
    let throughput = [1.0; WAVELENGTHS];
    let segment = Segment { origin, direction, width: 0.0, width_per_mm, throughput, pdf: f32::INFINITY, draws: 1 };
    let mut traced =
        Traced { light: [0.0; WAVELENGTHS], albedo: [0.0; WAVELENGTHS], hit: None, cut: CutSums::default() };
    let roulette = RouletteState::new(options.depth);
    let mut branches = vec![Branch { segment, roulette, shares: Shares::default(), light: [0.0; WAVELENGTHS] }];
    let mut remaining = MAX_BRANCHES;
    while let Some(mut branch) = branches.pop() {
        sheet.follow(&mut branch, lambda, rng, &mut traced, &mut branches, &mut remaining);
        let (light, cut) = branch.roulette.end(branch.light, lambda, traced.hit.is_some());
        for k in 0..WAVELENGTHS {
            traced.light[k] += light[k];
        }
        traced.cut.add(&cut);
    }
    traced.cut.hits = traced.cut.hits.min(1.0);
    traced
}

/// A scattering point of a path.
struct Vertex {
    point: SurfacePoint,
    /// The ray that ends at the point.
    segment: Segment,
    /// Number of sources that the point samples.
    draws: usize,
    /// Number of scatterings before this one, and number that may follow it.
    depth: u32,
    remaining: u32,
    /// Number of rays that the point samples.
    count: usize,
}

/// Shares of the last rays of a path that ended on the sheet: the weights of sampling their directions by
/// scattering, against chains.
#[derive(Clone, Copy)]
struct Shares([f32; CHAIN]);

impl Default for Shares {
    fn default() -> Shares {
        Shares([1.0; CHAIN])
    }
}

impl Shares {
    fn push(&mut self, share: f32) {
        self.0.rotate_left(1);
        self.0[CHAIN - 1] = share;
    }

    fn product(&self) -> f32 {
        self.0.iter().product()
    }
}

impl<S: Surface> Sheet<'_, S> {
    /// Follows a branch to its end. At points at which it carries much it adds branches that share what it
    /// carries, at most `remaining`.
    fn follow(
        &self,
        branch: &mut Branch,
        lambda: Light4,
        rng: &mut PathNumbers,
        traced: &mut Traced,
        branches: &mut Vec<Branch>,
        remaining: &mut usize,
    ) {
        let (scene, mut next) = (self.scene, Vec::new());
        loop {
            let Branch { segment, roulette, shares, light } = branch;
            let scene_hit = scene.first(segment.origin, segment.direction);
            // Add the lamp or sky that the ray hits, if no surface occludes it.
            let reach = scene_hit.map_or(f32::INFINITY, |m| m.point().t);
            if let Some(source) = scene.sources().hit(segment.origin, segment.direction, reach, lambda) {
                let apart = if roulette.is_cut() { 1.0 } else { shares.product() };
                let weight = apart * scene.sampling.weight_of_hit(segment.pdf, source.pdf * segment.draws as f32);
                segment.add_light(weight, &source.radiance, light);
                return;
            }
            let Some(scene_hit) = scene_hit else { return };
            let point = *scene_hit.point();
            let draws = scene.sources().draws(roulette.depth());
            let goes_on = roulette.goes_on(&segment.throughput, light, rng);
            match scene_hit {
                SceneHit::Sheet(_) => shares.push(self.share(segment)),
                SceneHit::Prop(..) => *shares = Shares::default(),
            }
            let mut count = 1;
            if goes_on && !roulette.is_cut() {
                let most = segment.throughput.iter().copied().fold(0.0, f32::max);
                count = ((most / MAX_CARRIED).ceil().max(1.0) as usize).min(*remaining + 1);
                *remaining -= count - 1;
                segment.throughput.iter_mut().for_each(|t| *t /= count as f32);
            }
            let vertex = Vertex {
                point,
                segment: *segment,
                draws,
                depth: roulette.depth(),
                remaining: roulette.remaining(),
                count: if goes_on { count } else { 0 },
            };
            let albedo = match scene_hit {
                SceneHit::Sheet(_) => {
                    let at = segment.at(self.surface, &point, lambda);
                    self.scatter(&vertex, &at, lambda, rng, light, &mut next);
                    at.albedo()
                }
                SceneHit::Prop(_, albedo) => {
                    let at = Matte(albedo);
                    self.scatter(&vertex, &at, lambda, rng, light, &mut next);
                    Bsdf::<WAVELENGTHS>::albedo(&at)
                }
            };
            if traced.hit.is_none() {
                traced.albedo = albedo;
                let normal = point.frame.axes[2];
                let to_camera = if normal.dot(segment.direction) > 0.0 { -normal } else { normal };
                traced.hit = Some((to_camera.to_array(), point.t));
            }
            let Some(first) = next.pop() else { return };
            for segment in next.drain(..) {
                let mut other = Branch { segment, roulette: roulette.branch(), shares: *shares, light: [0.0; 4] };
                if other.roulette.survives(&mut other.segment.throughput, rng) {
                    branches.push(other);
                }
            }
            *segment = first;
            if !roulette.survives(&mut segment.throughput, rng) {
                return;
            }
        }
    }

    /// Adds direct light at a scattering point and samples the next rays, without those that are absorbed.
    fn scatter(
        &self,
        vertex: &Vertex,
        at: &impl Bsdf<WAVELENGTHS>,
        lambda: Light4,
        rng: &mut PathNumbers,
        light: &mut Light4,
        next: &mut Vec<Segment>,
    ) {
        for _ in 0..vertex.count {
            self.direct(vertex, at, lambda, rng, light);
            next.extend(vertex.segment.next(&vertex.point, at.sample(rng.random()), vertex.draws));
        }
    }

    /// Adds direct light from each source, or from one of them ([`Sources::draws`]), weighted against
    /// sampling of the scattering function. Where the sheet occludes a source, a chain follows the light
    /// through it.
    fn direct(
        &self,
        vertex: &Vertex,
        at: &impl Bsdf<WAVELENGTHS>,
        lambda: Light4,
        rng: &mut PathNumbers,
        light: &mut Light4,
    ) {
        let (scene, point, draws) = (self.scene, &vertex.point, vertex.draws);
        for number in 0..draws {
            let Some(source) = scene.sources().draw_of((number, draws), point.position, lambda, rng) else { continue };
            let (f, own) = at.eval_pdf(point.frame.local(source.direction));
            if f.iter().all(|f| *f <= 0.0) {
                continue;
            }
            let pdf = source.pdf * draws as f32;
            let weight = scene.sampling.weight_of_sampled(pdf, own) / pdf.max(1e-30);
            if scene.free(leave(point, source.direction), source.direction, source.reach()) {
                for k in 0..WAVELENGTHS {
                    light[k] += vertex.segment.throughput[k] * f[k] * weight * source.radiance[k];
                }
            } else if self.openness > 0.0 && vertex.remaining > 0 && scene.sources().is_chained(&source) {
                // Roulette by the light that would come if nothing occluded it, and by the part that passes.
                let most = (0..WAVELENGTHS).map(|k| vertex.segment.throughput[k] * f[k] * source.radiance[k]);
                let expected = most.fold(0.0, f32::max) * weight;
                let chance = (OFTEN * self.openness).min(1.0) * (expected / EXPECTED).min(1.0);
                if rng.random::<f32>() >= chance {
                    continue;
                }
                let weight = f.map(|f| f * weight / chance);
                let segment = vertex.segment.scattered(point, source.direction, own, weight, draws);
                self.chain(segment, vertex.depth + 1, vertex.remaining, lambda, rng, light);
            }
        }
    }

    /// Adds the light of sources that comes through the sheet along a ray that was sampled towards a source:
    /// at each crossing the scattering function alone is sampled, and only rays that hit a source count.
    /// Together with [`Sheet::share`] the weights of the ways to sample such a path sum to 1.
    fn chain(
        &self,
        first: Segment,
        depth: u32,
        remaining: u32,
        lambda: Light4,
        rng: &mut PathNumbers,
        light: &mut Light4,
    ) {
        let scene = self.scene;
        let Some(SceneHit::Sheet(first_point)) = scene.first(first.origin, first.direction) else { return };
        let first_at = first.at(self.surface, &first_point, lambda);
        for split in 0..SPLITS {
            let [u, v, w]: [f32; 3] = rng.random();
            let u = [(u + split as f32) / SPLITS as f32, v, w];
            let draws = scene.sources().draws(depth);
            let mut next = first.next(&first_point, first_at.sample(u), draws);
            let mut weight = 1.0 / SPLITS as f32;
            for crossed in 1..=(CHAIN as u32).min(remaining) {
                let Some(segment) = next else { break };
                let scene_hit = scene.first(segment.origin, segment.direction);
                let reach = scene_hit.map_or(f32::INFINITY, |m| m.point().t);
                if let Some(source) = scene.sources().hit(segment.origin, segment.direction, reach, lambda) {
                    weight *= scene.sampling.weight_of_hit(segment.pdf, source.pdf * segment.draws as f32);
                    segment.add_light(weight, &source.radiance, light);
                    break;
                }
                let Some(SceneHit::Sheet(point)) = scene_hit else { break };
                if crossed == (CHAIN as u32).min(remaining) {
                    break;
                }
                weight *= self.share(&segment);
                let at = segment.at(self.surface, &point, lambda);
                next = segment.next(&point, at.sample(rng.random()), scene.sources().draws(depth + crossed));
            }
        }
    }

    /// Weight of sampling the direction of a ray that ends on the sheet by scattering, against a chain that
    /// begins with the same ray.
    fn share(&self, segment: &Segment) -> f32 {
        if self.openness <= 0.0 {
            return 1.0;
        }
        match self.scene.sources().chained_pdf(segment.origin, segment.direction) {
            Some(pdf) => self.scene.sampling.weight_of_hit(segment.pdf, pdf * segment.draws as f32),
            None => 1.0,
        }
    }
}

/// Start of a ray that leaves the sheet, offset to the side that `direction` points to.
pub(crate) fn leave(point: &SurfacePoint, direction: Vec3) -> Vec3 {
    let offset = 1e-5 * (1.0 + point.position.abs().max_element());
    point.position + point.face * offset.copysign(point.face.dot(direction))
}
