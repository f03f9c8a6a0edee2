//! Fabrics as surfaces.

use crate::{Surface, WAVELENGTHS};
use plywave::fabric::FabricBsdf;
use plywave::{FabricModel, FabricQuery};

impl Surface for FabricModel {
    type At<'a> = FabricBsdf<'a, WAVELENGTHS>;

    fn at(
        &self,
        uv_um: [f32; 2],
        footprint_um: f32,
        wo: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
    ) -> FabricBsdf<'_, WAVELENGTHS> {
        FabricModel::at(self, &FabricQuery { footprint_um, ..FabricQuery::new(uv_um, wo, lambda_um) })
    }
}
