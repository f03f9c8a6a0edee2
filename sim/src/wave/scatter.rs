//! From a scene to its far fields: the choice of the solver, the slices of equal wavelength and latitude, the checks of what comes back, the report.
//!
//! A slice is solved by one factorization for all its sources. Slices run side by side as far as memory allows; a single one is left to the
//! solver's own threads. Nothing is scaled to make powers add up: a case whose ledger does not balance is an error.

use super::scene::degrees;
use super::{
    Body, C64, CompressedSolver, Method, MieSolver, MultipoleSolver, NystromSolver, Polarization, Scattered, Scene,
    Shape, Wave, WaveError, WaveSolver, memory,
};
use rayon::prelude::*;
use serde::{Serialize, Serializer};
use std::f64::consts::TAU;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Sources given to a solver at a time: enough for block solves, few enough for a bar to move.
const SOURCES: usize = 256;

/// How far the ledger may be off, in units of tolerance times `C_ext + 2 sqrt(C_sca / k_0)`.
///
/// The second term is (4/k_0) times the root mean square of |F|. With a far field of relative error t, C_ext is off by t times the greater of the two
/// terms (the first for thick fibers, whose far field peaks forward; the second for thin clear ones, whose C_ext is what is left of an F nearly out of
/// phase), C_sca by 2 t of itself, and C_abs, the small difference of large fluxes through a wall, by 2 t of the power that falls on its
/// circumference, some pi/2 of C_ext: 6 in all, were they all at their worst.
const LEDGER: f64 = 10.0;

/// What one source scatters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// Vacuum wavelength [um].
    pub lambda_um: f64,
    /// Latitude of the incidence [rad]; degrees in files.
    #[serde(rename = "theta_i_deg", serialize_with = "in_degrees")]
    pub theta_i: f64,
    /// Azimuth the light comes from [rad]; degrees in files.
    #[serde(rename = "phi_i_deg", serialize_with = "in_degrees")]
    pub phi_i: f64,
    /// Offset of the beam [um]; none for plane waves.
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

/// How a run went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStats {
    /// The solver that was used.
    pub method: &'static str,
    /// Size of the largest linear system.
    pub unknowns: usize,
    /// Largest relative residual of a solve.
    pub residual: f64,
    /// Wall time [s].
    pub seconds: f64,
    /// The most memory the process held at once, or the solvers' estimate where the system does not tell [bytes].
    pub peak_bytes: usize,
}

/// What `plywave wave scatter` writes. Cases by wavelength, within it by theta_i, phi_i, h and polarization.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// One a combination.
    pub cases: Vec<Case>,
    /// How the run went.
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

/// Solves every case of a scene that has passed [`Scene::check`]. `progress` is told of cases as they are done. The work runs in the current
/// thread pool of rayon; results do not depend on its size.
///
/// # Errors
/// What the solvers refuse, [`WaveError::NotConverged`] for a residual above the tolerance, [`WaveError::Ledger`] for powers that do not add up.
pub fn scatter(scene: &Scene, progress: &(dyn Fn(u64) + Sync)) -> Result<Report, WaveError> {
    let mut refusal = None;
    for method in candidates(scene) {
        let prepare = |wave: &Wave| prepare(method, &scene.bodies, wave, scene.tolerance);
        match run(scene, method, &prepare, progress) {
            Err(error) if passes_on(&error) => refusal = Some(error),
            done => return done,
        }
    }
    Err(refusal.unwrap_or_else(|| unsupported(scene.method, "serves no scene", "use \"auto\"")))
}

fn unsupported(method: Method, what: &str, mend: &str) -> WaveError {
    WaveError::Unsupported { method: method.name(), what: what.into(), mend: mend.into() }
}

