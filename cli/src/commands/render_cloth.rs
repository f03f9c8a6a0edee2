//! `plywave render` of a cloth of curves.

use super::cloth_file;
use super::render::slits;
use crate::args::{Cli, FabricPart, Integrator, RenderArgs};
use crate::failure::{Failure, Outcome};
use crate::progress::STOP;
use crate::rendering::{About, Outputs, camera, camera_flags, check_flags, film, mesh, setup, shoot};
use plywave::cloth::ClothModel;
use plywave::fabric::{FabricOptions, GapLight};
use plywave_pipeline::{ReadyCloth, digest_of_file};
use plywave_render::{RenderOptions, Setup, render};
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    check_flags(args)?;
    if args.integrator == Some(Integrator::Dual) {
        let hint = "dual scattering is between strands and a cloth has none; give a scene of strands, or leave it out";
        return Err(Failure::input("command line", "--integrator", "dual", hint));
    }
    let outputs = Outputs::from_args(args)?;
    let mut inputs: Vec<(&str, PathBuf)> = vec![("cloth", args.fabric.clone())];
    inputs.extend(args.mesh.iter().map(|m| ("mesh", m.clone())));
    inputs.extend(args.sky.iter().map(|s| ("sky", s.clone())));
    let read: Vec<&Path> = inputs.iter().map(|(_, path)| path.as_path()).collect();
    let _held = outputs.hold(&read)?;
    let ReadyCloth { data, digest, mut notes } = cloth_file::ready(cli, &args.fabric)?;
    let without = |part: FabricPart| args.without.contains(&part);
    let options = FabricOptions {
        gaps: if args.straight_gaps { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: args.sigma.map(|s| s as f32),
        noise: !args.smooth,
        layers: !without(FabricPart::Layers),
        shadowing: !without(FabricPart::Shadowing),
        edges: !without(FabricPart::Edges),
        slits: slits(args)?,
        far: !without(FabricPart::Far),
    };
    let named = setup(args);
    let setup = Setup::from(named);
    let size = args.size_mm.map_or(setup.size_mm(), |s| s as f32);
    let camera = camera(args, setup.camera(size))?;
    let mut of = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string()), ("cloth".to_string(), digest)];
    for (name, path) in &inputs[1..] {
        of.push(((*name).to_string(), digest_of_file(path)?));
    }
    for (name, value) in [
        ("--setup", format!("{:?}", named)),
        ("--size-mm", size.to_string()),
        ("--cloth-mm", args.cloth_mm.to_string()),
        ("--sky-layer", format!("{:?}", args.sky_layer)),
        ("--width", args.width.to_string()),
        ("--height", args.height.to_string()),
        ("--depth", args.depth.to_string()),
        ("--seed", args.seed.to_string()),
        ("options", format!("{options:?}")),
    ] {
        of.push((name.to_string(), value));
    }
    of.extend(camera_flags(args));
    let film = film(args, &outputs, &of)?;
    notes.extend(data.notes(&options));
    let mesh = mesh(args, size, &mut notes)?;
    let sky = crate::rendering::sky(args, &mut notes)?;
    notes.dedup();
    let name = data.name.clone();
    let cloth = ClothModel::from_data(data, &options)?;
    let (scene, _) = setup.scene(size, mesh, sky);
    let render_options = RenderOptions { samples: args.samples, depth: args.depth, seed: args.seed };
    let about = About { name, scene: format!("{named:?}").to_lowercase(), notes };
    shoot(cli, args, &outputs, &of, film, about, |film, after| {
        render(&scene, &camera, &cloth, film, &render_options, &STOP, after)
    })
}
