//! Colors of the yarns of a WIF: a table of red, green and blue, the color of each yarn by its number, and
//! one for those without.

use super::super::names::numbered;
use super::note::{Notes, WifNoteKind};
use super::text::{Ini, numbers};
use super::{colors_of, section_of, words};
use crate::Result;
use crate::cloth::YarnSet;
use std::collections::BTreeMap;

/// Color of each of the yarns `kept`, counted from 0, of `threads` of warp and weft [sRGB, 0 to 1]; empty for
/// a family of which the file says none.
pub(super) fn colors(
    ini: &Ini<'_>,
    threads: [usize; 2],
    kept: &[Vec<usize>; 2],
    notes: &mut Notes,
) -> Result<[Vec<[f32; 3]>; 2]> {
    let palette = Palette::read(ini, notes)?;
    let mut both = [Vec::new(), Vec::new()];
    for (k, family) in YarnSet::EACH.into_iter().enumerate() {
        let (own, rest) = (colors_of(family), section_of(family));
        let given = ini.rows(own, notes)?.fit(threads[k], notes);
        // A number of the table, and red, green and blue for programs that have no table.
        let common = ini.text(rest, "Color").map(|given| number_of(ini, rest, given)).transpose()?.unwrap_or_default();
        let usual = palette.find(&common);
        let is_named = |list: &[u64]| list.first().is_some_and(|n| *n != 0);
        if !(usual.is_some() || is_named(&common) || given.iter().any(|list| is_named(list))) {
            continue;
        }
        let Some(first) = palette.colors.values().next().copied().or(usual) else { continue };
        let (mut unknown, mut none) = (Vec::new(), Vec::new());
        both[k] = Vec::with_capacity(kept[k].len());
        for &at in &kept[k] {
            let list = &given[at];
            let own = palette.find(list);
            match (is_named(list), own, usual) {
                (true, None, _) => unknown.push(at + 1),
                (false, None, None) => none.push(at + 1),
                _ => {}
            }
            both[k].push(own.or(usual).unwrap_or(first));
        }
        let (rest, words) = (rest.to_string(), words(family));
        let taken = if usual.is_some() { format!("Color of [{rest}]") } else { "first color of [COLOR TABLE]".into() };
        if usual.is_none() && is_named(&common) {
            notes.add(WifNoteKind::Colors, format!("[{rest}] Color = {} is not in [COLOR TABLE]", common[0]));
        }
        if !unknown.is_empty() {
            let which = numbered(words, &unknown);
            notes.add(WifNoteKind::Colors, format!("[COLOR TABLE] lacks the color of {which}: the {taken} is taken"));
        }
        if !none.is_empty() {
            notes.add(WifNoteKind::Colors, format!("{} without color: the {taken} is taken", numbered(words, &none)));
        }
    }
    Ok(both)
}

fn number_of(ini: &Ini<'_>, section: &str, given: &str) -> Result<Vec<u64>> {
    let hint = || "use the number of a color of [COLOR TABLE]".into();
    numbers(given).ok_or_else(|| ini.invalid(section, "Color", given, hint()))
}

/// The table's colors by number, and the range of their numbers.
struct Palette {
    colors: BTreeMap<u64, [f32; 3]>,
    range: [u64; 2],
}

impl Palette {
    fn read(ini: &Ini<'_>, notes: &mut Notes) -> Result<Palette> {
        let table = ini.rows("COLOR TABLE", notes)?;
        if let Some((number, _)) = table.lines.iter().find(|(_, list)| list.len() < 3) {
            let key = number.to_string();
            let given = ini.text(table.section, &key).unwrap_or_default();
            return Err(ini.invalid(table.section, &key, given, "use three whole numbers r,g,b".into()));
        }
        let given = ini.text("COLOR PALETTE", "Range");
        let said = match given.and_then(numbers).as_deref() {
            Some([low, high]) if low < high => Ok([*low, *high]),
            Some([high]) if *high > 0 => Ok([0, *high]),
            Some([high, low]) if low < high => Err([*low, *high]),
            _ => Err([0, 255]),
        };
        let [low, high] = said.unwrap_or_else(|usual| usual);
        let values = || table.lines.values().flat_map(|list| &list[..3]).copied();
        let range = [values().fold(low, u64::min), values().fold(high, u64::max)];
        if !table.lines.is_empty() && (said.is_err() || range != [low, high]) {
            let given = given.map_or("(absent)".into(), crate::spec::rules::line);
            let finding =
                format!("[COLOR PALETTE] Range = {given}: colors are taken to go from {} to {}", range[0], range[1]);
            notes.add(WifNoteKind::ColorRange, finding);
        }
        let last = table.lines.keys().next_back().copied().unwrap_or(0);
        if let Some(entries) =
            ini.text("COLOR PALETTE", "Entries").and_then(numbers).and_then(|list| list.first().copied())
            && last as u64 > entries
        {
            let finding =
                format!("[COLOR PALETTE] Entries = {entries}, but [COLOR TABLE] has a color {last}: all are read");
            notes.add(WifNoteKind::Colors, finding);
        }
        let mut palette = Palette { colors: BTreeMap::new(), range };
        palette.colors = table.lines.iter().map(|(n, list)| (*n as u64, palette.srgb(&list[..3]))).collect();
        Ok(palette)
    }

    /// The color of a yarn's line: a number of the table, with red, green and blue beside it for programs
    /// that have no table.
    fn find(&self, list: &[u64]) -> Option<[f32; 3]> {
        let number = list.first()?;
        self.colors.get(number).copied().or_else(|| (list.len() == 4).then(|| self.srgb(&list[1..])))
    }

    fn srgb(&self, rgb: &[u64]) -> [f32; 3] {
        let [low, high] = self.range.map(|v| v as f64);
        std::array::from_fn(|k| ((rgb[k] as f64 - low) / (high - low)).clamp(0.0, 1.0) as f32)
    }
}
