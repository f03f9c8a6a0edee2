//! Patterns of single fibers for the statistics of speckle (Yu 2025, 6.2): many instances of one fiber, drawn
//! with the spec's jitter and rotated at random, each under the same wide beam, clear and absorbing, at
//! several wavelengths.
//!
//! One instance is one shard. Instance i is the same fiber whatever the number of instances. Only the
//! scattered field's power is stored, without the beam: `2/(pi k_0) |F|^2`, the scattering width per azimuth.

use crate::jobs::scatter::solver_of;
use crate::jobs::total_field::azimuths;
use crate::{BeamSource, Body, Polarization, Source, Wave, WaveError, check_ledger, fiber_body};
use plywave::spec::{FiberSpec, SODIUM_UM, YarnSpec};
use plywave_runs::RunError;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards, Values};
use plywave_sim::SimError;
use plywave_sim::seeds::instance_seed;
use plywave_sim::shape;
use plywave_tables::speckle::SpecklePatterns;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::atomic::{AtomicBool, Ordering};

/// Sizes of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeckleOptions {
    /// Instances of the fiber.
    pub instances: u32,
    /// Seed of the instances.
    pub seed: u64,
    /// Wavelengths [um], ascending.
    pub lambda_um: Vec<f64>,
    /// Imaginary indices, clear first.
    pub kappa: Vec<f64>,
    /// Latitude of the incidence [rad].
    pub theta_i: f64,
    /// Waist of the beam [um].
    pub w0_um: f64,
    /// Error of the solver's far field.
    pub tolerance: f64,
}

impl Default for SpeckleOptions {
    fn default() -> Self {
        SpeckleOptions {
            instances: 200,
            seed: 1,
            lambda_um: vec![0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7],
            // At 0.05 a path of 15 um keeps e^-24 of its light at 0.4 um and e^-13 at 0.7, and the
            // reflectance of a fiber of index 1.55 grows by 1 %.
            kappa: vec![0.0, 0.05],
            theta_i: 0.0,
            w0_um: 100.0,
            tolerance: 1e-5,
        }
    }
}

impl SpeckleOptions {
    /// The options that a shard depends on; others allow a longer run.
    fn of_a_shard(&self) -> Self {
        SpeckleOptions { instances: 0, ..self.clone() }
    }

    fn wave(&self, lambda_um: f64) -> Wave {
        Wave { lambda_um, theta_i: self.theta_i }
    }

    fn source(&self, pol: Polarization) -> Source {
        Source { phi_i: FRAC_PI_2, pol, beam: Some(BeamSource { w0_um: self.w0_um, h_um: 0.0 }) }
    }
}

/// A solved fiber.
struct Instance<'a> {
    of: &'a FiberSpec,
    /// Clear body about the origin, rotated at random, with its index at the sodium line.
    body: Body,
    /// Radius of the circle that contains it [um].
    radius_um: f64,
    /// Absorption of its material and of its core, relative to the requested one.
    dye: [f64; 2],
}

/// The fiber of instance `i`.
fn fiber(spec: &YarnSpec, seed: u64, i: u32) -> Result<Instance<'_>, RunError> {
    // A stream separate from that of sections.
    let mut rng = Pcg64Mcg::seed_from_u64(instance_seed(seed, i) ^ 0x5bec_c1e5_0000_0000);
    let second = spec.blend.as_ref().filter(|blend| rng.random::<f64>() < blend.share);
    let of = second.map_or(&spec.fiber, |blend| &blend.fiber);
    let mut section = shape::draw(of, &mut rng)?;
    section.angle_rad = rng.random_range(0.0..TAU);
    let radius_um = section.outer.bounding_radius();
    let mut body = fiber_body(&section, of.eta_at(SODIUM_UM), 0.0)?;
    let [core_eta, core_dye] = of.shape.core();
    if let Some(core) = body.lumen.as_deref_mut() {
        core.eta = core_eta;
    }
    let dye = second.map_or(1.0, |blend| blend.dye);
    Ok(Instance { of, body, radius_um, dye: [dye, dye * core_dye] })
}

