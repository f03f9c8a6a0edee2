//! Solver for many bodies: each is solved once by itself, its outside response is compressed on its outline,
//! and the small responses are coupled.
//!
//! A body's boundary equations ([`system`](crate::boundary::system)) map the fields that arrive from outside
//! to the total fields on its wall. Between bodies only the exterior's Green function acts, with a rank
//! little above `2 k_rho r`. Each body is reduced to a [`skeleton`](crate::many::skeleton) of its outer wall,
//! accurate for fields at the others, and to the matrix T from the values that its sites receive to the
//! strengths that they radiate. The [`coupling`](crate::many::coupling) of all is a dense system that is
//! factorized once; directions, beams and polarizations are its right-hand sides. Equal bodies share their
//! boundary equations, wherever they lie.
//!
//! The coupled system is factorized whole, or for many bodies by merging groups of them
//! ([`hierarchy`](crate::many::hierarchy)).

use crate::boundary::entries::{E, H};
use crate::boundary::extinction::Probes;
use crate::boundary::kernel::{Medium, MediumKernel};
use crate::boundary::nystrom::harvest;
use crate::boundary::system::BoundarySystem;
use crate::boundary::walls::{check_overlap, trace_walls};
use crate::many::coupling::{Coupling, Factors, SINGLE, product};
use crate::many::hierarchy::{Factored, Hierarchy, Leaf};
use crate::many::placement::{Frame, at_home, bounds, candidates, same};
use crate::many::skeleton::{Exterior, Site, Skeleton, circle};
use crate::scene::curve::{CurvePoint, Resolution};
use crate::{Body, C64, PlaneWave, Polarization, Scattered, SolverStats, Source, Wave, WaveError, WaveSolver};
use faer::Accum;
use plywave_runs::memory;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Tolerance of the skeletons over that of the far field. Errors grow by the strength of multiple scattering:
/// a few hundredfold for a ply of clear fibers of 15 um at 0.4 um, 0.2 um apart. One more digit costs about
/// 5 % more sites there.
const SKELETON: f64 = 2e-3;
/// Tolerance of groups of bodies over that of the skeletons. The error of light between bodies is this times
/// the coefficients of all levels of groups above, times the strength of multiple scattering: the residual is
/// proportional to it (19 and 37 fibers of 15 um at 0.4 um, over three decades) and grows with the number of
/// fibers. One more digit takes about 4 % more time and memory. With these five digits, the residual is 4e-8
/// for 37 fibers and 9e-7 for 200.
const GROUPS: f64 = 1e-5;
/// Maximum size of all parts' systems that are held at once [bytes]; larger ones are held one at a time.
const HELD: f64 = 2e9;
/// Tolerance of the coupled system's residual over that of the far field.
const COUPLED: f64 = 1e-2;
/// Minimum guaranteed tolerance: at 1e-8 the error of the tests' crowd is 1e-7.
pub(crate) const MIN_TOLERANCE: f64 = 2e-7;
/// Sources whose fields on all walls are held at once.
const BATCH: usize = 32;

/// A body in the scene.
struct Member {
    /// Index of its boundary system.
    shape: usize,
    /// Nodes of its outer wall in the scene.
    nodes: Vec<CurvePoint>,
    /// Arc length of each node [um].
    weights: Vec<f64>,
    skeleton: Skeleton,
}

/// Coupling of the bodies.
enum Coupled {
    /// A single body.
    Alone,
    Whole {
        /// T, `[part][body]`.
        transfers: Vec<Vec<Vec<C64>>>,
        /// `[part]`.
        factors: Vec<Factors>,
    },
    Merged {
        groups: Hierarchy,
        /// Whether all parts are held, or the last one used.
        all: bool,
        /// `[part]`.
        parts: Mutex<Vec<Option<Arc<Factored>>>>,
    },
}

