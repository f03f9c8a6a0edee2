//! Crossings of the starting curves, found by brute force: the right strand lies in front.

use super::super::curves::{POINTS, StartCurve};
use super::super::kinds::Knit;
use super::super::needles::{Cell, Knitted, Loop, knit};
use super::Random;
use plywave_textile::{Chart, KnitKind, Stitch};
use std::collections::BTreeMap;

const W: f64 = 714.0;
const H: f64 = 500.0;
const R: f64 = 85.0;

/// A crossing of two strands viewed along z.
struct Crossing {
    /// The strand in front, then the one behind: curve, point, and translation in repeats.
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
    // Loops reach over up to five courses and wales beyond the cell.
    let reach = cell.map(|side| if side > 6.0 * W.max(H) { 1 } else { (6.0 * W.max(H) / side).ceil() as i32 });
    let mut found = Vec::new();
    for &(c, i, p, q) in &segments {
        for &(d, j, r, s) in &segments {
            for a in -reach[0]..=reach[0] {
                for b in -reach[1]..=reach[1] {
                    let by = [f64::from(a) * cell[0], f64::from(b) * cell[1]];
                    let (r, s) = ([r[0] + by[0], r[1] + by[1], r[2]], [s[0] + by[0], s[1] + by[1], s[2]]);
                    let apart = |k: usize| p[k].min(q[k]) > r[k].max(s[k]) || r[k].min(s[k]) > p[k].max(q[k]);
                    if apart(0) || apart(1) || (c, i) == (d, j) && [a, b] == [0, 0] {
                        continue;
                    }
                    let (u, v) = ([q[0] - p[0], q[1] - p[1]], [s[0] - r[0], s[1] - r[1]]);
                    let w = [r[0] - p[0], r[1] - p[1]];
                    let det = u[0] * v[1] - u[1] * v[0];
                    if det.abs() < 1e-12 {
                        continue;
                    }
                    let (x, y) = ((w[0] * v[1] - w[1] * v[0]) / det, (w[0] * u[1] - w[1] * u[0]) / det);
                    if !(0.0..1.0).contains(&x) || !(0.0..1.0).contains(&y) {
                        continue;
                    }
                    let gap = p[2] + x * (q[2] - p[2]) - r[2] - y * (s[2] - r[2]);
                    // Each crossing is counted once, with this strand in front. Neighboring segments share a
                    // point and have no gap.
                    if gap > 1e-6 {
                        found.push(Crossing { strands: [(c, i, [0, 0]), (d, j, [a, b])], gap });
                    }
                }
            }
        }
    }
    found
}

/// Part of a loop, with the fraction of the loop's length without its longer legs: 0 at the left sinker, 0.5
/// at the head, 1 at the right one.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Lower(f64),
    Leg,
    Upper(f64),
    Float,
}

/// The strand of a point: the place that makes it, counted through all repeats, and the part.
fn strand(knitted: &Knitted, curves: &[StartCurve], (c, i, by): (usize, usize, [i32; 2])) -> ([i64; 2], Part) {
    let needles = &curves[c].needles;
    let wale = needles.partition_point(|start| *start <= i) - 1;
    let end = needles.get(wale + 1).copied().unwrap_or(curves[c].points_um.len());
    let (at, extra) = (i - needles[wale], (end - needles[wale] - POINTS) / 2);
    let size = [knitted.cells.len(), knitted.cells[0].len()].map(|n| n as i64);
    let place = [c as i64 + i64::from(by[1]) * size[0], wale as i64 + i64::from(by[0]) * size[1]];
    let of = |point: usize| point as f64 / POINTS as f64;
    let quarter = POINTS / 4;
    let part = match knitted.cells[c][wale] {
        Cell::Float(_) => Part::Float,
        _ if at < quarter => Part::Lower(of(at)),
        _ if at < quarter + extra => Part::Leg,
        _ if at < 3 * quarter + extra => Part::Upper(of(at - extra)),
        _ if at < 3 * quarter + 2 * extra => Part::Leg,
        _ => Part::Lower(of(at - 2 * extra)),
    };
    (place, part)
}

/// A knitted chart with the loops of all repeats.
struct Pattern<'a> {
    knitted: &'a Knitted,
    chart: &'a Chart,
}

