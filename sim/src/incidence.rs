//! What all shards of one incident latitude share.

use crate::rays::dielectric::RoughDielectric;
use plywave::spec::GaussianBeam;
use plywave::table::OutgoingGrid;

/// What is the same for all shards of an incident latitude.
pub(crate) struct Incidence<'a> {
    pub theta_i: f64,
    pub h_um: &'a [f64],
    pub sigma_per_um: &'a [f64],
    pub beam: GaussianBeam,
    pub grid: OutgoingGrid,
    pub surface: RoughDielectric,
    /// The ply's radius [um].
    pub radius_um: f64,
    /// Whether exit positions are recorded.
    pub record_exits: bool,
}
