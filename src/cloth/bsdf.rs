//! The BSDF of a cloth at a query (Yu 2025, 7.1): evaluation, sampling, density and albedo.
//!
//! The line from the viewer comes near one ply or several, in order; each intercepts a share of the beam that
//! the plies before it let pass. Direct light is the part of a ply's light that escapes without hitting
//! another yarn. Single reflection leaves from the point at which the line enters the ply, all other light
//! from a distribution across it. The light that passes all plies is diffracted, at the edge of the ply that
//! the line hits or by the aperture of the gap. Light that other yarns intercept returns as inter-yarn
//! scattering (`light/inter_yarn.rs`). All directions are in the frame of the pattern, which may be rotated
//! about the surface's normal; `b` is the direction of the light.

use crate::bsdf::{DirectionSample, Outcomes};
use crate::cloth::light::absorption::SIGMAS;
use crate::cloth::light::far::{self, FarAt};
use crate::cloth::light::far_grid::Seen;
use crate::cloth::light::hair_layer::HairsAt;
use crate::cloth::light::inter_yarn::{CLASSES_A_KIND, InterYarnAt, PLY_CLASSES};
use crate::cloth::light::lit_places::Ratios;
use crate::cloth::shade::shadow_table::Toward;
use crate::cloth::shade::shadows::ClothShade;
use crate::frame::is_direction;
use crate::frame::{to_pattern, to_surface};
use crate::gap::{GapAt, Opening};
use crate::math::clamp_unit;
use crate::math::vec3::dot;
use crate::ply::speckle::Speckle;
use crate::ply::{ExitsAt, LobeLight, Prepared, UncachedPly, hit_chance};
use crate::{Bsdf, BsdfSample};
use multiversion::multiversion;

/// Transforms a direction from the cloth's frame to a ply's.
#[inline(always)]
fn to_ply(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    [dot(frame[0], w), dot(frame[1], w), dot(frame[2], w)]
}

/// Transforms a direction from a ply's frame to the cloth's.
#[inline(always)]
fn to_cloth(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = frame;
    let along = |k: usize| x[k] * w[0] + y[k] * w[1] + z[k] * w[2];
    [along(0), along(1), along(2)]
}

/// Largest number of plies behind the first hit whose lobes a query evaluates.
pub(crate) const MAX_NEAR: usize = 4;

/// What is computed once for a ply: its interpolated lobes and its speckle patterns.
type Kept<'b, const N: usize> = (&'b Prepared<N>, Option<&'b Speckle<N>>);

/// A ply near the line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearPly<'a, const N: usize> {
    pub ply: UncachedPly<'a, N>,
    pub frame: [[f32; 3]; 3],
    pub shade: ClothShade<'a>,
    pub exits: ExitsAt,
    /// Class of the ply among those that scatter first: see [`crate::cloth::light::inter_yarn::class`].
    pub class: usize,
    /// Share of the beam that reaches the ply.
    pub arrives: f32,
    /// Share of the arriving light that the ply intercepts; set only for plies behind the first hit.
    pub caught: f32,
    /// Energy that the ply scatters per unit of arriving light, and probability that sampling its lobes
    /// returns a direction.
    pub energy: [f32; N],
    pub hit_chance: f32,
    /// Probability of sampling this ply.
    pub chance: f32,
}

