//! Inter-yarn scattering: light that leaves a ply and hits another, until it leaves the cloth.
//!
//! The cloth's f has two parts: the light of the plies that the line hits, if it escapes without hitting
//! another yarn (`shade/`), and light that two or more plies scatter, which is computed here. The second part
//! is smooth. Its energies are computed once per cloth by tracing light from ply to ply (`plywave_sim`), and
//! fitted by regression to polynomials of the direction `a` of incidence (by reciprocity: of the viewer),
//! separately for
//!
//! - the side, face or back, on which the light is incident,
//! - the class of the first scatterer: its kind of yarn, whether it is the first ply on the line and whether
//!   another follows; or a hair,
//! - the half space of the cloth's normal into which the first ply sends the light: light upwards is
//!   intercepted by yarns beside it, light downwards by the layer below,
//! - the half space in which the light finally leaves the cloth,
//! - the absorptions of both kinds of yarns, at nodes.
//!
//! The distribution of the outgoing direction follows from reciprocity: averaged over a cell, the light from
//! a to b divided by the cosine at b is symmetric. With the energy E(a) of light that is reflected, the form
//! `E(a) E(b) cos b / integral E cos` is symmetric, has the energy E(a) and needs no other parameter. For
//! transmitted light, E(b) is the energy of light incident from b and transmitted in the reverse direction.
//! (Kulla and Conty 2017 use this form for the missing energy of microfacets.)

use crate::cloth::geometry::plies::Runs;
use crate::cloth::light::absorption::{SIGMAS, node_of};
use crate::cloth::light::cones::{Cone, ConeAt};
use crate::cloth::light::lit_places::{FUNCTIONS, LitPlaces, MAPS, Ratios, clear_map_share, functions};
use crate::cloth::light::terms::{FEW, Few, Poly, dot, few, terms};
use crate::cloth::shade::splines;
use crate::math::clamp_unit;
use crate::math::simd::{max, min};
use multiversion::multiversion;
use std::f32::consts::{PI, TAU};

/// Share of the light near cones whose samples are drawn from the cones; all others are cosine-distributed.
const ABOUT_CONES: f32 = 0.2;
/// Largest slope of the density of samples over the direction, so that every direction is drawn.
const MAX_LEAN: f32 = 0.9;
/// Number of pairs of absorptions, one of each kind of yarn.
pub const PAIRS: usize = SIGMAS * SIGMAS;
/// Number of classes of the first scatterer: its kind of yarn; for a ply, whether it is the first on the line
/// and whether another follows; or a hair, before or behind the plies.
pub const CLASSES: usize = 2 * CLASSES_A_KIND;
/// Number of classes per kind of yarn.
pub const CLASSES_A_KIND: usize = 6;
/// Number of those classes that are plies; they come first.
pub const PLY_CLASSES: usize = 4;
/// Tables for light incident on one side, the face or the back.
#[derive(Clone, Debug)]
pub struct Side {
    /// `[class][sent up, sent down, total][absorption of its kind]`: the energies of the first scatterer's
    /// light that other yarns intercept, sent towards the half space of incidence or away from it, and all of
    /// its energy.
    pub caught: Vec<splines::Several<SIGMAS>>,
    /// `[class][sent up, down][leaves up, down][pair]`: energy that leaves the cloth per energy that is
    /// intercepted.
    pub leaves: Vec<Few>,
    /// `[class][sent up, down][leaves up, down][absorption of its kind]`: the part of `leaves` that only
    /// yarns of the class's kind have scattered.
    pub parallel: Vec<[Few; SIGMAS]>,
    /// `[kind][leaves up, down]`: cones of the light in `parallel`.
    pub cones: [[Cone; 2]; 2],
    /// `[leaves up, down][pair]`: how the energy that cones do not distribute leaves; of integral 1 when
    /// weighted by the cosine. It is close to the mean of that energy over classes, by reciprocity.
    pub shape: Vec<Poly>,
}

