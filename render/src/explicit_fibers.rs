//! Path tracing of a sheet of explicit fibers, which serves as the reference for the scattering function of a
//! [`crate::Surface`].
//!
//! A caller traces the light through the fibers ([`ExplicitFibers::follow`]). Lamps are sampled at each
//! rough interface; the sky is not sampled but counts where a path escapes to it, because interfaces scatter
//! into narrow lobes that directions sampled from a sky seldom hit.

use crate::camera::Camera;
use crate::film::Film;
use crate::light::{Arriving, Sources};
use crate::numbers::PathNumbers;
use crate::path::{RenderOptions, Traced, Tracer, leave, render_by};
use crate::roulette::RouletteState;
use crate::scene::{Scene, SceneHit, SurfacePoint};
use crate::spectrum::Light4;
use crate::surface::props::Matte;
use crate::{Environment, RenderError, WAVELENGTHS};
use glam::Vec3;
use plywave::{Bsdf, BsdfSample};
use rand::RngExt;
use std::sync::atomic::AtomicBool;

/// Where and how light leaves a sheet of explicit fibers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exit {
    /// A point on the last ray outside the fibers [um], relative to the point of the middle plane at which
    /// the light was incident, in the surface's frame.
    pub offset_um: [f32; 3],
    /// Unit direction of the leaving light, in the same frame.
    pub w: [f32; 3],
    /// Remaining fraction of the light, by wavelength.
    pub weight: [f32; WAVELENGTHS],
    /// Whether the last scattering point sampled the lamps ([`Lamps::draw`]), so that a lamp at the end of
    /// the leaving ray must not count again.
    pub was_drawn: bool,
}

/// Light sampling for paths inside a sheet of explicit fibers.
pub struct Lamps<'a> {
    scene: &'a Scene,
    lamps: Sources<'a>,
    point: SurfacePoint,
    lambda: Light4,
    throughput: Light4,
    drawn: Option<Arriving>,
    light: Light4,
}

impl Lamps<'_> {
    /// Samples a direction to a lamp for the point `place_um` [um], which is relative to the point of the
    /// middle plane at which the light was incident. The direction is in the surface's frame; `None` if there
    /// is no lamp to sample or a lamp is occluded by another.
    pub fn draw(&mut self, place_um: [f32; 3], rng: &mut PathNumbers) -> Option<[f32; 3]> {
        let place = self.point.position + 1e-3 * self.point.frame.world(place_um);
        self.drawn = self.lamps.draw(place, self.lambda, rng);
        self.drawn.as_ref().map(|source| self.point.frame.local(source.direction))
    }

    /// Adds light of the lamp that was sampled last. `exit_um` is a point outside the fibers [um] on the ray
    /// to the lamp, `density` the scattering density towards the lamp [1/sr] by wavelength.
    pub fn add(&mut self, exit_um: [f32; 3], density: [f32; WAVELENGTHS]) {
        let Some(source) = &self.drawn else { return };
        let exit = self.point.position + 1e-3 * self.point.frame.world(exit_um);
        if self.scene.free(exit, source.direction, source.reach()) {
            for k in 0..WAVELENGTHS {
                self.light[k] += self.throughput[k] * density[k] * source.radiance[k] / source.pdf.max(1e-30);
            }
        }
    }
}

/// Explicit fibers about the sheet, which is their middle plane.
pub trait ExplicitFibers: Sync {
    /// Traces light that arrives along the line through the position `uv_um` on the cloth [um] in unit
    /// direction `w`, in the frame of [`crate::Surface`], until it leaves; `None` if it is absorbed.
    fn follow(
        &self,
        uv_um: [f32; 2],
        w: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
        rng: &mut PathNumbers,
        lamps: &mut Lamps<'_>,
    ) -> Option<Exit>;
}

/// A scene whose sheet consists of explicit fibers.
struct Explicit<'a, M> {
    scene: &'a Scene,
    fibers: &'a M,
    /// A dark sky: light sampling inside the fibers uses lamps only.
    dark: Environment,
}

/// Renders explicit fibers in place of a surface. A curved sheet counts as flat along each path through its
/// fibers. The film's albedo is the mean remaining fraction after the first exit.
///
/// # Errors
/// Those of [`crate::render`].
pub fn render_matter<M: ExplicitFibers>(
    scene: &Scene,
    camera: &Camera,
    fibers: &M,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    render_by(&Explicit { scene, fibers, dark: Environment::constant(0.0) }, camera, film, options, stop, after)
}

impl<M: ExplicitFibers> Tracer for Explicit<'_, M> {
    const EVEN: bool = false;

    fn trace(
        &self,
        options: &RenderOptions,
        (mut origin, mut direction, _): (Vec3, Vec3, f32),
        lambda: Light4,
        rng: &mut PathNumbers,
    ) -> Traced {
        let (mut light, mut albedo, mut throughput) = ([0.0; WAVELENGTHS], [0.0; WAVELENGTHS], [1.0f32; WAVELENGTHS]);
        let (mut hit, mut was_drawn) = (None, false);
        let mut roulette = RouletteState::new(options.depth);
        loop {
            let scene_hit = self.scene.first(origin, direction);
            let reach = scene_hit.map_or(f32::INFINITY, |m| m.point().t);
            if let Some(source) = self.scene.sources().hit(origin, direction, reach, lambda) {
                if !was_drawn || source.is_sky() {
                    (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * source.radiance[k]);
                }
                break;
            }
            let Some(scene_hit) = scene_hit else { break };
            let point = *scene_hit.point();
            let next = match scene_hit {
                _ if !roulette.goes_on(&throughput, &light, rng) => None,
                SceneHit::Sheet(_) => {
                    let (scene, w) = (self.scene, point.frame.local(direction));
                    let lamps = Sources { environment: &self.dark, ..scene.sources() };
                    let mut lamps =
                        Lamps { scene, lamps, point, lambda, throughput, drawn: None, light: [0.0; WAVELENGTHS] };
                    let exit = self.fibers.follow(point.uv_um, w, lambda, rng, &mut lamps);
                    (0..WAVELENGTHS).for_each(|k| light[k] += lamps.light[k]);
                    exit.map(|exit| {
                        was_drawn = exit.was_drawn;
                        let place = point.position + 1e-3 * point.frame.world(exit.offset_um);
                        (place, point.frame.world(exit.w).normalize_or_zero(), exit.weight)
                    })
                }
                SceneHit::Prop(_, albedo) => match Matte(albedo).sample(rng.random()) {
                    BsdfSample::Scattered(sample) => {
                        was_drawn = false;
                        let w = point.frame.world(sample.w).normalize_or_zero();
                        Some((leave(&point, w), w, sample.weight))
                    }
                    _ => None,
                },
            };
            if roulette.depth() == 0 {
                albedo = next.map_or([0.0; WAVELENGTHS], |(.., weight)| weight);
                let normal = point.frame.axes[2];
                let to_camera = if normal.dot(direction) > 0.0 { -normal } else { normal };
                hit = Some((to_camera.to_array(), point.t));
            }
            let Some((place, w, weight)) = next.filter(|(_, w, _)| *w != Vec3::ZERO) else { break };
            (0..WAVELENGTHS).for_each(|k| throughput[k] *= weight[k]);
            (origin, direction) = (place, w);
            if !roulette.survives(&mut throughput, rng) {
                break;
            }
        }
        let (light, cut) = roulette.end(light, lambda, hit.is_some());
        Traced { light, albedo, hit, cut }
    }
}