/// Azimuths of the patterns: those needed at the shortest wavelength by the fiber of the spec, a third
/// larger, in steps of half a degree or an integer fraction of it.
fn grid(spec: &YarnSpec, options: &SpeckleOptions) -> Result<usize, RunError> {
    let radius = fiber(spec, options.seed, 0)?.radius_um;
    let wave = options.wave(options.lambda_um.iter().copied().fold(f64::INFINITY, f64::min));
    let plane = Source { phi_i: FRAC_PI_2, pol: Polarization::Tm, beam: None };
    Ok(azimuths(&wave, &plane, 4.0 / 3.0 * radius, 720))
}

/// Patterns of the fibers of `spec`, whose text is kept, on the current thread pool. Progress counts
/// instances.
///
/// # Errors
/// Errors of the outlines, the solvers ([`RunError::Wave`]) and the parts folder; [`RunError::Interrupted`].
pub fn speckle(
    spec: &YarnSpec,
    spec_text: &str,
    options: &SpeckleOptions,
    run: Run<'_>,
) -> Result<SpecklePatterns, RunError> {
    runs::run(&SpeckleJob::new(spec, spec_text, options)?, run)
}

/// Speckle patterns as a job: shard i is instance i.
pub struct SpeckleJob {
    spec: YarnSpec,
    spec_text: String,
    options: SpeckleOptions,
    azimuths: usize,
}

impl SpeckleJob {
    /// The job of `spec`, whose text is `spec_text`.
    ///
    /// # Errors
    /// Beams that are too narrow and outlines that cannot be built ([`RunError::Wave`]),
    /// [`RunError::TooLarge`], [`RunError::Option`] for no instance.
    pub fn new(spec: &YarnSpec, spec_text: &str, options: &SpeckleOptions) -> Result<SpeckleJob, RunError> {
        if options.instances == 0 {
            return Err(SimError::Option { name: "instances", value: 0, allowed: "1 or more" }.into());
        }
        spec.fibers().try_for_each(WaveError::if_scatters)?;
        for &lambda_um in &options.lambda_um {
            options.source(Polarization::Tm).plane_waves(&options.wave(lambda_um), 0.0)?;
        }
        let azimuths = grid(spec, options)?;
        let job = SpeckleJob { spec: spec.clone(), spec_text: spec_text.into(), options: options.clone(), azimuths };
        // At most 1 GiB of the file's patterns.
        const MAX: f64 = 2.7e8;
        let cells = job.kinds() as f64 * f64::from(options.instances) * azimuths as f64;
        if cells > MAX {
            return Err(SimError::TooLarge { cells, allowed: MAX }.into());
        }
        Ok(job)
    }

    /// The job of a description and a number of instances.
    ///
    /// # Errors
    /// [`RunError::Merge`] and those of the spec.
    pub fn from_description(description: &Description, instances: u64) -> Result<SpeckleJob, RunError> {
        let options: SpeckleOptions = description.parse_options()?;
        let spec = YarnSpec::parse(&description.spec, "the part's spec")?;
        let instances = u32::try_from(instances).unwrap_or(u32::MAX);
        SpeckleJob::new(&spec, &description.spec, &SpeckleOptions { instances, ..options })
    }

    /// Number of combinations of absorption, wavelength and polarization.
    fn kinds(&self) -> usize {
        self.options.kappa.len() * self.options.lambda_um.len() * 2
    }
}

impl Shards for SpeckleJob {
    fn description(&self) -> Description {
        Description::new("speckle", &self.options.of_a_shard(), &self.spec_text)
    }

    fn shards(&self) -> usize {
        self.options.instances as usize
    }

