//! Starting chains of a woven cloth, from its draft and its yarns, before they are relaxed.
//!
//! The cell is the smallest that the draft allows: that of a five-end satin has one end and one pick, shifted
//! from end to end, instead of five of each.

use super::relax::{Chain, Elements, Hold, Section, Station};
use plywave::cloth::{ClothYarn, Lattice, PlyCurve};
use plywave_textile::{Draft, YarnOfCloth};
use std::f64::consts::{PI, TAU};

/// Length of an element over its strand's radius, for plies and for bundles.
pub(super) const ELEMENT: [f64; 2] = [0.33, 0.6];

/// Maximum number of nodes of a cloth that is relaxed, of plies and of bundles: the factor of its Hessian and
/// the rest take about 6 and 20 kB a node, so 8 GiB together.
const MAX_NODES: [f64; 2] = [1.2e6, 4e5];

/// Maximum number of nodes of a cloth of these yarns.
pub(super) fn max_nodes(yarns: &[&YarnOfCloth]) -> f64 {
    MAX_NODES[usize::from(yarns.iter().any(|yarn| yarn.bundles > 1))]
}

/// Coefficient of friction of yarn on yarn: chosen within the values that textbooks give for fibers on
/// fibers, from 0.1 (wool along its scales) to 0.6 (against them).
pub(super) const FRICTION: f64 = 0.25;
/// Displacement at which a yarn slides, over its radius. Chosen: until then its fibers and those of the yarns
/// that cross it shear.
pub(super) const SLIP: f64 = 0.5;

/// Starting chains with the yarns that they belong to.
pub(super) struct Start {
    pub elements: Elements,
    pub yarns: Vec<ClothYarn>,
    /// Yarn of each chain.
    pub of_chain: Vec<u32>,
    /// Kind of each yarn of several strands, with its twist rounded to the period [turns/um].
    pub twists: Vec<(u32, f64)>,
}

/// Minimal cell `[i, j, k]` of a draft, spanned by the vectors (i, j) and (0, k) in ends and picks.
pub(super) fn minimal_cell(draft: &Draft) -> [usize; 3] {
    let (ends, picks) = (draft.ends(), draft.picks());
    let is_same = |i: usize, j: usize| {
        (0..picks).all(|p| (0..ends).all(|e| draft.up(p, e) == draft.up((p + j) % picks, (e + i) % ends)))
    };
    let k = (1..picks).find(|k| picks % k == 0 && is_same(0, *k)).unwrap_or(picks);
    let first = (1..ends).filter(|i| ends % i == 0).find_map(|i| (0..k).find(|j| is_same(i, *j)).map(|j| (i, j)));
    let (i, j) = first.unwrap_or((ends, 0));
    [i, j, k]
}

/// Estimated number of nodes of a draft's minimal cell.
pub(super) fn nodes(draft: &Draft, yarns: [&YarnOfCloth; 2], spacing_um: [f64; 2]) -> f64 {
    let [i, _, k] = minimal_cell(draft);
    let crossings = (i * k) as f64;
    let of = |set: usize| {
        let yarn = yarns[set];
        crossings * spacing_um[1 - set] / element_um(yarn) * yarn.strands() as f64
    };
    of(0) + of(1)
}

/// Length of an element of a yarn [um].
pub(super) fn element_um(yarn: &YarnOfCloth) -> f64 {
    ELEMENT[usize::from(yarn.bundles > 1)] * yarn.strand_radius_um()
}

/// Number of nodes of a yarn's period for elements of a length.
pub(super) fn nodes_of(period_um: f64, element_um: f64) -> usize {
    ((period_um / element_um).ceil() as usize).max(8)
}

