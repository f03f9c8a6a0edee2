//! The tensors of a ply model (Yu 2025, Eq. 8), as the fit computes them and files store them.

pub(in crate::ply) mod drift;
pub(crate) mod edge_lobes;
pub(super) mod energies;
pub(in crate::ply) mod exits;
pub(super) mod layer_factors;
mod limits;

pub use self::limits::{ENERGY_TOLERANCE, MIN_ENERGY, MIN_TRANSMITTANCE, extended};
pub(crate) use self::limits::{MAX_LOBES, MAX_PATHS};

use self::edge_lobes::EdgeLobes;
use self::energies::PlyEnergies;
use self::exits::ExitOffsets;
use self::layer_factors::{LayerFactors, half_nodes};
use super::cone::LobeKind;
use crate::ply::speckle::NoiseSpectrum;

/// The tensors of a ply model file. All arrays are flat, last index fastest. Lobe parameters are in the order
/// of [`crate::ply::asg::Lobe`]: theta_z, phi_z, phi_xy [rad], ln mu1, ln mu2, energy. Those of cones are in
/// the order of [`crate::ply::cone::ConeLobe`].
///
/// A model at (theta_i >= 0, h) interpolates two mixtures:
///
/// - For `f_refl`, lobe parameters are bicubic (Catmull-Rom) over the nodes. Lobe energies are clamped to 0
///   or more and scaled so that they sum to the energy of f_refl in `energies`.
/// - For `f_high`, lobe parameters are bilinear between the four corners of the block that contains (theta_i,
///   h); block (m, n) spans the nodes 2m..2m+2 and 2n..2n+2. The energy of lobe l is multiplied by
///   `w_l(sigma) = sum_j high_path[l][j] exp(-sigma path_um[j])`, with the spectrum interpolated like the
///   lobe, and the sum is scaled to the energy of f_high in `energies`.
///
/// Incidences outside the nodes are clamped to them, and theta_i < 0 is mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyData {
    /// Text of the yarn spec, verbatim.
    pub spec_text: String,
    /// Version of the program that fitted the model.
    pub program_version: String,
    /// Name of the preset, for information.
    pub preset: String,
    /// Seed of the simulation.
    pub seed: u64,
    /// `[M]` incident latitudes [rad], uniform, ascending from 0; M odd.
    pub theta_i: Vec<f64>,
    /// `[H]` offsets of the beam's center [um], uniform, ascending; H odd.
    pub h_um: Vec<f64>,
    /// `[K]` absorption coefficients of the simulation [1/um]; the model is valid between and beyond them.
    pub sigma_per_um: Vec<f64>,
    /// `[J]` path lengths of the absorption spectra [um], ascending, >= 0.
    pub path_um: Vec<f64>,
    /// Kind of the model's lobes.
    pub family: LobeKind,
    /// Number of reflection lobes.
    pub lobes_refl: usize,
    /// Number of high-order lobes.
    pub lobes_high: usize,
    /// Missed light, and the energies of f_refl and of f_high.
    pub energies: PlyEnergies,
    /// `[M][H][lobes_refl][6]`: reflection lobes at the nodes.
    pub refl: Vec<f64>,
    /// `[(M-1)/2][(H-1)/2][2][2][lobes_high][6]`: high-order lobes at the corners (theta_i, h) of each block.
    pub high: Vec<f64>,
    /// `[(M-1)/2][(H-1)/2][2][2][lobes_high][J]`: path-length spectrum of each lobe, >= 0, sum over J = 1.
    pub high_path: Vec<f64>,
    /// `[M][H]`: relative L2 error of f_refl against the table it was fitted to, without the table's noise.
    pub error_refl: Vec<f64>,
    /// `[M][H][K]`: the same for f_high, as rms over the blocks that contain the node.
    pub error_high: Vec<f64>,
    /// Factors of light that layers of this ply's yarns reflect and transmit; absent from models of a single
    /// ply.
    pub layers: Option<LayerFactors>,
    /// Exit positions of light on the ply. They are absent from models of tables without exits, whose light
    /// exits anywhere across the ply.
    pub exits: Option<ExitOffsets>,
    /// Edge diffraction (Yu 2025, 6.1). It is absent from models whose missed light goes straight on.
    pub edge: Option<EdgeLobes>,
    /// Speckle noise (Yu 2025, 6.2); absent from models that are only smooth.
    pub noise: Option<NoiseSpectrum>,
}

impl PlyData {
    /// Limits forward energy to scattered energy, which may be exceeded because both are interpolated
    /// separately.
    pub(in crate::ply) fn bound_layers(&mut self) {
        let Some(mut layers) = self.layers.take() else { return };
        let size = 1 + self.path_um.len();
        for (forward, energy) in
            layers.forward.chunks_exact_mut(size).zip(half_nodes(&self.energies, &self.theta_i, &self.h_um))
        {
            forward[0] = forward[0].min(energy.refl);
            let (sum, limit) = (forward[1..].iter().sum::<f64>(), energy.high.iter().sum::<f64>());
            if sum > limit {
                forward[1..].iter_mut().for_each(|f| *f *= limit / sum);
            }
        }
        self.layers = Some(layers);
    }
}
