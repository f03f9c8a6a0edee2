//! Light between yarns: what leaves a ply and meets another yarn, until it leaves the cloth.
//!
//! The cloth's f is that of the ply which the line meets, as far as the light gets out without meeting
//! another yarn (`shadow.rs`), and the rest, the light that is scattered by two or more yarns. The rest is
//! smooth. Its energies are found once a fabric by following light from ply to ply: a ply scatters as its
//! model says; light leaves it as the model's exits lie; a beam that passes a ply's rim goes on. Energies are
//! regressed on polynomials of the direction `a` that the light comes from (by reciprocity: of the viewer),
//! apart for
//!
//! - the face and the back, from which the light comes,
//! - the family and whether two layers lie there, of the first ply,
//! - the half of the sphere, of the cloth's normal, into which the first ply sends the light: what yarns
//!   beside it catch, and what the layer below catches,
//! - the half in which the light leaves the cloth at last,
//! - absorptions of warp and weft, each at nodes.
//!
//! The direction in which it leaves is given by reciprocity: averaged over a repeat, the light from a to b
//! over the cosine at b is symmetric. With the energy E(a) of light reflected so, the form
//! `E(a) E(b) cos b / integral E cos` is symmetric, has the energy E(a) and no other parameter; of light that
//! is transmitted, E(b) is the energy of light from b transmitted the other way. (Kulla and Conty 2017 give
//! microfacets their missing energy in this form.)

use super::flight::{Candidate, exit};
use super::hit::PlyHit;
use super::regression::Sums;
use super::shade::{Occlusion, Shade};
use super::shadow::Shadows;
use super::splines;
use super::{Fabric, YarnSet};
use crate::color::AlbedoCurve;
use crate::gap::Slit;
use crate::math::hash::SplitMix64;
use crate::math::parallel;
use crate::math::simd::{max, min};
use crate::ply::{ByFirst, ExitsAt, LobeLight, UncachedPly};
use crate::{PlyModel, PlyQuery};
use multiversion::multiversion;
use std::f32::consts::PI;

