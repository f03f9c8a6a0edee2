//! Errors of the simulator: values, not prose. Each prints as one line.

/// Errors between a yarn spec and a table.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The fibers could not be placed within the ply without overlap.
    #[error(
        "{key} = {radius_um:.4}: {fibers} fibers at packing fraction {packing_fraction:.3} do not fit; use {key} >= {least_radius_um:.1} or fewer or thinner fibers"
    )]
    CannotPack {
        /// Key of the spec: `ply.radius_um`, or `ply.radii_um`, for its first value (both scale alike).
        key: &'static str,
        /// Number of fibers.
        fibers: usize,
        /// Radius of the ply, or its first semi-axis [um].
        radius_um: f64,
        /// Area of the fibers over the area of the ply.
        packing_fraction: f64,
        /// Estimate of the least radius (first semi-axis) that would be accepted [um].
        least_radius_um: f64,
    },
    /// The spec's fiber outline cannot be built.
    #[error("fiber.shape: {what}; {hint}")]
    BadOutline {
        /// Description of the error.
        what: String,
        /// Accepted values.
        hint: String,
    },
    /// The fibers crowd so much that the screw march's grid cannot tell them apart.
    #[error("the screw march cannot resolve this cross section; use the mesh tracer")]
    TooCrowded,
    /// An input table cannot be used.
    #[error("table: {field} = {value}: {hint}")]
    Table {
        /// Name of the field.
        field: &'static str,
        /// Offending value.
        value: String,
        /// Accepted values.
        hint: &'static str,
    },
    /// A size in the options is out of range.
    #[error("options: {name} = {value}: must be {allowed}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// Offending value.
        value: usize,
        /// Allowed values.
        allowed: &'static str,
    },
    /// The table would not fit in memory.
    #[error(
        "simulation.phi_o_bins: the table would have {cells:.2e} cells; use fewer nodes or bins, {allowed:.1e} cells at most"
    )]
    TooLarge {
        /// Cells of (theta_i, h, 1 + sigma, theta_o, phi_o).
        cells: f64,
        /// Most that are allowed.
        allowed: f64,
    },
    /// A relaxation that was stopped.
    #[error("stopped before the yarns were at rest")]
    Stopped,
    /// Stopped before the end.
    #[error("stopped with {left} of {total} shards left")]
    Interrupted {
        /// Shards not yet summed.
        left: usize,
        /// Shards in all.
        total: usize,
    },
    /// Another process runs in the parts folder.
    #[error("{folder}: another run is writing to this output; wait for it, or choose another output")]
    PartsInUse {
        /// The folder.
        folder: String,
    },
    /// The parts folder holds finished shards of the same job, and the caller did not say what to do with
    /// them.
    #[error(
        "{folder}: holds {found} of {total} finished shards of this run; go on with --resume, or delete them with --fresh"
    )]
    PartsFound {
        /// The folder.
        folder: String,
        /// Finished shards.
        found: usize,
        /// Shards of the job.
        total: usize,
    },
    /// The parts folder holds finished shards of another job.
    #[error(
        "{folder}: holds shards of another run (its spec, options, seed or version differ); choose another output, or delete them with --fresh"
    )]
    PartsOfAnotherRun {
        /// The folder.
        folder: String,
    },
    /// A shard computed impossible values.
    #[error("shard {shard}: {what}; the run cannot be saved: change the spec or its sizes")]
    BadShard {
        /// Number of the shard.
        shard: usize,
        /// Description of the error.
        what: String,
    },
    /// The job has fewer shards than parts.
    #[error("--shards = {index}/{count}: the run has {shards} shards; give K/N with 1 <= K <= N <= {shards}")]
    TooManyParts {
        /// Number of the part.
        index: usize,
        /// Number of parts.
        count: usize,
        /// Shards of the job.
        shards: usize,
    },
    /// Parts that cannot be merged into a whole.
    #[error("{}; {hint}", plywave::one_line(what, 1000))]
    Merge {
        /// Description of the error.
        what: String,
        /// Fix.
        hint: String,
    },
    /// A run with too few paths: its result could not be saved because of the noise of its energies.
    #[error(
        "simulation.paths_per_theta = {paths}: too few paths, the energies would be off by up to {error:.1e} and the table refused; use {least} or more"
    )]
    TooFewPaths {
        /// Paths of an incident latitude.
        paths: u64,
        /// Five standard errors of the energies' sum.
        error: f64,
        /// Paths that are enough.
        least: u64,
    },
    /// The triangles of a cloth would not fit in memory.
    #[error(
        "the fibers of {repeats} repeats make {triangles:.2e} triangles, {allowed:.1e} are allowed; use fewer repeats or a coarser mesh"
    )]
    TwinTooLarge {
        /// Repeats along x times those along y.
        repeats: u64,
        /// Triangles.
        triangles: f64,
        /// Most that are allowed.
        allowed: f64,
    },
    /// Error of the wave code.
    #[error(transparent)]
    #[cfg(not(target_family = "wasm"))]
    Wave(#[from] crate::wave::WaveError),
    /// Error of the runtime: spec, table or file.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
}
