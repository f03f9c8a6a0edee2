//! The whole simulation: an ensemble of ply instances at every incidence, for a [`Table`] (Yu 2025, 5.1).
//!
//! Work is divided into shards of one incident latitude. A shard's random stream and instances depend on the
//! seed and its number alone. The shards of a latitude form a group that is summed in their order, so the
//! table does not depend on threads, machines or interruptions.

use crate::energy_grids::{EnergyGrids, share_rows};
use crate::error::SimError;
use crate::geometry::section::PlySection;
use crate::incidence::Incidence;
use crate::options::{SimOptions, TracerKind};
use crate::rays::mesh_tracer::{MeshResolution, MeshTracer};
use crate::rays::screw::ScrewTracer;
use crate::rays::surface::Surfaces;
use crate::rays::tracer::Tracer;
use crate::seeds::{instance_seed, stream};
use crate::shard::{EXIT_AZIMUTHS, EXIT_POSITIONS, HIT_POSITIONS, TableSums, trace_paths};
use crate::target::{Target, YarnTwin};
use plywave::ply::DRIFT_BINS;
use plywave::spec::YarnSpec;
use plywave_runs::RunError;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards};
use plywave_tables::table::{DISPLACEMENTS, ExitPositions, OutgoingGrid, Table};
use rand::RngExt;
use rayon::prelude::*;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Maximum size of a table in cells of (theta_i, h, 1 + sigma, theta_o, phi_o): 1 GiB of densities.
const MAX_CELLS: f64 = 2.7e8;
/// Flag of the random streams for the rays and paths of the fine energies.
const ENERGIES: u64 = 1 << 63;
/// Maximum deviation of an incidence's energies from 1 at which a table is saved.
const ENERGY_TOLERANCE: f64 = 0.05;

/// Total number of paths that [`simulate`] reports through `progress`.
pub fn total_paths(options: &SimOptions) -> u64 {
    let rows = u64::from(options.theta_i_nodes.max(2));
    let rows = if options.traced_plies { rows } else { (rows - 1) * share_rows(options) as u64 + 1 };
    rows * shard_paths(options) * u64::from(options.shards.max(1))
}

/// Simulates the scattering of one ply of `spec`, or with `options.traced_plies` of the whole yarn with
/// parallel plies. It runs on the current rayon pool; `spec_text` is the text of `spec` and is kept in the
/// table. Progress counts paths.
///
/// # Errors
/// Errors of the geometry, such as [`SimError::CannotPack`], [`RunError::Interrupted`] when stopped, and
/// errors of the parts folder.
pub fn simulate(spec: &YarnSpec, spec_text: &str, options: &SimOptions, run: Run<'_>) -> Result<Table, RunError> {
    runs::run(&SimulateJob::new(spec, spec_text, options)?, run)
}

/// A simulation as a job: shard `m S + s` is the s-th of the S shards of latitude `m`.
pub struct SimulateJob {
    spec: YarnSpec,
    surfaces: Surfaces,
    spec_text: String,
    options: SimOptions,
    theta_i: Vec<f64>,
    h_um: Vec<f64>,
    grid: OutgoingGrid,
    twin: Option<YarnTwin>,
    energies: Option<EnergyGrids>,
    tracers: OnceLock<Vec<Box<dyn Tracer + Send>>>,
}

