//! What ships: the library of ply models ([`plywave_models`]), and specs of cloths and yarns with the files
//! that they need.

use crate::cloth::ClothRecipe;
use crate::error::Error;
use plywave::io::ModelLibrary;
pub use plywave_models::MODELS as SHIPPED_MODELS;
use plywave_models::SPECS;
use std::path::Path;

/// [`ModelLibrary::usual`] with the shipped models.
pub fn model_library() -> ModelLibrary {
    ModelLibrary::usual().with_embedded(SHIPPED_MODELS)
}

/// What a spec that ships is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShippedKind {
    /// A cloth.
    Cloth,
    /// A yarn.
    Yarn,
    /// A yarn with ranges, for a family.
    Family,
}

/// Folder of the cloths among the files that ship.
const CLOTHS: &str = "cloths/";

/// A spec that ships, compiled in.
#[derive(Clone, Copy, Debug)]
pub struct ShippedSpec {
    /// What it is of.
    pub kind: ShippedKind,
    /// Its path below `fabrics/`.
    path: &'static str,
    text: &'static str,
}

impl ShippedSpec {
    fn new(path: &'static str, bytes: &'static [u8]) -> Option<ShippedSpec> {
        let text = std::str::from_utf8(bytes).ok()?;
        let kind = match path.strip_prefix(CLOTHS) {
            // Those of plies come with their cloths.
            Some(file) if file.contains('/') => return None,
            Some(_) => ShippedKind::Cloth,
            None if text.lines().any(|line| line == "[family]") => ShippedKind::Family,
            None => ShippedKind::Yarn,
        };
        Some(ShippedSpec { kind, path, text })
    }

    /// All specs that ship: yarns and families by name, then cloths.
    pub fn all() -> Vec<ShippedSpec> {
        SPECS.iter().filter_map(|(path, bytes)| ShippedSpec::new(path, bytes)).collect()
    }

    /// A cloth that names the model or yarn spec `path`.
    pub fn cloth_with(path: &str) -> Option<ShippedSpec> {
        let has = |spec: &ShippedSpec| spec.models().is_ok_and(|models| models.iter().any(|model| model == path));
        ShippedSpec::all().into_iter().filter(|spec| spec.kind == ShippedKind::Cloth).find(has)
    }

    /// Name of its file.
    pub fn file(&self) -> &'static str {
        self.path.strip_prefix(CLOTHS).unwrap_or(self.path)
    }

    /// Its name: that of its file without the ending.
    pub fn name(&self) -> &'static str {
        self.file().trim_end_matches(".toml")
    }

    /// What it is, in a sentence: the first of its comment, without what stands in parentheses.
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

    fn recipe(&self) -> Result<ClothRecipe, Error> {
        ClothRecipe::parse(self.file(), self.text, "")
    }

    /// The models and yarn specs that a cloth names.
    fn models(&self) -> Result<Vec<String>, Error> {
        Ok(self.recipe()?.spec.yarns().into_iter().filter_map(|yarn| yarn.model.clone()).collect())
    }

    /// The files that it needs and the spec itself, which is the last: paths relative to it, and contents.
    /// Models that go by name are among those that ship.
    ///
    /// # Errors
    /// None, as long as what ships is whole.
    pub fn files(&self) -> Result<Vec<(String, &'static [u8])>, Error> {
        let mut needed = Vec::new();
        if self.kind == ShippedKind::Cloth {
            for model in self.models()?.into_iter().filter(|model| !ModelLibrary::is_name(model)) {
                needed.extend(Path::new(&model).with_extension("pwm").to_str().map(|path| path.replace('\\', "/")));
                needed.push(model);
            }
            needed.extend(self.recipe()?.files().into_iter().map(str::to_string));
        }
        needed.sort();
        needed.dedup();
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

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::cloth::ClothSpec;
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

    #[test]
    fn every_spec_of_the_folder_ships() {
        let mut there = BTreeSet::new();
        for folder in ["", "cloths/", "cloths/plies/"] {
            for entry in std::fs::read_dir(format!("{FABRICS}/{folder}")).unwrap().map(Result::unwrap) {
                let name = entry.file_name().to_string_lossy().into_owned();
                let is_spec = name.ends_with(".toml") || name.ends_with(".pwm");
                if is_spec && entry.file_type().unwrap().is_file() && name != "Cargo.toml" {
                    there.insert(format!("{folder}{name}"));
                }
            }
        }
        assert_eq!(SPECS.iter().map(|(path, _)| (*path).to_string()).collect::<BTreeSet<_>>(), there);
        assert!(SPECS.iter().all(|(path, bytes)| std::fs::read(format!("{FABRICS}/{path}")).unwrap() == *bytes));
    }

    /// Each spec with the files that it names, in a folder of its own, is whole.
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
                    let recipe = ClothRecipe::load(&path).unwrap();
                    let library = ModelLibrary::none().with_embedded(SHIPPED_MODELS);
                    assert_eq!(recipe.models(&library).unwrap().len(), ClothSpec::yarns(&recipe.spec).len());
                    recipe.ply_specs(&library).unwrap();
                }
                ShippedKind::Yarn | ShippedKind::Family => {
                    assert_eq!(files.len(), 1);
                    let text = std::fs::read_to_string(path).unwrap();
                    let is_yarn = plywave::spec::YarnSpec::parse(&text, spec.file()).is_ok();
                    assert!(is_yarn || spec.kind == ShippedKind::Family, "{spec:?}");
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
        assert_eq!(ShippedSpec::cloth_with("plies/silk_single.toml").unwrap().name(), "organza");
    }
}
