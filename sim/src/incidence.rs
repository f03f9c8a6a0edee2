//! What all shards of one incident latitude share.

use crate::energy_grids::EnergyGrids;
use crate::rays::surface::Surfaces;
use plywave::spec::GaussianBeam;
use plywave::table::OutgoingGrid;

/// What is the same for all shards of an incident latitude.
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
    /// Sideways tilt of a ray in the xy plane that is not exceeded: 5 standard deviations, at most 1 rad.
    pub fn sideways_rad(&self) -> f64 {
        (5.0 * self.beam.angular_sd_rad() / self.theta_i.cos().max(1e-3)).min(1.0)
    }
}