impl SimulateJob {
    /// The job of `spec`, whose text is `spec_text`.
    ///
    /// # Errors
    /// [`SimError::TooLarge`] for a table above the maximum size.
    pub fn new(spec: &YarnSpec, spec_text: &str, options: &SimOptions) -> Result<SimulateJob, SimError> {
        let (theta_i, h_um) = (options.theta_i(), options.h_um(spec));
        let grid = OutgoingGrid { theta_o: options.theta_o_bins as usize, phi_o: options.phi_o_bins as usize };
        let channels = 1 + spec.absorption.sigma_per_um.len();
        let cells = theta_i.len() as f64 * h_um.len() as f64 * channels as f64 * grid.len() as f64;
        if cells > MAX_CELLS {
            return Err(SimError::TooLarge { cells, allowed: MAX_CELLS });
        }
        let ring = spec.ply_ring();
        let twin = (options.traced_plies && ring.plies > 1).then(|| YarnTwin::new(ring, &h_um));
        Ok(SimulateJob {
            surfaces: Surfaces::of_spec(spec),
            spec: spec.clone(),
            spec_text: spec_text.into(),
            options: options.clone(),
            energies: twin.is_none().then(|| EnergyGrids::new(spec, options, &theta_i, &h_um)),
            theta_i,
            h_um,
            grid,
            twin,
            tracers: OnceLock::new(),
        })
    }

    /// The job of a description.
    ///
    /// # Errors
    /// [`RunError::Merge`] for other options than those of this job, and the errors of the spec.
    pub fn from_description(description: &Description) -> Result<SimulateJob, RunError> {
        let options: SimOptions = description.parse_options()?;
        let spec = YarnSpec::parse(&description.spec, "the part's spec")?;
        Ok(SimulateJob::new(&spec, &description.spec, &options)?)
    }

    /// Refuses a run with so few paths that the noise of its energies exceeds the tolerance of a table.
    ///
    /// # Errors
    /// [`SimError::TooFewPaths`] with a number of paths that suffices.
    pub fn check_savable(&self) -> Result<(), SimError> {
        let off =
            |paths: u64| 5.0 * self.standard_error(&SimOptions { paths_per_theta: paths, ..self.options.clone() });
        let paths = self.options.paths_per_theta;
        let error = off(paths);
        if error <= ENERGY_TOLERANCE {
            return Ok(());
        }
        let mut least = paths.max(1);
        while off(least) > ENERGY_TOLERANCE && least < 1 << 50 {
            least += least.div_ceil(8);
        }
        Err(SimError::TooFewPaths { paths, error, least })
    }

    /// Maximum standard error of the sum of an incidence's energies: that of the stratified integral of a
    /// beam's density over the drawn width.
    fn standard_error(&self, options: &SimOptions) -> f64 {
        let n = instance_paths(options);
        let sd = self.spec.beam.beam().sd_um();
        let half = self.spec.ply_ring().radius_um;
        let step = 2.0 * half / n as f64;
        let batches = (instances_per_shard(options) * u64::from(options.shards.max(1))) as f64;
        // For narrow strata, the variance of each is that of a linear function, and their sum is an integral.
        let narrow = (step / sd).powi(3) / (48.0 * std::f64::consts::PI.sqrt());
        if step < 0.5 * sd {
            return (narrow / batches).sqrt();
        }
        let density = |x: f64, h: f64| (-0.5 * ((x - h) / sd).powi(2)).exp() / (sd * std::f64::consts::TAU.sqrt());
        let inside = self.h_um.iter().filter(|h| h.abs() <= half);
        let variance = inside.map(|h| {
            (0..n)
                .map(|i| {
                    let at = |k: u32| step * density(-half + step * (i as f64 + (f64::from(k) + 0.5) / 64.0), *h);
                    let mean = (0..64).map(at).sum::<f64>() / 64.0;
                    (0..64).map(|k| (at(k) - mean).powi(2)).sum::<f64>() / 64.0
                })
                .sum::<f64>()
        });
        (variance.fold(0.0, f64::max) / batches).sqrt()
    }

