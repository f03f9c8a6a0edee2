//! `plywave view`: serves the viewer and a model to a browser on this machine.

use crate::args::{Cli, ViewArgs};
use crate::commands::look::view_server::{Files, serve};
use crate::commands::make::cloth_file;
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use plywave::Document;
use plywave::PlyModel;
use std::borrow::Cow;
use std::io::Read;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;

/// Files of the site that is compiled in: addresses and contents.
static SITE: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/site.rs"));
/// Largest total size of a site's files [bytes], and their largest number.
const MAX_SITE: u64 = 256 << 20;
const MAX_FILES: usize = 4096;
/// Hint for a program that was built without the site.
const WITHOUT_SITE: &str = "view: this program was built without the viewer; in the sources, make it by \
    `(cd viewer && npm ci && npm run wasm && npm run build)` and give --site viewer/dist, or build the program again \
    with PLYWAVE_VIEWER=$PWD/viewer/dist";
/// List of the models in the site.
const INDEX: &str = "models/index.json";

/// Runs the command.
pub fn run(cli: &Cli, args: &ViewArgs) -> Outcome {
    let mut files = site(args)?;
    if let Some(file) = &args.file {
        let (name, bytes) = model(cli, file)?;
        files.insert(format!("models/{name}"), Cow::Owned(bytes));
        // The page shows the first model of the list.
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

/// The site: the compiled-in one, or that of a folder.
fn site(args: &ViewArgs) -> Outcome<Files> {
    let mut files: Files = SITE.iter().map(|(name, bytes)| ((*name).to_string(), Cow::Borrowed(*bytes))).collect();
    if let Some(folder) = &args.site {
        files.clear();
        let mut remaining = MAX_SITE;
        read(folder, "", &mut files, &mut remaining)
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

/// Reads the files of a folder and its subfolders, up to `remaining` [bytes]; the error is a hint.
fn read(folder: &Path, prefix: &str, files: &mut Files, remaining: &mut u64) -> Result<(), String> {
    let failed = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    for entry in std::fs::read_dir(folder).map_err(|e| failed(folder, e))? {
        let entry = entry.map_err(|e| failed(folder, e))?;
        let path = entry.path();
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        match entry.file_type().map_err(|e| failed(&path, e))? {
            kind if kind.is_dir() => read(&path, &format!("{name}/"), files, remaining)?,
            kind if kind.is_file() => {
                let bytes = read_up_to(&path, *remaining).map_err(|e| failed(&path, e))?;
                let (Some(bytes), true) = (bytes, files.len() < MAX_FILES) else {
                    let max = MAX_SITE >> 20;
                    let own = "give the folder that `npm run build` makes, viewer/dist";
                    return Err(format!("has more than {max} MiB or {MAX_FILES} files, with {name}; {own}"));
                };
                *remaining -= bytes.len() as u64;
                files.insert(name, Cow::Owned(bytes));
            }
            _ => (),
        }
    }
    Ok(())
}

/// The bytes of a file; `None` for a file with more than `max` bytes, of which no more is read.
fn read_up_to(path: &Path, max: u64) -> std::io::Result<Option<Vec<u8>>> {
    let file = std::fs::File::open(path)?;
    if file.metadata()?.len() > max {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    // A file that grows during the read is truncated at the limit.
    file.take(max + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= max).then_some(bytes))
}

/// Name and bytes of the model to show; a cloth spec is replaced by its cloth.
fn model(cli: &Cli, file: &Path) -> Outcome<(String, Vec<u8>)> {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    match kinds::kind_of(file) {
        Some(InputKind::Model) => {
            let (_, bytes) = cli.library()?.read(file)?;
            PlyModel::from_bytes(&bytes, &file.display().to_string())?;
            Ok((format!("{stem}.pwm"), bytes))
        }
        _ => Ok((format!("{stem}.pwc"), cloth_file::precomputed(cli, file)?.data.to_bytes()?)),
    }
}
