//! Slits between the fibers of a fabric's yarns (Yu 2025, 7.3): requested by the spec or by options; a slit
//! transmits the light that it removes from a ply, and samples cover it.

use plywave::check::check_bsdf;
use plywave::fabric::{ColorOf, FabricBsdf, FabricOptions, FabricSpec, Slits, YarnColor, YarnSet};
use plywave::frame::direction;
use plywave::gap::SLIT_SHARE;
use plywave::io::Folder;
use plywave::{Bsdf, BsdfSample, FabricModel, FabricQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;
use std::path::Path;
use std::sync::OnceLock;

const LAMBDA: [f32; 3] = [0.45, 0.55, 0.65];
/// Each yarn alone, without inter-yarn scattering.
const ALONE: FabricOptions = FabricOptions { layers: false, shadowing: false, ..FabricOptions::SMOOTH };

/// An open plain weave of silk, with more keys of the warp's yarns.
fn spec(more: &str) -> String {
    let yarn = "model = \"models/silk.pwm\"\nspacing_um = 200.0\ncrimp = 0.5\nsigma_per_um = 0.002\n";
    format!("name = \"open\"\n[weave]\nkind = \"plain\"\n[warp]\n{yarn}{more}\n[weft]\n{yarn}")
}

/// Without slits, loaded once.
fn plain() -> &'static FabricModel {
    static PLAIN: OnceLock<FabricModel> = OnceLock::new();
    PLAIN.get_or_init(|| fabric("", &ALONE))
}

fn fabric(more: &str, options: &FabricOptions) -> FabricModel {
    let folder = format!("{}/fabrics", env!("CARGO_MANIFEST_DIR"));
    let loaded = FabricSpec::load_from(&spec(more), "open", &Folder::new(Path::new(&folder))).unwrap();
    FabricModel::new(loaded, options).unwrap()
}

fn with(width_um: f32, share: f32) -> Option<Slits> {
    Some(Slits { width_um, share })
}

/// A viewer within 60 degrees of either normal.
fn viewer(rng: &mut Pcg64Mcg) -> [f32; 3] {
    let z = 0.5 + 0.5 * rng.random::<f32>();
    let w = direction(z.asin(), TAU * rng.random::<f32>());
    if rng.random::<bool>() { w } else { [w[0], w[1], -w[2]] }
}

/// The beam's case: a gap, one layer, two.
fn case(at: &FabricBsdf<'_, 3>) -> usize {
    if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) }
}

/// Two layers are unchanged; with one layer, some transmitted light is in the slit's pattern, whose color
/// depends on the direction.
#[test]
#[ignore = "slow: 5 s: slits color one layer alone"]
fn slits_color_one_layer_alone() {
    let (plain, slit) = (plain(), fabric("", &FabricOptions { slits: with(2.0, SLIT_SHARE), ..ALONE }));
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (mut seen, mut reds) = ([0u32; 3], [0u32; 2]);
    for _ in 0..4000 {
        let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
        let (wo, turn, off) = ([0.0, 0.0, 1.0], TAU * rng.random::<f32>(), 0.4 * rng.random::<f32>());
        let wi = [off * turn.cos(), off * turn.sin(), -(1.0 - off * off).sqrt()];
        let query = FabricQuery::new(point, wo, LAMBDA);
        let (a, b) = (plain.at(&query), slit.at(&query));
        assert_eq!(a.albedo(), b.albedo());
        seen[case(&a)] += 1;
        let (f, g) = (a.eval(wi), b.eval(wi));
        match case(&a) {
            2 => assert_eq!(f, g, "two layers at {point:?}"),
            1 => {
                let ratio = (g[2] / f[2]) / (g[0] / f[0]);
                reds[0] += u32::from(ratio > 1.1);
                reds[1] += u32::from(ratio < 0.9);
            }
            _ => {}
        }
    }
    println!("gaps, one layer, two: {seen:?}; redder, bluer: {reds:?}");
    assert!(seen.iter().all(|n| *n > 200), "{seen:?}");
    assert!(reds.iter().all(|n| *n > 100), "redder and bluer of {}: {reds:?}", seen[1]);
}

/// Slits lose no light of clear fibers, nor of dyed ones: the light that leaves a point is the same as
/// without. Each ply alone: integrals over the sphere of samples.
#[test]
#[ignore = "slow: 15 s: slits keep the energy of a point"]
fn slits_keep_the_energy_of_a_point() {
    let slit = fabric("", &FabricOptions { slits: with(1.5, 1.0), ..ALONE });
    for sigma in [0.0, 0.01] {
        let slit = slit.with_colors([YarnColor::Sigma(sigma); 2], ColorOf::EvenSky);
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let mut checked = 0;
        while checked < 6 {
            let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
            let at = slit.at(&FabricQuery::new(point, viewer(&mut rng), LAMBDA));
            if case(&at) != 1 {
                continue;
            }
            checked += 1;
            let r = check_bsdf(&at, [0.006, 0.012], 20_000, &mut || rng.random());
            assert!(r.furnace_error < 3e-3 && r.pdf_error < 3e-3, "{r:?}");
            // The tabulated density of a slit has steps, where a direction transformed through two frames may
            // be on the other side.
            assert!(r.weight_error < 0.05 && r.sampled_furnace_se < 5.0 && r.chi2_p > 1e-3, "{r:?}");
            let (mut error, mut peak, mut steps) = (0.0f32, 0.0f32, 0);
            for _ in 0..5000 {
                let Some(s) = at.sample(rng.random()).direction().copied() else { continue };
                let (f, pdf) = at.eval_pdf(s.w);
                peak = f.iter().fold(peak, |peak, f| peak.max(*f));
                (0..3).for_each(|k| error = error.max((s.weight[k] * s.pdf - f[k]).abs()));
                steps += u32::from((s.pdf - pdf).abs() > 1e-3 * pdf);
            }
            assert!(error < 1e-4 * peak && steps < 10, "weight times pdf off by {error} of {peak}, {steps} densities");
        }
    }
}

