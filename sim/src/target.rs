//! Target of a shard's paths: one ply, or the whole yarn of P plies in the frame of its ply 0.
//!
//! *One ply.* It is rotated about z and shifted along z at random for each path.
//!
//! *The yarn* (the brute-force reference of the multi-ply model, Yu 2025, 5.3). Plies lie parallel on their
//! circle about the yarn's axis. The axis of ply 0 is the origin, at the azimuth psi about the yarn's axis.
//! Every ply is rotated and shifted at random independently, and psi is drawn for each path. For an offset h,
//! only those psi are valid at which the line x = h hits ply 0 first ([`PlyRing::is_valid`]). Since one path
//! serves every h, its weight for h is valid(psi, h)/V(h), where V(h) is the fraction of psi that is valid.
//! Psi follows the golden ratio from path to path, which together with the stratified lateral position covers
//! the rectangle (x, psi) uniformly.

use crate::incidence::Incidence;
use crate::rays::dielectric::sin_cos_turn;
use crate::rays::path::{PathEnd, trace_path_among};
use crate::rays::surface::Surfaces;
use crate::rays::tracer::{Hit, Medium, Trace, Tracer};
use nalgebra::{Vector2, Vector3};
use plywave::spec::PlyRing;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// Step of psi from path to path, in turns: the golden ratio.
pub(crate) const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Maximum number of plies of a yarn.
const MAX_PLIES: usize = 7;
/// Stride of the yarn's fiber numbers from ply to ply; a ply has fewer fibers.
const FIBERS: u32 = 1 << 16;

/// The ring of a yarn's plies with the valid psi for each h.
pub(crate) struct YarnTwin {
    ring: PlyRing,
    /// `[h]`: valid ranges of psi [rad], and their share of a turn.
    valid: Vec<(Vec<(f64, f64)>, f64)>,
}

impl YarnTwin {
    pub fn new(ring: PlyRing, h_um: &[f64]) -> YarnTwin {
        let valid = h_um
            .iter()
            .map(|&h| {
                let ranges = ring.valid_ranges(h);
                let share = ranges.iter().map(|r| r.1 - r.0).sum::<f64>() / TAU;
                (ranges, share)
            })
            .collect();
        YarnTwin { ring, valid }
    }

    /// Fills `shares[h]` with valid(psi, h)/V(h).
    fn shares(&self, psi: f64, shares: &mut [f64]) {
        for (share, (ranges, total)) in shares.iter_mut().zip(&self.valid) {
            let valid = ranges.iter().any(|r| r.0 <= psi && psi < r.1);
            *share = if valid { 1.0 / total } else { 0.0 };
        }
    }
}

/// Target of the paths.
pub(crate) enum Target<'a> {
    /// One ply.
    Ply(&'a dyn Tracer),
    /// The yarn of these plies, with one tracer each, and the start of psi in this shard [turns].
    Yarn(&'a YarnTwin, Vec<&'a dyn Tracer>, f64),
}

