//! One fiber of a yarn spec or a scene as a body of the wave code, with the symmetry of its outline. The
//! shape is the mean one, without jitter.
//!
//! Waves and rays both use it, so they have the same outline. Its frame is the outline's own, with the
//! centroid at the origin and no turn.

use crate::{Body, C64, Scene, Shape, WaveError};
use nalgebra::Vector2;
use plywave::spec::{FiberSpec, YarnSpec};
use plywave_fiber::OutlineSymmetry;
use plywave_runs::RunError;
use plywave_sim::FiberSection;
use plywave_sim::Outline;
use plywave_sim::shape;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// Absorption of the fiber's material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Absorption {
    /// Imaginary index kappa, the same at every wavelength.
    Kappa(f64),
    /// Absorption coefficient sigma [1/um], the same at every wavelength: kappa = sigma lambda / (4 pi).
    Sigma(f64),
}

impl Absorption {
    /// Imaginary index at a wavelength [um].
    pub fn kappa(&self, lambda_um: f64) -> f64 {
        match *self {
            Absorption::Kappa(kappa) => kappa,
            Absorption::Sigma(sigma) => sigma * lambda_um / (4.0 * PI),
        }
    }

    /// Absorption coefficient [1/um] at a wavelength [um].
    pub fn sigma_per_um(&self, lambda_um: f64) -> f64 {
        match *self {
            Absorption::Kappa(kappa) => 4.0 * PI * kappa / lambda_um,
            Absorption::Sigma(sigma) => sigma,
        }
    }
}

/// A straight fiber of one outline.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleFiber {
    /// The fiber; its kappa is that of [`SingleFiber::absorption`] once a wavelength is chosen.
    pub body: Body,
    /// Absorption of its material.
    pub absorption: Absorption,
    /// Symmetry of its outline.
    pub symmetry: OutlineSymmetry,
    /// GGX roughness of its walls, for rays only.
    pub alpha_fiber: f64,
    /// For an opaque fiber or one with dispersion: the fiber of the spec, which has the index at each
    /// wavelength. The body has the index at the sodium line.
    pub by_wavelength: Option<FiberSpec>,
}

/// Maximum size of a file that is read [bytes].
const MAX_BYTES: u64 = 4 << 20;
/// Points of an outline for measures of its extent.
const MEASURED: usize = 2048;

impl SingleFiber {
    /// Reads the fiber of a file, and returns the text that defines it: a yarn spec's mean fiber, with the
    /// absorption `sigma_per_um`, or the one fiber of a scene, with its own absorption.
    ///
    /// # Errors
    /// Those of [`plywave_textile::load_yarn_file`] and [`Scene::load`] (which do not name the file), and
    /// [`WaveError::Invalid`] for a scene of several fibers.
    pub fn load(path: impl AsRef<Path>, sigma_per_um: f64) -> Result<(SingleFiber, String), RunError> {
        let path = path.as_ref();
        // The reader of yarn specs reports files that cannot be read or parsed.
        let text = plywave::io::read_text(path, MAX_BYTES).unwrap_or_default();
        if !is_scene(&text) {
            let (spec, text) = plywave_textile::load_yarn_file(path)?;
            return Ok((SingleFiber::of_yarn(&spec, sigma_per_um)?, text));
        }
        Ok((SingleFiber::of_scene(&text, sigma_per_um)?, text))
    }

    /// The fiber of the text that [`SingleFiber::load`] returns; `file` stands for the file in errors.
    ///
    /// # Errors
    /// The errors of [`SingleFiber::load`].
    pub fn parse(text: &str, file: &str, sigma_per_um: f64) -> Result<SingleFiber, RunError> {
        if is_scene(text) {
            return SingleFiber::of_scene(text, sigma_per_um);
        }
        SingleFiber::of_yarn(&YarnSpec::parse(text, file)?, sigma_per_um)
    }

