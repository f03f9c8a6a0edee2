//! Rules of the cloth spec: its keys and their ranges, and what must hold between them.

use super::spec::{ClothSpec, YarnOfCloth};
use super::weave::{WEAVE, WeaveSpec, check_weave, check_weave_keys};
use crate::Result;
use crate::gap::SLIT_MAX_UM;
use crate::spec::rules::{self, Custom, Key, Kind, Rules, invalid, optional, required};
use toml::Value;

/// The rules of a cloth spec.
pub const CLOTH_RULES: Rules = Rules {
    keys: ROOT,
    units: &["_per_cm", "_per_um", "_per_m", "_um", "_mm", "_percent"],
    example: "fabrics/cloths/satin.toml",
    foreign: &[(
        &["fiber", "ply", "beam", "absorption", "simulation"],
        "this is a key of a yarn spec; a cloth names the models of its yarns",
    )],
};

const ROOT: &[Key] = &[
    required("name", Kind::Text),
    optional("weave", Kind::Table(WEAVE), "knit or curves"),
    optional("knit", Kind::Tagged("{ kind = \"jersey\", ... }", KNITS), "weave or curves"),
    optional("curves", Kind::Table(CURVES), "weave or knit"),
    optional("warp", Kind::Table(YARN), "of a weave, or of curves of two yarns"),
    optional("weft", Kind::Table(YARN), "of a weave, or of curves of two yarns"),
    optional("yarn", Kind::Table(YARN), "of a knit, or of curves of one yarn"),
    optional("thickness_um", Kind::Number(1.0, 1e5), "not pressed"),
    optional("color_of", Kind::Choice(&["even_sky", "reflected", "folded"]), "\"even_sky\""),
    optional("thermal", Kind::Table(THERMAL), "usual fibers"),
];
const THERMAL: &[Key] = &[
    optional("thickness_um", Kind::Number(1.0, 1e5), "that of the curves"),
    optional("conductivity_w_per_m_k", Kind::Number(1e-3, 1e3), "0.15, of polymers"),
    optional("emissivity_front", Kind::Number(0.0, 1.0), "by fibers and openness"),
    optional("emissivity_back", Kind::Number(0.0, 1.0), "by fibers and openness"),
    optional("ir_transmittance", Kind::Number(0.0, 1.0), "light beside all fibers"),
    optional("permeability", Kind::Number(0.0, 1.0), "openness"),
];
const COUNT: &[Key] = &[
    optional("tex", Kind::Number(0.1, 1e4), "another unit"),
    optional("dtex", Kind::Number(1.0, 1e5), "another unit"),
    optional("den", Kind::Number(1.0, 1e5), "another unit"),
    optional("ne", Kind::Number(0.05, 1000.0), "another unit"),
    optional("nm", Kind::Number(0.1, 2000.0), "another unit"),
    optional("filaments", Kind::Integer(1, 10_000), "not said"),
];
const YARN: &[Key] = &[
    optional("model", Kind::Text, "none: the geometry alone"),
    required("count", Kind::Table(COUNT)),
    required("density_g_per_cm3", Kind::Number(0.5, 25.0)),
    optional("packing", Kind::Number(0.1, 1.0), "0.6"),
    optional("plies", Kind::Integer(1, 7), "1"),
    optional("bundles", Kind::Integer(1, 19), "1"),
    optional("twist_per_m", Kind::Number(0.0, 5000.0), "0.0"),
    optional("handedness", Kind::Choice(&["Z", "S"]), "\"Z\""),
    optional("ends_per_cm", Kind::Number(0.1, 1000.0), "of a warp; the WIF's"),
    optional("picks_per_cm", Kind::Number(0.1, 1000.0), "of a weft; the WIF's"),
    optional("tension", Kind::Number(0.01, 100.0), "1.0"),
    optional("crimp_percent", Kind::Number(0.0, 200.0), "by tension"),
    optional("stiffness", Kind::Number(0.0, 100.0), "0.5"),
    optional("cohesion", Kind::Number(0.0, 100.0), "0.02"),
    optional("count_cv", Kind::Number(0.0, 0.5), "even"),
    optional("spacing_cv", Kind::Number(0.0, 0.15), "even"),
    optional("uneven_mm", Kind::Number(0.1, 1e4), "10 where uneven"),
    optional("srgb", Kind::Srgb, "clear fibers"),
    optional("stripes", Kind::Custom(STRIPES), "one color"),
    optional("sigma_per_um", Kind::Number(0.0, 10.0), "srgb"),
    optional("slit_um", Kind::Above(0.0, SLIT_MAX_UM as f64), "no slits"),
    optional("slit_share", Kind::Number(0.0, 1.0), "a quarter, with slit_um"),
    optional("hairs", Kind::Table(HAIRS), "none"),
];
const HAIRS: &[Key] = &[
    required("per_mm", Kind::Number(0.0, 100.0)),
    required("length_mm", Kind::Number(0.02, 10.0)),
    optional("curl_mm", Kind::Number(0.05, 100.0), "0.5"),
    optional("rise", Kind::Number(0.05, 0.95), "0.5"),
    optional("loops", Kind::Number(0.0, 1.0), "0.0"),
];