impl Target<'_> {
    /// Half of the width over which lateral positions are drawn [um]. It covers all rays that can hit the ply
    /// or yarn with a sideways tilt in the xy plane of up to 5 standard deviations (at most 1 rad), but it
    /// does not exceed the beams, which end `beam_sds` standard deviations beyond the last h.
    pub fn half_width(&self, at: &Incidence<'_>, beam_sds: f64) -> f64 {
        let tilt = at.sideways_rad();
        match self {
            Target::Ply(tracer) => f64::from(tracer.bound_radius_um()) / tilt.cos(),
            Target::Yarn(yarn, tracers, _) => {
                let bound = tracers.iter().map(|t| f64::from(t.bound_radius_um())).fold(0.0, f64::max);
                let last = at.h_um.iter().fold(0.0, |a: f64, h| a.max(h.abs()));
                ((2.0 * yarn.ring.circle_um + bound) / tilt.cos()).min(last + beam_sds * at.beam.sd_um())
            }
        }
    }

    /// Traces path number `i`, whose line passes through (x, 0) at the origin's height in direction `dir`, to
    /// its end. Directions and positions are in the beam's frame. The flag is true if `shares` has a weight
    /// of the path for each h; otherwise the weight is unchanged.
    pub fn walk<R: Rng>(
        &self,
        i: u64,
        x: f64,
        dir: Vector3<f32>,
        surfaces: &Surfaces,
        rng: &mut R,
        shares: &mut [f64],
    ) -> (PathEnd, bool) {
        match self {
            Target::Ply(tracer) => (walk_ply(*tracer, x as f32, dir, surfaces, rng), false),
            Target::Yarn(yarn, tracers, start) => {
                let psi = TAU * (start + GOLDEN * i as f64).fract();
                yarn.shares(psi, shares);
                if shares.iter().all(|s| *s == 0.0) {
                    return (PathEnd::Miss, true);
                }
                (walk_yarn(yarn.ring, tracers, psi, x, dir, surfaces, rng), true)
            }
        }
    }
}

/// Random direction of a ray of the beam: that of the beam's center with the divergence added.
pub(crate) fn ray<R: Rng>(at: &Incidence<'_>, rng: &mut R) -> Vector3<f32> {
    let (sin_i, cos_i) = (at.theta_i as f32).sin_cos();
    // Direction of the beam's center, and the transverse axis perpendicular to x.
    let (forward, across) = (Vector3::new(0.0, -cos_i, -sin_i), Vector3::new(0.0, -sin_i, cos_i));
    let angular_sd = at.beam.angular_sd_rad() as f32;
    let tilt: [f32; 2] = [rng.sample(StandardNormal), rng.sample(StandardNormal)];
    (forward + Vector3::x() * (tilt[0] * angular_sd) + across * (tilt[1] * angular_sd)).normalize()
}

/// Whether the ray through (x, 0) in direction `dir` at a random height hits a fiber of the ply, which is
/// rotated by `turn` [turns].
pub(crate) fn hits<R: Rng>(tracer: &dyn Tracer, x: f32, dir: Vector3<f32>, turn: f32, rng: &mut R) -> bool {
    let z = rng.random::<f32>() * tracer.period_um();
    let (sin, cos) = sin_cos_turn(turn);
    let turn = |v: Vector3<f32>| Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
    let Some(s) = entry(Vector2::new(x, 0.0), dir, tracer.bound_radius_um()) else { return false };
    let p = Vector3::new(x + s * dir.x, s * dir.y, z + s * dir.z);
    !matches!(tracer.trace(turn(p), turn(dir), Medium::Air), Trace::Escaped)
}

fn walk_ply<R: Rng>(tracer: &dyn Tracer, x: f32, dir: Vector3<f32>, surfaces: &Surfaces, rng: &mut R) -> PathEnd {
    // The ray through (x, 0, z) on the beam's waist starts at its entry into the bounding cylinder.
    let z = rng.random::<f32>() * tracer.period_um();
    let (sin, cos) = sin_cos_turn(rng.random::<f32>());
    let turn = |v: Vector3<f32>| Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
    let back = |v: Vector3<f32>| Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
    let Some(s) = entry(Vector2::new(x, 0.0), dir, tracer.bound_radius_um()) else { return PathEnd::Miss };
    let p = Vector3::new(x + s * dir.x, s * dir.y, z + s * dir.z);
    let origin = |v: Vector3<f32>| back(v) - Vector3::z() * z;
    match trace_path_among(tracer, surfaces, turn(p), turn(dir), rng) {
        PathEnd::Reflected { dir, pos, interactions } => {
            PathEnd::Reflected { dir: back(dir), pos: origin(pos), interactions }
        }
        PathEnd::High { dir, pos, length_um, interactions } => {
            PathEnd::High { dir: back(dir), pos: origin(pos), length_um, interactions }
        }
        other => other,
    }
}

