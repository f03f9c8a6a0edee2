//! Yarns of a cloth: what a label says, and what follows from it.

pub(crate) mod count;
pub(crate) mod fibers;
pub(crate) mod finish;
pub(crate) mod hairs;
pub(crate) mod keys;
pub(crate) mod old;
pub(crate) mod ply;
pub(crate) mod resolve;
pub(crate) mod stripe;
pub(crate) mod stripes;
pub(crate) mod tartan;
pub(crate) mod twist;

use crate::yarn::count::{Count, fiber_area_um2, round_radius_um};
use crate::yarn::fibers::Fiber;
use crate::yarn::hairs::Hairs;
use crate::yarn::stripe::Stripe;
use plywave::cloth::{Slits, Unevenness, YarnColor, YarnLook};
use plywave::spec::{Handedness, Twist};
use std::f64::consts::PI;

/// A yarn of the cloth: a single, plies twisted together, or a single of bundles that can move past each
/// other, so that its section flattens. Plies and bundles are its strands, each round and shaded by a model.
#[derive(Clone, Debug, PartialEq)]
pub struct YarnOfCloth {
    /// Path of the model of a strand, relative to the spec, or its name in a library; `None` for a model that
    /// is found or built by [`YarnOfCloth::ply`].
    pub model: Option<String>,
    /// The fibers.
    pub fiber: Fiber,
    /// Linear density of a single, with the number of singles.
    pub count: Count,
    /// Number of singles that are twisted together.
    pub plies: u32,
    /// Number of round bundles. More than one stand for the whole yarn: the singles of a plied yarn merge.
    pub bundles: u32,
    /// Number of fibers in a strand.
    pub fibers: u32,
    /// Share of a strand's round cross section that fibers fill.
    pub packing: f64,
    /// Twist of the fibers in a strand: direction, turns per meter.
    pub fiber_twist: (Handedness, f64),
    /// Twist of the strands about each other: direction, turns per meter; 0 for a single strand.
    pub strand_twist: (Handedness, f64),
    /// Tension in the cloth, relative to that of the other yarns; the yarn under more tension bends less.
    pub tension: f64,
    /// Length of the yarn over that of the cloth, minus 1 [percent]; it replaces the tension.
    pub crimp_percent: Option<f64>,
    /// Bending stiffness of a strand, divided by its tension and the square of its radius.
    pub stiffness: f64,
    /// Cohesion of the strands of a yarn, apart from twist: force per length that pulls a strand at the rim
    /// inwards, divided by its tension over the yarn's radius.
    pub cohesion: f64,
    /// Variation along and across the yarns; `None` for even yarns.
    pub unevenness: Option<Unevenness>,
    /// Color of all yarns.
    pub color: YarnColor,
    /// Colors of consecutive yarns, repeated periodically; they replace the color. Empty for one color.
    pub stripes: Vec<Stripe>,
    /// Slits between the fibers (Yu 2025, 7.3).
    pub slits: Option<Slits>,
    /// Ends and loops of fibers that stand out of the yarn.
    pub hairs: Option<Hairs>,
    /// What was derived, for reports.
    pub derived: Vec<Derived>,
}

/// A value that the spec leaves open.
#[derive(Clone, Debug, PartialEq)]
pub struct Derived {
    /// Key that would set it.
    pub key: &'static str,
    /// The value, with its unit.
    pub value: String,
    /// What it follows from.
    pub from: String,
}

impl YarnOfCloth {
    /// Colors of the yarns by number, repeated periodically; empty if all yarns have one color.
    pub fn colors(&self) -> Vec<[f32; 3]> {
        self.stripes.iter().flat_map(|s| std::iter::repeat_n(s.color.map(|v| v as f32), s.count)).collect()
    }

