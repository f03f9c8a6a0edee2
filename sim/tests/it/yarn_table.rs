//! Chain of trust of the yarn's table: light is conserved at every number of plies; the brute-force reference
//! is a random walk of photons between plies that shares only the table and the ring of plies with the
//! construction.

use plywave::Document;
use plywave::frame::{direction, theta_phi};
use plywave::ply::DRIFT_BINS;
use plywave::spec::YarnSpec;
use plywave_sim::yarn::{YarnOptions, yarn_table};
use plywave_tables::table::{DISPLACEMENTS, ExitPositions, OutgoingGrid, Table};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

fn spec(plies: u32) -> YarnSpec {
    YarnSpec::parse(&format!("{}\n[yarn]\nplies = {plies}\n", plywave::spec::POLYESTER), "yarn").unwrap()
}

const THETAS: u32 = 3;
const OFFSETS: u32 = 9;
const REACH_UM: f64 = 70.0;

/// A synthetic ply: lobes that follow theta_i and h, skewed so that no symmetry hides a sign, an edge blurred
/// by the beam. Its energy is exactly 1 at sigma = 0.
fn ply(exits: bool) -> Table {
    let grid = OutgoingGrid { theta_o: 24, phi_o: 48 };
    let theta_i: Vec<f64> = (0..THETAS).map(|m| 1.4 * f64::from(m) / f64::from(THETAS - 1)).collect();
    let h_um: Vec<f64> = (0..OFFSETS).map(|n| REACH_UM * (2.0 * f64::from(n) / f64::from(OFFSETS - 1) - 1.0)).collect();
    let sigma_per_um: Vec<f64> = vec![0.0, 0.01];
    let (mut refl, mut high) = (Vec::new(), Vec::new());
    let (mut r_d, mut energy_refl, mut energy_high) = (Vec::new(), Vec::new(), Vec::new());
    let slice = |energy: f64, density: &dyn Fn([f32; 3]) -> f64| -> Vec<f32> {
        let mut out: Vec<f64> = (0..grid.len())
            .map(|b| density(direction(grid.theta(b / grid.phi_o) as f32, grid.phi(b % grid.phi_o) as f32)))
            .collect();
        let total: f64 = out.iter().enumerate().map(|(b, v)| grid.solid_angle(b / grid.phi_o) * v).sum();
        out.iter_mut().for_each(|v| *v *= energy / total);
        out.iter().map(|v| *v as f32).collect()
    };
    for &theta in &theta_i {
        for &h in &h_um {
            let met = 0.5 * (1.0 + ((50.0 - f64::abs(h)) / 7.0).tanh());
            let lobe = |theta: f64, phi: f64, width: f64| {
                let axis = direction(theta as f32, phi as f32);
                move |v: [f32; 3]| (f64::from(v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]) / width).exp()
            };
            let up = lobe(0.2 - theta, 0.5 * PI - h / 40.0, 0.08);
            let through = lobe(-theta, 1.5 * PI + 0.3 + h / 60.0, 0.3);
            let (e_refl, e_high) = (0.1 * met, 0.9 * met);
            refl.extend(slice(e_refl, &|v| up(v)));
            for sigma in &sigma_per_um {
                let dark = (-15.0 * sigma).exp();
                high.extend(slice(e_high * dark, &|v| through(v) / 20.0 + 0.3));
                energy_high.push(e_high * dark);
            }
            r_d.push(1.0 - met);
            energy_refl.push(e_refl);
        }
    }
    let (rows, columns, sigmas) = (theta_i.len(), h_um.len(), sigma_per_um.len());
    let exit = exits.then(|| ExitPositions {
        azimuths: 4,
        positions: 5,
        shares: (0..rows * columns * (1 + sigmas) * 4)
            .flat_map(|i| [[0.5, 0.3, 0.1, 0.1, 0.0], [0.2; 5]][i % 2])
            .collect(),
        met: (0..rows * 40).map(|i| if (4..36).contains(&(i % 40)) { 1.0 } else { 0.5 }).collect(),
        drift: vec![1e-3; rows * DRIFT_BINS * DISPLACEMENTS * sigmas],
    });
    Table {
        spec_text: "made up".into(),
        program_version: "0".into(),
        preset: "preview".into(),
        seed: 1,
        plies: 1,
        traced: false,
        noise_refl: vec![0.0; rows * columns],
        noise_high: vec![0.0; rows * columns * sigmas],
        energy_se: vec![0.0; rows * columns],
        energy_killed: vec![0.0; rows * columns],
        paths: vec![1; rows],
        interactions: vec![1.0; rows],
        theta_i,
        h_um,
        sigma_per_um,
        grid,
        r_d,
        energy_refl,
        energy_high,
        refl,
        high,
        exit,
        energies: None,
    }
}

