//! Fits an OpenPBR material to the mean BSDF of a cloth by L-BFGS-B.
//!
//! The material is thin-walled OpenPBR 1.1 as in MaterialX 1.39: fuzz (the sheen of Zeltner, Burley and
//! Chiang 2022) over a GGX lobe of a dielectric over diffuse reflection and diffuse transmission, with the
//! geometry opacity for the gaps. Warp and weft have separate lobes, each about the normals of its plies: the
//! fitted function is the mean of the material over the normals in the normal map. The rougher axis of a lobe
//! lies across the yarn. The cost is the squared difference of the reflected f in linear sRGB, relative to f
//! and its mean, over directions uniform on the hemisphere, plus that of the reflectance of each view. The
//! fuzz has the color of all reflected light, the glossy lobe is white, and the diffuse colors are solved for
//! by least squares at each step.

use super::maps::{Maps, Point};
use super::mean::{Bands, MeanCloth, Spectrum};
use crate::error::Error;
use plywave_fit::{CostGradient, LbfgsbOptions, minimize};
use rayon::prelude::*;
use std::f64::consts::PI;

/// The glossy lobe of a kind of yarn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// OpenPBR's roughness, the square root of the GGX width.
    pub roughness: f64,
    /// OpenPBR's anisotropy.
    pub anisotropy: f64,
    /// Reflectance along the normal.
    pub f0: f64,
}

/// A fitted material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Lobes of warp and weft; a cloth with one kind has the same lobe twice.
    pub gloss: [Gloss; 2],
    /// Weight and roughness of the fuzz.
    pub fuzz: [f64; 2],
    /// Color of the fuzz, linear sRGB.
    pub fuzz_color: [f64; 3],
    /// Light that the fuzz reflects, mean over the views, linear sRGB.
    pub fuzz_energy: [f64; 3],
    /// Diffuse reflectance and diffuse transmittance, linear sRGB.
    pub diffuse: [[f64; 3]; 2],
    /// Presence: 1 minus the straight light along the normal.
    pub presence: f64,
    /// Errors of the fit.
    pub fit: Fit,
    /// Parameters that ended at a bound of the fit.
    pub at_bounds: Vec<Bound>,
}

/// A parameter that ended at a bound of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Name of the parameter in OpenPBR, and the yarn to which it belongs.
    pub parameter: String,
    /// Value of the parameter.
    pub value: f64,
    /// Whether the bound is the upper one.
    pub is_upper: bool,
}

/// Distance between a material and the cloth.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// Relative L2 errors of the reflected and of the transmitted f, over directions.
    pub error: [f64; 2],
    /// Mean over the views of reflectance and of transmittance without straight light, `[cloth, material]`.
    pub energy: [[f64; 2]; 2],
    /// Largest sum over the views of the material's reflected and transmitted light and the light that misses
    /// all fibers.
    pub largest_total: f64,
    /// Errors of the reflected f by lobe: over the directions in which the glossy lobes, the fuzz or diffuse
    /// light contribute most to the material.
    pub by_lobe: [f64; 3],
    /// Fractions of the material's reflected light in these lobes.
    pub shares: [f64; 3],
}

const VIEW_TILTS_DEG: [f64; 4] = [0.0, 30.0, 55.0, 72.0];
const VIEW_AZIMUTHS: usize = 4;
/// Number of directions of each hemisphere.
const LIGHTS: usize = 96;
/// Weight in the cost of the relative error of a view's reflectance.
const ENERGY_WEIGHT: f64 = 10.0;
/// Number of parameters: roughness and anisotropy of two kinds, f0, weight and roughness of the fuzz.
const PARAMETERS: usize = 7;
const LOWER: [f64; PARAMETERS] = [0.08, 0.0, 0.08, 0.0, 0.0, 0.0, 0.1];
/// An f0 of 0.25 corresponds to an index of 3.
const UPPER: [f64; PARAMETERS] = [1.0, 0.98, 1.0, 0.98, 0.25, MAX_FUZZ, 1.0];
/// Largest weight of the fuzz: a renderer or preview without fuzz shows only the diffuse light below it.
const MAX_FUZZ: f64 = 0.5;
/// Starting points of the fit, of which the best result is used.
const STARTS: [[f64; PARAMETERS]; 3] = [
    [0.45, 0.5, 0.45, 0.5, 0.04, 0.1, 0.5],
    [0.25, 0.8, 0.25, 0.8, 0.05, 0.1, 0.5],
    [0.7, 0.2, 0.7, 0.2, 0.06, 0.3, 0.4],
];

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let per = 1.0 / dot(v, v).sqrt().max(1e-12);
    v.map(|v| v * per)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A shading frame (across the yarn, along it, normal), and the kind of yarn.
