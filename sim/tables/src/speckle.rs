//! Patterns of single fibers under a wide beam, their statistics and their file (Yu 2025, 6.2; Goodman 2007).
//!
//! For a fully developed speckle the covariance of the intensity over its squared mean is |rho|^2, rho the
//! field's autocorrelation (Siegert). From instances it is `C(d) = <(n(phi) - 1)(n(phi + d) - 1)>` with
//! `n = I / mean of I over the instances`, averaged over instances and over a range of azimuths. The mean in
//! the denominator includes the instance itself, which reduces the covariance by 1/N; a factor N/(N - 1)
//! corrects it.
//!
//! The directions around exact forward are excluded, since the light diffracted there is the same in every
//! instance.

use plywave::Result;
use plywave::io::{Axis, Check, Document, FileKind, Provenance, Reader, Summary, Writer, invalid};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Half of the range about exact forward that all statistics exclude [rad], 20 degrees: several times the
/// width lambda / (2 a) of the diffraction behind a fiber of radius a >= 2 um.
pub const FORWARD_RAD: f64 = PI / 9.0;

/// Polarization of the incident light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecklePolarization {
    /// Electric field with a component along the fiber.
    Tm,
    /// Electric field across the fiber.
    Te,
    /// The mean of both.
    Unpolarized,
}

/// The azimuths of a statistic. Light comes from pi/2, exact forward is 3 pi/2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpeckleSide {
    /// All azimuths except for the range around forward.
    All,
    /// The half from which light comes.
    Reflection,
    /// The other half, without the range around forward.
    Forward,
}

impl SpeckleSide {
    /// All three sides.
    pub const EACH: [SpeckleSide; 3] = [SpeckleSide::All, SpeckleSide::Reflection, SpeckleSide::Forward];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            SpeckleSide::All => "all",
            SpeckleSide::Reflection => "reflection",
            SpeckleSide::Forward => "forward",
        }
    }

    /// Whether an azimuth [rad] is included.
    pub fn holds(self, phi: f64) -> bool {
        let off = (phi - 3.0 * FRAC_PI_2 + PI).rem_euclid(TAU) - PI;
        let outside = off.abs() > FORWARD_RAD;
        match self {
            SpeckleSide::All => outside,
            SpeckleSide::Reflection => off.abs() >= FRAC_PI_2,
            SpeckleSide::Forward => outside && off.abs() < FRAC_PI_2,
        }
    }
}

/// Scattered light of many instances of one fiber. Arrays are flat, last index fastest; A absorptions, L
/// wavelengths, 2 polarizations (TM, TE), N instances, D azimuths.
#[derive(Clone, Debug, PartialEq)]
pub struct SpecklePatterns {
    /// Text of the yarn spec.
    pub spec_text: String,
    /// Program version that wrote it.
    pub program_version: String,
    /// Seed of the instances.
    pub seed: u64,
    /// Latitude of the incidence [rad]. Light comes from azimuth pi/2.
    pub theta_i: f64,
    /// Waist of the beam [um].
    pub w0_um: f64,
    /// `[A]`: imaginary indices, the same at every wavelength.
    pub kappa: Vec<f64>,
    /// `[L]`: wavelengths [um], ascending.
    pub lambda_um: Vec<f64>,
    /// Number of instances.
    pub instances: usize,
    /// Number of azimuths 2 pi j / D.
    pub azimuths: usize,
    /// `[A][L][2][N][D]`: scattered power per length and azimuth over |S| at the beam's center [um/rad].
    pub patterns: Vec<f32>,
    /// `[A][L][2][N]`: scattering width [um].
    pub c_sca_um: Vec<f64>,
    /// `[A][L][2][N]`: absorption width [um].
    pub c_abs_um: Vec<f64>,
}

/// Statistics of patterns of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeckleStatistics {
    /// Distance between two lags [rad].
    pub step_rad: f64,
    /// `[lag]`: C at 0, step, 2 step, ...
    pub covariance: Vec<f64>,
    /// sqrt(C(0)): standard deviation of the intensity over its mean; 1 for a fully developed speckle.
    pub contrast: f64,
    /// Lag at which C first falls to half of C(0) [rad]; NaN if it does not within the lags.
    pub half_width_rad: f64,
    /// `[lag]`: standard error of C, from instance to instance; NaN for one instance.
    pub covariance_se: Vec<f64>,
}

