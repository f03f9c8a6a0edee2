//! The absorption of a yarn that gives the cloth a target color, per wavelength and for hosts that render in
//! RGB.
//!
//! An sRGB color is turned into a smooth reflectance spectrum, and each wavelength into the absorption at
//! which the cloth has that reflectance, by inverting the cloth's brightness curve ([`AlbedoCurve`]).
//! Reflectances out of range are clamped to clear or black fibers; [`ColorReach`] reports the difference.

use crate::cloth::YarnColor;
use crate::color::{
    AlbedoCurve, SPECTRUM_NODES, SigmaSpectrum, SmoothReflectance, delta_e_2000, linear_rec2020_of_xyz,
    linear_srgb_of_xyz, srgb_encode, xyz_of_reflectance,
};
use crate::optics::Reflections;
use crate::spec::YarnSpec;
use crate::{PlyModel, Result};

/// Meaning of the N numbers of a color.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Light at the N wavelengths of the query, for spectral hosts.
    #[default]
    Wavelengths,
    /// Linear RGB with the primaries of sRGB, for hosts that render in RGB. Each channel has the absorption
    /// that gives the yarn, under diffuse light, that channel of the color of the yarn's spectrum under D65.
    /// Edges, gaps and speckle use the query's wavelengths; [`crate::color::RGB_LAMBDA_UM`] represents the
    /// channels.
    ///
    /// A channel cannot be darker than the reflection at the fibers' surfaces, so a saturated color with a
    /// channel below that comes out paler. This requires N = 3; channels beyond the third equal the third.
    LinearSrgb,
    /// Linear RGB with the wider primaries of BT.2020, whose gamut includes every color that fibers can have.
    LinearRec2020,
}

/// A target color and the color that the cloth attains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorReach {
    /// The target [sRGB, 0 to 1].
    pub asked: [f32; 3],
    /// The color of the cloth, in the sense that its spec gives to colors [sRGB; outside of 0 to 1 if out of
    /// gamut].
    pub comes_out: [f64; 3],
    /// CIEDE2000 difference between the two colors; a just noticeable difference is about 1.
    pub delta_e: f64,
    /// Number of the 81 wavelengths at which the target is brighter than clear fibers, and darker than black
    /// ones.
    pub clamped: [usize; 2],
}

impl ColorReach {
    fn new(srgb: [f32; 3], curve: &AlbedoCurve) -> (ColorReach, SigmaSpectrum, [f64; 3]) {
        let smooth = SmoothReflectance::of_srgb(srgb.map(f64::from));
        let (sigma, clamped) = SigmaSpectrum::of_reflectance(curve, |l| smooth.at(l));
        let achieved = xyz_of_reflectance(|l| curve.albedo(f64::from(sigma.at(l as f32))));
        let delta_e = delta_e_2000(xyz_of_reflectance(|l| smooth.at(l)), achieved);
        let comes_out = linear_srgb_of_xyz(achieved).map(srgb_encode);
        (ColorReach { asked: srgb, comes_out, delta_e, clamped }, sigma, achieved)
    }

    /// The color that a cloth with this brightness curve attains for a target color.
    pub fn from_srgb(srgb: [f32; 3], curve: &AlbedoCurve) -> ColorReach {
        ColorReach::new(srgb, curve).0
    }
}

/// Absorption of a yarn.
#[derive(Clone, Debug)]
pub(crate) enum Dye {
    /// The same absorption [1/um] at every wavelength.
    Even(f32),
    /// Spectrum of the absorption, and absorptions of the three channels of linear sRGB and of BT.2020
    /// [1/um].
    Spectrum(Box<(SigmaSpectrum, [[f32; 3]; 2])>),
}

impl Dye {
    /// The absorption that gives a cloth with this brightness curve the color.
    pub(crate) fn new(color: YarnColor, curve: &AlbedoCurve) -> Dye {
        match color {
            YarnColor::Undyed => Dye::Even(0.0),
            YarnColor::Sigma(sigma) => Dye::Even(sigma),
            YarnColor::Natural(of) => Dye::of_sigma(SigmaSpectrum::from_fn(|l| of.sigma_per_um(l)), curve),
            YarnColor::Srgb(srgb) => {
                // RGB channels are taken from the color that the cloth attains under D65, so that colors out
                // of reach agree in spectral and RGB modes.
                let (_, sigma, achieved) = ColorReach::new(srgb, curve);
                let rgb = [linear_srgb_of_xyz(achieved), linear_rec2020_of_xyz(achieved)]
                    .map(|rgb| rgb.map(|channel| curve.sigma(channel).0 as f32));
                Dye::Spectrum(Box::new((sigma, rgb)))
            }
        }
    }

    /// The absorption that represents the color of opaque fibers in a cloth with this brightness curve.
    pub(crate) fn of_metal(reflections: &Reflections, curve: &AlbedoCurve) -> Dye {
        Dye::of_sigma(SigmaSpectrum::from_fn(|lambda_um| reflections.sigma_per_um(lambda_um)), curve)
    }

    /// An absorption by wavelength.
    fn of_sigma(sigma: SigmaSpectrum, curve: &AlbedoCurve) -> Dye {
        let xyz = xyz_of_reflectance(|l| curve.albedo(f64::from(sigma.at(l as f32))));
        let rgb = [linear_srgb_of_xyz(xyz), linear_rec2020_of_xyz(xyz)]
            .map(|rgb| rgb.map(|channel| curve.sigma(channel).0 as f32));
        Dye::Spectrum(Box::new((sigma, rgb)))
    }

    /// Absorption per channel [1/um].
    pub(crate) fn at<const N: usize>(&self, lambda_um: [f32; N], channels: Channels) -> [f32; N] {
        let rgb = |of: &[f32; 3]| std::array::from_fn(|k| of[k.min(2)]);
        match (self, channels) {
            (Dye::Even(sigma), _) => [*sigma; N],
            (Dye::Spectrum(dye), Channels::Wavelengths) => lambda_um.map(|l| dye.0.at(l)),
            (Dye::Spectrum(dye), Channels::LinearSrgb) => rgb(&dye.1[0]),
            (Dye::Spectrum(dye), Channels::LinearRec2020) => rgb(&dye.1[1]),
        }
    }

    /// Absorptions [1/um] of the three channels of linear sRGB, and at the nodes of the spectrum.
    pub(crate) fn numbers(&self) -> ([f32; 3], [f32; SPECTRUM_NODES]) {
        match self {
            Dye::Even(sigma) => ([*sigma; 3], [*sigma; SPECTRUM_NODES]),
            Dye::Spectrum(dye) => (dye.1[0], *dye.0.nodes_per_um()),
        }
    }

    /// Heap memory in bytes.
    pub(crate) fn memory_bytes(&self) -> usize {
        match self {
            Dye::Even(_) => 0,
            Dye::Spectrum(dye) => size_of_val(dye.as_ref()),
        }
    }
}

/// Reflections of a model's opaque fibers; `None` for fibers that transmit light.
///
/// # Errors
/// The errors of the model's spec.
pub(crate) fn own_color(model: &PlyModel) -> Result<Option<Reflections>> {
    Ok(YarnSpec::parse(&model.data().spec_text, "model (its spec)")?.fiber.reflections())
}
