//! Reading of fabric specs: from files, from memory, or of models that the host has loaded already.

use super::rules::{FABRIC_RULES, SPACING_UM, check_alike, check_model, check_relations};
use super::spec::{FabricSpec, WeaveSpec, YarnColor, YarnOfFabric};
use super::wif::{self, Wif, WifNote, WifNoteKind, WifSpacing};
use super::yarn::YarnShape;
use super::{Fabric, YarnSet};
use crate::io::{AssetSource, Folder, ModelLibrary, of_key, read_text};
use crate::spec::YarnSpec;
use crate::spec::rules;
use crate::{PlyModel, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest fabric spec that is read [bytes]: a draft of 4096 x 4096 in rows of text takes 17 MB.
const MAX_BYTES: u64 = 32 << 20;

/// A fabric spec with what it refers to: all that a host needs to shade a fabric.
#[derive(Clone, Debug)]
pub struct LoadedFabric {
    /// The spec.
    pub spec: FabricSpec,
    /// The geometry.
    pub fabric: Fabric,
    /// The models that the spec names, each once.
    pub models: Vec<Arc<PlyModel>>,
    /// Path of each model, or its name where it is not from a file.
    pub model_paths: Vec<PathBuf>,
    /// For warp and weft, and each yarn of one repeat of their stripes: the index of its model.
    /// [`LoadedFabric::model_of`] looks it up.
    pub threads: [Vec<usize>; 2],
    /// What was taken where the WIF says nothing or is wrong; none of other weaves.
    pub wif_notes: Vec<WifNote>,
}

impl LoadedFabric {
    /// A fabric of a spec, the WIF if its weave is one, and models, all of which the host has: nothing is
    /// read. `models` are those that the spec names, in the order of [`YarnOfFabric::stripes`], of warp and
    /// weft.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] when the spec does not pass its rules, a WIF or a model is missing, and as
    /// [`FabricSpec::load`].
    pub fn new(spec: FabricSpec, wif: Option<Wif>, models: [Vec<Arc<PlyModel>>; 2]) -> Result<LoadedFabric> {
        spec.check("fabric")?;
        let (mut all, mut names): (Vec<Arc<PlyModel>>, Vec<String>) = (Vec::new(), Vec::new());
        let mut indices = [Vec::new(), Vec::new()];
        for (k, family) in YarnSet::EACH.into_iter().enumerate() {
            let (wanted, _) = spec.yarn(family).stripes();
            if wanted.len() != models[k].len() {
                let hint = format!("hand in {}, one for each that the spec names", wanted.len());
                let key = format!("{}.models", family.name());
                return Err(rules::invalid("fabric", &key, format!("{} models", models[k].len()), hint));
            }
            for (name, model) in wanted.into_iter().zip(&models[k]) {
                let known = all.iter().position(|m| Arc::ptr_eq(m, model));
                indices[k].push(known.unwrap_or_else(|| {
                    all.push(model.clone());
                    names.push(name.to_string());
                    all.len() - 1
                }));
            }
        }
        LoadedFabric::assembled(spec, "fabric", wif, (all, names), indices)
    }

    /// Of parts: `indices` say which of the models each name of a family is.
    fn assembled(
        spec: FabricSpec,
        file: &str,
        wif: Option<Wif>,
        (models, names): (Vec<Arc<PlyModel>>, Vec<String>),
        indices: [Vec<usize>; 2],
    ) -> Result<LoadedFabric> {
        let (draft, colors, in_wif, mut wif_notes) = match (wif, spec.weave.draft()) {
            (Some(wif), None) => (wif.draft, [wif.warp_srgb, wif.weft_srgb], wif.spacing, wif.notes),
            (None, Some(draft)) => (draft, [Vec::new(), Vec::new()], [None, None], Vec::new()),
            (given, _) => {
                let (value, hint) = match given {
                    Some(_) => ("a WIF", "this weave has a draft of its own: hand in none"),
                    None => ("no draft", "hand in the WIF that the spec names"),
                };
                return Err(rules::invalid(file, "weave.kind", value, hint));
            }
        };
        let spacing_um = spacings(&spec, file, &in_wif, &mut wif_notes)?;
        let mut shapes = Vec::with_capacity(2);
        let (mut threads, mut one_by_one) = ([Vec::new(), Vec::new()], [false; 2]);
        for (k, family) in YarnSet::EACH.into_iter().enumerate() {
            let mut first: Option<YarnSpec> = None;
            for &index in &indices[k] {
                let name = &names[index];
                let ply = YarnSpec::parse(&models[index].data().spec_text, &format!("{name} (its spec)"))?;
                check_model(file, family, spec.yarn(family), name, &ply)?;
                match &first {
                    Some(first) => check_alike(file, family, name, &ply, first)?,
                    None => first = Some(ply),
                }
            }
            if let Some(ply) = &first {
                let shape = spec.shape(family, ply, spacing_um[k]);
                if let (None, Some(given)) = (spec.yarn(family).spacing_um, &in_wif[k])
                    && shape.spacing_um < shape.width_um()
                {
                    let hint = format!(
                        "the yarn is {:.2} um wide, more than {} of the WIF; give a spacing of that or more",
                        shape.width_um(),
                        given.source
                    );
                    let key = format!("{}.spacing_um", family.name());
                    return Err(rules::invalid(file, &key, format!("{:.2}", given.um), hint));
                }
                one_by_one[k] = ply.yarn.plies < shape.plies;
                shapes.push(shape);
            }
            threads[k] = spec.yarn(family).stripes().1.into_iter().map(|at| indices[k][at]).collect();
        }
        let [mut warp, mut weft] = shapes[..] else {
            return Err(rules::invalid(file, "warp.model", "(absent)", "give a model of each family"));
        };
        // An absent crimp leaves room for the other family's.
        let room = |other: Option<f64>| 1.0 - other.unwrap_or(0.5);
        if spec.warp.crimp.is_none() {
            warp.crimp = usual_crimp(&warp, &weft).min(room(spec.weft.crimp));
        }
        if spec.weft.crimp.is_none() {
            weft.crimp = usual_crimp(&weft, &warp).min(room(spec.warp.crimp));
        }
        let mut fabric = Fabric::named(draft, [warp, weft], spec.colors(colors), file)?;
        fabric.set_one_by_one(one_by_one);
        let model_paths = names.into_iter().map(PathBuf::from).collect();
        Ok(LoadedFabric { spec, fabric, models, model_paths, threads, wif_notes })
    }

    /// Index in [`LoadedFabric::models`] of the model of a yarn; stripes go on without end.
    pub fn model_index(&self, family: YarnSet, yarn: i32) -> usize {
        let threads = &self.threads[family as usize];
        let at = i64::from(yarn).rem_euclid(threads.len().max(1) as i64);
        threads.get(at as usize).copied().unwrap_or(0)
    }

    /// The model of a yarn.
    pub fn model_of(&self, family: YarnSet, yarn: i32) -> &Arc<PlyModel> {
        &self.models[self.model_index(family, yarn)]
    }

    /// Notes on the fabric, one per line: assumptions where its WIF is silent or wrong, layers that no yarn
    /// joins, and omitted effects that a model does not contain.
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = match &self.spec.weave {
            WeaveSpec::Wif { file } => self.wif_notes.iter().map(|note| format!("{file}: {note}")).collect(),
            WeaveSpec::Draft { .. } => self.fabric.draft().layers_note().into_iter().collect(),
            _ => Vec::new(),
        };
        let mut add = |note: String| {
            if !notes.contains(&note) {
                notes.push(note);
            }
        };
        for threads in &self.threads {
            for &index in threads {
                let (data, model) = (self.models[index].data(), self.model_paths[index].display());
                if data.edge.is_none() {
                    add(format!("{model} has no edge lobes: light beside a ply goes straight on"));
                }
                if data.layers.is_none() {
                    add(format!(
                        "{model} has no layer factors: where two yarns lie, the light is that of the upper one"
                    ));
                }
            }
        }
        notes
    }
}

