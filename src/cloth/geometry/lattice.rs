//! The periodic cell of a cloth: the lattice of its two vectors, and neighbor searches across its sides.

/// A lattice of cells in the plane of the cloth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The two vectors of the cell [um].
    pub cell_um: [[f64; 2]; 2],
    /// Rows of the inverse matrix: fractions of the vectors per um.
    inverse: [[f64; 2]; 2],
}

impl Lattice {
    /// The lattice of a cell; `None` if its vectors are parallel or not finite.
    pub fn new(cell_um: [[f64; 2]; 2]) -> Option<Lattice> {
        let [a, b] = cell_um;
        let area = a[0] * b[1] - a[1] * b[0];
        let longest = a[0].hypot(a[1]).max(b[0].hypot(b[1]));
        if !area.is_finite() || area.abs() <= 1e-9 * longest * longest {
            return None;
        }
        Some(Lattice { cell_um, inverse: [[b[1] / area, -b[0] / area], [-a[1] / area, a[0] / area]] })
    }

    /// Area of the cell [um2].
    pub fn area_um2(&self) -> f64 {
        let [a, b] = self.cell_um;
        (a[0] * b[1] - a[1] * b[0]).abs()
    }

    /// The point at whole multiples of the two vectors [um].
    pub fn vector(&self, steps: [i32; 2]) -> [f64; 2] {
        let [a, b] = self.cell_um;
        let [i, j] = steps.map(f64::from);
        [i * a[0] + j * b[0], i * a[1] + j * b[1]]
    }

    /// The lattice in its shortest vectors (Lagrange reduction), and these as multiples of the original
    /// vectors.
    pub fn reduced(&self) -> (Lattice, [[i32; 2]; 2]) {
        let (mut steps, mut cell_um) = ([[1, 0], [0, 1]], self.cell_um);
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        loop {
            if dot(cell_um[1], cell_um[1]) < dot(cell_um[0], cell_um[0]) {
                cell_um.swap(0, 1);
                steps.swap(0, 1);
            }
            let by = (dot(cell_um[0], cell_um[1]) / dot(cell_um[0], cell_um[0])).round();
            let shorter = [0, 1].map(|k| cell_um[1][k] - by * cell_um[0][k]);
            // At exactly half a step both choices are equally long; only a step that shortens is taken, so
            // the loop ends.
            let shortens = dot(shorter, shorter) < dot(cell_um[1], cell_um[1]);
            if by.abs() > 1e6 || !shortens {
                break;
            }
            cell_um[1] = shorter;
            (0..2).for_each(|k| steps[1][k] -= by as i32 * steps[0][k]);
        }
        (Lattice::new(cell_um).unwrap_or(*self), steps)
    }

    /// A point in fractions of the vectors.
    pub fn fractions(&self, x: f64, y: f64) -> [f64; 2] {
        self.inverse.map(|row| row[0] * x + row[1] * y)
    }

    /// For each vector, the distance between the two sides of the cell that it connects [um].
    pub fn widths_um(&self) -> [f64; 2] {
        let area = self.area_um2();
        let [a, b] = self.cell_um;
        [area / b[0].hypot(b[1]), area / a[0].hypot(a[1])]
    }
}

/// Limits of a neighbor search: mean number of candidates per point, and number of pairs.
const MAX_NEAR: f64 = 2e4;
const MAX_PAIRS: f64 = 1e9;

/// The multiple of `shift` that equals `cells`; `None` if it is not a whole number.
pub fn whole_times(cells: [i32; 2], shift: [i32; 2]) -> Option<i32> {
    let k = if shift[0] != 0 { cells[0] / shift[0] } else { cells[1].checked_div(shift[1])? };
    (shift.map(|s| s * k) == cells).then_some(k)
}

/// Points of a lattice in buckets, for neighbor searches.
pub struct Buckets {
    lattice: Lattice,
    /// Number of buckets along each vector, and number of buckets that the cutoff spans.
    counts: [i32; 2],
    reach: [i32; 2],
    /// Start of each bucket's points, and the points: their index and the cell that they lie in.
    first: Vec<u32>,
    points: Vec<(u32, [i32; 2])>,
}

impl Buckets {
    /// Sorts points [um] into buckets for searches within `cutoff_um`.
    pub fn new(lattice: &Lattice, points: &[[f64; 3]], cutoff_um: f64) -> Buckets {
        let widths = lattice.widths_um();
        let counts = widths.map(|w| ((w / cutoff_um).floor() as i32).clamp(1, 2048));
        let reach = [0, 1].map(|k| (cutoff_um / (widths[k] / f64::from(counts[k]))).ceil() as i32);
        let mut buckets = Buckets { lattice: *lattice, counts, reach, first: Vec::new(), points: Vec::new() };
        let places: Vec<(usize, [i32; 2])> = points
            .iter()
            .map(|p| {
                let (at, cell) = buckets.place(*p);
                ((at[0] * counts[1] + at[1]) as usize, cell)
            })
            .collect();
        buckets.first = vec![0u32; (counts[0] * counts[1]) as usize + 1];
        places.iter().for_each(|(bucket, _)| buckets.first[bucket + 1] += 1);
        for i in 1..buckets.first.len() {
            buckets.first[i] += buckets.first[i - 1];
        }
        let mut next = buckets.first.clone();
        buckets.points = vec![(0, [0; 2]); points.len()];
        for (i, (bucket, cell)) in places.into_iter().enumerate() {
            buckets.points[next[bucket] as usize] = (i as u32, cell);
            next[bucket] += 1;
        }
        buckets
    }

