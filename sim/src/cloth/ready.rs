//! All that shading needs of a cloth, found by lines and paths through it.

mod between;
mod cones;
mod follow;
mod hairs;
mod paths;
mod regression;
mod shadows;
mod splines;

use crate::error::SimError;
use plywave::cloth::making::{ALBEDO_NODES, ClothPlies, FarData, albedo, far_view};
use plywave::cloth::{ClothCurves, ClothData, ClothModel, ClothOptions, GapLight};
use plywave::{Error, PlyModel};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// How far the making of a cloth is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClothStep {
    /// What is found: shadows, light between plies, albedo, or the mean over the cell.
    pub what: &'static str,
    /// Parts of it that are done.
    pub done: usize,
    /// All parts.
    pub total: usize,
}

/// Called after each part, from any thread; `false` stops.
pub type Told<'a> = &'a (dyn Fn(ClothStep) -> bool + Sync);

/// How much of a cloth is made, and how well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// As [`Effort::Near`] with a 32nd of the paths, for editors.
    Draft,
    /// All but the mean over the cell, whose pixels are then as those of a camera nearby.
    Near,
    /// All.
    Full,
}

/// Makes a cloth of its curves: finds shadows, light between plies, the albedo and, some seconds more, the
/// mean over the cell for pixels that cover many yarns. `models` has one for each kind of yarn. The result
/// does not depend on the number of threads.
///
/// # Errors
/// [`SimError::Stopped`], and [`Error::Invalid`] for models whose plies are not those of the curves, and as
/// [`plywave::cloth::ClothLines::new`].
pub fn make_ready(
    spec_text: &str,
    name: &str,
    curves: &ClothCurves,
    models: &[Arc<PlyModel>],
    effort: Effort,
    told: Told<'_>,
) -> Result<ClothData, SimError> {
    let models: Vec<Arc<PlyModel>> =
        models.iter().map(|m| Ok(Arc::new(m.of_lines()?))).collect::<Result<_, Error>>()?;
    let plies = ClothPlies::new(curves, &models)?;
    let shadows = shadows::shadows(&plies, effort, told)?;
    let hairs = hairs::hair_layer(spec_text, curves, &plies, told)?;
    let paths = follow::ClothPaths { plies: &plies, shadows: &shadows, hairs: hairs.as_ref() };
    let between = between::light_between(&paths, effort, told)?;
    let mut data = ClothData {
        spec_text: spec_text.into(),
        name: name.into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        curves: curves.clone(),
        models,
        colors: Default::default(),
        shadows,
        between,
        hairs,
        albedo: [0.0; ALBEDO_NODES],
        far: None,
    };
    let shaded = |data: &ClothData, options: &ClothOptions| ClothModel::from_data(data.clone(), options);
    let of_rays = shaded(&data, &ClothOptions::RAYS)?;
    data.albedo = parts("albedo", 1, told, |_| albedo(&of_rays))?[0];
    if effort == Effort::Full {
        // The layer of hairs is added to the mean of the rest.
        let bare = ClothData { hairs: None, ..data.clone() };
        let cloth = shaded(&bare, &ClothOptions { gaps: GapLight::Diffracted, ..ClothOptions::RAYS })?;
        let views = parts("mean over the cell", FarData::views(&cloth), told, |view| far_view(&cloth, view))?;
        data.far = Some(FarData::new(&cloth, &views));
    }
    Ok(data)
}

/// `of(0)` to `of(total - 1)`, in order.
fn parts<T: Send>(
    what: &'static str,
    total: usize,
    told: Told<'_>,
    of: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, SimError> {
    let go_on = |done: usize| if told(ClothStep { what, done, total }) { Ok(()) } else { Err(SimError::Stopped) };
    go_on(0)?;
    let done = AtomicUsize::new(0);
    let part = |i: usize| {
        let found = of(i);
        go_on(done.fetch_add(1, Ordering::Relaxed) + 1)?;
        Ok(found)
    };
    (0..total).into_par_iter().map(part).collect()
}
