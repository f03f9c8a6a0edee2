//! Weaves by the names that weavers use: a name, counts and words, such as `twill 3/1 S`, `satin 8/3 weft` or
//! `herringbone 2/2 12`. The order of the words, capitals, hyphens and the word `weave` do not matter.
//!
//! Twills and the weaves derived from them are threaded on shafts and treadled: treadle t lifts shaft s if
//! the twill's order has the warp on top at (t - s) mod n.

use crate::weave::draft::{Draft, MAX_THREADS};
use crate::words::nearest;
use plywave::spec::Handedness;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Default number of ends in a band of a herringbone or a chevron.
const BAND: usize = 8;

/// A weave by name. It prints as a name that parses to the same weave.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum NamedWeave {
    /// Over one, under one.
    Plain,
    /// Each end passes over the first count of picks, under the second, and so on; its neighbor at larger x
    /// does so one pick later (Z) or earlier (S).
    Twill(Vec<usize>, Handedness),
    /// A twill of four picks whose ends follow in the order 1, 2, 4, 3, so that no diagonal continues.
    BrokenTwill(Vec<usize>),
    /// One binding point per pick, moved by `step` ends from pick to pick.
    Satin {
        /// Number of ends in the repeat.
        ends: usize,
        /// Number of ends from one binding point to the next.
        step: usize,
        /// Whether the warp is on top except at these points; otherwise the weft is.
        of_warp: bool,
    },
    /// A twill in bands of this many ends that run to the right and to the left, with a cut between them.
    Herringbone(Vec<usize>, usize),
    /// A twill in bands of this many ends that run to the right and to the left, mirrored about an end.
    Chevron(Vec<usize>, usize),
    /// Plain weave of groups of ends and of picks.
    Hopsack {
        /// Number of ends in a group.
        ends: usize,
        /// Number of picks in a group.
        picks: usize,
    },
    /// Warp ribs: ends pass over the first count of picks and under the second, and their neighbors the other
    /// way round. Weft ribs have picks and ends exchanged.
    Rib {
        /// Numbers of threads that a yarn passes over, and under.
        counts: [usize; 2],
        /// Whether the warp makes the ribs; otherwise the weft does.
        of_warp: bool,
    },
    /// A 2/2 twill, threaded and treadled to points on four shafts: small diamonds with a dot.
    Birdseye,
    /// A 2/2 twill. Its teeth come from colors: four dark and four light yarns in turn, in warp and weft.
    Houndstooth,
    /// Two layers of straight yarns, warp above weft: no cloth, but the simplest case for testing a model.
    /// Round yarns touch where the crimps add up to 1.
    Layers,
}

/// Names, each with its synonyms.
const NAMES: &[(&str, &[&str])] = &[
    ("plain", &["tabby"]),
    ("twill", &[]),
    ("broken", &[]),
    ("satin", &[]),
    ("sateen", &[]),
    ("herringbone", &[]),
    ("chevron", &["pointed", "zigzag"]),
    ("hopsack", &["basket", "matt"]),
    ("oxford", &[]),
    ("rib", &[]),
    ("birdseye", &[]),
    ("houndstooth", &["dogtooth"]),
    ("layers", &[]),
];

/// The words of a name.
#[derive(Default)]
struct Words {
    name: Option<&'static str>,
    /// Groups of counts; slashes separate the counts of a group.
    counts: Vec<Vec<usize>>,
    hand: Option<Handedness>,
    of_warp: Option<bool>,
    /// A message about a word that is no name, or about a second name.
    unknown: Option<String>,
}

fn counts_of(word: &str) -> Option<Vec<usize>> {
    word.split('/').map(|count| count.parse().ok()).collect()
}

impl Words {
    fn read(text: &str, plain: &str) -> Result<Words, String> {
        let mut words = Words::default();
        for word in plain.split_whitespace() {
            match word {
                "z" => words.hand = Some(Handedness::Z),
                "s" => words.hand = Some(Handedness::S),
                "warp" => words.of_warp = Some(true),
                "weft" => words.of_warp = Some(false),
                "weave" => {}
                _ if word.starts_with(|c: char| c.is_ascii_digit()) => {
                    let counts = counts_of(word);
                    words.counts.push(counts.ok_or_else(|| format!("{word} is no count; write 2/2"))?);
                }
                _ => words.add_name(word),
            }
        }
        match words.unknown.take() {
            Some(what) => Err(what),
            None if words.name.is_none() => Err(format!("no name of a weave in {text:?}; {}", list())),
            None => Ok(words),
        }
    }

