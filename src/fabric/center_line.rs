//! Center lines of yarns in double precision, and by how much the tubes about them intersect.
//!
//! The axis of a yarn lies at +A over the crossings where it is on top and at -A where it is below, A its
//! amplitude, joined by arcs and straight lines (`profile.rs`).
//!
//! Each yarn lies within a tube about its center line, whose radius is half of the yarn's width. Center lines
//! of one family keep the distance of their spacing, which is not below the width. Those of a warp and a weft
//! yarn come close where they cross: the distance of two points is a function of their places along the
//! yarns, and its least value is found on a grid that is then refined. It depends on the sides of five
//! crossings, so that 32 cases serve a draft of any size.

use super::profile::Profile;
use super::{Fabric, YarnSet};
use crate::spec::Handedness;

/// A point of a yarn's center line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CenterPoint {
    /// Position in the fabric's frame [um].
    pub point_um: [f64; 3],
    /// Direction of the yarn, unit, to greater y on warp and to greater x on weft.
    pub tangent: [f64; 3],
    /// Curvature [1/um], positive where the line bends towards the face.
    pub curvature_per_um: f64,
}

/// Where a warp yarn and a weft yarn intersect most, or come nearest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Depth of the intersection of the tubes [um]; negative where they are apart, by that distance.
    pub depth_um: f64,
    /// Number of the warp yarn, in the first repeat.
    pub warp: i32,
    /// Number of the weft yarn, in the first repeat.
    pub weft: i32,
    /// Where on the warp yarn, as y from the crossing [um].
    pub along_warp_um: f64,
    /// Where on the weft yarn, as x from the crossing [um].
    pub along_weft_um: f64,
}

/// Points a side of the grid on which the least distance is looked for, over a spacing to either side of the
/// crossing.
const GRID: i32 = 48;
/// Step at which the refinement ends [um].
const FINEST_UM: f64 = 1e-6;

/// Height between two crossings at `x` um from the first, on top at each or not, its slope and its second
/// derivative.
fn joined(profile: &Profile, from: bool, to: bool, x: f64) -> [f64; 3] {
    let side = if from { 1.0 } else { -1.0 };
    if from == to { [side * profile.amplitude, 0.0, 0.0] } else { profile.at(x).map(|v| side * v) }
}

impl Fabric {
    /// Amplitude A of the height of a family's center lines [um]: they lie at +A and -A over the crossings.
    pub fn amplitude_um(&self, family: YarnSet) -> f64 {
        self.profile(family).amplitude
    }

    fn profile(&self, family: YarnSet) -> Profile {
        self.shapes[family as usize].profile(&self.shapes[family.other() as usize])
    }

    /// Whether yarn `yarn` of `family` is on top where it crosses yarn `other` of the other family.
    pub fn is_on_top(&self, family: YarnSet, yarn: i32, other: i32) -> bool {
        let (end, pick) = match family {
            YarnSet::Warp => (yarn, other),
            YarnSet::Weft => (other, yarn),
        };
        // Drafts have no more threads than numbers of 32 bits.
        let wrap = |n: i32, count: usize| n.rem_euclid(count.max(1) as i32) as usize;
        let up = self.draft.up(wrap(pick, self.draft.picks()), wrap(end, self.draft.ends()));
        up == (family == YarnSet::Warp)
    }

    /// The center line of yarn `yarn` of `family` at `along_um`, its y on warp and its x on weft. Yarn n lies
    /// at `(n + 1/2) spacing` across.
    pub fn center_line(&self, family: YarnSet, yarn: i32, along_um: f64) -> CenterPoint {
        let step = self.shapes[family.other() as usize].spacing_um;
        let t = along_um / step - 0.5;
        let first = t.floor();
        let [from, to] = [0, 1].map(|k| self.is_on_top(family, yarn, (first as i32).wrapping_add(k)));
        let [height, slope, second] = joined(&self.profile(family), from, to, (t - first) * step);
        let across = (f64::from(yarn) + 0.5) * self.shapes[family as usize].spacing_um;
        let c = 1.0 / (1.0 + slope * slope).sqrt();
        let (point_um, tangent) = match family {
            YarnSet::Warp => ([across, along_um, height], [0.0, c, slope * c]),
            YarnSet::Weft => ([along_um, across, height], [c, 0.0, slope * c]),
        };
        CenterPoint { point_um, tangent, curvature_per_um: second * c * c * c }
    }

