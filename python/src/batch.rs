//! Batches of queries: arrays from Python, evaluated in chunks on several threads, and the calls that every
//! [`Bsdf`] answers.
//!
//! Chunks have a fixed size and are evaluated independently, so the results do not depend on the number of
//! threads.

use crate::errors::{Failure, Outcome};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use plywave::{Bsdf, BsdfSample};
use pyo3::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Largest number of absorptions or wavelengths of a call.
pub(crate) const MAX_CHANNELS: usize = 8;
/// Number of queries in a chunk.
pub(crate) const CHUNK: usize = 2048;
/// Time between two checks for Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Number of directions of one query from which they are evaluated together.
const TOGETHER: usize = 4;

/// A flat array of either kind of float.
#[derive(FromPyObject)]
pub(crate) enum Floats<'py> {
    /// float32.
    Single(PyReadonlyArray1<'py, f32>),
    /// float64.
    Double(PyReadonlyArray1<'py, f64>),
}

/// Rows of K numbers: one row for all queries, or one per query.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Rows<'a, const K: usize> {
    /// One row for all queries.
    One([f32; K]),
    /// One row per query, in single precision.
    Single(&'a [[f32; K]]),
    /// One row per query, in double precision.
    Double(&'a [[f64; K]]),
}

impl<'a, const K: usize> Rows<'a, K> {
    /// Rows from an array with `n` rows or a single one.
    pub(crate) fn new(floats: &'a Floats<'_>, n: usize, name: &str) -> Outcome<Rows<'a, K>> {
        fn slice<'a, T: numpy::Element>(array: &'a PyReadonlyArray1<'_, T>, name: &str) -> Outcome<&'a [T]> {
            array
                .as_slice()
                .map_err(|_| Failure::input("arrays", name, "not contiguous", "the wrapper hands in flat arrays"))
        }
        let rows = match floats {
            Floats::Single(array) => {
                let flat = slice(array, name)?;
                match flat.as_chunks::<K>() {
                    ([one], []) => Some(Rows::One(*one)),
                    (rows, []) if rows.len() == n => Some(Rows::Single(rows)),
                    _ => None,
                }
            }
            Floats::Double(array) => {
                let flat = slice(array, name)?;
                match flat.as_chunks::<K>() {
                    ([one], []) => Some(Rows::One(one.map(|v| v as f32))),
                    (rows, []) if rows.len() == n => Some(Rows::Double(rows)),
                    _ => None,
                }
            }
        };
        rows.ok_or_else(|| Failure::input("arrays", name, "of another length", "the wrapper hands in rows that fit"))
    }

    /// Rows from an optional array; without it, `usual` for all queries.
    pub(crate) fn of_optional(
        floats: Option<&'a Floats<'_>>,
        n: usize,
        name: &str,
        usual: [f32; K],
    ) -> Outcome<Rows<'a, K>> {
        floats.map_or(Ok(Rows::One(usual)), |floats| Rows::new(floats, n, name))
    }

    /// Row of query `i`.
    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> [f32; K] {
        match self {
            Rows::One(row) => *row,
            Rows::Single(rows) => rows[i],
            Rows::Double(rows) => rows[i].map(|v| v as f32),
        }
    }

    /// Rows of a range of queries; they are copied to `buffer` unless they are in memory already.
    pub(crate) fn range<'b>(&'b self, range: Range<usize>, buffer: &'b mut Vec<[f32; K]>) -> &'b [[f32; K]] {
        if let Rows::Single(rows) = self {
            return &rows[range];
        }
        buffer.clear();
        buffer.extend(range.map(|i| self.get(i)));
        buffer
    }
}

