//! Starting curves of stitches, before they are relaxed.
//!
//! In the plane a stitch of width W and course spacing H is the loop of Peirce (1947) in the form
//! ```text
//! x = W t / 2 pi + a sin 2 t,   y = -h cos t,   t from 0 to 2 pi
//! ```
//! It runs from the sinker (t = 0) over foot, leg and head (t = pi) back to the next sinker. The head is
//! wider than the foot (a > 0), and with h above H / 2 it reaches over the feet of the next course. The legs
//! of a knit stitch lie in front of the head of the loop below (z = -b cos 2 t), and its feet behind the legs
//! of that loop; a purl stitch is the opposite. The depth of a loop's lower half follows from its own stitch,
//! that of its upper half from the stitch that holds it.
//!
//! Heads and feet cross in a zone about each course. Between two zones only legs pass: there loops move
//! sideways, those in front lifted over the others, and there the legs of a loop that is held over several
//! courses are longer. Several loops on a needle lie one inside the other in the plane, and one behind the
//! other, and the feet of the stitch that holds them reach beyond all.

use super::needles::{Cell, Knitted, Loop, Place};
use std::f64::consts::{PI, TAU};

/// Half of a loop's height over H (h / H), and the lean of its legs over W (a / W).
pub const HEIGHT: f64 = 0.95;
pub const LEAN: f64 = 0.2;
/// Height over the yarn's radius of the legs.
pub const LEG: f64 = 1.2;
/// Number of points of a stitch.
pub const POINTS: usize = 48;
/// Distance of layers of yarn over its radius: loops on a needle, floats, and loops that move over others.
const LAYER: f64 = 2.2;
/// Part by which a loop is narrower and by which its head is lower for each loop around it.
const NARROWER: f64 = 0.15;
const LOWER: f64 = 0.04;
/// Distance from a course over H within which heads and feet lie, and that to which they are pressed where
/// loops move, so that there is room between the courses. Chosen: half of the height of a course is free.
const ZONE: f64 = 0.45;
const PRESSED: f64 = 0.25;
/// Distance from a zone over H at which loops move.
const ASIDE: f64 = 0.01;
/// Parts of a loop's width within which the feet of a stitch through several loops reach beyond all of them:
/// middle and half of the way out, middle and half of the way back.
const FOOT: [f64; 3] = [0.02, 0.135, 0.02];
/// Parts of the way between two zones at whose ends loops rise to their layer and come down; they move
/// between them.
const RISE: f64 = 0.1;
/// Parts of a float's width in which it goes behind the loops and comes back.
const DIP: f64 = 0.15;

/// A yarn over one period. After the last point follows the first one, translated by `shift` vectors of
/// the cell.
#[derive(Clone, Debug, PartialEq)]
pub struct StartCurve {
    pub points_um: Vec<[f64; 3]>,
    pub shift: [i32; 2],
    /// Yarn of one period in loops of plain stitches.
    pub loops: f64,
    /// Yarn up to each point and at the end, in any unit; absent: that of plain stitches, the curve's length.
    pub yarn: Option<Vec<f64>>,
    /// First point of each needle.
    pub needles: Vec<usize>,
}

/// Sizes of stitches.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Width of a wale [um].
    pub wale: f64,
    /// Spacing of courses [um].
    pub course: f64,
    /// Radius of the yarn [um].
    pub radius: f64,
    /// Height of the face and back wales of a rib [um].
    pub lift: f64,
    /// Whether heads and feet are pressed to make room between the courses.
    pub is_pressed: bool,
}

/// A leg of a loop at the height of a course.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Leg {
    /// Wales to the right of the needle that makes the loop.
    wale: f64,
    /// Width over that of a loop which no other encloses.
    width: f64,
    /// Height by its place among the loops of its needle, over the yarn's radius.
    layer: f64,
    /// Number of loops around it.
    around: f64,
}

