//! The mean of a cloth over its cell: what a pixel sees that covers many yarns.
//!
//! Light of the plies is tabulated for each kind of yarn in angles about its yarns' mean axis z, which runs
//! in the cloth: `theta = asin(w . z)`, and `phi` from the other in-plane axis towards the normal. A
//! cylinder's light keeps near the cone `theta_o = -theta_i`, so that the table has theta_o on nodes about
//! that cone which move with theta_i: entries at neighboring theta_i then hold the same feature. Entries are
//! the cloth's own f (`bsdf.rs`), its shadows included, at places spread evenly over the cell, at nodes of
//! absorption, times cos theta_o; between the nodes they are linear. The light between yarns is that of the
//! mean energies (`between.rs`), which are a function of the direction to begin with. What passes all plies
//! is diffracted by a few apertures that stand for those of the cell. The tables are of a cloth without
//! hairs, whose layer (`hair_layer.rs`) is added to the mean.
//!
//! Energy. With theta_o = -theta_i + t |t|^(1/2) w, w the angle from the cone to the axis on its side, the
//! integral of f is `sum over the sides of w integral f cos theta_o d(t |t|^(1/2)) dphi`: of entries that
//! hold the cosine it is w times a fixed sum of them, exact between views too. Of the light that first plies
//! scatter, [`BetweenAt`] says what other plies catch; the rest leaves straight from its ply. f of each kind
//! is scaled to that rest, so that no light is made or lost between the nodes of the table
//! (sim/tests/it/cloth_energy.rs). The mean is as reciprocal as the cloth.

use super::between::{BetweenAt, CLASSES, CLASSES_A_KIND, PLY_CLASSES};
use super::hair_layer::{HairLayer, HairsAt};
use super::plies::Runs;
use super::query::ClothQuery;
use crate::gap::{GapAt, Opening};
use crate::math::{clamp_unit, floor_fraction};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Nodes of absorption [1/um], the last for an infinite one; between them f is linear in `1 / (1 + sigma L)`,
/// L some paths through a ply [um].
/// They are close at 0, where light scattered many times falls as the root of the absorption (Kubelka and
/// Munk).
pub const SIGMA_PER_UM: [f32; SIGMAS] = [0.0, 0.0006, 0.002, 0.005, 0.0115, 0.028, 0.085, 3.0];
/// How many.
pub const SIGMAS: usize = 8;
const LENGTH_UM: f32 = 150.0;
/// Azimuths of the viewer over one side of the cloth [degrees], closer towards the plane.
pub(crate) const PHI_I_DEG: [f32; 15] =
    [2.5, 8.0, 18.0, 30.0, 43.0, 56.0, 73.0, 90.0, 107.0, 124.0, 137.0, 150.0, 162.0, 172.0, 177.5];
const SIDE: usize = PHI_I_DEG.len();
/// Latitudes of the viewer [degrees].
pub(crate) const THETA_I_DEG: [f32; 11] = [-82.0, -66.0, -49.0, -33.0, -16.0, 0.0, 16.0, 33.0, 49.0, 66.0, 82.0];
const ROWS: usize = THETA_I_DEG.len();
/// Directions to the viewer.
pub(crate) const VIEWS: usize = 2 * SIDE * ROWS;
/// Azimuths of the light, evenly, and steps of its latitude to each side of the cone.
pub(crate) const COLUMNS: usize = 24;
const STEPS: usize = 8;
/// Least cosine of the light's latitude: nearer to the axis, f is that of there.
const MIN_COSINE: f32 = 0.02;
pub(crate) const NODES: usize = 2 * STEPS + 1;
pub(crate) const CELLS: usize = COLUMNS * (NODES - 1);
/// Apertures that stand for those of the repeat.
pub(crate) const APERTURES: usize = 3;
/// Those of a view: the first ones are there.
pub(crate) type Openings = [Option<Opening>; APERTURES];
/// Numbers of a view's openings in a table.
pub(crate) const OPENING_NUMBERS: usize = 1 + 3 * APERTURES;
/// A kind whose plies send less straight out of the cloth is not scaled.
const MIN_ENERGY: f32 = 1e-6;
/// Share of the samples of plies' light that is even over the sphere.
const EVEN: f32 = 0.02;

