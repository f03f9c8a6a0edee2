//! Slits between the fibers of a cloth's yarns (Yu 2025, 7.3): requested by the spec or by options; a slit
//! transmits the light that it removes from a ply, and samples cover it.

use crate::small_cloth::{ALONE, RED_BLUE, cloth, with_keys};
use plywave::cloth::{ClothBsdf, ClothModel, ClothOptions, ColorOf, LineHits, Slits, YarnColor};
use plywave::frame::direction;
use plywave::gap::SLIT_SHARE;
use plywave::{Bsdf, BsdfSample, ClothQuery};
use plywave_check::check_bsdf;
use plywave_textile::ClothSpec;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::TAU;

const LAMBDA: [f32; 3] = [0.45, 0.55, 0.65];
const SIGMA: &str = "sigma_per_um = 0.002\n";

/// The small cloth, with more keys of the warp's yarns.
fn open(more: &str, options: &ClothOptions) -> ClothModel {
    cloth(&with_keys(&RED_BLUE, [&format!("{SIGMA}{more}"), SIGMA]), options)
}

fn with(width_um: f32, share: f32) -> Option<Slits> {
    Some(Slits { width_um, share })
}

/// Kind of the first yarn that the line to `wo` meets.
fn first_kind(cloth: &ClothModel, [x, y]: [f32; 2], wo: [f32; 3]) -> Option<u32> {
    let way = (cloth.lines().half_thickness_um() + 1.0) / wo[2].abs();
    let mut hits = LineHits::default();
    cloth.lines().hits([x + way * wo[0], y + way * wo[1], way * wo[2]], wo.map(|v| -v), &mut hits);
    let curves = &RED_BLUE.curves;
    Some(curves.yarns[curves.curves[hits.as_slice().first()?.curve as usize].yarn as usize].kind)
}

/// A viewer within 60 degrees of either normal.
fn viewer(rng: &mut Pcg64Mcg) -> [f32; 3] {
    let z = 0.5 + 0.5 * rng.random::<f32>();
    let w = direction(z.asin(), TAU * rng.random::<f32>());
    if rng.random::<bool>() { w } else { [w[0], w[1], -w[2]] }
}

/// The beam's case: a gap, one layer, two.
fn case(at: &ClothBsdf<'_, 3>) -> usize {
    if at.is_gap() { 0 } else { 1 + usize::from(at.is_double()) }
}

