//! Limits of a model's tensors, and their extrapolation beyond the nodes.

/// Maximum number of lobes of f_refl, and of f_high.
pub(crate) const MAX_LOBES: usize = 16;
/// Maximum number of path lengths of a spectrum.
pub(crate) const MAX_PATHS: usize = 16;

/// Minimum energy of a lobe. It keeps the sum of the lobes above 0, so that the mixture can always be scaled
/// to the simulated energy.
pub const MIN_ENERGY: f64 = 1e-12;
/// Minimum transmittance of a path length, for the same reason.
pub const MIN_TRANSMITTANCE: f64 = 1e-20;

/// Value of a node array at index -1..=n, extrapolated linearly beyond both ends: `at(-1) = 2 at(0) - at(1)`.
pub fn extended(i: isize, n: usize, at: &dyn Fn(usize) -> f64) -> f64 {
    if i < 0 {
        2.0 * at(0) - at(1)
    } else if i as usize >= n {
        2.0 * at(n - 1) - at(n - 2)
    } else {
        at(i as usize)
    }
}

/// Maximum excess over 1 of the Monte Carlo energies of one incidence.
pub const ENERGY_TOLERANCE: f64 = 0.05;
