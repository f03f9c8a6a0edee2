//! The cloth as a surface that scatters light (Yu 2025, 7.1): the plies that a line hits, the light that
//! passes them all, and the light between plies.
//!
//! The camera ray plays the beam: the query's `wo` is the direction to the viewer, and f(wi), an energy
//! density per steradian of the light's direction `wi`, holds the cosine at the surface: `radiance to wo =
//! integral f(wi) radiance from wi d wi`. Averaged over the cell, f over that cosine is symmetric in wo and
//! wi up to the ply models' own asymmetry, and energy is conserved either way (docs/explain/papers.md:
//! departures from 7.1).

use super::between::{CLASSES, CLASSES_A_KIND, InterYarn, PLY_CLASSES, class, class_of_hairs};
use super::bsdf::{ClothBsdf, MAX_NEAR, NearPly, Passes};
use super::color_of::of_nodes;
use super::dye::{ColorReach, own_color};
use super::far::{self, Far, FarAt, FarData, Mixed};
use super::gap::ClothGaps;
use super::hair_layer::{HairLayer, HairsAt};
use super::lines::{ClothLines, LineHit, LineHits};
use super::plies::{ClothPlies, frame, passes, start};
use super::query::{ClothOptions, ClothQuery, GapLight, Slits, in_pattern};
use super::shade::{ClothShade, ClothShadows};
use super::uneven::Uneven;
use super::yarn_colors::Dyes;
use super::{Channels, ClothData, ClothSpec, ColorOf, YarnColor};
use crate::color::AlbedoCurve;
use crate::fiber::Reflections;
use crate::gap::{Opening, Slit};
use crate::ply::PlyPlace;
use crate::ply::{Prepared, UncachedPly};
use crate::spec::{GaussianBeam, YarnSpec};
use crate::{PlyModel, PlyQuery, Result};
use std::path::Path;
use std::sync::Arc;

/// Share of a line that is not followed further.
const MIN_CAUGHT: f32 = 1e-3;
/// Share of a line below which a ply's light is that of the ply before it.
const MIN_OWN: f32 = 0.05;

/// A cloth of curves, ready for shading.
#[derive(Clone, Debug)]
pub struct ClothModel {
    pub(super) plies: ClothPlies,
    /// Brightness of the cloth over absorption, and what it is the brightness of.
    pub(super) curve: AlbedoCurve,
    /// The curve under a sky all round.
    pub(super) even_sky: AlbedoCurve,
    pub(super) color_of: ColorOf,
    /// By kind, what the reflections of its fibers absorb, if they are opaque, and the colors of its yarns.
    /// Of a single kind twice.
    pub(super) metals: [Option<Reflections>; 2],
    pub(super) colors: [Vec<YarnColor>; 2],
    pub(super) dyes: Dyes,
    pub(super) options: ClothOptions,
    pub(super) shadows: ClothShadows,
    pub(super) between: InterYarn,
    /// Of both sides; none without hairs.
    pub(super) hairs: Option<Arc<HairLayer>>,
    /// By kind.
    pub(super) slits: [Option<Slit>; 2],
    /// Of diffracted light.
    pub(super) gaps: Option<Arc<ClothGaps>>,
    /// The mean over the cell.
    pub(super) far: Option<Arc<Far>>,
    pub(super) uneven: Arc<Uneven>,
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

