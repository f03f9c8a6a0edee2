//! Cloth files (`.pwc`): everything that shading needs, computed once.
//!
//! A file contains the cloth spec, the curves, the ply model of each kind of yarn, and the tables of shadows,
//! inter-yarn scattering, hairs, brightness and, optionally, the mean over the cell. The layout is described
//! in docs/reference/format/cloth.md.

use crate::cloth::color::color_of::{self, Brightness, ColorOf};
use crate::cloth::geometry::plies::Runs;
use crate::cloth::light::absorption::SIGMAS;
use crate::cloth::light::cones::{Cone, NORMS};
use crate::cloth::light::far_grid::{COLUMNS, FarData, NODES, OPENING_NUMBERS, PASSING, VIEWS};
use crate::cloth::light::hair_field::{HAIR_TEXELS, HairField};
use crate::cloth::light::hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES, HairLayer};
use crate::cloth::light::inter_yarn::{CLASSES, InterYarn, PAIRS, PLY_CLASSES, Side};
use crate::cloth::light::lit_places::{ANGLES, FUNCTIONS, LitPlaces, MAPS, RATIOS, Ratios};
use crate::cloth::light::terms::{FEW, TERMS};
use crate::cloth::query::ClothOptions;
use crate::cloth::shade::shadow_table::{self, LANES, ROWS};
use crate::cloth::shade::shadows::ClothShadows;
use crate::cloth::shade::splines::COUNT;
use crate::cloth::{ClothCurves, ClothYarn, PlyCurve, YarnLook};
use crate::io::{Axis, Check, Document, FileKind, Provenance, Reader, Writer, invalid};
use crate::spec::YarnSpec;
use crate::{PlyModel, Result};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Largest number of kinds of yarns.
const MAX_KINDS: usize = 2;
/// Largest number of cells along a side of the tile of hairs.
const MAX_CELLS: u32 = 1 << 20;
const MODELS: [&str; MAX_KINDS] = ["model_0", "model_1"];

/// The contents of a cloth file.
#[derive(Clone, Debug)]
pub struct ClothData {
    /// Text of the cloth spec.
    pub spec_text: String,
    /// Name of the cloth.
    pub name: String,
    /// Version of the program that wrote the file.
    pub program_version: String,
    /// The curves of its plies.
    pub curves: ClothCurves,
    /// Model of each kind of yarn, [in single lines](PlyModel::of_lines).
    pub models: Vec<Arc<PlyModel>>,
    /// Sense in which the colors of the yarns are meant.
    pub color_of: ColorOf,
    /// Look of each kind of yarn.
    pub looks: Vec<YarnLook>,
    /// Shadow table of the plies.
    #[doc(hidden)]
    pub shadows: ClothShadows,
    /// Tables of inter-yarn scattering.
    #[doc(hidden)]
    pub inter_yarn: InterYarn,
    /// Hair layers over both sides.
    #[doc(hidden)]
    pub hairs: Option<HairLayer>,
    /// Brightness as a function of an absorption that both kinds of yarns share.
    pub brightness: Brightness,
    /// Tables of the mean over the cell.
    #[doc(hidden)]
    pub far: Option<FarData>,
}

/// Keys of the JSON document in addition to the common ones.
#[derive(Serialize, Deserialize)]
pub struct ClothKeys {
    cell_um: [[f64; 2]; 2],
    yarns: Vec<ClothYarn>,
    curves: Vec<CurveKeys>,
    color_of: ColorOf,
    looks: Vec<YarnLook>,
}

/// A curve without its control points, which are rows of the tensor `control_um`.
#[derive(Serialize, Deserialize)]
struct CurveKeys {
    yarn: u32,
    radius_um: f64,
    shift: [i32; 2],
    points: usize,
    /// Number of places at which its shadows are tabulated.
    places: u32,
}

impl ClothData {
    /// Whether the file has the tables of the mean over the cell.
    pub fn has_far(&self) -> bool {
        self.far.is_some()
    }

    /// `[kind]`: names of the plies.
    pub fn ply_names(&self) -> Vec<String> {
        let name = |text: &str| YarnSpec::parse(text, "model").map_or_else(|_| "a ply".into(), |spec| spec.name);
        self.models.iter().map(|model| name(&model.data().spec_text)).collect()
    }

