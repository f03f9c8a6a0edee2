//! The table of simulated scattering (Yu 2025, 5.1): what `plywave simulate` writes and `plywave fit` reads.
//!
//! Every distribution is an energy density [1/sr] averaged over a bin of the outgoing sphere; for sigma = 0
//! `energy_refl + energy_high + r_d = 1` to Monte Carlo accuracy.

use std::borrow::Cow;

mod energies;
mod file;

pub use energies::{TableEnergies, TableEnergiesAt};

/// Uniform bins of the outgoing sphere: latitude theta_o over [-pi/2, pi/2], azimuth phi_o over [0, 2 pi).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct OutgoingGrid {
    /// Number of latitude bins.
    pub theta_o: usize,
    /// Number of azimuth bins.
    pub phi_o: usize,
}

impl OutgoingGrid {
    /// Number of bins.
    pub fn len(&self) -> usize {
        self.theta_o * self.phi_o
    }

    /// Whether there are no bins.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Center latitude of row `i` [rad].
    pub fn theta(&self, i: usize) -> f64 {
        std::f64::consts::PI * ((i as f64 + 0.5) / self.theta_o as f64 - 0.5)
    }

    /// Center azimuth of column `j` [rad].
    pub fn phi(&self, j: usize) -> f64 {
        std::f64::consts::TAU * (j as f64 + 0.5) / self.phi_o as f64
    }

    /// Exact solid angle of a bin of row `i` [sr].
    pub fn solid_angle(&self, i: usize) -> f64 {
        let edge = |k: usize| (std::f64::consts::PI * (k as f64 / self.theta_o as f64 - 0.5)).sin();
        (edge(i + 1) - edge(i)) * std::f64::consts::TAU / self.phi_o as f64
    }

    /// Index of the bin that contains the unit direction `w`.
    pub fn bin(&self, w: [f32; 3]) -> usize {
        let (theta, phi) = plywave::frame::theta_phi(w);
        let i = ((theta / std::f32::consts::PI + 0.5) * self.theta_o as f32) as usize;
        let j = (phi / std::f32::consts::TAU * self.phi_o as f32) as usize;
        i.min(self.theta_o - 1) * self.phi_o + j.min(self.phi_o - 1)
    }
}

/// Positions on a single ply where light exits and where the beam hits, which the model of a yarn of several
/// plies needs besides the distributions (Yu 2025, 5.3, assumes uniform exits over the ply's width).
#[derive(Clone, Debug, PartialEq)]
pub struct ExitPositions {
    /// Azimuths phi_o: equal parts of [0, 2 pi).
    pub azimuths: usize,
    /// Lateral positions t: equal parts of [-R, R] along (-sin phi_o, cos phi_o).
    pub positions: usize,
    /// `[theta_i][h][1 + sigma][azimuth][position]`: shares of the light of an azimuth, of f_refl, then of
    /// f_high at each sigma; they sum to 1 over the positions, uniform where there was no light.
    pub shares: Vec<f32>,
    /// `[theta_i][x]`: fraction of the paths through lateral position x that hit a fiber; x in equal parts of
    /// [-R, R].
    pub met: Vec<f32>,
    /// `[theta_i][bin][displacement][sigma]`: light of f_high, over that of all paths, by the bin of its
    /// axial cosine ([`plywave::ply::drift_bin`]) and by its displacement along the axis in the parts of
    /// [`displacement`].
    pub drift: Vec<f32>,
}

/// Number of parts of the displacement along the axis.
pub const DISPLACEMENTS: usize = 112;
/// Displacement [R] about which the parts grow in width.
const FINE: f64 = 0.2;
/// Width of a part, in units of asinh(D / FINE).
const STEP: f64 = 0.125;

/// Part of a displacement along the axis over R. Parts are narrow near 0 and grow in proportion to the
/// displacement; the last ones begin at about 100.
pub fn displacement_part(over_r: f64) -> usize {
    let at = (over_r / FINE).asinh() / STEP + 0.5 * DISPLACEMENTS as f64;
    at.clamp(0.0, DISPLACEMENTS as f64 - 1.0) as usize
}

