//! Distances between yarns in a WIF: `Spacing` or else `Thickness`, for all yarns of a set or for each.

use super::note::Notes;
use super::section_of;
use super::text::{Ini, real};
use crate::weave::draft::YarnSet;

/// Distance between yarns from a WIF, for cloth specs without one.
#[derive(Clone, Debug, PartialEq)]
pub struct WifSpacing {
    /// The distance, or its mean if it varies [um].
    pub um: f64,
    /// Its place in the file, such as "[WARP] Spacing = 0.05 inches".
    pub source: String,
}

/// Prefix of a unit of length in the file, name of the unit, and its size [um]: those of WIF, and others that
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

/// The distance between the yarns of a set, of which those in `retained` (indices from 0) are woven. Spacing
/// takes precedence over thickness (WIF 1.1, "Spacing and Thickness Values").
pub(crate) fn spacing(ini: &Ini<'_>, family: YarnSet, retained: &[usize], notes: &mut Notes) -> Option<WifSpacing> {
    let section = section_of(family);
    let [of_spacing, of_thickness] = match family {
        YarnSet::Warp => ["WARP SPACING", "WARP THICKNESS"],
        YarnSet::Weft => ["WEFT SPACING", "WEFT THICKNESS"],
    };
    let units = ini.text(section, "Units").map(str::to_ascii_uppercase);
    let known = units.as_ref().and_then(|units| UNITS.iter().find(|(start, ..)| units.starts_with(start)));
    let (unit, um) = known.map_or(("centimeters", 1e4), |(_, name, um)| (*name, *um));
    for (key, own) in [("Spacing", of_spacing), ("Thickness", of_thickness)] {
        let common = ini.text(section, key).and_then(real);
        let each = ini.reals(own, notes);
        let values: Vec<f64> = retained.iter().filter_map(|at| each.get(&(at + 1)).copied().or(common)).collect();
        if values.is_empty() {
            continue;
        }
        let (min, max) = values.iter().fold((f64::MAX, 0.0), |(a, b): (f64, f64), v| (a.min(*v), b.max(*v)));
        let sum: f64 = values.iter().sum();
        let mean = if min == max { min } else { sum / values.len() as f64 };
        let mut source = match (min == max, common) {
            (true, Some(value)) if value == min => format!("[{section}] {key} = {min} {unit}"),
            (true, _) => format!("[{own}], {min} {unit}"),
            (false, _) => format!("the mean of [{own}], {min} to {max} {unit}"),
        };
        if known.is_none() {
            source += match units {
                None => " (no Units)",
                Some(_) => " (unknown Units)",
            };
        }
        return Some(WifSpacing { um: um * mean, source });
    }
    None
}
