//! Finer nodes for targets so close to another wall that its nodes do not resolve the kernel. The density is
//! interpolated to them by trigonometric polynomials.

use crate::C64;
use crate::boundary::entries::{COMPONENTS, Entries, Pair, Wavenumbers};
use crate::boundary::kernel::MediumKernel;
use crate::scene::curve::{Curve, CurvePoint};
use std::f64::consts::{PI, TAU};

/// Half width of the window in which a close wall is refined, in its nodes.
pub(crate) const WINDOW_NODES: f64 = 12.0;
/// Maximum number of finer nodes per node of a close wall.
pub(crate) const FINEST: f64 = 128.0;

/// Parameter of the point of `curve` nearest to `target` and the refinement that its kernel needs there;
/// `None` if the nodes resolve it.
pub(crate) fn closeness(target: &CurvePoint, curve: &Curve, tolerance: f64) -> Option<(f64, f64)> {
    let digits = (10.0 / tolerance).ln();
    // The relative error of the trapezoidal rule is exp(-2 pi distance / spacing) of its terms, which grow as
    // kernels of both sides cancel: measured on walls of metal and glass 0.01 to 0.2 um thick, as the third
    // power of the missing refinement.
    let needed = |distance: f64, speed: f64| {
        let coarse = curve.step() * speed / distance;
        (digits + 3.0 * coarse.max(1.0).ln()) * coarse / TAU
    };
    let apart = |p: &CurvePoint| (p.at[0] - target.at[0]).hypot(p.at[1] - target.at[1]);
    let (nearest, distance) =
        curve.nodes.iter().map(apart).enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).expect("a wall has nodes");
    let node = &curve.nodes[nearest];
    // The nearest point may lie half a spacing from a node.
    let min_distance = (distance * distance - (0.6 * curve.step() * node.speed).powi(2)).max(0.0).sqrt();
    if min_distance > 0.0 && needed(min_distance, node.speed) <= 1.0 {
        return None;
    }
    let mut t = curve.parameter(nearest);
    let mut point = *node;
    for _ in 0..8 {
        let along = (target.at[1] - point.at[1]) * point.normal[0] - (target.at[0] - point.at[0]) * point.normal[1];
        t += (along / point.speed).clamp(-0.5 * curve.step(), 0.5 * curve.step());
        point = curve.point(t);
    }
    let refinement = needed(apart(&point).min(distance), point.speed).ceil();
    (refinement > 1.0).then_some((t, refinement))
}

/// Entries of one target against all nodes of a wall close to it: inside a smooth window around the nearest
/// point, finer nodes replace the wall's own, and the density is interpolated to them.
pub(crate) fn close_row(
    wavenumbers: &Wavenumbers,
    kernel: &MediumKernel,
    sign: f64,
    target: &CurvePoint,
    curve: &Curve,
    nearest: f64,
    refinement: f64,
) -> Vec<Entries> {
    let n = curve.nodes.len();
    let h = curve.step();
    let whole = 3.0 * WINDOW_NODES >= n as f64;
    // Distance along the wall in nodes, and the window there.
    let window = |t: f64| {
        if whole {
            return 1.0;
        }
        let d = ((t - nearest + PI).rem_euclid(TAU) - PI) / h;
        (-(d / WINDOW_NODES).powi(8)).exp()
    };
    let at = |point: &CurvePoint, weight: f64| {
        let pair = Pair::new(target, point);
        wavenumbers.regular(&kernel.radial(pair.r, sign * weight * point.speed), &pair)
    };
    let mut row: Vec<Entries> = curve
        .nodes
        .iter()
        .enumerate()
        .map(|(j, node)| {
            let outside = 1.0 - window(curve.parameter(j));
            if outside == 0.0 { [[C64::ZERO; COMPONENTS]; COMPONENTS] } else { at(node, h * outside) }
        })
        .collect();
    let fine = n * refinement as usize;
    let step = TAU / fine as f64;
    let reach = if whole { fine as i64 / 2 } else { (1.5 * WINDOW_NODES * refinement).ceil() as i64 };
    let middle = (nearest / step - 0.5).round() as i64;
    let end = if whole { middle - reach + fine as i64 } else { middle + reach };
    for k in middle - reach..end {
        let t = step * (k as f64 + 0.5);
        let entries = at(&curve.point(t), step * window(t));
        // Periodic sinc of n nodes: sin(n u / 2) cot(u / 2) / n, whose sine alternates from node to node.
        let u0 = t - curve.parameter(0);
        let sine = (0.5 * n as f64 * u0).sin() / n as f64;
        for (j, out) in row.iter_mut().enumerate() {
            let half = 0.5 * (u0 - j as f64 * h);
            let s = half.sin();
            let weight =
                if s.abs() < 1e-13 { 1.0 } else { (if j.is_multiple_of(2) { sine } else { -sine }) * half.cos() / s };
            for (out, entries) in out.iter_mut().zip(&entries) {
                for (out, value) in out.iter_mut().zip(entries) {
                    *out += value * weight;
                }
            }
        }
    }
    row
}
