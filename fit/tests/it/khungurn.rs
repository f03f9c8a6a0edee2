//! Fits of Khungurn's model recover planted parameters from scattering, from a table, and from the
//! reflectance of a swatch; bad input is refused in one line.

use plywave::frame::direction;
use plywave_fiber::dual_scattering::{DualOptions, DualScattering};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{
    FiberSource, FiberTable, KhungurnFiber, KhungurnParameters, OpaqueFiber, OpaqueParameters, OutlineSymmetry,
    Reflectance, TabulatedFiber,
};
use plywave_fit::{KhungurnFitError, SwatchOptions, SwatchSample, fit_khungurn, fit_khungurn_swatch};
use std::f64::consts::{PI, TAU};

const LAMBDA_UM: [f64; 3] = [0.45, 0.55, 0.65];

fn nodes(shares: [f32; 3]) -> Reflectance {
    Reflectance::Nodes((0..3).map(|n| [LAMBDA_UM[n] as f32, shares[n]]).collect())
}

fn planted() -> KhungurnParameters {
    KhungurnParameters {
        c_r: nodes([0.03, 0.06, 0.12]),
        c_tt: nodes([0.15, 0.5, 0.9]),
        beta_r: 0.09,
        beta_tt: 0.23,
        gamma_tt: 0.52,
        ..Default::default()
    }
}

fn close(got: &KhungurnParameters, want: &KhungurnParameters, tolerance: f32) {
    for (name, got, want) in [
        ("beta_r", got.beta_r, want.beta_r),
        ("beta_tt", got.beta_tt, want.beta_tt),
        ("gamma_tt", got.gamma_tt, want.gamma_tt),
    ] {
        assert!((got / want - 1.0).abs() < tolerance, "{name}: {got}, planted {want}");
    }
    for lambda in LAMBDA_UM {
        for (name, got, want) in [("c_r", &got.c_r, &want.c_r), ("c_tt", &got.c_tt, &want.c_tt)] {
            let (got, want) = (got.at(lambda as f32), want.at(lambda as f32));
            assert!((got - want).abs() < tolerance, "{name} at {lambda}: {got}, planted {want}");
        }
    }
}

#[test]
fn planted_scattering_comes_back() {
    let target: FiberModel = KhungurnFiber::new(planted()).unwrap().into();
    let far = KhungurnParameters { beta_r: 0.5, beta_tt: 0.06, gamma_tt: 1.5, ..Default::default() };
    for start in [KhungurnParameters::default(), far] {
        let fit = fit_khungurn(&target, &LAMBDA_UM, &[0.0; 3], 1, &start).unwrap();
        println!("{} iterations, error {:.1e}: {:?}", fit.solution.iterations, fit.error, fit.parameters);
        assert!(fit.error < 1e-4, "{}", fit.error);
        close(&fit.parameters, &planted(), 1e-3);
    }
}

/// A table whose azimuths are R and TT of Khungurn's, with d'Eon's latitudes: the fit recovers the parameters
/// as far as two Gaussians represent M_0.
#[test]
fn planted_table_comes_back() {
    let (cells, gamma, beta) = (360, 0.6f64, 0.15);
    let kappa = 1.0 / (gamma * gamma);
    let raw: Vec<f64> = (0..cells)
        .map(|k| f64::from(k) / f64::from(cells) * TAU)
        .map(|x| (kappa * ((x - PI).cos() - 1.0)).exp())
        .collect();
    let sum: f64 = raw.iter().sum::<f64>() * TAU / f64::from(cells);
    let c_tt = [0.2, 0.5, 0.8];
    let slices = c_tt.map(|c| raw.iter().map(|v| (0.1 / TAU + 0.9 * c * v / sum) as f32).collect::<Vec<f32>>());
    let table = FiberTable {
        spec_text: String::new(),
        program_version: String::new(),
        preset: String::new(),
        seed: 0,
        source: FiberSource::Ray,
        symmetry: OutlineSymmetry::CIRCLE,
        beta_m: beta,
        lambda_um: LAMBDA_UM.to_vec(),
        theta_i: FiberTable::theta_nodes(1),
        phi_i: vec![0.0],
        width_um: vec![20.0],
        c_x_um: vec![20.0; 3],
        c_abs_um: c_tt.map(|c| 20.0 * (0.9 - 0.9 * c)).to_vec(),
        azimuthal: slices.concat(),
    };
    let target: FiberModel = TabulatedFiber::from_table(table).unwrap().into();
    let fit = fit_khungurn(&target, &LAMBDA_UM, &[0.0; 3], 1, &KhungurnParameters::default()).unwrap();
    let p = &fit.parameters;
    println!("{} iterations, error {:.3}: {p:?}", fit.solution.iterations, fit.error);
    // Towards grazing light M_0 and a Gaussian over cos^2 are different lobes: 0.155 measured.
    assert!(fit.error < 0.17, "{}", fit.error);
    assert!((p.gamma_tt - 0.6).abs() < 0.02 && (p.beta_tt - 0.15).abs() < 0.02, "{p:?}");
    for (n, lambda) in LAMBDA_UM.into_iter().enumerate() {
        let (r, tt) = (p.c_r.at(lambda as f32), p.c_tt.at(lambda as f32));
        // The table's R does not grow towards grazing light, Schlick's does.
        assert!((r - 0.1).abs() < 0.1 && (tt - c_tt[n] as f32).abs() < 0.1, "{lambda}: {r} {tt}");
    }
}

