//! The fabric as a surface that scatters light (Yu 2025, 7.1): at a point, seen from a direction, one of three cases of the beam.
//!
//! - The line meets a ply near its center or near its rim (cases a and b): the whole ply, edge light included; over a second layer of yarns what it sends on is that of
//!   two layers.
//! - The line meets no ply (case c): the light that the near plies catch, and what is left goes through the aperture between them.
//!
//! The camera ray plays the beam: the query's `wo` is the direction to the viewer, and f(wi), an energy density per steradian of the light's direction `wi`, holds the
//! cosine at the surface: `radiance to wo = integral f(wi) radiance from wi d wi`. f is not symmetric in wo and wi: yarns do not shadow their neighbors.
//!
//! Energy: with clear fibers f integrates to 1 over the sphere, up to the Kirchhoff integral of small apertures and, over a second layer, the energies between the
//! nodes of the model. Where the plies at the edges of a gap together catch more than the beam, as rims behind each other do, their light is scaled to all of it.

use super::dye::{Channels, Dye};
use super::in_gap::{GapLight, InGap, Near, to_fabric, to_pattern, to_ply, to_surface};
use super::{Fabric, Family, LoadedFabric, Place, PlyHit, YarnColor};
use crate::bsdf::{DirectionSample, Outcomes};
use crate::color::{AlbedoCurve, RGB_LAMBDA_UM};
use crate::gap::{GapBsdf, Spectrum};
use crate::ply::Layer;
use crate::spec::{GaussianBeam, YarnSpec};
use crate::speckle::Instance;
use crate::{Bsdf, BsdfSample, PlyBsdf, PlyModel, PlyQuery, Result};
use std::path::Path;
use std::sync::Arc;

/// Edges of apertures, in equal steps from the beam's center to d_cut, for which spectra are kept.
const EDGES: usize = 32;

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

/// What fixes a shading point of a fabric, for N wavelengths or color channels. [`FabricQuery::new`] is the fabric as its spec has it; a point's own color, turn or
/// models are options to set: `FabricQuery { turn_rad: 0.3, ..FabricQuery::new(..) }`.
///
/// ```
/// use plywave::FabricQuery;
///
/// let spectral = FabricQuery::new([120.0, 40.0], [0.0, 0.6, 0.8], [0.45, 0.55, 0.65]);
/// let turned = FabricQuery { turn_rad: 0.3, ..spectral };
/// let rgb = FabricQuery::rgb([120.0, 40.0], [0.0, 0.6, 0.8]);
/// # assert!(turned.turn_rad > rgb.turn_rad);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FabricQuery<'a, const N: usize> {
    /// Point in the plane of the fabric [um]: x along the weft, y along the warp.
    pub position_um: [f32; 2],
    /// Direction towards the viewer, unit, in the frame of the surface: z is the normal of the fabric's face.
    pub wo: [f32; 3],
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// What the N numbers of a color are.
    pub channels: Channels,
    /// The point's own absorptions of warp and weft [1/um], for textures and prints, in place of those of the yarns' colors; a host gets them from
    /// [`FabricBsdf::sigma_of_reflectance`].
    pub sigma_per_um: [Option<[f32; N]>; 2],
    /// Angle by which the pattern is turned about the normal at the point [rad], from x towards y. The position is one of the turned pattern's plane, given in the
    /// surface's axes.
    pub turn_rad: f32,
    /// Ply models of warp and weft in place of the fabric's; of the same ply radius and number of plies.
    pub models: [Option<&'a PlyModel>; 2],
}

impl<const N: usize> FabricQuery<'_, N> {
    /// The fabric as its spec has it, at a point [um] seen from `wo`, at wavelengths [um].
    pub fn new(position_um: [f32; 2], wo: [f32; 3], lambda_um: [f32; N]) -> Self {
        FabricQuery {
            position_um,
            wo,
            lambda_um,
            channels: Channels::Wavelengths,
            sigma_per_um: [None; 2],
            turn_rad: 0.0,
            models: [None; 2],
        }
    }
}

impl FabricQuery<'_, 3> {
    /// The fabric for a host that renders in linear sRGB: see [`Channels::LinearSrgb`].
    pub fn rgb(position_um: [f32; 2], wo: [f32; 3]) -> Self {
        FabricQuery { channels: Channels::LinearSrgb, ..FabricQuery::new(position_um, wo, RGB_LAMBDA_UM) }
    }
}

