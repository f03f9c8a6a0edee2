//! The traced domain: number of repeats, and pitches that close over them.
//!
//! Rays that leave the domain at one side re-enter at the other, so plies and fibers must make whole turns
//! over its length, and their pitches change a little. The domain has the fewest repeats that keep every
//! change under 10 % and give four yarns per family. If these have too many fibers for the memory, larger
//! changes are allowed. If nothing fits, the domain is that of the least change, and is refused later.

use super::cloth::TwinCloth;
use super::options::TwinMesh;
use super::strand::{Helix, Strand, Winding};
use plywave::fabric::YarnSet;
use plywave::spec::Shape;
use std::f64::consts::TAU;

/// Largest number of quads: they stay below 6 GiB, most of it only while a family's BVH is built.
pub(super) const MAX_QUADS: f64 = 2.8e7;
/// Largest change of a pitch, and larger ones that are allowed if memory is short.
const MAX_CHANGE: [f64; 5] = [0.1, 0.15, 0.2, 0.3, 0.5];
/// Largest number of repeats along a side that is tried.
const MAX_REPEATS: u32 = 24;
/// Least number of yarns per family: each has its own packed sections.
const MIN_YARNS: u32 = 4;

/// A pitch of the spec and its traced value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PitchUsed {
    /// Yarn set of the yarns.
    pub family: YarnSet,
    /// Whether it is the pitch of the plies, else that of the fibers.
    pub of_plies: bool,
    /// As in the spec [um].
    pub spec_um: f64,
    /// As traced [um]; infinite for no turn at all.
    pub used_um: f64,
}

impl PitchUsed {
    /// Relative change of the turns per length.
    fn change(&self) -> f64 {
        (self.spec_um / self.used_um - 1.0).abs()
    }
}

/// The part of the cloth that is traced.
#[derive(Clone, Debug, PartialEq)]
pub struct Domain {
    /// Repeats along x and y.
    pub repeats: [u32; 2],
    /// Size along x and y [um].
    pub size_um: [f64; 2],
    /// Yarns of warp and weft.
    pub yarns: [u32; 2],
    /// Pitches in the spec.
    pub pitches: Vec<PitchUsed>,
}

impl Domain {
    /// The domain of a cloth, with these repeats along x and y or as many as needed.
    pub fn new(cloth: &TwinCloth, repeats: Option<[u32; 2]>, mesh: &TwinMesh) -> Domain {
        let threads = YarnSet::EACH.map(|family| cloth.fabric.draft().threads(family) as u32);
        let repeat = cloth.fabric.repeat_um();
        // Along x lies the weft, and ends are counted; along y the warp.
        let enough = threads.map(|n| MIN_YARNS.div_ceil(n.max(1)));
        let of = |repeats: [u32; 2]| Domain {
            repeats,
            size_um: [0, 1].map(|k| repeat[k] * f64::from(repeats[k])),
            yarns: [threads[0] * repeats[0], threads[1] * repeats[1]],
            pitches: Vec::new(),
        };
        let least = |change: f64| {
            of([
                least_repeats(cloth, YarnSet::Weft, repeat[0], enough[0], change),
                least_repeats(cloth, YarnSet::Warp, repeat[1], enough[1], change),
            ])
        };
        let mut domain = match repeats {
            Some(given) => of(given.map(|n| n.max(1))),
            None => {
                let fits = |domain: &Domain| estimate(cloth, domain, mesh) <= MAX_QUADS;
                MAX_CHANGE.map(least).into_iter().find(fits).unwrap_or_else(|| least(MAX_CHANGE[0]))
            }
        };
        let [x, y] = domain.size_um;
        domain.pitches = [pitches(cloth, YarnSet::Warp, y), pitches(cloth, YarnSet::Weft, x)].concat();
        domain
    }

    /// Length of the domain along the yarns of a family [um].
    pub fn along_um(&self, family: YarnSet) -> f64 {
        match family {
            YarnSet::Warp => self.size_um[1],
            YarnSet::Weft => self.size_um[0],
        }
    }
}

