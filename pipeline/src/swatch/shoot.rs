//! Pictures of a cloth in the geometry of a swatch's photographs: every pixel of the full model, with
//! unevenness, the lamp's size and its image through gaps.

use super::geometry::{SwatchGeometry, unit};
use plywave::math::vec3::{cross, dot};
use plywave::{Bsdf, ClothModel, ClothQuery};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// What to photograph.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// The cloth.
    pub cloth: &'a ClothModel,
    /// Turn of the cloth, whose warp runs up the picture [rad].
    pub turn_rad: f32,
    /// Camera and lamps.
    pub geometry: &'a SwatchGeometry,
    /// Columns and rows of the whole picture.
    pub size: [usize; 2],
    /// Left, top, right and bottom of the part that is rendered [pixels].
    pub part: [usize; 4],
    /// Samples of a pixel.
    pub samples: u32,
    /// Seed of the samples.
    pub seed: u32,
}

impl Shot<'_> {
    /// Linear RGB of the part, in the front light or with the lamp behind.
    pub fn render(&self, is_back: bool) -> Vec<[f32; 3]> {
        let [left, top, right, bottom] = self.part;
        let width = right - left;
        (0..width * (bottom - top))
            .into_par_iter()
            .map(|i| self.pixel([left + i % width, top + i / width], is_back))
            .collect()
    }

    fn pixel(&self, [column, row]: [usize; 2], is_back: bool) -> [f32; 3] {
        let seen = self.geometry.seen_mm();
        let lamp = self.geometry.lamp_mm(is_back);
        let radius = self.geometry.lamp_radius_mm as f32;
        let camera_mm = self.geometry.camera_mm as f32;
        let seed = self.seed ^ ((row * self.size[0] + column) as u32).wrapping_mul(0x9e37_79b9);
        let mut sum = [0.0; 3];
        for sample in 0..self.samples {
            let [u, v, a, b] = [0, 1, 2, 3].map(|k| sobol_burley::sample(sample, k, seed));
            let per = seen / self.size[0] as f64;
            let x = (column as f64 + f64::from(u) - 0.5 * self.size[0] as f64) * per;
            let y = (0.5 * self.size[1] as f64 - row as f64 - f64::from(v)) * per;
            let wo = self.geometry.to_camera([x, y]);
            let to_lamp = [lamp[0] - x, lamp[1] - y, lamp[2]];
            let towards = unit(to_lamp);
            // A point of the lamp's disk, which faces the cloth.
            let side = unit([f64::from(towards[2]), 0.0, -f64::from(towards[0])]);
            let up = cross(towards, side);
            let (r, (s, c)) = (radius * a.sqrt(), (TAU * b).sin_cos());
            let to_lamp = to_lamp.map(|v| v as f32);
            let point: [f32; 3] = std::array::from_fn(|k| to_lamp[k] + r * (c * side[k] + s * up[k]));
            let squared = dot(point, point);
            let query = ClothQuery { turn_rad: self.turn_rad, ..ClothQuery::rgb([1e3 * x as f32, 1e3 * y as f32], wo) };
            let cloth = self.cloth.at(&query);
            let (f, lens) = (cloth.eval(point.map(|v| v / squared.sqrt())), self.geometry.lens(wo));
            (0..3).for_each(|k| sum[k] += lens * f[k] * camera_mm * camera_mm / squared);
            // The lamp itself, through gaps; it gives an irradiance of 1 at the camera's distance.
            let seen = dot(wo.map(|v| -v), towards);
            if is_back && 1.0 - seen * seen < radius * radius / dot(to_lamp, to_lamp) {
                let radiance = camera_mm * camera_mm / (std::f32::consts::PI * radius * radius);
                let straight = cloth.straight();
                (0..3).for_each(|k| sum[k] += lens * radiance * straight[k]);
            }
        }
        sum.map(|v| v / self.samples as f32)
    }
}

/// A Gaussian blur with a standard deviation in pixels, as a lens makes it.
pub fn blur<const N: usize>(size: [usize; 2], picture: &[[f32; N]], sd_px: f32) -> Vec<[f32; N]> {
    if sd_px < 0.05 {
        return picture.to_vec();
    }
    let reach = (3.0 * sd_px).ceil() as i64;
    let weights: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f32 / sd_px).powi(2)).exp()).collect();
    let total: f32 = weights.iter().sum();
    let pass = |from: &[[f32; N]], step: [i64; 2]| -> Vec<[f32; N]> {
        let at = |i: usize| {
            let (x, y) = ((i % size[0]) as i64, (i / size[0]) as i64);
            let mut sum = [0.0; N];
            for (k, w) in (-reach..=reach).zip(&weights) {
                let x = (x + k * step[0]).clamp(0, size[0] as i64 - 1) as usize;
                let y = (y + k * step[1]).clamp(0, size[1] as i64 - 1) as usize;
                (0..N).for_each(|c| sum[c] += w / total * from[y * size[0] + x][c]);
            }
            sum
        };
        (0..from.len()).map(at).collect()
    };
    pass(&pass(picture, [1, 0]), [0, 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A blur keeps light and spreads a point to its variance.
    #[test]
    fn blurs_keep_light() {
        let size = [33, 33];
        let mut point = vec![[0.0]; 33 * 33];
        point[16 * 33 + 16] = [1.0];
        let wide = blur(size, &point, 1.5);
        let sum: f32 = wide.iter().map(|v| v[0]).sum();
        let variance: f32 = wide.iter().enumerate().map(|(i, v)| v[0] * ((i % 33) as f32 - 16.0).powi(2)).sum();
        assert!((sum - 1.0).abs() < 1e-4 && (variance.sqrt() - 1.5).abs() < 0.03, "{sum} {variance}");
    }
}
