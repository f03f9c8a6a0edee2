//! Shadows of yarns on their neighbors: the chance that light which leaves a ply in a direction meets no
//! other yarn, more of it on the outer side of a bend, less on the inner one.
//!
//! It is tabulated over the place along the yarn where the light's line is nearest to the yarn's axis, its
//! offset from the axis, and the direction, by lines followed through the fabric (`flight.rs`). A draft of
//! few crossings has rows of its own for every place; in a larger one places share the rows of the pattern of
//! the nine crossings around.

use super::flight::{Skip, YarnId, exit};
use super::yarn::Yarn;
use super::{Fabric, YarnSet};
use crate::math::floor_fraction;
use crate::math::hash::SplitMix64;
use crate::math::parallel;
use crate::math::simd::{max, min};
use crate::math::vec3::{cross, dot};
use crate::ply::{EXIT_KINDS, ExitDensity};
use multiversion::multiversion;
use std::f32::consts::TAU;

/// Places along a yarn from one crossing to the next: of one ply, and of several, which turn on their way. Of
/// one ply more would bring more entries beyond the greatest.
const PLACES: [usize; 2] = [4, 8];
const MAX_PLACES: usize = PLACES[1];
/// Bands of directions in each half of the sphere, rows of the table: the bands' and the pole's, and columns
/// about the normal.
pub(crate) const BANDS: usize = 8;
pub(crate) const ROWS: usize = BANDS + 1;
pub(crate) const COLUMNS: usize = 16;
/// Offsets across a yarn.
pub(crate) const OFFSETS: usize = 7;
/// Numbers of a direction: the offsets, and zeros up to a word.
pub(crate) const LANES: usize = 8;
/// Greatest entry: 255 stands for it.
pub(crate) const MAX_SHARE: f32 = 1.35;
/// The entry of light that all gets out.
pub(crate) const ALL_FREE: u8 = (255.0 / MAX_SHARE + 0.5) as u8;
/// Lines of an entry of all places together, and least and most of one place: where places are few, chance
/// does not average out over them.
const LINES: usize = 1024;
const LINES_OF_ONE: [usize; 2] = [2, 16];
/// Bytes of a place.
const SIZE: usize = 2 * ROWS * COLUMNS * LANES;
/// Rows that are filled together.
const ROWS_A_PART: usize = 8;
/// Most crossings of a draft whose places have rows of their own.
const MAX_CROSSINGS: usize = 512;
/// Crossings of a larger draft that are looked at for patterns.
const LOOKED_AT: usize = 1 << 18;

/// The table of a fabric.
#[derive(Clone, Debug)]
pub(crate) struct Shadows {
    /// `[place][row][column][LANES]`, 255 for [`MAX_SHARE`].
    pub(crate) free: Vec<u8>,
    /// For patterns: of `[family][place][pattern]` the index of its row; empty where every place has its own.
    pub(crate) patterns: Vec<u32>,
}

/// What a ply model says of the light that passes beside its fibers.
pub(crate) trait Passing {
    /// Fraction of a beam that passes a ply.
    fn r_d(&self, family: YarnSet, yarn: i32, theta_i: f32, h_um: f32) -> f32;
}

/// Places of a yarn from one crossing to the next.
fn places(yarn: &Yarn) -> usize {
    PLACES[usize::from(yarn.plies > 1)]
}

/// Bands of directions: z of band r + 1/2 of a half is that to this power of the band's place in the half.
/// Shadows change most towards the plane.
pub(crate) fn z_of(band: f32) -> f32 {
    let t = band / BANDS as f32;
    t * t.sqrt()
}

/// Mean of z over a band: `integral ((r + u) / BANDS)^1.5 du`, u from 0 to 1.
const MEAN_Z: [f32; BANDS] = [0.017678, 0.082322, 0.175568, 0.290118, 0.422526, 0.570634, 0.732919, 0.908235];

/// Of the last band's mean.
const PER_SQUARED_SINE: f32 = 1.0 / (1.0 - MEAN_Z[BANDS - 1] * MEAN_Z[BANDS - 1]);

