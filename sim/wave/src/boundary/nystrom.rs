//! Scattering by fibers of any outline: from incident light on the walls, through densities, to far field and
//! ledger.
//!
//! The fields of [`system`](crate::boundary::system) on outermost walls radiate. With
//! `G ~ (i/4) sqrt(2/(pi k_rho rho)) exp(i (k_rho rho - pi/4)) exp(-i k_rho x.y)` with x the unit vector
//! towards azimuth phi, the axial amplitudes are
//!
//! ```text
//! a_e = (i/4) integral exp(-i k_rho x.y) [-i k_rho x.n e - (k_rho^2/k_0) P + i k_rho (k_z/k_0) x.t h] ds
//! a_h = (i/4) integral exp(-i k_rho x.y) [-i k_rho x.n h - (k_rho^2/k_0) Q - i k_rho (k_z/k_0) x.t e] ds
//! ```
//!
//! and the power that enters the fibers is `-(1/2) integral Im(P e* + Q h*) ds`, since E_t = -i Q and H_t = i
//! P on the walls. The far field of bodies within r of a point is a trigonometric polynomial of order little
//! above k_rho r about it. It is computed on the azimuths that determine this polynomial, which gives C_sca
//! exactly, and interpolated to any azimuth.

use crate::boundary::entries::{E, H, P, Q};
use crate::boundary::extinction::Probes;
use crate::boundary::incident::incident;
use crate::boundary::lu::par;
use crate::boundary::system::BoundarySystem;
use crate::scene::curve::CurvePoint;
use crate::scene::symmetry::{Element, Group};
use crate::{
    Body, C64, PlaneWave, Polarization, Scattered, SolverStats, Source, Wave, WaveError, WaveSolver, extinction_width,
    scattering_width,
};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of azimuths whose phases are held at once.
const AZIMUTH_CHUNK: usize = 64;

/// The boundary integral solver: bodies prepared for one [`Wave`].
pub struct NystromSolver {
    wave: Wave,
    tolerance: f64,
    system: BoundarySystem,
    probes: Probes,
    /// Bits of the largest residual so far.
    residual: AtomicU64,
}

impl NystromSolver {
    /// Assembles and factorizes the boundary equations of `bodies` (any outline, nested to any depth, lossy
    /// or not) for far fields with an error of about `tolerance` relative to their largest value.
    ///
    /// # Errors
    /// Bad numbers and shapes, walls that overlap, a tolerance out of reach, a system larger than the free
    /// memory.
    pub fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        let system = BoundarySystem::new(bodies, wave, tolerance)?;
        Ok(Self::with_system(system, wave, tolerance))
    }

    pub(crate) fn with_system(system: BoundarySystem, wave: &Wave, tolerance: f64) -> Self {
        let weights = system.outer_weights();
        let walls: Vec<(&[CurvePoint], &[f64])> = system
            .walls()
            .iter()
            .filter(|w| w.outside == 0)
            .map(|w| (w.curve.nodes.as_slice(), &weights[w.first..][..w.curve.nodes.len()]))
            .collect();
        let probes = Probes::new(wave, &walls, tolerance);
        Self { wave: *wave, tolerance, system, probes, residual: AtomicU64::new(0) }
    }

    /// Solver without the check of its fields, to measure the error of too few nodes.
    #[cfg(test)]
    pub(crate) fn unchecked(self) -> Self {
        Self { probes: Probes::none(&self.wave), ..self }
    }
}

/// Map from densities of many columns to axial amplitudes at azimuths.
pub(crate) struct FarField {
    /// Center the phases refer to [um].
    pub center: [f64; 2],
    /// First azimuth of the grid [rad].
    pub start: f64,
    /// Number of equispaced azimuths that resolve the far field about the center.
    pub azimuths: usize,
}

