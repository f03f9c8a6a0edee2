//! Table and model files: written files read back; damaged, foreign or hostile files are refused in one line.

use crate::synthetic::{STANDARD, Sizes, model, table};
use plywave::Document;
use plywave::io::{FileKind, file_kind};
use plywave::ply::{PlyData, PlyEnergies};
use plywave::{Bsdf, PlyModel, PlyQuery};
use plywave_tables::table::Table;
use proptest::prelude::*;

#[test]
fn models_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.ply");
    let data = model(1, STANDARD);
    data.save(&path).unwrap();
    assert_eq!(file_kind(&path).unwrap(), FileKind::Model);
    let loaded = PlyData::load(&path).unwrap();
    let round = |v: &[f64]| v.iter().map(|v| f64::from(*v as f32)).collect::<Vec<f64>>();
    let energies = PlyEnergies {
        miss: round(&data.energies.miss),
        share_refl: round(&data.energies.share_refl),
        share_high: round(&data.energies.share_high),
        ..data.energies.clone()
    };
    let want = PlyData {
        energies,
        refl: round(&data.refl),
        high: round(&data.high),
        high_path: round(&data.high_path),
        ..data
    };
    assert_eq!(loaded, want);
    assert_eq!(loaded.to_bytes().unwrap(), std::fs::read(&path).unwrap());
    let m = PlyModel::load(&path).unwrap();
    assert_eq!(m.reference_values().len(), 12);
    assert!(m.reference_error() < 1e-5, "reference error {}", m.reference_error());
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

/// A safetensors file by hand: header text and data.
fn file_of(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}

/// The header of `bytes` changed by `change`, the data kept.
fn with_header(bytes: &[u8], change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + n]).unwrap();
    change(&mut header);
    file_of(&header.to_string(), &bytes[8 + n..])
}

/// The JSON document of `bytes` changed by `change`.
fn with_document(bytes: &[u8], change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    with_header(bytes, |header| {
        let text = header["__metadata__"]["plywave"].as_str().unwrap();
        let mut document: serde_json::Value = serde_json::from_str(text).unwrap();
        change(&mut document);
        header["__metadata__"]["plywave"] = document.to_string().into();
    })
}

/// Checks that the bytes are refused as a model, as a table and by the detection of the kind, each in one
/// line with the name; returns the model's line.
fn refused(bytes: &[u8]) -> String {
    let error = PlyModel::from_bytes(bytes, "some.ply").map(|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("some.ply: ") && error.lines().count() == 1 && error.len() < 600, "{error}");
    error
}

#[test]
fn foreign_and_hostile_files_are_refused() {
    let good = model(2, STANDARD).to_bytes().unwrap();
    PlyModel::from_bytes(&good, "good").unwrap();
    let says = |bytes: &[u8], what: &str| {
        let error = refused(bytes);
        assert!(error.contains(what), "{error:?} does not say {what:?}");
    };
    says(b"", "shorter than");
    says(b"PNG\r\n", "shorter than");
    says(&u64::MAX.to_le_bytes(), "header of");
    says(&[&100_000_000u64.to_le_bytes()[..], &[b' '; 64]].concat(), "header of");
    says(&file_of("{}", &[]), "no metadata plywave");
    says(&file_of(&"[".repeat(100_000), &[]), "not a whole");
    says(&good[..good.len() - 1], "not a whole");
    says(&[&good[..], b"x"].concat(), "not a whole");
    says(&table(1).to_bytes().unwrap(), "expected \"plywave-ply\"");
    says(&with_document(&good, |d| d["version"] = 4.into()), "update plywave");
    says(&with_document(&good, |d| d["version"] = 1.into()), "write it again");
    says(&with_document(&good, |d| d["seed"] = "x".into()), "expected u64");
    says(&with_document(&good, |d| d["reference_values"][0]["value"][0] = 1e39.into()), "reference_values");
    says(&with_header(&good, |h| h["refl"]["dtype"] = "I32".into()), "refl = I32");
    says(&with_header(&good, |h| h["refl"]["shape"] = [9, 17, 12].into()), "refl = [9, 17, 12]");
    says(&with_header(&good, |h| h["share_refl"]["shape"] = [17, 9].into()), "share_refl = [17, 9]");
    says(&with_header(&good, |h| h["miss"]["data_offsets"] = h["h_um"]["data_offsets"].clone()), "not a whole");
    says(&with_header(&good, |h| h["miss"]["shape"] = [u64::MAX, u64::MAX].into()), "not a whole");
    says(
        &with_header(&good, |h| {
            let miss = h.as_object_mut().unwrap().remove("miss").unwrap();
            h["mis"] = miss;
        }),
        "unknown tensor \"mis\"",
    );
    says(
        &with_header(&good, |h| {
            h["more"] = serde_json::json!({"dtype": "F32", "shape": [0], "data_offsets": [0, 0]});
        }),
        "unknown tensor \"more\"",
    );
    let table_bytes = table(1).to_bytes().unwrap();
    let error = Table::from_bytes(&good, "t").unwrap_err().to_string();
    assert!(error.contains("expected \"plywave-table\""), "{error}");
    let error =
        Table::from_bytes(&with_document(&table_bytes, |d| d["version"] = 7.into()), "t").unwrap_err().to_string();
    assert!(error.contains("version 7"), "{error}");
}

