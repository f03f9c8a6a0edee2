//! Comparison of wave and ray optics over instances of a ply's cross section (Yu 2025, 4.5, Fig. 7), with the
//! same fibers and the same beam.
//!
//! Waves: the far field of beam and scattered light together, mean of TM and TE, each from an exact solve.
//! Rays: f_miss + f_refl + f_high of the walk in 2D over smooth walls, with the position and angle of the
//! beam at each wavelength (the paper takes the angles of 0.55 um for all). Both are shares of the beam's
//! power per azimuth, in bins of half a degree; coarser ones are their means.
//!
//! The pair of a section and a wavelength is one shard. Instance i is the same section whatever the number of
//! instances, so that a run can be extended.

use crate::jobs::scatter::solver_of;
use crate::jobs::similarity::{Similarity, Spread, binned, coarser, correlation, mean_and_sd, similarity};
use crate::{
    BeamSource, Body, Polarization, Solver, Source, Wave, WaveError, azimuths, check_ledger, section_bodies,
    total_field,
};
use plywave::spec::{GaussianBeam, YarnSpec};
use plywave_runs::RunError;
use plywave_runs::{self as runs, ArrayLayout, Description, Done, Job, Part, Run, Shards, Values};
use plywave_sim::PlySection;
use plywave_sim::seeds::instance_seed;
use plywave_sim::{Walk2d, walk_2d};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Number of stored azimuth bins, half a degree each.
pub const BINS: usize = 720;
/// Widths of the compared bins, in stored bins.
const FACTORS: [usize; 4] = [1, 2, 6, 20];
/// One degree, in stored bins.
const DEGREE: usize = 2;
/// Half of the range around exact forward that off-forward results exclude [degrees]: about fifteen times the
/// beam's spread, so that only light that a fiber has deflected remains.
const FORWARD_DEG: f64 = 10.0;
/// Number of curves of a case in a shard: total by waves; missed, reflected and other light by rays.
const CURVES: usize = 4;
/// Number of shares of a case in a shard: scattered, absorbed and extinguished by waves; killed rays.
const SHARES: usize = 4;

/// Sizes of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompareOptions {
    /// Instances of the section.
    pub instances: u32,
    /// Seed of the sections and of the rays.
    pub seed: u64,
    /// Wavelengths [um].
    pub lambda_um: Vec<f64>,
    /// Offsets of the beam over the ply's radius (of an elliptical one: its semi-axis along x).
    pub h_rel: Vec<f64>,
    /// Latitude of the incidence [rad].
    pub theta_i: f64,
    /// Absorption coefficient of the fibers [1/um], the same at every wavelength: kappa = sigma lambda / (4
    /// pi).
    pub sigma_per_um: f64,
    /// Error of the solver's far field.
    pub tolerance: f64,
    /// Rays of an instance, wavelength and offset.
    pub paths: u64,
}

impl Default for CompareOptions {
    fn default() -> Self {
        CompareOptions {
            instances: 50,
            seed: 1,
            // Yu 2025, Fig. 7.
            lambda_um: vec![0.4, 0.694],
            h_rel: vec![0.0, 0.5, 0.9],
            theta_i: 0.0,
            sigma_per_um: 0.0,
            tolerance: 1e-4,
            paths: 200_000,
        }
    }
}

impl CompareOptions {
    /// Shards of the run, which progress counts.
    pub fn jobs(&self) -> u64 {
        u64::from(self.instances) * self.lambda_um.len() as u64
    }

    /// The beam at `lambda_um` and offset `h_um`, from +y.
    fn source(&self, spec: &YarnSpec, h_um: f64, pol: Polarization) -> Source {
        Source { phi_i: FRAC_PI_2, pol, beam: Some(BeamSource { w0_um: spec.beam.beam().w0_um, h_um }) }
    }

    /// Offsets [um].
    fn h_um(&self, spec: &YarnSpec) -> Vec<f64> {
        self.h_rel.iter().map(|h| h * spec.ply_radii_um()[0]).collect()
    }

