//! Textile units: counts of yarns, and what follows from them.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Linear density of a single yarn, in the unit of its trade; one of the five.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub struct Count {
    /// Grams a kilometer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tex: Option<f64>,
    /// Grams in ten kilometers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dtex: Option<f64>,
    /// Denier: grams in nine kilometers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub den: Option<f64>,
    /// English cotton count: hanks of 840 yards to the pound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ne: Option<f64>,
    /// Metric count: kilometers to the kilogram.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nm: Option<f64>,
    /// Filaments of the yarn, for the record and for the number in each bundle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filaments: Option<u32>,
}

/// Tex of a yarn of which 840 yards weigh a pound: 453.59237 g over 768.096 m.
const TEX_OF_NE_1: f64 = 453.59237 / 0.768096;

impl Count {
    /// Units given, by name.
    pub fn units(&self) -> Vec<(&'static str, f64)> {
        [("tex", self.tex), ("dtex", self.dtex), ("den", self.den), ("ne", self.ne), ("nm", self.nm)]
            .into_iter()
            .filter_map(|(name, value)| value.map(|v| (name, v)))
            .collect()
    }

    /// Grams a kilometer; 0 where no unit is given.
    pub fn tex(&self) -> f64 {
        match self.units().first() {
            Some(("tex", x)) => *x,
            Some(("dtex", x)) => x / 10.0,
            Some(("den", x)) => x / 9.0,
            Some(("ne", x)) => TEX_OF_NE_1 / x,
            Some(("nm", x)) => 1000.0 / x,
            _ => 0.0,
        }
    }
}

/// Area of the fibers in a yarn's section [um2]: grams a kilometer over grams a cubic centimeter.
pub(super) fn fiber_area_um2(tex: f64, density_g_per_cm3: f64) -> f64 {
    1000.0 * tex / density_g_per_cm3
}

/// Radius of a round yarn [um] of which fibers fill the share `packing`.
pub(super) fn round_radius_um(fiber_area_um2: f64, packing: f64) -> f64 {
    (fiber_area_um2 / (packing * PI)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(text: &str) -> Count {
        toml::from_str(text).unwrap()
    }

    /// Factors of ISO 1144 and ISO 2947: 1 tex is 9 den, Ne 590.5, Nm 1000.
    #[test]
    fn units_agree() {
        for (text, tex) in [
            ("den = 75\nfilaments = 36", 8.333),
            ("dtex = 83.33", 8.333),
            ("ne = 7", 84.36),
            ("nm = 60", 16.667),
            ("tex = 5", 5.0),
        ] {
            assert!((count(text).tex() / tex - 1.0).abs() < 2e-4, "{text}: {}", count(text).tex());
        }
        assert_eq!(count("").tex(), 0.0);
    }

    /// Peirce 1937: a cotton yarn of specific volume 1.1 cm3/g is 37.4 sqrt(tex) um wide.
    #[test]
    fn widths_are_those_of_peirce() {
        let density = 1.52;
        let packing = 1.0 / 1.1 / density;
        let width = 2.0 * round_radius_um(fiber_area_um2(30.0, density), packing);
        assert!((width / (37.4 * 30f64.sqrt()) - 1.0).abs() < 1e-3, "{width}");
    }
}
