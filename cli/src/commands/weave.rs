//! `plywave weave`: a fabric spec in, the textures of its weave out, for hosts that want images (Yu 2025,
//! 7.1), with a sheet to look at.

use crate::args::{Cli, WeaveArgs};
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, Kind};
use crate::report::{self, number};
use crate::{output, plot, progress};
use image::{ExtendedColorType, ImageEncoder};
use plywave::color::{AlbedoCurve, srgb_encode};
use plywave::fabric::{
    Fabric, FabricModel, FabricOptions, FabricSpec, USUAL_LEAN_DEG, WeaveSpec, YarnColor, YarnPlace, YarnSet,
};
use std::path::Path;
use std::time::{Duration, Instant};

/// The description in the folder, by which a folder is known as one of ours.
const DESCRIPTION: &str = "weave.json";
/// All files in the folder.
const FILES: [&str; 12] = [
    "draft.png",
    "family.png",
    "yarn.png",
    "across.png",
    "along.png",
    "tangent.png",
    "height.png",
    "base_color.png",
    "normal.png",
    "thickness.png",
    "sheet.png",
    DESCRIPTION,
];
/// Most pixels of a texture.
const MAX_PIXELS: f64 = (1u64 << 24) as f64;
/// Longest side of a texture without --pixels.
const USUAL_SIDE: f64 = 4096.0;
/// Pixels to the narrower spacing, where that makes no side longer.
const USUAL_PIXELS: f64 = 32.0;

/// Runs the command.
pub fn run(cli: &Cli, args: &WeaveArgs) -> Outcome {
    let begun = Instant::now();
    if kinds::kind_of(&args.fabric) == Some(Kind::Cloth) {
        return super::weave_cloth::run(cli, args);
    }
    let loaded = FabricSpec::load_file(&args.fabric, &cli.library()?)?;
    let mut notes = loaded.notes();
    notes.extend(lean_notes(&loaded.fabric));
    let spec = loaded.spec.clone();
    let mut inputs = loaded.model_paths.to_vec();
    if let WeaveSpec::Wif { file } = &spec.weave {
        inputs.push(args.fabric.parent().unwrap_or(Path::new("")).join(file));
    }
    // What is quickly refused comes before what takes seconds.
    let folder = args.output.clone().unwrap_or_else(|| output::default_output(&args.fabric, "weave"));
    output::check_folder(&folder, DESCRIPTION, &[&args.fabric])?;
    let read = [&[args.fabric.clone()][..], &inputs].concat();
    let read: Vec<&Path> = read.iter().map(std::path::PathBuf::as_path).collect();
    if folder.is_dir() {
        FILES.iter().try_for_each(|name| output::check_writable(&folder.join(name), &read))?;
    }
    let size = size(args, &loaded.fabric)?;
    let shading = FabricModel::new(loaded, &FabricOptions::default())?;
    notes.extend(super::color::fabric_notes(&shading));
    let load = begun.elapsed();
    let colors = YarnSet::EACH.map(|family| base_colors(&shading, family));
    let fabric = shading.fabric();
    progress::install_stop();
    let textures = textures(fabric, &colors, size, args.back);
    let mut files = Vec::new();
    for texture in &textures {
        files.push((texture.file, texture.png(&folder)?));
    }
    let sheet = plot::weave::sheet(&spec.name, &particulars(fabric), fabric);
    files.push(("sheet.png", plot::Format::Png.encode(&sheet, &folder)?));
    let mut about = about(&spec, fabric, size, args.back, &textures);
    about["shading_bytes"] = shading.memory_bytes().into();
    progress::stoppable(|| {
        let made = std::fs::create_dir_all(&folder);
        made.map_err(|e| Failure::input(folder.display(), "-o", e, "choose a place that can be written"))?;
        for (name, bytes) in &files {
            output::write_whole(&folder.join(name), bytes)?;
        }
        // The description last: it stands for the whole.
        output::write_whole_by(&folder.join(DESCRIPTION), |out| {
            serde_json::to_writer_pretty(&mut *out, &about).map_err(std::io::Error::from)?;
            writeln!(out)
        })
    })?;
    tell(cli, &folder, &shading, load, &notes, &about)
}