    /// Turns of ply 0 of a yarn about the yarn's axis at `along_um`; 0 for a yarn of one ply. Ply k of P is
    /// `k / P` turns further.
    pub fn ply_turns(&self, family: YarnSet, yarn: i32, along_um: f64) -> f64 {
        let shape = &self.shapes[family as usize];
        if shape.plies < 2 {
            return 0.0;
        }
        let hand = if shape.handedness == Handedness::Z { 1.0 } else { -1.0 };
        let begin = f64::from(self.yarns[family as usize].turns(yarn, family as u32, 0.0));
        begin + shape.ply_pitch_um.map_or(0.0, |pitch| hand * along_um / pitch)
    }

    /// Least radius by which the center lines of a family bend [um]; infinite where no yarn changes sides. A
    /// yarn cannot bend with a radius of less than half its width.
    pub fn least_bend_radius_um(&self, family: YarnSet) -> f64 {
        let threads = |f: YarnSet| self.draft.threads(f) as i32;
        let other = family.other();
        let bends = (0..threads(family)).any(|yarn| {
            let top = self.is_on_top(family, yarn, 0);
            (1..threads(other)).any(|n| self.is_on_top(family, yarn, n) != top)
        });
        let profile = self.profile(family);
        if bends && profile.amplitude > 0.0 { profile.radius } else { f64::INFINITY }
    }

    /// Where the tubes about a warp yarn and a weft yarn intersect most over the repeat, or come nearest; the
    /// first such crossing by pick and end.
    pub fn largest_overlap(&self) -> Overlap {
        let mut cases: [Option<[f64; 3]>; 32] = [None; 32];
        let mut worst =
            Overlap { depth_um: f64::NEG_INFINITY, warp: 0, weft: 0, along_warp_um: 0.0, along_weft_um: 0.0 };
        for weft in 0..self.draft.picks() as i32 {
            for warp in 0..self.draft.ends() as i32 {
                // Around the crossing: on the warp yarn before, at and after it, on the weft yarn before and
                // after.
                let up = |end: i32, pick: i32| self.is_on_top(YarnSet::Warp, end, pick);
                let around =
                    [up(warp, weft - 1), up(warp, weft), up(warp, weft + 1), up(warp - 1, weft), up(warp + 1, weft)];
                let case = around.iter().fold(0, |case, up| 2 * case + usize::from(*up));
                let [distance, y, x] = *cases[case].get_or_insert_with(|| self.least_distance(&around));
                let depth_um = 0.5 * (self.shapes[0].width_um() + self.shapes[1].width_um()) - distance;
                // A later crossing of the same case is no worse.
                if depth_um > worst.depth_um {
                    worst = Overlap { depth_um, warp, weft, along_warp_um: y, along_weft_um: x };
                }
            }
        }
        worst
    }

