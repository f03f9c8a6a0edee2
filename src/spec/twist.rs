//! Twist of fibers in a ply and of plies in a yarn: its hand, its rate, and rates that close over a period.

use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Handedness of the fibers' helix. With Z twist (right-handed helix) the azimuth of a fiber increases with
/// z, as `2 pi z / pitch`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Handedness {
    /// Right-handed helix.
    #[default]
    Z,
    /// Left-handed helix.
    S,
}

/// Rate at which something turns about an axis, positive for Z (right-handed).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    rad_per_um: f64,
}

impl Twist {
    /// The twist of a helix of this pitch [um]; none without a pitch.
    pub fn from_pitch(pitch_um: Option<f64>, hand: Handedness) -> Twist {
        Twist { rad_per_um: pitch_um.map_or(0.0, |pitch| hand.sign() * TAU / pitch) }
    }

    /// The twist of so many turns a meter.
    pub fn from_turns_per_m(turns: f64, hand: Handedness) -> Twist {
        Twist { rad_per_um: hand.sign() * TAU * turns * 1e-6 }
    }

    /// A twist of this rate [rad/um].
    pub fn from_rad_per_um(rad_per_um: f64) -> Twist {
        Twist { rad_per_um }
    }

    /// Its rate [rad/um].
    pub fn rad_per_um(self) -> f64 {
        self.rad_per_um
    }

    /// Turn [rad] over a length [um] that comes nearest to this twist and, together with `frame_rad` by which
    /// the frame itself turns, is a whole number of parts of a turn, `symmetry` parts each.
    pub fn closed_rad(self, length_um: f64, symmetry: f64, frame_rad: f64) -> f64 {
        TAU * ((self.rad_per_um * length_um + frame_rad) * symmetry / TAU).round() / symmetry - frame_rad
    }
}

impl Handedness {
    fn sign(self) -> f64 {
        match self {
            Handedness::Z => 1.0,
            Handedness::S => -1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twists_have_the_units_and_signs_of_their_sources() {
        assert_eq!(Twist::from_pitch(Some(800.0), Handedness::S).rad_per_um(), -TAU / 800.0);
        assert_eq!(Twist::from_pitch(None, Handedness::S).rad_per_um(), 0.0);
        let turns = Twist::from_turns_per_m(500.0, Handedness::Z).rad_per_um() / TAU;
        assert!((turns * 1e6 - 500.0).abs() < 1e-9, "{turns}");
    }

    #[test]
    fn closed_twists_are_whole_parts_of_turns_with_the_frame() {
        let twist = Twist::from_turns_per_m(400.0, Handedness::S);
        for (length_um, symmetry, frame_rad) in [(9000.0, 1.0, 0.0), (9000.0, 3.0, 0.0), (9000.0, 1.0, 0.7)] {
            let rad = twist.closed_rad(length_um, symmetry, frame_rad);
            let parts = (rad + frame_rad) * symmetry / TAU;
            assert!((parts - parts.round()).abs() < 1e-12, "{parts}");
            assert!((rad - twist.rad_per_um() * length_um).abs() <= 0.5 * TAU / symmetry + 1e-12);
        }
    }
}
