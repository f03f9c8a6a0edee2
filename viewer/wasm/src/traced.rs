//! The simulated table to which a ply's model was fitted.

use crate::failed;
use plywave::Document;
use plywave_tables::table::Table;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// A table of paths traced through a ply's fibers (`plywave simulate`), for comparison with the model.
#[wasm_bindgen]
pub struct Traced {
    pub(crate) table: Table,
}

fn nearest(nodes: &[f64], value: f64) -> usize {
    let far = |k: &usize| (nodes[*k] - value).abs();
    (0..nodes.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

#[wasm_bindgen]
impl Traced {
    /// Loads a table from the bytes of its file (`.pwt`); `file` names it in errors.
    ///
    /// # Errors
    /// A foreign, damaged or newer file.
    #[wasm_bindgen(constructor)]
    pub fn new(bytes: &[u8], file: &str) -> Result<Traced, JsError> {
        Ok(Traced { table: Table::from_bytes(bytes, file).map_err(failed)? })
    }

    /// The incidence of the table nearest to a latitude [rad], an offset [um] and an absorption [1/um], as
    /// the same three numbers. Latitudes of tables are not negative.
    pub fn nearest(&self, theta_i: f64, h_um: f64, sigma_per_um: f64) -> Vec<f64> {
        let [m, n, k] = self.indices(theta_i, h_um, sigma_per_um);
        vec![self.table.theta_i[m], self.table.h_um[n], self.table.sigma_per_um[k]]
    }

    /// Latitude [rad] at the center of the row of bins that contains this latitude.
    #[wasm_bindgen(js_name = latitudeNear)]
    pub fn latitude_near(&self, theta_o: f64) -> f64 {
        self.table.grid.theta(self.row_of(theta_o))
    }

    /// Mean f [1/sr] of the bins at a latitude, by azimuth from x towards y, for the nearest incidence.
    pub fn slice(&self, theta_i: f64, h_um: f64, sigma_per_um: f64, theta_o: f64) -> Vec<f32> {
        let [m, n, k] = self.indices(theta_i, h_um, sigma_per_um);
        let columns = self.table.grid.phi_o;
        let row = self.row_of(theta_o) * columns;
        let (refl, high) = (self.table.refl_slice(m, n), self.table.high_slice(m, n, k));
        (row..row + columns).map(|bin| refl[bin] + high[bin]).collect()
    }

    fn indices(&self, theta_i: f64, h_um: f64, sigma_per_um: f64) -> [usize; 3] {
        let table = &self.table;
        let m = nearest(&table.theta_i, theta_i.abs());
        [m, nearest(&table.h_um, h_um), nearest(&table.sigma_per_um, sigma_per_um)]
    }

    fn row_of(&self, theta_o: f64) -> usize {
        let rows = self.table.grid.theta_o;
        ((theta_o / std::f64::consts::PI + 0.5) * rows as f64).clamp(0.0, rows as f64 - 1.0) as usize
    }
}
