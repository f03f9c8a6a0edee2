//! The targets under mutations, for as long or as many inputs as asked: `PLYWAVE_FUZZ_SECONDS` (4 by default)
//! or `PLYWAVE_FUZZ_COUNT`, from `PLYWAVE_FUZZ_SEED` on. With both, the run ends at whichever comes first.
//! `PLYWAVE_FUZZ_TARGETS=model,table` runs these alone. A failure names target and seed, which give the same
//! input again.

use plywave_fuzz::targets::LOADED;
use plywave_fuzz::{Rng, all, mutate};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// One test at a time: both read the count of what loaded.
static TURN: Mutex<()> = Mutex::new(());

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|v| v.parse().unwrap_or_else(|_| panic!("{name} = {v:?}: expected a whole number")))
}

#[test]
fn seeds_are_good_and_mutations_differ() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    for target in all() {
        assert!(!target.seeds.is_empty(), "{}", target.name);
        for seed in &target.seeds {
            let before = LOADED.load(Ordering::Relaxed);
            (target.run)(seed);
            assert!(LOADED.load(Ordering::Relaxed) > before, "{}: a seed does not load", target.name);
            let changed = (0..20u64).filter(|i| mutate(seed, &mut Rng::new(*i)) != *seed).count();
            assert!(changed >= 15, "{}: {changed} of 20 inputs differ from their seed", target.name);
        }
    }
}

#[test]
fn every_loader_keeps_its_promises() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let count = number("PLYWAVE_FUZZ_COUNT");
    let seconds = number("PLYWAVE_FUZZ_SECONDS").or(if count.is_none() { Some(4) } else { None });
    let budget = seconds.map_or(Duration::MAX, Duration::from_secs);
    let first = number("PLYWAVE_FUZZ_SEED").unwrap_or(1);
    let mut targets = all();
    if let Ok(names) = std::env::var("PLYWAVE_FUZZ_TARGETS") {
        let names: Vec<&str> = names.split(',').collect();
        let known = |name: &&str| targets.iter().any(|t| t.name == *name);
        assert!(names.iter().all(known), "PLYWAVE_FUZZ_TARGETS = {names:?}: expected names of targets, with commas");
        targets.retain(|t| names.contains(&t.name));
    }
    let begun = Instant::now();
    let (mut done, mut by_target) = (0u64, vec![(0u64, Duration::ZERO, 0u64); targets.len()]);
    let mut failures = Vec::new();
    while begun.elapsed() < budget && done < count.unwrap_or(u64::MAX) && failures.len() < 20 {
        // Each target has its turn; in time, not in number, where the budget is time.
        let which = match count {
            Some(_) => (done % targets.len() as u64) as usize,
            None => (0..targets.len()).min_by_key(|i| by_target[*i].1).unwrap_or(0),
        };
        let target = &targets[which];
        let seed = first + done;
        let mut rng = Rng::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
        let input = mutate(&target.seeds[rng.below(target.seeds.len())], &mut rng);
        let (start, loaded) = (Instant::now(), LOADED.load(Ordering::Relaxed));
        let result = catch_unwind(AssertUnwindSafe(|| (target.run)(&input)));
        let took = start.elapsed();
        if result.is_err() || took > Duration::from_secs(20) {
            let folder = std::env::temp_dir().join("plywave-fuzz");
            let file = folder.join(format!("{}-{seed}", target.name));
            let kept = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&file, &input));
            failures.push(format!("{} seed {seed}: {took:?}, input in {} ({kept:?})", target.name, file.display()));
        }
        by_target[which].0 += 1;
        by_target[which].1 += took;
        by_target[which].2 += LOADED.load(Ordering::Relaxed) - loaded;
        done += 1;
    }
    for (target, (inputs, time, loaded)) in targets.iter().zip(&by_target) {
        println!("{:8} {inputs:9} inputs, {loaded:9} loads, {time:.1?}", target.name);
        assert!(*inputs < 2000 || loaded * 100 > *inputs, "{}: nearly every input is refused at the door", target.name);
    }
    println!("{done} inputs in {:.1?}", begun.elapsed());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
