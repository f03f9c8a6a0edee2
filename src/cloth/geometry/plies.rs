//! The curves of a cloth together with the ply models, and the frames of plies at hits.
//!
//! `ClothPlies` pairs each curve with the model of its kind of yarn and checks that their radii agree.
//! `frame` gives the axes in which a ply model is evaluated at a hit.

use crate::cloth::geometry::lines::{ClothLines, LineHit};
use crate::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve};
use crate::math::vec3::{cross, dot};
use crate::spec::YarnSpec;
use crate::spec::rules::invalid;
use crate::{PlyModel, Result};
use std::sync::Arc;

/// Largest relative difference between the radius of a model's ply and of its curve.
const MAX_OFF: f64 = 0.02;
/// Distance above the plies at which lines start [um].
pub(crate) const MARGIN_UM: f32 = 1.0;

/// The axis of the cloth along which the yarns of a kind run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Runs {
    /// Along x.
    AlongX,
    /// Along y.
    AlongY,
}

impl Runs {
    /// Index of the axis: 0 for x, 1 for y.
    pub(crate) fn axis(self) -> usize {
        match self {
            Runs::AlongX => 0,
            Runs::AlongY => 1,
        }
    }
}

/// The curves of a cloth with the models of their plies.
#[derive(Clone, Debug)]
pub struct ClothPlies {
    /// The curves, prepared for intersection with lines.
    pub lines: ClothLines,
    /// The lattice of the cell.
    pub lattice: Lattice,
    pub(crate) yarns: Vec<ClothYarn>,
    /// `[curve]`: index of its yarn.
    pub(crate) of_curve: Vec<u32>,
    /// `[curve]`: kind of its yarn.
    pub kind_of: Vec<usize>,
    /// Number of kinds of yarns, 1 or 2.
    pub kinds: usize,
    /// `[kind]`: axis along which its yarns run.
    pub runs: [Runs; 2],
    /// `[kind]`: ply model in single lines.
    pub models: Vec<Arc<PlyModel>>,
    /// `[kind]`: radius of the model's ply over that of the curves.
    pub scale: Vec<f32>,
    /// `[curve]`: rotation of the fibers per unit of the curve's parameter [rad]; a whole number of turns per
    /// period.
    pub(crate) twist: Vec<f32>,
    /// `[curve]`: arc length [um] per unit of the curve's parameter, and per step along each vector of the
    /// cell.
    pub(crate) along_um: Vec<[f32; 3]>,
}

impl ClothPlies {
    /// Pairs curves with the model of each kind of yarn, in single lines.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for models whose plies are not those of the curves, and as
    /// [`ClothLines::new`].
    pub fn new(curves: &ClothCurves, models: &[Arc<PlyModel>]) -> Result<ClothPlies> {
        let lines = ClothLines::new(curves)?;
        let lattice = curves.lattice("cloth")?;
        let kinds = curves.yarns.iter().map(|y| y.kind as usize + 1).max().unwrap_or(1);
        if models.len() != kinds || kinds > 2 {
            let hint = format!("give {kinds}, one for each kind of yarn");
            return Err(invalid("cloth", "model", format!("{} models", models.len()), hint));
        }
        let kind_of: Vec<usize> = curves.curves.iter().map(|c| curves.yarns[c.yarn as usize].kind as usize).collect();
        let (mut scale, mut twists) = (Vec::new(), Vec::new());
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
            twists.push(ply.ply.twist());
        }
        let runs = [0, 1].map(|kind| {
            let yarn = curves.yarns.iter().find(|y| y.kind == kind);
            let period = yarn.map_or([1.0, 0.0], |y| lattice.vector(y.period));
            if period[1].abs() > period[0].abs() { Runs::AlongY } else { Runs::AlongX }
        });
        let lengths_um: Vec<f64> = curves.curves.iter().map(|curve| curve.length_um(&lattice)).collect();
        let twist = |((curve, kind), length_um): ((&PlyCurve, &usize), &f64)| {
            (twists[*kind].closed_rad(*length_um, 1.0, 0.0) / curve.control_um.len() as f64) as f32
        };
        let along = |(curve, length_um): (&PlyCurve, &f64)| {
            // One period later the curve is in another cell.
            let [a, b] = curve.shift;
            let per = |steps: i32| if steps == 0 { 0.0 } else { length_um / f64::from(steps) };
            let [a, b] = if a.unsigned_abs() >= b.unsigned_abs() { [per(a), 0.0] } else { [0.0, per(b)] };
            [length_um / curve.control_um.len() as f64, a, b].map(|um| um as f32)
        };
        Ok(ClothPlies {
            twist: curves.curves.iter().zip(&kind_of).zip(&lengths_um).map(twist).collect(),
            along_um: curves.curves.iter().zip(&lengths_um).map(along).collect(),
            lines,
            lattice,
            yarns: curves.yarns.clone(),
            of_curve: curves.curves.iter().map(|c| c.yarn).collect(),
            kind_of,
            kinds,
            runs,
            models: models.to_vec(),
            scale,
        })
    }
}

