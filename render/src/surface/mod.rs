//! Surfaces of a scene: meshes and their files, BVH, smooth normals, props.

pub(crate) mod bvh;
pub(crate) mod drape;
pub(crate) mod folds;
pub(crate) mod hem;
pub(crate) mod import;
pub(crate) mod mesh;
pub(crate) mod net;
pub(crate) mod obj;
pub(crate) mod props;
pub(crate) mod sheets;
pub(crate) mod smooth;
