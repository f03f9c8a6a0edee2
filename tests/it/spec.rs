//! The yarn spec: valid ones load, invalid ones are refused in one line that names the key and the hint, and
//! none panics.

use plywave::Error;
use plywave::io::MemoryAssets;
use plywave::spec::{POLYESTER, Shape, YarnSpec};
use proptest::prelude::*;

/// The message of a refused spec; one line, naming the file.
fn refusal(text: &str) -> String {
    let error = YarnSpec::parse(text, "yarn.toml").expect_err(text);
    let message = error.to_string();
    assert!(!message.contains(['\n', '\r']), "{message:?}");
    assert!(message.starts_with("yarn.toml: "), "{message}");
    message
}

/// Polyester with one piece of its text replaced.
fn polyester_with(old: &str, new: &str) -> String {
    assert!(POLYESTER.contains(old), "{old}");
    POLYESTER.replacen(old, new, 1)
}

fn with_shape(shape: &str) -> String {
    let start = POLYESTER.find("shape = {").unwrap();
    let end = start + POLYESTER[start..].find('}').unwrap() + 1;
    format!("{}shape = {shape}{}", &POLYESTER[..start], &POLYESTER[end..])
}

#[test]
fn polyester_is_the_yarn_of_the_readme() {
    let spec = YarnSpec::polyester().unwrap();
    assert_eq!(spec.fiber.shape, Shape::Circle { radius_um: 7.5 });
    assert_eq!((spec.ply.fibers, spec.ply.radius_um, spec.fiber.alpha_fiber), (30, Some(50.0), 0.2));
    assert!((spec.packing_fraction() - 30.0 * 7.5 * 7.5 / 2500.0).abs() < 1e-12);
    assert_eq!(YarnSpec::parse(&toml::to_string(&spec).unwrap(), "again").unwrap(), spec);
    spec.check("in code").unwrap();
}

#[test]
fn plies_lie_on_their_circle() {
    let one = YarnSpec::polyester().unwrap();
    assert_eq!((one.yarn.plies, one.ply_circle_um()), (1, 0.0));
    let yarn = |keys: &str| YarnSpec::parse(&format!("{POLYESTER}\n[yarn]\n{keys}\n"), "yarn").unwrap();
    let two = yarn("plies = 2");
    assert!((two.ply_circle_um() - 50.0).abs() < 1e-9);
    // Two plies lie as if parallel until the helix' slope at radius R passes 1, at a pitch of 2 pi R = 314
    // um.
    let loose = yarn("plies = 2\nply_pitch_um = 1000");
    assert!((loose.ply_circle_um() - 50.0).abs() < 1e-6, "{}", loose.ply_circle_um());
    let twisted = yarn("plies = 2\nply_pitch_um = 280\nhandedness = \"S\"");
    assert!(twisted.ply_circle_um() > 50.5 && twisted.ply_circle_um() < 100.0, "{}", twisted.ply_circle_um());
    assert_eq!(YarnSpec::parse(&toml::to_string(&twisted).unwrap(), "again").unwrap(), twisted);
    twisted.check("in code").unwrap();
}