/// Runs `work` on all jobs on `threads` threads, each taking the next job. The calling thread, which must not
/// hold the interpreter's lock, checks for Ctrl-C periodically.
///
/// # Errors
/// The exception that a signal raised; some jobs may then not have run.
pub(crate) fn parallel<I: Iterator + Send>(jobs: I, threads: usize, work: impl Fn(I::Item) + Sync) -> PyResult<()>
where
    I::Item: Send,
{
    let (jobs, stop) = (Mutex::new(jobs), AtomicBool::new(false));
    let next = || match stop.load(Ordering::Relaxed) {
        true => None,
        false => jobs.lock().unwrap_or_else(PoisonError::into_inner).next(),
    };
    let calling = || {
        let mut looked = Instant::now();
        while let Some(job) = next() {
            work(job);
            if looked.elapsed() > LOOK_EVERY {
                looked = Instant::now();
                Python::attach(|py| py.check_signals()).inspect_err(|_| stop.store(true, Ordering::Relaxed))?;
            }
        }
        Ok(())
    };
    if threads <= 1 {
        return calling();
    }
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(|| {
                while let Some(job) = next() {
                    work(job);
                }
            });
        }
        calling()
    })
}

/// Number of threads that is worthwhile for `n` queries.
fn threads_for(n: usize, threads: usize) -> usize {
    threads.min(n.div_ceil(CHUNK)).max(1)
}

/// Constructor of the scattering function of a query.
pub(crate) trait At<Q> {
    /// Scattering function at a query.
    type Bsdf;

    /// Prepares the query for one direction. Implementations may be inlined into the loops over queries.
    fn one(&self, query: &Q) -> Self::Bsdf;

    /// Prepares the query for several directions.
    fn many(&self, query: &Q) -> Self::Bsdf {
        self.one(query)
    }
}

/// A constructor that is the same for one direction and for several.
pub(crate) struct Same<F>(pub(crate) F);

impl<Q, B, F: Fn(&Q) -> B> At<Q> for Same<F> {
    type Bsdf = B;

    fn one(&self, query: &Q) -> B {
        self.0(query)
    }
}

/// Queries by index, and the constructor of their scattering functions.
pub(crate) struct PreparedQueries<G, A> {
    /// Number of queries.
    pub(crate) n: usize,
    /// Number of threads.
    pub(crate) threads: usize,
    /// Returns the query of an index.
    pub(crate) get: G,
    /// Constructs the scattering function of a query.
    pub(crate) at: A,
}

/// Iterator over runs of equal consecutive queries within a range of indices.
struct Runs<'a, G, Q> {
    get: &'a G,
    /// First query of the next run.
    query: Option<Q>,
    range: Range<usize>,
}

impl<'a, Q, G: Fn(usize) -> Q> Runs<'a, G, Q> {
    fn new(get: &'a G, range: Range<usize>) -> Self {
        Runs { get, query: (!range.is_empty()).then(|| get(range.start)), range }
    }
}

impl<Q: PartialEq, G: Fn(usize) -> Q> Iterator for Runs<'_, G, Q> {
    type Item = (Q, Range<usize>);

    #[inline(always)]
    fn next(&mut self) -> Option<(Q, Range<usize>)> {
        let query = self.query.take()?;
        let start = self.range.start;
        let mut end = start + 1;
        while end < self.range.end {
            let other = (self.get)(end);
            if other != query {
                self.query = Some(other);
                break;
            }
            end += 1;
        }
        self.range.start = end;
        Some((query, start..end))
    }
}

impl<G, A> PreparedQueries<G, A> {
    /// Computes M numbers per query from its scattering function and its index.
    pub(crate) fn map<Q: PartialEq, const M: usize>(
        &self,
        out: &mut [[f32; M]],
        f: impl Fn(&A::Bsdf, usize) -> [f32; M] + Sync,
    ) -> PyResult<()>
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q> + Sync,
    {
        parallel(out.chunks_mut(CHUNK).enumerate(), threads_for(self.n, self.threads), |(chunk, out)| {
            let start = chunk * CHUNK;
            for (query, range) in Runs::new(&self.get, start..start + out.len()) {
                let bsdf = self.at.many(&query);
                for i in range {
                    out[i - start] = f(&bsdf, i);
                }
            }
        })
    }

