//! Good files of each kind: those of the repository, and small ones made here.

use plywave::Document;
use plywave::PlyModel;
use plywave::cloth::{ClothCurves, ClothData};
use plywave::ply::{FamilyAxis, FamilyData, FamilyParam, PlyData};
use plywave::spec::YarnSpec;
use plywave::speckle::NoiseSpectrum;
use plywave_fiber::{FiberSource, FiberTable, OutlineSymmetry};
use plywave_runs::{self as runs, Run, Shards};
use plywave_sim::cloth::{CurveFormat, Effort, make_cloth, precompute, write_curves};
use plywave_sim::twin::{TwinCurves, TwinJob, TwinOptions};
use plywave_sim::{SimOptions, SimulateJob};
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::twin::{CLASSES, ClothTwin, SphereBins};
use plywave_textile::ClothSpec;
use plywave_wave::{ScatterJob, Scene, SpeckleJob, SpeckleOptions};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn file(name: &str) -> Vec<u8> {
    let path = root().join(name);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The small model of the tests, with layer factors made up for it, and one that ships.
pub fn models() -> Vec<Vec<u8>> {
    let small = PlyData::load(root().join("tests/data/small.pwm")).expect("the small model");
    let mut layered = small.clone();
    let (m, h, j) = (small.theta_i.len(), small.h_um.len(), small.path_um.len());
    let mut diffuse = vec![0.0; 2 * (1 + j)];
    (diffuse[0], diffuse[1], diffuse[1 + j]) = (0.3, 0.2, 0.5);
    layered.layers =
        Some(plywave::ply::LayerFactors { forward: vec![0.004; (2 * m - 1) * (2 * h - 1) * (1 + j)], diffuse });
    let mut noised = small.clone();
    noised.noise = Some(noise());
    vec![
        small.to_bytes().expect("it loads"),
        noised.to_bytes().expect("good noise"),
        layered.to_bytes().expect("it is within the energies"),
        file("fabrics/models/silk.pwm"),
    ]
}

/// A family of two nodes of the small model.
pub fn families() -> Vec<Vec<u8>> {
    let small = PlyData::load(root().join("tests/data/small.pwm")).expect("the small model");
    let node = PlyData { noise: None, ..small.clone() };
    let data = FamilyData {
        spec_text: format!("{}\n[family]\nalpha_fiber = [0.1, 0.4]\n", small.spec_text),
        program_version: small.program_version.clone(),
        preset: small.preset.clone(),
        seed: small.seed,
        axes: vec![FamilyAxis { param: FamilyParam::Alpha, values: vec![0.1, 0.4] }],
        nodes: vec![node.clone(), node],
    };
    vec![data.to_bytes().expect("two good nodes")]
}

/// Noise of few positions.
fn noise() -> NoiseSpectrum {
    NoiseSpectrum {
        seed: 1,
        spectrum: [[0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.25, 0.25, 0.0, 0.0, 0.0, 0.0]]
            .concat(),
        share: [0.3, 1.0],
        w0_um: 10.0,
        step_um: [0.3, 0.5],
        lambda_um: 0.4,
        fade: [[1.0, -0.2]; 2],
        contrast: [1.0; 2],
    }
}

/// The small table of the tests.
pub fn tables() -> Vec<Vec<u8>> {
    vec![file("tests/data/small.pwt")]
}

/// A round fiber and one of two folds.
pub fn fibers() -> Vec<Vec<u8>> {
    let fiber = |symmetry: OutlineSymmetry, p: usize| {
        let slices = 2 * 4 * p;
        let table = FiberTable {
            spec_text: "made up".into(),
            program_version: "0".into(),
            preset: "test".into(),
            seed: 1,
            source: FiberSource::Wave,
            symmetry,
            beta_m: 0.15,
            lambda_um: vec![0.5, 0.6],
            theta_i: FiberTable::theta_nodes(4),
            phi_i: symmetry.phi_i(p),
            width_um: vec![2.0; p],
            c_x_um: vec![4.0; slices],
            c_abs_um: vec![0.0; slices],
            azimuthal: vec![1.0 / std::f32::consts::TAU; slices * 32],
        };
        table.to_bytes().expect("a good table")
    };
    vec![fiber(OutlineSymmetry::CIRCLE, 1), fiber(OutlineSymmetry { folds: 2, mirror_rad: Some(0.0) }, 3)]
}

/// Patterns of two instances.
pub fn speckles() -> Vec<Vec<u8>> {
    let (instances, azimuths) = (2, 720);
    let patterns = SpecklePatterns {
        spec_text: "made up".into(),
        program_version: "0".into(),
        seed: 1,
        theta_i: 0.0,
        w0_um: 30.0,
        kappa: vec![0.0],
        lambda_um: vec![0.6],
        instances,
        azimuths,
        patterns: vec![0.5; 2 * instances * azimuths],
        c_sca_um: vec![std::f64::consts::PI; 2 * instances],
        c_abs_um: vec![0.0; 2 * instances],
    };
    on_disk(|path| patterns.save(path).expect("good patterns"))
}

/// Specs of a folder, in the order of their names.
fn specs(folder: &str) -> Vec<Vec<u8>> {
    let entries = std::fs::read_dir(root().join(folder)).expect("a folder of specs");
    let mut paths: Vec<PathBuf> =
        entries.map(|e| e.expect("an entry").path()).filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
    paths.sort();
    paths.iter().map(|p| std::fs::read(p).expect("a spec")).collect()
}

/// The yarns that ship.
pub fn yarns() -> Vec<Vec<u8>> {
    specs("fabrics").into_iter().filter(|text| text.windows(7).any(|w| w == b"\n[fiber")).collect()
}

/// An open plain weave of yarns of one ply, as wide as those of the small model, striped.
const PLAIN: &str = "name = \"plain\"\ncolor_of = \"even_sky\"\n[weave]\nkind = \"plain\"\nends_per_cm = 40\n\
    picks_per_cm = 40\n[warp]\nfiber = \"polyester\"\ncount = \"2.833 tex\"\npacking = 0.6\nslit_um = 2.0\n\
    slit_share = 0.2\nstripes = [{ count = 2, color = [0.7, 0.1, 0.1] }, { count = 1, color = [0.1, 0.2, 0.6] }]\n\
    [weft]\nas = \"warp\"\ncolor = [0.5, 0.5, 0.4]\n";

/// Curves of [`PLAIN`].
fn plain() -> ClothCurves {
    let spec = ClothSpec::parse(PLAIN, "c.toml").expect("a good spec");
    let no_file = |name: &str| -> plywave::Result<Vec<u8>> { panic!("{name} is not to be read") };
    make_cloth(&spec, "c.toml", &mut |name| no_file(name), Effort::Full, &|_| true).expect("a cloth").curves
}

/// A small cloth, with the mean over the cell.
pub static CLOTH: LazyLock<ClothData> = LazyLock::new(|| {
    let spec = ClothSpec::parse(PLAIN, "c.toml").expect("a good spec");
    let model = Arc::new(PlyModel::load(root().join("tests/data/small.pwm")).expect("the small model"));
    precompute(&spec, PLAIN, &plain(), &[model.clone(), model], Effort::Full, &|_| true).expect("a cloth")
});

/// A file of a small cloth.
pub fn cloths() -> Vec<Vec<u8>> {
    vec![CLOTH.to_bytes().expect("a good cloth")]
}

/// A small cloth, and those that ship.
pub fn cloth_specs() -> Vec<Vec<u8>> {
    [vec![PLAIN.into()], specs("fabrics/cloths")].concat()
}

/// The cloth of a twin.
fn twin_curves() -> TwinCurves {
    let yarn = String::from_utf8(file("tests/data/small.toml")).expect("a text");
    TwinCurves::new("plain", plain(), vec![yarn.clone(), yarn]).expect("a cloth of explicit fibers")
}

/// Texts of the cloths of twins.
pub fn twin_cloths() -> Vec<Vec<u8>> {
    vec![twin_curves().text().into()]
}

/// A small draft.
pub fn wifs() -> Vec<Vec<u8>> {
    let text = "[WIF]\nVersion=1.1\n[CONTENTS]\nWEAVING=true\nWARP=true\nWEFT=true\nTHREADING=true\nTIEUP=true\nTREADLING=true\nCOLOR TABLE=true\n[COLOR PALETTE]\nRange=0,999\n[COLOR TABLE]\n1=999,0,0\n2=0,0,999\n[WEAVING]\nShafts=4\nTreadles=4\nRising Shed=true\n[WARP]\nThreads=4\nColor=1\n[WEFT]\nThreads=4\nColor=2\n[WARP COLORS]\n1=1\n2=2\n[THREADING]\n1=1\n2=2\n3=3\n4=4\n[TIEUP]\n1=1,2\n2=2,3\n3=3,4\n4=1,4\n[TREADLING]\n1=1\n2=2\n3=3\n4=4\n";
    vec![text.into()]
}

/// A folded sheet with normals, and one of polygons.
pub fn meshes() -> Vec<Vec<u8>> {
    let fold = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nvn 0 1 0\nf 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/4/1\nf 4/1/2 3/2/2 5/3/2\n";
    let polygon = "o sheet\nv -1 -1 0\nv 1 -1 0.5\nv 2 0 0\nv 1 1 0.5\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1.5 0.5\nvt 1 1\nvt 0 1\nusemtl none\ns off\nf 1/1 2/2 3/3 4/4 5/5\nf -5/1 -4/2 -3/3\n";
    vec![fold.into(), polygon.into()]
}

/// Calls `write` with a name and gives what it wrote.
fn on_disk(write: impl FnOnce(&Path)) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("seed");
    write(&path);
    vec![std::fs::read(path).expect("it was written")]
}

