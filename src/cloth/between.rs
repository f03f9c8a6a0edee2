//! Light between plies: what leaves a ply and hits another, until it leaves the cloth.
//!
//! The cloth's f is that of the ply which the line meets, as far as the light gets out without meeting
//! another (`shade.rs`), and the rest, the light that is scattered by two or more plies. The rest is
//! smooth. Its energies are found once a cloth by following light from ply to ply (`plywave_sim`). They are
//! regressed on polynomials of the direction `a` that the light comes from (by reciprocity: of the viewer),
//! apart for
//!
//! - the face and the back, from which the light comes,
//! - the class of what scatters first: its kind of yarn, whether it is the first ply on the line, whether
//!   another follows; or a hair,
//! - the half of the sphere, of the cloth's normal, into which the first ply sends the light: what yarns
//!   beside it catch, and what the layer below catches,
//! - the half in which the light leaves the cloth at last,
//! - absorptions of the kinds of yarns, each at nodes.
//!
//! The direction in which it leaves is given by reciprocity: averaged over a repeat, the light from a to b
//! over the cosine at b is symmetric. With the energy E(a) of light reflected so, the form
//! `E(a) E(b) cos b / integral E cos` is symmetric, has the energy E(a) and no other parameter; of light that
//! is transmitted, E(b) is the energy of light from b transmitted the other way. (Kulla and Conty 2017 give
//! microfacets their missing energy in this form.)

use super::cones::{Cone, ConeAt};
use super::plies::Runs;
use super::splines;
use super::terms::{Few, Poly, dot, few, terms};
use crate::math::clamp_unit;
use crate::math::simd::{max, min};
use multiversion::multiversion;
use std::f32::consts::{PI, TAU};

/// Nodes of absorption, those of the mean over the repeat: between them energies are linear in v = 1 / (1 +
/// sigma L), L this length [um], some paths through a ply. Nodes even in v end at 0.04 and 3 per um, and deep
/// colors, denim's warp in red, lie between these.
pub use super::far::{SIGMA_PER_UM, SIGMAS};
const LENGTH_UM: f32 = 150.0;
/// Share of light about cones whose samples are drawn so; the others are drawn by the cosine.
const ABOUT_CONES: f32 = 0.2;
/// Pairs of absorptions.
pub const PAIRS: usize = SIGMAS * SIGMAS;
/// Classes of what scatters light first: its kind of yarn; of a ply, whether it is the first on the line and
/// whether another follows; or a hair.
pub const CLASSES: usize = 2 * CLASSES_A_KIND;
/// Of one kind.
pub const CLASSES_A_KIND: usize = 6;
/// Of these, those of plies, which are the first ones.
pub const PLY_CLASSES: usize = 4;
/// Energies of a side, the face or the back.
#[derive(Clone, Debug)]
pub struct Side {
    /// `[class][sent up, sent down, all]`, by absorption of its kind: what other yarns catch of the first
    /// ply's light, up the half the light came from, and all that it scatters.
    pub caught: Vec<splines::Several<SIGMAS>>,
    /// `[class][sent up, down][leaves up, down][pair]`: what leaves the cloth, per energy that is caught.
    pub leaves: Vec<Few>,
    /// `[class][sent up, down][leaves up, down]`, by absorption of the class's kind: what of that
    /// only yarns of that kind have scattered.
    pub parallel: Vec<[Few; SIGMAS]>,
    /// `[kind][leaves up, down]`: cones of that light.
    pub cones: [[Cone; 2]; 2],
    /// `[leaves up, down][pair]`: the mean over classes, divided by the integral of its cosine-weighted
    /// values.
    pub shape: Vec<Poly>,
}

/// The light between the plies of a cloth.
#[derive(Clone, Debug)]
pub struct InterYarn {
    /// The face and the back.
    pub sides: [Side; 2],
    /// How yarns run, by kind.
    pub(crate) runs: [Runs; 2],
}

/// Class of the ply that a line hits as the `depth`-th, and whether it hits another behind it.
#[inline]
pub fn class(kind: usize, depth: usize, follows: bool) -> usize {
    CLASSES_A_KIND * kind + 2 * usize::from(depth > 0) + usize::from(follows)
}