impl SpeckleStatistics {
    /// Statistics of `patterns`, `[n][azimuths]`, over the azimuths of `side`, up to the lag `max_rad`.
    pub fn from_patterns(patterns: &[Vec<f64>], side: SpeckleSide, max_rad: f64) -> SpeckleStatistics {
        let n = patterns.len();
        let d = patterns.first().map_or(0, Vec::len);
        let step_rad = TAU / d.max(1) as f64;
        let lags = ((max_rad / step_rad).round() as usize).min(d / 2) + 1;
        let mut mean = vec![0.0; d];
        for pattern in patterns {
            mean.iter_mut().zip(pattern).for_each(|(m, v)| *m += v / n as f64);
        }
        let is_included: Vec<bool> = (0..d).map(|j| side.holds(step_rad * j as f64) && mean[j] > 0.0).collect();
        // Sums over the instances of the products and of their squares.
        let (mut sums, mut squares) = (vec![0.0; lags], vec![0.0; lags]);
        for pattern in patterns {
            // Excluded azimuths have the value 0, so that pairs with them do not count.
            let off: Vec<f64> = (0..d).map(|j| if is_included[j] { pattern[j] / mean[j] - 1.0 } else { 0.0 }).collect();
            for (lag, (sum, square)) in sums.iter_mut().zip(&mut squares).enumerate() {
                let own: f64 = (0..d).map(|j| off[j] * off[(j + lag) % d]).sum();
                *sum += own;
                *square += own * own;
            }
        }
        let unbiased = if n > 1 { n as f64 / (n - 1) as f64 } else { 0.0 };
        let pairs = |lag: usize| (0..d).filter(|j| is_included[*j] && is_included[(j + lag) % d]).count();
        let covariance: Vec<f64> = sums
            .iter()
            .enumerate()
            .map(|(lag, sum)| match pairs(lag) {
                0 => 0.0,
                pairs => unbiased * sum / (n * pairs) as f64,
            })
            .collect();
        let covariance_se = (0..lags)
            .map(|lag| {
                let spread = (squares[lag] - sums[lag] * sums[lag] / n as f64).max(0.0);
                if n > 1 { (spread * unbiased).sqrt() / (n * pairs(lag).max(1)) as f64 } else { f64::NAN }
            })
            .collect();
        let variance = covariance.first().copied().unwrap_or(0.0);
        SpeckleStatistics {
            step_rad,
            contrast: variance.max(0.0).sqrt(),
            half_width_rad: step_rad * half(&covariance),
            covariance,
            covariance_se,
        }
    }

    /// `[lag]`: autocorrelation of the field, `sqrt(C / C(0))`, up to the lag at which C first falls below
    /// two of its standard errors. Beyond, it is 0, since the root would turn the noise of the estimate into
    /// a tail.
    pub fn rho(&self) -> Vec<f64> {
        let top = self.covariance.first().copied().unwrap_or(0.0);
        let end = self.covariance.iter().zip(&self.covariance_se).position(|(c, se)| *c <= 2.0 * se || *c <= 0.0);
        let end = end.unwrap_or(self.covariance.len());
        let value = |(lag, c): (usize, &f64)| if lag < end && top > 0.0 { (c / top).sqrt() } else { 0.0 };
        self.covariance.iter().enumerate().map(value).collect()
    }

    /// `[k]`: power spectrum of the field on a circle of `azimuths` points, for the harmonics 0 to
    /// `azimuths / 2`. It is the cosine transform of [`SpeckleStatistics::rho`], clipped at 0 and scaled to
    /// the mean 1 over all points.
    pub fn power_spectrum(&self, azimuths: usize) -> Vec<f64> {
        let rho = self.rho();
        let at = |k: usize| {
            let turn = TAU * k as f64 / azimuths as f64;
            let sides: f64 = rho.iter().enumerate().skip(1).map(|(j, r)| r * (turn * j as f64).cos()).sum();
            (rho.first().copied().unwrap_or(0.0) + 2.0 * sides).max(0.0)
        };
        let spectrum: Vec<f64> = (0..=azimuths / 2).map(at).collect();
        // Harmonics k and azimuths - k are equal.
        let twice = |k: usize| if k == 0 || 2 * k == azimuths { 1.0 } else { 2.0 };
        let sum: f64 = spectrum.iter().enumerate().map(|(k, v)| twice(k) * v).sum();
        let scale = if sum > 0.0 { azimuths as f64 / sum } else { 0.0 };
        spectrum.into_iter().map(|v| v * scale).collect()
    }
}

