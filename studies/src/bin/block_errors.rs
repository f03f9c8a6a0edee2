//! Errors of whole models with other numbers of lobes, measured on an independent table of another seed.
//!
//! `cargo run --release -p plywave-studies --bin block_errors -- A.pwt B.pwt 8 12 16`

use plywave::Document;
use plywave_fit::{FitOptions, errors, fit};
use plywave_tables::table::Table;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [a, b, lobes @ ..] = args.as_slice() else { return Err("give two tables and numbers of lobes".into()) };
    let (a, b) = (Table::load(a)?, Table::load(b)?);
    let columns = a.h_um.len();
    let sigmas = a.sigma_per_um.len();
    for lobes in lobes {
        let options = FitOptions { lobes_high: lobes.parse()?, ..FitOptions::standard() };
        let start = Instant::now();
        let model = fit(&a, &options, &|_| {})?;
        let seconds = start.elapsed().as_secs_f64();
        println!("{lobes} lobes of f_high, fitted in {seconds:.0} s");
        for (name, table) in [("own", &a), ("other", &b)] {
            let e = errors(&model, table)?;
            println!("  {name} table: f_refl rms {:.4}, f_high rms {:.4?}", e.rms_refl, e.rms_high);
            for (m, row) in e.high.chunks(columns * sigmas).enumerate() {
                let row: Vec<f64> = row.iter().step_by(sigmas).copied().filter(|v| v.is_finite()).collect();
                let rms = (row.iter().map(|v| v * v).sum::<f64>() / row.len().max(1) as f64).sqrt();
                println!(
                    "    theta_i {:5.1} degrees: f_high rms {rms:.4} over {} slices",
                    a.theta_i[m].to_degrees(),
                    row.len()
                );
            }
        }
    }
    Ok(())
}