/// Shares of the nodes of absorption at one.
fn sigma_weights(sigma: f32) -> [f32; SIGMAS] {
    let v = |sigma: f32| 1.0 / (1.0 + sigma * LENGTH_UM);
    let sigma = sigma.max(0.0).min(SIGMA_PER_UM[SIGMAS - 1]);
    let node = SIGMA_PER_UM.partition_point(|node| *node <= sigma).clamp(1, SIGMAS - 1) - 1;
    let [low, high] = [SIGMA_PER_UM[node], SIGMA_PER_UM[node + 1]].map(v);
    let t = (low - v(sigma)) / (low - high);
    std::array::from_fn(|i| {
        if i == node {
            1.0 - t
        } else if i == node + 1 {
            t
        } else {
            0.0
        }
    })
}

/// Absorptions of a kind of yarn whose yarns have several colors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mixed<const N: usize> {
    weights: [[f32; SIGMAS]; N],
    /// Mean of `1 / (1 + sigma L)`.
    mean: [f32; N],
}

impl<const N: usize> Mixed<N> {
    pub(crate) const NONE: Mixed<N> = Mixed { weights: [[0.0; SIGMAS]; N], mean: [0.0; N] };

    /// With a color that this share of the yarns has.
    pub(crate) fn add(&mut self, share: f32, sigma_per_um: [f32; N]) {
        for k in 0..N {
            let weights = sigma_weights(sigma_per_um[k]);
            (0..SIGMAS).for_each(|s| self.weights[k][s] += share * weights[s]);
            self.mean[k] += share / (1.0 + sigma_per_um[k].clamp(0.0, 1e6) * LENGTH_UM);
        }
    }

    /// One absorption that stands for all [1/um].
    pub(crate) fn sigma(&self) -> [f32; N] {
        self.mean.map(|v| (1.0 / v.max(1e-9) - 1.0).max(0.0) / LENGTH_UM)
    }
}

/// theta and phi of a direction about a kind's yarns.
pub(super) fn angles(runs: Runs, w: [f32; 3]) -> (f32, f32) {
    let (along, across) = match runs {
        Runs::AlongY => (w[1], w[0]),
        Runs::AlongX => (w[0], w[1]),
    };
    (along.clamp(-1.0, 1.0).asin(), w[2].atan2(across))
}

/// The inverse of [`angles`].
pub(super) fn direction(runs: Runs, theta: f32, phi: f32) -> [f32; 3] {
    let (along, cos) = theta.sin_cos();
    let (up, across) = (cos * phi.sin(), cos * phi.cos());
    match runs {
        Runs::AlongY => [across, along, up],
        Runs::AlongX => [along, across, up],
    }
}

/// Latitude of a node of the light, q from 0 to `2 STEPS`, seen from theta_i: closer about the cone.
pub(super) fn theta_of(theta_i: f32, q: f32) -> f32 {
    let t = q / STEPS as f32 - 1.0;
    let t = t * t.abs().sqrt();
    if t < 0.0 { -theta_i + t * (FRAC_PI_2 - theta_i) } else { -theta_i + t * (FRAC_PI_2 + theta_i) }
}

/// The inverse of [`theta_of`].
fn q_of(theta_i: f32, theta_o: f32) -> f32 {
    let off = theta_o + theta_i;
    let width = if off < 0.0 { FRAC_PI_2 - theta_i } else { FRAC_PI_2 + theta_i };
    let t = (off.abs() / width.max(1e-6)).min(1.0);
    // t^(2/3).
    let t = t.cbrt();
    STEPS as f32 * (1.0 + (t * t).copysign(off))
}

