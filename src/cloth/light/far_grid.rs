//! The grid of a cloth's mean BSDF over its cell, and the tables on it ([`FarData`]).
//!
//! Directions are given by angles about the mean axis z of the yarns of a kind, which lies in the cloth's
//! plane: the latitude `theta = asin(w . z)`, and the azimuth `phi` from the other in-plane axis towards the
//! normal. Indices i belong to the viewer, o to the light. Nodes of theta_o are placed relative to the cone
//! `theta_o = -theta_i` and move with it.

use crate::cloth::geometry::plies::Runs;
use crate::cloth::light::absorption::SIGMAS;
use crate::cloth::light::inter_yarn::PLY_CLASSES;
use crate::gap::Opening;
use crate::math::simd::{atan2, exp2_within, ln, max, min, signed, sin_cos_half_turns};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, LOG2_E, PI, TAU};

/// Azimuths of the viewer over one side of the cloth [degrees], denser towards the plane.
pub(crate) const PHI_I_DEG: [f32; 15] =
    [2.5, 8.0, 18.0, 30.0, 43.0, 56.0, 73.0, 90.0, 107.0, 124.0, 137.0, 150.0, 162.0, 172.0, 177.5];
pub(crate) const SIDE: usize = PHI_I_DEG.len();
/// Latitudes of the viewer [degrees].
pub(crate) const THETA_I_DEG: [f32; 11] = [-82.0, -66.0, -49.0, -33.0, -16.0, 0.0, 16.0, 33.0, 49.0, 66.0, 82.0];
pub(crate) const ROWS: usize = THETA_I_DEG.len();
/// Number of directions of the viewer.
pub const VIEWS: usize = 2 * SIDE * ROWS;
/// Number of uniform azimuths of the light, and number of steps of its latitude on each side of the cone.
pub const COLUMNS: usize = 24;
pub(crate) const STEPS: usize = 8;
/// Smallest cosine of the light's latitude; closer to the axis, f is clamped to its value there.
pub(crate) const MIN_COSINE: f32 = 0.02;
/// Number of nodes of the light's latitude.
pub const NODES: usize = 2 * STEPS + 1;
pub(crate) const CELLS: usize = COLUMNS * (NODES - 1);
/// Numbers of latitudes and azimuths over half a turn at which the light that passes all plies is tabulated:
/// the middles of equal steps. A line and its reverse pass alike.
pub const PASSING: [usize; 2] = [32, 32];
/// Number of apertures that represent all apertures of the cell.
pub const APERTURES: usize = 3;
/// Apertures of a view; the entries that are present come first.
pub type Openings = [Option<Opening>; APERTURES];
/// Number of table entries for the openings of one view.
pub(crate) const OPENING_NUMBERS: usize = 1 + 3 * APERTURES;
/// theta and phi [rad] of a direction about the yarns of a kind.
#[inline(always)]
pub fn angles(runs: Runs, w: [f32; 3]) -> (f32, f32) {
    let (along, across) = match runs {
        Runs::AlongY => (w[1], w[0]),
        Runs::AlongX => (w[0], w[1]),
    };
    let along = min(max(along, -1.0), 1.0);
    let theta = atan2::<false>(along, ((1.0 - along) * (1.0 + along)).sqrt());
    (theta, atan2::<false>(w[2], across))
}

/// Sine and cosine of an angle within half a turn [rad].
#[inline(always)]
fn sin_cos(x: f32) -> (f32, f32) {
    let (sin, cos, sign) = sin_cos_half_turns::<false>(FRAC_1_PI * x);
    (signed(sin, sign), signed(cos, sign))
}

/// The inverse of [`angles`].
pub fn direction(runs: Runs, theta: f32, phi: f32) -> [f32; 3] {
    let (along, cos) = theta.sin_cos();
    let (up, across) = (cos * phi.sin(), cos * phi.cos());
    match runs {
        Runs::AlongY => [across, along, up],
        Runs::AlongX => [along, across, up],
    }
}

