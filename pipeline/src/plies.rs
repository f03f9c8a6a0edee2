//! Ply models of a cloth's yarns: named by the spec, found among models that are at hand, or built and kept.

use crate::build::build;
use crate::cache::{cloth_cache, digest_of_bytes, keep};
use crate::error::Error;
use crate::recipe::{Quality, Recipe};
use crate::run::Run;
use plywave::PlyModel;
use plywave::io::{Document, ModelLibrary};
use plywave::spec::YarnSpec;
use plywave_sim::SimError;
use plywave_textile::alike;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Version of the building of plies, which increases with each change of simulation or fit; it is part of the
/// key of the cache.
const MAKING: u32 = 2;
/// Seed of models that are built for a cloth.
const SEED: u64 = 1;

/// Models of a cloth's plies.
#[derive(Clone, Debug)]
pub struct ClothPlyModels {
    /// `[kind]`: the model.
    pub models: Vec<Arc<PlyModel>>,
    /// Where they come from, one note per kind that names no model.
    pub notes: Vec<String>,
}

/// The plies of a cloth's yarns, each with its model if there is one.
#[derive(Clone, Debug)]
pub struct ClothPlies {
    pub(crate) plies: Vec<Ply>,
    pub(crate) quality: Option<Quality>,
}

/// A ply of a kind of yarn.
#[derive(Clone, Debug)]
pub(crate) struct Ply {
    /// Name of the kind.
    pub kind: &'static str,
    /// Name of the yarn in messages.
    pub file: String,
    pub spec: YarnSpec,
    pub spec_text: String,
    /// The model that is at hand.
    pub model: Option<Arc<PlyModel>>,
    /// Where it comes from; empty if the spec of the cloth names it.
    pub origin: String,
}

impl ClothPlies {
    /// Whether every ply has a model, so that none is built.
    pub fn are_complete(&self) -> bool {
        self.plies.iter().all(|ply| ply.model.is_some())
    }

    /// Texts of the specs of the plies, by kind of yarn: those of the models at hand, or else those that the
    /// spec of the cloth describes.
    pub fn spec_texts(&self) -> Vec<String> {
        let text = |ply: &Ply| match &ply.model {
            Some(model) => model.data().spec_text.clone(),
            None => ply.spec_text.clone(),
        };
        self.plies.iter().map(text).collect()
    }

    /// The models; missing ones are built, of the quality of the recipe or preview, and kept in the cache.
    ///
    /// # Errors
    /// Those of [`crate::build`].
    pub fn build(self, run: &Run<'_>) -> Result<ClothPlyModels, Error> {
        let mut all = ClothPlyModels { models: Vec::new(), notes: Vec::new() };
        let mut built: Vec<(String, Arc<PlyModel>)> = Vec::new();
        for Ply { kind, file, spec, spec_text, model, mut origin } in self.plies {
            let before = || built.iter().find(|(text, _)| *text == spec_text).map(|(_, model)| model.clone());
            let model = match model.or_else(before) {
                Some(model) => model,
                None => {
                    let model;
                    (model, origin) =
                        build_ply(&file, spec, &spec_text, self.quality.unwrap_or(Quality::Preview), run)?;
                    built.push((spec_text, Arc::new(model)));
                    built[built.len() - 1].1.clone()
                }
            };
            all.notes.extend((!origin.is_empty()).then(|| format!("{kind}: {origin}")));
            all.models.push(model);
        }
        Ok(all)
    }
}

/// File of a ply's model in the cache.
fn cached(spec_text: &str, quality: Quality) -> Option<PathBuf> {
    let of = format!("{} {MAKING} {} {SEED}\n{spec_text}", env!("CARGO_PKG_VERSION"), quality.name());
    Some(cloth_cache()?.join("plies").join(format!("{}.pwm", &digest_of_bytes(of.as_bytes())[..24])))
}

