//! Xia's tables of one fiber (Xia 2020, 5): N_wave and C_x over wavelength, latitude and azimuth, by waves or by rays.
//!
//! A table's cell stands for a band of wavelengths and of latitudes, within which the far field of a large fiber beats many times. So each cell averages as
//! many solves as keep the phase of the light's longest way, there and back across the fiber, within a set number of turns from solve to solve (Xia samples
//! until renderings no longer change). What is averaged are powers: differential widths and C_x; N is their quotient. Azimuths follow the band limit: a far
//! field of harmonics |m| <= M has an intensity of harmonics up to 2 M, whose sums over more than 4 M azimuths are exact; more azimuths than the table keeps
//! are averaged down.
//!
//! TM and TE light are averaged with equal weights: their powers are, so that N is unpolarized light's.
//!
//! Work is cut into shards, a few latitudes of one wavelength each, that depend on their place alone; the table does not depend on threads or interruptions.

use super::rays::RaySlice;
use super::scatter::solver_of;
use super::{Absorption, Polarization, SingleFiber, Source, Wave, WaveError, WaveSolver, check_walls};
use crate::error::SimError;
use crate::parts::Parts;
use crate::simulate::Run;
use plywave::fiber::{FiberSource, FiberTable};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Sizes of a fiber table.
#[derive(Clone, Debug, PartialEq)]
pub struct TabulateOptions {
    /// Name of the preset they started from, for the record.
    pub preset: String,
    /// Ends of the spectrum [um].
    pub lambda_um: [f64; 2],
    /// Bands of wavelength.
    pub lambdas: usize,
    /// Latitudes.
    pub thetas: usize,
    /// Most azimuths phi_i round the fiber.
    pub azimuths: usize,
    /// Most relative azimuths.
    pub relative: usize,
    /// Turns of phase that two solves of a cell may lie apart.
    pub turns: f64,
    /// Most solves of a cell along either axis.
    pub most_samples: usize,
    /// Error of the solver's far field.
    pub tolerance: f64,
    /// Longitudinal width to store [rad].
    pub beta_m: f64,
    /// Rays of a slice (rays only).
    pub rays: u64,
    /// Seed of the rays.
    pub seed: u64,
}

impl TabulateOptions {
    /// To look at a fiber.
    pub fn preview() -> Self {
        TabulateOptions {
            preset: "preview".into(),
            lambda_um: [0.38, 0.78],
            lambdas: 12,
            thetas: 15,
            azimuths: 90,
            relative: 180,
            turns: 1.0,
            most_samples: 1,
            tolerance: 1e-3,
            // About that of Marschner 2003 for hair, 5 to 10 degrees.
            beta_m: 0.1,
            rays: 10_000,
            seed: 1,
        }
    }

    /// The sizes of Xia 2020, 5.2.1.
    pub fn standard() -> Self {
        TabulateOptions {
            preset: "standard".into(),
            lambdas: 50,
            thetas: 100,
            azimuths: 360,
            relative: 360,
            most_samples: 5,
            tolerance: 1e-4,
            rays: 40_000,
            ..Self::preview()
        }
    }

    /// The same sizes, each cell averaged over more solves.
    pub fn reference() -> Self {
        TabulateOptions {
            preset: "reference".into(),
            turns: 0.5,
            most_samples: 15,
            tolerance: 1e-6,
            rays: 400_000,
            ..Self::standard()
        }
    }

    /// By name: "preview", "standard" or "reference".
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "preview" => Some(Self::preview()),
            "standard" => Some(Self::standard()),
            "reference" => Some(Self::reference()),
            _ => None,
        }
    }
}

/// Largest table, in values of the azimuthal function: those of a fiber without symmetry at Xia's sizes.
const MAX_VALUES: f64 = 7e8;
/// Latitudes of a shard.
const SHARD: usize = 5;

/// Axes and sampling of a table.
#[derive(Clone, Debug, PartialEq)]
struct Plan {
    lambda_um: Vec<f64>,
    theta_i: Vec<f64>,
    phi_i: Vec<f64>,
    width_um: Vec<f64>,
    /// D.
    relative: usize,
    /// Azimuths solved for each that is kept, along phi_i and phi_r alike; odd.
    fine: usize,
    /// Solves of a cell along lambda and theta_i.
    samples: [usize; 2],
}

