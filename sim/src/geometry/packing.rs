//! Hard-particle Monte Carlo packing of fiber outlines in a circular or elliptical ply.
//!
//! The fibers start apart in a ply that is too large. Random moves and turns are accepted only if they keep
//! every gap. After each sweep the arrangement is compressed as far as the gaps allow, until all fibers lie
//! within the ply. Further sweeps at that size randomize the arrangement at the target radial density
//! (`radial.rs`); without a target, hard particles at equilibrium fill their container uniformly and line its
//! wall. Two fibers never overlap. (Yu 2025, 4.1, only says that cross sections are "generated and
//! clustered".)
//!
//! Outlines other than circles are tested through a grid of exact signed distances in the fiber's frame, and
//! the measured error of the grid is added to the gap. The packed section is then checked with the exact
//! outlines.

use crate::error::SimError;
use crate::geometry::fiber_section::FiberSection;
use crate::geometry::outline::{Outline, Runs};
use crate::geometry::radial::{MIN_FIBERS, Radial};
use nalgebra::{Rotation2, Vector2};
use plywave::math::axis;
use plywave::spec::{Packing, YarnSpec};
use rand::{Rng, RngExt};
use std::f64::consts::{PI, TAU};

/// Maximum number of starts; a start often succeeds after the previous one has jammed.
const STARTS: usize = 4;
/// Scale of a jam beyond which another start does not help: starts differ by about 0.01.
const HOPELESS: f64 = 1.03;
/// Number of fibers below which more starts are tried, none of which counts as hopeless: few fibers jam in
/// very different arrangements (five discs in a ring, or four about the fifth).
const FEW: usize = 12;
const STARTS_OF_FEW: usize = 60;
/// Maximum number of compression sweeps per start.
const MAX_SWEEPS: usize = 6000;
/// Compression stops when this many sweeps shrink the ply by less than [`STALL`].
const STALL_SWEEPS: usize = 400;
/// Relative shrinkage below which compression counts as jammed.
const STALL: f64 = 1e-3;
/// Number of sweeps at the final size; with steps near a third of a gap, tens of sweeps carry a fiber past
/// its neighbors.
const MIX_SWEEPS: usize = 150;
/// Number of sweeps at the final size with a target radial density; two thirds of them approach it.
const RADIAL_SWEEPS: usize = 600;
/// Filled fraction of the densest packing of equal discs in the plane; above it no start is tried.
const HEXAGONAL: f64 = 0.9069;
/// Number of cells across the grid of signed distances.
const CELLS: usize = 72;
/// Maximum number of outline points tested per pair.
const PROBES: usize = 96;

