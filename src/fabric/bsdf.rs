//! The fabric as a surface that scatters light (Yu 2025, 7.1): at a point, seen from a direction, one of three cases of the beam.
//!
//! - The line meets a ply near its center or near its rim (cases a and b): the whole ply, edge light included; over a second layer of yarns what it sends on is that of
//!   two layers.
//! - The line meets no ply (case c): the light that the near plies catch, and what is left goes through the aperture between them.
//!
//! The camera ray plays the beam: `w` is the direction to the viewer, and f(wo), an energy density per steradian of the light's direction `wo`, holds the cosine at the
//! surface: `radiance to w = integral f(wo) radiance from wo d wo`. By reciprocity the same numbers serve light that comes along `w`.
//!
//! Energy: with clear fibers f integrates to 1 over the sphere, up to the Kirchhoff integral of small apertures and, over a second layer, the energies between the
//! nodes of the model. Where the plies at the edges of a gap together catch more than the beam, as rims behind each other do, their light is scaled to all of it.

use super::{Fabric, Family, LoadedFabric, Place, PlyHit, YarnColor};
use crate::color::{AlbedoCurve, SigmaSpectrum, SmoothReflectance};
use crate::gap::{GapIncidence, Spectrum};
use crate::layers::TwoLayered;
use crate::ply::Drawn;
use crate::whole::FreshPly;
use crate::{GaussianBeam, Instance, PlyModel, PreparedPly, Result, Scatter, ScatterSample, WholePly, YarnSpec};
use std::path::Path;
use std::sync::Arc;

/// Edges of apertures, in equal steps from the beam's center to d_cut, for which spectra are kept.
const EDGES: usize = 32;

/// What light through the gaps does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapLight {
    /// It is diffracted by the aperture.
    #[default]
    Diffracted,
    /// It goes straight on, as rays do: for comparison. [`Scatter::sample`] gives `None` for it.
    Straight,
}

/// How a fabric is shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FabricOptions {
    /// Light through the gaps.
    pub gaps: GapLight,
    /// One absorption [1/um] at every wavelength for all yarns, in place of their colors; 0 for a white furnace.
    pub sigma_per_um: Option<f32>,
    /// Speckle: every stretch of a ply as long as the beam's waist is wide has patterns of its own. Models without tiles stay smooth.
    pub noise: bool,
}

/// Absorption of a yarn over the wavelength.
#[derive(Clone, Debug)]
enum Dye {
    Even(f32),
    Spectrum(Box<SigmaSpectrum>),
}

impl Dye {
    fn at<const N: usize>(&self, lambda_um: [f32; N]) -> [f32; N] {
        match self {
            Dye::Even(sigma) => [*sigma; N],
            Dye::Spectrum(s) => lambda_um.map(|l| s.at(l)),
        }
    }
}

/// A woven fabric, ready for shading.
///
/// Lengths in um in the plane of the fabric (x along the weft, y along the warp, z the face's normal), directions unit in that frame. No call to
/// evaluate fails, allocates or panics.
#[derive(Clone, Debug)]
pub struct FabricBsdf {
    fabric: Fabric,
    models: [Arc<PlyModel>; 2],
    /// Different dyes, and that of each thread of a repeat by family.
    dyes: Vec<Dye>,
    threads: [Vec<u32>; 2],
    /// `[EDGES + 1][EDGES + 1]` of the distances of the two edges along one axis, of the beam of the warp's model.
    spectra: Vec<Spectrum>,
    edge_step_um: f32,
    gaps: GapLight,
    noise: bool,
    /// Length of a ply with the same patterns, 2 w0 [um].
    grain_um: f32,
}

impl FabricBsdf {
    /// Reads a fabric spec and the models it names.
    ///
    /// # Errors
    /// As [`super::FabricSpec::load`].
    pub fn load(path: impl AsRef<Path>, options: &FabricOptions) -> Result<FabricBsdf> {
        FabricBsdf::new(super::FabricSpec::load(path)?, options)
    }

