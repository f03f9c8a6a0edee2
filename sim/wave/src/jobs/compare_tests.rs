//! Tests of the comparison of waves and rays on fibers of known scattering; threads, stops and longer runs.

use crate::jobs::compare::*;
use crate::jobs::similarity::{coarser, correlation};
use crate::{Body, MieSolver, Scattered, Solver, SolverStats, Source, Wave, WaveError, WaveSolver};
use plywave::spec::YarnSpec;
use plywave_runs::RunError;
use plywave_runs::{self as runs, Found, PartsFolder, Run};
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

const ONE: &str = "name = \"one\"\n[fiber]\nshape = { kind = \"circle\", radius_um = 4.0 }\nsize_jitter = 0.05\neta = 1.5\nalpha_fiber = 0.2\n\
    [ply]\nfibers = 1\nradius_um = 6.0\n[beam]\nw0_um = 4.0\n";

fn options() -> CompareOptions {
    CompareOptions {
        instances: 3,
        lambda_um: vec![0.5, 0.7],
        h_rel: vec![0.0, 0.8],
        paths: 20_000,
        tolerance: 1e-8,
        ..CompareOptions::default()
    }
}

fn mie(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    Ok(Box::new(MieSolver::new(&bodies[0], wave, tolerance)?))
}

fn compare_with(
    spec: &YarnSpec,
    text: &str,
    options: &CompareOptions,
    run: Run<'_>,
    solver: &MakeSolver<'_>,
) -> Result<CompareReport, RunError> {
    runs::run(&CompareJob::with_solver(spec, text, options, solver)?, run)
}

/// Clear fibers: both optics conserve the beam's power, waves to the solver's accuracy; the missed share is
/// that of rays. With absorption both have less.
#[test]
fn energies_add_up() {
    let spec = YarnSpec::parse(ONE, "one.toml").unwrap();
    let clear = compare_with(&spec, ONE, &options(), Run::plain(), &mie).unwrap();
    assert_eq!(clear.cases.len(), 4);
    for case in &clear.cases {
        let e = &case.energies;
        assert!((e.wave_total.min - 1.0).abs() < 1e-7 && (e.wave_total.max - 1.0).abs() < 1e-7, "{e:?}");
        let rays = e.ray_miss.mean + e.ray_refl.mean + e.ray_high.mean + e.ray_killed.mean;
        assert!((rays - 1.0).abs() < 1e-9, "{rays}");
        assert!((e.wave_scattered.mean + e.wave_absorbed.mean - e.wave_extinguished.mean).abs() < 1e-7);
        // The curves hold the same energy.
        let mean: f64 = case.curves.wave_mean.iter().sum::<f64>() * TAU / case.curves.wave_mean.len() as f64;
        assert!((mean - 1.0).abs() < 1e-7, "{mean}");
    }
    let dark = CompareOptions { sigma_per_um: 0.05, ..options() };
    let dark = compare_with(&spec, ONE, &dark, Run::plain(), &mie).unwrap();
    for case in &dark.cases {
        let e = &case.energies;
        let (wave, ray) = (1.0 - e.wave_total.mean, 1.0 - e.ray_miss.mean - e.ray_refl.mean - e.ray_high.mean);
        assert!((wave - e.wave_absorbed.mean).abs() < 1e-7, "{wave} {e:?}");
        // Ray optics of a fiber eight wavelengths thick absorbs as much, up to the noise of three times 20000
        // rays.
        assert!((wave / ray - 1.0).abs() < 0.1, "waves absorb {wave}, rays {ray}");
    }
}

/// A fiber of hundreds of wavelengths in coarse bins agrees with rays: tests the whole chain from section to
/// similarity, with angles, sides and offsets.
#[test]
fn thick_fibers_are_ray_optics() {
    let text = ONE.replace("radius_um = 4.0", "radius_um = 40.0").replace("radius_um = 6.0", "radius_um = 52.0");
    let text = text.replace("w0_um = 4.0", "w0_um = 10.0");
    let spec = YarnSpec::parse(&text, "thick.toml").unwrap();
    let thick =
        CompareOptions { instances: 4, lambda_um: vec![0.4], h_rel: vec![0.0, 0.5, -0.5], paths: 200_000, ..options() };
    let report = compare_with(&spec, &text, &thick, Run::plain(), &mie).unwrap();
    for case in &report.cases {
        let coarse = &case.resolutions[3];
        assert!(
            coarse.average.correlation > 0.999 && coarse.average.relative_l2 < 0.05,
            "h {}: {:?}",
            case.h_rel,
            coarse.average
        );
    }
    // Sides matter: rays at -h are not waves at h.
    let [a, b] = [1, 2].map(|k| &report.cases[k].curves);
    let [a, b] = [(&a.wave_mean, &b.ray_mean), (&b.wave_mean, &a.ray_mean)]
        .map(|(w, r)| correlation(&coarser(w, 20), &coarser(r, 20)));
    assert!(a < 0.9 && b < 0.9, "{a} {b}");
}

/// Threads, a stop and a longer run later change nothing.
#[test]
fn threads_stops_and_more_instances_do_not_matter() {
    let spec = YarnSpec::parse(ONE, "one.toml").unwrap();
    let whole = |threads: usize, run: Run<'_>, options: &CompareOptions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| compare_with(&spec, ONE, options, run, &mie))
    };
    let options = CompareOptions { paths: 2000, ..options() };
    let want = whole(1, Run::plain(), &options).unwrap();
    assert_eq!(whole(3, Run::plain(), &options).unwrap(), want);

    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().join("r.parts");
    let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
    let halt = |jobs: u64| {
        if done.fetch_add(jobs, Ordering::Relaxed) + jobs >= 2 {
            stop.store(true, Ordering::Relaxed);
        }
    };
    let parts = PartsFolder::open(&parts, Found::Resume).unwrap();
    let run = Run { parts: Some(&parts), stop: Some(&stop), progress: Some(&halt) };
    let fewer = CompareOptions { instances: 2, ..options.clone() };
    assert!(matches!(whole(1, run, &fewer), Err(RunError::Interrupted { left: 2, total: 4 })));
    let again = Run { parts: Some(&parts), ..Run::plain() };
    assert_eq!(whole(2, again, &fewer).unwrap().instances, 2);
    assert_eq!(whole(2, again, &options).unwrap(), want);
}

/// A solver that loses a hundredth of the scattered light.
struct Leaky(Solver);

impl WaveSolver for Leaky {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let mut all = self.0.scatter(sources, n_phi_out)?;
        all.iter_mut().for_each(|s| s.c_sca_um *= 0.99);
        Ok(all)
    }

    fn stats(&self) -> SolverStats {
        self.0.stats()
    }
}

/// A solver that loses power is detected.
#[test]
fn lost_power_is_an_error() {
    let spec = YarnSpec::parse(ONE, "one.toml").unwrap();
    let options = CompareOptions { tolerance: 1e-4, ..options() };
    let solver = |bodies: &[Body], wave: &Wave, _: f64| -> Result<Solver, WaveError> {
        Ok(Box::new(Leaky(mie(bodies, wave, 1e-8)?)))
    };
    let error = compare_with(&spec, ONE, &options, Run::plain(), &solver).unwrap_err();
    assert!(matches!(error.job(), Some(WaveError::Ledger { .. })), "{error}");
}
