//! Tables of one fiber as in Xia 2020, 5: N_wave and C_x over wavelength, latitude and azimuth, by waves or
//! by rays.
//!
//! A table's cell covers a band of wavelengths and of latitudes, within which the far field of a large fiber
//! beats many times. So each cell averages enough solves that the phase of the light's longest path, there
//! and back across the fiber, changes by less than a set number of turns from solve to solve (Xia samples
//! until renderings no longer change). The averaged quantities are powers: differential widths and C_x; N is
//! their quotient. Azimuths follow the band limit: a far field of harmonics |m| <= M has an intensity of
//! harmonics up to 2 M, whose sums over more than 4 M azimuths are exact; more azimuths than the table stores
//! are averaged.
//!
//! The powers of TM and TE light are averaged with equal weights, so that N is that of unpolarized light.
//!
//! Work is cut into shards, a few latitudes of one wavelength each, that depend on their index alone; the
//! table does not depend on threads or interruptions.

use crate::jobs::rays::RaySlice;
use crate::jobs::scatter::solver_of;
use crate::{Absorption, Polarization, SingleFiber, Source, Wave, WaveError, WaveSolver, check_walls};
use plywave_fiber::{FiberSource, FiberTable};
use plywave_runs::RunError;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards, Values};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::atomic::{AtomicBool, Ordering};

/// Sizes of a fiber table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TabulateOptions {
    /// Name of the preset that the options started from, for the record.
    pub preset: String,
    /// Ends of the spectrum [um].
    pub lambda_um: [f64; 2],
    /// Bands of wavelength.
    pub lambdas: usize,
    /// Latitudes.
    pub thetas: usize,
    /// Maximum number of azimuths phi_i around the fiber.
    pub azimuths: usize,
    /// Maximum number of relative azimuths.
    pub relative: usize,
    /// Maximum difference of phase between two solves of a cell [turns].
    pub turns: f64,
    /// Maximum number of solves of a cell along either axis.
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
    /// Preset for a first look at a fiber.
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

    /// Preset with the sizes of Xia 2020, 5.2.1.
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

    /// Preset with the same sizes, each cell averaged over more solves.
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

    /// The preset of this name: "preview", "standard" or "reference".
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "preview" => Some(Self::preview()),
            "standard" => Some(Self::standard()),
            "reference" => Some(Self::reference()),
            _ => None,
        }
    }
}

/// Maximum size of a table, in values of the azimuthal function: that of a fiber without symmetry at Xia's
/// sizes.
const MAX_VALUES: f64 = 7e8;
/// Latitudes of a shard.
const SHARD: usize = 5;

/// Axes and sampling of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    pub(crate) lambda_um: Vec<f64>,
    pub(crate) theta_i: Vec<f64>,
    pub(crate) phi_i: Vec<f64>,
    width_um: Vec<f64>,
    /// D.
    pub(crate) relative: usize,
    /// Number of solved azimuths per stored one, along phi_i and along phi_r; odd.
    pub(crate) fine: usize,
    /// Number of solves of a cell along lambda and theta_i.
    pub(crate) samples: [usize; 2],
}

impl Plan {
    pub(crate) fn new(fiber: &SingleFiber, options: &TabulateOptions, source: FiberSource) -> Result<Plan, RunError> {
        let radius = fiber.bound_um()?;
        let [first, last] = options.lambda_um;
        if !(first > 0.0 && last >= first && last.is_finite()) {
            let value = format!("{first} to {last}");
            let hint = "give two wavelengths above 0, the shorter first".to_string();
            return Err(WaveError::Invalid { key: "lambda_um".into(), value, hint }.into());
        }
        // Rays depend on wavelength by absorption alone.
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
        // Linear interpolation needs several nodes per period; a fiber of few harmonics needs no more.
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
            return Err(plywave_sim::SimError::TooLarge { cells: values, allowed: MAX_VALUES }.into());
        }
        // The phase of light paths 4 eta R long (across and back) turns by 4 eta R band / lambda^2, those of
        // 4 R by 4 R dtheta / lambda.
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

    /// Total number of solves (or traced slices' latitudes).
    fn solves(&self) -> usize {
        self.lambda_um.len() * self.theta_i.len() * self.samples[0] * self.samples[1]
    }

