//! Lines of text: markup for indices, their widths in the embedded font, shortening and wrapping.

use super::path::{Path, Pen};
use std::sync::LazyLock;
use ttf_parser::{Face, GlyphId};

/// DejaVu Sans 2.37 (license beside it): Latin, Greek, Cyrillic and a few signs, without hints, kerning and
/// ligatures, so that a text is as wide as its letters. Made by `pyftsubset` of fonttools; README
/// of the folder has the command.
const FONT: &[u8] = include_bytes!("../../fonts/DejaVuSans.ttf");
/// Size of text [pixels an em].
const SIZE: f64 = 15.0;
/// Size of an index over that of its line.
const INDEX: f64 = 0.75;
/// How far an index lies below its line, and an exponent above it, over the size.
const SHIFT: f64 = 0.3;

static FACE: LazyLock<Face<'static>> = LazyLock::new(|| match Face::parse(FONT, 0) {
    Ok(face) => face,
    Err(error) => unreachable!("the font is compiled in: {error}"),
});

/// Width of a letter [em]. One that the font lacks is taken to be square, as Chinese, Japanese and Korean
/// letters are.
fn letter(c: char) -> f64 {
    let width = FACE.glyph_index(c).and_then(|glyph| FACE.glyph_hor_advance(glyph));
    width.map_or(1.0, |width| f64::from(width) / f64::from(FACE.units_per_em()))
}

/// A letter on its line, or below or above it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Letter {
    c: char,
    /// 1 for an index, -1 for an exponent, 0 otherwise.
    level: i8,
}

impl Letter {
    fn width(&self) -> f64 {
        SIZE * letter(self.c) * if self.level == 0 { 1.0 } else { INDEX }
    }
}

/// A line of text. In its markup `_` lowers and `^` raises what follows, one letter or a group in braces;
/// doubled they stand for themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct Text(Vec<Letter>);

impl Text {
    /// Reads markup. Control characters become spaces: XML has no place for them.
    pub fn parse(markup: &str) -> Text {
        let mut out = Vec::new();
        let (mut level, mut group) = (0, false);
        let mut chars = markup.chars().map(|c| if c.is_control() { ' ' } else { c }).peekable();
        while let Some(c) = chars.next() {
            match c {
                '_' | '^' if chars.peek() == Some(&c) => {
                    chars.next();
                    out.push(Letter { c, level });
                }
                '_' | '^' => {
                    level = if c == '_' { 1 } else { -1 };
                    group = chars.next_if_eq(&'{').is_some();
                }
                '}' if group => (level, group) = (0, false),
                c => {
                    out.push(Letter { c, level });
                    if !group {
                        level = 0;
                    }
                }
            }
        }
        Text(out)
    }

    /// Its letters without levels.
    pub fn plain(&self) -> String {
        self.0.iter().map(|l| l.c).collect()
    }

    /// Width at the size [`SIZE`].
    pub fn width(&self) -> f64 {
        self.0.iter().map(Letter::width).sum()
    }

    /// As much of it as `room` units hold, with an ellipsis where that is not all.
    pub fn shortened(mut self, available: f64) -> Text {
        let dots = Letter { c: '…', level: 0 };
        let mut width = self.width();
        if width <= available {
            return self;
        }
        while width + dots.width() > available {
            let Some(last) = self.0.pop() else { break };
            width -= last.width();
        }
        self.0.push(dots);
        self
    }

    /// Its outline at the size [`SIZE`], from `x` on along the axis. A letter
    /// that the font lacks is a box.
    pub fn outline(&self, x: f64) -> Path {
        let mut pen = Pen { x, ..Pen::default() };
        for letter in &self.0 {
            let size = if letter.level == 0 { SIZE } else { INDEX * SIZE };
            pen.scale = size / f64::from(FACE.units_per_em());
            pen.y = f64::from(letter.level) * (SHIFT * SIZE).round();
            // The box of a letter that the font lacks stands in the middle of its square.
            let glyph = FACE.glyph_index(letter.c).unwrap_or(GlyphId(0));
            let advance = pen.scale * f64::from(FACE.glyph_hor_advance(glyph).unwrap_or(0));
            let (from, width) = (pen.x, letter.width());
            pen.x += 0.5 * (width - advance);
            FACE.outline_glyph(glyph, &mut pen);
            pen.x = from + width;
        }
        pen.path
    }
}

