//! `plywave color`: finds the absorption that gives a model or a cloth a color or a reflectance, and reports
//! the color that results.

use crate::args::{Cli, ColorArgs};
use crate::commands::latitude;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use crate::report::number;
use plywave::cloth::{ClothModel, ClothOptions, ColorOf};
use plywave::color::{
    AlbedoCurve, SPECTRUM_NODES, SPECTRUM_UM, SigmaSpectrum, SmoothReflectance, delta_e_2000, linear_srgb_of_xyz,
    spectrum_lambda_um, srgb_encode, xyz_of_reflectance,
};
use plywave_pipeline::PrecomputedCloth;

/// CIEDE2000 above which two colors count as visibly different.
const SEEN: f64 = 1.0;

#[derive(serde::Serialize)]
struct Report {
    model: String,
    incidence: String,
    /// Albedo of the darkest fibers and of non-absorbing fibers.
    albedo_range: [f64; 2],
    lambda_um: Vec<f64>,
    reflectance: Vec<f64>,
    sigma_per_um: Vec<f64>,
    albedo: Vec<f64>,
    srgb_asked: [f64; 3],
    srgb: [f64; 3],
    delta_e_spectrum: f64,
    delta_e: f64,
    clamped_to_clear: usize,
    clamped_to_dark: usize,
}

/// Runs the command.
pub fn run(cli: &Cli, args: &ColorArgs) -> Outcome {
    let (curve, incidence) = curve(cli, args)?;
    if let Some(bad) = args.reflectance.iter().find(|v| !(0.0..=1.0).contains(*v)) {
        return Err(Failure::input("command line", "--reflectance", bad, "must be from 0 to 1"));
    }
    let smooth = args.srgb.map(SmoothReflectance::of_srgb);
    let reflectance = |lambda: f64| match &smooth {
        Some(smooth) => smooth.at(lambda),
        None => steps(&args.reflectance, lambda),
    };
    let (sigma, [clear, dark]) = SigmaSpectrum::of_reflectance(&curve, reflectance);
    let albedo = |lambda: f64| curve.albedo(f64::from(sigma.at(lambda as f32)));
    let (target, got) = (xyz_of_reflectance(reflectance), xyz_of_reflectance(albedo));
    let encoded = |xyz| linear_srgb_of_xyz(xyz).map(srgb_encode);
    let lambda_um: Vec<f64> = (0..SPECTRUM_NODES).map(spectrum_lambda_um).collect();
    let report = Report {
        model: args.model.display().to_string(),
        incidence,
        albedo_range: curve.range(),
        reflectance: lambda_um.iter().map(|l| reflectance(*l)).collect(),
        sigma_per_um: sigma.nodes_per_um().iter().map(|s| f64::from(*s)).collect(),
        albedo: lambda_um.iter().map(|l| albedo(*l)).collect(),
        lambda_um,
        srgb_asked: encoded(target),
        srgb: encoded(got),
        delta_e_spectrum: smooth.map_or(0.0, |s| s.delta_e),
        delta_e: delta_e_2000(target, got),
        clamped_to_clear: clear,
        clamped_to_dark: dark,
    };
    if cli.json {
        return output::print_json(&report);
    }
    let r = &report;
    output::print(|out| {
        let color = |c: &[f64; 3]| c.map(|v| format!("{v:.4}")).join(", ");
        writeln!(
            out,
            "{}: albedo from {:.4} to {:.4}, incidence {}",
            r.model, r.albedo_range[0], r.albedo_range[1], r.incidence
        )?;
        writeln!(out, "  sRGB target       {}", color(&r.srgb_asked))?;
        writeln!(out, "  sRGB of the model {} (Delta E {:.3})", color(&r.srgb), r.delta_e)?;
        for note in out_of_reach([clear, dark], r.albedo_range, r.delta_e) {
            writeln!(out, "  {note}")?;
        }
        writeln!(out, "  {:>11}  {:>11}  {:>14}  {:>8}", "lambda [um]", "reflectance", "sigma [1/um]", "albedo")?;
        for i in (0..SPECTRUM_NODES).step_by(4) {
            let (l, s) = (number(r.lambda_um[i]), number(r.sigma_per_um[i]));
            writeln!(out, "  {l:>11}  {:>11.4}  {s:>14}  {:>8.4}", r.reflectance[i], r.albedo[i])?;
        }
        Ok(())
    })
}