impl Pattern<'_> {
    /// The loop that is made at a place, and its translation in courses and wales.
    fn made(&self, [course, wale]: [i64; 2]) -> Option<(&Loop, [i64; 2])> {
        let size = [self.chart.courses() as i64, self.chart.wales() as i64];
        let in_repeat = [course.rem_euclid(size[0]), wale.rem_euclid(size[1])];
        match &self.knitted.cells[in_repeat[0] as usize][in_repeat[1] as usize] {
            Cell::Loop(id) => Some((&self.knitted.loops[*id], [course - in_repeat[0], wale - in_repeat[1]])),
            Cell::Float(_) => None,
        }
    }

    /// Where a loop is in a course; `None` where it is not.
    fn place(&self, made: [i64; 2], course: i64) -> Option<(i64, usize)> {
        let (of, by) = self.made(made)?;
        let place = of.places.get(usize::try_from(course - made[0]).ok()?)?;
        Some((place.wale + by[1], place.front))
    }

    /// Place of the stitch that holds a loop.
    fn holder(&self, made: [i64; 2]) -> Option<[i64; 2]> {
        let (of, by) = self.made(made)?;
        let last = of.places.len() - 1;
        Some([made[0] + last as i64, of.places[last].wale + by[1]])
    }

    /// Rank of a loop as it moves before a course: those of higher rank pass in front.
    fn rank(&self, made: [i64; 2], course: i64) -> Option<i32> {
        let (wale, _) = self.place(made, course - 1)?;
        Some(match self.chart.stitch(course, wale) {
            Stitch::Move(1) => 2,
            Stitch::Move(_) => 1,
            Stitch::Cable { is_front, .. } => i32::from(is_front),
            _ => 0,
        })
    }

    /// Whether the strand in front is the right one; `None` where the two must not cross.
    fn is_right(&self, front: ([i64; 2], Part), back: ([i64; 2], Part)) -> Option<bool> {
        let is_knit = |made: [i64; 2]| self.made(made).map(|(of, _)| of.own > 0.0);
        for ((upper, low), (lower, high), is_front) in [(front, back, true), (back, front, false)] {
            if self.holder(lower) == Some(upper) && upper != lower {
                // Legs cross the heads of the loops below, and feet their legs.
                let (Part::Lower(_), Part::Upper(t)) = (low, high) else { continue };
                let is_leg = (0.36..0.64).contains(&t);
                return Some(is_front == (is_leg == is_knit(upper)?));
            }
        }
        match (front.1, back.1) {
            // Floats lie behind the loops that they pass.
            (Part::Leg, Part::Float) => return self.place(front.0, back.0[0]).map(|(wale, _)| wale == back.0[1]),
            (Part::Float, _) | (_, Part::Float) => return None,
            _ => {}
        }
        // Two loops that change places do so before one course.
        let [from, to] = [front.0[0].max(back.0[0]) + 1, self.holder(front.0)?[0].min(self.holder(back.0)?[0])];
        let order = |course: i64| Some(self.place(front.0, course)?.0.cmp(&self.place(back.0, course)?.0));
        let crossed = (from..=to).find(|course| order(course - 1) != order(*course))?;
        Some(self.rank(front.0, crossed) > self.rank(back.0, crossed))
    }
}

