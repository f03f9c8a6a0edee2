//! What the C interface refuses: null and misaligned pointers, lengths that no memory has, what is not
//! finite, memory that was never prepared, files that are none. Each is a code and a message, never a crash;
//! and the header and the page say what the code does.

#![allow(clippy::undocumented_unsafe_blocks)] // Of all blocks: pointers are null, misaligned or of impossible lengths, which the library looks at before it reads, or to live memory.

use plywave::Document;
use plywave_capi::*;
use std::ffi::CString;
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");

fn zeroed<T>() -> T {
    // SAFETY: only for the C structs of numbers and pointers, of which all zeros are a value.
    unsafe { MaybeUninit::zeroed().assume_init() }
}

fn message(error: &PlywaveError) -> String {
    error.message.iter().take_while(|c| **c != 0).map(|c| *c as u8 as char).collect()
}

/// A call that must be refused with this status and words in its message; the error comes back.
pub(crate) fn refused(
    status: PlywaveStatus,
    words: &str,
    call: impl Fn(*mut PlywaveError) -> PlywaveStatus,
) -> PlywaveError {
    let mut error = zeroed();
    assert_eq!(call(&mut error), status, "{}", message(&error));
    assert_eq!(error.status, status as i32);
    assert!(message(&error).contains(words), "{:?} has no {words:?}", message(&error));
    // The same without a place for the message, and with one that is misaligned.
    assert_eq!(call(null_mut()), status);
    assert_eq!(call((&raw mut error).wrapping_byte_add(1)), status);
    error
}

use PlywaveStatus::{Format, InvalidArgument as Invalid, Io, Missing, NotPrepared, NullPointer as Null};

fn ply() -> *mut PlywavePly {
    let path = CString::new(format!("{FABRICS}/models/polyester.pwm")).expect("no 0");
    let mut ply = null_mut();
    // SAFETY: live pointers.
    assert_eq!(unsafe { plywave_ply_load(path.as_ptr(), &mut ply, null_mut()) }, PlywaveStatus::Ok);
    ply
}

fn query() -> PlywavePlyQuery {
    PlywavePlyQuery { theta_i: 0.5, h_um: 10.0, count: 3, ..zeroed() }
}

#[test]
fn bad_pointers_and_numbers_of_a_ply() {
    let ply = ply();
    let at = |q: PlywavePlyQuery| move |e| unsafe { plywave_ply_at(ply, &q, &mut zeroed(), e) };
    refused(Null, "ply is NULL", |e| unsafe { plywave_ply_at(null(), &query(), &mut zeroed(), e) });
    refused(Null, "query is NULL", |e| unsafe { plywave_ply_at(ply, null(), &mut zeroed(), e) });
    refused(Null, "bsdf is NULL", |e| unsafe { plywave_ply_at(ply, &query(), null_mut(), e) });
    let askew = (&raw const *Box::new(query())).wrapping_byte_add(1);
    refused(Invalid, "query is not aligned", |e| unsafe { plywave_ply_at(ply, askew, &mut zeroed(), e) });
    for count in [-1, 0, 2, 5, i32::MAX] {
        refused(Invalid, "expected 1, 3 or 4", at(PlywavePlyQuery { count, ..query() }));
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        refused(Invalid, "theta_i", at(PlywavePlyQuery { theta_i: bad, ..query() }));
        refused(Invalid, "h_um", at(PlywavePlyQuery { h_um: bad, ..query() }));
        refused(Invalid, "sigma_per_um", at(PlywavePlyQuery { sigma_per_um: [0.0, 0.0, bad, 0.0], ..query() }));
        refused(Invalid, "lambda_um", at(PlywavePlyQuery { lambda_um: [0.5, bad, 0.5, 0.0], ..query() }));
        let layer = PlywaveLayer { transmitted: [0.1, bad, 0.1, 0.0], ..zeroed() };
        refused(Invalid, "below.transmitted", at(PlywavePlyQuery { below: &layer, ..query() }));
        let q = query();
        refused(Invalid, "width_um", |e| unsafe { plywave_slit_new(ply, bad, 0.25, &mut null_mut(), e) });
        refused(Invalid, "theta_i", |e| unsafe {
            plywave_ply_layer(ply, bad, 3, q.sigma_per_um.as_ptr(), &mut zeroed(), e)
        });
    }
    refused(Invalid, "lambda_um", at(PlywavePlyQuery { count: 1, ..query() }));
    // What is not asked for is not looked at.
    let one = PlywavePlyQuery { count: 1, lambda_um: [0.5, f32::NAN, 0.0, 0.0], ..query() };
    assert_eq!(at(one)(null_mut()), PlywaveStatus::Ok);
    refused(Null, "found is NULL", |e| unsafe { plywave_ply_check(ply, 1, 10, 1, null_mut(), e) });
    refused(Invalid, "incidences", |e| unsafe { plywave_ply_check(ply, 0, 10, 1, &mut zeroed(), e) });
    refused(Invalid, "samples", |e| unsafe { plywave_ply_check(ply, 1, usize::MAX, 1, &mut zeroed(), e) });
    refused(Null, "buffer is NULL", |e| unsafe { plywave_ply_spec(ply, null_mut(), 1 << 20, null_mut(), e) });
    refused(Null, "out is NULL", |e| unsafe { plywave_slit_new(ply, 1.0, 0.25, null_mut(), e) });
    unsafe {
        plywave_ply_free(ply);
        plywave_ply_free(null_mut());
        plywave_cloth_free(null_mut());
        plywave_fiber_free(null_mut());
        plywave_slit_free(null_mut());
    }
}

