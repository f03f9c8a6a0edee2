//! A prepared query: a model at one query, in the caller's memory, evaluated in any number of directions. One
//! set of functions serves plies, cloths and fibers.

use crate::pointer::{
    disjoint, is_uniform, is_unit, pointer, pointers, put, slice, slice_mut, span, three, to_direction, to_random,
    uniform, unit,
};
use crate::status::{AtIndex, Checked, PlywaveError, PlywaveStatus, failure, guard};
use plywave::cloth::ClothBsdf;
use plywave::{Bsdf, BsdfSample, PlyBsdf};
use plywave_fiber::FiberBsdf;

/// Largest number of wavelengths or channels of a query.
pub const PLYWAVE_MAX_COUNT: usize = 4;

/// Size of a prepared query in 64-bit words, without its tag. With the tag it is 7 KB: the size of the
/// largest prepared query, a cloth at four wavelengths.
pub const PLYWAVE_BSDF_WORDS: usize = 928;

/// A model at a query. The caller provides the memory, usually on the stack; the library writes and reads its
/// content. A prepared query owns no memory and needs no release; it may be copied, moved, and read by many
/// threads. It is valid as long as the handles that it was prepared from: the model or cloth, and the slit
/// and models of its query.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PlywaveBsdf {
    /// Identifies the prepared type.
    pub tag: u64,
    /// Private to the library.
    pub words: [u64; PLYWAVE_BSDF_WORDS],
}

/// Outcome of a sampled light path.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveOutcome {
    /// The path ends here: w, weight and pdf are 0.
    Absorbed = 0,
    /// The light is scattered into the direction w.
    Scattered = 1,
    /// The light passes straight through as if there were no model: a delta. w is 0, pdf the probability of
    /// this outcome.
    Straight = 2,
}

/// A sampled light path.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveSample {
    /// The outcome: a `PlywaveOutcome`.
    pub outcome: i32,
    /// Direction of scattered light, a unit vector.
    pub w: [f32; 3],
    /// f / pdf by wavelength, or the straight fraction divided by its probability; 0 beyond the count.
    pub weight: [f32; PLYWAVE_MAX_COUNT],
    /// Density of the direction [1/sr], including the probability of scattering; or the probability that the
    /// light passes straight through.
    pub pdf: f32,
}

/// Probabilities of the outcomes of sampling; they sum to 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveOutcomes {
    /// Probability of `PLYWAVE_OUTCOME_ABSORBED`.
    pub absorbed: f32,
    /// Probability of `PLYWAVE_OUTCOME_SCATTERED`: the integral of the pdf.
    pub scattered: f32,
    /// Probability of `PLYWAVE_OUTCOME_STRAIGHT`.
    pub straight: f32,
}

/// Kinds of models.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveKind {
    /// A ply.
    Ply = 1,
    /// A cloth.
    Cloth = 2,
    /// A fiber.
    Fiber = 3,
}

/// Description of a prepared query.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveBsdfInfo {
    /// Kind of its model.
    pub kind: PlywaveKind,
    /// Number of wavelengths or channels: 1, 3 or 4.
    pub count: i32,
    /// Whether a second layer of yarn lies below the point; for a cloth, whether the line hits both kinds of
    /// yarns; 0 or 1.
    pub is_double: i32,
    /// For a cloth: whether the point lies in a gap, where the line hits no ply; 0 or 1.
    pub is_gap: i32,
    /// For a ply: the fraction of the beam that misses all fibers; else 0.
    pub r_d: f32,
    /// For a fiber: the width over which it intercepts light [um], by wavelength; else 0.
    pub width_um: [f32; PLYWAVE_MAX_COUNT],
}

/// First half of every tag; uninitialized memory is unlikely to contain it.
const MARK: u64 = 0x706c_7977 << 32;

/// Tag of a model of a kind at N wavelengths.
pub(crate) const fn tag(kind: PlywaveKind, count: usize) -> u64 {
    MARK | (kind as u64) << 8 | count as u64
}

