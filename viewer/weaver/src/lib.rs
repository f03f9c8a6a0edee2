//! Precomputation of cloths in a browser: from a spec, the models of its plies and the files that it names to
//! the bytes of a cloth file.
//!
//! `plywave-web` shades the result. The two are separate because a page that shows models needs no simulator.

use plywave::Document;
use plywave::PlyModel;
use plywave::spec::YarnSpec;
use plywave_sim::cloth::{ClothStep, Effort, make_cloth, precompute};
use plywave_textile::{ClothSpec, ClothWeave, Draft, KnitKind, WeaveSpec, Wif, YarnOfCloth, alike};
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// Specs of the plies of the models that ship, by name.
static PLIES: LazyLock<BTreeMap<String, String>> =
    LazyLock::new(|| serde_json::from_str(plywave_models::PLIES).unwrap_or_default());

/// Largest number of characters of an error.
const LONGEST: usize = 300;

/// A cloth spec, and the contents of the files that it names.
#[wasm_bindgen]
pub struct Recipe {
    file: String,
    text: String,
    spec: ClothSpec,
    files: BTreeMap<String, Vec<u8>>,
}

/// A precomputed cloth.
#[wasm_bindgen]
pub struct Woven {
    bytes: Vec<u8>,
    notes: Vec<String>,
}

fn failed(error: impl std::fmt::Display) -> JsError {
    JsError::new(&plywave::one_line(&error.to_string(), LONGEST))
}

fn rows(draft: &Draft) -> Vec<String> {
    let row = |pick| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
    (0..draft.picks()).rev().map(row).collect()
}

#[wasm_bindgen]
impl Recipe {
    /// Parses the text of a spec; `file` identifies it in messages.
    ///
    /// # Errors
    /// An invalid spec, with the offending key.
    #[wasm_bindgen(constructor)]
    pub fn new(text: String, file: &str) -> Result<Recipe, JsError> {
        let spec = ClothSpec::parse(&text, file).map_err(failed)?;
        Ok(Recipe { file: file.into(), text, spec, files: BTreeMap::new() })
    }

    /// Name of the cloth.
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.spec.name.clone()
    }

    /// Names of the files that the spec needs: models, a WIF, a picture, curves. A yarn that names no model
    /// gets the one that ships for its ply.
    ///
    /// # Errors
    /// A yarn for whose ply no model ships.
    pub fn needs(&self) -> Result<Vec<String>, JsError> {
        let mut names = self.models()?;
        match &self.spec.weave {
            Some(WeaveSpec::Wif { file }) => names.push(file.clone()),
            Some(WeaveSpec::Picture(picture)) => names.push(picture.picture.clone()),
            _ => {}
        }
        if let Some(KnitKind::Picture(picture)) = self.spec.knit.as_ref().map(|knit| &knit.kind) {
            names.push(picture.picture.clone());
        }
        names.extend(self.spec.curves.iter().map(|curves| curves.file.clone()));
        names.dedup();
        Ok(names)
    }

    /// Names of the models, by kind of yarn.
    fn models(&self) -> Result<Vec<String>, JsError> {
        let one = |(kind, yarn): (usize, &YarnOfCloth)| match &yarn.model {
            Some(name) if name.ends_with(".pwm") => Ok(name.clone()),
            Some(name) => Ok(format!("{name}.pwm")),
            None => {
                let ply = yarn.ply(&self.file, self.spec.kind_name(kind)).map_err(failed)?;
                let same = |text: &String| YarnSpec::parse(text, "model").is_ok_and(|model| alike(&ply, &model));
                let found = PLIES.iter().find(|(_, text)| same(text));
                found.map(|(name, _)| format!("{name}.pwm")).ok_or_else(|| {
                    let kind = self.spec.kind_name(kind);
                    let what =
                        format!("{}: {kind}: no model ships for {}; `plywave build` makes one", self.file, ply.name);
                    failed(what)
                })
            }
        };
        self.spec.yarns().into_iter().enumerate().map(one).collect()
    }

    /// Provides the contents of a file by its name in [`Recipe::needs`].
    pub fn give(&mut self, name: &str, bytes: Vec<u8>) {
        self.files.insert(name.into(), bytes);
    }

    /// One repeat of the weave, a row of `X` (warp on top) and `.` for each pick, the last pick first; empty
    /// for cloths that are not woven. A WIF must have been provided.
    ///
    /// # Errors
    /// A WIF without a draft.
    pub fn rows(&self) -> Result<Vec<String>, JsError> {
        match self.spec.made() {
            Some(ClothWeave::Woven(WeaveSpec::Wif { file }, _)) => match self.files.get(file) {
                Some(bytes) => Ok(rows(&Wif::parse(bytes, file).map_err(failed)?.draft.reduced())),
                None => Ok(Vec::new()),
            },
            Some(ClothWeave::Woven(WeaveSpec::Picture(picture), _)) => match self.files.get(&picture.picture) {
                Some(bytes) => Ok(rows(&picture.draft(&self.file, bytes).map_err(failed)?.draft)),
                None => Ok(Vec::new()),
            },
            Some(ClothWeave::Woven(weave, _)) => Ok(weave.draft().map_or(Vec::new(), |draft| rows(&draft))),
            _ => Ok(Vec::new()),
        }
    }

    /// Precomputes the cloth; a draft takes less time ([`Effort::Draft`]).
    ///
    /// # Errors
    /// A missing file, and all errors of the precomputation.
    pub fn weave(&self, is_draft: bool) -> Result<Woven, JsError> {
        let models = self.models()?.into_iter().map(|name| {
            let bytes = self.file(&name).map_err(failed)?;
            PlyModel::from_bytes(bytes, &name).map(Arc::new).map_err(failed)
        });
        let models = models.collect::<Result<Vec<_>, JsError>>()?;
        let effort = if is_draft { Effort::Draft } else { Effort::Full };
        let mut read = |name: &str| self.file(name).map(<[u8]>::to_vec);
        let made = make_cloth(&self.spec, &self.file, &mut read, effort, &|_| true).map_err(failed)?;
        let on = |_: ClothStep| true;
        let data = precompute(&self.spec, &self.text, &made.curves, &models, effort, &on);
        let mut data = data.map_err(failed)?;
        data.looks = made.looks;
        Ok(Woven { bytes: data.to_bytes().map_err(failed)?, notes: made.notes })
    }

    fn file(&self, name: &str) -> Result<&[u8], plywave::Error> {
        let missing = || plywave::Error::Invalid {
            file: self.file.clone(),
            key: "file".into(),
            value: name.into(),
            hint: "give this file too".into(),
        };
        self.files.get(name).map(Vec::as_slice).ok_or_else(missing)
    }
}

#[wasm_bindgen]
impl Woven {
    /// Bytes of the cloth file.
    #[wasm_bindgen(getter)]
    pub fn bytes(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    /// Notes on the precomputation.
    #[wasm_bindgen(getter)]
    pub fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}
