//! Several circular cylinders, plain or layered, at oblique incidence by cylindrical waves about each center
//! (Graf's addition theorem, DLMF 10.23.7).
//!
//! Scattered amplitudes c of all cylinders obey `c_p = T_p (a_p + sum_q G_pq c_q)`, where a_p is the incident
//! light about the center of p, T_p the response of `circle.rs`, and
//! `G_pq[n][m] = H_{m-n}(k_rho D) exp(i (m - n) psi)` for the vector (D, psi) from the center of q to that of
//! p. All amplitudes are scaled by the size s_n of H_n at their own wall, x = s c, which bounds every entry,
//! so narrow gaps may use high orders. One LU factorization serves all sources; at normal incidence e and h
//! have one each, of half the size.
//!
//! The number of orders for a gap is not known beforehand. The first guess comes from the image points of the
//! two walls, and orders are added until the last amplitudes are small enough for probe waves from several
//! sides.

use crate::boundary::lu::{Lu, par};
use crate::cylinders::circle::{Circle, M2, Response, order_for};
use crate::cylinders::mie::{check_wave, reachable};
use crate::light::series::{incident, minus_i_power};
use crate::special::{Sequence, power_of_two};
use crate::{Body, C64, Polarization, Scattered, SolverStats, Source, Wave, WaveError, WaveSolver};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef};
use plywave_runs::memory::available_bytes;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering};

const METHOD: &str = "multipole";
const ZERO: C64 = C64::new(0.0, 0.0);

/// Rounds of adding orders before the tolerance counts as unreachable.
const ROUNDS: usize = 16;
/// Azimuths of the probe waves that decide on the orders.
const PROBES: usize = 5;
/// Sources solved at once: bounds the memory of right-hand sides.
const BATCH: usize = 256;

/// Circular cylinders coupled by Graf's theorem, factorized once for all sources.
pub struct MultipoleSolver {
    wave: Wave,
    tolerance: f64,
    cylinders: Vec<Cylinder>,
    /// One system for both fields, or one each at normal incidence.
    systems: Vec<System>,
    peak_bytes: usize,
    /// Bits of the largest residual so far.
    residual: AtomicU64,
}

/// One cylinder with its place among the unknowns.
struct Cylinder {
    center_um: [f64; 2],
    radius_um: f64,
    response: Response,
    /// Number of orders before this cylinder's, per field.
    first: usize,
}

impl Cylinder {
    fn top(&self) -> usize {
        self.response.top()
    }

    /// Number of orders -top..=top.
    fn width(&self) -> usize {
        2 * self.top() + 1
    }
}

/// The factorized equations of the fields in `fields` (0: e, 1: h). Unknowns run over cylinder, field, order,
/// the last fastest.
struct System {
    fields: &'static [usize],
    size: usize,
    lu: Lu<C64>,
}

/// Right-hand side and solution of one batch, columns by source.
struct Solution {
    /// Incident amplitudes over s.
    incident: Mat<C64>,
    /// Incident and neighbors' amplitudes over s.
    exciting: Mat<C64>,
    /// Scattered amplitudes times s.
    x: Mat<C64>,
}

