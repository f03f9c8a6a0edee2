//! The C interface gives the bits of the Rust library: plies and fibers at 1, 3 and 4 wavelengths, single
//! calls and batches. Cloths are in `cloth.rs`, what it refuses is in `errors.rs`.

#![allow(clippy::undocumented_unsafe_blocks)] // Of all blocks: live pointers of the lengths that the calls ask for, but where it is said.

use plywave::Document;
use plywave::ply::{PlyPlace, Queries};
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use plywave_capi::*;
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{FiberSource, FiberTable, FilamentSpec, OutlineSymmetry, TabulatedFiber};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;
use std::ptr::{null, null_mut};

pub(crate) const FABRICS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics");

pub(crate) fn c(text: &str) -> CString {
    CString::new(text).expect("no 0 inside")
}

pub(crate) fn zeroed<T>() -> T {
    // SAFETY: only for the C structs of numbers and pointers, of which all zeros are a value.
    unsafe { MaybeUninit::zeroed().assume_init() }
}

fn message(error: &PlywaveError) -> String {
    error.message.iter().take_while(|c| **c != 0).map(|c| *c as u8 as char).collect()
}

/// A call that must succeed; its error is told.
pub(crate) fn ok(call: impl FnOnce(*mut PlywaveError) -> PlywaveStatus) {
    let mut error = zeroed();
    assert_eq!(call(&mut error), PlywaveStatus::Ok, "{}", message(&error));
}

fn bits<const N: usize>(v: [f32; N]) -> [u32; N] {
    v.map(f32::to_bits)
}

pub(crate) fn direction(rng: &mut Pcg64Mcg) -> [f32; 3] {
    plywave::frame::direction((2.0 * rng.random::<f32>() - 1.0).asin(), std::f32::consts::TAU * rng.random::<f32>())
}

pub(crate) fn four<const N: usize>(v: [f32; N]) -> [f32; 4] {
    std::array::from_fn(|k| v.get(k).copied().unwrap_or(0.0))
}

pub(crate) fn sample_of<const N: usize>(s: BsdfSample<N>) -> PlywaveSample {
    match s {
        BsdfSample::Scattered(s) => PlywaveSample { outcome: 1, w: s.w, weight: four(s.weight), pdf: s.pdf },
        BsdfSample::Straight { weight, probability } => {
            PlywaveSample { outcome: 2, w: [0.0; 3], weight: four(weight), pdf: probability }
        }
        BsdfSample::Absorbed => PlywaveSample { outcome: 0, w: [0.0; 3], weight: [0.0; 4], pdf: 0.0 },
    }
}

/// Everything that a prepared query answers, against Rust's.
pub(crate) fn same<const N: usize>(bsdf: &PlywaveBsdf, at: &impl Bsdf<N>, rng: &mut Pcg64Mcg) {
    let w: Vec<[f32; 3]> = (0..19).map(|_| direction(rng)).collect();
    let u: Vec<[f32; 3]> = (0..19).map(|_| rng.random()).collect();
    let (mut f, mut pdf) = ([f32::NAN; N], f32::NAN);
    for w in &w {
        ok(|e| unsafe { plywave_bsdf_eval(bsdf, w.as_ptr(), f.as_mut_ptr(), e) });
        assert_eq!(bits(f), bits(at.eval(*w)));
        ok(|e| unsafe { plywave_bsdf_pdf(bsdf, w.as_ptr(), &mut pdf, e) });
        assert_eq!(pdf.to_bits(), at.pdf(*w).to_bits());
        ok(|e| unsafe { plywave_bsdf_eval_pdf(bsdf, w.as_ptr(), f.as_mut_ptr(), &mut pdf, e) });
        let (want_f, want_pdf) = at.eval_pdf(*w);
        assert_eq!((bits(f), pdf.to_bits()), (bits(want_f), want_pdf.to_bits()));
    }
    let mut sample: PlywaveSample = zeroed();
    for u in &u {
        ok(|e| unsafe { plywave_bsdf_sample(bsdf, u.as_ptr(), &mut sample, e) });
        assert_eq!(sample, sample_of(at.sample(*u)));
    }
    let (mut got_f, mut got_pdf) = (vec![[f32::NAN; N]; w.len()], vec![f32::NAN; w.len()]);
    let (mut want_f, mut want_pdf) = (got_f.clone(), got_pdf.clone());
    let (w_at, f_at, pdf_at) = (w.as_ptr().cast(), got_f.as_mut_ptr().cast(), got_pdf.as_mut_ptr());
    ok(|e| unsafe { plywave_bsdf_eval_batch(bsdf, w.len(), w_at, f_at, pdf_at, e) });
    at.eval_batch(&w, &mut want_f, &mut want_pdf);
    assert_eq!((got_f, got_pdf), (want_f, want_pdf));
    let mut samples = vec![sample; u.len()];
    ok(|e| unsafe { plywave_bsdf_sample_batch(bsdf, u.len(), u.as_ptr().cast(), samples.as_mut_ptr(), e) });
    assert_eq!(samples, u.iter().map(|u| sample_of(at.sample(*u))).collect::<Vec<_>>());
    ok(|e| unsafe { plywave_bsdf_albedo(bsdf, f.as_mut_ptr(), e) });
    assert_eq!(bits(f), bits(at.albedo()));
    ok(|e| unsafe { plywave_bsdf_straight(bsdf, f.as_mut_ptr(), e) });
    assert_eq!(bits(f), bits(at.straight()));
    let mut outcomes: PlywaveOutcomes = zeroed();
    ok(|e| unsafe { plywave_bsdf_outcomes(bsdf, &mut outcomes, e) });
    let want = at.outcomes();
    assert_eq!(
        (outcomes.scattered, outcomes.straight, outcomes.absorbed),
        (want.scattered, want.straight, want.absorbed)
    );
    let mut info = MaybeUninit::<PlywaveBsdfInfo>::uninit();
    ok(|e| unsafe { plywave_bsdf_info(bsdf, info.as_mut_ptr(), e) });
    // SAFETY: the call that succeeded wrote it.
    assert_eq!(unsafe { info.assume_init() }.count as usize, N);
}

