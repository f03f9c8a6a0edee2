//! From a cloth spec to a cloth ready for shading: loads the models that the spec names, computes the curves,
//! precomputes the cloth, and caches the result.

use crate::cache::{cloth_cache, digest_of_bytes, keep};
use crate::error::Error;
use crate::plies::{self, ClothPlies, ClothPlyModels, Ply};
use crate::recipe::Quality;
use crate::run::{Progress, Run, Stage};
use crate::shipped::files_of;
use plywave::Document;
use plywave::PlyModel;
use plywave::cloth::ClothData;
use plywave::io::{AssetSource, Folder, ModelLibrary};
use plywave::spec::YarnSpec;
use plywave_sim::cloth::{ClothStep, Effort, MadeCloth, make_cloth, precompute};
#[cfg(doc)]
use plywave_textile::YarnOfCloth;
use plywave_textile::{ClothSpec, load_yarn};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest cloth spec [bytes], and below it the largest file that a spec names [bytes].
const MAX_SPEC_BYTES: u64 = 1 << 20;
const MAX_BYTES: u64 = 256 << 20;

/// Number of parts in which the progress of the relaxation is reported.
const PARTS: u64 = 1000;

/// Version of the precomputation, which increases with each change of it; it is part of the key of the cache.
const MAKING: u32 = 10;

/// A cloth spec, and the folder of the files that it names.
#[derive(Clone, Debug, PartialEq)]
pub struct ClothRecipe {
    /// Name of the spec in messages.
    pub file: String,
    /// Folder to which the paths in the spec are relative.
    pub folder: PathBuf,
    /// Whether these files may lie outside of that folder.
    pub is_open: bool,
    /// The cloth.
    pub spec: ClothSpec,
    /// Text of the spec, which the cloth file contains.
    pub spec_text: String,
    /// Least quality of the ply models that are found or built for it; `None`: any is taken, and missing ones
    /// are built of preview quality.
    pub quality: Option<Quality>,
    /// Whether the cloth is a draft, which takes less time ([`Effort::Draft`]).
    pub is_draft: bool,
}

/// A precomputed cloth, ready for shading.
#[derive(Clone, Debug)]
pub struct PrecomputedCloth {
    /// The cloth.
    pub data: ClothData,
    /// SHA-256 of all inputs of the cloth, in hex.
    pub digest: String,
    /// Notes, one per line: those of the curves, whether the cloth was computed or found in the cache, and
    /// where it is cached.
    pub notes: Vec<String>,
}

