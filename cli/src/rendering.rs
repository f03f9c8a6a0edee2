//! Common parts of `plywave render` for cloths and strands: output files, inputs that resumed sums must
//! match, the render loop with its bar, and its report.

use crate::args::{Cli, RenderArgs, Scene};
use crate::failure::{Failure, Outcome};
use crate::output::Held;
use crate::progress::{self, Bar};
use crate::threads::on_threads;
use crate::{output, report};
use glam::Vec3;
use plywave_pipeline::digest_of_file;
use plywave_render::{
    Camera, Environment, Facts, Film, FilmView, Ingredients, MAX_SCATTERINGS, Mesh, MeshNotes, RenderError, Setup, png,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Largest number of pixels of a picture.
const MAX_PIXELS: u64 = 1 << 28;
/// Fraction of omitted light above which a note is printed.
const TOLD: f64 = 0.005;

/// Failure for a render that ended early.
pub fn failed(error: RenderError) -> Failure {
    match error {
        RenderError::Stopped { .. } => progress::stopped(""),
        RenderError::Io { file, source } if source.kind() == std::io::ErrorKind::NotFound => {
            Failure::Input(format!("{file}: no such file; check the path"))
        }
        other => Failure::Input(other.to_string()),
    }
}

/// Files that a render writes, according to the ending of `-o`.
pub struct Outputs {
    png: Option<PathBuf>,
    exr: Option<PathBuf>,
    /// File of the sums for `--resume`.
    sums: PathBuf,
}

impl Outputs {
    pub fn from_args(args: &RenderArgs) -> Outcome<Outputs> {
        let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.cloth, "png"));
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

    pub fn each(&self) -> impl Iterator<Item = &Path> {
        [self.png.as_deref(), self.exr.as_deref(), Some(self.sums.as_path())].into_iter().flatten()
    }

    /// Refuses outputs that cannot be written and those of a running command; locks them while the result
    /// lives.
    pub fn hold(&self, inputs: &[&Path]) -> Outcome<Vec<Held>> {
        self.each().try_for_each(|path| output::check_writable(path, inputs))?;
        self.each().map(output::hold).collect()
    }

    /// Refuses to discard the sums of an earlier render without a flag that requests it.
    pub fn check_sums(&self, args: &RenderArgs) -> Outcome {
        if args.resume || args.fresh || !self.sums.exists() {
            return Ok(());
        }
        Err(Failure::Input(format!(
            "{}: holds the sums of an earlier render; go on with --resume, or delete them with --fresh",
            self.sums.display()
        )))
    }

    /// The picture that the flags select.
    fn main(&self) -> &Path {
        self.png.as_deref().or(self.exr.as_deref()).unwrap_or(&self.sums)
    }
}

/// Digests of the files that a picture is made of, taken before they are read. They name the sums of
/// `--resume`, so they must be those of the bytes that were read.
pub struct InputDigests(Vec<(String, PathBuf, Option<String>)>);

impl InputDigests {
    /// Takes the digests; a file that cannot be read has none.
    pub fn take(inputs: &[(String, PathBuf)]) -> InputDigests {
        let of = |(name, path): &(String, PathBuf)| (name.clone(), path.clone(), digest_of_file(path).ok());
        InputDigests(inputs.iter().map(of).collect())
    }

    /// The digests by name, after the files were read; refuses a file that changed since they were taken.
    pub fn check(self) -> Outcome<Vec<(String, String)>> {
        let check = |(name, path, before): (String, PathBuf, Option<String>)| {
            let digest = digest_of_file(&path)?;
            if before.is_some_and(|before| before != digest) {
                let what = format!("{}: changed while it was read; run it again when it is complete", path.display());
                return Err(Failure::Input(what));
            }
            Ok((name, digest))
        };
        self.0.into_iter().map(check).collect()
    }
}

/// One digest of all inputs of a picture.
fn digest(of: &Ingredients) -> String {
    let all: String = of.iter().map(|(name, value)| format!("{name} = {value}\n")).collect();
    format!("sha256:{}", plywave_pipeline::digest_of_bytes(all.as_bytes()))
}

/// Refuses flags that are out of range.
pub fn check_flags(args: &RenderArgs) -> Outcome {
    if u64::from(args.width) * u64::from(args.height) > MAX_PIXELS {
        return Err(Failure::input("command line", "--width", args.width, "give a picture of at most 268 M pixels"));
    }
    for (name, value, low, high) in [
        ("--size-mm", args.size_mm, 1e-3, 1e5),
        ("--cloth-mm", Some(args.cloth_mm), 1e-3, 1e6),
        ("--sigma", args.sigma, 0.0, 1e6),
        ("--slit-share", args.slit_share, 0.0, 1.0),
        ("--lamp-scale", args.lamp_scale, 1e-3, 1e3),
        ("--exposure", args.exposure, -40.0, 40.0),
        ("--fov", args.fov, 0.001, 170.0),
    ] {
        if let Some(v) = value.filter(|v| !(low..=high).contains(v)) {
            return Err(Failure::input("command line", name, v, &format!("must be from {low} to {high}")));
        }
    }
    Ok(())
}