/// Width and height of the textures of one repeat.
fn size(args: &WeaveArgs, fabric: &Fabric) -> Outcome<[u32; 2]> {
    let narrow = YarnSet::EACH.map(|f| fabric.shape(f).spacing_um).into_iter().fold(f64::INFINITY, f64::min);
    let cells = fabric.repeat_um().map(|um| um / narrow);
    let pixels = match args.pixels {
        Some(pixels) => f64::from(pixels),
        None => USUAL_PIXELS.min((USUAL_SIDE / cells[0].max(cells[1])).floor()).max(1.0),
    };
    let [w, h] = cells.map(|c| (c * pixels).round().max(1.0));
    if w * h > MAX_PIXELS {
        let most = (MAX_PIXELS / (cells[0] * cells[1])).sqrt().floor();
        let hint = match most {
            most if most >= 1.0 => format!("one repeat would take {w} x {h} pixels; use {most} or less"),
            _ => "one repeat of this draft is too large for textures; evaluate the fabric model instead".into(),
        };
        return Err(Failure::input("command line", "--pixels", pixels, &hint));
    }
    Ok([w as u32, h as u32])
}

/// One texture: gray of 8 or 16 bits, three channels of 16, or four of 8.
struct Texture {
    file: &'static str,
    meaning: String,
    size: [u32; 2],
    color: ExtendedColorType,
    /// Native-endian samples.
    bytes: Vec<u8>,
    /// Micrometers to a step of the samples, where they are a length.
    um_per_step: Option<f64>,
}

impl Texture {
    fn png(&self, folder: &Path) -> Outcome<Vec<u8>> {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes)
            .write_image(&self.bytes, self.size[0], self.size[1], self.color)
            .map_err(|e| Failure::input(folder.join(self.file).display(), "-o", e, "choose fewer --pixels"))?;
        Ok(bytes)
    }
}

/// A number of [0, 1] in 16 bits.
fn unit16(x: f64) -> u16 {
    (65535.0 * x.clamp(0.0, 1.0)).round() as u16
}

/// A number of [-1, 1] in 16 bits, 32768 for 0.
fn signed16(x: f64) -> u16 {
    (32768.0 + 32767.0 * x.clamp(-1.0, 1.0)).round() as u16
}

/// Base colors of the yarns of a repeat, encoded sRGB: the color of the spec or the WIF; of other yarns the
/// albedo of their fibers under diffuse light.
fn base_colors(shading: &FabricModel, family: YarnSet) -> Vec<[u8; 3]> {
    let fabric = shading.fabric();
    let gray = |thread: i32, sigma: f64| {
        let curve = AlbedoCurve::diffuse(shading.model_of(family, thread));
        [srgb_encode(curve.albedo(sigma)); 3]
    };
    let of = |thread: usize| match fabric.color(family, thread as i32) {
        YarnColor::Srgb(srgb) => srgb.map(f64::from),
        YarnColor::Sigma(sigma) => gray(thread as i32, f64::from(sigma)),
        YarnColor::Undyed => gray(thread as i32, 0.0),
    };
    let bytes = |c: [f64; 3]| c.map(|v| (255.0 * v.clamp(0.0, 1.0)).round() as u8);
    (0..fabric.draft().threads(family)).map(|thread| bytes(of(thread))).collect()
}

/// Normal of a yarn's round outline where it is seen, in the fabric's axes; z points out of the side that is
/// seen.
fn normal(fabric: &Fabric, place: &YarnPlace) -> [f64; 3] {
    let half = 0.5 * fabric.shape(place.family).width_um();
    let sin = (f64::from(place.across_um) / half).clamp(-1.0, 1.0);
    let cos = (1.0 - sin * sin).sqrt();
    let [tx, ty, tz] = place.tangent.map(f64::from);
    // The axis of warp has no x, that of weft no y; the outline leans back where the axis climbs.
    let normal = match place.family {
        YarnSet::Warp => [sin, -cos * tz * ty.signum(), cos * ty.abs()],
        YarnSet::Weft => [-cos * tz * tx.signum(), sin, cos * tx.abs()],
    };
    normal.map(|v| if v.is_finite() { v } else { 0.0 })
}

