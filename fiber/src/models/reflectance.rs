//! Shares of light that depend on the wavelength: the colors of models that have no absorption.

use crate::range::{invalid, parameter};
use plywave::Result;
use plywave::color::SmoothReflectance;

/// A share of light at each wavelength, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Reflectance {
    /// The same at every wavelength.
    Gray(f32),
    /// `[lambda_um, share]` at ascending wavelengths, measured or fitted; linear between them and constant
    /// beyond.
    Nodes(Vec<[f32; 2]>),
    /// A smooth spectrum that reproduces a color.
    Smooth(SmoothReflectance),
}

impl Reflectance {
    /// A smooth reflectance of a color in encoded sRGB, 0 to 1 each.
    pub fn of_srgb(srgb: [f64; 3]) -> Reflectance {
        Reflectance::Smooth(SmoothReflectance::of_srgb(srgb))
    }

    /// The share at a wavelength. A NaN wavelength gives the share of the first node.
    pub fn at(&self, lambda_um: f32) -> f32 {
        match self {
            Reflectance::Gray(share) => *share,
            Reflectance::Smooth(smooth) => smooth.at(f64::from(lambda_um)) as f32,
            Reflectance::Nodes(nodes) => {
                let next = nodes.partition_point(|[lambda, _]| *lambda <= lambda_um);
                if next == 0 || next == nodes.len() {
                    return nodes.get(next.saturating_sub(1)).map_or(0.0, |[_, share]| *share);
                }
                let ([a, low], [b, high]) = (nodes[next - 1], nodes[next]);
                low + (high - low) * (lambda_um - a) / (b - a)
            }
        }
    }

    /// Returns an error for shares outside [0, 1] and for nodes out of order; `model` and `key` name the
    /// parameter in the message.
    pub(crate) fn check(&self, model: &str, key: &str) -> Result<()> {
        match self {
            Reflectance::Gray(share) => parameter(model, key, *share, [0.0, 1.0]),
            Reflectance::Smooth(smooth) => match smooth.coefficients.iter().find(|c| !c.is_finite()) {
                Some(c) => Err(invalid(model, key, c, "use finite coefficients".into())),
                None => Ok(()),
            },
            Reflectance::Nodes(nodes) => {
                if nodes.is_empty() {
                    return Err(invalid(model, key, "[]", "give at least one [lambda_um, share]".into()));
                }
                for (k, [lambda, share]) in nodes.iter().enumerate() {
                    parameter(model, key, *share, [0.0, 1.0])?;
                    let ascends = lambda.is_finite() && (k == 0 || nodes[k - 1][0] < *lambda);
                    if !ascends {
                        return Err(invalid(
                            model,
                            key,
                            lambda,
                            "use finite wavelengths [um] in ascending order".into(),
                        ));
                    }
                }
                Ok(())
            }
        }
    }
}

impl From<f32> for Reflectance {
    fn from(share: f32) -> Reflectance {
        Reflectance::Gray(share)
    }
}