impl ClothRecipe {
    /// Reads the file of a spec. The files that the spec names must lie in its folder or below.
    ///
    /// # Errors
    /// Those of the file and of [`ClothSpec::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<ClothRecipe, Error> {
        let path = path.as_ref();
        let text = plywave::io::read_text(path, MAX_SPEC_BYTES)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(ClothRecipe { is_open: false, ..ClothRecipe::parse(&path.display().to_string(), text, folder)? })
    }

    /// Parses the text of a spec; `file` identifies it in messages, and the paths in it are relative to
    /// `folder`.
    ///
    /// # Errors
    /// Those of [`ClothSpec::parse`].
    pub fn parse(file: &str, text: impl Into<String>, folder: impl Into<PathBuf>) -> Result<ClothRecipe, Error> {
        let spec_text = text.into();
        let spec = ClothSpec::parse(&spec_text, file)?;
        Ok(ClothRecipe {
            file: file.into(),
            folder: folder.into(),
            is_open: true,
            spec,
            spec_text,
            quality: None,
            is_draft: false,
        })
    }

    /// Name of a kind of yarn: `warp`, `weft` or `yarn`.
    pub fn kind_name(&self, kind: usize) -> &'static str {
        self.spec.kind_name(kind)
    }

    fn assets(&self) -> Folder {
        let folder = Folder::new(&self.folder);
        if self.is_open { folder.anywhere() } else { folder }
    }

    fn invalid(&self, key: &str, value: &str, hint: String) -> Error {
        Error::Runtime(plywave::Error::Invalid { file: self.file.clone(), key: key.into(), value: value.into(), hint })
    }

    /// The plies of the yarns, by kind, each with its model if one is at hand: that which the spec names, or
    /// one of the library or the cache for the ply that the spec describes.
    ///
    /// # Errors
    /// Those of [`ModelLibrary::named`], [`YarnOfCloth::ply`] and [`load_yarn`].
    pub fn plies(&self, library: &ModelLibrary) -> Result<ClothPlies, Error> {
        let mut plies: Vec<Ply> = Vec::new();
        for (kind, yarn) in self.spec.yarns().into_iter().enumerate() {
            let kind = self.kind_name(kind);
            let (key, file) = (format!("{kind}.model"), format!("{} ({kind})", self.file));
            let (spec, spec_text) = match &yarn.model {
                Some(model) if !is_toml(model) => {
                    let (shown, bytes) = library.named(&self.file, &key, model, &self.assets())?;
                    let model = PlyModel::from_bytes(&bytes, &shown)?;
                    let spec_text = model.data().spec_text.clone();
                    let spec = YarnSpec::parse(&spec_text, &shown)?;
                    let (model, origin) = (Some(Arc::new(model)), String::new());
                    plies.push(Ply { kind, file, spec, spec_text, model, origin });
                    continue;
                }
                Some(model) => {
                    let assets = self.assets();
                    let bytes = assets.read(model, MAX_SPEC_BYTES).map_err(|error| self.unread(&key, model, error))?;
                    let text = String::from_utf8(bytes);
                    let text = text.map_err(|_| self.invalid(&key, model, "this is no text in UTF-8".into()))?;
                    load_yarn(&text, &assets.display(model), &assets)?
                }
                None => {
                    let spec = yarn.ply(&self.file, kind)?;
                    let text = spec.to_text(&self.file)?;
                    (spec, text)
                }
            };
            let same = plies.iter().find(|ply| ply.spec_text == spec_text);
            let found = match same {
                Some(ply) => ply.model.clone().map(|model| (model, ply.origin.clone())),
                None => plies::find(&spec, &spec_text, library, self.quality),
            };
            let (model, origin) = found.map_or((None, String::new()), |(model, origin)| (Some(model), origin));
            plies.push(Ply { kind, file, spec, spec_text, model, origin });
        }
        Ok(ClothPlies { plies, quality: self.quality })
    }

    /// Error for a yarn spec that cannot be read.
    fn unread(&self, key: &str, model: &str, error: plywave::Error) -> Error {
        match error {
            plywave::Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                self.invalid(key, model, "no such file; leave the key out for the yarn's own ply".into())
            }
            other => other.into(),
        }
    }

    /// Files other than models that the spec names.
    fn files(&self) -> Vec<&str> {
        files_of(&self.spec)
    }

    /// Paths of the files that the spec names, models first, each with a word for its role.
    pub fn inputs(&self) -> Vec<(&'static str, PathBuf)> {
        let models = self.spec.yarns().into_iter().filter_map(|yarn| yarn.model.as_deref());
        let models = models.map(|model| self.folder.join(model));
        let mut all: Vec<_> = models.filter(|path| path.is_file()).map(|path| ("model", path)).collect();
        all.extend(self.files().into_iter().map(|file| ("file of the spec", self.folder.join(file))));
        all.dedup();
        all
    }

    /// Computes the cloth's curves.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the run was stopped, and those of [`make_cloth`].
    pub fn curves(&self, run: &Run<'_>) -> Result<MadeCloth, Error> {
        let assets = self.assets();
        self.curves_of(&mut |named| assets.read(named, MAX_BYTES), run)
    }

    /// Computes the cloth's curves from the files that `read` gives.
    fn curves_of(
        &self,
        read: &mut dyn FnMut(&str) -> plywave::Result<Vec<u8>>,
        run: &Run<'_>,
    ) -> Result<MadeCloth, Error> {
        let last = AtomicU64::new(0);
        let report = |done: u64| run.report(Progress { stage: Stage::Curves, done, total: PARTS });
        report(0);
        let go_on = |share: f64| {
            let done = (share * PARTS as f64) as u64;
            if last.fetch_max(done, Ordering::Relaxed) < done {
                report(done);
            }
            run.check_stop().is_ok()
        };
        let effort = if self.is_draft { Effort::Draft } else { Effort::Full };
        let made = make_cloth(&self.spec, &self.file, read, effort, &go_on);
        made.map_err(|error| Error::of_simulation(error, &self.file))
    }

    /// Precomputes the cloth from its curves and the models of its plies; `has_far` is whether the file gets
    /// the mean over the cell.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the run was stopped, and those of [`precompute`].
    pub fn make(
        &self,
        curves: &MadeCloth,
        models: &[Arc<PlyModel>],
        has_far: bool,
        run: &Run<'_>,
    ) -> Result<ClothData, Error> {
        let report = |ClothStep { what, done, total }: ClothStep| {
            run.report(Progress { stage: Stage::Cloth(what), done: done as u64, total: total as u64 });
            run.check_stop().is_ok()
        };
        let effort = match (self.is_draft, has_far) {
            (true, _) => Effort::Draft,
            (false, true) => Effort::Full,
            (false, false) => Effort::Near,
        };
        let data = precompute(&self.spec, &self.spec_text, &curves.curves, models, effort, &report);
        let mut data = data.map_err(|error| Error::of_simulation(error, &self.file))?;
        data.looks.clone_from(&curves.looks);
        Ok(data)
    }

    /// The precomputed cloth. It is looked up in [`cloth_cache`] by the contents of spec, models and files,
    /// or computed and cached. A damaged file in the cache is replaced.
    ///
    /// # Errors
    /// Those of [`ClothRecipe::plies`], [`ClothPlies::build`], [`ClothRecipe::curves`] and
    /// [`ClothRecipe::make`]. A cache folder that cannot be written results in a note.
    pub fn precomputed(&self, library: &ModelLibrary, run: &Run<'_>) -> Result<PrecomputedCloth, Error> {
        let plies = self.plies(library)?;
        let mut files = FilesOnce { folder: self.assets(), read: BTreeMap::new() };
        let mut read = |named: &str| files.read(named);
        // Weaving takes seconds and refuses what cannot be woven, building a model takes minutes.
        let woven = if plies.are_complete() { None } else { Some(self.curves_of(&mut read, run)?) };
        let ClothPlyModels { models, mut notes } = plies.build(run)?;
        let mut of = format!("{} {MAKING} {}\n{}\n", env!("CARGO_PKG_VERSION"), self.is_draft, self.spec_text);
        for model in &models {
            of += &digest_of_bytes(&model.data().to_bytes()?);
        }
        for named in self.files() {
            of += &digest_of_bytes(&read(named)?);
        }
        let digest = digest_of_bytes(of.as_bytes());
        let cached = cloth_cache().map(|folder| folder.join(format!("{}.pwc", &digest[..24])));
        if let Some(path) = cached.as_ref().filter(|path| path.exists())
            && let Ok(data) = ClothData::load(path)
        {
            return Ok(PrecomputedCloth { data, digest, notes });
        }
        let curves = woven.map_or_else(|| self.curves_of(&mut read, run), Ok)?;
        let data = self.make(&curves, &models, true, run)?;
        notes.extend(curves.notes.iter().cloned());
        notes.push(match cached {
            None => "the cloth is not kept: there is no cache folder; PLYWAVE_CACHE names one".into(),
            Some(path) => match keep(&data, &path) {
                Ok(()) => format!("the cloth was made and is kept in {}", path.display()),
                Err(e) => format!("the cloth was made and could not be kept: {e}"),
            },
        });
        Ok(PrecomputedCloth { data, digest, notes })
    }
}