    /// Of a loaded fabric.
    ///
    /// # Errors
    /// As [`YarnSpec::parse`], for the spec in the warp's model.
    pub fn new(loaded: LoadedFabric, options: &FabricOptions) -> Result<FabricBsdf> {
        let models = Family::EACH.map(|family| loaded.model_of(family, 0).clone());
        let fabric = loaded.fabric;
        let curves = [0, 1].map(|k| AlbedoCurve::diffuse(&models[k]));
        let (mut dyes, mut known): (Vec<Dye>, Vec<(usize, YarnColor)>) = (Vec::new(), Vec::new());
        let mut threads = [Vec::new(), Vec::new()];
        for (k, family) in Family::EACH.into_iter().enumerate() {
            for thread in 0..fabric.draft().threads(family) {
                let color = match options.sigma_per_um {
                    Some(sigma) => YarnColor::Sigma(sigma),
                    None => fabric.color(family, thread as i32),
                };
                let at = known.iter().position(|c| *c == (k, color)).unwrap_or_else(|| {
                    known.push((k, color));
                    dyes.push(match color {
                        YarnColor::Undyed => Dye::Even(0.0),
                        YarnColor::Sigma(sigma) => Dye::Even(sigma),
                        YarnColor::Srgb(srgb) => {
                            let smooth = SmoothReflectance::of_srgb(srgb.map(f64::from));
                            Dye::Spectrum(Box::new(SigmaSpectrum::of_reflectance(&curves[k], |l| smooth.at(l)).0))
                        }
                    });
                    dyes.len() - 1
                });
                threads[k].push(at as u32);
            }
        }
        let beam: GaussianBeam = YarnSpec::parse(&models[0].data().spec_text, "warp.model (its spec)")?.beam.beam();
        let step = beam.d_cut_um / EDGES as f64;
        let spectrum = |i: usize| {
            let (low, high) = (i / (EDGES + 1), i % (EDGES + 1));
            Spectrum::new(-step * low as f64, step * high as f64, beam.w0_um)
        };
        let spectra = (0..(EDGES + 1) * (EDGES + 1)).map(spectrum).collect();
        Ok(FabricBsdf {
            fabric,
            models,
            dyes,
            threads,
            spectra,
            edge_step_um: step as f32,
            gaps: options.gaps,
            noise: options.noise,
            grain_um: (2.0 * beam.w0_um) as f32,
        })
    }

    /// The geometry.
    pub fn fabric(&self) -> &Fabric {
        &self.fabric
    }

    /// The ply model of a family.
    pub fn model(&self, family: Family) -> &PlyModel {
        &self.models[family as usize]
    }

    /// Bytes of memory, the models apart, which fabrics share.
    pub fn memory_bytes(&self) -> usize {
        let dye = |d: &Dye| match d {
            Dye::Even(_) => 0,
            Dye::Spectrum(_) => size_of::<SigmaSpectrum>(),
        };
        size_of::<FabricBsdf>()
            + self.fabric.memory_bytes()
            + self.threads.iter().map(|t| size_of_val(t.as_slice())).sum::<usize>()
            + size_of_val(self.dyes.as_slice())
            + self.dyes.iter().map(dye).sum::<usize>()
            + size_of_val(self.spectra.as_slice())
    }

    /// Absorptions [1/um] of a yarn at wavelengths [um].
    pub fn sigma<const N: usize>(&self, family: Family, yarn: i32, lambda_um: [f32; N]) -> [f32; N] {
        let threads = &self.threads[family as usize];
        let thread = yarn.rem_euclid(threads.len().max(1) as i32) as usize;
        let dye = threads.get(thread).and_then(|d| self.dyes.get(*d as usize));
        dye.map_or([0.0; N], |d| d.at(lambda_um))
    }