/// Energies of a [`Side`], with what a query reads together side by side. A row of four results, of light
/// sent up that leaves up and down and of light sent down, holds two terms of each at a time.
#[derive(Clone, Debug)]
struct Packed {
    /// `[class][spline][sent up, sent down, total]`.
    caught: Vec<[[f32; SIGMAS]; 3]>,
    /// `[class][pair]`, `[class][absorption]`.
    leaves: Vec<Row>,
    parallel: Vec<Row>,
}

/// `[two terms][term][result]`.
type Row = [[f32; 2 * RESULTS]; FEW / 2];
/// Number of results of a class: by where the light is sent and where it leaves.
const RESULTS: usize = 4;

impl Packed {
    fn new(side: &Side) -> Packed {
        let row = |of: [&Few; RESULTS]| -> Row {
            std::array::from_fn(|j| std::array::from_fn(|i| of[i % RESULTS][2 * j + i / RESULTS]))
        };
        let caught = side
            .caught
            .as_chunks::<3>()
            .0
            .iter()
            .flat_map(|[up, down, all]| (0..splines::COUNT).map(move |i| [up[i], down[i], all[i]]));
        let leaves = side.leaves.as_chunks::<PAIRS>().0.as_chunks::<RESULTS>().0.iter();
        let leaves = leaves.flat_map(|of| (0..PAIRS).map(move |pair| row(of.each_ref().map(|of| &of[pair]))));
        let parallel = side.parallel.as_chunks::<RESULTS>().0.iter();
        let parallel = parallel.flat_map(|of| (0..SIGMAS).map(move |node| row(of.each_ref().map(|of| &of[node]))));
        Packed { caught: caught.collect(), leaves: leaves.collect(), parallel: parallel.collect() }
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(self.caught.as_slice())
            + size_of_val(self.leaves.as_slice())
            + size_of_val(self.parallel.as_slice())
    }
}

/// The tables of inter-yarn scattering of a cloth.
#[derive(Clone, Debug)]
pub struct InterYarn {
    /// `[face, back]`.
    pub sides: [Side; 2],
    /// Where the light leaves the cloth.
    pub places: LitPlaces,
    /// `[side]`: energies laid out for queries.
    packed: [Packed; 2],
    /// `[side][leaves up, down][pair]`: means of the functions of the light's direction over the shapes.
    means: Vec<[f32; FUNCTIONS]>,
    /// `[kind]`: axis along which the yarns run.
    pub(crate) runs: [Runs; 2],
}

/// Class of the ply that a line hits as number `depth`, counted from 0; `follows` if the line hits another
/// ply behind it.
#[inline(always)]
pub fn class(kind: usize, depth: usize, follows: bool) -> usize {
    CLASSES_A_KIND * kind + 2 * usize::from(depth > 0) + usize::from(follows)
}

/// Class of the hairs of a kind, on the side of incidence or, if `is_behind`, on the other side, reached by
/// light that passes all plies.
#[inline(always)]
pub fn class_of_hairs(kind: usize, is_behind: bool) -> usize {
    CLASSES_A_KIND * kind + PLY_CLASSES + usize::from(is_behind)
}

impl InterYarn {
    /// Builds the tables from both sides, with the warp along y, and the map over places.
    pub fn new(sides: [Side; 2], places: LitPlaces) -> InterYarn {
        let means = sides.iter().flat_map(|side| side.shape.iter().map(means_of_shape)).collect();
        InterYarn {
            means,
            packed: sides.each_ref().map(Packed::new),
            sides,
            places,
            runs: [Runs::AlongY, Runs::AlongX],
        }
    }

    /// The same tables for yarns that run along other axes.
    #[must_use]
    pub fn along(self, runs: [Runs; 2]) -> InterYarn {
        InterYarn { runs, ..self }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.places.memory_bytes()
            + self.packed.iter().map(Packed::memory_bytes).sum::<usize>()
            + self
                .sides
                .iter()
                .map(|s| {
                    size_of_val(s.caught.as_slice())
                        + size_of_val(s.leaves.as_slice())
                        + size_of_val(s.parallel.as_slice())
                        + size_of_val(s.shape.as_slice())
                })
                .sum::<usize>()
    }

