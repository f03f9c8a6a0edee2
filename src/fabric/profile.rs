//! The height of a yarn's axis from crossing to crossing: Peirce's arcs and straight lines (Peirce 1937, The
//! geometry of cloth structure).
//!
//! Over a crossing the axis lies at +A or -A, A the yarn's amplitude. From a crossing where it is on top to
//! the next, a distance S further, where it is below, it runs on an arc about the yarn that it crosses,
//! straight, and on an arc about the next. With arcs of radius rho up to the angle theta and half a straight
//! line of length l,
//!
//! `S / 2 = rho sin theta + l cos theta`, `A = rho (1 - cos theta) + l sin theta`,
//!
//! the line is the inner tangent of two circles whose centers lie S apart and `2 (rho - A)` in height:
//! `theta = asin(2 rho / d) - atan(2 (rho - A) / S)`, `d^2 = S^2 + 4 (rho - A)^2`. With rho the sum of the
//! two yarns' radii and amplitudes that add up to it, round yarns touch along the arcs and intersect nowhere:
//! of two points on the axes, x and y from the crossing, the squared distance is
//! `rho^2 + 2 (rho - a) (rho - b)`, `a^2 = rho^2 - x^2`, `b^2 = rho^2 - y^2`. Arcs of that radius fit as long
//! as `rho <= (S^2 / 4 + A^2) / (2 A)`, where l is 0 and the cloth is jammed; yarns that lie closer have
//! shorter arcs, lean by [`STEEPEST_DEG`] at most where any arc does, and intersect.

/// Greatest lean of an axis whose arcs are shorter than its yarn's widths ask for [degrees].
const STEEPEST_DEG: f64 = 66.0;

/// A yarn's way from a crossing where it is on top to one where it is below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profile {
    /// Distance of the crossings [um].
    pub step: f64,
    /// Height over the crossings [um].
    pub amplitude: f64,
    /// Radius of the arcs [um].
    pub radius: f64,
    /// Length of an arc along the cloth [um].
    arc: f64,
    /// Slope of the straight line.
    slope: f64,
}

impl Profile {
    /// Of an amplitude, between crossings a distance `step` apart, of yarns whose radii add up to `radii`
    /// [um].
    pub fn new(amplitude: f64, step: f64, radii: f64) -> Profile {
        let flat = Profile { step, amplitude, radius: radii, arc: 0.0, slope: 0.0 };
        if amplitude <= 0.0 {
            return flat;
        }
        let jammed = (0.25 * step * step + amplitude * amplitude) / (2.0 * amplitude);
        let mut radius = radii.min(jammed);
        let steepest = STEEPEST_DEG.to_radians();
        if angle(amplitude, step, radius) > steepest {
            radius = (0.5 * step * steepest.tan() - amplitude) / (1.0 / steepest.cos() - 1.0);
        }
        let radius = radius.clamp(0.02 * step, jammed);
        let angle = angle(amplitude, step, radius);
        Profile { radius, arc: (radius * angle.sin()).min(0.5 * step), slope: angle.tan(), ..flat }
    }

    /// Height [um], slope and second derivative [1/um] at `x` um from the crossing where the yarn is on top,
    /// 0 to `step`.
    pub fn at(&self, x: f64) -> [f64; 3] {
        let (sign, x) = if x > 0.5 * self.step { (-1.0, self.step - x) } else { (1.0, x) };
        if x >= self.arc {
            return [sign * self.slope * (0.5 * self.step - x), -self.slope, 0.0];
        }
        let depth = (self.radius * self.radius - x * x).sqrt();
        let [height, slope] = [self.amplitude - self.radius + depth, -x / depth];
        [sign * height, slope, -sign * self.radius * self.radius / (depth * depth * depth)]
    }

    pub fn single(&self) -> Profile32 {
        let [step, amplitude, radius, arc, slope] =
            [self.step, self.amplitude, self.radius, self.arc, self.slope].map(|v| v as f32);
        Profile32 { step, amplitude, radius, arc, slope }
    }
}

/// Lean of the straight line between arcs of this radius [rad].
fn angle(amplitude: f64, step: f64, radius: f64) -> f64 {
    let rise = 2.0 * (radius - amplitude);
    (2.0 * radius / (step * step + rise * rise).sqrt()).min(1.0).asin() - rise.atan2(step)
}

/// The amplitude with which a yarn leans by `angle` [rad] at most.
pub(super) fn amplitude_of(angle: f64, step: f64, radii: f64) -> f64 {
    if radii * angle.sin() < 0.5 * step {
        0.5 * step * angle.tan() - radii * (1.0 / angle.cos() - 1.0)
    } else {
        0.5 * step * (0.5 * angle).tan()
    }
}

