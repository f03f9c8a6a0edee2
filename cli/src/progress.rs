//! Progress on stderr: a bar on a terminal, else a line every ten seconds; nothing with `--quiet`. And Ctrl-C
//! and SIGTERM.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use plywave_pipeline::{Progress, Stage};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, Once, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two lines where stderr is no terminal.
const LINES_EVERY: Duration = Duration::from_secs(10);

/// Set by the first Ctrl-C or SIGTERM during stoppable work, which looks at it between shards.
pub static STOP: AtomicBool = AtomicBool::new(false);
static STOPPABLE: AtomicBool = AtomicBool::new(false);

/// Makes the first Ctrl-C or SIGTERM stop the work in good order where it can be, else (and the second one
/// always) end the program at once.
/// Shards already written stay whole either way.
pub fn install_stop() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A file beyond the limit of its size is then a failed write with a message, not the end of the
        // program. Without room for a handler it stays that.
        #[cfg(unix)]
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
        let handler = || {
            if !STOPPABLE.load(Ordering::SeqCst) || STOP.swap(true, Ordering::SeqCst) {
                if std::io::stderr().is_terminal() {
                    // The bar's line makes room; where it cannot, the message stands beside it.
                    let _ = std::io::stderr().write_all(b"\r\x1b[2K");
                }
                crate::failure::Failure::Interrupted(format!("stopped; go on with: {}", resume_command())).report();
                std::process::exit(130);
            }
        };
        // Fails only when the system has no room for a handler: Ctrl-C then ends the program at once, and
        // --resume still works.
        let _ = ctrlc::set_handler(handler);
    });
}

/// Runs work that looks at [`STOP`].
pub fn stoppable<T>(work: impl FnOnce() -> T) -> T {
    STOPPABLE.store(true, Ordering::SeqCst);
    let done = work();
    STOPPABLE.store(false, Ordering::SeqCst);
    done
}

/// Commands that have the flag `--resume`.
const RESUMABLE: [&str; 6] = ["simulate", "build", "tabulate", "compare", "speckle", "render"];

/// The command line of this run with `--resume`, where the command has that flag.
pub fn resume_command() -> String {
    let mut words = vec!["plywave".to_string()];
    for word in std::env::args_os().skip(1) {
        let word = word.to_string_lossy();
        let plain = !word.is_empty() && word.chars().all(|c| c.is_alphanumeric() || "-_./=,:+".contains(c));
        words.push(if plain { word.into_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) });
    }
    let resumable = words.iter().any(|w| RESUMABLE.contains(&w.as_str()));
    if resumable && !words.iter().any(|w| w == "--resume") {
        words.push("--resume".into());
    }
    words.join(" ")
}

/// A bar for one stage of the work after the other.
pub struct Bar {
    bar: ProgressBar,
    begun: Instant,
    /// Where stderr is no terminal: the thread that writes lines, which ends when the sender is dropped.
    lines: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Bar {
    /// A bar named `what` that counts `unit`s, or a silent one.
    pub fn new(what: &'static str, unit: &'static str, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let hidden = quiet || !terminal;
        let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
        let bar = ProgressBar::with_draw_target(Some(1), target);
        let template =
            format!("{{prefix:>9}} [{{bar:32}}] {{percent:>3}} %  {{rate}} {unit}/s  {{elapsed}}, {{eta}} left");
        let style = ProgressStyle::with_template(&template)
            .unwrap_or_else(|_| ProgressStyle::default_bar())
            .with_key("rate", |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
                // What cannot be shown is left out of the bar.
                let _ = out.write_str(&crate::report::count(state.per_sec()));
            })
            .progress_chars("=> ");
        bar.set_style(style);
        bar.set_prefix(what);
        if !hidden {
            bar.enable_steady_tick(Duration::from_millis(250));
        }
        let begun = Instant::now();
        let lines = (!quiet && !terminal).then(|| {
            let (sender, ended) = channel();
            let bar = bar.clone();
            let write = move || {
                while ended.recv_timeout(LINES_EVERY) == Err(RecvTimeoutError::Timeout) {
                    // A log that cannot be written is no reason to stop.
                    let _ = writeln!(std::io::stderr(), "{}", line(&bar, begun.elapsed()));
                }
            };
            (sender, std::thread::spawn(write))
        });
        Bar { bar, begun, lines }
    }

    /// Begins a stage of `total` units.
    pub fn begin(&self, what: &'static str, total: u64) {
        self.bar.set_prefix(what);
        self.bar.set_length(total);
        self.bar.set_position(0);
        self.bar.reset_eta();
    }

    /// That many more units are done.
    pub fn advance(&self, units: u64) {
        self.bar.inc(units);
    }

    /// `done` of `total` units of a stage are done.
    pub fn update(&self, what: &'static str, done: u64, total: u64) {
        if self.bar.prefix() != what || self.bar.length() != Some(total) {
            self.begin(what, total);
        }
        self.bar.set_position(done);
    }

    /// Takes the bar away; gives the time it stood.
    pub fn finish(self) -> Duration {
        self.begun.elapsed()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((sender, thread)) = self.lines.take() {
            drop(sender);
            // A thread that panicked has nothing left to write.
            let _ = thread.join();
        }
    }
}

/// A line for logs.
fn line(bar: &ProgressBar, time: Duration) -> String {
    let (done, total) = (bar.position(), bar.length().unwrap_or(0));
    let percent = 100.0 * done as f64 / total.max(1) as f64;
    // At the mean rate so far; a bar that is not drawn estimates none itself.
    let remaining = match done {
        0 => String::new(),
        _ => {
            let share = total.saturating_sub(done) as f64 / done as f64;
            format!(", {} left", crate::report::duration(time.mul_f64(share)))
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
        assert_eq!(line(&bar, Duration::from_secs(130)), "simulate: 25 %, 2 min 10 s, 6 min 30 s left");
        bar.set_position(0);
        assert_eq!(line(&bar, Duration::from_secs(10)), "simulate: 0 %, 10.0 s");
    }
}
