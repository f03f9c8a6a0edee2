//! Options of a twin: views, absorptions, paths, and resolution of the triangles.

use plywave::twin::SphereBins;
use serde::{Deserialize, Serialize};

/// Resolution of the fibers' triangles. Normals are smooth: those of the swept outline at the vertices,
/// interpolated between.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TwinMesh {
    /// Points around a circle or another convex outline; outlines with dents have more, and points are closer
    /// where an outline bends more.
    pub outline_points: u32,
    /// Largest turn of a fiber's frame from ring to ring, by bend and twist together [rad].
    pub turn_rad: f64,
    /// Longest step from ring to ring [um].
    pub step_um: f64,
}

impl Default for TwinMesh {
    /// Chords of a turn of 0.2 move a fiber 50 um off the axis of its ply inward by 0.25 um half way between
    /// rings, and its neighbors nearly as much.
    fn default() -> Self {
        TwinMesh { outline_points: 24, turn_rad: 0.2, step_um: 20.0 }
    }
}

/// Options of a twin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TwinOptions {
    /// Unit directions that the light comes from, in the cloth's frame; z below 0 is from the back.
    pub views: Vec<[f64; 3]>,
    /// Pairs of absorptions of warp and weft [1/um].
    pub sigma_per_um: Vec<[f64; 2]>,
    /// Paths of a view, rounded up to whole shards.
    pub paths: u64,
    /// Shards of a view.
    pub shards: u32,
    /// Seed of the packing and of the paths.
    pub seed: u64,
    /// Bins of the outgoing sphere.
    pub bins: SphereBins,
    /// Pixels per side of the image of the repeat.
    pub image: u32,
    /// Repeats along x and y; `None`: the same number along both, the least that gives four yarns of each
    /// set, 8 at most, and fewer if memory is short.
    pub repeats: Option<[u32; 2]>,
    /// The triangles.
    pub mesh: TwinMesh,
}

impl Default for TwinOptions {
    /// [`standard_views`]; clear fibers, and absorptions of 0.003 and 0.01 per um in both families; standard
    /// errors of the energies of 0.0007 or less.
    fn default() -> Self {
        TwinOptions {
            views: standard_views(),
            sigma_per_um: vec![[0.0; 2], [0.003; 2], [0.01; 2]],
            paths: 500_000,
            shards: 32,
            seed: 1,
            bins: SphereBins::STANDARD,
            image: 64,
            repeats: None,
            mesh: TwinMesh::default(),
        }
    }
}

impl TwinOptions {
    /// Paths of a shard.
    pub(crate) fn shard_paths(&self) -> u64 {
        self.paths.div_ceil(u64::from(self.shards.max(1))).max(1)
    }
}

/// The direction of a tilt from the face's normal towards an azimuth from x to y [rad]; a tilt beyond pi/2 is
/// from the back.
pub fn direction(tilt_rad: f64, azimuth_rad: f64) -> [f64; 3] {
    let ((sin, cos), (y, x)) = (tilt_rad.sin_cos(), azimuth_rad.sin_cos());
    [sin * x, sin * y, cos]
}

/// Normal; 30, 60 and 75 degrees across the warp (towards x); 30 and 60 along it (towards y); 45 and 60 along
/// the diagonal.
pub fn standard_views() -> Vec<[f64; 3]> {
    [[0.0, 0.0], [30.0, 0.0], [60.0, 0.0], [75.0, 0.0], [30.0, 90.0], [60.0, 90.0], [45.0, 45.0], [60.0, 45.0]]
        .iter()
        .map(|[tilt, azimuth]: &[f64; 2]| direction(tilt.to_radians(), azimuth.to_radians()))
        .collect()
}
