//! Rules of the yarn spec: which keys there are, in which ranges, and what must hold between them.
//!
//! The check walks the parsed TOML, not the typed spec, so that every refusal names the dotted key and the value as given.
//! Bounds are those within which the simulator's geometry and grids are sound, far wider than real yarns.

use crate::ply_circle::{least_ply_pitch_um, ply_circle_um};
use crate::{Error, PlySpec, Result, Shape, YarnSpec};
use std::f64::consts::PI;
use toml::{Table, Value};

/// Densest ply that is let through to packing; random packings of discs end near 0.8.
const MAX_FRACTION: f64 = 0.9;
/// Most cells of a table, 1 GiB in f32.
const MAX_CELLS: f64 = 2.7e8;
/// Largest number of polygon points.
const MAX_POINTS: usize = 2000;

/// What a key holds.
enum Kind {
    /// Number in a closed range.
    Number(f64, f64),
    /// Number above the first and up to the second.
    Above(f64, f64),
    /// Integer in a closed range.
    Integer(i64, i64),
    /// Odd integer in a closed range.
    Odd(i64, i64),
    /// Text that is not empty.
    Text,
    /// One of some words.
    Choice(&'static [&'static str]),
    /// Numbers ascending from 0 up to the value.
    Ascending(f64),
    /// Two numbers in a closed range.
    Pair(f64, f64),
    /// `[x, y]` pairs within the bound.
    Points(f64),
    /// A table of further keys.
    Table(&'static [Rule]),
    /// A table whose keys depend on its `kind`.
    Shape,
}

