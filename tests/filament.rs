//! Analytic models of single fibers (Zinke 2007). Chain of trust: frames are held to vectors and differences; reflectances to the
//! formulas in three dimensions; paths of a smooth cylinder to a walk by vectors; the far field to its histogram and to the mean of the near field; every model passes the checks of `check_bsdf`.

use plywave::check::{FURNACE_TOLERANCE, SAMPLED_TOLERANCE_SE, WEIGHT_TOLERANCE, check_bsdf};
use plywave::fiber::azimuthal::CrossSection;
use plywave::fiber::cylinder::{FiberDirection, bcsdf_of_energy, energy_of_bcsdf, relative_azimuth};
use plywave::fiber::opaque::{bcsdf_of_brdf, lambertian, lambertian_by_zinke};
use plywave::fiber::{
    DielectricBsdf, DielectricFiber, DielectricParameters, Metal, Mirror, OpaqueFiber, OpaqueParameters,
    RoughDielectricFiber, RoughDielectricParameters, conductor, fresnel,
};
use plywave::frame::direction;
use plywave::{Bsdf, BsdfSample, FiberModel, FiberQuery};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Any place and direction, off the rim and the poles by 1e-3.
fn anywhere(rng: &mut Pcg64Mcg) -> FiberDirection {
    FiberDirection {
        h_rel: 0.999 * (2.0 * rng.random::<f64>() - 1.0),
        phi: PI * (2.0 * rng.random::<f64>() - 1.0),
        theta: (FRAC_PI_2 - 1e-3) * (2.0 * rng.random::<f64>() - 1.0),
    }
}

/// Eq. 1-6 against the vectors: axis, normal and tangent at xi, and the direction.
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
        // The line at offset h passes the axis at h radii: the place is on it, and its distance from the axis is |h|.
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

/// Eq. 8, 11, 12: `d xi d alpha d beta sin beta cos beta = cos^2 theta dh dphi dtheta`, the Jacobian from differences.
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

/// Table of the module `cylinder`: f of `Bsdf` is the BCSDF times cos theta_o. A fiber that scatters all light evenly over the sphere has f = 1/(4 pi), so that
/// Eq. 36 in a white room must give the curve radiance that keeps it in balance: out, `integral L cos theta_o d omega`, is in, `integral D L_i cos theta_i d omega`.
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

/// Eq. 24: reflectances of the cross section's two indices are those in three dimensions, at the cosine cos theta cos gamma'; swapped indices are not (physics: 0.151, 0.052).
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

/// A ray through a smooth cylinder of radius 1, by vectors alone: what leaves after each inner part (direction, power without absorption, length inside so far).
fn walk(theta: f64, h: f64, eta: f64, parts: usize) -> Vec<([f64; 3], f64, f64)> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // Light from the azimuth 0: its line has y = h.
    let mut d = [-theta.cos(), 0.0, -theta.sin()];
    let mut x = [(1.0 - h * h).sqrt(), h, 0.0];
    let mut power = 1.0;
    let mut length = 0.0;
    let mut out = Vec::new();
    for event in 0..=parts {
        let outward = [x[0], x[1], 0.0];
        let (n, ratio) = if event == 0 { (outward, eta) } else { (outward.map(|v| -v), 1.0 / eta) };
        let cos_i = -dot(d, n);
        let reflected: [f64; 3] = std::array::from_fn(|k| d[k] + 2.0 * cos_i * n[k]);
        let sin2 = (1.0 - cos_i * cos_i) / (ratio * ratio);
        let cos_t = (1.0 - sin2).max(0.0).sqrt();
        let refracted: [f64; 3] = std::array::from_fn(|k| d[k] / ratio + (cos_i / ratio - cos_t) * n[k]);
        let (s, p) =
            ((cos_i - ratio * cos_t) / (cos_i + ratio * cos_t), (ratio * cos_i - cos_t) / (ratio * cos_i + cos_t));
        let f = if sin2 >= 1.0 { 1.0 } else { 0.5 * (s * s + p * p) };
        let (leaves, stays, share) =
            if event == 0 { (reflected, refracted, f) } else { (refracted, reflected, 1.0 - f) };
        out.push((leaves, power * share, length));
        power *= 1.0 - share;
        d = stays;
        // To the wall: |x + t d| across the axis is 1 again.
        let across = d[0] * d[0] + d[1] * d[1];
        let t = -2.0 * (x[0] * d[0] + x[1] * d[1]) / across;
        length += t;
        x = std::array::from_fn(|k| x[k] + t * d[k]);
    }
    out
}

