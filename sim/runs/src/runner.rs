//! Runs shards in parallel as far as memory allows, stores finished ones in memory or in a folder, and adds
//! them up in order.

use super::arrays::Part;
use super::folder::{PartsFolder, block_name};
use super::job::{Job, Plan, Shards};
use super::part::{Entry, check_part, encode};
use super::{disk, memory};
use crate::error::RunError;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Options of a run, which do not change its result.
#[derive(Clone, Copy, Default)]
pub struct Run<'a> {
    /// Folder for finished shards, from which a run can be resumed; `None` stores them in memory only.
    pub parts: Option<&'a PartsFolder>,
    /// Set to stop at the next opportunity with [`RunError::Interrupted`].
    pub stop: Option<&'a AtomicBool>,
    /// Called with a number of units just done (or found done in the parts folder), from any thread.
    pub progress: Option<&'a (dyn Fn(u64) + Sync)>,
}

impl Run<'_> {
    /// A run in memory, without progress reports or a stop flag.
    pub fn plain() -> Run<'static> {
        Run::default()
    }
}

/// Runs all shards of a job on the current thread pool and merges them.
///
/// # Errors
/// The failure of the first shard by number that fails, [`RunError::Interrupted`] when stopped, errors of the
/// parts folder.
pub fn run<J: Job>(job: &J, run: Run<'_>) -> Result<J::Output, RunError> {
    let plan = Plan::from_job(job);
    let mut merge = job.begin();
    execute(job, &plan, 0..plan.shards, run, &mut |entry| job.absorb(&mut merge, entry.first, entry.part))?;
    job.finish(merge)
}

/// Runs part `index` (from 1) of `count` of a job and writes it to the file `path`.
///
/// # Errors
/// The errors of [`run`], and [`RunError::TooManyParts`] if the job has fewer shards than parts.
pub fn run_part(
    job: &dyn Shards,
    (index, count): (usize, usize),
    path: &Path,
    run: Run<'_>,
) -> Result<Range<usize>, RunError> {
    let plan = Plan::from_job(job);
    if count > plan.shards || index == 0 || index > count {
        return Err(RunError::TooManyParts { index, count, shards: plan.shards });
    }
    let shards = plan.slice(index, count);
    let mut entries = Vec::new();
    execute(job, &plan, shards.clone(), run, &mut |entry| entries.push(entry))?;
    disk::write_whole(path, &encode(job, &plan, &entries, &path.display().to_string())?)?;
    Ok(shards)
}

/// Runs one shard, or one whole group of shards, and returns the bytes of its file in a parts folder. With
/// the files of all shards in the folder, a resumed run only merges.
///
/// # Errors
/// The errors of [`run`], and [`RunError::Merge`] for a range that is neither one shard nor a group.
pub fn run_block(job: &dyn Shards, shards: Range<usize>, run: Run<'_>) -> Result<Vec<u8>, RunError> {
    let plan = Plan::from_job(job);
    if shards.end > plan.shards || !(shards.len() == 1 || blocks(&plan, shards.clone()).len() == 1) {
        return Err(RunError::Merge {
            what: format!(
                "shards {} to {} are no block of {}",
                shards.start,
                shards.end.saturating_sub(1),
                plan.shards
            ),
            hint: format!("give one shard, or a group of {} that begins at a multiple of it", plan.group),
        });
    }
    let mut entries = Vec::new();
    execute(job, &plan, shards.clone(), run, &mut |entry| entries.push(entry))?;
    encode(job, &plan, &entries, &block_name(shards.start, shards.len()))
}

/// Checks the parts of `job` in the folder of `run` before any work, so that a job late in a chain is not
/// refused after hours.
///
/// # Errors
/// The errors of [`run`] for parts that may be neither used nor deleted.
pub fn check_parts(job: &dyn Shards, run: Run<'_>) -> Result<(), RunError> {
    run.parts.map_or(Ok(()), |parts| parts.scan(job, &Plan::from_job(job)).map(|_| ()))
}

