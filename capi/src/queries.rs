//! Batches of queries with one direction each, and handles: code shared by all kinds of models.

use crate::bsdf::{PlywaveSample, outputs, put_sample};
use crate::pointer::{disjoint, put, slice, slice_mut, span, uniform, unit};
use crate::status::{AtIndex, Checked, invalid};
use plywave::BsdfSample;

/// Runs an expression for the number of wavelengths of a query: 1, 3 or 4.
macro_rules! by_count {
    ($count:expr, $n:ident => $body:expr) => {
        match $count {
            1 => {
                const $n: usize = 1;
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
            other => Err(crate::status::invalid("count", other, "1, 3 or 4")),
        }
    };
}
pub(crate) use by_count;

/// A query in C's layout.
pub(crate) trait Counted {
    /// Its number of wavelengths.
    fn count(&self) -> i32;
}

/// The number of wavelengths of all queries, which is that of the first.
pub(crate) fn count_of<Q: Counted>(queries: &[Q]) -> Checked<i32> {
    let Some(first) = queries.first() else { return Ok(1) };
    let same = |(i, q): (usize, &Q)| {
        if q.count() == first.count() {
            Ok(())
        } else {
            Err(invalid("count", q.count(), "that of the first query")).at(i)
        }
    };
    queries.iter().enumerate().try_for_each(same)?;
    Ok(first.count())
}

/// Evaluates f and pdf of many queries, one direction each.
pub(crate) unsafe fn eval_queries<Q, const N: usize>(
    queries: &[Q],
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    eval_pdf: impl Fn(&Q, [f32; 3]) -> Checked<([f32; N], f32)>,
) -> Checked {
    let (n, f) = (queries.len(), f.cast::<[f32; N]>());
    // SAFETY: the caller's arrays; lengths are checked there.
    let w = unsafe { slice(w.cast::<[f32; 3]>(), n, "w") }?;
    outputs(n, f, pdf, &[span(w.as_ptr(), n), span(queries.as_ptr(), n)])?;
    // SAFETY: the caller's arrays, which `outputs` found disjoint.
    let (f, pdf) = unsafe { (slice_mut(f, n, "f")?, slice_mut(pdf, n, "pdf")?) };
    for i in 0..n {
        let one = unit(w[i], "w").and_then(|()| eval_pdf(&queries[i], w[i]));
        (f[i], pdf[i]) = one.at(i)?;
    }
    Ok(())
}

/// Samples many queries once each.
pub(crate) unsafe fn sample_queries<Q, const N: usize>(
    queries: &[Q],
    u: *const f32,
    samples: *mut PlywaveSample,
    sample: impl Fn(&Q, [f32; 3]) -> Checked<BsdfSample<N>>,
) -> Checked {
    let n = queries.len();
    // SAFETY: the caller's arrays; lengths are checked there.
    let u = unsafe { slice(u.cast::<[f32; 3]>(), n, "u") }?;
    if n > 0 {
        disjoint(span(samples, n), &[span(u.as_ptr(), n), span(queries.as_ptr(), n)], "samples")?;
    }
    // SAFETY: the caller's array, which is disjoint from the others.
    let samples = unsafe { slice_mut(samples, n, "samples") }?;
    for i in 0..n {
        let one = uniform(u[i]).and_then(|()| sample(&queries[i], u[i]));
        // SAFETY: an entry of the array.
        unsafe { put_sample(&mut samples[i], one.at(i)?) }?;
    }
    Ok(())
}

/// The first N numbers of a query, all finite.
#[inline(always)]
pub(crate) fn first<const N: usize>(of: &[f32; 4], name: &str) -> Checked<[f32; N]> {
    let values: [f32; N] = std::array::from_fn(|k| of[k]);
    crate::pointer::all_finite(&values, name)?;
    Ok(values)
}

/// The wavelengths of a query [um]; three zeros stand for those of red, green and blue.
#[inline(always)]
pub(crate) fn wavelengths<const N: usize>(of: &[f32; 4]) -> Checked<[f32; N]> {
    let values: [f32; N] = std::array::from_fn(|k| of[k]);
    if values.iter().all(|l| *l > 0.0 && l.is_finite()) {
        return Ok(values);
    }
    if N == 3 && values == [0.0; N] {
        return Ok(std::array::from_fn(|k| plywave::color::RGB_LAMBDA_UM[k.min(2)]));
    }
    Err(invalid("lambda_um", values, "wavelengths above 0, in um"))
}

/// Passes a new handle to the caller.
pub(crate) unsafe fn hand_out<T>(out: *mut *mut T, value: T) -> Checked {
    // SAFETY: the caller's pointer, which was checked when the call began.
    unsafe { put(out, Box::into_raw(Box::new(value)), "out") }
}

/// Releases a handle; NULL is allowed.
pub(crate) unsafe fn take_back<T>(handle: *mut T) {
    if !handle.is_null() && handle.is_aligned() {
        // SAFETY: the caller got it from `hand_out` and releases it once.
        drop(unsafe { Box::from_raw(handle) });
    }
}
