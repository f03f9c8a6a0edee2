//! Cloth models in a browser.

use crate::{failed, sphere};
use plywave::Document;
use plywave::cloth::{ClothData, ClothOptions, ColorOf, YarnColor};
use plywave::{Bsdf, ClothModel, ClothQuery};
use plywave_textile::ClothSpec;
use std::rc::Rc;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// A footprint that selects the mean over the cell [um].
const FAR_UM: f32 = 1e6;

/// A cloth.
#[wasm_bindgen]
pub struct Cloth {
    pub(crate) model: Rc<ClothModel>,
    name: String,
    notes: Vec<String>,
}

#[wasm_bindgen]
impl Cloth {
    /// Loads a cloth from the bytes of its file (`.pwc`), with speckle and the mean over the cell; `file`
    /// names it in errors.
    ///
    /// # Errors
    /// A foreign, damaged or newer file.
    #[wasm_bindgen(constructor)]
    pub fn new(bytes: &[u8], file: &str) -> Result<Cloth, JsError> {
        let options = ClothOptions { noise: true, far: true, ..ClothOptions::SMOOTH };
        let data = ClothData::from_bytes(bytes, file).map_err(failed)?;
        let (name, notes) = (data.name.clone(), data.notes(&options));
        let model = Rc::new(ClothModel::from_data(data, &options).map_err(failed)?);
        Ok(Cloth { model, name, notes })
    }

    /// Name of the cloth.
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Missing effects, one sentence each.
    #[wasm_bindgen(getter)]
    pub fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Number of kinds of yarns: 2, warp and weft, for a woven cloth, else 1.
    #[wasm_bindgen(getter)]
    pub fn kinds(&self) -> usize {
        self.model.kinds()
    }

    /// Two vectors after which the cloth repeats [um]: x and y of each.
    #[wasm_bindgen(getter, js_name = cellUm)]
    pub fn cell_um(&self) -> Vec<f64> {
        self.model.cell_um().concat()
    }

    /// The distinct colors of its yarns in sRGB, 0 to 1, three numbers each; yarns with an absorption in
    /// place of a color are omitted.
    pub fn colors(&self) -> Vec<f32> {
        self.model.colors().iter().flat_map(|reach| reach.asked).collect()
    }

    /// The cloth with other colors of its kinds of yarns, sRGB, 0 to 1.
    ///
    /// # Errors
    /// A color that is not three numbers from 0 to 1.
    #[wasm_bindgen(js_name = withColors)]
    pub fn with_colors(&self, warp: &[f32], weft: &[f32]) -> Result<Cloth, JsError> {
        let color = |srgb: &[f32]| match <[f32; 3]>::try_from(srgb) {
            Ok(srgb) if srgb.iter().all(|v| (0.0..=1.0).contains(v)) => Ok(YarnColor::Srgb(srgb)),
            _ => Err(JsError::new("a color is three numbers from 0 to 1")),
        };
        let model = Rc::new(self.model.with_colors([color(warp)?, color(weft)?], ColorOf::EvenSky));
        Ok(Cloth { model, name: self.name.clone(), notes: self.notes.clone() })
    }

    /// The cloth with one absorption of all its yarns [1/um].
    #[wasm_bindgen(js_name = withSigma)]
    pub fn with_sigma(&self, sigma_per_um: f32) -> Cloth {
        let sigma = YarnColor::Sigma(sigma_per_um);
        let model = Rc::new(self.model.with_colors([sigma; 2], ColorOf::EvenSky));
        Cloth { model, name: self.name.clone(), notes: self.notes.clone() }
    }

    /// f [1/sr], the cosine of `wi` included, at a point [um], at the wavelength `lambda_um`, with a
    /// footprint [um], seen from `wo`, for light from directions `wi`, three numbers each.
    ///
    /// # Errors
    /// A point that is not two numbers, a `wo` that is not three.
    pub fn eval(
        &self,
        point_um: &[f32],
        footprint_um: f32,
        wo: &[f32],
        lambda_um: f32,
        wi: &[f32],
    ) -> Result<Vec<f32>, JsError> {
        let (Ok(point), Ok(wo)) = (<[f32; 2]>::try_from(point_um), <[f32; 3]>::try_from(wo)) else {
            return Err(JsError::new("a point is two numbers, a direction is three"));
        };
        let at = self.model.at(&ClothQuery { footprint_um, ..ClothQuery::new(point, wo, [lambda_um]) });
        Ok(wi.as_chunks().0.iter().map(|wi| at.eval(*wi)[0]).collect())
    }

    /// f of the mean over the cell [1/sr], seen from `theta` off the face's normal towards the azimuth `phi`
    /// [rad], over the sphere of directions to the light: `rows` of equal angle to the normal, from it on, of
    /// `columns` azimuths each.
    pub fn map(&self, theta: f32, phi: f32, lambda_um: f32, rows: usize, columns: usize) -> Vec<f32> {
        let wo = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        let at = self.model.at(&ClothQuery { footprint_um: FAR_UM, ..ClothQuery::new([0.0; 2], wo, [lambda_um]) });
        sphere(rows, columns).into_iter().map(|wi| at.eval(wi)[0]).collect()
    }
}

/// Text of the spec in a cloth file.
///
/// # Errors
/// A foreign, damaged or newer file.
#[wasm_bindgen(js_name = specText)]
pub fn spec_text(bytes: &[u8], file: &str) -> Result<String, JsError> {
    let data = ClothData::from_bytes(bytes, file).map_err(failed)?;
    ClothSpec::parse(&data.spec_text, file).map_err(failed)?;
    Ok(data.spec_text)
}
