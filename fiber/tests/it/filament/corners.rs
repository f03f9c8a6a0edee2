//! `plywave check` at the corners of the range of specs: least and greatest index, width, order, strength,
//! without absorption and with lengths times it of 0.3 to 20 and beyond.

use super::*;
use plywave_check::{FiberReport, check_fiber, clear_albedo};
use plywave_fiber::FilamentSpec;

const SIGMA_PER_UM: [f32; 3] = [0.0, 0.02, 0.25];

fn spec(keys: &str) -> FilamentSpec {
    FilamentSpec::parse(&format!("name = \"x\"\n[filament]\n{keys}\n"), "x.toml").unwrap()
}

/// Checks of each spec; with so many p-values some hundredth of a percent occurs by chance.
fn pass(specs: &[&str], samples: usize) {
    for (k, keys) in specs.iter().enumerate() {
        let spec = spec(keys);
        let mut rng = Pcg64Mcg::seed_from_u64(k as u64);
        for mut report in check_fiber(&spec.model, spec.lambda_um, SIGMA_PER_UM, samples, &mut || rng.random()) {
            assert!(report.scatter.chi2_p > 1e-5, "{keys}: {report:?}");
            report.scatter.chi2_p = 1.0;
            assert!(FiberReport::passed(&report), "{keys}: {report:?}");
        }
    }
}

/// A fiber of the least index from a file: its TT is 0.28 rad wide and holds paths of all lengths.
#[test]
fn least_index_passes() {
    let spec = FilamentSpec::load("../tests/data/field/filament_eta_101/low.toml").unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for report in check_fiber(&spec.model, spec.lambda_um, spec.sigma_per_um, 20_000, &mut || rng.random()) {
        assert!(report.passed(), "{report:?}");
    }
}

#[test]
#[ignore = "slow: 5 s: dielectric corners pass"]
fn dielectric_corners_pass() {
    pass(
        &[
            "kind = \"dielectric\"\nradius_um = 40\neta = 1.01",
            "kind = \"dielectric\"\nradius_um = 40\neta = 1.05\norders = 1",
            "kind = \"dielectric\"\nradius_um = 40\neta = 1.19\nbeta_n = 10\nbeta_m = [2, 2, 2]\norders = 1",
            "kind = \"dielectric\"\nradius_um = 40\neta = 1.2\norders = 2",
            "kind = \"dielectric\"\nradius_um = 40\neta = 4\nbeta_n = 0.05\norders = 8\nshift = [1, -1, 0.5]",
            "kind = \"rough_dielectric\"\neta = 1.01",
            "kind = \"rough_dielectric\"\neta = 1.01\nwidth_theta = [1, 1, 1]\nwidth_phi = [10, 10, 10]\nshift = [-1, 1, 0]",
            "kind = \"rough_dielectric\"\neta = 4\nwidth_theta = [1, 1, 1]\nwidth_phi = [10, 10, 10]\nk_d = 0.05\nshift = [1, 1, 1]",
            "kind = \"rough_dielectric\"\nwidth_theta = [0.005, 0.02, 0.3]\nwidth_phi = [0.06, 10, 0.3]",
        ],
        6000,
    );
}

/// Khungurn's narrowest and widest lobes, together and apart.
#[test]
fn khungurn_corners_pass() {
    pass(
        &[
            "kind = \"khungurn\"\nbeta_r = 0.005\nbeta_tt = 0.005\ngamma_tt = 0.01",
            "kind = \"khungurn\"\nbeta_r = 0.005\nbeta_tt = 10\ngamma_tt = 1000\nc_tt = [1, 0.1, 0]",
            "kind = \"khungurn\"\nbeta_r = 10\nbeta_tt = 0.2\ngamma_tt = 0.01\nc_r = 0\nc_tt = 1",
        ],
        6000,
    );
}

#[test]
fn opaque_and_parametric_corners_pass() {
    pass(
        &[
            "kind = \"kajiya_kay\"\nexponent = 1\nphong = 10\ndiffuse = 0",
            "kind = \"kajiya_kay\"\nexponent = 10000\nphong = 10\ndiffuse = 0.1",
            "kind = \"kajiya_kay\"\nphong = 0\ndiffuse = 0.1",
            "kind = \"opaque\"\nmetal = \"gold\"\nbeta_m = 0.01\nbeta_n = 0.1",
            "kind = \"opaque\"\nmetal = \"silver\"\nbeta_m = 2\nbeta_n = 10\ndiffuse = 1",
            "kind = \"opaque\"\neta = 1.01\ndiffuse = 1",
            "kind = \"opaque\"\neta = 4\ndiffuse = 0",
            "kind = \"opaque\"\neta = 0.01\nkappa = 50\ndiffuse = 0.5",
            "kind = \"opaque\"\neta = 20\nkappa = 0\ndiffuse = 1",
            "kind = \"opaque\"\ndiffuse = 1",
        ],
        6000,
    );
}

/// At grazing light of every index the integral of eval is the albedo that the offsets give: rows of the far
/// field's table are close enough there.
#[test]
fn far_fields_hold_at_grazing_light() {
    for (eta, radius_um) in [(1.01, 40.0), (1.05, 10.0), (1.19, 40.0), (1.55, 40.0), (4.0, 40.0)] {
        let fiber =
            dielectric(DielectricParameters { eta, radius_um, beta_m: [0.3; 3], beta_n: 0.3, ..Default::default() });
        for degrees in [70.0, 80.0, 85.0, 87.5, 88.9, 89.6, 89.9f32] {
            let query = FiberQuery::new(direction(degrees.to_radians(), 0.0), [0.61, 0.55, 0.465]);
            let at = fiber.at(&FiberQuery { sigma_per_um: SIGMA_PER_UM, ..query });
            let (rows, columns) = (160, 64);
            let mut sums = [0.0; 3];
            for i in 0..rows {
                let x = 2.0 * (f64::from(i) + 0.5) / f64::from(rows) - 1.0;
                let theta_o = FRAC_PI_2 * (1.5 * x - 0.5 * x * x * x);
                let area = theta_o.cos() * FRAC_PI_2 * 3.0 * (1.0 - x * x) / f64::from(rows) * TAU / f64::from(columns);
                for j in 0..columns {
                    let f = at.eval(direction(theta_o as f32, (TAU * f64::from(j) / f64::from(columns)) as f32));
                    (0..3).for_each(|n| sums[n] += area * f64::from(f[n]));
                }
            }
            for (got, want) in sums.into_iter().zip(at.albedo()) {
                assert!((got - f64::from(want)).abs() < 5e-4, "{eta} at {degrees}: {got}, albedo {want}");
            }
        }
    }
}

/// The figures of docs/explain/filaments.md.
#[test]
fn albedos_farthest_from_1_are_those_stated() {
    for (keys, albedo, degrees) in [
        ("kind = \"dielectric\"", 1.0, None),
        ("kind = \"opaque\"\neta = 1.5\ndiffuse = 1", 1.0, None),
        ("kind = \"khungurn\"\nc_tt = 1", 1.0, None),
        ("kind = \"rough_dielectric\"", 2.446, Some(-89.9)),
        ("kind = \"rough_dielectric\"\nnormalize = true", 1.0, None),
    ] {
        let spec = spec(keys);
        let found = clear_albedo(&spec.model, spec.lambda_um);
        assert!((found.albedo - albedo).abs() < 1e-3, "{keys}: {found:?}");
        assert!(degrees.is_none_or(|d: f64| (d - found.theta_i_deg).abs() < 0.1), "{keys}: {found:?}");
    }
}
