//! Table of shadows of a cloth: the share of light from each place of a ply, in each direction and from each
//! offset, that escapes the other plies. It is a mean over sampled lines through the cloth.

use super::{Effort, Progress, parts};
use crate::error::SimError;
use plywave::cloth::geometry::{AxisAt, ClothPlies};
use plywave::cloth::shade::{
    BANDS, COLUMNS, ClothShadows, LANES, MAX_SHARE, OFFSETS, ROWS, SHADOW_BYTES as SIZE, exit, is_own, z_of,
};
use plywave::cloth::{ClothCurves, LineHits};
use plywave::math::hash::SplitMix64;
use plywave::math::vec3::{cross, dot};
use std::collections::HashMap;
use std::f32::consts::TAU;

/// Distance of two places along a ply, over its radius.
const STEP: f32 = 1.5;
/// Maximum number of places of a cloth; longer plies have places farther apart.
const MAX_PLACES: f32 = 1000.0;
/// Number of lines of an entry over all places together, and its minimum and maximum at one place. A cloth of
/// few places needs more lines at each, since noise does not average out over places.
const LINES: usize = 2048;
const LINES_OF_ONE: [usize; 2] = [3, 16];
/// Maximum weight of a line on the outer side of a bend, over that at a straight ply.
const MAX_AREA: f32 = 2.5;
/// Transmittance below which a line counts as occluded.
const MIN_FREE: f32 = 1e-3;

/// The places of all curves: number of places of each curve, curve, parameter and width of each place, and
/// the first place with the same surroundings.
struct Places {
    counts: Vec<u32>,
    all: Vec<(usize, f32, f32)>,
    like: Vec<usize>,
}

impl Places {
    fn new(plies: &ClothPlies, curves: &ClothCurves) -> Places {
        let lines = &plies.lines;
        let length = |curve: usize| {
            let knots = lines.knots(curve);
            (0..knots).map(|k| lines.speed_um(curve, k as f32 + 0.5)).sum::<f32>()
        };
        let wanted: Vec<f32> = (0..lines.curves()).map(|c| length(c) / (STEP * lines.radius_um(c))).collect();
        let is_shared = curves.curves.iter().all(|curve| !curve.alike.is_empty());
        let less = if is_shared { 1.0 } else { (MAX_PLACES / wanted.iter().sum::<f32>()).min(1.0) };
        let mut places = Places { counts: Vec::new(), all: Vec::new(), like: Vec::new() };
        let mut first_of: HashMap<(u32, u32), usize> = HashMap::new();
        for (curve, wanted) in wanted.iter().enumerate() {
            let alike = &curves.curves[curve].alike;
            // A whole number of places in each part of a curve.
            let parts = alike.len().max(1) as f32;
            let of_part =
                if is_shared { (less * wanted / parts).ceil().max(1.0) } else { (less * wanted).ceil().max(2.0) };
            let count = (of_part * parts) as u32;
            let per_knot = count as f32 / lines.knots(curve) as f32;
            for place in 0..count {
                let number = places.all.len();
                let like = match alike.get((place / of_part as u32) as usize).filter(|_| is_shared) {
                    Some(part) => *first_of.entry((*part, place % of_part as u32)).or_insert(number),
                    None => number,
                };
                places.like.push(like);
                places.all.push((curve, place as f32 / per_knot, 1.0 / per_knot));
            }
            places.counts.push(count);
        }
        places
    }
}

/// Computes the shadows of the plies of a cloth.
pub(super) fn shadows(
    plies: &ClothPlies,
    curves: &ClothCurves,
    effort: Effort,
    progress: Progress<'_>,
) -> Result<ClothShadows, SimError> {
    let Places { counts, all, like } = Places::new(plies, curves);
    let own: Vec<usize> = (0..all.len()).filter(|place| like[*place] == *place).collect();
    let count = (LINES / own.len().max(1)).clamp(LINES_OF_ONE[0], LINES_OF_ONE[1]);
    let count = if effort == Effort::Draft { 1 } else { count };
    let rows = parts("shadows", own.len(), progress, |i| {
        let mut row = [0; SIZE];
        fill(&mut row, plies, all[own[i]], i as u64, count);
        row
    })?;
    let tables = if own.len() == all.len() {
        Vec::new()
    } else {
        let mut table = vec![0; all.len()];
        own.iter().enumerate().for_each(|(number, place)| table[*place] = number as u32);
        like.iter().map(|place| table[*place]).collect()
    };
    let knots = (0..plies.lines.curves()).map(|curve| plies.lines.knots(curve));
    Ok(ClothShadows::of(&counts, knots, tables, rows.concat()).expect("a table for each place"))
}

