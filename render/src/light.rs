//! Rectangular lamps and the sky as light sources: their sampling densities, and the weights that combine
//! light sampling with sampling of the scattering function by the power heuristic (Veach 1997, 9.2).

use crate::numbers::PathNumbers;
use crate::spectrum::Light4;
use crate::{Environment, WAVELENGTHS};
use glam::Vec3;
use rand::RngExt;

/// Largest number of sources for which a scattering point samples every source.
const EACH: usize = 3;
/// Number of scatterings of a path after which a point samples a single source.
const FROM_EACH: u32 = 2;

/// A rectangular lamp that emits the same radiance in all directions on the side of `edges[0] x edges[1]`.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// A corner [mm].
    pub corner: Vec3,
    /// The two edges that start at the corner [mm], at right angles.
    pub edges: [Vec3; 2],
    /// Radiance, relative to the illuminant's spectrum.
    pub radiance: f32,
}

impl Light {
    /// A square of side `size` [mm] at `center` that faces `target`.
    pub fn facing(center: Vec3, target: Vec3, size: f32, radiance: f32) -> Light {
        let normal = (target - center).normalize();
        let across = normal.any_orthonormal_vector() * size;
        let up = normal.cross(across);
        Light { corner: center - 0.5 * (across + up), edges: [across, up], radiance }
    }

    fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1]).normalize_or_zero()
    }

    fn area(&self) -> f32 {
        self.edges[0].cross(self.edges[1]).length()
    }

    /// Whether a ray in `direction` hits the emitting side.
    fn faces(&self, direction: Vec3) -> bool {
        -self.normal().dot(direction) > 1e-9
    }

    /// Distance [mm] along a ray to the emitting side, if the ray hits it.
    pub(crate) fn hit(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        if !self.faces(direction) {
            return None;
        }
        let cos = -self.normal().dot(direction);
        let t = (origin - self.corner).dot(self.normal()) / cos;
        let local = origin + direction * t - self.corner;
        let inside = self.edges.iter().all(|e| (0.0..=1.0).contains(&(local.dot(*e) / e.length_squared())));
        (t > 0.0 && inside).then_some(t)
    }

    /// Density [1/sr] with which [`Light::sample`] draws `direction`, in which the lamp is `t` [mm] away.
    pub(crate) fn pdf(&self, direction: Vec3, t: f32) -> f32 {
        t * t / (self.area() * -self.normal().dot(direction)).max(1e-20)
    }

    /// Direction to a uniformly distributed point of the lamp, from two uniform numbers, and the distance
    /// [mm].
    pub(crate) fn sample(&self, origin: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let to = self.corner + self.edges[0] * u[0] + self.edges[1] * u[1] - origin;
        let t = to.length();
        (to / t.max(1e-20), t)
    }
}

/// Strategy for sampling lamps and the sky. All three strategies have the same expected picture; each single
/// strategy is noisy where the other one is not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightSampling {
    /// Both strategies, weighted by the power heuristic (Veach 1997, 9.2).
    #[default]
    Both,
    /// Directions drawn from a lamp or the sky.
    Sources,
    /// Directions drawn from the surface's scattering.
    Scattering,
}

impl LightSampling {
    /// Weight of light in a direction that was sampled from its source with density `pdf` [1/sr];
    /// `scattering` is the density with which the scattering function samples the same direction.
    pub(crate) fn weight_of_sampled(self, pdf: f32, scattering: f32) -> f32 {
        match self {
            LightSampling::Both => share(pdf, scattering),
            LightSampling::Sources => 1.0,
            LightSampling::Scattering => 0.0,
        }
    }

    /// Weight of light from a source that a ray hit. The ray was sampled by the scattering function with
    /// density `scattering`, which is infinite for directions that cannot be sampled otherwise (from the
    /// camera, or straight through), and by the source with density `pdf` [1/sr].
    pub(crate) fn weight_of_hit(self, scattering: f32, pdf: f32) -> f32 {
        match self {
            LightSampling::Both => share(scattering, pdf),
            LightSampling::Sources => f32::from(scattering.is_infinite()),
            LightSampling::Scattering => 1.0,
        }
    }
}

/// Weight of the first of two strategies with densities `a` and `b` by the power heuristic with exponent 2.
fn share(a: f32, b: f32) -> f32 {
    if a <= 0.0 {
        0.0
    } else if a.is_infinite() {
        1.0
    } else {
        let ratio = b / a;
        1.0 / (1.0 + ratio * ratio)
    }
}

/// Light from one source at a scattering point.
pub(crate) struct Arriving {
    /// Unit direction towards the source.
    pub direction: Vec3,
    /// Distance to the source [mm].
    pub t: f32,
    /// Radiance, by wavelength.
    pub radiance: Light4,
    /// Density [1/sr] of this direction in [`Sources::draw`].
    pub pdf: f32,
}

impl Arriving {
    /// Whether the light comes from the sky.
    pub fn is_sky(&self) -> bool {
        self.t.is_infinite()
    }

    /// Distance [mm] within which an object occludes the source.
    pub fn reach(&self) -> f32 {
        self.t * (1.0 - 1e-4)
    }
}

/// Lamps and sky of a scene. A lamp occludes the light behind it and is invisible to rays from behind.
#[derive(Clone, Copy)]
pub(crate) struct Sources<'a> {
    pub lights: &'a [Light],
    pub environment: &'a Environment,
    pub sampling: LightSampling,
}