/// Consecutive shards that are added up: whole groups, beginnings of groups, and otherwise single shards.
pub(super) fn blocks(plan: &Plan, shards: Range<usize>) -> Vec<Range<usize>> {
    let mut blocks = Vec::new();
    let mut at = shards.start;
    while at < shards.end {
        let end = if at.is_multiple_of(plan.group) { (at + plan.group).min(shards.end) } else { at + 1 };
        blocks.push(at..end);
        at = end;
    }
    blocks
}

/// One step of the sums, in their order.
enum Step {
    /// A block that an earlier run finished.
    Block(Range<usize>),
    /// A shard, whether an earlier run has finished it, and the block that it completes.
    Shard { shard: usize, stored: bool, ends: Option<Range<usize>> },
}

/// State shared by the lanes.
struct State<'a> {
    next: usize,
    finished: BTreeMap<usize, Part>,
    sum: Option<Part>,
    failed: Option<(usize, RunError)>,
    give: &'a mut (dyn FnMut(Entry) + Send),
}

/// Passes the sums of all blocks of `shards` to `give`, in order.
fn execute(
    job: &dyn Shards,
    plan: &Plan,
    shards: Range<usize>,
    run: Run<'_>,
    give: &mut (dyn FnMut(Entry) + Send),
) -> Result<(), RunError> {
    let never = AtomicBool::new(false);
    let stop = run.stop.unwrap_or(&never);
    let silent = |_: u64| {};
    let progress: &(dyn Fn(u64) + Sync) = run.progress.unwrap_or(&silent);
    let there = run.parts.map(|parts| parts.scan(job, plan)).transpose()?.unwrap_or_default();
    let mut steps = Vec::new();
    for block in blocks(plan, shards.clone()) {
        if block.len() > 1 && there.contains(&(block.start, block.len())) {
            steps.push(Step::Block(block));
            continue;
        }
        for shard in block.clone() {
            let ends = (shard + 1 == block.end).then(|| block.clone());
            steps.push(Step::Shard { shard, stored: there.contains(&(shard, 1)), ends });
        }
    }
    // Shards in order, as numbers of steps; stored shards are only read.
    let turns: Vec<usize> = (0..steps.len()).filter(|at| matches!(steps[*at], Step::Shard { .. })).collect();
    if turns.iter().any(|at| matches!(steps[*at], Step::Shard { stored: false, .. })) {
        job.prepare()?;
    }
    let state = Mutex::new(State { next: 0, finished: BTreeMap::new(), sum: None, failed: None, give });
    let lanes = Lanes { job, plan, parts: run.parts, steps: &steps, stop, progress, state: &state };
    lanes.advance()?;
    let next = AtomicUsize::new(0);
    let mut side_by_side = rayon::current_num_threads();
    match job.shard_bytes() {
        Some(bytes) => side_by_side = memory::lanes(bytes),
        // The first shard runs alone; its memory determines how many run at once.
        None => {
            while let Some(&step) = turns.get(next.fetch_add(1, Ordering::Relaxed)) {
                if stop.load(Ordering::Relaxed) {
                    break;
                }
                if let Some(bytes) = lanes.one(step)? {
                    side_by_side = memory::lanes(bytes);
                    break;
                }
            }
        }
    }
    let begun = next.load(Ordering::Relaxed).min(turns.len());
    (0..side_by_side.min(turns.len() - begun)).into_par_iter().with_max_len(1).for_each(|_| {
        loop {
            let turn = next.fetch_add(1, Ordering::Relaxed);
            // Shards begin in order, so that the first failure by number does not depend on the number of
            // lanes.
            let hopeless = || lock(&state).failed.as_ref().is_some_and(|(at, _)| *at < turn);
            if turn >= turns.len() || stop.load(Ordering::Relaxed) || hopeless() {
                return;
            }
            if let Err(error) = lanes.one(turns[turn]) {
                let mut state = lock(&state);
                if state.failed.as_ref().is_none_or(|(at, _)| turn < *at) {
                    state.failed = Some((turn, error));
                }
            }
        }
    });
    let state = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, error)) = state.failed {
        return Err(error);
    }
    if state.next < steps.len() {
        // Shards whose sums wait for an earlier one count as finished.
        let done = |(at, step): (usize, &Step)| match step {
            Step::Block(block) => block.len(),
            Step::Shard { stored, .. } => usize::from(*stored || at < state.next || state.finished.contains_key(&at)),
        };
        let done: usize = steps.iter().enumerate().map(done).sum();
        return Err(RunError::Interrupted { left: shards.len() - done, total: shards.len() });
    }
    Ok(())
}

