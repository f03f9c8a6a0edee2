//! Chain of trust of traced yarns. Truth: geometry (what misses a yarn of solid plies), conservation of power, the impact parameter that a reflection by
//! a cylinder keeps. Twin: the same yarn turned by pi about y.

use plywave::{Table, YarnSpec};
use plywave_sim::{Run, SimOptions, simulate};

/// A yarn of plies that are one smooth or rough solid cylinder each.
fn solid(plies: u32, alpha: f64) -> (YarnSpec, String) {
    let text = format!(
        "name = \"solid\"\n[fiber]\nshape = {{ kind = \"circle\", radius_um = 20.0 }}\neta = 1.5\nalpha_fiber = {alpha}\n\
         [ply]\nfibers = 1\nradius_um = 20.001\n[yarn]\nplies = {plies}\n[beam]\nw0_um = 4.0\n[absorption]\nsigma_per_um = [0.0, 0.01]\n"
    );
    (YarnSpec::parse(&text, "solid").unwrap(), text)
}

fn options(paths_per_theta: u64, traced_plies: bool) -> SimOptions {
    SimOptions {
        paths_per_theta,
        instances: 32,
        shards: 32,
        theta_i_nodes: 3,
        theta_i_max_rad: 1.2,
        h_nodes: 13,
        theta_o_bins: 12,
        phi_o_bins: 24,
        traced_plies,
        ..SimOptions::preview()
    }
}

/// r_d of a yarn of solid plies by quadrature over the beam and the valid psi.
fn missed(spec: &YarnSpec, h: f64) -> f64 {
    let ring = spec.ply_ring();
    let (sd, turns, lines) = (spec.beam.beam().sd_um(), 7200, 400);
    let (mut valid, mut sum) = (0.0, 0.0);
    for i in 0..turns {
        let psi = std::f64::consts::TAU * (f64::from(i) + 0.5) / f64::from(turns);
        if !ring.is_valid(psi, h) {
            continue;
        }
        valid += 1.0;
        for k in 0..lines {
            let t = 6.0 * (2.0 * (f64::from(k) + 0.5) / f64::from(lines) - 1.0);
            let x = h + sd * t;
            if (0..ring.plies).all(|p| (x - ring.center(p, psi)[0]).abs() > ring.radius_um) {
                sum += (-0.5 * t * t).exp() * 12.0 / f64::from(lines) / std::f64::consts::TAU.sqrt();
            }
        }
    }
    sum / valid
}

#[test]
fn what_misses_a_yarn_is_geometry() {
    for plies in [2, 3, 7] {
        let (spec, text) = solid(plies, 0.2);
        let t = simulate(&spec, &text, &options(60_000, true), Run::plain()).unwrap();
        assert_eq!(t.plies, plies);
        assert!(t.exit.is_none());
        for m in 0..t.theta_i.len() {
            for (n, h) in t.h_um.iter().enumerate() {
                let i = m * t.h_um.len() + n;
                let want = missed(&spec, *h);
                // 60k paths over 100 um: some 6000 serve a beam of 4 um; binomial noise, the valid share's weights at most double it.
                let tol = 5.0 * 2.0 * (want * (1.0 - want) / 6e3).sqrt() + 2e-3;
                assert!(
                    (t.r_d[i] - want).abs() < tol,
                    "{plies} plies, theta {m}, h {h}: {} want {want}, tol {tol}",
                    t.r_d[i]
                );
            }
        }
    }
}

#[test]
fn power_of_a_traced_yarn_is_conserved() {
    let (_, text) = solid(3, 0.2);
    for text in [text, format!("{}\n[yarn]\nplies = 2\n", plywave::POLYESTER)] {
        let spec = YarnSpec::parse(&text, "yarn").unwrap();
        let t = simulate(&spec, &text, &options(16_000, true), Run::plain()).unwrap();
        let ks = t.sigma_per_um.len();
        for i in 0..t.r_d.len() {
            let sum = t.r_d[i] + t.energy_refl[i] + t.energy_high[i * ks];
            assert!(t.energy_se[i] < 0.05, "the standard error is no error: {}", t.energy_se[i]);
            assert!((sum - 1.0).abs() <= 5.0 * t.energy_se[i] + 1e-9, "incidence {i}: {sum}, se {}", t.energy_se[i]);
            assert_eq!(t.energy_killed[i], 0.0);
            let high = &t.energy_high[i * ks..(i + 1) * ks];
            assert!(high.windows(2).all(|w| w[1] <= w[0]), "f_high must fall with sigma: {high:?}");
        }
    }
}

/// More plies send more light back and let less through: light that leaves one ply meets others.
#[test]
fn other_plies_stop_forward_light() {
    let forward = |t: &Table| -> f64 {
        let slice = t.high_slice(0, t.h_um.len() / 2, 0);
        (0..12)
            .map(|i| {
                let row = &slice[i * 24..(i + 1) * 24];
                t.grid.solid_angle(i) * row[12..].iter().map(|v| f64::from(*v)).sum::<f64>()
            })
            .sum()
    };
    let of = |plies: u32| {
        let text = format!("{}\n[yarn]\nplies = {plies}\n", plywave::POLYESTER);
        let spec = YarnSpec::parse(&text, "yarn").unwrap();
        forward(&simulate(&spec, &text, &options(40_000, plies > 1), Run::plain()).unwrap())
    };
    let (one, two, seven) = (of(1), of(2), of(7));
    assert!(one > two + 0.01 && two > seven + 0.03, "{one} {two} {seven}");
}

/// The yarn's plies are no part of what one ply does.
#[test]
fn one_ply_of_a_yarn_is_the_ply() {
    let (one, one_text) = solid(1, 0.3);
    let (three, three_text) = solid(3, 0.3);
    let a = simulate(&one, &one_text, &options(2_000, false), Run::plain()).unwrap();
    let b = simulate(&three, &three_text, &options(2_000, false), Run::plain()).unwrap();
    assert_eq!(a, Table { spec_text: one_text, ..b });
}

/// A reflection by a smooth cylinder keeps the line's distance from the axis and its side: light of the beam at x leaves at t = x.
#[test]
fn reflected_light_leaves_at_its_impact_parameter() {
    let (spec, text) = solid(1, 0.0);
    let t = simulate(&spec, &text, &options(40_000, false), Run::plain()).unwrap();
    let exit = t.exit.as_ref().unwrap();
    let channels = 1 + t.sigma_per_um.len();
    let mut seen = 0;
    for (n, h) in t.h_um.iter().enumerate().filter(|(_, h)| h.abs() < 19.0) {
        for a in 0..exit.azimuths {
            let row = (n * channels * exit.azimuths + a) * exit.positions;
            let shares = &exit.shares[row..row + exit.positions];
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            // Where there is no light, shares are even.
            if shares.iter().all(|s| *s == shares[0]) {
                continue;
            }
            seen += 1;
            for (i, share) in shares.iter().enumerate() {
                let at = 20.001 * ((2 * i + 1) as f64 / exit.positions as f64 - 1.0);
                // The beam's standard deviation is 2 um, a position is 2.5 um wide.
                let far = ((at - h).abs() - 1.25).max(0.0) / 2.0;
                assert!(*share == 0.0 || far < 6.6, "h {h}, azimuth {a}: share {share} at {at}");
            }
        }
    }
    assert!(seen > 20, "{seen} azimuths with light");
    // Every ray through the cylinder meets it.
    assert!(exit.met.iter().all(|m| *m > 0.99), "{:?}", exit.met);
}
