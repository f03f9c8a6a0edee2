//! A cloth of curves beside its twin of explicit fibers, and the time of its parts.
//!
//! `cargo run --release -p plywave-studies --bin cloth_twin -- CLOTH.toml TWIN.pwx MODEL.pwm ..`
//!
//! A twin that is no file is left out. The variable BESIDE names another twin, of another seed, that the
//! first one is held to.

use plywave::Document;
use plywave::bsdf::Bsdf;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::{ClothQuery, PlyModel};
use plywave_sim::cloth::{Effort, make_cloth, precompute};
use plywave_tables::twin::{ClothTwin, ComparisonOptions, compare};
use plywave_textile::ClothSpec;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let [file, twin, models @ ..] = files.as_slice() else { return Err("CLOTH TWIN MODEL..".into()) };
    let spec = ClothSpec::parse(&std::fs::read_to_string(file)?, file)?;
    let mut read = |name: &str| {
        let hint = "curves and drafts in files are not read here".into();
        Err(plywave::Error::Format { file: name.into(), what: "it is not read".into(), hint })
    };
    let mut begun = Instant::now();
    let mut told = |what: &str| {
        println!("{what}: {:.1} ms", 1e3 * begun.elapsed().as_secs_f64());
        begun = Instant::now();
    };
    let made = make_cloth(&spec, file, &mut read, Effort::Full, &|_| true)?;
    told("curves");
    let models: Vec<Arc<PlyModel>> =
        models.iter().map(|m| Ok(Arc::new(PlyModel::load(m)?))).collect::<plywave::Result<_>>()?;
    let options = ClothOptions { sigma_per_um: Some(0.0), ..ClothOptions::RAYS };
    let text = std::fs::read_to_string(file)?;
    let data = precompute(&spec, &text, &made.curves, &models, Effort::Near, &|_| true)?;
    told("cloth");
    let bytes = data.to_bytes()?;
    told("written");
    let data = ClothData::from_bytes(&bytes, "cloth")?;
    told("read");
    let cloth = ClothModel::from_data(data, &options)?;
    told("ready");
    println!("{} KiB", cloth.memory_bytes() >> 10);
    speed(&cloth);
    told("speed");
    if let Ok(twin) = ClothTwin::load(twin) {
        let places = std::env::var("PLACES").ok().and_then(|p| p.parse().ok()).unwrap_or(2048);
        let options = ComparisonOptions { places, directions: 1 };
        let views = (0..twin.view_count()).into_par_iter().map(|view| compare(&cloth, &twin, view, &options));
        for c in views.collect::<Vec<_>>().concat() {
            let (twin_light, model) = (c.twin, c.model);
            println!(
                "{}: R {:.4} {:.4}  T {:.4} {:.4}  straight {:.4} {:.4}  L2 {:.3} {:.3}",
                named(&twin, c.view, c.sigma),
                twin_light.reflected,
                model.reflected,
                twin_light.transmitted,
                model.transmitted,
                twin_light.straight,
                model.straight,
                c.upper,
                c.lower,
            );
        }
        if let Ok(other) = std::env::var("BESIDE") {
            println!("{other}");
            beside(&twin, &ClothTwin::load(other)?);
        }
    }
    told("twin");
    Ok(())
}

/// A view and an absorption in words.
fn named(twin: &ClothTwin, view: usize, sigma: usize) -> String {
    let [x, y, z] = twin.view(view);
    format!("view {:5.1}:{:4.0} sigma {}", z.acos().to_degrees(), y.atan2(x).to_degrees(), twin.sigma(sigma)[0])
}

/// How far two twins of the same views and absorptions are apart in each half, relative L2, noise removed.
fn beside(a: &ClothTwin, b: &ClothTwin) {
    for (view, sigma) in (0..a.view_count()).flat_map(|v| (0..a.sigma_count()).map(move |s| (v, s))) {
        let ([p, q], face) = ([a, b].map(|t| t.distribution(view, sigma)), a.view(view)[2] > 0.0);
        let mut halves = [[0.0f64; 2]; 2];
        for bin in 0..a.bins.len() {
            let half = &mut halves[usize::from(a.bins.is_up(bin) != face)];
            let [p, v, q, w] = [p.0[bin], p.1[bin], q.0[bin], q.1[bin]].map(f64::from);
            half[0] += (p - q).powi(2) - v - w;
            half[1] += p * p - v;
        }
        let [upper, lower] = halves.map(|[off, all]| (off.max(0.0) / all).sqrt());
        println!("{}: L2 {upper:.3} {lower:.3}", named(a, view, sigma));
    }
}

/// Time of a query's parts [us]: of the place alone, with a sample, with an evaluation beside it.
fn speed(cloth: &ClothModel) {
    const QUERIES: usize = 100_000;
    let mut sum = 0.0;
    let mut timed = |part: usize, flat: bool| {
        let mut best = f64::INFINITY;
        for _ in 0..3 {
            let begun = Instant::now();
            for k in 0..QUERIES {
                let even = |step: f64| (0.5 + k as f64 * step).fract() as f32;
                let at = [9e4 * even(0.754_877_666), 9e4 * even(0.569_840_291)];
                let (sin, cos) = (TAU * even(0.618_034)).sin_cos();
                let z = if flat { 0.9 } else { even(0.414_213_56).sqrt().max(0.05) };
                let across = (1.0 - z * z).sqrt();
                let query = ClothQuery {
                    sigma_per_um: [Some([0.0, 0.003, 0.01, 0.02]); 2],
                    ..ClothQuery::new(at, [across * cos, across * sin, z], [0.45, 0.5, 0.55, 0.6])
                };
                let bsdf = cloth.at(&query);
                sum += bsdf.straight()[0];
                if part > 0 {
                    let sample = bsdf.sample([even(0.31), even(0.47), even(0.83)]);
                    if let Some(s) = sample.direction() {
                        if part > 1 {
                            let (f, pdf) = bsdf.eval_pdf([s.w[1], -s.w[0], s.w[2]]);
                            sum += f[0] + pdf;
                        }
                        sum += s.w[0];
                    }
                }
            }
            best = f64::min(best, begun.elapsed().as_secs_f64() / QUERIES as f64);
        }
        1e6 * best
    };
    for flat in [true, false] {
        let [place, sample, eval] = [0, 1, 2].map(|part| timed(part, flat));
        println!(
            "{}: place {place:.3} us, sample {:.3}, eval and pdf {:.3}; all {eval:.3}",
            if flat { "cosine 0.9" } else { "views by their cosine" },
            sample - place,
            eval - sample
        );
    }
    println!("({sum:.1})");
}