/// A woven fabric, ready for shading.
///
/// ```
/// use plywave::FabricBsdf;
/// use plywave::fabric::{FabricOptions, FabricSpec};
/// use plywave::io::MemoryAssets;
///
/// # fn main() -> plywave::Result<()> {
/// # let model = &include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm"))[..];
/// // Without a file system: a spec's text, and the bytes of the models it names.
/// let assets = MemoryAssets::new().with("ply.pwm", model);
/// let yarn = "model = \"ply.pwm\"\nspacing_um = 130.0\ncrimp = 0.3\nsrgb = [0.6, 0.2, 0.2]\n";
/// let text = format!("name = \"plain\"\n[weave]\nkind = \"plain\"\n[warp]\n{yarn}[weft]\n{yarn}");
/// let fabric = FabricBsdf::new(FabricSpec::load_from(&text, "plain.toml", &assets)?, &FabricOptions::default())?;
/// assert_eq!(fabric.fabric().repeat_um(), [260.0, 260.0]);
/// # Ok(())
/// # }
/// ```
///
/// Lengths in um in the plane of the fabric (x along the weft, y along the warp, z the face's normal), directions unit in that frame. No call to
/// evaluate fails, allocates or panics.
#[derive(Clone, Debug)]
pub struct FabricBsdf {
    fabric: Fabric,
    models: Vec<Arc<PlyModel>>,
    /// Albedo over absorption of each model.
    curves: Vec<AlbedoCurve>,
    /// By family, the model of each yarn of one repeat of its stripes.
    stripes: [Vec<u32>; 2],
    /// By family, the color of each thread of the draft's repeat.
    threads: [Vec<u32>; 2],
    /// `[color][model]`: the absorption that gives yarns of the model the color.
    dyes: Vec<Dye>,
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
        let warp = loaded.model_of(Family::Warp, 0).data();
        let beam: GaussianBeam = YarnSpec::parse(&warp.spec_text, "warp.model (its spec)")?.beam.beam();
        let LoadedFabric { fabric, models, threads: stripes, .. } = loaded;
        let stripes = stripes.map(|of| of.into_iter().map(|model| model as u32).collect());
        let curves: Vec<AlbedoCurve> = models.iter().map(|model| AlbedoCurve::diffuse(model)).collect();
        let mut colors: Vec<YarnColor> = Vec::new();
        let mut threads = [Vec::new(), Vec::new()];
        for (k, family) in Family::EACH.into_iter().enumerate() {
            for thread in 0..fabric.draft().threads(family) {
                let color = match options.sigma_per_um {
                    Some(sigma) => YarnColor::Sigma(sigma),
                    None => fabric.color(family, thread as i32),
                };
                let at = colors.iter().position(|c| *c == color).unwrap_or_else(|| {
                    colors.push(color);
                    colors.len() - 1
                });
                threads[k].push(at as u32);
            }
        }
        let dyes = colors.iter().flat_map(|color| curves.iter().map(|curve| Dye::new(*color, curve))).collect();
        let step = beam.d_cut_um / EDGES as f64;
        let spectrum = |i: usize| {
            let (low, high) = (i / (EDGES + 1), i % (EDGES + 1));
            Spectrum::new(-step * low as f64, step * high as f64, beam.w0_um)
        };
        let spectra = (0..(EDGES + 1) * (EDGES + 1)).map(spectrum).collect();
        Ok(FabricBsdf {
            fabric,
            models,
            curves,
            stripes,
            threads,
            dyes,
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

    /// The ply model of a yarn.
    pub fn model_of(&self, family: Family, yarn: i32) -> &PlyModel {
        &self.models[self.model_index(family, yarn)]
    }

    /// Number of yarns after which the models of a family repeat; 1 without stripes.
    pub fn repeat_of_stripes(&self, family: Family) -> usize {
        self.stripes[family as usize].len()
    }

    /// Index of the model of a yarn; stripes go on without end.
    #[inline]
    fn model_index(&self, family: Family, yarn: i32) -> usize {
        repeated(&self.stripes[family as usize], yarn) as usize
    }

    /// Bytes of memory, the models apart, which fabrics share.
    pub fn memory_bytes(&self) -> usize {
        size_of::<FabricBsdf>()
            + self.fabric.memory_bytes()
            + self.threads.iter().chain(&self.stripes).map(|t| size_of_val(t.as_slice())).sum::<usize>()
            + size_of_val(self.dyes.as_slice())
            + self.dyes.iter().map(Dye::memory_bytes).sum::<usize>()
            + size_of_val(self.spectra.as_slice())
    }

    /// Absorptions [1/um] of a yarn at wavelengths [um].
    pub fn sigma<const N: usize>(&self, family: Family, yarn: i32, lambda_um: [f32; N]) -> [f32; N] {
        self.dye(family, yarn).at(lambda_um, Channels::Wavelengths)
    }

    /// Absorptions [1/um] that give the first yarn of a family these reflectances (albedos under diffuse light), 0 to 1, at wavelengths or in linear RGB. What is out of
    /// reach is clamped to clear or black fibers. An exact inversion by Newton's steps: hosts convert a texture once.
    pub fn sigma_of_reflectance<const N: usize>(&self, family: Family, reflectance: [f32; N]) -> [f32; N] {
        let curve = &self.curves[self.model_index(family, 0)];
        reflectance.map(|r| curve.sigma(f64::from(r)).0 as f32)
    }

    #[inline]
    fn dye(&self, family: Family, yarn: i32) -> &Dye {
        let color = repeated(&self.threads[family as usize], yarn) as usize;
        &self.dyes[color * self.models.len() + self.model_index(family, yarn)]
    }

    /// Absorptions of a yarn at a query.
    fn query_sigma<const N: usize>(&self, query: &FabricQuery<'_, N>, family: Family, yarn: i32) -> [f32; N] {
        if let Some(sigma) = query.sigma_per_um[family as usize] {
            return sigma;
        }
        self.dye(family, yarn).at(query.lambda_um, query.channels)
    }

    fn query_model<'a, const N: usize>(
        &'a self,
        query: &FabricQuery<'a, N>,
        family: Family,
        yarn: i32,
    ) -> &'a PlyModel {
        query.models[family as usize].unwrap_or_else(|| self.model_of(family, yarn))
    }