    fn add_name(&mut self, word: &str) {
        let known = NAMES.iter().find(|(name, others)| *name == word || others.contains(&word));
        match (known.map(|(name, _)| *name), self.name) {
            (Some(name), None) => self.name = Some(name),
            // "broken twill" and "pointed twill" are twills.
            (Some("twill"), Some("broken" | "chevron")) => {}
            (Some(name @ ("broken" | "chevron")), Some("twill")) => self.name = Some(name),
            (Some(_), Some(name)) => self.unknown = Some(format!("{word} beside {name}: give one name")),
            (None, _) => self.unknown = Some(unknown(word)),
        }
    }

    /// The only group of counts, with N numbers; `usual` if the name has none.
    fn only<const N: usize>(&self, usual: Option<[usize; N]>, form: &str) -> Result<[usize; N], String> {
        match (&self.counts[..], usual) {
            ([counts], _) => counts.as_slice().try_into().map_err(|_| format!("write {form}")),
            ([], Some(usual)) => Ok(usual),
            _ => Err(format!("write {form}")),
        }
    }

    /// The order of a twill, and the width of its bands.
    fn banded(&self, form: &str) -> Result<(Vec<usize>, usize), String> {
        let (mut order, mut width) = (vec![2, 2], BAND);
        for counts in &self.counts {
            match counts[..] {
                [ends] => width = ends,
                _ => order = counts.clone(),
            }
        }
        match self.counts.len() <= 2 && order.len() == 2 {
            true => Ok((order, width)),
            false => Err(format!("write {form}")),
        }
    }

    /// Rejects words that do not apply to this weave.
    fn without(&self, hand: bool, of_warp: bool, counts: bool) -> Result<(), String> {
        let name = self.name.map_or("", |name| if name == "broken" { "broken twill" } else { name });
        match self {
            Words { hand: Some(_), .. } if hand => Err(format!("a {name} has no hand; leave Z or S out")),
            Words { of_warp: Some(_), .. } if of_warp => Err(format!("leave warp or weft out of a {name}")),
            Words { counts: groups, .. } if counts && !groups.is_empty() => {
                Err(format!("a {name} has no counts; leave them out"))
            }
            _ => Ok(()),
        }
    }
}

fn list() -> String {
    let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).filter(|name| *name != "broken").collect();
    format!("use {}, draft or wif", names.join(", "))
}

fn unknown(word: &str) -> String {
    let all = NAMES.iter().flat_map(|(name, others)| std::iter::once(name).chain(*others));
    match nearest(word, all.chain(&["draft", "wif"]).copied()) {
        Some(name) => format!("{word:?} is no weave; did you mean {name}?"),
        None => format!("{word:?} is no weave; {}", list()),
    }
}

impl FromStr for NamedWeave {
    type Err = String;

    /// Parses a name. The error tells what to write, as the end of a message.
    fn from_str(text: &str) -> Result<NamedWeave, String> {
        let plain = text.to_lowercase().replace(['-', '\'', '\u{2019}'], "");
        let words = Words::read(text, &plain)?;
        let weave = match words.name.unwrap_or_default() {
            "twill" => twill(&words),
            "broken" => words.without(true, true, false).and_then(|()| {
                let form = "broken twill 3/1, of four picks";
                let order: [usize; 2] = words.only(None, form)?;
                (order[0] + order[1] == 4).then(|| NamedWeave::BrokenTwill(order.into())).ok_or(format!("write {form}"))
            }),
            name @ ("satin" | "sateen") => satin(&words, name == "satin"),
            "herringbone" => {
                let banded = words.without(true, true, false).and_then(|()| words.banded("herringbone 2/2 8"));
                banded.map(|(order, width)| NamedWeave::Herringbone(order, width))
            }
            "chevron" => {
                let banded = words.without(true, true, false).and_then(|()| words.banded("chevron 2/2 8"));
                banded.map(|(order, width)| NamedWeave::Chevron(order, width))
            }
            "hopsack" => words.without(true, true, false).and_then(|()| {
                let [ends, picks] = words.only(Some([2, 2]), "hopsack 2/2: ends and picks of a group")?;
                Ok(NamedWeave::Hopsack { ends, picks })
            }),
            "rib" => words.without(true, false, false).and_then(|()| {
                let counts = words.only(Some([2, 2]), "rib 2/2, with warp or weft")?;
                Ok(NamedWeave::Rib { counts, of_warp: words.of_warp.unwrap_or(true) })
            }),
            name => words.without(true, true, true).map(|()| match name {
                "oxford" => NamedWeave::Hopsack { ends: 2, picks: 1 },
                "birdseye" => NamedWeave::Birdseye,
                "houndstooth" => NamedWeave::Houndstooth,
                "layers" => NamedWeave::Layers,
                _ => NamedWeave::Plain,
            }),
        }?;
        match weave.try_draft() {
            Some(_) => Ok(weave),
            None => Err(format!("use counts of 1 or more and a repeat of {MAX_THREADS} yarns or less")),
        }
    }
}

