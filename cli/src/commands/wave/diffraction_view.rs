//! `plywave plot SPEC`: diffraction of the beam of a yarn at gaps and at the ply's edge.

use crate::args::PlotArgs;
use crate::failure::{Failure, Outcome};
use crate::plot::axes::LogScale;
use crate::plot::figure::Figure;
use crate::plot::lines::{self, Curve, LinePanel, Row, Scale};
use crate::plot::page::Head;
use crate::plot::pattern::{self, BANDS, Daylight, Pattern};
use crate::plot::text::literal;
use crate::report::number;
use plywave::Bsdf;
use plywave::frame::direction;
use plywave::gap::{Aperture, Gap};
use plywave::math::faddeeva::{diffraction_factor, power_between};
use plywave::ply::EdgeLobes;
use plywave::spec::{GaussianBeam, YarnSpec};
use plywave_fit::{EdgeOptions, fit_edge};

/// Width and height [um] of the gaps shown without --gap.
const GAPS_UM: [[f32; 2]; 4] = [[2.0, 2.0], [5.0, 20.0], [10.0, 10.0], [40.0, 40.0]];
/// Wavelengths [um] at which the energy is printed.
const ENERGY_UM: [f32; 3] = [0.45, 0.55, 0.65];
/// Greatest tilt [degrees].
const MAX_TILT: f64 = 80.0;
/// Pixels along a pattern.
const SIDE: usize = 300;

/// The figure the flags ask for: gap patterns, or edge lobes with `--part edge`.
pub fn figure(args: &PlotArgs, spec: &YarnSpec, edge: bool) -> Outcome<Figure> {
    let beam = spec.beam.beam();
    let name = literal(&spec.name, 80);
    if edge { Ok(edge_lobes(&name, spec, &beam)) } else { gaps(args, &name, &beam) }
}

/// Apertures from numbers W,H[,X,Y].
fn apertures(numbers: &[f64]) -> Outcome<Vec<Aperture>> {
    let centered = |[w, h]: [f32; 2], [x, y]: [f32; 2]| {
        Aperture::new([x - 0.5 * w, x + 0.5 * w], [y - 0.5 * h, y + 0.5 * h]).map_err(|_| {
            let value = format!("{w},{h}");
            Failure::input("command line", "--gap", value, "give a width and a height above 0 [um], as in --gap 10,20")
        })
    };
    match numbers.iter().map(|v| *v as f32).collect::<Vec<f32>>()[..] {
        [] => GAPS_UM.iter().map(|size| centered(*size, [0.0; 2])).collect(),
        [w, h] => Ok(vec![centered([w, h], [0.0; 2])?]),
        [w, h, x, y] => Ok(vec![centered([w, h], [x, y])?]),
        _ => {
            let hint = "give width and height [um], and optionally the center's x and y";
            Err(Failure::input("command line", "--gap", format!("{} numbers", numbers.len()), hint))
        }
    }
}

fn gaps(args: &PlotArgs, name: &str, beam: &GaussianBeam) -> Outcome<Figure> {
    if args.tilt.is_nan() || args.tilt.abs() > MAX_TILT {
        let hint = format!("must be from -{MAX_TILT} to {MAX_TILT} degrees");
        return Err(Failure::input("command line", "--tilt", args.tilt, &hint));
    }
    let (s, c) = args.tilt.to_radians().sin_cos();
    let xi_i = [s as f32, 0.0, c as f32];
    let day = Daylight::new();
    let patterns: Vec<Pattern> = apertures(&args.gap)?
        .iter()
        .map(|a| {
            let gap = Gap::new(a, beam);
            let at = gap.at(xi_i, day.lambda_um);
            let size = |[a, b]: [f32; 2]| b - a;
            let min = f64::from(size(a.x_um).min(size(a.y_um))).min(2.0 * beam.d_cut_um);
            // The range is three lobes of the narrower side in green light, limited to existing directions.
            let reach = (3.0 * f64::from(ENERGY_UM[1]) / min).max(6.0 * beam.divergence_rad()).min(1.0);
            let title = format!("{} x {} μm", number(size(a.x_um).into()), number(size(a.y_um).into()));
            let energy = gap.at(xi_i, ENERGY_UM).albedo();
            let note = format!("energy {:.3} {:.3} {:.3}", energy[0], energy[1], energy[2]);
            Pattern::sample(title, note, reach, SIDE, |dx, dy| {
                let (x, y) = (dx as f32 - xi_i[0], dy as f32 - xi_i[1]);
                match 1.0 - x * x - y * y {
                    z2 if z2 > 0.0 => day.rgb(&at.eval([x, y, -z2.sqrt()])),
                    _ => [0.0; 3],
                }
            })
        })
        .collect();
    let particulars = vec![
        format!(
            "Gaussian beam, w_0 = {} μm, tilted by {}° towards x; directions by the change of their components x, y in the plane",
            number(beam.w0_um),
            number(args.tilt)
        ),
        format!(
            "daylight D65 in {BANDS} bands from 0.38 to 0.78 μm, CIE 1931; below: 100 times the light; energy: what f integrates to at {} {} {} μm",
            ENERGY_UM[0], ENERGY_UM[1], ENERGY_UM[2]
        ),
    ];
    let title = format!("{name}: diffraction by gaps of the weave");
    Ok(pattern::page(&Head { title, particulars, legend: Vec::new() }, &patterns))
}

