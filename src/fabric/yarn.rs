//! A yarn at one place and a line through it: which ply is met first, at which theta_i and h (Yu 2025, 3.2).
//!
//! In the yarn's frame (c across, n up, t along) the axis is straight and ply k's is the helix
//! `(D cos psi, D sin psi, s)`, `psi = phase +- 2 pi s / pitch + 2 pi k / P`, D the radius of the circle the
//! plies lie on. The line runs through (a, 0, 0), a point of the yarn's middle plane, along w.
//!
//! Every ply is replaced by the straight cylinder along its tangent where the yarn is straightened, and the
//! line is followed from cylinder to cylinder (`walk.rs`). The ply that is met is replaced once more, by the
//! cylinder along the tangent at the place of its axis next to where the line enters it; h is the distance of
//! the line from this tangent, |h| <= R at every hit.
//! For one ply, and for parallel plies, this is exact. `twisted_plies_are_near_true_helices` measures the
//! rest, and `tests/it/weave.rs` plies of bent yarns.

use super::profile::{Profile, Profile32};
use crate::math::simd::{atan2, signed, sin_cos_half_turns};
use crate::math::vec3::{cross, dot};
use crate::spec::Handedness;

/// Most plies of a yarn.
pub const MAX_PLIES: usize = 7;

/// Shape and place of the yarns of one family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct YarnShape {
    /// Plies of the yarn, 1 to 7.
    pub plies: u32,
    /// Radius R of a ply [um].
    pub ply_radius_um: f64,
    /// Pitch of the plies' helix [um]; `None` for parallel plies.
    pub ply_pitch_um: Option<f64>,
    /// Hand of the plies' helix; Z is right-handed.
    pub handedness: Handedness,
    /// From axis to axis [um].
    pub spacing_um: f64,
    /// Amplitude of the axis' height over what lies between the layers, the distance `r_warp + r_weft` of the
    /// axes of two touching yarns at a crossing: 0 is a straight yarn. Round yarns that touch have crimps
    /// that add up to 1 (the crimp heights of Peirce 1937 add up to the yarns' diameters); yarns flattened in
    /// the cloth have less.
    pub crimp: f64,
    /// The beam is dark beyond this distance from its center [um].
    pub d_cut_um: f64,
}

impl YarnShape {
    /// Distance D of the plies' axes from the yarn's axis [um]: `R / sin(pi / P)`, at which parallel plies
    /// touch; 0 for one ply.
    pub fn circle_um(&self) -> f64 {
        if self.plies < 2 { 0.0 } else { self.ply_radius_um / (std::f64::consts::PI / f64::from(self.plies)).sin() }
    }

    /// Height of the axis between crossings with yarns of the other family.
    pub(super) fn profile(&self, other: &YarnShape) -> Profile {
        let radii = 0.5 * (self.width_um() + other.width_um());
        Profile::new(self.crimp * radii, other.spacing_um, radii)
    }

    /// Width of the yarn [um]: 2 R, and 2 (D + R) of several plies.
    pub fn width_um(&self) -> f64 {
        2.0 * (self.circle_um() + self.ply_radius_um)
    }
}

/// A yarn as evaluation needs it.
#[derive(Clone, Debug)]
pub(super) struct Yarn {
    pub plies: usize,
    /// Whether its plies scatter one by one, each by a model of one ply; else the model of the ply that is
    /// met has what the others do.
    pub one_by_one: bool,
    pub radius: f32,
    pub circle: f32,
    pub half_width: f32,
    pub spacing: f32,
    pub per_spacing: f32,
    /// Height of the axis.
    pub profile: Profile32,
    /// R + d_cut.
    pub reach: f32,
    /// Radius of the tube that all plies' reach is in [um].
    pub hull: f32,
    /// Turns of the plies per um, negative for S.
    pub turns_per_um: f32,
    /// Slope of a ply against a straight yarn, D dpsi/ds.
    pub slope: f32,
    /// Cosine and sine of 2 pi k / P.
    pub turn: [[f32; 2]; MAX_PLIES],
}

/// A line in the yarn's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// A point of it [um]: along c, n and t.
    pub origin: [f32; 3],
    /// Its direction, toward the light, unit: along c, n and t.
    pub w: [f32; 3],
    /// Turns of ply 0 about the axis at this place.
    pub turns: f32,
    /// Cosine of the yarn's lean: plies turn evenly along the cloth, and so much less along t.
    pub lean: f32,
}

