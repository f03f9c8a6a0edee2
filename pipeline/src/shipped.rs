//! Shipped data: the library of ply models ([`plywave_models`]), and specs of cloths and yarns with the files
//! that they need.

use crate::error::Error;
use plywave::io::ModelLibrary;
pub use plywave_models::MODELS as SHIPPED_MODELS;
use plywave_models::SPECS;
use plywave_textile::{ClothSpec, KnitKind, WeaveSpec};

/// [`ModelLibrary::usual`], extended by the shipped models.
pub fn model_library() -> ModelLibrary {
    ModelLibrary::usual().with_embedded(SHIPPED_MODELS)
}

/// Kind of a shipped spec.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShippedKind {
    /// A cloth spec.
    Cloth,
    /// A yarn spec.
    Yarn,
    /// A yarn spec with ranges, for a family.
    Family,
}

/// Folder of the cloth specs within the shipped files.
const CLOTHS: &str = "cloths/";

/// A shipped spec, compiled in.
#[derive(Clone, Copy, Debug)]
pub struct ShippedSpec {
    /// Kind of the spec.
    pub kind: ShippedKind,
    /// Path of the spec below `fabrics/`.
    path: &'static str,
    text: &'static str,
}

impl ShippedSpec {
    fn new(path: &'static str, bytes: &'static [u8]) -> Option<ShippedSpec> {
        let text = std::str::from_utf8(bytes).ok()?;
        let kind = match path.strip_prefix(CLOTHS) {
            Some(_) => ShippedKind::Cloth,
            None if text.lines().any(|line| line == "[family]") => ShippedKind::Family,
            None => ShippedKind::Yarn,
        };
        Some(ShippedSpec { kind, path, text })
    }

    /// All shipped specs: yarns and families by name, then cloths.
    pub fn all() -> Vec<ShippedSpec> {
        SPECS.iter().filter_map(|(path, bytes)| ShippedSpec::new(path, bytes)).collect()
    }

    /// File name of the spec.
    pub fn file(&self) -> &'static str {
        self.path.strip_prefix(CLOTHS).unwrap_or(self.path)
    }

    /// Name of the spec: its file name without the ending.
    pub fn name(&self) -> &'static str {
        self.file().trim_end_matches(".toml")
    }

    /// Description in one sentence: the first of the spec's comment, without parentheses.
    pub fn about(&self) -> String {
        let comment = self.text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim);
        let mut depth = 0;
        let mut text = String::new();
        for c in comment.collect::<Vec<_>>().join(" ").chars() {
            depth += i32::from(c == '(');
            if depth == 0 {
                text.push(c);
            }
            depth -= i32::from(c == ')');
        }
        let sentence = text.split_once(". ").map_or(&*text, |(first, _)| first).trim_end_matches('.');
        sentence.split_whitespace().collect::<Vec<_>>().join(" ").replace(" :", ":")
    }

    fn cloth(&self) -> Result<ClothSpec, Error> {
        Ok(ClothSpec::parse(self.text, self.file())?)
    }

    /// The files that the spec needs, and last the spec itself: paths relative to the spec, and contents. The
    /// models of its plies are among the shipped models.
    ///
    /// # Errors
    /// An error means that the shipped data is incomplete.
    pub fn files(&self) -> Result<Vec<(String, &'static [u8])>, Error> {
        let mut needed: Vec<String> = match self.kind {
            ShippedKind::Cloth => files_of(&self.cloth()?).into_iter().map(str::to_string).collect(),
            ShippedKind::Yarn | ShippedKind::Family => Vec::new(),
        };
        needed.push(self.file().into());
        needed.into_iter().map(|path| self.needed(path)).collect()
    }

    fn needed(&self, path: String) -> Result<(String, &'static [u8]), Error> {
        let folder = &self.path[..self.path.len() - self.file().len()];
        match SPECS.iter().find(|(other, _)| other.strip_prefix(folder) == Some(&path)) {
            Some((_, bytes)) => Ok((path, bytes)),
            None => Err(Error::Runtime(plywave::Error::Invalid {
                file: self.path.into(),
                key: "file".into(),
                value: path,
                hint: "is not among the files that ship".into(),
            })),
        }
    }
}