/// Class of hairs of a kind, on the side that the light comes from or, of light that passes all plies, on
/// the other.
#[inline]
pub fn class_of_hairs(kind: usize, is_behind: bool) -> usize {
    CLASSES_A_KIND * kind + PLY_CLASSES + usize::from(is_behind)
}

/// v of the nodes; the last one stands for infinite absorption.
const V: [f32; SIGMAS] = {
    let mut v = [0.0; SIGMAS];
    let mut node = 0;
    while node < SIGMAS - 1 {
        v[node] = 1.0 / (1.0 + SIGMA_PER_UM[node] * LENGTH_UM);
        node += 1;
    }
    v
};

/// Node below an absorption and the fraction to the next.
#[inline(always)]
pub(crate) fn node_of(sigma: f32) -> (usize, f32) {
    let sigma = min(max(sigma, 0.0), 1e6);
    let v = 1.0 / (1.0 + sigma * LENGTH_UM);
    let mut node = 0;
    for at in &SIGMA_PER_UM[1..SIGMAS - 1] {
        node += usize::from(*at <= sigma);
    }
    (node, (V[node] - v) * PER_V[node])
}

/// 1 over the difference of v to the next node.
const PER_V: [f32; SIGMAS] = {
    let mut per = [0.0; SIGMAS];
    let mut node = 0;
    while node < SIGMAS - 1 {
        per[node] = 1.0 / (V[node] - V[node + 1]);
        node += 1;
    }
    per
};

impl InterYarn {
    /// Of its sides, of yarns whose warp runs along y.
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

    /// The light between yarns of a beam from `a`. `firsts` are the classes of the plies that scatter it and
    /// the energies that they scatter, `sent` factors on what the first ply sends up and what it sends down.
    #[inline]
    pub(crate) fn at<'a, const N: usize>(
        &'a self,
        a: [f32; 3],
        firsts: &[(usize, [f32; N])],
        sigma_per_um: [[f32; N]; 2],
        sent: [f32; 2],
    ) -> BetweenAt<'a, N> {
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

/// Four pairs of absorptions about one of each kind, with their shares.
type Corners = [(u16, f32); 4];

/// Mean of polynomials over pairs of absorptions.
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
) -> BetweenAt<'a, N> {
    let mut at = BetweenAt::none(a);
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
        let mut what = [[0.0; SIGMAS]; 3];
        for (what, of) in what.iter_mut().zip(functions) {
            place.add(of, what);
        }
        let mut caught = [[0.0; N]; 2];
        for k in 0..N {
            let (own, u) = nodes[kind][k];
            let mut of = [0.0; 3];
            for i in 0..3 {
                of[i] = (1.0 - u) * what[i][own % SIGMAS] + u * what[i][(own + 1) % SIGMAS];
            }
            // Shares change less with the absorption than energies do.
            let per = energy[k] / max(of[2], 1e-6);
            for cause in 0..2 {
                // Less than nothing where bent yarns send out more than straight ones.
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
    // Caught light can be less than nothing.
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

/// The light between yarns for one direction, N absorptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BetweenAt<'a, const N: usize> {
    up_sign: f32,
    /// `[leaves up, down]`.
    pub energy: [[f32; N]; 2],
    /// `[kind][leaves up, down]`: of that, what yarns of the kind alone have scattered.
    parallel: [[[f32; N]; 2]; 2],
    /// What other yarns catch of the first ply's light, and of the light of plies of each kind.
    pub caught: [f32; N],
    pub caught_of_plies: [[f32; N]; 2],
    /// `[kind][leaves up, down]`: cones, and shares of the samples.
    cones: [[Option<(ConeAt<'a>, f32)>; 2]; 2],
    /// `[leaves up, down][pair]`, of which each wavelength has a mean.
    shapes: Option<&'a [[Poly; PAIRS]; 2]>,
    corners: [Corners; N],
}

impl<'a, const N: usize> BetweenAt<'a, N> {
    /// No light, of a beam from `a`.
    #[inline(always)]
    pub(crate) fn none(a: [f32; 3]) -> Self {
        BetweenAt {
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

    /// Cones of the light that only yarns of one kind have scattered.
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

    /// Whether a direction lies in the half that the light comes from.
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

    /// Density of samples in direction `b` by the chances of the halves that it leaves in, up and
    /// down [1/sr].
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

    /// A direction of the light that leaves up, or down.
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
