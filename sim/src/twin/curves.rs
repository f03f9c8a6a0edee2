//! The fibers of a twin: every fiber of every ply swept along the curve of the ply.
//!
//! The traced domain is a rectangle of whole cells. A curve and its images form closed loops on it, each with
//! its own packed section. Sections are perpendicular to the curve and rotate with a rotation-minimizing
//! frame (Wang, Juettler, Zheng and Liu, "Computation of rotation minimizing frames", ACM Transactions on
//! Graphics 27, 2008). Relative to that frame, fibers wind by the twist of their spec, adjusted slightly so
//! that they close. The domain contains every piece of a tube that reaches into it.

use super::domain::{Domain, MAX_QUADS, PitchUsed, outline_share};
use super::hair_walls::add_hair;
use super::options::TwinMesh;
use super::rings::{Loop, Path};
use super::sweep::{ClothMesh, ring};
use crate::cloth::{Hair, HairKind, HairRoots};
use crate::error::SimError;
use crate::geometry::outline::Outline;
use crate::geometry::section::PlySection;
use crate::seeds::stream;
use nalgebra::Rotation2;
use plywave::Error;
use plywave::cloth::{ClothCurves, Lattice, PlyCurve};
use plywave::math::vec3::{cross, unit};
use plywave::spec::{Twist, YarnSpec};
use plywave_textile::{Hairs, YarnSet};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// A vector of three.
type V3 = [f64; 3];

/// Relative difference up to which two numbers are those of the same cloth.
const SAME: f64 = 1e-6;
/// Maximum relative difference between the radius of a curve and that of its ply.
const MAX_RADIUS_OFF: f64 = 0.02;
/// Maximum multiple of a cell vector along a side of the minimal rectangle.
const MAX_CELLS: i32 = 512;
/// Maximum number of cells of the minimal rectangle.
const MAX_RECTANGLE: f64 = 4096.0;
/// Minimum number of distinct yarns of a kind in a domain whose size is chosen automatically.
const MIN_YARNS: usize = 4;
/// Maximum side of a domain whose size is chosen automatically [repeats].
const MAX_REPEATS: u32 = 8;
/// Length by which pieces reach beyond the domain [um].
const MARGIN_UM: f64 = 5.0;
/// Maximum number of sections drawn until one fits its ply.
const DRAWS: u32 = 8;

/// A cloth of explicit fibers along curves.
#[derive(Clone, Debug)]
pub struct TwinCurves {
    /// Name of the cloth.
    pub name: String,
    /// Curves of its plies.
    pub curves: ClothCurves,
    /// Specs of the plies, by kind of yarn.
    pub yarns: Vec<YarnSpec>,
    /// Hairs, by kind of yarn; empty for a cloth without hairs.
    hairs: Vec<Option<Hairs>>,
    lattice: Lattice,
    /// The minimal rectangle: two integer combinations of the cell vectors, along x and along y.
    rectangle: [[i32; 2]; 2],
    text: String,
}

/// Contents of a cloth's text, which is JSON.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: String,
    curves: ClothCurves,
    /// Texts of the yarn specs.
    yarns: Vec<String>,
    /// Hairs, by kind of yarn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    hairs: Vec<Option<Hairs>>,
}

/// Serializes a text.
fn written(text: &Text) -> String {
    // Serialization cannot fail for strings, finite numbers and lists.
    serde_json::to_string(text).unwrap_or_default()
}

fn refuse(key: &str, value: String, hint: String) -> SimError {
    Error::Invalid { file: "cloth".into(), key: key.into(), value, hint }.into()
}

/// The shortest integer combination of the cell vectors along an axis.
fn along_axis(lattice: &Lattice, axis: usize) -> Option<[i32; 2]> {
    let scale = lattice.area_um2().sqrt();
    let of = |i: i32, j: i32| lattice.vector([i, j]);
    let mut best: Option<(f64, [i32; 2])> = None;
    for i in -MAX_CELLS..=MAX_CELLS {
        // Multiple of the second vector that minimizes the absolute value of the other coordinate.
        let (a, b) = (of(i, 0)[1 - axis], of(0, 1)[1 - axis]);
        let candidates = if b.abs() > 1e-9 * scale { vec![(-a / b).round() as i32] } else { (-1..=1).collect() };
        for j in candidates.into_iter().filter(|j| j.abs() <= MAX_CELLS) {
            let v = of(i, j);
            if v[1 - axis].abs() < 1e-6 * scale && v[axis] > 1e-6 * scale && best.is_none_or(|(min, _)| v[axis] < min) {
                best = Some((v[axis], [i, j]));
            }
        }
    }
    best.map(|(_, steps)| steps)
}