/// Files of a folder, each of which is read once: what is cached under a file's digest is then made of the
/// same bytes, even if the file changes in the meantime.
struct FilesOnce {
    folder: Folder,
    read: BTreeMap<String, Vec<u8>>,
}

impl FilesOnce {
    fn read(&mut self, name: &str) -> plywave::Result<Vec<u8>> {
        if let Some(bytes) = self.read.get(name) {
            return Ok(bytes.clone());
        }
        let bytes = self.folder.read(name, MAX_BYTES)?;
        self.read.insert(name.into(), bytes.clone());
        Ok(bytes)
    }
}

fn is_toml(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|e| e == "toml")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    const YARN: &str = "fiber = \"polyester bright 14.62 um\"\ncount = \"11.904 dtex\"\npacking = 0.65\n";

    /// A spec whose warp has more keys.
    fn voile(more: &str) -> String {
        format!(
            "name = \"voile\"\n[weave]\nkind = \"plain\"\nends_per_cm = 150\npicks_per_cm = 150\n\
             [warp]\n{more}{YARN}[weft]\n{YARN}"
        )
    }

    /// Yarns without a model get the one of the library that is alike, and so do yarn specs; the error for a
    /// missing model names the key that refers to it.
    #[test]
    fn models_are_found_or_named_by_kind_of_yarn() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = |more: &str| ClothRecipe::parse("voile.toml", voile(more), folder.path()).unwrap();
        let library = crate::model_library();
        let found = |more: &str| recipe(more).plies(&library).unwrap().build(&Run::plain()).unwrap();
        let note = |kind: &str| format!("{kind}: the model polyester_bundle of the library");
        assert_eq!(found("").notes, [note("warp"), note("weft")]);
        let named = found("model = \"polyester_bundle\"\n");
        assert_eq!((named.models.len(), &named.notes[..]), (2, &[note("weft")][..]));
        assert_eq!(recipe("").plies(&library).unwrap().spec_texts()[0], named.models[0].data().spec_text);

        let refused = |more: &str| recipe(more).plies(&library).unwrap_err().to_string();
        let unknown = refused("model = \"polyestr\"\n");
        assert!(unknown.contains("warp.model = polyestr: ") && unknown.contains("polyester_bundle"), "{unknown}");
        assert!(refused("model = \"plies/silk.pwm\"\n").contains("warp.model = plies/silk.pwm: "));
        let missing = "warp.model = ply.toml: no such file; leave the key out for the yarn's own ply";
        assert!(refused("model = \"ply.toml\"\n").contains(missing));
        std::fs::write(folder.path().join("ply.toml"), format!("name = \"ply\"\n[yarn]\n{YARN}")).unwrap();
        assert_eq!(found("model = \"ply.toml\"\n").notes, [note("warp"), note("weft")]);
        assert_eq!([0, 1].map(|kind| recipe("").kind_name(kind)), ["warp", "weft"]);
    }

    /// Curves and digest are of the same bytes, though the file changes between them.
    #[test]
    fn files_of_a_spec_are_read_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("draft.wif");
        std::fs::write(&path, "old").unwrap();
        let mut files = FilesOnce { folder: Folder::new(folder.path()), read: BTreeMap::new() };
        assert_eq!(files.read("draft.wif").unwrap(), b"old");
        std::fs::write(&path, "another").unwrap();
        assert_eq!(files.read("draft.wif").unwrap(), b"old");
        assert!(files.read("../draft.wif").is_err());
    }

    #[test]
    fn curves_are_stopped() {
        let recipe = ClothRecipe::parse("voile.toml", voile(""), "").unwrap();
        let stop = AtomicBool::new(true);
        let stopped = recipe.curves(&Run { stop: Some(&stop), ..Run::plain() });
        assert!(matches!(stopped, Err(Error::Interrupted { .. })), "{stopped:?}");
    }
}
