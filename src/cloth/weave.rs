//! Weaves of the cloth spec, their rules, and colors of yarns.

use super::YarnSet;
use super::draft::{Draft, MAX_THREADS};
#[cfg(doc)]
use super::wif::Wif;
use crate::Result;
use crate::spec::rules::{Custom, Key, Kind, invalid, required};
use serde::{Deserialize, Serialize};
use toml::Value;

const THREADS: i64 = MAX_THREADS as i64;

/// Weaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum WeaveSpec {
    /// Over one, under one. An open one, as organza, has spacings wider than its yarns.
    Plain {},
    /// Each end over `up` picks, under `down`.
    Twill {
        /// Picks that an end passes over.
        up: usize,
        /// Picks that an end passes under.
        down: usize,
    },
    /// Warp satin of `n` ends, its binding points moved by `step` from pick to pick.
    Satin {
        /// Ends of the repeat.
        n: usize,
        /// Ends from one binding point to the next.
        step: usize,
    },
    /// Plain weave of groups of `n`.
    Basket {
        /// Yarns of a group.
        n: usize,
    },
    /// Two layers of straight yarns, warp above weft: no cloth, but the simplest case to hold a model to.
    /// Round yarns touch where the crimps add up to 1.
    Layers {},
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
    /// The draft; `None` for a WIF, whose draft is in its file, and for counts out of range.
    pub fn draft(&self) -> Option<Draft> {
        match self {
            WeaveSpec::Plain {} => Some(Draft::plain()),
            WeaveSpec::Twill { up, down } => Draft::twill(*up, *down),
            WeaveSpec::Satin { n, step } => Draft::satin(*n, *step),
            WeaveSpec::Basket { n } => Draft::basket(*n),
            WeaveSpec::Layers {} => Some(Draft::layers()),
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

/// Keys of each `weave.kind`, besides `kind`.
pub(super) const WEAVES: &[(&str, &[Key])] = &[
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
pub(super) fn check_weave(file: &str, weave: &WeaveSpec) -> Result<()> {
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