    /// The first kind of fibers of a yarn.
    fn of_yarn(spec: &YarnSpec, sigma_per_um: f64) -> Result<SingleFiber, RunError> {
        if spec.fiber.is_opaque() && sigma_per_um != 0.0 {
            let hint = "an opaque fiber has its own absorption; leave this out".into();
            return Err(WaveError::Invalid { key: "sigma".into(), value: sigma_per_um.to_string(), hint }.into());
        }
        WaveError::if_scatters(&spec.fiber)?;
        Ok(SingleFiber::of_spec(&spec.fiber, Absorption::Sigma(sigma_per_um)))
    }

    fn of_scene(text: &str, sigma_per_um: f64) -> Result<SingleFiber, RunError> {
        let scene = Scene::parse(text)?;
        let [body] = &scene.bodies[..] else {
            let value = format!("{} fibers", scene.bodies.len());
            return Err(
                WaveError::Invalid { key: "fiber".into(), value, hint: "give a scene of one fiber".into() }.into()
            );
        };
        if sigma_per_um != 0.0 {
            let hint = "a scene's fiber has its kappa; leave this out".into();
            return Err(WaveError::Invalid { key: "sigma".into(), value: sigma_per_um.to_string(), hint }.into());
        }
        Ok(SingleFiber::of_body(body))
    }

    /// The mean fiber of a yarn spec: its shape as given, without jitter. Irregular shapes take their regular
    /// form: a stone its regular polygon of the same area, a serrated outline even teeth of the mean depth.
    pub fn of_spec(spec: &FiberSpec, absorption: Absorption) -> SingleFiber {
        let fold = |folds, mirror| OutlineSymmetry { folds, mirror_rad: Some(mirror) };
        let mut lumen = None;
        let (shape, symmetry) = match &spec.shape {
            plywave::spec::Shape::Circle { radius_um } => {
                (Shape::Circle { radius_um: *radius_um }, OutlineSymmetry::CIRCLE)
            }
            plywave::spec::Shape::HollowCircle { radius_um, lumen: hollow, .. } => {
                lumen = Some(Shape::Circle { radius_um: hollow * radius_um });
                (Shape::Circle { radius_um: *radius_um }, OutlineSymmetry::CIRCLE)
            }
            plywave::spec::Shape::Ellipse { a_um, b_um } if a_um == b_um => {
                (Shape::Circle { radius_um: *a_um }, OutlineSymmetry::CIRCLE)
            }
            plywave::spec::Shape::Ellipse { a_um, b_um } => (Shape::Ellipse { a_um: *a_um, b_um: *b_um }, fold(2, 0.0)),
            plywave::spec::Shape::Kidney { a_um, b_um, dent, lumen: hollow } => {
                let bean = shape::Kidney { a: *a_um, b: *b_um, dent: *dent, hollow: *hollow };
                let mut coeffs = trigonometric(|t| bean.outer(t));
                let center = center_of(&coeffs);
                let shifted = |coeffs: &mut Vec<(i32, C64)>| {
                    match coeffs.iter_mut().find(|(k, _)| *k == 0) {
                        Some((_, c)) => *c -= center,
                        None => coeffs.push((0, -center)),
                    }
                    Shape::Fourier { coeffs: std::mem::take(coeffs) }
                };
                lumen = (*hollow > 0.0).then(|| shifted(&mut trigonometric(|t| bean.lumen(t))));
                (shifted(&mut coeffs), fold(1, FRAC_PI_2))
            }
            plywave::spec::Shape::RoundedTriangle { radius_um, rounding_um } => {
                (regular(3, *radius_um, *rounding_um), fold(3, 0.0))
            }
            plywave::spec::Shape::Stone { radius_um, corners, rounding_um } => {
                // Area of a regular polygon of circumradius c with arcs of radius r: c^2 n/2 sin(2 pi/n) -
                // r^2 (n tan(pi/n) - pi).
                let n = f64::from(*corners);
                let taken = rounding_um * rounding_um * (n * (PI / n).tan() - PI);
                let c = (2.0 * (PI * radius_um * radius_um + taken) / (n * (TAU / n).sin())).sqrt();
                (regular(*corners, c, *rounding_um), fold(*corners, 0.0))
            }
            plywave::spec::Shape::Trilobal { radius_um, depth } => (lobed(*radius_um, *depth, 3), fold(3, 0.0)),
            plywave::spec::Shape::Serrated { radius_um, depth, teeth } => {
                (lobed(*radius_um, shape::MEAN_TOOTH * depth, *teeth), fold(*teeth, 0.0))
            }
            plywave::spec::Shape::Polygon { points_um, rounding_um, .. } => {
                let corners: Vec<_> = points_um.iter().map(|p| Vector2::new(p[0], p[1])).collect();
                // A rounding that does not fit is refused when the outline is built.
                let rounded = shape::rounded_polygon(corners.clone(), *rounding_um);
                let center = rounded.unwrap_or(Outline::Polyline(corners)).centroid();
                let points_um = points_um.iter().map(|p| [p[0] - center.x, p[1] - center.y]).collect();
                (Shape::Polygon { points_um, rounding_um: *rounding_um }, OutlineSymmetry::NONE)
            }
        };
        let [core_eta, core_dye] = spec.shape.core();
        let core = |shape| {
            let kappa = core_dye * absorption.kappa(1.0);
            Box::new(Body { shape, center_um: [0.0; 2], rotation_rad: 0.0, eta: core_eta, kappa, lumen: None })
        };
        let varies = spec.is_opaque() || spec.dispersion_um2.is_some();
        SingleFiber {
            body: Body {
                shape,
                center_um: [0.0; 2],
                rotation_rad: 0.0,
                eta: spec.eta_at(plywave::spec::SODIUM_UM),
                kappa: absorption.kappa(1.0),
                lumen: lumen.map(core),
            },
            absorption,
            symmetry,
            alpha_fiber: spec.alpha_fiber,
            by_wavelength: varies.then(|| spec.clone()),
        }
    }

