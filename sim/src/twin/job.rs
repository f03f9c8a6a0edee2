//! The twin as a sharded job. Shard `v S + s` is the s-th of the S shards of view v; its random numbers
//! depend on the seed and its number alone. A view's result is the sum of its shards over the number of
//! paths.

use super::curves::TwinCurves;
use super::domain::Domain;
use super::options::TwinOptions;
use super::shard::{TwinSums, trace_paths};
use super::tracer::ClothTracer;
use crate::error::SimError;
use crate::seeds::stream;
use plywave_runs::RunError;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards};
use plywave_tables::twin::{CLASSES, ClothTwin};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

/// Traces the twin of a cloth on the threads of the current rayon pool. Progress counts paths.
///
/// # Errors
/// The errors of [`TwinJob::new`] and [`ClothTracer::new`], [`RunError::Interrupted`] when stopped, and
/// errors of the parts folder.
pub fn twin(cloth: &TwinCurves, options: &TwinOptions, run: Run<'_>) -> Result<ClothTwin, RunError> {
    runs::run(&TwinJob::new(cloth.clone(), options)?, run)
}

/// Size of a twin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwinSize {
    /// Number of fibers, each over a whole loop of its ply, and hairs.
    pub fibers: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Memory of the tracer [bytes].
    pub memory_bytes: usize,
}

/// A twin as a job.
pub struct TwinJob {
    cloth: TwinCurves,
    options: TwinOptions,
    domain: Domain,
    tracer: OnceLock<ClothTracer>,
}

/// Maximum length of a traced side [um].
const LONGEST_UM: f64 = 2e5;

impl TwinJob {
    /// The job of a cloth.
    ///
    /// # Errors
    /// [`SimError::Option`] for options out of range.
    pub fn new(cloth: TwinCurves, options: &TwinOptions) -> Result<TwinJob, SimError> {
        let refuse = |name, value, allowed| Err(SimError::Option { name, value, allowed });
        let unit = |v: &[f64; 3]| (v.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-9 && v[2].abs() > 1e-3;
        let absorbs = |s: &[f64; 2]| s.iter().all(|s| (0.0..=1e6).contains(s));
        let TwinOptions { views, sigma_per_um, bins, image, shards, .. } = options;
        if views.is_empty() || !views.iter().all(unit) {
            return refuse("views", views.len(), "1 or more unit directions out of the plane");
        }
        if sigma_per_um.is_empty() || !sigma_per_um.iter().all(absorbs) {
            return refuse("sigma_per_um", sigma_per_um.len(), "1 or more pairs of 0 to 1e6");
        }
        if bins.is_empty() || bins.rows % 2 == 1 || bins.len() > 1 << 20 {
            return refuse("bins", bins.len(), "an even number of rows, and 2 to 1048576 bins");
        }
        if !(1..=4096).contains(image) {
            return refuse("image", *image as usize, "1 to 4096");
        }
        if !(1..=1 << 20).contains(shards) {
            return refuse("shards", *shards as usize, "1 to 1048576");
        }
        // Longer sides have too many fibers to trace and too many steps along the curves.
        let repeats = options.repeats.unwrap_or([1; 2]).map(f64::from);
        let sides = cloth.repeat_um();
        if let Some(side) = (0..2).map(|k| sides[k] * repeats[k]).find(|side| side.is_nan() || *side > LONGEST_UM) {
            return refuse("repeats", side as usize, "so many that the sides are 200000 um at most");
        }
        let domain = cloth.domain(options.repeats, &options.mesh);
        Ok(TwinJob { cloth, options: options.clone(), domain, tracer: OnceLock::new() })
    }

    /// The job of a description.
    ///
    /// # Errors
    /// [`RunError::Merge`] for text that describes no cloth of curves, and the errors of [`TwinCurves::new`]
    /// and [`TwinJob::new`].
    pub fn from_description(description: &Description) -> Result<TwinJob, RunError> {
        let cloth = TwinCurves::parse(&description.spec).ok_or_else(|| RunError::Merge {
            what: "the text of the cloth: not one of curves".into(),
            hint: "read it with the program that wrote it".into(),
        })??;
        Ok(TwinJob::new(cloth, &description.parse_options()?)?)
    }

    /// The part of the cloth that is traced.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Builds the triangles and returns their size.
    ///
    /// # Errors
    /// The errors of [`ClothTracer::new`].
    pub fn size(&self) -> Result<TwinSize, SimError> {
        let tracer = self.tracer()?;
        Ok(TwinSize { fibers: tracer.fibers(), triangles: tracer.triangles(), memory_bytes: tracer.memory_bytes() })
    }

    fn tracer(&self) -> Result<&ClothTracer, SimError> {
        if let Some(tracer) = self.tracer.get() {
            return Ok(tracer);
        }
        let tracer = ClothTracer::new(&self.cloth, &self.domain, &self.options.mesh, self.options.seed)?;
        Ok(self.tracer.get_or_init(|| tracer))
    }
}

impl Shards for TwinJob {
    fn description(&self) -> Description {
        Description::new("twin", &self.options, self.cloth.text())
    }

