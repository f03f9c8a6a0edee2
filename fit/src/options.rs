//! Options of a fit: numbers of lobes and iterations, with presets.

use crate::error::FitError;
use crate::lobes::block::BlockEffort;
use crate::lobes::reflection::ReflectionEffort;
use plywave::ply::LobeKind;

/// Effort and numbers of lobes of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Reflection lobes per incidence. The paper uses 1, which cannot represent a distribution wider than
    /// half a turn.
    pub lobes_refl: usize,
    /// High-order lobes per incidence.
    pub lobes_high: usize,
    /// Kind of lobes; `None` chooses the kind that the table needs.
    pub family: Option<LobeKind>,
    /// Effort of a block of high-order slices.
    pub block: BlockEffort,
    /// Effort of the reflection slices.
    pub reflection: ReflectionEffort,
    /// Iterations of the absorption spectra of a block.
    pub absorption_iterations: usize,
    /// Iterations of the joint refinement of a block's lobes and spectra at all sigma.
    pub dark_iterations: usize,
    /// Weight of a slice at sigma > 0 in that refinement, relative to one at sigma = 0.
    pub dark_share: f64,
}

impl FitOptions {
    /// Preset for a first look; a fit takes seconds.
    pub fn preview() -> Self {
        FitOptions {
            block: BlockEffort {
                starts: 2,
                start_iterations: 60,
                moves: 2,
                move_iterations: 40,
                iterations: 80,
                tolerance: 3e-3,
            },
            reflection: ReflectionEffort { rounds: 1, iterations: 40, ..Self::standard().reflection },
            absorption_iterations: 60,
            dark_iterations: 40,
            ..Self::standard()
        }
    }

    /// Preset whose errors the README reports.
    pub fn standard() -> Self {
        FitOptions {
            lobes_refl: 3,
            lobes_high: 8,
            family: None,
            block: BlockEffort {
                starts: 8,
                start_iterations: 150,
                moves: 6,
                move_iterations: 60,
                iterations: 300,
                tolerance: 1e-3,
            },
            reflection: ReflectionEffort { starts: 4, iterations: 80, rounds: 3, smoothness: 5e-3, tolerance: 1e-3 },
            absorption_iterations: 150,
            dark_iterations: 80,
            dark_share: 0.03,
        }
    }

    /// Preset with the smallest error that the minimizer reaches.
    pub fn reference() -> Self {
        FitOptions {
            block: BlockEffort {
                starts: 8,
                start_iterations: 400,
                moves: 30,
                move_iterations: 150,
                iterations: 1000,
                tolerance: 1e-4,
            },
            reflection: ReflectionEffort {
                starts: 8,
                iterations: 300,
                rounds: 4,
                tolerance: 1e-4,
                ..Self::standard().reflection
            },
            absorption_iterations: 400,
            dark_iterations: 300,
            ..Self::standard()
        }
    }
}

impl FitOptions {
    /// Refuses numbers of lobes and starts that are out of range.
    pub(crate) fn check(&self) -> Result<(), FitError> {
        for (name, value) in [("lobes_refl", self.lobes_refl), ("lobes_high", self.lobes_high)] {
            if !(1..=64).contains(&value) {
                return Err(FitError::Option { name, value, allowed: "1 to 64" });
            }
        }
        if self.block.starts == 0 || self.reflection.starts == 0 {
            return Err(FitError::Option { name: "starts", value: 0, allowed: "1 or more" });
        }
        Ok(())
    }
}
