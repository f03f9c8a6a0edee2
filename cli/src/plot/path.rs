//! Paths of a figure: lines and curves, as the data of an SVG path or as an outline to paint.

use std::fmt::Write;
use tiny_skia::PathBuilder;
use ttf_parser::OutlineBuilder;

/// A step of a path; x to the right, y downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Move([f64; 2]),
    Line([f64; 2]),
    Quadratic([[f64; 2]; 2]),
    Cubic([[f64; 2]; 3]),
    Close,
}

/// Turn, then scaling about the origin, then shift.
#[derive(Clone, Copy, Debug)]
pub struct Transform {
    /// Where the origin goes.
    pub shift: [f64; 2],
    /// Growth.
    pub scale: f64,
    /// Whether x turns upwards.
    pub upwards: bool,
}

impl Transform {
    /// No change.
    pub const NONE: Transform = Transform { shift: [0.0; 2], scale: 1.0, upwards: false };

    fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [x, y] = if self.upwards { [y, -x] } else { [x, y] };
        [self.shift[0] + self.scale * x, self.shift[1] + self.scale * y]
    }
}

/// A path.
#[derive(Clone, Debug, Default)]
pub struct Path(Vec<Step>);

impl Path {
    /// Straight lines through points; points that are no numbers are left out.
    pub fn lines(points: impl IntoIterator<Item = [f64; 2]>) -> Path {
        let finite = points.into_iter().filter(|p| p.iter().all(|v| v.is_finite()));
        Path(finite.enumerate().map(|(i, p)| if i == 0 { Step::Move(p) } else { Step::Line(p) }).collect())
    }

    /// The path with its end joined to its start.
    pub fn closed(mut self) -> Path {
        self.0.push(Step::Close);
        self
    }

    /// A rectangle between two corners.
    pub fn rectangle([left, top]: [f64; 2], [right, bottom]: [f64; 2]) -> Path {
        Path::lines([[left, top], [right, top], [right, bottom], [left, bottom]]).closed()
    }

    /// A circle, of four cubic curves: off by less than 3e-4 of the radius.
    pub fn circle([x, y]: [f64; 2], radius: f64) -> Path {
        let k = 4.0 / 3.0 * (2.0_f64.sqrt() - 1.0);
        let at = |u: f64, v: f64| [x + radius * u, y + radius * v];
        let quarters = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].map(|(u, v): (f64, f64)| {
            // From (u, v) to (-v, u).
            Step::Cubic([at(u - k * v, v + k * u), at(-v + k * u, u + k * v), at(-v, u)])
        });
        if !(x.is_finite() && y.is_finite() && radius.is_finite()) {
            return Path::default();
        }
        Path([Step::Move(at(1.0, 0.0))].into_iter().chain(quarters).chain([Step::Close]).collect())
    }

    /// The path moved.
    pub fn transformed(&self, by: &Transform) -> Path {
        let steps = self.0.iter().map(|step| match step {
            Step::Move(p) => Step::Move(by.apply(*p)),
            Step::Line(p) => Step::Line(by.apply(*p)),
            Step::Quadratic(p) => Step::Quadratic(p.map(|p| by.apply(p))),
            Step::Cubic(p) => Step::Cubic(p.map(|p| by.apply(p))),
            Step::Close => Step::Close,
        });
        Path(steps.collect())
    }

    /// The data of an SVG path, in hundredths.
    pub fn data(&self) -> String {
        let mut data = String::new();
        let mut add = |command: char, points: &[[f64; 2]]| {
            data.push(command);
            for (i, [x, y]) in points.iter().enumerate() {
                // Writing to a string does not fail.
                let _ = write!(data, "{}{} {}", if i == 0 { "" } else { " " }, short(*x), short(*y));
            }
        };
        for step in &self.0 {
            match step {
                Step::Move(p) => add('M', &[*p]),
                Step::Line(p) => add('L', &[*p]),
                Step::Quadratic(p) => add('Q', p),
                Step::Cubic(p) => add('C', p),
                Step::Close => add('Z', &[]),
            }
        }
        data
    }

    /// The path to paint; none where it has no extent.
    pub fn outline(&self) -> Option<tiny_skia::Path> {
        let mut builder = PathBuilder::new();
        let f = |p: [f64; 2]| p.map(|v| v as f32);
        for step in &self.0 {
            match step {
                Step::Move(p) => builder.move_to(f(*p)[0], f(*p)[1]),
                Step::Line(p) => builder.line_to(f(*p)[0], f(*p)[1]),
                Step::Quadratic(p) => {
                    let [[x1, y1], [x, y]] = p.map(f);
                    builder.quad_to(x1, y1, x, y);
                }
                Step::Cubic(p) => {
                    let [[x1, y1], [x2, y2], [x, y]] = p.map(f);
                    builder.cubic_to(x1, y1, x2, y2, x, y);
                }
                Step::Close => builder.close(),
            }
        }
        builder.finish()
    }
}

/// A coordinate in hundredths.
fn short(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

/// Adds the outline of a letter to a path: grown by `scale` from the font's units, from `(x, y)` on.
#[derive(Debug, Default)]
pub struct Pen {
    /// What was drawn.
    pub path: Path,
    /// Size of a unit of the font.
    pub scale: f64,
    /// Start of the letter.
    pub x: f64,
    /// Its line.
    pub y: f64,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> [f64; 2] {
        [self.x + self.scale * f64::from(x), self.y - self.scale * f64::from(y)]
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.0.push(Step::Move(self.at(x, y)));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.0.push(Step::Line(self.at(x, y)));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.0.push(Step::Quadratic([self.at(x1, y1), self.at(x, y)]));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.path.0.push(Step::Cubic([self.at(x1, y1), self.at(x2, y2), self.at(x, y)]));
    }

    fn close(&mut self) {
        self.path.0.push(Step::Close);
    }
}
