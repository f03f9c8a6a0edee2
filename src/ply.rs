//! The ply model (Yu 2025, Eq. 8): reflection lobes interpolated over (theta_i, h), high-order lobes in overlapping blocks,
//! absorption by each lobe's path-length spectrum, and the simulated energies, which the evaluator holds exactly.

mod batch;
mod bsdf;
mod dispatch;
mod edge;
mod energy;
mod file;
mod interpolate;
mod layout;
mod lobe;
mod lobes;
mod mixture;
mod place;
mod prepared;
pub mod reference;
mod slit;
mod terms;

use crate::layers::{LayerFactors, LayerTables};
use crate::{Bsdf, Result};
use layout::Layout;
use std::path::Path;

pub(crate) use bsdf::{LobeSample, PlyOn, UncachedPly};
pub use bsdf::{PlyBsdf, PlyQuery, PlyTerms};
pub(crate) use energy::{Core, clamped_sigma};
pub use file::ReferenceValue;
pub(crate) use lobes::Lobes;

/// Most lobes of each kind.
pub(crate) const MAX_LOBES: usize = 16;
/// Most path lengths of a spectrum.
pub(crate) const MAX_PATHS: usize = 16;

/// The tensors of a ply model file, as the fitter makes them. All arrays are flat, last index fastest.
/// Lobe parameters are in the order of [`crate::asg::Lobe`]: theta_z, phi_z, phi_xy [rad], ln mu1, ln mu2, energy.
///
/// A model at (theta_i >= 0, h): `f_refl` has its lobe parameters by bicubic (Catmull-Rom) interpolation over the nodes,
/// lobe energies clamped at 0 and scaled so that they add up to the bilinear `energy_refl`. `f_high` has its lobe parameters by
/// bilinear interpolation over the four corners of the block that holds (theta_i, h); block (m, n) spans the nodes
/// 2m..2m+2 and 2n..2n+2. Lobe l's energy is multiplied by `w_l(sigma) = sum_j high_path[l][j] exp(-sigma path_um[j])`
/// (spectrum interpolated as the lobe is), and the sum scaled to `E_high(sigma) = sum_j energy_high[j] exp(-sigma path_um[j])`,
/// bilinear over the nodes. Incidences outside the nodes are clamped to them; theta_i < 0 is mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyData {
    /// Text of the yarn spec, as given.
    pub spec_text: String,
    /// Program version that fitted it.
    pub program_version: String,
    /// Preset name, for the record.
    pub preset: String,
    /// Seed of the simulation.
    pub seed: u64,
    /// `[M]` incident latitudes [rad], uniform, ascending from 0; M odd.
    pub theta_i: Vec<f64>,
    /// `[H]` beam center offsets [um], uniform, ascending; H odd.
    pub h_um: Vec<f64>,
    /// `[K]` absorption coefficients of the simulation [1/um]; the model holds between and beyond them.
    pub sigma_per_um: Vec<f64>,
    /// `[J]` path lengths of the absorption spectra [um], ascending, >= 0.
    pub path_um: Vec<f64>,
    /// Number of reflection lobes.
    pub lobes_refl: usize,
    /// Number of high-order lobes.
    pub lobes_high: usize,
    /// `[M][H]`: fraction of the beam that meets no fiber.
    pub r_d: Vec<f64>,
    /// `[M][H]`: energy of f_refl.
    pub energy_refl: Vec<f64>,
    /// `[M][H][J]`: path-length spectrum of the energy of f_high, >= 0; its sum over J is the energy at sigma = 0.
    pub energy_high: Vec<f64>,
    /// `[M][H][lobes_refl][6]`: reflection lobes at the nodes.
    pub refl: Vec<f64>,
    /// `[(M-1)/2][(H-1)/2][2][2][lobes_high][6]`: high-order lobes at the corners (theta_i, h) of each block.
    pub high: Vec<f64>,
    /// `[(M-1)/2][(H-1)/2][2][2][lobes_high][J]`: path-length spectrum of each lobe, >= 0, sum over J = 1.
    pub high_path: Vec<f64>,
    /// `[M][H]`: relative L2 error of f_refl against the table it was fitted to, its noise removed.
    pub error_refl: Vec<f64>,
    /// `[M][H][K]`: the same for f_high, rms over the blocks that hold the node.
    pub error_high: Vec<f64>,
    /// What layers of this ply's yarns send back and let through; absent from models of one ply alone.
    pub layers: Option<LayerFactors>,
    /// Edge diffraction (Yu 2025, 6.1); absent in models without it, whose missed light goes on.
    pub edge: Option<crate::EdgeLobes>,
    /// Speckle noise (Yu 2025, 6.2); absent in models that are smooth only.
    pub noise: Option<crate::NoiseTiles>,
}