#[derive(Clone, Copy)]
struct Frame {
    axes: [[f64; 3]; 3],
    kind: usize,
}

impl Frame {
    fn new(point: &Point) -> Frame {
        let (normal, along) = (point.normal.map(f64::from), point.along.map(f64::from));
        let across = unit(cross(along, normal));
        Frame { axes: [across, unit(cross(normal, across)), normal], kind: point.kind.min(1) }
    }

    fn local(&self, w: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| dot(axis, w))
    }
}

/// GGX widths of OpenPBR across and along the yarn.
fn widths(gloss: &Gloss) -> [f64; 2] {
    let r2 = gloss.roughness * gloss.roughness;
    let keep = 1.0 - gloss.anisotropy;
    let across = r2 * (2.0 / (1.0 + keep * keep)).sqrt();
    [across.max(1e-4), (keep * across).max(1e-4)]
}

fn schlick(f0: f64, cosine: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
}

/// Value of the glossy lobe, including the cosine of the incident light.
fn glossy(gloss: &Gloss, wo: [f64; 3], wi: [f64; 3]) -> f64 {
    let [ax, ay] = widths(gloss);
    let m = unit([0, 1, 2].map(|k| wo[k] + wi[k]));
    let e = (m[0] / ax).powi(2) + (m[1] / ay).powi(2) + m[2] * m[2];
    let d = 1.0 / (PI * ax * ay * e * e);
    let lambda = |w: [f64; 3]| {
        let a2 = ((ax * w[0]).powi(2) + (ay * w[1]).powi(2)) / (w[2] * w[2]).max(1e-9);
        0.5 * ((1.0 + a2).sqrt() - 1.0)
    };
    let g = 1.0 / (1.0 + lambda(wo) + lambda(wi));
    schlick(gloss.f0, dot(wo, m)) * d * g / (4.0 * wo[2].max(1e-4))
}

/// Fraction of light that the fuzz scatters at a cosine `x` of the viewer and roughness `y`: MaterialX's fit
/// to the tables of Zeltner et al.
fn fuzz_albedo(x: f64, y: f64) -> f64 {
    let s = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y));
    let m = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y);
    let o = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y));
    (-0.5 * ((x - m) / s).powi(2)).exp() / (s * (2.0 * PI).sqrt()) + o
}

/// Value of the fuzz's lobe, normalized to 1 and including the cosine: a linearly transformed cosine lobe.
fn fuzz_lobe(wo: [f64; 3], wi: [f64; 3], y: f64) -> f64 {
    let x = wo[2].clamp(0.0, 1.0);
    let a = (2.58126 * x + 0.813703 * y) * y / (1.0 + 0.310327 * x * x + 2.60994 * x * y);
    let b = (1.0 - x).sqrt() * (y - 1.0) * y.powi(3) / (0.0000254053 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y);
    let across = wo[0].hypot(wo[1]);
    let [c, s] = if across > 1e-9 { [wo[0] / across, wo[1] / across] } else { [1.0, 0.0] };
    let w = [c * wi[0] + s * wi[1], c * wi[1] - s * wi[0], wi[2]];
    let v = [a * w[0] + b * w[2], a * w[1], w[2]];
    let length2 = dot(v, v).max(1e-12);
    v[2].max(0.0) / PI * (a / length2).powi(2)
}

