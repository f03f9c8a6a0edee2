//! Scenes: bodies and lists of incidences, their text, the checks of their walls, and the discretization of
//! walls by nodes.

pub(crate) mod curve;
pub(crate) mod description;
pub(crate) mod scene_check;
pub(crate) mod scene_toml;
pub(crate) mod section_bodies;
pub(crate) mod single_fiber;
pub(crate) mod symmetry;
pub(crate) mod visible;
