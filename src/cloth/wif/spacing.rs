//! Distances between yarns in a WIF: `Spacing`, else `Thickness`, of all yarns of a family or of each.

use super::note::Notes;
use super::section_of;
use super::text::{Ini, real};
use crate::cloth::YarnSet;

/// Distance from yarn to yarn that a WIF gives, for cloth specs that give none.
#[derive(Clone, Debug, PartialEq)]
pub struct WifSpacing {
    /// The distance, the mean where it varies [um].
    pub um: f64,
    /// Where it stands in the file and as what, such as "[WARP] Spacing = 0.05 inches".
    pub source: String,
}

/// Units of length in um, and the name of one, which the units of a file begin with: WIF's own, and what else
/// programs write.
const UNITS: [(&str, &str, f64); 7] = [
    ("DECIPOINT", "decipoints", 25_400.0 / 720.0),
    ("INCH", "inches", 25_400.0),
    ("IN", "inches", 25_400.0),
    ("CENTI", "centimeters", 1e4),
    ("CM", "centimeters", 1e4),
    ("MILLI", "millimeters", 1e3),
    ("MM", "millimeters", 1e3),
];

/// The distance of a family's yarns, of which `kept`, counted from 0, are woven. A program that has one of
/// spacing and thickness takes the spacing (WIF 1.1, "Spacing and Thickness Values").
pub(super) fn spacing(ini: &Ini<'_>, family: YarnSet, kept: &[usize], notes: &mut Notes) -> Option<WifSpacing> {
    let section = section_of(family);
    let [of_spacing, of_thickness] = match family {
        YarnSet::Warp => ["WARP SPACING", "WARP THICKNESS"],
        YarnSet::Weft => ["WEFT SPACING", "WEFT THICKNESS"],
    };
    let given = ini.text(section, "Units").map(str::to_ascii_uppercase);
    let known = given.as_ref().and_then(|given| UNITS.iter().find(|(start, ..)| given.starts_with(start)));
    let (unit, um) = known.map_or(("centimeters", 1e4), |(_, name, um)| (*name, *um));
    for (key, own) in [("Spacing", of_spacing), ("Thickness", of_thickness)] {
        let common = ini.text(section, key).and_then(real);
        let each = ini.reals(own, notes);
        let values: Vec<f64> = kept.iter().filter_map(|at| each.get(&(at + 1)).copied().or(common)).collect();
        if values.is_empty() {
            continue;
        }
        let (least, greatest) = values.iter().fold((f64::MAX, 0.0), |(a, b): (f64, f64), v| (a.min(*v), b.max(*v)));
        let sum: f64 = values.iter().sum();
        let mean = if least == greatest { least } else { sum / values.len() as f64 };
        let mut source = match (least == greatest, common) {
            (true, Some(value)) if value == least => format!("[{section}] {key} = {least} {unit}"),
            (true, _) => format!("[{own}], {least} {unit}"),
            (false, _) => format!("the mean of [{own}], {least} to {greatest} {unit}"),
        };
        if known.is_none() {
            source += match given {
                None => " (no Units)",
                Some(_) => " (unknown Units)",
            };
        }
        return Some(WifSpacing { um: um * mean, source });
    }
    None
}
