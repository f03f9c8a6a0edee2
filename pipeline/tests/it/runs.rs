//! Every kind of job in shares, merged from the parts' own descriptions, equals the same job in one run to
//! the bit.

use plywave::spec::YarnSpec;
use plywave_fiber::FiberSource;
use plywave_pipeline::{Output, merge_parts};
use plywave_runs::{Job, Parts, Run, run, run_part};
use plywave_sim::{SimError, SimOptions, SimulateJob};
use plywave_wave::{
    Absorption, CompareJob, CompareOptions, ScatterJob, Scene, SingleFiber, SpeckleJob, SpeckleOptions, TabulateJob,
    TabulateOptions,
};

const SPEC: &str = "name = \"thin\"\n[fiber]\nshape = { kind = \"circle\", radius_um = 1.0 }\nsize_jitter = 0.1\neta = 1.5\nalpha_fiber = 0.2\n\
    [ply]\nfibers = 3\nradius_um = 4.0\n[beam]\nw0_um = 2.0\n[yarn]\nplies = 2\n";
const SCENE: &str = "lambda_um = [0.7, 0.5, 0.6]\ntheta_i_deg = [0, 20]\nphi_i_deg = [0, 30]\nn_phi_out = 12\n\
    [[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.5\n";

fn spec() -> YarnSpec {
    YarnSpec::parse(SPEC, "thin.toml").unwrap()
}

/// The output of shares of `count`, run backwards and given out of order.
fn merged<J: Job>(job: &J, count: usize) -> Output {
    let dir = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for k in (1..=count).rev() {
        let path = dir.path().join(format!("{k}.pwp"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1 + k % 3).build().unwrap();
        pool.install(|| run_part(job, (k, count), &path, Run::plain())).unwrap();
        files.push(path);
    }
    files.rotate_left(count / 2);
    merge_parts(&Parts::open(&files).unwrap()).unwrap()
}

#[test]
fn simulations() {
    let small = SimOptions {
        paths_per_theta: 600,
        theta_i_nodes: 3,
        theta_o_bins: 8,
        phi_o_bins: 12,
        instances: 3,
        shards: 5,
        h_nodes: 5,
        ..SimOptions::preview()
    };
    for traced_plies in [false, true] {
        let job = SimulateJob::new(&spec(), SPEC, &SimOptions { traced_plies, ..small.clone() }).unwrap();
        let whole = run(&job, Run::plain()).unwrap();
        assert_eq!((whole.traced, whole.exit.is_none()), (traced_plies, traced_plies));
        // Shares that cut groups anywhere.
        for count in [1, 2, 4, 15] {
            let Output::Table(table) = merged(&job, count) else { panic!("no table") };
            assert_eq!(*table, whole, "{count} shares");
        }
    }
}

#[test]
fn fiber_tables() {
    let options = TabulateOptions { lambdas: 2, thetas: 7, rays: 40, ..TabulateOptions::preview() };
    let fiber = SingleFiber::of_spec(&spec().fiber, Absorption::Sigma(0.01));
    for source in [FiberSource::Wave, FiberSource::Ray] {
        let job = TabulateJob::new(&fiber, SPEC, &options, source).unwrap();
        let whole = run(&job, Run::plain()).unwrap();
        let Output::Fiber(table) = merged(&job, 2) else { panic!("no fiber") };
        assert_eq!(*table, whole, "{source:?}");
    }
}

#[test]
fn speckle_comparisons_and_scenes() {
    let options = SpeckleOptions { instances: 4, lambda_um: vec![0.6], w0_um: 30.0, ..SpeckleOptions::default() };
    let job = SpeckleJob::new(&spec(), SPEC, &options).unwrap();
    let Output::Speckle(patterns) = merged(&job, 3) else { panic!("no patterns") };
    assert_eq!(*patterns, run(&job, Run::plain()).unwrap());

    let options = CompareOptions { instances: 3, lambda_um: vec![0.5, 0.7], paths: 500, ..CompareOptions::default() };
    let job = CompareJob::new(&spec(), SPEC, &options).unwrap();
    let Output::Compare(report) = merged(&job, 4) else { panic!("no report") };
    assert_eq!(*report, run(&job, Run::plain()).unwrap());

    let job = ScatterJob::new(&Scene::parse(SCENE).unwrap(), SCENE);
    let Output::Scatter(report) = merged(&job, 4) else { panic!("no scene") };
    let whole = run(&job, Run::plain()).unwrap();
    assert_eq!(report.cases, whole.cases);
    assert_eq!((report.stats.method, report.stats.unknowns), (whole.stats.method, whole.stats.unknowns));
}

/// The predicted standard error is that of the runs, and the number of paths in the error's hint is enough.
#[test]
fn too_few_paths_are_told_ahead() {
    let text = SPEC.replace("radius_um = 4.0", "radius_um = 60.0");
    let spec = YarnSpec::parse(&text, "wide.toml").unwrap();
    let job = |paths| {
        let options = SimOptions { paths_per_theta: paths, instances: 32, ..SimOptions::preview() };
        SimulateJob::new(&spec, &text, &options).unwrap().check_savable()
    };
    let refused = job(100);
    let Err(SimError::TooFewPaths { paths: 100, error, least }) = refused else { panic!("{refused:?}") };
    assert!(error > 0.05 && least > 100, "{error} {least}");
    job(least).unwrap();
    assert!(job(least / 2).is_err());
}