fn walk_yarn<R: Rng>(
    ring: PlyRing,
    tracers: &[&dyn Tracer],
    psi: f64,
    x: f64,
    dir: Vector3<f32>,
    surfaces: &Surfaces,
    rng: &mut R,
) -> PathEnd {
    let placed = std::array::from_fn(|p| {
        let tracer = tracers[p % tracers.len()];
        let shift = rng.random::<f32>() * tracer.period_um();
        let (sin, cos) = sin_cos_turn(rng.random::<f32>());
        let center = ring.center(p as u32, psi);
        Placed { tracer, center: Vector2::new(center[0] as f32, center[1] as f32), sin, cos, shift }
    });
    let yarn = Yarn { placed, plies: ring.plies as usize };
    let (dx, dy) = (f64::from(dir.x), f64::from(dir.y));
    // Entry into the first bounding cylinder, in f64, since it lies far from the beam's waist at grazing
    // incidence.
    let first = (0..ring.plies)
        .filter_map(|p| {
            let [cx, cy] = ring.center(p, psi);
            let bound = f64::from(yarn.placed[p as usize].tracer.bound_radius_um());
            let (qx, qy) = (x - cx, -cy);
            let (a, b) = (dx * dx + dy * dy, qx * dx + qy * dy);
            let disc = b * b - a * (qx * qx + qy * qy - bound * bound);
            (disc > 0.0).then(|| (-b - disc.sqrt()) / a)
        })
        .fold(f64::INFINITY, f64::min);
    if first == f64::INFINITY {
        return PathEnd::Miss;
    }
    // The height along z does not matter: every ply has its own random shift.
    let p = Vector3::new((x + first * dx) as f32, (first * dy) as f32, 0.0);
    trace_path_among(&yarn, surfaces, p, dir, rng)
}

/// A placed ply, whose frame is rotated, translated and shifted along z.
struct Placed<'a> {
    tracer: &'a dyn Tracer,
    center: Vector2<f32>,
    sin: f32,
    cos: f32,
    shift: f32,
}

impl Placed<'_> {
    fn turn(&self, v: Vector3<f32>) -> Vector3<f32> {
        Vector3::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y, v.z)
    }

    fn trace(&self, p: usize, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        let there = Vector3::new(pos.x - self.center.x, pos.y - self.center.y, pos.z + self.shift);
        match self.tracer.trace(self.turn(there), self.turn(dir), medium) {
            Trace::Hit(hit) => {
                let n = hit.normal;
                let normal = Vector3::new(self.cos * n.x + self.sin * n.y, self.cos * n.y - self.sin * n.x, n.z);
                Trace::Hit(Hit { normal, fiber: p as u32 * FIBERS + hit.fiber, ..hit })
            }
            other => other,
        }
    }
}

/// A yarn of placed plies.
struct Yarn<'a> {
    placed: [Placed<'a>; MAX_PLIES],
    plies: usize,
}

