//! WIF, the weavers' exchange format ("Weaving Information File" 1.1, R. Nielsen and others, 1997): an INI file with threading, tie-up and treadling or
//! liftplan, and colors; from it the draft and the color of each yarn.
//!
//! Sections and keys count in any case; `;` begins a comment; yarns, shafts, treadles and colors are numbered from 1, and 0 stands for none. A
//! crossing has the warp on top where a shaft of the end is lifted: with `Rising Shed` (the default) those tied to a treadle that is pressed, without
//! it those that are not. A liftplan names lifted shafts in either case, and takes precedence over tie-up and treadling. What the fabric spec says itself
//! (spacing, thickness) is not read.

use super::Family;
use super::draft::{Draft, MAX_THREADS};
use crate::spec::rules::line;
use crate::{Error, Result};
use configparser::ini::IniDefault;
use std::collections::HashMap;

/// Largest WIF that is read [bytes].
pub(crate) const MAX_BYTES: u64 = 32 << 20;
/// Most shafts and treadles; a Jacquard loom has a shaft an end.
const MAX_SHAFTS: usize = MAX_THREADS;
/// Most colors of the table.
const MAX_COLORS: usize = 65_536;

/// What a WIF says of a weave.
#[derive(Clone, Debug, PartialEq)]
pub struct Wif {
    /// The draft, end 0 being its thread 1.
    pub draft: Draft,
    /// Color of each end [sRGB, 0 to 1], empty where the file has none.
    pub warp_srgb: Vec<[f32; 3]>,
    /// Color of each pick.
    pub weft_srgb: Vec<[f32; 3]>,
}

impl Wif {
    /// Reads a WIF; `file` is for messages. Bytes that are not UTF-8, in comments of old files, do no harm.
    ///
    /// # Errors
    /// [`Error::Format`] when it is no WIF, [`Error::Invalid`] naming section and key for what is missing or out of range.
    pub fn parse(bytes: &[u8], file: &str) -> Result<Wif> {
        let text = String::from_utf8_lossy(bytes);
        let ini = Ini::read(&text, file)?;
        let sides = [Family::Warp, Family::Weft].map(|family| ini.count(section_of(family), "Threads", MAX_THREADS));
        let [ends, picks] = sides;
        let (ends, picks) = (ends?, picks?);
        let shafts = ini.count("WEAVING", "Shafts", MAX_SHAFTS)?;
        let threading = ini.lists("THREADING", ends, shafts, "an end on no shaft is never lifted")?;
        let lifted = ini.lifted(picks, shafts)?;
        // Nearly always an end is on one shaft; a file may put it on thousands.
        let many: Vec<Option<Shafts>> =
            threading.iter().map(|list| (list.len() > 8).then(|| gather(list.iter().copied(), shafts))).collect();
        let draft = Draft::from_fn(picks, ends, |pick, end| match &many[end] {
            None => threading[end].iter().any(|&s| lifted[pick].get(s)),
            Some(set) => set.meets(&lifted[pick]),
        });
        let Some(draft) = draft else {
            return Err(ini.invalid("WARP", "Threads", ends, "use 1 to 4096 threads".into()));
        };
        if let Some((family, thread, up)) = draft.unbound() {
            let section = match family {
                Family::Warp => "THREADING",
                Family::Weft => ini.plan(),
            };
            let side = if up { "above" } else { "below" };
            let value = format!("{} of the {} that lies {side} all others", thread + 1, family.name());
            let hint = "bind this yarn: each must pass at least once above and once below".into();
            return Err(ini.invalid(section, &(thread + 1).to_string(), value, hint));
        }
        let [warp_srgb, weft_srgb] = ini.colors([ends, picks])?;
        Ok(Wif { draft, warp_srgb, weft_srgb })
    }
}

fn section_of(family: Family) -> &'static str {
    match family {
        Family::Warp => "WARP",
        Family::Weft => "WEFT",
    }
}

/// Shafts as bits.
struct Shafts(Vec<u64>);

