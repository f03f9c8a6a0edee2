//! Distance of the model of a yarn of several plies from the path-traced yarn, its brute-force reference, per
//! incidence:
//!
//! `cargo run --release -p plywave-studies --bin yarn_twin
//! -- ONE.pwt TRACED.pwt [largest |h/R|] [YARN.pwt, the last table to write]`
//!
//! ONE is a table of `plywave simulate SPEC`, TRACED of `plywave simulate SPEC --plies traced`, of the same
//! bins and offsets (scripts/yarn_twin.sh computes both). Prints the relative L2 distance of f_high and
//! f_refl with the noise of both removed, and the differences of the energies, of three constructions: the
//! ply's table unchanged, light leaving plies evenly over their width, light leaving by the table's exit
//! positions.

use plywave::Document;
use plywave::spec::YarnSpec;
use plywave_fit::{TableDistance, table_distance};
use plywave_sim::yarn::{YarnOptions, yarn_table};
use plywave_tables::table::Table;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [one, traced] = [0, 1].map(|i| args.get(i).cloned().ok_or("give ONE.pwt TRACED.pwt"));
    let most = args.get(2).map_or(Ok(0.95), |a| a.parse::<f64>())?;
    let (one, traced) = (Table::load(one?)?, Table::load(traced?)?);
    let spec = YarnSpec::parse(&traced.spec_text, "the traced table's spec")?;
    let ring = spec.ply_ring();
    println!("{} plies of radius {} um on a circle of {:.2} um", ring.plies, ring.radius_um, ring.circle_um);
    let mut results = vec![("as it is", table_distance(&one, &traced)?)];
    for (name, exits) in [("even exits", false), ("exits", true)] {
        let start = Instant::now();
        let options = YarnOptions { exits, ..YarnOptions::default() };
        let (yarn, ledger) = yarn_table(&one, &spec, &options, &|_, _| {})?;
        let sigmas = yarn.sigma_per_um.len();
        let sums = (0..ledger.direct.len()).map(|i| {
            ledger.direct[i] + ledger.conv[i] + ledger.residual[i] + ledger.absorbed[i] + ledger.r_d[i / sigmas]
        });
        let off = sums.map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
        println!("{name}: {:.1} s, ledger within {off:.1e} of 1", start.elapsed().as_secs_f64());
        let middle = yarn.h_um.len() / 2 * sigmas;
        println!(
            "  at h = 0, theta_i = 0, sigma = 0: direct {:.3}, conv {:.3}, residual {:.3}",
            ledger.direct[middle], ledger.conv[middle], ledger.residual[middle]
        );
        results.push((name, table_distance(&yarn, &traced)?));
        if let Some(path) = args.get(3).filter(|_| exits) {
            yarn.save(path)?;
        }
    }
    let sigmas = results[0].1.sigma_per_um.clone();
    for (k, sigma) in sigmas.iter().enumerate() {
        println!("\nsigma {sigma} per um: relative L2 of f_high, difference of its energy");
        print(&results, ring.radius_um, most, |d, i| {
            (d.high2[i * sigmas.len() + k], d.energy_high[i * sigmas.len() + k])
        });
    }
    println!("\nrelative L2 of f_refl, difference of its energy");
    print(&results, ring.radius_um, most, |d, i| (d.refl2[i], d.energy_refl[i]));
    println!("\ndifference of r_d");
    print(&results, ring.radius_um, most, |d, i| (f64::NAN, d.r_d[i]));
    Ok(())
}

fn print(
    results: &[(&str, TableDistance)],
    radius_um: f64,
    most: f64,
    figure: impl Fn(&TableDistance, usize) -> (f64, f64),
) {
    print!("  theta_i    h/R");
    results.iter().for_each(|(name, _)| print!("  {name:>16}"));
    println!();
    let d = &results[0].1;
    let mut worst = vec![(0.0f64, 0.0f64); results.len()];
    for (m, theta) in d.theta_i.iter().enumerate() {
        for (n, h) in d.h_um.iter().enumerate() {
            if (h / radius_um).abs() > most {
                continue;
            }
            print!("  {:>7.1} {:>6.2}", theta.to_degrees(), h / radius_um);
            for ((_, d), worst) in results.iter().zip(&mut worst) {
                let (l2, energy) = figure(d, m * d.h_um.len() + n);
                let l2 = if l2.is_nan() { f64::NAN } else { l2.max(0.0).sqrt() };
                print!("  {l2:>8.3} {energy:>+7.4}");
                *worst = (worst.0.max(l2), worst.1.max(energy.abs()));
            }
            println!();
        }
    }
    print!("  largest       ");
    worst.iter().for_each(|(l2, energy)| print!("  {l2:>8.3} {energy:>7.4}"));
    println!();
}
