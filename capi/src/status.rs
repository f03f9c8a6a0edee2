//! Errors as codes and messages in the caller's memory, and the one way over the border: every function runs
//! inside [`guard`].

use plywave::Error;
use std::any::Any;
use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Status of a call. Every function that can fail returns one; 0 is success.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveStatus {
    /// Done.
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
    /// A file is well formed and holds a value that is not allowed.
    InvalidFile = 8,
    /// A defect of the library, caught at the border. The outputs of the call are undefined; handles stay
    /// usable.
    Panic = 9,
}

/// Bytes of a message, including its final 0.
pub const PLYWAVE_MESSAGE_SIZE: usize = 496;

/// Index of an error that is not about an entry of an array.
pub const PLYWAVE_NO_INDEX: u64 = u64::MAX;

/// An error in the caller's memory: each call takes a pointer to one, or NULL. It is written only if the
/// status is not `PLYWAVE_STATUS_OK`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PlywaveError {
    /// The returned status: a `PlywaveStatus`.
    pub status: i32,
    /// In a batch, the first invalid entry, before which all are done; else `PLYWAVE_NO_INDEX`.
    pub index: u64,
    /// One line in UTF-8 that names file, key or argument, value and what is allowed; 0-terminated.
    pub message: [c_char; PLYWAVE_MESSAGE_SIZE],
}

/// The reason why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    pub status: PlywaveStatus,
    pub index: u64,
    pub message: String,
}

/// A failure is rare and large: it is boxed, so that success costs nothing.
pub(crate) type Checked<T = ()> = Result<T, Box<Failure>>;

/// A failure with this status.
#[cold]
pub(crate) fn failure(status: PlywaveStatus, message: impl Into<String>) -> Box<Failure> {
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

/// Runs the body of a function: no panic leaves it, and a failure is written to the caller's error.
#[inline(always)]
pub(crate) fn guard(error: *mut PlywaveError, body: impl FnOnce() -> Checked) -> PlywaveStatus {
    // A body borrows the caller's memory, read-only models, or memory that is written before it is read:
    // nothing half-done is seen after a panic.
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
        // One line, cut between characters.
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
    fn floor_char_boundary_at(&self, most: usize) -> usize;
}

impl FloorCharBoundary for String {
    fn floor_char_boundary_at(&self, most: usize) -> usize {
        (0..=most.min(self.len())).rev().find(|at| self.is_char_boundary(*at)).unwrap_or(0)
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn empty() -> PlywaveError {
        PlywaveError { status: -1, index: 7, message: [1; PLYWAVE_MESSAGE_SIZE] }
    }

    fn text(error: &PlywaveError) -> String {
        let bytes: Vec<u8> = error.message.iter().map(|c| *c as u8).collect();
        CStr::from_bytes_until_nul(&bytes).expect("an end").to_str().expect("UTF-8").to_string()
    }

    #[test]
    fn a_panic_becomes_a_status() {
        let mut error = empty();
        assert_eq!(guard(&mut error, || panic!("entry {}", 3)), PlywaveStatus::Panic);
        assert_eq!((error.status, error.index), (9, PLYWAVE_NO_INDEX));
        assert_eq!(text(&error), "a defect of plywave, please report it: entry 3");
        // A static text, a payload without text, and no error to write to.
        assert_eq!(guard(&mut error, || panic!("static")), PlywaveStatus::Panic);
        assert!(text(&error).ends_with(": static"));
        assert_eq!(guard(&mut error, || std::panic::panic_any(5)), PlywaveStatus::Panic);
        assert!(text(&error).ends_with(": unknown panic"));
        assert_eq!(guard(std::ptr::null_mut(), || panic!("unheard")), PlywaveStatus::Panic);
    }

    /// A payload that panics again when dropped would end the program.
    #[test]
    fn a_payload_that_panics_when_dropped_is_not_dropped() {
        struct Bomb;
        impl Drop for Bomb {
            fn drop(&mut self) {
                panic!("dropped");
            }
        }
        assert_eq!(guard(std::ptr::null_mut(), || std::panic::panic_any(Bomb)), PlywaveStatus::Panic);
    }

    #[test]
    fn messages_are_one_line_cut_between_characters() {
        let mut error = empty();
        let long = format!("a\nb{}", "\u{e4}".repeat(PLYWAVE_MESSAGE_SIZE));
        let fail = || Err(failure(PlywaveStatus::Format, long.clone()));
        assert_eq!(guard(&mut error, fail), PlywaveStatus::Format);
        let got = text(&error);
        assert!(got.starts_with("a b\u{e4}") && got.len() == PLYWAVE_MESSAGE_SIZE - 1, "{got}");
        // A cut inside a character: one byte less.
        let fail = || Err(failure(PlywaveStatus::Format, &long[1..]));
        assert_eq!(guard(&mut error, fail), PlywaveStatus::Format);
        assert_eq!(text(&error).len(), PLYWAVE_MESSAGE_SIZE - 2);
    }

    #[test]
    fn a_call_that_succeeds_leaves_the_error_alone() {
        let mut error = empty();
        assert_eq!(guard(&mut error, || Ok(())), PlywaveStatus::Ok);
        assert_eq!((error.status, error.index, error.message[3]), (-1, 7, 1));
    }

    #[test]
    fn every_status_has_a_name() {
        for status in 0..10 {
            // SAFETY: the names are static.
            let name = unsafe { CStr::from_ptr(plywave_status_name(status)) };
            assert!(name.to_str().is_ok_and(|n| n.starts_with("PLYWAVE_STATUS_")), "{status}");
        }
        // SAFETY: as above.
        assert_eq!(unsafe { CStr::from_ptr(plywave_status_name(-3)) }, c"unknown status");
    }
}
