//! Checks on arrays, shared by loading and saving, and summaries for people who read headers.

use super::container::invalid;
use crate::Result;

/// Checks on the arrays of a file with this name.
pub struct Check<'a>(pub &'a str);

impl Check<'_> {
    /// Checks that every value is in `[low, high]` and finite.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn range(&self, name: &str, values: &[f64], low: f64, high: f64) -> Result<()> {
        match values.iter().position(|v| !(*v >= low && *v <= high)) {
            None => Ok(()),
            Some(i) => {
                let hint = format!("expected a value in [{low}, {high}]");
                Err(invalid(self.0, &format!("{name}[{i}]"), values[i], &hint))
            }
        }
    }

    /// [`Check::range`] for f32.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn range_f32(&self, name: &str, values: &[f32], low: f32, high: f32) -> Result<()> {
        match values.iter().position(|v| !(*v >= low && *v <= high)) {
            None => Ok(()),
            Some(i) => {
                let hint = format!("expected a value in [{low}, {high}]");
                Err(invalid(self.0, &format!("{name}[{i}]"), values[i], &hint))
            }
        }
    }

    /// Checks that the length is the product of `shape`.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn len(&self, name: &str, len: usize, shape: &[usize]) -> Result<()> {
        let want = shape.iter().try_fold(1usize, |a, b| a.checked_mul(*b));
        if want == Some(len) {
            return Ok(());
        }
        Err(invalid(self.0, name, format!("{len} values"), &format!("expected the shape {shape:?}")))
    }

    /// Checks that an axis is finite and strictly ascending.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn ascending(&self, name: &str, axis: &[f64]) -> Result<()> {
        self.range(name, axis, f64::MIN, f64::MAX)?;
        match axis.windows(2).position(|w| w[1] <= w[0]) {
            None => Ok(()),
            Some(i) => Err(invalid(self.0, &format!("{name}[{}]", i + 1), axis[i + 1], "the axis must ascend")),
        }
    }

    /// Checks that an axis ascends with equal steps, to 1e-6 of a step.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn uniform(&self, name: &str, axis: &[f64]) -> Result<()> {
        self.ascending(name, axis)?;
        let step = (axis[axis.len() - 1] - axis[0]) / (axis.len() - 1).max(1) as f64;
        for (i, v) in axis.iter().enumerate() {
            let want = axis[0] + step * i as f64;
            if (v - want).abs() > 1e-6 * step {
                let hint = format!("the axis must have equal steps: expected {want}");
                return Err(invalid(self.0, &format!("{name}[{i}]"), v, &hint));
            }
        }
        Ok(())
    }

    /// Checks the axis of incident latitudes: uniform from 0, below pi/2.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn theta_axis(&self, axis: &[f64]) -> Result<()> {
        self.uniform("theta_i", axis)?;
        self.range("theta_i", axis, 0.0, std::f64::consts::FRAC_PI_2)?;
        if axis[0] != 0.0 {
            return Err(invalid(self.0, "theta_i[0]", axis[0], "the first incident latitude must be 0"));
        }
        Ok(())
    }

    /// Checks the axis of offsets: uniform and symmetric about 0, since negative latitudes are mirrored onto
    /// it.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn h_axis(&self, axis: &[f64]) -> Result<()> {
        self.uniform("h_um", axis)?;
        self.range("h_um", axis, -1e6, 1e6)?;
        let (first, last) = (axis[0], axis[axis.len() - 1]);
        if (first + last).abs() > 1e-6 * last.abs() || (last <= 0.0 && axis.len() > 1) {
            return Err(invalid(
                self.0,
                "h_um[0]",
                first,
                &format!("the offsets must be symmetric: expected {}", -last),
            ));
        }
        Ok(())
    }

    /// Checks the axis of absorption coefficients: ascending from 0.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`].
    pub fn sigma_axis(&self, axis: &[f64]) -> Result<()> {
        self.ascending("sigma_per_um", axis)?;
        self.range("sigma_per_um", axis, 0.0, 1e6)?;
        if axis[0] != 0.0 {
            return Err(invalid(self.0, "sigma_per_um[0]", axis[0], "the first absorption coefficient must be 0"));
        }
        Ok(())
    }
}

/// Unit and length of an axis, for the JSON document.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct Axis {
    /// Name of the axis.
    pub name: String,
    /// Unit of the axis.
    pub unit: String,
    /// Number of nodes.
    pub size: usize,
}

impl Axis {
    /// Describes an axis.
    pub fn new(name: &str, unit: &str, size: usize) -> Self {
        Axis { name: name.to_string(), unit: unit.to_string(), size }
    }
}

/// Minimum, mean and maximum of an array, for the JSON document. For an empty array they are 0.
#[derive(serde::Serialize)]
pub struct Summary {
    min: f64,
    mean: f64,
    max: f64,
}

impl Summary {
    /// Summarizes some values.
    pub fn from_values(values: impl Iterator<Item = f64>) -> Self {
        let (mut min, mut max, mut sum, mut n) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0u64);
        for v in values {
            (min, max, sum, n) = (min.min(v), max.max(v), sum + v, n + 1);
        }
        if n == 0 { Summary { min: 0.0, mean: 0.0, max: 0.0 } } else { Summary { min, mean: sum / n as f64, max } }
    }
}
