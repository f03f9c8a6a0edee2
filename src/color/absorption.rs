//! The absorption sigma(lambda) for a given reflectance, by inverting the albedo of the loaded model.
//!
//! The albedo of a model at an incidence is `E_refl + sum_j e_j exp(-sigma path_j)` with e_j >= 0, and every
//! average over incidences has the same form. It decreases with sigma and is convex, from the albedo of clear
//! fibers to that of light that enters no fiber. Newton's method from sigma = 0 stays left of the root and
//! converges.

use super::{SPECTRUM_NODES, SPECTRUM_UM, spectrum_lambda_um};

/// Maximum absorption for a reflectance [1/um], at which light is absorbed before it crosses a fiber.
const MAX_PER_UM: f64 = 1.0;

/// Albedo of a model or a cloth as a function of the absorption, averaged over incidences.
#[derive(Clone, Debug, PartialEq)]
pub struct AlbedoCurve(Form);

#[derive(Clone, Debug, PartialEq)]
enum Form {
    /// A constant part, and energies by path length.
    Paths { constant: f64, path_um: Vec<f64>, energy: Vec<f64> },
    /// `(v, value)` at nodes of `v = 1 / (1 + sigma L)` from 1 to 0, linear in v between them; the value
    /// decreases with the absorption.
    Nodes { length_um: f64, nodes: Vec<(f64, f64)> },
}

/// Position of a reflectance relative to the range of albedos that the model can reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamped {
    /// Within the range.
    No,
    /// Brighter than clear fibers; sigma is clamped to 0.
    ToClear,
    /// Darker than the darkest fibers, or NaN; sigma is clamped to its maximum.
    ToDark,
}

impl AlbedoCurve {
    /// The curve of a constant part and of energies by path length [um].
    pub(crate) fn of_paths(constant: f64, path_um: Vec<f64>, energy: Vec<f64>) -> AlbedoCurve {
        AlbedoCurve(Form::Paths { constant, path_um, energy })
    }

    /// The curve of values at two or more nodes of `v = 1 / (1 + sigma L)`, from clear fibers (v = 1) to
    /// infinite absorption (v = 0). A value above the previous one is clamped to it, so the curve decreases.
    pub(crate) fn of_nodes(length_um: f64, nodes: impl Iterator<Item = (f64, f64)>) -> AlbedoCurve {
        let mut lowest = f64::INFINITY;
        let falling = |(v, value): (f64, f64)| {
            lowest = lowest.min(value);
            (v, lowest)
        };
        AlbedoCurve(Form::Nodes { length_um, nodes: nodes.map(falling).collect() })
    }

    /// `(v, value)` at the nodes of `v = 1 / (1 + sigma L)`, and L [um]; `None` for a curve of path lengths.
    pub(crate) fn nodes(&self) -> Option<(f64, &[(f64, f64)])> {
        match &self.0 {
            Form::Paths { .. } => None,
            Form::Nodes { length_um, nodes } => Some((*length_um, nodes)),
        }
    }

    /// Albedo at an absorption [1/um].
    pub fn albedo(&self, sigma_per_um: f64) -> f64 {
        match &self.0 {
            Form::Paths { constant, path_um, energy } => value(*constant, path_um, energy, sigma_per_um).0,
            Form::Nodes { length_um, nodes } => {
                let v = 1.0 / (1.0 + sigma_per_um.max(0.0) * length_um);
                let node = nodes.partition_point(|node| node.0 > v).clamp(1, nodes.len() - 1) - 1;
                let ((v0, a), (v1, b)) = (nodes[node], nodes[node + 1]);
                a + (v0 - v) / (v0 - v1) * (b - a)
            }
        }
    }

    /// The minimum and the maximum albedo that [`AlbedoCurve::sigma`] reaches.
    pub fn range(&self) -> [f64; 2] {
        [self.albedo(MAX_PER_UM), self.albedo(0.0)]
    }

