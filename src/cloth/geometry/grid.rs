//! A voxel grid over the cell and the thickness of a cloth that lists the pieces of its curves.
//!
//! Curves are cut into pieces of about 1.5 R; each piece is a cubic with the curve's points and tangents at
//! its ends. Each voxel lists the pieces whose plies reach into it or come near it, in blocks of SIMD lanes;
//! in a dense cloth there are about six per voxel.

use crate::Result;
use crate::cloth::{ClothCurves, Lattice};
use crate::math::vec3::dot;
use crate::spec::rules::invalid;

/// Length of a piece in radii.
const PIECE: f64 = 1.5;
/// Side of a voxel in mean radii.
const VOXEL: f64 = 2.5;
/// Number of chords that are tested at once.
pub(crate) const LANES: usize = 8;
/// Largest number of voxels in a cell.
const MAX_VOXELS: f64 = 1_048_576.0;
/// Largest number of pieces in a cloth.
const MAX_PIECES: f64 = 5e5;
/// Largest number of entries of all voxels, and largest mean number of pieces per voxel.
const MAX_ENTRIES: f64 = 4e6;
const MAX_SHARED: f64 = 2000.0;

/// Pieces of a voxel, relative to the corner of its cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PieceBlock {
    /// `[power of u][axis][lane]`: coefficients of the pieces as cubics of u from 0 to 1.
    pub cubic: [[[f32; LANES]; 3]; 4],
    /// Vectors from the start of each piece to its end, and their squared lengths.
    pub chord: [[f32; LANES]; 3],
    pub chord2: [f32; LANES],
    /// Squared distance from the chord within which a line may hit; negative in empty lanes.
    pub reach2: [f32; LANES],
    pub piece: [u32; LANES],
    /// Cells by which the piece is translated.
    pub cells: [[i16; 2]; LANES],
}

/// Index of a piece in a voxel, and the cells by which it is translated.
pub(crate) type Entry = (u32, [i16; 2]);

/// Coefficients of a piece, `[power of u][axis]`, and the reach about its chord [um].
pub(crate) type Shape = ([[f32; 3]; 4], f32);

/// A piece of a curve, from one parameter to the next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurvePiece {
    pub curve: u32,
    pub from: f32,
    pub to: f32,
}

/// The voxel grid of a cloth.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// The shortest vectors of the lattice [um], and these as multiples of the cloth's vectors.
    pub cell: [[f32; 2]; 2],
    pub steps: [[i32; 2]; 2],
    /// Rows of the inverse matrix of the cell.
    pub inverse: [[f32; 2]; 2],
    /// Number of voxels along each vector and along z.
    pub counts: [i32; 3],
    /// First block of each voxel, with the index along z fastest, and the number of blocks.
    pub first: Vec<u32>,
    pub blocks: Vec<PieceBlock>,
    pub pieces: Vec<CurvePiece>,
    pub half_thickness_um: f32,
}

