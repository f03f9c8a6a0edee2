//! Scattering by fibers of any outline: incident light onto the walls, densities to far field and ledger.
//!
//! The fields of [`system`](super::system) on outermost walls radiate. From `G ~ (i/4) sqrt(2/(pi k_rho rho)) exp(i (k_rho rho - pi/4)) exp(-i k_rho x.y)` with x the
//! unit vector towards azimuth phi, the axial amplitudes are
//!
//! ```text
//! a_e = (i/4) integral exp(-i k_rho x.y) [-i k_rho x.n e - (k_rho^2/k_0) P + i k_rho (k_z/k_0) x.t h] ds
//! a_h = (i/4) integral exp(-i k_rho x.y) [-i k_rho x.n h - (k_rho^2/k_0) Q - i k_rho (k_z/k_0) x.t e] ds
//! ```
//!
//! and the power that enters the fibers is `-(1/2) integral Im(P e* + Q h*) ds`, since E_t = -i Q and H_t = i P on the walls. The far field of bodies
//! within r of a point is a trigonometric polynomial of order little above k_rho r about it: it is computed on as many azimuths as that
//! takes, which gives C_sca exactly, and from there at any azimuth.

use super::curve::CurvePoint;
use super::system::{BoundarySystem, E, H, P, Q, par};
use super::{
    Body, C64, PlaneWave, Polarization, Scattered, SolverStats, Source, Wave, WaveError, WaveSolver, extinction_width,
    scattering_width,
};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering};

/// Azimuths whose phases are held at once.
const AZIMUTH_CHUNK: usize = 64;

/// The boundary integral solver: bodies prepared for one [`Wave`].
pub struct NystromSolver {
    wave: Wave,
    tolerance: f64,
    system: BoundarySystem,
    /// Bits of the largest residual so far.
    residual: AtomicU64,
}

impl NystromSolver {
    /// Assembles and factorizes the boundary equations of `bodies` (any outline, nested to any depth, lossy or not) so that far fields are off by about
    /// `tolerance` relative to their largest value.
    ///
    /// # Errors
    /// Bad numbers and shapes, walls that overlap, a tolerance out of reach, a system larger than the free memory.
    pub fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        let system = BoundarySystem::new(bodies, wave, tolerance)?;
        Ok(Self::with_system(system, wave, tolerance))
    }

    pub(crate) fn with_system(system: BoundarySystem, wave: &Wave, tolerance: f64) -> Self {
        Self { wave: *wave, tolerance, system, residual: AtomicU64::new(0) }
    }
}

/// Plane waves with their amplitudes, as they fall on a wall: `(e, P, h, Q)` at a point.
pub(crate) fn incident(wave: &Wave, pol: Polarization, waves: &[PlaneWave], point: &CurvePoint) -> [C64; 4] {
    let k_rho = wave.k_rho();
    let (sin_theta, cos_theta) = wave.theta_i.sin_cos();
    let [nx, ny] = point.normal;
    let (mut axial, mut along_n, mut along_t) = (C64::ZERO, C64::ZERO, C64::ZERO);
    for w in waves {
        let (sin, cos) = w.phi_i.sin_cos();
        let field = w.amplitude * C64::from_polar(1.0, -k_rho * (point.at[0] * cos + point.at[1] * sin));
        axial += field;
        along_n += field * (cos * nx + sin * ny);
        along_t += field * (sin * nx - cos * ny);
    }
    // d_n brings -i k_rho omega.n; the rest is the definition of P and Q.
    match pol {
        Polarization::Tm => [axial * cos_theta, -C64::I * along_n, C64::ZERO, -C64::I * sin_theta * along_t],
        Polarization::Te => [C64::ZERO, -C64::I * sin_theta * along_t, -axial * cos_theta, C64::I * along_n],
    }
}

/// Densities of many columns to axial amplitudes at azimuths.
pub(crate) struct FarField {
    /// Center the phases refer to [um].
    pub center: [f64; 2],
    /// Number of equispaced azimuths that resolve the far field about the center.
    pub azimuths: usize,
}

