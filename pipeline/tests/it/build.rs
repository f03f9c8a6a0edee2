//! The pipeline on a tiny ply: one call against its stages, progress, and a stopped run that resumes to the
//! same model.

use plywave::spec::YarnSpec;
use plywave_pipeline::*;
use plywave_runs::{Found, PartsFolder};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

const TINY: &str = "name = \"tiny\"\n[fiber]\nshape = { kind = \"circle\", radius_um = 7.5 }\neta = 1.58\nalpha_fiber = 0.2\n\
    [ply]\nfibers = 12\nradius_um = 40.0\nfiber_pitch_um = 800.0\n[absorption]\nsigma_per_um = [0.0, 0.01, 0.1]\n\
    [simulation]\ninstances = 2\npaths_per_theta = 6000\ntheta_i_nodes = 3\nh_nodes = 5\ntheta_o_bins = 12\nphi_o_bins = 24\nlobes_refl = 1\n\
    lobes_high = 2\n";

fn recipe() -> Recipe {
    let spec = YarnSpec::parse(TINY, "tiny.toml").unwrap();
    Recipe { seed: 3, speckle: Speckle::Solve(4), ..Recipe::new("tiny.toml", spec, TINY, Quality::Preview) }
}

#[test]
#[ignore = "slow: 15 s: one call is its stages"]
fn one_call_is_its_stages() {
    let recipe = recipe();
    let stages = Mutex::new(Vec::new());
    let tell = |p: Progress| {
        assert!(p.done <= p.total.max(1), "{p:?}");
        let mut stages = stages.lock().unwrap();
        if stages.last() != Some(&p.stage) {
            stages.push(p.stage);
        }
    };
    let built = build(&recipe, &Run { progress: Some(&tell), ..Run::plain() }).unwrap();
    let stages = stages.into_inner().unwrap();
    assert_eq!((stages.first(), stages.last()), (Some(&Stage::Simulate), Some(&Stage::Speckle)));
    assert!(stages.contains(&Stage::FitHigh) && stages.contains(&Stage::FitReflection));

    let (run, file) = (Run::plain(), "tiny.toml");
    let table = simulate(&recipe, &run).unwrap();
    assert_eq!(table, built.table);
    assert!(yarn_table(&table, &recipe.spec, file, &run).unwrap().is_none());
    let mut model = fit_model(&table, &recipe.spec, &recipe.quality.fit(), file, &run).unwrap();
    assert_eq!((model.lobes_refl, model.lobes_high, model.noise.is_none()), (1, 2, true));
    let patterns = solve_speckle(&recipe.spec, TINY, &speckle_options(&recipe, Some(4)), file, &run).unwrap();
    add_speckle(&mut model, &patterns, &recipe.spec, file).unwrap();
    assert_eq!(model, built.model);
    // So few lobes are a bad fit, by the model's errors.
    let quality = FitQuality::from_data(&model);
    assert!(quality.refl > 0.2 && quality.high > 0.15 && !quality.is_within(&FitQuality::good()), "{quality:?}");
    assert!(quality.is_within(&FitQuality { refl: 9.0, high: 9.0 }));
}

#[test]
#[ignore = "slow: 8 s: stopped builds go on"]
fn stopped_builds_go_on() {
    let recipe = Recipe { speckle: Speckle::None, ..recipe() };
    let want = build(&recipe, &Run::plain()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("t.parts");
    let parts = PartsFolder::open(&folder, Found::Refuse).unwrap();
    let stop = AtomicBool::new(false);
    let halt = |p: Progress| stop.store(p.done > p.total / 3, Ordering::Relaxed);
    let run = Run { parts: Some(&parts), stop: Some(&stop), progress: Some(&halt), ..Run::plain() };
    let stopped = build(&recipe, &run).err();
    assert!(matches!(stopped, Some(Error::Interrupted { left: 1.., total: 24 })), "{stopped:?}");
    drop(parts);
    // Checked before any work.
    let parts = PartsFolder::open(&folder, Found::Refuse).unwrap();
    let unasked = build(&recipe, &Run { parts: Some(&parts), ..Run::plain() }).err();
    assert!(matches!(unasked, Some(Error::Parts(_))), "{unasked:?}");
    drop(parts);
    let parts = PartsFolder::open(&folder, Found::Resume).unwrap();
    let resumed = build(&recipe, &Run { parts: Some(&parts), ..Run::plain() }).unwrap();
    assert!(resumed.table == want.table && resumed.model == want.model);
    // A spec without a changed key.
    let unknown = Recipe::changed("tiny.toml", TINY, &[("colour", "1".into())], Quality::Preview);
    assert!(matches!(unknown, Err(Error::NoSuchKey { ref key, .. }) if key == "colour"), "{unknown:?}");
}
