//! Fits a material to pictures of a cloth by L-BFGS-B.
//!
//! The material has a glossy GGX lobe for each kind of yarn, a fuzz, diffuse reflection and diffuse
//! transmission, each with a color, by the formulas of the [`Engine`] that renders it, and an opacity for the
//! gaps. glTF has one lobe, about the normal of the cloth, for all yarns. Other lobes lie about the normals
//! of the plies, flattened to the [`RELIEF`] that a normal map is applied with: the fitted light is the mean
//! over them. The rougher axis of a lobe lies across the yarn. The cost is the difference from the
//! [pictures](super::pictures) of the cloth, as the eye sees it: relative to a power of the brightness, pixel
//! by pixel and for the mean of each picture. Colors are solved for by non-negative least squares at each
//! step. The index of refraction is that of the fibers. Logarithmic barriers keep the other parameters inside
//! their ranges.

use super::lobes::{Engine, Frame, Parts, Shape, dot, reflected, transmitted};
use super::maps::Maps;
use super::mean::{Bands, MeanCloth, Spectrum};
use super::pictures::{Picture, Pixel, pictures, streak};
use crate::error::Error;
use plywave::cloth::ClothData;
use plywave::spec::YarnSpec;
use plywave_fit::{CostGradient, LbfgsbOptions, minimize};
use rayon::prelude::*;
use std::f64::consts::PI;

/// A fitted material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Program whose formulas the material has.
    pub engine: Engine,
    /// Widths of the lobes, roughness of the fuzz, level of the glossy lobe.
    pub shape: Shape,
    /// Colors of the glossy lobes of warp and weft, linear sRGB; a cloth with one kind has the same twice.
    pub gloss: [[f64; 3]; 2],
    /// Color of the fuzz, linear sRGB.
    pub fuzz: [f64; 3],
    /// Light that the fuzz reflects, mean over views, linear sRGB.
    pub fuzz_energy: [f64; 3],
    /// Diffuse reflectance and diffuse transmittance, linear sRGB.
    pub diffuse: [[f64; 3]; 2],
    /// Share of the diffuse transmittance that falls with the cosine of the viewer.
    pub facing: f64,
    /// Color of light that goes on forward, linear sRGB.
    pub forward: [f64; 3],
    /// Index of the closure of this light, which sets how far it spreads.
    pub forward_index: f64,
    /// Direction of the yarns where all have one (glTF): the warp (1) or the weft (0).
    pub axis: usize,
    /// Presence: 1 minus the straight light along the normal.
    pub presence: f64,
    /// Index of refraction of the fibers.
    pub ior: f64,
    /// Distance from the cloth.
    pub fit: Fit,
    /// Parameters that ended at a bound of the fit.
    pub at_bounds: Vec<Bound>,
}

/// A parameter that ended at a bound of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Name of the parameter, and the yarn to which it belongs.
    pub parameter: String,
    /// Value of the parameter.
    pub value: f64,
    /// Whether the bound is the upper one.
    pub is_upper: bool,
}

/// Distance between a material and the cloth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fit {
    /// Relative L2 errors of the reflected and of the transmitted f, over directions.
    pub error: [f64; 2],
    /// Mean over views of reflectance and of transmittance without straight light, `[cloth, material]`.
    pub energy: [[f64; 2]; 2],
    /// Largest sum over the views of the material's reflected and transmitted light and the light that misses
    /// all fibers.
    pub largest_total: f64,
    /// Largest difference of a picture's mean color from the cloth's, relative to the luminance: of the
    /// pictures with light in front, and of those with light behind.
    pub mean_color: [f64; 2],
    /// Largest distance of the places of streaks in the rows of folds [rad]; 0 where the cloth has none.
    pub streak_place_rad: f64,
    /// Largest relative difference of the widths of these streaks.
    pub streak_width: f64,
}

/// Strength with which normal maps of plies are applied. Light that enters a ply leaves it at other places,
/// so that its sides are not as dark as those of a hard body are.
pub const RELIEF: f64 = 0.35;

