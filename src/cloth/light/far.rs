//! The mean BSDF of a cloth over its cell, for pixels that cover many yarns.
//!
//! The light of the plies is tabulated for each kind of yarn in angles about the mean axis z of its yarns,
//! which lies in the cloth's plane: `theta = asin(w . z)`, and `phi` from the other in-plane axis towards the
//! normal. The light of a cylinder stays near the cone `theta_o = -theta_i`, so the nodes of theta_o are
//! placed relative to that cone and move with theta_i; entries at neighboring theta_i then describe the same
//! feature. Entries are the cloth's own f (`bsdf.rs`), with shadows, averaged over points distributed
//! uniformly over the cell, at nodes of absorption, times cos theta_o; they are interpolated linearly.
//! Inter-yarn scattering is computed from the mean energies (`inter_yarn.rs`), since it depends on directions
//! only. Light that passes all plies is diffracted by a few apertures that represent those of the cell. The
//! tables describe a cloth without hairs; the hair layer (`hair_layer.rs`) is added to the mean.
//!
//! Energy: with theta_o = -theta_i + t |t|^(1/2) w, where w is the angle from the cone to the axis on its
//! side, the integral of f is `sum over the sides of w integral f cos theta_o d(t |t|^(1/2)) dphi`. For
//! entries that include the cosine it is w times a fixed weighted sum of them, which is exact between views
//! too. [`InterYarnAt`] gives the part of the light of first plies that other plies intercept; the remaining
//! part leaves straight from its ply. f of each kind is scaled to that remaining energy, so that
//! interpolation neither creates nor loses energy (sim/tests/it/cloth_energy.rs). The mean is as reciprocal
//! as the cloth.

use crate::cloth::geometry::plies::Runs;
use crate::cloth::light::absorption::{LENGTH_UM, SIGMAS, sigma_weights};
use crate::cloth::light::far_grid::*;
use crate::cloth::light::hair_layer::{HairLayer, HairsAt};
use crate::cloth::light::inter_yarn::{CLASSES, CLASSES_A_KIND, InterYarnAt, PLY_CLASSES};
use crate::cloth::query::ClothQuery;
use crate::gap::GapAt;
use crate::math::simd::{max, min};
use crate::math::{clamp_unit, floor_fraction};
use multiversion::multiversion;
use std::f32::consts::{PI, TAU};

/// Energy below which the light of a kind is not rescaled.
const MIN_ENERGY: f32 = 1e-6;
/// Share of the samples of the plies' light that is uniform over the sphere.
const EVEN: f32 = 0.02;

/// `[node of absorption][channel]`: interpolation weights.
type Weights<const N: usize> = [[f32; N]; SIGMAS];

/// Absorptions of a kind of yarn whose yarns have several colors, as a mixture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mixed<const N: usize> {
    weights: Weights<N>,
    /// `[channel]`: mean of `1 / (1 + sigma L)`.
    mean: [f32; N],
}

impl<const N: usize> Mixed<N> {
    pub(crate) const NONE: Mixed<N> = Mixed { weights: [[0.0; N]; SIGMAS], mean: [0.0; N] };

    /// Adds a color that this share of the yarns has.
    #[inline(always)]
    pub(crate) fn add(&mut self, share: f32, sigma_per_um: [f32; N]) {
        for k in 0..N {
            let weights = sigma_weights(sigma_per_um[k]);
            for s in 0..SIGMAS {
                self.weights[s][k] += share * weights[s];
            }
            self.mean[k] += share / (1.0 + sigma_per_um[k].clamp(0.0, 1e6) * LENGTH_UM);
        }
    }

    /// One absorption per channel that represents the mixture [1/um].
    pub(crate) fn sigma(&self) -> [f32; N] {
        self.mean.map(|v| (1.0 / v.max(1e-9) - 1.0).max(0.0) / LENGTH_UM)
    }
}

/// Weight of the mean in a query's answer, seen from the viewer `wo`; `repeat_um` is the longer vector of the
/// cell. `None` for point queries, for queries with models of their own, and if `wo` is not a direction. The
/// weight is 1 from a footprint of one repeat on.
pub(crate) fn share<const N: usize>(query: &ClothQuery<'_, N>, wo: [f32; 3], repeat_um: f64) -> Option<f32> {
    let t = (2.0 * query.footprint_um / repeat_um as f32 - 1.0).clamp(0.0, 1.0);
    let share = t * t * (3.0 - 2.0 * t);
    // A NaN footprint compares false and counts as 0.
    let counts = share > 0.0 && crate::frame::is_direction(wo) && query.models.iter().all(Option::is_none);
    counts.then_some(share)
}

