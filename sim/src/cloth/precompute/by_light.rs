//! Shapes of inter-yarn scattering that conserve energy by the direction of the light.
//!
//! Of even light from a direction b, a clear cloth gives back all. By view its energy is 1 as its parts are
//! made; by light it is not, since plies, shadows and the fits of inter-yarn scattering are not exactly
//! reciprocal. The shaded cloth tells how much of the light from b passes, leaves straight from its plies, or
//! leaves about cones. The shapes of all other light are multiplied by a factor of b, the same for all
//! absorptions, so that they have the rest, and are fitted anew. Their integrals, and so energies by view,
//! stay as they are.

use super::inter_yarn::{integrals, not_negative};
use super::regression::solve;
use super::{Effort, Progress, parts};
use crate::error::SimError;
use nalgebra::DMatrix;
use plywave::cloth::light::{InterYarn, LitPlaces, PAIRS, Poly, TERMS, dot, terms};
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::math::hash::SplitMix64;
use plywave::{Bsdf, ClothQuery};
use std::f64::consts::{PI, TAU};

/// Directions of the light on each side: rows of z, denser towards grazing, by azimuths.
const ROWS: usize = 10;
const COLUMNS: usize = 16;
const LIGHTS: usize = ROWS * COLUMNS;
/// Viewers at places of the cell, and places for the light that passes all plies, of each direction.
const VIEWS: usize = 1 << 14;
const PASSES: usize = 512;
/// The same for [`Effort::Draft`].
const DRAFT_VIEWS: usize = 1 << 11;
const DRAFT_PASSES: usize = 128;
/// Number of chunks of viewers. Their sums are joined in order, so that the result is deterministic.
const CHUNKS: usize = 16;
/// Rounds of factors and fits.
const ROUNDS: usize = 4;
/// Bounds of the factors.
const FACTORS: [f64; 2] = [0.25, 4.0];
/// Shaped energy, of 1, below which a side's shapes stay as they are.
const MIN_SHAPED: f64 = 0.005;
/// Largest error of the energy by light, averaged over azimuth, with which corrected shapes are used. More
/// are errors of plies, shadows or cones (gold, glass), for which shapes cannot make up.
const MAX_LEFT: f64 = 0.05;

/// Row's z, and its share of the integral over z.
fn row(i: usize) -> [f64; 2] {
    let u = (i as f64 + 0.5) / ROWS as f64;
    [0.02 + 0.98 * u * u.sqrt(), 1.5 * u.sqrt() / ROWS as f64]
}

/// Light number `i` of a side.
fn light(side: usize, i: usize) -> [f32; 3] {
    let [z, _] = row(i / COLUMNS);
    let (sin, cos) = (TAU * ((i % COLUMNS) as f64 + 0.5) / COLUMNS as f64).sin_cos();
    let across = (1.0 - z * z).sqrt();
    [(across * cos) as f32, (across * sin) as f32, if side == 0 { z as f32 } else { -z as f32 }]
}

/// What the shaded cloth tells.
struct Found {
    /// `[side][light]`: energy by light of clear fibers that the shapes do not distribute.
    fixed: [[f64; LIGHTS]; 2],
    /// `[side][leaves up, down]`: integral over views of the side of energy that the shapes distribute, times
    /// the cosine.
    shaped: [[f64; 2]; 2],
}

impl Found {
    const NONE: Found = Found { fixed: [[0.0; LIGHTS]; 2], shaped: [[0.0; 2]; 2] };

