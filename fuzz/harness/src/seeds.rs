//! Good files of each kind: those of the repository, and small ones made here.

use plywave::fiber::{FiberSource, FiberTable, OutlineSymmetry};
use plywave::ply::PlyData;
use plywave::speckle::{NoiseSpectrum, SpecklePatterns};
use plywave_sim::runs::{self, Run};
use plywave_sim::wave::{ScatterJob, Scene};
use std::path::{Path, PathBuf};

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
    noised.noise = Some(noise().into());
    vec![
        small.to_bytes().expect("it loads"),
        noised.to_bytes().expect("good noise"),
        layered.to_bytes().expect("it is within the energies"),
        file("fabrics/models/silk.pwm"),
    ]
}

/// Noise of small tiles.
fn noise() -> NoiseSpectrum {
    NoiseSpectrum {
        sizes: [1, 16, 16],
        seed: 1,
        spectrum: [[0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.25, 0.25, 0.0, 0.0, 0.0, 0.0]]
            .concat(),
        share: [0.3, 1.0],
        w0_um: 10.0,
        step: [[0.003, 0.01]; 2],
        lambda_um: 0.4,
        fade: [[1.0, -0.2]; 2],
        contrast: [[1.0; 2]; 2],
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

fn specs(fabrics: bool) -> Vec<Vec<u8>> {
    let entries = std::fs::read_dir(root().join("fabrics")).expect("the fabrics");
    let mut paths: Vec<PathBuf> =
        entries.map(|e| e.expect("an entry").path()).filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
    paths.sort();
    let texts = paths.iter().map(|p| std::fs::read(p).expect("a spec"));
    texts.filter(|t| fabrics == t.windows(6).any(|w| w == b"[warp]")).collect()
}

/// The yarns that ship.
pub fn yarns() -> Vec<Vec<u8>> {
    specs(false)
}

/// The fabrics that ship.
pub fn fabrics() -> Vec<Vec<u8>> {
    specs(true)
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
    let (mut header, mut data) =
        (serde_json::json!({ "__metadata__": { "of spec": "digest", "samples": "1" } }), Vec::new());
    for (name, channels) in [("albedo", 3), ("depth", 1), ("deviation", 3), ("hits", 1), ("light", 3), ("normal", 3)] {
        let from = data.len();
        data.extend((0..12 * channels).flat_map(|_| 0.5f32.to_le_bytes()));
        header[name] =
            serde_json::json!({ "dtype": "F32", "shape": [3, 4, channels], "data_offsets": [from, data.len()] });
    }
    let text = header.to_string();
    vec![[&(text.len() as u64).to_le_bytes(), text.as_bytes(), &data].concat()]
}
