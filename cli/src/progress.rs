//! Progress on stderr: a bar on a terminal, else a line every ten seconds; nothing with `--quiet`. Also
//! handles Ctrl-C and SIGTERM.

use crate::failure::Failure;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use plywave_pipeline::{Progress, Stage};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two lines if stderr is not a terminal.
const LINES_EVERY: Duration = Duration::from_secs(10);

/// Set by the first Ctrl-C or SIGTERM during stoppable work, which checks it between shards.
pub static STOP: AtomicBool = AtomicBool::new(false);
static STOPPABLE: AtomicBool = AtomicBool::new(false);

/// Installs handlers: the first Ctrl-C or SIGTERM stops stoppable work in good order; otherwise, and always
/// the second time, it ends the program at once. Shards already written stay complete either way.
pub fn install_stop() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A file beyond the limit of its size is then a failed write with a message, not the end of the
        // program. Without room for a handler it stays that.
        #[cfg(unix)]
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
        let handler = || {
            if !STOPPABLE.load(Ordering::SeqCst) || STOP.swap(true, Ordering::SeqCst) {
                if std::io::stderr().is_terminal() {
                    // The line of the bar is cleared for the message.
                    let _ = std::io::stderr().write_all(b"\r\x1b[2K");
                }
                stopped("").report();
                std::process::exit(130);
            }
        };
        // Fails only when the system has no room for a handler: Ctrl-C then ends the program at once, and
        // --resume still works.
        let _ = ctrlc::set_handler(handler);
    });
}

/// Runs work that checks [`STOP`].
pub fn stoppable<T>(work: impl FnOnce() -> T) -> T {
    STOPPABLE.store(true, Ordering::SeqCst);
    let done = work();
    STOPPABLE.store(false, Ordering::SeqCst);
    done
}

/// Failure of a stopped command; `left` describes the remaining work. A command without `--resume` saves no
/// state.
pub fn stopped(left: &str) -> Failure {
    let words: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    Failure::Interrupted(match is_resumable(words.iter().map(String::as_str)) {
        true => format!("stopped{left}; go on with: {}", resume_command()),
        false => format!("stopped{left}"),
    })
}

/// Whether the command line (without the program) belongs to a command with the flag `--resume`.
fn is_resumable<'a>(words: impl Iterator<Item = &'a str>) -> bool {
    let mut command = <crate::args::Cli as clap::CommandFactory>::command();
    for word in words {
        if let Some(next) = command.find_subcommand(word).cloned() {
            command = next;
        }
    }
    command.get_arguments().any(|argument| argument.get_id() == "resume")
}

/// The command line of this run, with `--resume` added.
fn resume_command() -> String {
    let mut words = vec!["plywave".to_string()];
    // With --fresh the command would delete the saved shards.
    for word in std::env::args_os().skip(1).filter(|word| word != "--fresh") {
        let word = word.to_string_lossy();
        let plain = !word.is_empty() && word.chars().all(|c| c.is_alphanumeric() || "-_./=,:+".contains(c));
        words.push(if plain { word.into_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) });
    }
    if !words.iter().any(|w| w == "--resume") {
        words.push("--resume".into());
    }
    words.join(" ")
}