    /// The solves of cell (l, m).
    pub(crate) fn waves(&self, options: &TabulateOptions, l: usize, m: usize) -> Vec<Wave> {
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

/// Highest harmonic of a far field from within `x` = k R of the center: beyond x they fall as an Airy
/// function of width x^(1/3); an amplitude of 1e-5 lies about 4 widths out.
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

/// Total number of solves that a run reports through `progress`.
///
/// # Errors
/// The errors of [`tabulate_with`] that occur before any solve.
pub fn tabulate_slices(fiber: &SingleFiber, options: &TabulateOptions, source: FiberSource) -> Result<u64, RunError> {
    Ok(Plan::new(fiber, options, source)?.solves() as u64)
}

/// Solver of a prepared body.
pub type Solver = Box<dyn WaveSolver>;
/// Constructor of a fiber's solver for a wave, to a tolerance.
pub type MakeSolver<'a> = dyn Fn(&SingleFiber, &Wave, f64) -> Result<Solver, WaveError> + Sync + 'a;

/// Computes the table of `fiber` by wave optics with the solvers of `solver`; `spec_text` is kept in the
/// table. Progress counts solves.
///
/// # Errors
/// [`RunError::TooLarge`], [`RunError::Wave`] from the solver, [`RunError::Interrupted`], errors of the parts
/// folder.
pub fn tabulate_with(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
    solver: &MakeSolver<'_>,
) -> Result<FiberTable, RunError> {
    runs::run(&TabulateJob::with_solver(fiber, spec_text, options, solver)?, run)
}

/// Computes the table of `fiber` by wave optics with the cheapest solver: series for circles, boundary
/// integrals for all other shapes.
///
/// # Errors
/// The errors of [`tabulate_with`], and errors of the fiber's walls.
pub fn tabulate(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
) -> Result<FiberTable, RunError> {
    runs::run(&TabulateJob::new(fiber, spec_text, options, FiberSource::Wave)?, run)
}

/// Computes the table of `fiber` by ray optics on the same axes and cells, with geometric widths. Progress
/// counts latitudes.
///
/// # Errors
/// The errors of [`tabulate_with`].
pub fn tabulate_rays(
    fiber: &SingleFiber,
    spec_text: &str,
    options: &TabulateOptions,
    run: Run<'_>,
) -> Result<FiberTable, RunError> {
    runs::run(&TabulateJob::new(fiber, spec_text, options, FiberSource::Ray)?, run)
}

/// Input of a fiber table's shards, beside the text.
#[derive(Serialize, Deserialize)]
struct Identity {
    rays: bool,
    /// Absorption of a yarn spec's fiber [1/um]; scenes have their own.
    sigma_per_um: f64,
    /// The whole fiber, as a fiber may be built in code.
    fiber: String,
    options: TabulateOptions,
}

/// Method of computing the cells of a table.
enum Method<'a> {
    Wave(&'a MakeSolver<'a>),
    Ray(Box<RaySlice>),
}

/// A fiber table as a job: a shard is a run of latitudes of one wavelength, latitudes within wavelengths.
pub struct TabulateJob<'a> {
    fiber: SingleFiber,
    spec_text: String,
    options: TabulateOptions,
    plan: Plan,
    method: Method<'a>,
}

/// The cheapest solver for the fiber.
fn cheapest(fiber: &SingleFiber, wave: &Wave, tolerance: f64) -> Result<Solver, WaveError> {
    solver_of(&[fiber.at(wave.lambda_um)], wave, tolerance)
}

impl TabulateJob<'static> {
    /// The job of `fiber`, whose spec or scene has the text `spec_text`, by waves or by rays.
    ///
    /// # Errors
    /// Errors of the fiber's walls, [`RunError::TooLarge`].
    pub fn new(
        fiber: &SingleFiber,
        spec_text: &str,
        options: &TabulateOptions,
        source: FiberSource,
    ) -> Result<Self, RunError> {
        if source == FiberSource::Wave {
            check_walls(std::slice::from_ref(&fiber.body))?;
            return TabulateJob::with_solver(fiber, spec_text, options, &cheapest);
        }
        Ok(TabulateJob {
            plan: Plan::new(fiber, options, FiberSource::Ray)?,
            method: Method::Ray(Box::new(RaySlice::new(fiber)?)),
            fiber: fiber.clone(),
            spec_text: spec_text.into(),
            options: options.clone(),
        })
    }

    /// The job of a description.
    ///
    /// # Errors
    /// [`RunError::Merge`] and those of the spec or scene.
    pub fn from_description(description: &Description) -> Result<Self, RunError> {
        let Identity { rays, sigma_per_um, options, .. } = description.parse_options()?;
        let fiber = SingleFiber::parse(&description.spec, "the part's spec", sigma_per_um)?;
        let source = if rays { FiberSource::Ray } else { FiberSource::Wave };
        TabulateJob::new(&fiber, &description.spec, &options, source)
    }
}

