//! Specs in TOML: their common validation rules, and the yarn spec. The cloth spec is in `cloth/`.

mod beam;
mod family_rules;
mod fiber_index;
mod ply_circle;
mod twist;
mod yarn;
mod yarn_load;
mod yarn_rules;

#[doc(hidden)]
pub mod rules;

pub use beam::GaussianBeam;
pub use fiber_index::SODIUM_UM;
pub use ply_circle::{PlyRing, least_ply_pitch_um, ply_circle_um};
pub use twist::{Handedness, Twist};
pub use yarn::{
    AbsorptionSpec, BeamSpec, BlendSpec, FamilySpec, FiberSpec, Packing, PlySpec, Shape, SimulationSpec, YarnGeometry,
    YarnSpec,
};
pub use yarn_load::POLYESTER;
#[doc(hidden)]
pub use yarn_rules::{FIBER_KEYS, YARN_RULES};