    fn new(cloth: &ClothModel, data: &ClothData, [views, passes]: [usize; 2], chunk: usize) -> Found {
        let mut found = Found::NONE;
        let (sides, is_small) = (&data.inter_yarn.sides, data.shadows.tables().is_empty());
        let lights = [0, 1].map(|side| (0..LIGHTS).map(|i| light(side, i)).collect::<Vec<_>>());
        // `[side of the viewer][leaves up, down][light]`.
        let shapes = [0, 1].map(|side| {
            [0, 1].map(|half| {
                let of = &sides[side].shape[half * PAIRS];
                lights[side ^ half].iter().map(|b| dot(of, &terms(*b)).max(0.0)).collect::<Vec<_>>()
            })
        });
        let [a, b] = cloth.cell_um();
        let query = |place: [f64; 2], wo: [f32; 3]| {
            let at = [0, 1].map(|i| (place[0] * a[i] + place[1] * b[i]) as f32);
            ClothQuery { sigma_per_um: [Some([0.0]); 2], ..ClothQuery::new(at, wo, [0.55]) }
        };
        let mut rng = SplitMix64(0x6c_6967_6874 + chunk as u64);
        for k in (chunk * (views / CHUNKS))..((chunk + 1) * (views / CHUNKS)) {
            // Low-discrepancy sequences (Roberts 2018); sides take turns in their order.
            let even = |step: f64| (0.5 + (k / 2) as f64 * step).fract();
            let side = k % 2;
            let z = even(0.856_674_883_854_502_9).sqrt().max(2e-3);
            let (sin, cos) = (TAU * even(0.733_891_856_627_126_9)).sin_cos();
            // Over a cell of many crossings the sequence of places would go with that of directions.
            let place = match is_small {
                true => [even(0.628_706_721_042_211_5), even(0.538_597_257_223_612_7)],
                false => [rng.next_f64(), rng.next_f64()],
            };
            let across = (1.0 - z * z).sqrt();
            let wo = [(across * cos) as f32, (across * sin) as f32, if side == 0 { z as f32 } else { -z as f32 }];
            let bsdf = cloth.at(&query(place, wo));
            let shaped = bsdf.shaped_energy().map(|energy| energy[0]);
            let per = TAU / views as f64;
            for half in 0..2 {
                found.shaped[side][half] += per * f64::from(shaped[half]);
                let of = side ^ half;
                for (i, b) in lights[of].iter().enumerate() {
                    let [direct, inter_yarn] = bsdf.parts(*b).map(|f| f[0] / b[2].abs());
                    found.fixed[of][i] += per * f64::from(direct + inter_yarn - shaped[half] * shapes[side][half][i]);
                }
            }
        }
        for k in (chunk * (passes / CHUNKS))..((chunk + 1) * (passes / CHUNKS)) {
            let even = |step: f64| (0.5 + k as f64 * step).fract();
            let place = [even(0.754_877_666_246_692_8), even(0.569_840_290_998_053_3)];
            for (fixed, lights) in found.fixed.iter_mut().zip(&lights) {
                for (fixed, b) in fixed.iter_mut().zip(lights) {
                    *fixed += f64::from(cloth.at(&query(place, *b)).straight()[0]) / passes as f64;
                }
            }
        }
        found
    }

    fn join(&mut self, other: &Found) {
        let sums = self.fixed.as_flattened_mut().iter_mut().chain(self.shaped.as_flattened_mut());
        let others = other.fixed.as_flattened().iter().chain(other.shaped.as_flattened());
        sums.zip(others).for_each(|(sum, other)| *sum += other);
    }
}

/// Fit of polynomials to values at the lights of a side, in least squares.
struct Fit(DMatrix<f64>);

impl Fit {
    fn new() -> Fit {
        let values = DMatrix::from_fn(LIGHTS, TERMS, |i, term| f64::from(terms(light(0, i))[term]));
        let normal = values.tr_mul(&values);
        let ridge = 1e-6 * normal[(0, 0)];
        Fit(solve(normal, ridge, values.transpose()))
    }

    /// The polynomial of least squares.
    fn poly(&self, values: &[f64; LIGHTS]) -> Poly {
        std::array::from_fn(|term| (0..LIGHTS).map(|i| self.0[(term, i)] * values[i]).sum::<f64>() as f32)
    }