    /// The options that a shard depends on; others allow a longer run.
    fn of_a_shard(&self) -> Self {
        CompareOptions { instances: 0, ..self.clone() }
    }
}

/// Shares of the beam's power, over the instances.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Energies {
    /// All outgoing light, beam included, by waves.
    pub wave_total: Spread,
    /// C_sca over the beam's power.
    pub wave_scattered: Spread,
    /// C_abs.
    pub wave_absorbed: Spread,
    /// C_ext: loss of the beam's own far field.
    pub wave_extinguished: Spread,
    /// Rays that hit no fiber.
    pub ray_miss: Spread,
    /// Rays that were reflected only.
    pub ray_refl: Spread,
    /// All other rays.
    pub ray_high: Spread,
    /// Rays stopped at the limit of interactions.
    pub ray_killed: Spread,
}

/// Comparison of waves and rays in bins of one width.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Resolved {
    /// Width of the bins [degrees].
    pub bin_deg: f64,
    /// Similarity of the averages over all instances.
    pub average: Similarity,
    /// The relative L2 distance due to the instances' spread alone: root of the sum of the variances of wave
    /// minus ray, over their number.
    pub average_noise_l2: f64,
    /// Similarity of the averages without 10 degrees on either side of exact forward.
    pub average_off_forward: Similarity,
    /// The relative L2 distance of these due to the spread alone.
    pub average_off_forward_noise_l2: f64,
    /// Correlations of the single instances.
    pub single_correlation: Spread,
    /// Relative L2 distances of the single instances.
    pub single_relative_l2: Spread,
    /// Correlations of the single instances without forward.
    pub single_off_forward_correlation: Spread,
    /// Relative L2 distances of the single instances without forward.
    pub single_off_forward_relative_l2: Spread,
}

/// Densities [1/rad] in bins of half a degree, the first from 0 to 0.5.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompareCurves {
    /// Mean by waves.
    pub wave_mean: Vec<f64>,
    /// Standard deviation from instance to instance.
    pub wave_sd: Vec<f64>,
    /// Mean by rays.
    pub ray_mean: Vec<f64>,
    /// Standard deviation from instance to instance.
    pub ray_sd: Vec<f64>,
    /// The part of the rays' mean that hit no fiber.
    pub ray_miss_mean: Vec<f64>,
    /// The first instance by waves.
    pub wave_first: Vec<f64>,
    /// The first instance by rays.
    pub ray_first: Vec<f64>,
}

/// One wavelength and offset.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompareCase {
    /// Wavelength [um].
    pub lambda_um: f64,
    /// Offset over the radius.
    pub h_rel: f64,
    /// Offset [um].
    pub h_um: f64,
    /// Shares of the beam's power.
    pub energies: Energies,
    /// Results by width of the bins.
    pub resolutions: Vec<Resolved>,
    /// The curves.
    pub curves: CompareCurves,
}

/// Comparison of two wavelengths at one offset, both by waves: the averages have little color.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AcrossWavelengths {
    /// Wavelengths [um].
    pub lambda_um: [f64; 2],
    /// Offset over the radius.
    pub h_rel: f64,
    /// Averages, bins of one degree.
    pub average: Similarity,
    /// Correlation of single instances.
    pub single_correlation: Spread,
}

/// Report of `plywave compare`, in `report.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompareReport {
    /// Program version.
    pub program_version: String,
    /// Name of the yarn.
    pub name: String,
    /// Instances.
    pub instances: u32,
    /// Seed.
    pub seed: u64,
    /// Latitude of the incidence [degrees].
    pub theta_i_deg: f64,
    /// Waist of the beam [um].
    pub w0_um: f64,
    /// Absorption coefficient [1/um].
    pub sigma_per_um: f64,
    /// Tolerance of the solver.
    pub tolerance: f64,
    /// Rays of an instance, wavelength and offset.
    pub paths: u64,
    /// Half of the range about forward that off-forward results exclude [degrees].
    pub forward_deg: f64,
    /// Cases, offsets within wavelengths.
    pub cases: Vec<CompareCase>,
    /// Pairs of neighboring wavelengths.
    pub across_wavelengths: Vec<AcrossWavelengths>,
    /// Text of the spec.
    pub spec: String,
}