/// Eq. 17-28 at every offset against the walk: azimuth, power, length, position along the axis; and the sum of all orders.
#[test]
fn paths_are_those_of_the_walk() {
    for (eta, theta) in [(1.55, 0.0), (1.55, 0.5), (1.3, -1.1), (1.9, 1.4f64)] {
        let section = CrossSection::new(eta as f32, 1.0, theta.sin() as f32);
        for k in 0..199 {
            let h = (k as f64 - 99.0) / 100.0;
            let path = section.path(h as f32);
            let walked = walk(theta, h, eta, 5);
            for (order, (w, power, length)) in walked.iter().enumerate() {
                let what = format!("eta {eta}, theta {theta}, h {h}, order {order}");
                let turn = f64::from(section.turn(order as u32, h as f32));
                assert!(relative_azimuth(turn - w[1].atan2(w[0])).abs() < 2e-5, "{what}: turn {turn}");
                assert!((w[2] + theta.sin()).abs() < 1e-9, "{what}: the latitude is kept");
                let sigma = 0.3;
                let (got, want) =
                    (f64::from(path.attenuation(order as u32, sigma)), power * (-f64::from(sigma) * length).exp());
                assert!((got - want).abs() < 1e-5, "{what}: {got}, want {want}");
                // Eq. 21-23, seen from where the light leaves. It enters at h and leaves at -h.
                let peak = section.peak(order as u32, -h as f32);
                assert_eq!(peak.h_rel_i, h as f32, "{what}");
                assert!(relative_azimuth(f64::from(peak.turn) + w[1].atan2(w[0])).abs() < 2e-5, "{what}: {peak:?}");
                let z = -theta.sin() / eta * length;
                assert!((f64::from(peak.shift_um) - z).abs() < 2e-5, "{what}: {peak:?}, want {z}");
            }
            // F + (1 - F)^2 T / (1 - F T); 1 where nothing is absorbed.
            assert!((path.from_order(0, 0.0) - 1.0).abs() < 1e-6, "{h}");
            let (f, t) = (f64::from(path.reflectance), (-0.3 * f64::from(path.length_um)).exp());
            let want = f + (1.0 - f).powi(2) * t / (1.0 - f * t);
            assert!((f64::from(path.from_order(0, 0.3)) - want).abs() < 1e-6, "{h}");
            let apart: f32 = (0..4).map(|p| path.attenuation(p, 0.3)).sum::<f32>() + path.from_order(4, 0.3);
            assert!((f64::from(apart) - want).abs() < 1e-6, "{h}: {apart}, want {want}");
        }
    }
}

/// Eq. 35 by order: the roots' density, integrated over bins, against a histogram of the walk at 400 000 offsets, power and all. Caustics lie in bins as everything else.
#[test]
fn far_field_is_the_histogram_of_the_walk() {
    let (bins, offsets, fine) = (90, 400_000, 4000);
    for (eta, theta) in [(1.55, 0.0), (1.55, 0.8), (1.3, 0.3), (2.2, 1.2f64)] {
        let section = CrossSection::new(eta as f32, 1.0, theta.sin() as f32);
        let mut want = vec![[0.0f64; 5]; bins];
        for k in 0..offsets {
            let h = (2.0 * k as f64 + 1.0) / f64::from(offsets) - 1.0;
            for (order, (w, power, _)) in walk(theta, h, eta, 4).iter().enumerate() {
                let bin = (w[1].atan2(w[0]).rem_euclid(TAU) / TAU * bins as f64) as usize;
                want[bin.min(bins - 1)][order] += power / f64::from(offsets);
            }
        }
        for order in 0..5 {
            // Midpoints know a caustic, 1/sqrt of the distance, to 0.3/sqrt(4000) of its light; an order has two, each in one bin or two.
            let (mut apart, mut off, mut total) = (0, 0.0, 0.0);
            for (bin, want) in want.iter().enumerate() {
                let mut got = 0.0;
                for k in 0..fine {
                    let phi = (bin as f64 + (f64::from(k) + 0.5) / f64::from(fine)) / bins as f64 * TAU;
                    section.roots(order as u32, phi as f32, |h, density| {
                        got += f64::from(density * section.path(h).attenuation(order as u32, 0.0));
                    });
                }
                got *= TAU / bins as f64 / f64::from(fine);
                let error = (got - want[order]).abs();
                apart += usize::from(error > 2e-3 * want[order] + 2e-6);
                off += error;
                total += want[order];
            }
            let what = format!("eta {eta}, theta {theta}, order {order}: off by {off} of {total}, {apart} bins");
            assert!(off < 1e-2 * total + 1e-5 && apart <= if order < 2 { 0 } else { 4 }, "{what}");
        }
    }
}

