//! What is at a point of the fabric: the plies and gaps that a line meets, in their order; the yarn on top,
//! by a side.
//!
//! A line meets the plies of the first yarn along it (`flight.rs`). The draft says on which side of a
//! crossing a yarn passes; its axis lies at +amplitude where it is on top and at -amplitude where it is
//! below, joined from crossing to crossing by arcs and a straight line (`profile.rs`). An oblique line meets
//! a yarn beyond its width: gaps close towards grazing light, as they do.

use super::yarn::{Yarn, cell};
use super::{Fabric, YarnSet};

/// What a line meets. It lives on the stack of one query: a box would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hit {
    /// A ply.
    Ply(PlyHit),
    /// No ply.
    Gap(Gap),
}

/// A ply at the line's theta_i and h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyHit {
    /// Yarn set of the yarn.
    pub family: YarnSet,
    /// Number of the yarn, counted from the origin; negative on the other side of it.
    pub yarn: i32,
    /// Number of the ply in the yarn.
    pub ply: u32,
    /// Axes x, y, z of the ply frame (Yu 2025, Eq. 1) in the fabric's frame: z along the ply,
    /// `w = y cos theta_i + z sin theta_i`.
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
    /// Whether a yarn of the other family lies over or under it there.
    pub is_double: bool,
}

/// A gap, or a near miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Distances in the fabric's plane from the point to the edges west (-x), east (+x), south (-y) and north
    /// (+y), 0 or more [um]: how far the line may be moved before it meets a ply. Of edges beyond the beam,
    /// |h| > R + d_cut, the yarns' spacing.
    pub aperture_um: [f32; 4],
    /// The plies at these edges that lie within the beam.
    pub near: [Option<PlyHit>; 4],
}

/// The yarn on top at a point, whatever the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YarnPlace {
    /// Its family.
    pub family: YarnSet,
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

/// Points beyond this distance from the origin count as at it [um]: 10 m, where single precision ends to tell
/// fibers apart.
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

impl<'a> Point<'a> {
    fn new(fabric: &'a Fabric, x_um: f32, y_um: f32) -> Point<'a> {
        let at = position(x_um, y_um);
        let draft = &fabric.draft;
        let pairs =
            [Pair::new(at[0], &fabric.yarns[0], draft.ends()), Pair::new(at[1], &fabric.yarns[1], draft.picks())];
        let up = pairs[1].thread.map(|pick| pairs[0].thread.map(|end| draft.up(pick, end)));
        Point { fabric, at, pairs, up }
    }

    /// Height [um] and slope of the axis of the nearer (0) or the other yarn of a family.
    fn axis(&self, family: YarnSet, which: usize) -> (f32, f32) {
        let sides = match family {
            YarnSet::Warp => [self.up[0][which], self.up[1][which]],
            YarnSet::Weft => [!self.up[which][0], !self.up[which][1]],
        };
        // Crossings stand where the other family's yarns lie.
        let Pair { fraction: u, side, .. } = self.pairs[family.other() as usize];
        let (height, slope) = self.fabric.yarns[family as usize].profile.joined(sides[0], sides[1], u);
        (height, side * slope)
    }
}

/// Axes c, n, t of a yarn of this slope, in the fabric's frame.
#[inline]
pub(super) fn axes(family: YarnSet, slope: f32) -> [[f32; 3]; 3] {
    let c = 1.0 / (1.0 + slope * slope).sqrt();
    let s = slope * c;
    match family {
        YarnSet::Warp => [[-1.0, 0.0, 0.0], [0.0, -s, c], [0.0, c, s]],
        YarnSet::Weft => [[0.0, 1.0, 0.0], [-s, 0.0, c], [c, 0.0, s]],
    }
}

/// Plies beside the first that a line meets, of which a query keeps the light.
pub(crate) const MAX_NEAR: usize = 4;

impl Gap {
    /// Without a ply near it.
    pub(super) fn open(fabric: &Fabric) -> Gap {
        let [warp, weft] = [0, 1].map(|k| fabric.yarns[k].spacing);
        Gap { aperture_um: [warp, warp, weft, weft], near: [None; 4] }
    }

    /// With the edge of a ply, if it is nearer than what was there.
    pub(super) fn close(&mut self, fabric: &Fabric, hit: &PlyHit) {
        let k = hit.family as usize;
        // By how much h changes when the line is moved along x or y.
        let per_um = hit.frame[0][k];
        let open = (hit.h_um.abs() - fabric.yarns[k].radius).max(0.0) / per_um.abs().max(1e-3);
        let edge = 2 * k + usize::from((hit.h_um < 0.0) == (per_um > 0.0));
        if open < self.aperture_um[edge] {
            self.aperture_um[edge] = open;
            self.near[edge] = Some(*hit);
        }
    }
}

/// A point of the plane. Not a number counts as 0, as far does.
pub(crate) fn position(x_um: f32, y_um: f32) -> [f32; 2] {
    [x_um, y_um].map(|p| if p.abs() <= FAR_UM { p } else { 0.0 })
}

/// A direction as it came, made unit; what is none counts as the face's normal.
pub(crate) fn unit(w: [f32; 3]) -> [f32; 3] {
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
    /// What the line through the point (x, y) of the middle plane [um] towards the light at `w` (unit, in the
    /// fabric's frame) meets first. From behind, `w[2] < 0`, the yarns of the other side are on top.
    ///
    /// Never fails: a `w` that is not unit is made so, one that is no direction counts as the face's normal,
    /// points that are no numbers or more than 10 m away as the origin.
    pub fn at(&self, x_um: f32, y_um: f32, w: [f32; 3]) -> Hit {
        let mut flight = self.flight_through(position(x_um, y_um), unit(w));
        let mut gap = Gap::open(self);
        while let Some(near) = flight.next_near() {
            if near.is_hit {
                return Hit::Ply(near.hit);
            }
            gap.close(self, &near.hit);
        }
        Hit::Gap(gap)
    }

    /// The yarn on top at the point (x, y) [um], seen from the face or from the back; `None` in gaps between
    /// yarns. Points as in [`Fabric::at`].
    pub fn yarn_at(&self, x_um: f32, y_um: f32, from_back: bool) -> Option<YarnPlace> {
        let point = Point::new(self, x_um, y_um);
        let there = [0, 1].map(|k| point.pairs[k].offset[0].abs() < self.yarns[k].half_width);
        let family = match there {
            [false, false] => return None,
            [true, false] => YarnSet::Warp,
            [false, true] => YarnSet::Weft,
            _ if point.up[0][0] != from_back => YarnSet::Warp,
            _ => YarnSet::Weft,
        };
        let (height_um, slope) = point.axis(family, 0);
        let [_, _, tangent] = axes(family, slope);
        let pair = &point.pairs[family as usize];
        Some(YarnPlace {
            family,
            yarn: pair.index[0],
            along_um: point.at[family.other() as usize],
            across_um: pair.offset[0],
            tangent,
            height_um,
            is_double: there == [true, true],
        })
    }
}