/// The model of a ply in the cache, of this quality.
fn in_cache(spec_text: &str, quality: Quality) -> Option<(PlyModel, String)> {
    let path = cached(spec_text, quality)?;
    let model = path.exists().then(|| PlyModel::load(&path).ok()).flatten()?;
    Some((model, format!("its model of {} quality in the cache", quality.name())))
}

/// The best model in the library that stands for the ply.
fn in_library(wanted: &YarnSpec, library: &ModelLibrary, least: Option<Quality>) -> Option<(PlyModel, String)> {
    let off = |spec: &YarnSpec| (spec.ply_radii_um()[0] / wanted.ply_radii_um()[0] - 1.0).abs();
    let candidates = library.names().into_iter().filter_map(|name| {
        let (shown, bytes) = library.read(&name).ok()?;
        let model = PlyModel::from_bytes(&bytes, &shown).ok()?;
        let quality = Quality::of_preset(&model.data().preset);
        let spec = YarnSpec::parse(&model.data().spec_text, &shown).ok()?;
        let is_good = least.is_none_or(|least| quality >= least) && alike(wanted, &spec);
        is_good.then(|| (quality, off(&spec), model, name))
    });
    let best = candidates.max_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)))?;
    Some((best.2, format!("the model {} of the library", best.3)))
}

/// The model that is at hand for a ply, and where it comes from: in the library, then in the cache, the best
/// first; models below `least` do not count.
pub(crate) fn find(
    spec: &YarnSpec,
    spec_text: &str,
    library: &ModelLibrary,
    least: Option<Quality>,
) -> Option<(Arc<PlyModel>, String)> {
    let good = [Quality::Reference, Quality::Standard, Quality::Preview];
    let mut good = good.into_iter().filter(|quality| least.is_none_or(|least| *quality >= least));
    let found = in_library(spec, library, least).or_else(|| good.find_map(|quality| in_cache(spec_text, quality)));
    found.map(|(model, origin)| (Arc::new(model), origin))
}

/// An error of fibers that do not fit, in the words of a yarn.
fn no_room(file: &str, error: Error) -> Error {
    let job = if let Error::Simulation { source, .. } = &error { source.job() } else { None };
    let Some(SimError::CannotPack { fibers, radius_um, packing_fraction, least_radius_um, .. }) = job else {
        return error;
    };
    let fits = packing_fraction * (radius_um / least_radius_um).powi(2);
    let hint =
        format!("{fibers} fibers find no room at random in a strand of R {radius_um:.1} um; use {fits:.2} or less");
    Error::Runtime(plywave::Error::Invalid {
        file: file.into(),
        key: "packing".into(),
        value: format!("{packing_fraction:.3}"),
        hint,
    })
}

/// Builds a ply's model and keeps it in the cache; the note says how long it took and where it is.
pub(crate) fn build_ply(
    file: &str,
    spec: YarnSpec,
    spec_text: &str,
    quality: Quality,
    run: &Run<'_>,
) -> Result<(PlyModel, String), Error> {
    let begun = Instant::now();
    let recipe = Recipe { seed: SEED, ..Recipe::new(file, spec, spec_text, quality) };
    let built = build(&recipe, &Run { parts: None, speckle_parts: None, ..*run });
    let data = built.map_err(|error| no_room(file, error))?.model;
    let took = format!("its model was built in {:.0} s, of {} quality", begun.elapsed().as_secs_f64(), quality.name());
    let note = match cached(spec_text, quality) {
        None => format!("{took}; it is not kept: there is no cache folder; PLYWAVE_CACHE names one"),
        Some(path) => match keep(&data, &path) {
            Ok(()) => format!("{took}, and is kept in {}", path.display()),
            Err(error) => format!("{took}; it could not be kept: {error}"),
        },
    };
    // As it is read from the cache: files have fewer digits.
    Ok((PlyModel::from_bytes(&data.to_bytes()?, file)?, note))
}
