//! Ply models: loading, and batches of queries.

use crate::batch::{
    Arrays, At, CHUNK, Floats, Out, PreparedQueries, Rows, Same, ScatterCall, What, by_channels, parallel, rows_mut,
};
use crate::errors::{Failure, Outcome};
use numpy::{IntoPyArray, PyReadonlyArray1};
use plywave::Document;
use plywave::gap::Slit;
use plywave::ply::{Layer, PlyData, PlyPlace, Queries};
use plywave::spec::YarnSpec;
use plywave::{PlyBsdf, PlyModel, PlyQuery};
use plywave_pipeline::model_library;
use plywave_tables::table::Table;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// A loaded ply model.
#[pyclass(frozen, module = "plywave._plywave", name = "Model")]
pub(crate) struct Model {
    pub(crate) model: Arc<PlyModel>,
}

/// The queries of a call as flat arrays.
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
    /// Positions on plies: ply numbers, azimuths, positions along the plies and footprints; `None` selects
    /// the smooth model.
    place: Option<(PyReadonlyArray1<'py, u64>, Floats<'py>, Floats<'py>, Floats<'py>)>,
    /// Whether relief and speckle are shown, for queries with positions.
    shown: (bool, bool),
    /// A layer of yarn below the ply: r, t, r* and t*.
    below: Option<[Floats<'py>; 4]>,
    /// Width [um] and fraction of slits between the fibers.
    slit: Option<(f32, f32)>,
    edge: bool,
    threads: usize,
}

/// A query as numbers: theta_i, h, absorptions, wavelengths, position, and the row of the layer below.
type Numbers<const N: usize> = (f32, f32, [f32; N], [f32; N], Option<PlyPlace>, Option<usize>);

/// A query of a smooth ply without layers: theta_i, h, absorptions, wavelengths.
type PlainNumbers<const N: usize> = (f32, f32, [f32; N], [f32; N]);

/// Constructor for queries of a smooth ply without layers.
struct PlainAt<'a> {
    model: &'a PlyModel,
    edge: bool,
}

impl<'a> PlainAt<'a> {
    #[inline(always)]
    fn at<const N: usize>(&self, &(theta_i, h, sigma, lambda): &PlainNumbers<N>, cached: bool) -> PlyBsdf<'a, N> {
        self.model.at(&PlyQuery { edge: self.edge, cached, ..PlyQuery::new(theta_i, h, sigma, lambda) })
    }
}

impl<'a, const N: usize> At<PlainNumbers<N>> for PlainAt<'a> {
    type Bsdf = PlyBsdf<'a, N>;

    // A prepared query takes 2.2 KB. Inlined into the loop over queries, and without the optional parts of a
    // query, most of it is optimized away.
    #[inline(always)]
    fn one(&self, query: &PlainNumbers<N>) -> PlyBsdf<'a, N> {
        self.at(query, false)
    }

    fn many(&self, query: &PlainNumbers<N>) -> PlyBsdf<'a, N> {
        self.at(query, true)
    }
}

/// Constructor for queries with all options.
struct PlyAt<'a, const N: usize> {
    model: &'a PlyModel,
    edge: bool,
    shown: (bool, bool),
    slit: Option<&'a Slit>,
    below: Option<[Rows<'a, N>; 4]>,
}

impl<'a, const N: usize> PlyAt<'a, N> {
    fn at(&self, &(theta_i, h_um, sigma, lambda, place, row): &Numbers<N>, cached: bool) -> PlyBsdf<'a, N> {
        let below = match (&self.below, row) {
            (Some(of), Some(i)) => {
                let [reflected, transmitted, reflected_diffuse, transmitted_diffuse] = of.each_ref().map(|r| r.get(i));
                Some(Layer { reflected, transmitted, reflected_diffuse, transmitted_diffuse })
            }
            _ => None,
        };
        let (edge, slit, (relief, speckle)) = (self.edge, self.slit, self.shown);
        let smooth = PlyQuery::new(theta_i, h_um, sigma, lambda);
        let query = PlyQuery { edge, cached, place, relief, speckle, slit, below, ..smooth };
        self.model.at(&query)
    }
}

impl<'a, const N: usize> At<Numbers<N>> for PlyAt<'a, N> {
    type Bsdf = PlyBsdf<'a, N>;

    fn one(&self, query: &Numbers<N>) -> PlyBsdf<'a, N> {
        self.at(query, false)
    }

    fn many(&self, query: &Numbers<N>) -> PlyBsdf<'a, N> {
        self.at(query, true)
    }
}

