//! eval, sample, pdf and albedo allocate nothing, nor does the preparation of a query: an allocator counts.
#![allow(unsafe_code)]

#[path = "it/small_cloth.rs"]
mod small_cloth;

use plywave::cloth::ClothOptions;
use plywave::frame::direction;
use plywave::{Bsdf, ClothQuery, PlyModel, PlyQuery};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// Safety: passes every call on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Number of allocations of this thread by some work.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

/// Asks a BSDF everything, in directions and with numbers that are valid or not.
fn ask<const N: usize>(bsdf: &impl Bsdf<N>) {
    for (k, w) in [[0.0, 0.6, 0.8], [0.6, -0.8, 0.0], [0.0, 0.0, -1.0], [f32::NAN, 0.0, 1.0]].into_iter().enumerate() {
        let u = [0.1 + 0.2 * k as f32, 0.7, 0.3];
        std::hint::black_box((bsdf.eval(w), bsdf.pdf(w), bsdf.eval_pdf(w), bsdf.sample(u), bsdf.albedo()));
    }
    let ws = [[0.0, 0.6, 0.8]; 8];
    for w in ws {
        std::hint::black_box(bsdf.eval(w));
    }
}

#[test]
fn the_allocator_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![1.0f32; 8]))), 1);
    assert_eq!(allocations(|| ()), 0);
}

fn plies<const N: usize>(model: &PlyModel, name: &str) {
    for theta_i in [-1.2, 0.0, 0.4] {
        for h_um in [0.0, 7.0] {
            let query = PlyQuery::new(theta_i, h_um, [0.01; N], [0.5; N]);
            let count = allocations(|| ask(&model.at(&query)));
            assert_eq!(count, 0, "{name}, {N} channels");
        }
    }
}

#[test]
fn queries_of_plies_allocate_nothing() {
    for (name, bytes) in [
        ("polyester", &include_bytes!("../fabrics/models/polyester.pwm")[..]),
        ("gold", include_bytes!("../fabrics/models/gold.pwm")),
    ] {
        let model = PlyModel::from_bytes(bytes, name).unwrap();
        plies::<1>(&model, name);
        plies::<3>(&model, name);
        plies::<8>(&model, name);
        plies::<22>(&model, name);
    }
}

#[test]
fn queries_of_cloths_allocate_nothing() {
    for options in
        [ClothOptions::SMOOTH, ClothOptions { noise: true, far: true, ..ClothOptions::SMOOTH }, ClothOptions::RAYS]
    {
        let cloth = small_cloth::cloth(&small_cloth::RED_BLUE, &options);
        for k in 0..200 {
            let (at, wo) = ([17.3 * k as f32, 29.1 * k as f32], direction(0.3 + 0.01 * k as f32, 1.0));
            let wo = [wo[0], wo[1], if k % 2 == 0 { wo[2] } else { -wo[2] }];
            for footprint_um in [0.0, 300.0, 2000.0] {
                let query = ClothQuery { footprint_um, ..ClothQuery::new(at, wo, [0.45, 0.55, 0.65]) };
                assert_eq!(allocations(|| ask(&cloth.at(&query))), 0, "{k}, footprint {footprint_um}");
                let rgb = ClothQuery { footprint_um, ..ClothQuery::rgb(at, wo) };
                assert_eq!(allocations(|| ask(&cloth.at(&rgb))), 0, "{k}, RGB, footprint {footprint_um}");
            }
        }
    }
}
