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

#[cfg(test)]
mod tests {
    use crate::Film;
    use crate::film::{PixelSums, Sample};
    use crate::roulette::CutSums;

    /// A film with one sample a pixel: luminance and albedo of each, and whether it hits an object.
    fn film(pixels: &[(f32, f32, bool)]) -> Film {
        let mut film = Film::new(pixels.len() as u32, 1).unwrap();
        for (x, (light, albedo, is_hit)) in pixels.iter().enumerate() {
            let mut sums = PixelSums::default();
            let hit = is_hit.then_some(([0.0, 0.0, 1.0], 5.0));
            sums.add(&Sample { light: [*light; 3], albedo: [*albedo; 3], hit, cut: CutSums::default() });
            film.add(x as u32, 0, &sums, 1);
        }
        film.count(1);
        film
    }

    #[test]
    fn cloth_is_exposed_by_its_albedo() {
        let even = |light: f32, albedo: f32| film(&[(light, albedo, true); 200]).metered_exposure();
        for (light, albedo) in [(0.3, 1.0), (30.0, 0.2), (0.001, 0.05)] {
            let shown = light * even(light, albedo).exp2();
            let want = 0.5 * f32::powf(albedo, 0.7);
            assert!((shown / want - 1.0).abs() < 1e-4, "{light} {albedo}: {shown}, want {want}");
        }
        // A window behind the cloth does not count, nor does a single speck.
        let mut pixels = vec![(0.3, 0.5, true); 200];
        let plain = film(&pixels).metered_exposure();
        pixels.extend([(1e4, 0.0, false); 50]);
        assert_eq!(film(&pixels).metered_exposure(), plain);
        pixels[7].0 = 1e4;
        assert!((film(&pixels).metered_exposure() - plain).abs() < 1e-4);
        // Highlights on a tenth of the cloth are kept, where that costs less than a stop.
        for (bright, lower) in [(1.3f32, None), (100.0, Some(1.0f32))] {
            let pixels: Vec<_> = (0..200).map(|k| (if k % 10 == 0 { bright } else { 0.3 }, 0.8, true)).collect();
            let mean = 0.9 * 0.3 + 0.1 * bright;
            let plain = (0.5 * 0.8f32.powf(0.7) / mean).log2();
            let stops = film(&pixels).metered_exposure();
            let want = lower.map_or_else(|| plain.min(-bright.log2()), |lower| plain - lower);
            assert!((stops - want).abs() < 1e-3, "{bright}: {stops}, want {want}");
        }
        assert_eq!(film(&[(1.0, 0.5, false); 9]).metered_exposure(), 0.0);
    }
}
