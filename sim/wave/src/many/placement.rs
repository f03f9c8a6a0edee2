//! Placement of bodies: the frames of equal ones, and the candidate points of a wall for its interaction with
//! others.

use crate::boundary::close::{FINEST, closeness};
use crate::many::skeleton::Candidates;
use crate::scene::curve::{Curve, CurvePoint};
use crate::{Body, C64, WaveError};
use std::f64::consts::TAU;

/// A rigid map from a body's own frame to the scene.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    center: C64,
    turn: C64,
}

impl Frame {
    pub(crate) fn new(body: &Body) -> Self {
        Self { center: C64::new(body.center_um[0], body.center_um[1]), turn: C64::from_polar(1.0, body.rotation_rad) }
    }

    pub(crate) fn place(&self, p: &CurvePoint) -> CurvePoint {
        let at = self.center + self.turn * C64::new(p.at[0], p.at[1]);
        let normal = self.turn * C64::new(p.normal[0], p.normal[1]);
        CurvePoint { at: [at.re, at.im], normal: [normal.re, normal.im], ..*p }
    }

    pub(crate) fn unplace(&self, p: &CurvePoint) -> CurvePoint {
        let at = self.turn.conj() * (C64::new(p.at[0], p.at[1]) - self.center);
        let normal = self.turn.conj() * C64::new(p.normal[0], p.normal[1]);
        CurvePoint { at: [at.re, at.im], normal: [normal.re, normal.im], ..*p }
    }
}

/// The body moved to its own frame, with its lumens.
pub(crate) fn at_home(body: &Body) -> Body {
    let frame = Frame::new(body);
    let mut home = body.clone();
    let mut next = Some(&mut home);
    while let Some(inner) = next {
        let center = frame.turn.conj() * (C64::new(inner.center_um[0], inner.center_um[1]) - frame.center);
        inner.center_um = [center.re, center.im];
        inner.rotation_rad -= body.rotation_rad;
        next = inner.lumen.as_deref_mut();
    }
    home
}

/// Whether two bodies in their own frames are equal up to rounding of their lumens' positions.
pub(crate) fn same(a: &Body, b: &Body) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-11;
    a.shape == b.shape
        && a.eta == b.eta
        && a.kappa == b.kappa
        && near(a.rotation_rad, b.rotation_rad)
        && near(a.center_um[0], b.center_um[0])
        && near(a.center_um[1], b.center_um[1])
        && match (&a.lumen, &b.lumen) {
            (None, None) => true,
            (Some(a), Some(b)) => same(a, b),
            _ => false,
        }
}

/// Smallest and largest coordinates.
pub(crate) fn bounds<'a>(points: impl Iterator<Item = &'a CurvePoint>) -> ([f64; 2], [f64; 2]) {
    points.fold(([f64::MAX; 2], [f64::MIN; 2]), |(low, high), p| {
        let low = [low[0].min(p.at[0]), low[1].min(p.at[1])];
        (low, [high[0].max(p.at[0]), high[1].max(p.at[1])])
    })
}

/// Candidate points of body b in the scene, finer where other bodies are close.
pub(crate) fn candidates(
    b: usize,
    frames: &[Frame],
    nodes: &[Vec<CurvePoint>],
    curve: &Curve,
    tolerance: f64,
) -> Result<Candidates, WaveError> {
    let (low, high) = bounds(nodes[b].iter());
    // Beyond this distance from the box no refinement is needed.
    let widest = curve.nodes.iter().map(|p| p.speed).fold(0.0, f64::max) * curve.step();
    let margin = widest * ((10.0 / tolerance).ln() / TAU + 2.0);
    let mut close = Vec::new();
    let mut finest: f64 = 1.0;
    for (c, others) in nodes.iter().enumerate().filter(|(c, _)| *c != b) {
        for node in others {
            let inside = (0..2).all(|k| node.at[k] > low[k] - margin && node.at[k] < high[k] + margin);
            if !inside {
                continue;
            }
            if let Some((nearest, refinement)) = closeness(&frames[b].unplace(node), curve, tolerance) {
                if refinement > FINEST {
                    let name = |j: usize| format!("fiber[{j}]");
                    return Err(WaveError::Overlap { first: name(b.min(c)), second: name(b.max(c)) });
                }
                close.push(nearest);
                finest = finest.max(refinement);
            }
        }
    }
    let mut made = Candidates::new(curve, &mut close, finest as usize);
    for point in &mut made.points {
        *point = frames[b].place(point);
    }
    Ok(made)
}