/// A type that the memory of a prepared query may contain.
///
/// # Safety
/// The type is plain data: no destructor, no reference into itself, and `TAG` belongs to this type alone.
pub(crate) unsafe trait Prepared: Copy + Send + Sync {
    const TAG: u64;
}

/// Implements [`Prepared`] for each type with its tag, and asserts that it fits, is aligned, and is shared
/// between threads.
macro_rules! prepared_types {
    ($($kind:ident $type:ident $count:literal),* $(,)?) => {$(
        // SAFETY: the type is Copy and made of numbers and references to the models; the tag names kind and
        // count.
        unsafe impl Prepared for $type<'_, $count> {
            const TAG: u64 = tag(PlywaveKind::$kind, $count);
        }
        const _: () = {
            assert!(size_of::<$type<'static, $count>>() <= 8 * PLYWAVE_BSDF_WORDS, "PLYWAVE_BSDF_WORDS is too small");
            assert!(align_of::<$type<'static, $count>>() <= align_of::<PlywaveBsdf>());
        };
    )*};
}

prepared_types!(
    Ply PlyBsdf 1, Ply PlyBsdf 3, Ply PlyBsdf 4,
    Cloth ClothBsdf 1, Cloth ClothBsdf 3, Cloth ClothBsdf 4,
    Fiber FiberBsdf 1, Fiber FiberBsdf 3, Fiber FiberBsdf 4,
);

/// Prepares the memory: writes the result of `make` to it in place.
#[inline(always)]
pub(crate) unsafe fn prepare<T: Prepared>(bsdf: *mut PlywaveBsdf, make: impl FnOnce() -> T) -> Checked {
    pointer(bsdf, "bsdf")?;
    // SAFETY: not null and aligned; the caller guarantees the rest. T fits and is no more aligned than the
    // words, as `prepared_types` asserts. The tag comes last: after a panic the memory is not prepared.
    unsafe {
        (&raw mut (*bsdf).tag).write(0);
        (&raw mut (*bsdf).words).cast::<T>().write(make());
        (&raw mut (*bsdf).tag).write(T::TAG);
    }
    Ok(())
}

/// Marks the memory as not prepared, for a refused query.
pub(crate) unsafe fn unprepare(bsdf: *mut PlywaveBsdf) {
    if pointer(bsdf, "bsdf").is_ok() {
        // SAFETY: not null and aligned; the caller guarantees the rest.
        unsafe { (&raw mut (*bsdf).tag).write(0) };
    }
}

/// Reads the tag in the caller's memory, which may never have been written.
#[inline(always)]
pub(crate) unsafe fn tag_of(bsdf: *const PlywaveBsdf) -> Checked<u64> {
    pointer(bsdf, "bsdf")?;
    // SAFETY: not null and aligned; the caller guarantees the rest. Volatile: the compiler must not reason
    // about memory that C owns.
    Ok(unsafe { (&raw const (*bsdf).tag).read_volatile() })
}

/// The content of a prepared query as `T`.
#[inline(always)]
pub(crate) unsafe fn as_prepared<'a, T: Prepared>(bsdf: *const PlywaveBsdf) -> &'a T {
    // SAFETY: its tag is that of T, so `prepare` wrote a T there.
    unsafe { &*(&raw const (*bsdf).words).cast::<T>() }
}

#[cold]
pub(crate) fn not_prepared() -> Box<crate::status::Failure> {
    failure(
        PlywaveStatus::NotPrepared,
        "bsdf was not prepared: call plywave_ply_at, plywave_cloth_at or plywave_fiber_at first, and look at its status",
    )
}

/// Evaluates an expression on the prepared model of any kind and count.
macro_rules! with_prepared {
    ($bsdf:expr, $at:ident => $body:expr) => {{
        let bsdf: *const PlywaveBsdf = $bsdf;
        // SAFETY: the caller's pointer, checked by `tag_of`.
        match unsafe { tag_of(bsdf) }? {
            <PlyBsdf<'static, 1> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<PlyBsdf<'_, 1>>(bsdf) };
                $body
            }
            <PlyBsdf<'static, 3> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<PlyBsdf<'_, 3>>(bsdf) };
                $body
            }
            <PlyBsdf<'static, 4> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<PlyBsdf<'_, 4>>(bsdf) };
                $body
            }
            <ClothBsdf<'static, 1> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<ClothBsdf<'_, 1>>(bsdf) };
                $body
            }
            <ClothBsdf<'static, 3> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<ClothBsdf<'_, 3>>(bsdf) };
                $body
            }
            <ClothBsdf<'static, 4> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<ClothBsdf<'_, 4>>(bsdf) };
                $body
            }
            <FiberBsdf<'static, 1> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<FiberBsdf<'_, 1>>(bsdf) };
                $body
            }
            <FiberBsdf<'static, 3> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<FiberBsdf<'_, 3>>(bsdf) };
                $body
            }
            <FiberBsdf<'static, 4> as Prepared>::TAG => {
                // SAFETY: the tag is that of this type.
                let $at = unsafe { as_prepared::<FiberBsdf<'_, 4>>(bsdf) };
                $body
            }
            _ => Err(not_prepared()),
        }
    }};
}
pub(crate) use with_prepared;