/// Position at which an even function, given at 0, 1, ..., first falls to half of its first value, by the
/// cubic through the four nearest values; NaN if there is none.
fn half(values: &[f64]) -> f64 {
    let Some(top) = values.first() else { return f64::NAN };
    let level = 0.5 * top;
    let Some(j) = values.windows(2).position(|w| w[0] > level && w[1] <= level) else { return f64::NAN };
    // The function is even, so the value before the first is the second.
    let before = values[if j == 0 { 1 } else { j - 1 }];
    let Some(&after) = values.get(j + 2) else { return f64::NAN };
    let (a, b) = (values[j], values[j + 1]);
    let cubic = |t: f64| {
        -t * (t - 1.0) * (t - 2.0) / 6.0 * before + (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0 * a
            - (t + 1.0) * t * (t - 2.0) / 2.0 * b
            + (t + 1.0) * t * (t - 1.0) / 6.0 * after
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if cubic(middle) > level { low = middle } else { high = middle }
    }
    j as f64 + low
}

const TENSORS: [&str; 5] = ["kappa", "lambda_um", "patterns", "c_sca_um", "c_abs_um"];
/// Maximum number of values of `patterns`: 1 GiB.
const MAX_VALUES: usize = 1 << 28;

/// Keys of the JSON document besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct SpeckleKeys {
    theta_i_rad: f64,
    w0_um: f64,
}

impl SpecklePatterns {
    /// Shape of `patterns`.
    fn shape(&self) -> [usize; 5] {
        [self.kappa.len(), self.lambda_um.len(), 2, self.instances, self.azimuths]
    }

    /// Pattern of one instance, `[D]`; `pol` 0 for TM, 1 for TE.
    pub fn pattern(&self, absorption: usize, lambda: usize, pol: usize, instance: usize) -> &[f32] {
        let at = ((absorption * self.lambda_um.len() + lambda) * 2 + pol) * self.instances + instance;
        &self.patterns[at * self.azimuths..][..self.azimuths]
    }

    /// Patterns of all instances, `[N][D]`.
    pub fn instances_of(&self, absorption: usize, lambda: usize, pol: SpecklePolarization) -> Vec<Vec<f64>> {
        let one = |p: usize, i: usize| self.pattern(absorption, lambda, p, i).iter().map(|v| f64::from(*v));
        (0..self.instances)
            .map(|i| match pol {
                SpecklePolarization::Tm => one(0, i).collect(),
                SpecklePolarization::Te => one(1, i).collect(),
                SpecklePolarization::Unpolarized => one(0, i).zip(one(1, i)).map(|(a, b)| 0.5 * (a + b)).collect(),
            })
            .collect()
    }

    /// Statistics of the patterns at an absorption and a wavelength, up to a lag of 30 degrees.
    pub fn statistics(
        &self,
        absorption: usize,
        lambda: usize,
        pol: SpecklePolarization,
        side: SpeckleSide,
    ) -> SpeckleStatistics {
        SpeckleStatistics::from_patterns(&self.instances_of(absorption, lambda, pol), side, PI / 6.0)
    }
}

impl Document for SpecklePatterns {
    const KIND: FileKind = FileKind::Speckle;
    type Keys = SpeckleKeys;

