//! Errors of the runtime, as structured values. The message of each is one line that names the file, the key,
//! the value and a hint.

/// An error of loading, saving or checking data. `eval`, `sample` and `pdf` never fail.
///
/// ```
/// use plywave::{Error, PlyModel};
///
/// let error = PlyModel::from_bytes(b"no model", "broken.pwm").unwrap_err();
/// assert!(matches!(error, Error::Format { .. }) && error.to_string().starts_with("broken.pwm: "));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file could not be read or written.
    #[error("{file}: {source}")]
    Io {
        /// Path, as the caller passed it.
        file: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A key of a spec, or a tensor or field of a table or model, has a value that is not allowed.
    #[error("{file}: {key} = {value}: {hint}")]
    Invalid {
        /// Path, as the caller passed it.
        file: String,
        /// Key, with dots if nested.
        key: String,
        /// Invalid value, as text.
        value: String,
        /// Hint: the accepted values.
        hint: String,
    },
    /// The file has another format or version, or is damaged.
    #[error("{file}: {what}; {hint}")]
    Format {
        /// Path, as the caller passed it.
        file: String,
        /// Description of the problem.
        what: String,
        /// Hint: how to fix the problem.
        hint: String,
    },
}

/// A message as one printable line of at most `max_chars` characters, for any text from a file. Control
/// characters, Unicode's line and paragraph separators, and runs of spaces become one space. A longer text is
/// cut and ends in "...".
///
/// ```
/// assert_eq!(plywave::one_line("key\n  \u{1b}[31m\u{2028}", 20), "key [31m");
/// assert_eq!(plywave::one_line("0123456789", 8), "01234...");
/// ```
pub fn one_line(text: &str, max_chars: usize) -> String {
    let mut line: Vec<char> = Vec::new();
    for c in text.chars().map(|c| if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}') { ' ' } else { c }) {
        // One character more than fits shows that the text is longer.
        if line.len() > max_chars {
            break;
        }
        if c != ' ' || line.last().is_some_and(|last| *last != ' ') {
            line.push(c);
        }
    }
    if line.len() > max_chars {
        line.truncate(max_chars.saturating_sub(3));
        line.extend("...".chars().take(max_chars));
    }
    let end = line.iter().rposition(|c| *c != ' ').map_or(0, |last| last + 1);
    line.into_iter().take(end).collect()
}

/// Result with the runtime's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
