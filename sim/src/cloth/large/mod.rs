//! Large drafts: crossings with equal neighborhoods share their shape.
//!
//! Friction holds yarns, so their shape about a crossing depends on the weave nearby: on a window of 7 x 7
//! crossings. A large draft has far fewer different windows than crossings. Each is shown by a tile, a part
//! of the draft with a margin that is relaxed by itself (`tiles.rs`). The curves of the whole draft are the
//! shapes of its crossings (`shape.rs`), each faded into the next along the yarn. Heights of the whole cloth
//! follow from those of neighboring crossings (`heights.rs`).
//!
//! Tiles are relaxed with the axes of yarns alone; strands are laid about them afterwards.

mod heights;
mod shape;
mod tiles;
mod windows;

use super::relax::{Elements, Relaxed, Rest, part, relax};
use super::woven::{ELEMENT, Start, woven_in};
use plywave::cloth::{ClothYarn, Lattice, PlyCurve};
use plywave_textile::{Draft, YarnOfCloth};
use rayon::prelude::*;
use shape::{Shape, Shapes};
use std::sync::Mutex;
use tiles::{Cover, Tile};
use windows::{MAX_REACH, Windows};

/// Number of crossings of the smallest cell from which a draft is made of tiles.
pub(super) const LARGE: usize = 1500;
/// Largest number of windows by which surroundings are told apart; of a draft with more, smaller windows are.
const MAX_ALIKE: usize = 1000;
/// Overlap over the radius above which strands are parted where different shapes meet, and number of rounds.
const PARTED: f64 = 0.03;
const ROUNDS: usize = 40;
/// Share of the work that the relaxation of the tiles takes.
const TILES: f64 = 0.95;

/// A large draft as laid out from its tiles.
pub(super) struct Large {
    /// The yarns with their strands. There are no sections: the cloth is at rest as far as its tiles are.
    pub start: Start,
    /// `[chain][crossing]`: number of what surrounds the strand from this crossing to the next.
    pub alike: Vec<Vec<u32>>,
    /// Nodes and steps of all tiles, and the largest forces and overlaps.
    pub relaxed: Relaxed,
    /// Number of crossings, of different windows, and of crossings of all tiles.
    pub counts: [usize; 3],
    /// Draft of the tile with the largest overlap.
    pub densest: Draft,
}

/// Number of points of a strand from crossing to crossing, for ends and picks.
fn samples(yarns: [&YarnOfCloth; 2], spacing_um: [f64; 2]) -> [usize; 2] {
    // Yarns of cloth are some 10 % longer than straight ones.
    [0, 1].map(|set| {
        let element_um = ELEMENT[1] * yarns[set].strand_radius_um();
        ((1.1 * spacing_um[1 - set] / element_um).ceil() as usize).max(4)
    })
}

/// Number of points of a large draft's strands.
pub(super) fn points(draft: &Draft, yarns: [&YarnOfCloth; 2], spacing_um: [f64; 2]) -> usize {
    let samples = samples(yarns, spacing_um);
    draft.ends() * draft.picks() * (samples[0] * yarns[0].strands() + samples[1] * yarns[1].strands())
}

/// A yarn of one strand, as thick as this one.
fn single(yarn: &YarnOfCloth) -> YarnOfCloth {
    let (strands, of_strand) = (yarn.strands() as f64, yarn.strand_radius_um() / yarn.radius_um());
    let mut single = yarn.clone();
    single.count.single_tex = yarn.tex();
    (single.plies, single.bundles) = (1, 1);
    single.packing = yarn.packing * strands * of_strand * of_strand;
    single
}