/// Latitude of the light [rad] at node q, from 0 to `2 STEPS`, for a viewer at theta_i; nodes are denser near
/// the cone.
#[inline(always)]
pub fn theta_of(theta_i: f32, q: f32) -> f32 {
    let t = q / STEPS as f32 - 1.0;
    let t = t * t.abs().sqrt();
    if t < 0.0 { -theta_i + t * (FRAC_PI_2 - theta_i) } else { -theta_i + t * (FRAC_PI_2 + theta_i) }
}

/// The inverse of [`theta_of`].
#[inline(always)]
pub(crate) fn q_of(theta_i: f32, theta_o: f32) -> f32 {
    let off = theta_o + theta_i;
    let width = if off < 0.0 { FRAC_PI_2 - theta_i } else { FRAC_PI_2 + theta_i };
    let t = min(off.abs() / max(width, 1e-6), 1.0);
    // t becomes its power 2/3.
    let t = exp2_within::<false>(2.0 / 3.0 * LOG2_E * ln::<false>(max(t, 1e-30)));
    STEPS as f32 * (1.0 + t.copysign(off))
}

/// Index of the node below `x` on an axis and the weight of the next, clamped to the axis.
#[inline(always)]
pub(crate) fn between_nodes(axis: &[f32], x: f32) -> (usize, f32) {
    let node = axis.partition_point(|node| *node <= x).clamp(1, axis.len() - 1) - 1;
    (node, ((x - axis[node]) / (axis[node + 1] - axis[node])).clamp(0.0, 1.0))
}

/// The four views around the viewer's direction, their interpolation weights, and the viewer's latitude
/// [rad].
#[inline(always)]
pub(crate) fn views(runs: Runs, wo: [f32; 3]) -> ([usize; 4], [f32; 4], f32) {
    let (theta, phi) = angles(runs, wo);
    let (i, s) = between_nodes(&PHI_I_DEG, phi.abs().to_degrees());
    let (m, t) = between_nodes(&THETA_I_DEG, theta.to_degrees());
    let first = if phi < 0.0 { SIDE } else { 0 };
    let at = |i: usize, m: usize| (first + i) * ROWS + m;
    let shares = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
    ([at(i, m), at(i, m + 1), at(i + 1, m), at(i + 1, m + 1)], shares, theta)
}

/// Direction of the viewer for a view.
pub fn view(runs: Runs, view: usize) -> [f32; 3] {
    let (azimuth, row) = (view / ROWS, view % ROWS);
    let phi = PHI_I_DEG[azimuth % SIDE].to_radians();
    direction(runs, THETA_I_DEG[row].to_radians(), if azimuth < SIDE { phi } else { -phi })
}

/// Direction at a node of the table of passing light, about the yarns of the first kind.
pub fn passing_direction(runs: Runs, node: usize) -> [f32; 3] {
    let [theta, phi] = [0, 1].map(|axis| {
        let number = if axis == 0 { node / PASSING[1] } else { node % PASSING[1] };
        PI * (number as f32 + 0.5) / PASSING[axis] as f32
    });
    direction(runs, theta - FRAC_PI_2, phi)
}

/// The four nodes of the table of passing light around a direction about the yarns of the first kind, and
/// their interpolation weights.
#[inline(always)]
pub(crate) fn passing_nodes(runs: Runs, w: [f32; 3]) -> ([usize; 4], [f32; 4]) {
    let w = if w[2] < 0.0 { [-w[0], -w[1], -w[2]] } else { w };
    let (theta, phi) = angles(runs, w);
    let [(i, s), (j, t)] = [(theta + FRAC_PI_2, PASSING[0]), (phi, PASSING[1])].map(|(x, count)| {
        let x = min(max(x * (count as f32 * FRAC_1_PI) - 0.5, 0.0), (count - 1) as f32);
        let node = (x as usize).min(count - 2);
        (node, x - node as f32)
    });
    let first = i * PASSING[1] + j;
    let weights = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
    ([first, first + 1, first + PASSING[1], first + PASSING[1] + 1], weights)
}

/// f and energies for one view at one point of the cell.
pub struct Seen {
    /// `[direction][node of absorption]`: f of the plies of the kind.
    pub f: Vec<[f32; SIGMAS]>,
    /// `[class of the kind][node of absorption]`: energies that its first plies scatter.
    pub first: [[f32; SIGMAS]; PLY_CLASSES],
    /// The aperture that the line passes, if the point lies in a gap.
    pub opening: Option<Opening>,
}