/// The compressed solver: bodies prepared for one [`Wave`].
pub struct CompressedSolver {
    wave: Wave,
    tolerance: f64,
    kernel: MediumKernel,
    shapes: Vec<BoundarySystem>,
    members: Vec<Member>,
    probes: Probes,
    /// Components of the parts (those of `BoundarySystem`).
    parts: Vec<&'static [usize]>,
    coupled: Coupled,
    peak_bytes: usize,
    /// Bits of the largest residual so far.
    residual: AtomicU64,
}

impl CompressedSolver {
    /// Prepares `bodies` (any outline, nested to any depth, lossy or not) for far fields with an error of
    /// about `tolerance` relative to their largest value.
    ///
    /// # Errors
    /// Bad numbers and shapes, walls that overlap, a tolerance out of reach, a system larger than the free
    /// memory.
    pub fn new(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        Self::with_skeletons(bodies, wave, tolerance, SKELETON * tolerance, false)
    }

    /// The same with the coupled system solved by merging groups of bodies: time grows as their number to the
    /// power 1.5, not 3.
    ///
    /// # Errors
    /// The errors of [`new`](Self::new).
    pub fn hierarchical(bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        Self::with_skeletons(bodies, wave, tolerance, SKELETON * tolerance, true)
    }

    /// Either solver, with a separate tolerance for the skeletons.
    pub(crate) fn with_skeletons(
        bodies: &[Body],
        wave: &Wave,
        tolerance: f64,
        skeleton_tolerance: f64,
        merged: bool,
    ) -> Result<Self, WaveError> {
        if tolerance > 0.0 && tolerance < MIN_TOLERANCE {
            return Err(WaveError::Unreachable { method: "compressed", asked: tolerance, reachable: MIN_TOLERANCE });
        }
        if bodies.is_empty() || !(tolerance > 0.0 && tolerance < 1.0) {
            // The boundary equations report errors.
            BoundarySystem::new(bodies, wave, tolerance)?;
        }
        let resolution = Resolution::new(bodies, tolerance);
        let walls = trace_walls(bodies, wave, &resolution)?.1;
        if bodies.len() > 1 {
            // A check before any work: a skeleton has more sites than waves that fit around the wall, k_rho
            // length / pi.
            let length: f64 = walls
                .iter()
                .filter(|w| w.outside == 0)
                .map(|w| w.curve.step() * w.curve.nodes.iter().map(|p| p.speed).sum::<f64>())
                .sum();
            let fields = if wave.kz() == 0.0 { 1.0 } else { 2.0 };
            let unknowns = fields * wave.k_rho() * length / PI;
            if merged {
                // The bodies' responses alone.
                let own = unknowns * unknowns / bodies.len() as f64;
                check_free(unknowns, 16.0 * own)?;
            } else {
                check_memory(unknowns, 2.0 / fields, tolerance)?;
            }
        }
        check_overlap(&walls)?;
        drop(walls);
        let mut homes: Vec<Body> = Vec::new();
        let mut shapes = Vec::new();
        let mut shape_of = Vec::new();
        for body in bodies {
            let home = at_home(body);
            let known = homes.iter().position(|h| same(h, &home));
            shape_of.push(known.unwrap_or(shapes.len()));
            if known.is_none() {
                let own = std::slice::from_ref(&home);
                shapes.push(BoundarySystem::build(own, wave, tolerance, &resolution, true)?);
                homes.push(home);
            }
        }
        let parts: Vec<&'static [usize]> = shapes[0].parts().collect();
        let frames: Vec<Frame> = bodies.iter().map(Frame::new).collect();
        let nodes: Vec<Vec<CurvePoint>> = frames
            .iter()
            .zip(&shape_of)
            .map(|(frame, &s)| shapes[s].nodes()[..shapes[s].outer_nodes()].iter().map(|p| frame.place(p)).collect())
            .collect();
        let (low, high) = bounds(nodes.iter().flatten());
        // Circles of tests reach out of the box of all walls by less than its size.
        let reach = 2.5 * (high[0] - low[0]).hypot(high[1] - low[1]) + wave.lambda_um / wave.theta_i.cos();
        let kernel = MediumKernel::new(Medium { kappa: C64::new(wave.k_rho(), 0.0), eps: C64::ONE }, reach);
        let candidates = (0..bodies.len())
            .into_par_iter()
            .map(|b| {
                let curve = &shapes[shape_of[b]].walls()[0].curve;
                candidates(b, &frames, &nodes, curve, skeleton_tolerance.min(tolerance))
            })
            .collect::<Result<Vec<_>, WaveError>>()?;
        let k_rho = wave.k_rho();
        let skeletons: Vec<Skeleton> = (0..bodies.len())
            .into_par_iter()
            .map(|b| {
                let (mut tests, center, radius) = circle(&candidates[b].points, k_rho, skeleton_tolerance);
                for (_, other) in candidates.iter().enumerate().filter(|(c, _)| *c != b) {
                    for (point, &scale) in other.points.iter().zip(&other.scales) {
                        if (point.at[0] - center[0]).hypot(point.at[1] - center[1]) <= radius {
                            tests.push(Site { point: *point, scale });
                        }
                    }
                }
                Skeleton::new(&kernel, k_rho, &candidates[b], &tests, wave.kz() != 0.0, skeleton_tolerance, b as u64)
            })
            .collect();
        drop(candidates);
        let members: Vec<Member> = shape_of
            .iter()
            .zip(nodes)
            .zip(skeletons)
            .map(|((&shape, nodes), skeleton)| Member {
                shape,
                nodes,
                weights: shapes[shape].outer_weights(),
                skeleton,
            })
            .collect();
        let walls: Vec<(&[CurvePoint], &[f64])> = members.iter().map(|m| (&m.nodes[..], &m.weights[..])).collect();
        let probes = Probes::new(wave, &walls, tolerance);
        let mut solver = Self {
            wave: *wave,
            tolerance,
            kernel,
            shapes,
            members,
            probes,
            parts,
            coupled: Coupled::Alone,
            peak_bytes: 0,
            residual: AtomicU64::new(0),
        };
        if merged && bodies.len() > 1 {
            solver.merge(skeleton_tolerance)?;
        } else {
            solver.prepare()?;
        }
        Ok(solver)
    }

