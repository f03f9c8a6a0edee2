//! Curves over one axis, linear or logarithmic, with bands of their spread; pages of such panels.

use super::axes::{self, LogScale, Ticks};
use super::canvas::{Align, Canvas, GRAY, INK, LINE};
use super::colormap::Rgb;
use super::map::Panel;
use super::sheet::heading;

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its points, x ascending.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper edge of a band about it, one pair a point; empty for none.
    pub band: Vec<[f64; 2]>,
    /// Color.
    pub color: Rgb,
    /// Width [dots].
    pub width: f64,
}

/// Vertical scale of a panel.
#[derive(Clone, Copy, Debug)]
pub enum Scale {
    /// Decades.
    Log(LogScale),
    /// From the first to the second.
    Linear(f64, f64),
}

impl Scale {
    fn position(&self, value: f64) -> f64 {
        match self {
            Scale::Log(scale) if value > 0.0 => (value.log10() - scale.top) / scale.decades + 1.0,
            Scale::Log(_) => -1.0,
            Scale::Linear(from, to) => (value - from) / (to - from),
        }
    }

    fn ticks(&self) -> Ticks {
        match self {
            Scale::Log(scale) => scale.labels(),
            Scale::Linear(from, to) => linear(*from, *to, 5.0),
        }
    }
}

/// Round marks between two values, about `count` of them.
pub fn linear(from: f64, to: f64, count: f64) -> Ticks {
    let step = axes::nice_step(to - from, count);
    let digits = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    let (first, last) = ((from / step - 1e-9).ceil() as i64, (to / step + 1e-9).floor() as i64);
    (first..=last)
        .map(|i| {
            let value = i as f64 * step;
            ((value - from) / (to - from), format!("{:.digits$}", value + 0.0))
        })
        .collect()
}

/// Curves in one frame.
#[derive(Clone, Debug)]
pub struct LinePanel {
    /// Above it.
    pub title: String,
    /// Below it: what x is.
    pub x_title: String,
    /// Ends of the x axis.
    pub x: [f64; 2],
    /// Marks of the x axis.
    pub x_ticks: Ticks,
    /// Vertical scale.
    pub y: Scale,
    /// Curves, the last on top.
    pub curves: Vec<Curve>,
}

impl LinePanel {
    fn draw(&self, canvas: &mut Canvas, at: Panel) {
        let clip = at.clip();
        for (p, _) in self.y.ticks() {
            let y = at.y + at.h - 1 - (p * (at.h - 1) as f64).round() as i32;
            canvas.fill(at.x, y, at.w, 1, PALE);
        }
        for (p, _) in &self.x_ticks {
            canvas.fill(at.x + (p * (at.w - 1) as f64).round() as i32, at.y, 1, at.h, PALE);
        }
        let x = |v: f64| f64::from(at.x) + (v - self.x[0]) / (self.x[1] - self.x[0]) * f64::from(at.w);
        // Far beyond the frame all heights look the same.
        let y = |v: f64| f64::from(at.y + at.h) - self.y.position(v).clamp(-2.0, 3.0) * f64::from(at.h);
        for curve in &self.curves {
            for (pair, band) in curve.points.windows(2).zip(curve.band.windows(2)) {
                let (from, to) = (x(pair[0][0]), x(pair[1][0]));
                for column in (from.floor() as i32).max(clip[0])..(to.floor() as i32).min(clip[2]) {
                    let t = ((f64::from(column) + 0.5 - from) / (to - from)).clamp(0.0, 1.0);
                    let edge = |k: usize| y(band[0][k] + t * (band[1][k] - band[0][k]));
                    for row in (edge(1).round() as i32).max(clip[1])..(edge(0).round() as i32).min(clip[3]) {
                        canvas.blend(column, row, curve.color, 0.18);
                    }
                }
            }
        }
        for curve in &self.curves {
            for pair in curve.points.windows(2) {
                let ends = [pair[0], pair[1]].map(|p| [x(p[0]), y(p[1])]);
                canvas.stroke(ends[0], ends[1], curve.width, curve.color, clip);
            }
        }
        canvas.frame(at.x, at.y, at.w, at.h, INK);
        canvas.text(at.x + at.w / 2, at.y - LINE, &self.title, Align::Center, INK);
        axes::ticks_below(canvas, at.x, at.y + at.h, at.w, &self.x_ticks);
        canvas.text(at.x + at.w / 2, at.y + at.h + LINE + 10, &self.x_title, Align::Center, INK);
        axes::ticks_left(canvas, at.x, at.y, at.h, &self.y.ticks());
    }
}