    /// The fabric at a query.
    ///
    /// ```
    /// use plywave::{Bsdf, BsdfSample, FabricBsdf, FabricQuery};
    /// use plywave::fabric::FabricOptions;
    ///
    /// # fn main() -> plywave::Result<()> {
    /// let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/polyester_satin.toml");
    /// let fabric = FabricBsdf::load(path, &FabricOptions::default())?;
    /// let at = fabric.at(&FabricQuery::rgb([1200.0, 340.0], [0.0, 0.6, 0.8]));
    /// let rgb = at.eval([0.3, 0.0, 0.954]); // light from there, its cosine included
    /// if let BsdfSample::Scattered(light) = at.sample([0.3, 0.6, 0.9]) {
    ///     println!("next ray towards {:?}, weight {:?}", light.w, light.weight);
    /// }
    /// # assert!(rgb.iter().all(|f| *f >= 0.0));
    /// # Ok(())
    /// # }
    /// ```
    pub fn at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricAt<'a, N> {
        let turned = query.turn_rad != 0.0 && query.turn_rad.is_finite();
        let turn = if turned { [query.turn_rad.cos(), query.turn_rad.sin()] } else { [1.0, 0.0] };
        let ([x, y], mut wo) = (query.position_um, query.wo);
        let mut position = [x, y];
        if turned {
            let p = to_pattern(turn, [x, y, 0.0]);
            (position, wo) = ([p[0], p[1]], to_pattern(turn, wo));
        }
        let surface_frame =
            |frame: [[f32; 3]; 3]| if turned { frame.map(|axis| to_surface(turn, axis)) } else { frame };
        match self.fabric.at(position[0], position[1], wo) {
            Place::Ply(hit) => {
                let mut ply_query = self.ply_query(query, &hit);
                ply_query.below = self.layer_below(query, &hit);
                let ply = self.query_model(query, hit.family, hit.yarn).unprepared(&ply_query);
                let mut at = FabricAt { case: Case::Ply(OnPly { ply, frame: surface_frame(hit.frame) }) };
                if let Case::Ply(on) = &mut at.case {
                    // In its place: lobes are large.
                    on.ply.prepare();
                }
                at
            }
            Place::Gap(gap) => {
                let mut near = [None; 4];
                for (slot, hit) in near.iter_mut().zip(&gap.near) {
                    if let Some(hit) = hit {
                        let ply =
                            self.query_model(query, hit.family, hit.yarn).uncached_at(&self.ply_query(query, hit));
                        *slot = Some(Near::new(ply, surface_frame(hit.frame)));
                    }
                }
                let [west, east, south, north] = gap.aperture_um;
                let (x, y) = (self.spectrum(west, east), self.spectrum(south, north));
                let through = GapBsdf::new(x, y, wo, query.lambda_um);
                FabricAt { case: Case::Gap(InGap::new(near, through, self.gaps, turn)) }
            }
        }
    }

    /// The layer of the yarn below a ply, where there is one and its model has layer factors.
    fn layer_below<const N: usize>(&self, query: &FabricQuery<'_, N>, hit: &PlyHit) -> Option<Layer<N>> {
        let below = hit.below?;
        let family = hit.family.other();
        self.query_model(query, family, below.yarn).layer(below.theta_i, self.query_sigma(query, family, below.yarn))
    }

    fn ply_query<'a, const N: usize>(&self, query: &FabricQuery<'a, N>, hit: &PlyHit) -> PlyQuery<'a, N> {
        let sigma_per_um = self.query_sigma(query, hit.family, hit.yarn);
        PlyQuery {
            instance: self.noise.then(|| self.instance(hit)),
            ..PlyQuery::new(hit.theta_i, hit.h_um, sigma_per_um, query.lambda_um)
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

/// The entry of a yarn in a list that repeats; 0 for an empty one.
#[inline]
fn repeated(list: &[u32], yarn: i32) -> u32 {
    match list {
        [one] => *one,
        _ => list.get(yarn.rem_euclid(list.len().max(1) as i32) as usize).copied().unwrap_or(0),
    }
}

/// The ply that a line meets, and its frame in the surface's.
#[derive(Clone, Copy, Debug)]
struct OnPly<'a, const N: usize> {
    ply: PlyBsdf<'a, N>,
    frame: [[f32; 3]; 3],
}