/// Share of the mean in a query's answer, seen from `wo`: none of a point and of models of its own, all
/// beyond a repeat of this length [um].
pub(crate) fn share<const N: usize>(query: &ClothQuery<'_, N>, wo: [f32; 3], repeat_um: f64) -> Option<f32> {
    let t = (2.0 * query.footprint_um / repeat_um as f32 - 1.0).clamp(0.0, 1.0);
    let share = t * t * (3.0 - 2.0 * t);
    // Not a number is no footprint.
    let counts = share > 0.0 && crate::frame::is_direction(wo) && query.models.iter().all(Option::is_none);
    counts.then_some(share)
}

/// Node below `x` on an axis and the share of the next.
fn between_nodes(axis: &[f32], x: f32) -> (usize, f32) {
    let node = axis.partition_point(|node| *node <= x).clamp(1, axis.len() - 1) - 1;
    (node, ((x - axis[node]) / (axis[node + 1] - axis[node])).clamp(0.0, 1.0))
}

/// The four views around one, and their shares.
fn views(runs: Runs, wo: [f32; 3]) -> ([usize; 4], [f32; 4], f32) {
    let (theta, phi) = angles(runs, wo);
    let (i, s) = between_nodes(&PHI_I_DEG, phi.abs().to_degrees());
    let (m, t) = between_nodes(&THETA_I_DEG, theta.to_degrees());
    let first = if phi < 0.0 { SIDE } else { 0 };
    let at = |i: usize, m: usize| (first + i) * ROWS + m;
    let shares = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
    ([at(i, m), at(i, m + 1), at(i + 1, m), at(i + 1, m + 1)], shares, theta)
}

/// Direction of a view.
pub(super) fn view(runs: Runs, view: usize) -> [f32; 3] {
    let (azimuth, row) = (view / ROWS, view % ROWS);
    let phi = PHI_I_DEG[azimuth % SIDE].to_radians();
    direction(runs, THETA_I_DEG[row].to_radians(), if azimuth < SIDE { phi } else { -phi })
}

/// What a view sees at one place.
pub(crate) struct Seen {
    /// `[direction][node of absorption]`: f of the plies of the kind.
    pub f: Vec<[f32; SIGMAS]>,
    /// `[class of the kind][node]`: energies that its first plies scatter.
    pub first: [[f32; SIGMAS]; PLY_CLASSES],
    /// Energy that passes all plies, and the aperture that it passes, in a gap.
    pub passing: f32,
    pub opening: Option<Opening>,
}

/// Of one kind.
#[derive(Clone, Debug)]
struct Plies {
    /// `[view][column][q][SIGMAS]`: f times the cosine of the light's latitude.
    f: Vec<[f32; SIGMAS]>,
    /// `[view][clear, dark][cell]`: sums of the energies up to a cell's end, of all 1.
    chances: Vec<f32>,
    /// `[view][side of the cone][SIGMAS]`: integral of f, of what passes the hairs, over the angle from the
    /// cone to the axis.
    energy: Vec<[[f32; SIGMAS]; 2]>,
    /// `[view][class of the kind][SIGMAS]`.
    first: Vec<[[f32; SIGMAS]; PLY_CLASSES]>,
}

/// The mean of a cloth.
#[derive(Clone, Debug)]
pub(crate) struct Far {
    kinds: [Plies; 2],
    runs: [Runs; 2],
    /// `[view about the warp]`: energy that passes, and apertures for it.
    passing: Vec<f32>,
    openings: Vec<Openings>,
}

/// Solid angle of a cell seen from theta_i.
fn solid_angle(theta_i: f32, q: usize) -> f32 {
    let [low, high] = [q, q + 1].map(|q| theta_of(theta_i, q as f32).sin());
    (high - low) * TAU / COLUMNS as f32
}

/// The tables of a mean, from which the rest follows.
#[derive(Clone, Debug)]
pub struct FarData {
    pub(crate) runs: [Runs; 2],
    /// `[kind][view][column][q][SIGMAS]`.
    pub(crate) f: Vec<[f32; SIGMAS]>,
    /// `[kind][view][class of the kind][SIGMAS]`.
    pub(crate) first: Vec<[[f32; SIGMAS]; PLY_CLASSES]>,
    /// `[view]` of the first kind.
    pub(crate) passing: Vec<f32>,
    /// `[view]` of the first kind.
    pub(crate) openings: Vec<Openings>,
}

