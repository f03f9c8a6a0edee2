//! Cloth files (`.pwc`): all that shading needs, made once.

use super::between::{CLASSES, InterYarn, PAIRS, PLY_CLASSES, SIGMAS, Side};
use super::cones::{Cone, NORMS};
use super::far::{COLUMNS, FarData, NODES, OPENING_NUMBERS, VIEWS};
use super::hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES, HairLayer};
use super::plies::Runs;
use super::query::ClothOptions;
use super::shade::ClothShadows;
use super::shadow::{self, LANES, ROWS};
use super::splines::COUNT;
use super::terms::{FEW, TERMS};
use super::{ClothCurves, ClothYarn, PlyCurve, color_of};
use crate::io::{Axis, Check, Document, FileKind, Provenance, Reader, Writer, document, invalid};
use crate::spec::YarnSpec;
use crate::{PlyModel, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// Most kinds of yarns.
const MAX_KINDS: usize = 2;
const MODELS: [&str; MAX_KINDS] = ["model_0", "model_1"];

/// A cloth, ready for shading: the contents of a cloth file.
#[derive(Clone, Debug)]
pub struct ClothData {
    /// Text of the cloth spec.
    pub spec_text: String,
    /// Name of the cloth.
    pub name: String,
    /// Program version that wrote it.
    pub program_version: String,
    /// The curves of its plies.
    pub curves: ClothCurves,
    /// Model of each kind of yarn, [in single lines](PlyModel::of_lines).
    pub models: Vec<Arc<PlyModel>>,
    /// By kind of yarn, colors [sRGB, 0 to 1] of the yarns by their number, which repeat; none where the spec
    /// has one for all.
    pub colors: [Vec<[f32; 3]>; 2],
    /// Shadows of its plies.
    #[doc(hidden)]
    pub shadows: ClothShadows,
    /// The light between its plies.
    #[doc(hidden)]
    pub between: InterYarn,
    /// The hairs over its sides.
    #[doc(hidden)]
    pub hairs: Option<HairLayer>,
    /// By node of absorption of both kinds alike, of clear fibers first: scattered light of all orders over
    /// the light that meets fibers, under light from everywhere.
    #[doc(hidden)]
    pub albedo: [f64; color_of::NODES],
    /// The mean over the cell.
    #[doc(hidden)]
    pub far: Option<FarData>,
}

/// Keys of the JSON document besides the common ones.
#[derive(Serialize, Deserialize)]
pub(crate) struct Keys {
    cell_um: [[f64; 2]; 2],
    yarns: Vec<ClothYarn>,
    curves: Vec<CurveKeys>,
    colors: [Vec<[f32; 3]>; 2],
}

/// A curve without its control points, which are rows of the tensor `control_um`.
#[derive(Serialize, Deserialize)]
struct CurveKeys {
    yarn: u32,
    radius_um: f64,
    shift: [i32; 2],
    points: usize,
    /// Places at which its shadows are tabulated.
    places: u32,
}

impl ClothData {
    /// Writes the cloth (`docs/reference/format/cloth.md`) atomically.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if it would not load again, [`crate::Error::Io`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        document::save(self, path.as_ref())
    }

    /// Reads a cloth and checks names, shapes, ranges and finiteness.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Format`] for a foreign, damaged or newer file,
    /// [`crate::Error::Invalid`] for a value that is not allowed.
    pub fn load(path: impl AsRef<Path>) -> Result<ClothData> {
        document::load(path.as_ref())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if it would not load again.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        document::to_bytes(self, "cloth")
    }

    /// Reads a cloth from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// As [`ClothData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<ClothData> {
        Ok(document::from_bytes(bytes, name)?.0)
    }

    /// Whether the mean over the cell is in it.
    pub fn has_far(&self) -> bool {
        self.far.is_some()
    }

    /// Names of its plies, by kind of yarn.
    pub fn ply_names(&self) -> Vec<String> {
        let name = |text: &str| YarnSpec::parse(text, "model").map_or_else(|_| "a ply".into(), |spec| spec.name);
        self.models.iter().map(|model| name(&model.data().spec_text)).collect()
    }

    /// Effects that these options ask of it and that it does not have, one note a line: speckle of models
    /// without noise, the mean over the cell.
    pub fn notes(&self, options: &ClothOptions) -> Vec<String> {
        let mut notes = Vec::new();
        let plies = self.models.iter().zip(self.ply_names());
        for (_, ply) in plies.filter(|(model, _)| options.noise && model.data().noise.is_none()) {
            let note = format!("{ply} has no speckle noise and stays smooth; `plywave noise` adds it");
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        if options.far && !self.has_far() {
            notes.push("the mean over the cell is not in the file: footprints count as points".into());
        }
        notes
    }

    fn kinds(&self) -> usize {
        self.models.len()
    }
}

