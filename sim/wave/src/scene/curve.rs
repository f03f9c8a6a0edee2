//! Walls as curves of one periodic parameter, and the nodes of the trapezoidal rule on them.
//!
//! Circles, ellipses and Fourier outlines are analytic in their own parameter. A rounded polygon is a chain
//! of straight pieces and circular arcs whose curvature jumps at the joints, where the densities have weak
//! singularities `s^2 ln s`. Its parameter is graded: on a piece of length L, with tau in [0, 1] along it,
//! `ds/d tau` is proportional to `(1 - |1 - 2 tau|^(2 q))^(order - 1)`, which vanishes at the joints and is
//! flat away from them (Kress 1990 grades the whole piece; here only some nodes at its ends, to save nodes).
//!
//! Nodes are at `t_j = (j + 1/2) 2 pi / n`: off the joints, off the axes of mirror symmetry.

use crate::{Body, C64, Shape, WaveError};
use std::f64::consts::TAU;

/// Resolution of walls by nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resolution {
    /// Nodes per wavelength, in the optically denser medium beside the wall, for circles and ellipses.
    pub per_wavelength_ellipse: f64,
    /// Nodes per wavelength for other outlines.
    pub per_wavelength: f64,
    /// Additional nodes, per cube root of the wall's length in wavelengths over 2 pi, as for the order at
    /// which a Bessel series may stop.
    pub transition: f64,
    /// Natural logarithm of (ten over the tolerance).
    pub logarithm: f64,
    /// Order of the grading at joints, 1 for none.
    pub grading: i32,
    /// Nodes over which a joint's grading fades.
    pub fade_nodes: f64,
    /// Whether waves inside of a body may be unresolved where they decay on their way.
    pub skin: bool,
}

impl Resolution {
    /// Resolution for bodies. Between almost touching bodies there are shorter waves than along the wall of
    /// one.
    pub(crate) fn new(bodies: &[Body], tolerance: f64) -> Self {
        Self { skin: bodies.len() == 1, ..Self::for_tolerance(tolerance) }
    }

    /// Resolution for relative errors of `tolerance` in the far field, measured at 0.4 um and index 1.55 on
    /// circles of 0.2 to 7.5 um, ellipses of 1.6 and 16 um and a rounded triangle of 5 um. On a long wall the
    /// kernel and the density each hold waves of up to the denser medium's wavenumber, and the quadrature is
    /// exact if the nodes resolve their product: 4 per wavelength. Ellipses have few of the steepest waves
    /// (circles none); outlines that mix directions have more.
    pub(crate) fn for_tolerance(tolerance: f64) -> Self {
        let digits = -tolerance.log10();
        let per_wavelength = if digits < 6.0 { 3.6 + 0.33 * (digits - 3.0) } else { 4.6 + 0.22 * (digits - 6.0) };
        // Orders and fades by their accuracy on two triangles; short arcs need the longer fades.
        let (grading, per_digit) = match digits {
            ..=4.0 => (3, 1.3),
            ..=7.0 => (5, 1.8),
            _ => (7, 2.4),
        };
        Self {
            per_wavelength_ellipse: (3.4 + 0.095 * (digits - 3.0)).min(3.72),
            per_wavelength,
            transition: 4.0 + (digits - 3.0).max(0.0),
            logarithm: (10.0 / tolerance).ln(),
            grading,
            fade_nodes: per_digit * digits,
            skin: true,
        }
    }
}

/// Number of sample points on outlines before they get their nodes.
const SAMPLES: usize = 256;
/// Normals with a dot product below this face away from each other.
const FACING: f64 = -0.3;

/// A point of a wall and its derivatives by the parameter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurvePoint {
    /// Position [um].
    pub at: [f64; 2],
    /// Outward unit normal; the tangent is (-n_y, n_x).
    pub normal: [f64; 2],
    /// |dx/dt| [um].
    pub speed: f64,
    /// Curvature [1/um], positive where the outline is convex.
    pub curvature: f64,
}

/// A straight piece or an arc.
#[derive(Clone, Debug)]
struct WallPiece {
    start: [f64; 2],
    /// Direction of travel at the start [rad].
    heading: f64,
    curvature: f64,
    length: f64,
    /// Nodes on it, even, and those before it.
    nodes: usize,
    before: usize,
    grading: Grading,
}

