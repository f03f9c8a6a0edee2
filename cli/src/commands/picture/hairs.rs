//! `plywave hairs`: writes the hairs of a cloth as curves, on a flat sheet or on a mesh.

use crate::args::{Cli, HairsArgs};
use crate::commands::make::cloth_file;
use crate::commands::runs;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::progress::{Bar, STOP};
use crate::rendering::{failed, mesh_notes};
use crate::threads::on_threads;
use crate::{output, progress, report};
use plywave::Document;
use plywave::cloth::geometry::Uneven;
use plywave::cloth::{ClothCurves, ClothData};
use plywave::spec::YarnSpec;
use plywave_render::{Mesh, MeshNotes, UvPlaces};
use plywave_sim::cloth::{Hair, HairKind, HairRoots};
use plywave_textile::ClothSpec;
use rayon::prelude::*;
use std::fmt::Write;
use std::path::Path;
use std::sync::atomic::Ordering;

/// Largest number of hairs that are written: about 4 GB of text.
const MAX_HAIRS: f64 = 5e6;
/// Number of pieces of yarn between two writes.
const PIECES: usize = 4096;
/// Default side of a sheet [mm].
const SIDE_MM: f64 = 10.0;
/// Largest displacement of a yarn by unevenness, relative to the cell: less than the distance between two
/// yarns.
const MOVED_CELLS: f64 = 1.0;

/// Curves, spec and ply specs of a cloth.
struct Grown {
    curves: ClothCurves,
    spec: ClothSpec,
    plies: Vec<String>,
}

/// Runs the command.
pub fn run(cli: &Cli, args: &HairsArgs) -> Outcome {
    let path = args.output.clone().unwrap_or_else(|| output::default_output(&args.cloth, "txt"));
    let inputs: Vec<&Path> = std::iter::once(args.cloth.as_path()).chain(args.mesh.as_deref()).collect();
    output::check_writable(&path, &inputs)?;
    let size_mm = match args.size_mm[..] {
        [w, h] => [w, h],
        [w] => [w; 2],
        _ => [SIDE_MM; 2],
    };
    if let Some(side) = size_mm.into_iter().find(|side| !(1e-3..=1e5).contains(side)) {
        return Err(Failure::input("command line", "--size-mm", side, "must be from 0.001 to 100000"));
    }
    if let Some(um) = args.um_per_uv.filter(|um| !(1.0..=1e9).contains(um)) {
        return Err(Failure::input("command line", "--um-per-uv", um, "must be from 1 to 1000000000"));
    }
    let mesh = args.mesh.as_deref().map(|file| load(file, args.um_per_uv.unwrap_or(1e5))).transpose()?;
    let Grown { curves, spec, plies } = cloth(cli, args)?;
    let file = args.cloth.display().to_string();
    let kinds = plies.iter().zip(spec.hairs()).map(|(text, hairs)| {
        let ply = YarnSpec::parse(text, &format!("{file} (spec of a ply)"))?;
        Ok(hairs.map(|hairs| HairKind::new(hairs, &ply)))
    });
    let kinds = kinds.collect::<plywave::Result<Vec<_>>>()?;
    let refuse = |e| runs::failure(e, &args.cloth);
    let roots = HairRoots::new(&curves, kinds).map_err(refuse)?;
    let lattice = curves.lattice(&file)?;
    let uneven = Uneven::new(&spec.looks(), &curves, &lattice)?;
    let places = mesh.as_ref().map(|(mesh, _)| UvPlaces::new(mesh));
    let (area_um2, bounds) = match &places {
        Some(places) => (places.cloth_um2(), places.bounds_um()),
        None => (1e6 * size_mm[0] * size_mm[1], [[0.0; 2], size_mm.map(|mm| 1e3 * mm)]),
    };
    let mean = roots.mean_count(area_um2);
    if mean > MAX_HAIRS {
        let (key, value) = match &args.mesh {
            Some(mesh) => ("--um-per-uv", mesh.display().to_string()),
            None => ("--size-mm", format!("{} {}", size_mm[0], size_mm[1])),
        };
        let hint =
            format!("this cloth has some {} hairs; give a piece of {MAX_HAIRS:.0e} or fewer", report::count(mean));
        return Err(Failure::input("command line", key, value, &hint));
    }
    // Unevenness displaces what appears at a position.
    let margin = match uneven.is_even() {
        true => [0.0; 2],
        false => [0, 1].map(|k| MOVED_CELLS * lattice.cell_um.iter().map(|v| v[k].abs()).sum::<f64>()),
    };
    let wide = |[low, high]: [[f64; 2]; 2]| {
        [[0, 1].map(|k: usize| low[k] - margin[k]), [0, 1].map(|k: usize| high[k] + margin[k])]
    };
    let mut pieces = roots.pieces(wide(bounds));
    if let Some(places) = &places {
        pieces.retain(|(yarn, cell)| roots.bounds_um(*yarn, *cell).is_some_and(|of| places.covers(wide(of))));
    }
    let at = match (&places, &mesh) {
        (Some(places), Some((_, notes))) => Where::Mesh(places, *notes),
        _ => Where::Sheet(size_mm),
    };
    let mut tally = Tally::default();
    let mut wrong = Ok(());
    progress::install_stop();
    let bar = Bar::new("hairs", "pieces", cli.quiet);
    bar.begin("hairs", pieces.len() as u64);
    let written = progress::stoppable(|| {
        output::write_whole_by(&path, |out| {
            for pieces in pieces.chunks(PIECES) {
                if STOP.load(Ordering::Relaxed) {
                    wrong = Err(progress::stopped(""));
                    return Err(std::io::Error::other("stopped"));
                }
                let made = on_threads(cli, || {
                    let grown = pieces.par_iter().map(|(yarn, cell)| {
                        let (mut text, mut tally) = (String::new(), Tally::default());
                        for hair in roots.grow(*yarn, *cell, args.seed) {
                            at.write(&shown(hair, &uneven), &mut text, &mut tally);
                        }
                        (text, tally)
                    });
                    grown.collect::<Vec<_>>()
                });
                match made {
                    Ok(made) => {
                        bar.advance(made.len() as u64);
                        for (text, own) in made {
                            out.write_all(text.as_bytes())?;
                            tally.add(&own);
                        }
                    }
                    Err(failure) => {
                        wrong = Err(failure);
                        return Err(std::io::Error::other("no threads"));
                    }
                }
            }
            Ok(())
        })
    });
    bar.finish();
    wrong?;
    written?;
    tell(cli, args, &path, &spec.name, &at, &tally)
}

