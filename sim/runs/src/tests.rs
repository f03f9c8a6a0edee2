//! Tests of the scheduler on a synthetic job with known parts: groups, stops, failures, damaged and foreign
//! parts, merges in any order.

use super::*;
use crate::error::RunError;
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Sums of single-precision numbers whose bits depend on the order of summation.
struct Toy<'a> {
    name: &'static str,
    shards: usize,
    group: usize,
    runs: AtomicUsize,
    before: &'a (dyn Fn(usize) -> Result<bool, RunError> + Sync),
}

fn always(_: usize) -> Result<bool, RunError> {
    Ok(true)
}

fn toy(shards: usize, group: usize) -> Toy<'static> {
    Toy { name: "toy", shards, group, runs: AtomicUsize::new(0), before: &always }
}

fn values(shard: usize) -> Vec<f32> {
    (0..3).map(|k| 1.0 / (3.0 + (shard * 7 + k) as f32) + (shard % 3) as f32 * 1e3).collect()
}

impl Shards for Toy<'_> {
    fn description(&self) -> Description {
        Description::new("toy", &self.group, self.name)
    }

    fn shards(&self) -> usize {
        self.shards
    }

    fn group(&self) -> usize {
        self.group
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        vec![ArrayLayout::f32("floats", &[3], [0.0, 1e6]), ArrayLayout::f64("count", &[1], [1.0, 1e6])]
    }

    fn check(&self, _: usize, count: usize, part: &Part) -> Result<(), String> {
        if part.f64(1)[0] == count as f64 { Ok(()) } else { Err("not the count".into()) }
    }

    fn run_shard(
        &self,
        shard: usize,
        _: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        self.runs.fetch_add(1, Ordering::Relaxed);
        if !(self.before)(shard)? {
            return Ok(None);
        }
        progress(1);
        Ok(Some(Done { part: Part::new(vec![Values::F32(values(shard)), Values::F64(vec![1.0])]), peak_bytes: 1 }))
    }
}

impl Job for Toy<'_> {
    type Output = Vec<(usize, Part)>;
    type Merge = Vec<(usize, Part)>;

    fn begin(&self) -> Self::Merge {
        Vec::new()
    }

    fn absorb(&self, merge: &mut Self::Merge, first: usize, part: Part) {
        merge.push((first, part));
    }

    fn finish(&self, merge: Self::Merge) -> Result<Self::Output, RunError> {
        Ok(merge)
    }
}

/// The bits of the values, without time and memory.
fn bits(output: &[(usize, Part)]) -> Vec<(usize, Vec<u32>, Vec<u64>)> {
    let one = |(first, part): &(usize, Part)| {
        let singles = part.f32(0).iter().map(|v| v.to_bits()).collect();
        (*first, singles, part.f64(1).iter().map(|v| v.to_bits()).collect())
    };
    output.iter().map(one).collect()
}

fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The sums match those computed by hand, group by group.
#[test]
fn groups_are_summed_in_order_whatever_the_threads() {
    for (shards, group) in [(12, 4), (10, 4), (5, 1), (3, 7), (0, 2)] {
        let want: Vec<(usize, Vec<f32>)> = (0..shards)
            .step_by(group)
            .map(|first| {
                let mut sum = values(first);
                for shard in first + 1..(first + group).min(shards) {
                    sum.iter_mut().zip(values(shard)).for_each(|(a, b)| *a += b);
                }
                (first, sum)
            })
            .collect();
        for threads in [1, 4] {
            let got = on_threads(threads, || run(&toy(shards, group), Run::plain())).unwrap();
            let got: Vec<_> = got.iter().map(|(first, part)| (*first, part.f32(0).to_vec())).collect();
            assert_eq!(got, want, "{shards} shards in groups of {group}, {threads} threads");
        }
    }
}