impl Grid {
    /// Builds the grid of a checked cloth, for lines that come within `beside_um` of its plies.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for curves that are millions of radii long.
    pub fn new(cloth: &ClothCurves, whole: &Lattice, beside_um: f64) -> Result<Grid> {
        let (reduced, steps) = whole.reduced();
        let lattice = &reduced;
        let mean = cloth.curves.iter().map(|c| c.radius_um).sum::<f64>() / cloth.curves.len() as f64;
        let thickest = cloth.curves.iter().map(|c| c.radius_um).fold(0.0, f64::max);
        let lengths: Vec<f64> = cloth.curves.iter().map(|c| c.length_um(whole)).collect();
        let count: f64 = lengths.iter().zip(&cloth.curves).map(|(l, c)| 1.0 + l / (PIECE * c.radius_um)).sum();
        if count > MAX_PIECES {
            let hint = format!("use thicker or shorter curves: they have {count:.1e} pieces, {MAX_PIECES:.0e} at most");
            return Err(invalid("cloth", "curve.radius_um", format!("{mean:.3}"), hint));
        }
        let (mut pieces, mut cubics) = (Vec::new(), Vec::new());
        let mut half = 0.0f64;
        for (index, curve) in cloth.curves.iter().enumerate() {
            let knots = curve.control_um.len() as f64;
            let count = (lengths[index] / (PIECE * curve.radius_um)).ceil().max(1.0);
            for k in 0..count as usize {
                let [u, v] = [k, k + 1].map(|k| k as f64 * knots / count);
                let [p, q] = [u, v].map(|u| curve.at(whole, u).point_um);
                // Largest distance between the curve and its chord.
                let sag = (1..8)
                    .map(|i| {
                        let t = f64::from(i) / 8.0;
                        let at = curve.at(whole, u + t * (v - u)).point_um;
                        let off: [f64; 3] = std::array::from_fn(|k| at[k] - p[k] - t * (q[k] - p[k]));
                        dot(off, off).sqrt()
                    })
                    .fold(0.0, f64::max);
                let reach = beside_um + curve.radius_um + 1.05 * sag + 1e-3 * curve.radius_um;
                half = half.max(p[2].abs() + reach);
                pieces.push(CurvePiece { curve: index as u32, from: u as f32, to: v as f32 });
                let [d, e] = [u, v].map(|at| curve.at(whole, at).d_um.map(|d| d * (v - u)));
                let chord: [f64; 3] = std::array::from_fn(|k| q[k] - p[k]);
                let cubic = [
                    p,
                    d,
                    std::array::from_fn(|k| 3.0 * chord[k] - 2.0 * d[k] - e[k]),
                    std::array::from_fn(|k| d[k] + e[k] - 2.0 * chord[k]),
                ];
                cubics.push((cubic, reach));
            }
        }
        // Bounds the number of voxels for cells of many yarns, and the voxel size from below for thick plies.
        let min_side = (lattice.area_um2() * 2.0 * half / MAX_VOXELS).cbrt();
        let voxels = Voxels::new(lattice, half, (VOXEL * mean).max(0.5 * thickest).max(min_side));
        let mut lists: Vec<Vec<Entry>> = vec![Vec::new(); voxels.counts.iter().map(|n| *n as usize).product()];
        let (mut entries, max_entries) = (0.0, MAX_ENTRIES.min(MAX_SHARED * lists.len() as f64));
        for (piece, ((cubic, reach), CurvePiece { curve, .. })) in cubics.iter().zip(&pieces).enumerate() {
            let end = std::array::from_fn(|k| cubic.iter().map(|power| power[k]).sum());
            let range = voxels.range([cubic[0], end], *reach);
            entries += range.iter().map(|[low, high]| f64::from(*high) - f64::from(*low) + 1.0).product::<f64>();
            if entries > max_entries {
                let hint = "use curves that wind less and are thinner: they reach into too much of the cell";
                return Err(invalid("cloth", "curve", format!("curve {}", curve + 1), hint));
            }
            for (voxel, cells) in voxels.reached([cubic[0], end], *reach, range) {
                lists[voxel].push((piece as u32, cells));
            }
        }
        let (mut first, mut blocks) = (vec![0], Vec::<PieceBlock>::new());
        for list in &lists {
            for chunk in list.chunks(LANES) {
                let mut block = PieceBlock {
                    cubic: [[[0.0; LANES]; 3]; 4],
                    chord: [[1.0; LANES]; 3],
                    chord2: [3.0; LANES],
                    reach2: [-1.0; LANES],
                    piece: [0; LANES],
                    cells: [[0; 2]; LANES],
                };
                block.cubic[1] = [[1.0; LANES]; 3];
                for (lane, (piece, cells)) in chunk.iter().enumerate() {
                    let (cubic, reach) = cubics[*piece as usize];
                    let by = lattice.vector(cells.map(i32::from));
                    for (power, c) in cubic.iter().enumerate() {
                        for k in 0..3 {
                            let move_by = if power == 0 && k < 2 { by[k] } else { 0.0 };
                            block.cubic[power][k][lane] = (c[k] + move_by) as f32;
                        }
                    }
                    let chord: [f64; 3] = std::array::from_fn(|k| cubic[1][k] + cubic[2][k] + cubic[3][k]);
                    (0..3).for_each(|k| block.chord[k][lane] = chord[k] as f32);
                    block.chord2[lane] = dot(chord, chord) as f32;
                    block.reach2[lane] = (reach * reach) as f32;
                    block.piece[lane] = *piece;
                    block.cells[lane] = *cells;
                }
                blocks.push(block);
            }
            first.push(blocks.len() as u32);
        }
        let unit = [[1.0, 0.0], [0.0, 1.0]].map(|e| lattice.fractions(e[0], e[1]));
        Ok(Grid {
            cell: lattice.cell_um.map(|v| v.map(|v| v as f32)),
            steps,
            inverse: [0, 1].map(|k| [unit[0][k] as f32, unit[1][k] as f32]),
            counts: voxels.counts,
            first,
            blocks,
            pieces,
            half_thickness_um: half as f32,
        })
    }

    /// Blocks of a voxel of the cell.
    #[inline(always)]
    pub fn of_voxel(&self, [i, j, k]: [i32; 3]) -> &[PieceBlock] {
        let number = ((i * self.counts[1] + j) * self.counts[2] + k) as usize;
        &self.blocks[self.first[number] as usize..self.first[number + 1] as usize]
    }