/// Number of parameters: width across and the ratio of the widths of two kinds, roughness of the fuzz, level.
const PARAMETERS: usize = 6;
const LOWER: [f64; PARAMETERS] = [0.03, 0.02, 0.03, 0.02, 0.3, 0.004];
const UPPER: [f64; PARAMETERS] = [1.0, 1.0, 1.0, 1.0, 1.0, 0.4];
const NAMES: [&str; PARAMETERS] = ["roughness", "anisotropy", "roughness", "anisotropy", "fuzz roughness", "level"];
/// Starting points of the fit, of which the best result is used.
const STARTS: [[f64; PARAMETERS]; 2] = [[0.4, 0.5, 0.4, 0.5, 0.5, 0.08], [0.8, 0.3, 0.8, 0.3, 0.4, 0.2]];
/// Weight of the barriers.
const BARRIER: f64 = 3e-3;
/// Weight of a picture's mean relative to its pixels.
const MEAN_WEIGHT: f64 = 20.0;
/// Weight of the pixels of a fold relative to those of a sphere.
const FOLD_WEIGHT: f64 = 2.0;
/// Power of the brightness to which differences are relative.
const EYE: f64 = 1.5;
/// Pull of the colors of gloss and fuzz towards none, which decides between lobes that look the same.
const RIDGE: f64 = 1e-4;
/// Number of sweeps over the unknowns of a color.
const SWEEPS: usize = 60;
/// Indices that are tried for forward light.
const INDICES: [f64; 5] = [1.25, 1.4, 1.6, 1.9, 2.4];
/// Largest share of the light below Mitsuba's glossy lobe that is reflected diffusely without a penalty, so
/// that light which goes through has its place.
const MITSUBA_DIFFUSE: f64 = 0.6;
/// Least share of the cloth's reflected light, from all views, that OpenPBR has.
const LEAST_ENERGY: f64 = 0.87;
/// Light that a material may transmit beyond the cloth's, of light from all views.
const EXCESS: f64 = 0.02;
/// Largest color without a penalty.
const MAX_COLOR: f64 = 0.95;

const VIEW_TILTS_DEG: [f64; 4] = [0.0, 30.0, 55.0, 72.0];
const VIEW_AZIMUTHS: usize = 4;
/// Number of directions of each hemisphere for energies.
const LIGHTS: usize = 96;

fn luminance(c: [f64; 3]) -> f64 {
    plywave::color::xyz_of_linear_srgb(c)[1]
}

/// Number of lobes with a color: gloss of warp and weft, fuzz, diffuse light.
const COLORS: usize = 4;

/// The colors of the lobes: `[channel][lobe]`.
type Colors = [[f64; COLORS]; 3];

/// A parameterization and the pictures to which it is fitted.
struct Target {
    engine: Engine,
    frames: Vec<Frame>,
    pictures: Vec<Picture>,
    /// `[picture][pixel]`: weights of squared differences.
    weights: Vec<Vec<f64>>,
    /// Weights of squared differences of means.
    mean_weights: Vec<f64>,
}

fn shape_of(x: &[f64]) -> Shape {
    Shape { widths: [0, 1].map(|k| [x[2 * k], x[2 * k] * x[2 * k + 1]]), fuzz_roughness: x[4], level: x[5] }
}

/// Light of each lobe for a color of 1, and light that has no color, given the colors of an earlier step.
fn linear(parts: &Parts, colors: &Colors, channel: usize) -> ([f64; COLORS], f64) {
    let weight = (0..3).map(|c| colors[c][2]).fold(0.0, f64::max).min(1.0);
    let gloss = colors[channel][0].max(colors[channel][1]);
    let below = |value: f64, k: usize| value - weight * parts.below[k];
    let diffuse = (below(parts.diffuse, 3) - gloss * below(parts.taken, 4)).max(0.0);
    let lobes = [below(parts.gloss[0], 0), below(parts.gloss[1], 1), parts.fuzz, diffuse];
    (lobes, below(parts.rim, 2))
}

