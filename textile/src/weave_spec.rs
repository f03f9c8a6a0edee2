//! Weaves of the cloth spec with their rules. `named.rs` has the names of weaves.

use crate::picture::spec::{PictureWeave, WEAVES_FORM, check_weaves};
use crate::weave::draft::YarnSet;
use crate::weave::draft::{Draft, MAX_THREADS};
use crate::weave::named::NamedWeave;
#[cfg(doc)]
use crate::weave::wif::Wif;
use plywave::Result;
use plywave::spec::rules::{Custom, Key, KeyKind, invalid, optional};
use toml::{Table, Value};

/// The weave of a woven cloth.
#[derive(Clone, Debug, PartialEq)]
pub enum WeaveSpec {
    /// A weave by the name that weavers use.
    Named(NamedWeave),
    /// Any draft: rows of `X` (warp on top) and `.` as seen, so that the last row is the first pick.
    Draft {
        /// Rows of one repeat, all of the same length.
        rows: Vec<String>,
    },
    /// A weavers' file, [`Wif`].
    Wif {
        /// Path of the file, relative to the spec.
        file: String,
    },
    /// A picture, with a weave for each of its colors.
    Picture(PictureWeave),
}

impl WeaveSpec {
    /// The draft; `None` for a WIF or a picture, whose draft is in its file, and for rows that
    /// do not form a draft.
    pub fn draft(&self) -> Option<Draft> {
        match self {
            WeaveSpec::Named(name) => Some(name.draft()),
            WeaveSpec::Draft { rows } => {
                let up = |pick: usize, end: usize| {
                    rows.get(rows.len() - 1 - pick).and_then(|r| r.as_bytes().get(end)) == Some(&b'X')
                };
                Draft::from_fn(rows.len(), rows.first().map_or(0, String::len), up)
            }
            WeaveSpec::Wif { .. } | WeaveSpec::Picture(_) => None,
        }
    }
}

/// Keys of a weave.
pub(crate) const WEAVE: &[Key] = &[
    optional("kind", KeyKind::Custom(KIND), "of a picture"),
    optional("rows", KeyKind::Custom(ROWS), "of a draft"),
    optional("file", KeyKind::Text, "of a WIF"),
    optional("picture", KeyKind::Text, "of kind"),
    optional("weaves", KeyKind::Custom(WEAVES), "of a picture"),
    optional("max_float", KeyKind::Integer(2, MAX_THREADS as i64), "twice that of the weaves"),
    optional("ends_per_cm", KeyKind::Number(0.1, 1000.0), "the WIF's"),
    optional("picks_per_cm", KeyKind::Number(0.1, 1000.0), "the WIF's"),
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

const WEAVES: Custom = Custom { expected: WEAVES_FORM, check: check_weaves };

impl WeaveSpec {
    /// Reads the keys of a weave, which passed their rules.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for keys that do not go together.
    pub(crate) fn read(file: &str, keys: &Table) -> Result<WeaveSpec> {
        check_weave_keys(file, keys)?;
        let text = |key: &str| keys.get(key).and_then(Value::as_str).map(str::to_string);
        if keys.contains_key("picture") {
            let of_picture = keys.clone().try_into::<PictureWeave>();
            return of_picture
                .map(WeaveSpec::Picture)
                .map_err(|e| invalid(file, "weave.weaves", "(a table)", e.message()));
        }
        let weave = match text("kind").unwrap_or_default().as_str() {
            "draft" => {
                let rows = keys.get("rows").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
                WeaveSpec::Draft { rows: rows.iter().filter_map(Value::as_str).map(str::to_string).collect() }
            }
            "wif" => WeaveSpec::Wif { file: text("file").unwrap_or_default() },
            name => WeaveSpec::Named(name.parse().map_err(|hint: String| invalid(file, "weave.kind", name, hint))?),
        };
        check_weave(file, &weave)?;
        Ok(weave)
    }
}

/// Checks the relations between the keys of a weave before it is read.
fn check_weave_keys(file: &str, weave: &Table) -> Result<()> {
    let kind = weave.get("kind").and_then(Value::as_str).unwrap_or_default();
    let is_picture = weave.contains_key("picture");
    match (weave.get("kind"), is_picture) {
        (Some(kind), true) => {
            let hint = "leave it out: a picture has a weave for each of its colors, in weaves";
            return Err(invalid(file, "weave.kind", kind, hint));
        }
        (None, false) => return Err(invalid(file, "weave.kind", "(absent)", "give the name of a weave, or a picture")),
        _ => {}
    }
    for key in ["weaves", "max_float"] {
        match (weave.get(key), is_picture) {
            (Some(value), false) => {
                let hint = "leave it out, or give picture, the file of the picture";
                return Err(invalid(file, &format!("weave.{key}"), value, hint));
            }
            (None, true) if key == "weaves" => {
                let hint =
                    "give a weave for each color, such as { \"#fff\" = \"satin 5/2\", \"#000\" = \"satin 5/2 weft\" }";
                return Err(invalid(file, "weave.weaves", "(absent)", hint));
            }
            _ => {}
        }
    }
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

/// Checks that a draft given by rows binds every yarn.
fn check_weave(file: &str, weave: &WeaveSpec) -> Result<()> {
    match (weave, weave.draft()) {
        (WeaveSpec::Draft { .. }, Some(draft)) => check_bound(file, &draft),
        _ => Ok(()),
    }
}

fn check_bound(file: &str, draft: &Draft) -> Result<()> {
    let Some((family, thread, up)) = draft.unbound() else { return Ok(()) };
    let (what, at) = match family {
        YarnSet::Warp => ("column", thread + 1),
        // Rows are numbered as written: the last row is the first pick.
        YarnSet::Weft => ("row", draft.picks() - thread),
    };
    let side = if up { "above" } else { "below" };
    let value = format!("{what} {at}, whose {} lies {side} all others", family.name());
    Err(invalid(file, "weave.rows", value, "bind every yarn: both X and . in every row and every column"))
}