    /// Computes K times N numbers per query; each of the K goes to an array of its own.
    pub(crate) fn map_parts<Q: PartialEq, const N: usize, const K: usize>(
        &self,
        parts: [&mut [[f32; N]]; K],
        f: impl Fn(&A::Bsdf, usize) -> [[f32; N]; K] + Sync,
    ) -> PyResult<()>
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q> + Sync,
    {
        let mut chunks = parts.map(|part| part.chunks_mut(CHUNK));
        let jobs = (0..self.n.div_ceil(CHUNK))
            .map(move |chunk| (chunk, chunks.each_mut().map(|part| part.next().unwrap_or_default())));
        parallel(jobs, threads_for(self.n, self.threads), |(chunk, mut parts)| {
            let start = chunk * CHUNK;
            for (query, range) in Runs::new(&self.get, start..self.n.min(start + CHUNK)) {
                let bsdf = self.at.many(&query);
                for i in range {
                    for (part, value) in parts.iter_mut().zip(f(&bsdf, i)) {
                        part[i - start] = value;
                    }
                }
            }
        })
    }

    /// Evaluates f and pdf in the directions `w`.
    fn eval_pdf<Q: PartialEq, const N: usize>(
        &self,
        w: Rows<'_, 3>,
        f: &mut [[f32; N]],
        pdf: &mut [f32],
    ) -> PyResult<()>
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q, Bsdf: Bsdf<N>> + Sync,
    {
        let jobs = f.chunks_mut(CHUNK).zip(pdf.chunks_mut(CHUNK)).enumerate();
        parallel(jobs, threads_for(self.n, self.threads), |(chunk, (f, pdf))| {
            let (start, mut buffer) = (chunk * CHUNK, Vec::new());
            let w = w.range(start..start + f.len(), &mut buffer);
            for (query, range) in Runs::new(&self.get, start..start + f.len()) {
                let range = range.start - start..range.end - start;
                if range.len() == 1 {
                    (f[range.start], pdf[range.start]) = self.at.one(&query).eval_pdf(w[range.start]);
                    continue;
                }
                let bsdf = self.at.many(&query);
                if range.len() >= TOGETHER {
                    bsdf.eval_batch(&w[range.clone()], &mut f[range.clone()], &mut pdf[range]);
                } else {
                    for i in range {
                        (f[i], pdf[i]) = bsdf.eval_pdf(w[i]);
                    }
                }
            }
        })
    }

