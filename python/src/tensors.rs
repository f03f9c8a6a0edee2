//! Interface for `plywave.mitsuba`: all tables of a cloth as arrays, and single terms computed by the
//! library, with which its tests compare.

use crate::kernel_calls::{Addresses, addresses, kept_for_ever};
use numpy::ndarray::{Array1, Array2, ArrayD, IxDyn};
use numpy::{IntoPyArray, PyReadonlyArray1, PyReadonlyArray2};
use plywave::Document;
use plywave::cloth::{ClothData, ClothModel, ClothOptions, GapLight, LineHits, Slits, Values};
use plywave::ply::PlyPlace;
use plywave::spec::YarnSpec;
use plywave::speckle::NoiseField;
use plywave::{Bsdf, ClothQuery, PlyQuery};
use plywave_fiber::FiberTable;
use plywave_pipeline::{ClothRecipe, Error, PrecomputedCloth, Run, model_library};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};
use std::sync::Arc;

fn raise(e: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(e.to_string())
}

fn row<const N: usize>(a: &numpy::ndarray::ArrayView2<'_, f32>, i: usize) -> [f32; N] {
    std::array::from_fn(|k| a[[i, k]])
}

fn columns(name: &str, a: &PyReadonlyArray2<'_, f32>, n: usize, count: usize) -> PyResult<()> {
    let shape = a.as_array().dim();
    if shape == (n, count) {
        return Ok(());
    }
    Err(raise(format!("{name}: {shape:?}: expected an array [{n}, {count}]")))
}

/// f `[n, 3]`, the sampling density `[n]` and the energy that passes straight through `[n]`.
type Light<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// A cloth loaded for `plywave.mitsuba`.
#[pyclass(frozen, module = "plywave._plywave")]
pub struct ClothTables {
    cloth: Arc<ClothModel>,
    /// What tells the cloth from others: its file's length and hash, and the options.
    key: String,
    speckle: bool,
    notes: Vec<String>,
}

#[pymethods]
impl ClothTables {
    /// Loads a cloth file, or the cloth of a spec (.toml) from the user's cache, precomputing and caching it
    /// if necessary.
    #[new]
    #[pyo3(signature = (filename, diffracted = true, layers = true, shadowing = true, edges = true, slits = true, uneven = true, relief = true, speckle = false, far = false))]
    #[allow(clippy::fn_params_excessive_bools)]
    fn new(
        py: Python<'_>,
        filename: String,
        diffracted: bool,
        layers: bool,
        shadowing: bool,
        edges: bool,
        slits: bool,
        uneven: bool,
        relief: bool,
        speckle: bool,
        far: bool,
    ) -> PyResult<Self> {
        let gaps = if diffracted { GapLight::Diffracted } else { GapLight::Straight };
        let slits = if slits { None } else { Some(Slits::NONE) };
        let options = ClothOptions {
            gaps,
            noise: speckle,
            layers,
            shadowing,
            edges,
            slits,
            uneven,
            relief,
            far,
            ..ClothOptions::SMOOTH
        };
        let load = || -> Result<ClothTables, Error> {
            let (data, notes) = if filename.ends_with(".toml") {
                let PrecomputedCloth { data, notes, .. } =
                    ClothRecipe::load(filename)?.precomputed(&model_library(), &Run::plain())?;
                (data, notes)
            } else {
                (ClothData::load(filename)?, Vec::new())
            };
            let bytes = data.to_bytes()?;
            let mut hasher = DefaultHasher::new();
            hasher.write(&bytes);
            let key = format!("{} {} {options:?}", bytes.len(), hasher.finish());
            let cloth = Arc::new(ClothModel::from_data(data, &options)?);
            Ok(ClothTables { cloth, key, speckle, notes })
        };
        py.detach(load).map_err(raise)
    }

