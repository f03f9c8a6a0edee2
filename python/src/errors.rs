//! Conversion of errors to exceptions, one line each, with the wording of the command line.

use plywave_pipeline::Error as PipelineError;
use plywave_runs::RunError;
use pyo3::PyErr;
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use std::io::ErrorKind;

pyo3::create_exception!(
    plywave,
    Error,
    PyValueError,
    "What plywave refuses: bad arrays, specs, files and options. The message is one line that names file, key, value and a hint, as the program prints it."
);

/// Failure of a call, before it becomes an exception.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Invalid input: becomes `plywave.Error`.
    Input(String),
    /// The user stopped the work: becomes `KeyboardInterrupt`.
    Interrupted(String),
    /// An exception that Python code raised, passed on unchanged.
    Python(PyErr),
}

/// Result of a call that may fail.
pub(crate) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    /// Invalid input, as the line `file: key = value: hint`.
    pub(crate) fn input(file: &str, key: &str, value: impl std::fmt::Display, hint: &str) -> Failure {
        Failure::Input(format!("{file}: {key} = {value}: {hint}"))
    }

    /// Failure of a simulation or its run; `file` is the spec or scene.
    pub(crate) fn of_run(error: impl Into<RunError>, file: &str) -> Failure {
        match error.into() {
            RunError::Interrupted { left, total } => interrupted(left, total),
            RunError::Runtime(error) => error.into(),
            error if error.is_of_parts() => Failure::Input(error.to_string()),
            other => Failure::Input(format!("{file}: {other}")),
        }
    }
}

fn interrupted(left: usize, total: usize) -> Failure {
    Failure::Interrupted(if total > 0 {
        format!("stopped with {left} of {total} shards left")
    } else {
        "stopped".into()
    })
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Failure {
        Failure::Python(error)
    }
}

impl From<PipelineError> for Failure {
    fn from(error: PipelineError) -> Failure {
        match error {
            PipelineError::Interrupted { left, total } => interrupted(left, total),
            PipelineError::Runtime(error) => error.into(),
            other => Failure::Input(other.to_string()),
        }
    }
}

impl From<plywave::Error> for Failure {
    fn from(error: plywave::Error) -> Failure {
        match error {
            // The message of the system names the file and the reason.
            plywave::Error::Io { file, source }
                if source.kind() == ErrorKind::NotFound && source.get_ref().is_some() =>
            {
                Failure::Input(format!("{file}: {source}"))
            }
            plywave::Error::Io { file, source } if source.kind() == ErrorKind::NotFound => {
                Failure::Input(format!("{file}: no such file; check the path"))
            }
            plywave::Error::Io { file, source } => Failure::Input(format!("{file}: {source}; {}", hint_of(&source))),
            other => Failure::Input(other.to_string()),
        }
    }
}

/// Largest number of characters of a message.
const MAX: usize = 1999;

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        match failure {
            Failure::Input(line) => Error::new_err(plywave::one_line(&line, MAX)),
            Failure::Interrupted(line) => PyKeyboardInterrupt::new_err(plywave::one_line(&line, MAX)),
            Failure::Python(error) => error,
        }
    }
}

/// Hint for a file that cannot be read or written.
fn hint_of(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "make room there, or choose another place",
        ErrorKind::FileTooLarge => "raise the limit of file sizes, or choose another place",
        _ => "check the path and its rights",
    }
}
