//! Lobes of a family interpolate, those of separate fits do not.
//!
//! Reference: planted lobes that turn from one end of a family to the other (tests/planted), with the noise
//! of a known number of paths. In the middle between two ends the mean of the parameters is compared with a
//! held-out table.

use crate::planted::Planted;
use plywave::ply::asg::PARAMS;
use plywave::ply::{FamilyAxis, FamilyParam, PlyData};
use plywave_fit::{FamilyMiddle, FamilyTables, FitOptions, errors, fit, fit_family};
use plywave_tables::table::Table;
use std::sync::{Arc, OnceLock};

/// Turn of the lobes over the family [rad times the factors of `crate::planted::turned`]: two widths of the
/// narrowest.
const TURN: f64 = 0.3;

/// A table at a position from 0 to 1 in the family.
fn table(at: f64, seed: u64) -> Arc<Table> {
    let turn = TURN * at;
    let plan = Planted { turn, seed, sigma_per_um: vec![0.0, 0.003, 0.03], ..Planted::default() };
    Arc::new(crate::planted::table(&plan))
}

/// The model whose numbers are the means of those of two.
fn mean(a: &PlyData, b: &PlyData) -> PlyData {
    let of = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect::<Vec<f64>>();
    let mut m = a.clone();
    m.refl = of(&a.refl, &b.refl);
    m.high = of(&a.high, &b.high);
    m.high_path = of(&a.high_path, &b.high_path);
    m.energies.miss = of(&a.energies.miss, &b.energies.miss);
    m.energies.share_refl = of(&a.energies.share_refl, &b.energies.share_refl);
    m.energies.share_high = of(&a.energies.share_high, &b.energies.share_high);
    m
}

fn family(middles: Vec<FamilyMiddle>) -> Vec<PlyData> {
    let axes = [FamilyAxis { param: FamilyParam::Alpha, values: vec![0.0, 1.0] }];
    let nodes = [table(0.0, 1), table(1.0, 1)];
    let tables = FamilyTables { spec_text: "planted", axes: &axes, nodes: &nodes, middles: &middles, edge: None };
    fit_family(&tables, &FitOptions::preview(), &|_| {}).expect("planted tables").nodes
}

/// A family without tables between the ends, fitted once.
fn followed() -> &'static [PlyData] {
    static FOLLOWED: OnceLock<Vec<PlyData>> = OnceLock::new();
    FOLLOWED.get_or_init(|| family(Vec::new()))
}

#[test]
#[ignore = "slow: 25 s: lobes fitted together interpolate and those fitted apart do not"]
fn lobes_fitted_together_interpolate_and_those_fitted_apart_do_not() {
    let fresh = table(0.5, 7);
    let options = FitOptions::preview();
    let own = fit(&table(0.5, 1), &options, &|_| {}).unwrap();
    let ends = [0.0, 1.0].map(|turn| fit(&table(turn, 1), &options, &|_| {}).unwrap());
    let high = |model: &PlyData| errors(model, &fresh).unwrap().rms_high[0];
    let refl = |model: &PlyData| errors(model, &fresh).unwrap().rms_refl;
    // Separate fits have their own path lengths; either serves at sigma = 0.
    let apart = mean(&ends[0], &ends[1]);
    let followed = followed();
    let joint = family(vec![FamilyMiddle { corners: vec![(0, 0.5), (1, 0.5)], table: table(0.5, 1) }]);
    let (followed, joint) = (mean(&followed[0], &followed[1]), mean(&joint[0], &joint[1]));
    println!(
        "f_high: own {:.4}, apart {:.4}, followed {:.4}, joint {:.4}",
        high(&own),
        high(&apart),
        high(&followed),
        high(&joint)
    );
    println!(
        "f_refl: own {:.4}, apart {:.4}, followed {:.4}, joint {:.4}",
        refl(&own),
        refl(&apart),
        refl(&followed),
        refl(&joint)
    );
    assert!(high(&apart) > 3.0 * high(&joint), "apart {}, joint {}", high(&apart), high(&joint));
    assert!(high(&joint) < 1.3 * high(&own).max(0.02), "joint {}, own {}", high(&joint), high(&own));
    assert!(refl(&joint) < 1.3 * refl(&own).max(0.03), "joint {}, own {}", refl(&joint), refl(&own));
}

#[test]
#[ignore = "slow: 5 s: nodes share what a family needs"]
fn nodes_share_what_a_family_needs() {
    let nodes = followed();
    assert_eq!(nodes.len(), 2);
    assert_eq!(nodes[0].path_um, nodes[1].path_um);
    assert_eq!(nodes[0].energies.miss, nodes[1].energies.miss);
    // Lobes stay near each other, no turn by pi, no swap of mu1 and mu2 (a quarter turn): planted ones turn
    // by some TURN.
    let mut compared = 0;
    let mut near = |a: &[f64], b: &[f64], lobes: usize| {
        for (a, b) in a.chunks_exact(lobes * PARAMS).zip(b.chunks_exact(lobes * PARAMS)) {
            let sum = |set: &[f64]| set.chunks_exact(PARAMS).map(|p| p[5]).sum::<f64>();
            let least = [0.03 * sum(a), 0.03 * sum(b)];
            for (p, q) in a.chunks_exact(PARAMS).zip(b.chunks_exact(PARAMS)) {
                if p[5] > least[0] && q[5] > least[1] {
                    compared += 1;
                    let apart = (0..3).map(|i| (p[i] - q[i]).abs()).fold(0.0, f64::max);
                    assert!(apart < 1.2, "{p:?} and {q:?}");
                }
            }
        }
    };
    near(&nodes[0].high, &nodes[1].high, nodes[0].lobes_high);
    near(&nodes[0].refl, &nodes[1].refl, nodes[0].lobes_refl);
    assert!(compared > 50, "{compared}");
}

#[test]
fn tables_of_other_grids_are_refused() {
    let axes = [FamilyAxis { param: FamilyParam::Alpha, values: vec![0.0, 1.0] }];
    let other = Arc::new(crate::planted::table(&Planted { rows: 3, ..Planted::default() }));
    let nodes = [Arc::new(crate::planted::table(&Planted::default())), other];
    let tables = FamilyTables { spec_text: "planted", axes: &axes, nodes: &nodes, middles: &[], edge: None };
    let error = fit_family(&tables, &FitOptions::preview(), &|_| {}).unwrap_err().to_string();
    assert!(error.contains("theta_i") && !error.contains('\n'), "{error}");
}