    /// The absorption of an albedo within the range.
    fn inverse(&self, albedo: f64) -> f64 {
        match &self.0 {
            Form::Paths { constant, path_um, energy } => {
                let mut sigma = 0.0;
                for _ in 0..200 {
                    let (value, slope) = value(*constant, path_um, energy, sigma);
                    let step = (albedo - value) / slope;
                    let next = if step.is_finite() { (sigma + step).clamp(0.0, MAX_PER_UM) } else { sigma };
                    let done = (next - sigma).abs() <= 1e-14 * next;
                    sigma = next;
                    if done {
                        break;
                    }
                }
                sigma
            }
            Form::Nodes { length_um, nodes } => {
                let node = nodes.iter().rposition(|(_, value)| *value >= albedo).unwrap_or(0).min(nodes.len() - 2);
                let ((v0, a), (v1, b)) = (nodes[node], nodes[node + 1]);
                let v = v0 + if a > b { ((a - albedo) / (a - b)).clamp(0.0, 1.0) } else { 0.0 } * (v1 - v0);
                ((1.0 / v - 1.0) / length_um).min(MAX_PER_UM)
            }
        }
    }

    /// The absorption [1/um], in [0, 1], whose albedo is `reflectance`, and whether the reflectance was
    /// clamped.
    pub fn sigma(&self, reflectance: f64) -> (f64, Clamped) {
        let [dark, bright] = self.range();
        if reflectance > bright {
            return (0.0, Clamped::ToClear);
        }
        // The comparison is false for NaN, which is therefore dark.
        let within = reflectance >= dark;
        if !within {
            return (MAX_PER_UM, Clamped::ToDark);
        }
        (self.inverse(reflectance), Clamped::No)
    }
}

/// Value of a sum over paths, and its slope [um].
fn value(constant: f64, path_um: &[f64], energy: &[f64], sigma: f64) -> (f64, f64) {
    let (mut value, mut slope) = (constant, 0.0);
    for (path, energy) in path_um.iter().zip(energy) {
        let e = energy * (-sigma * path).exp();
        value += e;
        slope -= path * e;
    }
    (value, slope)
}

/// Absorption as a function of the wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct SigmaSpectrum {
    per_um: [f32; SPECTRUM_NODES],
}

impl SigmaSpectrum {
    /// The absorption with which a model of this albedo has the reflectance at each wavelength; and how many
    /// of the 81 nodes were clamped to clear and to dark fibers.
    pub fn of_reflectance(curve: &AlbedoCurve, reflectance: impl Fn(f64) -> f64) -> (SigmaSpectrum, [usize; 2]) {
        let mut clamped = [0; 2];
        let per_um = std::array::from_fn(|node| {
            let (sigma, clamping) = curve.sigma(reflectance(spectrum_lambda_um(node)));
            match clamping {
                Clamped::No => {}
                Clamped::ToClear => clamped[0] += 1,
                Clamped::ToDark => clamped[1] += 1,
            }
            sigma as f32
        });
        (SigmaSpectrum { per_um }, clamped)
    }

    /// The absorption [1/um] given as a function of the wavelength [um].
    pub fn from_fn(sigma_per_um: impl Fn(f64) -> f64) -> SigmaSpectrum {
        SigmaSpectrum { per_um: std::array::from_fn(|node| sigma_per_um(spectrum_lambda_um(node)) as f32) }
    }

    /// Absorptions at the nodes [1/um].
    pub fn nodes_per_um(&self) -> &[f32; SPECTRUM_NODES] {
        &self.per_um
    }

