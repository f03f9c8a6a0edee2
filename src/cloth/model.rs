//! The cloth as a surface that scatters light (Yu 2025, 7.1): the model of a whole cloth, and the BSDF at a
//! query.
//!
//! A line from the viewer is traced through the ply curves. The BSDF at the query is the sum of the light of
//! the plies that the line hits, the light that passes all of them, and inter-yarn scattering.
//!
//! The camera ray plays the part of the paper's incident beam: the query's `wo` is the direction towards the
//! viewer. f(wi) is an energy density per steradian of the direction `wi` towards the light and includes the
//! cosine at the surface: `radiance towards wo = integral f(wi) radiance from wi d wi`. Averaged over the
//! cell, f divided by that cosine is symmetric in wo and wi up to the asymmetry of the ply models, and energy
//! is conserved either way (docs/explain/papers/yu_2025.md: departures from 7.1).

use crate::cloth::bsdf::{ClothBsdf, MAX_NEAR, NearPly, Passes};
use crate::cloth::color::color_of::Brightness;
use crate::cloth::color::dye::{ColorReach, own_color};
use crate::cloth::color::yarn_colors::Dyes;
use crate::cloth::geometry::lines::{ClothLines, LineHit, LineHits};
use crate::cloth::geometry::plies::{ClothPlies, frame, passes, start};
use crate::cloth::geometry::uneven::Uneven;
use crate::cloth::light::far::{self, Far, FarAt, Mixed};
use crate::cloth::light::far_grid::FarData;
use crate::cloth::light::gaps::ClothGaps;
use crate::cloth::light::hair_field::HairsHere;
use crate::cloth::light::hair_layer::{HairLayer, HairsAt};
use crate::cloth::light::inter_yarn::{CLASSES, CLASSES_A_KIND, InterYarn, PLY_CLASSES, class, class_of_hairs};
use crate::cloth::light::lit_places::{RatiosOfPlies, angle_of};
use crate::cloth::query::{ClothOptions, ClothQuery, GapLight, in_pattern};
use crate::cloth::shade::shadows::{ClothShade, ClothShadows};
use crate::cloth::shade::splines;
use crate::cloth::yarn_look::Slits;
use crate::cloth::{Channels, ClothData, ColorOf, YarnColor};
use crate::color::AlbedoCurve;
use crate::gap::{Opening, Slit};
use crate::io::Document;
use crate::math::simd::atan2;
use crate::optics::Reflections;
use crate::ply::PlyPlace;
use crate::ply::{Prepared, UncachedPly};
use crate::spec::{GaussianBeam, YarnSpec};
use crate::{PlyModel, PlyQuery, Result};
use multiversion::multiversion;
use std::path::Path;
use std::sync::Arc;

/// Weight of a line below which it is not followed further, and below which a ply contributes no lobes.
const MIN_CAUGHT: f32 = 1e-3;
/// Weight of a line below which a ply gets no lobes of its own: its energy is added to the ply before it.
const MIN_OWN: f32 = 0.05;

/// A cloth of ply curves with its tables, prepared for shading.
#[derive(Clone, Debug)]
pub struct ClothModel {
    pub(crate) plies: ClothPlies,
    /// Brightness of the cloth as a function of absorption, in the sense that `color_of` names.
    pub(crate) curve: AlbedoCurve,
    pub(crate) brightness: Brightness,
    pub(crate) color_of: ColorOf,
    /// `[kind]`: reflections of opaque (metal) fibers, `None` for fibers that transmit light; and the colors
    /// of the yarns. Both entries are equal for a cloth with one kind of yarn.
    pub(crate) metals: [Option<Reflections>; 2],
    pub(crate) colors: [Vec<YarnColor>; 2],
    pub(crate) dyes: Dyes,
    pub(crate) options: ClothOptions,
    pub(crate) shadows: ClothShadows,
    pub(crate) inter_yarn: InterYarn,
    /// Hair layers of the face and of the back; `None` for a cloth without hairs.
    pub(crate) hairs: Option<Arc<HairLayer>>,
    /// `[kind]`: slits between the fibers; `None` if no light passes through any.
    pub(crate) slits: [Option<Slit>; 2],
    /// Apertures that diffract the light through the gaps; `None` if that light goes straight on.
    pub(crate) gaps: Option<Arc<ClothGaps>>,
    /// Tables of the mean BSDF over the cell; `None` unless the file has them and the options request them.
    pub(crate) far: Option<Arc<Far>>,
    pub(crate) uneven: Arc<Uneven>,
}