    /// Of the contents of a cloth file. Nothing is traced, but for colors of another light than a sky all
    /// round: that takes tenths of a second.
    ///
    /// # Errors
    /// Those of the spec and of the models in it.
    pub fn from_data(data: ClothData, options: &ClothOptions) -> Result<ClothModel> {
        let spec = ClothSpec::parse(&data.spec_text, "cloth (its spec)")?;
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
        let curve = of_nodes(&data.albedo);
        let yarns = spec.yarns();
        let kind = |kind: usize| kind.min(plies.kinds - 1);
        let colors = [0, 1].map(|k| {
            let yarn = yarns.get(kind(k)).or(yarns.first());
            match (options.sigma_per_um, yarn.and_then(|y| y.srgb), yarn.and_then(|y| y.sigma_per_um)) {
                (Some(sigma), ..) => vec![YarnColor::Sigma(sigma)],
                (_, Some(srgb), _) => vec![YarnColor::Srgb(srgb.map(|v| v as f32))],
                (_, _, Some(sigma)) => vec![YarnColor::Sigma(sigma as f32)],
                _ if data.colors[kind(k)].is_empty() => vec![YarnColor::Undyed],
                _ => data.colors[kind(k)].iter().map(|srgb| YarnColor::Srgb(*srgb)).collect(),
            }
        });
        let slit = |k: usize| {
            let yarn = yarns.get(kind(k)).or(yarns.first());
            match options.slits_or(yarn.and_then(|yarn| yarn.slits())) {
                Some(Slits { width_um, share }) => Slit::new(width_um, share, &beams[kind(k)]).map(Some),
                None => Ok(None),
            }
        };
        let slits = [slit(0)?, slit(1)?];
        let uneven = Uneven::new(&spec, &data.curves, &plies.lattice)?;
        let hairs = data.hairs.filter(|_| options.shadowing && options.layers).map(Arc::new);
        let far = data.far.filter(|_| options.far).map(|far| Far::new(FarData { runs, ..far }, hairs.as_deref()));
        let metals = [own_color(&plies.models[0])?, own_color(&plies.models[kind(1)])?];
        let cloth = ClothModel {
            dyes: Dyes::new(&colors, &metals, &curve),
            even_sky: curve.clone(),
            curve,
            color_of: ColorOf::EvenSky,
            metals,
            colors,
            plies,
            options: *options,
            shadows: data.shadows,
            between: InterYarn { runs, ..data.between },
            hairs,
            slits,
            gaps,
            uneven: Arc::new(if options.uneven { uneven } else { Uneven::default() }),
            far: far.map(Arc::new),
        };
        Ok(match spec.color_of {
            ColorOf::EvenSky => cloth,
            of => cloth.meaning(of),
        })
    }

    /// The same cloth whose colors are colors of `of`.
    fn meaning(mut self, of: ColorOf) -> ClothModel {
        self.curve = self.color_curve_of(of);
        self.color_of = of;
        self.dyes = Dyes::new(&self.colors, &self.metals, &self.curve);
        self
    }

    /// The same cloth with other colors of its kinds of yarns, which are colors of `of`; of a single kind,
    /// the first. Nothing is traced; where `of` was not the cloth's, it takes tenths of a second.
    #[must_use]
    pub fn with_colors(&self, colors: [YarnColor; 2], of: ColorOf) -> ClothModel {
        let mut other = self.clone();
        other.colors = [0, 1].map(|kind: usize| vec![colors[kind.min(self.kinds() - 1)]]);
        other.meaning(of)
    }

    /// Its colors in sRGB, each once, and what becomes of them.
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

    /// Number of kinds of yarns: 2, warp and weft, of a woven cloth, else 1.
    pub fn kinds(&self) -> usize {
        self.plies.kinds
    }

    /// The ply model of a kind of yarn, [in single lines](PlyModel::of_lines); `None` for a kind that it
    /// does not have.
    pub fn model_of(&self, kind: usize) -> Option<&PlyModel> {
        self.plies.models.get(kind).map(Arc::as_ref)
    }

    /// Whether queries with a footprint get the mean over the cell: it is in the file, and the options ask
    /// for it.
    pub fn has_far(&self) -> bool {
        self.far.is_some()
    }

    /// The place of the even cloth that shows at a point of its plane [um]: the point itself, but for yarns
    /// that the spec has as uneven.
    pub fn even_place(&self, at_um: [f32; 2]) -> [f32; 2] {
        self.uneven.place(at_um)
    }

    /// The plies that lines hit.
    pub fn lines(&self) -> &ClothLines {
        &self.plies.lines
    }

    /// Two vectors of the plane after which the cloth repeats [um].
    pub fn cell_um(&self) -> [[f64; 2]; 2] {
        self.plies.lattice.cell_um
    }

