//! The pictures by which a material is fitted: a sphere and folds of the cloth under a distant light in front
//! of it and behind it, seen from far away along z.
//!
//! A pixel is a pair of directions in the cloth's frame at the point that it shows. On a sphere the warp runs
//! along the meridians. A fold is a cylinder along the warp or along the weft, and its light lies in the
//! plane across it, so that a row of its pixels shows the profile of a streak. The cloth's numbers are those
//! of its mean over the cell.

use super::lobes::{cross, unit};
use super::mean::{Bands, MeanCloth, Spectrum};
use rayon::prelude::*;

/// Angles of the light from the viewer, in the plane across a fold [degrees].
const FOLD_LIGHTS_DEG: [f64; 4] = [-50.0, -20.0, 20.0, 50.0];
/// Number of pixels of a fold's row, and the largest angle of its normals [degrees].
const FOLD_PIXELS: usize = 37;
const FOLD_DEG: f64 = 81.0;
/// Tilt and azimuth of the lights of spheres [degrees].
const FRONT_LIGHTS_DEG: [[f64; 2]; 5] = [[8.0, 45.0], [45.0, 20.0], [45.0, 110.0], [45.0, 200.0], [45.0, 290.0]];
const BACK_LIGHTS_DEG: [[f64; 2]; 5] = [[0.0, 0.0], [30.0, 0.0], [30.0, 90.0], [30.0, 180.0], [30.0, 270.0]];
/// Number of pixels of a sphere.
const SPHERE_PIXELS: usize = 64;
/// Smallest cosine of the light and of the viewer for a pixel that counts.
const MIN_COSINE: f64 = 0.06;

/// A pixel of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Direction to the viewer, in the cloth's frame.
    pub wo: [f64; 3],
    /// Direction to the light, in the cloth's frame.
    pub wi: [f64; 3],
    /// Radiance of the cloth for a light of irradiance 1 on its normal, linear sRGB.
    pub rgb: [f64; 3],
    /// Angle of the normal in a fold's row.
    pub angle_rad: f64,
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Pixels; those of a fold are ordered by the angle of the normal.
    pub pixels: Vec<Pixel>,
    /// Whether the picture is the row of a fold.
    pub is_fold: bool,
    /// Whether the light is behind the cloth.
    pub is_back: bool,
}

/// A direction by tilt and azimuth [degrees].
fn direction([tilt, azimuth]: [f64; 2]) -> [f64; 3] {
    let ((s, z), (sin, cos)) = (tilt.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
    [s * cos, s * sin, z]
}

/// Pixels of a fold along the warp (`axis` 1) or the weft (0).
fn fold(axis: usize, light_deg: f64) -> Picture {
    let (sin, cos) = light_deg.to_radians().sin_cos();
    let each = |k: usize| {
        let angle_rad = FOLD_DEG.to_radians() * (2.0 * k as f64 / (FOLD_PIXELS - 1) as f64 - 1.0);
        let (s, c) = angle_rad.sin_cos();
        // Components in the plane across the fold: along the cloth, and along its normal.
        let local = |[x, z]: [f64; 2]| {
            let [t, n] = [x * c - z * s, x * s + z * c];
            if axis == 1 { [t, 0.0, n] } else { [0.0, t, n] }
        };
        Pixel { wo: local([0.0, 1.0]), wi: local([sin, cos]), rgb: [0.0; 3], angle_rad }
    };
    Picture { pixels: (0..FOLD_PIXELS).map(each).collect(), is_fold: true, is_back: false }
}

/// Pixels of a sphere, even over its disk.
fn sphere(light: [f64; 3], is_back: bool) -> Picture {
    let each = |k: usize| {
        let r = ((k as f64 + 0.5) / SPHERE_PIXELS as f64).sqrt();
        let (sin, cos) = (k as f64 * 2.399_963_229_728_653).sin_cos();
        let n = [r * cos, r * sin, (1.0 - r * r).max(0.0).sqrt()];
        let x = unit(cross([0.0, 1.0, 0.0], n));
        let axes = [x, cross(n, x), n];
        let local = |w: [f64; 3]| axes.map(|axis| super::lobes::dot(axis, w));
        Pixel { wo: local([0.0, 0.0, 1.0]), wi: local(light), rgb: [0.0; 3], angle_rad: 0.0 }
    };
    Picture { pixels: (0..SPHERE_PIXELS).map(each).collect(), is_fold: false, is_back }
}

/// The pictures of a cloth. Where `presence` of the cloth is in the way of light, radiances are divided by
/// it.
pub fn pictures(cloth: &MeanCloth, presence: f64) -> Vec<Picture> {
    let folds = [1, 0].into_iter().flat_map(|axis| FOLD_LIGHTS_DEG.map(|light| fold(axis, light)));
    let fronts = FRONT_LIGHTS_DEG.map(|light| sphere(direction(light), false));
    let backs = BACK_LIGHTS_DEG.map(|light| {
        let [x, y, z] = direction(light);
        sphere([x, y, -z], true)
    });
    let bands = Bands::new();
    let single = |w: [f64; 3]| w.map(|v| v as f32);
    let filled = |mut picture: Picture| {
        let side = if picture.is_back { -1.0 } else { 1.0 };
        picture.pixels.retain(|p| p.wo[2] > MIN_COSINE && side * p.wi[2] > MIN_COSINE);
        picture.pixels.par_iter_mut().for_each(|p| {
            let mut f = [Spectrum::ZERO];
            cloth.f(single(p.wo), &[single(p.wi)], &mut f);
            p.rgb = bands.rgb(&f[0]).map(|v| v / presence);
        });
        picture
    };
    folds.chain(fronts).chain(backs).map(filled).collect()
}

/// Streak of a fold's row: where it is brightest and how wide it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Streak {
    /// Angle of the normal at the middle of the upper half.
    pub place_rad: f64,
    /// Width at the mean of the largest and the smallest value.
    pub width_rad: f64,
}