/// Constructor of a solver for the bodies of a section.
pub(crate) type MakeSolver<'a> = dyn Fn(&[Body], &Wave, f64) -> Result<Solver, WaveError> + Sync + 'a;

/// Runs both optics over the instances of `spec`, whose text is kept in the report, on the current thread
/// pool.
///
/// # Errors
/// Errors of the geometry, the solvers ([`RunError::Wave`]) and the parts folder; [`RunError::Interrupted`].
pub fn compare(
    spec: &YarnSpec,
    spec_text: &str,
    options: &CompareOptions,
    run: Run<'_>,
) -> Result<CompareReport, RunError> {
    runs::run(&CompareJob::new(spec, spec_text, options)?, run)
}

/// A comparison as a job: shard `i L + l` is instance i at wavelength l.
pub struct CompareJob<'a> {
    spec: YarnSpec,
    spec_text: String,
    options: CompareOptions,
    solver: &'a MakeSolver<'a>,
    sections: OnceLock<Vec<PlySection>>,
}

impl CompareJob<'static> {
    /// The job of `spec`, whose text is `spec_text`.
    ///
    /// # Errors
    /// Beams that are too narrow, [`RunError::Wave`].
    pub fn new(spec: &YarnSpec, spec_text: &str, options: &CompareOptions) -> Result<Self, RunError> {
        CompareJob::with_solver(spec, spec_text, options, &solver_of)
    }

    /// The job of a description and a number of instances.
    ///
    /// # Errors
    /// [`RunError::Merge`] and those of the spec.
    pub fn from_description(description: &Description, instances: u64) -> Result<Self, RunError> {
        let options: CompareOptions = description.parse_options()?;
        let spec = YarnSpec::parse(&description.spec, "the part's spec")?;
        let instances = u32::try_from(instances).unwrap_or(u32::MAX);
        CompareJob::new(&spec, &description.spec, &CompareOptions { instances, ..options })
    }
}

impl<'a> CompareJob<'a> {
    pub(crate) fn with_solver(
        spec: &YarnSpec,
        spec_text: &str,
        options: &CompareOptions,
        solver: &'a MakeSolver<'a>,
    ) -> Result<Self, RunError> {
        // The walk in 2D supports dielectrics of one index and one absorption only.
        let kinds = [
            (spec.blend.is_some(), "a blend"),
            (spec.fiber.is_opaque(), "an opaque fiber"),
            (spec.fiber.scattering_per_um > 0.0, "a fiber that scatters within"),
            (spec.fiber.shape.core() != [1.0, 0.0], "a filled core"),
        ];
        if let Some((_, what)) = kinds.into_iter().find(|kind| kind.0) {
            let hint = "compare plies of clear fibers of one kind, solid or hollow".into();
            return Err(WaveError::Unsupported { method: "a comparison with rays", what: what.into(), hint }.into());
        }
        // Waists that are too narrow are refused before the first shard.
        for &lambda_um in &options.lambda_um {
            let wave = Wave { lambda_um, theta_i: options.theta_i };
            options.source(spec, 0.0, Polarization::Tm).plane_waves(&wave, 0.0)?;
        }
        let (spec, spec_text, options) = (spec.clone(), spec_text.to_string(), options.clone());
        Ok(CompareJob { spec, spec_text, options, solver, sections: OnceLock::new() })
    }

    /// All sections, built at the first call, so that fibers that do not fit are reported before hours of
    /// work.
    fn sections(&self) -> Result<&[PlySection], RunError> {
        if let Some(sections) = self.sections.get() {
            return Ok(sections);
        }
        let sections = (0..self.options.instances)
            .into_par_iter()
            .map(|i| PlySection::generate(&self.spec, instance_seed(self.options.seed, i)))
            .collect::<Result<_, _>>()?;
        Ok(self.sections.get_or_init(|| sections))
    }
}