#[test]
fn refusals_name_key_value_and_mend() {
    let radius = |new: &str| polyester_with("radius_um = 7.5", new);
    let eta = |new: &str| polyester_with("eta = 1.60", new);
    let ply = |new: &str| polyester_with("radius_um = 50.0", new);
    let pitch = |new: &str| polyester_with("fiber_pitch_um = 800.0", new);
    let end = |new: &str| format!("{POLYESTER}\n{new}\n");
    let blend = |keys: &str, index: &str| {
        let shape = "shape = { kind = \"circle\", radius_um = 6.0 }";
        format!("[blend]\n{keys}\n[blend.fiber]\n{shape}\n{index}\nalpha_fiber = 0.2\n")
    };
    let cases = [
        (radius("radius_um = -1.0"), "fiber.shape.radius_um = -1.0: use a number from 0.01 to 10000"),
        (radius("radius_um = nan"), "fiber.shape.radius_um = nan: use a number"),
        (radius("radius_um = \"big\""), "fiber.shape.radius_um = \"big\": use a number"),
        (radius("radius_nm = 7500"), "fiber.shape.radius_nm = 7500: unknown unit: use radius_um"),
        (radius("radius = 7.5"), "fiber.shape.radius = 7.5: unknown unit: use radius_um"),
        (radius("colour = 1"), "fiber.shape.colour = 1: unknown key: use one of radius_um"),
        (radius("radius_um = 7.5, rounding_um = 1"), "fiber.shape.rounding_um = 1: unknown key"),
        (polyester_with("kind = \"circle\", ", ""), "fiber.shape.kind = (absent): use one of \"circle\""),
        (polyester_with("\"circle\"", "\"square\""), "fiber.shape.kind = \"square\": use one of \"circle\""),
        (eta("eta = 1.0"), "fiber.eta = 1.0: use a number above 1 and up to 4"),
        (eta(""), "fiber.eta = (absent): this key must be given"),
        (eta("eta = -1.5"), "fiber.eta = -1.5: use a number above 0"),
        (eta("eta = 0.43"), "fiber.eta = 0.43: use a number above 1 and up to 4, or give kappa"),
        (eta("eta = 0.43\nkappa = -2.4"), "fiber.kappa = -2.4: use a number from 0.05 to 20"),
        (eta("eta = 0.43\nkappa = 0.05"), "fiber.kappa = 0.05: light would pass: use 0.058 or more"),
        (eta("eta = 1.6\nmetal = \"gold\""), "fiber.eta = 1.6: Gold brings its index: give either"),
        (eta("kappa = 2.4\nmetal = \"gold\""), "fiber.kappa = 2.4: Gold brings its index: give either"),
        (eta("metal = \"tin\""), "fiber.metal = \"tin\": use one of \"gold\", \"silver\""),
        (eta("metal = \"gold\"\ndispersion_um2 = 0.01"), "fiber.dispersion_um2 = 0.01: an opaque fiber has its index"),
        (eta("eta = 1.6\ndispersion_um2 = -0.01"), "fiber.dispersion_um2 = -0.01: use a number from 0 to 0.1"),
        (
            format!("{}\n[beam]\nlambda_um = 3.0", eta("eta = 1.1\ndispersion_um2 = 0.1")),
            "fiber.dispersion_um2 = an index of 0.8232 at 3 um: use less dispersion",
        ),
        (
            eta("metal = \"gold\"")
                .replace("\"circle\", radius_um = 7.5", "\"hollow_circle\", radius_um = 7.5, lumen = 0.4"),
            "fiber.shape.lumen = a core: no light is in an opaque fiber",
        ),
        (end("[blend]\nshare = 0.5"), "blend.fiber = (absent): this key must be given"),
        (end(&blend("share = 1.5", "eta = 1.5")), "blend.share = 1.5: use a number from 0.01 to 0.99"),
        (end(&blend("share = 0.5\ndye = -1", "eta = 1.5")), "blend.dye = -1: use a number from 0 to 10"),
        (end(&blend("share = 0.5", "eta = 0.5")), "blend.fiber.eta = 0.5: use a number above 1"),
        (end(&blend("share = 0.5", "metal = \"gold\"")), "blend.fiber.metal = an opaque fiber among clear ones: "),
        (
            format!("{}\n{}", eta("metal = \"silver\""), blend("share = 0.5", "metal = \"gold\"")),
            "blend.fiber.metal = another metal: ",
        ),
        (
            format!("{}\n{}", eta("metal = \"gold\""), blend("share = 0.5\ndye = 2", "metal = \"gold\"")),
            "blend.dye = 2: fibers of the same metal absorb alike",
        ),
        (
            format!("{}\n{}", eta("metal = \"gold\""), blend("share = 0.5", "eta = 1.5")),
            "fiber.metal = clear fibers among opaque ones: ",
        ),
        (eta("eta = 1.60\nalpha = 0.2"), "fiber.alpha = 0.2: unknown key"),
        (polyester_with("alpha_fiber = 0.2", "alpha_fiber = 1.5"), "fiber.alpha_fiber = 1.5: use a number from 0 to 1"),
        (polyester_with("fibers = 30", "fibers = 0"), "ply.fibers = 0: use an integer from 1 to 200"),
        (polyester_with("fibers = 30", "fibers = 30.0"), "ply.fibers = 30.0: use an integer"),
        (polyester_with("fibers = 30", "fibers = 200"), "ply.radius_um = 50: 200 fibers fill 4.500 of the ply"),
        (ply("radius_um = 50.0\nradii_um = [60, 40]"), "ply.radii_um = [60.0, 40.0]: give either"),
        (ply(""), "ply.radius_um = (absent): give radius_um, or radii_um"),
        (ply("radii_um = [60]"), "ply.radii_um = [60]: use two numbers"),
        (pitch("fiber_pitch_mm = 0.8"), "ply.fiber_pitch_mm = 0.8: unknown unit: use fiber_pitch_um"),
        (pitch("fiber_pitch_um = 20.0"), "ply.fiber_pitch_um = 20: use a pitch"),
        (polyester_with("\"Z\"", "\"X\""), "ply.handedness = \"X\": use one of \"Z\", \"S\""),
        (end("[yarn]\nplies = 8"), "yarn.plies = 8: use an integer from 1 to 7"),
        (end("[yarn]\nplies = 0"), "yarn.plies = 0: use an integer from 1 to 7"),
        (end("[yarn]\nplies = 2.5"), "yarn.plies = 2.5: use an integer from 1 to 7"),
        (end("[yarn]\nply_pitch_mm = 1"), "yarn.ply_pitch_mm = 1: unknown unit: use ply_pitch_um"),
        (end("[yarn]\nplies = 3\nhandedness = \"X\""), "yarn.handedness = \"X\": use one of \"Z\", \"S\""),
        (
            end("[yarn]\nplies = 3\nply_pitch_um = 250"),
            "yarn.ply_pitch_um = 250: 3 plies of radius 50 um intersect however they lie: use 30",
        ),
        (
            format!("{}\n[yarn]\nplies = 2", ply("radii_um = [60, 40]")),
            "ply.radii_um = [60.0, 40.0] with yarn.plies = 2: elliptical plies cannot be plied",
        ),
        (end("[beam]\nw0_um = 0.3"), "beam.w0_um = 0.3: use a waist"),
        (end("[beam]\nw0_um = 10\nd_cut_um = 1000"), "beam.d_cut_um = 1000: use from 5 to 200"),
        (end("[absorption]\nsigma_per_um = [0.01, 0.1]"), "absorption.sigma_per_um = [0.01, 0.1]: use 1 to 32"),
        (end("[absorption]\nsigma_per_um = [0, 0.1, 0.1]"), "absorption.sigma_per_um = [0, 0.1, 0.1]: use"),
        (
            end("[absorption]\nsigma_per_mm = [0, 1]"),
            "absorption.sigma_per_mm = [0, 1]: unknown unit: use sigma_per_um",
        ),
        (end("[simulation]\nh_nodes = 8"), "simulation.h_nodes = 8: use an odd integer from 3 to 401"),
        (
            end("[simulation]\ntheta_i_max_deg = 80"),
            "simulation.theta_i_max_deg = 80: unknown unit: use theta_i_max_rad",
        ),
        (end("[simulation]\ntheta_i_max_rad = 1.6"), "simulation.theta_i_max_rad = 1.6: use a number above 0"),
        (end("[simulation]\nh_nodes = 401\ntheta_i_nodes=201\ntheta_o_bins=720\nphi_o_bins=1440"), "use fewer nodes"),
        (end("[weave]\nx = 1"), "weave = { x = 1 }: unknown key: use one of name, fiber, blend, ply"),
        ("name = 3".to_string(), "name = 3: use a text in quotes"),
        ("fiber = 3".to_string(), "fiber = 3: use a table, [fiber]"),
        (String::new(), "name = (absent)"),
    ];
    for (text, expected) in cases {
        let message = refusal(&text);
        assert!(message.contains(expected), "got {message}\nwant {expected}");
    }
}