/// Most yarns of a repeat of stripes.
const MAX_STRIPES: usize = 4096;
const STRIPES: Custom = Custom {
    expected: "stripes, each a count of yarns and a color",
    check: |file, key, value| {
        const HINT: &str = "use stripes such as [{ count = 12, srgb = [0.1, 0.2, 0.5] }, { count = 4, srgb = \"#e6e6e6\" }], 4096 yarns at most";
        let is_color = |v: &Value| crate::color::srgb_of_value(v).is_some();
        let count = |v: &Value| {
            let stripe = v.as_table().filter(|t| t.len() == 2 && t.get("srgb").is_some_and(is_color))?;
            usize::try_from(stripe.get("count")?.as_integer()?).ok().filter(|n| (1..=MAX_STRIPES).contains(n))
        };
        let counts: Option<Vec<usize>> = value.as_array().map(|all| all.iter().map(count).collect()).unwrap_or(None);
        match counts {
            Some(counts) if (1..=MAX_STRIPES).contains(&counts.iter().sum::<usize>()) => Ok(()),
            _ => Err(invalid(file, key, value, HINT)),
        }
    },
};
const WALES: Key = required("wales_per_cm", Kind::Number(0.1, 200.0));
const COURSES: Key = required("courses_per_cm", Kind::Number(0.1, 200.0));
const LOOP: Key = required("loop_mm", Kind::Number(0.05, 200.0));
const ROWS: Custom = Custom {
    expected: "rows of one length of K (knit) and P (purl), such as [\"KP\", \"PK\"]",
    check: |file, key, value| match value.as_array() {
        Some(rows) if rows.iter().all(Value::is_str) => Ok(()),
        _ => Err(invalid(file, key, value, "use rows of one length of K and P, such as [\"KP\", \"PK\"]")),
    },
};
/// Keys of each `knit.kind`, besides `kind`.
const KNITS: &[(&str, &[Key])] = &[
    ("jersey", &[WALES, COURSES, LOOP]),
    (
        "rib",
        &[
            WALES,
            COURSES,
            LOOP,
            optional("knit", Kind::Integer(1, 32), "1"),
            optional("purl", Kind::Integer(1, 32), "1"),
        ],
    ),
    ("garter", &[WALES, COURSES, LOOP]),
    ("seed", &[WALES, COURSES, LOOP]),
    ("interlock", &[WALES, COURSES, LOOP]),
    ("tricot", &[WALES, COURSES, LOOP]),
    ("grid", &[WALES, COURSES, LOOP, required("rows", Kind::Custom(ROWS))]),
];
const CURVES: &[Key] = &[
    required("file", Kind::Text),
    optional("cell_um", Kind::Custom(CELL), "that of the file"),
    optional("um_per_unit", Kind::Number(1e-6, 1e9), "1, of a .tg3 by its GeometryScale"),
    optional("relax", Kind::Custom(BOOL), "false"),
];
const CELL: Custom = Custom {
    expected: "two vectors of two numbers",
    check: |file, key, value| {
        let number = |v: &Value| v.as_float().is_some_and(f64::is_finite) || v.is_integer();
        let pair = |v: &Value| v.as_array().is_some_and(|v| v.len() == 2 && v.iter().all(number));
        match value.as_array() {
            Some(rows) if rows.len() == 2 && rows.iter().all(pair) => Ok(()),
            _ => Err(invalid(file, key, value, "use two vectors such as [[700.0, 0.0], [0.0, 500.0]]")),
        }
    },
};
const BOOL: Custom = Custom {
    expected: "true or false",
    check: |file, key, value| match value.is_bool() {
        true => Ok(()),
        false => Err(invalid(file, key, value, "use true or false")),
    },
};

