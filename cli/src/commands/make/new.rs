//! `plywave new`: writes a shipped spec with all files that it needs, or lists the specs.

use crate::args::{Cli, NewArgs};
use crate::failure::{Failure, Outcome};
use crate::{output, report};
use plywave_pipeline::{ShippedKind, ShippedSpec};
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(cli: &Cli, args: &NewArgs) -> Outcome {
    let Some(name) = &args.name else { return list(cli) };
    let spec = chosen(name, args.yarn)?;
    let folder = args.output.clone().unwrap_or_default();
    let files = spec.files().map_err(crate::commands::runs::pipeline_failure)?;
    let mut missing = Vec::new();
    for (path, bytes) in files {
        let path = folder.join(path);
        if !is_there(&path, bytes)? {
            missing.push((path, bytes));
        }
    }
    write(&missing)?;
    tell(cli, &spec, &folder, &missing)
}

/// The spec with a name; if a cloth and a yarn share the name, the cloth, or with `is_yarn` the yarn.
fn chosen(name: &str, is_yarn: bool) -> Outcome<ShippedSpec> {
    let all = ShippedSpec::all();
    let is_wanted = |spec: &&ShippedSpec| spec.name() == name && !(is_yarn && spec.kind == ShippedKind::Cloth);
    let mut found: Vec<ShippedSpec> = all.iter().filter(is_wanted).copied().collect();
    found.sort_by_key(|spec| spec.kind != ShippedKind::Cloth);
    found.first().copied().ok_or_else(|| {
        let what = if is_yarn { "yarn spec" } else { "cloth or yarn spec" };
        let hint = format!("no {what} that ships has this name; `plywave new` lists them");
        Failure::input("command line", "NAME", crate::failure::one_line(name), &hint)
    })
}

/// Whether a file has these contents already; refuses a file with other contents.
fn is_there(path: &Path, bytes: &[u8]) -> Outcome<bool> {
    use plywave::Error;
    match plywave::io::read_file(path, bytes.len() as u64) {
        Ok(there) if there == bytes => Ok(true),
        Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(Error::Io { source, .. }) if source.kind() != std::io::ErrorKind::InvalidInput => {
            Err(Failure::input(path.display(), "-o", source, "choose another folder with -o"))
        }
        _ => Err(Failure::input(
            path.display(),
            "-o",
            "a file with other contents",
            "choose another folder with -o, or move the file away",
        )),
    }
}

/// Writes all files or none.
fn write(files: &[(PathBuf, &[u8])]) -> Outcome {
    for (k, (path, bytes)) in files.iter().enumerate() {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let made = match folder.map(std::fs::create_dir_all) {
            Some(Err(error)) => Err(Failure::input(path.display(), "-o", error, "choose a place that can be written")),
            _ => output::write_whole(path, bytes),
        };
        if made.is_err() {
            // A file that cannot be removed is ignored: the reported error matters more.
            files[..k].iter().for_each(|(path, _)| drop(std::fs::remove_file(path)));
            return made;
        }
    }
    Ok(())
}

fn tell(cli: &Cli, spec: &ShippedSpec, folder: &Path, written: &[(PathBuf, &[u8])]) -> Outcome {
    let path = folder.join(spec.file());
    if cli.json {
        let files: Vec<String> = written.iter().map(|(path, _)| path.display().to_string()).collect();
        return output::print_json(&serde_json::json!({
            "name": spec.name(), "kind": kind_word(spec.kind), "spec": path.display().to_string(), "written": files,
        }));
    }
    if cli.quiet {
        return Ok(());
    }
    output::print(|out| {
        if written.is_empty() {
            writeln!(out, "{}: is there already, with all that it needs", path.display())?;
        }
        for (path, bytes) in written {
            writeln!(out, "{}: {}", path.display(), report::bytes(bytes.len() as u64))?;
        }
        let next = match spec.kind {
            ShippedKind::Cloth => "see its measures with: plywave weave",
            ShippedKind::Yarn => "make its model with: plywave build",
            ShippedKind::Family => "make its family with: plywave family",
        };
        writeln!(out, "{next} {}", path.display())
    })
}

fn kind_word(kind: ShippedKind) -> &'static str {
    match kind {
        ShippedKind::Cloth => "cloth",
        ShippedKind::Yarn => "yarn",
        ShippedKind::Family => "family",
    }
}

fn list(cli: &Cli) -> Outcome {
    let all = ShippedSpec::all();
    if cli.json {
        let specs: Vec<serde_json::Value> = all
            .iter()
            .map(|s| serde_json::json!({ "name": s.name(), "kind": kind_word(s.kind), "about": s.about() }))
            .collect();
        return output::print_json(&specs);
    }
    let groups = [
        (ShippedKind::Cloth, "cloths"),
        (ShippedKind::Yarn, "yarns (with --yarn where a cloth has the same name)"),
        (ShippedKind::Family, "families of yarns"),
    ];
    output::print(|out| {
        for (kind, title) in groups {
            writeln!(out, "{title}")?;
            for spec in all.iter().filter(|spec| spec.kind == kind) {
                writeln!(out, "  {:<16} {}", spec.name(), spec.about())?;
            }
        }
        writeln!(out, "write one with all that it needs with: plywave new NAME -o FOLDER")
    })
}
