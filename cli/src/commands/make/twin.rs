//! `plywave twin`: path traces the explicit fibers of a cloth spec and writes the light that leaves them.

use crate::args::{Cli, TwinArgs};
use crate::commands::make::cloth_file;
use crate::commands::runs::{self, ProgressNames};
use crate::failure::Outcome;
use crate::{output, progress, report};
use plywave::Document;
use plywave_sim::twin::{Domain, TwinCurves, TwinJob, TwinMesh, TwinOptions, direction};
use plywave_tables::twin::{CLASSES, ClothTwin};
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

/// Runs the command.
pub fn run(cli: &Cli, args: &TwinArgs) -> Outcome {
    let refuse = |e| runs::failure(e, &args.spec);
    let recipe = cloth_file::recipe(&args.spec)?;
    let texts = recipe.plies(&cli.library()?).map_err(runs::pipeline_failure)?.spec_texts();
    let made = cloth_file::curves(cli, &recipe)?;
    let cloth = TwinCurves::new(&recipe.spec.name, made.curves, texts).map_err(refuse)?.with_hairs(recipe.spec.hairs());
    let job = TwinJob::new(cloth, &options(args)).map_err(refuse)?;
    let path = args.output.clone().unwrap_or_else(|| args.shards.default_output(&args.spec, "pwx"));
    output::check_writable(&path, &[&args.spec])?;
    let names = ProgressNames { what: "trace", unit: "paths" };
    if runs::run_share(cli, &job, names, &args.shards, (&path, &args.resume), &args.spec)? {
        return Ok(());
    }
    let resumed = args.resume.resume && runs::parts_of(&path).exists();
    let parts = runs::open_parts(&path, &args.resume)?;
    let (twin, time) = runs::run_job(cli, &job, names, Some(&parts), &args.spec)?;
    progress::stoppable(|| twin.save(&path))?;
    parts.remove();
    tell(cli, &path, &job, &twin, time, resumed)
}

fn options(args: &TwinArgs) -> TwinOptions {
    let standard = TwinOptions::default();
    let mut mesh = TwinMesh::default();
    if let Some(points) = args.points {
        mesh.turn_rad *= f64::from(mesh.outline_points) / f64::from(points);
        mesh.outline_points = points;
    }
    let views = args.views.iter().map(|[tilt, azimuth]| direction(tilt.to_radians(), azimuth.to_radians()));
    TwinOptions {
        views: if args.views.is_empty() { standard.views } else { views.collect() },
        sigma_per_um: args.sigma.clone(),
        paths: args.paths,
        seed: args.seed,
        repeats: args.repeats,
        mesh,
        ..standard
    }
}

/// Says what came out.
fn tell(cli: &Cli, path: &Path, job: &TwinJob, twin: &ClothTwin, time: Duration, resumed: bool) -> Outcome {
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    let size = job.size().map_err(|e| runs::failure(e, path))?;
    let paths: u64 = twin.paths.iter().sum();
    if cli.json {
        let mut object = json(path, bytes, twin);
        crate::commands::make::simulate::merge(
            &mut object,
            &serde_json::json!({
                "seconds": time.as_secs_f64(), "resumed": resumed, "fibers": size.fibers, "triangles": size.triangles,
                "memory_bytes": size.memory_bytes,
                "pitches": job.domain().pitches.iter().map(|p| serde_json::json!({
                    "set": p.family,
                    "spec_um": p.spec_um, "used_um": p.used_um,
                })).collect::<Vec<_>>(),
            }),
        );
        return output::print_json(&object);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        let rate = match resumed {
            true => "resumed from an earlier run".into(),
            false => format!("{} paths/s", report::count(paths as f64 / time.as_secs_f64().max(1e-9))),
        };
        writeln!(out, "  work         {}: {} paths, {rate}", report::duration(time), report::count(paths as f64))?;
        write_domain(out, job.domain())?;
        writeln!(
            out,
            "  geometry     {} fibers, {} triangles, {}",
            size.fibers,
            report::count(size.triangles as f64),
            report::bytes(size.memory_bytes as u64)
        )?;
        write_views(out, twin)
    })
}

fn write_domain(out: &mut dyn Write, domain: &Domain) -> io::Result<()> {
    let ([x, y], [w, h], [warp, weft]) = (domain.repeats, domain.size_um, domain.yarns);
    writeln!(out, "  domain       {x} x {y} repeats, {w:.0} x {h:.0} um, {warp} warp and {weft} weft yarns")?;
    for pitch in &domain.pitches {
        let (set, spec, used) = (pitch.family.name(), pitch.spec_um, pitch.used_um);
        writeln!(out, "  pitch        {set}, fibers: {used:.1} um in place of {spec:.1}, to close over the domain")?;
    }
    Ok(())
}

