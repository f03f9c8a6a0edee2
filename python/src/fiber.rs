//! Fibers: loading, and batches of queries.

use crate::batch::{Floats, Out, PreparedQueries, Rows, Same, What, by_channels, rows_mut};
use crate::errors::{Failure, Outcome};
use plywave::Document;
use plywave_fiber::{FiberBsdf, FiberModel, FiberQuery};
use plywave_fiber::{FilamentSpec, TabulatedFiber};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A loaded fiber model.
#[pyclass(frozen, module = "plywave._plywave", name = "Fiber")]
pub(crate) struct Fiber {
    pub(crate) fiber: Arc<FiberModel>,
    /// Wavelengths [um] and absorptions [1/um] from the spec of an analytic fiber.
    color: Option<([f32; 3], [f32; 3])>,
}

impl From<FilamentSpec> for Fiber {
    fn from(spec: FilamentSpec) -> Fiber {
        Fiber { fiber: Arc::new(spec.model), color: Some((spec.lambda_um, spec.sigma_per_um)) }
    }
}

impl From<TabulatedFiber> for Fiber {
    fn from(fiber: TabulatedFiber) -> Fiber {
        Fiber { fiber: Arc::new(FiberModel::Tabulated(fiber)), color: None }
    }
}

/// The queries of a call as flat arrays.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FiberArrays<'py> {
    n: usize,
    channels: usize,
    omega_i: Floats<'py>,
    lambda: Floats<'py>,
    sigma: Floats<'py>,
    h_rel: Option<Floats<'py>>,
    w: Option<Floats<'py>>,
    threads: usize,
}

#[pymethods]
impl Fiber {
    /// Loads the bytes of a file; `name` identifies it in messages and ends in `.toml` for a spec.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> Outcome<Fiber> {
        match FilamentSpec::from_bytes(bytes, name)? {
            Some(spec) => Ok(spec.into()),
            None => Ok(py.detach(|| TabulatedFiber::from_bytes(bytes, name))?.into()),
        }
    }

    /// Loads a table (.pwf) or the spec of an analytic fiber (.toml).
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Outcome<Fiber> {
        if path.extension().is_some_and(|e| e == "toml") {
            return Ok(FilamentSpec::load(path)?.into());
        }
        Ok(py.detach(|| TabulatedFiber::load(path))?.into())
    }

    /// Wavelengths [um] and absorptions [1/um] from the spec of an analytic fiber; `None` for a table.
    #[getter]
    fn color(&self) -> Option<([f32; 3], [f32; 3])> {
        self.color
    }

    /// The bytes of the fiber's file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &py.detach(|| self.tabulated()?.table().to_bytes().map_err(Failure::from))?))
    }

    /// Writes the fiber's file atomically.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Outcome {
        py.detach(|| self.tabulated()?.table().save(path).map_err(Failure::from))
    }

    /// Largest width over which the fiber intercepts light [um].
    #[getter]
    fn max_width_um(&self) -> f32 {
        self.fiber.max_width_um()
    }

    /// The same fiber with another longitudinal width [rad].
    fn with_beta_m(&self, beta_m_rad: f32) -> Outcome<Fiber> {
        Ok(self.tabulated()?.clone().with_beta_m(beta_m_rad).into())
    }

    /// Computes the quantity `what` for the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: FiberArrays<'py>, mut out: Out<'py>) -> Outcome {
        by_channels!(arrays.channels, N => self.answer::<N>(py, what, &arrays, &mut out))
    }
}

impl Fiber {
    fn tabulated(&self) -> Outcome<&TabulatedFiber> {
        match &*self.fiber {
            FiberModel::Tabulated(fiber) => Ok(fiber),
            _ => Err(Failure::Input("an analytic fiber has no table: change its spec".into())),
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
        let omega_i: Rows<'_, 3> = Rows::new(&arrays.omega_i, n, "omega_i")?;
        let lambda: Rows<'_, N> = Rows::new(&arrays.lambda, n, "lambda_um")?;
        let sigma: Rows<'_, N> = Rows::new(&arrays.sigma, n, "sigma_per_um")?;
        let h_rel: Option<Rows<'_, 1>> = arrays.h_rel.as_ref().map(|h| Rows::new(h, n, "h_rel")).transpose()?;
        let w: Option<Rows<'_, 3>> = arrays.w.as_ref().map(|w| Rows::new(w, n, "omega_o")).transpose()?;
        let fiber = &*self.fiber;
        let prepared = PreparedQueries {
            n,
            threads,
            get: |i| FiberQuery {
                omega_i: omega_i.get(i),
                h_rel: h_rel.map(|h| h.get(i)[0]),
                lambda_um: lambda.get(i),
                sigma_per_um: sigma.get(i),
            },
            at: Same(|query: &FiberQuery<N>| fiber.at(query)),
        };
        match What::from_name(what) {
            Some(what) => prepared.answer(py, what, w, out, |query| query.omega_i.map(|v| -v)),
            None if what == "width_um" => {
                let [width] = out.floats()?;
                let width = rows_mut(width, n)?;
                py.detach(|| prepared.map(width, |bsdf: &FiberBsdf<'_, N>, _| bsdf.width_um()))?;
                Ok(())
            }
            None => Err(Failure::input("fiber", "question", what, "there is no such")),
        }
    }
}
