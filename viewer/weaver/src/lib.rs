//! The making of cloths in a browser: a spec, the models of its plies and the files that it names go in, the
//! bytes of a cloth file come out.
//!
//! `plywave-web` shades what is made here. The two are apart because a page that shows models needs no
//! simulator.

use plywave::PlyModel;
use plywave::cloth::{ClothSpec, ClothWeave, Draft, WeaveSpec, Wif};
use plywave_sim::cloth::{ClothStep, Effort, make_cloth, make_ready};
use std::collections::BTreeMap;
use std::sync::Arc;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// Most characters of an error.
const LONGEST: usize = 300;

/// A cloth spec, and the contents of the files that it names.
#[wasm_bindgen]
pub struct Recipe {
    file: String,
    text: String,
    spec: ClothSpec,
    files: BTreeMap<String, Vec<u8>>,
}

/// A cloth that was made.
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
    /// Of a spec's text; `file` is for messages.
    ///
    /// # Errors
    /// A text that is no cloth spec, with the key that is wrong.
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

    /// Names of what it needs: of models, of a WIF, of curves. A yarn spec stands for the model beside it.
    pub fn needs(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.spec.yarns().into_iter().filter_map(|y| y.model.as_deref().map(model_name)).collect();
        if let Some(WeaveSpec::Wif { file }) = &self.spec.weave {
            names.push(file.clone());
        }
        names.extend(self.spec.curves.iter().map(|curves| curves.file.clone()));
        names.dedup();
        names
    }

    /// Gives the contents of a file by its name in [`Recipe::needs`].
    pub fn give(&mut self, name: &str, bytes: Vec<u8>) {
        self.files.insert(name.into(), bytes);
    }

    /// One repeat of its weave, a row of `X` (warp on top) and `.` for each pick, the last woven first; empty
    /// of what is not woven. A WIF must have been given.
    ///
    /// # Errors
    /// A WIF that gives no draft.
    pub fn rows(&self) -> Result<Vec<String>, JsError> {
        match self.spec.made() {
            Some(ClothWeave::Woven(WeaveSpec::Wif { file }, _)) => match self.files.get(file) {
                Some(bytes) => Ok(rows(&Wif::parse(bytes, file).map_err(failed)?.draft.reduced())),
                None => Ok(Vec::new()),
            },
            Some(ClothWeave::Woven(weave, _)) => Ok(weave.draft().map_or(Vec::new(), |draft| rows(&draft))),
            _ => Ok(Vec::new()),
        }
    }

    /// Makes the cloth; a draft of it takes less time, as [`Effort::Draft`] says.
    ///
    /// # Errors
    /// A file that is missing, and all that the program refuses.
    pub fn weave(&self, is_draft: bool) -> Result<Woven, JsError> {
        let model = |(kind, yarn): (usize, &plywave::cloth::YarnOfCloth)| {
            let Some(name) = &yarn.model else {
                return Err(JsError::new(&format!("{}: the yarn of kind {kind} has no model", self.file)));
            };
            let name = model_name(name);
            let bytes = self.file(&name).map_err(failed)?;
            PlyModel::from_bytes(bytes, &name).map(Arc::new).map_err(failed)
        };
        let models = self.spec.yarns().into_iter().enumerate().map(model).collect::<Result<Vec<_>, JsError>>()?;
        let effort = if is_draft { Effort::Draft } else { Effort::Full };
        let mut read = |name: &str| self.file(name).map(<[u8]>::to_vec);
        let made = make_cloth(&self.spec, &self.file, &mut read, effort, &|| true).map_err(failed)?;
        let on = |_: ClothStep| true;
        let data = make_ready(&self.text, &self.spec.name, &made.curves, &models, effort, &on);
        let mut data = data.map_err(failed)?;
        data.colors.clone_from(&made.colors);
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

/// File of a model: that beside a yarn spec, or of a model that ships.
fn model_name(name: &str) -> String {
    match name.strip_suffix(".toml") {
        Some(stem) => format!("{stem}.pwm"),
        None if name.ends_with(".pwm") => name.into(),
        None => format!("{name}.pwm"),
    }
}

#[wasm_bindgen]
impl Woven {
    /// The cloth file.
    #[wasm_bindgen(getter)]
    pub fn bytes(&self) -> Vec<u8> {
        self.bytes.clone()
    }

    /// What is to be said of its making.
    #[wasm_bindgen(getter)]
    pub fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
}
