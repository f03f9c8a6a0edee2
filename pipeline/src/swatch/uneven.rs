//! Unevenness of the yarns and the blur of the lens, from the contrast of small squares.
//!
//! Variances add: of an even cloth's weave, of the count's variation and of the places of the yarns.
//! Patches of the fitted cloth are rendered even, with either kind of unevenness, and blurred; shares
//! and blurs of a grid are weighed by how well they match the photographs' contrast at 1 to 8 pixels in
//! both lights, and their means and deviations are the result.

use super::cloths::{SwatchCloth, SwatchNumbers};
use super::geometry::SwatchGeometry;
use super::inputs::SwatchInputs;
use super::photo::{contrast, luminance};
use super::shoot::{Shot, blur};
use super::spectrum::WeaveGuess;
use crate::error::Error;
use plywave::cloth::{ClothOptions, YarnColor};
use std::f32::consts::FRAC_PI_2;

/// Blurs that are tried: standard deviations [pixels].
const BLURS: [f32; 8] = [0.0, 0.3, 0.45, 0.6, 0.75, 0.9, 1.1, 1.4];
/// Unevenness of the patches, and the length over which it changes [mm].
const COUNT_CV: f64 = 0.15;
const SPACING_CV: f64 = 0.04;
const LENGTHS_MM: [f64; 2] = [5.0, 20.0];
/// Side of a patch [pixels], and samples of a pixel, in two halves.
const PATCH: usize = 128;
const SAMPLES: u32 = 16;
/// Relative deviation of a contrast: of the patch's size, and of what the model leaves out.
const CONTRAST_SD: f64 = 0.15;
/// Priors of both kinds, means and deviations: ring-spun yarns have a count that varies by 10 to 20 %.
const PRIORS: [[f64; 2]; 2] = [[0.13, 0.06], [0.02, 0.02]];
/// Deviations that the model leaves, measured as those of the other numbers: of count, places, length and
/// blur, at least half of the steps that are tried.
const MODEL_SD: [f64; 4] = [0.03, 0.015, 5.0, 0.08];

/// Unevenness with its bars.
#[derive(Clone, Copy, Debug)]
pub struct Unevenness {
    /// Variation of the count, of places, and the length [mm]: values and standard deviations.
    pub values: [f64; 3],
    /// Their standard deviations.
    pub sd: [f64; 3],
    /// Blur of the lens [pixels], and its deviation.
    pub blur_px: f64,
    /// Standard deviation of the blur [pixels].
    pub blur_sd_px: f64,
}

/// The part of a picture in which contrast is measured: its middle for the front picture, and beside the
/// lamp's image for the other.
fn part(size: [usize; 2], is_back: bool) -> [usize; 4] {
    let [width, height] = size.map(|side| PATCH.min(side / 32 * 32));
    let left = (size[0] - width) / 2;
    let middle = (size[1] - height) / 2;
    let top = if is_back { (middle + size[1] / 4).min(size[1] - height) } else { middle };
    [left, top, left + width, top + height]
}

/// Renders the patch of a light, in two halves of the samples.
fn patches(
    cloth: &plywave::ClothModel,
    guess: &WeaveGuess,
    geometry: &SwatchGeometry,
    size: [usize; 2],
    is_back: bool,
) -> [Vec<[f32; 1]>; 2] {
    let turn_rad = guess.turn_rad as f32 + if guess.is_across { FRAC_PI_2 } else { 0.0 };
    [1, 2].map(|seed| {
        let part = part(size, is_back);
        let shot = Shot { cloth, turn_rad, geometry, size, part, samples: SAMPLES / 2, seed };
        shot.render(is_back).into_iter().map(|rgb| [luminance(rgb)]).collect()
    })
}

fn flat(picture: &[[f32; 1]]) -> Vec<f32> {
    picture.iter().map(|v| v[0]).collect()
}

