//! The plies that a line comes near, in the order along it: yarns as tubes about their crimped axes.
//!
//! A line is followed by steps as long as the distance to the nearest yarn's hull, the tube of its outer
//! radius and d_cut about it. At a hull a yarn of one ply counts as straight along its tangent where the line
//! is nearest to its axis, which is looked for in a few steps; in a yarn of several plies the line is
//! followed along the bent axis (`walk.rs`). A line that passes the plies goes on behind the hull. Distances
//! are those to the tangent at the same coordinate along the yarn, 0.9 of which is stepped: the axis bends
//! away from it.

use super::hit::PlyHit;
use super::profile::Ends;
use super::yarn::{Line, MAX_PLIES, YarnHit};
use super::{Fabric, YarnSet};
use crate::math::floor_fraction;
use crate::math::vec3::dot;

/// Least step along a line [um].
const MIN_STEP_UM: f32 = 1.0;
/// A hull nearer than this is reached [um].
const CLOSE_UM: f32 = 3.0;
/// How near to the place where a line is nearest to a yarn's axis the axis is taken, over half of the yarn's
/// width.
const NEAREST: f32 = 0.001;
/// Most rounds of looking for the place where a line is nearest to a yarn.
const MAX_ROUNDS: usize = 7;
/// Most steps of one line: what grazes for longer counts as gone.
const MAX_STEPS: usize = 1024;
/// Yarns that a line may be in the hulls of at once, and more: hulls overlap by twice d_cut.
const PASSED: usize = 8;
/// All plies may be met.
const ALL: [f32; MAX_PLIES] = [f32::NEG_INFINITY; MAX_PLIES];
/// No yarn.
const NONE: u64 = u64::MAX;
/// How far a yarn is looked at at once, over its hull's radius. A ply's r_d is of the whole yarn: a yarn that
/// a line passes beside once must count once.
const LOOKED_AT: f32 = 4.0;
/// How far from where it is asked a yarn is met at most, over its hull's radius.
const AHEAD: f32 = 6.0;
/// Squared sine below which a line counts as parallel to a yarn.
const PARALLEL: f32 = 1e-10;
/// What light comes from may be met again this far away, over R.
const OWN: f32 = 2.5;
/// Lines start and end this far above and below the yarns [um].
const MARGIN_UM: f32 = 1.0;

/// A yarn of a fabric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct YarnId {
    pub family: YarnSet,
    pub yarn: i32,
}

impl YarnId {
    /// One number.
    #[inline]
    fn key(self) -> u64 {
        (self.family as u64) << 32 | u64::from(self.yarn as u32)
    }
}

/// What a line does not meet at first: what it comes from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Skip {
    None,
    /// A yarn, until the line is so long [um].
    Yarn(YarnId, f32),
    /// A ply of a yarn, until the line is so long [um].
    Ply(YarnId, u32, f32),
}

/// A ply within whose reach, R + d_cut, a line comes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub hit: PlyHit,
    /// Whether the line meets the ply itself, |h| < R.
    pub is_hit: bool,
    /// Point of the ply's axis that the line is nearest to [um], the way to it from the yarn's axis, and that
    /// axis' direction.
    pub center: [f32; 3],
    pub off_axis: [f32; 3],
    pub yarn_axis: [f32; 3],
}

impl Candidate {
    pub(super) fn id(&self) -> YarnId {
        YarnId { family: self.hit.family, yarn: self.hit.yarn }
    }
}

/// What a line meets of a yarn, or passes nearest to.
struct Meeting {
    met: YarnHit,
    /// Axes of the yarn, straight there, and the point of its axis.
    axes: [[f32; 3]; 3],
    axis: [f32; 3],
    /// Where on the line the ply's axis is nearest [um].
    nearest: f32,
}

/// A yarn that has been asked.
#[derive(Clone, Copy, Debug)]
struct TestedYarn {
    key: u64,
    /// It is not asked before the line is so far, and where on the line it was found [um].
    until: f32,
    met_at: f32,
}

impl TestedYarn {
    const NONE: TestedYarn = TestedYarn { key: NONE, until: f32::NEG_INFINITY, met_at: f32::NEG_INFINITY };
}