impl MultipoleSolver {
    /// Prepares and factorizes the scene: circles with concentric circular lumens, nowhere touching.
    ///
    /// # Errors
    /// [`WaveError::Unsupported`] for other outlines, [`WaveError::Invalid`] and [`WaveError::Overlap`] for
    /// bad scenes, [`WaveError::TooLarge`] before a factorization that does not fit in the free memory,
    /// [`WaveError::Unreachable`] if `tolerance` is below rounding or needs more orders than the limit.
    pub fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        check_wave(wave)?;
        if bodies.is_empty() {
            return Err(WaveError::Invalid {
                key: "fiber".into(),
                value: "none".into(),
                hint: "give one or more".into(),
            });
        }
        let circles: Vec<Circle> = bodies
            .iter()
            .enumerate()
            .map(|(i, b)| Circle::new(b, &format!("fiber[{i}]"), METHOD))
            .collect::<Result<_, _>>()?;
        for (i, p) in circles.iter().enumerate() {
            for (j, q) in circles.iter().enumerate().take(i) {
                if distance(p, q) <= p.radius_um() + q.radius_um() {
                    return Err(WaveError::Overlap { first: format!("fiber[{j}]"), second: format!("fiber[{i}]") });
                }
            }
        }
        let reachable = 10.0 * circles.iter().map(|c| reachable(c, wave)).fold(0.0, f64::max);
        if tolerance.is_nan() || tolerance < reachable {
            return Err(WaveError::Unreachable { method: METHOD, asked: tolerance, reachable });
        }
        let mut tops = vec![0; circles.len()];
        if circles.len() > 2 {
            // First every cylinder with its closest neighbor alone: small systems, and usually the cluster
            // needs no more orders.
            let mut known: Vec<([&Circle; 2], f64, Vec<usize>)> = Vec::new();
            for (i, p) in circles.iter().enumerate() {
                let gap = |q: &Circle| distance(p, q) - p.radius_um() - q.radius_um();
                let others = circles.iter().enumerate().filter(|(j, _)| *j != i);
                let Some((j, q)) = others.min_by(|a, b| gap(a.1).total_cmp(&gap(b.1))) else { continue };
                let like = known.iter().find(|([a, b], g, _)| {
                    a.layers == p.layers && b.layers == q.layers && (g - gap(q)).abs() < 0.01 * g
                });
                let pair = match like {
                    Some((_, _, pair)) => pair.clone(),
                    None => {
                        let pair = Self::settle(&[p.clone(), q.clone()], wave, tolerance, &[0, 0])?.tops();
                        known.push(([p, q], gap(q), pair.clone()));
                        pair
                    }
                };
                (tops[i], tops[j]) = (tops[i].max(pair[0]), tops[j].max(pair[1]));
            }
        }
        Self::settle(&circles, wave, tolerance, &tops)
    }

    /// Adds orders until the tolerance holds, from `min_orders` or [`first_order`]'s guess on.
    fn settle(circles: &[Circle], wave: &Wave, tolerance: f64, min_orders: &[usize]) -> Result<Self, WaveError> {
        let (mut tops, narrow): (Vec<usize>, Vec<f64>) =
            (0..circles.len()).map(|i| first_order(circles, i, wave, tolerance)).unzip();
        for (top, min_orders) in tops.iter_mut().zip(min_orders) {
            *top = (*top).max(*min_orders);
        }
        let probes: Vec<Source> = (0..PROBES)
            .flat_map(|i| [Polarization::Tm, Polarization::Te].map(|pol| (i, pol)))
            .map(|(i, pol)| Source { phi_i: 0.3 + TAU * i as f64 / PROBES as f64, pol, beam: None })
            .collect();
        let mut error = f64::INFINITY;
        for round in 0..ROUNDS {
            let solver = Self::with_orders(circles, wave, tolerance, &tops)?;
            if circles.len() == 1 {
                return Ok(solver);
            }
            let errors: Vec<f64> = solver.tails(&probes)?.iter().zip(&narrow).map(|(tail, all)| tail * all).collect();
            error = errors.iter().copied().fold(0.0, f64::max);
            if error <= tolerance {
                return Ok(solver);
            }
            for ((top, error), circle) in tops.iter_mut().zip(errors).zip(circles) {
                if error > tolerance {
                    // Squared amplitudes fall at least as exp(-2 alpha) per order, cosh(alpha) = n/x,
                    // unless a gap slows them: then the steps grow.
                    let alpha = (*top as f64 / (wave.k_rho() * circle.radius_um())).max(1.0).acosh();
                    let more = (1 + round) as f64 * (error / tolerance).ln() / (2.0 * alpha);
                    *top += more.clamp(3.0, (*top as f64 / 8.0).max(4.0)) as usize;
                }
            }
        }
        Err(WaveError::Unreachable { method: METHOD, asked: tolerance, reachable: error })
    }

    /// Highest order about each center.
    fn tops(&self) -> Vec<usize> {
        self.cylinders.iter().map(Cylinder::top).collect()
    }

    /// The scene with orders up to `tops` about each center.
    fn with_orders(circles: &[Circle], wave: &Wave, tolerance: f64, tops: &[usize]) -> Result<Self, WaveError> {
        let orders: usize = tops.iter().map(|t| 2 * t + 1).sum();
        let normal = wave.kz() == 0.0;
        let (count, size) = if normal { (2, orders) } else { (1, 2 * orders) };
        // Factors, one translation block per thread, and a batch of right-hand sides with their copies.
        let need = count * size * size * 16 + 6 * size * BATCH * 16;
        let have = available_bytes().unwrap_or(usize::MAX);
        if need > have {
            let gib = |bytes: usize| bytes as f64 / (1u64 << 30) as f64;
            return Err(WaveError::TooLarge { unknowns: size, need_gib: gib(need), have_gib: gib(have) });
        }
        let mut first = 0;
        let cylinders = circles
            .iter()
            .zip(tops)
            .map(|(circle, &top)| {
                let hankel = Sequence::hankel(C64::new(wave.k_rho() * circle.radius_um(), 0.0), top + 1);
                let response = Response::new(circle, wave, &hankel, top)?;
                let cylinder = Cylinder { center_um: circle.center_um, radius_um: circle.radius_um(), response, first };
                first += cylinder.width();
                Ok(cylinder)
            })
            .collect::<Result<Vec<_>, WaveError>>()?;
        let mut solver = Self {
            wave: *wave,
            tolerance,
            cylinders,
            systems: Vec::new(),
            peak_bytes: need,
            residual: AtomicU64::new(0),
        };
        let fields: &[&'static [usize]] = if normal { &[&[0], &[1]] } else { &[&[0, 1]] };
        solver.systems = fields.iter().map(|f| solver.factorize(f, orders * f.len())).collect();
        Ok(solver)
    }

    /// `G_pq` in scaled amplitudes, rows n of p, columns m of q, column-major.
    fn translation(&self, p: &Cylinder, q: &Cylinder) -> Vec<C64> {
        let [dx, dy] = [p.center_um[0] - q.center_um[0], p.center_um[1] - q.center_um[1]];
        let (top_p, top_q) = (p.top() as i64, q.top() as i64);
        let span = top_p + top_q;
        let hankel = Sequence::hankel(C64::new(self.wave.k_rho() * dx.hypot(dy), 0.0), span as usize);
        let psi = dy.atan2(dx);
        let terms: Vec<(C64, i32)> = (-span..=span)
            .map(|l| {
                let h = hankel.get(l);
                (h.mantissa * C64::from_polar(1.0, l as f64 * psi), h.exponent)
            })
            .collect();
        let scales: Vec<i32> = (-top_p..=top_p).map(|n| p.response.exponent(n)).collect();
        let mut out = Vec::with_capacity(p.width() * q.width());
        for m in -top_q..=top_q {
            let column = q.response.exponent(m);
            for (i, scale) in scales.iter().enumerate() {
                // l = m - n.
                let (mantissa, exponent) = terms[(m + top_p - i as i64 + span) as usize];
                out.push(mantissa * power_of_two(exponent - scale - column));
            }
        }
        out
    }

    /// Assembles `1 - T G` for the given fields and factorizes it in place.
    fn factorize(&self, fields: &'static [usize], size: usize) -> System {
        let mut lu = vec![ZERO; size * size];
        // Columns of one cylinder lie together.
        let mut rest = &mut lu[..];
        let mut columns = Vec::with_capacity(self.cylinders.len());
        for q in &self.cylinders {
            let (mine, others) = rest.split_at_mut(q.width() * fields.len() * size);
            columns.push((q, mine));
            rest = others;
        }
        columns.into_par_iter().for_each(|(q, columns)| {
            for p in &self.cylinders {
                let row = p.first * fields.len();
                if std::ptr::eq(p, q) {
                    for i in 0..q.width() * fields.len() {
                        columns[i * size + row + i] = C64::new(1.0, 0.0);
                    }
                    continue;
                }
                let block = self.translation(p, q);
                let (wp, wq) = (p.width(), q.width());
                for (a, &to) in fields.iter().enumerate() {
                    for (b, &from) in fields.iter().enumerate() {
                        let t: Vec<C64> = (0..wp).map(|i| -p.response.t(i as i64 - p.top() as i64)[to][from]).collect();
                        for m in 0..wq {
                            let start = (b * wq + m) * size + row + a * wp;
                            let out = &mut columns[start..start + wp];
                            for ((o, t), g) in out.iter_mut().zip(&t).zip(&block[m * wp..]) {
                                *o = t * g;
                            }
                        }
                    }
                }
            }
        });
        System { fields, size, lu: Lu::new(lu, size) }
    }

    /// `out += G x` in scaled amplitudes, the same for every field.
    fn couple(&self, fields: usize, x: MatRef<'_, C64>, out: &mut Mat<C64>) {
        for p in &self.cylinders {
            for q in &self.cylinders {
                if std::ptr::eq(p, q) {
                    continue;
                }
                let block = self.translation(p, q);
                let block = MatRef::from_column_major_slice(&block, p.width(), q.width());
                for a in 0..fields {
                    let from = x.subrows(q.first * fields + a * q.width(), q.width());
                    let to = out.as_mut().subrows_mut(p.first * fields + a * p.width(), p.width());
                    matmul(to, Accum::Add, block, from, C64::new(1.0, 0.0), par());
                }
            }
        }
    }

    /// T applied to scaled amplitudes.
    fn respond(&self, system: &System, b: MatRef<'_, C64>) -> Mat<C64> {
        let fields = system.fields;
        let mut out = Mat::zeros(b.nrows(), b.ncols());
        for p in &self.cylinders {
            for i in 0..p.width() {
                let t: M2 = p.response.t(i as i64 - p.top() as i64);
                for (a, &to) in fields.iter().enumerate() {
                    let row = p.first * fields.len() + a * p.width() + i;
                    for c in 0..b.ncols() {
                        out[(row, c)] = fields
                            .iter()
                            .enumerate()
                            .map(|(k, &from)| t[to][from] * b[(p.first * fields.len() + k * p.width() + i, c)])
                            .sum();
                    }
                }
            }
        }
        out
    }

    fn solve_system(&self, system: &System, sources: &[&Source]) -> Result<Solution, WaveError> {
        let fields = system.fields;
        let k_rho = self.wave.k_rho();
        let mut a = Mat::zeros(system.size, sources.len());
        for (c, source) in sources.iter().enumerate() {
            let waves = source.plane_waves(&self.wave, self.extent_um([0.0, 0.0]))?;
            let (e0, h0) = source.axial(&self.wave);
            let parts: Vec<Vec<C64>> =
                self.cylinders.par_iter().map(|p| incident(&waves, k_rho, p.center_um, p.top())).collect();
            for (p, parts) in self.cylinders.iter().zip(parts) {
                for (i, amplitude) in parts.into_iter().enumerate() {
                    let scaled = amplitude * power_of_two(-p.response.exponent(i as i64 - p.top() as i64));
                    for (k, &field) in fields.iter().enumerate() {
                        a[(p.first * fields.len() + k * p.width() + i, c)] = scaled * [e0, h0][field];
                    }
                }
            }
        }
        let rhs = self.respond(system, a.as_ref());
        let mut x = rhs.clone();
        system.solve(&mut x);
        let mut exciting = Mat::zeros(0, 0);
        let mut residual = f64::INFINITY;
        // Solve again with the residual as right-hand side, if that helps.
        for round in 0..2 {
            exciting = a.clone();
            self.couple(fields.len(), x.as_ref(), &mut exciting);
            let mut rest = self.respond(system, exciting.as_ref());
            rest -= &x;
            residual = (0..rest.ncols()).map(|c| norm(rest.col(c)) / norm(rhs.col(c))).fold(0.0, f64::max);
            if round == 1 || residual < 1e-2 * self.tolerance {
                break;
            }
            system.solve(&mut rest);
            x += &rest;
        }
        self.residual.fetch_max(residual.to_bits(), Ordering::Relaxed);
        if residual.is_nan() || residual > self.tolerance {
            return Err(WaveError::NotConverged { residual, iterations: 2 });
        }
        Ok(Solution { incident: a, exciting, x })
    }

    /// For each cylinder, the part of its scattered amplitudes (at the wall, squared) in the last three
    /// orders, times twice the number of orders beyond the size parameter.
    ///
    /// Omitted orders act on the far field only through the neighbors, that is twice, hence the square; the
    /// number counts the pairs of orders in a gap. Measured on pairs with gaps of 0.003 to 0.3 radii, sizes 1
    /// to 60, glass and metal: with [`first_order`]'s sum over the omitted orders this bounds the far field's
    /// relative error for all errors below 1e-3.
    fn tails(&self, sources: &[Source]) -> Result<Vec<f64>, WaveError> {
        let mut tails = vec![0.0f64; self.cylinders.len()];
        for system in &self.systems {
            let chosen: Vec<&Source> = sources.iter().filter(|s| system.serves(s.pol)).collect();
            let x = self.solve_system(system, &chosen)?.x;
            let count = system.fields.len();
            for c in 0..x.ncols() {
                let all = norm(x.col(c)).powi(2);
                for (p, tail) in self.cylinders.iter().zip(&mut tails) {
                    let mut sum = 0.0;
                    for a in 0..count {
                        let start = p.first * count + a * p.width();
                        for i in (0..3).chain(p.width().max(6) - 3..p.width()) {
                            sum += x[(start + i, c)].norm_sqr();
                        }
                    }
                    let evanescent = p.top() as f64 - self.wave.k_rho() * p.radius_um;
                    *tail = tail.max(2.0 * evanescent.max(1.0) * sum / all);
                }
            }
        }
        Ok(tails)
    }

    /// Radius about `center_um` that contains all cylinders [um].
    fn extent_um(&self, center_um: [f64; 2]) -> f64 {
        self.cylinders
            .iter()
            .map(|c| (c.center_um[0] - center_um[0]).hypot(c.center_um[1] - center_um[1]) + c.radius_um)
            .fold(0.0, f64::max)
    }

    /// Azimuths on which the trapezoidal rule integrates |F|^2 exactly.
    fn quadrature_azimuths(&self) -> usize {
        let n = self.cylinders.len() as f64;
        let mid = [0, 1].map(|i| self.cylinders.iter().map(|c| c.center_um[i]).sum::<f64>() / n);
        2 * order_for(self.wave.k_rho() * self.extent_um(mid), 1e-18) + 1
    }

    /// Far-field amplitudes `[field][azimuth][source]` at `size` azimuths.
    fn far_field(&self, system: &System, x: &Mat<C64>, size: usize) -> Vec<Mat<C64>> {
        let count = system.fields.len();
        let k_rho = self.wave.k_rho();
        let mut out = vec![Mat::zeros(size, x.ncols()); count];
        let roots: Vec<C64> = (0..size).map(|j| C64::from_polar(1.0, TAU * j as f64 / size as f64)).collect();
        for p in &self.cylinders {
            let [px, py] = p.center_um;
            let phases: Vec<C64> = roots
                .iter()
                .map(|u| C64::from_polar(1.0 / self.wave.theta_i.cos(), -k_rho * (px * u.re + py * u.im)))
                .collect();
            let mut waves = Mat::zeros(size, p.width());
            for i in 0..p.width() {
                let n = i as i64 - p.top() as i64;
                let scale = minus_i_power(n) * power_of_two(-p.response.exponent(n));
                let turn = n.rem_euclid(size as i64) as usize;
                let mut at = 0;
                for (w, phase) in waves.col_as_slice_mut(i).iter_mut().zip(&phases) {
                    *w = scale * phase * roots[at];
                    at += turn;
                    if at >= size {
                        at -= size;
                    }
                }
            }
            for a in 0..count {
                let part = x.as_ref().subrows(p.first * count + a * p.width(), p.width());
                matmul(out[a].as_mut(), Accum::Add, waves.as_ref(), part, C64::new(1.0, 0.0), par());
            }
        }
        out
    }

    fn batch(&self, system: &System, sources: &[&Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let count = system.fields.len();
        let (k0, cos) = (self.wave.k0(), self.wave.theta_i.cos());
        let solution = self.solve_system(system, sources)?;
        let far = self.far_field(system, &solution.x, n_phi_out);
        let fine = self.far_field(system, &solution.x, self.quadrature_azimuths());
        let zero = vec![ZERO; n_phi_out];
        let column = |c: usize, field: usize| match system.fields.iter().position(|f| *f == field) {
            Some(a) => (0..n_phi_out).map(|j| far[a][(j, c)]).collect(),
            None => zero.clone(),
        };
        Ok((0..sources.len())
            .map(|c| {
                let intensity: f64 = fine.iter().map(|f| norm(f.col(c)).powi(2)).sum();
                let n_fine = fine[0].nrows() as f64;
                // The optical theorem: the forward amplitudes of the source's plane waves, each times its
                // conjugate amplitude, add up to the product of all incident and scattered amplitudes, since
                // a plane wave's amplitudes are the conjugate of the far field's phases in its forward
                // direction.
                let forward: f64 =
                    (0..system.size).map(|r| (solution.incident[(r, c)].conj() * solution.x[(r, c)]).re).sum();
                let mut c_abs_um = 0.0;
                for p in &self.cylinders {
                    for i in 0..p.width() {
                        let mut b = [ZERO; 2];
                        for (a, &field) in system.fields.iter().enumerate() {
                            b[field] = solution.exciting[(p.first * count + a * p.width() + i, c)];
                        }
                        c_abs_um += p.response.absorbed_um(i as i64 - p.top() as i64, b);
                    }
                }
                Scattered {
                    f_u: column(c, 0),
                    f_phi: column(c, 1),
                    c_sca_um: 4.0 / (k0 * n_fine) * intensity,
                    c_abs_um,
                    c_ext_um: -4.0 / (k0 * cos * cos) * forward,
                }
            })
            .collect())
    }
}

impl WaveSolver for MultipoleSolver {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let mut out: Vec<Option<Scattered>> = vec![None; sources.len()];
        for system in &self.systems {
            let chosen: Vec<usize> = (0..sources.len()).filter(|&i| system.serves(sources[i].pol)).collect();
            for part in chosen.chunks(BATCH) {
                let batch: Vec<&Source> = part.iter().map(|&i| &sources[i]).collect();
                for (&i, done) in part.iter().zip(self.batch(system, &batch, n_phi_out)?) {
                    out[i] = Some(done);
                }
            }
        }
        Ok(out.into_iter().flatten().collect())
    }

    fn stats(&self) -> SolverStats {
        SolverStats {
            unknowns: self.systems.iter().map(|s| s.size).max().unwrap_or(0),
            residual: f64::from_bits(self.residual.load(Ordering::Relaxed)),
            peak_bytes: self.peak_bytes,
        }
    }
}