/// Hit of a z among the bands of a half, 0 to BANDS.
#[inline]
fn band_of(z: f32) -> f32 {
    (two_thirds(z) * BANDS as f32).min(BANDS as f32)
}

/// z^(2/3), z from 0 to 1, to 0.01: two steps of Newton's for the cube root of the root, from a line that is
/// near it.
#[inline]
pub(crate) fn two_thirds(z: f32) -> f32 {
    let root = z.sqrt();
    let mut c = 0.4 + 0.6 * root;
    for _ in 0..2 {
        c -= (c * c * c - root) / (3.0 * c * c);
    }
    c * c * c * c
}

impl Shadows {
    /// Of a fabric, by lines followed through it.
    pub(crate) fn new(fabric: &Fabric, passing: &(impl Passing + Sync)) -> Shadows {
        let (ends, picks) = (fabric.draft.ends(), fabric.draft.picks());
        let mut shadows = Shadows { free: Vec::new(), patterns: Vec::new() };
        // Yarn set, yarn and place of each row.
        let mut rows: Vec<(YarnSet, i32, i32)> = Vec::new();
        if ends * picks <= MAX_CROSSINGS {
            for family in YarnSet::EACH {
                let places = places(&fabric.yarns[family as usize]);
                for yarn in 0..fabric.draft.threads(family) as i32 {
                    for place in 0..(places * fabric.draft.threads(family.other())) as i32 {
                        rows.push((family, yarn, place));
                    }
                }
            }
        } else {
            shadows.patterns = vec![u32::MAX; 2 * MAX_PLACES * 512];
            let step = (ends * picks).div_ceil(LOOKED_AT).max(1);
            for crossing in (0..ends * picks).step_by(step) {
                let (end, pick) = ((crossing % ends) as i32, (crossing / ends) as i32);
                for (family, yarn, along) in [(YarnSet::Warp, end, pick), (YarnSet::Weft, pick, end)] {
                    let pattern = pattern(fabric, family, yarn, along);
                    let (first, places) = (first_of(family) + pattern, places(&fabric.yarns[family as usize]));
                    if shadows.patterns[first] == u32::MAX {
                        for place in 0..places {
                            shadows.patterns[first + place * 512] = rows.len() as u32;
                            rows.push((family, yarn, (along as usize * places + place) as i32));
                        }
                    }
                }
            }
            // A pattern that was not looked at has the row of one that was.
            for family_place in shadows.patterns.chunks_exact_mut(512) {
                let known: Vec<usize> = (0..512).filter(|p| family_place[*p] != u32::MAX).collect();
                for p in 0..512usize {
                    if family_place[p] == u32::MAX {
                        let like = known.iter().min_by_key(|k| (*k ^ p).count_ones()).copied().unwrap_or(0);
                        family_place[p] = family_place[like];
                    }
                }
            }
        }
        let lines = (LINES / rows.len().max(1)).clamp(LINES_OF_ONE[0], LINES_OF_ONE[1]);
        let filled = parallel::map(rows.len().div_ceil(ROWS_A_PART), |part| {
            let rows = &rows[part * ROWS_A_PART..((part + 1) * ROWS_A_PART).min(rows.len())];
            let mut free = vec![0; rows.len() * SIZE];
            for (row, (family, yarn, place)) in free.chunks_exact_mut(SIZE).zip(rows) {
                fill(row, fabric, passing, (YarnId { family: *family, yarn: *yarn }, *place), lines);
            }
            free
        });
        shadows.free = filled.concat();
        shadows
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        self.free.len() + size_of_val(self.patterns.as_slice())
    }

    /// The rows of a yarn.
    #[inline]
    pub(crate) fn of(&self, fabric: &Fabric, family: YarnSet, yarn: i32) -> OfYarn<'_> {
        let [own, other] = [family, family.other()].map(|f| fabric.draft.threads(f));
        let [of_warp, of_own] = [YarnSet::Warp, family].map(|f| places(&fabric.yarns[f as usize]));
        let first = if family == YarnSet::Warp { 0 } else { of_warp * own * other };
        let places = of_own * other;
        OfYarn {
            shadows: self,
            family,
            yarn,
            per_um: fabric.yarns[family.other() as usize].per_spacing * of_own as f32,
            first: first + yarn.rem_euclid(own as i32) as usize * places,
            places: places as i32,
            from_crossing: of_own as i32,
        }
    }
}

