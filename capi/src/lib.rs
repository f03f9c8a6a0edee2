//! plywave for C and C++: models, fabrics and fibers as opaque handles, queries prepared in memory of the
//! caller, single calls and batches for 1, 3 or 4 wavelengths.
//!
//! The header is `include/plywave.h`, made of this crate by cbindgen (`capi/header.sh`); docs/howto/host_c.md
//! is the page for users.
//!
//! - Every function runs in `status::guard`: no panic leaves it, and what can fail returns a `PlywaveStatus`.
//! - Nothing is global. Handles never change once they are made, so that threads share them without locks.
//! - Numbers of a call are checked at the border (`pointer`), since `eval` and `sample` of the library give 0
//!   for what is no direction, and a host wants to know.
//! - There is one set of functions for all that was prepared (`bsdf`): the kind of model and its number of
//!   wavelengths are a tag in the caller's memory.

mod bsdf;
mod check;
mod fabric;
mod fiber;
mod ply;
mod pointer;
mod queries;
mod status;

pub use bsdf::*;
pub use check::*;
pub use fabric::*;
pub use fiber::*;
pub use ply::*;
pub use status::{PLYWAVE_MESSAGE_SIZE, PLYWAVE_NO_INDEX, PlywaveError, PlywaveStatus, plywave_status_name};

use std::ffi::c_char;

#[cfg(not(panic = "unwind"))]
compile_error!("plywave-capi turns panics into errors: compile it with panic = \"unwind\"");

/// Version of what this header declares: it rises with every change that programs compiled before would not
/// notice.
pub const PLYWAVE_ABI_VERSION: u32 = 1;

/// `PLYWAVE_ABI_VERSION` of the library at run time: a program that was compiled with another one must not go
/// on.
#[unsafe(no_mangle)]
pub extern "C" fn plywave_abi_version() -> u32 {
    PLYWAVE_ABI_VERSION
}

/// Version of the library, such as `"0.1.0"`. Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn plywave_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
