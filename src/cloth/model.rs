//! The cloth as a surface that scatters light (Yu 2025, 7.1): the plies that a line hits, the light that
//! passes them all, and the light between plies.
//!
//! As for a [`crate::FabricModel`], the query's `wo` is the direction to the viewer, and f(wi) holds the
//! cosine at the surface.

use super::lines::{ClothLines, LineHit, LineHits};
use super::shade::{ClothShade, ClothShadows, PassesPlies, exit, is_own};
use super::{ClothCurves, ClothData, ClothSpec, ClothYarn, Lattice};
use crate::color::AlbedoCurve;
use crate::fabric::at::{FabricBsdf, NearPly, Passes, to_pattern};
use crate::fabric::between::{BetweenAt, CLASSES_A_KIND, Escaped, InterYarn, Paths, SIGMA_PER_UM, SIGMAS, Scattered};
use crate::fabric::color_of::{self, Sheet};
use crate::fabric::dye::{Dye, own_color, shares_of};
use crate::fabric::far::{self, Far, FarAt, FarData, Mixed, Places, Runs, Seen};
use crate::fabric::hit::{MAX_NEAR, position, unit};
use crate::fabric::shade::Shade;
use crate::fabric::shadow::Toward;
use crate::fabric::{Channels, ColorOf, FabricOptions, FabricQuery, YarnColor};
use crate::math::vec3::{cross, dot};
use crate::ply::{Lobes, PlyOn};
use crate::spec::YarnSpec;
use crate::spec::rules::invalid;
use crate::speckle::Instance;
use crate::{Bsdf, PlyModel, PlyQuery, Result};
use std::path::Path;
use std::sync::Arc;

/// Share of a line that is not followed further.
const MIN_CAUGHT: f32 = 1e-3;
/// Share of a line below which a ply's light is that of the ply before it.
const MIN_OWN: f32 = 0.05;
/// Largest difference of a model's radius from its curve's, over it.
const MAX_OFF: f64 = 0.02;
/// Lines start this far above the plies [um].
const MARGIN_UM: f32 = 1.0;

/// A surface of cloth.
pub trait ClothSurface: Sync {
    /// The surface at a query.
    fn surface_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N>;
}

impl ClothSurface for crate::FabricModel {
    fn surface_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N> {
        self.at(query)
    }
}

impl ClothSurface for ClothModel {
    fn surface_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N> {
        self.at(query)
    }
}

/// A cloth of curves, ready for shading.
#[derive(Clone, Debug)]
pub struct ClothModel {
    laid: Laid,
    /// Brightness of the cloth over absorption under a sky all round.
    curve: AlbedoCurve,
    /// By kind, the color of each yarn of one repeat of its stripes.
    threads: [Vec<u32>; 2],
    /// `[color]`: the absorption that gives yarns the color.
    dyes: Vec<Dye>,
    options: FabricOptions,
    shadows: ClothShadows,
    between: InterYarn,
    /// The mean over the cell, and by kind the share of each color.
    far: Option<Arc<Far>>,
    color_shares: [Vec<(u32, f32)>; 2],
}

/// The curves of a cloth with the models of their plies.
#[derive(Clone, Debug)]
pub(crate) struct Laid {
    pub lines: ClothLines,
    pub lattice: Lattice,
    yarns: Vec<ClothYarn>,
    /// Yarn of each curve, and its kind.
    of_curve: Vec<u32>,
    kind_of: Vec<usize>,
    /// Kinds of yarns, 1 or 2, and how they run.
    pub kinds: usize,
    pub runs: [Runs; 2],
    /// By kind, of single lines.
    pub models: Vec<Arc<PlyModel>>,
    /// Radius of the models' plies over that of the curves, by kind.
    scale: Vec<f32>,
    /// Length of a ply with the same patterns, 2 w0 [um].
    grain_um: f32,
}

