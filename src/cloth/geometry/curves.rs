//! Ply curves: uniform cubic B-splines that are periodic up to a vector of the cell.
//!
//! [`ClothCurves`] is the geometry of a cloth: the cell, its yarns, and the control points of their plies, as
//! read from TOML (docs/reference/format/cloth.md) and stored in cloth files. Curves through given points are
//! computed by a fixed-point iteration for the control points.

use crate::cloth::Lattice;
use crate::math::vec3::dot;
use crate::spec::rules::invalid;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Largest number of control points of all curves of a cloth.
pub const MAX_CURVE_POINTS: usize = 1 << 21;
/// Number of iterations that compute control points from points on the curve; each halves the error.
const ROUNDS: usize = 60;
/// Largest coordinate [um].
const MAX_UM: f64 = 1e8;
/// Largest number of vectors of the cell in a period or a step, and between the origin and a point.
const MAX_STEPS: u32 = 1 << 20;

/// The geometry of a cloth: its cell, its yarns, and the curves of their plies. z is the normal of the face.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClothCurves {
    /// The two vectors of the plane by which the cloth repeats [um].
    pub cell_um: [[f64; 2]; 2],
    /// Yarns of one cell.
    #[serde(rename = "yarn")]
    pub yarns: Vec<ClothYarn>,
    /// Curves of one cell.
    #[serde(rename = "curve")]
    pub curves: Vec<PlyCurve>,
}

/// A yarn of the cell. Its images in other cells are different yarns, except along its own period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClothYarn {
    /// Which yarn of the spec: 0 is the warp or the yarn of a knit, 1 the weft.
    pub kind: u32,
    /// Number among the yarns of its kind: end, pick or course.
    pub number: i32,
    /// Increase of the number along each vector of the cell.
    pub step: [i32; 2],
    /// The vectors of the cell after which the yarn repeats itself.
    pub period: [i32; 2],
}

/// The axis of a ply or of a bundle of filaments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlyCurve {
    /// Index of its yarn.
    pub yarn: u32,
    /// Radius R [um].
    pub radius_um: f64,
    /// The period, in vectors of the cell: a whole multiple of the yarn's own period, more than one where
    /// plies change places by twist.
    pub shift: [i32; 2],
    /// Control points of the uniform cubic B-spline over one period [um].
    pub control_um: Vec<[f64; 3]>,
    /// Numbers of equal parts of the period: parts of the cloth's curves with the same number have the same
    /// surroundings. Empty if that is unknown; files do not keep it.
    #[serde(skip)]
    pub alike: Vec<u32>,
}

/// A point of a curve with its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct CurvePoint {
    /// The point [um].
    pub point_um: [f64; 3],
    /// First derivative with respect to the parameter, which increases by 1 from knot to knot [um].
    pub d_um: [f64; 3],
    /// Second derivative [um].
    pub dd_um: [f64; 3],
}

impl CurvePoint {
    /// Curvature [1/um].
    pub fn curvature_per_um(&self) -> f64 {
        let c = crate::math::vec3::cross(self.d_um, self.dd_um);
        let speed2 = dot(self.d_um, self.d_um).max(1e-300);
        (dot(c, c) / (speed2 * speed2 * speed2)).sqrt()
    }
}

