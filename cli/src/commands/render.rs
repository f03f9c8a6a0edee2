//! `plywave render`: a fabric in a ready-made scene, by the reference host.

use super::on_threads;
use crate::args::{Cli, RenderArgs, Scene};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, Bar, STOP};
use crate::report;
use plywave::fabric::{FabricBsdf, FabricOptions, FabricSpec, GapLight};
use plywave_render::{Environment, Film, FilmView, Mesh, RenderError, RenderOptions, Setup, render};
use std::time::Duration;

/// Most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 28;

impl From<Scene> for Setup {
    fn from(scene: Scene) -> Setup {
        match scene {
            Scene::Front => Setup::Front,
            Scene::Back => Setup::Back,
            Scene::Drape => Setup::Drape,
            Scene::Folds => Setup::Folds,
            Scene::Swatch => Setup::Swatch,
            Scene::Furnace => Setup::Furnace,
        }
    }
}

/// What a render that ended early says.
pub fn failed(error: RenderError) -> Failure {
    match error {
        RenderError::Stopped { .. } => {
            Failure::Interrupted(format!("stopped; go on with: {}", progress::resume_command()))
        }
        other => Failure::Input(other.to_string()),
    }
}

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.fabric, "png"));
    output::check_writable(&path, &[&args.fabric])?;
    let flag =
        |name: &str, value: &dyn std::fmt::Display, mend: &str| Err(Failure::input("command line", name, value, mend));
    if u64::from(args.width) * u64::from(args.height) > MOST_PIXELS {
        return flag("--width", &args.width, "a picture of at most 268 M pixels");
    }
    for (name, value, low, high) in [
        ("--size-mm", args.size_mm, 1e-3, 1e5),
        ("--cloth-mm", Some(args.cloth_mm), 1e-3, 1e6),
        ("--sigma", args.sigma, 0.0, 1e6),
        ("--exposure", Some(args.exposure), -40.0, 40.0),
    ] {
        if let Some(v) = value.filter(|v| !(low..=high).contains(v)) {
            return flag(name, &v, &format!("must be from {low} to {high}"));
        }
    }
    let options = FabricOptions {
        gaps: if args.straight_gaps { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: args.sigma.map(|s| s as f32),
        noise: !args.smooth,
    };
    let loaded = FabricSpec::load(&args.fabric)?;
    let notes = loaded.notes();
    let fabric = FabricBsdf::new(loaded, &options)?;
    let setup = Setup::from(args.setup);
    let size = args.size_mm.map_or(setup.size_mm(), |s| s as f32);
    let mesh = match &args.mesh {
        Some(file) => Some(Mesh::obj(file, 1000.0 * args.cloth_mm as f32, size).map_err(failed)?),
        None => None,
    };
    let sky = match &args.sky {
        Some(file) => Some(Environment::load(file, 1.0).map_err(failed)?),
        None => None,
    };
    let (scene, camera) = setup.scene(size, mesh, sky);
    // What a render must have in common with its sums to go on from them.
    let key = format!(
        "{args:?}",
        args = (
            &args.fabric,
            args.setup,
            size,
            args.width,
            args.height,
            args.seed,
            args.depth,
            &options,
            &args.mesh,
            &args.sky
        )
    );
    let sums = path.with_extension("sums");
    let mut film = match sums.exists() && args.resume {
        true => Film::resume(&sums, &key).map_err(failed)?,
        false => Film::new(args.width, args.height),
    };
    let render_options = RenderOptions { samples: args.samples, depth: args.depth, seed: args.seed };
    progress::install_stop();
    let bar = Bar::new("render", "samples", cli.quiet);
    let begun = std::time::Instant::now();
    let first = film.samples();
    let mut saved = begun;
    let work = on_threads(cli, || {
        progress::stoppable(|| {
            render(&scene, &camera, &fabric, &mut film, &render_options, &STOP, &mut |film| {
                bar.update("render", film.samples().into(), args.samples.into());
                if saved.elapsed() > Duration::from_secs(10) && film.samples() < args.samples {
                    film.save(&sums, &key)?;
                    saved = std::time::Instant::now();
                }
                Ok(())
            })
        })
    })?;
    if let Err(error) = work {
        film.save(&sums, &key).map_err(failed)?;
        return Err(failed(error));
    }
    let time = bar.finish();
    let exr = path.with_extension("exr");
    film.write_exr(&exr).map_err(failed)?;
    let png = crate::plot::png(&film.image(FilmView::Light, args.exposure as f32), &path)?;
    output::write_whole(&path, &png)?;
    match args.keep_sums {
        true => film.save(&sums, &key).map_err(failed)?,
        // Sums that were never written, or are gone already, need no removal.
        false => drop(std::fs::remove_file(&sums)),
    }
    let paths = u64::from(film.samples() - first) * u64::from(args.width) * u64::from(args.height);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "png": path.display().to_string(), "exr": exr.display().to_string(), "width": args.width, "height": args.height,
            "samples": film.samples(), "seconds": time.as_secs_f64(), "paths": paths, "notes": notes,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {} x {}, {} samples a pixel", path.display(), args.width, args.height, film.samples())?;
        let rate = paths as f64 / time.as_secs_f64().max(1e-9);
        writeln!(out, "  time         {}, {} paths/s", report::duration(time), report::count(rate))?;
        writeln!(out, "  linear       {}", exr.display())?;
        notes.iter().try_for_each(|note| writeln!(out, "  note         {note}"))
    })
}
