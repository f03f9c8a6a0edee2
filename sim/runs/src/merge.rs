//! Merge of separately computed files of parts. They must be of one job, undamaged, and together hold every
//! shard exactly once; the output has the same bits as that of one run.

use super::arrays::Part;
use super::job::{Description, Job, Plan};
use super::part::PartFile;
use crate::error::RunError;
use std::path::{Path, PathBuf};

/// Files that together hold every shard of one job once.
pub struct Parts {
    paths: Vec<PathBuf>,
    /// Entries in the order of their shards: the file's number, the entry's number in it, first shard and
    /// number of shards.
    order: Vec<(usize, usize, (usize, usize))>,
    description: Description,
    digest: String,
    shards: usize,
    extent: u64,
}

impl Parts {
    /// Reads the files and checks that they are undamaged, of one job, and hold each shard once.
    ///
    /// # Errors
    /// [`RunError::Merge`] naming the missing or duplicate shards, or the file of another job; those of
    /// [`PartFile::open`].
    pub fn open(paths: &[PathBuf]) -> Result<Parts, RunError> {
        let refuse = |what: String, hint: &str| RunError::Merge { what, hint: hint.into() };
        let mut first: Option<Parts> = None;
        let mut ranges: Vec<(usize, usize, (usize, usize))> = Vec::new();
        for (at, path) in paths.iter().enumerate() {
            let file = PartFile::open(path)?;
            ranges.extend(file.entries().enumerate().map(|(k, (first, count))| (first, first + count, (at, k))));
            let Some(known) = &first else {
                first = Some(Parts {
                    paths: paths.to_vec(),
                    order: Vec::new(),
                    description: file.description().clone(),
                    digest: file.digest().into(),
                    shards: file.shards(),
                    extent: file.extent(),
                });
                continue;
            };
            let other = &paths[0];
            if file.digest() != known.digest {
                let what = format!("{}: a part of another job than {}", path.display(), other.display());
                let why = difference(&known.description, file.description());
                return Err(refuse(what, &format!("{why} differs; give parts of one command")));
            }
            if (file.shards(), file.extent()) != (known.shards, known.extent) {
                let (ours, theirs) = (file.shards(), known.shards);
                let what = format!("{}: of a job of {ours} shards, {} of {theirs}", path.display(), other.display());
                return Err(refuse(what, "give parts of one command"));
            }
        }
        let Some(mut parts) = first else { return Err(refuse("no parts".into(), "give the files of all shards")) };
        ranges.sort_unstable();
        let mut at = 0;
        let mut missing = Vec::new();
        for &(from, to, (file, _)) in &ranges {
            if from < at {
                let twice = format!("{}: shards {} are there twice", paths[file].display(), span(from, to.min(at)));
                return Err(refuse(twice, "give every shard once"));
            }
            if from > at {
                missing.push(span(at, from));
            }
            at = to;
        }
        if at < parts.shards {
            missing.push(span(at, parts.shards));
        }
        if !missing.is_empty() {
            let what = format!("{}: shards {} of {} are missing", paths[0].display(), missing.join(", "), parts.shards);
            return Err(refuse(what, "run them with --shards, or give their files too"));
        }
        parts.order = ranges.into_iter().map(|(from, to, (file, entry))| (file, entry, (from, to - from))).collect();
        Ok(parts)
    }

    /// Description of the job, to rebuild it.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Extent of the job, see [`Shards::extent`].
    pub fn extent(&self) -> u64 {
        self.extent
    }

    /// The files.
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        self.shards
    }

    /// The output of `job`, which the caller rebuilds from [`Parts::description`].
    ///
    /// # Errors
    /// [`RunError::Merge`] if the job is not that of the parts, or if a part does not fit the job's layout.
    pub fn merge<J: Job>(&self, job: &J) -> Result<J::Output, RunError> {
        let plan = Plan::from_job(job);
        if plan.digest != self.digest || plan.shards != self.shards {
            return Err(RunError::Merge {
                what: format!("{}: not a part of this {} job", self.first().display(), plan.description.kind),
                hint: "merge it with the program that wrote it".into(),
            });
        }
        let mut merge = job.begin();
        let mut sum: Option<Part> = None;
        let mut open: Option<(usize, PartFile)> = None;
        for &(at, entry, shards) in &self.order {
            let file = match open.take().filter(|(known, _)| *known == at) {
                Some((_, file)) => file,
                None => PartFile::open(&self.paths[at])?,
            };
            // Another program may have replaced it since it was checked.
            if file.digest() != self.digest || file.entries().nth(entry) != Some(shards) {
                let what = format!("{}: changed while it was merged", self.paths[at].display());
                return Err(RunError::Merge { what, hint: "merge again when all parts are complete".into() });
            }
            let entry = file.entry(job, entry)?;
            open = Some((at, file));
            let end = entry.shards().end;
            // A group may be distributed over several files: a sum of its first shards, then single ones.
            match &mut sum {
                Some(sum) => sum.add(&entry.part),
                None => sum = Some(entry.part),
            }
            if (end.is_multiple_of(plan.group) || end == plan.shards)
                && let Some(part) = sum.take()
            {
                job.absorb(&mut merge, (end - 1) / plan.group * plan.group, part);
            }
        }
        job.finish(merge)
    }

    fn first(&self) -> &Path {
        self.paths.first().map_or(Path::new(""), PathBuf::as_path)
    }
}

/// `3` or `3 to 5`, for shards `from..to`.
fn span(from: usize, to: usize) -> String {
    if to == from + 1 { from.to_string() } else { format!("{from} to {}", to - 1) }
}

/// Names the first field in which two descriptions differ.
fn difference(a: &Description, b: &Description) -> String {
    if a.kind != b.kind {
        return "its kind".into();
    }
    if a.program_version != b.program_version || a.part_version != b.part_version {
        return "the program's version".into();
    }
    if a.spec != b.spec {
        return "the spec".into();
    }
    let keys = |v: &serde_json::Value| v.as_object().map(|o| o.keys().cloned().collect::<Vec<_>>()).unwrap_or_default();
    let key = keys(&a.options).into_iter().find(|k| a.options.get(k) != b.options.get(k));
    key.map_or_else(|| "an option".into(), |key| format!("the option {key}"))
}
