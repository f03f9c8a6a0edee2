//! How many faults the tests find that are put into the code on purpose: operators, conditions and whole
//! functions are replaced, one at a time.
//!
//! `cargo run --release -p plywave-mutants -- [--only TEXT].. [--sample N] [--seed S] [--diff REVISION]
//! [--limit SECONDS] [--known FILE] [--least SCORE] [--list]`
//!
//! The mutants are compiled at once, each as an arm of a branch, in a copy of the tree under
//! `target/mutants`; a variable of the environment says which is on. Tests that take at most `--limit`
//! seconds (10) run once to see which mutants they reach. Then each mutant is on while the tests that reach
//! it run, quickest first, until one fails or is late.
//!
//! `--only` takes mutants whose file has the text, `--diff` those in lines that differ from a revision,
//! `--sample` N of them by chance. Survivors that FILE lists are those that change nothing which a test could
//! hold: they do not count. A line of FILE is the mutant's key, as it is printed, then ` # ` and the reason.
//! The program ends with 1 when the score, mutants found over mutants that count, is below `--least`.

mod rewrite;
mod run;

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use rewrite::{Mutant, rewrite};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Duration;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Crates that get mutants, with their folders. The tests of those that have one run.
const CRATES: [(&str, &str); 5] = [
    ("plywave", ""),
    ("plywave-fiber", "fiber/"),
    ("plywave-textile", "textile/"),
    ("plywave-fit", "fit/"),
    ("plywave-sim", "sim/"),
];
/// What gets mutants: evaluation, sampling and density of plies, cloths, fibers, speckle and gaps, the
/// fitter, the readers and the walk.
const FILES: [&str; 8] = [
    "src/",
    "fiber/src/",
    "textile/src/",
    "fit/src/",
    "sim/src/rays/",
    "sim/src/yarn/",
    "sim/src/simulate",
    "sim/src/energies",
];
/// Seconds of tests that a mutant gets.
const BUDGET_S: u64 = 60;

/// The switch that each crate with mutants gets.
const SWITCH: &str = r#"//! Says which mutant is on.
#![allow(missing_docs)]
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
const UNKNOWN: u32 = u32::MAX;
const LOOKING: u32 = u32::MAX - 1;
const NONE: u32 = u32::MAX - 2;
static ON: AtomicU32 = AtomicU32::new(UNKNOWN);
static SEEN: [AtomicBool; COUNT] = [const { AtomicBool::new(false) }; COUNT];
#[inline(always)]
pub fn on(id: u32) -> bool {
    let on = ON.load(Relaxed);
    on == id || (on > NONE && look(id))
}
#[cold]
#[inline(never)]
fn look(id: u32) -> bool {
    if ON.load(Relaxed) == UNKNOWN {
        let number = std::env::var("MUTANT").ok().and_then(|m| m.parse::<u32>().ok()).unwrap_or(0);
        let looks = std::env::var_os("MUTANT_REACH").is_some();
        ON.store(if looks { LOOKING } else if number == 0 { NONE } else { number - 1 }, Relaxed);
        return on(id);
    }
    if !SEEN[id as usize].swap(true, Relaxed) {
        use std::io::Write;
        let file = std::env::var_os("MUTANT_REACH").unwrap();
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file).unwrap();
        file.write_all(format!("{id}\n").as_bytes()).unwrap();
    }
    false
}
"#;

struct Arguments {
    only: Vec<String>,
    sample: Option<usize>,
    seed: u64,
    diff: Option<String>,
    limit: Duration,
    known: Option<PathBuf>,
    least: f64,
    list: bool,
}

/// Flags that have a value.
const FLAGS: [&str; 7] = ["--only", "--sample", "--seed", "--diff", "--limit", "--known", "--least"];

fn arguments() -> Outcome<Arguments> {
    let mut all = Arguments {
        only: Vec::new(),
        sample: None,
        seed: 1,
        diff: None,
        limit: Duration::from_secs(10),
        known: None,
        least: 0.0,
        list: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        if word == "--list" {
            all.list = true;
            continue;
        }
        if !FLAGS.contains(&word.as_str()) {
            return Err(format!("{word}: unknown; use --list or one of {}", FLAGS.join(", ")).into());
        }
        let value = words.next().ok_or_else(|| format!("{word}: a value is missing"))?;
        match word.as_str() {
            "--sample" => all.sample = Some(number(&word, &value)?),
            "--seed" => all.seed = number(&word, &value)?,
            "--diff" => all.diff = Some(value),
            "--limit" => all.limit = Duration::from_secs_f64(number::<f64>(&word, &value)?.clamp(0.0, 1e6)),
            "--least" => all.least = number(&word, &value)?,
            "--known" => all.known = Some(value.into()),
            _ => all.only.push(value),
        }
    }
    Ok(all)
}

