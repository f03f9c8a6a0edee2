//! Stitches: starting curves of knitted yarns, before they are relaxed.
//!
//! In the plane a stitch of width W and course spacing H is the loop of Peirce (1947) in the form
//! ```text
//! x = W t / 2 pi + a sin 2 t,   y = -h cos t,   t from 0 to 2 pi
//! ```
//! It runs from the sinker (t = 0) over foot, leg and head (t = pi) back to the next sinker. The head is
//! wider than the foot (a > 0), and with h above H / 2 it reaches over the feet of the next course. The legs
//! of a knit stitch lie in front of the head of the loop below (z = -b cos 2 t), and its feet behind the legs
//! of that loop; a purl stitch is the opposite. The depth of a loop's lower half follows from its own stitch,
//! that of its upper half from the stitch of the next course.

use std::f64::consts::{PI, TAU};

/// Maximum number of rows and of columns of a grid.
const MAX_GRID: usize = 64;
/// Half of a loop's height over H (h / H), and the lean of its legs over W (a / W).
const HEIGHT: f64 = 0.95;
const LEAN: f64 = 0.2;
/// Heights over the yarn's radius of the legs, and of the face and back wales of ribs.
const LEG: f64 = 1.2;
const WALE: f64 = 1.4;
/// Number of points of a stitch.
const POINTS: usize = 48;

/// A knit.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Knit {
    /// Rows of knit (true) and purl stitches as they appear on the face, the first course first.
    Grid { rows: Vec<Vec<bool>>, is_rib: bool },
    /// Two interlocked 1 x 1 ribs, back to back.
    Interlock,
    /// A warp knit of one bar with open laps: each yarn makes loops on two wales alternately.
    Tricot,
}

/// A yarn over one period. After the last point follows the first one, translated by `shift` vectors of the
/// cell.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StartCurve {
    pub points_um: Vec<[f64; 3]>,
    pub shift: [i32; 2],
    /// Number of stitches of one period.
    pub stitches: usize,
}

impl Knit {
    /// Parses a knit from rows of `K` and `P`; the last row is the first course.
    ///
    /// # Errors
    /// A description of what is wrong with the rows.
    pub fn from_rows(rows: &[String]) -> Result<Knit, String> {
        let width = rows.first().map_or(0, String::len);
        if rows.is_empty() || rows.len() > MAX_GRID || !(1..=MAX_GRID).contains(&width) {
            return Err(format!("use 1 to {MAX_GRID} rows of 1 to {MAX_GRID} stitches"));
        }
        let mut grid = Vec::new();
        for (course, row) in rows.iter().rev().enumerate() {
            if row.len() != width {
                return Err(format!("use rows of one length: course {} has {}, others {width}", course + 1, row.len()));
            }
            let mut stitches = Vec::new();
            for (wale, stitch) in row.chars().enumerate() {
                match stitch {
                    'K' => stitches.push(true),
                    'P' => stitches.push(false),
                    '.' => {
                        let below = if course == 0 { rows.len() } else { course };
                        return Err(format!(
                            "the knit runs: no stitch of course {} holds the loop of course {below}, wale {}",
                            course + 1,
                            wale + 1
                        ));
                    }
                    other => {
                        return Err(format!("use K and P, not {other:?}, in course {}, wale {}", course + 1, wale + 1));
                    }
                }
            }
            grid.push(stitches);
        }
        Ok(Knit::Grid { rows: grid, is_rib: false })
    }

    /// A rib of alternating groups of knit and purl wales.
    pub fn rib(knit: usize, purl: usize) -> Knit {
        Knit::Grid { rows: vec![(0..knit + purl).map(|wale| wale < knit).collect()], is_rib: true }
    }

    /// Number of wales and courses of the cell.
    pub fn cell(&self) -> [usize; 2] {
        match self {
            Knit::Grid { rows, .. } => [rows[0].len(), rows.len()],
            Knit::Interlock => [2, 1],
            Knit::Tricot => [1, 2],
        }
    }

