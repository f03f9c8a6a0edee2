//! Canonical form of parameters that describe the same mixture: mu1 and mu2 may be swapped together with a
//! turn of phi_xy, phi_z and phi_xy are periodic, and lobes may be listed in any order.

use plywave::ply::asg::{Lobe, PARAMS};
use plywave::ply::{LobeKind, PlyData};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The same lobe with theta_z in [-pi/2, pi/2], phi_z in [0, 2 pi), mu1 <= mu2 and phi_xy in [-pi/2, pi/2).
pub fn canonical(lobe: Lobe) -> Lobe {
    let mut l = lobe;
    let wrapped = (l.theta_z + PI).rem_euclid(TAU) - PI;
    l.theta_z = wrapped;
    if wrapped.abs() > FRAC_PI_2 {
        // Beyond the pole, the axis lies at pi - theta on the other side, where the frame is rotated by pi.
        l.theta_z = PI.copysign(wrapped) - wrapped;
        l.phi_z += PI;
    }
    if l.ln_mu1 > l.ln_mu2 {
        std::mem::swap(&mut l.ln_mu1, &mut l.ln_mu2);
        l.phi_xy += FRAC_PI_2;
    }
    l.phi_z = l.phi_z.rem_euclid(TAU);
    l.phi_xy = (l.phi_xy + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2;
    l
}

/// Canonical lobes in order of decreasing energy.
pub fn canonical_order(lobes: &[Lobe]) -> Vec<Lobe> {
    let mut out: Vec<Lobe> = lobes.iter().map(|l| canonical(*l)).collect();
    out.sort_by(|a, b| b.energy.total_cmp(&a.energy));
    out
}

/// The representation of `lobe` nearest to `reference`, over turns of phi_z by 2 pi, turns of phi_xy by pi,
/// and the swap of mu1 and mu2.
pub fn nearest_representation(lobe: Lobe, reference: Lobe) -> Lobe {
    let near = |x: f64, to: f64, period: f64| x + period * ((to - x) / period).round();
    let turn = |mut l: Lobe| {
        l.phi_z = near(l.phi_z, reference.phi_z, TAU);
        l.phi_xy = near(l.phi_xy, reference.phi_xy, PI);
        l
    };
    let plain = turn(lobe);
    let swapped = turn(Lobe { ln_mu1: lobe.ln_mu2, ln_mu2: lobe.ln_mu1, phi_xy: lobe.phi_xy + FRAC_PI_2, ..lobe });
    let distance = |l: &Lobe| {
        (l.phi_xy - reference.phi_xy).powi(2)
            + (l.ln_mu1 - reference.ln_mu1).powi(2)
            + (l.ln_mu2 - reference.ln_mu2).powi(2)
    };
    if distance(&swapped) < distance(&plain) { swapped } else { plain }
}

/// Converts the lobes of a model to canonical form without changing its values. Parameter sets that are
/// interpolated with each other (all nodes of f_refl; the four corners of a block) are turned, swapped and
/// ordered together.
pub fn canonicalize(data: &mut PlyData) {
    let (lobes, paths) = (data.lobes_refl, data.path_um.len());
    let turns = data.family == LobeKind::Round;
    canonical_sets(&mut data.refl, lobes, &mut [], 0, turns);
    let lobes = data.lobes_high;
    let blocks = data.high.chunks_exact_mut(4 * lobes * PARAMS).zip(data.high_path.chunks_exact_mut(4 * lobes * paths));
    for (params, spectra) in blocks {
        canonical_sets(params, lobes, spectra, paths, turns);
    }
}

/// Canonical form of `params[sets][lobes][6]` and of the data of each lobe, `extra[sets][lobes][stride]`.
/// Round lobes may turn about their axes (`turns`), cones may not.
fn canonical_sets(params: &mut [f64], lobes: usize, extra: &mut [f64], stride: usize, turns: bool) {
    let sets = params.len() / (lobes * PARAMS).max(1);
    if sets == 0 {
        return;
    }
    let total = |k: usize, l: usize| (0..sets).map(|s| params[(s * lobes + l) * PARAMS + k]).sum::<f64>();
    let mut order: Vec<(f64, usize)> = (0..lobes).map(|l| (total(5, l), l)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let swap: Vec<bool> = (0..lobes).map(|l| turns && total(3, l) > total(4, l)).collect();
    let (old, old_extra) = (params.to_vec(), extra.to_vec());
    for (to, &(_, from)) in order.iter().enumerate() {
        // One turn for all sets moves their mean into the canonical range.
        let count = sets as f64;
        let quarter = if swap[from] { FRAC_PI_2 } else { 0.0 };
        let mean = |k: usize| (0..sets).map(|s| old[(s * lobes + from) * PARAMS + k]).sum::<f64>() / count;
        let (phi_z, phi_xy) = (mean(1), mean(2) + quarter);
        let turn_z = phi_z.rem_euclid(TAU) - phi_z;
        let turn_xy = if turns { (phi_xy + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2 - phi_xy + quarter } else { 0.0 };
        for s in 0..sets {
            let p = &old[(s * lobes + from) * PARAMS..][..PARAMS];
            let (mu1, mu2) = if swap[from] { (p[4], p[3]) } else { (p[3], p[4]) };
            let new = [p[0], p[1] + turn_z, p[2] + turn_xy, mu1, mu2, p[5]];
            params[(s * lobes + to) * PARAMS..][..PARAMS].copy_from_slice(&new);
            let (a, b) = ((s * lobes + from) * stride, (s * lobes + to) * stride);
            if stride > 0 {
                extra[b..b + stride].copy_from_slice(&old_extra[a..a + stride]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same(a: Lobe, b: Lobe) {
        for i in 0..40 {
            for j in 0..40 {
                let (theta, phi) = (PI * (i as f64 / 40.0 - 0.49), TAU * j as f64 / 40.0);
                let v = [theta.cos() * phi.cos(), theta.cos() * phi.sin(), theta.sin()];
                let (x, y) = (a.eval(v), b.eval(v));
                assert!((x - y).abs() < 1e-12, "{a:?} {b:?} at {theta} {phi}: {x} {y}");
            }
        }
    }

    #[test]
    fn canonical_forms_are_the_same_function() {
        for theta_z in [-4.0, -2.0, -1.0, 0.3, 1.9, 3.0] {
            for phi_xy in [-3.0, 0.2, 1.7] {
                for (ln_mu1, ln_mu2) in [(1.0, 3.0), (3.0, 1.0)] {
                    let lobe = Lobe { theta_z, phi_z: -8.0, phi_xy, ln_mu1, ln_mu2, energy: 1.0 };
                    let c = canonical(lobe);
                    same(lobe, c);
                    assert!(c.theta_z.abs() <= FRAC_PI_2 && (0.0..TAU).contains(&c.phi_z) && c.ln_mu1 <= c.ln_mu2);
                    assert!((-FRAC_PI_2..FRAC_PI_2).contains(&c.phi_xy));
                    let reference = Lobe { phi_xy: 1.0, phi_z: 7.0, ln_mu1: 2.5, ln_mu2: 1.5, ..lobe };
                    let near = nearest_representation(lobe, reference);
                    same(lobe, near);
                    assert!(near.ln_mu1 > near.ln_mu2 || (near.phi_xy - 1.0).abs() <= FRAC_PI_2 + 1e-12);
                }
            }
        }
    }
}