/// Fits unevenness and blur.
///
/// # Errors
/// Those of a cloth's model.
pub fn fit_uneven(
    inputs: &SwatchInputs,
    cloth: &SwatchCloth,
    guess: &WeaveGuess,
    sigma: [f64; 3],
) -> Result<Unevenness, Error> {
    let size = inputs.photos[0].size;
    let measured: [[f64; 4]; 2] = [0, 1].map(|k| {
        let [left, top, right, bottom] = part(size, k == 1);
        let values: Vec<f32> = (top..bottom)
            .flat_map(|row| (left..right).map(move |column| row * size[0] + column))
            .map(|i| luminance(inputs.photos[k].rgb[i]))
            .collect();
        contrast([right - left, bottom - top], [&values, &values])
    });
    // `[unevenness][light][blur][square]`: variances.
    let variances = |uneven: Option<[f64; 3]>| -> Result<[[[f64; 4]; BLURS.len()]; 2], Error> {
        let numbers = SwatchNumbers { tex: 1.0, turns_per_m: 0.0, tension: 1.0, alpha_fiber: 0.1, srgb: None, uneven };
        let model = cloth.uneven_model(&numbers, &ClothOptions::default())?;
        let gray = luminance(sigma.map(|s| s as f32));
        let model = model.with_colors([YarnColor::Sigma(gray); 2], model.color_of());
        Ok([false, true].map(|is_back| {
            let halves = patches(&model, guess, &inputs.geometry, size, is_back);
            let [left, top, right, bottom] = part(size, is_back);
            let of = [right - left, bottom - top];
            BLURS.map(|sd| {
                let [a, b] = halves.each_ref().map(|half| flat(&blur(of, half, sd)));
                contrast(of, [&a, &b]).map(|c| c * c)
            })
        }))
    };
    let even = variances(None)?;
    // Costs with what they are costs of.
    let mut all: Vec<(f64, [f64; 4])> = Vec::new();
    for mm in LENGTHS_MM {
        let of_count = variances(Some([COUNT_CV, 0.0, mm]))?;
        let of_place = variances(Some([0.0, SPACING_CV, mm]))?;
        for (at, blur_px) in BLURS.iter().enumerate() {
            let grid = |k: usize| 0.02 * k as f64;
            for i in 0..=20 {
                for j in 0..=20 {
                    // Shares of the patches' variances.
                    let [count, place] = [grid(i) / COUNT_CV, 0.3 * grid(j) / SPACING_CV];
                    let off = |k: usize, x: f64| 0.5 * ((x - PRIORS[k][0]) / PRIORS[k][1]).powi(2);
                    let mut cost = off(0, grid(i)) + off(1, 0.3 * grid(j));
                    for light in 0..2 {
                        for k in 0..4 {
                            let e = even[light][at][k];
                            let c = (of_count[light][at][k] - e).max(0.0);
                            let p = (of_place[light][at][k] - e).max(0.0);
                            let variance: f64 = e + count * count * c + place * place * p;
                            let fitted = variance.max(1e-12).sqrt();
                            cost += 0.5 * ((fitted / measured[light][k].max(1e-6)).ln() / CONTRAST_SD).powi(2);
                        }
                    }
                    all.push((cost, [grid(i), 0.3 * grid(j), mm, f64::from(*blur_px)]));
                }
            }
        }
    }
    Ok(posterior(&all))
}

/// Means and deviations by the weights `exp(-cost)`.
fn posterior(all: &[(f64, [f64; 4])]) -> Unevenness {
    let least = all.iter().map(|(cost, _)| *cost).fold(f64::INFINITY, f64::min);
    let total: f64 = all.iter().map(|(cost, _)| (least - cost).exp()).sum();
    let mean =
        |of: &dyn Fn(&[f64; 4]) -> f64| all.iter().map(|(cost, x)| (least - cost).exp() * of(x)).sum::<f64>() / total;
    let means: [f64; 4] = std::array::from_fn(|k| mean(&|x| x[k]));
    let sd: [f64; 4] = std::array::from_fn(|k| mean(&|x| (x[k] - means[k]).powi(2)).sqrt().hypot(MODEL_SD[k]));
    let [count_cv, spacing_cv, mm, blur_px] = means;
    Unevenness { values: [count_cv, spacing_cv, mm], sd: [sd[0], sd[1], sd[2]], blur_px, blur_sd_px: sd[3] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two equally good places: their mean, and half of their distance.
    #[test]
    fn bars_are_those_of_the_weights() {
        let found = posterior(&[(3.0, [0.1, 0.0, 20.0, 1.0]), (3.0, [0.2, 0.06, 20.0, 1.0]), (60.0, [9.0; 4])]);
        let bars: [f64; 3] = [0.05, 0.03, 0.0];
        assert!((found.values[0] - 0.15).abs() < 1e-9, "{found:?}");
        for k in 0..3 {
            assert!((found.sd[k] - bars[k].hypot(MODEL_SD[k])).abs() < 1e-9, "{found:?}");
        }
    }
}