/// Closed forms of physics: one root of TT, none within 2 asin(1/n') of the light's side; one or three of TRT; R is cos(phi/2)/4, whose integral is 1.
#[test]
fn roots_are_as_many_as_they_must_be() {
    let section = CrossSection::new(1.55, 1.0, 0.0);
    let edge = 2.0 * (1.0f64 / 1.55).asin();
    let mut furnace = 0.0;
    let n = 3600;
    for k in 0..n {
        let phi = (f64::from(k) + 0.5) / f64::from(n) * TAU - PI;
        let count = |order: u32| {
            let mut found = 0;
            section.roots(order, phi as f32, |_, _| found += 1);
            found
        };
        if (phi.abs() - edge).abs() > 1e-3 {
            assert_eq!(count(1), usize::from(phi.abs() > edge), "{phi}");
        }
        let rough = [count(2), count(0)];
        assert!([0, 1, 2, 3].contains(&rough[0]) && rough[1] == 1, "{phi}: {rough:?}");
        section.roots(0, phi as f32, |_, density| {
            assert!((f64::from(density) - 0.25 * (0.5 * phi).cos()).abs() < 1e-6, "{phi}");
            furnace += f64::from(density) * TAU / f64::from(n);
        });
    }
    assert!((furnace - 1.0).abs() < 1e-5, "{furnace}");
    assert!((edge.to_degrees() - 80.36).abs() < 0.01, "{edge}");
}

fn dielectric(parameters: DielectricParameters) -> DielectricFiber {
    DielectricFiber::new(parameters).unwrap()
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

#[test]
fn near_field_of_a_smooth_fiber_passes_the_checks() {
    let fiber: FiberModel =
        dielectric(DielectricParameters { shift: [-0.05, 0.03, 0.08], ..Default::default() }).into();
    for (k, query) in queries(3, &[Some(0.0), Some(0.7), Some(-0.95), Some(1.0)]).into_iter().enumerate() {
        let at = fiber.at(&query);
        assert!((at.albedo()[0] - 1.0).abs() < 1e-5, "{query:?}: {:?}", at.albedo());
        check(&at, [0.1, 0.1], FURNACE_TOLERANCE, k as u64, &format!("{query:?}"));
    }
}

/// The far field has caustics: its integrals by Gauss's rule over panels of 0.005 rad are known to 5e-3.
#[test]
fn far_field_of_a_smooth_fiber_passes_the_checks() {
    let fiber: FiberModel =
        dielectric(DielectricParameters { shift: [-0.05, 0.03, 0.08], ..Default::default() }).into();
    for (k, query) in queries(4, &[None]).into_iter().enumerate() {
        let at = fiber.at(&query);
        assert!((at.albedo()[0] - 1.0).abs() < 1e-5, "{query:?}: {:?}", at.albedo());
        check(&at, [0.1, 0.0025], 5e-3, k as u64, &format!("{query:?}"));
    }
}

/// The mean of the near field over the offsets is the far field (Eq. 35 and 38), by its first Fourier coefficients over the azimuth.
#[test]
fn mean_of_the_near_field_is_the_far_field() {
    let fiber = dielectric(DielectricParameters { beta_n: 0.01, beta_m: [0.3; 3], ..Default::default() });
    for theta in [0.0, 0.7f32] {
        let query = FiberQuery { sigma_per_um: [0.0, 0.02], ..FiberQuery::new(direction(theta, 0.0), [0.5; 2]) };
        let coefficients = |at: &DielectricBsdf<'_, 2>, n: usize| {
            let mut sums = [[0.0f64; 2]; 7];
            for j in 0..n {
                let phi = (j as f64 + 0.37) / n as f64 * TAU;
                let f = at.eval(direction(-theta, phi as f32));
                for (k, sum) in sums.iter_mut().enumerate() {
                    (0..2).for_each(|w| sum[w] += f64::from(f[w]) * (k as f64 * phi).cos() / n as f64);
                }
            }
            sums
        };
        let far = coefficients(&fiber.at(&query), 40_000);
        let offsets = 3000;
        let mut near = [[0.0f64; 2]; 7];
        for k in 0..offsets {
            let h = (2 * k + 1) as f32 / offsets as f32 - 1.0;
            let c = coefficients(&fiber.at(&FiberQuery { h_rel: Some(h), ..query }), 900);
            (0..7).for_each(|k| (0..2).for_each(|w| near[k][w] += c[k][w] / f64::from(offsets)));
        }
        for k in 0..7 {
            for w in 0..2 {
                // The spread takes k^2 beta_n^2 / 2 of the k-th coefficient, 0.0018 of the last.
                let off = (far[k][w] - near[k][w]).abs() / far[0][w];
                assert!(off < 4e-3, "theta {theta}, coefficient {k}: far {:?}, near {:?}", far[k], near[k]);
            }
        }
    }
}

