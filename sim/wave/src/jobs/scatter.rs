//! From a scene to its far fields: choice of the solver, slices of equal wavelength and latitude, checks of
//! the results, report.
//!
//! A slice is solved by one factorization for all its sources. Slices run in parallel as far as memory
//! allows; for a single slice the solver's threads run in parallel. No result is scaled to make powers add
//! up: a case whose ledger does not balance is an error.

use crate::jobs::choice::{by_shape, candidates, least_length};
use crate::scene::description::degrees;
use crate::scene::visible::{EmptySolver, visible};
use crate::{
    Body, C64, CompressedSolver, Method, MieSolver, MultipoleSolver, NystromSolver, Polarization, Scattered, Scene,
    Source, Wave, WaveError, WaveSolver,
};
use plywave_runs::RunError;
use plywave_runs::memory;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards, Values};
use serde::{Serialize, Serializer};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Number of sources per call of a solver: enough for block solves, few enough for progress reports.
const SOURCES: usize = 256;

/// Error of widths due to rounding of fields of size 1, in units of the length of all walls.
const ROUNDING: f64 = 1e-12;
/// Tolerances at which a method is tried, relative to the requested one: if powers do not add up within it, a
/// finer solution is computed. Compression reaches the second one at the default tolerance.
const FINER: [f64; 3] = [1.0, 0.21, 0.02];

/// Scattering of one source.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// Vacuum wavelength [um].
    pub lambda_um: f64,
    /// Latitude of incidence [rad]; degrees in files.
    #[serde(rename = "theta_i_deg", serialize_with = "in_degrees")]
    pub theta_i: f64,
    /// Azimuth from which the light comes [rad]; degrees in files.
    #[serde(rename = "phi_i_deg", serialize_with = "in_degrees")]
    pub phi_i: f64,
    /// Offset of the beam [um]; `None` for plane waves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub h_um: Option<f64>,
    /// Polarization.
    #[serde(serialize_with = "in_letters")]
    pub pol: Polarization,
    /// Amplitude of the incident polarization at azimuths 2 pi j / n: F_u for TM, F_phi for TE; `[j]`.
    #[serde(rename = "F_co", serialize_with = "in_pairs")]
    pub f_co: Vec<C64>,
    /// Amplitude of the other polarization, likewise.
    #[serde(rename = "F_cross", serialize_with = "in_pairs")]
    pub f_cross: Vec<C64>,
    /// Scattering width [um].
    #[serde(rename = "C_sca_um")]
    pub c_sca_um: f64,
    /// Absorption width [um].
    #[serde(rename = "C_abs_um")]
    pub c_abs_um: f64,
    /// Extinction width [um].
    #[serde(rename = "C_ext_um")]
    pub c_ext_um: f64,
}

/// Statistics of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStats {
    /// The solver; the costliest one if slices needed several.
    pub method: &'static str,
    /// Size of the largest linear system.
    pub unknowns: usize,
    /// Maximum relative residual of a solve.
    pub residual: f64,
    /// Time of the slices, one after the other [s].
    pub seconds: f64,
    /// Peak memory of the process, or the solvers' estimate if the system does not report it [bytes].
    pub peak_bytes: usize,
}

/// Output of `plywave wave scatter`. Cases are ordered by wavelength, then theta_i, phi_i, h and
/// polarization.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// One case per combination.
    pub cases: Vec<Case>,
    /// Statistics of the run.
    pub stats: RunStats,
}

fn in_degrees<S: Serializer>(angle: &f64, out: S) -> Result<S::Ok, S::Error> {
    degrees(*angle).serialize(out)
}

fn in_letters<S: Serializer>(pol: &Polarization, out: S) -> Result<S::Ok, S::Error> {
    match pol {
        Polarization::Tm => "TM",
        Polarization::Te => "TE",
    }
    .serialize(out)
}

fn in_pairs<S: Serializer>(list: &[C64], out: S) -> Result<S::Ok, S::Error> {
    out.collect_seq(list.iter().map(|z| [z.re, z.im]))
}

/// A solver behind its trait.
type Solver = Box<dyn WaveSolver>;