fn light(parts: &Parts, colors: &Colors) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let (lobes, rim) = linear(parts, colors, c);
        rim + (0..COLORS).map(|k| lobes[k] * colors[c][k]).sum::<f64>()
    })
}

/// Non-negative least squares of few unknowns by coordinate descent. `a` and `b` are normal equations.
fn non_negative(a: &[[f64; COLORS]; COLORS], b: &[f64; COLORS]) -> [f64; COLORS] {
    let mut x = [0.0; COLORS];
    for _ in 0..SWEEPS {
        for k in 0..COLORS {
            let others: f64 = (0..COLORS).filter(|j| *j != k).map(|j| a[k][j] * x[j]).sum();
            x[k] = ((b[k] - others) / a[k][k].max(f64::MIN_POSITIVE)).max(0.0);
        }
    }
    x
}

impl Target {
    fn new(engine: Engine, frames: Vec<Frame>, pictures: Vec<Picture>) -> Target {
        let mean =
            |of: &Picture| of.pixels.iter().map(|p| luminance(p.rgb)).sum::<f64>() / of.pixels.len().max(1) as f64;
        let fronts: Vec<f64> = pictures.iter().filter(|p| !p.is_back).map(mean).collect();
        let level = (fronts.iter().sum::<f64>() / fronts.len().max(1) as f64).max(1e-6);
        let weights = pictures
            .iter()
            .map(|p| {
                let per = 1.0 / p.pixels.len().max(1) as f64;
                let per = if p.is_fold { FOLD_WEIGHT * per } else { per };
                let of = |q: &Pixel| per * (level + luminance(q.rgb).max(0.0)).powf(-EYE) * level.powf(EYE - 2.0);
                p.pixels.iter().map(of).collect()
            })
            .collect();
        let mean_weights = pictures.iter().map(|p| MEAN_WEIGHT * (0.3 * level + mean(p)).powi(-2)).collect();
        Target { engine, frames, pictures, weights, mean_weights }
    }

    fn fronts(&self) -> impl Iterator<Item = (usize, &Picture)> {
        self.pictures.iter().enumerate().filter(|(_, p)| !p.is_back)
    }

    fn parts(&self, shape: &Shape, wo: [f64; 3], wi: [f64; 3]) -> Parts {
        let (share, mut sum) = (1.0 / self.frames.len().max(1) as f64, Parts::default());
        self.frames.iter().for_each(|frame| reflected(self.engine, shape, frame, wo, wi, share, &mut sum));
        sum
    }

    /// Parts of all pixels with light in front, and the colors that fit best with them.
    fn solved(&self, x: &[f64]) -> (Vec<Vec<Parts>>, Colors) {
        let shape = shape_of(x);
        let of = |picture: &Picture| match picture.is_back {
            true => Vec::new(),
            false => picture.pixels.iter().map(|p| self.parts(&shape, p.wo, p.wi)).collect(),
        };
        let all: Vec<Vec<Parts>> = self.pictures.par_iter().map(of).collect();
        let mut colors = [[0.0; COLORS]; 3];
        // What lies below gloss and fuzz depends on their colors, which change little after the second step.
        for _ in 0..3 {
            let before = colors;
            for (c, out) in colors.iter_mut().enumerate() {
                let (mut a, mut b) = ([[0.0; COLORS]; COLORS], [0.0; COLORS]);
                let mut add = |lobes: &[f64; COLORS], want: f64, w: f64| {
                    for i in 0..COLORS {
                        b[i] += w * lobes[i] * want;
                        (0..COLORS).for_each(|j| a[i][j] += w * lobes[i] * lobes[j]);
                    }
                };
                for (k, picture) in self.fronts() {
                    let (mut sums, mut want, per) = ([0.0; COLORS], 0.0, 1.0 / picture.pixels.len().max(1) as f64);
                    for ((p, parts), w) in picture.pixels.iter().zip(&all[k]).zip(&self.weights[k]) {
                        let (lobes, rim) = linear(parts, &before, c);
                        add(&lobes, p.rgb[c] - rim, *w);
                        (0..COLORS).for_each(|i| sums[i] += per * lobes[i]);
                        want += per * (p.rgb[c] - rim);
                    }
                    add(&sums, want, self.mean_weights[k]);
                }
                (0..COLORS).for_each(|i| a[i][i] += if i < 3 { RIDGE * a[3][3] } else { 1e-12 } + 1e-12);
                *out = non_negative(&a, &b);
            }
        }
        (all, colors)
    }

