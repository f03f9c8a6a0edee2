//! The light that a color describes, and the cloth's brightness over the absorption of its fibers in each
//! of these meanings.
//!
//! All are of a cloth whose yarns all have the same absorption, at nodes of it:
//!
//! - under a sky all round, light that was scattered over the light that met fibers; cloth files have it;
//! - reflected: R of the cloth's face, mean over views by their cosine, of light that is even over the
//!   viewer's half;
//! - folded: R of a pile of sheets, face up and face down in turn, seen 8 degrees off the normal under light
//!   that is even over the viewer's half, as a d/8 spectrophotometer has it. Light between sheets is taken as
//!   even: with R and T of a sheet from either side and X, Y the reflectances of piles that begin with the
//!   other side, `Y = R_f + T_f X T_b / (1 - R_b X)`, and alike for X; of a pile without end that neither
//!   absorbs nor lets through, 1.
//!
//! R and T are means over places and samples of the cloth as it is shaded by rays, clear fibers' scaled to
//! lose nothing.

use super::model::ClothModel;
use super::query::ClothQuery;
use crate::Bsdf;
use crate::color::AlbedoCurve;
use serde::{Deserialize, Serialize};

/// Light that a color describes. In each meaning all yarns count as if they had it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorOf {
    /// The cloth's fibers under a sky all round: reflected and transmitted light over the light that meets
    /// fibers.
    #[default]
    EvenSky,
    /// The cloth's face, lit from the viewer's side, with dark behind it: the mean over views.
    Reflected,
    /// The cloth folded until no light comes through, under even light 8 degrees off the normal (d/8), as
    /// textile labs read it.
    Folded,
}

impl ColorOf {
    /// As specs have it.
    pub fn name(self) -> &'static str {
        match self {
            ColorOf::EvenSky => "even_sky",
            ColorOf::Reflected => "reflected",
            ColorOf::Folded => "folded",
        }
    }
}

/// Nodes of absorption at which R and T are found, dense towards infinite absorption in
/// `v = 1 / (1 + sigma L)` with L = 150 um: at 0.1 and 1 per um a cloth's reflectance differs by a factor of
/// two.
pub const NODES: usize = 22;
/// v falls by this power of the node.
const POWER: f64 = 1.5;
/// Absorption of the last node [1/um], for an infinite one.
const DARKEST: f64 = 3.0;
/// Length L [um].
const LENGTH_UM: f64 = 150.0;
/// Samples a side.
const SAMPLES: usize = 1 << 14;
/// Nodes of the pile's curve; the reflectance falls with the root of a small absorption.
const PILE_NODES: usize = 65;
/// Sheets of the pile, beyond which it is as bright as without end.
const SHEETS: usize = 4000;
/// Cosine of 8 degrees.
const COS_8_DEG: f64 = 0.990_268;

/// Absorption at `1 / (1 + sigma L)`.
fn sigma_of(v: f64) -> f64 {
    if v > 0.0 { ((1.0 / v - 1.0) / LENGTH_UM).min(DARKEST) } else { DARKEST }
}

fn v_of(node: usize) -> f64 {
    (1.0 - node as f64 / (NODES - 1) as f64).powf(POWER)
}

/// The curve of values at the nodes.
pub(crate) fn of_nodes(values: &[f64; NODES]) -> AlbedoCurve {
    AlbedoCurve::of_nodes(LENGTH_UM, values.iter().enumerate().map(|(node, value)| (v_of(node), *value)))
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
pub(crate) fn curve(cloth: &ClothModel, of: ColorOf) -> AlbedoCurve {
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
