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
use crate::cloth::light::terms::{Few, Poly, dot, few, terms};
use crate::cloth::shade::splines;
use crate::math::clamp_unit;
use crate::math::simd::{max, min};
use multiversion::multiversion;
use std::f32::consts::{PI, TAU};

/// Share of the light near cones whose samples are drawn from the cones; all others are cosine-distributed.
const ABOUT_CONES: f32 = 0.2;
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
    /// `[leaves up, down][pair]`: the mean energy over classes, divided by the integral of its
    /// cosine-weighted values.
    pub shape: Vec<Poly>,
}

/// The tables of inter-yarn scattering of a cloth.
#[derive(Clone, Debug)]
pub struct InterYarn {
    /// `[face, back]`.
    pub sides: [Side; 2],
    /// `[kind]`: axis along which the yarns run.
    pub(crate) runs: [Runs; 2],
}

/// Class of the ply that a line hits as number `depth`, counted from 0; `follows` if the line hits another
/// ply behind it.
#[inline]
pub fn class(kind: usize, depth: usize, follows: bool) -> usize {
    CLASSES_A_KIND * kind + 2 * usize::from(depth > 0) + usize::from(follows)
}

/// Class of the hairs of a kind, on the side of incidence or, if `is_behind`, on the other side, reached by
/// light that passes all plies.
#[inline]
pub fn class_of_hairs(kind: usize, is_behind: bool) -> usize {
    CLASSES_A_KIND * kind + PLY_CLASSES + usize::from(is_behind)
}

impl InterYarn {
    /// Builds the tables from both sides, with the warp along y.
    pub fn new(sides: [Side; 2]) -> InterYarn {
        InterYarn { sides, runs: [Runs::AlongY, Runs::AlongX] }
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.sides
            .iter()
            .map(|s| {
                size_of_val(s.caught.as_slice())
                    + size_of_val(s.leaves.as_slice())
                    + size_of_val(s.parallel.as_slice())
                    + size_of_val(s.shape.as_slice())
            })
            .sum()
    }