    /// Starting curves of the yarns for this width of wales, spacing of courses and radius of the yarn [um].
    pub fn curves(&self, wale: f64, course: f64, radius: f64) -> Vec<StartCurve> {
        match self {
            Knit::Grid { rows, is_rib } => {
                let lift = if *is_rib { WALE * radius } else { 0.0 };
                let of = |c: usize| {
                    weft_knitted(&rows[c], &rows[(c + 1) % rows.len()], c as f64, lift, [wale, course, radius])
                };
                (0..rows.len()).map(of).collect()
            }
            Knit::Interlock => {
                let [a, b] = [[true, false], [false, true]];
                let lift = 1.6 * WALE * radius;
                let of = |row: [bool; 2], c: f64| weft_knitted(&row, &row, c, lift, [wale, course, radius]);
                vec![of(a, 0.0), of(b, 0.5)]
            }
            Knit::Tricot => vec![tricot(wale, course, radius)],
        }
    }
}

/// Smooth step: 0 for x below -1, 1 above 1.
fn smooth(x: f64) -> f64 {
    let t = (0.5 * (x + 1.0)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A course of stitches at the height of `at` courses; `next` are the stitches of the next course.
fn weft_knitted(own: &[bool], next: &[bool], at: f64, lift: f64, [wale, course, radius]: [f64; 3]) -> StartCurve {
    let sign = |is_knit: bool| if is_knit { 1.0 } else { -1.0 };
    let count = own.len();
    let mut points = Vec::with_capacity(count * POINTS);
    for w in 0..count {
        let [before, here, after] = [w + count - 1, w, w + 1].map(|i| sign(own[i % count]));
        let above = sign(next[w]);
        for i in 0..POINTS {
            let t = TAU * (i as f64 + 0.5) / POINTS as f64;
            // Between its sinkers the loop changes to the side of the next course and back.
            let up = smooth((t - 0.5 * PI) * 4.0 / PI) * (1.0 - smooth((t - 1.5 * PI) * 4.0 / PI));
            let mut side = here + up * (above - here);
            side += (before - here) * (1.0 - smooth(t * 12.0 / PI));
            side += (after - here) * smooth((t - TAU) * 12.0 / PI);
            points.push([
                wale * (w as f64 + t / TAU) + LEAN * wale * (2.0 * t).sin(),
                course * (at + 0.5) - HEIGHT * course * t.cos(),
                side * (lift - LEG * radius * (2.0 * t).cos()),
            ]);
        }
    }
    StartCurve { points_um: points, shift: [1, 0], stitches: count }
}

/// A yarn of a tricot: loops on two wales alternately, with underlaps behind both.
fn tricot(wale: f64, course: f64, radius: f64) -> StartCurve {
    let leg = LEG * radius;
    let mut points = Vec::new();
    for c in 0..2 {
        // The first loop rises on its right and falls on its left; the second is its mirror image.
        let (middle, mirror) = if c == 0 { (0.5, 1.0) } else { (1.5, -1.0) };
        for i in 0..POINTS {
            // The loop of a knit stitch without sinkers, from the inner foot over the head to the other foot.
            let t = TAU * (0.09 + 0.82 * (i as f64 + 0.5) / POINTS as f64);
            let x = t / TAU - 0.5 + LEAN * (2.0 * t).sin();
            points.push([
                wale * (middle - mirror * x),
                course * (c as f64 + 0.5) - HEIGHT * course * t.cos(),
                -leg * (2.0 * t).cos(),
            ]);
        }
        // The underlap passes behind this loop's feet and rises to the next one.
        let from = points[points.len() - 1];
        let (next, side) = if c == 0 { (1.5, 1.0) } else { (0.5, -1.0) };
        let t: f64 = TAU * (0.09 + 0.41 / POINTS as f64);
        let x = t / TAU - 0.5 + LEAN * (2.0 * t).sin();
        let to =
            [wale * (next + side * x), course * (c as f64 + 1.5) - HEIGHT * course * t.cos(), -leg * (2.0 * t).cos()];
        let steps = POINTS / 4;
        for i in 1..steps {
            let s = i as f64 / steps as f64;
            let w = s * s * (3.0 - 2.0 * s);
            let behind = -2.6 * leg * (PI * s).sin();
            points.push([
                from[0] + w * (to[0] - from[0]),
                from[1] + w * (to[1] - from[1]),
                from[2] + w * (to[2] - from[2]) + behind,
            ]);
        }
    }
    StartCurve { points_um: points, shift: [0, 1], stitches: 2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const W: f64 = 714.0;
    const H: f64 = 500.0;
    const R: f64 = 85.0;

    /// A crossing of two strands viewed along z.
    struct Crossing {
        at: [f64; 2],
        /// The strand in front, then the one behind: curve, point, and translation in wales and courses.
        strands: [(usize, usize, [i32; 2]); 2],
        gap: f64,
    }

    /// All crossings of strands of the cell, found by brute force among the neighboring images.
    fn crossings(curves: &[StartCurve], cell: [f64; 2]) -> Vec<Crossing> {
        let mut segments = Vec::new();
        for (c, curve) in curves.iter().enumerate() {
            let n = curve.points_um.len();
            let way = [0, 1].map(|k| f64::from(curve.shift[k]) * cell[k]);
            for i in 0..n {
                let p = curve.points_um[i];
                let mut q = curve.points_um[(i + 1) % n];
                if i + 1 == n {
                    q = [q[0] + way[0], q[1] + way[1], q[2]];
                }
                segments.push((c, i, p, q));
            }
        }
        let mut found = Vec::new();
        for &(c, i, p, q) in &segments {
            for &(d, j, r, s) in &segments {
                for a in -3i32..=3 {
                    for b in -3i32..=3 {
                        let by = [f64::from(a) * cell[0], f64::from(b) * cell[1]];
                        let (r, s) = ([r[0] + by[0], r[1] + by[1], r[2]], [s[0] + by[0], s[1] + by[1], s[2]]);
                        let (u, v) = ([q[0] - p[0], q[1] - p[1]], [s[0] - r[0], s[1] - r[1]]);
                        let w = [r[0] - p[0], r[1] - p[1]];
                        let det = u[0] * v[1] - u[1] * v[0];
                        if det.abs() < 1e-12 {
                            continue;
                        }
                        let (x, y) = ((w[0] * v[1] - w[1] * v[0]) / det, (w[0] * u[1] - w[1] * u[0]) / det);
                        if !(0.0..1.0).contains(&x) || !(0.0..1.0).contains(&y) || (c, i) == (d, j) && [a, b] == [0, 0]
                        {
                            continue;
                        }
                        let gap = p[2] + x * (q[2] - p[2]) - r[2] - y * (s[2] - r[2]);
                        // Each crossing is counted once, with this strand in front. Neighboring segments
                        // share a point and have no gap.
                        if gap > 1e-6 {
                            let at = [p[0] + x * u[0], p[1] + x * u[1]];
                            found.push(Crossing { at, strands: [(c, i, [0, 0]), (d, j, [a, b])], gap });
                        }
                    }
                }
            }
        }
        found
    }

    fn cell(knit: &Knit) -> [f64; 2] {
        let [wales, courses] = knit.cell();
        [wales as f64 * W, courses as f64 * H]
    }

    /// Fraction of the loop at a point: 0 at the left sinker, 0.5 at the head, 1 at the right sinker.
    fn share(point: usize) -> f64 {
        (point % POINTS) as f64 / POINTS as f64
    }

    /// Each stitch crosses the loop below four times. The legs of a knit stitch lie in front of that loop's
    /// head and its feet behind that loop's legs; a purl stitch is the opposite. Strands keep apart.
    #[test]
    fn stitches_hold_each_other() {
        let rows = |rows: &[&str]| Knit::from_rows(&rows.iter().map(|r| r.to_string()).collect::<Vec<_>>()).unwrap();
        for (name, knit) in [
            ("jersey", rows(&["K"])),
            ("garter", rows(&["P", "K"])),
            ("seed", rows(&["KP", "PK"])),
            ("moss of three", rows(&["KKP", "PKK", "KPK"])),
            ("rib 1 x 1", Knit::rib(1, 1)),
            ("rib 2 x 2", Knit::rib(2, 2)),
        ] {
            let Knit::Grid { rows, .. } = &knit else { panic!() };
            let curves = knit.curves(W, H, R);
            let found = crossings(&curves, cell(&knit));
            assert_eq!(found.len(), 4 * rows.len() * rows[0].len(), "{name}");
            for crossing in &found {
                let [front, back] = crossing.strands;
                // The upper strand is a course higher and crosses with its feet or legs, in the lower half of
                // its loop.
                let height = |(c, _, by): (usize, usize, [i32; 2])| c as i32 + by[1] * rows.len() as i32;
                let (upper, lower, is_front) =
                    if height(front) > height(back) { (front, back, true) } else { (back, front, false) };
                assert_eq!(height(upper) - height(lower), 1, "{name}");
                let is_knit = rows[upper.0][upper.1 / POINTS];
                let (s, t) = (share(upper.1), share(lower.1));
                assert!(!(0.25..0.75).contains(&s) && (0.25..0.75).contains(&t), "{name}: {s} {t}");
                // Legs cross the head of the loop below, and feet its legs.
                let is_leg = (0.36..0.64).contains(&t);
                assert_eq!(is_front, is_leg == is_knit, "{name}: at {:?}, {s} {t}", crossing.at);
                assert!(crossing.gap > 0.5 * R, "{name}: {} at {s} {t}", crossing.gap / R);
            }
        }
    }

    /// Loops of interlock and tricot hold those below on their own wale, and strands keep apart.
    #[test]
    fn interlock_and_tricot_hold() {
        // Each stitch has four crossings with the loop below. Further crossings in projection are those of
        // ribs back to back and of underlaps.
        for (name, knit, count) in [("interlock", Knit::Interlock, 48), ("tricot", Knit::Tricot, 10)] {
            let found = crossings(&knit.curves(W, H, R), cell(&knit));
            let min = found.iter().map(|c| c.gap / R).fold(f64::INFINITY, f64::min);
            println!("{name}: {} crossings, least gap {min:.2} R", found.len());
            assert!(found.len() == count && min > 0.5, "{name}: {} {min}", found.len());
        }
    }

    #[test]
    fn grids_that_run_or_cannot_be_read_are_refused() {
        let of = |rows: &[&str]| Knit::from_rows(&rows.iter().map(|r| r.to_string()).collect::<Vec<_>>()).unwrap_err();
        assert_eq!(of(&["KK", "K."]), "the knit runs: no stitch of course 1 holds the loop of course 2, wale 2");
        assert_eq!(of(&[".K", "KK"]), "the knit runs: no stitch of course 2 holds the loop of course 1, wale 1");
        assert!(of(&["KQ"]).contains("not 'Q', in course 1, wale 2"));
        assert!(of(&["KK", "K"]).contains("rows of one length"));
        assert!(of(&[]).contains("1 to 64 rows"));
    }

    /// The loop of a jersey of 14 wales and 20 courses per cm is about 2.7 mm long.
    #[test]
    fn loops_are_as_long_as_those_of_cloth() {
        let curves = Knit::rib(1, 0).curves(W, H, R);
        let p = &curves[0].points_um;
        let step = |i: usize| {
            let mut q = p[(i + 1) % p.len()];
            if i + 1 == p.len() {
                q[0] += W;
            }
            (0..3).map(|k| (q[k] - p[i][k]).powi(2)).sum::<f64>().sqrt()
        };
        let length: f64 = (0..p.len()).map(step).sum();
        println!("{length:.0} um");
        assert!((2400.0..3100.0).contains(&length), "{length}");
    }
}