    fn cost(&self, x: &[f64]) -> f64 {
        let (all, colors) = self.solved(x);
        let (mut sum, mut count) = (0.0, 0.0);
        for (k, picture) in self.fronts() {
            let (mut off, per) = ([0.0; 3], 1.0 / picture.pixels.len().max(1) as f64);
            for ((p, parts), w) in picture.pixels.iter().zip(&all[k]).zip(&self.weights[k]) {
                let got = light(parts, &colors);
                for c in 0..3 {
                    sum += w * (got[c] - p.rgb[c]).powi(2);
                    off[c] += per * (got[c] - p.rgb[c]);
                }
            }
            sum += self.mean_weights[k] * off.iter().map(|v| v * v).sum::<f64>();
            count += 3.0;
        }
        let most = |k: usize| match self.engine {
            Engine::Gltf | Engine::Mitsuba if k < 2 => MAX_COLOR * x[5],
            Engine::Mitsuba if k == 3 => MITSUBA_DIFFUSE * (1.0 - x[5]),
            _ => MAX_COLOR,
        };
        let beyond = |c: &[f64; COLORS]| (0..COLORS).map(|k| (c[k] - most(k)).max(0.0).powi(2)).sum::<f64>();
        let over = 10.0 * colors.iter().map(beyond).sum::<f64>();
        let barrier: f64 = (0..PARAMETERS)
            .map(|k| {
                let at = (x[k] - LOWER[k]) / (UPPER[k] - LOWER[k]);
                -(at.max(1e-9).ln() + (1.0 - at).max(1e-9).ln())
            })
            .sum();
        sum / count + over + BARRIER * barrier
    }

    /// Colors of light from behind that fit best, and their cost: `of` gives this light for colors of 1.
    fn through(&self, of: impl Fn(&Pixel) -> [f64; 3]) -> ([[f64; 3]; 3], f64) {
        let (mut a, mut b, mut all) = ([[0.0; COLORS]; COLORS], [[0.0; COLORS]; 3], 0.0);
        let mut add = |lobes: [f64; 3], want: [f64; 3], w: f64| {
            all += w * dot(want, want);
            for i in 0..3 {
                (0..3).for_each(|j| a[i][j] += w * lobes[i] * lobes[j]);
                (0..3).for_each(|c| b[c][i] += w * lobes[i] * want[c]);
            }
        };
        for picture in self.pictures.iter().filter(|p| p.is_back) {
            let per = 1.0 / picture.pixels.len().max(1) as f64;
            let (mut lobes, mut want) = ([0.0; 3], [0.0; 3]);
            for p in &picture.pixels {
                let one = of(p);
                (0..3).for_each(|k| lobes[k] += per * one[k]);
                (0..3).for_each(|c| want[c] += per * p.rgb[c]);
            }
            // Relative to a picture's mean, and each pixel as far as the eye sees it.
            let mean = luminance(want).max(1e-12);
            for p in &picture.pixels {
                add(of(p), p.rgb, per / (mean * (mean + luminance(p.rgb))));
            }
            add(lobes, want, MEAN_WEIGHT / (mean * mean));
        }
        (0..3).for_each(|k| a[k][k] += RIDGE * a[0][0]);
        let solved = b.map(|b| non_negative(&a, &b));
        let gain: f64 = (0..3)
            .map(|c| {
                let x = &solved[c];
                (0..3).map(|i| x[i] * (2.0 * b[c][i] - (0..3).map(|j| a[i][j] * x[j]).sum::<f64>())).sum::<f64>()
            })
            .sum();
        ([0, 1, 2].map(|k| [0, 1, 2].map(|c| solved[c][k].min(1.0))), all - gain)
    }