/// Solves every case of a scene that has passed [`Scene::check`]. Progress counts cases. The work runs in the
/// current thread pool of rayon; results do not depend on its size. `text` is the scene's.
///
/// # Errors
/// Errors of the solvers, [`WaveError::NotConverged`] for a residual above the tolerance,
/// [`WaveError::Ledger`] for powers that do not add up, all in [`RunError::Wave`]; [`RunError::Interrupted`]
/// and errors of the parts folder.
pub fn scatter(scene: &Scene, text: &str, run: Run<'_>) -> Result<Report, RunError> {
    let mut report = runs::run(&ScatterJob::new(scene, text), run)?;
    report.stats.peak_bytes = memory::peak_bytes().unwrap_or(report.stats.peak_bytes);
    Ok(report)
}

fn unsupported(method: Method, what: &str, hint: &str) -> WaveError {
    WaveError::Unsupported { method: method.name(), what: what.into(), hint: hint.into() }
}

/// Whether a finer solution may succeed after this error.
fn is_coarse(error: &WaveError) -> bool {
    use WaveError::{Ledger, NotConverged, Uncancelled};
    matches!(error, NotConverged { .. } | Uncancelled { .. } | Ledger { .. })
}

/// Whether another method may succeed after this error. Every result has passed its own residual and ledger.
fn passes_on(error: &WaveError) -> bool {
    use WaveError::{TooLarge, Unreachable, Unsupported};
    is_coarse(error) || matches!(error, Unsupported { .. } | Unreachable { .. } | TooLarge { .. })
}

/// The cheapest solver that accepts these fibers at this wave.
pub(crate) fn solver_of(fibers: &[Body], wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    let mut refusal = None;
    let fibers = &visible(fibers);
    for method in by_shape(fibers, wave, tolerance) {
        match prepare(method, fibers, wave, tolerance) {
            Err(error) if passes_on(&error) => refusal = Some(error),
            done => return done,
        }
    }
    Err(refusal.unwrap_or_else(|| unsupported(Method::Auto, "finds no solver for these fibers", "use other shapes")))
}

/// The solver of one slice.
fn prepare(method: Method, bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    if bodies.is_empty() {
        return Ok(Box::new(EmptySolver));
    }
    Ok(match method {
        Method::Mie => match bodies {
            [body] => Box::new(MieSolver::new(body, wave, tolerance)?),
            _ => {
                let what = format!("{} fibers", bodies.len());
                return Err(unsupported(method, &what, "use \"auto\", or one fiber"));
            }
        },
        Method::Nystrom | Method::Auto => {
            // Every node interacts with every other.
            let unknowns = least_unknowns(bodies, wave);
            check_memory(unknowns, 4.0 * unknowns * unknowns)?;
            Box::new(NystromSolver::new(bodies, wave, tolerance)?)
        }
        Method::Multipole => Box::new(MultipoleSolver::new(bodies, wave, tolerance)?),
        Method::Compressed | Method::Hierarchical => {
            // Every node interacts with all nodes of its own fiber.
            let own: Vec<f64> = bodies.iter().map(|b| least_unknowns(std::slice::from_ref(b), wave)).collect();
            let unknowns: f64 = own.iter().sum();
            check_memory(unknowns, 64.0 * unknowns + 4.0 * own.iter().fold(0.0, |a: f64, &b| a.max(b)).powi(2))?;
            if method == Method::Compressed {
                Box::new(CompressedSolver::new(bodies, wave, tolerance)?)
            } else {
                Box::new(CompressedSolver::hierarchical(bodies, wave, tolerance)?)
            }
        }
    })
}

/// All bodies and lumens.
fn walls(bodies: &[Body]) -> impl Iterator<Item = &Body> {
    bodies.iter().flat_map(|body| std::iter::successors(Some(body), |b| b.lumen.as_deref()))
}