#[test]
fn syntax_errors_name_the_line() {
    let message = refusal("name = \"a\"\n[fiber\neta = 1");
    assert!(message.contains("line 2: "), "{message}");
    assert!(refusal("name = \"a\"\nname = \"b\"").contains("line 2: duplicate key"));
}

#[test]
fn shapes_are_held_to_their_relations() {
    for (shape, expected) in [
        (
            "{ kind = \"rounded_triangle\", radius_um = 7.0, rounding_um = 3.5 }",
            "rounding_um = 3.5: use from 0.140 to 2.800",
        ),
        (
            "{ kind = \"stone\", radius_um = 7.0, corners = 2, rounding_um = 1.0 }",
            "corners = 2: use an integer from 3 to 24",
        ),
        ("{ kind = \"kidney\", a_um = 8.0, b_um = 4.0, dent = 1.2, lumen = 0.4 }", "dent = 1.2: use a number"),
        (
            "{ kind = \"kidney\", a_um = 8.0, b_um = 4.0, dent = 0.2, lumen = 1e-9 }",
            "lumen = 0.000000001: use 0 for no lumen",
        ),
        ("{ kind = \"hollow_circle\", radius_um = 7.0, lumen = 0.99 }", "lumen = 0.99: use a number from 0.02 to 0.98"),
        ("{ kind = \"hollow_circle\", radius_um = 7.0, lumen = 1.2 }", "lumen = 1.2: use a number from 0.02 to 0.98"),
        ("{ kind = \"hollow_circle\", radius_um = 7.0 }", "fiber.shape.lumen = (absent): this key must be given"),
        (
            "{ kind = \"hollow_circle\", radius_um = 7.0, lumen = 0.4, lumen_eta = 0.9 }",
            "lumen_eta = 0.9: use a number from 1 to 4",
        ),
        ("{ kind = \"ellipse\", a_um = 20.0, b_um = 1.0 }", "b_um = 1: use a value within a factor of 6"),
        ("{ kind = \"serrated\", radius_um = 6.0, depth = 0.2, teeth = 30 }", "depth = 0.2: teeth too sharp"),
        ("{ kind = \"polygon\", file = \"p.txt\", rounding_um = 1.0 }", "file = p.txt: load the spec from its file"),
        ("{ kind = \"polygon\", rounding_um = 1.0 }", "file = (absent)"),
        (
            "{ kind = \"polygon\", points_um = [[0,0],[8,8],[8,0],[0,8]], rounding_um = 0.5 }",
            "points_um = [8, 0]: the edge from here crosses",
        ),
        (
            "{ kind = \"polygon\", points_um = [[0,0],[8,0],[8,8],[0,8]], rounding_um = 4.5 }",
            "rounding_um = 4.5: use from 0.064 to 4.000",
        ),
        ("{ kind = \"polygon\", points_um = [[0,0],[8,0],[8,0],[0,8]], rounding_um = 1 }", "given twice in a row"),
    ] {
        let message = refusal(&with_shape(shape));
        assert!(message.contains(expected), "got {message}\nwant {expected}");
    }
}

