//! Tables from known lobes that drift smoothly over (theta_i, h), with Poisson noise of a known number of
//! paths.
#![allow(dead_code)]

use plywave::ply::asg::Lobe;
use plywave_fit::{PaddedSlice, Scratch, SphereGrid};
use plywave_tables::table::{OutgoingGrid, Table};
use rand::{Rng, RngExt, SeedableRng};
use std::f64::consts::PI;

/// Plan of a planted table: its lobes and axes.
#[derive(Clone, Debug)]
pub struct Planted {
    pub rows: usize,
    pub columns: usize,
    pub grid: OutgoingGrid,
    pub sigma_per_um: Vec<f64>,
    /// Paths per incidence; infinite for no noise.
    pub paths: f64,
    pub seed: u64,
    /// Turn of all lobes, as that of lobes of another twist.
    pub turn: f64,
}

impl Default for Planted {
    fn default() -> Self {
        Planted {
            rows: 5,
            columns: 5,
            grid: OutgoingGrid { theta_o: 45, phi_o: 90 },
            sigma_per_um: vec![0.0, 0.001, 0.003, 0.01, 0.03, 0.1],
            paths: 2e6,
            seed: 1,
            turn: 0.0,
        }
    }
}

/// Half range of h [um].
pub const H_MAX: f64 = 60.0;

fn lobe(theta_z: f64, phi_z: f64, phi_xy: f64, mu1: f64, mu2: f64, energy: f64) -> Lobe {
    Lobe { theta_z, phi_z, phi_xy, ln_mu1: mu1.ln(), ln_mu2: mu2.ln(), energy }
}

/// Reflection lobes: two that together wrap the ply, tilted with the incidence and turned with the offset.
pub fn refl_lobes(theta_i: f64, h: f64) -> Vec<Lobe> {
    let hr = h / H_MAX;
    let lit = (-1.5 * hr * hr).exp();
    let turn = 0.9 * hr;
    vec![
        lobe(-theta_i + 0.1, 0.5 * PI - 0.9 - turn, 0.3 * hr, 1.2 + 0.5 * hr, 5.0 + 8.0 * theta_i, 0.2 * lit),
        lobe(
            -theta_i - 0.1,
            0.5 * PI + 0.9 - turn,
            -0.3 * hr,
            1.4 - 0.5 * hr,
            7.0 + 6.0 * theta_i,
            (0.2 + 0.05 * hr) * lit,
        ),
    ]
}

/// High-order lobes and the mean path length [um] of each.
pub fn high_lobes(theta_i: f64, h: f64) -> Vec<(Lobe, f64)> {
    let hr = h / H_MAX;
    let lit = (-1.2 * hr * hr).exp();
    let t = theta_i;
    let bend = 0.5 * hr + 0.15 * hr.powi(3);
    [
        (lobe(-t, 1.5 * PI + bend, 0.2 * hr, 8.0, 60.0 - 20.0 * t, 0.12), 14.0),
        (lobe(-t + 0.1 * hr, 1.5 * PI - 0.7 + 0.6 * bend, 0.1, 5.0, 25.0, 0.08), 25.0),
        (lobe(-t - 0.1 * hr, 1.5 * PI + 0.7 + 0.8 * bend, -0.1, 6.0, 30.0, 0.09), 28.0),
        (lobe(-0.9 * t, 1.5 * PI - 1.5 + 0.5 * bend, 0.3, 3.0, 9.0, 0.05), 45.0),
        (lobe(-0.9 * t, 1.5 * PI + 1.5 + 0.5 * bend, -0.4, 2.5, 8.0, 0.06), 40.0),
        (lobe(-0.8 * t + 0.1, 0.5 * PI - 0.5 * hr, 0.2, 1.5, 4.0, 0.10), 60.0),
        (lobe(-0.3 * t, 1.5 * PI + 0.2 * bend, 0.0, 0.6, 1.2, 0.06), 110.0),
        (lobe(0.2 * t, 0.6 * PI, 0.5, 0.4, 0.8, 0.04), 150.0),
    ]
    .into_iter()
    .map(|(mut l, path)| {
        l.energy *= lit * (1.0 - 0.3 * t / PI);
        (l, path)
    })
    .collect()
}

/// Laplace transform of a gamma distribution of path lengths of shape 2.
pub fn attenuation(sigma: f64, mean_um: f64) -> f64 {
    (1.0 + 0.5 * sigma * mean_um).powi(-2)
}

/// High-order lobes at an absorption.
pub fn high_at(theta_i: f64, h: f64, sigma: f64) -> Vec<Lobe> {
    high_lobes(theta_i, h)
        .into_iter()
        .map(|(mut l, path)| {
            l.energy *= attenuation(sigma, path);
            l
        })
        .collect()
}

