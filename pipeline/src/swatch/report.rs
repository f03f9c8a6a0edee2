//! What a fit hands back: the spec with a bar at each number, the numbers as data, and the fit's pictures
//! beside the photographs.

use super::cloths::{SwatchCloth, SwatchFiber, SwatchNumbers, spec_text};
use super::fit::SwatchSolution;
use super::geometry::{SwatchGeometry, unit};
use super::inputs::SwatchInputs;
use super::photo::{Photo, contrast, encode, luminance, png, profiles, streak_widths};
use super::shoot::{Shot, blur};
use super::spectrum::WeaveGuess;
use super::table::{LightTable, UNKNOWNS, sigma_of};
use super::uneven::Unevenness;
use crate::error::Error;
use plywave::cloth::{ClothOptions, YarnColor};
use plywave::color::srgb_encode;
use plywave_wave::correlation;
use serde::Serialize;
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::TAU;

/// Samples of a pixel of the fit's pictures, in two halves.
const SAMPLES: u32 = 8;
/// Luminance of the middle of a picture that is written.
const GRAY: f32 = 0.2;

/// A number with its bar.
#[derive(Clone, Debug, Serialize)]
pub struct SwatchNumber {
    /// Name with unit, as in a spec where the spec has it.
    pub name: &'static str,
    /// The value.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
    /// What it comes from.
    pub from: &'static str,
}

/// An unknown of the fit with both of its bars.
#[derive(Clone, Debug, Serialize)]
pub struct SwatchUnknown {
    /// Name.
    pub name: &'static str,
    /// Its value: a logarithm.
    pub x: f64,
    /// Standard deviation by the curvature of the cost.
    pub sd_curvature: f64,
    /// Values of the refits to resampled parts of the pictures.
    pub refits: Vec<f64>,
}

/// Names of the unknowns.
const UNKNOWN: [&str; UNKNOWNS] =
    ["count", "twist", "tension", "alpha_fiber", "sigma_red", "sigma_green", "sigma_blue"];

/// Figures of a light, of the photograph and of the fit.
#[derive(Clone, Debug, Serialize)]
pub struct SwatchFigures {
    /// `front` or `back`.
    pub light: &'static str,
    /// Correlation of the profiles across and down.
    pub correlation: [f64; 2],
    /// Width of the streak at half of its peak, across and down [mm]; `null`: wider than the picture.
    pub photo_width_mm: [Option<f64>; 2],
    /// That of the fit.
    pub fit_width_mm: [Option<f64>; 2],
    /// Contrast of squares of 1, 2, 4 and 8 pixels.
    pub photo_contrast: [f64; 4],
    /// That of the fit.
    pub fit_contrast: [f64; 4],
}

/// A weave with its probability.
#[derive(Clone, Debug, Serialize)]
pub struct SwatchWeave {
    /// Its name.
    pub weave: String,
    /// Whether the warp runs across the picture.
    pub is_across: bool,
    /// Ends and picks per centimeter.
    pub per_cm: [f64; 2],
    /// Posterior probability among the weaves that were compared.
    pub probability: f64,
}

/// A fitted swatch.
#[derive(Clone, Debug, Serialize)]
pub struct SwatchFit {
    /// The cloth spec.
    pub spec: String,
    /// Numbers with their bars.
    pub numbers: Vec<SwatchNumber>,
    /// The weaves that were compared, the most probable first.
    pub weaves: Vec<SwatchWeave>,
    /// Whether the warp runs across the picture.
    pub is_across: bool,
    /// Turn of the yarns from the axes of the picture [rad].
    pub turn_rad: f64,
    /// The fiber that was assumed or given.
    pub fiber: String,
    /// Root mean square of the residuals of the blocks, relative.
    pub rms: f64,
    /// Cost of the fit, and evaluations of it.
    pub cost: f64,
    /// Evaluations of the cost.
    pub evaluations: usize,
    /// `[front, back]`: logarithms of what the light of the cloth is multiplied with.
    pub exposures: [f64; 2],
    /// The unknowns in the coordinates of the fit.
    pub unknowns: Vec<SwatchUnknown>,
    /// Figures of both lights.
    pub figures: Vec<SwatchFigures>,
    /// What to know, one line each.
    pub notes: Vec<String>,
    /// PNG file: photographs above, the fit below, front on the left and back-lit on the right.
    #[serde(skip)]
    pub picture: Vec<u8>,
}