    /// The scattering function at a point [um] seen from `w`, at wavelengths [um].
    pub fn at<const N: usize>(&self, x_um: f32, y_um: f32, w: [f32; 3], lambda_um: [f32; N]) -> FabricAt<'_, N> {
        match self.fabric.at(x_um, y_um, w) {
            Place::Ply(hit) => {
                let seat = Seat { ply: self.ply(&hit, lambda_um).unprepared(), frame: hit.frame, over: None };
                let mut at = FabricAt { case: Case::Ply(seat) };
                if let Case::Ply(seat) = &mut at.case {
                    // In its place: lobes are large.
                    seat.ply.make();
                    seat.over = self.two_layers(&seat.ply, &hit, lambda_um);
                }
                at
            }
            Place::Gap(gap) => {
                let mut near = [None; 4];
                for (slot, hit) in near.iter_mut().zip(&gap.near) {
                    if let Some(hit) = hit {
                        *slot = Some(Near::new(&self.ply(hit, lambda_um), hit.frame));
                    }
                }
                let [west, east, south, north] = gap.aperture_um;
                let (x, y) = (self.spectrum(west, east), self.spectrum(south, north));
                let through = GapIncidence::new(x, y, w, lambda_um);
                FabricAt { case: Case::Gap(InGap::new(near, through, self.gaps)) }
            }
        }
    }

    /// What the ply does over the layer below, where there is one.
    fn two_layers<const N: usize>(
        &self,
        ply: &PreparedPly<'_, N>,
        hit: &PlyHit,
        lambda_um: [f32; N],
    ) -> Option<TwoLayered<N>> {
        let below = hit.below?;
        let family = hit.family.other();
        let sigma = self.sigma(family, below.yarn, lambda_um);
        TwoLayered::new(ply, &self.models[family as usize].layer(below.theta_i, sigma)?)
    }

    fn ply<const N: usize>(&self, hit: &PlyHit, lambda_um: [f32; N]) -> WholePly<'_, N> {
        WholePly {
            model: &self.models[hit.family as usize],
            theta_i: hit.theta_i,
            h_um: hit.h_um,
            sigma_per_um: self.sigma(hit.family, hit.yarn, lambda_um),
            lambda_um,
            slit: None,
            instance: self.noise.then(|| self.instance(hit)),
        }
    }

    /// The patterns of a stretch of a ply.
    fn instance(&self, hit: &PlyHit) -> Instance {
        // Two families, eight plies a yarn at most.
        let ply = (hit.yarn as u32).wrapping_mul(16) + hit.ply * 2 + hit.family as u32;
        Instance::new(ply, hit.along_um, self.grain_um)
    }

    /// The spectrum of the aperture whose edges are this far before and beyond the beam's center [um].
    fn spectrum(&self, before_um: f32, beyond_um: f32) -> &Spectrum {
        let node = |x: f32| ((x / self.edge_step_um + 0.5) as usize).min(EDGES);
        &self.spectra[node(before_um) * (EDGES + 1) + node(beyond_um)]
    }
}

/// A direction of the fabric's frame in that of a ply.
fn to_ply(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    frame.map(|a| a[0] * w[0] + a[1] * w[1] + a[2] * w[2])
}

/// A direction of a ply's frame in that of the fabric.
fn to_fabric(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| frame[0][k] * w[0] + frame[1][k] * w[1] + frame[2][k] * w[2])
}

/// A ply at the line, and its frame in the fabric's.
#[derive(Clone, Copy, Debug)]
struct Seat<'a, const N: usize> {
    ply: PreparedPly<'a, N>,
    frame: [[f32; 3]; 3],
    /// What it does over a second layer.
    over: Option<TwoLayered<N>>,
}

/// A ply beside a gap: what its fibers scatter of the beam.
#[derive(Clone, Copy, Debug)]
struct Near<'a, const N: usize> {
    ply: FreshPly<'a, N>,
    frame: [[f32; 3]; 3],
    /// 1 - r_d.
    caught: f32,
    energy: [f32; N],
    mean: f32,
    /// Chance that the ply's lobes give a direction.
    hit: f32,
}

impl<'a, const N: usize> Near<'a, N> {
    fn new(ply: &WholePly<'a, N>, frame: [[f32; 3]; 3]) -> Self {
        let ply = ply.fresh();
        let (energy, r_d) = ply.albedo_r_d();
        let mean = energy.iter().sum::<f32>() / N.max(1) as f32;
        let hit = if mean > 0.0 { mean / (mean + r_d) } else { 0.0 };
        Near { ply, frame, caught: (1.0 - r_d).max(0.0), energy, mean, hit }
    }

    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.ply.lobes(to_ply(&self.frame, wo))
    }

    /// Density of the lobes alone.
    fn pdf(&self, wo: [f32; 3]) -> f32 {
        if self.hit > 0.0 { self.ply.lobes_density(to_ply(&self.frame, wo)) / self.hit } else { 0.0 }
    }

    /// f and the density of the lobes alone.
    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let (f, pdf) = self.ply.lobes_pdf(to_ply(&self.frame, wo));
        (f, if self.hit > 0.0 { pdf / self.hit } else { 0.0 })
    }

    /// A direction of the lobes alone, with [`Near::eval_pdf`] there.
    fn sample(&self, u: [f32; 3]) -> Option<Drawn<([f32; N], f32)>> {
        let first = (u[0] * self.hit).min(self.hit * (1.0 - 1e-6));
        let (wo, (f, pdf)) = self.ply.sample_lobes([first, u[1], u[2]])?;
        Some((to_fabric(&self.frame, wo), (f, pdf / self.hit)))
    }
}

