//! From two photographs of a swatch to a cloth spec with error bars.
//!
//! One photograph shows the face, lit from the front; one has a lamp behind the cloth. The stages:
//!
//! 1. `spectrum`: weave and sett from the spectra of both pictures.
//! 2. `table`: cloths of several counts and twists are woven, and the mean light of blocks of both pictures
//!    is tabulated over roughness and absorption, with ply models from a family.
//! 3. `fit`: L-BFGS-B fits count, twist, roughness and absorption to the blocks, under priors of textile
//!    tables, with error bars.
//! 4. `uneven`: unevenness of the yarns and the lens's blur from the contrast of small squares.
//! 5. `report`: the spec, the numbers with their bars, and the fit's picture beside the photographs.

mod cloths;
mod fit;
mod geometry;
mod inputs;
mod photo;
mod report;
mod shoot;
mod spectrum;
mod table;
mod uneven;
mod words;

#[doc(hidden)]
pub use geometry::GEOMETRY_RULES;
pub use geometry::SwatchGeometry;
pub use inputs::{SwatchInputs, SwatchKnown};
pub use photo::{Photo, contrast, encode, luminance, png, profiles, streak_widths};
pub use report::{SwatchFigures, SwatchFit, SwatchNumber, SwatchUnknown, SwatchWeave};
pub use shoot::{Shot, blur};
pub use words::SwatchWords;

use crate::error::Error;
use crate::run::{Progress, Run, Stage};
use cloths::{SwatchCloth, SwatchFiber, SwatchNumbers};
use fit::{MASS_SD, Prior, SwatchData, SwatchSolution};
use plywave_textile::NamedWeave;
use spectrum::{WeaveGuess, guess_weaves};
use std::f64::consts::TAU;
use table::{LightTable, TableInputs, make_table, of_sigma};
use words::{TEX, check_known};

/// Stages that progress counts.
const STAGES: u64 = 100;
/// Prior of the logarithm of the sum of both covers, yarn widths over their spacing: of plain weaves, and of
/// those with floats (the cloths of `fabrics/cloths/` have 1.2 and 1.5 to 1.8).
const COVERS: [f64; 2] = [1.2, 1.6];
const COVER_SD: f64 = 0.25;
/// Deviations of the logarithms of a count that is given, of twist and of roughness from their usual values,
/// and of the absorption's coordinate from that of a medium dye.
const GIVEN_SD: f64 = 0.03;
const TWIST_SD: f64 = 0.3;
const ALPHA_SD: f64 = 0.5;
/// Deviation of the logarithm of the warp's tension over the weft's.
const TENSION_SD: f64 = 0.8;
const USUAL_SIGMA: f64 = 0.006;
const SIGMA_SD: f64 = 1.2;
/// Twist of yarns that have none by their label: what spreads the tangents of their filaments [turns/m], and
/// the deviation of its logarithm.
const FILAMENT_TURNS: f64 = 200.0;
const FILAMENT_SD: f64 = 0.8;
/// Deviations that errors of the model leave, such as a family's bundle in place of the yarn: measured on
/// fits of the first twelve cloths of `swatch_truth`. Of twist: of staple yarns and of filaments.
const MODEL_COUNT_SD: f64 = 0.15;
const MODEL_TWIST_SD: [f64; 2] = [0.2, 0.4];
const MODEL_TENSION_SD: f64 = 0.3;
const MODEL_ALPHA_SD: f64 = 0.25;
const MODEL_SIGMA_SD: f64 = 0.1;
/// Probability over that of the best from which a weave is fitted, and the most that are of each way of the
/// warp.
const LEAST_PROBABILITY: f64 = 0.1;
const WAYS_EACH: usize = 2;
/// Number of roughnesses in a table.
const ALPHAS: usize = 6;

/// The prior of the logarithm of the count [tex].
fn count_prior(known: &SwatchKnown, guess: &WeaveGuess, fiber: &SwatchFiber) -> Result<Prior, Error> {
    if let Some(tex) = known.tex {
        return Ok(Prior { mean: tex.ln(), sd: GIVEN_SD, model_sd: 0.0 });
    }
    let threads = guess.per_cm[0] + guess.per_cm[1];
    if let Some(g_per_m2) = known.g_per_m2 {
        // Yarns are longer than the cloth by some 7 %; the cost has the cloth's own crimp.
        let mean = (10.0 * g_per_m2 / (1.07 * threads)).clamp(TEX[0], TEX[1]).ln();
        return Ok(Prior { mean, sd: 0.12, model_sd: MASS_SD });
    }
    // Widths grow with the root of the count.
    let [_, radius_um] = fiber.radii_um(30.0)?;
    let cover = COVERS[usize::from(guess.weave != NamedWeave::Plain)];
    let tex = 30.0 * (cover * 1e4 / (threads * 2.0 * radius_um)).powi(2);
    Ok(Prior { mean: tex.clamp(TEX[0], TEX[1]).ln(), sd: 2.0 * COVER_SD, model_sd: MODEL_COUNT_SD })
}

