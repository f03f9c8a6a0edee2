//! Time of one call of the special functions [ns], of the crate and of rays.
//!
//! `cargo run --release -p plywave-studies --bin special_speed`

use plywave_wave::C64;
use plywave_wave::special::{Ray, Sequence, cylinder01, hankel01, real01};
use std::hint::black_box;
use std::time::Instant;

/// Least of several timings of `f` over `xs` [ns a call].
fn time(xs: &[f64], mut f: impl FnMut(f64) -> C64) -> f64 {
    (0..7)
        .map(|_| {
            let start = Instant::now();
            let sum: C64 = xs.iter().map(|x| f(black_box(*x))).sum();
            black_box(sum);
            start.elapsed().as_secs_f64() * 1e9 / xs.len() as f64
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    println!("|z| range       k            hankel01  cylinder01  ray hankel01  ray cylinder01  real01   [ns]");
    for (low, high) in [(0.01, 1.0), (1.0, 10.0), (10.0, 60.0), (64.0, 300.0)] {
        let xs: Vec<f64> = (0..20_000).map(|i| low + (high - low) * ((i * 7919) % 20_000) as f64 / 20_000.0).collect();
        for k in [C64::new(1.0, 0.0), C64::new(0.995, 0.1)] {
            let ray = Ray::new(k);
            println!(
                "{low:5}..{high:5}  {k:12}  {:8.0}  {:10.0}  {:12.1}  {:14.1}  {:6.1}",
                time(&xs, |x| hankel01(k * x)[1]),
                time(&xs, |x| cylinder01(k * x).j[0]),
                time(&xs, |x| ray.hankel01(x)[1]),
                time(&xs, |x| ray.cylinder01(x).j[0]),
                time(&xs, |x| real01(x)[0]),
            );
        }
    }
    let ray = time(&[1.0; 50], |x| Ray::new(C64::new(x, 0.2)).hankel01(5.0)[0]);
    println!("a ray's tables: {:.0} us", ray * 1e-3);
    for n in [20, 200, 2000] {
        let z = C64::new(n as f64 * 0.9, 0.0);
        let xs = vec![1.0; 200];
        println!(
            "orders 0..={n}: bessel {:.1}, hankel {:.1} ns an order",
            time(&xs, |x| Sequence::bessel(z * x, n).value(0)) / n as f64,
            time(&xs, |x| Sequence::hankel(z * x, n).value(0)) / n as f64
        );
    }
}
