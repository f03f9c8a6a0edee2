//! Cloths in the C interface: the bits of the Rust library, what there is to know of them, and what is
//! refused.

#![allow(clippy::undocumented_unsafe_blocks)] // Of all blocks: live pointers of the lengths that the calls ask for, or such as are refused before they are read.

use crate::calls::{FABRICS, Handle, Surface, c, load_ply, ok, plies, surface, surfaces, zeroed};
use crate::errors::refused;
use plywave::cloth::{ClothCurves, ClothData, ClothModel, ClothYarn, Lattice, PlyCurve};
use plywave::fabric::{ColorOf, FabricOptions, GapLight, Slits, YarnColor};
use plywave::{Bsdf, FabricQuery, PlyModel};
use plywave_capi::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::ffi::c_char;
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};
use std::sync::{Arc, LazyLock};

/// Radius of the plies, and distance of the yarns [um].
const RADIUS_UM: f64 = 50.0;
const SPACING_UM: f64 = 150.0;

/// Plain weave of polyester plies, or a sheet of one kind of yarn: the weft of it.
fn cloth(kinds: u32) -> ClothData {
    let cell_um = [[2.0 * SPACING_UM, 0.0], [0.0, 2.0 * SPACING_UM]];
    let lattice = Lattice::new(cell_um).expect("a cell");
    let mut curves = ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() };
    for kind in 0..kinds {
        let is_warp = kinds == 2 && kind == 0;
        let (period, step) = if is_warp { ([0, 1], [2, 0]) } else { ([1, 0], [0, 2]) };
        for number in 0..2 {
            let index = curves.yarns.len() as u32;
            curves.yarns.push(ClothYarn { kind, number, step, period });
            let sign = if is_warp == (number == 0) { 1.0 } else { -1.0 };
            let points: Vec<[f64; 3]> = (0..12)
                .map(|i| {
                    let t = f64::from(i) / 12.0;
                    let along = 2.0 * SPACING_UM * t;
                    let across = (f64::from(number) + 0.5) * SPACING_UM;
                    let z = sign * (RADIUS_UM + 2.0) * (std::f64::consts::TAU * (t - 0.25)).cos();
                    if is_warp { [across, along, z] } else { [along, across, z] }
                })
                .collect();
            curves.curves.push(PlyCurve::through(index, RADIUS_UM, period, &points, &lattice));
        }
    }
    let yarn =
        |color: &str| format!("model = \"polyester\"\ncount = {{ tex = 10 }}\ndensity_g_per_cm3 = 1.38\n{color}");
    let (red, blue) = (yarn("srgb = [0.7, 0.1, 0.1]\n"), yarn("srgb = [0.1, 0.2, 0.6]\n"));
    let spec = match kinds {
        1 => format!("name = \"sheet\"\n[curves]\nfile = \"sheet.toml\"\n[yarn]\n{red}"),
        _ => format!(
            "name = \"plain\"\n[weave]\nkind = \"plain\"\n[warp]\n{red}ends_per_cm = 66\n[weft]\n{blue}picks_per_cm = 66\n"
        ),
    };
    let model = Arc::new(PlyModel::load(format!("{FABRICS}/models/polyester.pwm")).expect("a model that ships"));
    let name = if kinds == 1 { "sheet" } else { "plain" };
    ClothData::make(&spec, name, &curves, &vec![model; kinds as usize], kinds == 2, |_| Ok(())).expect("a cloth")
}

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