    /// The nonnegative shape that follows these values; where it cannot, it stays closer to the `old` one.
    fn shape(&self, values: &[f64; LIGHTS], old: &Poly) -> Poly {
        let poly = self.poly(values);
        let all = dot(&poly, &integrals());
        if all > 1e-6 { not_negative(poly.map(|v| v / all), old) } else { *old }
    }
}

/// Values of a polynomial at the lights of a side.
fn values(poly: &Poly) -> [f64; LIGHTS] {
    std::array::from_fn(|i| f64::from(dot(poly, &terms(light(0, i)))))
}

/// The tables of inter-yarn scattering of `data`, which is even over places, with corrected shapes.
pub(super) fn by_light(data: &ClothData, effort: Effort, progress: Progress<'_>) -> Result<InterYarn, SimError> {
    let cloth = ClothModel::from_data(data.clone(), &ClothOptions::RAYS)?;
    let samples = if effort == Effort::Draft { [DRAFT_VIEWS, DRAFT_PASSES] } else { [VIEWS, PASSES] };
    let found = parts("light by direction", CHUNKS, progress, |chunk| Found::new(&cloth, data, samples, chunk))?;
    let mut all = Found::NONE;
    found.iter().for_each(|found| all.join(found));
    let (fit, mut sides) = (Fit::new(), data.inter_yarn.sides.clone());
    for to in 0..2 {
        // Light from a side is what leaves up of views of that side, and down of views of the other.
        let of = [(to, 0), (1 - to, 1)];
        let shaped = of.map(|(side, half)| all.shaped[side][half]);
        if shaped[0] + shaped[1] < MIN_SHAPED * PI {
            continue;
        }
        let old = of.map(|(side, half)| sides[side].shape[half * PAIRS]);
        let shapes = old.each_ref().map(values);
        let rest = all.fixed[to].map(|fixed| 1.0 - fixed);
        let mut wanted = rest;
        // The shapes cannot change how much light leaves by them in all.
        let integral: f64 = (0..LIGHTS)
            .map(|i| {
                let [z, share] = row(i / COLUMNS);
                wanted[i] * z * share * TAU / COLUMNS as f64
            })
            .sum();
        let per = (shaped[0] + shaped[1]) / integral.max(1e-9);
        wanted.iter_mut().for_each(|wanted| *wanted *= per);
        let mut factor = [1.0; LIGHTS];
        let mut fitted = shapes;
        for _ in 0..ROUNDS {
            let got: [f64; LIGHTS] = std::array::from_fn(|i| shaped[0] * fitted[0][i] + shaped[1] * fitted[1][i]);
            // Factors follow what polynomials can: they would grow without end where polynomials cannot.
            let more = values(&fit.poly(&std::array::from_fn(|i| wanted[i] - got[i])));
            for i in 0..LIGHTS {
                let ratio = 1.0 + more[i] / got[i].max(1e-6);
                factor[i] = (factor[i] * ratio.clamp(0.5, 2.0)).clamp(FACTORS[0], FACTORS[1]);
            }
            fitted = [0, 1].map(|n| values(&fit.shape(&std::array::from_fn(|i| factor[i] * shapes[n][i]), &old[n])));
        }
        let error = |i: usize| shaped[0] * fitted[0][i] + shaped[1] * fitted[1][i] - rest[i];
        let of_row = |row: usize| (row * COLUMNS..(row + 1) * COLUMNS).map(error).sum::<f64>() / COLUMNS as f64;
        if (0..ROWS).any(|row| of_row(row).abs() > MAX_LEFT) {
            return Ok(data.inter_yarn.clone());
        }
        for (side, half) in of {
            for shape in &mut sides[side].shape[half * PAIRS..][..PAIRS] {
                let old = values(shape);
                *shape = fit.shape(&std::array::from_fn(|i| factor[i] * old[i]), shape);
            }
        }
    }
    Ok(InterYarn::new(sides, LitPlaces::default()))
}
