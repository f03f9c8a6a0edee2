//! Linear densities of yarns as written on labels, and the cross sections that follow from them.

use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

/// Unit of a linear density. Indirect units are lengths per mass: a larger number is a finer yarn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    Tex,
    Dtex,
    Denier,
    /// English cotton count: hanks of 840 yards per pound.
    Cotton,
    /// Kilometers per kilogram.
    Metric,
    /// Hanks of 560 yards per pound.
    Worsted,
    /// Leas of 300 yards per pound, of linen.
    Lea,
}

/// Units with the words that stand for them.
const UNITS: &[(Unit, &str, &[&str])] = &[
    (Unit::Tex, "tex", &[]),
    (Unit::Dtex, "dtex", &[]),
    (Unit::Denier, "den", &["denier", "d"]),
    (Unit::Cotton, "Ne", &["nec", "cc"]),
    (Unit::Metric, "Nm", &[]),
    (Unit::Worsted, "worsted", &["new", "nw"]),
    (Unit::Lea, "lea", &["nel"]),
];

/// Tex of a yarn of which 840 yards weigh one pound: 453.59237 g over 768.096 m.
const TEX_OF_NE_1: f64 = 453.59237 / 0.768096;
/// Linear densities that a count may have [tex].
const TEX: std::ops::RangeInclusive<f64> = 0.05..=2e4;

/// Linear density of a yarn as on its label: that of a single, and how many singles are plied. `75/36 den`
/// has 36 filaments, `60/2 Nm` two singles of Nm 60, `20 tex x 2` two singles of 20 tex.
#[derive(Clone, Debug, PartialEq)]
pub struct Count {
    /// The text of the label.
    pub text: String,
    /// Linear density of a single [tex, g/km].
    pub single_tex: f64,
    /// Number of singles, if the label has it.
    pub plies: Option<u32>,
    /// Number of filaments in a single, if the label has it.
    pub filaments: Option<u32>,
}

impl Unit {
    fn tex(self, number: f64) -> f64 {
        match self {
            Unit::Tex => number,
            Unit::Dtex => number / 10.0,
            Unit::Denier => number / 9.0,
            Unit::Cotton => TEX_OF_NE_1 / number,
            Unit::Metric => 1000.0 / number,
            Unit::Worsted => TEX_OF_NE_1 * 840.0 / 560.0 / number,
            Unit::Lea => TEX_OF_NE_1 * 840.0 / 300.0 / number,
        }
    }

    fn is_direct(self) -> bool {
        matches!(self, Unit::Tex | Unit::Dtex | Unit::Denier)
    }
}

impl FromStr for Count {
    type Err = String;

