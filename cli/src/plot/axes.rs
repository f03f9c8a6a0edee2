//! Scales, color bars and the marks along panels.

use super::color::{self, Rgb};
use super::figure::{Align, CAP, Figure, GRAY, INK, LINE, Panel};
use super::text;

/// A logarithmic scale of densities that spans whole decades below its top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogScale {
    /// log10 of the value at the top.
    pub top: f64,
    /// Decades shown.
    pub decades: f64,
}

impl LogScale {
    /// The scale whose top is the next of 1, 2, 5, 10, ... at or above `max`. Anything that is not positive
    /// counts as 1.
    pub fn above(max: f64, decades: f64) -> Self {
        let max = if max > 0.0 && max.is_finite() { max } else { 1.0 };
        let floor = max.log10().floor();
        let step =
            [1.0, 2.0, 5.0, 10.0].into_iter().find(|s| s * 10f64.powf(floor) >= max * (1.0 - 1e-9)).unwrap_or(10.0);
        LogScale { top: floor + f64::log10(step), decades }
    }

    /// Position of `value` in [0, 1]; 0 for values below the bottom, including zero and negative ones.
    pub fn position(&self, value: f64) -> f64 {
        if value > 0.0 { ((value.log10() - self.top) / self.decades + 1.0).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Position of a signed `value` in [-1, 1]: its sign, and its magnitude on the same scale.
    pub fn signed(&self, value: f64) -> f64 {
        self.position(value.abs()).copysign(value)
    }

    /// Marks at the powers of ten of the scale.
    pub fn labels(&self) -> Ticks {
        let (from, to) = ((self.top - self.decades).ceil() as i32, (self.top + 1e-9).floor() as i32);
        (from..=to).map(|e| (((e as f64 - self.top) / self.decades + 1.0).clamp(0.0, 1.0), power(e))).collect()
    }
}

/// `10^e` in markup.
fn power(e: i32) -> String {
    match e {
        0 => "1".into(),
        1 => "10".into(),
        -1 => "0.1".into(),
        _ => format!("10^{{{e}}}"),
    }
}

/// Width of a color bar with its numbers and its title.
pub const BAR: i32 = 100;
const BAR_INK: i32 = 16;

/// Draws a vertical color bar with its upper left corner at `(x, y)`: `color` maps [0, 1], followed by marks
/// and title.
fn bar(figure: &mut Figure, [x, y, h]: [i32; 3], color: impl Fn(f64) -> Rgb, ticks: &Ticks, title: &str) {
    let at = Panel { x, y, w: BAR_INK, h };
    figure.pixels(at, |_, j| color(1.0 - (f64::from(j) + 0.5) / f64::from(h)));
    figure.frame(at, INK);
    for (p, label) in spaced(ticks, f64::from(h), |_| f64::from(LINE)) {
        let at = f64::from(y) + (1.0 - p) * f64::from(h);
        let right = f64::from(x + BAR_INK);
        figure.line([right, at], [right + 5.0, at], INK, 0.0);
        figure.text(x + BAR_INK + 9, at.round() as i32 - CAP / 2, &label, Align::Left, INK);
    }
    figure.text_up(x + BAR - 24, y + h / 2, h, title);
}

/// Color bar of densities.
pub fn density_bar(figure: &mut Figure, at: [i32; 3], scale: LogScale, title: &str) {
    bar(figure, at, color::sequential, &scale.labels(), title);
}

/// Color bar of signed differences: both signs on the same logarithmic scale, meeting at its bottom.
pub fn residual_bar(figure: &mut Figure, at: [i32; 3], scale: LogScale, title: &str) {
    let half = |p: f64, sign: f64, label: &str| {
        (0.5 + 0.5 * sign * p, format!("{}{label}", ["-", "+"][usize::from(sign > 0.0)]))
    };
    let apart = 2.0 * f64::from(LINE) / f64::from(at[2]);
    let shown: Ticks = scale.labels().into_iter().filter(|(p, _)| *p >= apart).collect();
    let signed = shown.iter().flat_map(|(p, label)| [half(*p, -1.0, label), half(*p, 1.0, label)]);
    let ticks: Ticks = signed.chain([(0.5, "0".into())]).collect();
    bar(figure, at, |t| color::diverging(2.0 * t - 1.0), &ticks, title);
}

/// Color bar of a linear scale from 0 to `max`.
pub fn linear_bar(figure: &mut Figure, at: [i32; 3], max: f64, title: &str) {
    bar(figure, at, color::sequential, &linear(0.0, max, f64::from((at[2] / 60).clamp(2, 5))), title);
}

/// Removes marks that overlap the previous one, given their sizes.
fn spaced(ticks: &Ticks, length: f64, size: impl Fn(&str) -> f64) -> Ticks {
    let mut shown: Ticks = Vec::new();
    let mut ticks: Vec<&(f64, String)> = ticks.iter().collect();
    ticks.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (p, label) in ticks {
        let available = |(q, last): &(f64, String)| (p - q) * length - 0.5 * (size(last) + size(label));
        if shown.last().is_none_or(|last| available(last) >= -1e-6) {
            shown.push((*p, label.clone()));
        }
    }
    shown
}

/// The step of 1, 2 or 5 times a power of ten that cuts [0, max] into about `count` parts.
fn nice_step(max: f64, count: f64) -> f64 {
    let raw = (max / count).max(1e-300);
    let base = 10f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|s| s * base).find(|s| *s >= raw * 0.999).unwrap_or(10.0 * base)
}

/// Round marks between two values, about `count` of them.
pub fn linear(from: f64, to: f64, count: f64) -> Ticks {
    every(from, to, nice_step(to - from, count))
}

/// Marks at the multiples of `step` between two values.
pub fn every(from: f64, to: f64, step: f64) -> Ticks {
    let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    let (first, last) = ((from / step - 1e-9).ceil() as i64, (to / step + 1e-9).floor() as i64);
    let mark = |i: i64| ((i as f64 * step - from) / (to - from), format!("{:.digits$}", i as f64 * step + 0.0));
    (first..=last).map(mark).collect()
}

/// Marks along an edge of a panel: position in [0, 1] and label.
pub type Ticks = Vec<(f64, String)>;

/// Space below a panel for marks, and for the axis name below them.
pub const BELOW: i32 = 2 * LINE + 8;
/// Space to the left of a panel for marks, and for the axis name beside them.
pub const LEFT: i32 = 76;

/// Marks below a panel and the axis' name below them.
pub fn below(figure: &mut Figure, at: Panel, ticks: &Ticks, title: &str) {
    let y = at.y + at.h;
    let near = |label: &str| f64::from(text::width(label) + 8);
    for (p, label) in spaced(ticks, f64::from(at.w), near) {
        let x = f64::from(at.x) + p * f64::from(at.w);
        figure.line([x, f64::from(y)], [x, f64::from(y + 6)], INK, 0.0);
        figure.text(x.round() as i32, y + 10, &label, Align::Center, GRAY);
    }
    figure.text_within(at.x + at.w / 2, y + 10 + LINE, at.w + 40, title, Align::Center, INK);
}

/// Marks at the left of a panel, position 0 at the bottom, and the axis' name, upwards, beside them.
pub fn left(figure: &mut Figure, at: Panel, ticks: &Ticks, title: &str) {
    for (p, label) in spaced(ticks, f64::from(at.h), |_| f64::from(LINE - 4)) {
        let y = f64::from(at.y) + (1.0 - p) * f64::from(at.h);
        figure.line([f64::from(at.x - 6), y], [f64::from(at.x), y], INK, 0.0);
        figure.text(at.x - 10, y.round() as i32 - CAP / 2, &label, Align::Right, GRAY);
    }
    figure.text_up(at.x - LEFT, at.y + at.h / 2, at.h, title);
}

/// The title above a panel, shortened to its width.
pub fn above(figure: &mut Figure, at: Panel, title: &str) {
    figure.text_within(at.x + at.w / 2, at.y - LINE, at.w, title, Align::Center, INK);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_tops_are_round_and_positions_are_decades() {
        for (max, top) in [(0.8, 1.0), (1.0, 1.0), (1.3, 2.0), (0.03, 0.05), (60.0, 100.0)] {
            let scale = LogScale::above(max, 4.0);
            assert!((scale.top - f64::log10(top)).abs() < 1e-12, "{max}: 10^{}", scale.top);
            assert!((scale.position(top * 1e-2) - 0.5).abs() < 1e-12);
            assert!((scale.signed(-top * 1e-1) + 0.75).abs() < 1e-12);
            assert_eq!(scale.position(0.0), 0.0);
            assert_eq!(scale.position(f64::NAN), 0.0);
        }
        assert_eq!(LogScale::above(0.0, 4.0), LogScale::above(1.0, 4.0));
    }

    #[test]
    fn linear_marks_are_round() {
        let labels = |from, to, count| linear(from, to, count).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(0.0, 0.13, 3.0), ["0.00", "0.05", "0.10"]);
        assert_eq!(linear(0.0, 1.0, 4.0).len(), 3);
        assert_eq!(labels(-180.0, 180.0, 4.0), ["-100", "0", "100"]);
        let degrees: Vec<String> = every(-180.0, 180.0, 90.0).into_iter().map(|t| t.1).collect();
        assert_eq!(degrees, ["-180", "-90", "0", "90", "180"]);
        let at: Vec<f64> = linear(0.0, 0.3, 3.0).into_iter().map(|t| t.0).collect();
        assert!((at[1] - 1.0 / 3.0).abs() < 1e-12 && at.len() == 4, "{at:?}");
    }

    #[test]
    fn marks_keep_apart() {
        let ticks: Ticks = (0..=10).map(|i| (f64::from(i) / 10.0, i.to_string())).collect();
        let shown = |length| spaced(&ticks, length, |_| 20.0).len();
        assert_eq!((shown(200.0), shown(100.0), shown(5.0)), (11, 6, 1));
    }
}
