//! The number of threads of a command.

use crate::args::Cli;
use crate::failure::{Failure, Outcome};

/// Runs `work` on the number of threads that --threads gives.
pub fn on_threads<T: Send>(cli: &Cli, work: impl FnOnce() -> T + Send) -> Outcome<T> {
    match cli.threads {
        None => Ok(work()),
        Some(n) => match rayon::ThreadPoolBuilder::new().num_threads(n as usize).build() {
            Ok(pool) => Ok(pool.install(work)),
            Err(error) => Err(Failure::input("command line", "--threads", n, &format!("{error}; give fewer"))),
        },
    }
}
