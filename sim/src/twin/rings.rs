//! Rings along closed loops of curves, in a rotation-minimizing frame.
//!
//! The frame follows by double reflection from ring to ring. Over the whole loop it turns by some angle; the
//! fibers' twist is rounded so that frame and twist together make whole turns and the fibers close.

use super::options::TwinMesh;
use super::sweep::ThreadOfFiber;
use plywave::cloth::{Lattice, PlyCurve};
use plywave::math::vec3::{cross, dot, sub, unit};
use plywave::spec::Twist;
use plywave_textile::YarnSet;

/// A vector of three.
type V3 = [f64; 3];

/// A curve with its images along its period, which closes on the torus of a domain.
pub(super) struct Loop<'a> {
    pub curve: &'a PlyCurve,
    /// Index of the curve.
    pub index: usize,
    pub kind: usize,
    /// Number of its yarn in the domain.
    pub yarn: u32,
    /// Number of its yarn in the sequence of colors.
    pub color: i32,
    /// Cell in which it starts.
    pub start: [i32; 2],
    /// Number of periods of the curve after which it closes.
    pub periods: usize,
}

impl Loop<'_> {
    /// Yarn, ply and spec of a fiber of this loop, which is the ply of this number.
    pub fn thread(&self, number: u32, second: bool) -> ThreadOfFiber {
        let (family, spec) = (YarnSet::EACH[self.kind.min(1)], self.kind as u32);
        ThreadOfFiber { family, yarn: self.yarn, number: self.color, ply: number, spec, second }
    }
}

/// Rings along a loop.
pub(super) struct Path {
    points: Vec<V3>,
    /// `[ring]`: rotation-minimizing frame.
    frames: Vec<[V3; 2]>,
    /// `[ring]`: length up to the ring [um].
    arcs: Vec<f64>,
    /// Vector from the first ring to its next image [um].
    way: V3,
    pub length_um: f64,
    /// Twist of the fibers relative to the frame [rad/um].
    pub twist: f64,
    /// Rotation of the frame over the loop [rad].
    turned: f64,
}

/// A ring's frame with the angle of the fibers in it.
pub(super) struct Frame {
    pub point: V3,
    pub u: V3,
    pub v: V3,
    pub angle: f64,
    /// Angle that undoes the rotation of the frame over the loop, in proportion to the length [rad].
    pub unwound: f64,
}

impl Path {
    /// The rings of a loop whose fibers have about this twist; the twist is rounded so that they close.
    pub fn new(lattice: &Lattice, of: &Loop<'_>, options: &TwinMesh, twist: Twist) -> Path {
        let curve = of.curve;
        let knots = curve.control_um.len();
        let start = lattice.vector(of.start);
        let place = |u: f64| {
            let at = curve.at(lattice, u);
            let [x, y, z] = at.point_um;
            ([x + start[0], y + start[1], z], at)
        };
        // Rings are closer where the curve bends more.
        const CELLS: usize = 4;
        let mut sum = vec![0.0];
        for i in 0..knots * CELLS {
            let at = curve.at(lattice, (i as f64 + 0.5) / CELLS as f64);
            let step = dot(at.d_um, at.d_um).sqrt() / CELLS as f64;
            let turn = at.curvature_per_um() + twist.rad_per_um().abs();
            sum.push(sum[i] + step * (turn / options.turn_rad.max(1e-3)).max(1.0 / options.step_um.max(0.1)));
        }
        let whole = sum[knots * CELLS];
        let each = whole.ceil().max(8.0) as usize;
        let mut cell = 0;
        let inner: Vec<f64> = (0..each)
            .map(|k| {
                let want = whole * k as f64 / each as f64;
                while cell + 1 < knots * CELLS && sum[cell + 1] <= want {
                    cell += 1;
                }
                (cell as f64 + (want - sum[cell]) / (sum[cell + 1] - sum[cell])) / CELLS as f64
            })
            .collect();
        let parameters = (0..of.periods).flat_map(|p| inner.iter().map(move |u| u + (p * knots) as f64));
        let (mut points, mut tangents): (Vec<V3>, Vec<V3>) =
            parameters.map(place).map(|(p, at)| (p, unit(at.d_um))).unzip();
        let v = lattice.vector(curve.shift);
        let way = [v[0] * of.periods as f64, v[1] * of.periods as f64, 0.0];
        // The first ring is repeated at the end.
        points.push(std::array::from_fn(|k| points[0][k] + way[k]));
        tangents.push(tangents[0]);
        // The double reflection method takes the frame from ring to ring.
        let reflected = |w: V3, by: V3| -> V3 {
            let scale = 2.0 * dot(by, w) / dot(by, by).max(1e-300);
            std::array::from_fn(|k| w[k] - scale * by[k])
        };
        let t = tangents[0];
        let start = unit(cross(if t[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] }, t));
        let mut frames = vec![[start, cross(t, start)]];
        let mut arcs = vec![0.0];
        for i in 0..points.len() - 1 {
            let step = sub(points[i + 1], points[i]);
            let (u, along) = (reflected(frames[i][0], step), reflected(tangents[i], step));
            let u = unit(reflected(u, sub(tangents[i + 1], along)));
            frames.push([u, cross(tangents[i + 1], u)]);
            arcs.push(arcs[i] + dot(step, step).sqrt());
        }
        let length_um = arcs[arcs.len() - 1];
        let [u, _] = frames[frames.len() - 1];
        let turned = dot(u, frames[0][1]).atan2(dot(u, frames[0][0]));
        // Frame and twist together make whole turns.
        let twist = twist.closed_rad(length_um, 1.0, turned) / length_um;
        Path { points, frames, arcs, way, length_um, twist, turned }
    }

    /// Number of rings of the loop; the repeated first one counts once.
    pub fn count(&self) -> usize {
        self.points.len() - 1
    }

    /// Frame of ring `k - 1`. Ring -1 is the last one of the previous turn of the loop, and the ring after
    /// the loop's end is its second one.
    pub fn frame(&self, k: usize) -> Frame {
        let count = self.count();
        let (at, loops) = match k {
            0 => (count - 1, -1.0),
            k if k - 1 <= count => (k - 1, 0.0),
            k => (k - 1 - count, 1.0),
        };
        let point = std::array::from_fn(|i| self.points[at][i] + loops * self.way[i]);
        // The image one loop further has the frame's rotation and the fibers' twist of a whole loop.
        let angle = self.twist * self.arcs[at] + loops * (self.twist * self.length_um + self.turned);
        let unwound = -self.turned * self.arcs[at] / self.length_um;
        Frame { point, u: self.frames[at][0], v: self.frames[at][1], angle, unwound }
    }

    pub fn bounds(&self) -> (V3, V3) {
        let of = |pick: fn(f64, f64) -> f64, from: f64| {
            std::array::from_fn(|k| self.points.iter().map(|p| p[k]).fold(from, pick))
        };
        (of(f64::min, f64::INFINITY), of(f64::max, f64::NEG_INFINITY))
    }

    pub fn longest_um(&self) -> f64 {
        self.arcs.windows(2).map(|a| a[1] - a[0]).fold(0.0, f64::max)
    }
}
