//! Colors of pictures with what each stands for: a table such as `{ "#fff" = "K", "#000" = "P" }`.

use crate::picture::pixels::{Pixels, hex};
use plywave::color::srgb_of_text;

/// What is wrong with a key: its name below its table, its value and what to do.
pub(crate) struct Wrong {
    pub(crate) key: String,
    pub(crate) value: String,
    pub(crate) hint: String,
}

impl Wrong {
    pub(crate) fn new(key: impl Into<String>, value: impl Into<String>, hint: impl Into<String>) -> Wrong {
        Wrong { key: key.into(), value: value.into(), hint: hint.into() }
    }
}

/// Name of the key of a color in a table.
pub(crate) fn color_key(table: &str, color: &str) -> String {
    format!("{table}.{:?}", plywave::one_line(color, 40))
}

/// Reads the color of an entry of a table, which none of the colors before it may be.
pub(crate) fn read_color(
    table: &str,
    text: &str,
    mut before: impl Iterator<Item = (String, [u8; 3])>,
) -> Result<[u8; 3], Wrong> {
    let key = color_key(table, text);
    let Some(srgb) = srgb_of_text(text) else {
        return Err(Wrong::new(&key, "(a color)", "use \"#rrggbb\" or \"#rgb\", as in the picture"));
    };
    let color = srgb.map(|v| (v * 255.0).round() as u8);
    match before.find(|(_, known)| *known == color) {
        None => Ok(color),
        Some((other, _)) => Err(Wrong::new(&key, hex(color), format!("this color is {other:?} as well; give it once"))),
    }
}

/// Index of each color of a picture in a table of colors, `known`. `table` is the key of the table, `what` is
/// what it gives a color, and `picture` is the name of the file.
pub(crate) fn find_colors(
    pixels: &Pixels,
    known: &[[u8; 3]],
    [table, what, picture]: [&str; 3],
) -> Result<Vec<usize>, Wrong> {
    let counts = pixels.counts();
    let found: Vec<Option<usize>> = pixels.colors.iter().map(|color| known.iter().position(|of| of == color)).collect();
    let missing = (0..found.len()).filter(|at| found[*at].is_none());
    let Some(most) = missing.clone().max_by_key(|at| (counts[*at], std::cmp::Reverse(*at))) else {
        return Ok(found.into_iter().flatten().collect());
    };
    let color = pixels.colors[most];
    let others = match missing.count() - 1 {
        0 => String::new(),
        1 => " and 1 other color".into(),
        n => format!(" and {n} other colors"),
    };
    let distance = |of: &&[u8; 3]| -> u32 { (0..3).map(|k| u32::from(of[k].abs_diff(color[k])).pow(2)).sum() };
    let near = known.iter().min_by_key(distance).map_or(String::new(), |of| {
        format!(", or draw it as {}, the nearest that has one (without antialiasing)", hex(*of))
    });
    let value = format!("{}{others} without a {what}, {} pixels of {picture}", hex(color), counts[most]);
    Err(Wrong::new(table, value, format!("give \"{}\" a {what}{near}", hex(color))))
}
