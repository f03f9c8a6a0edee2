//! Pictures as drafts, as programs for jacquard weaving make them: each color of the picture stands for a
//! weave, a column of pixels for an end, and a row for a pick, or for one pick of each weft of several.

use crate::picture::area::{AreaWeave, WovenUnit};
use crate::picture::bind::{Crossings, MIN_LIMIT, bind};
use crate::picture::colors::{Wrong, color_key, find_colors, read_color};
use crate::picture::pixels::{Pixels, hex};
use crate::weave::floats::{Float, longest_floats, runs};
use crate::{Draft, MAX_THREADS, YarnSet};
use plywave::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::Value;

/// Largest number of wefts.
pub const MAX_WEFTS: usize = 4;
/// The form of the key `weaves`, for messages.
pub const WEAVES_FORM: &str = "a weave for each color of the picture, such as { \"#fff\" = \"satin 5/2\", \
    \"#000\" = \"satin 5/2 weft\" }, or a list, one for each weft";
/// Repeats beyond this are not searched for the longest float of an area; their first threads are.
const MAX_SEARCHED: usize = 1024;

/// A draft drawn as a picture: the keys of `[weave]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Keys", into = "Keys")]
pub struct PictureWeave {
    /// Path of the PNG file, relative to the spec. Its last row is the first pick.
    pub picture: String,
    /// Weaves of the colors: at least one, each color once, all with the same number of wefts.
    pub weaves: Vec<ColorWeaves>,
    /// Number of pixels over which a yarn may float, on either side: ends for a pick, and rows of picks for
    /// an end. Longer floats are bound. Absent: twice the longest float of the weaves (chosen: two floats can
    /// join where areas meet, and each binding point blurs what is drawn).
    pub max_float: Option<usize>,
}

/// The weaves of a color, one for each weft.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColorWeaves {
    /// The color [sRGB, 0 to 255].
    pub color: [u8; 3],
    /// How each weft is woven there, in the order in which their picks follow.
    pub wefts: Vec<AreaWeave>,
}

/// A draft made from a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureDraft {
    /// The draft. Pick p belongs to weft p mod `wefts`.
    pub draft: Draft,
    /// Number of wefts.
    pub wefts: usize,
    /// Number of crossings that were turned over to bind long floats.
    pub bound: usize,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// A weave, or a list of them, as written.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    One(String),
    Each(Vec<String>),
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    picture: String,
    weaves: BTreeMap<String, Written>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    max_float: Option<usize>,
}

/// Reads the weaves of the colors, `weaves` being the name of their key.
fn read_weaves<'a>(
    weaves: &str,
    written: impl Iterator<Item = (&'a str, Written)>,
) -> std::result::Result<Vec<ColorWeaves>, Wrong> {
    let mut read: Vec<(&str, ColorWeaves)> = Vec::new();
    for (text, value) in written {
        let key = color_key(weaves, text);
        let before = read.iter().map(|(text, known)| (text.to_string(), known.color));
        let color = read_color(weaves, text, before)?;
        let (names, is_list) = match value {
            Written::One(name) => (vec![name], false),
            Written::Each(names) => (names, true),
        };
        if !(1..=MAX_WEFTS).contains(&names.len()) {
            let value = format!("{} weaves", names.len());
            return Err(Wrong::new(&key, value, format!("use 1 to {MAX_WEFTS}, one for each weft")));
        }
        let mut wefts = Vec::new();
        for (at, name) in names.iter().enumerate() {
            let at = if is_list { format!("{key}[{at}]") } else { key.clone() };
            let shown = plywave::one_line(name, 60);
            wefts.push(name.parse().map_err(|hint: String| Wrong::new(at, shown, hint))?);
        }
        if let Some((other, first)) = read.first().filter(|(_, first)| first.wefts.len() != wefts.len()) {
            let value = format!("{} weaves", wefts.len());
            let hint = format!("use {}, as for {other:?}: one for each weft", first.wefts.len());
            return Err(Wrong::new(&key, value, hint));
        }
        read.push((text, ColorWeaves { color, wefts }));
    }
    match read.is_empty() {
        true => Err(Wrong::new(weaves, "no weaves", format!("use {WEAVES_FORM}"))),
        false => Ok(read.into_iter().map(|(_, weaves)| weaves).collect()),
    }
}

/// Checks the key `weaves` of a spec before it is parsed.
///
/// # Errors
/// [`Error::Invalid`] with the color and the weave that are wrong.
pub fn check_weaves(file: &str, key: &str, value: &Value) -> Result<()> {
    let invalid =
        |wrong: Wrong| Error::Invalid { file: file.into(), key: wrong.key, value: wrong.value, hint: wrong.hint };
    let form = |key: &str, value: &Value| {
        let value = plywave::one_line(&value.to_string(), 60);
        invalid(Wrong::new(key, value, format!("use {WEAVES_FORM}")))
    };
    let table = value.as_table().ok_or_else(|| form(key, value))?;
    let mut written = Vec::new();
    for (color, value) in table {
        let names = match value {
            Value::String(name) => Some(Written::One(name.clone())),
            Value::Array(list) => {
                list.iter().map(|v| v.as_str().map(Into::into)).collect::<Option<_>>().map(Written::Each)
            }
            _ => None,
        };
        written.push((color.as_str(), names.ok_or_else(|| form(&format!("{key}.{color:?}"), value))?));
    }
    read_weaves(key, written.into_iter()).map(|_| ()).map_err(invalid)
}

