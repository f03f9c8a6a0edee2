//! The tensors of a model laid out for the kernels, in f32.
//!
//! Records begin on cache lines, lobes lie side by side, and the reflection grid has one ghost node on each
//! side. Angles are in half turns and bandwidths are stored as log2 of sqrt(mu log2 e), so the kernels need
//! neither a range reduction nor a square root: `exp(-mu u^2) = 2^-(s u)^2` with s = 2 to the power of the
//! stored number.

use crate::ply::asg::PARAMS;
use crate::ply::cone::LobeKind;
use crate::ply::data::energies::coefficient;
use crate::ply::data::{MAX_LOBES, MAX_PATHS, MIN_ENERGY, PlyData, extended};
use std::f64::consts::{LOG2_E, PI};

/// Lanes of high-order lobes that the fast kernels are compiled for: enough for most models, and enough for
/// fibers with flat facets. Both fit 16 lanes together with the reflection lobes.
pub(in crate::ply) const FEW: usize = 8;
pub(in crate::ply) const MORE: usize = 12;

/// Lanes of reflection lobes, and path lengths, that the fast kernels are compiled for.
pub(in crate::ply) const REFL: usize = 4;
pub(in crate::ply) const PATHS: usize = 8;

/// Tables of the fast kernels.
pub(in crate::ply) type Fast<const H: usize> = Tables<H, REFL, PATHS>;

/// Shares of the light that hits fibers, as coefficients of a spline ([`crate::ply::data::energies`]).
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(in crate::ply) struct Shares<const J: usize> {
    pub(in crate::ply) refl: f32,
    /// Path-length spectrum of f_high.
    pub(in crate::ply) high: [f32; J],
}

/// Reflection lobes at four consecutive nodes along theta_i, `[node][parameter][lobe]`.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(in crate::ply) struct Refl<const R: usize>(pub(in crate::ply) [[[f32; R]; PARAMS]; 4]);

/// High-order lobes at a corner of a block, `[parameter][lobe]`, and their spectra, `[lobe][path length]`.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(in crate::ply) struct High<const H: usize, const J: usize> {
    pub(in crate::ply) params: [[f32; H]; PARAMS],
    pub(in crate::ply) spectrum: [[f32; J]; H],
}

/// Arrays for kernels of H high-order lanes, R reflection lanes and J path lengths. Entries beyond those of
/// the model are zero.
#[derive(Clone, Debug)]
pub(in crate::ply) struct Tables<const H: usize, const R: usize, const J: usize> {
    pub(in crate::ply) grid: Grid,
    /// -log2 e times the path lengths [um].
    pub(in crate::ply) path: [f32; J],
    /// `[A+2][B+2]`: coefficients of r_d, with one more beyond each end.
    pub(in crate::ply) miss: Vec<f32>,
    /// `[P+2][Q+2]`: coefficients of the shares, with one more beyond each end.
    pub(in crate::ply) shares: Vec<Shares<J>>,
    /// `[M-1][H+2]`: the nodes -1..=2 of a cell along theta_i, so that a cell's data are contiguous;
    /// extrapolated linearly by one node on each side.
    pub(in crate::ply) refl: Vec<Refl<R>>,
    /// `[(M-1)/2][(H-1)/2]`: high-order lobes at the four corners of a block.
    pub(in crate::ply) high: Vec<[High<H, J>; 4]>,
    /// Minimum energy of each lane: [`MIN_ENERGY`] for lobes, 0 for empty lanes.
    pub(in crate::ply) min_energy_high: [f32; H],
    pub(in crate::ply) min_energy_refl: [f32; R],
    /// Number of pairs of high-order lanes that hold a lobe.
    pub(in crate::ply) pairs: usize,
    /// Bounds of the stored bandwidths.
    pub(in crate::ply) bandwidth: (f32, f32),
    /// Bounds of mu2 for cone lobes; the same as `bandwidth` for round ones.
    pub(in crate::ply) bandwidth_across: (f32, f32),
}