/// The rows of a yarn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OfYarn<'a> {
    shadows: &'a Shadows,
    pub(crate) family: YarnSet,
    yarn: i32,
    per_um: f32,
    /// Where every place has rows of its own: the first row, and how many there are.
    first: usize,
    places: i32,
    /// Places from one crossing to the next.
    from_crossing: i32,
}

impl<'a> OfYarn<'a> {
    /// The shadows about a place of the yarn [um along it].
    #[inline]
    pub(crate) fn at(&self, fabric: &Fabric, along_um: f32) -> ShadowsAt<'a> {
        let (place, between) = floor_fraction(along_um * self.per_um);
        let row = |at: usize| -> &'a [u8; SIZE] {
            self.shadows.free.get(at * SIZE..).and_then(|rows| rows.first_chunk()).unwrap_or(&[ALL_FREE; SIZE])
        };
        let patterns = &self.shadows.patterns;
        if patterns.is_empty() {
            let place = place.rem_euclid(self.places);
            let next = if place + 1 < self.places { place + 1 } else { 0 };
            return ShadowsAt { rows: [place, next].map(|place| row(self.first + place as usize)), between };
        }
        let of = |place: i32| {
            let (crossing, phase) =
                (place.div_euclid(self.from_crossing), place.rem_euclid(self.from_crossing) as usize);
            let pattern = pattern(fabric, self.family, self.yarn, crossing);
            row(patterns[first_of(self.family) + phase * 512 + pattern] as usize)
        };
        ShadowsAt { rows: [of(place), of(place.wrapping_add(1))], between }
    }
}

/// Shadows about one place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShadowsAt<'a> {
    pub(crate) rows: [&'a [u8; SIZE]; 2],
    pub(crate) between: f32,
}

/// A direction, and where the table has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Toward {
    pub b: [f32; 3],
    /// `[row][column]` of the four entries around, and the shares of rows and columns.
    at: [[u16; 2]; 2],
    rows: [f32; 2],
    columns: [f32; 2],
}

impl Toward {
    #[inline]
    pub(crate) fn new(b: [f32; 3]) -> Toward {
        let z = b[2].abs().min(1.0);
        let r = ((band_of(z) - 0.5).max(0.0) as usize).min(BANDS - 1);
        let s = if r + 1 < BANDS {
            // A line through two bands goes on towards the plane.
            (z - MEAN_Z[r]) / (MEAN_Z[r + 1] - MEAN_Z[r])
        } else {
            // Shadows move in proportion to the sine of the tilt.
            1.0 - ((1.0 - z * z) * PER_SQUARED_SINE).sqrt()
        };
        let column = (crate::math::simd::atan2::<false>(b[1], b[0]) / TAU + 1.0) * COLUMNS as f32 - 0.5;
        let (c, t) = floor_fraction(column);
        let columns = [(c as usize) % COLUMNS, (c as usize + 1) % COLUMNS];
        let first = if b[2] < 0.0 { ROWS } else { 0 };
        let at = [r, r + 1].map(|r| columns.map(|c| (((first + r) * COLUMNS + c) * LANES) as u16));
        Toward { b, at, rows: [1.0 - s, s], columns: [1.0 - t, t] }
    }
}

