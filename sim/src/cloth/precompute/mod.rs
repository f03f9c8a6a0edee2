//! Precomputation of the tables that shade a cloth, from the curves of its plies and the models of its yarns.
//!
//! Lines through the cloth give the table of shadows (`shadows`) and the layer of hairs (`hairs`). Paths from
//! ply to ply (`paths`, `follow`) give inter-yarn scattering, as regressions over the incident direction
//! (`inter_yarn`, `splines`, `regression`) and as cones (`cones`). The shaded cloth itself then corrects the
//! energy by the direction of the light (`by_light`); the same paths tell where the light leaves
//! (`lit_places`). The shaded cloth gives its brightness over absorption (`brightness`) and its mean over the
//! cell for distant cameras (`far_views`).

mod brightness;
mod by_light;
mod cones;
mod drift;
mod far_views;
mod follow;
mod hairs;
mod inter_yarn;
mod lit_places;
mod paths;
mod regression;
mod shadows;
mod splines;

use crate::error::SimError;
use far_views::{far_data, far_view, passing, view_count};
use plywave::cloth::Brightness;
use plywave::cloth::geometry::ClothPlies;
use plywave::cloth::light::far_grid::PASSING;
use plywave::cloth::{ClothCurves, ClothData, ClothModel, ClothOptions, GapLight};
use plywave::{Error, PlyModel};
use plywave_textile::ClothSpec;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Progress of the precomputation of a cloth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClothStep {
    /// Name of the current stage, such as "shadows" or "mean over the cell".
    pub what: &'static str,
    /// Number of finished parts of the stage.
    pub done: usize,
    /// Number of all parts of the stage.
    pub total: usize,
}

/// Callback that receives the progress after each part, from any thread. Its result `false` stops the work.
pub type Progress<'a> = &'a (dyn Fn(ClothStep) -> bool + Sync);

/// How much of a cloth is precomputed, and with how many samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// The stages of [`Effort::Near`] with 1/32 of the paths, for editors.
    Draft,
    /// All stages except the mean over the cell. Distant pixels are then shaded like those of a near camera.
    Near,
    /// All stages.
    Full,
}

/// Precomputes a cloth from its curves: shadows, hairs, inter-yarn scattering and brightness and, with
/// [`Effort::Full`], the mean over the cell for pixels that cover many yarns. `models` has one model for each
/// kind of yarn. The result does not depend on the number of threads.
///
/// # Errors
/// [`SimError::Stopped`] if `progress` returned `false`, [`Error::Invalid`] for models whose plies do not fit
/// the curves, and the errors of [`plywave::cloth::ClothLines::new`].
pub fn precompute(
    spec: &ClothSpec,
    spec_text: &str,
    curves: &ClothCurves,
    models: &[Arc<PlyModel>],
    effort: Effort,
    progress: Progress<'_>,
) -> Result<ClothData, SimError> {
    let models: Vec<Arc<PlyModel>> =
        models.iter().map(|m| Ok(Arc::new(m.of_lines()?))).collect::<Result<_, Error>>()?;
    let plies = ClothPlies::new(curves, &models)?;
    let shadows = shadows::shadows(&plies, curves, effort, progress)?;
    let (hairs, roots) = hairs::hair_layer(spec, curves, &plies, progress)?.unzip();
    let drifts: Vec<_> = models.iter().map(|model| drift::Drift::new(model)).collect();
    let paths = follow::ClothPaths { plies: &plies, shadows: &shadows, hairs: hairs.as_ref(), drifts: &drifts };
    let (inter_yarn, followed) = inter_yarn::inter_yarn(&paths, effort, progress)?;
    let runs = plies.runs;
    let mut data = ClothData {
        spec_text: spec_text.into(),
        name: spec.name.clone(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        curves: curves.clone(),
        models,
        color_of: spec.color_of,
        looks: spec.looks(),
        shadows,
        inter_yarn,
        hairs,
        brightness: Brightness::NONE,
        far: None,
    };
    let shaded = |data: &ClothData, options: &ClothOptions| ClothModel::from_data(data.clone(), options);
    data.inter_yarn = by_light::by_light(&data, effort, progress)?.along(runs);
    data.inter_yarn.places = lit_places::lit_places(&data, &followed, effort, progress)?;
    let of_rays = shaded(&data, &ClothOptions::RAYS)?;
    data.brightness = parts("brightness", 1, progress, |_| brightness::brightness(&of_rays))?.remove(0);
    if let (Some(hairs), Some(roots)) = (&mut data.hairs, &roots) {
        hairs.field = Some(hairs::hair_field(roots, curves, &plies, progress)?);
    }
    if effort == Effort::Full {
        // The mean is that of the plies alone; the runtime adds the layer of hairs to it.
        let bare = ClothData { hairs: None, ..data.clone() };
        let cloth = shaded(&bare, &ClothOptions { gaps: GapLight::Diffracted, ..ClothOptions::RAYS })?;
        let views = parts("mean over the cell", view_count(&cloth), progress, |view| far_view(&cloth, view))?;
        let rays = shaded(&bare, &ClothOptions::RAYS)?;
        let passing = parts("passing light", PASSING[0], progress, |latitude| passing(&rays, latitude))?.concat();
        data.far = Some(far_data(&cloth, &views, passing));
    }
    Ok(data)
}

/// The results `of(0)` to `of(total - 1)` in order, evaluated in parallel, with a report after each.
fn parts<T: Send>(
    what: &'static str,
    total: usize,
    progress: Progress<'_>,
    of: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, SimError> {
    let report = |done: usize| if progress(ClothStep { what, done, total }) { Ok(()) } else { Err(SimError::Stopped) };
    report(0)?;
    let done = AtomicUsize::new(0);
    let part = |i: usize| {
        let found = of(i);
        report(done.fetch_add(1, Ordering::Relaxed) + 1)?;
        Ok(found)
    };
    (0..total).into_par_iter().map(part).collect()
}