/// Fits a cloth to two photographs.
///
/// # Errors
/// [`plywave::Error::Invalid`] for pictures of different sizes and for what the user knows, the errors of
/// weaving, and [`Error::Interrupted`].
pub fn fit_swatch(inputs: &SwatchInputs, run: &Run<'_>) -> Result<SwatchFit, Error> {
    let SwatchInputs { photos: [front, back], geometry, known } = inputs;
    check_known(known, "swatch", &|key| key.into())?;
    let invalid = |key: &str, value: String, hint: &str| {
        Error::Runtime(plywave::Error::Invalid { file: "swatch".into(), key: key.into(), value, hint: hint.into() })
    };
    if front.size != back.size {
        let value = format!("{} x {} and {} x {} pixels", front.size[0], front.size[1], back.size[0], back.size[1]);
        return Err(invalid("pictures", value, "give two pictures of one size, from one place of the camera"));
    }
    let exposure = match geometry.white_px {
        None => None,
        Some(rectangle) => Some(report::white_exposure(front, geometry, rectangle).ok_or_else(|| {
            invalid("white_px", format!("{rectangle:?}"), "give a patch inside the front picture that is not saturated")
        })?),
    };
    let tell = |name, done: usize, total: usize| {
        let done = STAGES * done as u64 / total.max(1) as u64;
        run.report(Progress { stage: Stage::Cloth(name), done, total: STAGES });
    };
    let go_on = || run.check_stop().is_ok();
    tell("weave and sett", 0, 1);
    let mut guesses = guess_weaves([front, back], geometry, known);
    let guess = guesses.first().cloned().ok_or_else(|| invalid("weave", "none".into(), "give --weave"))?;
    tell("weave and sett", 1, 1);
    let is_satin = matches!(guess.weave, NamedWeave::Satin { .. });
    let name = known.fiber.clone().unwrap_or_else(|| if is_satin { "polyester bright" } else { "cotton" }.into());
    let fiber = SwatchFiber::new(&name)?;
    // The spectrum hardly tells warp from weft: a twill turned by a quarter is the other twill with its setts
    // exchanged. Nor does it tell long floats from short ones. The profiles do.
    let mut ways: Vec<usize> = Vec::new();
    for (k, other) in guesses.iter().enumerate().filter(|(_, g)| g.probability > LEAST_PROBABILITY * guess.probability)
    {
        if ways.iter().filter(|way| guesses[**way].is_across == other.is_across).count() < WAYS_EACH {
            ways.push(k);
        }
    }
    let blocks = [front.blocks(geometry.white_px), back.blocks(None)];
    let aspect = front.size[1] as f64 / front.size[0] as f64;
    let data = SwatchData::new([&blocks[0], &blocks[1]], geometry, aspect, (exposure, known.g_per_m2));
    let mut fits = Vec::new();
    let mut failed = None;
    for (k, way) in ways.iter().enumerate() {
        let mut of_table = |done, total| tell("cloths and their light", k * total + done, ways.len() * total);
        match fit_way(inputs, (&guesses[*way], &fiber), (aspect, &data), &go_on, &mut of_table) {
            Ok(Some((table, solution))) => fits.push((*way, table, solution)),
            Ok(None) => {}
            Err(error @ Error::Interrupted { .. }) => return Err(error),
            Err(error) => failed = Some(error),
        }
    }
    // The posterior of those that were fitted, by the light as well.
    let total: f64 = fits.iter().map(|(way, ..)| guesses[*way].probability).sum();
    let unlikely =
        |fit: &(usize, LightTable, SwatchSolution)| fit.2.unlikely - guesses[fit.0].probability.max(1e-9).ln();
    fits.sort_by(|a, b| unlikely(a).total_cmp(&unlikely(b)));
    let costs: Vec<f64> = fits.iter().map(unlikely).collect();
    let weight = |cost: &f64| (costs[0] - cost).exp();
    let weights: f64 = costs.iter().map(weight).sum();
    for ((way, ..), cost) in fits.iter().zip(&costs) {
        guesses[*way].probability = total * weight(cost) / weights;
    }
    let Some((way, table, solution)) = fits.first() else {
        let hint = "no cloth gives such light; check the geometry, or give --weave, --ends-per-cm and --picks-per-cm";
        return Err(failed.unwrap_or_else(|| invalid("pictures", "no fit".into(), hint)));
    };
    tell("unevenness", 0, 1);
    let finished = finish(inputs, &fiber, &guesses[*way], (table, solution), &go_on)?;
    tell("unevenness", 1, 1);
    guesses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Ok(finished.with_guesses(&guesses))
}

