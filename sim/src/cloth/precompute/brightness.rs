//! Brightness of a cloth as a function of the absorption of its fibers, for each definition of color in
//! [`ColorOf`](plywave::cloth::ColorOf).
//!
//! The reflectance R and the transmittance T are means over places of the cell and sampled directions of the
//! cloth as shaded for rays. They are scaled so that clear fibers conserve energy.

use plywave::cloth::Brightness;
use plywave::cloth::color_of::{NODES, PILE_NODES, POWER, sigma_of, v_of, v_of_pile};
use plywave::{Bsdf, ClothModel, ClothQuery};

/// Samples of each side.
const SAMPLES: usize = 1 << 14;
/// Sheets of the pile; more of them do not change its reflectance.
const SHEETS: usize = 4000;
/// Cosine of 8 degrees, the angle of incidence of common spectrophotometers.
const COS_D8: f64 = 0.990_268;

/// R and T at the nodes of absorption, and the part of T that passes straight between fibers.
struct Light {
    r: [f64; NODES],
    t: [f64; NODES],
    straight: f64,
}

impl Light {
    /// R and T at the value `v`, interpolated between the nodes.
    fn at(&self, v: f64) -> [f64; 2] {
        let x = (1.0 - v.clamp(0.0, 1.0).powf(1.0 / POWER)) * (NODES - 1) as f64;
        let node = (x as usize).min(NODES - 2);
        let share = (v_of(node) - v) / (v_of(node) - v_of(node + 1));
        [&self.r, &self.t].map(|of| of[node] + share * (of[node + 1] - of[node]))
    }
}

/// R and T of one side, the face or the back, for views at this cosine or, with `None`, averaged over
/// cosine-weighted views.
fn light(cloth: &ClothModel, is_face: bool, cosine: Option<f64>) -> Light {
    let sigma: [f32; NODES] = std::array::from_fn(|node| sigma_of(v_of(node)) as f32);
    let [a, b] = cloth.cell_um();
    let (mut r, mut t, mut passes) = ([0.0; NODES], [0.0; NODES], 0.0);
    for k in 0..SAMPLES {
        // A low-discrepancy sequence in seven dimensions (Roberts 2018).
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
    // Clear fibers conserve energy.
    let per = 1.0 / (r[0] + t[0]).max(f64::MIN_POSITIVE);
    Light { r: r.map(|v| v * per), t: t.map(|v| v * per), straight: passes * per }
}

/// Reflectance of a sheet on a pile of reflectance `pile`, with multiple reflections between the two: R and T
/// of the sheet from above, then from below.
fn on_pile([r, t]: [f64; 2], [from_below_r, from_below_t]: [f64; 2], pile: f64) -> f64 {
    r + t * pile * from_below_t / (1.0 - from_below_r * pile).max(1e-12)
}

/// Albedo of the cloth under uniform light from all directions, the mean over both sides.
fn even_sky(sides: &[Light; 2]) -> [f64; NODES] {
    let scattered = |node: usize| sides.iter().map(|side| side.r[node] + side.t[node] - side.straight).sum::<f64>();
    // Clear fibers scatter all light that hits them.
    let hit = scattered(0).max(f64::MIN_POSITIVE);
    std::array::from_fn(|node| (scattered(node) / hit).clamp(0.0, 1.0))
}

/// Reflectance of a folded pile whose top sheet is viewed 8 degrees off the normal (`near`). Sheets show
/// their face and their back in turn.
fn folded(near: &Light, [face, back]: &[Light; 2]) -> [f64; PILE_NODES] {
    std::array::from_fn(|node| {
        let v = v_of_pile(node);
        let ([rn, tn], [rf, tf], [rb, tb]) = (near.at(v), face.at(v), back.at(v));
        // Reflectance of piles whose top is a face, and a back, built from the lowest sheet up.
        let (mut from_face, mut from_back) = (1.0, 1.0);
        for _ in 0..SHEETS {
            (from_face, from_back) = (on_pile([rf, tf], [rb, tb], from_back), on_pile([rb, tb], [rf, tf], from_face));
        }
        on_pile([rn, tn], [rb, tb], from_back).clamp(0.0, 1.0)
    })
}

/// Brightness of a cloth that is shaded for rays ([`plywave::ClothOptions::RAYS`]).
pub(super) fn brightness(cloth: &ClothModel) -> Brightness {
    let ((face, back), near) = rayon::join(
        || rayon::join(|| light(cloth, true, None), || light(cloth, false, None)),
        || light(cloth, true, Some(COS_D8)),
    );
    let both = [face, back];
    Brightness {
        even_sky: even_sky(&both),
        reflected: both[0].r.map(|r| r.clamp(0.0, 1.0)),
        folded: folded(&near, &both),
    }
}