impl Laid {
    /// Curves and the model of each kind of yarn, in single lines.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for models whose plies are not those of the curves, and as
    /// [`ClothLines::new`].
    pub fn new(curves: &ClothCurves, models: &[Arc<PlyModel>]) -> Result<Laid> {
        let lines = ClothLines::new(curves)?;
        let lattice = curves.lattice("cloth")?;
        let kinds = curves.yarns.iter().map(|y| y.kind as usize + 1).max().unwrap_or(1);
        if models.len() != kinds || kinds > 2 {
            let hint = format!("give {kinds}, one for each kind of yarn");
            return Err(invalid("cloth", "model", format!("{} models", models.len()), hint));
        }
        let kind_of: Vec<usize> = curves.curves.iter().map(|c| curves.yarns[c.yarn as usize].kind as usize).collect();
        let (mut scale, mut grain_um) = (Vec::new(), 0.0);
        for (kind, model) in models.iter().enumerate() {
            let ply = YarnSpec::parse(&model.data().spec_text, "model (its spec)")?;
            let of_curve = curves.curves.iter().zip(&kind_of).find(|(_, k)| **k == kind).map(|(c, _)| c.radius_um);
            let [a, b] = ply.ply_radii_um();
            let radius_um = of_curve.unwrap_or(a);
            if ply.yarn.plies > 1 || [a, b].iter().any(|r| (r / radius_um - 1.0).abs() > MAX_OFF) {
                let value = format!("{a:.2}, of a yarn of {}", ply.yarn.plies);
                let hint = format!("the plies of this cloth have {radius_um:.2}; use a model of one such ply");
                return Err(invalid("cloth", "ply.radius_um (of the model)", value, hint));
            }
            scale.push((a / radius_um) as f32);
            grain_um = (2.0 * ply.beam.beam().w0_um) as f32;
        }
        let runs = [0, 1].map(|kind| {
            let yarn = curves.yarns.iter().find(|y| y.kind == kind);
            let way = yarn.map_or([1.0, 0.0], |y| lattice.vector(y.period));
            if way[1].abs() > way[0].abs() { Runs::AlongY } else { Runs::AlongX }
        });
        Ok(Laid {
            lines,
            lattice,
            yarns: curves.yarns.clone(),
            of_curve: curves.curves.iter().map(|c| c.yarn).collect(),
            kind_of,
            kinds,
            runs,
            models: models.to_vec(),
            scale,
            grain_um,
        })
    }
}

/// Latitude of a hit's direction w = -d, and its offset in the units of the model.
#[inline]
fn incidence(hit: &LineHit, d: [f32; 3], scale: f32) -> (f32, f32) {
    ((-dot(d, hit.tangent)).clamp(-1.0, 1.0).asin(), scale * hit.h_um)
}

/// Axes of the ply's frame at a hit of a line in direction `d`.
#[inline]
fn frame(hit: &LineHit, d: [f32; 3]) -> [[f32; 3]; 3] {
    let z = hit.tangent;
    let along = dot(d, z);
    let mut y: [f32; 3] = std::array::from_fn(|k| along * z[k] - d[k]);
    let mut length2 = dot(y, y);
    if length2 < 1e-8 {
        // Along the ply: any axis across it.
        let e = if z[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        y = cross(z, e);
        length2 = dot(y, y);
    }
    let per = 1.0 / length2.sqrt();
    let y = y.map(|v| v * per);
    [cross(y, z), y, z]
}

/// About which share of a line passes a ply.
#[inline]
fn passes(model: &PlyModel, scale: f32, hit: &LineHit, d: [f32; 3]) -> f32 {
    let (theta_i, h_um) = incidence(hit, d, scale);
    let off = 0.05 * hit.radius_um;
    model.passed_lines().map_or(1.0, |passed| passed.mean(theta_i, h_um - off, h_um + off))
}

impl PassesPlies for Laid {
    fn passes(&self, hit: &LineHit, d: [f32; 3]) -> f32 {
        let kind = self.kind_of[hit.curve as usize];
        passes(&self.models[kind], self.scale[kind], hit, d)
    }

    fn r_d(&self, hit: &LineHit, d: [f32; 3]) -> f32 {
        let kind = self.kind_of[hit.curve as usize];
        let (theta_i, h_um) = incidence(hit, d, self.scale[kind]);
        self.models[kind].r_d(theta_i, h_um)
    }
}

/// Class of the ply that a line hits as the `depth`-th, and whether it hits another behind it.
#[inline]
fn class(kind: usize, depth: usize, follows: bool) -> usize {
    CLASSES_A_KIND * kind + 2 * usize::from(depth > 0) + usize::from(follows)
}

/// Start of the line that comes from direction `a` through a point of the middle plane [um].
#[inline]
fn start(lines: &ClothLines, at: [f32; 2], a: [f32; 3]) -> [f32; 3] {
    let way = (lines.half_thickness_um() + MARGIN_UM) / a[2].abs().max(1e-4);
    [at[0] + way * a[0], at[1] + way * a[1], way * a[2]]
}

/// Shadows of a cloth, while the light between its plies is found.
pub(crate) struct ClothPaths<'a> {
    pub laid: &'a Laid,
    pub shadows: &'a ClothShadows,
}