/// Makes the table of a weave in its orientation and fits it.
fn fit_way(
    inputs: &SwatchInputs,
    (guess, fiber): (&WeaveGuess, &SwatchFiber),
    (aspect, data): (f64, &SwatchData),
    go_on: &(dyn Fn() -> bool + Sync),
    tell: &mut dyn FnMut(usize, usize),
) -> Result<Option<(LightTable, SwatchSolution)>, Error> {
    let count = count_prior(&inputs.known, guess, fiber)?;
    let is_staple = fiber.twist_factor > 0.0;
    let turns = match is_staple {
        true => Prior {
            mean: (fiber.twist_factor / (0.5 * count.mean).exp()).ln(),
            sd: TWIST_SD,
            model_sd: MODEL_TWIST_SD[0],
        },
        false => Prior { mean: FILAMENT_TURNS.ln(), sd: FILAMENT_SD, model_sd: MODEL_TWIST_SD[1] },
    };
    let tension = Prior { mean: 0.0, sd: TENSION_SD, model_sd: MODEL_TENSION_SD };
    let sigma = Prior { mean: of_sigma(USUAL_SIGMA), sd: SIGMA_SD, model_sd: MODEL_SIGMA_SD };
    let [low, high] = fiber.alphas().map(f64::ln);
    let alpha = Prior { mean: fiber.alpha.ln().clamp(low, high), sd: ALPHA_SD, model_sd: MODEL_ALPHA_SD };
    let twist_off = if is_staple { 0.4 } else { 1.2 };
    let max_turns = max_turns(fiber, count.mean)?.ln();
    let plain = WeaveGuess { weave: without_bands(&guess.weave), ..guess.clone() };
    let table_inputs = TableInputs {
        guess: &plain,
        fiber,
        geometry: &inputs.geometry,
        aspect,
        woven: [
            (count.mean, (1.3 * count.sd).clamp(0.1, 0.5)),
            (turns.mean.min(max_turns - twist_off), twist_off),
            (0.0, 1.2 * TENSION_SD),
        ],
        ln_alpha: (0..ALPHAS).map(|k| low + (high - low) * k as f64 / (ALPHAS - 1) as f64).collect(),
    };
    let table = make_table(&table_inputs, go_on, tell)?;
    let solution = fit::fit_table(&table, data, &[count, turns, tension, alpha, sigma, sigma, sigma]);
    Ok(solution.map(|solution| (table, solution)))
}

/// The weave with the same floats and the smallest repeat: the mean light of a twill in bands is the twill's.
fn without_bands(weave: &NamedWeave) -> NamedWeave {
    match weave {
        NamedWeave::Herringbone(order, _) | NamedWeave::Chevron(order, _) => {
            NamedWeave::Twill(order.clone(), plywave::spec::Handedness::Z)
        }
        NamedWeave::Houndstooth => NamedWeave::Twill(vec![2, 2], plywave::spec::Handedness::Z),
        other => other.clone(),
    }
}

/// Twist at which the fibers at the rim lean by 40 degrees, of the thickest yarn of a table [turns/m].
fn max_turns(fiber: &SwatchFiber, ln_tex: f64) -> Result<f64, Error> {
    let [_, radius_um] = fiber.radii_um((ln_tex + 0.5).exp())?;
    Ok(1e6 * 0.84 / (TAU * radius_um))
}

/// Weaves the fitted cloth, fits its unevenness, and collects the numbers.
fn finish(
    inputs: &SwatchInputs,
    fiber: &SwatchFiber,
    guess: &WeaveGuess,
    (table, solution): (&LightTable, &SwatchSolution),
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<SwatchFit, Error> {
    let x = solution.x;
    let numbers = SwatchNumbers {
        tex: x[0].exp(),
        turns_per_m: x[1].exp(),
        tension: x[2].exp(),
        alpha_fiber: x[3].exp(),
        srgb: None,
        uneven: None,
    };
    let cloth = SwatchCloth::new(guess, fiber, &numbers, go_on)?;
    let sigma = [4, 5, 6].map(|k| table::sigma_of(x[k]));
    let uneven = uneven::fit_uneven(inputs, &cloth, guess, sigma)?;
    report::finish(inputs, (fiber, guess), (table, solution), (&cloth, numbers, uneven))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spec of a fit is one that `plywave weave` reads, with the numbers that went in.
    #[test]
    fn specs_of_fits_are_read() {
        let guess = WeaveGuess {
            weave: NamedWeave::Plain,
            is_across: false,
            per_cm: [20.0, 18.0],
            sd: [0.01; 2],
            turn_rad: 0.0,
            probability: 1.0,
            score: 0.0,
        };
        let numbers = SwatchNumbers {
            tex: 30.0,
            turns_per_m: 700.0,
            tension: 1.5,
            alpha_fiber: 0.2,
            srgb: Some([0.5, 0.4, 0.3]),
            uneven: Some([0.1, 0.02, 20.0]),
        };
        let fiber = SwatchFiber::new("cotton").unwrap();
        let text = cloths::spec_text(&guess, &fiber, &numbers, &|key| format!("+- 1 of {key}"));
        let spec = plywave_textile::ClothSpec::parse(&text, "swatch").unwrap();
        let [warp, weft] = spec.yarns()[..] else { panic!("{text}") };
        assert_eq!((spec.per_cm, warp.tex(), warp.tension, weft.tension), ([Some(20.0), Some(18.0)], 30.0, 1.5, 1.0));
        assert_eq!((warp.fiber.spec.alpha_fiber, warp.fiber_twist.1), (0.2, 700.0));
        assert_eq!(warp.unevenness.map(|u| u.count_cv), Some(0.1));
    }
}