/// The spacings of warp and weft: the spec's own, else those of the WIF, of which a note tells.
fn spacings(
    spec: &FabricSpec,
    file: &str,
    in_wif: &[Option<WifSpacing>; 2],
    notes: &mut Vec<WifNote>,
) -> Result<[f64; 2]> {
    let (mut spacing_um, mut told) = ([0.0; 2], Vec::new());
    for (k, family) in YarnSet::EACH.into_iter().enumerate() {
        spacing_um[k] = match (spec.yarn(family).spacing_um, &in_wif[k]) {
            (Some(own), _) => own,
            (None, Some(given)) if (SPACING_UM[0]..=SPACING_UM[1]).contains(&given.um) => {
                told.push(format!("{}.spacing_um = {:.1} from {}", family.name(), given.um, given.source));
                given.um
            }
            (None, given) => {
                let key = format!("{}.spacing_um", family.name());
                let hint = match given {
                    None => "give this key; the WIF has no Spacing and no Thickness for it".into(),
                    Some(given) => format!("give this key; {} in the WIF is {:.1} um", given.source, given.um),
                };
                return Err(rules::invalid(file, &key, "(absent)", hint));
            }
        };
    }
    if !told.is_empty() {
        notes.push(WifNote { kind: WifNoteKind::Spacing, text: told.join(", ") });
    }
    Ok(spacing_um)
}