impl Shafts {
    fn none(shafts: usize) -> Shafts {
        Shafts(vec![0; shafts / 64 + 1])
    }

    fn set(&mut self, shaft: usize) {
        if let Some(word) = self.0.get_mut(shaft / 64) {
            *word |= 1 << (shaft % 64);
        }
    }

    fn get(&self, shaft: usize) -> bool {
        self.0.get(shaft / 64).is_some_and(|word| word >> (shaft % 64) & 1 == 1)
    }

    fn add(&mut self, other: &Shafts) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a |= b);
    }

    fn meets(&self, other: &Shafts) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a & b != 0)
    }
}

/// Sections and their keys, names in capitals. The syntax is the crate `configparser`'s.
struct Ini<'a> {
    file: &'a str,
    sections: HashMap<String, HashMap<String, String>>,
}

impl<'a> Ini<'a> {
    fn read(text: &str, file: &'a str) -> Result<Ini<'a>> {
        let mut syntax = IniDefault::default();
        (syntax.comment_symbols, syntax.delimiters) = (vec![';'], vec!['=']);
        let parsed = configparser::ini::Ini::new_from_defaults(syntax).read(text.trim_start_matches('\u{feff}').into());
        let parsed = parsed.map_err(|what| Error::Format {
            file: line(file),
            what: line(&what),
            hint: "write sections as [NAME] and keys as name=value".into(),
        })?;
        let keys = |keys: HashMap<String, Option<String>>| {
            keys.into_iter().filter_map(|(key, value)| Some((key.to_ascii_uppercase(), value?))).collect()
        };
        let sections = parsed.into_iter().map(|(name, section)| (name.to_ascii_uppercase(), keys(section))).collect();
        let ini = Ini { file, sections };
        if !ini.has("WIF") {
            let hint = "use a Weaving Information File, which begins with the section [WIF]".into();
            return Err(Error::Format { file: line(file), what: "no section [WIF]".into(), hint });
        }
        // A section that is announced must be there.
        for name in ["WEAVING", "WARP", "WEFT", "THREADING", "TIEUP", "TREADLING", "LIFTPLAN"] {
            if ini.text("CONTENTS", name).is_some_and(truth) && !ini.has(name) {
                let hint = format!("the section [{name}] is missing; add it, or write false here");
                return Err(ini.invalid("CONTENTS", name, "true", hint));
            }
        }
        Ok(ini)
    }

    fn has(&self, section: &str) -> bool {
        self.sections.contains_key(section)
    }

    /// The value of a key in capitals; an empty one counts as absent.
    fn text(&self, section: &str, key: &str) -> Option<&str> {
        self.sections.get(section)?.get(key).map(String::as_str).filter(|v| !v.is_empty())
    }

    fn invalid(&self, section: &str, key: &str, value: impl std::fmt::Display, hint: String) -> Error {
        Error::Invalid {
            file: line(self.file),
            key: line(&format!("[{section}] {key}")),
            value: line(&value.to_string()),
            hint,
        }
    }

    fn need(&self, section: &str, key: &str) -> Result<&str> {
        self.text(section, &key.to_ascii_uppercase()).ok_or_else(|| {
            let hint = if self.has(section) {
                format!("give {key} in the section [{section}]")
            } else {
                format!("the section [{section}] is missing; it must give {key}")
            };
            self.invalid(section, key, "(absent)", hint)
        })
    }

    /// A number from 1 to `most`.
    fn count(&self, section: &str, key: &str, most: usize) -> Result<usize> {
        let given = self.need(section, key)?;
        match given.parse() {
            Ok(n) if (1..=most).contains(&n) => Ok(n),
            _ => Err(self.invalid(section, key, given, format!("use a whole number from 1 to {most}"))),
        }
    }

    /// Numbers from 1 to `most`, counted from 0 in what comes back; 0 in the file stands for none.
    fn numbers(&self, section: &str, key: &str, given: &str, most: usize) -> Result<Vec<usize>> {
        let mut list = Vec::new();
        for part in given.split(',').map(str::trim).filter(|p| !p.is_empty()) {
            match part.parse::<usize>() {
                Ok(0) => {}
                Ok(n) if n <= most => list.push(n - 1),
                _ => {
                    let hint = format!("use whole numbers from 1 to {most} with commas between them");
                    return Err(self.invalid(section, key, given, hint));
                }
            }
        }
        Ok(list)
    }

    /// A section with a list of numbers for each of `rows` keys. Keys that are not such numbers are refused, and so are empty rows, for the reason
    /// `empty` unless that is "".
    fn lists(&self, section: &str, rows: usize, most: usize, empty: &str) -> Result<Vec<Vec<usize>>> {
        let Some(keys) = self.sections.get(section) else {
            let hint = format!("the section [{section}] is missing; add it with one line for each of {rows}");
            return Err(self.invalid(section, "1", "(absent)", hint));
        };
        let mut lists = vec![Vec::new(); rows];
        // In the order of the text's keys as sorted, so that the same file gives the same message.
        let mut keys: Vec<(&String, &String)> = keys.iter().collect();
        keys.sort();
        for (key, given) in keys {
            let row = key.parse::<usize>().ok().filter(|n| (1..=rows).contains(n));
            let Some(row) = row else {
                let hint = format!("use keys from 1 to {rows} in this section");
                return Err(self.invalid(section, key, given, hint));
            };
            lists[row - 1] = self.numbers(section, key, given, most)?;
        }
        if !empty.is_empty()
            && let Some(row) = lists.iter().position(Vec::is_empty)
        {
            let key = (row + 1).to_string();
            let given = self.text(section, &key).unwrap_or("(absent)");
            return Err(self.invalid(section, &key, given, format!("{empty}; use numbers from 1 to {most}")));
        }
        Ok(lists)
    }

    /// The section that says what is lifted at each pick.
    fn plan(&self) -> &'static str {
        if self.sections.get("LIFTPLAN").is_some_and(|s| !s.is_empty()) { "LIFTPLAN" } else { "TREADLING" }
    }

