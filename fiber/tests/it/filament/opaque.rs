//! Opaque fibers: Lambert exactly, Fresnel, conductors and metals (Zinke 2007, 9.1).

use super::*;
use plywave::optics::{conductor, fresnel};
use plywave_fiber::opaque::{bcsdf_of_brdf, lambertian, lambertian_by_zinke};

/// Closed forms of physics: k_d pi/4 at phi = 0, integral 2 k_d over the azimuth, and Eq. 48 by quadrature;
/// Eq. 51 deviates as docs/explain/papers/zinke_weber_2007.md says.
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

/// Fresnel's reflectance of conductors by complex numbers, and of metals at published values.
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
    // A black fiber absorbs all light.
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

/// The far field is the mean of the near field, which is the surface itself under the light: Eq. 48 against
/// Eq. 44.
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
