//! Exposure of a picture by itself, as a photographer meters.

use crate::{Film, FilmView};

/// Brightness that the mean of a white cloth gets in the picture, linear.
const WHITE: f32 = 0.5;
/// Power of the albedo in the brightness of the mean: dark cloth is shown darker than white, but less so than
/// it is.
const POWER: f32 = 0.7;
/// Fraction of the pixels that may be brighter than the picture can show, and the most stops that it costs.
const CLIPPED: f32 = 0.01;
const MAX_STOPS: f32 = 1.0;
/// Range of the exposure [stops].
const RANGE: f32 = 20.0;

impl Film {
    /// Exposure [stops] that shows the cloth as its albedo says. Of the pixels that hit an object, the mean
    /// luminance becomes 0.5 A^0.7, where A is their mean albedo; the mean takes no pixel for brighter than
    /// one in a hundred is. Where more than one in a hundred of them would be clipped, the exposure is
    /// lowered until they are not, by one stop at most. 0 if no pixel hits an object or all are black.
    pub fn metered_exposure(&self) -> f32 {
        let pixels = (0..self.height()).flat_map(|y| (0..self.width()).map(move |x| (x, y)));
        let hits = pixels.filter(|(x, y)| self.depth(*x, *y) > 0.0);
        let (mut light, mut albedo) = (Vec::new(), 0.0f64);
        for (x, y) in hits {
            light.push(self.xyz(FilmView::Light, x, y)[1].max(0.0));
            albedo += f64::from(self.xyz(FilmView::Albedo, x, y)[1]);
        }
        if light.is_empty() {
            return 0.0;
        }
        let count = light.len();
        light.sort_by(f32::total_cmp);
        let bright = light[count - 1 - (CLIPPED * count as f32) as usize];
        let mean = light.iter().map(|l| f64::from(l.min(bright))).sum::<f64>() / count as f64;
        let albedo = (albedo / count as f64) as f32;
        if mean <= 0.0 || albedo <= 0.0 {
            return 0.0;
        }
        let stops = (WHITE * albedo.powf(POWER) / mean as f32).log2();
        let clipped = (stops + bright.max(f32::MIN_POSITIVE).log2()).clamp(0.0, MAX_STOPS);
        (stops - clipped).clamp(-RANGE, RANGE)
    }
}