    /// Inter-yarn scattering of a beam from `a`. `firsts` are the classes of the first scatterers with the
    /// energies that they scatter, `sent` holds factors on the light that they send up and down.
    #[inline]
    pub(crate) fn at<'a, const N: usize>(
        &'a self,
        a: [f32; 3],
        firsts: &[(usize, [f32; N])],
        sigma_per_um: [[f32; N]; 2],
        sent: [f32; 2],
    ) -> InterYarnAt<'a, N> {
        let mut classes = [[0.0; N]; CLASSES];
        for (class, energy) in firsts {
            (0..N).for_each(|k| classes[*class][k] += energy[k]);
        }
        let side = usize::from(a[2] < 0.0);
        let mut at = light(&self.sides[side], a, &classes, sigma_per_um, sent);
        at.set_cones(self, a, side);
        at
    }
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

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn light<'a, const N: usize>(
    side: &'a Side,
    a: [f32; 3],
    classes: &[[f32; N]; CLASSES],
    sigma_per_um: [[f32; N]; 2],
    sent: [f32; 2],
) -> InterYarnAt<'a, N> {
    let mut at = InterYarnAt::none(a);
    at.shapes = side.shape.as_chunks().0.first_chunk();
    let (few, place) = (few(&terms(a)), splines::At::new(a));
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
    let leaves = side.leaves.as_chunks::<PAIRS>().0.as_chunks::<2>().0.as_chunks::<2>().0;
    let parallel = side.parallel.as_chunks::<2>().0.as_chunks::<2>().0;
    for (class, energy) in classes.iter().enumerate() {
        let mut any = 0.0f32;
        for e in energy {
            any = max(any, *e);
        }
        if any <= 0.0 {
            continue;
        }
        let functions = side.caught.get(3 * class..).and_then(|of| of.first_chunk::<3>());
        let (Some(leaves), Some(parallel), Some(functions)) = (leaves.get(class), parallel.get(class), functions)
        else {
            continue;
        };
        let kind = class / CLASSES_A_KIND;
        let mut at_nodes = [[0.0; SIGMAS]; 3];
        for (at_nodes, of) in at_nodes.iter_mut().zip(functions) {
            place.add(of, at_nodes);
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
        for cause in 0..2 {
            if sent[cause] == 0.0 {
                continue;
            }
            for half in 0..2 {
                for k in 0..N {
                    let mixed = mixed(&leaves[cause][half], &at.corners[k]);
                    let all = min(max(dot(&mixed, &few), 0.0), 1.0);
                    let (own, u) = nodes[kind][k];
                    let [low, high] = [own, own + 1].map(|own| dot(&parallel[cause][half][own % SIGMAS], &few));
                    at.energy[half][k] += caught[cause][k] * all;
                    at.parallel[kind][half][k] += caught[cause][k] * min(max(low + u * (high - low), 0.0), all);
                }
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
    at
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
pub(crate) struct InterYarnAt<'a, const N: usize> {
    up_sign: f32,
    /// `[leaves up, down]`: energies that leave the cloth.
    pub energy: [[f32; N]; 2],
    /// `[kind][leaves up, down]`: the part of `energy` that only yarns of the kind have scattered.
    parallel: [[[f32; N]; 2]; 2],
    /// Energy that other yarns intercept of all first scatterers, and of the plies of each kind alone.
    pub caught: [f32; N],
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
            parallel: [[[0.0; N]; 2]; 2],
            caught: [0.0; N],
            caught_of_plies: [[0.0; N]; 2],
            cones: [[None; 2]; 2],
            shapes: None,
            corners: [[(0, 0.0); 4]; N],
        }
    }

    /// Prepares the cones of the light that only yarns of one kind have scattered.
    #[inline]
    fn set_cones(&mut self, of: &'a InterYarn, a: [f32; 3], side: usize) {
        for kind in 0..2 {
            let axis = of.runs[kind].axis();
            for half in 0..2 {
                let own: f32 = self.parallel[kind][half].iter().sum();
                if own > 0.0 {
                    let [from, back] = [side, side ^ half].map(|side| &of.sides[side].cones[kind][half]);
                    let share = ABOUT_CONES * own / self.energy[half].iter().sum::<f32>();
                    self.cones[kind][half] = Some((ConeAt::new(axis, a, from, back), share));
                }
            }
        }
    }

    /// Whether a direction lies in the half space of incidence.
    #[inline]
    fn is_up(&self, b: [f32; 3]) -> bool {
        b[2] * self.up_sign >= 0.0
    }

    /// f in direction `b` [1/sr].
    #[inline]
    pub(crate) fn eval(&self, b: [f32; 3]) -> [f32; N] {
        let half = usize::from(!self.is_up(b));
        let Some(shapes) = self.shapes else { return [0.0; N] };
        let mut f = eval(&shapes[half], &self.corners, b);
        for k in 0..N {
            f[k] *= self.energy[half][k] - self.parallel[0][half][k] - self.parallel[1][half][k];
        }
        for kind in 0..2 {
            if let Some((cone, _)) = &self.cones[kind][half] {
                let of = cone.eval(b);
                (0..N).for_each(|k| f[k] += self.parallel[kind][half][k] * of);
            }
        }
        f
    }

    /// Density of samples in direction `b` [1/sr]; `chances` are the probabilities of sampling light that
    /// leaves up and down.
    #[inline]
    pub(crate) fn pdf(&self, chances: [f32; 2], b: [f32; 3]) -> f32 {
        let half = usize::from(!self.is_up(b));
        let (mut pdf, mut rest) = (0.0, 1.0);
        for kind in 0..2 {
            if let Some((cone, share)) = &self.cones[kind][half] {
                pdf += share * cone.pdf(b);
                rest -= share;
            }
        }
        chances[half] * (pdf + rest * b[2].abs().min(1.0) / PI)
    }

    /// Samples a direction of the light that leaves up (`half` 0) or down (1).
    pub(crate) fn draw(&self, half: usize, u: [f32; 3]) -> [f32; 3] {
        let up = if half == 0 { self.up_sign } else { -self.up_sign };
        let mut remaining = u[0];
        for kind in 0..2 {
            if let Some((cone, share)) = &self.cones[kind][half] {
                if remaining < *share {
                    return cone.draw([clamp_unit(u[1]), clamp_unit(u[2])], up);
                }
                remaining -= share;
            }
        }
        let (sin, cos) = (TAU * u[2]).sin_cos();
        let radius = u[1].sqrt();
        [radius * cos, radius * sin, up * (1.0 - u[1]).max(0.0).sqrt()]
    }
}
