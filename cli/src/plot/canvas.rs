//! A raster to draw figures on: rectangles, anti-aliased strokes and dots, and text in the bitmap font.

use super::colormap::Rgb;
use super::font;

/// Paper of every figure.
pub const WHITE: Rgb = [255, 255, 255];
/// Text and frames.
pub const INK: Rgb = [32, 32, 38];
/// Secondary text and ticks.
pub const GRAY: Rgb = [110, 110, 118];

/// Dots between the left edges of neighbouring characters.
pub const ADVANCE: i32 = 12;
/// Height of a line of capitals.
pub const CAP: i32 = 14;
/// From one line of text to the next.
pub const LINE: i32 = 22;

/// Where a text's anchor lies along its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// At its start.
    Left,
    /// In its middle.
    Center,
    /// At its end.
    Right,
}

/// Pixels of a figure, sRGB.
pub struct Canvas {
    image: image::RgbImage,
}

impl Canvas {
    /// A white canvas.
    pub fn new(width: i32, height: i32) -> Self {
        Canvas { image: image::RgbImage::from_pixel(width.max(1) as u32, height.max(1) as u32, image::Rgb(WHITE)) }
    }

    /// The finished figure.
    pub fn into_image(self) -> image::RgbImage {
        self.image
    }

    /// Width [dots].
    pub fn width(&self) -> i32 {
        self.image.width() as i32
    }

    /// Height [dots].
    pub fn height(&self) -> i32 {
        self.image.height() as i32
    }

    /// Sets a dot; outside the canvas nothing happens.
    pub fn set(&mut self, x: i32, y: i32, color: Rgb) {
        if (0..self.width()).contains(&x) && (0..self.height()).contains(&y) {
            self.image.put_pixel(x as u32, y as u32, image::Rgb(color));
        }
    }

    /// Mixes `color` over a dot, `cover` in [0, 1].
    pub fn blend(&mut self, x: i32, y: i32, color: Rgb, cover: f64) {
        if cover > 0.0 && (0..self.width()).contains(&x) && (0..self.height()).contains(&y) {
            let dot = &mut self.image.get_pixel_mut(x as u32, y as u32).0;
            for (d, c) in dot.iter_mut().zip(color) {
                *d = (*d as f64 + cover.min(1.0) * (c as f64 - *d as f64)).round() as u8;
            }
        }
    }

    /// Fills `w` by `h` dots from the corner `(x, y)`.
    pub fn fill(&mut self, x: i32, y: i32, w: i32, h: i32, color: Rgb) {
        for j in y.max(0)..(y + h).min(self.height()) {
            for i in x.max(0)..(x + w).min(self.width()) {
                self.image.put_pixel(i as u32, j as u32, image::Rgb(color));
            }
        }
    }

    /// Frame of one dot just outside the `w` by `h` dots at `(x, y)`.
    pub fn frame(&mut self, x: i32, y: i32, w: i32, h: i32, color: Rgb) {
        self.fill(x - 1, y - 1, w + 2, 1, color);
        self.fill(x - 1, y + h, w + 2, 1, color);
        self.fill(x - 1, y, 1, h, color);
        self.fill(x + w, y, 1, h, color);
    }