impl ClothSpec {
    /// A spec from TOML.
    ///
    /// # Errors
    /// [`crate::Error::Format`] for text that is not TOML, [`crate::Error::Invalid`] for a key that is
    /// unknown, absent or out of range, and for keys that contradict each other.
    pub fn parse(text: &str, file: &str) -> Result<ClothSpec> {
        let table = rules::parse(text, file, &CLOTH_RULES)?;
        if let Some(weave) = table.get("weave") {
            check_weave_keys(file, weave)?;
        }
        let spec: ClothSpec = rules::typed(table, file, &CLOTH_RULES)?;
        check_relations(file, &spec)?;
        Ok(spec)
    }
}

/// What must hold between keys.
fn check_relations(file: &str, spec: &ClothSpec) -> Result<()> {
    let given = [spec.weave.is_some(), spec.knit.is_some(), spec.curves.is_some()];
    if given.iter().filter(|is| **is).count() != 1 {
        let names: Vec<&str> =
            ["weave", "knit", "curves"].into_iter().zip(given).filter(|g| g.1).map(|g| g.0).collect();
        let value = if names.is_empty() { "(absent)".to_string() } else { names.join(" and ") };
        return Err(invalid(file, "weave", value, "give one of [weave], [knit] and [curves]"));
    }
    // Curves are of one yarn, or of two.
    let is_two = given[0] || (given[2] && (spec.warp.is_some() || spec.weft.is_some()));
    let wanted = if is_two { ["warp", "weft"].as_slice() } else { &["yarn"] };
    for (name, yarn) in [("warp", &spec.warp), ("weft", &spec.weft), ("yarn", &spec.yarn)] {
        match (yarn, wanted.contains(&name)) {
            (Some(yarn), true) => {
                check_yarn(file, name, yarn)?;
                check_spacing(file, name, yarn, spec)?;
            }
            (None, true) => return Err(invalid(file, name, "(absent)", "this table must be given")),
            (Some(_), false) => {
                let hint = format!("leave it out, or use [{}]", wanted.join("] and ["));
                return Err(invalid(file, name, "(given)", hint));
            }
            (None, false) => {}
        }
    }
    if let Some(weave) = &spec.weave {
        check_weave(file, weave)?;
    }
    check_thermal(file, spec)
}

/// What is emitted and what goes through are parts of one.
fn check_thermal(file: &str, spec: &ClothSpec) -> Result<()> {
    let thermal = spec.thermal.unwrap_or_default();
    let through = thermal.ir_transmittance.unwrap_or(0.0);
    for (key, emitted) in [("emissivity_front", thermal.emissivity_front), ("emissivity_back", thermal.emissivity_back)]
    {
        if let Some(emitted) = emitted.filter(|emitted| emitted + through > 1.0 + 1e-9) {
            let hint = format!("must be 1 - ir_transmittance at most, which is {:.6}", 1.0 - through);
            return Err(invalid(file, &format!("thermal.{key}"), emitted, hint));
        }
    }
    Ok(())
}

