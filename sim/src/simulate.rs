//! The whole simulation: an ensemble of ply instances, every incidence, into a [`Table`] (Yu 2025, 5.1).
//!
//! Work is cut into shards of one incident latitude. A shard's random stream and instances depend on the seed and its place
//! alone, and shards are summed in their order, whatever thread finished first: the table does not depend on the number of
//! threads, nor on interruptions. With a parts folder every finished shard is written there before it counts, so that
//! a resumed run loses at most the shards in work.

use crate::error::SimError;
use crate::geometry::section::PlySection;
use crate::options::{SimOptions, TracerKind};
use crate::parts::Parts;
use crate::rays::dielectric::RoughDielectric;
use crate::rays::mesh_tracer::{MeshResolution, MeshTracer};
use crate::rays::screw::ScrewTracer;
use crate::rays::tracer::Tracer;
use crate::shard::{EXIT_AZIMUTHS, EXIT_POSITIONS, Incidence, MET_POSITIONS, Sums, trace_paths};
use crate::target::{Target, YarnTwin};
use plywave::math::hash::SplitMix64;
use plywave::{ExitPositions, OutgoingGrid, Table, YarnSpec};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// How a simulation is run: nothing here changes its result.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Folder for finished shards; None keeps them in memory only.
    pub parts: Option<&'a Path>,
    /// Take up what the parts folder holds; else it must not exist or is emptied.
    pub resume: bool,
    /// Set to stop at the next opportunity with [`SimError::Interrupted`].
    pub stop: Option<&'a AtomicBool>,
    /// Called with a number of paths just traced (or found done in the parts folder), from any thread.
    pub progress: Option<&'a (dyn Fn(u64) + Sync)>,
}

impl Run<'_> {
    /// In memory, without progress, to the end.
    pub fn plain() -> Run<'static> {
        Run { parts: None, resume: false, stop: None, progress: None }
    }
}

/// Largest table, in cells of (theta_i, h, 1 + sigma, theta_o, phi_o): 1 GiB of densities.
const MAX_CELLS: f64 = 2.7e8;

/// Paths that [`simulate`] will report through `progress`, in all.
pub fn total_paths(options: &SimOptions) -> u64 {
    u64::from(options.theta_i_nodes.max(2)) * shard_paths(options) * u64::from(options.shards)
}

/// Simulate the scattering of `spec`, whose text is `spec_text` (kept in the table), on the threads of the current rayon pool: that of one ply, or
/// with `options.traced_plies` that of the whole yarn, its plies parallel where they lie.
///
/// # Errors
/// [`SimError::CannotPack`] and the like when the geometry cannot be built, [`SimError::Interrupted`] when stopped, file errors
/// of the parts folder.
pub fn simulate(spec: &YarnSpec, spec_text: &str, options: &SimOptions, run: Run<'_>) -> Result<Table, SimError> {
    let theta_i = options.theta_i();
    let h_um = options.h_um(spec);
    let sigma_per_um = spec.absorption.sigma_per_um.clone();
    let grid = OutgoingGrid { theta_o: options.theta_o_bins as usize, phi_o: options.phi_o_bins as usize };
    let cells = theta_i.len() as f64 * h_um.len() as f64 * (1 + sigma_per_um.len()) as f64 * grid.len() as f64;
    if cells > MAX_CELLS {
        return Err(SimError::TooLarge { cells, allowed: MAX_CELLS });
    }
    let never = AtomicBool::new(false);
    let stop = run.stop.unwrap_or(&never);
    let silent = |_: u64| {};
    let progress: &(dyn Fn(u64) + Sync) = run.progress.unwrap_or(&silent);
    let parts = match run.parts {
        Some(folder) => Some(Parts::open(folder, run.resume, spec_text, options)?),
        None => None,
    };
    let ring = spec.ply_ring();
    let twin = (options.traced_plies && ring.plies > 1).then(|| YarnTwin::new(ring, &h_um));
    let incidences: Vec<Incidence<'_>> = theta_i
        .iter()
        .map(|&theta_i| Incidence {
            theta_i,
            h_um: &h_um,
            sigma_per_um: &sigma_per_um,
            beam: spec.beam.beam(),
            grid,
            surface: RoughDielectric { eta: spec.fiber.eta as f32, alpha: spec.fiber.alpha_fiber as f32 },
            radius_um: ring.radius_um,
            record_exits: twin.is_none(),
        })
        .collect();
    let tracers: Vec<Box<dyn Tracer + Send>> = (0..options.instances.max(1))
        .into_par_iter()
        .map(|i| tracer_of(spec, options, i))
        .collect::<Result<_, SimError>>()?;
    let shards = options.shards.max(1) as usize;
    let mut table = empty_table(spec_text, options, &theta_i, &h_um, &sigma_per_um, grid);
    table.traced = twin.is_some();
    table.plies = if table.traced { ring.plies } else { 1 };
    if twin.is_none() {
        let rows = theta_i.len() * h_um.len() * (1 + sigma_per_um.len());
        table.exit = Some(ExitPositions {
            azimuths: EXIT_AZIMUTHS,
            positions: EXIT_POSITIONS,
            shares: vec![0.0; rows * EXIT_AZIMUTHS * EXIT_POSITIONS],
            met: vec![0.0; theta_i.len() * MET_POSITIONS],
        });
    }
    // Latitudes that an earlier run finished, and the shards that are left, in the order they are summed.
    let mut left = Vec::new();
    for (m, at) in incidences.iter().enumerate() {
        let mut sums = Sums::zero(at);
        if let Some(parts) = &parts
            && parts.read(m, None, &mut sums)?
        {
            fill(&mut table, m, at, &sums);
            progress(shard_paths(options) * shards as u64);
        } else {
            left.extend((0..shards).map(|s| (m, s)));
        }
    }
    let jobs = left.len();
    let state = Mutex::new(Reduction { next: 0, pending: BTreeMap::new(), sums: None, table, failed: None });
    let counter = AtomicUsize::new(0);
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads() {
            scope.spawn(|_| {
                loop {
                    let job = counter.fetch_add(1, Ordering::Relaxed);
                    if job >= jobs || stop.load(Ordering::Relaxed) {
                        return;
                    }
                    let (m, s) = left[job];
                    let done = run_shard(
                        &incidences[m],
                        &tracers,
                        twin.as_ref(),
                        options,
                        (m, s),
                        parts.as_ref(),
                        stop,
                        progress,
                    );
                    let mut reduction = state.lock().unwrap_or_else(|e| e.into_inner());
                    match done {
                        Ok(Some(sums)) => {
                            reduction.pending.insert(job, sums);
                            if let Err(e) = reduction.advance(&left, &incidences, shards, parts.as_ref()) {
                                reduction.fail(e, stop);
                            }
                        }
                        Ok(None) => return,
                        Err(e) => reduction.fail(e, stop),
                    }
                }
            });
        }
    });
    let reduction = state.into_inner().unwrap_or_else(|e| e.into_inner());
    if let Some(e) = reduction.failed {
        return Err(e);
    }
    if reduction.next < jobs {
        return Err(SimError::Interrupted { left: jobs - reduction.next, total: theta_i.len() * shards });
    }
    Ok(reduction.table)
}