/// One key: its name, what it holds, whether it must be given.
type Rule = (&'static str, Kind, bool);

const SIZE: Kind = Kind::Number(0.01, 1e4);
/// Units that a key's name may end in.
const UNITS: [&str; 3] = ["_per_um", "_um", "_rad"];

const ROOT: &[Rule] = &[
    ("name", Kind::Text, true),
    ("fiber", Kind::Table(FIBER), true),
    ("ply", Kind::Table(PLY), true),
    ("yarn", Kind::Table(YARN), false),
    ("beam", Kind::Table(BEAM), false),
    ("absorption", Kind::Table(ABSORPTION), false),
    ("simulation", Kind::Table(SIMULATION), false),
];
const FIBER: &[Rule] = &[
    ("shape", Kind::Shape, true),
    ("size_jitter", Kind::Number(0.0, 0.25), false),
    ("shape_jitter", Kind::Number(0.0, 0.25), false),
    ("angle_jitter_rad", Kind::Number(0.0, PI), false),
    ("eta", Kind::Above(1.0, 4.0), true),
    ("alpha_fiber", Kind::Number(0.0, 1.0), true),
];
const PLY: &[Rule] = &[
    ("fibers", Kind::Integer(1, 200), true),
    // Beyond 1 mm the tracer's single precision would no longer resolve its own offset from a wall.
    ("radius_um", Kind::Number(0.01, 1e3), false),
    ("radii_um", Kind::Pair(0.01, 1e3), false),
    ("min_gap_um", Kind::Number(0.001, 100.0), false),
    ("fiber_pitch_um", Kind::Number(0.01, 1e7), false),
    ("handedness", Kind::Choice(&["Z", "S"]), false),
];
const YARN: &[Rule] = &[
    ("plies", Kind::Integer(1, 7), false),
    ("ply_pitch_um", Kind::Number(0.01, 1e7), false),
    ("handedness", Kind::Choice(&["Z", "S"]), false),
];
const BEAM: &[Rule] = &[
    ("w0_um", Kind::Number(0.1, 1e4), false),
    ("lambda_um", Kind::Number(0.1, 20.0), false),
    ("d_cut_um", Kind::Number(0.1, 1e5), false),
];
const ABSORPTION: &[Rule] = &[("sigma_per_um", Kind::Ascending(10.0), false)];
const SIMULATION: &[Rule] = &[
    ("instances", Kind::Integer(1, 1000), false),
    ("paths_per_theta", Kind::Integer(1, 1_000_000_000_000), false),
    ("theta_i_nodes", Kind::Odd(3, 201), false),
    ("theta_i_max_rad", Kind::Above(0.0, 1.55), false),
    ("h_nodes", Kind::Odd(3, 401), false),
    ("theta_o_bins", Kind::Integer(4, 720), false),
    ("phi_o_bins", Kind::Integer(4, 1440), false),
    ("lobes_refl", Kind::Integer(1, 16), false),
    ("lobes_high", Kind::Integer(1, 16), false),
];
/// Keys of each `fiber.shape.kind`, besides `kind`.
const SHAPES: &[(&str, &[Rule])] = &[
    ("circle", &[("radius_um", SIZE, true)]),
    ("ellipse", &[("a_um", SIZE, true), ("b_um", SIZE, true)]),
    (
        "kidney",
        &[
            ("a_um", SIZE, true),
            ("b_um", SIZE, true),
            ("dent", Kind::Number(0.0, 0.8), true),
            ("lumen", Kind::Number(0.0, 0.9), true),
        ],
    ),
    ("rounded_triangle", &[("radius_um", SIZE, true), ("rounding_um", SIZE, true)]),
    ("stone", &[("radius_um", SIZE, true), ("corners", Kind::Integer(3, 24), true), ("rounding_um", SIZE, true)]),
    ("trilobal", &[("radius_um", SIZE, true), ("depth", Kind::Number(0.0, 0.35), true)]),
    (
        "serrated",
        &[("radius_um", SIZE, true), ("depth", Kind::Number(0.0, 0.3), true), ("teeth", Kind::Integer(3, 60), true)],
    ),
    ("polygon", &[("file", Kind::Text, false), ("points_um", Kind::Points(1e4), false), ("rounding_um", SIZE, true)]),
];

/// One line, at most 80 characters.
fn line(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let flat: String = words.join(" ").chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if flat.chars().count() <= 80 { flat } else { flat.chars().take(77).chain("...".chars()).collect() }
}

fn invalid(file: &str, key: &str, value: impl std::fmt::Display, mend: impl Into<String>) -> Error {
    Error::Invalid { file: line(file), key: line(key), value: line(&value.to_string()), mend: mend.into() }
}

/// Check every key of `table`, then that none is missing.
pub(crate) fn check_keys(file: &str, table: &Table) -> Result<()> {
    check_table(file, "", table, ROOT)
}

fn dotted(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

fn check_table(file: &str, path: &str, table: &Table, rules: &[Rule]) -> Result<()> {
    for (key, value) in table {
        let Some((_, kind, _)) = rules.iter().find(|(name, ..)| name == key) else {
            return Err(invalid(file, &dotted(path, key), value, unknown(key, rules)));
        };
        check_value(file, &dotted(path, key), value, kind)?;
    }
    for (name, _, required) in rules {
        if *required && !table.contains_key(*name) {
            return Err(invalid(file, &dotted(path, name), "(absent)", "this key must be given"));
        }
    }
    Ok(())
}

/// What to do about an unknown key: a known one with another unit, or the list of all.
fn unknown(key: &str, rules: &[Rule]) -> String {
    for (name, ..) in rules {
        let Some(stem) = UNITS.iter().find_map(|unit| name.strip_suffix(unit)) else { continue };
        if key == stem || key.strip_prefix(stem).is_some_and(|rest| rest.starts_with('_')) {
            return format!("unknown unit: use {name}");
        }
    }
    let names: Vec<&str> = rules.iter().map(|(name, ..)| *name).collect();
    format!("unknown key: use one of {}", names.join(", "))
}

/// A finite TOML number as f64.
fn number(value: &Value) -> Option<f64> {
    let x = match value {
        Value::Float(x) => *x,
        Value::Integer(i) => *i as f64,
        _ => return None,
    };
    x.is_finite().then_some(x)
}

fn check_value(file: &str, key: &str, value: &Value, kind: &Kind) -> Result<()> {
    let refuse = |mend: String| Err(invalid(file, key, value, mend));
    let within = |v: &Value, min: f64, max: f64| number(v).is_some_and(|x| (min..=max).contains(&x));
    match kind {
        Kind::Number(min, max) if !within(value, *min, *max) => refuse(format!("use a number from {min} to {max}")),
        Kind::Above(min, max) if !within(value, *min, *max) || number(value) == Some(*min) => {
            refuse(format!("use a number above {min} and up to {max}"))
        }
        Kind::Integer(min, max) if !value.as_integer().is_some_and(|i| (*min..=*max).contains(&i)) => {
            refuse(format!("use an integer from {min} to {max}"))
        }
        Kind::Odd(min, max) if !value.as_integer().is_some_and(|i| (*min..=*max).contains(&i) && i % 2 == 1) => {
            refuse(format!("use an odd integer from {min} to {max}"))
        }
        Kind::Text if value.as_str().is_none_or(|s| s.trim().is_empty()) => refuse("use a text in quotes".into()),
        Kind::Choice(words) if !value.as_str().is_some_and(|s| words.contains(&s)) => {
            refuse(format!("use one of \"{}\"", words.join("\", \"")))
        }
        Kind::Ascending(max) => {
            let numbers: Option<Vec<f64>> = value.as_array().and_then(|list| list.iter().map(number).collect());
            let good = numbers.is_some_and(|x| {
                (1..=32).contains(&x.len())
                    && x[0] == 0.0
                    && x.get(1).is_none_or(|x| *x >= 1e-6)
                    && x.windows(2).all(|w| w[0] < w[1])
                    && x[x.len() - 1] <= *max
            });
            if good {
                Ok(())
            } else {
                refuse(format!(
                    "use 1 to 32 ascending numbers, the first 0, the next 1e-6 or more, the last up to {max}"
                ))
            }
        }
        Kind::Pair(min, max) => {
            let good = value.as_array().is_some_and(|v| v.len() == 2 && v.iter().all(|x| within(x, *min, *max)));
            if good { Ok(()) } else { refuse(format!("use two numbers from {min} to {max}")) }
        }
        Kind::Points(max) => {
            let pair =
                |v: &Value| v.as_array().is_some_and(|v| v.len() == 2 && v.iter().all(|x| within(x, -max, *max)));
            let good = value.as_array().is_some_and(|v| (3..=MAX_POINTS).contains(&v.len()) && v.iter().all(pair));
            if good {
                Ok(())
            } else {
                refuse(format!("use 3 to {MAX_POINTS} pairs [x, y] within {max} um of the origin"))
            }
        }
        Kind::Table(rules) => match value {
            Value::Table(table) => check_table(file, key, table, rules),
            _ => refuse(format!("use a table, [{key}]")),
        },
        Kind::Shape => check_shape(file, key, value),
        _ => Ok(()),
    }
}

fn check_shape(file: &str, key: &str, value: &Value) -> Result<()> {
    let Value::Table(table) = value else {
        return Err(invalid(file, key, value, "use a table such as { kind = \"circle\", radius_um = 7.5 }"));
    };
    let names: Vec<&str> = SHAPES.iter().map(|(name, _)| *name).collect();
    let kind = dotted(key, "kind");
    let mend = || format!("use one of \"{}\"", names.join("\", \""));
    let given = table.get("kind").ok_or_else(|| invalid(file, &kind, "(absent)", mend()))?;
    let Some((_, rules)) = SHAPES.iter().find(|(name, _)| given.as_str() == Some(name)) else {
        return Err(invalid(file, &kind, given, mend()));
    };
    let mut rest = table.clone();
    rest.remove("kind");
    check_table(file, key, &rest, rules)
}

/// What must hold between keys. The polygon's points are in place.
pub(crate) fn check_relations(file: &str, spec: &YarnSpec) -> Result<()> {
    check_outline(file, &spec.fiber.shape)?;
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
    check_plies(file, spec, widest)?;
    check_fraction(file, ply, radii, nominal_area(&spec.fiber.shape))?;
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
        let mend = format!("use from {} to {} (0.5 to 20 w0)", 0.5 * beam.w0_um, 20.0 * beam.w0_um);
        return Err(invalid(file, "beam.d_cut_um", beam.d_cut_um, mend));
    }
    let sim = &spec.simulation;
    let least = |n: Option<u32>, absent: u32| f64::from(n.unwrap_or(absent));
    let slices = least(sim.theta_i_nodes, 3) * least(sim.h_nodes, 3) * (1 + spec.absorption.sigma_per_um.len()) as f64;
    let cells = slices * least(sim.theta_o_bins, 4) * least(sim.phi_o_bins, 4);
    if cells > MAX_CELLS {
        let value = format!("{} bins of phi_o in a table of {cells:.2e} cells", least(sim.phi_o_bins, 4));
        return Err(invalid(
            file,
            "simulation.phi_o_bins",
            value,
            format!("use fewer nodes or bins, {MAX_CELLS:.1e} cells at most"),
        ));
    }
    Ok(())
}

/// Plies of one radius that do not intersect.
fn check_plies(file: &str, spec: &YarnSpec, radius_um: f64) -> Result<()> {
    let yarn = &spec.yarn;
    if let (2.., Some(radii)) = (yarn.plies, spec.ply.radii_um) {
        let mend = "elliptical plies cannot be plied: give ply.radius_um, or yarn.plies = 1";
        return Err(invalid(file, "ply.radii_um", format!("{radii:?} with yarn.plies = {}", yarn.plies), mend));
    }
    if let Some(pitch) = yarn.ply_pitch_um
        && ply_circle_um(yarn.plies, radius_um, Some(pitch)).is_none()
    {
        let least = least_ply_pitch_um(yarn.plies, radius_um);
        let mend = format!(
            "{} plies of radius {radius_um} um intersect however they lie: use {:.1} or more, or leave it out for parallel plies",
            yarn.plies,
            (10.0 * least).ceil() / 10.0
        );
        return Err(invalid(file, "yarn.ply_pitch_um", pitch, mend));
    }
    Ok(())
}

fn check_fraction(file: &str, ply: &PlySpec, radii: [f64; 2], fiber_area: f64) -> Result<()> {
    let fraction = f64::from(ply.fibers) * fiber_area / (PI * radii[0] * radii[1]);
    if fraction <= MAX_FRACTION {
        return Ok(());
    }
    let scale = (fraction / 0.65).sqrt();
    let count = format!("{} fibers fill {fraction:.3} of the ply, at most {MAX_FRACTION} can be tried", ply.fibers);
    Err(match ply.radii_um {
        None => invalid(file, "ply.radius_um", radii[0], format!("{count}; use about {:.1}", scale * radii[0])),
        Some(_) => {
            let mend = format!("{count}; use about [{:.1}, {:.1}]", scale * radii[0], scale * radii[1]);
            invalid(file, "ply.radii_um", format!("{radii:?}"), mend)
        }
    })
}

/// Relations within a shape.
fn check_outline(file: &str, shape: &Shape) -> Result<()> {
    let key = |name: &str| format!("fiber.shape.{name}");
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
            let mend = format!("use from {:.3} to {:.3} (0.02 to 0.4 of radius_um)", 0.02 * radius_um, 0.4 * radius_um);
            Err(invalid(file, &key("rounding_um"), rounding_um, mend))
        }
        // The curvature of the teeth grows as depth teeth^2; an outline of 1024 points resolves this much.
        Shape::Serrated { depth, teeth, .. } if depth * f64::from(*teeth).powi(2) > 12.0 => {
            let most = 12.0 / f64::from(*teeth).powi(2);
            Err(invalid(
                file,
                &key("depth"),
                depth,
                format!("teeth too sharp: use {most:.3} or less with {teeth} teeth"),
            ))
        }
        Shape::Polygon { file: points_file, points_um, rounding_um } => {
            if points_um.is_empty() {
                let mend = "load the spec from its file, or give points_um = [[x, y], ...] in it";
                let value = if points_file.is_empty() { "(absent)" } else { points_file };
                return Err(invalid(file, &key("file"), value, mend));
            }
            if !points_file.is_empty() {
                return Err(invalid(file, &key("file"), points_file, "give either file or points_um, not both"));
            }
            check_polygon(file, points_um, *rounding_um)
        }
        _ => Ok(()),
    }
}

