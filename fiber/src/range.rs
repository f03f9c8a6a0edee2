//! Checks of the parameters of analytic models against their ranges.

use plywave::{Error, Result};

/// The error of an invalid parameter.
pub(crate) fn invalid(model: &str, key: &str, value: impl ToString, hint: String) -> Error {
    Error::Invalid { file: model.into(), key: key.into(), value: value.to_string(), hint }
}

/// Returns an error if a parameter is outside its range or NaN.
pub(crate) fn parameter(model: &str, key: &str, value: f32, [low, high]: [f32; 2]) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(invalid(model, key, value, format!("use {low} to {high}")))
}
