//! What the file of a scene of strands holds.

use plywave_render::GeneratedStrands;
use serde::Deserialize;
use std::path::PathBuf;

#[derive(Debug, Deserialize)]
pub struct Spec {
    pub name: String,
    pub strands: StrandsSpec,
    pub fiber: FiberSpec,
    pub camera: CameraSpec,
    #[serde(default)]
    pub lamps: Vec<LampSpec>,
    #[serde(default)]
    pub sky: f32,
    pub floor: Option<FloorSpec>,
    pub ball: Option<BallSpec>,
}

#[derive(Debug, Deserialize)]
pub struct StrandsSpec {
    pub file: Option<PathBuf>,
    pub make: Option<GeneratedStrands>,
    pub radius_um: Option<f32>,
    pub segments: Option<u32>,
    pub seed: Option<u64>,
    pub basis: Option<String>,
    pub whole: Option<bool>,
    pub mm_per_unit: Option<f32>,
    pub shape: Option<String>,
}

#[derive(Debug, Deserialize)]
pub struct FiberSpec {
    /// A table or one of the kinds of analytic fibers.
    pub model: toml::Table,
    pub sigma_per_um: Option<SigmaSpec>,
    #[serde(default)]
    pub near: bool,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub enum SigmaSpec {
    Same(f32),
    Spectrum(Vec<[f32; 2]>),
}

#[derive(Debug, Deserialize)]
pub struct CameraSpec {
    pub from_mm: [f32; 3],
    pub to_mm: [f32; 3],
    pub up: Option<[f32; 3]>,
    pub fov_deg: f32,
}

#[derive(Debug, Deserialize)]
pub struct LampSpec {
    pub from_mm: [f32; 3],
    #[serde(default)]
    pub to_mm: [f32; 3],
    pub size_mm: f32,
    pub radiance: f32,
}

#[derive(Debug, Deserialize)]
pub struct FloorSpec {
    pub height_mm: f32,
    pub albedo: f32,
}

#[derive(Debug, Deserialize)]
pub struct BallSpec {
    #[serde(default)]
    pub center_mm: [f32; 3],
    pub radius_mm: f32,
    pub albedo: f32,
}
