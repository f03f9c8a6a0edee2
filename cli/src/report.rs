//! Numbers and tables for people.

/// A number with up to six significant digits and no needless zeros.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return format!("{value}");
    }
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = value.abs().log10().floor();
    if !(-5.0..9.0).contains(&magnitude) {
        return format!("{value:.3e}");
    }
    let digits = (5.0 - magnitude).clamp(0.0, 10.0) as usize;
    let text = format!("{value:.digits$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.into() }
}

/// A large count in short: 950, 95.2 k, 1.3 M.
pub fn count(value: f64) -> String {
    match value {
        v if !v.is_finite() => "-".into(),
        v if v < 1e3 => format!("{v:.0}"),
        v if v < 1e6 => format!("{:.1} k", v / 1e3),
        v if v < 1e9 => format!("{:.1} M", v / 1e6),
        v => format!("{:.1} G", v / 1e9),
    }
}

/// A number of things: 1 fiber, 2 fibers.
pub fn counted(n: u64, one: &str, many: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {many}") }
}

/// A size in bytes: 812 B, 34.1 KiB, 2.5 MiB.
pub fn bytes(value: u64) -> String {
    match value as f64 {
        v if v < 1024.0 => format!("{v:.0} B"),
        v if v < 1048576.0 => format!("{:.1} KiB", v / 1024.0),
        v => format!("{:.1} MiB", v / 1048576.0),
    }
}

/// A time: 820 ms, 12.4 s, 3 min 20 s.
pub fn duration(time: std::time::Duration) -> String {
    match time.as_secs_f64() {
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s if s < 100.0 => format!("{s:.1} s"),
        s => format!("{:.0} min {:02.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
    }
}

/// Least, root mean square and largest of some numbers; NaNs are left out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Least.
    pub min: f64,
    /// Root mean square.
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Of a model's stored fit errors. A stored 0 says that noise hid the error: it counts as unknown, not as
    /// perfect.
    pub fn of_errors(values: impl IntoIterator<Item = f64>) -> Self {
        Self::from_values(values.into_iter().filter(|v| *v > 0.0))
    }

    /// Of these numbers; all zero when there are none.
    pub fn from_values(values: impl IntoIterator<Item = f64>) -> Self {
        let (mut n, mut min, mut max, mut square) = (0u64, f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for v in values.into_iter().filter(|v| !v.is_nan()) {
            n += 1;
            min = min.min(v);
            max = max.max(v);
            square += v * v;
        }
        if n == 0 {
            return Spread { min: 0.0, rms: 0.0, max: 0.0 };
        }
        Spread { min, rms: (square / n as f64).sqrt(), max }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Of no numbers, or zeros, which say the same of errors.
        if (self.min, self.max) == (0.0, 0.0) {
            return f.write_str("none known");
        }
        write!(f, "{:.4} .. {:.4}, rms {:.4}", self.min, self.max, self.rms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        for (v, want) in
            [(0.0, "0"), (30.0, "30"), (0.35, "0.35"), (-1.25, "-1.25"), (100000.0, "100000"), (1e-7, "1.000e-7")]
        {
            assert_eq!(number(v), want);
        }
        assert_eq!(number(29.999999999), "30");
        assert_eq!(count(95_210.0), "95.2 k");
        assert_eq!((counted(1, "ply", "plies"), counted(0, "ply", "plies")), ("1 ply".into(), "0 plies".into()));
        assert_eq!(bytes(34_900), "34.1 KiB");
        assert_eq!(duration(std::time::Duration::from_secs(200)), "3 min 20 s");
    }

    #[test]
    fn spread_skips_what_is_not_a_number() {
        assert_eq!(Spread::of_errors([0.0, f64::NAN]).to_string(), "none known");
        let s = Spread::from_values([3.0, f64::NAN, 4.0]);
        assert_eq!((s.min, s.max), (3.0, 4.0));
        assert!((s.rms - 12.5f64.sqrt()).abs() < 1e-12);
    }
}