/// Lower bound of the unknowns of boundary integrals, two nodes per wavelength with two unknowns each on
/// every wall. The solvers count exactly, but only with the nodes in memory. Waves inside of lossy bodies may
/// need none.
fn least_unknowns(bodies: &[Body], wave: &Wave) -> f64 {
    let index = |wall: &Body| if wall.kappa == 0.0 { wall.eta.max(1.0) } else { 1.0 };
    walls(bodies).map(|wall| 4.0 * least_length(&wall.shape) * index(wall) / wave.lambda_um).sum()
}

fn check_memory(unknowns: f64, bytes: f64) -> Result<(), WaveError> {
    const GIB: f64 = (1u64 << 30) as f64;
    match memory::available_bytes() {
        Some(free) if bytes > free as f64 => {
            Err(WaveError::TooLarge { unknowns: unknowns as usize, need_gib: bytes / GIB, have_gib: free as f64 / GIB })
        }
        _ => Ok(()),
    }
}

/// Constructor of a slice's solver by a method, to a tolerance.
pub(crate) type Prepare<'a> = dyn Fn(Method, &Wave, f64) -> Result<Solver, WaveError> + Sync + 'a;

/// A scene as a job: a shard is a slice, those of the shortest waves first, as they make the largest systems.
/// Its part has the far fields and widths of its cases, and the method of the solve.
pub struct ScatterJob<'a> {
    scene: Scene,
    text: String,
    waves: Vec<Wave>,
    sources: Vec<Source>,
    /// Slices in the order of the shards.
    order: Vec<usize>,
    prepare: Option<&'a Prepare<'a>>,
}

impl<'a> ScatterJob<'a> {
    /// The job of a scene that has passed [`Scene::check`], whose text is `text`.
    pub fn new(scene: &Scene, text: &str) -> ScatterJob<'a> {
        let (waves, sources) = (scene.waves(), scene.sources());
        let mut order: Vec<usize> = (0..waves.len()).collect();
        order.sort_by(|&a, &b| waves[b].k0().total_cmp(&waves[a].k0()));
        let scene = Scene { bodies: visible(&scene.bodies), ..scene.clone() };
        ScatterJob { scene, text: text.into(), waves, sources, order, prepare: None }
    }

    /// The job of a description.
    ///
    /// # Errors
    /// Those of the scene.
    pub fn from_description(description: &Description) -> Result<ScatterJob<'a>, RunError> {
        Ok(ScatterJob::new(&Scene::parse(&description.spec)?, &description.spec))
    }

    fn solver(&self, method: Method, wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
        match self.prepare {
            Some(prepare) => prepare(method, wave, tolerance),
            None => prepare(method, &self.scene.bodies, wave, tolerance),
        }
    }

    /// One slice by one method at a tolerance: all sources by one solver, each checked against the scene's
    /// tolerance. `None` when stopped. `progress` is called with all cases done so far.
    fn slice(
        &self,
        method: Method,
        wave: &Wave,
        tolerance: f64,
        stop: &AtomicBool,
        progress: &dyn Fn(u64),
    ) -> Result<Option<Done>, WaveError> {
        let solver = self.solver(method, wave, tolerance)?;
        let n = self.scene.n_phi_out;
        let (mut fields, mut widths) = (Vec::with_capacity(4 * n * self.sources.len()), Vec::new());
        let mut done = 0;
        for sources in self.sources.chunks(SOURCES) {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let checked = (|| {
                let scattered = solver.scatter(sources, n)?;
                let residual = solver.stats().residual;
                // Written this way, a NaN fails the check.
                let solved = residual <= self.scene.tolerance;
                if !solved {
                    return Err(WaveError::NotConverged { residual, iterations: 1 });
                }
                let bodies = &self.scene.bodies;
                scattered.iter().try_for_each(|s| check_ledger(wave, self.scene.tolerance, bodies, s))?;
                Ok(scattered)
            })();
            for (source, s) in sources.iter().zip(checked?) {
                let (f_co, f_cross) = match source.pol {
                    Polarization::Tm => (s.f_u, s.f_phi),
                    Polarization::Te => (s.f_phi, s.f_u),
                };
                fields.extend(f_co.iter().chain(&f_cross).flat_map(|z| [z.re, z.im]));
                widths.extend([s.c_sca_um, s.c_abs_um, s.c_ext_um]);
            }
            done += sources.len() as u64;
            progress(done);
        }
        let stats = solver.stats();
        let number = METHODS.iter().position(|m| *m == method).unwrap_or(0);
        let solved = vec![number as f64, stats.unknowns as f64, stats.residual];
        let part = Part::new(vec![Values::F64(fields), Values::F64(widths), Values::F64(solved)]);
        Ok(Some(Done { part, peak_bytes: stats.peak_bytes }))
    }
}