impl ClothModel {
    /// Reads a cloth file.
    ///
    /// # Errors
    /// As [`ClothData::load`].
    pub fn load(path: impl AsRef<Path>, options: &ClothOptions) -> Result<ClothModel> {
        ClothModel::from_data(ClothData::load(path)?, options)
    }

    /// A cloth from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// As [`ClothData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str, options: &ClothOptions) -> Result<ClothModel> {
        ClothModel::from_data(ClothData::from_bytes(bytes, name)?, options)
    }

    /// Builds the model from the contents of a cloth file; nothing is traced.
    ///
    /// # Errors
    /// The errors of the looks of the yarns and of the models in it.
    pub fn from_data(data: ClothData, options: &ClothOptions) -> Result<ClothModel> {
        let plies = ClothPlies::new(&data.curves, &data.models)?;
        let runs = plies.runs;
        let beams = plies
            .models
            .iter()
            .map(|model| Ok(YarnSpec::parse(&model.data().spec_text, "model (its spec)")?.beam.beam()));
        let beams: Vec<GaussianBeam> = beams.collect::<Result<_>>()?;
        let gaps = match options.gaps {
            GapLight::Diffracted => Some(Arc::new(ClothGaps::new(&data.curves, &plies.lattice, &beams[0])?)),
            GapLight::Straight => None,
        };
        let curve = data.brightness.curve(data.color_of);
        let kind = |kind: usize| kind.min(plies.kinds - 1);
        let colors = [0, 1].map(|k| {
            let look = data.looks.get(kind(k));
            let sigma = options.sigma_per_um.map(|sigma| vec![YarnColor::Sigma(sigma)]);
            sigma.or(look.map(|look| look.colors.clone())).unwrap_or(vec![YarnColor::Undyed])
        });
        let slit = |k: usize| match options.slits_or(data.looks.get(kind(k)).and_then(|look| look.slits)) {
            Some(Slits { width_um, share }) => Slit::new(width_um, share, &beams[kind(k)]).map(Some),
            None => Ok(None),
        };
        let slits = [slit(0)?, slit(1)?];
        let uneven = Uneven::new(&data.looks, &data.curves, &plies.lattice)?;
        let hairs = data.hairs.filter(|_| options.shadowing && options.layers).map(Arc::new);
        let far = data.far.filter(|_| options.far).map(|far| Far::new(FarData { runs, ..far }, hairs.as_deref()));
        let metals = [own_color(&plies.models[0])?, own_color(&plies.models[kind(1)])?];
        Ok(ClothModel {
            dyes: Dyes::new(&colors, &metals, &curve),
            curve,
            color_of: data.color_of,
            brightness: data.brightness,
            metals,
            colors,
            plies,
            options: *options,
            shadows: data.shadows,
            inter_yarn: data.inter_yarn.along(runs),
            hairs,
            slits,
            gaps,
            uneven: Arc::new(if options.uneven { uneven } else { Uneven::default() }),
            far: far.map(Arc::new),
        })
    }

    /// Returns the cloth with its colors interpreted as colors in the sense of `of`.
    fn interpret_colors_as(mut self, of: ColorOf) -> ClothModel {
        self.curve = self.color_curve_of(of);
        self.color_of = of;
        self.dyes = Dyes::new(&self.colors, &self.metals, &self.curve);
        self
    }

    /// Returns the cloth with other colors for its two kinds of yarns, in the sense of `of`. A cloth with one
    /// kind of yarn uses the first color.
    #[must_use]
    pub fn with_colors(&self, colors: [YarnColor; 2], of: ColorOf) -> ClothModel {
        let mut other = self.clone();
        other.colors = [0, 1].map(|kind: usize| vec![colors[kind.min(self.kinds() - 1)]]);
        other.interpret_colors_as(of)
    }

    /// The distinct sRGB colors of the yarns, each with the color that the cloth attains.
    pub fn colors(&self) -> Vec<ColorReach> {
        let mut colors: Vec<[f32; 3]> = Vec::new();
        for color in self.colors.iter().flatten() {
            if let YarnColor::Srgb(srgb) = *color
                && !colors.contains(&srgb)
            {
                colors.push(srgb);
            }
        }
        colors.into_iter().map(|srgb| ColorReach::from_srgb(srgb, &self.curve)).collect()
    }

    /// Number of kinds of yarns: 2 (warp and weft) for a woven cloth, 1 otherwise.
    pub fn kinds(&self) -> usize {
        self.plies.kinds
    }

    /// The ply model of a kind of yarn, [in single lines](PlyModel::of_lines); `None` if the cloth has no
    /// such kind.
    pub fn model_of(&self, kind: usize) -> Option<&PlyModel> {
        self.plies.models.get(kind).map(Arc::as_ref)
    }

    /// Whether queries with a footprint use the mean over the cell: the file has it and the options request
    /// it.
    pub fn has_far(&self) -> bool {
        self.far.is_some()
    }

    /// Maps a point of the cloth's plane [um] to the point of the even cloth that appears there. The map is
    /// the identity unless the spec makes yarns uneven.
    pub fn even_place(&self, at_um: [f32; 2]) -> [f32; 2] {
        self.uneven.place(at_um)
    }

    /// The curves of the plies, prepared for intersection with lines.
    pub fn lines(&self) -> &ClothLines {
        &self.plies.lines
    }

    /// The two vectors of the plane by which the cloth repeats [um].
    pub fn cell_um(&self) -> [[f64; 2]; 2] {
        self.plies.lattice.cell_um
    }

    /// Memory in bytes, without the ply models.
    pub fn memory_bytes(&self) -> usize {
        size_of::<ClothModel>()
            + self.plies.lines.memory_bytes()
            + self.shadows.memory_bytes()
            + self.inter_yarn.memory_bytes()
            + self.hairs.as_ref().map_or(0, |hairs| hairs.memory_bytes())
            + self.far.as_ref().map_or(0, |far| far.memory_bytes())
            + self.gaps.as_ref().map_or(0, |gaps| gaps.memory_bytes())
            + self.dyes.memory_bytes()
    }

    /// The curves of the plies together with their ply models.
    pub fn plies(&self) -> &ClothPlies {
        &self.plies
    }

    /// As [`ClothModel::color_curve`], for colors in the sense of `of`.
    pub fn color_curve_of(&self, of: ColorOf) -> AlbedoCurve {
        self.brightness.curve(of)
    }

    /// Brightness of the cloth as a function of the absorption of its fibers, in the sense of its own colors.
    pub fn color_curve(&self) -> &AlbedoCurve {
        &self.curve
    }

    /// The sense in which the colors of the yarns are meant.
    pub fn color_of(&self) -> ColorOf {
        self.color_of
    }

    /// Absorptions [1/um] with which the cloth has these reflectances, 0 to 1, per wavelength or per linear
    /// RGB channel: the inverse of [`ClothModel::color_curve`]. Reflectances out of range are clamped to
    /// clear or black fibers. Hosts convert a texture once.
    pub fn sigma_of_reflectance<const N: usize>(&self, reflectance: [f32; N]) -> [f32; N] {
        reflectance.map(|r| self.curve.sigma(f64::from(r)).0 as f32)
    }

    /// Absorption [1/um] of the yarn with this kind and number, numbered as in the curves, at wavelengths
    /// [um].
    pub fn yarn_sigma_per_um<const N: usize>(&self, kind: usize, number: i32, lambda_um: [f32; N]) -> [f32; N] {
        self.dyes.of(kind.min(self.plies.kinds - 1), number).at(lambda_um, Channels::Wavelengths)
    }

    /// Absorptions of a kind of yarn: the query's own, or those of the mean color of its yarns.
    #[inline(always)]
    fn sigma<const N: usize>(&self, query: &ClothQuery<'_, N>, kind: usize) -> [f32; N] {
        let kind = kind.min(self.plies.kinds - 1);
        query.sigma_per_um[kind].unwrap_or_else(|| self.dyes.mean(kind).at(query.lambda_um, query.channels))
    }

    /// Moves a point of the plane into the cell at the origin; returns the point and the cell it came from.
    #[inline(always)]
    fn in_cell(&self, [x, y]: [f32; 2]) -> ([f32; 2], [i32; 2]) {
        let (x, y) = (f64::from(x), f64::from(y));
        let cell = self.plies.lattice.fractions(x, y).map(|f| f.floor());
        let [a, b] = self.plies.lattice.cell_um;
        let at = [x - cell[0] * a[0] - cell[1] * b[0], y - cell[0] * a[1] - cell[1] * b[1]];
        (at.map(|v| v as f32), cell.map(|c| c as i32))
    }

    /// Evaluates the cloth at a query: traces the line and prepares the BSDF.
    #[inline(always)]
    pub fn at<'a, const N: usize>(&'a self, query: &ClothQuery<'a, N>) -> ClothBsdf<'a, N> {
        // The result is filled in place because it is too large to move.
        let mut at = ClothBsdf::empty();
        fill(self, query, &mut at);
        at
    }

    /// Factors on the light that first plies send up and down: 1, or 0 where an option excludes it.
    #[inline(always)]
    fn sent_factors(&self) -> [f32; 2] {
        [self.options.shadowing, self.options.layers].map(|on| f32::from(u8::from(on)))
    }

    /// Prepares a ply that the line hits; `arrives` is the share of the beam that reaches it.
    #[inline(always)]
    fn near_ply<'a, const N: usize>(
        &'a self,
        (hit, class): (&LineHit, usize),
        ply: UncachedPly<'a, N>,
        arrives: f32,
        wo: [f32; 3],
    ) -> NearPly<'a, N> {
        let counts = [self.options.shadowing, self.options.layers];
        let scale = self.plies.scale[class / CLASSES_A_KIND];
        NearPly {
            frame: frame(hit, [-wo[0], -wo[1], -wo[2]]),
            shade: ClothShade::new(&self.shadows, hit, wo, counts),
            exits: ply.model.exits_at(ply.query.theta_i, ply.query.h_um, hit.radius_um * scale),
            ply,
            class,
            arrives,
            caught: 0.0,
            energy: [0.0; N],
            hit_chance: 0.0,
            chance: 0.0,
        }
    }

    /// Number of the yarn that a line hits; `cell` is the cell that the query's point was moved from.
    #[inline(always)]
    fn number(&self, hit: &LineHit, cell: [i32; 2]) -> i32 {
        let yarn = &self.plies.yarns[self.plies.of_curve[hit.curve as usize] as usize];
        let [i, j] = [0, 1].map(|k| hit.cells[k].wrapping_add(cell[k]));
        yarn.number.wrapping_add(yarn.step[0].wrapping_mul(i)).wrapping_add(yarn.step[1].wrapping_mul(j))
    }

    /// Position on the ply where the line towards the viewer `wo` leaves it, for relief and speckle.
    #[inline(always)]
    fn place(&self, hit: &LineHit, cell: [i32; 2], wo: [f32; 3], footprint_um: f32) -> PlyPlace {
        let ply = (self.number(hit, cell) as u32).wrapping_mul(64).wrapping_add(hit.curve);
        // Azimuth of the viewer about the axis, from the direction towards the face of the cloth; it includes
        // the twist.
        let [x, y, z] = hit.tangent;
        let (up, across) = (wo[2] - z * (wo[0] * x + wo[1] * y + wo[2] * z), y * wo[0] - x * wo[1]);
        let azimuth = atan2::<false>(across, up) - self.plies.twist[hit.curve as usize] * hit.parameter;
        let [step, a, b] = self.plies.along_um[hit.curve as usize];
        let [i, j] = [0, 1].map(|k| hit.cells[k].wrapping_add(cell[k]) as f32);
        PlyPlace { ply, azimuth, along_um: step * hit.parameter + (a * i + b * j), footprint_um }
    }
}

