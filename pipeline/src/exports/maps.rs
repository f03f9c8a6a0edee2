//! Maps of a cloth over its repeat, as seen along the normal of its face: cover, color, normals and
//! directions of yarns.

use super::mean::MeanCloth;
use crate::error::Error;
use plywave::bsdf::Bsdf;
use plywave::cloth::geometry::{frame, start};
use plywave::cloth::{Channels, LineHits};
use plywave::{ClothQuery, color};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Number of lines along a side of a pixel.
const LINES: usize = 2;
/// Number of directions of each hemisphere from which a point's reflectance is computed.
const DIRECTIONS: usize = 48;
/// Largest sine of a normal's tilt. Beyond it, the sides of plies are so steep that a flat shading point
/// receives no light.
const MAX_SINE: f32 = 0.9;

/// A visible point of a cloth's face.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// Kind of yarn: warp or weft.
    pub kind: usize,
    /// Normal of the ply, in the cloth's frame.
    pub normal: [f32; 3],
    /// Direction of the ply's axis, in the cloth's frame.
    pub along: [f32; 3],
}

/// A pixel of the maps.
#[derive(Clone, Copy, Debug, Default)]
pub struct Texel {
    /// Fraction of the pixel's lines that hit a ply.
    pub cover: f32,
    /// Fraction of these that hit weft.
    pub weft: f32,
    /// Unit mean normal.
    pub normal: [f32; 3],
    /// Unit direction across the yarn in the cloth's plane, with its larger component positive.
    pub across: [f32; 2],
    /// Reflectance and scattered transmittance along the normal, linear sRGB.
    pub light: [[f32; 3]; 2],
}

/// Maps over a rectangular repeat of a cloth.
pub struct Maps {
    /// Number of pixels along x and y.
    pub size: [usize; 2],
    /// Size of the rectangle [um].
    pub size_um: [f64; 2],
    /// Pixels by row; the first row has the largest y.
    pub texels: Vec<Texel>,
    /// First hits of evenly spaced lines along the normal.
    pub points: Vec<Point>,
}

/// Largest number of cells along a lattice vector that a rectangle spans.
const MAX_CELLS: i32 = 64;

/// Size of the smallest rectangle along x and y after which a lattice with these vectors repeats [um].
pub fn rectangle([a, b]: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let unit = a[0].hypot(a[1]).max(b[0].hypot(b[1]));
    let along = |axis: usize| {
        let mut smallest: Option<f64> = None;
        for i in -MAX_CELLS..=MAX_CELLS {
            for j in -MAX_CELLS..=MAX_CELLS {
                let at = [0, 1].map(|k| f64::from(i) * a[k] + f64::from(j) * b[k]);
                let length = at[axis];
                if at[1 - axis].abs() < 1e-6 * unit && length > 1e-6 * unit && smallest.is_none_or(|l| length < l) {
                    smallest = Some(length);
                }
            }
        }
        smallest
    };
    Some([along(0)?, along(1)?])
}

impl Maps {
    /// Maps of a cloth, with `pixels` along the longer side.
    ///
    /// # Errors
    /// [`Error::Runtime`] for a cloth without a rectangular repeat.
    pub fn new(cloth: &MeanCloth, name: &str, pixels: usize) -> Result<Maps, Error> {
        let model = cloth.points();
        let Some(size_um) = rectangle(model.cell_um()) else {
            return Err(Error::Runtime(plywave::Error::Invalid {
                file: name.into(),
                key: "cell_um".into(),
                value: format!("{:?}", model.cell_um()),
                hint: "textures need a cloth that repeats after a rectangle; give the curves such a cell".into(),
            }));
        };
        let longest = size_um[0].max(size_um[1]);
        let size = size_um.map(|s| ((pixels as f64 * s / longest).round() as usize).max(4));
        let lights = [true, false].map(lights);
        let texel = |at: usize| texel(cloth, size, size_um, at, &lights);
        let texels: Vec<Texel> = (0..size[0] * size[1]).into_par_iter().map(texel).collect();
        let points = (0..POINTS).filter_map(|k| {
            let u = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3].map(|s: f64| ((k as f64 + 0.5) * s).fract());
            point(cloth, [u[0] * size_um[0], u[1] * size_um[1]])
        });
        Ok(Maps { size, size_um, texels, points: points.collect() })
    }

    /// Mean of a quantity over the covered area.
    pub fn mean(&self, of: impl Fn(&Texel) -> f32) -> f64 {
        let (mut sum, mut all) = (0.0, 0.0);
        for texel in &self.texels {
            sum += f64::from(texel.cover) * f64::from(of(texel));
            all += f64::from(texel.cover);
        }
        if all > 0.0 { sum / all } else { 0.0 }
    }

    /// Opacity of a pixel, such that its mean is `presence`: plies let a part of the light straight through.
    pub fn opacity(&self, texel: &Texel, presence: f64) -> f64 {
        f64::from(texel.cover) * (presence / self.cover().max(1e-9)).min(1.0)
    }

    /// Fraction of the face that plies cover.
    pub fn cover(&self) -> f64 {
        self.texels.iter().map(|t| f64::from(t.cover)).sum::<f64>() / self.texels.len().max(1) as f64
    }
}

