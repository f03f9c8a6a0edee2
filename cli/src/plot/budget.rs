//! The energy budget of a ply over (theta_i, h): stacked shares of the beam's power.

use super::axes::{self, Ticks};
use super::canvas::{Align, Canvas, GRAY, INK, LINE};
use super::colormap::Rgb;
use super::map::Panel;

/// Shares of the beam's power over h at one theta_i; arrays `[h]`.
#[derive(Clone, Debug)]
pub struct Budget {
    /// Incident latitude [rad].
    pub theta_i: f64,
    /// Offset over the ply radius.
    pub h_rel: Vec<f64>,
    /// Light that was only reflected.
    pub refl: Vec<f64>,
    /// All other scattered light that is left at the chosen absorption.
    pub high: Vec<f64>,
    /// What the fibers took of it.
    pub absorbed: Vec<f64>,
    /// What met no fiber.
    pub r_d: Vec<f64>,
}

/// The parts in their order of stacking: name and colour.
pub const PARTS: [(&str, Rgb); 4] = [
    ("refl", [214, 112, 66]),
    ("high", [240, 200, 116]),
    ("absorbed", [92, 84, 104]),
    ("r_d (missed)", [198, 216, 230]),
];

/// Draws the stack over h into a panel; the h axis spans the table's range.
pub fn draw(canvas: &mut Canvas, panel: Panel, budget: &Budget, below: bool, left: bool) {
    let Panel { x, y, w, h } = panel;
    let (from, to) = (budget.h_rel[0], budget.h_rel[budget.h_rel.len() - 1]);
    let span = (to - from).max(1e-12);
    canvas.fill(x, y, w, h, [255, 255, 255]);
    for i in 0..w {
        let at = from + span * (i as f64 + 0.5) / w as f64;
        let mut low = 0.0;
        for (part, (_, color)) in [&budget.refl, &budget.high, &budget.absorbed, &budget.r_d].into_iter().zip(PARTS) {
            let high = low + interpolate(&budget.h_rel, part, at).max(0.0);
            let row = |v: f64| y + h - (v.min(1.02) * h as f64).round() as i32;
            let (upper, lower) = (row(high).max(y), row(low));
            canvas.fill(x + i, upper, 1, lower - upper, color);
            low = high;
        }
    }
    // The ply's own rim.
    for rim in [-1.0, 1.0] {
        if rim > from && rim < to {
            let at = x + ((rim - from) / span * w as f64) as i32;
            for j in (0..h).step_by(8) {
                canvas.fill(at, y + j, 1, 4.min(h - j), INK);
            }
        }
    }
    canvas.frame(x, y, w, h, INK);
    let ticks: Ticks = (-4..=4)
        .map(|k| 0.5 * k as f64)
        .filter(|v| *v >= from - 1e-9 && *v <= to + 1e-9 && (v.fract() == 0.0))
        .map(|v| ((v - from) / span, format!("{v}")))
        .collect();
    if below {
        axes::ticks_below(canvas, x, y + h, w, &ticks);
        canvas.text(x + w / 2, y + h + 14 + LINE, "h / R", Align::Center, INK);
    }
    if left {
        axes::ticks_left(canvas, x, y, h, &[0.0, 0.5, 1.0].map(|v| (v, format!("{v:.1}"))).to_vec());
    }
    canvas.text(
        x + w / 2,
        y - LINE,
        &format!("θ_i = {}°", crate::report::number((10.0 * budget.theta_i.to_degrees()).round() / 10.0)),
        Align::Center,
        INK,
    );
}

/// The legend on one line; returns where it ends.
pub fn legend(canvas: &mut Canvas, x: i32, y: i32, sigma_per_um: f64) -> i32 {
    let mut at = x;
    for (name, color) in PARTS {
        canvas.fill(at, y, 14, 14, color);
        canvas.frame(at, y, 14, 14, GRAY);
        let name = match name {
            "absorbed" => format!("absorbed at σ = {} /μm", crate::report::number(sigma_per_um)),
            name => name.to_string(),
        };
        canvas.text(at + 22, y, &name, Align::Left, INK);
        at += 22 + Canvas::text_width(&name) + 28;
    }
    for j in (0..14).step_by(8) {
        canvas.fill(at + 6, y + j, 1, 4, INK);
    }
    canvas.text(at + 20, y, "rim of the ply", Align::Left, INK);
    at + 20 + Canvas::text_width("rim of the ply")
}

/// Piecewise linear interpolation, held at the ends.
fn interpolate(xs: &[f64], ys: &[f64], x: f64) -> f64 {
    let last = xs.len() - 1;
    let k = xs.partition_point(|v| *v <= x).clamp(1, last.max(1)) - 1;
    if last == 0 {
        return ys[0];
    }
    let t = ((x - xs[k]) / (xs[k + 1] - xs[k])).clamp(0.0, 1.0);
    ys[k] + t * (ys[k + 1] - ys[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_linear_between_and_held_beyond() {
        let (xs, ys) = ([-1.0, 0.0, 2.0], [1.0, 3.0, 7.0]);
        for (x, want) in [(-2.0, 1.0), (-1.0, 1.0), (-0.5, 2.0), (0.0, 3.0), (1.0, 5.0), (2.0, 7.0), (9.0, 7.0)] {
            let got = interpolate(&xs, &ys, x);
            assert!((got - want).abs() < 1e-12, "{x}: got {got}, want {want}");
        }
        assert_eq!(interpolate(&[1.0], &[5.0], 3.0), 5.0);
    }

    #[test]
    fn stack_fills_the_panel_in_order() {
        let budget = Budget {
            theta_i: 0.0,
            h_rel: vec![-1.5, 0.0, 1.5],
            refl: vec![0.1; 3],
            high: vec![0.4; 3],
            absorbed: vec![0.2; 3],
            r_d: vec![0.3; 3],
        };
        let mut canvas = Canvas::new(120, 200);
        draw(&mut canvas, Panel { x: 10, y: 50, w: 100, h: 100 }, &budget, false, false);
        let image = canvas.into_image();
        for (share, part) in [(0.05, 0), (0.3, 1), (0.6, 2), (0.85, 3)] {
            let y = 150 - (share * 100.0) as u32;
            assert_eq!(image.get_pixel(60, y).0, PARTS[part].1, "at {share}");
        }
    }
}