/// Greatest lean of a yarn whose crimp the spec does not give [degrees], as in the cloths that ship.
pub const USUAL_LEAN_DEG: f64 = 25.0;

/// The crimp by which a yarn leans by [`USUAL_LEAN_DEG`] where it is steepest, half way between crossings.
/// 0.5, where both families bend alike, at most.
pub(super) fn usual_crimp(yarn: &YarnShape, other: &YarnShape) -> f64 {
    let radii = 0.5 * (yarn.width_um() + other.width_um());
    (super::profile::amplitude_of(USUAL_LEAN_DEG.to_radians(), other.spacing_um, radii) / radii).min(0.5)
}

impl FabricSpec {
    /// Reads a spec from its text; `file` is for messages only. Files it names are not read.
    ///
    /// # Errors
    /// [`crate::Error::Format`] when the text is not TOML, [`crate::Error::Invalid`] for a key that is
    /// unknown, absent or out of range, and for a draft that binds a yarn nowhere.
    pub fn parse(text: &str, file: &str) -> Result<FabricSpec> {
        let spec: FabricSpec = rules::typed(rules::parse(text, file, &FABRIC_RULES)?, file, &FABRIC_RULES)?;
        check_relations(file, &spec)?;
        Ok(spec)
    }

    /// Checks a spec that was made or changed in code, by the same rules as a parsed one.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`], with `file` as given.
    pub fn check(&self, file: &str) -> Result<()> {
        rules::check_typed(self, file, &FABRIC_RULES)?;
        check_relations(file, self)
    }

    /// Reads a spec, its WIF if it has one, and its models. What the spec names must lie in its folder or
    /// below, or is the name of a model of
    /// [`ModelLibrary::usual`]; [`FabricSpec::load_with`] with [`Folder::anywhere`] allows other places, and
    /// other libraries.
    ///
    /// # Errors
    /// As [`FabricSpec::parse`], [`Wif::parse`] and [`PlyModel::load`], [`crate::Error::Io`] when a file
    /// cannot be read, and
    /// [`crate::Error::Invalid`] for a spacing narrower than the yarn, for a number of plies that a model of
    /// a yarn is not of, for a radius that is not that of the model's plies, and for models of one family
    /// whose yarns differ in size.
    pub fn load(path: impl AsRef<Path>) -> Result<LoadedFabric> {
        FabricSpec::load_file(path, &ModelLibrary::usual())
    }

    /// As [`FabricSpec::load`], with the models of a library.
    ///
    /// # Errors
    /// As [`FabricSpec::load`].
    pub fn load_file(path: impl AsRef<Path>, library: &ModelLibrary) -> Result<LoadedFabric> {
        let path = path.as_ref();
        let (text, file) = (read_text(path, MAX_BYTES)?, path.display().to_string());
        FabricSpec::load_with(&text, &file, &Folder::of_file(path), library)
    }

