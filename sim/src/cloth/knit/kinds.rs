//! Kinds of knits: the chart of each, and the curves of its yarns.

use super::curves::{Size, StartCurve, course};
use super::needles::knit;
use super::tricot::tricot;
use plywave_textile::{Chart, ChartError, KnitKind};

/// Height over the yarn's radius of the face and back wales of ribs, and of the beds of an interlock.
const WALE: f64 = 1.4;
const BEDS: f64 = 1.6 * WALE;

/// A knit.
#[derive(Clone, Debug, PartialEq)]
pub enum Knit {
    /// Stitches of a chart.
    Chart {
        /// The stitches.
        chart: Chart,
        /// Whether its wales draw together.
        is_rib: bool,
    },
    /// Two interlocked 1 x 1 ribs, back to back.
    Interlock,
    /// A warp knit of one bar with open laps: each yarn makes loops on two wales alternately.
    Tricot,
}

impl Knit {
    /// The stitches of a kind. A chart from a picture must have been read before.
    pub fn new(kind: &KnitKind) -> Result<Knit, ChartError> {
        let chart = |rows: &[&str]| Ok(Knit::Chart { chart: Chart::from_rows(rows)?, is_rib: false });
        match kind {
            KnitKind::Jersey => chart(&["K"]),
            KnitKind::Garter => chart(&["P", "K"]),
            KnitKind::Seed => chart(&["KP", "PK"]),
            KnitKind::Rib { knit, purl } => Knit::rib(*knit, *purl),
            KnitKind::Interlock => Ok(Knit::Interlock),
            KnitKind::Tricot => Ok(Knit::Tricot),
            KnitKind::Chart(chart) => Ok(Knit::Chart { chart: chart.clone(), is_rib: false }),
            KnitKind::Picture(picture) => Err(ChartError {
                row: None,
                value: picture.picture.clone(),
                hint: "the picture has not been read".into(),
            }),
        }
    }

    /// A rib of alternating groups of knit and purl wales.
    fn rib(knit: usize, purl: usize) -> Result<Knit, ChartError> {
        let row = "K".repeat(knit) + &"P".repeat(purl);
        Ok(Knit::Chart { chart: Chart::from_rows(&[row])?, is_rib: true })
    }

    /// Number of wales and courses of the cell.
    pub fn cell(&self) -> [usize; 2] {
        match self {
            Knit::Chart { chart, .. } => [chart.wales(), chart.courses()],
            Knit::Interlock => [2, 1],
            Knit::Tricot => [1, 2],
        }
    }

    /// Starting curves of the yarns for this width of wales, spacing of courses and radius of the yarn [um].
    pub fn curves(&self, wale: f64, spacing: f64, radius: f64) -> Vec<StartCurve> {
        let size = |lift: f64| Size { wale, course: spacing, radius, lift: lift * radius, is_pressed: false };
        match self {
            Knit::Chart { chart, is_rib } => {
                let lift = if *is_rib { WALE } else { 0.0 };
                let size = Size { is_pressed: !chart.is_plain(), ..size(lift) };
                let knitted = knit(chart);
                (0..chart.courses()).map(|c| course(&knitted, c, c as f64, &size)).collect()
            }
            Knit::Interlock => {
                // Each rib is a course of its own, half a course above the other.
                let of = |(row, at): (&str, f64)| {
                    let chart = Chart::from_rows(&[row]).ok()?;
                    Some(course(&knit(&chart), 0, at, &size(BEDS)))
                };
                [("KP", 0.0), ("PK", 0.5)].into_iter().filter_map(of).collect()
            }
            Knit::Tricot => vec![tricot(wale, spacing, radius)],
        }
    }
}
