//! One shard of a twin: paths of one view through a cloth, and their sums.
//!
//! Incident lines cross the middle plane at uniform random points of the domain. A path begins where its line
//! reaches the height of the highest fiber, or from the back that of the lowest. Each path is traced once;
//! its lengths within warp and weft fibers give its weight for every pair of absorptions.

use super::options::TwinOptions;
use super::tracer::ClothTracer;
use crate::rays::path::{PathEnd, walk};
use nalgebra::Vector3;
use plywave_runs::{ArrayLayout, Part, Values};
use plywave_tables::twin::CLASSES;
use rand::{Rng, RngExt};
use std::sync::atomic::{AtomicBool, Ordering};

/// Paths between two checks of the stop flag.
const BATCH: u64 = 1024;

/// Sums over the paths of one or more shards of a view.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TwinSums {
    /// Number of paths, of paths that hit no fiber, of killed paths, and of wall interactions.
    pub counts: [f64; 4],
    /// `[sigma][half]`: sum of weights of reflected (0) and transmitted (1) light.
    pub energy: Vec<f64>,
    /// `[sigma][half]`: sum of squared weights.
    pub squares: Vec<f64>,
    /// `[sigma][half][class]`: sum of weights by the number of different yarns hit.
    pub yarns: Vec<f64>,
    /// `[sigma][half][class]`: sum of weights by the number of different plies hit.
    pub plies: Vec<f64>,
    /// `[sigma][bin]`: sum of weights.
    pub bins: Vec<f64>,
    /// `[sigma][bin]`: sum of squared weights.
    pub bin_squares: Vec<f64>,
    /// `[sigma][y][x]`: sum of weights of reflected light by pixel of incidence.
    pub image: Vec<f64>,
    /// `[y][x]`: number of paths by pixel of incidence.
    pub image_paths: Vec<f64>,
}

impl TwinSums {
    pub fn zero(options: &TwinOptions) -> TwinSums {
        let (k, bins, places) = (options.sigma_per_um.len(), options.bins.len(), (options.image as usize).pow(2));
        TwinSums {
            counts: [0.0; 4],
            energy: vec![0.0; 2 * k],
            squares: vec![0.0; 2 * k],
            yarns: vec![0.0; 2 * k * CLASSES],
            plies: vec![0.0; 2 * k * CLASSES],
            bins: vec![0.0; k * bins],
            bin_squares: vec![0.0; k * bins],
            image: vec![0.0; k * places],
            image_paths: vec![0.0; places],
        }
    }

    /// Arrays of the part that holds the sums, with the names and the order of the fields.
    pub fn layout(options: &TwinOptions) -> Vec<ArrayLayout> {
        let (k, bins, n) = (options.sigma_per_um.len(), options.bins, options.image as usize);
        let any = [0.0, f64::MAX];
        vec![
            ArrayLayout::f64("counts", &[4], any),
            ArrayLayout::f64("energy", &[k, 2], any),
            ArrayLayout::f64("squares", &[k, 2], any),
            ArrayLayout::f64("yarns", &[k, 2, CLASSES], any),
            ArrayLayout::f64("plies", &[k, 2, CLASSES], any),
            ArrayLayout::f64("bins", &[k, bins.rows, bins.columns], any),
            ArrayLayout::f64("bin_squares", &[k, bins.rows, bins.columns], any),
            ArrayLayout::f64("image", &[k, n, n], any),
            ArrayLayout::f64("image_paths", &[n, n], any),
        ]
    }

    /// The sums as a part.
    pub fn into_part(self) -> Part {
        let TwinSums { counts, energy, squares, yarns, plies, bins, bin_squares, image, image_paths } = self;
        let arrays = [counts.to_vec(), energy, squares, yarns, plies, bins, bin_squares, image, image_paths];
        Part::new(arrays.into_iter().map(Values::F64).collect())
    }

    /// The sums of a part with the arrays of [`TwinSums::layout`].
    pub fn from_part(part: &Part) -> TwinSums {
        let array = |at: usize| part.f64(at).to_vec();
        let mut counts = [0.0; 4];
        counts.iter_mut().zip(part.f64(0)).for_each(|(to, v)| *to = *v);
        TwinSums {
            counts,
            energy: array(1),
            squares: array(2),
            yarns: array(3),
            plies: array(4),
            bins: array(5),
            bin_squares: array(6),
            image: array(7),
            image_paths: array(8),
        }
    }

