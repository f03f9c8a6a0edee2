//! Starting chains of a knitted cloth, from its stitches and its yarn.
//!
//! The curves of the stitches are resampled by length and laid out with the yarn's plies or bundles. A knit
//! holds the length of its loops when it is relaxed: that of plain stitches is given, and others have more or
//! less in proportion.
//!
//! Knit and purl stitches come to rest without friction. Loops that are held, moved or left out do not: yarn
//! would slide from the loops that pull to those that do not, and eyelets would close. So in other charts
//! friction holds the yarn at its start, along the wales and along the courses. In a loop the yarn of tension
//! T turns about twice by 180 degrees around those that it crosses, at its head and at its feet, and each
//! turn presses on them with 2 T; friction takes mu times these 4 T at most.

use super::super::relax::{Elements, Hold};
use super::super::woven::{FRICTION, SLIP, Start, axis_tension, element_um, max_nodes, nodes_of};
use super::curves::StartCurve;
use super::kinds::Knit;
use plywave::cloth::{ClothYarn, Lattice};
use plywave_textile::{KnitKind, KnitSpec, YarnOfCloth};

/// An error of a key: its name, its value and a hint.
pub type Refusal = (&'static str, String, String);

/// Force over tension with which the yarn of a loop presses on those that it crosses.
const PRESSES: f64 = 4.0;
/// Number of stitches of a chart beyond which friction holds plain stitches, too. Chosen: in wide charts
/// nothing but bending resists that whole rows shift.
const MANY: usize = 1024;

/// Lays out the starting chains of a knit. A chart from a picture is given as `kind` in its place.
pub fn knitted(spec: &KnitSpec, kind: &KnitKind, yarn: &YarnOfCloth) -> Result<Start, Refusal> {
    let knit = Knit::new(kind).map_err(|error| ("knit.chart", error.value, error.hint))?;
    let [wale_um, course_um] = [1e4 / spec.wales_per_cm, 1e4 / spec.courses_per_cm];
    let [wales, courses] = knit.cell().map(|n| n as f64);
    let Some(lattice) = Lattice::new([[wales * wale_um, 0.0], [0.0, courses * course_um]]) else {
        return Err(("knit.wales_per_cm", spec.wales_per_cm.to_string(), "use numbers above 0".into()));
    };
    let nodes = 1e3 * spec.loop_mm * wales * courses / element_um(yarn) * yarn.strands() as f64;
    let most = max_nodes(&[yarn]);
    if nodes > most {
        let hint = format!("the loops are too long or too many to relax; use {most:.0e} nodes at most");
        return Err(("knit.loop_mm", format!("{nodes:.1e} nodes"), hint));
    }
    let elements = Elements { lattice, chains: Vec::new(), sections: Vec::new(), thickness_um: None };
    let mut start = Start { elements, yarns: Vec::new(), of_chain: Vec::new(), twists: Vec::new() };
    let curves = knit.curves(wale_um, course_um, yarn.radius_um());
    let is_held = match &knit {
        Knit::Chart { chart, .. } => !chart.is_plain() || chart.wales() * chart.courses() > MANY,
        _ => false,
    };
    let grip = is_held.then(|| FRICTION * PRESSES * axis_tension(yarn) / (1e3 * spec.loop_mm));
    for (number, curve) in curves.iter().enumerate() {
        add(&mut start, curve, [number, curves.len()], 1e3 * spec.loop_mm, grip, yarn);
    }
    Ok(start)
}

/// Adds the yarn of a curve, which is `number` of `count`. `grip` is the maximum force of friction over its
/// length [force/um].
fn add(
    start: &mut Start,
    curve: &StartCurve,
    [number, count]: [usize; 2],
    loop_um: f64,
    grip: Option<f64>,
    yarn: &YarnOfCloth,
) {
    // Courses are numbered upwards, and the yarns of a tricot to the right.
    let step = if curve.shift[0] == 0 { [count as i32, 0] } else { [0, count as i32] };
    let of = ClothYarn { kind: 0, number: number as i32, step, period: curve.shift };
    let length_um = loop_um * curve.loops;
    let line = Polyline::new(curve, start.elements.lattice.vector(curve.shift));
    let first = start.elements.chains.len();
    let slip_um = SLIP * yarn.radius_um();
    let holds = |s: f64| {
        let (point, _) = line.at(s);
        let hold = |k: usize| {
            let across = [[1.0, 0.0], [0.0, 1.0]][k];
            grip.map(|force_per_um| Hold { across, line_um: point[k], slip_um, force_per_um })
        };
        [hold(0), hold(1)]
    };
    start.add_along(yarn, of, (length_um, nodes_of(length_um, element_um(yarn))), holds, |s| line.at(s));
    for chain in &mut start.elements.chains[first..] {
        // Plies of several are helices about the axis; their starting length already includes the helix.
        let periods = if curve.shift[0] == 0 { chain.shift[1] } else { chain.shift[0] };
        chain.length_um.get_or_insert(length_um * f64::from(periods));
    }
}

/// A periodic polyline, parameterized by its yarn.
struct Polyline<'a> {
    points: &'a [[f64; 3]],
    way: [f64; 2],
    /// Yarn up to each point, and the total last.
    lengths: Vec<f64>,
}

impl<'a> Polyline<'a> {
    fn new(curve: &'a StartCurve, way: [f64; 2]) -> Polyline<'a> {
        let points = &curve.points_um;
        let mut line = Polyline { points, way, lengths: curve.yarn.clone().unwrap_or_default() };
        if line.lengths.is_empty() {
            line.lengths.push(0.0);
            for i in 0..points.len() {
                let (p, q) = (line.point(i), line.point(i + 1));
                let d = (0..3).map(|k| (q[k] - p[k]).powi(2)).sum::<f64>().sqrt();
                line.lengths.push(line.lengths[i] + d);
            }
        }
        line
    }

    /// The point `i`, which may lie in a later period.
    fn point(&self, i: usize) -> [f64; 3] {
        let n = self.points.len();
        let turns = (i / n) as f64;
        let p = self.points[i % n];
        [p[0] + turns * self.way[0], p[1] + turns * self.way[1], p[2]]
    }

    /// Point at `s`, which grows by 1 over a period, and the unit direction across the line in the plane.
    fn at(&self, s: f64) -> ([f64; 3], [f64; 3]) {
        let n = self.points.len();
        let turns = s.floor();
        let length = (s - turns) * self.lengths[n];
        let i = self.lengths.partition_point(|l| *l <= length).clamp(1, n) - 1;
        let t = (length - self.lengths[i]) / (self.lengths[i + 1] - self.lengths[i]).max(1e-12);
        let (p, q) = (self.point(i), self.point(i + 1));
        let point: [f64; 3] = std::array::from_fn(|k| p[k] + t * (q[k] - p[k]));
        let d = [q[0] - p[0], q[1] - p[1]];
        let across = d[0].hypot(d[1]).max(1e-12);
        let moved = [point[0] + turns * self.way[0], point[1] + turns * self.way[1], point[2]];
        (moved, [-d[1] / across, d[0] / across, 0.0])
    }
}