    fn incidence(&self, m: usize) -> Incidence<'_> {
        let spec = &self.spec;
        Incidence {
            theta_i: self.theta_i[m],
            h_um: &self.h_um,
            sigma_per_um: &spec.absorption.sigma_per_um,
            beam: spec.beam.beam(),
            grid: self.grid,
            surfaces: &self.surfaces,
            radius_um: spec.ply_ring().radius_um,
            record_exits: self.twin.is_none(),
            energies: self.energies.as_ref(),
        }
    }

    /// Incidence at a latitude between those of the slices, `row / rows` of a step above latitude `m`.
    /// It has energies but no slices.
    fn intermediate(&self, m: usize, row: usize, rows: usize) -> Incidence<'_> {
        let step = self.theta_i[1] - self.theta_i[0];
        let theta_i = self.theta_i[m] + step * row as f64 / rows as f64;
        Incidence { theta_i, h_um: &[], record_exits: false, ..self.incidence(m) }
    }

    /// Number of rows at latitude `m` for `rows` parts of a step; 1 at the last latitude.
    fn rows_at(&self, m: usize, rows: usize) -> usize {
        if m + 1 < self.theta_i.len() { rows } else { 1 }
    }

    /// The instances, built at the first call.
    fn tracers(&self) -> Result<&[Box<dyn Tracer + Send>], SimError> {
        if let Some(tracers) = self.tracers.get() {
            return Ok(tracers);
        }
        let tracers = (0..self.options.instances.max(1))
            .into_par_iter()
            .map(|i| tracer_of(&self.spec, &self.options, i))
            .collect::<Result<_, SimError>>()?;
        Ok(self.tracers.get_or_init(|| tracers))
    }
}

impl Shards for SimulateJob {
    fn description(&self) -> Description {
        Description::new("simulate", &self.options, &self.spec_text)
    }

    fn shards(&self) -> usize {
        self.theta_i.len() * self.group()
    }

    fn group(&self) -> usize {
        self.options.shards.max(1) as usize
    }

    fn units(&self, shard: usize) -> u64 {
        let rows = self.energies.as_ref().map_or(1, |e| self.rows_at(shard / self.group(), e.share_rows));
        shard_paths(&self.options) * rows as u64
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        TableSums::layout(&self.incidence(0))
    }

    fn check(&self, _: usize, count: usize, part: &Part) -> Result<(), String> {
        TableSums::from_part(part).check(shard_paths(&self.options) * count as u64)
    }

    fn shard_bytes(&self) -> Option<usize> {
        // Each lane holds its own sums and finished sums that wait to be merged.
        Some(self.layout(0).iter().map(|a| a.len() * if a.single { 8 } else { 16 }).sum())
    }

    fn prepare(&self) -> Result<(), RunError> {
        Ok(self.tracers().map(|_| ())?)
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let (m, s) = (shard / self.group(), shard % self.group());
        let (options, tracers, at) = (&self.options, self.tracers()?, self.incidence(m));
        let mut sums = TableSums::zero(&at);
        let mut rng = stream(options.seed, [m as u64, s as u64 + 1]);
        let per_shard = instances_per_shard(options);
        for k in 0..per_shard {
            let first = (s as u64 * per_shard + k) as usize;
            let tracer = |p: usize| -> &dyn Tracer { tracers[(first + p) % tracers.len()].as_ref() };
            let paths = instance_paths(options);
            let target = match &self.twin {
                None => Target::Ply(tracer(0)),
                Some(twin) => Target::Yarn(twin, (0..7).map(tracer).collect(), rng.random()),
            };
            if trace_paths(&at, &target, paths, &mut rng, &mut sums, stop, progress).is_none() {
                return Ok(None);
            }
            let Some(energies) = &self.energies else { continue };
            // Separate streams, so that the slices' paths do not depend on the energies' grids.
            let mut rng = stream(options.seed, [m as u64, ENERGIES | first as u64]);
            for row in 1..self.rows_at(m, energies.share_rows) {
                let at = self.intermediate(m, row, energies.share_rows);
                let mut apart = TableSums::zero(&at);
                trace_paths(&at, &target, paths, &mut rng, &mut apart, stop, progress);
                if stop.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                let len = apart.shares.len() / energies.share_rows;
                let to = &mut sums.shares[row * len..(row + 1) * len];
                to.iter_mut().zip(&apart.shares).for_each(|(to, v)| *to += v);
            }
            for row in 0..self.rows_at(m, energies.miss_rows) {
                let at = self.intermediate(m, row, energies.miss_rows);
                energies.trace_rays(&at, tracer(0), row, &mut rng, &mut sums);
                if stop.load(Ordering::Relaxed) {
                    return Ok(None);
                }
            }
        }
        Ok(Some(Done { part: sums.into_part(), peak_bytes: 0 }))
    }
}