/// Whether another method may succeed where one fails so. Whatever answers in the end has passed its own residual and ledger.
fn passes_on(error: &WaveError) -> bool {
    use WaveError::{Ledger, NotConverged, TooLarge, Unreachable, Unsupported};
    matches!(error, Unsupported { .. } | Unreachable { .. } | TooLarge { .. } | NotConverged { .. } | Ledger { .. })
}

/// Solvers to be tried for a scene, the cheapest first.
fn candidates(scene: &Scene) -> Vec<Method> {
    if scene.method == Method::Auto { by_shape(&scene.bodies) } else { vec![scene.method] }
}

/// Solvers that serve these fibers, the cheapest first.
fn by_shape(fibers: &[Body]) -> Vec<Method> {
    let series = fibers.iter().all(is_concentric);
    match fibers.len() {
        1 if series => vec![Method::Mie],
        1 => vec![Method::Nystrom],
        // Measured on 2 to 19 fibers of 1 to 5 um: multipoles are 4 to 30 times faster than either of the others. They fail where walls all but touch.
        _ if series => vec![Method::Multipole, Method::Compressed, Method::Nystrom],
        // On a level for two fibers of 1 um, 4 to 9 times faster for 19 of them. Tolerances below its reach are left to the other.
        _ => vec![Method::Compressed, Method::Nystrom],
    }
}

/// The cheapest solver that takes these fibers at this wave.
pub(crate) fn solver_of(fibers: &[Body], wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    let mut refusal = None;
    for method in by_shape(fibers) {
        match prepare(method, fibers, wave, tolerance) {
            Err(error) if passes_on(&error) => refusal = Some(error),
            done => return done,
        }
    }
    Err(refusal.unwrap_or_else(|| unsupported(Method::Auto, "finds no solver for these fibers", "use other shapes")))
}

/// Whether the body and its lumens are circles about one center.
fn is_concentric(body: &Body) -> bool {
    let inner = |lumen: &Body| lumen.center_um == body.center_um && is_concentric(lumen);
    matches!(body.shape, Shape::Circle { .. }) && body.lumen.as_deref().is_none_or(inner)
}

/// The solver of one slice.
fn prepare(method: Method, bodies: &[Body], wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    Ok(match method {
        Method::Mie => match bodies {
            [body] => Box::new(MieSolver::new(body, wave, tolerance)?),
            _ => {
                let what = format!("{} fibers", bodies.len());
                return Err(unsupported(method, &what, "use \"auto\", or one fiber"));
            }
        },
        Method::Nystrom | Method::Auto => {
            // Every node meets every other.
            let unknowns = least_unknowns(bodies, wave);
            check_memory(unknowns, 4.0 * unknowns * unknowns)?;
            Box::new(NystromSolver::new(bodies, wave, tolerance)?)
        }
        Method::Multipole => Box::new(MultipoleSolver::new(bodies, wave, tolerance)?),
        Method::Compressed => {
            // Every node meets those of its own fiber.
            let own: Vec<f64> = bodies.iter().map(|b| least_unknowns(std::slice::from_ref(b), wave)).collect();
            let unknowns: f64 = own.iter().sum();
            check_memory(unknowns, 64.0 * unknowns + 4.0 * own.iter().fold(0.0, |a: f64, &b| a.max(b)).powi(2))?;
            Box::new(CompressedSolver::new(bodies, wave, tolerance)?)
        }
    })
}

/// Lower bound of the unknowns of boundary integrals, two nodes a wavelength with two unknowns each on every wall. The solvers count exactly, but only
/// with the nodes in memory.
fn least_unknowns(bodies: &[Body], wave: &Wave) -> f64 {
    let walls = bodies.iter().flat_map(|body| std::iter::successors(Some(body), |b| b.lumen.as_deref()));
    walls.map(|wall| 4.0 * least_length(&wall.shape) * wall.eta.max(1.0) / wave.lambda_um).sum()
}

