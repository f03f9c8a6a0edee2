//! A grid over the cell of a cloth that lists the pieces of its curves.
//!
//! Curves are cut into pieces of some 1.5 R, each a cubic with the curve's points and tangents at its ends.
//! Each bucket of the grid has the pieces whose plies reach into it, by height, in blocks of lanes.

use super::{ClothCurves, Lattice};
use crate::Result;
use crate::math::vec3::dot;
use crate::spec::rules::invalid;

/// Length of a piece over its radius.
const PIECE: f64 = 1.5;
/// Side of a bucket over the mean radius.
const BUCKET: f64 = 1.2;
/// Chords that are tested at once.
pub(super) const LANES: usize = 8;
/// Most buckets of a cell.
const MAX_BUCKETS: f64 = 65_536.0;
/// Most pieces of a cloth.
const MAX_PIECES: f64 = 5e5;
/// Most buckets that all pieces together may reach into, and most pieces of a bucket on the average.
const MAX_ENTRIES: f64 = 4e6;
const MAX_SHARED: f64 = 2000.0;

/// Pieces of a bucket, relative to the corner of its cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// `[power of u][axis][lane]`: points of the pieces, u from 0 to 1.
    pub cubic: [[[f32; LANES]; 3]; 4],
    /// From their first ends to their last, and the squared length of that.
    pub chord: [[f32; LANES]; 3],
    pub chord2: [f32; LANES],
    /// Square of the distance from its chord within which a line may hit; negative in empty lanes.
    pub reach2: [f32; LANES],
    pub piece: [u32; LANES],
    /// Cells by which the piece is moved.
    pub cells: [[i16; 2]; LANES],
}

/// A piece of a curve: from one parameter to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub curve: u32,
    pub from: f32,
    pub to: f32,
}

/// The grid.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub cell: [[f32; 2]; 2],
    /// Rows of the inverse of the cell.
    pub inverse: [[f32; 2]; 2],
    /// Buckets along each vector.
    pub counts: [i32; 2],
    /// First block of each bucket, and their number.
    pub first: Vec<u32>,
    pub blocks: Vec<Block>,
    /// Heights between which a line may be nearest to the chords of each block [um].
    pub heights: Vec<[f32; 2]>,
    pub pieces: Vec<Piece>,
    pub half_thickness_um: f32,
}

