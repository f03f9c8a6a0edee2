//! Scenes of strands (TOML): strands, their fiber, lamps, sky and camera.

mod keys;
mod types;

use crate::failure::{Failure, Outcome};
use crate::kinds;
use glam::Vec3;
use keys::RULES;
use plywave::spec::rules;
use plywave::spec::rules::number;
use plywave_fiber::FiberModel;
use plywave_fiber::filament_of;
use plywave_render::{
    Basis, Camera, Environment, Light, Prop, Shape, StrandFiber, StrandFile, StrandNotes, StrandScene, StrandShape,
    make,
};
use std::path::{Path, PathBuf};
use types::{SigmaSpec, Spec};

/// Longest scene file [bytes].
const MAX_BYTES: u64 = 4 << 20;

/// A scene of strands as its file describes it.
pub struct StrandSpec {
    file: String,
    folder: PathBuf,
    spec: Spec,
}

/// A scene of strands, loaded.
pub struct Loaded {
    pub scene: StrandScene,
    /// What it is seen by.
    pub camera: Camera,
    /// For the user, a line each.
    pub notes: Vec<String>,
    /// Files that the file of strands includes.
    pub included: Vec<PathBuf>,
}

impl StrandSpec {
    /// Reads and checks a file; another kind of file is named.
    pub fn load(path: &Path) -> Outcome<StrandSpec> {
        let explain = |e: plywave::Error| kinds::explain(path, &[kinds::InputKind::StrandScene], e);
        let file = path.display().to_string();
        let text = plywave::io::read_text(path, MAX_BYTES).map_err(explain)?;
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
        list.extend(self.table().map(|path| ("fiber", path)));
        list
    }

    /// The fiber's table, if it is of one.
    fn table(&self) -> Option<PathBuf> {
        self.spec.fiber.model.get("file").and_then(toml::Value::as_str).map(|file| self.folder.join(file))
    }

    /// What it is of.
    pub fn load_scene(&self, sky: Option<Environment>) -> Outcome<Loaded> {
        let failed = crate::rendering::failed;
        let Spec { strands: s, camera, .. } = &self.spec;
        let basis = if s.basis.as_deref() == Some("linear") { Basis::Linear } else { Basis::BSpline };
        let (strands, reported) = match (&s.make, &s.file) {
            (Some(of), _) => {
                let radius = 1e-3 * s.radius_um.unwrap_or(1.0);
                let made = make(of, radius, s.segments.unwrap_or(32), s.seed.unwrap_or(1)).map_err(failed)?;
                (made, StrandNotes::default())
            }
            (None, file) => {
                let path = self.folder.join(file.as_deref().unwrap_or(Path::new("")));
                // Both have the points of whole strands.
                let is_whole = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
                let is_whole = ["hair", "obj"].into_iter().any(is_whole);
                let import = StrandFile {
                    basis,
                    mm_per_unit: s.mm_per_unit.unwrap_or(1.0),
                    radius_mm: s.radius_um.map(|r| 1e-3 * r),
                    whole: s.whole.unwrap_or(is_whole),
                };
                plywave_render::Strands::load(&path, &import).map_err(failed)?
            }
        };
        let mut notes =
            vec![format!("{} strands of {} segments", strands.len(), crate::report::count(strands.segments() as f64))];
        notes.extend(reported.lines());
        let mean_um = 1e3 * strands.mean_radius_mm();
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
        Ok(Loaded { scene, camera, notes, included: reported.included.into_iter().collect() })
    }

    fn fiber(&self, radius_um: f32) -> Outcome<StrandFiber> {
        let model: FiberModel = match self.table() {
            Some(path) => {
                let fiber =
                    FiberModel::load(&path).map_err(|e| kinds::explain(&path, &[kinds::InputKind::Fiber], e))?;
                match (fiber, self.spec.fiber.model.get("beta_m").and_then(number)) {
                    (FiberModel::Tabulated(fiber), Some(beta)) => fiber.with_beta_m(beta as f32).into(),
                    (fiber, _) => fiber,
                }
            }
            None => {
                let mut model = self.spec.fiber.model.clone();
                model.entry("radius_um").or_insert(f64::from(radius_um).into());
                filament_of(&model, &self.file, "fiber.model")?
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
