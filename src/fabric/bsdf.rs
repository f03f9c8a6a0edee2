//! The fabric as a surface that scatters light (Yu 2025, 7.1), loaded with what all its points share: models,
//! colors, shadows, the light between yarns.
//!
//! The camera ray plays the beam: the query's `wo` is the direction to the viewer, and f(wi), an energy
//! density per steradian of the light's direction `wi`, holds the cosine at the surface:
//! `radiance to wo = integral f(wi) radiance from wi d wi`. Averaged over a repeat, f over that cosine is
//! symmetric in wo and wi up to the ply models' own asymmetry, and energy is conserved either way
//! (docs/explain/papers.md: departures from 7.1).

use super::at::{FabricBsdf, NearPly, Passes, by_family, in_pattern};
use super::between::InterYarn;
use super::color_of::{self, ColorOf};
use super::dye::{Channels, Dye, colors_of, own_color, shares_of};
use super::far::Far;
use super::flight::Candidate;
use super::follow::{Yarns, class};
use super::hit::MAX_NEAR;
use super::query::{FabricOptions, FabricQuery, GapLight, Slits};
use super::shade::{Occlusion, Shade};
use super::shadow::{Passing, Shadows};
use super::{Fabric, Gap, LoadedFabric, PlyHit, YarnColor, YarnSet};
use crate::cloth::ClothSurface;
use crate::color::AlbedoCurve;
use crate::fiber::Reflections;
use crate::gap::{Apertures, Slit};
use crate::ply::{Prepared, UncachedPly};
use crate::spec::{GaussianBeam, YarnSpec};
use crate::speckle::Instance;
use crate::{PlyModel, PlyQuery, Result};
use std::path::Path;
use std::sync::Arc;

/// Share of a beam that is not followed further.
const MIN_CAUGHT: f32 = 1e-3;

/// A woven fabric, ready for shading.
///
/// ```
/// use plywave::FabricModel;
/// use plywave::fabric::{FabricOptions, FabricSpec};
/// use plywave::io::MemoryAssets;
///
/// # fn main() -> plywave::Result<()> {
/// # let model = &include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm"))[..];
/// // Without a file system: a spec's text, and the bytes of the models it names.
/// let assets = MemoryAssets::new().with("ply.pwm", model);
/// let yarn = "model = \"ply.pwm\"\nspacing_um = 130.0\ncrimp = 0.3\nsrgb = [0.6, 0.2, 0.2]\n";
/// let text = format!("name = \"plain\"\n[weave]\nkind = \"plain\"\n[warp]\n{yarn}[weft]\n{yarn}");
/// let fabric = FabricModel::new(FabricSpec::load_from(&text, "plain.toml", &assets)?, &FabricOptions::default())?;
/// assert_eq!(fabric.fabric().repeat_um(), [260.0, 260.0]);
/// # Ok(())
/// # }
/// ```
///
/// Lengths in um in the plane of the fabric (x along the weft, y along the warp, z the face's normal),
/// directions unit in that frame. No call to evaluate fails, allocates or panics.
#[derive(Clone, Debug)]
pub struct FabricModel {
    pub(super) fabric: Fabric,
    pub(super) models: Vec<Arc<PlyModel>>,
    /// Brightness of the cloth over absorption, and what it is the brightness of.
    pub(super) curve: AlbedoCurve,
    pub(super) color_of: ColorOf,
    /// By family, the model of each yarn of one repeat of its stripes.
    pub(super) stripes: [Vec<u32>; 2],
    /// By family, the color of each thread of the draft's repeat.
    pub(super) threads: [Vec<u32>; 2],
    /// `[model]`: what its fibers' reflections absorb, if they are opaque.
    pub(super) metals: Vec<Option<Reflections>>,
    /// `[color]`: the absorption that gives yarns the color.
    pub(super) dyes: Vec<Dye>,
    /// In the beam of the warp's model.
    pub(super) apertures: Apertures,
    /// By family.
    pub(super) slits: [Option<Slit>; 2],
    pub(super) options: FabricOptions,
    pub(super) shadows: Shadows,
    pub(super) between: InterYarn,
    /// Length of a ply with the same patterns, 2 w0 [um].
    pub(super) grain_um: f32,
    /// The mean over the repeat, and by family the share of each color.
    pub(super) far: Option<Arc<Far>>,
    pub(super) color_shares: [Vec<(u32, f32)>; 2],
}

