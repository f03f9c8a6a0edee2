//! pbrt's curves: Bezier and B-spline curves of degree 2 and 3, converted exactly to segments of cubic
//! B-splines, and their transforms.
//!
//! A non-uniform scale turns a circular cross section into an ellipse; a circle of the same area replaces
//! it. Along a unit tangent t the matrix M scales the area by |det M| / |M t|, and the radius by the root of
//! that. A uniform scale s scales the radius by s.

use super::import_options::{StrandFile, min_radius_mm};
use super::words::{Word, Words, number, shown};
use super::{MAX_MM, MAX_POINTS, StrandNotes, Strands};
use glam::{DMat4, DVec3};

/// Relative difference up to which scales count as equal.
const SAME: f64 = 1e-4;

/// Attributes of a curve other than its points; `None` stands for pbrt's default.
#[derive(Clone, Copy, Debug, Default)]
pub struct CurveAttributes {
    degree: Option<usize>,
    is_bspline: bool,
    is_ribbon: bool,
    width: Option<f64>,
    ends: [Option<f64>; 2],
}

impl CurveAttributes {
    /// Reads all following parameters `"type name" value` or `"type name" [ values ]`; points are appended to
    /// `points`.
    pub fn read<'a>(
        &mut self,
        words: &mut Words<'a>,
        values: &mut Vec<Word<'a>>,
        points: &mut Vec<DVec3>,
    ) -> Result<(), String> {
        while let Some(Word::Quoted(declared)) = words.peek()? {
            words.next()?;
            words.values(declared, values)?;
            let name = declared.split(|b| b.is_ascii_whitespace()).filter(|w| !w.is_empty()).nth(1).unwrap_or(b"");
            let of = |word: &Word<'_>| {
                number(word).ok_or_else(|| format!("{} of {} is no number", word.shown(), shown(name)))
            };
            let first = || values.first().ok_or_else(|| format!("{} has no value", shown(name)));
            let width = || {
                let width = of(first()?)?;
                if width < 0.0 { Err(format!("{} = {width}; use 0 or more", shown(name))) } else { Ok(Some(width)) }
            };
            let text = || match first()? {
                Word::Quoted(text) => Ok(*text),
                word => Err(format!("{} where {} takes a text in quotes", word.shown(), shown(name))),
            };
            match name {
                b"P" => {
                    let (triples, rest) = values.as_chunks::<3>();
                    if !rest.is_empty() {
                        return Err(format!("\"P\" has {} numbers; use three a point", values.len()));
                    }
                    if triples.len() > MAX_POINTS {
                        return Err(format!("{} points; at most {MAX_POINTS}, split the curve", triples.len()));
                    }
                    points.clear();
                    for [x, y, z] in triples {
                        points.push(DVec3::new(of(x)?, of(y)?, of(z)?));
                    }
                }
                b"width" => self.width = width()?,
                b"width0" => self.ends[0] = width()?,
                b"width1" => self.ends[1] = width()?,
                b"degree" => {
                    self.degree = match of(first()?)? {
                        2.0 => Some(2),
                        3.0 => Some(3),
                        other => return Err(format!("degree {other}; use 2 or 3")),
                    }
                }
                b"basis" => {
                    self.is_bspline = match text()? {
                        b"bezier" => false,
                        b"bspline" => true,
                        _ => return Err("unknown basis; use \"bezier\" or \"bspline\"".into()),
                    }
                }
                b"type" => {
                    self.is_ribbon = match text()? {
                        b"ribbon" => true,
                        b"flat" | b"cylinder" => false,
                        _ => return Err("unknown type; use \"flat\", \"cylinder\" or \"ribbon\"".into()),
                    }
                }
                // Splitting, orientation and visible range have no effect on the geometry read here.
                _ => {}
            }
        }
        Ok(())
    }

    /// Builds the curve in the coordinates of its file.
    pub fn curve(&self, points: &[DVec3]) -> Result<Curve, String> {
        let (n, d) = (points.len(), self.degree.unwrap_or(3));
        let segments = if self.is_bspline {
            if n < d + 1 {
                return Err(format!("{n} points; a B-spline of degree {d} has {} or more", d + 1));
            }
            n - d
        } else {
            if n < d + 1 || !(n - 1).is_multiple_of(d) {
                return Err(format!("{n} points; Bezier curves of degree {d} have 1 + {d} a segment"));
            }
            (n - 1) / d
        };
        let [from, to] = self.ends.map(|end| 0.5 * end.or(self.width).unwrap_or(1.0));
        let radius = |knot: usize| from + (to - from) * knot as f64 / segments as f64;
        let pieces = if self.is_bspline && d == 3 {
            vec![CubicPiece { points: points.to_vec(), radii: (0..=segments).map(radius).collect() }]
        } else {
            let piece = |s: usize| {
                let first = if self.is_bspline { s } else { d * s };
                let points = cubic_b_spline(&bezier(&points[first..=first + d], self.is_bspline));
                CubicPiece { points: points.to_vec(), radii: vec![radius(s), radius(s + 1)] }
            };
            (0..segments).map(piece).collect()
        };
        Ok(Curve { pieces, is_ribbon: self.is_ribbon, is_stretched: false })
    }
}

