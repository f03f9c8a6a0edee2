//! Single fibers: loading, queries and batches.

use crate::bsdf::{PLYWAVE_MAX_COUNT, PlywaveBsdf, PlywaveSample, prepare, unprepare};
use crate::pointer::{optional, put, reference, slice, text, unit};
use crate::queries::{Counted, by_count, count_of, eval_queries, hand_out, sample_queries, take_back, wavelengths};
use crate::status::{Checked, PlywaveError, PlywaveStatus, guard, invalid};
use plywave::Bsdf;
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{FilamentSpec, TabulatedFiber};
use std::ffi::c_char;

/// Largest absorption of a query [1/um], the limit of specs.
const MAX_SIGMA_PER_UM: f32 = 1000.0;

/// A loaded fiber model. It is immutable: any number of threads may use it at once.
pub struct PlywaveFiber {
    model: FiberModel,
    /// Wavelengths [um] and absorption [1/um] from the spec of an analytic fiber.
    color: Option<[[f32; 3]; 2]>,
}

impl From<FilamentSpec> for PlywaveFiber {
    fn from(spec: FilamentSpec) -> PlywaveFiber {
        PlywaveFiber { model: spec.model, color: Some([spec.lambda_um, spec.sigma_per_um]) }
    }
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlywaveFiber>();
};

/// A query at a shading point of a fiber. Start from zeroed memory; `count` and `omega_i` are required.
///
/// The fiber's frame: z along the fiber, x and y the axes of its outline.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveFiberQuery {
    /// Direction that light comes from, unit.
    pub omega_i: [f32; 3],
    /// Number of wavelengths: 1, 3 or 4.
    pub count: i32,
    /// Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue.
    pub lambda_um: [f32; PLYWAVE_MAX_COUNT],
    /// Offset of the ray from the center line relative to half the fiber's width, -1 to 1, or NULL for the
    /// mean over all offsets. Tables contain only that mean. Read during the call only.
    pub h_rel: *const f32,
    /// Absorption inside the fiber [1/um], by wavelength: the color of an analytic fiber. Tables ignore it,
    /// because they contain their own.
    pub sigma_per_um: [f32; PLYWAVE_MAX_COUNT],
}

impl Counted for PlywaveFiberQuery {
    fn count(&self) -> i32 {
        self.count
    }
}

/// # Safety
/// Its pointer is NULL or points to a number.
#[inline(always)]
unsafe fn query_of<const N: usize>(q: &PlywaveFiberQuery) -> Checked<FiberQuery<N>> {
    unit(q.omega_i, "omega_i")?;
    // SAFETY: the caller's pointer, as documented.
    let h_rel = unsafe { optional(q.h_rel, "h_rel") }?.copied();
    if h_rel.is_some_and(|h| !(-1.0..=1.0).contains(&h)) {
        return Err(invalid("h_rel", h_rel, "a number in [-1, 1]"));
    }
    let sigma_per_um: [f32; N] = std::array::from_fn(|k| q.sigma_per_um[k]);
    if let Some(s) = sigma_per_um.iter().find(|s| !(0.0..=MAX_SIGMA_PER_UM).contains(*s)) {
        return Err(invalid("sigma_per_um", s, "numbers in [0, 1000]"));
    }
    Ok(FiberQuery { omega_i: q.omega_i, h_rel, lambda_um: wavelengths(&q.lambda_um)?, sigma_per_um })
}

/// Reads and checks a fiber table (.pwf), or the spec of an analytic fiber (.toml). `path` is UTF-8. On an
/// error `*out` is NULL. Release it with `plywave_fiber_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_load(
    path: *const c_char,
    out: *mut *mut PlywaveFiber,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let path = text(path, "path")?;
            let fiber = if path.ends_with(".toml") {
                FilamentSpec::load(path)?.into()
            } else {
                PlywaveFiber { model: FiberModel::load(path)?, color: None }
            };
            hand_out(out, fiber)
        }
    })
}

/// Like `plywave_fiber_load`, but from the `size` bytes of a file; `name` identifies the file in messages and
/// ends in `.toml` for a spec.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_from_bytes(
    bytes: *const u8,
    size: usize,
    name: *const c_char,
    out: *mut *mut PlywaveFiber,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let (bytes, name) = (slice(bytes, size, "bytes")?, text(name, "name")?);
            let fiber = match FilamentSpec::from_bytes(bytes, name)? {
                Some(spec) => spec.into(),
                None => PlywaveFiber { model: TabulatedFiber::from_bytes(bytes, name)?.into(), color: None },
            };
            hand_out(out, fiber)
        }
    })
}

/// Releases a fiber; NULL is allowed. No prepared query and no call may use it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_free(fiber: *mut PlywaveFiber) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, given back once.
        unsafe { take_back(fiber) };
        Ok(())
    });
}

/// Diameter [um] of the cylinder that contains all rays which the fiber scatters, over all directions and
/// wavelengths.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_max_width(
    fiber: *const PlywaveFiber,
    max_width_um: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put(max_width_um, reference(fiber, "fiber")?.model.max_width_um(), "max_width_um") }
    })
}

/// Color of an analytic fiber from its spec, in the form of a query: writes three wavelengths [um] to
/// `lambda_um` `[3]` and the absorptions at these [1/um] to `sigma_per_um` `[3]`. All are 0 for a table,
/// which contains its own absorption.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_color(
    fiber: *const PlywaveFiber,
    lambda_um: *mut f32,
    sigma_per_um: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            let [lambda, sigma] = reference(fiber, "fiber")?.color.unwrap_or_default();
            put(lambda_um.cast(), lambda, "lambda_um")?;
            put(sigma_per_um.cast(), sigma, "sigma_per_um")
        }
    })
}

/// Prepares the fiber at a query for any number of directions. On an error `bsdf` is not prepared, whatever
/// it held before. `plywave_bsdf_info` returns the widths over which the fiber intercepts light.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_at(
    fiber: *const PlywaveFiber,
    query: *const PlywaveFiberQuery,
    bsdf: *mut PlywaveBsdf,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    let status = guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, q) = unsafe { (&reference(fiber, "fiber")?.model, reference(query, "query")?) };
        by_count!(q.count, N => {
            // SAFETY: as above.
            unsafe {
                let query = query_of::<N>(q)?;
                prepare(bsdf, || of.at(&query))
            }
        })
    });
    if status != PlywaveStatus::Ok {
        // SAFETY: as above.
        unsafe { unprepare(bsdf) };
    }
    status
}

/// f and pdf of `n` queries, one direction each: from `queries` `[n]` and `w` `[n][3]` to `f` `[n][count]`
/// and `pdf` `[n]`. All queries have the count of the first.
///
/// If an entry is invalid, the status is that of the first such entry, `error` has its index, and all entries
/// before it are written. `n` = 0 does nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_eval_batch(
    fiber: *const PlywaveFiber,
    n: usize,
    queries: *const PlywaveFiberQuery,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(fiber, "fiber")?.model, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(of.at(&query_of(q)?).eval_pdf(w))) }
        })
    })
}

/// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
/// `plywave_fiber_eval_batch`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_sample_batch(
    fiber: *const PlywaveFiber,
    n: usize,
    queries: *const PlywaveFiberQuery,
    u: *const f32,
    samples: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(fiber, "fiber")?.model, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(of.at(&query_of(q)?).sample(u))) }
        })
    })
}
