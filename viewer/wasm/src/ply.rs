//! Ply models in a browser.

use crate::{Traced, failed, sphere};
use plywave::spec::YarnSpec;
use plywave::{Bsdf, PlyModel, PlyQuery};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// A ply model.
#[wasm_bindgen]
pub struct Ply {
    model: PlyModel,
    name: String,
    radius_um: f64,
    /// Directions of the last map, and its rows and columns.
    directions: (usize, usize, Vec<[f32; 3]>),
}

#[wasm_bindgen]
impl Ply {
    /// Loads a model from the bytes of its file (`.pwm`); `file` names it in errors.
    ///
    /// # Errors
    /// A foreign, damaged or newer file, and one whose offsets end inside the ply.
    #[wasm_bindgen(constructor)]
    pub fn new(bytes: &[u8], file: &str) -> Result<Ply, JsError> {
        let model = PlyModel::from_bytes(bytes, file).map_err(failed)?;
        let spec = YarnSpec::parse(&model.data().spec_text, "model").map_err(failed)?;
        // The largest offset is R + d_cut.
        let last_um = model.data().h_um.last().copied().unwrap_or(0.0);
        let radius_um = last_um - spec.beam.beam().d_cut_um;
        if radius_um <= 0.0 {
            let text = format!("{file}: largest h_um = {last_um}: it must exceed the beam's d_cut_um");
            return Err(JsError::new(&text));
        }
        Ok(Ply { model, name: spec.name, radius_um, directions: (0, 0, Vec::new()) })
    }

    /// Name of the model's yarn.
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Whether a table belongs to the same yarn spec.
    #[wasm_bindgen(js_name = isOf)]
    pub fn is_of(&self, traced: &Traced) -> bool {
        self.model.data().spec_text == traced.table.spec_text
    }

    /// Radius R of the ply [um].
    #[wasm_bindgen(getter, js_name = radiusUm)]
    pub fn radius_um(&self) -> f64 {
        self.radius_um
    }

    /// Largest offset at which a beam still hits the ply [um]; it exceeds R because beams have a width.
    #[wasm_bindgen(getter, js_name = hMaxUm)]
    pub fn h_max_um(&self) -> f64 {
        self.model.data().h_um.last().copied().unwrap_or(0.0)
    }

    /// Largest incident latitude of its tables [rad].
    #[wasm_bindgen(getter, js_name = thetaMax)]
    pub fn theta_max(&self) -> f64 {
        self.model.data().theta_i.last().copied().unwrap_or(0.0)
    }

    /// Whether light that passes beside the ply is diffracted.
    #[wasm_bindgen(getter, js_name = hasEdge)]
    pub fn has_edge(&self) -> bool {
        self.model.has_edge()
    }

    /// f [1/sr] in directions `w`, three numbers each, in the ply's frame, of a beam at latitude
    /// `theta_i` [rad] and offset `h_um`, with absorption `sigma_per_um` at the wavelength `lambda_um`.
    pub fn eval(&self, theta_i: f32, h_um: f32, sigma_per_um: f32, lambda_um: f32, edge: bool, w: &[f32]) -> Vec<f32> {
        let at = self.model.at(&PlyQuery { edge, ..PlyQuery::new(theta_i, h_um, [sigma_per_um], [lambda_um]) });
        w.as_chunks().0.iter().map(|w| at.eval(*w)[0]).collect()
    }

    /// [`Ply::eval`] over the sphere: `rows` of equal angle to the axis, from its positive end, with
    /// `columns` azimuths each from x towards y.
    pub fn map(
        &mut self,
        theta_i: f32,
        h_um: f32,
        sigma_per_um: f32,
        lambda_um: f32,
        edge: bool,
        rows: usize,
        columns: usize,
    ) -> Vec<f32> {
        if (self.directions.0, self.directions.1) != (rows, columns) {
            self.directions = (rows, columns, sphere(rows, columns));
        }
        let at = self.model.at(&PlyQuery { edge, ..PlyQuery::new(theta_i, h_um, [sigma_per_um], [lambda_um]) });
        let w = &self.directions.2;
        let (mut f, mut pdf) = (vec![[0.0]; w.len()], vec![0.0; w.len()]);
        at.eval_batch(w, &mut f, &mut pdf);
        f.into_iter().flatten().collect()
    }

    /// Fractions of a beam's light: single reflection (f_refl), other scattering (f_high), and light that
    /// misses all fibers (r_d).
    pub fn energies(&self, theta_i: f32, h_um: f32, sigma_per_um: f32) -> Vec<f32> {
        let at = |sigma: f32| self.model.at(&PlyQuery::lobes(theta_i, h_um, [sigma]));
        let passed = at(sigma_per_um).r_d();
        // Fibers that absorb all light inside them only reflect.
        let reflected = at(1e6).albedo()[0];
        vec![reflected, at(sigma_per_um).albedo()[0] - reflected, passed]
    }
}