/// Steps of the tables of [`chords`].
const CHORDS: usize = 1024;

/// Height of fiber-filled plies over distances from a level yarn's axis, from 0 to half its width [um], the
/// mean over the turn of the plies.
fn chords(fabric: &Fabric, family: YarnSet) -> Vec<f64> {
    const TURNS: usize = 96;
    let s = fabric.shape(family);
    let (radius, circle, plies) = (s.ply_radius_um, s.circle_um(), s.plies as usize);
    let turns = if plies > 1 { TURNS } else { 1 };
    let at = |across: f64| {
        let mut sum = 0.0;
        for turn in 0..turns {
            for ply in 0..plies {
                let psi = (ply as f64 + (turn as f64 + 0.5) / turns as f64) / plies as f64 * std::f64::consts::TAU;
                let from_axis = across - circle * psi.cos();
                sum += 2.0 * (radius * radius - from_axis * from_axis).max(0.0).sqrt();
            }
        }
        sum / turns as f64
    };
    (0..=CHORDS).map(|k| at(0.5 * s.width_um() * k as f64 / CHORDS as f64)).collect()
}

/// Height of the plies of one yarn at a point [um]: of a yarn that leans a vertical line cuts a longer piece.
fn thickness(fabric: &Fabric, chords: &[Vec<f64>; 2], place: &YarnPlace) -> f64 {
    let half = 0.5 * fabric.shape(place.family).width_um();
    let x = (f64::from(place.across_um).abs() / half).min(1.0) * CHORDS as f64;
    let (k, table) = ((x as usize).min(CHORDS - 1), &chords[place.family as usize]);
    let level = table[k] + (x - k as f64) * (table[k + 1] - table[k]);
    let tz = f64::from(place.tangent[2]);
    level / (1.0 - tz * tz).max(1e-6).sqrt()
}