    /// Mean color of a picture: of the cloth, and of a material with this light of a pixel.
    fn means(picture: &Picture, of: impl Fn(usize, &Pixel) -> [f64; 3]) -> [[f64; 3]; 2] {
        let mut sums = [[0.0; 3]; 2];
        for (k, p) in picture.pixels.iter().enumerate() {
            let got = of(k, p);
            (0..3).for_each(|c| (sums[0][c], sums[1][c]) = (sums[0][c] + p.rgb[c], sums[1][c] + got[c]));
        }
        sums
    }
}

impl CostGradient for Target {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        for k in 0..x.len() {
            let moved = |by: f64| {
                let mut at = x.to_vec();
                at[k] = (at[k] + by).clamp(LOWER[k], UPPER[k]);
                at
            };
            let (low, high) = (moved(-1e-4), moved(1e-4));
            gradient[k] = (self.cost(&high) - self.cost(&low)) / (high[k] - low[k]);
        }
        Ok(self.cost(x))
    }
}

/// Directions of a hemisphere, uniform in solid angle.
fn even(is_up: bool) -> Vec<[f64; 3]> {
    let each = |k: usize| {
        let z = (k as f64 + 0.5) / LIGHTS as f64;
        let (sin, cos) = (2.0 * PI * (k as f64 * 0.618_033_988_749_895).fract()).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, if is_up { z } else { -z }]
    };
    (0..LIGHTS).map(each).collect()
}

/// Distance from a bound, relative to the parameter's range, within which a parameter counts as at the bound.
const AT_BOUND: f64 = 1e-3;

/// Fitted parameters that are at a bound; `kinds` tells which kinds of yarns exist.
fn at_bounds(x: &[f64], kinds: [bool; 2], engine: Engine, has_fuzz: bool) -> Vec<Bound> {
    let bound = |k: usize| {
        let at = (x[k] - LOWER[k]) / (UPPER[k] - LOWER[k]);
        let yarn = if kinds[0] && kinds[1] && k < 4 { [" of the warp", " of the weft"][k / 2] } else { "" };
        let counts = match k {
            0..4 => kinds[k / 2],
            4 => has_fuzz,
            _ => engine != Engine::Cycles,
        };
        let (is_lower, is_upper) = (at < AT_BOUND, at > 1.0 - AT_BOUND);
        (counts && (is_lower || is_upper)).then(|| Bound {
            parameter: format!("{}{yarn}", NAMES[k]),
            value: x[k],
            is_upper,
        })
    };
    (0..PARAMETERS).filter_map(bound).collect()
}

/// Mean index of refraction of the fibers; that of glass for opaque metals.
fn index(data: &ClothData) -> Result<f64, Error> {
    let of = |text: &str| -> Result<f64, Error> {
        let fiber = YarnSpec::parse(text, "model (its spec)")?.fiber;
        Ok(if fiber.metal.is_some() || fiber.eta <= 1.0 { 1.5 } else { fiber.eta })
    };
    let all: Vec<f64> = data.models.iter().map(|m| of(&m.data().spec_text)).collect::<Result<_, _>>()?;
    Ok(all.iter().sum::<f64>() / all.len().max(1) as f64)
}

