//! `plywave render`: a fabric in a ready-made scene, or strands in their own, by the reference host.

use super::color;
use crate::args::{Cli, FabricPart, Integrator, RenderArgs};
use crate::failure::{Failure, Outcome};
use crate::kinds;
use crate::progress::STOP;
use crate::rendering::{About, Outputs, camera, camera_flags, check_flags, film, mesh, setup, shoot};
use plywave::fabric::{
    Fabric, FabricModel, FabricOptions, FabricSpec, GapLight, LoadedFabric, Slits, WeaveSpec, YarnSet,
};
use plywave::gap::{SLIT_MAX_UM, SLIT_SHARE};
use plywave_pipeline::{digest_of_bytes, digest_of_file};
use plywave_render::{Camera, RenderOptions, Setup, render};
use std::path::{Path, PathBuf};

/// What a render reads: names for people, and paths.
fn inputs(args: &RenderArgs, spec: &FabricSpec, models: &[PathBuf]) -> Vec<(&'static str, PathBuf)> {
    let mut list = vec![("fabric spec", args.fabric.clone())];
    list.extend(models.iter().filter(|model| !kinds::is_named(model)).map(|model| ("model", model.clone())));
    if let WeaveSpec::Wif { file } = &spec.weave {
        list.push(("WIF", args.fabric.parent().unwrap_or(Path::new("")).join(file)));
    }
    list.extend(args.mesh.iter().map(|m| ("mesh", m.clone())));
    list.extend(args.sky.iter().map(|s| ("sky", s.clone())));
    list
}

/// Contents of the inputs and the flags that matter for the picture: what sums must have in common with a
/// render to go on.
fn ingredients(
    args: &RenderArgs,
    size: f32,
    inputs: &[(&'static str, PathBuf)],
    loaded: &LoadedFabric,
) -> Outcome<Vec<(String, String)>> {
    let mut list = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string())];
    for (name, path) in inputs {
        list.push(((*name).to_string(), digest_of_file(path)?));
    }
    // Models that are compiled in have no file.
    for (model, _) in loaded.models.iter().zip(&loaded.model_paths).filter(|(_, path)| kinds::is_named(path)) {
        list.push(("model".to_string(), digest_of_bytes(&model.data().to_bytes()?)));
    }
    let flags: [(&str, String); 14] = [
        ("--setup", format!("{:?}", setup(args))),
        ("--size-mm", size.to_string()),
        ("--cloth-mm", args.cloth_mm.to_string()),
        ("--sky-layer", format!("{:?}", args.sky_layer)),
        ("--width", args.width.to_string()),
        ("--height", args.height.to_string()),
        ("--depth", args.depth.to_string()),
        ("--seed", args.seed.to_string()),
        ("--sigma", format!("{:?}", args.sigma)),
        ("--straight-gaps", args.straight_gaps.to_string()),
        ("--smooth", args.smooth.to_string()),
        ("--slit-um", format!("{:?}", args.slit_um)),
        ("--slit-share", format!("{:?}", args.slit_share)),
        (
            "--without",
            [FabricPart::Layers, FabricPart::Shadowing, FabricPart::Edges, FabricPart::Slits, FabricPart::Far]
                .map(|p| args.without.contains(&p))
                .map(u8::from)
                .map(|b| b.to_string())
                .concat(),
        ),
    ];
    list.extend(flags.map(|(name, value)| (name.to_string(), value)));
    list.extend(camera_flags(args));
    Ok(list)
}

/// Lines of a picture that is worth the seconds in which the mean over the repeat is made.
const FAR_LINES: u32 = 256;

/// Whether a pixel covers half of a fabric's repeat or more, so that its mean takes part.
fn covers_repeats(fabric: &Fabric, camera: &Camera, height: u32) -> bool {
    let [x, y] = fabric.repeat_um();
    height >= FAR_LINES && f64::from(camera.pixel_um(height)) > 0.5 * x.max(y)
}

/// Slits as the flags have them; those of the spec without.
pub(super) fn slits(args: &RenderArgs) -> Outcome<Option<Slits>> {
    match (args.slit_um, args.without.contains(&FabricPart::Slits)) {
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

/// Whether the yarns of a fabric have slits, which the mean over its repeat leaves out.
fn has_slits(spec: &FabricSpec, options: &FabricOptions) -> bool {
    YarnSet::EACH.into_iter().any(|family| options.slits_or(spec.yarn(family).slits()).is_some())
}

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    check_flags(args)?;
    if kinds::kind_of(&args.fabric) == Some(kinds::Kind::StrandScene) {
        return super::render_strands::run(cli, args);
    }
    if matches!(kinds::kind_of(&args.fabric), Some(kinds::Kind::Cloth | kinds::Kind::ClothFile)) {
        return super::render_cloth::run(cli, args);
    }
    if args.integrator == Some(Integrator::Dual) {
        let hint = "dual scattering is between strands and a fabric has none; give a scene of strands, or leave it out";
        return Err(Failure::input("command line", "--integrator", "dual", hint));
    }
    let outputs = Outputs::from_args(args)?;
    let loaded = FabricSpec::load_file(&args.fabric, &cli.library()?)?;
    let inputs = inputs(args, &loaded.spec, &loaded.model_paths);
    let read: Vec<&Path> = inputs.iter().map(|(_, path)| path.as_path()).collect();
    let _held = outputs.hold(&read)?;
    let options = FabricOptions {
        gaps: if args.straight_gaps { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: args.sigma.map(|s| s as f32),
        noise: !args.smooth,
        layers: !args.without.contains(&FabricPart::Layers),
        shadowing: !args.without.contains(&FabricPart::Shadowing),
        edges: !args.without.contains(&FabricPart::Edges),
        slits: slits(args)?,
        far: false,
    };
    let named = setup(args);
    let setup = Setup::from(named);
    let size = args.size_mm.map_or(setup.size_mm(), |s| s as f32);
    let camera = camera(args, setup.camera(size))?;
    let far = !args.without.contains(&FabricPart::Far) && covers_repeats(&loaded.fabric, &camera, args.height);
    let has_slits = has_slits(&loaded.spec, &options);
    let options = FabricOptions { far: far && !has_slits, ..options };
    let of = ingredients(args, size, &inputs, &loaded)?;
    let film = film(args, &outputs, &of)?;
    let mut notes = loaded.notes();
    notes.extend(super::weave::lean_notes(&loaded.fabric));
    if options.noise {
        let smooth = loaded.models.iter().zip(&loaded.model_paths).filter(|(model, _)| model.data().noise.is_none());
        notes.extend(smooth.map(|(_, path)| {
            format!("{} has no speckle noise and stays smooth; `plywave noise` adds it", path.display())
        }));
    }
    if far && has_slits {
        notes.push(
            "with slits, pixels that cover repeats show points of them instead of the mean, which has no slits".into(),
        );
    }
    // What is quickly refused comes before what takes seconds.
    let mesh = mesh(args, size, &mut notes)?;
    let sky = crate::rendering::sky(args, &mut notes)?;
    let name = loaded.spec.name.clone();
    let fabric = FabricModel::new(loaded, &options)?;
    if args.sigma.is_none() {
        notes.extend(color::fabric_notes(&fabric));
    }
    let (scene, _) = setup.scene(size, mesh, sky);
    let render_options = RenderOptions { samples: args.samples, depth: args.depth, seed: args.seed };
    let about = About { name, scene: format!("{named:?}").to_lowercase(), notes };
    shoot(cli, args, &outputs, &of, film, about, |film, after| {
        render(&scene, &camera, &fabric, film, &render_options, &STOP, after)
    })
}
