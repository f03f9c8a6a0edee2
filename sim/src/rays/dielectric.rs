//! Multiple-scattering rough dielectric: the random walk of Heitz et al. 2016 on a GGX microsurface of the
//! Smith model.
//!
//! A single-scattering microfacet model drops the light that hits a second microfacet. Inside a bundle of
//! fibers, with a dozen interactions per path, this loses half of the energy (docs/explain/papers/yu_2025.md,
//! departure 11). The walk follows the ray over the microsurface until it leaves, so that every sample
//! carries weight 1 and power is conserved exactly.
//!
//! Power is traced, not radiance: there is no eta^2 factor. Heights are uniform in [-1, 1] and enter only
//! through their cumulative distribution, here `c` in [0, 1]. The walk is in the frame of the ray's medium,
//! with the outward side up. At a refraction the frame is flipped (w -> -w, c -> 1 - c, eta -> 1/eta), which
//! the symmetry of the height distribution allows.

use nalgebra::Vector3;
use rand::{Rng, RngExt};

/// A dielectric interface: index inside over index outside, and GGX roughness.
#[derive(Clone, Copy, Debug)]
pub struct RoughDielectric {
    /// Relative index of refraction, inside over outside.
    pub eta: f32,
    /// GGX roughness; 0 for smooth.
    pub alpha: f32,
}

/// Result of a scattering event at the interface.
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    /// Propagation direction after the event, in the local frame (z along the normal, which points outside).
    pub dir: Vector3<f32>,
    /// Whether the ray is now on the outside.
    pub outside: bool,
    /// Number of microfacet interactions; 0 if the walk was stopped at its limit.
    pub order: u32,
}

/// A ray at a facet of a microsurface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtFacet {
    /// Its direction `w` and its height `c`, as cumulative probability, in the frame of its medium.
    w: Vector3<f32>,
    c: f32,
    /// Index beyond the facet over that of its medium.
    eta: f32,
    /// Whether its medium is the inside.
    flipped: bool,
}

/// Microfacet interactions after which a walk stops; the path then counts as killed.
pub(super) const MAX_ORDER: u32 = 512;

/// Unpolarized Fresnel reflectance at a facet, and the cosine of the refracted ray; `cos_i >= 0`, `eta` =
/// transmitted over incident index. Total internal reflection gives (1, 0).
pub fn fresnel(cos_i: f32, eta: f32) -> (f32, f32) {
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    (0.5 * (s * s + p * p), cos_t)
}

impl RoughDielectric {
    /// Scatters a ray that propagates along `dir` (local frame) and hits the interface from `outside` or from
    /// inside.
    pub fn scatter<R: Rng>(&self, dir: Vector3<f32>, outside: bool, rng: &mut R) -> Scattered {
        self.walk(dir, outside, rng, |_| ())
    }

    /// Scatters a ray like [`RoughDielectric::scatter`]. `on_facet` is called at each facet of a rough wall
    /// that the ray hits.
    #[inline(always)]
    pub(crate) fn walk<R: Rng>(
        &self,
        dir: Vector3<f32>,
        outside: bool,
        rng: &mut R,
        mut on_facet: impl FnMut(&AtFacet),
    ) -> Scattered {
        // The frame is that of the medium of the ray; `flipped` if that is the inside.
        let mut flipped = !outside;
        let mut w = if flipped { -dir } else { dir };
        let mut eta = if flipped { 1.0 / self.eta } else { self.eta };
        if self.alpha <= 0.0 {
            let n = Vector3::z();
            if self.facet(&mut w, n, eta, rng) {
                flipped = !flipped;
            }
            let dir = if !outside { -w } else { w };
            return Scattered { dir, outside: !flipped, order: 1 };
        }
        let mut c = 1.0f32;
        let mut order = 0;
        loop {
            match self.next_height(w, c, rng.random::<f32>()) {
                None => break,
                Some(next) => c = next,
            }
            order += 1;
            if order > MAX_ORDER {
                return Scattered { dir: if flipped { -w } else { w }, outside: !flipped, order: 0 };
            }
            on_facet(&AtFacet { w, c, eta, flipped });
            let n = self.visible_normal(-w, rng.random::<f32>(), rng.random::<f32>());
            if self.facet(&mut w, n, eta, rng) {
                w = -w;
                c = 1.0 - c;
                eta = 1.0 / eta;
                flipped = !flipped;
            }
        }
        Scattered { dir: if flipped { -w } else { w }, outside: !flipped, order }
    }