/// A run that is stopped in the middle and resumed runs each shard once and has the result of one run. A
/// longer run of the same job uses the stored shards.
#[test]
fn stopped_runs_are_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.parts");
    let stop = AtomicBool::new(false);
    let halt = |shard: usize| {
        stop.fetch_or(shard == 6, Ordering::Relaxed);
        Ok(shard != 6)
    };
    let job = Toy { before: &halt, ..toy(9, 4) };
    let want = bits(&run(&toy(9, 4), Run::plain()).unwrap());
    let parts = PartsFolder::open(&path, Found::Refuse).unwrap();
    let stopped =
        on_threads(1, || run(&job, Run { parts: Some(&parts), stop: Some(&stop), ..Run::plain() }).map(|_| ()));
    assert!(matches!(stopped, Err(RunError::Interrupted { left: 3, total: 9 })), "{stopped:?}");
    drop(parts);
    assert_eq!(names(&path), ["lock", "shard-000000-000003.pwp", "shard-000004.pwp", "shard-000005.pwp"]);

    // By default the parts are neither used nor deleted.
    let parts = PartsFolder::open(&path, Found::Refuse).unwrap();
    let unasked = run(&toy(9, 4), Run { parts: Some(&parts), ..Run::plain() }).map(|_| ());
    assert!(matches!(unasked, Err(RunError::PartsFound { found: 6, total: 9, .. })), "{unasked:?}");
    drop(parts);
    // Another job does not use the parts.
    let parts = PartsFolder::open(&path, Found::Resume).unwrap();
    let other = run(&Toy { name: "other", ..toy(9, 4) }, Run { parts: Some(&parts), ..Run::plain() }).map(|_| ());
    assert!(matches!(other, Err(RunError::PartsOfAnotherRun { .. })), "{other:?}");

    let reported = AtomicUsize::new(0);
    let count = |n: u64| {
        reported.fetch_add(n as usize, Ordering::Relaxed);
    };
    let rest = toy(9, 4);
    let resumed = run(&rest, Run { parts: Some(&parts), progress: Some(&count), ..Run::plain() }).unwrap();
    assert_eq!((bits(&resumed), rest.runs.into_inner(), reported.into_inner()), (want, 3, 9));
    // A longer run of the same job runs the incomplete group again, but not the others.
    let longer = toy(12, 4);
    let got = run(&longer, Run { parts: Some(&parts), ..Run::plain() }).unwrap();
    assert_eq!(bits(&got), bits(&run(&toy(12, 4), Run::plain()).unwrap()));
    assert_eq!(longer.runs.into_inner(), 3);
    parts.remove();
    assert!(!path.exists());
    // With `Replace`, a run deletes the parts.
    let parts = PartsFolder::open(&path, Found::Refuse).unwrap();
    run(&toy(4, 4), Run { parts: Some(&parts), ..Run::plain() }).unwrap();
    drop(parts);
    let parts = PartsFolder::open(&path, Found::Replace).unwrap();
    let afresh = toy(4, 4);
    run(&afresh, Run { parts: Some(&parts), ..Run::plain() }).unwrap();
    assert_eq!(afresh.runs.into_inner(), 4);
}

/// The failure of the first shard by number is reported, for any number of threads.
#[test]
fn first_failure_is_reported() {
    let fail = |shard: usize| match shard {
        5 | 7 => Err(RunError::BadShard { shard, what: "made up".into() }),
        _ => Ok(true),
    };
    for threads in [1, 4] {
        let failed = on_threads(threads, || run(&Toy { before: &fail, ..toy(12, 3) }, Run::plain()).map(|_| ()));
        assert!(matches!(failed, Err(RunError::BadShard { shard: 5, .. })), "{failed:?}");
    }
}

/// A shard with impossible values is an error when it runs, not when its part is read.
#[test]
fn impossible_values_are_errors() {
    struct Bad(f32);
    impl Shards for Bad {
        fn description(&self) -> Description {
            Description::new("bad", &0, "")
        }
        fn shards(&self) -> usize {
            1
        }
        fn layout(&self, _: usize) -> Vec<ArrayLayout> {
            vec![ArrayLayout::f32("v", &[1], [0.0, 1e6])]
        }
        fn run_shard(&self, _: usize, _: &AtomicBool, _: &(dyn Fn(u64) + Sync)) -> Result<Option<Done>, RunError> {
            Ok(Some(Done { part: Part::new(vec![Values::F32(vec![self.0])]), peak_bytes: 0 }))
        }
    }
    impl Job for Bad {
        type Output = ();
        type Merge = ();
        fn begin(&self) {}
        fn absorb(&self, _: &mut (), _: usize, _: Part) {}
        fn finish(&self, _: ()) -> Result<(), RunError> {
            Ok(())
        }
    }
    assert!(run(&Bad(1.0), Run::plain()).is_ok());
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        assert!(matches!(run(&Bad(bad), Run::plain()), Err(RunError::BadShard { shard: 0, .. })), "{bad}");
    }
}

