//! The mean of a cloth over its cell, as measured from far away: reflected, transmitted and straight light of
//! a direction, and f between two directions.
//!
//! The cloth is shaded with rays ([`ClothOptions::RAYS`]): light that misses all fibers passes straight
//! through and is reported separately. Diffraction would spread it by a degree, which none of the formats
//! resolves. Energies are means over positions, by Owen-scrambled Sobol numbers in batches that yield
//! standard errors. f is the file's mean over the cell, if the file has it, else a mean over positions; both
//! describe the same cloth up to the error of the table.

use plywave::Result;
use plywave::bsdf::Bsdf;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::{ClothQuery, color};
use std::f64::consts::{PI, TAU};

/// Number of wavelengths of a spectrum.
pub const NODES: usize = 41;
/// Number of batches of samples, from which standard errors are computed.
pub const BATCHES: usize = 16;
/// Number of positions in the cell if the file has no mean over it; a Fibonacci number, followed by its
/// predecessor.
const PLACES: usize = 89;
const LATTICE: usize = 55;
/// Half-angle [rad] of the cone around straight light that counts towards the normal-normal transmittance.
pub const CONE_RAD: f64 = 5.0 * PI / 180.0;

/// Wavelength of a node [um]: 0.38 to 0.78 in steps of 0.01.
pub fn lambda_um(node: usize) -> f64 {
    0.38 + 0.01 * node as f64
}

/// Absorptions outside the visible range [1/um]; a missing one equals that at the end of the visible range.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BeyondVisible {
    /// Absorption below 0.38 um.
    pub uv_per_um: Option<f64>,
    /// Absorption above 0.78 um.
    pub ir_per_um: Option<f64>,
}

/// A quantity as a function of wavelength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spectrum {
    /// Values at the nodes.
    pub visible: [f64; NODES],
    /// Values below 0.38 um and above 0.78 um.
    pub ends: [f64; 2],
}

impl Spectrum {
    /// The spectrum that is 0 everywhere.
    pub const ZERO: Spectrum = Spectrum { visible: [0.0; NODES], ends: [0.0; 2] };

    /// The same number at every wavelength.
    pub fn flat(value: f64) -> Spectrum {
        Spectrum { visible: [value; NODES], ends: [value; 2] }
    }

    /// Adds another spectrum times `share`.
    pub fn add(&mut self, share: f64, other: &Spectrum) {
        self.visible.iter_mut().zip(&other.visible).for_each(|(a, b)| *a += share * b);
        self.ends.iter_mut().zip(&other.ends).for_each(|(a, b)| *a += share * b);
    }

    /// Value at a wavelength [um], linear between the nodes.
    pub fn at(&self, lambda: f64) -> f64 {
        let x = (lambda - 0.38) * 100.0;
        if x < -1e-9 {
            return self.ends[0];
        }
        if x > (NODES - 1) as f64 + 1e-9 {
            return self.ends[1];
        }
        let node = (x.max(0.0) as usize).min(NODES - 2);
        let share = (x - node as f64).clamp(0.0, 1.0);
        self.visible[node] + share * (self.visible[node + 1] - self.visible[node])
    }
}

/// Energies of light incident from one direction, or of a mean over directions.
#[derive(Clone, Copy, Debug)]
pub struct Energies {
    /// Light that leaves on the side of incidence.
    pub reflected: Spectrum,
    /// Scattered light that leaves on the other side, without straight light.
    pub transmitted: Spectrum,
    /// The part of the transmitted light within [`CONE_RAD`] of the straight direction.
    pub forward: Spectrum,
    /// Light that misses all fibers, the same at every wavelength.
    pub straight: f64,
    /// Fraction of the lines that miss all plies.
    pub open: f64,
}

/// A mean and its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// The mean.
    pub value: f64,
    /// Its standard error.
    pub se: f64,
}

