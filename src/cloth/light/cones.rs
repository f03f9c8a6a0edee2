//! Inter-yarn scattering by parallel yarns, which stays near their cone.
//!
//! Light that only yarns of one kind have scattered, all along one axis e of the cloth, leaves near the cone
//! of its incidence: with v = (a + b) . e, which is 0 on the cone, its density falls as
//!
//! ```text
//! q(v) = s^2 / (2 (s^2 + v^2)^(3/2))
//! ```
//!
//! where the width s depends on crimp, roughness and the number of scatterings. By reciprocity, and with the
//! energy E(a) of such light, its BSDF is
//!
//! ```text
//! f(a, b) = E(a) E(b) q((a + b) . e) cos b / (N(a . e) N(b . e))
//! N(a . e) = integral E(b) q((a + b) . e) cos b / N(b . e) db
//! ```
//!
//! which is symmetric except for cos b and has the energy E(a). N is computed by Sinkhorn scaling when the
//! cloth is made. The integral of q is `v / (2 sqrt(s^2 + v^2))`, which is inverted to sample v.

use crate::cloth::light::lit_places::FUNCTIONS;
use crate::cloth::light::terms::{Poly, TERMS, dot, terms};
use crate::math::simd::{max, min};
use std::f32::consts::PI;

/// Number of nodes of N over the sine, from -1 to 1.
pub const NORMS: usize = 33;
/// Lower bound on E in a direction, relative to its constant term.
const MIN_ENERGY: f32 = 1e-3;

/// The cone of the light that yarns of one kind scatter from one side of the cloth into one half space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Width s of the density q.
    pub width: f32,
    /// Energy E as a polynomial of the direction.
    pub energy: Poly,
    /// N at equidistant sines from -1 to 1.
    pub norm: [f32; NORMS],
}

impl Cone {
    /// The cone of a cloth without such light.
    pub const NONE: Cone = Cone { width: 1.0, energy: [0.0; TERMS], norm: [1.0; NORMS] };

    /// E in a direction; always above 0.
    #[inline(always)]
    pub fn energy(&self, b: [f32; 3]) -> f32 {
        max(dot(&self.energy, &terms(b)), MIN_ENERGY * self.energy[0].abs().max(1e-6))
    }

    /// N at a sine, interpolated linearly; the sine is clamped to [-1, 1].
    #[inline(always)]
    pub fn norm(&self, sine: f32) -> f32 {
        let at = min(max(0.5 * (sine + 1.0), 0.0), 1.0) * (NORMS - 1) as f32;
        let i = (at as usize).min(NORMS - 2);
        self.norm[i] + (at - i as f32) * (self.norm[i + 1] - self.norm[i])
    }

    /// q at `v`.
    #[inline(always)]
    pub fn density(&self, v: f32) -> f32 {
        let squared = self.width * self.width;
        let t = squared + v * v;
        0.5 * squared / (t * t.sqrt())
    }

    /// Integral of q from 0 to `v`.
    #[inline(always)]
    fn below(&self, v: f32) -> f32 {
        0.5 * v / (self.width * self.width + v * v).sqrt()
    }
}

/// A cone for one direction of incidence.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ConeAt<'a> {
    /// Index of the yarns' axis in the cloth: 0 for x, 1 for y.
    axis: usize,
    /// Cone of the light that is incident from the half space into which this light leaves.
    cone: &'a Cone,
    /// `a . e`, and N there.
    sine: f32,
    norm: f32,
    /// Integral of q from 0 to the smallest v that any direction has, and from there to the largest.
    low: f32,
    all: f32,
}

