//! Chain of trust of the distance between tables: a known factor, energies, and noise of a known size.

use plywave_fit::table_distance;
use plywave_tables::table::{OutgoingGrid, Table};

/// A synthetic table of 3 latitudes, 9 offsets and 2 absorptions: smooth densities that follow the incidence,
/// nothing equal to anything else.
fn table() -> Table {
    let grid = OutgoingGrid { theta_o: 24, phi_o: 48 };
    let theta_i: Vec<f64> = (0..3).map(|m| 0.7 * f64::from(m)).collect();
    let h_um: Vec<f64> = (0..9).map(|n| 17.5 * f64::from(n) - 70.0).collect();
    let sigma_per_um = vec![0.0, 0.01];
    let density = |scale: f64, m: usize, n: usize, width: f64| -> Vec<f64> {
        let (theta, h) = (theta_i[m], h_um[n]);
        let value = |b: usize| {
            let (t, p) = (grid.theta(b / grid.phi_o), grid.phi(b % grid.phi_o));
            scale * ((-((t + theta) / width).powi(2)).exp() * (1.2 + (p + h / 40.0).sin()) + 0.1)
        };
        (0..grid.len()).map(value).collect()
    };
    let energy = |f: &[f64]| -> f64 { f.iter().enumerate().map(|(b, v)| v * grid.solid_angle(b / grid.phi_o)).sum() };
    let (mut refl, mut high, mut energy_refl, mut energy_high) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for m in 0..theta_i.len() {
        for n in 0..h_um.len() {
            let f = density(0.01, m, n, 0.3);
            energy_refl.push(energy(&f));
            refl.extend(f.iter().map(|v| *v as f32));
            for sigma in &sigma_per_um {
                let f = density(0.05 * f64::exp(-15.0 * sigma), m, n, 0.6);
                energy_high.push(energy(&f));
                high.extend(f.iter().map(|v| *v as f32));
            }
        }
    }
    let nodes = theta_i.len() * h_um.len();
    Table {
        spec_text: "made up".into(),
        program_version: "0".into(),
        preset: "preview".into(),
        seed: 1,
        plies: 1,
        traced: false,
        r_d: vec![0.3; nodes],
        noise_refl: vec![0.0; nodes],
        noise_high: vec![0.0; nodes * sigma_per_um.len()],
        energy_se: vec![0.0; nodes],
        energy_killed: vec![0.0; nodes],
        paths: vec![1; theta_i.len()],
        interactions: vec![1.0; theta_i.len()],
        theta_i,
        h_um,
        sigma_per_um,
        grid,
        energy_refl,
        energy_high,
        refl,
        high,
        exit: None,
        energies: None,
    }
}

#[test]
fn distance_of_tables_is_their_difference_less_noise() {
    let a = table();
    let mut b = table();
    let d = table_distance(&a, &b).unwrap();
    assert!(d.high2.iter().chain(&d.refl2).all(|v| v.abs() < 1e-12));
    b.high.iter_mut().for_each(|v| *v *= 1.25);
    b.energy_high.iter_mut().for_each(|v| *v *= 1.25);
    let d = table_distance(&a, &b).unwrap();
    assert!(d.high2.iter().all(|v| (v.sqrt() - 0.2).abs() < 1e-5));
    assert!(d.energy_high.iter().zip(&a.energy_high).all(|(d, e)| (d + 0.25 * e).abs() < 1e-12));
    // The noise of both is subtracted: here it is the whole distance.
    let norm2 = |slice: &[f32]| -> f64 {
        slice.iter().enumerate().map(|(i, v)| a.grid.solid_angle(i / 48) * f64::from(*v).powi(2)).sum()
    };
    let noisy = 0.5 * 0.04 * norm2(b.high_slice(0, 4, 0));
    let mut a = a.clone();
    a.noise_high[4 * 2] = noisy;
    b.noise_high[4 * 2] = noisy;
    let d = table_distance(&a, &b).unwrap();
    assert!(d.high2[4 * 2].abs() < 1e-3, "{}", d.high2[4 * 2]);
    // Partly common axes.
    let mut c = a.clone();
    c.h_um.iter_mut().for_each(|h| *h += 1.0);
    assert!(table_distance(&a, &c).unwrap_err().to_string().contains("h_um"));
}