/// A sky of 8 x 4 texels.
pub fn skies() -> Vec<Vec<u8>> {
    on_disk(|path| {
        exr::prelude::write_rgb_file(path, 8, 4, |x, y| (x as f32 / 8.0, y as f32 / 4.0, 1.0f32)).expect("an EXR");
    })
}

const SCENE: &str = "lambda_um = [0.7, 0.5]\ntheta_i_deg = [0, 20]\nphi_i_deg = [0]\nn_phi_out = 12\n[[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.5\n";
const HOLLOW: &str = "lambda_um = [0.55]\ntheta_i_deg = [10]\nphi_i_deg = [0, 90]\nn_phi_out = 36\n[[fiber]]\nshape = \"circle\"\nradius_um = 2.0\neta = 1.5\nkappa = 0.001\n[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.5\n[[fiber]]\nshape = \"circle\"\nradius_um = 1.0\ncenter_um = [4.0, 0.5]\neta = 1.4\n";

/// A fiber alone; a hollow one beside another.
pub fn scenes() -> Vec<Vec<u8>> {
    vec![SCENE.into(), HOLLOW.into()]
}

/// All shards of a small scene in one part.
pub fn parts() -> Vec<Vec<u8>> {
    let scene = Scene::parse(SCENE).expect("a good scene");
    on_disk(|path| {
        runs::run_part(&ScatterJob::new(&scene, SCENE), (1, 1), path, Run::plain()).expect("a small scene");
    })
}