/// Reflected f of a material at one normal: glossy lobe, fuzz, and the contribution of a diffuse reflectance
/// of 1.
fn parts(gloss: &Gloss, fuzz: [f64; 2], frame: &Frame, wo: [f64; 3], wi: [f64; 3]) -> [f64; 3] {
    let (o, i) = (frame.local(wo), frame.local(wi));
    if o[2] <= 1e-3 || i[2] <= 0.0 {
        return [0.0; 3];
    }
    let over = fuzz[0] * fuzz_albedo(o[2], fuzz[1]).clamp(0.0, 1.0);
    let gloss_share = schlick(gloss.f0, o[2]);
    [
        (1.0 - over) * glossy(gloss, o, i),
        over * fuzz_lobe(o, i, fuzz[1]),
        (1.0 - over) * (1.0 - gloss_share) * i[2] / PI,
    ]
}

fn gloss_of(x: &[f64]) -> [Gloss; 2] {
    [0, 1].map(|k| Gloss { roughness: x[2 * k], anisotropy: x[2 * k + 1], f0: x[4] })
}

/// Distance from a bound, relative to the parameter's range, within which a parameter counts as at the bound.
const AT_BOUND: f64 = 1e-3;

/// Fitted parameters that are at a bound; `kinds` tells which kinds of yarns exist. A lower bound of 0 does
/// not count, because 0 means that the effect is absent.
fn at_bounds(x: &[f64], kinds: [bool; 2]) -> Vec<Bound> {
    let yarn = |k: usize| if kinds[1 - k] { [" of the warp", " of the weft"][k] } else { "" };
    let of_kind = |name: &str, k: usize| kinds[k].then(|| format!("{name}{}", yarn(k)));
    let names = [
        of_kind("specular_roughness", 0),
        of_kind("specular_roughness_anisotropy", 0),
        of_kind("specular_roughness", 1),
        of_kind("specular_roughness_anisotropy", 1),
        Some("specular_ior".into()),
        Some("fuzz_weight".into()),
        (x[5] > 0.0).then(|| "fuzz_roughness".into()),
    ];
    let bound = |(k, name): (usize, Option<String>)| {
        let margin = AT_BOUND * (UPPER[k] - LOWER[k]);
        let is_upper = x[k] > UPPER[k] - margin;
        let is_lower = x[k] < LOWER[k] + margin && LOWER[k] > 0.0;
        let value = if k == 4 { Material::index(x[k]) } else { x[k] };
        name.filter(|_| is_upper || is_lower).map(|parameter| Bound { parameter, value, is_upper })
    };
    names.into_iter().enumerate().filter_map(bound).collect()
}

fn luminance(c: [f64; 3]) -> f64 {
    plywave::color::xyz_of_linear_srgb(c)[1]
}

/// Values to which the material is fitted.
struct Target {
    frames: Vec<Frame>,
    views: Vec<[f64; 3]>,
    /// Incident directions of the upper hemisphere.
    lights: Vec<[f64; 3]>,
    /// `[view][light]`: f divided by the presence, linear sRGB.
    rgb: Vec<Vec<[f64; 3]>>,
    /// Color of the fuzz, which is that of all reflected light.
    hue: [f64; 3],
    /// `[view][light]`: weights of the differences.
    weights: Vec<Vec<f64>>,
}

impl Target {
    /// Glossy lobe, fuzz, and the contribution of a diffuse reflectance of 1, for one view.
    fn lobes(&self, x: &[f64], view: usize) -> Vec<[f64; 3]> {
        let (gloss, fuzz) = (gloss_of(x), [x[5], x[6]]);
        let share = 1.0 / self.frames.len().max(1) as f64;
        let of = |wi: &[f64; 3]| {
            let mut sum = [0.0; 3];
            for frame in &self.frames {
                let p = parts(&gloss[frame.kind], fuzz, frame, self.views[view], *wi);
                (0..3).for_each(|k| sum[k] += share * p[k]);
            }
            sum
        };
        self.lights.iter().map(of).collect()
    }