/// The grid of the nodes.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct Grid {
    pub(in crate::ply) nodes_h: u32,
    /// Index of the last node along theta_i and along h.
    pub(in crate::ply) last_theta: f32,
    pub(in crate::ply) last_h: f32,
    /// Nodes per radian of theta_i and per um of h.
    pub(in crate::ply) per_theta: f32,
    pub(in crate::ply) per_h: f32,
    /// Last offset node [um]; the first is its negative.
    pub(in crate::ply) h_last: f32,
    /// Nodes of r_d and of the shares.
    pub(in crate::ply) miss: SplineGrid,
    pub(in crate::ply) shares: SplineGrid,
}

/// Nodes of a spline over the same range of theta_i and h.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct SplineGrid {
    /// Coefficients per row, including those beyond the ends.
    pub(in crate::ply) row: u32,
    pub(in crate::ply) last_theta: f32,
    pub(in crate::ply) last_h: f32,
    pub(in crate::ply) per_theta: f32,
    pub(in crate::ply) per_h: f32,
}

impl SplineGrid {
    fn new(theta_i: &[f64], h_um: &[f64]) -> SplineGrid {
        let (rows, columns) = (theta_i.len(), h_um.len());
        SplineGrid {
            row: columns as u32 + 2,
            last_theta: (rows - 1) as f32,
            last_h: (columns - 1) as f32,
            per_theta: ((rows - 1) as f64 / theta_i[rows - 1]) as f32,
            per_h: ((columns - 1) as f64 / (2.0 * h_um[columns - 1])) as f32,
        }
    }
}

/// The coefficients `of(node)` of a grid of `sizes`, with one more beyond each end.
fn bordered<T>([rows, columns]: [usize; 2], of: impl Fn(isize, isize) -> T) -> Vec<T> {
    (-1..=rows as isize).flat_map(|m| (-1..=columns as isize).map(move |n| (m, n))).map(|(m, n)| of(m, n)).collect()
}

/// Tables of one of three sizes for round lobes, or of one of two for cones.
#[derive(Clone, Debug)]
pub(in crate::ply) enum Layout {
    Few(Box<Fast<FEW>>),
    More(Box<Fast<MORE>>),
    Large(Box<Tables<MAX_LOBES, MAX_LOBES, MAX_PATHS>>),
    /// Tables of cone lobes.
    Cone(Box<Fast<MORE>>),
    LargeCone(Box<Tables<MAX_LOBES, MAX_LOBES, MAX_PATHS>>),
}

impl Layout {
    /// Lays out checked data.
    pub(in crate::ply) fn new(d: &PlyData) -> Layout {
        let fast = d.lobes_refl <= REFL && d.path_um.len() <= PATHS;
        if d.family == LobeKind::Cone {
            return match d.lobes_high {
                0..=MORE if fast => Layout::Cone(Box::new(Tables::new(d))),
                _ => Layout::LargeCone(Box::new(Tables::new(d))),
            };
        }
        match d.lobes_high {
            0..=FEW if fast => Layout::Few(Box::new(Tables::new(d))),
            0..=MORE if fast => Layout::More(Box::new(Tables::new(d))),
            _ => Layout::Large(Box::new(Tables::new(d))),
        }
    }
}

/// Lobe parameter `k` in the units of the kernels, from its f32 value in files.
fn stored(family: LobeKind, k: usize, value: f64) -> f64 {
    let value = f64::from(value as f32);
    match k {
        // Offset and slope of a cone are not angles of an axis and stay in radians.
        0 | 2 if family == LobeKind::Cone => value,
        0..3 => value / PI,
        3 | 4 => 0.5 * (value * LOG2_E + LOG2_E.log2()),
        _ => value,
    }
}