impl Tracer for Yarn<'_> {
    fn bound_radius_um(&self) -> f32 {
        self.placed[..self.plies].iter().map(|p| p.center.norm() + p.tracer.bound_radius_um()).fold(0.0, f32::max)
    }

    fn period_um(&self) -> f32 {
        f32::INFINITY
    }

    fn is_second(&self, fiber: u32) -> bool {
        self.placed[(fiber / FIBERS) as usize].tracer.is_second(fiber % FIBERS)
    }

    fn trace(&self, pos: Vector3<f32>, dir: Vector3<f32>, medium: Medium) -> Trace {
        if let Medium::Fiber(f) | Medium::Lumen(f) = medium {
            let p = (f / FIBERS) as usize;
            let own = match medium {
                Medium::Lumen(f) => Medium::Lumen(f % FIBERS),
                _ => Medium::Fiber(f % FIBERS),
            };
            return self.placed[p].trace(p, pos, dir, own);
        }
        // Plies in the order in which the ray enters their bounding cylinders.
        let mut order = [(f32::INFINITY, 0usize); MAX_PLIES];
        let mut count = 0;
        for (p, ply) in self.placed[..self.plies].iter().enumerate() {
            let from = pos.xy() - ply.center;
            let bound = ply.tracer.bound_radius_um();
            // A ray that starts on a bounding cylinder may lie outside of it by rounding.
            let at = match entry(from, dir, bound) {
                _ if from.norm_squared() <= bound * bound => 0.0,
                Some(s) if from.dot(&dir.xy()) < 0.0 => s.max(0.0),
                _ => continue,
            };
            let mut k = count;
            while k > 0 && order[k - 1].0 > at {
                order[k] = order[k - 1];
                k -= 1;
            }
            order[k] = (at, p);
            count += 1;
        }
        let mut first: Option<Hit> = None;
        for &(at, p) in &order[..count] {
            if first.is_some_and(|hit| hit.t_um <= at) {
                break;
            }
            match self.placed[p].trace(p, pos + dir * at, dir, Medium::Air) {
                Trace::Hit(hit) => {
                    let hit = Hit { t_um: hit.t_um + at, ..hit };
                    if first.is_none_or(|known| hit.t_um < known.t_um) {
                        first = Some(hit);
                    }
                }
                Trace::Escaped => {}
                Trace::Lost => return Trace::Lost,
            }
        }
        first.map_or(Trace::Escaped, Trace::Hit)
    }
}

