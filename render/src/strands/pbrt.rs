//! pbrt's `Shape "curve"` text: Bezier and B-spline curves of degree 2 and 3, as segments of cubic B-splines, exactly.

use super::how::{StrandFile, cut};
use super::{Basis, MOST_POINTS, Strands};
use crate::RenderError;

/// Whether a text is of pbrt.
pub fn is(text: &str) -> bool {
    text.lines().take(10_000).any(|line| line.trim_start().starts_with("Shape"))
}

/// A word of the text: a text in quotes, a bracket, or anything else.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Word<'a> {
    Quoted(&'a str),
    Open,
    Close,
    Bare(&'a str),
}

struct Words<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Words<'a> {
    /// Line of the next word, from 1.
    fn line(&self) -> usize {
        1 + self.text.as_bytes()[..self.at.min(self.text.len())].iter().filter(|b| **b == b'\n').count()
    }

    fn peek(&self) -> Option<Word<'a>> {
        Words { text: self.text, at: self.at }.next()
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = Word<'a>;

    fn next(&mut self) -> Option<Word<'a>> {
        let bytes = self.text.as_bytes();
        loop {
            match bytes.get(self.at)? {
                b if b.is_ascii_whitespace() => self.at += 1,
                b'#' => self.at += bytes[self.at..].iter().position(|b| *b == b'\n').unwrap_or(bytes.len() - self.at),
                _ => break,
            }
        }
        let from = self.at;
        Some(match bytes[from] {
            b'[' => {
                self.at += 1;
                Word::Open
            }
            b']' => {
                self.at += 1;
                Word::Close
            }
            b'"' => {
                let end = bytes[from + 1..].iter().position(|b| *b == b'"').map_or(bytes.len(), |n| from + 1 + n);
                self.at = (end + 1).min(bytes.len());
                Word::Quoted(&self.text[from + 1..end])
            }
            _ => {
                let end = bytes[from..].iter().position(|b| b.is_ascii_whitespace() || b"[]\"#".contains(b));
                self.at = end.map_or(bytes.len(), |n| from + n);
                Word::Bare(&self.text[from..self.at])
            }
        })
    }
}

/// What a curve is given by.
struct Curve {
    degree: usize,
    bezier: bool,
    points: Vec<[f32; 3]>,
    width: [f32; 2],
}

/// All curves of a text; what is no curve is passed over.
pub fn read(text: &str, file: &str, how: &StrandFile) -> Result<Strands, RenderError> {
    let mut strands = Strands::new(Basis::BSpline);
    let mut words = Words { text, at: 0 };
    while let Some(word) = words.next() {
        if word != Word::Bare("Shape") {
            continue;
        }
        let line = words.line();
        if words.next() != Some(Word::Quoted("curve")) {
            continue;
        }
        let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("line {line}: {what}") };
        let curve = parameters(&mut words).map_err(bad)?;
        add(&mut strands, &curve, file, &format!("curve at line {line}"), how)?;
    }
    Ok(strands)
}

/// `"type name" value` or `"type name" [ values ]`, as many as follow.
fn parameters(words: &mut Words<'_>) -> Result<Curve, String> {
    let mut curve = Curve { degree: 3, bezier: true, points: Vec::new(), width: [1.0; 2] };
    while let Some(Word::Quoted(declared)) = words.peek() {
        words.next();
        let name = declared.split_ascii_whitespace().nth(1).unwrap_or("");
        let mut values = Vec::new();
        match words.next() {
            Some(Word::Open) => loop {
                match words.next() {
                    Some(Word::Close) => break,
                    Some(Word::Open) | None => return Err(format!("{declared:?} has no closing bracket")),
                    Some(word) => values.push(word),
                }
            },
            Some(word @ (Word::Bare(_) | Word::Quoted(_))) => values.push(word),
            _ => return Err(format!("{:?} has no value", cut(declared))),
        }
        let numbers = || -> Result<Vec<f32>, String> {
            let number = |word: &Word<'_>| match word {
                Word::Bare(text) => text.parse().map_err(|_| format!("{:?} of {name:?} is no number", cut(text))),
                _ => Err(format!("{name:?} takes numbers")),
            };
            values.iter().map(number).collect()
        };
        let one = || numbers()?.first().copied().ok_or_else(|| format!("{name:?} has no value"));
        match name {
            "P" => {
                let numbers = numbers()?;
                if !numbers.len().is_multiple_of(3) {
                    return Err(format!("\"P\" has {} numbers; use three a point", numbers.len()));
                }
                if numbers.len() > 3 * MOST_POINTS {
                    return Err(format!("{} points; at most {MOST_POINTS}, split the curve", numbers.len() / 3));
                }
                curve.points = numbers.as_chunks().0.to_vec();
            }
            "width" => curve.width = [one()?; 2],
            "width0" => curve.width[0] = one()?,
            "width1" => curve.width[1] = one()?,
            "degree" => {
                curve.degree = match one()? {
                    2.0 => 2,
                    3.0 => 3,
                    other => return Err(format!("degree {other}; use 2 or 3")),
                }
            }
            "basis" => {
                curve.bezier = match values.first() {
                    Some(Word::Quoted("bezier")) => true,
                    Some(Word::Quoted("bspline")) => false,
                    _ => return Err("unknown basis; use \"bezier\" or \"bspline\"".into()),
                }
            }
            // How it is cut up, which way it faces, and what of it is shown are the host's.
            _ => {}
        }
    }
    Ok(curve)
}

