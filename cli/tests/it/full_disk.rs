//! A full disk: what a command writes is whole or absent, all of its files or none, it says so in one line,
//! and what was there before stays. The disk is a file system in memory of some KiB, in a mount namespace of
//! its own that ends with the command; where the system allows no such namespace, the tests print why and
//! end.
#![cfg(target_os = "linux")]

use crate::common::{ANY_FIT, folder, succeed, text, write_cloth};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

/// Mounts a disk of `$1` KiB, puts the files of `before` on it, runs the rest of the arguments there, and
/// copies what is then on the disk to `after`. With RESUME, the disk then becomes large and the command runs
/// again.
const SCRIPT: &str = r#"
mount -t tmpfs -o "size=$1k,mode=0777" none disk || exit 99
shift
if [ -d before ]; then cp -R before/. disk || exit 97; fi
cd disk
"$@" >../out 2>../err
echo $? >../code
cp -a . ../after
if [ -n "$RESUME" ]; then
    mount -o remount,size=32m . || exit 98
    "$@" --resume >../out2 2>../err2
    echo $? >../code2
    cp -a . ../resumed
fi
"#;

/// A scene of strands.
const STRANDS: &str = r#"
name = "few"
sky = 0.5
[strands]
make = { kind = "fur", count = 500, size_mm = 10.0, length_mm = 5.0 }
radius_um = 60.0
[fiber]
model = { kind = "dielectric" }
[camera]
from_mm = [0.0, -30.0, 20.0]
to_mm = [0.0, 0.0, 1.0]
fov_deg = 25.0
"#;

/// How a namespace with mounts of its own is to be had here, if at all.
fn namespace() -> Option<&'static [&'static str]> {
    static FOUND: OnceLock<Option<&'static [&'static str]>> = OnceLock::new();
    *FOUND.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let mut reasons = Vec::new();
        for flags in [&["-rm"][..], &["-m"]] {
            let output = Command::new("unshare")
                .args(flags)
                .args(["mount", "-t", "tmpfs", "-o", "size=16k", "none"])
                .arg(folder.path())
                .output();
            match output {
                Ok(output) if output.status.success() => return Some(flags),
                Ok(output) => reasons.push(format!("unshare {flags:?}: {}", text(&output.stderr).trim())),
                Err(error) => reasons.push(format!("unshare: {error}")),
            }
        }
        eprintln!("skipped: no file system can be mounted here ({})", reasons.join("; "));
        None
    })
}

/// A run on a full disk: exit code, what it printed as an error, files then on the disk by their path.
struct Ended {
    code: i32,
    err: String,
    files: BTreeMap<String, Vec<u8>>,
}