/// A polygon must not touch itself, and each rounding arc must fit on its two edges.
fn check_polygon(file: &str, points: &[[f64; 2]], rounding_um: f64) -> Result<()> {
    let n = points.len();
    let show = |p: [f64; 2]| format!("[{}, {}]", p[0], p[1]);
    let refuse = |p: [f64; 2], mend: &str| Err(invalid(file, "fiber.shape.points_um", show(p), mend));
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
    // An arc of radius r that turns by t takes r tan(t/2) of both edges.
    let taken = |i: usize| {
        let (u, v) = (minus(points[i], points[(i + n - 1) % n]), minus(points[(i + 1) % n], points[i]));
        (0.5 * cross(u, v).atan2(u[0] * v[0] + u[1] * v[1]).abs()).tan()
    };
    let most = (0..n).map(|i| length(i) / (taken(i) + taken((i + 1) % n))).fold(f64::INFINITY, f64::min);
    let least = 0.002 * perimeter;
    if !(least..=most).contains(&rounding_um) {
        let mend = if least < most {
            format!("use from {least:.3} to {most:.3}, so that arcs are resolved and fit on the polygon's edges")
        } else {
            format!(
                "no rounding fits this polygon: an edge has room for {most:.3} um only; drop its shortest edges or spikes"
            )
        };
        return Err(invalid(file, "fiber.shape.rounding_um", rounding_um, mend));
    }
    Ok(())
}

