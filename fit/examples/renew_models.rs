//! Gives models made by an earlier version what the fit now adds to its lobes: edge lobes and layer factors. Lobes, energies and errors stay bit for bit.
//! With `--reference-values` all tensors stay, and only the reference values of the file are computed again.
//!
//! `cargo run --release -p plywave-fit --example renew_models -- [--reference-values] fabrics/models/*.pwm`
//!
//! ci: build only

use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave_fit::{EdgeOptions, fit_edge, layer_factors};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (flags, files): (Vec<String>, Vec<String>) = std::env::args().skip(1).partition(|a| a == "--reference-values");
    for file in files {
        let mut data = PlyData::load(&file)?;
        if flags.is_empty() {
            let spec = YarnSpec::parse(&data.spec_text, &file)?;
            data.edge = Some(fit_edge(&spec, &EdgeOptions::default()).lobes);
            data.layers = Some(layer_factors(&data));
        }
        data.save(&file)?;
        println!("{file}: {} bytes", std::fs::metadata(&file)?.len());
    }
    Ok(())
}