/// Places and rotates `fibers` within the ply.
pub(crate) fn pack<R: Rng>(fibers: &mut [FiberSection], spec: &YarnSpec, rng: &mut R) -> Result<(), SimError> {
    let ply = &spec.ply;
    let radii = ply.radii_um.unwrap_or([ply.radius_um.unwrap_or(0.0); 2]);
    let gap = ply.min_gap_um;
    let area: f64 = fibers.iter().map(|f| f.outer.area()).sum();
    let with_gap: f64 =
        fibers.iter().map(|f| f.outer.area() + 0.5 * gap * f.outer.perimeter() + 0.25 * PI * gap * gap).sum();
    let container = PI * (radii[0] + 0.5 * gap) * (radii[1] + 0.5 * gap);
    let mut reached = f64::INFINITY;
    // A monofilament is the whole ply: its axis is that of the ply.
    if let [only] = fibers
        && with_gap / container > HEXAGONAL
        && extent(&FiberSection { center_um: Vector2::zeros(), ..only.clone() }, radii) <= 1.0
    {
        only.center_um = Vector2::zeros();
        return Ok(());
    }
    if with_gap / container <= HEXAGONAL {
        let bodies: Vec<Body> = fibers.iter().map(|f| Body::new(&f.outer, gap)).collect();
        let areas = fibers.iter().map(|f| f.outer.area()).collect();
        let turns: Vec<Option<f64>> = fibers
            .iter()
            .map(|f| spec.blend.as_ref().filter(|_| f.second).map_or(&spec.fiber, |b| &b.fiber).angle_jitter_rad)
            .collect();
        let mut state = State::new(bodies, areas, radii, gap, turns);
        let is_few = fibers.len() < FEW;
        for _ in 0..if is_few { STARTS_OF_FEW } else { STARTS } {
            let angles = fibers.iter().map(|f| f.angle_rad);
            if !state.start(angles, rng) {
                continue;
            }
            let scale = state.compress(rng);
            if scale <= 1.0 {
                state.mix(ply.packing, rng);
                for (f, pose) in fibers.iter_mut().zip(&state.poses) {
                    (f.center_um, f.angle_rad) = (pose.center, pose.angle.rem_euclid(TAU));
                }
                if holds(fibers, radii, gap) {
                    return Ok(());
                }
                // The measured error of the grid was too small somewhere: widen it and start again.
                state.bodies.iter_mut().for_each(Body::widen);
            } else {
                reached = reached.min(scale);
                if scale > HOPELESS && !is_few {
                    break;
                }
            }
        }
    }
    // If no start was tried: random compression jams near 0.8 for discs, earlier for other outlines.
    let min_scale = if reached.is_finite() { reached } else { (with_gap / container / 0.75).sqrt() };
    Err(SimError::CannotPack {
        key: if ply.radii_um.is_some() { "ply.radii_um" } else { "ply.radius_um" },
        fibers: fibers.len(),
        radius_um: radii[0],
        packing_fraction: area / (PI * radii[0] * radii[1]),
        least_radius_um: (1.02 * min_scale.max(1.0) * radii[0] * 10.0).ceil() / 10.0,
    })
}

/// Whether all gaps are respected and all fibers lie within the ply, by the exact outlines.
pub(crate) fn holds(fibers: &[FiberSection], radii: [f64; 2], gap: f64) -> bool {
    let apart = fibers.iter().enumerate().all(|(i, a)| {
        fibers[i + 1..].iter().all(|b| {
            let bounds = a.outer.bounding_radius() + b.outer.bounding_radius();
            (a.center_um - b.center_um).norm() - bounds >= gap || a.min_distance(b) >= gap
        })
    });
    apart && fibers.iter().all(|f| extent(f, radii) <= 1.0)
}

/// Minimum scale of the ply at which it contains the fiber.
pub(crate) fn extent(fiber: &FiberSection, radii: [f64; 2]) -> f64 {
    let pose = Pose { center: fiber.center_um, angle: fiber.angle_rad };
    match &fiber.outer {
        Outline::Circle { radius_um } => disc_extent(pose.center, *radius_um, radii),
        Outline::Polyline(points) => points_extent(&pose, points, 0.0, radii),
    }
}

fn disc_extent(center: Vector2<f64>, radius: f64, radii: [f64; 2]) -> f64 {
    if radii[0] == radii[1] {
        return (center.norm() + radius) / radii[0];
    }
    // The extent of a circumscribed polygon is at least that of the disc and at most 0.1 % larger.
    const SIDES: usize = 64;
    let reach = radius / (PI / SIDES as f64).cos();
    let corner = |i: usize| {
        let (s, c) = (TAU * i as f64 / SIDES as f64).sin_cos();
        ((center.x + reach * c) / radii[0]).hypot((center.y + reach * s) / radii[1])
    };
    (0..SIDES).map(corner).fold(0.0, f64::max)
}

fn points_extent(pose: &Pose, points: &[Vector2<f64>], margin: f64, radii: [f64; 2]) -> f64 {
    let turn = Rotation2::new(pose.angle);
    let max2 = points.iter().fold(0.0_f64, |max, p| {
        let q = pose.center + turn * p;
        max.max((q.x / radii[0]).powi(2) + (q.y / radii[1]).powi(2))
    });
    max2.sqrt() + margin / radii[0].min(radii[1])
}

/// Position and rotation of a fiber.
#[derive(Clone, Copy, Debug)]
struct Pose {
    center: Vector2<f64>,
    angle: f64,
}

/// One outline, prepared for fast tests.
struct Body {
    /// Circle about the center that contains the outline.
    bound: f64,
    /// Circle about the center within the outline.
    core: f64,
    form: Form,
}

