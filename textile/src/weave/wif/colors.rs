//! Colors of the yarns of a WIF: a table of red, green and blue, the color of each yarn by its number, and a
//! default for yarns without a color.

use super::note::{Notes, WifNoteKind};
use super::text::{Ini, numbers};
use super::{colors_of, section_of, words};
use crate::weave::draft::YarnSet;
use crate::weave::names::numbered;
use plywave::Result;
use std::collections::BTreeMap;

/// Color of each yarn in `retained` (indices from 0), where warp and weft have `threads` yarns [sRGB, 0 to
/// 1]; empty for a set of yarns without colors in the file.
pub(crate) fn colors(
    ini: &Ini<'_>,
    threads: [usize; 2],
    retained: &[Vec<usize>; 2],
    notes: &mut Notes,
) -> Result<[Vec<[f32; 3]>; 2]> {
    let palette = Palette::read(ini, notes)?;
    let mut both = [Vec::new(), Vec::new()];
    for (k, family) in YarnSet::EACH.into_iter().enumerate() {
        let (own, rest) = (colors_of(family), section_of(family));
        let lists = ini.rows(own, notes)?.fit(threads[k], notes);
        // The default is a number of the table, followed by red, green and blue for programs without a table.
        let common = ini.text(rest, "Color").map(|value| number_of(ini, rest, value)).transpose()?.unwrap_or_default();
        let usual = palette.find(&common);
        let is_named = |list: &[u64]| list.first().is_some_and(|n| *n != 0);
        if !(usual.is_some() || is_named(&common) || lists.iter().any(|list| is_named(list))) {
            continue;
        }
        let Some(first) = palette.colors.values().next().copied().or(usual) else { continue };
        let (mut unknown, mut none) = (Vec::new(), Vec::new());
        both[k] = Vec::with_capacity(retained[k].len());
        for &at in &retained[k] {
            let list = &lists[at];
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

fn number_of(ini: &Ini<'_>, section: &str, value: &str) -> Result<Vec<u64>> {
    let hint = || "use the number of a color of [COLOR TABLE]".into();
    numbers(value).ok_or_else(|| ini.invalid(section, "Color", value, hint()))
}

/// The table's colors by number, and the range of their values.
struct Palette {
    colors: BTreeMap<u64, [f32; 3]>,
    range: [u64; 2],
}

impl Palette {
    fn read(ini: &Ini<'_>, notes: &mut Notes) -> Result<Palette> {
        let table = ini.rows("COLOR TABLE", notes)?;
        if let Some((number, _)) = table.lines.iter().find(|(_, list)| list.len() < 3) {
            let key = number.to_string();
            let value = ini.text(table.section, &key).unwrap_or_default();
            return Err(ini.invalid(table.section, &key, value, "use three whole numbers r,g,b".into()));
        }
        let value = ini.text("COLOR PALETTE", "Range");
        let declared = match value.and_then(numbers).as_deref() {
            Some([low, high]) if low < high => Ok([*low, *high]),
            Some([high]) if *high > 0 => Ok([0, *high]),
            Some([high, low]) if low < high => Err([*low, *high]),
            _ => Err([0, 255]),
        };
        let [low, high] = declared.unwrap_or_else(|usual| usual);
        let values = || table.lines.values().flat_map(|list| &list[..3]).copied();
        let range = [values().fold(low, u64::min), values().fold(high, u64::max)];
        if !table.lines.is_empty() && (declared.is_err() || range != [low, high]) {
            let value = value.map_or("(absent)".into(), plywave::spec::rules::line);
            let finding =
                format!("[COLOR PALETTE] Range = {value}: colors are taken to go from {} to {}", range[0], range[1]);
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

    /// The color in a yarn's line: a number of the table, which red, green and blue may follow for programs
    /// without a table.
    fn find(&self, list: &[u64]) -> Option<[f32; 3]> {
        let number = list.first()?;
        self.colors.get(number).copied().or_else(|| (list.len() == 4).then(|| self.srgb(&list[1..])))
    }

    fn srgb(&self, rgb: &[u64]) -> [f32; 3] {
        let [low, high] = self.range.map(|v| v as f64);
        std::array::from_fn(|k| ((rgb[k] as f64 - low) / (high - low)).clamp(0.0, 1.0) as f32)
    }
}