fn number<T: std::str::FromStr>(word: &str, value: &str) -> Outcome<T> {
    value.parse().map_err(|_| format!("{word} {value}: no number").into())
}

/// The output of git.
fn git(words: &[&str]) -> Outcome<String> {
    let out = Command::new("git").args(words).output()?;
    if !out.status.success() {
        return Err(format!("git {}: {}", words.join(" "), String::from_utf8_lossy(&out.stderr)).into());
    }
    Ok(String::from_utf8(out.stdout)?)
}

/// Lines that differ from a revision, by file.
fn changed_lines(revision: &str) -> Outcome<BTreeMap<String, BTreeSet<usize>>> {
    let mut lines = BTreeMap::<String, BTreeSet<usize>>::new();
    let mut file = String::new();
    for line in git(&["diff", "--unified=0", "--no-color", revision, "--", "*.rs"])?.lines() {
        if let Some(name) = line.strip_prefix("+++ b/") {
            file = name.to_owned();
        } else if let Some(hunk) = line.strip_prefix("@@ ") {
            let range = hunk.split(' ').find_map(|w| w.strip_prefix('+')).ok_or("a hunk without a range")?;
            let (first, count) = range.split_once(',').unwrap_or((range, "1"));
            let first: usize = first.parse()?;
            lines.entry(file.clone()).or_default().extend(first..first + count.parse::<usize>()?);
        }
    }
    Ok(lines)
}

/// Writes a file unless it is there with this text, so that what did not change is not compiled again.
fn write(path: &Path, bytes: &[u8]) -> Outcome<()> {
    if std::fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    std::fs::create_dir_all(path.parent().ok_or("a file without a folder")?)?;
    Ok(std::fs::write(path, bytes)?)
}

/// A crate's first file with the switch; constants that overflow in a mutant are no error.
fn as_root(text: &str) -> String {
    format!("#![allow(warnings, arithmetic_overflow, unconditional_panic)]\n{text}\npub mod mutant_switch;\n")
}

/// The copy of the tree with the mutants that `is_wanted` says.
fn write_tree(tree: &Path, is_wanted: &dyn Fn(&Mutant) -> bool) -> Outcome<Vec<Mutant>> {
    let mut mutants = Vec::new();
    let names = git(&["ls-files", "--cached", "--others", "--exclude-standard"])?;
    let mut roots = Vec::new();
    for name in names.lines().filter(|n| Path::new(n).is_file()) {
        let target = tree.join(name);
        let is_root = CRATES.iter().any(|(_, folder)| name == format!("{folder}src/lib.rs"));
        let is_test = name.ends_with("tests.rs") || name.contains("/tests/");
        if name.ends_with(".rs") && !is_test && FILES.iter().any(|f| name.starts_with(f)) {
            let text = std::fs::read_to_string(name)?;
            let mut text = rewrite(name, &text, is_wanted, &mut mutants);
            if is_root {
                text = as_root(&text);
            }
            write(&target, text.as_bytes())?;
        } else if is_root {
            write(&target, as_root(&std::fs::read_to_string(name)?).as_bytes())?;
        } else if name.ends_with("Cargo.toml") {
            // Branches of mutants are no clean code.
            write(&target, std::fs::read_to_string(name)?.replace("[lints]\nworkspace = true\n", "").as_bytes())?;
        } else {
            write(&target, &std::fs::read(name)?)?;
        }
        if is_root {
            roots.push(target.with_file_name("mutant_switch.rs"));
        }
    }
    let switch = SWITCH.replace("COUNT", &mutants.len().max(1).to_string());
    for root in roots {
        write(&root, switch.as_bytes())?;
    }
    Ok(mutants)
}

/// Programs of tests with the folders that they run in.
type Programs = Vec<(PathBuf, PathBuf)>;