/// A clear cloth with slits conserves all light, its layers and shadows included.
#[test]
#[ignore = "slow: 15 s: clear cloth with slits is white"]
fn clear_cloth_with_slits_is_white() {
    const PLACES: usize = 40_000;
    let clear = FabricOptions { sigma_per_um: Some(0.0), ..FabricOptions::SMOOTH };
    for slits in [None, with(2.0, SLIT_SHARE), with(2.0, 1.0)] {
        let cloth = fabric("", &FabricOptions { slits, ..clear });
        for z in [1.0f32, 0.7, 0.4] {
            let mut rng = Pcg64Mcg::seed_from_u64(3);
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..PLACES {
                let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
                let wo = direction(z.asin(), TAU * rng.random::<f32>());
                let at = cloth.at(&FabricQuery::new(point, wo, LAMBDA));
                let weight = match at.sample(rng.random()) {
                    BsdfSample::Scattered(s) => f64::from(s.weight[1]),
                    BsdfSample::Straight { weight, .. } => f64::from(weight[1]),
                    BsdfSample::Absorbed => 0.0,
                };
                sum += weight;
                squares += weight * weight;
            }
            let n = PLACES as f64;
            let (mean, se) = (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt());
            println!("{slits:?} at {z}: {mean:.4} +- {se:.4}");
            assert!((mean - 1.0).abs() < 0.005 + 3.0 * se, "{slits:?} at {z}: {mean} +- {se}");
        }
    }
}

/// The spec's keys are the option for one family; a share of 0 in spec or option means no slits.
#[test]
#[ignore = "slow: 10 s: specs ask for slits"]
fn specs_ask_for_slits() {
    let (plain, both) = (plain(), fabric("", &FabricOptions { slits: with(3.0, 0.5), ..ALONE }));
    let warp = fabric("slit_um = 3.0\nslit_share = 0.5", &ALONE);
    let none = fabric("slit_um = 3.0\nslit_share = 0.5", &FabricOptions { slits: Some(Slits::NONE), ..ALONE });
    let zero = fabric("slit_um = 3.0\nslit_share = 0.0", &ALONE);
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let mut differ = [0u32; 2];
    for _ in 0..1500 {
        let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
        let (wo, wi) = (viewer(&mut rng), viewer(&mut rng));
        let query = FabricQuery::new(point, wo, LAMBDA);
        let f = plain.at(&query).eval(wi);
        assert_eq!(f, none.at(&query).eval(wi));
        assert_eq!(f, zero.at(&query).eval(wi));
        let plywave::fabric::Hit::Ply(hit) = plain.fabric().at(point[0], point[1], wo) else { continue };
        let (g, h) = (warp.at(&query).eval(wi), both.at(&query).eval(wi));
        differ[hit.family as usize] += u32::from(g != f);
        if hit.family == YarnSet::Warp && g != h {
            // Rims of the weft have slits in the one and none in the other.
            assert!((0..3).all(|k| (g[k] - h[k]).abs() < 0.2 * (g[k] + h[k]) + 1e-3), "{g:?} {h:?}");
        }
    }
    assert!(differ[0] > 100 && 5 * differ[1] < differ[0], "points that differ, warp and weft: {differ:?}");
    let spec = FabricSpec::parse(&spec("slit_um = 2.5"), "open").unwrap();
    assert_eq!(spec.warp.slits(), with(2.5, SLIT_SHARE));
    assert_eq!(spec.weft.slits(), None);
}

#[test]
fn slits_that_cannot_be_are_refused_in_a_line() {
    for (more, key) in [
        ("slit_um = 0.0", "warp.slit_um = 0"),
        ("slit_um = 6.0", "warp.slit_um = 6"),
        ("slit_um = 2.0\nslit_share = 1.5", "warp.slit_share = 1.5"),
        ("slit_share = 0.2", "warp.slit_share = 0.2: give slit_um"),
    ] {
        let said = FabricSpec::parse(&spec(more), "open.toml").unwrap_err().to_string();
        assert!(said.starts_with("open.toml: ") && said.contains(key) && !said.contains('\n'), "{said}");
    }
    let folder = format!("{}/fabrics", env!("CARGO_MANIFEST_DIR"));
    for (slits, key) in
        [(with(9.0, 0.2), "width_um = 9"), (with(f32::NAN, 0.2), "width_um"), (with(1.0, -0.1), "share")]
    {
        let loaded = FabricSpec::load_from(&spec(""), "open", &Folder::new(Path::new(&folder))).unwrap();
        let said = FabricModel::new(loaded, &FabricOptions { slits, ..ALONE }).unwrap_err().to_string();
        assert!(said.contains(key) && !said.contains('\n'), "{said}");
    }
}