/// Copies N values to the caller's array, number by number.
#[inline(always)]
unsafe fn put_values<const N: usize>(to: *mut f32, values: [f32; N], name: &str) -> Checked {
    pointer(to, name)?;
    for k in 0..N {
        // SAFETY: not null and aligned; the caller guarantees N numbers.
        unsafe { to.add(k).write(values[k]) };
    }
    Ok(())
}

/// Pads N values with zeros to four.
pub(crate) fn padded<const N: usize>(values: [f32; N]) -> [f32; PLYWAVE_MAX_COUNT] {
    std::array::from_fn(|k| values.get(k).copied().unwrap_or(0.0))
}

/// Copies a sample to the caller's memory, number by number, so that each number passes through memory only
/// once.
#[inline(always)]
pub(crate) unsafe fn put_sample<const N: usize>(to: *mut PlywaveSample, sample: BsdfSample<N>) -> Checked {
    pointer(to, "sample")?;
    let (outcome, w, weight, pdf) = match sample {
        BsdfSample::Scattered(s) => (PlywaveOutcome::Scattered, s.w, s.weight, s.pdf),
        BsdfSample::Straight { weight, probability } => (PlywaveOutcome::Straight, [0.0; 3], weight, probability),
        BsdfSample::Absorbed => (PlywaveOutcome::Absorbed, [0.0; 3], [0.0; N], 0.0),
    };
    // SAFETY: not null and aligned; the caller guarantees the rest.
    unsafe {
        (&raw mut (*to).outcome).write(outcome as i32);
        for k in 0..3 {
            (&raw mut (*to).w[k]).write(w[k]);
        }
        for k in 0..PLYWAVE_MAX_COUNT {
            (&raw mut (*to).weight[k]).write(if k < N { weight[k] } else { 0.0 });
        }
        (&raw mut (*to).pdf).write(pdf);
    }
    Ok(())
}

/// f in direction `w` [1/sr], including the cosine, to the `count` numbers of `f`. Straight light is not
/// included.
///
/// `w`: 3 numbers, a unit vector. On an error nothing is written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_eval(
    bsdf: *const PlywaveBsdf,
    w: *const f32,
    f: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let w = unsafe {
            to_direction(w, "w")?;
            three(w)
        };
        with_prepared!(bsdf, at => {
            // SAFETY: as above.
            unsafe { put_values(f, at.eval(w), "f") }
        })
    })
}