/// Checks the libraries, or compiles the tests: their programs with the folders that they run in, or the
/// numbers of the mutants in the lines with errors.
fn compile(
    tree: &Path,
    target: &Path,
    words: &[&str],
    mutants: &[Mutant],
) -> Outcome<Result<Programs, BTreeSet<usize>>> {
    let mut cargo = Command::new("cargo");
    cargo.args(words).args(["--release", "--offline", "--message-format", "json"]);
    for (name, folder) in CRATES {
        if mutants.iter().any(|m| m.file.starts_with(&format!("{folder}src/"))) {
            cargo.args(["-p", name]);
        }
    }
    let out =
        cargo.current_dir(tree).env("CARGO_TARGET_DIR", target).stderr(std::process::Stdio::inherit()).output()?;
    let (mut programs, mut bad) = (Vec::new(), BTreeSet::new());
    let mut other = String::new();
    for line in String::from_utf8(out.stdout)?.lines() {
        let message: serde_json::Value = serde_json::from_str(line)?;
        if let (Some(program), Some(manifest)) = (message["executable"].as_str(), message["manifest_path"].as_str())
            && message["profile"]["test"] == true
        {
            let folder = Path::new(manifest).parent().ok_or("a manifest without a folder")?;
            programs.push((program.into(), folder.into()));
        }
        if message["message"]["level"] == "error" {
            let spans = message["message"]["spans"].as_array().cloned().unwrap_or_default();
            let found: BTreeSet<usize> = spans.iter().flat_map(|span| numbers_in(tree, span)).collect();
            if found.is_empty() {
                other += message["message"]["rendered"].as_str().unwrap_or_default();
            }
            bad.extend(found);
        }
    }
    if out.status.success() {
        return Ok(Ok(programs));
    }
    if bad.is_empty() {
        return Err(format!("the tree does not compile\n{other}").into());
    }
    Ok(Err(bad))
}

/// Numbers of the mutants in a compiler's span, or in its lines if it has none.
fn numbers_in(tree: &Path, span: &serde_json::Value) -> Vec<usize> {
    let number = |key: &str| usize::try_from(span[key].as_u64().unwrap_or(0)).unwrap_or(0);
    let Ok(text) = std::fs::read_to_string(tree.join(span["file_name"].as_str().unwrap_or_default())) else {
        return Vec::new();
    };
    let numbers = |text: &str| -> Vec<usize> {
        let pieces = text.split("mutant_switch::on(").skip(1);
        pieces.filter_map(|p| p.split(')').next()?.parse().ok()).collect()
    };
    let inside = text.get(number("byte_start")..number("byte_end")).map(numbers).unwrap_or_default();
    if !inside.is_empty() {
        return inside;
    }
    let lines = text.lines().skip(number("line_start").saturating_sub(1));
    lines.take(number("line_end") + 1 - number("line_start").max(1)).flat_map(numbers).collect()
}

/// Survivors that are known, with the reasons.
fn known(file: Option<&Path>) -> Outcome<BTreeMap<String, String>> {
    let Some(file) = file else { return Ok(BTreeMap::new()) };
    let text = std::fs::read_to_string(file)?;
    let entry = |line: &str| line.rsplit_once(" # ").map(|(key, reason)| (key.to_owned(), reason.to_owned()));
    Ok(text.lines().filter(|l| !l.starts_with('#')).filter_map(entry).collect())
}

fn main() -> ExitCode {
    measure().unwrap_or_else(|error| {
        eprintln!("{error}");
        ExitCode::FAILURE
    })
}

