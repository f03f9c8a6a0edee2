//! What is at a point of the fabric: a ply or a gap, by a direction; the yarn on top, by a side.
//!
//! The cell of a point is that of the end and the pick whose axes are nearest. The draft says which family is on top in a cell. A line meets the
//! plies of the nearest yarn of a family or, where it misses those, of the next one on the other side. At a crossing of two yarns that are both met
//! the one on top counts; where only one is met it counts, so that light passing beside the plies of the upper yarn meets the lower one; where none
//! is met there is a gap. At normal incidence plies are met where yarns are. An oblique line meets a yarn beyond its width: gaps close towards
//! grazing light, as they do.
//!
//! The axis of a yarn lies at +amplitude where it is on top and at -amplitude where it is below, joined from crossing to crossing by `3 u^2 - 2 u^3`.

use super::yarn::{Line, Met, Yarn, cell};
use super::{Fabric, Family};

/// What a line meets. It lives on the stack of one query: a box would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// A ply.
    Ply(PlyHit),
    /// No ply.
    Gap(Gap),
}

/// A ply at the line's theta_i and h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyHit {
    /// Family of the yarn.
    pub family: Family,
    /// Number of the yarn, counted from the origin; negative on the other side of it.
    pub yarn: i32,
    /// Number of the ply in the yarn.
    pub ply: u32,
    /// Axes x, y, z of the ply frame (Yu 2025, Eq. 1) in the fabric's frame: z along the ply, `w = y cos theta_i + z sin theta_i`.
    pub frame: [[f32; 3]; 3],
    /// Latitude of w [rad].
    pub theta_i: f32,
    /// Offset of the line along x of the ply frame [um]; within R for a ply that is met.
    pub h_um: f32,
    /// Where the point lies along the yarn, from the weave's origin [um]: its x on weft, its y on warp.
    pub along_um: f32,
    /// Where the point lies across the yarn, from its axis [um]: along y on weft, along x on warp.
    pub across_um: f32,
    /// Height of the yarn's axis over the fabric's middle plane [um].
    pub height_um: f32,
    /// The ply of the other family that the line meets below this one; `None` where one layer is met.
    pub below: Option<Below>,
}

/// A ply of the lower of two layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Below {
    /// Number of its yarn; of the other family.
    pub yarn: i32,
    /// Latitude of w on it [rad].
    pub theta_i: f32,
    /// Offset of the line [um].
    pub h_um: f32,
}

/// A gap, or a near miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Distances in the fabric's plane from the point to the edges west (-x), east (+x), south (-y) and north (+y), 0 or more [um]: how far the line
    /// may be moved before it meets a ply.
    pub aperture_um: [f32; 4],
    /// The plies at these edges that lie within the beam, |h| < R + d_cut. Those at two edges may be met by one line, at a crossing; none is `below` another.
    pub near: [Option<PlyHit>; 4],
}

/// The yarn on top at a point, whatever the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YarnPlace {
    /// Its family.
    pub family: Family,
    /// Its number, as in [`PlyHit`].
    pub yarn: i32,
    /// As in [`PlyHit`].
    pub along_um: f32,
    /// As in [`PlyHit`].
    pub across_um: f32,
    /// Direction of the yarn's axis in the fabric's frame, unit.
    pub tangent: [f32; 3],
    /// As in [`PlyHit`].
    pub height_um: f32,
    /// Whether a yarn of the other family lies below.
    pub is_double: bool,
}

/// Points beyond this distance from the origin count as at it [um]: 10 m, where single precision ends to tell fibers apart.
const FAR_UM: f32 = 1e7;

/// The two nearest yarns of a family at a point: the nearer one, then that on the point's other side.
#[derive(Clone, Copy)]
struct Pair {
    index: [i32; 2],
    /// Index in the draft's repeat.
    thread: [usize; 2],
    /// From their axes to the point [um].
    offset: [f32; 2],
    /// Distance from the nearer axis over the spacing, 0 to 1/2.
    fraction: f32,
    /// 1 where the point lies at greater coordinates than the nearer axis, else -1.
    side: f32,
}

