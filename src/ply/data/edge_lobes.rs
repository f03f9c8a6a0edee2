//! Ply-edge diffraction lobes (Yu 2025, 6.1, Eq. 17, 18): the light of a beam that passes beside a ply,
//! spread by the edge it passes.
//!
//! The lobe points forward (theta -theta_i, phi 3 pi/2, phi_xy 0), so its x axis is the ply's, and has the
//! energy r_d. Only its bandwidths are stored, over the wavelength and over e = R - |h|, the distance of the
//! beam's center inside the ply's edge; at e < 0 the beam's center misses. The lobe is normalized exactly,
//! not by `mu1 mu2/pi` (docs/explain/papers/yu_2025.md, erratum 3).

use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use crate::ply::asg::{Lobe, MU_MIN};
use std::f64::consts::{FRAC_PI_2, PI};

/// Names of the tensors of the edge lobes in a model file.
pub(crate) const NAMES: [&str; 4] = ["edge_radius_um", "edge_lambda_um", "edge_inside_um", "edge_ln_mu"];

/// Maximum bandwidth of an edge lobe: that of a beam of waist 200 um in violet light.
pub const EDGE_MU_MAX: f64 = 1e7;
/// Maximum number of nodes of an axis.
const MAX_NODES: usize = 1024;

/// Bandwidths of the edge lobe at nodes. ln mu is bilinear between the nodes and constant beyond them.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeLobes {
    /// Radius R of the ply [um], which e is relative to.
    pub radius_um: f64,
    /// `[L]` wavelengths [um], uniform and ascending; at least 2.
    pub lambda_um: Vec<f64>,
    /// `[E]` e = R - |h| [um], uniform and ascending; at least 2.
    pub inside_um: Vec<f64>,
    /// `[L][E][2]` ln mu1 (across the ply) and ln mu2 (along it).
    pub ln_mu: Vec<f64>,
}

impl EdgeLobes {
    /// The lobe of energy 1 at an incidence. This is the reference implementation of the runtime's
    /// evaluation.
    pub fn lobe(&self, theta_i: f64, h_um: f64, lambda_um: f64) -> Lobe {
        let place = |axis: &[f64], x: f64| {
            let last = axis.len() - 1;
            let t = ((x - axis[0]) / (axis[last] - axis[0]) * last as f64).clamp(0.0, last as f64);
            let i = (t as usize).min(last - 1);
            (i, t - i as f64)
        };
        let (l, fl) = place(&self.lambda_um, lambda_um);
        let (e, fe) = place(&self.inside_um, self.radius_um - h_um.abs());
        let ln_mu = |c: usize| {
            let at = |l: usize, e: usize| self.ln_mu[(l * self.inside_um.len() + e) * 2 + c];
            let row = |l: usize| (1.0 - fe) * at(l, e) + fe * at(l, e + 1);
            (1.0 - fl) * row(l) + fl * row(l + 1)
        };
        let phi_z = 3.0 * FRAC_PI_2;
        Lobe { theta_z: -theta_i, phi_z, phi_xy: 0.0, ln_mu1: ln_mu(0), ln_mu2: ln_mu(1), energy: 1.0 }
    }

    pub(crate) fn write(&self, w: &mut Writer) {
        let (l, e) = (self.lambda_um.len(), self.inside_um.len());
        w.f64("edge_radius_um", &[1], &[self.radius_um]);
        w.f64("edge_lambda_um", &[l], &self.lambda_um);
        w.f64("edge_inside_um", &[e], &self.inside_um);
        w.f32("edge_ln_mu", &[l, e, 2], self.ln_mu.iter().map(|v| *v as f32));
    }

    /// Reads the lobes of a file; `None` if it has none of their tensors.
    pub(crate) fn read(r: &Reader<'_>) -> Result<Option<EdgeLobes>> {
        if NAMES.iter().all(|name| !r.has(name)) {
            return Ok(None);
        }
        let (l, e) = (r.shape("edge_lambda_um", 1)?[0], r.shape("edge_inside_um", 1)?[0]);
        Ok(Some(EdgeLobes {
            radius_um: r.f64("edge_radius_um", &[1])?[0],
            lambda_um: r.f64("edge_lambda_um", &[l])?,
            inside_um: r.f64("edge_inside_um", &[e])?,
            ln_mu: r.f64("edge_ln_mu", &[l, e, 2])?,
        }))
    }

    /// Checks that the lobes are valid. Reading and writing call this.
    pub(crate) fn check(&self, c: &Check<'_>) -> Result<()> {
        c.range("edge_radius_um", &[self.radius_um], 1e-3, 1e6)?;
        let (l, e) = (self.lambda_um.len(), self.inside_um.len());
        for (name, axis, low, high) in
            [("edge_lambda_um", &self.lambda_um, 0.05, 20.0), ("edge_inside_um", &self.inside_um, -1e6, 1e6)]
        {
            if !(2..=MAX_NODES).contains(&axis.len()) {
                let hint = format!("expected 2 to {MAX_NODES}");
                return Err(invalid(c.0, name, format!("{} values", axis.len()), &hint));
            }
            c.uniform(name, axis)?;
            c.range(name, axis, low, high)?;
        }
        c.len("edge_ln_mu", self.ln_mu.len(), &[l, e, 2])?;
        // Rounding to f32 may move a bandwidth slightly past its bound.
        c.range("edge_ln_mu", &self.ln_mu, MU_MIN.ln() - 1e-5, EDGE_MU_MAX.ln() + 1e-5)
    }
}

/// Bandwidth of the unobstructed beam, whose `|k|^2` is `exp(-2 (pi w0 u/lambda)^2)`.
pub fn beam_mu(w0_um: f64, lambda_um: f64) -> f64 {
    2.0 * (PI * w0_um / lambda_um).powi(2)
}