#[test]
#[ignore = "slow: 10 s: cloths give the bits of Rust in C"]
fn cloths_give_the_bits_of_rust_on_any_number_of_threads() {
    let options = FabricOptions { gaps: GapLight::Straight, noise: true, far: true, ..FabricOptions::default() };
    let rust = ClothModel::from_bytes(&PLAIN, "plain", &options).expect("a cloth");
    let c = load(&PLAIN, &PlywaveClothOptions { noise: 1, straight_gaps: 1, ..zeroed() });
    let gold = PlyModel::load(format!("{FABRICS}/models/gold.pwm")).and_then(|m| m.of_lines()).expect("it ships");
    let (beam, mut lines) = (load_ply("gold"), null_mut());
    ok(|e| unsafe { plywave_ply_of_lines(beam.0, &mut lines, e) });
    let lines = Handle(lines, plywave_ply_free);
    let of = Surface {
        rust: &rust,
        c: &c,
        model: (&gold, &lines),
        size_um: [9000.0; 2],
        footprint_um: 2000.0,
        calls: (plywave_cloth_at, plywave_cloth_eval_batch, plywave_cloth_sample_batch),
    };
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let outcomes = surfaces(&of, &mut rng);
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
    surface::<_, _, 3>(&Surface { rust: &rust, c: &other, ..of }, &mut rng);
    assert_eq!(told(plywave_cloth_name, &other), "plain");

    // The model of a yarn, as a handle of its own.
    let mut ply = null_mut();
    ok(|e| unsafe { plywave_cloth_model(c.0, 1, &mut ply, e) });
    plies::<1>(&Handle(ply, plywave_ply_free), rust.model_of(1).expect("of the weft"), &mut rng);

    // Held to what it promises.
    let query = PlywaveFabricQuery { wo: [0.0, 0.6, 0.8], count: 3, channels: 1, ..zeroed() };
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
    let rust = FabricOptions {
        sigma_per_um: Some(0.002),
        layers: false,
        shadowing: false,
        edges: false,
        slits: Some(Slits { width_um: 0.6, share: 0.3 }),
        ..FabricOptions::default()
    };
    let rust = ClothModel::from_bytes(&SHEET, "sheet", &rust).expect("a cloth");
    assert_eq!((info(&of).kinds, info(&of).has_far, rust.has_far()), (1, 0, false));
    assert_eq!(told(plywave_cloth_notes, &of), "");
    assert!(told(plywave_cloth_notes, &load(&SHEET, null())).contains("footprints count as points"));

    let sigma = [0.05f32; 3];
    for (place, weft) in [([20.0, 75.0], null()), ([20.0, 75.0], sigma.as_ptr()), ([230.0, 240.0], null())] {
        let wo = [0.36, 0.48, 0.8];
        let query =
            PlywaveFabricQuery { position_um: place, wo, count: 3, channels: 1, sigma_weft_per_um: weft, ..zeroed() };
        let (mut bsdf, mut f): (PlywaveBsdf, [f32; 3]) = zeroed();
        ok(|e| unsafe { plywave_cloth_at(of.0, &query, &mut bsdf, e) });
        for w in [[0.0, 0.6, 0.8], [0.6, 0.0, -0.8]] {
            ok(|e| unsafe { plywave_bsdf_eval(&bsdf, w.as_ptr(), f.as_mut_ptr(), e) });
            assert_eq!(f, rust.at(&FabricQuery::rgb(place, wo)).eval(w));
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
    let at = bytes.windows(11).position(|w| w == b"version\\\":1").expect("a version");
    newer[at + 10] = b'9';
    refused(Format, "version", |e| from(&newer, null(), e));
    for sigma_per_um in [f32::NAN, -1.0, f32::INFINITY] {
        let bad = PlywaveClothOptions { has_sigma: 1, sigma_per_um, ..zeroed() };
        refused(Invalid, "sigma_per_um", |e| from(bytes, &bad, e));
    }
    let wide = PlywaveClothOptions { has_slits: 1, slit_width_um: 9.0, slit_share: 0.2, ..zeroed() };
    refused(Invalid, "width_um", |e| from(bytes, &wide, e));
    refused(Null, "bytes is NULL", |e| unsafe {
        plywave_cloth_from_memory(null(), 5, c"bad".as_ptr(), null(), out, e)
    });
    refused(Null, "out is NULL", |e| unsafe {
        plywave_cloth_from_memory(bytes.as_ptr(), bytes.len(), c"bad".as_ptr(), null(), null_mut(), e)
    });

    let of = load(bytes, null());
    let good = PlywaveFabricQuery { wo: [0.0, 0.6, 0.8], count: 3, ..zeroed() };
    let at = |q: PlywaveFabricQuery| move |e| unsafe { plywave_cloth_at(of.0, &q, &mut zeroed(), e) };
    refused(Null, "cloth is NULL", |e| unsafe { plywave_cloth_at(null(), &good, &mut zeroed(), e) });
    refused(Null, "cloth is NULL", |e| unsafe { plywave_cloth_info(null(), MaybeUninit::uninit().as_mut_ptr(), e) });
    refused(Invalid, "wo", at(PlywaveFabricQuery { wo: [0.0; 3], ..good }));
    refused(Invalid, "position_um", at(PlywaveFabricQuery { position_um: [f32::NAN, 0.0], ..good }));
    refused(Invalid, "footprint_um", at(PlywaveFabricQuery { footprint_um: -1.0, ..good }));
    refused(Invalid, "1, 3 or 4", at(PlywaveFabricQuery { count: 2, ..good }));
    let mut bsdf: PlywaveBsdf = zeroed();
    assert_eq!(unsafe { plywave_cloth_at(of.0, &good, &mut bsdf, null_mut()) }, PlywaveStatus::Ok);
    let none = PlywaveFabricQuery { turn_rad: f32::NAN, ..good };
    assert_eq!(unsafe { plywave_cloth_at(of.0, &none, &mut bsdf, null_mut()) }, Invalid);
    refused(NotPrepared, "plywave_cloth_at", |e| unsafe { plywave_bsdf_albedo(&bsdf, &mut 0.0, e) });
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
    unsafe { plywave_cloth_free(null_mut()) };
}
