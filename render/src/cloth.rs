//! Fabrics and cloths as surfaces.

use crate::{Surface, WAVELENGTHS};
use plywave::FabricQuery;
use plywave::cloth::ClothSurface;
use plywave::fabric::FabricBsdf;

impl<T: ClothSurface> Surface for T {
    type At<'a>
        = FabricBsdf<'a, WAVELENGTHS>
    where
        Self: 'a;

    fn at(
        &self,
        uv_um: [f32; 2],
        footprint_um: f32,
        wo: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
    ) -> FabricBsdf<'_, WAVELENGTHS> {
        self.surface_at(&FabricQuery { footprint_um, ..FabricQuery::new(uv_um, wo, lambda_um) })
    }
}