impl TryFrom<Keys> for PictureWeave {
    type Error = String;

    fn try_from(keys: Keys) -> std::result::Result<PictureWeave, String> {
        let written = keys.weaves.iter().map(|(color, value)| (color.as_str(), value.clone()));
        let weaves = read_weaves("weave.weaves", written)
            .map_err(|wrong| format!("{} = {}: {}", wrong.key, wrong.value, wrong.hint))?;
        match keys.max_float {
            Some(limit) if !(MIN_LIMIT..=MAX_THREADS).contains(&limit) => {
                Err(format!("weave.max_float = {limit}: use {MIN_LIMIT} to {MAX_THREADS} pixels"))
            }
            max_float => Ok(PictureWeave { picture: keys.picture, weaves, max_float }),
        }
    }
}

impl From<PictureWeave> for Keys {
    fn from(weave: PictureWeave) -> Keys {
        let written = |wefts: &[AreaWeave]| match wefts {
            [one] => Written::One(one.to_string()),
            each => Written::Each(each.iter().map(ToString::to_string).collect()),
        };
        let weaves = weave.weaves.iter().map(|of| (hex(of.color), written(&of.wefts))).collect();
        Keys { picture: weave.picture, weaves, max_float: weave.max_float }
    }
}

impl ColorWeaves {
    /// The longest float in a wide area of this color, in pixels; `None` if a yarn is bound by the limit of
    /// floats alone.
    fn longest_float(&self) -> Option<usize> {
        let units: Vec<WovenUnit> = self.wefts.iter().map(AreaWeave::unit).collect();
        let mut longest = 0;
        let mut sizes = [1usize; 2];
        for unit in &units {
            let WovenUnit::Repeat(draft) = unit else { return None };
            longest = longest.max(longest_floats(draft)[1].length);
            sizes = [0, 1].map(|k| lcm(sizes[k], unit.size()[k]).min(MAX_SEARCHED));
        }
        let [rows, ends] = sizes;
        for end in 0..ends {
            let up = |pick: usize| units[pick % units.len()].up(pick / units.len(), end);
            let found = runs(rows * units.len(), up).into_iter().map(|(_, length, _)| length);
            let float = found.filter(|length| *length < rows * units.len()).max().unwrap_or(0);
            // A float of as many rows, and of some picks more, is within that number of rows.
            longest = longest.max((float + 1).div_ceil(units.len()) - 1);
        }
        Some(longest)
    }

    fn name(&self) -> String {
        let names: Vec<String> = self.wefts.iter().map(ToString::to_string).collect();
        names.join(" with ")
    }
}

impl PictureWeave {
    /// Number of wefts.
    pub fn wefts(&self) -> usize {
        self.weaves.first().map_or(1, |of| of.wefts.len())
    }

    /// A note if the colors of the picks, `colors` in turn, do not go with the wefts; 0 or 1 is one color.
    pub fn rotation_note(&self, colors: usize) -> Option<String> {
        let wefts = self.wefts();
        (wefts > 1 && (colors < 2 || !colors.is_multiple_of(wefts))).then(|| {
            format!(
                "the picks of {wefts} wefts follow in turn; to give each its color, use weft.stripes of {wefts} picks, \
                 one of each color"
            )
        })
    }

    /// The draft of a picture, from the bytes of its PNG file. `file` is the name of the spec.
    ///
    /// # Errors
    /// [`Error::Format`] for a picture that cannot be read ([`Pixels::from_png`]), and [`Error::Invalid`] for
    /// a color without a weave, a limit below the floats of a weave, and too many picks.
    pub fn draft(&self, file: &str, png: &[u8]) -> Result<PictureDraft> {
        self.draft_of(file, &Pixels::from_png(png, &self.picture)?)
    }

