//! Colors of yarns as absorptions: over the wavelength, and for hosts that render in RGB.

use super::YarnColor;
use crate::color::{AlbedoCurve, SigmaSpectrum, SmoothReflectance, linear_srgb_of_xyz, xyz_of_reflectance};

/// What the N numbers of a color are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Light of the N wavelengths of the query: a spectral host.
    #[default]
    Wavelengths,
    /// Linear sRGB: a host that renders in RGB. Each channel has the absorption that gives the yarn, under diffuse light, that channel of the color that the yarn's
    /// spectrum has under D65. Edges, gaps and speckle take the query's wavelengths, of which [`crate::color::RGB_LAMBDA_UM`] stand for the channels. For N = 3;
    /// channels beyond the third count as the third.
    Rgb,
}

/// Absorption of a yarn.
#[derive(Clone, Debug)]
pub(super) enum Dye {
    /// The same at every wavelength.
    Even(f32),
    /// Over the wavelength, and of the three channels of linear sRGB.
    Spectrum(Box<(SigmaSpectrum, [f32; 3])>),
}

impl Dye {
    /// The absorption that gives yarns of this albedo the color.
    pub(super) fn new(color: YarnColor, curve: &AlbedoCurve) -> Dye {
        match color {
            YarnColor::Undyed => Dye::Even(0.0),
            YarnColor::Sigma(sigma) => Dye::Even(sigma),
            YarnColor::Srgb(srgb) => {
                let smooth = SmoothReflectance::of_srgb(srgb.map(f64::from));
                let (sigma, _) = SigmaSpectrum::of_reflectance(curve, |l| smooth.at(l));
                // What the fibers can have of the color, seen under D65: out of reach colors are the same in both modes.
                let achieved = xyz_of_reflectance(|l| curve.albedo(f64::from(sigma.at(l as f32))));
                let rgb = linear_srgb_of_xyz(achieved).map(|channel| curve.sigma(channel).0 as f32);
                Dye::Spectrum(Box::new((sigma, rgb)))
            }
        }
    }

    pub(super) fn at<const N: usize>(&self, lambda_um: [f32; N]) -> [f32; N] {
        match self {
            Dye::Even(sigma) => [*sigma; N],
            Dye::Spectrum(dye) => lambda_um.map(|l| dye.0.at(l)),
        }
    }

    /// Of the channels of linear sRGB.
    pub(super) fn rgb<const N: usize>(&self) -> [f32; N] {
        match self {
            Dye::Even(sigma) => [*sigma; N],
            Dye::Spectrum(dye) => std::array::from_fn(|k| dye.1[k.min(2)]),
        }
    }

    /// Bytes beyond its own size.
    pub(super) fn memory_bytes(&self) -> usize {
        match self {
            Dye::Even(_) => 0,
            Dye::Spectrum(dye) => size_of_val(dye.as_ref()),
        }
    }
}
