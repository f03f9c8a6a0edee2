//! What every loader of plywave must withstand. [`targets`] takes bytes as a file of each kind and asks all
//! that loads for finite, non-negative light and no more than there is; [`seeds`] has good files of each
//! kind; [`mutate`] damages them where it hurts: numbers, sizes, lines, headers, checksums.
//!
//! The same targets are run by `cargo fuzz` (`fuzz/`) and, on stable Rust, by this crate's test, which takes
//! its budget from `PLYWAVE_FUZZ_SECONDS` or `PLYWAVE_FUZZ_COUNT`, and with `PLYWAVE_FUZZ_TARGETS` runs some
//! of them.

pub mod mutate;
pub mod seeds;
pub mod targets;

pub use mutate::{Rng, mutate};

/// A kind of file: its name, good files, what is asked of bytes.
pub struct Target {
    /// Name, that of the target of `cargo fuzz`.
    pub name: &'static str,
    /// Good files.
    pub seeds: Vec<Vec<u8>>,
    /// Takes bytes as such a file; panics where a promise is broken.
    pub run: fn(&[u8]),
}

/// All targets with their seeds.
pub fn all() -> Vec<Target> {
    let target = |name, seeds, run| Target { name, seeds, run };
    vec![
        target("model", seeds::models(), targets::model as fn(&[u8])),
        target("family", seeds::families(), targets::family),
        target("table", seeds::tables(), targets::table),
        target("fiber", seeds::fibers(), targets::fiber),
        target("speckle", seeds::speckles(), targets::speckle),
        target("yarn", seeds::yarns(), targets::yarn),
        target("wif", seeds::wifs(), targets::wif),
        target("obj", seeds::meshes(), targets::obj),
        target("sky", seeds::skies(), targets::sky),
        target("scene", seeds::scenes(), targets::scene),
        target("part", seeds::parts(), targets::part),
        target("sums", seeds::sums(), targets::sums),
        target("filament", seeds::filaments(), targets::filament),
        target("strands", seeds::strands(), targets::strands),
        target("twin", seeds::twins(), targets::twin),
        target("twin_cloth", seeds::twin_cloths(), targets::twin_cloth),
        target("cloth", seeds::cloths(), targets::cloth),
        target("cloth_spec", seeds::cloth_specs(), targets::cloth_spec),
        target("curves", seeds::curves(), targets::curves),
        target("single", seeds::singles(), targets::single),
        target("job", seeds::jobs(), targets::job),
    ]
}