    /// Checks that sums over `paths` paths are plausible; the error names the impossible value.
    pub fn check(&self, paths: u64) -> Result<(), String> {
        let [drawn, straight, killed, _] = self.counts;
        let placed: f64 = self.image_paths.iter().sum();
        if drawn != paths as f64 || placed != drawn {
            return Err(format!("{drawn} paths at {placed} places, expected {paths}"));
        }
        let max = self.energy.chunks_exact(2).map(|e| e[0] + e[1]).fold(0.0, f64::max);
        if straight + killed + max > drawn * (1.0 + 1e-9) {
            return Err(format!("{straight} straight, {killed} stopped and {max} scattered of {drawn} paths"));
        }
        Ok(())
    }
}

/// A set of up to [`CLASSES`] different numbers.
#[derive(Default)]
struct Different {
    numbers: [u32; CLASSES],
    count: usize,
}

impl Different {
    #[inline(always)]
    fn add(&mut self, number: u32) {
        if self.count < CLASSES && !self.numbers[..self.count].contains(&number) {
            self.numbers[self.count] = number;
            self.count += 1;
        }
    }
}

/// Traces `paths` paths of light that comes from `view` and adds them to `sums`. `repeat_um` is the size of
/// the repeat that the image shows. Returns `None` when stopped.
pub(super) fn trace_paths<R: Rng>(
    tracer: &ClothTracer,
    options: &TwinOptions,
    view: [f64; 3],
    repeat_um: [f64; 2],
    paths: u64,
    rng: &mut R,
    sums: &mut TwinSums,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Option<()> {
    let (sigmas, bins, side) = (&options.sigma_per_um, options.bins, options.image as usize);
    let size = tracer.size_um();
    let dir = Vector3::from(view.map(|v| -v as f32)).normalize();
    let from_face = dir.z < 0.0;
    let [low, high] = tracer.heights_um();
    let back = if from_face { high } else { low } / dir.z;
    for i in 0..paths {
        if i % BATCH == 0 {
            if stop.load(Ordering::Relaxed) {
                return None;
            }
            progress(BATCH.min(paths - i));
        }
        let place: [f32; 2] = std::array::from_fn(|_| rng.random::<f32>());
        let [x, y] = [0, 1].map(|k| (place[k] - 0.5) * size[k]);
        let (mut lengths, mut yarns, mut plies, mut walls) =
            ([0.0f64; 2], Different::default(), Different::default(), 0u32);
        let end = walk(
            |pos, dir, medium| tracer.trace(pos, dir, medium),
            |fiber| tracer.surface(fiber),
            Vector3::new(x, y, 0.0) + dir * back,
            dir,
            rng,
            |fiber, inside_um, pos| {
                *pos = tracer.folded(*pos);
                let thread = tracer.thread(fiber);
                lengths[thread.family as usize] += f64::from(inside_um);
                yarns.add(2 * thread.yarn + thread.family as u32);
                plies.add(thread.ply);
                walls += 1;
            },
        );
        let cell = |k: usize| {
            let at = f64::from(place[k]) * f64::from(size[k]) / repeat_um[k];
            ((at.fract() * side as f64) as usize).min(side - 1)
        };
        let cell = cell(1) * side + cell(0);
        sums.image_paths[cell] += 1.0;
        sums.counts[0] += 1.0;
        sums.counts[3] += f64::from(walls);
        let out = match end {
            PathEnd::Miss => {
                sums.counts[1] += 1.0;
                continue;
            }
            PathEnd::Killed => {
                sums.counts[2] += 1.0;
                continue;
            }
            PathEnd::Reflected { dir, .. } | PathEnd::High { dir, .. } => dir,
        };
        let half = usize::from((out.z > 0.0) != from_face);
        let bin = bins.bin([out.x, out.y, out.z]);
        for (k, sigma) in sigmas.iter().enumerate() {
            let w = (-sigma[0] * lengths[0] - sigma[1] * lengths[1]).exp();
            sums.energy[2 * k + half] += w;
            sums.squares[2 * k + half] += w * w;
            sums.yarns[(2 * k + half) * CLASSES + yarns.count - 1] += w;
            sums.plies[(2 * k + half) * CLASSES + plies.count - 1] += w;
            sums.bins[k * bins.len() + bin] += w;
            sums.bin_squares[k * bins.len() + bin] += w * w;
            if half == 0 {
                sums.image[k * side * side + cell] += w;
            }
        }
    }
    Some(())
}
