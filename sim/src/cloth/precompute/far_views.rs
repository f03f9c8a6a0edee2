//! Mean of a cloth over its cell, for pixels that cover many yarns.
//!
//! Each kind of yarn has a grid of views. A view is averaged over the places of a Fibonacci lattice on the
//! cell: f towards a grid of lights, first-order energies by class, and the openings between plies.

use plywave::ClothQuery;
use plywave::bsdf::Bsdf;
use plywave::cloth::light::far_grid::{
    APERTURES, COLUMNS, FarData, NODES, PASSING, VIEWS, angles, direction, passing_direction, theta_of, view,
};
use plywave::cloth::light::{PLY_CLASSES, SIGMA_PER_UM, SIGMAS};
use plywave::cloth::shade::Toward;
use plywave::cloth::{Channels, ClothBsdf, ClothModel};
use plywave::gap::Opening;
use plywave::math::half::{from_half, to_half};
use std::f32::consts::TAU;

/// Number of places of the cell at which a view is evaluated, and the Fibonacci number before it; and those
/// for the light that passes all plies.
const PLACES: [usize; 2] = [233, 144];
const PASSING_PLACES: [usize; 2] = [1597, 987];

/// One view of one kind of yarn, averaged over the places of the cell.
pub(super) struct FarView {
    f: Vec<[f32; SIGMAS]>,
    first: [[f32; SIGMAS]; PLY_CLASSES],
    openings: Vec<Opening>,
}

/// The view of this number, from 0 to [`view_count`] - 1.
pub(super) fn far_view(cloth: &ClothModel, number: usize) -> FarView {
    let (kind, number) = (number / VIEWS, number % VIEWS);
    let runs = cloth.plies().runs[kind];
    let wo = view(runs, number);
    let theta_i = angles(runs, wo).0;
    let light = |i: usize| {
        let theta = theta_of(theta_i, (i % NODES) as f32).clamp(-1.55, 1.55);
        // The offset keeps directions out of the plane itself, where f is discontinuous.
        let phi = TAU * ((i / NODES) as f32 + 1e-3) / COLUMNS as f32;
        Toward::new(direction(runs, theta, phi))
    };
    let lights: Vec<Toward> = (0..COLUMNS * NODES).map(light).collect();
    let (f, first) = (vec![[0.0; SIGMAS]; lights.len()], [[0.0; SIGMAS]; PLY_CLASSES]);
    let mut mean = FarView { f, first, openings: Vec::new() };
    let per = 1.0 / PLACES[0] as f32;
    for place in places(PLACES, number) {
        let at = query(cloth, place, wo).seen(kind, &lights);
        for (sum, f) in mean.f.iter_mut().zip(&at.f) {
            (0..SIGMAS).for_each(|s| sum[s] += per * f[s]);
        }
        for (sum, energy) in mean.first.as_flattened_mut().iter_mut().zip(at.first.as_flattened()) {
            *sum += per * energy;
        }
        mean.openings.extend(at.opening);
    }
    mean
}

/// Number of views of a cloth over all its kinds of yarns.
pub(super) fn view_count(cloth: &ClothModel) -> usize {
    cloth.kinds() * VIEWS
}

/// The mean over the cell from [all views](far_view) and the light that [passes](passing), rounded to half
/// precision like in files.
pub(super) fn far_data(cloth: &ClothModel, views: &[FarView], passing: Vec<f32>) -> FarData {
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
        passing,
        openings: views[..VIEWS].iter().map(openings).collect(),
    }
}

/// Shares of the beam that pass all plies of a cloth without diffraction, for a latitude of the table.
pub(super) fn passing(cloth: &ClothModel, latitude: usize) -> Vec<f32> {
    let node = |azimuth: usize| {
        let node = latitude * PASSING[1] + azimuth;
        let wo = passing_direction(cloth.plies().runs[0], node);
        let sum: f64 = places(PASSING_PLACES, node).map(|place| f64::from(query(cloth, place, wo).straight()[0])).sum();
        (sum / PASSING_PLACES[0] as f64) as f32
    };
    (0..PASSING[1]).map(node).collect()
}

/// The places of a Fibonacci lattice, as fractions of the cell's vectors, with a shift for each `number`.
fn places([count, before]: [usize; 2], number: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(move |k| {
        let even = |step: f64, shift: f64| (k as f64 * step + number as f64 * shift).fract();
        [even(1.0 / count as f64, 0.618_034), even(before as f64 / count as f64, 0.414_214)]
    })
}

/// The cloth seen from `wo` at a place of the cell, at the nodes of absorption.
fn query(cloth: &ClothModel, place: [f64; 2], wo: [f32; 3]) -> ClothBsdf<'_, SIGMAS> {
    let [a, b] = cloth.plies().lattice.cell_um;
    let at = [0, 1].map(|k| (place[0] * a[k] + place[1] * b[k]) as f32);
    cloth.at(&ClothQuery {
        sigma_per_um: [Some(SIGMA_PER_UM); 2],
        channels: Channels::Wavelengths,
        ..ClothQuery::new(at, wo, [0.55; SIGMAS])
    })
}
