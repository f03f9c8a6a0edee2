//! Energy of clear cloths by the direction of the viewer and by that of the light, and how far light of
//! swapped directions is apart, all averaged over the cell.
//!
//! `cargo run --release -p plywave-studies --bin cloth_energy -- CLOTH.pwc ..`
//!
//! Energies are means over azimuth. Differences of swapped directions are those of f over the cosine at the
//! light, relative to its root mean square: averaged over places, and of the mean over the cell in the file.
//! The variable FULL prints every cosine, with the part of inter-yarn scattering.

use plywave::ClothQuery;
use plywave::Document;
use plywave::bsdf::Bsdf;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Cosines at the viewer or light, each on both sides.
const COSINES: [f32; 6] = [0.95, 0.6, 0.3, 0.15, 0.1, 0.05];
const AZIMUTHS: usize = 16;
/// Places with a direction of the other end each, and places for each pair of swapped directions.
const PLACES: usize = 1 << 15;
const SWAPPED_PLACES: usize = 1 << 12;
const PAIRS: usize = 96;
const CHUNKS: usize = 64;

fn even(k: usize, step: f64) -> f32 {
    (0.5 + k as f64 * step).fract() as f32
}

/// Number of cells along each vector over which places are spread.
const CELLS: f64 = 60.0;

fn direction(z: f32, turn: f32) -> [f32; 3] {
    let (sin, cos) = (TAU * turn).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    [across * cos, across * sin, z]
}

fn query(cloth: &ClothModel, [u, v]: [f32; 2], wo: [f32; 3], footprint_um: f32) -> ClothQuery<'static, 1> {
    let [a, b] = cloth.cell_um();
    // Hairs repeat after several cells.
    let [u, v] = [u, v].map(|part| CELLS * f64::from(part));
    let at = [0, 1].map(|i| (u * a[i] + v * b[i]) as f32);
    ClothQuery { sigma_per_um: [Some([0.0]); 2], footprint_um, ..ClothQuery::new(at, wo, [0.55]) }
}

/// Of a direction: energy by view and by light, and the part of each that is inter-yarn scattering.
type Energies = [f64; 4];

/// `[cosine][side][azimuth]`.
fn energies(cloth: &ClothModel) -> Vec<Energies> {
    let ends: Vec<[f32; 3]> = COSINES
        .iter()
        .flat_map(|z| [*z, -*z])
        .flat_map(|z| (0..AZIMUTHS).map(move |i| direction(z, (i as f32 + 0.37) / AZIMUTHS as f32)))
        .collect();
    let parts: Vec<Vec<Energies>> = (0..CHUNKS)
        .into_par_iter()
        .map(|chunk| {
            let mut sums = vec![[0.0; 4]; ends.len()];
            for k in (chunk..PLACES).step_by(CHUNKS) {
                let place = [even(k, 0.856_674_883_854_502_9), even(k, 0.733_891_856_627_126_9)];
                let z = even(k, 0.628_706_721_042_211_5).sqrt().max(1e-3) * if k % 2 == 0 { 1.0 } else { -1.0 };
                let bsdf = cloth.at(&query(cloth, place, direction(z, even(k, 0.538_597_257_223_612_7)), 0.0));
                for (sums, b) in sums.iter_mut().zip(&ends) {
                    let [direct, inter] = bsdf.parts(*b).map(|f| f64::from(f[0] * TAU / b[2].abs()));
                    sums[1] += (direct + inter) / PLACES as f64;
                    sums[3] += inter / PLACES as f64;
                }
            }
            // Views: samples of f over their density.
            let views = PLACES / 64;
            for k in (chunk..views).step_by(CHUNKS) {
                let place = [even(k, 0.754_877_666_246_692_8), even(k, 0.569_840_290_998_053_3)];
                for (i, (sums, b)) in sums.iter_mut().zip(&ends).enumerate() {
                    let bsdf = cloth.at(&query(cloth, place, *b, 0.0));
                    let straight = f64::from(bsdf.straight()[0]);
                    let (mut view, mut inter) = (0.0, 0.0);
                    for n in 0..8 {
                        let n = 8 * (k * ends.len() + i) + n;
                        let u = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2];
                        if let Some(sample) = bsdf.sample(u.map(|step| even(n, step))).direction() {
                            let weight = f64::from(sample.weight[0]) / 8.0;
                            let [d, i] = bsdf.parts(sample.w).map(|f| f64::from(f[0]));
                            view += weight;
                            inter += weight * i / (d + i).max(1e-20);
                        }
                    }
                    for (sum, e) in sums.iter_mut().zip([view + straight, straight, inter, 0.0]) {
                        *sum += e / views as f64;
                    }
                }
            }
            sums
        })
        .collect();
    let mut all = vec![[0.0; 4]; ends.len()];
    for part in &parts {
        for (all, part) in all.iter_mut().zip(part) {
            (0..4).for_each(|i| all[i] += part[i]);
        }
    }
    all
}