impl<const N: usize> NearPly<'_, N> {
    /// Computes the energies; returns r_d, the share of the light that passes the ply unscattered.
    pub(crate) fn energies(&mut self, prepared: &Prepared<N>) -> f32 {
        let (energy, r_d) = self.ply.lit_by(&self.ply.kept(prepared), None).albedo_r_d();
        self.energy = energy;
        self.hit_chance = hit_chance(&energy, r_d);
        r_d
    }

    /// Share, per wavelength, of the light through fibers that leaves with the distribution of clear fibers.
    #[inline(always)]
    fn clear_shares(&self) -> [f32; N] {
        let mut shares = [0.0; N];
        for k in 0..N {
            shares[k] = ExitsAt::clear_share(self.ply.query.sigma_per_um[k]);
        }
        shares
    }

    /// Adds the light of the lobes, weighted by the shares that escape: those of f_refl, and those of f_high
    /// for clear and for dark fibers.
    #[inline(always)]
    fn add_light(&self, free: [f32; 3], clear_shares: &[f32; N], light: &LobeLight<N>, f: &mut [f32; N]) {
        let [refl, clear, dark] = [free[0] * self.arrives, free[1] * self.arrives, free[2] * self.arrives];
        for k in 0..N {
            f[k] += refl * light.refl[k] + (dark + clear_shares[k] * (clear - dark)) * light.high[k];
        }
    }

    #[inline(always)]
    fn add(&self, toward: &Toward, b_ply: [f32; 3], light: &LobeLight<N>, f: &mut [f32; N], pdf: &mut f32) {
        self.add_light(
            self.shade.toward(toward, self.ply.model.exit_shapes(), self.exits.lines(b_ply)),
            &self.clear_shares(),
            light,
            f,
        );
        *pdf += self.chance * light.pdf;
    }

    /// Adds f and density in a direction, with the lobes and the speckle patterns that were prepared.
    #[inline(always)]
    fn eval_pdf(&self, (prepared, speckle): Kept<'_, N>, toward: &Toward, f: &mut [f32; N], pdf: &mut f32) {
        let b_ply = to_ply(&self.frame, toward.b);
        let light = self.ply.lit_by(&self.ply.kept(prepared), speckle).eval_pdf(self.hit_chance, b_ply);
        self.add(toward, b_ply, &light, f, pdf);
    }

    /// Adds f for many directions of the light.
    fn add_all(&self, prepared: &Prepared<N>, lights: &[Toward], f: &mut [[f32; N]]) {
        let interpolated = self.ply.kept(prepared);
        let shares = self.clear_shares();
        for (toward, f) in lights.iter().zip(f) {
            let b_ply = to_ply(&self.frame, toward.b);
            let light = self.ply.lit_by(&interpolated, None).eval_apart(b_ply);
            self.add_light(
                self.shade.toward(toward, self.ply.model.exit_shapes(), self.exits.lines(b_ply)),
                &shares,
                &light,
                f,
            );
        }
    }

    #[inline]
    fn pdf(&self, prepared: &Prepared<N>, b: [f32; 3]) -> f32 {
        self.chance * self.ply.lit_by(&self.ply.kept(prepared), None).pdf(self.hit_chance, to_ply(&self.frame, b))
    }

    #[inline]
    fn sample(&self, (prepared, speckle): Kept<'_, N>, u: [f32; 3]) -> Option<([f32; 3], LobeLight<N>)> {
        let (w, light) = self.ply.lit_by(&self.ply.kept(prepared), speckle).sample(self.hit_chance, u)?;
        Some((to_cloth(&self.frame, w), light))
    }
}

/// Propagation of the light that passes all plies.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Passes<'a, const N: usize> {
    /// It goes straight on.
    Straight,
    /// It is diffracted at the edge of the ply that the line hits.
    Edge,
    /// It is diffracted by the aperture of the gap.
    Aperture(GapAt<'a, N>),
}

/// A sampled direction, and the index and light of the ply whose lobes gave it.
type Drawn<const N: usize> = ([f32; 3], Option<(usize, LobeLight<N>)>);

/// Index of the component that a sample belongs to; smaller indices are plies.
const PASSES: usize = MAX_NEAR;
const UP: usize = MAX_NEAR + 1;
const DOWN: usize = MAX_NEAR + 2;

/// Lower bound on the share of a ply's light that escapes, as sampling weighs it. In some directions all
/// light escapes, so the weight of a sample can be as large as the inverse of this bound.
const MIN_FREE: f32 = 0.5;
/// Factor on the probability of inter-yarn scattering relative to its energy. Its cosine-distributed samples
/// cover the directions in which few ply samples escape: a larger factor reduces the variance of the weights
/// and raises the largest weight of clear cloths.
const FOR_SHADOWS: f32 = 1.35;

