//! Cost of loading woven fabrics: clock and, on Linux, seconds of all cores, for reading a spec with its
//! models, preparing the fabric, and the mean over its repeat (`FabricOptions::far`); then a digest that
//! shows whether its tables equal those of another run bit by bit.
//!
//! `cargo run --release -p plywave-studies --bin loading [far] [FABRIC.toml ..]`, by default
//! the shipped fabrics of filaments and of plies.

use plywave::FabricModel;
use plywave::fabric::{FabricOptions, FabricSpec, Values};
use std::path::Path;
use std::time::Instant;

const FABRICS: [&str; 6] =
    ["polyester_satin", "cotton_twill", "cotton_plain", "silk_organza", "wool_plain", "polyester_layers"];

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
fn timed<T>(of: impl FnOnce() -> T) -> (T, [f64; 2]) {
    let (begun, before) = (Instant::now(), cpu_s());
    let out = of();
    (out, [begun.elapsed().as_secs_f64(), cpu_s() - before])
}

/// FNV-1a of the bits of all tables.
fn digest(fabric: &FabricModel) -> u64 {
    let mut hash = 0xCBF2_9CE4_8422_2325u64;
    let mut add = |bits: u32| hash = (hash ^ u64::from(bits)).wrapping_mul(0x0100_0000_01B3);
    for tensor in fabric.tensors() {
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
        wanted = FABRICS.map(|name| format!("{}/../fabrics/{name}.toml", env!("CARGO_MANIFEST_DIR"))).to_vec();
    }
    println!(
        "fabric, read [s clock, s of all cores], made ready{}, tables",
        if far { ", with the far view" } else { "" }
    );
    for path in wanted {
        let name = Path::new(&path).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let (loaded, read) = timed(|| FabricSpec::load(&path));
        let options = FabricOptions { far, ..FabricOptions::default() };
        let (fabric, ready) = timed(|| FabricModel::new(loaded?, &options));
        let fabric = fabric?;
        println!("{name}: {:.2} {:.2}, {:.2} {:.2}, {:016x}", read[0], read[1], ready[0], ready[1], digest(&fabric));
    }
    Ok(())
}
