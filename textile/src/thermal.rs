//! Thermal properties of a cloth, as files of window programs give them.

use serde::{Deserialize, Serialize};

/// Thermal properties of a cloth. Absent values are derived from usual fibers and the cloth's openness when a
/// file for a window program is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thermal {
    /// Thickness measured by a gauge [um].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_um: Option<f64>,
    /// Thermal conductivity across the cloth [W/(m K)].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductivity_w_per_m_k: Option<f64>,
    /// Hemispherical emissivity of the face near 10 um, including gaps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissivity_front: Option<f64>,
    /// Hemispherical emissivity of the back near 10 um, including gaps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissivity_back: Option<f64>,
    /// Hemispherical transmittance near 10 um.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ir_transmittance: Option<f64>,
    /// Share of the area through which air flows freely.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub permeability: Option<f64>,
}

#[cfg(test)]
mod tests {
    use crate::ClothSpec;

    const KNIT: &str = "name = \"k\"\n[knit]\nkind = \"jersey\"\nwales_per_cm = 10\ncourses_per_cm = 14\nloop_mm = 3\n\
                        [yarn]\nfiber = \"cotton\"\ncount = \"20 tex\"\n";

    #[test]
    fn heat_is_taken_or_refused() {
        let parse = |keys: &str| ClothSpec::parse(&format!("{KNIT}[thermal]\n{keys}"), "k.toml");
        // Values of a shade from pyWinCalc's examples; their sum may be at most 1.
        let thermal = parse("emissivity_front = 0.79626\nir_transmittance = 0.10916").unwrap().thermal.unwrap();
        assert_eq!((thermal.emissivity_front, thermal.ir_transmittance), (Some(0.79626), Some(0.10916)));
        assert!(parse("emissivity_front = 0.7\nemissivity_back = 0.9\nir_transmittance = 0.1").is_ok());
        for (keys, expected) in [
            ("emissivity_front = 1.2", "thermal.emissivity_front = 1.2: use a number from 0 to 1"),
            ("conductivity_w_per_m_k = 0", "thermal.conductivity_w_per_m_k = 0: use a number from 0.001 to 1000"),
            ("openness = 0.1", "thermal.openness = 0.1: unknown key"),
            ("emissivity_back = 0.8\nir_transmittance = 0.3", "thermal.emissivity_back = 0.8: must be 1 - ir_transm"),
        ] {
            let message = parse(keys).unwrap_err().to_string();
            assert!(message.starts_with("k.toml: ") && message.contains(expected), "got {message}\nwant {expected}");
        }
    }
}
