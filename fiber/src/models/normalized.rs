//! Albedo without absorption of a fiber whose lobes do not conserve energy, over latitude and offset. Its
//! inverse is the factor that scales the albedo to 1.
//!
//! The factor depends only on the incident light, so the shape of f, its sampler and its density are
//! unchanged, and so is the absorbed share of light. The scaled f is not reciprocal: swapping the two
//! directions changes it by the ratio of their factors. A symmetric factor `s(theta_i) s(theta_o)` that gives
//! the albedo 1 exists only for lobes without shifts. With the shifts of hair it would scale the lobes by
//! more than ten at the poles.

use crate::distributions::latitudes::{PARTS, cubic, measured, place};
use crate::range::invalid;
use plywave::Result;
use std::f32::consts::{FRAC_2_PI, FRAC_PI_2};

/// Number of nodes over the offset from 0 to 1. They are uniform in `1 - sqrt(1 - 2 gamma / pi)`, where gamma
/// = asin h, since the albedo varies most near the rim.
const OFFSETS: usize = 49;
/// Minimum albedo that is scaled to 1. A fiber that scatters less at some incidence has almost lost its lobes
/// beyond the pole there.
const MIN: f32 = 0.05;
/// Maximum error of a cubic through other latitudes at a measured albedo.
const MAX_MISSED: f64 = 1e-3;

/// Factors that scale the albedo to 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Factors {
    /// `[PARTS + 1]` factors of the far field.
    far: Vec<f32>,
    /// `[PARTS + 1][OFFSETS]` factors of the near field.
    near: Vec<f32>,
}

impl Factors {
    /// Factors of a fiber whose albedo without absorption is `albedo` at a latitude [rad] and an offset;
    /// `None` is the mean over all offsets.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if almost no light is scattered at some incidence; `model` and `key` name
    /// the parameter in the message.
    pub(crate) fn new(model: &str, key: &str, albedo: impl Fn(f32, Option<f32>) -> f32) -> Result<Factors> {
        let all = |theta: f32| -> Vec<f32> {
            std::iter::once(None).chain((0..OFFSETS).map(|j| Some(offset(j)))).map(|h| albedo(theta, h)).collect()
        };
        let nodes = measured(all, |row| row.iter().map(|a| f64::from(*a)).collect(), MAX_MISSED);
        for (node, row) in &nodes {
            if let Some(lowest) = row.iter().copied().filter(|a| a.is_nan() || *a < MIN).reduce(f32::min) {
                let degrees = crate::distributions::latitudes::latitude(*node).to_degrees();
                let hint = format!(
                    "at a latitude of {degrees:.1} degrees {:.1} % of the light are scattered, the rest leaves beyond the pole: use less shift or wider lobes, or leave it out",
                    100.0 * lowest
                );
                return Err(invalid(model, key, true, hint));
            }
        }
        let at = |node: usize, j: usize| {
            let albedo = cubic(&nodes, node).iter().map(|(k, w)| w * f64::from(nodes[*k].1[j])).sum::<f64>();
            (1.0 / albedo.max(f64::from(MIN))) as f32
        };
        Ok(Factors {
            far: (0..=PARTS).map(|node| at(node, 0)).collect(),
            near: (0..(PARTS + 1) * OFFSETS).map(|k| at(k / OFFSETS, 1 + k % OFFSETS)).collect(),
        })
    }

    /// The factor at a latitude [rad] and at the angle gamma of an offset [rad], both of either sign.
    #[inline]
    pub(crate) fn at(&self, theta: f32, gamma: Option<f32>) -> f32 {
        let (row, s) = place(theta, PARTS);
        let Some(gamma) = gamma else {
            return self.far[row] + s * (self.far[row + 1] - self.far[row]);
        };
        let from_rim = (1.0 - FRAC_2_PI * gamma.abs()).max(0.0).sqrt();
        let at = (1.0 - from_rim) * (OFFSETS - 1) as f32;
        let first = (at as usize).saturating_sub(1).min(OFFSETS - 4);
        // The cubic through four nodes, at t = 0, 1, 2, 3.
        let t = at - first as f32;
        let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
        let weights = [b * c * d * (-1.0 / 6.0), a * c * d * 0.5, a * b * d * -0.5, a * b * c * (1.0 / 6.0)];
        let of = |row: usize| -> f32 {
            let nodes = &self.near[row * OFFSETS + first..][..4];
            (0..4).map(|k| weights[k] * nodes[k]).sum()
        };
        let (low, high) = (of(row), of(row + 1));
        low + s * (high - low)
    }
}

/// Offset of a node.
fn offset(j: usize) -> f32 {
    let from_rim = 1.0 - j as f32 / (OFFSETS - 1) as f32;
    (FRAC_PI_2 * (1.0 - from_rim * from_rim)).sin()
}
