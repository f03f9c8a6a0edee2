//! The brightness of a cloth over the absorption of its fibers, in the meanings of [`ColorOf`].
//!
//! R and T are means over places and samples of the cloth as it is shaded by rays, scaled so that clear
//! fibers lose nothing.

use super::color_of::{ColorOf, LENGTH_UM, NODES, POWER, of_nodes, sigma_of, v_of};
use super::model::ClothModel;
use super::query::{ClothOptions, ClothQuery};
use crate::Bsdf;
use crate::color::AlbedoCurve;
use std::sync::Arc;

/// Samples a side.
const SAMPLES: usize = 1 << 14;
/// Nodes of the pile's curve; the reflectance falls with the root of a small absorption.
const PILE_NODES: usize = 65;
/// Sheets of the pile, beyond which it is as bright as without end.
const SHEETS: usize = 4000;
/// Cosine of 8 degrees.
const COS_8_DEG: f64 = 0.990_268;

impl ClothModel {
    /// As [`ClothModel::color_curve`], in another meaning. It takes tenths of a second but for the cloth's
    /// own and [`ColorOf::EvenSky`].
    pub fn color_curve_of(&self, of: ColorOf) -> AlbedoCurve {
        if of == self.color_of {
            return self.curve.clone();
        }
        let (gaps, slits) = (None, [None; 2]);
        let uneven = Arc::default();
        let rays = ClothModel { options: ClothOptions::RAYS, far: None, gaps, slits, uneven, ..self.clone() };
        curve(&rays, of)
    }
}

/// R and T at the nodes, and what of T passes between fibers.
struct Light {
    r: [f64; NODES],
    t: [f64; NODES],
    straight: f64,
}

impl Light {
    /// Between the nodes.
    fn at(&self, v: f64) -> [f64; 2] {
        let x = (1.0 - v.clamp(0.0, 1.0).powf(1.0 / POWER)) * (NODES - 1) as f64;
        let node = (x as usize).min(NODES - 2);
        let share = (v_of(node) - v) / (v_of(node) - v_of(node + 1));
        [&self.r, &self.t].map(|of| of[node] + share * (of[node + 1] - of[node]))
    }
}

/// R and T of one side, the face or the back: of views of the cosine given, or of the mean over views.
fn light(cloth: &ClothModel, is_face: bool, cosine: Option<f64>) -> Light {
    let sigma: [f32; NODES] = std::array::from_fn(|node| sigma_of(v_of(node)) as f32);
    let [a, b] = cloth.cell_um();
    let (mut r, mut t, mut passes) = ([0.0; NODES], [0.0; NODES], 0.0);
    for k in 0..SAMPLES {
        // An even sequence of seven numbers (Roberts 2018).
        let even = |step: f64| (0.5 + k as f64 * step).fract();
        let z = cosine.unwrap_or_else(|| even(0.911_592_353_5).sqrt().max(2e-3));
        let (sin, cos) = (std::f64::consts::TAU * even(0.831_000_618_9)).sin_cos();
        let across = (1.0 - z * z).max(0.0).sqrt();
        let up = if is_face { z } else { -z };
        let wo = [(across * cos) as f32, (across * sin) as f32, up as f32];
        let [first, second] = [even(0.757_533_810_0), even(0.690_562_028_7)];
        let at = [0, 1].map(|i| (first * a[i] + second * b[i]) as f32);
        let u = [0.629_511_064_9, 0.573_857_473_2, 0.523_124_084_6].map(|step| even(step) as f32);
        let query = ClothQuery { sigma_per_um: [Some(sigma); 2], ..ClothQuery::new(at, wo, [0.55; NODES]) };
        let bsdf = cloth.at(&query);
        let (straight, sample) = (bsdf.straight(), bsdf.sample(u));
        passes += f64::from(straight[0]);
        for i in 0..NODES {
            t[i] += f64::from(straight[i]);
            if let Some(sample) = sample.direction() {
                let half = if sample.w[2] * wo[2] >= 0.0 { &mut r } else { &mut t };
                half[i] += f64::from(sample.weight[i]);
            }
        }
    }
    // Clear fibers lose nothing.
    let per = 1.0 / (r[0] + t[0]).max(f64::MIN_POSITIVE);
    Light { r: r.map(|v| v * per), t: t.map(|v| v * per), straight: passes * per }
}

/// Reflectance of a sheet of these R and T, from above and from below, that lies on a pile.
fn on_pile([r, t]: [f64; 2], [from_below_r, from_below_t]: [f64; 2], pile: f64) -> f64 {
    r + t * pile * from_below_t / (1.0 - from_below_r * pile).max(1e-12)
}

/// Albedo under a sky all round at the nodes, of a cloth that is shaded by rays.
pub fn albedo(cloth: &ClothModel) -> [f64; NODES] {
    let sides = [true, false].map(|is_face| light(cloth, is_face, None));
    let scattered = |node: usize| sides.iter().map(|side| side.r[node] + side.t[node] - side.straight).sum::<f64>();
    // Clear fibers send out all that meets them.
    let met = scattered(0).max(f64::MIN_POSITIVE);
    std::array::from_fn(|node| (scattered(node) / met).clamp(0.0, 1.0))
}

/// The curve of a meaning; of a cloth that is shaded by rays.
fn curve(cloth: &ClothModel, of: ColorOf) -> AlbedoCurve {
    match of {
        ColorOf::EvenSky => cloth.even_sky.clone(),
        ColorOf::Reflected => of_nodes(&light(cloth, true, None).r),
        ColorOf::Folded => {
            let (near, face, back) =
                (light(cloth, true, Some(COS_8_DEG)), light(cloth, true, None), light(cloth, false, None));
            let pile = |node: usize| {
                // Dense towards clear fibers.
                let x = node as f64 / (PILE_NODES - 1) as f64;
                let v = 1.0 - x * x;
                let ([rn, tn], [rf, tf], [rb, tb]) = (near.at(v), face.at(v), back.at(v));
                // Of piles that begin with the face, and with the back, from the lowest sheet up.
                let (mut from_face, mut from_back) = (1.0, 1.0);
                for _ in 0..SHEETS {
                    (from_face, from_back) =
                        (on_pile([rf, tf], [rb, tb], from_back), on_pile([rb, tb], [rf, tf], from_face));
                }
                (v, on_pile([rn, tn], [rb, tb], from_back))
            };
            AlbedoCurve::of_nodes(LENGTH_UM, (0..PILE_NODES).map(pile))
        }
    }
}
