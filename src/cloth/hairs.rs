//! Hairs of a yarn: ends and loops of fibers that stand out of it.
//!
//! Their numbers and shapes alone; `plywave_sim::cloth` grows them on the curves of a cloth.

use serde::{Deserialize, Serialize};

/// Hairs of a yarn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hairs {
    /// Hairs a millimeter of yarn.
    pub per_mm: f64,
    /// Mean length of a hair along the fiber, of exponentially distributed lengths [mm].
    pub length_mm: f64,
    /// Root mean square radius of the bends of a hair [mm]: a stiff fiber bends less.
    #[serde(default = "usual_curl_mm")]
    pub curl_mm: f64,
    /// Mean sine of the angle between a hair and the surface of its yarn at the root: near 0 it lies along
    /// the yarn, near 1 it stands off.
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
