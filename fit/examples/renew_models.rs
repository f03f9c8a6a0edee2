//! Gives models made by an earlier version what the fit now adds to its lobes: edge lobes and layer factors. Lobes, energies and errors stay bit for bit.
//!
//! `cargo run --release -p plywave-fit --example renew_models -- fabrics/models/*.pwm`
//!
//! ci: build only

use plywave::{PlyData, PlyModel, YarnSpec};
use plywave_fit::{EdgeOptions, fit_edge, layer_factors};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for file in std::env::args().skip(1) {
        let mut data: PlyData = PlyModel::load(&file)?.data().clone();
        let spec = YarnSpec::parse(&data.spec_text, &file)?;
        data.edge = Some(fit_edge(&spec, &EdgeOptions::default()).lobes);
        data.layers = Some(layer_factors(&data));
        data.save(&file)?;
        println!("{file}: {} bytes", std::fs::metadata(&file)?.len());
    }
    Ok(())
}