/// Nodes of absorption, those of the mean over the repeat: between them energies are linear in v = 1 / (1 +
/// sigma L), L this length [um], some paths through a ply. Nodes even in v end at 0.04 and 3 per um, and deep
/// colors, denim's warp in red, lie between these.
pub(crate) use super::far::{SIGMA_PER_UM, SIGMAS};
const LENGTH_UM: f32 = 150.0;
/// Polynomials of the direction.
pub(crate) const TERMS: usize = 16;
/// Polynomials of what depends little on it.
pub(crate) const FEW: usize = 8;
/// Pairs of absorptions.
pub(crate) const PAIRS: usize = SIGMAS * SIGMAS;
/// Classes of a first ply: its kind of yarn and up to four of each. A fabric has two of each family: whether
/// two layers lie there.
pub(crate) const CLASSES: usize = 2 * CLASSES_A_KIND;
pub(crate) const CLASSES_A_KIND: usize = 4;
/// Beams from each side whose first ply is looked at, and of which two of `FOLLOWED` are followed until they
/// leave the cloth: what is caught needs many terms of the direction and so many beams.
const BEAMS: usize = 1 << 18;
const FOLLOWED: usize = 4;
/// Most plies that scatter a path.
const MAX_ORDERS: usize = 64;
/// What f has over the density of its samples, at most.
const MAX_OVER: f32 = 2.0;
/// Directions of the first ply's light that are looked at.
const FIRSTS: usize = 4;
/// Steps of an even sequence of three numbers (Roberts 2018).
const EVEN: [f32; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
/// Most directions drawn for one that is kept.
const MAX_DRAWN: usize = 100;
/// A path of less energy is dropped.
const MIN_WEIGHT: f32 = 1e-4;

/// A polynomial of the direction for each pair of absorptions.
pub(crate) type Poly = [f32; TERMS];
pub(crate) type Few = [f32; FEW];

/// Energies of a side, the face or the back.
#[derive(Clone, Debug)]
pub(crate) struct Side {
    /// `[class][sent up, sent down, all]`, by absorption of its family: what other yarns catch of the first
    /// ply's light, up the half the light came from, and all that it scatters.
    pub(crate) caught: Vec<splines::Several<SIGMAS>>,
    /// `[class][sent up, down][leaves up, down][pair]`: what leaves the cloth, per energy that is caught.
    pub(crate) leaves: Vec<Few>,
    /// `[leaves up, down][pair]`: the mean over classes, divided by the integral of its cosine-weighted
    /// values.
    pub(crate) shape: Vec<Poly>,
}

/// The light between the yarns of a fabric.
#[derive(Clone, Debug)]
pub(crate) struct InterYarn {
    pub(crate) sides: [Side; 2],
    /// By node of absorption of both families alike, of clear fibers first: scattered light of all orders
    /// over the light that meets fibers, under light from everywhere.
    pub(crate) albedo: [f64; SIGMAS],
}

/// v of a node; the last one stands for infinite absorption.
fn v_of(node: usize) -> f32 {
    if node == SIGMAS - 1 { 0.0 } else { 1.0 / (1.0 + SIGMA_PER_UM[node] * LENGTH_UM) }
}

/// Node below an absorption and the fraction to the next.
#[inline]
fn node_of(sigma: f32) -> (usize, f32) {
    let sigma = sigma.clamp(0.0, 1e6);
    let v = 1.0 / (1.0 + sigma * LENGTH_UM);
    let node = SIGMA_PER_UM[1..SIGMAS - 1].iter().filter(|node| **node <= sigma).count();
    let [high, low] = [v_of(node), v_of(node + 1)];
    (node, (high - v) / (high - low))
}

/// The polynomials at a direction; z counts as positive.
#[inline]
fn terms(w: [f32; 3]) -> Poly {
    let [x, y, z] = w;
    let z = z.abs();
    let (d, e) = (x * x - y * y, 2.0 * x * y);
    [1.0, z, z * z, z * z * z, x, y, x * z, y * z, d, e, d * z, e * z, d * z * z, e * z * z, d * d - e * e, 2.0 * d * e]
}

/// The terms that energies per caught energy have: they depend little on the direction.
#[inline]
fn few(t: &Poly) -> Few {
    [t[0], t[1], t[2], t[3], t[4], t[5], t[8], t[9]]
}

/// Integrals over a half of the sphere of the terms times z.
fn integrals() -> Poly {
    let mut sums = [0.0; TERMS];
    sums[0] = PI;
    sums[1] = 2.0 * PI / 3.0;
    sums[2] = 0.5 * PI;
    sums[3] = 0.4 * PI;
    sums
}

#[inline]
fn dot<const T: usize>(a: &[f32; T], b: &[f32; T]) -> f32 {
    // Lanes apart: the compiler keeps the order of sums.
    let mut sums = [0.0; 4];
    for i in 0..T {
        sums[i % 4] += a[i] * b[i];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Models of a fabric's yarns.
pub(crate) trait Yarns {
    /// The model of a yarn.
    fn model(&self, family: YarnSet, yarn: i32) -> &PlyModel;

    /// The slits of a ply there, whose light of 0.55 um stands for all.
    fn slit(&self, hit: &PlyHit) -> Option<&Slit>;
}

/// A cloth through which paths are followed.
pub(crate) trait Paths: Sync {
    /// A point of the middle plane [um] by fractions, 0 to 1, even over a part of the cloth that stands for
    /// all.
    fn place(&self, fractions: [f64; 2]) -> [f32; 2];

    /// A path from direction `a` through a point of the middle plane, followed to its end or to its first
    /// ply; none where it is dropped or lost.
    fn path(&self, a: [f32; 3], at: [f32; 2], is_followed: bool, number: &mut dyn FnMut() -> f32) -> Option<Escaped>;
}

/// A fabric of yarns, its shadows and models.
struct FabricPaths<'a, Y>(&'a Fabric, &'a Shadows, &'a Y);

impl<Y: Yarns + Sync> Paths for FabricPaths<'_, Y> {
    fn place(&self, fractions: [f64; 2]) -> [f32; 2] {
        // Plies of twisted yarns are met at every turn.
        let spread = self.0.repeat_um().map(|r| r * (1 + (20_000.0 / r) as usize) as f64);
        [0, 1].map(|k| (fractions[k] * spread[k]) as f32)
    }

    fn path(&self, a: [f32; 3], at: [f32; 2], is_followed: bool, number: &mut dyn FnMut() -> f32) -> Option<Escaped> {
        path((self.0, self.1, self.2), (a, at), is_followed, number)
    }
}

/// What a ply sends out at a hit, at all nodes of absorption; directions are drawn for clear fibers. It lives
/// on the stack of a path.
#[allow(clippy::large_enum_variant)]
enum Emitted<'a> {
    Lobes(ByFirst<'a, SIGMAS>),
    /// Of a ply with slits, which take their part of the lobes at every call.
    Slits {
        clear: UncachedPly<'a, 1>,
        dyed: UncachedPly<'a, SIGMAS>,
    },
}

impl<'a> Emitted<'a> {
    fn new(model: &'a PlyModel, (theta_i, h_um): (f32, f32), slit: Option<&'a Slit>) -> Emitted<'a> {
        if slit.is_none() {
            return Emitted::Lobes(model.by_first(theta_i, h_um, SIGMA_PER_UM));
        }
        let clear = PlyQuery { cached: false, slit, ..PlyQuery::lobes(theta_i, h_um, [0.0]) };
        let dyed = PlyQuery { cached: false, slit, ..PlyQuery::lobes(theta_i, h_um, SIGMA_PER_UM) };
        Emitted::Slits { clear: model.uncached_at(&clear), dyed: model.uncached_at(&dyed) }
    }

    /// Energy that clear fibers scatter.
    fn energy(&self) -> f32 {
        match self {
            Emitted::Lobes(ply) => ply.albedo()[0],
            Emitted::Slits { clear, .. } => clear.albedo_r_d().0[0],
        }
    }

    fn sample(&self, u: [f32; 3]) -> Option<([f32; 3], LobeLight<SIGMAS>)> {
        match self {
            Emitted::Lobes(ply) => ply.sample(u),
            Emitted::Slits { clear, dyed } => {
                let (w, drawn) = clear.sample_lobes(clear.hit_chance(), u)?;
                Some((w, LobeLight { pdf: drawn.pdf, ..dyed.eval_pdf_lobes(1.0, w) }))
            }
        }
    }
}

