//! Curves over one axis, linear or logarithmic, with bands of their spread; pages of such panels.

use super::axes::{self, BELOW, LEFT, LogScale, Ticks};
pub use super::axes::{every, linear};
use super::color::Rgb;
use super::figure::{Figure, INK, LINE, Panel};
use super::page::{Head, page as with_head};

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Its points, x ascending.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper edge of a band about it, one pair a point; empty for none.
    pub band: Vec<[f64; 2]>,
    /// Color.
    pub color: Rgb,
    /// Width [pixels].
    pub width: f64,
}

/// Vertical scale of a panel.
#[derive(Clone, Copy, Debug)]
pub enum Scale {
    /// Decades.
    Log(LogScale),
    /// Linear, from the first value to the second.
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

/// Curves in one frame.
#[derive(Clone, Debug)]
pub struct LinePanel {
    /// Title above the panel.
    pub title: String,
    /// Name of the x axis, below the panel.
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
    fn draw(&self, figure: &mut Figure, at: Panel) {
        let [left, top, w, h] = [at.x, at.y, at.w, at.h].map(f64::from);
        let x = |v: f64| left + (v - self.x[0]) / (self.x[1] - self.x[0]) * w;
        // Far beyond the frame all heights look the same.
        let y = |v: f64| top + (1.0 - self.y.position(v).clamp(-2.0, 3.0)) * h;
        figure.clipped(at, |figure| {
            for (p, _) in self.y.ticks() {
                figure.line([left, top + (1.0 - p) * h], [left + w, top + (1.0 - p) * h], PALE, 0.0);
            }
            for (p, _) in &self.x_ticks {
                figure.line([left + p * w, top], [left + p * w, top + h], PALE, 0.0);
            }
            for curve in self.curves.iter().filter(|c| !c.band.is_empty()) {
                let edge = |k: usize| curve.points.iter().zip(&curve.band).map(move |(p, b)| [p[0], b[k]]);
                let outline = edge(0).chain(edge(1).collect::<Vec<_>>().into_iter().rev());
                figure.area(outline.map(|[a, b]| [x(a), y(b)]), curve.color, 0.18);
            }
            for curve in &self.curves {
                figure.curve(curve.points.iter().map(|p| [x(p[0]), y(p[1])]), curve.width, curve.color);
            }
        });
        figure.frame(at, INK);
        axes::above(figure, at, &self.title);
        axes::below(figure, at, &self.x_ticks, &self.x_title);
        axes::left(figure, at, &self.y.ticks(), "");
    }
}

/// Lines of the grid.
const PALE: Rgb = [234, 234, 238];

/// A row of panels.
pub struct Row {
    /// Label at the left, running upwards.
    pub title: String,
    /// Panels, each with its width [pixels].
    pub panels: Vec<(i32, LinePanel)>,
    /// Height of the panels [pixels].
    pub height: i32,
}

/// A page of rows of panels.
pub fn page(head: &Head, rows: &[Row]) -> Figure {
    let row_width = |row: &Row| LINE + row.panels.iter().map(|(w, _)| LEFT + w).sum::<i32>();
    let row_height = |row: &Row| LINE + row.height + BELOW + 10;
    let width = rows.iter().map(row_width).max().unwrap_or(0) + LEFT / 4;
    with_head(head, [width, rows.iter().map(row_height).sum()], |figure, x, mut y| {
        for row in rows {
            figure.text_up(x, y + LINE + row.height / 2, row.height, &row.title);
            let mut at = x + LINE;
            for (w, panel) in &row.panels {
                panel.draw(figure, Panel { x: at + LEFT, y: y + LINE, w: *w, h: row.height });
                at += LEFT + w;
            }
            y += row_height(row);
        }
    })
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
        let mut figure = Figure::new(300, 300);
        let at = Panel { x: 50, y: 50, w: 200, h: 200 };
        panel(Scale::Log(LogScale { top: 2.0, decades: 4.0 })).draw(&mut figure, at);
        let image = figure.raster();
        assert_eq!(image.get_pixel(90, 150).0, [200, 0, 0]);
        let banded = |y: u32| image.get_pixel(90, y).0[1] < 230;
        assert!(banded(110) && banded(190) && !banded(90) && !banded(210));
    }

    /// Titles longer than their panels are shortened: between two panels, titles and names of axes leave
    /// paper.
    #[test]
    fn titles_keep_to_their_panels() {
        let long = LinePanel {
            title: "a title of many words ".repeat(9),
            x_title: "an axis' name ".repeat(9),
            ..panel(Scale::Linear(0.0, 1.0))
        };
        let row = Row { title: "up ".repeat(90), panels: vec![(200, long.clone()), (200, long)], height: 100 };
        let head = Head { title: "two panels".into(), ..Head::default() };
        let image = page(&head, &[row]).raster();
        let ink = |x: u32, y: u32| image.get_pixel(x, y).0 != [255, 255, 255];
        let dark = |x: u32, y: u32| image.get_pixel(x, y).0[0] < 100;
        let frames: Vec<u32> = (0..image.width()).filter(|x| (110..180).all(|y| dark(*x, y))).collect();
        assert_eq!(frames.len(), 4, "{frames:?}");
        let below = |x: u32| (40..image.height()).any(|y| ink(x, y));
        // The name of an axis may reach 20 units beyond its panel; marks of the y axis stand from 50 on.
        assert!((frames[1] + 22..frames[2] - 50).all(|x| !below(x)));
        assert!((frames[3] + 22..image.width()).all(|x| !below(x)));
    }
}