impl FabricModel {
    /// Reads a fabric spec and the models it names.
    ///
    /// # Errors
    /// As [`super::FabricSpec::load`].
    pub fn load(path: impl AsRef<Path>, options: &FabricOptions) -> Result<FabricModel> {
        FabricModel::new(super::FabricSpec::load(path)?, options)
    }

    /// Of a loaded fabric.
    ///
    /// # Errors
    /// As [`YarnSpec::parse`], for the spec in the warp's model, and as [`Slit::new`], for
    /// [`FabricOptions::slits`].
    pub fn new(loaded: LoadedFabric, options: &FabricOptions) -> Result<FabricModel> {
        let warp = loaded.model_of(YarnSet::Warp, 0).data();
        let beam: GaussianBeam = YarnSpec::parse(&warp.spec_text, "warp.model (its spec)")?.beam.beam();
        let slits = [slit_of(&loaded, YarnSet::Warp, options)?, slit_of(&loaded, YarnSet::Weft, options)?];
        let LoadedFabric { fabric, models, threads: stripes, spec, .. } = loaded;
        // A line that passes a ply goes on to others: it is one line, not the beam of a table.
        let models: Vec<Arc<PlyModel>> = models.iter().map(|m| Ok(Arc::new(m.of_lines()?))).collect::<Result<_>>()?;
        let stripes = stripes.map(|of| of.into_iter().map(|model| model as u32).collect::<Vec<_>>());
        let metals: Vec<Option<Reflections>> = models.iter().map(|m| own_color(m)).collect::<Result<_>>()?;
        let (colors, threads) = colors_of(&fabric, &stripes, &metals, options.sigma_per_um);
        let yarns = OfYarns { models: &models, stripes: &stripes, slits: &slits };
        let shadows = Shadows::new(&fabric, &yarns);
        let between = InterYarn::new(&fabric, &shadows, &yarns);
        if options.noise {
            // No query makes tiles then.
            for model in &models {
                let _ = model.noise();
            }
        }
        let mut shading = FabricModel {
            shadows,
            curve: between.curve(),
            between,
            fabric,
            models,
            color_of: ColorOf::EvenSky,
            stripes,
            threads,
            metals,
            dyes: Vec::new(),
            apertures: Apertures::new(&beam),
            slits,
            options: *options,
            grain_um: (2.0 * beam.w0_um) as f32,
            far: None,
            color_shares: [Vec::new(), Vec::new()],
        };
        if colors.iter().any(|color| matches!(color.0, YarnColor::Srgb(_))) {
            shading.curve = shading.color_curve_of(spec.color_of);
            shading.color_of = spec.color_of;
        }
        shading.dyes = colors.iter().map(|color| shading.dye_of(*color)).collect();
        shading.color_shares = shares_of(&shading.threads);
        if options.far {
            let options = FabricOptions { noise: false, ..*options };
            let smooth = FabricModel { options, slits: [None; 2], ..shading.clone() };
            shading.far = Some(Arc::new(Far::new(&smooth)));
        }
        Ok(shading)
    }

    /// The geometry.
    pub fn fabric(&self) -> &Fabric {
        &self.fabric
    }

    /// The ply model of a yarn, [in single lines](PlyModel::of_lines).
    pub fn model_of(&self, family: YarnSet, yarn: i32) -> &PlyModel {
        &self.models[self.model_index(family, yarn)]
    }

    /// Number of yarns after which the models of a family repeat; 1 without stripes.
    pub fn repeat_of_stripes(&self, family: YarnSet) -> usize {
        self.stripes[family as usize].len()
    }