/// Energies times a factor.
#[inline(always)]
fn scaled<const N: usize>(energy: &[f32; N], by: f32) -> [f32; N] {
    let mut all = *energy;
    for energy in &mut all {
        *energy *= by;
    }
    all
}

/// The mean over the cell, seen from the viewer `wo` in the pattern's frame, and its weight in the
/// answer; `None` if the query does not use it.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn far_at<'a, const N: usize>(
    of: &'a ClothModel,
    query: &ClothQuery<'a, N>,
    wo: [f32; 3],
) -> Option<(FarAt<'a, N>, f32)> {
    let far = of.far.as_deref()?;
    let longest = of.lines().cell().0.map(|v| v[0].hypot(v[1])).into_iter().fold(0.0, f32::max);
    let share = far::share(query, wo, f64::from(longest))?;
    let mut sigma = [Mixed::NONE; 2];
    for (k, sigma) in sigma.iter_mut().enumerate() {
        let kind = k.min(of.plies.kinds - 1);
        match query.sigma_per_um[kind] {
            Some(own) => sigma.add(1.0, own),
            None => of.dyes.each(kind, |dye, share| sigma.add(share, dye.at(query.lambda_um, query.channels))),
        }
    }
    let (mut plies, mut passing, openings) = far.at(wo, [&sigma[0], &sigma[1]]);
    let sigma_per_um = sigma.map(|s| s.sigma());
    let mut firsts: [(usize, [f32; N]); CLASSES] = std::array::from_fn(|class| (class, plies.first[class]));
    let hairs = of.hairs.as_deref().map(|layer| {
        let free = layer.passes(wo);
        firsts.iter_mut().for_each(|(_, energy)| *energy = energy.map(|e| free * e));
        let hairs = HairsAt::new((layer, None), wo, sigma_per_um, free * passing);
        passing *= free * hairs.passes_behind();
        for (kind, [before, behind]) in hairs.energies().into_iter().enumerate() {
            firsts[class_of_hairs(kind, false)].1 = before;
            firsts[class_of_hairs(kind, true)].1 = behind;
        }
        hairs
    });
    let inter_yarn = of.inter_yarn.at(wo, &firsts, sigma_per_um, of.sent_factors());
    plies.conserve([0, 1].map(|kind| {
        let of_plies = &firsts[CLASSES_A_KIND * kind..][..PLY_CLASSES];
        std::array::from_fn(|k| of_plies.iter().map(|(_, e)| e[k]).sum::<f32>() - inter_yarn.caught_of_plies[kind][k])
    }));
    let first = std::array::from_fn(|k| firsts.iter().map(|(_, energy)| energy[k]).sum());
    let through =
        |opening: Option<Opening>| Some(of.gaps.as_deref()?.apertures().through(opening?, wo, query.lambda_um));
    Some((FarAt::new(plies, inter_yarn, (passing, openings.map(through)), hairs, first), share))
}