impl Shards for CompareJob<'_> {
    fn description(&self) -> Description {
        Description::new("compare", &self.options.of_a_shard(), &self.spec_text)
    }

    fn shards(&self) -> usize {
        self.options.jobs() as usize
    }

    fn extent(&self) -> u64 {
        u64::from(self.options.instances)
    }

    fn layout(&self, _: usize) -> Vec<ArrayLayout> {
        let h = self.options.h_rel.len();
        // Extinction and absorption may be negative by the solver's tolerance, and by the beam's own
        // interference.
        let any = [f64::MIN, f64::MAX];
        vec![ArrayLayout::f64("curves", &[h, CURVES, BINS], any), ArrayLayout::f64("shares", &[h, SHARES], any)]
    }

    fn prepare(&self) -> Result<(), RunError> {
        self.sections().map(|_| ())
    }

    fn run_shard(
        &self,
        shard: usize,
        stop: &AtomicBool,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Option<Done>, RunError> {
        let l = self.options.lambda_um.len();
        let (instance, at) = (shard / l, shard % l);
        let section = (instance as u32, &self.sections()?[instance]);
        let done = one(&self.spec, &self.options, section, at, stop, self.solver)?;
        if done.is_some() {
            progress(1);
        }
        Ok(done)
    }
}

impl Job for CompareJob<'_> {
    type Output = CompareReport;
    type Merge = Vec<Part>;

    fn begin(&self) -> Vec<Part> {
        Vec::new()
    }

    fn absorb(&self, parts: &mut Vec<Part>, _: usize, part: Part) {
        parts.push(part);
    }

    fn finish(&self, parts: Vec<Part>) -> Result<CompareReport, RunError> {
        Ok(report(&self.spec, &self.spec_text, &self.options, &parts))
    }
}

/// One instance at wavelength `at`: `[h]` of the curves, then of the shares; and its peak memory.
fn one(
    spec: &YarnSpec,
    options: &CompareOptions,
    (instance, section): (u32, &PlySection),
    at: usize,
    stop: &AtomicBool,
    solver: &MakeSolver<'_>,
) -> Result<Option<Done>, RunError> {
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let wave = Wave { lambda_um: options.lambda_um[at], theta_i: options.theta_i };
    let h_um = options.h_um(spec);
    let kappa = options.sigma_per_um * wave.lambda_um / (4.0 * PI);
    let bodies = section_bodies(section, spec.fiber.eta_at(wave.lambda_um), kappa)?;
    let prepared = solver(&bodies, &wave, options.tolerance)?;
    let sources: Vec<Source> = h_um
        .iter()
        .flat_map(|&h| [Polarization::Tm, Polarization::Te].map(|pol| options.source(spec, h, pol)))
        .collect();
    let extent_um = section.bound_radius_um;
    let n = sources.iter().map(|s| azimuths(&wave, s, extent_um, BINS)).max().unwrap_or(BINS);
    let scattered = prepared.scatter(&sources, n)?;
    let stats = prepared.stats();
    // The comparison is written such that a NaN fails it.
    let solved = stats.residual <= options.tolerance;
    if !solved {
        return Err(WaveError::NotConverged { residual: stats.residual, iterations: 1 }.into());
    }
    drop(prepared);

    let (mut curves, mut shares) = (Vec::new(), Vec::new());
    for (k, pair) in sources.chunks_exact(2).zip(scattered.chunks_exact(2)).enumerate() {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let mut total = vec![0.0; BINS];
        let mut share = [0.0; SHARES];
        for (source, scattered) in pair.0.iter().zip(pair.1) {
            check_ledger(&wave, options.tolerance, &bodies, scattered)?;
            let field = total_field(source, &wave, scattered)?;
            let binned = binned(&field.total, BINS);
            total.iter_mut().zip(binned).for_each(|(to, v)| *to += 0.5 * v);
            let widths = [scattered.c_sca_um, scattered.c_abs_um, scattered.c_ext_um];
            share.iter_mut().zip(widths).for_each(|(to, width)| *to += 0.5 * width / field.beam_um);
        }
        let beam = spec.beam.beam();
        let rays = walk_2d(
            section,
            &Walk2d {
                theta_i: options.theta_i,
                h_um: h_um[k],
                eta: spec.fiber.eta_at(wave.lambda_um),
                alpha_fiber: 0.0,
                sigma_per_um: vec![options.sigma_per_um],
                beam: GaussianBeam { lambda_um: wave.lambda_um, ..beam },
                phi_o_bins: BINS,
                paths: options.paths,
                // Distinct for every instance, wavelength and offset.
                seed: instance_seed(options.seed, instance) ^ ((at as u64) << 40 | (k as u64) << 52),
            },
        )?;
        share[3] = rays.killed;
        curves.extend(total);
        curves.extend(rays.miss);
        curves.extend(rays.refl);
        curves.extend(&rays.high[0]);
        shares.extend(share);
    }
    let part = Part::new(vec![Values::F64(curves), Values::F64(shares)]);
    Ok(Some(Done { part, peak_bytes: stats.peak_bytes }))
}

