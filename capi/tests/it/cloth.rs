//! Cloths in the C interface: the bits of the Rust library, what there is to know of them, and what is
//! refused.

#![allow(clippy::undocumented_unsafe_blocks)] // Of all blocks: live pointers of the lengths that the calls ask for, or such as are refused before they are read.

use crate::calls::{FABRICS, Handle, c, direction, four, load_ply, ok, plies, same, sample_of, zeroed};
use crate::errors::refused;
use crate::small_cloth::cloth;
use plywave::Document;
use plywave::cloth::{Channels, ClothModel, ClothOptions, ColorOf, GapLight, Slits, YarnColor};
use plywave::{Bsdf, ClothQuery, PlyModel};
use plywave_capi::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};
use std::sync::LazyLock;

static PLAIN: LazyLock<Vec<u8>> = LazyLock::new(|| cloth(2).to_bytes().expect("a valid cloth"));
static SHEET: LazyLock<Vec<u8>> = LazyLock::new(|| cloth(1).to_bytes().expect("a valid cloth"));

fn load(bytes: &[u8], options: *const PlywaveClothOptions) -> Handle<PlywaveCloth> {
    let mut cloth = null_mut();
    ok(|e| unsafe {
        plywave_cloth_from_memory(bytes.as_ptr(), bytes.len(), c"cloth".as_ptr(), options, &mut cloth, e)
    });
    Handle(cloth, plywave_cloth_free)
}

/// A text that a call gives.
fn told(
    call: unsafe extern "C" fn(*const PlywaveCloth, *mut c_char, usize, *mut usize, *mut PlywaveError) -> PlywaveStatus,
    of: &Handle<PlywaveCloth>,
) -> String {
    let (mut text, mut length) = ([1 as c_char; 256], 0);
    ok(|e| unsafe { call(of.0, text.as_mut_ptr(), text.len(), &mut length, e) });
    text[..length].iter().map(|c| *c as u8 as char).collect()
}

fn info(of: &Handle<PlywaveCloth>) -> PlywaveClothInfo {
    let mut info = MaybeUninit::<PlywaveClothInfo>::uninit();
    ok(|e| unsafe { plywave_cloth_info(of.0, info.as_mut_ptr(), e) });
    // SAFETY: the call that succeeded wrote it.
    unsafe { info.assume_init() }
}

/// A cloth in Rust and in C.
struct Both<'a> {
    rust: &'a ClothModel,
    c: &'a Handle<PlywaveCloth>,
    /// In place of the weft's.
    model: (&'a PlyModel, &'a Handle<PlywavePly>),
}

/// Queries are within half of it [um].
const SIZE_UM: f32 = 9000.0;
/// Footprint of a part of them [um].
const FOOTPRINT_UM: f32 = 2000.0;

