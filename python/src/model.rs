//! Ply models.

use crate::batch::{Arrays, Asked, Floats, Rows, What, by_channels, flat};
use crate::errors::{Failure, Outcome};
use plywave::ply::{PlyData, Queries};
use plywave::{PlyBsdf, PlyModel, PlyQuery};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A ply model, loaded.
#[pyclass(frozen, module = "plywave._plywave", name = "Model")]
pub(crate) struct Model {
    pub(crate) model: Arc<PlyModel>,
}

/// The queries of a call, as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PlyArrays<'py> {
    n: usize,
    channels: usize,
    theta_i: Floats<'py>,
    h_um: Floats<'py>,
    sigma: Floats<'py>,
    lambda: Floats<'py>,
    w: Option<Floats<'py>>,
    edge: bool,
    threads: usize,
}

#[pymethods]
impl Model {
    /// Of a file's bytes; `name` stands for it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> Outcome<Model> {
        Ok(Model::of(py.detach(|| PlyModel::from_bytes(bytes, name))?))
    }

    /// Of a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Outcome<Model> {
        Ok(Model::of(py.detach(|| PlyModel::load(path))?))
    }

    /// The bytes of its file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &py.detach(|| self.data().to_bytes())?))
    }

    /// Writes its file, whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Outcome {
        Ok(py.detach(|| self.data().save(path))?)
    }

    #[getter]
    fn has_edge(&self) -> bool {
        self.model.has_edge()
    }

    #[getter]
    fn has_noise(&self) -> bool {
        self.data().noise.is_some()
    }

    #[getter]
    fn reference_error(&self, py: Python<'_>) -> f32 {
        py.detach(|| self.model.reference_error())
    }

    /// Answers `what` of the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: PlyArrays<'py>) -> Outcome<Arrays<'py>> {
        by_channels!(arrays.channels, N => self.answer::<N>(py, what, &arrays))
    }
}

impl Model {
    pub(crate) fn of(model: PlyModel) -> Model {
        Model { model: Arc::new(model) }
    }

    fn data(&self) -> &PlyData {
        self.model.data()
    }

    fn answer<'py, const N: usize>(&self, py: Python<'py>, what: &str, arrays: &PlyArrays<'py>) -> Outcome<Arrays<'py>> {
        let PlyArrays { n, threads, edge, .. } = *arrays;
        let theta_i: Rows<'_, 1> = Rows::of(&arrays.theta_i, n, "theta_i")?;
        let h_um: Rows<'_, 1> = Rows::of(&arrays.h_um, n, "h_um")?;
        let sigma: Rows<'_, N> = Rows::of(&arrays.sigma, n, "sigma_per_um")?;
        let lambda: Rows<'_, N> = Rows::of(&arrays.lambda, n, "lambda_um")?;
        let w: Option<Rows<'_, 3>> = arrays.w.as_ref().map(|w| Rows::of(w, n, "omega_o")).transpose()?;
        let model = &*self.model;
        if let (Kernel::Lobes, Some(w)) = (Kernel::of(what, edge, (theta_i, h_um, sigma)), w) {
            return Ok(vec![flat(py, py.detach(|| lobes(model, n, threads, (theta_i, h_um, sigma), w)))]);
        }
        let asked = Asked {
            n,
            threads,
            get: |i| (theta_i.get(i)[0], h_um.get(i)[0], sigma.get(i), lambda.get(i)),
            at: |&(theta_i, h_um, sigma, lambda): &(f32, f32, [f32; N], [f32; N]), cached: bool| {
                model.at(&PlyQuery { edge, cached, ..PlyQuery::new(theta_i, h_um, sigma, lambda) })
            },
        };
        match (what, w) {
            ("r_d", _) => Ok(vec![flat(py, py.detach(|| asked.map(|bsdf: &PlyBsdf<'_, N>, _| [bsdf.r_d()])))]),
            ("terms", Some(w)) => {
                let terms = py.detach(|| {
                    let of = |bsdf: &PlyBsdf<'_, N>, i: usize| bsdf.terms(w.get(i));
                    [
                        asked.map(|bsdf, i| [of(bsdf, i).refl; N]),
                        asked.map(|bsdf, i| of(bsdf, i).high),
                        asked.map(|bsdf, i| of(bsdf, i).edge),
                    ]
                });
                Ok(terms.into_iter().map(|rows| flat(py, rows)).collect())
            }
            _ => {
                let what = What::of(what).ok_or_else(|| Failure::input("model", "question", what, "there is no such"))?;
                asked.answer(py, what, w, |(theta_i, ..)| [0.0, -theta_i.cos(), -theta_i.sin()])
            }
        }
    }
}

/// Whether the kernel for many incidences answers.
#[derive(PartialEq, Eq)]
enum Kernel {
    Lobes,
    Other,
}

impl Kernel {
    /// It does where f alone is asked for, without edge light, at incidences of their own.
    fn of<const N: usize>(what: &str, edge: bool, at: (Rows<'_, 1>, Rows<'_, 1>, Rows<'_, N>)) -> Kernel {
        match at {
            (Rows::One(_), Rows::One(_), Rows::One(_)) => Kernel::Other,
            _ if what == "eval" && !edge => Kernel::Lobes,
            _ => Kernel::Other,
        }
    }
}

/// f_refl + f_high by the kernel for many incidences.
fn lobes<const N: usize>(
    model: &PlyModel,
    n: usize,
    threads: usize,
    (theta_i, h_um, sigma): (Rows<'_, 1>, Rows<'_, 1>, Rows<'_, N>),
    w: Rows<'_, 3>,
) -> Vec<[f32; N]> {
    use crate::batch::{CHUNK, parallel};
    let mut f = vec![[0.0; N]; n];
    let threads = threads.min(n.div_ceil(CHUNK)).max(1);
    parallel(f.chunks_mut(CHUNK).enumerate(), threads, |(chunk, f)| {
        let range = chunk * CHUNK..chunk * CHUNK + f.len();
        let (mut a, mut b, mut c, mut d) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let w = w.range(range.clone(), &mut d);
        let wo: [Vec<f32>; 3] = std::array::from_fn(|k| w.iter().map(|w| w[k]).collect());
        let queries = Queries {
            theta_i: theta_i.range(range.clone(), &mut a).as_flattened(),
            h_um: h_um.range(range.clone(), &mut b).as_flattened(),
            sigma_per_um: sigma.range(range, &mut c),
            wo: wo.each_ref().map(Vec::as_slice),
        };
        model.eval_batch(&queries, f);
    });
    f
}
