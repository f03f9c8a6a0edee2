//! Checks of a table before a fit.

use crate::error::FitError;
use plywave_tables::table::Table;

/// Refuses tables with inconsistent arrays or whose incidences do not form blocks.
pub(crate) fn check_table(table: &Table) -> Result<(), FitError> {
    let bad = |field, value: String, hint| Err(FitError::Table { field, value, hint });
    let (m, n, k, bins) = (table.theta_i.len(), table.h_um.len(), table.sigma_per_um.len(), table.grid.len());
    for (field, len) in [("theta_i", m), ("h_um", n)] {
        if len < 3 || len.is_multiple_of(2) {
            return bad(field, format!("{len} nodes"), "must have an odd number of nodes, 3 or more");
        }
    }
    if table.grid.theta_o < 4 || table.grid.phi_o < 4 {
        return bad("grid", format!("{} x {}", table.grid.theta_o, table.grid.phi_o), "must have at least 4 x 4 bins");
    }
    if k == 0
        || table.sigma_per_um[0] != 0.0
        || table.sigma_per_um.windows(2).any(|w| w[1] <= w[0] || !w[1].is_finite())
    {
        return bad("sigma_per_um", format!("{:?}", table.sigma_per_um), "must ascend from 0");
    }
    for (field, len, want) in [
        ("r_d", table.r_d.len(), m * n),
        ("energy_refl", table.energy_refl.len(), m * n),
        ("energy_high", table.energy_high.len(), m * n * k),
        ("refl", table.refl.len(), m * n * bins),
        ("high", table.high.len(), m * n * k * bins),
        ("noise_refl", table.noise_refl.len(), m * n),
        ("noise_high", table.noise_high.len(), m * n * k),
    ] {
        if len != want {
            return bad(field, format!("{len} values"), "must have one value for each index of its axes");
        }
    }
    for (field, values) in [
        ("theta_i", &table.theta_i),
        ("h_um", &table.h_um),
        ("r_d", &table.r_d),
        ("energy_refl", &table.energy_refl),
        ("energy_high", &table.energy_high),
        ("noise_refl", &table.noise_refl),
        ("noise_high", &table.noise_high),
    ] {
        if let Some(v) = values.iter().find(|v| !v.is_finite()) {
            return bad(field, v.to_string(), "must be finite");
        }
    }
    for (field, values) in [("refl", &table.refl), ("high", &table.high)] {
        if let Some(v) = values.iter().find(|v| !v.is_finite() || **v < 0.0) {
            return bad(field, v.to_string(), "must be finite and not negative");
        }
    }
    Ok(())
}
