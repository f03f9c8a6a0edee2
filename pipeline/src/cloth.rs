//! From a cloth spec to a cloth ready for shading: the models that it names, its curves, the cache of cloths
//! that were made.

use crate::error::Error;
use crate::run::{Progress, Run, Stage};
use crate::shipped::ShippedSpec;
use plywave::PlyModel;
use plywave::cloth::{ClothData, ClothSpec, WeaveSpec, YarnOfCloth};
use plywave::io::{AssetSource, Folder, ModelLibrary};
use plywave_sim::cloth::{ClothStep, Effort, MadeCloth, make_cloth, make_ready};
use sha2::{Digest, Sha256};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest cloth spec, and largest file that it names [bytes].
const MAX_SPEC_BYTES: u64 = 1 << 20;
const MAX_BYTES: u64 = 256 << 20;

/// Steps of a relaxation from one report of progress to the next.
const STEPS_TOLD: u64 = 16;

/// How cloths are made, raised by each change of that: those of another number are not found in the cache.
const MAKING: u32 = 3;

/// A cloth spec and the folder of the files that it names.
#[derive(Clone, Debug, PartialEq)]
pub struct ClothRecipe {
    /// Name of the spec in messages.
    pub file: String,
    /// Folder of the files that it names.
    pub folder: PathBuf,
    /// Whether these may lie outside of it.
    pub is_open: bool,
    /// The cloth.
    pub spec: ClothSpec,
    /// Text of the spec, kept in the cloth file.
    pub spec_text: String,
}

/// A cloth, ready for shading.
#[derive(Clone, Debug)]
pub struct ReadyCloth {
    /// The cloth.
    pub data: ClothData,
    /// SHA-256 of what it is made of, in hex.
    pub digest: String,
    /// Notes, one a line: those of its curves, whether it was made, where it is kept.
    pub notes: Vec<String>,
}

