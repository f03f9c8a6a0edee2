//! The report of a cloth: quantities that a textile or glazing lab measures, with standard errors.
//!
//! R and T are directional-hemispherical, with the straight light in T; by Helmholtz reciprocity they are
//! also the hemispherical-directional quantities that a detector measures in an integrating sphere. The five
//! numbers of EN 14501 are for light along the normal: solar T, R and A, visible T, and the visible
//! transmittance into a cone of five degrees about the straight direction.

use super::Format;
use super::mean::{BATCHES, Bands, Energies, Estimate, MeanCloth, Spectrum, diffuse};
use super::outputs::CSV_HEAD;
use super::window_xml::escaped;
use serde::Serialize;
use std::fmt::Write;

/// Direction of incident light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct View {
    /// Angle from the normal of the side of incidence [rad].
    pub tilt_rad: f64,
    /// Azimuth from x, the weft, towards y, the warp [rad].
    pub azimuth_rad: f64,
    /// Whether the light is incident on the face.
    pub is_face: bool,
}

impl View {
    /// The direction towards the light.
    pub fn direction(&self) -> [f32; 3] {
        let ((s, z), (sin, cos)) = (self.tilt_rad.sin_cos(), self.azimuth_rad.sin_cos());
        [(s * cos) as f32, (s * sin) as f32, (if self.is_face { z } else { -z }) as f32]
    }

    /// The default views of a report: six tilts, three azimuths, both sides.
    pub fn usual() -> Vec<View> {
        let mut views = Vec::new();
        for is_face in [true, false] {
            for tilt in [0.0f64, 15.0, 30.0, 45.0, 60.0, 75.0] {
                for azimuth in [0.0f64, 45.0, 90.0] {
                    if tilt > 0.0 || azimuth == 0.0 {
                        let (tilt_rad, azimuth_rad) = (tilt.to_radians(), azimuth.to_radians());
                        views.push(View { tilt_rad, azimuth_rad, is_face });
                    }
                }
            }
        }
        views
    }
}

/// Measured quantities for light from one direction, or uniform over a hemisphere.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The direction; `None` for the mean over a hemisphere.
    pub view: Option<View>,
    /// Whether the light is incident on the face.
    pub is_face: bool,
    /// Visible reflectance.
    pub reflected: Estimate,
    /// Visible transmittance, straight light included.
    pub transmitted: Estimate,
    /// Light that misses all fibers.
    pub straight: Estimate,
    /// Fraction of the lines that miss all plies.
    pub openness: Estimate,
    /// Visible transmittance into a cone of five degrees about the straight direction, straight light
    /// included.
    pub into_cone: Estimate,
    /// Solar reflectance.
    pub solar_reflected: Estimate,
    /// Solar transmittance.
    pub solar_transmitted: Estimate,
    /// Solar absorptance: 1 minus solar reflectance and transmittance.
    pub solar_absorbed: Estimate,
    /// CIELAB of the reflected light, D65 and the 1964 observer.
    pub lab_reflected: [Estimate; 3],
    /// CIELAB of the transmitted light, D65 and the 1964 observer.
    pub lab_transmitted: [Estimate; 3],
}

impl Row {
    fn new(view: Option<View>, is_face: bool, batches: &[Energies], bands: &Bands) -> Row {
        let of = |number: &dyn Fn(&Energies) -> f64| Estimate::of(&batches.iter().map(number).collect::<Vec<_>>());
        let through = |e: &Energies| {
            let mut all = Spectrum::flat(e.straight);
            all.add(1.0, &e.transmitted);
            all
        };
        // CIELAB is not linear: the color is that of the mean spectrum, and its errors are those of the
        // batches' colors.
        let lab = |light: &dyn Fn(&Energies) -> Spectrum| {
            let mut mean = Spectrum::ZERO;
            batches.iter().for_each(|e| mean.add(1.0 / batches.len() as f64, &light(e)));
            let value = bands.lab_10(&mean);
            [0, 1, 2].map(|k| Estimate { value: value[k], se: of(&|e| bands.lab_10(&light(e))[k]).se })
        };
        Row {
            view,
            is_face,
            reflected: of(&|e| bands.visible(&e.reflected)),
            transmitted: of(&|e| e.straight + bands.visible(&e.transmitted)),
            straight: of(&|e| e.straight),
            openness: of(&|e| e.open),
            into_cone: of(&|e| e.straight + bands.visible(&e.forward)),
            solar_reflected: of(&|e| bands.solar(&e.reflected)),
            solar_transmitted: of(&|e| bands.solar(&through(e))),
            solar_absorbed: of(&|e| 1.0 - bands.solar(&e.reflected) - bands.solar(&through(e))),
            lab_reflected: lab(&|e| e.reflected),
            lab_transmitted: lab(&through),
        }
    }
}