/// A slice restored from a part.
pub struct Slice {
    cases: Vec<Case>,
    method: Method,
    unknowns: usize,
    residual: f64,
    seconds: f64,
    peak_bytes: usize,
}

impl Shards for ScatterJob<'_> {
    fn description(&self) -> Description {
        Description::new("scatter", &serde_json::json!({}), &self.text)
    }

    fn shards(&self) -> usize {
        self.waves.len()
    }

    fn units(&self, _: usize) -> u64 {
        self.sources.len() as u64
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        let any = [f64::MIN, f64::MAX];
        vec![
            // F_co and F_cross, real and imaginary.
            ArrayLayout::f64("fields", &[self.sources.len(), 2, self.scene.n_phi_out, 2], any),
            // C_sca, C_abs, C_ext.
            ArrayLayout::f64("widths", &[self.sources.len(), 3], any),
            // Number of the method, unknowns, residual.
            ArrayLayout::f64("solved", &[3], [0.0, 1e15]),
        ]
    }

    fn check(&self, _: usize, _: usize, part: &Part) -> Result<(), String> {
        let number = part.f64(2)[0];
        method_of(number).map(|_| ()).ok_or_else(|| format!("{number} is no method"))
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let wave = &self.waves[self.order[shard]];
        let mut refusal = None;
        // Cases that a method solved before it failed are not reported again for the next one.
        let reported = AtomicU64::new(0);
        let report = |done: u64| progress(done.saturating_sub(reported.fetch_max(done, Ordering::Relaxed)));
        for method in candidates(&self.scene, wave) {
            for finer in FINER {
                match self.slice(method, wave, finer * self.scene.tolerance, stop, &report) {
                    Err(error) if is_coarse(&error) => refusal = Some(error),
                    // A lack of memory or digits in a finer solution is not the reason for the method's
                    // failure.
                    Err(error) if passes_on(&error) => {
                        if finer == 1.0 {
                            refusal = Some(error);
                        }
                        break;
                    }
                    done => return Ok(done?),
                }
            }
        }
        Err(refusal.unwrap_or_else(|| unsupported(self.scene.method, "serves no scene", "use \"auto\"")).into())
    }
}

impl Job for ScatterJob<'_> {
    type Output = Report;
    type Merge = Vec<Option<Slice>>;

    fn begin(&self) -> Vec<Option<Slice>> {
        self.waves.iter().map(|_| None).collect()
    }

    fn absorb(&self, slices: &mut Vec<Option<Slice>>, shard: usize, part: Part) {
        let wave = &self.waves[self.order[shard]];
        let n = self.scene.n_phi_out;
        let complex = |values: &[f64]| values.as_chunks().0.iter().map(|[re, im]| C64::new(*re, *im)).collect();
        let (fields, widths, solved) = (part.f64(0), part.f64(1), part.f64(2));
        let case = |(source, (fields, widths)): (&Source, (&[f64], &[f64]))| Case {
            lambda_um: wave.lambda_um,
            theta_i: wave.theta_i,
            phi_i: source.phi_i,
            h_um: source.beam.map(|b| b.h_um),
            pol: source.pol,
            f_co: complex(&fields[..2 * n]),
            f_cross: complex(&fields[2 * n..]),
            c_sca_um: widths[0],
            c_abs_um: widths[1],
            c_ext_um: widths[2],
        };
        slices[self.order[shard]] = Some(Slice {
            cases: self.sources.iter().zip(fields.chunks(4 * n).zip(widths.chunks(3))).map(case).collect(),
            method: method_of(solved[0]).unwrap_or_default(),
            unknowns: solved[1] as usize,
            residual: solved[2],
            seconds: part.seconds,
            peak_bytes: part.peak_bytes as usize,
        });
    }

    fn finish(&self, slices: Vec<Option<Slice>>) -> Result<Report, RunError> {
        let slices: Vec<Slice> = slices.into_iter().flatten().collect();
        // The costliest method of any slice.
        let method = METHODS.into_iter().rfind(|m| slices.iter().any(|s| s.method == *m));
        let stats = RunStats {
            method: method.unwrap_or_default().name(),
            unknowns: slices.iter().map(|s| s.unknowns).max().unwrap_or(0),
            residual: slices.iter().map(|s| s.residual).fold(0.0, f64::max),
            seconds: slices.iter().map(|s| s.seconds).sum(),
            peak_bytes: slices.iter().map(|s| s.peak_bytes).max().unwrap_or(0),
        };
        Ok(Report { cases: slices.into_iter().flat_map(|s| s.cases).collect(), stats })
    }
}