/// Traces the line of a query and prepares its parts.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn fill<'a, const N: usize>(of: &'a ClothModel, query: &ClothQuery<'a, N>, at: &mut ClothBsdf<'a, N>) {
    let (turn, at_um, wo) = in_pattern(query);
    at.turn = turn;
    if of.far.is_some() && at.is_far(far_at(of, query, wo)) {
        return;
    }
    let even_um = of.uneven.place(at_um);
    let (at_um, cell) = of.in_cell(even_um);
    let d = [-wo[0], -wo[1], -wo[2]];
    let mut hits = LineHits::default();
    let passes = |hit: &LineHit| {
        let kind = of.plies.kind_of[hit.curve as usize];
        passes(query.models[kind].unwrap_or(&of.plies.models[kind]), of.plies.scale[kind], hit)
    };
    of.plies.lines.hits_while(start(&of.plies.lines, at_um, wo), d, &mut hits, passes);
    let hits = hits.as_slice();
    let mut sigma_per_um = [of.sigma(query, 0), of.sigma(query, 1)];
    // Kinds with several colors of which no yarn has been hit so far; they use the mean color.
    let is_mean_of = |kind: usize| of.dyes.several(kind) && query.sigma_per_um[kind].is_none();
    let mut is_mean = [is_mean_of(0), is_mean_of(1)];
    let mut firsts = [(0, [0.0; N]); MAX_NEAR + 5];
    let mut count = 0;
    let is_uneven = !of.inter_yarn.places.is_even();
    let mut ratios = RatiosOfPlies::default();
    let hairs = of.hairs.as_deref();
    let hairs = hairs.map(|layer| {
        let here = |field| HairsHere::new(field, even_um, query.footprint_um);
        (layer, layer.field.as_ref().map(here))
    });
    if let Some((layer, here)) = &hairs {
        at.passing = 1.0 - layer.seen(usize::from(wo[2] < 0.0), wo, here.as_ref());
    }
    let first = hits.first().map_or(0, |hit| of.plies.kind_of[hit.curve as usize]);
    at.is_double = hits.iter().any(|h| of.plies.kind_of[h.curve as usize] != first);
    for (depth, hit) in hits.iter().enumerate() {
        let kind = of.plies.kind_of[hit.curve as usize];
        let model: &'a PlyModel = query.models[kind].unwrap_or(&of.plies.models[kind]);
        let (theta_i, h_um) = (hit.theta_i, of.plies.scale[kind] * hit.h_um);
        let mut sigma = sigma_per_um[kind];
        if query.sigma_per_um[kind].is_none() && of.dyes.several(kind) {
            sigma = of.dyes.of(kind, of.number(hit, cell)).at(query.lambda_um, query.channels);
            if std::mem::take(&mut is_mean[kind]) {
                sigma_per_um[kind] = sigma;
            }
        }
        let ply_query = PlyQuery {
            place: (of.options.relief || of.options.noise).then(|| of.place(hit, cell, wo, query.footprint_um)),
            relief: of.options.relief,
            speckle: of.options.noise,
            slit: of.slits[kind].as_ref().filter(|_| !at.is_double),
            ..PlyQuery::new(theta_i, h_um, sigma, query.lambda_um)
        };
        let class = class(kind, depth, depth + 1 < hits.len());
        let arrives = at.passing;
        let lit_at = |ply: &NearPly<'a, N>| of.inter_yarn.places.at(ply.shade.tables(), angle_of(hit, ply.frame[1]));
        let r_d = if at.main.is_none() {
            let main = at.main.insert(of.near_ply((hit, class), model.uncached_at(&ply_query), arrives, wo));
            main.ply.prepare_into(&mut at.prepared);
            if of.options.noise {
                at.speckle = main.ply.speckle();
            }
            let r_d = main.energies(&at.prepared);
            firsts[count] = (class, scaled(&main.energy, arrives));
            if is_uneven {
                ratios.add(arrives * (1.0 - r_d), &lit_at(main));
            }
            count += 1;
            r_d
        } else {
            let free_slot = at.others.iter().position(Option::is_none);
            let Some(slot) = free_slot.filter(|free_slot| *free_slot == 0 || arrives > MIN_OWN) else {
                // The table of lobes is full or the weight is small: the ply before this one scatters its
                // energy.
                let r_d = model.r_d(theta_i, h_um);
                if let Some(last) = &mut at.others[free_slot.unwrap_or(MAX_NEAR) - 1] {
                    let more = 1.0 + arrives * (1.0 - r_d) / (last.arrives * last.caught).max(MIN_CAUGHT);
                    last.arrives *= more;
                    firsts[count - 1].1.iter_mut().for_each(|energy| *energy *= more);
                }
                at.passing *= r_d;
                if at.passing < MIN_CAUGHT {
                    break;
                }
                continue;
            };
            let mut ply = of.near_ply((hit, class), model.uncached_at(&ply_query), arrives, wo);
            let r_d = ply.energies(&Prepared::NOTHING);
            // Energy that a rim intercepts below this threshold counts as passing.
            if arrives * (1.0 - r_d) < MIN_CAUGHT {
                continue;
            }
            ply.caught = 1.0 - r_d;
            let ply = at.others[slot].insert(ply);
            firsts[count] = (class, scaled(&ply.energy, arrives));
            if is_uneven {
                ratios.add(arrives * (1.0 - r_d), &lit_at(ply));
            }
            count += 1;
            r_d
        };
        at.passing *= r_d;
        if at.passing < MIN_CAUGHT {
            break;
        }
    }
    // Hairs have the color of the yarn below them.
    if let Some(hairs) = hairs {
        let hairs = at.hairs.insert(HairsAt::new(hairs, wo, sigma_per_um, at.passing));
        at.passing *= hairs.passes_behind();
        for (kind, energies) in hairs.energies().into_iter().enumerate() {
            for (is_behind, energy) in [false, true].into_iter().zip(energies) {
                firsts[count] = (class_of_hairs(kind, is_behind), energy);
                count += 1;
            }
        }
    }
    if count > 0 {
        let splines = splines::At::new(wo);
        of.inter_yarn.at_into((wo, &splines), &firsts[..count], sigma_per_um, of.sent_factors(), &mut at.inter_yarn);
        if is_uneven {
            let (deviations, share) = ratios.deviations(&of.inter_yarn.places.mean_at(wo, &splines), 1.0 - at.passing);
            at.inter_yarn.set_place(&of.inter_yarn, (&deviations, share), sigma_per_um[first]);
        }
    }
    at.passes = match (&at.main, &of.gaps) {
        (Some(main), _) if of.options.edges && main.ply.model.has_edge() => Passes::Edge,
        (None, Some(gaps)) => at.passes_gap(gaps.at(&of.plies.lines, at_um, wo, query.lambda_um)),
        _ => Passes::Straight,
    };
    at.set_chances();
}