    /// Evaluates f in the directions `w`.
    fn eval<Q: PartialEq, const N: usize>(&self, w: Rows<'_, 3>, f: &mut [[f32; N]]) -> PyResult<()>
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q, Bsdf: Bsdf<N>> + Sync,
    {
        parallel(f.chunks_mut(CHUNK).enumerate(), threads_for(self.n, self.threads), |(chunk, f)| {
            let (start, mut buffer, mut pdf) = (chunk * CHUNK, Vec::new(), Vec::new());
            let w = w.range(start..start + f.len(), &mut buffer);
            for (query, range) in Runs::new(&self.get, start..start + f.len()) {
                let range = range.start - start..range.end - start;
                if range.len() == 1 {
                    f[range.start] = self.at.one(&query).eval(w[range.start]);
                    continue;
                }
                let bsdf = self.at.many(&query);
                if range.len() >= TOGETHER {
                    pdf.resize(range.len(), 0.0);
                    bsdf.eval_batch(&w[range.clone()], &mut f[range], &mut pdf);
                } else {
                    for i in range {
                        f[i] = bsdf.eval(w[i]);
                    }
                }
            }
        })
    }

    /// Samples with the numbers `u`: directions, weights, densities and outcomes. Light that passes straight
    /// through leaves in direction `onward`.
    fn sample<Q: PartialEq, const N: usize>(
        &self,
        u: Rows<'_, 3>,
        onward: impl Fn(&Q) -> [f32; 3] + Sync,
        (w, weight, pdf, event): SamplesMut<'_, N>,
    ) -> PyResult<()>
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q, Bsdf: Bsdf<N>> + Sync,
    {
        let jobs = w.chunks_mut(CHUNK).zip(weight.chunks_mut(CHUNK));
        let jobs = jobs.zip(pdf.chunks_mut(CHUNK)).zip(event.chunks_mut(CHUNK)).enumerate();
        parallel(jobs, threads_for(self.n, self.threads), |(chunk, (((w, weight), pdf), event))| {
            let start = chunk * CHUNK;
            for (query, range) in Runs::new(&self.get, start..start + w.len()) {
                let mut put = |i: usize, drawn: BsdfSample<N>| {
                    let k = i - start;
                    (w[k], weight[k], pdf[k], event[k]) = match drawn {
                        BsdfSample::Scattered(s) => (s.w, s.weight, s.pdf, 1),
                        BsdfSample::Straight { weight, probability } => (onward(&query), weight, probability, 2),
                        BsdfSample::Absorbed => ([0.0; 3], [0.0; N], 0.0, 0),
                    };
                };
                if range.len() == 1 {
                    put(range.start, self.at.one(&query).sample(u.get(range.start)));
                    continue;
                }
                let bsdf = self.at.many(&query);
                for i in range {
                    put(i, bsdf.sample(u.get(i)));
                }
            }
        })
    }

    /// Writes f, f and pdf, or samples to the caller's arrays.
    pub(crate) fn answer_often<Q: PartialEq, const N: usize>(
        &self,
        py: Python<'_>,
        what: ScatterCall,
        w: Rows<'_, 3>,
        out: &mut Out<'_>,
        onward: impl Fn(&Q) -> [f32; 3] + Sync,
    ) -> Outcome
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q, Bsdf: Bsdf<N>> + Sync,
    {
        let n = self.n;
        match what {
            ScatterCall::Eval => {
                let [f] = out.floats()?;
                let f = rows_mut(f, n)?;
                py.detach(|| self.eval(w, f))?;
            }
            ScatterCall::EvalPdf => {
                let [f, pdf] = out.floats()?;
                let (f, pdf) = (rows_mut(f, n)?, rows_mut::<_, 1>(pdf, n)?);
                py.detach(|| self.eval_pdf(w, f, pdf.as_flattened_mut()))?;
            }
            ScatterCall::Sample => {
                let ([drawn, weight, pdf], event) = out.floats_and_events()?;
                let (drawn, weight) = (rows_mut(drawn, n)?, rows_mut(weight, n)?);
                let (pdf, event) = (rows_mut::<_, 1>(pdf, n)?, rows_mut::<_, 1>(event, n)?);
                let (pdf, event) = (pdf.as_flattened_mut(), event.as_flattened_mut());
                py.detach(|| self.sample(w, &onward, (drawn, weight, pdf, event)))?;
            }
        }
        Ok(())
    }

    /// Writes the quantity `what` to the caller's arrays.
    pub(crate) fn answer<Q: PartialEq, const N: usize>(
        &self,
        py: Python<'_>,
        what: What,
        w: Option<Rows<'_, 3>>,
        out: &mut Out<'_>,
        onward: impl Fn(&Q) -> [f32; 3] + Sync,
    ) -> Outcome
    where
        G: Fn(usize) -> Q + Sync,
        A: At<Q, Bsdf: Bsdf<N>> + Sync,
    {
        let directions = || w.ok_or_else(|| Failure::Input("directions are missing".into()));
        let n = self.n;
        if let Some(often) = ScatterCall::from_what(what) {
            return self.answer_often(py, often, directions()?, out, onward);
        }
        match what {
            What::Eval | What::EvalPdf | What::Sample => {}
            What::Pdf => {
                let (w, [pdf]) = (directions()?, out.floats()?);
                let pdf = rows_mut(pdf, n)?;
                py.detach(|| self.map(pdf, |bsdf, i| [bsdf.pdf(w.get(i))]))?;
            }
            What::Albedo => {
                let [albedo] = out.floats()?;
                let albedo = rows_mut(albedo, n)?;
                py.detach(|| self.map(albedo, |bsdf, _| bsdf.albedo()))?;
            }
            What::Straight => {
                let [straight] = out.floats()?;
                let straight = rows_mut(straight, n)?;
                py.detach(|| self.map(straight, |bsdf, _| bsdf.straight()))?;
            }
            What::Outcomes => {
                let [outcomes] = out.floats()?;
                let outcomes = rows_mut(outcomes, n)?;
                let of = |bsdf: &A::Bsdf| {
                    let o = bsdf.outcomes();
                    [o.scattered, o.straight, o.absorbed]
                };
                py.detach(|| self.map(outcomes, |bsdf, _| of(bsdf)))?;
            }
        }
        Ok(())
    }
}

/// The caller's arrays for results: float arrays in the order of the results, and the outcomes of samples.
/// NumPy allocates them, in large pages if possible.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Out<'py> {
    floats: Vec<PyReadwriteArray1<'py, f32>>,
    events: Option<PyReadwriteArray1<'py, u8>>,
}

