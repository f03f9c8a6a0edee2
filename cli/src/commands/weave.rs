//! `plywave weave`: a fabric spec in, the textures of its weave out, for hosts that want images (Yu 2025, 7.1), with a sheet to look at.

use crate::args::{Cli, WeaveArgs};
use crate::failure::{Failure, Outcome};
use crate::report::{self, number};
use crate::{output, plot, progress};
use image::{ExtendedColorType, ImageEncoder};
use plywave::fabric::{Fabric, FabricBsdf, FabricOptions, FabricSpec, Family, YarnPlace};
use std::path::Path;
use std::time::{Duration, Instant};

/// The description in the folder, by which a folder is known as one of ours.
const DESCRIPTION: &str = "weave.json";
/// Most pixels of a texture.
const MOST_PIXELS: f64 = (1u64 << 24) as f64;
/// Longest side of a texture whose size nobody asked for.
const USUAL_SIDE: f64 = 4096.0;
/// Pixels to the narrower spacing, where that makes no side longer.
const USUAL_PIXELS: f64 = 32.0;

/// Runs the command.
pub fn run(cli: &Cli, args: &WeaveArgs) -> Outcome {
    let begun = Instant::now();
    let loaded = FabricSpec::load(&args.fabric)?;
    let notes = loaded.notes();
    let spec = loaded.spec.clone();
    let shading = FabricBsdf::new(loaded, &FabricOptions::default())?;
    let load = begun.elapsed();
    let fabric = shading.fabric();
    let folder = args.output.clone().unwrap_or_else(|| output::default_output(&args.fabric, "weave"));
    output::check_folder(&folder, DESCRIPTION, &[&args.fabric])?;
    let size = size(args, fabric)?;
    progress::install_stop();
    let textures = textures(fabric, size, args.back);
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
    let narrow = Family::EACH.map(|f| fabric.shape(f).spacing_um).into_iter().fold(f64::INFINITY, f64::min);
    let cells = fabric.repeat_um().map(|um| um / narrow);
    let pixels = match args.pixels {
        Some(pixels) => f64::from(pixels),
        None => USUAL_PIXELS.min((USUAL_SIDE / cells[0].max(cells[1])).floor()).max(1.0),
    };
    let [w, h] = cells.map(|c| (c * pixels).round().max(1.0));
    if w * h > MOST_PIXELS {
        let most = (MOST_PIXELS / (cells[0] * cells[1])).sqrt().floor();
        let mend = match most {
            most if most >= 1.0 => format!("one repeat would take {w} x {h} pixels; use {most} or less"),
            _ => "one repeat of this draft is too large for textures; ask the fabric on the fly".into(),
        };
        return Err(Failure::input("command line", "--pixels", pixels, &mend));
    }
    Ok([w as u32, h as u32])
}

/// One texture: gray of 8 or 16 bits, or three channels of 16.
struct Texture {
    file: &'static str,
    meaning: String,
    size: [u32; 2],
    color: ExtendedColorType,
    /// Native-endian samples.
    bytes: Vec<u8>,
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

/// All textures; the first row is that of the largest y.
fn textures(fabric: &Fabric, [w, h]: [u32; 2], from_back: bool) -> Vec<Texture> {
    let repeat = fabric.repeat_um();
    let half = f64::from(fabric.half_thickness_um());
    let [mut family, mut yarn, mut across, mut along, mut tangent, mut height] = [const { Vec::new() }; 6];
    for row in 0..h {
        for column in 0..w {
            let x = (f64::from(column) + 0.5) / f64::from(w) * repeat[0];
            let y = (f64::from(h - 1 - row) + 0.5) / f64::from(h) * repeat[1];
            let place = fabric.yarn_at(x as f32, y as f32, from_back);
            family.push(match place.map(|p| p.family) {
                None => 0,
                Some(Family::Weft) => 128,
                Some(Family::Warp) => 255,
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
        }
    }
    let draft = fabric.draft();
    let crossings = [draft.ends() as u32, draft.picks() as u32];
    let mut matrix = Vec::with_capacity(draft.ends() * draft.picks());
    for pick in (0..draft.picks()).rev() {
        matrix.extend((0..draft.ends()).map(|end| if draft.up(pick, end) { 255 } else { 0 }));
    }
    let of = |file, meaning: String, color, bytes| Texture { file, meaning, size: [w, h], color, bytes };
    let (l8, l16, rgb16) = (ExtendedColorType::L8, ExtendedColorType::L16, ExtendedColorType::Rgb16);
    vec![
        Texture {
            file: "draft.png",
            meaning: "a pixel a crossing, seen from the face: 255 warp on top, 0 weft".into(),
            size: crossings,
            color: l8,
            bytes: matrix,
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
    ]
}

fn about(spec: &FabricSpec, fabric: &Fabric, size: [u32; 2], back: bool, textures: &[Texture]) -> serde_json::Value {
    let yarns: serde_json::Map<String, serde_json::Value> = Family::EACH
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
        .map(|t| serde_json::json!({ "file": t.file, "pixels": t.size, "meaning": t.meaning }))
        .collect();
    serde_json::json!({
        "name": spec.name, "program_version": env!("CARGO_PKG_VERSION"), "side": if back { "back" } else { "face" },
        "ends": fabric.draft().ends(), "picks": fabric.draft().picks(), "warp_on_top": fabric.draft().warp_share(),
        "repeat_um": fabric.repeat_um(), "pixels": size, "half_thickness_um": fabric.half_thickness_um(),
        "rows": "the first row of every image is that of the largest y", "memory_bytes": fabric.memory_bytes(),
        "yarns": yarns, "textures": list,
    })
}

/// The yarns in words, one line a family.
fn particulars(fabric: &Fabric) -> Vec<String> {
    let draft = fabric.draft();
    let mut lines = vec![format!(
        "{} ends x {} picks, warp on top at {} % of the crossings",
        draft.ends(),
        draft.picks(),
        number((1000.0 * draft.warp_share()).round() / 10.0)
    )];
    for family in Family::EACH {
        let s = fabric.shape(family);
        let pitch =
            s.ply_pitch_um.filter(|_| s.plies > 1).map(|p| format!(", pitch {} um {:?}", number(p), s.handedness));
        lines.push(format!(
            "{}: {:.1} to the cm, {:.0} um wide, {} {} of radius {} um{}, crimp {}",
            family.name(),
            1e4 / s.spacing_um,
            s.width_um(),
            s.plies,
            if s.plies == 1 { "ply" } else { "plies" },
            number(s.ply_radius_um),
            pitch.unwrap_or_default(),
            number(s.crimp)
        ));
    }
    lines
}

/// Says what came out.
fn tell(
    cli: &Cli,
    folder: &Path,
    shading: &FabricBsdf,
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