impl TwinCurves {
    /// A cloth from curves and, by kind of yarn, the text of the spec of its plies.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for a kind without a spec, for plies whose radius is not that of the
    /// curves, and for cells that tile no rectangle; also the errors of the yarn specs.
    pub fn new(name: &str, curves: ClothCurves, specs: Vec<String>) -> Result<TwinCurves, SimError> {
        curves.check("cloth")?;
        let lattice = curves.lattice("cloth")?;
        let yarns = specs.iter().map(|text| YarnSpec::parse(text, "yarn")).collect::<Result<Vec<_>, _>>()?;
        for curve in &curves.curves {
            let kind = curves.yarns[curve.yarn as usize].kind as usize;
            let Some(spec) = yarns.get(kind) else {
                return Err(refuse("yarns", format!("{} specs", yarns.len()), format!("give a spec for kind {kind}")));
            };
            let [a, b] = spec.ply_radii_um();
            if (a - curve.radius_um).abs() > MAX_RADIUS_OFF * a || (b - curve.radius_um).abs() > MAX_RADIUS_OFF * b {
                let hint = format!("plies of {} have radii of {a} and {b} um; use a model of such plies", spec.name);
                return Err(refuse("radius_um", format!("{:.2}", curve.radius_um), hint));
            }
        }
        let (Some(x), Some(y)) = (along_axis(&lattice, 0), along_axis(&lattice, 1)) else {
            let hint = format!("use a cell of which {MAX_CELLS} or fewer make a rectangle along x and y");
            return Err(refuse("cell_um", format!("{:?}", curves.cell_um), hint));
        };
        let cells = [x, y].map(|steps| lattice.vector(steps)).map(|v| v[0].max(v[1])).iter().product::<f64>();
        let cells = cells / lattice.area_um2();
        if cells > MAX_RECTANGLE {
            let hint = format!("use a cell of which {MAX_RECTANGLE} or fewer make a rectangle along x and y");
            return Err(refuse("cell_um", format!("{:?}", curves.cell_um), hint));
        }
        let text = written(&Text { name: name.into(), curves: curves.clone(), yarns: specs, hairs: Vec::new() });
        Ok(TwinCurves { name: name.into(), curves, yarns, hairs: Vec::new(), lattice, rectangle: [x, y], text })
    }

    /// This cloth with the given hairs, by kind of yarn.
    #[must_use]
    pub fn with_hairs(mut self, hairs: Vec<Option<Hairs>>) -> TwinCurves {
        self.hairs = if hairs.iter().any(Option::is_some) { hairs } else { Vec::new() };
        if let Ok(text) = serde_json::from_str::<Text>(&self.text) {
            self.text = written(&Text { hairs: self.hairs.clone(), ..text });
        }
        self
    }

    /// Parses a cloth from its text; `None` for text of another kind.
    ///
    /// # Errors
    /// The errors of [`TwinCurves::new`].
    pub fn parse(text: &str) -> Option<Result<TwinCurves, SimError>> {
        let Text { name, curves, yarns, hairs } = serde_json::from_str(text).ok()?;
        Some(TwinCurves::new(&name, curves, yarns).map(|cloth| cloth.with_hairs(hairs)))
    }

