//! Both families of lobes fitted to one table and compared with another of the same yarn and another seed:
//! `cargo run --release -p plywave-studies --bin lobe_families -- TABLE OTHER [preview|standard]
//! [round|cone]`

use plywave::Document;
use plywave::ply::LobeKind;
use plywave_fit::{FitOptions, errors, fit};
use plywave_tables::table::Table;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [table, other, rest @ ..] = &args[..] else {
        return Err("usage: families TABLE OTHER [PRESET] [FAMILY]".into());
    };
    let (table, other) = (Table::load(table)?, Table::load(other)?);
    let options = if rest.iter().any(|a| a == "preview") { FitOptions::preview() } else { FitOptions::standard() };
    for family in [LobeKind::Cone, LobeKind::Round] {
        let wanted = rest.iter().filter(|a| ["cone", "round"].contains(&a.as_str())).all(|a| a == family.name());
        if !wanted {
            continue;
        }
        let start = Instant::now();
        let model = fit(&table, &FitOptions { family: Some(family), ..options }, &|_| {})?;
        let seconds = start.elapsed().as_secs_f64();
        let held = errors(&model, &other)?;
        let high: Vec<String> = held.rms_high.iter().map(|e| format!("{e:.4}")).collect();
        println!(
            "{:5}: f_refl {:.4}, f_high by sigma {}; {seconds:.0} s",
            family.name(),
            held.rms_refl,
            high.join(" ")
        );
        for (m, row) in held.block.chunks(held.block.len() / (table.theta_i.len() / 2)).enumerate() {
            let zero = row.iter().step_by(held.rms_high.len()).map(|e| format!("{e:.3}")).collect::<Vec<_>>();
            println!("  blocks {m}: {}", zero.join(" "));
        }
    }
    Ok(())
}
