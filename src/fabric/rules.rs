//! Rules of the fabric spec: its keys and their ranges, and what must hold between them.

use super::YarnSet;
use super::draft::{Draft, MAX_THREADS};
use super::spec::{FabricSpec, WeaveSpec, YarnOfFabric};
use super::yarn::YarnShape;
use crate::Result;
use crate::gap::SLIT_MAX_UM;
use crate::spec::YarnSpec;
use crate::spec::rules::{Custom, Key, Kind, Rules, invalid, optional, required};
use toml::Value;

const THREADS: i64 = MAX_THREADS as i64;

/// The rules of a fabric spec.
pub const FABRIC_RULES: Rules = Rules {
    keys: ROOT,
    units: &["_per_um", "_um"],
    example: "fabrics/cotton_twill.toml",
    foreign: &[(
        &["fiber", "ply", "beam", "yarn", "absorption", "simulation"],
        "this is a key of a yarn spec; a fabric names the models of its yarns",
    )],
};

const ROOT: &[Key] = &[
    required("name", Kind::Text),
    required("weave", Kind::Tagged("{ kind = \"satin\", n = 5, step = 2 }", WEAVES)),
    required("warp", Kind::Table(YARN)),
    required("weft", Kind::Table(YARN)),
    optional("color_of", Kind::Choice(&["even_sky", "reflected", "folded"]), "\"even_sky\""),
];
const YARN: &[Key] = &[
    optional("model", Kind::Text, "models"),
    optional("plies", Kind::Integer(1, 7), "1"),
    optional("ply_radius_um", Kind::Number(0.01, 1e3), "the model's"),
    optional("ply_pitch_um", Kind::Number(0.01, 1e7), "parallel plies"),
    optional("handedness", Kind::Choice(&["Z", "S"]), "\"Z\""),
    optional("spacing_um", Kind::Number(0.01, 1e5), "the WIF's"),
    optional("crimp", Kind::Number(0.0, 1.0), "a lean of 25 degrees, 0.5 at most"),
    optional("srgb", Kind::Srgb, "the WIF's, or clear fibers"),
    optional("sigma_per_um", Kind::Number(0.0, 10.0), "srgb"),
    optional("models", Kind::Letters, "model"),
    optional("threads", Kind::Text, "model"),
    optional("slit_um", Kind::Above(0.0, SLIT_MAX_UM as f64), "no slits"),
    optional("slit_share", Kind::Number(0.0, 1.0), "a quarter, with slit_um"),
];
/// Spacings that are taken from a WIF [um]: programs that leave it to a default write all kinds of numbers.
pub(super) const SPACING_UM: [f64; 2] = [10.0, 1e5];

/// Keys of each `weave.kind`, besides `kind`.
pub const WEAVES: &[(&str, &[Key])] = &[
    ("plain", &[]),
    ("twill", &[required("up", Kind::Integer(1, THREADS / 2)), required("down", Kind::Integer(1, THREADS / 2))]),
    ("satin", &[required("n", Kind::Integer(5, THREADS)), required("step", Kind::Integer(2, THREADS))]),
    ("basket", &[required("n", Kind::Integer(1, THREADS / 2))]),
    ("layers", &[]),
    ("draft", &[required("rows", Kind::Custom(ROWS))]),
    ("wif", &[required("file", Kind::Text)]),
];

const ROWS: Custom =
    Custom { expected: "rows of one length of X (warp on top) and ., such as [\"X.\", \".X\"]", check: check_rows };

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
            let hint = format!("use rows of one length, 1 to {MAX_THREADS}; the first has {width}");
            return Err(invalid(file, &at, format!("{} characters", row.len()), hint));
        }
    }
    Ok(())
}

/// What must hold between the keys of a weave.
pub fn check_weave(file: &str, weave: &WeaveSpec) -> Result<()> {
    if let WeaveSpec::Satin { n, step } = *weave
        && Draft::satin(n, step).is_none()
    {
        let good: Vec<usize> = (2..n.saturating_sub(1)).filter(|&s| Draft::satin(n, s).is_some()).take(12).collect();
        let hint = match good[..] {
            [] => format!("no satin has {n} ends; use another n"),
            _ => {
                let list: Vec<String> = good.iter().map(usize::to_string).collect();
                format!("step and n = {n} must have no common factor; use one of {}", list.join(", "))
            }
        };
        return Err(invalid(file, "weave.step", step, hint));
    }
    match (weave.draft(), weave) {
        (Some(draft), WeaveSpec::Draft { .. }) => check_bound(file, &draft)?,
        (None, WeaveSpec::Wif { .. }) | (Some(_), _) => {}
        (None, _) => {
            let hint = format!("use counts of 1 or more and a repeat of {MAX_THREADS} or less");
            return Err(invalid(file, "weave.kind", "a weave without draft", hint));
        }
    }
    Ok(())
}