impl System {
    /// Whether sources of this polarization involve the fields of this system.
    fn serves(&self, pol: Polarization) -> bool {
        let field = match pol {
            Polarization::Tm => 0,
            Polarization::Te => 1,
        };
        self.fields.contains(&field)
    }

    fn solve(&self, x: &mut Mat<C64>) {
        self.lu.solve(x.as_mut());
    }
}

fn norm(column: faer::ColRef<'_, C64>) -> f64 {
    column.norm_l2()
}

fn distance(p: &Circle, q: &Circle) -> f64 {
    (p.center_um[0] - q.center_um[0]).hypot(p.center_um[1] - q.center_um[1])
}

/// First guess of the highest order about cylinder i, and the sum of the omitted squares relative to the last
/// ones, `1 / (1 - r^2)`.
///
/// Charges in the walls' gap image each other: a point at distance t from the center of the neighbor (radius
/// b) has its image in this cylinder at `a^2 / (D - t)` from its center, weaker by the static reflection
/// `(eps - 1)/(eps + 1)`, and so on back and forth. The image at s causes amplitudes at the wall that fall as
/// (s/a)^n beyond the size parameter. r is s/a at the limit point of the images.
fn first_order(circles: &[Circle], i: usize, wave: &Wave, tolerance: f64) -> (usize, f64) {
    let weakening = |c: &Circle| {
        let eps = c.layers[0].1 * c.layers[0].1;
        ((eps - 1.0) / (eps + 1.0)).norm().min(0.999)
    };
    let a = circles[i].radius_um();
    let x = wave.k_rho() * a;
    let (mut max_need, mut closest) = (0.0f64, 0.0f64);
    for (j, q) in circles.iter().enumerate() {
        if j == i {
            continue;
        }
        let (d, b) = (distance(&circles[i], q), q.radius_um());
        let (mut t, mut weight) = (0.0, weakening(q));
        loop {
            let s = a * a / (d - t);
            let need = (weight / tolerance.sqrt()).ln();
            if need <= 0.0 {
                break;
            }
            max_need = max_need.max(need / (a / s).ln());
            t = b * b / (d - s);
            weight *= weakening(&circles[i]) * weakening(q);
        }
        let half = ((d * d - a * a - b * b).powi(2) - 4.0 * a * a * b * b).sqrt() / (2.0 * d);
        closest = closest.max(((d * d + a * a - b * b) / (2.0 * d) - half) / a);
    }
    let alone = order_for(x, (1e-2 * tolerance).max(1e-18));
    let narrow = 1.0 / (1.0 - closest * closest);
    (alone.max(order_for(x, tolerance.max(1e-18)) + max_need.min(1e4) as usize), narrow)
}
