//! Errors as codes and messages in the caller's memory. Every function runs inside [`guard`], which reports
//! failures and catches panics.

use plywave::Error;
use std::any::Any;
use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Status of a call. Every function that can fail returns one; 0 is success.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveStatus {
    /// The call succeeded.
    Ok = 0,
    /// A pointer that must not be null is null.
    NullPointer = 1,
    /// An argument has a value that is not allowed: a number that is not finite or out of range, a direction
    /// that is not a unit vector, a misaligned pointer, overlapping arrays.
    InvalidArgument = 2,
    /// A `PlywaveBsdf` was not prepared, or its preparation failed.
    NotPrepared = 3,
    /// The buffer is too small; the required length was written.
    BufferTooSmall = 4,
    /// The model does not have the requested part, such as layer factors.
    Missing = 5,
    /// A file cannot be read.
    Io = 6,
    /// A file is not of the expected format or version, or is damaged.
    Format = 7,
    /// A well-formed file contains a value that is not allowed.
    InvalidFile = 8,
    /// A defect of the library, caught at the boundary. The outputs of the call are undefined; handles stay
    /// usable.
    Panic = 9,
}

/// Bytes of a message, including its final 0.
pub const PLYWAVE_MESSAGE_SIZE: usize = 496;

/// Index of an error that does not concern an entry of an array.
pub const PLYWAVE_NO_INDEX: u64 = u64::MAX;

/// An error in the caller's memory: each call takes a pointer to one, or NULL. It is written only if the
/// status is not `PLYWAVE_STATUS_OK`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PlywaveError {
    /// The returned status: a `PlywaveStatus`.
    pub status: i32,
    /// Index of the first invalid entry of a batch, before which all entries are processed; else
    /// `PLYWAVE_NO_INDEX`.
    pub index: u64,
    /// One line in UTF-8 that names file, key or argument, value and allowed values; 0-terminated.
    pub message: [c_char; PLYWAVE_MESSAGE_SIZE],
}

/// The reason why a call failed.
#[derive(Debug)]
pub struct Failure {
    pub status: PlywaveStatus,
    pub index: u64,
    pub message: String,
}

/// Result of a checked call. A failure is rare and large; boxing it keeps the success path cheap.
pub type Checked<T = ()> = Result<T, Box<Failure>>;

/// A failure with this status.
#[cold]
pub fn failure(status: PlywaveStatus, message: impl Into<String>) -> Box<Failure> {
    Box::new(Failure { status, index: PLYWAVE_NO_INDEX, message: message.into() })
}

/// A failure for an argument that is not allowed.
#[cold]
pub(crate) fn invalid(name: &str, value: impl std::fmt::Debug, allowed: &str) -> Box<Failure> {
    failure(PlywaveStatus::InvalidArgument, format!("{name} = {value:?}: expected {allowed}"))
}

/// Sets the index of the failed entry of a batch.
pub(crate) trait AtIndex {
    fn at(self, index: usize) -> Self;
}

impl<T> AtIndex for Checked<T> {
    #[inline]
    fn at(self, index: usize) -> Self {
        self.map_err(|mut failure| {
            failure.index = index as u64;
            failure.message = format!("entry {index}: {}", failure.message);
            failure
        })
    }
}

impl From<Error> for Box<Failure> {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Io { .. } => PlywaveStatus::Io,
            Error::Invalid { .. } => PlywaveStatus::InvalidFile,
            Error::Format { .. } => PlywaveStatus::Format,
        };
        failure(status, error.to_string())
    }
}

/// Runs the body of a function: catches panics, and writes a failure to the caller's error.
#[inline(always)]
pub fn guard(error: *mut PlywaveError, body: impl FnOnce() -> Checked) -> PlywaveStatus {
    // A body borrows the caller's memory, immutable models, or memory that is written before it is read, so a
    // panic leaves no partial state that is visible afterwards.
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => PlywaveStatus::Ok,
        Ok(Err(failure)) => report(error, &failure),
        Err(payload) => report_panic(error, payload),
    }
}

#[cold]
#[inline(never)]
fn report_panic(error: *mut PlywaveError, payload: Box<dyn Any + Send>) -> PlywaveStatus {
    let text = payload.downcast_ref::<String>().map(String::as_str).or(payload.downcast_ref::<&str>().copied());
    let message = format!("a defect of plywave, please report it: {}", text.unwrap_or("unknown panic"));
    let status = report(error, &Failure { status: PlywaveStatus::Panic, index: PLYWAVE_NO_INDEX, message });
    // Dropping the payload of a panic may panic again.
    std::mem::forget(payload);
    status
}

#[cold]
#[inline(never)]
fn report(error: *mut PlywaveError, failure: &Failure) -> PlywaveStatus {
    if !error.is_null() && error.is_aligned() {
        let mut message = [0; PLYWAVE_MESSAGE_SIZE];
        // The message is one line, cut between characters.
        let line: String = failure.message.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let end = line.floor_char_boundary_at(PLYWAVE_MESSAGE_SIZE - 1);
        for (to, from) in message.iter_mut().zip(line.as_bytes().iter().take(end)) {
            *to = *from as c_char;
        }
        // SAFETY: the caller gives a PlywaveError or NULL; here it is not null, and aligned.
        unsafe { error.write(PlywaveError { status: failure.status as i32, index: failure.index, message }) };
    }
    failure.status
}

/// `str::floor_char_boundary`, which is newer than this crate's Rust.
trait FloorCharBoundary {
    fn floor_char_boundary_at(&self, max: usize) -> usize;
}

impl FloorCharBoundary for String {
    fn floor_char_boundary_at(&self, max: usize) -> usize {
        (0..=max.min(self.len())).rev().find(|at| self.is_char_boundary(*at)).unwrap_or(0)
    }
}

/// Name of a status as in C, such as `"PLYWAVE_STATUS_NULL_POINTER"`; `"unknown status"` for other numbers.
/// Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn plywave_status_name(status: i32) -> *const c_char {
    let name = match status {
        0 => c"PLYWAVE_STATUS_OK",
        1 => c"PLYWAVE_STATUS_NULL_POINTER",
        2 => c"PLYWAVE_STATUS_INVALID_ARGUMENT",
        3 => c"PLYWAVE_STATUS_NOT_PREPARED",
        4 => c"PLYWAVE_STATUS_BUFFER_TOO_SMALL",
        5 => c"PLYWAVE_STATUS_MISSING",
        6 => c"PLYWAVE_STATUS_IO",
        7 => c"PLYWAVE_STATUS_FORMAT",
        8 => c"PLYWAVE_STATUS_INVALID_FILE",
        9 => c"PLYWAVE_STATUS_PANIC",
        _ => c"unknown status",
    };
    name.as_ptr()
}