/// Lays out a large draft. `go_on` gets the share that is done; the result is `None` once it returns `false`.
pub(super) fn large(
    draft: &Draft,
    yarns: [&YarnOfCloth; 2],
    spacing_um: [f64; 2],
    thickness_um: Option<f64>,
    go_on: &(dyn Fn(f64) -> bool + Sync),
) -> Option<Large> {
    let windows = Windows::new(draft, MAX_REACH);
    let cover = Cover::new(draft, &windows);
    let axes = yarns.map(single);
    let samples = samples(yarns, spacing_um);
    let sizes: Vec<usize> = cover.tiles.iter().map(|tile| tile.size[0] * tile.size[1]).collect();
    let all: usize = sizes.iter().sum();
    let done = Mutex::new(vec![0.0; sizes.len()]);
    let relax_tile = |(number, tile): (usize, &Tile)| {
        let cell = [tile.size[0], 0, tile.size[1]];
        let axes = [&axes[0], &axes[1]];
        let element_um = axes.map(|yarn| ELEMENT[1] * yarn.strand_radius_um());
        let mut elements: Elements = woven_in(cell, &tile.draft(draft)?, axes, spacing_um, element_um)?.elements;
        elements.thickness_um = thickness_um;
        let report = |share: f64| {
            let mut done = done.lock().unwrap_or_else(|e| e.into_inner());
            done[number] = share * sizes[number] as f64 / all as f64;
            go_on(TILES * done.iter().sum::<f64>())
        };
        let relaxed = relax(&mut elements, Rest::Near, &report)?;
        Some((relaxed, Shapes::new(&elements, tile.size, spacing_um, samples)))
    };
    let tiles: Vec<(Relaxed, Shapes)> =
        cover.tiles.par_iter().enumerate().map(relax_tile).collect::<Option<Vec<_>>>()?;
    let densest = (0..tiles.len()).max_by(|a, b| tiles[*a].0.overlap.total_cmp(&tiles[*b].0.overlap))?;
    let relaxed = Relaxed {
        nodes: tiles.iter().map(|(relaxed, _)| relaxed.nodes).sum(),
        steps: tiles.iter().map(|(relaxed, _)| relaxed.steps).sum(),
        force: tiles.iter().map(|(relaxed, _)| relaxed.force).fold(0.0, f64::max),
        overlap: tiles[densest].0.overlap,
    };
    let shapes: Vec<Shape> = cover.shown.par_iter().map(|(tile, at)| tiles[*tile].1.at(*at)).collect();
    let (mut start, alike) = laid_out(draft, yarns, spacing_um, samples, &windows, &shapes)?;
    part(&mut start.elements, PARTED, ROUNDS);
    if !go_on(1.0) {
        return None;
    }
    Some(Large {
        start,
        alike,
        relaxed,
        counts: [draft.ends() * draft.picks(), windows.count(), all],
        densest: cover.tiles[densest].draft(draft)?,
    })
}

