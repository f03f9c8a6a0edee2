//! The light that a color describes, and the cloth's brightness over the absorption of its fibers in each
//! of these meanings.
//!
//! All are of a cloth whose yarns all have the same absorption, at nodes of it:
//!
//! - under a sky all round, light that was scattered over the light that met fibers; cloth files have it;
//! - reflected: R of the cloth's face, mean over views by their cosine, of light that is even over the
//!   viewer's half;
//! - folded: R of a pile of sheets, face up and face down in turn, seen 8 degrees off the normal under light
//!   that is even over the viewer's half, as a d/8 spectrophotometer has it. Light between sheets is taken as
//!   even: with R and T of a sheet from either side and X, Y the reflectances of piles that begin with the
//!   other side, `Y = R_f + T_f X T_b / (1 - R_b X)`, and alike for X; of a pile without end that neither
//!   absorbs nor lets through, 1.

use crate::color::AlbedoCurve;
use serde::{Deserialize, Serialize};

/// Light that a color describes. In each meaning all yarns count as if they had it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorOf {
    /// The cloth's fibers under a sky all round: reflected and transmitted light over the light that meets
    /// fibers.
    #[default]
    EvenSky,
    /// The cloth's face, lit from the viewer's side, with dark behind it: the mean over views.
    Reflected,
    /// The cloth folded until no light comes through, under even light 8 degrees off the normal (d/8), as
    /// textile labs read it.
    Folded,
}

impl ColorOf {
    /// As specs have it.
    pub fn name(self) -> &'static str {
        match self {
            ColorOf::EvenSky => "even_sky",
            ColorOf::Reflected => "reflected",
            ColorOf::Folded => "folded",
        }
    }
}

/// Nodes of absorption at which R and T are found, dense towards infinite absorption in
/// `v = 1 / (1 + sigma L)` with L = 150 um: at 0.1 and 1 per um a cloth's reflectance differs by a factor of
/// two.
pub const NODES: usize = 22;
/// v falls by this power of the node.
pub(super) const POWER: f64 = 1.5;
/// Absorption of the last node [1/um], for an infinite one.
const DARKEST: f64 = 3.0;
/// Length L [um].
pub(super) const LENGTH_UM: f64 = 150.0;

/// Absorption at `1 / (1 + sigma L)`.
pub(super) fn sigma_of(v: f64) -> f64 {
    if v > 0.0 { ((1.0 / v - 1.0) / LENGTH_UM).min(DARKEST) } else { DARKEST }
}

pub(super) fn v_of(node: usize) -> f64 {
    (1.0 - node as f64 / (NODES - 1) as f64).powf(POWER)
}

/// The curve of values at the nodes.
pub(crate) fn of_nodes(values: &[f64; NODES]) -> AlbedoCurve {
    AlbedoCurve::of_nodes(LENGTH_UM, values.iter().enumerate().map(|(node, value)| (v_of(node), *value)))
}