    fn shards(&self) -> usize {
        self.options.views.len() * self.group()
    }

    fn group(&self) -> usize {
        self.options.shards.max(1) as usize
    }

    fn units(&self, _: usize) -> u64 {
        self.options.shard_paths()
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        TwinSums::layout(&self.options)
    }

    fn check(&self, _: usize, count: usize, part: &Part) -> Result<(), String> {
        TwinSums::from_part(part).check(self.options.shard_paths() * count as u64)
    }

    fn shard_bytes(&self) -> Option<usize> {
        // Each lane holds its own sums and finished sums that wait to be merged.
        Some(self.layout(0).iter().map(|a| a.len() * 16).sum())
    }

    fn prepare(&self) -> Result<(), RunError> {
        Ok(self.tracer().map(|_| ())?)
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let (view, s) = (shard / self.group(), shard % self.group());
        let mut sums = TwinSums::zero(&self.options);
        let mut rng = stream(self.options.seed, [view as u64, s as u64 + 1]);
        let (direction, repeat) = (self.options.views[view], self.cloth.repeat_um());
        let paths = self.options.shard_paths();
        let done =
            trace_paths(self.tracer()?, &self.options, direction, repeat, paths, &mut rng, &mut sums, stop, progress);
        Ok(done.map(|()| Done { part: sums.into_part(), peak_bytes: 0 }))
    }
}

impl Job for TwinJob {
    type Output = ClothTwin;
    type Merge = ClothTwin;

    fn begin(&self) -> ClothTwin {
        let options = &self.options;
        let (v, k) = (options.views.len(), options.sigma_per_um.len());
        let (bins, places) = (options.bins.len(), (options.image as usize).pow(2));
        ClothTwin {
            spec_text: self.cloth.text().into(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            name: self.cloth.name.clone(),
            seed: options.seed,
            repeat_um: self.cloth.repeat_um(),
            repeats: self.domain.repeats,
            views: options.views.concat(),
            sigma_per_um: options.sigma_per_um.concat(),
            bins: options.bins,
            paths: vec![0; v],
            straight: vec![0.0; v],
            killed: vec![0.0; v],
            interactions: vec![0.0; v],
            reflected: vec![0.0; v * k],
            transmitted: vec![0.0; v * k],
            reflected_se: vec![0.0; v * k],
            transmitted_se: vec![0.0; v * k],
            by_yarns: vec![0.0; v * k * 2 * CLASSES],
            by_plies: vec![0.0; v * k * 2 * CLASSES],
            density: vec![0.0; v * k * bins],
            variance: vec![0.0; v * k * bins],
            image: vec![0.0; v * k * places],
            image_size: [options.image as usize; 2],
        }
    }

    fn absorb(&self, twin: &mut ClothTwin, first: usize, part: Part) {
        fill(twin, first / self.group(), &TwinSums::from_part(&part));
    }

    fn finish(&self, twin: ClothTwin) -> Result<ClothTwin, RunError> {
        Ok(twin)
    }
}

/// Fills the results of a view from its sums, divided by the number of paths and by solid angles.
fn fill(twin: &mut ClothTwin, view: usize, sums: &TwinSums) {
    let [paths, straight, killed, walls] = sums.counts;
    let inv = 1.0 / paths.max(1.0);
    // Variance of a mean over paths, from the sums of the weights and of their squares.
    let variance = |sum: f64, squares: f64| ((squares - sum * sum * inv) * inv * inv).max(0.0);
    twin.paths[view] = paths as u64;
    (twin.straight[view], twin.killed[view]) = (straight * inv, killed * inv);
    twin.interactions[view] = walls / (paths - straight).max(1.0);
    let k = twin.sigma_count();
    for sigma in 0..k {
        let at = view * k + sigma;
        twin.reflected[at] = sums.energy[2 * sigma] * inv;
        twin.transmitted[at] = sums.energy[2 * sigma + 1] * inv;
        twin.reflected_se[at] = variance(sums.energy[2 * sigma], sums.squares[2 * sigma]).sqrt();
        twin.transmitted_se[at] = variance(sums.energy[2 * sigma + 1], sums.squares[2 * sigma + 1]).sqrt();
    }
    let scaled = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(to, from)| *to = from * inv);
    let classes = 2 * k * CLASSES;
    scaled(&mut twin.by_yarns[view * classes..][..classes], &sums.yarns);
    scaled(&mut twin.by_plies[view * classes..][..classes], &sums.plies);
    let per_solid_angle = 1.0 / twin.bins.solid_angle();
    let bins = k * twin.bins.len();
    for bin in 0..bins {
        twin.density[view * bins + bin] = (sums.bins[bin] * inv * per_solid_angle) as f32;
        let variance = variance(sums.bins[bin], sums.bin_squares[bin]);
        twin.variance[view * bins + bin] = (variance * per_solid_angle * per_solid_angle) as f32;
    }
    let places = sums.image_paths.len();
    for (i, weight) in sums.image.iter().enumerate() {
        let drawn = sums.image_paths[i % places];
        twin.image[view * sums.image.len() + i] = if drawn > 0.0 { (weight / drawn) as f32 } else { 0.0 };
    }
}