/// Albedo as a function of absorption for the light that the flags select, and the name of that light.
fn curve(cli: &Cli, args: &ColorArgs) -> Outcome<(AlbedoCurve, String)> {
    if matches!(kinds::kind_of(&args.model), Some(InputKind::Cloth | InputKind::ClothFile)) {
        if let Some(theta) = args.theta_i {
            return Err(Failure::input(
                "command line",
                "--theta-i",
                theta,
                "is for models; give --color-of for a cloth",
            ));
        }
        let PrecomputedCloth { data, notes, .. } = crate::commands::make::cloth_file::precomputed(cli, &args.model)?;
        if !cli.quiet {
            notes.iter().for_each(|note| eprintln!("note: {note}"));
        }
        let cloth = ClothModel::from_data(data, &ClothOptions::RAYS)?;
        let of = args.color_of.map_or(cloth.color_of(), ColorOf::from);
        return Ok((cloth.color_curve_of(of), of.name().into()));
    }
    let model = cli.library()?.load(&args.model)?;
    if let Some(of) = args.color_of {
        let hint = "is for cloths; leave it out";
        return Err(Failure::input("command line", "--color-of", ColorOf::from(of).name(), hint));
    }
    match args.theta_i {
        Some(theta) => {
            latitude("--theta-i", theta)?;
            Ok((AlbedoCurve::at(&model, theta.to_radians()), format!("{} degrees", number(theta))))
        }
        None => Ok((AlbedoCurve::diffuse(&model), "diffuse".into())),
    }
}

/// Notes on a color that a model does not reach: the number of wavelengths concerned, the reason, and the
/// resulting color difference.
pub fn out_of_reach([clear, dark]: [usize; 2], [low, high]: [f64; 2], delta_e: f64) -> Vec<String> {
    let line = |count: usize, why: String| {
        format!(
            "out of reach: {count} of {SPECTRUM_NODES} wavelengths are {why}; the color comes out at Delta E {delta_e:.3}"
        )
    };
    let mut notes = Vec::new();
    if clear > 0 {
        notes.push(line(clear, format!("brighter than clear fibers (albedo {high:.4}), sigma is 0 there")));
    }
    if dark > 0 {
        notes.push(line(dark, format!("darker than the darkest fibers (albedo {low:.4})")));
    }
    notes
}

/// Notes for each color of a cloth that differs visibly from its target.
pub fn cloth_notes(cloth: &ClothModel) -> Vec<String> {
    let mut notes = Vec::new();
    for color in cloth.colors().iter().filter(|color| color.delta_e > SEEN) {
        let [r, g, b] = color.asked.map(|v| number(f64::from(v)));
        let of = format!("srgb [{r}, {g}, {b}] as color_of = \"{}\"", cloth.color_of().name());
        let lines = out_of_reach(color.clamped, cloth.color_curve().range(), color.delta_e);
        notes.extend(lines.into_iter().map(|line| format!("{of}: {line}")));
    }
    notes
}

/// Value at a wavelength of samples in equal steps over the spectrum, linear in between.
fn steps(values: &[f64], lambda_um: f64) -> f64 {
    let last = values.len() - 1;
    let x = ((lambda_um - SPECTRUM_UM[0]) / (SPECTRUM_UM[1] - SPECTRUM_UM[0]) * last as f64).clamp(0.0, last as f64);
    let i = (x as usize).min(last.saturating_sub(1));
    values[i] + (x - i as f64) * (values[(i + 1).min(last)] - values[i])
}