/// Checks all crossings of a chart; returns the least gap and the number of crossings of moved loops.
fn check(chart: &Chart, name: &str) -> (f64, usize) {
    let knitted = knit(chart);
    let curves = Knit::new(&KnitKind::Chart(chart.clone())).unwrap().curves(W, H, R);
    let cell = [chart.wales() as f64 * W, chart.courses() as f64 * H];
    let pattern = Pattern { knitted: &knitted, chart };
    let mut holds = BTreeMap::<[[i64; 2]; 2], usize>::new();
    let mut floats = BTreeMap::<[[i64; 2]; 2], usize>::new();
    let (mut least, mut moved, mut wrong) = (f64::INFINITY, 0, 0);
    for crossing in crossings(&curves, cell) {
        let [front, back] = crossing.strands.map(|of| strand(&knitted, &curves, of));
        let is_right = pattern.is_right(front, back);
        if is_right != Some(true) {
            println!("{name}: {front:?} in front of {back:?}, {:.2} R: {is_right:?}", crossing.gap / R);
            wrong += 1;
        }
        least = least.min(crossing.gap / R);
        let mut pair = [front.0, back.0];
        pair.sort();
        match (front.1, back.1) {
            (_, Part::Float) => *floats.entry([back.0, front.0]).or_default() += 1,
            _ if pattern.holder(pair[0]) == Some(pair[1]) => {
                // Pairs are counted from the repeat that has the stitch.
                let by = [0, 1].map(|k| pair[1][k] - pair[1][k].rem_euclid([chart.courses(), chart.wales()][k] as i64));
                *holds
                    .entry([[pair[1][0] - by[0], pair[1][1] - by[1]], [pair[0][0] - by[0], pair[0][1] - by[1]]])
                    .or_default() += 1;
            }
            _ => moved += 1,
        }
    }
    assert_eq!(wrong, 0, "{name}: strands in the wrong order");
    // Each stitch crosses each loop that it holds four times, and each float crosses both legs of each loop.
    let mut stitches = 0;
    for cell in knitted.cells.iter().flatten() {
        match cell {
            Cell::Loop(id) => stitches += knitted.loops[*id].holds.len(),
            Cell::Float(_) => {}
        }
    }
    assert!(holds.values().all(|count| *count == 4), "{name}: {holds:?}");
    assert_eq!(holds.len(), stitches, "{name}: {holds:?}");
    let passed: usize =
        knitted.cells.iter().flatten().map(|c| if let Cell::Float(held) = c { held.len() } else { 0 }).sum();
    assert_eq!(floats.values().sum::<usize>(), 2 * passed, "{name}");
    (least, moved)
}

/// Stitches hold each other as they should, in charts of each stitch and in random ones, and strands keep
/// apart.
#[test]
fn stitches_hold_each_other() {
    let mut all: Vec<(String, Chart)> = [
        vec!["K"],
        vec!["P", "K"],
        vec!["KP", "PK"],
        vec!["KKP", "PKK", "KPK"],
        vec!["KK", "KT"],
        vec!["PP", "PT"],
        vec!["KK", "TK", "TK", "TK", "TK"],
        vec!["KK", "KM"],
        vec!["PP", "PM"],
        vec!["KKK", "K>K"],
        vec!["PPPP", "P<PP"],
        vec!["KKKK", ">K<K"],
        vec!["KKKKK", "K>>KK"],
        vec!["KKKKKK", "PRRllP"],
        vec!["KKKKKK", "PrrLLP"],
        vec!["KKKKKK", "PRlllP"],
        vec!["PPPPPP", "PRrLlP"],
    ]
    .into_iter()
    .filter_map(|rows| Some((rows.join(" "), Chart::from_rows(&rows).ok()?)))
    .collect();
    assert_eq!(all.len(), 16, "PRrLlP is no cable");
    let mut random = Random(3);
    for _ in 0..300 {
        let (rows, chart) = random.chart(6);
        all.push((rows.join(" "), chart));
    }
    let mut least = (f64::INFINITY, String::new());
    let mut moved = 0;
    for (name, chart) in all {
        let (gap, more) = check(&chart, &name);
        moved += more;
        if gap < least.0 {
            least = (gap, name);
        }
    }
    println!("least gap {:.2} R ({}), {moved} crossings of moved loops", least.0, least.1);
    assert!(least.0 > 0.5 && moved > 300, "{least:?} {moved}");
}

/// Loops of interlock and tricot hold those below on their own wale, and strands keep apart.
#[test]
fn interlock_and_tricot_hold() {
    // Each stitch has four crossings with the loop below. Further crossings in projection are those of ribs
    // back to back and of underlaps.
    for (name, kind, count) in [("interlock", KnitKind::Interlock, 48), ("tricot", KnitKind::Tricot, 10)] {
        let knit = Knit::new(&kind).unwrap();
        let [wales, courses] = knit.cell();
        let found = crossings(&knit.curves(W, H, R), [wales as f64 * W, courses as f64 * H]);
        let min = found.iter().map(|c| c.gap / R).fold(f64::INFINITY, f64::min);
        println!("{name}: {} crossings, least gap {min:.2} R", found.len());
        assert!(found.len() == count && min > 0.5, "{name}: {} {min}", found.len());
    }
}