fn measure() -> Outcome<ExitCode> {
    let arguments = arguments()?;
    let target = std::env::current_dir()?.join("target");
    let (tree, scratch) = (target.join("mutants/tree"), target.join("mutants/scratch"));
    std::fs::create_dir_all(&scratch)?;

    let lines = arguments.diff.as_deref().map(changed_lines).transpose()?;
    let is_asked = |m: &Mutant| {
        let only = arguments.only.is_empty() || arguments.only.iter().any(|o| m.file.contains(o.as_str()));
        only && lines.as_ref().is_none_or(|l| l.get(&m.file).is_some_and(|l| l.contains(&m.line)))
    };
    let mut asked = write_tree(&tree, &is_asked)?;
    let all = asked.len();
    asked.shuffle(&mut Pcg64Mcg::seed_from_u64(arguments.seed));
    asked.truncate(arguments.sample.unwrap_or(all));
    if arguments.list {
        asked.iter().for_each(|m| println!("{}", m.key()));
        return Ok(ExitCode::SUCCESS);
    }

    let mut wanted: BTreeSet<String> = asked.iter().map(Mutant::key).collect();
    let (mutants, programs) = loop {
        let mutants = write_tree(&tree, &|m| wanted.contains(&m.key()) && is_asked(m))?;
        let found = match compile(&tree, &target, &["check", "--keep-going"], &mutants)? {
            Ok(_) => compile(&tree, &target, &["test", "--no-run"], &mutants)?,
            bad => bad,
        };
        match found {
            Ok(programs) => break (mutants, programs),
            Err(bad) => {
                eprintln!("{} of {} mutants do not compile", bad.len(), mutants.len());
                for id in bad {
                    wanted.remove(&mutants[id].key());
                }
            }
        }
    };
    println!("{} of {all} mutants are tried", mutants.len());

    let tests: Vec<_> = programs.iter().flat_map(|(program, folder)| run::tests_of(program, folder)).collect();
    let count = tests.len();
    let (tests, reached) = run::reach(tests, &scratch, arguments.limit);
    println!("{} of {count} tests pass within {:?}", tests.len(), arguments.limit);

    let none = Vec::new();
    let found: Vec<(usize, Option<(String, run::End)>)> = (0..mutants.len())
        .into_par_iter()
        .map(|id| {
            let those = reached.get(&id).unwrap_or(&none).iter().map(|&t| &tests[t]);
            let found = run::find(id, those, Duration::from_secs(BUDGET_S)).map(|(t, end)| (t.name.clone(), end));
            let m = &mutants[id];
            match &found {
                Some((test, end)) => eprintln!("{end:?} {} by {test}", m.key()),
                None => eprintln!("SURVIVED {}:{} {}", m.file, m.line, m.key()),
            }
            (id, found)
        })
        .collect();
    let score = report(&mutants, &found, (&reached, &known(arguments.known.as_deref())?));
    Ok(if score < arguments.least { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Prints survivors and scores; the score of all.
fn report(
    mutants: &[Mutant],
    found: &[(usize, Option<(String, run::End)>)],
    (reached, known): (&BTreeMap<usize, Vec<usize>>, &BTreeMap<String, String>),
) -> f64 {
    let mut folders = BTreeMap::<String, [usize; 3]>::new();
    let mut survivors: Vec<&Mutant> = Vec::new();
    for (id, end) in found {
        let mutant = &mutants[*id];
        let folder = mutant.file.rsplit_once('/').map_or("", |(f, _)| f).to_owned();
        let counts = folders.entry(folder).or_default();
        counts[0] += 1;
        counts[1] += usize::from(end.is_some());
        counts[2] += usize::from(end.is_none() && known.contains_key(&mutant.key()));
        if end.is_none() {
            survivors.push(mutant);
        }
    }
    survivors.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
    for mutant in survivors {
        let reason = known.get(&mutant.key()).map_or("", |r| r);
        println!(
            "{}:{}: {}{}{reason}",
            mutant.file,
            mutant.line,
            mutant.key(),
            if reason.is_empty() { "" } else { " # " }
        );
    }
    println!("| folder | mutants | found | explained | score |\n|---|---|---|---|---|");
    let mut sum = [0; 3];
    for (folder, counts) in &folders {
        for k in 0..3 {
            sum[k] += counts[k];
        }
        println!("{}", row(folder, *counts));
    }
    println!("{}", row("all", sum));
    let unreached = found.iter().filter(|(id, _)| !reached.contains_key(id)).count();
    println!("{unreached} are reached by no fast test");
    score(sum)
}

/// Mutants found over those that change anything.
#[expect(clippy::cast_precision_loss, reason = "counts are small")]
fn score([mutants, found, explained]: [usize; 3]) -> f64 {
    found as f64 / (mutants - explained).max(1) as f64
}

/// A row of the table.
fn row(name: &str, counts: [usize; 3]) -> String {
    let [mutants, found, explained] = counts;
    format!("| {name} | {mutants} | {found} | {explained} | {:.1} % |", 100.0 * score(counts))
}
