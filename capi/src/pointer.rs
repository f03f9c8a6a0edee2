//! Checks of pointers and numbers that come in from C, as far as C allows.
//!
//! A null or misaligned pointer, or an impossible length, is an error. The caller guarantees that a pointer
//! refers to live memory of that length that no other thread writes to during the call; this is the safety
//! condition of every `unsafe fn` here.

use crate::status::{Checked, PlywaveStatus, failure, invalid};
use std::ffi::{CStr, c_char};

#[cold]
fn bad_pointer(is_null: bool, name: &str) -> Box<crate::status::Failure> {
    if is_null {
        failure(PlywaveStatus::NullPointer, format!("{name} is NULL"))
    } else {
        failure(PlywaveStatus::InvalidArgument, format!("{name} is not aligned"))
    }
}

/// Refuses null and misaligned pointers.
#[inline(always)]
pub(crate) fn pointer<T>(p: *const T, name: &str) -> Checked {
    if p.is_null() || !p.is_aligned() { Err(bad_pointer(p.is_null(), name)) } else { Ok(()) }
}

/// Refuses null and misaligned pointers to numbers: one test of all, and names only for a failure.
#[inline(always)]
pub(crate) fn pointers<const K: usize>(p: [*const f32; K], names: [&str; K]) -> Checked {
    let (mut bits, mut none_null) = (0, true);
    for p in p {
        bits |= p.addr();
        none_null &= !p.is_null();
    }
    if none_null && bits % align_of::<f32>() == 0 { Ok(()) } else { first_bad(&p, &names) }
}

#[cold]
fn first_bad(p: &[*const f32], names: &[&str]) -> Checked {
    p.iter().zip(names).try_for_each(|(p, name)| pointer(*p, name))
}

/// A reference from a pointer that must not be null.
#[inline(always)]
pub(crate) unsafe fn reference<'a, T>(p: *const T, name: &str) -> Checked<&'a T> {
    pointer(p, name)?;
    // SAFETY: not null and aligned; the caller guarantees the rest.
    Ok(unsafe { &*p })
}

/// A reference from a pointer that may be null.
#[inline(always)]
pub(crate) unsafe fn optional<'a, T>(p: *const T, name: &str) -> Checked<Option<&'a T>> {
    // SAFETY: guaranteed by the caller.
    if p.is_null() { Ok(None) } else { unsafe { reference(p, name) }.map(Some) }
}

#[cold]
fn too_long(len: usize, name: &str) -> Box<crate::status::Failure> {
    invalid(name, len, "a number of entries that fit in memory")
}

/// Refuses a pointer and length that cannot be an array; any pointer passes with length 0.
#[inline(always)]
fn array<T>(p: *const T, len: usize, name: &str) -> Checked {
    if len == 0 {
        return Ok(());
    }
    pointer(p, name)?;
    // An array is at most half of the address space and does not extend past its end.
    let bytes = len.checked_mul(size_of::<T>()).filter(|bytes| *bytes <= isize::MAX as usize);
    if bytes.and_then(|bytes| p.addr().checked_add(bytes)).is_none() { Err(too_long(len, name)) } else { Ok(()) }
}

/// A slice for reading; with length 0, from any pointer.
#[inline(always)]
pub(crate) unsafe fn slice<'a, T>(p: *const T, len: usize, name: &str) -> Checked<&'a [T]> {
    array(p, len, name)?;
    // SAFETY: not null, aligned and of a possible length; the caller guarantees the rest.
    Ok(if len == 0 { &[] } else { unsafe { std::slice::from_raw_parts(p, len) } })
}

/// A slice for writing; with length 0, from any pointer.
#[inline(always)]
pub(crate) unsafe fn slice_mut<'a, T>(p: *mut T, len: usize, name: &str) -> Checked<&'a mut [T]> {
    array(p, len, name)?;
    // SAFETY: as in `slice`; `disjoint` checks that nothing else refers to it.
    Ok(if len == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(p, len) } })
}

/// First address of an array and the address after its end, for [`disjoint`].
#[inline(always)]
pub(crate) fn span<T>(p: *const T, len: usize) -> [usize; 2] {
    let bytes = len.saturating_mul(size_of::<T>());
    [p.addr(), p.addr().saturating_add(bytes)]
}

/// Refuses an output that shares memory with another array.
#[inline(always)]
pub(crate) fn disjoint(output: [usize; 2], others: &[[usize; 2]], name: &str) -> Checked {
    let overlaps = |other: &[usize; 2]| output[0] < other[1] && other[0] < output[1];
    if others.iter().any(overlaps) {
        return Err(failure(PlywaveStatus::InvalidArgument, format!("{name} overlaps another array")));
    }
    Ok(())
}

/// Writes a result to the caller's memory.
#[inline(always)]
pub(crate) unsafe fn put<T>(p: *mut T, value: T, name: &str) -> Checked {
    pointer(p, name)?;
    // SAFETY: not null and aligned; the caller guarantees the rest.
    unsafe { p.write(value) };
    Ok(())
}

/// Reads K numbers from the caller's memory.
#[inline(always)]
pub(crate) unsafe fn numbers<const K: usize>(p: *const f32, name: &str) -> Checked<[f32; K]> {
    pointer(p, name)?;
    // SAFETY: not null and aligned as f32, as arrays of f32 are; the caller guarantees the rest.
    Ok(unsafe { p.cast::<[f32; K]>().read() })
}