    /// Index of the model of a yarn; stripes go on without end.
    #[inline]
    fn model_index(&self, family: YarnSet, yarn: i32) -> usize {
        repeated(&self.stripes[family as usize], yarn) as usize
    }

    /// Bytes of memory, the models apart, which fabrics share.
    pub fn memory_bytes(&self) -> usize {
        size_of::<FabricModel>()
            + self.fabric.memory_bytes()
            + self.threads.iter().chain(&self.stripes).map(|t| size_of_val(t.as_slice())).sum::<usize>()
            + size_of_val(self.dyes.as_slice())
            + self.dyes.iter().map(Dye::memory_bytes).sum::<usize>()
            + self.apertures.memory_bytes()
            + self.shadows.memory_bytes()
            + self.between.memory_bytes()
            + self.far.as_ref().map_or(0, |far| far.memory_bytes())
            + self.color_shares.iter().map(|shares| size_of_val(shares.as_slice())).sum::<usize>()
    }

    /// Absorptions [1/um] of a yarn at wavelengths [um].
    pub fn sigma<const N: usize>(&self, family: YarnSet, yarn: i32, lambda_um: [f32; N]) -> [f32; N] {
        self.dye(family, yarn).at(lambda_um, Channels::Wavelengths)
    }

    /// Brightness of the cloth over the absorption of its fibers, in the meaning that the spec gives to
    /// colors: the light that a color describes. Of a spec without colors, under a sky all round.
    pub fn color_curve(&self) -> &AlbedoCurve {
        &self.curve
    }

    /// What the colors of the spec are colors of; of a spec without colors, a sky all round.
    pub fn color_of(&self) -> ColorOf {
        self.color_of
    }

    /// As [`FabricModel::color_curve`], in another meaning. It takes tenths of a second but for the spec's
    /// own and [`ColorOf::EvenSky`].
    pub fn color_curve_of(&self, of: ColorOf) -> AlbedoCurve {
        let even_sky = self.between.curve();
        if of == ColorOf::EvenSky {
            return even_sky;
        }
        if of == self.color_of {
            return self.curve.clone();
        }
        let mut rays = self.clone();
        rays.options = FabricOptions::RAYS;
        color_of::curve(&color_of::Sheet { cloth: &rays, repeat_um: self.fabric.repeat_um() }, of, &even_sky)
    }

    /// Absorptions [1/um] with which the cloth has these reflectances, 0 to 1, at wavelengths or in linear
    /// RGB: [`FabricModel::color_curve`] inverted. What is out of reach is clamped to clear or black fibers.
    /// Hosts convert a texture once.
    pub fn sigma_of_reflectance<const N: usize>(&self, reflectance: [f32; N]) -> [f32; N] {
        reflectance.map(|r| self.curve.sigma(f64::from(r)).0 as f32)
    }

    #[inline]
    fn dye(&self, family: YarnSet, yarn: i32) -> &Dye {
        let color = repeated(&self.threads[family as usize], yarn) as usize;
        &self.dyes[color]
    }

    /// Absorptions of a yarn at a query.
    fn query_sigma<const N: usize>(&self, query: &FabricQuery<'_, N>, family: YarnSet, yarn: i32) -> [f32; N] {
        if let Some(sigma) = query.sigma_per_um[family as usize] {
            return sigma;
        }
        self.dye(family, yarn).at(query.lambda_um, query.channels)
    }