#[test]
fn polygon_points_are_read_once_and_embedded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yarn.toml");
    let shape = "{ kind = \"polygon\", file = \"square.txt\", rounding_um = 1.5 }";
    std::fs::write(&path, with_shape(shape)).unwrap();
    assert!(matches!(YarnSpec::load(&path), Err(Error::Io { .. })), "the point file is missing");
    std::fs::write(folder.path().join("square.txt"), "# a square\n-6.5 -6\n6 -6\n\n6, 6\n-6\t6\n").unwrap();
    let (spec, text) = YarnSpec::load(&path).unwrap();
    let Shape::Polygon { file, points_um, .. } = &spec.fiber.shape else { panic!("{:?}", spec.fiber.shape) };
    assert_eq!((file.as_str(), &points_um[..]), ("", &[[-6.5, -6.0], [6.0, -6.0], [6.0, 6.0], [-6.0, 6.0]][..]));
    assert_eq!(YarnSpec::parse(&text, "embedded").unwrap(), spec);
    for (points, expected) in [
        ("0 0\n1 secret\n", "line 2 = "),
        ("0 0\n1 1\n", "points = 2"),
        ("0 0\ninf 0\n", "line 2 = "),
        ("0 0\n1 2 x\n", "line 2 = "),
    ] {
        std::fs::write(folder.path().join("square.txt"), points).unwrap();
        let message = YarnSpec::load(&path).unwrap_err().to_string();
        assert!(message.contains("square.txt: ") && message.contains(expected), "{message}");
        // A spec may name any file; messages do not show its content.
        assert!(!message.contains("secret") && !message.contains("inf"), "{message}");
    }
    std::fs::write(&path, with_shape(&shape.replace("square.txt", "../square.txt"))).unwrap();
    let message = YarnSpec::load(&path).unwrap_err().to_string();
    assert!(message.contains("leads out of the folder"), "{message}");
    let assets = MemoryAssets::new().with("square.txt", *b"-6.5 -6\n6 -6\n6 6\n-6 6");
    assert_eq!(YarnSpec::load_from(&with_shape(shape), "yarn.toml", &assets).unwrap(), (spec, text));
}

