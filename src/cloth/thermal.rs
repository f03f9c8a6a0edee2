//! What a cloth does to heat, as files of windows have it.

use serde::{Deserialize, Serialize};

/// Heat through a cloth. Numbers that are absent are those of usual fibers and of the cloth's openness, found
/// where a file of a window is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thermal {
    /// Thickness as a gauge measures it [um].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_um: Option<f64>,
    /// Thermal conductivity across the cloth [W/(m K)].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conductivity_w_per_m_k: Option<f64>,
    /// Hemispherical emissivity of the face near 10 um, gaps included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissivity_front: Option<f64>,
    /// That of the back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissivity_back: Option<f64>,
    /// Hemispherical transmittance near 10 um.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ir_transmittance: Option<f64>,
    /// Share of the area through which air flows freely.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub permeability: Option<f64>,
}
