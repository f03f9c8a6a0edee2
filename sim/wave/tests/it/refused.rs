//! What waves and rays do not share is refused in one line.

use plywave::optics::Metal;
use plywave::spec::{POLYESTER, YarnSpec};
use plywave_wave::{CompareJob, CompareOptions, SingleFiber};

fn yarn(fiber: &str) -> YarnSpec {
    let start = POLYESTER.find("[fiber]").unwrap();
    let end = POLYESTER.find("[ply]").unwrap();
    let text = format!(
        "{}[fiber]\n{fiber}\nsize_jitter = 0.03\nalpha_fiber = 0.2\n\n{}",
        &POLYESTER[..start],
        &POLYESTER[end..]
    );
    YarnSpec::parse(&text, "yarn").unwrap_or_else(|e| panic!("{e}"))
}

/// Comparisons of plies with waves, single fibers by rays, an absorption for a metal.
#[test]
fn what_rays_and_waves_do_not_share_is_refused() {
    let says = |message: String, what: &str| {
        assert!(message.contains(what) && message.lines().count() == 1, "{message:?} does not say {what:?}");
    };
    let gold = yarn("shape = { kind = \"circle\", radius_um = 7.5 }\nmetal = \"gold\"");
    let filled = yarn("shape = { kind = \"hollow_circle\", radius_um = 7.5, lumen = 0.5, lumen_eta = 1.3 }\neta = 1.6");
    let text = toml::to_string(&gold).unwrap();
    for (spec, what) in [(gold, "an opaque fiber"), (filled, "a filled core")] {
        let error = CompareJob::new(&spec, "", &CompareOptions::default()).map(|_| ()).unwrap_err();
        says(error.to_string(), what);
    }
    let error = SingleFiber::parse(&text, "gold.toml", 0.01).unwrap_err();
    says(error.to_string(), "sigma = 0.01: an opaque fiber has its own");
    let body = SingleFiber::parse(&text, "gold.toml", 0.0).unwrap().at(0.65);
    assert_eq!([body.eta, body.kappa], Metal::Gold.index(0.65).map(f64::from));
}