    fn extent(&self) -> u64 {
        u64::from(self.options.instances)
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        let (a, l) = (self.options.kappa.len(), self.options.lambda_um.len());
        vec![
            ArrayLayout::f32("patterns", &[a, l, 2, self.azimuths], [0.0, f64::from(f32::MAX)]),
            // C_sca and C_abs; the latter is 0 up to rounding for clear fibers.
            ArrayLayout::f64("widths", &[a, l, 2, 2], [f64::MIN, f64::MAX]),
        ]
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let options = &self.options;
        let Instance { of, body: clear, dye, .. } = fiber(&self.spec, options.seed, shard as u32)?;
        let (mut patterns, mut widths) = (Vec::new(), Vec::new());
        let mut peak_bytes = 0;
        let sources = [Polarization::Tm, Polarization::Te].map(|pol| options.source(pol));
        for &kappa in &options.kappa {
            for &lambda_um in &options.lambda_um {
                if stop.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                let wave = options.wave(lambda_um);
                // Opaque fibers are the same whatever the absorption.
                let own = if of.is_opaque() { of.kappa_at(lambda_um) } else { dye[0] * kappa };
                let mut body = Body { eta: of.eta_at(lambda_um), kappa: own, ..clear.clone() };
                if let Some(core) = body.lumen.as_deref_mut() {
                    core.kappa = dye[1] * kappa;
                }
                let bodies = [body];
                let solver = solver_of(&bodies, &wave, options.tolerance)?;
                let scattered = solver.scatter(&sources, self.azimuths)?;
                let stats = solver.stats();
                // Written this way, a NaN fails the check.
                let solved = stats.residual <= options.tolerance;
                if !solved {
                    return Err(WaveError::NotConverged { residual: stats.residual, iterations: 1 }.into());
                }
                peak_bytes = peak_bytes.max(stats.peak_bytes);
                for scattered in &scattered {
                    check_ledger(&wave, options.tolerance, &bodies, scattered)?;
                    let scale = 2.0 / (PI * wave.k0());
                    let power = |j: usize| scale * (scattered.f_u[j].norm_sqr() + scattered.f_phi[j].norm_sqr());
                    patterns.extend((0..self.azimuths).map(|j| power(j) as f32));
                    widths.extend([scattered.c_sca_um, scattered.c_abs_um]);
                }
            }
        }
        progress(1);
        Ok(Some(Done { part: Part::new(vec![Values::F32(patterns), Values::F64(widths)]), peak_bytes }))
    }
}

impl Job for SpeckleJob {
    type Output = SpecklePatterns;
    type Merge = Vec<Part>;

    fn begin(&self) -> Vec<Part> {
        Vec::new()
    }

    fn absorb(&self, parts: &mut Vec<Part>, _: usize, part: Part) {
        parts.push(part);
    }