    /// A fiber of a scene in its own frame, smooth, with the symmetry that follows from the numbers of
    /// circles, ellipses and Fourier outlines.
    pub fn of_body(body: &Body) -> SingleFiber {
        let bare = body.lumen.is_none();
        let (symmetry, shape) = match &body.shape {
            Shape::Circle { .. } if bare => (OutlineSymmetry::CIRCLE, body.shape.clone()),
            Shape::Ellipse { a_um, b_um } if bare && a_um == b_um => {
                (OutlineSymmetry::CIRCLE, Shape::Circle { radius_um: *a_um })
            }
            Shape::Ellipse { .. } if bare => (OutlineSymmetry { folds: 2, mirror_rad: Some(0.0) }, body.shape.clone()),
            Shape::Fourier { coeffs } if bare => (fourier_symmetry(coeffs), body.shape.clone()),
            shape => (OutlineSymmetry::NONE, shape.clone()),
        };
        // Inner bodies move and turn with the fiber.
        fn carried(body: &Body, center: [f64; 2], turn: f64) -> Body {
            let (s, c) = turn.sin_cos();
            let [x, y] = [body.center_um[0] - center[0], body.center_um[1] - center[1]];
            Body {
                center_um: [c * x + s * y, c * y - s * x],
                rotation_rad: body.rotation_rad - turn,
                lumen: body.lumen.as_ref().map(|inner| Box::new(carried(inner, center, turn))),
                ..body.clone()
            }
        }
        SingleFiber {
            body: Body { shape, ..carried(body, body.center_um, body.rotation_rad) },
            absorption: Absorption::Kappa(body.kappa),
            symmetry,
            alpha_fiber: 0.0,
            by_wavelength: None,
        }
    }

