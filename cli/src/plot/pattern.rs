//! Far-field patterns in colors, as an eye would see them behind an aperture: daylight (D65) in bands of the
//! visible spectrum, the CIE 1931 observer, sRGB; one exposure a panel. Light that is the same at every
//! wavelength is white.

use super::axes::{self, BELOW, LEFT, linear};
use super::figure::{Align, Figure, GRAY, INK, LINE, Panel};
use super::page::{Head, page as with_head};
use plywave::color::{SPECTRUM_UM, d65_xyz_density, linear_srgb_of_xyz, srgb_encode, white_d65};

/// Bands of the visible spectrum.
pub const BANDS: usize = 24;

/// Daylight in equal bands of the visible spectrum: their middles [um], and the linear sRGB of each band's
/// light, (1, 1, 1) together.
pub struct Daylight {
    /// Middles of the bands [um].
    pub lambda_um: [f32; BANDS],
    rgb: [[f64; 3]; BANDS],
}

impl Daylight {
    /// D65.
    pub fn new() -> Self {
        const PARTS: usize = 40;
        let width = (SPECTRUM_UM[1] - SPECTRUM_UM[0]) / BANDS as f64;
        let at = |band: f64| SPECTRUM_UM[0] + width * band;
        let xyz: [[f64; 3]; BANDS] = std::array::from_fn(|k| {
            let parts = (0..PARTS).map(|i| d65_xyz_density(at(k as f64 + (i as f64 + 0.5) / PARTS as f64)));
            parts.fold([0.0; 3], |sum, v| std::array::from_fn(|c| sum[c] + v[c]))
        });
        let white = white_d65();
        let scale: [f64; 3] = std::array::from_fn(|c| white[c] / xyz.iter().map(|v| v[c]).sum::<f64>());
        let rgb = xyz.map(|v| linear_srgb_of_xyz(std::array::from_fn(|c| v[c] * scale[c])));
        Daylight { lambda_um: std::array::from_fn(|k| at(k as f64 + 0.5) as f32), rgb }
    }

    /// Linear sRGB of this light in each band. A color outside the gamut is brought to its border, at the
    /// same luminance.
    pub fn rgb(&self, light: &[f32; BANDS]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (light, rgb) in light.iter().zip(&self.rgb) {
            sum.iter_mut().zip(rgb).for_each(|(s, v)| *s += f64::from(*light) * v);
        }
        // Luminance of linear sRGB (ITU-R BT.709).
        let gray = 0.2126 * sum[0] + 0.7152 * sum[1] + 0.0722 * sum[2];
        let min = sum.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        let keep = if min < 0.0 && gray > 0.0 { gray / (gray - min) } else { 1.0 };
        sum.map(|v| (gray + keep * (v - gray)).max(0.0) as f32)
    }
}

/// A square window of directions about the forward one.
pub struct Pattern {
    /// Above it.
    pub title: String,
    /// Below it: what was measured.
    pub note: String,
    /// Half the window's side, as the change of a direction's component in the plane.
    pub reach: f64,
    /// Pixels along a side.
    pub side: usize,
    /// `[side][side]` linear RGB, the first row at the top.
    pub values: Vec<[f32; 3]>,
}

impl Pattern {
    /// Samples `f(dx, dy)` at the centers of the pixels.
    pub fn sample(title: String, note: String, reach: f64, side: usize, f: impl Fn(f64, f64) -> [f32; 3]) -> Self {
        let at = |i: usize| (2.0 * (i as f64 + 0.5) / side as f64 - 1.0) * reach;
        let values = (0..side * side).map(|i| f(at(i % side), -at(i / side))).collect();
        Pattern { title, note, reach, side, values }
    }
}

/// The sRGB value of a linear one in [0, 1].
fn encode(linear: f32) -> u8 {
    (255.0 * srgb_encode(f64::from(linear.clamp(0.0, 1.0)))).round() as u8
}

/// Exposures of a pattern: the brightest value at the top of the scale, and this many times as much light,
/// for the side lobes.
const EXPOSURES: [f32; 2] = [1.0, 100.0];

/// A page: two exposures of each pattern, one above the other.
pub fn page(head: &Head, patterns: &[Pattern]) -> Figure {
    let side = patterns.iter().map(|p| p.side as i32).max().unwrap_or(0);
    let (column, row) = (side + LEFT, side + LINE + BELOW);
    let size = [patterns.len() as i32 * column + LEFT / 4, EXPOSURES.len() as i32 * row + LINE];
    with_head(head, size, |figure, x, y| {
        for (k, pattern) in patterns.iter().enumerate() {
            let at = Panel { x: x + LEFT + k as i32 * column, y: y + LINE, w: side, h: side };
            axes::above(figure, at, &pattern.title);
            for (r, exposure) in EXPOSURES.into_iter().enumerate() {
                draw(figure, Panel { y: at.y + r as i32 * row, ..at }, pattern, exposure);
            }
            let below = y + EXPOSURES.len() as i32 * row;
            figure.text_within(at.x + side / 2, below, column - 8, &pattern.note, Align::Center, GRAY);
        }
    })
}

fn draw(figure: &mut Figure, at: Panel, pattern: &Pattern, exposure: f32) {
    let top = pattern.values.iter().flatten().fold(0.0f32, |a, b| a.max(*b));
    let scale = if top > 0.0 { exposure / top } else { 0.0 };
    figure.pixels(at, |i, j| {
        let value = pattern.values[j as usize * pattern.side + i as usize];
        // Overexposed pixels keep their hue: the channel that clips first takes the others with it.
        let peak = value.iter().fold(0.0f32, |a, b| a.max(*b)) * scale;
        let dim = if peak > 1.0 { scale / peak } else { scale };
        value.map(|v| encode(v * dim))
    });
    figure.frame(at, INK);
    let ticks = linear(-pattern.reach, pattern.reach, 4.0);
    axes::below(figure, at, &ticks, "");
    axes::left(figure, at, &ticks, "");
    if exposure > 1.0 {
        figure.text(at.x + 8, at.y + 8, &format!("exposed {exposure} x"), Align::Left, [235, 235, 235]);
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
        let mut figure = Figure::new(60, 60);
        draw(&mut figure, Panel { x: 10, y: 10, w: 40, h: 40 }, &p, 1.0);
        let image = figure.raster();
        assert_eq!(image.get_pixel(45, 15).0, [255, 255, 255]);
        assert_eq!(image.get_pixel(15, 15).0, [0, 0, 255]);
        assert_eq!(image.get_pixel(45, 45).0, [255, 0, 0]);
        assert_eq!((encode(0.5), encode(2.0), encode(-1.0)), (188, 255, 0));
    }

    /// Light that is even over the spectrum is white, also where bands are many; single bands have their
    /// hues; light between two hues is in the gamut.
    #[test]
    fn even_light_is_white_and_bands_have_their_hues() {
        let day = Daylight::new();
        for v in day.rgb(&[0.5; BANDS]) {
            assert!((v - 0.5).abs() < 1e-5, "{v}");
        }
        let hue = |lambda: f32| {
            let at = |k: usize| (day.lambda_um[k] - lambda).abs();
            let k = (0..BANDS).min_by(|a, b| at(*a).total_cmp(&at(*b))).unwrap();
            let rgb = day.rgb(&std::array::from_fn(|i| f32::from(i == k)));
            assert!(rgb.iter().all(|v| *v >= 0.0));
            (0..3).max_by(|a, b| rgb[*a].total_cmp(&rgb[*b])).unwrap()
        };
        assert_eq!([0.45, 0.53, 0.65].map(hue), [2, 1, 0]);
    }
}