enum Form {
    Disc,
    Grid {
        probes: Vec<Vector2<f64>>,
        grid: DistanceGrid,
        /// Bound of the error by which the probes and the grid overestimate a distance.
        margin: f64,
    },
}

impl Body {
    fn new(outline: &Outline, gap: f64) -> Body {
        let bound = outline.bounding_radius();
        match outline {
            Outline::Circle { .. } => Body { bound, core: bound, form: Form::Disc },
            Outline::Polyline(points) => {
                let stride = points.len().div_ceil(PROBES);
                let probes: Vec<_> = points.iter().copied().step_by(stride).collect();
                let grid = DistanceGrid::new(outline, points, bound, gap);
                // Distance by which the outline bulges past the polygon of the probes.
                let coarse = Outline::Polyline(probes.clone());
                let bulge = points.iter().map(|&p| coarse.signed_distance(p)).fold(0.0, f64::max);
                let runs = Runs::new(points);
                let mut excess: f64 = 0.0;
                for p in outline.points(points.len()) {
                    for out in [0.25, 0.75, 1.25].map(|part| part * gap.max(0.05)) {
                        let q = p.position_um + p.normal * out;
                        let distance = runs.distance(q, 1.01 * out);
                        // Deep in a dent the normal may lead into the opposite wall.
                        let exact = if distance < 0.9 * out && outline.contains(q) { -distance } else { distance };
                        excess = excess.max(grid.at(q) - exact);
                    }
                }
                let core = outline.signed_distance(Vector2::zeros()).min(0.0).abs();
                Body { bound, core, form: Form::Grid { probes, grid, margin: bulge + 1.1 * excess + 1e-6 } }
            }
        }
    }

    fn widen(&mut self) {
        if let Form::Grid { margin, .. } = &mut self.form {
            *margin = 2.0 * *margin + 0.01;
        }
    }

    fn extent(&self, pose: &Pose, radii: [f64; 2]) -> f64 {
        match &self.form {
            Form::Disc => disc_extent(pose.center, self.bound, radii),
            Form::Grid { probes, margin, .. } => points_extent(pose, probes, *margin, radii),
        }
    }
}

/// Whether the distance of two placed bodies is at least the gap.
fn apart(a: &Body, at: &Pose, b: &Body, bt: &Pose, gap: f64) -> bool {
    let between = (bt.center - at.center).norm();
    if between >= a.bound + b.bound + gap {
        return true;
    }
    if between < a.core + b.core + gap {
        return false;
    }
    clear(a, at, b, bt, gap) && clear(b, bt, a, at, gap)
}

/// Whether the outline of `b` has at least the gap from that of `a`, by the distance grid of `a`.
fn clear(a: &Body, at: &Pose, b: &Body, bt: &Pose, gap: f64) -> bool {
    let Form::Grid { grid, margin, .. } = &a.form else {
        return !matches!(b.form, Form::Disc) || (bt.center - at.center).norm() >= a.bound + b.bound + gap;
    };
    let origin = Rotation2::new(-at.angle) * (bt.center - at.center);
    match &b.form {
        Form::Disc => grid.at(origin) >= b.bound + gap + margin,
        Form::Grid { probes, margin: other, .. } => {
            let required = gap + margin.max(*other);
            let far2 = (a.bound + required).powi(2);
            let turn = Rotation2::new(bt.angle - at.angle);
            probes.iter().all(|p| {
                let q = origin + turn * p;
                q.norm_squared() >= far2 || grid.at(q) >= required
            })
        }
    }
}

/// Exact signed distances at the nodes of a square grid, with bilinear interpolation.
struct DistanceGrid {
    values: Vec<f64>,
    half: f64,
    per_um: f64,
}

