//! Intersection of lines with the plies of a cloth: which plies a line hits, in order.
//!
//! A line walks through the voxels of a grid (`grid.rs`). In each voxel its distance to the chords of the
//! pieces of curve is tested; blocks of pieces with a chord near enough are refined by Newton's method on
//! `(p(u) - x - t w) . p'(u) = 0`, all lanes at once (`nearest.rs`). A chord counts in the voxel in which the
//! line is nearest to it, and a point of a curve counts in the piece that contains it, so each hit is found
//! once.

use crate::Result;
use crate::cloth::ClothCurves;
use crate::cloth::geometry::axis_at::AxisAt;
use crate::cloth::geometry::grid::{CurvePiece, Entry, Grid, LANES, Shape};
use crate::cloth::geometry::nearest::{Found, candidates, refine};
use crate::math::simd::{atan2, max, min};
use crate::math::vec3::{cross, dot};
use arrayvec::ArrayVec;
use multiversion::{multiversion, target::target_cfg_f};

/// Largest number of hits of a line that are stored; the nearest ones are kept.
pub const MAX_HITS: usize = 24;
/// Largest number of voxels that a line walks through; a longer line at grazing incidence counts as escaped.
const MAX_STEPS: usize = 4096;
/// Smallest squared derivative of a curve that defines a tangent [um^2].
const MIN_SPEED2_UM2: f32 = 1e-12;
/// Lower bound on the squared sine of a line's angle to a curve, for the length of its path in the ply; at
/// smaller angles the curve bends away first.
const MIN_SINE2: f32 = 0.01;
/// Weight of a line below which it is not followed further; and distance, in largest radii, beyond the
/// deepest hit over which plies are still searched, so that the next ply behind is found.
const MIN_LEFT: f32 = 3e-4;
const BEYOND: f32 = 3.0;

/// A hit of a line on a ply.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineHit {
    /// Index of the curve.
    pub curve: u32,
    /// Cell of the curve's image, in vectors of the cell.
    pub cells: [i32; 2],
    /// Parameter of the curve at the point nearest to the line.
    pub parameter: f32,
    /// Distance along the line to that point [um].
    pub nearest_um: f32,
    /// Distance along the line to the point at which it enters the ply's surface [um].
    pub enter_um: f32,
    /// Signed distance of the line from the axis [um], positive if the axis lies along `w cross tangent` from
    /// the line.
    pub h_um: f32,
    /// Latitude of the direction that the line comes from, about the tangent [rad].
    pub theta_i: f32,
    /// Unit tangent of the curve.
    pub tangent: [f32; 3],
    /// Point on the axis relative to the line's start [um].
    pub center_um: [f32; 3],
    /// Curvature vector [1/um], perpendicular to the tangent.
    pub bend_per_um: [f32; 3],
    /// Radius of the ply [um].
    pub radius_um: f32,
    /// Length of the curve per unit of its parameter at that point [um].
    pub speed_um: f32,
}

/// Hits of a line, sorted by the distance at which it enters the plies.
#[derive(Clone, Debug, Default)]
pub struct LineHits(ArrayVec<LineHit, MAX_HITS>);

impl LineHits {
    /// The hits, nearest first.
    pub fn as_slice(&self) -> &[LineHit] {
        &self.0
    }

    #[inline(always)]
    fn add(&mut self, hit: LineHit) {
        let behind = self.0.iter().rev().take_while(|other| other.enter_um > hit.enter_um).count();
        let at = self.0.len() - behind;
        if self.0.is_full() {
            if at == MAX_HITS {
                return;
            }
            self.0.pop();
        }
        self.0.insert(at, hit);
    }
}

/// A curve: its control points, preceded by one and followed by two, so that each span has its four.
#[derive(Clone, Debug)]
struct Spline {
    control: Vec<[f32; 3]>,
    radius: f32,
    /// The period, in vectors of the cell.
    shift: [i32; 2],
}