/// A [`Profile`] in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Profile32 {
    pub step: f32,
    pub amplitude: f32,
    pub radius: f32,
    pub arc: f32,
    pub slope: f32,
}

impl Profile32 {
    /// Greatest slope of the axis.
    pub fn steepest(&self) -> f32 {
        self.slope
    }

    /// Height [um] and slope at the share `u` of the way from a crossing to the next, on top at each or not.
    #[inline]
    pub fn joined(&self, from: bool, to: bool, u: f32) -> (f32, f32) {
        self.on(Ends::new(from, to), u)
    }

    /// As [`Profile32::joined`]. Both pieces are computed and one is chosen: which it is changes from call to
    /// call, and a wrong guess of the processor costs more.
    #[inline]
    pub fn on(&self, ends: Ends, u: f32) -> (f32, f32) {
        let (turned, x, depth) = self.arc_at(u);
        let on_line = x >= self.arc;
        let height = if on_line { self.slope * (0.5 * self.step - x) } else { self.amplitude - self.radius + depth };
        let slope = if on_line { -self.slope } else { -x / depth };
        let height = if ends.bends { turned * height } else { self.amplitude };
        (ends.side * height, if ends.bends { ends.side * slope } else { 0.0 })
    }

    /// Height [um] at the share `u` of the way from a crossing where the yarn is on top to one where it is
    /// below, and the squared cosine of its lean.
    #[inline]
    pub fn bent(&self, u: f32) -> (f32, f32) {
        let (turned, x, depth) = self.arc_at(u);
        let on_line = x >= self.arc;
        let height = if on_line { self.slope * (0.5 * self.step - x) } else { self.amplitude - self.radius + depth };
        let arc = depth / self.radius;
        (turned * height, if on_line { 1.0 / (1.0 + self.slope * self.slope) } else { arc * arc })
    }

    /// Sign of the height, distance to the nearer crossing, and height of the arc over its center there [um].
    #[inline]
    fn arc_at(&self, u: f32) -> (f32, f32, f32) {
        let far = u > 0.5;
        let x = self.step * if far { 1.0 - u } else { u };
        let depth = (self.radius * self.radius - x * x).max(f32::MIN_POSITIVE).sqrt();
        (if far { -1.0 } else { 1.0 }, x, depth)
    }
}

/// How a yarn lies between two crossings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends {
    /// Sign of its height at the crossing before.
    pub side: f32,
    /// Whether it lies on the other side at the next.
    pub bends: bool,
}

impl Ends {
    /// On top or not at the crossing before and the next.
    pub fn new(from: bool, to: bool) -> Ends {
        Ends { side: if from { 1.0 } else { -1.0 }, bends: from != to }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Heights against points made of the arcs and the line, one by one; slopes and curvatures against
    /// differences.
    #[test]
    fn profiles_are_arcs_and_tangents() {
        for (amplitude, step, radii) in [
            (100.0, 400.0, 200.0),
            (190.0, 480.0, 200.0),
            (5.0, 102.0, 100.0),
            (95.0, 250.0, 100.0),
            (60.0, 110.0, 100.0),
        ] {
            let p = Profile::new(amplitude, step, radii);
            let theta = p.slope.atan();
            let line = (0.5 * step - p.radius * theta.sin()) / theta.cos();
            assert!(line > -1e-9 && p.radius <= radii);
            assert!(
                (p.radius * (1.0 - theta.cos()) + line * theta.sin() - amplitude).abs() < 1e-9 * amplitude,
                "{p:?}"
            );
            for i in 0..=20 {
                let turned = theta * f64::from(i) / 20.0;
                let [z, ..] = p.at(p.radius * turned.sin());
                assert!((z - amplitude + p.radius * (1.0 - turned.cos())).abs() < 1e-9 * step);
            }
            let single = p.single();
            for i in 1..200 {
                let (x, d) = (step * f64::from(i) / 200.0, 1e-4);
                let [a, b, c] = [x - d, x, x + d].map(|x| p.at(x));
                assert!(((c[0] - a[0]) / (2.0 * d) - b[1]).abs() < 1e-5);
                assert!(
                    a[2] != c[2] && (a[2] == 0.0 || c[2] == 0.0) || ((c[1] - a[1]) / (2.0 * d) - b[2]).abs() < 1e-5
                );
                let (z, slope) = single.joined(true, false, (x / step) as f32);
                assert!((f64::from(z) - b[0]).abs() < 1e-3 && (f64::from(slope) - b[1]).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn amplitudes_are_those_of_a_lean() {
        for (step, radii) in [(400.0, 100.0), (150.0, 200.0)] {
            let amplitude = amplitude_of(0.4, step, radii);
            assert!((Profile::new(amplitude, step, radii).slope.atan() - 0.4).abs() < 1e-6);
        }
    }
}