    /// Bytes of memory, the models apart.
    pub fn memory_bytes(&self) -> usize {
        size_of::<ClothModel>()
            + self.plies.lines.memory_bytes()
            + self.shadows.memory_bytes()
            + self.between.memory_bytes()
            + self.hairs.as_ref().map_or(0, |hairs| hairs.memory_bytes())
            + self.far.as_ref().map_or(0, |far| far.memory_bytes())
            + self.gaps.as_ref().map_or(0, |gaps| gaps.memory_bytes())
            + self.dyes.memory_bytes()
    }

    /// Brightness of the cloth over the absorption of its fibers, in the meaning of its colors.
    pub fn color_curve(&self) -> &AlbedoCurve {
        &self.curve
    }

    /// What its colors are colors of.
    pub fn color_of(&self) -> ColorOf {
        self.color_of
    }

    /// Absorptions [1/um] with which the cloth has these reflectances, 0 to 1, at wavelengths or in linear
    /// RGB: [`ClothModel::color_curve`] inverted. What is out of reach is clamped to clear or black fibers.
    /// Hosts convert a texture once.
    pub fn sigma_of_reflectance<const N: usize>(&self, reflectance: [f32; N]) -> [f32; N] {
        reflectance.map(|r| self.curve.sigma(f64::from(r)).0 as f32)
    }

    /// Absorption of a yarn [1/um] by its kind and its number, as the curves have them, at wavelengths [um].
    pub fn yarn_sigma_per_um<const N: usize>(&self, kind: usize, number: i32, lambda_um: [f32; N]) -> [f32; N] {
        self.dyes.of(kind.min(self.plies.kinds - 1), number).at(lambda_um, Channels::Wavelengths)
    }

    /// Absorptions of a kind of yarn, or their mean.
    #[inline]
    fn sigma<const N: usize>(&self, query: &ClothQuery<'_, N>, kind: usize) -> [f32; N] {
        let kind = kind.min(self.plies.kinds - 1);
        query.sigma_per_um[kind].unwrap_or_else(|| self.dyes.mean(kind).at(query.lambda_um, query.channels))
    }

    /// A point of the plane in the cell at the origin, and its cell.
    #[inline]
    fn in_cell(&self, [x, y]: [f32; 2]) -> ([f32; 2], [i32; 2]) {
        let (x, y) = (f64::from(x), f64::from(y));
        let cell = self.plies.lattice.fractions(x, y).map(|f| f.floor());
        let [a, b] = self.plies.lattice.cell_um;
        let at = [x - cell[0] * a[0] - cell[1] * b[0], y - cell[0] * a[1] - cell[1] * b[1]];
        (at.map(|v| v as f32), cell.map(|c| c as i32))
    }

    /// The cloth at a query.
    #[inline(always)]
    pub fn at<'a, const N: usize>(&'a self, query: &ClothQuery<'a, N>) -> ClothBsdf<'a, N> {
        // In its place: it is too large to move.
        let mut at = ClothBsdf::empty();
        self.fill(query, &mut at);
        at
    }