impl FarData {
    /// The openings of all views as numbers, [`OPENING_NUMBERS`] of each: how many there are, and their own.
    pub(crate) fn opening_numbers(openings: &[Openings]) -> Vec<u32> {
        let of = |view: &Openings| {
            let count = view.iter().flatten().count() as u32;
            let each = view.iter().flat_map(|opening| opening.unwrap_or_default().0.map(u32::from));
            [count].into_iter().chain(each).collect::<Vec<_>>()
        };
        openings.iter().flat_map(of).collect()
    }

    /// The inverse of [`FarData::opening_numbers`]; `None` of numbers that are none of openings.
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

/// Integrals of a cell from q to q + 1 of the functions that fall from 1 to 0 and rise from 0 to 1 over it,
/// times the growth of t |t|^(1/2) with q.
fn cell_weights(q: usize) -> [f32; 2] {
    let steps = STEPS as f64;
    // The end nearer to the cone: the growth is 1.5 (x / STEPS)^(1/2) / STEPS, x steps from it.
    let (near, is_above) = if q < STEPS { (STEPS - 1 - q, false) } else { (q - STEPS, true) };
    let [x, y] = [near, near + 1].map(|x| x as f64);
    let all = (y / steps).powf(1.5) - (x / steps).powf(1.5);
    let first = 0.6 * steps.powf(-1.5) * (y.powf(2.5) - x.powf(2.5));
    let [near, away] = [y * all - first, first - x * all].map(|w| w as f32);
    if is_above { [near, away] } else { [away, near] }
}

/// Angles from the cone to the axis, on its sides.
fn widths(theta_i: f32) -> [f32; 2] {
    [FRAC_PI_2 - theta_i, FRAC_PI_2 + theta_i]
}

/// Cosine of the latitude of light, as entries have it.
fn cosine_of(theta: f32) -> f32 {
    theta.cos().max(MIN_COSINE)
}

impl Far {
    /// Of its tables, under hairs.
    pub(crate) fn new(data: FarData, hairs: Option<&HairLayer>) -> Far {
        let kind = |k: usize| {
            let of = data.f.chunks_exact(VIEWS * COLUMNS * NODES).nth(k).unwrap_or_default();
            let (mut f, mut chances, mut energy) = (of.to_vec(), Vec::new(), Vec::new());
            let weights: [[f32; 2]; NODES - 1] = std::array::from_fn(cell_weights);
            for (number, view) in f.chunks_exact_mut(COLUMNS * NODES).enumerate() {
                let theta_i = THETA_I_DEG[number % ROWS].to_radians();
                let cosines: [f32; NODES] = std::array::from_fn(|q| cosine_of(theta_of(theta_i, q as f32)));
                // What passes the hairs.
                let mut free = view.to_vec();
                for (i, (f, free)) in view.iter_mut().zip(&mut free).enumerate() {
                    *f = f.map(|f| f * cosines[i % NODES]);
                    let toward = || {
                        let phi = TAU * (i / NODES) as f32 / COLUMNS as f32;
                        direction(data.runs[k], theta_of(theta_i, (i % NODES) as f32), phi)
                    };
                    let passes = hairs.map_or(1.0, |hairs| hairs.passes(toward()));
                    *free = f.map(|f| f * passes);
                }
                let mut cells = Vec::with_capacity(CELLS);
                let mut sides = [[0.0; SIGMAS]; 2];
                for cell in 0..CELLS {
                    let (column, q) = (cell / (NODES - 1), cell % (NODES - 1));
                    let at = |column: usize, q: usize| &free[column % COLUMNS * NODES + q];
                    let side = usize::from(q >= STEPS);
                    let share = 0.5 * TAU / COLUMNS as f32;
                    let mean: [f32; SIGMAS] = std::array::from_fn(|s| {
                        let of = |i: usize| share * weights[q][i] * (at(column, q + i)[s] + at(column + 1, q + i)[s]);
                        of(0) + of(1)
                    });
                    (0..SIGMAS).for_each(|s| sides[side][s] += mean[s]);
                    cells.push((solid_angle(theta_i, q) / (4.0 * PI), mean.map(|e| e * widths(theta_i)[side])));
                }
                let whole: [f32; SIGMAS] =
                    std::array::from_fn(|s| (0..2).map(|side| widths(theta_i)[side] * sides[side][s]).sum());
                for s in [0, SIGMAS - 1] {
                    let mut sum = 0.0;
                    for (even, mean) in &cells {
                        sum += EVEN * even
                            + if whole[s] > 0.0 { (1.0 - EVEN) * mean[s] / whole[s] } else { (1.0 - EVEN) * even };
                        chances.push(sum);
                    }
                }
                energy.push(sides);
            }
            let first = data.first.chunks_exact(VIEWS).nth(k).unwrap_or_default().to_vec();
            Plies { f, chances, energy, first }
        };
        let kinds = [kind(0), kind(1)];
        let FarData { runs, passing, openings, .. } = data;
        Far { kinds, runs, passing, openings }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        let plies = |p: &Plies| {
            size_of_val(p.f.as_slice())
                + size_of_val(p.chances.as_slice())
                + size_of_val(p.energy.as_slice())
                + size_of_val(p.first.as_slice())
        };
        self.kinds.iter().map(plies).sum::<usize>()
            + size_of_val(self.passing.as_slice())
            + size_of_val(self.openings.as_slice())
    }