    fn names() -> Vec<&'static str> {
        TENSORS.to_vec()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: "speckle".into(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<SpeckleKeys> {
        Ok(SpeckleKeys { theta_i_rad: self.theta_i, w0_um: self.w0_um })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let names = ["kappa", "lambda", "polarization", "instance", "phi_o"];
        let units = ["1", "um", "1", "1", "rad"];
        let shape = self.shape();
        let axes = (0..5).map(|i| Axis::new(names[i], units[i], shape[i])).collect();
        let statistics = serde_json::json!({
            "c_sca_um": Summary::from_values(self.c_sca_um.iter().copied()),
            "c_abs_um": Summary::from_values(self.c_abs_um.iter().copied()),
        });
        (axes, statistics)
    }

    fn tensors(&self, writer: &mut Writer) {
        let shape = self.shape();
        writer.f64("kappa", &shape[..1], &self.kappa);
        writer.f64("lambda_um", &shape[1..2], &self.lambda_um);
        writer.f32("patterns", &shape, self.patterns.iter().copied());
        writer.f64("c_sca_um", &shape[..4], &self.c_sca_um);
        writer.f64("c_abs_um", &shape[..4], &self.c_abs_um);
    }

    fn read(reader: &Reader<'_>, provenance: Provenance, keys: &SpeckleKeys) -> Result<SpecklePatterns> {
        let shape = reader.shape("patterns", 5)?;
        if shape[2] != 2 {
            return Err(invalid(
                reader.file(),
                "patterns",
                format!("{shape:?}"),
                "its third axis must be 2, for TM and TE",
            ));
        }
        Ok(SpecklePatterns {
            spec_text: provenance.spec,
            program_version: provenance.program_version,
            seed: provenance.seed,
            theta_i: keys.theta_i_rad,
            w0_um: keys.w0_um,
            kappa: reader.f64("kappa", &shape[..1])?,
            lambda_um: reader.f64("lambda_um", &shape[1..2])?,
            instances: shape[3],
            azimuths: shape[4],
            patterns: reader.f32("patterns", &shape)?,
            c_sca_um: reader.f64("c_sca_um", &shape[..4])?,
            c_abs_um: reader.f64("c_abs_um", &shape[..4])?,
        })
    }

    /// Checks the arrays, when loaded or saved.
    fn check(&self, file: &str) -> Result<()> {
        let (check, shape) = (Check(file), self.shape());
        let size = shape.iter().try_fold(1usize, |a, b| a.checked_mul(*b)).filter(|n| (1..=MAX_VALUES).contains(n));
        if size.is_none() || self.azimuths < 4 {
            let hint = format!("expected axes of one or more, 4 or more azimuths, {MAX_VALUES} values at most");
            return Err(invalid(file, "patterns", format!("{shape:?}"), &hint));
        }
        check.len("patterns", self.patterns.len(), &shape)?;
        check.len("c_sca_um", self.c_sca_um.len(), &shape[..4])?;
        check.len("c_abs_um", self.c_abs_um.len(), &shape[..4])?;
        check.range("theta_i_rad", &[self.theta_i], -FRAC_PI_2, FRAC_PI_2)?;
        check.range("w0_um", &[self.w0_um], 1e-3, 1e6)?;
        check.range("kappa", &self.kappa, 0.0, 1e3)?;
        check.range("lambda_um", &self.lambda_um, 1e-3, 1e3)?;
        check.ascending("lambda_um", &self.lambda_um)?;
        check.range_f32("patterns", &self.patterns, 0.0, 1e12)?;
        check.range("c_sca_um", &self.c_sca_um, 0.0, 1e9)?;
        // Clear fibers have 0 up to the solver's error, which may be negative.
        check.range("c_abs_um", &self.c_abs_um, -1e6, 1e9)
    }
}

#[cfg(test)]
mod tests {
    //! Ground truth: fields sampled as circular Gaussians of a known correlation; closed forms; a file read
    //! back.
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// `[n][d]`: intensities of a circular Gaussian field with rho(lag) = exp(-(lag/width)^2 / 2) and the
    /// mean `mean(j)`.
    fn drawn(n: usize, d: usize, width: f64, mean: impl Fn(usize) -> f64) -> Vec<Vec<f64>> {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let top = (4.0 * d as f64 / (TAU * width)).ceil() as i64;
        // Each harmonic gets a circular Gaussian amplitude whose variance is rho's transform.
        let share = |k: i64| (-0.5 * (TAU * k as f64 * width / d as f64).powi(2)).exp();
        let sum: f64 = (-top..=top).map(share).sum();
        (0..n)
            .map(|_| {
                let amplitudes: Vec<(f64, f64, f64)> = (-top..=top)
                    .map(|k| {
                        let radius = (-(1.0 - rng.random::<f64>()).ln() * share(k) / sum).sqrt();
                        (k as f64, radius, TAU * rng.random::<f64>())
                    })
                    .collect();
                (0..d)
                    .map(|j| {
                        let (mut re, mut im) = (0.0, 0.0);
                        for (k, radius, phase) in &amplitudes {
                            let (s, c) = (phase + TAU * k * j as f64 / d as f64).sin_cos();
                            (re, im) = (re + radius * c, im + radius * s);
                        }
                        mean(j) * (re * re + im * im)
                    })
                    .collect()
            })
            .collect()
    }