    fn fill<'a, const N: usize>(&'a self, query: &ClothQuery<'a, N>, at: &mut ClothBsdf<'a, N>) {
        let (turn, at_um, wo) = in_pattern(query);
        at.turn = turn;
        if at.is_far(self.far_at(query, wo)) {
            return;
        }
        let (at_um, cell) = self.in_cell(self.uneven.place(at_um));
        let d = wo.map(|v| -v);
        let mut hits = LineHits::default();
        let passes = |hit: &LineHit| {
            let kind = self.plies.kind_of[hit.curve as usize];
            passes(query.models[kind].unwrap_or(&self.plies.models[kind]), self.plies.scale[kind], hit)
        };
        self.plies.lines.hits_while(start(&self.plies.lines, at_um, wo), d, &mut hits, passes);
        let hits = hits.as_slice();
        let mut sigma_per_um = [0, 1].map(|kind| self.sigma(query, kind));
        // Kinds whose yarns have several colors and of which none was hit.
        let mut is_mean = [0, 1].map(|kind| self.dyes.several(kind) && query.sigma_per_um[kind].is_none());
        let mut firsts = [(0, [0.0; N]); MAX_NEAR + 5];
        let mut count = 0;
        if let Some(layer) = self.hairs.as_deref() {
            at.passing = layer.passes(wo);
        }
        let first = hits.first().map_or(0, |hit| self.plies.kind_of[hit.curve as usize]);
        at.is_double = hits.iter().any(|h| self.plies.kind_of[h.curve as usize] != first);
        for (depth, hit) in hits.iter().enumerate() {
            let kind = self.plies.kind_of[hit.curve as usize];
            let model: &'a PlyModel = query.models[kind].unwrap_or(&self.plies.models[kind]);
            let (theta_i, h_um) = (hit.theta_i, self.plies.scale[kind] * hit.h_um);
            let mut sigma = sigma_per_um[kind];
            if query.sigma_per_um[kind].is_none() && self.dyes.several(kind) {
                sigma = self.dyes.of(kind, self.number(hit, cell)).at(query.lambda_um, query.channels);
                if std::mem::take(&mut is_mean[kind]) {
                    sigma_per_um[kind] = sigma;
                }
            }
            let ply_query = PlyQuery {
                place: (self.options.relief || self.options.noise)
                    .then(|| self.place(hit, cell, wo, query.footprint_um)),
                relief: self.options.relief,
                speckle: self.options.noise,
                slit: self.slits[kind].as_ref().filter(|_| !at.is_double),
                ..PlyQuery::new(theta_i, h_um, sigma, query.lambda_um)
            };
            let class = class(kind, depth, depth + 1 < hits.len());
            let arrives = at.passing;
            let r_d = if at.main.is_none() {
                let main = at.main.insert(self.near_ply((hit, class), model.uncached_at(&ply_query), arrives, wo));
                main.ply.prepare_into(&mut at.prepared);
                let r_d = main.energies(&at.prepared);
                firsts[count] = (class, main.energy.map(|e| arrives * e));
                count += 1;
                r_d
            } else {
                let room = at.others.iter().position(Option::is_none);
                let Some(slot) = room.filter(|room| *room == 0 || arrives > MIN_OWN) else {
                    // What those beyond these catch, the last of these scatters.
                    let r_d = model.r_d(theta_i, h_um);
                    if let Some(last) = &mut at.others[room.unwrap_or(MAX_NEAR) - 1] {
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
                let mut ply = self.near_ply((hit, class), model.uncached_at(&ply_query), arrives, wo);
                let r_d = ply.energies(&Prepared::NOTHING);
                // Of less than this of the line, what rims catch counts as passing.
                if arrives * (1.0 - r_d) < MIN_CAUGHT {
                    continue;
                }
                ply.caught = 1.0 - r_d;
                let ply = at.others[slot].insert(ply);
                firsts[count] = (class, ply.energy.map(|e| arrives * e));
                count += 1;
                r_d
            };
            at.passing *= r_d;
            if at.passing < MIN_CAUGHT {
                break;
            }
        }
        // Hairs have the color of the yarn below.
        if let Some(layer) = self.hairs.as_deref() {
            let hairs = at.hairs.insert(HairsAt::new(layer, wo, sigma_per_um, at.passing));
            at.passing *= hairs.passes_behind();
            for (kind, energies) in hairs.energies().into_iter().enumerate() {
                for (is_behind, energy) in [false, true].into_iter().zip(energies) {
                    firsts[count] = (class_of_hairs(kind, is_behind), energy);
                    count += 1;
                }
            }
        }
        if count > 0 {
            at.between = self.between.at(wo, &firsts[..count], sigma_per_um, self.sent());
        }
        at.passes = match (&at.main, &self.gaps) {
            (Some(main), _) if self.options.edges && main.ply.model.has_edge() => Passes::Edge,
            (None, Some(gaps)) => at.passes_gap(gaps.at(&self.plies.lines, at_um, wo, query.lambda_um)),
            _ => Passes::Straight,
        };
        at.set_chances();
    }

    /// Factors on what first plies send up and down.
    fn sent(&self) -> [f32; 2] {
        [self.options.shadowing, self.options.layers].map(|on| f32::from(u8::from(on)))
    }

    /// A ply that the line hits, of light of which the share `arrives` comes to it.
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
            frame: frame(hit, wo.map(|v| -v)),
            shade: ClothShade::new(&self.shadows, hit, wo, counts),
            exits: ply.model.exits_at(ply.query.theta_i, ply.query.h_um, hit.radius_um * scale),
            ply,
            class,
            arrives,
            caught: 0.0,
            energy: [0.0; N],
            hit: 0.0,
            chance: 0.0,
        }
    }

    /// Number of the yarn that a line of a cell hits.
    fn number(&self, hit: &LineHit, cell: [i32; 2]) -> i32 {
        let yarn = &self.plies.yarns[self.plies.of_curve[hit.curve as usize] as usize];
        let [i, j] = [0, 1].map(|k| hit.cells[k].wrapping_add(cell[k]));
        yarn.number.wrapping_add(yarn.step[0].wrapping_mul(i)).wrapping_add(yarn.step[1].wrapping_mul(j))
    }

    /// The place on a ply of a cell that a line towards `wo` leaves.
    fn place(&self, hit: &LineHit, cell: [i32; 2], wo: [f32; 3], footprint_um: f32) -> PlyPlace {
        let ply = (self.number(hit, cell) as u32).wrapping_mul(64).wrapping_add(hit.curve);
        // From the axis over the curve, towards the cloth's face.
        let [x, y, z] = hit.tangent;
        let (up, across) = (wo[2] - z * (wo[0] * x + wo[1] * y + wo[2] * z), y * wo[0] - x * wo[1]);
        let azimuth = across.atan2(up) - self.plies.twist[hit.curve as usize] * hit.parameter;
        let [step, a, b] = self.plies.along_um[hit.curve as usize];
        let [i, j] = [0, 1].map(|k| hit.cells[k].wrapping_add(cell[k]) as f32);
        PlyPlace { ply, azimuth, along_um: step * hit.parameter + (a * i + b * j), footprint_um }
    }

    /// The mean over the cell where a query asks for it, seen from `wo` in the pattern's frame, and its
    /// share.
    fn far_at<'a, const N: usize>(&'a self, query: &ClothQuery<'a, N>, wo: [f32; 3]) -> Option<(FarAt<'a, N>, f32)> {
        let far = self.far.as_deref()?;
        let longest = self.lines().cell().0.map(|v| v[0].hypot(v[1])).into_iter().fold(0.0, f32::max);
        let share = far::share(query, wo, f64::from(longest))?;
        let mut sigma = [Mixed::NONE; 2];
        for (k, sigma) in sigma.iter_mut().enumerate() {
            let kind = k.min(self.plies.kinds - 1);
            match query.sigma_per_um[kind] {
                Some(own) => sigma.add(1.0, own),
                None => self.dyes.each(kind, |dye, share| sigma.add(share, dye.at(query.lambda_um, query.channels))),
            }
        }
        let (mut plies, mut passing, openings) = far.at(wo, [&sigma[0], &sigma[1]]);
        let sigma_per_um = sigma.map(|s| s.sigma());
        let mut firsts: [(usize, [f32; N]); CLASSES] = std::array::from_fn(|class| (class, plies.first[class]));
        let hairs = self.hairs.as_deref().map(|layer| {
            let free = layer.passes(wo);
            firsts.iter_mut().for_each(|(_, energy)| *energy = energy.map(|e| free * e));
            let hairs = HairsAt::new(layer, wo, sigma_per_um, free * passing);
            passing *= free * hairs.passes_behind();
            for (kind, [before, behind]) in hairs.energies().into_iter().enumerate() {
                firsts[class_of_hairs(kind, false)].1 = before;
                firsts[class_of_hairs(kind, true)].1 = behind;
            }
            hairs
        });
        let between = self.between.at(wo, &firsts, sigma_per_um, self.sent());
        plies.conserve([0, 1].map(|kind| {
            let of_plies = &firsts[CLASSES_A_KIND * kind..][..PLY_CLASSES];
            std::array::from_fn(|k| of_plies.iter().map(|(_, e)| e[k]).sum::<f32>() - between.caught_of_plies[kind][k])
        }));
        let first = std::array::from_fn(|k| firsts.iter().map(|(_, energy)| energy[k]).sum());
        let through =
            |opening: Option<Opening>| Some(self.gaps.as_deref()?.apertures().through(opening?, wo, query.lambda_um));
        Some((FarAt::new(plies, between, (passing, openings.map(through)), hairs, first), share))
    }
}