/// Numbers of a tensor as rows of F.
fn rows<const F: usize>(values: Vec<f32>) -> Vec<[f32; F]> {
    values.as_chunks::<F>().0.to_vec()
}

/// Of `hair_scatter`: kind, view, light, azimuth, absorption.
const HAIR_SHAPE: [usize; 5] = [2, HAIR_COSINES, 2 * HAIR_COSINES, HAIR_AZIMUTHS, SIGMAS];

/// Numbers of a cone: width, energy, norm.
pub(super) const CONE_NUMBERS: usize = 1 + TERMS + NORMS;

/// Those of a side.
pub(super) fn cone_numbers(side: &Side) -> Vec<f32> {
    let numbers = |cone: &Cone| [&[cone.width][..], &cone.energy, &cone.norm].concat();
    side.cones.as_flattened().iter().flat_map(numbers).collect()
}

fn cone_of(numbers: &[f32; CONE_NUMBERS]) -> Cone {
    let mut cone = Cone { width: numbers[0], ..Cone::NONE };
    cone.energy.copy_from_slice(&numbers[1..=TERMS]);
    cone.norm.copy_from_slice(&numbers[1 + TERMS..]);
    cone
}

impl Document for ClothData {
    const KIND: FileKind = FileKind::Cloth;
    type Keys = Keys;

    fn names() -> Vec<&'static str> {
        let tables = [
            "control_um",
            "shadow_free",
            "between_caught",
            "between_leaves",
            "between_shape",
            "between_parallel",
            "between_cones",
            "hair_area",
            "hair_scatter",
            "albedo",
            "far_f",
            "far_first",
            "far_passing",
            "far_openings",
        ];
        [&tables[..], &MODELS].concat()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.name.clone(),
            seed: 0,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<Keys> {
        let curves = self.curves.curves.iter().zip(self.shadows.counts());
        let curves = curves.map(|(c, places)| CurveKeys {
            yarn: c.yarn,
            radius_um: c.radius_um,
            shift: c.shift,
            points: c.control_um.len(),
            places,
        });
        Ok(Keys {
            cell_um: self.curves.cell_um,
            yarns: self.curves.yarns.clone(),
            curves: curves.collect(),
            colors: self.colors.clone(),
        })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let points = self.curves.curves.iter().map(|c| c.control_um.len()).sum();
        let axes = vec![Axis::new("curve", "1", self.curves.curves.len()), Axis::new("point", "um", points)];
        (axes, serde_json::json!({ "far": self.has_far() }))
    }