    /// Effects that the options request and the file lacks, one note per line: speckle of models without
    /// noise tables, and the mean over the cell.
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

/// Splits the numbers of a tensor into rows of F.
fn rows<const F: usize>(values: Vec<f32>) -> Vec<[f32; F]> {
    values.as_chunks::<F>().0.to_vec()
}

/// Shape of `hair_scatter`: kind, view, light, azimuth, absorption.
const HAIR_SHAPE: [usize; 5] = [2, HAIR_COSINES, 2 * HAIR_COSINES, HAIR_AZIMUTHS, SIGMAS];

/// Numbers of a cone: width, energy, norm.
pub(crate) const CONE_NUMBERS: usize = 1 + TERMS + NORMS;

/// Numbers of all cones of a side.
pub(crate) fn cone_numbers(side: &Side) -> Vec<f32> {
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
    type Keys = ClothKeys;

    fn names() -> Vec<&'static str> {
        let tables = [
            "control_um",
            "shadow_free",
            "shadow_table",
            "inter_yarn_caught",
            "inter_yarn_leaves",
            "inter_yarn_shape",
            "inter_yarn_parallel",
            "inter_yarn_cones",
            "inter_yarn_places",
            "inter_yarn_place_means",
            "hair_area",
            "hair_scatter",
            "hair_tile",
            "hair_cover",
            "albedo",
            "albedo_reflected",
            "albedo_folded",
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

    fn keys(&self, _: &str) -> Result<ClothKeys> {
        let curves = self.curves.curves.iter().zip(self.shadows.counts());
        let curves = curves.map(|(c, places)| CurveKeys {
            yarn: c.yarn,
            radius_um: c.radius_um,
            shift: c.shift,
            points: c.control_um.len(),
            places,
        });
        Ok(ClothKeys {
            cell_um: self.curves.cell_um,
            yarns: self.curves.yarns.clone(),
            curves: curves.collect(),
            color_of: self.color_of,
            looks: self.looks.clone(),
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
            // The model was checked, so it can be written.
            let bytes = model.data().to_bytes().unwrap_or_default();
            w.u8(name, &[bytes.len()], &bytes);
        }
        let free = self.shadows.free();
        let row = 2 * ROWS * shadow_table::COLUMNS * LANES;
        w.u8("shadow_free", &[free.len() / row, 2 * ROWS, shadow_table::COLUMNS, LANES], free);
        let tables = self.shadows.tables();
        if !tables.is_empty() {
            w.f32("shadow_table", &[tables.len()], tables.iter().map(|table| *table as f32));
        }
        let sides = &self.inter_yarn.sides;
        let of = |values: &dyn Fn(&Side) -> Vec<f32>| sides.iter().flat_map(values).collect::<Vec<f32>>();
        let caught = of(&|s| s.caught.as_flattened().as_flattened().to_vec());
        w.f32("inter_yarn_caught", &[2, CLASSES, 3, COUNT, SIGMAS], caught.into_iter());
        let leaves = of(&|s| s.leaves.as_flattened().to_vec());
        w.f32("inter_yarn_leaves", &[2, CLASSES, 2, 2, PAIRS, FEW], leaves.into_iter());
        w.f32("inter_yarn_shape", &[2, 2, PAIRS, TERMS], of(&|s| s.shape.as_flattened().to_vec()).into_iter());
        let parallel = of(&|s| s.parallel.as_flattened().as_flattened().to_vec());
        w.f32("inter_yarn_parallel", &[2, CLASSES, 2, 2, SIGMAS, FEW], parallel.into_iter());
        w.f32("inter_yarn_cones", &[2, 2, 2, CONE_NUMBERS], of(&|s| cone_numbers(s)).into_iter());
        let places = &self.inter_yarn.places;
        let map = places.map.as_flattened().as_flattened().as_flattened().as_flattened();
        w.f16("inter_yarn_places", &[places.map.len(), ANGLES, 2, MAPS, FUNCTIONS], map.iter().copied());
        let means = places.mean.as_flattened().as_flattened().iter().copied();
        w.f32("inter_yarn_place_means", &[2, COUNT, 2, MAPS, FUNCTIONS], means);
        if let Some(hairs) = &self.hairs {
            let area = hairs.area.as_flattened().as_flattened().iter().copied();
            w.f32("hair_area", &[2, 2, HAIR_COSINES], area);
            w.f32("hair_scatter", &HAIR_SHAPE, hairs.scatter.as_flattened().iter().copied());
            if let Some(field) = &hairs.field {
                let tile = field.cells.map(|cells| cells as f32).into_iter().chain(field.height_um).chain(field.free);
                w.f32("hair_tile", &[6], tile);
                w.u8("hair_cover", &[2, HAIR_TEXELS, HAIR_TEXELS / 2], &field.shares());
            }
        }
        w.f64("albedo", &[color_of::NODES], &self.brightness.even_sky);
        w.f64("albedo_reflected", &[color_of::NODES], &self.brightness.reflected);
        w.f64("albedo_folded", &[color_of::PILE_NODES], &self.brightness.folded);
        if let Some(far) = &self.far {
            let kinds = self.kinds();
            w.f16("far_f", &[kinds, VIEWS, COLUMNS, NODES, SIGMAS], far.f.as_flattened().iter().copied());
            let first = far.first.as_flattened().as_flattened().iter().copied();
            w.f32("far_first", &[kinds, VIEWS, PLY_CLASSES, SIGMAS], first);
            w.f32("far_passing", &PASSING, far.passing.iter().copied());
            let openings = FarData::opening_numbers(&far.openings).into_iter().map(|n| n as f32);
            w.f32("far_openings", &[VIEWS, OPENING_NUMBERS], openings);
        }
    }

    fn read(r: &Reader<'_>, p: Provenance, keys: &ClothKeys) -> Result<ClothData> {
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
            PlyCurve { yarn: c.yarn, radius_um: c.radius_um, shift: c.shift, control_um, alike: Vec::new() }
        });
        let curves = ClothCurves { cell_um: keys.cell_um, yarns: keys.yarns.clone(), curves: curves.collect() };
        let wanted = keys.curves.iter().fold(0usize, |sum, c| sum.saturating_add(c.points));
        if wanted != rows_of_points {
            let value = format!("{rows_of_points} rows");
            return Err(invalid(r.file(), "control_um", value, "expected as many as the curves have points"));
        }
        curves.check(r.file())?;
        let shape = r.shape("shadow_free", 4)?;
        let free = r.u8("shadow_free", &[shape[0], 2 * ROWS, shadow_table::COLUMNS, LANES])?;
        let counts: Vec<u32> = keys.curves.iter().map(|c| c.places).collect();
        let knots = curves.curves.iter().map(|c| c.control_um.len());
        let tables = match r.has("shadow_table") {
            true => {
                r.f32("shadow_table", &r.shape("shadow_table", 1)?)?.into_iter().map(|table| table as u32).collect()
            }
            false => Vec::new(),
        };
        let places = shape[0];
        let shadows = ClothShadows::of(&counts, knots, tables, free).ok_or_else(|| {
            invalid(r.file(), "shadow_free", format!("{} places", shape[0]), "expected those of the curves")
        })?;
        let caught = rows::<SIGMAS>(r.f32("inter_yarn_caught", &[2, CLASSES, 3, COUNT, SIGMAS])?);
        let leaves = rows::<FEW>(r.f32("inter_yarn_leaves", &[2, CLASSES, 2, 2, PAIRS, FEW])?);
        let shape = rows::<TERMS>(r.f32("inter_yarn_shape", &[2, 2, PAIRS, TERMS])?);
        let parallel = rows::<FEW>(r.f32("inter_yarn_parallel", &[2, CLASSES, 2, 2, SIGMAS, FEW])?);
        let cones = rows::<CONE_NUMBERS>(r.f32("inter_yarn_cones", &[2, 2, 2, CONE_NUMBERS])?);
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
        let map = rows::<FUNCTIONS>(r.f16("inter_yarn_places", &[places, ANGLES, 2, MAPS, FUNCTIONS])?);
        let ratios: &[Ratios] = map.as_chunks::<MAPS>().0.as_chunks::<2>().0;
        let mean = rows::<RATIOS>(r.f32("inter_yarn_place_means", &[2, COUNT, 2, MAPS, FUNCTIONS])?);
        let mean = mean.as_chunks::<COUNT>().0.to_vec();
        let places = LitPlaces { map: ratios.as_chunks::<ANGLES>().0.to_vec(), mean };
        let inter_yarn = InterYarn::new([side(0), side(1)], places);
        let hairs = if r.has("hair_area") {
            let numbers = rows::<HAIR_COSINES>(r.f32("hair_area", &[2, 2, HAIR_COSINES])?);
            let area = [0, 1].map(|side| [0, 1].map(|kind| numbers[2 * side + kind]));
            let tile = r.f32("hair_tile", &[6])?;
            let (cells, heights) =
                ([tile[0] as u32, tile[1] as u32].map(|cells| cells.clamp(1, MAX_CELLS)), [tile[2], tile[3]]);
            let cover = r.u8("hair_cover", &[2, HAIR_TEXELS, HAIR_TEXELS / 2])?;
            let field = HairField::new(&curves.lattice(r.file())?, cells, heights, [tile[4], tile[5]], &cover);
            let mut layer = HairLayer::new(area, rows::<SIGMAS>(r.f32("hair_scatter", &HAIR_SHAPE)?));
            layer.field = Some(field);
            Some(layer)
        } else {
            None
        };
        let mut brightness = Brightness::NONE;
        brightness.even_sky.copy_from_slice(&r.f64("albedo", &[color_of::NODES])?);
        brightness.reflected.copy_from_slice(&r.f64("albedo_reflected", &[color_of::NODES])?);
        brightness.folded.copy_from_slice(&r.f64("albedo_folded", &[color_of::PILE_NODES])?);
        let far = if r.has("far_f") {
            let kinds = models.len();
            let f = rows(r.f16("far_f", &[kinds, VIEWS, COLUMNS, NODES, SIGMAS])?);
            let first = rows::<SIGMAS>(r.f32("far_first", &[kinds, VIEWS, PLY_CLASSES, SIGMAS])?);
            let passing = r.f32("far_passing", &PASSING)?;
            let numbers: Vec<u32> =
                r.f32("far_openings", &[VIEWS, OPENING_NUMBERS])?.into_iter().map(|n| n as u32).collect();
            let openings = FarData::openings_of(&numbers).ok_or_else(|| {
                invalid(r.file(), "far_openings", "(other numbers)", "expected a count and numbers of spectra")
            })?;
            // The axes along which yarns run are derived from the curves when the model is built.
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
            color_of: keys.color_of,
            looks: keys.looks.clone(),
            shadows,
            inter_yarn,
            hairs,
            brightness,
            far,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        let c = Check(name);
        self.curves.check(name)?;
        for (key, model) in MODELS.into_iter().zip(&self.models) {
            model.data().check(&format!("{name} ({key})"))?;
        }
        self.looks.iter().try_for_each(|look| look.check(name))?;
        if self.looks.len() != self.models.len() {
            let value = format!("{} looks", self.looks.len());
            return Err(invalid(name, "looks", value, "expected one for each model"));
        }
        for side in &self.inter_yarn.sides {
            c.range_f32("inter_yarn_caught", side.caught.as_flattened().as_flattened(), -1e3, 1e3)?;
            c.range_f32("inter_yarn_leaves", side.leaves.as_flattened(), -1e3, 1e3)?;
            c.range_f32("inter_yarn_shape", side.shape.as_flattened(), -1e6, 1e6)?;
            c.range_f32("inter_yarn_parallel", side.parallel.as_flattened().as_flattened(), -1e3, 1e3)?;
            for cone in side.cones.as_flattened() {
                c.range_f32("inter_yarn_cones (width)", &[cone.width], 1e-3, 1e3)?;
                c.range_f32("inter_yarn_cones (energy)", &cone.energy, -1e3, 1e3)?;
                c.range_f32("inter_yarn_cones (norm)", &cone.norm, 1e-6, 1e6)?;
            }
        }
        let places = &self.inter_yarn.places;
        let map = places.map.as_flattened().as_flattened().as_flattened().as_flattened();
        c.range_f32("inter_yarn_places", map, -1e3, 1e3)?;
        c.range_f32("inter_yarn_place_means", places.mean.as_flattened().as_flattened(), -1e3, 1e3)?;
        if let Some(hairs) = &self.hairs {
            c.range_f32("hair_area", hairs.area.as_flattened().as_flattened(), 0.0, 1e3)?;
            c.range_f32("hair_scatter", hairs.scatter.as_flattened(), 0.0, 1e3)?;
            if let Some(field) = &hairs.field {
                c.range_f32("hair_tile", &field.height_um, -1e5, 1e5)?;
                c.range_f32("hair_tile (free)", &field.free, 0.0, 1.0)?;
            }
        }
        c.range("albedo", &self.brightness.even_sky, 0.0, 1.0)?;
        c.range("albedo_reflected", &self.brightness.reflected, 0.0, 1.0)?;
        c.range("albedo_folded", &self.brightness.folded, 0.0, 1.0)?;
        if let Some(far) = &self.far {
            c.range_f32("far_f", far.f.as_flattened(), 0.0, 65504.0)?;
            c.range_f32("far_first", far.first.as_flattened().as_flattened(), 0.0, 10.0)?;
            c.range_f32("far_passing", &far.passing, 0.0, 1.0)?;
        }
        Ok(())
    }
}