/// All textures; the first row is that of the largest y.
fn textures(fabric: &Fabric, colors: &[Vec<[u8; 3]>; 2], [w, h]: [u32; 2], from_back: bool) -> Vec<Texture> {
    let repeat = fabric.repeat_um();
    let half = f64::from(fabric.half_thickness_um());
    let [mut family, mut yarn, mut across, mut along, mut tangent, mut height] = [const { Vec::new() }; 6];
    let [mut base_color, mut normals] = [const { Vec::new() }; 2];
    let chords = YarnSet::EACH.map(|f| chords(fabric, f));
    let mut thick: Vec<f64> = Vec::new();
    for row in 0..h {
        for column in 0..w {
            let x = (f64::from(column) + 0.5) / f64::from(w) * repeat[0];
            let y = (f64::from(h - 1 - row) + 0.5) / f64::from(h) * repeat[1];
            let place = fabric.yarn_at(x as f32, y as f32, from_back);
            family.push(match place.map(|p| p.family) {
                None => 0,
                Some(YarnSet::Weft) => 128,
                Some(YarnSet::Warp) => 255,
            });
            let of = |f: &dyn Fn(&YarnPlace) -> u16, gap: u16| place.as_ref().map_or(gap, f).to_ne_bytes();
            let threads = |p: &YarnPlace| fabric.draft().threads(p.family) as i32;
            yarn.extend(of(&|p| (p.yarn.rem_euclid(threads(p)) + 1) as u16, 0));
            across.extend(of(&|p| signed16(2.0 * f64::from(p.across_um) / fabric.shape(p.family).width_um()), 32768));
            along.extend(of(&|p| unit16(f64::from(p.along_um) / repeat[p.family.other() as usize]), 0));
            for k in 0..3 {
                tangent.extend(of(&|p| signed16(f64::from(p.tangent[k])), 32768));
            }
            height.extend(of(&|p| signed16(f64::from(p.height_um) / half), 32768));
            base_color.extend(match &place {
                Some(p) => {
                    let [r, g, b] = colors[p.family as usize][p.yarn.rem_euclid(threads(p)) as usize];
                    [r, g, b, 255]
                }
                None => [0; 4],
            });
            let n = place.as_ref().map_or([0.0, 0.0, 1.0], |p| normal(fabric, p));
            n.iter().for_each(|v| normals.extend(unit16(0.5 + 0.5 * v).to_ne_bytes()));
            // Where two yarns lie, the lower one is on top for who looks from the other side.
            let below = place.as_ref().filter(|p| p.is_double);
            let below = below.and_then(|_| fabric.yarn_at(x as f32, y as f32, !from_back));
            thick.push([place, below].iter().flatten().map(|p| thickness(fabric, &chords, p)).sum());
        }
    }
    let thickest = thick.iter().copied().fold(0.0, f64::max);
    // Hundredths of a micrometer, or ten, hundred.. times as much, as 16 bits hold it.
    let um_per_step = (0..).map(|k| 0.01 * 10f64.powi(k)).find(|step| 65535.0 * step >= thickest).unwrap_or(0.01);
    let thick: Vec<u8> = thick.iter().flat_map(|um| ((um / um_per_step).round() as u16).to_ne_bytes()).collect();
    let draft = fabric.draft();
    let crossings = [draft.ends() as u32, draft.picks() as u32];
    let mut matrix = Vec::with_capacity(draft.ends() * draft.picks());
    for pick in (0..draft.picks()).rev() {
        matrix.extend((0..draft.ends()).map(|end| if draft.up(pick, end) { 255 } else { 0 }));
    }
    let of =
        |file, meaning: String, color, bytes| Texture { file, meaning, size: [w, h], color, bytes, um_per_step: None };
    let (l8, l16, rgb16) = (ExtendedColorType::L8, ExtendedColorType::L16, ExtendedColorType::Rgb16);
    vec![
        Texture {
            file: "draft.png",
            meaning: "a pixel a crossing, seen from the face: 255 warp on top, 0 weft".into(),
            size: crossings,
            color: l8,
            bytes: matrix,
            um_per_step: None,
        },
        of("family.png", "yarn on top: 255 warp, 128 weft, 0 gap".into(), l8, family),
        of("yarn.png", "its number in the repeat, from 1; 0 gap".into(), l16, yarn),
        of(
            "across.png",
            "(value - 32768) / 32767 times half the yarn's width is the distance from its axis, along +x on warp and +y on weft".into(),
            l16,
            across,
        ),
        of("along.png", "value / 65535 times the repeat is the place along the yarn: y on warp, x on weft".into(), l16, along),
        of("tangent.png", "(value - 32768) / 32767 are x, y, z of the yarn's direction".into(), rgb16, tangent),
        of("height.png", format!("(value - 32768) / 32767 times {half} um is the height of its axis"), l16, height),
        of(
            "base_color.png",
            "color of the yarn on top, encoded sRGB; alpha 0 in gaps".into(),
            ExtendedColorType::Rgba8,
            base_color,
        ),
        of(
            "normal.png",
            "2 value / 65535 - 1 are x, y, z of the normal of the yarn's round outline (OpenGL: red to the right, +y up the image, +z out of the side seen); flat in gaps"
                .into(),
            rgb16,
            normals,
        ),
        Texture {
            um_per_step: Some(um_per_step),
            ..of(
                "thickness.png",
                format!(
                    "value times {um_per_step} um is the height of all plies above each other, both yarns of a crossing; 0 in gaps; the mean over the turn of twisted plies"
                ),
                l16,
                thick,
            )
        },
    ]
}