/// What must hold between keys.
pub(super) fn check_relations(file: &str, spec: &FabricSpec) -> Result<()> {
    check_weave(file, &spec.weave)?;
    for family in YarnSet::EACH {
        let (name, yarn) = (family.name(), spec.yarn(family));
        check_stripes(file, name, yarn)?;
        if yarn.spacing_um.is_none() && !matches!(spec.weave, WeaveSpec::Wif { .. }) {
            return Err(invalid(file, &format!("{name}.spacing_um"), "(absent)", "this key must be given"));
        }
        if yarn.srgb.is_some() && yarn.sigma_per_um.is_some() {
            return Err(invalid(
                file,
                &format!("{name}.sigma_per_um"),
                yarn.sigma_per_um.unwrap_or_default(),
                "give either srgb or sigma_per_um, not both",
            ));
        }
        if let (Some(share), None) = (yarn.slit_share, yarn.slit_um) {
            let hint = "give slit_um, the width of the slits, too, or leave this key out";
            return Err(invalid(file, &format!("{name}.slit_share"), share, hint));
        }
    }
    // Crimps that are absent are small enough for any other.
    let (warp, weft) = (spec.warp.crimp.unwrap_or(0.0), spec.weft.crimp.unwrap_or(0.0));
    if warp + weft > 1.0 + 1e-9 {
        let hint =
            format!("crimps add up to {:.3}; use 1 or less, beyond which the yarns would lie apart", warp + weft);
        return Err(invalid(file, "weft.crimp", weft, hint));
    }
    Ok(())
}

/// One model, or several with the yarns that have them.
fn check_stripes(file: &str, family: &str, yarn: &YarnOfFabric) -> Result<()> {
    let key = |name: &str| format!("{family}.{name}");
    match (&yarn.model, &yarn.threads) {
        (None, _) if yarn.models.is_empty() => {
            Err(invalid(file, &key("model"), "(absent)", "give model, or models and threads for stripes"))
        }
        (Some(_), None) if yarn.models.is_empty() => Ok(()),
        (Some(model), _) if !yarn.models.is_empty() => {
            Err(invalid(file, &key("model"), model, "give either model or models, not both"))
        }
        (_, Some(threads)) if yarn.models.is_empty() => {
            Err(invalid(file, &key("threads"), threads, "give models = { A = \"...\" } too, or leave this key out"))
        }
        (_, None) => {
            let example: String = yarn.models.keys().map(|letter| letter.repeat(2)).collect();
            let hint = format!("say which yarn has which model, such as \"{example}\"");
            Err(invalid(file, &key("threads"), "(absent)", hint))
        }
        (_, Some(threads)) => {
            let known: String = yarn.models.keys().map(String::as_str).collect();
            if !(1..=MAX_THREADS).contains(&threads.len()) || !threads.chars().all(|c| known.contains(c)) {
                let hint = format!("use 1 to {MAX_THREADS} of the letters {known} of {}", key("models"));
                return Err(invalid(file, &key("threads"), threads, hint));
            }
            match yarn.models.iter().find(|(letter, _)| !threads.contains(letter.as_str())) {
                None => Ok(()),
                Some((letter, model)) => {
                    let hint = format!("no yarn of {} has this model; leave it out or use its letter", key("threads"));
                    Err(invalid(file, &key(&format!("models.{letter}")), model, hint))
                }
            }
        }
    }
}

fn check_bound(file: &str, draft: &Draft) -> Result<()> {
    let Some((family, thread, up)) = draft.unbound() else { return Ok(()) };
    let (what, at) = match family {
        YarnSet::Warp => ("column", thread + 1),
        // As written: the last row is the first pick.
        YarnSet::Weft => ("row", draft.picks() - thread),
    };
    let side = if up { "above" } else { "below" };
    let value = format!("{what} {at}, whose {} lies {side} all others", family.name());
    Err(invalid(file, "weave.rows", value, "bind every yarn: both X and . in every row and every column"))
}

