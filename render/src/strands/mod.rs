//! Strands: hair, fur, threads, lone fibers as curves with a radius, and what a ray meets of them.
//!
//! A strand is a chain of straight segments or a uniform cubic B-spline through or near its control points; its radius varies along it in the same way. Rays meet
//! it as a tube ([`StrandShape::Tube`]: the union of balls along the curve) or as a band that faces each ray ([`StrandShape::Band`]). `segment.rs` has the
//! formulas, `tree.rs` the BVH and the answer at a hit.

mod how;
mod make;
mod pbrt;
mod read;
mod scene;
mod segment;
mod trace;
mod tree;

use crate::RenderError;
use crate::room::check_room;

pub use how::StrandFile;
pub use make::{Made, make};
pub use read::mitsuba_text;
pub use scene::{StrandFiber, StrandScene};
pub use trace::render_strands;
pub use tree::{Skip, StrandHit, StrandTree};

/// Most control points of one strand, which is what a `.hair` file can say.
pub const MOST_POINTS: usize = 65_536;
/// Largest coordinate [mm].
pub const MOST_MM: f32 = 1e6;
/// Least radius [mm].
pub const LEAST_RADIUS_MM: f32 = 1e-5;
/// Bytes a control point, in the strands and in their BVH.
const POINT_BYTES: u64 = 300;

/// What control points mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// Straight from point to point.
    Linear,
    /// Uniform cubic B-spline: n points make n - 3 segments, which do not reach the first and the last point.
    BSpline,
}

impl Basis {
    /// Points of a segment.
    pub fn order(self) -> usize {
        match self {
            Basis::Linear => 2,
            Basis::BSpline => 4,
        }
    }
}

/// What a ray meets of a strand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StrandShape {
    /// Balls along the curve: rays enter at the surface.
    Tube,
    /// A band that faces each ray: rays are met where they pass the curve within the radius.
    Band,
}

/// Consecutive control points of one strand. The curves of one strand, as pbrt's Bezier pieces, may stand in several runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    pub first: u32,
    pub count: u32,
    pub strand: u32,
}

/// Strands, before a BVH is built over them.
#[derive(Clone, Debug, PartialEq)]
pub struct Strands {
    basis: Basis,
    /// x, y, z, radius [mm].
    points: Vec<[f32; 4]>,
    runs: Vec<Run>,
    count: u32,
}

impl Strands {
    /// No strands yet.
    pub fn new(basis: Basis) -> Strands {
        Strands { basis, points: Vec::new(), runs: Vec::new(), count: 0 }
    }

    /// What the control points mean.
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Number of strands.
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of segments.
    pub fn segments(&self) -> usize {
        self.runs.iter().map(|run| run.count as usize + 1 - self.basis.order()).sum()
    }

    /// Control points, x, y, z, radius [mm], of all strands one after the other.
    pub fn points(&self) -> &[[f32; 4]] {
        &self.points
    }

    /// Control points of each strand, or of each curve where a strand has several.
    pub fn curves(&self) -> impl Iterator<Item = &[[f32; 4]]> {
        self.runs.iter().map(|run| &self.points[run.first as usize..][..run.count as usize])
    }

    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Adds a strand by its control points: x, y, z, radius [mm].
    ///
    /// # Errors
    /// [`RenderError::Strands`] for too few or more than [`MOST_POINTS`] points, coordinates that are not finite or beyond [`MOST_MM`], radii below
    /// [`LEAST_RADIUS_MM`]; `file` and `place`, as `strand 3`, stand in it.
    pub fn push(&mut self, points: &[[f32; 4]], file: &str, place: &str) -> Result<(), RenderError> {
        self.extend(points, file, place, true)
    }

    /// Adds a curve to the strand that was added last.
    ///
    /// # Errors
    /// As [`Strands::push`].
    pub fn push_to_last(&mut self, points: &[[f32; 4]], file: &str, place: &str) -> Result<(), RenderError> {
        self.extend(points, file, place, self.count == 0)
    }

    /// A strand through all of `points`: of a B-spline, the outermost points are mirrored at the ends, so that it begins and ends there; in between it passes them by.
    ///
    /// # Errors
    /// As [`Strands::push`].
    pub fn push_whole(&mut self, points: &[[f32; 4]], file: &str, place: &str) -> Result<(), RenderError> {
        let (Basis::BSpline, [a, b, .., y, z]) = (self.basis, points) else {
            return match (self.basis, points) {
                (Basis::BSpline, [a, b] | [a, _, b]) => {
                    // Two or three points: the middle is where it was.
                    let middle = if points.len() == 3 { points[1] } else { mean(*a, *b) };
                    self.push(&[beyond(*a, middle), *a, middle, *b, beyond(*b, middle)], file, place)
                }
                _ => self.push(points, file, place),
            };
        };
        let mut all = Vec::with_capacity(points.len() + 2);
        all.push(beyond(*a, *b));
        all.extend_from_slice(points);
        all.push(beyond(*z, *y));
        self.push(&all, file, place)
    }

    fn extend(&mut self, points: &[[f32; 4]], file: &str, place: &str, new: bool) -> Result<(), RenderError> {
        let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("{place}: {what}") };
        let order = self.basis.order();
        if points.len() < order {
            return Err(bad(format!("{} points; a segment takes {order}", points.len())));
        }
        if points.len() > MOST_POINTS {
            return Err(bad(format!("{} points; at most {MOST_POINTS}, split the strand", points.len())));
        }
        for (k, p) in points.iter().enumerate() {
            if let Some(v) = p[..3].iter().find(|v| v.is_nan() || v.abs() > MOST_MM) {
                return Err(bad(format!("point {} has the coordinate {v} mm; use up to {MOST_MM}", k + 1)));
            }
            if !(p[3] >= LEAST_RADIUS_MM && p[3] <= MOST_MM) {
                return Err(bad(format!("point {} has the radius {} mm; use {LEAST_RADIUS_MM} or more", k + 1, p[3])));
            }
        }
        if self.points.len() + points.len() > u32::MAX as usize {
            return Err(bad("more than 4 G points".into()));
        }
        if new {
            self.count += 1;
        }
        self.runs.push(Run {
            first: self.points.len() as u32,
            count: points.len() as u32,
            strand: self.count.saturating_sub(1),
        });
        self.points.extend_from_slice(points);
        Ok(())
    }

    /// Refuses what memory does not hold.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`].
    pub fn check_room(points: u64) -> Result<(), RenderError> {
        check_room(&format!("strands of {points} points"), points.saturating_mul(POINT_BYTES))
    }

    /// All radii times `factor`.
    pub fn scale_radii(&mut self, factor: f32) {
        self.points.iter_mut().for_each(|p| p[3] = (p[3] * factor).clamp(LEAST_RADIUS_MM, MOST_MM));
    }

    /// Largest and least coordinates of the control points [mm]; zeros without strands.
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

/// `b` mirrored at `a`; the radius is that at `a`, so that it stays above 0.
fn beyond(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    [2.0 * a[0] - b[0], 2.0 * a[1] - b[1], 2.0 * a[2] - b[2], a[3]]
}
