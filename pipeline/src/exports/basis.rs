//! Patches of the hemisphere: the basis of Klems, and the squares of Shirley and Chiu (1997).
//!
//! A direction is represented by its projection on the plane of the cloth, a point of the unit disk, in a
//! frame that all blocks of a file share. The frame of WINDOW and Radiance has X to the right and Y up as
//! seen from indoors and Z into the room, and the front of a layer faces outdoors. In terms of the cloth's
//! frame, whose face is the front, `X = -x, Y = y, Z = -z`. Outgoing light is numbered by its direction of
//! propagation; incident light is numbered by the direction in which it would continue, opposite to its
//! source. Straight and mirrored light thus stay in their patch, on the diagonal of a matrix.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// Rings of the full basis of Klems: upper bound of theta [degrees], patches.
pub const KLEMS_RINGS: [(f64, usize); 9] =
    [(5.0, 1), (15.0, 8), (25.0, 16), (35.0, 20), (45.0, 24), (55.0, 24), (65.0, 24), (75.0, 16), (90.0, 12)];

/// Division of the hemisphere into patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// The 145 patches of Klems; the first patch of each ring is centered at azimuth 0.
    Klems,
    /// `side * side` squares of equal projected solid angle, with the first coordinate fastest (Shirley and
    /// Chiu 1997).
    Squares {
        /// Number of squares along an edge.
        side: usize,
    },
}

/// Ring of a Klems patch, and the patch's number within the ring.
fn ring_of(patch: usize) -> (usize, usize) {
    let mut first = 0;
    for (ring, (_, count)) in KLEMS_RINGS.iter().enumerate() {
        if patch < first + count {
            return (ring, patch - first);
        }
        first += count;
    }
    (KLEMS_RINGS.len() - 1, 0)
}

/// Squared sines of the bounds of a ring.
fn sines(ring: usize) -> [f64; 2] {
    let low = if ring == 0 { 0.0 } else { KLEMS_RINGS[ring - 1].0 };
    [low, KLEMS_RINGS[ring].0].map(|deg: f64| deg.to_radians().sin().powi(2))
}

impl Basis {
    /// Number of patches.
    pub fn len(self) -> usize {
        match self {
            Basis::Klems => KLEMS_RINGS.iter().map(|(_, count)| count).sum(),
            Basis::Squares { side } => side * side,
        }
    }

    /// Whether there are no patches.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Projected solid angle of a patch [sr]; the sum over all patches is pi.
    pub fn projected_solid_angle(self, patch: usize) -> f64 {
        match self {
            Basis::Klems => {
                let (ring, _) = ring_of(patch);
                let [low, high] = sines(ring);
                PI * (high - low) / KLEMS_RINGS[ring].1 as f64
            }
            Basis::Squares { side } => PI / (side * side) as f64,
        }
    }

    /// The point of the disk at fractional coordinates within a patch; equal areas of these coordinates have
    /// equal projected solid angles.
    pub fn disk(self, patch: usize, [u, v]: [f64; 2]) -> [f64; 2] {
        match self {
            Basis::Klems => {
                let (ring, number) = ring_of(patch);
                let [low, high] = sines(ring);
                let r = (low + u * (high - low)).sqrt();
                let (sin, cos) = (TAU * (number as f64 + v - 0.5) / KLEMS_RINGS[ring].1 as f64).sin_cos();
                [r * cos, r * sin]
            }
            Basis::Squares { side } => {
                let at = |k: usize, u: f64| (k as f64 + u) / side as f64;
                square_to_disk([at(patch % side, u), at(patch / side, v)])
            }
        }
    }

    /// The patch whose directions are opposite in azimuth.
    pub fn opposite(self, patch: usize) -> usize {
        match self {
            Basis::Klems => {
                let (ring, number) = ring_of(patch);
                let count = KLEMS_RINGS[ring].1;
                patch - number + (number + count / 2) % count
            }
            Basis::Squares { side } => side * side - 1 - patch,
        }
    }
}

/// Maps the unit square to the unit disk, preserving ratios of areas (Shirley and Chiu 1997).
pub fn square_to_disk(at: [f64; 2]) -> [f64; 2] {
    let [a, b] = at.map(|v| 2.0 * v - 1.0);
    let (r, phi) = match (a > -b, a > b, a < b) {
        (true, true, _) => (a, FRAC_PI_4 * (b / a)),
        (true, false, _) => (b, FRAC_PI_4 * (2.0 - a / b)),
        (false, _, true) => (-a, FRAC_PI_4 * (4.0 + b / a)),
        (false, _, false) if b != 0.0 => (-b, FRAC_PI_4 * (6.0 - a / b)),
        _ => (0.0, 0.0),
    };
    [r * phi.cos(), r * phi.sin()]
}

/// Direction towards the source of incident light, in the cloth's frame, for the point of the disk that
/// numbers it.
pub fn incident([x, y]: [f64; 2], is_face: bool) -> [f32; 3] {
    direction([x, -y], is_face)
}

/// Direction of propagation of outgoing light, in the cloth's frame, for its point of the disk.
pub fn outgoing([x, y]: [f64; 2], is_face: bool) -> [f32; 3] {
    direction([-x, y], is_face)
}

fn direction([x, y]: [f64; 2], is_face: bool) -> [f32; 3] {
    // The direction stays out of the plane of the cloth, where the mean is undefined.
    let r = x.hypot(y);
    let scale = if r > 0.999_95 { 0.999_95 / r } else { 1.0 };
    let (x, y) = (x * scale, y * scale);
    let z = (1.0 - x * x - y * y).sqrt();
    [x as f32, y as f32, (if is_face { z } else { -z }) as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Patches cover the hemisphere once, and each patch has an opposite one.
    #[test]
    fn patches_are_those_of_the_bases() {
        assert_eq!(Basis::Klems.len(), 145);
        for basis in [Basis::Klems, Basis::Squares { side: 16 }] {
            let sum: f64 = (0..basis.len()).map(|p| basis.projected_solid_angle(p)).sum();
            assert!((sum - PI).abs() < 1e-12, "{sum}");
            for patch in 0..basis.len() {
                let ([x, y], [a, b]) = (basis.disk(patch, [0.5; 2]), basis.disk(basis.opposite(patch), [0.5; 2]));
                if patch > 0 || basis != Basis::Klems {
                    assert!((x + a).abs() < 1e-12 && (y + b).abs() < 1e-12, "{basis:?} {patch}: {x} {y}, {a} {b}");
                }
            }
        }
        // The second patch is at theta 10 degrees and azimuth 0.
        let [x, y] = Basis::Klems.disk(1, [0.5; 2]);
        assert!(y.abs() < 1e-12 && x > 5f64.to_radians().sin() && x < 15f64.to_radians().sin());
    }

    /// Straight light has the same number on both sides, and so has mirrored light.
    #[test]
    fn straight_light_lies_on_the_diagonal() {
        for at in [[0.3, -0.5], [-0.7, 0.1]] {
            for is_face in [true, false] {
                let wo = incident(at, is_face);
                let on = outgoing(at, !is_face);
                assert!((0..3).all(|k| (on[k] + wo[k]).abs() < 1e-6), "{wo:?} {on:?}");
                let mirrored = outgoing(at, is_face);
                assert!((mirrored[0] + wo[0]).abs() < 1e-6 && (mirrored[1] + wo[1]).abs() < 1e-6);
            }
        }
    }
}