#[pymethods]
impl Model {
    /// Loads the bytes of a file; `name` identifies it in messages.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8], name: &str) -> Outcome<Model> {
        Ok(Model::from_model(py.detach(|| PlyModel::from_bytes(bytes, name))?))
    }

    /// Loads a file, or a model of the library by its name.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Outcome<Model> {
        Ok(Model::from_model(py.detach(|| model_library().load(path))?))
    }

    /// The bytes of the model's file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &py.detach(|| self.data().to_bytes())?))
    }

    /// Writes the model's file atomically.
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
    fn has_layers(&self) -> bool {
        self.data().layers.is_some()
    }

    #[getter]
    fn reference_error(&self, py: Python<'_>) -> f32 {
        py.detach(|| self.model.reference_error())
    }

    /// Energies at the nodes: r_d and f_refl `[M * H]`, f_high at each of the absorptions `[S * M * H]`.
    fn node_energies<'py>(&self, py: Python<'py>, sigma_per_um: Vec<f64>) -> Arrays<'py> {
        let data = self.data();
        let nodes = data.node_energies();
        let high = sigma_per_um.iter().flat_map(|s| nodes.iter().map(|e| e.high_at(*s, &data.path_um)));
        let high: Vec<f64> = high.collect();
        let [r_d, refl] = [nodes.iter().map(|e| e.r_d).collect::<Vec<_>>(), nodes.iter().map(|e| e.refl).collect()];
        [r_d, refl, high].map(|values| values.into_pyarray(py).into_any()).into()
    }

    /// Lobes at an incidence, `[L][6]`: of f_refl, or of f_high at an absorption.
    fn lobes(&self, theta_i: f64, h_um: f64, sigma_per_um: Option<f64>) -> Vec<f64> {
        let at = plywave_fit::locate(self.data(), theta_i, h_um);
        match sigma_per_um {
            None => plywave_fit::refl_lobes(self.data(), at).params,
            Some(sigma) => plywave_fit::high_lobes(self.data(), at, sigma).params,
        }
    }

    /// Errors of f_refl `[M * H]` and f_high `[M * H * K]` against the table of these bytes.
    fn fit_errors<'py>(&self, py: Python<'py>, table: &[u8], name: &str) -> Outcome<Arrays<'py>> {
        let errors = py.detach(|| {
            let table = Table::from_bytes(table, name)?;
            plywave_fit::errors(self.data(), &table).map_err(|e| Failure::Input(format!("{name}: {e}")))
        })?;
        Ok([errors.refl, errors.high].map(|values| values.into_pyarray(py).into_any()).into())
    }

    /// Time [s] that the Rust library takes for the queries, the best of `repeats`, with its own arrays
    /// allocated in advance; for performance tests.
    fn bench(&self, py: Python<'_>, what: &str, arrays: PlyArrays<'_>, repeats: usize) -> Outcome<f64> {
        by_channels!(arrays.channels, N => self.time::<N>(py, what, &arrays, repeats))
    }

    /// Computes the quantity `what` for the queries.
    fn ask<'py>(&self, py: Python<'py>, what: &str, arrays: PlyArrays<'py>, mut out: Out<'py>) -> Outcome {
        by_channels!(arrays.channels, N => self.answer::<N>(py, what, &arrays, &mut out))
    }
}

impl Model {
    pub(crate) fn from_model(model: PlyModel) -> Model {
        Model { model: Arc::new(model) }
    }

    fn data(&self) -> &PlyData {
        self.model.data()
    }

    /// Refuses a model without layer factors.
    fn require_layers(&self) -> Outcome {
        let hint = "the model has no layer factors; build it anew with `plywave build`";
        self.data().layers.as_ref().map(drop).ok_or_else(|| Failure::input("model", "layers", "absent", hint))
    }

