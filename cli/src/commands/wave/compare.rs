//! `plywave compare`: compares wave and ray optics for the cross sections of a ply (Yu 2025, Fig. 7).

use crate::args::{Cli, CompareArgs};
use crate::commands::latitude;
use crate::commands::runs::{self, ProgressNames};
use crate::failure::{Failure, Outcome};
use crate::plot::axes::LogScale;
use crate::plot::color::Rgb;
use crate::plot::figure::Figure;
use crate::plot::lines::{self, Curve, LinePanel, Row, Scale};
use crate::plot::page::Head;
use crate::plot::text::literal;
use crate::progress;
use crate::report::{self, counted, number};
use crate::{output, plot};
use plywave::spec::YarnSpec;
use plywave_wave::{CompareCase, CompareJob, CompareOptions, CompareReport};
use std::path::Path;

/// File of the report, which also marks a folder as an output of this command.
pub const REPORT: &str = "report.json";
/// The figure beside it.
const FIGURE: &str = "compare.png";

/// Runs the command.
pub fn run(cli: &Cli, args: &CompareArgs) -> Outcome {
    let (spec, text) = plywave_textile::load_yarn_file(&args.spec)?;
    let options = options(args, &spec)?;
    let folder = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.spec, "compare"));
    if args.shards.shards.is_some() {
        output::check_writable(&folder, &[&args.spec])?;
    } else {
        output::check_folder(&folder, REPORT, &[&args.spec])?;
    }
    let job = CompareJob::new(&spec, &text, &options).map_err(|e| runs::failure(e, &args.spec))?;
    let names = ProgressNames { what: "compare", unit: "sections" };
    if runs::run_share(cli, &job, names, &args.shards, (&folder, &args.resume), &args.spec)? {
        return Ok(());
    }
    let parts = runs::open_parts(&folder, &args.resume)?;
    let (report, time) = runs::run_job(cli, &job, names, Some(&parts), &args.spec)?;
    save(&folder, &report)?;
    if !args.keep_parts {
        parts.remove();
    }
    tell(cli, &folder, &report, time)
}

/// Writes the report and its figure into a folder.
pub fn save(folder: &Path, report: &CompareReport) -> Outcome {
    let figure = plot::Format::Png.encode(&figure(report), folder)?;
    let mut text = serde_json::to_vec(report).map_err(|e| Failure::input(folder.display(), "-o", e, "report a bug"))?;
    text.push(b'\n');
    // The report is written last and marks the folder as complete.
    progress::stoppable(|| output::write_set(&[(folder.join(FIGURE), figure), (folder.join(REPORT), text)]))
}

/// Refuses a list of numbers if one of them is out of range.
pub fn within(flag: &str, values: &[f64], (min, max): (f64, f64), unit: &str) -> Outcome {
    match values.iter().find(|v| !(min..=max).contains(*v)) {
        None => Ok(()),
        Some(value) => {
            let hint = format!("must be from {} to {}{unit}", number(min), number(max));
            Err(Failure::input("command line", flag, value, &hint))
        }
    }
}

/// The sizes of the run, within their ranges.
fn options(args: &CompareArgs, spec: &YarnSpec) -> Outcome<CompareOptions> {
    within("--lambda", &args.lambda, (0.1, 20.0), " um")?;
    let reach = 1.0 + spec.beam.beam().d_cut_um / spec.ply_radii_um()[0];
    within("--h", &args.h, (-reach, reach), ", where the beam still hits the ply")?;
    latitude("--theta-i", args.theta_i)?;
    within("--theta-i", &[args.theta_i], (-80.0, 80.0), " degrees")?;
    within("--sigma", &[args.sigma], (0.0, 100.0), ", in 1/um")?;
    within("--tolerance", &[args.tolerance], (1e-12, 0.01), "")?;
    Ok(CompareOptions {
        instances: args.instances,
        seed: args.seed,
        lambda_um: args.lambda.clone(),
        h_rel: args.h.clone(),
        theta_i: args.theta_i.to_radians(),
        sigma_per_um: args.sigma,
        tolerance: args.tolerance,
        paths: args.paths,
    })
}

