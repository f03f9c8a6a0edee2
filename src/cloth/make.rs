//! All that shading needs of a cloth, found by lines and paths through it.

use super::between::InterYarn;
use super::far::FarData;
use super::file::ClothData;
use super::follow::ClothPaths;
use super::model::ClothModel;
use super::plies::ClothPlies;
use super::query::{ClothOptions, GapLight};
use super::shade::ClothShadows;
use super::{ClothCurves, color_of};
use crate::math::half::{from_half, to_half};
use crate::{PlyModel, Result};
use std::sync::Arc;

impl ClothData {
    /// Finds all that shading needs of a cloth: shadows, light between plies, and, some seconds more, the
    /// mean over the cell for pixels that cover many yarns. `models` has one for each kind of yarn; `told`
    /// says what begins.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for models whose plies are not those of the curves, and as
    /// [`super::ClothLines::new`].
    pub fn make(
        spec_text: &str,
        name: &str,
        curves: &ClothCurves,
        models: &[Arc<PlyModel>],
        has_far: bool,
        mut told: impl FnMut(&'static str) -> Result<()>,
    ) -> Result<ClothData> {
        told("shadows")?;
        let models: Vec<Arc<PlyModel>> = models.iter().map(|m| Ok(Arc::new(m.of_lines()?))).collect::<Result<_>>()?;
        let plies = ClothPlies::new(curves, &models)?;
        let shadows = ClothShadows::new(&plies.lines, &plies);
        told("light between plies")?;
        let between = InterYarn::new(&ClothPaths { plies: &plies, shadows: &shadows });
        let mut data = ClothData {
            spec_text: spec_text.into(),
            name: name.into(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            curves: curves.clone(),
            models,
            colors: Default::default(),
            shadows,
            between,
            albedo: [0.0; color_of::NODES],
            far: None,
        };
        told("albedo")?;
        data.albedo = color_of::albedo(&ClothModel::from_data(data.clone(), &ClothOptions::RAYS)?);
        if has_far {
            told("mean over the cell")?;
            let options = ClothOptions { gaps: GapLight::Diffracted, ..ClothOptions::RAYS };
            let mut far = FarData::new(&ClothModel::from_data(data.clone(), &options)?);
            // As a file has it.
            far.f.as_flattened_mut().iter_mut().for_each(|f| *f = from_half(to_half(*f)));
            data.far = Some(far);
        }
        Ok(data)
    }
}