    /// Shafts that are up at each pick.
    fn lifted(&self, picks: usize, shafts: usize) -> Result<Vec<Shafts>> {
        if self.plan() == "LIFTPLAN" {
            let plan = self.lists("LIFTPLAN", picks, shafts, "")?;
            return Ok(plan.iter().map(|lifted| gather(lifted.iter().copied(), shafts)).collect());
        }
        if !self.has("TREADLING") && !self.has("TIEUP") {
            let hint = "give either [LIFTPLAN], or [TIEUP] and [TREADLING]; all are missing".into();
            return Err(self.invalid("TREADLING", "1", "(absent)", hint));
        }
        let treadles = self.count("WEAVING", "Treadles", MAX_SHAFTS)?;
        let tieup = self.lists("TIEUP", treadles, shafts, "")?;
        let tieup: Vec<Shafts> = tieup.into_iter().map(|list| gather(list.into_iter(), shafts)).collect();
        let treadling = self.lists("TREADLING", picks, treadles, "a pick without a treadle opens no shed")?;
        let rising = match self.text("WEAVING", "RISING SHED") {
            None => true,
            Some(word) if truth(word) => true,
            Some(word) if lie(word) => false,
            Some(word) => {
                return Err(self.invalid("WEAVING", "Rising Shed", word, "use true or false".into()));
            }
        };
        Ok(treadling
            .iter()
            .map(|pressed| {
                let mut tied = Shafts::none(shafts);
                pressed.iter().for_each(|&t| tied.add(&tieup[t]));
                if rising { tied } else { gather((0..shafts).filter(|&s| !tied.get(s)), shafts) }
            })
            .collect())
    }