impl Spline {
    /// Point, first and second derivative at a parameter within one period.
    #[inline(always)]
    fn at(&self, u: f32) -> ([f32; 3], [f32; 3], [f32; 3]) {
        let last = self.control.len() - 4;
        let first = min(max(u, 0.0), last as f32) as usize;
        let t = u - first as f32;
        let s = 1.0 - t;
        let p = &self.control[first.min(last)..];
        let w0 = [
            s * s * s / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            t * t * t / 6.0,
        ];
        let w1 = [-0.5 * s * s, 1.5 * t * t - 2.0 * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t];
        let w2 = [s, 3.0 * t - 2.0, 1.0 - 3.0 * t, t];
        let sum = |w: [f32; 4], k: usize| w[0] * p[0][k] + w[1] * p[1][k] + w[2] * p[2][k] + w[3] * p[3][k];
        (std::array::from_fn(|k| sum(w0, k)), std::array::from_fn(|k| sum(w1, k)), std::array::from_fn(|k| sum(w2, k)))
    }
}

/// The curves of a cloth, prepared for intersection with lines.
#[derive(Clone, Debug)]
pub struct ClothLines {
    grid: Grid,
    splines: Vec<Spline>,
    /// Largest radius of a ply [um].
    largest_um: f32,
}

/// The grid of a cloth and its pieces as flat tables.
pub(crate) struct LineTables {
    /// Number of voxels along the vectors of the cell and along z.
    pub counts: [u32; 3],
    /// First entry of each voxel, and the number of entries.
    pub first: Vec<u32>,
    /// Entries of the voxels.
    pub entries: Vec<Entry>,
    /// Curve and 16 numbers of each piece: coefficients `[power of u][axis]`, radius, reach about the chord,
    /// parameter of the curve at u = 0, and its increase to u = 1.
    pub pieces: Vec<(u32, [f32; 16])>,
}

impl ClothLines {
    /// Builds the grid and the splines of a cloth.
    ///
    /// # Errors
    /// As [`ClothCurves::check`], and [`crate::Error::Invalid`] for curves that are millions of radii long.
    pub fn new(cloth: &ClothCurves) -> Result<ClothLines> {
        cloth.check("cloth")?;
        let lattice = cloth.lattice("cloth")?;
        let grid = Grid::new(cloth, &lattice, 0.0)?;
        let splines = cloth.curves.iter().map(|curve| {
            let n = curve.control_um.len();
            let period = lattice.vector(curve.shift);
            let control = (0..n + 3).map(|i| {
                let at = i as i64 - 1;
                let turns = at.div_euclid(n as i64) as f64;
                let p = curve.control_um[at.rem_euclid(n as i64) as usize];
                [(p[0] + turns * period[0]) as f32, (p[1] + turns * period[1]) as f32, p[2] as f32]
            });
            Spline { control: control.collect(), radius: curve.radius_um as f32, shift: curve.shift }
        });
        let thickest = cloth.curves.iter().map(|c| c.radius_um).fold(0.0, f64::max);
        Ok(ClothLines { grid, splines: splines.collect(), largest_um: thickest as f32 })
    }

    /// Height above the middle plane beyond which there is no ply [um].
    pub fn half_thickness_um(&self) -> f32 {
        self.grid.half_thickness_um
    }

    /// Largest radius of a ply [um].
    pub(crate) fn largest_um(&self) -> f32 {
        self.largest_um
    }

    /// Vectors of the grid's cell [um], and these as multiples of the cloth's vectors.
    pub(crate) fn cell(&self) -> ([[f32; 2]; 2], [[i32; 2]; 2]) {
        (self.grid.cell, self.grid.steps)
    }