    /// Its tables, as `tensors.rs` has them: f, chances, energies and first energies of the kinds, what
    /// passes; openings.
    pub(crate) fn numbers(&self) -> ([Vec<f32>; 5], Vec<u32>) {
        let of = |numbers: &dyn Fn(&Plies) -> Vec<f32>| self.kinds.iter().flat_map(numbers).collect::<Vec<f32>>();
        let tables = [
            of(&|p| p.f.as_flattened().to_vec()),
            of(&|p| p.chances.clone()),
            of(&|p| p.energy.as_flattened().as_flattened().to_vec()),
            of(&|p| p.first.iter().flat_map(|of| of.as_flattened().to_vec()).collect()),
            self.passing.clone(),
        ];
        (tables, FarData::opening_numbers(&self.openings))
    }

    /// Seen from `wo`, for the absorptions of warp and weft; f has the table's own energies, of what passes
    /// the hairs over it, until [`PliesAt::conserve`]. Then the energy that passes all plies, and the
    /// apertures that it passes.
    ///
    /// What clear plies of both kinds scatter and what passes are interpolated between views about different
    /// axes; together they are the beam, 1, to which they are scaled.
    pub(crate) fn at<const N: usize>(&self, wo: [f32; 3], dyes: [&Mixed<N>; 2]) -> (PliesAt<'_, N>, f32, &Openings) {
        let sigma = dyes.map(|dye| dye.weights);
        let around = self.runs.map(|runs| views(runs, wo));
        let mut at = PliesAt {
            far: self,
            around,
            sigma,
            energy: [[0.0; N]; 2],
            scale: [[1.0; N]; 2],
            first: [[0.0; N]; CLASSES],
            dark: [0.0; 2],
        };
        let mut clear = 0.0;
        for k in 0..2 {
            let (views, shares, theta_i) = around[k];
            let plies = &self.kinds[k];
            if plies.f.is_empty() {
                continue;
            }
            let mut energy = [0.0; SIGMAS];
            for (view, share) in views.into_iter().zip(shares) {
                clear += share * plies.first[view].iter().map(|of| of[0]).sum::<f32>();
                for (side, width) in plies.energy[view].iter().zip(widths(theta_i)) {
                    (0..SIGMAS).for_each(|s| energy[s] += share * width * side[s]);
                }
                for n in 0..N {
                    for class in 0..PLY_CLASSES {
                        at.first[CLASSES_A_KIND * k + class][n] += share * dot(&plies.first[view][class], &sigma[k][n]);
                    }
                }
            }
            at.energy[k] = sigma[k].map(|sigma| dot(&energy, &sigma));
            // Samples: of dark fibers by their share of the light.
            let (clear, dark) = (energy[0], energy[SIGMAS - 1]);
            let energy = at.energy[k].iter().sum::<f32>() / N.max(1) as f32;
            at.dark[k] = if energy > 0.0 {
                ((clear - energy) / (clear - dark).max(1e-9) * dark / energy).clamp(0.0, 1.0)
            } else {
                0.0
            };
        }
        let (views, shares, _) = around[0];
        let passing: f32 = views.iter().zip(shares).map(|(view, share)| share * self.passing[*view]).sum();
        let per = 1.0 / (clear + passing).max(MIN_ENERGY);
        at.first.as_flattened_mut().iter_mut().for_each(|energy| *energy *= per);
        let nearest = (0..4).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).map_or(0, |i| views[i]);
        (at, per * passing, &self.openings[nearest])
    }
}

