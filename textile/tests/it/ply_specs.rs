//! The yarn specs that ship, in the language of cloths: each stands for the ply of its model.

use plywave::PlyModel;
use plywave::cloth::YarnColor;
use plywave::color::Undyed;
use plywave::spec::YarnSpec;
use plywave_textile::{ClothSpec, alike, load_yarn_file};

const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");

fn spec_of(model: &str) -> YarnSpec {
    let model = PlyModel::load(format!("{FABRICS}/models/{model}.pwm")).unwrap();
    YarnSpec::parse(&model.data().spec_text, "model").unwrap()
}

#[test]
fn yarns_that_ship_are_those_of_their_models() {
    for name in [
        "alpaca",
        "cotton",
        "cotton_2ply",
        "cotton_3ply",
        "cotton_4ply",
        "glass",
        "gold",
        "polyester",
        "polyester_3ply",
        "silk",
        "viscose",
        "wool",
        "wool_2ply",
    ] {
        let (spec, text) = load_yarn_file(format!("{FABRICS}/{name}.toml")).unwrap();
        assert_eq!(YarnSpec::parse(&text, "again").unwrap(), spec, "{name}");
        let of_model = spec_of(name);
        // Rounding of counts aside, they are the same.
        let ply = |spec: &YarnSpec| YarnSpec { yarn: Default::default(), ..spec.clone() };
        assert!(alike(&ply(&spec), &ply(&of_model)), "{name}:\n{spec:#?}\n{of_model:#?}");
        assert_eq!((&spec.name, spec.yarn, &spec.simulation), (&of_model.name, of_model.yarn, &of_model.simulation));
        assert_eq!(
            (spec.ply.fibers, spec.ply.fiber_pitch_um),
            (of_model.ply.fibers, of_model.ply.fiber_pitch_um),
            "{name}"
        );
        assert!((spec.ply_radii_um()[0] - of_model.ply_radii_um()[0]).abs() < 0.06, "{name}");
    }
}

/// The ply that follows from each cloth's yarn has its model among those that ship.
#[test]
fn yarns_of_cloths_that_ship_have_a_model() {
    let names: Vec<String> = std::fs::read_dir(format!("{FABRICS}/models"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter_map(|name| name.strip_suffix(".pwm").map(str::to_string))
        .collect();
    let models: Vec<YarnSpec> = names.iter().map(|name| spec_of(name)).collect();
    for entry in std::fs::read_dir(format!("{FABRICS}/cloths")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "toml") {
            continue;
        }
        let cloth = ClothSpec::parse(&std::fs::read_to_string(&path).unwrap(), "cloth").unwrap();
        for yarn in cloth.yarns() {
            let ply = yarn.ply("cloth", "yarn").unwrap();
            assert!(models.iter().any(|model| alike(&ply, model)), "{}:\n{ply:#?}", path.display());
        }
    }
}

/// What differs by more than a weaver's eye is another ply.
#[test]
fn other_plies_are_told_apart() {
    let ply = spec_of("cotton_bundle_ne7");
    assert!(alike(&ply, &ply));
    let changed = |change: &dyn Fn(&mut YarnSpec)| {
        let mut other = ply.clone();
        change(&mut other);
        alike(&ply, &other)
    };
    assert!(changed(&|other| other.ply.radius_um = Some(58.2)) && !changed(&|other| other.ply.radius_um = Some(59.0)));
    assert!(changed(&|other| other.ply.fibers = 77) && !changed(&|other| other.ply.fibers = 82));
    assert!(changed(&|other| other.ply.fiber_pitch_um = Some(2300.0)));
    assert!(!changed(&|other| other.ply.fiber_pitch_um = Some(1500.0)));
    assert!(!changed(&|other| other.ply.fiber_pitch_um = None));
    assert!(!changed(&|other| other.ply.handedness = plywave::spec::Handedness::S));
    assert!(!changed(&|other| other.fiber.alpha_fiber = 0.3) && !changed(&|other| other.fiber.eta = 1.6));
    assert!(!changed(&|other| other.beam.w0_um = 12.0));
}

/// A monofilament is as thick as its count says and is the whole ply (Kotilainen et al. 2018: 360 den of HDPE
/// is 232 um wide); a yarn of two filaments is none.
#[test]
fn monofilaments_are_their_ply() {
    let read = |yarn: &str| {
        let weave = "name = \"net\"\n[weave]\nkind = \"plain\"\nends_per_cm = 16\npicks_per_cm = 16\n";
        ClothSpec::parse(&format!("{weave}[warp]\n{yarn}\n[weft]\nas = \"warp\"\n"), "net.toml")
    };
    for (fiber, count, um) in [
        ("polyethylene", "360 den", 231.5),
        ("hdpe", "360/1 den", 231.5),
        ("polypropylene", "360/1 den", 236.5),
        ("pvc coated", "1500 den", 400.9),
    ] {
        let spec = read(&format!("fiber = \"{fiber}\"\ncount = \"{count}\"")).unwrap();
        let yarn = spec.yarns()[0];
        assert!((2.0 * yarn.radius_um() - um).abs() < 0.5, "{fiber}: {}", 2.0 * yarn.radius_um());
        let ply = yarn.ply("net.toml", "warp").unwrap();
        let shares = 1.0 - ply.packing_fraction();
        assert!(ply.ply.fibers == 1 && (0.0..0.002).contains(&shares), "{fiber}: {shares}");
        assert_eq!(ply.fiber.scattering_per_um > 0.0, fiber != "polypropylene");
    }
    let two = read("fiber = \"polyethylene\"\ncount = \"360/2 den\"").unwrap();
    assert_eq!(two.yarns()[0].ply("net.toml", "warp").unwrap().ply.fibers, 2);
    let color = |fiber: &str| {
        let spec = read(&format!("fiber = \"{fiber}\"\ncount = \"200 den\"\ncolor = \"undyed\""))?;
        Ok::<_, plywave::Error>(spec.yarns()[0].color)
    };
    assert_eq!(color("flax").unwrap(), YarnColor::Natural(Undyed::Cellulose));
    assert_eq!(color("alpaca").unwrap(), YarnColor::Natural(Undyed::Wool));
    let refused = color("polyester").unwrap_err().to_string();
    assert_eq!(
        refused,
        "net.toml: warp.color = undyed: polyester has no color of its own: leave this out for clear fibers"
    );
}