/// Small enough to be quick.
fn small() -> YarnOptions {
    YarnOptions { rows: 16, cells: 12, offsets: 8, ..YarnOptions::default() }
}

#[test]
fn light_is_kept_at_every_number_of_plies() {
    for plies in 2..=7 {
        for exits in if plies < 4 { vec![false, true] } else { vec![plies % 2 == 0] } {
            let ply = ply(exits);
            let (yarn, ledger) = yarn_table(&ply, &spec(plies), &small(), &|_, _| {}).unwrap();
            assert_eq!((yarn.plies, yarn.exit.is_some()), (plies, exits));
            let sigmas = yarn.sigma_per_um.len();
            for i in 0..yarn.r_d.len() {
                for k in 0..sigmas {
                    let at = i * sigmas + k;
                    let parts =
                        [ledger.direct[at], ledger.conv[at], ledger.residual[at], ledger.absorbed[at], ledger.r_d[i]];
                    let sum: f64 = parts.iter().sum();
                    let place = format!("{plies} plies, exits {exits}, incidence {i}, sigma {k}: {parts:?}");
                    assert!((sum - 1.0).abs() < 1e-3, "{place}");
                    assert!(parts.iter().all(|p| (-1e-4..=1.0).contains(p)), "{place}");
                    // The table's energies are those of the ledger.
                    let held = yarn.energy_refl[i] + yarn.energy_high[at];
                    assert!((held - parts[..3].iter().sum::<f64>()).abs() < 1e-4, "{place}: the table holds {held}");
                    assert!(held + yarn.r_d[i] <= 1.0 + 1e-4, "{place}");
                    // Nothing is absorbed in clear fibers, except by the rounding of the synthetic slices.
                    assert!(k > 0 || ledger.absorbed[at].abs() < 1e-3, "{place}");
                }
                let high = &yarn.energy_high[i * sigmas..(i + 1) * sigmas];
                assert!(high.windows(2).all(|w| w[1] <= w[0] + 1e-9), "{high:?}");
            }
            assert!(yarn.refl.iter().chain(&yarn.high).all(|v| *v >= 0.0 && v.is_finite()));
            // The file's own rules hold.
            assert_eq!(Table::from_bytes(&yarn.to_bytes().unwrap(), "yarn").unwrap(), yarn);
        }
    }
}

/// One photon after the other: it hits a ply at random, is scattered by the table's bins and leaves evenly
/// over the ply's width.
struct Walk<'a> {
    table: &'a Table,
    spec: &'a YarnSpec,
    rng: Pcg64Mcg,
    /// `[node]`: sums of the energies of f_refl, then of f_high, bin after bin.
    below: Vec<Vec<f64>>,
}