impl SwatchFit {
    /// The number of this name.
    pub fn number(&self, name: &str) -> Option<&SwatchNumber> {
        self.numbers.iter().find(|number| number.name == name)
    }

    /// With the weaves that were compared.
    pub(super) fn with_guesses(mut self, guesses: &[WeaveGuess]) -> SwatchFit {
        let weave = |g: &WeaveGuess| SwatchWeave {
            weave: g.weave.to_string(),
            is_across: g.is_across,
            per_cm: g.per_cm,
            probability: g.probability,
        };
        self.weaves = guesses.iter().filter(|g| g.probability > 0.005).map(weave).collect();
        let first = self.weaves.first().map(|w| w.weave.clone()).unwrap_or_default();
        let sure: f64 = self.weaves.iter().filter(|w| w.weave == first).map(|w| w.probability).sum();
        if sure < 0.9 {
            self.notes
                .push(format!("the weave is {first} with a probability of {sure:.2}; give --weave if you know it"));
        }
        self
    }
}

/// Logarithm of the exposure of the front picture from a white patch: what multiplies the light of a cloth.
pub(super) fn white_exposure(
    photo: &Photo,
    geometry: &SwatchGeometry,
    [left, top, right, bottom]: [f64; 4],
) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in top as usize..=bottom as usize {
        for column in left as usize..=right as usize {
            if column >= photo.size[0] || row >= photo.size[1] || photo.is_saturated[row * photo.size[0] + column] {
                return None;
            }
            let at = photo.place_mm(geometry, [column as f64, row as f64]);
            let lamp = geometry.lamp_mm(false);
            let to_lamp = [lamp[0] - at[0], lamp[1] - at[1], lamp[2]];
            let squared: f64 = to_lamp.iter().map(|v| v * v).sum();
            let lens = f64::from(geometry.lens(geometry.to_camera(at)));
            let light = geometry.white_reflectance / std::f64::consts::PI * f64::from(unit(to_lamp)[2]);
            sum += f64::from(luminance(photo.rgb[row * photo.size[0] + column]))
                / (lens * light * geometry.camera_mm.powi(2) / squared);
            count += 1.0;
        }
    }
    (count > 0.0 && sum > 0.0).then(|| (sum / count).ln())
}