/// A line on its way through a fabric.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flight<'a> {
    fabric: &'a Fabric,
    from: [f32; 3],
    d: [f32; 3],
    at: f32,
    /// The yarns that have been asked.
    passed: [TestedYarn; PASSED],
    oldest: usize,
    /// Of a yarn whose plies scatter one by one: its key, and until when each ply is not met, as the line has
    /// left it [um].
    left: (u64, [f32; MAX_PLIES]),
    /// By family.
    around: [Around; 2],
    top: f32,
}

/// The two nearest yarns of a family, and how they lie between the crossings before and after a point.
#[derive(Clone, Copy, Debug)]
struct Around {
    /// The nearest yarn, the way to the other one, the crossing before.
    at: [i32; 3],
    ends: [Ends; 2],
    /// They are not asked before the line is so far [um].
    until: [f32; 2],
}

impl Around {
    const UNKNOWN: Around =
        Around { at: [0; 3], ends: [Ends { side: 1.0, bends: false }; 2], until: [f32::NEG_INFINITY; 2] };

    /// The two yarns.
    fn yarns(&self) -> [i32; 2] {
        [self.at[0], self.at[0].wrapping_add(self.at[1])]
    }
}

/// Where light in direction `b` leaves the tube of this radius about the axis through `center` along `z`
/// (unit), from a point `p` in it. Along the tube at most ten radii further.
pub(crate) fn exit(center: [f32; 3], z: [f32; 3], radius: f32, p: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let q: [f32; 3] = std::array::from_fn(|i| p[i] - center[i]);
    let (qz, bz) = (dot(q, z), dot(b, z));
    let across: [f32; 3] = std::array::from_fn(|i| q[i] - qz * z[i]);
    let turned: [f32; 3] = std::array::from_fn(|i| b[i] - bz * z[i]);
    let a = dot(turned, turned).max(1e-4);
    let half = dot(across, turned);
    let room = (half * half - a * (dot(across, across) - radius * radius)).max(0.0);
    let way = ((room.sqrt() - half) / a).clamp(0.0, 10.0 * radius);
    std::array::from_fn(|i| p[i] + way * b[i])
}

impl Fabric {
    /// The line from `from` [um] in direction `d` (unit).
    pub(super) fn flight(&self, from: [f32; 3], d: [f32; 3], skip: Skip) -> Flight<'_> {
        let mut passed = [TestedYarn::NONE; PASSED];
        let mut left = (NONE, ALL);
        match skip {
            Skip::None => {}
            Skip::Yarn(id, until) => passed[0] = TestedYarn { key: id.key(), until, ..TestedYarn::NONE },
            Skip::Ply(id, ply, until) => {
                left.0 = id.key();
                left.1[ply as usize % MAX_PLIES] = until;
            }
        }
        let (around, top) = ([Around::UNKNOWN; 2], self.top_um());
        Flight { fabric: self, from, d, at: 0.0, passed, oldest: 1, left, around, top }
    }

    /// What light that leaves a ply at `from` in direction `d` does not meet: the ply; of a yarn of several
    /// plies, whose model has what the others do, the yarn.
    pub(super) fn skip_own(&self, near: &Candidate, from: [f32; 3], d: [f32; 3]) -> Skip {
        let yarn = &self.yarns[near.hit.family as usize];
        if yarn.one_by_one {
            return Skip::Ply(near.id(), near.hit.ply, OWN * yarn.radius);
        }
        self.skip_yarn(near.id(), from, d)
    }

    /// A yarn, for light that leaves one of its plies at `from` in direction `d`.
    pub(super) fn skip_yarn(&self, id: YarnId, from: [f32; 3], d: [f32; 3]) -> Skip {
        let k = id.family as usize;
        let yarn = &self.yarns[k];
        let beside = OWN * yarn.radius;
        if yarn.plies < 2 {
            return Skip::Yarn(id, beside);
        }
        let along = from[1 - k];
        let (height, slope) = self.axis_at(id, along);
        let [_, _, tangent] = super::hit::axes(id.family, slope);
        let mut axis = [height; 3];
        axis[k] = (id.yarn as f32 + 0.5) * yarn.spacing;
        axis[1 - k] = along;
        let gone = exit(axis, tangent, yarn.half_width, from, d);
        let way: [f32; 3] = std::array::from_fn(|i| gone[i] - from[i]);
        Skip::Yarn(id, dot(way, way).sqrt() + beside)
    }

    /// The line that crosses the middle plane at a point [um], towards the light at `w` (unit), followed the
    /// other way from above the yarns.
    pub(super) fn flight_through(&self, at: [f32; 2], w: [f32; 3]) -> Flight<'_> {
        // Lines in the plane itself come from ten repeats of a thick cloth away.
        let lift = (self.top_um() / w[2].abs().max(1e-6)).min(1e5);
        self.flight([at[0] + lift * w[0], at[1] + lift * w[1], lift * w[2]], w.map(|v| -v), Skip::None)
    }

    /// Height above which there is no yarn's reach [um].
    pub(super) fn top_um(&self) -> f32 {
        self.half_thickness_um() + self.yarns.iter().map(|y| y.reach - y.radius).fold(0.0, f32::max) + MARGIN_UM
    }

    /// The crossing before a coordinate along the yarns of a family [um], and the share of the way to the
    /// next.
    #[inline]
    fn between_crossings(&self, family: YarnSet, along: f32) -> (i32, f32) {
        floor_fraction(along * self.yarns[family.other() as usize].per_spacing - 0.5)
    }

    /// Height and slope of a yarn's axis at the coordinate along it [um].
    #[inline]
    fn axis_at(&self, id: YarnId, along: f32) -> (f32, f32) {
        let (first, u) = self.between_crossings(id.family, along);
        let [from, to] = [first, first.wrapping_add(1)].map(|k| self.is_on_top(id.family, id.yarn, k));
        self.yarns[id.family as usize].profile.joined(from, to, u)
    }
}