fn twill(words: &Words) -> Result<NamedWeave, String> {
    const FORM: &str = "write picks over and under, as twill 2/2 or twill 3/1 S";
    words.without(false, true, false)?;
    match &words.counts[..] {
        [order] if order.len().is_multiple_of(2) => {
            Ok(NamedWeave::Twill(order.clone(), words.hand.unwrap_or(Handedness::Z)))
        }
        _ => Err(FORM.into()),
    }
}

fn satin(words: &Words, is_satin: bool) -> Result<NamedWeave, String> {
    words.without(true, !is_satin, false)?;
    let form = "satin 5/2: ends, and ends from one binding point to the next";
    let [ends, step] = words.only(None, form)?;
    if Draft::satin(ends, step).is_some() {
        return Ok(NamedWeave::Satin { ends, step, of_warp: is_satin && words.of_warp.unwrap_or(true) });
    }
    let is_sound = |step: &usize| Draft::satin(ends, *step).is_some();
    let good: Vec<String> = (2..ends.min(MAX_THREADS)).filter(is_sound).take(12).map(|s| s.to_string()).collect();
    Err(match good.is_empty() {
        true => format!("no satin has {ends} ends; use 5, or 7 to {MAX_THREADS}"),
        false => format!(
            "step and ends of satin {ends}/{step} must have no common factor; use a step of {}",
            good.join(", ")
        ),
    })
}

/// The order of a twill, over and under in turn: the warp is on top where it is true.
fn order_of(counts: &[usize]) -> Option<Vec<bool>> {
    let all = counts.iter().try_fold(0usize, |sum, count| sum.checked_add(*count))?;
    if counts.contains(&0) || all > MAX_THREADS {
        return None;
    }
    Some(counts.iter().enumerate().flat_map(|(k, count)| std::iter::repeat_n(k % 2 == 0, *count)).collect())
}

/// The draft of a twill's order, given the shafts of its ends and the treadles of its picks.
fn threaded(order: &[bool], shafts: &[usize], treadles: &[usize]) -> Option<Draft> {
    let n = order.len();
    Draft::from_fn(treadles.len(), shafts.len(), |pick, end| order[(treadles[pick] + n - shafts[end]) % n])
}

/// Shafts up and down again, each end of the range once.
fn pointed(last: usize) -> Vec<usize> {
    (0..=last).chain((1..last).rev()).collect()
}

impl NamedWeave {
    /// The draft of one repeat.
    pub fn draft(&self) -> Draft {
        // A name without a draft does not parse.
        self.try_draft().unwrap_or_else(Draft::plain)
    }

    fn try_draft(&self) -> Option<Draft> {
        let straight = |n: usize| (0..n).collect::<Vec<usize>>();
        match self {
            NamedWeave::Plain => Some(Draft::plain()),
            NamedWeave::Twill(counts, hand) => {
                let order = order_of(counts)?;
                let mut shafts = straight(order.len());
                if *hand == Handedness::S {
                    shafts.reverse();
                }
                threaded(&order, &shafts, &straight(order.len()))
            }
            NamedWeave::BrokenTwill(counts) => threaded(&order_of(counts)?, &[0, 1, 3, 2], &straight(4)),
            NamedWeave::Satin { ends, step, of_warp } => {
                let draft = Draft::satin(*ends, *step)?;
                Draft::from_fn(*ends, *ends, |pick, end| draft.up(pick, end) == *of_warp)
            }
            NamedWeave::Herringbone(counts, width) => {
                let order = order_of(counts)?;
                let n = order.len();
                let width = Some(*width).filter(|width| (2..=MAX_THREADS / 2).contains(width))?;
                // At the cut the neighbors are half of the order apart, which is opposite for a balanced
                // twill.
                let back = (0..width).rev().map(|end| (end + n / 2) % n);
                let shafts: Vec<usize> = (0..width).map(|end| end % n).chain(back).collect();
                threaded(&order, &shafts, &straight(n))
            }
            NamedWeave::Chevron(counts, width) => {
                let order = order_of(counts)?;
                let n = order.len();
                let width = Some(*width).filter(|width| (2..=MAX_THREADS / 2).contains(width))?;
                let shafts: Vec<usize> = pointed(width).into_iter().map(|shaft| shaft % n).collect();
                threaded(&order, &shafts, &straight(n))
            }
            NamedWeave::Hopsack { ends, picks } => Draft::hopsack(*ends, *picks),
            NamedWeave::Rib { counts: [over, under], of_warp } => {
                let order = order_of(&[*over, *under])?;
                match of_warp {
                    true => Draft::from_fn(order.len(), 2, |pick, end| order[pick] == (end == 0)),
                    // A pick passes over ends where the weft is on top.
                    false => Draft::from_fn(2, order.len(), |pick, end| order[end] != (pick == 0)),
                }
            }
            NamedWeave::Birdseye => threaded(&[true, true, false, false], &pointed(3), &pointed(3)),
            NamedWeave::Houndstooth => Draft::twill(2, 2),
            NamedWeave::Layers => Some(Draft::layers()),
        }
    }
}