    /// Density [1/sr] with which a ray at a facet leaves to the outside in direction `wo` (unit, local frame)
    /// after its next event. The sum over the facets of a walk is an unbiased estimate of the walk's density
    /// (Heitz et al. 2016, 5.3).
    pub(crate) fn toward(&self, at: &AtFacet, wo: Vector3<f32>) -> f32 {
        if wo.z < 1e-4 {
            return 0.0;
        }
        let wi = -at.w;
        if at.flipped {
            // In the frame of the inside, the refracted direction is flipped.
            let wt = -wo;
            let mut h = wi + wt * at.eta;
            let length = h.norm();
            if length < 1e-6 {
                return 0.0;
            }
            h *= if h.z < 0.0 { -1.0 } else { 1.0 } / length;
            let (cos_i, cos_t) = (wi.dot(&h), wt.dot(&h));
            if cos_i <= 0.0 || cos_t >= 0.0 {
                return 0.0;
            }
            let per = cos_i + at.eta * cos_t;
            let jacobian = at.eta * at.eta * -cos_t / (per * per).max(1e-12);
            (1.0 - fresnel(cos_i, at.eta).0) * self.visible(at.w, h, cos_i) * jacobian * self.escapes(1.0 - at.c, wo)
        } else {
            self.mirrored(at.w, at.c, wo).map_or(0.0, |(density, cos)| density * fresnel(cos, at.eta).0)
        }
    }

    /// Density [1/sr] of the normal `h` among those visible along a ray in direction `w`, `cos = -w.h > 0`.
    fn visible(&self, w: Vector3<f32>, h: Vector3<f32>, cos: f32) -> f32 {
        // Projected area of the facets, with its limit for a horizontal ray.
        let area = if w.z.abs() > 1e-4 { w.z * self.lambda(w) } else { 0.5 * self.alpha };
        let a2 = self.alpha * self.alpha;
        let root = h.z * h.z * (a2 - 1.0) + 1.0;
        if area <= 1e-9 { 0.0 } else { cos * a2 / (std::f32::consts::PI * root * root) / area }
    }

    /// Density [1/sr] with which a ray in direction `w` at height `c` is reflected to the upward direction
    /// `wo` by a facet of reflectance 1 and leaves, with the cosine of incidence at the facet.
    pub(super) fn mirrored(&self, w: Vector3<f32>, c: f32, wo: Vector3<f32>) -> Option<(f32, f32)> {
        let h = (wo - w).try_normalize(1e-6)?;
        let cos = -w.dot(&h);
        (cos > 1e-6 && h.z > 0.0).then(|| (self.visible(w, h, cos) / (4.0 * cos) * self.escapes(c, wo), cos))
    }

    /// Probability that a ray at height `c` leaves in the upward direction `w`.
    fn escapes(&self, c: f32, w: Vector3<f32>) -> f32 {
        powf(c, self.lambda(w))
    }

    /// Reflects or refracts `w` at a facet of normal `n` (n.w < 0); true if refracted. The frame is not
    /// flipped.
    #[inline(always)]
    fn facet<R: Rng>(&self, w: &mut Vector3<f32>, n: Vector3<f32>, eta: f32, rng: &mut R) -> bool {
        let cos_i = (-w.dot(&n)).max(0.0);
        let (f, cos_t) = fresnel(cos_i, eta);
        let refracted = rng.random::<f32>() >= f;
        *w = if refracted { (*w + n * cos_i) / eta - n * cos_t } else { *w + n * (2.0 * cos_i) };
        // One Newton step of the normalization keeps the length at 1 without a square root.
        *w *= 1.5 - 0.5 * w.norm_squared();
        refracted
    }

    /// Smith's Lambda of GGX for a propagation direction `w`; <= -1 for downward ones.
    #[inline(always)]
    fn lambda(&self, w: Vector3<f32>) -> f32 {
        let tan2 = (1.0 - w.z * w.z).max(0.0) / (w.z * w.z);
        let root = (1.0 + self.alpha * self.alpha * tan2).sqrt();
        0.5 * (-1.0 + if w.z > 0.0 { root } else { -root })
    }

    /// Height (as cumulative probability) of the next facet hit by a ray at height `c`; `None` if the ray
    /// leaves (Heitz et al. 2016, 4.1).
    #[inline(always)]
    pub(super) fn next_height(&self, w: Vector3<f32>, c: f32, u: f32) -> Option<f32> {
        if w.z > 0.9999 {
            return None;
        }
        if w.z < -0.9999 {
            return Some(c * (1.0 - u));
        }
        if w.z.abs() < 1e-4 {
            // A horizontal ray hits the surface at its own height.
            return Some(c);
        }
        let lambda = self.lambda(w);
        if w.z > 0.0 && 1.0 - u <= powf(c, lambda) {
            return None;
        }
        Some((c / powf(1.0 - u, 1.0 / lambda)).clamp(0.0, 1.0))
    }

