//! Rules of the fabric spec: which keys there are, in which ranges, and what must hold between them. As in `spec_check.rs`, the parsed TOML is walked, so that
//! every refusal names the dotted key and the value as given.

use super::Family;
use super::draft::{Draft, MAX_THREADS};
use super::spec::{FabricSpec, WeaveSpec, YarnOfFabric};
use super::wif::line;
use super::yarn::YarnShape;
use crate::{Error, Result, YarnSpec};
use toml::{Table, Value};

/// What a key holds.
enum Kind {
    /// Number in a closed range.
    Number(f64, f64),
    /// Integer in a closed range.
    Integer(i64, i64),
    /// Text that is not empty.
    Text,
    /// One of some words.
    Choice(&'static [&'static str]),
    /// Three numbers from 0 to 1.
    Srgb,
    /// Rows of a draft.
    Rows,
    /// A table of further keys.
    Table(&'static [Rule]),
    /// A table whose keys depend on its `kind`.
    Weave,
}

/// One key: its name, what it holds, whether it must be given.
type Rule = (&'static str, Kind, bool);

const THREADS: i64 = MAX_THREADS as i64;
/// Units that a key's name may end in.
const UNITS: [&str; 2] = ["_per_um", "_um"];

const ROOT: &[Rule] = &[
    ("name", Kind::Text, true),
    ("weave", Kind::Weave, true),
    ("warp", Kind::Table(YARN), true),
    ("weft", Kind::Table(YARN), true),
];
const YARN: &[Rule] = &[
    ("model", Kind::Text, true),
    ("plies", Kind::Integer(1, 7), false),
    ("ply_radius_um", Kind::Number(0.01, 1e3), false),
    ("ply_pitch_um", Kind::Number(0.01, 1e7), false),
    ("handedness", Kind::Choice(&["Z", "S"]), false),
    ("spacing_um", Kind::Number(0.01, 1e5), true),
    ("crimp", Kind::Number(0.0, 1.0), false),
    ("srgb", Kind::Srgb, false),
    ("sigma_per_um", Kind::Number(0.0, 10.0), false),
];
/// Keys of each `weave.kind`, besides `kind`.
const WEAVES: &[(&str, &[Rule])] = &[
    ("plain", &[]),
    ("twill", &[("up", Kind::Integer(1, THREADS / 2), true), ("down", Kind::Integer(1, THREADS / 2), true)]),
    ("satin", &[("n", Kind::Integer(5, THREADS), true), ("step", Kind::Integer(2, THREADS), true)]),
    ("basket", &[("n", Kind::Integer(1, THREADS / 2), true)]),
    ("draft", &[("rows", Kind::Rows, true)]),
    ("wif", &[("file", Kind::Text, true)]),
];

pub(super) fn format_error(file: &str, what: String) -> Error {
    let what = what.split_whitespace().collect::<Vec<_>>().join(" ");
    Error::Format { file: line(file), what, mend: "use TOML with the keys of fabrics/cotton_twill.toml".to_string() }
}

pub(super) fn invalid(file: &str, key: &str, value: impl std::fmt::Display, mend: impl Into<String>) -> Error {
    Error::Invalid { file: line(file), key: line(key), value: line(&value.to_string()), mend: mend.into() }
}

/// Checks every key of `table`, then that none is missing.
pub(super) fn check_keys(file: &str, table: &Table) -> Result<()> {
    check_table(file, "", table, ROOT)
}

fn dotted(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

fn check_table(file: &str, path: &str, table: &Table, rules: &[Rule]) -> Result<()> {
    for (key, value) in table {
        let Some((_, kind, _)) = rules.iter().find(|(name, ..)| name == key) else {
            return Err(invalid(file, &dotted(path, key), value, unknown(path, key, rules)));
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
fn unknown(path: &str, key: &str, rules: &[Rule]) -> String {
    for (name, ..) in rules {
        let Some(stem) = UNITS.iter().find_map(|unit| name.strip_suffix(unit)) else { continue };
        if key == stem || key.strip_prefix(stem).is_some_and(|rest| rest.starts_with('_')) {
            return format!("unknown unit: use {name}");
        }
    }
    if path.is_empty() && ["fiber", "ply", "beam"].contains(&key) {
        return "this is a key of a yarn spec; a fabric names the models of its yarns".into();
    }
    let names: Vec<&str> = rules.iter().map(|(name, ..)| *name).collect();
    match names[..] {
        [] => "unknown key: this kind has none".into(),
        _ => format!("unknown key: use one of {}", names.join(", ")),
    }
}

/// Whether a value is a finite number in a closed range.
fn within(value: &Value, min: f64, max: f64) -> bool {
    let x = match value {
        Value::Float(x) => *x,
        Value::Integer(i) => *i as f64,
        _ => return false,
    };
    (min..=max).contains(&x)
}

fn check_value(file: &str, key: &str, value: &Value, kind: &Kind) -> Result<()> {
    let refuse = |mend: String| Err(invalid(file, key, value, mend));
    match kind {
        Kind::Number(min, max) if !within(value, *min, *max) => refuse(format!("use a number from {min} to {max}")),
        Kind::Integer(min, max) if !value.as_integer().is_some_and(|i| (*min..=*max).contains(&i)) => {
            refuse(format!("use an integer from {min} to {max}"))
        }
        Kind::Text if value.as_str().is_none_or(|s| s.trim().is_empty()) => refuse("use a text in quotes".into()),
        Kind::Choice(words) if !value.as_str().is_some_and(|s| words.contains(&s)) => {
            refuse(format!("use one of \"{}\"", words.join("\", \"")))
        }
        Kind::Srgb => match value.as_array() {
            Some(v) if v.len() == 3 && v.iter().all(|x| within(x, 0.0, 1.0)) => Ok(()),
            _ => refuse("use three numbers from 0 to 1, red, green and blue".into()),
        },
        Kind::Rows => check_rows(file, key, value),
        Kind::Table(rules) => match value {
            Value::Table(table) => check_table(file, key, table, rules),
            _ => refuse(format!("use a table, [{key}]")),
        },
        Kind::Weave => check_weave(file, key, value),
        _ => Ok(()),
    }
}

fn check_weave(file: &str, key: &str, value: &Value) -> Result<()> {
    let Value::Table(table) = value else {
        return Err(invalid(file, key, value, "use a table such as { kind = \"satin\", n = 5, step = 2 }"));
    };
    let names: Vec<&str> = WEAVES.iter().map(|(name, _)| *name).collect();
    let kind = dotted(key, "kind");
    let mend = || format!("use one of \"{}\"", names.join("\", \""));
    let given = table.get("kind").ok_or_else(|| invalid(file, &kind, "(absent)", mend()))?;
    let Some((_, rules)) = WEAVES.iter().find(|(name, _)| given.as_str() == Some(name)) else {
        return Err(invalid(file, &kind, given, mend()));
    };
    let mut rest = table.clone();
    rest.remove("kind");
    check_table(file, key, &rest, rules)
}

fn check_rows(file: &str, key: &str, value: &Value) -> Result<()> {
    let rows: Option<Vec<&str>> = value.as_array().and_then(|list| list.iter().map(Value::as_str).collect());
    let Some(rows) = rows.filter(|r| (1..=MAX_THREADS).contains(&r.len())) else {
        let count = value.as_array().map_or(value.to_string(), |rows| format!("{} rows", rows.len()));
        return Err(invalid(file, key, count, format!("use 1 to {MAX_THREADS} rows such as [\"X.X.\", \".X.X\"]")));
    };
    let width = rows[0].len();
    for (i, row) in rows.iter().enumerate() {
        let at = format!("{key}[{i}]");
        if !row.bytes().all(|b| b == b'X' || b == b'.') {
            return Err(invalid(file, &at, row, "use X where the warp is on top and . where the weft is"));
        }
        if row.len() != width || !(1..=MAX_THREADS).contains(&width) {
            let mend = format!("use rows of one length, 1 to {MAX_THREADS}; the first has {width}");
            return Err(invalid(file, &at, format!("{} characters", row.len()), mend));
        }
    }
    Ok(())
}

/// What must hold between keys.
pub(super) fn check_relations(file: &str, spec: &FabricSpec) -> Result<()> {
    if let WeaveSpec::Satin { n, step } = spec.weave
        && Draft::satin(n, step).is_none()
    {
        let good: Vec<usize> = (2..n.saturating_sub(1)).filter(|&s| Draft::satin(n, s).is_some()).take(12).collect();
        let mend = match good[..] {
            [] => format!("no satin has {n} ends; use another n"),
            _ => {
                let list: Vec<String> = good.iter().map(usize::to_string).collect();
                format!("step and n = {n} must have no common factor; use one of {}", list.join(", "))
            }
        };
        return Err(invalid(file, "weave.step", step, mend));
    }
    match (spec.weave.draft(), &spec.weave) {
        (Some(draft), WeaveSpec::Draft { .. }) => check_bound(file, &draft)?,
        (None, WeaveSpec::Wif { .. }) | (Some(_), _) => {}
        (None, _) => {
            let mend = format!("use counts of 1 or more and a repeat of {MAX_THREADS} or less");
            return Err(invalid(file, "weave.kind", "a weave without draft", mend));
        }
    }
    for family in Family::EACH {
        let (name, yarn) = (family.name(), spec.yarn(family));
        if yarn.srgb.is_some() && yarn.sigma_per_um.is_some() {
            return Err(invalid(
                file,
                &format!("{name}.sigma_per_um"),
                yarn.sigma_per_um.unwrap_or_default(),
                "give either srgb or sigma_per_um, not both",
            ));
        }
    }
    if spec.warp.crimp + spec.weft.crimp > 1.0 + 1e-9 {
        let mend = format!(
            "crimps add up to {:.3}; use 1 or less, beyond which the yarns would lie apart",
            spec.warp.crimp + spec.weft.crimp
        );
        return Err(invalid(file, "weft.crimp", spec.weft.crimp, mend));
    }
    Ok(())
}

fn check_bound(file: &str, draft: &Draft) -> Result<()> {
    let Some((family, thread, up)) = draft.unbound() else { return Ok(()) };
    let (what, at) = match family {
        Family::Warp => ("column", thread + 1),
        // As written: the last row is the first pick.
        Family::Weft => ("row", draft.picks() - thread),
    };
    let side = if up { "above" } else { "below" };
    let value = format!("{what} {at}, whose {} lies {side} all others", family.name());
    Err(invalid(file, "weave.rows", value, "bind every yarn: both X and . in every row and every column"))
}

/// What must hold between the yarns of a family and `ply`, the spec in `model`, which they name.
///
/// A model of a yarn of P plies is that of its first ply with the light of the others in it (Yu 2025, 5.3), so the fabric's yarns have P plies. A model of one ply is taken for
/// yarns of any number: every ply then scatters as if it were alone ([`super::LoadedFabric::notes`] says so). Offsets h are in um, so the plies have the model's radius.
pub(super) fn check_model(file: &str, family: Family, yarn: &YarnOfFabric, model: &str, ply: &YarnSpec) -> Result<()> {
    let key = |name: &str| format!("{}.{name}", family.name());
    let plies = ply.yarn.plies;
    if plies > 1 && yarn.plies != plies {
        let mend = format!("{model} is of a yarn of {plies} plies; use plies = {plies}, or a model of one ply");
        return Err(invalid(file, &key("plies"), yarn.plies, mend));
    }
    let [a, b] = ply.ply_radii_um();
    let (least, most) = (a.min(b), a.max(b));
    // A rounding is no other radius.
    if let Some(radius) = yarn.ply_radius_um.filter(|r| !(least * (1.0 - 1e-6)..=most * (1.0 + 1e-6)).contains(r)) {
        let own = if least < most { format!("{least} to {most}") } else { format!("{most}") };
        let mend = format!("{model} is of plies of radius {own} um; leave this key out, or use a model of such plies");
        return Err(invalid(file, &key("ply_radius_um"), radius, mend));
    }
    Ok(())
}

/// What must hold of the yarns once their plies are known.
pub(super) fn check_shapes(file: &str, shapes: &[YarnShape; 2]) -> Result<()> {
    for (family, shape) in Family::EACH.into_iter().zip(shapes) {
        let key = |name: &str| format!("{}.{name}", family.name());
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if !positive(shape.ply_radius_um) {
            return Err(invalid(file, &key("ply_radius_um"), shape.ply_radius_um, "use a radius above 0"));
        }
        if !(1..=7).contains(&shape.plies) {
            return Err(invalid(file, &key("plies"), shape.plies, "use 1 to 7 plies"));
        }
        if !(0.0..=1.0).contains(&shape.crimp) {
            return Err(invalid(file, &key("crimp"), shape.crimp, "use a number from 0 to 1"));
        }
        if !(shape.d_cut_um.is_finite() && shape.d_cut_um >= 0.0) {
            return Err(invalid(file, &key("d_cut_um"), shape.d_cut_um, "use a distance of 0 or more"));
        }
        if let Some(pitch) = shape.ply_pitch_um {
            // At a pitch of 2 P R the next ply stands a diameter further along the yarn, whatever its distance from the axis.
            let least = if shape.plies > 1 { 2.0 * f64::from(shape.plies) * shape.ply_radius_um } else { 0.0 };
            if !(pitch.is_finite() && pitch > least) {
                let mend = format!("plies of this pitch would intersect; use more than {least} um");
                return Err(invalid(file, &key("ply_pitch_um"), pitch, mend));
            }
        }
        let width = shape.width_um();
        // A rounding of the width is not an overlap.
        if !(shape.spacing_um.is_finite() && shape.spacing_um >= width * (1.0 - 1e-9)) {
            let mend = format!("the yarn is {width:.2} um wide; use a spacing of that or more");
            return Err(invalid(file, &key("spacing_um"), shape.spacing_um, mend));
        }
    }
    Ok(())
}
