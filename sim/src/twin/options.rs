//! Options of a twin: views, absorptions, number of paths, outgoing bins, traced repeats, and resolution of
//! the triangles; and the standard views.

use plywave_tables::twin::SphereBins;
use serde::{Deserialize, Serialize};

/// Resolution of the fibers' triangles. Normals are those of the swept outline at the vertices, interpolated
/// in between.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TwinMesh {
    /// Number of points around a circle or another convex outline. Outlines with dents have more points, and
    /// points are closer where the outline bends more.
    pub outline_points: u32,
    /// Maximum rotation of a fiber's frame from ring to ring, by bending and twist together [rad].
    pub turn_rad: f64,
    /// Maximum distance from ring to ring [um].
    pub step_um: f64,
}

impl Default for TwinMesh {
    /// With a rotation of 0.2 rad, the chord of a fiber 50 um off the axis of its ply lies 0.25 um inside of
    /// the helix half way between rings; its neighbors move nearly as much.
    fn default() -> Self {
        TwinMesh { outline_points: 24, turn_rad: 0.2, step_um: 20.0 }
    }
}

/// Options of a twin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TwinOptions {
    /// Unit directions from which the light comes, in the cloth's frame; light with z below 0 hits the back.
    pub views: Vec<[f64; 3]>,
    /// `[sigma][warp, weft]`: absorption [1/um].
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
    /// Repeats along x and y. `None` stands for the same number along both: the smallest that gives four
    /// yarns of each set, at most 8, and fewer if the triangles would exceed the memory limit.
    pub repeats: Option<[u32; 2]>,
    /// Resolution of the triangles.
    pub mesh: TwinMesh,
}

impl Default for TwinOptions {
    /// [`standard_views`] with clear fibers and with absorptions of 0.003 and 0.01 per um in both sets. The
    /// energies have standard errors of 0.0007 or less.
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

/// Unit direction with a tilt from the face's normal and an azimuth from x to y [rad]; a tilt above pi/2
/// points to the back.
pub fn direction(tilt_rad: f64, azimuth_rad: f64) -> [f64; 3] {
    let ((sin, cos), (y, x)) = (tilt_rad.sin_cos(), azimuth_rad.sin_cos());
    [sin * x, sin * y, cos]
}

/// The normal; tilts of 30, 60 and 75 degrees across the warp (towards x), of 30 and 60 degrees along it
/// (towards y), and of 45 and 60 degrees along the diagonal.
pub fn standard_views() -> Vec<[f64; 3]> {
    [[0.0, 0.0], [30.0, 0.0], [60.0, 0.0], [75.0, 0.0], [30.0, 90.0], [60.0, 90.0], [45.0, 45.0], [60.0, 45.0]]
        .iter()
        .map(|[tilt, azimuth]: &[f64; 2]| direction(tilt.to_radians(), azimuth.to_radians()))
        .collect()
}
