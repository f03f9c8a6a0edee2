//! Weaves of the areas of a picture: a named weave, a double cloth of two such weaves, or a yarn that floats.

use crate::{Draft, MAX_THREADS, NamedWeave};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Weave of the area of one color. It prints as a name that parses to the same weave.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum AreaWeave {
    /// A weave by name.
    Named(NamedWeave),
    /// `double plain`: two cloths of this weave, one above the other. Ends and picks belong to the first and
    /// to the second cloth in turn. Exchanged, the second cloth is above.
    Double(NamedWeave, bool),
    /// `float` and `float back`: the weft lies on the face, or on the back, and only the limit of floats
    /// binds it.
    Float {
        /// Whether it lies on the back.
        is_back: bool,
    },
}

/// A weave with its repeat, to be laid over areas at any place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WovenUnit {
    /// One repeat.
    Repeat(Draft),
    /// The warp is above everywhere, or the weft is.
    Float {
        /// Whether the warp is above.
        is_warp_up: bool,
    },
}

impl WovenUnit {
    /// Whether the warp is on top where a pick and an end of the whole cloth cross.
    pub fn up(&self, pick: usize, end: usize) -> bool {
        match self {
            WovenUnit::Repeat(draft) => draft.up(pick % draft.picks(), end % draft.ends()),
            WovenUnit::Float { is_warp_up } => *is_warp_up,
        }
    }

    /// Picks and ends of the repeat.
    pub fn size(&self) -> [usize; 2] {
        match self {
            WovenUnit::Repeat(draft) => [draft.picks(), draft.ends()],
            WovenUnit::Float { .. } => [1, 1],
        }
    }
}

impl AreaWeave {
    /// The weave with its repeat.
    pub fn unit(&self) -> WovenUnit {
        match self {
            AreaWeave::Named(name) => WovenUnit::Repeat(name.draft()),
            AreaWeave::Double(name, exchanged) => {
                let one = name.draft();
                let up = |pick: usize, end: usize| match (pick % 2, end % 2) {
                    (of_pick, of_end) if of_pick == of_end => one.up(pick / 2, end / 2),
                    // The end of the upper cloth passes over the picks of the lower one.
                    (_, of_end) => (of_end == 0) != *exchanged,
                };
                // Weaves that would exceed the limit do not parse.
                WovenUnit::Repeat(Draft::from_fn(2 * one.picks(), 2 * one.ends(), up).unwrap_or(one))
            }
            AreaWeave::Float { is_back } => WovenUnit::Float { is_warp_up: *is_back },
        }
    }
}

impl FromStr for AreaWeave {
    type Err = String;

    /// Parses a name. The error tells what to write, as the end of a message.
    fn from_str(text: &str) -> Result<AreaWeave, String> {
        let plain = text.to_lowercase();
        let mut words: Vec<&str> = plain.split_whitespace().collect();
        if words.contains(&"float") {
            words.retain(|word| *word != "float");
            return match words[..] {
                [] | ["face"] => Ok(AreaWeave::Float { is_back: false }),
                ["back"] => Ok(AreaWeave::Float { is_back: true }),
                _ => Err("write float or float back".into()),
            };
        }
        if !words.contains(&"double") {
            let named: NamedWeave = text.parse()?;
            return match named {
                NamedWeave::Layers => Err("layers is no weave for an area; use float or float back".into()),
                _ => Ok(AreaWeave::Named(named)),
            };
        }
        let exchanged = words.contains(&"exchanged");
        words.retain(|word| !matches!(*word, "double" | "exchanged" | "cloth"));
        if words.is_empty() {
            words.push("plain");
        }
        let named: NamedWeave = words.join(" ").parse()?;
        let draft = named.draft();
        match named == NamedWeave::Layers || draft.ends().max(draft.picks()) > MAX_THREADS / 2 {
            true => Err(format!("use a weave of {} yarns or less for each cloth, as double plain", MAX_THREADS / 2)),
            false => Ok(AreaWeave::Double(named, exchanged)),
        }
    }
}

impl fmt::Display for AreaWeave {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AreaWeave::Named(name) => name.fmt(f),
            AreaWeave::Double(name, false) => write!(f, "double {name}"),
            AreaWeave::Double(name, true) => write!(f, "double {name} exchanged"),
            AreaWeave::Float { is_back: false } => f.write_str("float"),
            AreaWeave::Float { is_back: true } => f.write_str("float back"),
        }
    }
}

impl TryFrom<String> for AreaWeave {
    type Error = String;

    fn try_from(text: String) -> Result<AreaWeave, String> {
        text.parse()
    }
}

impl From<AreaWeave> for String {
    fn from(weave: AreaWeave) -> String {
        weave.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str) -> AreaWeave {
        let weave: AreaWeave = name.parse().unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(weave.to_string().parse(), Ok(weave.clone()), "{name}");
        weave
    }

    fn draft_of(name: &str) -> Draft {
        match of(name).unit() {
            WovenUnit::Repeat(draft) => draft,
            WovenUnit::Float { .. } => panic!("{name} floats"),
        }
    }

    /// Rows as drawn in books, with the last pick at the top.
    #[test]
    fn double_plain_is_drawn_on_four_ends() {
        let drawn = |name: &str| -> Vec<String> {
            let draft = draft_of(name);
            let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
            (0..draft.picks()).rev().map(row).collect()
        };
        assert_eq!(drawn("double plain"), ["X.XX", "..X.", "XXX.", "X..."]);
        assert_eq!(drawn("double plain exchanged"), ["...X", ".XXX", ".X..", "XX.X"]);
    }

    /// A double cloth falls apart into its two cloths, each with its own ends and picks.
    #[test]
    fn double_cloths_are_two_cloths() {
        for (name, first) in [
            ("double plain", 0),
            ("double plain exchanged", 1),
            ("Double cloth", 0),
            ("double twill 2/2", 0),
            ("exchanged double satin 5/2", 1),
        ] {
            let draft = draft_of(name);
            let layers = draft.layers_apart();
            assert_eq!(layers.len(), 2, "{name}");
            let own = |count: usize, which: usize| (0..count).filter(|at| at % 2 == which).collect::<Vec<usize>>();
            for (layer, which) in layers.iter().zip([first, 1 - first]) {
                assert_eq!(layer.ends, own(draft.ends(), which), "{name}");
                assert_eq!(layer.picks, own(draft.picks(), which), "{name}");
            }
        }
        // Each cloth of the pair is the weave itself.
        let twill = "twill 2/2".parse::<NamedWeave>().unwrap().draft();
        let pair = draft_of("double twill 2/2");
        for which in 0..2 {
            let one = Draft::from_fn(4, 4, |pick, end| pair.up(2 * pick + which, 2 * end + which)).unwrap();
            assert_eq!(one, twill);
        }
    }

    #[test]
    fn other_names_and_what_is_none() {
        assert_eq!(of("satin 8/3 weft").unit().size(), [8, 8]);
        assert!(!of("float").unit().up(3, 5) && of("Float back").unit().up(3, 5));
        for (name, want) in [
            ("velvet", "\"velvet\" is no weave"),
            ("satn 5/2", "did you mean satin?"),
            ("layers", "layers is no weave for an area"),
            ("double layers", "use a weave of 2048"),
            ("double twill 2000/2000", "use a weave of 2048 yarns or less"),
            ("double velvet", "\"velvet\" is no weave"),
            ("float over", "write float or float back"),
            ("", "no name of a weave"),
        ] {
            let got = name.parse::<AreaWeave>().expect_err(name);
            assert!(got.contains(want), "{name}: {got}");
        }
    }
}