impl FarField {
    /// For sources at `nodes`, resolved to `tolerance`.
    pub(crate) fn new(nodes: &[CurvePoint], k_rho: f64, tolerance: f64) -> Self {
        let mut center = [0.0; 2];
        for k in 0..2 {
            let (low, high) = nodes.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.at[k]), h.max(p.at[k])));
            center[k] = 0.5 * (low + high);
        }
        let radius = nodes.iter().map(|p| (p.at[0] - center[0]).hypot(p.at[1] - center[1])).fold(0.0, f64::max);
        // J_m(x) falls off over x^(1/3) beyond m = x; d digits take about 1.8 d^(2/3) of that.
        let x = k_rho * radius;
        let digits = 2.0 - tolerance.log10();
        let order = x + 1.8 * digits.powf(2.0 / 3.0) * x.max(1.0).cbrt() + digits;
        Self { center, azimuths: (2.0 * order + 2.0).ceil() as usize }
    }

    /// Amplitudes `(a_e, a_h)` on the grid, about the center: `[azimuth]` column after column. `densities` are `(e, P, h, Q)` at a node, node after node, of which the
    /// first `nodes.len()` of `stride` radiate.
    pub(crate) fn amplitudes(
        &self,
        wave: &Wave,
        nodes: &[CurvePoint],
        weights: &[f64],
        densities: &[C64],
        stride: usize,
        columns: usize,
    ) -> (Vec<C64>, Vec<C64>) {
        let n = nodes.len();
        let k_rho = wave.k_rho();
        let (kn, kp) = (-C64::I * k_rho, -k_rho * k_rho / wave.k0());
        let ratio = wave.kz() / wave.k0();
        // Per column and field: factors of cos phi, sin phi and 1.
        let mut moments = vec![C64::ZERO; 6 * n * columns];
        moments.par_chunks_mut(6 * n).enumerate().for_each(|(column, moments)| {
            let u = &densities[4 * stride * column..][..4 * n];
            for (j, (p, w)) in nodes.iter().zip(weights).enumerate() {
                let u = &u[4 * j..][..4];
                let [nx, ny] = p.normal;
                let w = C64::I * (0.25 * w);
                for (field, own, flux, other) in [(0, u[E], u[P], -u[H]), (1, u[H], u[Q], u[E])] {
                    let at = 3 * n * field + j;
                    // x.t = sin phi n_x - cos phi n_y.
                    moments[at] = w * kn * (own * nx - other * (ratio * ny));
                    moments[at + n] = w * kn * (own * ny + other * (ratio * nx));
                    moments[at + 2 * n] = w * flux * kp;
                }
            }
        });
        let mut out = (vec![C64::ZERO; self.azimuths * columns], vec![C64::ZERO; self.azimuths * columns]);
        let mut first = 0;
        while first < self.azimuths {
            let count = AZIMUTH_CHUNK.min(self.azimuths - first);
            let direction = |row: usize| (TAU * (first + row) as f64 / self.azimuths as f64).sin_cos();
            let mut phases = vec![C64::ZERO; count * n];
            phases.par_chunks_mut(count).zip(nodes).for_each(|(phases, p)| {
                let (x, y) = (p.at[0] - self.center[0], p.at[1] - self.center[1]);
                for (row, phase) in phases.iter_mut().enumerate() {
                    let (sin, cos) = direction(row);
                    *phase = C64::from_polar(1.0, -k_rho * (x * cos + y * sin));
                }
            });
            let mut sums = vec![C64::ZERO; count * 6 * columns];
            matmul(
                MatMut::from_column_major_slice_mut(&mut sums, count, 6 * columns),
                Accum::Replace,
                MatRef::from_column_major_slice(&phases, count, n),
                MatRef::from_column_major_slice(&moments, n, 6 * columns),
                C64::ONE,
                par(),
            );
            for column in 0..columns {
                for row in 0..count {
                    let (sin, cos) = direction(row);
                    let at = |k: usize| sums[(6 * column + k) * count + row];
                    let to = self.azimuths * column + first + row;
                    out.0[to] = at(0) * cos + at(1) * sin + at(2);
                    out.1[to] = at(3) * cos + at(4) * sin + at(5);
                }
            }
            first += count;
        }
        out
    }

    /// Values at `phi` of functions known on the grid (`values`, column after column, `[column][phi]` out), with the phase moved from the center to the origin.
    pub(crate) fn resample(&self, wave: &Wave, values: &[C64], phi: &[f64]) -> Vec<C64> {
        let n = self.azimuths;
        let columns = values.len() / n;
        // Dirichlet kernel of the orders |m| <= (n - 1) / 2, and for even n half of the last.
        let mut weights = vec![C64::ZERO; phi.len() * n];
        weights.par_chunks_mut(phi.len()).enumerate().for_each(|(j, weights)| {
            let own = TAU * j as f64 / n as f64;
            for (weight, &phi) in weights.iter_mut().zip(phi) {
                let half = 0.5 * (phi - own);
                let (sin, cos) = half.sin_cos();
                let sine = (n as f64 * half).sin();
                let kernel = if sin.abs() < 1e-12 {
                    // At a multiple of 2 pi apart.
                    1.0
                } else if n.is_multiple_of(2) {
                    sine * cos / (sin * n as f64)
                } else {
                    sine / (sin * n as f64)
                };
                let shift = -wave.k_rho() * (self.center[0] * phi.cos() + self.center[1] * phi.sin());
                *weight = kernel * C64::from_polar(1.0, shift);
            }
        });
        let mut out = vec![C64::ZERO; phi.len() * columns];
        matmul(
            MatMut::from_column_major_slice_mut(&mut out, phi.len(), columns),
            Accum::Replace,
            MatRef::from_column_major_slice(&weights, phi.len(), n),
            MatRef::from_column_major_slice(values, n, columns),
            C64::ONE,
            par(),
        );
        out
    }
}