/// A ply that a line meets, or the one it comes nearest to.
#[derive(Clone, Copy, Debug)]
pub(super) struct YarnHit {
    pub hit: bool,
    pub ply: u32,
    pub h: f32,
    /// Tangent of the ply in the yarn's frame.
    pub tangent: [f32; 3],
    /// The x axis of the ply frame. Its component along c says by how much h grows when the line is moved
    /// along c.
    pub x: [f32; 3],
    /// Sine between line and ply.
    pub sine: f32,
    /// Along the line from its point, towards the light: where it comes nearest to the ply's axis [um].
    pub nearest: f32,
    /// The point of the axis there, in the yarn's frame [um].
    pub center: [f32; 3],
}

/// Sine and cosine of an angle in turns.
#[inline]
fn sin_cos_turns(turns: f32) -> (f32, f32) {
    let (s, c, sign) = sin_cos_half_turns::<false>(2.0 * turns);
    (signed(s, sign), signed(c, sign))
}

/// Squared sine below which a line counts as parallel to a ply; its frame is then turned so that y is n.
const PARALLEL: f32 = 1e-10;

/// The x axis of the ply frame of tangent `z` for light from `w`, `w cross z` made unit (Yu 2025, Eq. 1), and
/// the sine between w and z, at least 1e-5.
#[inline]
fn across(w: [f32; 3], z: [f32; 3]) -> ([f32; 3], f32) {
    let m = cross(w, z);
    let squared = dot(m, m);
    if squared > PARALLEL {
        let sine = squared.sqrt();
        let per_sine = 1.0 / sine;
        return ([m[0] * per_sine, m[1] * per_sine, m[2] * per_sine], sine);
    }
    let m = cross([0.0, 1.0, 0.0], z);
    let scale = 1.0 / dot(m, m).max(1e-6).sqrt();
    ([m[0] * scale, m[1] * scale, m[2] * scale], PARALLEL.sqrt())
}

impl YarnHit {
    /// Latitude of the light `w` on the ply [rad].
    #[inline]
    pub fn theta_i(&self, w: [f32; 3]) -> f32 {
        atan2::<false>(dot(w, self.tangent), self.sine)
    }

    /// The ply frame [x, y, z] (Yu 2025, Eq. 1): `w = y cos theta_i + z sin theta_i`.
    #[inline]
    pub fn frame(&self) -> [[f32; 3]; 3] {
        let z = self.tangent;
        let mut x = self.x;
        if self.sine < 0.05 {
            // Lines nearly along the ply lose digits in the product; a step of Gram and Schmidt gives them
            // back.
            let off = dot(x, z);
            x = [x[0] - off * z[0], x[1] - off * z[1], x[2] - off * z[2]];
            let scale = 1.0 / dot(x, x).max(1e-12).sqrt();
            x = x.map(|v| v * scale);
        }
        [x, cross(z, x), z]
    }
}

impl Yarn {
    pub fn new(shape: &YarnShape, other: &YarnShape) -> Yarn {
        let circle = shape.circle_um();
        let hand = match shape.handedness {
            Handedness::Z => 1.0,
            Handedness::S => -1.0,
        };
        let turns_per_um = shape.ply_pitch_um.filter(|_| shape.plies > 1).map_or(0.0, |pitch| hand / pitch);
        let slope = circle * std::f64::consts::TAU * turns_per_um;
        let mut turn = [[1.0, 0.0]; MAX_PLIES];
        for (k, turn) in turn.iter_mut().enumerate() {
            let (s, c) = (std::f64::consts::TAU * k as f64 / f64::from(shape.plies)).sin_cos();
            *turn = [c as f32, s as f32];
        }
        Yarn {
            plies: (shape.plies as usize).clamp(1, MAX_PLIES),
            one_by_one: false,
            radius: shape.ply_radius_um as f32,
            circle: circle as f32,
            half_width: (0.5 * shape.width_um()) as f32,
            spacing: shape.spacing_um as f32,
            per_spacing: (1.0 / shape.spacing_um) as f32,
            profile: shape.profile(other).single(),
            reach: (shape.ply_radius_um + shape.d_cut_um) as f32,
            hull: (0.5 * shape.width_um() + shape.d_cut_um) as f32,
            turns_per_um: turns_per_um as f32,
            slope: slope as f32,
            turn,
        }
    }

