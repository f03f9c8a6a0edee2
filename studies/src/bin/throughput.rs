//! Paths per second of a yarn's simulation, and its energies.
//!
//! `cargo run --release -p plywave-studies --bin throughput
//! -- [fabrics/NAME.toml] [threads] [preset] [paths per theta] [seed] [out.pwt]`

use plywave::Document;
use plywave_runs::Run;
use plywave_sim::{SimOptions, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let get = |i: usize| args.get(i).map(String::as_str);
    let (spec, text) = plywave_textile::load_yarn_file(get(0).unwrap_or("fabrics/polyester.toml"))?;
    let threads = get(1).map_or(Ok(1), str::parse)?;
    let mut options = SimOptions::preset(get(2).unwrap_or("preview")).ok_or("unknown preset")?;
    options.paths_per_theta = get(3).map_or(Ok(200_000), str::parse)?;
    options.seed = get(4).map_or(Ok(1), str::parse)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let start = std::time::Instant::now();
    let table = pool.install(|| simulate(&spec, &text, &options, Run::plain()))?;
    let seconds = start.elapsed().as_secs_f64();
    let paths: u64 = table.paths.iter().sum();
    println!("{paths} paths in {seconds:.2} s: {:.0} paths/s on {threads} threads", paths as f64 / seconds);
    let (hs, ks) = (table.h_um.len(), table.sigma_per_um.len());
    println!("theta_i   h_um    r_d    refl  high(sigma)      sum - 1  standard error  killed  interactions");
    for m in 0..table.theta_i.len() {
        for n in (0..hs).step_by(hs / 6) {
            let i = m * hs + n;
            let sum = table.r_d[i] + table.energy_refl[i] + table.energy_high[i * ks];
            println!(
                "{:7.1} {:6.1} {:.4} {:.4} {:.4?} {:+.1e} {:.1e} {:.1e} {:.2}",
                table.theta_i[m].to_degrees(),
                table.h_um[n],
                table.r_d[i],
                table.energy_refl[i],
                &table.energy_high[i * ks..(i + 1) * ks],
                sum - 1.0,
                table.energy_se[i],
                table.energy_killed[i],
                table.interactions[m]
            );
        }
    }
    if let Some(out) = get(5) {
        table.save(out)?;
    }
    Ok(())
}
