//! Optical surfaces of fibers: their walls, and the absorption within.
//!
//! An opaque fiber's wall is the GGX microsurface of [`RoughDielectric`] whose facets all reflect (Heitz et
//! al. 2016, the conductor). The walk loses no energy: the absorption at the facets is recorded as a length,
//! [`Reflections`], which weights the path for every absorption afterwards, like its length in a dielectric.

use crate::rays::dielectric::{MAX_ORDER, RoughDielectric, Scattered, sin_cos_turn};
use nalgebra::Vector3;
use plywave::optics::Reflections;
use plywave::spec::{FiberSpec, YarnSpec};
use rand::{Rng, RngExt};

/// The wall of an opaque fiber.
#[derive(Clone, Debug)]
pub struct RoughConductor {
    /// GGX roughness; 0 for smooth.
    pub alpha: f32,
    /// Absorption of its reflections.
    pub reflections: Reflections,
}

impl RoughConductor {
    /// Reflects a ray that propagates along `dir` (local frame, z along the normal, which points outside).
    /// Returns its direction and the length that its reflections stand for [um].
    pub fn scatter<R: Rng>(&self, dir: Vector3<f32>, rng: &mut R) -> (Scattered, f32) {
        self.walk(dir, rng, |cos| self.reflections.length_um(cos), |_, _, _| ())
    }

    /// Walk over the microsurface. Returns the direction and the sum of `of_facet` over the cosines of
    /// incidence at the facets. Before each reflection at a facet of a rough wall, `on_facet` receives the
    /// direction, the height and the sum so far.
    pub(crate) fn walk<R: Rng>(
        &self,
        dir: Vector3<f32>,
        rng: &mut R,
        of_facet: impl Fn(f32) -> f32,
        mut on_facet: impl FnMut(Vector3<f32>, f32, f32),
    ) -> (Scattered, f32) {
        let mut w = dir;
        let (mut sum, mut order) = (0.0, 0);
        let reflect = |w: &mut Vector3<f32>, sum: &mut f32, n: Vector3<f32>| {
            let cos = (-w.dot(&n)).max(0.0);
            *sum += of_facet(cos);
            *w += n * (2.0 * cos);
            // One Newton step of the normalization, like in the dielectric.
            *w *= 1.5 - 0.5 * w.norm_squared();
        };
        if self.alpha <= 0.0 {
            reflect(&mut w, &mut sum, Vector3::z());
            return (Scattered { dir: w, outside: true, order: 1 }, sum);
        }
        // Heights and normals are those of a dielectric's microsurface, which do not depend on its index.
        let micro = RoughDielectric { eta: 1.0, alpha: self.alpha };
        let mut c = 1.0f32;
        while let Some(next) = micro.next_height(w, c, rng.random::<f32>()) {
            c = next;
            order += 1;
            if order > MAX_ORDER {
                return (Scattered { dir: w, outside: true, order: 0 }, sum);
            }
            on_facet(w, c, sum);
            let n = micro.visible_normal(-w, rng.random::<f32>(), rng.random::<f32>());
            reflect(&mut w, &mut sum, n);
        }
        (Scattered { dir: w, outside: true, order }, sum)
    }
}

/// The optical interface of a fiber's wall.
#[derive(Clone, Debug)]
pub enum Wall {
    /// Light is reflected or transmitted.
    Dielectric(RoughDielectric),
    /// Light is reflected or absorbed.
    Opaque(RoughConductor),
}

impl Wall {
    /// Scatters a ray that propagates along `dir` (local frame, z along the normal, which points outside).
    /// Returns also the length that the reflections of an opaque wall stand for [um], 0 for other walls.
    #[inline(always)]
    pub(crate) fn scatter<R: Rng>(&self, dir: Vector3<f32>, outside: bool, rng: &mut R) -> (Scattered, f32) {
        match self {
            Wall::Dielectric(wall) => (wall.scatter(dir, outside, rng), 0.0),
            Wall::Opaque(wall) => wall.scatter(dir, rng),
        }
    }

    /// Scatters a ray like [`Wall::scatter`]. At each event `on_event` receives the density [1/sr] with which
    /// the ray leaves to the outside in direction `wo`, and the length that reflections on that path stand
    /// for [um].
    pub(crate) fn scatter_toward<R: Rng>(
        &self,
        dir: Vector3<f32>,
        outside: bool,
        rng: &mut R,
        wo: Vector3<f32>,
        mut on_event: impl FnMut(f32, f32),
    ) -> (Scattered, f32) {
        match self {
            Wall::Dielectric(wall) => (wall.walk(dir, outside, rng, |at| on_event(wall.toward(at, wo), 0.0)), 0.0),
            Wall::Opaque(wall) => {
                let micro = RoughDielectric { eta: 1.0, alpha: wall.alpha };
                let length_um = |cos: f32| wall.reflections.length_um(cos);
                wall.walk(dir, rng, length_um, |w, c, before_um| {
                    if wo.z > 1e-4
                        && let Some((density, cos)) = micro.mirrored(w, c, wo)
                    {
                        on_event(density, before_um + length_um(cos));
                    }
                })
            }
        }
    }