impl Plan {
    fn new(fiber: &SingleFiber, options: &TabulateOptions, source: FiberSource) -> Result<Plan, SimError> {
        let radius = fiber.bound_um()?;
        let [first, last] = options.lambda_um;
        if !(first > 0.0 && last >= first && last.is_finite()) {
            let value = format!("{first} to {last}");
            let mend = "give two wavelengths above 0, the shorter first".to_string();
            return Err(WaveError::Invalid { key: "lambda_um".into(), value, mend }.into());
        }
        // Rays know wavelength by absorption alone.
        let colored = matches!(fiber.absorption, Absorption::Kappa(k) if k > 0.0);
        let lambdas = match source {
            FiberSource::Wave => options.lambdas.max(1),
            // Absorption changes slowly with the wavelength.
            FiberSource::Ray if colored => options.lambdas.clamp(1, 12),
            FiberSource::Ray => 1,
        };
        let thetas = options.thetas.max(1);
        let band = (last - first) / lambdas as f64;
        let harmonics = highest_harmonic(TAU / first * radius);
        // Linear interpolation wants several nodes for each period; a fiber of few harmonics needs no more than that.
        let wanted = if source == FiberSource::Wave { 16 * harmonics } else { usize::MAX };
        let folds = fiber.symmetry.folds.max(1) as usize;
        let stride = options.relative.min(wanted).div_ceil(options.azimuths.max(1)).max(1);
        let unit = match (fiber.symmetry.folds, fiber.symmetry.mirror_rad) {
            (0, _) => 1,
            // Whole steps from one mirror to the next, and mirrors at quarter turns.
            (_, Some(_)) => lcm(2 * folds * stride, 4),
            (_, None) => folds * stride,
        };
        let relative = (options.relative.min(wanted) / unit * unit).max(unit).max(2);
        let count = fiber.symmetry.count(relative / stride);
        let phi_i = fiber.symmetry.phi_i(count);
        let width_um = phi_i.iter().map(|phi| fiber.shadow_um(*phi).map(|[a, b]| b - a)).collect::<Result<_, _>>()?;
        let values = (lambdas * thetas * count) as f64 * relative as f64;
        if values > MAX_VALUES {
            return Err(SimError::TooLarge { cells: values, allowed: MAX_VALUES });
        }
        // Ways of light 4 eta R long (across and back) turn by 4 eta R band / lambda^2, those of 4 R by 4 R dtheta / lambda.
        let samples = match source {
            FiberSource::Ray => [1, 1],
            FiberSource::Wave => {
                let turns = [
                    4.0 * fiber.body.eta.max(1.0) * radius * band / (first * first),
                    4.0 * radius * FRAC_PI_2 / thetas as f64 / first,
                ];
                turns.map(|t| ((t / options.turns).ceil() as usize).clamp(1, options.most_samples.max(1)))
            }
        };
        let fine = match source {
            FiberSource::Ray => 1,
            FiberSource::Wave => ((4 * harmonics + 1).div_ceil(relative)) | 1,
        };
        let lambda_um = match source {
            FiberSource::Ray if lambdas == 1 => vec![0.5 * (first + last)],
            _ => (0..lambdas).map(|l| first + (l as f64 + 0.5) * band).collect(),
        };
        let theta_i = FiberTable::theta_nodes(thetas);
        Ok(Plan { lambda_um, theta_i, phi_i, width_um, relative, fine, samples })
    }

    /// Solves (or traced slices' latitudes) in all.
    fn solves(&self) -> usize {
        self.lambda_um.len() * self.theta_i.len() * self.samples[0] * self.samples[1]
    }

    /// The solves of cell (l, m).
    fn waves(&self, options: &TabulateOptions, l: usize, m: usize) -> Vec<Wave> {
        let band = (options.lambda_um[1] - options.lambda_um[0]) / self.lambda_um.len() as f64;
        let part = FRAC_PI_2 / self.theta_i.len() as f64;
        let within = |k: usize, n: usize| (k as f64 + 0.5) / n as f64 - 0.5;
        let [nl, nt] = self.samples;
        (0..nl * nt)
            .map(|k| Wave {
                lambda_um: self.lambda_um[l] + band * within(k / nt, nl),
                theta_i: self.theta_i[m] + part * within(k % nt, nt),
            })
            .collect()
    }
}

/// Highest harmonic of a far field from within `x` = k R of the center: beyond x they fall as an Airy function of width x^(1/3); its fifth power of ten
/// of the amplitude lies some 4 widths out.
fn highest_harmonic(x: f64) -> usize {
    (x + 4.0 * x.cbrt() + 2.0).ceil() as usize
}