#[test]
fn files_that_are_no_specs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("yarn.toml");
    assert!(matches!(YarnSpec::load(&path), Err(Error::Io { .. })));
    std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
    assert!(matches!(YarnSpec::load(&path), Err(Error::Format { .. })));
    std::fs::write(&path, vec![b'#'; 5 << 20]).unwrap();
    assert!(matches!(YarnSpec::load(&path), Err(Error::Format { .. })));
    std::fs::write(&path, POLYESTER).unwrap();
    let (spec, text) = YarnSpec::load(&path).unwrap();
    assert_eq!((spec, text.as_str()), (YarnSpec::polyester().unwrap(), POLYESTER));
}

fn one_line(result: plywave::Result<YarnSpec>) {
    match result {
        Ok(spec) => spec.check("accepted").unwrap(),
        Err(error) => assert!(!error.to_string().contains(['\n', '\r']), "{:?}", error.to_string()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_parsed_or_refused(text in "(?s).{0,200}") {
        one_line(YarnSpec::parse(&text, "yarn.toml"));
    }

    #[test]
    fn toml_like_text_is_parsed_or_refused(text in "([a-z_]{1,12}(\\.[a-z]{1,5})? ?= ?([-0-9.e]{1,6}|\"[a-z]*\"|\\[[0-9, \\[\\]]*\\]|nan|inf)\n|\\[[a-z.]{1,9}\\]\n){0,12}") {
        one_line(YarnSpec::parse(&text, "yarn.toml"));
    }

    #[test]
    fn mutated_polyester_is_parsed_or_refused(at in 0.0..1.0f64, cut in 0usize..12, new in "[-0-9a-z_.=\\[\\]{}\"\n, ]{0,8}") {
        let start = POLYESTER.floor_char_boundary((at * POLYESTER.len() as f64) as usize);
        let end = POLYESTER.floor_char_boundary((start + cut).min(POLYESTER.len()));
        one_line(YarnSpec::parse(&format!("{}{new}{}", &POLYESTER[..start], &POLYESTER[end..]), "yarn.toml"));
    }

    #[test]
    fn any_numbers_are_parsed_or_refused(values in prop::collection::vec(prop_oneof![any::<f64>(), -20.0..20.0f64], 4), fibers in any::<i64>(), kind in 0usize..4) {
        let text = with_shape(&[
            format!("{{ kind = \"ellipse\", a_um = {:?}, b_um = {:?} }}", values[0], values[1]),
            format!("{{ kind = \"stone\", radius_um = {:?}, corners = {fibers}, rounding_um = {:?} }}", values[0], values[1]),
            format!("{{ kind = \"kidney\", a_um = {:?}, b_um = 4.0, dent = {:?}, lumen = {:?} }}", values[0], values[1], values[2]),
            format!("{{ kind = \"polygon\", points_um = [[0, 0], [{:?}, 1.0], [{:?}, {:?}]], rounding_um = {:?} }}", values[0], values[1], values[2], values[3]),
        ][kind]);
        one_line(YarnSpec::parse(&text.replacen("fibers = 30", &format!("fibers = {fibers}"), 1), "yarn.toml"));
    }
}

/// Fibers of every kind come back from their own text, and have the index of the text.
#[test]
fn metals_hollow_circles_blends_and_dispersion_are_read() {
    let gold = YarnSpec::parse(&polyester_with("eta = 1.60", "metal = \"gold\""), "gold").unwrap();
    assert!(gold.fiber.is_opaque());
    let [eta, kappa] = plywave::optics::Metal::Gold.index(0.55).map(f64::from);
    assert_eq!([gold.fiber.eta_at(0.55), gold.fiber.kappa_at(0.55)], [eta, kappa]);
    // Gold keeps less of blue light than of red.
    assert!(gold.own_sigma_per_um(0.45) > 15.0 * gold.own_sigma_per_um(0.65));

    let opaque = YarnSpec::parse(&polyester_with("eta = 1.60", "eta = 0.43\nkappa = 2.455"), "opaque").unwrap();
    assert_eq!([opaque.fiber.eta_at(0.4), opaque.fiber.kappa_at(0.4)], [0.43, 2.455]);
    assert_eq!(opaque.own_sigma_per_um(0.4), opaque.own_sigma_per_um(0.7));

    let glass = YarnSpec::parse(&polyester_with("eta = 1.60", "eta = 1.60\ndispersion_um2 = 0.01"), "glass").unwrap();
    assert_eq!((glass.fiber.eta_at(plywave::spec::SODIUM_UM), glass.own_sigma_per_um(0.5)), (1.60, 0.0));
    let want = 1.60 + 0.01 * (1.0 / 0.2025 - 1.0 / (0.5893 * 0.5893));
    assert!((glass.fiber.eta_at(0.45) - want).abs() < 1e-12);

    let hollow = with_shape("{ kind = \"hollow_circle\", radius_um = 7.5, lumen = 0.4, lumen_eta = 1.3 }");
    let fiber = "[blend]\nshare = 0.25\ndye = 0.5\n[blend.fiber]\nshape = { kind = \"circle\", radius_um = 5.0 }";
    let blend = YarnSpec::parse(&format!("{hollow}\n{fiber}\neta = 1.5\nalpha_fiber = 0.1\n"), "blend").unwrap();
    assert_eq!(blend.fiber.shape.core(), [1.3, 0.0]);
    let area = std::f64::consts::PI * (0.75 * 56.25 + 0.25 * 25.0);
    assert!((blend.fiber_area_um2() - area).abs() < 1e-9);
    for spec in [gold, opaque, glass, blend] {
        assert_eq!(YarnSpec::parse(&toml::to_string(&spec).unwrap(), "again").unwrap(), spec);
        spec.check("in code").unwrap();
    }
}
