//! plywave for C and C++: models, cloths and fibers as opaque handles, queries prepared in the
//! caller's memory, single calls and batches for 1, 3 or 4 wavelengths.
//!
//! cbindgen makes the header `include/plywave.h` from this crate (`capi/header.sh`); docs/howto/host_c.md is
//! the user guide.
//!
//! - Every function runs in `status::guard`: no panic leaves it, and a function that can fail returns a
//!   `PlywaveStatus`.
//! - There is no global state. Handles are immutable, so threads share them without locks.
//! - The module `pointer` checks the numbers of a call at the boundary, because the library's `eval` and
//!   `sample` return 0 for an invalid direction and a host needs the error.
//! - One set of functions serves every prepared query (`bsdf`): a tag in the caller's memory stores the kind
//!   of model and the number of wavelengths.

mod bsdf;
mod check;
mod cloth;
mod cloth_query;
mod color;
mod fiber;
mod ply;
mod pointer;
mod queries;
#[doc(hidden)]
pub mod status;

pub use bsdf::*;
pub use check::*;
pub use cloth::*;
pub use cloth_query::{PlywaveChannels, PlywaveClothQuery};
pub use color::{PlywaveColorOf, PlywaveColorReach, PlywaveYarnColor, PlywaveYarnColorKind};
pub use fiber::*;
pub use ply::*;
pub use status::{PLYWAVE_MESSAGE_SIZE, PLYWAVE_NO_INDEX, PlywaveError, PlywaveStatus, plywave_status_name};

use std::ffi::c_char;

#[cfg(not(panic = "unwind"))]
compile_error!("plywave-capi turns panics into errors: compile it with panic = \"unwind\"");

/// Version of this header's interface; it increases with every change that would break compiled programs
/// without an error.
pub const PLYWAVE_ABI_VERSION: u32 = 1;

/// `PLYWAVE_ABI_VERSION` of the library at run time: a program compiled with another value must not continue.
#[unsafe(no_mangle)]
pub extern "C" fn plywave_abi_version() -> u32 {
    PLYWAVE_ABI_VERSION
}

/// Version of the library, such as `"0.1.0"`. Never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn plywave_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
