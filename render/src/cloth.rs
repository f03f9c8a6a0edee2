//! Fabrics as surfaces.

use crate::{Surface, WAVELENGTHS};
use plywave::fabric::FabricAt;
use plywave::{FabricBsdf, FabricQuery};

impl Surface for FabricBsdf {
    type At<'a> = FabricAt<'a, WAVELENGTHS>;

    fn at(
        &self,
        uv_um: [f32; 2],
        footprint_um: f32,
        wo: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
    ) -> FabricAt<'_, WAVELENGTHS> {
        FabricBsdf::at(self, &FabricQuery { footprint_um, ..FabricQuery::new(uv_um, wo, lambda_um) })
    }
}
