//! Table and model files: what is written comes back; what is damaged, foreign or hostile is refused by one line.

mod synthetic;

use plywave::{FileKind, PlyData, PlyModel, Table, file_kind};
use synthetic::{STANDARD, model, table};

#[test]
fn models_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.ply");
    let data = model(1, STANDARD);
    data.save(&path).unwrap();
    assert_eq!(file_kind(&path).unwrap(), FileKind::Model);
    let loaded = PlyData::load(&path).unwrap();
    let round = |v: &[f64]| v.iter().map(|v| f64::from(*v as f32)).collect::<Vec<f64>>();
    let want = PlyData { refl: round(&data.refl), high: round(&data.high), high_path: round(&data.high_path), ..data };
    assert_eq!(loaded, want);
    assert_eq!(loaded.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    let m = PlyModel::load(&path).unwrap();
    assert_eq!(m.golden().len(), 12);
    assert!(m.golden_error() < 1e-5, "golden error {}", m.golden_error());
    assert!(std::fs::metadata(&path).unwrap().len() < 1 << 20);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file was left");
}

#[test]
fn tables_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.table");
    let t = table(3);
    t.save(&path).unwrap();
    assert_eq!(file_kind(&path).unwrap(), FileKind::Table);
    assert_eq!(Table::load(&path).unwrap(), t);
    assert_eq!(t.to_bytes().unwrap(), std::fs::read(&path).unwrap());
}