/// A loaded ply model, laid out for evaluation.
///
/// All angles in radians, lengths in um, densities in 1/sr; every f is an energy density: BSDF times |cos theta_o|. Directions are
/// unit vectors in the ply frame and are not normalised. No call allocates, fails or panics. Where |h| is beyond the nodes, or
/// theta_i or h is not a number, the beam misses: f = 0 and r_d = 1. |theta_i| beyond the nodes counts as the last node.
/// Absorption is clamped to [0, 1e6]; not a number counts as 0. A `wo` that is not finite gives 0. Interpolated ln mu is kept
/// within [`crate::asg::MU_MIN`] and [`crate::asg::MU_MAX`], lobe energies at 0 or more.
#[derive(Clone, Debug)]
pub struct PlyModel {
    data: PlyData,
    reference_values: Vec<ReferenceValue>,
    layout: Layout,
    layers: Option<LayerTables>,
    edge: Option<edge::EdgeTables>,
}

/// Many queries, as arrays of equal lengths.
#[derive(Clone, Copy, Debug)]
pub struct Queries<'a, const N: usize> {
    /// Incident latitudes [rad].
    pub theta_i: &'a [f32],
    /// Beam offsets [um].
    pub h_um: &'a [f32],
    /// Absorptions [1/um].
    pub sigma_per_um: &'a [[f32; N]],
    /// Components x, y, z of the outgoing directions, unit.
    pub wo: [&'a [f32]; 3],
}

impl<const N: usize> Queries<'_, N> {
    /// Query `i`; `None` beyond the shortest array.
    #[inline(always)]
    fn get(&self, i: usize) -> Option<(f32, f32, [f32; N], [f32; 3])> {
        let wo = [*self.wo[0].get(i)?, *self.wo[1].get(i)?, *self.wo[2].get(i)?];
        Some((*self.theta_i.get(i)?, *self.h_um.get(i)?, *self.sigma_per_um.get(i)?, wo))
    }

    /// The queries from `at` on.
    #[inline(always)]
    fn from(&self, at: usize) -> Self {
        let [x, y, z] = self.wo;
        Queries {
            theta_i: self.theta_i.get(at..).unwrap_or(&[]),
            h_um: self.h_um.get(at..).unwrap_or(&[]),
            sigma_per_um: self.sigma_per_um.get(at..).unwrap_or(&[]),
            wo: [x.get(at..).unwrap_or(&[]), y.get(at..).unwrap_or(&[]), z.get(at..).unwrap_or(&[])],
        }
    }

    /// Whether the first `n` queries have the same incidence and absorptions.
    #[inline(always)]
    fn one_incidence(&self, n: usize) -> bool {
        fn same<T: PartialEq>(x: &[T], n: usize) -> bool {
            x.iter().take(n).all(|v| *v == x[0])
        }
        same(self.theta_i, n) && same(self.h_um, n) && same(self.sigma_per_um, n)
    }
}

impl PlyModel {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// As [`PlyData::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<PlyModel> {
        let path = path.as_ref();
        PlyModel::from_bytes(&crate::file::read_bytes(path)?, &path.display().to_string())
    }

    /// Reads and checks a model from the bytes of its file; `name` stands for the file in errors.
    ///
    /// # Errors
    /// As [`PlyData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<PlyModel> {
        let (data, reference_values) = file::read(bytes, name)?;
        Ok(PlyModel::of(data, reference_values))
    }

    /// A model of tensors that need not have been in a file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] when a file with them would be refused.
    pub fn from_data(data: PlyData) -> Result<PlyModel> {
        PlyModel::from_data_named(data, "model")
    }

    fn from_data_named(data: PlyData, name: &str) -> Result<PlyModel> {
        data.check(name)?;
        Ok(PlyModel::of(data, Vec::new()))
    }

    /// Of checked data.
    fn of(data: PlyData, reference_values: Vec<ReferenceValue>) -> PlyModel {
        let edge = data.edge.as_ref().map(edge::EdgeTables::new);
        PlyModel { layout: Layout::new(&data), layers: LayerTables::new(&data), edge, data, reference_values }
    }

    pub(crate) fn layer_tables(&self) -> Option<&LayerTables> {
        self.layers.as_ref()
    }

    /// The tensors as stored in the file.
    pub fn data(&self) -> &PlyData {
        &self.data
    }

    /// Values of eval stored in the file; empty for a model not from a file.
    pub fn reference_values(&self) -> &[ReferenceValue] {
        &self.reference_values
    }

    /// Greatest difference of eval from the stored values, relative to the greatest of them. 0 when none are stored.
    pub fn reference_error(&self) -> f32 {
        let (mut error, mut peak) = (0.0f32, 0.0f32);
        for g in &self.reference_values {
            let got = self.uncached_at(&PlyQuery::lobes(g.theta_i, g.h_um, g.sigma_per_um)).eval(g.wo);
            for (got, want) in got.iter().zip(g.value) {
                error = error.max((got - want).abs());
                peak = peak.max(want.abs());
            }
        }
        if error == 0.0 { 0.0 } else { error / peak }
    }

    /// Whether the model has edge lobes.
    pub fn has_edge(&self) -> bool {
        self.edge.is_some()
    }

    /// f_refl + f_high [1/sr] (Yu 2025, Eq. 8) at each of many queries; 0 where an array of `queries` is shorter than `f`.
    pub fn eval_batch<const N: usize>(&self, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
        dispatch::run_batch(&self.layout, queries, f);
    }
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlyModel>();
};