/// Largest coordinate of the camera and its target [mm].
const FARTHEST_MM: f64 = 1e6;

/// The scene's camera, with the overrides of the flags.
pub fn camera(args: &RenderArgs, own: Camera) -> Outcome<Camera> {
    let own = own.view();
    let shown = |v: [f64; 3]| v.map(|v| v.to_string()).join(",");
    let refuse =
        |name: &str, value: [f64; 3], hint: &str| Err(Failure::input("command line", name, shown(value), hint));
    for (name, place) in [("--camera", args.camera), ("--look", args.look)] {
        if let Some(place) = place.filter(|p| p.iter().any(|v| v.abs() > FARTHEST_MM)) {
            return refuse(name, place, &format!("must be within {FARTHEST_MM} mm of the origin along each axis"));
        }
    }
    let of = |v: Option<[f64; 3]>| v.map(|v| v.map(|v| v as f32).into());
    let from = of(args.camera).unwrap_or(own.from);
    let to = of(args.look).unwrap_or(own.to);
    let fov_rad = args.fov.map_or(own.fov_rad, |deg| deg.to_radians() as f32);
    let Some(forward) = (to - from).try_normalize() else {
        let (name, place) = if args.camera.is_some() { ("--camera", from) } else { ("--look", to) };
        return refuse(name, place.to_array().map(f64::from), "the camera must not be at the point that it looks at");
    };
    // An up vector along the view direction leaves the orientation of the picture undefined.
    let is_along = |up: Vec3| up.normalize_or_zero().cross(forward).length() < 1e-3;
    let up = match of(args.up) {
        Some(up) if is_along(up) => {
            return refuse(
                "--up",
                args.up.unwrap_or_default(),
                "must not be 0, nor along the view: give another direction",
            );
        }
        Some(up) => up,
        None => [own.up, Vec3::Z, Vec3::Y].into_iter().find(|up| !is_along(*up)).unwrap_or(own.up),
    };
    Ok(Camera::new(from, to, up, fov_rad))
}

/// Flags of the camera, for [`Ingredients`].
pub fn camera_flags(args: &RenderArgs) -> [(String, String); 4] {
    [
        ("--camera", format!("{:?}", args.camera)),
        ("--look", format!("{:?}", args.look)),
        ("--up", format!("{:?}", args.up)),
        ("--fov", format!("{:?}", args.fov)),
    ]
    .map(|(name, value)| (name.to_string(), value))
}

/// Loads the sky of `--sky`, and adds a note for each assumption about its file.
pub fn sky(args: &RenderArgs, notes: &mut Vec<String>) -> Outcome<Option<Environment>> {
    let Some(file) = &args.sky else { return Ok(None) };
    let (sky, reported) = Environment::load(file, args.sky_layer.as_deref()).map_err(failed)?;
    notes.extend(reported.iter().map(|line| format!("{}: {line}", file.display())));
    Ok(Some(sky))
}

/// A new film, or with `--resume` the film of the saved sums; `--fresh` deletes saved sums.
pub fn film(args: &RenderArgs, outputs: &Outputs, of: &Ingredients) -> Outcome<Film> {
    if args.fresh && outputs.sums.exists() {
        let refuse = |e: std::io::Error| Failure::Input(format!("{}: {e}; remove it", outputs.sums.display()));
        std::fs::remove_file(&outputs.sums).map_err(refuse)?;
    }
    match outputs.sums.exists() && args.resume {
        true => Film::resume(&outputs.sums, of, args.width, args.height).map_err(failed),
        false => Film::new(args.width, args.height).map_err(failed),
    }
}

/// Data for the report and the metadata of a render.
pub struct About {
    /// Name of the cloth or the strands.
    pub name: String,
    /// Name of the scene.
    pub scene: String,
    /// Notes for the user, one per line.
    pub notes: Vec<String>,
    /// Whether the PNG is exposed by its own light, where no flag gives the exposure.
    pub is_metered: bool,
}

/// Callback that receives the film after each pass.
pub type After<'a> = &'a mut dyn FnMut(&Film) -> Result<(), RenderError>;

