//! Weave gaps. Chain of trust: `src/math/faddeeva.rs` compares the factor k with quadrature. Here f is
//! compared with its formula in f64, its energy with a separate integral, and the sampler with f by the
//! checks of every `Bsdf`.

use plywave::bsdf::Outcomes;
use plywave::gap::{Aperture, Gap};
use plywave::math::faddeeva::{diffraction_factor, power_between};
use plywave::spec::GaussianBeam;
use plywave::{Bsdf, BsdfSample};
use plywave_check::check_bsdf;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const BEAM: GaussianBeam = GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 };
const LAMBDA: [f32; 4] = [0.4, 0.5, 0.6, 0.7];

fn gap(x: [f32; 2], y: [f32; 2]) -> Gap {
    Gap::new(&Aperture::new(x, y).unwrap(), &BEAM)
}

/// Light tilted by `tilt` from the normal, at azimuth `phi`.
fn tilted(tilt: f32, phi: f32) -> [f32; 3] {
    [tilt.sin() * phi.cos(), tilt.sin() * phi.sin(), tilt.cos()]
}

/// Yu 2025, Eq. 11, 12, 15 with |K|^2 and the corrected power, in f64.
fn formula(x: [f64; 2], y: [f64; 2], xi_i: [f64; 3], wo: [f64; 3], lambda: f64) -> f64 {
    let square = |k: [f64; 2]| k[0] * k[0] + k[1] * k[1];
    let w0 = BEAM.w0_um;
    let kx = square(diffraction_factor(x[0], x[1], (xi_i[0] + wo[0]) / lambda, w0));
    let ky = square(diffraction_factor(y[0], y[1], (xi_i[1] + wo[1]) / lambda, w0));
    let power = power_between(x[0], x[1], w0) * power_between(y[0], y[1], w0);
    let cosines = (xi_i[2].abs() + wo[2].abs()).powi(2);
    cosines * kx * ky / (4.0 * power * xi_i[2].abs() * lambda * lambda)
}

#[test]
fn eval_is_the_formula() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut worst = 0.0f64;
    for (x, y) in [([-20.0, 20.0], [-20.0, 20.0]), ([-1.0, 1.0], [-1.0, 1.0]), ([-2.0, 9.0], [1.5, 20.0])] {
        let g = gap(x, y);
        for _ in 0..200 {
            let xi_i = tilted(1.2 * rng.random::<f32>(), 6.3 * rng.random::<f32>());
            let at = g.at(xi_i, LAMBDA);
            let peak = at.eval([-xi_i[0], -xi_i[1], -xi_i[2]]);
            let spread: f32 = 0.5 * rng.random::<f32>().powi(3);
            let mut d = || spread * (2.0 * rng.random::<f32>() - 1.0);
            let (a, b) = ((d() - xi_i[0]).clamp(-0.7, 0.7), (d() - xi_i[1]).clamp(-0.7, 0.7));
            let wo = [a, b, -(1.0 - a * a - b * b).sqrt()];
            let got = at.eval(wo);
            for k in 0..4 {
                let want = formula(
                    x.map(f64::from),
                    y.map(f64::from),
                    xi_i.map(f64::from),
                    wo.map(f64::from),
                    f64::from(LAMBDA[k]),
                );
                worst = worst.max((f64::from(got[k]) - want).abs() / f64::from(peak[k]).max(want));
            }
        }
    }
    println!("f_gap in f32 against f64, over its peak: {worst:.1e}");
    // The sum xi_i + wo is rounded to 6e-8, a beam's divergence is 0.009: some 1e-5 of the peak.
    assert!(worst < 2e-5, "{worst}");
}

