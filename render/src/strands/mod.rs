//! Strands: hair, fur, threads and single fibers as curves with a radius, and their intersection with rays.
//!
//! A strand is a chain of straight segments, or a uniform cubic B-spline through or near its control points;
//! its radius is interpolated in the same way. Rays intersect it as a tube ([`StrandShape::Tube`], the union
//! of balls along the curve) or as a ray-facing band ([`StrandShape::Band`]). `segment.rs` has the
//! intersection formulas, `tree.rs` the BVH and the hits.

mod bundle;
mod dual;
mod import_options;
mod make;
mod notes;
mod pbrt;
mod pbrt_curve;
mod read;
mod scene;
mod segment;
mod trace;
mod tree;
mod wide;
mod words;

use crate::RenderError;
use crate::memory_limit::check_memory;

pub use dual::{StrandDual, StrandDualOptions, render_strands_dual};
pub use import_options::StrandFile;
pub use make::{GeneratedStrands, make};
pub use notes::StrandNotes;
pub use read::mitsuba_text;
pub use scene::{StrandFiber, StrandScene};
pub use trace::render_strands;
pub use tree::{Skip, StrandHit, StrandTree, TraceCost};

/// Largest number of control points of one strand: the limit of a `.hair` file.
pub const MAX_POINTS: usize = 65_536;
/// Largest number of points of all strands: the limit of the tree's indices.
const MAX_IN_ALL: usize = 1 << 29;
/// Largest coordinate [mm].
pub const MAX_MM: f32 = 1e6;
/// Minimum radius [mm].
pub const MIN_RADIUS_MM: f32 = 1e-5;
/// Bytes per control point, for the strands and their BVH.
const POINT_BYTES: u64 = 300;

/// Basis of control points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// Straight segments from point to point.
    Linear,
    /// Uniform cubic B-spline: n points define n - 3 segments, which do not reach the first and the last
    /// point.
    BSpline,
}

impl Basis {
    /// Number of control points of a segment.
    pub fn order(self) -> usize {
        match self {
            Basis::Linear => 2,
            Basis::BSpline => 4,
        }
    }
}

/// Shape of a strand for intersection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StrandShape {
    /// Balls along the curve; a ray hits the surface of their union.
    Tube,
    /// A ray-facing band; a ray hits it where it passes the curve within the radius.
    Band,
}

/// Consecutive control points of one strand. The curves of one strand, such as the Bezier pieces of pbrt, may
/// be in several runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub first: u32,
    pub count: u32,
    pub strand: u32,
}

/// Strands without a BVH.
#[derive(Clone, Debug, PartialEq)]
pub struct Strands {
    basis: Basis,
    /// x, y, z and radius of all control points [mm]. Control radii beyond the ends of a spline may be
    /// negative; the curve's radius is not.
    points: Vec<[f32; 4]>,
    runs: Vec<Run>,
    count: u32,
}

impl Strands {
    /// An empty set of strands with this basis.
    pub fn new(basis: Basis) -> Strands {
        Strands { basis, points: Vec::new(), runs: Vec::new(), count: 0 }
    }

    /// Basis of the control points.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Number of strands.
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Whether there are no strands.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of segments.
    pub fn segments(&self) -> usize {
        self.runs.iter().map(|run| run.count as usize + 1 - self.basis.order()).sum()
    }

    /// Control points x, y, z, radius [mm] of all strands, one after the other.
    pub fn points(&self) -> &[[f32; 4]] {
        &self.points
    }

