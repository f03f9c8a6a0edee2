//! Tests of a tree with mutants: which reach a mutant, and which fail with it.

use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Memory of a test [KiB].
const MEMORY_KIB: u64 = 8 << 20;

/// A test with what it needs.
#[derive(Clone, Debug)]
pub struct Test {
    /// Program with the test.
    pub program: PathBuf,
    /// Folder that it runs in.
    pub folder: PathBuf,
    /// Name.
    pub name: String,
    /// Time without a mutant.
    pub time: Duration,
}

/// How a test ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It passed.
    Passed,
    /// It failed, or its program crashed.
    Failed,
    /// It took too long.
    Late,
}

/// Runs one test with a mutant; 0 is none.
fn run(test: &Test, mutant: usize, reach: Option<&Path>, limit: Duration) -> End {
    let mut command = Command::new("sh");
    command
        .arg("-c")
        .arg(format!("ulimit -v {MEMORY_KIB}; exec \"$0\" --exact \"$1\" --test-threads 1"))
        .arg(&test.program)
        .arg(&test.name)
        .current_dir(&test.folder)
        .env("MUTANT", mutant.to_string())
        .env("CARGO_MANIFEST_DIR", &test.folder)
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    if let Some(reach) = reach {
        command.env("MUTANT_REACH", reach);
    }
    let Ok(mut child) = command.spawn() else { return End::Failed };
    let begun = Instant::now();
    let mut wait = Duration::from_millis(1);
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return if status.success() { End::Passed } else { End::Failed },
            Ok(None) if begun.elapsed() < limit => {
                std::thread::sleep(wait);
                wait = (2 * wait).min(Duration::from_millis(20));
            }
            _ => {
                let _ = child.kill();
                let _ = child.wait();
                return End::Late;
            }
        }
    }
}

/// The tests of a program that are not ignored.
pub fn tests_of(program: &Path, folder: &Path) -> Vec<Test> {
    let list = |flags: &[&str]| -> Vec<String> {
        let out = Command::new(program).args(["--list", "--format", "terse"]).args(flags).current_dir(folder).output();
        let text = out.map(|o| String::from_utf8_lossy(&o.stdout).into_owned()).unwrap_or_default();
        text.lines().filter_map(|l| l.strip_suffix(": test")).map(str::to_owned).collect()
    };
    let slow = list(&["--ignored"]);
    let names = list(&[]).into_iter().filter(|n| !slow.contains(n));
    let test = |name| Test { program: program.into(), folder: folder.into(), name, time: Duration::ZERO };
    names.map(test).collect()
}

/// Runs each test without a mutant: those that pass within `limit`, quickest first, and of each mutant the
/// numbers of the tests that reach it.
pub fn reach(tests: Vec<Test>, scratch: &Path, limit: Duration) -> (Vec<Test>, BTreeMap<usize, Vec<usize>>) {
    let mut reached: Vec<(Test, Vec<usize>)> = tests
        .into_par_iter()
        .enumerate()
        .filter_map(|(i, mut test)| {
            let file = scratch.join(format!("reach{i}"));
            let _ = std::fs::remove_file(&file);
            let begun = Instant::now();
            if run(&test, 0, Some(&file), limit) != End::Passed {
                return None;
            }
            test.time = begun.elapsed();
            let text = std::fs::read_to_string(&file).unwrap_or_default();
            let ids = text.lines().filter_map(|l| l.parse().ok()).collect();
            Some((test, ids))
        })
        .collect();
    reached.sort_by_key(|(test, _)| test.time);
    let mut of_mutant = BTreeMap::<usize, Vec<usize>>::new();
    for (i, (_, ids)) in reached.iter().enumerate() {
        for &id in ids {
            of_mutant.entry(id).or_default().push(i);
        }
    }
    (reached.into_iter().map(|(test, _)| test).collect(), of_mutant)
}

/// The test that finds a mutant, with how it ended; none if all pass, or those that `budget` has time for.
pub fn find<'t>(mutant: usize, tests: impl Iterator<Item = &'t Test>, budget: Duration) -> Option<(&'t Test, End)> {
    let begun = Instant::now();
    for test in tests {
        if begun.elapsed() > budget {
            return None;
        }
        // Machines are shared, so that a test may take some times longer than before.
        let end = run(test, mutant + 1, None, 10 * test.time + Duration::from_secs(10));
        if end != End::Passed {
            return Some((test, end));
        }
    }
    None
}
