//! Time of the fiber models on one core: `cargo bench -p plywave-fiber --bench fiber`; `-- analytic` runs the
//! analytic models.

mod analytic;
mod hair;
mod tabulated;

use criterion::{criterion_group, criterion_main};
use std::time::Duration;

criterion_group! {
    name = benches;
    config = criterion::Criterion::default().sample_size(20).warm_up_time(Duration::from_millis(100)).measurement_time(Duration::from_millis(500));
    targets = analytic::analytic, tabulated::tabulated
}
criterion_main!(benches);
