//! Checks of the parameters of analytic models.

use crate::{Error, Result};

/// An error of a parameter.
pub(crate) fn invalid(model: &str, key: &str, value: impl ToString, hint: String) -> Error {
    Error::Invalid { file: model.into(), key: key.into(), value: value.to_string(), hint }
}

/// Refuses a parameter outside its range, and NaN.
pub(crate) fn parameter(model: &str, key: &str, value: f32, [low, high]: [f32; 2]) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(invalid(model, key, value, format!("use {low} to {high}")))
}