/// Density [1/sr] with which `plywave_bsdf_sample` returns the direction `w`, to the one number of `pdf`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_pdf(
    bsdf: *const PlywaveBsdf,
    w: *const f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        pointers([w, pdf], ["w", "pdf"])?;
        // SAFETY: not null and aligned, as checked; three numbers as documented.
        let w = unsafe { three(w) };
        unit(w, "w")?;
        with_prepared!(bsdf, at => {
            // SAFETY: not null and aligned, as checked.
            unsafe { pdf.write(at.pdf(w)) };
            Ok(())
        })
    })
}

/// `plywave_bsdf_eval` and `plywave_bsdf_pdf` in one call, which share their work.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_eval_pdf(
    bsdf: *const PlywaveBsdf,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // All checks come first: after the evaluation its numbers wait for no branch.
        pointers([w, f, pdf], ["w", "f", "pdf"])?;
        // SAFETY: not null and aligned, as checked; three numbers as documented.
        let w = unsafe { three(w) };
        unit(w, "w")?;
        with_prepared!(bsdf, at => {
            let (value, density) = at.eval_pdf(w);
            // SAFETY: not null and aligned, as checked; as many numbers as documented.
            unsafe {
                for k in 0..value.len() {
                    f.add(k).write(value[k]);
                }
                pdf.write(density);
            }
            Ok(())
        })
    })
}

/// Samples the outcome of a light path from three independent uniform random numbers `u` in [0, 1).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_sample(
    bsdf: *const PlywaveBsdf,
    u: *const f32,
    sample: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let u = unsafe {
            to_random(u)?;
            three(u)
        };
        with_prepared!(bsdf, at => {
            // SAFETY: as above.
            unsafe { put_sample(sample, at.sample(u)) }
        })
    })
}

/// Integral of f over the sphere, to the `count` numbers of `albedo`. For a cloth it takes shadows at their
/// mean over directions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_albedo(
    bsdf: *const PlywaveBsdf,
    albedo: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        with_prepared!(bsdf, at => {
            // SAFETY: the caller's pointer, as documented.
            unsafe { put_values(albedo, at.albedo(), "albedo") }
        })
    })
}

/// Fraction of the light that goes straight on, unscattered, to the `count` numbers of `straight`; 0 for most
/// models.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_straight(
    bsdf: *const PlywaveBsdf,
    straight: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        with_prepared!(bsdf, at => {
            // SAFETY: the caller's pointer, as documented.
            unsafe { put_values(straight, at.straight(), "straight") }
        })
    })
}

/// Chances of the outcomes of `plywave_bsdf_sample`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_outcomes(
    bsdf: *const PlywaveBsdf,
    outcomes: *mut PlywaveOutcomes,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        with_prepared!(bsdf, at => {
            let o = at.outcomes();
            let value = PlywaveOutcomes { absorbed: o.absorbed, scattered: o.scattered, straight: o.straight };
            // SAFETY: the caller's pointer, as documented.
            unsafe { put(outcomes, value, "outcomes") }
        })
    })
}

/// f and pdf in `n` directions at one query: from `w` `[n][3]` to `f` `[n][count]` and `pdf` `[n]`. This is
/// the fastest way to evaluate many directions.
///
/// If a direction is invalid, the status is that of the first such entry, `error` has its index, and nothing
/// is written. `n` = 0 does nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_eval_batch(
    bsdf: *const PlywaveBsdf,
    n: usize,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        with_prepared!(bsdf, at => {
            // SAFETY: the caller's pointers, as documented.
            unsafe { eval_directions(at, n, w, f, pdf) }
        })
    })
}