impl Estimate {
    /// Estimate from one value per batch.
    pub fn of(batches: &[f64]) -> Estimate {
        let n = batches.len().max(1) as f64;
        let value = batches.iter().sum::<f64>() / n;
        let variance = batches.iter().map(|b| (b - value).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        Estimate { value, se: (variance / n).sqrt() }
    }
}

/// A cloth averaged over its cell.
pub struct MeanCloth {
    points: ClothModel,
    far: Option<ClothModel>,
    /// Number of cells along each vector after which the colors repeat.
    cells: f64,
    kinds: Vec<usize>,
    beyond: BeyondVisible,
    lambda_um: [f32; NODES],
}

impl MeanCloth {
    /// The mean of a cloth; `sigma_per_um` is one absorption at every wavelength that overrides the colors.
    ///
    /// # Errors
    /// Those of [`ClothModel::from_data`].
    pub fn new(data: &ClothData, sigma_per_um: Option<f64>, beyond: BeyondVisible) -> Result<MeanCloth> {
        let options = ClothOptions { sigma_per_um: sigma_per_um.map(|s| s as f32), ..ClothOptions::RAYS };
        let far = match data.has_far() {
            true => Some(ClothModel::from_data(data.clone(), &ClothOptions { far: true, ..options })?),
            false => None,
        };
        let cells = match sigma_per_um {
            Some(_) => 1,
            None => data.looks.iter().map(|look| look.colors.len()).max().unwrap_or(1).max(1),
        };
        Ok(MeanCloth {
            points: ClothModel::from_data(data.clone(), &options)?,
            far,
            cells: cells as f64,
            kinds: data.curves.curves.iter().map(|c| data.curves.yarns[c.yarn as usize].kind as usize).collect(),
            beyond,
            lambda_um: std::array::from_fn(|node| lambda_um(node) as f32),
        })
    }

    /// The cloth model at single points.
    pub fn points(&self) -> &ClothModel {
        &self.points
    }

    /// Kind of yarn of a curve: warp or weft.
    pub fn kind_of(&self, curve: usize) -> usize {
        self.kinds.get(curve).copied().unwrap_or(0)
    }

    /// Whether f comes from the file's mean over the cell.
    pub fn has_far(&self) -> bool {
        self.far.is_some()
    }

    /// Absorptions outside the visible range.
    pub fn beyond(&self) -> BeyondVisible {
        self.beyond
    }

    /// Absorptions below and above the visible range for a query, if one of them is given. A missing one is
    /// set to 0; its value is taken from the end of the visible range instead.
    fn ends(&self) -> Option<[f32; 2]> {
        let BeyondVisible { uv_per_um, ir_per_um } = self.beyond;
        let has_ends = uv_per_um.is_some() || ir_per_um.is_some();
        has_ends.then(|| [uv_per_um, ir_per_um].map(|sigma| sigma.unwrap_or(0.0) as f32))
    }

    /// The spectrum of values at the nodes and, if absorptions outside the visible range are given, of values
    /// there.
    fn spectrum(&self, visible: &[f32; NODES], ends: Option<[f32; 2]>) -> Spectrum {
        let visible = visible.map(f64::from);
        let [uv, ir] = ends.unwrap_or_default().map(f64::from);
        let BeyondVisible { uv_per_um, ir_per_um } = self.beyond;
        let ends = [
            if uv_per_um.is_some() { uv } else { visible[0] },
            if ir_per_um.is_some() { ir } else { visible[NODES - 1] },
        ];
        Spectrum { visible, ends }
    }

