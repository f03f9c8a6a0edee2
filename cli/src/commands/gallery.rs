//! `plywave gallery`: every picture of the gallery into a folder, with an index of what was rendered how.

use super::on_threads;
use crate::args::{Cli, GalleryArgs};
use crate::failure::{Failure, Outcome};
use crate::gallery::digest;
use crate::gallery::materials::Workshop;
use crate::gallery::pages::{Entry, Index, Shot, about, for_page, markdown, png, strip};
use crate::gallery::pictures::{self, Panel, Picture};
use crate::progress::{self, Bar, STOP};
use crate::rendering::failed;
use crate::{output, report};
use plywave::fabric::{FabricModel, FabricOptions, FabricSpec};
use plywave::io::FileKind;
use plywave_render::{Film, FilmView, RenderOptions, render};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The index, by which a folder is known as one of ours.
const INDEX: &str = "gallery.json";
/// Most scatterings of a path.
const DEPTH: u32 = 8;

/// Pixels a side of a panel of a picture that has so many, and samples a pixel. Pictures are 1024 pixels wide or more.
fn sizes(quick: bool, panels: usize) -> (u32, u32) {
    if quick {
        return (128, 16);
    }
    let side = match panels {
        1 => 1024,
        2 => 640,
        3 => 480,
        4 => 400,
        _ => 320,
    };
    (side, 48)
}

/// A panel with what it is rendered of.
struct Work {
    panel: Panel,
    file: PathBuf,
    shot: Shot,
}

impl Work {
    fn paths(&self) -> u64 {
        u64::from(self.shot.pixels).pow(2) * u64::from(self.shot.samples)
    }

    /// The finished film.
    fn render(&self, cli: &Cli, bar: &Bar) -> Outcome<Film> {
        let loaded = FabricSpec::load(&self.file)?;
        let Panel { setup, size_mm, options, .. } = self.panel;
        let far = super::render::covers_repeats(&loaded.fabric, &setup.camera(size_mm), self.shot.pixels)
            && !super::render::has_slits(&loaded.spec, &options);
        let fabric = FabricModel::new(loaded, &FabricOptions { far, ..options })?;
        let (scene, camera) = setup.scene(size_mm, None, None);
        let side = self.shot.pixels;
        let mut film = Film::new(side, side).map_err(failed)?;
        let options = RenderOptions { samples: self.shot.samples, depth: self.shot.depth, seed: self.shot.seed };
        let mut before = 0;
        let work = on_threads(cli, || {
            progress::stoppable(|| {
                render(&scene, &camera, &fabric, &mut film, &options, &STOP, &mut |film| {
                    bar.advance(u64::from(side).pow(2) * u64::from(film.samples() - before));
                    before = film.samples();
                    Ok(())
                })
            })
        })?;
        work.map_err(failed)?;
        Ok(film)
    }
}

/// The pictures asked for.
fn chosen(only: &[String]) -> Outcome<Vec<Picture>> {
    let mut all = pictures::all();
    for name in only {
        if !all.iter().any(|p| p.name == *name) {
            let names: Vec<&str> = all.iter().map(|p| p.name.as_str()).collect();
            return Err(Failure::input("command line", "--only", name, &format!("use some of {}", names.join(", "))));
        }
    }
    all.retain(|p| only.is_empty() || only.contains(&p.name));
    Ok(all)
}