fn dot(a: &[f32; SIGMAS], b: &[f32; SIGMAS]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The plies' mean light seen from one direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PliesAt<'a, const N: usize> {
    far: &'a Far,
    /// By kind, views around, their shares, theta_i.
    around: [([usize; 4], [f32; 4], f32); 2],
    /// `[kind][wavelength]`: shares of the nodes of absorption.
    sigma: [[[f32; SIGMAS]; N]; 2],
    /// `[kind]`: energy that leaves the cloth straight from its plies, and factors on f.
    pub energy: [[f32; N]; 2],
    scale: [[f32; N]; 2],
    /// `[class]`: energies that first plies scatter.
    pub first: [[f32; N]; CLASSES],
    /// `[kind]`: share of the samples that is drawn as for dark fibers.
    dark: [f32; 2],
}

impl<const N: usize> PliesAt<'_, N> {
    /// Scales f of each kind to what its first plies scatter and other plies do not catch.
    pub(crate) fn conserve(&mut self, energy: [[f32; N]; 2]) {
        for k in 0..2 {
            for n in 0..N {
                let own = energy[k][n].max(0.0);
                if self.energy[k][n] > MIN_ENERGY {
                    self.scale[k][n] = own / self.energy[k][n];
                    self.energy[k][n] = own;
                }
            }
        }
    }

    /// Adds f in a direction, and the density of a kind's samples times its chance.
    pub(crate) fn add(&self, b: [f32; 3], chances: [f32; 2], f: &mut [f32; N], pdf: &mut f32) {
        for k in 0..2 {
            let (views, shares, theta_i) = self.around[k];
            let plies = &self.far.kinds[k];
            if plies.f.is_empty() {
                continue;
            }
            let (theta, phi) = angles(self.far.runs[k], b);
            let q = q_of(theta_i, theta).clamp(0.0, (NODES - 1) as f32);
            // A turn is not added to the angle: its digits would be lost, and f falls by a factor of some
            // tens from a column to the next.
            let (column, t) = floor_fraction(phi * (COLUMNS as f32 / TAU));
            let column = column.rem_euclid(COLUMNS as i32) as usize;
            let (row, s) = ((q as usize).min(NODES - 2), q - (q as usize).min(NODES - 2) as f32);
            let next = (column + 1) % COLUMNS;
            let mut sum = [0.0; SIGMAS];
            let cell = column * (NODES - 1) + row;
            let mut density = 0.0;
            for (view, share) in views.into_iter().zip(shares) {
                if share <= 0.0 {
                    continue;
                }
                let of = &plies.f[view * COLUMNS * NODES..][..COLUMNS * NODES];
                for (node, weight) in [
                    (column * NODES + row, (1.0 - t) * (1.0 - s)),
                    (column * NODES + row + 1, (1.0 - t) * s),
                    (next * NODES + row, t * (1.0 - s)),
                    (next * NODES + row + 1, t * s),
                ] {
                    let weight = weight * share;
                    (0..SIGMAS).for_each(|i| sum[i] += weight * of[node][i]);
                }
                let chance = |dark: usize| {
                    let sums = &plies.chances[(2 * view + dark) * CELLS..][..CELLS];
                    sums[cell] - if cell > 0 { sums[cell - 1] } else { 0.0 }
                };
                density += share * ((1.0 - self.dark[k]) * chance(0) + self.dark[k] * chance(1));
            }
            let per_cosine = 1.0 / cosine_of(theta);
            for n in 0..N {
                f[n] += self.scale[k][n] * per_cosine * dot(&sum, &self.sigma[k][n]);
            }
            *pdf += chances[k] * density / solid_angle(theta_i, row).max(1e-12);
        }
    }

    /// A direction of a kind's light.
    pub(crate) fn draw(&self, k: usize, u: [f32; 3]) -> [f32; 3] {
        let (views, shares, theta_i) = self.around[k];
        let (mut u0, mut view) = (u[0], views[3]);
        for (v, share) in views.into_iter().zip(shares) {
            if u0 < share {
                (view, u0) = (v, u0 / share);
                break;
            }
            u0 -= share;
        }
        let dark = usize::from(clamp_unit(u0) < self.dark[k]);
        let sums = &self.far.kinds[k].chances[(2 * view + dark) * CELLS..][..CELLS];
        let target = u[1] * sums[CELLS - 1];
        let cell = sums.partition_point(|sum| *sum <= target).min(CELLS - 1);
        let low = if cell > 0 { sums[cell - 1] } else { 0.0 };
        let across = clamp_unit((target - low) / (sums[cell] - low).max(1e-20));
        let (column, row) = (cell / (NODES - 1), cell % (NODES - 1));
        let [a, b] = [row, row + 1].map(|q| theta_of(theta_i, q as f32).sin());
        let sine = a + (b - a) * u[2];
        direction(self.far.runs[k], sine.clamp(-1.0, 1.0).asin(), TAU * (column as f32 + across) / COLUMNS as f32)
    }
}