impl<'a> ConeAt<'a> {
    /// Prepares the cone for light from `a` along an axis. `own` is the cone of light from the side of `a`,
    /// `other` that of light in the reverse direction.
    #[inline(always)]
    pub(crate) fn new(axis: usize, a: [f32; 3], own: &Cone, other: &'a Cone) -> ConeAt<'a> {
        let sine = min(max(a[axis], -1.0), 1.0);
        let (low, high) = (other.below(sine - 1.0), other.below(sine + 1.0));
        ConeAt { axis, cone: other, sine, norm: own.norm(sine), low, all: high - low }
    }

    /// f divided by the energy, and density of [`ConeAt::draw`], in direction `b` of the half space [1/sr].
    #[inline(always)]
    pub(crate) fn eval_pdf(&self, b: [f32; 3]) -> (f32, f32) {
        let sine = min(max(b[self.axis], -1.0), 1.0);
        let q = self.cone.density(self.sine + sine);
        let f = q * self.cone.energy(b) * b[2].abs() / (self.norm * self.cone.norm(sine));
        (f, self.pdf_of(q, sine, b[2]))
    }

    /// Density of [`ConeAt::draw`] [1/sr].
    #[inline(always)]
    pub(crate) fn pdf(&self, b: [f32; 3]) -> f32 {
        let sine = min(max(b[self.axis], -1.0), 1.0);
        self.pdf_of(self.cone.density(self.sine + sine), sine, b[2])
    }

    #[inline(always)]
    fn pdf_of(&self, q: f32, sine: f32, z: f32) -> f32 {
        let cos = (1.0 - sine * sine).max(1e-12).sqrt();
        q / self.all * 0.5 * min(z.abs() / cos, 1.0)
    }

    /// Approximate means of the functions 1, x, y, |z| of the light's direction: those of light on the cone
    /// itself, distributed by the cosine to the normal.
    #[inline(always)]
    pub(crate) fn means(&self) -> [f32; FUNCTIONS] {
        let mut means = [1.0, 0.0, 0.0, 0.25 * PI * max(1.0 - self.sine * self.sine, 0.0).sqrt()];
        means[1 + self.axis] = -self.sine;
        means
    }

    /// Samples a direction near the cone, with the angle about the axis distributed by the cosine to the
    /// normal. `up` is the sign of its z.
    pub(crate) fn draw(&self, u: [f32; 2], up: f32) -> [f32; 3] {
        let y = (self.low + u[0] * self.all).clamp(-0.499_999, 0.499_999);
        let v = self.cone.width * y / (0.25 - y * y).sqrt();
        let sine = (v - self.sine).clamp(-1.0, 1.0);
        let cos = (1.0 - sine * sine).sqrt();
        let turn = (2.0 * u[1] - 1.0).clamp(-1.0, 1.0);
        let mut b = [0.0, 0.0, up * cos * (1.0 - turn * turn).sqrt()];
        (b[self.axis], b[1 - self.axis]) = (sine, cos * turn);
        b
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// The density integrates to 1 over the half space, and samples follow it.
    #[test]
    fn samples_have_their_density() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let cone = Cone { width: 0.3, energy: [1.0; TERMS].map(|v: f32| 0.01 * v), norm: [1.0; NORMS] };
        for (axis, a) in [(0, [0.6, 0.0, 0.8]), (1, [0.1, -0.9, -0.424]), (0, [0.0, 0.0, 1.0])] {
            let at = ConeAt::new(axis, a, &cone, &cone);
            let n = 400_000;
            let (mut even, mut drawn) = (0.0, [0.0f64; 2]);
            for _ in 0..n {
                let (z, turn) = (rng.random::<f32>(), std::f32::consts::TAU * rng.random::<f32>());
                let r = (1.0 - z * z).sqrt();
                even += f64::from(at.pdf([r * turn.cos(), r * turn.sin(), z])) * std::f64::consts::TAU / f64::from(n);
                let b = at.draw([rng.random(), rng.random()], 1.0);
                assert!((b[0] * b[0] + b[1] * b[1] + b[2] * b[2] - 1.0).abs() < 1e-5 && b[2] >= 0.0, "{b:?}");
                // Two integrals over the half space, estimated from the samples.
                drawn[0] += f64::from(b[0] * b[2] / at.pdf(b).max(1e-6)) / f64::from(n);
                drawn[1] += f64::from(b[2] / at.pdf(b).max(1e-6)) / f64::from(n);
            }
            println!("{axis} {a:?}: {even:.4}, {drawn:.4?}");
            assert!((even - 1.0).abs() < 0.01, "{axis} {a:?}: {even}");
            assert!(drawn[0].abs() < 0.03 && (drawn[1] - std::f64::consts::PI).abs() < 0.06, "{axis} {a:?}: {drawn:?}");
        }
    }
}