/// The length of a wall, or less [um].
fn least_length(shape: &Shape) -> f64 {
    match shape {
        Shape::Circle { radius_um } => TAU * radius_um,
        Shape::Ellipse { a_um, b_um } => 4.0 * a_um.max(*b_um),
        // The root mean square of |z - c_0| is that of the |c_k|: one point is as far from c_0, another lies beyond c_0, and the wall goes there and back.
        Shape::Fourier { coeffs } => {
            2.0 * coeffs.iter().filter(|(k, _)| *k != 0).map(|(_, c)| c.norm_sqr()).sum::<f64>().sqrt()
        }
        Shape::Polygon { points_um, rounding_um } => {
            let n = points_um.len();
            let corner = |i: usize| C64::new(points_um[i % n][0], points_um[i % n][1]);
            let edge = |i: usize| corner(i + 1) - corner(i);
            // An arc that turns by t replaces 2 tan(t/2) of the edges by t, in units of its radius.
            let saved = |i: usize| {
                let turn = (edge(i + 1) * edge(i).conj()).arg().abs();
                rounding_um * (2.0 * (0.5 * turn).tan() - turn)
            };
            (0..n).map(|i| edge(i).norm() - saved(i)).sum()
        }
    }
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

/// A slice that is done.
struct Slice {
    cases: Vec<Case>,
    unknowns: usize,
    residual: f64,
    peak_bytes: usize,
}

/// All slices, by solvers that `prepare` makes.
fn run(
    scene: &Scene,
    method: Method,
    prepare: &(dyn Fn(&Wave) -> Result<Solver, WaveError> + Sync),
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Report, WaveError> {
    let begun = Instant::now();
    let waves = scene.waves();
    // The shortest waves make the largest systems: one of them goes first and tells how many slices fit into memory side by side.
    let mut order: Vec<usize> = (0..waves.len()).collect();
    order.sort_by(|&a, &b| waves[b].k0().total_cmp(&waves[a].k0()));
    let mut slices: Vec<Option<Slice>> = waves.iter().map(|_| None).collect();
    let (mut rest, mut lanes) = (&order[..], 0);
    if let Some((&first, others)) = order.split_first() {
        let done = slice(scene, &waves[first], prepare, progress)?;
        lanes = fitting(done.peak_bytes).min(others.len());
        slices[first] = Some(done);
        rest = others;
    }

    let next = AtomicUsize::new(0);
    let failed: Mutex<Option<(usize, WaveError)>> = Mutex::new(None);
    let found: Mutex<Vec<(usize, Slice)>> = Mutex::new(Vec::with_capacity(rest.len()));
    (0..lanes).into_par_iter().with_max_len(1).for_each(|_| {
        loop {
            let turn = next.fetch_add(1, Ordering::Relaxed);
            // Slices begin in order, so that the first failure by that order is found whatever the number of lanes.
            if turn >= rest.len() || lock(&failed).as_ref().is_some_and(|(at, _)| *at < turn) {
                return;
            }
            match slice(scene, &waves[rest[turn]], prepare, progress) {
                Ok(done) => lock(&found).push((rest[turn], done)),
                Err(error) => {
                    let mut failed = lock(&failed);
                    if failed.as_ref().is_none_or(|(at, _)| turn < *at) {
                        *failed = Some((turn, error));
                    }
                }
            }
        }
    });
    if let Some((_, error)) = failed.into_inner().unwrap_or_else(|e| e.into_inner()) {
        return Err(error);
    }
    for (i, slice) in found.into_inner().unwrap_or_else(|e| e.into_inner()) {
        slices[i] = Some(slice);
    }
    let slices: Vec<Slice> = slices.into_iter().flatten().collect();
    let estimate = slices.iter().map(|s| s.peak_bytes).max().unwrap_or(0) * lanes.max(1);
    let stats = RunStats {
        method: method.name(),
        unknowns: slices.iter().map(|s| s.unknowns).max().unwrap_or(0),
        residual: slices.iter().map(|s| s.residual).fold(0.0, f64::max),
        seconds: begun.elapsed().as_secs_f64(),
        peak_bytes: memory::peak_bytes().unwrap_or(estimate),
    };
    Ok(Report { cases: slices.into_iter().flat_map(|s| s.cases).collect(), stats })
}

/// The lock of a mutex, whoever panicked while holding it: the values within are whole at any time.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|e| e.into_inner())
}

/// Slices that may be held at once where each takes `bytes`: one a thread, in half of the memory that is free.
fn fitting(bytes: usize) -> usize {
    let fit = memory::available_bytes().map_or(1, |free| free / 2 / bytes.max(1));
    fit.clamp(1, rayon::current_num_threads())
}

/// One slice: all sources by one solver, each checked.
fn slice(
    scene: &Scene,
    wave: &Wave,
    prepare: &dyn Fn(&Wave) -> Result<Solver, WaveError>,
    progress: &dyn Fn(u64),
) -> Result<Slice, WaveError> {
    let solver = prepare(wave)?;
    let sources = scene.sources();
    let mut cases = Vec::with_capacity(sources.len());
    for sources in sources.chunks(SOURCES) {
        let scattered = solver.scatter(sources, scene.n_phi_out)?;
        let residual = solver.stats().residual;
        // Asked this way, a NaN does not pass.
        let solved = residual <= scene.tolerance;
        if !solved {
            return Err(WaveError::NotConverged { residual, iterations: 1 });
        }
        for (source, scattered) in sources.iter().zip(scattered) {
            check_ledger(wave, scene.tolerance, &scattered)?;
            let Scattered { f_u, f_phi, c_sca_um, c_abs_um, c_ext_um } = scattered;
            let (f_co, f_cross) = match source.pol {
                Polarization::Tm => (f_u, f_phi),
                Polarization::Te => (f_phi, f_u),
            };
            cases.push(Case {
                lambda_um: wave.lambda_um,
                theta_i: wave.theta_i,
                phi_i: source.phi_i,
                h_um: source.beam.map(|b| b.h_um),
                pol: source.pol,
                f_co,
                f_cross,
                c_sca_um,
                c_abs_um,
                c_ext_um,
            });
        }
        progress(sources.len() as u64);
    }
    let stats = solver.stats();
    Ok(Slice { cases, unknowns: stats.unknowns, residual: stats.residual, peak_bytes: stats.peak_bytes })
}

/// Refuses powers that do not add up within the tolerance, and fields that are not numbers.
///
/// # Errors
/// [`WaveError::Ledger`].
pub fn check_ledger(wave: &Wave, tolerance: f64, scattered: &Scattered) -> Result<(), WaveError> {
    let scale = scattered.c_ext_um.abs() + 2.0 * (scattered.c_sca_um / wave.k0()).sqrt();
    let allowed_um = LEDGER * tolerance * scale;
    let defect_um = scattered.c_ext_um - scattered.c_sca_um - scattered.c_abs_um;
    // NaNs in the far field show in C_sca; asked this way, they do not pass.
    if defect_um.abs() <= allowed_um {
        return Ok(());
    }
    Err(WaveError::Ledger { lambda_um: wave.lambda_um, theta_i_deg: degrees(wave.theta_i), defect_um, allowed_um })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wave::{SolverStats, Source};

    const SCENE: &str = "lambda_um = [0.7, 0.5, 0.6]\ntheta_i_deg = [0, 20]\nphi_i_deg = [0, 90]\nn_phi_out = 12\n[beam]\nw0_um = 5\nh_um = [0, 1]\n[[fiber]]\nshape = \"circle\"\nradius_um = 0.8\neta = 1.5\nkappa = 0.01\n";

    /// A solver whose results are spoiled on the way.
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

    fn spoiled(scene: &Scene, residual: f64, factor: impl Fn(&Wave) -> f64 + Sync) -> Result<Report, WaveError> {
        let prepare = |wave: &Wave| -> Result<Solver, WaveError> {
            let inner = MieSolver::new(&scene.bodies[0], wave, scene.tolerance)?;
            Ok(Box::new(Spoiled { inner, residual, factor: factor(wave) }))
        };
        run(scene, Method::Mie, &prepare, &|_| ())
    }

    /// Every combination once, in order; each equals a run of its own; progress adds up.
    #[test]
    fn cases_are_complete_and_in_order() {
        let scene = Scene::parse(SCENE).unwrap();
        let done = AtomicUsize::new(0);
        let report = scatter(&scene, &|n| {
            done.fetch_add(n as usize, Ordering::Relaxed);
        })
        .unwrap();
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
                            beams: Some(super::super::Beams { w0_um: 5.0, h_um: vec![h_um] }),
                            ..scene.clone()
                        };
                        for (case, pol) in
                            scatter(&one, &|_| ()).unwrap().cases.iter().zip([Polarization::Tm, Polarization::Te])
                        {
                            assert_eq!(Some(case), want.next());
                            assert_eq!((case.lambda_um, case.theta_i, case.phi_i), (lambda_um, theta_i, phi_i));
                            assert_eq!((case.h_um, case.pol), (Some(h_um), pol));
                        }
                    }
                }
            }
        }
    }

    /// Powers that do not add up, residuals that stay, fields that are not numbers: errors, never answers. The first bad slice is told, whatever the threads.
    #[test]
    fn bad_solutions_are_errors() {
        let scene = Scene::parse(SCENE).unwrap();
        assert!(spoiled(&scene, 1e-7, |_| 1.0).is_ok());
        let off = spoiled(&scene, 0.0, |wave| if wave.lambda_um == 0.6 { 1.001 } else { 1.0 }).unwrap_err();
        assert!(matches!(off, WaveError::Ledger { lambda_um: 0.6, theta_i_deg: 0.0, .. }), "{off}");
        assert!(matches!(spoiled(&scene, 0.0, |_| f64::NAN).unwrap_err(), WaveError::Ledger { .. }));
        for bad in [1e-5, f64::NAN, f64::INFINITY] {
            let error = spoiled(&scene, bad, |_| 1.0).unwrap_err();
            assert!(matches!(error, WaveError::NotConverged { .. }), "{error}");
        }
    }

    /// "auto" takes the cheapest solver that serves the scene, and the next where one refuses.
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
        ] {
            let text = format!("lambda_um = [1]\nphi_i_deg = [0]\ntolerance = {tolerance}\n{fibers}");
            let report = scatter(&Scene::parse(&text).unwrap(), &|_| ()).unwrap();
            assert_eq!(report.stats.method, method, "{text}");
            assert!(report.stats.residual <= tolerance);
        }
        // What was asked for by name is not replaced.
        let text = format!("lambda_um = [1]\nphi_i_deg = [0]\nmethod = \"mie\"\n{}", pair(&circle));
        let error = scatter(&Scene::parse(&text).unwrap(), &|_| ()).unwrap_err();
        assert!(matches!(error, WaveError::Unsupported { method: "mie", .. }), "{error}");
    }

    /// A square of side 4 with arcs of radius 1 has four straight pieces of 2 and a circle of circumference.
    #[test]
    fn lengths_of_rounded_polygons() {
        let points_um = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let length = least_length(&Shape::Polygon { points_um, rounding_um: 1.0 });
        assert!((length - (8.0 + TAU)).abs() < 1e-12, "{length}");
    }

    /// The file has the keys that are promised, in that order, and numbers that come back.
    #[test]
    fn reports_are_written_as_promised() {
        let scene = Scene::parse(SCENE).unwrap();
        let report = scatter(&scene, &|_| ()).unwrap();
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
        let text = serde_json::to_string(&scatter(&planes, &|_| ()).unwrap()).unwrap();
        assert!(!text.contains("h_um"));
    }
}