    /// Name of the first property that differs in a cloth of these curves with, by kind of yarn, these texts
    /// of ply specs and these hairs; `None` if the cloths are equal.
    pub fn difference(&self, curves: &ClothCurves, specs: &[String], hairs: &[Option<Hairs>]) -> Option<&'static str> {
        // Numbers may have been rounded in a text.
        let is_near = |a: f64, b: f64| (a - b).abs() <= SAME * (1.0 + a.abs());
        let all_near = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_near(*a, *b));
        if !all_near(self.curves.cell_um.as_flattened(), curves.cell_um.as_flattened()) {
            return Some("cell_um");
        }
        let same = |(a, b): (&PlyCurve, &PlyCurve)| {
            a.yarn == b.yarn
                && a.shift == b.shift
                && is_near(a.radius_um, b.radius_um)
                && all_near(a.control_um.as_flattened(), b.control_um.as_flattened())
        };
        let count = self.curves.curves.len() == curves.curves.len();
        if self.curves.yarns != curves.yarns || !count || !self.curves.curves.iter().zip(&curves.curves).all(same) {
            return Some("curves");
        }
        let others = specs.iter().map(|text| YarnSpec::parse(text, "yarn")).collect::<Result<Vec<_>, _>>();
        let alike = |(a, b): (&YarnSpec, &YarnSpec)| (&a.fiber, &a.ply) == (&b.fiber, &b.ply);
        let plies = others.is_ok_and(|o| o.len() == self.yarns.len() && o.iter().zip(&self.yarns).all(alike));
        if !plies {
            return Some("plies");
        }
        let of = |hairs: &[Option<Hairs>], kind: usize| hairs.get(kind).copied().flatten();
        (0..self.yarns.len()).any(|kind| of(&self.hairs, kind) != of(hairs, kind)).then_some("hairs")
    }

    /// Its text, which has everything that the fibers depend on, except for the seed.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Size of the minimal rectangle along x and y [um].
    pub fn repeat_um(&self) -> [f64; 2] {
        [0, 1].map(|k| self.lattice.vector(self.rectangle[k])[k])
    }

    /// The domain of these repeats. `None` chooses as many as give each kind of yarn [`MIN_YARNS`] distinct
    /// yarns, within [`MAX_REPEATS`] and [`MAX_QUADS`].
    pub(super) fn domain(&self, repeats: Option<[u32; 2]>, mesh: &TwinMesh) -> Domain {
        let of = |repeats: [u32; 2]| {
            let loops = self.loops(repeats);
            let mut yarns = [0; 2];
            for kind in 0..2 {
                let mut all: Vec<u32> = loops.iter().filter(|l| l.kind.min(1) == kind).map(|l| l.yarn).collect();
                all.sort_unstable();
                all.dedup();
                yarns[kind] = all.len() as u32;
            }
            let repeat = self.repeat_um();
            let size_um = [0, 1].map(|k| repeat[k] * f64::from(repeats[k]));
            let pitches = loops.iter().flat_map(|l| self.pitch(l)).fold(Vec::<PitchUsed>::new(), |mut all, pitch| {
                if !all.iter().any(|p| p.family == pitch.family) {
                    all.push(pitch);
                }
                all
            });
            Domain { repeats, size_um, yarns, pitches }
        };
        if let Some(requested) = repeats {
            return of(requested.map(|n| n.max(1)));
        }
        let kinds = 1 + usize::from(self.curves.yarns.iter().any(|yarn| yarn.kind > 0));
        let mut best = of([1, 1]);
        for n in 1..=MAX_REPEATS {
            let domain = of([n, n]);
            if self.estimate(domain.repeats, mesh) > MAX_QUADS {
                break;
            }
            let enough = domain.yarns[..kinds].iter().all(|count| *count as usize >= MIN_YARNS);
            best = domain;
            if enough {
                break;
            }
        }
        best
    }

    /// Traced pitch of a loop's fibers with that of the spec; `None` for fibers without a pitch.
    fn pitch(&self, of: &Loop<'_>) -> Option<PitchUsed> {
        let spec_um = self.yarns[of.kind].ply.fiber_pitch_um?;
        let path = Path::new(&self.lattice, of, &TwinMesh::default(), self.yarns[of.kind].ply.twist());
        let used_um = TAU / path.twist.abs().max(1e-12);
        Some(PitchUsed { family: YarnSet::EACH[of.kind.min(1)], spec_um, used_um })
    }

    /// Position of a combination of cell vectors on the torus of the domain, as two integers for comparison.
    fn place(&self, steps: [i32; 2], size: [f64; 2]) -> [i64; 2] {
        let v = self.lattice.vector(steps);
        [0, 1].map(|k| (((v[k] / size[k] + 1e-7).rem_euclid(1.0)) * 1e6).round() as i64)
    }

    /// Size of a domain [um], and its cells by their positions on the torus.
    fn cells(&self, repeats: [u32; 2]) -> ([f64; 2], BTreeMap<[i64; 2], [i32; 2]>) {
        let repeat = self.repeat_um();
        let size = [0, 1].map(|k| repeat[k] * f64::from(repeats[k]));
        let mut cells = BTreeMap::from([(self.place([0; 2], size), [0; 2])]);
        let mut next = vec![[0i32; 2]];
        while let Some(at) = next.pop() {
            for step in [[1, 0], [0, 1]] {
                let there = [at[0] + step[0], at[1] + step[1]];
                if cells.insert(self.place(there, size), there).is_none() {
                    next.push(there);
                }
            }
        }
        (size, cells)
    }

    /// All hairs of a domain.
    #[cfg(test)]
    pub(super) fn all_hairs(&self, repeats: [u32; 2], seed: u64) -> Vec<Hair> {
        self.hairs(&self.loops(repeats), repeats, seed).unwrap().concat()
    }

    /// Generator of the hairs of the cloth; `None` for a cloth without hairs.
    fn hair_roots(&self) -> Result<Option<HairRoots<'_>>, SimError> {
        if self.hairs.is_empty() {
            return Ok(None);
        }
        let kinds = self.yarns.iter().zip(self.hairs.iter().chain(std::iter::repeat(&None)));
        let kinds = kinds.map(|(spec, hairs)| hairs.map(|hairs| HairKind::new(hairs, spec)));
        HairRoots::new(&self.curves, kinds.collect()).map(Some)
    }

    /// `[loop]`: the hairs of a domain. Each hair is generated once, in a cell of the domain; its periodic
    /// images are copies.
    fn hairs(&self, loops: &[Loop<'_>], repeats: [u32; 2], seed: u64) -> Result<Vec<Vec<Hair>>, SimError> {
        let mut all = vec![Vec::new(); loops.len()];
        let Some(roots) = self.hair_roots()? else { return Ok(all) };
        let (size, cells) = self.cells(repeats);
        let mut of_piece = BTreeMap::new();
        for (number, of) in loops.iter().enumerate() {
            for period in 0..of.periods as i32 {
                let cell = [0, 1].map(|k| of.start[k] + period * of.curve.shift[k]);
                of_piece.insert((of.index, self.place(cell, size)), number);
            }
        }
        let pieces: Vec<_> = (0..self.curves.yarns.len())
            .flat_map(|yarn| cells.iter().map(move |(at, cell)| (yarn, at, cell)))
            .collect();
        let grown: Vec<_> =
            pieces.into_par_iter().map(|(yarn, place, cell)| (place, roots.grow(yarn, *cell, seed))).collect();
        for (place, hairs) in grown {
            for hair in hairs {
                if let Some(number) = of_piece.get(&(hair.curve as usize, *place)) {
                    all[*number].push(hair);
                }
            }
        }
        Ok(all)
    }

    /// The closed loops of a domain.
    fn loops(&self, repeats: [u32; 2]) -> Vec<Loop<'_>> {
        let (size, cells) = self.cells(repeats);
        let plus = |a: [i32; 2], b: [i32; 2]| [a[0] + b[0], a[1] + b[1]];
        let (mut loops, mut yarns) = (Vec::new(), BTreeMap::new());
        for (index, curve) in self.curves.curves.iter().enumerate() {
            let yarn = &self.curves.yarns[curve.yarn as usize];
            let mut visited = BTreeSet::new();
            for (place, start) in &cells {
                if visited.contains(place) {
                    continue;
                }
                let (mut at, mut periods) = (*start, 0);
                loop {
                    visited.insert(self.place(at, size));
                    at = plus(at, curve.shift);
                    periods += 1;
                    if self.place(at, size) == *place {
                        break;
                    }
                }
                // Images along the yarn's period are the same yarn; the smallest position identifies it.
                let mut name = *place;
                let mut image = *start;
                loop {
                    image = plus(image, yarn.period);
                    let there = self.place(image, size);
                    if there == *place {
                        break;
                    }
                    name = name.min(there);
                }
                let count = yarns.len() as u32;
                let number = *yarns.entry((curve.yarn, name)).or_insert(count);
                let color = (0..2).fold(yarn.number, |n, k| n.wrapping_add(yarn.step[k].wrapping_mul(start[k])));
                loops.push(Loop {
                    curve,
                    index,
                    kind: yarn.kind as usize,
                    yarn: number,
                    color,
                    start: *start,
                    periods,
                });
            }
        }
        // The tracer expects the fibers of the first kind first.
        loops.sort_by_key(|l| l.kind.min(1));
        loops
    }

    /// Estimated number of quads, before sections are packed.
    pub(super) fn estimate(&self, repeats: [u32; 2], options: &TwinMesh) -> f64 {
        let of = |l: &Loop<'_>| {
            let spec = &self.yarns[l.kind];
            let length = l.curve.length_um(&self.lattice) * l.periods as f64;
            let turn = spec.ply.twist().rad_per_um().abs() + 0.005;
            let rings = length * (turn / options.turn_rad.max(1e-3)).max(1.0 / options.step_um.max(0.1));
            let shape = spec.fibers().map(|fiber| outline_share(&fiber.shape)).fold(0.0, f64::max);
            rings * f64::from(options.outline_points) * shape * f64::from(spec.ply.fibers)
        };
        let plies: f64 = self.loops(repeats).iter().map(of).sum();
        let area: f64 = self.repeat_um().iter().zip(repeats).map(|(um, n)| um * f64::from(n)).product();
        let longest = self.hairs.iter().flatten().map(|hairs| 1e3 * hairs.length_mm).fold(0.0, f64::max);
        let of_hair = (8.0 + longest / 50.0) * f64::from(options.outline_points);
        let hairs = self.hair_roots().ok().flatten().map_or(0.0, |roots| roots.mean_count(area));
        plies + hairs * of_hair
    }

    /// The quads of a domain.
    ///
    /// # Errors
    /// The errors of packing, such as [`SimError::CannotPack`], and [`SimError::TwinTooLarge`].
    pub(super) fn mesh(&self, domain: &Domain, options: &TwinMesh, seed: u64) -> Result<ClothMesh, SimError> {
        let quads = self.estimate(domain.repeats, options);
        if quads > MAX_QUADS {
            let repeats = domain.repeats.iter().map(|n| u64::from(*n)).product();
            return Err(SimError::TwinTooLarge { repeats, triangles: 2.0 * quads, allowed: 2.0 * MAX_QUADS });
        }
        let loops = self.loops(domain.repeats);
        let hairs = self.hairs(&loops, domain.repeats, seed)?;
        let parts = loops.par_iter().zip(hairs).enumerate().map(|(i, (l, hairs))| {
            let mut part = self.sweep(l, domain, options, seed, i as u32)?;
            hairs.iter().for_each(|hair| add_hair(&mut part, hair, l.thread(i as u32, hair.second), domain, options));
            Ok(part)
        });
        let parts = parts.collect::<Result<Vec<_>, SimError>>()?;
        Ok(ClothMesh::joined(parts))
    }

    /// The quads of one loop.
    fn sweep(
        &self,
        of: &Loop<'_>,
        domain: &Domain,
        options: &TwinMesh,
        seed: u64,
        number: u32,
    ) -> Result<ClothMesh, SimError> {
        let mut rng = stream(seed, [u64::MAX, u64::from(number)]);
        let section = section_of(&self.yarns[of.kind], &mut rng)?;
        let begin: f64 = TAU * rng.random::<f64>();
        let path = Path::new(&self.lattice, of, options, Twist::from_rad_per_um(section.twist_per_um));
        let count = path.count();
        let turn = path.twist.abs() * path.length_um / count as f64;
        let (low, high) = path.bounds();
        let margin = of.curve.radius_um + path.longest_um() + MARGIN_UM;
        let middle = [0.5 * domain.size_um[0], 0.5 * domain.size_um[1], 0.0];
        // Images of the loop that reach into the domain.
        let images = |k: usize| {
            let size = domain.size_um[k];
            let first = ((-margin - high[k]) / size).ceil() as i64;
            first..=((size + margin - low[k]) / size).floor() as i64
        };
        let mut mesh = ClothMesh::default();
        for (fiber, id) in section.fibers.iter().zip(0..) {
            mesh.fibers.push(of.thread(number, fiber.second));
            for (outline, lumen) in std::iter::once((&fiber.outer, 0)).chain(fiber.lumen.as_ref().map(|l| (l, 1))) {
                let ring = ring(fiber, outline, lumen == 1, turn, options);
                let is_round = matches!(outline, Outline::Circle { .. });
                let n = ring.len();
                // Rings -1 to count + 1 are placed, so that rings 0 to count have both neighbors.
                let (mut points, mut around): (Vec<V3>, Vec<V3>) = (Vec::new(), Vec::new());
                for k in 0..count + 3 {
                    let frame = path.frame(k);
                    let angle = Rotation2::new(begin + frame.angle);
                    let center = angle * fiber.center_um;
                    // Rings of circles do not rotate with the fibers, which keeps quads straight.
                    let own = if is_round { Rotation2::new(frame.unwound) } else { angle };
                    let place = |x: f64, y: f64| -> V3 { std::array::from_fn(|i| x * frame.u[i] + y * frame.v[i]) };
                    for (p, normal) in &ring {
                        let (q, m) = (center + own * p, own * normal);
                        let off = place(q.x, q.y);
                        points.push(std::array::from_fn(|i| frame.point[i] + off[i]));
                        // Normals use points of the neighboring rings, since the wall is shorter on the inner
                        // side of a bend.
                        around.push(place(-m.y, m.x));
                    }
                }
                let side = if lumen == 1 { -1.0 } else { 1.0 };
                let normals: Vec<[f32; 3]> = (0..(count + 1) * n)
                    .map(|i| {
                        let along: V3 = std::array::from_fn(|x| points[i + 2 * n][x] - points[i][x]);
                        unit(cross(around[i + n], along)).map(|v| (side * v) as f32)
                    })
                    .collect();
                for a in images(0) {
                    for b in images(1) {
                        let by = [a as f64 * domain.size_um[0], b as f64 * domain.size_um[1], 0.0];
                        let is_near = |k: usize| {
                            let p = path.frame(k + 1).point;
                            (0..2).all(|i| (-margin..=domain.size_um[i] + margin).contains(&(p[i] + by[i])))
                        };
                        let mut last: Option<usize> = None;
                        for k in 0..=count {
                            if !is_near(k) {
                                last = None;
                                continue;
                            }
                            let first = mesh.vertices.len();
                            for i in 0..n {
                                let p = points[(k + 1) * n + i];
                                mesh.vertices.push(std::array::from_fn(|x| (p[x] + by[x] - middle[x]) as f32));
                                mesh.normals.push(normals[k * n + i]);
                            }
                            if let Some(before) = last {
                                for i in 0..n {
                                    let next = (i + 1) % n;
                                    let quad = [before + i, before + next, first + i, first + next];
                                    // The material lies outside of the lumen's ring, so its triangles have
                                    // the opposite orientation.
                                    let [a, b, c, d] = quad.map(|v| v as u32);
                                    mesh.quads.push(if lumen == 1 { [b, a, d, c] } else { [a, b, c, d] });
                                    mesh.wall.push(2 * id + lumen);
                                }
                            }
                            last = Some(first);
                        }
                    }
                }
            }
        }
        Ok(mesh)
    }
}

/// Draws a section. Fibers of varying size are sometimes too thick in total for their ply; they are then
/// drawn again, up to [`DRAWS`] times.
fn section_of(spec: &YarnSpec, rng: &mut Pcg64Mcg) -> Result<PlySection, SimError> {
    let mut drawn = PlySection::generate(spec, rng.random());
    for _ in 1..DRAWS {
        if !matches!(drawn, Err(SimError::CannotPack { .. })) {
            break;
        }
        drawn = PlySection::generate(spec, rng.random());
    }
    drawn
}