fn lcm(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y > 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}

/// Solves that a run will report through `progress`, in all.
///
/// # Errors
/// As [`tabulate_with`], before any work.
pub fn tabulate_slices(fiber: &SingleFiber, options: &TabulateOptions, source: FiberSource) -> Result<u64, SimError> {
    Ok(Plan::new(fiber, options, source)?.solves() as u64)
}

/// A prepared body.
pub type Solver = Box<dyn WaveSolver>;
/// What prepares a fiber for a wave, to a tolerance.
pub type MakeSolver<'a> = dyn Fn(&SingleFiber, &Wave, f64) -> Result<Solver, WaveError> + Sync + 'a;

/// The table of `fiber` by wave optics, each solve made by `solver`; `spec_text` is kept in the table. Progress counts solves.
///
/// # Errors
/// [`SimError::TooLarge`], [`SimError::Wave`] from the solver, [`SimError::Interrupted`], file errors of the parts folder.
pub fn tabulate_with(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
    solver: &MakeSolver<'_>,
) -> Result<FiberTable, SimError> {
    let plan = Plan::new(fiber, options, FiberSource::Wave)?;
    let cell = |l: usize, m: usize, out: Cell<'_>, done: &dyn Fn() -> bool| {
        wave_cell(&plan, &plan.waves(options, l, m), out, done, &|wave| solver(fiber, wave, options.tolerance))
    };
    fill(fiber, spec_text, options, run, &plan, FiberSource::Wave, &cell)
}

/// [`tabulate_with`] the cheapest solver that serves the fiber: series for circles, boundary integrals for all others.
///
/// # Errors
/// As [`tabulate_with`], and what is wrong with the fiber's walls.
pub fn tabulate(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
) -> Result<FiberTable, SimError> {
    check_walls(std::slice::from_ref(&fiber.body))?;
    let solver =
        |fiber: &SingleFiber, wave: &Wave, tolerance: f64| solver_of(&[fiber.at(wave.lambda_um)], wave, tolerance);
    tabulate_with(fiber, spec_text, options, run, &solver)
}

/// The ray-optics twin of the table: the same axes, the same cells, geometric widths. Progress counts latitudes.
///
/// # Errors
/// As [`tabulate_with`].
pub fn tabulate_rays(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
) -> Result<FiberTable, SimError> {
    let plan = Plan::new(fiber, options, FiberSource::Ray)?;
    let slice = RaySlice::new(fiber)?;
    let cell = |l: usize, m: usize, out: Cell<'_>, done: &dyn Fn() -> bool| {
        let sigma = fiber.absorption.sigma_per_um(plan.lambda_um[l]);
        for (p, phi_i) in plan.phi_i.iter().enumerate() {
            let bins = &mut out.azimuthal[p * plan.relative..(p + 1) * plan.relative];
            // The same rays at every wavelength: only what is absorbed differs.
            let place = [m as u64, p as u64];
            let absorbed = slice.trace([plan.theta_i[m], *phi_i], sigma, options.rays, options.seed, place, bins);
            out.c_x_um[p] = plan.width_um[p];
            out.c_abs_um[p] = plan.width_um[p] * absorbed;
        }
        Ok(done())
    };
    fill(fiber, spec_text, options, run, &plan, FiberSource::Ray, &cell)
}

/// Place of one cell's results: `[P][D]`, `[P]`, `[P]`.
struct Cell<'a> {
    azimuthal: &'a mut [f32],
    c_x_um: &'a mut [f64],
    c_abs_um: &'a mut [f64],
}

/// Work of one cell; calls `done` after each solve, which says whether to go on. False when stopped.
type Work<'a> = dyn Fn(usize, usize, Cell<'_>, &dyn Fn() -> bool) -> Result<bool, SimError> + Sync + 'a;