/// Smooth step from 0 to 1.
fn smooth_step(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// The strands of all yarns, and the numbers of what surrounds them.
fn laid_out(
    draft: &Draft,
    yarns: [&YarnOfCloth; 2],
    spacing_um: [f64; 2],
    samples: [usize; 2],
    windows: &Windows,
    shapes: &[Shape],
) -> Option<(Start, Vec<Vec<u32>>)> {
    let size = [draft.ends(), draft.picks()];
    let at = |end: usize, pick: usize| &shapes[windows.at(pick % size[1], end % size[0])];
    let mut increments = Vec::with_capacity(size[0] * size[1]);
    for pick in 0..size[1] {
        for end in 0..size[0] {
            // Both shapes know the step between them.
            let own = at(end, pick);
            let next = [at(end + 1, pick), at(end, pick + 1)];
            increments.push([0, 1].map(|k| 0.5 * (own.after[k] + next[k].before[k])));
        }
    }
    let heights = heights::heights(size, &increments);
    let surroundings = (1..=MAX_REACH).rev().map(|reach| Windows::new(draft, reach));
    let surroundings = { surroundings }.find(|windows| windows.count() <= MAX_ALIKE);
    let surroundings = surroundings.unwrap_or_else(|| Windows::new(draft, 1));
    let cell_um = [[size[0] as f64 * spacing_um[0], 0.0], [0.0, size[1] as f64 * spacing_um[1]]];
    let mut start = Start {
        elements: Elements { lattice: Lattice::new(cell_um)?, chains: vec![], sections: vec![], thickness_um: None },
        yarns: Vec::new(),
        of_chain: Vec::new(),
        twists: Vec::new(),
    };
    let mut alike = Vec::new();
    for set in 0..2 {
        // Ends run along y, picks along x.
        let axis = 1 - set;
        let (count, m) = (size[axis], samples[set]);
        for number in 0..size[set] {
            let crossing = |k: usize| {
                let mut crossing = [0; 2];
                (crossing[set], crossing[axis]) = (number, k % count);
                crossing
            };
            let mut points_um = Vec::with_capacity(count * m);
            for k in 0..count {
                let both = [crossing(k), crossing(k + 1)];
                for i in 0..m {
                    let t = (i as f64 + 0.5) / m as f64;
                    let parts = [(both[0], m + i, 1.0 - smooth_step(t)), (both[1], i, smooth_step(t))];
                    let mut p = [0.0; 3];
                    p[set] = (number as f64 + 0.5) * spacing_um[set];
                    p[axis] = (k as f64 + 0.5 + t) * spacing_um[axis];
                    for ([end, pick], sample, weight) in parts {
                        let off = at(end, pick).yarns[set][sample];
                        let height = heights[pick * size[0] + end];
                        (0..2).for_each(|k| p[k] += weight * off[k]);
                        p[2] += weight * (off[2] + height);
                    }
                    points_um.push(p);
                }
            }
            let (step, period) = if set == 0 { ([size[0] as i32, 0], [0, 1]) } else { ([0, size[1] as i32], [1, 0]) };
            let yarn = ClothYarn { kind: set as u32, number: number as i32, step, period };
            let line = |s: f64| along(&points_um, axis, cell_um[axis][axis], s);
            let first = start.elements.chains.len();
            start.add_along(yarns[set], yarn, (cell_um[axis][axis], points_um.len()), |_| [None, None], line);
            let own: Vec<u32> = (0..count)
                .map(|k| {
                    let [end, pick] = crossing(k);
                    (2 * surroundings.at(pick, end) + set) as u32
                })
                .collect();
            for chain in &start.elements.chains[first..] {
                alike.push(own.repeat(chain.points_um.len() / points_um.len()));
            }
        }
    }
    Some((start, alike))
}

/// Point of a periodic polyline at the middle of the part `s` of its period, and the unit vector across it in
/// the plane, to the left of the yarn.
fn along(points_um: &[[f64; 3]], axis: usize, period_um: f64, s: f64) -> ([f64; 3], [f64; 3]) {
    let n = points_um.len() as i64;
    let i = (s * n as f64).floor() as i64;
    let at = |i: i64| {
        let mut p = points_um[i.rem_euclid(n) as usize];
        p[axis] += i.div_euclid(n) as f64 * period_um;
        p
    };
    let (before, after) = (at(i - 1), at(i + 1));
    let d = [after[0] - before[0], after[1] - before[1]];
    let length = d[0].hypot(d[1]).max(1e-12);
    (at(i), [-d[1] / length, d[0] / length, 0.0])
}

/// The splines of the chains.
pub(super) fn curves(large: &Large) -> Vec<PlyCurve> {
    let Start { elements, of_chain, .. } = &large.start;
    let of = |((chain, yarn), alike): ((&super::relax::Chain, &u32), &Vec<u32>)| PlyCurve {
        alike: alike.clone(),
        ..PlyCurve::through(*yarn, chain.radius_um, chain.shift, &chain.points_um, &elements.lattice)
    };
    elements.chains.par_iter().zip(of_chain).zip(&large.alike).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloth::woven::woven;
    use plywave_textile::{ClothSpec, ClothWeave};

    /// Side of the draft, and radius of the figure in it, in crossings.
    const SIDE: usize = 36;
    const FIGURE: i64 = 11;

    /// A disk of weft satin in warp satin.
    fn figured() -> Draft {
        let up = |pick: usize, end: usize| {
            let center = SIDE as i64 / 2;
            let is_figure = (pick as i64 - center).pow(2) + (end as i64 - center).pow(2) < FIGURE * FIGURE;
            // Of 36 threads, satins of six ends close.
            let bound = [0, 2, 4, 1, 3, 5][end % 6] == pick % 6;
            bound == is_figure
        };
        Draft::from_fn(SIDE, SIDE, up).unwrap()
    }

    /// `[set]`: axis of each yarn by a crossing, from its straight place [um].
    fn places(elements: &Elements, spacing_um: [f64; 2], samples: [usize; 2]) -> [Vec<[f64; 3]>; 2] {
        let shapes = Shapes::new(elements, [SIDE; 2], spacing_um, samples);
        let mut all = [Vec::new(), Vec::new()];
        for pick in 0..SIDE {
            for end in 0..SIDE {
                let shape = shapes.at([end, pick]);
                let height = shapes.height([end, pick]);
                for set in 0..2 {
                    let [x, y, z] = shape.yarns[set][samples[set]];
                    all[set].push([x, y, z + height]);
                }
            }
        }
        all
    }

    /// Root mean square of differences.
    fn rms(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
        f64::sqrt(sum / count)
    }

    /// Tiles give the shapes that relaxation of the whole draft gives, apart from its smooth height.
    #[test]
    #[ignore = "slow: 45 s: a figured draft from tiles and as a whole"]
    fn tiles_are_as_the_whole() {
        let text = "name = \"x\"\n[weave]\nkind = \"plain\"\nends_per_cm = 80\npicks_per_cm = 50\n[warp]\n\
                    fiber = \"polyester bright\"\ncount = \"75/36 den\"\nbundles = 1\n[weft]\nas = \"warp\"\n";
        let spec = ClothSpec::parse(text, "x").unwrap();
        let Some(ClothWeave::Woven(_, yarns)) = spec.made() else { panic!("woven") };
        let (draft, spacing_um) = (figured(), [1e4 / 80.0, 1e4 / 50.0]);
        let samples = samples(yarns, spacing_um);
        let tiles = large(&draft, yarns, spacing_um, None, &|_| true).unwrap();
        let mut whole = woven(&draft, yarns, spacing_um).unwrap().elements;
        let relaxed = relax(&mut whole, Rest::Full, &|_| true).unwrap();
        assert!(relaxed.force <= 1e-5, "{relaxed:?}");
        let radius = yarns[0].radius_um();
        let [found, want] = [&tiles.start.elements, &whole].map(|elements| places(elements, spacing_um, samples));
        // Heights above the mean of the 5 x 5 crossings around.
        let level = |places: &[Vec<[f64; 3]>; 2], i: usize| {
            let around = (0..25).map(|k| {
                let at = |i: usize, by: usize| (i + SIDE + by - 2) % SIDE;
                let i = at(i / SIDE, k / 5) * SIDE + at(i % SIDE, k % 5);
                0.5 * (places[0][i][2] + places[1][i][2])
            });
            around.sum::<f64>() / 25.0
        };
        let all = || (0..2).flat_map(|set| (0..SIDE * SIDE).map(move |i| (set, i)));
        let off = |set: usize, i: usize, k: usize| (found[set][i][k] - want[set][i][k]) / radius;
        let lateral = rms(all().map(|(set, i)| off(set, i, set)));
        let z = rms(all().map(|(set, i)| off(set, i, 2)));
        let local = rms(all().map(|(set, i)| off(set, i, 2) - (level(&found, i) - level(&want, i)) / radius));
        println!("lateral {lateral:.3} R, z {z:.3} R, local {local:.3} R; {:?}", tiles.counts);
        println!("{:?}, overlap {:.3}", tiles.relaxed, super::super::relax::overlap(&tiles.start.elements));
        assert!(lateral < 0.05 && local < 0.05, "{lateral} {local}");
    }
}