impl ClothRecipe {
    /// Reads a spec's file. The files that it names lie in its folder or below.
    ///
    /// # Errors
    /// Those of the file and of [`ClothSpec::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<ClothRecipe, Error> {
        let path = path.as_ref();
        let text = plywave::io::read_text(path, MAX_SPEC_BYTES)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(ClothRecipe { is_open: false, ..ClothRecipe::parse(&path.display().to_string(), text, folder)? })
    }

    /// Of a spec's text; `file` stands for it in messages, and paths that it names are relative to `folder`.
    ///
    /// # Errors
    /// As [`ClothSpec::parse`].
    pub fn parse(file: &str, text: impl Into<String>, folder: impl Into<PathBuf>) -> Result<ClothRecipe, Error> {
        let spec_text = text.into();
        let spec = ClothSpec::parse(&spec_text, file)?;
        Ok(ClothRecipe { file: file.into(), folder: folder.into(), is_open: true, spec, spec_text })
    }

    /// Name of a kind of yarn: warp, weft or yarn.
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

    /// By kind of yarn, what `of` makes of the key and the name of its model; `hint` is for a yarn without.
    fn each_model<T>(&self, hint: &str, of: impl Fn(&str, &str) -> Result<T, Error>) -> Result<Vec<T>, Error> {
        let one = |(kind, yarn): (usize, &YarnOfCloth)| {
            let key = format!("{}.model", self.kind_name(kind));
            match &yarn.model {
                Some(model) => of(&key, model),
                None => Err(self.invalid(&key, "(absent)", hint.into())),
            }
        };
        self.spec.yarns().into_iter().enumerate().map(one).collect()
    }

    /// The models of its plies, by kind of yarn. A yarn spec that is named stands for the model beside it, of
    /// the same name with `.pwm`.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for a yarn without a model, and as [`ModelLibrary::load`].
    pub fn models(&self, library: &ModelLibrary) -> Result<Vec<Arc<PlyModel>>, Error> {
        self.each_model("name the model of its plies", |key, model| {
            let mut name = model.to_string();
            if is_toml(model) {
                name.replace_range(name.len() - 4.., "pwm");
                // One that leads out of the folder is refused as other models are.
                if !self.folder.join(&name).exists() {
                    if !self.folder.join(model).exists() {
                        return Err(self.missing_spec(key, model, Some(&name)));
                    }
                    let [spec, own] = [model, &name].map(|name| self.folder.join(name).display().to_string());
                    let hint = format!("build its model first: `plywave build {spec} -o {own}`");
                    return Err(self.invalid(key, model, hint));
                }
            }
            Ok(Arc::new(self.model(library, key, &name)?))
        })
    }

    /// The yarn spec that `key` names is not there, nor is `own`, the model beside it.
    fn missing_spec(&self, key: &str, model: &str, own: Option<&str>) -> Error {
        let nor = own.map(|own| format!(", nor its model {own}")).unwrap_or_default();
        let folder = match self.folder.as_os_str().is_empty() {
            true => "this folder".into(),
            false => self.folder.display().to_string(),
        };
        let fix = match ShippedSpec::cloth_with(model) {
            Some(spec) => format!("`plywave new {} -o FOLDER` writes a spec with all that it needs", spec.name()),
            None => "copy both from where the cloth spec comes from".into(),
        };
        self.invalid(key, model, format!("no such file in {folder}{nor}; {fix}"))
    }

    fn model(&self, library: &ModelLibrary, key: &str, name: &str) -> Result<PlyModel, Error> {
        let (shown, bytes) = library.named(&self.file, key, name, &self.assets())?;
        Ok(PlyModel::from_bytes(&bytes, &shown)?)
    }

    /// Texts of the specs of its plies, by kind of yarn: of yarn specs that it names, or in its models.
    ///
    /// # Errors
    /// As [`ClothRecipe::models`].
    pub fn ply_specs(&self, library: &ModelLibrary) -> Result<Vec<String>, Error> {
        self.each_model("name the model of its plies, or their yarn spec (.toml)", |key, model| {
            if !is_toml(model) {
                return Ok(self.model(library, key, model)?.data().spec_text.clone());
            }
            let bytes = self.assets().read(model, MAX_SPEC_BYTES).map_err(|error| match error {
                plywave::Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                    self.missing_spec(key, model, None)
                }
                other => other.into(),
            })?;
            String::from_utf8(bytes).map_err(|_| self.invalid(key, model, "this is no text in UTF-8".into()))
        })
    }

    /// Files that it names besides models.
    pub(crate) fn files(&self) -> Vec<&str> {
        let wif = self.spec.weave.iter().filter_map(|weave| match weave {
            WeaveSpec::Wif { file } => Some(file.as_str()),
            _ => None,
        });
        wif.chain(self.spec.curves.iter().map(|curves| curves.file.as_str())).collect()
    }

    /// Paths of the files that it names, models first, each with a word for what it is.
    pub fn inputs(&self) -> Vec<(&'static str, PathBuf)> {
        let models = self.spec.yarns().into_iter().filter_map(|yarn| yarn.model.as_deref());
        let models = models.map(|model| {
            let path = self.folder.join(model);
            if is_toml(model) { path.with_extension("pwm") } else { path }
        });
        let mut all: Vec<_> = models.filter(|path| path.is_file()).map(|path| ("model", path)).collect();
        all.extend(self.files().into_iter().map(|file| ("file of the spec", self.folder.join(file))));
        all.dedup();
        all
    }

    /// Makes its curves.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when stopped, and those of [`make_cloth`].
    pub fn curves(&self, run: &Run<'_>) -> Result<MadeCloth, Error> {
        let steps = AtomicU64::new(0);
        // The end of a stage without a known end is one more than is done.
        let tell = |done: u64| run.tell(Progress { stage: Stage::Curves, done, total: done + 1 });
        tell(0);
        let assets = self.assets();
        let mut read = |named: &str| assets.read(named, MAX_BYTES);
        let go_on = || {
            let done = steps.fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(STEPS_TOLD) {
                tell(done);
            }
            run.check_stop().is_ok()
        };
        let made = make_cloth(&self.spec, &self.file, &mut read, Effort::Full, &go_on);
        made.map_err(|error| Error::of_simulation(error, &self.file))
    }

    /// Makes the cloth of its curves and the models of its plies; `has_far` is whether with the mean over the
    /// cell.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when stopped, and those of [`make_ready`].
    pub fn make(
        &self,
        curves: &MadeCloth,
        models: &[Arc<PlyModel>],
        has_far: bool,
        run: &Run<'_>,
    ) -> Result<ClothData, Error> {
        let told = |ClothStep { what, done, total }: ClothStep| {
            run.tell(Progress { stage: Stage::Cloth(what), done: done as u64, total: total as u64 });
            run.check_stop().is_ok()
        };
        let effort = if has_far { Effort::Full } else { Effort::Near };
        let data = make_ready(&self.spec_text, &self.spec.name, &curves.curves, models, effort, &told);
        let mut data = data.map_err(|error| Error::of_simulation(error, &self.file))?;
        data.colors.clone_from(&curves.colors);
        Ok(data)
    }

    /// The cloth: looked up by the contents of spec, models and files among those in [`cloth_cache`], or made
    /// and kept there. One that is damaged is made again.
    ///
    /// # Errors
    /// As [`ClothRecipe::models`], [`ClothRecipe::curves`] and [`ClothRecipe::make`]. A folder that cannot be
    /// written is a note.
    pub fn ready(&self, library: &ModelLibrary, run: &Run<'_>) -> Result<ReadyCloth, Error> {
        let models = self.models(library)?;
        let mut of = format!("{} {MAKING}\n{}\n", env!("CARGO_PKG_VERSION"), self.spec_text);
        for model in &models {
            of += &digest_of_bytes(&model.data().to_bytes()?);
        }
        for named in self.files() {
            of += &digest_of_file(&self.folder.join(named))?;
        }
        let digest = digest_of_bytes(of.as_bytes());
        let kept = cloth_cache().map(|folder| folder.join(format!("{}.pwc", &digest[..24])));
        if let Some(path) = kept.as_ref().filter(|path| path.exists())
            && let Ok(data) = ClothData::load(path)
        {
            return Ok(ReadyCloth { data, digest, notes: Vec::new() });
        }
        let curves = self.curves(run)?;
        let data = self.make(&curves, &models, true, run)?;
        let mut notes = curves.notes.clone();
        notes.push(match kept {
            None => "the cloth is not kept: there is no cache folder; PLYWAVE_CACHE names one".into(),
            Some(path) => match keep(&data, &path) {
                Ok(()) => format!("the cloth was made and is kept in {}", path.display()),
                Err(e) => format!("the cloth was made and could not be kept: {e}"),
            },
        });
        Ok(ReadyCloth { data, digest, notes })
    }
}