impl Sources<'_> {
    /// Number of sources: all lamps, and the sky unless it is dark.
    fn count(&self) -> usize {
        self.lights.len() + usize::from(!self.environment.is_dark())
    }

    /// The first lamp that a ray hits, and its distance [mm].
    fn nearest(&self, origin: Vec3, direction: Vec3) -> Option<(usize, f32)> {
        let hits = self.lights.iter().enumerate().filter_map(|(i, l)| l.hit(origin, direction).map(|t| (i, t)));
        hits.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn of_lamp(&self, i: usize, direction: Vec3, t: f32) -> Arriving {
        let lamp = &self.lights[i];
        let pdf = lamp.pdf(direction, t) / self.count() as f32;
        Arriving { direction, t, radiance: [lamp.radiance; WAVELENGTHS], pdf }
    }

    fn of_sky(&self, direction: Vec3, texel: usize, lambda_um: Light4) -> Arriving {
        let pdf = self.environment.pdf(texel) / self.count() as f32;
        Arriving { direction, t: f32::INFINITY, radiance: self.environment.radiance(texel, lambda_um), pdf }
    }

    /// The source at the end of a ray whose first hit with another object is at `reach` [mm], infinite
    /// without one.
    pub fn hit(&self, origin: Vec3, direction: Vec3, reach: f32, lambda_um: Light4) -> Option<Arriving> {
        if let Some((i, t)) = self.nearest(origin, direction).filter(|(_, t)| *t < reach) {
            return Some(self.of_lamp(i, direction, t));
        }
        let is_open = reach.is_infinite() && !self.environment.is_dark();
        is_open.then(|| self.of_sky(direction, self.environment.texel(direction), lambda_um))
    }

    /// Whether chains follow light of this source through the sheet: that of lamps, and of a sky that is not
    /// even.
    pub fn is_chained(&self, source: &Arriving) -> bool {
        self.sampling == LightSampling::Both && !(source.is_sky() && self.environment.is_even())
    }

    /// Density [1/sr] of this direction in [`Sources::draw`] if chains follow the light of its source, where
    /// an object occludes it.
    pub fn chained_pdf(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        if self.sampling != LightSampling::Both {
            return None;
        }
        if let Some((i, t)) = self.nearest(origin, direction) {
            return Some(self.lights[i].pdf(direction, t) / self.count() as f32);
        }
        let is_sky = !self.environment.is_dark() && !self.environment.is_even();
        is_sky.then(|| self.environment.pdf(self.environment.texel(direction)) / self.count() as f32)
    }

    /// Number of sources that a point samples after `depth` scatterings: each of a few sources at first, a
    /// single one later or if there are many.
    pub fn draws(&self, depth: u32) -> usize {
        if depth < FROM_EACH && self.count() <= EACH { self.count() } else { 1 }
    }

    /// Samples one of several draws ([`Sources::draws`]): draw `number` of `draws` samples source `number` if
    /// there are as many draws as sources, else a random source. `pdf` remains the density of
    /// [`Sources::draw`].
    pub fn draw_of(
        &self,
        (number, draws): (usize, usize),
        position: Vec3,
        lambda_um: Light4,
        rng: &mut PathNumbers,
    ) -> Option<Arriving> {
        if draws == self.count() {
            return self.draw_from(number, position, lambda_um, rng.random());
        }
        self.draw(position, lambda_um, rng)
    }

    /// Samples a random source and a direction towards it; `None` if another source occludes it.
    pub fn draw(&self, position: Vec3, lambda_um: Light4, rng: &mut PathNumbers) -> Option<Arriving> {
        let count = self.count();
        let which = (rng.random::<f32>() * count as f32) as usize;
        self.draw_from(which.min(count.max(1) - 1), position, lambda_um, rng.random())
    }

    fn draw_from(&self, which: usize, position: Vec3, lambda_um: Light4, u: [f64; 2]) -> Option<Arriving> {
        if self.count() == 0 || self.sampling == LightSampling::Scattering {
            return None;
        }
        let Some(lamp) = self.lights.get(which) else {
            let (direction, texel) = self.environment.sample(u);
            let hidden = self.nearest(position, direction).is_some();
            return (!hidden).then(|| self.of_sky(direction, texel, lambda_um));
        };
        let (direction, t) = lamp.sample(position, u.map(|u| u as f32));
        let others = self.lights.iter().enumerate().filter(|(i, _)| *i != which);
        let mut hidden = others.filter_map(|(_, l)| l.hit(position, direction));
        if !lamp.faces(direction) || hidden.any(|before| before < t) {
            return None;
        }
        Some(self.of_lamp(which, direction, t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use std::f32::consts::TAU;

    #[test]
    fn rectangles_sample_what_their_pdf_says() {
        let light = Light::facing(Vec3::new(3.0, 1.0, 4.0), Vec3::ZERO, 2.0, 1.0);
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let (mut sampled, mut visible) = (0.0f64, 0.0f64);
        let n = 200_000;
        for _ in 0..n {
            let (w, t) = light.sample(Vec3::ZERO, [rng.random(), rng.random()]);
            assert!((light.hit(Vec3::ZERO, w).unwrap() - t).abs() < 1e-3);
            sampled += 1.0 / f64::from(light.pdf(w, t));
            let z = 2.0 * rng.random::<f32>() - 1.0;
            let phi = TAU * rng.random::<f32>();
            let sin = (1.0 - z * z).sqrt();
            let anywhere = Vec3::new(sin * phi.cos(), sin * phi.sin(), z);
            visible += light.hit(Vec3::ZERO, anywhere).map_or(0.0, |_| 4.0 * std::f64::consts::PI);
        }
        // Both means estimate the solid angle of the lamp.
        let (sampled, visible) = (sampled / n as f64, visible / n as f64);
        assert!(
            (sampled - visible).abs() < 5.0 * (visible * 4.0 * std::f64::consts::PI / n as f64).sqrt(),
            "{sampled} {visible}"
        );
    }
}
