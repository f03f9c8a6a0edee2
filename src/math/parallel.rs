//! Parallel loops over the machine's cores.

/// `of(0)` to `of(count - 1)`, in order; the results do not depend on the number of cores. Runs on one core
/// without threads.
pub(crate) fn map<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(count);
    if cores < 2 || cfg!(target_family = "wasm") {
        return (0..count).map(of).collect();
    }
    let of = &of;
    let share = move |core: usize| (core..count).step_by(cores).map(of).collect::<Vec<T>>();
    let shares = std::thread::scope(|scope| {
        let others: Vec<_> = (1..cores).map(|core| scope.spawn(move || share(core))).collect();
        let mut shares = vec![share(0).into_iter()];
        for other in others {
            match other.join() {
                Ok(share) => shares.push(share.into_iter()),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        shares
    });
    let mut shares = shares;
    (0..count).filter_map(|k| shares[k % cores].next()).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn parts_come_in_order() {
        assert_eq!(super::map(37, |k| k * k), (0..37).map(|k| k * k).collect::<Vec<_>>());
        assert!(super::map(0, |k| k).is_empty());
    }
}