    /// Address of the cloth, and of the functions that kernels call in packets of so many lanes and channels
    /// (`put`, `get`, `eval_pdf`, `sample`, `straight` of `kernel_calls.rs`); `None` for other numbers. The
    /// cloth stays loaded as long as the process runs.
    fn kernel_calls(&self, lanes: usize, channels: usize) -> Option<(usize, Addresses)> {
        let addresses = addresses(lanes, channels)?;
        Some((std::ptr::from_ref(kept_for_ever(&self.key, &self.cloth)) as usize, addresses))
    }

    /// Tables by name; `models` contains the files of the ply models, `noise` the noise of each model, or
    /// `None` without speckle.
    fn tensors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for tensor in self.cloth.tensors() {
            let shape = IxDyn(&tensor.shape);
            match tensor.values {
                Values::F32(v) => {
                    all.set_item(tensor.name, ArrayD::from_shape_vec(shape, v).map_err(raise)?.into_pyarray(py))?
                }
                Values::U32(v) => {
                    all.set_item(tensor.name, ArrayD::from_shape_vec(shape, v).map_err(raise)?.into_pyarray(py))?
                }
                Values::U8(v) => {
                    all.set_item(tensor.name, ArrayD::from_shape_vec(shape, v).map_err(raise)?.into_pyarray(py))?
                }
            }
        }
        let (files, noise) = (PyList::empty(py), PyList::empty(py));
        for model in self.cloth.models() {
            files.append(PyBytes::new(py, &model.data().to_bytes().map_err(raise)?))?;
            let field = if self.speckle { model.noise() } else { None };
            noise.append(field.map(|field| noise_tables(py, field)).transpose()?)?;
        }
        all.set_item("models", files)?;
        all.set_item("noise", noise)?;
        Ok(all)
    }

    /// Evaluates the library for `position_um` [n, 2], `wo` and `wi` [n, 3]: f [n, 3] and sampling density
    /// [n], at three wavelengths [um] or in linear sRGB, and the energy that passes straight through.
    #[pyo3(signature = (position_um, wo, wi, lambda_um = None, sigma_per_um = None, footprint_um = 0.0))]
    #[allow(clippy::too_many_arguments)]
    fn eval_pdf<'py>(
        &self,
        py: Python<'py>,
        position_um: PyReadonlyArray2<'py, f32>,
        wo: PyReadonlyArray2<'py, f32>,
        wi: PyReadonlyArray2<'py, f32>,
        lambda_um: Option<[f32; 3]>,
        sigma_per_um: Option<[[f32; 3]; 2]>,
        footprint_um: f32,
    ) -> PyResult<Light<'py>> {
        let n = wo.as_array().nrows();
        columns("position_um", &position_um, n, 2)?;
        columns("wo", &wo, n, 3)?;
        columns("wi", &wi, n, 3)?;
        let (position_um, wo, wi) = (position_um.as_array(), wo.as_array(), wi.as_array());
        let (mut f, mut pdf, mut straight) = (Array2::zeros((n, 3)), Array1::zeros(n), Array1::zeros(n));
        for i in 0..n {
            let (at, viewer) = (row(&position_um, i), row(&wo, i));
            let query = match lambda_um {
                Some(lambda) => ClothQuery::new(at, viewer, lambda),
                None => ClothQuery::rgb(at, viewer),
            };
            let query =
                ClothQuery { sigma_per_um: sigma_per_um.map_or([None; 2], |s| s.map(Some)), footprint_um, ..query };
            let at = self.cloth.at(&query);
            let (value, density) = at.eval_pdf(row(&wi, i));
            (0..3).for_each(|k| f[[i, k]] = value[k]);
            pdf[i] = density;
            straight[i] = at.straight()[0];
        }
        Ok((f.into_pyarray(py).into_any(), pdf.into_pyarray(py).into_any(), straight.into_pyarray(py).into_any()))
    }

    /// Notes on the cloth, one per line.
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// First hits of lines from `from_um` in directions `w`, `[n, 3]` each, as `[n, 10]`: 1 for a hit, curve,
    /// theta_i, h, distance to the ply's surface, parameter, tangent, ply number.
    fn hits<'py>(
        &self,
        py: Python<'py>,
        from_um: PyReadonlyArray2<'py, f32>,
        w: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let n = w.as_array().nrows();
        columns("from_um", &from_um, n, 3)?;
        columns("w", &w, n, 3)?;
        let (from_um, w) = (from_um.as_array(), w.as_array());
        let (mut found, mut numbers) = (LineHits::default(), Array2::<f32>::zeros((n, 10)));
        for i in 0..n {
            self.cloth.lines().hits(row(&from_um, i), row(&w, i), &mut found);
            if let Some(hit) = found.as_slice().first() {
                let [x, y, z] = hit.tangent;
                let of = [1.0, hit.curve as f32, hit.theta_i, hit.h_um, hit.enter_um, hit.parameter, x, y, z];
                of.into_iter()
                    .chain([found.as_slice().len() as f32])
                    .enumerate()
                    .for_each(|(k, v)| numbers[[i, k]] = v);
            }
        }
        Ok(numbers.into_pyarray(py).into_any())
    }
}

