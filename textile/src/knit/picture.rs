//! Charts drawn as pictures: each color stands for a stitch, a column of pixels for a wale, a row for a
//! course.

use crate::knit::chart::{Chart, MAX_CHART};
use crate::picture::colors::{Wrong, color_key, find_colors, read_color};
use crate::picture::pixels::Pixels;
use plywave::{Error, Result};
use toml::{Table, Value};

/// The form of the key `stitches`, for messages.
pub(crate) const STITCHES_FORM: &str =
    "a stitch for each color of the picture, such as { \"#fff\" = \"K\", \"#000\" = \"P\" }";

/// A chart drawn as a picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureChart {
    /// Path of the PNG file, relative to the spec. Its last row is the first course.
    pub picture: String,
    /// Color [sRGB, 0 to 255] and letter of each stitch.
    pub stitches: Vec<([u8; 3], char)>,
}

/// An error of a key of `[knit]`.
fn invalid(file: &str, wrong: Wrong) -> Error {
    Error::Invalid { file: file.into(), key: wrong.key, value: wrong.value, hint: wrong.hint }
}

/// Reads the colors of stitches; `key` is the name of the table.
pub(crate) fn read_stitches(file: &str, key: &str, table: &Table) -> Result<Vec<([u8; 3], char)>> {
    let mut read: Vec<(&str, [u8; 3], char)> = Vec::new();
    for (text, value) in table {
        let before = read.iter().map(|(text, color, _)| (text.to_string(), *color));
        let color = read_color(key, text, before).map_err(|wrong| invalid(file, wrong))?;
        let mut letters = value.as_str().unwrap_or_default().chars();
        let (letter, rest) = (letters.next(), letters.next());
        let Some(letter) = letter.filter(|c| rest.is_none() && "KPTM<>RrLl".contains(*c)) else {
            let value = plywave::one_line(&value.to_string(), 60);
            let hint = "use one of K, P, T, M, > and <, or R, r, L and l for the loops of cables";
            return Err(invalid(file, Wrong::new(color_key(key, text), value, hint)));
        };
        read.push((text, color, letter));
    }
    match read.is_empty() {
        true => Err(invalid(file, Wrong::new(key, "no stitches", format!("use {STITCHES_FORM}")))),
        false => Ok(read.into_iter().map(|(_, color, letter)| (color, letter)).collect()),
    }
}

/// Checks the key `stitches` of a spec before it is parsed.
pub(crate) fn check_stitches(file: &str, key: &str, value: &Value) -> Result<()> {
    match value.as_table() {
        Some(table) => read_stitches(file, key, table).map(|_| ()),
        None => {
            let value = plywave::one_line(&value.to_string(), 60);
            Err(invalid(file, Wrong::new(key, value, format!("use {STITCHES_FORM}"))))
        }
    }
}

impl PictureChart {
    /// The chart of a picture, from the bytes of its PNG file. `file` is the name of the spec.
    ///
    /// # Errors
    /// [`Error::Format`] for a picture that cannot be read ([`Pixels::from_png`]), and [`Error::Invalid`] for
    /// a color without a stitch, a picture of more than [`MAX_CHART`] rows or columns, and a chart that
    /// cannot be knitted.
    pub fn chart(&self, file: &str, png: &[u8]) -> Result<Chart> {
        let pixels = Pixels::from_png(png, &self.picture)?;
        let wrong = |key: &str, value: String, hint: String| invalid(file, Wrong::new(key, value, hint));
        let (rows, wales) = (pixels.height, pixels.width);
        if rows > MAX_CHART || wales > MAX_CHART {
            let hint = format!("a pixel is a stitch: use {MAX_CHART} x {MAX_CHART} or less");
            return Err(wrong("knit.picture", format!("{} of {wales} x {rows} pixels", self.picture), hint));
        }
        let colors: Vec<[u8; 3]> = self.stitches.iter().map(|(color, _)| *color).collect();
        let found = find_colors(&pixels, &colors, ["knit.stitches", "stitch", &self.picture])
            .map_err(|wrong| invalid(file, wrong))?;
        let letter = |value: &u8| self.stitches[found[usize::from(*value)]].1;
        let rows: Vec<String> = pixels.values.chunks(wales).map(|row| row.iter().map(letter).collect()).collect();
        Chart::from_rows(&rows).map_err(|error| {
            let row = error.row.map_or(String::new(), |row| format!("row {}, ", row + 1));
            wrong("knit.picture", format!("{}: {row}{}", self.picture, error.value), error.hint)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::pixels::tests::rgb;

    /// A picture of letters: `.` white, `#` black, `r` red.
    fn picture(rows: &[&str]) -> Vec<u8> {
        let color = |c: char| match c {
            '.' => [255; 3],
            'r' => [255, 0, 0],
            _ => [0; 3],
        };
        let pixels: Vec<[u8; 3]> = rows.iter().flat_map(|row| row.chars().map(color)).collect();
        rgb(rows[0].len(), &pixels)
    }

    fn of(stitches: &[([u8; 3], char)]) -> PictureChart {
        PictureChart { picture: "a.png".into(), stitches: stitches.to_vec() }
    }

    /// A picture is the chart of its letters, and the last row is the first course.
    #[test]
    fn pictures_are_charts() {
        let chart = of(&[([255; 3], 'K'), ([0; 3], 'P'), ([255, 0, 0], '>')]);
        let got = chart.chart("s.toml", &picture(&["..#.", "r..#", "...."])).unwrap();
        assert_eq!(got, Chart::from_rows(&["KKPK", ">KKP", "KKKK"]).unwrap());
    }

    #[test]
    fn pictures_that_are_no_chart_are_refused_in_one_line() {
        let plain = of(&[([255; 3], 'K'), ([0; 3], 'T')]);
        let wide = rgb(257, &[[255; 3]; 257]);
        for (png, want) in [
            (picture(&["..#.", "...r"]), "s.toml: knit.stitches = #ff0000 without a stitch, 1 pixels of a.png"),
            (picture(&["#."]), "knit.picture = a.png: the loop of course 1, wale 1: the knit runs"),
            (wide, "knit.picture = a.png of 257 x 1 pixels: a pixel is a stitch: use 256 x 256 or less"),
            (b"GIF89a".to_vec(), "no PNG file"),
        ] {
            let error = plain.chart("s.toml", &png).unwrap_err().to_string();
            assert!(error.contains(want) && error.lines().count() == 1, "{error}\n{want}");
        }
        let cable = of(&[([255; 3], 'K'), ([0; 3], 'R')]);
        let error = cable.chart("s.toml", &picture(&["..#.", "...."])).unwrap_err().to_string();
        assert!(error.contains("a.png: row 1, \"R\" at wale 3: complete the cable"), "{error}");
    }
}
