//! Figure of a fiber table: azimuthal scattering by wavelength at a few latitudes, and the widths over which
//! it intercepts light.

use crate::commands::wave::compare::color_of;
use crate::failure::{Failure, Outcome};
use crate::plot::axes::LogScale;
use crate::plot::color::Rgb;
use crate::plot::figure::Figure;
use crate::plot::lines::{self, Curve, LinePanel, Row, Scale};
use crate::plot::page::Head;
use crate::plot::text::literal;
use crate::report::{counted, number};
use plywave_fiber::{FiberSource, FiberTable};
use std::path::Path;

/// Largest number of wavelengths drawn.
const MAX_LAMBDAS: usize = 4;
/// Latitudes drawn [degrees]; the nearest nodes of the table are used.
const LATITUDES: [f64; 3] = [0.0, 35.0, 70.0];
/// Decades of the azimuthal panels.
const DECADES: f64 = 5.0;
/// Color of widths that do not belong to a wavelength.
const PLAIN: Rgb = [90, 90, 96];

/// The whole figure.
pub fn figure(file: &Path, t: &FiberTable) -> Outcome<Figure> {
    let (lambdas, latitudes, azimuths) = (t.lambda_um.len(), t.theta_i.len(), t.phi_i.len());
    let cells = t.azimuthal.len() / t.c_x_um.len().max(1);
    if lambdas == 0 || latitudes == 0 || azimuths == 0 || cells < 2 {
        return Err(Failure::input(file.display(), "azimuthal", "none", "give a whole fiber table"));
    }
    let shown: Vec<usize> =
        (0..lambdas.min(MAX_LAMBDAS)).map(|i| i * (lambdas - 1) / (lambdas.min(MAX_LAMBDAS) - 1).max(1)).collect();
    let nearest = |deg: f64| {
        let away = |m: usize| (t.theta_i[m] - deg.to_radians()).abs();
        (0..latitudes).min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or(0)
    };
    let mut rows_of: Vec<usize> = LATITUDES.map(nearest).to_vec();
    rows_of.dedup();
    let slice = |l: usize, m: usize, p: usize| (l * latitudes + m) * azimuths + p;
    let curve = |points, color, width| Curve { points, band: Vec::new(), color, width };
    // The first and the middle azimuth of incidence.
    let mut sides = vec![0, azimuths / 2];
    sides.dedup();
    let mut rows = Vec::new();
    for &m in &rows_of {
        let panels = sides
            .iter()
            .map(|&p| {
                // Exact forward, phi_r - phi_i = 180 degrees, is in the middle.
                let points = |l: usize| -> Vec<[f64; 2]> {
                    let values = &t.azimuthal[slice(l, m, p) * cells..][..cells];
                    (0..=cells).map(|j| [360.0 * j as f64 / cells as f64, f64::from(values[j % cells])]).collect()
                };
                let curves: Vec<Curve> =
                    shown.iter().map(|&l| curve(points(l), color_of(t.lambda_um[l]), 1.4)).collect();
                let top = curves.iter().flat_map(|c| &c.points).map(|q| q[1]).fold(1e-12, f64::max);
                let panel = LinePanel {
                    title: format!("N [1/rad], light from φ_i = {}°", number(t.phi_i[p].to_degrees())),
                    x_title: "φ_r - φ_i [degrees]".into(),
                    x: [0.0, 360.0],
                    x_ticks: lines::every(0.0, 360.0, 90.0),
                    y: Scale::Log(LogScale::above(top, DECADES)),
                    curves,
                };
                (480, panel)
            })
            .collect();
        rows.push(Row { title: format!("θ_i = {:.1}°", t.theta_i[m].to_degrees()), panels, height: 240 });
    }
    if lambdas > 1 {
        let ends = [t.lambda_um[0], t.lambda_um[lambdas - 1]];
        let panels = sides
            .iter()
            .map(|&p| {
                let of = |values: &[f64]| -> Vec<Vec<[f64; 2]>> {
                    let at = |m: usize| (0..lambdas).map(|l| [t.lambda_um[l], values[slice(l, m, p)]]).collect();
                    rows_of.iter().map(|&m| at(m)).collect()
                };
                let mut curves = Vec::new();
                let shade = |i: usize| -> Rgb { [30 + 70 * i as u8, 90 + 40 * i as u8, 160 + 25 * i as u8] };
                curves.extend(of(&t.c_x_um).into_iter().enumerate().map(|(i, c)| curve(c, shade(i), 2.0)));
                curves.extend(of(&t.c_abs_um).into_iter().enumerate().map(|(i, c)| curve(c, shade(i), 1.0)));
                let width = t.width_um[p];
                curves.push(curve(vec![[ends[0], width], [ends[1], width]], PLAIN, 1.0));
                let top = curves.iter().flat_map(|c| &c.points).map(|q| q[1]).fold(1e-12, f64::max);
                let panel = LinePanel {
                    title: "C_x, absorbed (thin), own width (gray) [μm]".into(),
                    x_title: "λ [μm]; darker is θ_i nearer to 0".into(),
                    x: ends,
                    x_ticks: lines::linear(ends[0], ends[1], 4.0),
                    y: Scale::Linear(0.0, 1.05 * top),
                    curves,
                };
                (480, panel)
            })
            .collect();
        rows.push(Row { title: "widths".into(), panels, height: 220 });
    }
    let legend: Vec<(String, Rgb)> =
        shown.iter().map(|&l| (format!("{:.3} μm", t.lambda_um[l]), color_of(t.lambda_um[l]))).collect();
    let source = match t.source {
        FiberSource::Wave => "wave optics",
        FiberSource::Ray => "ray optics",
    };
    let particulars = vec![format!(
        "{source}: {}, {}, {} of the light, {cells} of the scattered light; N: scattered share of the extinguished power per azimuth, unpolarized",
        counted(lambdas as u64, "wavelength", "wavelengths"),
        counted(latitudes as u64, "latitude", "latitudes"),
        counted(azimuths as u64, "azimuth", "azimuths"),
    )];
    let name = file.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let name = literal(&name, 80);
    Ok(lines::page(&Head { title: format!("{name}: scattering of a single fiber"), particulars, legend }, &rows))
}