/// Tables of the mean for the plies of one kind of yarn.
#[derive(Clone, Debug)]
struct Plies {
    /// `[view][column][q][absorption]`: f times the cosine of the light's latitude.
    f: Vec<[f32; SIGMAS]>,
    /// `[view][clear, dark][cell]`: cumulative sampling probabilities up to the end of each grid cell; the
    /// last is 1.
    chances: Vec<f32>,
    /// `[view][side of the cone][absorption]`: integral of f, after the hairs, divided by the angle from the
    /// cone to the axis.
    energy: Vec<[[f32; SIGMAS]; 2]>,
    /// `[view][class of the kind][absorption]`: energies that first plies scatter.
    first: Vec<[[f32; SIGMAS]; PLY_CLASSES]>,
}

/// The mean BSDF of a cloth over its cell.
#[derive(Clone, Debug)]
pub(crate) struct Far {
    kinds: [Plies; 2],
    runs: [Runs; 2],
    /// `[node of passing_nodes]`: share of the beam that passes all plies.
    passing: Vec<f32>,
    /// `[view about the yarns of the first kind]`: its apertures.
    openings: Vec<Openings>,
}

impl Far {
    /// Builds the mean from its tables, for a cloth with or without hairs.
    pub(crate) fn new(data: FarData, hairs: Option<&HairLayer>) -> Far {
        let kind = |k: usize| {
            let of = data.f.chunks_exact(VIEWS * COLUMNS * NODES).nth(k).unwrap_or_default();
            let (mut f, mut chances, mut energy) = (of.to_vec(), Vec::new(), Vec::new());
            let weights: [[f32; 2]; NODES - 1] = std::array::from_fn(cell_weights);
            for (number, view) in f.chunks_exact_mut(COLUMNS * NODES).enumerate() {
                let theta_i = THETA_I_DEG[number % ROWS].to_radians();
                let cosines: [f32; NODES] = std::array::from_fn(|q| cosine_of(theta_of(theta_i, q as f32)));
                // The light that passes the hairs over the plies.
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

    /// The tables in the order of `tensors.rs`: f, sampling probabilities, energies and first energies by
    /// kind, passing light; then the openings.
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

    /// Interpolates the mean for a viewer in direction `wo` and the absorptions of warp and weft. Returns the
    /// light of the plies, the share of the beam that passes all plies, and its apertures. Until
    /// [`PliesAt::conserve`] is called, f has the energies of the table, after the hairs.
    ///
    /// The light that passes has a finer table than the energies that plies scatter. Those of clear plies
    /// are scaled to the remaining energy of the beam.
    #[inline(always)]
    pub(crate) fn at<const N: usize>(&self, wo: [f32; 3], dyes: [&Mixed<N>; 2]) -> (PliesAt<'_, N>, f32, &Openings) {
        let sigma = [dyes[0].weights, dyes[1].weights];
        let around = [views(self.runs[0], wo), views(self.runs[1], wo)];
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
            let (mut energy, mut first) = ([0.0; SIGMAS], [[0.0; SIGMAS]; PLY_CLASSES]);
            for v in 0..4 {
                let (sides, widths) = (&plies.energy[views[v]], widths(theta_i));
                for s in 0..SIGMAS {
                    energy[s] += shares[v] * (widths[0] * sides[0][s] + widths[1] * sides[1][s]);
                }
                let of = &plies.first[views[v]];
                for class in 0..PLY_CLASSES {
                    for s in 0..SIGMAS {
                        first[class][s] += shares[v] * of[class][s];
                    }
                }
            }
            for class in 0..PLY_CLASSES {
                clear += first[class][0];
                at.first[CLASSES_A_KIND * k + class] = mixed(&first[class], &sigma[k]);
            }
            at.energy[k] = mixed(&energy, &sigma[k]);
            // Share of the samples drawn as for dark fibers, from their share of the light.
            let (clear, dark) = (energy[0], energy[SIGMAS - 1]);
            let energy = mean(&at.energy[k]);
            at.dark[k] = if energy > 0.0 {
                ((clear - energy) / (clear - dark).max(1e-9) * dark / energy).clamp(0.0, 1.0)
            } else {
                0.0
            };
        }
        let (views, shares, _) = around[0];
        let mut passing = 1.0;
        if clear > MIN_ENERGY {
            let (nodes, weights) = passing_nodes(self.runs[0], wo);
            passing = (0..4).map(|k| weights[k] * self.passing[nodes[k]]).sum();
        }
        let per = (1.0 - passing) / clear.max(MIN_ENERGY);
        for energy in at.first.as_flattened_mut() {
            *energy *= per;
        }
        let nearest = (0..4).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).map_or(0, |i| views[i]);
        (at, passing, &self.openings[nearest])
    }
}

/// Values at nodes of absorption, interpolated for all channels.
#[inline(always)]
fn mixed<const N: usize>(of: &[f32; SIGMAS], weights: &Weights<N>) -> [f32; N] {
    let mut mixed = [0.0; N];
    for s in 0..SIGMAS {
        for n in 0..N {
            mixed[n] += of[s] * weights[s][n];
        }
    }
    mixed
}

/// Mean over channels.
#[inline(always)]
fn mean<const N: usize>(of: &[f32; N]) -> f32 {
    let mut sum = 0.0;
    for x in of {
        sum += x;
    }
    sum / N.max(1) as f32
}

/// The mean light of the plies for one direction of the viewer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PliesAt<'a, const N: usize> {
    far: &'a Far,
    /// `[kind]`: the four views around, their interpolation weights, and theta_i [rad].
    around: [([usize; 4], [f32; 4], f32); 2],
    /// `[kind]`: interpolation weights of the nodes of absorption.
    sigma: [Weights<N>; 2],
    /// `[kind][wavelength]`: energy that leaves the cloth straight from its plies, and factors on f.
    pub energy: [[f32; N]; 2],
    scale: [[f32; N]; 2],
    /// `[class][wavelength]`: energies that first plies scatter.
    pub first: [[f32; N]; CLASSES],
    /// `[kind]`: share of the samples that is drawn as for dark fibers.
    dark: [f32; 2],
}

