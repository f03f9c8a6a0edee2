//! Many queries at once: arrays from Python, chunks of them side by side on threads, and what every [`Bsdf`] answers.
//!
//! Chunks have a fixed size and each is worked on alone, so that results do not depend on the number of threads.

use crate::errors::{Failure, Outcome};
use numpy::{IntoPyArray, PyReadonlyArray1};
use plywave::{Bsdf, BsdfSample};
use pyo3::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Most absorptions or wavelengths of a call.
pub(crate) const MOST_CHANNELS: usize = 8;
/// Queries that one thread takes at a time.
pub(crate) const CHUNK: usize = 2048;
/// Directions of one query from which they are evaluated together.
const TOGETHER: usize = 4;

/// A flat array of either kind of float.
#[derive(FromPyObject)]
pub(crate) enum Floats<'py> {
    /// float32.
    Single(PyReadonlyArray1<'py, f32>),
    /// float64.
    Double(PyReadonlyArray1<'py, f64>),
}

/// Rows of K numbers: one for all queries, or one a query.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Rows<'a, const K: usize> {
    /// One for all.
    One([f32; K]),
    /// One a query, in single precision.
    Single(&'a [[f32; K]]),
    /// One a query, in double precision.
    Double(&'a [[f64; K]]),
}

impl<'a, const K: usize> Rows<'a, K> {
    /// Of an array of `n` rows or of one.
    pub(crate) fn of(floats: &'a Floats<'_>, n: usize, name: &str) -> Outcome<Rows<'a, K>> {
        fn slice<'a, T: numpy::Element>(array: &'a PyReadonlyArray1<'_, T>, name: &str) -> Outcome<&'a [T]> {
            array.as_slice().map_err(|_| Failure::input("arrays", name, "not contiguous", "the wrapper hands in flat arrays"))
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

    /// Of an array that may be left out: then `usual` for all.
    pub(crate) fn of_optional(floats: Option<&'a Floats<'_>>, n: usize, name: &str, usual: [f32; K]) -> Outcome<Rows<'a, K>> {
        floats.map_or(Ok(Rows::One(usual)), |floats| Rows::of(floats, n, name))
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

    /// Rows of some queries, in `kept` where they are not in memory as they are.
    pub(crate) fn range<'b>(&'b self, range: Range<usize>, kept: &'b mut Vec<[f32; K]>) -> &'b [[f32; K]] {
        if let Rows::Single(rows) = self {
            return &rows[range];
        }
        kept.clear();
        kept.extend(range.map(|i| self.get(i)));
        kept
    }
}

/// Works on jobs on `threads` threads, each taking the next.
pub(crate) fn parallel<I: Iterator + Send>(jobs: I, threads: usize, work: impl Fn(I::Item) + Sync)
where
    I::Item: Send,
{
    if threads <= 1 {
        return jobs.for_each(work);
    }
    let jobs = Mutex::new(jobs);
    let next = || jobs.lock().unwrap_or_else(PoisonError::into_inner).next();
    std::thread::scope(|scope| {
        let run = || {
            while let Some(job) = next() {
                work(job);
            }
        };
        for _ in 1..threads {
            scope.spawn(run);
        }
        run();
    });
}

/// How many threads `n` queries are worth.
fn threads_for(n: usize, threads: usize) -> usize {
    threads.min(n.div_ceil(CHUNK)).max(1)
}

/// Queries of an index, and the scattering function at one of them.
pub(crate) struct Asked<G, A> {
    /// Number of queries.
    pub(crate) n: usize,
    /// Threads.
    pub(crate) threads: usize,
    /// The query of an index.
    pub(crate) get: G,
    /// What it is at a query; true where it is asked for several directions.
    pub(crate) at: A,
}

impl<G, A> Asked<G, A> {
    /// Calls `each` with every run of equal queries within `range`.
    fn runs<Q: PartialEq, B>(&self, range: Range<usize>, mut each: impl FnMut(&B, Range<usize>))
    where
        G: Fn(usize) -> Q,
        A: Fn(&Q, bool) -> B,
    {
        let mut i = range.start;
        while i < range.end {
            let query = (self.get)(i);
            let mut end = i + 1;
            while end < range.end && (self.get)(end) == query {
                end += 1;
            }
            each(&(self.at)(&query, end > i + 1), i..end);
            i = end;
        }
    }

    /// M numbers a query, of what is there at it and its index.
    pub(crate) fn map<Q: PartialEq, B, const M: usize>(&self, f: impl Fn(&B, usize) -> [f32; M] + Sync) -> Vec<[f32; M]>
    where
        G: Fn(usize) -> Q + Sync,
        A: Fn(&Q, bool) -> B + Sync,
    {
        let mut out = vec![[0.0; M]; self.n];
        parallel(out.chunks_mut(CHUNK).enumerate(), threads_for(self.n, self.threads), |(chunk, out)| {
            let start = chunk * CHUNK;
            self.runs(start..start + out.len(), |bsdf, range| {
                for i in range {
                    out[i - start] = f(bsdf, i);
                }
            });
        });
        out
    }

    /// f and pdf in the directions `w`.
    fn eval_pdf<Q: PartialEq, B: Bsdf<N>, const N: usize>(&self, w: Rows<'_, 3>) -> (Vec<[f32; N]>, Vec<f32>)
    where
        G: Fn(usize) -> Q + Sync,
        A: Fn(&Q, bool) -> B + Sync,
    {
        let (mut f, mut pdf) = (vec![[0.0; N]; self.n], vec![0.0; self.n]);
        let jobs = f.chunks_mut(CHUNK).zip(pdf.chunks_mut(CHUNK)).enumerate();
        parallel(jobs, threads_for(self.n, self.threads), |(chunk, (f, pdf))| {
            let (start, mut kept) = (chunk * CHUNK, Vec::new());
            let w = w.range(start..start + f.len(), &mut kept);
            self.runs(start..start + f.len(), |bsdf, range| {
                let range = range.start - start..range.end - start;
                if range.len() >= TOGETHER {
                    bsdf.eval_batch(&w[range.clone()], &mut f[range.clone()], &mut pdf[range]);
                } else {
                    for i in range {
                        (f[i], pdf[i]) = bsdf.eval_pdf(w[i]);
                    }
                }
            });
        });
        (f, pdf)
    }

    /// f alone in the directions `w`.
    fn eval<Q: PartialEq, B: Bsdf<N>, const N: usize>(&self, w: Rows<'_, 3>) -> Vec<[f32; N]>
    where
        G: Fn(usize) -> Q + Sync,
        A: Fn(&Q, bool) -> B + Sync,
    {
        let mut f = vec![[0.0; N]; self.n];
        parallel(f.chunks_mut(CHUNK).enumerate(), threads_for(self.n, self.threads), |(chunk, f)| {
            let (start, mut kept, mut pdf) = (chunk * CHUNK, Vec::new(), Vec::new());
            let w = w.range(start..start + f.len(), &mut kept);
            self.runs(start..start + f.len(), |bsdf, range| {
                let range = range.start - start..range.end - start;
                if range.len() >= TOGETHER {
                    pdf.resize(range.len(), 0.0);
                    bsdf.eval_batch(&w[range.clone()], &mut f[range], &mut pdf);
                } else {
                    for i in range {
                        f[i] = bsdf.eval(w[i]);
                    }
                }
            });
        });
        f
    }

    /// Samples by the numbers `u`: directions, weights, densities and what became of the light. Light that goes straight on leaves along `onward`.
    fn sample<Q: PartialEq, B: Bsdf<N>, const N: usize>(
        &self,
        u: Rows<'_, 3>,
        onward: impl Fn(&Q) -> [f32; 3] + Sync,
    ) -> Samples<N>
    where
        G: Fn(usize) -> Q + Sync,
        A: Fn(&Q, bool) -> B + Sync,
    {
        let n = self.n;
        let mut s = Samples { w: vec![[0.0; 3]; n], weight: vec![[0.0; N]; n], pdf: vec![0.0; n], event: vec![0u8; n] };
        let jobs = s.w.chunks_mut(CHUNK).zip(s.weight.chunks_mut(CHUNK));
        let jobs = jobs.zip(s.pdf.chunks_mut(CHUNK)).zip(s.event.chunks_mut(CHUNK)).enumerate();
        parallel(jobs, threads_for(n, self.threads), |(chunk, (((w, weight), pdf), event))| {
            let start = chunk * CHUNK;
            self.runs(start..start + w.len(), |bsdf, range| {
                for i in range {
                    let k = i - start;
                    match bsdf.sample(u.get(i)) {
                        BsdfSample::Scattered(s) => (w[k], weight[k], pdf[k], event[k]) = (s.w, s.weight, s.pdf, 1),
                        BsdfSample::Straight { weight: by, probability } => {
                            (w[k], weight[k], pdf[k], event[k]) = (onward(&(self.get)(i)), by, probability, 2);
                        }
                        BsdfSample::Absorbed => {}
                    }
                }
            });
        });
        s
    }

    /// What `what` asks for, as flat arrays.
    pub(crate) fn answer<'py, Q: PartialEq, B: Bsdf<N>, const N: usize>(
        &self,
        py: Python<'py>,
        what: What,
        w: Option<Rows<'_, 3>>,
        onward: impl Fn(&Q) -> [f32; 3] + Sync,
    ) -> Outcome<Arrays<'py>>
    where
        G: Fn(usize) -> Q + Sync,
        A: Fn(&Q, bool) -> B + Sync,
    {
        let directions = || w.ok_or_else(|| Failure::Input("directions are missing".into()));
        Ok(match what {
            What::Eval => {
                let w = directions()?;
                vec![flat(py, py.detach(|| self.eval(w)))]
            }
            What::EvalPdf | What::Pdf => {
                let w = directions()?;
                if what == What::Pdf {
                    vec![flat(py, py.detach(|| self.map(|bsdf, i| [bsdf.pdf(w.get(i))])))]
                } else {
                    let (f, pdf) = py.detach(|| self.eval_pdf(w));
                    vec![flat(py, f), pdf.into_pyarray(py).into_any()]
                }
            }
            What::Sample => {
                let u = directions()?;
                let s = py.detach(|| self.sample(u, &onward));
                let (w, weight) = (flat(py, s.w), flat(py, s.weight));
                vec![w, weight, s.pdf.into_pyarray(py).into_any(), s.event.into_pyarray(py).into_any()]
            }
            What::Albedo => vec![flat(py, py.detach(|| self.map(|bsdf, _| bsdf.albedo())))],
            What::Straight => vec![flat(py, py.detach(|| self.map(|bsdf, _| bsdf.straight())))],
            What::Outcomes => {
                let of = |bsdf: &B| {
                    let o = bsdf.outcomes();
                    [o.scattered, o.straight, o.absorbed]
                };
                vec![flat(py, py.detach(|| self.map(|bsdf, _| of(bsdf))))]
            }
        })
    }
}

/// Arrays of Python.
pub(crate) type Arrays<'py> = Vec<Bound<'py, PyAny>>;

/// Samples as arrays.
struct Samples<const N: usize> {
    w: Vec<[f32; 3]>,
    weight: Vec<[f32; N]>,
    pdf: Vec<f32>,
    event: Vec<u8>,
}

/// Rows as one flat array of Python.
pub(crate) fn flat<const M: usize>(py: Python<'_>, rows: Vec<[f32; M]>) -> Bound<'_, PyAny> {
    rows.into_flattened().into_pyarray(py).into_any()
}

/// What every scattering function answers.
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
    pub(crate) fn of(name: &str) -> Option<What> {
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

/// Evaluates an expression for a number of channels known at run time.
macro_rules! by_channels {
    ($channels:expr, $n:ident => $body:expr) => {
        match $channels {
            1 => { const $n: usize = 1; $body }
            2 => { const $n: usize = 2; $body }
            3 => { const $n: usize = 3; $body }
            4 => { const $n: usize = 4; $body }
            5 => { const $n: usize = 5; $body }
            6 => { const $n: usize = 6; $body }
            7 => { const $n: usize = 7; $body }
            8 => { const $n: usize = 8; $body }
            other => Err($crate::errors::Failure::input("arrays", "channels", other, "give 1 to 8 absorptions or wavelengths a query")),
        }
    };
}
pub(crate) use by_channels;
