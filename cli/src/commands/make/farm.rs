//! `plywave farm`: a library of yarns on many machines. The engine is Dask's, so the work is done by the
//! Python package, which this command starts.

use crate::args::{Cli, FarmArgs};
use crate::failure::{Failure, Outcome};
use std::ffi::OsString;
use std::process::{Command, Stdio};

/// Runs the command.
pub fn run(cli: &Cli, args: &FarmArgs) -> Outcome {
    let python = std::env::var_os("PYTHON").filter(|p| !p.is_empty()).unwrap_or_else(|| "python3".into());
    check_package(&python)?;
    let mut command = Command::new(&python);
    command.args(["-m", "plywave.farm"]).arg(&args.library);
    let mut option = |name: &str, value: Option<OsString>| {
        if let Some(value) = value {
            command.arg(name).arg(value);
        }
    };
    option("--output", args.output.clone().map(Into::into));
    option("--cache", args.cache.clone().map(Into::into));
    option("--scheduler", args.scheduler.clone().map(Into::into));
    option("--local", args.local.or(cli.threads).filter(|_| local(args)).map(|n| n.to_string().into()));
    option("--slurm", args.slurm.clone().map(Into::into));
    option("--jobs", args.jobs.map(|n| n.to_string().into()));
    option("--timeout", args.timeout.map(|s| s.to_string().into()));
    option("--retries", args.retries.map(|n| n.to_string().into()));
    option("--price", args.price.map(|p| p.to_string().into()));
    for (flag, is_set) in [("--json", cli.json), ("--quiet", cli.quiet)] {
        if is_set {
            command.arg(flag);
        }
    }
    let status = command.status().map_err(|e| missing(&python, &e.to_string()))?;
    match status.code() {
        Some(0) => Ok(()),
        Some(1) => Err(Failure::NotHeld),
        Some(code) => Err(Failure::Reported(u8::try_from(code).unwrap_or(2))),
        None => Err(Failure::Input(format!("{}: {status}", python.display()))),
    }
}

/// Whether the work runs on this machine.
fn local(args: &FarmArgs) -> bool {
    args.scheduler.is_none() && args.slurm.is_none()
}

/// Refuses a Python without the package and one with another version: shards of two versions are never mixed.
fn check_package(python: &OsString) -> Outcome {
    let found = Command::new(python)
        .args(["-c", "import plywave, plywave.farm; print(plywave.__version__)"])
        .stdin(Stdio::null())
        .output()
        .map_err(|e| missing(python, &e.to_string()))?;
    if !found.status.success() {
        let text = String::from_utf8_lossy(&found.stderr).into_owned();
        return Err(missing(python, text.lines().last().unwrap_or("it cannot import plywave")));
    }
    let theirs = String::from_utf8_lossy(&found.stdout).trim().to_string();
    let ours = env!("CARGO_PKG_VERSION");
    if theirs != ours {
        let hint = "install the same version of both";
        return Err(Failure::Input(format!("{}: plywave {theirs}, this program is {ours}; {hint}", python.display())));
    }
    Ok(())
}

fn missing(python: &OsString, why: &str) -> Failure {
    let hint = "run `pip install \"./python[cluster]\"` in the repository; the variable PYTHON selects another Python";
    Failure::Input(format!("{}: {why}; {hint}", python.display()))
}
