//! Colors of yarns as absorptions: over the wavelength, and for hosts that render in RGB.

use super::YarnColor;
use crate::color::{
    AlbedoCurve, SPECTRUM_NODES, SigmaSpectrum, SmoothReflectance, delta_e_2000, linear_rec2020_of_xyz,
    linear_srgb_of_xyz, srgb_encode, xyz_of_reflectance,
};
use crate::fiber::Reflections;
use crate::spec::YarnSpec;
use crate::{PlyModel, Result};

/// What the N numbers of a color are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Light of the N wavelengths of the query: a spectral host.
    #[default]
    Wavelengths,
    /// Linear RGB of the primaries of sRGB: a host that renders in RGB. Each channel has the absorption that
    /// gives the yarn, under diffuse light, the channel of the color that the yarn's spectrum has under D65.
    /// Edges, gaps and speckle take the query's wavelengths, of which [`crate::color::RGB_LAMBDA_UM`] stand
    /// for the channels.
    ///
    /// A channel cannot be darker than what the fibers' surfaces reflect: a saturated color whose spectrum
    /// would have a channel below that comes out paler. For N = 3;
    /// channels beyond the third count as the third.
    LinearSrgb,
    /// The same of the wider primaries of BT.2020, in which every color that fibers can have fits.
    LinearRec2020,
}

/// A target color and the color that the cloth reaches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorReach {
    /// As asked for [sRGB, 0 to 1].
    pub asked: [f32; 3],
    /// As the cloth has it, in the meaning that its spec gives to colors [sRGB; beyond 0 to 1 out of its
    /// gamut].
    pub comes_out: [f64; 3],
    /// CIEDE2000 between the two; one that is just seen is about 1.
    pub delta_e: f64,
    /// How many of the 81 wavelengths were brighter than clear fibers and darker than black ones.
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

    /// What a cloth of this brightness over absorption makes of a color.
    pub fn from_srgb(srgb: [f32; 3], curve: &AlbedoCurve) -> ColorReach {
        ColorReach::new(srgb, curve).0
    }
}

/// Absorption of a yarn.
#[derive(Clone, Debug)]
pub(crate) enum Dye {
    /// The same at every wavelength.
    Even(f32),
    /// Over the wavelength, and of the three channels of linear sRGB and of BT.2020.
    Spectrum(Box<(SigmaSpectrum, [[f32; 3]; 2])>),
}

impl Dye {
    /// The absorption that gives yarns of this albedo the color.
    pub(crate) fn new(color: YarnColor, curve: &AlbedoCurve) -> Dye {
        match color {
            YarnColor::Undyed => Dye::Even(0.0),
            YarnColor::Sigma(sigma) => Dye::Even(sigma),
            YarnColor::Srgb(srgb) => {
                // What the fibers can have of the color, seen under D65: out of reach colors are the same in
                // both modes.
                let (_, sigma, achieved) = ColorReach::new(srgb, curve);
                let rgb = [linear_srgb_of_xyz(achieved), linear_rec2020_of_xyz(achieved)]
                    .map(|rgb| rgb.map(|channel| curve.sigma(channel).0 as f32));
                Dye::Spectrum(Box::new((sigma, rgb)))
            }
        }
    }

    /// The color that opaque fibers have by themselves, in a cloth of this albedo.
    pub(crate) fn of_metal(reflections: &Reflections, curve: &AlbedoCurve) -> Dye {
        let sigma = SigmaSpectrum::from_fn(|lambda_um| reflections.sigma_per_um(lambda_um));
        let xyz = xyz_of_reflectance(|l| curve.albedo(f64::from(sigma.at(l as f32))));
        let rgb = [linear_srgb_of_xyz(xyz), linear_rec2020_of_xyz(xyz)]
            .map(|rgb| rgb.map(|channel| curve.sigma(channel).0 as f32));
        Dye::Spectrum(Box::new((sigma, rgb)))
    }

    /// By channel.
    pub(crate) fn at<const N: usize>(&self, lambda_um: [f32; N], channels: Channels) -> [f32; N] {
        let rgb = |of: &[f32; 3]| std::array::from_fn(|k| of[k.min(2)]);
        match (self, channels) {
            (Dye::Even(sigma), _) => [*sigma; N],
            (Dye::Spectrum(dye), Channels::Wavelengths) => lambda_um.map(|l| dye.0.at(l)),
            (Dye::Spectrum(dye), Channels::LinearSrgb) => rgb(&dye.1[0]),
            (Dye::Spectrum(dye), Channels::LinearRec2020) => rgb(&dye.1[1]),
        }
    }

    /// Of the three channels of linear sRGB, and at the nodes of a spectrum.
    pub(crate) fn numbers(&self) -> ([f32; 3], [f32; SPECTRUM_NODES]) {
        match self {
            Dye::Even(sigma) => ([*sigma; 3], [*sigma; SPECTRUM_NODES]),
            Dye::Spectrum(dye) => (dye.1[0], *dye.0.nodes_per_um()),
        }
    }

    /// Bytes beyond its own size.
    pub(crate) fn memory_bytes(&self) -> usize {
        match self {
            Dye::Even(_) => 0,
            Dye::Spectrum(dye) => size_of_val(dye.as_ref()),
        }
    }
}

/// What the reflections of a model's fibers absorb; `None` of fibers that light passes.
///
/// # Errors
/// Those of the model's spec.
pub(crate) fn own_color(model: &PlyModel) -> Result<Option<Reflections>> {
    Ok(YarnSpec::parse(&model.data().spec_text, "model (its spec)")?.fiber.reflections())
}
