//! Starting chains of a knitted cloth, from its stitches and its yarn.
//!
//! The curves of `knit.rs` are resampled by length and laid out with the yarn's plies or bundles. A knit
//! holds the length of its loops when it is relaxed.

use super::knit::Knit;
use super::relax::Elements;
use super::woven::{Start, element_um, max_nodes};
use plywave::cloth::{ClothYarn, Lattice};
use plywave_textile::{KnitSpec, YarnOfCloth};

/// An error of a key: its name, its value and a hint.
pub(super) type Refusal = (&'static str, String, String);

/// The stitches of a spec.
fn stitches(spec: &KnitSpec) -> Result<Knit, Refusal> {
    let rows = |rows: &[&str]| -> Vec<String> { rows.iter().map(|row| row.to_string()).collect() };
    let grid = match spec.kind.as_str() {
        "rib" => return Ok(Knit::rib(spec.knit.unwrap_or(1), spec.purl.unwrap_or(1))),
        "interlock" => return Ok(Knit::Interlock),
        "tricot" => return Ok(Knit::Tricot),
        "garter" => rows(&["P", "K"]),
        "seed" => rows(&["KP", "PK"]),
        "grid" => spec.rows.clone().unwrap_or_default(),
        _ => rows(&["K"]),
    };
    let value = format!("{} rows", grid.len());
    Knit::from_rows(&grid).map_err(|hint| ("knit.rows", value, hint))
}

/// Lays out the starting chains of a knit.
pub(super) fn knitted(spec: &KnitSpec, yarn: &YarnOfCloth) -> Result<Start, Refusal> {
    let knit = stitches(spec)?;
    let [wale_um, course_um] = [1e4 / spec.wales_per_cm, 1e4 / spec.courses_per_cm];
    let [wales, courses] = knit.cell().map(|n| n as f64);
    let Some(lattice) = Lattice::new([[wales * wale_um, 0.0], [0.0, courses * course_um]]) else {
        return Err(("knit.wales_per_cm", spec.wales_per_cm.to_string(), "use numbers above 0".into()));
    };
    let nodes = 1e3 * spec.loop_mm * wales * courses / element_um(yarn) * yarn.strands() as f64;
    let most = max_nodes(&[yarn]);
    if nodes > most {
        let hint = format!("the loops are too long to relax; use {most:.0e} nodes at most");
        return Err(("knit.loop_mm", format!("{nodes:.1e} nodes"), hint));
    }
    let elements = Elements { lattice, chains: Vec::new(), sections: Vec::new(), thickness_um: None };
    let mut start = Start { elements, yarns: Vec::new(), of_chain: Vec::new(), twists: Vec::new() };
    let curves = knit.curves(wale_um, course_um, yarn.radius_um());
    let step = curves.len() as i32;
    for (number, curve) in curves.iter().enumerate() {
        // Courses are numbered upwards, and the yarns of a tricot to the right.
        let step = if curve.shift[0] == 0 { [step, 0] } else { [0, step] };
        let of = ClothYarn { kind: 0, number: number as i32, step, period: curve.shift };
        let length_um = 1e3 * spec.loop_mm * curve.stitches as f64;
        let line = Polyline::new(&curve.points_um, lattice.vector(curve.shift));
        let first = start.elements.chains.len();
        start.add_along(yarn, of, length_um, None, |s| line.at(s));
        for chain in &mut start.elements.chains[first..] {
            // A knit keeps the length of its loops. Plies of several are helices about the axis; their
            // starting length already includes the helix.
            let periods = if curve.shift[0] == 0 { chain.shift[1] } else { chain.shift[0] };
            chain.length_um.get_or_insert(length_um * f64::from(periods));
        }
    }
    Ok(start)
}

/// A periodic polyline, parameterized by its length.
struct Polyline<'a> {
    points: &'a [[f64; 3]],
    way: [f64; 2],
    /// Length up to each point, and the total length last [um].
    lengths: Vec<f64>,
}

impl<'a> Polyline<'a> {
    fn new(points: &'a [[f64; 3]], way: [f64; 2]) -> Polyline<'a> {
        let mut line = Polyline { points, way, lengths: vec![0.0] };
        for i in 0..points.len() {
            let (p, q) = (line.point(i), line.point(i + 1));
            let d = (0..3).map(|k| (q[k] - p[k]).powi(2)).sum::<f64>().sqrt();
            line.lengths.push(line.lengths[i] + d);
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