/// How far f over the cosine is apart between swapped directions, over its root mean square; without noise.
fn swapped(cloth: &ClothModel, footprint_um: f32) -> f64 {
    let places = if footprint_um > 0.0 { 2 } else { SWAPPED_PLACES };
    let of_pair = |pair: usize| {
        let end = |of: usize| {
            let z = even(pair, [0.856_674_883_854_502_9, 0.733_891_856_627_126_9][of]).sqrt().max(0.05);
            let up = if (pair >> of).is_multiple_of(2) { z } else { -z };
            direction(up, even(pair, [0.628_706_721_042_211_5, 0.538_597_257_223_612_7][of]))
        };
        let [a, b] = [end(0), end(1)];
        // Means over two sets of places.
        let mut f = [[0.0f64; 2]; 2];
        for k in 0..places {
            let place = [even(k + 77 * pair, 0.754_877_666_246_692_8), even(k + 77 * pair, 0.569_840_290_998_053_3)];
            let of = |a: [f32; 3], b: [f32; 3]| {
                f64::from(cloth.at(&query(cloth, place, a, footprint_um)).eval(b)[0] / b[2].abs()) * 2.0 / places as f64
            };
            f[k % 2][0] += of(a, b);
            f[k % 2][1] += of(b, a);
        }
        let [off, all] = [[1.0, -1.0], [0.5, 0.5]].map(|w| f.map(|f| w[0] * f[0] + w[1] * f[1]));
        [off[0] * off[1], all[0] * all[1]]
    };
    let sums: Vec<[f64; 2]> = (0..PAIRS).into_par_iter().map(of_pair).collect();
    let sum = |i: usize| sums.iter().map(|s| s[i]).sum::<f64>();
    (sum(0).max(0.0) / sum(1)).sqrt()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let is_full = std::env::var("FULL").is_ok();
    println!("cloth: by view least, most; by light least, most; swapped over places, of the mean");
    for file in std::env::args().skip(1) {
        let cloth = ClothModel::from_data(ClothData::load(&file)?, &ClothOptions::RAYS)?;
        let found = energies(&cloth);
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        let mut lines = String::new();
        for (n, of) in found.chunks(AZIMUTHS).enumerate() {
            let mean: Energies = std::array::from_fn(|i| of.iter().map(|e| e[i]).sum::<f64>() / AZIMUTHS as f64);
            let spread = of.iter().map(|e| (e[1] - mean[1]).powi(2)).sum::<f64>() / AZIMUTHS as f64;
            for (ends, mean) in ends.iter_mut().zip(mean) {
                *ends = [ends[0].min(mean), ends[1].max(mean)];
            }
            let z = COSINES[n / 2] * if n % 2 == 0 { 1.0 } else { -1.0 };
            lines += &format!(
                "  {z:5.2}: by view {:.3}, {:.3} between yarns; by light {:.3}, {:.3}; over azimuths {:.3}\n",
                mean[0],
                mean[2],
                mean[1],
                mean[3],
                spread.sqrt()
            );
        }
        let [near, far] = [0.0, 1e9].map(|footprint| {
            let with = ClothOptions { far: footprint > 0.0, ..ClothOptions::RAYS };
            let cloth = ClothData::load(&file).and_then(|data| ClothModel::from_data(data, &with));
            cloth.map_or(f64::NAN, |cloth| swapped(&cloth, footprint))
        });
        println!(
            "{file}: {:.3} {:.3}  {:.3} {:.3}  {near:.3} {far:.3}",
            ends[0][0], ends[0][1], ends[1][0], ends[1][1]
        );
        if is_full {
            print!("{lines}");
        }
    }
    Ok(())
}