    fn query_ends<'a>(query: &ClothQuery<'a, NODES>, sigma: [f32; 2]) -> ClothQuery<'a, 2> {
        ClothQuery {
            sigma_per_um: [Some(sigma); 2],
            footprint_um: query.footprint_um,
            ..ClothQuery::new(query.position_um, query.wo, [0.55; 2])
        }
    }

    /// Mean energies of each batch for light from the directions to which `wo` maps two uniform numbers;
    /// `samples` is the total over all batches.
    pub fn energies(&self, wo: &(dyn Fn([f64; 2]) -> [f32; 3] + Sync), samples: usize, seed: u32) -> Vec<Energies> {
        use rayon::prelude::*;
        let count = samples.div_ceil(BATCHES).clamp(1, 1 << 16) as u32;
        let batch = |batch: usize| self.batch(wo, count, seed.wrapping_mul(0x9e37_79b9).wrapping_add(batch as u32));
        (0..BATCHES).into_par_iter().map(batch).collect()
    }

    fn batch(&self, wo: &(dyn Fn([f64; 2]) -> [f32; 3] + Sync), count: u32, seed: u32) -> Energies {
        let mut sum = Energies {
            reflected: Spectrum::ZERO,
            transmitted: Spectrum::ZERO,
            forward: Spectrum::ZERO,
            straight: 0.0,
            open: 0.0,
        };
        let per = 1.0 / f64::from(count);
        for k in 0..count {
            let u = |dimension: u32| sobol_burley::sample(k, dimension, seed);
            let wo = wo([f64::from(u(0)), f64::from(u(1))]);
            let query = ClothQuery::new(self.place([u(2), u(3), u(7), u(8)]), wo, self.lambda_um);
            let at = self.points.at(&query);
            let numbers = [u(4), u(5), u(6)];
            let sample = at.sample(numbers);
            sum.straight += per * f64::from(at.straight()[0]);
            sum.open += per * f64::from(u8::from(at.is_gap()));
            let ends = self.ends().map(|sigma| self.points.at(&Self::query_ends(&query, sigma)).sample(numbers));
            let mut add = |w: [f32; 3], light: &Spectrum| {
                if w[2] * wo[2] >= 0.0 {
                    sum.reflected.add(per, light);
                    return;
                }
                sum.transmitted.add(per, light);
                let along = -(0..3).map(|i| f64::from(w[i]) * f64::from(wo[i])).sum::<f64>();
                if along > CONE_RAD.cos() {
                    sum.forward.add(per, light);
                }
            };
            match ends {
                None => {
                    if let Some(s) = sample.direction() {
                        add(s.w, &self.spectrum(&s.weight, None));
                    }
                }
                // Visible and end wavelengths are sampled separately, because their directions differ.
                Some(ends) => {
                    if let Some(s) = sample.direction() {
                        add(s.w, &self.spectrum(&s.weight, Some([0.0; 2])));
                    }
                    if let Some(s) = ends.direction() {
                        let mut light = self.spectrum(&[0.0; NODES], Some(s.weight));
                        light.visible = [0.0; NODES];
                        add(s.w, &light);
                    }
                }
            }
        }
        sum
    }

    /// A position uniform over the cell and over the cells after which colors repeat.
    fn place(&self, [a, b, i, j]: [f32; 4]) -> [f32; 2] {
        let [x, y] = self.points.cell_um();
        let cell = |u: f32| (f64::from(u) * self.cells).floor();
        let (a, b) = (f64::from(a) + cell(i), f64::from(b) + cell(j));
        [0, 1].map(|k| (a * x[k] + b * y[k]) as f32)
    }

    /// Straight light, as the mean over directions and over `count` positions.
    pub fn straight(&self, wo: &dyn Fn([f64; 2]) -> [f32; 3], count: u32, seed: u32) -> f64 {
        let mut sum = 0.0;
        for k in 0..count {
            let u = |dimension: u32| sobol_burley::sample(k, dimension, seed);
            let query = ClothQuery {
                sigma_per_um: [Some([0.0]); 2],
                ..ClothQuery::new(self.place([u(2), u(3), 0.0, 0.0]), wo([f64::from(u(0)), f64::from(u(1))]), [0.55])
            };
            sum += f64::from(self.points.at(&query).straight()[0]);
        }
        sum / f64::from(count.max(1))
    }

    /// Light from `wo` that the cloth scatters, and light that misses all fibers, both for the mean that
    /// [`MeanCloth::f`] uses.
    pub fn energy(&self, wo: [f32; 3]) -> (Spectrum, f64) {
        let (mut scattered, mut passing) = (Spectrum::ZERO, 0.0);
        self.each_place(wo, &mut |model, query, share| {
            let at = model.at(query);
            let ends = self.ends().map(|sigma| model.at(&Self::query_ends(query, sigma)).albedo());
            scattered.add(share, &self.spectrum(&at.albedo(), ends));
            passing += share * f64::from(at.straight()[0]);
        });
        (scattered, passing)
    }

    /// Calls `of` with the queries whose weighted mean is the mean over the cell, and their weights: one
    /// query if the file has the mean.
    fn each_place(&self, wo: [f32; 3], of: &mut dyn FnMut(&ClothModel, &ClothQuery<'_, NODES>, f64)) {
        let (model, footprint_um, places) = match &self.far {
            Some(far) => (far, f32::MAX, 1),
            None => (&self.points, 0.0, PLACES),
        };
        for k in 0..places {
            let even = |step: f64| ((k as f64 + 0.5) * step).fract() as f32;
            let across = even(LATTICE as f64 / PLACES as f64);
            let position = self.place([even(1.0 / PLACES as f64), across, even(0.618_034), even(0.414_214)]);
            let query = ClothQuery { footprint_um, ..ClothQuery::new(position, wo, self.lambda_um) };
            of(model, &query, 1.0 / places as f64);
        }
    }

    /// f [1/sr], the BSDF times the cosine of `w`, for light from `wo` that leaves towards each `w`; written
    /// to `f`, which has the same length. Straight light is excluded.
    pub fn f(&self, wo: [f32; 3], w: &[[f32; 3]], f: &mut [Spectrum]) {
        f.fill(Spectrum::ZERO);
        let (mut visible, mut pdf) = (vec![[0.0f32; NODES]; w.len()], vec![0.0f32; w.len()]);
        let mut ends = vec![[0.0f32; 2]; w.len()];
        self.each_place(wo, &mut |model, query, share| {
            model.at(query).eval_batch(w, &mut visible, &mut pdf);
            if let Some(sigma) = self.ends() {
                model.at(&Self::query_ends(query, sigma)).eval_batch(w, &mut ends, &mut pdf);
            }
            for (f, (visible, ends)) in f.iter_mut().zip(visible.iter().zip(&ends)) {
                f.add(share, &self.spectrum(visible, Some(*ends)));
            }
        });
    }
}