    fn tensors(&self, w: &mut Writer) {
        let points: Vec<f64> = self.curves.curves.iter().flat_map(|c| c.control_um.as_flattened()).copied().collect();
        w.f64("control_um", &[points.len() / 3, 3], &points);
        for (name, model) in MODELS.into_iter().zip(&self.models) {
            // Checked, so that it is written.
            let bytes = model.data().to_bytes().unwrap_or_default();
            w.u8(name, &[bytes.len()], &bytes);
        }
        let free = self.shadows.free();
        let row = 2 * ROWS * shadow::COLUMNS * LANES;
        w.u8("shadow_free", &[free.len() / row, 2 * ROWS, shadow::COLUMNS, LANES], free);
        let sides = &self.between.sides;
        let of = |values: &dyn Fn(&Side) -> Vec<f32>| sides.iter().flat_map(values).collect::<Vec<f32>>();
        let caught = of(&|s| s.caught.as_flattened().as_flattened().to_vec());
        w.f32("between_caught", &[2, CLASSES, 3, COUNT, SIGMAS], caught.into_iter());
        let leaves = of(&|s| s.leaves.as_flattened().to_vec());
        w.f32("between_leaves", &[2, CLASSES, 2, 2, PAIRS, FEW], leaves.into_iter());
        w.f32("between_shape", &[2, 2, PAIRS, TERMS], of(&|s| s.shape.as_flattened().to_vec()).into_iter());
        let parallel = of(&|s| s.parallel.as_flattened().as_flattened().to_vec());
        w.f32("between_parallel", &[2, CLASSES, 2, 2, SIGMAS, FEW], parallel.into_iter());
        w.f32("between_cones", &[2, 2, 2, CONE_NUMBERS], of(&|s| cone_numbers(s)).into_iter());
        if let Some(hairs) = &self.hairs {
            let area = hairs.area.as_flattened().as_flattened().iter().copied();
            w.f32("hair_area", &[2, 2, HAIR_COSINES], area);
            w.f32("hair_scatter", &HAIR_SHAPE, hairs.scatter.as_flattened().iter().copied());
        }
        w.f64("albedo", &[color_of::NODES], &self.albedo);
        if let Some(far) = &self.far {
            let kinds = self.kinds();
            w.f16("far_f", &[kinds, VIEWS, COLUMNS, NODES, SIGMAS], far.f.as_flattened().iter().copied());
            let first = far.first.as_flattened().as_flattened().iter().copied();
            w.f32("far_first", &[kinds, VIEWS, PLY_CLASSES, SIGMAS], first);
            w.f32("far_passing", &[VIEWS], far.passing.iter().copied());
            let openings = FarData::opening_numbers(&far.openings).into_iter().map(|n| n as f32);
            w.f32("far_openings", &[VIEWS, OPENING_NUMBERS], openings);
        }
    }

