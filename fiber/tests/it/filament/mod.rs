//! Analytic models of single fibers (Zinke 2007). Chain of trust: frames are compared with vectors and
//! differences, reflectances with the formulas in three dimensions, paths of a smooth cylinder with a walk by
//! vectors, and the far field with its histogram and with the mean of the near field; every model passes the
//! checks of `check_bsdf`.

mod corners;
mod frames;
mod kajiya_kay;
mod normalize;
mod opaque;
mod paths;
mod rough;
mod smooth;
mod spec;

use plywave::frame::direction;
use plywave::optics::Metal;
use plywave::{Bsdf, BsdfSample};
use plywave_check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave_fiber::azimuthal::CrossSection;
use plywave_fiber::{
    DielectricFiber, DielectricParameters, KajiyaKayFiber, KajiyaKayParameters, Mirror, OpaqueFiber, OpaqueParameters,
    RoughDielectricFiber, RoughDielectricParameters,
};
use plywave_fiber::{FiberModel, FiberQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

fn dielectric(parameters: DielectricParameters) -> DielectricFiber {
    DielectricFiber::new(parameters).unwrap()
}
fn opaque(parameters: OpaqueParameters) -> OpaqueFiber {
    OpaqueFiber::new(parameters).unwrap()
}

fn rough(parameters: RoughDielectricParameters) -> RoughDielectricFiber {
    RoughDielectricFiber::new(parameters).unwrap()
}

/// The checks of every model: furnace, density, weight times pdf, sampled furnace, chi-square.
fn check<const N: usize>(bsdf: &impl Bsdf<N>, sd_rad: [f64; 2], furnace: f64, seed: u64, what: &str) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let r = check_bsdf(bsdf, sd_rad, 20_000, &mut || rng.random());
    let what = format!("{what}: albedo {:?}, {r:?}", bsdf.albedo());
    assert!(r.furnace_error < furnace && r.pdf_error < furnace, "{what}");
    assert!(r.weight_error < WEIGHT_TOLERANCE && r.sampled_furnace_se < SAMPLED_TOLERANCE_SE, "{what}");
    assert!(r.chi2_p > 1e-4, "{what}");
}

/// Queries that cover latitudes and absorptions; with and without offset.
fn queries(seed: u64, offsets: &[Option<f32>]) -> Vec<FiberQuery<3>> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut all = Vec::new();
    for theta in [0.0, 0.6, -1.2, 1.5f32] {
        for h_rel in offsets {
            let omega_i = direction(theta, 6.0 * rng.random::<f32>());
            let query = FiberQuery::new(omega_i, [0.61, 0.55, 0.465]);
            all.push(FiberQuery { h_rel: *h_rel, sigma_per_um: [0.0, 0.01, 0.2], ..query });
        }
    }
    all
}

/// No input gives NaN.
#[test]
fn any_numbers_are_answered() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1.0, -1.0, 1e30, -1e-30, 0.5, 2.0];
    let plastic = OpaqueParameters { mirror: Mirror::Dielectric(1.5), diffuse: 0.5, ..Default::default() };
    let fibers: [FiberModel; 6] = [
        KajiyaKayFiber::new(KajiyaKayParameters::default()).unwrap().into(),
        rough(RoughDielectricParameters::default()).into(),
        rough(RoughDielectricParameters { width_phi: [0.0; 3], k_d: 0.01, ..Default::default() }).into(),
        dielectric(DielectricParameters::default()).into(),
        opaque(OpaqueParameters::default()).into(),
        opaque(plastic).into(),
    ];
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    let mut any = || bad[(rng.random::<f32>() * bad.len() as f32) as usize];
    for k in 0..30_000 {
        let fiber = &fibers[k % fibers.len()];
        let h_rel = [None, Some(any())][usize::from(any() > 0.5)];
        let query = FiberQuery { omega_i: [any(), any(), any()], h_rel, lambda_um: [any()], sigma_per_um: [any()] };
        let at = fiber.at(&query);
        let (f, pdf) = at.eval_pdf([any(), any(), any()]);
        assert!(f[0] >= 0.0 && f[0].is_finite() && pdf >= 0.0 && pdf.is_finite(), "{query:?}: {f:?} {pdf}");
        assert!(at.albedo()[0].is_finite(), "{query:?}");
        if let BsdfSample::Scattered(s) = at.sample([any(), any(), any()]) {
            assert!(
                s.weight[0].is_finite() && s.pdf.is_finite() && s.w.iter().all(|x| x.is_finite()),
                "{query:?}: {s:?}"
            );
        }
    }
    for p in [
        DielectricParameters { eta: 0.9, ..Default::default() },
        DielectricParameters { eta: f32::NAN, ..Default::default() },
        DielectricParameters { radius_um: 0.0, ..Default::default() },
        DielectricParameters { beta_m: [0.1, 0.0, 0.1], ..Default::default() },
        DielectricParameters { beta_n: 0.0, ..Default::default() },
        DielectricParameters { orders: 0, ..Default::default() },
    ] {
        let line = DielectricFiber::new(p).unwrap_err().to_string();
        assert!(line.starts_with("dielectric fiber: ") && !line.contains('\n'), "{line}");
    }
}
