//! A grid of numbers over (theta_i, h), colored by their size.

use super::figure::{Align, CAP, Figure, GRAY, INK, LINE, Panel};
use super::{axes, color, text};

/// Numbers over the nodes, `values[theta_i][h]`, last fastest.
#[derive(Clone, Debug)]
pub struct Numbers {
    /// Incident latitudes [rad], ascending.
    pub theta_i: Vec<f64>,
    /// Offsets over the ply radius, ascending.
    pub h_rel: Vec<f64>,
    /// One number a node; a NaN is shown as a dash.
    pub values: Vec<f64>,
}

impl Numbers {
    /// Largest finite number.
    pub fn max(&self) -> f64 {
        self.values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max)
    }
}

/// Color of a cell without a number.
const NONE: color::Rgb = [225, 225, 228];

/// Draws the grid in percent, theta_i upwards and h rightwards, colors from 0 to `max`, with a color bar at
/// the right.
pub fn draw(figure: &mut Figure, at: Panel, numbers: &Numbers, max: f64, title: &str) {
    let Panel { x, y, w, h } = at;
    let (rows, columns) = (numbers.theta_i.len(), numbers.h_rel.len());
    let edge = |i: usize, n: usize, size: i32| (i as i64 * size as i64 / n as i64) as i32;
    // Numbers are written where they fit; in finer grids in every second cell.
    let cell = (w / columns as i32).max(1);
    let stride = ((text::width("0.00") + 2) / cell + 1) as usize;
    let fits = h / rows as i32 >= CAP + 4;
    for r in 0..rows {
        let (top, bottom) = (y + h - edge(r + 1, rows, h), y + h - edge(r, rows, h));
        for c in 0..columns {
            let (left, right) = (x + edge(c, columns, w), x + edge(c + 1, columns, w));
            let value = numbers.values[r * columns + c];
            let color = if value.is_finite() { color::sequential(value / max) } else { NONE };
            figure.fill(Panel { x: left, y: top, w: right - left, h: bottom - top }, color);
            if fits && c % stride == stride / 2 {
                let text = if value.is_finite() { short(value) } else { "-".into() };
                let ink = color::ink_on(color);
                figure.text((left + right) / 2, (top + bottom - CAP) / 2, &text, Align::Center, ink);
            }
        }
        if fits || r % 2 == 0 {
            let label = format!("{}°", crate::report::number(numbers.theta_i[r].to_degrees().round()));
            figure.text(x - 8, (top + bottom - CAP) / 2, &label, Align::Right, GRAY);
        }
    }
    figure.frame(at, INK);
    let middle = |c: usize| (c as f64 + 0.5) / columns as f64;
    let ticks = numbers.h_rel.iter().enumerate().map(|(c, h)| (middle(c), format!("{h:.2}"))).collect();
    axes::below(figure, at, &ticks, "h / R");
    figure.text_up(x - axes::LEFT, y + h / 2, h, "θ_i");
    figure.text_within(x, y - LINE - 4, w + axes::BAR, title, Align::Left, INK);
    axes::linear_bar(figure, [x + w + 14, y, h], 100.0 * max, "");
}

/// Percent in at most three characters: 0.4, 3.1, 12, >1k; a dash for 0, which says that noise hid the error.
fn short(value: f64) -> String {
    match 100.0 * value {
        v if v <= 0.0 => "-".into(),
        v if v < 9.95 => format!("{v:.1}"),
        v if v < 999.5 => format!("{v:.0}"),
        _ => ">1k".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (v, want) in [(0.0, "-"), (0.0432, "4.3"), (0.312, "31"), (1.24, "124"), (37.0, ">1k")] {
            assert_eq!(short(v), want);
        }
    }

    #[test]
    fn cells_are_colored_from_the_bottom_left() {
        let numbers =
            Numbers { theta_i: vec![0.0, 0.5], h_rel: vec![-1.0, 1.0], values: vec![0.0, 1.0, f64::NAN, 0.5] };
        let mut figure = Figure::new(400, 300);
        draw(&mut figure, Panel { x: 90, y: 40, w: 100, h: 100 }, &numbers, 1.0, "");
        let image = figure.raster();
        assert_eq!(image.get_pixel(92, 138).0, color::sequential(0.0));
        assert_eq!(image.get_pixel(188, 138).0, color::sequential(1.0));
        assert_eq!(image.get_pixel(92, 42).0, NONE);
        assert_eq!(image.get_pixel(188, 42).0, color::sequential(0.5));
    }
}