    /// Sampled normal of a facet visible from `wi` (any direction, also from below the horizon), by uniform
    /// sampling of the spherical cap of the stretched configuration (Dupuy and Benyoub 2023).
    #[inline(always)]
    pub(super) fn visible_normal(&self, wi: Vector3<f32>, u1: f32, u2: f32) -> Vector3<f32> {
        let s = Vector3::new(self.alpha * wi.x, self.alpha * wi.y, wi.z).normalize();
        let (sin_phi, cos_phi) = sin_cos_turn(u1);
        let z = (1.0 - u2) * (1.0 + s.z) - s.z;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let h = Vector3::new(r * cos_phi + s.x, r * sin_phi + s.y, z + s.z);
        let n = Vector3::new(self.alpha * h.x, self.alpha * h.y, h.z.max(1e-7));
        n.normalize()
    }
}

/// `x^y` for x in [0, 1].
#[inline(always)]
fn powf(x: f32, y: f32) -> f32 {
    x.powf(y)
}

/// Sine and cosine of `2 pi u`, u in [0, 1), by polynomials over an eighth turn; absolute error below 3e-7.
#[inline(always)]
pub(crate) fn sin_cos_turn(u: f32) -> (f32, f32) {
    let q = (4.0 * u + 0.5).floor();
    let x = (u - 0.25 * q) * std::f32::consts::TAU;
    let x2 = x * x;
    let s = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 - x2 / 5040.0)));
    let c = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 / 40320.0)));
    match q as i32 & 3 {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    #[test]
    fn sin_cos_turn_is_accurate() {
        for i in 0..4096 {
            let u = i as f32 / 4096.0;
            let (s, c) = sin_cos_turn(u);
            let (ws, wc) = (u as f64 * std::f64::consts::TAU).sin_cos();
            assert!((s as f64 - ws).abs() < 4e-7 && (c as f64 - wc).abs() < 4e-7, "u {u}: {s} {ws} {c} {wc}");
        }
    }

    /// Densities towards drawn directions and the outgoing directions of walks have the same moments, for
    /// rays from outside and from inside, steep and grazing.
    #[test]
    fn densities_are_those_of_the_walk() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let n = 200_000;
        let moments = |w: Vector3<f32>| {
            let [x, z] = [w.x, w.z].map(f64::from);
            [1.0, z, z * z, x, x * z, x * x]
        };
        for (eta, alpha) in [(1.5, 0.15), (1.5, 0.4), (1.34, 0.8), (0.8, 0.3)] {
            let m = RoughDielectric { eta, alpha };
            for (z, outside) in [(-0.95f32, true), (-0.3, true), (0.97, false), (0.7, false), (0.2, false)] {
                let dir = Vector3::new((1.0 - z * z).sqrt(), 0.0, z);
                let mut sums = [[[0.0f64; 6]; 2]; 2];
                for _ in 0..n {
                    // Uniform over the outer hemisphere.
                    let [up, turn]: [f32; 2] = rng.random();
                    let (sin, cos) = sin_cos_turn(turn);
                    let across = (1.0 - up * up).sqrt();
                    let wo = Vector3::new(across * cos, across * sin, up);
                    let mut density = 0.0f64;
                    let s = m.walk(dir, outside, &mut rng, |at| density += f64::from(m.toward(at, wo)));
                    let outgoing = if s.outside { moments(s.dir) } else { [0.0; 6] };
                    let drawn = moments(wo).map(|v| v * density * std::f64::consts::TAU);
                    for (sums, values) in sums.iter_mut().zip([outgoing, drawn]) {
                        (0..6).for_each(|k| {
                            sums[0][k] += values[k] / n as f64;
                            sums[1][k] += values[k] * values[k] / n as f64;
                        });
                    }
                }
                for k in 0..6 {
                    let [outgoing, drawn] = sums.map(|of| of[0][k]);
                    let se = sums.map(|of| (of[1][k] - of[0][k] * of[0][k]).max(0.0) / n as f64);
                    let se = (se[0] + se[1]).sqrt();
                    assert!(
                        (outgoing - drawn).abs() < 4.5 * se + 1e-3,
                        "{eta} {alpha} {z} {k}: {outgoing} {drawn} {se}"
                    );
                }
            }
        }
    }

    /// At index 1 no facet refracts the ray, so it is not deflected at any roughness.
    #[test]
    fn matched_index_changes_nothing() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        for alpha in [0.0, 0.05, 0.3, 1.0] {
            let m = RoughDielectric { eta: 1.0, alpha };
            for z in [-0.95f32, -0.4, -0.1] {
                let d = Vector3::new((1.0 - z * z).sqrt(), 0.0, z);
                let s = m.scatter(d, true, &mut rng);
                assert!(!s.outside && (s.dir - d).norm() < 1e-5, "{s:?}");
            }
        }
    }

    /// Reciprocity of power scattering: flux from a cosine-distributed bundle outside into the inside must
    /// equal, through detailed balance, eta^2 times the reverse: T_in = eta^2 T_out for diffuse light,
    /// whatever the roughness.
    #[test]
    fn diffuse_transmittances_are_reciprocal() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let n = 400_000;
        for alpha in [0.0, 0.1, 0.3, 0.7] {
            let m = RoughDielectric { eta: 1.5, alpha };
            let mut passed = [0u32; 2];
            for (k, outside) in [true, false].into_iter().enumerate() {
                for _ in 0..n {
                    let z = rng.random::<f32>().sqrt().max(1e-3);
                    let d = Vector3::new((1.0 - z * z).sqrt(), 0.0, if outside { -z } else { z });
                    let s = m.scatter(d, outside, &mut rng);
                    assert!(s.order > 0 && (s.dir.norm() - 1.0).abs() < 1e-4);
                    assert_eq!(s.dir.z > 0.0, s.outside, "{s:?}");
                    passed[k] += (s.outside != outside) as u32;
                }
            }
            let t = passed.map(|p| p as f64 / n as f64);
            let se = |p: f64| (p * (1.0 - p) / n as f64).sqrt();
            let (got, want) = (t[0], 2.25 * t[1]);
            let tol = 5.0 * (se(t[0]).powi(2) + (2.25 * se(t[1])).powi(2)).sqrt();
            assert!((got - want).abs() < tol, "alpha {alpha}: T_in {got}, eta^2 T_out {want}, tolerance {tol}");
        }
    }

    /// A smooth interface reflects by Fresnel's law: normal incidence gives ((eta-1)/(eta+1))^2.
    #[test]
    fn smooth_limit_is_fresnel() {
        let (f, _) = fresnel(1.0, 1.5);
        assert!((f - 0.04).abs() < 1e-6);
        assert_eq!(fresnel(0.2, 1.0 / 1.5).0, 1.0);
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let d = Vector3::new(0.6, 0.0, -0.8);
        let (want, _) = fresnel(0.8, 1.5);
        for alpha in [0.0, 1e-3] {
            let m = RoughDielectric { eta: 1.5, alpha };
            let n = 200_000;
            let hits = (0..n).filter(|_| m.scatter(d, true, &mut rng).outside).count() as f64 / n as f64;
            let tol = 5.0 * (want as f64 * (1.0 - want as f64) / n as f64).sqrt();
            assert!((hits - want as f64).abs() < tol, "alpha {alpha}: {hits} against {want}");
        }
    }

    /// The facet visible from wi has the density D(m) max(m.wi, 0) / sigma(wi), sigma the projected area of
    /// all facets. The test compares its mean m.z with a quadrature over GGX, for directions above and below
    /// the horizon.
    #[test]
    fn visible_normals_follow_ggx() {
        let m = RoughDielectric { eta: 1.5, alpha: 0.4 };
        let mut rng = Pcg64Mcg::seed_from_u64(4);
        for z in [0.9f32, 0.5, 0.2, -0.2] {
            let wi = Vector3::new((1.0 - z * z).sqrt(), 0.0, z);
            // sigma(wi) = projected area of the facets that face wi, by quadrature over slopes.
            let (mut area, mut first) = (0.0f64, 0.0f64);
            let n = 1200;
            for i in 0..n {
                // GGX's radial variable: tan^2 = alpha^2 u/(1-u), the density of m.z-weighted area is 1 in u.
                // With u = 1 - t^2 the root singularity of the projected area at u = 1 cancels.
                let t = (i as f64 + 0.5) / n as f64;
                let u = 1.0 - t * t;
                let t2 = 0.16 * u / (t * t);
                let cos = 1.0 / (1.0 + t2).sqrt();
                let sin = (1.0 - cos * cos).sqrt();
                for j in 0..n / 4 {
                    let phi = std::f64::consts::TAU * (j as f64 + 0.5) / (n / 4) as f64;
                    let dot = sin * phi.cos() * wi.x as f64 + cos * wi.z as f64;
                    if dot > 0.0 {
                        area += dot / cos * t;
                        first += dot * t; // weighted by m.z
                    }
                }
            }
            let want = first / area;
            let trials = 200_000;
            let (mut s1, mut s2) = (0.0f64, 0.0f64);
            for _ in 0..trials {
                let k = m.visible_normal(wi, rng.random(), rng.random());
                s1 += k.z as f64;
                s2 += (k.z * k.z) as f64;
            }
            let mean = s1 / trials as f64;
            let se = ((s2 / trials as f64 - mean * mean) / trials as f64).sqrt();
            assert!((mean - want).abs() < 5.0 * se + 1e-3, "z {z}: got {mean}, want {want}, se {se}");
        }
    }
}