    /// Least distance of the two center lines about a crossing [um], and where: from the crossing along the
    /// warp yarn and along the weft yarn.
    fn least_distance(&self, around: &[bool; 5]) -> [f64; 3] {
        let [warp, weft] = YarnSet::EACH.map(|family| self.profile(family));
        let [s_warp, s_weft] = [0, 1].map(|k| self.shapes[k].spacing_um);
        let height = |profile: &Profile, at: f64, before: bool, here: bool, after: bool| {
            joined(profile, here, if at < 0.0 { before } else { after }, at.abs().min(profile.step))[0]
        };
        let distance2 = |y: f64, x: f64| {
            let z_warp = height(&warp, y, around[0], around[1], around[2]);
            let z_weft = height(&weft, x, !around[3], !around[1], !around[4]);
            x * x + y * y + (z_warp - z_weft).powi(2)
        };
        let mut best = [distance2(0.0, 0.0), 0.0, 0.0];
        let at = |i: i32, step: f64| step * f64::from(i) / f64::from(GRID);
        for i in -GRID..=GRID {
            for j in -GRID..=GRID {
                let (y, x) = (at(i, s_weft), at(j, s_warp));
                if distance2(y, x) < best[0] {
                    best = [distance2(y, x), y, x];
                }
            }
        }
        // Pattern search: the best of the eight neighbors, or half the step.
        let mut step = [s_weft, s_warp].map(|s| s / f64::from(GRID));
        while step[0].max(step[1]) > FINEST_UM {
            let mut next = best;
            for (dy, dx) in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)] {
                let (y, x) = (best[1] + step[0] * f64::from(dy), best[2] + step[1] * f64::from(dx));
                let here = distance2(y, x);
                if here < next[0] && y.abs() <= s_weft && x.abs() <= s_warp {
                    next = [here, y, x];
                }
            }
            if next[0] < best[0] {
                best = next;
            } else {
                step = step.map(|s| 0.5 * s);
            }
        }
        [best[0].sqrt(), best[1], best[2]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fabric::{Draft, Hit, YarnShape};

    fn shape(spacing_um: f64, crimp: f64) -> YarnShape {
        YarnShape {
            plies: 1,
            ply_radius_um: 50.0,
            ply_pitch_um: None,
            handedness: Handedness::Z,
            spacing_um,
            crimp,
            d_cut_um: 20.0,
        }
    }

    fn fabrics() -> Vec<Fabric> {
        let of = |draft, warp, weft| Fabric::new(draft, [warp, weft]).unwrap();
        vec![
            of(Draft::plain(), shape(260.0, 0.4), shape(300.0, 0.6)),
            of(Draft::satin(5, 2).unwrap(), shape(102.0, 0.3), shape(200.0, 0.2)),
            of(Draft::twill(3, 1).unwrap(), shape(120.0, 0.7), shape(140.0, 0.1)),
        ]
    }

    /// Against what evaluation says of a point: height and the direction of a yarn of one ply.
    #[test]
    fn center_lines_are_those_that_lines_meet() {
        let mut compared = [0; 2];
        for fabric in fabrics() {
            let [width, height] = fabric.repeat_um();
            for i in 0..4000 {
                let (x, y) =
                    (width * ((f64::from(i) * 0.754_877).fract() - 0.3), height * ((f64::from(i) * 0.569_84).fract()));
                let Hit::Ply(hit) = fabric.at(x as f32, y as f32, [0.0, 0.0, 1.0]) else { continue };
                let along = if hit.family == YarnSet::Warp { y } else { x };
                let center = fabric.center_line(hit.family, hit.yarn, along);
                compared[hit.family as usize] += 1;
                let off = (center.point_um[2] - f64::from(hit.height_um)).abs();
                assert!(off < 2e-3, "height {} against {}", hit.height_um, center.point_um[2]);
                for (got, want) in hit.frame[2].iter().zip(center.tangent) {
                    assert!(
                        (f64::from(*got) - want).abs() < 1e-4,
                        "tangent {:?} against {:?}",
                        hit.frame[2],
                        center.tangent
                    );
                }
            }
        }
        assert!(compared.iter().all(|n| *n > 1000), "{compared:?}");
    }

    /// Tangent and curvature against differences of the points.
    #[test]
    fn tangents_and_curvatures_are_derivatives() {
        for fabric in fabrics() {
            for (family, yarn) in [(YarnSet::Warp, 0), (YarnSet::Warp, -3), (YarnSet::Weft, 1), (YarnSet::Weft, 7)] {
                let k = if family == YarnSet::Warp { 1 } else { 0 };
                for i in 0..200 {
                    let (s, d) = (13.0 + 7.77 * f64::from(i), 1e-3);
                    let [a, b, c] = [-d, 0.0, d].map(|d| fabric.center_line(family, yarn, s + d));
                    let slope = (c.point_um[2] - a.point_um[2]) / (2.0 * d);
                    assert!((b.tangent[2] / b.tangent[k] - slope).abs() < 1e-5);
                    let turn = (c.tangent[2].asin() - a.tangent[2].asin()) / (2.0 * d) * b.tangent[k];
                    // At a crossing the curvature jumps where the yarn goes on straight.
                    let jumps = (a.curvature_per_um - c.curvature_per_um).abs() > 1e-4;
                    assert!(jumps || (turn - b.curvature_per_um).abs() < 1e-6, "{turn} against {}", b.curvature_per_um);
                }
            }
            for family in YarnSet::EACH {
                let sharpest = (0..4000)
                    .map(|i| fabric.center_line(family, 0, 0.5 * f64::from(i)).curvature_per_um.abs())
                    .fold(0.0, f64::max);
                let least = fabric.least_bend_radius_um(family);
                assert!((sharpest * least - 1.0).abs() < 0.02, "{} against {least}", 1.0 / sharpest);
            }
        }
    }

    /// Against points on all pairs of center lines of the repeat, with no search.
    #[test]
    fn overlaps_are_those_of_all_pairs_of_points() {
        for fabric in fabrics() {
            let found = fabric.largest_overlap();
            let mut least = f64::INFINITY;
            let step = |f: YarnSet| fabric.shape(f).spacing_um;
            for warp in 0..fabric.draft().ends() as i32 {
                for weft in 0..fabric.draft().picks() as i32 {
                    let points = |family: YarnSet, yarn: i32, at: i32| -> Vec<[f64; 3]> {
                        let s = step(family.other());
                        let place = |i: i32| s * (f64::from(at) + 0.5 + f64::from(i) / 100.0);
                        (-80..=80).map(|i| fabric.center_line(family, yarn, place(i)).point_um).collect()
                    };
                    let (a, b) = (points(YarnSet::Warp, warp, weft), points(YarnSet::Weft, weft, warp));
                    for p in &a {
                        for q in &b {
                            least = f64::min(least, (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>());
                        }
                    }
                }
            }
            let want = 100.0 - least.sqrt();
            assert!(found.depth_um >= want - 1e-9 && found.depth_um < want + 0.05, "{found:?} against {want}");
        }
    }

    /// Yarns whose crimps add up to 1 touch, along arcs, as long as arcs of the sum of their radii fit;
    /// nearer ones intersect beside the crossing.
    #[test]
    fn round_yarns_touch_until_they_jam() {
        let of = |spacing| Fabric::new(Draft::plain(), [shape(spacing, 0.5), shape(spacing, 0.5)]).unwrap();
        for spacing in [260.0, 200.0, 174.0] {
            let fabric = of(spacing);
            assert!((fabric.least_bend_radius_um(YarnSet::Warp) - 100.0).abs() < 1e-9);
            assert!(fabric.largest_overlap().depth_um.abs() < 1e-4, "{spacing}: {:?}", fabric.largest_overlap());
        }
        // Peirce's jammed plain cloth: a spacing of sqrt(3) times the radii's sum.
        let dense = of(150.0);
        assert!(dense.least_bend_radius_um(YarnSet::Warp) < 100.0);
        let found = dense.largest_overlap();
        assert!(found.depth_um > 0.5 && found.along_warp_um.abs() > 5.0, "{found:?}");
        // Of uneven amplitudes: a satin's warp bends about nearly straight weft.
        let satin = Fabric::new(Draft::satin(5, 2).unwrap(), [shape(102.0, 0.95), shape(250.0, 0.05)]).unwrap();
        assert!(satin.largest_overlap().depth_um < 1e-4, "{:?}", satin.largest_overlap());
    }
}