impl<const N: usize> PliesAt<'_, N> {
    /// Scales f of each kind to these energies: what its first plies scatter and other plies do not
    /// intercept.
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

    /// Adds f in direction `b`, and the density of each kind's samples times its probability.
    #[inline(always)]
    fn add(&self, b: [f32; 3], chances: [f32; 2], f: &mut [f32; N], pdf: &mut f32) {
        for k in 0..2 {
            let (views, shares, theta_i) = self.around[k];
            let plies = &self.far.kinds[k];
            if plies.f.is_empty() {
                continue;
            }
            let (theta, phi) = angles(self.far.runs[k], b);
            let q = min(max(q_of(theta_i, theta), 0.0), (NODES - 1) as f32);
            // The azimuth is wrapped after scaling: adding a full turn to the angle would lose digits, and f
            // changes by a factor of several tens between neighboring columns.
            let (column, t) = floor_fraction(phi * (COLUMNS as f32 / TAU));
            let column = column.rem_euclid(COLUMNS as i32) as usize;
            let row = (q as usize).min(NODES - 2);
            let s = q - row as f32;
            let next = (column + 1) % COLUMNS;
            let nodes = [column * NODES + row, column * NODES + row + 1, next * NODES + row, next * NODES + row + 1];
            let weights = [(1.0 - t) * (1.0 - s), (1.0 - t) * s, t * (1.0 - s), t * s];
            let cell = column * (NODES - 1) + row;
            let (mut sum, mut density) = ([0.0; SIGMAS], 0.0);
            for v in 0..4 {
                if shares[v] <= 0.0 {
                    continue;
                }
                let of = &plies.f[views[v] * COLUMNS * NODES..][..COLUMNS * NODES];
                for i in 0..4 {
                    let (of, weight) = (&of[nodes[i]], weights[i] * shares[v]);
                    for s in 0..SIGMAS {
                        sum[s] += weight * of[s];
                    }
                }
                for (dark, share) in [1.0 - self.dark[k], self.dark[k]].into_iter().enumerate() {
                    let sums = &plies.chances[(2 * views[v] + dark) * CELLS..][..CELLS];
                    let before = if cell > 0 { sums[cell - 1] } else { 0.0 };
                    density += shares[v] * share * (sums[cell] - before);
                }
            }
            let light = mixed(&sum, &self.sigma[k]);
            let per_cosine = 1.0 / cosine_of(theta);
            for n in 0..N {
                f[n] += self.scale[k][n] * per_cosine * light[n];
            }
            *pdf += chances[k] * density / max(solid_angle(theta_i, row), 1e-12);
        }
    }

    /// Samples a direction of the light of kind `k`.
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

/// The mean of a cloth at a query.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FarAt<'a, const N: usize> {
    pub plies: PliesAt<'a, N>,
    pub inter_yarn: InterYarnAt<'a, N>,
    /// Share of the beam that passes all plies, and the apertures that diffract it; without apertures it goes
    /// straight on.
    pub passing: f32,
    pub gaps: [Option<GapAt<'a, N>>; APERTURES],
    /// The hair layers over the cloth.
    hairs: Option<HairsAt<'a, N>>,
    /// Energies that first plies and hairs scatter.
    first: [f32; N],
    /// Probabilities of sampling the light of warp and weft, inter-yarn scattering up and down, and
    /// diffracted light; light that goes straight on has the remaining probability.
    chances: [f32; 5],
}