/// Collects the numbers, renders the fit, and writes the spec.
pub(super) fn finish(
    inputs: &SwatchInputs,
    (fiber, guess): (&SwatchFiber, &WeaveGuess),
    (table, solution): (&LightTable, &SwatchSolution),
    (cloth, numbers, uneven): (&SwatchCloth, SwatchNumbers, Unevenness),
) -> Result<SwatchFit, Error> {
    let model = cloth.model(&ClothOptions::default())?;
    let curve = model.color_curve();
    let color = |shift: f64| -> [f64; 3] {
        [4, 5, 6].map(|k| srgb_encode(curve.albedo(sigma_of(solution.x[k] + shift * solution.sd[k])).clamp(0.0, 1.0)))
    };
    let (middle, darker, lighter) = (color(0.0), color(1.0), color(-1.0));
    let numbers = SwatchNumbers { srgb: Some(middle), uneven: Some(uneven.values), ..numbers };
    let list = list(fiber, guess, (table, solution), (&numbers, &uneven), [middle, darker, lighter])?;
    let bar = |key: &str| -> String {
        let of = |name: &str| list.iter().find(|n| n.name == name).map(|n| n.sd);
        let text = |sd: Option<f64>, unit: &str| sd.map_or(String::new(), |sd| format!("+- {}{unit}", digits(sd)));
        match key {
            "kind" => format!("probability {:.2}", guess.probability),
            "ends_per_cm" | "picks_per_cm" | "tension" | "count_cv" | "spacing_cv" | "uneven_mm" => text(of(key), ""),
            "count" => text(of("count_tex"), " tex"),
            "twist" => text(of("twist_per_m"), "/m"),
            "fiber" => format!("alpha_fiber {}", text(of("alpha_fiber"), "")),
            "color" => {
                let of = ["color_red", "color_green", "color_blue"].map(|name| of(name).unwrap_or(0.0));
                format!("+- [{:.3}, {:.3}, {:.3}]", of[0], of[1], of[2])
            }
            _ => String::new(),
        }
    };
    let spec = spec_text(guess, fiber, &numbers, &bar);
    let shaded = cloth.uneven_model(&numbers, &ClothOptions::default())?;
    let shaded = shaded.with_colors([YarnColor::Srgb(middle.map(|v| v as f32)); 2], shaded.color_of());
    let (mut figures, mut pictures) = (Vec::new(), Vec::new());
    for (k, light) in ["front", "back"].into_iter().enumerate() {
        let photo = &inputs.photos[k];
        let size = photo.size;
        let turn_rad = guess.turn_rad as f32 + if guess.is_across { FRAC_PI_2 } else { 0.0 };
        let shot = Shot {
            cloth: &shaded,
            turn_rad,
            geometry: &inputs.geometry,
            size,
            part: [0, 0, size[0], size[1]],
            samples: SAMPLES / 2,
            seed: 3,
        };
        let halves = [3, 4].map(|seed| blur(size, &Shot { seed, ..shot }.render(k == 1), uneven.blur_px as f32));
        let mean: Vec<[f32; 3]> =
            halves[0].iter().zip(&halves[1]).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect();
        let fit = Photo { size, is_saturated: vec![false; mean.len()], rgb: mean };
        let [theirs, ours] = [photo, &fit].map(|of| profiles(size, &of.luminances()));
        let mm = inputs.geometry.seen_mm() / size[0] as f64;
        let widths = |photo: &Photo| streak_widths(size, &photo.luminances()).map(|w| w.map(|w| w * mm));
        let [a, b] = halves.each_ref().map(|half| half.iter().map(|rgb| luminance(*rgb)).collect::<Vec<f32>>());
        let values = photo.luminances();
        figures.push(SwatchFigures {
            light,
            correlation: [0, 1].map(|way: usize| correlation(&theirs[way], &ours[way])),
            photo_width_mm: widths(photo),
            fit_width_mm: widths(&fit),
            photo_contrast: contrast(size, [&values, &values]),
            fit_contrast: contrast(size, [&a, &b]),
        });
        pictures.push(fit);
    }
    let unknown = |(k, name): (usize, &&'static str)| SwatchUnknown {
        name,
        x: solution.x[k],
        sd_curvature: solution.curvature[(k, k)].max(0.0).sqrt(),
        refits: solution.refits.iter().map(|x| x[k]).collect(),
    };
    let notes = match inputs.known.fiber {
        Some(_) => Vec::new(),
        None => vec![format!("the fiber is taken to be {}; give --fiber if you know it", fiber.name)],
    };
    Ok(SwatchFit {
        spec,
        numbers: list,
        weaves: Vec::new(),
        is_across: guess.is_across,
        turn_rad: guess.turn_rad,
        fiber: fiber.name.clone(),
        rms: solution.rms,
        cost: solution.cost,
        evaluations: solution.evaluations,
        exposures: solution.exposures,
        unknowns: UNKNOWN.iter().enumerate().map(unknown).collect(),
        figures,
        notes,
        picture: beside(&inputs.photos, &pictures)?,
    })
}

/// Two digits of a bar.
fn digits(sd: f64) -> String {
    if sd <= 0.0 || !sd.is_finite() {
        return "0".into();
    }
    let places = (1.0 - sd.log10().floor()).clamp(0.0, 8.0) as usize;
    format!("{sd:.places$}")
}

