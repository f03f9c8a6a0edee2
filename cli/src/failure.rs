//! How a command ends when it does not end well, and the one line it says.

use std::process::ExitCode;

/// Why a command stopped.
#[derive(Debug)]
pub enum Failure {
    /// Bad input or an output that cannot be written: exit code 2.
    Input(String),
    /// A check or a comparison did not hold; the report has been printed: exit code 1.
    NotHeld,
    /// Another program did the work and has said why not: its exit code.
    ProgressNames(u8),
    /// The user stopped the work: exit code 130.
    Interrupted(String),
    /// The reader of the standard output went away: nothing to say.
    BrokenPipe,
}

/// Result of a command.
pub type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    /// `error: file: key = value: hint`.
    pub fn input(file: impl std::fmt::Display, key: &str, value: impl std::fmt::Display, hint: &str) -> Self {
        Failure::Input(format!("{file}: {key} = {value}: {hint}"))
    }

    /// Says what there is to say on stderr; gives the exit code.
    pub fn report(&self) -> ExitCode {
        use std::io::Write;
        let (line, code) = match self {
            Failure::Input(line) => (format!("error: {}", one_line(line)), 2),
            Failure::Interrupted(line) => (one_line(line), 130),
            Failure::NotHeld => return ExitCode::from(1),
            Failure::ProgressNames(code) => return ExitCode::from(*code),
            Failure::BrokenPipe => return ExitCode::SUCCESS,
        };
        // Nobody is left to tell when stderr itself is closed.
        let _ = writeln!(std::io::stderr(), "{line}");
        ExitCode::from(code)
    }
}

impl From<plywave::Error> for Failure {
    fn from(error: plywave::Error) -> Self {
        match error {
            // With a message of its own, which tells what there is.
            plywave::Error::Io { file, source }
                if source.kind() == std::io::ErrorKind::NotFound && source.get_ref().is_some() =>
            {
                Failure::Input(format!("{file}: {source}"))
            }
            plywave::Error::Io { file, source } if source.kind() == std::io::ErrorKind::NotFound => {
                Failure::Input(format!("{file}: no such file; check the path"))
            }
            plywave::Error::Io { file, source } => Failure::Input(format!("{file}: {source}; {}", hint_of(&source))),
            other => Failure::Input(other.to_string()),
        }
    }
}

/// What to do about a file that could not be read or written.
fn hint_of(error: &std::io::Error) -> &'static str {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    match error.kind() {
        StorageFull | QuotaExceeded => "make room there, or choose another place",
        FileTooLarge => "raise the limit of file sizes, or choose another place",
        _ => "check the path and its rights",
    }
}

/// A message as one printable line of at most 2000 characters, whatever a file put into it.
pub fn one_line(text: &str) -> String {
    plywave::one_line(text, 2000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_printable_line() {
        assert_eq!(one_line("a\n  b\x1b[31m\r\n"), "a b [31m");
        assert_eq!(one_line(&"x".repeat(9000)).len(), 2000);
    }
}