impl<'a> TabulateJob<'a> {
    fn with_solver(
        fiber: &SingleFiber,
        spec_text: &str,
        options: &TabulateOptions,
        solver: &'a MakeSolver<'a>,
    ) -> Result<Self, RunError> {
        Ok(TabulateJob {
            plan: Plan::new(fiber, options, FiberSource::Wave)?,
            method: Method::Wave(solver),
            fiber: fiber.clone(),
            spec_text: spec_text.into(),
            options: options.clone(),
        })
    }

    /// Wavelength, first latitude and number of latitudes of a shard.
    fn place(&self, shard: usize) -> (usize, usize, usize) {
        let latitudes = self.plan.theta_i.len();
        let per_band = latitudes.div_ceil(SHARD);
        let first = shard % per_band * SHARD;
        (shard / per_band, first, SHARD.min(latitudes - first))
    }

    /// Fills the cell of wavelength `l` and latitude `m`; false when stopped.
    fn cell(&self, l: usize, m: usize, out: Cell<'_>, done: &dyn Fn() -> bool) -> Result<bool, RunError> {
        let (plan, options, fiber) = (&self.plan, &self.options, &self.fiber);
        let slice = match &self.method {
            Method::Wave(solver) => {
                let waves = plan.waves(options, l, m);
                return wave_cell(plan, &waves, out, done, &|wave| solver(fiber, wave, options.tolerance));
            }
            Method::Ray(slice) => slice,
        };
        let sigma = fiber.absorption.sigma_per_um(plan.lambda_um[l]);
        for (p, phi_i) in plan.phi_i.iter().enumerate() {
            let bins = &mut out.azimuthal[p * plan.relative..(p + 1) * plan.relative];
            // The same rays at every wavelength: only absorption differs.
            let place = [m as u64, p as u64];
            let absorbed = slice.trace([plan.theta_i[m], *phi_i], sigma, options.rays, options.seed, place, bins);
            out.c_x_um[p] = plan.width_um[p];
            out.c_abs_um[p] = plan.width_um[p] * absorbed;
        }
        Ok(done())
    }
}

/// The arrays of a table.
pub struct Arrays {
    azimuthal: Vec<f32>,
    c_x_um: Vec<f64>,
    c_abs_um: Vec<f64>,
}

impl Arrays {
    fn new(cells: usize, p: usize, d: usize) -> Arrays {
        Arrays { azimuthal: vec![0.0; cells * p * d], c_x_um: vec![0.0; cells * p], c_abs_um: vec![0.0; cells * p] }
    }
}