/// The speed along a piece, `(1 - |1 - 2 tau|^(2 q))^(order - 1)` up to a factor.
#[derive(Clone, Copy, Debug)]
struct Grading {
    q: f64,
    order: i32,
}

#[derive(Clone, Debug)]
enum Outline {
    Fourier(Vec<(i32, C64)>),
    Pieces(Vec<WallPiece>),
}

/// A closed wall, counterclockwise, with its nodes.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    outline: Outline,
    /// Frame: x -> center + turn * x.
    center: C64,
    turn: C64,
    /// The nodes.
    pub nodes: Vec<CurvePoint>,
}

impl Grading {
    /// Integral of [`Self::speed`] over [0, tau], tau <= 1/2, in closed form.
    fn length(self, tau: f64) -> f64 {
        let v = 1.0 - 2.0 * tau;
        let (mut binomial, mut sum) = (1.0, 0.0);
        for k in 0..self.order {
            let exponent = 2.0 * self.q * k as f64 + 1.0;
            sum += binomial * (1.0 - v.powf(exponent)) / (2.0 * exponent);
            binomial *= -((self.order - 1 - k) as f64) / (k + 1) as f64;
        }
        sum
    }

    fn speed(self, tau: f64) -> f64 {
        (1.0 - (1.0 - 2.0 * tau).abs().powf(2.0 * self.q)).powi(self.order - 1)
    }
}