/// Chances of being free in a direction, of light of each kind that leaves so across a ply whose axis lies
/// `off` from the yarn's, over the ply's radius, which is `scale` of half of the yarn's width. The first and
/// the last of them leave at the first place, the other at the second.
#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
pub(crate) fn free<'a>(
    places: &[ShadowsAt<'a>; 2],
    toward: &Toward,
    exits: &[ExitDensity; EXIT_KINDS],
    off: f32,
    scale: f32,
) -> [f32; EXIT_KINDS] {
    let mut sums = [[0.0f32; LANES]; 2];
    for (sum, place) in sums.iter_mut().zip(places) {
        let shares = [1.0 - place.between, place.between];
        for p in 0..2 {
            for r in 0..2 {
                for c in 0..2 {
                    let w = shares[p] * toward.rows[r] * toward.columns[c];
                    if let Some(lanes) = place.rows[p][usize::from(toward.at[r][c])..].first_chunk::<LANES>() {
                        for l in 0..LANES {
                            sum[l] += w * f32::from(lanes[l]);
                        }
                    }
                }
            }
        }
        for sum in sum {
            *sum = min(max(*sum * (MAX_SHARE / 255.0), 0.0), MAX_SHARE);
        }
    }
    // Offsets of the yarn grow as those of the ply fall; what lies beyond the yarn's width counts as at its
    // rim.
    let per = 1.0 / scale;
    let mut edges = [0.0f32; LANES];
    for (o, edge) in edges.iter_mut().enumerate() {
        *edge = off - per * (2.0 * o as f32 / OFFSETS as f32 - 1.0);
    }
    let mut shares = [0.0; EXIT_KINDS];
    for (i, share) in shares.iter_mut().enumerate() {
        let mut below = [0.0f32; LANES];
        for (below, edge) in below.iter_mut().zip(&edges) {
            *below = exits[i].below(*edge);
        }
        (below[0], below[OFFSETS]) = (1.0, 0.0);
        for o in 0..OFFSETS {
            *share += (below[o] - below[o + 1]) * sums[i % 2][o];
        }
    }
    shares
}

/// Where the patterns of a family begin.
fn first_of(family: YarnSet) -> usize {
    family as usize * MAX_PLACES * 512
}

/// Bits of the nine crossings around: the yarn's own and its neighbors', at this crossing and the ones
/// beside.
fn pattern(fabric: &Fabric, family: YarnSet, yarn: i32, crossing: i32) -> usize {
    let mut bits = 0;
    for y in -1..=1 {
        for c in -1..=1 {
            bits = 2 * bits + usize::from(fabric.is_on_top(family, yarn.wrapping_add(y), crossing.wrapping_add(c)));
        }
    }
    bits
}

