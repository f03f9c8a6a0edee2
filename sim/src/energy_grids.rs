//! The grids of one ply's energies (`energies.rs`): axes of r_d and of the shares of scattered light, and
//! bins of lateral positions.

use crate::options::SimOptions;
use plywave::spec::YarnSpec;
use plywave_tables::table::TableEnergies;

/// Number of bins of lateral positions per standard deviation of the beam, and maximum number of bins.
const BINS_PER_SD: f64 = 16.0;
const MAX_BINS: f64 = 8192.0;
/// Steps of r_d, in standard deviations of the beam or of the ridge blurred by it; the error of a spline is
/// then 4e-4 of an edge's height.
const MISS_STEP_SDS: f64 = 0.4;
const RIDGE_STEP_SDS: f64 = 0.6;
/// Steps of r_d along theta_i away from the ridge, and of the shares [rad].
const PLAIN_STEP_RAD: f64 = 0.07;
const SHARE_STEP_RAD: f64 = 0.18;
/// Step of the shares along h, in standard deviations of the beam.
const SHARE_STEP_SDS: f64 = 1.2;
/// Maximum number of nodes of an axis.
const MAX_NODES: usize = 1001;
/// Number of rays per latitude of r_d over all instances; rays per path in short runs; minimum number of rays
/// per instance.
const RAYS: u64 = 1 << 18;
const RAYS_A_PATH: u64 = 1;
const MIN_RAYS: u64 = 1 << 11;

/// Grids of the energies, as refinements of the slices' grids.
#[derive(Clone, Debug)]
pub(crate) struct EnergyGrids {
    /// Number of latitudes of r_d per latitude of the slices.
    pub miss_rows: usize,
    pub miss_h_um: Vec<f64>,
    /// Number of latitudes of the shares per latitude of the slices.
    pub share_rows: usize,
    pub share_h_um: Vec<f64>,
    pub bins: PositionBins,
    /// Number of rays per instance and latitude.
    pub rays: u64,
}

/// Equal bins of lateral positions in [-reach, reach].
#[derive(Clone, Copy, Debug)]
pub(crate) struct PositionBins {
    pub reach_um: f64,
    pub count: usize,
}

impl PositionBins {
    pub fn width_um(&self) -> f64 {
        2.0 * self.reach_um / self.count as f64
    }

    pub fn center_um(&self, bin: usize) -> f64 {
        self.width_um() * (bin as f64 + 0.5) - self.reach_um
    }

    /// The bin of a position, or `None` beyond the reach.
    pub fn of(&self, x: f64) -> Option<usize> {
        (x.abs() < self.reach_um).then(|| (((x + self.reach_um) / self.width_um()) as usize).min(self.count - 1))
    }

    /// `[bin]`: density of the beam about `h` over its maximum among the bins for which `counts` is true, at
    /// most 1.
    pub fn beam(&self, h: f64, sd: f64, counts: impl Fn(usize) -> bool) -> Vec<f64> {
        let log = |b: usize| -0.5 * ((self.center_um(b) - h) / sd).powi(2);
        let top = (0..self.count).filter(|b| counts(*b)).map(log).fold(f64::NEG_INFINITY, f64::max);
        (0..self.count).map(|b| (log(b) - top).min(0.0).exp()).collect()
    }
}

/// Number of latitudes of the shares per latitude of the slices.
pub(crate) fn share_rows(options: &SimOptions) -> usize {
    let theta_i = options.theta_i();
    refinement(theta_i[1] - theta_i[0], SHARE_STEP_RAD, theta_i.len())
}

/// Number of parts of a step such that each is at most `wanted`, for an axis of `nodes`.
fn refinement(step: f64, wanted: f64, nodes: usize) -> usize {
    ((step / wanted - 1e-9).ceil().max(1.0) as usize).min(((MAX_NODES - 1) / (nodes - 1)).max(1))
}

/// An axis with each step divided into `parts`.
fn refined(axis: &[f64], parts: usize) -> Vec<f64> {
    let cells = (axis.len() - 1) * parts;
    let (first, last) = (axis[0], axis[axis.len() - 1]);
    (0..=cells).map(|i| first + (last - first) * i as f64 / cells as f64).collect()
}

impl EnergyGrids {
    pub fn new(spec: &YarnSpec, options: &SimOptions, theta_i: &[f64], h_um: &[f64]) -> EnergyGrids {
        let (sd, radius) = (spec.beam.beam().sd_um(), spec.ply_ring().radius_um);
        let reach_um = h_um[h_um.len() - 1];
        let along_h = |sds: f64| refined(h_um, refinement(h_um[1] - h_um[0], sds * sd, h_um.len()));
        let k = spec.ply.twist().rad_per_um().abs();
        let width = (sd * k / (1.0 + (k * radius).powi(2))).hypot(spec.beam.beam().angular_sd_rad());
        let ridge = (1.0f64).atan2(k * radius) - 3.0 * width < theta_i[theta_i.len() - 1];
        let step = if k > 0.0 && ridge { (RIDGE_STEP_SDS * width).min(PLAIN_STEP_RAD) } else { PLAIN_STEP_RAD };
        EnergyGrids {
            miss_rows: refinement(theta_i[1] - theta_i[0], step, theta_i.len()),
            miss_h_um: along_h(MISS_STEP_SDS),
            share_rows: share_rows(options),
            share_h_um: along_h(SHARE_STEP_SDS),
            bins: PositionBins {
                reach_um,
                count: (2.0 * reach_um / sd * BINS_PER_SD).ceil().clamp(64.0, MAX_BINS) as usize,
            },
            rays: (RAYS.min(RAYS_A_PATH * options.paths_per_theta) / u64::from(options.instances.max(1))).max(MIN_RAYS),
        }
    }

    /// Fractions of the beams at `miss_h_um` that hit no fiber, from the probability to hit one, `hits[bin]`,
    /// and the beam's standard deviation `sd` [um].
    pub fn missed(&self, hits: &[f64], sd: f64) -> Vec<f64> {
        let density = self.bins.width_um() / (sd * std::f64::consts::TAU.sqrt());
        let of = |h: &f64| {
            let hit: f64 = (0..self.bins.count)
                .map(|b| hits[b] * density * (-0.5 * ((self.bins.center_um(b) - h) / sd).powi(2)).exp())
                .sum();
            (1.0 - hit).clamp(0.0, 1.0)
        };
        self.miss_h_um.iter().map(of).collect()
    }

    /// Unfilled energies for slices at these nodes.
    pub fn empty(&self, theta_i: &[f64], sigmas: usize) -> TableEnergies {
        let (miss_theta_i, share_theta_i) = (refined(theta_i, self.miss_rows), refined(theta_i, self.share_rows));
        let nodes = miss_theta_i.len() * self.miss_h_um.len();
        let shares = share_theta_i.len() * self.share_h_um.len();
        TableEnergies {
            miss: vec![0.0; nodes],
            miss_se: vec![0.0; nodes],
            met: vec![0.0; miss_theta_i.len() * self.bins.count],
            share_refl: vec![0.0; shares],
            share_high: vec![0.0; shares * sigmas],
            share_se: vec![0.0; shares * (1 + sigmas)],
            miss_theta_i,
            share_theta_i,
            miss_h_um: self.miss_h_um.clone(),
            share_h_um: self.share_h_um.clone(),
        }
    }
}