/// Eq. 36 in a white room: L_o / D is 1 for a clear fiber of narrow lobes. With wide ones it is the mean of `cos theta_i / cos theta_o` over the lobe, as f = M N keeps the
/// energy of each light and not of each view.
#[test]
fn white_room_gives_white() {
    let fiber = dielectric(DielectricParameters { beta_m: [0.02; 3], ..Default::default() });
    for theta_o in [0.1, 0.9, 1.3f32] {
        let wo = direction(theta_o, 0.4);
        let (rows, columns) = (200, 1440);
        let mut sum = 0.0;
        for i in 0..rows {
            let theta = (0.2 * ((i as f64 + 0.5) / f64::from(rows) - 0.5) - f64::from(theta_o)).max(-FRAC_PI_2);
            for j in 0..columns {
                let phi = (j as f64 + 0.37) / f64::from(columns) * TAU;
                let f = fiber.at(&FiberQuery::new(direction(theta as f32, phi as f32), [0.5])).eval(wo)[0];
                let bcsdf = bcsdf_of_energy(f64::from(f), f64::from(theta_o).cos());
                sum += bcsdf * theta.cos().powi(2) * 0.2 / f64::from(rows) * TAU / f64::from(columns);
            }
        }
        assert!((sum - 1.0).abs() < 0.01, "theta_o {theta_o}: {sum}");
    }
}

