//! Guarantees of fiber tables: directions that are not unit vectors give no light, and no width is too small.

use crate::no_direction::{NONE, dark};
use plywave::Bsdf;
use plywave_fiber::{FiberQuery, FiberSource, FiberTable, OutlineSymmetry, TabulatedFiber};

/// A lossless round fiber that scatters evenly over the azimuth.
fn round_fiber() -> FiberTable {
    FiberTable {
        spec_text: "made up".into(),
        program_version: "0".into(),
        preset: "test".into(),
        seed: 1,
        source: FiberSource::Wave,
        symmetry: OutlineSymmetry::CIRCLE,
        beta_m: 0.15,
        lambda_um: vec![0.5, 0.6],
        theta_i: FiberTable::theta_nodes(4),
        phi_i: OutlineSymmetry::CIRCLE.phi_i(1),
        width_um: vec![2.0],
        c_x_um: vec![4.0; 8],
        c_abs_um: vec![0.0; 8],
        azimuthal: vec![1.0 / std::f32::consts::TAU; 8 * 16],
    }
}

#[test]
fn light_of_no_direction_is_none() {
    let fiber = TabulatedFiber::from_table(round_fiber()).unwrap();
    for w in NONE {
        dark(&fiber.at(&FiberQuery::new([0.6, 0.0, 0.8], [0.5, 0.6])), w, "fiber");
        let at = fiber.at(&FiberQuery::new(w, [0.5]));
        dark(&at, [0.6, 0.0, 0.8], "fiber lit from nowhere");
        assert!(at.albedo() == [0.0] && at.width_um() == [0.0]);
    }
}

/// A width of NaN counts as the least.
#[test]
fn longitudinal_widths_that_are_no_numbers_are_the_least() {
    let fiber = TabulatedFiber::from_table(round_fiber()).unwrap().with_beta_m(f32::NAN);
    assert_eq!(fiber.table().beta_m, 0.001);
    let f = fiber.at(&FiberQuery::new([0.6, 0.0, 0.8], [0.5])).eval([0.6, 0.0, -0.8]);
    assert!(f[0].is_finite() && f[0] > 0.0, "{f:?}");
}