/// From reflectances of the runtime's dual scattering, by its tables of samples, the fit recovers the
/// parameters to the accuracy of its integrals, 1e-3.
#[test]
fn planted_swatch_comes_back() {
    let want = planted();
    let fiber: FiberModel = KhungurnFiber::new(want.clone()).unwrap().into();
    let query = FiberQuery::new(direction(0.0, 0.0), LAMBDA_UM.map(|l| l as f32));
    let options = DualOptions { samples: 100_000, ..Default::default() };
    let dual = DualScattering::new(&fiber, &query, options).unwrap();
    for layers in [None, Some(4)] {
        let mut samples = Vec::new();
        // Nodes of the runtime's tables, between which it is linear.
        for node in [0, 4, 8, 11, 14, 16] {
            let theta_i = f64::from(node) / 35.0 * PI;
            let endless = dual.reflectance(theta_i as f32);
            let stack = dual.attenuation(theta_i as f32).stack(layers.unwrap_or(1));
            for n in 0..3 {
                let reflectance = f64::from(if layers.is_some() { stack[n].reflected } else { endless[n] });
                samples.push(SwatchSample { theta_i, lambda_um: LAMBDA_UM[n], reflectance });
            }
        }
        // C_TT alone, from one photograph under normal light.
        let start = KhungurnParameters { c_tt: 0.5.into(), ..want.clone() };
        let fit = fit_khungurn_swatch(&samples[..3], &SwatchOptions { layers, ..Default::default() }, &start).unwrap();
        println!("{layers:?}, C_TT: error {:.1e}, {:?}", fit.error, fit.parameters.c_tt);
        close(&fit.parameters, &want, 4e-3);
        // With C_R, or with gamma, from six latitudes.
        for free in
            [SwatchOptions { layers, c_r: true, gamma_tt: false }, SwatchOptions { layers, c_r: false, gamma_tt: true }]
        {
            let start = if free.c_r {
                KhungurnParameters { c_r: 0.3.into(), ..start.clone() }
            } else {
                KhungurnParameters { gamma_tt: 0.9, ..start.clone() }
            };
            let fit = fit_khungurn_swatch(&samples, &free, &start).unwrap();
            println!("{free:?}: error {:.1e}, {:?}", fit.error, fit.parameters);
            assert!(fit.error < 2e-3, "{}", fit.error);
            close(&fit.parameters, &want, 1e-2);
        }
    }
}

#[test]
fn bad_input_is_refused_in_one_line() {
    let target: FiberModel = KhungurnFiber::new(planted()).unwrap().into();
    let start = KhungurnParameters::default();
    let refused = |error: KhungurnFitError, begins: &str| {
        let line = error.to_string();
        assert!(line.starts_with(begins) && !line.contains('\n'), "{line}");
    };
    refused(fit_khungurn(&target, &[], &[], 1, &start).unwrap_err(), "Khungurn fit: lambda_um = []");
    refused(fit_khungurn(&target, &[f64::NAN], &[0.0], 1, &start).unwrap_err(), "Khungurn fit: lambda_um = NaN");
    refused(fit_khungurn(&target, &[0.5, 0.5], &[0.0; 2], 1, &start).unwrap_err(), "Khungurn fit: lambda_um = 0.5");
    refused(fit_khungurn(&target, &[0.5], &[], 1, &start).unwrap_err(), "Khungurn fit: sigma_per_um = 0");
    refused(fit_khungurn(&target, &[0.5], &[-1.0], 1, &start).unwrap_err(), "Khungurn fit: sigma_per_um = -1");
    refused(fit_khungurn(&target, &[0.5], &[0.0], 0, &start).unwrap_err(), "Khungurn fit: turns = 0");
    let bad = KhungurnParameters { beta_r: 0.0, ..start.clone() };
    refused(fit_khungurn(&target, &[0.5], &[0.0], 1, &bad).unwrap_err(), "Khungurn fiber: beta_r = 0");
    let black = OpaqueParameters { mirror: plywave_fiber::Mirror::None, ..Default::default() };
    let black: FiberModel = OpaqueFiber::new(black).unwrap().into();
    refused(fit_khungurn(&black, &[0.5], &[0.0], 1, &start).unwrap_err(), "Khungurn fit: target = 0");

    let sample = SwatchSample { theta_i: 0.0, lambda_um: 0.5, reflectance: 0.4 };
    let swatch = |sample: SwatchSample, layers| {
        fit_khungurn_swatch(&[sample], &SwatchOptions { layers, ..Default::default() }, &start).unwrap_err()
    };
    refused(fit_khungurn_swatch(&[], &SwatchOptions::default(), &start).unwrap_err(), "Khungurn fit: samples = 0");
    refused(swatch(sample, Some(0)), "Khungurn fit: layers = 0");
    let both = SwatchOptions { layers: None, c_r: true, gamma_tt: true };
    refused(fit_khungurn_swatch(&[sample], &both, &start).unwrap_err(), "Khungurn fit: gamma_tt = true");
    refused(swatch(SwatchSample { reflectance: -0.1, ..sample }, None), "Khungurn fit: reflectance = -0.1");
    refused(swatch(SwatchSample { reflectance: f64::NAN, ..sample }, None), "Khungurn fit: reflectance = NaN");
    refused(swatch(SwatchSample { theta_i: 2.0, ..sample }, None), "Khungurn fit: theta_i = 2");
    refused(swatch(SwatchSample { lambda_um: f64::INFINITY, ..sample }, None), "Khungurn fit: lambda_um = inf");
}
