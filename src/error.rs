//! Errors of the runtime: values, not prose. One line names the file, the key, the value and the hint.

/// What can go wrong where data enters. `eval`, `sample` and `pdf` never fail.
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
        /// Path as given.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A key of a spec, or a tensor or field of a table or model, holds a value that is not allowed.
    #[error("{file}: {key} = {value}: {hint}")]
    Invalid {
        /// Path as given.
        file: String,
        /// Key, dotted for nested ones.
        key: String,
        /// Offending value as text.
        value: String,
        /// What would be accepted.
        hint: String,
    },
    /// The file is not of the expected format or version, or is damaged.
    #[error("{file}: {what}; {hint}")]
    Format {
        /// Path as given.
        file: String,
        /// What is wrong.
        what: String,
        /// What to do about it.
        hint: String,
    },
}

/// Result with the runtime's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