    fn read(r: &Reader<'_>, p: Provenance, keys: &Keys) -> Result<ClothData> {
        let models = MODELS.into_iter().filter(|name| r.has(name)).map(|name| {
            let bytes = r.u8(name, &r.shape(name, 1)?)?;
            Ok(Arc::new(PlyModel::from_bytes(&bytes, &format!("{} ({name})", r.file()))?.in_lines()))
        });
        let models = models.collect::<Result<Vec<_>>>()?;
        let points = r.f64("control_um", &r.shape("control_um", 2)?)?;
        let rows_of_points = points.len() / 3;
        let mut points = points.as_chunks::<3>().0.iter().copied();
        let curves = keys.curves.iter().map(|c| {
            let control_um: Vec<[f64; 3]> = points.by_ref().take(c.points).collect();
            PlyCurve { yarn: c.yarn, radius_um: c.radius_um, shift: c.shift, control_um }
        });
        let curves = ClothCurves { cell_um: keys.cell_um, yarns: keys.yarns.clone(), curves: curves.collect() };
        let wanted = keys.curves.iter().fold(0usize, |sum, c| sum.saturating_add(c.points));
        if wanted != rows_of_points {
            let value = format!("{rows_of_points} rows");
            return Err(invalid(r.file(), "control_um", value, "expected as many as the curves have points"));
        }
        curves.check(r.file())?;
        let shape = r.shape("shadow_free", 4)?;
        let free = r.u8("shadow_free", &[shape[0], 2 * ROWS, shadow::COLUMNS, LANES])?;
        let counts: Vec<u32> = keys.curves.iter().map(|c| c.places).collect();
        let knots = curves.curves.iter().map(|c| c.control_um.len());
        let shadows = ClothShadows::of(&counts, knots, free).ok_or_else(|| {
            invalid(r.file(), "shadow_free", format!("{} places", shape[0]), "expected those of the curves")
        })?;
        let caught = rows::<SIGMAS>(r.f32("between_caught", &[2, CLASSES, 3, COUNT, SIGMAS])?);
        let leaves = rows::<FEW>(r.f32("between_leaves", &[2, CLASSES, 2, 2, PAIRS, FEW])?);
        let shape = rows::<TERMS>(r.f32("between_shape", &[2, 2, PAIRS, TERMS])?);
        let parallel = rows::<FEW>(r.f32("between_parallel", &[2, CLASSES, 2, 2, SIGMAS, FEW])?);
        let cones = rows::<CONE_NUMBERS>(r.f32("between_cones", &[2, 2, 2, CONE_NUMBERS])?);
        let side = |side: usize| {
            let of = |count: usize| side * count / 2..(side + 1) * count / 2;
            Side {
                caught: caught[of(caught.len())].as_chunks::<COUNT>().0.to_vec(),
                leaves: leaves[of(leaves.len())].to_vec(),
                shape: shape[of(shape.len())].to_vec(),
                parallel: parallel[of(parallel.len())].as_chunks::<SIGMAS>().0.to_vec(),
                cones: [0, 1].map(|kind| [0, 1].map(|half| cone_of(&cones[4 * side + 2 * kind + half]))),
            }
        };
        let between = InterYarn::new([side(0), side(1)]);
        let hairs = if r.has("hair_area") {
            let numbers = rows::<HAIR_COSINES>(r.f32("hair_area", &[2, 2, HAIR_COSINES])?);
            let area = [0, 1].map(|side| [0, 1].map(|kind| numbers[2 * side + kind]));
            Some(HairLayer::new(area, rows::<SIGMAS>(r.f32("hair_scatter", &HAIR_SHAPE)?)))
        } else {
            None
        };
        let mut albedo = [0.0; color_of::NODES];
        albedo.copy_from_slice(&r.f64("albedo", &[color_of::NODES])?);
        let far = if r.has("far_f") {
            let kinds = models.len();
            let f = rows(r.f16("far_f", &[kinds, VIEWS, COLUMNS, NODES, SIGMAS])?);
            let first = rows::<SIGMAS>(r.f32("far_first", &[kinds, VIEWS, PLY_CLASSES, SIGMAS])?);
            let passing = r.f32("far_passing", &[VIEWS])?;
            let numbers: Vec<u32> =
                r.f32("far_openings", &[VIEWS, OPENING_NUMBERS])?.into_iter().map(|n| n as u32).collect();
            let openings = FarData::openings_of(&numbers).ok_or_else(|| {
                invalid(r.file(), "far_openings", "(other numbers)", "expected a count and numbers of spectra")
            })?;
            // How yarns run is found with the curves.
            Some(FarData { runs: [Runs::AlongY; 2], f, first: first.as_chunks().0.to_vec(), passing, openings })
        } else {
            None
        };
        Ok(ClothData {
            spec_text: p.spec,
            name: p.preset,
            program_version: p.program_version,
            curves,
            models,
            colors: keys.colors.clone(),
            shadows,
            between,
            hairs,
            albedo,
            far,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        let c = Check(name);
        self.curves.check(name)?;
        for (key, model) in MODELS.into_iter().zip(&self.models) {
            model.data().check(&format!("{name} ({key})"))?;
        }
        c.range_f32("colors", self.colors.concat().as_flattened(), 0.0, 1.0)?;
        super::ClothSpec::parse(&self.spec_text, &format!("{name} (its spec)"))?;
        for side in &self.between.sides {
            c.range_f32("between_caught", side.caught.as_flattened().as_flattened(), -1e3, 1e3)?;
            c.range_f32("between_leaves", side.leaves.as_flattened(), -1e3, 1e3)?;
            c.range_f32("between_shape", side.shape.as_flattened(), -1e6, 1e6)?;
            c.range_f32("between_parallel", side.parallel.as_flattened().as_flattened(), -1e3, 1e3)?;
            for cone in side.cones.as_flattened() {
                c.range_f32("between_cones (width)", &[cone.width], 1e-3, 1e3)?;
                c.range_f32("between_cones (energy)", &cone.energy, -1e3, 1e3)?;
                c.range_f32("between_cones (norm)", &cone.norm, 1e-6, 1e6)?;
            }
        }
        if let Some(hairs) = &self.hairs {
            c.range_f32("hair_area", hairs.area.as_flattened().as_flattened(), 0.0, 1e3)?;
            c.range_f32("hair_scatter", hairs.scatter.as_flattened(), 0.0, 1e3)?;
        }
        c.range("albedo", &self.albedo, 0.0, 1.0)?;
        if let Some(far) = &self.far {
            c.range_f32("far_f", far.f.as_flattened(), 0.0, 65504.0)?;
            c.range_f32("far_first", far.first.as_flattened().as_flattened(), 0.0, 10.0)?;
            c.range_f32("far_passing", &far.passing, 0.0, 1.0)?;
        }
        Ok(())
    }
}
