//! Failures of a command, with their exit codes and messages of one line.

use std::process::ExitCode;

/// Reason for which a command stopped.
#[derive(Debug)]
pub enum Failure {
    /// Invalid input, or an output that cannot be written: exit code 2.
    Input(String),
    /// A check or a comparison failed, and the report has been printed: exit code 1.
    NotHeld,
    /// Another program ran the command and has reported its failure: that program's exit code.
    Reported(u8),
    /// The user stopped the work: exit code 130.
    Interrupted(String),
    /// The reader of the standard output closed it; no message is printed.
    BrokenPipe,
}

/// Result of a command.
pub type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    /// `error: file: key = value: hint`.
    pub fn input(file: impl std::fmt::Display, key: &str, value: impl std::fmt::Display, hint: &str) -> Self {
        Failure::Input(format!("{file}: {key} = {value}: {hint}"))
    }

    /// Prints the message on stderr; returns the exit code.
    pub fn report(&self) -> ExitCode {
        use std::io::Write;
        let (line, code) = match self {
            Failure::Input(line) => (format!("error: {}", one_line(line)), 2),
            Failure::Interrupted(line) => (one_line(line), 130),
            Failure::NotHeld => return ExitCode::from(1),
            Failure::Reported(code) => return ExitCode::from(*code),
            Failure::BrokenPipe => return ExitCode::SUCCESS,
        };
        // The write fails only if stderr is closed.
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

/// Hint for a file that cannot be read or written.
fn hint_of(error: &std::io::Error) -> &'static str {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    match error.kind() {
        StorageFull | QuotaExceeded => "make room there, or choose another place",
        FileTooLarge => "raise the limit of file sizes, or choose another place",
        _ => "check the path and its rights",
    }
}

/// A message as one printable line of at most 2000 characters.
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