    /// Colors of ends and picks; empty for a family of which the file says none.
    fn colors(&self, threads: [usize; 2]) -> Result<[Vec<[f32; 3]>; 2]> {
        let Some(table) = self.sections.get("COLOR TABLE").filter(|t| !t.is_empty()) else {
            return Ok([Vec::new(), Vec::new()]);
        };
        let [low, high] = self.color_range()?;
        let mut colors = HashMap::new();
        let mut keys: Vec<(&String, &String)> = table.iter().collect();
        keys.sort();
        for (key, given) in keys {
            let index = key.parse::<usize>().ok().filter(|n| (1..=MAX_COLORS).contains(n));
            let Some(index) = index else {
                return Err(self.invalid("COLOR TABLE", key, given, format!("use keys from 1 to {MAX_COLORS}")));
            };
            let parts: Vec<i64> = given.split(',').flat_map(|p| p.trim().parse()).collect();
            let [r, g, b] = parts[..] else {
                return Err(self.invalid("COLOR TABLE", key, given, "use three whole numbers r,g,b".into()));
            };
            if [r, g, b].iter().any(|c| !(low..=high).contains(c)) {
                let hint = format!("use numbers from {low} to {high}, the Range of [COLOR PALETTE]");
                return Err(self.invalid("COLOR TABLE", key, given, hint));
            }
            colors.insert(index, [r, g, b].map(|c| ((c - low) as f64 / (high - low) as f64) as f32));
        }
        let mut both = [Vec::new(), Vec::new()];
        for (k, family) in Family::EACH.into_iter().enumerate() {
            let (own, rest) = match family {
                Family::Warp => ("WARP COLORS", "WARP"),
                Family::Weft => ("WEFT COLORS", "WEFT"),
            };
            let first = |section: &str, key: &str, given: &str| {
                let index = given.split(',').next().unwrap_or_default().trim().parse::<usize>().ok();
                index.and_then(|i| colors.get(&i)).copied().ok_or_else(|| {
                    self.invalid(section, key, given, "use the number of a color of [COLOR TABLE]".into())
                })
            };
            let common = self.text(rest, "COLOR").map(|given| first(rest, "Color", given)).transpose()?;
            let mut list = vec![common; threads[k]];
            let mut keys: Vec<(&String, &String)> = self.sections.get(own).into_iter().flatten().collect();
            keys.sort();
            for (key, given) in keys {
                let thread = key.parse::<usize>().ok().filter(|n| (1..=threads[k]).contains(n));
                let Some(thread) = thread else {
                    return Err(self.invalid(own, key, given, format!("use keys from 1 to {}", threads[k])));
                };
                list[thread - 1] = Some(first(own, key, given)?);
            }
            if list.iter().any(Option::is_some) {
                if let Some(thread) = list.iter().position(Option::is_none) {
                    let hint = format!("give every thread a color, or Color in the section [{rest}]");
                    return Err(self.invalid(own, &(thread + 1).to_string(), "(absent)", hint));
                }
                both[k] = list.into_iter().flatten().collect();
            }
        }
        Ok(both)
    }

    /// Least and greatest number of a color.
    fn color_range(&self) -> Result<[i64; 2]> {
        let Some(given) = self.text("COLOR PALETTE", "RANGE") else { return Ok([0, 255]) };
        let parts: Vec<Option<i64>> = given.split(',').map(|p| p.trim().parse().ok()).collect();
        match parts[..] {
            [Some(low), Some(high)] if low >= 0 && low < high && high <= 1 << 24 => Ok([low, high]),
            [Some(high)] if high > 0 && high <= 1 << 24 => Ok([0, high]),
            _ => Err(self.invalid("COLOR PALETTE", "Range", given, "use two whole numbers such as 0,255".into())),
        }
    }
}

fn gather(list: impl Iterator<Item = usize>, shafts: usize) -> Shafts {
    let mut set = Shafts::none(shafts);
    list.for_each(|s| set.set(s));
    set
}

fn truth(word: &str) -> bool {
    ["true", "yes", "on", "1", "t", "y"].iter().any(|w| word.eq_ignore_ascii_case(w))
}

fn lie(word: &str) -> bool {
    ["false", "no", "off", "0", "f", "n"].iter().any(|w| word.eq_ignore_ascii_case(w))
}
