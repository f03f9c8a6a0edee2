//! Data shared by all shards of one incident latitude.

use crate::energy_grids::EnergyGrids;
use crate::rays::surface::Surfaces;
use plywave::spec::GaussianBeam;
use plywave::table::OutgoingGrid;

/// Data shared by all shards of an incident latitude.
pub(crate) struct Incidence<'a> {
    pub theta_i: f64,
    pub h_um: &'a [f64],
    pub sigma_per_um: &'a [f64],
    pub beam: GaussianBeam,
    pub grid: OutgoingGrid,
    pub surfaces: &'a Surfaces,
    /// The ply's radius [um].
    pub radius_um: f64,
    /// Whether exit positions are recorded.
    pub record_exits: bool,
    /// Lateral positions over which the energies are tallied; `None` for whole yarns, whose plies'
    /// orientations h depends on.
    pub energies: Option<&'a EnergyGrids>,
}

impl Incidence<'_> {
    /// Largest sideways tilt of a ray in the xy plane: 5 standard deviations, at most 1 rad.
    pub fn sideways_rad(&self) -> f64 {
        (5.0 * self.beam.angular_sd_rad() / self.theta_i.cos().max(1e-3)).min(1.0)
    }
}
