//! The sense in which colors of yarns are meant, and the cloth's brightness as a function of absorption in
//! each of these senses.
//!
//! Each curve is for a cloth whose yarns all have the same absorption, tabulated at nodes of absorption:
//!
//! - Even sky: under uniform light from all directions, the scattered light divided by the light that hits
//!   fibers.
//! - Reflected: the reflectance R of the cloth's face under light that is uniform over the viewer's half
//!   space, averaged over views with their cosine as weight.
//! - Folded: the reflectance R of a pile of sheets, face up and face down in turn, viewed at 8 degrees from
//!   the normal under light that is uniform over the viewer's half space, as in a d/8 spectrophotometer.
//!   Light between sheets is taken as uniform. With R and T of a sheet from either side, and X and Y the
//!   reflectances of piles that begin with the one and the other side, `Y = R_f + T_f X T_b / (1 - R_b X)`,
//!   and correspondingly for X. An infinite pile that neither absorbs nor transmits has the reflectance 1.

use crate::color::AlbedoCurve;
use serde::{Deserialize, Serialize};

/// Sense in which colors are meant. In each of them the color is that of a cloth whose yarns all have it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorOf {
    /// The cloth's fibers under uniform light from all directions: reflected and transmitted light over the
    /// light that hits fibers.
    #[default]
    EvenSky,
    /// The cloth's face, lit from the viewer's side and in front of black, averaged over views.
    Reflected,
    /// The cloth folded until it is opaque, viewed at 8 degrees from the normal under uniform light (d/8), as
    /// textile labs measure it.
    Folded,
}

impl ColorOf {
    /// Name in a spec.
    pub fn name(self) -> &'static str {
        match self {
            ColorOf::EvenSky => "even_sky",
            ColorOf::Reflected => "reflected",
            ColorOf::Folded => "folded",
        }
    }
}

/// Number of nodes of absorption at which R and T are tabulated, dense in `v = 1 / (1 + sigma L)` towards
/// infinite absorption: at 0.1 and 1 per um a cloth's reflectance differs by a factor of two.
pub const NODES: usize = 22;
/// Number of nodes for a pile of sheets, dense towards clear fibers: its reflectance falls with the square
/// root of a small absorption.
pub const PILE_NODES: usize = 65;
/// Exponent of the spacing of v at [`NODES`].
pub const POWER: f64 = 1.5;
/// Absorption of the last node [1/um]; it represents infinite absorption.
const DARKEST: f64 = 3.0;
/// Length L [um].
pub const LENGTH_UM: f64 = 150.0;

/// Absorption [1/um] at `v = 1 / (1 + sigma L)`; clamped for v near 0.
pub fn sigma_of(v: f64) -> f64 {
    if v > 0.0 { ((1.0 / v - 1.0) / LENGTH_UM).min(DARKEST) } else { DARKEST }
}

/// v at one of the [`NODES`].
pub fn v_of(node: usize) -> f64 {
    (1.0 - node as f64 / (NODES - 1) as f64).powf(POWER)
}

/// v at one of the [`PILE_NODES`].
pub fn v_of_pile(node: usize) -> f64 {
    let x = node as f64 / (PILE_NODES - 1) as f64;
    1.0 - x * x
}

/// Brightness of a cloth at nodes of absorption, clear fibers first, in each sense of [`ColorOf`].
#[derive(Clone, Debug, PartialEq)]
pub struct Brightness {
    /// [`ColorOf::EvenSky`].
    pub even_sky: [f64; NODES],
    /// [`ColorOf::Reflected`].
    pub reflected: [f64; NODES],
    /// [`ColorOf::Folded`].
    pub folded: [f64; PILE_NODES],
}

impl Brightness {
    /// A placeholder before the brightness is computed.
    pub const NONE: Brightness =
        Brightness { even_sky: [0.0; NODES], reflected: [0.0; NODES], folded: [0.0; PILE_NODES] };

    /// Brightness as a function of absorption.
    pub fn curve(&self, of: ColorOf) -> AlbedoCurve {
        let nodes = |values: &[f64], v: fn(usize) -> f64| {
            AlbedoCurve::of_nodes(LENGTH_UM, values.iter().enumerate().map(|(node, value)| (v(node), *value)))
        };
        match of {
            ColorOf::EvenSky => nodes(&self.even_sky, v_of),
            ColorOf::Reflected => nodes(&self.reflected, v_of),
            ColorOf::Folded => nodes(&self.folded, v_of_pile),
        }
    }
}