impl FarField {
    /// Map for sources at `nodes`, resolved to `tolerance`. The maps of the walls' symmetries take the grid
    /// to itself.
    pub(crate) fn new(nodes: &[CurvePoint], k_rho: f64, tolerance: f64, group: &Group) -> Self {
        let mut center = [0.0; 2];
        for k in 0..2 {
            let (low, high) = nodes.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.at[k]), h.max(p.at[k])));
            center[k] = 0.5 * (low + high);
        }
        let (mut start, mut multiple) = (0.0, 1);
        if group.order() > 1 {
            center = [group.center.re, group.center.im];
            // A mirror's axis is at half its angle.
            start = group.elements.iter().find(|e| e.mirror).map_or(0.0, |e| 0.5 * e.angle);
            multiple = group.order();
        }
        let radius = nodes.iter().map(|p| (p.at[0] - center[0]).hypot(p.at[1] - center[1])).fold(0.0, f64::max);
        // J_m(x) falls off over x^(1/3) beyond m = x; d digits take about 1.8 d^(2/3) of that.
        let x = k_rho * radius;
        let digits = 2.0 - tolerance.log10();
        let order = x + 1.8 * digits.powf(2.0 / 3.0) * x.max(1.0).cbrt() + digits;
        Self { center, start, azimuths: ((2.0 * order + 2.0).ceil() as usize).next_multiple_of(multiple) }
    }

    /// Azimuth j of the grid [rad].
    fn azimuth(&self, j: usize) -> f64 {
        self.start + TAU * j as f64 / self.azimuths as f64
    }

    /// Amplitudes `(a_e, a_h)` on the grid, about the center: `[azimuth]` column after column. `densities`
    /// are `(e, P, h, Q)` at a node, node after node, where the first `nodes.len()` of `stride` radiate.
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
            let direction = |row: usize| self.azimuth(first + row).sin_cos();
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

    /// Values at `phi` of functions known on the grid (`values`, column after column, `[column][phi]` out),
    /// with the phase moved from the center to the origin.
    pub(crate) fn resample(&self, wave: &Wave, values: &[C64], phi: &[f64]) -> Vec<C64> {
        let n = self.azimuths;
        let columns = values.len() / n;
        if phi.is_empty() || columns == 0 {
            return Vec::new();
        }
        // Dirichlet kernel of the orders |m| <= (n - 1) / 2, and for even n half of the last.
        let mut weights = vec![0.0; phi.len() * n];
        weights.par_chunks_mut(phi.len()).enumerate().for_each(|(j, weights)| {
            let own = self.azimuth(j);
            for (weight, &phi) in weights.iter_mut().zip(phi) {
                let half = 0.5 * (phi - own);
                let (sin, cos) = half.sin_cos();
                let sine = (n as f64 * half).sin();
                *weight = if sin.abs() < 1e-12 {
                    // Apart by a multiple of 2 pi.
                    1.0
                } else if n.is_multiple_of(2) {
                    sine * cos / (sin * n as f64)
                } else {
                    sine / (sin * n as f64)
                };
            }
        });
        // Real and imaginary parts side by side: the kernel is real.
        let parts: Vec<f64> = values.iter().map(|v| v.re).chain(values.iter().map(|v| v.im)).collect();
        let mut sums = vec![0.0; 2 * phi.len() * columns];
        matmul(
            MatMut::from_column_major_slice_mut(&mut sums, phi.len(), 2 * columns),
            Accum::Replace,
            MatRef::from_column_major_slice(&weights, phi.len(), n),
            MatRef::from_column_major_slice(&parts, n, 2 * columns),
            1.0,
            par(),
        );
        let shifts: Vec<C64> = phi
            .iter()
            .map(|phi| C64::from_polar(1.0, -wave.k_rho() * (self.center[0] * phi.cos() + self.center[1] * phi.sin())))
            .collect();
        let (re, im) = sums.split_at(phi.len() * columns);
        re.iter().zip(im).zip(shifts.iter().cycle()).map(|((&re, &im), shift)| C64::new(re, im) * shift).collect()
    }

    /// Image of azimuth j of the grid under the map.
    fn image(&self, element: &Element, j: usize) -> usize {
        let n = self.azimuths as i64;
        let at = (element.azimuth(self.azimuth(j)) - self.start) * n as f64 / TAU;
        (at.round() as i64).rem_euclid(n) as usize
    }
}