impl<'a, const N: usize> FarAt<'a, N> {
    pub(crate) fn new(
        plies: PliesAt<'a, N>,
        inter_yarn: InterYarnAt<'a, N>,
        (passing, gaps): (f32, [Option<GapAt<'a, N>>; APERTURES]),
        mut hairs: Option<HairsAt<'a, N>>,
        first: [f32; N],
    ) -> Self {
        let [warp, weft] = plies.energy.map(|e| mean(&e));
        let [up, down] = inter_yarn.energy.map(|e| mean(&e));
        let of_hairs = hairs.as_ref().map_or([0.0; 2], |hairs| hairs.out().map(|out| mean(&out)));
        let all = warp + weft + up + down + of_hairs[0] + of_hairs[1] + passing;
        let per = if all > 0.0 { 1.0 / all } else { 0.0 };
        let diffracted = if gaps.iter().flatten().next().is_some() { passing } else { 0.0 };
        if let Some(hairs) = &mut hairs {
            hairs.set_chances(of_hairs.map(|e| e * per));
        }
        let chances = [warp, weft, up, down, diffracted].map(|e| e * per);
        FarAt { plies, inter_yarn, passing, gaps, hairs, first, chances }
    }

    fn is_diffracted(&self) -> bool {
        self.gaps[0].is_some()
    }

    /// Probability that sampling returns a direction.
    pub(crate) fn scattered(&self) -> f32 {
        (self.chances.iter().sum::<f32>() + self.hairs.as_ref().map_or(0.0, HairsAt::chance)).min(1.0)
    }

    pub(crate) fn straight(&self) -> f32 {
        if self.is_diffracted() { 0.0 } else { self.passing }
    }

    pub(crate) fn albedo(&self, k: usize) -> f32 {
        let diffracted = if self.is_diffracted() { self.passing } else { 0.0 };
        let plies = match self.hairs {
            // Hairs intercept part of the light that is in the table.
            Some(_) => (self.first[k] - self.inter_yarn.caught[k]).max(0.0),
            None => self.plies.energy[0][k] + self.plies.energy[1][k],
        };
        plies + self.inter_yarn.energy[0][k] + self.inter_yarn.energy[1][k] + diffracted
    }

    #[inline(always)]
    fn add(&self, b: [f32; 3], share: f32, f: &mut [f32; N], pdf: &mut f32) {
        let (inter_yarn, mut density) = self.inter_yarn.eval_pdf([self.chances[2], self.chances[3]], b);
        let mut own = [0.0; N];
        self.plies.add(b, [self.chances[0], self.chances[1]], &mut own, &mut density);
        if let Some(hairs) = &self.hairs {
            let free = hairs.free(b);
            for k in 0..N {
                own[k] *= free;
            }
            hairs.add(b, &mut own);
            density += hairs.pdf(b);
        }
        for k in 0..N {
            own[k] += inter_yarn[k];
        }
        if self.is_diffracted() {
            let per = 1.0 / self.gaps.iter().flatten().count() as f32;
            for gap in self.gaps.iter().flatten() {
                let (light, gap_pdf) = gap.conserved(b);
                for k in 0..N {
                    own[k] += per * self.passing * light[k];
                }
                density += per * self.chances[4] * gap_pdf;
            }
        }
        for k in 0..N {
            f[k] += share * own[k];
        }
        *pdf += share * density;
    }

    /// Samples a direction; `None` where light goes straight on.
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
                2 | 3 => Some(self.inter_yarn.draw(i - 2, [u0, u[1], u[2]])),
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

/// Adds f and density of the mean in a direction, times its share.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
pub(crate) fn add<const N: usize>(of: &FarAt<'_, N>, b: [f32; 3], share: f32, f: &mut [f32; N], pdf: &mut f32) {
    of.add(b, share, f, pdf);
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
    fn passing_light_is_found_at_its_nodes_from_both_sides() {
        for kind in [Runs::AlongY, Runs::AlongX] {
            for number in 0..PASSING[0] * PASSING[1] {
                let w = passing_direction(kind, number);
                for w in [w, w.map(|x| -x)] {
                    let (nodes, shares) = passing_nodes(kind, w);
                    let share: f32 = nodes.iter().zip(shares).filter(|(v, _)| **v == number).map(|(_, s)| s).sum();
                    assert!(share > 0.99, "{kind:?} node {number}: {nodes:?} {shares:?}");
                }
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