/// The index of an earlier run; none where it cannot be read.
fn earlier(folder: &Path) -> Index {
    let read = std::fs::read(folder.join(INDEX)).ok();
    read.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

fn make_folder(path: &Path) -> Outcome {
    std::fs::create_dir_all(path)
        .map_err(|e| Failure::input(path.display(), "-o", e, "choose a place that can be written"))
}

/// Runs the command.
pub fn run(cli: &Cli, args: &GalleryArgs) -> Outcome {
    let pictures = chosen(&args.only)?;
    if !args.fabrics.is_dir() {
        let hint = "no such folder; name that of the fabric specs that ship";
        return Err(Failure::input("command line", "--fabrics", args.fabrics.display(), hint));
    }
    let folder = &args.output;
    // Specs and models of the gallery go into folders of its own, never over those that it reads.
    let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
    let written = [folder.clone(), folder.join("fabrics"), folder.join("models")];
    let read = [args.fabrics.clone(), args.fabrics.join("models")];
    if written.iter().any(|w| read.iter().any(|r| same(w, r))) {
        return Err(Failure::input(folder.display(), "-o", "a folder that --fabrics reads", "name another folder"));
    }
    output::check_folder(folder, INDEX, &[])?;
    let workshop = Workshop { cli, from: &args.fabrics, to: folder, quick: args.quick };
    pictures.iter().flat_map(|p| &p.panels).try_for_each(|panel| workshop.check(&panel.cloth))?;
    for part in ["", "fabrics", "fabrics/models", "page"] {
        make_folder(&folder.join(part))?;
    }
    let _held = output::hold(&folder.join(INDEX))?;
    let begun = Instant::now();
    let before = earlier(folder);
    let mut index = Index {
        program_version: env!("CARGO_PKG_VERSION").into(),
        quick: args.quick,
        // Pictures that are not asked for stay in the index.
        pictures: before.pictures.clone(),
    };
    let mut command = "plywave gallery".to_string();
    if args.quick {
        command += " --quick";
    }
    let write_index = |index: &Index| {
        output::write_whole_by(&folder.join(INDEX), |out| {
            serde_json::to_writer_pretty(&mut *out, index).map_err(std::io::Error::from)?;
            writeln!(out)
        })?;
        output::write_whole(&folder.join("gallery.md"), markdown(index, &command).as_bytes())
    };
    // From here on the folder is known as a gallery's, so that a stopped run can go on in it.
    write_index(&index)?;
    progress::install_stop();
    let mut works = Vec::new();
    for picture in &pictures {
        let (side, samples) = sizes(args.quick, picture.panels.len());
        let mut panels = Vec::new();
        for panel in &picture.panels {
            let file = workshop.cloth(&panel.cloth)?;
            let digest = digest_of(&file)?;
            let name = format!("fabrics/{}.toml", panel.cloth.name());
            let shot = Shot::new(panel, name, digest, side, samples, DEPTH);
            panels.push(Work { panel: panel.clone(), file, shot });
        }
        works.push((picture, panels));
    }
    let made = begun.elapsed();
    let total: u64 = works.iter().flat_map(|(_, panels)| panels).map(Work::paths).sum();
    let bar = Bar::new("render", "paths", cli.quiet);
    bar.begin("render", total);
    let (mut rendered, mut skipped) = (0, 0);
    for (picture, panels) in &works {
        let shots: Vec<Shot> = panels.iter().map(|w| w.shot.clone()).collect();
        let entry = Entry {
            name: picture.name.clone(),
            caption: picture.caption.clone(),
            file: format!("{}.png", picture.name),
            small: format!("page/{}.jpg", picture.name),
            panels: shots,
            seconds: 0.0,
        };
        let there = before.pictures.iter().find(|e| e.name == entry.name && e.panels == entry.panels);
        if let Some(there) =
            there.filter(|e| args.resume && folder.join(&e.file).is_file() && folder.join(&e.small).is_file())
        {
            skipped += 1;
            put(&mut index, Entry { caption: entry.caption, ..there.clone() });
            bar.advance(panels.iter().map(Work::paths).sum());
            continue;
        }
        let begun = Instant::now();
        let mut images = Vec::new();
        for work in panels {
            images.push(work.render(cli, &bar)?.image(FilmView::Light, work.shot.exposure));
        }
        let titles: Vec<&str> = entry.panels.iter().map(|s| s.title.as_str()).collect();
        let (file, small_file) = (folder.join(&entry.file), folder.join(&entry.small));
        let about = about(&entry);
        output::write_whole(&file, &png(&strip(&images, &titles), &about, &file)?)?;
        output::write_whole(&small_file, &for_page(&images, &titles, &small_file)?)?;
        put(&mut index, Entry { seconds: begun.elapsed().as_secs_f64(), ..entry });
        write_index(&index)?;
        rendered += 1;
    }
    let time = bar.finish();
    order(&mut index);
    write_index(&index)?;
    tell(cli, folder, (rendered, skipped), (made, time), &index)
}

/// Of a fabric spec and the models beside it.
fn digest_of(file: &Path) -> Outcome<String> {
    let loaded = FabricSpec::load(file)?;
    let read = |file: &Path| plywave::io::read_file(file, FileKind::Model.most_bytes());
    let mut bytes = read(file)?;
    for model in &loaded.model_paths {
        bytes.extend(digest(&read(model)?).bytes());
    }
    Ok(digest(&bytes))
}

/// Puts an entry in the place of that of its name.
fn put(index: &mut Index, entry: Entry) {
    match index.pictures.iter_mut().find(|e| e.name == entry.name) {
        Some(there) => *there = entry,
        None => index.pictures.push(entry),
    }
}

/// The gallery's own order; names it does not know any more are left out.
fn order(index: &mut Index) {
    let names: Vec<String> = pictures::all().into_iter().map(|p| p.name).collect();
    let place = |e: &Entry| names.iter().position(|n| *n == e.name);
    index.pictures.retain(|e| place(e).is_some());
    index.pictures.sort_by_key(|e| place(e));
}

fn tell(
    cli: &Cli,
    folder: &Path,
    (rendered, skipped): (usize, usize),
    (made, time): (Duration, Duration),
    index: &Index,
) -> Outcome {
    if cli.json {
        return output::print_json(&serde_json::json!({
            "folder": folder.display().to_string(), "rendered": rendered, "skipped": skipped,
            "materials_s": made.as_secs_f64(), "render_s": time.as_secs_f64(), "index": index,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        writeln!(
            out,
            "{}: {} rendered, {skipped} there already; gallery.md shows them",
            folder.display(),
            report::counted(rendered as u64, "picture", "pictures")
        )?;
        writeln!(out, "  time         {} for models, {} for pictures", report::duration(made), report::duration(time))
    })
}
