//! Khungurn's fiber model (2015) compared with its formulas in f64 and with closed forms, and the checks of
//! every model.

use plywave::frame::direction;
use plywave::{Bsdf, BsdfSample};
use plywave_check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{KhungurnFiber, KhungurnParameters, Reflectance};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const LAMBDA_UM: [f32; 3] = [0.61, 0.55, 0.465];

fn fiber(parameters: KhungurnParameters) -> FiberModel {
    KhungurnFiber::new(parameters).unwrap().into()
}

fn nodes(shares: [f32; 3]) -> Reflectance {
    Reflectance::Nodes((0..3).rev().map(|n| [LAMBDA_UM[n], shares[n]]).collect())
}

/// Red, and a wide R.
fn red() -> KhungurnParameters {
    KhungurnParameters {
        c_r: nodes([0.1, 0.05, 0.02]),
        c_tt: nodes([0.9, 0.3, 0.1]),
        beta_r: 0.3,
        ..Default::default()
    }
}

/// Integral of `f` by midpoints.
fn midpoints(from: f64, to: f64, n: u32, f: impl Fn(f64) -> f64) -> f64 {
    let step = (to - from) / f64::from(n);
    (0..n).map(|k| f(from + (f64::from(k) + 0.5) * step) * step).sum()
}

/// Section 2 of the note as printed, with G by quadrature and I_0 by its integral, times cos theta_o.
fn as_printed(p: &KhungurnParameters, n: usize, [theta_i, theta_o]: [f64; 2], turn: f64) -> f64 {
    let g = |x: f64, beta: f64| (-x * x / (2.0 * beta * beta)).exp();
    let lobe = |beta: f64| {
        let (low, high) = ((-theta_i - 12.0 * beta).max(-FRAC_PI_2), (-theta_i + 12.0 * beta).min(FRAC_PI_2));
        g(theta_o + theta_i, beta) / midpoints(low, high, 4000, |x| g(x + theta_i, beta) * x.cos().powi(2))
    };
    let kappa = 1.0 / f64::from(p.gamma_tt).powi(2);
    let bessel = midpoints(0.0, PI, 4000, |x| (kappa * (x.cos() - 1.0)).exp()) / PI;
    let v = (kappa * ((turn - PI).cos() - 1.0)).exp() / (TAU * bessel);
    let (c_r, c_tt) = (f64::from(p.c_r.at(LAMBDA_UM[n])), f64::from(p.c_tt.at(LAMBDA_UM[n])));
    let fresnel = c_r + (1.0 - c_r) * (1.0 - theta_i.cos()).powi(5);
    let sum = fresnel * lobe(f64::from(p.beta_r)) / TAU + (1.0 - fresnel) * c_tt * lobe(f64::from(p.beta_tt)) * v;
    sum * theta_o.cos()
}

#[test]
fn model_is_the_printed_one() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut peak = 0.0f64;
    for gamma_tt in [0.05, 0.4, 3.0] {
        let p = KhungurnParameters { gamma_tt, ..red() };
        let fiber = fiber(p.clone());
        for _ in 0..200 {
            let theta_i = 3.1 * rng.random::<f64>() - 1.55;
            let theta_o = (-theta_i + 1.0 * (rng.random::<f64>() - 0.5)).clamp(-1.55, 1.55);
            let (phi_i, turn) =
                (TAU * rng.random::<f64>(), PI + 4.0 * f64::from(gamma_tt) * (rng.random::<f64>() - 0.5));
            let at = fiber.at(&FiberQuery::new(direction(theta_i as f32, phi_i as f32), LAMBDA_UM));
            let got = at.eval(direction(theta_o as f32, (phi_i + turn) as f32));
            for n in 0..3 {
                let want = as_printed(&p, n, [theta_i, theta_o], turn);
                peak = peak.max(want);
                let got = f64::from(got[n]);
                assert!((got - want).abs() < 3e-4 * want + 1e-6, "{theta_i} {theta_o} {turn}: got {got}, want {want}");
            }
        }
    }
    assert!(peak > 5.0, "the lobes were met: {peak}");
}

/// Furnace, density, weight times pdf, sampled furnace, chi-square: at narrow and wide lobes, normal and
/// grazing light.
#[test]
fn khungurn_fibers_pass_the_checks() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let wide = KhungurnParameters { beta_r: 10.0, beta_tt: 0.8, gamma_tt: 1000.0, ..red() };
    let narrow = KhungurnParameters { beta_r: 0.02, beta_tt: 0.03, gamma_tt: 0.05, ..red() };
    let glass = KhungurnParameters { c_r: 0.0.into(), c_tt: 1.0.into(), ..Default::default() };
    for (j, p) in [KhungurnParameters::default(), red(), wide, narrow, glass].into_iter().enumerate() {
        let fiber = fiber(p.clone());
        for (k, theta) in [0.0, 0.6, -1.2, 1.5, 1.57f32].into_iter().enumerate() {
            let query = FiberQuery::new(direction(theta, 6.0 * rng.random::<f32>()), LAMBDA_UM);
            let at = fiber.at(&query);
            let mut draws = Pcg64Mcg::seed_from_u64((10 * j + k) as u64);
            let sd = [p.beta_r.min(p.beta_tt).min(0.3), p.gamma_tt.min(0.3)].map(f64::from);
            let r = check_bsdf(&at, sd, 20_000, &mut || draws.random());
            let what = format!("{p:?}, theta_i {theta}: albedo {:?}, {r:?}", at.albedo());
            assert!(r.furnace_error < FURNACE_TOLERANCE && r.pdf_error < FURNACE_TOLERANCE, "{what}");
            assert!(r.weight_error < WEIGHT_TOLERANCE && r.sampled_furnace_se < SAMPLED_TOLERANCE_SE, "{what}");
            assert!(r.chi2_p > 1e-4, "{what}");
            let (f, c) = (f64::from(p.c_r.at(LAMBDA_UM[0])), f64::from(p.c_tt.at(LAMBDA_UM[0])));
            let f = f + (1.0 - f) * (1.0 - f64::from(theta).cos()).powi(5);
            assert!((f64::from(at.albedo()[0]) - f - (1.0 - f) * c).abs() < 1e-5, "{what}");
            if j == 4 {
                assert!((at.albedo()[0] - 1.0).abs() < 1e-6, "{what}");
            }
        }
    }
}