/// Error of a model after `spoil`.
fn spoilt(spoil: impl Fn(&mut PlyData)) -> String {
    let mut data = model(2, STANDARD);
    spoil(&mut data);
    let error = PlyModel::from_data(data.clone()).map(|_| ()).unwrap_err().to_string();
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(data.to_bytes().is_err(), "written although it would not load: {error}");
    error
}

#[test]
fn models_are_checked() {
    for (error, key) in [
        (spoilt(|d| d.energies.miss[3] = f64::NAN), "miss[3] = NaN"),
        (spoilt(|d| d.energies.miss[5] = 1.01), "miss[5] = 1.01"),
        (spoilt(|d| d.energies.share_refl[0] = -0.1), "share_refl[0] = -0.1"),
        (spoilt(|d| d.energies.share_refl[76] = 0.99), "share_refl + share_high at node 76"),
        (spoilt(|d| d.energies.share_high[7] = f64::INFINITY), "share_high[7] = inf"),
        (spoilt(|d| d.energies.miss_h_um.iter_mut().for_each(|h| *h *= 1.1)), "miss_h_um = 143"),
        (spoilt(|d| d.energies.share_theta_i.truncate(1)), "share_theta_i = 1 values"),
        (spoilt(|d| d.energies.share_theta_i.truncate(8)), "share_theta_i = "),
        (spoilt(|d| d.energies.miss.truncate(9)), "miss = "),
        (spoilt(|d| d.refl[9] = 50.0), "refl lobe 1 ln_mu1 = 50"),
        (spoilt(|d| d.high[1] = 1e9), "high lobe 0 phi_z"),
        (spoilt(|d| d.high[5] = -1.0), "high lobe 0 energy"),
        (spoilt(|d| d.high_path[8] += 0.1), "high_path of lobe 1"),
        (spoilt(|d| d.theta_i[0] = 0.001), "theta_i"),
        (spoilt(|d| d.theta_i[4] += 1e-3), "equal steps"),
        (spoilt(|d| d.h_um.iter_mut().for_each(|h| *h += 1.0)), "symmetric"),
        (spoilt(|d| d.sigma_per_um[0] = 1e-4), "sigma_per_um[0]"),
        (spoilt(|d| d.path_um[2] = d.path_um[1]), "path_um[2]"),
        (spoilt(|d| d.path_um[0] = -1.0), "path_um[0]"),
        (spoilt(|d| d.lobes_high = 17), "lobes_high = 17"),
        (spoilt(|d| d.lobes_refl = 0), "lobes_refl = 0"),
        (spoilt(|d| d.lobes_refl = 3), "refl = "),
        (spoilt(|d| d.theta_i.truncate(8)), "theta_i = 8 values"),
        (spoilt(|d| d.theta_i.clear()), "theta_i = 0 values"),
        (spoilt(|d| d.error_high.truncate(5)), "error_high"),
    ] {
        assert!(error.contains(key), "{error:?} does not name {key:?}");
    }
}

#[test]
fn tables_are_checked() {
    let spoilt = |spoil: &dyn Fn(&mut Table)| {
        let mut t = table(2);
        spoil(&mut t);
        t.to_bytes().unwrap_err().to_string()
    };
    for (error, key) in [
        (spoilt(&|t| t.refl[5] = f32::NAN), "refl[5] = NaN"),
        (spoilt(&|t| t.high[5] = -1.0), "high[5] = -1"),
        (
            spoilt(&|t| (t.r_d[0], t.energy_refl[0], t.energy_high[0]) = (0.4, 0.4, 0.4)),
            "r_d + energy_refl + energy_high at incidence 0",
        ),
        (spoilt(&|t| t.grid.phi_o = 7), "refl"),
        (spoilt(&|t| t.grid.phi_o = 0), "phi_o bins"),
        (spoilt(&|t| t.paths.clear()), "paths"),
        (spoilt(&|t| t.noise_high[0] = -1.0), "noise_high[0]"),
        (spoilt(&|t| t.h_um[0] = -90.0), "h_um"),
    ] {
        assert!(error.contains(key) && error.lines().count() == 1, "{error:?} does not name {key:?}");
    }
}

