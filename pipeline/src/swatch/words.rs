//! What a user says of a swatch, read and checked.

use super::cloths::SwatchFiber;
use super::inputs::SwatchKnown;
use crate::error::Error;
use plywave_textile::{Count, NamedWeave};

/// Counts that cloths are woven of [tex].
pub(super) const TEX: [f64; 2] = [1.0, 500.0];

/// What the user says of a swatch, with names and counts as text.
#[derive(Clone, Copy, Debug, Default)]
pub struct SwatchWords<'a> {
    /// A fiber of the library.
    pub fiber: Option<&'a str>,
    /// Name of a weave.
    pub weave: Option<&'a str>,
    /// Mass per area [g/m2].
    pub g_per_m2: Option<f64>,
    /// Ends per centimeter.
    pub ends_per_cm: Option<f64>,
    /// Picks per centimeter.
    pub picks_per_cm: Option<f64>,
    /// Count of the yarns with its unit.
    pub count: Option<&'a str>,
}

impl SwatchWords<'_> {
    /// What they mean. `file` and `key` say in errors where a word of this key stood.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for unknown weaves and fibers, and for numbers that no cloth has.
    pub fn known(&self, file: &str, key: &dyn Fn(&str) -> String) -> Result<SwatchKnown, Error> {
        let refuse = |name: &str, value: &str, hint: String| {
            Error::Runtime(plywave::Error::Invalid { file: file.into(), key: key(name), value: value.into(), hint })
        };
        let weave = match self.weave {
            None => None,
            Some(name) => match name.parse::<NamedWeave>() {
                Ok(NamedWeave::Layers) => {
                    return Err(refuse("weave", name, "it is no cloth; give the weave of the swatch".into()));
                }
                Ok(weave) => Some(weave),
                Err(hint) => return Err(refuse("weave", name, hint)),
            },
        };
        let count = |text: &str| -> Result<f64, Error> {
            let count: Count = text.parse().map_err(|hint: String| refuse("count", text, hint))?;
            Ok(count.single_tex * f64::from(count.plies.unwrap_or(1)))
        };
        let known = SwatchKnown {
            fiber: self.fiber.map(String::from),
            weave,
            g_per_m2: self.g_per_m2,
            per_cm: [self.ends_per_cm, self.picks_per_cm],
            tex: self.count.map(count).transpose()?,
        };
        check_known(&known, file, key)?;
        Ok(known)
    }
}

/// Checks numbers and fiber.
pub(super) fn check_known(known: &SwatchKnown, file: &str, key: &dyn Fn(&str) -> String) -> Result<(), Error> {
    let number = |name: &str, value: Option<f64>, [low, high]: [f64; 2], unit: &str| match value {
        Some(v) if !(low..=high).contains(&v) => Err(Error::Runtime(plywave::Error::Invalid {
            file: file.into(),
            key: key(name),
            value: v.to_string(),
            hint: format!("no cloth has that; give {low} to {high} {unit}"),
        })),
        _ => Ok(()),
    };
    number("g_per_m2", known.g_per_m2, [5.0, 2000.0], "g/m2")?;
    number("ends_per_cm", known.per_cm[0], [1.0, 300.0], "ends per cm")?;
    number("picks_per_cm", known.per_cm[1], [1.0, 300.0], "picks per cm")?;
    number("count", known.tex, TEX, "tex")?;
    let Some(fiber) = &known.fiber else { return Ok(()) };
    SwatchFiber::new(fiber).map(|_| ()).map_err(|error| match error {
        Error::Runtime(plywave::Error::Invalid { value, hint, .. }) => {
            Error::Runtime(plywave::Error::Invalid { file: file.into(), key: key("fiber"), value, hint })
        }
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_knowledge_is_refused() {
        let flag = |key: &str| format!("--{}", key.replace('_', "-"));
        let refused = |words: SwatchWords<'_>| words.known("command line", &flag).unwrap_err().to_string();
        let heavy = SwatchWords { g_per_m2: Some(1e4), ..SwatchWords::default() };
        assert_eq!(refused(heavy), "command line: --g-per-m2 = 10000: no cloth has that; give 5 to 2000 g/m2");
        let fiber = |name| SwatchWords { fiber: Some(name), ..SwatchWords::default() };
        assert!(refused(fiber("unobtainium")).contains("unobtainium"));
        assert!(refused(fiber("gold")).contains("a metal has no absorption to fit"));
        assert!(refused(SwatchWords { weave: Some("layers"), ..SwatchWords::default() }).contains("it is no cloth"));
        assert!(refused(SwatchWords { weave: Some("tweed"), ..SwatchWords::default() }).contains("--weave = tweed"));
        assert!(refused(SwatchWords { count: Some("7 cats"), ..SwatchWords::default() }).contains("--count = 7 cats"));
        let twofold = SwatchWords { count: Some("20 tex"), ..fiber("cotton") };
        assert_eq!(twofold.known("", &flag).unwrap().tex, Some(20.0));
    }
}