    /// A fully developed speckle over a nonuniform mean has contrast 1, covariance |rho|^2 with its half
    /// width, and the rho and spectrum from which it was sampled.
    #[test]
    fn developed_speckle_has_contrast_1_and_siegerts_covariance() {
        let (n, d, width) = (400, 240, 4.0);
        let patterns = drawn(n, d, width, |j| 3.0 + 2.5 * (TAU * j as f64 / d as f64).cos());
        for side in SpeckleSide::EACH {
            let got = SpeckleStatistics::from_patterns(&patterns, side, PI / 6.0);
            assert_eq!(got.covariance.len(), 21);
            // The standard error at any other lag is at most that at lag 0.
            let allowed = 5.0 * got.covariance_se[0];
            assert!(allowed < 0.25, "{allowed}");
            for (lag, c) in got.covariance.iter().enumerate() {
                let want = (-(lag as f64 / width).powi(2)).exp();
                assert!((c - want).abs() < allowed, "{side:?} lag {lag}: {c}, want {want} within {allowed}");
            }
            assert!((got.contrast - 1.0).abs() < 0.5 * allowed, "contrast {}", got.contrast);
            let want = width * 2f64.ln().sqrt() * got.step_rad;
            assert!((got.half_width_rad / want - 1.0).abs() < 0.1, "{} {want}", got.half_width_rad);
            let rho = got.rho();
            let truth = |lag: usize| (-0.5 * (lag as f64 / width).powi(2)).exp();
            // The standard error of rho = sqrt(C / C(0)) follows from those of C and C(0).
            let se = |lag: usize| 0.5 * (got.covariance_se[lag] / truth(lag) + truth(lag) * got.covariance_se[0]);
            let end = rho.iter().position(|r| *r == 0.0).unwrap();
            assert!((7..13).contains(&end), "{side:?}: noise begins at lag {end}");
            for lag in 0..end {
                let allowed = 5.0 * se(lag);
                let want = truth(lag);
                assert!(
                    (rho[lag] - want).abs() < allowed,
                    "{side:?} rho {lag}: {}, want {want} within {allowed}",
                    rho[lag]
                );
            }
            let spectrum = got.power_spectrum(d);
            let all: f64 = spectrum.iter().sum::<f64>() * 2.0 - spectrum[0] - spectrum[d / 2];
            assert!((all / d as f64 - 1.0).abs() < 1e-12);
            let want = |k: usize| width * TAU.sqrt() * (-0.5 * (TAU * k as f64 * width / d as f64).powi(2)).exp();
            // Errors of neighboring lags are at worst fully correlated, and the tail of rho is cut off.
            let tail: f64 = (end..d / 2).map(|lag| 2.0 * truth(lag)).sum();
            let allowed = tail + 2.0 * (1..end).map(se).sum::<f64>() * 5.0;
            assert!(allowed < 0.5 * want(0), "{allowed}");
            for k in [0, 5, 10, 15] {
                let got = spectrum[k];
                assert!((got - want(k)).abs() < allowed, "{side:?} k {k}: {got}, want {} within {allowed}", want(k));
            }
        }
    }

