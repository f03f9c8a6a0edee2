//! Absorption by the reflections of an opaque fiber, expressed as a length in an absorbing material. A ply of
//! metal then has the same axis of absorption as every other ply.
//!
//! A path retains the share `prod_k F(lambda, c_k)` of its light, where F is the reflectance of the conductor
//! and c_k the cosine of the angle of incidence at its k-th facet. This is `exp(-sum_k a(lambda, c_k))` with
//! a = -ln F. Over the wavelengths of one metal, a varies much more with lambda than its shape over c does,
//! so
//!
//! ```text
//! a(lambda, c) ~ sigma(lambda) L(c),     L(c) = 100 um * mean of a(lambda', c) over the measured lambda' / the same at c = 1,
//! ```
//!
//! and a path has one length, the sum of L(c_k), for all wavelengths. At normal incidence each reflection
//! adds 100 um, [`REFLECTION_UM`], which puts the absorption of metals into the range of dyed fibers (gold:
//! 3e-4 to 9e-3 per um). sigma(lambda) is chosen such that a reflection retains the correct share of light
//! that is uniform over the hemisphere:
//! `integral of exp(-sigma L(c)) 2 c dc = integral of F(lambda, c) 2 c dc`. In that mean a first reflection
//! is exact at every wavelength. At a single angle a reflectance is off by at most 0.037 (tests below:
//! aluminum near grazing; gold by 0.030), and a wire lit from 63 degrees of latitude by 0.018. For a single
//! fixed index L is exact.

use super::metal::{Metal, conductor};

/// Length that represents a reflection at normal incidence [um].
pub const REFLECTION_UM: f64 = 100.0;

/// Number of cells of the length over the cosine.
const CELLS: usize = 256;
/// Number of points of integrals over the hemisphere.
const POINTS: usize = 512;
/// Number of wavelengths over which a metal's lengths are averaged: 0.40 to 0.70 um in steps of 0.02 um.
const LAMBDAS: usize = 16;

/// Complex index of an opaque material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OpaqueIndex {
    /// The measured index of a metal.
    Metal(Metal),
    /// `[eta, kappa]` at all wavelengths.
    Fixed([f32; 2]),
}

impl OpaqueIndex {
    /// `[eta, kappa]` at a wavelength [um].
    pub fn at(&self, lambda_um: f64) -> [f32; 2] {
        match self {
            OpaqueIndex::Metal(metal) => metal.index(lambda_um as f32),
            OpaqueIndex::Fixed(index) => *index,
        }
    }
}

/// Reflections of an opaque fiber as lengths (see the module).
#[derive(Clone, Debug, PartialEq)]
pub struct Reflections {
    index: OpaqueIndex,
    /// Lengths over the cosine, from 0 to 1 [um].
    length_um: Vec<f32>,
}

impl Reflections {
    /// The lengths for a material.
    pub fn new(index: OpaqueIndex) -> Reflections {
        let lambda = |k: usize| 0.40 + 0.02 * k as f64;
        let sum = |cos: f32| (0..LAMBDAS).map(|k| absorbance(cos, index.at(lambda(k)))).sum::<f64>();
        // The reflectance of a perfect mirror does not depend on the angle.
        let all = sum(1.0).max(1e-12);
        let length = |i: usize| (REFLECTION_UM * sum(i as f32 / CELLS as f32) / all) as f32;
        Reflections { index, length_um: (0..=CELLS).map(length).collect() }
    }

    /// The material.
    pub fn index(&self) -> OpaqueIndex {
        self.index
    }

    /// Length [um] that represents a reflection at this cosine of the angle of incidence.
    #[inline]
    pub fn length_um(&self, cos: f32) -> f32 {
        let x = cos.abs().min(1.0) * CELLS as f32;
        let i = (x as usize).min(CELLS - 1);
        let [a, b] = [self.length_um[i], self.length_um[i + 1]];
        a + (x - i as f32) * (b - a)
    }

    /// Absorption [1/um] at a wavelength [um] for which reflections retain the correct share of light from
    /// all directions.
    pub fn sigma_per_um(&self, lambda_um: f64) -> f64 {
        let index = self.index.at(lambda_um);
        let wanted = mean(|cos| (-absorbance(cos, index)).exp());
        // The mean decreases with sigma and is convex, so Newton's method from 0 approaches the root from the
        // left without overshoot.
        let mut sigma = 0.0;
        for _ in 0..60 {
            let retained = |cos: f32| (-sigma * f64::from(self.length_um(cos))).exp();
            let slope = mean(|cos| f64::from(self.length_um(cos)) * retained(cos));
            let step = (mean(retained) - wanted) / slope.max(1e-9);
            sigma = f64::max(sigma + step, 0.0);
            if step.abs() < 1e-12 {
                break;
            }
        }
        sigma
    }
}

/// -ln F, with F clamped above 1e-12.
fn absorbance(cos: f32, index: [f32; 2]) -> f64 {
    -f64::from(conductor(cos, index)).max(1e-12).ln()
}

/// Mean over light that is uniform over the hemisphere, by the midpoint rule in cos^2.
fn mean(of: impl Fn(f32) -> f64) -> f64 {
    (0..POINTS).map(|i| of(((i as f32 + 0.5) / POINTS as f32).sqrt())).sum::<f64>() / POINTS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const METALS: [Metal; 4] = [Metal::Gold, Metal::Silver, Metal::Aluminium, Metal::Copper];

    /// The mean over the hemisphere is that of Fresnel's reflectance. At a single angle the reflectance is
    /// off by at most 0.037, the limit stated above and in docs/reference/spec.md.
    #[test]
    fn reflectances_by_length_are_those_of_fresnel() {
        for metal in METALS {
            let of = Reflections::new(OpaqueIndex::Metal(metal));
            assert!((f64::from(of.length_um(1.0)) - REFLECTION_UM).abs() < 1e-3);
            let mut worst = 0.0f64;
            for k in 0..=30 {
                let lambda_um = 0.4 + 0.01 * f64::from(k);
                let (index, sigma) = (metal.index(lambda_um as f32), of.sigma_per_um(lambda_um));
                let by_length = |cos: f32| (-sigma * f64::from(of.length_um(cos))).exp();
                let fresnel = |cos: f32| f64::from(conductor(cos, index));
                let (got, want) = (mean(by_length), mean(fresnel));
                assert!((got - want).abs() < 1e-6, "{metal:?} at {lambda_um}: {got}, want {want}");
                for i in 0..=200 {
                    let cos = i as f32 / 200.0;
                    worst = worst.max((by_length(cos) - fresnel(cos)).abs());
                }
            }
            assert!(worst < 0.037, "{metal:?}: off by {worst}");
        }
    }

    /// For a single index, only the table over the cosine is an approximation.
    #[test]
    fn one_index_is_exact() {
        for index in [[0.43, 2.455], [2.5, 3.0], [1.5, 0.3]] {
            let of = Reflections::new(OpaqueIndex::Fixed(index));
            let sigma = of.sigma_per_um(0.55);
            for i in 0..=1000 {
                let cos = i as f32 / 1000.0;
                let got = (-sigma * f64::from(of.length_um(cos))).exp();
                let want = f64::from(conductor(cos, index));
                assert!((got - want).abs() < 3e-3, "{index:?} at cos {cos}: {got}, want {want}");
            }
        }
    }
}
