//! Progress bars on stderr, silent when it is not a terminal or `--quiet` is given, and Ctrl-C as a flag.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Set by the first Ctrl-C. Long work looks at it between shards.
pub static STOP: AtomicBool = AtomicBool::new(false);

/// Makes the first Ctrl-C set [`STOP`] and the second end the program at once. Parts already written stay whole either way.
pub fn install_stop() {
    let handler = || {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    };
    // Only fails when a handler is there already; Ctrl-C then ends the program as it does any other, and --resume still works.
    let _ = ctrlc::set_handler(handler);
}

/// A bar for one stage of the work.
pub struct Bar {
    bar: ProgressBar,
    begun: Instant,
}

impl Bar {
    /// A bar named `what` that counts `unit`s, or a silent one.
    pub fn new(what: &'static str, unit: &'static str, quiet: bool) -> Self {
        let hidden = quiet || !std::io::stderr().is_terminal();
        let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
        let bar = ProgressBar::with_draw_target(Some(0), target);
        let template = format!("{{prefix:>9}} [{{bar:32}}] {{percent:>3}} %  {{rate}} {unit}/s  {{elapsed}}, {{eta}} left");
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

    /// `done` of `total` units are finished. Work taken over from an earlier run does not count towards the rate.
    pub fn update(&self, done: u64, total: u64) {
        if self.bar.length() != Some(total) {
            self.bar.set_length(total);
            if done > 0 {
                self.bar.set_position(done);
                self.bar.reset_eta();
                return;
            }
        }
        self.bar.set_position(done);
    }

    /// Takes the bar away; gives the time it stood.
    pub fn finish(self) -> Duration {
        self.bar.finish_and_clear();
        self.begun.elapsed()
    }
}