    /// The lobes of all views, and the diffuse reflectances that minimize the cost with them.
    fn solved(&self, x: &[f64]) -> (Vec<Vec<[f64; 3]>>, [f64; 3]) {
        let all: Vec<_> = (0..self.views.len()).into_par_iter().map(|view| self.lobes(x, view)).collect();
        let diffuse = [0, 1, 2].map(|c| {
            let (mut sum, mut norm) = (0.0, 0.0);
            let weights = self.weights.iter().flatten();
            for ((lobes, light), w) in all.iter().flatten().zip(self.rgb.iter().flatten()).zip(weights) {
                sum += w * lobes[2] * (light[c] - lobes[0] - self.hue[c] * lobes[1]);
                norm += w * lobes[2] * lobes[2];
            }
            if norm > 0.0 { (sum / norm).clamp(0.0, 1.0) } else { 0.0 }
        });
        (all, diffuse)
    }

    fn cost(&self, x: &[f64]) -> f64 {
        let (all, diffuse) = self.solved(x);
        let (mut sum, mut energies) = (0.0, 0.0);
        for ((lobes, light), weights) in all.iter().zip(&self.rgb).zip(&self.weights) {
            let (mut off, mut energy) = ([0.0; 3], 0.0);
            for ((lobes, light), w) in lobes.iter().zip(light).zip(weights) {
                for c in 0..3 {
                    let difference = lobes[0] + self.hue[c] * lobes[1] + diffuse[c] * lobes[2] - light[c];
                    sum += w * difference * difference;
                    off[c] += difference;
                    energy += light[c];
                }
            }
            let off = off.iter().map(|v| v * v).sum::<f64>();
            energies += 3.0 * off / (energy * energy).max(f64::MIN_POSITIVE);
        }
        let views = self.views.len() as f64;
        sum / (3.0 * views * LIGHTS as f64) + ENERGY_WEIGHT * energies / views
    }
}