/// A progress bar for consecutive stages of the work.
pub struct Bar {
    bar: ProgressBar,
    begun: Instant,
    /// Start of the current stage.
    stage: Arc<Mutex<Instant>>,
    /// Thread that writes lines if stderr is not a terminal; it ends when the sender is dropped.
    lines: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Bar {
    /// A bar named `what` that counts in `unit`, or a silent one.
    pub fn new(what: &'static str, unit: &'static str, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let hidden = quiet || !terminal;
        let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
        let bar = ProgressBar::with_draw_target(Some(1), target);
        bar.set_style(style(unit));
        bar.set_prefix(what);
        if !hidden {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        let begun = Instant::now();
        let stage = Arc::new(Mutex::new(begun));
        let lines = (!quiet && !terminal).then(|| {
            let (sender, ended) = channel();
            let (bar, stage) = (bar.clone(), Arc::clone(&stage));
            let write = move || {
                while ended.recv_timeout(LINES_EVERY) == Err(RecvTimeoutError::Timeout) {
                    // A failed write to a log does not stop the work.
                    let _ = writeln!(std::io::stderr(), "{}", line(&bar, begun.elapsed(), lock(&stage).elapsed()));
                }
            };
            (sender, std::thread::spawn(write))
        });
        Bar { bar, begun, stage, lines }
    }

    /// Begins a stage of `total` units.
    pub fn begin(&self, what: &'static str, total: u64) {
        *lock(&self.stage) = Instant::now();
        self.bar.set_prefix(what);
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.reset_eta();
    }

    /// Adds `units` to the units done.
    pub fn advance(&self, units: u64) {
        self.bar.inc(units);
    }

    /// Sets the units done and the total of a stage.
    pub fn update(&self, what: &'static str, done: u64, total: u64) {
        if self.bar.prefix() != what || self.bar.length() != Some(total) {
            self.begin(what, total);
        }
        self.bar.set_position(done);
    }

    /// Removes the bar; returns the time since its start.
    pub fn finish(self) -> Duration {
        self.begun.elapsed()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((sender, thread)) = self.lines.take() {
            drop(sender);
            // A thread that panicked has no output to finish.
            let _ = thread.join();
        }
    }
}

fn style(unit: &str) -> ProgressStyle {
    let template = format!("{{prefix:>9}} [{{bar:32}}] {{percent:>3}} %  {{rate}} {unit}/s  {{elapsed}}, {{eta}} left");
    ProgressStyle::with_template(&template)
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .with_key("rate", |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
            // What cannot be shown is left out of the bar.
            let _ = out.write_str(&crate::report::count(state.per_sec()));
        })
        .progress_chars("=> ")
}

fn lock(at: &Mutex<Instant>) -> MutexGuard<'_, Instant> {
    at.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A line for logs: `time` that the bar stood, and the remaining time of its stage, which has taken `stage`.
fn line(bar: &ProgressBar, time: Duration, stage: Duration) -> String {
    let (done, total) = (bar.position(), bar.length().unwrap_or(1));
    let percent = 100.0 * done as f64 / total.max(1) as f64;
    // At the mean rate of the stage so far; a bar that is not drawn estimates none itself.
    let remaining = match done {
        0 => String::new(),
        _ => {
            let share = total.saturating_sub(done) as f64 / done as f64;
            format!(", {} left", crate::report::duration(stage.mul_f64(share)))
        }
    };
    format!("{}: {percent:.0} %, {}{remaining}", bar.prefix(), crate::report::duration(time))
}

/// A bar for the stages of the pipeline, which also says which of them Ctrl-C can stop in good order.
pub struct PipelineBar {
    quiet: bool,
    begun: Instant,
    state: Mutex<Option<(Stage, Bar)>>,
}

impl PipelineBar {
    /// No stage yet.
    pub fn new(quiet: bool) -> Self {
        PipelineBar { quiet, begun: Instant::now(), state: Mutex::new(None) }
    }

    /// A stage is so far.
    pub fn update(&self, progress: Progress) {
        let Progress { stage, done, total } = progress;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let known = state.as_ref().is_some_and(|(known, _)| known.unit() == stage.unit());
        STOPPABLE.store(stage.is_stoppable(), Ordering::SeqCst);
        if !known {
            *state = Some((stage, Bar::new(stage.name(), stage.unit(), self.quiet)));
        }
        if let Some((_, bar)) = state.as_ref() {
            bar.update(stage.name(), done, total);
        }
    }

    /// Takes the bar away; gives the time it stood.
    pub fn finish(self) -> Duration {
        STOPPABLE.store(false, Ordering::SeqCst);
        self.begun.elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_tell_stage_and_share() {
        let bar = ProgressBar::with_draw_target(Some(8), ProgressDrawTarget::hidden());
        bar.set_prefix("simulate");
        bar.set_position(2);
        let reported = |seconds: u64| line(&bar, Duration::from_secs(seconds), Duration::from_secs(30));
        assert_eq!(reported(130), "simulate: 25 %, 2 min 10 s, 90.0 s left");
        bar.set_position(0);
        assert_eq!(reported(10), "simulate: 0 %, 10.0 s");
    }

    /// Also of commands in commands, and with flags before the command.
    #[test]
    fn commands_with_resume_go_on() {
        let goes_on = |line: &str| is_resumable(line.split(' '));
        for line in ["build", "-q simulate a.toml", "wave tabulate a.toml", "twin a.toml", "family a.toml", "render a"]
        {
            assert!(goes_on(line), "{line}");
        }
        for line in ["weave a.toml -o a.pwc", "export a.toml --to rgl", "plot a.pwm", "view", "wave", "hairs a.pwc"] {
            assert!(!goes_on(line), "{line}");
        }
    }
}
