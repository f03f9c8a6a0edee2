//! Cloth models as surfaces of the renderer.

use crate::{Surface, WAVELENGTHS};
use plywave::cloth::ClothBsdf;
use plywave::{ClothModel, ClothQuery};

impl Surface for ClothModel {
    type At<'a> = ClothBsdf<'a, WAVELENGTHS>;

    fn at(
        &self,
        uv_um: [f32; 2],
        footprint_um: f32,
        wo: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
    ) -> ClothBsdf<'_, WAVELENGTHS> {
        self.at(&ClothQuery { footprint_um, ..ClothQuery::new(uv_um, wo, lambda_um) })
    }
}
