//! Bodies without their invisible walls, which have the same medium on both sides.

use crate::{Body, C64, Scattered, SolverStats, Source, WaveError, WaveSolver};

/// Bodies without the walls between equal media.
pub(crate) fn visible(bodies: &[Body]) -> Vec<Body> {
    bodies.iter().filter_map(|body| visible_body(body, C64::ONE)).collect()
}

/// The visible part of a body in a medium: only its lumen if the indices are equal.
fn visible_body(body: &Body, around: C64) -> Option<Body> {
    let lumen = body.lumen.as_deref().and_then(|lumen| visible_body(lumen, body.index()));
    if body.index() == around { lumen } else { Some(Body { lumen: lumen.map(Box::new), ..body.clone() }) }
}

/// The solver of no bodies at all.
pub(crate) struct EmptySolver;

impl WaveSolver for EmptySolver {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let none = vec![C64::ZERO; n_phi_out];
        let dark = Scattered { f_u: none.clone(), f_phi: none, c_sca_um: 0.0, c_abs_um: 0.0, c_ext_um: 0.0 };
        Ok(vec![dark; sources.len()])
    }

    fn stats(&self) -> SolverStats {
        SolverStats { unknowns: 0, residual: 0.0, peak_bytes: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    fn circle(radius_um: f64, eta: f64, kappa: f64, lumen: Option<Body>) -> Body {
        let shape = Shape::Circle { radius_um };
        Body { shape, center_um: [0.0; 2], rotation_rad: 0.0, eta, kappa, lumen: lumen.map(Box::new) }
    }

    /// Walls between equal media, absorption included, are removed; their inner bodies stay.
    #[test]
    fn walls_between_equal_media_go() {
        let core = circle(1.0, 1.0, 0.0, None);
        let coat = |eta: f64, kappa: f64| circle(2.0, eta, kappa, Some(circle(1.5, 1.5, 0.1, Some(core.clone()))));
        assert_eq!(visible(std::slice::from_ref(&core)), []);
        assert_eq!(visible(&[coat(1.0, 0.0)]), [circle(1.5, 1.5, 0.1, Some(core.clone()))]);
        assert_eq!(visible(&[coat(1.5, 0.1)]), [circle(2.0, 1.5, 0.1, Some(core.clone()))]);
        assert_eq!(visible(&[coat(1.5, 0.0), core.clone()]), [coat(1.5, 0.0)]);
    }
}