    /// Whether the wall is rough, so that its scattering has a density.
    pub(crate) fn is_rough(&self) -> bool {
        match self {
            Wall::Dielectric(wall) => wall.alpha > 0.0,
            Wall::Opaque(wall) => wall.alpha > 0.0,
        }
    }
}

/// Scattering in a fiber's material: pigment, delustrant or crystals. Free flights are exponential, and
/// deflections those of Henyey and Greenstein ("Diffuse radiation in the galaxy", Astrophysical Journal 93,
/// 1941). No event absorbs; the length of the flights counts for the absorption like that of a clear fiber.
#[derive(Clone, Copy, Debug)]
pub struct Scattering {
    /// Events per length [1/um].
    pub per_um: f32,
    /// Mean cosine of the deflection, in (-1, 1).
    pub g: f32,
}

impl Scattering {
    /// A length to the next event [um].
    #[inline(always)]
    pub(crate) fn flight_um<R: Rng>(&self, rng: &mut R) -> f32 {
        -(1.0 - rng.random::<f32>()).ln() / self.per_um
    }

    /// A direction after an event.
    pub(crate) fn deflect<R: Rng>(&self, dir: Vector3<f32>, rng: &mut R) -> Vector3<f32> {
        let [u, turn]: [f32; 2] = rng.random();
        let g = self.g;
        let cos = if g.abs() < 1e-3 {
            1.0 - 2.0 * u
        } else {
            let ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
            ((1.0 + g * g - ratio * ratio) / (2.0 * g)).clamp(-1.0, 1.0)
        };
        let across = (1.0 - cos * cos).max(0.0).sqrt();
        let (sin_phi, cos_phi) = sin_cos_turn(turn);
        let (t, b) = basis(dir);
        (t * (across * cos_phi) + b * (across * sin_phi) + dir * cos).normalize()
    }
}

