//! Kajiya and Kay's model (Zinke 2007, Eq. 41).

use super::*;

/// Eq. 41 as printed, times cos theta_o; the checks; `K_diffuse = 1 / pi^2` alone is white.
#[test]
fn kajiya_kay_is_the_printed_one_and_passes_the_checks() {
    for (j, p) in [
        KajiyaKayParameters::default(),
        KajiyaKayParameters { phong: 0.3, exponent: 400.0, diffuse: 0.0, ..Default::default() },
        KajiyaKayParameters { phong: 0.0, diffuse: 1.0 / std::f32::consts::PI.powi(2), ..Default::default() },
        KajiyaKayParameters { exponent: 1.0, ..Default::default() },
    ]
    .into_iter()
    .enumerate()
    {
        let fiber: FiberModel = KajiyaKayFiber::new(p).unwrap().into();
        for (k, query) in queries(70, &[None]).into_iter().enumerate() {
            let at = fiber.at(&query);
            let theta_i = f64::from(query.omega_i[2]).asin();
            for theta_o in [-1.3, -0.6, 0.0, 0.5, 1.2f64] {
                let phong = (theta_o + theta_i).cos().max(0.0).powf(f64::from(p.exponent)) / theta_i.cos();
                let want = (f64::from(p.phong) * phong + f64::from(p.diffuse)) * theta_o.cos();
                let got = f64::from(at.eval(direction(theta_o as f32, 1.0))[1]);
                assert!((got - want).abs() < 1e-3 * want + 1e-6, "{p:?} {theta_i} {theta_o}: got {got}, want {want}");
            }
            let sd = 0.7 / f64::from(p.exponent).sqrt();
            check(&at, [sd.min(0.3), 0.5], 2e-3, (700 + 10 * j + k) as u64, &format!("{p:?} {query:?}"));
            if p.phong == 0.0 {
                assert!((at.albedo()[0] - 1.0).abs() < 1e-5);
            }
        }
    }
    let line =
        KajiyaKayFiber::new(KajiyaKayParameters { exponent: 0.0, ..Default::default() }).unwrap_err().to_string();
    assert!(line.starts_with("Kajiya-Kay fiber: "), "{line}");
}