impl Job for SimulateJob {
    type Output = Table;
    type Merge = Table;

    fn begin(&self) -> Table {
        let sigma_per_um = &self.spec.absorption.sigma_per_um;
        let mut table = empty_table(&self.spec_text, &self.options, &self.theta_i, &self.h_um, sigma_per_um, self.grid);
        table.traced = self.twin.is_some();
        table.plies = if table.traced { self.spec.ply_ring().plies } else { 1 };
        if self.twin.is_none() {
            table.energies = self.energies.as_ref().map(|e| e.empty(&self.theta_i, sigma_per_um.len()));
            let rows = self.theta_i.len() * self.h_um.len() * (1 + sigma_per_um.len());
            table.exit = Some(ExitPositions {
                azimuths: EXIT_AZIMUTHS,
                positions: EXIT_POSITIONS,
                shares: vec![0.0; rows * EXIT_AZIMUTHS * EXIT_POSITIONS],
                met: vec![0.0; self.theta_i.len() * HIT_POSITIONS],
                drift: vec![0.0; self.theta_i.len() * DRIFT_BINS * DISPLACEMENTS * sigma_per_um.len()],
            });
        }
        table
    }

    fn absorb(&self, table: &mut Table, first: usize, part: Part) {
        let m = first / self.group();
        let sums = TableSums::from_part(&part);
        fill(table, m, &self.incidence(m), &sums);
        if let (Some(grids), Some(to)) = (&self.energies, &mut table.energies) {
            let runs = (self.group() as u64 * instances_per_shard(&self.options)) as f64;
            let instances = runs.min(f64::from(self.options.instances.max(1)));
            grids.fill(to, m, self.spec.beam.beam().sd_um(), &sums, runs, instances);
        }
    }

    fn finish(&self, table: Table) -> Result<Table, RunError> {
        Ok(table)
    }
}

/// Number of paths of one shard over one instance: even and at least 2, since strata are paired.
fn instance_paths(options: &SimOptions) -> u64 {
    let per_shard = options.paths_per_theta.div_ceil(u64::from(options.shards.max(1)));
    per_shard.div_ceil(instances_per_shard(options)).div_ceil(2).max(1) * 2
}

fn instances_per_shard(options: &SimOptions) -> u64 {
    u64::from(options.instances.max(1).div_ceil(options.shards.max(1)))
}

fn shard_paths(options: &SimOptions) -> u64 {
    instance_paths(options) * instances_per_shard(options)
}

fn tracer_of(spec: &YarnSpec, options: &SimOptions, instance: u32) -> Result<Box<dyn Tracer + Send>, SimError> {
    let section = PlySection::generate(spec, instance_seed(options.seed, instance))?;
    let mesh = |section: &PlySection| Box::new(MeshTracer::new(section, MeshResolution::default()));
    Ok(match options.tracer {
        TracerKind::Mesh => mesh(&section),
        TracerKind::Auto => match ScrewTracer::new(&section) {
            Some(t) => Box::new(t),
            None => mesh(&section),
        },
        TracerKind::Screw => Box::new(ScrewTracer::new(&section).ok_or(SimError::TooCrowded)?),
    })
}