/// Files by their path; of a folder without files, the path and a slash.
fn files(folder: &Path, prefix: &str, found: &mut BTreeMap<String, Vec<u8>>) {
    let entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(Result::unwrap).collect();
    if entries.is_empty() && !prefix.is_empty() {
        found.insert(prefix.into(), Vec::new());
    }
    for entry in entries {
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            files(&entry.path(), &format!("{name}/"), found);
        } else {
            found.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
}

/// Runs a command on a disk of this size [KiB] that holds `before`; again with `--resume` on a large one, if
/// asked. Inputs are in the disk's parent folder.
fn on_disk(dir: &Path, kib: usize, before: &[(&str, &[u8])], args: &[&str], resume: bool) -> Vec<Ended> {
    for name in ["disk", "before", "after", "resumed"] {
        let _ = std::fs::remove_dir_all(dir.join(name));
    }
    std::fs::create_dir_all(dir.join("disk")).unwrap();
    if !before.is_empty() {
        std::fs::create_dir_all(dir.join("before")).unwrap();
        for (name, bytes) in before {
            let path = dir.join("before").join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
    }
    let output = Command::new("unshare")
        .args(namespace().expect("asked for before"))
        .args(["sh", "-c", SCRIPT, "sh", &kib.to_string(), env!("CARGO_BIN_EXE_plywave")])
        .args(args)
        .current_dir(dir)
        .env("RESUME", if resume { "1" } else { "" })
        .output()
        .unwrap();
    assert!(output.status.success(), "{kib} KiB: {} {}", output.status, text(&output.stderr));
    let read = |name: &str| std::fs::read_to_string(dir.join(name)).unwrap();
    let ended = |code: &str, err: &str, after: &str| {
        let mut found = BTreeMap::new();
        files(&dir.join(after), "", &mut found);
        Ended { code: read(code).trim().parse().unwrap(), err: read(err), files: found }
    };
    let mut all = vec![ended("code", "err", "after")];
    if resume {
        all.push(ended("code2", "err2", "resumed"));
    }
    all
}

/// A command on disks of several sizes: either all outputs are those of a large disk and the code is 0, or
/// the error is one line, and all outputs are what was there before: text of this test, or nothing. Returns
/// how many disks were too small.
fn whole_or_absent(dir: &Path, args: &[&str], outputs: &[&str], sizes: &[usize]) -> usize {
    let old: Vec<(&str, &[u8])> = outputs.iter().map(|name| (*name, &b"what was there before"[..])).collect();
    all_or_nothing(dir, args, outputs, &old, sizes)
}

/// As [`whole_or_absent`], with these old files.
fn all_or_nothing(dir: &Path, args: &[&str], outputs: &[&str], old: &[(&str, &[u8])], sizes: &[usize]) -> usize {
    let whole = on_disk(dir, 32 << 10, &[], args, false).remove(0);
    assert_eq!(whole.code, 0, "{args:?}: {}", whole.err);
    let mut full = 0;
    for &kib in sizes {
        for before in [&[][..], old] {
            // Beside the old files, in whole pages.
            let pages: usize = before.iter().map(|(_, bytes)| bytes.len().div_ceil(4096)).sum();
            let ended = on_disk(dir, kib + 4 * pages, before, args, false).remove(0);
            let case = format!("{args:?}, {kib} KiB, {} old files: {}", before.len(), ended.err);
            println!("{case}");
            for name in outputs {
                let got = ended.files.get(*name).map(Vec::as_slice);
                let was = before.iter().find(|(old, _)| old == name).map(|(_, bytes)| *bytes);
                let right = if ended.code == 0 { Some(whole.files[*name].as_slice()) } else { was };
                assert!(got == right, "{name}: {case}");
            }
            let rest: Vec<&String> = ended.files.keys().filter(|name| !outputs.contains(&name.as_str())).collect();
            if ended.code == 0 {
                assert!(rest.is_empty(), "{rest:?}: {case}");
                continue;
            }
            full += 1;
            assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{case}");
            assert!(ended.err.starts_with("error: ") && ended.err.contains("No space left"), "{case}");
            assert!(["make room", "choose a place"].iter().any(|hint| ended.err.contains(hint)), "{case}");
            // Resumable state may stay; a half-written file may not.
            assert!(rest.iter().all(|name| name.contains(".parts/") || name.ends_with(".sums")), "{rest:?}: {case}");
            assert!(!ended.files.keys().any(|name| name.ends_with(".tmp")), "{case}");
        }
    }
    full
}

#[test]
#[ignore = "slow: 60 s: outputs on a full disk are whole or absent"]
fn outputs_on_a_full_disk_are_whole_or_absent() {
    if namespace().is_none() {
        return;
    }
    let folder = folder();
    let dir = folder.path();
    let small = ["--preset", "preview", "--quiet", "--paths", "3000"];
    succeed(dir, &[&["simulate", "tiny.toml", "-o", "t.pwt"][..], &small].concat());
    succeed(dir, &[&["build", "tiny.toml", "-o", "m.pwm"][..], ANY_FIT, &small].concat());

    let model = std::fs::metadata(dir.join("m.pwm")).unwrap().len() as usize / 1024;
    let fits = ["fit", "../t.pwt", "-o", "m.pwm", "--quiet"];
    assert!(whole_or_absent(dir, &fits, &["m.pwm"], &[4, model / 2, 4 * model + 64]) >= 4);

    write_cloth(dir);
    let small = ["-o", "p.png", "--width", "64", "--height", "48", "--samples", "1", "--quiet"];
    let of_cloth = [&["render", "../cloth.pwc"][..], &small].concat();
    assert!(whole_or_absent(dir, &of_cloth, &["p.png", "p.exr"], &[12]) == 2);
    // Pictures of strands are written by the same code.
    std::fs::write(dir.join("few.toml"), STRANDS).unwrap();
    let render = [&["render", "../few.toml"][..], &small].concat();
    assert!(whole_or_absent(dir, &render, &["p.png", "p.exr"], &[4, 12, 40, 100, 160, 1024]) >= 4);

    let plot = ["plot", "../m.pwm", "-o", "f.svg", "--quiet"];
    assert!(whole_or_absent(dir, &plot, &["f.svg"], &[4, 20, 4096]) >= 2);
    let help = ["weave", "../cloth.toml", "-o", "curves.toml", "--quiet"];
    let ended = on_disk(dir, 8, &[], &help, false).remove(0);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
}

/// Files that belong together: on a disk that has room for some of them, none is new.
#[test]
#[ignore = "slow: 90 s: sets of files on a full disk"]
fn sets_of_files_on_a_full_disk_are_whole_or_nothing_changes() {
    if namespace().is_none() {
        return;
    }
    let folder = folder();
    let dir = folder.path();
    write_cloth(dir);
    let usd = ["export", "../cloth.pwc", "--to", "usd", "-o", "o.usda", "--pixels", "64", "--quiet"];
    let outputs = [
        "o.usda",
        "o_usd.mtlx",
        "o_usd_maps/base_color.png",
        "o_usd_maps/transmission_color.png",
        "o_usd_maps/roughness.png",
        "o_usd_maps/anisotropy.png",
        "o_usd_maps/tangent.png",
        "o_usd_maps/normal.png",
        "o_usd_maps/opacity.png",
    ];
    // The set of an earlier export, in other colors.
    let dark = on_disk(dir, 32 << 10, &[], &[&usd[..], &["--sigma", "0.02"]].concat(), false).remove(0);
    assert_eq!(dark.code, 0, "{}", dark.err);
    let old: Vec<(&str, &[u8])> = dark.files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    assert_eq!(old.len(), outputs.len(), "{:?}", dark.files.keys());
    let pages: usize = old.iter().map(|(_, bytes)| bytes.len().div_ceil(4096)).sum();
    assert!(all_or_nothing(dir, &usd, &outputs, &old, &[4 * pages / 2, 4 * pages + 64]) == 2);

    let small = ["--preset", "preview", "--quiet", "--paths", "3000"];
    succeed(dir, &[&["build", "tiny.toml", "-o", "m.pwm", "--keep-table"][..], ANY_FIT, &small].concat());
    let [model, table] =
        ["m.pwm", "m.pwt"].map(|name| std::fs::metadata(dir.join(name)).unwrap().len() as usize / 1024);
    let render =
        ["render", "../cloth.pwc", "-o", "p.png", "--width", "64", "--height", "48", "--samples", "1", "--quiet"];
    // Room for the EXR and not for the PNG, and the reverse.
    let picture = on_disk(dir, 32 << 10, &[], &render, false).remove(0);
    let kib = |name: &str| picture.files[name].len().div_ceil(4096) * 4;
    assert!(whole_or_absent(dir, &render, &["p.png", "p.exr"], &[kib("p.exr"), kib("p.png"), 4096]) == 4);
    let build = [&["build", "../tiny.toml", "-o", "m.pwm", "--keep-table"][..], ANY_FIT, &small].concat();
    // From less than the shards need to room for all, by about the size of the two files.
    let sizes: Vec<usize> = (1..12).map(|k| k * (model + table)).chain([32 << 10]).collect();
    let full = whole_or_absent(dir, &build, &["m.pwm", "m.pwt"], &sizes);
    assert!(full >= 2 && full < 2 * sizes.len(), "{full}");
}

/// A run whose shards or table do not fit: what was finished is resumed once there is room, to the bits of an
/// undisturbed run.
#[test]
#[ignore = "slow: 10 s: runs on a full disk go on when there is room"]
fn runs_on_a_full_disk_go_on_when_there_is_room() {
    if namespace().is_none() {
        return;
    }
    let folder = folder();
    let dir = folder.path();
    let command = ["simulate", "../tiny.toml", "--preset", "preview", "--quiet", "-o", "t.pwt"];
    let whole = on_disk(dir, 32 << 10, &[], &command, false).remove(0);
    assert_eq!(whole.code, 0, "{}", whole.err);
    let mut kept = 0;
    for kib in [4, 100, 150, 300, 400] {
        let [full, resumed] = &on_disk(dir, kib, &[], &command, true)[..] else { panic!("two runs") };
        println!("{kib} KiB: {} {:?} {}", full.code, full.files.keys(), full.err);
        assert_eq!((full.code, full.err.lines().count()), (2, 1), "{kib} KiB: {}", full.err);
        assert!(full.err.contains("No space left"), "{kib} KiB: {}", full.err);
        assert!(!full.files.contains_key("t.pwt") && !full.files.keys().any(|n| n.ends_with(".tmp")), "{kib} KiB");
        kept += full.files.keys().filter(|name| name.contains("shard")).count();
        assert_eq!(resumed.code, 0, "{kib} KiB: {}", resumed.err);
        assert!(resumed.files == whole.files, "{kib} KiB: {:?}", resumed.files.keys());
    }
    assert!(kept > 0, "no disk was large enough for a shard");
}