/// Curve `which` of offset `k` in a part.
fn curve(part: &Part, k: usize, which: usize) -> &[f64] {
    &part.f64(0)[(k * CURVES + which) * BINS..][..BINS]
}

/// All light by rays.
fn ray_total(part: &Part, k: usize) -> Vec<f64> {
    let (miss, refl, high) = (curve(part, k, 1), curve(part, k, 2), curve(part, k, 3));
    (0..BINS).map(|bin| miss[bin] + refl[bin] + high[bin]).collect()
}

/// Report of the finished shards.
fn report(spec: &YarnSpec, spec_text: &str, options: &CompareOptions, parts: &[Part]) -> CompareReport {
    let (l, h) = (options.lambda_um.len(), options.h_rel.len());
    let h_um = options.h_um(spec);
    let of = |at: usize| parts.iter().skip(at).step_by(l);
    let waves_of = |at: usize, k: usize| -> Vec<Vec<f64>> { of(at).map(|part| curve(part, k, 0).to_vec()).collect() };
    let mut cases = Vec::new();
    for at in 0..l {
        for k in 0..h {
            let waves = waves_of(at, k);
            let rays: Vec<Vec<f64>> = of(at).map(|part| ray_total(part, k)).collect();
            let share = |which: usize| Spread::from_values(of(at).map(move |part| part.f64(1)[k * SHARES + which]));
            let sum = |values: &[f64]| values.iter().sum::<f64>() * TAU / BINS as f64;
            let energy = |which: usize| Spread::from_values(of(at).map(move |part| sum(curve(part, k, which))));
            let (wave_mean, wave_sd) = mean_and_sd(&waves);
            let (ray_mean, ray_sd) = mean_and_sd(&rays);
            let misses: Vec<Vec<f64>> = of(at).map(|part| curve(part, k, 1).to_vec()).collect();
            cases.push(CompareCase {
                lambda_um: options.lambda_um[at],
                h_rel: options.h_rel[k],
                h_um: h_um[k],
                energies: Energies {
                    wave_total: energy(0),
                    wave_scattered: share(0),
                    wave_absorbed: share(1),
                    wave_extinguished: share(2),
                    ray_miss: energy(1),
                    ray_refl: energy(2),
                    ray_high: energy(3),
                    ray_killed: share(3),
                },
                resolutions: FACTORS.map(|factor| resolved(&waves, &rays, factor)).to_vec(),
                curves: CompareCurves {
                    wave_mean,
                    wave_sd,
                    ray_mean,
                    ray_sd,
                    ray_miss_mean: mean_and_sd(&misses).0,
                    wave_first: waves.first().cloned().unwrap_or_default(),
                    ray_first: rays.first().cloned().unwrap_or_default(),
                },
            });
        }
    }
    let mut across_wavelengths = Vec::new();
    for at in 1..l {
        for k in 0..h {
            let [a, b] = [at - 1, at].map(|at| waves_of(at, k).iter().map(|c| coarser(c, DEGREE)).collect::<Vec<_>>());
            across_wavelengths.push(AcrossWavelengths {
                lambda_um: [options.lambda_um[at - 1], options.lambda_um[at]],
                h_rel: options.h_rel[k],
                average: similarity(&mean_and_sd(&a).0, &mean_and_sd(&b).0),
                single_correlation: Spread::from_values(a.iter().zip(&b).map(|(a, b)| correlation(a, b))),
            });
        }
    }
    CompareReport {
        program_version: env!("CARGO_PKG_VERSION").into(),
        name: spec.name.clone(),
        instances: options.instances,
        seed: options.seed,
        theta_i_deg: crate::scene::description::degrees(options.theta_i),
        w0_um: spec.beam.beam().w0_um,
        sigma_per_um: options.sigma_per_um,
        tolerance: options.tolerance,
        paths: options.paths,
        forward_deg: FORWARD_DEG,
        cases,
        across_wavelengths,
        spec: spec_text.into(),
    }
}

