//! Frames and measures of the enclosing cylinder, and reflectances of its cross section (Zinke 2007, Eq.
//! 1-16, 24).

use super::*;
use plywave::optics::fresnel;
use plywave_fiber::cylinder::{FiberDirection, bcsdf_of_energy, energy_of_bcsdf, relative_azimuth};

/// A random point and direction, off the rim and the poles by 1e-3.
fn anywhere(rng: &mut Pcg64Mcg) -> FiberDirection {
    FiberDirection {
        h_rel: 0.999 * (2.0 * rng.random::<f64>() - 1.0),
        phi: PI * (2.0 * rng.random::<f64>() - 1.0),
        theta: (FRAC_PI_2 - 1e-3) * (2.0 * rng.random::<f64>() - 1.0),
    }
}

/// Eq. 1-6 agree with the vectors: axis, normal and tangent at xi, and the direction.
#[test]
fn frames_are_those_of_the_vectors() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for _ in 0..2000 {
        let at = anywhere(&mut rng);
        let s = at.on_surface();
        let w = [at.theta.cos() * at.phi.cos(), at.theta.cos() * at.phi.sin(), at.theta.sin()];
        let normal = w[0] * s.xi.cos() + w[1] * s.xi.sin();
        let tangent = w[1] * s.xi.cos() - w[0] * s.xi.sin();
        let want = [normal, tangent, w[2]];
        let got = [s.beta.cos(), s.beta.sin() * s.alpha.sin(), s.beta.sin() * s.alpha.cos()];
        for k in 0..3 {
            assert!((got[k] - want[k]).abs() < 1e-12, "{at:?} {k}: got {}, want {}", got[k], want[k]);
        }
        assert!((at.cos_beta() - normal).abs() < 1e-12, "{at:?}");
        // Eq. 5 and 6 as printed.
        let cos_alpha = at.theta.sin() / (1.0 - (1.0 - at.h_rel.powi(2)) * at.theta.cos().powi(2)).sqrt();
        let alpha = if at.h_rel <= 0.0 { cos_alpha.acos() } else { TAU - cos_alpha.acos() };
        assert!((s.alpha - alpha).abs() < 1e-6, "{at:?}: {} and {alpha}", s.alpha);
        // The line at offset h passes the axis at h radii: the place is on it, and its distance from the axis
        // is |h|.
        let (x, y) = (s.xi.cos(), s.xi.sin());
        assert!((x * -at.phi.sin() + y * at.phi.cos() - at.h_rel).abs() < 1e-12, "{at:?}");
        let back = s.in_fiber();
        assert!((back.h_rel - at.h_rel).abs() < 1e-9 && (back.theta - at.theta).abs() < 1e-9, "{at:?} {back:?}");
        assert!(relative_azimuth(back.phi - at.phi).abs() < 1e-9, "{at:?} {back:?}");
    }
}

/// Eq. 16 on its three branches.
#[test]
fn azimuths_are_brought_to_half_a_turn_a_side() {
    for (given, want) in [(0.3, 0.3), (PI, PI), (-PI, PI), (4.0, 4.0 - TAU), (-4.0, TAU - 4.0), (TAU, 0.0)] {
        assert!((relative_azimuth(given) - want).abs() < 1e-12, "{given}: {}", relative_azimuth(given));
    }
}

/// Eq. 8, 11, 12: `d xi d alpha d beta sin beta cos beta = cos^2 theta dh dphi dtheta`, the Jacobian from
/// differences.
#[test]
fn measure_is_cos_squared() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for _ in 0..500 {
        let at =
            FiberDirection { h_rel: 1.8 * rng.random::<f64>() - 0.9, theta: 2.6 * rng.random::<f64>() - 1.3, phi: 1.0 };
        if at.h_rel.abs() < 0.05 && at.theta.abs() < 0.05 {
            continue; // alpha has no value where beta is 0
        }
        let step = 1e-6;
        let column = |d: [f64; 3]| {
            let moved = |s: f64| {
                FiberDirection { h_rel: at.h_rel + s * d[0], phi: at.phi + s * d[1], theta: at.theta + s * d[2] }
                    .on_surface()
            };
            let (a, b) = (moved(-step), moved(step));
            [b.xi - a.xi, relative_azimuth(b.alpha - a.alpha), b.beta - a.beta].map(|x| x / (2.0 * step))
        };
        let m = [column([1.0, 0.0, 0.0]), column([0.0, 1.0, 0.0]), column([0.0, 0.0, 1.0])];
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let c = cross(m[1], m[2]);
        let jacobian = (m[0][0] * c[0] + m[0][1] * c[1] + m[0][2] * c[2]).abs();
        let s = at.on_surface();
        let (got, want) = (jacobian * s.beta.sin() * s.beta.cos(), at.theta.cos().powi(2));
        assert!((got - want).abs() < 1e-6, "{at:?}: got {got}, want {want}");
        assert!((at.jacobian() / jacobian - 1.0).abs() < 1e-6, "{at:?}: {} and {jacobian}", at.jacobian());
    }
}