    /// The body at a wavelength [um].
    pub fn at(&self, lambda_um: f64) -> Body {
        let mut body = Body { kappa: self.absorption.kappa(lambda_um), ..self.body.clone() };
        if let Some(core) = body.lumen.as_deref_mut()
            && self.body.kappa > 0.0
        {
            // The core's share of the dye is the same at every wavelength.
            core.kappa *= body.kappa / self.body.kappa;
        }
        if let Some(spec) = &self.by_wavelength {
            body.eta = spec.eta_at(lambda_um);
            if spec.is_opaque() {
                body.kappa = spec.kappa_at(lambda_um);
            }
        }
        body
    }

    /// The outlines for rays: the outer wall and a hollow lumen.
    ///
    /// # Errors
    /// [`WaveError::Unsupported`] for a filled core or more than one wall within the fiber, which rays cannot
    /// trace.
    pub fn section(&self) -> Result<FiberSection, WaveError> {
        let unsupported = |what: &str| WaveError::Unsupported {
            method: "rays",
            what: what.into(),
            hint: "use waves, or a fiber whose lumen is air".into(),
        };
        let lumen = match &self.body.lumen {
            None => None,
            Some(inner) if inner.lumen.is_some() => return Err(unsupported("a lumen within a lumen")),
            Some(inner) if inner.eta != 1.0 || inner.kappa != 0.0 => return Err(unsupported("a filled core")),
            Some(inner) if matches!(inner.shape, Shape::Circle { .. }) && inner.center_um == [0.0; 2] => {
                Some(outline(&inner.shape)?)
            }
            Some(inner) => {
                let points = outline(&inner.shape)?.polyline(MEASURED / 4);
                let turn = nalgebra::Rotation2::new(inner.rotation_rad);
                let center = Vector2::from(inner.center_um);
                Some(Outline::Polyline(points.into_iter().map(|p| center + turn * p).collect()))
            }
        };
        let outer = outline(&self.body.shape)?;
        Ok(FiberSection { center_um: Vector2::zeros(), angle_rad: 0.0, outer, lumen, second: false })
    }

    /// Radius about the origin that contains the fiber [um].
    ///
    /// # Errors
    /// [`WaveError::Invalid`] for a polygon whose rounding does not fit.
    pub fn bound_um(&self) -> Result<f64, WaveError> {
        Ok(outline(&self.body.shape)?.bounding_radius())
    }

    /// Ends of the fiber's shadow for light from `phi_i`, along `(sin phi_i, -cos phi_i)` [um].
    ///
    /// # Errors
    /// The errors of [`SingleFiber::bound_um`].
    pub fn shadow_um(&self, phi_i: f64) -> Result<[f64; 2], WaveError> {
        if let Shape::Circle { radius_um } = self.body.shape {
            return Ok([-radius_um, radius_um]);
        }
        if let Shape::Ellipse { a_um, b_um } = self.body.shape {
            let half = (a_um * phi_i.sin()).hypot(b_um * phi_i.cos());
            return Ok([-half, half]);
        }
        let (sin, cos) = phi_i.sin_cos();
        let points = outline(&self.body.shape)?.polyline(MEASURED);
        let along = points.iter().map(|p| p.x * sin - p.y * cos);
        Ok([along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max)])
    }
}

/// Whether a text is a scene's, with a list of fibers.
fn is_scene(text: &str) -> bool {
    toml::from_str::<toml::Table>(text).is_ok_and(|t| t.get("fiber").is_some_and(toml::Value::is_array))
}

