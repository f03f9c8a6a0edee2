//! No panic leaves a function; a failure becomes a status and one line.

use plywave_capi::status::*;
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
    // A static text, a payload without text, and a NULL error.
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
    // A cut inside a character removes one more byte.
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
