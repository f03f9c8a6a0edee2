//! Bytes taken as a file of each kind. An error is one line; what loads keeps its promises. A broken promise
//! is a panic.

use crate::Rng;
use crate::seeds::CLOTH;
use plywave::Document;
use plywave::cloth::{ClothData, ClothLines, ClothModel, ClothOptions, LineHits};
use plywave::ply::{FamilyParams, PlyFamily, PlyPlace};
use plywave::spec::YarnSpec;
use plywave::{Bsdf, ClothQuery, PlyModel, PlyQuery};
use plywave_fiber::FiberQuery;
use plywave_fiber::{FiberModel, FiberTable, FilamentSpec, TabulatedFiber};
use plywave_pipeline::AnyJob;
use plywave_render::{Basis, Environment, Film, Light, Mesh, Scene, StrandFile, StrandShape, StrandTree, Strands};
use plywave_runs::{PartFile, Parts};
use plywave_sim::cloth::{Effort, make_cloth};
use plywave_sim::twin::TwinCurves;
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_tables::twin::ClothTwin;
use plywave_textile::{ClothSpec, Wif};
use plywave_wave::SingleFiber;
use std::fmt::Display;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest albedo of one model: energies of loaded models add up to at most this
/// (docs/reference/format/models.md), and rounding.
const MAX: f32 = 1.0501;

/// An error is one line that is not endless.
fn one_line(error: &impl Display) {
    let text = error.to_string();
    assert!(
        !text.is_empty() && text.lines().count() == 1 && text.len() < 2000,
        "an error of {} lines: {text:.2000}",
        text.lines().count()
    );
}

/// Files and jobs that loaded so far: a harness whose inputs are all refused at the door would test little.
pub static LOADED: AtomicU64 = AtomicU64::new(0);

fn loaded<T, E: Display>(result: Result<T, E>) -> Option<T> {
    LOADED.fetch_add(u64::from(result.is_ok()), Ordering::Relaxed);
    result.inspect_err(one_line).ok()
}

fn good(what: &str, values: &[f32]) {
    assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: {values:?}");
}

