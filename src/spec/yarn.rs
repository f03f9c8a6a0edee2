//! The yarn spec: its keys as types. Lengths are in um and angles in rad; the unit is part of the key.
//!
//! The ranges of the keys and the relations between them are in `yarn_rules.rs`. [`YarnSpec::parse`] and
//! [`YarnSpec::load`] check every spec by them.

use super::beam::GaussianBeam;
use super::ply_circle::{PlyRing, ply_circle_um};
use super::twist::{Handedness, Twist};
use crate::optics::Metal;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A yarn spec, as in `fabrics/*.toml`. Unknown keys are errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YarnSpec {
    /// Name of the yarn, for information.
    pub name: String,
    /// The main kind of fiber.
    pub fiber: FiberSpec,
    /// A second kind of fiber among them. If absent, all fibers are of the main kind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blend: Option<BlendSpec>,
    /// The ply of fibers.
    pub ply: PlySpec,
    /// Number and arrangement of the plies.
    #[serde(default)]
    pub yarn: YarnGeometry,
    /// The illuminating beam.
    #[serde(default)]
    pub beam: BeamSpec,
    /// Absorption coefficients to tabulate.
    #[serde(default)]
    pub absorption: AbsorptionSpec,
    /// Sizes of the simulation and the fit. A key that is present overrides the preset.
    #[serde(default)]
    pub simulation: SimulationSpec,
    /// Ranges of a family of yarns. If absent, the spec describes a single yarn. The other keys of a yarn
    /// with ranges describe one member of the family.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<FamilySpec>,
}

/// Ranges `[min, max]` of a family ([`crate::ply::PlyFamily`]). A parameter whose key is absent does not
/// vary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FamilySpec {
    /// Pitches of the fibers' helix [um].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fiber_pitch_um: Option<[f64; 2]>,
    /// GGX roughnesses of the fibers' surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_fiber: Option<[f64; 2]>,
    /// Real refractive indices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eta: Option<[f64; 2]>,
}

impl YarnSpec {
    /// Semi-axes of the ply [um]; equal for a circular ply.
    pub fn ply_radii_um(&self) -> [f64; 2] {
        self.ply.radii_um.unwrap_or([self.ply.radius_um.unwrap_or(0.0); 2])
    }

    /// Distance D [um] of the plies' axes from the yarn's axis (Yu 2025, 5.3; [`ply_circle_um`]); 0 for a
    /// single ply.
    pub fn ply_circle_um(&self) -> f64 {
        let [a, b] = self.ply_radii_um();
        ply_circle_um(self.yarn.plies, a.max(b), self.yarn.ply_pitch_um).unwrap_or(0.0)
    }

    /// The plies in the plane across the yarn.
    pub fn ply_ring(&self) -> PlyRing {
        let [a, b] = self.ply_radii_um();
        PlyRing { plies: self.yarn.plies, radius_um: a.max(b), circle_um: self.ply_circle_um() }
    }

    /// Area of the fibers, lumens included and without jitter, relative to the area of the ply.
    pub fn packing_fraction(&self) -> f64 {
        let [a, b] = self.ply_radii_um();
        f64::from(self.ply.fibers) * self.fiber_area_um2() / (PI * a * b)
    }

    /// Mean area of a fiber, lumens included and without jitter [um^2].
    pub fn fiber_area_um2(&self) -> f64 {
        let first = self.fiber.shape.area_um2();
        self.blend.as_ref().map_or(first, |b| first + b.share * (b.fiber.shape.area_um2() - first))
    }

