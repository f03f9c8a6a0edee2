//! Errors of the fitter, with values as fields. Each prints as one line.

/// Errors of a fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A table's field has a length or value that cannot be fitted.
    #[error("table: {field} = {value}: {hint}")]
    Table {
        /// Name of the field.
        field: &'static str,
        /// Offending length or value.
        value: String,
        /// Accepted values.
        hint: &'static str,
    },
    /// The model of a table could not be saved, independent of its lobes.
    #[error("table: {key} = {value} of its model: {hint}; such a model could not be saved")]
    Unsavable {
        /// Field of the model.
        key: String,
        /// Its value.
        value: String,
        /// Accepted values, and a fix.
        hint: String,
    },
    /// An option is out of range.
    #[error("fit options: {name} = {value}: must be {allowed}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Offending value.
        value: usize,
        /// Allowed values.
        allowed: &'static str,
    },
    /// Model and table, or two models, differ in an axis.
    #[error(
        "axis {axis} differs: {model} nodes in the model, {table} in the other, or other values; use files of one yarn and preset"
    )]
    Axes {
        /// Name of the axis.
        axis: &'static str,
        /// Length in the model.
        model: usize,
        /// Length in the table or other model.
        table: usize,
    },
}
