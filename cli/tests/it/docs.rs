//! The output in docs/reference/commands.md is what this program prints: each command with output is run, and
//! its output compared, numbers within what other processors round otherwise and other machines take in time.
//! `scripts/renew_docs.sh` writes the output anew.

use crate::common::{run, text};
use std::path::Path;

/// A command of the page, from `line` on, and the output that follows it.
struct Shown {
    line: usize,
    command: String,
    output: Vec<String>,
}

/// What stands at the end of an output of which the page shows the beginning.
const CUT: &str = "...";

fn page() -> String {
    format!("{}/../docs/reference/commands.md", env!("CARGO_MANIFEST_DIR"))
}

/// The commands in fenced blocks.
fn commands(page: &str) -> Vec<Shown> {
    let mut all: Vec<Shown> = Vec::new();
    let (mut fenced, mut open) = (false, false);
    for (line, text) in page.lines().enumerate() {
        if text.starts_with("```") {
            (fenced, open) = (!fenced, false);
        } else if let Some(command) = text.strip_prefix("$ plywave ").filter(|_| fenced) {
            all.push(Shown { line, command: command.to_string(), output: Vec::new() });
            open = true;
        } else if open && let Some(last) = all.last_mut() {
            last.output.push(text.to_string());
        }
    }
    all.retain(|shown| !shown.output.is_empty());
    all
}

/// Words and numbers of a line.
fn tokens(line: &str) -> Vec<&str> {
    line.split(|c: char| c.is_whitespace() || "/,;:()|".contains(c)).filter(|t| !t.is_empty()).collect()
}

/// Whether a line printed stands for the line shown.
fn alike(shown: &str, printed: &str) -> bool {
    let (a, b) = (tokens(shown), tokens(printed));
    // Times, and what hangs on them: those of the page are kept.
    let is_timed = |line: &str| line.contains("paths/s") || line.contains(" s:") || line.contains("made in");
    if is_timed(shown) && is_timed(printed) {
        return a.first() == b.first();
    }
    // The third is what was measured: rounding, mostly.
    let measured = |i: usize| i == 2 && ["pass", "FAIL"].contains(&a[0]);
    a.len() == b.len()
        && a.iter().zip(&b).enumerate().all(|(i, (a, b))| match (a.parse::<f64>(), b.parse::<f64>()) {
            (Ok(a), Ok(b)) if measured(i) => (a - b).abs() <= 1e-3 + 0.5 * a.abs(),
            (Ok(a), Ok(b)) => (a - b).abs() <= 2e-4 + 1e-3 * a.abs(),
            _ => a == b,
        })
}

/// Runs the commands that `chosen` picks, in the order of the page in one folder, and compares; or writes
/// their output into the page.
fn hold(chosen: impl Fn(&str) -> bool) {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let fabrics = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics").canonicalize().unwrap();
    std::os::unix::fs::symlink(&fabrics, dir.join("fabrics")).unwrap();
    let polyester = std::fs::read_to_string(fabrics.join("polyester.toml")).unwrap();
    assert!(polyester.contains("\nradius_um = 50.0\n"), "the page has this ply at 40 um");
    std::fs::write(dir.join("tight.toml"), polyester.replace("\nradius_um = 50.0\n", "\nradius_um = 40.0\n")).unwrap();

    let written = std::fs::read_to_string(page()).unwrap();
    let mut lines: Vec<String> = written.lines().map(str::to_string).collect();
    let mut wrong = Vec::new();
    // From the last to the first, so that lines keep their numbers.
    let mut printed: Vec<(Shown, Vec<String>)> = Vec::new();
    for shown in commands(&written).into_iter().filter(|shown| chosen(&shown.command)) {
        let args: Vec<&str> = shown.command.split_whitespace().collect();
        let done = run(dir, &args);
        let all = text(&done.stdout) + &text(&done.stderr);
        // How far a long run is, where nobody looks on.
        let is_progress = |line: &&str| line.contains(" %, ") && line.ends_with(" left");
        let mut output: Vec<String> =
            all.lines().filter(|line| !is_progress(line)).map(|line| line.trim_end().to_string()).collect();
        if shown.output.last().is_some_and(|last| last == CUT) {
            output.truncate(shown.output.len() - 1);
            output.push(CUT.to_string());
        }
        printed.push((shown, output));
    }
    assert!(!printed.is_empty(), "no command of {} was run", page());
    for (shown, output) in printed.into_iter().rev() {
        let same =
            shown.output.len() == output.len() && shown.output.iter().zip(&output).all(|(a, b)| alike(a.trim_end(), b));
        if !same {
            wrong.push(format!("line {}: $ plywave {}\n{}", shown.line + 1, shown.command, output.join("\n")));
        }
        let first = shown.line + 1;
        let kept = |i: usize, line: String| match shown.output.get(i) {
            Some(was) if alike(was.trim_end(), &line) => was.clone(),
            _ => line,
        };
        let output = output.into_iter().enumerate().map(|(i, line)| kept(i, line));
        lines.splice(first..first + shown.output.len(), output.collect::<Vec<_>>());
    }
    if std::env::var_os("PLYWAVE_RENEW_DOCS").is_some() {
        std::fs::write(page(), lines.join("\n") + "\n").unwrap();
        return;
    }
    wrong.reverse();
    assert!(
        wrong.is_empty(),
        "{} shows other output than this program; scripts/renew_docs.sh renews it\n{}",
        page(),
        wrong.join("\n\n")
    );
}

/// Whether a command simulates or fits, or takes what such a one made.
fn is_slow(command: &str) -> bool {
    ["simulate", "fit", "build"].iter().any(|c| command.starts_with(c)) && command != "build tight.toml"
        || command.contains("second.")
}

#[test]
fn output_of_quick_commands_is_as_shown() {
    hold(|command| !is_slow(command));
}

#[test]
#[ignore = "slow: 60 s: simulates and fits twice"]
fn output_of_slow_commands_is_as_shown() {
    hold(is_slow);
}

#[test]
fn other_numbers_and_words_are_told_apart() {
    assert!(alike("0  0.102830  1", "0  0.102831  1") && !alike("0  0.100681  1", "0  0.102830  1"));
    assert!(!alike("a.pwm: 87.2 KiB", "a.pwm: 58.9 KiB") && !alike("five", "nine") && !alike("a b", "a"));
    assert!(alike(
        "  simulation   7.7 s: 2.5 M paths, 323.5 k paths/s",
        "  simulation   812 ms: 2.5 M paths, 3.1 M paths/s"
    ));
    assert!(alike("pass  furnace  0.0000274  allowed 0.001", "pass  furnace  0.0000391  allowed 0.001"));
}
