//! Paths of a smooth cylinder: closed forms against a walk by vectors, the far field against its histogram
//! (Zinke 2007, Eq. 17-35).

use super::*;
use plywave_fiber::cylinder::relative_azimuth;

/// A ray through a smooth cylinder of radius 1, by vectors alone: the light that leaves after each inner part
/// (direction, power without absorption, length inside so far).
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

/// Eq. 17-28 at every offset against the walk: azimuth, power, length, position along the axis; and the sum
/// of all orders.
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

/// Eq. 35 by order: the roots' density, integrated over bins, against a histogram of the walk at 400 000
/// offsets, power and all. Caustics lie in bins as everything else.
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
            // Midpoints know a caustic, 1/sqrt of the distance, to 0.3/sqrt(4000) of its light; an order has
            // two, each in one bin or two.
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

/// Closed forms of physics: one root of TT, none within 2 asin(1/n') of the light's side; one or three of
/// TRT; R is cos(phi/2)/4, whose integral is 1.
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

/// Eq. 39-40: light that varies over the width, L(h_i). The mean over the offsets of L times the near field
/// is what a histogram of the walk with power L(h) a has; and Eq. 54:
/// at one offset, over all places of exit, it is the position-dependent BSDF of a ribbon.
#[test]
fn light_that_varies_over_the_width_is_the_weighted_mean_of_the_near_field() {
    let light = |h: f64| (0.5 + 0.5 * h).powi(2);
    let (bins, offsets, theta) = (60, 100_000, 0.4);
    let beta_n = 0.1;
    let p = DielectricParameters { radius_um: 1.0, beta_n, orders: 8, beta_m: [0.02; 3], ..Default::default() };
    let fiber = dielectric(p);
    let query = FiberQuery::new(direction(theta as f32, 0.0), [0.5]);
    // First moments over the azimuth of the walk; the spread by the width multiplies them by exp(-k^2 beta^2
    // / 2).
    let mut want = [[0.0f64; 2]; 4];
    for k in 0..offsets {
        let h = (2.0 * f64::from(k) + 1.0) / f64::from(offsets) - 1.0;
        for (w, power, _) in walk(theta, h, 1.55, 12) {
            let phi = w[1].atan2(w[0]);
            for (m, want) in want.iter_mut().enumerate() {
                let fade = (-0.5 * (m as f64 * f64::from(beta_n)).powi(2)).exp() / f64::from(offsets);
                want[0] += light(h) * power * (m as f64 * phi).cos() * fade;
                want[1] += light(h) * power * (m as f64 * phi).sin() * fade;
            }
        }
    }
    let mut got = [[0.0f64; 2]; 4];
    let places = 1000;
    for k in 0..places {
        let h = (2.0 * f64::from(k) + 1.0) / f64::from(places) - 1.0;
        let at = fiber.at(&FiberQuery { h_rel: Some(h as f32), ..query });
        let energy = f64::from(at.albedo()[0]);
        let (mut sums, mut all) = ([[0.0f64; 2]; 4], 0.0);
        for j in 0..2 * bins {
            let phi = f64::from(j) / f64::from(2 * bins) * TAU;
            let f = f64::from(at.eval(direction(-theta as f32, phi as f32))[0]);
            all += f;
            for (m, sum) in sums.iter_mut().enumerate() {
                sum[0] += f * (m as f64 * phi).cos();
                sum[1] += f * (m as f64 * phi).sin();
            }
        }
        for m in 0..4 {
            // One latitude represents all: M is the same for every order.
            (0..2).for_each(|c| got[m][c] += light(h) * energy * sums[m][c] / all / f64::from(places));
        }
    }
    for m in 0..4 {
        for c in 0..2 {
            assert!((got[m][c] - want[m][c]).abs() < 2e-3 * want[0][0], "{m}: got {:?}, want {:?}", got[m], want[m]);
        }
    }
    // It differs from an even beam of the same power.
    assert!(want[1][1].abs() > 0.02 * want[0][0], "{want:?}");
}

/// Eq. 54: at one offset, the BFSDF integrated over all places of exit (xi_o and s) is the position-dependent
/// BSDF of a ribbon; paths of the walk are counted wherever they leave.
/// Its mean over a ribbon, places even in h, and over a half cylinder, places even in xi with the
/// foreshortening cos(xi - phi_i), is the far field's.
#[test]
fn position_dependent_bsdf_is_the_bfsdf_over_all_exits() {
    let (beta_n, sigma) = (0.1, 0.15f32);
    let p = DielectricParameters { radius_um: 1.0, beta_n, orders: 8, beta_m: [0.02; 3], ..Default::default() };
    let fiber = dielectric(p);
    for theta in [0.0f32, 0.5, -1.0] {
        let query = FiberQuery { sigma_per_um: [sigma], ..FiberQuery::new(direction(theta, 0.0), [0.5]) };
        let places = [-0.9, -0.55, -0.1, 0.2, 0.6, 0.85f32];
        for h in places {
            let at = fiber.at(&FiberQuery { h_rel: Some(h), ..query });
            // Moments over the azimuth; the spread multiplies them by exp(-m^2 beta^2 / 2).
            let (mut want, mut got) = ([[0.0f64; 2]; 5], [[0.0f64; 2]; 5]);
            for (w, power, length) in walk(theta.into(), h.into(), 1.55, 20) {
                let (phi, power) = (w[1].atan2(w[0]), power * (-f64::from(sigma) * length).exp());
                for (m, want) in want.iter_mut().enumerate() {
                    let fade = (-0.5 * (m as f64 * f64::from(beta_n)).powi(2)).exp();
                    want[0] += power * fade * (m as f64 * phi).cos();
                    want[1] += power * fade * (m as f64 * phi).sin();
                }
            }
            let (n, mut all) = (240, 0.0);
            for j in 0..n {
                let phi = f64::from(j) / f64::from(n) * TAU;
                let f = f64::from(at.eval(direction(-theta, phi as f32))[0]);
                all += f;
                for (m, got) in got.iter_mut().enumerate() {
                    got[0] += f * (m as f64 * phi).cos();
                    got[1] += f * (m as f64 * phi).sin();
                }
            }
            // One latitude represents all: M is the same for every order.
            let scale = f64::from(at.albedo()[0]) / all;
            for m in 0..5 {
                for c in 0..2 {
                    let (got, want) = (scale * got[m][c], want[m][c]);
                    assert!((got - want).abs() < 2e-3, "theta {theta}, h {h}, moment {m}: got {got}, want {want}");
                }
            }
        }
        let energy = |h: f64| f64::from(fiber.at(&FiberQuery { h_rel: Some(h as f32), ..query }).albedo()[0]);
        let n = 2000;
        let middle = |k: i32| (2.0 * f64::from(k) + 1.0) / f64::from(n) - 1.0;
        let ribbon = (0..n).map(|k| energy(middle(k)) / f64::from(n)).sum::<f64>();
        let xi = |k: i32| FRAC_PI_2 * middle(k);
        // The half cylinder's width is 2 of its arc of pi.
        let half = (0..n).map(|k| energy(xi(k).sin()) * xi(k).cos() * 0.5 * PI / f64::from(n)).sum::<f64>();
        let far = f64::from(fiber.at(&query).albedo()[0]);
        assert!((ribbon - half).abs() < 1e-4 && (ribbon - far).abs() < 2e-3, "{theta}: {ribbon}, {half}, {far}");
    }
}