    /// The grid and its pieces as flat tables.
    pub(crate) fn tables(&self) -> LineTables {
        let (first, entries, shapes) = self.grid.tables();
        let numbers = |(piece, (cubic, reach)): (&CurvePiece, &Shape)| {
            let mut numbers = [0.0; 16];
            numbers[..12].copy_from_slice(cubic.as_flattened());
            let radius = self.radius_um(piece.curve as usize);
            numbers[12..].copy_from_slice(&[radius, *reach, piece.from, piece.to - piece.from]);
            (piece.curve, numbers)
        };
        let pieces = self.grid.pieces.iter().zip(&shapes).map(numbers).collect();
        LineTables { counts: self.grid.counts.map(|n| n as u32), first, entries, pieces }
    }

    /// Number of curves.
    pub fn curves(&self) -> usize {
        self.splines.len()
    }

    /// Number of knots in a curve's period.
    pub fn knots(&self, curve: usize) -> usize {
        self.splines[curve].control.len() - 3
    }

    /// Radius of a curve's ply [um].
    pub fn radius_um(&self, curve: usize) -> f32 {
        self.splines[curve].radius
    }

    /// The axis of a curve's ply at a parameter of its period; the result's `of` is the parameter.
    pub fn axis_at(&self, curve: usize, parameter: f32) -> AxisAt<f32> {
        let spline = &self.splines[curve];
        let (center_um, d, dd) = spline.at(parameter);
        let speed2 = dot(d, d);
        let axis = d.map(|d| d / speed2.sqrt());
        let along = dot(dd, axis);
        let bend_per_um = std::array::from_fn(|k| (dd[k] - along * axis[k]) / speed2);
        AxisAt { center_um, axis, bend_per_um, radius_um: spline.radius, of: parameter }
    }

    /// Length of a curve per unit of its parameter [um].
    pub fn speed_um(&self, curve: usize, parameter: f32) -> f32 {
        let d = self.splines[curve].at(parameter).1;
        dot(d, d).sqrt()
    }

    /// The period of a curve, in vectors of the cell.
    pub fn shift(&self, curve: usize) -> [i32; 2] {
        self.splines[curve].shift
    }

    /// Bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        self.grid.memory_bytes() + self.splines.iter().map(|s| size_of_val(s.control.as_slice())).sum::<usize>()
    }

    /// Finds the plies that the line from `from` [um] in the unit direction `w` hits before it leaves the
    /// cloth, sorted by the distance at which it enters them; `hits` is cleared first. A ply that contains
    /// the start counts if its axis is nearest to the line further on. Values that are not finite never
    /// panic; their hits have no meaning.
    pub fn hits(&self, from: [f32; 3], w: [f32; 3], hits: &mut LineHits) {
        self.hits_while(from, w, hits, |_| 1.0);
    }

    /// As [`ClothLines::hits`], but ends when almost no light remains: `passes` returns the share of the
    /// light that passes a hit's ply. The nearest plies behind that point are still found.
    pub fn hits_while(
        &self,
        from: [f32; 3],
        w: [f32; 3],
        hits: &mut LineHits,
        mut passes: impl FnMut(&LineHit) -> f32,
    ) {
        hits.0.clear();
        visit(self, (&self.grid, 0.0), from, w, |hit| {
            let passed = passes(&hit);
            hits.add(hit);
            passed
        });
    }
}