/// A cloth at a query, for N wavelengths. The lobes of the first ply that the line hits are interpolated
/// once.
#[derive(Clone, Copy, Debug)]
pub struct ClothBsdf<'a, const N: usize> {
    /// The first ply that the line hits, its interpolated lobes and its speckle patterns, and the plies
    /// behind it.
    pub(crate) main: Option<NearPly<'a, N>>,
    pub(crate) prepared: Prepared<N>,
    pub(crate) speckle: Option<Speckle<N>>,
    pub(crate) others: [Option<NearPly<'a, N>>; MAX_NEAR],
    /// The hair layers over the cloth.
    pub(crate) hairs: Option<HairsAt<'a, N>>,
    pub(crate) passes: Passes<'a, N>,
    /// Share of the beam that passes all plies.
    pub(crate) passing: f32,
    pub(crate) inter_yarn: InterYarnAt<'a, N>,
    /// Probabilities of sampling the light that passes all plies, and inter-yarn scattering upwards and
    /// downwards.
    pub(crate) chances: [f32; 3],
    /// Cosine and sine of the pattern's rotation.
    pub(crate) turn: [f32; 2],
    pub(crate) is_double: bool,
    /// Aperture of the gap, if the line hits no ply and its light is diffracted.
    pub(crate) opening: Option<Opening>,
    /// The mean over the cell and its weight; the other components have the remaining weight.
    pub(crate) far: Option<(FarAt<'a, N>, f32)>,
}

impl<'a, const N: usize> ClothBsdf<'a, N> {
    /// The state before the line hits a ply. The parts are filled in place because they are large.
    #[inline(always)]
    pub(crate) fn empty() -> Self {
        ClothBsdf {
            main: None,
            prepared: Prepared::nothing(),
            speckle: None,
            others: [const { None }; MAX_NEAR],
            hairs: None,
            passes: Passes::Straight,
            passing: 1.0,
            inter_yarn: InterYarnAt::none([0.0; 3]),
            chances: [0.0; 3],
            turn: [1.0, 0.0],
            is_double: false,
            opening: None,
            far: None,
        }
    }

    /// Stores the aperture of a gap, and returns the propagation of the light that passes all plies.
    pub(crate) fn passes_gap(&mut self, light: Option<(Opening, GapAt<'a, N>)>) -> Passes<'a, N> {
        let Some((opening, light)) = light else { return Passes::Straight };
        self.opening = Some(opening);
        Passes::Aperture(light)
    }

    /// Stores the mean over the cell with its weight; returns whether the mean is the whole answer.
    pub(crate) fn is_far(&mut self, far: Option<(FarAt<'a, N>, f32)>) -> bool {
        let all = far.as_ref().is_some_and(|(_, share)| *share >= 1.0);
        if far.is_some() {
            self.far = far;
        }
        if all {
            self.passing = 0.0;
        }
        all
    }
}

impl<const N: usize> ClothBsdf<'_, N> {
    /// Weight of the mean over the cell in the answer: 0 for a point, 1 for a footprint as large as the cell.
    pub fn far_share(&self) -> f32 {
        self.far.as_ref().map_or(0.0, |(_, share)| *share)
    }

    /// Whether the point lies in a gap: the line hits no ply. The result has no meaning if
    /// [`ClothBsdf::far_share`] is 1.
    pub fn is_gap(&self) -> bool {
        self.main.is_none()
    }

    /// Whether the line hits yarns of both kinds, one over the other.
    pub fn is_double(&self) -> bool {
        self.is_double
    }

    /// Sets the probabilities of sampling all components.
    ///
    /// For components whose light does not overlap, probabilities in proportion to the root of the mean
    /// square of f over the component's own density minimize the variance of the weights, here of their sum
    /// over channels. Other yarns let the share m of a ply's light escape. That root is m times the ply's
    /// energy if shadows reduce the light equally in every direction, and `m^(1/2)` times it if they remove
    /// all or nothing of it; `m^(3/4)` lies between the two. (tests/it/cloth.rs measures the weights.)
    pub(crate) fn set_chances(&mut self) {
        let mean = |x: &[f32; N]| x.iter().sum::<f32>() / N.max(1) as f32;
        let root_mean_square = |x: &[f32; N]| (x.iter().map(|x| x * x).sum::<f32>() / N.max(1) as f32).sqrt();
        let inter_yarn = self.inter_yarn.energy.map(|e| FOR_SHADOWS * root_mean_square(&e));
        let (mut plies, mut hairs_too) = ([0.0; N], [0.0; N]);
        let mut add = |arrives: f32, energy: &[f32; N]| (0..N).for_each(|k| plies[k] += arrives * energy[k]);
        if let Some(p) = &self.main {
            add(p.arrives, &p.energy);
        }
        self.others.iter().flatten().for_each(|p| add(p.arrives, &p.energy));
        (0..N).for_each(|k| hairs_too[k] += plies[k]);
        if let Some(hairs) = &self.hairs {
            hairs.energies().as_flattened().iter().for_each(|energy| (0..N).for_each(|k| hairs_too[k] += energy[k]));
        }
        let direct = root_mean_square(&std::array::from_fn(|k| {
            let m = (1.0 - self.inter_yarn.caught[k] / hairs_too[k].max(f32::MIN_POSITIVE)).max(MIN_FREE);
            // This is m^(3/4).
            plies[k] * (m * m.sqrt()).sqrt()
        }));
        let passing = if matches!(self.passes, Passes::Straight) { 0.0 } else { self.passing };
        // Light that goes straight on has the remaining probability.
        let hairs = self.hairs.as_ref().map_or([0.0; 2], |hairs| hairs.out().map(|out| root_mean_square(&out)));
        let all = direct + inter_yarn[0] + inter_yarn[1] + hairs[0] + hairs[1] + self.passing;
        let per = if all > 0.0 { 1.0 / all } else { 0.0 };
        let plies = mean(&plies);
        let per_ply = if plies > 0.0 { per * direct / plies } else { 0.0 };
        if let Some(p) = &mut self.main {
            p.chance = per_ply * p.arrives * mean(&p.energy);
        }
        for p in self.others.iter_mut().flatten() {
            p.chance = per_ply * p.arrives * mean(&p.energy);
        }
        if let Some(of) = &mut self.hairs {
            of.set_chances(hairs.map(|hairs| per * hairs));
        }
        self.chances = [per * passing, per * inter_yarn[0], per * inter_yarn[1]];
    }

    /// Adds the diffracted light that passes all plies, and the density of its samples.
    #[inline(always)]
    fn passing(&self, b: [f32; 3], f: &mut [f32; N], pdf: &mut f32) {
        if self.chances[0] <= 0.0 {
            return;
        }
        let light = match (&self.passes, &self.main) {
            (Passes::Aperture(gap), _) => Some(gap.conserved(b)),
            (Passes::Edge, Some(main)) => main.ply.edge_eval_pdf(to_ply(&main.frame, b)),
            _ => None,
        };
        if let Some((light, density)) = light {
            for k in 0..N {
                f[k] += self.passing * light[k];
            }
            *pdf += self.chances[0] * density;
        }
    }

    #[inline(always)]
    fn inter_yarn_pdf(&self, b: [f32; 3]) -> f32 {
        self.inter_yarn.pdf([self.chances[1], self.chances[2]], b)
    }

    /// f and density in a direction of the pattern; the light of one ply may be known from its sampling.
    #[inline]
    fn sum(&self, b: [f32; 3], known: Option<(usize, LobeLight<N>)>) -> ([f32; N], f32) {
        let Some((far, share)) = &self.far else { return self.near(b, known) };
        let (mut f, mut pdf) = if *share < 1.0 { self.near(b, known) } else { ([0.0; N], 0.0) };
        f.iter_mut().for_each(|f| *f *= 1.0 - share);
        pdf *= 1.0 - share;
        far::add(far, b, *share, &mut f, &mut pdf);
        (f, pdf)
    }

    /// f and density without the mean over the cell.
    #[inline]
    fn near(&self, b: [f32; 3], known: Option<(usize, LobeLight<N>)>) -> ([f32; N], f32) {
        near(self, b, known)
    }

    /// Adds f and density of the plies, as far as hairs let it pass, and of the hairs.
    #[inline(always)]
    fn plies_and_hairs(&self, b: [f32; 3], known: Option<(usize, LobeLight<N>)>, f: &mut [f32; N], pdf: &mut f32) {
        let toward = Toward::new(b);
        if let Some(ply) = &self.main {
            match &known {
                Some((0, light)) => ply.add(&toward, to_ply(&ply.frame, b), light, f, pdf),
                _ => ply.eval_pdf((&self.prepared, self.speckle.as_ref()), &toward, f, pdf),
            }
        }
        for (i, ply) in self.others.iter().enumerate() {
            let Some(ply) = ply else { continue };
            match &known {
                Some((known, light)) if *known == i + 1 => ply.add(&toward, to_ply(&ply.frame, b), light, f, pdf),
                _ => ply.eval_pdf((&Prepared::NOTHING, ply.ply.speckle().as_ref()), &toward, f, pdf),
            }
        }
        if let Some(hairs) = &self.hairs {
            let free = hairs.free(b);
            f.iter_mut().for_each(|f| *f *= free);
            hairs.add(b, f);
            *pdf += hairs.pdf(b);
        }
    }

    /// The parts of f in direction `b` of the pattern, without the mean over the cell: light of plies and
    /// hairs that leaves straight, and inter-yarn scattering. Diffracted light is in neither.
    #[doc(hidden)]
    pub fn parts(&self, b: [f32; 3]) -> [[f32; N]; 2] {
        let (mut f, mut pdf) = ([0.0; N], 0.0);
        self.plies_and_hairs(b, None, &mut f, &mut pdf);
        [f, self.inter_yarn.eval(b)]
    }

    /// Of inter-yarn scattering that leaves up and down: its mean energy over places, and the deviations from
    /// that mean at this place; and the share of the intercepted light that the plies of these deviations
    /// intercept.
    #[doc(hidden)]
    pub fn inter_yarn_at_place(&self) -> ([[f32; N]; 2], Ratios, f32) {
        self.inter_yarn.at_place()
    }

    /// Energy of inter-yarn scattering that leaves up and down with the shapes that
    /// [`Side::shape`](crate::cloth::light::Side::shape) holds.
    #[doc(hidden)]
    pub fn shaped_energy(&self) -> [[f32; N]; 2] {
        self.inter_yarn.shaped_energy()
    }

    /// Samples a direction of the pattern; returns it with the light of the ply that gave it.
    #[inline]
    fn draw(&self, u: [f32; 3]) -> Option<Drawn<N>> {
        let Some((far, share)) = &self.far else { return self.draw_near(u) };
        if u[0] < *share {
            return far.draw([clamp_unit(u[0] / share), u[1], u[2]]).map(|w| (w, None));
        }
        self.draw_near([clamp_unit((u[0] - share) / (1.0 - share)), u[1], u[2]])
    }

    #[inline]
    fn draw_near(&self, u: [f32; 3]) -> Option<Drawn<N>> {
        let mut remaining = u[0];
        let rescaled = |remaining: f32, chance: f32| [clamp_unit(remaining / chance), u[1], u[2]];
        if let Some(ply) = &self.main {
            if remaining < ply.chance {
                let drawn = ply.sample((&self.prepared, self.speckle.as_ref()), rescaled(remaining, ply.chance));
                return drawn.map(|(w, light)| (w, Some((0, light))));
            }
            remaining -= ply.chance;
        }
        for (i, ply) in self.others.iter().enumerate() {
            let Some(ply) = ply else { continue };
            if remaining < ply.chance {
                let speckle = ply.ply.speckle();
                let drawn = ply.sample((&Prepared::NOTHING, speckle.as_ref()), rescaled(remaining, ply.chance));
                return drawn.map(|(w, light)| (w, Some((i + 1, light))));
            }
            remaining -= ply.chance;
        }
        if let Some(hairs) = &self.hairs {
            if remaining < hairs.chance() {
                return Some((hairs.draw([remaining, u[1], u[2]]), None));
            }
            remaining -= hairs.chance();
        }
        for (i, chance) in self.chances.into_iter().enumerate() {
            if remaining >= chance {
                remaining -= chance;
                continue;
            }
            let u = rescaled(remaining, chance);
            let w = match (PASSES + i, &self.passes, &self.main) {
                (PASSES, Passes::Aperture(gap), _) => gap.conserved_sample(u)?,
                (PASSES, Passes::Edge, Some(main)) => to_cloth(&main.frame, main.ply.edge_sample(u)?),
                (UP | DOWN, ..) => self.inter_yarn.draw(i - 1, u),
                _ => return None,
            };
            return Some((w, None));
        }
        None
    }
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn near<const N: usize>(of: &ClothBsdf<'_, N>, b: [f32; 3], known: Option<(usize, LobeLight<N>)>) -> ([f32; N], f32) {
    let (inter_yarn, mut pdf) = of.inter_yarn.eval_pdf([of.chances[1], of.chances[2]], b);
    let mut f = [0.0; N];
    of.plies_and_hairs(b, known, &mut f, &mut pdf);
    for k in 0..N {
        f[k] += inter_yarn[k];
    }
    of.passing(b, &mut f, &mut pdf);
    (f, pdf)
}

impl ClothBsdf<'_, SIGMAS> {
    /// f and energies of the plies of one kind of yarn for light from the directions `lights`, at the nodes
    /// of absorption of the tables of the mean.
    pub fn seen(&self, kind: usize, lights: &[Toward]) -> Seen {
        let mut view =
            Seen { f: vec![[0.0; SIGMAS]; lights.len()], first: [[0.0; SIGMAS]; PLY_CLASSES], opening: self.opening };
        let mut scatters = |class: usize, arrives: f32, energy: &[f32; SIGMAS]| {
            (0..SIGMAS).for_each(|k| view.first[class % CLASSES_A_KIND][k] += arrives * energy[k]);
        };
        let is_of = |class: usize| class / CLASSES_A_KIND == kind;
        if let Some(ply) = self.main.as_ref().filter(|ply| is_of(ply.class)) {
            scatters(ply.class, ply.arrives, &ply.energy);
            ply.add_all(&self.prepared, lights, &mut view.f);
        }
        for ply in self.others.iter().flatten().filter(|ply| is_of(ply.class)) {
            scatters(ply.class, ply.arrives, &ply.energy);
            let mut prepared = Prepared::nothing();
            ply.ply.prepare_into(&mut prepared);
            ply.add_all(&prepared, lights, &mut view.f);
        }
        view
    }
}

impl<const N: usize> Bsdf<N> for ClothBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.eval_pdf(w).0
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        if !is_direction(w) {
            return 0.0;
        }
        let b = to_pattern(self.turn, w);
        if self.far.is_some() {
            return self.sum(b, None).1;
        }
        let mut pdf = self.inter_yarn_pdf(b) + self.hairs.as_ref().map_or(0.0, |hairs| hairs.pdf(b));
        self.passing(b, &mut [0.0; N], &mut pdf);
        pdf += self.main.as_ref().map_or(0.0, |ply| ply.pdf(&self.prepared, b));
        pdf + self.others.iter().flatten().map(|ply| ply.pdf(&Prepared::NOTHING, b)).sum::<f32>()
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        if !is_direction(w) {
            return ([0.0; N], 0.0);
        }
        self.sum(to_pattern(self.turn, w), None)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        let u = u.map(clamp_unit);
        if let Some((b, known)) = self.draw(u) {
            let (f, pdf) = self.sum(b, known);
            return match BsdfSample::scattered(b, f, pdf) {
                BsdfSample::Scattered(s) => {
                    BsdfSample::Scattered(DirectionSample { w: to_surface(self.turn, s.w), ..s })
                }
                other => other,
            };
        }
        BsdfSample::straight(self.straight(), self.outcomes().straight)
    }

    /// The light that is reflected or transmitted, with shadows averaged over directions: the energy that
    /// plies scatter, minus what other yarns intercept of it, plus inter-yarn scattering.
    fn albedo(&self) -> [f32; N] {
        let mut albedo = if matches!(self.passes, Passes::Straight) { [0.0; N] } else { [self.passing; N] };
        let lit = |energy: &[f32; N], arrives: f32, k: usize| arrives * energy[k];
        for k in 0..N {
            let plies =
                self.hairs.iter().flat_map(|hairs| hairs.energies()).flatten().map(|energy| energy[k]).sum::<f32>()
                    + self.main.iter().map(|p| lit(&p.energy, p.arrives, k)).sum::<f32>()
                    + self.others.iter().flatten().map(|p| lit(&p.energy, p.arrives, k)).sum::<f32>();
            albedo[k] += (plies - self.inter_yarn.caught[k]).max(0.0)
                + self.inter_yarn.energy[0][k]
                + self.inter_yarn.energy[1][k];
            if let Some((far, share)) = &self.far {
                albedo[k] += share * (far.albedo(k) - albedo[k]);
            }
        }
        albedo
    }

    fn straight(&self) -> [f32; N] {
        let straight = if matches!(self.passes, Passes::Straight) { self.passing } else { 0.0 };
        let far = self.far.as_ref().map_or(0.0, |(far, share)| share * (far.straight() - straight));
        [straight + far; N]
    }

    fn outcomes(&self) -> Outcomes {
        let scattered = self.chances.iter().sum::<f32>()
            + self.hairs.as_ref().map_or(0.0, HairsAt::chance)
            + self.main.iter().map(|p| p.chance).sum::<f32>()
            + self.others.iter().flatten().map(|p| p.chance).sum::<f32>();
        let far = self.far.as_ref().map_or(0.0, |(far, share)| share * (far.scattered() - scattered));
        let scattered = scattered + far;
        let rest = (1.0 - scattered).max(0.0);
        if Bsdf::<N>::straight(self).iter().any(|e| *e > 0.0) {
            Outcomes { scattered, straight: rest, absorbed: 0.0 }
        } else {
            Outcomes { scattered, straight: 0.0, absorbed: rest }
        }
    }
}