/// Averages of the cell's solves.
fn wave_cell(
    plan: &Plan,
    waves: &[Wave],
    out: Cell<'_>,
    done: &dyn Fn() -> bool,
    solver: &dyn Fn(&Wave) -> Result<Solver, WaveError>,
) -> Result<bool, SimError> {
    let (p, d, q) = (plan.phi_i.len(), plan.relative, plan.fine);
    let n = d * q;
    let half = (q / 2) as i64;
    // Azimuths stand on the grid of n: a node every `stride q` steps, its samples `stride` steps apart around it.
    let step = TAU / n as f64;
    let round = plan.phi_i.len() == 1;
    let stride = if round { 0.0 } else { ((plan.phi_i[1] - plan.phi_i[0]) / (TAU / d as f64)).round() };
    let offsets: Vec<f64> = if round { vec![0.0] } else { (-half..=half).map(|k| k as f64 * stride * step).collect() };
    let mut power = vec![0.0; p * d];
    let (mut c_x, mut c_abs) = (vec![0.0; p], vec![0.0; p]);
    for wave in waves {
        let solver = solver(wave)?;
        // Sources in runs that keep the amplitudes of one run below some 64 MiB.
        let run = ((1 << 21) / n.max(1) / 2).max(1);
        let azimuths: Vec<(usize, f64)> =
            (0..p).flat_map(|k| offsets.iter().map(move |o| (k, plan.phi_i[k] + o))).collect();
        let weight = 0.5 / (offsets.len() as f64 * waves.len() as f64 * wave.theta_i.cos());
        for azimuths in azimuths.chunks(run) {
            let sources: Vec<Source> = azimuths
                .iter()
                .flat_map(|(_, phi_i)| {
                    [Polarization::Tm, Polarization::Te].map(|pol| Source { phi_i: *phi_i, pol, beam: None })
                })
                .collect();
            let fields = solver.scatter(&sources, n)?;
            for (i, field) in fields.iter().enumerate() {
                let (k, phi_i) = azimuths[i / 2];
                c_x[k] += weight * field.c_ext_um;
                c_abs[k] += weight * field.c_abs_um;
                let scale = weight * 2.0 / (PI * wave.k0()) / q as f64;
                let shift = (phi_i / step).round() as i64;
                for (j, power) in power[k * d..(k + 1) * d].iter_mut().enumerate() {
                    let first = shift + (j * q) as i64 - half;
                    for at in first..first + q as i64 {
                        let at = at.rem_euclid(n as i64) as usize;
                        *power += scale * (field.f_u[at].norm_sqr() + field.f_phi[at].norm_sqr());
                    }
                }
            }
        }
        if !done() {
            return Ok(false);
        }
    }
    for (k, powers) in power.chunks_exact(d).enumerate() {
        out.c_x_um[k] = c_x[k];
        out.c_abs_um[k] = c_abs[k];
        for (to, power) in out.azimuthal[k * d..(k + 1) * d].iter_mut().zip(powers) {
            *to = (power / c_x[k]) as f32;
        }
    }
    Ok(true)
}