/// Bytes of a ply model's file, read and checked by the library.
#[pyfunction]
pub fn ply_file<'py>(py: Python<'py>, filename: &str) -> PyResult<Bound<'py, PyBytes>> {
    let model = model_library().load(filename).map_err(raise)?;
    Ok(PyBytes::new(py, &model.data().to_bytes().map_err(raise)?))
}

/// Bytes of a fiber's file, read and checked by the library.
#[pyfunction]
pub fn fiber_file<'py>(py: Python<'py>, filename: &str) -> PyResult<Bound<'py, PyBytes>> {
    let table = FiberTable::load(filename).map_err(raise)?;
    Ok(PyBytes::new(py, &table.to_bytes().map_err(raise)?))
}

/// Numbers of formulas that are typed once, in the Rust library (`plywave::host_constants`), by name.
#[pyfunction]
pub fn host_constants() -> BTreeMap<&'static str, Vec<f32>> {
    plywave::host_constants().into_iter().collect()
}

/// Radius R of a ply model [um], from the spec in its file.
#[pyfunction]
pub fn ply_radius_um(filename: &str) -> PyResult<f64> {
    let model = model_library().load(filename).map_err(raise)?;
    let [a, b] = YarnSpec::parse(&model.data().spec_text, filename).map_err(raise)?.ply_radii_um();
    Ok(a.max(b))
}

/// Numbers `[10]` of a model's noise, its tables `[4][512]` (`NoiseField::numbers`), and its seed.
fn noise_tables<'py>(py: Python<'py>, field: &NoiseField) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    let (seed, numbers, tables) = field.numbers();
    all.set_item("seed", seed)?;
    all.set_item("numbers", numbers.to_vec())?;
    let shape = IxDyn(&[tables.len(), tables[0].len()]);
    let tables = ArrayD::from_shape_vec(shape, tables.concat()).map_err(raise)?;
    all.set_item("tables", tables.into_pyarray(py))?;
    Ok(all)
}

