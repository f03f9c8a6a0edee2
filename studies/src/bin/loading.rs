//! Cost of making and loading cloths: clock and, on Linux, seconds of all cores, for the curves, for what
//! shading needs of them (with `far` the mean over the cell too), and for reading the file and making it
//! ready for shading; then a digest that shows whether its tables equal those of another run bit by bit.
//!
//! `cargo run --release -p plywave-studies --bin loading [far] [CLOTH.toml ..]`, by default the shipped
//! cloths of which the models ship. Models are read from beside the specs of the plies.

use plywave::Document;
use plywave::cloth::{ClothData, ClothModel, ClothOptions, Values};
use plywave_pipeline::{ClothRecipe, Run, model_library};
use plywave_sim::cloth::{Effort, make_cloth, precompute};
use plywave_textile::ClothSpec;
use std::path::Path;
use std::time::Instant;

const CLOTHS: [&str; 5] = ["satin", "organza", "hopsack", "jersey", "rib"];

/// Seconds of this process on all cores; NaN if the system does not report them.
fn cpu_s() -> f64 {
    // Hundredths of a second, after the command's name and eleven fields.
    let times = std::fs::read_to_string("/proc/self/stat").ok().and_then(|stat| {
        let fields: Vec<f64> = stat.rsplit(") ").next()?.split(' ').skip(11).take(2).flat_map(str::parse).collect();
        Some(fields.iter().sum::<f64>() / 100.0)
    });
    times.unwrap_or(f64::NAN)
}

/// Cost of a call: its clock and all cores' seconds.
fn timed<T>(of: impl FnOnce() -> T) -> (T, String) {
    let (begun, before) = (Instant::now(), cpu_s());
    let out = of();
    (out, format!("{:.2} {:.2}", begun.elapsed().as_secs_f64(), cpu_s() - before))
}

/// FNV-1a of the bits of all tables.
fn digest(cloth: &ClothModel) -> u64 {
    let mut hash = 0xCBF2_9CE4_8422_2325u64;
    let mut add = |bits: u32| hash = (hash ^ u64::from(bits)).wrapping_mul(0x0100_0000_01B3);
    for tensor in cloth.tensors() {
        match tensor.values {
            Values::F32(values) => values.iter().for_each(|v| add(v.to_bits())),
            Values::U32(values) => values.iter().for_each(|v| add(*v)),
            Values::U8(values) => values.iter().for_each(|v| add(u32::from(*v))),
        }
    }
    hash
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut wanted: Vec<String> = std::env::args().skip(1).collect();
    let far = wanted.iter().any(|word| word == "far");
    wanted.retain(|word| word != "far");
    if wanted.is_empty() {
        wanted = CLOTHS.map(|name| format!("{}/../fabrics/cloths/{name}.toml", env!("CARGO_MANIFEST_DIR"))).to_vec();
    }
    println!(
        "cloth: curves [s clock, s of all cores], made{}, read, made ready, KiB of the file, tables",
        if far { " with the mean over the cell" } else { "" }
    );
    for path in wanted {
        let (path, text) = (Path::new(&path), std::fs::read_to_string(&path)?);
        let (name, folder) = (path.display().to_string(), path.parent().unwrap_or(Path::new("")));
        let spec = ClothSpec::parse(&text, &name)?;
        let mut read = |file: &str| {
            let path = folder.join(file);
            std::fs::read(&path).map_err(|source| plywave::Error::Io { file: path.display().to_string(), source })
        };
        let (made, curves) = timed(|| make_cloth(&spec, &name, &mut read, Effort::Full, &|_| true));
        let made = made?;
        let models = ClothRecipe::load(path)?.plies(&model_library())?.build(&Run::plain())?.models;
        let effort = if far { Effort::Full } else { Effort::Near };
        let (data, making) = timed(|| precompute(&spec, &text, &made.curves, &models, effort, &|_| true));
        let bytes = data?.to_bytes()?;
        let (data, reading) = timed(|| ClothData::from_bytes(&bytes, &name));
        let options = ClothOptions { far, ..ClothOptions::default() };
        let (cloth, ready) = timed(|| ClothModel::from_data(data?, &options));
        let (kib, digest) = (bytes.len() >> 10, digest(&cloth?));
        println!("{}: {curves}, {making}, {reading}, {ready}, {kib}, {digest:016x}", spec.name);
    }
    Ok(())
}