impl Shards for TabulateJob<'_> {
    fn description(&self) -> Description {
        let sigma_per_um = match self.fiber.absorption {
            Absorption::Sigma(sigma) => sigma,
            Absorption::Kappa(_) => 0.0,
        };
        let identity = Identity {
            rays: matches!(self.method, Method::Ray(_)),
            sigma_per_um,
            fiber: format!("{:?}", self.fiber),
            options: self.options.clone(),
        };
        Description::new("tabulate", &identity, &self.spec_text)
    }

    fn shards(&self) -> usize {
        self.plan.lambda_um.len() * self.plan.theta_i.len().div_ceil(SHARD)
    }

    fn units(&self, shard: usize) -> u64 {
        (self.plan.samples[0] * self.plan.samples[1] * self.place(shard).2) as u64
    }

    fn layout(&self, shard: usize) -> Vec<ArrayLayout> {
        let (thetas, p) = (self.place(shard).2, self.plan.phi_i.len());
        // With waves an absorption may be below 0 by the solver's tolerance; a far field is never below 0.
        vec![
            ArrayLayout::f32("azimuthal", &[thetas, p, self.plan.relative], [0.0, f64::from(f32::MAX)]),
            ArrayLayout::f64("c_x_um", &[thetas, p], [f64::MIN_POSITIVE, f64::MAX]),
            ArrayLayout::f64("c_abs_um", &[thetas, p], [f64::MIN, f64::MAX]),
        ]
    }

    fn shard_bytes(&self) -> Option<usize> {
        Some(8 * SHARD * self.plan.phi_i.len() * self.plan.relative)
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let (band, first, thetas) = self.place(shard);
        let (p, d) = (self.plan.phi_i.len(), self.plan.relative);
        let mut arrays = Arrays::new(thetas, p, d);
        let done = || {
            progress(1);
            !stop.load(Ordering::Relaxed)
        };
        for m in 0..thetas {
            let cell = Cell {
                azimuthal: &mut arrays.azimuthal[m * p * d..][..p * d],
                c_x_um: &mut arrays.c_x_um[m * p..][..p],
                c_abs_um: &mut arrays.c_abs_um[m * p..][..p],
            };
            if !self.cell(band, first + m, cell, &done)? {
                return Ok(None);
            }
        }
        let Arrays { azimuthal, c_x_um, c_abs_um } = arrays;
        let part = Part::new(vec![Values::F32(azimuthal), Values::F64(c_x_um), Values::F64(c_abs_um)]);
        Ok(Some(Done { part, peak_bytes: 0 }))
    }
}

impl Job for TabulateJob<'_> {
    type Output = FiberTable;
    type Merge = Arrays;

    fn begin(&self) -> Arrays {
        let plan = &self.plan;
        Arrays::new(plan.lambda_um.len() * plan.theta_i.len(), plan.phi_i.len(), plan.relative)
    }

    fn absorb(&self, to: &mut Arrays, shard: usize, part: Part) {
        let (band, first, thetas) = self.place(shard);
        let (p, d) = (self.plan.phi_i.len(), self.plan.relative);
        let at = (band * self.plan.theta_i.len() + first) * p;
        to.azimuthal[at * d..][..thetas * p * d].copy_from_slice(part.f32(0));
        to.c_x_um[at..][..thetas * p].copy_from_slice(part.f64(1));
        to.c_abs_um[at..][..thetas * p].copy_from_slice(part.f64(2));
    }

    fn finish(&self, arrays: Arrays) -> Result<FiberTable, RunError> {
        let (plan, options) = (&self.plan, &self.options);
        let Arrays { azimuthal, c_x_um, c_abs_um } = arrays;
        Ok(FiberTable {
            spec_text: self.spec_text.clone(),
            program_version: env!("CARGO_PKG_VERSION").to_string(),
            preset: options.preset.clone(),
            seed: options.seed,
            source: if matches!(self.method, Method::Ray(_)) { FiberSource::Ray } else { FiberSource::Wave },
            symmetry: self.fiber.symmetry,
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
}

/// Output slices of one cell's results: `[P][D]`, `[P]`, `[P]`.
struct Cell<'a> {
    azimuthal: &'a mut [f32],
    c_x_um: &'a mut [f64],
    c_abs_um: &'a mut [f64],
}

/// Averages of the cell's solves; calls `done` after each, which returns whether to continue. False when
/// stopped.
fn wave_cell(
    plan: &Plan,
    waves: &[Wave],
    out: Cell<'_>,
    done: &dyn Fn() -> bool,
    solver: &dyn Fn(&Wave) -> Result<Solver, WaveError>,
) -> Result<bool, RunError> {
    let (p, d, q) = (plan.phi_i.len(), plan.relative, plan.fine);
    let n = d * q;
    let half = (q / 2) as i64;
    // Azimuths are on the grid of n: a node every `stride q` steps, its samples `stride` steps apart around
    // it.
    let step = TAU / n as f64;
    let round = plan.phi_i.len() == 1;
    let stride = if round { 0.0 } else { ((plan.phi_i[1] - plan.phi_i[0]) / (TAU / d as f64)).round() };
    let offsets: Vec<f64> = if round { vec![0.0] } else { (-half..=half).map(|k| k as f64 * stride * step).collect() };
    let mut power = vec![0.0; p * d];
    let (mut c_x, mut c_abs) = (vec![0.0; p], vec![0.0; p]);
    for wave in waves {
        let solver = solver(wave)?;
        // Sources are solved in batches whose amplitudes stay below about 64 MiB.
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
