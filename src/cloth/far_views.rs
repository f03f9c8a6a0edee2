//! The making of the mean of a cloth over its cell: views of it at places of the cell.

use super::Channels;
use super::between::PLY_CLASSES;
use super::far::{
    APERTURES, COLUMNS, FarData, NODES, SIGMA_PER_UM, SIGMAS, Seen, VIEWS, angles, direction, theta_of, view,
};
use super::model::ClothModel;
use super::query::ClothQuery;
use super::shadow::Toward;
use crate::gap::Opening;
use crate::math::half::{from_half, to_half};
use std::f32::consts::TAU;

/// Places of the repeat at which a view is looked at, and the Fibonacci number before it.
const PLACES: usize = 233;
const LATTICE: usize = 144;

/// What one view sees of one kind of yarn, mean over the places of the cell.
pub struct FarView {
    f: Vec<[f32; SIGMAS]>,
    first: [[f32; SIGMAS]; PLY_CLASSES],
    passing: f32,
    openings: Vec<Opening>,
}

/// One of [`FarData::views`], by its number.
pub fn far_view(cloth: &ClothModel, number: usize) -> FarView {
    let (kind, number) = (number / VIEWS, number % VIEWS);
    let runs = cloth.plies.runs[kind];
    let wo = view(runs, number);
    let theta_i = angles(runs, wo).0;
    let lights: Vec<Toward> = (0..COLUMNS * NODES)
        .map(|i| {
            let theta = theta_of(theta_i, (i % NODES) as f32).clamp(-1.55, 1.55);
            // Not in the plane itself, where f ends.
            let phi = TAU * ((i / NODES) as f32 + 1e-3) / COLUMNS as f32;
            Toward::new(direction(runs, theta, phi))
        })
        .collect();
    let mut seen = FarView {
        f: vec![[0.0; SIGMAS]; lights.len()],
        first: [[0.0; SIGMAS]; PLY_CLASSES],
        passing: 0.0,
        openings: Vec::new(),
    };
    let per = 1.0 / PLACES as f32;
    for k in 0..PLACES {
        // Fibonacci's lattice, shifted from view to view.
        let even = |step: f64, shift: f64| (k as f64 * step + number as f64 * shift).fract();
        let place = [even(1.0 / PLACES as f64, 0.618_034), even(LATTICE as f64 / PLACES as f64, 0.414_214)];
        let at = cloth.seen(kind, place, wo, &lights);
        for (sum, f) in seen.f.iter_mut().zip(&at.f) {
            (0..SIGMAS).for_each(|s| sum[s] += per * f[s]);
        }
        for (sum, energy) in seen.first.as_flattened_mut().iter_mut().zip(at.first.as_flattened()) {
            *sum += per * energy;
        }
        seen.passing += per * at.passing;
        seen.openings.extend(at.opening);
    }
    seen
}

impl FarData {
    /// Number of views of a cloth, of all its kinds of yarns.
    pub fn views(cloth: &ClothModel) -> usize {
        cloth.plies.kinds * VIEWS
    }

    /// The mean over the places of a cloth, of [all views](far_view), as a file has it.
    pub fn new(cloth: &ClothModel, seen: &[FarView]) -> FarData {
        let openings = |view: &FarView| {
            // By area, from the parts of which each has as many.
            let mut all = view.openings.clone();
            all.sort_by_key(|Opening([x, y, _])| u32::from(*x) * u32::from(*y));
            let count = all.len().min(APERTURES);
            std::array::from_fn(|i| (i < count).then(|| all[(2 * i + 1) * all.len() / (2 * count)]))
        };
        FarData {
            runs: cloth.plies.runs,
            f: seen.iter().flat_map(|view| view.f.iter().map(|f| f.map(|f| from_half(to_half(f))))).collect(),
            first: seen.iter().map(|view| view.first).collect(),
            passing: seen[..VIEWS].iter().map(|view| view.passing).collect(),
            openings: seen[..VIEWS].iter().map(openings).collect(),
        }
    }
}

impl ClothModel {
    /// What is seen of the plies of a kind from `wo` at a place of the cell, by fractions of it, towards
    /// `lights`.
    fn seen(&self, kind: usize, place: [f64; 2], wo: [f32; 3], lights: &[Toward]) -> Seen {
        let [a, b] = self.plies.lattice.cell_um;
        let at = [0, 1].map(|k| (place[0] * a[k] + place[1] * b[k]) as f32);
        let query = ClothQuery {
            sigma_per_um: [Some(SIGMA_PER_UM); 2],
            channels: Channels::Wavelengths,
            ..ClothQuery::new(at, wo, [0.55; SIGMAS])
        };
        self.at(&query).seen(kind, lights)
    }
}