    /// With the factor N/(N - 1), the mean estimate does not depend on the number of instances.
    #[test]
    fn few_instances_are_not_biased() {
        let all = drawn(3000, 90, 1.5, |_| 1.0);
        let mean = |group: usize| {
            let groups = all
                .chunks_exact(group)
                .map(|g| SpeckleStatistics::from_patterns(g, SpeckleSide::All, 0.1).covariance[0]);
            groups.sum::<f64>() / (all.len() / group) as f64
        };
        let (few, many) = (mean(10), mean(3000));
        // Second-order terms of the quotient remain, which are about 1/N.
        assert!((few - many).abs() < 0.12 && (many - 1.0).abs() < 0.05, "{few} {many}");
    }

    /// A fringe cos(2 pi j / period) falls to half at a sixth of its period, also for few points per period.
    #[test]
    fn half_widths_are_found_between_places() {
        for (period, within) in [(40.0, 1e-4), (8.0, 0.01)] {
            let values: Vec<f64> = (0..20).map(|j| (TAU * f64::from(j) / period).cos()).collect();
            assert!((half(&values) - period / 6.0).abs() < within, "{} of {period}", half(&values));
        }
        assert!(half(&[1.0, 0.9, 0.8]).is_nan() && half(&[1.0, 0.2]).is_nan() && half(&[]).is_nan());
    }

    #[test]
    fn identical_instances_have_no_contrast() {
        let got = SpeckleStatistics::from_patterns(
            &vec![vec![1.0, 2.0, 5.0, 1.0, 1.0, 3.0, 1.0, 1.0]; 4],
            SpeckleSide::All,
            1.0,
        );
        assert_eq!(got.contrast, 0.0);
        assert!(got.half_width_rad.is_nan());
        assert_eq!(got.rho().iter().sum::<f64>(), 0.0);
    }

    #[test]
    fn sides_share_the_circle() {
        let degrees = |side: SpeckleSide| {
            (0..360).filter(|d| side.holds((f64::from(*d) + 0.5).to_radians())).collect::<Vec<i32>>()
        };
        let [all, reflection, forward] = SpeckleSide::EACH.map(degrees);
        assert_eq!((all.len(), reflection.len(), forward.len()), (320, 180, 140));
        assert!(reflection.contains(&90) && !reflection.contains(&200));
        assert!(forward.contains(&240) && !forward.contains(&260) && forward.contains(&300));
    }

    fn patterns() -> SpecklePatterns {
        SpecklePatterns {
            spec_text: "name = \"x\"".into(),
            program_version: "0".into(),
            seed: 7,
            theta_i: 0.1,
            w0_um: 100.0,
            kappa: vec![0.0, 0.05],
            lambda_um: vec![0.4, 0.7],
            instances: 3,
            azimuths: 6,
            patterns: (0..2 * 2 * 2 * 3 * 6).map(|i| i as f32).collect(),
            c_sca_um: vec![1.5; 24],
            c_abs_um: vec![0.5; 24],
        }
    }

    #[test]
    fn files_are_read_back_and_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.pws");
        let p = patterns();
        p.save(&path).unwrap();
        assert_eq!(plywave::io::file_kind(&path).unwrap(), FileKind::Speckle);
        assert_eq!(SpecklePatterns::load(&path).unwrap(), p);
        assert_eq!(p.pattern(1, 0, 1, 2)[3], (((2 * 2 + 1) * 3 + 2) * 6 + 3) as f32);
        let both = p.instances_of(0, 1, SpecklePolarization::Unpolarized);
        assert_eq!(both[1][2], f64::from(0.5 * (p.pattern(0, 1, 0, 1)[2] + p.pattern(0, 1, 1, 1)[2])));
        let bytes = plywave::io::read_file(&path, 1 << 20).unwrap();
        assert!(SpecklePatterns::from_bytes(&bytes[..bytes.len() - 4], "x").is_err());
        assert!(crate::table::Table::load(&path).is_err());
        let bad: [fn(&mut SpecklePatterns); 6] = [
            |p| p.patterns[5] = -1.0,
            |p| p.patterns[5] = f32::NAN,
            |p| p.lambda_um.reverse(),
            |p| p.kappa[0] = -0.1,
            |p| p.c_sca_um.truncate(20),
            |p| p.instances = 0,
        ];
        for spoil in bad {
            let mut p = patterns();
            spoil(&mut p);
            assert!(p.save(&path).is_err());
        }
    }
}