/// Form of the yarn at a needle in a course.
#[derive(Clone, Debug, PartialEq)]
struct Form {
    /// Side of its sinkers and of its lower half.
    own: f64,
    /// Side of its upper half.
    side: f64,
    is_open: bool,
    /// Number of loops that it holds beyond the first.
    more: f64,
    /// At its own course and at each one after, up to that of its holder.
    legs: Vec<Leg>,
    /// Height over the yarn's radius of the way between two courses, where it moves.
    lifts: Vec<Option<f64>>,
    /// Height of a float over the yarn's radius; absent: it is a loop.
    float: Option<f64>,
}

const STRAIGHT: Leg = Leg { wale: 0.0, width: 1.0, layer: 0.0, around: 0.0 };

impl Form {
    fn plain(own: f64, side: f64) -> Form {
        let (legs, lifts) = (vec![STRAIGHT; 2], vec![None]);
        Form { own, side, is_open: false, more: 0.0, legs, lifts, float: None }
    }

    fn new(of: &Loop) -> Form {
        let leg = |place: &Place| leg(of, place);
        let lift = |(lift, place): (&Option<usize>, &Place)| lift.map(|n| LEG + LAYER * (n + place.back) as f64);
        Form {
            own: of.own,
            side: of.side,
            is_open: of.is_open,
            more: of.holds.len().saturating_sub(1) as f64,
            legs: of.places.iter().map(leg).collect(),
            lifts: of.lifts.iter().zip(&of.places).map(lift).collect(),
            float: None,
        }
    }

    /// By how much its legs are longer than those of a plain loop if they are straight [um].
    fn longer(&self, size: &Size) -> f64 {
        let of = |legs: &[Leg]| size.course.hypot(size.wale * (legs[1].wale - legs[0].wale));
        2.0 * (self.legs.windows(2).map(of).sum::<f64>() - size.course)
    }

    /// Height over the yarn's radius of its legs at a course.
    fn height(&self, leg: &Leg) -> f64 {
        0.5 * (self.own + self.side) * LEG + leg.layer
    }
}

/// A loop's leg at a place.
fn leg(of: &Loop, place: &Place) -> Leg {
    // The first loop of a knit stitch is that in front, of a purl stitch that at the back.
    let layer = if of.side > 0.0 { -LAYER * place.front as f64 } else { LAYER * place.back as f64 };
    let around = place.around as f64;
    Leg { wale: (place.wale - of.made[1]) as f64, width: 1.0 / (1.0 + NARROWER * around), layer, around }
}

/// The form of a cell.
fn form(knitted: &Knitted, cell: &Cell) -> Form {
    match cell {
        Cell::Loop(id) => Form::new(&knitted.loops[*id]),
        Cell::Float(held) => {
            let height = |(id, at): &(usize, usize)| {
                let of = &knitted.loops[*id];
                Form::new(of).height(&leg(of, &of.places[*at]))
            };
            let lowest = held.iter().map(height).fold(f64::INFINITY, f64::min);
            Form { float: Some((lowest - LAYER).min(-LEG)), ..Form::plain(1.0, 1.0) }
        }
    }
}

/// Curve of a course of a knitted repeat; `at` is the course's height in courses.
///
/// A loop that is moved or held has the yarn of a plain one and that by which its legs are longer, if they
/// lie straight from course to course. A float has as much as its curve is long.
pub fn course(knitted: &Knitted, course: usize, at: f64, size: &Size) -> StartCurve {
    let forms: Vec<Form> = knitted.cells[course].iter().map(|cell| form(knitted, cell)).collect();
    let plain: Vec<Form> = forms.iter().map(|form| Form::plain(form.own, form.side)).collect();
    let (points_um, needles) = points(&forms, at, size);
    let mut curve = StartCurve { points_um, shift: [1, 0], loops: forms.len() as f64, yarn: None, needles };
    if forms == plain {
        return curve;
    }
    let period = forms.len() as f64 * size.wale;
    let steps = lengths(&curve.points_um, &curve.needles, period);
    let (points_um, needles) = points(&plain, at, size);
    let of_plain = lengths(&points_um, &needles, period);
    let mut yarn = vec![0.0];
    let mut all = 0.0;
    for (w, form) in forms.iter().enumerate() {
        let (own, plain): (f64, f64) = (steps[w].iter().sum(), of_plain[w].iter().sum());
        let wanted = if form.float.is_some() { own } else { plain + form.longer(size) };
        for length in &steps[w] {
            all += length * wanted / own;
            yarn.push(all);
        }
    }
    curve.loops *= all / of_plain.iter().flatten().sum::<f64>();
    curve.yarn = Some(yarn);
    curve
}