/// Edge lobes and the diffraction integral in the plane across the ply: columns of e = R - |h|, rows of
/// wavelengths.
fn edge_lobes(name: &str, spec: &YarnSpec, beam: &GaussianBeam) -> Figure {
    const LAMBDA: [f64; 3] = [0.45, 0.55, 0.65];
    const DECADES: f64 = 4.0;
    const COLORS: [[u8; 3]; 2] = [[40, 90, 170], [200, 80, 40]];
    let fit = fit_edge(spec, &EdgeOptions::default());
    let d = beam.d_cut_um;
    let insides = [-d, -0.5 * d, 0.0, 0.5 * d];
    let rows = LAMBDA
        .iter()
        .map(|&lambda| {
            let panels = insides
                .iter()
                .map(|&e| {
                    let curves = [integral(beam, lambda, e), lobe(&fit.lobes, lambda, e)];
                    let top = curves.iter().flatten().map(|p| p[1]).fold(0.0, f64::max);
                    let curves = curves.into_iter().zip(COLORS).map(|(points, color)| Curve {
                        points,
                        band: vec![],
                        color,
                        width: 1.8,
                    });
                    let panel = LinePanel {
                        title: format!("R - |h| = {} μm", number(e)),
                        x_title: "across the ply [degrees]".into(),
                        x: [-REACH, REACH],
                        x_ticks: lines::linear(-REACH, REACH, 4.0),
                        y: Scale::Log(LogScale::above(top, DECADES)),
                        curves: curves.collect(),
                    };
                    (300, panel)
                })
                .collect();
            Row { title: format!("λ = {} μm", number(lambda)), panels, height: 240 }
        })
        .collect::<Vec<_>>();
    let worst = fit.error.iter().fold(0.0f64, |a, b| a.max(*b));
    let particulars = vec![format!(
        "w_0 = {} μm, d_{{cut}} = {} μm; f / r_d [1/sr], both of energy 1; relative L2 distance over all (λ, h): at most {:.3}",
        number(beam.w0_um),
        number(d),
        worst
    )];
    let legend = vec![("diffraction integral".to_string(), COLORS[0]), ("lobe".to_string(), COLORS[1])];
    lines::page(&Head { title: format!("{name}: diffraction at the ply's edge"), particulars, legend }, &rows)
}

/// Degrees shown either side of the forward direction.
const REACH: f64 = 15.0;
/// Points of a curve.
const POINTS: usize = 601;

fn angles() -> impl Iterator<Item = f64> {
    (0..POINTS).map(|i| REACH * (2.0 * i as f64 / (POINTS - 1) as f64 - 1.0))
}

/// The pattern of the half plane x > e in the plane z = 0, normal incidence, over the light that passes.
fn integral(beam: &GaussianBeam, lambda: f64, e: f64) -> Vec<[f64; 2]> {
    let (d, w0) = (beam.d_cut_um, beam.w0_um);
    let square = |[re, im]: [f64; 2]| re * re + im * im;
    let power = power_between(e, d, w0) * power_between(-d, d, w0);
    let along = square(diffraction_factor(-d, d, 0.0, w0));
    angles()
        .map(|deg| {
            let (s, c) = deg.to_radians().sin_cos();
            let across = square(diffraction_factor(e, d, s / lambda, w0));
            [deg, 0.25 * (1.0 + c).powi(2) * across * along / (power * lambda * lambda)]
        })
        .collect()
}

fn lobe(lobes: &EdgeLobes, lambda: f64, e: f64) -> Vec<[f64; 2]> {
    let lobe = lobes.lobe(0.0, lobes.radius_um - e, lambda);
    angles()
        .map(|deg| {
            let phi = (270.0 + deg).to_radians();
            [deg, lobe.eval(direction(0.0, phi as f32).map(f64::from))]
        })
        .collect()
}
