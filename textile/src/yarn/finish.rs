//! Ways of spinning and finishing by name: how even a yarn is, and its hairs.
//!
//! Evenness is the coefficient of variation of the count as spinners measure it: 19.4 % for an upland cotton
//! yarn (D. E. Akin, "Linen Most Useful", ISRN Biotechnology 2013, table 9); the other numbers are chosen
//! between it and the even yarn. The lengths are about those of the fibers.

use crate::yarn::hairs::Hairs;
use plywave::cloth::Unevenness;

/// What a finish decides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Finish {
    pub unevenness: Option<Unevenness>,
    pub hairs: Option<Hairs>,
}

const fn uneven(count_cv: f64, spacing_cv: f64, length_mm: f64) -> Option<Unevenness> {
    Some(Unevenness { count_cv, spacing_cv, length_mm })
}

const NONE: Finish = Finish { unevenness: None, hairs: None };
const fn spun(count_cv: f64, spacing_cv: f64, length_mm: f64) -> Finish {
    Finish { unevenness: uneven(count_cv, spacing_cv, length_mm), ..NONE }
}
const fn hairy(per_mm: f64, length_mm: f64, curl_mm: f64, rise: f64, loops: f64) -> Finish {
    Finish { hairs: Some(Hairs { per_mm, length_mm, curl_mm, rise, loops }), ..NONE }
}

/// Finishes by name.
const FINISHES: &[(&str, Finish)] = &[
    ("carded", spun(0.18, 0.04, 20.0)),
    ("combed", spun(0.14, 0.03, 20.0)),
    ("worsted", spun(0.13, 0.03, 40.0)),
    ("wet-spun", spun(0.28, 0.05, 15.0)),
    ("raised", hairy(10.0, 1.0, 0.4, 0.6, 0.1)),
    ("milled", hairy(16.0, 1.2, 0.5, 0.5, 0.3)),
];

impl Finish {
    /// Reads finishes separated by commas. The error tells what to write.
    pub fn parse(text: &str) -> Result<Finish, String> {
        let mut all = Finish::default();
        for word in text.split(',').map(|word| word.trim().to_lowercase()) {
            let Some((_, finish)) = FINISHES.iter().find(|(name, _)| *name == word) else {
                let names: Vec<&str> = FINISHES.iter().map(|(name, _)| *name).collect();
                return Err(format!("{word:?} is no finish; use one of {}, or two with a comma", names.join(", ")));
            };
            let is_twice = (all.unevenness.is_some() && finish.unevenness.is_some())
                || (all.hairs.is_some() && finish.hairs.is_some());
            if is_twice {
                return Err(format!(
                    "{word} beside another of its kind; give one way of spinning and one of finishing"
                ));
            }
            all = Finish { unevenness: all.unevenness.or(finish.unevenness), hairs: all.hairs.or(finish.hairs) };
        }
        Ok(all)
    }
}