/// Sums of a render of 4 x 3 pixels with one sample each.
pub fn sums() -> Vec<Vec<u8>> {
    let (mut header, mut data) = (
        serde_json::json!({ "__metadata__": { "of spec": "digest", "samples": "1", "cut": "0 0 0 0 0" } }),
        Vec::new(),
    );
    for (name, channels) in [("albedo", 3), ("depth", 1), ("deviation", 3), ("hits", 1), ("light", 3), ("normal", 3)] {
        let from = data.len();
        data.extend((0..12 * channels).flat_map(|_| 0.5f32.to_le_bytes()));
        header[name] =
            serde_json::json!({ "dtype": "F32", "shape": [3, 4, channels], "data_offsets": [from, data.len()] });
    }
    let text = header.to_string();
    vec![[&(text.len() as u64).to_le_bytes(), text.as_bytes(), &data].concat()]
}

/// One analytic fiber of each kind.
pub fn filaments() -> Vec<Vec<u8>> {
    let kinds = [
        "kind = \"dielectric\"\neta = 1.5\nradius_um = 20\nbeta_m = [0.1, 0.1, 0.1]\nshift = [0.0, 0.02, -0.05]\nbeta_n = 0.1\norders = 5",
        "kind = \"rough_dielectric\"\neta = 1.55\nradius_um = 40\neccentricity = 0.9\nshift = [-0.1, 0.05, 0.15]\nwidth_theta = [0.1, 0.05, 0.2]\nwidth_phi = [0.1, 0.1, 0.2]\nk_d = 0.005",
        "kind = \"opaque\"\nmetal = \"gold\"\nradius_um = 10\nbeta_m = 0.1\nbeta_n = 0.1",
        "kind = \"opaque\"\neta = 1.5\nkappa = 2.0\ndiffuse = 0.3\nradius_um = 10",
        "kind = \"kajiya_kay\"\nradius_um = 10\nphong = 0.1\nexponent = 50\ndiffuse = 0.03",
        "kind = \"khungurn\"\nradius_um = 10\nc_r = 0.05\nc_tt = [0.9, 0.5, 0.2]\nbeta_r = 0.1\nbeta_tt = 0.2\ngamma_tt = 0.4",
    ];
    let text = |kind| {
        format!(
            "name = \"x\"\nlambda_um = [0.61, 0.55, 0.465]\nsigma_per_um = [0.002, 0.005, 0.012]\n[filament]\n{kind}\n"
        )
    };
    kinds.into_iter().map(|kind| text(kind).into()).collect()
}