/// The streak of a row of angles and values in order; `None` for a row whose maximum is less than twice its
/// median, or lies at an end.
pub fn streak(row: &[(f64, f64)]) -> Option<Streak> {
    let mut sorted: Vec<f64> = row.iter().map(|p| p.1).collect();
    sorted.sort_by(f64::total_cmp);
    let (low, median, high) = (*sorted.first()?, sorted[sorted.len() / 2], *sorted.last()?);
    let top = row.iter().position(|p| p.1 == high)?;
    if high < 2.0 * median || top == 0 || top + 1 == row.len() {
        return None;
    }
    let level = 0.5 * (low + high);
    let crossing = |a: (f64, f64), b: (f64, f64)| a.0 + (b.0 - a.0) * (level - a.1) / (b.1 - a.1);
    let left = (1..=top).rev().find(|k| row[k - 1].1 < level).map(|k| crossing(row[k - 1], row[k]))?;
    let right = (top..row.len() - 1).find(|k| row[k + 1].1 < level).map(|k| crossing(row[k + 1], row[k]))?;
    Some(Streak { place_rad: 0.5 * (left + right), width_rad: right - left })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streaks_are_measured() {
        let row = |of: &dyn Fn(f64) -> f64| -> Vec<(f64, f64)> {
            (-40..=40).map(|k| 0.03 * f64::from(k)).map(|x| (x, of(x))).collect()
        };
        let tent = streak(&row(&|x| 0.1 + (1.0 - (x - 0.2).abs() / 0.4).max(0.0))).unwrap();
        assert!((tent.place_rad - 0.2).abs() < 0.01 && (tent.width_rad - 0.4).abs() < 0.02, "{tent:?}");
        assert_eq!(streak(&row(&|x| 1.0 + 0.1 * x)), None);
    }

    /// At the mirror's angle, half of the light's, the normal of a fold halves viewer and light.
    #[test]
    fn folds_show_the_mirror_between() {
        for (axis, along) in [(1, 0), (0, 1)] {
            let picture = fold(axis, 50.0);
            let p = picture.pixels.iter().min_by(|a, b| {
                let off = |p: &Pixel| (p.angle_rad - 25f64.to_radians()).abs();
                off(a).total_cmp(&off(b))
            });
            let p = p.unwrap();
            assert!((p.wo[along] + p.wi[along]).abs() < 0.1 && (p.wo[2] - p.wi[2]).abs() < 0.1, "{p:?}");
        }
    }
}
