//! The way of a line along a yarn of several plies, bent or not: the first ply that it meets, or the one that
//! it passes nearest to.
//!
//! The yarn is straightened where the line is, its plies are straight cylinders along their tangents there,
//! and the line goes on to the first of them, but no further than a stretch on which a ply hardly leaves its
//! tangent, or than the distance to the circle about all plies. Then the yarn is straightened anew. A ply is
//! met where the line is next to it.
//! Thus a line nearly along a yarn that dives under another meets what it meets first, not what a yarn
//! straight from far away would have there.

use super::yarn::{Line, MAX_PLIES, Yarn};

/// Most straightened places of one walk; what lies behind them is asked by the next.
const MAX_STEPS: usize = 24;
/// Stretch on which plies count as straight, over R: a ply whose curvature is 1 over 5 R leaves its tangent
/// by 0.1 R on it.
const STRETCH: f32 = 1.0;
/// A ply nearer than this is met, over R.
const NEXT: f32 = 0.02;

/// What a line along a yarn comes to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Walked {
    /// Whether a ply is met; else the ply is that which the line passes nearest to, if any.
    pub is_hit: bool,
    pub ply: Option<u32>,
    /// Where on the line the yarn is straightened for it [um].
    pub at: f32,
    /// How far the walk came [um].
    pub until: f32,
}

impl Yarn {
    /// Walks along a line from the distance `at` until it has met a ply, left the yarn's hull, or come to
    /// `end`. `line_at` straightens the yarn at a distance along the line. Each ply is met once the line is
    /// so far as `until` says [um].
    pub(super) fn walk(
        &self,
        mut at: f32,
        end: f32,
        until: &[f32; MAX_PLIES],
        mut line_at: impl FnMut(f32) -> Line,
    ) -> Walked {
        let mut walked = Walked::default();
        let mut least = f32::INFINITY;
        for _ in 0..MAX_STEPS {
            let line = line_at(at);
            let [x, y, shift] = line.origin;
            let [wc, wn, _] = line.w;
            let beside = (x * x + y * y).sqrt();
            let mut step = (STRETCH * self.radius).max(beside - self.half_width);
            let angle = self.angle(&line, shift);
            let mut first = None;
            for k in 0..self.plies {
                if at < until[k] {
                    continue;
                }
                let (met, entry, _) = self.cylinder(&line, k, shift, angle);
                if met.nearest > 0.0 {
                    // Behind.
                } else if met.hit {
                    let ahead = (-entry).max(0.0);
                    if ahead < step {
                        (step, first) = (ahead, Some(k as u32));
                    }
                } else if -met.nearest < step && met.h.abs() < least {
                    least = met.h.abs();
                    (walked.ply, walked.at) = (Some(k as u32), at - met.nearest);
                }
            }
            at += step;
            if first.is_some() && step < NEXT * self.radius {
                return Walked { is_hit: true, ply: first, at, until: at };
            }
            walked.until = at;
            if at > end || beside > self.hull && x * wc + y * wn < 0.0 {
                break;
            }
        }
        walked
    }
}