/// The curves and specs of a cloth file or a cloth spec.
fn cloth(cli: &Cli, args: &HairsArgs) -> Outcome<Grown> {
    if kinds::kind_of(&args.cloth) == Some(InputKind::ClothFile) {
        let data = ClothData::load(&args.cloth)?;
        let spec = ClothSpec::parse(&data.spec_text, &args.cloth.display().to_string())?;
        check_hairs(&args.cloth, &spec)?;
        let plies = data.models.iter().map(|model| model.data().spec_text.clone()).collect();
        return Ok(Grown { curves: data.curves, spec, plies });
    }
    let recipe = cloth_file::recipe(&args.cloth)?;
    check_hairs(&args.cloth, &recipe.spec)?;
    let plies = recipe.plies(&cli.library()?).map_err(runs::pipeline_failure)?.spec_texts();
    let curves = cloth_file::curves(cli, &recipe)?.curves;
    Ok(Grown { curves, spec: recipe.spec, plies })
}

/// Refuses a cloth without hairs.
fn check_hairs(file: &Path, spec: &ClothSpec) -> Outcome {
    if spec.hairs().iter().any(Option::is_some) {
        return Ok(());
    }
    let hint = "no yarn of this cloth has hairs; give its spec a table such as [warp.hairs]";
    Err(Failure::input(file.display(), "hairs", "(absent)", hint))
}

/// A mesh of largest extent 1.
fn load(file: &Path, um_per_uv: f64) -> Outcome<(Mesh, MeshNotes)> {
    Mesh::obj(file, um_per_uv as f32, 1.0).map_err(failed)
}

/// A hair, moved to where its root appears on the uneven cloth.
fn shown(mut hair: Hair, uneven: &Uneven) -> Hair {
    if !uneven.is_even() {
        let root = [hair.points_um[0][0], hair.points_um[0][1]];
        let point = uneven.point(root.map(|v| v as f32)).map(f64::from);
        for p in &mut hair.points_um {
            (0..2).for_each(|k| p[k] += point[k] - root[k]);
        }
    }
    hair
}

/// Statistics of the written hairs.
#[derive(Clone, Copy, Default)]
struct Tally {
    hairs: u64,
    loops: u64,
    cut: u64,
    points: u64,
    length_um: f64,
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.hairs += other.hairs;
        self.loops += other.loops;
        self.cut += other.cut;
        self.points += other.points;
        self.length_um += other.length_um;
    }
}