#[test]
fn io_errors_name_the_file_and_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("no/such/folder/m.ply");
    assert!(model(1, STANDARD).save(&missing).unwrap_err().to_string().contains("m.ply"));
    assert!(PlyModel::load(&missing).unwrap_err().to_string().contains("m.ply"));
    assert!(file_kind(&missing).unwrap_err().to_string().contains("m.ply"));
    let text = dir.path().join("fabric.toml");
    std::fs::write(&text, "name = \"polyester\"\n").unwrap();
    assert!(file_kind(&text).unwrap_err().to_string().contains("give a table or model"));
    let mut bad = model(1, STANDARD);
    bad.energies.miss[0] = 2.0;
    let target = dir.path().join("bad.ply");
    assert!(bad.save(&target).is_err());
    // With a folder in the way, the write fails at the rename and removes the temporary file.
    std::fs::create_dir(&target).unwrap();
    assert!(model(1, STANDARD).save(&target).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(PlyModel::from_bytes(&bytes, "x").is_err());
        prop_assert!(Table::from_bytes(&bytes, "x").is_err());
    }

    #[test]
    fn truncated_files_are_refused(cut in 0.0f64..1.0) {
        let [m, t] = originals();
        prop_assert!(PlyModel::from_bytes(&m[..(cut * m.len() as f64) as usize], "x").is_err());
        prop_assert!(Table::from_bytes(&t[..(cut * t.len() as f64) as usize], "x").is_err());
    }

    #[test]
    fn flipped_bits_are_refused_or_harmless(flips in prop::collection::vec((0.0f64..1.0, 0u8..8, any::<bool>()), 1..6)) {
        for original in originals() {
            let header = u64::from_le_bytes(original[..8].try_into().unwrap()) as usize;
            let mut bytes = original.clone();
            for (at, bit, in_header) in &flips {
                let range = if *in_header { header + 8 } else { original.len() };
                bytes[(at * range as f64) as usize] ^= 1 << bit;
            }
            if let Err(e) = Table::from_bytes(&bytes, "x") {
                prop_assert_eq!(e.to_string().lines().count(), 1);
            }
            match PlyModel::from_bytes(&bytes, "x") {
                Err(e) => prop_assert_eq!(e.to_string().lines().count(), 1),
                Ok(m) => {
                    let f = m.at(&PlyQuery::lobes(0.7, 13.0, [0.0, 0.1])).eval([0.0, 0.6, 0.8]);
                    prop_assert!(f.iter().all(|f| f.is_finite() && *f >= 0.0));
                    let _ = m.reference_error();
                }
            }
        }
    }
}

/// A small model and a small table.
fn originals() -> &'static [Vec<u8>; 2] {
    static BYTES: std::sync::OnceLock<[Vec<u8>; 2]> = std::sync::OnceLock::new();
    BYTES.get_or_init(|| {
        let sizes = Sizes { theta: 3, h: 5, refl: 1, high: 2, paths: 3 };
        [model(5, sizes).to_bytes().unwrap(), table(5).to_bytes().unwrap()]
    })
}

#[test]
fn exit_positions_and_plies_of_tables_are_checked() {
    let good = table(4);
    let says = |t: &Table, what: &str| {
        let error = t.to_bytes().unwrap_err().to_string();
        assert!(error.contains(what) && error.lines().count() == 1, "{error:?} does not say {what:?}");
    };
    let without = Table { exit: None, ..good.clone() };
    assert_eq!(Table::from_bytes(&without.to_bytes().unwrap(), "t").unwrap(), without);
    let yarn = Table { plies: 3, ..without.clone() };
    assert_eq!(Table::from_bytes(&yarn.to_bytes().unwrap(), "t").unwrap().plies, 3);
    let twin = Table { plies: 3, traced: true, ..without.clone() };
    assert_eq!(Table::from_bytes(&twin.to_bytes().unwrap(), "t").unwrap(), twin);
    says(&Table { traced: true, ..good.clone() }, "traced = true");
    // Tables without yarns are of one ply.
    let old = with_document(&without.to_bytes().unwrap(), |d| {
        let document = d.as_object_mut().unwrap();
        document.remove("plies");
        document.remove("traced");
    });
    assert_eq!(Table::from_bytes(&old, "old").unwrap(), without);
    says(&Table { plies: 8, ..good.clone() }, "plies = 8");
    says(&Table { plies: 0, ..good.clone() }, "plies = 0");
    let mut bad = good.clone();
    bad.exit.as_mut().unwrap().shares[0] += 0.5;
    says(&bad, "add up to 1");
    let mut bad = good.clone();
    bad.exit.as_mut().unwrap().shares[0] = f32::NAN;
    says(&bad, "exit[0]");
    let mut bad = good.clone();
    bad.exit.as_mut().unwrap().met[1] = 1.5;
    says(&bad, "met[1]");
    let mut bad = good;
    bad.exit.as_mut().unwrap().shares.pop();
    says(&bad, "exit");
}
