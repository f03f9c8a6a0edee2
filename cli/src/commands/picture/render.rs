//! `plywave render`: renders a cloth in a predefined scene, or strands in a scene of their own, with the
//! reference host.

use crate::args::{Cli, ClothPart, Integrator, RenderArgs};
use crate::commands::look::color;
use crate::commands::make::cloth_file;
use crate::commands::make::fibers::Fibers;
use crate::failure::{Failure, Outcome};
use crate::kinds;
use crate::progress::STOP;
use crate::rendering::{About, InputDigests, Outputs, camera, camera_flags, check_flags, film, mesh, setup, shoot};
use plywave::cloth::{ClothModel, ClothOptions, GapLight, Slits};
use plywave::gap::{SLIT_MAX_UM, SLIT_SHARE};
use plywave_pipeline::PrecomputedCloth;
use plywave_render::{RenderOptions, Setup, render, render_matter};
use std::path::{Path, PathBuf};

/// Slits that the flags select; without flags, those of the spec.
fn slits(args: &RenderArgs) -> Outcome<Option<Slits>> {
    match (args.slit_um, args.without.contains(&ClothPart::Slits)) {
        (Some(width), true) => {
            let hint = "given with --without slits; leave one of them out";
            Err(Failure::input("command line", "--slit-um", width, hint))
        }
        (Some(width), false) if !(width > 0.0 && width <= f64::from(SLIT_MAX_UM)) => {
            let hint = format!("must be above 0 and at most {SLIT_MAX_UM}");
            Err(Failure::input("command line", "--slit-um", width, &hint))
        }
        (Some(width), false) => {
            let share = args.slit_share.map_or(SLIT_SHARE, |share| share as f32);
            Ok(Some(Slits { width_um: width as f32, share }))
        }
        (None, leave_out) => Ok(leave_out.then_some(Slits::NONE)),
    }
}

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    check_flags(args)?;
    if kinds::kind_of(&args.cloth) == Some(kinds::InputKind::StrandScene) {
        return crate::commands::picture::render_strands::run(cli, args);
    }
    if args.integrator == Some(Integrator::Dual) {
        let hint = "dual scattering is between strands and a cloth has none; give a scene of strands, or leave it out";
        return Err(Failure::input("command line", "--integrator", "dual", hint));
    }
    let outputs = Outputs::from_args(args)?;
    let mut inputs: Vec<(String, PathBuf)> = vec![("cloth".into(), args.cloth.clone())];
    let is_spec = kinds::kind_of(&args.cloth) == Some(kinds::InputKind::Cloth);
    let named = if is_spec { cloth_file::recipe(&args.cloth)?.inputs() } else { Vec::new() };
    inputs.extend(args.mesh.iter().map(|m| ("mesh".into(), m.clone())));
    inputs.extend(args.sky.iter().map(|s| ("sky".into(), s.clone())));
    let named = named.iter().map(|(_, path)| path.as_path());
    let read: Vec<&Path> = inputs.iter().map(|(_, path)| path.as_path()).chain(named).collect();
    let _held = outputs.hold(&read)?;
    outputs.check_sums(args)?;
    let without = |part: ClothPart| args.without.contains(&part);
    let options = ClothOptions {
        gaps: if args.straight_gaps { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: args.sigma.map(|s| s as f32),
        noise: !args.smooth,
        layers: !without(ClothPart::Layers),
        shadowing: !without(ClothPart::Shadowing),
        edges: !without(ClothPart::Edges),
        slits: slits(args)?,
        relief: !without(ClothPart::Relief),
        uneven: !without(ClothPart::Uneven),
        far: !without(ClothPart::Far),
    };
    let named = setup(args);
    let setup = Setup::from(named);
    let size = args.size_mm.map_or(setup.size_mm(), |s| s as f32);
    let camera = camera(args, setup.camera(size))?;
    // Quick checks come before work that takes seconds.
    let mut input_notes = Vec::new();
    let digests = InputDigests::take(&inputs[1..]);
    let mesh = mesh(args, size, &mut input_notes)?;
    let sky = crate::rendering::sky(args, &mut input_notes)?;
    let PrecomputedCloth { data, digest, mut notes } = cloth_file::precomputed(cli, &args.cloth)?;
    let mut of = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string()), ("cloth".to_string(), digest)];
    of.extend(digests.check()?);
    for (name, value) in [
        ("--setup", format!("{:?}", named)),
        ("--size-mm", size.to_string()),
        ("--cloth-mm", args.cloth_mm.to_string()),
        ("--sky-layer", format!("{:?}", args.sky_layer)),
        ("--width", args.width.to_string()),
        ("--height", args.height.to_string()),
        ("--depth", args.depth.to_string()),
        ("--seed", args.seed.to_string()),
        ("--sigma", format!("{:?}", args.sigma)),
        ("--fibers", args.fibers.to_string()),
        ("--lamp-scale", format!("{:?}", args.lamp_scale)),
        ("options", format!("{options:?}")),
    ] {
        of.push((name.to_string(), value));
    }
    of.extend(camera_flags(args));
    let film = film(args, &outputs, &of)?;
    if !args.fibers {
        notes.extend(data.notes(&options));
    }
    notes.extend(input_notes);
    let name = data.name.clone();
    let tracer = if args.fibers {
        Some(crate::commands::make::fibers::tracer(cli, &data, &args.cloth, args.seed)?)
    } else {
        None
    };
    let cloth = ClothModel::from_data(data, &options)?;
    if args.sigma.is_none() {
        notes.extend(color::cloth_notes(&cloth));
    }
    let (mut scene, _) = setup.scene(size, mesh, sky);
    scene.widen_lamps(args.lamp_scale.map_or(1.0, |times| times as f32));
    let render_options = RenderOptions { samples: args.samples, depth: args.depth, seed: args.seed };
    let about = About { name, scene: format!("{named:?}").to_lowercase(), notes, is_metered: setup != Setup::Furnace };
    shoot(cli, args, &outputs, &of, film, about, |film, after| match tracer {
        Some(tracer) => {
            let fibers = Fibers { tracer, cloth };
            render_matter(&scene, &camera, &fibers, film, &render_options, &STOP, after)
        }
        None => render(&scene, &camera, &cloth, film, &render_options, &STOP, after),
    })
}
