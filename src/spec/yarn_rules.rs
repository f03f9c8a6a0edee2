//! Validation rules of the yarn spec: its keys, their ranges, and the relations between them.
//!
//! Within these bounds the simulator's geometry and grids are sound. They are far wider than real yarns need.

use super::ply_circle::{least_ply_pitch_um, ply_circle_um};
use super::rules::{Key, KeyKind, Rules, invalid, optional, required};
use super::yarn::{BlendSpec, FiberSpec, PlySpec, Shape, YarnSpec};
use crate::Result;
use std::f64::consts::PI;

/// Maximum packing fraction; random packings of discs end near 0.8.
const MAX_FRACTION: f64 = 0.9;
/// Maximum number of cells of a table, which is 1 GiB in f32.
const MAX_CELLS: f64 = 2.7e8;
/// Maximum number of transport lengths across a fiber that scatters; light takes the square of it in steps.
const MAX_TRANSPORT: f64 = 300.0;
/// Maximum number of points of a polygon.
const MAX_POINTS: usize = 2000;

const SIZE: KeyKind = KeyKind::Number(0.01, 1e4);
/// The rules of a yarn spec.
pub const YARN_RULES: Rules =
    Rules { keys: ROOT, units: &["_per_um", "_um", "_rad"], example: "fabrics/polyester.toml", foreign: &[] };

const ROOT: &[Key] = &[
    required("name", KeyKind::Text),
    required("fiber", KeyKind::Table(FIBER_KEYS)),
    optional("blend", KeyKind::Table(BLEND), "fibers of one kind"),
    required("ply", KeyKind::Table(PLY)),
    optional("yarn", KeyKind::Table(YARN), "its keys' defaults"),
    optional("beam", KeyKind::Table(BEAM), "its keys' defaults"),
    optional("absorption", KeyKind::Table(ABSORPTION), "its keys' defaults"),
    optional("simulation", KeyKind::Table(SIMULATION), "its keys' defaults"),
    optional("family", KeyKind::Table(FAMILY), "one yarn"),
];
#[doc(hidden)]
/// Keys of a fiber.
pub const FIBER_KEYS: &[Key] = &[
    required("shape", KeyKind::Tagged("{ kind = \"circle\", radius_um = 7.5 }", SHAPES)),
    optional("size_jitter", KeyKind::Number(0.0, 0.25), "0.0"),
    optional("shape_jitter", KeyKind::Number(0.0, 0.25), "0.0"),
    optional("angle_jitter_rad", KeyKind::Number(0.0, PI), "any turn, uniformly"),
    optional("eta", KeyKind::Above(0.0, 10.0), "`metal`'s"),
    optional("kappa", KeyKind::Number(0.05, 20.0), "light passes the fiber"),
    optional("metal", KeyKind::Choice(&["gold", "silver", "aluminium", "aluminum", "copper"]), "`eta`"),
    optional("dispersion_um2", KeyKind::Number(0.0, 0.1), "one index"),
    required("alpha_fiber", KeyKind::Number(0.0, 1.0)),
    optional("scattering_per_um", KeyKind::Number(0.0, 10.0), "clear"),
    optional("scattering_g", KeyKind::Number(-0.95, 0.95), "even"),
];
const BLEND: &[Key] = &[
    required("share", KeyKind::Number(0.01, 0.99)),
    optional("dye", KeyKind::Number(0.0, 10.0), "1.0"),
    required("fiber", KeyKind::Table(FIBER_KEYS)),
];
const PLY: &[Key] = &[
    required("fibers", KeyKind::Integer(1, 200)),
    // Above 1 mm the tracer, in f32, would not resolve its own offset from a wall.
    optional("radius_um", KeyKind::Number(0.01, 1e3), "radii_um"),
    optional("radii_um", KeyKind::Pair(0.01, 1e3), "radius_um"),
    optional("min_gap_um", KeyKind::Number(0.001, 100.0), "0.2"),
    optional("packing", KeyKind::Choice(&["falling", "lined"]), "\"falling\""),
    optional("fiber_pitch_um", KeyKind::Number(0.01, 1e7), "parallel fibers"),
    optional("handedness", KeyKind::Choice(&["Z", "S"]), "\"Z\""),
];
const YARN: &[Key] = &[
    optional("plies", KeyKind::Integer(1, 7), "1"),
    optional("ply_pitch_um", KeyKind::Number(0.01, 1e7), "parallel plies"),
    optional("handedness", KeyKind::Choice(&["Z", "S"]), "\"Z\""),
];
const BEAM: &[Key] = &[
    optional("w0_um", KeyKind::Number(0.1, 1e4), "10.0"),
    optional("lambda_um", KeyKind::Number(0.1, 20.0), "0.55"),
    optional("d_cut_um", KeyKind::Number(0.1, 1e5), "2 w0_um"),
];
const ABSORPTION: &[Key] =
    &[optional("sigma_per_um", KeyKind::Ascending(10.0), "[0.0, 0.001, 0.003, 0.01, 0.03, 0.1]")];