impl<'a> Walk<'a> {
    fn new(table: &'a Table, spec: &'a YarnSpec, sigma: usize) -> Walk<'a> {
        let columns = table.h_um.len();
        let sums = |node: usize| {
            let (m, n) = (node / columns, node % columns);
            let mut sum = 0.0;
            let slices = table.refl_slice(m, n).iter().chain(table.high_slice(m, n, sigma)).enumerate();
            let row = |b: usize| b % table.grid.len() / table.grid.phi_o;
            slices
                .map(|(b, v)| {
                    sum += f64::from(*v) * table.grid.solid_angle(row(b));
                    sum
                })
                .collect()
        };
        let below = (0..table.theta_i.len() * columns).map(sums).collect();
        Walk { table, spec, rng: Pcg64Mcg::seed_from_u64(5), below }
    }

    fn pick(&mut self, at: f64, last: usize) -> usize {
        let at = at.clamp(0.0, last as f64);
        let i = (at as usize).min(last - 1);
        i + usize::from(self.rng.random::<f64>() < at - i as f64)
    }

    /// 1 - r_d, linear over the offsets, mean over the latitudes and both signs as the flights take it.
    fn met(&self, h: f64) -> f64 {
        let last = self.table.h_um.len() - 1;
        let at = (h / REACH_UM + 1.0) * 0.5 * last as f64;
        if at < 0.0 || at > last as f64 {
            return 0.0;
        }
        let n = (at as usize).min(last - 1);
        let (a, b) = (1.0 - self.table.r_d[n], 1.0 - self.table.r_d[n + 1]);
        a + (at - n as f64) * (b - a)
    }

    /// Direction of a photon scattered at node (m, n) in the ply's frame, and whether it was only reflected;
    /// None when absorbed.
    fn scatter(&mut self, m: usize, n: usize) -> Option<([f32; 3], bool)> {
        let t = self.table;
        let node = m * t.h_um.len() + n;
        let below = &self.below[node];
        let xi = self.rng.random::<f64>() * (1.0 - t.r_d[node]);
        let place = below.partition_point(|sum| *sum <= xi);
        if place == below.len() {
            return None;
        }
        let b = place % t.grid.len();
        let (i, j) = (b / t.grid.phi_o, b % t.grid.phi_o);
        let edge = |i: usize| (PI * (i as f64 / t.grid.theta_o as f64 - 0.5)).sin();
        let sine = edge(i) + self.rng.random::<f64>() * (edge(i + 1) - edge(i));
        let phi = TAU * (j as f64 + self.rng.random::<f64>()) / t.grid.phi_o as f64;
        Some((direction(sine.asin() as f32, phi as f32), place < t.grid.len()))
    }

    /// A photon that ply 0 scatters at node (m, n): its last direction, whether it was only reflected, plies
    /// it hit; None when absorbed.
    fn photon(&mut self, m: usize, n: usize) -> Option<([f32; 3], bool, usize)> {
        let ring = self.spec.ply_ring();
        let mut psi = TAU * self.rng.random::<f64>();
        while !ring.is_valid(psi, self.table.h_um[n]) {
            psi = TAU * self.rng.random::<f64>();
        }
        let (mut dir, mut reflected) = self.scatter(m, n)?;
        let mut plies = 1;
        'flight: loop {
            let across = f64::from(dir[0].hypot(dir[1])).max(1e-9);
            let (cos, sin) = (f64::from(dir[0]) / across, f64::from(dir[1]) / across);
            let t = ring.radius_um * (2.0 * self.rng.random::<f64>() - 1.0);
            let mut ahead: Vec<(f64, f64, u32)> = (1..ring.plies)
                .map(|p| (p, ring.center(p, psi)))
                .map(|(p, [x, y])| (x * cos + y * sin, t - (y * cos - x * sin), p))
                .filter(|a| a.0 > 0.0)
                .collect();
            ahead.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, h, p) in ahead {
                if self.rng.random::<f64>() >= self.met(h) {
                    continue;
                }
                plies += 1;
                psi += TAU * f64::from(p) / f64::from(ring.plies);
                // The ply's frame: y' against the flight. A negative latitude is looked up in the turned ply.
                let theta_i = -f64::from(dir[2].clamp(-1.0, 1.0)).asin();
                let (turned, theta, h) = if theta_i < 0.0 { (true, -theta_i, -h) } else { (false, theta_i, h) };
                let m = self.pick(theta / 1.4 * f64::from(THETAS - 1), THETAS as usize - 1);
                let n = self.pick((h / REACH_UM + 1.0) * 0.5 * f64::from(OFFSETS - 1), OFFSETS as usize - 1);
                let (local, only) = self.scatter(m, n)?;
                let local = if turned { plywave::frame::mirror_incidence(local) } else { local };
                reflected &= only;
                // x' = (-sin, cos), y' = (-cos, -sin).
                let (x, y) = (f64::from(local[0]), f64::from(local[1]));
                dir = [(-x * sin - y * cos) as f32, (x * cos - y * sin) as f32, local[2]];
                continue 'flight;
            }
            return Some((dir, reflected, plies));
        }
    }
}