impl DistanceGrid {
    fn new(outline: &Outline, points: &[Vector2<f64>], bound: f64, gap: f64) -> DistanceGrid {
        let half = 1.05 * bound + 2.0 * gap;
        let per_um = CELLS as f64 / (2.0 * half);
        let node = |i: usize| i as f64 / per_um - half;
        let runs = Runs::new(points);
        let mut values: Vec<f64> = Vec::with_capacity((CELLS + 1) * (CELLS + 1));
        for j in 0..=CELLS {
            for i in 0..=CELLS {
                let p = Vector2::new(node(i), node(j));
                // The neighbor's distance differs by one spacing at most, and no wall lies between if it is
                // larger than that.
                let last = if i > 0 { values.last().copied() } else { None };
                let distance = runs.distance(p, last.map_or(f64::INFINITY, |d| d.abs() + 1.001 / per_um));
                let inside = last.filter(|d| d.abs() > 1.001 / per_um).map_or_else(|| outline.contains(p), |d| d < 0.0);
                values.push(if inside { -distance } else { distance });
            }
        }
        DistanceGrid { values, half, per_um }
    }

    /// Distance at `p`; outside the grid, the distance at the nearest point of its border, a lower bound.
    fn at(&self, p: Vector2<f64>) -> f64 {
        let cell = |x: f64| axis::cell((x + self.half) * self.per_um, CELLS + 1);
        let ((i, s), (j, t)) = (cell(p.x), cell(p.y));
        let row = |j: usize| {
            let k = j * (CELLS + 1) + i;
            self.values[k] * (1.0 - s) + self.values[k + 1] * s
        };
        row(j) * (1.0 - t) + row(j + 1) * t
    }
}

/// The running arrangement.
struct State {
    bodies: Vec<Body>,
    poses: Vec<Pose>,
    radii: [f64; 2],
    gap: f64,
    /// Standard deviation of each fiber's rotation [rad].
    angle_sd: Vec<Option<f64>>,
    /// Maximum move per axis [um], tuned to accept about 40 %.
    step: f64,
    /// Areas of the fibers [um^2].
    areas: Vec<f64>,
    radial: Option<Radial>,
}

impl State {
    fn new(bodies: Vec<Body>, areas: Vec<f64>, radii: [f64; 2], gap: f64, angle_sd: Vec<Option<f64>>) -> State {
        State { bodies, poses: Vec::new(), radii, gap, angle_sd, step: 1.0, areas, radial: None }
    }

    /// Randomizes the arrangement by sweeps at the final size.
    fn mix<R: Rng>(&mut self, packing: Packing, rng: &mut R) {
        if packing == Packing::Lined || self.bodies.len() < MIN_FIBERS {
            (0..MIX_SWEEPS).for_each(|_| self.sweep(1.0, rng));
            return;
        }
        let discs = self.bodies.iter().all(|b| matches!(b.form, Form::Disc));
        let mut radial = Radial::new(&self.areas, self.radii, discs);
        for sweep in 0..RADIAL_SWEEPS {
            radial.count(self.poses.iter().map(|p| p.center), 1.5 * sweep as f64 / RADIAL_SWEEPS as f64);
            self.radial = Some(radial);
            self.sweep(1.0, rng);
            match self.radial.take() {
                Some(back) => radial = back,
                None => return,
            }
        }
    }