fn part_files(folder: &Path, job: &Toy<'_>, count: usize) -> Vec<PathBuf> {
    let one = |k: usize| {
        let path = folder.join(format!("{}-{k}-of-{count}.pwp", job.name));
        run_part(job, (k, count), &path, Run::plain()).unwrap();
        path
    };
    (1..=count).map(one).collect()
}

/// Separately computed parts, in any number and order, merge to the same bits. Parts that are missing,
/// duplicate or of another job are reported.
#[test]
fn merges_are_the_whole_run() {
    let dir = tempfile::tempdir().unwrap();
    let job = toy(13, 4);
    let want = bits(&run(&job, Run::plain()).unwrap());
    for count in [1, 2, 3, 5, 13] {
        let mut files = part_files(dir.path(), &job, count);
        files.reverse();
        let half = files.len() / 2;
        files.rotate_left(half);
        assert_eq!(bits(&Parts::open(&files).unwrap().merge(&job).unwrap()), want, "{count} parts");
    }
    let said = |paths: &[PathBuf]| match Parts::open(paths).err() {
        Some(error) => error.to_string(),
        None => "nothing".into(),
    };
    let files = part_files(dir.path(), &job, 3);
    assert!(said(&[files[0].clone(), files[2].clone()]).contains("shards 4 to 7 of 13 are missing"));
    assert!(said(&files[1..]).contains("shards 0 to 3 of 13 are missing"));
    let double = said(&[&files[..], &part_files(dir.path(), &job, 13)[12..]].concat());
    assert!(double.contains("13-of-13.pwp: shards 12 are there twice"), "{double}");
    let other = part_files(dir.path(), &Toy { name: "other", ..toy(13, 4) }, 3);
    let foreign = said(&[files[0].clone(), other[1].clone(), files[2].clone()]);
    assert!(foreign.contains("other-2-of-3.pwp: a part of another job") && foreign.contains("the spec differs"));
    assert!(said(&[]).contains("no parts"));
    std::fs::write(dir.path().join("x"), "text").unwrap();
    assert!(said(&[dir.path().join("x")]).contains("not a part"));
    assert!(said(&[dir.path().to_path_buf()]).contains("not a regular file"));
    assert!(Parts::open(&files).unwrap().merge(&Toy { name: "other", ..toy(13, 4) }).is_err());
    // Parts that are replaced between the check and the merge: of another job, and with fewer shards.
    let fewer = part_files(dir.path(), &job, 13).remove(4);
    for replaced in [&other[1], &fewer] {
        let files = part_files(dir.path(), &job, 3);
        let parts = Parts::open(&files).unwrap();
        std::fs::copy(replaced, &files[1]).unwrap();
        let error = parts.merge(&job).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("2-of-3.pwp: changed while it was merged"), "{error}");
    }
    let none = run_part(&job, (1, 14), &dir.path().join("y"), Run::plain());
    assert!(matches!(none, Err(RunError::TooManyParts { shards: 13, .. })), "{none:?}");
}