impl Flight<'_> {
    fn point(&self, at: f32) -> [f32; 3] {
        std::array::from_fn(|i| self.from[i] + at * self.d[i])
    }

    /// How far the line goes before it asks a yarn [um].
    fn until(&self, id: YarnId) -> f32 {
        let key = id.key();
        self.passed.iter().fold(f32::NEG_INFINITY, |all, passed| if passed.key == key { passed.until } else { all })
    }

    /// Where on the line a yarn was found last [um].
    fn met_at(&self, id: YarnId) -> f32 {
        let key = id.key();
        self.passed.iter().find(|passed| passed.key == key).map_or(f32::NEG_INFINITY, |passed| passed.met_at)
    }

    fn pass(&mut self, id: YarnId, until: f32, met_at: f32) {
        // A yarn has one entry.
        let key = id.key();
        let slot = self.passed.iter().position(|passed| passed.key == key).unwrap_or(self.oldest);
        self.passed[slot] = TestedYarn { key, until, met_at };
        if slot == self.oldest {
            self.oldest = (self.oldest + 1) % self.passed.len();
        }
        for family in YarnSet::EACH {
            let until = self.around[family as usize].yarns().map(|yarn| self.until(YarnId { family, yarn }));
            self.around[family as usize].until = until;
        }
    }

    /// The nearest hull that has not been asked: its distance, yarn, and how far the line may go without
    /// meeting any.
    fn nearest(&mut self, q: [f32; 3]) -> (f32, Option<YarnId>, f32) {
        let (mut squared, mut free) = ([0.0; 4], f32::INFINITY);
        for family in YarnSet::EACH {
            let k = family as usize;
            let yarn = &self.fabric.yarns[k];
            let (cell, rest) = floor_fraction(q[k] * yarn.per_spacing);
            let t = rest - 0.5;
            let other = if t < 0.0 { -1 } else { 1 };
            let (first, u) = self.fabric.between_crossings(family, q[1 - k]);
            if self.around[k].at != [cell, other, first] {
                let mut around = Around { at: [cell, other, first], ..Around::UNKNOWN };
                let yarns = around.yarns();
                let on_top = |yarn, n| self.fabric.is_on_top(family, yarn, n);
                around.ends = yarns.map(|yarn| Ends::new(on_top(yarn, first), on_top(yarn, first.wrapping_add(1))));
                around.until = yarns.map(|yarn| self.until(YarnId { family, yarn }));
                self.around[k] = around;
            }
            let ends = &self.around[k].ends;
            let (bent, cos2) = yarn.profile.bent(u);
            for n in 0..2 {
                let lateral = (t - (n as i32 * other) as f32) * yarn.spacing;
                let height = ends[n].side * if ends[n].bends { bent } else { yarn.profile.amplitude };
                let up = q[2] - height;
                squared[2 * k + n] = lateral * lateral + up * up * if ends[n].bends { cos2 } else { 1.0 };
            }
            // The yarns beside these two are a spacing away at least.
            free = free.min((yarn.spacing - yarn.hull).max(0.3 * yarn.half_width));
        }
        let (mut least, mut which) = (f32::INFINITY, None);
        for family in YarnSet::EACH {
            let k = family as usize;
            let (hull, around) = (self.fabric.yarns[k].hull, &self.around[k]);
            for (n, yarn) in around.yarns().into_iter().enumerate() {
                let distance = squared[2 * k + n].sqrt() - hull;
                if distance < least && self.at >= around.until[n] {
                    (least, which) = (distance, Some(YarnId { family, yarn }));
                }
            }
        }
        (least, which, free.min(0.9 * least))
    }

    /// As [`Fabric::axis_at`], with what is known of the nearest yarns.
    #[inline]
    fn axis_at(&self, id: YarnId, along: f32) -> (f32, f32) {
        let (first, u) = self.fabric.between_crossings(id.family, along);
        let around = &self.around[id.family as usize];
        let known = around.yarns().iter().position(|yarn| *yarn == id.yarn);
        match known.filter(|_| around.at[2] == first && around.at[1] != 0) {
            Some(which) => self.fabric.yarns[id.family as usize].profile.on(around.ends[which], u),
            None => self.fabric.axis_at(id, along),
        }
    }

    /// Where on the line a yarn of one ply is straightened: next to its axis, found as in [`Flight::meet`] by
    /// the distance to the axis alone.
    fn beside(&self, id: YarnId) -> f32 {
        let k = id.family as usize;
        let yarn = &self.fabric.yarns[k];
        let axis = (id.yarn as f32 + 0.5) * yarn.spacing;
        let mut at = self.at;
        for _ in 0..MAX_ROUNDS {
            let q = self.point(at);
            let (height, slope) = self.axis_at(id, q[1 - k]);
            let cos2 = 1.0 / (1.0 + slope * slope);
            let rise = self.d[2] - slope * self.d[1 - k];
            let sine2 = (self.d[k] * self.d[k] + rise * rise * cos2).max(PARALLEL);
            let nearest = ((q[k] - axis) * self.d[k] + (q[2] - height) * rise * cos2) / sine2;
            let step = (-nearest).clamp(-2.0 * yarn.half_width, 2.0 * yarn.half_width);
            if step.abs() < NEAREST * yarn.half_width {
                break;
            }
            at += step;
        }
        at
    }

    /// The line `at` um along it and a yarn, straight along its tangent next to the point: the line from that
    /// point, the yarn's axes, and the point of its axis.
    fn straightened(&self, id: YarnId, at: f32) -> (Line, [[f32; 3]; 3], [f32; 3]) {
        let k = id.family as usize;
        let yarn = &self.fabric.yarns[k];
        let q = self.point(at);
        let mut along = q[1 - k];
        let (mut height, mut slope) = self.axis_at(id, along);
        if yarn.plies > 1 {
            // The foot of the point on the axis.
            let foot = (q[2] - height) * slope / (1.0 + slope * slope);
            along += foot.clamp(-yarn.half_width, yarn.half_width);
            (height, slope) = self.axis_at(id, along);
        }
        let axes = super::hit::axes(id.family, slope);
        let mut axis = [height; 3];
        axis[k] = (id.yarn as f32 + 0.5) * yarn.spacing;
        axis[1 - k] = along;
        let off: [f32; 3] = std::array::from_fn(|i| q[i] - axis[i]);
        let line = Line {
            origin: axes.map(|a| dot(a, off)),
            w: axes.map(|a| -dot(a, self.d)),
            turns: yarn.turns(id.yarn, id.family as u32, along),
            lean: axes[2][1 - k],
        };
        (line, axes, axis)
    }

    /// What the line meets of a yarn or passes nearest to, if any, and how far the yarn has been looked at.
    fn meet(&self, id: YarnId) -> (Option<Meeting>, f32) {
        let yarn = &self.fabric.yarns[id.family as usize];
        let (at, ply, until) = if yarn.plies == 1 {
            (self.beside(id), None, self.at)
        } else {
            let (key, left) = &self.left;
            let until = if *key == id.key() { left } else { &ALL };
            let walked = yarn.walk(self.at, self.at + LOOKED_AT * yarn.hull, until, |at| self.straightened(id, at).0);
            let Some(ply) = walked.ply else { return (None, walked.until) };
            (walked.at, Some((ply, walked.is_hit)), walked.until)
        };
        let (line, axes, axis) = self.straightened(id, at);
        let met = ply.map_or_else(|| yarn.meet_one(&line), |(ply, is_hit)| yarn.meet_ply(&line, ply, is_hit));
        (Some(Meeting { nearest: at - met.nearest, met, axes, axis }), until)
    }

    /// The next ply that the line comes near.
    pub(super) fn next_near(&mut self) -> Option<Candidate> {
        let fabric = self.fabric;
        let top = self.top;
        for _ in 0..MAX_STEPS {
            let q = self.point(self.at);
            if q[2].abs() > top {
                if q[2] * self.d[2] >= 0.0 {
                    return None;
                }
                self.at += (q[2].abs() - top) / self.d[2].abs() + 0.1 * MARGIN_UM;
                continue;
            }
            let (distance, which, free) = self.nearest(q);
            let Some(id) = which.filter(|_| distance < CLOSE_UM) else {
                self.at += free.max(MIN_STEP_UM);
                continue;
            };
            let (meeting, until) = self.meet(id);
            let yarn = &fabric.yarns[id.family as usize];
            let hull = yarn.hull;
            let Some(Meeting { met, axes, axis, nearest }) = meeting else {
                self.pass(id, until.max(self.at + MIN_STEP_UM), f32::NEG_INFINITY);
                self.at += 0.1 * MIN_STEP_UM;
                continue;
            };
            // Where it leaves the hull, straight as the yarn is here.
            let off: [f32; 3] = std::array::from_fn(|i| q[i] - axis[i]);
            let [o, v] = [off, self.d].map(|x| [dot(axes[0], x), dot(axes[1], x)]);
            let a = v[0] * v[0] + v[1] * v[1];
            let half = o[0] * v[0] + o[1] * v[1];
            let room = half * half - a * (o[0] * o[0] + o[1] * o[1] - hull * hull);
            let leaves = if a > 1e-6 && room > 0.0 { (room.sqrt() - half) / a } else { 0.0 };
            // It goes on in any case, so that every line ends.
            let leaves = self.at + leaves.clamp(MIN_STEP_UM, LOOKED_AT * hull);
            // A line that stays near a yarn for longer than it is looked at asks again, and finds the same
            // place or, where the yarn bends, the next.
            let before = self.met_at(id);
            let is_new = yarn.plies > 1 || (nearest - before).abs() > yarn.half_width;
            let is_in_reach = (nearest - self.at).abs() < AHEAD * hull;
            let met_at = if is_in_reach { nearest } else { before };
            if met.hit && yarn.one_by_one {
                // Behind the ply that is met there may be another.
                if self.left.0 != id.key() {
                    self.left = (id.key(), ALL);
                }
                self.left.1[met.ply as usize % MAX_PLIES] = nearest + OWN * yarn.radius;
                self.pass(id, nearest.max(self.at), met_at);
            } else {
                let until = if met.hit || yarn.plies == 1 { leaves } else { until.max(self.at + MIN_STEP_UM) };
                self.pass(id, until, met_at);
            }
            self.at += 0.1 * MIN_STEP_UM;
            // What lies behind the line's start is not met.
            if is_new && met.h.abs() < yarn.reach && nearest > 0.0 && is_in_reach {
                let to_fabric = |v: [f32; 3]| -> [f32; 3] {
                    std::array::from_fn(|i| v[0] * axes[0][i] + v[1] * axes[1][i] + v[2] * axes[2][i])
                };
                let center = to_fabric(met.center);
                let k = id.family as usize;
                let along_um = axis[1 - k] + center[1 - k];
                let other = &fabric.yarns[1 - k];
                let (_, beside) = floor_fraction(along_um * other.per_spacing);
                let hit = PlyHit {
                    family: id.family,
                    yarn: id.yarn,
                    ply: met.ply,
                    frame: met.frame().map(to_fabric),
                    theta_i: met.theta_i(axes.map(|a| -dot(a, self.d))),
                    h_um: met.h,
                    along_um,
                    is_double: (beside - 0.5).abs() * other.spacing < other.half_width,
                    across_um: self.point(nearest)[k] - axis[k],
                    height_um: fabric.axis_at(id, along_um).0,
                };
                let [c, n, _] = met.center;
                let off_axis = std::array::from_fn(|i| c * axes[0][i] + n * axes[1][i]);
                let center = std::array::from_fn(|i| axis[i] + center[i]);
                return Some(Candidate { hit, is_hit: met.hit, center, off_axis, yarn_axis: axes[2] });
            }
        }
        None
    }
}
