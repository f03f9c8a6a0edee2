//! Where the hairs of a cloth lie: a tile of strokes over some cells, filtered by the footprint.
//!
//! A texel holds the share of it that hairs of a side cover, seen along the normal: those that stand free.
//! Hairs that lie on plies look as their fibers do, and are even. A line off the normal meets more hairs.
//! Copies of the tile, shifted and laid over each other, cover it 1, 2, 4 and 8 times; a line's share of
//! the light that hits free hairs is the interpolant between two of these whose mean over the tile is the
//! line's probability of hitting one. The mean over the cloth is therefore that of the even layer
//! (`hair_layer.rs`), at any footprint. Shadows fall at another part of the tile than the hairs that are
//! seen, so that both are as independent as the layer takes them to be.

use crate::cloth::Lattice;

/// Texels along each side of the tile.
pub const HAIR_TEXELS: usize = 1024;
/// Number of layers of copies, and of levels of the pyramid.
const LAYERS: usize = 4;
const LEVELS: u32 = HAIR_TEXELS.ilog2() + 1;
/// Shifts in texels of the copies that double a layer, without a common multiple.
const SHIFTS: [[usize; 2]; LAYERS - 1] = [[391, 633], [187, 451], [733, 269]];
/// Part of the tile by which shadows are shifted.
const SHADOW: [f32; 2] = [0.371, 0.619];
/// Smallest cosine for which the height of hairs moves them over the cloth.
const MIN_COSINE: f32 = 0.2;
/// Largest value of a texel in the file.
const MOST: u8 = 15;

/// The hairs of both sides over a tile of cells.
#[derive(Clone, Debug)]
pub struct HairField {
    /// Number of cells of the tile along the vectors of the cell.
    pub cells: [u32; 2],
    /// `[face, back]`: mean height of the hairs over the middle plane [um], negative on the back.
    pub height_um: [f32; 2],
    /// `[face, back]`: share of the hairs' depth that stands free.
    pub free: [f32; 2],
    /// Fractions of the tile per um of x and y.
    per_um: [[f32; 2]; 2],
    /// Size of a texel [um].
    texel_um: f32,
    /// `[side][layer]`: mean over the tile.
    means: [[f32; LAYERS]; 2],
    /// Pyramids of both sides; a texel has a byte for each layer.
    texels: Vec<u32>,
}

/// Index of the first texel of a level of a side.
#[inline]
fn first(side: usize, level: u32) -> usize {
    let squares = |level: u32| (HAIR_TEXELS >> level).pow(2);
    side * squares_of_all() + (squares(0) - squares(level)) / 3 * 4
}

/// Number of texels of all levels.
const fn squares_of_all() -> usize {
    (4 * HAIR_TEXELS * HAIR_TEXELS - 1) / 3
}

impl HairField {
    /// Builds the field of `cells` of the lattice from both sides' shares, 0 to 15 for 0 to 1, two in a
    /// byte and the lower half first.
    pub fn new(lattice: &Lattice, cells: [u32; 2], height_um: [f32; 2], free: [f32; 2], shares: &[u8]) -> HairField {
        const N: usize = HAIR_TEXELS;
        let area = lattice.area_um2() * f64::from(cells[0]) * f64::from(cells[1]);
        let [x, y] = [lattice.fractions(1.0, 0.0), lattice.fractions(0.0, 1.0)];
        let per_um = [0, 1].map(|k| [x[k], y[k]].map(|v| (v / f64::from(cells[k])) as f32));
        let (mut means, mut texels) = ([[0.0; LAYERS]; 2], Vec::with_capacity(2 * squares_of_all()));
        for (side, mean) in means.iter_mut().enumerate() {
            let half = &shares[side * N * N / 2..(side + 1) * N * N / 2];
            let mut layer: Vec<f32> =
                half.iter().flat_map(|byte| [byte & MOST, byte >> 4]).map(|v| f32::from(v) / f32::from(MOST)).collect();
            let mut level = vec![[0u8; LAYERS]; N * N];
            let mut layers: Vec<Vec<f32>> = Vec::new();
            for i in 0..LAYERS {
                for (texel, share) in level.iter_mut().zip(&layer) {
                    texel[i] = (255.0 * share + 0.5) as u8;
                }
                mean[i] = (level.iter().map(|texel| f64::from(texel[i])).sum::<f64>() / (255 * N * N) as f64) as f32;
                layers.push(layer.clone());
                if let Some([dx, dy]) = SHIFTS.get(i) {
                    let before = &layers[i];
                    for (y, row) in layer.chunks_exact_mut(N).enumerate() {
                        let other = &before[(y + dy) % N * N..][..N];
                        for (x, share) in row.iter_mut().enumerate() {
                            *share = 1.0 - (1.0 - *share) * (1.0 - other[(x + dx) % N]);
                        }
                    }
                }
            }
            texels.extend(level.into_iter().map(u32::from_le_bytes));
            let mut size = N;
            while size > 1 {
                size /= 2;
                layers = layers.iter().map(|of| halved(of, size)).collect();
                texels.extend(
                    (0..size * size)
                        .map(|i| u32::from_le_bytes(std::array::from_fn(|k| (255.0 * layers[k][i] + 0.5) as u8))),
                );
            }
        }
        HairField { cells, height_um, free, per_um, texel_um: (area.sqrt() / N as f64) as f32, means, texels }
    }