/// Two unit vectors that make a right-handed basis with the unit vector `n` (Duff et al. 2017).
pub(crate) fn basis(n: Vector3<f32>) -> (Vector3<f32>, Vector3<f32>) {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vector3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vector3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Optical surface of one kind of fibers.
#[derive(Clone, Debug)]
pub struct FiberSurface {
    /// The outer wall.
    pub outer: Wall,
    /// The wall of the core. Its normal points from the material into the core, and its index is that of the
    /// material over that of the core.
    pub inner: Wall,
    /// Absorbing length per length in the material: 1, or the share of the dye for a blend's second fibers.
    pub absorbs: f32,
    /// Absorbing length per length in the core.
    pub core_absorbs: f32,
    /// Scattering in the material, outside of the core; `None` for a clear one.
    pub scattering: Option<Scattering>,
}

impl FiberSurface {
    /// A dielectric whose core, if it has one, is air.
    pub fn dielectric(wall: RoughDielectric) -> FiberSurface {
        let [outer, inner] = [Wall::Dielectric(wall), Wall::Dielectric(wall)];
        FiberSurface { outer, inner, absorbs: 1.0, core_absorbs: 0.0, scattering: None }
    }

    /// Surface of a spec's fiber at a wavelength [um]. Its absorption is `dye` times that of the ply's first
    /// fibers.
    pub fn new(fiber: &FiberSpec, lambda_um: f64, dye: f64) -> FiberSurface {
        let alpha = fiber.alpha_fiber as f32;
        let wall = |eta: f64| Wall::Dielectric(RoughDielectric { eta: eta as f32, alpha });
        let eta = fiber.eta_at(lambda_um);
        let [core_eta, core_dye] = fiber.shape.core();
        let outer = match fiber.reflections() {
            Some(reflections) => Wall::Opaque(RoughConductor { alpha, reflections }),
            None => wall(eta),
        };
        let (per_um, g) = (fiber.scattering_per_um as f32, fiber.scattering_g as f32);
        FiberSurface {
            outer,
            inner: wall(eta / core_eta),
            absorbs: dye as f32,
            core_absorbs: (dye * core_dye) as f32,
            scattering: (per_um > 0.0).then_some(Scattering { per_um, g }),
        }
    }
}

/// The one or two kinds of fibers of a ply.
#[derive(Clone, Debug)]
pub struct Surfaces {
    first: FiberSurface,
    second: Option<FiberSurface>,
}

impl Surfaces {
    /// Surfaces of a ply of equal fibers.
    pub fn alike(surface: FiberSurface) -> Surfaces {
        Surfaces { first: surface, second: None }
    }

    /// Surfaces of a spec's ply, at the wavelength of its beam.
    pub fn of_spec(spec: &YarnSpec) -> Surfaces {
        let lambda_um = spec.beam.lambda_um;
        let of_blend = |b: &plywave::spec::BlendSpec| FiberSurface::new(&b.fiber, lambda_um, b.dye);
        Surfaces { first: FiberSurface::new(&spec.fiber, lambda_um, 1.0), second: spec.blend.as_ref().map(of_blend) }
    }

    /// Whether there are two kinds of fibers.
    #[inline(always)]
    pub fn is_blend(&self) -> bool {
        self.second.is_some()
    }

    /// Surface of the first or the second kind.
    #[inline(always)]
    pub fn of(&self, second: bool) -> &FiberSurface {
        match &self.second {
            Some(of) if second => of,
            _ => &self.first,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::optics::{Metal, OpaqueIndex, conductor};
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    fn gold(alpha: f32) -> RoughConductor {
        RoughConductor { alpha, reflections: Reflections::new(OpaqueIndex::Metal(Metal::Gold)) }
    }

    /// A smooth wall is a mirror: it preserves the angle and has Fresnel's reflectance.
    #[test]
    fn smooth_walls_are_mirrors() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for z in [-0.9f32, -0.5, -0.1] {
            let d = Vector3::new((1.0 - z * z).sqrt(), 0.0, z);
            let (s, length_um) = gold(0.0).scatter(d, &mut rng);
            assert!(s.outside && s.order == 1 && (s.dir - Vector3::new(d.x, 0.0, -z)).norm() < 1e-6, "{s:?}");
            assert_eq!(length_um, gold(0.0).reflections.length_um(-z));
        }
    }

    /// A lossless surface preserves uniform radiance over the hemisphere for any roughness, by reciprocity:
    /// the mean cosine is 2/3, and no light goes below the surface.
    #[test]
    fn even_light_stays_even() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let n = 200_000;
        for alpha in [0.05, 0.3, 1.0] {
            // Built once: the lengths of gold's reflections are fitted.
            let wall = gold(alpha);
            let (mut sum, mut squares) = (0.0f64, 0.0);
            for _ in 0..n {
                let z = rng.random::<f32>().sqrt().max(1e-3);
                let (s, _) = wall.scatter(Vector3::new((1.0 - z * z).sqrt(), 0.0, -z), &mut rng);
                assert!(s.order > 0 && s.dir.z > 0.0 && (s.dir.norm() - 1.0).abs() < 1e-4, "{s:?}");
                sum += f64::from(s.dir.z);
                squares += f64::from(s.dir.z).powi(2);
            }
            let mean = sum / f64::from(n);
            let se = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
            assert!((mean - 2.0 / 3.0).abs() < 5.0 * se, "alpha {alpha}: {mean}, standard error {se}");
        }
    }

    /// Weights by length agree to 0.02 with a walk that is absorbed at each facet by Fresnel's reflectance at
    /// the wavelength. They differ since all lengths share one dependence on the angle.
    #[test]
    fn lengths_absorb_as_facets_do() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let n = 100_000;
        for (alpha, z) in [(0.2, 0.9f32), (0.5, 0.4), (1.0, 0.7)] {
            let wall = gold(alpha);
            let dir = Vector3::new((1.0 - z * z).sqrt(), 0.0, -z);
            for lambda_um in [0.45, 0.5, 0.55, 0.65] {
                let (index, sigma) =
                    (Metal::Gold.index(lambda_um), wall.reflections.sigma_per_um(f64::from(lambda_um)));
                let (mut by_length, mut by_facet) = (0.0, 0.0);
                for _ in 0..n {
                    by_length += (-sigma * f64::from(wall.scatter(dir, &mut rng).1)).exp() / f64::from(n);
                    let (_, log) = wall.walk(dir, &mut rng, |cos| conductor(cos, index).ln(), |_, _, _| ());
                    by_facet += f64::from(log).exp() / f64::from(n);
                }
                let off: f64 = by_length - by_facet;
                assert!(
                    off.abs() < 0.02,
                    "alpha {alpha}, {lambda_um} um: {by_length} by lengths, {by_facet} by facets"
                );
            }
        }
    }
}