const SIMULATION: &[Key] = &[
    optional("instances", KeyKind::Integer(1, 1000), "the preset's"),
    optional("paths_per_theta", KeyKind::Integer(1, 1_000_000_000_000), "the preset's"),
    optional("theta_i_nodes", KeyKind::Odd(3, 201), "the preset's"),
    optional("theta_i_max_rad", KeyKind::Above(0.0, 1.55), "the preset's"),
    optional("h_nodes", KeyKind::Odd(3, 401), "the preset's"),
    optional("theta_o_bins", KeyKind::Integer(4, 720), "the preset's"),
    optional("phi_o_bins", KeyKind::Integer(4, 1440), "the preset's"),
    optional("lobes_refl", KeyKind::Integer(1, 16), "the preset's"),
    optional("lobes_high", KeyKind::Integer(1, 16), "the preset's"),
];
const FAMILY: &[Key] = &[
    optional("fiber_pitch_um", KeyKind::Pair(0.01, 1e7), "`ply.fiber_pitch_um` alone"),
    optional("alpha_fiber", KeyKind::Pair(0.0, 1.0), "`fiber.alpha_fiber` alone"),
    optional("eta", KeyKind::Pair(0.01, 10.0), "`fiber.eta` alone"),
];
/// Keys of each `fiber.shape.kind` besides `kind`.
const SHAPES: &[(&str, &[Key])] = &[
    ("circle", &[required("radius_um", SIZE)]),
    (
        "hollow_circle",
        &[
            required("radius_um", SIZE),
            required("lumen", KeyKind::Number(0.02, 0.98)),
            optional("lumen_eta", KeyKind::Number(1.0, 4.0), "1.0"),
            optional("lumen_dye", KeyKind::Number(0.0, 10.0), "0.0"),
        ],
    ),
    ("ellipse", &[required("a_um", SIZE), required("b_um", SIZE)]),
    (
        "kidney",
        &[
            required("a_um", SIZE),
            required("b_um", SIZE),
            required("dent", KeyKind::Number(0.0, 0.8)),
            required("lumen", KeyKind::Number(0.0, 0.9)),
        ],
    ),
    ("rounded_triangle", &[required("radius_um", SIZE), required("rounding_um", SIZE)]),
    (
        "stone",
        &[required("radius_um", SIZE), required("corners", KeyKind::Integer(3, 24)), required("rounding_um", SIZE)],
    ),
    ("trilobal", &[required("radius_um", SIZE), required("depth", KeyKind::Number(0.0, 0.35))]),
    (
        "serrated",
        &[
            required("radius_um", SIZE),
            required("depth", KeyKind::Number(0.0, 0.3)),
            required("teeth", KeyKind::Integer(3, 60)),
        ],
    ),
    (
        "polygon",
        &[
            optional("file", KeyKind::Text, "points_um"),
            optional("points_um", KeyKind::Points(MAX_POINTS, 1e4), "file"),
            required("rounding_um", SIZE),
        ],
    ),
];