/// A report on a cloth.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Text about the program that made the report.
    pub made_by: String,
    /// Name of the cloth.
    pub cloth: String,
    /// Program version.
    pub program_version: String,
    /// Number of samples for each row.
    pub samples: usize,
    /// Seed of the samples.
    pub seed: u32,
    /// Light along the normal, incident on the face and on the back.
    pub normal: [Row; 2],
    /// Light uniform over the hemisphere, incident on the face and on the back.
    pub diffuse: [Row; 2],
    /// Rows by angle.
    pub rows: Vec<Row>,
    /// Ultraviolet protection factor, if an absorption of the ultraviolet was given.
    pub upf: Option<Estimate>,
    /// Fractions of the solar spectrum below and above the visible range, where absorption is assumed.
    pub solar_beyond: [f64; 2],
    /// Assumptions, one per line.
    pub notes: Vec<String>,
}

impl Report {
    /// Computes the report of a cloth for these views.
    pub fn new(
        cloth: &MeanCloth,
        name: &str,
        views: &[View],
        samples: usize,
        seed: u32,
        each: &mut dyn FnMut(usize) -> Result<(), crate::Error>,
    ) -> Result<Report, crate::Error> {
        let bands = Bands::new();
        let sides = [true, false];
        let mut done = 0;
        let mut upf = None;
        let mut row = |view: Option<View>, is_face: bool| -> Result<Row, crate::Error> {
            each(done)?;
            done += 1;
            let batches = cloth.energies(
                &|u| match view {
                    Some(view) => view.direction(),
                    None => diffuse(is_face, u),
                },
                samples,
                seed.wrapping_mul(1009).wrapping_add(done as u32),
            );
            if view.is_some_and(|view| view.tilt_rad == 0.0 && view.is_face) && upf.is_none() {
                upf = Some(protection(&batches));
            }
            Ok(Row::new(view, is_face, &batches, &bands))
        };
        let mut along = |is_face| row(Some(View { tilt_rad: 0.0, azimuth_rad: 0.0, is_face }), is_face);
        let normal = [along(sides[0])?, along(sides[1])?];
        let diffuse = [row(None, true)?, row(None, false)?];
        let rows = views.iter().map(|view| row(Some(*view), view.is_face)).collect::<Result<Vec<_>, _>>()?;
        let upf = upf.filter(|_| cloth.beyond().uv_per_um.is_some());
        Ok(Report {
            made_by: Format::Report.mark(),
            cloth: name.into(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            samples: samples.div_ceil(BATCHES) * BATCHES,
            seed,
            normal,
            diffuse,
            rows,
            upf,
            solar_beyond: bands.solar_ends,
            notes: notes(cloth, upf.is_some()),
        })
    }

    /// Largest sum of reflected and transmitted light over the rows, minus three standard errors.
    pub fn largest_total(&self) -> f64 {
        // Absorbed light is the remainder of each sample, so its error is that of the sum.
        let total = |row: &Row| 1.0 - row.solar_absorbed.value - 3.0 * row.solar_absorbed.se;
        self.normal.iter().chain(&self.diffuse).chain(&self.rows).map(total).fold(0.0, f64::max)
    }

    /// The report as the text of a file with this ending.
    pub fn text(&self, ending: &str) -> String {
        match ending {
            "json" => self.json(),
            "csv" => self.csv(),
            "html" => self.html(),
            _ => self.markdown(),
        }
    }

    /// The report as JSON.
    pub fn json(&self) -> String {
        // Its numbers are finite, so serialization cannot fail.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// The rows as CSV: angles in degrees, `diffuse` for the mean over the hemisphere.
    pub fn csv(&self) -> String {
        let mut out = String::from(CSV_HEAD);
        for name in COLUMNS {
            let _ = write!(out, ",{name},{name}_se");
        }
        out.push('\n');
        for row in self.diffuse.iter().chain(&self.rows) {
            let (tilt, azimuth) = angles(row);
            let _ = write!(out, "{},{tilt},{azimuth}", side(row.is_face));
            for e in numbers(row) {
                let _ = write!(out, ",{:.6},{:.6}", e.value, e.se);
            }
            out.push('\n');
        }
        out
    }

    /// The report as one page of Markdown.
    pub fn markdown(&self) -> String {
        let mut out = format!("# {}\n\n", self.cloth);
        for line in self.notes.iter().chain([&self.made()]) {
            let _ = writeln!(out, "- {line}");
        }
        for (title, head, rows) in self.tables() {
            let _ = writeln!(out, "\n## {title}\n\n| {} |\n|{}", head.join(" | "), "---|".repeat(head.len()));
            for row in rows {
                let _ = writeln!(out, "| {} |", row.join(" | "));
            }
        }
        out
    }

    /// The report as one page of HTML.
    pub fn html(&self) -> String {
        let name = escaped(&self.cloth);
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{name}</title>\n<style>\n\
             body {{ font: 15px/1.5 sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em }}\n\
             table {{ border-collapse: collapse }}\nth, td {{ padding: .2em .7em; text-align: right; border-bottom: 1px solid #ccc }}\n\
             th:first-child, td:first-child {{ text-align: left }}\n</style>\n</head>\n<body>\n<h1>{name}</h1>\n<ul>\n"
        );
        for line in self.notes.iter().chain([&self.made()]) {
            let _ = writeln!(out, "<li>{}</li>", escaped(line));
        }
        out.push_str("</ul>\n");
        for (title, head, rows) in self.tables() {
            let cells = |tag: &str, cells: &[String]| -> String {
                cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escaped(c))).collect()
            };
            let _ = writeln!(out, "<h2>{title}</h2>\n<table>\n<tr>{}</tr>", cells("th", &head));
            for row in &rows {
                let _ = writeln!(out, "<tr>{}</tr>", cells("td", row));
            }
            out.push_str("</table>\n");
        }
        out.push_str("</body>\n</html>\n");
        out
    }

    fn made(&self) -> String {
        format!(
            "Made by {}, version {}, with {} samples a row and seed {}. The number after +- is a standard error.",
            self.made_by, self.program_version, self.samples, self.seed
        )
    }

    fn tables(&self) -> Vec<PageTable> {
        let [face, back] = &self.normal;
        let strings = |of: &[&str]| of.iter().map(|s| (*s).to_string()).collect::<Vec<_>>();
        let five: [(&str, Quantity); 5] = [
            ("solar transmittance", |r| r.solar_transmitted),
            ("solar reflectance", |r| r.solar_reflected),
            ("solar absorptance", |r| r.solar_absorbed),
            ("visible transmittance, normal-hemispherical", |r| r.transmitted),
            ("visible transmittance, normal-normal", |r| r.into_cone),
        ];
        let mut summary: Vec<Vec<String>> =
            five.iter().map(|(name, of)| vec![(*name).into(), shown(of(face)), shown(of(back))]).collect();
        summary.push(vec!["openness".into(), shown(face.openness), shown(back.openness)]);
        if let Some(upf) = self.upf {
            summary.push(vec!["UPF".into(), format!("{:.1} +- {:.1}", upf.value, upf.se), String::new()]);
        }
        let head = ["light from", "tilt [deg]", "azimuth [deg]", "R", "T", "straight", "openness"];
        let light = |row: &Row| {
            let (tilt, azimuth) = angles(row);
            let numbers = [row.reflected, row.transmitted, row.straight, row.openness].map(shown);
            [vec![side(row.is_face).into(), tilt, azimuth], numbers.to_vec()].concat()
        };
        let color = |row: &Row| {
            let (tilt, azimuth) = angles(row);
            let lab = |lab: &[Estimate; 3]| lab.map(|e| format!("{:.2} +- {:.2}", e.value, e.se)).to_vec();
            [vec![side(row.is_face).into(), tilt, azimuth], lab(&row.lab_reflected), lab(&row.lab_transmitted)].concat()
        };
        let all: Vec<&Row> = self.diffuse.iter().chain(&self.rows).collect();
        vec![
            ("Numbers of EN 14501", strings(&["of light along the normal", "to the face", "to the back"]), summary),
            ("Visible light by angle", strings(&head), all.iter().map(|row| light(row)).collect()),
            (
                "Color by angle (CIELAB, D65, 10 degrees)",
                strings(&["light from", "tilt [deg]", "azimuth [deg]", "R: L*", "a*", "b*", "T: L*", "a*", "b*"]),
                all.iter().map(|row| color(row)).collect(),
            ),
        ]
    }
}

/// Title, header and rows of a table on the page.
type PageTable = (&'static str, Vec<String>, Vec<Vec<String>>);
/// A quantity of a row.
type Quantity = fn(&Row) -> Estimate;

/// Ultraviolet protection factor: 1 over the transmittance in the ultraviolet. The absorption there is a
/// single number, so the weights of sunlight and skin cancel.
fn protection(batches: &[Energies]) -> Estimate {
    let through = |e: &Energies| e.straight + e.transmitted.ends[0];
    let mean = Estimate::of(&batches.iter().map(through).collect::<Vec<_>>());
    let value = 1.0 / mean.value.max(1e-9);
    Estimate { value, se: value * value * mean.se }
}

fn notes(cloth: &MeanCloth, has_upf: bool) -> Vec<String> {
    let mut notes = vec![
        "The light is computed with rays: what passes between the fibers keeps its direction, where diffraction would spread it by about one degree."
            .to_string(),
        "The normal-normal transmittance counts all light that leaves within 5 degrees of the direction in which it came."
            .to_string(),
    ];
    notes.extend(super::beyond_note(cloth.beyond()));
    notes.push(match has_upf {
        true => {
            "The UPF is 1 over the transmittance along the normal. One absorption is assumed from 0.29 to 0.4 um, so that the weights of sun and skin cancel."
                .into()
        }
        false => "UPF is not computed: the colors of the yarns are not known below 0.38 um. Give the absorption there with --sigma-uv."
            .into(),
    });
    notes
}

const COLUMNS: [&str; 14] = [
    "reflected",
    "transmitted",
    "straight",
    "openness",
    "into_cone",
    "solar_reflected",
    "solar_transmitted",
    "solar_absorbed",
    "reflected_L",
    "reflected_a",
    "reflected_b",
    "transmitted_L",
    "transmitted_a",
    "transmitted_b",
];

fn numbers(row: &Row) -> [Estimate; 14] {
    let ([l, a, b], [tl, ta, tb]) = (row.lab_reflected, row.lab_transmitted);
    [
        row.reflected,
        row.transmitted,
        row.straight,
        row.openness,
        row.into_cone,
        row.solar_reflected,
        row.solar_transmitted,
        row.solar_absorbed,
        l,
        a,
        b,
        tl,
        ta,
        tb,
    ]
}

fn side(is_face: bool) -> &'static str {
    if is_face { "face" } else { "back" }
}

/// Tilt and azimuth in degrees.
fn angles(row: &Row) -> (String, String) {
    let degrees = |rad: f64| {
        let text = format!("{:.3}", rad.to_degrees());
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    };
    match &row.view {
        Some(view) => (degrees(view.tilt_rad), degrees(view.azimuth_rad)),
        None => ("diffuse".into(), "diffuse".into()),
    }
}

fn shown(e: Estimate) -> String {
    format!("{:.4} +- {:.4}", e.value, e.se)
}