/// The integral of the f64 formula in the variables (xi_x, angle about x), whose area element is that of the
/// sphere: without tables, and with K as the only code under test.
fn furnace(x: [f64; 2], y: [f64; 2], xi_i: [f64; 3], lambda: f64) -> f64 {
    let (w0, mut sum) = (BEAM.w0_um, 0.0);
    let square = |k: [f64; 2]| k[0] * k[0] + k[1] * k[1];
    let power = power_between(x[0], x[1], w0) * power_between(y[0], y[1], w0);
    // Steps of half a fringe of the widest aperture, in the finer middle of a tenth of a beam's divergence.
    let nodes = |center: f64, low: f64, high: f64| -> Vec<(f64, f64)> {
        let mut at = vec![low];
        while *at.last().unwrap() < high {
            let last = *at.last().unwrap();
            let step = if (last - center).abs() < 0.1 { 0.001 } else { 0.0025 };
            at.push((last + step).min(high));
        }
        at.windows(2).map(|w| (0.5 * (w[0] + w[1]), w[1] - w[0])).collect()
    };
    let psi_forward = xi_i[1].atan2(xi_i[2]);
    let columns = nodes(psi_forward, -0.5 * std::f64::consts::PI, 0.5 * std::f64::consts::PI);
    for (u, du) in nodes(-xi_i[0], -1.0, 1.0) {
        let kx = square(diffraction_factor(x[0], x[1], (xi_i[0] + u) / lambda, w0));
        if kx < 1e-9 * power {
            continue;
        }
        let reach = (1.0 - u * u).sqrt();
        for (psi, dpsi) in &columns {
            let (s, c) = psi.sin_cos();
            let ky = square(diffraction_factor(y[0], y[1], (xi_i[1] - reach * s) / lambda, w0));
            sum += du * dpsi * kx * ky * (xi_i[2] + reach * c).powi(2);
        }
    }
    sum / (4.0 * power * xi_i[2] * lambda * lambda)
}

/// Wide apertures pass all of their light, tilted or not; narrow ones lose some to Kirchhoff's approximation.
#[test]
fn furnace_of_apertures_and_tilts() {
    let cases = [
        (20.0, 0.0, 0.55, 0.02),
        (20.0, 1.0, 0.55, 0.02),
        (5.0, 0.0, 0.4, 0.02),
        (5.0, 0.0, 0.7, 0.02),
        (5.0, 1.0, 0.55, 0.02),
        // 10 um are 14 wavelengths here: 0.9792.
        (5.0, 1.0, 0.7, 0.022),
        (1.0, 0.0, 0.55, 0.06),
    ];
    for (half, tilt, lambda, tolerance) in cases {
        let g = gap([-half, half], [-half, half]);
        let xi_i = tilted(tilt, 0.4);
        let got = f64::from(g.at(xi_i, [lambda]).albedo()[0]);
        let edges = [-f64::from(half), f64::from(half)];
        let want = furnace(edges, edges, xi_i.map(f64::from), f64::from(lambda));
        println!("{} um, tilt {tilt}, lambda {lambda}: albedo {got:.4}, integral {want:.4}", 2.0 * half);
        assert!((got - want).abs() < 3e-3, "albedo {got}, integral of f {want}");
        assert!((want - 1.0).abs() < tolerance, "{half} {tilt} {lambda}: {want}");
    }
}

/// Energy, density, weights and samples are consistent: open, narrow, off-center and slit-like apertures,
/// tilts to 1 rad.
#[test]
fn every_check_of_a_bsdf_passes() {
    let cases = [
        ([-20.0, 20.0], [-20.0, 20.0], tilted(0.0, 0.0)),
        ([-5.0, 5.0], [-5.0, 5.0], tilted(1.0, 0.7)),
        ([-1.0, 1.0], [-1.0, 1.0], tilted(0.5, 2.0)),
        ([1.0, 11.0], [-20.0, 20.0], tilted(0.7, 5.0)),
    ];
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for (x, y, xi_i) in cases {
        let g = gap(x, y);
        let s = g.at(xi_i, [0.45, 0.65]);
        let r = check_bsdf(&s, [0.012, 0.02], 40_000, &mut || rng.random());
        println!("{x:?} {y:?}: {r:?}");
        assert!(r.furnace_error < 3e-3, "{r:?}");
        assert!(r.pdf_error < 3e-3, "{r:?}");
        assert!(r.weight_error < 1e-5, "{r:?}");
        assert!(r.sampled_furnace_se < 5.0, "{r:?}");
        assert!(r.chi2_p > 1e-3, "{r:?}");
    }
}