    fn query_model<'a, const N: usize>(
        &'a self,
        query: &FabricQuery<'a, N>,
        family: YarnSet,
        yarn: i32,
    ) -> &'a PlyModel {
        query.models[family as usize].unwrap_or_else(|| self.model_of(family, yarn))
    }

    /// The fabric at a query.
    ///
    /// ```
    /// use plywave::{Bsdf, BsdfSample, FabricModel, FabricQuery};
    /// use plywave::fabric::FabricOptions;
    ///
    /// # fn main() -> plywave::Result<()> {
    /// let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/polyester_satin.toml");
    /// let fabric = FabricModel::load(path, &FabricOptions::default())?;
    /// let at = fabric.at(&FabricQuery::rgb([1200.0, 340.0], [0.0, 0.6, 0.8]));
    /// let rgb = at.eval([0.3, 0.0, 0.954]); // light from there, its cosine included
    /// if let BsdfSample::Scattered(light) = at.sample([0.3, 0.6, 0.9]) {
    ///     println!("next ray towards {:?}, weight {:?}", light.w, light.weight);
    /// }
    /// # assert!(rgb.iter().all(|f| *f >= 0.0));
    /// # Ok(())
    /// # }
    /// ```
    #[inline(always)]
    pub fn at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N> {
        // In its place: it is too large to move.
        let mut at = FabricBsdf::empty();
        self.fill(query, &mut at);
        at
    }

    fn fill<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>, at: &mut FabricBsdf<'a, N>) {
        let (turn, position, wo) = in_pattern(query);
        at.turn = turn;
        if at.is_far(self.far_at(query, wo)) {
            return;
        }
        let mut firsts = [(0, [0.0; N]); MAX_NEAR + 1];
        let (mut count, mut last_other) = (0, 0);
        let mut sigma = None;
        let mut gap = Gap::open(&self.fabric);
        let mut flight = self.fabric.flight_through(position, wo);
        while let Some(near) = flight.next_near() {
            let hit = &near.hit;
            let ply_query = self.ply_query(query, hit);
            let model = self.query_model(query, hit.family, hit.yarn);
            let arrives = at.passing;
            let (r_d, energy) = if near.is_hit && at.main.is_none() {
                at.is_double = hit.is_double;
                let main = at.main.insert(self.near_ply(&near, model.uncached_at(&ply_query), arrives, wo));
                main.ply.prepare_into(&mut at.prepared);
                (main.energies(&at.prepared), main.energy)
            } else {
                gap.close(&self.fabric, hit);
                let ply = model.uncached_at(&ply_query);
                let r_d = ply.lit().albedo_r_d().1;
                // Of less than this of the beam, what rims catch counts as passing.
                if arrives * (1.0 - r_d) < MIN_CAUGHT {
                    continue;
                }
                let Some(slot) = at.others.iter_mut().find(|slot| slot.is_none()) else {
                    // Grazing lines pass many rims: what those beyond these catch, the last of these
                    // scatters.
                    if let Some(last) = &mut at.others[MAX_NEAR - 1] {
                        let more = 1.0 + arrives * (1.0 - r_d) / (last.arrives * last.caught).max(MIN_CAUGHT);
                        last.arrives *= more;
                        firsts[last_other].1.iter_mut().for_each(|energy| *energy *= more);
                    }
                    at.passing *= r_d;
                    if at.passing < MIN_CAUGHT {
                        break;
                    }
                    continue;
                };
                let ply = slot.insert(self.near_ply(&near, ply, arrives, wo));
                ply.caught = 1.0 - ply.energies(&Prepared::Nothing);
                last_other = count;
                (r_d, ply.energy)
            };
            firsts[count] = (class(hit), energy.map(|e| arrives * e));
            count += 1;
            if sigma.is_none() || near.is_hit {
                let other = hit.family.other();
                let across = hit.along_um * self.fabric.yarns[other as usize].per_spacing;
                let other_yarn = crate::math::floor_fraction(across).0;
                sigma = Some(by_family(hit.family, ply_query.sigma_per_um, self.query_sigma(query, other, other_yarn)));
            }
            at.passing *= r_d;
            if at.passing < MIN_CAUGHT {
                break;
            }
        }
        if let Some(sigma) = sigma {
            at.between = self.between.at(wo, &firsts[..count], sigma, self.sent());
        }
        at.passes = match &at.main {
            Some(main) if self.options.edges && main.ply.model.has_edge() => Passes::Edge,
            None if self.options.gaps == GapLight::Diffracted => {
                at.passes_gap(self.apertures.at(gap.aperture_um, [1.0, 0.0], wo, query.lambda_um))
            }
            _ => Passes::Straight,
        };
        at.set_chances();
    }

    /// A ply near the line, of a beam of which the share `arrives` comes to it.
    #[inline(always)]
    fn near_ply<'a, const N: usize>(
        &'a self,
        near: &Candidate,
        ply: UncachedPly<'a, N>,
        arrives: f32,
        wo: [f32; 3],
    ) -> NearPly<'a, N> {
        let hit = &near.hit;
        NearPly {
            frame: hit.frame,
            shade: Shade::Yarns(Occlusion::new(
                (&self.fabric, &self.shadows, ply.model),
                near,
                wo,
                [self.options.shadowing, self.options.layers],
            )),
            exits: ply.model.exits_at(hit.theta_i, hit.h_um, self.fabric.yarns[hit.family as usize].radius),
            ply,
            class: class(hit),
            arrives,
            caught: 0.0,
            energy: [0.0; N],
            hit: 0.0,
            chance: 0.0,
        }
    }

    fn ply_query<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>, hit: &PlyHit) -> PlyQuery<'a, N> {
        let sigma_per_um = self.query_sigma(query, hit.family, hit.yarn);
        PlyQuery {
            instance: self.options.noise.then(|| self.instance(hit)),
            slit: slit_at(&self.slits, hit),
            ..PlyQuery::new(hit.theta_i, hit.h_um, sigma_per_um, query.lambda_um)
        }
    }

    /// The patterns of a place on a ply.
    fn instance(&self, hit: &PlyHit) -> Instance {
        // Two families, eight plies a yarn at most.
        let ply = (hit.yarn as u32).wrapping_mul(16) + hit.ply * 2 + hit.family as u32;
        Instance::new(ply, [hit.along_um, hit.h_um], self.grain_um)
    }

    /// Factors on what first plies send up and down.
    pub(super) fn sent(&self) -> [f32; 2] {
        let on = |switch: bool| f32::from(u8::from(switch));
        [on(self.options.shadowing), on(self.options.layers)]
    }
}