    /// Fields of a part: 1 (e or h) or 2.
    fn fields(&self) -> usize {
        self.parts[0].len() / 2
    }

    fn coupling(&self) -> Coupling<'_> {
        let sites = self.members.iter().map(|m| m.skeleton.sites.as_slice()).collect();
        Coupling { kernel: &self.kernel, k_rho: self.wave.k_rho(), sites }
    }

    fn exterior(&self) -> Exterior<'_> {
        Exterior { kernel: &self.kernel, k_rho: self.wave.k_rho() }
    }

    /// Prepares transfers and factors, after a check of their memory.
    fn prepare(&mut self) -> Result<(), WaveError> {
        let fields = self.fields();
        let counts: Vec<f64> = self.members.iter().map(|m| (fields * m.skeleton.sites.len()) as f64).collect();
        let unknowns: f64 = counts.iter().sum();
        let single = self.tolerance >= SINGLE;
        let need = if self.members.len() > 1 {
            let transfers = 16.0 * self.parts.len() as f64 * counts.iter().map(|k| k * k).sum::<f64>();
            transfers + check_memory(unknowns, self.parts.len() as f64, self.tolerance)?
        } else {
            0.0
        };
        self.peak_bytes = need as usize + self.held_bytes();
        if self.members.len() == 1 {
            return Ok(());
        }
        let all: Vec<(usize, usize)> =
            (0..self.parts.len()).flat_map(|p| (0..self.members.len()).map(move |b| (p, b))).collect();
        let mut made = all.into_par_iter().map(|(part, b)| self.transfer(part, b)).collect::<Vec<_>>().into_iter();
        let transfers: Vec<Vec<Vec<C64>>> =
            (0..self.parts.len()).map(|_| made.by_ref().take(self.members.len()).collect()).collect();
        let factors = self.coupling().factorize(&transfers, fields, single);
        self.coupled = Coupled::Whole { transfers, factors };
        Ok(())
    }

    /// Memory of boundary equations and skeletons [bytes].
    fn held_bytes(&self) -> usize {
        let shapes: usize = self.shapes.iter().map(|s| s.peak_bytes()).sum();
        shapes
            + self
                .members
                .iter()
                .map(|m| m.skeleton.value.bytes() + m.skeleton.normal.bytes() + m.skeleton.tangential.bytes())
                .sum::<usize>()
    }

    /// Prepares groups of bodies and their responses, after a check of their memory.
    fn merge(&mut self, tolerance: f64) -> Result<(), WaveError> {
        let leaves: Vec<Leaf<'_>> = self
            .members
            .iter()
            .map(|m| {
                let (low, high) = bounds(m.nodes.iter());
                let center = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
                let off = |p: &CurvePoint| (p.at[0] - center[0]).hypot(p.at[1] - center[1]);
                Leaf { sites: &m.skeleton.sites, center, radius: m.nodes.iter().map(off).fold(0.0, f64::max) }
            })
            .collect();
        let groups = Hierarchy::plan(&leaves, self.exterior(), (GROUPS * tolerance).max(1e-12));
        drop(leaves);
        let (fields, count) = (self.fields(), self.parts.len());
        let bytes = groups.bytes(fields);
        let all = count as f64 * bytes.part <= HELD;
        let stored = if all { count as f64 * bytes.part } else { bytes.part };
        let sites: usize = self.members.iter().map(|m| m.skeleton.sites.len()).sum();
        check_free((fields * sites) as f64, stored + bytes.work)?;
        self.peak_bytes = (bytes.plan + stored + bytes.work) as usize + self.held_bytes();
        self.coupled = Coupled::Merged { groups, all, parts: Mutex::new(vec![None; count]) };
        // The rest is computed when a source needs it.
        (0..if all { count } else { 1 }).for_each(|part| drop(self.factored(part)));
        Ok(())
    }

    /// The merged system of a part: held, or computed anew to replace another part's.
    fn factored(&self, part: usize) -> Option<Arc<Factored>> {
        let Coupled::Merged { groups, all, parts } = &self.coupled else { return None };
        {
            let mut parts = parts.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(held) = &parts[part] {
                return Some(held.clone());
            }
            if !all {
                parts.fill(None);
            }
        }
        // The lock is open meanwhile, as threads that wait for this one's work may need the same system.
        let made = Arc::new(groups.factorize(self.fields(), self.exterior(), &|b| self.transfer(part, b)));
        parts.lock().unwrap_or_else(PoisonError::into_inner)[part] = Some(made.clone());
        Some(made)
    }

    /// T of a body: strengths radiated by its sites for a unit received at each.
    fn transfer(&self, part: usize, b: usize) -> Vec<C64> {
        let size = self.fields() * self.members[b].skeleton.sites.len();
        let (densities, _) = self.respond(part, b, None, size);
        self.radiate(part, b, &densities, size)
    }

    /// Densities of a part on all walls of a body (components side by side, node after node, column after
    /// column) for the values that its sites receive (default: a unit at each site in turn), and the
    /// residual.
    fn respond(&self, part: usize, b: usize, received: Option<&[C64]>, columns: usize) -> (Vec<C64>, f64) {
        let member = &self.members[b];
        let system = &self.shapes[member.shape];
        let components = self.parts[part];
        let c = components.len();
        let fields = c / 2;
        let k = member.skeleton.sites.len();
        let (n, stride) = (member.nodes.len(), system.nodes().len());
        // Transposed coefficients: node rows. (received is k x (fields columns).)
        let spread = |coefficients: &[C64]| -> Vec<C64> {
            let mut out = vec![C64::ZERO; n * fields * columns];
            let Some(received) = received else {
                // Column (field, site) has the site's coefficients in its own field.
                for (column, out) in out.chunks_mut(fields * n).enumerate() {
                    let (field, site) = (column / k, column % k);
                    for (out, values) in out[field * n..][..n].iter_mut().zip(coefficients.chunks(k)) {
                        *out = values[site];
                    }
                }
                return out;
            };
            faer::linalg::matmul::matmul(
                faer::MatMut::from_column_major_slice_mut(&mut out, n, fields * columns),
                Accum::Replace,
                faer::MatRef::from_column_major_slice(coefficients, k, n).transpose(),
                faer::MatRef::from_column_major_slice(received, k, fields * columns),
                C64::ONE,
                faer::Par::Seq,
            );
            out
        };
        let value = spread(&member.skeleton.value.wide());
        let normal = spread(&member.skeleton.normal.wide());
        let tangential = if fields == 2 { spread(&member.skeleton.tangential.wide()) } else { Vec::new() };
        let (k0, kz, k_rho) = (self.wave.k0(), self.wave.kz(), self.wave.k_rho());
        let mut rhs = vec![C64::ZERO; c * stride * columns];
        for (column, rhs) in rhs.chunks_mut(c * stride).enumerate() {
            for (j, out) in rhs.chunks_mut(c).take(n).enumerate() {
                let at = |field: usize| (fields * column + field) * n + j;
                for field in 0..fields {
                    out[2 * field] = value[at(field)];
                    out[2 * field + 1] = normal[at(field)] * (k0 / k_rho);
                }
                if fields == 2 {
                    out[1] += tangential[at(1)] * (kz / k_rho);
                    out[3] -= tangential[at(0)] * (kz / k_rho);
                }
            }
        }
        let residual = system.solve(part, &mut rhs, columns);
        (rhs, residual)
    }

    /// Strengths of a body's sites that radiate the same field as its densities.
    fn radiate(&self, part: usize, b: usize, densities: &[C64], columns: usize) -> Vec<C64> {
        let member = &self.members[b];
        let c = self.parts[part].len();
        let fields = c / 2;
        let k = member.skeleton.sites.len();
        let n = member.nodes.len();
        let stride = self.shapes[member.shape].nodes().len();
        let (k0, kz, k_rho) = (self.wave.k0(), self.wave.kz(), self.wave.k_rho());
        let mut out = vec![C64::ZERO; k * fields * columns];
        let mut moment = vec![C64::ZERO; n * fields * columns];
        let mut gather = |coefficients: &[C64], of: &dyn Fn(&[C64], usize) -> C64| {
            for (column, moment) in moment.chunks_mut(fields * n).enumerate() {
                let nodes = densities[column * c * stride..].chunks(c);
                for (j, (u, w)) in nodes.zip(&member.weights).enumerate() {
                    for field in 0..fields {
                        moment[field * n + j] = of(u, field) * *w;
                    }
                }
            }
            product(&mut out, Accum::Add, coefficients, k, &moment, n, C64::ONE);
        };
        // Monopoles -(k_rho^2/k_0) P, normal dipoles e, tangential dipoles -(k_z/k_0) h; with h, -e for e, h.
        gather(&member.skeleton.value.wide(), &|u, field| u[2 * field + 1] * (-k_rho * k_rho / k0));
        gather(&member.skeleton.normal.wide(), &|u, field| u[2 * field] * k_rho);
        if fields == 2 {
            gather(&member.skeleton.tangential.wide(), &|u, field| {
                if field == 0 { u[H] * (-k_rho * kz / k0) } else { u[E] * (k_rho * kz / k0) }
            });
        }
        out
    }

    /// Values that the sites of a body receive from plane waves of unit axial field.
    fn external(&self, b: usize, waves: &[PlaneWave]) -> Vec<C64> {
        let k_rho = self.wave.k_rho();
        let directions: Vec<(f64, f64)> = waves.iter().map(|w| w.phi_i.sin_cos()).collect();
        let sites = &self.members[b].skeleton.sites;
        sites
            .iter()
            .map(|site| {
                let ([x, y], [nx, ny]) = (site.point.at, site.point.normal);
                let mut sum = C64::ZERO;
                for (w, (sin, cos)) in waves.iter().zip(&directions) {
                    let phase = C64::from_polar(site.scale, -k_rho * (x * cos + y * sin));
                    // d_n / k_rho gives -i omega.n.
                    sum += w.amplitude * phase * (1.0 + nx * cos + ny * sin);
                }
                C64::new(sum.im, -sum.re)
            })
            .collect()
    }

    fn scatter_batch(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let extent = self.members.iter().flat_map(|m| &m.nodes).map(|p| p.at[0].hypot(p.at[1])).fold(0.0, f64::max);
        let waves = sources
            .iter()
            .map(|s| Ok((s.pol, s.plane_waves(&self.wave, extent)?)))
            .collect::<Result<Vec<(Polarization, Vec<PlaneWave>)>, WaveError>>()?;
        let fields = self.fields();
        // At normal incidence only sources of its polarization drive a part.
        let columns_of = |part: usize| -> Vec<usize> {
            let own = |s: &usize| fields == 2 || (sources[*s].pol == Polarization::Tm) == (self.parts[part][0] == E);
            (0..sources.len()).filter(own).collect()
        };
        let outer: usize = self.members.iter().map(|m| m.nodes.len()).sum();
        // The first part is computed before fields on walls take memory.
        drop((0..self.parts.len()).find(|&p| !columns_of(p).is_empty()).and_then(|p| self.factored(p)));
        let mut total = vec![C64::ZERO; 4 * outer * sources.len()];
        let mut residual: f64 = 0.0;
        for (part, components) in self.parts.iter().enumerate() {
            let columns = columns_of(part);
            if columns.is_empty() {
                continue;
            }
            let mut received: Vec<Vec<C64>> = (0..self.members.len())
                .into_par_iter()
                .map(|b| {
                    let k = self.members[b].skeleton.sites.len();
                    let mut out = vec![C64::ZERO; fields * k * columns.len()];
                    for (&s, out) in columns.iter().zip(out.chunks_mut(fields * k)) {
                        let (e, h) = sources[s].axial(&self.wave);
                        let values = self.external(b, &waves[s].1);
                        let (at, axial) = match sources[s].pol {
                            Polarization::Tm => (0, e),
                            Polarization::Te => ((fields - 1) * k, h),
                        };
                        for (out, value) in out[at..at + k].iter_mut().zip(values) {
                            *out = value * axial;
                        }
                    }
                    out
                })
                .collect();
            let mut external = Vec::new();
            match &self.coupled {
                Coupled::Alone => (),
                Coupled::Whole { transfers, factors } => {
                    let goal = COUPLED * self.tolerance;
                    let (factors, transfers) = (&factors[part], &transfers[part]);
                    let (reached, iterations) = self.coupling().solve(factors, transfers, fields, &mut received, goal);
                    if reached.is_nan() || reached > 10.0 * goal {
                        return Err(WaveError::NotConverged { residual: reached, iterations });
                    }
                    residual = residual.max(reached);
                }
                Coupled::Merged { groups, .. } => {
                    external = received.clone();
                    if let Some(factored) = self.factored(part) {
                        groups.solve(&factored, fields, self.exterior(), &mut received);
                    }
                }
            }
            let answers: Vec<(Vec<C64>, f64)> = received
                .par_iter()
                .enumerate()
                .map(|(b, received)| self.respond(part, b, Some(received), columns.len()))
                .collect();
            if !external.is_empty() {
                let strengths: Vec<Vec<C64>> = answers
                    .par_iter()
                    .enumerate()
                    .map(|(b, (densities, _))| self.radiate(part, b, densities, columns.len()))
                    .collect();
                residual = residual.max(self.coupling().witness(&strengths, &received, &external, fields));
            }
            let c = components.len();
            let mut first = 0;
            for (member, (densities, own)) in self.members.iter().zip(&answers) {
                residual = residual.max(*own);
                let n = member.nodes.len();
                let stride = self.shapes[member.shape].nodes().len();
                for (&s, densities) in columns.iter().zip(densities.chunks(c * stride)) {
                    let out = &mut total[4 * (outer * s + first)..][..4 * n];
                    for (out, values) in out.chunks_mut(4).zip(densities.chunks(c)) {
                        for (&to, value) in components.iter().zip(values) {
                            out[to] = *value;
                        }
                    }
                }
                first += n;
            }
        }
        // Residuals are not negative, so the order of their bits is theirs.
        self.residual.fetch_max(residual.to_bits(), Ordering::Relaxed);
        if residual.is_nan() || residual > 0.1 * self.tolerance {
            return Err(WaveError::NotConverged { residual, iterations: 0 });
        }
        let nodes: Vec<CurvePoint> = self.members.iter().flat_map(|m| m.nodes.iter().copied()).collect();
        let weights: Vec<f64> = self.members.iter().flat_map(|m| m.weights.iter().copied()).collect();
        self.probes.check(&nodes, &weights, &total, outer, waves.iter())?;
        Ok(harvest(&self.wave, self.tolerance, &nodes, &weights, &total, outer, &waves, n_phi_out))
    }

    /// Number of different bodies.
    #[cfg(test)]
    pub(crate) fn systems(&self) -> usize {
        self.shapes.len()
    }

    /// Sites of each body.
    #[cfg(test)]
    pub(crate) fn ranks(&self) -> Vec<usize> {
        self.members.iter().map(|m| m.skeleton.sites.len()).collect()
    }
}