/// The same two strands in the three formats, and pbrt's with transforms and objects.
pub fn strands() -> Vec<Vec<u8>> {
    let points: [[f32; 3]; 10] = std::array::from_fn(|i| {
        let t = (i % 5) as f32;
        [t, 0.3 * t * t, if i < 5 { 0.0 } else { 1.0 + 0.2 * t }]
    });
    // Flags: segments, points, thickness.
    let mut hair = b"HAIR".to_vec();
    for word in [2u32, 10, 0b111, 4] {
        hair.extend(word.to_le_bytes());
    }
    for real in [0.1f32, 0.0, 0.5, 0.5, 0.5] {
        hair.extend(real.to_le_bytes());
    }
    hair.resize(128, b' ');
    hair.extend([4u16, 4].iter().flat_map(|n| n.to_le_bytes()));
    hair.extend(points.iter().flatten().flat_map(|v| v.to_le_bytes()));
    hair.extend([0.1f32; 10].iter().flat_map(|v| v.to_le_bytes()));
    let line = |[x, y, z]: &[f32; 3]| format!("{x} {y} {z} 0.05\n");
    let curve = |part: &[[f32; 3]]| part.iter().map(line).collect::<String>();
    let mitsuba = format!("{}\n{}", curve(&points[..5]), curve(&points[5..]));
    let pbrt = "AttributeBegin\nMaterial \"hair\" \"float beta_m\" [0.3]\nShape \"curve\" \"string type\" \"flat\" \"string basis\" \"bezier\" \"integer degree\" 3\n  \"point3 P\" [0 0 0  1 0.5 0  2 0 0.5  3 1 0] \"float width0\" 0.1 \"float width1\" 0.05\nShape \"curve\" \"point P\" [ 0 0 1 1 0 1 2 1 1 3 1 2 4 0 2 ] \"string basis\" [ \"bspline\" ] \"integer degree\" [ 3 ] \"float width\" [ 0.1 ]\nAttributeEnd\n";
    let placed = "LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\" \"float fov\" 30\nWorldBegin\nAttribute \"shape\" \"float width\" 0.1\nObjectBegin \"o\" Rotate 30 0 0 1 Shape \"curve\" \"integer degree\" 2 \"point3 P\" [ 0 0 0 1 2 0 2 0 0 ] ObjectEnd\nAttributeBegin CoordinateSystem \"c\" Scale 2 2 2 Translate 1 0 0 ObjectInstance \"o\" AttributeEnd\nActiveTransform EndTime Transform [ 1 0 0 0 0 1 0 0 0 0 1 0 5 0 0 1 ] ConcatTransform [ 1 0 0 0 0 2 0 0 0 0 1 0 5 0 0 1 ] ActiveTransform All CoordSysTransform \"c\" Identity\nObjectInstance \"o\" Shape \"sphere\"\n";
    vec![hair, mitsuba.into(), pbrt.into(), placed.into()]
}

