//! The incident latitude of a group of shards, with all that its paths depend on besides the geometry.

use crate::energy_grids::EnergyGrids;
use crate::rays::surface::Surfaces;
use plywave::spec::GaussianBeam;
use plywave_tables::table::OutgoingGrid;

/// Data shared by all shards of one incident latitude `theta_i` [rad].
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
    /// Grids over which the energies are tallied; `None` for whole yarns, where the valid orientations of the
    /// plies depend on h.
    pub energies: Option<&'a EnergyGrids>,
}

impl Incidence<'_> {
    /// Maximum sideways tilt of a ray in the xy plane [rad]: 5 standard deviations, at most 1 rad.
    pub fn sideways_rad(&self) -> f64 {
        (5.0 * self.beam.angular_sd_rad() / self.theta_i.cos().max(1e-3)).min(1.0)
    }
}