fn keep(data: &ClothData, path: &Path) -> plywave::Result<()> {
    if let Some(folder) = path.parent() {
        let io = |source| plywave::Error::Io { file: folder.display().to_string(), source };
        std::fs::create_dir_all(folder).map_err(io)?;
    }
    data.save(path)
}

fn is_toml(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|e| e == "toml")
}

/// Folder in which cloths are kept: that of the variable PLYWAVE_CACHE, or `plywave` in the user's cache
/// folder. `None` where there is neither.
pub fn cloth_cache() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    of("PLYWAVE_CACHE").or_else(|| {
        let user = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| Some(of("HOME")?.join(".cache")))?;
        Some(user.join("plywave"))
    })
}

/// Largest file of which a digest is taken [bytes].
const MAX_INPUT: u64 = 1 << 32;

/// SHA-256 of a file's bytes, in hex.
///
/// # Errors
/// [`plywave::Error::Io`].
pub fn digest_of_file(path: &Path) -> plywave::Result<String> {
    let mut file = plywave::io::open_file(path, MAX_INPUT)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hex(&hash.finalize())),
            Ok(n) => hash.update(&buffer[..n]),
            Err(source) => return Err(plywave::Error::Io { file: path.display().to_string(), source }),
        }
    }
}

/// SHA-256 of bytes, in hex.
pub fn digest_of_bytes(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    const VOILE: &str = "name = \"voile\"\n[weave]\nkind = \"plain\"\n\
        [warp]\ncount = { dtex = 12 }\ndensity_g_per_cm3 = 1.38\nends_per_cm = 150\n\
        [weft]\ncount = { dtex = 12 }\ndensity_g_per_cm3 = 1.38\npicks_per_cm = 150\n";

    /// Models that are not there are told by the key that names them.
    #[test]
    fn models_are_named_by_kind_of_yarn() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = |model: &str| {
            let text = VOILE.replace("ends_per_cm", &format!("{model}ends_per_cm"));
            ClothRecipe::parse("voile.toml", text, folder.path()).unwrap()
        };
        let library = crate::model_library();
        let refused = |recipe: &ClothRecipe| recipe.models(&library).unwrap_err().to_string();
        assert_eq!(refused(&recipe("")), "voile.toml: warp.model = (absent): name the model of its plies");
        assert!(refused(&recipe("model = \"polyester\"\n")).contains("weft.model = (absent)"));
        // Neither the spec that is named nor its model: a shipped cloth comes with both.
        let missing = refused(&recipe("model = \"plies/silk_single.toml\"\n"));
        assert!(missing.contains("warp.model = plies/silk_single.toml: no such file in"), "{missing}");
        assert!(missing.contains("nor its model plies/silk_single.pwm; `plywave new organza"), "{missing}");
        assert!(!missing.contains("build"), "{missing}");
        let specs = |recipe: &ClothRecipe| recipe.ply_specs(&library).unwrap_err().to_string();
        assert!(specs(&recipe("model = \"ply.toml\"\n")).contains("warp.model = ply.toml: no such file in"));
        std::fs::write(folder.path().join("ply.toml"), plywave::spec::POLYESTER).unwrap();
        assert!(refused(&recipe("model = \"ply.toml\"\n")).contains("build its model first: `plywave build"));
        assert_eq!([0, 1].map(|kind| recipe("").kind_name(kind)), ["warp", "weft"]);
    }

    #[test]
    fn curves_are_stopped() {
        let recipe = ClothRecipe::parse("voile.toml", VOILE, "").unwrap();
        let stop = AtomicBool::new(true);
        let stopped = recipe.curves(&Run { stop: Some(&stop), ..Run::plain() });
        assert!(matches!(stopped, Err(Error::Interrupted { .. })), "{stopped:?}");
    }
}