    /// Inter-yarn scattering of a beam from `a`. `firsts` are the classes of the first scatterers with the
    /// energies that they scatter, `sent` holds factors on the light that they send up and down.
    #[inline]
    pub fn at<'a, const N: usize>(
        &'a self,
        a: [f32; 3],
        firsts: &[(usize, [f32; N])],
        sigma_per_um: [[f32; N]; 2],
        sent: [f32; 2],
    ) -> InterYarnAt<'a, N> {
        let mut at = InterYarnAt::none(a);
        self.at_into((a, &splines::At::new(a)), firsts, sigma_per_um, sent, &mut at);
        at
    }

    /// [`InterYarn::at`] in place, with the splines at `a`.
    #[inline(always)]
    pub(crate) fn at_into<'a, const N: usize>(
        &'a self,
        (a, place): ([f32; 3], &splines::At),
        firsts: &[(usize, [f32; N])],
        sigma_per_um: [[f32; N]; 2],
        sent: [f32; 2],
        at: &mut InterYarnAt<'a, N>,
    ) {
        let side = usize::from(a[2] < 0.0);
        at.up_sign = if side == 1 { -1.0 } else { 1.0 };
        at.shapes = self.sides[side].shape.as_chunks().0.first_chunk();
        let mut classes = [[0.0; N]; CLASSES];
        for (class, energy) in firsts {
            for k in 0..N {
                classes[*class][k] += energy[k];
            }
        }
        light(&self.packed[side], (a, place), &classes, sigma_per_um, sent, at);
        at.set_cones(self, a, side);
    }

    /// `[side][leaves up, down][pair]`: means of the functions of the light's direction over the shapes.
    pub(crate) fn means(&self) -> &[[f32; FUNCTIONS]] {
        &self.means
    }

    /// The same of light from one side.
    #[inline(always)]
    fn means_from(&self, side: usize) -> Option<&[[[f32; FUNCTIONS]; PAIRS]; 2]> {
        self.means.as_chunks::<PAIRS>().0.get(2 * side..)?.first_chunk()
    }
}

/// Means of the functions of a direction over a distribution on one half of the sphere.
fn means_of_shape(shape: &Poly) -> [f32; FUNCTIONS] {
    const ROWS: usize = 16;
    const COLUMNS: usize = 16;
    let mut means = [0.0; FUNCTIONS];
    for i in 0..ROWS * COLUMNS {
        // Cosine-weighted directions.
        let z = (((i / COLUMNS) as f32 + 0.5) / ROWS as f32).sqrt();
        let (sin, cos) = (TAU * (i % COLUMNS) as f32 / COLUMNS as f32).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let b = [across * cos, across * sin, z];
        let weight = PI / (ROWS * COLUMNS) as f32 * dot(shape, &terms(b));
        means.iter_mut().zip(functions(b)).for_each(|(mean, value)| *mean += weight * value);
    }
    let per = 1.0 / means[0].max(1e-6);
    means.map(|mean| per * mean)
}

/// The four pairs of absorptions around a pair of values, with their interpolation weights.
type Corners = [(u16, f32); 4];

/// Interpolates polynomials between pairs of absorptions.
#[inline(always)]
fn mixed<const T: usize>(of: &[[f32; T]; PAIRS], corners: &Corners) -> [f32; T] {
    let mut mixed = [0.0; T];
    for (pair, share) in corners {
        let of = &of[usize::from(*pair) % PAIRS];
        for n in 0..T {
            mixed[n] += share * of[n];
        }
    }
    mixed
}

