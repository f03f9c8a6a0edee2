//! Relations between the ranges of a family and its yarn.

use super::rules::invalid;
use super::yarn::{FamilySpec, YarnSpec};
use crate::Result;

/// Checks that ranges ascend, contain the yarn's own values, and vary parameters that the yarn has. `widest`
/// is the ply's radius [um].
pub(super) fn check_family(file: &str, spec: &YarnSpec, family: &FamilySpec, widest: f64) -> Result<()> {
    let FamilySpec { fiber_pitch_um, alpha_fiber, eta } = *family;
    if fiber_pitch_um.is_none() && alpha_fiber.is_none() && eta.is_none() {
        return Err(invalid(file, "family", "(empty)", "give ranges of fiber_pitch_um, alpha_fiber or eta"));
    }
    if eta.is_some() && spec.fiber.is_opaque() {
        return Err(invalid(file, "family.eta", "a range", "opaque fibers have no family of indices; drop the key"));
    }
    if fiber_pitch_um.is_some() && spec.ply.fiber_pitch_um.is_none() {
        return Err(invalid(
            file,
            "family.fiber_pitch_um",
            "a range",
            "give ply.fiber_pitch_um too: the ply has no twist",
        ));
    }
    let own = [spec.ply.fiber_pitch_um.unwrap_or(0.0), spec.fiber.alpha_fiber, spec.fiber.eta];
    let ranges = [("fiber_pitch_um", fiber_pitch_um), ("alpha_fiber", alpha_fiber), ("eta", eta)];
    for ((name, range), own) in ranges.into_iter().zip(own) {
        let Some([low, high]) = range else { continue };
        let key = format!("family.{name}");
        if low >= high {
            return Err(invalid(
                file,
                &key,
                format!("[{low}, {high}]"),
                "use a range whose first number is the lesser",
            ));
        }
        if !(low..=high).contains(&own) {
            let hint = format!("use a range that holds the yarn's own {name} = {own}");
            return Err(invalid(file, &key, format!("[{low}, {high}]"), hint));
        }
    }
    if let Some([low, _]) = fiber_pitch_um.filter(|range| range[0] < widest) {
        return Err(invalid(
            file,
            "family.fiber_pitch_um",
            low,
            format!("use pitches of the ply's radius {widest} um or more"),
        ));
    }
    Ok(())
}
