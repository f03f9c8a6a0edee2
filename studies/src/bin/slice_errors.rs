//! Errors of lobes fitted to single slices of a table, measured on an independent table of another seed.
//!
//! `cargo run --release -p plywave-studies --bin slice_errors -- A.pwt B.pwt [lobes of f_high] [reference]`;
//! the last word selects the reference fit's starts and iterations.

use plywave::Document;
use plywave_fit::{FitOptions, Part, fit_single_slices};
use plywave_tables::table::Table;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [a, b, ..] = args.as_slice() else { return Err("give two tables".into()) };
    let (a, b) = (Table::load(a)?, Table::load(b)?);
    let lobes = args.get(2).map_or(Ok(8), |l| l.parse())?;
    let options = match args.get(3).map(String::as_str) {
        None => FitOptions::standard(),
        Some("reference") => FitOptions::reference(),
        Some(other) => return Err(format!("{other}: expected reference, or nothing").into()),
    };
    let (rows, columns) = (a.theta_i.len(), a.h_um.len());
    let nodes: Vec<(usize, usize)> = (0..rows * columns).map(|i| (i / columns, i % columns)).collect();
    for (name, part, lobes) in [("f_high", Part::High, lobes), ("f_refl", Part::Refl, options.lobes_refl)] {
        let squares = fit_single_slices(&a, &b, part, &nodes, lobes, &options.block)?;
        let known: Vec<f64> = squares.iter().copied().filter(|v| v.is_finite()).collect();
        let rms = |v: &[f64]| (v.iter().sum::<f64>() / v.len().max(1) as f64).max(0.0).sqrt();
        println!("{name}: {lobes} lobes, {} slices, rms excess error {:.4}", known.len(), rms(&known));
        for (m, row) in squares.chunks(columns).enumerate() {
            let row: Vec<f64> = row.iter().copied().filter(|v| v.is_finite()).collect();
            println!("  theta_i {:5.1} degrees: {:.4} over {} slices", a.theta_i[m].to_degrees(), rms(&row), row.len());
        }
    }
    Ok(())
}