/// A number of any size, most of them sensible.
fn any(rng: &mut Rng, scale: f32) -> f32 {
    const ODD: [f32; 9] = [0.0, -0.0, 1e-30, 1.9e19, -1.9e19, 1e30, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    if rng.below(40) == 0 { ODD[rng.below(ODD.len())] } else { scale * (2.0 * rng.unit() - 1.0) }
}

fn direction(rng: &mut Rng) -> [f32; 3] {
    let (z, phi) = (2.0 * rng.unit() - 1.0, std::f32::consts::TAU * rng.unit());
    let r = (1.0 - z * z).max(0.0).sqrt();
    let mut w = [r * phi.cos(), r * phi.sin(), z];
    if rng.below(12) == 0 {
        w[rng.below(3)] = any(rng, 1.0);
    }
    w
}

/// Everything a scattering function answers, in some directions.
fn ask<const N: usize>(what: &str, at: &impl Bsdf<N>, most: f32, rng: &mut Rng) {
    let albedo = at.albedo();
    good(what, &albedo);
    assert!(albedo.iter().all(|a| *a <= most), "{what}: albedo {albedo:?}");
    good(what, &at.straight());
    let outcomes = at.outcomes();
    good(what, &[outcomes.scattered, outcomes.straight, outcomes.absorbed]);
    for _ in 0..3 {
        let w = direction(rng);
        let ((f, pdf), g, p) = (at.eval_pdf(w), at.eval(w), at.pdf(w));
        for values in [&f[..], &g, &[pdf, p]] {
            assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: {values:?} in {w:?}");
        }
        let u = [rng.unit(), rng.unit(), rng.unit()].map(|u| if rng.below(30) == 0 { any(rng, 1.0) } else { u });
        if let Some(s) = at.sample(u).direction() {
            assert!(s.w.iter().all(|v| v.is_finite()), "{what}: sample {u:?} of {s:?}");
            good(what, &s.weight);
            good(what, &[s.pdf]);
        }
    }
}

fn seeded(bytes: &[u8]) -> Rng {
    let mut state = bytes.len() as u64;
    for chunk in bytes.chunks(bytes.len() / 64 + 1) {
        state = state.rotate_left(7) ^ u64::from(chunk[0]);
    }
    Rng::new(state)
}

/// A ply model: alone, over a layer, with speckle.
pub fn model(bytes: &[u8]) {
    let Some(ply) = loaded(PlyModel::from_bytes(bytes, "m")) else { return };
    let mut rng = seeded(bytes);
    let error = ply.reference_error();
    assert!(!error.is_nan() || !ply.reference_values().is_empty());
    let (last_h, last_t) = (ply.data().h_um.last().map_or(0.0, |h| *h as f32), 1.6);
    for _ in 0..4 {
        let (theta_i, h_um) = (any(&mut rng, last_t), any(&mut rng, 1.1 * last_h));
        let sigma = [0.0, any(&mut rng, 0.1)];
        let base =
            PlyQuery { cached: rng.below(2) == 0, ..PlyQuery::new(theta_i, h_um, sigma, [0.55, any(&mut rng, 1.0)]) };
        let at = ply.at(&base);
        ask("ply", &at, MAX, &mut rng);
        if let Some(below) = ply.layer(theta_i, sigma) {
            ask("two layers", &ply.at(&PlyQuery { below: Some(below), ..base }), MAX, &mut rng);
        }
        let place = PlyPlace {
            ply: rng.bits() as u32,
            azimuth: any(&mut rng, 10.0),
            along_um: any(&mut rng, 1e4),
            footprint_um: any(&mut rng, 100.0),
        };
        ask("ply at a place", &ply.at(&PlyQuery { place: Some(place), ..base }), MAX, &mut rng);
    }
}

/// A family of plies: whole models, single incidences, slopes.
pub fn family(bytes: &[u8]) {
    let Some(family) = loaded(PlyFamily::from_bytes(bytes, "f")) else { return };
    let mut rng = seeded(bytes);
    let own = family.params();
    for _ in 0..3 {
        let params = FamilyParams {
            fiber_pitch_um: any(&mut rng, 4000.0).into(),
            alpha_fiber: any(&mut rng, 0.5).into(),
            eta: any(&mut rng, 2.0).into(),
        };
        let sigma = [0.0, any(&mut rng, 0.1)];
        let query = PlyQuery::new(any(&mut rng, 1.6), any(&mut rng, 60.0), sigma, [0.55, any(&mut rng, 1.0)]);
        ask("a family's ply", &family.on(&params, &query), MAX, &mut rng);
        let slope = family.eval_gradient(&params, &query, direction(&mut rng));
        let numbers = slope.by_params.iter().flatten().chain(&slope.value).chain(&slope.by_sigma);
        assert!(numbers.clone().all(|v| v.is_finite()), "{slope:?}");
        let params = if rng.below(2) == 0 { own } else { params };
        if let Some(model) = loaded(family.at(&params)) {
            ask("a family's model", &model.at(&query), MAX, &mut rng);
        }
    }
}

/// A table.
pub fn table(bytes: &[u8]) {
    if let Some(table) = loaded(Table::from_bytes(bytes, "t")) {
        assert_eq!(
            Table::from_bytes(&table.to_bytes().expect("what loads can be written"), "t").expect("and read"),
            table
        );
    }
}

/// A fiber table.
pub fn fiber(bytes: &[u8]) {
    let Some(table) = loaded(FiberTable::from_bytes(bytes, "f")) else { return };
    let mut rng = seeded(bytes);
    let fiber = TabulatedFiber::from_table(table).expect("a checked table");
    let fiber = if rng.below(4) == 0 { fiber.with_beta_m(any(&mut rng, 2.0)) } else { fiber };
    for _ in 0..4 {
        let at = fiber.at(&FiberQuery::new(direction(&mut rng), [0.5, any(&mut rng, 1.0)]));
        good("width", &at.width_um());
        ask("fiber", &at, MAX, &mut rng);
    }
}

/// Speckle patterns.
pub fn speckle(bytes: &[u8]) {
    if let Some(patterns) = loaded(SpecklePatterns::from_bytes(bytes, "s")) {
        assert!(patterns.patterns.iter().all(|v| v.is_finite() && *v >= 0.0));
    }
}

/// The text of a yarn spec.
pub fn yarn(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Some(spec) = loaded(YarnSpec::parse(text, "y.toml")) {
        let beam = spec.beam.beam();
        assert!(beam.w0_um > 0.0 && beam.w0_um.is_finite() && beam.d_cut_um.is_finite());
        spec.check("y.toml").expect("a parsed spec passes its own rules");
    }
}

/// Queries of a cloth of which none has more light than `most`.
fn ask_cloth(cloth: &ClothModel, most: f32, rng: &mut Rng) {
    for _ in 0..40 {
        let position = [any(rng, 5e3), any(rng, 5e3)];
        let footprint_um = if rng.below(2) == 0 { 0.0 } else { any(rng, 2e3) };
        let query = ClothQuery { turn_rad: any(rng, 3.0), footprint_um, ..ClothQuery::rgb(position, direction(rng)) };
        ask("cloth", &cloth.at(&query), most, rng);
    }
}

/// The text of a cloth spec, of the curves of a small cloth.
pub fn cloth_spec(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Some(spec) = loaded(ClothSpec::parse(text, "c.toml")) else { return };
    for yarn in spec.yarns() {
        assert!(yarn.strand_radius_um() > 0.0 && yarn.radius_um().is_finite());
        assert_eq!(yarn.section().len(), yarn.strands());
    }
    let mut rng = seeded(bytes);
    // The spectra of its gaps take 20 ms.
    if rng.below(4) > 0 {
        return;
    }
    let mut data = CLOTH.clone();
    data.spec_text = text.into();
    data.color_of = spec.color_of;
    for (own, look) in data.looks.iter_mut().zip(spec.looks()) {
        *own = look;
    }
    let options = ClothOptions { far: true, ..ClothOptions::default() };
    if let Some(cloth) = loaded(ClothModel::from_data(data, &options)) {
        // In a gap several plies and the aperture, each within its tolerance.
        ask_cloth(&cloth, 1.25, &mut rng);
    }
}

/// A cloth file.
pub fn cloth(bytes: &[u8]) {
    let Some(data) = loaded(ClothData::from_bytes(bytes, "c.pwc")) else { return };
    let mut rng = seeded(bytes);
    if rng.below(4) > 0 {
        return;
    }
    let options = ClothOptions { far: true, noise: rng.below(2) == 0, ..ClothOptions::default() };
    if let Some(cloth) = loaded(ClothModel::from_data(data, &options)) {
        // Nothing binds the energies between yarns of a file.
        ask_cloth(&cloth, f32::INFINITY, &mut rng);
    }
}

/// Curves of a cloth in each of their formats, of one kind of yarn and of two, and lines through them.
pub fn curves(bytes: &[u8]) {
    let mut rng = seeded(bytes);
    let yarn = |name: &str| format!("[{name}]\nfiber = \"polyester\"\ncount = \"2.833 tex\"\npacking = 0.6\n");
    let yarns = [yarn("yarn"), yarn("warp") + &yarn("weft")];
    for (ending, yarns) in
        ["toml", "bcc", "tg3"].into_iter().flat_map(|ending| yarns.iter().map(move |of| (ending, of)))
    {
        let text = format!(
            "name = \"x\"\n[curves]\nfile = \"x.{ending}\"\n{}{yarns}",
            if ending == "bcc" { "cell_um = [[250.0, 250.0], [0.0, 500.0]]\n" } else { "" }
        );
        let spec = ClothSpec::parse(&text, "c.toml").expect("a good spec");
        let made = loaded(make_cloth(&spec, "c.toml", &mut |_| Ok(bytes.to_vec()), Effort::Full, &|_| true));
        let Some(made) = made else { continue };
        assert!(made.measures.thickness_um > 0.0 && (0.0..=1.0).contains(&made.measures.openness));
        let lines = ClothLines::new(&made.curves).expect("measured curves");
        let mut hits = LineHits::default();
        for _ in 0..20 {
            let from = [any(&mut rng, 1e3), any(&mut rng, 1e3), any(&mut rng, 1e3)];
            lines.hits(from, direction(&mut rng), &mut hits);
            assert!(hits.as_slice().windows(2).all(|pair| pair[0].enter_um <= pair[1].enter_um));
        }
    }
}

/// A draft in WIF.
pub fn wif(bytes: &[u8]) {
    loaded(Wif::parse(bytes, "w.wif"));
}

/// Calls `with` on a file of these bytes.
fn on_disk<T>(bytes: &[u8], with: impl FnOnce(&Path) -> T) -> T {
    thread_local!(static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder"));
    FOLDER.with(|folder| {
        let path = folder.path().join("input");
        std::fs::write(&path, bytes).expect("it can be written");
        with(&path)
    })
}

/// A mesh in OBJ, and rays at it.
pub fn obj(bytes: &[u8]) {
    let Some((mesh, _)) = loaded(on_disk(bytes, |path| Mesh::obj(path, 1000.0, 100.0))) else { return };
    let lights: Vec<Light> = Vec::new();
    let scene = Scene::new(mesh, lights, Environment::constant(1.0));
    let mut rng = seeded(bytes);
    for _ in 0..8 {
        let origin = direction(&mut rng).map(|v| if v.is_finite() { 200.0 * v } else { 0.0 });
        if let Some(point) = scene.meet(origin.into(), origin.map(|v| -v / 200.0).into()) {
            let _ = point;
        }
    }
}

/// A sky in OpenEXR.
pub fn sky(bytes: &[u8]) {
    loaded(on_disk(bytes, |path| Environment::load(path, None)));
}

/// A scene of the wave simulator.
pub fn scene(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    loaded(plywave_wave::Scene::parse(text));
}

/// A part of a run: read, and merged where it is whole.
pub fn part(bytes: &[u8]) {
    let Some(part) = loaded(PartFile::from_bytes(bytes.to_vec(), "p.pwp")) else { return };
    assert!(part.entries().all(|(first, count)| count > 0 && first + count <= part.shards()));
    if part.description().kind == "scatter" {
        on_disk(bytes, |path| {
            if let Some(parts) = loaded(Parts::open(&[path.to_path_buf()])) {
                loaded(plywave_pipeline::merge_parts(&parts).map(|_| ()));
            }
        });
    }
}

/// Sums of a render of 4 x 3 pixels.
pub fn sums(bytes: &[u8]) {
    let of = [("spec".to_string(), "digest".to_string())];
    if let Some(film) = loaded(on_disk(bytes, |path| Film::resume(path, &of, 4, 3))) {
        for (x, y) in (0..4).flat_map(|x| (0..3).map(move |y| (x, y))) {
            let values = [film.xyz(plywave_render::FilmView::Light, x, y), film.normal(x, y)];
            assert!(values.iter().flatten().chain([&film.depth(x, y)]).all(|v| v.is_finite()), "{values:?}");
        }
    }
}

/// The text of an analytic fiber.
pub fn filament(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Some(spec) = loaded(FilamentSpec::parse(text, "f.toml")) else { return };
    // Not bound by energy: Kajiya and Kay's sum of a diffuse and a shiny part; Marschner's lobes over cos^2
    // of the half difference, which at grazing incidence grow without limit as they narrow (Marschner 2003
    // Eq. 8), unless they are normalized.
    let most = match &spec.model {
        FiberModel::KajiyaKay(_) => f32::INFINITY,
        FiberModel::RoughDielectric(fiber) if !fiber.parameters().normalize => f32::INFINITY,
        _ => MAX,
    };
    let mut rng = seeded(bytes);
    for _ in 0..4 {
        let h_rel = (rng.below(2) == 0).then(|| any(&mut rng, 1.0));
        let query = FiberQuery {
            h_rel,
            sigma_per_um: spec.sigma_per_um,
            ..FiberQuery::new(direction(&mut rng), spec.lambda_um)
        };
        let at = spec.model.at(&query);
        good("width", &at.width_um());
        ask("analytic fiber", &at, most, &mut rng);
    }
}

/// A file of strands, and rays at what loads.
pub fn strands(bytes: &[u8]) {
    let mut rng = seeded(bytes);
    let basis = if rng.below(2) == 0 { Basis::Linear } else { Basis::BSpline };
    let radius_mm = (rng.below(4) == 0).then_some(0.02);
    let how = StrandFile { basis, mm_per_unit: 1.0, radius_mm, whole: rng.below(2) == 0 };
    let Some((strands, _)) = loaded(Strands::from_bytes(bytes, "s", &how)) else { return };
    assert!(strands.points().iter().flatten().all(|v| v.is_finite()));
    let shape = if rng.below(2) == 0 { StrandShape::Tube } else { StrandShape::Band };
    let tree = StrandTree::new(strands, shape);
    let [low, high] = tree.bounds();
    let (middle, size) = ((0.5 * (low + high)).as_dvec3(), (high - low).length().max(1e-3));
    for _ in 0..8 {
        let w = direction(&mut rng).map(|v| if v.is_finite() { f64::from(v.clamp(-1.0, 1.0)) } else { 0.0 });
        let w = glam::DVec3::from(w).normalize_or(glam::DVec3::X);
        if let Some(hit) = tree.first(middle - f64::from(size) * w, w, 0.0, f64::INFINITY, &[]) {
            let numbers = [hit.t, hit.radius_mm, hit.h_rel, hit.u, hit.position.length(), hit.center.length()];
            assert!(numbers.iter().all(|v| v.is_finite()), "{hit:?}");
            assert!(hit.radius_mm > 0.0 && hit.h_rel.abs() <= 1.0 + 1e-6, "{hit:?}");
            assert!((hit.tangent.length() - 1.0).abs() < 1e-6, "{hit:?}");
        }
    }
}

/// The twin of a cloth.
pub fn twin(bytes: &[u8]) {
    if let Some(twin) = loaded(ClothTwin::from_bytes(bytes, "x")) {
        let again = ClothTwin::from_bytes(&twin.to_bytes().expect("what loads can be written"), "x");
        assert_eq!(again.expect("and read"), twin);
    }
}

/// The text of a twin's cloth, as a twin has it.
pub fn twin_cloth(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Some(cloth) = TwinCurves::parse(text).and_then(loaded) {
        let again = TwinCurves::parse(cloth.text()).expect("its own text is one");
        again.expect("and good");
    }
}

/// The fiber of a table by waves: a yarn spec or a scene of one fiber.
pub fn single(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    loaded(SingleFiber::parse(text, "y.toml", 0.0));
}

/// The description of a job, as a farm's worker gets it.
pub fn job(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let extent = seeded(bytes).bits() % 9;
    if let Some(job) = loaded(AnyJob::of_text(text, extent)) {
        assert!(job.plan().shards > 0);
    }
}