    /// The kinds of fibers: the main kind, then that of the blend.
    pub fn fibers(&self) -> impl Iterator<Item = &FiberSpec> {
        std::iter::once(&self.fiber).chain(self.blend.as_ref().map(|blend| &blend.fiber))
    }
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
    /// Standard deviation [rad] of the rotation of the cross section from fiber to fiber. If absent, all
    /// rotations are equally probable.
    #[serde(default)]
    pub angle_jitter_rad: Option<f64>,
    /// Real refractive index. For a fiber with dispersion it is the index at [`super::SODIUM_UM`]; for a
    /// metal, whose index is built in, it is 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub eta: f64,
    /// Imaginary index of an opaque fiber. If absent, light passes through the fiber.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kappa: Option<f64>,
    /// A metal with its measured index, which makes the fiber opaque.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metal: Option<Metal>,
    /// Dispersion B [um^2]: the index at a wavelength is `eta + B (1/lambda^2 - 1/lambda_D^2)`, where
    /// lambda_D = [`super::SODIUM_UM`] (Cauchy). If absent, the index is constant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dispersion_um2: Option<f64>,
    /// GGX roughness of the fiber's surface; 0 for a smooth one.
    pub alpha_fiber: f64,
    /// Scattering coefficient of the fiber's material, outside of its core [1/um]: pigment, delustrant or
    /// crystals in it; 0 for a clear one.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub scattering_per_um: f64,
    /// Mean cosine of the deflection at a scattering event (Henyey and Greenstein 1941).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub scattering_g: f64,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

/// A second kind of fiber among the first, in every ply of the yarn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlendSpec {
    /// Share of the second kind among the fibers, by number.
    pub share: f64,
    /// Absorption of its material relative to that of the first kind: 1 for the same dye uptake, 0 for no
    /// absorption.
    #[serde(default = "unit")]
    pub dye: f64,
    /// The second kind of fiber.
    pub fiber: FiberSpec,
}

fn unit() -> f64 {
    1.0
}

/// Outlines of the cross sections of fibers; every length is in um.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// Circle.
    Circle {
        /// Radius [um].
        radius_um: f64,
    },
    /// Circle with a concentric round core, for a hollow fiber, hair with its medulla, or a cortex with its
    /// cuticle.
    HollowCircle {
        /// Radius [um].
        radius_um: f64,
        /// Radius of the core, as a fraction of that of the fiber.
        lumen: f64,
        /// Real refractive index of the core; 1 for air.
        #[serde(default = "unit")]
        lumen_eta: f64,
        /// Absorption of the core relative to that of the fiber's material.
        #[serde(default)]
        lumen_dye: f64,
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
        /// Size of the lumen, as a fraction of the outline; 0 for no lumen.
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
    /// Polygon, from a file of `x y` lines [um] or with its points in the spec. [`YarnSpec::load`] moves the
    /// points of the file to `points_um` and empties `file`, so a loaded spec and its text are
    /// self-contained.
    Polygon {
        /// Path of the file, relative to the spec; empty once loaded.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        file: String,
        /// Corners in order [um], in either direction. The polygon is closed implicitly.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        points_um: Vec<[f64; 2]>,
        /// Radius of the rounding of the corners [um].
        rounding_um: f64,
    },
}

impl Shape {
    /// Whether the fiber has a core of air or of another material.
    pub fn has_lumen(&self) -> bool {
        match self {
            Shape::HollowCircle { .. } => true,
            Shape::Kidney { lumen, .. } => *lumen > 0.0,
            _ => false,
        }
    }

    /// Real index of the core, and its absorption relative to that of the fiber's material. For a fiber
    /// without a core they are those of air.
    pub fn core(&self) -> [f64; 2] {
        match self {
            Shape::HollowCircle { lumen_eta, lumen_dye, .. } => [*lumen_eta, *lumen_dye],
            _ => [1.0, 0.0],
        }
    }

    /// Area of the outer outline without jitter [um^2].
    pub fn area_um2(&self) -> f64 {
        match self {
            Shape::Circle { radius_um } | Shape::HollowCircle { radius_um, .. } | Shape::Stone { radius_um, .. } => {
                PI * radius_um * radius_um
            }
            Shape::Ellipse { a_um, b_um } => PI * a_um * b_um,
            // The integral of the dent in `sim/src/geometry/shape.rs`.
            Shape::Kidney { a_um, b_um, dent, .. } => a_um * b_um * (PI - 1.006_44 * dent),
            Shape::RoundedTriangle { radius_um, rounding_um } => {
                let sharp = 0.75 * 3.0_f64.sqrt() * radius_um * radius_um;
                sharp - (3.0 * 3.0_f64.sqrt() - PI) * rounding_um * rounding_um
            }
            Shape::Trilobal { radius_um, depth } => PI * radius_um * radius_um * (1.0 + 0.5 * depth * depth),
            Shape::Serrated { radius_um, depth, .. } => PI * radius_um * radius_um * (1.0 + 0.3 * depth * depth),
            Shape::Polygon { points_um, .. } => {
                let n = points_um.len();
                let twice = |i: usize| {
                    let (a, b) = (points_um[i], points_um[(i + 1) % n]);
                    a[0] * b[1] - a[1] * b[0]
                };
                0.5 * (0..n).map(twice).sum::<f64>().abs()
            }
        }
    }
}

