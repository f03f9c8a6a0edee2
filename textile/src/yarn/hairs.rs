//! Hairs of a yarn: ends and loops of fibers that stand out of it.
//!
//! The spec gives statistics of their number and shape; `plywave_sim::cloth` grows them on the curves of a
//! cloth.

use serde::{Deserialize, Serialize};

/// Statistics of the hairs of a yarn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hairs {
    /// Hairs per millimeter of yarn.
    pub per_mm: f64,
    /// Mean of the exponentially distributed lengths of hairs, along the fiber [mm].
    pub length_mm: f64,
    /// Root mean square radius of the bends of a hair [mm]; a stiff fiber bends less.
    #[serde(default = "usual_curl_mm")]
    pub curl_mm: f64,
    /// Mean sine of the angle between a hair and the surface of its yarn at the root: near 0 it lies along
    /// the yarn, near 1 it stands upright.
    #[serde(default = "usual_rise")]
    pub rise: f64,
    /// Share of the hairs that are loops, with both ends in the yarn.
    #[serde(default)]
    pub loops: f64,
}

fn usual_curl_mm() -> f64 {
    0.5
}

fn usual_rise() -> f64 {
    0.5
}
