//! A net of points of a sheet, with a smooth surface through them.

use glam::Vec3;

/// Points of a sheet at equal steps along both of its sides.
pub(crate) struct Net {
    /// Numbers of cells along u and v.
    pub cells: [usize; 2],
    /// Points, `[v][u]`.
    pub points: Vec<Vec3>,
}

impl Net {
    /// A net through `place(s, t)`, s and t in [0, 1].
    pub fn new(cells: [usize; 2], place: impl Fn(f32, f32) -> Vec3) -> Net {
        let [n, m] = cells;
        let of = |k: usize, n: usize| k as f32 / n as f32;
        let points = (0..=m).flat_map(|j| (0..=n).map(move |i| (i, j))).map(|(i, j)| place(of(i, n), of(j, m)));
        Net { cells, points: points.collect() }
    }

    /// The same surface with other numbers of cells.
    pub fn refined(&self, cells: [usize; 2]) -> Net {
        Net::new(cells, |s, t| self.at(s, t))
    }

    /// The point at (s, t), by Catmull-Rom interpolation; beyond [0, 1]^2 the sheet goes on straight.
    pub fn at(&self, s: f32, t: f32) -> Vec3 {
        let side = self.cells[0] + 1;
        let point = |i: isize, j: isize| {
            let clamped = |k: isize, axis: usize| k.clamp(0, self.cells[axis] as isize) as usize;
            let (ci, cj) = (clamped(i, 0), clamped(j, 1));
            let own = self.points[cj * side + ci];
            if (ci as isize, cj as isize) == (i, j) {
                return own;
            }
            let (mi, mj) = (clamped(2 * ci as isize - i, 0), clamped(2 * cj as isize - j, 1));
            2.0 * own - self.points[mj * side + mi]
        };
        let spline = |p: [Vec3; 4], u: f32| {
            let (a, b, c) =
                (p[2] - p[0], 2.0 * p[0] - 5.0 * p[1] + 4.0 * p[2] - p[3], 3.0 * (p[1] - p[2]) + p[3] - p[0]);
            p[1] + 0.5 * u * (a + u * (b + u * c))
        };
        let cell = |x: f32, axis: usize| {
            let x = x * self.cells[axis] as f32;
            let cell = x.floor().clamp(0.0, self.cells[axis] as f32 - 1.0);
            (cell as isize, x - cell)
        };
        let ((i, u), (j, v)) = (cell(s, 0), cell(t, 1));
        let row = |j: isize| spline([-1, 0, 1, 2].map(|k| point(i + k, j)), u);
        spline([-1, 0, 1, 2].map(|k| row(j + k)), v)
    }
}