/// No number in gives what is not a number out.
#[test]
fn any_numbers_are_answered() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0, 1.0, -1.0, 1e30, -1e-30, 0.5, 2.0];
    let plastic = OpaqueParameters { mirror: Mirror::Dielectric(1.5), diffuse: 0.5, ..Default::default() };
    let fibers: [FiberModel; 5] = [
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

fn opaque(parameters: OpaqueParameters) -> OpaqueFiber {
    OpaqueFiber::new(parameters).unwrap()
}

/// Closed forms of physics: k_d pi/4 at phi = 0, integral 2 k_d over the azimuth, and Eq. 48 by quadrature; Eq. 51 is off as docs/papers.md says.
#[test]
fn lambertian_fiber_is_exact() {
    assert!((f64::from(lambertian(0.3, 0.0)) - 0.3 * PI / 4.0).abs() < 1e-6);
    let n = 3600;
    let (mut sum, mut printed) = (0.0, 0.0);
    for k in 0..n {
        let phi = (f64::from(k) + 0.5) / f64::from(n) * PI;
        let exact = f64::from(lambertian(0.3, phi as f32));
        // Eq. 49 by midpoints in h_o, in f64.
        if k % 60 == 0 {
            let steps = 200_000;
            let (low, high) = (-1.0, phi.cos());
            let want: f64 = (0..steps)
                .map(|s| low + (high - low) * (f64::from(s) + 0.5) / f64::from(steps))
                .map(|h: f64| 0.15 * (phi + h.asin()).cos().abs() * (high - low) / f64::from(steps))
                .sum();
            assert!((exact - want).abs() < 1e-6, "{phi}: {exact}, want {want}");
            for phi in [phi, -phi] {
                let [got] = bcsdf_of_brdf(phi as f32, |_| [0.3]);
                assert!((f64::from(got) - want).abs() < 1e-6, "{phi}: {got}, want {want}");
            }
        }
        sum += 2.0 * exact * PI / f64::from(n);
        printed += 2.0 * f64::from(lambertian_by_zinke(0.3, phi as f32)) * PI / f64::from(n);
    }
    assert!((sum - 0.6).abs() < 1e-5, "{sum}");
    assert!((printed / sum - 1.024).abs() < 2e-3, "{}", printed / sum);
    for (degrees, off) in [(0.0f32, 0.061), (130.0, -0.28), (150.0, -0.87)] {
        let phi = degrees.to_radians();
        let got = f64::from(lambertian_by_zinke(1.0, phi) / lambertian(1.0, phi) - 1.0);
        assert!((got - off).abs() < 5e-3, "{degrees}: {got}");
    }
}

/// Fresnel's reflectance of conductors by complex numbers, and of metals at published places.
#[test]
fn conductors_reflect_as_complex_indices_say() {
    let reference = |cos: f64, eta: f64, kappa: f64| {
        type C = (f64, f64);
        let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let div = |a: C, b: C| {
            let n = b.0 * b.0 + b.1 * b.1;
            ((a.0 * b.0 + a.1 * b.1) / n, (a.1 * b.0 - a.0 * b.1) / n)
        };
        let n = (eta, -kappa);
        let n2 = mul(n, n);
        let z = (n2.0 - (1.0 - cos * cos), n2.1);
        let size = z.0.hypot(z.1);
        let root = ((0.5 * (size + z.0)).max(0.0).sqrt(), -(0.5 * (size - z.0)).max(0.0).sqrt());
        let s = div((cos - root.0, -root.1), (cos + root.0, root.1));
        let nc = (n2.0 * cos, n2.1 * cos);
        let p = div((nc.0 - root.0, nc.1 - root.1), (nc.0 + root.0, nc.1 + root.1));
        0.5 * (s.0 * s.0 + s.1 * s.1 + p.0 * p.0 + p.1 * p.1)
    };
    for (eta, kappa) in [(0.21, 3.272), (1.366, 7.4052), (1.5, 0.0), (2.0, 0.3), (0.05, 3.858)] {
        for cos in [0.0, 0.01, 0.1, 0.4, 0.8, 1.0] {
            let (got, want) =
                (f64::from(conductor(cos as f32, [eta as f32, kappa as f32])), reference(cos, eta, kappa));
            assert!((got - want).abs() < 2e-6, "{eta} {kappa} {cos}: {got}, want {want}");
            if kappa == 0.0 {
                assert!((f64::from(fresnel::dielectric(cos as f32, eta as f32)) - want).abs() < 2e-6);
            }
        }
    }
    assert_eq!(Metal::Gold.index(0.5821), [0.29, 2.863]);
    assert_eq!(Metal::Copper.index(9.0), [0.26, 5.18]);
    assert_eq!(Metal::Aluminium.index(f32::NEG_INFINITY), [0.39877, 4.3957]);
    let [eta, kappa] = Metal::Silver.index(0.5 * (0.5486 + 0.5821));
    assert!((eta - 0.055).abs() < 1e-6 && (kappa - 3.722).abs() < 1e-5);
}

#[test]
fn opaque_fibers_pass_the_checks() {
    let fibers = [
        OpaqueParameters { mirror: Mirror::None, diffuse: 1.0, ..Default::default() },
        OpaqueParameters { mirror: Mirror::Dielectric(1.5), diffuse: 0.6, ..Default::default() },
        OpaqueParameters { mirror: Mirror::Metal(Metal::Gold), ..Default::default() },
        OpaqueParameters { mirror: Mirror::Metal(Metal::Aluminium), beta_m: 0.2, ..Default::default() },
        OpaqueParameters { mirror: Mirror::Conductor([2.0, 1.0]), diffuse: 0.9, ..Default::default() },
    ];
    for (j, parameters) in fibers.into_iter().enumerate() {
        let fiber: FiberModel = opaque(parameters).into();
        for (k, query) in queries(30 + j as u64, &[None, Some(0.4), Some(-0.98)]).into_iter().enumerate() {
            let at = fiber.at(&query);
            check(&at, [0.1, 0.1], FURNACE_TOLERANCE, (100 * j + k) as u64, &format!("{parameters:?} {query:?}"));
            if parameters.diffuse == 1.0 {
                assert!(at.albedo().iter().all(|a| (a - 1.0).abs() < 1e-5), "white at k_d = 1/pi");
            }
        }
    }
    // A black fiber keeps all light.
    let black = opaque(OpaqueParameters { mirror: Mirror::None, ..Default::default() });
    let query = FiberQuery::new(direction(0.2, 0.0), [0.5]);
    assert_eq!(black.at(&query).sample([0.5; 3]), BsdfSample::Absorbed);
    for p in [
        OpaqueParameters { mirror: Mirror::Conductor([1.0, -1.0]), ..Default::default() },
        OpaqueParameters { mirror: Mirror::Dielectric(0.5), ..Default::default() },
        OpaqueParameters { diffuse: 1.5, ..Default::default() },
        OpaqueParameters { radius_um: f32::NAN, ..Default::default() },
    ] {
        let line = OpaqueFiber::new(p).unwrap_err().to_string();
        assert!(line.starts_with("opaque fiber: ") && !line.contains('\n'), "{line}");
    }
}

/// The far field is the mean of the near field, which is the surface itself under the light: Eq. 48 against Eq. 44.
#[test]
fn opaque_far_field_is_the_mean_of_the_surface() {
    let plastic = OpaqueParameters {
        mirror: Mirror::Dielectric(1.5),
        diffuse: 0.7,
        beta_n: 0.02,
        beta_m: 0.3,
        ..Default::default()
    };
    let fiber = opaque(plastic);
    let query = FiberQuery::new(direction(0.5, 1.0), [0.5]);
    let far = fiber.at(&query);
    for k in 0..40 {
        let phi = 0.15 * k as f32;
        if (phi - std::f32::consts::PI).abs() < 0.1 {
            continue; // beta_n rounds the kink of cos(phi/2) there
        }
        let w = direction(-0.9 + 0.04 * k as f32, 1.0 + phi);
        let n = 8000;
        let mean: f64 = (0..n)
            .map(|j| (2 * j + 1) as f32 / n as f32 - 1.0)
            .map(|h| f64::from(fiber.at(&FiberQuery { h_rel: Some(h), ..query }).eval(w)[0]) / f64::from(n))
            .sum();
        let f = f64::from(far.eval(w)[0]);
        assert!((f - mean).abs() < 5e-3 * f + 3e-4, "{k}: far {f}, mean {mean}");
    }
}

fn rough(parameters: RoughDielectricParameters) -> RoughDielectricFiber {
    RoughDielectricFiber::new(parameters).unwrap()
}

/// Eq. 53 written out in f64, with TRT's argument as Eq. 23 has it: the energy density, that is times cos theta_o.
fn near_field_as_printed(
    p: &RoughDielectricParameters,
    [theta_i, theta_o]: [f64; 2],
    phi: f64,
    h_i: f64,
    sigma: f64,
) -> f64 {
    let n = f64::from(p.eta);
    let theta_d = 0.5 * (theta_o - theta_i);
    let across = (n * n - theta_d.sin().powi(2)).sqrt() / theta_d.cos();
    // The paper's h_o is where light leaves; phi is phi_o - phi_i.
    let h_o = -h_i;
    let g = |half: f64, x: f64, w: f64| {
        let steps = 4000;
        let sum: f64 = (0..steps)
            .map(|k| half * (2.0 * (f64::from(k) + 0.5) / f64::from(steps) - 1.0))
            .map(|x| (-x * x / (2.0 * w * w)).exp() * 2.0 * half / f64::from(steps))
            .sum();
        (-x * x / (2.0 * w * w)).exp() / sum
    };
    let (ci, inside) = ((1.0 - h_o * h_o).sqrt(), (1.0 - (h_o / across).powi(2)).sqrt());
    let perpendicular = (ci - across * inside) / (ci + across * inside);
    let second = n * n / across;
    let parallel = (second * ci - inside) / (second * ci + inside);
    let f = 0.5 * (perpendicular.powi(2) + parallel.powi(2));
    let length = 2.0 * f64::from(p.radius_um) * inside / (1.0 - (theta_d.sin() / n).powi(2)).sqrt();
    let t = (-sigma * length).exp();
    let a = [f, (1.0 - f).powi(2) * t, (1.0 - f).powi(2) * f * t * t];
    let off = [
        phi + 2.0 * h_o.asin(),
        phi + PI + 2.0 * h_o.asin() - 2.0 * (h_o / across).asin(),
        phi + 2.0 * h_o.asin() - 4.0 * (h_o / across).asin(),
    ];
    let lobes: f64 = (0..3)
        .map(|k| {
            let along = theta_o + theta_i - f64::from(p.shift[k]);
            g(FRAC_PI_2, along, f64::from(p.width_theta[k]))
                * a[k]
                * g(PI, relative_azimuth(off[k]), f64::from(p.width_phi[k]))
        })
        .sum();
    (2.0 * f64::from(p.k_d) + lobes / theta_d.cos().powi(2)) * theta_o.cos()
}

#[test]
fn rough_near_field_is_the_printed_one() {
    let p = RoughDielectricParameters { k_d: 0.01, ..Default::default() };
    let fiber = rough(p);
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let mut peak = 0.0f64;
    for _ in 0..400 {
        let theta_i = 2.4 * rng.random::<f64>() - 1.2;
        let theta_o = (-theta_i + 0.6 * (rng.random::<f64>() - 0.5)).clamp(-1.5, 1.5);
        let (phi_i, phi, h) = (TAU * rng.random::<f64>(), TAU * rng.random::<f64>(), 1.96 * rng.random::<f64>() - 0.98);
        let query = FiberQuery::new(direction(theta_i as f32, phi_i as f32), [0.5]);
        let at = fiber.at(&FiberQuery { sigma_per_um: [0.004], h_rel: Some(h as f32), ..query });
        let got = f64::from(at.eval(direction(theta_o as f32, (phi_i + phi) as f32))[0]);
        let want = near_field_as_printed(&p, [theta_i, theta_o], phi, h, 0.004);
        peak = peak.max(want);
        // f32 angles are known to 1e-6, of widths from 0.05: exponents to 1e-4.
        assert!((got - want).abs() < 3e-4 * want + 1e-6, "{theta_i} {theta_o} {phi} {h}: got {got}, want {want}");
    }
    assert!(peak > 1.0, "the lobes were met: {peak}");
}

/// Furnace against the albedo's own integral, sampling, chi-square, at a near and the far field; rough, and Marschner's with caustics.
#[test]
fn rough_fibers_pass_the_checks() {
    let blurred = RoughDielectricParameters { width_phi: [0.1, 0.15, 0.3], k_d: 0.01, ..Default::default() };
    let fiber: FiberModel = rough(blurred).into();
    for (k, query) in queries(50, &[None, Some(0.5), Some(-0.9)]).into_iter().enumerate() {
        let query = FiberQuery { sigma_per_um: [0.0, 0.002, 0.02], ..query };
        check(&fiber.at(&query), [0.05, 0.1], 2e-3, 500 + k as u64, &format!("{query:?}"));
    }
    let marschner = RoughDielectricParameters::marschner(1.55, 40.0, [-0.1, 0.05, 0.15], [0.1, 0.1, 0.2]);
    let fiber: FiberModel = rough(marschner).into();
    for (k, query) in queries(51, &[None]).into_iter().take(3).enumerate() {
        let query = FiberQuery { sigma_per_um: [0.0, 0.002, 0.02], ..query };
        // Caustics, as for the smooth fiber.
        check(&fiber.at(&query), [0.1, 0.0025], 5e-3, 600 + k as u64, &format!("{query:?}"));
    }
    for p in [
        RoughDielectricParameters { eta: 0.8, ..Default::default() },
        RoughDielectricParameters { width_theta: [0.1, 0.0, 0.1], ..Default::default() },
        RoughDielectricParameters { width_phi: [0.1, 0.01, 0.1], ..Default::default() },
        RoughDielectricParameters { k_d: 0.06, ..Default::default() },
    ] {
        let line = RoughDielectricFiber::new(p).unwrap_err().to_string();
        assert!(line.starts_with("rough dielectric fiber: ") && !line.contains('\n'), "{line}");
    }
}

/// The far field is the mean of the near field (Eq. 35 of 52), at the least width too; `k_d = 1 / (2 pi^2)` alone is white.
#[test]
fn rough_far_field_is_the_mean_of_the_near_field() {
    let p = RoughDielectricParameters {
        width_phi: [0.06, 0.06, 0.06],
        k_d: 1.0 / (2.0 * std::f32::consts::PI.powi(2)),
        ..Default::default()
    };
    let fiber = rough(p);
    let query = FiberQuery { sigma_per_um: [0.003], ..FiberQuery::new(direction(0.4, 0.0), [0.5]) };
    let far = fiber.at(&query);
    let n = 4000;
    for k in 0..60 {
        let w = direction(-0.35, 0.1 * k as f32 + 0.01);
        // Midpoints in gamma, finer than the model's.
        let mean: f64 = (0..n)
            .map(|j| PI * ((f64::from(j) + 0.5) / f64::from(n) - 0.5))
            .map(|gamma| {
                let at = fiber.at(&FiberQuery { h_rel: Some(gamma.sin() as f32), ..query });
                f64::from(at.eval(w)[0]) * 0.5 * gamma.cos() * PI / f64::from(n)
            })
            .sum();
        let f = f64::from(far.eval(w)[0]);
        assert!((f - mean).abs() < 4e-3 * mean, "{k}: far {f}, mean {mean}");
    }
    let black = FiberQuery { sigma_per_um: [1e6], ..query };
    let white = f64::from(fiber.at(&black).albedo()[0])
        - f64::from(rough(RoughDielectricParameters { k_d: 0.0, ..p }).at(&black).albedo()[0]);
    assert!((white - 1.0).abs() < 1e-5, "{white}");
}

/// Eq. 43: R of Marschner's model is `a(theta_d, sin(phi/2)) cos(phi/2) g / (4 cos^2 theta_d)`, derived from Eq. 42 by Eq. 35; an opaque inside leaves it alone. And widths that
/// shrink give the smooth cylinder: the mean of the rough far field over a tenth of a radian is Marschner's.
#[test]
fn marschner_is_an_instance() {
    let p = RoughDielectricParameters::marschner(1.55, 40.0, [-0.1, 0.05, 0.15], [0.1, 0.1, 0.2]);
    let fiber = rough(p);
    let query = FiberQuery { sigma_per_um: [1e6], ..FiberQuery::new(direction(0.5, 1.0), [0.5]) };
    let at = fiber.at(&query);
    for k in 0..50 {
        let (theta_o, phi) = (-0.9 + 0.02 * f64::from(k), -3.0 + 0.12 * f64::from(k));
        let got = f64::from(at.eval(direction(theta_o as f32, (1.0 + phi) as f32))[0]);
        let theta_d = 0.5 * (theta_o - 0.5);
        let (cos, n) = (theta_d.cos() * (0.5 * phi).cos(), 1.55f64);
        let inside = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
        let (s, q) = ((cos - n * inside) / (cos + n * inside), (n * cos - inside) / (n * cos + inside));
        let x = theta_o + 0.5 + 0.1;
        let g = (-x * x / 0.02).exp() / (0.1 * TAU.sqrt());
        let want = 0.5 * (s * s + q * q) * (0.5 * phi).cos() * g / (4.0 * theta_d.cos().powi(2)) * theta_o.cos();
        assert!((got - want).abs() < 2e-4 * want + 1e-7, "{k}: got {got}, want {want}");
    }
    // Away from caustics and edges by five widths the blur of 0.06 rad moves little: TT at its middle, where a(h) and |dh/dphi| change slowly.
    let narrow = rough(RoughDielectricParameters { width_phi: [0.06; 3], ..p });
    let clear = FiberQuery { sigma_per_um: [0.0], ..query };
    for phi in [PI, PI - 0.3, PI + 0.3] {
        let w = direction(-0.5, (1.0 + phi) as f32);
        let (a, b) = (f64::from(fiber.at(&clear).eval(w)[0]), f64::from(narrow.at(&clear).eval(w)[0]));
        assert!((a / b - 1.0).abs() < 0.02, "{phi}: {a} and {b}");
    }
}