/// Number of lines along the normal by which normals are sampled.
const POINTS: usize = 64;

/// Cosine-distributed directions of a hemisphere.
fn lights(is_up: bool) -> Vec<[f32; 3]> {
    let each = |k: usize| {
        let r2 = (k as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (2.0 * PI * (k as f64 * 0.618_033_988_749_895).fract()).sin_cos();
        let z = (1.0 - r2).sqrt();
        [(r2.sqrt() * cos) as f32, (r2.sqrt() * sin) as f32, (if is_up { z } else { -z }) as f32]
    };
    (0..DIRECTIONS).map(each).collect()
}

/// The first hit of a line along the normal.
fn point(cloth: &MeanCloth, at_um: [f64; 2]) -> Option<Point> {
    let model = cloth.points();
    let wo = [0.0, 0.0, 1.0];
    let d = [0.0, 0.0, -1.0];
    let mut hits = LineHits::default();
    model.lines().hits(start(model.lines(), at_um.map(|v| v as f32), wo), d, &mut hits);
    let hit = hits.as_slice().first()?;
    let [x, y, z] = frame(hit, d);
    let sine = (hit.h_um / hit.radius_um).clamp(-MAX_SINE, MAX_SINE);
    let cosine = (1.0 - sine * sine).sqrt();
    let normal = std::array::from_fn(|k| sine * x[k] + cosine * y[k]);
    Some(Point { kind: cloth.kind_of(hit.curve as usize), normal, along: z })
}

fn texel(cloth: &MeanCloth, size: [usize; 2], size_um: [f64; 2], at: usize, lights: &[Vec<[f32; 3]>; 2]) -> Texel {
    let (column, row) = (at % size[0], size[1] - 1 - at / size[0]);
    let mut texel = Texel::default();
    let (mut normal, mut double, mut hit) = ([0.0f32; 3], [0.0f32; 2], 0usize);
    let (mut f, mut pdf) = (vec![[0.0f32; 3]; DIRECTIONS], vec![0.0f32; DIRECTIONS]);
    for line in 0..LINES * LINES {
        let inside = |k: usize| (k as f64 + 0.5) / LINES as f64;
        let at = [
            (column as f64 + inside(line % LINES)) / size[0] as f64 * size_um[0],
            (row as f64 + inside(line / LINES)) / size[1] as f64 * size_um[1],
        ];
        let Some(point) = point(cloth, at) else { continue };
        hit += 1;
        texel.weft += if point.kind == 1 { 1.0 } else { 0.0 };
        (0..3).for_each(|k| normal[k] += point.normal[k]);
        // The direction across the yarn is an axis without sign, so its double angle is averaged.
        let [x, y] = [-point.along[1], point.along[0]];
        double[0] += x * x - y * y;
        double[1] += 2.0 * x * y;
        let query = ClothQuery {
            channels: Channels::LinearSrgb,
            ..ClothQuery::new(at.map(|v| v as f32), [0.0, 0.0, 1.0], color::RGB_LAMBDA_UM)
        };
        let bsdf = cloth.points().at(&query);
        for (light, lights) in texel.light.iter_mut().zip(lights) {
            bsdf.eval_batch(lights, &mut f, &mut pdf);
            for (f, w) in f.iter().zip(lights) {
                let weight = std::f32::consts::PI / (DIRECTIONS as f32 * w[2].abs());
                (0..3).for_each(|k| light[k] += weight * f[k]);
            }
        }
    }
    texel.cover = hit as f32 / (LINES * LINES) as f32;
    if hit == 0 {
        return Texel { normal: [0.0, 0.0, 1.0], across: [1.0, 0.0], ..texel };
    }
    let per = 1.0 / hit as f32;
    texel.weft *= per;
    texel.light.iter_mut().flatten().for_each(|v| *v *= per);
    let length = normal.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-6);
    texel.normal = normal.map(|v| v / length);
    let angle = 0.5 * double[1].atan2(double[0]);
    let across = [angle.cos(), angle.sin()];
    let sign = if across[0].abs() >= across[1].abs() { across[0] } else { across[1] };
    texel.across = if sign < 0.0 { across.map(|v| -v) } else { across };
    texel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattices_have_rectangles() {
        assert_eq!(rectangle([[500.0, 0.0], [0.0, 300.0]]), Some([500.0, 300.0]));
        // The cell of a satin of five has one yarn.
        let [w, h] = rectangle([[100.0, 500.0], [200.0, 0.0]]).unwrap();
        assert!((w - 200.0).abs() < 1e-9 && (h - 1000.0).abs() < 1e-9, "{w} {h}");
        assert_eq!(rectangle([[100.0, 1.0], [0.0, 300.0 / 7.03]]), None);
    }
}