/// Paths of one shard over one instance, at least two (one pair of strata).
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

/// A well-mixed 128-bit state from the seed and the place of a stream.
pub(crate) fn stream(seed: u64, place: [u64; 2]) -> Pcg64Mcg {
    let mut state = SplitMix64(seed);
    let mut word = |salt: u64| {
        state.0 ^= salt;
        state.next_u64()
    };
    let hi = word(place[0]);
    let lo = word(place[1]);
    Pcg64Mcg::new(u128::from(hi) << 64 | u128::from(lo))
}

/// Seed of the geometry of instance `i`: distinct for every i and every seed below 2^32.
pub(crate) fn instance_seed(seed: u64, i: u32) -> u64 {
    seed.wrapping_mul(0x1_0000_0000).wrapping_add(u64::from(i))
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

/// One shard, from the parts folder or traced (and then written there); None when stopped.
fn run_shard(
    at: &Incidence<'_>,
    tracers: &[Box<dyn Tracer + Send>],
    twin: Option<&YarnTwin>,
    options: &SimOptions,
    (m, s): (usize, usize),
    parts: Option<&Parts>,
    stop: &AtomicBool,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Option<Sums>, SimError> {
    let mut sums = Sums::zero(at);
    if let Some(parts) = parts {
        if parts.read(m, Some(s), &mut sums)? {
            progress(shard_paths(options));
            return Ok(Some(sums));
        }
        // What a damaged file may have left in the sums is thrown away.
        sums = Sums::zero(at);
    }
    let mut rng = stream(options.seed, [m as u64, s as u64 + 1]);
    let per_shard = instances_per_shard(options);
    for k in 0..per_shard {
        let first = (s as u64 * per_shard + k) as usize;
        let tracer = |p: usize| -> &dyn Tracer { tracers[(first + p) % tracers.len()].as_ref() };
        let paths = instance_paths(options);
        let target = match twin {
            None => Target::Ply(tracer(0)),
            Some(twin) => Target::Yarn(twin, (0..7).map(tracer).collect(), rng.random()),
        };
        if trace_paths(at, &target, paths, &mut rng, &mut sums, stop, progress).is_none() {
            return Ok(None);
        }
    }
    if let Some(parts) = parts {
        parts.write(m, Some(s), &sums)?;
    }
    Ok(Some(sums))
}

/// Sums shards in their order and turns each finished incident latitude into its slices of the table.
struct Reduction {
    next: usize,
    pending: BTreeMap<usize, Sums>,
    sums: Option<Sums>,
    table: Table,
    failed: Option<SimError>,
}

impl Reduction {
    /// Sum what is next in order; a finished latitude is written as one file in place of its shards.
    fn advance(
        &mut self,
        left: &[(usize, usize)],
        incidences: &[Incidence<'_>],
        shards: usize,
        parts: Option<&Parts>,
    ) -> Result<(), SimError> {
        while let Some(shard) = self.pending.remove(&self.next) {
            let (m, s) = left[self.next];
            match &mut self.sums {
                Some(sums) => sums.add(&shard),
                None => self.sums = Some(shard),
            }
            self.next += 1;
            if s + 1 == shards
                && let Some(sums) = self.sums.take()
            {
                fill(&mut self.table, m, &incidences[m], &sums);
                if let Some(parts) = parts {
                    parts.write(m, None, &sums)?;
                    parts.remove_shards(m, shards);
                }
            }
        }
        Ok(())
    }

    fn fail(&mut self, error: SimError, stop: &AtomicBool) {
        self.failed.get_or_insert(error);
        stop.store(true, Ordering::Relaxed);
    }
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
    }
}

/// Slices of incident latitude `m` from its sums: divided by the paths drawn and the solid angles, and nothing else.
fn fill(table: &mut Table, m: usize, at: &Incidence<'_>, sums: &Sums) {
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

/// Shares of the exit positions and of the rays that met the ply, of incident latitude `m`.
fn fill_exits(exit: &mut ExitPositions, m: usize, at: &Incidence<'_>, sums: &Sums) {
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
    let width = sums.met.len() / 2;
    for x in 0..width {
        exit.met[m * width + x] = (sums.met[width + x] / sums.met[x].max(1.0)) as f32;
    }
}