/// The model is not reciprocal, as the module says: of two directions swapped, f / cos theta_o differs by
/// more than rounding.
#[test]
fn swapped_directions_differ() {
    let fiber = fiber(red());
    let f = |a: [f32; 3], b: [f32; 3], cos: f32| fiber.at(&FiberQuery::new(a, LAMBDA_UM)).eval(b)[0] / cos;
    let (a, b) = (direction(1.0, 0.0), direction(-0.7, 3.0));
    let [there, back] = [f(a, b, 0.7f32.cos()), f(b, a, 1.0f32.cos())];
    assert!((there / back - 1.0).abs() > 0.1, "{there} {back}");
}

#[test]
fn any_numbers_are_answered_and_bad_parameters_refused() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1.0, -1.0, 1e30, -1e-30, 0.5, 2.0];
    let fibers = [
        fiber(red()),
        fiber(KhungurnParameters { beta_r: 0.005, beta_tt: 10.0, gamma_tt: 0.01, ..Default::default() }),
        fiber(KhungurnParameters { c_r: 0.0.into(), c_tt: 0.0.into(), ..Default::default() }),
    ];
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut any = || bad[(rng.random::<f32>() * bad.len() as f32) as usize];
    for k in 0..20_000 {
        let query = FiberQuery { h_rel: Some(any()), ..FiberQuery::new([any(), any(), any()], [any()]) };
        let at = fibers[k % fibers.len()].at(&query);
        let (f, pdf) = at.eval_pdf([any(), any(), any()]);
        assert!(f[0] >= 0.0 && f[0].is_finite() && pdf >= 0.0 && pdf.is_finite(), "{query:?}: {f:?} {pdf}");
        assert!(at.albedo()[0].is_finite() && at.width_um()[0].is_finite());
        if let BsdfSample::Scattered(s) = at.sample([any(), any(), any()]) {
            assert!(s.weight[0].is_finite() && s.pdf.is_finite() && s.w.iter().all(|x| x.is_finite()), "{s:?}");
        }
    }
    let black = fibers[2].at(&FiberQuery::new([1.0, 0.0, 0.0], LAMBDA_UM));
    assert_eq!(black.sample([0.5; 3]), BsdfSample::Absorbed);
    for (p, key) in [
        (KhungurnParameters { beta_r: 0.0, ..red() }, "beta_r"),
        (KhungurnParameters { beta_tt: f32::NAN, ..red() }, "beta_tt"),
        (KhungurnParameters { gamma_tt: -0.1, ..red() }, "gamma_tt"),
        (KhungurnParameters { c_r: (-0.1).into(), ..red() }, "c_r"),
        (KhungurnParameters { c_tt: nodes([0.5, -1.0, 0.2]), ..red() }, "c_tt"),
        (KhungurnParameters { c_tt: nodes([0.5, f32::INFINITY, 0.2]), ..red() }, "c_tt"),
        (KhungurnParameters { c_tt: Reflectance::Nodes(vec![]), ..red() }, "c_tt"),
        (KhungurnParameters { c_tt: Reflectance::Nodes(vec![[0.5, 0.1], [0.4, 0.1]]), ..red() }, "c_tt"),
        (KhungurnParameters { radius_um: f32::INFINITY, ..red() }, "radius_um"),
    ] {
        let line = KhungurnFiber::new(p).unwrap_err().to_string();
        assert!(line.starts_with(&format!("Khungurn fiber: {key} = ")) && !line.contains('\n'), "{line}");
    }
}

#[test]
fn reflectances_are_linear_between_nodes() {
    let r = nodes([0.9, 0.3, 0.1]);
    for (lambda, want) in [(0.3, 0.1), (0.465, 0.1), (0.5075, 0.2), (0.55, 0.3), (0.58, 0.6), (0.7, 0.9)] {
        assert!((r.at(lambda) - want).abs() < 1e-5, "{lambda}: {}", r.at(lambda));
    }
    let green = Reflectance::of_srgb([0.1, 0.6, 0.1]);
    assert!(green.at(0.54) > 2.0 * green.at(0.45) && green.at(0.54) > 2.0 * green.at(0.65));
}