/// Values of the four results of a row, whose terms have the values `few`.
#[inline(always)]
fn results(row: &Row, few: &Row) -> [f32; 2 * RESULTS] {
    let mut sums = [0.0; 2 * RESULTS];
    for j in 0..FEW / 2 {
        for i in 0..2 * RESULTS {
            sums[i] += few[j][i] * row[j][i];
        }
    }
    sums
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn light<const N: usize>(
    packed: &Packed,
    (a, place): ([f32; 3], &splines::At),
    classes: &[[f32; N]; CLASSES],
    sigma_per_um: [[f32; N]; 2],
    sent: [f32; 2],
    at: &mut InterYarnAt<'_, N>,
) {
    let of_terms = few(&terms(a));
    let mut few: Row = [[0.0; 2 * RESULTS]; FEW / 2];
    for j in 0..FEW / 2 {
        for i in 0..2 * RESULTS {
            few[j][i] = of_terms[2 * j + i / RESULTS];
        }
    }
    let mut nodes = [[(0, 0.0); N]; 2];
    for k in 0..N {
        let [(i, x), (j, y)] = [node_of(sigma_per_um[0][k]), node_of(sigma_per_um[1][k])];
        (nodes[0][k], nodes[1][k]) = ((i, x), (j, y));
        let pair = (SIGMAS * i + j) as u16;
        at.corners[k] = [
            (pair, (1.0 - x) * (1.0 - y)),
            (pair + 1, (1.0 - x) * y),
            (pair + SIGMAS as u16, x * (1.0 - y)),
            (pair + SIGMAS as u16 + 1, x * y),
        ];
    }
    for (class, energy) in classes.iter().enumerate() {
        let mut any = 0.0f32;
        for e in energy {
            any = max(any, *e);
        }
        if any <= 0.0 {
            continue;
        }
        let of = |size: usize| class * size..(class + 1) * size;
        let (Some(functions), Some(leaves), Some(parallel)) = (
            packed.caught.get(of(splines::COUNT)).and_then(|of| of.first_chunk::<{ splines::COUNT }>()),
            packed.leaves.get(of(PAIRS)).and_then(|of| of.first_chunk::<PAIRS>()),
            packed.parallel.get(of(SIGMAS)).and_then(|of| of.first_chunk::<SIGMAS>()),
        ) else {
            continue;
        };
        let kind = class / CLASSES_A_KIND;
        let mut at_nodes = [[0.0; SIGMAS]; 3];
        for (index, weight) in place.index.iter().zip(place.weight) {
            let of = &functions[usize::from(*index).min(splines::COUNT - 1)];
            for i in 0..3 {
                for n in 0..SIGMAS {
                    at_nodes[i][n] += weight * of[i][n];
                }
            }
        }
        let mut caught = [[0.0; N]; 2];
        for k in 0..N {
            let (own, u) = nodes[kind][k];
            let mut of = [0.0; 3];
            for i in 0..3 {
                of[i] = (1.0 - u) * at_nodes[i][own % SIGMAS] + u * at_nodes[i][(own + 1) % SIGMAS];
            }
            // The intercepted share of the energy depends less on absorption than the energy does.
            let per = energy[k] / max(of[2], 1e-6);
            for cause in 0..2 {
                // The value is negative where bent yarns let more light escape than straight ones.
                caught[cause][k] = sent[cause] * min(max(per * of[cause], -energy[k]), energy[k]);
                at.caught[k] += caught[cause][k];
                if class % CLASSES_A_KIND < PLY_CLASSES {
                    at.caught_of_plies[kind][k] += caught[cause][k];
                }
            }
        }
        for k in 0..N {
            let mut all = [0.0; 2 * RESULTS];
            for (pair, share) in &at.corners[k] {
                let of = results(&leaves[usize::from(*pair) % PAIRS], &few);
                for i in 0..2 * RESULTS {
                    all[i] += share * of[i];
                }
            }
            let (own, u) = nodes[kind][k];
            let low = results(&parallel[own % SIGMAS], &few);
            let high = results(&parallel[(own + 1) % SIGMAS], &few);
            for i in 0..RESULTS {
                let (cause, half) = (i / 2, i % 2);
                let all = min(max(all[i] + all[i + RESULTS], 0.0), 1.0);
                let (low, high) = (low[i] + low[i + RESULTS], high[i] + high[i + RESULTS]);
                at.energy[half][k] += caught[cause][k] * all;
                at.parallel[kind][half][k] += caught[cause][k] * min(max(low + u * (high - low), 0.0), all);
            }
        }
    }
    // Intercepted energies can be negative; sums are clamped to 0.
    for half in 0..2 {
        for k in 0..N {
            let mut rest = max(at.energy[half][k], 0.0);
            at.energy[half][k] = rest;
            for kind in 0..2 {
                at.parallel[kind][half][k] = min(max(at.parallel[kind][half][k], 0.0), rest);
                rest -= at.parallel[kind][half][k];
            }
        }
    }
    at.mean = at.energy;
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn eval<const N: usize>(shapes: &[Poly; PAIRS], corners: &[Corners; N], b: [f32; 3]) -> [f32; N] {
    let (t, cos) = (terms(b), b[2].abs());
    let mut f = [0.0; N];
    for k in 0..N {
        f[k] = max(dot(&mixed(shapes, &corners[k]), &t) * cos, 0.0);
    }
    f
}

/// Inter-yarn scattering for one direction of incidence and N absorptions.
#[derive(Clone, Copy, Debug)]
pub struct InterYarnAt<'a, const N: usize> {
    up_sign: f32,
    /// `[leaves up, down]`: energies that leave the cloth.
    pub energy: [[f32; N]; 2],
    /// The same, of the mean over places.
    mean: [[f32; N]; 2],
    /// `[leaves up, down][map]`: deviations from the mean over places, by function of the light's direction.
    deviations: Ratios,
    /// Share of the intercepted light that the plies of the deviations intercept.
    share: f32,
    /// Shares of the map of clear fibers.
    clear: [f32; N],
    /// `[leaves up, down]`: x and y of the density of samples, `cos / pi (1 + x b_x + y b_y)`.
    lean: [[f32; 2]; 2],
    /// `[kind][leaves up, down]`: the part of `energy` that only yarns of the kind have scattered.
    parallel: [[[f32; N]; 2]; 2],
    /// Energy that other yarns intercept of all first scatterers.
    pub caught: [f32; N],
    /// `[kind]`: the part of it that plies scattered first.
    pub caught_of_plies: [[f32; N]; 2],
    /// `[kind][leaves up, down]`: cones, and their shares of the samples.
    cones: [[Option<(ConeAt<'a>, f32)>; 2]; 2],
    /// `[leaves up, down][pair]`: shapes that are interpolated for each wavelength.
    shapes: Option<&'a [[Poly; PAIRS]; 2]>,
    corners: [Corners; N],
}

impl<'a, const N: usize> InterYarnAt<'a, N> {
    /// No scattered light, for a beam from `a`.
    #[inline(always)]
    pub(crate) fn none(a: [f32; 3]) -> Self {
        InterYarnAt {
            up_sign: if a[2] < 0.0 { -1.0 } else { 1.0 },
            energy: [[0.0; N]; 2],
            mean: [[0.0; N]; 2],
            deviations: [[[0.0; FUNCTIONS]; MAPS]; 2],
            share: 0.0,
            clear: [0.0; N],
            lean: [[0.0; 2]; 2],
            parallel: [[[0.0; N]; 2]; 2],
            caught: [0.0; N],
            caught_of_plies: [[0.0; N]; 2],
            cones: [[None; 2]; 2],
            shapes: None,
            corners: [[(0, 0.0); 4]; N],
        }
    }

    /// Prepares the cones of the light that only yarns of one kind have scattered.
    #[inline(always)]
    fn set_cones(&mut self, of: &'a InterYarn, a: [f32; 3], side: usize) {
        for kind in 0..2 {
            let axis = of.runs[kind].axis();
            for half in 0..2 {
                let (mut own, mut all) = (0.0, 0.0);
                for k in 0..N {
                    (own, all) = (own + self.parallel[kind][half][k], all + self.energy[half][k]);
                }
                if own > 0.0 {
                    let [from, back] = [&of.sides[side].cones[kind][half], &of.sides[side ^ half].cones[kind][half]];
                    let share = ABOUT_CONES * own / all;
                    self.cones[kind][half] = Some((ConeAt::new(axis, a, from, back), share));
                }
            }
        }
    }

    /// The mean energy over places, the deviations from it and their share.
    pub(crate) fn at_place(&self) -> ([[f32; N]; 2], Ratios, f32) {
        (self.mean, self.deviations, self.share)
    }

    /// Moves the light to the place at which the viewer sees it: `deviations` are those of the plies there,
    /// for light from the sides of the face and of the back, and `share` is the part of the intercepted light
    /// that these plies intercept.
    #[inline(always)]
    pub fn set_place(&mut self, of: &InterYarn, (deviations, share): (&Ratios, f32), sigma_per_um: [f32; N]) {
        self.share = share;
        let side = usize::from(self.up_sign < 0.0);
        self.deviations = [deviations[side], deviations[1 - side]];
        for k in 0..N {
            self.clear[k] = clear_map_share(sigma_per_um[k]);
        }
        let Some(means) = of.means_from(side) else { return };
        // `[k]`: energy that leaves, of the mean over places, and by the ratio of clear fibers.
        let mut leaves = [[0.0; 2]; N];
        for half in 0..2 {
            let mut of_cones = [[1.0; MAPS]; 2];
            for (kind, of) in of_cones.iter_mut().enumerate() {
                if let Some((cone, _)) = &self.cones[kind][half] {
                    *of = self.ratios(half, &cone.means());
                }
            }
            for k in 0..N {
                let mut at_shape = [0.0; FUNCTIONS];
                for (pair, share) in &self.corners[k] {
                    let of = &means[half][usize::from(*pair) % PAIRS];
                    for i in 0..FUNCTIONS {
                        at_shape[i] += share * of[i];
                    }
                }
                let [first, second] = [self.parallel[0][half][k], self.parallel[1][half][k]];
                let shaped = (self.mean[half][k] - first - second, self.ratios(half, &at_shape));
                self.energy[half][k] = 0.0;
                for (energy, ratios) in [(first, of_cones[0]), (second, of_cones[1]), shaped] {
                    self.energy[half][k] += energy * self.ratio(k, ratios);
                    leaves[k][1] += energy * max(ratios[0], 0.0);
                }
                leaves[k][0] += self.mean[half][k];
            }
            // Samples lean as the mean over wavelengths does.
            let clear = self.clear.iter().sum::<f32>() / N.max(1) as f32;
            let [bright, dark] = self.deviations[half];
            let (x, y) = (dark[1] + clear * (bright[1] - dark[1]), dark[2] + clear * (bright[2] - dark[2]));
            let (mut mean, mut here) = (0.0, 0.0);
            for k in 0..N {
                (mean, here) = (mean + self.mean[half][k], here + self.energy[half][k]);
            }
            let per = mean / max(here, 1e-3 * mean).max(f32::MIN_POSITIVE);
            let length = per * (x * x + y * y).sqrt();
            let per = per * min(MAX_LEAN / length.max(f32::MIN_POSITIVE), 1.0);
            self.lean[half] = [per * x, per * y];
        }
        // What leaves of clear fibers is what other yarns intercept.
        for (caught, [all, clear]) in self.caught.iter_mut().zip(leaves) {
            *caught *= if all > 0.0 { clear / all } else { 1.0 };
        }
    }

    /// `[map]`: ratios to the mean over places at values of the functions of the light's direction.
    #[inline(always)]
    fn ratios(&self, half: usize, t: &[f32; FUNCTIONS]) -> [f32; MAPS] {
        let [clear, dark] = &self.deviations[half];
        [1.0 + dot(clear, t), 1.0 + dot(dark, t)]
    }

    /// Ratio to the mean over places at one wavelength.
    #[inline(always)]
    fn ratio(&self, k: usize, [clear, dark]: [f32; MAPS]) -> f32 {
        max(dark + self.clear[k] * (clear - dark), 0.0)
    }

    /// Whether a direction lies in the half space of incidence.
    #[inline(always)]
    fn is_up(&self, b: [f32; 3]) -> bool {
        b[2] * self.up_sign >= 0.0
    }

    /// `[leaves up, down]`: the energy that the shapes distribute; cones distribute the rest.
    pub(crate) fn shaped_energy(&self) -> [[f32; N]; 2] {
        let [first, second] = &self.parallel;
        let of = |half: usize| std::array::from_fn(|k| self.mean[half][k] - first[half][k] - second[half][k]);
        [of(0), of(1)]
    }

    /// f in direction `b` [1/sr].
    #[inline]
    pub fn eval(&self, b: [f32; 3]) -> [f32; N] {
        self.eval_pdf([0.0; 2], b).0
    }

    /// f and the density of samples in direction `b` [1/sr]; `chances` are the probabilities of sampling
    /// light that leaves up and down.
    #[inline(always)]
    pub(crate) fn eval_pdf(&self, chances: [f32; 2], b: [f32; 3]) -> ([f32; N], f32) {
        let half = usize::from(!self.is_up(b));
        let mut f = [0.0; N];
        if let Some(shapes) = self.shapes {
            f = eval(&shapes[half], &self.corners, b);
        }
        for k in 0..N {
            f[k] *= self.mean[half][k] - self.parallel[0][half][k] - self.parallel[1][half][k];
        }
        let (mut pdf, mut rest) = (0.0, 1.0);
        for kind in 0..2 {
            if let Some((cone, share)) = &self.cones[kind][half] {
                let (of, density) = cone.eval_pdf(b);
                for k in 0..N {
                    f[k] += self.parallel[kind][half][k] * of;
                }
                (pdf, rest) = (pdf + share * density, rest - share);
            }
        }
        let ratios = self.ratios(half, &functions(b));
        for k in 0..N {
            f[k] *= self.ratio(k, ratios);
        }
        (f, chances[half] * (pdf + rest * self.evenly(half, b)))
    }

    /// Density of samples of one half that are not drawn from cones [1/sr].
    #[inline(always)]
    fn evenly(&self, half: usize, b: [f32; 3]) -> f32 {
        let [x, y] = self.lean[half];
        b[2].abs().min(1.0) / PI * (1.0 + x * b[0] + y * b[1])
    }

    /// Density of samples in direction `b` [1/sr]; `chances` are the probabilities of sampling light that
    /// leaves up and down.
    #[inline(always)]
    pub(crate) fn pdf(&self, chances: [f32; 2], b: [f32; 3]) -> f32 {
        let half = usize::from(!self.is_up(b));
        let (mut pdf, mut rest) = (0.0, 1.0);
        for kind in 0..2 {
            if let Some((cone, share)) = &self.cones[kind][half] {
                pdf += share * cone.pdf(b);
                rest -= share;
            }
        }
        chances[half] * (pdf + rest * self.evenly(half, b))
    }

    /// Samples a direction of the light that leaves up (`half` 0) or down (1).
    pub(crate) fn draw(&self, half: usize, u: [f32; 3]) -> [f32; 3] {
        let up = if half == 0 { self.up_sign } else { -self.up_sign };
        let (mut remaining, mut rest) = (u[0], 1.0);
        for kind in 0..2 {
            if let Some((cone, share)) = &self.cones[kind][half] {
                rest -= share;
                if remaining < *share {
                    return cone.draw([clamp_unit(u[1]), clamp_unit(u[2])], up);
                }
                remaining -= share;
            }
        }
        let (sin, cos) = (TAU * u[2]).sin_cos();
        let radius = u[1].sqrt();
        let [x, y] = [radius * cos, radius * sin];
        // Of two opposite directions, each is drawn in proportion to its density.
        let [lean_x, lean_y] = self.lean[half];
        let sign = if remaining < 0.5 * rest * (1.0 + lean_x * x + lean_y * y) { 1.0 } else { -1.0 };
        [sign * x, sign * y, up * (1.0 - u[1]).max(0.0).sqrt()]
    }
}