impl PlyCurve {
    /// The curve through points of one period [um]; the point after the last is the first, translated by
    /// `shift`.
    pub fn through(yarn: u32, radius_um: f64, shift: [i32; 2], points_um: &[[f64; 3]], lattice: &Lattice) -> PlyCurve {
        let period = lattice.vector(shift);
        let n = points_um.len();
        // A uniformly divided straight line is its own control polygon: only the periodic part is unknown.
        let even = |i: usize| [0, 1].map(|k| period[k] * i as f64 / n as f64);
        let periodic: Vec<[f64; 3]> = points_um
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let e = even(i);
                [p[0] - e[0], p[1] - e[1], p[2]]
            })
            .collect();
        let mut control = periodic.clone();
        for _ in 0..ROUNDS {
            let last = control.clone();
            for i in 0..n {
                let (before, after) = (last[(i + n - 1) % n], last[(i + 1) % n]);
                control[i] = std::array::from_fn(|k| 1.5 * periodic[i][k] - 0.25 * (before[k] + after[k]));
            }
        }
        for (i, c) in control.iter_mut().enumerate() {
            let e = even(i);
            c[0] += e[0];
            c[1] += e[1];
        }
        PlyCurve { yarn, radius_um, shift, control_um: control, alike: Vec::new() }
    }

    /// The same curve with twice the knots: knot `i` of this curve is knot `2 i` of the result (Lane and
    /// Riesenfeld 1980).
    #[must_use]
    pub fn refined(&self, lattice: &Lattice) -> PlyCurve {
        let period = lattice.vector(self.shift);
        let n = self.control_um.len();
        let control = |i: usize| {
            // Indices start at the last control point of the period before.
            let [x, y, z] = self.control_um[(i + n - 1) % n];
            let turns = i.div_ceil(n) as f64 - 1.0;
            [x + turns * period[0], y + turns * period[1], z]
        };
        let mut control_um = Vec::with_capacity(2 * n);
        for i in 0..n {
            let [before, here, after] = [0, 1, 2].map(|k| control(i + k));
            control_um.push(std::array::from_fn(|k| (before[k] + 6.0 * here[k] + after[k]) / 8.0));
            control_um.push(std::array::from_fn(|k| 0.5 * (here[k] + after[k])));
        }
        PlyCurve { control_um, ..self.clone() }
    }

    /// Evaluates the curve at a parameter: knot `i` is near control point `i`, and the period is their
    /// number.
    pub fn at(&self, lattice: &Lattice, parameter: f64) -> CurvePoint {
        let n = self.control_um.len() as i64;
        let (first, t) = (parameter.floor(), parameter - parameter.floor());
        let control = |i: i64| -> [f64; 3] {
            let at = first as i64 + i;
            let turns = at.div_euclid(n);
            let mut p = self.control_um[at.rem_euclid(n) as usize];
            let v = lattice.vector(self.shift);
            p[0] += turns as f64 * v[0];
            p[1] += turns as f64 * v[1];
            p
        };
        let p = [-1, 0, 1, 2].map(control);
        let sum = |w: [f64; 4]| std::array::from_fn(|k| (0..4).map(|i| w[i] * p[i][k]).sum());
        let u = 1.0 - t;
        CurvePoint {
            point_um: sum([
                u * u * u / 6.0,
                (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
                (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
                t * t * t / 6.0,
            ]),
            d_um: sum([-0.5 * u * u, 1.5 * t * t - 2.0 * t, -1.5 * u * u + 2.0 * u, 0.5 * t * t]),
            dd_um: sum([u, 3.0 * t - 2.0, 1.0 - 3.0 * t, t]),
        }
    }

    /// Length of one period [um], by two-point Gauss quadrature from knot to knot.
    pub fn length_um(&self, lattice: &Lattice) -> f64 {
        let speed = |u: f64| {
            let d = self.at(lattice, u).d_um;
            dot(d, d).sqrt()
        };
        let g = 0.5 / 3f64.sqrt();
        (0..self.control_um.len()).map(|i| 0.5 * (speed(i as f64 + 0.5 - g) + speed(i as f64 + 0.5 + g))).sum()
    }

    /// Number of its yarn's own periods in one period of the curve.
    pub fn turns(&self, yarn: &ClothYarn) -> usize {
        let of = |k: usize| if yarn.period[k] == 0 { 0 } else { (self.shift[k] / yarn.period[k]).max(0) as usize };
        of(0).max(of(1)).max(1)
    }
}

impl ClothCurves {
    /// Reads curves from TOML.
    ///
    /// # Errors
    /// [`Error::Format`] for text that is not TOML of this form, and the errors of [`ClothCurves::check`].
    pub fn parse(text: &str, file: &str) -> Result<ClothCurves> {
        let curves: ClothCurves = toml::from_str(text).map_err(|e| Error::Format {
            file: file.into(),
            what: crate::one_line(e.message(), 120),
            hint: "use cell_um, [[yarn]] and [[curve]] as docs/reference/format/cloth.md has them".into(),
        })?;
        curves.check(file)?;
        Ok(curves)
    }

    /// The curves as TOML.
    pub fn to_toml(&self) -> String {
        // Every value is a number or a list of numbers, which TOML can represent.
        toml::to_string(self).unwrap_or_default()
    }

    /// The lattice of the cell.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the two vectors are parallel.
    pub fn lattice(&self, file: &str) -> Result<Lattice> {
        Lattice::new(self.cell_um).ok_or_else(|| {
            invalid(file, "cell_um", format!("{:?}", self.cell_um), "use two vectors that are not parallel")
        })
    }

    /// Checks all values.
    ///
    /// # Errors
    /// [`Error::Invalid`] for the first value that is out of range.
    pub fn check(&self, file: &str) -> Result<()> {
        let lattice = self.lattice(file)?;
        if self.curves.is_empty() {
            return Err(invalid(file, "curve", "(absent)", "give at least one curve"));
        }
        let count: usize = self.curves.iter().map(|c| c.control_um.len()).sum();
        if count > MAX_CURVE_POINTS {
            return Err(invalid(file, "curve", format!("{count} points"), format!("use {MAX_CURVE_POINTS} or fewer")));
        }
        let is_small = |steps: &[i32; 2]| steps.iter().all(|s| s.unsigned_abs() <= MAX_STEPS);
        for (i, yarn) in self.yarns.iter().enumerate() {
            if !is_small(&yarn.period) || !is_small(&yarn.step) {
                let value = format!("{:?}, {:?}", yarn.period, yarn.step);
                return Err(invalid(
                    file,
                    &format!("yarn[{i}].period"),
                    value,
                    format!("use numbers within {MAX_STEPS}"),
                ));
            }
            if yarn.period == [0, 0] {
                let key = format!("yarn[{i}].period");
                return Err(invalid(file, &key, "[0, 0]", "a yarn that closes in itself is no yarn of a cloth"));
            }
        }
        for (i, curve) in self.curves.iter().enumerate() {
            let key = |name: &str| format!("curve[{i}].{name}");
            let Some(yarn) = self.yarns.get(curve.yarn as usize) else {
                return Err(invalid(file, &key("yarn"), curve.yarn, format!("use 0 to {}", self.yarns.len())));
            };
            if !(curve.radius_um > 0.0 && curve.radius_um < 1e4) {
                return Err(invalid(file, &key("radius_um"), curve.radius_um, "use a number above 0 and below 10000"));
            }
            if curve.control_um.len() < 4 {
                let hint = "use at least 4 points a period";
                return Err(invalid(file, &key("control_um"), format!("{} points", curve.control_um.len()), hint));
            }
            if let Some(p) = curve.control_um.as_flattened().iter().find(|p| !p.is_finite() || p.abs() > MAX_UM) {
                return Err(invalid(file, &key("control_um"), p, "use numbers within 1e8 um"));
            }
            let cells = |p: &[f64; 3]| lattice.fractions(p[0], p[1]).map(f64::abs);
            if let Some(p) = curve.control_um.iter().find(|p| cells(p).iter().any(|f| *f > f64::from(MAX_STEPS))) {
                let hint = format!("use points within {MAX_STEPS} cells");
                return Err(invalid(file, &key("control_um"), format!("{p:?}"), hint));
            }
            if !is_small(&curve.shift) {
                let value = format!("{:?}", curve.shift);
                return Err(invalid(file, &key("shift"), value, format!("use numbers within {MAX_STEPS}")));
            }
            let turns = curve.turns(yarn) as i32;
            if curve.shift != yarn.period.map(|p| p.wrapping_mul(turns)) {
                let hint = format!("use a whole number of times the yarn's period, {:?}", yarn.period);
                return Err(invalid(file, &key("shift"), format!("{:?}", curve.shift), hint));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix() -> (Lattice, Vec<[f64; 3]>) {
        let lattice = Lattice::new([[300.0, 20.0], [0.0, 200.0]]).unwrap();
        let v = lattice.vector([1, 0]);
        let points = (0..48)
            .map(|i| {
                let t = i as f64 / 48.0;
                let (s, c) = (std::f64::consts::TAU * t).sin_cos();
                [t * v[0] - 40.0 * c * v[1] / v[0], t * v[1] + 40.0 * c, 40.0 * s]
            })
            .collect();
        (lattice, points)
    }

    #[test]
    fn a_curve_goes_through_its_points_and_on_periodically() {
        let (lattice, points) = helix();
        let curve = PlyCurve::through(0, 10.0, [1, 0], &points, &lattice);
        for (i, p) in points.iter().enumerate() {
            let at = curve.at(&lattice, i as f64).point_um;
            let beyond = curve.at(&lattice, i as f64 + 96.0).point_um;
            let v = lattice.vector([2, 0]);
            for k in 0..3 {
                assert!((at[k] - p[k]).abs() < 1e-9, "{at:?} {p:?}");
                assert!((beyond[k] - at[k] - [v[0], v[1], 0.0][k]).abs() < 1e-9);
            }
        }
        // Derivatives are compared with finite differences.
        for u in [0.3, 11.7, 47.9] {
            let (a, b, m) = (curve.at(&lattice, u - 1e-4), curve.at(&lattice, u + 1e-4), curve.at(&lattice, u));
            for k in 0..3 {
                assert!((m.d_um[k] - (b.point_um[k] - a.point_um[k]) / 2e-4).abs() < 1e-5);
                assert!((m.dd_um[k] - (b.d_um[k] - a.d_um[k]) / 2e-4).abs() < 1e-5);
            }
        }
    }

    /// Refinement holds for one, two and many points per period.
    #[test]
    fn a_refined_curve_is_the_same_curve() {
        let (lattice, points) = helix();
        for count in [1, 2, 3, 48] {
            let curve = PlyCurve::through(0, 10.0, [1, 0], &points[..count], &lattice);
            let fine = curve.refined(&lattice);
            assert_eq!(fine.control_um.len(), 2 * count);
            for u in [-3.3, 0.0, 0.4, 1.0, 7.7] {
                let (a, b) = (curve.at(&lattice, u).point_um, fine.at(&lattice, 2.0 * u).point_um);
                assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-9), "{count} at {u}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn lengths_and_curvatures_are_those_of_a_helix() {
        let (lattice, points) = helix();
        let curve = PlyCurve::through(0, 10.0, [1, 0], &points, &lattice);
        let v = lattice.vector([1, 0]);
        let (pitch, r) = (v[0].hypot(v[1]), 40.0 * (1.0 + (v[1] / v[0]).powi(2)).sqrt());
        let want = pitch.hypot(std::f64::consts::TAU * r);
        // The cross section of the helix is slightly elliptical because the points keep their height.
        assert!((curve.length_um(&lattice) / want - 1.0).abs() < 3e-3);
        let c = pitch / std::f64::consts::TAU;
        let kappa = curve.at(&lattice, 10.0).curvature_per_um();
        assert!((kappa * (r * r + c * c) / r - 1.0).abs() < 0.02, "{kappa}");
    }

    #[test]
    fn a_file_comes_back_and_bad_ones_are_refused() {
        let (lattice, points) = helix();
        let curve = PlyCurve::through(0, 10.0, [1, 0], &points, &lattice);
        let yarn = ClothYarn { kind: 0, number: 0, step: [0, 1], period: [1, 0] };
        let cloth = ClothCurves { cell_um: lattice.cell_um, yarns: vec![yarn], curves: vec![curve] };
        let text = cloth.to_toml();
        assert_eq!(ClothCurves::parse(&text, "x.toml").unwrap(), cloth);
        for (from, to, want) in [
            ("radius_um = 10.0", "radius_um = -1.0", "curve[0].radius_um = -1"),
            ("shift = [1, 0]", "shift = [0, 1]", "curve[0].shift = [0, 1]: use a whole number of times"),
            ("period = [1, 0]", "period = [0, 0]", "yarn[0].period"),
            ("cell_um = [[300.0, 20.0], [0.0, 200.0]]", "cell_um = [[1.0, 0.0], [2.0, 0.0]]", "not parallel"),
            ("kind = 0", "kind = \"warp\"", "use cell_um, [[yarn]]"),
        ] {
            assert!(text.contains(from), "{from}\n{text}");
            let message = ClothCurves::parse(&text.replacen(from, to, 1), "x.toml").unwrap_err().to_string();
            assert!(message.contains(want) && message.lines().count() == 1, "{message}");
        }
    }
}
