//! Paths per second through the standard polyester ply: screw march and triangles in the same run, on one
//! thread and on two.
//!
//! `cargo bench -p plywave-sim --bench trace`; the throughput line of each is paths per second.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use plywave::spec::YarnSpec;
use plywave_runs::Run;
use plywave_sim::{PlySection, ScrewTracer, SimOptions, TracerKind, simulate};
use std::time::{Duration, Instant};

fn paths_per_second(c: &mut Criterion) {
    let spec = YarnSpec::polyester().expect("compiled-in spec");
    let mut group = c.benchmark_group("trace");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).measurement_time(Duration::from_secs(12));
    for (name, tracer, threads) in [
        ("screw march, 1 thread", TracerKind::Screw, 1),
        ("screw march, 2 threads", TracerKind::Screw, 2),
        ("triangles in obvhs, 1 thread", TracerKind::Mesh, 1),
    ] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        // Two latitudes, so that geometry is built once for many paths; its time is included.
        let options = SimOptions {
            tracer,
            instances: 8,
            theta_i_nodes: 3,
            paths_per_theta: 60_000,
            h_nodes: 25,
            theta_o_bins: 90,
            phi_o_bins: 180,
            ..SimOptions::preview()
        };
        group.throughput(Throughput::Elements(plywave_sim::total_paths(&options)));
        group.bench_function(name, |b| {
            b.iter(|| pool.install(|| simulate(&spec, "", &options, Run::plain()).expect("simulates")))
        });
    }
    group.finish();
}

/// Paths per second of the walk alone, without geometry and tables.
fn walk_alone(c: &mut Criterion) {
    use plywave_sim::{MeshResolution, MeshTracer, RoughDielectric, Tracer, trace_path};
    use rand::{RngExt, SeedableRng};
    let spec = YarnSpec::polyester().expect("compiled-in spec");
    let section = PlySection::generate(&spec, 1).expect("packs");
    let screw = ScrewTracer::new(&section).expect("resolves");
    let mesh = MeshTracer::new(&section, MeshResolution::default());
    let surface = RoughDielectric { eta: spec.fiber.eta as f32, alpha: spec.fiber.alpha_fiber as f32 };
    let mut group = c.benchmark_group("walk");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).measurement_time(Duration::from_secs(5));
    group.throughput(Throughput::Elements(10_000));
    for (name, tracer) in [("screw march", &screw as &dyn Tracer), ("triangles in obvhs", &mesh)] {
        group.bench_function(format!("10 k paths at normal incidence, {name}"), |b| {
            b.iter_custom(|rounds| {
                let start = Instant::now();
                for round in 0..rounds {
                    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(round);
                    let bound = tracer.bound_radius_um();
                    for _ in 0..10_000 {
                        let x = bound * (2.0 * rng.random::<f32>() - 1.0);
                        let y = (bound * bound - x * x).max(0.0).sqrt();
                        let pos = nalgebra::Vector3::new(x, y, 800.0 * rng.random::<f32>());
                        std::hint::black_box(trace_path(tracer, &surface, pos, -nalgebra::Vector3::y(), &mut rng));
                    }
                }
                start.elapsed()
            })
        });
    }
    group.finish();
}

criterion_group!(benches, paths_per_second, walk_alone);
criterion_main!(benches);
