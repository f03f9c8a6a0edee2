//! Light that plies scatter more than once, light of hairs and of gaps, and the mean BSDF over the cell.

pub(crate) mod absorption;
pub(crate) mod cones;
pub(crate) mod far;
pub mod far_grid;
pub(crate) mod gaps;
pub(crate) mod hair_field;
pub(crate) mod hair_layer;
pub(crate) mod inter_yarn;
pub(crate) mod lit_places;
pub(crate) mod terms;

pub use absorption::{SIGMA_PER_UM, SIGMAS};
pub use cones::{Cone, NORMS};
pub use far_grid::FarData;
pub use hair_field::{HAIR_TEXELS, HairField};
pub use hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES, HAIR_NODES, HairLayer, azimuth, once, once_through};
pub use inter_yarn::{
    CLASSES, CLASSES_A_KIND, InterYarn, InterYarnAt, PAIRS, PLY_CLASSES, Side, class, class_of_hairs,
};
pub use lit_places::{ANGLES, FUNCTIONS, LitPlaces, MAP_NODES, MAPS, RATIOS, Ratios, angle_of, functions};
pub use terms::{FEW, Few, Poly, TERMS, dot, few, terms};
