//! `plywave render`: a fabric in a ready-made scene, or strands in their own, by the reference host.

use super::{color, on_threads};
use crate::args::{Cli, FabricPart, Integrator, RenderArgs, Scene};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar, STOP};
use crate::{kinds, output, report};
use plywave::fabric::{Fabric, FabricBsdf, FabricOptions, FabricSpec, GapLight, WeaveSpec};
use plywave_render::{
    Environment, Facts, Film, FilmView, Ingredients, Mesh, MeshNotes, RenderError, RenderOptions, Setup, png, render,
};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
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
            Scene::Grazing => Setup::Grazing,
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
        RenderError::Io { file, source } if source.kind() == std::io::ErrorKind::NotFound => {
            Failure::Input(format!("{file}: no such file; check the path"))
        }
        other => Failure::Input(other.to_string()),
    }
}

/// The ready-made scene.
fn setup(args: &RenderArgs) -> Scene {
    args.setup.unwrap_or(Scene::Front)
}

/// Most scatterings of a path in a fabric.
fn depth(args: &RenderArgs) -> u32 {
    args.depth.unwrap_or(8)
}

/// The files that a render writes, by the ending of `-o`.
pub(super) struct Outputs {
    png: Option<PathBuf>,
    exr: Option<PathBuf>,
    /// For `--resume`.
    sums: PathBuf,
}

impl Outputs {
    pub(super) fn of(args: &RenderArgs) -> Outcome<Outputs> {
        let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.fabric, "png"));
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let sums = path.with_extension("sums");
        match ending.as_str() {
            "png" => {
                let exr = (!args.no_exr).then(|| path.with_extension("exr"));
                Ok(Outputs { png: Some(path), exr, sums })
            }
            "exr" if args.no_exr => {
                Err(Failure::input("command line", "--no-exr", path.display(), "leave it out, or name a .png"))
            }
            "exr" => Ok(Outputs { png: None, exr: Some(path), sums }),
            "" => {
                Err(Failure::input(path.display(), "-o", "no ending", "use .png, with an EXR beside it, or .exr alone"))
            }
            other => {
                let hint = "use .png, with an EXR beside it, or .exr alone";
                Err(Failure::input(path.display(), "-o", format!(".{other}"), hint))
            }
        }
    }

    pub(super) fn each(&self) -> impl Iterator<Item = &Path> {
        [self.png.as_deref(), self.exr.as_deref(), Some(self.sums.as_path())].into_iter().flatten()
    }

    /// The picture that was asked for.
    fn main(&self) -> &Path {
        self.png.as_deref().or(self.exr.as_deref()).unwrap_or(&self.sums)
    }
}

/// What a render reads: names for people, and paths.
fn inputs(args: &RenderArgs, spec: &FabricSpec, models: &[PathBuf]) -> Vec<(&'static str, PathBuf)> {
    let mut list = vec![("fabric spec", args.fabric.clone())];
    list.extend(models.iter().map(|model| ("model", model.clone())));
    if let WeaveSpec::Wif { file } = &spec.weave {
        list.push(("WIF", args.fabric.parent().unwrap_or(Path::new("")).join(file)));
    }
    list.extend(args.mesh.iter().map(|m| ("mesh", m.clone())));
    list.extend(args.sky.iter().map(|s| ("sky", s.clone())));
    list
}

