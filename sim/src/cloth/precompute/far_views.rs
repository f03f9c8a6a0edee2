//! Mean of a cloth over its cell, for pixels that cover many yarns.
//!
//! Each kind of yarn has a grid of views. A view is averaged over the places of a Fibonacci lattice on the
//! cell: f towards a grid of lights, first-order energies by class, and the openings between plies.

use plywave::ClothQuery;
use plywave::cloth::light::far_grid::{
    APERTURES, COLUMNS, FarData, NODES, Seen, VIEWS, angles, direction, theta_of, view,
};
use plywave::cloth::light::{PLY_CLASSES, SIGMA_PER_UM, SIGMAS};
use plywave::cloth::shade::Toward;
use plywave::cloth::{Channels, ClothModel};
use plywave::gap::Opening;
use plywave::math::half::{from_half, to_half};
use std::f32::consts::TAU;

/// Number of places of the cell at which a view is evaluated, and the Fibonacci number before it.
const PLACES: usize = 233;
const LATTICE: usize = 144;

/// One view of one kind of yarn, averaged over the places of the cell.
pub(super) struct FarView {
    f: Vec<[f32; SIGMAS]>,
    first: [[f32; SIGMAS]; PLY_CLASSES],
    passing: f32,
    openings: Vec<Opening>,
}

/// The view of this number, from 0 to [`view_count`] - 1.
pub(super) fn far_view(cloth: &ClothModel, number: usize) -> FarView {
    let (kind, number) = (number / VIEWS, number % VIEWS);
    let runs = cloth.plies().runs[kind];
    let wo = view(runs, number);
    let theta_i = angles(runs, wo).0;
    let lights: Vec<Toward> = (0..COLUMNS * NODES)
        .map(|i| {
            let theta = theta_of(theta_i, (i % NODES) as f32).clamp(-1.55, 1.55);
            // The offset keeps directions out of the plane itself, where f is discontinuous.
            let phi = TAU * ((i / NODES) as f32 + 1e-3) / COLUMNS as f32;
            Toward::new(direction(runs, theta, phi))
        })
        .collect();
    let mut mean = FarView {
        f: vec![[0.0; SIGMAS]; lights.len()],
        first: [[0.0; SIGMAS]; PLY_CLASSES],
        passing: 0.0,
        openings: Vec::new(),
    };
    let per = 1.0 / PLACES as f32;
    for k in 0..PLACES {
        // A Fibonacci lattice, shifted from view to view.
        let even = |step: f64, shift: f64| (k as f64 * step + number as f64 * shift).fract();
        let place = [even(1.0 / PLACES as f64, 0.618_034), even(LATTICE as f64 / PLACES as f64, 0.414_214)];
        let at = view_at(cloth, kind, place, wo, &lights);
        for (sum, f) in mean.f.iter_mut().zip(&at.f) {
            (0..SIGMAS).for_each(|s| sum[s] += per * f[s]);
        }
        for (sum, energy) in mean.first.as_flattened_mut().iter_mut().zip(at.first.as_flattened()) {
            *sum += per * energy;
        }
        mean.passing += per * at.passing;
        mean.openings.extend(at.opening);
    }
    mean
}

/// Number of views of a cloth over all its kinds of yarns.
pub(super) fn view_count(cloth: &ClothModel) -> usize {
    cloth.kinds() * VIEWS
}

/// The mean over the cell from [all views](far_view), rounded to half precision like in files.
pub(super) fn far_data(cloth: &ClothModel, views: &[FarView]) -> FarData {
    let openings = |view: &FarView| {
        // Quantiles by area: one opening from each of `count` groups of equal number.
        let mut all = view.openings.clone();
        all.sort_by_key(|Opening([x, y, _])| u32::from(*x) * u32::from(*y));
        let count = all.len().min(APERTURES);
        std::array::from_fn(|i| (i < count).then(|| all[(2 * i + 1) * all.len() / (2 * count)]))
    };
    FarData {
        runs: cloth.plies().runs,
        f: views.iter().flat_map(|view| view.f.iter().map(|f| f.map(|f| from_half(to_half(f))))).collect(),
        first: views.iter().map(|view| view.first).collect(),
        passing: views[..VIEWS].iter().map(|view| view.passing).collect(),
        openings: views[..VIEWS].iter().map(openings).collect(),
    }
}

/// View of the plies of a kind from `wo` at a place of the cell, given by fractions of its vectors, towards
/// `lights`.
fn view_at(cloth: &ClothModel, kind: usize, place: [f64; 2], wo: [f32; 3], lights: &[Toward]) -> Seen {
    let [a, b] = cloth.plies().lattice.cell_um;
    let at = [0, 1].map(|k| (place[0] * a[k] + place[1] * b[k]) as f32);
    let query = ClothQuery {
        sigma_per_um: [Some(SIGMA_PER_UM); 2],
        channels: Channels::Wavelengths,
        ..ClothQuery::new(at, wo, [0.55; SIGMAS])
    };
    cloth.at(&query).seen(kind, lights)
}