/// Tension of a yarn; one of a given crimp has the usual one.
pub(super) fn axis_tension(yarn: &YarnOfCloth) -> f64 {
    if yarn.crimp_percent.is_some() { 1.0 } else { yarn.tension }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Height of a yarn at `u` along it: at crossings `spacing` apart it lies `amplitude` up or down, with cosine
/// transitions in between. All values are in um.
fn height(amplitude: f64, spacing: f64, is_up: &dyn Fn(i64) -> bool, u: f64) -> f64 {
    let f = u / spacing - 0.5;
    let crossing = f.floor();
    let at = |k: i64| if is_up(k) { amplitude } else { -amplitude };
    let w = 0.5 - 0.5 * (PI * (f - crossing)).cos();
    (1.0 - w) * at(crossing as i64) + w * at(crossing as i64 + 1)
}

/// Maximum force of friction on a yarn over its length [force/um]. Where a yarn of tension T passes from one
/// side of the cloth to the other at an angle theta, it presses with 2 T sin theta on those that it crosses.
/// `apart_um` is the sum of the radii, `spacing_um` that of the crossings, `turns` the share of them after
/// which the yarn changes sides.
fn friction(tension: f64, apart_um: f64, spacing_um: f64, turns: f64) -> f64 {
    FRICTION * 2.0 * tension * apart_um / apart_um.hypot(spacing_um) * turns / spacing_um
}

/// Lays out the starting chains of a draft with the yarns of warp and weft and the spacings of their axes
/// [um]. Returns `None` if the vectors span no cell, which cannot happen for spacings above 0.
pub(super) fn woven(draft: &Draft, yarns: [&YarnOfCloth; 2], spacing_um: [f64; 2]) -> Option<Start> {
    woven_in(minimal_cell(draft), draft, yarns, spacing_um, yarns.map(element_um))
}

/// As [`woven`], in a cell of the draft that is spanned by the vectors (i, j) and (0, k) in ends and picks,
/// with elements of these lengths [um].
pub(super) fn woven_in(
    [i, j, k]: [usize; 3],
    draft: &Draft,
    yarns: [&YarnOfCloth; 2],
    spacing_um: [f64; 2],
    element_um: [f64; 2],
) -> Option<Start> {
    let [sx, sy] = spacing_um;
    let lattice = Lattice::new([[i as f64 * sx, j as f64 * sy], [0.0, k as f64 * sy]])?;
    let elements = Elements { lattice, chains: Vec::new(), sections: Vec::new(), thickness_um: None };
    let mut start = Start { elements, yarns: Vec::new(), of_chain: Vec::new(), twists: Vec::new() };
    let apart = yarns[0].radius_um() + yarns[1].radius_um();
    // The looser yarn bends more.
    let tension = yarns.map(axis_tension);
    let share = tension[1] / (tension[0] + tension[1]);
    let amplitude = [apart * share, apart * (1.0 - share)];
    let (ends, picks) = (draft.ends() as i64, draft.picks() as i64);
    for end in 0..i {
        let yarn = ClothYarn { kind: 0, number: end as i32, step: [i as i32, 0], period: [0, 1] };
        let up = |pick: i64| draft.up(pick.rem_euclid(picks) as usize, end);
        let z = |u: f64| height(amplitude[0], sy, &up, u);
        let turns = (0..picks).filter(|pick| up(*pick) != up(pick + 1)).count() as f64 / picks as f64;
        let grip = friction(tension[0], apart, sy, turns);
        start.add(yarns[0], yarn, [(end as f64 + 0.5) * sx, 0.0], element_um[0], grip, z);
    }
    // A pick that continues into the cells to its right is another pick there.
    let wefts = gcd(j, k);
    let cells = (k / wefts) as i32;
    for pick in 0..wefts {
        let period = [cells, -((cells as usize * j / k) as i32)];
        let yarn = ClothYarn { kind: 1, number: pick as i32, step: [j as i32, k as i32], period };
        let up = |end: i64| !draft.up(pick, end.rem_euclid(ends) as usize);
        let z = |u: f64| height(amplitude[1], sx, &up, u);
        let turns = (0..ends).filter(|end| up(*end) != up(end + 1)).count() as f64 / ends as f64;
        let grip = friction(tension[1], apart, sx, turns);
        start.add(yarns[1], yarn, [0.0, (pick as f64 + 0.5) * sy], element_um[1], grip, z);
    }
    Some(start)
}

impl Start {
    /// Adds the strands of a yarn that is straight in the plane. Its axis starts at `from` [um]; `z` returns
    /// its height at a length along it [um], `grip` is its friction [force/um].
    fn add(
        &mut self,
        spec: &YarnOfCloth,
        yarn: ClothYarn,
        from: [f64; 2],
        element_um: f64,
        grip: f64,
        z: impl Fn(f64) -> f64,
    ) {
        let way = self.elements.lattice.vector(yarn.period);
        let period_um = way[0].hypot(way[1]);
        let along = way.map(|v| v / period_um);
        let axis = |s: f64| {
            // The direction across points to the left of the yarn, viewed from above.
            let u = s * period_um;
            (
                [from[0] + u * along[0], from[1] + u * along[1], z(s.rem_euclid(1.0) * period_um)],
                [-along[1], along[0], 0.0],
            )
        };
        let across = [-along[1], along[0]];
        let line_um = across[0] * from[0] + across[1] * from[1];
        let slip_um = SLIP * spec.radius_um();
        let hold = (grip > 0.0).then_some(Hold { across, line_um, slip_um, force_per_um: grip });
        self.add_along(spec, yarn, (period_um, nodes_of(period_um, element_um)), |_| [hold, None], axis);
    }

    /// Adds the strands of a yarn about an axis. `axis` returns the point and the unit vector across at `s`,
    /// which grows by 1 over a period and may exceed it. `length_um` is the length of a period, `nodes` its
    /// number of nodes. `holds` returns the friction at `s`.
    pub fn add_along(
        &mut self,
        spec: &YarnOfCloth,
        yarn: ClothYarn,
        (length_um, nodes): (f64, usize),
        holds: impl Fn(f64) -> [Option<Hold>; 2],
        axis: impl Fn(f64) -> ([f64; 3], [f64; 3]),
    ) {
        let radius_um = spec.strand_radius_um();
        let places: Vec<[f64; 2]> = spec.section().iter().map(|p| p.map(|v| v * radius_um)).collect();
        let count = places.len();
        // The twist is rounded so that the section maps onto itself after a period.
        let symmetry = f64::from(spec.symmetry());
        let turn = if count > 1 { spec.twist().closed_rad(length_um, symmetry, 0.0) } else { 0.0 };
        let turned = |p: [f64; 2], angle: f64| {
            let (sin, cos) = angle.sin_cos();
            [p[0] * cos - p[1] * sin, p[0] * sin + p[1] * cos]
        };
        let image = |k: usize| {
            let q = turned(places[k], turn);
            let off = |i: usize| (places[i][0] - q[0]).hypot(places[i][1] - q[1]);
            (0..count).min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(k)
        };
        let tension = axis_tension(spec) / count as f64;
        // `[strand]`: its chain, and its number of periods along that chain.
        let mut of_strand: Vec<Option<(usize, usize)>> = vec![None; count];
        let index = self.yarns.len() as u32;
        for first in 0..count {
            if of_strand[first].is_some() {
                continue;
            }
            let (chain, mut periods, mut strand) = (self.elements.chains.len(), 0, first);
            let mut points_um = Vec::new();
            while of_strand[strand].is_none() {
                of_strand[strand] = Some((chain, periods));
                for i in 0..nodes {
                    let s = (i as f64 + 0.5) / nodes as f64;
                    let (point, across) = axis(s + periods as f64);
                    let [c, n] = turned(places[strand], turn * s);
                    points_um.push([point[0] + c * across[0], point[1] + c * across[1], point[2] + c * across[2] + n]);
                }
                periods += 1;
                strand = image(strand);
            }
            let off = places[first][0].hypot(places[first][1]);
            let held = spec.crimp_percent.map(|crimp| {
                let own = length_um * (1.0 + 0.01 * crimp);
                periods as f64 * own.hypot(turn * off)
            });
            self.elements.chains.push(Chain {
                points_um,
                shift: yarn.period.map(|p| p * periods as i32),
                radius_um,
                tension,
                bending: spec.stiffness * tension * radius_um * radius_um,
                length_um: held,
            });
            self.of_chain.push(index);
        }
        self.yarns.push(yarn);
        if count > 1 {
            self.twists.push((yarn.kind, turn / TAU / length_um));
        }
        let yarn_radius = spec.radius_um();
        let cohesion = if count > 1 { spec.cohesion * tension / (yarn_radius * yarn_radius) } else { 0.0 };
        let length_um = length_um / nodes as f64;
        for i in 0..nodes {
            let station = || -> Station {
                let of = |(chain, periods): &(usize, usize)| {
                    (*chain, periods * nodes + i, yarn.period.map(|p| -(*periods as i32) * p))
                };
                of_strand.iter().flatten().map(of).collect()
            };
            let [hold, other] = holds((i as f64 + 0.5) / nodes as f64);
            if count > 1 || hold.is_some() {
                self.elements.sections.push(Section { station: station(), cohesion, length_um, hold });
            }
            if other.is_some() {
                self.elements.sections.push(Section { station: station(), cohesion: 0.0, length_um, hold: other });
            }
        }
    }
}

/// The spline of a chain. The elements are chords, which lie on average `l^2 kappa / 12` inside the arc
/// through their nodes. A spline through the nodes lies on that arc, a spline with the nodes as control
/// points `l^2 kappa / 6` inside it. The mean of both has the mean height of the elements.
pub(super) fn smooth(chain: &Chain, yarn: u32, lattice: &Lattice) -> PlyCurve {
    let mut curve = PlyCurve::through(yarn, chain.radius_um, chain.shift, &chain.points_um, lattice);
    for (control, node) in curve.control_um.iter_mut().zip(&chain.points_um) {
        *control = std::array::from_fn(|k| 0.5 * (control[k] + node[k]));
    }
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The minimal cell maps the draft onto itself, and no smaller one does.
    #[test]
    fn least_cells_are_those_of_weavers() {
        assert_eq!(minimal_cell(&Draft::plain()), [1, 1, 2]);
        assert_eq!(minimal_cell(&Draft::satin(5, 2).unwrap()), [1, 3, 5]);
        assert_eq!(minimal_cell(&Draft::twill(3, 1).unwrap()), [1, 1, 4]);
        assert_eq!(minimal_cell(&Draft::hopsack(2, 2).unwrap()), [2, 2, 4]);
        assert_eq!(minimal_cell(&Draft::layers()), [1, 0, 1]);
        // Several repeats of a plain weave, written out.
        let wide = Draft::from_fn(4, 6, |pick, end| (pick + end) % 2 == 0).unwrap();
        assert_eq!(minimal_cell(&wide), [1, 1, 2]);
    }
}