impl Out<'_> {
    /// The first K arrays of floats.
    pub(crate) fn floats<const K: usize>(&mut self) -> Outcome<[&mut [f32]; K]> {
        slices(&mut self.floats)
    }

    fn floats_and_events<const K: usize>(&mut self) -> Outcome<([&mut [f32]; K], &mut [u8])> {
        let events = self.events.as_mut().ok_or_else(|| Failure::Input("an array of events is missing".into()))?;
        let events = events.as_slice_mut().map_err(|_| Failure::Input("results: not contiguous".into()))?;
        Ok((slices(&mut self.floats)?, events))
    }
}

fn slices<'a, const K: usize>(arrays: &'a mut [PyReadwriteArray1<'_, f32>]) -> Outcome<[&'a mut [f32]; K]> {
    let mut made = Vec::new();
    for array in arrays {
        made.push(array.as_slice_mut().map_err(|_| Failure::Input("results: not contiguous".into()))?);
    }
    made.try_into().map_err(|_| Failure::Input("results: of another number".into()))
}

/// A flat array as `n` rows.
pub(crate) fn rows_mut<T, const K: usize>(flat: &mut [T], n: usize) -> Outcome<&mut [[T; K]]> {
    match flat.as_chunks_mut::<K>() {
        (rows, []) if rows.len() == n => Ok(rows),
        _ => Err(Failure::Input("results: of another length".into())),
    }
}

/// Arrays of Python.
pub(crate) type Arrays<'py> = Vec<Bound<'py, PyAny>>;

/// Destination of samples: directions, weights, densities, outcomes.
type SamplesMut<'a, const N: usize> = (&'a mut [[f32; 3]], &'a mut [[f32; N]], &'a mut [f32], &'a mut [u8]);

/// Quantities that every scattering function provides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    Eval,
    Pdf,
    EvalPdf,
    Sample,
    Albedo,
    Straight,
    Outcomes,
}

impl What {
    pub(crate) fn from_name(name: &str) -> Option<What> {
        Some(match name {
            "eval" => What::Eval,
            "pdf" => What::Pdf,
            "eval_pdf" => What::EvalPdf,
            "sample" => What::Sample,
            "albedo" => What::Albedo,
            "straight" => What::Straight,
            "outcomes" => What::Outcomes,
            _ => return None,
        })
    }
}

/// Quantities that callers request for millions of queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScatterCall {
    Eval,
    EvalPdf,
    Sample,
}

impl ScatterCall {
    pub(crate) fn from_what(what: What) -> Option<ScatterCall> {
        Some(match what {
            What::Eval => ScatterCall::Eval,
            What::EvalPdf => ScatterCall::EvalPdf,
            What::Sample => ScatterCall::Sample,
            _ => return None,
        })
    }
}

/// Evaluates an expression for a number of channels known at run time.
macro_rules! by_channels {
    ($channels:expr, $n:ident => $body:expr) => {
        match $channels {
            1 => {
                const $n: usize = 1;
                $body
            }
            2 => {
                const $n: usize = 2;
                $body
            }
            3 => {
                const $n: usize = 3;
                $body
            }
            4 => {
                const $n: usize = 4;
                $body
            }
            5 => {
                const $n: usize = 5;
                $body
            }
            6 => {
                const $n: usize = 6;
                $body
            }
            7 => {
                const $n: usize = 7;
                $body
            }
            8 => {
                const $n: usize = 8;
                $body
            }
            other => Err($crate::errors::Failure::input(
                "arrays",
                "channels",
                other,
                "give 1 to 8 absorptions or wavelengths a query",
            )),
        }
    };
}
pub(crate) use by_channels;