/// Factors of f_refl and f_high `[n, 3]` by the library's noise of a model: of plies by number and place
/// `[n, 4]`, which is azimuth, way along the ply, footprint and the offset h. The noise's tables come first.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub fn speckle_factors<'py>(
    py: Python<'py>,
    filename: &str,
    ply: PyReadonlyArray1<'py, u32>,
    place: PyReadonlyArray2<'py, f32>,
    theta_i: PyReadonlyArray1<'py, f32>,
    lambda_um: PyReadonlyArray2<'py, f32>,
    wo: PyReadonlyArray2<'py, f32>,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let model = model_library().load(filename).map_err(raise)?;
    let field = model.require_noise(filename).map_err(raise)?;
    let n = theta_i.as_array().len();
    columns("place", &place, n, 4)?;
    columns("lambda_um", &lambda_um, n, 3)?;
    columns("wo", &wo, n, 3)?;
    let (ply, place, theta_i) = (ply.as_array(), place.as_array(), theta_i.as_array());
    if ply.len() != n {
        return Err(raise(format!("ply: {} numbers: expected {n}", ply.len())));
    }
    let (lambda, wo) = (lambda_um.as_array(), wo.as_array());
    let (mut refl, mut high) = (Array2::zeros((n, 3)), Array2::zeros((n, 3)));
    for i in 0..n {
        let [azimuth, along_um, footprint_um, h_um] = row(&place, i);
        let at = PlyPlace { ply: ply[i], azimuth, along_um, footprint_um };
        let (of_refl, of_high) = field.factors(&at, h_um, theta_i[i], row(&wo, i), row::<3>(&lambda, i));
        for k in 0..3 {
            (refl[[i, k]], high[[i, k]]) = (of_refl[k], of_high[k]);
        }
    }
    Ok((noise_tables(py, field)?, refl.into_pyarray(py).into_any(), high.into_pyarray(py).into_any()))
}

/// Terms of a ply by the library, for n queries: f_refl `[n]`, f_high and f_edge `[n, 3]`, the sampling
/// density `[n]`.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub fn ply_terms<'py>(
    py: Python<'py>,
    filename: &str,
    theta_i: PyReadonlyArray1<'py, f32>,
    h_um: PyReadonlyArray1<'py, f32>,
    sigma_per_um: PyReadonlyArray2<'py, f32>,
    lambda_um: PyReadonlyArray2<'py, f32>,
    wo: PyReadonlyArray2<'py, f32>,
    edge: bool,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let model = model_library().load(filename).map_err(raise)?;
    let (theta_i, h_um) = (theta_i.as_array(), h_um.as_array());
    let n = theta_i.len();
    columns("sigma_per_um", &sigma_per_um, n, 3)?;
    columns("lambda_um", &lambda_um, n, 3)?;
    columns("wo", &wo, n, 3)?;
    if h_um.len() != n {
        return Err(raise(format!("h_um: {} numbers: expected {n}", h_um.len())));
    }
    let (sigma, lambda, wo) = (sigma_per_um.as_array(), lambda_um.as_array(), wo.as_array());
    let (mut refl, mut pdf) = (Array1::zeros(n), Array1::zeros(n));
    let (mut high, mut of_edge) = (Array2::zeros((n, 3)), Array2::zeros((n, 3)));
    for i in 0..n {
        let query = PlyQuery { edge, ..PlyQuery::new(theta_i[i], h_um[i], row::<3>(&sigma, i), row(&lambda, i)) };
        let terms = model.at(&query).terms(row(&wo, i));
        (refl[i], pdf[i]) = (terms.refl, terms.pdf);
        for k in 0..3 {
            high[[i, k]] = terms.high[k];
            of_edge[[i, k]] = terms.edge[k];
        }
    }
    let [refl, pdf] = [refl, pdf].map(|a| a.into_pyarray(py).into_any());
    let [high, of_edge] = [high, of_edge].map(|a| a.into_pyarray(py).into_any());
    Ok((refl, high, of_edge, pdf))
}

/// Adds the functions and classes of this file to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<ClothTables>()?;
    module.add_function(wrap_pyfunction!(ply_file, module)?)?;
    module.add_function(wrap_pyfunction!(fiber_file, module)?)?;
    module.add_function(wrap_pyfunction!(host_constants, module)?)?;
    module.add_function(wrap_pyfunction!(ply_radius_um, module)?)?;
    module.add_function(wrap_pyfunction!(speckle_factors, module)?)?;
    module.add_function(wrap_pyfunction!(ply_terms, module)?)
}