impl ClothSurface for FabricModel {
    #[inline(always)]
    fn surface_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N> {
        self.at(query)
    }
}

/// The slits of a family's yarns, in its models' beam; none where no light goes through them.
fn slit_of(loaded: &LoadedFabric, family: YarnSet, options: &FabricOptions) -> Result<Option<Slit>> {
    let Some(Slits { width_um, share }) = options.slits_or(loaded.spec.yarn(family).slits()) else { return Ok(None) };
    let model = loaded.model_of(family, 0).data();
    let beam = YarnSpec::parse(&model.spec_text, "model (its spec)")?.beam.beam();
    Slit::new(width_um, share, &beam).map(Some)
}

/// The slits of a ply that a line comes near: where one layer lies, as [`PlyQuery::slit`] has it.
#[inline]
fn slit_at<'a>(slits: &'a [Option<Slit>; 2], hit: &PlyHit) -> Option<&'a Slit> {
    slits[hit.family as usize].as_ref().filter(|_| !hit.is_double)
}

/// The entry of a yarn in a list that repeats; 0 for an empty one.
#[inline]
fn repeated(list: &[u32], yarn: i32) -> u32 {
    match list {
        [one] => *one,
        _ => list.get(yarn.rem_euclid(list.len().max(1) as i32) as usize).copied().unwrap_or(0),
    }
}

/// The models of a fabric's yarns.
struct OfYarns<'a> {
    models: &'a [Arc<PlyModel>],
    stripes: &'a [Vec<u32>; 2],
    slits: &'a [Option<Slit>; 2],
}

impl Yarns for OfYarns<'_> {
    fn model(&self, family: YarnSet, yarn: i32) -> &PlyModel {
        &self.models[repeated(&self.stripes[family as usize], yarn) as usize]
    }

    fn slit(&self, hit: &PlyHit) -> Option<&Slit> {
        slit_at(self.slits, hit)
    }
}

impl Passing for OfYarns<'_> {
    fn r_d(&self, family: YarnSet, yarn: i32, theta_i: f32, h_um: f32) -> f32 {
        self.model(family, yarn).r_d(theta_i, h_um)
    }
}