/// Queries of all options at N wavelengths; `channels` that fit. Gives what became of the samples.
fn queries<const N: usize>(of: &Both<'_>, rng: &mut Pcg64Mcg) -> Vec<i32> {
    let n = 48;
    let (w, u): (Vec<[f32; 3]>, Vec<[f32; 3]>) = (0..n).map(|_| (direction(rng), rng.random::<[f32; 3]>())).unzip();
    let sigmas: Vec<[f32; N]> = (0..2 * n).map(|_| std::array::from_fn(|_| 0.02 * rng.random::<f32>())).collect();
    let (mut queries, mut answers, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..n {
        let position_um = [0; 2].map(|_| SIZE_UM * (rng.random::<f32>() - 0.5));
        let (wo, turn_rad) = (direction(rng), if i % 3 == 0 { 6.0 * rng.random::<f32>() } else { 0.0 });
        let footprint_um = if i % 5 == 0 { FOOTPRINT_UM } else { 0.0 };
        let lambda: [f32; N] = std::array::from_fn(|_| 0.4 + 0.3 * rng.random::<f32>());
        let channels = if N == 3 { i % 3 } else { 0 };
        let [warp, weft, other] = [1, 2, 4].map(|bit| i & bit != 0);
        let query = ClothQuery {
            channels: [Channels::Wavelengths, Channels::LinearSrgb, Channels::LinearRec2020][channels],
            sigma_per_um: [warp.then_some(sigmas[i]), weft.then_some(sigmas[n + i])],
            turn_rad,
            models: [None, other.then_some(of.model.0)],
            footprint_um,
            ..ClothQuery::new(position_um, wo, lambda)
        };
        let c_query = PlywaveClothQuery {
            position_um,
            wo,
            count: N as i32,
            lambda_um: four(lambda),
            channels: channels as i32,
            turn_rad,
            sigma_warp_per_um: if warp { sigmas[i].as_ptr() } else { null() },
            sigma_weft_per_um: if weft { sigmas[n + i].as_ptr() } else { null() },
            models: [null(), if other { of.model.1.0 } else { null() }],
            footprint_um,
        };
        let mut bsdf: PlywaveBsdf = zeroed();
        ok(|e| unsafe { plywave_cloth_at(of.c.0, &c_query, &mut bsdf, e) });
        let at = of.rust.at(&query);
        same(&bsdf, &at, rng);
        answers.push(at.eval_pdf(w[i]));
        samples.push(sample_of(at.sample(u[i])));
        queries.push(c_query);
    }
    let (mut f, mut pdf) = (vec![[f32::NAN; N]; n], vec![f32::NAN; n]);
    let (w_at, f_at, pdf_at) = (w.as_ptr().cast(), f.as_mut_ptr().cast(), pdf.as_mut_ptr());
    ok(|e| unsafe { plywave_cloth_eval_batch(of.c.0, n, queries.as_ptr(), w_at, f_at, pdf_at, e) });
    assert_eq!(f.iter().copied().zip(pdf).collect::<Vec<_>>(), answers);
    let mut got: Vec<PlywaveSample> = vec![zeroed(); n];
    ok(|e| unsafe { plywave_cloth_sample_batch(of.c.0, n, queries.as_ptr(), u.as_ptr().cast(), got.as_mut_ptr(), e) });
    assert_eq!(got, samples);
    got.iter().map(|s| s.outcome).collect()
}

/// At 1, 3 and 4 wavelengths, then one handle on four threads. Gives what became of the samples.
fn all(of: &Both<'_>, rng: &mut Pcg64Mcg) -> Vec<i32> {
    let mut outcomes = queries::<1>(of, rng);
    outcomes.extend(queries::<3>(of, rng));
    outcomes.extend(queries::<4>(of, rng));
    let asked = |seed: u64| drop(queries::<3>(of, &mut Pcg64Mcg::seed_from_u64(seed)));
    std::thread::scope(|scope| (0..4).for_each(|seed| drop(scope.spawn(move || asked(seed)))));
    outcomes
}

#[test]
#[ignore = "slow: 10 s: cloths give the bits of Rust in C"]
fn cloths_give_the_bits_of_rust_on_any_number_of_threads() {
    let slits = Some(Slits { width_um: 0.6, share: 0.25 });
    let options = ClothOptions { gaps: GapLight::Straight, noise: true, far: true, slits, ..ClothOptions::default() };
    let rust = ClothModel::from_bytes(&PLAIN, "plain", &options).expect("a cloth");
    let c_options = PlywaveClothOptions {
        noise: 1,
        straight_gaps: 1,
        has_slits: 1,
        slit_width_um: 0.6,
        slit_share: 0.25,
        ..zeroed()
    };
    let c = load(&PLAIN, &c_options);
    let gold = PlyModel::load(format!("{FABRICS}/models/gold.pwm")).and_then(|m| m.of_lines()).expect("it ships");
    let (beam, mut lines) = (load_ply("gold"), null_mut());
    ok(|e| unsafe { plywave_ply_of_lines(beam.0, &mut lines, e) });
    let lines = Handle(lines, plywave_ply_free);
    let of = Both { rust: &rust, c: &c, model: (&gold, &lines) };
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let outcomes = all(&of, &mut rng);
    assert!(outcomes.contains(&1) && outcomes.contains(&2), "light is scattered and goes straight: {outcomes:?}");

    let about = info(&c);
    assert_eq!((about.cell_um, about.half_thickness_um), (rust.cell_um(), rust.lines().half_thickness_um()));
    assert_eq!((about.kinds, about.has_far, about.color_of), (2, 1, PlywaveColorOf::EvenSky));
    assert_eq!(about.memory_bytes, rust.memory_bytes() as u64);
    assert_eq!((told(plywave_cloth_name, &c), told(plywave_cloth_notes, &c)), ("plain".into(), String::new()));

    // Colors: of the file, of a texture, others, of another meaning.
    let (mut count, mut reach) = (0, [zeroed::<PlywaveColorReach>(); 1]);
    ok(|e| unsafe { plywave_cloth_colors(c.0, reach.as_mut_ptr(), 1, &mut count, e) });
    let want = rust.colors();
    assert_eq!((count, want.len(), reach[0].asked), (2, 2, [0.7, 0.1, 0.1]));
    assert_eq!((reach[0].comes_out, reach[0].delta_e), (want[0].comes_out, want[0].delta_e));
    let mut texture = [0.6, 0.5, 0.1, 0.0, 1.0, 0.33];
    let want: Vec<f32> = texture.iter().flat_map(|r| rust.sigma_of_reflectance([*r])).collect();
    let at = texture.as_mut_ptr();
    ok(|e| unsafe { plywave_cloth_sigma_of_reflectance(c.0, texture.len(), at, at, e) });
    assert_eq!(texture.to_vec(), want);
    let colors = [
        PlywaveYarnColor { kind: 1, srgb: [0.2, 0.3, 0.6], sigma_per_um: 0.0 },
        PlywaveYarnColor { kind: 2, srgb: [0.0; 3], sigma_per_um: 0.003 },
    ];
    let mut other = null_mut();
    ok(|e| unsafe { plywave_cloth_with_colors(c.0, colors.as_ptr(), 2, 0, &mut other, e) });
    let other = Handle(other, plywave_cloth_free);
    let rust = rust.with_colors([YarnColor::Srgb([0.2, 0.3, 0.6]), YarnColor::Sigma(0.003)], ColorOf::EvenSky);
    queries::<3>(&Both { rust: &rust, c: &other, ..of }, &mut rng);
    assert_eq!(told(plywave_cloth_name, &other), "plain");

    // The model of a yarn, as a handle of its own.
    let mut ply = null_mut();
    ok(|e| unsafe { plywave_cloth_model(c.0, 1, &mut ply, e) });
    plies::<1>(&Handle(ply, plywave_ply_free), rust.model_of(1).expect("of the weft"), &mut rng);

    // Held to what it promises.
    let query = PlywaveClothQuery { wo: [0.0, 0.6, 0.8], count: 3, channels: 1, ..zeroed() };
    let (mut bsdf, mut found): (PlywaveBsdf, PlywaveReport) = (zeroed(), zeroed());
    ok(|e| unsafe { plywave_cloth_at(c.0, &query, &mut bsdf, e) });
    ok(|e| unsafe { plywave_bsdf_check(&bsdf, 0.01, 5000, 1, &mut found, e) });
    assert_eq!(found.passed, 1, "{found:?}");
}

/// Options are those of Rust; the second kind of yarn of a cloth with one has no effect.
#[test]
fn options_and_cloths_of_one_kind_of_yarn() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), &*SHEET).expect("written");
    let path = c(file.path().to_str().expect("UTF-8"));
    let options = PlywaveClothOptions {
        no_edges: 1,
        no_layers: 1,
        no_shadowing: 1,
        no_uneven: 1,
        no_relief: 1,
        no_far: 1,
        has_sigma: 1,
        sigma_per_um: 0.002,
        has_slits: 1,
        slit_width_um: 0.6,
        slit_share: 0.3,
        ..zeroed()
    };
    let mut of = null_mut();
    ok(|e| unsafe { plywave_cloth_load(path.as_ptr(), &options, &mut of, e) });
    let of = Handle(of, plywave_cloth_free);
    let rust = ClothOptions {
        sigma_per_um: Some(0.002),
        layers: false,
        shadowing: false,
        edges: false,
        uneven: false,
        relief: false,
        slits: Some(Slits { width_um: 0.6, share: 0.3 }),
        ..ClothOptions::default()
    };
    let rust = ClothModel::from_bytes(&SHEET, "sheet", &rust).expect("a cloth");
    assert_eq!((info(&of).kinds, info(&of).has_far, rust.has_far()), (1, 0, false));
    let polyester = PlyModel::load(format!("{FABRICS}/models/polyester.pwm")).expect("a model that ships");
    let lines = Handle(null_mut(), plywave_ply_free);
    let both = Both { rust: &rust, c: &of, model: (&polyester, &lines) };
    all(&both, &mut Pcg64Mcg::seed_from_u64(5));
    assert_eq!(told(plywave_cloth_notes, &of), "");
    assert!(told(plywave_cloth_notes, &load(&SHEET, null())).contains("footprints count as points"));

    let sigma = [0.05f32; 3];
    for (place, weft) in [([20.0, 75.0], null()), ([20.0, 75.0], sigma.as_ptr()), ([230.0, 240.0], null())] {
        let wo = [0.36, 0.48, 0.8];
        let query =
            PlywaveClothQuery { position_um: place, wo, count: 3, channels: 1, sigma_weft_per_um: weft, ..zeroed() };
        let (mut bsdf, mut f): (PlywaveBsdf, [f32; 3]) = zeroed();
        ok(|e| unsafe { plywave_cloth_at(of.0, &query, &mut bsdf, e) });
        for w in [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8]] {
            ok(|e| unsafe { plywave_bsdf_eval(&bsdf, w.as_ptr(), f.as_mut_ptr(), e) });
            assert_eq!(f, rust.at(&ClothQuery::rgb(place, wo)).eval(w));
        }
    }
    let color = PlywaveYarnColor { kind: 0, ..zeroed() };
    let mut other = null_mut();
    ok(|e| unsafe { plywave_cloth_with_colors(of.0, &color, 1, 0, &mut other, e) });
    drop(Handle(other, plywave_cloth_free));
    for n in [0, 2, usize::MAX / 1024] {
        refused(PlywaveStatus::InvalidArgument, "one color for each kind", |e| unsafe {
            plywave_cloth_with_colors(of.0, &[color; 2][0], n, 0, &mut null_mut(), e)
        });
    }
    for kind in [-1, 1, i32::MAX] {
        refused(PlywaveStatus::InvalidArgument, "kind", |e| unsafe {
            plywave_cloth_model(of.0, kind, &mut null_mut(), e)
        });
    }
}

