//! The tensors of a ply model (Yu 2025, Eq. 8), as stored in files and made by the fitter.

pub(crate) mod edge_lobes;
pub(super) mod energies;
pub(super) mod exits;
pub(super) mod file;
pub(super) mod layer_factors;

use self::edge_lobes::EdgeLobes;
use self::energies::PlyEnergies;
use self::exits::ExitOffsets;
use self::layer_factors::LayerFactors;
use super::cone::LobeKind;
use crate::speckle::NoiseSpectrum;

/// Largest number of lobes of each kind.
pub(crate) const MAX_LOBES: usize = 16;
/// Largest number of path lengths of a spectrum.
pub(crate) const MAX_PATHS: usize = 16;

/// Weight of a lobe whose energy or spectrum has vanished: keeps the sum of the lobes above 0, so that the
/// mixture can always be scaled to the simulated energy.
pub(crate) const MIN_ENERGY: f64 = 1e-12;
/// The same for the transmittance of a lobe.
pub(crate) const MIN_TRANSMITTANCE: f64 = 1e-20;

/// The tensors of a ply model file, as the fitter makes them. All arrays are flat, last index fastest.
/// Lobe parameters are in the order of [`crate::ply::asg::Lobe`]: theta_z, phi_z, phi_xy [rad], ln mu1, ln
/// mu2, energy;
/// those of cones in the order of [`crate::ply::cone::ConeLobe`].
///
/// A model at (theta_i >= 0, h) interpolates both mixtures. For `f_refl`, lobe parameters are bicubic
/// (Catmull-Rom) over the nodes, and lobe energies are clamped at 0 and scaled so that they sum to the energy
/// of f_refl in `energies`. For `f_high`, lobe parameters are bilinear over the four corners of the block
/// that contains (theta_i, h); block (m, n) spans the nodes 2m..2m+2 and 2n..2n+2. Lobe l's energy is
/// multiplied by `w_l(sigma) = sum_j high_path[l][j] exp(-sigma path_um[j])` (spectrum interpolated like the
/// lobe), and the sum scaled to the energy of f_high in `energies`. Incidences outside the nodes are clamped
/// to them; theta_i < 0 is mirrored.
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
    /// `[K]` absorption coefficients of the simulation [1/um]; the model is valid between and beyond them.
    pub sigma_per_um: Vec<f64>,
    /// `[J]` path lengths of the absorption spectra [um], ascending, >= 0.
    pub path_um: Vec<f64>,
    /// Family of the model's lobes.
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
    /// `[M][H]`: relative L2 error of f_refl against the table it was fitted to, its noise removed.
    pub error_refl: Vec<f64>,
    /// `[M][H][K]`: the same for f_high, rms over the blocks that hold the node.
    pub error_high: Vec<f64>,
    /// Layer factors: light that layers of this ply's yarns reflect and transmit; absent from models of one
    /// ply alone.
    pub layers: Option<LayerFactors>,
    /// Exit positions of light on the ply; absent from models of tables without exits, whose light exits
    /// anywhere across the ply.
    pub exits: Option<ExitOffsets>,
    /// Edge diffraction (Yu 2025, 6.1); absent from models without it, whose missed light goes straight on.
    pub edge: Option<EdgeLobes>,
    /// Speckle noise (Yu 2025, 6.2); absent from models that are only smooth.
    pub noise: Option<NoiseSpectrum>,
}

/// Value of a node array at index -1..=n, extrapolated linearly at both ends: `at(-1) = 2 at(0) - at(1)`.
pub(crate) fn extended(i: isize, n: usize, at: &dyn Fn(usize) -> f64) -> f64 {
    if i < 0 {
        2.0 * at(0) - at(1)
    } else if i as usize >= n {
        2.0 * at(n - 1) - at(n - 2)
    } else {
        at(i as usize)
    }
}
