//! The longitudinal lobe of light between fibers: `g(theta_o - mean) cos theta_o / G`, whose integral over
//! the latitudes of the sphere is 1 at every mean and width.

use crate::models::khungurn::Normalizer;
use std::f32::consts::{FRAC_PI_2, TAU};

/// Minimum and maximum width [rad].
pub(crate) const WIDTHS: [f32; 2] = [0.005, 10.0];
/// Numbers of nodes over the distance from the pole, 0 to 8 widths, and over the logarithm of the width.
const ACROSS: usize = 129;
const WIDE: usize = 65;

/// G divided by its form far from the poles, `beta sqrt(2 pi) (1 + exp(-2 beta^2) cos 2 theta) / 2`. The
/// ratio is smooth in both axes, and bilinear interpolation is accurate to 1e-3.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LobeTable {
    ratio: Vec<f32>,
}

impl LobeTable {
    pub(crate) fn new() -> LobeTable {
        let span = f64::from(WIDTHS[1] / WIDTHS[0]).ln();
        let mut ratio = Vec::with_capacity(ACROSS * WIDE);
        for j in 0..WIDE {
            let width = f64::from(WIDTHS[0]) * (span * j as f64 / (WIDE - 1) as f64).exp();
            for k in 0..ACROSS {
                let from_pole = (8.0 * k as f64 / (ACROSS - 1) as f64 * width).min(std::f64::consts::FRAC_PI_2);
                let theta = std::f64::consts::FRAC_PI_2 - from_pole;
                ratio.push((Normalizer::exact(theta, width) / open(theta, width)) as f32);
            }
        }
        LobeTable { ratio }
    }

    /// `cos theta_o g / G` about `mean`: energy per solid angle of a lobe whose light over all latitudes is
    /// 1, without the factor 1/rad of the azimuth.
    pub(crate) fn eval(&self, theta_o: f32, mean: f32, width: f32) -> f32 {
        let width = width.max(WIDTHS[0]).min(WIDTHS[1]);
        // A mean beyond a pole is clamped to the pole.
        let mean = mean.max(-FRAC_PI_2).min(FRAC_PI_2);
        let x = (FRAC_PI_2 - mean.abs()) / width * ((ACROSS - 1) as f32 / 8.0);
        const PER_LN: f32 = (WIDE - 1) as f32 / 7.600_902_5; // ln of the widest over the narrowest
        let y = (width / WIDTHS[0]).ln() * PER_LN;
        let (i, j) = ((x as usize).min(ACROSS - 2), (y as usize).min(WIDE - 2));
        let (s, t) = ((x - i as f32).min(1.0), (y - j as f32).min(1.0));
        let at = |j: usize| self.ratio[j * ACROSS + i] * (1.0 - s) + self.ratio[j * ACROSS + i + 1] * s;
        let ratio = at(j) * (1.0 - t) + at(j + 1) * t;
        let off = (theta_o - mean) / width;
        let open = 0.5 * width * TAU.sqrt() * (1.0 + (-2.0 * width * width).exp() * (2.0 * mean).cos());
        theta_o.cos().max(0.0) * (-0.5 * off * off).exp() / (ratio * open)
    }
}

fn open(theta: f64, width: f64) -> f64 {
    0.5 * width * std::f64::consts::TAU.sqrt() * (1.0 + (-2.0 * width * width).exp() * (2.0 * theta).cos())
}

/// Mean and width of the lobe whose light has this mean latitude and standard deviation. A standard deviation
/// above that of `cos^2`, the widest lobe, is clamped to it.
pub(crate) fn lobe_of_moments(mean: f64, sd: f64) -> [f64; 2] {
    let half = std::f64::consts::FRAC_PI_2;
    let (mut middle, mut width) = (mean.clamp(-half, half), sd.clamp(f64::from(WIDTHS[0]), f64::from(WIDTHS[1])));
    for _ in 0..60 {
        let [m, s] = moments(middle, width);
        let (off, ratio) = (mean - m, (sd / s).clamp(0.5, 2.0));
        middle = (middle + off).clamp(-half, half);
        width = (width * ratio).clamp(f64::from(WIDTHS[0]), f64::from(WIDTHS[1]));
        if off.abs() < 1e-5 && (ratio - 1.0).abs() < 1e-4 {
            break;
        }
    }
    [middle, width]
}

/// Mean and standard deviation of the density `g cos^2` over the latitude.
fn moments(middle: f64, width: f64) -> [f64; 2] {
    let half = std::f64::consts::FRAC_PI_2;
    let (low, high) = ((middle - 6.0 * width).max(-half), (middle + 6.0 * width).min(half));
    let n = 64;
    let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
    for k in 0..n {
        let x = low + (f64::from(k) + 0.5) * (high - low) / f64::from(n);
        let t = (x - middle) / width;
        let density = (-0.5 * t * t).exp() * x.cos().powi(2);
        sum += density;
        first += density * x;
        second += density * x * x;
    }
    let mean = first / sum;
    [mean, (second / sum - mean * mean).max(1e-12).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lobes_are_found_by_their_moments() {
        for (middle, width) in [(0.0, 0.1), (0.7, 0.3), (-1.2, 0.05), (1.4, 0.2), (0.0, 1.0)] {
            let [mean, sd] = moments(middle, width);
            let [m, w] = lobe_of_moments(mean, sd);
            assert!((m - middle).abs() < 0.02 && (w / width - 1.0).abs() < 0.03, "{middle} {width}: {m} {w}");
        }
    }

    /// The integral of the lobe over `cos theta_o d theta_o` is 1, between nodes of the table too.
    #[test]
    fn lobes_hold_all_light() {
        let table = LobeTable::new();
        for width in [0.001, 0.0061, 0.043, 0.11, 0.37, 0.9, 3.3, 20.0f32] {
            for mean in [0.0, 0.4, -0.93, 1.33, -1.51, 1.57, 2.0f32] {
                let spread = 9.0 * width.max(WIDTHS[0]);
                let middle = mean.clamp(-FRAC_PI_2, FRAC_PI_2);
                let (low, high) = ((middle - spread).max(-FRAC_PI_2), (middle + spread).min(FRAC_PI_2));
                let n = 4000;
                let step = (high - low) / n as f32;
                let sum: f64 = (0..n)
                    .map(|k| low + (k as f32 + 0.5) * step)
                    .map(|x| f64::from(table.eval(x, mean, width) * x.cos() * step))
                    .sum();
                assert!((sum - 1.0).abs() < 2e-3, "width {width}, mean {mean}: {sum}");
            }
        }
    }
}