    /// Places the fibers at random in a ply wide enough for their bounding circles; false if that fails.
    fn start<R: Rng>(&mut self, angles: impl Iterator<Item = f64>, rng: &mut R) -> bool {
        let n = self.bodies.len();
        let widest = self.bodies.iter().map(|b| b.bound).fold(0.0, f64::max);
        let discs: f64 = self.bodies.iter().map(|b| (b.bound + 0.5 * self.gap).powi(2)).sum();
        let [a, b] = self.radii;
        // Random insertion of discs saturates at a fraction of 0.547; up to 0.3 it is fast.
        let mut scale = (discs / (a * b) / 0.3).sqrt().max(1.1 * widest / a.min(b)).max(1.0);
        let angles: Vec<f64> = angles.collect();
        'grow: for _ in 0..60 {
            self.poses.clear();
            for i in 0..n {
                let placed = (0..500).any(|_| {
                    let radius = scale * rng.random::<f64>().sqrt();
                    let (s, c) = (TAU * rng.random::<f64>()).sin_cos();
                    let pose = Pose { center: Vector2::new(a * radius * c, b * radius * s), angle: angles[i] };
                    let free = (0..i).all(|j| {
                        let bounds = self.bodies[i].bound + self.bodies[j].bound + self.gap;
                        (pose.center - self.poses[j].center).norm() >= bounds
                    });
                    let ok = free && self.bodies[i].extent(&pose, self.radii) <= scale;
                    if ok {
                        self.poses.push(pose);
                    }
                    ok
                });
                if !placed {
                    scale *= 1.15;
                    continue 'grow;
                }
            }
            self.step = 0.3 * widest;
            return true;
        }
        false
    }

    /// Minimum scale of the ply that contains all fibers.
    fn scale(&self) -> f64 {
        self.bodies.iter().zip(&self.poses).map(|(b, p)| b.extent(p, self.radii)).fold(0.0, f64::max)
    }

    /// Shrinks the arrangement until it fits the ply or jams. Returns the final scale, which is at most 1 if
    /// it fits.
    fn compress<R: Rng>(&mut self, rng: &mut R) -> f64 {
        let mut shrink = 0.05;
        let mut scale = self.scale();
        let mut mark = (0, scale);
        for sweep in 0..MAX_SWEEPS {
            if scale <= 1.0 {
                break;
            }
            if sweep - mark.0 >= STALL_SWEEPS {
                if scale > mark.1 * (1.0 - STALL) {
                    break;
                }
                mark = (sweep, scale);
            }
            self.sweep(scale, rng);
            if self.squeeze(1.0 - shrink) {
                shrink = (1.5 * shrink).min(0.1);
            } else {
                shrink = (0.5 * shrink).max(1e-6);
            }
            scale = self.scale();
        }
        scale
    }

    /// Moves all centers towards the axis by `factor`, unless this would violate a gap.
    fn squeeze(&mut self, factor: f64) -> bool {
        let closer: Vec<Pose> = self.poses.iter().map(|p| Pose { center: p.center * factor, ..*p }).collect();
        let free = (0..closer.len())
            .all(|i| (0..i).all(|j| apart(&self.bodies[i], &closer[i], &self.bodies[j], &closer[j], self.gap)));
        if free {
            self.poses = closer;
        }
        free
    }

    /// One trial move and rotation per fiber within the ply of the given scale.
    fn sweep<R: Rng>(&mut self, scale: f64, rng: &mut R) {
        let n = self.bodies.len();
        let mut accepted = 0;
        for i in 0..n {
            let (body, old) = (&self.bodies[i], self.poses[i]);
            let mut step = || self.step * (2.0 * rng.random::<f64>() - 1.0);
            let center = old.center + Vector2::new(step(), step());
            let turn = 2.0 * step() / body.bound;
            let angle = match (&body.form, self.angle_sd[i]) {
                (Form::Disc, _) => old.angle,
                (_, None) => old.angle + turn,
                // The Metropolis rule preserves the normal distribution of the rotations.
                (_, Some(sd)) => {
                    let new = old.angle + turn;
                    let gain = (old.angle.powi(2) - new.powi(2)) / (2.0 * sd * sd).max(f64::MIN_POSITIVE);
                    if rng.random::<f64>() < gain.exp() { new } else { old.angle }
                }
            };
            let pose = Pose { center, angle };
            let (gain, part) = self.radial.as_ref().map_or((0.0, None), |r| {
                let (gain, part) = r.gain(i, center);
                (gain, Some(part))
            });
            let free = (gain <= 0.0 || rng.random::<f64>() < (-gain).exp())
                && body.extent(&pose, self.radii) <= scale
                && (0..n).all(|j| j == i || apart(body, &pose, &self.bodies[j], &self.poses[j], self.gap));
            if free {
                self.poses[i] = pose;
                if let (Some(radial), Some(part)) = (&mut self.radial, part) {
                    radial.set(i, part);
                }
                accepted += 1;
            }
        }
        let widest = 0.5 * (self.radii[0] + self.radii[1]) * scale;
        let tune = if 5 * accepted > 2 * n { 1.05 } else { 0.95 };
        self.step = (self.step * tune).clamp(1e-4 * widest, widest);
    }
}