/// Width of a line of markup, rounded up.
pub fn width(markup: &str) -> i32 {
    Text::parse(markup).width().ceil() as i32
}

/// Lines of at most `available` units, broken at spaces; a longer word has a line of its own.
pub fn wrap(markup: &str, available: i32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in markup.split(' ') {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}")) <= available => *line = format!("{line} {word}"),
            _ => lines.push(word.into()),
        }
    }
    lines
}

/// Text from a file with its underscores and carets escaped for the markup, at most `max` characters of it.
pub fn literal(text: &str, max: usize) -> String {
    text.chars().take(max).collect::<String>().replace('_', "__").replace('^', "^^")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_lowers_raises_and_groups() {
        let read = |t: &str| Text::parse(t).0.iter().map(|l| (l.c, l.level)).collect::<Vec<_>>();
        assert_eq!(read("θ_i=1"), [('θ', 0), ('i', 1), ('=', 0), ('1', 0)]);
        assert_eq!(read("f_{ab}c"), [('f', 0), ('a', 1), ('b', 1), ('c', 0)]);
        assert_eq!(read("1^{-2}}"), [('1', 0), ('-', -1), ('2', -1), ('}', 0)]);
        assert_eq!(read(&literal("a_b^{", 9)), [('a', 0), ('_', 0), ('b', 0), ('^', 0), ('{', 0)]);
        assert_eq!(read("a\n\u{1b}b"), [('a', 0), (' ', 0), (' ', 0), ('b', 0)]);
        assert_eq!(literal("Żółw_x", 5), "Żółw__");
    }

    /// Widths are those of DejaVu Sans (units of 2048 an em: M 1767, i 569); outlines fill them.
    #[test]
    fn widths_are_the_fonts() {
        assert_eq!(width(""), 0);
        assert!((letter('M') - 1767.0 / 2048.0).abs() < 1e-6 && (letter('i') - 569.0 / 2048.0).abs() < 1e-6);
        assert!(letter('絹') == 1.0 && letter('Ż') < 1.0);
        let line = Text::parse("Ångström, θ_i = 30°, Żółw: H");
        let ends = |d: &str| -> [f64; 2] {
            let numbers = d.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'));
            let x = numbers.filter_map(|n| n.parse::<f64>().ok()).step_by(2);
            x.fold([f64::INFINITY, 0.0], |[low, high], x| [low.min(x), high.max(x)])
        };
        // A and H have bearings of 0.01 and 0.1 em.
        let [from, to] = ends(&line.outline(0.0).data());
        assert!(
            (0.0..0.2).contains(&from) && (line.width() - to - 0.1 * SIZE).abs() < 0.3,
            "{from}..{to} of {}",
            line.width()
        );
        assert!(Text::parse("絹").outline(0.0).outline().is_some());
    }

    #[test]
    fn long_texts_are_shortened_or_wrapped() {
        let text = Text::parse("a rather long title with f_{high}");
        assert_eq!(text.clone().shortened(1e3), text);
        for available in [40.0, 90.0, 150.0] {
            let short = text.clone().shortened(available);
            assert!(short.width() <= available && short.plain().ends_with('…'), "{short:?}");
        }
        let lines = wrap("one two three four five six seven", 100);
        assert!(lines.len() > 1 && lines.iter().all(|l| width(l) <= 100), "{lines:?}");
        assert_eq!(lines.join(" "), "one two three four five six seven");
    }
}
