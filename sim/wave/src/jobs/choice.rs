//! Choice of the solver for a scene: by the shapes of its bodies, and for many fibers by predicted times from
//! the numbers of unknowns.

use crate::many::compressed::MIN_TOLERANCE;
use crate::many::coupling::SINGLE;
use crate::{Body, C64, Method, Scene, Shape, Wave};
use std::f64::consts::{PI, TAU};

/// Speed of factorizations on one core [operations/s]: complex in double precision, counted as real
/// operations. Single precision is twice as fast.
const SPEED: f64 = 2.5e10;
/// Time of merging on one core [s] over (unknowns of a field)^1.5, for one system of one field: 37 fibers of
/// `docs/howto/wave.md`.
const MERGING: f64 = 2e-5;

/// Solvers to try for a scene at a wave, the cheapest first.
pub(crate) fn candidates(scene: &Scene, wave: &Wave) -> Vec<Method> {
    if scene.method == Method::Auto { by_shape(&scene.bodies, wave, scene.tolerance) } else { vec![scene.method] }
}

/// Solvers for these fibers, the cheapest first.
pub(crate) fn by_shape(fibers: &[Body], wave: &Wave, tolerance: f64) -> Vec<Method> {
    let series = fibers.iter().all(is_concentric);
    let mut all = match fibers.len() {
        0 | 1 if series => return vec![Method::Mie],
        1 => return vec![Method::Nystrom],
        // Measured on 2 to 19 fibers of 1 to 5 um: multipoles are 4 to 30 times faster than either of the
        // others. They fail if walls almost touch.
        _ if series => vec![Method::Multipole, Method::Compressed, Method::Nystrom],
        // The compressed solver is as fast as the plain one for two fibers of 1 um, and 4 to 9 times faster
        // for 19 of them. The plain one handles tolerances below its reach.
        _ => vec![Method::Compressed, Method::Nystrom],
    };
    let many = tolerance >= MIN_TOLERANCE
        && seconds(Method::Hierarchical, fibers, wave, tolerance) < seconds(all[0], fibers, wave, tolerance);
    // The last solver serves scenes for which the systems of the others do not fit in memory.
    all.insert(if many { 0 } else { all.len() - 1 }, Method::Hierarchical);
    all
}

/// Predicted time of one core [s] for the coupled system.
fn seconds(method: Method, fibers: &[Body], wave: &Wave, tolerance: f64) -> f64 {
    // Number of waves that fit around all walls.
    let waves: f64 = fibers.iter().map(|f| wave.k_rho() * least_length(&f.shape) / PI).sum();
    let (systems, fields) = if wave.kz() == 0.0 { (2.0, 1.0) } else { (1.0, 2.0) };
    let count = fibers.len() as f64;
    let elimination = |n: f64| systems * 8.0 / 3.0 * (fields * n).powi(3) / SPEED;
    // Sites and orders beyond the waves: those of close walls.
    let sites = 1.4 * waves + 40.0 * count;
    match method {
        Method::Multipole => elimination(1.1 * waves + 20.0 * count),
        Method::Hierarchical => systems * fields.powi(3) * MERGING * sites.powf(1.5),
        _ if tolerance >= SINGLE => 0.5 * elimination(sites),
        _ => elimination(sites),
    }
}

/// Whether the body and its lumens are circles about one center.
fn is_concentric(body: &Body) -> bool {
    let inner = |lumen: &Body| lumen.center_um == body.center_um && is_concentric(lumen);
    matches!(body.shape, Shape::Circle { .. }) && body.lumen.as_deref().is_none_or(inner)
}

/// Lower bound of the length of a wall [um].
pub(crate) fn least_length(shape: &Shape) -> f64 {
    match shape {
        Shape::Circle { radius_um } => TAU * radius_um,
        Shape::Ellipse { a_um, b_um } => 4.0 * a_um.max(*b_um),
        // The root mean square of |z - c_0| is that of the |c_k|. Some point has that distance from c_0,
        // another lies on the opposite side of c_0, and the wall connects both twice.
        Shape::Fourier { coeffs } => {
            2.0 * coeffs.iter().filter(|(k, _)| *k != 0).map(|(_, c)| c.norm_sqr()).sum::<f64>().sqrt()
        }
        Shape::Polygon { points_um, rounding_um } => {
            let n = points_um.len();
            let corner = |i: usize| C64::new(points_um[i % n][0], points_um[i % n][1]);
            let edge = |i: usize| corner(i + 1) - corner(i);
            // An arc that turns by t replaces 2 tan(t/2) of the edges by t, in units of its radius.
            let saved = |i: usize| {
                let turn = (edge(i + 1) * edge(i).conj()).arg().abs();
                rounding_um * (2.0 * (0.5 * turn).tan() - turn)
            };
            (0..n).map(|i| edge(i).norm() - saved(i)).sum()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(count: usize, shape: &Shape, apart_um: f64) -> Vec<Body> {
        (0..count)
            .map(|i| Body {
                shape: shape.clone(),
                center_um: [apart_um * i as f64, 0.0],
                rotation_rad: 0.0,
                eta: 1.55,
                kappa: 0.0,
                lumen: None,
            })
            .collect()
    }

    /// Merging is the first choice for many thick fibers, and never for one, few or thin ones, nor below its
    /// tolerance. Otherwise it precedes the plain solver.
    #[test]
    fn many_fibers_are_merged() {
        let wave = Wave { lambda_um: 0.4, theta_i: 0.0 };
        let oval = |a_um: f64| Shape::Ellipse { a_um, b_um: 0.8 * a_um };
        let first =
            |count: usize, shape: &Shape, tolerance: f64| by_shape(&row(count, shape, 30.0), &wave, tolerance)[0];
        assert_eq!(first(200, &oval(7.5), 1e-3), Method::Hierarchical);
        assert_eq!(first(37, &oval(7.5), 1e-3), Method::Hierarchical);
        assert_eq!(first(2, &oval(7.5), 1e-3), Method::Compressed);
        assert_eq!(first(19, &oval(0.5), 1e-3), Method::Compressed);
        assert_eq!(first(200, &oval(7.5), 1e-9), Method::Compressed);
        assert_eq!(first(1, &oval(7.5), 1e-3), Method::Nystrom);
        let circle = |radius_um: f64| Shape::Circle { radius_um };
        assert_eq!(first(7, &circle(7.5), 1e-3), Method::Multipole);
        assert_eq!(first(100, &circle(7.5), 1e-3), Method::Hierarchical);
        let all = by_shape(&row(2, &oval(1.0), 3.0), &wave, 1e-3);
        assert_eq!(all, [Method::Compressed, Method::Hierarchical, Method::Nystrom]);
    }

    /// A square of side 4 with arcs of radius 1 has four straight pieces of 2 and a circle of circumference.
    #[test]
    fn lengths_of_rounded_polygons() {
        let points_um = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let length = least_length(&Shape::Polygon { points_um, rounding_um: 1.0 });
        assert!((length - (8.0 + TAU)).abs() < 1e-12, "{length}");
    }
}
