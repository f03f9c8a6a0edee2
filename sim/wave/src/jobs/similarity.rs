//! Similarity of two distributions over the azimuth: bins, correlation, relative distance, and its part due
//! to the spread of the instances.

use serde::Serialize;

/// Means over `bins` equal parts of the azimuth of a function given at azimuths 2 pi j / n, n a multiple of
/// `bins`: `[bin]` from bin/bins to (bin + 1)/bins of a turn. Uses the trapezoidal rule within each bin: the
/// bins' mean is that of the function, to rounding.
pub fn binned(samples: &[f64], bins: usize) -> Vec<f64> {
    let (n, each) = (samples.len(), samples.len() / bins);
    let mean = |bin: usize| {
        let first = bin * each;
        let ends = 0.5 * (samples[first] + samples[(first + each) % n]);
        (ends + samples[first + 1..first + each].iter().sum::<f64>()) / each as f64
    };
    (0..bins).map(mean).collect()
}

/// Means over `factor` neighboring bins.
pub fn coarser(values: &[f64], factor: usize) -> Vec<f64> {
    values.chunks(factor).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect()
}

/// Similarity of two curves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Similarity {
    /// Pearson's correlation of the values.
    pub correlation: f64,
    /// Correlation of their logarithms, over bins where both are positive.
    pub log_correlation: f64,
    /// |a - b| / |a|, in the L2 sense.
    pub relative_l2: f64,
}

/// Compares curve `b` with `a`.
pub fn similarity(a: &[f64], b: &[f64]) -> Similarity {
    let logs = |of: &[f64]| -> Vec<f64> {
        a.iter().zip(b).zip(of).filter(|((a, b), _)| **a > 0.0 && **b > 0.0).map(|(_, v)| v.ln()).collect()
    };
    let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    let size: f64 = a.iter().map(|a| a * a).sum();
    Similarity {
        correlation: correlation(a, b),
        log_correlation: correlation(&logs(a), &logs(b)),
        relative_l2: (apart / size.max(f64::MIN_POSITIVE)).sqrt(),
    }
}

/// Pearson's correlation; 0 where one of the two does not vary.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().max(1) as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        let (a, b) = (a - mean_a, b - mean_b);
        (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Mean and spread of some numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Sample standard deviation.
    pub sd: f64,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
}

impl Spread {
    /// Spread of these values; zeros for none.
    pub fn from_values(values: impl Iterator<Item = f64> + Clone) -> Self {
        let n = values.clone().count();
        if n == 0 {
            return Spread::default();
        }
        let mean = values.clone().sum::<f64>() / n as f64;
        let square: f64 = values.clone().map(|v| (v - mean).powi(2)).sum();
        Spread {
            mean,
            sd: if n > 1 { (square / (n - 1) as f64).sqrt() } else { 0.0 },
            min: values.clone().fold(f64::INFINITY, f64::min),
            max: values.fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Mean and standard deviation of curves, bin by bin.
pub fn mean_and_sd(curves: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    let bins = curves.first().map_or(0, Vec::len);
    (0..bins)
        .map(|bin| {
            let s = Spread::from_values(curves.iter().map(|c| c[bin]));
            (s.mean, s.sd)
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn bins_keep_the_mean() {
        let samples: Vec<f64> = (0..720).map(|j| 2.0 + (TAU * 3.0 * j as f64 / 720.0).sin()).collect();
        let bins = binned(&samples, 36);
        assert!((bins.iter().sum::<f64>() / 36.0 - 2.0).abs() < 1e-13);
        for (bin, got) in bins.iter().enumerate() {
            // Mean of sin(3 phi) over the bin, in closed form.
            let (from, to) = (TAU * bin as f64 / 36.0, TAU * (bin + 1) as f64 / 36.0);
            let want = 2.0 + ((3.0 * from).cos() - (3.0 * to).cos()) / (3.0 * (to - from));
            assert!((got - want).abs() < 1e-3, "bin {bin}: {got}, want {want}");
        }
        assert_eq!(coarser(&[1.0, 3.0, 5.0, 9.0], 2), [2.0, 7.0]);
    }

    #[test]
    fn likeness_has_its_closed_values() {
        let a = [1.0, 2.0, 3.0, 4.0];
        let same = similarity(&a, &a);
        assert!((same.correlation - 1.0).abs() < 1e-15 && same.relative_l2 == 0.0);
        let twice = similarity(&a, &a.map(|v| 2.0 * v));
        assert!((twice.correlation - 1.0).abs() < 1e-15 && (twice.relative_l2 - 1.0).abs() < 1e-15);
        assert!((twice.log_correlation - 1.0).abs() < 1e-15);
        assert!((similarity(&a, &[4.0, 3.0, 2.0, 1.0]).correlation + 1.0).abs() < 1e-15);
        assert_eq!(similarity(&a, &[1.0; 4]).correlation, 0.0);
        // Only the logarithms omit a zero bin.
        let gap = similarity(&a, &[0.0, 2.0, 3.0, 4.0]);
        assert!((gap.log_correlation - 1.0).abs() < 1e-15 && (gap.relative_l2 - (1.0f64 / 30.0).sqrt()).abs() < 1e-15);
        let s = Spread::from_values([1.0, 2.0, 6.0].into_iter());
        assert_eq!((s.mean, s.min, s.max), (3.0, 1.0, 6.0));
        assert!((s.sd - 7f64.sqrt()).abs() < 1e-15);
    }
}