#[test]
fn bad_directions_and_memory_of_a_prepared_query() {
    let ply = ply();
    let mut bsdf: PlywaveBsdf = zeroed();
    let (w, u) = ([0.0f32, 0.0, 1.0], [0.5f32; 3]);
    let (mut f, mut pdf) = ([7.0f32; 3], 7.0f32);
    // Never prepared, of garbage, and of a query that was refused.
    refused(NotPrepared, "plywave_ply_at", |e| unsafe { plywave_bsdf_eval(&zeroed(), w.as_ptr(), &mut 0.0, e) });
    let garbage = PlywaveBsdf { tag: 0x1234_5678_9abc_def0, words: [u64::MAX; PLYWAVE_BSDF_WORDS] };
    refused(NotPrepared, "prepared", |e| unsafe { plywave_bsdf_sample(&garbage, u.as_ptr(), &mut zeroed(), e) });
    let ok = unsafe { plywave_ply_at(ply, &query(), &mut bsdf, null_mut()) };
    assert_eq!(ok, PlywaveStatus::Ok);
    let again = unsafe { plywave_ply_at(ply, &PlywavePlyQuery { count: 2, ..query() }, &mut bsdf, null_mut()) };
    assert_eq!(again, Invalid);
    refused(NotPrepared, "prepared", |e| unsafe { plywave_bsdf_albedo(&bsdf, &mut 0.0, e) });
    refused(NotPrepared, "prepared", |e| unsafe { plywave_bsdf_check(&bsdf, 0.01, 10, 1, &mut zeroed(), e) });
    refused(NotPrepared, "prepared", |e| unsafe { plywave_bsdf_info(&bsdf, MaybeUninit::uninit().as_mut_ptr(), e) });

    assert_eq!(unsafe { plywave_ply_at(ply, &query(), &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let bsdf = &raw const bsdf;
    let (f_at, pdf_at) = (f.as_mut_ptr(), &raw mut pdf);
    refused(Null, "bsdf is NULL", |e| unsafe { plywave_bsdf_eval(null(), w.as_ptr(), f_at, e) });
    refused(Null, "w is NULL", |e| unsafe { plywave_bsdf_eval(bsdf, null(), f_at, e) });
    refused(Null, "f is NULL", |e| unsafe { plywave_bsdf_eval(bsdf, w.as_ptr(), null_mut(), e) });
    refused(Null, "pdf is NULL", |e| unsafe { plywave_bsdf_pdf(bsdf, w.as_ptr(), null_mut(), e) });
    refused(Null, "pdf is NULL", |e| unsafe { plywave_bsdf_eval_pdf(bsdf, w.as_ptr(), f_at, null_mut(), e) });
    refused(Null, "sample is NULL", |e| unsafe { plywave_bsdf_sample(bsdf, u.as_ptr(), null_mut(), e) });
    refused(Invalid, "w is not aligned", |e| unsafe {
        plywave_bsdf_eval(bsdf, w.as_ptr().wrapping_byte_add(1), f_at, e)
    });
    for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, 3.0, 1e30] {
        for k in 0..3 {
            let (mut w, mut v) = (w, u);
            (w[k], v[k]) = (bad, bad);
            refused(Invalid, "expected a unit vector", |e| unsafe { plywave_bsdf_eval(bsdf, w.as_ptr(), f_at, e) });
            refused(Invalid, "unit vector", |e| unsafe { plywave_bsdf_eval_pdf(bsdf, w.as_ptr(), f_at, pdf_at, e) });
            refused(Invalid, "unit vector", |e| unsafe { plywave_bsdf_pdf(bsdf, w.as_ptr(), pdf_at, e) });
            refused(Invalid, "[0, 1)", |e| unsafe { plywave_bsdf_sample(bsdf, v.as_ptr(), &mut zeroed(), e) });
        }
    }
    let zero = [0.0f32; 3];
    refused(Invalid, "unit vector", |e| unsafe { plywave_bsdf_eval(bsdf, zero.as_ptr(), f_at, e) });
    for sd in [f64::NAN, 0.0, -1.0, 2.0, 1e-9] {
        refused(Invalid, "sd_rad", |e| unsafe { plywave_bsdf_check(bsdf, sd, 10, 1, &mut zeroed(), e) });
    }
    // A call that is refused writes nothing.
    assert_eq!((f, pdf), ([7.0; 3], 7.0));
    // A direction may lie where its f goes.
    let mut shared = w;
    let at = shared.as_mut_ptr();
    assert_eq!(unsafe { plywave_bsdf_eval(bsdf, at, at, null_mut()) }, PlywaveStatus::Ok);
    assert_eq!(unsafe { plywave_bsdf_eval(bsdf, w.as_ptr(), f_at, null_mut()) }, PlywaveStatus::Ok);
    assert_eq!(shared, f);
    unsafe { plywave_ply_free(ply) };
}

#[test]
fn bad_batches() {
    let ply = ply();
    let mut bsdf: PlywaveBsdf = zeroed();
    assert_eq!(unsafe { plywave_ply_at(ply, &query(), &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let bsdf = &raw const bsdf;
    let mut w = vec![[0.0f32, 0.0, 1.0]; 5];
    w[3] = [f32::NAN, 0.0, 1.0];
    w[4] = [0.0, 0.0, 2.0];
    let (mut f, mut pdf) = (vec![[7.0f32; 3]; 5], vec![7.0f32; 5]);
    let (w_at, f_at, pdf_at) = (w.as_ptr().cast::<f32>(), f.as_mut_ptr().cast::<f32>(), pdf.as_mut_ptr());
    let eval = |n, w, f, pdf| move |e| unsafe { plywave_bsdf_eval_batch(bsdf, n, w, f, pdf, e) };
    // Nothing asked, nothing needed.
    assert_eq!(eval(0, null(), null_mut(), null_mut())(null_mut()), PlywaveStatus::Ok);
    let error = refused(Invalid, "entry 3: w", eval(5, w_at, f_at, pdf_at));
    assert_eq!((error.index, f[0], pdf[0]), (3, [7.0; 3], 7.0));
    assert_eq!(eval(3, w_at, f_at, pdf_at)(null_mut()), PlywaveStatus::Ok);
    refused(Null, "w is NULL", eval(5, null(), f_at, pdf_at));
    refused(Null, "f is NULL", eval(5, w_at, null_mut(), pdf_at));
    refused(Null, "pdf is NULL", eval(5, w_at, f_at, null_mut()));
    refused(Invalid, "w is not aligned", eval(5, w_at.wrapping_byte_add(2), f_at, pdf_at));
    for n in [usize::MAX, usize::MAX / 2, usize::MAX / 12, isize::MAX as usize / 12 + 1] {
        refused(Invalid, "fit in memory", eval(n, w_at, f_at, pdf_at));
    }
    refused(Invalid, "f overlaps", eval(3, w_at, w.as_mut_ptr().cast(), pdf_at));
    refused(Invalid, "pdf overlaps", eval(3, w_at, f_at, f_at.wrapping_add(8)));
    refused(Invalid, "pdf overlaps", eval(3, w_at, f_at, w.as_mut_ptr().cast()));

    let mut u = [[0.5f32; 3]; 4];
    u[2] = [0.0, 1.5, 0.0];
    let mut samples = [zeroed::<PlywaveSample>(); 4];
    let (u_at, samples_at) = (u.as_ptr().cast::<f32>(), samples.as_mut_ptr());
    let error = refused(Invalid, "entry 2: u", |e| unsafe { plywave_bsdf_sample_batch(bsdf, 4, u_at, samples_at, e) });
    assert_eq!(error.index, 2);
    refused(Null, "samples is NULL", |e| unsafe { plywave_bsdf_sample_batch(bsdf, 2, u_at, null_mut(), e) });

    // Many queries: those before the bad one are done.
    let mut queries = [query(); 4];
    queries[2].h_um = f32::NAN;
    let (good, q) = ([[0.0f32, 0.0, 1.0]; 4], queries.as_ptr());
    let good = good.as_ptr().cast::<f32>();
    f.fill([7.0; 3]);
    let f_at = f.as_mut_ptr().cast::<f32>();
    let error =
        refused(Invalid, "entry 2: h_um", |e| unsafe { plywave_ply_eval_batch(ply, 4, q, good, f_at, pdf_at, e) });
    assert_eq!(error.index, 2);
    assert!(f[1] != [7.0; 3] && f[2] == [7.0; 3], "{f:?}");
    queries[1].count = 1;
    let q = queries.as_ptr();
    refused(Invalid, "entry 1: count", |e| unsafe { plywave_ply_eval_batch(ply, 4, q, good, f_at, pdf_at, e) });
    refused(Null, "queries is NULL", |e| unsafe { plywave_ply_eval_batch(ply, 4, null(), good, f_at, pdf_at, e) });
    refused(Invalid, "fit in memory", |e| unsafe {
        plywave_ply_sample_batch(ply, usize::MAX / 8, q, u_at, samples_at, e)
    });
    let x = pdf.as_ptr();
    refused(Invalid, "f overlaps", |e| unsafe { plywave_ply_lobes_batch(ply, 4, 3, x, x, w_at, x, x, x, pdf_at, e) });
    refused(Invalid, "1, 3 or 4", |e| unsafe { plywave_ply_lobes_batch(ply, 4, 7, x, x, w_at, x, x, x, f_at, e) });
    unsafe { plywave_ply_free(ply) };
}

#[test]
fn bad_files() {
    let text = |t: &str| CString::new(t).expect("no 0");
    let (missing, broken, name) = (text("none/such.pwm"), b"no model", text("broken"));
    let mut out: *mut PlywavePly = null_mut::<PlywavePly>().wrapping_byte_add(8);
    let out = &raw mut out;
    refused(Io, "none/such.pwm", |e| unsafe { plywave_ply_load(missing.as_ptr(), out, e) });
    assert!(unsafe { *out }.is_null(), "a handle after an error");
    refused(Null, "path is NULL", |e| unsafe { plywave_ply_load(null(), out, e) });
    refused(Null, "out is NULL", |e| unsafe { plywave_ply_load(missing.as_ptr(), null_mut(), e) });
    refused(Invalid, "UTF-8", |e| unsafe { plywave_ply_load(c"\xff\xfe".as_ptr(), out, e) });
    refused(Io, "a/b: ", |e| unsafe { plywave_fiber_load(c"a/b".as_ptr(), &mut null_mut(), e) });
    for bytes in [&broken[..], &[]] {
        refused(Format, "broken: ", |e| unsafe {
            plywave_ply_from_bytes(bytes.as_ptr(), bytes.len(), name.as_ptr(), out, e)
        });
        refused(Format, "broken: ", |e| unsafe {
            plywave_fiber_from_bytes(bytes.as_ptr(), bytes.len(), name.as_ptr(), &mut null_mut(), e)
        });
    }
    refused(Null, "bytes is NULL", |e| unsafe { plywave_ply_from_bytes(null(), 5, name.as_ptr(), out, e) });
    refused(Invalid, "fit in memory", |e| unsafe {
        plywave_ply_from_bytes(broken.as_ptr(), usize::MAX, name.as_ptr(), out, e)
    });
}

#[test]
fn a_model_without_layer_factors_says_so() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics/models/polyester.pwm");
    let model = plywave::PlyModel::load(path).expect("a model that ships");
    let bare = plywave::ply::PlyData { layers: None, ..model.data().clone() }.to_bytes().expect("a valid model");
    let mut ply = null_mut();
    let made = unsafe { plywave_ply_from_bytes(bare.as_ptr(), bare.len(), c"bare".as_ptr(), &mut ply, null_mut()) };
    assert_eq!(made, PlywaveStatus::Ok);
    let sigma = [0.0f32; 3];
    refused(Missing, "no layer factors", |e| unsafe {
        plywave_ply_layer(ply, 0.1, 3, sigma.as_ptr(), &mut zeroed(), e)
    });
    unsafe { plywave_ply_free(ply) };
}

fn sources() -> String {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src");
    let files = std::fs::read_dir(folder).expect("the sources");
    files.map(|f| std::fs::read_to_string(f.expect("an entry").path()).expect("text")).collect()
}

/// `capi/header.sh --check` compares the whole header, where cbindgen can be had; this holds its names.
#[test]
fn every_function_is_guarded_and_declared() {
    let header = include_str!("../../include/plywave.h");
    let sources = sources();
    let functions: Vec<&str> = sources.split("#[unsafe(no_mangle)]\n").skip(1).collect();
    assert!(functions.len() > 40, "{}", functions.len());
    for text in functions {
        let (signature, body) = text.split_once(" {\n").expect("a body");
        let name = signature.split_once("fn ").expect("a function").1.split('(').next().expect("a name");
        assert!(header.contains(&format!("{name}(")), "{name} is not in the header: run capi/header.sh");
        // Names and versions cannot fail.
        if !["plywave_status_name", "plywave_abi_version", "plywave_version"].contains(&name) {
            let body = body.split("\n}\n").next().expect("an end");
            assert!(
                body.trim_start().starts_with("guard(") || body.trim_start().starts_with("let status = guard("),
                "{name}"
            );
        }
    }
    assert!(header.contains(&format!("#define PLYWAVE_ABI_VERSION {PLYWAVE_ABI_VERSION}\n")));
    assert!(header.contains(&format!("#define PLYWAVE_BSDF_WORDS {PLYWAVE_BSDF_WORDS}\n")));
}

/// The lines of C++ on the page are those of the example, which is compiled and run.
#[test]
fn the_page_shows_the_example() {
    let example = include_str!("../../examples/cloth.cpp");
    let material = example.split("// [material]\n").nth(1).and_then(|t| t.split("// [/material]\n").next());
    let material = material.expect("the marks of the material");
    let lines = material.lines().filter(|l| !l.trim().is_empty()).count();
    assert!(lines <= 60, "{lines} lines");
    let page = include_str!("../../../docs/howto/host_c.md");
    assert!(
        page.contains(&format!("```cpp\n{material}```\n")),
        "docs/howto/host_c.md shows another material than capi/examples/cloth.cpp"
    );
}
