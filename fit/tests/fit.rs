//! Fits of planted tables: the density comes back, on the nodes and between them.
//!
//! Truth: lobes that drift smoothly over the incidences, with the noise of a known number of paths.

mod planted;

use planted::Planted;
use plywave_fit::{FitOptions, errors, fit};

fn worst(values: &[f64]) -> f64 {
    values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
}

#[test]
fn planted_lobes_come_back() {
    let plan = Planted::default();
    let table = planted::table(&plan);
    let start = std::time::Instant::now();
    let model = fit(&table, &FitOptions::standard(), &|_| {}).unwrap();
    println!("fit {:.2} s", start.elapsed().as_secs_f64());
    let other = planted::table(&Planted { seed: 2, ..plan });
    let e = errors(&model, &other).unwrap();
    println!("refl {:.3?}\nblock {:.3?}\npaths {:?}", e.refl, e.block, model.path_um);
    assert!(worst(&e.refl) < 0.06, "refl {:?}", e.refl);
    assert!(worst(&e.block) < 0.06, "block {:?}", e.block);
}