impl fmt::Display for NamedWeave {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let strokes = |counts: &[usize]| counts.iter().map(usize::to_string).collect::<Vec<_>>().join("/");
        let side = |of_warp: &bool| if *of_warp { "warp" } else { "weft" };
        match self {
            NamedWeave::Plain => f.write_str("plain"),
            NamedWeave::Twill(counts, hand) => write!(f, "twill {} {hand:?}", strokes(counts)),
            NamedWeave::BrokenTwill(counts) => write!(f, "broken twill {}", strokes(counts)),
            NamedWeave::Satin { ends, step, of_warp } => write!(f, "satin {ends}/{step} {}", side(of_warp)),
            NamedWeave::Herringbone(counts, width) => write!(f, "herringbone {} {width}", strokes(counts)),
            NamedWeave::Chevron(counts, width) => write!(f, "chevron {} {width}", strokes(counts)),
            NamedWeave::Hopsack { ends, picks } => write!(f, "hopsack {ends}/{picks}"),
            NamedWeave::Rib { counts, of_warp } => write!(f, "rib {} {}", strokes(counts), side(of_warp)),
            NamedWeave::Birdseye => f.write_str("birdseye"),
            NamedWeave::Houndstooth => f.write_str("houndstooth"),
            NamedWeave::Layers => f.write_str("layers"),
        }
    }
}

impl TryFrom<String> for NamedWeave {
    type Error = String;

    fn try_from(text: String) -> Result<NamedWeave, String> {
        text.parse()
    }
}