/// Calls `each` for the plies of a grid within `beside_um` of the line from `from` [um] in the unit direction
/// `w`, voxel by voxel. Ends when the product of the shares that `each` returns is small: almost no light
/// remains.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
pub(crate) fn visit<F: FnMut(LineHit) -> f32>(
    cloth: &ClothLines,
    (grid, beside_um): (&Grid, f32),
    from: [f32; 3],
    w: [f32; 3],
    mut each: F,
) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    // Distances at which the line enters and leaves the slab of the cloth.
    let half = grid.half_thickness_um;
    let per_z = 1.0 / if w[2].abs() < 1e-6 { 1e-6f32.copysign(w[2]) } else { w[2] };
    let [low, high] = [(-half - from[2]) * per_z, (half - from[2]) * per_z];
    let (begin, mut end) = (max(min(low, high), 0.0), max(low, high));
    if end <= begin || !(end.is_finite() && begin.is_finite()) {
        return;
    }
    // Voxel coordinates along the line.
    let counts = grid.counts.map(|n| n as f32);
    let [x, y] = grid.inverse;
    let axes = [[x[0], x[1], 0.0], [y[0], y[1], 0.0], [0.0, 0.0, 0.5 / half]];
    let middle = [0.0, 0.0, 0.5];
    let rate: [f32; 3] = std::array::from_fn(|k| counts[k] * dot(axes[k], w));
    let start: [f32; 3] = std::array::from_fn(|k| counts[k] * (dot(axes[k], from) + middle[k]));
    let mut voxel: [i32; 3] = std::array::from_fn(|k| (start[k] + begin * rate[k]).floor() as i32);
    let top = grid.counts[2] - 1;
    voxel[2] = voxel[2].clamp(0, top);
    // Indices of the voxel in its cell, and the line's start relative to the cell's corner.
    let mut here = [0, 1].map(|k| voxel[k].rem_euclid(grid.counts[k]));
    let mut cell = [0, 1].map(|k| voxel[k].div_euclid(grid.counts[k]));
    let corner = |cell: [i32; 2]| {
        let ([a, b], [i, j]) = (grid.cell, cell.map(|c| c as f32));
        [from[0] - i * a[0] - j * b[0], from[1] - i * a[1] - j * b[1], from[2]]
    };
    let mut origin = corner(cell);
    let step = rate.map(|r| if r < 0.0 { -1 } else { 1 });
    let per_rate = rate.map(|r| if r.abs() < 1e-12 { f32::INFINITY } else { 1.0 / r });
    // Distance to the next border along each axis.
    let border = |voxel: [i32; 3], k: usize| {
        let at = voxel[k].wrapping_add(i32::from(step[k] > 0)) as f32;
        if per_rate[k].is_finite() { (at - start[k]) * per_rate[k] } else { f32::INFINITY }
    };
    let (mut at, mut remaining, last) = (begin, 1.0, end);
    let mut next: [f32; 3] = std::array::from_fn(|k| border(voxel, k));
    // Distance to the nearest point of the deepest hit, and distance beyond which plies are ignored.
    let (mut deepest, mut stop) = (0.0, f32::INFINITY);
    for _ in 0..MAX_STEPS {
        let leave = max(min(min(min(next[0], next[1]), next[2]), end), at);
        // A line within one voxel crosses no border.
        let begin_um = if at == begin { f32::NEG_INFINITY } else { at };
        let end_um = if leave >= last { f32::INFINITY } else { leave };
        for block in grid.of_voxel([here[0], here[1], voxel[2]]) {
            let Some(candidates) = candidates::<FMA>(block, origin, w, [begin_um, end_um]) else { continue };
            let found = refine::<FMA>(block, origin, w, &candidates);
            let mut lanes = 0u32;
            for l in 0..LANES {
                lanes |= (found.counts[l] & 1) << l;
            }
            while lanes != 0 {
                let l = lanes.trailing_zeros() as usize % LANES;
                lanes &= lanes - 1;
                let piece = &grid.pieces[block.piece[l] as usize];
                let radius = cloth.splines[piece.curve as usize].radius;
                let reach = radius + beside_um;
                if found.h2[l] >= reach * reach || found.distance[l] < 0.0 || found.distance[l] > stop {
                    continue;
                }
                let mut hit = hit((piece, radius, reach), &found, l, w);
                let [i, j] = [0, 1].map(|k| cell[k].wrapping_add(block.cells[l][k].into()));
                let along = |k: usize| i.wrapping_mul(grid.steps[0][k]).wrapping_add(j.wrapping_mul(grid.steps[1][k]));
                hit.cells = [0, 1].map(along);
                deepest = max(deepest, hit.nearest_um);
                remaining *= each(hit);
            }
        }
        if remaining < MIN_LEFT && stop == f32::INFINITY {
            // The next plies may be entered before those that were hit.
            stop = deepest + BEYOND * cloth.largest_um;
            end = min(end, stop);
        }
        if leave >= end {
            break;
        }
        let k = if next[2] < min(next[0], next[1]) { 2 } else { usize::from(next[1] < next[0]) };
        // The index wraps for lines that start too far away for a cell index.
        voxel[k] = voxel[k].wrapping_add(step[k]);
        if k == 2 {
            if !(0..=top).contains(&voxel[2]) {
                break;
            }
        } else {
            here[k] += step[k];
            if here[k] < 0 || here[k] == grid.counts[k] {
                here[k] -= step[k] * grid.counts[k];
                cell[k] = cell[k].wrapping_add(step[k]);
                origin = corner(cell);
            }
        }
        next[k] = border(voxel, k);
        at = leave;
    }
}