/// Light that has left the cloth.
pub(crate) struct Escaped {
    /// Plies that scattered it.
    pub orders: usize,
    /// Class of the first ply; whether it sent the light up.
    pub class: usize,
    pub sent_up: bool,
    pub up: bool,
    /// Energies by node of absorption, of what the warp and what the weft leave of it.
    pub weight: [[f32; SIGMAS]; 2],
    /// What the first ply left of it.
    pub first: [f32; SIGMAS],
    /// Means over directions that the first ply may send light in: `[sent up, down]`, what other yarns catch
    /// by the table of shadows, and all that it scatters.
    pub caught: [[f32; SIGMAS]; 2],
    pub scattered: [f32; SIGMAS],
}

/// The class of a first ply.
pub(crate) fn class(hit: &PlyHit) -> usize {
    CLASSES_A_KIND * (hit.family as usize) + usize::from(hit.is_double)
}

/// A ply that scatters a path.
pub(crate) struct Scattered<'a> {
    pub model: &'a PlyModel,
    pub theta_i: f32,
    pub h_um: f32,
    pub radius_um: f32,
    pub frame: [[f32; 3]; 3],
    pub slit: Option<&'a Slit>,
    /// 0 for the warp or the only kind of yarn, 1 for the weft.
    pub kind: usize,
}

impl Escaped {
    /// A path that has met nothing yet.
    pub(crate) fn new() -> Escaped {
        Escaped {
            orders: 0,
            class: 0,
            sent_up: false,
            up: false,
            weight: [[1.0; SIGMAS]; 2],
            first: [1.0; SIGMAS],
            caught: [[0.0; SIGMAS]; 2],
            scattered: [0.0; SIGMAS],
        }
    }

    /// Whether nothing that counts is left of it, or it has gone on for long enough.
    pub(crate) fn is_over(&self) -> bool {
        let most = self.weight.iter().map(|w| w.iter().fold(0.0f32, |m, v| m.max(*v))).product::<f32>();
        self.orders >= MAX_ORDERS || most < MIN_WEIGHT
    }