/// Order from which on the Fourier coefficients of curvature times speed stay below `tolerance` of the
/// largest.
fn harmonics(samples: &[CurvePoint], tolerance: f64) -> usize {
    let n = samples.len();
    let bend: Vec<f64> = samples.iter().map(|p| p.curvature * p.speed).collect();
    let unit: Vec<C64> = (0..n).map(|j| C64::from_polar(1.0, TAU * j as f64 / n as f64)).collect();
    let coefficient = |m: usize| (0..n).map(|j| bend[j] * unit[m * j % n]).sum::<C64>().norm();
    let sizes: Vec<f64> = (0..=n / 2).map(coefficient).collect();
    let largest = sizes.iter().fold(0.0, |a: f64, &b| a.max(b));
    sizes.iter().rposition(|&s| s > tolerance.max(1e-13) * largest).map_or(0, |m| m + 1)
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Fourier coefficients of an analytic shape, counterclockwise.
fn fourier_of(shape: &Shape) -> Option<Vec<(i32, C64)>> {
    let coeffs = match shape {
        Shape::Circle { radius_um } => vec![(1, C64::new(*radius_um, 0.0))],
        Shape::Ellipse { a_um, b_um } => {
            vec![(1, C64::new(0.5 * (a_um + b_um), 0.0)), (-1, C64::new(0.5 * (a_um - b_um), 0.0))]
        }
        Shape::Fourier { coeffs } => {
            // Twice the enclosed area over pi is the sum of k |c_k|^2.
            let area: f64 = coeffs.iter().map(|(k, c)| *k as f64 * c.norm_sqr()).sum();
            let sign = if area < 0.0 { -1 } else { 1 };
            coeffs.iter().map(|(k, c)| (sign * k, *c)).collect()
        }
        Shape::Polygon { .. } => return None,
    };
    Some(coeffs)
}

/// Straight pieces and arcs of a rounded polygon, counterclockwise, without nodes; the first starts in the
/// middle of an edge.
fn pieces_of(points: &[[f64; 2]], rounding: f64, key: &str) -> Result<Vec<WallPiece>, WaveError> {
    let mut points: Vec<C64> = points.iter().map(|p| C64::new(p[0], p[1])).collect();
    let n = points.len();
    let area: f64 = (0..n).map(|j| (points[j].conj() * points[(j + 1) % n]).im).sum();
    if area < 0.0 {
        points.reverse();
    }
    let edges: Vec<C64> = (0..n).map(|j| points[(j + 1) % n] - points[j]).collect();
    // Turn at the corner between edge j and edge j + 1, and the length that the arc removes from both.
    let turns: Vec<f64> = (0..n).map(|j| (edges[(j + 1) % n] / edges[j]).arg()).collect();
    let takes: Vec<f64> = turns.iter().map(|turn| rounding * (0.5 * turn.abs()).tan()).collect();
    let mut pieces = Vec::new();
    for j in 0..n {
        let before = takes[(j + n - 1) % n];
        let straight = edges[j].norm() - before - takes[j];
        if straight.is_nan() || straight < 0.0 || rounding <= 0.0 {
            return Err(WaveError::Invalid {
                key: format!("{key}.rounding_um"),
                value: rounding.to_string(),
                hint: "use a positive radius whose arcs fit on every edge".into(),
            });
        }
        let unit = edges[j] / edges[j].norm();
        let start = points[j] + unit * before;
        let piece = |start: C64, curvature: f64, length: f64| WallPiece {
            start: [start.re, start.im],
            heading: unit.arg(),
            curvature,
            length,
            nodes: 0,
            before: 0,
            grading: Grading { q: 1.0, order: 1 },
        };
        if straight > 1e-9 * edges[j].norm() {
            pieces.push(piece(start, 0.0, straight));
        }
        if turns[j].abs() > 1e-9 {
            pieces.push(piece(start + unit * straight, turns[j].signum() / rounding, rounding * turns[j].abs()));
        }
    }
    Ok(pieces)
}

impl WallPiece {
    /// Position, heading and curvature at arc length s.
    fn at(&self, s: f64) -> (C64, f64) {
        let turn = self.curvature * s;
        // Chord of an arc: s sinc(turn / 2) along the mean heading.
        let half = 0.5 * turn;
        let chord = if half.abs() < 1e-8 { s } else { s * half.sin() / half };
        let start = C64::new(self.start[0], self.start[1]);
        (start + C64::from_polar(chord, self.heading + half), self.heading + turn)
    }
}

impl Curve {
    /// The wall of `body` with nodes for a wavelength; `key` names it in errors.
    pub(crate) fn new(body: &Body, resolution: &Resolution, wavelength_um: f64, key: &str) -> Result<Self, WaveError> {
        let outline = match (&body.shape, fourier_of(&body.shape)) {
            (Shape::Polygon { points_um, rounding_um }, _) => Outline::Pieces(pieces_of(points_um, *rounding_um, key)?),
            (_, coeffs) => Outline::Fourier(coeffs.unwrap_or_default()),
        };
        let mut curve = Self {
            outline,
            center: C64::new(body.center_um[0], body.center_um[1]),
            turn: C64::from_polar(1.0, body.rotation_rad),
            nodes: Vec::new(),
        };
        let mut denser = 1.0;
        for _ in 0..4 {
            let n = curve.count(resolution, wavelength_um, denser);
            curve.nodes = (0..n).map(|j| curve.at(TAU * (j as f64 + 0.5) / n as f64, n)).collect();
            let short = resolution.logarithm / (TAU * curve.thickness_in_steps());
            if short <= 1.0 {
                break;
            }
            denser *= 1.05 * short;
        }
        Ok(curve)
    }

    /// Number of nodes, `denser` times those for the wavelength; sets those of pieces.
    fn count(&mut self, resolution: &Resolution, wavelength_um: f64, denser: f64) -> usize {
        let coeffs = match &mut self.outline {
            Outline::Pieces(pieces) => {
                let mut before = 0;
                for piece in pieces {
                    // A piece's nodes have the target density where the grading is flat.
                    let nodes = denser * piece.length * resolution.per_wavelength / wavelength_um;
                    // An integer, so that the speed is smooth in the middle.
                    let q = (0.5 * nodes / resolution.fade_nodes).floor().max(1.0);
                    piece.grading = Grading { q, order: resolution.grading };
                    let flat = 2.0 * piece.grading.length(0.5);
                    // Short arcs still need the grading resolved.
                    piece.nodes = 2 * (0.5 * nodes / flat - 1e-9).max(resolution.fade_nodes).ceil() as usize;
                    piece.before = before;
                    before += piece.nodes;
                }
                return before;
            }
            Outline::Fourier(coeffs) => coeffs,
        };
        let highest = coeffs.iter().map(|(k, _)| k.unsigned_abs()).max().unwrap_or(1);
        // Node sets keep the outline's rotations (z(t + 2 pi/m) = z rotated if m divides all k - 1) and
        // mirrors.
        let order = coeffs.iter().fold(0, |m, (k, _)| gcd(m, (k - 1).unsigned_abs()));
        let multiple = if order == 0 { 24 } else { 4 * order as usize / gcd(4, order) as usize };
        let samples: Vec<CurvePoint> =
            (0..SAMPLES).map(|j| self.at(TAU * j as f64 / SAMPLES as f64, SAMPLES)).collect();
        // The sparsest nodes set the count, where the parameter runs fastest: the number of wavelengths at
        // that speed.
        let waves = TAU * samples.iter().map(|p| p.speed).fold(0.0, f64::max) / wavelength_um;
        let ellipse = highest <= 1;
        let density = if ellipse { resolution.per_wavelength_ellipse } else { resolution.per_wavelength };
        let waving = density * waves + resolution.transition * waves.cbrt() + 4.0 * highest as f64;
        // The kernel's diagonal holds curvature times speed: its harmonics are those of the outline's bends.
        // The bends of an ellipse follow from its thinness.
        let bending = if ellipse { 0 } else { harmonics(&samples, (-resolution.logarithm).exp()) };
        ((denser * waving.max(bending as f64)).ceil() as usize).next_multiple_of(multiple)
    }

    /// Minimum distance between two parts of the wall that face each other from within, in local steps of its
    /// nodes: kernels between them are resolved to `exp(-2 pi steps)`.
    fn thickness_in_steps(&self) -> f64 {
        let h = self.step();
        self.thickness(|a, b| h * a.speed.max(b.speed))
    }

    /// Minimum distance between two facing parts of the wall [um].
    pub(crate) fn thickness_um(&self) -> f64 {
        self.thickness(|_, _| 1.0)
    }

    /// Minimum distance between two facing parts of the wall, in units that may depend on position.
    fn thickness(&self, unit: impl Fn(&CurvePoint, &CurvePoint) -> f64) -> f64 {
        let stride = self.nodes.len().div_ceil(SAMPLES);
        let mut min_squared = f64::MAX;
        for (j, a) in self.nodes.iter().enumerate().step_by(stride) {
            for b in self.nodes[j + 1..].iter().step_by(stride) {
                if a.normal[0] * b.normal[0] + a.normal[1] * b.normal[1] < FACING {
                    let squared = (a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2);
                    min_squared = min_squared.min(squared / unit(a, b).powi(2));
                }
            }
        }
        min_squared.sqrt()
    }

    /// The point at parameter t in [0, 2 pi), for a rule of n nodes (the grading of pieces depends on it).
    fn at(&self, t: f64, n: usize) -> CurvePoint {
        let (at, slope, curvature) = match &self.outline {
            Outline::Fourier(coeffs) => {
                let (mut z, mut z1, mut z2) = (C64::ZERO, C64::ZERO, C64::ZERO);
                for (k, c) in coeffs {
                    let k = *k as f64;
                    let term = c * C64::from_polar(1.0, k * t);
                    z += term;
                    z1 += C64::new(0.0, k) * term;
                    z2 -= k * k * term;
                }
                (z, z1, (z1.conj() * z2).im / z1.norm().powi(3))
            }
            Outline::Pieces(pieces) => {
                let at = t / TAU * n as f64;
                let index = pieces.partition_point(|p| p.before as f64 <= at).max(1) - 1;
                let piece = &pieces[index];
                let tau = ((at - piece.before as f64) / piece.nodes as f64).clamp(0.0, 1.0);
                let whole = 2.0 * piece.grading.length(0.5);
                let part = if tau <= 0.5 {
                    piece.grading.length(tau) / whole
                } else {
                    1.0 - piece.grading.length(1.0 - tau) / whole
                };
                let (z, heading) = piece.at(piece.length * part);
                let per_t = n as f64 / (TAU * piece.nodes as f64);
                let speed = piece.length * piece.grading.speed(tau) / whole * per_t;
                (z, C64::from_polar(speed, heading), piece.curvature)
            }
        };
        let z = self.center + self.turn * at;
        let slope = self.turn * slope;
        let speed = slope.norm();
        // n = -i t.
        CurvePoint { at: [z.re, z.im], normal: [slope.im / speed, -slope.re / speed], speed, curvature }
    }

    /// The point at parameter t, any real number.
    pub(crate) fn point(&self, t: f64) -> CurvePoint {
        self.at(t.rem_euclid(TAU), self.nodes.len())
    }

    /// Parameter of node j.
    pub(crate) fn parameter(&self, j: usize) -> f64 {
        TAU * (j as f64 + 0.5) / self.nodes.len() as f64
    }

    /// Step of the parameter between nodes.
    pub(crate) fn step(&self) -> f64 {
        TAU / self.nodes.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn body(shape: Shape) -> Body {
        Body { shape, center_um: [0.3, -0.2], rotation_rad: 0.4, eta: 1.5, kappa: 0.0, lumen: None }
    }

    fn triangle() -> Shape {
        let corner = |j: i32| {
            let a = TAU * j as f64 / 3.0;
            [5.0 * a.cos(), 5.0 * a.sin()]
        };
        Shape::Polygon { points_um: vec![corner(0), corner(1), corner(2)], rounding_um: 0.5 }
    }

    /// Lengths, areas and the turn by 2 pi of closed curves, through the nodes' weights; also for outlines
    /// given clockwise.
    #[test]
    fn curves_close() {
        let side = 5.0 * 3f64.sqrt();
        let cut = 0.5 * (PI / 3.0).tan();
        let length = 3.0 * (side - 2.0 * cut) + PI;
        // Each corner loses the kite of two right triangles (cut, rounding) less a sector of 120 degrees.
        let area = 3f64.sqrt() / 4.0 * side * side - 3.0 * (cut * 0.5 - PI / 3.0 * 0.25);
        let reversed = match triangle() {
            Shape::Polygon { mut points_um, rounding_um } => {
                points_um.reverse();
                Shape::Polygon { points_um, rounding_um }
            }
            other => other,
        };
        let fourier = Shape::Fourier { coeffs: vec![(-1, C64::new(2.0, 0.0)), (2, C64::new(0.1, 0.2))] };
        let cases = [
            (Shape::Circle { radius_um: 2.0 }, Some(4.0 * PI), 4.0 * PI, 1e-12),
            (Shape::Ellipse { a_um: 1.6, b_um: 1.0 }, None, 1.6 * PI, 1e-12),
            (fourier, None, PI * (4.0 - 2.0 * 0.05), 1e-12),
            // The rule's own error at the graded joints.
            (triangle(), Some(length), area, 1e-5),
            (reversed, Some(length), area, 1e-5),
        ];
        let resolution = Resolution { grading: 5, fade_nodes: 12.0, ..Resolution::for_tolerance(1e-9) };
        for (shape, length, area, tolerance) in cases {
            let curve = Curve::new(&body(shape.clone()), &resolution, 0.2, "fiber[0]").unwrap();
            let h = curve.step();
            let sum = |f: &dyn Fn(&CurvePoint) -> f64| -> f64 { curve.nodes.iter().map(|p| f(p) * p.speed * h).sum() };
            let turn = sum(&|p| p.curvature);
            let got = 0.5 * sum(&|p| p.at[0] * p.normal[0] + p.at[1] * p.normal[1]);
            assert!((turn - TAU).abs() < tolerance, "{shape:?}: turn {turn}");
            assert!((got - area).abs() < tolerance * area, "{shape:?}: area {got}, want {area}");
            if let Some(length) = length {
                let got = sum(&|_| 1.0);
                assert!((got - length).abs() < tolerance * length, "{shape:?}: length {got}, want {length}");
            }
        }
    }

    #[test]
    fn arcs_that_do_not_fit_are_refused() {
        let points_um = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let shape = Shape::Polygon { points_um, rounding_um: 0.6 };
        assert!(matches!(
            Curve::new(&body(shape), &Resolution::for_tolerance(1e-3), 0.1, "fiber[0]"),
            Err(WaveError::Invalid { .. })
        ));
    }
}
