//! Scales, colour bars and the frames around panels.

use super::canvas::{Align, CAP, Canvas, GRAY, INK};
use super::colormap;

/// A logarithmic scale of densities that spans whole decades below its top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogScale {
    /// log10 of the value at the top.
    pub top: f64,
    /// Decades shown.
    pub decades: f64,
}

impl LogScale {
    /// The scale whose top is the next of 1, 2, 5, 10, ... at or above `max`. Anything that is not positive counts as 1.
    pub fn above(max: f64, decades: f64) -> Self {
        let max = if max > 0.0 && max.is_finite() { max } else { 1.0 };
        let floor = max.log10().floor();
        let step =
            [1.0, 2.0, 5.0, 10.0].into_iter().find(|s| s * 10f64.powf(floor) >= max * (1.0 - 1e-9)).unwrap_or(10.0);
        LogScale { top: floor + f64::log10(step), decades }
    }

    /// Position of `value` in [0, 1]; 0 for what is below the bottom, zero and negative values included.
    pub fn position(&self, value: f64) -> f64 {
        if value > 0.0 { ((value.log10() - self.top) / self.decades + 1.0).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Position of a signed `value` in [-1, 1]: its sign, and its size on the same scale.
    pub fn signed(&self, value: f64) -> f64 {
        self.position(value.abs()).copysign(value)
    }

    /// Its powers of ten as marks.
    pub fn labels(&self) -> Ticks {
        self.ticks().into_iter().map(|(p, e)| (p, power(e))).collect()
    }

    /// The powers of ten shown, as (position, exponent).
    fn ticks(&self) -> Vec<(f64, i32)> {
        let (from, to) = ((self.top - self.decades).ceil() as i32, (self.top + 1e-9).floor() as i32);
        (from..=to).map(|e| (((e as f64 - self.top) / self.decades + 1.0).clamp(0.0, 1.0), e)).collect()
    }
}

/// `10^e` in the canvas' markup.
fn power(e: i32) -> String {
    match e {
        0 => "1".into(),
        1 => "10".into(),
        -1 => "0.1".into(),
        _ => format!("10^{{{e}}}"),
    }
}

/// Width [dots] of a colour bar with its numbers and its title.
pub const BAR: i32 = 120;
const BAR_INK: i32 = 16;

/// Vertical colour bar of a density scale, its top left corner at `(x, y)`.
pub fn density_bar(canvas: &mut Canvas, x: i32, y: i32, h: i32, scale: LogScale, title: &str) {
    for j in 0..h {
        canvas.fill(x, y + j, BAR_INK, 1, colormap::sequential(1.0 - (j as f64 + 0.5) / h as f64));
    }
    canvas.frame(x, y, BAR_INK, h, INK);
    for (p, e) in scale.ticks() {
        tick(canvas, x, y + h - 1 - (p * (h - 1) as f64).round() as i32, &power(e));
    }
    canvas.text_up(x + BAR - 30, y + h / 2, title, Align::Center, INK);
}

/// Vertical colour bar of signed differences: both signs on the same logarithmic scale, meeting at its bottom.
pub fn residual_bar(canvas: &mut Canvas, x: i32, y: i32, h: i32, scale: LogScale, title: &str) {
    for j in 0..h {
        canvas.fill(x, y + j, BAR_INK, 1, colormap::diverging(1.0 - 2.0 * (j as f64 + 0.5) / h as f64));
    }
    canvas.frame(x, y, BAR_INK, h, INK);
    let middle = y + h / 2;
    let mut last = 0;
    for (p, e) in scale.ticks().into_iter().rev() {
        let up = (p * (h / 2 - 1) as f64).round() as i32;
        // Numbers stand at least two capitals apart, and off the zero.
        if up < 2 * CAP || (last != 0 && last - up < 2 * CAP) {
            continue;
        }
        last = up;
        tick(canvas, x, middle - up, &format!("+{}", power(e)));
        tick(canvas, x, middle + up, &format!("-{}", power(e)));
    }
    tick(canvas, x, middle, "0");
    canvas.text_up(x + BAR - 30, y + h / 2, title, Align::Center, INK);
}

fn tick(canvas: &mut Canvas, x: i32, y: i32, label: &str) {
    canvas.fill(x + BAR_INK, y, 5, 1, INK);
    canvas.text(x + BAR_INK + 9, y - CAP / 2, label, Align::Left, INK);
}

/// Vertical colour bar of a linear scale from 0 to `max`.
pub fn linear_bar(canvas: &mut Canvas, x: i32, y: i32, h: i32, max: f64, title: &str) {
    for j in 0..h {
        canvas.fill(x, y + j, BAR_INK, 1, colormap::sequential(1.0 - (j as f64 + 0.5) / h as f64));
    }
    canvas.frame(x, y, BAR_INK, h, INK);
    let step = nice_step(max, (h / 60).clamp(2, 5) as f64);
    for (value, label) in linear_ticks(max, step) {
        tick(canvas, x, y + h - 1 - (value / max * (h - 1) as f64).round() as i32, &label);
    }
    canvas.text_up(x + BAR - 30, y + h / 2, title, Align::Center, INK);
}

/// The step of 1, 2 or 5 times a power of ten that cuts [0, max] into about `count` parts.
pub fn nice_step(max: f64, count: f64) -> f64 {
    let raw = (max / count).max(1e-300);
    let base = 10f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|s| s * base).find(|s| *s >= raw * 0.999).unwrap_or(10.0 * base)
}

fn linear_ticks(max: f64, step: f64) -> Vec<(f64, String)> {
    let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    (0..=(max / step * (1.0 + 1e-9)) as i32)
        .map(|i| (i as f64 * step, format!("{:.digits$}", i as f64 * step)))
        .collect()
}

/// Marks along an edge of a panel: position in [0, 1] and label.
pub type Ticks = Vec<(f64, String)>;

/// Ticks and labels below a panel.
pub fn ticks_below(canvas: &mut Canvas, x: i32, y: i32, w: i32, ticks: &Ticks) {
    for (p, label) in ticks {
        let at = x + (p * (w - 1) as f64).round() as i32;
        canvas.fill(at, y + 1, 1, 5, INK);
        canvas.text(at, y + 10, label, Align::Center, GRAY);
    }
}

/// Ticks and labels at the left of a panel; position 0 is the bottom.
pub fn ticks_left(canvas: &mut Canvas, x: i32, y: i32, h: i32, ticks: &Ticks) {
    for (p, label) in ticks {
        let at = y + h - 1 - (p * (h - 1) as f64).round() as i32;
        canvas.fill(x - 6, at, 5, 1, INK);
        canvas.text(x - 10, at - CAP / 2, label, Align::Right, GRAY);
    }
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
    fn linear_ticks_are_round() {
        let labels: Vec<String> = linear_ticks(0.13, nice_step(0.13, 3.0)).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["0.00", "0.05", "0.10"]);
        assert_eq!(linear_ticks(1.0, nice_step(1.0, 4.0)).len(), 3);
    }
}
