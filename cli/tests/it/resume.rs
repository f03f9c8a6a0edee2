//! Results do not depend on the number of threads, on being killed and resumed, nor on being shared out; runs
//! with one output do not mix.
#![cfg(unix)]

use crate::common::{STRANDS, folder, names, plywave, run, succeed, text};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Enough work to be caught in the middle of.
const RUN: &[&str] = &[
    "build",
    "tiny.toml",
    "--preset",
    "preview",
    "--paths",
    "15000",
    "--quiet",
    "--max-error-refl",
    "9",
    "--max-error-high",
    "9",
];

fn bytes(folder: &Path, file: &str) -> Vec<u8> {
    std::fs::read(folder.join(file)).unwrap()
}

/// Starts a run that writes `output`, and waits until some of its shards are done.
fn start(folder: &Path, output: &str) -> Child {
    let mut child = plywave(folder, RUN)
        .args(["-o", output, "--keep-table", "--threads", "1"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let parts = folder.join(format!("{output}.parts"));
    let begun = Instant::now();
    while !parts.is_dir() || names(&parts).iter().filter(|n| n.contains("shard")).count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it could be stopped");
        assert!(begun.elapsed() < Duration::from_secs(60), "no shard within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

#[test]
#[ignore = "slow: 20 s: threads kills and interrupts do not change the result"]
fn threads_kills_and_interrupts_do_not_change_the_result() {
    let folder = folder();
    let dir = folder.path();
    succeed(dir, &[RUN, &["-o", "whole.pwm", "--keep-table", "--threads", "2"]].concat());
    let (table, model) = (bytes(dir, "whole.pwt"), bytes(dir, "whole.pwm"));

    // kill -9 in the middle: the shards stay, and nothing else.
    let mut child = start(dir, "killed.pwm");
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(names(dir), ["killed.pwm.parts", "tiny.toml", "whole.pwm", "whole.pwt"]);
    // Another seed does not take them up.
    let other = run(dir, &[RUN, &["-o", "killed.pwm", "--seed", "5", "--resume"]].concat());
    assert_eq!(other.status.code(), Some(2), "{}", text(&other.stderr));
    succeed(dir, &[RUN, &["-o", "killed.pwm", "--keep-table", "--threads", "1", "--resume"]].concat());
    assert_eq!((bytes(dir, "killed.pwt"), bytes(dir, "killed.pwm")), (table.clone(), model.clone()));
    assert!(!dir.join("killed.pwm.parts").exists());

    // Ctrl-C: exit code 130, one line that says how to go on, and it does go on from there.
    let child = start(dir, "stopped.pwm");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.contains("go on with: plywave build tiny.toml") && err.contains("--resume"), "{err}");
    assert!(!dir.join("stopped.pwm").exists() && !dir.join("stopped.pwt").exists());
    succeed(dir, &[RUN, &["-o", "stopped.pwm", "--keep-table", "--threads", "2", "--resume"]].concat());
    assert_eq!((bytes(dir, "stopped.pwt"), bytes(dir, "stopped.pwm")), (table, model));
}

/// SIGTERM is as good as Ctrl-C, and what it leaves is neither used nor deleted unasked.
#[test]
#[ignore = "slow: 20 s: finished shards are kept until somebody says"]
fn finished_shards_are_kept_until_somebody_says() {
    let folder = folder();
    let dir = folder.path();
    let child = start(dir, "a.pwm");
    // A second run of the same output while the first one is at it.
    let second = run(dir, &[RUN, &["-o", "a.pwm", "--seed", "2"]].concat());
    let err = text(&second.stderr);
    assert_eq!((second.status.code(), err.lines().count()), (Some(2), 1), "{err}");
    assert!(err.contains("a.pwm.parts") && err.contains("another run"), "{err}");
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let err = text(&output.stderr);
    assert_eq!((output.status.code(), err.lines().count()), (Some(130), 1), "{err}");
    assert!(err.contains("shards left; go on with: plywave build"), "{err}");

    let parts = dir.join("a.pwm.parts");
    let left = names(&parts);
    let again = run(dir, &[RUN, &["-o", "a.pwm"]].concat());
    let err = text(&again.stderr);
    assert_eq!((again.status.code(), err.lines().count()), (Some(2), 1), "{err}");
    assert!(err.contains("finished shards") && err.contains("--resume") && err.contains("--fresh"), "{err}");
    let other = text(&run(dir, &[RUN, &["-o", "a.pwm", "--seed", "2"]].concat()).stderr);
    assert!(other.contains("another run") && other.contains("--fresh"), "{other}");
    assert_eq!(names(&parts), left);

    // A damaged shard is run again with a word; what is not ours stays.
    let shard = left.iter().find(|n| n.starts_with("shard")).unwrap();
    let mut damaged = bytes(&parts, shard);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 4;
    std::fs::write(parts.join(shard), damaged).unwrap();
    std::fs::write(parts.join("diary.txt"), "mine").unwrap();
    let loud: Vec<&str> = RUN.iter().filter(|a| **a != "--quiet").copied().collect();
    let resumed = run(dir, &[&loud[..], &["-o", "a.pwm", "--keep-table", "--resume"]].concat());
    let err = text(&resumed.stderr);
    assert!(resumed.status.success() && err.contains(shard) && err.contains("checksum"), "{err}");
    assert_eq!(names(&parts), ["diary.txt"]);
    succeed(dir, &[RUN, &["-o", "b.pwm", "--keep-table"]].concat());
    assert_eq!((bytes(dir, "a.pwt"), bytes(dir, "a.pwm")), (bytes(dir, "b.pwt"), bytes(dir, "b.pwm")));
    // Started over with --fresh.
    let child = start(dir, "c.pwm");
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    child.wait_with_output().unwrap();
    succeed(dir, &[RUN, &["-o", "c.pwm", "--seed", "2", "--fresh"]].concat());
    assert!(!dir.join("c.pwm.parts").exists());
}

/// The share `k/n` of a run as a file.
fn share(dir: &Path, command: &[&str], (k, n): (usize, usize)) -> String {
    let (part, flag) = (format!("part{k}of{n}"), format!("{k}/{n}"));
    succeed(dir, &[command, &["--shards", &flag, "-o", &part, "--quiet"]].concat());
    part
}

/// Every kind of run, shared out and merged in another order: the bytes of one run.
#[test]
#[ignore = "slow: 5 s: shares make the whole"]
fn shares_make_the_whole() {
    let folder = folder();
    let dir = folder.path();
    let thin = "name = \"thin\"\n[fiber]\nshape = { kind = \"circle\", radius_um = 1.0 }\nsize_jitter = 0.1\neta = 1.5\nalpha_fiber = 0.2\n[ply]\nfibers = 3\nradius_um = 4.0\n[beam]\nw0_um = 2.0\n";
    std::fs::write(dir.join("thin.toml"), thin).unwrap();
    let scene = "lambda_um = [0.7, 0.5, 0.6]\ntheta_i_deg = [0, 20]\nphi_i_deg = [0]\nn_phi_out = 12\n[[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.5\n";
    std::fs::write(dir.join("scene.toml"), scene).unwrap();
    let runs: [&[&str]; 6] = [
        &["simulate", "tiny.toml", "--preset", "preview"],
        &["wave", "tabulate", "thin.toml", "--preset", "preview", "--lambdas", "2", "--thetas", "6"],
        &["wave", "tabulate", "thin.toml", "--preset", "preview", "--rays", "--thetas", "12", "--ray-count", "50"],
        &["wave", "speckle", "thin.toml", "--instances", "4", "--lambda", "0.6", "--w0", "30"],
        &["compare", "thin.toml", "--instances", "3", "--paths", "200", "--lambda", "0.5,0.7"],
        &["wave", "scatter", "scene.toml"],
    ];
    for command in runs {
        let whole = |name: &str| match command[1] {
            "thin.toml" => bytes(&dir.join(name), "report.json"),
            "scatter" => {
                // How long it took and the memory of the machine are told too.
                let mut report = crate::common::json(&text(&bytes(dir, name)));
                report["stats"]["seconds"] = 0.into();
                report["stats"]["peak_bytes"] = 0.into();
                report.to_string().into_bytes()
            }
            _ => bytes(dir, name),
        };
        succeed(dir, &[command, &["-o", "whole", "--quiet"]].concat());
        let mut parts: Vec<String> = (1..=3).map(|k| share(dir, command, (k, 3))).collect();
        parts.rotate_left(1);
        let names: Vec<&str> = parts.iter().map(String::as_str).collect();
        succeed(dir, &[&["merge"][..], &names, &["-o", "merged", "--quiet"]].concat());
        assert_eq!(whole("merged"), whole("whole"), "{command:?}");
        // What is missing, and parts of another run, in one line.
        crate::common::refused(dir, &["merge", names[0], names[1], "-o", "x"], &["shards", "are missing"]);
        crate::common::refused(dir, &["merge", names[0], names[0], "-o", "x"], &["twice"]);
        for name in ["whole", "merged"] {
            let path = dir.join(name);
            if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.unwrap();
        }
        parts.iter().for_each(|p| std::fs::rename(dir.join(p), dir.join(format!("old-{p}"))).unwrap());
    }
    let tiny = runs[0];
    let a = share(dir, tiny, (1, 2));
    let b = share(dir, &[tiny, &["--seed", "2"]].concat(), (2, 2));
    crate::common::refused(dir, &["merge", &a, &b, "-o", "x.pwt"], &["part2of2", "another job", "seed"]);
    crate::common::refused(dir, &["merge", &a, "tiny.toml", "-o", "x.pwt"], &["tiny.toml", "expected a part"]);
    let all = share(dir, tiny, (1, 1));
    crate::common::refused(dir, &["merge", &all, "-o", &all], &["-o", "an input"]);
    crate::common::refused(dir, &[tiny, &["--shards", "1/1000"]].concat(), &["--shards", "1000", "shards"]);
    crate::common::refused(dir, &[tiny, &["--shards", "3/2"]].concat(), &["--shards", "K/N"]);
    let plan = crate::common::json(&succeed(dir, &[tiny, &["--plan", "--json"]].concat()));
    assert_eq!((plan["kind"].as_str(), plan["shards"].as_u64()), (Some("simulate"), Some(24)));
}

/// What could not be saved at the end is refused before the work.
#[test]
#[ignore = "slow: 15 s: runs that cannot be saved are refused"]
fn runs_that_cannot_be_saved_are_refused() {
    let folder = folder();
    let spec =
        crate::common::TINY.replace("radius_um = 40.0", "radius_um = 120.0").replace("instances = 2", "instances = 32");
    std::fs::write(folder.path().join("wide.toml"), spec).unwrap();
    for command in ["simulate", "build"] {
        let few = [command, "wide.toml", "--preset", "preview", "--paths", "100"];
        crate::common::refused(folder.path(), &few, &["wide.toml", "paths_per_theta = 100", "too few", "or more"]);
    }
    // 2475 are asked for.
    succeed(folder.path(), &["simulate", "wide.toml", "--preset", "preview", "--paths", "5000", "--quiet"]);
}

/// A limit of file sizes: one line, and what was finished before goes on.
#[test]
#[ignore = "slow: 5 s: limits of file sizes are failed writes"]
fn limits_of_file_sizes_are_failed_writes() {
    let folder = folder();
    let dir = folder.path();
    // Shards of 287 KiB fit into the limit, which is in units of 512 bytes; the table of 380 KiB does not.
    let command = format!(
        "ulimit -f 650; exec '{}' simulate tiny.toml --preset preview --quiet -o t.pwt",
        env!("CARGO_BIN_EXE_plywave")
    );
    let output = Command::new("sh").current_dir(dir).args(["-c", &command]).output().unwrap();
    let err = text(&output.stderr);
    assert_eq!((output.status.code(), err.lines().count()), (Some(2), 1), "{err}");
    assert!(err.contains("t.pwt") && err.contains("too large"), "{err}");
    assert!(!dir.join("t.pwt").exists() && dir.join("t.pwt.parts").is_dir());
    let resume = ["simulate", "tiny.toml", "--preset", "preview", "--quiet", "-o", "t.pwt", "--resume"];
    succeed(dir, &resume);
    succeed(dir, &["simulate", "tiny.toml", "--preset", "preview", "--quiet", "-o", "u.pwt"]);
    assert_eq!(bytes(dir, "t.pwt"), bytes(dir, "u.pwt"));
}

/// Two renders on one output would mix their sums: the second is refused, by any name of the output; a killed
/// one leaves nothing in the way.
#[test]
fn renders_have_their_outputs_for_themselves() {
    let folder = folder();
    let dir = folder.path();
    std::fs::write(dir.join("few.toml"), STRANDS).unwrap();
    let shot = |output: &'static str, samples: &'static str| {
        ["render", "few.toml", "--width", "8", "--height", "8", "--quiet", "-o", output, "--samples", samples]
    };
    let mut first = plywave(dir, &shot("a.png", "1000000")).spawn().unwrap();
    let begun = Instant::now();
    while !dir.join(".a.sums.lock").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no lock within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    std::os::unix::fs::symlink("a.exr", dir.join("link.exr")).unwrap();
    let refused = |output: &'static str| {
        let output = run(dir, &shot(output, "1"));
        let err = text(&output.stderr);
        assert!(output.status.code() == Some(2) && err.contains("written by another run"), "{err}");
    };
    ["a.png", "a.exr", "link.exr"].into_iter().for_each(refused);
    succeed(dir, &shot("b.png", "1"));
    first.kill().unwrap();
    first.wait().unwrap();
    // On a slow machine it has left sums.
    succeed(dir, &[&shot("a.png", "1")[..], &["--fresh"]].concat());
    assert!(!names(dir).iter().any(|name| name.ends_with(".lock")), "{:?}", names(dir));
}

/// The sums of a stopped render are neither thrown away nor used unasked.
#[test]
fn sums_of_a_stopped_render_are_kept_until_somebody_says() {
    let folder = folder();
    let dir = folder.path();
    std::fs::write(dir.join("few.toml"), STRANDS).unwrap();
    let shot = ["render", "few.toml", "--width", "8", "--height", "8", "--quiet", "-o", "a.png"];
    // Renders until it has samples, and stops it; gives the last line that it says.
    let stop = |more: &[&str]| {
        let args = [&shot[..], &["--samples", "1000000"], more].concat();
        let child = plywave(dir, &args).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs(2));
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let said = stop(&[]);
    assert!(said.contains("go on with: plywave render few.toml") && said.contains("--resume"), "{said}");
    let sums = bytes(dir, "a.sums");
    crate::common::refused(dir, &[&shot[..], &["--samples", "1"]].concat(), &["a.sums", "--resume", "--fresh"]);
    assert!(bytes(dir, "a.sums") == sums && !dir.join("a.png").exists());
    crate::common::refused(dir, &[&shot[..], &["--resume", "--fresh"]].concat(), &["--resume", "--fresh"]);
    // Started over, and stopped again: what to go on with is not started over a second time.
    let said = stop(&["--fresh", "--seed", "2"]);
    assert!(said.contains("--seed 2") && said.contains("--resume") && !said.contains("--fresh"), "{said}");
    assert!(bytes(dir, "a.sums") != sums);
    succeed(dir, &[&shot[..], &["--samples", "3", "--fresh"]].concat());
    assert!(!dir.join("a.sums").exists());
    let started_over = bytes(dir, "a.exr");
    succeed(dir, &[&shot[..], &["--samples", "3"]].concat());
    assert!(bytes(dir, "a.exr") == started_over, "started over, the picture is another");
}

/// Interrupts a command as soon as it listens to that; gives its exit code and what it said.
#[cfg(target_os = "linux")]
fn interrupted(dir: &Path, args: &[&str]) -> (Option<i32>, String) {
    let mut child = plywave(dir, args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    // The signals that a program catches, as bits: SIGINT is the second signal.
    let listens = |status: String| {
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).map(str::trim);
        caught.is_some_and(|bits| u64::from_str_radix(bits, 16).unwrap() & 2 != 0)
    };
    while !listens(std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap()) {
        assert!(child.try_wait().unwrap().is_none(), "{args:?} ended before it could be stopped");
        assert!(begun.elapsed() < Duration::from_secs(60), "{args:?} does not listen within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    (output.status.code(), text(&output.stderr))
}

/// What cannot be gone on with is not told to be: nothing of it is kept.
#[cfg(target_os = "linux")]
#[test]
fn commands_that_keep_nothing_do_not_go_on() {
    let folder = folder();
    let dir = folder.path();
    succeed(dir, &["new", "percale", "-q"]);
    let all = names(dir);
    for command in [
        &["weave", "percale.toml", "-o", "p.pwc"][..],
        &["weave", "percale.toml", "-o", "p.bcc"],
        &["export", "percale.toml", "--to", "rgl", "-o", "p.bsdf"],
        &["plot", "percale.toml", "-o", "p.png"],
    ] {
        let (code, told) = interrupted(dir, command);
        assert_eq!((code, told.trim_end()), (Some(130), "stopped"), "{command:?}");
        assert_eq!(names(dir), all, "{command:?}");
    }
}

/// A render that is stopped while its cloth is made goes on with the command that it says.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "slow: 30 s: a render goes on from its cloth"]
fn a_render_goes_on_from_its_cloth() {
    let folder = folder();
    let dir = folder.path();
    succeed(dir, &["new", "organza", "-q"]);
    let shot = ["render", "organza.toml", "--width", "8", "--height", "8", "--samples", "1", "-q", "-o", "o.png"];
    let with_cache = |args: &[&str]| {
        let mut command = plywave(dir, args);
        command.env("PLYWAVE_CACHE", dir.join("cache"));
        command
    };
    let mut child = with_cache(&shot).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(1));
    assert!(child.try_wait().unwrap().is_none(), "ended before it could be stopped");
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let told = text(&child.wait_with_output().unwrap().stderr);
    let (_, command) = told.trim_end().split_once("go on with: plywave ").unwrap_or_else(|| panic!("{told}"));
    let args: Vec<&str> = command.split(' ').collect();
    let done = with_cache(&args).output().unwrap();
    assert!(done.status.success() && dir.join("o.png").exists(), "{}", text(&done.stderr));
}
