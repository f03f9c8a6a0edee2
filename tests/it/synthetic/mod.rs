//! A synthetic model: random lobes, smooth over the grid, with its own energies and spectra.
#![allow(dead_code)]

use plywave::ply::asg::PARAMS;
use plywave::ply::{DRIFT_BINS, LobeKind, PlyData, PlyEnergies, spline_coefficients};
use plywave_tables::table::{DISPLACEMENTS, ExitPositions, OutgoingGrid, Table};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Sizes of a synthetic model.
#[derive(Clone, Copy)]
pub struct Sizes {
    pub theta: usize,
    pub h: usize,
    pub refl: usize,
    pub high: usize,
    pub paths: usize,
}

/// Two reflection lobes, eight high-order lobes, eight path lengths.
pub const STANDARD: Sizes = Sizes { theta: 9, h: 17, refl: 2, high: 8, paths: 8 };

/// A smooth function of (x, y) in [0, 1]^2 with values in [low, high].
struct Wave {
    low: f64,
    high: f64,
    a: f64,
    b: f64,
    c: f64,
}

impl Wave {
    fn new(rng: &mut Pcg64Mcg, low: f64, high: f64) -> Wave {
        let mut r = |s: f64| s * (2.0 * rng.random::<f64>() - 1.0);
        Wave { low, high, a: r(1.2), b: r(1.2), c: r(3.0) }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        self.low + (self.high - self.low) * (0.5 + 0.5 * (self.c + self.a * x + self.b * y).sin())
    }
}

/// A model with lobes planted by `seed`.
pub fn model(seed: u64, s: Sizes) -> PlyData {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let rng = &mut rng;
    let theta_i: Vec<f64> = (0..s.theta).map(|i| 1.4 * i as f64 / (s.theta - 1) as f64).collect();
    let h_um: Vec<f64> = (0..s.h).map(|i| 130.0 * (2.0 * i as f64 / (s.h - 1) as f64 - 1.0)).collect();
    let path_um: Vec<f64> = (0..s.paths).map(|j| 12.0 * j as f64 + 0.7 * (j * j) as f64).collect();
    let sigma_per_um = vec![0.0, 0.001, 0.003, 0.01, 0.03, 0.1];
    let lobe = |rng: &mut Pcg64Mcg| -> Vec<Wave> {
        let phi = 6.0 * rng.random::<f64>();
        vec![
            Wave::new(rng, -1.3, 1.3),
            Wave::new(rng, phi - 1.0, phi + 1.0),
            Wave::new(rng, -1.5, 1.5),
            Wave::new(rng, -1.2, 5.0),
            Wave::new(rng, -1.2, 5.0),
            Wave::new(rng, 0.01, 0.2),
        ]
    };
    let lobes_refl: Vec<Vec<Wave>> = (0..s.refl).map(|_| lobe(rng)).collect();
    let lobes_high: Vec<Vec<Wave>> = (0..s.high).map(|_| lobe(rng)).collect();
    let path_waves: Vec<Vec<Wave>> =
        (0..s.high).map(|_| (0..s.paths).map(|_| Wave::new(rng, 0.0, 1.0)).collect()).collect();
    let spectrum = |waves: &[Wave], x: f64, y: f64| {
        let p: Vec<f64> = waves.iter().map(|w| w.at(x, y)).collect();
        let sum: f64 = p.iter().sum();
        p.iter().map(|v| v / sum).collect::<Vec<f64>>()
    };
    let unit = |i: usize, n: usize| i as f64 / (n - 1) as f64;

    let (mut r_d, mut energy_refl, mut energy_high, mut refl) = (vec![], vec![], vec![], vec![]);
    for m in 0..s.theta {
        for n in 0..s.h {
            let (x, y) = (unit(m, s.theta), unit(n, s.h));
            let miss = (2.0 * y - 1.0).powi(4) * (0.9 - 0.3 * x);
            let share = 0.25 + 0.1 * x;
            r_d.push(miss);
            energy_refl.push((1.0 - miss) * share);
            let mut sum = vec![0.0; s.paths];
            let total: f64 = lobes_high.iter().map(|l| l[5].at(x, y)).sum();
            for (l, w) in lobes_high.iter().zip(&path_waves) {
                let p = spectrum(w, x, y);
                sum.iter_mut().zip(p).for_each(|(s, p)| *s += p * l[5].at(x, y) / total);
            }
            energy_high.extend(sum.iter().map(|v| v * (1.0 - miss) * (1.0 - share)));
            refl.extend(lobes_refl.iter().flat_map(|l| l.iter().map(|w| w.at(x, y)).collect::<Vec<f64>>()));
        }
    }
    let (mut high, mut high_path) = (vec![], vec![]);
    for m in 0..s.theta / 2 {
        for n in 0..s.h / 2 {
            for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let (x, y) = (unit(2 * (m + a), s.theta), unit(2 * (n + b), s.h));
                high.extend(lobes_high.iter().flat_map(|l| l.iter().map(|w| w.at(x, y)).collect::<Vec<f64>>()));
                high_path.extend(path_waves.iter().flat_map(|w| spectrum(w, x, y)));
            }
        }
    }
    assert_eq!(refl.len(), s.theta * s.h * s.refl * PARAMS);
    PlyData {
        spec_text: "name = \"planted\"\n# \u{3c3} [1/um], \"quoted\"\n".to_string(),
        program_version: "0.1.0".to_string(),
        preset: "preview".to_string(),
        seed: u64::MAX - seed,
        error_refl: vec![0.1; s.theta * s.h],
        error_high: vec![0.02; s.theta * s.h * sigma_per_um.len()],
        layers: None,
        exits: None,
        edge: None,
        noise: None,
        theta_i: theta_i.clone(),
        h_um: h_um.clone(),
        sigma_per_um,
        path_um,
        family: LobeKind::Round,
        lobes_refl: s.refl,
        lobes_high: s.high,
        energies: energies(s, &r_d, &energy_refl, &energy_high, theta_i, h_um),
        refl,
        high,
        high_path,
    }
}