/// Axes of the ply's frame at a hit of a line in direction `d`: x and y across the ply, y towards the line's
/// origin, z along the ply.
#[inline(always)]
pub fn frame(hit: &LineHit, d: [f32; 3]) -> [[f32; 3]; 3] {
    let z = hit.tangent;
    let along = dot(d, z);
    let mut y = [along * z[0] - d[0], along * z[1] - d[1], along * z[2] - d[2]];
    let mut length2 = dot(y, y);
    if length2 < 1e-8 {
        // The line runs along the ply: any axis across it will do.
        let e = if z[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        y = cross(z, e);
        length2 = dot(y, y);
    }
    let per = 1.0 / length2.sqrt();
    let y = [y[0] * per, y[1] * per, y[2] * per];
    [cross(y, z), y, z]
}

/// Approximate share of a line that passes a ply: a mean of r_d over offsets near the hit.
#[inline(always)]
pub(crate) fn passes(model: &PlyModel, scale: f32, hit: &LineHit) -> f32 {
    let (h_um, off) = (scale * hit.h_um, 0.05 * hit.radius_um);
    model.passed_lines().map_or(1.0, |passed| passed.mean(hit.theta_i, h_um - off, h_um + off))
}

impl ClothPlies {
    /// Approximate share of a line that passes the ply it hits, from a small table.
    pub fn passes(&self, hit: &LineHit) -> f32 {
        let kind = self.kind_of[hit.curve as usize];
        passes(&self.models[kind], self.scale[kind], hit)
    }

    /// `[kind]`: index of the axis of the cloth along which its yarns run, 0 for x.
    pub fn axes(&self) -> [usize; 2] {
        self.runs.map(Runs::axis)
    }

    /// r_d: share of a line that passes the ply it hits unscattered.
    pub fn r_d(&self, hit: &LineHit) -> f32 {
        let kind = self.kind_of[hit.curve as usize];
        self.models[kind].r_d(hit.theta_i, self.scale[kind] * hit.h_um)
    }
}

/// Start of the line that comes from direction `a` through a point of the middle plane [um].
#[inline(always)]
pub fn start(lines: &ClothLines, at: [f32; 2], a: [f32; 3]) -> [f32; 3] {
    let distance = (lines.half_thickness_um() + MARGIN_UM) / a[2].abs().max(1e-4);
    [at[0] + distance * a[0], at[1] + distance * a[1], distance * a[2]]
}

/// Point at which the line from a point in direction `d` has left all plies [um].
#[inline]
pub fn beyond(lines: &ClothLines, from: [f32; 3], d: [f32; 3]) -> [f32; 3] {
    let height = lines.half_thickness_um() + MARGIN_UM - from[2] * d[2].signum();
    let distance = height.max(0.0) / d[2].abs().max(1e-4);
    std::array::from_fn(|k| from[k] + distance * d[k])
}