/// Far fields F on the grid and absorbed widths, one column per density.
struct Radiated {
    far: FarField,
    f_u: Vec<C64>,
    f_phi: Vec<C64>,
    absorbed_um: Vec<f64>,
}

impl Radiated {
    fn new(
        wave: &Wave,
        far: FarField,
        nodes: &[CurvePoint],
        weights: &[f64],
        densities: &[C64],
        stride: usize,
        columns: usize,
    ) -> Self {
        let (mut f_u, mut f_phi) = far.amplitudes(wave, nodes, weights, densities, stride, columns);
        let per_cos = 1.0 / wave.theta_i.cos();
        for value in f_u.iter_mut().chain(&mut f_phi) {
            *value *= per_cos;
        }
        let absorbed_um = (0..columns)
            .map(|column| {
                let u = densities[4 * stride * column..].chunks(4).zip(weights);
                u.map(|(u, w)| -w * (u[P] * u[E].conj() + u[Q] * u[H].conj()).im).sum()
            })
            .collect();
        Self { far, f_u, f_phi, absorbed_um }
    }
}

/// Relation of a source to a solved one: its image under a map, with its amplitudes times factors.
#[derive(Clone, Copy)]
struct Origin {
    column: usize,
    element: usize,
    factor_u: C64,
    factor_phi: C64,
}

/// Sources to be solved, and the relation of every source to them. Plane waves that maps of the walls take to
/// each other are solved once.
fn origins(wave: &Wave, group: &Group, sources: &[Source]) -> (Vec<usize>, Vec<Origin>) {
    let mut solved: Vec<usize> = Vec::new();
    let origins = sources
        .iter()
        .enumerate()
        .map(|(index, source)| {
            let found = solved.iter().enumerate().find_map(|(column, &other)| {
                let other = &sources[other];
                if other.pol != source.pol || other.beam.is_some() || source.beam.is_some() {
                    return None;
                }
                let same = |e: &Element| {
                    let apart = (e.azimuth(other.phi_i) - source.phi_i) / TAU;
                    (apart - apart.round()).abs() < 1e-13
                };
                group.elements.iter().position(same).map(|element| (column, element, other.phi_i))
            });
            let Some((column, element, phi_i)) = found else {
                solved.push(index);
                return Origin { column: solved.len() - 1, element: 0, factor_u: C64::ONE, factor_phi: C64::ONE };
            };
            // Both waves have phase zero at the origin; the map keeps the phase at the center.
            let towards = C64::from_polar(1.0, source.phi_i) - C64::from_polar(1.0, phi_i);
            let phase = C64::from_polar(1.0, -wave.k_rho() * (towards.conj() * group.center).re);
            // A mirror reverses h: that of the scattered light for TM; the incident one for TE, so that the
            // whole solution changes sign.
            let (factor_u, factor_phi) = match (group.elements[element].mirror, source.pol) {
                (false, _) => (phase, phase),
                (true, Polarization::Tm) => (phase, -phase),
                (true, Polarization::Te) => (-phase, phase),
            };
            Origin { column, element, factor_u, factor_phi }
        })
        .collect();
    (solved, origins)
}

/// Far fields and ledger of sources from the total fields on outermost walls. `densities` are `(e, P, h, Q)`
/// node after node, `stride` nodes per column, one column per source.
#[allow(dead_code, reason = "for the solver of many fibers")]
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
    let group = Group::trivial(0);
    let far = FarField::new(nodes, wave.k_rho(), tolerance, &group);
    let radiated = Radiated::new(wave, far, nodes, weights, densities, stride, sources.len());
    let own = |column| Origin { column, element: 0, factor_u: C64::ONE, factor_phi: C64::ONE };
    let origins: Vec<Origin> = (0..sources.len()).map(own).collect();
    finish(wave, &group, &radiated, &origins, sources, n_phi_out)
}

