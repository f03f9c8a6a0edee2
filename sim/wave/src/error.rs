//! Errors of the wave code. Variants hold values; each prints as one line with a hint.

/// Errors between a scene and its far field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WaveError {
    /// A number or a shape that cannot be used.
    #[error("{key} = {value}: {hint}")]
    Invalid {
        /// Key of the scene, with its index: `fiber[2].eta`.
        key: String,
        /// Value in the scene.
        value: String,
        /// Accepted values.
        hint: String,
    },
    /// A scene that cannot be read at all.
    #[error("{what}; {hint}")]
    Unreadable {
        /// Description of the error.
        what: String,
        /// Fix.
        hint: String,
    },
    /// A wall that crosses itself.
    #[error("{wall}: the outline crosses itself; give a simple closed curve")]
    SelfCrossing {
        /// `fiber[2]` or `fiber[2].lumen`.
        wall: String,
    },
    /// Two walls that touch or overlap.
    #[error("{first} and {second} overlap or touch; leave a gap between their walls")]
    Overlap {
        /// One wall.
        first: String,
        /// The other.
        second: String,
    },
    /// A lumen that is not inside of its body.
    #[error("{wall} lies outside of its body; move it in (its center_um is in the scene's frame)")]
    LumenOutside {
        /// `fiber[2].lumen`.
        wall: String,
    },
    /// The method cannot treat the scene.
    #[error("method = \"{method}\": {what}; {hint}")]
    Unsupported {
        /// Name of the method.
        method: &'static str,
        /// Obstacle.
        what: String,
        /// Fix.
        hint: String,
    },
    /// The tolerance is below the method's reach.
    #[error("tolerance = {asked:e}: {method} reaches {reachable:e} here; ask for that or more")]
    Unreachable {
        /// Name of the method.
        method: &'static str,
        /// Requested tolerance.
        asked: f64,
        /// Minimum reachable tolerance.
        reachable: f64,
    },
    /// The system would not fit in memory.
    #[error(
        "{unknowns} unknowns need about {need_gib:.1} GiB, {have_gib:.1} GiB are free; loosen the tolerance or take fewer or smaller fibers"
    )]
    TooLarge {
        /// Size of the linear system.
        unknowns: usize,
        /// Estimated need [GiB].
        need_gib: f64,
        /// Memory that is free [GiB].
        have_gib: f64,
    },
    /// A solve whose residual stayed too large.
    #[error("the solve did not converge: relative residual {residual:e} after {iterations} iterations")]
    NotConverged {
        /// Relative residual reached.
        residual: f64,
        /// Iterations (or refinements) made.
        iterations: usize,
    },
    /// Fields that do not cancel the incident light inside of the bodies: the solution is wrong.
    #[error(
        "{left:.2e} of the incident light is left inside of the fibers, {allowed:.2e} would pass; the tolerance is not reached here, ask for a larger one or another method"
    )]
    Uncancelled {
        /// Maximum remaining field, relative to the largest field.
        left: f64,
        /// Maximum allowed value.
        allowed: f64,
    },
    /// Powers that do not add up: the solution is less exact than requested.
    #[error(
        "lambda_um = {lambda_um}, theta_i_deg = {theta_i_deg}: C_ext - C_sca - C_abs = {defect_um:.2e} um, {allowed_um:.2e} would pass; the tolerance is not reached here, ask for a larger one or another method"
    )]
    Ledger {
        /// Wavelength [um].
        lambda_um: f64,
        /// Latitude of the incidence [degrees].
        theta_i_deg: f64,
        /// C_ext - C_sca - C_abs [um].
        defect_um: f64,
        /// Maximum allowed magnitude [um].
        allowed_um: f64,
    },
}

impl From<WaveError> for plywave_runs::RunError {
    fn from(error: WaveError) -> Self {
        plywave_runs::RunError::of_job(error)
    }
}

impl WaveError {
    /// Refuses a fiber that scatters within, which the solvers' even bodies cannot have.
    pub(crate) fn if_scatters(fiber: &plywave::spec::FiberSpec) -> Result<(), WaveError> {
        if fiber.scattering_per_um == 0.0 {
            return Ok(());
        }
        let hint = "waves pass through even fibers alone: leave this out, or trace rays".into();
        Err(WaveError::Invalid {
            key: "fiber.scattering_per_um".into(),
            value: fiber.scattering_per_um.to_string(),
            hint,
        })
    }
}