    /// Parses a count. The error tells what to write, as the end of a message.
    fn from_str(text: &str) -> Result<Count, String> {
        const FORMS: &str =
            "write a number with its unit, such as \"Ne 40\", \"Nm 60/2\", \"20 tex x 2\" or \"75/36 den\"";
        // Numbers and units need no space between them, as in 75den.
        let mut words: Vec<String> = Vec::new();
        let kind = |c: char| {
            if c.is_ascii_digit() || matches!(c, '.' | '/') {
                0
            } else if c.is_alphabetic() {
                1
            } else {
                2
            }
        };
        let mut last = 2;
        if text.contains(|c: char| !(c.is_alphanumeric() || c.is_whitespace() || matches!(c, '.' | '/'))) {
            return Err(FORMS.into());
        }
        for c in text.trim().chars() {
            let kind = kind(c);
            match kind {
                2 => {}
                _ if kind == last => words.last_mut().into_iter().for_each(|word| word.push(c)),
                _ => words.push(c.to_string()),
            }
            last = kind;
        }
        let (mut unit, mut number, mut second, mut plies, mut filaments) = (None, None, None, None, None);
        let mut words = words.iter().map(|word| word.to_lowercase()).peekable();
        while let Some(word) = words.next() {
            if word == "/" {
                continue;
            }
            let whole = |next: Option<String>| next.and_then(|n| n.parse::<u32>().ok()).filter(|n| *n >= 1);
            if word == "x" && plies.is_none() {
                plies = Some(whole(words.next()).ok_or("write the number of plies after x, such as \"20 tex x 2\"")?);
            } else if (word == "f" || word == "fil" || word == "filaments") && filaments.is_none() {
                let before = (second.is_some() && unit.is_some()).then(|| second.take()).flatten();
                let next = words.peek().and_then(|n| n.parse::<u32>().ok());
                filaments = Some(match (next, before) {
                    (Some(n), _) => {
                        words.next();
                        n
                    }
                    (None, Some(n)) => n,
                    (None, None) => {
                        return Err("write the number of filaments after f, such as \"83 dtex f 36\"".into());
                    }
                });
            } else if let Some((known, ..)) =
                UNITS.iter().find(|(_, name, others)| name.to_lowercase() == word || others.contains(&&*word))
            {
                if unit.replace(*known).is_some() {
                    return Err(format!("two units; {FORMS}"));
                }
            } else if word.starts_with(|c: char| c.is_ascii_digit()) && number.is_none() {
                let (first, rest) = word.split_once('/').map_or((&*word, None), |(a, b)| (a, Some(b)));
                number = Some(first.parse::<f64>().ok().filter(|n| *n > 0.0).ok_or(FORMS)?);
                second = match rest {
                    Some(rest) => Some(rest.parse::<u32>().ok().filter(|n| *n >= 1).ok_or(FORMS)?),
                    None => None,
                };
            } else if word.starts_with(|c: char| c.is_ascii_digit()) {
                second = Some(word.parse::<u32>().ok().filter(|n| *n >= 1 && second.is_none()).ok_or(FORMS)?);
            } else {
                let names: Vec<&str> = UNITS.iter().map(|(_, name, _)| *name).collect();
                return Err(format!("{word} is no unit of counts; use one of {}", names.join(", ")));
            }
        }
        let (unit, number) = unit.zip(number).ok_or(FORMS)?;
        // A number after the stroke counts filaments of a direct unit, and singles of an indirect one.
        match (second, unit.is_direct()) {
            (Some(n), true) if filaments.is_none() => filaments = Some(n),
            (Some(n), false) if plies.is_none() => plies = Some(n),
            (Some(_), _) => return Err(format!("a number too many; {FORMS}")),
            (None, _) => {}
        }
        let single_tex = unit.tex(number);
        if !TEX.contains(&single_tex) {
            return Err(format!("that is {single_tex:.3e} tex; yarns have {} to {}", TEX.start(), TEX.end()));
        }
        if plies.is_some_and(|n| n > 7) || filaments.is_some_and(|n| n > 3800) {
            return Err("use up to 7 plies, and up to 3800 filaments".into());
        }
        Ok(Count { text: text.trim().into(), single_tex, plies, filaments })
    }
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Area of the fibers in a yarn's cross section [um2], from its linear density [g/km] and the fibers'
/// density.
pub(crate) fn fiber_area_um2(tex: f64, density_g_per_cm3: f64) -> f64 {
    1000.0 * tex / density_g_per_cm3
}

/// Radius of a round yarn [um] whose cross section is filled with fibers to the share `packing`.
pub(crate) fn round_radius_um(fiber_area_um2: f64, packing: f64) -> f64 {
    (fiber_area_um2 / (packing * PI)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> (f64, Option<u32>, Option<u32>) {
        let count: Count = text.parse().unwrap_or_else(|e| panic!("{text}: {e}"));
        (count.single_tex, count.plies, count.filaments)
    }

    /// Conversion factors of ISO 1144 and ISO 2947: 1 tex is 9 den, Ne 590.5, Nm 1000, worsted 885.8, lea
    /// 1653.
    #[test]
    fn units_agree() {
        for (text, tex, plies, filaments) in [
            ("75/36 den", 8.333, None, Some(36)),
            ("75den", 8.333, None, None),
            ("75D / 36F", 8.333, None, Some(36)),
            ("83.33 dtex f 36", 8.333, None, Some(36)),
            ("Ne 7", 84.36, None, None),
            ("7 ne", 84.36, None, None),
            ("Ne 30/2", 19.68, Some(2), None),
            ("Nm 60/2", 16.667, Some(2), None),
            ("2.81 tex f49", 2.81, None, Some(49)),
            ("20 tex x 2", 20.0, Some(2), None),
            ("worsted 40/2", 22.14, Some(2), None),
            ("40 lea", 41.34, None, None),
        ] {
            let got = of(text);
            assert!((got.0 / tex - 1.0).abs() < 3e-4, "{text}: {got:?}");
            assert_eq!((got.1, got.2), (plies, filaments), "{text}");
        }
    }

    #[test]
    fn texts_that_are_no_counts_are_refused() {
        for (text, want) in [
            ("", "write a number with its unit"),
            ("40", "write a number with its unit"),
            ("Ne", "write a number with its unit"),
            ("Ne -40", "write a number with its unit"),
            ("40 nn", "nn is no unit of counts; use one of tex"),
            ("Ne 40 tex", "two units"),
            ("Ne 40/2/3", "write a number"),
            ("Nm 0", "write a number"),
            ("20 tex x", "number of plies after x"),
            ("1e9 tex", "is no unit"),
            ("900000 tex", "that is 9.000e5 tex"),
            ("Nm 60/40", "use up to 7 plies"),
        ] {
            let got = text.parse::<Count>();
            let got = got.expect_err(text);
            assert!(got.contains(want), "{text}: {got}");
        }
    }

    /// Peirce 1937: the diameter of a cotton yarn of specific volume 1.1 cm3/g is 37.4 sqrt(tex) um.
    #[test]
    fn widths_are_those_of_peirce() {
        let density = 1.52;
        let packing = 1.0 / 1.1 / density;
        let width = 2.0 * round_radius_um(fiber_area_um2(30.0, density), packing);
        assert!((width / (37.4 * 30f64.sqrt()) - 1.0).abs() < 1e-3, "{width}");
    }
}