    fn finish(&self, parts: Vec<Part>) -> Result<SpecklePatterns, RunError> {
        let (kinds, n, d, options) = (self.kinds(), parts.len(), self.azimuths, &self.options);
        let mut patterns = Vec::with_capacity(kinds * n * d);
        let (mut c_sca_um, mut c_abs_um) = (Vec::with_capacity(kinds * n), Vec::with_capacity(kinds * n));
        for kind in 0..kinds {
            for part in &parts {
                patterns.extend_from_slice(&part.f32(0)[kind * d..][..d]);
                c_sca_um.push(part.f64(1)[2 * kind]);
                c_abs_um.push(part.f64(1)[2 * kind + 1]);
            }
        }
        Ok(SpecklePatterns {
            spec_text: self.spec_text.clone(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            seed: options.seed,
            theta_i: options.theta_i,
            w0_um: options.w0_um,
            kappa: options.kappa.clone(),
            lambda_um: options.lambda_um.clone(),
            instances: n,
            azimuths: d,
            patterns,
            c_sca_um,
            c_abs_um,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plywave::Document;
    use plywave_runs::{Found, PartsFolder};
    use plywave_tables::speckle::{SpecklePolarization, SpeckleSide};
    use std::sync::atomic::AtomicU64;

    const SPEC: &str = "name = \"s\"\n[fiber]\nshape = { kind = \"ellipse\", a_um = 1.6, b_um = 1.0 }\nsize_jitter = 0.1\nshape_jitter = 0.1\neta = 1.5\n\
        alpha_fiber = 0.2\n[ply]\nfibers = 1\nradius_um = 4.0\n";

    fn options() -> SpeckleOptions {
        SpeckleOptions { instances: 4, lambda_um: vec![0.5, 0.7], w0_um: 20.0, ..SpeckleOptions::default() }
    }

    /// The patterns hold the energy of the ledger; clear fibers absorb nothing, dark ones do; instances
    /// differ.
    #[test]
    fn patterns_hold_the_scattered_power() {
        let spec = YarnSpec::parse(SPEC, "s.toml").unwrap();
        let p = speckle(&spec, SPEC, &options(), Run::plain()).unwrap();
        assert_eq!((p.instances, p.azimuths % 720), (4, 0));
        for a in 0..2 {
            for l in 0..2 {
                for pol in 0..2 {
                    for i in 0..4 {
                        let at = ((a * 2 + l) * 2 + pol) * 4 + i;
                        let sum: f64 = p.pattern(a, l, pol, i).iter().map(|v| f64::from(*v)).sum();
                        let sum = sum * TAU / p.azimuths as f64;
                        assert!((sum / p.c_sca_um[at] - 1.0).abs() < 1e-5, "{sum} {}", p.c_sca_um[at]);
                        let absorbed = p.c_abs_um[at];
                        assert!(if a == 0 { absorbed.abs() < 1e-3 } else { absorbed > 0.2 }, "{a}: {absorbed}");
                    }
                }
            }
        }
        assert!(p.statistics(0, 0, SpecklePolarization::Tm, SpeckleSide::All).contrast > 0.1);
        p.save(tempfile::tempdir().unwrap().path().join("s.pws")).unwrap();
    }

    /// A wide beam is a plane wave to the fiber: a circle without jitter gives the same pattern in every
    /// instance, that of its series.
    #[test]
    fn wide_beams_are_plane_waves() {
        let text = SPEC.replace("kind = \"ellipse\", a_um = 1.6, b_um = 1.0", "kind = \"circle\", radius_um = 1.5");
        let text = text.replace("jitter = 0.1", "jitter = 0.0");
        let spec = YarnSpec::parse(&text, "c.toml").unwrap();
        let options = SpeckleOptions { instances: 2, w0_um: 300.0, ..options() };
        let p = speckle(&spec, &text, &options, Run::plain()).unwrap();
        let body = fiber(&spec, 1, 0).unwrap().body;
        let wave = Wave { lambda_um: 0.7, theta_i: 0.0 };
        let plane = Source { beam: None, ..options.source(Polarization::Te) };
        let want = &solver_of(&[body], &wave, 1e-8).unwrap().scatter(&[plane], p.azimuths).unwrap()[0];
        let top = want.f_phi.iter().map(|f| f.norm_sqr()).fold(0.0, f64::max) * 2.0 / (PI * wave.k0());
        for (got, want) in p.pattern(0, 1, 1, 0).iter().zip(&want.f_phi) {
            let want = want.norm_sqr() * 2.0 / (PI * wave.k0());
            // The beam is flat to (1.5/300)^2 across the fiber.
            assert!((f64::from(*got) - want).abs() < 1e-4 * top, "{got} {want}");
        }
        assert_eq!(p.pattern(0, 1, 1, 0), p.pattern(0, 1, 1, 1));
    }

    /// Threads, a stop and a longer run later change nothing.
    #[test]
    fn threads_stops_and_more_instances_do_not_matter() {
        let spec = YarnSpec::parse(SPEC, "s.toml").unwrap();
        let whole = |threads: usize, run: Run<'_>, instances| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = SpeckleOptions { instances, lambda_um: vec![0.6], ..options() };
            pool.install(|| speckle(&spec, SPEC, &options, run))
        };
        let want = whole(1, Run::plain(), 4).unwrap();
        assert_eq!(whole(3, Run::plain(), 4).unwrap(), want);
        let folder = tempfile::tempdir().unwrap();
        let parts = folder.path().join("s.parts");
        let (stop, done) = (AtomicBool::new(false), AtomicU64::new(0));
        let halt = |jobs: u64| {
            if done.fetch_add(jobs, Ordering::Relaxed) + jobs >= 2 {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let parts = PartsFolder::open(&parts, Found::Resume).unwrap();
        let run = Run { parts: Some(&parts), stop: Some(&stop), progress: Some(&halt) };
        assert!(matches!(whole(1, run, 3), Err(RunError::Interrupted { left: 1, total: 3 })));
        let again = Run { parts: Some(&parts), ..Run::plain() };
        assert_eq!(whole(2, again, 3).unwrap().instances, 3);
        assert_eq!(whole(1, again, 4).unwrap(), want);
    }
}