impl Material {
    /// Fits the material of a cloth with these maps, for an engine.
    ///
    /// # Errors
    /// [`Error::Export`] if the minimizer fails.
    pub fn fit(
        engine: Engine,
        data: &ClothData,
        cloth: &MeanCloth,
        maps: &Maps,
        name: &str,
    ) -> Result<Material, Error> {
        let presence = (1.0 - cloth.straight(&|_| [0.0, 0.0, 1.0], 8192, 1)).max(1e-3);
        let pictures = pictures(cloth, presence);
        // Programs that show glTF filter textures: from afar normals are flat, and a direction that changes
        // from yarn to yarn has a mean that is that of none. One direction for all yarns is left: the better
        // one.
        let all: Vec<(usize, Vec<Frame>)> = match engine {
            Engine::Gltf => [1, 0].map(|axis| (axis, vec![Frame::flat(axis)])).into(),
            // Mitsuba has no texture of directions.
            Engine::Mitsuba => {
                [1, 0].map(|axis| (axis, maps.points.iter().map(|p| Frame::aligned(p, RELIEF, axis)).collect())).into()
            }
            _ => vec![(1, maps.points.iter().map(|p| Frame::new(p, RELIEF, engine)).collect())],
        };
        let options = LbfgsbOptions { max_iterations: 40, ftol: 1e-6, ..LbfgsbOptions::default() };
        let mut best: Option<(f64, Vec<f64>, usize, Target)> = None;
        for (axis, frames) in all {
            for start in &STARTS {
                let target = Target::new(engine, frames.clone(), pictures.clone());
                let solution = minimize(&target, start, &LOWER, &UPPER, &options);
                let solution =
                    solution.map_err(|e| Error::Export { file: name.into(), what: format!("the fit failed: {e}") })?;
                if best.as_ref().is_none_or(|(cost, ..)| solution.cost < *cost) {
                    best = Some((solution.cost, solution.x, axis, target));
                }
            }
        }
        let Some((_, x, axis, target)) = best else {
            return Err(Error::Export { file: name.into(), what: "the fit has no start".into() });
        };
        Ok(Material { axis, ..Material::of(&target, &x, presence, index(data)?, cloth) })
    }