    /// Whether a search within `cutoff_um` around each of `count` points, spread uniformly over the cell, has
    /// few enough pairs to end within a minute.
    pub fn can_search(lattice: &Lattice, count: usize, cutoff_um: f64) -> bool {
        let square = (2.0 * cutoff_um + lattice.widths_um()[0].min(cutoff_um)).powi(2);
        let each = count as f64 * square / lattice.area_um2();
        each < MAX_NEAR && count as f64 * each < MAX_PAIRS
    }

    /// Bucket and cell of a point.
    fn place(&self, p: [f64; 3]) -> ([i32; 2], [i32; 2]) {
        let f = self.lattice.fractions(p[0], p[1]);
        let cell = f.map(|f| f.floor() as i32);
        let at = [0, 1].map(|k| {
            let rest = f[k] - f64::from(cell[k]);
            ((rest * f64::from(self.counts[k])) as i32).clamp(0, self.counts[k] - 1)
        });
        (at, cell)
    }

    /// Calls `found` for each point in the buckets around `p`, with its index and the cells by which it is
    /// translated to be there. All points within the cutoff in the plane are reported, and some beyond.
    pub fn near(&self, p: [f64; 3], mut found: impl FnMut(usize, [i32; 2])) {
        let (at, cell) = self.place(p);
        for da in -self.reach[0]..=self.reach[0] {
            for db in -self.reach[1]..=self.reach[1] {
                let to = [at[0] + da, at[1] + db];
                let wrap = [0, 1].map(|k| to[k].div_euclid(self.counts[k]));
                let here = [0, 1].map(|k| to[k].rem_euclid(self.counts[k]));
                let bucket = (here[0] * self.counts[1] + here[1]) as usize;
                for (j, of) in &self.points[self.first[bucket] as usize..self.first[bucket + 1] as usize] {
                    found(*j as usize, [0, 1].map(|k| cell[k] + wrap[k] - of[k]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;

    /// A reduced cell spans the same lattice with short vectors that are far from parallel.
    #[test]
    fn reduced_cells_are_the_same_lattice() {
        for cell_um in [
            [[100.0, 750.0], [0.0, 1250.0]],
            [[500.0, 0.0], [0.0, 80.0]],
            [[30.0, 900.0], [-70.0, 11.0]],
            [[100.0, 0.0], [50.0, 80.0]],
        ] {
            let lattice = Lattice::new(cell_um).unwrap();
            let (reduced, steps) = lattice.reduced();
            for (vector, steps) in reduced.cell_um.iter().zip(steps) {
                let same = lattice.vector(steps);
                assert!((0..2).all(|k| (vector[k] - same[k]).abs() < 1e-9), "{cell_um:?}: {vector:?}, {same:?}");
            }
            assert!((reduced.area_um2() / lattice.area_um2() - 1.0).abs() < 1e-12);
            let [a, b] = reduced.cell_um;
            let along = (a[0] * b[0] + a[1] * b[1]).abs() / (a[0].hypot(a[1]) * b[0].hypot(b[1]));
            assert!(along < 0.501 && a[0].hypot(a[1]) <= b[0].hypot(b[1]), "{a:?}, {b:?}");
        }
    }

    /// The search across the sides of a sheared cell finds the same neighbors as a search over all images.
    #[test]
    fn neighbors_are_all_found() {
        for (cell, cutoff) in [([[100.0, 750.0], [0.0, 1250.0]], 60.0), ([[300.0, 0.0], [40.0, 200.0]], 35.0)] {
            let lattice = Lattice::new(cell).unwrap();
            let mut rng = SplitMix64(3);
            let mut number = |extent: f64| (rng.next_f64() - 0.3) * extent;
            let points: Vec<[f64; 3]> = (0..60).map(|_| [number(900.0), number(900.0), 0.0]).collect();
            let buckets = Buckets::new(&lattice, &points, cutoff);
            for i in 0..points.len() {
                let is_near = |j: usize, cells: [i32; 2]| {
                    let by = lattice.vector(cells);
                    let (p, q) = (points[i], points[j]);
                    (q[0] + by[0] - p[0]).hypot(q[1] + by[1] - p[1]) < cutoff
                };
                let mut found = Vec::new();
                buckets.near(points[i], |j, cells| {
                    if is_near(j, cells) {
                        found.push((j, cells));
                    }
                });
                found.sort_unstable();
                let mut want: Vec<(usize, [i32; 2])> = (0..points.len())
                    .flat_map(|j| (-30..30).flat_map(move |a| (-30..30).map(move |b| (j, [a, b]))))
                    .filter(|(j, cells)| is_near(*j, *cells))
                    .collect();
                want.sort_unstable();
                assert_eq!(found, want, "{i}");
            }
        }
    }

    #[test]
    fn multiples_of_a_shift() {
        assert_eq!(whole_times([4, -6], [2, -3]), Some(2));
        assert_eq!(whole_times([0, -3], [0, 3]), Some(-1));
        assert_eq!(whole_times([0, 0], [0, -2]), Some(0));
        assert_eq!(whole_times([1, 0], [0, 2]), None);
        assert_eq!(whole_times([2, 1], [2, 0]), None);
        assert!(Lattice::new([[1.0, 2.0], [2.0, 4.0]]).is_none());
    }
}