/// Cubic Bezier points of one segment.
fn bezier(p: &[DVec3], is_bspline: bool) -> [DVec3; 4] {
    let &[a, b, c] = p else { return [p[0], p[1], p[2], p[3]] };
    let [a, c] = if is_bspline { [0.5 * (a + b), 0.5 * (b + c)] } else { [a, c] };
    [a, (a + 2.0 * b) / 3.0, (c + 2.0 * b) / 3.0, c]
}

/// Control points of a uniform cubic B-spline that has the same segment.
fn cubic_b_spline(b: &[DVec3; 4]) -> [DVec3; 4] {
    const ROWS: [[f64; 4]; 4] =
        [[6.0, -7.0, 2.0, 0.0], [0.0, 2.0, -1.0, 0.0], [0.0, -1.0, 2.0, 0.0], [0.0, 2.0, -7.0, 6.0]];
    ROWS.map(|row| (0..4).map(|k| row[k] * b[k]).sum())
}

/// A run of segments of a uniform cubic B-spline.
#[derive(Clone, Debug)]
struct CubicPiece {
    points: Vec<DVec3>,
    /// Radii at the ends of the segments, two fewer than points.
    radii: Vec<f64>,
}

/// A curve in the units of its file.
#[derive(Clone, Debug)]
pub struct Curve {
    pieces: Vec<CubicPiece>,
    is_ribbon: bool,
    is_stretched: bool,
}

impl Curve {
    /// Number of control points.
    pub fn points(&self) -> usize {
        self.pieces.iter().map(|piece| piece.points.len()).sum()
    }

    /// The curve transformed by a matrix.
    pub fn moved(mut self, to: &DMat4) -> Curve {
        if *to == DMat4::IDENTITY {
            return self;
        }
        let volume = to.determinant().abs();
        self.is_stretched |= is_stretch(to);
        for piece in &mut self.pieces {
            for (k, radius) in piece.radii.iter_mut().enumerate() {
                // Tangent of the curve where two segments join.
                let along = (piece.points[k + 2] - piece.points[k]).normalize_or_zero();
                let longer = to.transform_vector3(along).length();
                *radius *= if longer > 0.0 { (volume / longer).sqrt() } else { volume.cbrt() };
            }
            piece.points.iter_mut().for_each(|p| *p = to.transform_point3(*p));
        }
        self
    }

    /// Adds the curve as a strand, in mm. Radii below the minimum are raised to it, and a curve without width
    /// is omitted, as in [`StrandFile::push`].
    pub fn add(&self, strands: &mut Strands, options: &StrandFile, notes: &mut StrandNotes) -> Result<(), String> {
        let mm = f64::from(options.mm_per_unit);
        let radius_mm = |radius: f64| options.radius_mm.map_or(mm * radius, f64::from);
        let radii = || self.pieces.iter().flat_map(|piece| &piece.radii).map(|r| radius_mm(*r));
        let coordinates = self.pieces.iter().flat_map(|piece| &piece.points).map(|p| mm * p.abs().max_element());
        // Control points of a B-spline lie up to 15 times as far out as those of the same Bezier curve.
        let too_much = |max: f64| move |v: &f64| v.is_nan() || *v > max * f64::from(MAX_MM);
        let far = coordinates.into_iter().find(too_much(15.0)).map(|v| ("coordinate", v));
        if let Some((name, v)) = far.or_else(|| radii().find(too_much(1.0)).map(|v| ("radius", v))) {
            return Err(format!("a {name} of {v} mm; use up to {MAX_MM}"));
        }
        let Some(min) = min_radius_mm(radii()) else {
            notes.without_width += 1;
            return Ok(());
        };
        notes.ribbons += u64::from(self.is_ribbon);
        notes.stretched += u64::from(self.is_stretched);
        notes.thin_points += radii().filter(|r| *r < min).count() as u64;
        let mut points = Vec::new();
        for (k, piece) in self.pieces.iter().enumerate() {
            // Control values of the radius are those at the knots, with the outermost ones mirrored: the
            // radius is then exact at both ends, and everywhere if it is linear.
            let at = |knot: usize| radius_mm(piece.radii[knot]).max(min);
            let last = piece.radii.len() - 1;
            let control = |i: usize| match i {
                0 => 2.0 * at(0) - at(1),
                i if i - 1 > last => 2.0 * at(last) - at(last - 1),
                i => at(i - 1),
            };
            points.clear();
            points.extend(piece.points.iter().enumerate().map(|(i, p)| {
                let [x, y, z] = (mm * *p).to_array();
                [x, y, z, control(i)].map(|v| v as f32)
            }));
            strands.add_run(&points, k == 0)?;
        }
        Ok(())
    }
}

/// Whether a matrix scales non-uniformly: its columns differ in length or are not perpendicular.
fn is_stretch(m: &DMat4) -> bool {
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.truncate());
    let max = axes.map(|axis| axis.length_squared()).into_iter().fold(0.0, f64::max);
    (0..3).any(|k| {
        let (a, b) = (axes[k], axes[(k + 1) % 3]);
        (a.length_squared() - b.length_squared()).abs() > 2.0 * SAME * max || a.dot(b).abs() > 2.0 * SAME * max
    })
}