/// The displacement over R in the middle of a part.
pub fn displacement(part: usize) -> f64 {
    FINE * ((part as f64 + 0.5 - 0.5 * DISPLACEMENTS as f64) * STEP).sinh()
}

/// Ensemble-averaged scattering of one ply, or of the yarn that its plies make, over a grid of incidences.
/// All arrays are flat, last index fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Text of the simulated yarn spec, unchanged.
    pub spec_text: String,
    /// Program version that wrote it.
    pub program_version: String,
    /// Preset name, for the record.
    pub preset: String,
    /// Seed of the run.
    pub seed: u64,
    /// Number of plies that scatter: 1 for a single ply of the spec's yarn, otherwise all plies of the yarn.
    pub plies: u32,
    /// True for a yarn whose plies were traced together, which is the brute-force reference; false for one
    /// ply and for a yarn computed from one ply's table.
    pub traced: bool,
    /// Incident latitudes [rad], uniform, ascending from 0 (negative ones follow from the symmetry of the
    /// ply).
    pub theta_i: Vec<f64>,
    /// Beam center offsets [um], uniform, ascending, from -(R + d_cut) to R + d_cut.
    pub h_um: Vec<f64>,
    /// Absorption coefficients [1/um], ascending, `sigma_per_um[0] = 0`.
    pub sigma_per_um: Vec<f64>,
    /// Bins of the outgoing sphere.
    pub grid: OutgoingGrid,
    /// `[theta_i][h]`: fraction of the beam that hits no fiber.
    pub r_d: Vec<f64>,
    /// `[theta_i][h]`: energy of the reflection-only light.
    pub energy_refl: Vec<f64>,
    /// `[theta_i][h][sigma]`: energy of all other scattered light.
    pub energy_high: Vec<f64>,
    /// `[theta_i][h]`: standard error of `r_d + energy_refl + energy_high` at sigma = 0.
    pub energy_se: Vec<f64>,
    /// `[theta_i][h]`: energy of paths stopped at the interaction limit, at sigma = 0; not included
    /// elsewhere.
    pub energy_killed: Vec<f64>,
    /// `[theta_i][h][theta_o][phi_o]`: reflection-only density [1/sr].
    pub refl: Vec<f32>,
    /// `[theta_i][h][sigma][theta_o][phi_o]`: density of all other light [1/sr].
    pub high: Vec<f32>,
    /// `[theta_i][h]`: integral over the sphere of the variance of `refl` [1/sr]: the noise part of a squared
    /// L2 distance.
    pub noise_refl: Vec<f64>,
    /// `[theta_i][h][sigma]`: the same for `high`.
    pub noise_high: Vec<f64>,
    /// `[theta_i]`: number of traced paths, including those that hit nothing.
    pub paths: Vec<u64>,
    /// `[theta_i]`: mean number of fiber surface interactions of a path that hit a fiber.
    pub interactions: Vec<f64>,
    /// Exit positions, if recorded; for a yarn, those of its single plies.
    pub exit: Option<ExitPositions>,
    /// Energies on finer grids; without them, those of the slices are interpolated.
    pub energies: Option<TableEnergies>,
}

impl Table {
    /// [`Table::energies`], or the energies of the slices if there are none.
    pub fn fine_energies(&self) -> Cow<'_, TableEnergies> {
        match &self.energies {
            Some(energies) => Cow::Borrowed(energies),
            None => Cow::Owned(TableEnergies::of_nodes(self)),
        }
    }

    /// Reflection-only slice `[theta_o][phi_o]` at incidence indices `(m, n)`.
    pub fn refl_slice(&self, m: usize, n: usize) -> &[f32] {
        let at = (m * self.h_um.len() + n) * self.grid.len();
        &self.refl[at..at + self.grid.len()]
    }

    /// High-order slice `[theta_o][phi_o]` at incidence indices `(m, n)` and absorption index `k`.
    pub fn high_slice(&self, m: usize, n: usize, k: usize) -> &[f32] {
        let at = ((m * self.h_um.len() + n) * self.sigma_per_um.len() + k) * self.grid.len();
        &self.high[at..at + self.grid.len()]
    }
}