/// In a gap.
#[derive(Clone, Copy, Debug)]
struct InGap<'a, const N: usize> {
    near: [Option<Near<'a, N>>; 4],
    /// Factor on the plies' light.
    scale: f32,
    /// Energy that goes through the aperture.
    through: f32,
    gap: GapIncidence<'a, N>,
    straight: bool,
    /// Chances of the four plies and of the aperture; what is left of 1 goes straight on.
    chances: [f32; 5],
}

impl<'a, const N: usize> InGap<'a, N> {
    fn new(near: [Option<Near<'a, N>>; 4], gap: GapIncidence<'a, N>, gaps: GapLight) -> Self {
        let caught: f32 = near.iter().flatten().map(|n| n.caught).sum();
        let (scale, through) = (if caught > 1.0 { 1.0 / caught } else { 1.0 }, (1.0 - caught).max(0.0));
        // An aperture that is closed at the precision of the spectra lets its light pass straight on too.
        let straight = gaps == GapLight::Straight || gap.miss() >= 1.0;
        let mut chances = [0.0; 5];
        for (chance, ply) in chances.iter_mut().zip(&near) {
            *chance = ply.map_or(0.0, |p| scale * p.mean);
        }
        let total: f32 = chances.iter().sum::<f32>() + through;
        chances[4] = if straight { 0.0 } else { through };
        if total > 0.0 {
            chances.iter_mut().for_each(|c| *c /= total);
        }
        InGap { near, scale, through, gap, straight, chances }
    }

    /// The light of the aperture.
    fn aperture(&self, wo: [f32; 3]) -> [f32; N] {
        if self.straight { [0.0; N] } else { self.gap.eval(wo).map(|g| self.through * g) }
    }

    /// The density of the aperture's samples, with their chance.
    fn aperture_pdf(&self, wo: [f32; 3]) -> f32 {
        if self.chances[4] > 0.0 { self.chances[4] * self.gap.pdf(wo) } else { 0.0 }
    }

    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        let mut f = self.aperture(wo);
        for ply in self.near.iter().flatten() {
            let part = ply.eval(wo);
            for k in 0..N {
                f[k] += self.scale * part[k];
            }
        }
        f
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        let mut pdf = self.aperture_pdf(wo);
        for (ply, chance) in self.near.iter().zip(&self.chances) {
            if let Some(ply) = ply {
                pdf += chance * ply.pdf(wo);
            }
        }
        pdf
    }

    /// f and density; those of a ply that is known by its number need not be asked for.
    fn eval_pdf(&self, wo: [f32; 3], known: Option<(usize, ([f32; N], f32))>) -> ([f32; N], f32) {
        let (mut f, mut pdf) = (self.aperture(wo), self.aperture_pdf(wo));
        for (i, (ply, chance)) in self.near.iter().zip(&self.chances).enumerate() {
            if let Some(ply) = ply {
                let (part, density) = match known {
                    Some((known, drawn)) if known == i => drawn,
                    _ => ply.eval_pdf(wo),
                };
                for k in 0..N {
                    f[k] += self.scale * part[k];
                }
                pdf += chance * density;
            }
        }
        (f, pdf)
    }

    /// A direction, f and density there.
    fn sample(&self, u: [f32; 3]) -> Option<Drawn<([f32; N], f32)>> {
        let mut left = u[0];
        for (i, (ply, chance)) in self.near.iter().zip(&self.chances).enumerate() {
            if let Some(ply) = ply {
                if left < *chance {
                    let (wo, drawn) = ply.sample([left / chance, u[1], u[2]])?;
                    return Some((wo, self.eval_pdf(wo, Some((i, drawn)))));
                }
                left -= chance;
            }
        }
        let chance = self.chances[4];
        if left < chance {
            let wo = self.gap.direction([left / chance, u[1], u[2]])?;
            Some((wo, self.eval_pdf(wo, None)))
        } else {
            None
        }
    }
}

