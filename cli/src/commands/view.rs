//! `plywave view`: serves the viewer and a model to a browser on this machine.

use super::cloth_file;
use super::view_server::{Files, serve};
use crate::args::{Cli, ViewArgs};
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, Kind};
use crate::output;
use plywave::PlyModel;
use std::borrow::Cow;
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;

/// Files of the site in the program: addresses and contents.
static SITE: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/site.rs"));
/// Largest site: all its files together [bytes], and their number.
const MAX_SITE: u64 = 256 << 20;
const MAX_FILES: usize = 4096;
/// What to do with a program that has no site in it.
const WITHOUT_SITE: &str = "view: this program was built without the viewer; in the sources, make it by \
    `(cd viewer && npm ci && npm run wasm && npm run build)` and give --site viewer/dist, or build the program again \
    with PLYWAVE_VIEWER=$PWD/viewer/dist";
/// List of the models that the site has.
const INDEX: &str = "models/index.json";

/// Runs the command.
pub fn run(cli: &Cli, args: &ViewArgs) -> Outcome {
    let mut files = site(args)?;
    if let Some(file) = &args.file {
        let (name, bytes) = model(cli, file)?;
        files.insert(format!("models/{name}"), Cow::Owned(bytes));
        // The page shows the first of the list.
        let mut names: Vec<String> =
            files.get(INDEX).and_then(|index| serde_json::from_slice(index).ok()).unwrap_or_default();
        names.retain(|other| *other != name);
        names.insert(0, name);
        let index = serde_json::to_vec(&names).map_err(|e| Failure::Input(format!("list of models: {e}")))?;
        files.insert(INDEX.into(), Cow::Owned(index));
    }
    let refused = |e: std::io::Error| Failure::input("command line", "--port", args.port, &format!("{e}; use another"));
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port)).map_err(refused)?;
    let port = listener.local_addr().map_err(refused)?.port();
    output::print(|out| {
        writeln!(out, "http://127.0.0.1:{port}/")?;
        out.flush()
    })?;
    if !cli.quiet {
        eprintln!("open this address in a browser; Ctrl-C ends");
    }
    serve(&listener, port, files)
}

/// The site, of the program or of a folder.
fn site(args: &ViewArgs) -> Outcome<Files> {
    let mut files: Files = SITE.iter().map(|(name, bytes)| ((*name).to_string(), Cow::Borrowed(*bytes))).collect();
    if let Some(folder) = &args.site {
        files.clear();
        let mut room = MAX_SITE;
        read(folder, "", &mut files, &mut room)
            .map_err(|hint| Failure::input("command line", "--site", folder.display(), &hint))?;
    }
    if files.contains_key("index.html") {
        return Ok(files);
    }
    Err(match &args.site {
        Some(folder) => Failure::input(
            "command line",
            "--site",
            folder.display(),
            "has no index.html; give the folder that `npm run build` makes, viewer/dist",
        ),
        None => Failure::Input(WITHOUT_SITE.into()),
    })
}

/// Reads the files of a folder and of those in it, as long as there is `room` [bytes]; the error is a hint.
fn read(folder: &Path, prefix: &str, files: &mut Files, room: &mut u64) -> Result<(), String> {
    let told = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    for entry in std::fs::read_dir(folder).map_err(|e| told(folder, e))? {
        let entry = entry.map_err(|e| told(folder, e))?;
        let path = entry.path();
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        match entry.file_type().map_err(|e| told(&path, e))? {
            kind if kind.is_dir() => read(&path, &format!("{name}/"), files, room)?,
            kind if kind.is_file() => {
                let bytes = read_up_to(&path, *room).map_err(|e| told(&path, e))?;
                let (Some(bytes), true) = (bytes, files.len() < MAX_FILES) else {
                    let most = MAX_SITE >> 20;
                    let own = "give the folder that `npm run build` makes, viewer/dist";
                    return Err(format!("has more than {most} MiB or {MAX_FILES} files, with {name}; {own}"));
                };
                *room -= bytes.len() as u64;
                files.insert(name, Cow::Owned(bytes));
            }
            _ => (),
        }
    }
    Ok(())
}

/// The bytes of a file; `None` of one with more than `most`, of which no more is read.
fn read_up_to(path: &Path, most: u64) -> std::io::Result<Option<Vec<u8>>> {
    let file = std::fs::File::open(path)?;
    if file.metadata()?.len() > most {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    // One that grows meanwhile is not read on.
    file.take(most + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= most).then_some(bytes))
}

/// Name and bytes of the file to show; a cloth spec becomes its cloth.
fn model(cli: &Cli, file: &Path) -> Outcome<(String, Vec<u8>)> {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    match kinds::kind_of(file) {
        Some(Kind::Model) => {
            let (_, bytes) = cli.library()?.read(file)?;
            PlyModel::from_bytes(&bytes, &file.display().to_string())?;
            Ok((format!("{stem}.pwm"), bytes))
        }
        _ => Ok((format!("{stem}.pwc"), cloth_file::ready(cli, file)?.data.to_bytes()?)),
    }
}