/// Tilt from the face's normal and azimuth of a view [degrees].
pub fn angles([x, y, z]: [f64; 3]) -> [f64; 2] {
    let across = x.hypot(y);
    [across.atan2(z).to_degrees(), if across < 1e-12 { 0.0 } else { y.atan2(x).to_degrees() }]
}

/// A pair of absorptions, or a single value if both kinds have the same.
pub fn sigma_text([warp, weft]: [f64; 2]) -> String {
    if warp == weft { format!("{warp}") } else { format!("{warp}:{weft}") }
}

/// The lines of a twin's views.
pub fn write_views(out: &mut dyn Write, twin: &ClothTwin) -> io::Result<()> {
    writeln!(
        out,
        "  {:>5} {:>7} {:>11}  {:>9} {:>8}  {:>11} {:>8}  {:>8}  light of 1, 2, 3+ yarns",
        "tilt", "azimuth", "sigma", "reflected", "+-", "transmitted", "+-", "straight"
    )?;
    let sigmas = twin.sigma_count();
    for view in 0..twin.view_count() {
        let [tilt, azimuth] = angles(twin.view(view));
        for sigma in 0..sigmas {
            let (light, [r_se, t_se]) = (twin.light(view, sigma), twin.standard_errors(view, sigma));
            let classes = &twin.by_yarns[(view * sigmas + sigma) * 2 * CLASSES..][..2 * CLASSES];
            let by: Vec<String> = (0..CLASSES).map(|c| format!("{:.3}", classes[c] + classes[CLASSES + c])).collect();
            writeln!(
                out,
                "  {tilt:>5.1} {azimuth:>7.1} {:>11}  {:>9.4} {r_se:>8.5}  {:>11.4} {t_se:>8.5}  {:>8.4}  {}",
                sigma_text(twin.sigma(sigma)),
                light.reflected,
                light.transmitted,
                light.straight,
                by.join(" ")
            )?;
        }
    }
    let killed = twin.killed.iter().copied().fold(0.0, f64::max);
    writeln!(out, "  stopped      {killed:.1e} of the light at most")
}

/// Contents of a twin without its distributions.
pub fn json(path: &Path, bytes: u64, twin: &ClothTwin) -> serde_json::Value {
    let sigmas = twin.sigma_count();
    let views: Vec<serde_json::Value> = (0..twin.view_count())
        .map(|view| {
            let lights = (0..sigmas).map(|sigma| {
                let (light, se) = (twin.light(view, sigma), twin.standard_errors(view, sigma));
                let at = (view * sigmas + sigma) * 2 * CLASSES;
                serde_json::json!({
                    "sigma_per_um": twin.sigma(sigma),
                    "reflected": light.reflected, "reflected_se": se[0],
                    "transmitted": light.transmitted, "transmitted_se": se[1],
                    "reflected_by_yarns": &twin.by_yarns[at..at + CLASSES],
                    "transmitted_by_yarns": &twin.by_yarns[at + CLASSES..at + 2 * CLASSES],
                    "reflected_by_plies": &twin.by_plies[at..at + CLASSES],
                    "transmitted_by_plies": &twin.by_plies[at + CLASSES..at + 2 * CLASSES],
                })
            });
            let [tilt, azimuth] = angles(twin.view(view));
            serde_json::json!({
                "tilt_deg": tilt, "azimuth_deg": azimuth, "direction": twin.view(view), "paths": twin.paths[view],
                "straight": twin.straight[view], "killed": twin.killed[view], "interactions": twin.interactions[view],
                "light": lights.collect::<Vec<_>>(),
            })
        })
        .collect();
    serde_json::json!({
        "twin": path.display().to_string(), "bytes": bytes, "name": twin.name, "seed": twin.seed,
        "repeat_um": twin.repeat_um, "repeats": twin.repeats, "views": views,
    })
}

/// `plywave info` of a twin.
pub fn info(cli: &Cli, path: &Path, bytes: u64, twin: &ClothTwin) -> Outcome {
    if cli.json {
        return output::print_json(&json(path, bytes, twin));
    }
    output::print(|out| {
        writeln!(out, "{}: twin of a cloth, {}", path.display(), report::bytes(bytes))?;
        let ([x, y], [w, h]) = (twin.repeats, twin.repeat_um);
        writeln!(out, "  cloth        {}, {x} x {y} repeats of {w:.1} x {h:.1} um, seed {}", twin.name, twin.seed)?;
        write_views(out, twin)
    })
}