    /// The material of fitted parameters.
    fn of(target: &Target, x: &[f64], presence: f64, ior: f64, cloth: &MeanCloth) -> Material {
        let (engine, shape) = (target.engine, shape_of(x));
        let (all, mut colors) = target.solved(x);
        let fuzz_weight = |colors: &Colors| (0..3).map(|c| colors[c][2]).fold(0.0, f64::max).min(1.0);
        let share = 1.0 / target.frames.len().max(1) as f64;
        let fuzz = fuzz_weight(&colors);
        let behind_of = |index: f64, wo: [f64; 3], wi: [f64; 3]| -> [f64; 3] {
            target.frames.iter().fold([0.0; 3], |sum, frame| {
                let one = transmitted(engine, &shape, [fuzz, index], frame, wo, wi);
                [0, 1, 2].map(|k| sum[k] + share * one[k])
            })
        };
        let tried = INDICES.map(|index| (index, target.through(|p| behind_of(index, p.wo, p.wi))));
        let best = tried.iter().min_by(|a, b| a.1.1.total_cmp(&b.1.1)).unwrap_or(&tried[0]);
        let (index, mut through) = (best.0, best.1.0);
        let behind = |wo, wi| behind_of(index, wo, wi);

        // Energies, by directions of their own.
        let mut views = vec![[0.0, 0.0, 1.0]];
        for tilt in &VIEW_TILTS_DEG[1..] {
            let (s, z) = tilt.to_radians().sin_cos();
            views.extend((0..VIEW_AZIMUTHS).map(|k| {
                let (sin, cos) = (2.0 * PI * k as f64 / VIEW_AZIMUTHS as f64).sin_cos();
                [s * cos, s * sin, z]
            }));
        }
        let lights = [even(true), even(false)];
        let bands = Bands::new();
        type Row = ([Vec<[f64; 3]>; 2], Vec<Parts>, Vec<[f64; 3]>);
        let row = |wo: &[f64; 3]| -> Row {
            let cloth = [0, 1].map(|half: usize| {
                let towards: Vec<[f32; 3]> = lights[half].iter().map(|w| w.map(|v| v as f32)).collect();
                let mut f = vec![Spectrum::ZERO; LIGHTS];
                cloth.f(wo.map(|v| v as f32), &towards, &mut f);
                f.iter().map(|f| bands.rgb(f).map(|v| v / presence)).collect()
            });
            let parts = lights[0].iter().map(|wi| target.parts(&shape, *wo, *wi)).collect();
            (cloth, parts, lights[1].iter().map(|wi| behind(*wo, *wi)).collect())
        };
        let rows: Vec<Row> = views.par_iter().map(row).collect();
        let of_view = 2.0 * PI / LIGHTS as f64;
        let mix = |through: &[[f64; 3]; 3], behind: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|c| (0..3).map(|k| through[k][c] * behind[k]).sum())
        };
        let total = |colors: &Colors, through: &[[f64; 3]; 3]| {
            let of = |(_, parts, behind): &Row| {
                let up: f64 = parts.iter().map(|p| luminance(light(p, colors))).sum();
                of_view * (up + behind.iter().map(|b| luminance(mix(through, *b))).sum::<f64>())
            };
            rows.iter().map(of).fold(0.0, f64::max)
        };
        // A diffuse lobe alone cannot have the forward light of pictures and the energy of all directions.
        if engine != Engine::Cycles {
            let sum = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>();
            let want = sum(&|r| r.0[1].iter().map(|f| luminance(*f)).sum());
            let got = sum(&|r| r.2.iter().map(|b| luminance(mix(&through, *b))).sum());
            let excess = EXCESS / (presence * of_view / views.len() as f64);
            let factor = ((want + excess) / got.max(1e-12)).min(1.0);
            through[0] = through[0].map(|v| factor * v);
        }
        // Pictures show little of light at a slant; the energy of OpenPBR, which no picture of its own
        // renderer holds, is kept near the cloth's as well.
        if engine == Engine::OpenPbr {
            let sum = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>();
            let want = sum(&|r| r.0[0].iter().map(|f| luminance(*f)).sum());
            let got = sum(&|r| r.1.iter().map(|p| luminance(light(p, &colors))).sum());
            let factor = (LEAST_ENERGY * want / got.max(1e-12)).max(1.0);
            colors.iter_mut().flatten().for_each(|c| *c *= factor);
        }
        // The fit may give some views more light than comes in.
        let largest = total(&colors, &through);
        if largest > 1.0 {
            colors.iter_mut().flatten().for_each(|c| *c /= largest);
            through.iter_mut().flatten().for_each(|v| *v /= largest);
        }
        let largest_total = 1.0 - presence + presence * total(&colors, &through);
        let omega = of_view / views.len() as f64;
        let (mut off, mut norm, mut energy, mut fuzz_energy) = ([0.0; 2], [0.0; 2], [[0.0; 2]; 2], [0.0; 3]);
        for (of_cloth, parts, behind) in &rows {
            for k in 0..LIGHTS {
                let got = [luminance(light(&parts[k], &colors)), luminance(mix(&through, behind[k]))];
                (0..3).for_each(|c| fuzz_energy[c] += omega * colors[c][2] * parts[k].fuzz);
                for half in 0..2 {
                    let want = luminance(of_cloth[half][k]);
                    off[half] += (got[half] - want).powi(2);
                    norm[half] += want * want;
                    energy[0][half] += presence * omega * want;
                    energy[1][half] += presence * omega * got[half];
                }
            }
        }
        let mut fit = Fit { largest_total, energy, ..Fit::default() };
        fit.error = [0, 1].map(|h| if norm[h] > 0.0 { f64::sqrt(off[h] / norm[h]) } else { 0.0 });
        for (k, picture) in target.pictures.iter().enumerate() {
            let of = |at: usize, p: &Pixel| match picture.is_back {
                true => mix(&through, behind(p.wo, p.wi)),
                false => light(&all[k][at], &colors),
            };
            let [want, got] = Target::means(picture, of);
            let length = |v: [f64; 3]| dot(v, v).sqrt();
            let largest = length([0, 1, 2].map(|c| got[c] - want[c])) / length(want).max(1e-12);
            let side = usize::from(picture.is_back);
            if !picture.is_fold {
                fit.mean_color[side] = fit.mean_color[side].max(largest);
                continue;
            }
            let row = |of: &dyn Fn(usize, &Pixel) -> [f64; 3]| -> Vec<(f64, f64)> {
                picture.pixels.iter().enumerate().map(|(at, p)| (p.angle_rad, luminance(of(at, p)))).collect()
            };
            if let Some(want) = streak(&row(&|_, p| p.rgb)) {
                let (place, width) = match streak(&row(&of)) {
                    Some(got) => ((got.place_rad - want.place_rad).abs(), (got.width_rad / want.width_rad - 1.0).abs()),
                    None => (PI, 1.0),
                };
                fit.streak_place_rad = fit.streak_place_rad.max(place);
                fit.streak_width = fit.streak_width.max(width);
            }
        }
        let kinds = [0, 1].map(|kind| target.frames.iter().any(|frame| frame.kind == kind));
        let of = |k: usize| [0, 1, 2].map(|c| colors[c][k]);
        let mut shape = shape;
        let mut gloss = [of(0), of(1)];
        for k in 0..2 {
            if !kinds[k] {
                (shape.widths[k], gloss[k]) = (shape.widths[1 - k], gloss[1 - k]);
            }
        }
        Material {
            engine,
            shape,
            gloss,
            fuzz: of(2),
            fuzz_energy,
            diffuse: [of(3), [0, 1, 2].map(|c| through[0][c] + through[1][c])],
            facing: luminance(through[1]) / (luminance(through[0]) + luminance(through[1])).max(1e-12),
            forward: through[2],
            forward_index: index,
            axis: 1,
            presence,
            ior,
            at_bounds: at_bounds(x, kinds, engine, fuzz > 0.0),
            fit,
        }
    }
}