/// A cosine-distributed direction of a hemisphere from two uniform numbers.
pub fn diffuse(is_face: bool, [u, v]: [f64; 2]) -> [f32; 3] {
    let r = u.sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    let z = (1.0 - u).max(4e-6).sqrt();
    [(r * cos) as f32, (r * sin) as f32, (if is_face { z } else { -z }) as f32]
}

/// Weights that reduce a spectrum to single numbers.
#[derive(Clone, Debug)]
pub struct Bands {
    /// XYZ under D65 for the 1931 observer; its Y is the visible band.
    pub xyz: [[f64; NODES]; 3],
    /// XYZ under D65 for the 1964 observer.
    pub xyz_10: [[f64; NODES]; 3],
    /// Global solar radiation of EN 410, at the nodes.
    pub solar: [f64; NODES],
    /// Fractions of the solar radiation below and above the visible range.
    pub solar_ends: [f64; 2],
}

/// Wavelengths [nm] and fractions [1e-4] of global solar radiation (EN 410, Table 2).
const SOLAR: [(u32, u32); 56] = [
    (300, 5),
    (320, 69),
    (340, 122),
    (360, 145),
    (380, 177),
    (400, 235),
    (420, 268),
    (440, 294),
    (460, 343),
    (480, 339),
    (500, 326),
    (520, 318),
    (540, 321),
    (560, 312),
    (580, 294),
    (600, 289),
    (620, 289),
    (640, 280),
    (660, 273),
    (680, 246),
    (700, 237),
    (720, 220),
    (740, 230),
    (760, 199),
    (780, 211),
    (800, 330),
    (850, 453),
    (900, 381),
    (950, 220),
    (1000, 329),
    (1050, 306),
    (1100, 185),
    (1150, 136),
    (1200, 210),
    (1250, 211),
    (1300, 166),
    (1350, 42),
    (1400, 10),
    (1450, 44),
    (1500, 95),
    (1550, 123),
    (1600, 110),
    (1650, 106),
    (1700, 93),
    (1750, 68),
    (1800, 24),
    (1850, 5),
    (1900, 2),
    (1950, 12),
    (2000, 30),
    (2050, 37),
    (2100, 57),
    (2200, 66),
    (2300, 60),
    (2400, 41),
    (2500, 6),
];