#[test]
fn bad_apertures_are_refused_and_dark() {
    for (x, y) in [([1.0, -1.0], [-1.0, 1.0]), ([-1.0, 1.0], [2.0, 2.0]), ([f32::NAN, 1.0], [0.0, 1.0])] {
        let error = Aperture::new(x, y).unwrap_err().to_string();
        assert!(error.contains("_um") && error.contains("greater than the first"), "{error}");
        let dark = Gap::new(&Aperture { x_um: x, y_um: y }, &BEAM);
        let at = dark.at(tilted(0.3, 0.0), LAMBDA);
        assert_eq!(at.eval([0.0, 0.0, -1.0]), [0.0; 4]);
        assert_eq!((at.albedo(), at.outcomes(), dark.passing()), ([0.0; 4], Outcomes::ABSORBED, 0.0));
        assert_eq!(at.sample([0.5; 3]), BsdfSample::Absorbed);
    }
    assert!(Aperture::centered(-3.0, 1.0).is_err());
    // All of it beyond where the beam is dark.
    assert_eq!(gap([30.0, 40.0], [-5.0, 5.0]).at(tilted(0.0, 0.0), LAMBDA).outcomes(), Outcomes::ABSORBED);
}

#[test]
fn light_passes_from_both_sides() {
    let g = gap([-3.0, 8.0], [-6.0, 2.0]);
    let (up, down) = (g.at(tilted(0.4, 1.0), LAMBDA), g.at(tilted(0.4, 1.0).map(|x| -x), LAMBDA));
    let wo = [-0.2, -0.25, -0.9];
    assert_eq!(up.eval(wo), down.eval(wo.map(|x| -x)));
    assert_eq!(up.eval([wo[0], wo[1], -wo[2]]), [0.0; 4]);
}

#[test]
fn any_input_gives_finite_numbers() {
    let odd = [0.0, -1.0, 1.0, 0.3, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, 1e-30, f32::MIN_POSITIVE];
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    let mut any = || odd[rng.random_range(0..odd.len())];
    for _ in 0..3000 {
        let g = Gap::new(&Aperture { x_um: [any(), any()], y_um: [any(), any()] }, &BEAM);
        let at = g.at([any(), any(), any()], [any(), any(), 0.5]);
        let wo = [any(), any(), any()];
        let numbers = at.eval(wo).into_iter().chain([at.pdf(wo), at.outcomes().scattered]);
        numbers.for_each(|v| assert!(v.is_finite() && v >= 0.0, "{v}: {at:?} {wo:?}"));
        if let Some(s) = at.sample([any(), any(), any()]).direction() {
            let numbers = s.w.into_iter().chain(s.weight).chain([s.pdf]);
            numbers.for_each(|v| assert!(v.is_finite(), "{s:?} {at:?}"));
        }
    }
}

/// The integral of f differs from 1 by the light that the aperture's edges send beyond all directions, minus
/// the light that Kirchhoff's cosines add elsewhere. To first order in the wavelength, of each axis alone
/// (docs/explain/papers/yu_2025.md), with q the mean intensity at its two edges over the power between them
/// [1/um]: lambda/(2 pi^2) (q_x (1/c^2 + pi/(4 c)) + q_y (1 + pi/4)/c), c the cosine of a tilt towards x.
#[test]
fn missing_energy_is_that_of_the_edges() {
    let pi = std::f64::consts::PI;
    for [x, y] in [[5.0f64, 5.0], [7.5, 5.0], [5.0, 10.0]] {
        let q = |half: f64| (-2.0 * (half / BEAM.w0_um).powi(2)).exp() / power_between(-half, half, BEAM.w0_um);
        let edges = |half: f64| [-half as f32, half as f32];
        let g = gap(edges(x), edges(y));
        for tilt in [0.0f64, 0.5, 1.0] {
            let lambda = [0.4f32, 0.55, 0.7, 0.78];
            let got = g.at(tilted(tilt as f32, 0.0), lambda).albedo();
            for (got, lambda) in got.iter().zip(lambda) {
                let c = tilt.cos();
                let both = q(x) * (1.0 / (c * c) + 0.25 * pi / c) + q(y) * (1.0 + 0.25 * pi) / c;
                let want = f64::from(lambda) / (2.0 * pi * pi) * both;
                let missing = 1.0 - f64::from(*got);
                println!("{x} {y} {tilt} {lambda}: missing {missing:.5}, first order {want:.5}");
                assert!((missing - want).abs() < 0.15 * want + 3e-4, "{x} {y} {tilt} {lambda}: {missing}, {want}");
            }
        }
    }
}