impl Pair {
    fn new(position: f32, yarn: &Yarn, threads: usize) -> Pair {
        let (index, rest) = cell(position * yarn.per_spacing);
        let t = rest - 0.5;
        let (side, step) = if t < 0.0 { (-1.0, -1) } else { (1.0, 1) };
        let threads = threads as i32;
        let thread = index.rem_euclid(threads);
        let next = match thread + step {
            n if n < 0 => threads - 1,
            n if n >= threads => 0,
            n => n,
        };
        Pair {
            index: [index, index + step],
            thread: [thread as usize, next as usize],
            offset: [t * yarn.spacing, (t - side) * yarn.spacing],
            fraction: t.abs(),
            side,
        }
    }
}

/// Everything about a point that does not depend on the direction.
struct Point<'a> {
    fabric: &'a Fabric,
    at: [f32; 2],
    /// Of ends and of picks.
    pairs: [Pair; 2],
    /// Whether the warp is on top, `up[pick][end]` of the two nearest.
    up: [[bool; 2]; 2],
}

/// The axis of a yarn at a point, and a line's meeting with its plies.
#[derive(Clone, Copy)]
struct Meeting {
    which: usize,
    met: Met,
    /// Axes c, n, t of the yarn in the fabric's frame.
    axes: [[f32; 3]; 3],
    height: f32,
    /// w in the yarn's frame.
    w: [f32; 3],
}