    /// The absorption at a wavelength [1/um], linear between the nodes and constant beyond 0.38 to 0.78 um;
    /// NaN gives the first node.
    pub fn at(&self, lambda_um: f32) -> f32 {
        // Like `place`, but in f32 and without its division.
        const LAST: usize = SPECTRUM_NODES - 1;
        let x = crate::math::simd::min(
            crate::math::simd::max((lambda_um - SPECTRUM_UM[0] as f32) * 200.0, 0.0),
            LAST as f32,
        );
        let i = (x as i32 as usize).min(LAST - 1);
        self.per_um[i] + (x - i as f32) * (self.per_um[i + 1] - self.per_um[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{SmoothReflectance, delta_e, xyz_of_reflectance};

    fn curve() -> AlbedoCurve {
        AlbedoCurve(Form::Paths {
            constant: 0.004,
            path_um: vec![0.0, 4.0, 30.0, 200.0],
            energy: vec![0.0, 0.096, 0.6, 0.3],
        })
    }

    /// The inverse of the albedo is accurate to 1e-12, decreases, and reports clamping outside its range.
    #[test]
    fn absorption_inverts_the_albedo() {
        let c = curve();
        let [dark, bright] = c.range();
        let mut last = f64::INFINITY;
        for i in 0..=1000 {
            let r = dark + (bright - dark) * f64::from(i) / 1000.0;
            let (sigma, clamped) = c.sigma(r);
            assert_eq!(clamped, Clamped::No);
            assert!((c.albedo(sigma) - r).abs() < 1e-12, "{r}: {sigma} gives {}", c.albedo(sigma));
            assert!(sigma < last || i == 0, "{sigma} {last}");
            last = sigma;
        }
        assert_eq!(c.sigma(1.01), (0.0, Clamped::ToClear));
        assert_eq!(c.sigma(0.004), (MAX_PER_UM, Clamped::ToDark));
        assert_eq!(c.sigma(f64::NAN), (MAX_PER_UM, Clamped::ToDark));
    }

    /// A color converted to absorption and back has the spectrum of the reflectance wherever nothing was
    /// clamped.
    #[test]
    fn colors_come_back_through_the_albedo() {
        let c = curve();
        for srgb in [[0.8, 0.6, 0.65], [0.5, 0.5, 0.5], [0.45, 0.6, 0.5]] {
            let r = SmoothReflectance::of_srgb(srgb);
            let (sigma, clamped) = SigmaSpectrum::of_reflectance(&c, |l| r.at(l));
            assert_eq!(clamped, [0, 0]);
            let got = xyz_of_reflectance(|l| c.albedo(f64::from(sigma.at(l as f32))));
            let want = xyz_of_reflectance(|l| r.at(l));
            assert!(delta_e(got, want) < 1e-3, "{srgb:?}: {}", delta_e(got, want));
        }
        let (sigma, clamped) = SigmaSpectrum::of_reflectance(&c, |l| if l < 0.5 { 2.0 } else { 0.0 });
        assert_eq!(clamped, [24, 57]);
        assert_eq!([sigma.at(0.1), sigma.at(5.0), sigma.at(f32::NAN)], [0.0, 1.0, 0.0]);
        assert!((sigma.at(0.4975) - 0.5).abs() < 1e-4);
    }

    /// Curves of nodes are inverted where they decrease; elsewhere the clearest fibers are chosen.
    #[test]
    fn curves_of_nodes_are_inverted() {
        let values = [1.0, 0.7, 0.7, 0.75, 0.2, 0.05].into_iter().enumerate();
        let curve = AlbedoCurve::of_nodes(150.0, values.map(|(i, value)| (1.0 - 0.2 * i as f64, value)));
        for sigma in [0.0, 1e-4, 0.001, 0.009, 0.03, 0.4] {
            let albedo = curve.albedo(sigma);
            let (back, clamped) = curve.sigma(albedo);
            assert!(clamped == Clamped::No && (curve.albedo(back) - albedo).abs() < 1e-9, "{sigma}: {back}");
        }
        assert_eq!(curve.sigma(1.1), (0.0, Clamped::ToClear));
        assert_eq!(curve.sigma(0.01).1, Clamped::ToDark);
        assert!(curve.albedo(0.001) > curve.albedo(0.009) && curve.range()[1] == 1.0);
    }
}
