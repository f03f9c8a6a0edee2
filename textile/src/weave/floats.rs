//! Floats: stretches of a yarn between two bindings, on which it passes over, or under, several yarns of the
//! other set. Long floats snag; their length decides whether a draft can be used.

use crate::{Draft, YarnSet};
use plywave::{Error, Result};

/// Longest float of a cloth that is accepted [mm]. Chosen: upholstery and table damasks stay below 5 mm, and
/// a float of 10 mm catches on a finger.
pub const MAX_FLOAT_MM: f64 = 10.0;

/// A stretch of a yarn on one side of the cloth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Float {
    /// Set of the yarn.
    pub set: YarnSet,
    /// Index of the yarn in the repeat.
    pub thread: usize,
    /// Index of the first yarn of the other set that it passes; the float may go on into the next repeat.
    pub from: usize,
    /// Number of yarns that it passes; of an endless float, those of one repeat.
    pub length: usize,
    /// Whether it lies on the face; otherwise it lies on the back.
    pub on_face: bool,
    /// Whether nothing binds the yarn, so that the float has no end.
    pub is_endless: bool,
}

impl Float {
    /// Length [mm], with the spacings of ends and of picks [um]; infinite for an endless float.
    pub fn length_mm(&self, spacing_um: [f64; 2]) -> f64 {
        match self.is_endless {
            true => f64::INFINITY,
            false => self.length as f64 * spacing_um[self.set.other() as usize] * 1e-3,
        }
    }
}

/// The runs of equal values around a cycle of `count` values, as (start, length, value); one run of `count`
/// if all are equal.
pub(crate) fn runs(count: usize, value: impl Fn(usize) -> bool) -> Vec<(usize, usize, bool)> {
    let Some(first) = (0..count).find(|&at| value(at) != value((at + count - 1) % count)) else {
        return if count == 0 { Vec::new() } else { vec![(0, count, value(0))] };
    };
    let mut found: Vec<(usize, usize, bool)> = Vec::new();
    for step in 0..count {
        let at = (first + step) % count;
        match found.last_mut() {
            Some((_, length, last)) if *last == value(at) => *length += 1,
            _ => found.push((at, 1, value(at))),
        }
    }
    found
}

/// The longest float of the ends and that of the picks, on either side; the first one of several. An endless
/// float is longer than all others.
pub fn longest_floats(draft: &Draft) -> [Float; 2] {
    YarnSet::EACH.map(|set| {
        let across = draft.threads(set.other());
        let is_on_face = |thread: usize, at: usize| match set {
            YarnSet::Warp => draft.up(at, thread),
            YarnSet::Weft => !draft.up(thread, at),
        };
        let mut longest = Float { set, thread: 0, from: 0, length: 0, on_face: true, is_endless: false };
        for thread in 0..draft.threads(set) {
            for (from, length, on_face) in runs(across, |at| is_on_face(thread, at)) {
                let is_endless = length == across;
                if (is_endless, length) > (longest.is_endless, longest.length) {
                    longest = Float { set, thread, from, length, on_face, is_endless };
                }
            }
        }
        longest
    })
}