/// Files other than models that a cloth spec names: a WIF, a picture, or curves.
pub(crate) fn files_of(spec: &ClothSpec) -> Vec<&str> {
    let wif = spec.weave.iter().filter_map(|weave| match weave {
        WeaveSpec::Wif { file } => Some(file.as_str()),
        WeaveSpec::Picture(picture) => Some(picture.picture.as_str()),
        _ => None,
    });
    let chart = spec.knit.iter().filter_map(|knit| match &knit.kind {
        KnitKind::Picture(picture) => Some(picture.picture.as_str()),
        _ => None,
    });
    wif.chain(chart).chain(spec.curves.iter().map(|curves| curves.file.as_str())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");

    #[test]
    fn every_model_of_the_folder_ships() {
        let folder = format!("{FABRICS}/models");
        let there = ModelLibrary::none().with_folder(&folder).names();
        let shipped = ModelLibrary::none().with_embedded(SHIPPED_MODELS);
        assert_eq!(shipped.names(), there);
        for name in there {
            let (shown, bytes) = shipped.read(&name).unwrap();
            assert_eq!((shown, bytes), (name.clone(), std::fs::read(format!("{folder}/{name}.pwm")).unwrap()));
        }
    }

    /// The index of plies has the spec of each model.
    #[test]
    fn the_index_has_the_plies_of_the_models() {
        let index: std::collections::BTreeMap<String, String> = serde_json::from_str(plywave_models::PLIES).unwrap();
        assert!(index.keys().eq(SHIPPED_MODELS.iter().map(|(name, _)| *name)), "run scripts/model_index.py");
        for (name, bytes) in SHIPPED_MODELS {
            let model = plywave::PlyModel::from_bytes(bytes, name).unwrap();
            let [of_index, of_model] = [&index[*name], &model.data().spec_text]
                .map(|text| plywave::spec::YarnSpec::parse(text, name).unwrap());
            assert_eq!(of_index, of_model, "{name}: run scripts/model_index.py");
        }
    }

    #[test]
    fn every_spec_of_the_folder_ships() {
        let mut there = BTreeSet::new();
        for folder in ["", "cloths/"] {
            for entry in std::fs::read_dir(format!("{FABRICS}/{folder}")).unwrap().map(Result::unwrap) {
                let name = entry.file_name().to_string_lossy().into_owned();
                let is_needed = [".toml", ".wif", ".png"].iter().any(|ending| name.ends_with(ending));
                if is_needed && entry.file_type().unwrap().is_file() && name != "Cargo.toml" {
                    there.insert(format!("{folder}{name}"));
                }
            }
        }
        assert_eq!(SPECS.iter().map(|(path, _)| (*path).to_string()).collect::<BTreeSet<_>>(), there);
        assert!(SPECS.iter().all(|(path, bytes)| std::fs::read(format!("{FABRICS}/{path}")).unwrap() == *bytes));
    }

    /// Each spec loads from a folder that contains only the files that it names.
    #[test]
    fn a_spec_comes_with_what_it_needs() {
        for spec in ShippedSpec::all() {
            let folder = tempfile::tempdir().unwrap();
            let files = spec.files().unwrap();
            assert_eq!(files.last().unwrap(), &(spec.file().to_string(), spec.text.as_bytes()), "{spec:?}");
            for (path, bytes) in &files {
                let path = folder.path().join(path);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, bytes).unwrap();
            }
            let path = folder.path().join(spec.file());
            match spec.kind {
                ShippedKind::Cloth => {
                    // Nothing is built: each ply has a model that ships.
                    let recipe = crate::ClothRecipe::load(&path).unwrap();
                    let library = ModelLibrary::none().with_embedded(SHIPPED_MODELS);
                    let plies = recipe.plies(&library).unwrap().build(&crate::Run::plain()).unwrap();
                    assert_eq!(plies.models.len(), ClothSpec::yarns(&recipe.spec).len());
                    for note in &plies.notes {
                        assert!(note.ends_with("of the library"), "{}: {note}", spec.file());
                    }
                }
                ShippedKind::Yarn | ShippedKind::Family => {
                    assert_eq!(files.len(), 1);
                    let text = std::fs::read_to_string(path).unwrap();
                    let none = plywave::io::MemoryAssets::default();
                    let yarn = plywave_textile::load_yarn(&text, spec.file(), &none);
                    assert!(yarn.is_ok() || spec.kind == ShippedKind::Family, "{spec:?}: {yarn:?}");
                }
            }
        }
    }

    #[test]
    fn specs_say_what_they_are_of() {
        let about = |name: &str| ShippedSpec::all().into_iter().find(|s| s.name() == name).unwrap().about();
        assert_eq!(about("denim"), "Denim: 3/1 twill of single cotton yarns, the warp dyed in the rope");
        assert_eq!(about("cotton"), "A ply of cotton fibers: kidney-shaped with a hollow core");
        assert_eq!(about("polyester"), "A ply of round polyester filaments");
    }
}