/// Checks relations between keys. The polygon's points must be loaded.
pub(super) fn check_relations(file: &str, spec: &YarnSpec) -> Result<()> {
    let lambda_um = spec.beam.lambda_um;
    check_fiber(file, "fiber", &spec.fiber, lambda_um)?;
    if let Some(blend) = &spec.blend {
        check_fiber(file, "blend.fiber", &blend.fiber, lambda_um)?;
        check_blend(file, spec, blend)?;
    }
    let ply = &spec.ply;
    let radii = match (ply.radius_um, ply.radii_um) {
        (Some(radius), None) => [radius; 2],
        (None, Some(radii)) => radii,
        (None, None) => {
            return Err(invalid(file, "ply.radius_um", "(absent)", "give radius_um, or radii_um for an ellipse"));
        }
        (Some(_), Some(radii)) => {
            return Err(invalid(
                file,
                "ply.radii_um",
                format!("{radii:?}"),
                "give either radius_um or radii_um, not both",
            ));
        }
    };
    let widest = radii[0].max(radii[1]);
    if radii[0].min(radii[1]) < 0.05 * widest {
        return Err(invalid(file, "ply.radii_um", format!("{radii:?}"), "use semi-axes within a factor of 20"));
    }
    if let Some(pitch) = ply.fiber_pitch_um.filter(|&pitch| pitch < widest) {
        return Err(invalid(
            file,
            "ply.fiber_pitch_um",
            pitch,
            format!("use a pitch of the ply's radius {widest} um or more"),
        ));
    }
    if let Some(family) = &spec.family {
        super::family_rules::check_family(file, spec, family, widest)?;
    }
    check_plies(file, spec, widest)?;
    check_fraction(file, ply, radii, spec.fiber_area_um2())?;
    let beam = spec.beam.beam();
    if beam.w0_um < beam.lambda_um {
        return Err(invalid(
            file,
            "beam.w0_um",
            beam.w0_um,
            format!("use a waist of lambda_um = {} or more", beam.lambda_um),
        ));
    }
    if beam.d_cut_um < 0.5 * beam.w0_um || beam.d_cut_um > 20.0 * beam.w0_um {
        let hint = format!("use from {} to {} (0.5 to 20 w0)", 0.5 * beam.w0_um, 20.0 * beam.w0_um);
        return Err(invalid(file, "beam.d_cut_um", beam.d_cut_um, hint));
    }
    let sim = &spec.simulation;
    let at_least = |n: Option<u32>, absent: u32| f64::from(n.unwrap_or(absent));
    let slices =
        at_least(sim.theta_i_nodes, 3) * at_least(sim.h_nodes, 3) * (1 + spec.absorption.sigma_per_um.len()) as f64;
    let cells = slices * at_least(sim.theta_o_bins, 4) * at_least(sim.phi_o_bins, 4);
    if cells > MAX_CELLS {
        let value = format!("{} bins of phi_o in a table of {cells:.2e} cells", at_least(sim.phi_o_bins, 4));
        return Err(invalid(
            file,
            "simulation.phi_o_bins",
            value,
            format!("use fewer nodes or bins, {MAX_CELLS:.1e} cells at most"),
        ));
    }
    Ok(())
}

/// Checks that plies of one radius do not intersect.
fn check_plies(file: &str, spec: &YarnSpec, radius_um: f64) -> Result<()> {
    let yarn = &spec.yarn;
    if let (2.., Some(radii)) = (yarn.plies, spec.ply.radii_um) {
        let hint = "elliptical plies cannot be plied: give ply.radius_um, or yarn.plies = 1";
        return Err(invalid(file, "ply.radii_um", format!("{radii:?} with yarn.plies = {}", yarn.plies), hint));
    }
    if let Some(pitch) = yarn.ply_pitch_um
        && ply_circle_um(yarn.plies, radius_um, Some(pitch)).is_none()
    {
        let min_pitch = least_ply_pitch_um(yarn.plies, radius_um);
        let hint = format!(
            "{} plies of radius {radius_um} um intersect however they lie: use {:.1} or more, or leave it out for parallel plies",
            yarn.plies,
            (10.0 * min_pitch).ceil() / 10.0
        );
        return Err(invalid(file, "yarn.ply_pitch_um", pitch, hint));
    }
    Ok(())
}

fn check_fraction(file: &str, ply: &PlySpec, radii: [f64; 2], fiber_area: f64) -> Result<()> {
    let fraction = f64::from(ply.fibers) * fiber_area / (PI * radii[0] * radii[1]);
    // A single fiber can be the whole ply.
    let most = if ply.fibers == 1 { 1.0 } else { MAX_FRACTION };
    if fraction <= most {
        return Ok(());
    }
    let scale = (fraction / 0.65).sqrt();
    let count = format!("{} fibers fill {fraction:.3} of the ply, at most {most} can be tried", ply.fibers);
    Err(match ply.radii_um {
        None => invalid(file, "ply.radius_um", radii[0], format!("{count}; use about {:.1}", scale * radii[0])),
        Some(_) => {
            let hint = format!("{count}; use about [{:.1}, {:.1}]", scale * radii[0], scale * radii[1]);
            invalid(file, "ply.radii_um", format!("{radii:?}"), hint)
        }
    })
}