    /// Control points of each strand, or of each curve of a strand that has several.
    pub fn curves(&self) -> impl Iterator<Item = &[[f32; 4]]> {
        self.runs.iter().map(|run| &self.points[run.first as usize..][..run.count as usize])
    }

    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Adds a strand by its control points x, y, z, radius [mm].
    ///
    /// # Errors
    /// [`RenderError::Strands`] for too few or more than [`MAX_POINTS`] points, for coordinates that are
    /// infinite, NaN or beyond [`MAX_MM`], and for radii below [`MIN_RADIUS_MM`]; the error names `file` and
    /// `place`, such as `strand 3`.
    pub fn push(&mut self, points: &[[f32; 4]], file: &str, place: &str) -> Result<(), RenderError> {
        let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("{place}: {what}") };
        let order = self.basis.order();
        if points.len() < order {
            return Err(bad(format!("{} points; a segment takes {order}", points.len())));
        }
        check_points(points, MIN_RADIUS_MM, file, place)?;
        self.add_run(points, true).map_err(bad)
    }

    /// Adds a strand along all of `points`, at least two. For a B-spline, the outermost points are mirrored,
    /// so that the curve begins and ends at the first and last point with their radii; it only passes near
    /// the others.
    ///
    /// # Errors
    /// Those of [`Strands::push`].
    pub fn push_whole(&mut self, points: &[[f32; 4]], file: &str, place: &str) -> Result<(), RenderError> {
        let middle = match (self.basis, points) {
            (Basis::Linear, _) | (_, [] | [_]) => return self.push(points, file, place),
            (_, [a, b]) => vec![*a, mean(*a, *b), *b],
            _ => points.to_vec(),
        };
        check_points(points, MIN_RADIUS_MM, file, place)?;
        let (a, z) = (beyond(middle[0], middle[1]), beyond(middle[middle.len() - 1], middle[middle.len() - 2]));
        let all = [&[a], &middle[..], &[z]].concat();
        let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("{place}: {what}") };
        self.add_run(&all, true).map_err(bad)
    }

    /// Adds checked control points, to a new strand or to the last one.
    fn add_run(&mut self, points: &[[f32; 4]], is_new: bool) -> Result<(), String> {
        if self.points.len() + points.len() > MAX_IN_ALL {
            return Err("more than 536 M points in all; give fewer strands".into());
        }
        self.count += u32::from(is_new || self.count == 0);
        self.runs.push(Run {
            first: self.points.len() as u32,
            count: points.len() as u32,
            strand: self.count.saturating_sub(1),
        });
        self.points.extend_from_slice(points);
        Ok(())
    }

    /// Refuses a number of points that does not fit in memory.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`].
    pub fn check_memory(points: u64) -> Result<(), RenderError> {
        check_memory(&format!("strands of {points} points"), points.saturating_mul(POINT_BYTES))
    }

    /// Multiplies all radii by `factor`.
    pub fn scale_radii(&mut self, factor: f32) {
        self.points.iter_mut().for_each(|p| p[3] *= factor);
    }

    /// Mean radius over all segments [mm]; 0 without strands.
    pub fn mean_radius_mm(&self) -> f64 {
        let of = |p: &[[f32; 4]]| {
            let r = |k: usize| f64::from(p[k][3]);
            match self.basis {
                Basis::Linear => 0.5 * (r(0) + r(1)),
                Basis::BSpline => (r(0) + 11.0 * (r(1) + r(2)) + r(3)) / 24.0,
            }
        };
        let all = self.curves().flat_map(|points| points.windows(self.basis.order()));
        all.map(of).sum::<f64>() / self.segments().max(1) as f64
    }

    /// Smallest and largest coordinates of the control points [mm]; zeros without strands.
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for p in &self.points {
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(p[k]);
                bounds[1][k] = bounds[1][k].max(p[k]);
            }
        }
        if self.points.is_empty() { [[0.0; 3]; 2] } else { bounds }
    }
}

fn mean(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
}

/// `b` mirrored at `a`, radius included. The curve has the radius of `a` at the end, and its radius is
/// nowhere below those of both `a` and `b`.
fn beyond(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| 2.0 * a[k] - b[k])
}

/// Refuses numbers of points, coordinates and radii out of range; messages number points in their given
/// order.
fn check_points(points: &[[f32; 4]], min: f32, file: &str, place: &str) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("{place}: {what}") };
    if points.len() > MAX_POINTS {
        return Err(bad(format!("{} points; at most {MAX_POINTS}, split the strand", points.len())));
    }
    for (k, p) in points.iter().enumerate() {
        if let Some(v) = p[..3].iter().find(|v| v.is_nan() || v.abs() > MAX_MM) {
            return Err(bad(format!("point {} has the coordinate {v} mm; use up to {MAX_MM}", k + 1)));
        }
        if !(p[3] >= min && p[3] <= MAX_MM) {
            return Err(bad(format!("point {} has the radius {} mm; use {MIN_RADIUS_MM} or more", k + 1, p[3])));
        }
    }
    Ok(())
}
