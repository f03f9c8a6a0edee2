//! Displacements along a ply for paths through a cloth, with the weights of its absorptions, and the places
//! on curves to which they lead.

use plywave::PlyModel;
use plywave::cloth::light::{SIGMA_PER_UM, SIGMAS};
use plywave::cloth::{ClothLines, Lattice};
use plywave::math::vec3::{cross, dot};
use plywave::ply::{DRIFT_BINS, DRIFT_QUANTILES, EXIT_LENGTH_UM, drift_bin};

/// A displacement in units of R, and the light that leaves by it at each node of absorption, relative to that
/// of clear fibers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Displacement {
    pub over_r: f32,
    pub weights: [f32; SIGMAS],
}

/// Displacements of a model `[M][bin][quantile]`.
pub(super) struct Drift {
    rows: usize,
    per_theta: f32,
    all: Vec<Displacement>,
}

impl Drift {
    /// The displacements of a model; `None` for a model without exits.
    pub(super) fn new(model: &PlyModel) -> Option<Drift> {
        let data = model.data();
        let drift = &data.exits.as_ref()?.drift;
        let (rows, sigmas) = (data.theta_i.len(), data.sigma_per_um.len());
        // Shares are linear in v = 1 / (1 + sigma L) between the model's absorptions.
        let v = |sigma: f64| 1.0 / (1.0 + EXIT_LENGTH_UM * sigma);
        let places = SIGMA_PER_UM.map(|sigma| {
            let v_here = v(f64::from(sigma));
            let node = (0..sigmas).rev().find(|i| data.sigma_per_um[*i] <= f64::from(sigma)).unwrap_or(0);
            match data.sigma_per_um.get(node + 1) {
                Some(next) => (node, (v(data.sigma_per_um[node]) - v_here) / (v(data.sigma_per_um[node]) - v(*next))),
                None => (node, 0.0),
            }
        });
        let displacement = |(at, share): (&f64, &[f64])| {
            let at_sigma = |(node, t): (usize, f64)| (1.0 - t) * share[node] + t * share[(node + 1).min(sigmas - 1)];
            let weight = |place| (at_sigma(place) * DRIFT_QUANTILES as f64) as f32;
            Displacement { over_r: *at as f32, weights: places.map(weight) }
        };
        let all = drift.at.iter().zip(drift.share.chunks_exact(sigmas)).map(displacement).collect();
        Some(Drift { rows, per_theta: ((rows - 1) as f64 / data.theta_i[rows - 1]) as f32, all })
    }

    /// Draws a displacement of clear fibers' light by two random numbers. `cosine` is that between the
    /// outgoing direction and the ply's axis.
    pub(super) fn draw(&self, theta_i: f32, cosine: f32, [u, v]: [f32; 2]) -> Displacement {
        let sign = 1f32.copysign(theta_i);
        let at = (theta_i.abs() * self.per_theta).min((self.rows - 1) as f32);
        let row = ((at + u) as usize).min(self.rows - 1);
        let bin = drift_bin(sign * cosine);
        let part = ((v * DRIFT_QUANTILES as f32) as usize).min(DRIFT_QUANTILES - 1);
        let found = self.all[(row * DRIFT_BINS + bin) * DRIFT_QUANTILES + part];
        Displacement { over_r: sign * found.over_r, ..found }
    }
}

/// Longest step along a curve, in radii.
const STEP: f32 = 0.5;

/// A place on a curve.
pub(super) struct Place {
    /// Parameter, which may lie beyond the curve's period.
    pub parameter: f32,
    /// Point of the axis [um].
    pub center_um: [f32; 3],
    /// Unit tangent.
    pub tangent: [f32; 3],
}

/// The place at a parameter of a curve, and the one at a signed arc length from it [um].
pub(super) fn along(
    lines: &ClothLines,
    lattice: &Lattice,
    (curve, parameter): (usize, f32),
    length_um: f32,
) -> [Place; 2] {
    let knots = lines.knots(curve) as f32;
    let period_um = lattice.vector(lines.shift(curve));
    let place = |parameter: f32| {
        let turns = (parameter / knots).floor();
        let at = lines.axis_at(curve, (parameter - turns * knots).clamp(0.0, knots));
        let [x, y, z] = at.center_um;
        let center_um = [x + turns * period_um[0] as f32, y + turns * period_um[1] as f32, z];
        Place { parameter, center_um, tangent: at.axis }
    };
    let speed = |parameter: f32| lines.speed_um(curve, parameter.rem_euclid(knots)).max(1e-3);
    let steps = (length_um.abs() / (STEP * lines.radius_um(curve))).ceil();
    let step = length_um / steps.max(1.0);
    let mut at = parameter;
    for _ in 0..steps as usize {
        // The midpoint rule.
        at += step / speed(at + 0.5 * step / speed(at));
    }
    [place(parameter), place(at)]
}

/// A direction turned as the unit tangent `from` turns into `to`, about the axis that is normal to both.
pub(super) fn turned(d: [f32; 3], from: [f32; 3], to: [f32; 3]) -> [f32; 3] {
    let (axis, cosine) = (cross(from, to), dot(from, to));
    let (sideways, along) = (cross(axis, d), dot(axis, d) / (1.0 + cosine).max(1e-3));
    std::array::from_fn(|i| cosine * d[i] + sideways[i] + along * axis[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::cloth::{ClothCurves, ClothYarn, PlyCurve};

    /// Arc lengths of a wave that continues in the next cell are those of a fine polygon through its points,
    /// and turned directions keep their length and their angle with the tangent.
    #[test]
    fn lengths_are_arc_lengths() {
        let cell_um = [[600.0, 0.0], [0.0, 300.0]];
        let yarn = ClothYarn { kind: 0, number: 0, step: [0, 1], period: [1, 0] };
        let mut cloth = ClothCurves { cell_um, yarns: vec![yarn], curves: Vec::new() };
        let lattice = cloth.lattice("wave").unwrap();
        let wave = |x: f64| {
            [x, 40.0 * (x / 600.0 * std::f64::consts::TAU).cos(), 90.0 * (x / 300.0 * std::f64::consts::TAU).sin()]
        };
        let points: Vec<_> = (0..48).map(|i| wave(600.0 * f64::from(i) / 48.0)).collect();
        cloth.curves.push(PlyCurve::through(0, 50.0, [1, 0], &points, &lattice));
        let lines = ClothLines::new(&cloth).unwrap();
        for (from, length_um) in [(3.7f32, 400.0f32), (3.7, -400.0), (40.0, 900.0), (0.2, 12.0)] {
            let [start, end] = along(&lines, &lattice, (0, from), length_um);
            let (a, b) = (f64::from(start.center_um[0]), f64::from(end.center_um[0]));
            let steps = 20_000;
            let at = |i: usize| wave(a + (b - a) * i as f64 / steps as f64);
            let distance = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt();
            let length: f64 = (0..steps).map(|i| distance(at(i), at(i + 1))).sum::<f64>() * (b - a).signum();
            assert!((length - f64::from(length_um)).abs() < 0.01 * length.abs() + 0.1, "{length} for {length_um}");
            assert!(distance(wave(b), end.center_um.map(f64::from)) < 0.5, "{:?}", end.center_um);
            let d = [0.36, 0.48, -0.8f32];
            let turned = turned(d, start.tangent, end.tangent);
            assert!((dot(turned, turned) - 1.0).abs() < 1e-5);
            assert!((dot(turned, end.tangent) - dot(d, start.tangent)).abs() < 1e-5);
        }
    }
}