/// The numbers with their bars.
fn list(
    fiber: &SwatchFiber,
    guess: &WeaveGuess,
    (table, solution): (&LightTable, &SwatchSolution),
    (numbers, uneven): (&SwatchNumbers, &Unevenness),
    [middle, darker, lighter]: [[f64; 3]; 3],
) -> Result<Vec<SwatchNumber>, Error> {
    let (x, sd) = (&solution.x, &solution.sd);
    let (profile, spectrum, squares) = ("profiles and chroma", "spectrum", "contrast of squares");
    let mut list = Vec::new();
    let mut add = |name, value, sd, from| list.push(SwatchNumber { name, value, sd, from });
    for (k, name) in ["ends_per_cm", "picks_per_cm"].into_iter().enumerate() {
        add(name, guess.per_cm[k], guess.per_cm[k] * guess.sd[k], spectrum);
    }
    add("count_tex", numbers.tex, numbers.tex * sd[0], "openness, mass or cover");
    add("twist_per_m", numbers.turns_per_m, numbers.turns_per_m * sd[1], profile);
    add("tension", numbers.tension, numbers.tension * sd[2], profile);
    add("alpha_fiber", numbers.alpha_fiber, numbers.alpha_fiber * sd[3], profile);
    for (k, name) in ["sigma_red_per_um", "sigma_green_per_um", "sigma_blue_per_um"].into_iter().enumerate() {
        let of = |shift: f64| sigma_of(x[4 + k] + shift * sd[4 + k]);
        add(name, of(0.0), (of(1.0) - of(0.0)).max(of(0.0) - of(-1.0)), profile);
    }
    for (k, name) in ["color_red", "color_green", "color_blue"].into_iter().enumerate() {
        add(name, middle[k], (lighter[k] - middle[k]).max(middle[k] - darker[k]).max(0.005), profile);
    }
    for (k, name) in ["count_cv", "spacing_cv", "uneven_mm"].into_iter().enumerate() {
        add(name, uneven.values[k], uneven.sd[k], squares);
    }
    // What follows, with bars by differences.
    let measures = table.measures(x);
    let (mut up, mut down) = (*x, *x);
    up[0] += sd[0];
    down[0] -= sd[0];
    let [up, down] = [table.measures(&up), table.measures(&down)];
    let setts = guess.sd[0].hypot(guess.sd[1]) * std::f64::consts::FRAC_1_SQRT_2;
    let mass_sd = (0.5 * (up.g_per_m2 - down.g_per_m2)).hypot(measures.g_per_m2 * setts);
    add("g_per_m2", measures.g_per_m2, mass_sd, "count and sett");
    let [_, radius_um] = fiber.radii_um(numbers.tex)?;
    add("yarn_diameter_um", 2.0 * radius_um, radius_um * sd[0], "count");
    add("yarn_width_um", measures.width_um, (0.5 * (up.width_um - down.width_um)).abs(), "count and sett");
    add("thickness_um", measures.thickness_um, (0.5 * (up.thickness_um - down.thickness_um)).abs(), "count and sett");
    add("openness", measures.openness, (0.5 * (up.openness - down.openness)).abs().max(1e-4), "lamp's image");
    let tangent = TAU * 1e-6 * radius_um * numbers.turns_per_m;
    let lean = tangent.atan();
    add("twist_angle_deg", lean.to_degrees(), (tangent * sd[1] / (1.0 + tangent * tangent)).to_degrees(), profile);
    add("lens_blur_px", uneven.blur_px, uneven.blur_sd_px, squares);
    Ok(list)
}

/// Photographs above, pictures of the fit below, each as bright as its photograph.
fn beside(photos: &[Photo; 2], fits: &[Photo]) -> Result<Vec<u8>, Error> {
    let [width, height] = photos[0].size;
    let median = |photo: &Photo| {
        let mut all = photo.luminances();
        all.sort_by(f32::total_cmp);
        all[all.len() / 2].max(1e-9)
    };
    let mut codes = vec![[0u8; 3]; 4 * width * height];
    for (k, (photo, fit)) in photos.iter().zip(fits).enumerate() {
        for (row_of, of) in [photo, fit].into_iter().enumerate() {
            let scale = GRAY / median(of);
            for (i, rgb) in of.rgb.iter().enumerate() {
                let (x, y) = (k * width + i % width, row_of * height + i / width);
                codes[y * 2 * width + x] = rgb.map(|v| encode(scale * v));
            }
        }
    }
    let failed = |e: png::EncodingError| Error::Export { file: "picture of the fit".into(), what: e.to_string() };
    png([2 * width, 2 * height], &codes).map_err(failed)
}