/// Two layers are unchanged; with one layer, some transmitted light is in the slit's pattern, whose color
/// depends on the direction.
#[test]
#[ignore = "slow: 5 s: slits color one layer alone"]
fn slits_color_one_layer_alone() {
    let (plain, slit) = (open("", &ALONE), open("", &ClothOptions { slits: with(2.0, SLIT_SHARE), ..ALONE }));
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (mut seen, mut reds) = ([0u32; 3], [0u32; 2]);
    for _ in 0..4000 {
        let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
        let (wo, turn, off) = ([0.0, 0.0, 1.0], TAU * rng.random::<f32>(), 0.4 * rng.random::<f32>());
        let wi = [off * turn.cos(), off * turn.sin(), -(1.0 - off * off).sqrt()];
        let query = ClothQuery::new(point, wo, LAMBDA);
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
    let slit = open("", &ClothOptions { slits: with(1.5, 1.0), ..ALONE });
    for sigma in [0.0, 0.01] {
        let slit = slit.with_colors([YarnColor::Sigma(sigma); 2], ColorOf::EvenSky);
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let mut checked = 0;
        while checked < 6 {
            let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
            let at = slit.at(&ClothQuery::new(point, viewer(&mut rng), LAMBDA));
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

/// A clear cloth conserves all light, its layers and shadows included. With slits it gains what light between
/// plies, which is traced without them, has too much: the limits are measured values, rounded up.
#[test]
#[ignore = "slow: 15 s: clear cloth with slits is white"]
fn clear_cloth_with_slits_is_white() {
    const PLACES: usize = 40_000;
    let clear = ClothOptions { sigma_per_um: Some(0.0), relief: false, ..ClothOptions::SMOOTH };
    for (slits, most) in [(None, 0.005), (with(2.0, SLIT_SHARE), 0.015), (with(2.0, 1.0), 0.05)] {
        let cloth = open("", &ClothOptions { slits, ..clear });
        for z in [1.0f32, 0.7, 0.4] {
            let mut rng = Pcg64Mcg::seed_from_u64(3);
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..PLACES {
                let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
                let wo = direction(z.asin(), TAU * rng.random::<f32>());
                let at = cloth.at(&ClothQuery::new(point, wo, LAMBDA));
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
            assert!((mean - 1.0).abs() < most + 3.0 * se, "{slits:?} at {z}: {mean} +- {se}");
        }
    }
}

/// The spec's keys are the option for one family; a share of 0 in spec or option means no slits.
#[test]
#[ignore = "slow: 10 s: specs ask for slits"]
fn specs_ask_for_slits() {
    let (plain, both) = (open("", &ALONE), open("", &ClothOptions { slits: with(3.0, 0.5), ..ALONE }));
    let warp = open("slit_um = 3.0\nslit_share = 0.5", &ALONE);
    let none = open("slit_um = 3.0\nslit_share = 0.5", &ClothOptions { slits: Some(Slits::NONE), ..ALONE });
    let zero = open("slit_um = 3.0\nslit_share = 0.0", &ALONE);
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let mut differ = [0u32; 2];
    for _ in 0..1500 {
        let point = rng.random::<[f32; 2]>().map(|u| 4000.0 * u);
        let (wo, wi) = (viewer(&mut rng), viewer(&mut rng));
        let query = ClothQuery::new(point, wo, LAMBDA);
        let f = plain.at(&query).eval(wi);
        assert_eq!(f, none.at(&query).eval(wi));
        assert_eq!(f, zero.at(&query).eval(wi));
        let Some(kind) = first_kind(&plain, point, wo) else { continue };
        let (g, h) = (warp.at(&query).eval(wi), both.at(&query).eval(wi));
        differ[kind as usize] += u32::from(g != f);
        if kind == 0 && g != h {
            // Rims of the weft have slits in the one and none in the other.
            assert!((0..3).all(|k| (g[k] - h[k]).abs() < 0.2 * (g[k] + h[k]) + 1e-3), "{g:?} {h:?}");
        }
    }
    assert!(differ[0] > 100 && 5 * differ[1] < differ[0], "points that differ, warp and weft: {differ:?}");
    let spec = ClothSpec::parse(&crate::small_cloth::spec(["slit_um = 2.5", ""]), "open").unwrap();
    let slits: Vec<Option<Slits>> = spec.yarns().iter().map(|yarn| yarn.slits).collect();
    assert_eq!(slits, [with(2.5, SLIT_SHARE), None]);
}

#[test]
fn slits_that_cannot_be_are_refused_in_a_line() {
    for (more, key) in [
        ("slit_um = 0.0", "warp.slit_um = 0"),
        ("slit_um = 6.0", "warp.slit_um = 6"),
        ("slit_um = 2.0\nslit_share = 1.5", "warp.slit_share = 1.5"),
        ("slit_share = 0.2", "warp.slit_share = 0.2: give slit_um"),
    ] {
        let text = crate::small_cloth::spec([more, ""]);
        let said = ClothSpec::parse(&text, "open.toml").unwrap_err().to_string();
        assert!(said.starts_with("open.toml: ") && said.contains(key) && !said.contains('\n'), "{said}");
    }
    for (slits, key) in
        [(with(9.0, 0.2), "width_um = 9"), (with(f32::NAN, 0.2), "width_um"), (with(1.0, -0.1), "share")]
    {
        let said = ClothModel::from_data(RED_BLUE.clone(), &ClothOptions { slits, ..ALONE }).unwrap_err().to_string();
        assert!(said.contains(key) && !said.contains('\n'), "{said}");
    }
}