/// Reports the result.
fn tell(cli: &Cli, folder: &Path, report: &CompareReport, time: std::time::Duration) -> Outcome {
    if cli.json {
        let cases: Vec<_> = report
            .cases
            .iter()
            .map(|c| {
                serde_json::json!({
                    "lambda_um": c.lambda_um, "h_rel": c.h_rel, "energies": c.energies, "resolutions": c.resolutions,
                })
            })
            .collect();
        return output::print_json(&serde_json::json!({
            "folder": folder.display().to_string(), "instances": report.instances, "seconds": time.as_secs_f64(),
            "cases": cases, "across_wavelengths": report.across_wavelengths,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        let (n, time) = (report.instances, report::duration(time));
        writeln!(out, "{}: {}, {time}", folder.display(), report::counted(n.into(), "instance", "instances"))?;
        writeln!(out, "  correlation of waves and rays (relative L2 distance), bins of 1 degree")?;
        writeln!(out, "  lambda    h/R   average          off forward      single           missed / extinguished")?;
        writeln!(
            out,
            "  (missed: share of the beam that rays carry past the ply; extinguished: light that waves take out of the"
        )?;
        writeln!(
            out,
            "  beam over its power: scattered and absorbed, up to 2, since the field that casts the shadow is scattered too)"
        )?;
        for case in &report.cases {
            let at = one_degree(case);
            let pair = |correlation: f64, l2: f64| format!("{correlation:.4} ({l2:.3})");
            writeln!(
                out,
                "  {:<8}  {:<4}  {:<15}  {:<15}  {:<15}  {:.3} / {:.3}",
                number(case.lambda_um),
                number(case.h_rel),
                pair(at.average.correlation, at.average.relative_l2),
                pair(at.average_off_forward.correlation, at.average_off_forward.relative_l2),
                pair(at.single_correlation.mean, at.single_relative_l2.mean),
                case.energies.ray_miss.mean,
                case.energies.wave_extinguished.mean
            )?;
        }
        for pair in &report.across_wavelengths {
            writeln!(
                out,
                "  waves of {} and {} um at h/R {}: averages {:.4}, single {:.4}",
                number(pair.lambda_um[0]),
                number(pair.lambda_um[1]),
                number(pair.h_rel),
                pair.average.correlation,
                pair.single_correlation.mean
            )?;
        }
        Ok(())
    })
}

/// The case in bins of one degree.
fn one_degree(case: &CompareCase) -> &plywave_wave::Resolved {
    case.resolutions.iter().find(|r| (r.bin_deg - 1.0).abs() < 1e-9).unwrap_or(&case.resolutions[0])
}

/// Color of the rays.
const RAY: Rgb = [60, 60, 66];

/// A color for a wavelength [um]: from violet to red over the visible range.
pub fn color_of(lambda_um: f64) -> Rgb {
    const STOPS: [(f64, Rgb); 5] = [
        (0.40, [104, 58, 183]),
        (0.48, [30, 110, 215]),
        (0.55, [30, 150, 80]),
        (0.62, [226, 130, 20]),
        (0.70, [205, 40, 45]),
    ];
    let next = STOPS.iter().position(|(at, _)| *at >= lambda_um).unwrap_or(STOPS.len() - 1).max(1);
    let ((from, a), (to, b)) = (STOPS[next - 1], STOPS[next]);
    let t = ((lambda_um - from) / (to - from)).clamp(0.0, 1.0);
    std::array::from_fn(|i| (f64::from(a[i]) + t * (f64::from(b[i]) - f64::from(a[i]))).round() as u8)
}

/// A density in equal bins of the azimuth as points over the angle from exact forward [degrees], in bins
/// `factor` times as wide.
fn points(values: &[f64], factor: usize) -> Vec<[f64; 2]> {
    let coarse: Vec<f64> = values.chunks(factor).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
    let n = coarse.len();
    let bin_deg = 360.0 / n as f64;
    // The first bin after 90 degrees, where the light comes from, is the leftmost.
    (0..n).map(|i| [-180.0 + (i as f64 + 0.5) * bin_deg, coarse[(i + n / 4) % n]]).collect()
}

/// A curve with a band of one standard deviation either side.
fn banded(mean: &[f64], sd: &[f64], color: Rgb) -> Curve {
    let (mean, sd) = (points(mean, 2), points(sd, 2));
    let band = mean.iter().zip(&sd).map(|(m, s)| [(m[1] - s[1]).max(0.0), m[1] + s[1]]).collect();
    Curve { points: mean, band, color, width: 1.8 }
}

/// Averages, one instance and the forward peak for each offset.
fn figure(report: &CompareReport) -> Figure {
    const DECADES: f64 = 5.0;
    const NEAR_DEG: f64 = 12.0;
    let mut offsets: Vec<f64> = Vec::new();
    let mut lambdas: Vec<f64> = Vec::new();
    for case in &report.cases {
        let add = |list: &mut Vec<f64>, v: f64| {
            if !list.contains(&v) {
                list.push(v);
            }
        };
        add(&mut offsets, case.h_rel);
        add(&mut lambdas, case.lambda_um);
    }
    let largest = |curves: &dyn Fn(&CompareCase) -> Vec<f64>| {
        let top = report.cases.iter().flat_map(curves).fold(0.0, f64::max);
        Scale::Log(LogScale::above(top, DECADES))
    };
    let averages = largest(&|c| {
        [points(&c.curves.wave_mean, 2), points(&c.curves.ray_mean, 2)].concat().iter().map(|p| p[1]).collect()
    });
    let singles = largest(&|c| {
        [points(&c.curves.wave_first, 2), points(&c.curves.ray_first, 2)].concat().iter().map(|p| p[1]).collect()
    });
    let round = lines::every(-180.0, 180.0, 60.0);
    let rows: Vec<Row> = offsets
        .iter()
        .map(|&h| {
            let cases: Vec<&CompareCase> = report.cases.iter().filter(|c| c.h_rel == h).collect();
            let panel = |title: &str, y: Scale, x: [f64; 2], x_ticks, curves| LinePanel {
                title: title.into(),
                x_title: "φ_o - 270° [degrees]".into(),
                x,
                x_ticks,
                y,
                curves,
            };
            let line = |values: &[f64], factor, color, width| Curve {
                points: points(values, factor),
                band: Vec::new(),
                color,
                width,
            };
            // Rays differ between wavelengths by the beam's spread alone: one curve stands for them but near
            // forward.
            let mut mean: Vec<Curve> =
                cases.iter().map(|c| banded(&c.curves.wave_mean, &c.curves.wave_sd, color_of(c.lambda_um))).collect();
            mean.extend(cases.first().map(|c| line(&c.curves.ray_mean, 2, RAY, 1.8)));
            let mut single: Vec<Curve> = Vec::new();
            single.extend(cases.first().map(|c| line(&c.curves.ray_first, 2, RAY, 1.4)));
            single.extend(cases.iter().map(|c| line(&c.curves.wave_first, 1, color_of(c.lambda_um), 1.2)));
            let faded = |color: Rgb| color.map(|v| (f64::from(v) * 0.55) as u8);
            let near: Vec<Curve> = cases
                .iter()
                .flat_map(|c| {
                    let color = color_of(c.lambda_um);
                    [line(&c.curves.wave_mean, 1, color, 1.8), line(&c.curves.ray_mean, 1, faded(color), 1.2)]
                })
                .collect();
            Row {
                title: format!("h/R = {}: density [1/rad]", number(h)),
                panels: vec![
                    (
                        560,
                        panel(
                            &format!("mean of {}, 1° bins", counted(report.instances as u64, "instance", "instances")),
                            averages,
                            [-180.0, 180.0],
                            round.clone(),
                            mean,
                        ),
                    ),
                    (560, panel("one instance, waves in 0.5° bins", singles, [-180.0, 180.0], round.clone(), single)),
                    (
                        300,
                        panel(
                            "mean near forward, 0.5° bins",
                            averages,
                            [-NEAR_DEG, NEAR_DEG],
                            lines::linear(-NEAR_DEG, NEAR_DEG, 6.0),
                            near,
                        ),
                    ),
                ],
                height: 300,
            }
        })
        .collect();
    let mut legend: Vec<(String, Rgb)> =
        lambdas.iter().map(|&l| (format!("waves, {} μm", number(l)), color_of(l))).collect();
    legend.push(("rays (near forward: each wavelength's, darker)".into(), RAY));
    let name = literal(&report.name, 80);
    let particulars = vec![
        format!(
            "θ_i = {}°, w_0 = {} μm, σ = {} /μm, seed {}, {} rays each; bands: one standard deviation from instance to instance",
            number(report.theta_i_deg),
            number(report.w0_um),
            number(report.sigma_per_um),
            report.seed,
            report::count(report.paths as f64)
        ),
        "total light that leaves, beam included, over the beam's power; light comes from -180°, exact forward is 0"
            .into(),
    ];
    lines::page(&Head { title: format!("{name}: waves against rays"), particulars, legend }, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forward_is_in_the_middle() {
        // Bins of 30 degrees; forward is 270 degrees, the edge between bins 8 and 9.
        let values: Vec<f64> = (0..12).map(f64::from).collect();
        let points = points(&values, 1);
        assert_eq!(points[0], [-165.0, 3.0]);
        assert_eq!((points[5], points[6]), ([-15.0, 8.0], [15.0, 9.0]));
        assert_eq!(points[11], [165.0, 2.0]);
    }

    #[test]
    fn wavelengths_have_their_colors() {
        assert_eq!(color_of(0.3), color_of(0.4));
        assert_eq!(color_of(0.7), color_of(9.0));
        assert!(color_of(0.694)[0] > color_of(0.694)[2] && color_of(0.45)[2] > color_of(0.45)[0]);
    }
}
