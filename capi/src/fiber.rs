//! Single fibers.

use crate::bsdf::{PLYWAVE_MAX_COUNT, PlywaveBsdf, PlywaveSample, prepare, unprepare};
use crate::pointer::{optional, put, reference, slice, text, unit};
use crate::queries::{Counted, by_count, count_of, eval_queries, hand_out, sample_queries, take_back, wavelengths};
use crate::status::{Checked, PlywaveError, PlywaveStatus, guard, invalid};
use plywave::fiber::TabulatedFiber;
use plywave::{Bsdf, FiberModel, FiberQuery};
use std::ffi::c_char;

/// A loaded model of a fiber. It never changes: any number of threads may use it at once.
pub struct PlywaveFiber(FiberModel);

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlywaveFiber>();
};

/// What fixes a shading point of a fiber. Zeroed memory is a fine start; `count` and `omega_i` must be given.
///
/// The fiber's frame: z along it, x and y those of its outline.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveFiberQuery {
    /// Direction that light comes from, unit.
    pub omega_i: [f32; 3],
    /// Number of wavelengths: 1, 3 or 4.
    pub count: i32,
    /// Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue.
    pub lambda_um: [f32; PLYWAVE_MAX_COUNT],
    /// Offset of the ray from the center line over half the fiber's width, -1 to 1, or NULL for the mean over all. Tables hold that mean alone. Read during the call only.
    pub h_rel: *const f32,
}

impl Counted for PlywaveFiberQuery {
    fn count(&self) -> i32 {
        self.count
    }
}

/// # Safety
/// Its pointer is NULL or to a number.
#[inline(always)]
unsafe fn query_of<const N: usize>(q: &PlywaveFiberQuery) -> Checked<FiberQuery<N>> {
    unit(q.omega_i, "omega_i")?;
    // SAFETY: the caller's pointer, as documented.
    let h_rel = unsafe { optional(q.h_rel, "h_rel") }?.copied();
    if h_rel.is_some_and(|h| !(-1.0..=1.0).contains(&h)) {
        return Err(invalid("h_rel", h_rel, "a number in [-1, 1]"));
    }
    Ok(FiberQuery { h_rel, ..FiberQuery::new(q.omega_i, wavelengths(&q.lambda_um)?) })
}

/// Reads and checks a fiber table (.pwf). `path` is UTF-8. On an error `*out` is NULL. Release it with `plywave_fiber_free`.
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
            hand_out(out, PlywaveFiber(FiberModel::load(text(path, "path")?)?))
        }
    })
}

/// As `plywave_fiber_load`, of the `size` bytes of a file; `name` stands for it in messages.
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
            let fiber = TabulatedFiber::from_bytes(slice(bytes, size, "bytes")?, text(name, "name")?)?;
            hand_out(out, PlywaveFiber(fiber.into()))
        }
    })
}

/// Releases a fiber; NULL is allowed. No prepared query and no call may use it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_free(fiber: *mut PlywaveFiber) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, given back once.
        unsafe { take_back(fiber) };
        Ok(())
    });
}

/// Diameter of the cylinder that a ray must meet for the fiber to scatter it, whatever the direction and wavelength [um].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_max_width(
    fiber: *const PlywaveFiber,
    max_width_um: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put(max_width_um, reference(fiber, "fiber")?.0.max_width_um(), "max_width_um") }
    })
}

/// Prepares the fiber at a query for any number of directions. On an error `bsdf` is not prepared, whatever was in it before. The widths from which it takes light are in `plywave_bsdf_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fiber_at(
    fiber: *const PlywaveFiber,
    query: *const PlywaveFiberQuery,
    bsdf: *mut PlywaveBsdf,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    let status = guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, q) = unsafe { (&reference(fiber, "fiber")?.0, reference(query, "query")?) };
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

/// f and pdf of `n` queries, one direction each: of `queries` `[n]` and `w` `[n][3]`, to `f` `[n][count]` and `pdf` `[n]`. All queries have the count of the first.
///
/// With a bad entry the status is that of the first, `error` has its index, and all before it are written. `n` = 0 does nothing.
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
        let (of, queries) = unsafe { (&reference(fiber, "fiber")?.0, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(of.at(&query_of(q)?).eval_pdf(w))) }
        })
    })
}

/// Samples of `n` queries, one each: of `queries` `[n]` and `u` `[n][3]`, to `samples` `[n]`. As `plywave_fiber_eval_batch`.
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
        let (of, queries) = unsafe { (&reference(fiber, "fiber")?.0, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(of.at(&query_of(q)?).sample(u))) }
        })
    })
}
