//! Adds edge lobes and layer factors to models of earlier versions. Lobes, energies and errors stay bit for
//! bit. With `--reference-values` all tensors stay, and only the reference values of the file are computed
//! again. With `--exits TABLE` one model of a single ply gets its exit offsets from the table that it was
//! fitted to.
//!
//! `cargo run
//! --release -p plywave-fit --example renew_models -- [--reference-values | --exits TABLE]
//! fabrics/models/*.pwm`
//!
//! ci: build only

use plywave::ply::PlyData;
use plywave::spec::YarnSpec;
use plywave::table::Table;
use plywave_fit::{EdgeOptions, fit_edge, fit_exit_lengths, layer_factors};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut files: Vec<String> = std::env::args().skip(1).collect();
    let flag = files.first().filter(|a| a.starts_with("--")).cloned();
    files.drain(..usize::from(flag.is_some()));
    let table = match flag.as_deref() {
        Some("--exits") if files.len() == 2 => Some(Table::load(files.remove(0))?),
        Some("--exits") => return Err("--exits: expected a table and its model".into()),
        None | Some("--reference-values") => None,
        Some(other) => return Err(format!("{other}: no such option").into()),
    };
    for file in files {
        let mut data = PlyData::load(&file)?;
        if let Some(table) = &table {
            let exits = data.exits.as_mut().ok_or("the model has no exits: fit it again")?;
            exits.length = fit_exit_lengths(table, &exits.mean);
            println!("{file}: lengths over R {:.3?}", exits.length);
        } else if flag.is_none() {
            let spec = YarnSpec::parse(&data.spec_text, &file)?;
            data.edge = Some(fit_edge(&spec, &EdgeOptions::default()).lobes);
            data.layers = Some(layer_factors(&data));
        }
        data.save(&file)?;
        println!("{file}: {} bytes", std::fs::metadata(&file)?.len());
    }
    Ok(())
}
