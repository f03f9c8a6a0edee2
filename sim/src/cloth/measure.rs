//! Measures of a cloth as weavers know them: crimp, width and height of its yarns, thickness, cover, mass.
//!
//! Lengths and sections follow from the splines, cover from lines along the normal, mass from the counts of
//! the yarns, and overlap from distances between short straight pieces. [`ClothSolid`] finds the ply at a
//! point.

use plywave::cloth::{Buckets, ClothCurves, ClothLines, ClothYarn, Lattice, LineHits, PlyCurve, whole_times};
use plywave::math::vec3::{cross, dot, sub, unit};
use plywave_textile::YarnOfCloth;
use serde::Serialize;

/// Number of sections of a yarn that are measured in one period.
const SECTIONS: usize = 64;
/// Number of lines along which the cover is measured, and the steps of their places over the cell (powers of
/// the plastic number: M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
const LINES: usize = 40_000;
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
/// Samples of a curve from knot to knot.
const SAMPLES: usize = 2;
/// Product of curvature and radius below which a strand counts as straight.
const STRAIGHT: f64 = 1e-6;

/// Measures of the yarns of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct YarnMeasures {
    /// Kind, as in [`ClothYarn::kind`].
    pub kind: u32,
    /// Length of the yarn's axis over that of its straight period, less 1.
    pub crimp: f64,
    /// Length of the axis in one cell [um].
    pub length_um: f64,
    /// Mean width of the yarn's sections in the plane of the cloth [um].
    pub width_um: f64,
    /// Mean height of the yarn's sections [um].
    pub height_um: f64,
    /// Mean radius of its plies or bundles over the curves [um].
    pub strand_radius_um: f64,
    /// Number of plies or bundles of a yarn.
    pub strands: usize,
    /// Minimum radius of curvature of a ply or bundle over its radius; infinite if all are straight.
    pub least_bend: f64,
}

/// Measures of a cloth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClothMeasures {
    /// Measures of the yarns, one entry for each kind.
    pub yarns: Vec<YarnMeasures>,
    /// Distance from the lowest to the highest point of the plies [um].
    pub thickness_um: f64,
    /// Share of the area that no ply covers, viewed along the normal.
    pub openness: f64,
    /// Mass per area [g/m2].
    pub mass_g_per_m2: f64,
    /// Maximum overlap of two plies over their mean radius.
    pub overlap: f64,
    /// Indices of the yarns of these two plies, equal if a yarn overlaps itself or its image.
    pub overlap_yarns: [u32; 2],
}

fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// A yarn of the cell: its curves, each repeated for every period of the yarn along it.
struct Strands<'a> {
    lattice: &'a Lattice,
    yarn: &'a ClothYarn,
    /// Pairs of a curve and the period along it.
    all: Vec<(&'a PlyCurve, usize)>,
}

impl<'a> Strands<'a> {
    fn new(cloth: &'a ClothCurves, lattice: &'a Lattice, index: usize) -> Strands<'a> {
        let yarn = &cloth.yarns[index];
        let of = cloth.curves.iter().filter(|curve| curve.yarn as usize == index);
        let all = of.flat_map(|curve| (0..curve.turns(yarn)).map(move |period| (curve, period))).collect();
        Strands { lattice, yarn, all }
    }

    /// Point of a strand [um] and its derivative at `s`, which grows by 1 over the yarn's period.
    fn at(&self, (curve, period): (&PlyCurve, usize), s: f64) -> ([f64; 3], [f64; 3]) {
        let knots = curve.control_um.len() as f64 / curve.turns(self.yarn) as f64;
        let place = curve.at(self.lattice, (s + period as f64) * knots);
        let back = self.lattice.vector(self.yarn.period.map(|p| -p * period as i32));
        let [x, y, z] = place.point_um;
        ([x + back[0], y + back[1], z], place.d_um.map(|d| d * knots))
    }

    /// Point of the yarn's axis at `s`, the mean of the strands [um].
    fn axis(&self, s: f64) -> [f64; 3] {
        let points = self.all.iter().map(|strand| self.at(*strand, s).0);
        let sum = points.fold([0.0; 3], |sum, p| std::array::from_fn(|k| sum[k] + p[k]));
        sum.map(|v| v / self.all.len() as f64)
    }

    /// Width and height of the section at `s` [um].
    fn section(&self, s: f64) -> [f64; 2] {
        let center = self.axis(s);
        let along = unit(sub(self.axis(s + 1e-3), self.axis(s - 1e-3)));
        let across = unit(cross([0.0, 0.0, 1.0], along));
        let up = cross(along, across);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for strand in &self.all {
            let mut at = s;
            for _ in 0..8 {
                let (point, d) = self.at(*strand, at);
                let speed = dot(d, along);
                if speed.abs() < 1e-9 {
                    break;
                }
                at -= (dot(sub(point, center), along) / speed).clamp(-0.05, 0.05);
            }
            let off = sub(self.at(*strand, at).0, center);
            for (k, side) in [across, up].into_iter().enumerate() {
                low[k] = low[k].min(dot(off, side) - strand.0.radius_um);
                high[k] = high[k].max(dot(off, side) + strand.0.radius_um);
            }
        }
        [high[0] - low[0], high[1] - low[1]]
    }
}