/// Checks relations within a fiber, at `path` in the spec.
fn check_fiber(file: &str, path: &str, fiber: &FiberSpec, lambda_um: f64) -> Result<()> {
    check_outline(file, path, &fiber.shape)?;
    let refuse = |key: &str, value: String, hint: String| Err(invalid(file, &format!("{path}.{key}"), value, hint));
    if let Some(metal) = fiber.metal {
        for (key, value) in [("eta", Some(fiber.eta).filter(|eta| *eta != 0.0)), ("kappa", fiber.kappa)] {
            if let Some(value) = value {
                return refuse(key, format!("{value:?}"), format!("{metal:?} brings its index: give either"));
            }
        }
    } else if fiber.eta == 0.0 {
        let hint = "this key must be given, or metal = \"gold\", \"silver\", \"aluminium\" or \"copper\"";
        return refuse("eta", "(absent)".into(), hint.into());
    }
    if !fiber.is_opaque() {
        let etas = [("eta", fiber.eta), ("dispersion_um2", fiber.eta_at(lambda_um))];
        for (key, eta) in etas {
            if !(eta > 1.0 && eta <= 4.0) {
                let hint = "use a number above 1 and up to 4";
                return match key {
                    "eta" => refuse(key, format!("{eta:?}"), format!("{hint}, or give kappa of an opaque fiber")),
                    _ => refuse(key, format!("an index of {eta:.4} at {lambda_um} um"), "use less dispersion".into()),
                };
            }
        }
        let width_um = 2.0 * (fiber.shape.area_um2() / PI).sqrt();
        let most = MAX_TRANSPORT / width_um;
        if fiber.scattering_per_um * (1.0 - fiber.scattering_g) > most {
            let hint = format!("light would wander without end: use {most:.4} or less times 1 - scattering_g");
            return refuse("scattering_per_um", format!("{:?}", fiber.scattering_per_um), hint);
        }
        return Ok(());
    }
    if fiber.scattering_per_um > 0.0 {
        let hint = "no light is in an opaque fiber: leave this out";
        return refuse("scattering_per_um", format!("{:?}", fiber.scattering_per_um), hint.into());
    }
    if let Some(dispersion) = fiber.dispersion_um2 {
        let hint = "an opaque fiber has its index at all wavelengths, a metal its measured one: leave this out";
        return refuse("dispersion_um2", format!("{dispersion:?}"), hint.into());
    }
    if fiber.shape.has_lumen() {
        return refuse("shape.lumen", "a core".into(), "no light is in an opaque fiber: use a shape without".into());
    }
    // Light that enters must be absorbed before it exits elsewhere: 20 absorption lengths across a circle of
    // the same area.
    if let Some(kappa) = fiber.kappa {
        let width_um = 2.0 * (fiber.shape.area_um2() / PI).sqrt();
        let min_kappa = 20.0 * lambda_um / (4.0 * PI * width_um);
        if kappa < min_kappa {
            let hint =
                format!("light would pass: use {min_kappa:.3} or more, or leave it out and give sigma as absorption");
            return refuse("kappa", format!("{kappa:?}"), hint);
        }
    }
    Ok(())
}

/// Checks that two kinds of fibers in a ply can share one axis of absorption.
fn check_blend(file: &str, spec: &YarnSpec, blend: &BlendSpec) -> Result<()> {
    let (first, second) = (&spec.fiber, &blend.fiber);
    let key = |path: &str, fiber: &FiberSpec| {
        let name = if fiber.metal.is_some() { "metal" } else { "kappa" };
        format!("{path}.{name}")
    };
    match (first.is_opaque(), second.is_opaque()) {
        (false, false) => Ok(()),
        (true, true) => {
            if (first.metal, first.kappa, first.eta) != (second.metal, second.kappa, second.eta) {
                let hint = "reflections of two metals absorb each in their way, a table has one: use the same in both";
                return Err(invalid(file, &key("blend.fiber", second), "another metal", hint));
            }
            if blend.dye != 1.0 {
                return Err(invalid(file, "blend.dye", blend.dye, "fibers of the same metal absorb alike: use 1.0"));
            }
            Ok(())
        }
        (_, opaque) => {
            let value = if opaque { "an opaque fiber among clear ones" } else { "clear fibers among opaque ones" };
            let hint = "absorption is by length in one, by reflections in the other: make a yarn of each and lay them in the cloth";
            let at = if opaque { key("blend.fiber", second) } else { key("fiber", first) };
            Err(invalid(file, &at, value, hint))
        }
    }
}