/// Any flipped byte or wrong length of a part is detected. In a folder such a part is dropped with a note and
/// its shard runs again.
#[test]
fn damaged_parts_are_found_out() {
    let dir = tempfile::tempdir().unwrap();
    let job = toy(4, 1);
    let file = part_files(dir.path(), &job, 4).remove(1);
    let whole = std::fs::read(&file).unwrap();
    assert!(PartFile::from_bytes(whole.clone(), "x").unwrap().entry(&job, 0).is_ok());
    for at in 0..whole.len() {
        for mask in [1u8, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= mask;
            assert!(PartFile::from_bytes(bytes, "x").is_err(), "byte {at} ^ {mask:#x}");
        }
        assert!(PartFile::from_bytes(whole[..at].to_vec(), "x").is_err(), "cut at {at}");
    }
    let path = dir.path().join("t.parts");
    let parts = PartsFolder::open(&path, Found::Refuse).unwrap();
    let want = bits(&run(&job, Run { parts: Some(&parts), ..Run::plain() }).unwrap());
    drop(parts);
    std::fs::write(path.join("diary.txt"), "mine").unwrap();
    for (name, bytes) in [
        ("shard-000000.pwp", whole.clone()),
        ("shard-000001.pwp", whole[..whole.len() - 1].to_vec()),
        ("shard-000003.pwp", Vec::new()),
    ] {
        std::fs::write(path.join(name), bytes).unwrap();
    }
    let parts = PartsFolder::open(&path, Found::Resume).unwrap();
    let again = toy(4, 1);
    assert_eq!(bits(&run(&again, Run { parts: Some(&parts), ..Run::plain() }).unwrap()), want);
    let notes = parts.take_notes();
    assert_eq!((again.runs.into_inner(), notes.len()), (3, 3), "{notes:?}");
    assert!(notes.iter().all(|n| n.contains("shard-00000") && n.contains("run again")), "{notes:?}");
    parts.remove();
    assert_eq!(names(&path), ["diary.txt"]);
}

proptest! {
    /// Parts with a valid checksum but impossible values, sizes or numbers of shards are refused without a
    /// panic.
    #[test]
    fn impossible_parts_are_refused(
        value in prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1.0f32), Just(2e6f32)],
        at in 0usize..3, count in prop_oneof![Just(0.0f64), Just(f64::NAN), Just(2.0)],
        first in 0usize..20, shards in 0usize..6, length in 0usize..3,
    ) {
        let job = toy(8, 4);
        let plan = Plan::from_job(&job);
        let made = |first, count, floats: Vec<f32>, number: f64| {
            let part = Part::new(vec![Values::F32(floats), Values::F64(vec![number])]);
            part::encode(&job, &plan, &[Entry { first, count, part }], "x").ok()
        };
        let passes = |bytes: Option<Vec<u8>>| {
            bytes.is_some_and(|b| PartFile::from_bytes(b, "x").is_ok_and(|f| f.entry(&job, 0).is_ok()))
        };
        prop_assert!(passes(made(4, 1, vec![1.0; 3], 1.0)));
        let mut floats = vec![1.0; 3];
        floats[at] = value;
        prop_assert!(!passes(made(4, 1, floats, 1.0)));
        prop_assert!(!passes(made(4, 1, vec![1.0; 3], count)));
        prop_assert!(!passes(made(4, 1, vec![1.0; length], 1.0)));
        let can = shards > 0 && first + shards <= 8 && (shards == 1 || (first % 4 == 0 && shards <= 4));
        prop_assert_eq!(passes(made(first, shards, vec![1.0; 3], shards as f64)), can);
    }
}

/// Blocks that were run one by one fill the folder of a run, which then merges to the same bits without
/// running a shard. Other ranges of shards are refused.
#[test]
fn blocks_made_elsewhere_fill_a_folder() {
    let want = run(&toy(11, 4), Run::plain()).unwrap();
    for whole in [true, false] {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("toy");
        std::fs::create_dir(&folder).unwrap();
        let mut at = 0;
        while at < 11 {
            let count = if whole { 4.min(11 - at) } else { 1 };
            let bytes = run_block(&toy(11, 4), at..at + count, Run::plain()).unwrap();
            std::fs::write(folder.join(block_name(at, count)), bytes).unwrap();
            at += count;
        }
        let parts = PartsFolder::open(&folder, Found::Resume).unwrap();
        let job = toy(11, 4);
        let got = run(&job, Run { parts: Some(&parts), ..Run::plain() }).unwrap();
        let bits = |all: &[(usize, Part)]| -> Vec<(usize, Vec<Values>)> {
            all.iter().map(|(first, part)| (*first, part.arrays.clone())).collect()
        };
        assert_eq!(bits(&got), bits(&want));
        assert_eq!(job.runs.load(Ordering::Relaxed), 0);
    }
    for bad in [0..0, 1..3, 2..6, 0..8, 10..12] {
        let refused = run_block(&toy(11, 4), bad.clone(), Run::plain());
        assert!(matches!(refused, Err(RunError::Merge { .. })), "{bad:?}");
    }
}