    /// Stroke of `width` dots between two points, inside the clip `[x0, y0, x1, y1)`.
    pub fn stroke(&mut self, a: [f64; 2], b: [f64; 2], width: f64, color: Rgb, clip: [i32; 4]) {
        let d = [b[0] - a[0], b[1] - a[1]];
        let length2 = d[0] * d[0] + d[1] * d[1];
        let reach = 0.5 * width + 1.0;
        let range = |p: f64, q: f64, from: i32, to: i32| {
            ((p.min(q) - reach).floor() as i32).max(from)..((p.max(q) + reach).ceil() as i32 + 1).min(to)
        };
        for y in range(a[1], b[1], clip[1], clip[3]) {
            for x in range(a[0], b[0], clip[0], clip[2]) {
                let p = [x as f64 + 0.5 - a[0], y as f64 + 0.5 - a[1]];
                let t = if length2 > 0.0 { ((p[0] * d[0] + p[1] * d[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
                let off = (p[0] - t * d[0]).hypot(p[1] - t * d[1]);
                self.blend(x, y, color, (0.5 * width + 0.5 - off).clamp(0.0, 1.0));
            }
        }
    }

    /// Filled dot of radius `r` about a point, inside the clip.
    pub fn dot(&mut self, center: [f64; 2], r: f64, color: Rgb, clip: [i32; 4]) {
        self.stroke(center, center, 2.0 * r, color, clip);
    }

    /// Width [dots] of a text, markup not counted.
    pub fn text_width(text: &str) -> i32 {
        layout(text).last().map_or(0, |&(_, x, _)| x + 2 * font::WIDTH as i32)
    }

    /// Text with its anchor `x` and its cap line at `y`. `_` lowers the next character
    /// or `{group}`, `^` raises it; doubled they stand for themselves.
    pub fn text(&mut self, x: i32, y: i32, text: &str, align: Align, color: Rgb) {
        let start = x - shift(text, align);
        for (c, dx, dy) in layout(text) {
            self.each_dot(c, |canvas, i, j| canvas.set(start + dx + i, y + dy + j, color));
        }
    }

    /// Text that reads upwards, its cap line at `x` and its anchor at `y`.
    pub fn text_up(&mut self, x: i32, y: i32, text: &str, align: Align, color: Rgb) {
        let start = y + shift(text, align);
        for (c, dx, dy) in layout(text) {
            self.each_dot(c, |canvas, i, j| canvas.set(x + dy + j, start - dx - i, color));
        }
    }

    fn each_dot(&mut self, c: char, mut put: impl FnMut(&mut Self, i32, i32)) {
        let glyph = font::glyph(c);
        for j in 0..2 * font::HEIGHT {
            for i in 0..2 * font::WIDTH {
                if font::doubled(&glyph, i, j) {
                    put(self, i as i32, j as i32);
                }
            }
        }
    }
}

fn shift(text: &str, align: Align) -> i32 {
    match align {
        Align::Left => 0,
        Align::Center => Canvas::text_width(text) / 2,
        Align::Right => Canvas::text_width(text),
    }
}

/// Characters with their offsets from the anchor.
fn layout(text: &str) -> Vec<(char, i32, i32)> {
    let mut out = Vec::new();
    let (mut x, mut dy, mut group) = (0, 0, false);
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '_' | '^' if chars.peek() == Some(&c) => {
                chars.next();
                out.push((c, x, dy));
                x += ADVANCE;
            }
            '_' | '^' => {
                dy = if c == '_' { 6 } else { -6 };
                group = chars.next_if_eq(&'{').is_some();
            }
            '}' if group => (dy, group) = (0, false),
            c => {
                out.push((c, x, dy));
                x += ADVANCE;
                if !group {
                    dy = 0;
                }
            }
        }
    }
    out
}

/// A text from outside, with its underscores and carets kept from being markup.
pub fn literal(text: &str) -> String {
    text.replace('_', "__").replace('^', "^^")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_lowers_raises_and_groups() {
        let read = |t: &str| layout(t).into_iter().map(|(c, x, dy)| (c, x / ADVANCE, dy.signum())).collect::<Vec<_>>();
        assert_eq!(read("θ_i=1"), [('θ', 0, 0), ('i', 1, 1), ('=', 2, 0), ('1', 3, 0)]);
        assert_eq!(read("f_{ab}c"), [('f', 0, 0), ('a', 1, 1), ('b', 2, 1), ('c', 3, 0)]);
        assert_eq!(read("1^{-2}}"), [('1', 0, 0), ('-', 1, -1), ('2', 2, -1), ('}', 3, 0)]);
        assert_eq!(read(&literal("a_b^{")), [('a', 0, 0), ('_', 1, 0), ('b', 2, 0), ('^', 3, 0), ('{', 4, 0)]);
        assert_eq!(Canvas::text_width(""), 0);
        assert_eq!(Canvas::text_width("ab"), ADVANCE + 10);
    }
}