/// A dense outline of a wall.
fn outline(shape: &Shape) -> Result<Outline, WaveError> {
    Ok(match shape {
        Shape::Circle { radius_um } => Outline::Circle { radius_um: *radius_um },
        Shape::Ellipse { a_um, b_um } => shape::curve(|t| Vector2::new(a_um * t.cos(), b_um * t.sin())),
        Shape::Fourier { coeffs } => {
            let at = |t: f64| -> C64 { coeffs.iter().map(|(k, c)| c * C64::from_polar(1.0, f64::from(*k) * t)).sum() };
            let around = |sign: f64| {
                shape::curve(move |t| {
                    let z = at(sign * t);
                    Vector2::new(z.re, z.im)
                })
            };
            let outline = around(1.0);
            if outline.area() > 0.0 { outline } else { around(-1.0) }
        }
        Shape::Polygon { points_um, rounding_um } => {
            let corners = points_um.iter().map(|p| Vector2::new(p[0], p[1])).collect();
            shape::rounded_polygon(corners, *rounding_um).map_err(|e| WaveError::Invalid {
                key: "rounding_um".into(),
                value: rounding_um.to_string(),
                hint: e.to_string(),
            })?
        }
    })
}

/// A regular polygon with a corner at azimuth 0.
fn regular(corners: u32, radius_um: f64, rounding_um: f64) -> Shape {
    let corner = |i: u32| {
        let (s, c) = (TAU * f64::from(i) / f64::from(corners)).sin_cos();
        [radius_um * c, radius_um * s]
    };
    Shape::Polygon { points_um: (0..corners).map(corner).collect(), rounding_um }
}

/// `r = radius (1 + depth cos(lobes t))`.
fn lobed(radius_um: f64, depth: f64, lobes: u32) -> Shape {
    let (n, half) = (lobes as i32, C64::new(0.5 * radius_um * depth, 0.0));
    let mut coeffs = vec![(1, C64::new(radius_um, 0.0)), (1 + n, half), (1 - n, half)];
    if depth == 0.0 {
        coeffs.truncate(1);
    }
    Shape::Fourier { coeffs }
}

/// Coefficients of a curve that is a trigonometric polynomial of degree below 32, without those due to
/// rounding.
fn trigonometric(curve: impl Fn(f64) -> Vector2<f64>) -> Vec<(i32, C64)> {
    const N: i32 = 64;
    let points: Vec<C64> =
        (0..N).map(|j| curve(TAU * f64::from(j) / f64::from(N))).map(|p| C64::new(p.x, p.y)).collect();
    let largest = points.iter().map(|p| p.norm()).fold(0.0, f64::max);
    (1 - N / 2..N / 2)
        .map(|k| {
            let turn = |j: usize| C64::from_polar(1.0, -TAU * f64::from(k) * j as f64 / f64::from(N));
            (k, points.iter().enumerate().map(|(j, p)| p * turn(j)).sum::<C64>() / f64::from(N))
        })
        .filter(|(_, c)| c.norm() > 1e-14 * largest)
        .collect()
}

/// Centroid of the area within a Fourier outline: `A = pi sum k |c_k|^2` and, as
/// `2 i A z = closed integral of |z|^2 dz` over the outline, by the trapezoid rule, which is exact here.
fn center_of(coeffs: &[(i32, C64)]) -> C64 {
    const N: u32 = 256;
    let area: f64 = PI * coeffs.iter().map(|(k, c)| f64::from(*k) * c.norm_sqr()).sum::<f64>();
    let moment: C64 = (0..N)
        .map(|j| TAU * f64::from(j) / f64::from(N))
        .map(|t| {
            let turn = |k: i32| C64::from_polar(1.0, f64::from(k) * t);
            let z: C64 = coeffs.iter().map(|(k, c)| c * turn(*k)).sum();
            let dz: C64 = coeffs.iter().map(|(k, c)| C64::new(0.0, f64::from(*k)) * c * turn(*k)).sum();
            z.norm_sqr() * dz
        })
        .sum::<C64>()
        * (TAU / f64::from(N));
    moment / C64::new(0.0, 2.0 * area)
}