    /// Both sides' shares, as [`HairField::new`] takes them.
    pub fn shares(&self) -> Vec<u8> {
        let of = |texel: u32| (texel.to_le_bytes()[0] as f32 / 255.0 * f32::from(MOST)).round() as u8;
        let side = |side: usize| &self.texels[first(side, 0)..first(side, 1)];
        [0, 1]
            .into_iter()
            .flat_map(side)
            .copied()
            .collect::<Vec<_>>()
            .chunks_exact(2)
            .map(|two| of(two[0]) | of(two[1]) << 4)
            .collect()
    }

    /// Share of the light along a line that hits hairs of a side at a place of the tile; its mean over the
    /// cloth is `1 - exp(-depth)`.
    #[inline(always)]
    fn covered(&self, side: usize, place: [f32; 2], level: f32, depth: f32) -> f32 {
        let of_free = depth * self.free[side];
        let (probability, lying) = (-(-of_free).exp_m1(), (of_free - depth).exp());
        let (means, mut above) = (&self.means[side], 0);
        for mean in means {
            above += usize::from(*mean < probability);
        }
        let low = if above > 0 { means[above - 1] } else { 0.0 };
        let high = if above < LAYERS { means[above] } else { 1.0 };
        let share = if high > low { (probability - low) / (high - low) } else { 1.0 };
        let fine = level.floor().min((LEVELS - 1) as f32);
        let at = |level: u32| self.bilinear(side, place, level, above, share);
        let value = at(fine as u32);
        let rest = level - fine;
        let on = rest > 0.0 && fine as u32 + 1 < LEVELS;
        let covered = if on { value + rest * (at(fine as u32 + 1) - value) } else { value };
        1.0 - (1.0 - covered) * lying
    }

    #[inline(always)]
    fn bilinear(&self, side: usize, place: [f32; 2], level: u32, above: usize, share: f32) -> f32 {
        let size = HAIR_TEXELS >> level;
        let texels = &self.texels[first(side, level)..][..size * size];
        let at = |p: f32| {
            let at = (p - p.floor()) * size as f32 - 0.5;
            (at.floor() as i32, at - at.floor())
        };
        let ((x, s), (y, t), mask) = (at(place[0]), at(place[1]), size as i32 - 1);
        let mut sum = 0.0;
        for (dy, t) in [(0, 1.0 - t), (1, t)] {
            let row = ((y + dy) & mask) as usize * size;
            for (dx, s) in [(0, 1.0 - s), (1, s)] {
                let texel = texels[row + ((x + dx) & mask) as usize];
                // Before the layers comes nothing, and behind them all.
                let bytes = (u64::from(texel) << 8 | 0xFF << 40) >> (8 * above);
                let (low, high) = ((bytes & 0xFF) as f32, (bytes >> 8 & 0xFF) as f32);
                sum += t * s * (low + share * (high - low));
            }
        }
        sum * (1.0 / 255.0)
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(self.texels.as_slice())
    }

