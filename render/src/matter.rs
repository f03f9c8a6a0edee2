//! Path tracing of a sheet of explicit matter, which a caller follows light through: the truth beside a
//! [`crate::Surface`].
//!
//! Lamps are drawn from at each rough wall, and the sky is met: walls send light into narrow lobes, which a
//! sky's directions seldom hit.

use crate::camera::Camera;
use crate::course::Course;
use crate::film::Film;
use crate::light::{Arriving, Sources};
use crate::numbers::PathNumbers;
use crate::path::{RenderOptions, Traced, Tracer, leave, render_by};
use crate::props::Matte;
use crate::scene::{Meeting, Scene, SurfacePoint};
use crate::spectrum::Light4;
use crate::{Environment, RenderError, WAVELENGTHS};
use glam::Vec3;
use plywave::{Bsdf, BsdfSample};
use rand::RngExt;
use std::sync::atomic::AtomicBool;

/// Where light that came to a sheet of matter leaves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaves {
    /// A point of its last line beyond the matter, from the point of the middle plane that it came to [um],
    /// in the surface's frame.
    pub offset_um: [f32; 3],
    /// Unit direction in which it goes on, in the same frame.
    pub w: [f32; 3],
    /// Share of it that is left, by wavelength.
    pub weight: [f32; WAVELENGTHS],
    /// Whether the lamps that it then meets were drawn from ([`Lamps::draw`]) where it was scattered last.
    pub was_drawn: bool,
}

/// Lamps for light within matter.
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
    /// A direction to a lamp, in the surface's frame, drawn for a place given from the point of the middle
    /// plane that the light came to [um]; `None` where there is none.
    pub fn draw(&mut self, place_um: [f32; 3], rng: &mut PathNumbers) -> Option<[f32; 3]> {
        let place = self.point.position + 1e-3 * self.point.frame.world(place_um);
        self.drawn = self.lamps.draw(place, self.lambda, rng);
        self.drawn.as_ref().map(|source| self.point.frame.local(source.direction))
    }

    /// Adds light of the lamp drawn last, which is left to by a point beyond the matter [um] with this
    /// density [1/sr] by wavelength.
    pub fn add(&mut self, left_um: [f32; 3], density: [f32; WAVELENGTHS]) {
        let Some(source) = &self.drawn else { return };
        let left = self.point.position + 1e-3 * self.point.frame.world(left_um);
        if self.scene.free(left, source.direction, source.reach()) {
            for k in 0..WAVELENGTHS {
                self.light[k] += self.throughput[k] * density[k] * source.radiance[k] / source.pdf.max(1e-30);
            }
        }
    }
}

/// Matter about the sheet, which is its middle plane: explicit fibers.
pub trait Matter: Sync {
    /// Follows light that comes along the line through a position on the cloth [um] in unit direction `w`, in
    /// the surface's frame as [`crate::Surface`] has it, until it leaves; `None` if it is lost.
    fn follow(
        &self,
        uv_um: [f32; 2],
        w: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
        rng: &mut PathNumbers,
        lamps: &mut Lamps<'_>,
    ) -> Option<Leaves>;
}

/// A scene whose sheet is matter.
struct Explicit<'a, M> {
    scene: &'a Scene,
    matter: &'a M,
    /// The sky of what is drawn.
    dark: Environment,
}

/// As [`crate::render`], of matter in place of a surface. Curved sheets count as flat within a path through
/// them. The albedo of the film is the share of single paths.
///
/// # Errors
/// As [`crate::render`].
pub fn render_matter<M: Matter>(
    scene: &Scene,
    camera: &Camera,
    matter: &M,
    film: &mut Film,
    options: &RenderOptions,
    stop: &AtomicBool,
    after: &mut dyn FnMut(&Film) -> Result<(), RenderError>,
) -> Result<(), RenderError> {
    render_by(&Explicit { scene, matter, dark: Environment::constant(0.0) }, camera, film, options, stop, after)
}

impl<M: Matter> Tracer for Explicit<'_, M> {
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
        let mut course = Course::new(options.depth);
        loop {
            let meeting = self.scene.first(origin, direction);
            let reach = meeting.map_or(f32::INFINITY, |m| m.point().t);
            if let Some(source) = self.scene.sources().met(origin, direction, reach, lambda) {
                if !was_drawn || source.is_sky() {
                    (0..WAVELENGTHS).for_each(|k| light[k] += throughput[k] * source.radiance[k]);
                }
                break;
            }
            let Some(meeting) = meeting else { break };
            let point = *meeting.point();
            let next = match meeting {
                _ if !course.goes_on(&throughput, &light, rng) => None,
                Meeting::Sheet(_) => {
                    let (scene, w) = (self.scene, point.frame.local(direction));
                    let lamps = Sources { environment: &self.dark, ..scene.sources() };
                    let mut lamps =
                        Lamps { scene, lamps, point, lambda, throughput, drawn: None, light: [0.0; WAVELENGTHS] };
                    let left = self.matter.follow(point.uv_um, w, lambda, rng, &mut lamps);
                    (0..WAVELENGTHS).for_each(|k| light[k] += lamps.light[k]);
                    left.map(|left| {
                        was_drawn = left.was_drawn;
                        let place = point.position + 1e-3 * point.frame.world(left.offset_um);
                        (place, point.frame.world(left.w).normalize_or_zero(), left.weight)
                    })
                }
                Meeting::Prop(_, albedo) => match Matte(albedo).sample(rng.random()) {
                    BsdfSample::Scattered(sample) => {
                        was_drawn = false;
                        let w = point.frame.world(sample.w).normalize_or_zero();
                        Some((leave(&point, w), w, sample.weight))
                    }
                    _ => None,
                },
            };
            if course.depth() == 0 {
                albedo = next.map_or([0.0; WAVELENGTHS], |(.., weight)| weight);
                let normal = point.frame.axes[2];
                let to_camera = if normal.dot(direction) > 0.0 { -normal } else { normal };
                hit = Some((to_camera.to_array(), point.t));
            }
            let Some((place, w, weight)) = next.filter(|(_, w, _)| *w != Vec3::ZERO) else { break };
            (0..WAVELENGTHS).for_each(|k| throughput[k] *= weight[k]);
            (origin, direction) = (place, w);
            if !course.survives(&mut throughput, rng) {
                break;
            }
        }
        let (light, cut) = course.end(light, lambda, hit.is_some());
        Traced { light, albedo, hit, cut }
    }
}