fn check_yarn(file: &str, name: &str, yarn: &YarnOfCloth) -> Result<()> {
    let key = |of: &str| format!("{name}.{of}");
    let units = yarn.count.units();
    if units.len() != 1 {
        let names: Vec<&str> = units.iter().map(|(unit, _)| *unit).collect();
        let value = if names.is_empty() { "(absent)".into() } else { names.join(" and ") };
        return Err(invalid(file, &key("count"), value, "give one of tex, dtex, den, ne, nm"));
    }
    if yarn.bundles > 1 && yarn.plies > 1 {
        let hint = "a yarn has plies or bundles, not both; leave one out";
        return Err(invalid(file, &key("bundles"), yarn.bundles, hint));
    }
    if yarn.twist_per_m > 0.0 && yarn.strands() > 1 && yarn.symmetry() == 1 {
        let hint = format!("{} bundles cannot be twisted in a periodic cloth; use 3, 7 or 19", yarn.bundles);
        return Err(invalid(file, &key("twist_per_m"), yarn.twist_per_m, hint));
    }
    if yarn.crimp_percent.is_some() && yarn.tension != 1.0 {
        return Err(invalid(file, &key("tension"), yarn.tension, "give either tension or crimp_percent, not both"));
    }
    if yarn.srgb.is_some() && yarn.sigma_per_um.is_some() {
        let sigma = yarn.sigma_per_um.unwrap_or_default();
        return Err(invalid(file, &key("sigma_per_um"), sigma, "give either srgb or sigma_per_um, not both"));
    }
    if !yarn.stripes.is_empty() && (yarn.srgb.is_some() || yarn.sigma_per_um.is_some()) {
        let hint = "give either stripes or one color, not both";
        return Err(invalid(file, &key("stripes"), format!("{} stripes", yarn.stripes.len()), hint));
    }
    if let (Some(share), None) = (yarn.slit_share, yarn.slit_um) {
        let hint = "give slit_um, the width of the slits, too, or leave this key out";
        return Err(invalid(file, &key("slit_share"), share, hint));
    }
    if let (Some(mm), None, None) = (yarn.uneven_mm, yarn.count_cv, yarn.spacing_cv) {
        let hint = "give count_cv or spacing_cv, what changes over this length, or leave this key out";
        return Err(invalid(file, &key("uneven_mm"), mm, hint));
    }
    Ok(())
}

/// Whether the yarn has the spacing that its cloth needs, and no other.
fn check_spacing(file: &str, name: &str, yarn: &YarnOfCloth, spec: &ClothSpec) -> Result<()> {
    let key = |of: &str| format!("{name}.{of}");
    let (ends, picks) = (("ends_per_cm", yarn.ends_per_cm), ("picks_per_cm", yarn.picks_per_cm));
    let Some(weave) = &spec.weave else {
        let hint = match spec.knit {
            Some(_) => "leave it out: [knit] has wales_per_cm and courses_per_cm",
            None => "leave it out: the file of the curves has the places of the yarns",
        };
        let given = [ends, picks].into_iter().find_map(|(name, value)| value.map(|value| (name, value)));
        return given.map_or(Ok(()), |(name, value)| Err(invalid(file, &key(name), value, hint)));
    };
    let (own, other) = if name == "warp" { (ends, picks) } else { (picks, ends) };
    match (own, other) {
        (_, (other, Some(value))) => Err(invalid(file, &key(other), value, format!("use {}", own.0))),
        // A WIF may have it.
        ((own, None), _) if !matches!(weave, WeaveSpec::Wif { .. }) => {
            Err(invalid(file, &key(own), "(absent)", "this key must be given"))
        }
        _ => Ok(()),
    }
}