/// Reads three numbers, one by one. They do not pass through a `Result`, which the compiler copies through
/// memory in pieces of other sizes at a cost of 10 ns per call.
///
/// # Safety
/// The pointer was checked and points to three numbers.
#[inline(always)]
pub(crate) unsafe fn three(p: *const f32) -> [f32; 3] {
    // SAFETY: as above.
    unsafe { [p.read(), p.add(1).read(), p.add(2).read()] }
}

/// Refuses a pointer whose three numbers are not a unit vector.
#[inline(always)]
pub(crate) unsafe fn to_direction(p: *const f32, name: &str) -> Checked {
    pointer(p, name)?;
    // SAFETY: not null and aligned; the caller guarantees three numbers.
    unit(unsafe { three(p) }, name)
}

/// Refuses a pointer whose three numbers are not uniform random numbers.
#[inline(always)]
pub(crate) unsafe fn to_random(p: *const f32) -> Checked {
    pointer(p, "u")?;
    // SAFETY: not null and aligned; the caller guarantees three numbers.
    uniform(unsafe { three(p) })
}

/// Reads a 0-terminated UTF-8 string.
pub(crate) unsafe fn text<'a>(p: *const c_char, name: &str) -> Checked<&'a str> {
    pointer(p, name)?;
    // SAFETY: not null; the caller guarantees the terminating 0.
    let bytes = unsafe { CStr::from_ptr(p) };
    bytes.to_str().map_err(|_| failure(PlywaveStatus::InvalidArgument, format!("{name} is not text in UTF-8")))
}

/// Copies a text and its final 0 to the caller's buffer, and its length without that 0 to `length`.
pub(crate) unsafe fn put_text(from: &str, buffer: *mut c_char, size: usize, length: *mut usize) -> Checked {
    if !length.is_null() {
        // SAFETY: guaranteed by the caller; `put` checks the rest.
        unsafe { put(length, from.len(), "length") }?;
    }
    if size <= from.len() {
        let message = format!("size = {size}: expected {} or more", from.len() + 1);
        return Err(failure(PlywaveStatus::BufferTooSmall, message));
    }
    // SAFETY: guaranteed by the caller; `slice_mut` checks the rest.
    let to = unsafe { slice_mut(buffer, size, "buffer") }?;
    for (to, from) in to.iter_mut().zip(from.bytes().chain([0])) {
        *to = from as c_char;
    }
    Ok(())
}

/// Refuses an infinite number or NaN.
#[inline(always)]
pub(crate) fn finite(value: f32, name: &str) -> Checked {
    if value.is_finite() { Ok(()) } else { Err(invalid(name, value, "a finite number")) }
}

/// Refuses a number outside [low, high].
#[inline(always)]
pub(crate) fn within(value: f32, low: f32, high: f32, name: &str) -> Checked {
    if value >= low && value <= high { Ok(()) } else { Err(outside(value, low, high, name)) }
}

#[cold]
fn outside(value: f32, low: f32, high: f32, name: &str) -> Box<crate::status::Failure> {
    let allowed = if high == f32::MAX { format!("{low} or more, finite") } else { format!("{low:e} to {high:e}") };
    invalid(name, value, &allowed)
}

/// Refuses infinite numbers and NaN.
#[inline(always)]
pub(crate) fn all_finite<const K: usize>(values: &[f32; K], name: &str) -> Checked {
    // 0 times an infinite number or NaN is NaN.
    let sum = values.iter().fold(0.0, |sum, v| sum + 0.0 * v);
    if sum == 0.0 { Ok(()) } else { Err(invalid(name, values, "finite numbers")) }
}

/// Largest deviation of the squared length of a direction from 1.
const UNIT_TOLERANCE: f32 = 0.01;

/// Whether a vector is a unit vector; false if a component is NaN.
#[inline(always)]
pub(crate) fn is_unit(x: f32, y: f32, z: f32) -> bool {
    (x * x + y * y + z * z - 1.0).abs() <= UNIT_TOLERANCE
}

#[cold]
fn no_direction(x: f32, y: f32, z: f32, name: &str) -> Box<crate::status::Failure> {
    invalid(name, [x, y, z], "a unit vector")
}

/// Refuses a vector that is not a unit vector.
#[inline(always)]
pub(crate) fn unit([x, y, z]: [f32; 3], name: &str) -> Checked {
    if is_unit(x, y, z) { Ok(()) } else { Err(no_direction(x, y, z, name)) }
}

/// Whether three numbers can be uniform random numbers. Rounding may produce 1, which counts as the largest
/// number below it.
#[inline(always)]
pub(crate) fn is_uniform(x: f32, y: f32, z: f32) -> bool {
    let range = 0.0..=1.0;
    range.contains(&x) & range.contains(&y) & range.contains(&z)
}

#[cold]
fn not_uniform(x: f32, y: f32, z: f32) -> Box<crate::status::Failure> {
    invalid("u", [x, y, z], "numbers in [0, 1)")
}

/// Refuses numbers that cannot be uniform random numbers.
#[inline(always)]
pub(crate) fn uniform([x, y, z]: [f32; 3]) -> Checked {
    if is_uniform(x, y, z) { Ok(()) } else { Err(not_uniform(x, y, z)) }
}