/// Lobes turned about the ply, out of its cross section and about their own axes, and made narrower.
pub fn turned(lobes: Vec<Lobe>, turn: f64) -> Vec<Lobe> {
    let one = |l: Lobe| Lobe {
        theta_z: l.theta_z + 0.3 * turn,
        phi_z: l.phi_z + 0.6 * turn,
        phi_xy: l.phi_xy + 0.8 * turn,
        ln_mu1: l.ln_mu1 + 0.4 * turn,
        ..l
    };
    lobes.into_iter().map(one).collect()
}

/// Density of lobes at the bin centers.
pub fn density(sphere: &SphereGrid, lobes: &[Lobe]) -> PaddedSlice {
    let params: Vec<f64> = lobes.iter().flat_map(|l| l.to_params()).collect();
    sphere.mixture(&params, 1.0, &mut Scratch::default())
}

/// Poisson number of mean `mean`: by products below 30, by a rounded normal above.
fn poisson(mean: f64, rng: &mut impl Rng) -> f64 {
    if mean < 30.0 {
        let limit = (-mean).exp();
        let mut product: f64 = rng.random();
        let mut k = 0.0;
        while product > limit {
            product *= rng.random::<f64>();
            k += 1.0;
        }
        return k;
    }
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (2.0 * PI * b).cos();
    (mean + mean.sqrt() * normal).round().max(0.0)
}

fn with_noise(sphere: &SphereGrid, clean: &[f32], plan: &Planted, rng: &mut impl Rng) -> Vec<f64> {
    let columns = plan.grid.phi_o;
    let noisy = |(k, f): (usize, &f32)| {
        let counts = sphere.solid_angles()[k / columns] * plan.paths;
        if plan.paths.is_finite() { poisson(*f as f64 * counts, rng) / counts } else { *f as f64 }
    };
    clean.iter().enumerate().map(noisy).collect()
}

/// Appends `density * ratio` and its summed variance, and returns its energy.
fn push(
    sphere: &SphereGrid,
    plan: &Planted,
    density: &[f64],
    ratio: &[f64],
    values: &mut Vec<f32>,
    noise: &mut Vec<f64>,
) -> f64 {
    let (mut energy, mut variance) = (0.0, 0.0);
    for (k, (f, r)) in density.iter().zip(ratio).enumerate() {
        values.push((f * r) as f32);
        energy += f * r * sphere.solid_angles()[k / plan.grid.phi_o];
        variance += f * r * r / plan.paths;
    }
    noise.push(variance);
    energy
}

/// The table of a plan.
pub fn table(plan: &Planted) -> Table {
    let sphere = SphereGrid::new(plan.grid);
    let theta_i: Vec<f64> = (0..plan.rows).map(|i| 1.2 * i as f64 / (plan.rows - 1) as f64).collect();
    let h_um: Vec<f64> =
        (0..plan.columns).map(|j| H_MAX * (2.0 * j as f64 / (plan.columns - 1) as f64 - 1.0)).collect();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(plan.seed);
    let mut t = Table {
        spec_text: "planted".into(),
        program_version: "0".into(),
        preset: "planted".into(),
        seed: plan.seed,
        plies: 1,
        traced: false,
        theta_i: theta_i.clone(),
        h_um: h_um.clone(),
        sigma_per_um: plan.sigma_per_um.clone(),
        grid: plan.grid,
        r_d: vec![],
        energy_refl: vec![],
        energy_high: vec![],
        energy_se: vec![],
        energy_killed: vec![],
        refl: vec![],
        high: vec![],
        noise_refl: vec![],
        noise_high: vec![],
        paths: vec![plan.paths.min(1e15) as u64; plan.rows],
        interactions: vec![3.0; plan.rows],
        exit: None,
        energies: None,
    };
    for &theta in &theta_i {
        for &h in &h_um {
            let clean = sphere.unpad(&density(&sphere, &turned(refl_lobes(theta, h), plan.turn)));
            let noisy = with_noise(&sphere, &clean, plan, &mut rng);
            let refl = push(&sphere, plan, &noisy, &vec![1.0; clean.len()], &mut t.refl, &mut t.noise_refl);
            t.energy_refl.push(refl);
            // One set of paths serves every sigma: the noise is common to them.
            let clean = sphere.unpad(&density(&sphere, &turned(high_at(theta, h, 0.0), plan.turn)));
            let noisy = with_noise(&sphere, &clean, plan, &mut rng);
            for (k, &sigma) in plan.sigma_per_um.iter().enumerate() {
                let dark = sphere.unpad(&density(&sphere, &turned(high_at(theta, h, sigma), plan.turn)));
                let ratio: Vec<f64> =
                    dark.iter().zip(&clean).map(|(d, c)| if *c > 0.0 { *d as f64 / *c as f64 } else { 0.0 }).collect();
                let high = push(&sphere, plan, &noisy, &ratio, &mut t.high, &mut t.noise_high);
                t.energy_high.push(high);
                if k == 0 {
                    t.r_d.push(1.0 - refl - high);
                }
            }
            t.energy_se.push(1e-3);
            t.energy_killed.push(0.0);
        }
    }
    t
}