    /// The draft of pixels, as [`PictureWeave::draft`].
    ///
    /// # Errors
    /// As [`PictureWeave::draft`].
    pub fn draft_of(&self, file: &str, pixels: &Pixels) -> Result<PictureDraft> {
        let invalid = |wrong: Wrong| Error::Invalid {
            file: file.into(),
            key: format!("weave.{}", wrong.key),
            value: wrong.value,
            hint: wrong.hint,
        };
        let wefts = self.wefts();
        let (rows, ends) = (pixels.height, pixels.width);
        let size = format!("{ends} x {rows} pixels");
        if rows < 2 || ends < 2 {
            return Err(invalid(Wrong::new("picture", size, "use a picture of 2 x 2 pixels or more")));
        }
        if rows * wefts > MAX_THREADS {
            let most = MAX_THREADS / wefts;
            let hint = format!("{wefts} wefts make {} picks; use {most} rows or less", rows * wefts);
            return Err(invalid(Wrong::new("picture", size, hint)));
        }
        let used = self.weaves_of(pixels).map_err(invalid)?;
        let limit = self.limit(&used).map_err(invalid)?;
        let mut notes: Vec<String> = Vec::new();
        let unused: Vec<String> = self.weaves.iter().filter(|of| !used.contains(of)).map(|of| hex(of.color)).collect();
        if !unused.is_empty() {
            notes.push(format!("weave.weaves: no pixel of {} is {}", self.picture, unused.join(" or ")));
        }
        let units: Vec<Vec<WovenUnit>> = used.iter().map(|of| of.wefts.iter().map(AreaWeave::unit).collect()).collect();
        notes.extend(self.cut_notes(&used, [rows, ends]));
        let mut crossings = Crossings::from_fn([rows * wefts, ends], wefts, |pick, end| {
            let row = pick / wefts;
            let color = pixels.values[(rows - 1 - row) * ends + end];
            units[usize::from(color)][pick % wefts].up(row, end)
        });
        let before = crossings.draft().map(|draft| longest_floats(&draft));
        let bound = bind(&mut crossings, limit).len();
        if bound > 0 {
            let is_endless = before.iter().flatten().any(|float| float.is_endless);
            let pixels = |float: &Float| match float.set {
                YarnSet::Warp => (float.length + 1).div_ceil(wefts) - 1,
                YarnSet::Weft => float.length,
            };
            let longest = before.iter().flatten().map(pixels).max().unwrap_or(0);
            let longest = if is_endless { "without end".into() } else { format!("over {longest}") };
            notes.push(format!(
                "floats of more than {limit} pixels, the longest {longest}, are bound at {bound} of {} crossings",
                rows * wefts * ends
            ));
        }
        match crossings.draft() {
            Some(draft) => Ok(PictureDraft { draft, wefts, bound, notes }),
            None => Err(invalid(Wrong::new("picture", size, format!("use {MAX_THREADS} x {MAX_THREADS} or less")))),
        }
    }

    /// The weaves of the colors of a picture, in the order of these.
    fn weaves_of(&self, pixels: &Pixels) -> std::result::Result<Vec<&ColorWeaves>, Wrong> {
        let known: Vec<[u8; 3]> = self.weaves.iter().map(|of| of.color).collect();
        let found = find_colors(pixels, &known, ["weaves", "weave", &self.picture])?;
        Ok(found.into_iter().map(|at| &self.weaves[at]).collect())
    }

    /// The limit of floats.
    fn limit(&self, used: &[&ColorWeaves]) -> std::result::Result<usize, Wrong> {
        let own: Vec<Option<usize>> = used.iter().map(|of| of.longest_float()).collect();
        let longest = (0..used.len()).max_by_key(|at| (own[*at], std::cmp::Reverse(*at))).unwrap_or(0);
        let length = own[longest].unwrap_or(0);
        match self.max_float {
            Some(limit) if limit < length => Err(Wrong::new(
                "max_float",
                limit.to_string(),
                format!("{} alone floats over {length}; use {length} or more, or another weave", used[longest].name()),
            )),
            Some(limit) => Ok(limit.max(MIN_LIMIT)),
            None => match own.iter().position(Option::is_none) {
                Some(at) => Err(Wrong::new(
                    "max_float",
                    "(absent)",
                    format!("give the number of pixels at which {} is bound, such as 15", used[at].name()),
                )),
                None => Ok((2 * length).max(MIN_LIMIT)),
            },
        }
    }

    /// Notes for weaves whose repeat does not go into the picture.
    fn cut_notes(&self, used: &[&ColorWeaves], sizes: [usize; 2]) -> Vec<String> {
        let mut notes = Vec::new();
        for (k, [side, yarns]) in [["high", "picks"], ["wide", "ends"]].into_iter().enumerate() {
            let all = used.iter().flat_map(|of| &of.wefts).fold(1, |all, weave| lcm(all, weave.unit().size()[k]));
            if sizes[k].is_multiple_of(all) {
                continue;
            }
            let (below, above) = (sizes[k] / all * all, (sizes[k] / all + 1) * all);
            let fit: Vec<String> =
                [below, above].into_iter().filter(|n| (2..=MAX_THREADS).contains(n)).map(|n| n.to_string()).collect();
            let fit = if fit.is_empty() { String::new() } else { format!("; {} fit", fit.join(" and ")) };
            notes.push(format!(
                "{} is {} pixels {side}, and its weaves repeat over {all} {yarns}: they are cut where it repeats{fit}",
                self.picture, sizes[k]
            ));
        }
        notes
    }
}

/// Least common multiple, without overflow.
fn lcm(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    (a / x.max(1)).saturating_mul(b)
}

#[cfg(test)]
#[path = "spec_tests.rs"]
mod tests;
