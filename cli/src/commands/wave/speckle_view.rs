//! Report and figures of speckle patterns: contrast and width of every kind, patterns and covariances.

use crate::args::Cli;
use crate::commands::wave::compare::color_of;
use crate::failure::{Failure, Outcome, one_line};
use crate::output;
use crate::plot::axes::LogScale;
use crate::plot::color::Rgb;
use crate::plot::figure::Figure;
use crate::plot::lines::{self, Curve, LinePanel, Row, Scale};
use crate::plot::page::Head;
use crate::plot::text::literal;
use crate::report::{self, counted, number};
use plywave::spec::YarnSpec;
use plywave_tables::speckle::{SpecklePatterns, SpecklePolarization, SpeckleSide};
use std::path::Path;

/// Statistics of the patterns at one absorption and wavelength on one side.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PatternKind {
    /// Imaginary index.
    pub kappa: f64,
    /// Wavelength [um].
    pub lambda_um: f64,
    /// Range of azimuths.
    pub side: &'static str,
    /// Mean scattering width of the instances, unpolarized [um].
    pub c_sca_um: f64,
    /// Contrast of TM light.
    pub contrast_tm: f64,
    /// Contrast of TE light.
    pub contrast_te: f64,
    /// Contrast of the mean of both.
    pub contrast_unpolarized: f64,
    /// Standard error of the squared contrast of TM light.
    pub variance_se: f64,
    /// Lag at which the covariance of TM light falls to half [degrees]; null where it does not.
    pub half_width_deg: Option<f64>,
    /// That over the wavelength [degrees/um].
    pub half_width_deg_per_um: Option<f64>,
}

/// All kinds: sides within wavelengths within absorptions.
pub fn kinds(p: &SpecklePatterns) -> Vec<PatternKind> {
    let mut kinds = Vec::new();
    for (a, &kappa) in p.kappa.iter().enumerate() {
        for (l, &lambda_um) in p.lambda_um.iter().enumerate() {
            let [tm, te, both] = [SpecklePolarization::Tm, SpecklePolarization::Te, SpecklePolarization::Unpolarized]
                .map(|pol| p.instances_of(a, l, pol));
            let from = (a * p.lambda_um.len() + l) * 2 * p.instances;
            let widths = &p.c_sca_um[from..from + 2 * p.instances];
            for side in SpeckleSide::EACH {
                let of = |patterns: &[Vec<f64>]| {
                    plywave_tables::speckle::SpeckleStatistics::from_patterns(patterns, side, LAGS_RAD)
                };
                let (tm, te, both) = (of(&tm), of(&te), of(&both));
                let half_width_deg = Some(tm.half_width_rad.to_degrees()).filter(|w| w.is_finite());
                kinds.push(PatternKind {
                    kappa,
                    lambda_um,
                    side: side.name(),
                    c_sca_um: widths.iter().sum::<f64>() / widths.len().max(1) as f64,
                    contrast_tm: tm.contrast,
                    contrast_te: te.contrast,
                    contrast_unpolarized: both.contrast,
                    variance_se: tm.covariance_se[0],
                    half_width_deg,
                    half_width_deg_per_um: half_width_deg.map(|w| w / lambda_um),
                });
            }
        }
    }
    kinds
}

/// Largest lag of the covariances.
const LAGS_RAD: f64 = std::f64::consts::PI / 6.0;

/// The kinds as a table.
pub fn write_kinds(out: &mut dyn std::io::Write, kinds: &[PatternKind]) -> std::io::Result<()> {
    writeln!(out, "  kappa    lambda  side        C_sca    contrast TM, TE, both   half width (over lambda)")?;
    for k in kinds {
        let width = match (k.half_width_deg, k.half_width_deg_per_um) {
            (Some(w), Some(per)) => format!("{w:.2} degrees ({per:.2} /um)"),
            _ => "-".into(),
        };
        writeln!(
            out,
            "  {:<7}  {:<6}  {:<10}  {:<7}  {:.3}  {:.3}  {:.3}      {width}",
            number(k.kappa),
            number(k.lambda_um),
            k.side,
            format!("{:.2}", k.c_sca_um),
            k.contrast_tm,
            k.contrast_te,
            k.contrast_unpolarized
        )?;
    }
    Ok(())
}

/// Prints what a file of patterns holds.
pub fn info(cli: &Cli, file: &str, bytes: u64, p: &SpecklePatterns) -> Outcome {
    let kinds = kinds(p);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file, "kind": "speckle", "bytes": bytes, "program_version": p.program_version, "seed": p.seed,
            "theta_i_deg": p.theta_i.to_degrees(), "w0_um": p.w0_um, "kappa": p.kappa, "lambda_um": p.lambda_um,
            "instances": p.instances, "azimuths": p.azimuths, "statistics": kinds, "spec": p.spec_text,
        }));
    }
    output::print(|out| {
        writeln!(out, "{file}: speckle patterns, {}", report::bytes(bytes))?;
        writeln!(out, "  written by   plywave {}, seed {}", one_line(&p.program_version), p.seed)?;
        writeln!(
            out,
            "  patterns     {}, {} azimuths, {}, {}, TM and TE",
            report::counted(p.instances as u64, "instance", "instances"),
            p.azimuths,
            report::counted(p.lambda_um.len() as u64, "wavelength", "wavelengths"),
            report::counted(p.kappa.len() as u64, "absorption", "absorptions")
        )?;
        writeln!(out, "  beam         w0 {} um, theta_i {} degrees", number(p.w0_um), number(p.theta_i.to_degrees()))?;
        write_kinds(out, &kinds)
    })
}