/// Methods in the order of their cost for few fibers; the method for many comes last.
const METHODS: [Method; 6] =
    [Method::Auto, Method::Mie, Method::Multipole, Method::Compressed, Method::Nystrom, Method::Hierarchical];

/// The method of a number in a part.
fn method_of(number: f64) -> Option<Method> {
    METHODS.into_iter().enumerate().find(|(at, _)| *at as f64 == number).map(|(_, m)| m)
}

/// Refuses powers that do not add up within the tolerance, and fields that are not numbers. The reference is
/// the greater of C_ext and `2 sqrt(C_sca / k_0)`.
///
/// The second is (4/k_0) times the root mean square of |F|: the C_ext of thin clear fibers is the small
/// difference of an F nearly out of phase, with an error as large. Almost invisible bodies have errors of
/// rounding.
///
/// # Errors
/// [`WaveError::Ledger`].
pub fn check_ledger(wave: &Wave, tolerance: f64, bodies: &[Body], scattered: &Scattered) -> Result<(), WaveError> {
    let scale = scattered.c_ext_um.abs().max(2.0 * (scattered.c_sca_um / wave.k0()).sqrt());
    let allowed_um = tolerance * scale + ROUNDING * walls(bodies).map(|wall| least_length(&wall.shape)).sum::<f64>();
    let defect_um = scattered.c_ext_um - scattered.c_sca_um - scattered.c_abs_um;
    // NaNs in the far field show in C_sca; written this way, they fail the check.
    if defect_um.abs() <= allowed_um {
        return Ok(());
    }
    Err(WaveError::Ledger { lambda_um: wave.lambda_um, theta_i_deg: degrees(wave.theta_i), defect_um, allowed_um })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SolverStats;
    use std::sync::atomic::AtomicUsize;

    fn solve(scene: &Scene) -> Result<Report, RunError> {
        scatter(scene, "", Run::plain())
    }

    const SCENE: &str = "lambda_um = [0.7, 0.5, 0.6]\ntheta_i_deg = [0, 20]\nphi_i_deg = [0, 90]\nn_phi_out = 12\n[beam]\nw0_um = 5\nh_um = [0, 1]\n[[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.5\nkappa = 0.01\n";

    /// A solver with spoiled results.
    struct Spoiled {
        inner: MieSolver,
        residual: f64,
        factor: f64,
    }

    impl WaveSolver for Spoiled {
        fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
            let mut all = self.inner.scatter(sources, n_phi_out)?;
            all.iter_mut().for_each(|s| s.c_abs_um *= self.factor);
            Ok(all)
        }

        fn stats(&self) -> SolverStats {
            SolverStats { residual: self.residual, ..self.inner.stats() }
        }
    }

    fn spoiled(scene: &Scene, residual: f64, factor: impl Fn(&Wave) -> f64 + Sync) -> Result<Report, RunError> {
        let prepare = |_: Method, wave: &Wave, _: f64| -> Result<Solver, WaveError> {
            let inner = MieSolver::new(&scene.bodies[0], wave, scene.tolerance)?;
            Ok(Box::new(Spoiled { inner, residual, factor: factor(wave) }))
        };
        runs::run(&ScatterJob { prepare: Some(&prepare), ..ScatterJob::new(scene, "") }, Run::plain())
    }

    /// Every combination once, in order; each equals a separate run; progress adds up.
    #[test]
    fn cases_are_complete_and_in_order() {
        let scene = Scene::parse(SCENE).unwrap();
        let done = AtomicUsize::new(0);
        let count = |n: u64| {
            done.fetch_add(n as usize, Ordering::Relaxed);
        };
        let report = scatter(&scene, "", Run { progress: Some(&count), ..Run::plain() }).unwrap();
        assert_eq!((report.cases.len(), done.into_inner()), (48, 48));
        assert_eq!(report.stats.method, "mie");
        assert!(report.stats.unknowns > 10 && report.stats.peak_bytes > 0);
        let mut want = report.cases.iter();
        for &lambda_um in &scene.lambda_um {
            for &theta_i in &scene.theta_i {
                for &phi_i in &scene.phi_i {
                    for h_um in [0.0, 1.0] {
                        let one = Scene {
                            lambda_um: vec![lambda_um],
                            theta_i: vec![theta_i],
                            phi_i: vec![phi_i],
                            beams: Some(crate::Beams { w0_um: 5.0, h_um: vec![h_um] }),
                            ..scene.clone()
                        };
                        for (case, pol) in solve(&one).unwrap().cases.iter().zip([Polarization::Tm, Polarization::Te]) {
                            assert_eq!(Some(case), want.next());
                            assert_eq!((case.lambda_um, case.theta_i, case.phi_i), (lambda_um, theta_i, phi_i));
                            assert_eq!((case.h_um, case.pol), (Some(h_um), pol));
                        }
                    }
                }
            }
        }
    }

    /// Powers that do not add up, residuals that stay, fields that are not numbers: errors, never results.
    /// The first bad slice is reported, for any number of threads.
    #[test]
    fn bad_solutions_are_errors() {
        let scene = Scene::parse(SCENE).unwrap();
        assert!(spoiled(&scene, 1e-7, |_| 1.0).is_ok());
        let off = spoiled(&scene, 0.0, |wave| if wave.lambda_um == 0.6 { 1.001 } else { 1.0 }).unwrap_err();
        assert!(matches!(off.job(), Some(WaveError::Ledger { lambda_um: 0.6, theta_i_deg: 0.0, .. })), "{off}");
        assert!(matches!(spoiled(&scene, 0.0, |_| f64::NAN).unwrap_err().job(), Some(WaveError::Ledger { .. })));
        for bad in [1e-5, f64::NAN, f64::INFINITY] {
            let error = spoiled(&scene, bad, |_| 1.0).unwrap_err();
            assert!(matches!(error.job(), Some(WaveError::NotConverged { .. })), "{error}");
        }
    }

    /// A solution whose powers do not add up is recomputed at a finer tolerance before it is refused.
    #[test]
    fn coarse_solutions_are_refined() {
        let scene = Scene::parse(SCENE).unwrap();
        let prepare = |_: Method, wave: &Wave, tolerance: f64| -> Result<Solver, WaveError> {
            let inner = MieSolver::new(&scene.bodies[0], wave, scene.tolerance)?;
            let factor = if tolerance < scene.tolerance { 1.0 } else { 1.001 };
            Ok(Box::new(Spoiled { inner, residual: 0.0, factor }))
        };
        let job = ScatterJob { prepare: Some(&prepare), ..ScatterJob::new(&scene, "") };
        assert_eq!(runs::run(&job, Run::plain()).unwrap().cases, solve(&scene).unwrap().cases);
    }

    /// The ledger is compared with every tolerance; zeros and roundings of invisible bodies add up.
    #[test]
    fn ledgers_are_held_to_the_tolerance() {
        let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
        let bodies = Scene::parse(SCENE).unwrap().bodies;
        let with = |[c_sca_um, c_abs_um, c_ext_um]: [f64; 3]| Scattered {
            f_u: Vec::new(),
            f_phi: Vec::new(),
            c_sca_um,
            c_abs_um,
            c_ext_um,
        };
        let passes = |tolerance: f64, widths| check_ledger(&wave, tolerance, &bodies, &with(widths)).is_ok();
        for tolerance in [1e-1, 1e-3, 1e-6] {
            assert!(passes(tolerance, [10.0, 0.0, 10.0 * (1.0 + 0.9 * tolerance)]));
            assert!(!passes(tolerance, [10.0, 0.0, 10.0 * (1.0 + 1.2 * tolerance)]));
            assert!(passes(tolerance, [0.0, 0.0, 0.0]) && passes(tolerance, [1e-30, -2e-16, 1e-16]));
            assert!(!passes(tolerance, [0.0, 0.0, -1e-9]));
        }
    }

    /// "auto" takes the cheapest solver that suits the scene, and the next if one refuses.
    #[test]
    fn auto_takes_what_serves() {
        let circle =
            |x: f64| format!("[[fiber]]\nshape = \"circle\"\nradius_um = 0.4\neta = 1.5\ncenter_um = [{x}, 0]\n");
        let lumen = |x: f64| format!("[fiber.lumen]\nshape = \"circle\"\nradius_um = 0.1\ncenter_um = [{x}, 0]\n");
        let oval = |x: f64| circle(x).replace("circle", "ellipse").replace("radius_um = 0.4", "a_um = 0.4\nb_um = 0.3");
        let pair = |f: &dyn Fn(f64) -> String| f(0.0) + &f(1.0);
        for (fibers, tolerance, method) in [
            (circle(0.0), 1e-6, "mie"),
            (circle(0.0) + &lumen(0.0), 1e-6, "mie"),
            (circle(0.0) + &lumen(0.1), 1e-6, "nystrom"),
            (oval(0.0), 1e-6, "nystrom"),
            (pair(&circle), 1e-6, "multipole"),
            (pair(&circle), 1e-9, "multipole"),
            (pair(&oval), 1e-6, "compressed"),
            (pair(&oval), 1e-9, "nystrom"),
            ((0..9).map(|i| oval(f64::from(i))).collect(), 1e-3, "compressed"),
        ] {
            let text = format!("lambda_um = [1]\nphi_i_deg = [0]\ntolerance = {tolerance}\n{fibers}");
            let report = solve(&Scene::parse(&text).unwrap()).unwrap();
            assert_eq!(report.stats.method, method, "{text}");
            assert!(report.stats.residual <= tolerance);
        }
        // A method that is requested by name is not replaced.
        let text = format!("lambda_um = [1]\nphi_i_deg = [0]\nmethod = \"mie\"\n{}", pair(&circle));
        let error = solve(&Scene::parse(&text).unwrap()).unwrap_err();
        assert!(matches!(error.job(), Some(WaveError::Unsupported { method: "mie", .. })), "{error}");
    }

    /// The file has the documented keys in order, and numbers that read back.
    #[test]
    fn reports_are_written_as_promised() {
        let scene = Scene::parse(SCENE).unwrap();
        let report = solve(&scene).unwrap();
        let text = serde_json::to_string(&report).unwrap();
        let head = r#"{"cases":[{"lambda_um":0.7,"theta_i_deg":0.0,"phi_i_deg":0.0,"h_um":0.0,"pol":"TM","F_co":[["#;
        assert!(text.starts_with(head), "{}", &text[..200]);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let case = &json["cases"][5];
        assert_eq!((&case["theta_i_deg"], &case["phi_i_deg"]), (&0.0.into(), &90.0.into()));
        assert_eq!(case["pol"], "TE");
        let f = report.cases[5].f_cross[3];
        assert_eq!((case["F_cross"][3][0].as_f64(), case["F_cross"][3][1].as_f64()), (Some(f.re), Some(f.im)));
        assert_eq!(case["C_abs_um"].as_f64(), Some(report.cases[5].c_abs_um));
        for key in ["method", "unknowns", "residual", "seconds", "peak_bytes"] {
            assert!(!json["stats"][key].is_null(), "{key}");
        }
        let planes = Scene { beams: None, ..scene };
        let text = serde_json::to_string(&solve(&planes).unwrap()).unwrap();
        assert!(!text.contains("h_um"));
    }
}