/// Solid angle of a grid cell for a viewer at theta_i [sr].
#[inline(always)]
pub(crate) fn solid_angle(theta_i: f32, q: usize) -> f32 {
    let (low, high) = (theta_of(theta_i, q as f32), theta_of(theta_i, (q + 1) as f32));
    (sin_cos(high).0 - sin_cos(low).0) * TAU / COLUMNS as f32
}

/// The tables of the mean as stored in the file; `Far` (`far.rs`) is built from them.
#[derive(Clone, Debug)]
pub struct FarData {
    /// `[kind]`: axis along which the yarns run.
    pub runs: [Runs; 2],
    /// `[kind][view][column][q][absorption]`: f; `Far` multiplies it by the cosine of the light's latitude.
    pub f: Vec<[f32; SIGMAS]>,
    /// `[kind][view][class of the kind][absorption]`: energies that first plies scatter.
    pub first: Vec<[[f32; SIGMAS]; PLY_CLASSES]>,
    /// `[latitude][azimuth]` of [`passing_direction`]: share of the beam that passes all plies.
    pub passing: Vec<f32>,
    /// `[view]` about the yarns of the first kind: apertures that this light passes.
    pub openings: Vec<Openings>,
}

impl FarData {
    /// Encodes the openings of all views, [`OPENING_NUMBERS`] entries each: their count, then their numbers.
    pub(crate) fn opening_numbers(openings: &[Openings]) -> Vec<u32> {
        let of = |view: &Openings| {
            let count = view.iter().flatten().count() as u32;
            let each = view.iter().flat_map(|opening| opening.unwrap_or_default().0.map(u32::from));
            [count].into_iter().chain(each).collect::<Vec<_>>()
        };
        openings.iter().flat_map(of).collect()
    }

    /// The inverse of [`FarData::opening_numbers`]; `None` if a number is out of range.
    pub(crate) fn openings_of(numbers: &[u32]) -> Option<Vec<Openings>> {
        let view = |numbers: &[u32; OPENING_NUMBERS]| {
            let mut openings = [None; APERTURES];
            let (count, all) = (numbers[0] as usize, numbers[1..].as_chunks::<3>().0);
            for (opening, numbers) in openings.iter_mut().zip(all).take(count) {
                *opening = Some(Opening::new(*numbers)?);
            }
            (count <= APERTURES).then_some(openings)
        };
        numbers.as_chunks::<OPENING_NUMBERS>().0.iter().map(view).collect()
    }
}

/// Integrals over the grid cell from q to q + 1 of the linear functions that fall from 1 to 0 and rise from 0
/// to 1, weighted by the derivative of t |t|^(1/2) with respect to q.
pub(crate) fn cell_weights(q: usize) -> [f32; 2] {
    let steps = STEPS as f64;
    // The near end is the one closer to the cone: x steps from it the derivative is 1.5 (x / STEPS)^(1/2) /
    // STEPS.
    let (near, is_above) = if q < STEPS { (STEPS - 1 - q, false) } else { (q - STEPS, true) };
    let [x, y] = [near, near + 1].map(|x| x as f64);
    let all = (y / steps).powf(1.5) - (x / steps).powf(1.5);
    let first = 0.6 * steps.powf(-1.5) * (y.powf(2.5) - x.powf(2.5));
    let [near, away] = [y * all - first, first - x * all].map(|w| w as f32);
    if is_above { [near, away] } else { [away, near] }
}

/// Angles from the cone to the axis on both sides of the cone [rad].
#[inline(always)]
pub(crate) fn widths(theta_i: f32) -> [f32; 2] {
    [FRAC_PI_2 - theta_i, FRAC_PI_2 + theta_i]
}

/// Cosine of the light's latitude with the lower bound that table entries use.
#[inline(always)]
pub(crate) fn cosine_of(theta: f32) -> f32 {
    max(sin_cos(theta).1, MIN_COSINE)
}
