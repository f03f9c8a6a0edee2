//! Scenes of strands (TOML): strands, their fiber, lamps, sky and camera. Degrees are turned to radians here.

mod keys;
mod types;

use crate::failure::{Failure, Outcome};
use crate::kinds;
use glam::Vec3;
use keys::RULES;
use plywave::FiberModel;
use plywave::fiber::{
    DielectricFiber, DielectricParameters, KajiyaKayFiber, KajiyaKayParameters, Metal, Mirror, OpaqueFiber,
    OpaqueParameters, RoughDielectricFiber, RoughDielectricParameters,
};
use plywave::spec::rules;
use plywave_render::{
    Basis, Camera, Environment, Light, Prop, Shape, StrandFiber, StrandFile, StrandScene, StrandShape, make,
};
use std::path::{Path, PathBuf};
use types::{MirrorSpec, ModelSpec, SigmaSpec, Spec};

/// Longest scene file [bytes].
const MOST_BYTES: u64 = 4 << 20;

/// A scene of strands as its file describes it.
pub struct StrandSpec {
    file: String,
    folder: PathBuf,
    spec: Spec,
}

impl StrandSpec {
    /// Reads and checks a file; another kind of file is named.
    pub fn load(path: &Path) -> Outcome<StrandSpec> {
        let explain = |e: plywave::Error| kinds::explain(path, &[kinds::Kind::StrandScene], e);
        let file = path.display().to_string();
        let text = plywave::io::read_text(path, MOST_BYTES).map_err(explain)?;
        let table = rules::parse(&text, &file, &RULES).map_err(explain)?;
        let spec: Spec = rules::typed(table, &file, &RULES)?;
        let strands = &spec.strands;
        let refuse = |key: &str, value: &str, hint: &str| Err(Failure::input(&file, key, value, hint));
        match (&strands.file, &strands.make) {
            (None, None) => {
                return refuse("strands", "(neither file nor make)", "name a file of strands, or a kind to make");
            }
            (Some(_), Some(_)) => return refuse("strands.make", "(file and make)", "give one of the two"),
            (None, Some(_)) if strands.radius_um.is_none() => {
                return refuse("strands.radius_um", "(absent)", "this key must be given where strands are made");
            }
            _ => {}
        }
        let camera = &spec.camera;
        let [from, to] = [camera.from_mm, camera.to_mm].map(Vec3::from);
        if (to - from).length() < 1e-6 {
            return refuse("camera.to_mm", &format!("{:?}", camera.to_mm), "must not be where the camera is");
        }
        for lamp in &spec.lamps {
            if (Vec3::from(lamp.from_mm) - Vec3::from(lamp.to_mm)).length() < 1e-6 {
                return refuse("lamps.to_mm", &format!("{:?}", lamp.to_mm), "must not be where the lamp is");
            }
        }
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        Ok(StrandSpec { file, folder, spec })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// Files that it names.
    pub fn inputs(&self) -> Vec<(&'static str, PathBuf)> {
        let mut list = Vec::new();
        list.extend(self.spec.strands.file.iter().map(|file| ("strands", self.folder.join(file))));
        if let ModelSpec::Table { file, .. } = &self.spec.fiber.model {
            list.push(("fiber", self.folder.join(file)));
        }
        list
    }

    /// What it is lit and seen by, and notes for the user.
    pub fn scene(&self, sky: Option<Environment>) -> Outcome<(StrandScene, Camera, Vec<String>)> {
        let failed = crate::commands::render::failed;
        let Spec { strands: s, camera, .. } = &self.spec;
        let basis = if s.basis.as_deref() == Some("linear") { Basis::Linear } else { Basis::BSpline };
        let strands = match (&s.make, &s.file) {
            (Some(of), _) => {
                let radius = 1e-3 * s.radius_um.unwrap_or(1.0);
                make(&of.made(), radius, s.segments.unwrap_or(32), s.seed.unwrap_or(1)).map_err(failed)?
            }
            (None, file) => {
                let path = self.folder.join(file.as_deref().unwrap_or(Path::new("")));
                let is_hair = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hair"));
                let how = StrandFile {
                    basis,
                    mm_per_unit: s.mm_per_unit.unwrap_or(1.0),
                    radius_mm: s.radius_um.map(|r| 1e-3 * r),
                    whole: s.whole.unwrap_or(is_hair),
                };
                plywave_render::Strands::load(&path, &how).map_err(failed)?
            }
        };
        let mut notes =
            vec![format!("{} strands of {} segments", strands.len(), crate::report::count(strands.segments() as f64))];
        let mean_um =
            1e3 * strands.points().iter().map(|p| f64::from(p[3])).sum::<f64>() / strands.points().len().max(1) as f64;
        let fiber = self.fiber(mean_um as f32)?;
        let model_um = f64::from(fiber.radius_um());
        if (mean_um / model_um).ln().abs() > 0.5 && matches!(fiber.model, FiberModel::Tabulated(_)) {
            notes.push(format!(
                "the strands' radius is {mean_um:.3} um in the mean, the table's {model_um:.3} um: the fiber is shown enlarged"
            ));
        }
        let shape = if s.shape.as_deref() == Some("band") { StrandShape::Band } else { StrandShape::Tube };
        let lights = (self.spec.lamps.iter())
            .map(|l| Light::facing(l.from_mm.into(), l.to_mm.into(), l.size_mm, l.radiance))
            .collect();
        let sky = sky.unwrap_or_else(|| Environment::constant(self.spec.sky));
        let mut scene = StrandScene::new(strands, shape, fiber, lights, sky);
        scene.props.extend(
            self.spec.floor.iter().map(|f| Prop { shape: Shape::Floor { height_mm: f.height_mm }, albedo: f.albedo }),
        );
        scene.props.extend(self.spec.ball.iter().map(|b| Prop {
            shape: Shape::Ball { center: b.center_mm.into(), radius_mm: b.radius_mm },
            albedo: b.albedo,
        }));
        let up = camera.up.map_or(Vec3::Z, Vec3::from);
        let camera = Camera::new(camera.from_mm.into(), camera.to_mm.into(), up, camera.fov_deg.to_radians());
        Ok((scene, camera, notes))
    }

    fn fiber(&self, radius_um: f32) -> Outcome<StrandFiber> {
        let said = |e: plywave::Error| Failure::Input(format!("{}: fiber.model: {e}", self.file));
        let rad = f32::to_radians;
        let model: FiberModel = match &self.spec.fiber.model {
            ModelSpec::Table { file, beta_m_deg } => {
                let path = self.folder.join(file);
                let fiber = FiberModel::load(&path).map_err(|e| kinds::explain(&path, &[kinds::Kind::Fiber], e))?;
                match (fiber, beta_m_deg) {
                    (FiberModel::Tabulated(fiber), Some(beta)) => fiber.with_beta_m(rad(*beta)).into(),
                    (fiber, _) => fiber,
                }
            }
            ModelSpec::Dielectric { radius_um: r, eta, beta_m_deg, shift_deg, beta_n_deg, orders } => {
                let d = DielectricParameters::default();
                let parameters = DielectricParameters {
                    eta: eta.unwrap_or(d.eta),
                    radius_um: r.unwrap_or(radius_um),
                    beta_m: beta_m_deg.map_or(d.beta_m, |v| v.map(rad)),
                    shift: shift_deg.map_or(d.shift, |v| v.map(rad)),
                    beta_n: beta_n_deg.map_or(d.beta_n, rad),
                    orders: orders.unwrap_or(d.orders),
                };
                DielectricFiber::new(parameters).map_err(said)?.into()
            }
            ModelSpec::RoughDielectric { radius_um: r, eta, shift_deg, width_theta_deg, width_phi_deg, k_d } => {
                let d = RoughDielectricParameters::default();
                let parameters = RoughDielectricParameters {
                    eta: eta.unwrap_or(d.eta),
                    radius_um: r.unwrap_or(radius_um),
                    shift: shift_deg.map_or(d.shift, |v| v.map(rad)),
                    width_theta: width_theta_deg.map_or(d.width_theta, |v| v.map(rad)),
                    width_phi: width_phi_deg.map_or(d.width_phi, |v| v.map(rad)),
                    k_d: k_d.unwrap_or(d.k_d),
                };
                RoughDielectricFiber::new(parameters).map_err(said)?.into()
            }
            ModelSpec::Opaque { radius_um: r, mirror, diffuse, beta_m_deg, beta_n_deg } => {
                let d = OpaqueParameters::default();
                let mirror = match mirror {
                    None => Mirror::None,
                    Some(MirrorSpec::Metal(name)) => Metal::named(name).map_or(Mirror::None, Mirror::Metal),
                    Some(MirrorSpec::Varnish(eta)) => Mirror::Dielectric(*eta),
                };
                let parameters = OpaqueParameters {
                    radius_um: r.unwrap_or(radius_um),
                    mirror,
                    diffuse: diffuse.unwrap_or(d.diffuse),
                    beta_m: beta_m_deg.map_or(d.beta_m, rad),
                    beta_n: beta_n_deg.map_or(d.beta_n, rad),
                };
                OpaqueFiber::new(parameters).map_err(said)?.into()
            }
            ModelSpec::KajiyaKay { radius_um: r, phong, exponent, diffuse } => {
                let d = KajiyaKayParameters::default();
                let parameters = KajiyaKayParameters {
                    radius_um: r.unwrap_or(radius_um),
                    phong: phong.unwrap_or(d.phong),
                    exponent: exponent.unwrap_or(d.exponent),
                    diffuse: diffuse.unwrap_or(d.diffuse),
                };
                KajiyaKayFiber::new(parameters).map_err(said)?.into()
            }
        };
        let sigma = match &self.spec.fiber.sigma_per_um {
            None => Vec::new(),
            Some(SigmaSpec::Same(sigma)) => vec![[0.55, *sigma]],
            Some(SigmaSpec::Spectrum(nodes)) => nodes.clone(),
        };
        if !sigma.is_empty() && matches!(model, FiberModel::Tabulated(_)) {
            let hint = "a table has its own absorption; leave this key out";
            return Err(Failure::input(&self.file, "fiber.sigma_per_um", "given with a table", hint));
        }
        Ok(StrandFiber { model, sigma, near: self.spec.fiber.near })
    }
}
