//! Far-field patterns in colors, as a camera would see them behind an aperture: linear RGB from three wavelengths, one exposure a panel.

use super::canvas::{Align, CAP, Canvas, GRAY, INK, LINE};
use super::lines::linear;
use super::map::Panel;
use super::{axes, sheet::heading};

/// Wavelengths [um] that stand for red, green and blue.
pub const RGB_UM: [f32; 3] = [0.65, 0.55, 0.45];

/// A square window of directions about the forward one.
pub struct Pattern {
    /// Above it.
    pub title: String,
    /// Below it: what was measured.
    pub note: String,
    /// Half the window's side, as the change of a direction's component in the plane.
    pub reach: f64,
    /// Dots along a side.
    pub side: usize,
    /// `[side][side]` linear RGB, the first row at the top.
    pub values: Vec<[f32; 3]>,
}

impl Pattern {
    /// Samples `f(dx, dy)` at the centers of the dots.
    pub fn sample(title: String, note: String, reach: f64, side: usize, f: impl Fn(f64, f64) -> [f32; 3]) -> Self {
        let at = |i: usize| (2.0 * (i as f64 + 0.5) / side as f64 - 1.0) * reach;
        let values = (0..side * side).map(|i| f(at(i % side), -at(i / side))).collect();
        Pattern { title, note, reach, side, values }
    }
}

/// The sRGB value of a linear one in [0, 1].
fn encode(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let v = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * v).round() as u8
}

/// Exposures of a pattern: the brightest value at the top of the scale, and this many times as much light, for the side lobes.
const EXPOSURES: [f32; 2] = [1.0, 100.0];
const MARGIN: i32 = 28;
const GUTTER: i32 = 84;

/// A page: two exposures of each pattern, one above the other.
pub fn page(title: &str, particulars: &[String], patterns: &[Pattern]) -> image::RgbImage {
    let side = patterns.iter().map(|p| p.side as i32).max().unwrap_or(0);
    let head = MARGIN + (1 + particulars.len() as i32) * LINE + 2 * LINE;
    let texts = particulars.iter().map(|p| Canvas::text_width(p)).max().unwrap_or(0).max(Canvas::text_width(title));
    let columns = patterns.len() as i32 * (side + GUTTER);
    let row = side + 3 * LINE;
    let mut canvas = Canvas::new(2 * MARGIN + columns.max(texts), head + 2 * row + LINE + MARGIN);
    heading(&mut canvas, MARGIN, MARGIN, title);
    for (i, line) in particulars.iter().enumerate() {
        canvas.text(MARGIN, MARGIN + (i as i32 + 1) * LINE + 2, line, Align::Left, GRAY);
    }
    for (k, pattern) in patterns.iter().enumerate() {
        let x = MARGIN + GUTTER + k as i32 * (side + GUTTER);
        canvas.text(x + side / 2, head - LINE, &pattern.title, Align::Center, INK);
        for (r, exposure) in EXPOSURES.into_iter().enumerate() {
            draw(&mut canvas, Panel { x, y: head + r as i32 * row, w: side, h: side }, pattern, exposure);
        }
        canvas.text(x + side / 2, head + 2 * row - CAP, &pattern.note, Align::Center, GRAY);
    }
    canvas.into_image()
}

fn draw(canvas: &mut Canvas, at: Panel, pattern: &Pattern, exposure: f32) {
    let top = pattern.values.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
    let scale = if top > 0.0 { exposure / top } else { 0.0 };
    for (i, value) in pattern.values.iter().enumerate() {
        let (x, y) = ((i % pattern.side) as i32, (i / pattern.side) as i32);
        // Overexposed dots keep their hue: the channel that clips first takes the others with it.
        let peak = value.iter().fold(0.0f32, |a, b| a.max(*b)) * scale;
        let dim = if peak > 1.0 { scale / peak } else { scale };
        canvas.set(at.x + x, at.y + y, value.map(|v| encode(v * dim)));
    }
    canvas.frame(at.x, at.y, at.w, at.h, INK);
    let ticks = linear(-pattern.reach, pattern.reach, 4.0);
    axes::ticks_below(canvas, at.x, at.y + at.h, at.w, &ticks);
    axes::ticks_left(canvas, at.x, at.y, at.h, &ticks);
    if exposure > 1.0 {
        canvas.text(at.x + 8, at.y + 8, &format!("exposed {exposure} x"), Align::Left, [235, 235, 235]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Red to the right, blue above: the window is not turned over, and white is where all three are.
    #[test]
    fn patterns_are_the_right_way_round() {
        let p = Pattern::sample(String::new(), String::new(), 1.0, 40, |x, y| {
            [f32::from(x > 0.0), f32::from(x > 0.0 && y > 0.0), f32::from(y > 0.0)]
        });
        let mut canvas = Canvas::new(60, 60);
        draw(&mut canvas, Panel { x: 10, y: 10, w: 40, h: 40 }, &p, 1.0);
        let image = canvas.into_image();
        assert_eq!(image.get_pixel(45, 15).0, [255, 255, 255]);
        assert_eq!(image.get_pixel(15, 15).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(45, 45).0, [255, 0, 0]);
        assert_eq!((encode(0.5), encode(2.0), encode(-1.0)), (188, 255, 0));
    }
}