    /// What shading needs of the yarn beyond curves and plies; `name` is the name of its kind.
    pub fn look(&self, name: &str) -> YarnLook {
        let stripes: Vec<YarnColor> = self.colors().into_iter().map(YarnColor::Srgb).collect();
        let colors = if stripes.is_empty() { vec![self.color] } else { stripes };
        YarnLook { name: name.into(), colors, slits: self.slits, unevenness: self.unevenness }
    }

    /// Linear density of the whole yarn [tex, g/km].
    pub fn tex(&self) -> f64 {
        self.count.single_tex * f64::from(self.plies)
    }

    /// Number of strands: bundles if there are several, else plies.
    pub fn strands(&self) -> usize {
        if self.bundles > 1 { self.bundles as usize } else { self.plies as usize }
    }

    /// Linear density of one strand [tex, g/km].
    pub fn strand_tex(&self) -> f64 {
        self.tex() / self.strands() as f64
    }

    /// Radius of a strand [um], from count, density and packing.
    pub fn strand_radius_um(&self) -> f64 {
        round_radius_um(fiber_area_um2(self.strand_tex(), self.fiber.density_g_per_cm3), self.packing)
    }

    /// Twist of the strands about the yarn's axis.
    pub fn twist(&self) -> Twist {
        let (hand, turns) = self.strand_twist;
        Twist::from_turns_per_m(turns, hand)
    }

    /// Positions of the strands in the cross section of the round yarn: offsets from its axis in units of the
    /// strand's radius.
    pub fn section(&self) -> Vec<[f64; 2]> {
        section(self.plies, self.bundles)
    }

    /// Order of the rotational symmetry of the cross section: after 1 over this of a turn it is unchanged.
    pub fn symmetry(&self) -> u32 {
        match (self.bundles, self.plies) {
            (1, plies) => plies,
            (3, _) => 3,
            (7 | 19, _) => 6,
            _ => 1,
        }
    }

    /// Radius of the round yarn [um].
    pub fn radius_um(&self) -> f64 {
        self.strand_radius_um() * reach(self.plies, self.bundles)
    }
}

/// Radius of a round yarn over that of its strands.
pub(crate) fn reach(plies: u32, bundles: u32) -> f64 {
    1.0 + section(plies, bundles).iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max)
}

/// Positions of the strands of a yarn in units of their radius.
fn section(plies: u32, bundles: u32) -> Vec<[f64; 2]> {
    if bundles > 1 {
        return hexagonal(bundles as usize);
    }
    let count = plies as usize;
    if count == 1 {
        return vec![[0.0; 2]];
    }
    let circle = 1.0 / (PI / count as f64).sin();
    (0..count)
        .map(|k| {
            let (sin, cos) = (2.0 * PI * k as f64 / count as f64).sin_cos();
            [circle * cos, circle * sin]
        })
        .collect()
}

/// The sites of a hexagonal packing of circles of radius 1 that are nearest to its center: 3 circles about a
/// hole, 7 and 19 about a circle, other numbers about their own mean.
fn hexagonal(count: usize) -> Vec<[f64; 2]> {
    let center = if count == 3 { [1.0, 1.0 / 3f64.sqrt()] } else { [0.0; 2] };
    let mut all: Vec<[f64; 2]> = (-6i32..=6)
        .flat_map(|i| (-6i32..=6).map(move |j| [2.0 * (f64::from(i) + 0.5 * f64::from(j)), 3f64.sqrt() * f64::from(j)]))
        .map(|p| [p[0] - center[0], p[1] - center[1]])
        .collect();
    // Sites are sorted by ring, and by angle within a ring.
    let order = |p: &[f64; 2]| ((p[0].hypot(p[1]) * 1e6).round(), p[1].atan2(p[0]));
    all.sort_by(|a, b| order(a).partial_cmp(&order(b)).unwrap_or(std::cmp::Ordering::Equal));
    all.truncate(count);
    let mean = [0, 1].map(|k| all.iter().map(|p| p[k]).sum::<f64>() / count as f64);
    all.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]).collect()
}
