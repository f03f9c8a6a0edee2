//! Paths per second and energies of a standard polyester ply at a few incidences, one thread.
use plywave::*;
use plywave_sim::*;

fn main() {
    let spec = YarnSpec {
        name: "polyester".into(),
        fiber: FiberSpec {
            shape: Shape::Circle { radius_um: 7.5 },
            size_jitter: 0.05,
            shape_jitter: 0.0,
            angle_jitter_rad: None,
            eta: 1.57,
            alpha_fiber: std::env::args().nth(1).map_or(0.2, |a| a.parse().unwrap()),
        },
        ply: PlySpec { fibers: 30, radius_um: Some(52.0), radii_um: None, min_gap_um: 0.2, fiber_pitch_um: Some(800.0), handedness: Handedness::Z },
        beam: BeamSpec::default(),
        absorption: AbsorptionSpec::default(),
        simulation: SimulationSpec::default(),
    };
    let threads: usize = std::env::args().nth(2).map_or(1, |a| a.parse().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let options = SimOptions { paths_per_theta: 200_000, h_nodes: 25, ..SimOptions::preview() };
    let start = std::time::Instant::now();
    let table = pool.install(|| simulate(&spec, "", &options, Run::plain())).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let paths: u64 = table.paths.iter().sum();
    println!("{paths} paths in {seconds:.2} s: {:.0} paths/s, interactions {:?}", paths as f64 / seconds, table.interactions);
    let (hs, ks) = (table.h_um.len(), table.sigma_per_um.len());
    for m in 0..table.theta_i.len() {
        for n in (0..hs).step_by(4) {
            let i = m * hs + n;
            let sum = table.r_d[i] + table.energy_refl[i] + table.energy_high[i * ks];
            println!(
                "theta {:4.1} h {:6.1}: miss {:.4} refl {:.4} high {:.4?} killed {:.2e} sum-1 {:+.2e} se {:.1e}",
                table.theta_i[m].to_degrees(), table.h_um[n], table.r_d[i], table.energy_refl[i],
                &table.energy_high[i * ks..(i + 1) * ks], table.energy_killed[i], sum - 1.0, table.energy_se[i]
            );
        }
    }
}
