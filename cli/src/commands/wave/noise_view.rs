//! Figures of noise: synthesized patterns beside simulated ones (Yu 2025, Fig. 11 a), and what a model's
//! noise does to its terms (Fig. 11 b).

use crate::commands::wave::noise::{LINES, spec_of};
use crate::failure::Outcome;
use crate::plot::axes::{self, BELOW, LEFT, linear};
use crate::plot::color::Rgb;
use crate::plot::figure::{Figure, INK, LINE, Panel};
use crate::plot::lines::{self, Curve, LinePanel, Row, Scale};
use crate::plot::page::{Head, page};
use crate::plot::text::literal;
use crate::report::number;
use plywave::color::{color_matching, linear_srgb_of_xyz, srgb_encode};
use plywave::frame::direction;
use plywave::ply::{PlyPlace, PlyTerms};
use plywave::{PlyModel, PlyQuery};
use plywave_tables::speckle::SpecklePatterns;
use plywave_wave::noise::{LineComparison, NoiseOptions, PatternCovariance, compare_lines};
use std::path::Path;

const SIMULATED: Rgb = [120, 128, 150];
const SYNTHESIZED: Rgb = [200, 60, 50];
/// Azimuths that are shown of each kind, off exact forward [degrees].
const WINDOWS: [[f64; 2]; 2] = [[110.0, 150.0], [40.0, 80.0]];

/// Two simulated and two synthesized patterns of each kind, and the covariances at three wavelengths.
pub fn lines(file: &Path, patterns: &SpecklePatterns) -> Outcome<Figure> {
    let spec = spec_of(file, patterns)?;
    let options = NoiseOptions { w0_um: spec.beam.w0_um, ..NoiseOptions::default() };
    let rows = compare_lines(patterns, &options, LINES / 2, &file.display().to_string())?;
    let last = patterns.lambda_um.len() - 1;
    let mut shown = vec![0, last / 2, last];
    shown.dedup();
    let drawn =
        (0..2).map(|k| row(&rows[k * (last + 1)..(k + 1) * (last + 1)], &shown, WINDOWS[k])).collect::<Vec<_>>();
    let name = literal(&spec.name, 80);
    let particulars = vec![
        "unpolarized light; N = |a + g|², a constant phasor and a Gaussian field whose contrast and covariance are the simulated ones".to_string(),
        "one field at the shortest wavelength, stretched to the others; C: covariance of the intensity over its squared mean, all azimuths by their light".to_string(),
    ];
    let legend = vec![("simulated".to_string(), SIMULATED), ("synthesized".to_string(), SYNTHESIZED)];
    Ok(lines::page(&Head { title: format!("{name}: noise beside simulated patterns"), particulars, legend }, &drawn))
}

fn row(rows: &[LineComparison], shown: &[usize], window: [f64; 2]) -> Row {
    let first = &rows[0];
    let d = first.mean.len();
    let inside = |values: &[f64]| -> Vec<[f64; 2]> {
        (0..d)
            .map(|j| [360.0 * j as f64 / d as f64 - 270.0, values[j]])
            .map(|[x, y]| [if x < -180.0 { x + 360.0 } else { x }, y])
            .filter(|[x, _]| (window[0]..=window[1]).contains(x))
            .collect::<Vec<_>>()
    };
    let sorted = |values: &[f64]| {
        let mut points = inside(values);
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    };
    let curve = |points, color, width| Curve { points, band: Vec::new(), color, width };
    let all: Vec<Vec<[f64; 2]>> = first.two_simulated.iter().chain(&first.two_synthesized).map(|v| sorted(v)).collect();
    let top = all.iter().flatten().map(|q| q[1]).fold(0.0, f64::max);
    let low = all.iter().flatten().map(|q| q[1]).fold(0.0, f64::min);
    let margin = 0.05 * (top - low).max(f64::MIN_POSITIVE);
    let mut panels = Vec::new();
    for (k, (name, color)) in [("simulated", SIMULATED), ("synthesized", SYNTHESIZED)].into_iter().enumerate() {
        let light: Rgb = color.map(|v| v + (255 - v) / 2);
        panels.push((
            360,
            LinePanel {
                title: format!("f_{{{}}}, {name} [μm/rad]", first.kind),
                x_title: format!("φ_o - 270° [degrees], {} μm", number(first.lambda_um)),
                x: window,
                x_ticks: lines::linear(window[0], window[1], 4.0),
                y: Scale::Linear(low - margin, top + margin),
                curves: vec![
                    curve(all[2 * k].clone(), light, 1.3),
                    curve(all[2 * k + 1].clone(), color, 1.6),
                    curve(sorted(&first.mean), INK, 1.0),
                ],
            },
        ));
    }
    let values = |c: &PatternCovariance| -> Vec<[f64; 2]> {
        c.values.iter().enumerate().map(|(j, v)| [c.step_rad.to_degrees() * j as f64, *v]).collect()
    };
    for &l in shown {
        let row = &rows[l];
        let curves =
            vec![curve(values(&row.simulated), SIMULATED, 3.0), curve(values(&row.synthesized), SYNTHESIZED, 1.4)];
        let end = 8.0;
        let points = || curves.iter().flat_map(|c| &c.points).filter(|q| q[0] <= end).map(|q| q[1]);
        let (low, high) = (points().fold(0.0, f64::min), points().fold(1e-6, f64::max));
        let margin = 0.08 * (high - low);
        panels.push((
            270,
            LinePanel {
                title: format!(
                    "C, {} μm; √C(0): {:.3}, {:.3}",
                    number(row.lambda_um),
                    row.simulated.contrast(),
                    row.synthesized.contrast()
                ),
                x_title: "lag [degrees]".into(),
                x: [0.0, end],
                x_ticks: lines::linear(0.0, end, 4.0),
                y: Scale::Linear(low - margin, high + margin),
                curves,
            },
        ));
    }
    Row { title: String::new(), panels, height: 280 }
}

