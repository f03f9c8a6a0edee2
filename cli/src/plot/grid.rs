//! A grid of numbers over (theta_i, h), coloured by their size.

use super::canvas::{Align, CAP, Canvas, GRAY, INK, LINE};
use super::colormap;
use super::map::Panel;
use super::{axes, canvas};

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

/// Draws the grid in percent, theta_i upwards and h rightwards, colours from 0 to `max`, with a colour bar at the right.
pub fn draw(canvas: &mut Canvas, panel: Panel, numbers: &Numbers, max: f64, title: &str) {
    let Panel { x, y, w, h } = panel;
    let (rows, columns) = (numbers.theta_i.len(), numbers.h_rel.len());
    let edge = |i: usize, n: usize, size: i32| (i as i64 * size as i64 / n as i64) as i32;
    // Numbers are written where they fit; in finer grids in every second cell.
    let cell = (w / columns as i32).max(1);
    let width = 3 * canvas::ADVANCE + 2;
    let stride = (width / cell + 1) as usize;
    let room = h / rows as i32 >= CAP + 4;
    for r in 0..rows {
        let (top, bottom) = (y + h - edge(r + 1, rows, h), y + h - edge(r, rows, h));
        for c in 0..columns {
            let (left, right) = (x + edge(c, columns, w), x + edge(c + 1, columns, w));
            let value = numbers.values[r * columns + c];
            let color = if value.is_finite() { colormap::sequential(value / max) } else { [225, 225, 228] };
            canvas.fill(left, top, right - left, bottom - top, color);
            if room && c % stride == stride / 2 {
                let text = if value.is_finite() { short(value) } else { "-".into() };
                canvas.text(
                    (left + right) / 2,
                    (top + bottom - CAP) / 2,
                    &text,
                    Align::Center,
                    colormap::ink_on(color),
                );
            }
        }
        if room || r % 2 == 0 {
            let label = format!("{}°", crate::report::number(numbers.theta_i[r].to_degrees().round()));
            canvas.text(x - 8, (top + bottom - CAP) / 2, &label, Align::Right, GRAY);
        }
    }
    canvas.frame(x, y, w, h, INK);
    let every = columns.div_ceil((w / 70).max(1) as usize);
    for c in (0..columns).step_by(every.max(1)) {
        let label = format!("{:.2}", numbers.h_rel[c]);
        canvas.text(x + (edge(c, columns, w) + edge(c + 1, columns, w)) / 2, y + h + 8, &label, Align::Center, GRAY);
    }
    canvas.text(x + w / 2, y + h + 12 + LINE, "h / R", Align::Center, INK);
    canvas.text_up(x - 74, y + h / 2, "θ_i", Align::Center, INK);
    canvas.text(x, y - LINE - 4, title, Align::Left, INK);
    axes::linear_bar(canvas, x + w + 14, y, h, 100.0 * max, "");
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
    fn cells_are_coloured_from_the_bottom_left() {
        let numbers =
            Numbers { theta_i: vec![0.0, 0.5], h_rel: vec![-1.0, 1.0], values: vec![0.0, 1.0, f64::NAN, 0.5] };
        let mut canvas = Canvas::new(400, 300);
        draw(&mut canvas, Panel { x: 90, y: 40, w: 100, h: 100 }, &numbers, 1.0, "");
        let image = canvas.into_image();
        assert_eq!(image.get_pixel(92, 138).0, colormap::sequential(0.0));
        assert_eq!(image.get_pixel(188, 138).0, colormap::sequential(1.0));
        assert_eq!(image.get_pixel(92, 42).0, [225, 225, 228]);
        assert_eq!(image.get_pixel(188, 42).0, colormap::sequential(0.5));
    }
}
