//! Traced yarns: power is conserved, other plies stop light, and a single ply does not depend on the yarn.
//! `sim/src/target.rs` compares the missed light and the exit positions with closed forms.

use plywave::spec::YarnSpec;
use plywave_runs::Run;
use plywave_sim::{SimOptions, simulate};
use plywave_tables::table::Table;

/// A yarn of plies that are one cylinder each.
fn solid(plies: u32, alpha: f64) -> (YarnSpec, String) {
    let text = format!(
        "name = \"solid\"\n[fiber]\nshape = {{ kind = \"circle\", radius_um = 20.0 }}\neta = 1.5\nalpha_fiber = {alpha}\n\
         [ply]\nfibers = 1\nradius_um = 25.0\n[yarn]\nplies = {plies}\n[beam]\nw0_um = 4.0\n[absorption]\nsigma_per_um = [0.0, 0.01]\n"
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

#[test]
fn power_of_a_traced_yarn_is_conserved() {
    let text = format!("{}\n[yarn]\nplies = 2\n", plywave::spec::POLYESTER);
    for (spec, text) in [solid(3, 0.2), (YarnSpec::parse(&text, "yarn").unwrap(), text)] {
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

/// More plies reflect more light and transmit less: light that leaves one ply hits others.
#[test]
#[ignore = "slow: 5 s: other plies stop forward light"]
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
        let text = format!("{}\n[yarn]\nplies = {plies}\n", plywave::spec::POLYESTER);
        let spec = YarnSpec::parse(&text, "yarn").unwrap();
        forward(&simulate(&spec, &text, &options(40_000, plies > 1), Run::plain()).unwrap())
    };
    let (one, two, seven) = (of(1), of(2), of(7));
    assert!(one > two + 0.01 && two > seven + 0.03, "{one} {two} {seven}");
}

/// The table of one ply does not depend on the yarn's plies.
#[test]
fn one_ply_of_a_yarn_is_the_ply() {
    let (one, one_text) = solid(1, 0.3);
    let (three, three_text) = solid(3, 0.3);
    let a = simulate(&one, &one_text, &options(2_000, false), Run::plain()).unwrap();
    let b = simulate(&three, &three_text, &options(2_000, false), Run::plain()).unwrap();
    assert_eq!(a, Table { spec_text: one_text, ..b });
}