impl From<NamedWeave> for String {
    fn from(weave: NamedWeave) -> String {
        weave.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows as drawn, with the last pick at the top.
    fn drawn(name: &str) -> Vec<String> {
        let weave: NamedWeave = name.parse().unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(weave.to_string().parse(), Ok(weave.clone()), "{name}");
        let draft = weave.draft();
        let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
        (0..draft.picks()).rev().map(row).collect()
    }

    fn refused(name: &str) -> String {
        name.parse::<NamedWeave>().expect_err(name)
    }

    /// Drafts drawn by hand from the definitions in weavers' books.
    #[test]
    fn names_have_the_drafts_of_the_books() {
        for (name, rows) in [
            ("plain", &[".X", "X."][..]),
            ("twill 3/1 Z", &[".XXX", "XXX.", "XX.X", "X.XX"]),
            ("twill 3/1 S", &["XXX.", ".XXX", "X.XX", "XX.X"]),
            ("twill 1/2", &["..X", ".X.", "X.."]),
            ("twill 2/1/1/1", &[".X.XX", "X.XX.", ".XX.X", "XX.X.", "X.X.X"]),
            // Ends 1, 2, 4, 3 of the twill.
            ("broken twill 3/1", &[".XXX", "XX.X", "XXX.", "X.XX"]),
            ("satin 5/2", &["XXX.X", "X.XXX", "XXXX.", "XX.XX", ".XXXX"]),
            ("satin 5/2 weft", &["...X.", ".X...", "....X", "..X..", "X...."]),
            // Threaded 1, 2, 3, 4, 2, 1, 4, 3.
            ("herringbone 2/2 4", &["..XX..XX", ".XX.X..X", "XX..XX..", "X..X.XX."]),
            ("chevron 2/2 3", &["..XXX.", ".XX.XX", "XX...X", "X..X.."]),
            ("hopsack 2/2", &["..XX", "..XX", "XX..", "XX.."]),
            ("hopsack 2/1", &["..XX", "XX.."]),
            ("rib 2/2 warp", &[".X", ".X", "X.", "X."]),
            ("rib 2/1 warp", &[".X", "X.", "X."]),
            ("rib 2/2 weft", &["XX..", "..XX"]),
            ("birdseye", &["XX...X", ".XX.XX", "..XXX.", ".XX.XX", "XX...X", "X..X.."]),
            ("houndstooth", &["..XX", ".XX.", "XX..", "X..X"]),
            ("layers", &["X"]),
        ] {
            assert_eq!(drawn(name), rows, "{name}");
        }
    }

    #[test]
    fn other_words_for_the_same() {
        for (name, same) in [
            ("Tabby", "plain"),
            ("plain weave", "plain"),
            ("Z twill 2/2", "twill 2/2"),
            ("2/2 twill", "twill 2/2 Z"),
            ("sateen 8/3", "satin 8/3 weft"),
            ("8/3 weft satin", "satin 8/3 weft"),
            ("basket", "hopsack 2/2"),
            ("basket 3/3", "hopsack 3/3"),
            ("oxford", "hopsack 2/1"),
            ("warp rib 2/2", "rib"),
            ("herringbone", "herringbone 2/2 8"),
            ("herringbone 12", "herringbone 2/2 12"),
            ("pointed twill 2/2 8", "chevron"),
            ("bird's-eye", "birdseye"),
            ("hounds-tooth", "houndstooth"),
            ("dogtooth", "houndstooth"),
        ] {
            assert_eq!(drawn(name), drawn(same), "{name}");
        }
    }

    /// Bands of a herringbone are a twill to the right and one to the left, opposite at the cut, for any
    /// width.
    #[test]
    fn herringbones_are_cut_between_bands() {
        for width in [4, 6, 7, 12] {
            let draft: NamedWeave = format!("herringbone 2/2 {width}").parse().unwrap();
            let (draft, order) = (draft.draft(), [true, true, false, false]);
            assert_eq!((draft.ends(), draft.picks()), (2 * width, 4));
            for pick in 0..4 {
                for end in 0..width - 1 {
                    let at = |end: usize, pick: usize| draft.up(pick % 4, end);
                    assert_eq!(at(end + 1, pick + 1), at(end, pick), "right, {width}: {end}");
                    assert_eq!(at(width + end + 1, pick + 3), at(width + end, pick), "left, {width}: {end}");
                }
                assert_ne!(draft.up(pick, width - 1), draft.up(pick, width), "cut of {width}");
                assert_ne!(draft.up(pick, 2 * width - 1), draft.up(pick, 0), "cut of {width} at its repeat");
                assert_eq!(draft.up(pick, 0), order[pick]);
            }
        }
    }

    #[test]
    fn every_weave_binds_its_yarns() {
        for name in [
            "twill 1/3",
            "twill 5/1/2/3 S",
            "broken twill 2/2",
            "satin 7/3",
            "herringbone 3/1 9",
            "herringbone 2/1 10",
            "chevron 1/3 7",
            "hopsack 3/2",
            "rib 3/1 weft",
            "birdseye",
        ] {
            let weave: NamedWeave = name.parse().unwrap();
            assert_eq!(weave.draft().unbound(), None, "{name}");
        }
    }

    #[test]
    fn names_that_are_none_are_refused_with_the_nearest() {
        for (name, want) in [
            ("velvet", "\"velvet\" is no weave; use plain, twill"),
            ("twil 2/2", "\"twil\" is no weave; did you mean twill?"),
            ("heringbone", "did you mean herringbone?"),
            ("Satins 5/2", "did you mean satin?"),
            ("", "no name of a weave"),
            ("2/2", "no name of a weave"),
            ("twill", "write picks over and under, as twill 2/2"),
            ("twill 2/2/1", "write picks over and under"),
            ("twill 0/2", "use counts of 1 or more"),
            ("twill 4000/4000", "a repeat of 4096"),
            ("twill 2/2 weft", "leave warp or weft out of a twill"),
            ("twill 2/x", "2/x is no count; write 2/2"),
            ("broken twill 2/1", "write broken twill 3/1, of four picks"),
            ("satin", "write satin 5/2"),
            ("satin 8/2", "step and ends of satin 8/2 must have no common factor; use a step of 3, 5"),
            ("satin 6/2", "no satin has 6 ends"),
            ("satin 5/4", "use a step of 2, 3"),
            ("satin 5/2 S", "a satin has no hand"),
            ("herringbone 2/2 8 4", "write herringbone 2/2 8"),
            ("herringbone 1", "use counts of 1 or more"),
            ("plain 2/2", "a plain has no counts"),
            ("plain twill 2/2", "twill beside plain: give one name"),
        ] {
            let got = refused(name);
            assert!(got.contains(want), "{name}: {got}");
        }
    }
}