/// A model of cones: the planted lobes with small shifts and leans, their rings about `sharp` e-folds of
/// bandwidth narrower.
pub fn cone_model(seed: u64, s: Sizes, sharp: f64) -> PlyData {
    let mut data = model(seed, s);
    data.family = LobeKind::Cone;
    for p in data.refl.chunks_exact_mut(PARAMS).chain(data.high.chunks_exact_mut(PARAMS)) {
        (p[0], p[2], p[4]) = (0.3 * p[0], 0.3 * p[2], (p[4] + sharp).min(13.0));
    }
    data
}

/// Splines through energies at the nodes; r_d on a grid twice as fine, for its own indices.
fn energies(s: Sizes, r_d: &[f64], refl: &[f64], high: &[f64], theta_i: Vec<f64>, h_um: Vec<f64>) -> PlyEnergies {
    let clamped = |c: Vec<f64>| c.into_iter().map(|v| v.clamp(0.0, 1.0)).collect::<Vec<f64>>();
    let half = |axis: &[f64], i: usize| 0.5 * (axis[i / 2] + axis[i.div_ceil(2)]);
    let fine = |axis: &[f64]| (0..2 * axis.len() - 1).map(|i| half(axis, i)).collect::<Vec<f64>>();
    let (miss_theta_i, miss_h_um) = (fine(&theta_i), fine(&h_um));
    let columns = miss_h_um.len();
    let node = |m: usize, n: usize| r_d[m * s.h + n];
    let miss: Vec<f64> = (0..miss_theta_i.len() * columns)
        .map(|i| {
            let (m, n) = (i / columns, i % columns);
            let (m1, n1) = (m.div_ceil(2), n.div_ceil(2));
            0.25 * (node(m / 2, n / 2) + node(m / 2, n1) + node(m1, n / 2) + node(m1, n1))
        })
        .collect();
    let share = |stride: usize, k: usize, of: &[f64]| {
        let values: Vec<f64> = (0..s.theta * s.h).map(|i| of[i * stride + k] / (1.0 - r_d[i]).max(1e-9)).collect();
        clamped(spline_coefficients(&values, s.theta, s.h))
    };
    let spectra: Vec<Vec<f64>> = (0..s.paths).map(|p| share(s.paths, p, high)).collect();
    PlyEnergies {
        miss: clamped(spline_coefficients(&miss, miss_theta_i.len(), columns)),
        miss_theta_i,
        miss_h_um,
        share_refl: share(1, 0, refl),
        share_high: (0..s.theta * s.h).flat_map(|i| spectra.iter().map(move |c| c[i]).collect::<Vec<_>>()).collect(),
        share_theta_i: theta_i,
        share_h_um: h_um,
    }
}

/// A small table with random contents.
pub fn table(seed: u64) -> Table {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let (m, h, k) = (3, 5, 2);
    let grid = OutgoingGrid { theta_o: 6, phi_o: 8 };
    let mut f64s = |n: usize, scale: f64| (0..n).map(|_| scale * rng.random::<f64>()).collect::<Vec<f64>>();
    Table {
        spec_text: "name = \"random\"\n".to_string(),
        program_version: "0.1.0".to_string(),
        preset: "preview".to_string(),
        seed,
        plies: 1,
        traced: false,
        theta_i: vec![0.0, 0.7, 1.4],
        h_um: vec![-100.0, -50.0, 0.0, 50.0, 100.0],
        sigma_per_um: vec![0.0, 0.01],
        grid,
        r_d: f64s(m * h, 0.2),
        energy_refl: f64s(m * h, 0.3),
        energy_high: f64s(m * h * k, 0.5),
        energy_se: f64s(m * h, 1e-3),
        energy_killed: f64s(m * h, 1e-3),
        refl: f64s(m * h * grid.len(), 1.0).iter().map(|v| *v as f32).collect(),
        high: f64s(m * h * k * grid.len(), 1.0).iter().map(|v| *v as f32).collect(),
        noise_refl: f64s(m * h, 1.0),
        noise_high: f64s(m * h * k, 1.0),
        paths: vec![1000, 2000, u64::MAX / 8],
        interactions: f64s(m, 13.0),
        exit: Some(ExitPositions {
            azimuths: 3,
            positions: 2,
            shares: (0..m * h * (1 + k) * 3)
                .flat_map(|i| [0.125 * (i % 8) as f32, 1.0 - 0.125 * (i % 8) as f32])
                .collect(),
            met: (0..m * 4).map(|i| 1.0 / (1.0 + i as f32)).collect(),
            drift: (0..m * DRIFT_BINS * DISPLACEMENTS * k).map(|i| 1e-3 * (i % 7) as f32).collect(),
        }),
        energies: None,
    }
}