/// Lengths of the steps from point to point, by needle; a period along x is given.
fn lengths(points: &[[f64; 3]], needles: &[usize], period: f64) -> Vec<Vec<f64>> {
    let n = points.len();
    let step = |i: usize| {
        let (p, mut q) = (points[i], points[(i + 1) % n]);
        q[0] += if i + 1 == n { period } else { 0.0 };
        (0..3).map(|k| (q[k] - p[k]).powi(2)).sum::<f64>().sqrt()
    };
    let ends = needles.iter().skip(1).chain(std::iter::once(&n));
    needles.iter().zip(ends).map(|(start, end)| (*start..*end).map(step).collect()).collect()
}

/// Smooth step: 0 for x below -1, 1 above 1.
fn smooth(x: f64) -> f64 {
    let t = (0.5 * (x + 1.0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Height with heads and feet pressed to their course; heights are in courses.
fn pressed(y: f64) -> f64 {
    let course = y.round();
    let off = y - course;
    let moved = match off.abs() {
        in_zone if in_zone <= ZONE => in_zone * PRESSED / ZONE,
        beyond => PRESSED + (beyond - ZONE) * (0.5 - PRESSED) / (0.5 - ZONE),
    };
    course + moved.copysign(off)
}

/// Points of a course, and the first of each needle.
fn points(forms: &[Form], at: f64, size: &Size) -> (Vec<[f64; 3]>, Vec<usize>) {
    let count = forms.len();
    let (mut points, mut needles) = (Vec::with_capacity(count * POINTS), Vec::with_capacity(count));
    for (w, form) in forms.iter().enumerate() {
        needles.push(points.len());
        let neighbors = [w + count - 1, w + 1].map(|other| forms[other % count].own);
        let needle = Needle { form, neighbors, at: [w as f64, at], size };
        match form.float {
            Some(height) => needle.float(height, &mut points),
            None => needle.stitch(&mut points),
        }
    }
    if size.is_pressed {
        points.iter_mut().for_each(|point| point[1] = size.course * pressed(point[1] / size.course));
    }
    (points, needles)
}

/// Yarn at a needle in a course.
struct Needle<'a> {
    form: &'a Form,
    /// Sides of the sinkers of its neighbors.
    neighbors: [f64; 2],
    /// Its wale and its course.
    at: [f64; 2],
    size: &'a Size,
}

impl Needle<'_> {
    /// What the sinkers' side is at `t` beyond that of its own, to meet the neighbors in the middle.
    fn sinker(&self, t: f64) -> f64 {
        let [before, after] = self.neighbors.map(|side| side - self.form.own);
        before * (1.0 - smooth(t * 12.0 / PI)) + after * smooth((t - TAU) * 12.0 / PI)
    }

    /// Points of a float.
    fn float(&self, height: f64, points: &mut Vec<[f64; 3]>) {
        let (size, [w, at]) = (self.size, self.at);
        for i in 0..POINTS {
            let s = (i as f64 + 0.5) / POINTS as f64;
            let sinker = -LEG * (self.form.own + self.sinker(TAU * s));
            let down = smooth(2.0 * s.min(1.0 - s) / DIP - 1.0);
            let z = sinker + down * (height - sinker);
            points.push([size.wale * (w + s), size.course * (at + 0.5 - HEIGHT), size.radius * z]);
        }
    }

    /// Points of a loop.
    fn stitch(&self, points: &mut Vec<[f64; 3]>) {
        let (form, size, [w, at]) = (self.form, self.size, self.at);
        let (first, last) = (&form.legs[0], &form.legs[form.legs.len() - 1]);
        let held = (form.legs.len() - 2) as f64;
        for i in 0..POINTS {
            let t = TAU * (i as f64 + 0.5) / POINTS as f64;
            if i == POINTS / 4 {
                points.extend(self.ways(-1.0));
            } else if i == 3 * POINTS / 4 {
                points.extend(self.ways(1.0).into_iter().rev());
            }
            let is_upper = (POINTS / 4..3 * POINTS / 4).contains(&i);
            // Between its sinkers the loop changes to the side of its holder and back.
            let up = smooth((t - 0.5 * PI) * 4.0 / PI) * (1.0 - smooth((t - 1.5 * PI) * 4.0 / PI));
            let side = form.own + up * (form.side - form.own) + self.sinker(t);
            let share = (t / TAU).min(1.0 - t / TAU);
            let mut x = size.wale * (w + t / TAU) + LEAN * size.wale * (2.0 * t).sin();
            let mut y = size.course * (at + 0.5 + if is_upper { held } else { 0.0 });
            let mut reach = HEIGHT * size.course;
            let mut z = side * (size.lift - LEG * size.radius * (2.0 * t).cos());
            if is_upper && *last != STRAIGHT {
                let middle = size.wale * (w + 0.5);
                x = middle + size.wale * last.wale + last.width * (x - middle);
                reach *= 1.0 - if t.cos() < 0.0 { LOWER * last.around } else { 0.0 };
                z += size.radius * last.layer;
            } else if !is_upper && form.is_open {
                // It rises from its sinker straight to its leg.
                let (leg, sinker) = (form.height(first), -LEG * (form.own + self.sinker(t)));
                x = size.wale * (w + t / TAU);
                z = size.radius * (sinker + smooth(8.0 * share - 1.0) * (leg - sinker));
            } else if !is_upper && form.more > 0.0 {
                let foot = smooth((share - FOOT[0]) / FOOT[0]) * (1.0 - smooth((share - FOOT[1]) / FOOT[2]));
                z -= form.own * LAYER * size.radius * form.more * foot;
            }
            y -= reach * t.cos();
            points.push([x, y, z]);
        }
    }

    /// Points of a leg between the zones of its courses, upwards; of the left leg (-1) or the right one (1).
    /// There are none where it is that of a plain stitch.
    fn ways(&self, leg: f64) -> Vec<[f64; 3]> {
        let (form, size, [w, at]) = (self.form, self.size, self.at);
        let mut points = Vec::new();
        if form.legs == [STRAIGHT; 2] && form.lifts == [None] {
            return points;
        }
        for (i, lift) in form.lifts.iter().enumerate() {
            let ends = [&form.legs[i], &form.legs[i + 1]]
                .map(|end| (size.wale * (w + 0.5 + end.wale + 0.25 * leg * end.width), size.radius * form.height(end)));
            let mut add = |s: f64, z: Option<f64>| {
                let moved = ((s - RISE) / (1.0 - 2.0 * RISE)).clamp(0.0, 1.0);
                let of = |a: f64, b: f64| a + moved * (b - a);
                let y = at + i as f64 + ZONE + ASIDE + s * (1.0 - 2.0 * (ZONE + ASIDE));
                points.push([of(ends[0].0, ends[1].0), size.course * y, z.unwrap_or(of(ends[0].1, ends[1].1))]);
            };
            let lift = lift.map(|lift| size.radius * lift);
            add(0.0, None);
            add(RISE, lift);
            add(1.0 - RISE, lift);
            add(1.0, None);
        }
        points
    }
}