    /// As [`FabricSpec::load`], from the spec's text and a source of the files it names, which may be in
    /// memory; `file` is for messages. A model that is named without ending is the source's file of this
    /// name, or else with the ending `.pwm`.
    ///
    /// # Errors
    /// As [`FabricSpec::load`].
    pub fn load_from(text: &str, file: &str, assets: &dyn AssetSource) -> Result<LoadedFabric> {
        FabricSpec::load_with(text, file, assets, &ModelLibrary::none())
    }

    /// As [`FabricSpec::load_from`]; names of models that the source does not have are those of the library.
    ///
    /// # Errors
    /// As [`FabricSpec::load`].
    pub fn load_with(text: &str, file: &str, assets: &dyn AssetSource, library: &ModelLibrary) -> Result<LoadedFabric> {
        let spec = FabricSpec::parse(text, file)?;
        let wif = match &spec.weave {
            WeaveSpec::Wif { file: name } => {
                let bytes = assets.read(name, wif::MAX_BYTES);
                let bytes = bytes.map_err(|error| of_key(file, "weave.file", name, error, ""))?;
                Some(Wif::parse(&bytes, &assets.display(name))?)
            }
            _ => None,
        };
        let (mut models, mut names): (Vec<Arc<PlyModel>>, Vec<String>) = (Vec::new(), Vec::new());
        let mut indices = [Vec::new(), Vec::new()];
        for (k, family) in YarnSet::EACH.into_iter().enumerate() {
            let yarn = spec.yarn(family);
            for (i, name) in yarn.stripes().0.into_iter().enumerate() {
                let key = match yarn.models.keys().nth(i).filter(|_| yarn.model.is_none()) {
                    Some(letter) => format!("{}.models.{letter}", family.name()),
                    None => format!("{}.model", family.name()),
                };
                let (shown, bytes) = library.named(file, &key, name, assets)?;
                let known = names.iter().position(|known| *known == shown);
                indices[k].push(match known {
                    Some(index) => index,
                    None => {
                        models.push(Arc::new(PlyModel::from_bytes(&bytes, &shown)?));
                        names.push(shown);
                        names.len() - 1
                    }
                });
            }
        }
        LoadedFabric::assembled(spec, file, wif, (models, names), indices)
    }

    /// Shape of the yarns of a family at a spacing, of the plies of a yarn spec where the fabric's does not
    /// give their radius.
    pub fn shape(&self, family: YarnSet, ply: &YarnSpec, spacing_um: f64) -> YarnShape {
        let yarn = self.yarn(family);
        let [a, b] = ply.ply_radii_um();
        YarnShape {
            plies: yarn.plies,
            ply_radius_um: yarn.ply_radius_um.unwrap_or(a.max(b)),
            ply_pitch_um: yarn.ply_pitch_um,
            handedness: yarn.handedness,
            spacing_um,
            crimp: yarn.crimp.unwrap_or(0.5),
            d_cut_um: ply.beam.beam().d_cut_um,
        }
    }

    /// Colors of one repeat of ends and picks, or of all of them: the spec's own take precedence over a
    /// WIF's.
    fn colors(&self, threads: [Vec<[f32; 3]>; 2]) -> [Vec<YarnColor>; 2] {
        let [warp, weft] = threads;
        let of = |yarn: &YarnOfFabric, threads: Vec<[f32; 3]>| match (yarn.srgb, yarn.sigma_per_um) {
            (Some(srgb), _) => vec![YarnColor::Srgb(srgb.map(|c| c as f32))],
            (None, Some(sigma)) => vec![YarnColor::Sigma(sigma as f32)],
            (None, None) if threads.is_empty() => vec![YarnColor::Undyed],
            (None, None) => threads.into_iter().map(YarnColor::Srgb).collect(),
        };
        [of(&self.warp, warp), of(&self.weft, weft)]
    }
}