/// Length along a ray from `q` at which it enters the cylinder of radius `bound` about z, negative if the
/// entry lies behind `q`; `None` if the ray misses the cylinder.
fn entry(q: Vector2<f32>, dir: Vector3<f32>, bound: f32) -> Option<f32> {
    let (a, b) = (dir.x * dir.x + dir.y * dir.y, q.x * dir.x + q.y * dir.y);
    let disc = b * b - a * (q.norm_squared() - bound * bound);
    (disc > 0.0).then(|| (-b - disc.sqrt()) / a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::fiber_section::FiberSection;
    use crate::geometry::section::PlySection;
    use crate::shard::{EXIT_AZIMUTHS, EXIT_POSITIONS, TableSums, trace_paths};
    use crate::{FiberSurface, Outline, RoughDielectric, ScrewTracer};
    use plywave::ply::DRIFT_BINS;
    use plywave::spec::{GaussianBeam, ply_circle_um};
    use plywave_tables::table::OutgoingGrid;
    use plywave_tables::table::{DISPLACEMENTS, displacement};
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;
    use std::sync::atomic::AtomicBool;

    const RADIUS: f64 = 20.0;

    fn solid() -> ScrewTracer {
        let outer = Outline::Circle { radius_um: RADIUS };
        let fiber = FiberSection { center_um: Vector2::zeros(), angle_rad: 0.0, outer, lumen: None, second: false };
        ScrewTracer::new(&PlySection { fibers: vec![fiber], bound_radius_um: RADIUS, twist_per_um: 0.0 }).unwrap()
    }

    fn walls(alpha: f32) -> Surfaces {
        Surfaces::alike(FiberSurface::dielectric(RoughDielectric { eta: 1.5, alpha }))
    }

    fn incidence<'a>(theta_i: f64, h_um: &'a [f64], surfaces: &'a Surfaces, record_exits: bool) -> Incidence<'a> {
        Incidence {
            theta_i,
            h_um,
            sigma_per_um: &[0.0],
            beam: GaussianBeam { w0_um: 4.0, lambda_um: 0.55, d_cut_um: 8.0 },
            grid: OutgoingGrid { theta_o: 6, phi_o: 12 },
            surfaces,
            radius_um: RADIUS,
            record_exits,
            energies: None,
        }
    }

    fn offsets() -> Vec<f64> {
        (0..15).map(|n| 28.0 * (f64::from(n) / 7.0 - 1.0)).collect()
    }

    /// Share of the beam at `h` that hits none of the solid plies, by quadrature over the beam and the valid
    /// psi.
    fn missed(ring: PlyRing, sd: f64, h: f64) -> f64 {
        let (turns, lines) = (1200, 200);
        let (mut valid, mut sum) = (0.0, 0.0);
        for i in 0..turns {
            let psi = TAU * (f64::from(i) + 0.5) / f64::from(turns);
            if !ring.is_valid(psi, h) {
                continue;
            }
            valid += 1.0;
            for k in 0..lines {
                let t = 6.0 * (2.0 * (f64::from(k) + 0.5) / f64::from(lines) - 1.0);
                let x = h + sd * t;
                if (0..ring.plies).all(|p| (x - ring.center(p, psi)[0]).abs() > ring.radius_um) {
                    sum += (-0.5 * t * t).exp() * 12.0 / f64::from(lines) / TAU.sqrt();
                }
            }
        }
        sum / valid
    }

    /// The share of light that misses a yarn of solid plies follows from the geometry of its section alone;
    /// the beam's divergence of 0.02 rad is negligible.
    #[test]
    fn what_misses_a_yarn_of_solid_plies_is_geometry() {
        let (tracer, walls) = (solid(), walls(0.2));
        let h_um = offsets();
        let paths = 50_000;
        for plies in [2, 3, 7] {
            let ring = PlyRing { plies, radius_um: RADIUS, circle_um: ply_circle_um(plies, RADIUS, None).unwrap() };
            let twin = YarnTwin::new(ring, &h_um);
            for theta_i in [0.0, 1.0] {
                let at = incidence(theta_i, &h_um, &walls, false);
                let target = Target::Yarn(&twin, vec![&tracer; 7], 0.3);
                let mut sums = TableSums::zero(&at);
                let mut rng = Pcg64Mcg::seed_from_u64(9);
                trace_paths(&at, &target, paths, &mut rng, &mut sums, &AtomicBool::new(false), &|_| {}).unwrap();
                for (n, h) in h_um.iter().enumerate() {
                    let got = sums.missed[n] / paths as f64;
                    let want = missed(ring, at.beam.sd_um(), *h);
                    // About 4000 paths serve a beam; the weights 1/V of the valid psi raise the noise.
                    let share = twin.valid[n].1;
                    let tol = 5.0 * (want * (1.0 - want) / share / 4e3).sqrt() + 3e-3;
                    assert!(
                        (got - want).abs() < tol,
                        "{plies} plies, theta {theta_i}, h {h}: {got}, want {want}, tolerance {tol}"
                    );
                }
            }
        }
    }

    /// A reflection by a smooth cylinder preserves the signed distance of the line from the axis: light of
    /// the beam at x leaves at t = x.
    #[test]
    fn reflected_light_leaves_at_its_impact_parameter() {
        let (tracer, walls) = (solid(), walls(0.0));
        let h_um = offsets();
        let at = incidence(0.4, &h_um, &walls, true);
        let mut sums = TableSums::zero(&at);
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        let target = Target::Ply(&tracer);
        trace_paths(&at, &target, 50_000, &mut rng, &mut sums, &AtomicBool::new(false), &|_| {}).unwrap();
        let mut light = 0.0;
        for a in 0..EXIT_AZIMUTHS {
            for t in 0..EXIT_POSITIONS {
                let place = RADIUS * ((2 * t + 1) as f64 / EXIT_POSITIONS as f64 - 1.0);
                for (n, h) in h_um.iter().enumerate() {
                    let weight = sums.exit[((a * EXIT_POSITIONS + t) * h_um.len() + n) * 2];
                    light += weight;
                    // The beam's standard deviation is 2 um, a position is 2.5 um wide, and the tilt of the
                    // beam moves lines by less than 1 um.
                    let off = (place - h).abs() - 1.25 - 1.0;
                    assert!(weight == 0.0 || off < 6.5 * 2.0, "h {h}: light at {place}");
                }
            }
        }
        assert!(light > 0.0);
        let energy: f64 = sums.energy.iter().step_by(2).sum();
        assert!((light / energy - 1.0).abs() < 1e-9, "{light} recorded of {energy}");
        let (drawn, hit) = sums.hits.split_at(sums.hits.len() / 2);
        // Every line through the cylinder hits it, except tilted ones at the rim.
        assert!(drawn.iter().zip(hit).skip(1).take(62).all(|(d, m)| d == m), "{drawn:?} {hit:?}");
    }

    /// Light in a smooth cylinder runs along it by `2 cos gamma_t tan theta_t` (over R) from wall to wall, by
    /// Snell's law across (Bravais) and along the axis; every wall reflects the same share (Fresnel).
    #[test]
    fn light_of_a_smooth_cylinder_is_displaced_by_its_chords() {
        const ETA: f64 = 1.5;
        const SIGMA: f64 = 0.01;
        let (tracer, walls, theta_i, paths) = (solid(), walls(0.0), 0.6f64, 200_000);
        let at = Incidence { sigma_per_um: &[0.0, SIGMA], ..incidence(theta_i, &[0.0], &walls, true) };
        let mut sums = TableSums::zero(&at);
        let mut rng = Pcg64Mcg::seed_from_u64(9);
        let target = Target::Ply(&tracer);
        trace_paths(&at, &target, paths, &mut rng, &mut sums, &AtomicBool::new(false), &|_| {}).unwrap();
        // Light keeps its latitude.
        let bin = ((0.5 - 0.5 * theta_i.sin()) * DRIFT_BINS as f64) as usize;
        let mut got = [[0.0; 2]; 2];
        for (i, of) in sums.drift.chunks_exact(2).enumerate() {
            assert!(of[0] == 0.0 || i / DISPLACEMENTS == bin, "light in bin {}", i / DISPLACEMENTS);
            for k in 0..2 {
                got[k][0] += of[k] / paths as f64;
                got[k][1] += of[k] / paths as f64 * displacement(i % DISPLACEMENTS);
            }
        }
        let fresnel = |cos: f64| {
            let inside = (1.0 - (1.0 - cos * cos) / (ETA * ETA)).sqrt();
            let (s, p) = ((cos - ETA * inside) / (cos + ETA * inside), (ETA * cos - inside) / (ETA * cos + inside));
            0.5 * (s * s + p * p)
        };
        let (sin_t, bravais) = (theta_i.sin() / ETA, (ETA * ETA - theta_i.sin().powi(2)).sqrt() / theta_i.cos());
        let mut want = [[0.0; 2]; 2];
        let offsets = 20_000;
        for i in 0..offsets {
            let x = 2.0 * (i as f64 + 0.5) / offsets as f64 - 1.0;
            let reflected = fresnel(theta_i.cos() * (1.0 - x * x).sqrt());
            let chord = 2.0 * (1.0 - (x / bravais).powi(2)).sqrt();
            let cos_t = (1.0 - sin_t * sin_t).sqrt();
            for (k, want) in want.iter_mut().enumerate() {
                let passes = (-[0.0, SIGMA][k] * RADIUS * chord / cos_t).exp();
                let (mut light, mut chords) = ((1.0 - reflected).powi(2) * passes, 1.0);
                while light > 1e-9 {
                    want[0] += light / offsets as f64;
                    want[1] -= light / offsets as f64 * chords * chord * sin_t / cos_t;
                    light *= reflected * passes;
                    chords += 1.0;
                }
            }
        }
        for (got, want) in got.iter().zip(want) {
            assert!((got[0] / want[0] - 1.0).abs() < 0.01, "light {got:?}, want {want:?}");
            assert!((got[1] / want[1] - 1.0).abs() < 0.02, "displacement {got:?}, want {want:?}");
        }
    }
}