fn empty_table(
    spec_text: &str,
    options: &SimOptions,
    theta_i: &[f64],
    h_um: &[f64],
    sigma_per_um: &[f64],
    grid: OutgoingGrid,
) -> Table {
    let (m, mh) = (theta_i.len(), theta_i.len() * h_um.len());
    let k = sigma_per_um.len();
    Table {
        spec_text: spec_text.to_string(),
        program_version: env!("CARGO_PKG_VERSION").to_string(),
        preset: options.preset.clone(),
        seed: options.seed,
        theta_i: theta_i.to_vec(),
        h_um: h_um.to_vec(),
        sigma_per_um: sigma_per_um.to_vec(),
        grid,
        r_d: vec![0.0; mh],
        energy_refl: vec![0.0; mh],
        energy_high: vec![0.0; mh * k],
        energy_se: vec![0.0; mh],
        energy_killed: vec![0.0; mh],
        refl: vec![0.0; mh * grid.len()],
        high: vec![0.0; mh * k * grid.len()],
        noise_refl: vec![0.0; mh],
        noise_high: vec![0.0; mh * k],
        paths: vec![0; m],
        interactions: vec![0.0; m],
        plies: 1,
        traced: false,
        exit: None,
        energies: None,
    }
}

/// Fills the slices of incident latitude `m` from its sums, divided by the number of paths and by solid
/// angles.
fn fill(table: &mut Table, m: usize, at: &Incidence<'_>, sums: &TableSums) {
    let (hs, ks) = (at.h_um.len(), at.sigma_per_um.len());
    let bins = at.grid.len();
    let channels = 1 + ks;
    let inv = 1.0 / sums.counts[0].max(1.0);
    for n in 0..hs {
        let mn = m * hs + n;
        table.r_d[mn] = sums.missed[n] * inv;
        table.energy_refl[mn] = sums.energy[n * channels] * inv;
        table.noise_refl[mn] = sums.noise[n * channels] * inv * inv;
        table.energy_killed[mn] = sums.killed[n] * inv;
        table.energy_se[mn] = sums.variance[n].sqrt() * inv;
        for k in 0..ks {
            table.energy_high[mn * ks + k] = sums.energy[n * channels + 1 + k] * inv;
            table.noise_high[mn * ks + k] = sums.noise[n * channels + 1 + k] * inv * inv;
        }
    }
    for i in 0..at.grid.theta_o {
        let scale = inv / at.grid.solid_angle(i);
        for j in 0..at.grid.phi_o {
            let bin = i * at.grid.phi_o + j;
            for n in 0..hs {
                let from = &sums.bins[(bin * hs + n) * channels..][..channels];
                let mn = m * hs + n;
                table.refl[mn * bins + bin] = (f64::from(from[0]) * scale) as f32;
                for k in 0..ks {
                    table.high[(mn * ks + k) * bins + bin] = (f64::from(from[1 + k]) * scale) as f32;
                }
            }
        }
    }
    if let Some(exit) = &mut table.exit {
        fill_exits(exit, m, at, sums);
    }
    table.paths[m] = sums.counts[0] as u64;
    table.interactions[m] = sums.counts[2] / sums.counts[1].max(1.0);
}

/// Fills the shares of the exit positions and of the rays that hit the ply, at incident latitude `m`.
fn fill_exits(exit: &mut ExitPositions, m: usize, at: &Incidence<'_>, sums: &TableSums) {
    let rows = at.h_um.len() * (1 + at.sigma_per_um.len());
    let (azimuths, positions) = (exit.azimuths, exit.positions);
    for row in 0..rows {
        for a in 0..azimuths {
            let weight = |t: usize| sums.exit[(a * positions + t) * rows + row];
            let total: f64 = (0..positions).map(weight).sum();
            for t in 0..positions {
                let share = if total > 0.0 { weight(t) / total } else { 1.0 / positions as f64 };
                exit.shares[((m * rows + row) * azimuths + a) * positions + t] = share as f32;
            }
        }
    }
    let width = sums.hits.len() / 2;
    for x in 0..width {
        exit.met[m * width + x] = (sums.hits[width + x] / sums.hits[x].max(1.0)) as f32;
    }
    let per_path = 1.0 / sums.counts[0].max(1.0);
    let drift = &mut exit.drift[m * sums.drift.len()..];
    drift.iter_mut().zip(&sums.drift).for_each(|(to, sum)| *to = (sum * per_path) as f32);
}
