//! The output in docs/reference/commands.md is what this program prints: each command with output is run, and
//! its output compared, numbers within what other processors round otherwise and other machines take in time.
//! `scripts/renew_docs.sh` writes the output anew.

use crate::common::{names, run, succeed, text};
use std::collections::BTreeSet;
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
        let is_progress = |line: &&str| {
            let words: Vec<&str> = line.split_once(": ").map_or(*line, |(_, rest)| rest).split(' ').take(2).collect();
            matches!(words[..], [number, "%," | "steps,"] if !line.starts_with(' ') && number.parse::<u64>().is_ok())
        };
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

/// Commands that `plywave help` lists, in its order.
fn commands_of_program(of: &[&str]) -> Vec<String> {
    let help = succeed(Path::new("."), &[&["help"], of].concat());
    let block = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // What a command does may go on in the next line, further in.
    let names = block.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
    names.map(str::to_string).collect()
}

/// Flags that `plywave help` lists for a command, but for those of every command.
fn flags_of_program(command: &[&str]) -> BTreeSet<String> {
    let help = succeed(Path::new("."), &[&["help"], command].concat());
    let flags = help.lines().filter_map(|line| {
        let line = line.trim_start();
        let line = line
            .strip_prefix('-')
            .and_then(|l| l.strip_prefix(|c: char| c.is_ascii_lowercase()))
            .map_or(line, |l| l.trim_start_matches([',', ' ']));
        let name = line.strip_prefix("--")?.split([' ', '=']).next()?;
        Some(format!("--{name}"))
    });
    flags.filter(|flag| !COMMON_FLAGS.contains(&flag.as_str())).collect()
}

const COMMON_FLAGS: [&str; 6] = ["--help", "--json", "--models", "--quiet", "--threads", "--version"];

/// Commands with their subcommands, as words of the command line.
fn all_commands() -> Vec<Vec<String>> {
    let with_subcommands = |name: String| match name.as_str() {
        "wave" => commands_of_program(&["wave"]).into_iter().map(|sub| vec![name.clone(), sub]).collect(),
        _ => vec![vec![name]],
    };
    commands_of_program(&[]).into_iter().flat_map(with_subcommands).collect()
}

/// Code in a text: what stands between two backticks.
fn code(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// The table whose first line is `head`: its rows, and where they lie among the lines.
fn table<'a>(lines: &[&'a str], head: &str) -> (std::ops::Range<usize>, Vec<Vec<&'a str>>) {
    let first = 2 + lines.iter().position(|line| *line == head).unwrap_or_else(|| panic!("no table {head}"));
    let rows: Vec<Vec<&str>> = lines[first..]
        .iter()
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect();
    (first..first + rows.len(), rows)
}

/// The page lists the commands of the program, each with its flags; `scripts/renew_docs.sh` writes the flags.
#[test]
fn output_of_help_is_what_the_page_lists() {
    let written = std::fs::read_to_string(page()).unwrap();
    let lines: Vec<&str> = written.lines().collect();
    let listed: BTreeSet<&str> = table(&lines, "| command | does |").1.iter().flat_map(|row| code(row[0])).collect();
    let program = commands_of_program(&[]);
    assert_eq!(listed, program.iter().map(String::as_str).collect(), "the first table of the page");

    let (at, rows) = table(&lines, "| command | flags |");
    let expected: Vec<String> = all_commands()
        .iter()
        .map(|command| {
            let words: Vec<&str> = command.iter().map(String::as_str).collect();
            let flags: Vec<String> = flags_of_program(&words).iter().map(|flag| format!("`{flag}`")).collect();
            format!("| `{}` | {} |", words.join(" "), if flags.is_empty() { "none".into() } else { flags.join(", ") })
        })
        .collect();
    if std::env::var_os("PLYWAVE_RENEW_DOCS").is_some() {
        let mut lines: Vec<String> = lines.iter().map(|line| (*line).to_string()).collect();
        lines.splice(at, expected);
        return std::fs::write(page(), lines.join("\n") + "\n").unwrap();
    }
    let shown: Vec<&str> = lines[at].to_vec();
    assert_eq!(shown, expected, "{rows:?}");
}

/// Flags that the page speaks of belong to the program: in some sections, to the command of the section.
#[test]
fn flags_on_the_page_are_the_programs() {
    let written = std::fs::read_to_string(page()).unwrap();
    let all: BTreeSet<String> = all_commands()
        .iter()
        .flat_map(|command| flags_of_program(&command.iter().map(String::as_str).collect::<Vec<_>>()))
        .chain(COMMON_FLAGS.map(str::to_string))
        .collect();
    // Flags of a shell command or of other programs stand in blocks of code.
    let mut in_code = false;
    for (k, line) in written.lines().enumerate() {
        in_code ^= line.starts_with("```");
        if in_code && !line.contains("plywave") {
            continue;
        }
        let words = line.split(|c: char| !(c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-'));
        for flag in words.filter(|word| word.len() > 3 && word.starts_with("--") && !word.starts_with("---")) {
            let is_cargos = line.contains("cargo ");
            assert!(is_cargos || all.contains(flag), "{}:{}: no command has {flag}", page(), k + 1);
        }
    }
    let sections = [("### Export", "export"), ("### View", "view"), ("### Hairs", "hairs"), ("### New", "new")];
    for (title, command) in sections {
        let flags = flags_of_program(&[command]);
        let section = written.split(title).nth(1).unwrap_or_else(|| panic!("no section {title}"));
        let section = section.split("\n## ").next().and_then(|s| s.split("\n### ").next()).unwrap();
        for row in section.lines().filter(|line| line.starts_with("| `--")) {
            for flag in code(row.trim_matches('|').split('|').next().unwrap()) {
                assert!(flags.contains(flag), "{title}: {flag} is none of {flags:?}");
            }
        }
    }
}

/// Names of files in a folder of `fabrics`, without their ending.
fn shipped(folder: &str, ending: &str) -> BTreeSet<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics").join(folder);
    names(&folder).iter().filter_map(|name| name.strip_suffix(ending)).map(str::to_string).collect()
}

/// What the page says that ships is in the folders.
#[test]
fn what_ships_is_what_the_page_lists() {
    let written = std::fs::read_to_string(page()).unwrap();
    let part = |from: &str, to: &str| -> String {
        let rest = written.split(from).nth(1).unwrap_or_else(|| panic!("{}: no {from:?}", page()));
        rest.split(to).next().unwrap().replace('\n', " ")
    };
    let models = part("compiled into the program and into the Python package:", ".\n");
    let models: BTreeSet<String> = models.split(',').map(|name| name.trim().to_string()).collect();
    assert_eq!(models, shipped("models", ".pwm"));
    let cloths = part("Specs ship in `fabrics/cloths/`:", ";");
    let cloths: BTreeSet<String> = code(&cloths).into_iter().map(str::to_string).collect();
    assert_eq!(cloths, shipped("cloths", ".toml"));
    // The page says that each has the models of its plies, which `a_spec_comes_with_what_it_needs` of the
    // pipeline tests.
    assert!(written.contains("All cloths that ship have the models of their plies."));
    let singles = part("has models of one ply of ", ".\n");
    let singles: BTreeSet<&str> = singles.split([',', ' ']).filter(|word| !word.is_empty() && *word != "and").collect();
    let expected = shipped("models", ".pwm")
        .into_iter()
        .filter(|name| {
            !["ply", "bundle", "bundle_ne40", "bundle_ne7", "single"].iter().any(|ending| name.ends_with(ending))
        })
        .collect::<Vec<_>>();
    assert_eq!(singles, expected.iter().map(String::as_str).collect());
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
