//! Pearson's chi-square test of observed against expected counts, for samplers (after the tests of Mitsuba
//! and Nori).

/// Outcome of a test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chi2 {
    /// Sum of (observed - expected)^2 / expected over the cells.
    pub statistic: f64,
    /// Number of cells after pooling, minus 1.
    pub degrees: usize,
    /// Probability of a statistic this large or larger if the counts follow the expectation. It is 0 if a
    /// cell has counts where none are expected.
    pub p_value: f64,
}

/// Minimum expected count of a cell; smaller cells are pooled. The usual 5 suffices for p-values of a
/// percent. A cell of e expected counts adds 1/e to the 2 that its degree of freedom should add to the
/// statistic's variance. A hundred tests together need p-values of 1e-4, far out in the tail, where that
/// excess doubles the false alarms.
const MIN_EXPECTED: f64 = 25.0;

/// Tests `observed` counts of cells against `expected` ones; both sum to the number of samples. Cells are
/// pooled in ascending order of their expectation until each pool expects at least 25.
pub fn chi2_test(observed: &[f64], expected: &[f64]) -> Chi2 {
    let mut cells: Vec<(f64, f64)> = expected.iter().copied().zip(observed.iter().copied()).collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut impossible = false;
    let (mut statistic, mut pools) = (0.0, 0usize);
    let (mut e, mut o) = (0.0, 0.0);
    let mut last = None;
    for (expected, observed) in cells {
        impossible |= expected <= 0.0 && observed > 0.0;
        (e, o) = (e + expected, o + observed);
        if e >= MIN_EXPECTED {
            statistic += (o - e) * (o - e) / e;
            pools += 1;
            last = Some((e, o));
            (e, o) = (0.0, 0.0);
        }
    }
    // The remaining cells expect less than that, so they join the last pool.
    if let (Some((le, lo)), true) = (last, e > 0.0) {
        statistic -= (lo - le) * (lo - le) / le;
        statistic += (lo + o - le - e) * (lo + o - le - e) / (le + e);
    }
    let degrees = pools.saturating_sub(1);
    let p_value = match (impossible, degrees) {
        (true, _) => 0.0,
        (false, 0) => 1.0,
        (false, n) => gamma_q(0.5 * n as f64, 0.5 * statistic),
    };
    Chi2 { statistic, degrees, p_value }
}

/// Minimum p-value of a single test at which `tests` independent tests pass together at `significance`
/// (Sidak).
pub fn threshold(significance: f64, tests: usize) -> f64 {
    1.0 - (1.0 - significance).powf(1.0 / tests.max(1) as f64)
}

/// ln Gamma(x) for x > 0, by Stirling's series at x + 8, with an error below 1e-14.
fn ln_gamma(x: f64) -> f64 {
    let y = x + 8.0;
    let series = (1.0 / 12.0 - (1.0 / 360.0 - (1.0 / 1260.0 - 1.0 / (1680.0 * y * y)) / (y * y)) / (y * y)) / y;
    let stirling = (y - 0.5) * y.ln() - y + 0.5 * std::f64::consts::TAU.ln() + series;
    stirling - (0..8).map(|k| (x + f64::from(k)).ln()).sum::<f64>()
}

/// Regularized upper incomplete gamma function Q(a, x) for a > 0, by its series below a + 1 and by a
/// continued fraction (Lentz) above.
fn gamma_q(a: f64, x: f64) -> f64 {
    if x.is_nan() {
        return 0.0;
    }
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    // Both expansions need about sqrt(a) terms near x = a. The limit only ends the loop for NaN.
    let limit = 1000 + 20 * a.sqrt() as usize;
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..limit {
            term *= x / (a + n as f64);
            sum += term;
            if term < sum * 1e-16 {
                break;
            }
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let mut c = 1e300;
    let mut d = 1.0 / b;
    let mut h = d;
    for n in 1..limit {
        let an = -(n as f64) * (n as f64 - a);
        b += 2.0;
        d = 1.0 / nonzero(an * d + b);
        c = nonzero(b + an / c);
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

fn nonzero(x: f64) -> f64 {
    if x.abs() < 1e-300 { 1e-300 } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_q_matches_known_values() {
        // Q(1, x) = e^-x; Q(1/2, x) = erfc(sqrt x); the last three are from scipy.special.gammaincc.
        for (a, x, want) in [
            (1.0, 0.3, (-0.3f64).exp()),
            (1.0, 7.0, (-7.0f64).exp()),
            (0.5, 1.0, 0.157_299_207_050_285_13),
            (0.5, 9.0, 2.209_049_699_858_544e-5),
            (10.0, 12.5, 0.2014311049455359),
            (500.0, 480.0, 0.813_718_026_809_675_4),
            (500.0, 620.0, 2.815_233_228_954_229e-7),
        ] {
            let got = gamma_q(a, x);
            assert!((got / want - 1.0).abs() < 1e-10, "Q({a}, {x}): got {got}, want {want}");
        }
    }

    #[test]
    fn counts_that_follow_pass_and_others_fail() {
        let expected = [100.0, 200.0, 300.0, 10.0, 10.0, 10.0];
        let near = chi2_test(&[105.0, 190.0, 304.0, 5.0, 20.0, 10.0], &expected);
        assert_eq!(near.degrees, 3);
        assert!(near.p_value > 0.3, "{near:?}");
        assert!(chi2_test(&[150.0, 150.0, 300.0, 10.0, 10.0, 10.0], &expected).p_value < 1e-5);
        assert_eq!(chi2_test(&[10.0, 10.0, 1.0], &[10.5, 10.5, 0.0]).p_value, 0.0);
    }

    #[test]
    fn threshold_corrects_for_the_number_of_tests() {
        assert!((threshold(0.01, 1) - 0.01).abs() < 1e-15);
        assert!((threshold(0.01, 100) - 1.00498e-4).abs() < 1e-8);
    }
}