/// The mean of a cloth at a query, and its share of the answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FarAt<'a, const N: usize> {
    pub plies: PliesAt<'a, N>,
    pub between: BetweenAt<'a, N>,
    /// Energy that passes all plies, and the apertures that diffract it; straight on without.
    pub passing: f32,
    pub gaps: [Option<GapAt<'a, N>>; APERTURES],
    /// The hairs over the cloth.
    hairs: Option<HairsAt<'a, N>>,
    /// Energies that first plies and hairs scatter.
    first: [f32; N],
    /// Chances of warp and weft, light between yarns that leaves up and down, diffracted light; the rest goes
    /// straight on.
    chances: [f32; 5],
}

impl<'a, const N: usize> FarAt<'a, N> {
    pub(crate) fn new(
        plies: PliesAt<'a, N>,
        between: BetweenAt<'a, N>,
        (passing, gaps): (f32, [Option<GapAt<'a, N>>; APERTURES]),
        mut hairs: Option<HairsAt<'a, N>>,
        first: [f32; N],
    ) -> Self {
        let mean = |x: &[f32; N]| x.iter().sum::<f32>() / N.max(1) as f32;
        let [warp, weft] = plies.energy.map(|e| mean(&e));
        let [up, down] = between.energy.map(|e| mean(&e));
        let of_hairs = hairs.as_ref().map_or([0.0; 2], |hairs| hairs.out().map(|out| mean(&out)));
        let all = warp + weft + up + down + of_hairs[0] + of_hairs[1] + passing;
        let per = if all > 0.0 { 1.0 / all } else { 0.0 };
        let diffracted = if gaps.iter().flatten().next().is_some() { passing } else { 0.0 };
        if let Some(hairs) = &mut hairs {
            hairs.set_chances(of_hairs.map(|e| e * per));
        }
        let chances = [warp, weft, up, down, diffracted].map(|e| e * per);
        FarAt { plies, between, passing, gaps, hairs, first, chances }
    }

    fn is_diffracted(&self) -> bool {
        self.gaps[0].is_some()
    }

    /// Chance of a direction.
    pub(crate) fn scattered(&self) -> f32 {
        (self.chances.iter().sum::<f32>() + self.hairs.as_ref().map_or(0.0, HairsAt::chance)).min(1.0)
    }

    pub(crate) fn straight(&self) -> f32 {
        if self.is_diffracted() { 0.0 } else { self.passing }
    }

    pub(crate) fn albedo(&self, k: usize) -> f32 {
        let diffracted = if self.is_diffracted() { self.passing } else { 0.0 };
        let plies = match self.hairs {
            // Hairs catch of the light that the table has.
            Some(_) => (self.first[k] - self.between.caught[k]).max(0.0),
            None => self.plies.energy[0][k] + self.plies.energy[1][k],
        };
        plies + self.between.energy[0][k] + self.between.energy[1][k] + diffracted
    }

    pub(crate) fn add(&self, b: [f32; 3], share: f32, f: &mut [f32; N], pdf: &mut f32) {
        let (mut own, mut density) = ([0.0; N], self.between.pdf([self.chances[2], self.chances[3]], b));
        self.plies.add(b, [self.chances[0], self.chances[1]], &mut own, &mut density);
        if let Some(hairs) = &self.hairs {
            let free = hairs.free(b);
            own.iter_mut().for_each(|f| *f *= free);
            hairs.add(b, &mut own);
            density += hairs.pdf(b);
        }
        let between = self.between.eval(b);
        (0..N).for_each(|k| own[k] += between[k]);
        let count = self.gaps.iter().flatten().count();
        for gap in self.gaps.iter().flatten() {
            let (light, gap_pdf) = gap.conserved(b);
            (0..N).for_each(|k| own[k] += self.passing / count as f32 * light[k]);
            density += self.chances[4] / count as f32 * gap_pdf;
        }
        (0..N).for_each(|k| f[k] += share * own[k]);
        *pdf += share * density;
    }

    /// A direction; none where light goes straight on.
    pub(crate) fn draw(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        let mut remaining = u[0];
        if let Some(hairs) = &self.hairs {
            if remaining < hairs.chance() {
                return Some(hairs.draw([remaining, u[1], u[2]]));
            }
            remaining -= hairs.chance();
        }
        for (i, chance) in self.chances.into_iter().enumerate() {
            if remaining >= chance {
                remaining -= chance;
                continue;
            }
            let u0 = clamp_unit(remaining / chance);
            return match i {
                0 | 1 => Some(self.plies.draw(i, [u0, u[1], u[2]])),
                2 | 3 => Some(self.between.draw(i - 2, [u0, u[1], u[2]])),
                _ => {
                    let count = self.gaps.iter().flatten().count();
                    let x = u0 * count as f32;
                    let gap = self.gaps.iter().flatten().nth((x as usize).min(count - 1))?;
                    gap.conserved_sample([clamp_unit(x.fract()), u[1], u[2]])
                }
            };
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_and_nodes_are_inverted() {
        for (i, kind) in [Runs::AlongY, Runs::AlongX].into_iter().enumerate() {
            for k in 0..200 {
                let (theta, phi) = (1.5 * (0.37 * k as f32 + i as f32).sin(), 3.1 * (0.71 * k as f32).cos());
                let (t, p) = angles(kind, direction(kind, theta, phi));
                assert!((t - theta).abs() < 1e-3 && (p - phi).abs() < 1e-4, "{kind:?} {theta} {phi}: {t} {p}");
                let theta_o = 1.55 * (0.13 * k as f32).sin();
                assert!((theta_of(theta, q_of(theta, theta_o)) - theta_o).abs() < 1e-4, "{theta} {theta_o}");
            }
        }
    }

    #[test]
    fn views_are_found_at_their_nodes() {
        for kind in [Runs::AlongY, Runs::AlongX] {
            for number in 0..VIEWS {
                let (views, shares, _) = views(kind, view(kind, number));
                let share: f32 = views.iter().zip(shares).filter(|(v, _)| **v == number).map(|(_, s)| s).sum();
                assert!(share > 0.999, "{kind:?} view {number}: {views:?} {shares:?}");
            }
        }
    }
}