/// A handle, released when it goes out of scope.
pub(crate) struct Handle<T>(pub(crate) *mut T, pub(crate) unsafe extern "C" fn(*mut T));

// SAFETY: the library's handles are shared between threads; this is what is tested.
unsafe impl<T> Sync for Handle<T> {}

impl<T> Drop for Handle<T> {
    fn drop(&mut self) {
        // SAFETY: made by the library and released once.
        unsafe { (self.1)(self.0) };
    }
}

pub(crate) fn load_ply(name: &str) -> Handle<PlywavePly> {
    let mut ply = null_mut();
    let path = c(&format!("{FABRICS}/models/{name}.pwm"));
    // SAFETY: live pointers.
    ok(|e| unsafe { plywave_ply_load(path.as_ptr(), &mut ply, e) });
    Handle(ply, plywave_ply_free)
}

/// All options of a ply query, at N wavelengths.
pub(crate) fn plies<const N: usize>(ply: &Handle<PlywavePly>, model: &PlyModel, rng: &mut Pcg64Mcg) {
    let beam = plywave::spec::YarnSpec::parse(&model.data().spec_text, "spec").expect("a model that ships").beam.beam();
    let slit = plywave::gap::Slit::new(2.0, 0.25, &beam).expect("a valid slit");
    let mut c_slit = null_mut();
    ok(|e| unsafe { plywave_slit_new(ply.0, 2.0, 0.25, &mut c_slit, e) });
    let c_slit = Handle(c_slit, plywave_slit_free);
    let (mut queries, mut answers, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    let n = 48;
    let (w, u): (Vec<[f32; 3]>, Vec<[f32; 3]>) = (0..n).map(|_| (direction(rng), rng.random::<[f32; 3]>())).unzip();
    let places: Vec<PlywavePlace> = (0..n)
        .map(|i| PlywavePlace {
            ply_id: i as u32,
            azimuth: rng.random(),
            along_um: 300.0 * rng.random::<f32>(),
            footprint_um: (i % 3) as f32,
        })
        .collect();
    let mut layers: Vec<PlywaveLayer> = vec![zeroed(); n];
    for i in 0..n {
        let (theta_i, h_um) = (2.8 * (rng.random::<f32>() - 0.5), 160.0 * (rng.random::<f32>() - 0.5));
        let sigma: [f32; N] = std::array::from_fn(|_| 0.02 * rng.random::<f32>());
        let lambda: [f32; N] = std::array::from_fn(|_| 0.4 + 0.3 * rng.random::<f32>());
        // Every mixture of the options.
        let [edge, with_slit, placed, over, relief] = [1, 2, 4, 8, 16].map(|bit| i & bit != 0);
        ok(|e| unsafe { plywave_ply_layer(ply.0, 0.4, N as i32, sigma.as_ptr(), &mut layers[i], e) });
        let below = model.layer(0.4, sigma).expect("a model with layers");
        assert_eq!(layers[i].reflected, four(below.reflected));
        assert_eq!(layers[i].transmitted_diffuse, four(below.transmitted_diffuse));
        let place = &places[i];
        let query = PlyQuery {
            edge,
            slit: with_slit.then_some(&slit),
            place: placed.then_some(PlyPlace {
                ply: place.ply_id,
                azimuth: place.azimuth,
                along_um: place.along_um,
                footprint_um: place.footprint_um,
            }),
            relief,
            speckle: i % 5 != 0,
            below: over.then_some(below),
            ..PlyQuery::new(theta_i, h_um, sigma, lambda)
        };
        let c_query = PlywavePlyQuery {
            theta_i,
            h_um,
            count: N as i32,
            sigma_per_um: four(sigma),
            lambda_um: four(lambda),
            no_edge: i32::from(!edge),
            uncached: 0,
            no_relief: i32::from(!relief),
            no_speckle: i32::from(i % 5 == 0),
            slit: if with_slit { c_slit.0 } else { null() },
            place: if placed { place } else { null() },
            below: if over { &layers[i] } else { null() },
        };
        let mut bsdf: PlywaveBsdf = zeroed();
        ok(|e| unsafe { plywave_ply_at(ply.0, &c_query, &mut bsdf, e) });
        same(&bsdf, &model.at(&query), rng);
        let uncached = PlywavePlyQuery { uncached: 1, ..c_query };
        ok(|e| unsafe { plywave_ply_at(ply.0, &uncached, &mut bsdf, e) });
        // It may be copied.
        let elsewhere = Box::new(bsdf);
        bsdf = zeroed();
        assert_eq!(bsdf.tag, 0);
        let at = model.at(&PlyQuery { cached: false, ..query });
        same(&elsewhere, &at, rng);
        answers.push(at.eval_pdf(w[i]));
        samples.push(sample_of(at.sample(u[i])));
        queries.push(c_query);
    }
    let (mut f, mut pdf) = (vec![[f32::NAN; N]; n], vec![f32::NAN; n]);
    let (w_at, f_at, pdf_at) = (w.as_ptr().cast(), f.as_mut_ptr().cast(), pdf.as_mut_ptr());
    ok(|e| unsafe { plywave_ply_eval_batch(ply.0, n, queries.as_ptr(), w_at, f_at, pdf_at, e) });
    assert_eq!(f.iter().copied().zip(pdf).collect::<Vec<_>>(), answers);
    let mut got: Vec<PlywaveSample> = vec![zeroed(); n];
    ok(|e| unsafe { plywave_ply_sample_batch(ply.0, n, queries.as_ptr(), u.as_ptr().cast(), got.as_mut_ptr(), e) });
    assert_eq!(got, samples);

    let (theta_i, h_um): (Vec<f32>, Vec<f32>) = queries.iter().map(|q| (q.theta_i, q.h_um)).unzip();
    let sigma_per_um: Vec<[f32; N]> = queries.iter().map(|q| std::array::from_fn(|k| q.sigma_per_um[k])).collect();
    let [x, y, z] = [0, 1, 2].map(|k| w.iter().map(|w| w[k]).collect::<Vec<f32>>());
    let arrays = Queries { theta_i: &theta_i, h_um: &h_um, sigma_per_um: &sigma_per_um, wo: [&x, &y, &z] };
    let mut want = vec![[f32::NAN; N]; n];
    model.eval_batch(&arrays, &mut want);
    ok(|e| unsafe {
        let (sigma_at, f_at) = (sigma_per_um.as_ptr().cast(), f.as_mut_ptr().cast());
        let [x, y, z] = [x.as_ptr(), y.as_ptr(), z.as_ptr()];
        plywave_ply_lobes_batch(ply.0, n, N as i32, theta_i.as_ptr(), h_um.as_ptr(), sigma_at, x, y, z, f_at, e)
    });
    assert_eq!(f, want);
}

#[test]
fn plies_give_the_bits_of_rust() {
    // A model with edge lobes, layer factors and speckle.
    let ply = load_ply("silk");
    let model = PlyModel::load(format!("{FABRICS}/models/silk.pwm")).expect("a model that ships");
    assert!(model.has_edge() && model.noise().is_some());
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    plies::<1>(&ply, &model, &mut rng);
    plies::<3>(&ply, &model, &mut rng);
    plies::<4>(&ply, &model, &mut rng);

    let mut info: PlywavePlyInfo = zeroed();
    ok(|e| unsafe { plywave_ply_info(ply.0, &mut info, e) });
    assert_eq!((info.has_edge, info.has_layers, info.has_noise, info.plies), (1, 1, 1, 1));
    assert_eq!(info.h_limit_um, *model.data().h_um.last().expect("nodes"));
    assert_eq!(info.reference_error, f64::from(model.reference_error()));
    let mut length = 0;
    let small = unsafe { plywave_ply_spec(ply.0, null_mut(), 0, &mut length, null_mut()) };
    assert_eq!((small, length), (PlywaveStatus::BufferTooSmall, model.data().spec_text.len()));
    let mut text = vec![1 as c_char; length + 1];
    ok(|e| unsafe { plywave_ply_spec(ply.0, text.as_mut_ptr(), text.len(), null_mut(), e) });
    assert_eq!(text.pop(), Some(0));
    assert!(text.iter().map(|c| *c as u8).eq(model.data().spec_text.bytes()));
}

#[test]
fn a_check_gives_the_numbers_of_the_command() {
    let ply = load_ply("polyester");
    let model = PlyModel::load(format!("{FABRICS}/models/polyester.pwm")).expect("a model that ships");
    let mut found: PlywavePlyReport = zeroed();
    // SAFETY: live pointers.
    ok(|e| unsafe { plywave_ply_check(ply.0, 7, 3000, 1, &mut found, e) });
    let options = plywave_check::CheckOptions { incidences: 7, samples: 3000, ..Default::default() };
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let lobes = plywave_check::check_model(&model, &options, &mut || rng.random());
    let whole = plywave_check::check_whole(&model, &options, &mut || rng.random()).expect("edge lobes");
    let layers = plywave_check::check_layers(&model, &options, &mut || rng.random()).expect("layer factors");
    assert_eq!(found.lobes.chi2_p, lobes.chi2_p());
    assert_eq!(found.lobes.furnace_error, lobes.furnace_error());
    assert_eq!(found.whole.chi2_p, whole.scatter.chi2_p);
    assert_eq!(found.whole.kept_error, whole.kept_error);
    assert_eq!(found.layers.weight_error, layers.scatter.weight_error);
    assert_eq!((found.has_whole, found.has_layers, found.passed), (1, 1, 1), "{found:?}");
}

/// A table of a round fiber, made up.
fn table() -> FiberTable {
    let (l, t, d) = (3, 4, 64);
    let width = 12.0;
    let mut azimuthal = Vec::new();
    for slice in 0..l * t {
        let values: Vec<f64> = (0..d).map(|j| 1.1 + (0.1 * (j + slice) as f64).sin()).collect();
        let sum = values.iter().sum::<f64>() * std::f64::consts::TAU / d as f64;
        azimuthal.extend(values.iter().map(|v| (0.8 * v / sum) as f32));
    }
    FiberTable {
        spec_text: "made up".into(),
        program_version: "0".into(),
        preset: "test".into(),
        seed: 0,
        source: FiberSource::Wave,
        symmetry: OutlineSymmetry::CIRCLE,
        beta_m: 0.15,
        lambda_um: vec![0.45, 0.55, 0.65],
        theta_i: FiberTable::theta_nodes(t),
        phi_i: OutlineSymmetry::CIRCLE.phi_i(1),
        width_um: vec![width],
        c_x_um: (0..l * t).map(|s| width * (1.0 + 0.1 * s as f64)).collect(),
        c_abs_um: (0..l * t).map(|s| 0.2 * width * (1.0 + 0.1 * s as f64)).collect(),
        azimuthal,
    }
}

fn fibers<const N: usize>(fiber: &Handle<PlywaveFiber>, model: &FiberModel, rng: &mut Pcg64Mcg) {
    let n = 20;
    let (w, u): (Vec<[f32; 3]>, Vec<[f32; 3]>) = (0..n).map(|_| (direction(rng), rng.random::<[f32; 3]>())).unzip();
    let mut offsets = vec![None; n];
    let (mut queries, mut answers, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..n {
        let lambda: [f32; N] = std::array::from_fn(|_| 0.4 + 0.3 * rng.random::<f32>());
        let omega_i = direction(rng);
        let sigma_per_um: [f32; N] = std::array::from_fn(|_| 0.01 * rng.random::<f32>());
        let offset = 2.0 * rng.random::<f32>() - 1.0;
        let h_rel = (i % 2 == 0).then_some(offset);
        let query = PlywaveFiberQuery {
            omega_i,
            count: N as i32,
            lambda_um: four(lambda),
            h_rel: h_rel.map_or(null(), |_| &raw const *offsets[i].insert(offset)),
            sigma_per_um: four(sigma_per_um),
        };
        let mut bsdf: PlywaveBsdf = zeroed();
        ok(|e| unsafe { plywave_fiber_at(fiber.0, &query, &mut bsdf, e) });
        let at = model.at(&FiberQuery { omega_i, h_rel, lambda_um: lambda, sigma_per_um });
        same(&bsdf, &at, rng);
        let mut info = MaybeUninit::<PlywaveBsdfInfo>::uninit();
        ok(|e| unsafe { plywave_bsdf_info(&bsdf, info.as_mut_ptr(), e) });
        // SAFETY: the call that succeeded wrote it.
        assert_eq!(unsafe { info.assume_init() }.width_um, four(at.width_um()));
        answers.push(at.eval_pdf(w[i]));
        samples.push(sample_of(at.sample(u[i])));
        queries.push(query);
    }
    let (mut f, mut pdf) = (vec![[f32::NAN; N]; n], vec![f32::NAN; n]);
    let (w_at, f_at, pdf_at) = (w.as_ptr().cast(), f.as_mut_ptr().cast(), pdf.as_mut_ptr());
    ok(|e| unsafe { plywave_fiber_eval_batch(fiber.0, n, queries.as_ptr(), w_at, f_at, pdf_at, e) });
    assert_eq!(f.iter().copied().zip(pdf).collect::<Vec<_>>(), answers);
    let mut got: Vec<PlywaveSample> = vec![zeroed(); n];
    ok(|e| unsafe { plywave_fiber_sample_batch(fiber.0, n, queries.as_ptr(), u.as_ptr().cast(), got.as_mut_ptr(), e) });
    assert_eq!(got, samples);
}

#[test]
fn analytic_fibers_give_the_bits_of_rust() {
    let kinds = ["dielectric", "opaque", "rough_dielectric", "kajiya_kay", "khungurn"];
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    for kind in kinds {
        let head = "name = \"x\"\nlambda_um = [0.6, 0.5, 0.4]\nsigma_per_um = [0.001, 0.002, 0.003]\n";
        let text = format!("{head}[filament]\nkind = \"{kind}\"\nradius_um = 30\n");
        let text = if kind == "opaque" { text + "metal = \"gold\"\n" } else { text };
        let spec = FilamentSpec::parse(&text, "x.toml").expect(kind);
        let (mut fiber, name) = (null_mut(), c("x.toml"));
        ok(|e| unsafe { plywave_fiber_from_bytes(text.as_ptr(), text.len(), name.as_ptr(), &mut fiber, e) });
        let fiber = Handle(fiber, plywave_fiber_free);
        fibers::<1>(&fiber, &spec.model, &mut rng);
        fibers::<3>(&fiber, &spec.model, &mut rng);
        let (mut lambda, mut sigma) = ([0.0_f32; 3], [0.0_f32; 3]);
        ok(|e| unsafe { plywave_fiber_color(fiber.0, lambda.as_mut_ptr(), sigma.as_mut_ptr(), e) });
        assert_eq!((lambda, sigma), (spec.lambda_um, spec.sigma_per_um));

        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.toml");
        std::fs::write(&path, &text).expect("a folder that can be written");
        let mut loaded = null_mut();
        let path = c(path.to_str().expect("UTF-8"));
        ok(|e| unsafe { plywave_fiber_load(path.as_ptr(), &mut loaded, e) });
        fibers::<4>(&Handle(loaded, plywave_fiber_free), &spec.model, &mut rng);
    }
}

#[test]
fn fibers_give_the_bits_of_rust() {
    let bytes = table().to_bytes().expect("a valid table");
    let (mut fiber, name) = (null_mut(), c("made up"));
    ok(|e| unsafe { plywave_fiber_from_bytes(bytes.as_ptr(), bytes.len(), name.as_ptr(), &mut fiber, e) });
    let fiber = Handle(fiber, plywave_fiber_free);
    let model = FiberModel::from(TabulatedFiber::from_bytes(&bytes, "made up").expect("just written"));
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    fibers::<1>(&fiber, &model, &mut rng);
    fibers::<3>(&fiber, &model, &mut rng);
    fibers::<4>(&fiber, &model, &mut rng);
    let mut width = 0.0;
    ok(|e| unsafe { plywave_fiber_max_width(fiber.0, &mut width, e) });
    assert_eq!(width, model.max_width_um());

    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("f.pwf");
    table().save(&path).expect("a valid table");
    let mut loaded = null_mut();
    let path = c(path.to_str().expect("UTF-8"));
    ok(|e| unsafe { plywave_fiber_load(path.as_ptr(), &mut loaded, e) });
    fibers::<3>(&Handle(loaded, plywave_fiber_free), &model, &mut rng);
}