/// The ply: a packed bundle of twisted fibers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlySpec {
    /// Number of fibers, 1 to 200.
    pub fibers: u32,
    /// Radius R of a circular ply [um], which contains the fibers.
    #[serde(default)]
    pub radius_um: Option<f64>,
    /// Semi-axes of an elliptical ply [um] (Yu 2025, Fig. 17).
    #[serde(default)]
    pub radii_um: Option<[f64; 2]>,
    /// Minimum gap between fibers [um].
    #[serde(default = "default_gap_um")]
    pub min_gap_um: f64,
    /// Radial density of the fibers.
    #[serde(default)]
    pub packing: Packing,
    /// Pitch of the helix [um]. If absent, fibers are parallel.
    #[serde(default)]
    pub fiber_pitch_um: Option<f64>,
    /// Handedness of the helix.
    #[serde(default)]
    pub handedness: Handedness,
}

impl PlySpec {
    /// Twist of the fibers about the ply's axis; none for parallel fibers.
    pub fn twist(&self) -> Twist {
        Twist::from_pitch(self.fiber_pitch_um, self.handedness)
    }
}

fn default_gap_um() -> f64 {
    0.2
}

/// Radial density of the fibers in a ply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Packing {
    /// Densest in the middle and decreasing to zero at the surface, as measured in spun yarns; the rim is
    /// ragged.
    #[default]
    Falling,
    /// Uniform with fibers along the wall, as hard particles fill a container.
    Lined,
}

/// The yarn: P plies of one radius with their axes on a circle about the yarn's axis (Yu 2025, 5.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct YarnGeometry {
    /// Number of plies, 1 to 7.
    pub plies: u32,
    /// Pitch of the plies' helix [um]. If absent, plies are parallel. The pitch determines the plies'
    /// distance from the yarn's axis.
    pub ply_pitch_um: Option<f64>,
    /// Handedness of the plies' helix, for information: scattering treats plies as parallel.
    pub handedness: Handedness,
}

impl Default for YarnGeometry {
    fn default() -> Self {
        YarnGeometry { plies: 1, ply_pitch_um: None, handedness: Handedness::Z }
    }
}

/// The beam of the spec.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BeamSpec {
    /// Waist w0 [um].
    pub w0_um: f64,
    /// Wavelength of the divergence [um].
    pub lambda_um: f64,
    /// Distance [um] beyond which the beam is dark. If absent, it is 2 w0.
    pub d_cut_um: Option<f64>,
}

impl Default for BeamSpec {
    fn default() -> Self {
        BeamSpec { w0_um: 10.0, lambda_um: 0.55, d_cut_um: None }
    }
}

impl BeamSpec {
    /// The beam, with d_cut resolved to a value.
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
    /// Absorption coefficients [1/um], ascending from 0.
    pub sigma_per_um: Vec<f64>,
}

impl Default for AbsorptionSpec {
    fn default() -> Self {
        AbsorptionSpec { sigma_per_um: vec![0.0, 0.001, 0.003, 0.01, 0.03, 0.1] }
    }
}

/// Sizes of a run. An absent key takes the preset's value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationSpec {
    /// Number of geometry instances in the ensemble.
    pub instances: Option<u32>,
    /// Number of paths for each incident latitude.
    pub paths_per_theta: Option<u64>,
    /// Number of incident latitudes, odd.
    pub theta_i_nodes: Option<u32>,
    /// Maximum incident latitude [rad].
    pub theta_i_max_rad: Option<f64>,
    /// Number of beam offsets, odd.
    pub h_nodes: Option<u32>,
    /// Number of latitude bins of the outgoing sphere.
    pub theta_o_bins: Option<u32>,
    /// Number of azimuth bins of the outgoing sphere.
    pub phi_o_bins: Option<u32>,
    /// Number of lobes of f_refl (the paper uses 1).
    pub lobes_refl: Option<u32>,
    /// Number of lobes of f_high.
    pub lobes_high: Option<u32>,
}