impl Paths for ClothPaths<'_> {
    fn place(&self, fractions: [f64; 2]) -> [f32; 2] {
        let [a, b] = self.laid.lattice.cell_um;
        let [s, t] = fractions;
        [(s * a[0] + t * b[0]) as f32, (s * a[1] + t * b[1]) as f32]
    }

    fn path(&self, a: [f32; 3], at: [f32; 2], is_followed: bool, number: &mut dyn FnMut() -> f32) -> Option<Escaped> {
        let Laid { lines, kind_of, models, scale, .. } = self.laid;
        let mut d = a.map(|v| -v);
        let mut from = start(lines, at, a);
        let mut own = None;
        let mut hits = LineHits::default();
        let mut gone = Escaped::new();
        loop {
            lines.hits_while(from, d, &mut hits, |hit| self.laid.passes(hit, d));
            // The first ply that catches the line.
            let caught =
                hits.as_slice().iter().enumerate().find(|(_, hit)| {
                    own.is_none_or(|own| !is_own(lines, hit, own)) && number() >= self.laid.r_d(hit, d)
                });
            let Some((depth, hit)) = caught else {
                gone.up = d[2] * a[2] > 0.0;
                return Some(gone);
            };
            let kind = kind_of[hit.curve as usize];
            let (theta_i, h_um) = incidence(hit, d, scale[kind]);
            let frame = frame(hit, d);
            let (radius, z) = (hit.radius_um, hit.tangent);
            let shade = ClothShade::new(self.shadows, hit, a, [true; 2]);
            let first = if gone.orders == 0 {
                Some((class(kind, depth, depth + 1 < hits.as_slice().len()), Shade::Curves(shade)))
            } else {
                None
            };
            let ply = Scattered {
                model: &models[kind],
                theta_i,
                h_um,
                radius_um: radius * scale[kind],
                frame,
                slit: None,
                kind,
            };
            let (t, s) = gone.scatter(&ply, first, (a, is_followed), &mut d, number)?;
            if !is_followed {
                return Some(gone);
            }
            let x = cross(d, z);
            let across = -t * radius / dot(x, x).sqrt().max(1e-6);
            let center: [f32; 3] = std::array::from_fn(|i| from[i] + hit.center_um[i]);
            let inner = std::array::from_fn(|i| center[i] + across * x[i] + s * radius * z[i]);
            own = Some((hit.curve, hit.cells, hit.parameter));
            from = exit(center, z, radius, inner, d);
            if gone.is_over() {
                return None;
            }
        }
    }
}

impl ClothModel {
    /// Reads a cloth file.
    ///
    /// # Errors
    /// As [`ClothData::load`].
    pub fn load(path: impl AsRef<Path>, options: &FabricOptions) -> Result<ClothModel> {
        ClothModel::from_data(ClothData::load(path)?, options)
    }