/// A short straight piece of a curve.
struct MeasuredPiece {
    from: [f64; 3],
    to: [f64; 3],
    radius: f64,
    curve: usize,
    /// Number of the piece on the curve.
    number: usize,
}

fn pieces(cloth: &ClothCurves, lattice: &Lattice) -> Vec<MeasuredPiece> {
    let mut pieces = Vec::new();
    for (index, curve) in cloth.curves.iter().enumerate() {
        let count = SAMPLES * curve.control_um.len();
        let at = |i: usize| curve.at(lattice, i as f64 / SAMPLES as f64).point_um;
        for number in 0..count {
            pieces.push(MeasuredPiece {
                from: at(number),
                to: at(number + 1),
                radius: curve.radius_um,
                curve: index,
                number,
            });
        }
    }
    pieces
}

/// Maximum distance of a piece's middle from its wall [um].
fn reach_of(pieces: &[MeasuredPiece]) -> f64 {
    pieces.iter().map(|p| p.radius + 0.5 * norm(sub(p.to, p.from))).fold(0.0, f64::max)
}

/// Measures a cloth. `yarns` are those of its spec, by kind; kinds that are absent add nothing to the mass.
///
/// # Errors
/// The errors of [`ClothLines::new`], and [`plywave::Error::Invalid`] for curves so long or thick that each
/// reaches over many others.
pub fn measure(cloth: &ClothCurves, lattice: &Lattice, yarns: &[&YarnOfCloth]) -> plywave::Result<ClothMeasures> {
    let lines = ClothLines::new(cloth)?;
    let pieces = pieces(cloth, lattice);
    if !Buckets::can_search(lattice, pieces.len(), 2.0 * reach_of(&pieces)) {
        return Err(plywave::Error::Invalid {
            file: "cloth".into(),
            key: "curve".into(),
            value: format!("{} curves", cloth.curves.len()),
            hint: "use finer points and thinner plies: each reaches over many others".into(),
        });
    }
    let top = pieces.iter().map(|p| p.from[2] + p.radius).fold(f64::NEG_INFINITY, f64::max);
    let low = pieces.iter().map(|p| p.from[2] - p.radius).fold(f64::INFINITY, f64::min);
    let mut kinds: Vec<u32> = cloth.yarns.iter().map(|yarn| yarn.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let mass: f64 = cloth
        .curves
        .iter()
        .map(|curve| {
            let spec = yarns.get(cloth.yarns[curve.yarn as usize].kind as usize);
            let tex = spec.map_or(0.0, |spec| tex_of_strand(spec, strands_of(cloth, curve.yarn as usize)));
            // 1 g/km is 1e-9 g/um, and 1e-9 g/um2 are 1e3 g/m2.
            1e3 * tex * curve.length_um(lattice) / lattice.area_um2()
        })
        .sum();
    let (overlap, overlap_yarns) = overlap(cloth, lattice, &pieces);
    Ok(ClothMeasures {
        yarns: kinds.into_iter().map(|kind| yarns_of(cloth, lattice, kind)).collect(),
        thickness_um: top - low,
        openness: openness(lattice, &lines),
        mass_g_per_m2: mass,
        overlap,
        overlap_yarns,
    })
}

/// Number of strands of a yarn: its curves, each counted once for every period of the yarn along it.
pub(super) fn strands_of(cloth: &ClothCurves, index: usize) -> usize {
    let of = cloth.curves.iter().filter(|curve| curve.yarn as usize == index);
    of.map(|curve| curve.turns(&cloth.yarns[index])).sum()
}

/// Linear density [g/km] of each strand. Several strands share the count of the yarn; a lone strand stands
/// for one ply or bundle.
pub(super) fn tex_of_strand(spec: &YarnOfCloth, strands: usize) -> f64 {
    match strands {
        0 | 1 => spec.strand_tex(),
        _ => spec.strand_tex() * spec.strands() as f64 / strands as f64,
    }
}

fn yarns_of(cloth: &ClothCurves, lattice: &Lattice, kind: u32) -> YarnMeasures {
    let (mut length, mut straight, mut size, mut count) = (0.0, 0.0, [0.0; 2], 0.0);
    let (mut radii, mut curves, mut of_yarn) = (0.0, 0.0, 0);
    let mut least_bend = f64::INFINITY;
    for index in (0..cloth.yarns.len()).filter(|i| cloth.yarns[*i].kind == kind) {
        let strands = Strands::new(cloth, lattice, index);
        if strands.all.is_empty() {
            continue;
        }
        let points: Vec<[f64; 3]> =
            (0..=8 * SECTIONS).map(|i| strands.axis(i as f64 / (8 * SECTIONS) as f64)).collect();
        length += points.windows(2).map(|p| norm(sub(p[1], p[0]))).sum::<f64>();
        let way = lattice.vector(cloth.yarns[index].period);
        straight += way[0].hypot(way[1]);
        for i in 0..SECTIONS {
            let [width, height] = strands.section(i as f64 / SECTIONS as f64);
            size[0] += width;
            size[1] += height;
            count += 1.0;
        }
        of_yarn = strands.all.len();
        for (curve, _) in &strands.all {
            radii += curve.radius_um;
            curves += 1.0;
            for i in 0..2 * curve.control_um.len() {
                let kappa = curve.at(lattice, 0.5 * i as f64).curvature_per_um();
                if kappa * curve.radius_um > STRAIGHT {
                    least_bend = least_bend.min(1.0 / (kappa * curve.radius_um));
                }
            }
        }
    }
    YarnMeasures {
        kind,
        // Rounding can make the crimp of a straight yarn slightly negative.
        crimp: (length / straight - 1.0).max(0.0),
        length_um: length,
        width_um: size[0] / count,
        height_um: size[1] / count,
        strand_radius_um: radii / curves,
        strands: of_yarn,
        least_bend,
    }
}

/// Share of lines along the normal that hit no ply.
fn openness(lattice: &Lattice, lines: &ClothLines) -> f64 {
    let [a, b] = lattice.cell_um;
    let top = lines.half_thickness_um();
    let mut hits = LineHits::default();
    let mut is_open = |line: usize| {
        let [s, t] = STEPS.map(|step| (0.5 + step * line as f64).fract());
        let [x, y] = [s * a[0] + t * b[0], s * a[1] + t * b[1]];
        lines.hits([x as f32, y as f32, top], [0.0, 0.0, -1.0], &mut hits);
        hits.as_slice().is_empty()
    };
    (0..LINES).filter(|line| is_open(*line)).count() as f64 / LINES as f64
}

/// Maximum overlap of two curves over their mean radius, from the distances of the ends and middles of short
/// pieces to other pieces, with the indices of the curves' yarns.
fn overlap(cloth: &ClothCurves, lattice: &Lattice, pieces: &[MeasuredPiece]) -> (f64, [u32; 2]) {
    let middle = |p: &MeasuredPiece| -> [f64; 3] { std::array::from_fn(|k| 0.5 * (p.from[k] + p.to[k])) };
    let points: Vec<[f64; 3]> = pieces.iter().map(middle).collect();
    let half = |p: &MeasuredPiece| 0.5 * norm(sub(p.to, p.from));
    let buckets = Buckets::new(lattice, &points, 2.0 * reach_of(pieces));
    let (mut largest, mut yarns) = (0.0f64, [0; 2]);
    for (i, piece) in pieces.iter().enumerate() {
        let curve = &cloth.curves[piece.curve];
        buckets.near(points[i], |j, cells| {
            let other = &pieces[j];
            let by = lattice.vector(cells);
            if piece.curve == other.curve {
                // Pieces of the same strand that are close along it do not count as overlapping.
                if let Some(k) = whole_times(cells, curve.shift) {
                    let count = (SAMPLES * curve.control_um.len()) as i64;
                    let steps = (other.number as i64 + i64::from(k) * count - piece.number as i64).abs();
                    if steps as f64 * (half(piece) + half(other)) < 4.0 * piece.radius {
                        return;
                    }
                }
            }
            let from = [other.from[0] + by[0], other.from[1] + by[1], other.from[2]];
            let d = sub(other.to, other.from);
            for p in [piece.from, points[i]] {
                let w = sub(p, from);
                let t = (dot(w, d) / dot(d, d).max(1e-12)).clamp(0.0, 1.0);
                let apart = norm([w[0] - t * d[0], w[1] - t * d[1], w[2] - t * d[2]]);
                let sum = piece.radius + other.radius;
                let overlap = (sum - apart) / (0.5 * sum);
                if overlap > largest {
                    (largest, yarns) = (overlap, [curve.yarn, cloth.curves[other.curve].yarn]);
                }
            }
        });
    }
    (largest, yarns)
}

/// Point queries on a cloth: the ply that contains a point, and the ply on top.
pub struct ClothSolid {
    lattice: Lattice,
    pieces: Vec<MeasuredPiece>,
    buckets: Buckets,
    lines: ClothLines,
}

impl ClothSolid {
    /// Prepares the queries of a cloth.
    ///
    /// # Errors
    /// The errors of [`ClothCurves::check`].
    pub fn new(cloth: &ClothCurves) -> plywave::Result<ClothSolid> {
        let lines = ClothLines::new(cloth)?;
        let lattice = cloth.lattice("cloth")?;
        let pieces = pieces(cloth, &lattice);
        let middles = pieces.iter().map(|p| std::array::from_fn(|k| 0.5 * (p.from[k] + p.to[k])));
        let buckets = Buckets::new(&lattice, &middles.collect::<Vec<_>>(), reach_of(&pieces));
        Ok(ClothSolid { lattice, pieces, buckets, lines })
    }

    /// The curve whose ply contains a point [um], and the distance from its axis over its radius. If plies
    /// overlap, the one with the smallest such distance is returned.
    pub fn ply_at(&self, point: [f64; 3]) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        self.buckets.near(point, |i, cells| {
            let piece = &self.pieces[i];
            let by = self.lattice.vector(cells);
            let w = sub(point, [piece.from[0] + by[0], piece.from[1] + by[1], piece.from[2]]);
            let d = sub(piece.to, piece.from);
            let t = (dot(w, d) / dot(d, d).max(1e-12)).clamp(0.0, 1.0);
            let off = norm([w[0] - t * d[0], w[1] - t * d[1], w[2] - t * d[2]]) / piece.radius;
            if off < 1.0 && best.is_none_or(|(_, min)| off < min) {
                best = Some((piece.curve, off));
            }
        });
        best
    }

    /// The ply on top at a point of the plane [um], viewed from the face: its curve, the height of its wall
    /// [um] and the unit normal there.
    pub fn top_at(&self, [x, y]: [f64; 2]) -> Option<(usize, f64, [f64; 3])> {
        let top = self.lines.half_thickness_um();
        let mut hits = LineHits::default();
        self.lines.hits([x as f32, y as f32, top], [0.0, 0.0, -1.0], &mut hits);
        let hit = hits.as_slice().first()?;
        let [cx, cy, cz] = hit.center_um.map(f64::from);
        let p = [-cx, -cy, -f64::from(hit.enter_um) - cz];
        let tangent = hit.tangent.map(f64::from);
        let along = dot(p, tangent);
        let normal = unit(std::array::from_fn(|k| p[k] - along * tangent[k]));
        Some((hit.curve as usize, f64::from(top - hit.enter_um), normal))
    }
}