/// Far fields at the requested azimuths and ledgers, one per source.
fn finish(
    wave: &Wave,
    group: &Group,
    radiated: &Radiated,
    origins: &[Origin],
    sources: &[(Polarization, Vec<PlaneWave>)],
    n_phi_out: usize,
) -> Vec<Scattered> {
    let far = &radiated.far;
    let m = far.azimuths;
    // Both amplitudes of a source side by side.
    let mut grid = vec![C64::ZERO; 2 * m * origins.len()];
    grid.par_chunks_mut(2 * m).zip(origins).for_each(|(grid, origin)| {
        let element = &group.elements[origin.element];
        let (u, phi) = grid.split_at_mut(m);
        for j in 0..m {
            let to = if origin.element == 0 { j } else { far.image(element, j) };
            u[to] = radiated.f_u[m * origin.column + j] * origin.factor_u;
            phi[to] = radiated.f_phi[m * origin.column + j] * origin.factor_phi;
        }
    });
    let phi_out: Vec<f64> = (0..n_phi_out).map(|j| TAU * j as f64 / n_phi_out as f64).collect();
    let out = far.resample(wave, &grid, &phi_out);
    (0..sources.len())
        .into_par_iter()
        .map(|s| {
            let (pol, waves) = &sources[s];
            let (u, phi) = grid[2 * m * s..][..2 * m].split_at(m);
            let ahead: Vec<f64> = waves.iter().map(|w| w.phi_i + PI).collect();
            // The theorem uses the incident polarization alone.
            let forward: Vec<(C64, C64)> = match pol {
                Polarization::Tm => far.resample(wave, u, &ahead).into_iter().map(|f| (f, C64::ZERO)).collect(),
                Polarization::Te => far.resample(wave, phi, &ahead).into_iter().map(|f| (C64::ZERO, f)).collect(),
            };
            let (out_u, out_phi) = out[2 * n_phi_out * s..][..2 * n_phi_out].split_at(n_phi_out);
            Scattered {
                f_u: out_u.to_vec(),
                f_phi: out_phi.to_vec(),
                c_sca_um: scattering_width(wave, u, phi),
                c_abs_um: radiated.absorbed_um[origins[s].column],
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
        let group = self.system.group();
        let (solved, origins) = origins(&self.wave, group, sources);
        let stride = nodes.len();
        let mut fields = vec![C64::ZERO; 4 * stride * solved.len()];
        fields.par_chunks_mut(4 * stride).zip(&solved).for_each(|(fields, &s)| {
            let (pol, waves) = &waves[s];
            for (out, point) in fields.chunks_mut(4).zip(outer) {
                out.copy_from_slice(&incident(&self.wave, *pol, waves, point));
            }
        });
        let mut residual: f64 = 0.0;
        for (part, components) in self.system.parts().enumerate() {
            if components.len() == 4 {
                residual = residual.max(self.system.solve(part, &mut fields, solved.len()));
                continue;
            }
            // Only sources of this part's polarization drive it.
            let wanted = if components[0] == E { Polarization::Tm } else { Polarization::Te };
            let columns: Vec<usize> = (0..solved.len()).filter(|&s| sources[solved[s]].pol == wanted).collect();
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
        // Residuals are not negative, so the order of their bits is theirs.
        self.residual.fetch_max(residual.to_bits(), Ordering::Relaxed);
        if residual.is_nan() || residual > 0.1 * self.tolerance {
            return Err(WaveError::NotConverged { residual, iterations: 0 });
        }
        let far = FarField::new(outer, self.wave.k_rho(), self.tolerance, group);
        let weights = self.system.outer_weights();
        self.probes.check(outer, &weights, &fields, stride, solved.iter().map(|&s| &waves[s]))?;
        let radiated = Radiated::new(&self.wave, far, outer, &weights, &fields, stride, solved.len());
        Ok(finish(&self.wave, group, &radiated, &origins, &waves, n_phi_out))
    }

    fn stats(&self) -> SolverStats {
        SolverStats {
            unknowns: self.system.unknowns(),
            residual: f64::from_bits(self.residual.load(Ordering::Relaxed)),
            peak_bytes: self.system.peak_bytes(),
        }
    }
}