/// Compares waves and rays in bins of `factor` stored ones.
fn resolved(waves: &[Vec<f64>], rays: &[Vec<f64>], factor: usize) -> Resolved {
    let coarse = |curves: &[Vec<f64>]| -> Vec<Vec<f64>> { curves.iter().map(|c| coarser(c, factor)).collect() };
    let (waves, rays) = (coarse(waves), coarse(rays));
    let bin_deg = 360.0 * factor as f64 / BINS as f64;
    // Bins entirely off forward.
    let off = |curves: &[Vec<f64>]| -> Vec<Vec<f64>> {
        let keep = |bin: usize| ((bin as f64 + 0.5) * bin_deg - 270.0).abs() >= FORWARD_DEG + 0.5 * bin_deg - 1e-9;
        curves.iter().map(|c| c.iter().enumerate().filter(|(bin, _)| keep(*bin)).map(|(_, v)| *v).collect()).collect()
    };
    let (waves_off, rays_off) = (off(&waves), off(&rays));
    let (average, average_noise_l2) = averages(&waves, &rays);
    let (average_off_forward, average_off_forward_noise_l2) = averages(&waves_off, &rays_off);
    let singles = |a: &[Vec<f64>], b: &[Vec<f64>]| -> Vec<Similarity> {
        a.iter().zip(b).map(|(a, b)| similarity(a, b)).collect()
    };
    let (single, single_off) = (singles(&waves, &rays), singles(&waves_off, &rays_off));
    Resolved {
        bin_deg,
        average,
        average_noise_l2,
        average_off_forward,
        average_off_forward_noise_l2,
        single_correlation: Spread::from_values(single.iter().map(|s| s.correlation)),
        single_relative_l2: Spread::from_values(single.iter().map(|s| s.relative_l2)),
        single_off_forward_correlation: Spread::from_values(single_off.iter().map(|s| s.correlation)),
        single_off_forward_relative_l2: Spread::from_values(single_off.iter().map(|s| s.relative_l2)),
    }
}

/// Similarity of the averages, and the relative L2 distance between them due to chance.
fn averages(waves: &[Vec<f64>], rays: &[Vec<f64>]) -> (Similarity, f64) {
    let (wave, ray) = (mean_and_sd(waves).0, mean_and_sd(rays).0);
    let apart: Vec<Vec<f64>> =
        waves.iter().zip(rays).map(|(w, r)| w.iter().zip(r).map(|(w, r)| w - r).collect()).collect();
    let variance: f64 = mean_and_sd(&apart).1.iter().map(|sd| sd * sd).sum::<f64>() / waves.len().max(1) as f64;
    let size: f64 = wave.iter().map(|w| w * w).sum();
    (similarity(&wave, &ray), (variance / size.max(f64::MIN_POSITIVE)).sqrt())
}