/// Files of another kind, damaged ones, another version, bad options and queries: a code and a line each.
#[test]
fn bad_cloths_and_queries() {
    use PlywaveStatus::{Format, InvalidArgument as Invalid, Io, NotPrepared, NullPointer as Null};
    let mut out: *mut PlywaveCloth = null_mut::<PlywaveCloth>().wrapping_byte_add(8);
    let out = &raw mut out;
    let load_file = |path: &str, e| {
        let path = c(path);
        unsafe { plywave_cloth_load(path.as_ptr(), null(), out, e) }
    };
    let from = |bytes: &[u8], options: *const PlywaveClothOptions, e| unsafe {
        plywave_cloth_from_memory(bytes.as_ptr(), bytes.len(), c"bad".as_ptr(), options, out, e)
    };
    refused(Io, "none/such.pwc", |e| load_file("none/such.pwc", e));
    assert!(unsafe { *out }.is_null(), "a handle after an error");
    refused(Format, "polyester.pwm", |e| load_file(&format!("{FABRICS}/models/polyester.pwm"), e));
    refused(Format, "jersey.toml", |e| load_file(&format!("{FABRICS}/cloths/jersey.toml"), e));
    let bytes = &*SHEET;
    for cut in [0, 7, 100, 5000, bytes.len() - 1] {
        refused(Format, "bad: ", |e| from(&bytes[..cut], null(), e));
    }
    let mut newer = bytes.clone();
    let at = bytes.windows(10).position(|w| w == b"version\\\":").expect("a version");
    newer[at + 10] = b'9';
    refused(Format, "version", |e| from(&newer, null(), e));
    for sigma_per_um in [f32::NAN, -1.0, f32::INFINITY] {
        let bad = PlywaveClothOptions { has_sigma: 1, sigma_per_um, ..zeroed() };
        refused(Invalid, "sigma_per_um", |e| from(bytes, &bad, e));
    }
    for (slit_width_um, slit_share, words) in [(9.0, 0.2, "slit_width_um"), (1.0, f32::NAN, "slit_share")] {
        let bad = PlywaveClothOptions { has_slits: 1, slit_width_um, slit_share, ..zeroed() };
        refused(Invalid, words, |e| from(bytes, &bad, e));
    }
    refused(Null, "bytes is NULL", |e| unsafe {
        plywave_cloth_from_memory(null(), 5, c"bad".as_ptr(), null(), out, e)
    });
    refused(Null, "out is NULL", |e| unsafe {
        plywave_cloth_from_memory(bytes.as_ptr(), bytes.len(), c"bad".as_ptr(), null(), null_mut(), e)
    });

    let of = load(bytes, null());
    let good = PlywaveClothQuery { wo: [0.0, 0.6, 0.8], count: 3, ..zeroed() };
    let at = |q: PlywaveClothQuery| move |e| unsafe { plywave_cloth_at(of.0, &q, &mut zeroed(), e) };
    refused(Null, "cloth is NULL", |e| unsafe { plywave_cloth_at(null(), &good, &mut zeroed(), e) });
    refused(Null, "cloth is NULL", |e| unsafe { plywave_cloth_info(null(), MaybeUninit::uninit().as_mut_ptr(), e) });
    refused(Invalid, "wo", at(PlywaveClothQuery { wo: [0.0; 3], ..good }));
    refused(Invalid, "position_um", at(PlywaveClothQuery { position_um: [f32::NAN, 0.0], ..good }));
    refused(Invalid, "position_um", at(PlywaveClothQuery { position_um: [0.0, f32::INFINITY], ..good }));
    for far in [1e30, -1e30, 1.1e10] {
        refused(Invalid, "position_um", at(PlywaveClothQuery { position_um: [far, 0.0], ..good }));
        refused(Invalid, "turn_rad", at(PlywaveClothQuery { turn_rad: far, ..good }));
    }
    for bad in [f32::NAN, -5.0, -1e-6, f32::INFINITY] {
        refused(Invalid, "footprint_um", at(PlywaveClothQuery { footprint_um: bad, ..good }));
    }
    refused(Invalid, "1, 3 or 4", at(PlywaveClothQuery { count: 2, ..good }));
    refused(Invalid, "channels", at(PlywaveClothQuery { channels: 3, ..good }));
    refused(Invalid, "3 channels", at(PlywaveClothQuery { channels: 1, count: 4, lambda_um: [0.5; 4], ..good }));
    let nan = [f32::NAN; 3];
    refused(Invalid, "sigma_weft_per_um", at(PlywaveClothQuery { sigma_weft_per_um: nan.as_ptr(), ..good }));
    let farthest = PlywaveClothQuery { position_um: [1e10, -1e10], turn_rad: -1e6, ..good };
    assert_eq!(at(farthest)(null_mut()), PlywaveStatus::Ok);
    // What was prepared is not any more after a query that is refused, and a call on it writes nothing.
    let mut bsdf: PlywaveBsdf = zeroed();
    assert_eq!(unsafe { plywave_cloth_at(of.0, &good, &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let none = PlywaveClothQuery { turn_rad: f32::NAN, ..good };
    assert_eq!(unsafe { plywave_cloth_at(of.0, &none, &mut bsdf, null_mut()) }, Invalid);
    let mut albedo = [7.0f32; 3];
    let albedo_at = albedo.as_mut_ptr();
    refused(NotPrepared, "plywave_cloth_at", |e| unsafe { plywave_bsdf_albedo(&bsdf, albedo_at, e) });
    assert_eq!(albedo, [7.0; 3]);
    let (queries, w, mut f, mut pdf) = ([good, none], [[0.0f32, 0.0, 1.0]; 2], [[7.0f32; 3]; 2], [7.0f32; 2]);
    let (f_at, pdf_at) = (f.as_mut_ptr().cast(), pdf.as_mut_ptr());
    let error = refused(Invalid, "entry 1: turn_rad", |e| unsafe {
        plywave_cloth_eval_batch(of.0, 2, queries.as_ptr(), w.as_ptr().cast(), f_at, pdf_at, e)
    });
    assert_eq!((error.index, f[1], pdf[1]), (1, [7.0; 3], 7.0));
    let reflectance = [0.5, 1.5];
    let error = refused(Invalid, "entry 1: reflectance", |e| unsafe {
        plywave_cloth_sigma_of_reflectance(of.0, 2, reflectance.as_ptr(), pdf_at, e)
    });
    assert_eq!((error.index, pdf[1]), (1, 7.0));
    let color = |kind, srgb| PlywaveYarnColor { kind, srgb, sigma_per_um: -1.0 };
    let recolor = |a: PlywaveYarnColor, color_of| {
        move |e| unsafe { plywave_cloth_with_colors(of.0, &a, 1, color_of, &mut null_mut(), e) }
    };
    refused(Invalid, "srgb", recolor(color(1, nan), 0));
    refused(Invalid, "kind", recolor(color(5, [0.5; 3]), 0));
    refused(Invalid, "sigma_per_um", recolor(color(2, [0.5; 3]), 0));
    refused(Invalid, "color_of", recolor(color(1, [0.5; 3]), -1));
    unsafe { plywave_cloth_free(null_mut()) };
}