/// Memory of the coupled systems [bytes].
///
/// # Errors
/// If it exceeds the free memory.
fn check_memory(unknowns: f64, systems: f64, tolerance: f64) -> Result<f64, WaveError> {
    let bytes = if tolerance >= SINGLE { 8.0 } else { 16.0 };
    // Right-hand sides, blocks under way and factorization come on top.
    let need = 1.05 * systems * unknowns * unknowns * bytes + 64e6;
    check_free(unknowns, need)?;
    Ok(need)
}

/// # Errors
/// If `need` bytes exceed the free memory.
fn check_free(unknowns: f64, need: f64) -> Result<(), WaveError> {
    if let Some(have) = memory::available_bytes().map(|b| b as f64).filter(|have| need > *have) {
        let gib = 1.0 / (1u64 << 30) as f64;
        return Err(WaveError::TooLarge { unknowns: unknowns as usize, need_gib: need * gib, have_gib: have * gib });
    }
    Ok(())
}

impl WaveSolver for CompressedSolver {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        // One polarization after the other: at normal incidence each has its own system, and not all may be
        // held at once.
        let mut order: Vec<usize> = (0..sources.len()).collect();
        order.sort_by_key(|&s| sources[s].pol == Polarization::Te);
        let together = |&a: &usize, &b: &usize| self.fields() == 2 || sources[a].pol == sources[b].pol;
        let mut all: Vec<Option<Scattered>> = vec![None; sources.len()];
        for batch in order.chunk_by(together).flat_map(|some| some.chunks(BATCH)) {
            let own: Vec<Source> = batch.iter().map(|&s| sources[s]).collect();
            for (&s, scattered) in batch.iter().zip(self.scatter_batch(&own, n_phi_out)?) {
                all[s] = Some(scattered);
            }
        }
        Ok(all.into_iter().flatten().collect())
    }

    fn stats(&self) -> SolverStats {
        let sites: usize = self.members.iter().map(|m| m.skeleton.sites.len()).sum();
        let own = self.shapes.iter().map(|s| s.unknowns()).max().unwrap_or(0);
        SolverStats {
            unknowns: if matches!(self.coupled, Coupled::Alone) { own } else { self.fields() * sites },
            residual: f64::from_bits(self.residual.load(Ordering::Relaxed)),
            peak_bytes: self.peak_bytes,
        }
    }
}