impl Grid {
    /// Of a cloth that was checked.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for curves that are millions of radii long.
    pub fn new(cloth: &ClothCurves, lattice: &Lattice) -> Result<Grid> {
        let mean = cloth.curves.iter().map(|c| c.radius_um).sum::<f64>() / cloth.curves.len() as f64;
        let thickest = cloth.curves.iter().map(|c| c.radius_um).fold(0.0, f64::max);
        let lengths: Vec<f64> = cloth.curves.iter().map(|c| c.length_um(lattice)).collect();
        let whole: f64 = lengths.iter().zip(&cloth.curves).map(|(l, c)| 1.0 + l / (PIECE * c.radius_um)).sum();
        if whole > MAX_PIECES {
            let hint = format!("use thicker or shorter curves: they have {whole:.1e} pieces, {MAX_PIECES:.0e} at most");
            return Err(invalid("cloth", "curve.radius_um", format!("{mean:.3}"), hint));
        }
        // No more buckets than a cell of many yarns needs, nor than thick plies do.
        let side = (BUCKET * mean).max(0.25 * thickest).max((lattice.area_um2() / MAX_BUCKETS).sqrt());
        let widths = lattice.widths_um();
        let counts = widths.map(|w| ((w / side).round() as i32).max(1));
        let mut lists: Vec<Vec<(u32, [i32; 2])>> = vec![Vec::new(); (counts[0] * counts[1]) as usize];
        let (mut pieces, mut cubics) = (Vec::new(), Vec::new());
        let (mut half, mut entries) = (0.0f64, 0.0);
        let most = MAX_ENTRIES.min(MAX_SHARED * lists.len() as f64);
        for (index, curve) in cloth.curves.iter().enumerate() {
            let knots = curve.control_um.len() as f64;
            let count = (lengths[index] / (PIECE * curve.radius_um)).ceil().max(1.0);
            for k in 0..count as usize {
                let [u, v] = [k, k + 1].map(|k| k as f64 * knots / count);
                let [p, q] = [u, v].map(|u| curve.at(lattice, u).point_um);
                // How far the curve leaves its chord.
                let sag = (1..8)
                    .map(|i| {
                        let t = f64::from(i) / 8.0;
                        let at = curve.at(lattice, u + t * (v - u)).point_um;
                        let off: [f64; 3] = std::array::from_fn(|k| at[k] - p[k] - t * (q[k] - p[k]));
                        dot(off, off).sqrt()
                    })
                    .fold(0.0, f64::max);
                let reach = curve.radius_um + 1.05 * sag + 1e-3 * curve.radius_um;
                half = half.max(p[2].abs() + reach);
                let piece = pieces.len() as u32;
                pieces.push(Piece { curve: index as u32, from: u as f32, to: v as f32 });
                let [d, e] = [u, v].map(|at| curve.at(lattice, at).d_um.map(|d| d * (v - u)));
                let way: [f64; 3] = std::array::from_fn(|k| q[k] - p[k]);
                let cubic = [
                    p,
                    d,
                    std::array::from_fn(|k| 3.0 * way[k] - 2.0 * d[k] - e[k]),
                    std::array::from_fn(|k| d[k] + e[k] - 2.0 * way[k]),
                ];
                cubics.push((cubic, reach));
                let range = range(lattice, counts, [p, q], reach);
                entries += range.iter().map(|[low, high]| f64::from(*high) - f64::from(*low) + 1.0).product::<f64>();
                if entries > most {
                    let hint = "use curves that wind less and are thinner: they reach into too much of the cell";
                    return Err(invalid("cloth", "curve", format!("curve {}", index + 1), hint));
                }
                for (bucket, cells) in buckets(lattice, counts, [p, q], reach, range) {
                    lists[bucket].push((piece, cells));
                }
            }
        }
        let (mut first, mut blocks, mut heights) = (vec![0], Vec::<Block>::new(), Vec::new());
        for list in &mut lists {
            // From below: lines go through the height of few blocks.
            let middle = |piece: u32| {
                let c = cubics[piece as usize].0;
                c[0][2] + 0.5 * (c[1][2] + c[2][2] + c[3][2])
            };
            list.sort_by(|a, b| middle(a.0).total_cmp(&middle(b.0)).then(a.cmp(b)));
            for chunk in list.chunks(LANES) {
                let mut block = Block {
                    cubic: [[[0.0; LANES]; 3]; 4],
                    chord: [[1.0; LANES]; 3],
                    chord2: [3.0; LANES],
                    reach2: [-1.0; LANES],
                    piece: [0; LANES],
                    cells: [[0; 2]; LANES],
                };
                block.cubic[1] = [[1.0; LANES]; 3];
                let (mut bottom, mut top) = (f32::INFINITY, f32::NEG_INFINITY);
                for (lane, (piece, cells)) in chunk.iter().enumerate() {
                    let (cubic, reach) = cubics[*piece as usize];
                    let by = lattice.vector(*cells);
                    for (power, c) in cubic.iter().enumerate() {
                        for k in 0..3 {
                            let move_by = if power == 0 && k < 2 { by[k] } else { 0.0 };
                            block.cubic[power][k][lane] = (c[k] + move_by) as f32;
                        }
                    }
                    let chord: [f64; 3] = std::array::from_fn(|k| cubic[1][k] + cubic[2][k] + cubic[3][k]);
                    (0..3).for_each(|k| block.chord[k][lane] = chord[k] as f32);
                    block.chord2[lane] = dot(chord, chord) as f32;
                    let ends = [cubic[0][2], cubic[0][2] + chord[2]];
                    bottom = bottom.min((ends[0].min(ends[1]) - reach) as f32);
                    top = top.max((ends[0].max(ends[1]) + reach) as f32);
                    block.reach2[lane] = (reach * reach) as f32;
                    block.piece[lane] = *piece;
                    block.cells[lane] = cells.map(|c| c as i16);
                }
                blocks.push(block);
                heights.push([bottom, top]);
            }
            first.push(blocks.len() as u32);
        }
        let unit = [[1.0, 0.0], [0.0, 1.0]].map(|e| lattice.fractions(e[0], e[1]));
        Ok(Grid {
            cell: lattice.cell_um.map(|v| v.map(|v| v as f32)),
            inverse: [0, 1].map(|k| [unit[0][k] as f32, unit[1][k] as f32]),
            counts,
            first,
            blocks,
            heights,
            pieces,
            half_thickness_um: half as f32,
        })
    }

