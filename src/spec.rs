//! The yarn spec: the one place that reads TOML keys. Lengths in um, angles in rad; the unit is part of the key.

use crate::GaussianBeam;
use serde::{Deserialize, Serialize};

/// A yarn spec, as in `fabrics/*.toml`. Unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YarnSpec {
    /// Name of the yarn, for the record.
    pub name: String,
    /// One fiber.
    pub fiber: FiberSpec,
    /// The ply of fibers.
    pub ply: PlySpec,
    /// The illuminating beam.
    #[serde(default)]
    pub beam: BeamSpec,
    /// Absorption coefficients to tabulate.
    #[serde(default)]
    pub absorption: AbsorptionSpec,
    /// Sizes of the simulation and fit; each key that is given overrides the preset.
    #[serde(default)]
    pub simulation: SimulationSpec,
}

/// Cross section, size, jitter and material of the fibers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FiberSpec {
    /// Outline of the cross section.
    pub shape: Shape,
    /// Relative standard deviation of the size from fiber to fiber.
    #[serde(default)]
    pub size_jitter: f64,
    /// Relative standard deviation of the shape's parameters from fiber to fiber.
    #[serde(default)]
    pub shape_jitter: f64,
    /// Standard deviation [rad] of the turn of the cross section from fiber to fiber; absent: any turn, uniformly.
    #[serde(default)]
    pub angle_jitter_rad: Option<f64>,
    /// Real refractive index.
    pub eta: f64,
    /// GGX roughness of the fiber surface, 0 for smooth.
    pub alpha_fiber: f64,
}

/// Outlines of fiber cross sections; every length in um.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// Circle.
    Circle {
        /// Radius [um].
        radius_um: f64,
    },
    /// Ellipse.
    Ellipse {
        /// Semi-axis along x [um].
        a_um: f64,
        /// Semi-axis along y [um].
        b_um: f64,
    },
    /// Kidney with a hollow lumen (cotton).
    Kidney {
        /// Half width [um].
        a_um: f64,
        /// Half height [um].
        b_um: f64,
        /// Depth of the dent, as a fraction of b.
        dent: f64,
        /// Size of the lumen, as a fraction of the outline; 0 for none.
        lumen: f64,
    },
    /// Triangle with rounded corners (silk).
    RoundedTriangle {
        /// Radius of the circle through the sharp corners [um].
        radius_um: f64,
        /// Radius of the rounding [um].
        rounding_um: f64,
    },
    /// Irregular rounded convex polygon (silk).
    Stone {
        /// Mean radius [um].
        radius_um: f64,
        /// Number of corners.
        corners: u32,
        /// Radius of the rounding [um].
        rounding_um: f64,
    },
    /// Three lobes: `r = radius (1 + depth cos 3 t)`.
    Trilobal {
        /// Mean radius [um].
        radius_um: f64,
        /// Relative depth of the lobes.
        depth: f64,
    },
    /// Serrated outline (viscose): `r = radius (1 + depth cos(teeth t))` with irregular teeth.
    Serrated {
        /// Mean radius [um].
        radius_um: f64,
        /// Relative depth of the teeth.
        depth: f64,
        /// Number of teeth.
        teeth: u32,
    },
    /// Polygon from a file of `x y` lines [um].
    Polygon {
        /// Path of the file, relative to the spec.
        file: String,
        /// Radius of the rounding of its corners [um].
        rounding_um: f64,
    },
}

/// The ply: a packed bundle of twisted fibers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlySpec {
    /// Number of fibers, 1 to 200.
    pub fibers: u32,
    /// Radius R of a circular ply [um]; the fibers lie within it.
    #[serde(default)]
    pub radius_um: Option<f64>,
    /// Semi-axes of an elliptical ply [um] (Yu 2025, Fig. 17).
    #[serde(default)]
    pub radii_um: Option<[f64; 2]>,
    /// Smallest gap between fibers [um].
    #[serde(default = "default_gap_um")]
    pub min_gap_um: f64,
    /// Pitch of the helix [um]; absent for parallel fibers.
    #[serde(default)]
    pub fiber_pitch_um: Option<f64>,
    /// Hand of the helix.
    #[serde(default)]
    pub handedness: Handedness,
}

fn default_gap_um() -> f64 {
    0.2
}

/// Hand of the fiber helix. With Z twist (right-handed helix) a fiber's azimuth grows with z, as `2 pi z / pitch`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Handedness {
    /// Right-handed helix.
    #[default]
    Z,
    /// Left-handed helix.
    S,
}

/// The beam of the spec.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BeamSpec {
    /// Waist w0 [um].
    pub w0_um: f64,
    /// Wavelength of the divergence [um].
    pub lambda_um: f64,
    /// Dark beyond this distance [um]; absent: 2 w0.
    pub d_cut_um: Option<f64>,
}

impl Default for BeamSpec {
    fn default() -> Self {
        BeamSpec { w0_um: 10.0, lambda_um: 0.55, d_cut_um: None }
    }
}

impl BeamSpec {
    /// The beam, with d_cut resolved.
    pub fn beam(&self) -> GaussianBeam {
        GaussianBeam {
            w0_um: self.w0_um,
            lambda_um: self.lambda_um,
            d_cut_um: self.d_cut_um.unwrap_or(2.0 * self.w0_um),
        }
    }
}

/// Absorption coefficients to tabulate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AbsorptionSpec {
    /// Ascending, first 0 [1/um].
    pub sigma_per_um: Vec<f64>,
}

impl Default for AbsorptionSpec {
    fn default() -> Self {
        AbsorptionSpec { sigma_per_um: vec![0.0, 0.001, 0.003, 0.01, 0.03, 0.1] }
    }
}

/// Sizes of a run. A key that is absent takes the preset's value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationSpec {
    /// Geometry instances in the ensemble.
    pub instances: Option<u32>,
    /// Paths per incident latitude.
    pub paths_per_theta: Option<u64>,
    /// Incident latitudes, odd.
    pub theta_i_nodes: Option<u32>,
    /// Largest incident latitude [rad].
    pub theta_i_max_rad: Option<f64>,
    /// Beam offsets, odd.
    pub h_nodes: Option<u32>,
    /// Latitude bins of the outgoing sphere.
    pub theta_o_bins: Option<u32>,
    /// Azimuth bins of the outgoing sphere.
    pub phi_o_bins: Option<u32>,
    /// Lobes of f_refl (1 is the paper's choice).
    pub lobes_refl: Option<u32>,
    /// Lobes of f_high.
    pub lobes_high: Option<u32>,
}