    /// Turns of ply 0 of yarn `index` at the distance `along` from the weave's origin. Every yarn begins at a
    /// turn of its own, drawn by hash from its number and family: no two yarns of a cloth are twisted in
    /// step.
    pub fn turns(&self, index: i32, family: u32, along: f32) -> f32 {
        if self.plies < 2 {
            return 0.0;
        }
        let begin = (hash(index as u32 ^ family.wrapping_mul(0x9E37_79B9)) >> 8) as f32 / (1 << 24) as f32;
        begin + cell(along * self.turns_per_um).1
    }

    /// The ply of a yarn of one, and where a line meets it or comes nearest to it.
    pub fn meet_one(&self, line: &Line) -> YarnHit {
        let tangent = [0.0, 0.0, 1.0];
        let (x, sine) = across(line.w, tangent);
        let h = dot(line.origin, x);
        let nearest = -dot(line.origin, cross(tangent, x)) / sine;
        let center = [0.0, 0.0, line.origin[2] + nearest * line.w[2]];
        YarnHit { hit: h.abs() < self.radius, ply: 0, h, tangent, x, sine, nearest, center }
    }

    /// A ply of several that a line meets or passes next to its point, the yarn straight there.
    pub fn meet_ply(&self, line: &Line, ply: u32, is_hit: bool) -> YarnHit {
        let shift = line.origin[2];
        let (mut best, _, further) = self.cylinder(line, ply as usize, shift, self.angle(line, shift));
        if self.slope != 0.0 && further.abs() < 2.0 * self.half_width {
            let shift = shift + further;
            (best, ..) = self.cylinder(line, ply as usize, shift, self.angle(line, shift));
        }
        best.hit = is_hit;
        // The walk has told whether it is met: what this ply, straightened once more, says of a line at its
        // rim is within that.
        best.h = if is_hit {
            best.h.clamp(-self.radius, self.radius)
        } else {
            best.h.abs().max(self.radius).copysign(best.h)
        };
        best
    }

    /// Ply k at the distance `shift` along t, as the straight cylinder along its tangent there; where the
    /// line enters it, and how much further along t the point of its axis next to that place lies.
    pub(super) fn cylinder(&self, line: &Line, k: usize, shift: f32, [c, s]: [f32; 2]) -> (YarnHit, f32, f32) {
        let [ck, sk] = self.turn[k];
        let (cos, sin) = (c * ck - s * sk, s * ck + c * sk);
        let slope = self.slope * line.lean;
        let norm = 1.0 / (1.0 + slope * slope).sqrt();
        let tangent = [-slope * sin * norm, slope * cos * norm, norm];
        let (x, sine) = across(line.w, tangent);
        let d = [line.origin[0] - self.circle * cos, line.origin[1] - self.circle * sin, line.origin[2] - shift];
        let h = dot(d, x);
        let room = self.radius * self.radius - h * h;
        // Along the line, from its point nearest to the ply's axis; y = z cross x.
        let nearest = -dot(d, cross(tangent, x)) / sine;
        let entry = nearest + room.max(0.0).sqrt() / sine;
        let further = (dot(d, tangent) + entry * dot(line.w, tangent)) * tangent[2];
        let along = dot(d, tangent) + nearest * dot(line.w, tangent);
        let center = std::array::from_fn(|i| line.origin[i] - d[i] + along * tangent[i]);
        (YarnHit { hit: room > 0.0, ply: k as u32, h, tangent, x, sine, nearest, center }, entry, further)
    }

    /// Cosine and sine of ply 0's angle at `shift` along t.
    pub(super) fn angle(&self, line: &Line, shift: f32) -> [f32; 2] {
        let (s, c) = sin_cos_turns(line.turns + shift * line.lean * self.turns_per_um);
        [c, s]
    }
}

/// The whole number at or below `x`, and the fraction, 0 to 1. `f32::floor` is a library call on machines
/// without SSE 4.
#[inline]
pub(super) fn cell(x: f32) -> (i32, f32) {
    let whole = x as i32;
    let rest = x - whole as f32;
    if rest < 0.0 { (whole.wrapping_sub(1), rest + 1.0) } else { (whole, rest) }
}

/// A mixing hash of 32 bits.
fn hash(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7FEB_352D);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests;