impl<const H: usize, const R: usize, const J: usize> Tables<H, R, J> {
    /// Lays out checked data of at most these sizes.
    fn new(d: &PlyData) -> Self {
        let (m, h, _, j) = d.sizes();
        let e = &d.energies;
        let miss_sizes = [e.miss_theta_i.len(), e.miss_h_um.len()];
        let share_sizes = [e.share_theta_i.len(), e.share_h_um.len()];
        let missed = |m: isize, n: isize| coefficient(miss_sizes, m, n, &|m, n| e.miss[m * miss_sizes[1] + n]) as f32;
        let shares = |m: isize, n: isize| {
            let of = |c: &[f64], stride: usize, k: usize| {
                coefficient(share_sizes, m, n, &|m, n| c[(m * share_sizes[1] + n) * stride + k]) as f32
            };
            Shares {
                refl: of(&e.share_refl, 1, 0),
                high: std::array::from_fn(|p| if p < j { of(&e.share_high, j, p) } else { 0.0 }),
            }
        };
        let mut refl = Vec::with_capacity((m - 1) * (h + 2));
        for a in 0..m as isize - 1 {
            for b in -1..=h as isize {
                let value = |a: isize, k: usize, l: usize| {
                    let node =
                        |i: usize, j: usize| stored(d.family, k, d.refl[((i * h + j) * d.lobes_refl + l) * PARAMS + k]);
                    let row = |i: usize| extended(b, h, &|j| node(i, j));
                    if l < d.lobes_refl { extended(a, m, &row) as f32 } else { 0.0 }
                };
                refl.push(Refl(std::array::from_fn(|i| {
                    std::array::from_fn(|k| std::array::from_fn(|l| value(a + i as isize - 1, k, l)))
                })));
            }
        }

        let corner = |c: usize| {
            let value = |k: usize, l: usize| stored(d.family, k, d.high[(c * d.lobes_high + l) * PARAMS + k]) as f32;
            let share = |l: usize, p: usize| d.high_path[(c * d.lobes_high + l) * j + p] as f32;
            let is = |l: usize| l < d.lobes_high;
            High {
                params: std::array::from_fn(|k| std::array::from_fn(|l| if is(l) { value(k, l) } else { 0.0 })),
                spectrum: std::array::from_fn(|l| {
                    std::array::from_fn(|p| if is(l) && p < j { share(l, p) } else { 0.0 })
                }),
            }
        };
        let [low, high] =
            [0, 1].map(|end| d.family.bandwidths().map(|b| stored(d.family, 3, [b.0, b.1][end].ln()) as f32));
        let bounds = |k: usize| (low[k - 3], high[k - 3]);
        let min_energy = |is: bool| if is { MIN_ENERGY as f32 } else { 0.0 };
        Tables {
            grid: Grid {
                nodes_h: h as u32,
                last_theta: (m - 1) as f32,
                last_h: (h - 1) as f32,
                per_theta: (m - 1) as f32 / d.theta_i[m - 1] as f32,
                per_h: (h - 1) as f32 / (2.0 * d.h_um[h - 1]) as f32,
                h_last: d.h_um[h - 1] as f32,
                miss: SplineGrid::new(&e.miss_theta_i, &e.miss_h_um),
                shares: SplineGrid::new(&e.share_theta_i, &e.share_h_um),
            },
            path: std::array::from_fn(|p| if p < j { (-LOG2_E * d.path_um[p]) as f32 } else { 0.0 }),
            miss: bordered(miss_sizes, missed),
            shares: bordered(share_sizes, shares),
            refl,
            high: (0..(m / 2) * (h / 2)).map(|b| std::array::from_fn(|c| corner(b * 4 + c))).collect(),
            min_energy_high: std::array::from_fn(|l| min_energy(l < d.lobes_high)),
            min_energy_refl: std::array::from_fn(|l| min_energy(l < d.lobes_refl)),
            pairs: d.lobes_high.div_ceil(2),
            bandwidth: bounds(3),
            bandwidth_across: bounds(4),
        }
    }
}