    /// A ply scatters the path, which comes from direction `a`, into direction `d`. Returns the offset over R
    /// at which the new line passes the ply's axis, `-t` along `d cross z`, and how far along the axis;
    /// `None` where no direction is found. `first` is the class and the shadows of a first ply, of which the
    /// light is looked at; a path that is not followed ends there.
    pub(crate) fn scatter(
        &mut self,
        scattered: &Scattered<'_>,
        first: Option<(usize, Shade<'_>)>,
        (a, is_followed): ([f32; 3], bool),
        d: &mut [f32; 3],
        number: &mut dyn FnMut() -> f32,
    ) -> Option<(f32, f32)> {
        let Scattered { model, theta_i, h_um, radius_um, frame, slit, kind } = *scattered;
        // Drawn for clear fibers, the first node's: their light is then neither lost nor made, and that of
        // others is less.
        let ply = Emitted::new(model, (theta_i, h_um), slit);
        let energy = ply.energy().max(1e-12);
        let per_mean = 1.0 / (MAX_OVER * energy);
        let looks = 1.0 / (FIRSTS as f32 * energy);
        let exits = model.exits_at(theta_i, h_um, radius_um);
        let clear_shares = SIGMA_PER_UM.map(ExitsAt::clear_share);
        let to_cloth = |w: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| frame[0][i] * w[0] + frame[1][i] * w[1] + frame[2][i] * w[2])
        };
        if let Some((class, shade)) = first {
            self.class = class;
            // An even sequence, turned at random; what the density lacks is made good by weights.
            let turn = [number(), number(), number()];
            for i in 0..FIRSTS {
                let u = std::array::from_fn(|n| (turn[n] + i as f32 * EVEN[n]).fract());
                let Some((w, light)) = ply.sample(u) else { continue };
                let d = to_cloth(w);
                let free = shade.free(d, exits.lines(model.exit_shapes(), w));
                let (most, per) = (light.refl[0] + light.high[0], looks / light.pdf);
                for k in 0..SIGMAS {
                    let share = clear_shares[k];
                    let all = (light.refl[k] + light.high[k]).min(most);
                    let out = light.refl[k] * free[0] + light.high[k] * (free[2] + share * (free[1] - free[2]));
                    self.scattered[k] += per * all;
                    self.caught[usize::from(d[2] * a[2] < 0.0)][k] += per * (all - out);
                }
            }
        }
        if !is_followed {
            self.orders = 1;
            return Some((0.0, 0.0));
        }
        // Directions are drawn with a density near to f, and kept by what f has over it: weights would be
        // noise.
        let (w, light) = (0..MAX_DRAWN).find_map(|_| {
            let (w, light) = ply.sample([number(), number(), number()])?;
            (number() * light.pdf <= (light.refl[0] + light.high[0]) * per_mean).then_some((w, light))
        })?;
        let (lines, [refl, high]) = (exits.lines(model.exit_shapes(), w), [light.refl[0], light.high[0]]);
        *d = to_cloth(w);
        if self.orders == 0 {
            self.sent_up = d[2] * a[2] > 0.0;
            self.first = std::array::from_fn(|k| ((light.refl[k] + light.high[k]) / (refl + high)).min(1.0));
        }
        self.orders += 1;
        let density = |kind: usize| lines[kind].density;
        if number() * (refl + high) < refl {
            return Some((density(0).draw(number()), lines[0].s));
        }
        // Drawn for clear fibers.
        let [clear, dark] = [1, 2].map(density);
        let t = clear.draw(number());
        let dark = dark.at(t) / clear.at(t);
        for (k, weight) in self.weight[kind].iter_mut().enumerate() {
            *weight *= (light.high[k] / high).min(1.0) * (clear_shares[k] + (1.0 - clear_shares[k]) * dark);
        }
        Some((t, lines[1].s))
    }
}