/// Far fields and ledger of sources from the total fields on outermost walls. `densities` are `(e, P, h, Q)` node after node, `stride` nodes a column, one column a source.
pub(crate) fn harvest(
    wave: &Wave,
    tolerance: f64,
    nodes: &[CurvePoint],
    weights: &[f64],
    densities: &[C64],
    stride: usize,
    sources: &[(Polarization, Vec<PlaneWave>)],
    n_phi_out: usize,
) -> Vec<Scattered> {
    let far = FarField::new(nodes, wave.k_rho(), tolerance);
    let (e, h) = far.amplitudes(wave, nodes, weights, densities, stride, sources.len());
    let per_cos = 1.0 / wave.theta_i.cos();
    let scale = |v: Vec<C64>| -> Vec<C64> { v.into_iter().map(|a| a * per_cos).collect() };
    let (f_u, f_phi) = (scale(e), scale(h));
    let phi_out: Vec<f64> = (0..n_phi_out).map(|j| TAU * j as f64 / n_phi_out as f64).collect();
    let (out_u, out_phi) = if n_phi_out == 0 {
        (Vec::new(), Vec::new())
    } else {
        (far.resample(wave, &f_u, &phi_out), far.resample(wave, &f_phi, &phi_out))
    };
    let m = far.azimuths;
    (0..sources.len())
        .into_par_iter()
        .map(|s| {
            let (pol, waves) = &sources[s];
            let (u, phi) = (&f_u[m * s..][..m], &f_phi[m * s..][..m]);
            let ahead: Vec<f64> = waves.iter().map(|w| w.phi_i + std::f64::consts::PI).collect();
            let forward: Vec<(C64, C64)> =
                far.resample(wave, u, &ahead).into_iter().zip(far.resample(wave, phi, &ahead)).collect();
            let density = &densities[4 * stride * s..];
            let absorbed: f64 = weights
                .iter()
                .enumerate()
                .map(|(j, w)| {
                    let u = &density[4 * j..][..4];
                    -w * (u[P] * u[E].conj() + u[Q] * u[H].conj()).im
                })
                .sum();
            Scattered {
                f_u: out_u[n_phi_out * s..][..n_phi_out].to_vec(),
                f_phi: out_phi[n_phi_out * s..][..n_phi_out].to_vec(),
                c_sca_um: scattering_width(wave, u, phi),
                c_abs_um: absorbed,
                c_ext_um: extinction_width(wave, *pol, waves, &forward),
            }
        })
        .collect()
}

impl WaveSolver for NystromSolver {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let nodes = self.system.nodes();
        let outer = &nodes[..self.system.outer_nodes()];
        let extent = outer.iter().map(|p| p.at[0].hypot(p.at[1])).fold(0.0, f64::max);
        let waves = sources
            .iter()
            .map(|s| Ok((s.pol, s.plane_waves(&self.wave, extent)?)))
            .collect::<Result<Vec<_>, WaveError>>()?;
        let stride = nodes.len();
        let mut fields = vec![C64::ZERO; 4 * stride * sources.len()];
        fields.par_chunks_mut(4 * stride).zip(&waves).for_each(|(fields, (pol, waves))| {
            for (out, point) in fields.chunks_mut(4).zip(outer) {
                out.copy_from_slice(&incident(&self.wave, *pol, waves, point));
            }
        });
        let mut residual: f64 = 0.0;
        for (part, components) in self.system.parts().enumerate() {
            if components.len() == 4 {
                residual = residual.max(self.system.solve(part, &mut fields, sources.len()));
                continue;
            }
            // Only sources of this part's polarization drive it.
            let wanted = if components[0] == E { Polarization::Tm } else { Polarization::Te };
            let columns: Vec<usize> = (0..sources.len()).filter(|&s| sources[s].pol == wanted).collect();
            let size = components.len();
            let mut rhs = Vec::with_capacity(size * stride * columns.len());
            for &s in &columns {
                for node in fields[4 * stride * s..][..4 * stride].chunks(4) {
                    rhs.extend(components.iter().map(|&c| node[c]));
                }
            }
            residual = residual.max(self.system.solve(part, &mut rhs, columns.len()));
            for (&s, rhs) in columns.iter().zip(rhs.chunks(size * stride)) {
                for (node, values) in fields[4 * stride * s..].chunks_mut(4).zip(rhs.chunks(size)) {
                    for (&c, value) in components.iter().zip(values) {
                        node[c] = *value;
                    }
                }
            }
        }
        // Residuals are not negative: their bits are ordered as they are.
        self.residual.fetch_max(residual.to_bits(), Ordering::Relaxed);
        if residual.is_nan() || residual > 0.1 * self.tolerance {
            return Err(WaveError::NotConverged { residual, iterations: 0 });
        }
        let weights: Vec<f64> = self.system.outer_weights();
        Ok(harvest(&self.wave, self.tolerance, outer, &weights, &fields, stride, &waves, n_phi_out))
    }

    fn stats(&self) -> SolverStats {
        SolverStats {
            unknowns: self.system.unknowns(),
            residual: f64::from_bits(self.residual.load(Ordering::Relaxed)),
            peak_bytes: self.system.peak_bytes(),
        }
    }
}