/// Checks that no float of a draft is longer than [`MAX_FLOAT_MM`], with the spacings of ends and of picks
/// [um]. [`Draft::layers`], which binds no yarn on purpose, passes.
///
/// # Errors
/// [`Error::Invalid`] for `key` of `file`, with the number of the yarn, from 1, and the length of its float.
pub fn check_floats(file: &str, key: &str, draft: &Draft, spacing_um: [f64; 2]) -> Result<()> {
    if *draft == Draft::layers() {
        return Ok(());
    }
    for float in longest_floats(draft) {
        let length_mm = float.length_mm(spacing_um);
        // A yarn that is bound by each other yarn does not float, however far apart these are.
        if length_mm <= MAX_FLOAT_MM || (float.length == 1 && !float.is_endless) {
            continue;
        }
        let [yarn, across, density] = match float.set {
            YarnSet::Warp => ["end", "picks", "weave.picks_per_cm"],
            YarnSet::Weft => ["pick", "ends", "weave.ends_per_cm"],
        };
        let side = if float.on_face { "face" } else { "back" };
        let thread = float.thread + 1;
        let (value, hint) = match float.is_endless {
            true => (
                format!("{yarn} {thread} lies on the {side} of all {across}"),
                format!("bind it with at least one of the {across}"),
            ),
            false => {
                let most = (MAX_FLOAT_MM * 1e3 / spacing_um[float.set.other() as usize]).floor().max(1.0);
                let value = format!(
                    "{yarn} {thread} floats over {} {across} on the {side}, from number {}: {length_mm:.1} mm",
                    float.length,
                    float.from + 1
                );
                let hint = format!(
                    "use {most} or fewer ({MAX_FLOAT_MM} mm): bind it by max_float, a weave of shorter floats or a larger \
                     {density}"
                );
                (value, hint)
            }
        };
        return Err(Error::Invalid { file: file.into(), key: key.into(), value, hint });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NamedWeave;
    use proptest::prelude::*;

    fn named(name: &str) -> Draft {
        name.parse::<NamedWeave>().unwrap().draft()
    }

    #[test]
    fn named_weaves_have_the_floats_of_the_books() {
        for (name, warp, weft) in [
            ("plain", 1, 1),
            ("twill 2/2", 2, 2),
            ("twill 3/1", 3, 3),
            ("satin 5/2", 4, 4),
            ("satin 8/3 weft", 7, 7),
            ("hopsack 3/2", 2, 3),
            ("rib 3/1", 3, 1),
            ("twill 5/1/2/3", 5, 5),
        ] {
            let floats = longest_floats(&named(name));
            assert_eq!(floats.map(|f| f.length), [warp, weft], "{name}");
            assert_eq!(floats.map(|f| f.set), YarnSet::EACH, "{name}");
            assert!(floats.iter().all(|f| !f.is_endless), "{name}");
        }
        // The satin's ends float on its face, the picks on its back.
        assert_eq!(longest_floats(&named("satin 5/2")).map(|f| f.on_face), [true, false]);
        assert_eq!(longest_floats(&Draft::layers()).map(|f| f.is_endless), [true, true]);
        // End 1 is bound and end 2 is not: the endless float counts although the other is as long.
        let draft = Draft::from_fn(3, 2, |pick, end| end == 1 || pick == 0).unwrap();
        let [warp, _] = longest_floats(&draft);
        assert!(warp.is_endless && warp.thread == 1 && warp.length_mm([1.0; 2]).is_infinite());
    }

    #[test]
    fn long_floats_are_refused_with_their_place() {
        let draft = named("satin 16/7");
        // 15 ends of 500 um are 7.5 mm, of 700 um 10.5 mm.
        assert!(check_floats("a.toml", "weave", &draft, [500.0, 500.0]).is_ok());
        let error = check_floats("a.toml", "weave", &draft, [700.0, 500.0]).unwrap_err().to_string();
        assert_eq!(
            error,
            "a.toml: weave = pick 1 floats over 15 ends on the back, from number 2: 10.5 mm: use 14 or fewer (10 mm): \
             bind it by max_float, a weave of shorter floats or a larger weave.ends_per_cm"
        );
        let error = check_floats("a.toml", "weave", &draft, [500.0, 700.0]).unwrap_err().to_string();
        assert!(
            error.contains("end 1 floats over 15 picks on the face") && error.contains("weave.picks_per_cm"),
            "{error}"
        );
        // A net of yarns 20 mm apart has no floats in plain weave, and has some in a twill.
        assert!(check_floats("a.toml", "weave", &Draft::plain(), [2e4; 2]).is_ok());
        let error = check_floats("a.toml", "weave", &named("twill 2/2"), [2e4; 2]).unwrap_err().to_string();
        assert!(error.contains("40.0 mm: use 1 or fewer (10 mm)"), "{error}");
        let loose = Draft::from_fn(2, 2, |pick, _| pick == 0).unwrap();
        let error = check_floats("a.toml", "weave", &loose, [1.0; 2]).unwrap_err().to_string();
        assert!(error.contains("pick 1 lies on the back of all ends"), "{error}");
        assert!(check_floats("a.toml", "weave", &Draft::layers(), [1.0; 2]).is_ok());
    }

    /// Length by definition: from every crossing, yarns are counted until the side changes.
    fn by_counting(draft: &Draft, set: YarnSet) -> usize {
        let across = draft.threads(set.other());
        let up = |thread: usize, at: usize| match set {
            YarnSet::Warp => draft.up(at % across, thread),
            YarnSet::Weft => draft.up(thread, at % across),
        };
        let from = |thread: usize, at: usize| (0..across).take_while(|k| up(thread, at + k) == up(thread, at)).count();
        (0..draft.threads(set)).flat_map(|t| (0..across).map(move |at| from(t, at))).max().unwrap()
    }

    proptest! {
        #[test]
        fn lengths_are_those_of_the_definition(picks in 1usize..9, ends in 1usize..9, bits: u64) {
            let draft = Draft::from_fn(picks, ends, |pick, end| bits >> ((pick * ends + end) % 64) & 1 == 1).unwrap();
            for float in longest_floats(&draft) {
                prop_assert_eq!(float.length, by_counting(&draft, float.set));
                let side = |at: usize| match float.set {
                    YarnSet::Warp => draft.up((float.from + at) % picks, float.thread) == float.on_face,
                    YarnSet::Weft => draft.up(float.thread, (float.from + at) % ends) != float.on_face,
                };
                prop_assert!((0..float.length).all(side));
                prop_assert_eq!(float.is_endless, float.length == draft.threads(float.set.other()));
            }
        }
    }
}
