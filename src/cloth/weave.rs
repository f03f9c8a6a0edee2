//! Weaves of the cloth spec, their rules, and colors of yarns. Names are in `named.rs`.

use super::YarnSet;
use super::draft::{Draft, MAX_THREADS};
use super::named::NamedWeave;
#[cfg(doc)]
use super::wif::Wif;
use crate::Result;
use crate::spec::rules::{Custom, Key, Kind, invalid, optional, required};
use serde::{Deserialize, Serialize};
use toml::Value;

/// Weaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WeaveKeys", into = "WeaveKeys")]
pub enum WeaveSpec {
    /// A weave by the name that weavers use.
    Named(NamedWeave),
    /// Any draft: rows of `X` (warp on top) and `.`, as seen, so that the last row is the first pick.
    Draft {
        /// Rows of one repeat, all of the same length.
        rows: Vec<String>,
    },
    /// A weavers' file, [`Wif`].
    Wif {
        /// Path of the file, relative to the spec.
        file: String,
    },
}

/// The keys of a weave.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WeaveKeys {
    kind: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rows: Option<Vec<String>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file: Option<String>,
}

impl TryFrom<WeaveKeys> for WeaveSpec {
    type Error = String;

    fn try_from(keys: WeaveKeys) -> std::result::Result<WeaveSpec, String> {
        match (keys.kind.as_str(), keys.rows, keys.file) {
            ("draft", Some(rows), None) => Ok(WeaveSpec::Draft { rows }),
            ("wif", None, Some(file)) => Ok(WeaveSpec::Wif { file }),
            (name, None, None) => name.parse().map(WeaveSpec::Named),
            (name, ..) => Err(format!("weave.kind = {name} has other keys")),
        }
    }
}

impl From<WeaveSpec> for WeaveKeys {
    fn from(weave: WeaveSpec) -> WeaveKeys {
        match weave {
            WeaveSpec::Named(name) => WeaveKeys { kind: name.to_string(), ..WeaveKeys::default() },
            WeaveSpec::Draft { rows } => WeaveKeys { kind: "draft".into(), rows: Some(rows), file: None },
            WeaveSpec::Wif { file } => WeaveKeys { kind: "wif".into(), rows: None, file: Some(file) },
        }
    }
}

/// What a yarn is colored by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YarnColor {
    /// Neither the spec nor a WIF says anything: clear fibers, and opaque ones in their own color.
    Undyed,
    /// A color [sRGB, 0 to 1].
    Srgb([f32; 3]),
    /// An absorption coefficient [1/um].
    Sigma(f32),
}

impl WeaveSpec {
    /// The draft; `None` for a WIF, whose draft is in its file, and for rows that hold none.
    pub fn draft(&self) -> Option<Draft> {
        match self {
            WeaveSpec::Named(name) => Some(name.draft()),
            WeaveSpec::Draft { rows } => {
                let up = |pick: usize, end: usize| {
                    rows.get(rows.len() - 1 - pick).and_then(|r| r.as_bytes().get(end)) == Some(&b'X')
                };
                Draft::from_fn(rows.len(), rows.first().map_or(0, String::len), up)
            }
            WeaveSpec::Wif { .. } => None,
        }
    }
}

/// Keys of a weave.
pub(super) const WEAVE: &[Key] = &[
    required("kind", Kind::Custom(KIND)),
    optional("rows", Kind::Custom(ROWS), "of a draft"),
    optional("file", Kind::Text, "of a WIF"),
];

const KIND: Custom = Custom {
    expected: "the name of a weave, such as \"satin 5/2\", \"draft\" or \"wif\"",
    check: |file, key, value| {
        let Some(name) = value.as_str() else {
            return Err(invalid(file, key, value, "use the name of a weave in quotes, such as \"twill 2/2\""));
        };
        match name {
            "draft" | "wif" => Ok(()),
            _ => name.parse::<NamedWeave>().map(|_| ()).map_err(|hint| invalid(file, key, value, hint)),
        }
    },
};

/// What must hold between the keys of a weave, before it is one.
pub(super) fn check_weave_keys(file: &str, weave: &Value) -> Result<()> {
    let kind = weave.get("kind").and_then(Value::as_str).unwrap_or_default();
    for (key, of, hint) in [
        ("rows", "draft", "leave it out, or use kind = \"draft\""),
        ("file", "wif", "leave it out, or use kind = \"wif\""),
    ] {
        let name = format!("weave.{key}");
        match (weave.get(key), kind == of) {
            (Some(value), false) => return Err(invalid(file, &name, value, hint)),
            (None, true) => return Err(invalid(file, &name, "(absent)", "this key must be given")),
            _ => {}
        }
    }
    Ok(())
}

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

/// What must hold within a weave: a draft of rows binds every yarn.
pub(super) fn check_weave(file: &str, weave: &WeaveSpec) -> Result<()> {
    match (weave, weave.draft()) {
        (WeaveSpec::Draft { .. }, Some(draft)) => check_bound(file, &draft),
        _ => Ok(()),
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