#[test]
fn construction_is_a_walk_of_photons() {
    // A thin beam hits ply 0 alone at these offsets, so that the walk may begin there.
    let ply = ply(false);
    for (plies, m, n, sigma) in [(2, 0, 3, 0), (3, 1, 5, 1)] {
        let mut yarn_spec = spec(plies);
        yarn_spec.beam.w0_um = 1.0;
        let (yarn, ledger) =
            yarn_table(&ply, &yarn_spec, &YarnOptions { rows: 24, ..YarnOptions::default() }, &|_, _| {}).unwrap();
        let photons = 200_000;
        let mut walk = Walk::new(&ply, &yarn_spec, sigma);
        // Coarse bins: 6 x 12.
        let (mut refl, mut high) = (vec![0.0; 72], vec![0.0; 72]);
        let mut parts = [0.0; 3];
        for _ in 0..photons {
            let Some((dir, reflected, met)) = walk.photon(m, n) else { continue };
            let (theta, phi) = theta_phi(dir);
            let bin = ((f64::from(theta) / PI + 0.5) * 6.0).min(5.0) as usize * 12
                + (f64::from(phi) / TAU * 12.0).min(11.0) as usize;
            let share = 1.0 / f64::from(photons);
            if reflected {
                refl[bin] += share
            } else {
                high[bin] += share
            }
            parts[met.min(3) - 1] += share;
        }
        let node = m * ply.h_um.len() + n;
        let at = node * 2 + sigma;
        let got = [ledger.direct[at], ledger.conv[at], ledger.residual[at]];
        for (got, want) in got.iter().zip(&parts) {
            let tol = 5.0 * (want / f64::from(photons)).sqrt() + 5e-3;
            assert!((got - want).abs() < tol, "{plies} plies: {got}, walk {want}, tolerance {tol}");
        }
        for (name, walked, slice) in
            [("refl", &refl, yarn.refl_slice(m, n)), ("high", &high, yarn.high_slice(m, n, sigma))]
        {
            let mut energies = vec![0.0; 72];
            for (b, v) in slice.iter().enumerate() {
                energies[b / 48 / 4 * 12 + b % 48 / 4] += f64::from(*v) * yarn.grid.solid_angle(b / 48);
            }
            let total: f64 = walked.iter().sum();
            let off: f64 = energies.iter().zip(walked).map(|(a, b)| (a - b).abs()).sum::<f64>() / total;
            // Half of the sum of |differences| is the light in a wrong bin; 200k photons have some of it by
            // chance.
            let chance = (72.0 / (total * f64::from(photons))).sqrt();
            assert!(off < 0.02 + chance, "{plies} plies, {name}: {off} of the light is elsewhere, chance {chance}");
        }
    }
}

#[test]
fn one_ply_stays_and_yarns_are_refused() {
    let ply = ply(true);
    let (same, _) = yarn_table(&ply, &spec(1), &small(), &|_, _| {}).unwrap();
    assert_eq!(same, ply);
    let (yarn, _) = yarn_table(&ply, &spec(2), &small(), &|_, _| {}).unwrap();
    let again = yarn_table(&yarn, &spec(2), &small(), &|_, _| {}).unwrap_err().to_string();
    assert!(again.contains("plies = 2") && again.contains("a yarn already"), "{again}");
    let bad = YarnOptions { cells: 0, ..small() };
    assert!(yarn_table(&ply, &spec(2), &bad, &|_, _| {}).unwrap_err().to_string().contains("cells = 0"));
}