/// Colors of single patterns.
const SINGLE: [Rgb; 2] = [[150, 160, 185], [205, 170, 130]];
/// Most wavelengths drawn.
const MAX_LAMBDAS: usize = 8;

/// Patterns, covariances over the lag, and over the lag in units of the wavelength, one row an absorption.
pub fn figure(file: &Path, p: &SpecklePatterns) -> Outcome<Figure> {
    const DECADES: f64 = 5.0;
    let spec = YarnSpec::parse(&p.spec_text, &format!("{} (its spec)", file.display()))?;
    let shown: Vec<usize> = (0..p.lambda_um.len()).step_by(p.lambda_um.len().div_ceil(MAX_LAMBDAS)).collect();
    let Some(&first) = shown.first() else {
        return Err(Failure::input(file.display(), "lambda_um", "none", "give patterns of one wavelength or more"));
    };
    let d = p.azimuths;
    // Exact forward, 270 degrees, is in the middle.
    let turned = |values: &[f64]| -> Vec<[f64; 2]> {
        (0..=d).map(|j| [-180.0 + 360.0 * j as f64 / d as f64, values[(j + d / 4) % d]]).collect()
    };
    let curve = |points, color, width| Curve { points, band: Vec::new(), color, width };
    let mut rows = Vec::new();
    for (a, &kappa) in p.kappa.iter().enumerate() {
        let patterns = p.instances_of(a, first, SpecklePolarization::Tm);
        let mean: Vec<f64> =
            (0..d).map(|j| patterns.iter().map(|v| v[j]).sum::<f64>() / patterns.len() as f64).collect();
        let mut curves: Vec<Curve> =
            patterns.iter().zip(SINGLE).map(|(v, color)| curve(turned(v), color, 1.2)).collect();
        curves.push(curve(turned(&mean), color_of(p.lambda_um[first]), 2.0));
        let top = curves.iter().flat_map(|c| &c.points).map(|q| q[1]).fold(0.0, f64::max);
        let ticks = |from: f64, to: f64, count: f64| lines::linear(from, to, count);
        let mut panels = vec![(
            520,
            LinePanel {
                title: format!("{} μm: two instances and their mean [μm/rad]", number(p.lambda_um[first])),
                x_title: "φ_o - 270° [degrees]".into(),
                x: [-180.0, 180.0],
                x_ticks: lines::every(-180.0, 180.0, 60.0),
                y: Scale::Log(LogScale::above(top, DECADES)),
                curves,
            },
        )];
        let all: Vec<(usize, [plywave_tables::speckle::SpeckleStatistics; 2])> = shown
            .iter()
            .map(|&l| {
                let patterns = p.instances_of(a, l, SpecklePolarization::Tm);
                let sides = [SpeckleSide::Reflection, SpeckleSide::Forward];
                (
                    l,
                    sides.map(|side| {
                        plywave_tables::speckle::SpeckleStatistics::from_patterns(&patterns, side, LAGS_RAD)
                    }),
                )
            })
            .collect();
        for (k, side) in ["light's side", "far side"].into_iter().enumerate() {
            for stretched in [false, true] {
                let curves: Vec<Curve> = all
                    .iter()
                    .map(|(l, s)| {
                        let (s, lambda) = (&s[k], p.lambda_um[*l]);
                        let top = s.covariance[0].max(f64::MIN_POSITIVE);
                        let (unit, scale) = if stretched { (lambda, top) } else { (1.0, 1.0) };
                        let at = |(j, c): (usize, &f64)| [s.step_rad.to_degrees() * j as f64 / unit, c / scale];
                        curve(s.covariance.iter().enumerate().map(at).collect(), color_of(lambda), 1.6)
                    })
                    .collect();
                let end = if stretched { 24.0 } else { 12.0 };
                let values = || curves.iter().flat_map(|c| &c.points).filter(|q| q[0] <= end).map(|q| q[1]);
                let (low, high) = (values().fold(0.0, f64::min), values().fold(0.01, f64::max));
                let margin = 0.06 * (high - low);
                let (title, x_title) = match stretched {
                    false => (format!("C, {side}"), "lag [degrees]"),
                    true => (format!("C / C(0), {side}"), "lag / λ [degrees/μm]"),
                };
                panels.push((
                    260,
                    LinePanel {
                        title,
                        x_title: x_title.into(),
                        x: [0.0, end],
                        x_ticks: ticks(0.0, end, 4.0),
                        y: Scale::Linear(low - margin, high + margin),
                        curves,
                    },
                ));
            }
        }
        rows.push(Row { title: format!("κ = {}", number(kappa)), panels, height: 280 });
    }
    let legend: Vec<(String, Rgb)> = shown
        .iter()
        .map(|&l| (format!("{} μm", number(p.lambda_um[l])), color_of(p.lambda_um[l])))
        .chain([("single instances".into(), SINGLE[0])])
        .collect();
    let name = literal(&spec.name, 80);
    let particulars = vec![format!(
        "{} of one fiber, θ_i = {}°, w_0 = {} μm, seed {}; TM light; C: covariance of the intensity over its mean, without 20° either side of forward",
        counted(p.instances as u64, "instance", "instances"),
        number(p.theta_i.to_degrees()),
        number(p.w0_um),
        p.seed
    )];
    Ok(lines::page(&Head { title: format!("{name}: speckle of single fibers"), particulars, legend }, &rows))
}
