//! The energy budget of a ply over (theta_i, h): stacked shares of the beam's power.

use super::axes;
use super::color::Rgb;
use super::figure::{Figure, INK, LINE, Panel};
use super::{page, text};

/// Shares of the beam's power over h at one theta_i; arrays `[h]`.
#[derive(Clone, Debug)]
pub struct Budget {
    /// Incident latitude [rad].
    pub theta_i: f64,
    /// Offset relative to the ply radius.
    pub h_rel: Vec<f64>,
    /// Light of single reflection.
    pub refl: Vec<f64>,
    /// All other scattered light that remains at the chosen absorption.
    pub high: Vec<f64>,
    /// Light that the fibers absorb.
    pub absorbed: Vec<f64>,
    /// Light that misses all fibers.
    pub r_d: Vec<f64>,
}

/// The parts in their order of stacking: name and color.
pub const PARTS: [(&str, Rgb); 4] = [
    ("refl", [214, 112, 66]),
    ("high", [240, 200, 116]),
    ("absorbed", [92, 84, 104]),
    ("r_d (missed)", [198, 216, 230]),
];

/// Draws the stack over h into a panel; the h axis spans the table's range.
pub fn draw(figure: &mut Figure, at: Panel, budget: &Budget, left: bool) {
    let (from, to) = (budget.h_rel[0], budget.h_rel[budget.h_rel.len() - 1]);
    let span = (to - from).max(1e-12);
    let x = |h: f64| f64::from(at.x) + (h - from) / span * f64::from(at.w);
    // The stack may exceed 1 by the noise of the simulation.
    let y = |share: f64| f64::from(at.y) + (1.0 - share) * f64::from(at.h);
    let mut low = vec![0.0; budget.h_rel.len()];
    figure.clipped(at, |figure| {
        for (part, (_, color)) in [&budget.refl, &budget.high, &budget.absorbed, &budget.r_d].into_iter().zip(PARTS) {
            let high: Vec<f64> = low.iter().zip(part).map(|(low, part)| low + part.max(0.0)).collect();
            let edge = |shares: &[f64]| -> Vec<[f64; 2]> {
                budget.h_rel.iter().zip(shares).map(|(h, share)| [x(*h), y(*share)]).collect()
            };
            figure.area(edge(&low).into_iter().chain(edge(&high).into_iter().rev()), color, 1.0);
            low = high;
        }
        // The ply's own rim.
        for rim in [-1.0, 1.0] {
            figure.line([x(rim), y(0.0)], [x(rim), y(1.0)], INK, 4.0);
        }
    });
    figure.frame(at, INK);
    let ticks = [-2.0f64, -1.0, 0.0, 1.0, 2.0].map(|v| ((v - from) / span, format!("{v}")));
    let shown = ticks.into_iter().filter(|(p, _)| (-1e-9..=1.0 + 1e-9).contains(p)).collect();
    axes::below(figure, at, &shown, "h / R");
    if left {
        axes::left(figure, at, &axes::linear(0.0, 1.0, 2.0), "share of the power");
    }
    let degrees = crate::report::number((10.0 * budget.theta_i.to_degrees()).round() / 10.0);
    axes::above(figure, at, &format!("θ_i = {degrees}°"));
}

/// The legend on one line.
pub fn legend(figure: &mut Figure, x: i32, y: i32, sigma_per_um: f64) {
    let name = |name: &str| match name {
        "absorbed" => format!("absorbed at σ = {} /μm", crate::report::number(sigma_per_um)),
        name => name.to_string(),
    };
    let names = PARTS.map(|(part, color)| (name(part), color));
    page::legend(figure, [x, y], &names, i32::MAX);
    let width: i32 = names.iter().map(|(name, _)| page::NEXT + page::SWATCH + text::width(name)).sum();
    let at = f64::from(x + width + 8);
    figure.line([at, f64::from(y - 2)], [at, f64::from(y + LINE - 6)], INK, 4.0);
    figure.text(x + width + 18, y, "rim of the ply", super::figure::Align::Left, INK);
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let drawn = |budget: &Budget| {
            let mut figure = Figure::new(120, 200);
            draw(&mut figure, Panel { x: 10, y: 50, w: 100, h: 100 }, budget, false);
            figure.raster()
        };
        let image = drawn(&budget);
        for (share, part) in [(0.05, 0), (0.3, 1), (0.6, 2), (0.85, 3)] {
            let y = 150 - (share * 100.0) as u32;
            assert_eq!(image.get_pixel(60, y).0, PARTS[part].1, "at {share}");
        }
        // Linear between nodes: a quarter of the way from 0 to the middle's 0.8, the border lies at 0.2 and
        // 0.4.
        let image = drawn(&Budget {
            refl: vec![0.0, 0.8, 0.0],
            high: vec![0.0; 3],
            absorbed: vec![0.0; 3],
            r_d: vec![1.0; 3],
            ..budget
        });
        for (x, border) in [(22, 0.2), (35, 0.4), (60, 0.8), (85, 0.4)] {
            let at = |share: f64| image.get_pixel(x, 150 - (share * 100.0) as u32).0;
            assert_eq!((at(border - 0.04), at(border + 0.04)), (PARTS[0].1, PARTS[3].1), "at {x}");
        }
    }
}
