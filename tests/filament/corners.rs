//! `plywave check` at the corners of what specs take: least and greatest index, widths, orders, absorption.

use super::*;
use plywave::check::check_fiber;
use plywave::fiber::FilamentSpec;

/// A spec of these keys passes, without absorption and with three depths of it.
fn passes(keys: &str, seed: u64) {
    let text = format!("name = \"x\"\n[filament]\n{keys}\n");
    let spec = FilamentSpec::parse(&text, "x.toml").unwrap();
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    // Of a radius of 40 um: lengths times absorption of 0.3 to 20.
    for report in check_fiber(&spec.model, spec.lambda_um, [0.004, 0.02, 0.25], 6000, &mut || rng.random()) {
        assert!(report.passed(), "{keys}: {report:?}");
    }
}

#[test]
fn dielectric_corners_pass() {
    for (k, eta) in ["1.01", "1.03", "1.1", "1.19", "1.2", "2", "4"].into_iter().enumerate() {
        passes(&format!("kind = \"dielectric\"\nradius_um = 40\neta = {eta}"), k as u64);
        passes(&format!("kind = \"dielectric\"\nradius_um = 40\neta = {eta}\nbeta_n = 10\nbeta_m = [2, 2, 2]\norders = 1"), 20 + k as u64);
    }
    passes("kind = \"dielectric\"\nradius_um = 40\neta = 1.01\nbeta_n = 0.05\norders = 8\nshift = [1, -1, 0.5]", 40);
}
