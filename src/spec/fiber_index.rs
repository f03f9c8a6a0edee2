//! Refractive indices of the fibers of a yarn spec at a wavelength.

use super::yarn::{FiberSpec, YarnSpec};
use crate::optics::{OpaqueIndex, Reflections};

/// Wavelength at which tables of fibers state an index: the sodium D line [um].
pub const SODIUM_UM: f64 = 0.5893;

impl FiberSpec {
    /// Whether no light passes through the fiber.
    pub fn is_opaque(&self) -> bool {
        self.metal.is_some() || self.kappa.is_some()
    }

    /// Real index at a wavelength [um]. The table of a ply uses the index at its spec's `beam.lambda_um`.
    pub fn eta_at(&self, lambda_um: f64) -> f64 {
        match (self.metal, self.dispersion_um2) {
            (Some(metal), _) => f64::from(metal.index(lambda_um as f32)[0]),
            (None, Some(b)) => self.eta + b * (lambda_um.powi(-2) - SODIUM_UM.powi(-2)),
            (None, None) => self.eta,
        }
    }

    /// Imaginary index of an opaque fiber at a wavelength [um]; 0 for a fiber that transmits light.
    pub fn kappa_at(&self, lambda_um: f64) -> f64 {
        let of_metal = self.metal.map(|metal| f64::from(metal.index(lambda_um as f32)[1]));
        of_metal.or(self.kappa).unwrap_or(0.0)
    }

    /// Absorption by reflections of an opaque fiber; `None` for a fiber that transmits light.
    pub fn reflections(&self) -> Option<Reflections> {
        let fixed = self.kappa.map(|kappa| OpaqueIndex::Fixed([self.eta as f32, kappa as f32]));
        self.metal.map(OpaqueIndex::Metal).or(fixed).map(Reflections::new)
    }
}

impl YarnSpec {
    /// Absorption [1/um] that represents the yarn's own color at a wavelength [um]: that of the reflections
    /// of its opaque fibers ([`Reflections`]), or 0 for fibers that transmit light.
    pub fn own_sigma_per_um(&self, lambda_um: f64) -> f64 {
        self.fiber.reflections().map_or(0.0, |of| of.sigma_per_um(lambda_um))
    }
}