/// Lines of the grid.
const PALE: Rgb = [234, 234, 238];
const MARGIN: i32 = 28;
const LEFT: i32 = 96;
const BELOW: i32 = 2 * LINE + 14;

/// A row of panels.
pub struct Row {
    /// At the left, upwards.
    pub title: String,
    /// Panels, each with its width [dots].
    pub panels: Vec<(i32, LinePanel)>,
    /// Height of the panels [dots].
    pub height: i32,
}

/// A page: title, particulars, the legend's names in their colors, rows of panels.
pub fn page(title: &str, particulars: &[String], legend: &[(String, Rgb)], rows: &[Row]) -> image::RgbImage {
    let head = MARGIN + (2 + particulars.len() as i32) * LINE + 14;
    let row_width = |row: &Row| LINE + row.panels.iter().map(|(w, _)| LEFT + w).sum::<i32>();
    let row_height = |row: &Row| LINE + row.height + BELOW + 10;
    let names: i32 = legend.iter().map(|(name, _)| 62 + Canvas::text_width(name)).sum();
    let texts = particulars.iter().map(|p| Canvas::text_width(p)).max().unwrap_or(0).max(Canvas::text_width(title));
    let width = rows.iter().map(row_width).max().unwrap_or(0).max(names).max(texts);
    let height = head + rows.iter().map(row_height).sum::<i32>();
    let mut canvas = Canvas::new(2 * MARGIN + width, height + MARGIN);
    heading(&mut canvas, MARGIN, MARGIN, title);
    for (i, line) in particulars.iter().enumerate() {
        canvas.text(MARGIN, MARGIN + (i as i32 + 1) * LINE + 2, line, Align::Left, GRAY);
    }
    let (mut x, mut y) = (MARGIN, head - LINE);
    for (name, color) in legend {
        canvas.fill(x, y + 5, 26, 4, *color);
        canvas.text(x + 34, y, name, Align::Left, INK);
        x += 62 + Canvas::text_width(name);
    }
    y = head + LINE;
    for row in rows {
        canvas.text_up(MARGIN, y + row.height / 2, &row.title, Align::Center, INK);
        let mut x = MARGIN + LINE;
        for (w, panel) in &row.panels {
            x += LEFT;
            panel.draw(&mut canvas, Panel { x, y, w: *w, h: row.height });
            x += w;
        }
        y += row_height(row);
    }
    canvas.into_image()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(y: Scale) -> LinePanel {
        let curve = Curve {
            points: vec![[0.0, 1.0], [1.0, 1.0], [2.0, 100.0]],
            band: vec![[0.1, 10.0]; 3],
            color: [200, 0, 0],
            width: 3.0,
        };
        LinePanel {
            title: String::new(),
            x_title: String::new(),
            x: [0.0, 2.0],
            x_ticks: linear(0.0, 2.0, 4.0),
            y,
            curves: vec![curve],
        }
    }

    /// A level curve at the middle of four decades lies halfway up, its band a quarter either side.
    #[test]
    fn curves_and_bands_lie_where_they_belong() {
        let mut canvas = Canvas::new(300, 300);
        let at = Panel { x: 50, y: 50, w: 200, h: 200 };
        panel(Scale::Log(LogScale { top: 2.0, decades: 4.0 })).draw(&mut canvas, at);
        let image = canvas.into_image();
        assert_eq!(image.get_pixel(90, 150).0, [200, 0, 0]);
        let banded = |y: u32| image.get_pixel(90, y).0[1] < 230;
        assert!(banded(110) && banded(190) && !banded(90) && !banded(210));
    }

    #[test]
    fn marks_are_round() {
        let labels: Vec<String> = linear(-180.0, 180.0, 4.0).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["-100", "0", "100"]);
        let at: Vec<f64> = linear(0.0, 0.3, 3.0).into_iter().map(|t| t.0).collect();
        assert!((at[1] - 1.0 / 3.0).abs() < 1e-12 && at.len() == 4, "{at:?}");
    }
}