    fn time<const N: usize>(&self, py: Python<'_>, what: &str, arrays: &PlyArrays<'_>, repeats: usize) -> Outcome<f64> {
        use plywave::Bsdf;
        let PlyArrays { n, threads, edge, .. } = *arrays;
        let all: Rows<'_, 1> = Rows::new(&arrays.theta_i, n, "theta_i")?;
        let theta_i: Vec<f32> = (0..n).map(|i| all.get(i)[0]).collect();
        let all: Rows<'_, 1> = Rows::new(&arrays.h_um, n, "h_um")?;
        let h_um: Vec<f32> = (0..n).map(|i| all.get(i)[0]).collect();
        let all: Rows<'_, N> = Rows::new(&arrays.sigma, n, "sigma_per_um")?;
        let sigma: Vec<[f32; N]> = (0..n).map(|i| all.get(i)).collect();
        let all: Rows<'_, N> = Rows::new(&arrays.lambda, n, "lambda_um")?;
        let lambda: Vec<[f32; N]> = (0..n).map(|i| all.get(i)).collect();
        let Some(w) = &arrays.w else { return Err(Failure::Input("directions are missing".into())) };
        let all: Rows<'_, 3> = Rows::new(w, n, "omega_o")?;
        let w: Vec<[f32; 3]> = (0..n).map(|i| all.get(i)).collect();
        let wo: [Vec<f32>; 3] = std::array::from_fn(|k| w.iter().map(|w| w[k]).collect());
        let (mut f, mut pdf) = (vec![[1.0f32; N]; n], vec![1.0f32; n]);
        let model = &*self.model;
        // Chunks are as large as possible while every thread gets several.
        let chunk = n.div_ceil(threads * 8).max(1);
        let what =
            What::from_name(what).ok_or_else(|| Failure::input("model", "question", what, "there is no such"))?;
        Ok(py.detach(|| -> PyResult<f64> {
            let mut best = f64::INFINITY;
            for _ in 0..repeats.max(1) {
                let begun = std::time::Instant::now();
                let jobs = f.chunks_mut(chunk).zip(pdf.chunks_mut(chunk)).enumerate();
                parallel(jobs, threads, |(k, (f, pdf))| {
                    let from = k * chunk;
                    let to = from + f.len();
                    if what == What::Eval && !edge {
                        let queries = Queries {
                            theta_i: &theta_i[from..to],
                            h_um: &h_um[from..to],
                            sigma_per_um: &sigma[from..to],
                            wo: wo.each_ref().map(|w| &w[from..to]),
                        };
                        return model.eval_batch(&queries, f);
                    }
                    for i in 0..f.len() {
                        let query = PlyQuery {
                            edge,
                            cached: false,
                            ..PlyQuery::new(theta_i[from + i], h_um[from + i], sigma[from + i], lambda[from + i])
                        };
                        let bsdf = model.at(&query);
                        match what {
                            What::Eval => f[i] = bsdf.eval(w[from + i]),
                            What::EvalPdf => (f[i], pdf[i]) = bsdf.eval_pdf(w[from + i]),
                            What::Sample => {
                                if let Some(s) = bsdf.sample(w[from + i]).direction() {
                                    (f[i], pdf[i]) = (s.weight, s.pdf);
                                }
                            }
                            _ => f[i] = bsdf.albedo(),
                        }
                    }
                })?;
                best = best.min(begun.elapsed().as_secs_f64());
            }
            Ok(best)
        })?)
    }

