//! Rules of the cloth spec: its keys with their ranges, and relations between them.

use crate::cloth_spec::ClothSpec;
use crate::knit::spec::{KNITS, KnitSpec};
use crate::weave_spec::{WEAVE, WeaveSpec};
use crate::yarn::keys::YARN;
use crate::yarn::old;
use crate::yarn::resolve::{Use, resolve};
use plywave::Result;
use plywave::spec::rules::{self, Custom, Key, KeyKind, Rules, invalid, optional, required};
use toml::{Table, Value};

/// The rules of a cloth spec.
pub const CLOTH_RULES: Rules = Rules {
    keys: ROOT,
    units: &["_per_cm", "_per_um", "_per_m", "_um", "_mm", "_percent"],
    example: "fabrics/cloths/satin.toml",
    foreign: &[(
        &["fiber", "ply", "beam", "absorption", "simulation"],
        "this is a key of a ply spec; a cloth has its yarns, [warp] and [weft] or [yarn], with a fiber each",
    )],
};

const ROOT: &[Key] = &[
    required("name", KeyKind::Text),
    optional("weave", KeyKind::Table(WEAVE), "knit or curves"),
    optional("knit", KeyKind::Tagged("{ kind = \"jersey\", ... }", KNITS), "weave or curves"),
    optional("curves", KeyKind::Table(CURVES), "weave or knit"),
    optional("warp", KeyKind::Table(YARN), "of a weave, or of curves of two yarns"),
    optional("weft", KeyKind::Table(YARN), "of a weave, or of curves of two yarns"),
    optional("yarn", KeyKind::Table(YARN), "of a knit, or of curves of one yarn"),
    optional("thickness_um", KeyKind::Number(1.0, 1e5), "not pressed"),
    optional("color_of", KeyKind::Choice(&["even_sky", "reflected", "folded"]), "\"even_sky\""),
    optional("thermal", KeyKind::Table(THERMAL), "usual fibers"),
];
const THERMAL: &[Key] = &[
    optional("thickness_um", KeyKind::Number(1.0, 1e5), "that of the curves"),
    optional("conductivity_w_per_m_k", KeyKind::Number(1e-3, 1e3), "0.15, of polymers"),
    optional("emissivity_front", KeyKind::Number(0.0, 1.0), "by fibers and openness"),
    optional("emissivity_back", KeyKind::Number(0.0, 1.0), "by fibers and openness"),
    optional("ir_transmittance", KeyKind::Number(0.0, 1.0), "light beside all fibers"),
    optional("permeability", KeyKind::Number(0.0, 1.0), "openness"),
];
const CURVES: &[Key] = &[
    required("file", KeyKind::Text),
    optional("cell_um", KeyKind::Custom(CELL), "that of the file"),
    optional("um_per_unit", KeyKind::Number(1e-6, 1e9), "1, of a .tg3 by its GeometryScale"),
    optional("relax", KeyKind::Custom(BOOL), "false"),
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

/// Keys of which a yarn has one: a key of its own replaces the others of the yarn that it is `as`.
const INSTEAD: &[(&str, &[&str])] = &[
    ("color", &["stripes", "sigma_per_um"]),
    ("stripes", &["color", "sigma_per_um"]),
    ("sigma_per_um", &["color", "stripes"]),
    ("tension", &["crimp_percent"]),
    ("crimp_percent", &["tension"]),
    ("packing", &["diameter_um"]),
    ("diameter_um", &["packing"]),
    ("count", &["fibers", "diameter_um", "plies"]),
    ("fiber", &["fibers", "packing"]),
];

impl ClothSpec {
    /// Parses a spec from TOML.
    ///
    /// # Errors
    /// [`plywave::Error::Format`] for text that is not TOML, [`plywave::Error::Invalid`] for a key that is
    /// unknown, absent or out of range, and for keys that contradict each other.
    pub fn parse(text: &str, file: &str) -> Result<ClothSpec> {
        let mut root = rules::read(text, file, &CLOTH_RULES)?;
        for name in ["warp", "weft", "yarn"] {
            if let Some(Value::Table(yarn)) = root.get(name) {
                old::check(file, name, yarn)?;
            }
        }
        merge(file, &mut root)?;
        rules::check(file, &root, &CLOTH_RULES)?;
        let present = ["weave", "knit", "curves"].map(|name| root.contains_key(name));
        if present.iter().filter(|is| **is).count() != 1 {
            let names: Vec<&str> =
                ["weave", "knit", "curves"].into_iter().zip(present).filter(|g| g.1).map(|g| g.0).collect();
            let value = if names.is_empty() { "(absent)".to_string() } else { names.join(" and ") };
            return Err(invalid(file, "weave", value, "give one of [weave], [knit] and [curves]"));
        }
        let used = if present[0] { Use::Woven } else { Use::Loose };
        let yarn = |name: &str| match root.get(name) {
            Some(Value::Table(keys)) => resolve(file, name, keys, used).map(Some),
            _ => Ok(None),
        };
        let (warp, weft, yarn) = (yarn("warp")?, yarn("weft")?, yarn("yarn")?);
        // Curves consist of one yarn, or of two.
        let is_two = present[0] || (present[2] && (warp.is_some() || weft.is_some()));
        let wanted = if is_two { ["warp", "weft"].as_slice() } else { &["yarn"] };
        for name in ["warp", "weft", "yarn"] {
            match (root.contains_key(name), wanted.contains(&name)) {
                (false, true) => return Err(invalid(file, name, "(absent)", "this table must be given")),
                (true, false) => {
                    let hint = format!("leave it out, or use [{}]", wanted.join("] and ["));
                    return Err(invalid(file, name, "(given)", hint));
                }
                _ => {}
            }
        }
        let (weave, per_cm) = match root.get("weave") {
            Some(weave) => woven(file, weave)?,
            None => (None, [None; 2]),
        };
        let of_number = |name: &str| root.get(name).and_then(rules::number);
        let spec = ClothSpec {
            name: root.get("name").and_then(Value::as_str).unwrap_or_default().into(),
            color_of: typed(file, &root, "color_of")?.unwrap_or_default(),
            weave,
            per_cm,
            knit: root.get("knit").and_then(Value::as_table).map(|knit| KnitSpec::read(file, knit)).transpose()?,
            curves: typed(file, &root, "curves")?,
            warp,
            weft,
            yarn,
            thickness_um: of_number("thickness_um"),
            thermal: typed(file, &root, "thermal")?,
        };
        check_thermal(file, &spec)?;
        Ok(spec)
    }
}

/// The value of a key as a type.
fn typed<T: serde::de::DeserializeOwned>(file: &str, root: &Table, key: &str) -> Result<Option<T>> {
    let Some(value) = root.get(key) else { return Ok(None) };
    value.clone().try_into().map(Some).map_err(|e: toml::de::Error| invalid(file, key, value, e.message()))
}

/// Fills in the keys of a yarn that is `as` the other.
fn merge(file: &str, root: &mut Table) -> Result<()> {
    for (name, other) in [("warp", "weft"), ("weft", "warp")] {
        let Some(of) = root.get(name).and_then(|yarn| yarn.get("as")).cloned() else { continue };
        let base = root.get(other).and_then(Value::as_table).cloned();
        let key = format!("{name}.as");
        let Some(mut base) = base.filter(|base| of.as_str() == Some(other) && !base.contains_key("as")) else {
            return Err(invalid(file, &key, of, format!("name the other yarn, \"{other}\", which is written out")));
        };
        if let Some(Value::Table(own)) = root.get_mut(name) {
            own.remove("as");
            for (key, gone) in INSTEAD.iter().filter(|(key, _)| own.contains_key(*key)) {
                gone.iter().filter(|gone| !own.contains_key(**gone) || *gone == key).for_each(|gone| {
                    base.remove(*gone);
                });
            }
            base.extend(std::mem::take(own));
            *own = base;
        }
    }
    Ok(())
}

/// The weave with the ends and picks per centimeter.
fn woven(file: &str, weave: &Value) -> Result<(Option<WeaveSpec>, [Option<f64>; 2])> {
    let mut keys = weave.as_table().cloned().unwrap_or_default();
    let per_cm = ["ends_per_cm", "picks_per_cm"].map(|key| keys.remove(key).as_ref().and_then(rules::number));
    let weave = WeaveSpec::read(file, &keys)?;
    for (per_cm, key) in per_cm.iter().zip(["weave.ends_per_cm", "weave.picks_per_cm"]) {
        // A WIF may give it.
        if per_cm.is_none() && !matches!(weave, WeaveSpec::Wif { .. }) {
            return Err(invalid(file, key, "(absent)", "this key must be given"));
        }
    }
    Ok((Some(weave), per_cm))
}

/// Checks that emitted and transmitted shares do not exceed 1 together.
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
