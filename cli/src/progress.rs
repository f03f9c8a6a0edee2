//! Progress bars on stderr, silent when it is not a terminal or `--quiet` is given, and Ctrl-C.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Set by the first Ctrl-C during stoppable work, which looks at it between shards.
pub static STOP: AtomicBool = AtomicBool::new(false);
static STOPPABLE: AtomicBool = AtomicBool::new(false);

/// Makes the first Ctrl-C stop the work in good order where it can be, else (and the second one always) end the program at once.
/// Shards already written stay whole either way.
pub fn install_stop() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
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
        // Fails only when the system has no room for a handler: Ctrl-C then ends the program at once, and --resume still works.
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
const RESUMABLE: [&str; 7] = ["simulate", "build", "tabulate", "compare", "speckle", "render", "gallery"];

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
}

impl Bar {
    /// A bar named `what` that counts `unit`s, or a silent one.
    pub fn new(what: &'static str, unit: &'static str, quiet: bool) -> Self {
        let hidden = quiet || !std::io::stderr().is_terminal();
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
        Bar { bar, begun: Instant::now() }
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
        if self.bar.prefix() != what {
            self.begin(what, total);
        }
        self.bar.set_position(done);
    }

    /// Takes the bar away; gives the time it stood.
    pub fn finish(self) -> Duration {
        self.bar.finish_and_clear();
        self.begun.elapsed()
    }
}
