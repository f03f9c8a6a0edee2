//! Fibers.

use crate::batch::{Asked, Floats, Out, Rows, Same, What, by_channels, rows_mut};
use crate::errors::{Failure, Outcome};
use plywave::fiber::TabulatedFiber;
use plywave::{FiberBsdf, FiberModel, FiberQuery};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A fiber model, loaded.
#[pyclass(frozen, module = "plywave._plywave", name = "Fiber")]
pub(crate) struct Fiber {
    pub(crate) fiber: Arc<FiberModel>,
}

/// The queries of a call, as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FiberArrays<'py> {
    n: usize,
    channels: usize,
    omega_i: Floats<'py>,
    lambda: Floats<'py>,
    w: Option<Floats<'py>>,
    threads: usize,
}

#[pymethods]
impl Fiber {
    /// Of a file's bytes; `name` stands for it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> Outcome<Fiber> {
        let fiber = py.detach(|| TabulatedFiber::from_bytes(bytes, name))?;
        Ok(Fiber { fiber: Arc::new(FiberModel::Tabulated(fiber)) })
    }

    /// Of a file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Outcome<Fiber> {
        Ok(Fiber { fiber: Arc::new(py.detach(|| FiberModel::load(path))?) })
    }

    /// The bytes of its file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &py.detach(|| self.tabulated()?.table().to_bytes().map_err(Failure::from))?))
    }

    /// Writes its file, whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Outcome {
        py.detach(|| self.tabulated()?.table().save(path).map_err(Failure::from))
    }

    /// Largest width from which it takes light [um].
    #[getter]
    fn max_width_um(&self) -> Outcome<f32> {
        Ok(self.tabulated()?.max_width_um())
    }

    /// The same with another longitudinal width [rad].
    fn with_beta_m(&self, beta_m_rad: f32) -> Outcome<Fiber> {
        let fiber = self.tabulated()?.clone().with_beta_m(beta_m_rad);
        Ok(Fiber { fiber: Arc::new(FiberModel::Tabulated(fiber)) })
    }

    /// Answers `what` of the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: FiberArrays<'py>, mut out: Out<'py>) -> Outcome {
        by_channels!(arrays.channels, N => self.answer::<N>(py, what, &arrays, &mut out))
    }
}

impl Fiber {
    fn tabulated(&self) -> Outcome<&TabulatedFiber> {
        match &*self.fiber {
            FiberModel::Tabulated(fiber) => Ok(fiber),
            _ => Err(Failure::Input("the fiber has no table".into())),
        }
    }

    fn answer<const N: usize>(
        &self,
        py: Python<'_>,
        what: &str,
        arrays: &FiberArrays<'_>,
        out: &mut Out<'_>,
    ) -> Outcome {
        let FiberArrays { n, threads, .. } = *arrays;
        let omega_i: Rows<'_, 3> = Rows::of(&arrays.omega_i, n, "omega_i")?;
        let lambda: Rows<'_, N> = Rows::of(&arrays.lambda, n, "lambda_um")?;
        let w: Option<Rows<'_, 3>> = arrays.w.as_ref().map(|w| Rows::of(w, n, "omega_o")).transpose()?;
        let fiber = &*self.fiber;
        let asked = Asked {
            n,
            threads,
            get: |i| (omega_i.get(i), lambda.get(i)),
            at: Same(|&(omega_i, lambda): &([f32; 3], [f32; N])| fiber.at(&FiberQuery::new(omega_i, lambda))),
        };
        match What::of(what) {
            Some(what) => asked.answer(py, what, w, out, |(omega_i, _)| omega_i.map(|v| -v)),
            None if what == "width_um" => {
                let [width] = out.floats()?;
                let width = rows_mut(width, n)?;
                py.detach(|| asked.map(width, |bsdf: &FiberBsdf<'_, N>, _| bsdf.width_um()))?;
                Ok(())
            }
            None => Err(Failure::input("fiber", "question", what, "there is no such")),
        }
    }
}