/// Where the axis of a yarn or ply is that light leaves.
pub(crate) struct AxisAt<T> {
    pub center_um: [f32; 3],
    /// Unit.
    pub axis: [f32; 3],
    /// Curvature vector [1/um].
    pub bend_per_um: [f32; 3],
    pub radius_um: f32,
    /// Which it is.
    pub of: T,
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
pub(crate) fn fill_row<T>(
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

/// One place of a yarn. Of yarns of several plies, which turn from one side of a bend to the other, lines
/// count alike: their light is conserved without (tests/it/cloth.rs).
fn fill(row: &mut [u8], fabric: &Fabric, passing: &impl Passing, (id, place): (YarnId, i32), lines: usize) {
    let k = id.family as usize;
    let spacing = fabric.yarns[id.family.other() as usize].spacing;
    let (radius_um, is_one) = (fabric.yarns[k].half_width, fabric.yarns[k].plies == 1);
    let mut rng = SplitMix64((id.yarn as u64) << 32 ^ (place as u64) << 2 ^ id.family as u64);
    let at = |u: f32| {
        let along = spacing * (place as f32 + u - 0.5) / places(&fabric.yarns[k]) as f32;
        let line = fabric.center_line(id.family, id.yarn, f64::from(along));
        let [center_um, axis] = [line.point_um, line.tangent].map(|v| v.map(|v| v as f32));
        let bend = if is_one { line.curvature_per_um as f32 } else { 0.0 };
        let mut bend_per_um = [0.0; 3];
        (bend_per_um[1 - k], bend_per_um[2]) = (-bend * axis[2], bend * axis[1 - k]);
        AxisAt { center_um, axis, bend_per_um, radius_um, of: () }
    };
    fill_row(row, (lines, f32::INFINITY), &mut || rng.next_f64() as f32, at, |(), from, b| {
        free_share(fabric, passing, from, b, fabric.skip_yarn(id, from, b))
    });
}

/// Share of the light of a line that passes beside all plies.
fn free_share(fabric: &Fabric, passing: &impl Passing, from: [f32; 3], d: [f32; 3], skip: Skip) -> f32 {
    let mut flight = fabric.flight(from, d, skip);
    let mut free = 1.0;
    while let Some(near) = flight.next_near() {
        let hit = &near.hit;
        free *= passing.r_d(hit.family, hit.yarn, hit.theta_i, hit.h_um);
        if free < 1e-3 {
            return 0.0;
        }
    }
    free
}

#[cfg(test)]
mod tests {
    use super::super::flight::Candidate;
    use super::super::{FabricModel, FabricOptions, FabricSpec};
    use super::*;

    /// What lies between a yarn and the light that comes to it is what light that leaves there meets, and
    /// hardly a line meets a yarn twice at one place. Next to a bent yarn light starts from where the
    /// straight one has its wall.
    #[test]
    #[ignore = "slow: 5 s: lines meet the same both ways"]
    fn lines_meet_the_same_both_ways() {
        const LINES: usize = 4000;
        for (name, most) in [("polyester_layers", 0.002), ("silk_organza", 0.05), ("polyester_satin", 0.03)] {
            let loaded = FabricSpec::load(format!("{}/fabrics/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap();
            let bsdf = FabricModel::new(loaded, &FabricOptions::RAYS).unwrap();
            let fabric = &bsdf.fabric;
            let r_d =
                |near: &Candidate| bsdf.model_of(near.hit.family, near.hit.yarn).r_d(near.hit.theta_i, near.hit.h_um);
            let mut rng = SplitMix64(7);
            let mut number = || rng.next_f64() as f32;
            let [width, height] = fabric.repeat_um().map(|v| v as f32);
            for z in [0.5f32, 0.2, 0.1, 0.05] {
                let (mut came, mut left, mut twice) = (0.0, 0.0, 0);
                for i in 0..LINES {
                    let (sin, cos) = (TAU * (i as f32 + number()) / LINES as f32).sin_cos();
                    let across = (1.0 - z * z).sqrt();
                    let b = [across * cos, across * sin, z];
                    let mut flight = fabric.flight_through([width * number(), height * number()], b);
                    let (mut free, mut met) = (1.0f32, Vec::<Candidate>::new());
                    while let Some(near) = flight.next_near().filter(|_| free > 1e-3) {
                        let is_known = |other: &Candidate| {
                            other.id() == near.id() && (other.hit.along_um - near.hit.along_um).abs() < 1.0
                        };
                        twice += usize::from(met.iter().any(is_known));
                        let (hit, passes) = (&near.hit, r_d(&near));
                        let (axis, radius) = (hit.frame[2], fabric.yarns[hit.family as usize].half_width);
                        let x = cross(b, axis);
                        let scale = hit.h_um.clamp(-radius, radius) / dot(x, x).sqrt().max(1e-3);
                        let inner = std::array::from_fn(|i| near.center[i] + scale * x[i]);
                        let from = exit(near.center, axis, radius, inner, b);
                        let mut back = fabric.flight(from, b, fabric.skip_yarn(near.id(), from, b));
                        let mut back_free = 1.0;
                        while let Some(next) = back.next_near().filter(|_| back_free > 1e-3) {
                            back_free *= r_d(&next);
                        }
                        came += (1.0 - passes) * free / LINES as f32;
                        left += (1.0 - passes) * back_free / LINES as f32;
                        free *= passes;
                        met.push(near);
                    }
                }
                println!("{name}, cosine {z}: {came:.4} comes, {left:.4} leaves, met twice: {twice}");
                assert!(twice <= LINES / 500, "{name}, cosine {z}: {twice} met twice");
                assert!((came - left).abs() < most, "{name}, cosine {z}: {came} {left}");
            }
        }
    }
}