unsafe fn eval_directions<const N: usize>(
    at: &impl Bsdf<N>,
    n: usize,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
) -> Checked {
    let f = f.cast::<[f32; N]>();
    // SAFETY: the caller's arrays; lengths are checked there.
    let w = unsafe { slice(w.cast::<[f32; 3]>(), n, "w") }?;
    outputs(n, f, pdf, &[span(w.as_ptr(), n)])?;
    // All at once: vector code.
    if !w.iter().fold(true, |all, [x, y, z]| all & is_unit(*x, *y, *z)) {
        return w.iter().enumerate().try_for_each(|(i, w)| unit(*w, "w").at(i));
    }
    // SAFETY: the caller's arrays, which `outputs` found disjoint.
    let (f, pdf) = unsafe { (slice_mut(f, n, "f")?, slice_mut(pdf, n, "pdf")?) };
    at.eval_batch(w, f, pdf);
    Ok(())
}

/// Refuses outputs f and pdf of `n` entries that share memory with each other or with an input.
pub(crate) fn outputs<const N: usize>(n: usize, f: *mut [f32; N], pdf: *mut f32, inputs: &[[usize; 2]]) -> Checked {
    if n == 0 {
        return Ok(());
    }
    pointer(f, "f")?;
    pointer(pdf, "pdf")?;
    disjoint(span(f, n), inputs, "f")?;
    disjoint(span(pdf, n), inputs, "pdf")?;
    disjoint(span(pdf, n), &[span(f, n)], "pdf")
}

/// Samples `n` times at one query: from `u` `[n][3]` to `samples` `[n]`. Errors are as in
/// `plywave_bsdf_eval_batch`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_sample_batch(
    bsdf: *const PlywaveBsdf,
    n: usize,
    u: *const f32,
    samples: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's arrays, as documented; lengths are checked there.
        let u = unsafe { slice(u.cast::<[f32; 3]>(), n, "u") }?;
        if n > 0 {
            disjoint(span(samples, n), &[span(u.as_ptr(), n)], "samples")?;
        }
        if !u.iter().fold(true, |all, [x, y, z]| all & is_uniform(*x, *y, *z)) {
            return u.iter().enumerate().try_for_each(|(i, u)| uniform(*u).at(i));
        }
        // SAFETY: the caller's array, which is disjoint from `u`.
        let samples = unsafe { slice_mut(samples, n, "samples") }?;
        with_prepared!(bsdf, at => {
            samples.iter_mut().zip(u).try_for_each(|(sample, u)| {
                // SAFETY: an entry of the array.
                unsafe { put_sample(sample, at.sample(*u)) }
            })
        })
    })
}

/// Describes a prepared query: its kind, count, and facts about the point.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_bsdf_info(
    bsdf: *const PlywaveBsdf,
    info: *mut PlywaveBsdfInfo,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        with_prepared!(bsdf, at => {
            // SAFETY: the caller's pointer, as documented.
            unsafe { put(info, at.info(), "info") }
        })
    })
}

/// Description of a prepared query, by kind of model.
trait Info {
    fn info(&self) -> PlywaveBsdfInfo;
}

const fn info_of(kind: PlywaveKind, count: usize) -> PlywaveBsdfInfo {
    PlywaveBsdfInfo { kind, count: count as i32, is_double: 0, is_gap: 0, r_d: 0.0, width_um: [0.0; 4] }
}

impl<const N: usize> Info for PlyBsdf<'_, N> {
    fn info(&self) -> PlywaveBsdfInfo {
        PlywaveBsdfInfo { is_double: self.is_double().into(), r_d: self.r_d(), ..info_of(PlywaveKind::Ply, N) }
    }
}

impl<const N: usize> Info for ClothBsdf<'_, N> {
    fn info(&self) -> PlywaveBsdfInfo {
        let (is_double, is_gap) = (self.is_double().into(), self.is_gap().into());
        PlywaveBsdfInfo { is_double, is_gap, ..info_of(PlywaveKind::Cloth, N) }
    }
}

impl<const N: usize> Info for FiberBsdf<'_, N> {
    fn info(&self) -> PlywaveBsdfInfo {
        PlywaveBsdfInfo { width_um: padded(self.width_um()), ..info_of(PlywaveKind::Fiber, N) }
    }
}
