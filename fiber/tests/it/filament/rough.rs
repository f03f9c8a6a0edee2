//! Rough dielectric fibers, near and far field, and Marschner's model (Zinke 2007, 9.2, Eq. 42-43, 52-53).

use super::*;
use plywave_fiber::cylinder::relative_azimuth;

/// Eq. 53 written out in f64, with TRT's argument as Eq. 23 has it: the energy density, that is times cos
/// theta_o.
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

/// Furnace against the albedo's own integral, sampling, chi-square, at a near and the far field; rough, and
/// Marschner's with caustics.
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

/// The far field is the mean of the near field (Eq. 35 of 52), at the least width too; `k_d = 1 / (2 pi^2)`
/// alone is white.
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

/// Eq. 43: R of Marschner's model is `a(theta_d, sin(phi/2)) cos(phi/2) g / (4 cos^2 theta_d)`, derived from
/// Eq. 42 by Eq. 35; an opaque inside leaves it alone. And widths that shrink give the smooth cylinder: the
/// mean of the rough far field over a tenth of a radian is Marschner's.
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
    // Away from caustics and edges by five widths the blur of 0.06 rad moves little: TT at its middle, where
    // a(h) and |dh/dphi| change slowly.
    let narrow = rough(RoughDielectricParameters { width_phi: [0.06; 3], ..p });
    let clear = FiberQuery { sigma_per_um: [0.0], ..query };
    for phi in [PI, PI - 0.3, PI + 0.3] {
        let w = direction(-0.5, (1.0 + phi) as f32);
        let (a, b) = (f64::from(fiber.at(&clear).eval(w)[0]), f64::from(narrow.at(&clear).eval(w)[0]));
        assert!((a / b - 1.0).abs() < 0.02, "{phi}: {a} and {b}");
    }
}

/// Elliptical sections (Zinke 2007, 8.2): an ellipse of e near 1 is nearly the circle; TRT sees n_1 where
/// light comes and goes along x, n_2 along y; its width is the projected one; the checks hold, near and far.
#[test]
fn ellipses_change_trt_alone() {
    let circle = rough(RoughDielectricParameters::default());
    let nearly = rough(RoughDielectricParameters { eccentricity: 1.000_001, ..Default::default() });
    let oval = RoughDielectricParameters { eccentricity: 0.9, k_d: 0.001, ..Default::default() };
    for h_rel in [None, Some(0.6)] {
        for phi_i in [0.0, 0.7, 1.5f32] {
            let query = FiberQuery { h_rel, sigma_per_um: [0.004], ..FiberQuery::new(direction(0.2, phi_i), [0.5]) };
            let (a, b) = (circle.at(&query), nearly.at(&query));
            for k in 0..64 {
                let w = direction(-0.1, 0.1 * k as f32);
                let (a, b) = (f64::from(a.eval(w)[0]), f64::from(b.eval(w)[0]));
                // The circle's far field is a table.
                assert!((a - b).abs() < 4e-3 * a + 1e-4, "{h_rel:?} {phi_i} {k}: {a} and {b}");
            }
        }
    }
    // Straight back along x and y, the fiber opaque to TT's side: TRT of a circle of n_1 and n_2.
    let n = |e: f32| 2.0 * 0.55 * e * e - 1.55 + 2.0;
    for (phi_i, eta) in [(0.0, n(0.9)), (std::f32::consts::FRAC_PI_2, n(1.0 / 0.9))] {
        let query = FiberQuery { h_rel: Some(0.3), ..FiberQuery::new(direction(0.0, phi_i), [0.5]) };
        let trt = RoughDielectricParameters { width_theta: [0.005, 0.005, 0.2], shift: [0.9, 0.9, 0.0], ..oval };
        let w = direction(0.05, phi_i);
        let got = f64::from(rough(trt).at(&query).eval(w)[0]);
        let want = RoughDielectricParameters { eta, eccentricity: 1.0, ..trt };
        let want = f64::from(rough(want).at(&query).eval(w)[0]);
        assert!((got - want).abs() < 1e-4 * want, "{phi_i}: {got}, want {want}");
    }
    let fiber: FiberModel = rough(oval).into();
    let width = |phi: f32| fiber.at(&FiberQuery::new(direction(0.0, phi), [0.5])).width_um()[0];
    assert!((width(0.0) - 80.0 / 0.9f32.sqrt()).abs() < 1e-3, "{}", width(0.0));
    assert!((width(std::f32::consts::FRAC_PI_2) - 80.0 * 0.9f32.sqrt()).abs() < 1e-3);
    assert!((fiber.max_width_um() - width(0.0)).abs() < 1e-3);
    for (k, query) in queries(60, &[None, Some(0.5)]).into_iter().take(4).enumerate() {
        let query = FiberQuery { sigma_per_um: [0.0, 0.002, 0.02], ..query };
        check(&fiber.at(&query), [0.05, 0.1], 2e-3, 800 + k as u64, &format!("{query:?}"));
    }
}