/// One of the cases of 7.1. It lives on the stack of one query: a box would allocate.
#[derive(Clone, Copy, Debug)]
enum Case<'a, const N: usize> {
    Ply(Seat<'a, N>),
    Gap(InGap<'a, N>),
}

/// A fabric at one point and direction, for N wavelengths; of a ply the lobes are interpolated once.
#[derive(Clone, Copy, Debug)]
pub struct FabricAt<'a, const N: usize> {
    case: Case<'a, N>,
}

impl<const N: usize> FabricAt<'_, N> {
    /// Whether the point lies in a gap.
    pub fn is_gap(&self) -> bool {
        matches!(self.case, Case::Gap(_))
    }

    /// Whether two layers of yarns lie there.
    pub fn is_double(&self) -> bool {
        matches!(self.case, Case::Ply(Seat { over: Some(_), .. }))
    }
}

impl<const N: usize> Scatter<N> for FabricAt<'_, N> {
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        match &self.case {
            Case::Ply(Seat { ply, frame, over: None }) => ply.eval(to_ply(frame, wo)),
            Case::Ply(Seat { ply, frame, over: Some(two) }) => two.eval(ply, to_ply(frame, wo)),
            Case::Gap(gap) => gap.eval(wo),
        }
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        match &self.case {
            Case::Ply(Seat { ply, frame, over: None }) => ply.pdf(to_ply(frame, wo)),
            Case::Ply(Seat { ply, frame, over: Some(two) }) => two.pdf(ply, to_ply(frame, wo)),
            Case::Gap(gap) => gap.pdf(wo),
        }
    }

    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        match &self.case {
            Case::Ply(Seat { ply, frame, over: None }) => ply.eval_pdf(to_ply(frame, wo)),
            Case::Ply(Seat { ply, frame, over: Some(two) }) => two.eval_pdf(ply, to_ply(frame, wo)),
            Case::Gap(gap) => gap.eval_pdf(wo, None),
        }
    }

    fn sample(&self, u: [f32; 3]) -> Option<ScatterSample<N>> {
        let turned = |frame: &[[f32; 3]; 3], s: ScatterSample<N>| ScatterSample { wo: to_fabric(frame, s.wo), ..s };
        match &self.case {
            Case::Ply(Seat { ply, frame, over: None }) => ply.sample(u).map(|s| turned(frame, s)),
            Case::Ply(Seat { ply, frame, over: Some(two) }) => two.sample(ply, u).map(|s| turned(frame, s)),
            Case::Gap(gap) => {
                let u = u.map(|x| crate::simd::min(crate::simd::max(x, 0.0), 1.0 - f32::EPSILON / 2.0));
                let (wo, (f, pdf)) = gap.sample(u)?;
                Some(ScatterSample { wo, weight: f.map(|f| if pdf > 0.0 { f / pdf } else { 0.0 }), pdf })
            }
        }
    }

    /// The light that comes back or through. Of the light through an aperture all is counted, as its Kirchhoff integral is to 2 % from 10 um on.
    fn albedo(&self) -> [f32; N] {
        match &self.case {
            Case::Ply(Seat { ply, over: None, .. }) => ply.albedo(),
            Case::Ply(Seat { over: Some(two), .. }) => two.albedo(),
            Case::Gap(gap) => {
                let mut albedo = if gap.straight { [0.0; N] } else { [gap.through; N] };
                for ply in gap.near.iter().flatten() {
                    for k in 0..N {
                        albedo[k] += gap.scale * ply.energy[k];
                    }
                }
                albedo
            }
        }
    }

    fn miss(&self) -> f32 {
        match &self.case {
            Case::Ply(Seat { ply, over: None, .. }) => ply.miss(),
            Case::Ply(_) => 0.0,
            Case::Gap(gap) => (1.0 - gap.chances.iter().sum::<f32>()).max(0.0),
        }
    }
}