/// Arc sine [rad].
#[inline(always)]
fn latitude(sine: f32) -> f32 {
    let sine = min(max(sine, -1.0), 1.0);
    atan2::<false>(sine, ((1.0 - sine) * (1.0 + sine)).sqrt())
}

/// Computes the hit of one lane.
#[inline(always)]
fn hit((piece, radius, reach): (&CurvePiece, f32, f32), found: &Found, l: usize, w: [f32; 3]) -> LineHit {
    let lane = |of: &[[f32; LANES]; 3]| [of[0][l], of[1][l], of[2][l]];
    let (mut p, mut d, dd) = (lane(&found.point), lane(&found.d), lane(&found.dd));
    // The values are extrapolated by the last step.
    let step = found.step[l];
    for k in 0..3 {
        p[k] += step * (d[k] + 0.5 * step * dd[k]);
        d[k] += step * dd[k];
    }
    let nearest = dot(p, w);
    let off = [p[0] - nearest * w[0], p[1] - nearest * w[1], p[2] - nearest * w[2]];
    let h2 = min(dot(off, off), reach * reach);
    // A curve of length zero, or one that turns back, has no tangent there; any direction will do.
    let d = if dot(d, d) > MIN_SPEED2_UM2 { d } else { [1.0, 0.0, 0.0] };
    let speed2 = dot(d, d);
    let per = 1.0 / speed2.sqrt();
    let tangent = [d[0] * per, d[1] * per, d[2] * per];
    let across = cross(w, tangent);
    let sine2 = max(dot(across, across), MIN_SINE2);
    let along = dot(dd, tangent);
    let knots = piece.to - piece.from;
    let bend = |k: usize| (dd[k] - along * tangent[k]) / speed2;
    LineHit {
        curve: piece.curve,
        cells: [0; 2],
        parameter: piece.from + found.u[l] * knots,
        nearest_um: nearest,
        enter_um: nearest - (max(radius * radius - h2, 0.0) / sine2).sqrt(),
        h_um: h2.sqrt().copysign(dot(off, across)),
        theta_i: latitude(-dot(w, tangent)),
        tangent,
        center_um: p,
        bend_per_um: [bend(0), bend(1), bend(2)],
        radius_um: radius,
        speed_um: speed2 * per / knots,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::{ClothYarn, Lattice, PlyCurve};
    use crate::math::hash::SplitMix64;
    use std::f64::consts::TAU;

    /// Bent and twisted curves in a sheared cell.
    fn cloth() -> ClothCurves {
        let cell_um = [[160.0, 90.0], [0.0, 240.0]];
        let lattice = Lattice::new(cell_um).unwrap();
        let mut cloth = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
        let mut add = |shift: [i32; 2], from: [f64; 2], height: f64, circle: f64, radius: f64| {
            let index = cloth.yarns.len() as u32;
            cloth.yarns.push(ClothYarn { kind: 0, number: 0, step: [0; 2], period: shift });
            let period = lattice.vector(shift);
            let length = period[0].hypot(period[1]);
            let n = (length / (0.7 * radius)).ceil() as usize;
            let points: Vec<[f64; 3]> = (0..n)
                .map(|i| {
                    let t = i as f64 / n as f64;
                    let (s, c) = (3.0 * TAU * t).sin_cos();
                    let off = circle * c / length;
                    let z = height * (TAU * t).cos() + circle * s;
                    [from[0] + t * period[0] - off * period[1], from[1] + t * period[1] + off * period[0], z]
                })
                .collect();
            cloth.curves.push(PlyCurve::through(index, radius, shift, &points, &lattice));
        };
        add([0, 1], [40.0, 0.0], 50.0, 0.0, 30.0);
        add([0, 2], [120.0, 0.0], -40.0, 25.0, 22.0);
        add([8, -3], [0.0, 70.0], 20.0, 12.0, 18.0);
        add([1, 0], [0.0, 200.0], -30.0, 0.0, 25.0);
        cloth
    }

    /// Finds hits by brute force: minima of the distance over fine samples of all images, refined by
    /// bisection of its slope. Returns curve, distance along the line and distance from it.
    fn brute(cloth: &ClothCurves, from: [f64; 3], w: [f64; 3]) -> Vec<(u32, f64, f64)> {
        let lattice = Lattice::new(cloth.cell_um).unwrap();
        let mut all = Vec::new();
        for (index, curve) in cloth.curves.iter().enumerate() {
            let n = curve.control_um.len();
            let samples = 12 * n;
            for a in -26i32..=26 {
                for b in -26i32..=26 {
                    let by = lattice.vector([a, b]);
                    let off = |u: f64| {
                        let at = curve.at(&lattice, u);
                        let p = [
                            at.point_um[0] + by[0] - from[0],
                            at.point_um[1] + by[1] - from[1],
                            at.point_um[2] - from[2],
                        ];
                        let distance = dot(p, w);
                        let q: [f64; 3] = std::array::from_fn(|k| p[k] - distance * w[k]);
                        (distance, dot(q, q).sqrt(), dot(q, at.d_um))
                    };
                    // Distant images are skipped.
                    let reach = (0..8).map(|i| off(i as f64 * n as f64 / 8.0).1).fold(f64::INFINITY, f64::min);
                    if reach > curve.length_um(&lattice) / 8.0 + curve.radius_um {
                        continue;
                    }
                    for i in 0..samples {
                        let [mut low, mut high] = [i, i + 1].map(|i| i as f64 * n as f64 / samples as f64);
                        if !(off(low).2 < 0.0 && off(high).2 >= 0.0) {
                            continue;
                        }
                        for _ in 0..40 {
                            let middle = 0.5 * (low + high);
                            *(if off(middle).2 < 0.0 { &mut low } else { &mut high }) = middle;
                        }
                        let (distance, h, _) = off(low);
                        if h < curve.radius_um && distance >= 0.0 {
                            all.push((index as u32, distance, h));
                        }
                    }
                }
            }
        }
        all.sort_by(|a, b| a.1.total_cmp(&b.1));
        all
    }

    /// Lines hit the same plies as in the brute-force search, at all tilts, and each ply once.
    #[test]
    fn lines_hit_what_they_hit() {
        let cloth = cloth();
        let lines = ClothLines::new(&cloth).unwrap();
        let half = f64::from(lines.half_thickness_um());
        let mut rng = SplitMix64(5);
        let mut number = || rng.next_f64();
        let mut hits = LineHits::default();
        let (mut total, mut doubtful) = (0, 0);
        for i in 0..160 {
            let z = [1.0, 0.8, 0.5, 0.2, -0.9, -0.4, 0.1, 0.05][i % 8];
            let (sin, cos) = (TAU * number()).sin_cos();
            let across = (1.0f64 - z * z).sqrt();
            let w = [across * cos, across * sin, -z];
            let at = [2000.0 * (number() - 0.5), 2000.0 * (number() - 0.5)];
            // Lines start above or below the cloth; every fifth one starts inside.
            let lift = if i % 5 == 4 { 0.0 } else { 1.1 * half / f64::abs(z) };
            let from = [at[0] - lift * w[0], at[1] - lift * w[1], -lift * w[2]];
            lines.hits(from.map(|v| v as f32), w.map(|v| v as f32), &mut hits);
            // The brute-force search covers images around the origin.
            let mut want = brute(&cloth, from, w);
            for hit in hits.as_slice() {
                let radius = hit.radius_um;
                // A point near the end of a piece is found from both sides.
                let across = cross(w.map(|v| v as f32), hit.tangent);
                let sine = f64::from(dot(across, across)).sqrt();
                let found = want.iter().position(|(curve, distance, h)| {
                    *curve == hit.curve
                        && (distance - f64::from(hit.nearest_um)).abs() < 0.12 * f64::from(radius) / sine
                        && (h - f64::from(hit.h_um.abs())).abs() < 0.01 * f64::from(radius)
                });
                match found {
                    Some(at) => drop(want.remove(at)),
                    None if hit.h_um.abs() > 0.99 * radius => doubtful += 1,
                    None => panic!("{i}: {hit:?} is no hit; left {want:?}"),
                }
                // The hit's entry point lies on the surface of the ply, unless the line runs along the
                // tangent.
                let p: [f32; 3] = std::array::from_fn(|k| hit.enter_um * w[k] as f32 - hit.center_um[k]);
                let along = dot(p, hit.tangent);
                let off = dot(p, p) - along * along;
                let is_along = sine * sine < f64::from(MIN_SINE2);
                assert!(is_along || (off.max(0.0).sqrt() / radius - 1.0).abs() < 0.02, "{hit:?}");
                total += 1;
            }
            let missed: Vec<_> =
                want.iter().filter(|(curve, _, h)| *h < 0.99 * cloth.curves[*curve as usize].radius_um).collect();
            doubtful += want.len() - missed.len();
            assert!(missed.is_empty() || hits.as_slice().len() == MAX_HITS, "{i}, cosine {z}: missed {missed:?}");
        }
        println!("{total} hits, {doubtful} at a rim");
        assert!(total > 400 && doubtful < total / 50);
    }

    /// Any input ends, including NaN and infinity.
    #[test]
    fn lines_of_any_numbers_end() {
        let lines = ClothLines::new(&cloth()).unwrap();
        let mut hits = LineHits::default();
        for x in [0.0, 1e7, -3e30, f32::INFINITY, f32::NAN] {
            for w in
                [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [f32::NAN, 0.0, 1.0], [0.6, 0.0, 0.8], [1e30, 1.0, f32::INFINITY]]
            {
                lines.hits([x, 3.0, 200.0], w, &mut hits);
                lines.hits([x, 3.0, x], w, &mut hits);
                assert!(hits.as_slice().len() <= MAX_HITS);
            }
        }
    }

    /// A curve with spans of length zero, and one that turns back, still gets unit tangents.
    #[test]
    fn a_curve_without_a_tangent_gets_one() {
        let mut cloth = cloth();
        let control = &mut cloth.curves[0].control_um;
        let there = control[0];
        control[..6].fill(there);
        let back = control[9];
        control[11] = back;
        let (lines, mut hits, mut count) = (ClothLines::new(&cloth).unwrap(), LineHits::default(), 0);
        for k in 0..4000 {
            let part = |a: f64| (0.618 * a * f64::from(k)).fract() as f32 - 0.5;
            let from = [there[0] as f32 + 40.0 * part(1.0), there[1] as f32 + 40.0 * part(1.7), 500.0];
            lines.hits(from, [0.0, 0.0, -1.0], &mut hits);
            for hit in hits.as_slice() {
                count += usize::from(hit.tangent == [1.0, 0.0, 0.0]);
                let length2 = dot(hit.tangent, hit.tangent);
                assert!((length2 - 1.0).abs() < 1e-4 && hit.theta_i.is_finite(), "{hit:?}");
            }
        }
        assert!(count > 10, "{count}");
    }
}