/// Where the models are reciprocal: `f / cos theta_o` is the same with light and view swapped for the far
/// fields of Eq. 52 and of Marschner's model, whose attenuations are taken at theta_d, and for the Lambertian
/// fiber; for the near field at the offset with the opposite sign, where reversed light enters.
#[test]
fn swapped_directions_agree_where_the_models_are_reciprocal() {
    let hair = RoughDielectricParameters { k_d: 0.01, ..Default::default() };
    let marschner = RoughDielectricParameters::marschner(1.55, 40.0, [-0.1, 0.05, 0.15], [0.1, 0.1, 0.2]);
    let matte = OpaqueParameters { mirror: Mirror::None, diffuse: 0.6, ..Default::default() };
    let list: [(&str, FiberModel, &[Option<f32>]); 3] = [
        ("hair", rough(hair).into(), &[None, Some(0.3), Some(-0.8)]),
        ("marschner", rough(marschner).into(), &[None]),
        ("matte", opaque(matte).into(), &[None]),
    ];
    let mut rng = Pcg64Mcg::seed_from_u64(77);
    for (name, fiber, offsets) in list {
        let (mut most, mut seen) = (0.0f64, 0);
        for k in 0..600 {
            let h_rel = offsets[k % offsets.len()];
            let theta_i = 2.4 * rng.random::<f32>() - 1.2;
            let theta_o = (-theta_i + 0.6 * (rng.random::<f32>() - 0.5)).clamp(-1.4, 1.4);
            let [phi_i, phi_o] = [6.0 * rng.random::<f32>(), 6.0 * rng.random::<f32>()];
            let (i, o) = (direction(theta_i, phi_i), direction(theta_o, phi_o));
            let f = |from: [f32; 3], to: [f32; 3], h_rel: Option<f32>, theta: f32| {
                let query = FiberQuery { sigma_per_um: [0.004], h_rel, ..FiberQuery::new(from, [0.5]) };
                f64::from(fiber.at(&query).eval(to)[0]) / f64::from(theta).cos()
            };
            let (there, back) = (f(i, o, h_rel, theta_o), f(o, i, h_rel.map(|h| -h), theta_i));
            let off = (there - back).abs() / (there.max(back) + 1e-3);
            most = most.max(off);
            seen += usize::from(there > 0.01);
            // Angles are known to 1e-6 in 32 bits, widths are from 0.05 and caustics lie between.
            assert!(off < 1e-4, "{name}, {h_rel:?}, {i:?}, {o:?}: {there} and {back}");
        }
        println!("{name}: f / cos theta_o swapped, off by {most:.1e} at most; {seen} of 600 pairs with light");
        assert!(seen > 200, "{name}: {seen}");
    }
}

/// The widths along the fiber and of the offset (w_s, w_h of Eq. 52). w_s vanishes in the integral over the
/// exit position along the axis. w_h blurs the offset of exit about that of entry: the near field is then the
/// mean of Eq. 53 by `g(1, h_o + h_i, w_h)`, as of light that varies over the width (Eq. 39-40), and the far
/// field, its mean over h_o, loses what the blur carries past the rims alone: `w_h / sqrt(2 pi)` of the light
/// where all offsets are alike.
#[test]
fn blur_of_the_offset_costs_the_far_field_the_rims() {
    let fiber = rough(RoughDielectricParameters { width_phi: [0.3; 3], ..Default::default() });
    let query = FiberQuery { sigma_per_um: [0.003], ..FiberQuery::new(direction(0.4, 0.0), [0.5]) };
    let n = 1000;
    let middle = |k: usize| (2 * k + 1) as f64 / n as f64 - 1.0;
    for w_h in [0.02f64, 0.05] {
        // Share of an entry's light that leaves within the width, g being 1 over its own interval.
        let kept = |h: f64| {
            let steps = 400;
            let mean = |from: f64, to: f64| {
                (0..steps)
                    .map(|s| from + (to - from) * (f64::from(s) + 0.5) / f64::from(steps))
                    .map(|x: f64| (-0.5 * (x / w_h).powi(2)).exp() * (to - from) / f64::from(steps))
                    .sum::<f64>()
            };
            mean((h - 1.0).max(-1.0), (h + 1.0).min(1.0)) / mean(-1.0, 1.0)
        };
        let all: f64 = (0..n).map(|k| 1.0 - kept(middle(k))).sum::<f64>() / n as f64;
        assert!((all - w_h / TAU.sqrt()).abs() < 0.02 * all, "{w_h}: {all}");
        for phi in [0.4f32, 1.5, 3.0] {
            let w = direction(-0.35, phi);
            let far = f64::from(fiber.at(&query).eval(w)[0]);
            let (mut blurred, mut lost) = (0.0, 0.0);
            for k in 0..n {
                let at = fiber.at(&FiberQuery { h_rel: Some(middle(k) as f32), ..query });
                let f = f64::from(at.eval(w)[0]) / n as f64;
                blurred += f * kept(middle(k));
                lost += f * (1.0 - kept(middle(k)));
            }
            println!("w_h {w_h}, azimuth {phi}: far {far:.5}, blurred {blurred:.5}, past the rims {lost:.5}");
            assert!((blurred + lost - far).abs() < 4e-3 * far, "{w_h}, {phi}: {blurred} + {lost}, {far}");
            assert!(lost < 4.0 * w_h * far, "{w_h}, {phi}: {lost} of {far}");
        }
    }
}