/// Area of the outer outline without jitter [um^2].
pub(crate) fn nominal_area(shape: &Shape) -> f64 {
    match shape {
        Shape::Circle { radius_um } | Shape::Stone { radius_um, .. } => PI * radius_um * radius_um,
        Shape::Ellipse { a_um, b_um } => PI * a_um * b_um,
        // The dent of `sim/src/geometry/shape.rs`, integrated.
        Shape::Kidney { a_um, b_um, dent, .. } => a_um * b_um * (PI - 1.006_44 * dent),
        Shape::RoundedTriangle { radius_um, rounding_um } => {
            let sharp = 0.75 * 3.0_f64.sqrt() * radius_um * radius_um;
            sharp - (3.0 * 3.0_f64.sqrt() - PI) * rounding_um * rounding_um
        }
        Shape::Trilobal { radius_um, depth } => PI * radius_um * radius_um * (1.0 + 0.5 * depth * depth),
        Shape::Serrated { radius_um, depth, .. } => PI * radius_um * radius_um * (1.0 + 0.3 * depth * depth),
        Shape::Polygon { points_um, .. } => {
            let n = points_um.len();
            let twice = |i: usize| {
                let (a, b) = (points_um[i], points_um[(i + 1) % n]);
                a[0] * b[1] - a[1] * b[0]
            };
            0.5 * (0..n).map(twice).sum::<f64>().abs()
        }
    }
}