/// One of the cases of 7.1. It lives on the stack of one query: a box would allocate.
#[derive(Clone, Copy, Debug)]
enum Case<'a, const N: usize> {
    Ply(OnPly<'a, N>),
    Gap(InGap<'a, N>),
}

/// A fabric at a query, for N wavelengths; of a ply the lobes are interpolated once.
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
        matches!(&self.case, Case::Ply(on) if on.ply.is_double())
    }
}

impl<const N: usize> Bsdf<N> for FabricAt<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        match &self.case {
            Case::Ply(OnPly { ply, frame }) => ply.eval(to_ply(frame, w)),
            Case::Gap(gap) => gap.eval(w),
        }
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        match &self.case {
            Case::Ply(OnPly { ply, frame }) => ply.pdf(to_ply(frame, w)),
            Case::Gap(gap) => gap.pdf(w),
        }
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        match &self.case {
            Case::Ply(OnPly { ply, frame }) => ply.eval_pdf(to_ply(frame, w)),
            Case::Gap(gap) => gap.eval_pdf(w),
        }
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match &self.case {
            Case::Ply(OnPly { ply, frame }) => match ply.sample(u) {
                BsdfSample::Scattered(s) => BsdfSample::Scattered(DirectionSample { w: to_fabric(frame, s.w), ..s }),
                other => other,
            },
            Case::Gap(gap) => gap.sample(u),
        }
    }

    /// The light that comes back or through.
    fn albedo(&self) -> [f32; N] {
        match &self.case {
            Case::Ply(on) => on.ply.albedo(),
            Case::Gap(gap) => gap.albedo(),
        }
    }

    fn straight(&self) -> [f32; N] {
        match &self.case {
            Case::Ply(on) => on.ply.straight(),
            Case::Gap(gap) => Bsdf::straight(gap),
        }
    }

    fn outcomes(&self) -> Outcomes {
        match &self.case {
            Case::Ply(on) => on.ply.outcomes(),
            Case::Gap(gap) => gap.outcomes(),
        }
    }
}