/// SHA-256 of a file's bytes, in hex.
pub(super) fn digest_of_file(path: &Path) -> Outcome<String> {
    let mut hash = Sha256::new();
    let copied = std::fs::File::open(path).and_then(|mut file| {
        let mut buffer = vec![0; 1 << 16];
        loop {
            match std::io::Read::read(&mut file, &mut buffer)? {
                0 => return Ok(()),
                n => hash.update(&buffer[..n]),
            }
        }
    });
    copied.map_err(|e| Failure::Input(format!("{}: {e}; check the path and its rights", path.display())))?;
    Ok(hex(&hash.finalize()))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// Contents of the inputs and the flags that matter for the picture: what sums must have in common with a render to go on.
fn ingredients(args: &RenderArgs, size: f32, inputs: &[(&'static str, PathBuf)]) -> Outcome<Vec<(String, String)>> {
    let mut list = vec![("version".to_string(), env!("CARGO_PKG_VERSION").to_string())];
    for (name, path) in inputs {
        list.push(((*name).to_string(), digest_of_file(path)?));
    }
    let flags: [(&str, String); 11] = [
        ("--setup", format!("{:?}", setup(args))),
        ("--size-mm", size.to_string()),
        ("--cloth-mm", args.cloth_mm.to_string()),
        ("--width", args.width.to_string()),
        ("--height", args.height.to_string()),
        ("--depth", depth(args).to_string()),
        ("--seed", args.seed.to_string()),
        ("--sigma", format!("{:?}", args.sigma)),
        ("--straight-gaps", args.straight_gaps.to_string()),
        ("--smooth", args.smooth.to_string()),
        (
            "--without",
            [FabricPart::Layers, FabricPart::Shadowing, FabricPart::Edges, FabricPart::Far]
                .map(|p| args.without.contains(&p))
                .map(u8::from)
                .map(|b| b.to_string())
                .concat(),
        ),
    ];
    list.extend(flags.map(|(name, value)| (name.to_string(), value)));
    Ok(list)
}

/// One digest for all of it.
fn digest(of: &Ingredients) -> String {
    let mut hash = Sha256::new();
    for (name, value) in of {
        hash.update(format!("{name} = {value}\n"));
    }
    format!("sha256:{}", hex(&hash.finalize()))
}

/// What was done to a mesh, a line each.
fn mesh_notes(file: &Path, notes: &MeshNotes) -> Vec<String> {
    let file = file.display();
    let scale = report::number(f64::from(notes.mm_per_unit));
    let mut lines =
        vec![format!("{file}: scaled and centered, 1 unit is {scale} mm; --size-mm sets its largest extent")];
    for (count, what) in [(notes.equal_faces, "equal to another"), (notes.flat_faces, "without area")] {
        if count > 0 {
            lines.push(format!("{file}: left out {} {what}", report::counted(count as u64, "face", "faces")));
        }
    }
    lines
}

/// Refuses flags out of range.
pub(super) fn check_flags(args: &RenderArgs) -> Outcome {
    if u64::from(args.width) * u64::from(args.height) > MOST_PIXELS {
        return Err(Failure::input("command line", "--width", args.width, "a picture of at most 268 M pixels"));
    }
    for (name, value, low, high) in [
        ("--size-mm", args.size_mm, 1e-3, 1e5),
        ("--cloth-mm", Some(args.cloth_mm), 1e-3, 1e6),
        ("--sigma", args.sigma, 0.0, 1e6),
        ("--exposure", Some(args.exposure), -40.0, 40.0),
    ] {
        if let Some(v) = value.filter(|v| !(low..=high).contains(v)) {
            return Err(Failure::input("command line", name, v, &format!("must be from {low} to {high}")));
        }
    }
    Ok(())
}

/// Lines of a picture that is worth the seconds in which the mean over the repeat is made.
const FAR_LINES: u32 = 256;

/// Whether a pixel covers half of a fabric's repeat or more, so that its mean takes part.
pub(super) fn covers_repeats(fabric: &Fabric, setup: Setup, size_mm: f32, height: u32) -> bool {
    let [x, y] = fabric.repeat_um();
    height >= FAR_LINES && f64::from(setup.pixel_um(size_mm, height)) > 0.5 * x.max(y)
}

/// Runs the command.
pub fn run(cli: &Cli, args: &RenderArgs) -> Outcome {
    check_flags(args)?;
    if kinds::kind_of(&args.fabric) == Some(kinds::Kind::StrandScene) {
        return super::render_strands::run(cli, args);
    }
    if args.integrator == Some(Integrator::Dual) {
        let hint = "dual scattering is between strands and a fabric has none; give a scene of strands, or leave it out";
        return Err(Failure::input("command line", "--integrator", "dual", hint));
    }
    let outputs = Outputs::of(args)?;
    let loaded = kinds::load_fabric(&args.fabric)?;
    let inputs = inputs(args, &loaded.spec, &loaded.model_paths);
    let read: Vec<&Path> = inputs.iter().map(|(_, path)| path.as_path()).collect();
    outputs.each().try_for_each(|path| output::check_writable(path, &read))?;
    let options = FabricOptions {
        gaps: if args.straight_gaps { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: args.sigma.map(|s| s as f32),
        noise: !args.smooth,
        layers: !args.without.contains(&FabricPart::Layers),
        shadowing: !args.without.contains(&FabricPart::Shadowing),
        edges: !args.without.contains(&FabricPart::Edges),
        far: false,
    };
    let setup = Setup::from(setup(args));
    let size = args.size_mm.map_or(setup.size_mm(), |s| s as f32);
    let far = !args.without.contains(&FabricPart::Far) && covers_repeats(&loaded.fabric, setup, size, args.height);
    let options = FabricOptions { far, ..options };
    let of = ingredients(args, size, &inputs)?;
    let film = film(args, &outputs, &of)?;
    let mut notes = loaded.notes();
    notes.extend(super::weave::lean_notes(&loaded.fabric));
    if options.noise {
        let smooth = loaded.models.iter().zip(&loaded.model_paths).filter(|(model, _)| model.data().noise.is_none());
        notes.extend(smooth.map(|(_, path)| {
            format!("{} has no speckle noise and stays smooth; `plywave noise` adds it", path.display())
        }));
    }
    // What is quickly refused comes before what takes seconds.
    let mesh = match &args.mesh {
        Some(file) => {
            let (mesh, told) = Mesh::obj(file, 1000.0 * args.cloth_mm as f32, size).map_err(failed)?;
            notes.extend(mesh_notes(file, &told));
            Some(mesh)
        }
        None => None,
    };
    let sky = args.sky.as_ref().map(|file| Environment::load(file, 1.0)).transpose().map_err(failed)?;
    let name = loaded.spec.name.clone();
    let fabric = FabricBsdf::new(loaded, &options)?;
    if args.sigma.is_none() {
        notes.extend(color::fabric_notes(&fabric));
    }
    let (scene, camera) = setup.scene(size, mesh, sky);
    let render_options = RenderOptions { samples: args.samples, depth: depth(args), seed: args.seed };
    let about = About { name, scene: format!("{:?}", crate::commands::render::setup(args)).to_lowercase(), notes };
    shoot(cli, args, &outputs, &of, film, about, |film, after| {
        render(&scene, &camera, &fabric, film, &render_options, &STOP, after)
    })
}

/// A new film, or with `--resume` the one to go on with.
pub(super) fn film(args: &RenderArgs, outputs: &Outputs, of: &Ingredients) -> Outcome<Film> {
    match outputs.sums.exists() && args.resume {
        true => Film::resume(&outputs.sums, of, args.width, args.height).map_err(failed),
        false => Film::new(args.width, args.height).map_err(failed),
    }
}

/// What is said of a render.
pub(super) struct About {
    /// Name of the fabric or the strands.
    pub name: String,
    /// What it is shown in.
    pub scene: String,
    /// For the user, a line each.
    pub notes: Vec<String>,
}

/// Called after each pass with what is there.
pub(super) type After<'a> = &'a mut dyn FnMut(&Film) -> Result<(), RenderError>;

/// Renders by `work`, keeps sums now and then, writes the pictures and says so.
pub(super) fn shoot(
    cli: &Cli,
    args: &RenderArgs,
    outputs: &Outputs,
    of: &Ingredients,
    mut film: Film,
    about: About,
    work: impl FnOnce(&mut Film, After<'_>) -> Result<(), RenderError> + Send,
) -> Outcome {
    progress::install_stop();
    let bar = Bar::new("render", "samples", cli.quiet);
    let first = film.samples();
    let mut saved = std::time::Instant::now();
    let save = |film: &Film| output::write_whole(&outputs.sums, &film.sums(of).map_err(failed)?);
    let mut unsaved = None;
    let outcome = on_threads(cli, || {
        progress::stoppable(|| {
            work(&mut film, &mut |film| {
                bar.update("render", film.samples().into(), args.samples.into());
                if saved.elapsed() > Duration::from_secs(10) && film.samples() < args.samples {
                    if let Err(failure) = save(film) {
                        unsaved = Some(failure);
                        return Err(RenderError::Stopped { done: film.samples(), total: args.samples });
                    }
                    saved = std::time::Instant::now();
                }
                Ok(())
            })
        })
    })?;
    if let Some(failure) = unsaved {
        return Err(failure);
    }
    if let Err(error) = outcome {
        save(&film)?;
        return Err(failed(error));
    }
    let time = bar.finish();
    let facts = Facts {
        software: format!("plywave {}", env!("CARGO_PKG_VERSION")),
        fabric: about.name,
        spec: args.fabric.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        digest: digest(of),
        scene: about.scene,
        seed: args.seed,
        samples: film.samples(),
        exposure: args.exposure as f32,
    };
    if let Some(path) = &outputs.exr {
        output::write_whole(path, &film.exr(&facts).map_err(failed)?)?;
    }
    if let Some(path) = &outputs.png {
        let image = film.image(FilmView::Light, args.exposure as f32);
        output::write_whole(path, &png(&image, &facts.entries()).map_err(failed)?)?;
    }
    match args.keep_sums {
        true => save(&film)?,
        // Sums that were never written, or are gone already, need no removal.
        false => drop(std::fs::remove_file(&outputs.sums)),
    }
    tell(cli, args, outputs, (&film, first), time, &facts, &about.notes)
}

/// Says what came out.
fn tell(
    cli: &Cli,
    args: &RenderArgs,
    outputs: &Outputs,
    (film, first): (&Film, u32),
    time: Duration,
    facts: &Facts,
    notes: &[String],
) -> Outcome {
    let paths = u64::from(film.samples().saturating_sub(first)) * u64::from(args.width) * u64::from(args.height);
    if cli.json {
        let shown = |path: &Option<PathBuf>| path.as_ref().map(|p| p.display().to_string());
        return output::print_json(&serde_json::json!({
            "png": shown(&outputs.png), "exr": shown(&outputs.exr), "width": args.width, "height": args.height,
            "samples": film.samples(), "seconds": time.as_secs_f64(), "paths": paths, "digest": facts.digest, "notes": notes,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        let samples = report::counted(film.samples().into(), "sample", "samples");
        writeln!(out, "{}: {} x {}, {samples} a pixel", outputs.main().display(), args.width, args.height)?;
        let rate = paths as f64 / time.as_secs_f64().max(1e-9);
        writeln!(out, "  time         {}, {} paths/s", report::duration(time), report::count(rate))?;
        if let (Some(_), Some(exr)) = (&outputs.png, &outputs.exr) {
            writeln!(out, "  linear       {}", exr.display())?;
        }
        notes.iter().try_for_each(|note| writeln!(out, "  note         {note}"))
    })
}