    /// The pyramids, and `[side][layer]`, their means; then fractions of the tile per um, the size of a
    /// texel and the heights [um], and the free shares.
    pub(crate) fn tables(&self) -> (&[u32], Vec<f32>) {
        let numbers =
            [self.means.as_flattened(), self.per_um.as_flattened(), &[self.texel_um], &self.height_um, &self.free];
        (&self.texels, numbers.concat())
    }
}

/// A level of half the size.
fn halved(of: &[f32], size: usize) -> Vec<f32> {
    let at = |x: usize, y: usize| of[y * 2 * size + x];
    let mean = |x: usize, y: usize| {
        0.25 * (at(2 * x, 2 * y) + at(2 * x + 1, 2 * y) + at(2 * x, 2 * y + 1) + at(2 * x + 1, 2 * y + 1))
    };
    (0..size * size).map(|i| mean(i % size, i / size)).collect()
}

/// The hairs about a point of the cloth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HairsHere<'a> {
    field: &'a HairField,
    /// Place in the tile.
    place: [f32; 2],
    level: f32,
}

impl<'a> HairsHere<'a> {
    /// The hairs about a point of the even cloth [um], for a footprint [um].
    pub(crate) fn new(field: &'a HairField, at_um: [f32; 2], footprint_um: f32) -> Self {
        let place = field.per_um.map(|row| row[0] * at_um[0] + row[1] * at_um[1]);
        // A texel of level l is 2^l as large. Its interpolation blurs too, so half the footprint is its size.
        let level = (0.5 * footprint_um / field.texel_um).max(1.0).min(HAIR_TEXELS as f32).log2();
        HairsHere { field, place, level }
    }

    /// Place in the tile at which a line in direction `w` passes the hairs of a side.
    #[inline(always)]
    fn passed(&self, side: usize, w: [f32; 3]) -> [f32; 2] {
        let way = self.field.height_um[side] / w[2].abs().max(MIN_COSINE).copysign(w[2]);
        let [u, v] = self.field.per_um;
        [self.place[0] + way * (u[0] * w[0] + u[1] * w[1]), self.place[1] + way * (v[0] * w[0] + v[1] * w[1])]
    }

    /// Share of the light to the viewer, in direction `a`, that hairs of a side intercept.
    #[inline(always)]
    pub(crate) fn seen(&self, side: usize, a: [f32; 3], depth: f32) -> f32 {
        self.field.covered(side, self.passed(side, a), self.level, depth)
    }

    /// Share of the light of plies in direction `b` that hairs of a side intercept.
    #[inline(always)]
    pub(crate) fn shadow(&self, side: usize, b: [f32; 3], depth: f32) -> f32 {
        let [u, v] = self.passed(side, b);
        self.field.covered(side, [u + SHADOW[0], v + SHADOW[1]], self.level, depth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over the tile is the probability of the line, whatever the footprint.
    #[test]
    fn the_mean_over_the_tile_is_the_probability() {
        let lattice = Lattice::new([[900.0, 0.0], [150.0, 1100.0]]).expect("a lattice");
        let half = HAIR_TEXELS * HAIR_TEXELS / 2;
        let shares: Vec<u8> = (0..2 * half).map(|i| if i / 7 % 5 == i / 3000 % 5 { 0xF3 } else { 0 }).collect();
        let field = HairField::new(&lattice, [7, 5], [200.0, -200.0], [0.7, 1.0], &shares);
        assert_eq!(field.shares(), shares);
        for footprint in [0.0, 40.0, 700.0f32] {
            for probability in [0.03f32, 0.2, 0.5, 0.9, 0.99] {
                const STEPS: i32 = 400;
                let mut sum = 0.0;
                for i in 0..STEPS * STEPS {
                    let [u, v] = [i % STEPS, i / STEPS].map(|k| 7.0 * (k as f32 + 0.37) / STEPS as f32);
                    let at = [u * 900.0 + v * 150.0, v * 1100.0];
                    let here = HairsHere::new(&field, at, footprint);
                    sum += f64::from(here.seen(0, [0.3, 0.0, 0.95], -(1.0 - probability).ln()));
                }
                let mean = sum / f64::from(STEPS * STEPS);
                assert!((mean - f64::from(probability)).abs() < 0.01, "{footprint}, {probability}: {mean}");
            }
        }
    }
}
