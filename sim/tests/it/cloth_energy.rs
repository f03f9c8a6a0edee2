//! The mean of a cloth over its cell makes no light and loses none: integrals of its f over the sphere, at
//! views off the nodes of its tables and to the plane, against 1 for clear fibers and against its own account
//! for others; its halves against samples of the cloth at points.

use crate::cloth_model::{FLANNEL, JERSEY, even};
use plywave::ClothQuery;
use plywave::bsdf::{Bsdf, BsdfSample};
use plywave::cloth::{ClothModel, ClothOptions};
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};
use std::f32::consts::TAU;

/// Absorptions [1/um].
const SIGMAS: [f32; 3] = [0.0, 0.003, 0.02];

fn query(at: [f32; 2], wo: [f32; 3], footprint_um: f32) -> ClothQuery<'static, 3> {
    ClothQuery { sigma_per_um: [Some(SIGMAS); 2], footprint_um, ..ClothQuery::new(at, wo, [0.55; 3]) }
}

/// Integrals over the half of the viewer and over the other, by the middles of parts that are finer towards
/// the plane.
fn integrals(at: &impl Bsdf<3>, side: f32) -> [[f64; 3]; 2] {
    const ROWS: usize = 160;
    const COLUMNS: usize = 180;
    let mut sums = [[0.0; 3]; 2];
    for row in 0..ROWS {
        let t = 2.0 * (row as f64 + 0.5) / ROWS as f64 - 1.0;
        let (z, omega) = (t * t.abs(), 4.0 * t.abs() / ROWS as f64 * f64::from(TAU) / COLUMNS as f64);
        let across = (1.0 - z * z).sqrt();
        for column in 0..COLUMNS {
            let (sin, cos) = (f64::from(TAU) * (column as f64 + 0.5) / COLUMNS as f64).sin_cos();
            let f = at.eval([(across * cos) as f32, (across * sin) as f32, z as f32]);
            let half = usize::from(z * f64::from(side) < 0.0);
            (0..3).for_each(|k| sums[half][k] += omega * f64::from(f[k]));
        }
    }
    sums
}

#[test]
#[ignore = "slow: 28 s: the mean over the cell conserves energy"]
fn the_mean_over_the_cell_conserves_energy() {
    // Light that leaves by hairs is that of the layer's own integrals, which nothing scales.
    for (name, data, off) in [("jersey", &*JERSEY, 2e-3), ("flannel", &*FLANNEL, 5e-3)] {
        let far = ClothModel::from_data(data.clone(), &ClothOptions { far: true, ..ClothOptions::RAYS }).unwrap();
        let points = ClothModel::from_data(data.clone(), &ClothOptions::RAYS).unwrap();
        for (k, z) in [0.99f32, 0.93, 0.8, 0.6, 0.41, 0.26, 0.12, 0.05].into_iter().enumerate() {
            for side in [1.0, -1.0] {
                let (sin, cos) = (TAU * even(k, 0.618_034) + side).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let wo = [across * cos, across * sin, side * z];
                let at = far.at(&query([0.0; 2], wo, f32::MAX));
                let straight = at.straight().map(f64::from);
                let halves = integrals(&at, side);
                let all: [f64; 3] = std::array::from_fn(|k| halves[0][k] + halves[1][k] + straight[k]);
                let told: [f64; 3] = std::array::from_fn(|k| f64::from(at.albedo()[k]) + straight[k]);
                let sampled = sampled(&points, wo, data.curves.cell_um);
                println!(
                    "{name}, cosine {:.2}: {all:.4?}, account {told:.4?}, R {:.4?}, T {:.4?}; points R {:.4?}, T {:.4?}",
                    side * z,
                    halves[0],
                    halves[1],
                    sampled[0],
                    sampled[1]
                );
                assert!((all[0] - 1.0).abs() < off, "{name}, cosine {}: clear fibers send out {}", side * z, all[0]);
                for k in 0..3 {
                    assert!((all[k] - told[k]).abs() < off, "{name}, cosine {}: {all:?}, told {told:?}", side * z);
                    for half in 0..2 {
                        let apart = halves[half][k] - sampled[half][k];
                        let limit = if z > 0.5 { 0.02 } else { 0.03 };
                        assert!(apart.abs() < limit, "{name}, cosine {}: {halves:?}, points {sampled:?}", side * z);
                    }
                }
            }
        }
    }
}

/// Reflected and transmitted light of the cloth at points, mean over the cell and its hairs, without straight
/// light.
fn sampled(cloth: &ClothModel, wo: [f32; 3], cell_um: [[f64; 2]; 2]) -> [[f64; 3]; 2] {
    const PLACES: usize = 1 << 14;
    const DRAWS: usize = 4;
    // Hairs differ from cell to cell.
    const CELLS: f64 = 61.0;
    let mut rng = SmallRng::seed_from_u64(1);
    let mut sums = [[0.0; 3]; 2];
    for k in 0..PLACES {
        let [a, b] = [0.754_877_666, 0.569_840_291].map(|step| CELLS * f64::from(even(k, step)));
        let at = [0, 1].map(|i| (a * cell_um[0][i] + b * cell_um[1][i]) as f32);
        let bsdf = cloth.at(&query(at, wo, 0.0));
        for _ in 0..DRAWS {
            if let BsdfSample::Scattered(s) = bsdf.sample(rng.random()) {
                let half = usize::from(s.w[2] * wo[2] < 0.0);
                (0..3).for_each(|k| sums[half][k] += f64::from(s.weight[k]) / (PLACES * DRAWS) as f64);
            }
        }
    }
    sums
}