    fn answer<const N: usize>(&self, py: Python<'_>, what: &str, arrays: &PlyArrays<'_>, out: &mut Out<'_>) -> Outcome {
        let PlyArrays { n, threads, edge, .. } = *arrays;
        let theta_i: Rows<'_, 1> = Rows::new(&arrays.theta_i, n, "theta_i")?;
        let h_um: Rows<'_, 1> = Rows::new(&arrays.h_um, n, "h_um")?;
        let sigma: Rows<'_, N> = Rows::new(&arrays.sigma, n, "sigma_per_um")?;
        let lambda: Rows<'_, N> = Rows::new(&arrays.lambda, n, "lambda_um")?;
        let w: Option<Rows<'_, 3>> = arrays.w.as_ref().map(|w| Rows::new(w, n, "omega_o")).transpose()?;
        let places = match &arrays.place {
            None => None,
            Some((ply, azimuth, along_um, footprint_um)) => {
                let ply = ply.as_slice().map_err(|_| Failure::Input("place.ply: not contiguous".into()))?;
                if ply.len() != 1 && ply.len() != n {
                    return Err(Failure::Input("place.ply: of another length".into()));
                }
                let azimuth: Rows<'_, 1> = Rows::new(azimuth, n, "place.azimuth")?;
                let along_um: Rows<'_, 1> = Rows::new(along_um, n, "place.along_um")?;
                Some((ply, azimuth, along_um, Rows::<1>::new(footprint_um, n, "place.footprint_um")?))
            }
        };
        let place = |i: usize| {
            let (ply, azimuth, along_um, footprint_um) = places?;
            // Ply numbers count modulo 2^32.
            let ply = ply[if ply.len() == 1 { 0 } else { i }] as u32;
            let ([azimuth], [along_um], [footprint_um]) = (azimuth.get(i), along_um.get(i), footprint_um.get(i));
            Some(PlyPlace { ply, azimuth, along_um, footprint_um })
        };
        let model = &*self.model;
        let slit = match arrays.slit {
            Some((width_um, share)) => {
                let beam = YarnSpec::parse(&self.data().spec_text, "spec of the model")?.beam.beam();
                Some(Slit::new(width_um, share, &beam)?)
            }
            None => None,
        };
        let below = match &arrays.below {
            Some([a, b, c, d]) => {
                self.require_layers()?;
                let of = |rows, name| Rows::<N>::new(rows, n, name);
                Some([of(a, "below")?, of(b, "below")?, of(c, "below")?, of(d, "below")?])
            }
            None => None,
        };
        let one_below = below.is_some_and(|of| of.iter().all(|rows| matches!(rows, Rows::One(_))));
        let plain = places.is_none() && below.is_none() && slit.is_none();
        if let (true, Kernel::Lobes, Some(w)) = (plain, Kernel::from_query(what, edge, (theta_i, h_um, sigma)), w) {
            let [f] = out.floats()?;
            let f = rows_mut(f, n)?;
            py.detach(|| lobes(model, threads, (theta_i, h_um, sigma), w, f))?;
            return Ok(());
        }
        let onward = |theta_i: f32| [0.0, -theta_i.cos(), -theta_i.sin()];
        // Only the usual numbers of channels are specialized, to limit compile time.
        let usual = const { matches!(N, 1 | 3 | 4) };
        if usual
            && let (true, Some(often), Some(w)) = (plain, What::from_name(what).and_then(ScatterCall::from_what), w)
        {
            let get = |i| -> PlainNumbers<N> { (theta_i.get(i)[0], h_um.get(i)[0], sigma.get(i), lambda.get(i)) };
            let prepared = PreparedQueries { n, threads, get, at: PlainAt { model, edge } };
            return prepared.answer_often(py, often, w, out, |(theta_i, ..)| onward(*theta_i));
        }
        let row = |i: usize| below.is_some().then_some(if one_below { 0 } else { i });
        let prepared = PreparedQueries {
            n,
            threads,
            get: |i| -> Numbers<N> {
                (theta_i.get(i)[0], h_um.get(i)[0], sigma.get(i), lambda.get(i), place(i), row(i))
            },
            at: PlyAt { model, edge, shown: arrays.shown, slit: slit.as_ref(), below },
        };
        match (what, w) {
            ("layer", _) => {
                self.require_layers()?;
                let prepared = PreparedQueries {
                    n,
                    threads,
                    get: |i| (theta_i.get(i)[0], sigma.get(i)),
                    at: Same(|&(theta_i, sigma): &(f32, [f32; N])| model.layer::<N>(theta_i, sigma)),
                };
                let parts = parts_of(out, n)?;
                py.detach(|| {
                    prepared.map_parts(parts, |layer, _| {
                        let of =
                            |l: &Layer<N>| [l.reflected, l.transmitted, l.reflected_diffuse, l.transmitted_diffuse];
                        layer.as_ref().map_or([[0.0; N]; 4], of)
                    })
                })?;
                Ok(())
            }
            ("r_d", _) => {
                let [r_d] = out.floats()?;
                let r_d = rows_mut(r_d, n)?;
                py.detach(|| prepared.map(r_d, |bsdf: &PlyBsdf<'_, N>, _| [bsdf.r_d()]))?;
                Ok(())
            }
            ("terms", Some(w)) => {
                let parts = parts_of(out, n)?;
                py.detach(|| {
                    prepared.map_parts(parts, |bsdf: &PlyBsdf<'_, N>, i| {
                        let terms = bsdf.terms(w.get(i));
                        [[terms.refl; N], terms.high, terms.edge, terms.slit]
                    })
                })?;
                Ok(())
            }
            _ => {
                let what = What::from_name(what)
                    .ok_or_else(|| Failure::input("model", "question", what, "there is no such"))?;
                prepared.answer(py, what, w, out, |(theta_i, ..)| onward(*theta_i))
            }
        }
    }
}

/// The caller's four arrays with N numbers per query.
fn parts_of<'a, const N: usize>(out: &'a mut Out<'_>, n: usize) -> Outcome<[&'a mut [[f32; N]]; 4]> {
    let [a, b, c, d] = out.floats()?;
    Ok([rows_mut(a, n)?, rows_mut(b, n)?, rows_mut(c, n)?, rows_mut(d, n)?])
}

/// Choice between the general evaluation and the kernel for many incidences.
#[derive(PartialEq, Eq)]
enum Kernel {
    Lobes,
    Other,
}

impl Kernel {
    /// Selects the kernel for queries of f alone, without edge light, each with its own incidence.
    fn from_query<const N: usize>(what: &str, edge: bool, at: (Rows<'_, 1>, Rows<'_, 1>, Rows<'_, N>)) -> Kernel {
        match at {
            (Rows::One(_), Rows::One(_), Rows::One(_)) => Kernel::Other,
            _ if what == "eval" && !edge => Kernel::Lobes,
            _ => Kernel::Other,
        }
    }
}

/// Evaluates f_refl + f_high with the kernel for many incidences.
fn lobes<const N: usize>(
    model: &PlyModel,
    threads: usize,
    (theta_i, h_um, sigma): (Rows<'_, 1>, Rows<'_, 1>, Rows<'_, N>),
    w: Rows<'_, 3>,
    f: &mut [[f32; N]],
) -> PyResult<()> {
    let threads = threads.min(f.len().div_ceil(CHUNK)).max(1);
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
    })
}