impl Bands {
    /// The weights from the tables of the CIE and of EN 410.
    pub fn new() -> Bands {
        let hat = |node: usize, lambda: f64| (1.0 - (100.0 * (lambda - lambda_um(node))).abs()).max(0.0);
        let (mut xyz, mut xyz_10, mut solar) = ([[0.0; NODES]; 3], [[0.0; NODES]; 3], [0.0; NODES]);
        let mut solar_ends = [0.0; 2];
        for node in 0..NODES {
            let (one, ten) =
                (color::xyz_of_reflectance(|l| hat(node, l)), color::xyz_10_of_reflectance(|l| hat(node, l)));
            for k in 0..3 {
                (xyz[k][node], xyz_10[k][node]) = (one[k], ten[k]);
            }
        }
        for (nm, share) in SOLAR {
            let share = f64::from(share) * 1e-4;
            match nm {
                ..380 => solar_ends[0] += share,
                // The wavelengths tabulated in this range are nodes.
                380..=780 => solar[((nm - 380) / 10) as usize] += share,
                _ => solar_ends[1] += share,
            }
        }
        Bands { xyz, xyz_10, solar, solar_ends }
    }

    /// Visible value: Y under D65 for the 1931 observer.
    pub fn visible(&self, s: &Spectrum) -> f64 {
        dot(&self.xyz[1], s)
    }

    /// XYZ under D65 for the 1931 observer.
    pub fn xyz(&self, s: &Spectrum) -> [f64; 3] {
        [0, 1, 2].map(|k| dot(&self.xyz[k], s))
    }

    /// Linear sRGB under D65.
    pub fn rgb(&self, s: &Spectrum) -> [f64; 3] {
        color::linear_srgb_of_xyz(self.xyz(s))
    }

    /// Linear sRGB under D65; a color outside the gamut is desaturated at constant luminance.
    pub fn rgb_in_gamut(&self, s: &Spectrum) -> [f64; 3] {
        let (rgb, y) = (self.rgb(s), self.visible(s).max(0.0));
        let min = rgb.iter().copied().fold(f64::INFINITY, f64::min);
        let keep = if min < 0.0 { y / (y - min) } else { 1.0 };
        rgb.map(|v| (y + keep * (v - y)).max(0.0))
    }

    /// CIELAB under D65 for the 1964 observer.
    pub fn lab_10(&self, s: &Spectrum) -> [f64; 3] {
        color::lab_of_xyz_10([0, 1, 2].map(|k| dot(&self.xyz_10[k], s)))
    }

    /// Solar value, by global solar radiation.
    pub fn solar(&self, s: &Spectrum) -> f64 {
        dot(&self.solar, s) + self.solar_ends[0] * s.ends[0] + self.solar_ends[1] * s.ends[1]
    }
}

impl Default for Bands {
    fn default() -> Self {
        Bands::new()
    }
}

fn dot(weights: &[f64; NODES], s: &Spectrum) -> f64 {
    weights.iter().zip(&s.visible).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A white spectrum is 1 in every band, and a ramp has the color computed from the 81 nodes.
    #[test]
    fn bands_are_those_of_the_tables() {
        let bands = Bands::new();
        let white = Spectrum::flat(1.0);
        assert!((bands.visible(&white) - 1.0).abs() < 1e-12 && (bands.solar(&white) - 1.0).abs() < 1e-9);
        assert!(bands.lab_10(&white).iter().zip([100.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9));
        assert!(bands.rgb(&white).iter().all(|v| (v - 1.0).abs() < 1e-9));
        let mut ramp = Spectrum::ZERO;
        (0..NODES).for_each(|node| ramp.visible[node] = 2.0 * lambda_um(node) - 0.7);
        let want = color::xyz_of_reflectance(|l| 2.0 * l - 0.7);
        assert!(bands.xyz(&ramp).iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12));
        // A narrow green lies outside sRGB; its luminance is preserved.
        let mut green = Spectrum::ZERO;
        green.visible[14] = 1.0;
        let (rgb, y) = (bands.rgb_in_gamut(&green), bands.visible(&green));
        assert!(bands.rgb(&green)[0] < 0.0 && rgb.iter().all(|v| *v >= 0.0), "{rgb:?}");
        assert!((color::xyz_of_linear_srgb(rgb)[1] / y - 1.0).abs() < 1e-9);
        assert!((ramp.at(0.555) - 0.41).abs() < 1e-12 && ramp.at(0.3) == 0.0 && ramp.at(0.9) == 0.0);
        assert_eq!(SOLAR.iter().map(|(_, share)| share).sum::<u32>(), 10_000);
    }
}