    /// Blocks of a bucket from below, and their heights.
    #[inline(always)]
    pub fn of_bucket(&self, number: usize) -> (&[Block], &[[f32; 2]]) {
        let range = self.first[number] as usize..self.first[number + 1] as usize;
        (&self.blocks[range.clone()], &self.heights[range])
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.first.as_slice())
            + size_of_val(self.blocks.as_slice())
            + size_of_val(self.heights.as_slice())
            + size_of_val(self.pieces.as_slice())
    }
}

/// First and last bucket along each vector that a dilated chord may reach into.
fn range(lattice: &Lattice, counts: [i32; 2], [p, q]: [[f64; 3]; 2], reach: f64) -> [[i32; 2]; 2] {
    let widths = lattice.widths_um();
    let [f, g] = [p, q].map(|p| lattice.fractions(p[0], p[1]));
    [0, 1].map(|k| {
        let pad = reach / widths[k];
        let per = f64::from(counts[k]);
        [((f[k].min(g[k]) - pad) * per).floor() as i32, ((f[k].max(g[k]) + pad) * per).floor() as i32]
    })
}

/// Buckets of a range that a dilated chord reaches into, each with the cells by which the chord is moved to
/// be there.
fn buckets(
    lattice: &Lattice,
    counts: [i32; 2],
    [p, q]: [[f64; 3]; 2],
    reach: f64,
    range: [[i32; 2]; 2],
) -> Vec<(usize, [i32; 2])> {
    // Of the buckets in the range, those whose middle is near enough to the chord in the plane.
    let [a, b] = lattice.cell_um;
    let [x, y] = [0, 1].map(|k| [a[k] / f64::from(counts[0]), b[k] / f64::from(counts[1])]);
    let diagonal = 0.5 * (x[0] + x[1]).hypot(y[0] + y[1]).max((x[0] - x[1]).hypot(y[0] - y[1]));
    let mut all = Vec::new();
    for i in range[0][0]..=range[0][1] {
        for j in range[1][0]..=range[1][1] {
            let [s, t] = [(i, counts[0]), (j, counts[1])].map(|(i, n)| (f64::from(i) + 0.5) / f64::from(n));
            let m = [s * a[0] + t * b[0] - p[0], s * a[1] + t * b[1] - p[1]];
            let d = [q[0] - p[0], q[1] - p[1]];
            let along = ((m[0] * d[0] + m[1] * d[1]) / (d[0] * d[0] + d[1] * d[1]).max(1e-12)).clamp(0.0, 1.0);
            if (m[0] - along * d[0]).hypot(m[1] - along * d[1]) > reach + diagonal {
                continue;
            }
            let bucket = i.rem_euclid(counts[0]) * counts[1] + j.rem_euclid(counts[1]);
            all.push((bucket as usize, [-i.div_euclid(counts[0]), -j.div_euclid(counts[1])]));
        }
    }
    all
}