fn least_repeats(cloth: &TwinCloth, family: YarnSet, repeat_um: f64, least: u32, allowed: f64) -> u32 {
    let change =
        |n: u32| pitches(cloth, family, repeat_um * f64::from(n)).iter().map(PitchUsed::change).fold(0.0, f64::max);
    let most = MAX_REPEATS.max(least);
    (least..=most)
        .find(|n| change(*n) <= allowed)
        .unwrap_or_else(|| (least..=most).min_by(|a, b| change(*a).total_cmp(&change(*b))).unwrap_or(least))
}

/// Pitches of a family's plies and fibers over a length.
fn pitches(cloth: &TwinCloth, family: YarnSet, length_um: f64) -> Vec<PitchUsed> {
    let mut all: Vec<PitchUsed> = Vec::new();
    let strand = Strand::new(&cloth.fabric, family, 0, length_um);
    let helix = Helix::new(cloth.fabric.shape(family), length_um);
    if let Some(spec_um) = helix.spec_pitch_um {
        all.push(PitchUsed { family, of_plies: true, spec_um, used_um: helix.pitch_um() });
    }
    let mut known: Vec<f64> = Vec::new();
    for &spec in &cloth.threads[family as usize] {
        let Some(spec_um) = cloth.yarns[spec].ply.fiber_pitch_um.filter(|pitch| !known.contains(pitch)) else {
            continue;
        };
        known.push(spec_um);
        let winding = Winding::new(&strand, &helix, TAU / spec_um);
        all.push(PitchUsed { family, of_plies: false, spec_um, used_um: winding.pitch_um() });
    }
    all
}

/// A ply of a yarn.
#[derive(Clone, Copy)]
pub(super) struct PlyOf {
    pub family: YarnSet,
    pub yarn: u32,
    pub ply: u32,
    pub spec: usize,
}

/// The plies of a domain.
pub(super) fn plies_of(cloth: &TwinCloth, domain: &Domain) -> Vec<PlyOf> {
    let mut plies = Vec::new();
    for family in YarnSet::EACH {
        for yarn in 0..domain.yarns[family as usize] {
            let spec = cloth.spec_index(family, yarn as usize);
            plies.extend((0..cloth.fabric.shape(family).plies).map(|ply| PlyOf { family, yarn, ply, spec }));
        }
    }
    plies
}

/// Estimate of the number of quads of a domain, before its sections are packed.
pub(super) fn estimate(cloth: &TwinCloth, domain: &Domain, options: &TwinMesh) -> f64 {
    plies_of(cloth, domain).into_iter().map(|ply| estimate_ply(cloth, domain, options, ply)).sum()
}

fn estimate_ply(cloth: &TwinCloth, domain: &Domain, options: &TwinMesh, ply: PlyOf) -> f64 {
    let spec = &cloth.yarns[ply.spec];
    let length = domain.along_um(ply.family);
    let turn = spec.ply.twist_per_um().abs() + 0.005;
    let rings = length * (turn / options.turn_rad.max(1e-3)).max(1.0 / options.step_um.max(0.1));
    // The costlier kind of a blend counts for all: it is an estimate.
    let shape = spec.fibers().map(|fiber| outline_share(&fiber.shape)).fold(0.0, f64::max);
    let points = f64::from(options.outline_points) * shape;
    rings * points * f64::from(spec.ply.fibers)
}

/// Estimate of the points of an outline, relative to those of a circle.
pub(super) fn outline_share(shape: &Shape) -> f64 {
    match *shape {
        Shape::Circle { .. } | Shape::Ellipse { .. } | Shape::RoundedTriangle { .. } | Shape::Stone { .. } => 1.0,
        Shape::HollowCircle { lumen, .. } => 1.0 + lumen,
        Shape::Kidney { lumen, .. } => 1.3 + if lumen > 0.0 { 0.9 } else { 0.0 },
        Shape::Trilobal { .. } | Shape::Polygon { .. } => 2.0,
        Shape::Serrated { .. } => 4.0,
    }
}