/// All cells, shard by shard, into a table.
fn fill(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
    plan: &Plan,
    source: FiberSource,
    work: &Work<'_>,
) -> Result<FiberTable, SimError> {
    let (l, t, p, d) = (plan.lambda_um.len(), plan.theta_i.len(), plan.phi_i.len(), plan.relative);
    let parts = match run.parts {
        Some(folder) => Some(Parts::open(folder, run.resume, spec_text, &(source, fiber, options))?),
        None => None,
    };
    let never = AtomicBool::new(false);
    let stop = run.stop.unwrap_or(&never);
    let silent = |_: u64| {};
    let progress: &(dyn Fn(u64) + Sync) = run.progress.unwrap_or(&silent);
    let mut azimuthal = vec![0.0f32; l * t * p * d];
    let (mut c_x_um, mut c_abs_um) = (vec![0.0; l * t * p], vec![0.0; l * t * p]);
    // Shards of consecutive latitudes of one wavelength, each with its own stretch of the three arrays.
    let mut shards = Vec::new();
    let mut rest = (&mut azimuthal[..], &mut c_x_um[..], &mut c_abs_um[..]);
    for band in 0..l {
        for first in (0..t).step_by(SHARD) {
            let thetas = SHARD.min(t - first);
            let (a, more_a) = rest.0.split_at_mut(thetas * p * d);
            let (x, more_x) = rest.1.split_at_mut(thetas * p);
            let (b, more_b) = rest.2.split_at_mut(thetas * p);
            shards.push((band, first, a, x, b));
            rest = (more_a, more_x, more_b);
        }
    }
    let total = shards.len();
    let left = AtomicUsize::new(total);
    let solves = (plan.samples[0] * plan.samples[1]) as u64;
    let outcome = shards.into_par_iter().try_for_each(|(band, first, a, x, b)| {
        if stop.load(Ordering::Relaxed) {
            return Ok(());
        }
        if let Some(parts) = &parts
            && parts.read_fiber(band, first, a, [&mut *x, &mut *b])?
        {
            progress(solves * (x.len() / p) as u64);
            left.fetch_sub(1, Ordering::Relaxed);
            return Ok(());
        }
        let mut cells = a.chunks_exact_mut(p * d).zip(x.chunks_exact_mut(p)).zip(b.chunks_exact_mut(p)).enumerate();
        let whole = cells.try_fold(true, |whole, (m, ((azimuthal, c_x_um), c_abs_um))| {
            let done = || {
                progress(1);
                !stop.load(Ordering::Relaxed)
            };
            if !whole {
                return Ok(false);
            }
            work(band, first + m, Cell { azimuthal, c_x_um, c_abs_um }, &done)
        })?;
        // A stop that comes after the last solve of a shard leaves it whole.
        if whole {
            if let Some(parts) = &parts {
                parts.write_fiber(band, first, a, [&*x, &*b])?;
            }
            left.fetch_sub(1, Ordering::Relaxed);
        }
        Ok::<(), SimError>(())
    });
    outcome?;
    let left = left.into_inner();
    if left > 0 {
        return Err(SimError::Interrupted { left, total });
    }
    Ok(FiberTable {
        spec_text: spec_text.to_string(),
        program_version: env!("CARGO_PKG_VERSION").to_string(),
        preset: options.preset.clone(),
        seed: options.seed,
        source,
        symmetry: fiber.symmetry,
        beta_m: options.beta_m,
        lambda_um: plan.lambda_um.clone(),
        theta_i: plan.theta_i.clone(),
        phi_i: plan.phi_i.clone(),
        width_um: plan.width_um.clone(),
        c_x_um,
        c_abs_um,
        azimuthal,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wave::{C64, Scattered, SolverStats};
    use plywave::fiber::TabulatedFiber;
    use plywave::{Shape, YarnSpec, direction};
    use std::sync::atomic::AtomicU64;

    /// A made-up scatterer of the ellipse's symmetry whose powers are known in closed form: first order in a soft ellipse of Gaussian profile,
    /// `F = (k_0 a b) exp(-((a u)^2 + (b v)^2) / 4)` with (u, v) the change of the transverse wavevector, and what is scattered is extinguished, but
    /// for a tenth that is absorbed.
    struct Soft {
        wave: Wave,
        axes: [f64; 2],
    }

    impl Soft {
        fn amplitude(&self, phi_i: f64, phi_r: f64) -> f64 {
            let k = self.wave.k_rho();
            let [a, b] = self.axes;
            let (u, v) = (k * (phi_i.cos() + phi_r.cos()), k * (phi_i.sin() + phi_r.sin()));
            self.wave.k0() * a * b * (-0.25 * ((a * u).powi(2) + (b * v).powi(2))).exp()
        }

        /// Differential scattering width of unpolarized light [um/rad].
        fn width(&self, phi_i: f64, phi_r: f64) -> f64 {
            2.0 / (PI * self.wave.k0()) * self.amplitude(phi_i, phi_r).powi(2)
        }

        fn c_sca(&self, phi_i: f64) -> f64 {
            const N: usize = 4096;
            (0..N).map(|j| self.width(phi_i, TAU * j as f64 / N as f64)).sum::<f64>() * TAU / N as f64
        }
    }

    impl WaveSolver for Soft {
        fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
            Ok(sources
                .iter()
                .map(|source| {
                    let f = |j: usize| self.amplitude(source.phi_i, TAU * j as f64 / n_phi_out as f64);
                    // The polarizations scatter unlike amounts with the same mean.
                    let (tm, te) = (1.2f64.sqrt(), 0.8f64.sqrt());
                    let part = if source.pol == Polarization::Tm { tm } else { te };
                    let c_sca_um = part * part * self.c_sca(source.phi_i);
                    Scattered {
                        f_u: (0..n_phi_out).map(|j| C64::new(0.6 * part * f(j), 0.0)).collect(),
                        f_phi: (0..n_phi_out).map(|j| C64::new(0.0, 0.8 * part * f(j))).collect(),
                        c_sca_um,
                        c_abs_um: c_sca_um / 9.0,
                        c_ext_um: c_sca_um * 10.0 / 9.0,
                    }
                })
                .collect())
        }

        fn stats(&self) -> SolverStats {
            SolverStats { unknowns: 0, residual: 0.0, peak_bytes: 0 }
        }
    }

    fn soft(fiber: &SingleFiber, wave: &Wave, _: f64) -> Result<Solver, WaveError> {
        let axes = match fiber.body.shape {
            crate::wave::Shape::Ellipse { a_um, b_um } => [a_um, b_um],
            crate::wave::Shape::Circle { radius_um } => [radius_um; 2],
            _ => [1.0, 1.5],
        };
        Ok(Box::new(Soft { wave: *wave, axes }))
    }

    fn ellipse(a_um: f64, b_um: f64) -> SingleFiber {
        let mut spec = YarnSpec::polyester().unwrap().fiber;
        spec.shape = Shape::Ellipse { a_um, b_um };
        SingleFiber::of_spec(&spec, Absorption::Sigma(0.0))
    }

    fn small() -> TabulateOptions {
        TabulateOptions { lambdas: 3, thetas: 7, azimuths: 120, relative: 120, ..TabulateOptions::preview() }
    }

    #[test]
    fn nodes_hold_the_solver_s_powers() {
        let fiber = ellipse(0.5, 0.2);
        let table = tabulate_with(&fiber, "spec", &small(), Run::plain(), &soft).unwrap();
        assert_eq!((table.phi_i.len(), table.phi_r_count()), (31, 120));
        let mut slice = 0;
        for &lambda_um in &table.lambda_um {
            for &theta_i in &table.theta_i {
                let twin = Soft { wave: Wave { lambda_um, theta_i }, axes: [0.5, 0.2] };
                for &phi_i in &table.phi_i {
                    let want = twin.c_sca(phi_i) / 0.9 / theta_i.cos();
                    assert!((table.c_x_um[slice] / want - 1.0).abs() < 1e-12, "{} {want}", table.c_x_um[slice]);
                    assert!((table.c_abs_um[slice] / (0.1 * want) - 1.0).abs() < 1e-12);
                    for (j, got) in table.azimuthal[slice * 120..(slice + 1) * 120].iter().enumerate() {
                        let phi_r = phi_i + TAU * j as f64 / 120.0;
                        let want = 0.9 * twin.width(phi_i, phi_r) / twin.c_sca(phi_i);
                        assert!((f64::from(*got) - want).abs() < 1e-6, "{phi_i} {phi_r}: {got} {want}");
                    }
                    slice += 1;
                }
            }
        }
        assert!(table.ledger_error() < 1e-6, "{}", table.ledger_error());
    }

    /// Cells that average several solves and azimuths hold the power of all of them, and the loaded fiber gives it back at azimuths that are not stored.
    #[test]
    fn averages_keep_the_power_and_symmetry_the_rest() {
        let fiber = ellipse(3.0, 2.0);
        let options = TabulateOptions { lambdas: 2, thetas: 3, turns: 0.5, most_samples: 5, ..small() };
        let plan = Plan::new(&fiber, &options, FiberSource::Wave).unwrap();
        assert!(plan.fine >= 3 && plan.samples[0] > 1 && plan.samples[1] > 1, "{plan:?}");
        let table = tabulate_with(&fiber, "spec", &options, Run::plain(), &soft).unwrap();
        assert!(table.ledger_error() < 1e-5, "{}", table.ledger_error());
        let (p, d) = (table.phi_i.len(), table.phi_r_count());
        // Cell (1, 1, k) by hand.
        for k in [0, 7, p - 1] {
            let (mut c_x, mut n) = (0.0, vec![0.0; d]);
            let waves = plan.waves(&options, 1, 1);
            for wave in &waves {
                let twin = Soft { wave: *wave, axes: [3.0, 2.0] };
                for i in 0..plan.fine {
                    let shift = |i: usize| (i as f64 - (plan.fine / 2) as f64) / plan.fine as f64;
                    let phi_i = table.phi_i[k] + shift(i) * (table.phi_i[1] - table.phi_i[0]);
                    c_x += twin.c_sca(phi_i) / 0.9 / wave.theta_i.cos();
                    for (j, n) in n.iter_mut().enumerate() {
                        for m in 0..plan.fine {
                            let phi_r = phi_i + TAU * (j as f64 + shift(m)) / d as f64;
                            *n += twin.width(phi_i, phi_r) / wave.theta_i.cos() / plan.fine as f64;
                        }
                    }
                }
            }
            let slice = (3 + 1) * p + k;
            let got = table.c_x_um[slice];
            let want = c_x / (waves.len() * plan.fine) as f64;
            assert!((got / want - 1.0).abs() < 1e-12, "azimuth {k}: C_x {got}, want {want}");
            for j in 0..d {
                let (got, want) = (f64::from(table.azimuthal[slice * d + j]), n[j] / c_x);
                assert!((got - want).abs() < 1e-5 * (1.0 + want), "azimuth {k}, {j}: {got}, want {want}");
            }
        }
    }

    /// The loaded fiber at any azimuth against the closed form, through M_0 of the same width.
    #[test]
    fn loaded_fiber_gives_any_azimuth_back() {
        let fiber = ellipse(0.5, 0.2);
        let options = TabulateOptions { lambdas: 1, thetas: 1, azimuths: 360, relative: 360, ..small() };
        let table = tabulate_with(&fiber, "spec", &options, Run::plain(), &soft).unwrap();
        let wave = Wave { lambda_um: table.lambda_um[0], theta_i: table.theta_i[0] };
        let twin = Soft { wave, axes: [0.5, 0.2] };
        let loaded = TabulatedFiber::from_table(table).unwrap();
        let theta = wave.theta_i as f32;
        let mean = |phi_i: f32, phi_r: f32| {
            let at = loaded.at(&plywave::FiberQuery::new(direction(theta, phi_i), [0.5]));
            plywave::Bsdf::eval(&at, direction(-theta, phi_r))[0]
        };
        // M_0 at its peak from the mean over all azimuths, which is M_0 times the albedo over 2 pi.
        for k in 0..40 {
            let phi_i = 0.37 + 0.161 * f64::from(k);
            let all: f64 = (0..720).map(|j| f64::from(mean(phi_i as f32, TAU as f32 * j as f32 / 720.0))).sum::<f64>();
            let m_0 = all * TAU / 720.0 / 0.9;
            let peak = 0.9 * twin.width(phi_i, phi_i + PI) / twin.c_sca(phi_i);
            for j in 0..100 {
                let phi_r = 0.0631 * f64::from(j);
                let got = f64::from(mean(phi_i as f32, phi_r as f32)) / m_0;
                let want = 0.9 * twin.width(phi_i, phi_r) / twin.c_sca(phi_i);
                assert!((got - want).abs() < 2e-3 * peak, "{phi_i} {phi_r}: {got}, want {want}, peak {peak}");
            }
        }
    }

    #[test]
    fn threads_and_interruptions_change_nothing() {
        let fiber = ellipse(0.5, 0.2);
        let dir = tempfile::tempdir().unwrap();
        let parts = dir.path().join("f.parts");
        let want = tabulate_with(&fiber, "spec", &small(), Run::plain(), &soft).unwrap();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| tabulate_with(&fiber, "spec", &small(), Run::plain(), &soft)).unwrap(), want);
        let stop = AtomicBool::new(false);
        let count = AtomicU64::new(0);
        let halt = |n: u64| {
            if count.fetch_add(n, Ordering::Relaxed) >= 8 {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let run = Run { parts: Some(&parts), resume: false, stop: Some(&stop), progress: Some(&halt) };
        let stopped = tabulate_with(&fiber, "spec", &small(), run, &soft);
        let Err(SimError::Interrupted { left, total: 6 }) = stopped else { panic!("{stopped:?}") };
        assert!(left > 0);
        let before = std::fs::read_dir(&parts).unwrap().count() - 1;
        assert_eq!(before, 6 - left);
        let solved = AtomicU64::new(0);
        let counted = |fiber: &SingleFiber, wave: &Wave, tolerance: f64| {
            solved.fetch_add(1, Ordering::Relaxed);
            soft(fiber, wave, tolerance)
        };
        let total = AtomicU64::new(0);
        let add = |n: u64| {
            total.fetch_add(n, Ordering::Relaxed);
        };
        let run = Run { parts: Some(&parts), resume: true, stop: None, progress: Some(&add) };
        assert_eq!(tabulate_with(&fiber, "spec", &small(), run, &counted).unwrap(), want);
        assert!(solved.into_inner() < 21, "nothing was taken up");
        assert_eq!(total.into_inner(), tabulate_slices(&fiber, &small(), FiberSource::Wave).unwrap());
        // Another fiber does not take these parts up.
        let run = Run { parts: Some(&parts), resume: true, stop: None, progress: None };
        assert!(tabulate_with(&ellipse(0.5, 0.3), "spec", &small(), run, &soft).is_err());
    }

    /// A smooth circle's rays: nothing is lost, the width is the diameter, and what is absorbed has a closed form: all chords of a path are equally long, so
    /// that with Fresnel's R, T = 1 - R and the transmittance x of a chord `R + T^2 x / (1 - R x)` leaves.
    #[test]
    fn rays_keep_their_energy() {
        let mut spec = YarnSpec::polyester().unwrap().fiber;
        spec.alpha_fiber = 0.0;
        spec.shape = Shape::Circle { radius_um: 0.7 };
        let rays = 100_000;
        let options = TabulateOptions { rays, relative: 36, azimuths: 36, thetas: 3, ..small() };
        let clear = SingleFiber::of_spec(&spec, Absorption::Sigma(0.0));
        let table = tabulate_rays(&clear, "spec", &options, Run::plain()).unwrap();
        assert_eq!((table.lambda_um.len(), table.phi_i.len(), table.source), (1, 1, FiberSource::Ray));
        assert!(table.ledger_error() < 1e-6, "{}", table.ledger_error());
        assert!(table.c_x_um.iter().all(|c| (c - 1.4).abs() < 1e-12));
        let dark = SingleFiber::of_spec(&spec, Absorption::Sigma(1.0));
        let table = tabulate_rays(&dark, "spec", &options, Run::plain()).unwrap();
        assert!(table.ledger_error() < 1e-6);
        for (m, theta_i) in table.theta_i.iter().enumerate() {
            let n = 20_000;
            let (mut want, mut variance) = (0.0, 0.0);
            for k in 0..n {
                let h = 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
                let eta = (spec.eta.powi(2) - theta_i.sin().powi(2)).sqrt() / theta_i.cos();
                let cos_t = (1.0 - (theta_i.sin() / spec.eta).powi(2)).sqrt();
                let cos_wall = theta_i.cos() * (1.0 - h * h).sqrt();
                let r = f64::from(crate::fresnel(cos_wall as f32, spec.eta as f32).0);
                let length = 2.0 * 0.7 * (1.0 - (h / eta).powi(2)).sqrt() / cos_t;
                let x = (-length).exp();
                let out = r + (1.0 - r).powi(2) * x / (1.0 - r * x);
                want += (1.0 - out) / f64::from(n);
                // Where the path goes is chance, with a result between 0 and 1.
                variance += out * (1.0 - out) / f64::from(n);
            }
            let got = table.c_abs_um[m] / table.c_x_um[m];
            let tolerance = 5.0 * (variance / rays as f64).sqrt();
            assert!(
                (got - want).abs() < tolerance,
                "theta_i {theta_i}: absorbed {got}, want {want} within {tolerance}"
            );
        }
    }

    #[test]
    fn sizes_follow_symmetry_and_band_limit() {
        let polyester = YarnSpec::polyester().unwrap().fiber;
        let sizes = |shape: Shape| {
            let fiber =
                SingleFiber::of_spec(&plywave::FiberSpec { shape, ..polyester.clone() }, Absorption::Sigma(0.0));
            let plan = Plan::new(&fiber, &TabulateOptions::standard(), FiberSource::Wave).unwrap();
            (plan.phi_i.len(), plan.relative, plan.fine)
        };
        assert_eq!(sizes(Shape::Circle { radius_um: 7.5 }), (1, 360, 3));
        assert_eq!(sizes(Shape::Ellipse { a_um: 1.6, b_um: 1.0 }), (91, 360, 1));
        assert_eq!(sizes(Shape::Ellipse { a_um: 16.0, b_um: 10.0 }), (91, 360, 5));
        assert_eq!(sizes(Shape::Trilobal { radius_um: 5.0, depth: 0.2 }).0, 61);
        assert_eq!(sizes(Shape::Kidney { a_um: 8.0, b_um: 5.0, dent: 0.3, lumen: 0.2 }).0, 181);
        let triangle = vec![[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]];
        let polygon = Shape::Polygon { file: String::new(), points_um: triangle, rounding_um: 0.3 };
        assert_eq!(sizes(polygon).0, 360);
        // Few harmonics need few azimuths.
        let (phi_i, relative, fine) = sizes(Shape::Ellipse { a_um: 0.1, b_um: 0.05 });
        assert!(phi_i < 40 && relative < 160 && fine == 1, "{phi_i} {relative} {fine}");
        // Teeth: 7 * 2 does not divide 360.
        let (phi_i, relative, _) = sizes(Shape::Serrated { radius_um: 5.0, depth: 0.1, teeth: 7 });
        assert_eq!((phi_i, relative), (25, 336));
    }
}