    /// A cloth from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// As [`ClothData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str, options: &FabricOptions) -> Result<ClothModel> {
        ClothModel::from_data(ClothData::from_bytes(bytes, name)?, options)
    }

    /// Of the contents of a cloth file. Nothing is traced.
    ///
    /// # Errors
    /// Those of the spec and of the models in it.
    pub fn from_data(data: ClothData, options: &FabricOptions) -> Result<ClothModel> {
        let spec = ClothSpec::parse(&data.spec_text, "cloth (its spec)")?;
        let laid = Laid::new(&data.curves, &data.models)?;
        let runs = laid.runs;
        let metals = laid.models.iter().map(|m| own_color(m)).collect::<Result<Vec<_>>>()?;
        let yarns = spec.yarns();
        let colors: Vec<YarnColor> = (0..laid.kinds)
            .map(|kind| {
                let yarn = yarns.get(kind).or(yarns.first());
                match (options.sigma_per_um, yarn.and_then(|y| y.srgb), yarn.and_then(|y| y.sigma_per_um)) {
                    (Some(sigma), ..) => YarnColor::Sigma(sigma),
                    (_, Some(srgb), _) => YarnColor::Srgb(srgb.map(|v| v as f32)),
                    (_, _, Some(sigma)) => YarnColor::Sigma(sigma as f32),
                    _ => YarnColor::Undyed,
                }
            })
            .collect();
        let threads = [vec![0], vec![laid.kinds as u32 - 1]];
        let curve = data.between.curve();
        let dyes = colors
            .iter()
            .zip(&metals)
            .map(|(color, metal)| match metal {
                Some(metal) if *color == YarnColor::Undyed => Dye::of_metal(metal, &curve),
                _ => Dye::new(*color, &curve),
            })
            .collect();
        Ok(ClothModel {
            curve,
            laid,
            color_shares: shares_of(&threads),
            threads,
            dyes,
            options: *options,
            shadows: data.shadows,
            between: data.between,
            far: data.far.filter(|_| options.far).map(|far| Arc::new(Far::of(FarData { runs, ..far }))),
        })
    }

    /// The plies that lines hit.
    pub fn lines(&self) -> &ClothLines {
        &self.laid.lines
    }

    /// Two vectors of the plane after which the cloth repeats [um].
    pub fn cell_um(&self) -> [[f64; 2]; 2] {
        self.laid.lattice.cell_um
    }

    /// Bytes of memory, the models apart.
    pub fn memory_bytes(&self) -> usize {
        size_of::<ClothModel>()
            + self.laid.lines.memory_bytes()
            + self.shadows.memory_bytes()
            + self.between.memory_bytes()
            + self.far.as_ref().map_or(0, |far| far.memory_bytes())
    }

    /// Brightness of the cloth over the absorption of its fibers, in the meaning of its colors.
    pub fn color_curve(&self) -> &AlbedoCurve {
        &self.curve
    }

    /// As [`ClothModel::color_curve`], in another meaning.
    pub fn color_curve_of(&self, of: ColorOf) -> AlbedoCurve {
        if of == ColorOf::EvenSky {
            return self.curve.clone();
        }
        let rays = ClothModel { options: FabricOptions::RAYS, far: None, ..self.clone() };
        color_of::curve(&rays, of, &self.curve)
    }

    /// Number of the yarn of a curve's image.
    #[inline]
    fn yarn(&self, hit: &LineHit, cell: [i32; 2]) -> (usize, i32) {
        let yarn = &self.laid.yarns[self.laid.of_curve[hit.curve as usize] as usize];
        let [i, j] = [0, 1].map(|k| hit.cells[k].wrapping_add(cell[k]));
        let number = yarn.number.wrapping_add(yarn.step[0].wrapping_mul(i)).wrapping_add(yarn.step[1].wrapping_mul(j));
        (yarn.kind as usize, number)
    }

    #[inline]
    fn sigma<const N: usize>(&self, query: &FabricQuery<'_, N>, kind: usize, number: i32) -> [f32; N] {
        if let Some(sigma) = query.sigma_per_um[kind] {
            return sigma;
        }
        let threads = &self.threads[kind];
        let color = match threads.as_slice() {
            [one] => *one,
            _ => threads[number.rem_euclid(threads.len() as i32) as usize],
        };
        self.dyes[color as usize].at(query.lambda_um, query.channels)
    }

    /// A point of the plane in the cell at the origin, and its cell.
    #[inline]
    fn in_cell(&self, [x, y]: [f32; 2]) -> ([f32; 2], [i32; 2]) {
        let (x, y) = (f64::from(x), f64::from(y));
        let cell = self.laid.lattice.fractions(x, y).map(|f| f.floor());
        let [a, b] = self.laid.lattice.cell_um;
        let at = [x - cell[0] * a[0] - cell[1] * b[0], y - cell[0] * a[1] - cell[1] * b[1]];
        (at.map(|v| v as f32), cell.map(|c| c as i32))
    }

    /// The cloth at a query.
    pub fn at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N> {
        let turned = query.turn_rad != 0.0 && query.turn_rad.is_finite();
        let turn = if turned { [query.turn_rad.cos(), query.turn_rad.sin()] } else { [1.0, 0.0] };
        let ([x, y], mut wo) = (query.position_um, unit(query.wo));
        let mut at_um = position(x, y);
        if turned {
            let p = to_pattern(turn, [at_um[0], at_um[1], 0.0]);
            (at_um, wo) = ([p[0], p[1]], to_pattern(turn, wo));
        }
        let mut at = FabricBsdf {
            main: None,
            others: [const { None }; MAX_NEAR],
            passes: Passes::Straight,
            passing: 1.0,
            between: BetweenAt::none(wo),
            chances: [0.0; 3],
            turn,
            is_double: false,
            aperture: None,
            far: self.far_at(query, wo),
        };
        if at.far_share() >= 1.0 {
            at.passing = 0.0;
            return at;
        }
        let (at_um, cell) = self.in_cell(at_um);
        let d = wo.map(|v| -v);
        let mut hits = LineHits::default();
        let passes = |hit: &LineHit| {
            let kind = self.laid.yarns[self.laid.of_curve[hit.curve as usize] as usize].kind as usize;
            passes(query.models[kind].unwrap_or(&self.laid.models[kind]), self.laid.scale[kind], hit, d)
        };
        self.laid.lines.hits_while(start(&self.laid.lines, at_um, wo), d, &mut hits, passes);
        let hits = hits.as_slice();
        let mut firsts = [(0, [0.0; N]); MAX_NEAR + 1];
        let mut count = 0;
        let mut sigmas: [Option<[f32; N]>; 2] = [None; 2];
        for (depth, hit) in hits.iter().enumerate() {
            let (kind, number) = self.yarn(hit, cell);
            let sigma_per_um = self.sigma(query, kind, number);
            sigmas[kind].get_or_insert(sigma_per_um);
            let model: &'a PlyModel = query.models[kind].unwrap_or(&self.laid.models[kind]);
            let (theta_i, h_um) = incidence(hit, d, self.laid.scale[kind]);
            let ply_query = PlyQuery {
                instance: self.options.noise.then(|| self.instance(hit, number)),
                ..PlyQuery::new(theta_i, h_um, sigma_per_um, query.lambda_um)
            };
            let class = class(kind, depth, depth + 1 < hits.len());
            let arrives = at.passing;
            let r_d = if at.main.is_none() {
                at.is_double = hits.iter().any(|h| self.yarn(h, cell).0 != kind);
                let ply = self.near_ply((hit, class), model.unprepared(&ply_query).into_ply(), arrives, wo);
                // In its place: lobes are large.
                let main = at.main.insert(ply);
                main.ply.prepare();
                let r_d = main.energies();
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
                let r_d = ply.energies();
                if arrives * (1.0 - r_d) < MIN_CAUGHT {
                    at.passing *= r_d;
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
        if count > 0 {
            let sigma = [0, 1].map(|kind| sigmas[kind].unwrap_or_else(|| self.sigma(query, kind, 0)));
            at.between = self.between.at(wo, &firsts[..count], sigma, self.sent());
        }
        if let Some(main) = &at.main
            && self.options.edges
            && main.ply.model.has_edge()
        {
            at.passes = Passes::Edge;
        }
        at.set_chances();
        at
    }

    /// Factors on what first plies send up and down.
    fn sent(&self) -> [f32; 2] {
        [self.options.shadowing, self.options.layers].map(|on| f32::from(u8::from(on)))
    }

    /// A ply that the line hits, of light of which the share `arrives` comes to it.
    fn near_ply<'a, L: Lobes<N>, const N: usize>(
        &'a self,
        (hit, class): (&LineHit, usize),
        ply: PlyOn<'a, L, N>,
        arrives: f32,
        wo: [f32; 3],
    ) -> NearPly<'a, L, N> {
        let counts = [self.options.shadowing, self.options.layers];
        let scale = self.laid.scale[class / CLASSES_A_KIND];
        NearPly {
            frame: frame(hit, wo.map(|v| -v)),
            shade: Shade::Curves(ClothShade::new(&self.shadows, hit, wo, counts)),
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

    /// The patterns of a place on a ply.
    fn instance(&self, hit: &LineHit, number: i32) -> Instance {
        let ply = (number as u32).wrapping_mul(64).wrapping_add(hit.curve);
        Instance::new(ply, [hit.parameter * hit.speed_um, hit.h_um], self.laid.grain_um)
    }

    /// The mean over the cell where a query asks for it, seen from `wo` in the pattern's frame, and its
    /// share.
    fn far_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>, wo: [f32; 3]) -> Option<(FarAt<'a, N>, f32)> {
        let far = self.far.as_deref().filter(|_| query.models.iter().all(Option::is_none))?;
        let longest = self.laid.lattice.cell_um.map(|v| v[0].hypot(v[1])).into_iter().fold(0.0, f64::max) as f32;
        let t = (2.0 * query.footprint_um / longest - 1.0).clamp(0.0, 1.0);
        let share = t * t * (3.0 - 2.0 * t);
        // Not a number is no footprint.
        if !(share > 0.0 && crate::frame::is_direction(wo)) {
            return None;
        }
        let mut sigma = [Mixed::NONE; 2];
        for (k, sigma) in sigma.iter_mut().enumerate() {
            match query.sigma_per_um[k] {
                Some(own) => sigma.add(1.0, own),
                None => self.color_shares[k].iter().for_each(|(color, share)| {
                    sigma.add(*share, self.dyes[*color as usize].at(query.lambda_um, query.channels));
                }),
            }
        }
        let plies = far.at(wo, [&sigma[0], &sigma[1]]);
        let firsts: [(usize, [f32; N]); 2 * CLASSES_A_KIND] = std::array::from_fn(|class| (class, plies.first[class]));
        let between = self.between.at(wo, &firsts, sigma.map(|s| s.sigma()), self.sent());
        let (passing, _) = far.passing(wo);
        Some((FarAt::new(plies, between, passing, [None; far::APERTURES]), share))
    }
}

impl Sheet for ClothModel {
    fn repeat_um(&self) -> [f64; 2] {
        // Places are even over a part of the plane that is large beside this.
        let [a, b] = self.laid.lattice.cell_um;
        [0, 1].map(|k| a[k].abs().max(b[k].abs()))
    }

    fn sample<const N: usize>(
        &self,
        position_um: [f32; 2],
        wo: [f32; 3],
        sigma_per_um: [f32; N],
        u: [f32; 3],
    ) -> ([f32; N], Option<crate::bsdf::DirectionSample<N>>) {
        let query =
            FabricQuery { sigma_per_um: [Some(sigma_per_um); 2], ..FabricQuery::new(position_um, wo, [0.55; N]) };
        let at = self.at(&query);
        (at.straight(), at.sample(u).direction().copied())
    }
}

impl Places for ClothModel {
    fn kinds(&self) -> (usize, [Runs; 2]) {
        (self.laid.kinds, self.laid.runs)
    }

    fn seen(&self, kind: usize, place: [f64; 2], _: f64, wo: [f32; 3], lights: &[Toward]) -> Seen {
        let [a, b] = self.laid.lattice.cell_um;
        let at = [0, 1].map(|k| (place[0] * a[k] + place[1] * b[k]) as f32);
        let query = FabricQuery {
            sigma_per_um: [Some(SIGMA_PER_UM); 2],
            channels: Channels::Wavelengths,
            ..FabricQuery::new(at, wo, [0.55; SIGMAS])
        };
        let at = self.at(&query);
        let (f, first) = at.of_kind(kind, lights);
        Seen { f, first, passing: at.passing, aperture: at.aperture }
    }
}
