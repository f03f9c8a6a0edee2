//! Options of the synthesized speckle noise: beam, polarization and contrast.

use plywave_tables::speckle::{SpecklePolarization, SpeckleSide};

/// Contrast of the noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseContrast {
    /// The contrast and the covariance of the simulated fibers.
    Measured,
    /// Contrast 1 and `mu^2 = max(C / C(0), 0)`: Yu 2025, Eq. 19-22.
    Developed,
}

/// Options of the synthesized noise.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseOptions {
    /// Seed of the sources.
    pub seed: u64,
    /// Waist of the beam on the ply [um], which is the illuminated length.
    pub w0_um: f64,
    /// Polarization of the light; renderers have unpolarized light.
    pub polarization: SpecklePolarization,
    /// Number of fibers in view at once, whose patterns add up.
    pub fibers: u32,
    /// Contrast of the noise.
    pub contrast: NoiseContrast,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        NoiseOptions {
            seed: 1,
            w0_um: 10.0,
            polarization: SpecklePolarization::Unpolarized,
            fibers: 1,
            contrast: NoiseContrast::Measured,
        }
    }
}

/// Azimuths in the statistics of f_refl and f_high. The light behind a dark fiber is diffraction, not
/// reflection.
pub const KIND_SIDES: [SpeckleSide; 2] = [SpeckleSide::Reflection, SpeckleSide::All];
/// Names of the kinds of light.
pub const KIND_NAMES: [&str; 2] = ["refl", "high"];
