//! `plywave render` of a scene of strands.

use crate::args::{Cli, Integrator, RenderArgs};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::STOP;
use crate::rendering::{About, InputDigests, Outputs, camera, camera_flags, check_flags, failed, film, shoot};
use crate::strand_scene::{Loaded, StrandSpec};
use crate::threads::on_threads;
use plywave_render::{RenderOptions, StrandDual, StrandDualOptions, render_strands, render_strands_dual};
use std::path::{Path, PathBuf};

/// Refuses flags that apply to cloths only.
fn check_foreign(args: &RenderArgs) -> Outcome {
    for (name, is_set) in [
        ("--setup", args.setup.is_some()),
        ("--size-mm", args.size_mm.is_some()),
        ("--mesh", args.mesh.is_some()),
        ("--sigma", args.sigma.is_some()),
        ("--fibers", args.fibers),
        ("--lamp-scale", args.lamp_scale.is_some()),
        ("--straight-gaps", args.straight_gaps),
        ("--smooth", args.smooth),
        ("--slit-um", args.slit_um.is_some()),
        ("--without", !args.without.is_empty()),
    ] {
        if is_set {
            let hint = "is for cloths; a scene of strands has its own lamps, camera and fiber";
            return Err(Failure::input("command line", name, "given", hint));
        }
    }
    Ok(())
}

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    check_flags(args)?;
    check_foreign(args)?;
    let outputs = Outputs::from_args(args)?;
    let mut inputs: Vec<(String, PathBuf)> = vec![("scene of strands".into(), args.cloth.clone())];
    let scene_digest = InputDigests::take(&inputs);
    let spec = StrandSpec::load(&args.cloth)?;
    inputs.extend(spec.inputs().into_iter().map(|(name, path)| (name.to_string(), path)));
    inputs.extend(args.sky.iter().map(|s| ("sky".to_string(), s.clone())));
    let read: Vec<&Path> = inputs.iter().map(|(_, path)| path.as_path()).collect();
    let _held = outputs.hold(&read)?;
    outputs.check_sums(args)?;
    let mut notes = Vec::new();
    let digests = InputDigests::take(&inputs[1..]);
    let sky = crate::rendering::sky(args, &mut notes)?;
    let Loaded { scene, camera: own, notes: scene_notes, included } = spec.load_scene(sky)?;
    let camera = camera(args, own)?;
    notes.extend(scene_notes);
    // The included files are known only after the scene is read; none of them may be an output.
    let included_paths: Vec<&Path> = included.iter().map(PathBuf::as_path).collect();
    outputs.each().try_for_each(|path| output::check_writable(path, &included_paths))?;
    let folder = args.cloth.parent().unwrap_or(Path::new(""));
    let included = included.into_iter().map(|path| {
        let name = path.strip_prefix(folder).unwrap_or(&path).display().to_string();
        (format!("included file {name}"), path)
    });
    let mut of = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string())];
    of.extend(scene_digest.check()?);
    of.extend(digests.check()?);
    of.extend(InputDigests::take(&included.collect::<Vec<_>>()).check()?);
    for (name, value) in [
        ("--width", args.width.into()),
        ("--height", args.height.into()),
        ("--depth", args.depth.into()),
        ("--seed", args.seed),
    ] {
        of.push((name.to_string(), value.to_string()));
    }
    let integrator = args.integrator.unwrap_or(Integrator::Path);
    of.push(("--integrator".into(), format!("{integrator:?}")));
    of.extend(camera_flags(args));
    of.push(("--sky-layer".into(), format!("{:?}", args.sky_layer)));
    let film = film(args, &outputs, &of)?;
    let options = RenderOptions { samples: args.samples, depth: args.depth, seed: args.seed };
    let about = About { name: spec.name().to_string(), scene: "strands".into(), notes, is_metered: false };
    match integrator {
        Integrator::Path => shoot(cli, args, &outputs, &of, film, about, |film, after| {
            render_strands(&scene, &camera, film, &options, &STOP, after)
        }),
        Integrator::Dual => {
            let dual = on_threads(cli, || StrandDual::new(&scene, &StrandDualOptions::default()))?.map_err(failed)?;
            shoot(cli, args, &outputs, &of, film, about, |film, after| {
                render_strands_dual(&dual, &camera, film, &options, &STOP, after)
            })
        }
    }
}