fn about(spec: &FabricSpec, fabric: &Fabric, size: [u32; 2], back: bool, textures: &[Texture]) -> serde_json::Value {
    let yarns: serde_json::Map<String, serde_json::Value> = YarnSet::EACH
        .into_iter()
        .map(|family| {
            let s = fabric.shape(family);
            let value = serde_json::json!({
                "model": spec.yarn(family).model, "plies": s.plies, "ply_radius_um": s.ply_radius_um, "ply_circle_um": s.circle_um(),
                "ply_pitch_um": s.ply_pitch_um, "handedness": s.handedness, "width_um": s.width_um(), "spacing_um": s.spacing_um,
                "crimp": s.crimp,
            });
            (family.name().to_string(), value)
        })
        .collect();
    let list: Vec<_> = textures
        .iter()
        .map(|t| {
            let mut entry = serde_json::json!({ "file": t.file, "pixels": t.size, "meaning": t.meaning });
            if let Some(step) = t.um_per_step {
                entry["um_per_step"] = step.into();
            }
            entry
        })
        .collect();
    serde_json::json!({
        "name": spec.name, "program_version": env!("CARGO_PKG_VERSION"), "side": if back { "back" } else { "face" },
        "ends": fabric.draft().ends(), "picks": fabric.draft().picks(), "warp_on_top": fabric.draft().warp_share(),
        "repeat_um": fabric.repeat_um(), "pixels": size, "half_thickness_um": fabric.half_thickness_um(),
        "rows": "the first row of every image is that of the largest y", "memory_bytes": fabric.memory_bytes(),
        "yarns": yarns, "textures": list,
    })
}

/// Yarns that lean by more than this are told of [degrees]: such cloths are rare.
const STEEP_DEG: f64 = 45.0;

/// A line for each family whose yarns lean a lot.
pub fn lean_notes(fabric: &Fabric) -> Vec<String> {
    let note = |family: YarnSet| {
        let (lean, crimp, usual) = (fabric.lean_deg(family), fabric.shape(family).crimp, fabric.usual_crimp(family));
        (lean > STEEP_DEG).then(|| {
            format!(
                "{0} leans by up to {lean:.0} degrees; {0}.crimp = {usual:.2} in place of {1} leans by {USUAL_LEAN_DEG}",
                family.name(),
                number(crimp)
            )
        })
    };
    YarnSet::EACH.into_iter().filter_map(note).collect()
}

/// The yarns in words, one line a family.
fn particulars(fabric: &Fabric) -> Vec<String> {
    let draft = fabric.draft();
    let mut lines = vec![format!(
        "{} x {}, warp on top at {} % of the crossings",
        report::counted(draft.ends() as u64, "end", "ends"),
        report::counted(draft.picks() as u64, "pick", "picks"),
        number((1000.0 * draft.warp_share()).round() / 10.0)
    )];
    for family in YarnSet::EACH {
        let s = fabric.shape(family);
        let pitch =
            s.ply_pitch_um.filter(|_| s.plies > 1).map(|p| format!(", pitch {} um {:?}", number(p), s.handedness));
        lines.push(format!(
            "{}: {:.1} to the cm, {:.0} um wide, {} of radius {} um{}, crimp {} (leans by up to {:.0} degrees)",
            family.name(),
            1e4 / s.spacing_um,
            s.width_um(),
            report::counted(s.plies.into(), "ply", "plies"),
            number(s.ply_radius_um),
            pitch.unwrap_or_default(),
            number(s.crimp),
            fabric.lean_deg(family)
        ));
    }
    lines
}

/// Says what came out.
fn tell(
    cli: &Cli,
    folder: &Path,
    shading: &FabricModel,
    load: Duration,
    notes: &[String],
    about: &serde_json::Value,
) -> Outcome {
    let fabric = shading.fabric();
    if cli.json {
        let mut about = about.clone();
        about["load_s"] = load.as_secs_f64().into();
        about["notes"] = notes.into();
        about["folder"] = folder.display().to_string().into();
        return output::print_json(&about);
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: textures of one repeat, and sheet.png to look at", folder.display())?;
        for line in particulars(fabric) {
            writeln!(out, "  {line}")?;
        }
        let [draft, all] = [fabric.memory_bytes(), shading.memory_bytes()].map(|b| report::bytes(b as u64));
        writeln!(
            out,
            "  {draft} of draft and colors, {all} ready for shading without the models, read in {}",
            report::duration(load)
        )?;
        notes.iter().try_for_each(|note| writeln!(out, "  note: {note}"))
    })
}