/// Checks relations within the shape of the fiber at `path`.
fn check_outline(file: &str, path: &str, shape: &Shape) -> Result<()> {
    let key = |name: &str| format!("{path}.shape.{name}");
    match shape {
        Shape::Ellipse { a_um, b_um } | Shape::Kidney { a_um, b_um, .. } if 6.0 * a_um.min(*b_um) < a_um.max(*b_um) => {
            Err(invalid(file, &key("b_um"), b_um, format!("use a value within a factor of 6 of a_um = {a_um}")))
        }
        Shape::Kidney { lumen, .. } if *lumen > 0.0 && *lumen < 0.02 => {
            Err(invalid(file, &key("lumen"), lumen, "use 0 for no lumen, or from 0.02 to 0.9"))
        }
        Shape::RoundedTriangle { radius_um, rounding_um } | Shape::Stone { radius_um, rounding_um, .. }
            if !(0.02 * radius_um..=0.4 * radius_um).contains(rounding_um) =>
        {
            let hint = format!("use from {:.3} to {:.3} (0.02 to 0.4 of radius_um)", 0.02 * radius_um, 0.4 * radius_um);
            Err(invalid(file, &key("rounding_um"), rounding_um, hint))
        }
        // The curvature of the teeth grows as depth teeth^2; an outline of 1024 points resolves up to this.
        Shape::Serrated { depth, teeth, .. } if depth * f64::from(*teeth).powi(2) > 12.0 => {
            let max_depth = 12.0 / f64::from(*teeth).powi(2);
            Err(invalid(
                file,
                &key("depth"),
                depth,
                format!("teeth too sharp: use {max_depth:.3} or less with {teeth} teeth"),
            ))
        }
        Shape::Polygon { file: points_file, points_um, rounding_um } => {
            if points_um.is_empty() {
                let hint = "load the spec from its file, or give points_um = [[x, y], ...] in it";
                let value = if points_file.is_empty() { "(absent)" } else { points_file };
                return Err(invalid(file, &key("file"), value, hint));
            }
            if !points_file.is_empty() {
                return Err(invalid(file, &key("file"), points_file, "give either file or points_um, not both"));
            }
            check_polygon(file, path, points_um, *rounding_um)
        }
        _ => Ok(()),
    }
}

/// Checks that a polygon does not touch itself, and that each rounding arc fits on its two edges.
fn check_polygon(file: &str, path: &str, points: &[[f64; 2]], rounding_um: f64) -> Result<()> {
    let n = points.len();
    let show = |p: [f64; 2]| format!("[{}, {}]", p[0], p[1]);
    let refuse = |p: [f64; 2], hint: &str| Err(invalid(file, &format!("{path}.shape.points_um"), show(p), hint));
    let minus = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
    let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
    let side = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| cross(minus(b, a), minus(p, a));
    let length = |i: usize| {
        let d = minus(points[(i + 1) % n], points[i]);
        d[0].hypot(d[1])
    };
    let perimeter: f64 = (0..n).map(length).sum();
    if let Some(i) = (0..n).find(|&i| length(i) < 1e-6 * perimeter) {
        return refuse(points[i], "this point is given twice in a row; leave one out (the polygon closes by itself)");
    }
    for i in 0..n {
        for j in (i + 2..n).filter(|&j| (j + 1) % n != i) {
            let (a, b, c, d) = (points[i], points[i + 1], points[j], points[(j + 1) % n]);
            let boxes_meet = (0..2).all(|k| a[k].min(b[k]) <= c[k].max(d[k]) && c[k].min(d[k]) <= a[k].max(b[k]));
            if boxes_meet && side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0 {
                return refuse(
                    points[j],
                    "the edge from here crosses or touches another; use a polygon without crossings",
                );
            }
        }
    }
    // An arc of radius r that turns by t shortens both edges by r tan(t/2).
    let shortens = |i: usize| {
        let (u, v) = (minus(points[i], points[(i + n - 1) % n]), minus(points[(i + 1) % n], points[i]));
        (0.5 * cross(u, v).atan2(u[0] * v[0] + u[1] * v[1]).abs()).tan()
    };
    let max_um = (0..n).map(|i| length(i) / (shortens(i) + shortens((i + 1) % n))).fold(f64::INFINITY, f64::min);
    let min_um = 0.002 * perimeter;
    if !(min_um..=max_um).contains(&rounding_um) {
        let hint = if min_um < max_um {
            format!("use from {min_um:.3} to {max_um:.3}, so that arcs are resolved and fit on the polygon's edges")
        } else {
            format!(
                "no rounding fits this polygon: an edge has room for {max_um:.3} um only; drop its shortest edges or spikes"
            )
        };
        return Err(invalid(file, &format!("{path}.shape.rounding_um"), rounding_um, hint));
    }
    Ok(())
}