/// One view and one absorption, in eight bins.
pub fn twins() -> Vec<Vec<u8>> {
    let (cloth, bins) = (twin_curves(), SphereBins { rows: 2, columns: 4 });
    let twin = ClothTwin {
        spec_text: cloth.text().into(),
        program_version: "0".into(),
        name: cloth.name.clone(),
        seed: 1,
        repeat_um: cloth.repeat_um(),
        repeats: [2, 2],
        views: vec![0.0, 0.6, 0.8],
        sigma_per_um: vec![0.0, 0.01],
        bins,
        paths: vec![1000],
        straight: vec![0.25],
        killed: vec![1e-6],
        interactions: vec![3.5],
        reflected: vec![0.4],
        transmitted: vec![0.3],
        reflected_se: vec![0.01],
        transmitted_se: vec![0.01],
        by_yarns: vec![0.1; 2 * CLASSES],
        by_plies: vec![0.1; 2 * CLASSES],
        density: vec![0.07; bins.len()],
        variance: vec![1e-4; bins.len()],
        image: vec![0.5; 4],
        image_size: [2, 2],
    };
    vec![twin.to_bytes().expect("a good twin")]
}

/// Scenes of one fiber, and the yarns that ship.
pub fn singles() -> Vec<Vec<u8>> {
    [vec![SCENE.into(), file("fabrics/scenes/ellipse.toml"), file("fabrics/scenes/hollow_ellipse.toml")], yarns()]
        .concat()
}

/// Small jobs of four kinds.
pub fn jobs() -> Vec<Vec<u8>> {
    let yarn = String::from_utf8(file("tests/data/small.toml")).expect("a text");
    let spec = YarnSpec::parse(&yarn, "y.toml").expect("a good spec");
    let scene = Scene::parse(SCENE).expect("a good scene");
    let simulate = SimulateJob::new(&spec, &yarn, &SimOptions::preview()).expect("it can be simulated");
    let options = SpeckleOptions { instances: 2, ..SpeckleOptions::default() };
    let speckle = SpeckleJob::new(&spec, &yarn, &options).expect("it has fibers");
    let twin = TwinJob::new(twin_curves(), &TwinOptions::default()).expect("it can be traced");
    let texts = [
        simulate.description(),
        speckle.description(),
        twin.description(),
        ScatterJob::new(&scene, SCENE).description(),
    ];
    texts.into_iter().map(|d| d.text().into()).collect()
}

/// Curves of a small cloth in each of their formats.
pub fn curves() -> Vec<Vec<u8>> {
    let curves = plain();
    // The target knows the cell of the .bcc.
    [CurveFormat::Toml, CurveFormat::Tg3, CurveFormat::Bcc]
        .into_iter()
        .map(|format| write_curves(&curves, "plain", format))
        .collect()
}
