//! Errors of the simulator. Variants hold values instead of prose, and each prints as one line with a hint.

/// Errors between a yarn spec and a table.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The fibers could not be placed within the ply without overlap.
    #[error(
        "{key} = {radius_um:.4}: {fibers} fibers at packing fraction {packing_fraction:.3} do not fit; use {key} >= {least_radius_um:.1} or fewer or thinner fibers"
    )]
    CannotPack {
        /// Key of the spec: `ply.radius_um`, or `ply.radii_um` for its first value (both scale by the same
        /// factor).
        key: &'static str,
        /// Number of fibers.
        fibers: usize,
        /// Radius of the ply, or its first semi-axis [um].
        radius_um: f64,
        /// Area of the fibers over the area of the ply.
        packing_fraction: f64,
        /// Estimated minimum radius (first semi-axis) that would be accepted [um].
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
    /// The fibers are so close together that the grid of the screw march cannot resolve them.
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
        /// Number of cells of (theta_i, h, 1 + sigma, theta_o, phi_o).
        cells: f64,
        /// Maximum number.
        allowed: f64,
    },
    /// The work on a cloth was stopped by the caller.
    #[error("stopped before the yarns were at rest")]
    Stopped,
    /// A run with too few paths: its result could not be saved because of the noise of its energies.
    #[error(
        "simulation.paths_per_theta = {paths}: too few paths, the energies would be off by up to {error:.1e} and the table refused; use {least} or more"
    )]
    TooFewPaths {
        /// Number of paths of an incident latitude.
        paths: u64,
        /// Five standard errors of the sum of energies.
        error: f64,
        /// Number of paths that suffices.
        least: u64,
    },
    /// The triangles of a cloth would not fit in memory.
    #[error(
        "the fibers of {repeats} repeats make {triangles:.2e} triangles, {allowed:.1e} are allowed; use fewer repeats or a coarser mesh"
    )]
    TwinTooLarge {
        /// Repeats along x times those along y.
        repeats: u64,
        /// Number of triangles.
        triangles: f64,
        /// Maximum number.
        allowed: f64,
    },
    /// Error of the runtime: spec, table or file.
    #[error(transparent)]
    Runtime(#[from] plywave::Error),
}

#[cfg(not(target_family = "wasm"))]
impl From<SimError> for plywave_runs::RunError {
    fn from(error: SimError) -> Self {
        match error {
            SimError::Runtime(error) => error.into(),
            error => plywave_runs::RunError::of_job(error),
        }
    }
}
