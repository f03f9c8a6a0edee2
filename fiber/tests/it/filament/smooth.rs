//! Smooth dielectric fibers, near and far field (Zinke 2007, Eq. 29-38).

use super::*;
use plywave_fiber::DielectricBsdf;
use plywave_fiber::cylinder::bcsdf_of_energy;

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

/// The mean of the near field over the offsets is the far field (Eq. 35 and 38), by its first Fourier
/// coefficients over the azimuth.
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

/// Eq. 36 in a white room: L_o / D is 1 for a clear fiber of narrow lobes. With wide ones it is the mean of
/// `cos theta_i / cos theta_o` over the lobe, as f = M N keeps the energy of each light and not of each view.
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