/// n-fold when all harmonics are 1 modulo n; mirrored in the x axis when all coefficients are real.
fn fourier_symmetry(coeffs: &[(i32, C64)]) -> OutlineSymmetry {
    let largest = coeffs.iter().map(|(_, c)| c.norm()).fold(0.0, f64::max);
    let mut present = coeffs.iter().filter(|(_, c)| c.norm() > 1e-12 * largest);
    let gcd = |mut a: u32, mut b: u32| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let folds = present.clone().fold(0, |n, (k, _)| gcd(n, (k - 1).unsigned_abs()));
    let real = present.all(|(_, c)| c.im.abs() <= 1e-12 * largest);
    match folds {
        0 => OutlineSymmetry::CIRCLE,
        n if n > 360 => OutlineSymmetry::NONE,
        n => OutlineSymmetry { folds: n, mirror_rad: real.then_some(0.0) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    fn spec(shape: plywave::spec::Shape) -> FiberSpec {
        FiberSpec {
            shape,
            size_jitter: 0.0,
            shape_jitter: 0.0,
            angle_jitter_rad: Some(0.0),
            ..YarnSpec::polyester().unwrap().fiber
        }
    }

    fn shapes() -> Vec<plywave::spec::Shape> {
        vec![
            plywave::spec::Shape::Circle { radius_um: 7.5 },
            plywave::spec::Shape::Ellipse { a_um: 1.6, b_um: 1.0 },
            plywave::spec::Shape::Kidney { a_um: 8.0, b_um: 5.0, dent: 0.4, lumen: 0.5 },
            plywave::spec::Shape::RoundedTriangle { radius_um: 6.0, rounding_um: 1.0 },
            plywave::spec::Shape::Trilobal { radius_um: 6.0, depth: 0.2 },
            plywave::spec::Shape::Polygon {
                file: String::new(),
                points_um: vec![[1.0, 0.0], [9.0, 1.0], [5.0, 6.0]],
                rounding_um: 0.5,
            },
        ]
    }

    /// Shapes that a spec without jitter draws are the mean fiber's; areas, centroids and walls agree.
    #[test]
    fn mean_fibers_are_those_drawn_without_jitter() {
        for shape in shapes() {
            let spec = spec(shape);
            let drawn = shape::draw(&spec, &mut Pcg64Mcg::seed_from_u64(3)).unwrap();
            let fiber = SingleFiber::of_spec(&spec, Absorption::Sigma(0.0));
            let mean = fiber.section().unwrap();
            let (got, want) = (mean.outer.area(), drawn.outer.area());
            assert!((got / want - 1.0).abs() < 2e-3, "{:?}: area {got}, drawn {want}", spec.shape);
            assert!(mean.outer.centroid().norm() < 1e-3 * fiber.bound_um().unwrap(), "{:?}", mean.outer.centroid());
            let farthest =
                drawn.outer.polyline(200).iter().map(|p| mean.outer.signed_distance(*p).abs()).fold(0.0, f64::max);
            assert!(farthest < 0.03, "{:?}: walls {farthest} um apart", spec.shape);
            assert_eq!(mean.lumen.is_some(), drawn.lumen.is_some());
            if let (Some(a), Some(b)) = (&mean.lumen, &drawn.lumen) {
                let farthest = b.polyline(200).iter().map(|p| a.signed_distance(*p).abs()).fold(0.0, f64::max);
                assert!(farthest < 0.03, "{:?}: lumens {farthest} um apart", spec.shape);
            }
        }
    }

    /// Irregular shapes have the area of their spec.
    #[test]
    fn regular_forms_keep_the_area() {
        let stone = spec(plywave::spec::Shape::Stone { radius_um: 5.0, corners: 6, rounding_um: 0.7 });
        let area = SingleFiber::of_spec(&stone, Absorption::Sigma(0.0)).section().unwrap().outer.area();
        assert!((area / (25.0 * PI) - 1.0).abs() < 1e-3, "{area}");
    }

    /// The outline has its stated symmetry: a rotation by a fold or a reflection maps it to itself.
    #[test]
    fn symmetries_hold() {
        let mut all = shapes();
        all.push(plywave::spec::Shape::Stone { radius_um: 5.0, corners: 5, rounding_um: 0.7 });
        all.push(plywave::spec::Shape::Serrated { radius_um: 5.0, depth: 0.1, teeth: 9 });
        for shape in all {
            let fiber = SingleFiber::of_spec(&spec(shape), Absorption::Sigma(0.0));
            let outer = fiber.section().unwrap().outer;
            let points = outer.polyline(300);
            let apart = |turned: &dyn Fn(Vector2<f64>) -> Vector2<f64>| {
                points.iter().map(|p| outer.signed_distance(turned(*p)).abs()).fold(0.0, f64::max)
            };
            let turn = if fiber.symmetry.folds == 0 { 1.0 } else { TAU / f64::from(fiber.symmetry.folds) };
            let by_fold = apart(&|p| nalgebra::Rotation2::new(turn) * p);
            assert!(by_fold < 0.01, "{:?}: {by_fold}", fiber.symmetry);
            if let Some(mirror) = fiber.symmetry.mirror_rad {
                let (s, c) = (2.0 * mirror).sin_cos();
                let by_mirror = apart(&|p| Vector2::new(c * p.x + s * p.y, s * p.x - c * p.y));
                assert!(by_mirror < 0.01, "{:?}: {by_mirror}", fiber.symmetry);
            }
            let [low, high] = fiber.shadow_um(0.3).unwrap();
            let along = |p: &Vector2<f64>| p.x * 0.3f64.sin() - p.y * 0.3f64.cos();
            let want = points.iter().map(along).fold(0.0, f64::max);
            assert!(high > low && (high - want).abs() < 0.02 * want, "shadow {low} to {high}, want {want}");
        }
    }

    #[test]
    fn bodies_of_scenes_show_their_symmetry() {
        let body =
            |shape, lumen| Body { shape, center_um: [3.0, 1.0], rotation_rad: 0.5, eta: 1.5, kappa: 0.01, lumen };
        let real =
            |c: &[(i32, f64)]| Shape::Fourier { coeffs: c.iter().map(|(k, c)| (*k, C64::new(*c, 0.0))).collect() };
        let of = |shape| SingleFiber::of_body(&body(shape, None)).symmetry;
        assert_eq!(of(Shape::Circle { radius_um: 1.0 }), OutlineSymmetry::CIRCLE);
        assert_eq!(of(real(&[(1, 2.0)])), OutlineSymmetry::CIRCLE);
        assert_eq!(of(real(&[(1, 2.0), (-1, 0.3), (3, 0.1)])), OutlineSymmetry { folds: 2, mirror_rad: Some(0.0) });
        let twisted =
            Shape::Fourier { coeffs: vec![(1, C64::new(2.0, 0.0)), (4, C64::new(0.1, 0.1)), (-2, C64::new(0.1, 0.0))] };
        assert_eq!(of(twisted), OutlineSymmetry { folds: 3, mirror_rad: None });
        // A lumen off the center removes the symmetry and keeps its position in the fiber.
        let inner = body(Shape::Circle { radius_um: 0.2 }, None);
        let inner = Body { center_um: [3.0, 1.5], eta: 1.0, kappa: 0.0, ..inner };
        let fiber = SingleFiber::of_body(&body(Shape::Circle { radius_um: 1.0 }, Some(Box::new(inner))));
        assert_eq!(fiber.symmetry, OutlineSymmetry::NONE);
        let at = fiber.body.lumen.as_ref().unwrap().center_um;
        let want = [0.5 * 0.5f64.sin(), 0.5 * 0.5f64.cos()];
        assert!((at[0] - want[0]).abs() < 1e-12 && (at[1] - want[1]).abs() < 1e-12, "{at:?} {want:?}");
        assert!(fiber.section().unwrap().lumen.is_some());
        assert!((fiber.at(0.5).kappa - 0.01).abs() < 1e-15);
        assert!((Absorption::Sigma(4.0 * PI).kappa(0.5) - 0.5).abs() < 1e-15);
    }
}