impl Material {
    /// Roughness and anisotropy of OpenPBR for the widths of warp and weft.
    pub fn glosses(&self) -> [[f64; 2]; 2] {
        self.shape.widths.map(|[across, along]| {
            let keep = along / across;
            [(across / (2.0 / (1.0 + keep * keep)).sqrt()).sqrt(), 1.0 - keep]
        })
    }

    /// Weight of the fuzz, and its color for this weight.
    pub fn weighted_fuzz(&self) -> (f64, [f64; 3]) {
        let weight = self.fuzz.iter().copied().fold(0.0, f64::max);
        (weight.min(1.0), self.fuzz.map(|c| if weight > 0.0 { c / weight } else { 1.0 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_at_bounds_are_found() {
        let inside = [0.3, 0.5, 0.3, 0.5, 0.5, 0.1];
        assert_eq!(at_bounds(&inside, [true; 2], Engine::Gltf, true), []);
        let mut x = inside;
        (x[0], x[3], x[4], x[5]) = (0.03, 1.0, 0.1, 1.0);
        let names = |kinds, engine, has_fuzz| -> Vec<String> {
            at_bounds(&x, kinds, engine, has_fuzz).into_iter().map(|b| b.parameter).collect()
        };
        let all = ["roughness of the warp", "anisotropy of the weft", "fuzz roughness", "level"];
        assert_eq!(names([true; 2], Engine::Gltf, true), all);
        // A knit has one kind of yarn; without fuzz, its roughness has no meaning; closures have no level.
        assert_eq!(names([true, false], Engine::Cycles, false), ["roughness"]);
    }

    #[test]
    fn colors_are_not_negative() {
        let mut a = [[0.0; COLORS]; COLORS];
        (0..COLORS).for_each(|k| a[k][k] = 2.0);
        (a[0][1], a[1][0]) = (1.0, 1.0);
        assert_eq!(non_negative(&a, &[2.0, -1.0, 4.0, 0.0]), [1.0, 0.0, 2.0, 0.0]);
        let both = non_negative(&a, &[3.0, 3.0, 0.0, 0.0]);
        assert!((both[0] - 1.0).abs() < 1e-9 && (both[1] - 1.0).abs() < 1e-9, "{both:?}");
    }
}