impl CostGradient for Target {
    fn cost_gradient(&self, x: &[f64], gradient: &mut [f64]) -> Result<f64, argmin::core::Error> {
        for k in 0..x.len() {
            let step = 1e-4;
            let moved = |by: f64| {
                let mut at = x.to_vec();
                at[k] = (at[k] + by).clamp(LOWER[k], UPPER[k]);
                at
            };
            let (low, high) = (moved(-step), moved(step));
            let width = high[k] - low[k];
            gradient[k] = if width > 0.0 { (self.cost(&high) - self.cost(&low)) / width } else { 0.0 };
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

impl Material {
    /// Fits the material of a cloth with these maps.
    ///
    /// # Errors
    /// [`Error::Fit`] if the minimizer fails.
    pub fn fit(cloth: &MeanCloth, maps: &Maps, name: &str) -> Result<Material, Error> {
        let bands = Bands::new();
        let presence = (1.0 - cloth.straight(&|_| [0.0, 0.0, 1.0], 8192, 1)).max(1e-3);
        let mut views = vec![[0.0, 0.0, 1.0]];
        for tilt in &VIEW_TILTS_DEG[1..] {
            for k in 0..VIEW_AZIMUTHS {
                let ((s, z), (sin, cos)) =
                    (tilt.to_radians().sin_cos(), (2.0 * PI * k as f64 / VIEW_AZIMUTHS as f64).sin_cos());
                views.push([s * cos, s * sin, z]);
            }
        }
        let single = |w: &[f64; 3]| w.map(|v| v as f32);
        let lights = [even(true), even(false)];
        let rgb = |half: usize| -> Vec<Vec<[f64; 3]>> {
            let towards: Vec<[f32; 3]> = lights[half].iter().map(single).collect();
            let of = |view: &[f64; 3]| {
                let mut f = vec![Spectrum::ZERO; towards.len()];
                cloth.f(single(view), &towards, &mut f);
                f.iter().map(|f| bands.rgb(f).map(|v| v / presence)).collect()
            };
            views.par_iter().map(of).collect()
        };
        let (up, down) = (rgb(0), rgb(1));
        let count = 3 * up.len() * LIGHTS;
        let level = up.iter().flatten().flatten().sum::<f64>().max(1e-9) / count as f64;
        let weight = |rgb: &[f64; 3]| (level + rgb.iter().sum::<f64>().max(0.0) / 3.0).powi(-2);
        let weights = up.iter().map(|view| view.iter().map(weight).collect()).collect();
        let mean = [0, 1, 2].map(|c| up.iter().flatten().map(|rgb| rgb[c]).sum::<f64>().max(0.0));
        let brightest = mean.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let [above, below] = lights;
        let target = Target {
            frames: maps.points.iter().map(Frame::new).collect(),
            views,
            lights: above,
            rgb: up,
            hue: mean.map(|v| v / brightest),
            weights,
        };
        let mut best: Option<(f64, Vec<f64>)> = None;
        let options = LbfgsbOptions { max_iterations: 40, ftol: 1e-6, ..LbfgsbOptions::default() };
        for start in &STARTS {
            let solution = minimize(&target, start, &LOWER, &UPPER, &options);
            let solution =
                solution.map_err(|e| Error::Export { file: name.into(), what: format!("the fit failed: {e}") })?;
            if best.as_ref().is_none_or(|(cost, _)| solution.cost < *cost) {
                best = Some((solution.cost, solution.x));
            }
        }
        let Some((_, x)) = best else {
            return Err(Error::Export { file: name.into(), what: "the fit has no start".into() });
        };
        Ok(Material::of(&target, &x, presence, &down, &below))
    }

    /// The material of fitted parameters; `down` is the transmitted f of each view in the directions `below`,
    /// in the layout of the target's reflected f.
    fn of(target: &Target, x: &[f64], presence: f64, down: &[Vec<[f64; 3]>], below: &[[f64; 3]]) -> Material {
        let (all, mut reflected) = target.solved(x);
        let mut through = [0, 1, 2].map(|c| {
            let (mut sum, mut norm) = (0.0, 0.0);
            for lights in down {
                for (light, w) in lights.iter().zip(below) {
                    let base = -w[2] / PI;
                    sum += base * light[c];
                    norm += base * base;
                }
            }
            (sum / norm).clamp(0.0, 1.0)
        });
        // Least squares may give some views more light than is incident; the diffuse light is then reduced.
        let of_view = 2.0 * PI / LIGHTS as f64;
        let sums: Vec<[f64; 2]> = all
            .iter()
            .map(|lobes| {
                let sum = |of: &dyn Fn(&[f64; 3]) -> f64| of_view * lobes.iter().map(of).sum::<f64>();
                [sum(&|l| l[0] + luminance(target.hue) * l[1]), sum(&|l| l[2])]
            })
            .collect();
        let total = |[above, base]: &[f64; 2], reflected: [f64; 3], through: [f64; 3]| {
            above + luminance(reflected) * base + luminance(through)
        };
        let available = |sums: &[f64; 2]| (1.0 - sums[0]) / (total(sums, reflected, through) - sums[0]).max(1e-9);
        let share = sums.iter().map(available).fold(1.0, f64::min).max(0.0);
        reflected = reflected.map(|v| share * v);
        through = through.map(|v| share * v);
        let largest = sums.iter().map(|sums| total(sums, reflected, through)).fold(0.0, f64::max);
        let largest_total = 1.0 - presence + presence * largest;
        let omega = of_view / target.views.len() as f64;
        let (mut off, mut norm) = ([0.0; 3], [0.0; 3]);
        let mut energy = [[0.0; 2]; 2];
        let mut shares = [0.0; 3];
        for (lobes, light) in all.iter().flatten().zip(target.rgb.iter().flatten()) {
            let lobes = [lobes[0], luminance(target.hue) * lobes[1], luminance(reflected) * lobes[2]];
            let (sum, y) = (lobes.iter().sum::<f64>(), luminance(*light));
            let largest = (0..3).fold(0, |best, k| if lobes[k] > lobes[best] { k } else { best });
            off[largest] += (sum - y).powi(2);
            norm[largest] += y * y;
            energy[0][0] += omega * y;
            energy[1][0] += omega * sum;
            (0..3).for_each(|k| shares[k] += omega * lobes[k]);
        }
        let (mut lower_off, mut lower_norm) = (0.0, 0.0);
        for lights in down {
            for (light, w) in lights.iter().zip(below) {
                let (y, model) = (luminance(*light), luminance(through) * -w[2] / PI);
                lower_off += (model - y).powi(2);
                lower_norm += y * y;
                energy[0][1] += omega * y;
                energy[1][1] += omega * model;
            }
        }
        let ratio = |off: f64, norm: f64| if norm > 0.0 { (off / norm).sqrt() } else { 0.0 };
        let mut fuzz = 0.0;
        all.iter().flatten().for_each(|lobes| fuzz += omega * lobes[1]);
        let total = shares.iter().sum::<f64>().max(1e-12);
        Material {
            gloss: gloss_of(x),
            fuzz: [x[5], x[6]],
            fuzz_color: target.hue,
            fuzz_energy: target.hue.map(|c| c * fuzz),
            diffuse: [reflected, through],
            presence,
            at_bounds: at_bounds(x, [0, 1].map(|kind| target.frames.iter().any(|frame| frame.kind == kind))),
            fit: Fit {
                largest_total,
                error: [ratio(off.iter().sum(), norm.iter().sum()), ratio(lower_off, lower_norm)],
                energy: energy.map(|e| e.map(|v| v * presence)),
                by_lobe: [0, 1, 2].map(|k| ratio(off[k], norm[k])),
                shares: shares.map(|s| s / total),
            },
        }
    }

    /// Index of refraction for a reflectance along the normal.
    pub fn index(f0: f64) -> f64 {
        let root = f0.clamp(0.0, 0.9).sqrt();
        (1.0 + root) / (1.0 - root)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An f0 of 0.25 is an index of 3, by ((n - 1) / (n + 1))^2.
    #[test]
    fn parameters_at_bounds_are_found() {
        let named = |x: [f64; PARAMETERS], kinds| -> Vec<(String, f64, bool)> {
            at_bounds(&x, kinds).into_iter().map(|b| (b.parameter, b.value, b.is_upper)).collect()
        };
        let inside = [0.3, 0.0, 0.3, 0.0, 0.04, 0.1, 0.5];
        assert_eq!(named(inside, [true; 2]), []);
        let mut x = inside;
        (x[0], x[3], x[4], x[5], x[6]) = (0.08, 0.98, 0.25, 0.0, 0.1);
        let warp = ("specular_roughness of the warp".to_string(), 0.08, false);
        let weft = ("specular_roughness_anisotropy of the weft".to_string(), 0.98, true);
        let ior = ("specular_ior".to_string(), 3.0, true);
        assert_eq!(named(x, [true; 2]), [warp, weft, ior.clone()]);
        // A knit has one kind of yarn; without fuzz, the roughness of the fuzz has no meaning.
        assert_eq!(named(x, [true, false]), [("specular_roughness".to_string(), 0.08, false), ior]);
    }

    /// The fuzz's lobe integrates to 1, and GGX loses no more energy than its masking explains.
    #[test]
    fn lobes_are_normalized() {
        let n = 200;
        for tilt in [0.0f64, 0.6, 1.2] {
            let wo = [tilt.sin(), 0.0, tilt.cos()];
            let (mut fuzz, mut gloss) = (0.0, 0.0);
            for i in 0..n * n {
                let z = ((i / n) as f64 + 0.5) / n as f64;
                let (sin, cos) = (2.0 * PI * ((i % n) as f64 + 0.5) / n as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let wi = [r * cos, r * sin, z];
                let weight = 2.0 * PI / (n * n) as f64;
                fuzz += weight * fuzz_lobe(wo, wi, 0.5);
                gloss += weight * glossy(&Gloss { roughness: 0.4, anisotropy: 0.5, f0: 1.0 }, wo, wi);
            }
            assert!((fuzz - 1.0).abs() < 0.02, "{tilt}: {fuzz}");
            assert!(gloss < 1.005 && gloss > 0.85, "{tilt}: {gloss}");
        }
    }
}