/// Wavelengths that a color is summed over [um].
const LAMBDAS: [f32; 12] = [0.42, 0.445, 0.47, 0.495, 0.52, 0.545, 0.57, 0.595, 0.62, 0.645, 0.67, 0.695];
/// Size of a panel [pixels]; 6 pixels a degree.
const PANEL: [i32; 2] = [300, 240];
const DOTS: f64 = 6.0;
/// Latitude at the middle of a panel [degrees].
const MIDDLE: f64 = -8.0;

/// Linear sRGB of a spectrum at [`LAMBDAS`]; of one that is 1, white.
fn rgb(light: &[f32; 12]) -> [f64; 3] {
    let sum = |value: &dyn Fn(usize) -> f64| {
        let mut xyz = [0.0; 3];
        for (i, lambda) in LAMBDAS.iter().enumerate() {
            let bar = color_matching(f64::from(*lambda));
            (0..3).for_each(|k| xyz[k] += value(i) * bar[k]);
        }
        linear_srgb_of_xyz(xyz)
    };
    let (of, white) = (sum(&|i| f64::from(light[i])), sum(&|_| 1.0));
    std::array::from_fn(|k| of[k] / white[k])
}

/// One place of a model with noise at two incidences: smooth, as the place has it, and the noise alone.
/// Grayscale where light is smooth, color by
/// [`LAMBDAS`].
pub fn model(title: &str, model: &PlyModel) -> Figure {
    const GAP: [i32; 2] = [26, LINE + BELOW + 6];
    let mut head = Head { title: title.into(), ..Head::default() };
    let Some(noise) = model.noise() else { return page(&head, [0, 0], |_, _, _| ()) };
    head.particulars.push(format!(
        "speckle noise of one place at h = 0, σ = 0, in the color of 12 wavelengths; contrast of the simulated fibers {:.3} (refl), {:.3} (high); the same scale in a row's three panels of a kind",
        noise.contrast()[0],
        noise.contrast()[1]
    ));
    let place = PlyPlace::new(1, 0.0, 0.0);
    let size = [LEFT + LINE + 6 * (PANEL[0] + GAP[0]), 2 * (PANEL[1] + GAP[1])];
    page(&head, size, |figure, left, top| {
        for (row, theta_deg) in [0.0f64, 15.0].into_iter().enumerate() {
            let theta_i = theta_deg.to_radians() as f32;
            let bsdf = model.at(&PlyQuery::lobes(theta_i, 0.0, [0.0]));
            let y = top + LINE + row as i32 * (PANEL[1] + GAP[1]);
            figure.text_up(left, y + PANEL[1] / 2, PANEL[1], &format!("θ_i = {}°", number(theta_deg)));
            for kind in 0..2 {
                // Reflection about the light's azimuth, high-order light beside forward.
                let center = [90.0, 305.0][kind];
                let lit = |i: i32, j: i32| {
                    let phi = center + (f64::from(i - PANEL[0] / 2) + 0.5) / DOTS;
                    let theta = MIDDLE - (f64::from(j - PANEL[1] / 2) + 0.5) / DOTS;
                    let wo = direction(theta.to_radians() as f32, phi.to_radians() as f32);
                    let PlyTerms { refl, high: [high], .. } = bsdf.terms(wo);
                    let (n_refl, n_high) = noise.factors(&place, 0.0, theta_i, wo, LAMBDAS);
                    (if kind == 0 { refl } else { high }, if kind == 0 { n_refl } else { n_high })
                };
                let every_eighth = |n: i32| (0..n).step_by(8);
                let values = every_eighth(PANEL[1]).flat_map(|j| every_eighth(PANEL[0]).map(move |i| (i, j)));
                let brightest = values.map(|(i, j)| lit(i, j).0).fold(f32::MIN_POSITIVE, f32::max);
                let scale = 0.45 / f64::from(brightest);
                let name = ["refl", "high"][kind];
                let titles = [format!("f_{{{name}}}"), format!("f_{{{name}}} N"), format!("N_{{{name}}}")];
                for (part, title) in titles.iter().enumerate() {
                    let x = left + LINE + LEFT + (3 * kind + part) as i32 * (PANEL[0] + GAP[0]);
                    let at = Panel { x, y, w: PANEL[0], h: PANEL[1] };
                    figure.pixels(at, |i, j| {
                        let (f, n) = lit(i, j);
                        let f = f64::from(f) * scale;
                        let color = match part {
                            0 => [f; 3],
                            1 => rgb(&n).map(|v| f * v),
                            _ => rgb(&n).map(|v| 0.35 * v),
                        };
                        color.map(|v| (255.0 * srgb_encode(v.clamp(0.0, 1.0))).round() as u8)
                    });
                    figure.frame(at, INK);
                    axes::above(figure, at, title);
                    let half = PANEL.map(|n| f64::from(n) / DOTS / 2.0);
                    axes::below(figure, at, &linear(center - half[0], center + half[0], 4.0), "φ_o [degrees]");
                    if part == 0 && kind == 0 {
                        axes::left(figure, at, &linear(MIDDLE - half[1], MIDDLE + half[1], 4.0), "");
                    }
                }
            }
        }
    })
}