/// A path from direction `a` through a point of the middle plane, followed to its end or to its first ply;
/// none where it is dropped or lost.
fn path(
    (fabric, shadows, yarns): (&Fabric, &Shadows, &impl Yarns),
    (a, at): ([f32; 3], [f32; 2]),
    is_followed: bool,
    number: &mut dyn FnMut() -> f32,
) -> Option<Escaped> {
    let mut flight = fabric.flight_through(at, a);
    let mut d = a.map(|v| -v);
    let mut gone = Escaped::new();
    while !gone.is_over() {
        // The first ply that catches the beam.
        let near: Candidate = loop {
            let Some(near) = flight.next_near() else {
                gone.up = d[2] * a[2] > 0.0;
                return Some(gone);
            };
            let model = yarns.model(near.hit.family, near.hit.yarn);
            if number() >= model.r_d(near.hit.theta_i, near.hit.h_um) {
                break near;
            }
        };
        let hit = &near.hit;
        let model = yarns.model(hit.family, hit.yarn);
        let radius = fabric.yarns[hit.family as usize].radius;
        let (slit, kind, z) = (yarns.slit(hit), hit.family as usize, hit.frame[2]);
        let ply =
            Scattered { model, theta_i: hit.theta_i, h_um: hit.h_um, radius_um: radius, frame: hit.frame, slit, kind };
        let first = (gone.orders == 0)
            .then(|| (class(hit), Shade::Yarns(Occlusion::new((fabric, shadows, model), &near, a, [true; 2]))));
        let (t, s) = gone.scatter(&ply, first, (a, is_followed), &mut d, number)?;
        if !is_followed {
            return Some(gone);
        }
        let x = [d[1] * z[2] - d[2] * z[1], d[2] * z[0] - d[0] * z[2], d[0] * z[1] - d[1] * z[0]];
        let scale = -t * radius / (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt().max(1e-6);
        let inner = std::array::from_fn(|i| near.center[i] + scale * x[i] + s * radius * z[i]);
        let from = exit(near.center, z, radius, inner, d);
        flight = fabric.flight(from, d, fabric.skip_own(&near, from, d));
    }
    None
}

/// What is found of a first ply: energies caught of what it sends up and down, and all that it scatters, by
/// absorption.
const LOOKS: usize = 3 * SIGMAS;

/// Parts of the paths, whose sums are joined in order.
const CHUNKS: usize = 16;

/// Sums of paths, by side.
struct Found {
    caught: [Vec<splines::Sums<LOOKS>>; 2],
    leaves: [Vec<Sums<FEW>>; 2],
    mean: [Sums<TERMS>; 2],
    albedo: [f64; SIGMAS],
}

impl Found {
    fn none() -> Found {
        Found {
            caught: [0, 1].map(|_| (0..CLASSES).map(|_| splines::Sums::new()).collect()),
            leaves: [0, 1].map(|_| (0..2 * CLASSES).map(|_| Sums::new(2 * PAIRS)).collect()),
            mean: [0, 1].map(|_| Sums::new(2 * PAIRS)),
            albedo: [0.0; SIGMAS],
        }
    }

    fn new(paths: &impl Paths, chunk: usize) -> Found {
        let mut found = Found::none();
        for side in 0..2 {
            let mut rng = SplitMix64(0x70_6c79 + (2 * chunk + side) as u64);
            let sign = if side == 0 { 1.0 } else { -1.0 };
            for k in chunk * (BEAMS / CHUNKS)..(chunk + 1) * (BEAMS / CHUNKS) {
                // Even sequences (Roberts 2018) of direction and place; half of the directions even, half by
                // their cosine.
                let even = |step: f64| (0.5 + k as f64 * step).fract();
                let (u, turn) = (even(0.856_674_883_854_502_9) as f32, even(0.733_891_856_627_126_9));
                let place = [even(0.628_706_721_042_211_5), even(0.538_597_257_223_612_7)];
                let is_followed = k % FOLLOWED < 2;
                let cosine_weighted = k % 2 == 0;
                let z = if cosine_weighted { u.sqrt() } else { u }.max(2e-3);
                let (s, c) = (std::f64::consts::TAU * turn).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                let a = [r * c as f32, r * s as f32, sign * z];
                let at = paths.place(place);
                let mut number = || rng.next_f64() as f32;
                let t = terms(a);
                if is_followed {
                    found.mean[side].seen(&t);
                }
                if let Some(gone) = paths.path(a, at, is_followed, &mut number) {
                    found.add(side, a, &t, &gone, is_followed && cosine_weighted && side == 0);
                }
            }
        }
        found
    }

    fn add(&mut self, side: usize, a: [f32; 3], t: &Poly, gone: &Escaped, counts: bool) {
        if gone.orders == 0 {
            return;
        }
        if counts {
            for i in 0..SIGMAS {
                self.albedo[i] += f64::from(gone.weight[0][i] * gone.weight[1][i]);
            }
        }
        let cause = usize::from(!gone.sent_up);
        let [up, down] = gone.caught;
        let mut looks = [0.0; LOOKS];
        for (looks, energy) in looks.as_chunks_mut::<SIGMAS>().0.iter_mut().zip([up, down, gone.scattered]) {
            *looks = energy;
        }
        self.caught[side][gone.class].add(&looks, &splines::At::new(a));
        if gone.orders < 2 {
            return;
        }
        let few = few(t);
        let of_cause = &mut self.leaves[side][2 * gone.class + cause];
        of_cause.seen(&few);
        let first = PAIRS * usize::from(!gone.up);
        let own = gone.class / CLASSES_A_KIND;
        for i in 0..SIGMAS {
            for j in 0..SIGMAS {
                let energy = gone.weight[0][i] * gone.weight[1][j];
                let pair = first + SIGMAS * i + j;
                of_cause.add(pair, energy / gone.first[[i, j][own]].max(1e-30), &few);
                self.mean[side].add(pair, energy, t);
            }
        }
    }

    fn join(&mut self, other: &Found) {
        for side in 0..2 {
            self.caught[side].iter_mut().zip(&other.caught[side]).for_each(|(sums, other)| sums.join(other));
            self.leaves[side].iter_mut().zip(&other.leaves[side]).for_each(|(sums, other)| sums.join(other));
            self.mean[side].join(&other.mean[side]);
        }
        self.albedo.iter_mut().zip(other.albedo).for_each(|(sum, other)| *sum += other);
    }
}

impl InterYarn {
    /// Of a fabric whose yarns have these models.
    pub(crate) fn new(fabric: &Fabric, shadows: &Shadows, yarns: &(impl Yarns + Sync)) -> InterYarn {
        InterYarn::of(&FabricPaths(fabric, shadows, yarns))
    }

    /// Of paths through a cloth.
    pub(crate) fn of(paths: &impl Paths) -> InterYarn {
        let found = parallel::map(CHUNKS, |chunk| Found::new(paths, chunk));
        let mut all = Found::none();
        found.iter().for_each(|found| all.join(found));
        let Found { caught, leaves, mean, albedo } = all;
        let means = mean.map(|sums| sums.solve());
        let integrals = integrals();
        let side = |side: usize| {
            let shape = |half: usize, pair: usize| -> Poly {
                // What leaves on the other side is what comes from there.
                let from = if half == 0 { side } else { 1 - side };
                let poly = means[from][half * PAIRS + pair];
                let all = dot(&poly, &integrals);
                if all > 1e-6 {
                    poly.map(|v| v / all)
                } else {
                    std::array::from_fn(|i| if i == 0 { 1.0 / PI } else { 0.0 })
                }
            };
            Side {
                caught: caught[side].iter().flat_map(|sums| splines::several(&sums.solve())).collect(),
                leaves: leaves[side].iter().flat_map(Sums::solve).collect(),
                shape: (0..2 * PAIRS).map(|at| shape(at / PAIRS, at % PAIRS)).collect(),
            }
        };
        // Clear fibers send out all that meets them.
        let clear = albedo[0].max(f64::MIN_POSITIVE);
        InterYarn { sides: [side(0), side(1)], albedo: albedo.map(|a| a / clear) }
    }

    /// The color of the cloth over the absorption, under a sky all round: what it scatters of the light that
    /// meets its fibers.
    pub(crate) fn curve(&self) -> AlbedoCurve {
        let v = |node: usize| f64::from(v_of(node));
        AlbedoCurve::of_nodes(f64::from(LENGTH_UM), self.albedo.iter().enumerate().map(|(node, a)| (v(node), *a)))
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.sides
            .iter()
            .map(|s| {
                size_of_val(s.caught.as_slice()) + size_of_val(s.leaves.as_slice()) + size_of_val(s.shape.as_slice())
            })
            .sum()
    }

    /// The light between yarns of a beam from `a`. `firsts` are the classes of the plies that scatter it and
    /// the energies that they scatter, `sent` factors on what the first ply sends up and what it sends down.
    #[inline]
    pub(crate) fn at<const N: usize>(
        &self,
        a: [f32; 3],
        firsts: &[(usize, [f32; N])],
        sigma_per_um: [[f32; N]; 2],
        sent: [f32; 2],
    ) -> BetweenAt<N> {
        let mut at = BetweenAt::none(a);
        let mut classes = [[0.0; N]; CLASSES];
        for (class, energy) in firsts {
            (0..N).for_each(|k| classes[*class][k] += energy[k]);
        }
        light(&self.sides[usize::from(a[2] < 0.0)], a, &classes, sigma_per_um, sent, &mut at);
        at
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn light<const N: usize>(
    side: &Side,
    a: [f32; 3],
    classes: &[[f32; N]; CLASSES],
    sigma_per_um: [[f32; N]; 2],
    sent: [f32; 2],
    at: &mut BetweenAt<N>,
) {
    let t = terms(a);
    let (few, place) = (few(&t), splines::At::new(a));
    let (mut nodes, mut corners) = ([[(0, 0.0); N]; 2], [[(0, 0.0); 4]; N]);
    for k in 0..N {
        let [(i, x), (j, y)] = [node_of(sigma_per_um[0][k]), node_of(sigma_per_um[1][k])];
        (nodes[0][k], nodes[1][k]) = ((i, x), (j, y));
        corners[k] = [
            (SIGMAS * i + j, (1.0 - x) * (1.0 - y)),
            (SIGMAS * i + j + 1, (1.0 - x) * y),
            (SIGMAS * (i + 1) + j, x * (1.0 - y)),
            (SIGMAS * (i + 1) + j + 1, x * y),
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
        let what = [0, 1, 2].map(|what| place.of(&side.caught[3 * class + what]));
        for k in 0..N {
            if energy[k] <= 0.0 {
                continue;
            }
            let (own, u) = nodes[class / CLASSES_A_KIND][k];
            let of = |what: &[f32; SIGMAS]| (1.0 - u) * what[own] + u * what[own + 1];
            // Shares change less with the absorption than energies do.
            let per = energy[k] / max(of(&what[2]), 1e-6);
            for (cause, factor) in sent.into_iter().enumerate() {
                if factor == 0.0 {
                    continue;
                }
                // Less than nothing where bent yarns send out more than straight ones.
                let caught = factor * min(max(per * of(&what[cause]), -energy[k]), energy[k]);
                at.caught[k] += caught;
                for half in 0..2 {
                    let leaves = &side.leaves[PAIRS * (2 * (2 * class + cause) + half)..][..PAIRS];
                    let mut mixed = [0.0f32; FEW];
                    for (pair, share) in corners[k] {
                        for n in 0..FEW {
                            mixed[n] += share * leaves[pair][n];
                        }
                    }
                    at.energy[half][k] += caught * min(max(dot(&mixed, &few), 0.0), 1.0);
                }
            }
        }
    }
    for half in 0..2 {
        let shapes = &side.shape[half * PAIRS..][..PAIRS];
        for k in 0..N {
            at.energy[half][k] = max(at.energy[half][k], 0.0);
            let mixed = &mut at.shape[half][k];
            for (pair, weight) in corners[k] {
                for n in 0..TERMS {
                    mixed[n] += weight * shapes[pair][n];
                }
            }
        }
    }
}

/// The light between yarns for one direction, N absorptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BetweenAt<const N: usize> {
    up_sign: f32,
    /// `[leaves up, down]`.
    pub energy: [[f32; N]; 2],
    /// What other yarns catch of the first ply's light.
    pub caught: [f32; N],
    shape: [[Poly; N]; 2],
}

impl<const N: usize> BetweenAt<N> {
    /// No light, of a beam from `a`.
    pub(crate) fn none(a: [f32; 3]) -> BetweenAt<N> {
        BetweenAt {
            up_sign: if a[2] < 0.0 { -1.0 } else { 1.0 },
            energy: [[0.0; N]; 2],
            caught: [0.0; N],
            shape: [[[0.0; TERMS]; N]; 2],
        }
    }

    /// Sign of z of the half that the light comes from.
    pub(crate) fn up_sign(&self) -> f32 {
        self.up_sign
    }

    /// Whether a direction lies in that half.
    #[inline]
    pub(crate) fn is_up(&self, b: [f32; 3]) -> bool {
        b[2] * self.up_sign >= 0.0
    }

    /// f in direction `b` [1/sr].
    #[inline]
    pub(crate) fn eval(&self, b: [f32; 3]) -> [f32; N] {
        let half = usize::from(!self.is_up(b));
        let t = terms(b);
        let cos = b[2].abs();
        std::array::from_fn(|k| self.energy[half][k] * (dot(&self.shape[half][k], &t) * cos).max(0.0))
    }
}