/// Table of the module `cylinder`: f of `Bsdf` is the BCSDF times cos theta_o. A fiber that scatters all
/// light evenly over the sphere has f = 1/(4 pi), so that Eq. 36 in a white room must give the curve radiance
/// that keeps it in balance: out, `integral L cos theta_o d omega`, is in,
/// `integral D L_i cos theta_i d omega`.
#[test]
fn measures_keep_the_balance_of_a_white_room() {
    let n = 4000;
    let (mut out, mut within) = (0.0, 0.0);
    let thetas: Vec<f64> = (0..n).map(|k| (k as f64 + 0.5) / n as f64 * PI - FRAC_PI_2).collect();
    let weight = TAU * PI / n as f64;
    for theta_o in &thetas {
        let bcsdf = bcsdf_of_energy(1.0 / (4.0 * PI), theta_o.cos());
        assert!((energy_of_bcsdf(bcsdf, theta_o.cos()) * 4.0 * PI - 1.0).abs() < 1e-12);
        // Eq. 36 of L_i = 1 and D = 1.
        let curve_radiance: f64 = bcsdf * thetas.iter().map(|t| t.cos().powi(2) * weight).sum::<f64>();
        out += curve_radiance * theta_o.cos() * theta_o.cos() * weight;
        within += theta_o.cos() * theta_o.cos() * weight;
    }
    assert!((out / within - 1.0).abs() < 1e-5, "{out} of {within}");
}

/// Eq. 24: reflectances of the cross section's two indices are those in three dimensions, at the cosine cos
/// theta cos gamma'; swapped indices are not (physics: 0.151, 0.052).
#[test]
fn cross_section_indices_give_the_reflectance_in_space() {
    let printed = |n: [f64; 2], gamma: f64, n_bend: f64| {
        let (c, t) = (gamma.cos(), (1.0 - (gamma.sin() / n_bend).powi(2)).sqrt());
        let s = (c - n[0] * t) / (c + n[0] * t);
        let p = (n[1] * c - t) / (n[1] * c + t);
        0.5 * (s * s + p * p)
    };
    let space = |cos: f64, eta: f64| {
        let inside = (1.0 - (1.0 - cos * cos) / (eta * eta)).sqrt();
        let (s, p) = ((cos - eta * inside) / (cos + eta * inside), (eta * cos - inside) / (eta * cos + inside));
        0.5 * (s * s + p * p)
    };
    for eta in [1.2, 1.55, 2.4] {
        for theta in [0.0, 0.3, 0.7, 1.2, 1.5f64] {
            for gamma in [0.0, 0.4, 1.0, 1.4, 1.56f64] {
                let [across, along] = fresnel::cross_section_indices(theta.sin() as f32, eta as f32).map(f64::from);
                let want = space(theta.cos() * gamma.cos(), eta);
                let got = printed([across, along], gamma, across);
                assert!((got - want).abs() < 3e-6, "{eta} {theta} {gamma}: got {got}, want {want}");
                let fast = f64::from(fresnel::dielectric((theta.cos() * gamma.cos()) as f32, eta as f32));
                assert!((fast - want).abs() < 3e-6, "{eta} {theta} {gamma}: fast {fast}, want {want}");
            }
        }
    }
    let (theta, gamma) = (40f64.to_radians(), 60f64.to_radians());
    let [across, along] = fresnel::cross_section_indices(theta.sin() as f32, 1.55).map(f64::from);
    let (right, swapped) = (printed([across, along], gamma, across), printed([along, across], gamma, across));
    assert!((right - 0.151).abs() < 1e-3, "{right}");
    assert!((swapped - right).abs() > 0.05, "{swapped}");
}
