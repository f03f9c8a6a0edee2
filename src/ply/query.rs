//! A query of a ply, and the terms of its scattering function.

use super::layers::Layer;
use super::place::PlyPlace;
use crate::gap::Slit;

/// A query at a shading point of a ply, for N absorptions, each with its wavelength. [`PlyQuery::new`] is the
/// smooth ply with its edge light; other parts are options:
/// `PlyQuery { place: Some(..), ..PlyQuery::new(..) }`.
///
/// ```
/// use plywave::PlyQuery;
///
/// let smooth = PlyQuery::new(0.3, 10.0, [0.001, 0.004, 0.010], [0.612, 0.549, 0.464]);
/// let without_edge = PlyQuery { edge: false, ..smooth };
/// let asked_once = PlyQuery { cached: false, ..smooth };
/// # assert!(smooth.edge && !without_edge.edge && !asked_once.cached);
/// ```
///
/// Units and invalid values are as in [`PlyModel`]. Wavelengths outside the tables, and NaN, are clamped to
/// the tables.
#[derive(Clone, Copy, Debug)]
pub struct PlyQuery<'a, const N: usize> {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center [um]: its x coordinate in the ply frame.
    pub h_um: f32,
    /// Absorptions of the fibers [1/um]: the host's color.
    pub sigma_per_um: [f32; N],
    /// Wavelengths [um]; edge light, slits and speckle depend on them.
    pub lambda_um: [f32; N],
    /// Light that passes beside the ply is diffracted at its edge (Yu 2025, Eq. 18). If false, or in a model
    /// without edge lobes, it goes straight on.
    pub edge: bool,
    /// Small gaps between the fibers (Yu 2025, 7.3), for their diffraction colors. Has no effect over a
    /// second layer.
    pub slit: Option<&'a Slit>,
    /// Place on the ply, for its relief and its speckle: factors of mean 1 on f_refl and f_high. `None` for
    /// the smooth model, the mean over places. Sampling and albedo are those of the smooth model.
    pub place: Option<PlyPlace>,
    /// With a place: the fibers on the ply's surface show, if it has [`PlyModel::relief`].
    pub relief: bool,
    /// With a place: f_refl and f_high have speckle patterns (Yu 2025, Eq. 23), if the model has noise.
    pub speckle: bool,
    /// A second layer of yarns below (Yu 2025, 5.4), from [`PlyModel::layer`] of its model. Has no effect in
    /// a model without layer factors.
    pub below: Option<Layer<N>>,
    /// Cached: interpolates the lobes once for all calls. If false, every call interpolates them again, which
    /// is faster only for a single call.
    pub cached: bool,
}

impl<const N: usize> PlyQuery<'_, N> {
    /// A query of the smooth ply with its edge light.
    pub fn new(theta_i: f32, h_um: f32, sigma_per_um: [f32; N], lambda_um: [f32; N]) -> Self {
        PlyQuery {
            theta_i,
            h_um,
            sigma_per_um,
            lambda_um,
            edge: true,
            slit: None,
            place: None,
            relief: true,
            speckle: true,
            below: None,
            cached: true,
        }
    }

    /// A query of f_refl + f_high alone, which no wavelength affects: light that passes beside the fibers
    /// goes straight on.
    pub fn lobes(theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Self {
        PlyQuery { edge: false, ..PlyQuery::new(theta_i, h_um, sigma_per_um, [0.55; N]) }
    }
}

/// The terms of a ply model in one direction [1/sr].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyTerms<const N: usize> {
    /// Single reflection; the same at every absorption.
    pub refl: f32,
    /// All other light that hit fibers.
    pub high: [f32; N],
    /// Light that passed beside the ply and was diffracted (Yu 2025, Eq. 18).
    pub edge: [f32; N],
    /// Light of f_high that small slits diffract, if the query has a [`Slit`]; `high` is then without it.
    pub slit: [f32; N],
    /// Density of sampling the direction, over all terms [1/sr].
    pub pdf: f32,
}

impl<const N: usize> PlyTerms<N> {
    /// f_refl + f_high + f_edge, plus the light of slits.
    pub fn sum(&self) -> [f32; N] {
        let mut f = [0.0; N];
        for k in 0..N {
            f[k] = self.refl + self.high[k] + self.edge[k] + self.slit[k];
        }
        f
    }

    /// The sum with f_refl and f_high of a place (Yu 2025, Eq. 23), other light unchanged.
    pub(super) fn sum_with(&self, (refl, high): &([f32; N], [f32; N])) -> [f32; N] {
        std::array::from_fn(|k| refl[k] + high[k] + self.edge[k] + self.slit[k])
    }
}
