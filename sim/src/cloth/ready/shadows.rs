//! The table of shadows of a cloth, by lines followed through it.

use super::{Effort, Told, parts};
use crate::error::SimError;
use plywave::cloth::LineHits;
use plywave::cloth::making::{
    AxisAt, BANDS, COLUMNS, ClothPlies, ClothShadows, LANES, MAX_SHARE, OFFSETS, ROWS, SHADOW_BYTES as SIZE, exit,
    is_own, z_of,
};
use plywave::math::hash::SplitMix64;
use plywave::math::vec3::{cross, dot};
use std::f32::consts::TAU;

/// Length of ply between two places, over its radius.
const STEP: f32 = 1.5;
/// Most places of a cloth: beyond, they lie farther apart.
const MAX_PLACES: f32 = 1000.0;
/// Lines of an entry of all places together, and least and most of one place: where places are few, chance
/// does not average out over them.
const LINES: usize = 2048;
const LINES_OF_ONE: [usize; 2] = [3, 16];
/// How much more light a line on the outer side of a bend counts at most.
const MAX_AREA: f32 = 2.5;
/// A line of less light is not followed.
const MIN_FREE: f32 = 1e-3;

/// Shadows of the plies of a cloth.
pub(super) fn shadows(plies: &ClothPlies, effort: Effort, told: Told<'_>) -> Result<ClothShadows, SimError> {
    let lines = &plies.lines;
    let length = |curve: usize| {
        let knots = lines.knots(curve);
        (0..knots).map(|k| lines.speed_um(curve, k as f32 + 0.5)).sum::<f32>()
    };
    let wanted: Vec<f32> = (0..lines.curves()).map(|c| length(c) / (STEP * lines.radius_um(c))).collect();
    let less = (MAX_PLACES / wanted.iter().sum::<f32>()).min(1.0);
    let counts: Vec<u32> = wanted.iter().map(|wanted| (less * wanted).ceil().max(2.0) as u32).collect();
    let mut places = Vec::new();
    for (curve, count) in counts.iter().enumerate() {
        let per_knot = *count as f32 / lines.knots(curve) as f32;
        places.extend((0..*count).map(|place| (curve, place as f32 / per_knot, 1.0 / per_knot)));
    }
    let count = (LINES / places.len().max(1)).clamp(LINES_OF_ONE[0], LINES_OF_ONE[1]);
    let count = if effort == Effort::Draft { 1 } else { count };
    let rows = parts("shadows", places.len(), told, |i| {
        let mut row = [0; SIZE];
        fill(&mut row, plies, places[i], i as u64, count);
        row
    })?;
    let knots = (0..lines.curves()).map(|curve| lines.knots(curve));
    Ok(ClothShadows::of(&counts, knots, rows.concat()).expect("a row for each place"))
}

/// One place of a curve: its middle and width in the curve's parameter.
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

/// One place: lines in every direction, from every offset.
///
/// The table's light leaves by lines that are even over the offset t from the axis, as from a straight ply.
/// Of a bent one, of curvature kappa towards n, lines in direction b have the area `(sin - t kappa (b . B) /
/// sin^2) ds dt`, B = axis cross n and sin that between b and the axis: more on the outer side of a bend,
/// less on the inner one, nothing where it folds. What b is sent is in proportion, as what comes from there
/// is, so each line counts by this area over that of a straight ply, `sin ds dt`, and by `largest_area` at
/// most.
///
/// `place` gives the axis at a fraction, 0 to 1, of the place's length, `free` the share of the light of a
/// line from a point of the wall in a direction that gets out.
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
                // A ply sends little light along itself, where much passes: directions are drawn by the sine.
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