/// Surface on which the hairs grow.
enum Where<'a> {
    /// A flat sheet of this size [mm], in mm about the origin.
    Sheet([f64; 2]),
    /// A mesh of largest extent 1, in the units of its file.
    Mesh(&'a UvPlaces<'a>, MeshNotes),
}

impl Where<'_> {
    /// Writes the hair at every position of its root on the surface.
    fn write(&self, hair: &Hair, text: &mut String, tally: &mut Tally) {
        let root = hair.points_um[0];
        let mut curve = |place: &dyn Fn([f64; 3]) -> [f64; 3], per_um: f64| {
            tally.hairs += 1;
            tally.loops += u64::from(hair.is_loop);
            tally.cut += u64::from(hair.is_cut);
            tally.length_um += hair.length_um();
            let radius = (hair.radius_um * per_um) as f32;
            for p in spline(&hair.points_um) {
                let [x, y, z] = place(p).map(|v| v as f32);
                // Writing to a text cannot fail.
                let _ = writeln!(text, "{x} {y} {z} {radius}");
                tally.points += 1;
            }
            text.push('\n');
        };
        match self {
            Where::Sheet(size_mm) => {
                if (0..2).all(|k| (0.0..1e3 * size_mm[k]).contains(&root[k])) {
                    let place =
                        |p: [f64; 3]| [1e-3 * p[0] - 0.5 * size_mm[0], 1e-3 * p[1] - 0.5 * size_mm[1], 1e-3 * p[2]];
                    curve(&place, 1e-3);
                }
            }
            Where::Mesh(places, notes) => places.at([root[0], root[1]], |point, frame| {
                let per_um = 1.0 / (places.um_per_mm() * notes.mm_per_unit);
                let place = |p: [f64; 3]| {
                    let off = frame.world([p[0] - root[0], p[1] - root[1], p[2]].map(|v| v as f32));
                    let at = |k: usize| {
                        notes.middle[k] + f64::from(point[k]) / notes.mm_per_unit + f64::from(off[k]) * per_um
                    };
                    [at(0), at(1), at(2)]
                };
                curve(&place, per_um);
            }),
        }
    }

    /// The units of the file, in words.
    fn units(&self) -> String {
        match self {
            Where::Sheet([w, h]) => format!("mm; a sheet of {w} x {h} mm about the origin, z up"),
            Where::Mesh(..) => format!("those of the mesh, of which 1 is {} mm of cloth", report::number(self.mm())),
        }
    }

    /// Millimeters of cloth per unit of the file.
    fn mm(&self) -> f64 {
        match self {
            Where::Sheet(_) => 1.0,
            Where::Mesh(places, notes) => 1e-3 * places.um_per_mm() * notes.mm_per_unit,
        }
    }
}

/// Control points of a uniform cubic B-spline that begins and ends at the ends of the points.
fn spline(points: &[[f64; 3]]) -> impl Iterator<Item = [f64; 3]> + '_ {
    let beyond = |end: [f64; 3], next: [f64; 3]| std::array::from_fn(|k| 2.0 * end[k] - next[k]);
    let last = points.len() - 1;
    std::iter::once(beyond(points[0], points[1]))
        .chain(points.iter().copied())
        .chain(std::iter::once(beyond(points[last], points[last - 1])))
}

/// Reports the result.
fn tell(cli: &Cli, args: &HairsArgs, path: &Path, name: &str, at: &Where<'_>, tally: &Tally) -> Outcome {
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    let count = tally.hairs.max(1) as f64;
    let (mean_mm, loops, cut) = (1e-3 * tally.length_um / count, tally.loops as f64 / count, tally.cut as f64 / count);
    if cli.json {
        return output::print_json(&serde_json::json!({
            "cloth": name, "file": path.display().to_string(), "bytes": bytes, "hairs": tally.hairs,
            "points": tally.points, "mean_length_mm": mean_mm, "loops": loops, "cut": cut, "mm_per_unit": at.mm(),
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(out, "{}: {}", path.display(), report::bytes(bytes))?;
        writeln!(
            out,
            "  hairs        {} of {name}, {:.3} mm long in the mean, {:.1} % loops, {:.2} % cut by plies",
            tally.hairs,
            mean_mm,
            100.0 * loops,
            100.0 * cut
        )?;
        writeln!(out, "  points       {}, of cubic B-splines: x y z radius a line", tally.points)?;
        writeln!(out, "  units        {}", at.units())?;
        if let (Where::Mesh(_, notes), Some(file)) = (at, &args.mesh) {
            for note in mesh_notes(file, notes).iter().skip(1) {
                writeln!(out, "  note         {note}")?;
            }
        }
        Ok(())
    })
}