/// Data of the lanes.
struct Lanes<'a, 'b> {
    job: &'a dyn Shards,
    plan: &'a Plan,
    parts: Option<&'a PartsFolder>,
    steps: &'a [Step],
    stop: &'a AtomicBool,
    progress: &'a (dyn Fn(u64) + Sync),
    state: &'a Mutex<State<'b>>,
}

impl Lanes<'_, '_> {
    /// Reads or runs the shard of a step and adds up all parts that are next in order. Returns the shard's
    /// memory [bytes] if it was run.
    fn one(&self, at: usize) -> Result<Option<usize>, RunError> {
        let Step::Shard { shard, stored, .. } = self.steps[at] else { return Ok(None) };
        let mut bytes = None;
        let part = match self.parts {
            Some(parts) if stored => {
                (self.progress)(self.job.units(shard));
                parts.read(self.job, shard, 1)?.part
            }
            _ => {
                let begun = Instant::now();
                let Some(mut done) = self.job.run_shard(shard, self.stop, self.progress)? else { return Ok(None) };
                done.part.seconds = begun.elapsed().as_secs_f64();
                done.part.peak_bytes = done.peak_bytes as u64;
                bytes = Some(done.peak_bytes);
                let entry = Entry { first: shard, count: 1, part: done.part };
                if let Err(what) = check_part(&entry.part, self.job, shard, 1) {
                    return Err(RunError::BadShard { shard, what });
                }
                if let Some(parts) = self.parts {
                    parts.write(self.job, self.plan, &entry)?;
                }
                entry.part
            }
        };
        lock(self.state).finished.insert(at, part);
        self.advance()?;
        Ok(bytes)
    }

    /// Adds up all parts that are next in order; a finished group is written as one file that replaces those
    /// of its shards.
    fn advance(&self) -> Result<(), RunError> {
        let mut state = lock(self.state);
        while let Some(step) = self.steps.get(state.next) {
            let block = match step {
                Step::Block(block) => {
                    // The scan has found the block undamaged.
                    let entry = self.parts.map(|parts| parts.read(self.job, block.start, block.len())).transpose()?;
                    state.sum = entry.map(|e| e.part);
                    block.clone().for_each(|shard| (self.progress)(self.job.units(shard)));
                    Some(block)
                }
                Step::Shard { ends, .. } => {
                    let at = state.next;
                    let Some(part) = state.finished.remove(&at) else { return Ok(()) };
                    match &mut state.sum {
                        Some(sum) => sum.add(&part),
                        None => state.sum = Some(part),
                    }
                    ends.as_ref()
                }
            };
            state.next += 1;
            if let Some(block) = block
                && let Some(part) = state.sum.take()
            {
                let entry = Entry { first: block.start, count: block.len(), part };
                if let (Some(parts), Step::Shard { .. }, true) = (self.parts, step, block.len() > 1) {
                    parts.write(self.job, self.plan, &entry)?;
                    block.clone().for_each(|shard| parts.forget(shard));
                }
                (state.give)(entry);
            }
        }
        Ok(())
    }
}

/// Locks a mutex even after a panic of its holder, since its values are consistent at any time.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
