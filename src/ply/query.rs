//! A query of a ply, and the terms of its scattering function.
//!
//! A query holds all inputs of one shading point but the outgoing direction: incidence, colors, and which
//! optional effects are evaluated (edge diffraction, slits, relief, speckle, a second layer).

use super::layers::Layer;
use super::place::PlyPlace;
use crate::gap::Slit;

/// A query at a shading point of a ply, for N absorptions, each with its wavelength.
///
/// [`PlyQuery::new`] describes the smooth ply with its edge light. The other effects are options:
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
/// Units and the handling of invalid values are those of [`PlyModel`]. A wavelength outside the tables is
/// clamped to them; NaN is clamped too.
#[derive(Clone, Copy, Debug)]
pub struct PlyQuery<'a, const N: usize> {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center from the ply's axis [um]: its x coordinate in the ply frame.
    pub h_um: f32,
    /// Absorptions of the fibers [1/um], which set the color.
    pub sigma_per_um: [f32; N],
    /// Wavelengths [um]. Only edge light, slits and speckle depend on them.
    pub lambda_um: [f32; N],
    /// If true, light that passes beside the ply is diffracted at its edge (Yu 2025, Eq. 18). If false, or if
    /// the model has no edge lobes, that light goes straight on.
    pub edge: bool,
    /// Small gaps between the fibers, which diffract light into colors (Yu 2025, 7.3). Ignored if there is a
    /// second layer.
    pub slit: Option<&'a Slit>,
    /// Position on the ply, at which relief and speckle are evaluated: factors of mean 1 on f_refl and
    /// f_high. With `None` the ply is smooth, which is the mean over positions. Sampling and albedo are
    /// always those of the smooth ply.
    pub place: Option<PlyPlace>,
    /// If true and `place` is set, the fibers on the ply's surface are visible, provided that the model has
    /// [`PlyModel::relief`].
    pub relief: bool,
    /// If true and `place` is set, f_refl and f_high have speckle patterns (Yu 2025, Eq. 23), provided that
    /// the model has noise.
    pub speckle: bool,
    /// A second layer of yarns below the ply (Yu 2025, 5.4), from [`PlyModel::layer`] of its model. Ignored
    /// if this model has no layer factors.
    pub below: Option<Layer<N>>,
    /// If true (cached), the lobes are interpolated once for all calls. If false (uncached), every call
    /// interpolates them, which is faster only if there is a single call.
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

    /// A query of f_refl + f_high alone, which do not depend on wavelength. Light that passes beside the
    /// fibers goes straight on.
    pub fn lobes(theta_i: f32, h_um: f32, sigma_per_um: [f32; N]) -> Self {
        PlyQuery { edge: false, ..PlyQuery::new(theta_i, h_um, sigma_per_um, [0.55; N]) }
    }
}

/// The terms of a ply model in one outgoing direction [1/sr].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyTerms<const N: usize> {
    /// Single reflection, f_refl; the same at every absorption.
    pub refl: f32,
    /// All other light that hit fibers, f_high.
    pub high: [f32; N],
    /// Light that passed beside the ply and was diffracted at its edge, f_edge (Yu 2025, Eq. 18).
    pub edge: [f32; N],
    /// The part of f_high that small slits diffract, if the query has a [`Slit`]. `high` then excludes it.
    pub slit: [f32; N],
    /// Density with which the direction is sampled, over all terms [1/sr].
    pub pdf: f32,
}

impl<const N: usize> PlyTerms<N> {
    /// f_refl + f_high + f_edge + slit light.
    pub fn sum(&self) -> [f32; N] {
        let mut f = [0.0; N];
        for k in 0..N {
            f[k] = self.refl + self.high[k] + self.edge[k] + self.slit[k];
        }
        f
    }

    /// The sum with f_refl and f_high replaced by their values at a position on the ply (Yu 2025, Eq. 23).
    pub(super) fn sum_with(&self, (refl, high): &([f32; N], [f32; N])) -> [f32; N] {
        std::array::from_fn(|k| refl[k] + high[k] + self.edge[k] + self.slit[k])
    }
}