/// Renders with `work`, saves sums periodically, writes the pictures and reports them.
pub fn shoot(
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
        // A film without samples is not saved.
        if film.samples() > 0 {
            save(&film)?;
        }
        return Err(failed(error));
    }
    let time = bar.finish();
    let metered = || if about.is_metered { film.metered_exposure() } else { 0.0 };
    let exposure = args.exposure.map_or_else(metered, |stops| stops as f32);
    let facts = Facts {
        software: format!("plywave {}", env!("CARGO_PKG_VERSION")),
        cloth: about.name,
        spec: args.cloth.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
        digest: digest(of),
        scene: about.scene,
        seed: args.seed,
        samples: film.samples(),
        exposure,
        cut_share: film.cut_share(),
    };
    let mut files = Vec::new();
    if let Some(path) = &outputs.exr {
        files.push((path, film.exr(&facts).map_err(failed)?));
    }
    if let Some(path) = &outputs.png {
        let image = film.image(FilmView::Light, exposure);
        files.push((path, png(&image, &facts.entries()).map_err(failed)?));
    }
    output::write_set(&files)?;
    match args.keep_sums {
        true => save(&film)?,
        // Sums that do not exist need no removal.
        false => drop(std::fs::remove_file(&outputs.sums)),
    }
    let mut notes = about.notes;
    notes.extend(cut_note(args, facts.cut_share));
    tell(cli, args, outputs, (&film, first), time, &facts, &notes)
}

/// Note on the light that cut paths omit.
fn cut_note(args: &RenderArgs, share: f64) -> Option<String> {
    (share > TOLD).then(|| {
        let (percent, depth) = (100.0 * share, args.depth);
        let percent = format!("{percent:.*}", if percent < 10.0 { 1 } else { 0 });
        let more = if depth < MAX_SCATTERINGS { "; give a larger --depth, or none" } else { "" };
        format!("paths end after {depth} scatterings (--depth), which leaves out some {percent} % of the light{more}")
    })
}

/// Reports the result.
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
            "samples": film.samples(), "seconds": time.as_secs_f64(), "paths": paths, "digest": facts.digest,
            "cut_share": facts.cut_share, "exposure": facts.exposure, "notes": notes,
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
        if outputs.png.is_some() && args.exposure.is_none() && facts.exposure != 0.0 {
            writeln!(out, "  exposure     {:.2} stops", facts.exposure)?;
        }
        notes.iter().try_for_each(|note| writeln!(out, "  note         {note}"))
    })
}

impl From<Scene> for Setup {
    fn from(scene: Scene) -> Setup {
        match scene {
            Scene::Front => Setup::Front,
            Scene::Back => Setup::Back,
            Scene::Drape => Setup::Drape,
            Scene::Curtain => Setup::Curtain,
            Scene::Folded => Setup::Folded,
            Scene::Ball => Setup::Ball,
            Scene::Folds => Setup::Folds,
            Scene::Swatch => Setup::Swatch,
            Scene::Grazing => Setup::Grazing,
            Scene::Furnace => Setup::Furnace,
        }
    }
}

/// The predefined scene that the flags select.
pub fn setup(args: &RenderArgs) -> Scene {
    args.setup.unwrap_or(Scene::Front)
}

/// Notes on the import of a mesh, one per line.
pub fn mesh_notes(file: &Path, notes: &MeshNotes) -> Vec<String> {
    let file = file.display();
    let scale = report::number(notes.mm_per_unit);
    let mut lines =
        vec![format!("{file}: scaled and centered, 1 unit is {scale} mm; --size-mm sets its largest extent")];
    for (faces, done, what) in [
        (notes.equal, "left out", "equal to another"),
        (notes.flat, "left out", "without area in single precision"),
        (notes.crossed, "triangulated as far as possible", "crossing itself"),
    ] {
        if faces.count > 0 {
            let (counted, first) = (report::counted(faces.count as u64, "face", "faces"), faces.first);
            let which = if faces.count > 1 { "the first is " } else { "" };
            lines.push(format!("{file}: {done} {counted} {what}: {which}face {first} (line {})", faces.line));
        }
    }
    lines
}

/// The mesh that the flags select, scaled to the largest extent `size` [mm], with notes on its import.
pub fn mesh(args: &RenderArgs, size: f32, notes: &mut Vec<String>) -> Outcome<Option<Mesh>> {
    let Some(file) = &args.mesh else { return Ok(None) };
    let (mesh, reported) = Mesh::obj(file, 1000.0 * args.cloth_mm as f32, size).map_err(failed)?;
    notes.extend(mesh_notes(file, &reported));
    Ok(Some(mesh))
}