    /// The grid as flat tables: the first entry of each voxel and the number of entries; the piece of each
    /// entry and the cells by which it is translated; and the coefficients of each piece,
    /// `[power of u][axis]`, with the reach about its chord [um].
    pub fn tables(&self) -> (Vec<u32>, Vec<Entry>, Vec<Shape>) {
        let (mut first, mut entries) = (vec![0], Vec::new());
        let mut pieces = vec![([[0.0; 3]; 4], 0.0); self.pieces.len()];
        for blocks in self.first.windows(2) {
            for block in &self.blocks[blocks[0] as usize..blocks[1] as usize] {
                for l in (0..LANES).filter(|l| block.reach2[*l] > 0.0) {
                    let ([i, j], [a, b]) = (block.cells[l].map(f32::from), self.cell);
                    let mut cubic = block.cubic.map(|power| power.map(|axis| axis[l]));
                    (0..2).for_each(|k| cubic[0][k] -= i * a[k] + j * b[k]);
                    pieces[block.piece[l] as usize] = (cubic, block.reach2[l].sqrt());
                    entries.push((block.piece[l], block.cells[l]));
                }
            }
            first.push(entries.len() as u32);
        }
        (first, entries, pieces)
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.first.as_slice()) + size_of_val(self.blocks.as_slice()) + size_of_val(self.pieces.as_slice())
    }
}

/// The voxels of a grid while it is built.
struct Voxels<'a> {
    lattice: &'a Lattice,
    counts: [i32; 3],
    half_um: f64,
    /// Half of the three edge vectors of a voxel [um].
    sides: [[f64; 3]; 3],
}

impl Voxels<'_> {
    /// Voxels with sides of about `side` [um], from `half_um` below to `half_um` above the middle plane.
    fn new(lattice: &Lattice, half_um: f64, side: f64) -> Voxels<'_> {
        let [a, b] = lattice.widths_um();
        let counts = [a, b, 2.0 * half_um].map(|width| ((width / side).round() as i32).max(1));
        let [a, b] = lattice.cell_um;
        let along = [[a[0], a[1], 0.0], [b[0], b[1], 0.0], [0.0, 0.0, 2.0 * half_um]];
        let sides = std::array::from_fn(|i| along[i].map(|v| 0.5 * v / f64::from(counts[i])));
        Voxels { lattice, counts, half_um, sides }
    }

    /// First and last voxel along each axis that a dilated chord may overlap.
    fn range(&self, [p, q]: [[f64; 3]; 2], reach: f64) -> [[i32; 2]; 3] {
        let [a, b] = self.lattice.widths_um();
        let widths = [a, b, 2.0 * self.half_um];
        let [f, g] = [p, q].map(|p| {
            let [x, y] = self.lattice.fractions(p[0], p[1]);
            [x, y, 0.5 + 0.5 * p[2] / self.half_um]
        });
        [0, 1, 2].map(|k| {
            let (pad, per) = (reach / widths[k], f64::from(self.counts[k]));
            let [low, high] = [f[k].min(g[k]) - pad, f[k].max(g[k]) + pad].map(|at| (at * per).floor() as i32);
            if k == 2 { [low, high].map(|at| at.clamp(0, self.counts[2] - 1)) } else { [low, high] }
        })
    }

    /// Voxels of a range that a dilated chord overlaps, each with the cells by which the chord is translated.
    fn reached(&self, [p, q]: [[f64; 3]; 2], reach: f64, range: [[i32; 2]; 3]) -> Vec<(usize, [i16; 2])> {
        let chord: [f64; 3] = std::array::from_fn(|k| q[k] - p[k]);
        let mut all = Vec::new();
        for i in range[0][0]..=range[0][1] {
            for j in range[1][0]..=range[1][1] {
                for k in range[2][0]..=range[2][1] {
                    let steps = [i, j, k].map(|n| 2.0 * f64::from(n) + 1.0);
                    let middle: [f64; 3] = std::array::from_fn(|x| {
                        (0..3).map(|side| steps[side] * self.sides[side][x]).sum::<f64>()
                            - if x == 2 { self.half_um } else { 0.0 }
                    });
                    let off: [f64; 3] = std::array::from_fn(|x| middle[x] - p[x]);
                    let along = (dot(off, chord) / dot(chord, chord).max(1e-12)).clamp(0.0, 1.0);
                    // A plane perpendicular to the vector from the nearest point of the chord separates voxel
                    // and capsule.
                    let away: [f64; 3] = std::array::from_fn(|x| off[x] - along * chord[x]);
                    let far = dot(away, away).sqrt();
                    let extent = self.sides.map(|side| dot(side, away).abs()).iter().sum::<f64>();
                    if far * (far - reach) > extent {
                        continue;
                    }
                    let [[m, u], [n, v]] = [(i, 0), (j, 1)]
                        .map(|(at, axis)| [at.rem_euclid(self.counts[axis]), at.div_euclid(self.counts[axis])]);
                    let voxel = (m * self.counts[1] + n) * self.counts[2] + k;
                    all.push((voxel as usize, [-u as i16, -v as i16]));
                }
            }
        }
        all
    }
}
