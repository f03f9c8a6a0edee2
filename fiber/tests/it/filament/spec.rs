//! Specs of analytic fibers.

use super::*;
use plywave_fiber::FilamentSpec;

#[test]
fn every_kind_is_read_and_asked() {
    for (keys, albedo_at_least) in [
        ("kind = \"dielectric\"\neta = 1.5\nbeta_m = [0.1, 0.1, 0.2]\norders = 4", 0.99),
        ("kind = \"rough_dielectric\"\neccentricity = 0.9\nwidth_phi = [0.1, 0.1, 0.3]", 0.8),
        ("kind = \"opaque\"\nmetal = \"gold\"", 0.3),
        ("kind = \"opaque\"\neta = 1.5\ndiffuse = 1", 0.99),
        ("kind = \"opaque\"\neta = 1.5\nkappa = 4", 0.5),
        ("kind = \"kajiya_kay\"\nexponent = 20", 0.1),
    ] {
        let text = format!("name = \"x\"\n\n[filament]\n{keys}\n");
        let spec = FilamentSpec::parse(&text, "x.toml").unwrap();
        let query = FiberQuery::new(direction(0.3, 0.0), spec.lambda_um);
        let albedo = spec.model.at(&query).albedo();
        assert!(albedo.iter().all(|a| *a > albedo_at_least && *a < 1.5), "{keys}: {albedo:?}");
    }
}

/// One line with file, key, value and hint.
#[test]
fn bad_specs_are_refused_in_one_line() {
    for (keys, want) in [
        ("kind = \"dielectric\"\neta = 0.9", "x.toml: filament.eta = 0.9: use a number from 1.01 to 4"),
        ("kind = \"dielectric\"\nbeta_n = 0", "x.toml: filament.beta_n = 0: use a number from 0.001 to 10"),
        (
            "kind = \"dielectric\"\nbeta_m = [0.1, 0, 0.1]",
            "x.toml: filament.beta_m = [0.1, 0, 0.1]: use three numbers from 0.001 to 2",
        ),
        ("kind = \"opaque\"\neta = 1.5\nkappa = -1", "x.toml: filament.kappa = -1: use a number from 0 to 50"),
        ("kind = \"opaque\"\nkappa = 1", "x.toml: filament.kappa = 1: give eta with it"),
        ("kind = \"opaque\"\nmetal = \"gold\"\neta = 2", "x.toml: filament.eta = 2: a named metal has its own"),
        ("kind = \"opaque\"\neta = 0.5", "x.toml: filament.eta = 0.5: use 1.01 to 4"),
        ("kind = \"opaque\"\nmetal = \"lead\"", "x.toml: filament.metal = \"lead\": use one of \"gold\""),
        (
            "kind = \"rough_dielectric\"\nwidth_phi = [0.1, 0.01, 0.1]",
            "x.toml: filament.width_phi = [0.1, 0.01, 0.1]: use three numbers, 0 or",
        ),
        ("kind = \"rough_dielectric\"\nradius_um = nan", "x.toml: filament.radius_um = nan: use a number"),
        ("kind = \"rough_dielectric\"\nradius_mm = 1", "x.toml: filament.radius_mm = 1: unknown unit: use radius_um"),
        ("kind = \"kajiya_kay\"\nphong = 0\ndiffuse = 0", "x.toml: filament.phong = 0: use more"),
        ("kind = \"glass\"", "x.toml: filament.kind = \"glass\": use one of \"dielectric\""),
        ("", "x.toml: filament.kind = (absent): use one of"),
    ] {
        let line =
            FilamentSpec::parse(&format!("name = \"x\"\n[filament]\n{keys}\n"), "x.toml").unwrap_err().to_string();
        assert!(line.starts_with(want) && !line.contains('\n'), "got {line}\nwant {want}");
    }
    let line = FilamentSpec::parse("name = \"x\"\nsigma_per_um = [0, -1, 0]\n[filament]\nkind = \"opaque\"", "x.toml");
    assert!(line.unwrap_err().to_string().starts_with("x.toml: sigma_per_um = [0, -1, 0]: use three numbers from 0"));
}