/// Adds a curve: each of its segments as the four points of a cubic B-spline's, all of one strand; a cubic B-spline as it is.
fn add(strands: &mut Strands, curve: &Curve, file: &str, place: &str, how: &StrandFile) -> Result<(), RenderError> {
    let n = curve.points.len();
    let bad = |what: String| RenderError::Strands { file: file.to_string(), what: format!("{place}: {what}") };
    let d = curve.degree;
    let segments = if curve.bezier {
        if n < d + 1 || !(n - 1).is_multiple_of(d) {
            return Err(bad(format!("{n} points; Bezier curves of degree {d} have 1 + {d} a segment")));
        }
        (n - 1) / d
    } else {
        if n < d + 1 {
            return Err(bad(format!("{n} points; a B-spline of degree {d} has {} or more", d + 1)));
        }
        n - d
    };
    let radius = |u: f32| 0.5 * (curve.width[0] + (curve.width[1] - curve.width[0]) * u);
    if !curve.bezier && d == 3 {
        // A linear function of u has the values of its knots' means as control values: -1, 0, .. over the segments.
        let r = |k: usize| radius((k as f32 - 1.0) / segments as f32).max(1e-3 * radius(0.0).max(radius(1.0)));
        let points: Vec<[f32; 4]> = curve.points.iter().enumerate().map(|(k, p)| how.point(*p, r(k))).collect();
        return strands.push(&points, file, place);
    }
    for s in 0..segments {
        let p = |k: usize| curve.points[if curve.bezier { d * s + k } else { s + k }].map(f64::from);
        let mix = |weights: &[(usize, f64)]| -> [f64; 3] {
            std::array::from_fn(|c| weights.iter().map(|(k, w)| w * p(*k)[c]).sum())
        };
        // Bezier points of the segment, of degree 3.
        let b: [[f64; 3]; 4] = if d == 3 {
            [p(0), p(1), p(2), p(3)]
        } else {
            let q: [&[(usize, f64)]; 3] = if curve.bezier {
                [&[(0, 1.0)], &[(1, 1.0)], &[(2, 1.0)]]
            } else {
                [&[(0, 0.5), (1, 0.5)], &[(1, 1.0)], &[(1, 0.5), (2, 0.5)]]
            };
            let [q0, q1, q2] = q.map(mix);
            let raise = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| a[c] / 3.0 + 2.0 * b[c] / 3.0);
            [q0, raise(q0, q1), raise(q2, q1), q2]
        };
        // Of a cubic B-spline with the same segment.
        let rows = [[6.0, -7.0, 2.0, 0.0], [0.0, 2.0, -1.0, 0.0], [0.0, -1.0, 2.0, 0.0], [0.0, 2.0, -7.0, 6.0]];
        let points: [[f32; 4]; 4] = std::array::from_fn(|i| {
            let v: [f64; 3] = std::array::from_fn(|c| (0..4).map(|k| rows[i][k] * b[k][c]).sum());
            let u = (s as f32 + i as f32 - 1.0) / segments as f32;
            how.point(v.map(|v| v as f32), radius(u).max(1e-3 * radius(0.0).max(radius(1.0))))
        });
        if s == 0 {
            strands.push(&points, file, place)?;
        } else {
            strands.push_to_last(&points, file, place)?;
        }
    }
    Ok(())
}