/// Fills the row of one place, given by its curve and its middle and width in the curve's parameter.
fn fill(row: &mut [u8], plies: &ClothPlies, (curve, middle, width): (usize, f32, f32), seed: u64, count: usize) {
    let lines = &plies.lines;
    let knots = lines.knots(curve) as f32;
    let mut rng = SplitMix64(0x7368_6164 ^ seed << 20);
    let mut hits = LineHits::default();
    let at = |u: f32| {
        let parameter = middle + width * (u - 0.5);
        let parameter = if parameter < 0.0 { parameter + knots } else { parameter };
        lines.axis_at(curve, parameter)
    };
    fill_row(row, (count, MAX_AREA), &mut || rng.next_f64() as f32, at, |parameter, from, b| {
        lines.hits_while(from, b, &mut hits, |hit| plies.passes(hit));
        let mut passes = 1.0;
        for hit in hits.as_slice().iter().filter(|hit| !is_own(lines, hit, (curve as u32, [0; 2], *parameter))) {
            passes *= plies.r_d(hit);
            if passes < MIN_FREE {
                return 0.0;
            }
        }
        passes
    });
}

/// Fills the row of one place with means over lines in every direction, from every offset.
///
/// The light of the table leaves along lines that are uniform over the offset t from the axis, as for a
/// straight ply. For a ply with curvature kappa towards n, the lines in direction b cover the area
/// `(sin - t kappa (b . B) / sin^2) ds dt`, with B = axis cross n and sin the sine of the angle between b and
/// the axis. The area is larger on the outer side of a bend, smaller on the inner one and 0 where the lines
/// fold over. Radiated and received light are both proportional to it. Each line is therefore weighted by
/// this area over that of a straight ply, `sin ds dt`, clamped to `largest_area`.
///
/// `place` gives the axis at a fraction, 0 to 1, of the place's length. `free` gives the transmittance along
/// a line from a point of the wall in a direction.
fn fill_row<T>(
    row: &mut [u8],
    (lines, largest_area): (usize, f32),
    number: &mut impl FnMut() -> f32,
    place: impl Fn(f32) -> AxisAt<T>,
    mut free: impl FnMut(&T, [f32; 3], [f32; 3]) -> f32,
) {
    for (i, entry) in row.chunks_exact_mut(LANES).enumerate() {
        let (r, c) = (i / COLUMNS, i % COLUMNS);
        let sign = if r < ROWS { 1.0 } else { -1.0 };
        for (o, entry) in entry[..OFFSETS].iter_mut().enumerate() {
            let mut sum = 0.0;
            for _ in 0..lines {
                let AxisAt { center_um, axis, bend_per_um, radius_um, of } = place(number());
                // Directions are drawn by their sine to the axis, since a ply radiates little light along
                // itself, where lines pass freely.
                let (b, x, sine) = loop {
                    let band = r % ROWS;
                    let z = sign * if band < BANDS { z_of(band as f32 + number()) } else { 1.0 };
                    let (sin, cos) = (TAU * (c as f32 + number()) / COLUMNS as f32).sin_cos();
                    let across = (1.0 - z * z).max(0.0).sqrt();
                    let b = [across * cos, across * sin, z];
                    let x = cross(b, axis);
                    let sine = dot(x, x).sqrt();
                    if number() < sine {
                        break (b, x, sine.max(1e-3));
                    }
                };
                let t = ((o as f32 + number()) / OFFSETS as f32 * 2.0 - 1.0) * radius_um;
                let area = 1.0 - t * dot(b, cross(axis, bend_per_um)) / (sine * sine * sine);
                if area <= 0.0 {
                    continue;
                }
                let inner = std::array::from_fn(|i| center_um[i] + t / sine * x[i]);
                sum += area.min(largest_area) * free(&of, exit(center_um, axis, radius_um, inner, b), b);
            }
            *entry = (255.0 / MAX_SHARE * (sum / lines as f32).min(MAX_SHARE) + 0.5) as u8;
        }
    }
}