/// What must hold between the yarns of a family and `ply`, the spec in `model`, which they name.
///
/// A model of a yarn of P plies is that of its first ply with the light of the others in it (Yu 2025, 5.3),
/// so the fabric's yarns have P plies. A model of one ply is taken for yarns of any number, whose plies then
/// scatter one by one. Offsets h are in um, so the plies have the model's radius.
pub(super) fn check_model(file: &str, family: YarnSet, yarn: &YarnOfFabric, model: &str, ply: &YarnSpec) -> Result<()> {
    let key = |name: &str| format!("{}.{name}", family.name());
    let plies = ply.yarn.plies;
    if plies > 1 && yarn.plies != plies {
        let hint = format!("{model} is of a yarn of {plies} plies; use plies = {plies}, or a model of one ply");
        return Err(invalid(file, &key("plies"), yarn.plies, hint));
    }
    let [a, b] = ply.ply_radii_um();
    // Models are of plies turned every way, and yarns of a cloth lie flat.
    if (a - b).abs() > 1e-6 * a {
        let hint =
            format!("{model} is of elliptical plies, {a} x {b} um, whose side a cloth cannot tell; use round plies");
        return Err(invalid(file, &key("model"), model, hint));
    }
    // A rounding is no other radius.
    if let Some(radius) = yarn.ply_radius_um.filter(|r| (r - a).abs() > 1e-6 * a) {
        let hint = format!("{model} is of plies of radius {a} um; leave this key out, or use a model of such plies");
        return Err(invalid(file, &key("ply_radius_um"), radius, hint));
    }
    Ok(())
}

/// What must hold between the models of one family: stripes differ in fibers and color, the geometry of the
/// weave is that of one yarn.
pub(super) fn check_alike(file: &str, family: YarnSet, model: &str, ply: &YarnSpec, first: &YarnSpec) -> Result<()> {
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(b.abs());
    let ([a, b], [c, d]) = (ply.ply_radii_um(), first.ply_radii_um());
    let (beam, other) = (ply.beam.beam(), first.beam.beam());
    let difference = if ply.yarn.plies != first.yarn.plies {
        format!("yarns of {} and of {} plies", ply.yarn.plies, first.yarn.plies)
    } else if !close(a.max(b), c.max(d)) {
        format!("plies of radius {} and {} um", a.max(b), c.max(d))
    } else if !close(ply.ply_circle_um(), first.ply_circle_um()) {
        format!("plies on circles of radius {} and {} um", ply.ply_circle_um(), first.ply_circle_um())
    } else if !close(beam.d_cut_um, other.d_cut_um) || !close(beam.w0_um, other.w0_um) {
        format!("beams of w0 {} and {} um, d_cut {} and {} um", beam.w0_um, other.w0_um, beam.d_cut_um, other.d_cut_um)
    } else {
        return Ok(());
    };
    let hint = format!("{difference} in one family; use models of yarns of one size");
    Err(invalid(file, &format!("{}.models", family.name()), model, hint))
}

/// What must hold of the yarns once their plies are known.
pub(super) fn check_shapes(file: &str, shapes: &[YarnShape; 2]) -> Result<()> {
    for (family, shape) in YarnSet::EACH.into_iter().zip(shapes) {
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
            // At a pitch of 2 P R the next ply stands a diameter further along the yarn, whatever its
            // distance from the axis.
            let least = if shape.plies > 1 { 2.0 * f64::from(shape.plies) * shape.ply_radius_um } else { 0.0 };
            if !(pitch.is_finite() && pitch > least) {
                let hint = format!("plies of this pitch would intersect; use more than {least} um");
                return Err(invalid(file, &key("ply_pitch_um"), pitch, hint));
            }
        }
        let width = shape.width_um();
        // A rounding of the width is not an overlap.
        if !(shape.spacing_um.is_finite() && shape.spacing_um >= width * (1.0 - 1e-9)) {
            let hint = format!("the yarn is {width:.2} um wide; use a spacing of that or more");
            return Err(invalid(file, &key("spacing_um"), shape.spacing_um, hint));
        }
    }
    Ok(())
}