impl<'a> Point<'a> {
    fn new(fabric: &'a Fabric, x_um: f32, y_um: f32) -> Point<'a> {
        // Not a number counts as 0, as far does.
        let at = [x_um, y_um].map(|p| if p.abs() <= FAR_UM { p } else { 0.0 });
        let draft = &fabric.draft;
        let pairs =
            [Pair::new(at[0], &fabric.yarns[0], draft.ends()), Pair::new(at[1], &fabric.yarns[1], draft.picks())];
        let up = pairs[1].thread.map(|pick| pairs[0].thread.map(|end| draft.up(pick, end)));
        Point { fabric, at, pairs, up }
    }

    /// Height [um] and slope of the axis of the nearer (0) or the other yarn of a family.
    fn axis(&self, family: Family, which: usize) -> (f32, f32) {
        let sides = match family {
            Family::Warp => [self.up[0][which], self.up[1][which]],
            Family::Weft => [!self.up[which][0], !self.up[which][1]],
        };
        let amplitude = self.fabric.yarns[family as usize].amplitude;
        let [from, to] = sides.map(|up| if up { amplitude } else { -amplitude });
        // Crossings stand where the other family's yarns lie.
        let Pair { fraction: u, side, .. } = self.pairs[family.other() as usize];
        let per_um = self.fabric.yarns[family.other() as usize].per_spacing;
        (from + (to - from) * u * u * (3.0 - 2.0 * u), side * (to - from) * 6.0 * u * (1.0 - u) * per_um)
    }

    /// Axes c, n, t of a yarn of this slope, in the fabric's frame.
    fn axes(family: Family, slope: f32) -> [[f32; 3]; 3] {
        let c = 1.0 / (1.0 + slope * slope).sqrt();
        let s = slope * c;
        match family {
            Family::Warp => [[-1.0, 0.0, 0.0], [0.0, -s, c], [0.0, c, s]],
            Family::Weft => [[0.0, 1.0, 0.0], [-s, 0.0, c], [c, 0.0, s]],
        }
    }

    fn along(&self, family: Family) -> f32 {
        self.at[family.other() as usize]
    }

    fn meet(&self, family: Family, which: usize, w: [f32; 3]) -> Meeting {
        let (height, slope) = self.axis(family, which);
        let axes = Self::axes(family, slope);
        let pair = &self.pairs[family as usize];
        let w = axes.map(|a| a[0] * w[0] + a[1] * w[1] + a[2] * w[2]);
        let yarn = &self.fabric.yarns[family as usize];
        let across = match family {
            Family::Warp => -pair.offset[which],
            Family::Weft => pair.offset[which],
        };
        let turns = yarn.turns(pair.index[which], family as u32, self.along(family));
        Meeting { which, met: yarn.meet(&Line { across, w, turns }), axes, height, w }
    }

    /// The yarn of a family whose plies the line meets.
    fn first(&self, family: Family, w: [f32; 3]) -> Option<Meeting> {
        let near = self.meet(family, 0, w);
        if near.met.hit {
            return Some(near);
        }
        let next = self.meet(family, 1, w);
        next.met.hit.then_some(next)
    }

    fn hit(&self, family: Family, meeting: &Meeting, below: Option<Below>) -> PlyHit {
        let pair = &self.pairs[family as usize];
        let [c, n, t] = meeting.axes;
        let frame = meeting.met.frame().map(|a| std::array::from_fn(|k| a[0] * c[k] + a[1] * n[k] + a[2] * t[k]));
        PlyHit {
            family,
            yarn: pair.index[meeting.which],
            ply: meeting.met.ply,
            frame,
            theta_i: meeting.met.theta_i(meeting.w),
            h_um: meeting.met.h,
            along_um: self.along(family),
            across_um: pair.offset[meeting.which],
            height_um: meeting.height,
            below,
        }
    }

    fn gap(&self, w: [f32; 3]) -> Gap {
        let mut gap = Gap { aperture_um: [0.0; 4], near: [None; 4] };
        for (k, family) in Family::EACH.into_iter().enumerate() {
            let yarn = &self.fabric.yarns[k];
            for which in 0..2 {
                let meeting = self.meet(family, which, w);
                // The nearer yarn lies west or south of a point at greater coordinates.
                let edge = 2 * k + usize::from((self.pairs[k].side > 0.0) == (which == 1));
                let Met { h, x, .. } = meeting.met;
                let open = (h.abs() - yarn.radius) / x[0].abs().max(1e-3);
                gap.aperture_um[edge] = open.max(0.0).min(yarn.spacing);
                if h.abs() < yarn.reach {
                    gap.near[edge] = Some(self.hit(family, &meeting, None));
                }
            }
        }
        gap
    }
}

/// A direction as it came, made unit; what is none counts as the face's normal.
fn unit(w: [f32; 3]) -> [f32; 3] {
    let squared = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    if (squared - 1.0).abs() < 1e-5 {
        return w;
    }
    if !(1e-12..1e12).contains(&squared) {
        return [0.0, 0.0, 1.0];
    }
    let scale = 1.0 / squared.sqrt();
    w.map(|v| v * scale)
}

impl Fabric {
    /// What the line through the point (x, y) [um] towards the light at `w` (unit, in the fabric's frame) meets first. From behind, `w[2] < 0`, the
    /// yarns of the other side are on top.
    ///
    /// Never fails: a `w` that is not unit is made so, one that is no direction counts as the face's normal, points that are no numbers or more than 10 m
    /// away as the origin.
    pub fn at(&self, x_um: f32, y_um: f32, w: [f32; 3]) -> Place {
        let w = unit(w);
        let point = Point::new(self, x_um, y_um);
        match Family::EACH.map(|family| point.first(family, w)) {
            [Some(warp), Some(weft)] => {
                let warp_on_top = point.up[weft.which][warp.which] != (w[2] < 0.0);
                let (family, top, low) =
                    if warp_on_top { (Family::Warp, warp, weft) } else { (Family::Weft, weft, warp) };
                let theta_i = low.met.theta_i(low.w);
                let yarn = point.pairs[family.other() as usize].index[low.which];
                Place::Ply(point.hit(family, &top, Some(Below { yarn, theta_i, h_um: low.met.h })))
            }
            [Some(warp), None] => Place::Ply(point.hit(Family::Warp, &warp, None)),
            [None, Some(weft)] => Place::Ply(point.hit(Family::Weft, &weft, None)),
            [None, None] => Place::Gap(point.gap(w)),
        }
    }

    /// The yarn on top at the point (x, y) [um], seen from the face or from the back; `None` in gaps between yarns. Points as in [`Fabric::at`].
    pub fn yarn_at(&self, x_um: f32, y_um: f32, from_back: bool) -> Option<YarnPlace> {
        let point = Point::new(self, x_um, y_um);
        let there = [0, 1].map(|k| point.pairs[k].offset[0].abs() < self.yarns[k].half_width);
        let family = match there {
            [false, false] => return None,
            [true, false] => Family::Warp,
            [false, true] => Family::Weft,
            _ if point.up[0][0] != from_back => Family::Warp,
            _ => Family::Weft,
        };
        let (height_um, slope) = point.axis(family, 0);
        let [_, _, tangent] = Point::axes(family, slope);
        let pair = &point.pairs[family as usize];
        Some(YarnPlace {
            family,
            yarn: pair.index[0],
            along_um: point.along(family),
            across_um: pair.offset[0],
            tangent,
            height_um,
            is_double: there == [true, true],
        })
    }
}
