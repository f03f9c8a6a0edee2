//! Ply models by name: `model = "polyester"` in a cloth spec, `plywave info polyester`.

use super::{AssetSource, FileKind, disk, invalid};
use crate::{Error, Result};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Environment variable with folders of models, separated as in `PATH`.
pub const MODELS_VARIABLE: &str = "PLYWAVE_MODELS";
/// Folder of models, relative to the folder of the program.
const SHARED: &str = "../share/plywave/models";
/// Suffix of a model's file.
const ENDING: &str = ".pwm";

/// Models by name. `NAME` means the file `NAME.pwm`. It is searched beside the spec that names it, then in
/// the library's folders in their order, then among the models compiled into the host.
///
/// ```
/// use plywave::io::ModelLibrary;
///
/// assert!(ModelLibrary::is_name("cotton_2ply") && !ModelLibrary::is_name("cotton.pwm") && !ModelLibrary::is_name("a/cotton"));
/// let error = ModelLibrary::none().load("polyster").unwrap_err();
/// assert!(error.to_string().starts_with("polyster: no such file and no model of this name; there are: none"));
/// ```
#[derive(Clone, Debug, Default)]
pub struct ModelLibrary {
    folders: Vec<PathBuf>,
    embedded: &'static [(&'static str, &'static [u8])],
}

/// Location of a named model.
enum Location {
    /// A file with this name in the spec's own source.
    Own(String),
    /// A file in a folder of the library.
    File(PathBuf),
    /// A compiled-in model.
    Embedded(&'static [u8]),
    Nowhere,
}

impl ModelLibrary {
    /// A library without models.
    pub fn none() -> ModelLibrary {
        ModelLibrary::default()
    }

    /// The folders of the variable `PLYWAVE_MODELS`, then `../share/plywave/models` relative to the folder of
    /// the program.
    pub fn usual() -> ModelLibrary {
        let variable = std::env::var_os(MODELS_VARIABLE).unwrap_or_default();
        let named = std::env::split_paths(&variable).filter(|folder| !folder.as_os_str().is_empty());
        let program = std::env::current_exe().ok();
        let shared = program.as_deref().and_then(Path::parent).map(|folder| folder.join(SHARED));
        ModelLibrary { folders: named.chain(shared).collect(), embedded: &[] }
    }

    /// The same library with a folder that is searched before the others.
    #[must_use]
    pub fn with_folder(mut self, folder: impl Into<PathBuf>) -> ModelLibrary {
        self.folders.insert(0, folder.into());
        self
    }

    /// The same library with compiled-in models, `(name, bytes of the file)`, which are searched last.
    #[must_use]
    pub fn with_embedded(self, embedded: &'static [(&'static str, &'static [u8])]) -> ModelLibrary {
        ModelLibrary { embedded, ..self }
    }

    /// Whether a text is the name of a model and not a path: it consists of letters, digits, `_` and `-`.
    pub fn is_name(text: &str) -> bool {
        !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || c == '_' || c == '-')
    }

    /// Names of all models, sorted.
    pub fn names(&self) -> Vec<String> {
        let mut names: BTreeSet<String> = self.embedded.iter().map(|(name, _)| (*name).to_string()).collect();
        for entry in self.folders.iter().flat_map(std::fs::read_dir).flatten().flatten() {
            let file = entry.file_name().to_string_lossy().into_owned();
            if let Some(name) = file.strip_suffix(ENDING).filter(|name| ModelLibrary::is_name(name)) {
                names.insert(name.to_string());
            }
        }
        names.into_iter().collect()
    }

    /// The stem of a file's name, if there is a model of that name; for hints in messages.
    fn stem(&self, file: &str) -> Option<String> {
        let stem = file.rsplit(['/', '\\']).next()?.strip_suffix(ENDING)?.to_string();
        self.names().contains(&stem).then_some(stem)
    }

    fn place(&self, name: &str, own: &dyn AssetSource) -> Location {
        if !ModelLibrary::is_name(name) || own.has(name) {
            return Location::Own(name.to_string());
        }
        let file = format!("{name}{ENDING}");
        if own.has(&file) {
            return Location::Own(file);
        }
        if let Some(path) = self.folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file()) {
            return Location::File(path);
        }
        self.embedded
            .iter()
            .find(|(known, _)| *known == name)
            .map_or(Location::Nowhere, |(_, bytes)| Location::Embedded(bytes))
    }

    /// The names of the available models, for messages.
    fn model_list(&self) -> String {
        let names = self.names();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }

    /// The model called `name`, as its name for messages and its bytes; `None` if it is not found.
    fn find(&self, name: &str, own: &dyn AssetSource) -> Result<Option<(String, Vec<u8>)>> {
        let max_bytes = FileKind::Model.most_bytes();
        Ok(Some(match self.place(name, own) {
            Location::Own(file) => (own.display(&file), own.read(&file, max_bytes)?),
            Location::File(path) => (path.display().to_string(), disk::read_file(&path, max_bytes)?),
            Location::Embedded(bytes) => (name.to_string(), bytes.to_vec()),
            Location::Nowhere => return Ok(None),
        }))
    }

    /// The name for messages and the bytes of a model, from its file, or by its name if there is no such
    /// file.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Format`] for a file that cannot be read; [`Error::Io`] if no model has the
    /// name.
    pub fn read(&self, path: impl AsRef<Path>) -> Result<(String, Vec<u8>)> {
        let path = path.as_ref();
        let here = super::Folder::new("").anywhere();
        match path.to_str() {
            Some(name) if ModelLibrary::is_name(name) => self.find(name, &here)?.ok_or_else(|| {
                let what = format!("no such file and no model of this name; there are: {}", self.model_list());
                Error::Io {
                    file: super::container::one_line(&name),
                    source: std::io::Error::new(std::io::ErrorKind::NotFound, what),
                }
            }),
            _ => Ok((path.display().to_string(), disk::read_file(path, FileKind::Model.most_bytes())?)),
        }
    }

    /// The name for messages and the bytes of the model that `key` of the spec `file` names: a file beside
    /// the spec, from `own`, or a model of the library. Errors contain the file, the key and the name.
    ///
    /// # Errors
    /// [`Error::Invalid`] if no model has the name; otherwise the errors of reading the file.
    pub fn named(&self, file: &str, key: &str, name: &str, own: &dyn AssetSource) -> Result<(String, Vec<u8>)> {
        let refused = |hint: String| Err(invalid(file, key, super::container::one_line(&name), &hint));
        let stem = self.stem(name);
        let by_name =
            stem.as_ref().map(|stem| format!("write {key} = \"{stem}\" for the model that goes by this name"));
        let error = match self.find(name, own) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => {
                return refused(format!(
                    "no model of this name; there are: {}; a file is named NAME.pwm",
                    self.model_list()
                ));
            }
            Err(error) => error,
        };
        match (error, by_name) {
            (Error::Io { source, .. }, Some(way)) if source.kind() == std::io::ErrorKind::NotFound => {
                refused(format!("no such file; {way}"))
            }
            (error, way) => {
                let usual = format!("put its folder into {MODELS_VARIABLE} and name it without folder and ending");
                Err(super::of_key(file, key, name, error, &way.unwrap_or(usual)))
            }
        }
    }
}
