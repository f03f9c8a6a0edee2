//! What a ply's neighbors leave of its light: the table of shadows (`shadow.rs`) at the place where light
//! leaves the ply.

use super::Fabric;
use super::flight::Candidate;
use super::shadow::{self, OfYarn, Shadows, ShadowsAt, Toward};
use crate::PlyModel;
use crate::cloth::ClothShade;
use crate::math::simd::atan2;
use crate::math::vec3::{cross, dot};
use crate::ply::{EXIT_KINDS, ExitDensity, ExitLine, PassedLines};

/// What a ply's neighbors leave of its light.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shade<'a> {
    /// In a fabric of yarns.
    Yarns(Occlusion<'a>),
    /// In a cloth of curves.
    Curves(ClothShade<'a>),
}

impl Shade<'_> {
    #[inline]
    pub(crate) fn free(&self, b: [f32; 3], lines: [ExitLine; EXIT_KINDS]) -> [f32; EXIT_KINDS] {
        self.toward(&Toward::new(b), lines)
    }

    #[inline]
    pub(crate) fn toward(&self, toward: &Toward, lines: [ExitLine; EXIT_KINDS]) -> [f32; EXIT_KINDS] {
        match self {
            Shade::Yarns(shade) => shade.toward(toward, lines),
            Shade::Curves(shade) => shade.toward(toward, lines),
        }
    }
}

/// Neighbors of a ply: which of them count, and the place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Occlusion<'a> {
    /// Of the half the light comes from, and of the other.
    counts: [bool; 2],
    /// Sign of z of the half the light comes from.
    up_sign: f32,
    fabric: &'a Fabric,
    shadows: OfYarn<'a>,
    /// Where the line is nearest to the ply's axis along the yarn [um], and how much further a point lies
    /// that is R further along the ply.
    along_um: f32,
    per_radius_um: f32,
    /// The ply's axis, the way to it from the yarn's over the ply's radius, and that radius over half of the
    /// yarn's width.
    axis: [f32; 3],
    off_axis: [f32; 3],
    scale: f32,
    /// Of yarns whose plies scatter one by one: what passes a ply.
    passed: Option<&'a PassedLines>,
    yarn_axis: [f32; 3],
}

/// Parts of a ply's width over which light that leaves it counts as even where it passes other plies of its
/// yarn, and the least share of light that counts.
const PARTS: usize = 6;
const MIN_SHARE: f32 = 2e-3;

impl<'a> Occlusion<'a> {
    /// Of a ply that a line from direction `a` comes near; `counts` are the halves, up first, in which
    /// shadows count.
    pub(crate) fn new(
        (fabric, shadows, model): (&'a Fabric, &'a Shadows, &'a PlyModel),
        near: &Candidate,
        a: [f32; 3],
        counts: [bool; 2],
    ) -> Occlusion<'a> {
        let hit = &near.hit;
        let k = hit.family as usize;
        let yarn = &fabric.yarns[k];
        Occlusion {
            counts,
            up_sign: if a[2] < 0.0 { -1.0 } else { 1.0 },
            fabric,
            shadows: shadows.of(fabric, hit.family, hit.yarn),
            along_um: hit.along_um,
            per_radius_um: yarn.radius * hit.frame[2][1 - k],
            axis: hit.frame[2],
            off_axis: near.off_axis.map(|v| v / yarn.radius),
            scale: yarn.radius / yarn.half_width,
            passed: if yarn.one_by_one { model.passed_lines() } else { None },
            yarn_axis: near.yarn_axis,
        }
    }

    fn at(&self, s: f32) -> ShadowsAt<'a> {
        self.shadows.at(self.fabric, self.along_um + s * self.per_radius_um)
    }

    /// Shares of single reflection, of other light of clear fibers and of that of dark ones that get out in a
    /// direction whose place in the table is known, of light that leaves on these lines.
    #[inline]
    pub(crate) fn toward(&self, toward: &Toward, [refl, clear, dark]: [ExitLine; EXIT_KINDS]) -> [f32; EXIT_KINDS] {
        let b = toward.b;
        if !self.counts[usize::from(b[2] * self.up_sign < 0.0)] {
            return [1.0; EXIT_KINDS];
        }
        // Of the ply's axis: the offset along `b cross z`, as the table counts it, and how much further along
        // z the line is nearest to the yarn's axis than to the ply's.
        let (mut off, mut further) = (0.0, 0.0);
        if self.scale < 1.0 {
            let (z, p) = (self.axis, self.off_axis);
            let bz = dot(b, z);
            let per_sine = 1.0 / (1.0 - bz * bz).max(0.02).sqrt();
            let x = cross(b, z);
            off = dot(p, x) * per_sine;
            further = -(dot(p, b) - bz * dot(p, z)) * bz * per_sine * per_sine;
        }
        // Single reflection and light of dark fibers turn at places near each other.
        let places = [self.at(0.5 * (refl.s + dark.s) + further), self.at(clear.s + further)];
        let lines = [refl, clear, dark];
        let exits = lines.map(|line| line.density);
        let mut free = shadow::free(&places, toward, &exits, off, self.scale);
        if let Some(passed) = self.passed.filter(|_| free != [0.0; EXIT_KINDS]) {
            self.pass_plies(passed, b, lines, &exits, &mut free);
        }
        free
    }

    /// Of the shares, those that pass the yarn's other plies as well, by lines that lie as the light does.
    fn pass_plies(
        &self,
        passed: &PassedLines,
        b: [f32; 3],
        lines: [ExitLine; EXIT_KINDS],
        exits: &[ExitDensity; EXIT_KINDS],
        free: &mut [f32; EXIT_KINDS],
    ) {
        let edge = |part: usize| 2.0 * part as f32 / PARTS as f32 - 1.0;
        let shares: [[f32; PARTS]; EXIT_KINDS] = std::array::from_fn(|kind| {
            let below: [f32; PARTS + 1] = std::array::from_fn(|part| exits[kind].below(edge(part)));
            std::array::from_fn(|part| below[part + 1] - below[part])
        });
        let yarn = &self.fabric.yarns[self.shadows.family as usize];
        let (t, p, z) = (self.yarn_axis, self.off_axis, self.axis);
        let turned = |v: [f32; 3], [c, s]: [f32; 2]| -> [f32; 3] {
            let (w, along) = (cross(t, v), (1.0 - c) * dot(t, v));
            std::array::from_fn(|i| c * v[i] + s * w[i] + along * t[i])
        };
        let x = cross(b, z);
        let per_x = 1.0 / dot(x, x).sqrt().max(1e-3);
        for turn in &yarn.turn[1..yarn.plies] {
            // As if straight along its tangent next to this ply: lengths over R.
            let (center, axis) = (turned(p, *turn), turned(z, *turn));
            let across = cross(b, axis);
            let along = dot(b, axis);
            let sine = dot(across, across).sqrt().max(1e-3);
            let theta = atan2::<false>(along, sine);
            // How far from the other ply's axis a line lies, by how far it lies from this one's.
            let slope = -per_x * dot(x, across) / sine;
            let half = yarn.radius * slope.abs().max(0.1) / PARTS as f32;
            for (kind, free) in free.iter_mut().enumerate() {
                let line = &lines[kind];
                let middle: [f32; 3] = std::array::from_fn(|i| p[i] + line.s * z[i] - center[i]);
                let from: [f32; 3] = std::array::from_fn(|i| middle[i] - line.t * per_x * x[i]);
                if along * dot(from, axis) <= dot(from, b) {
                    continue;
                }
                let h = dot(middle, across) / sine;
                let (mut sum, mut all) = (0.0, 0.0);
                for (part, share) in shares[kind].iter().enumerate() {
                    if *share > MIN_SHARE {
                        let h = yarn.radius * (h + slope * (edge(part) + 1.0 / PARTS as f32));
                        sum += share * passed.mean(theta, h - half, h + half);
                        all += share;
                    }
                }
                *free *= sum / all;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::flight::exit;
    use super::super::{FabricModel, FabricOptions, FabricSpec};
    use super::*;
    use crate::io::Folder;
    use crate::math::hash::SplitMix64;
    use crate::ply::ExitShape;
    use std::f32::consts::TAU;
    use std::path::Path;

    /// What the plies of a yarn let pass of each other's light, against lines followed through the twisted
    /// yarn from where light leaves.
    #[test]
    #[ignore = "slow: 5 s: plies shadow each other as lines meet them"]
    fn plies_shadow_each_other_as_lines_meet_them() {
        const LINES: usize = 48;
        for plies in [2, 3, 4] {
            let yarn = format!(
                "model = \"models/cotton.pwm\"\nspacing_um = 2000.0\ncrimp = 0.5\nplies = {plies}\nply_pitch_um = 1300.0\n"
            );
            let text = format!("name = \"apart\"\n[weave]\nkind = \"layers\"\n[warp]\n{yarn}[weft]\n{yarn}");
            let folder = format!("{}/fabrics", env!("CARGO_MANIFEST_DIR"));
            let loaded = FabricSpec::load_from(&text, "apart", &Folder::new(Path::new(&folder))).unwrap();
            let bsdf = FabricModel::new(loaded, &FabricOptions::RAYS).unwrap();
            let fabric = &bsdf.fabric;
            let mut rng = SplitMix64(7 + plies);
            let mut number = || rng.next_f64() as f32;
            let (mut count, mut means, mut squares) = (0.0f32, [[0.0f32; 2]; 2], [0.0f32; 2]);
            while count < 1500.0 {
                let at = [4000.0 * number(), 4000.0 * number()];
                let mut turned = |z: f32| {
                    let (s, c) = (TAU * number()).sin_cos();
                    let r = (1.0 - z * z).sqrt();
                    [r * c, r * s, z]
                };
                let a = turned(0.75);
                let b = turned(-0.9 + 1.8 * (count / 1500.0));
                let Some(near) = fabric.flight_through(at, a).next_near().filter(|near| near.is_hit) else { continue };
                let (hit, id) = (&near.hit, near.id());
                let model = bsdf.model_of(hit.family, hit.yarn);
                let radius = fabric.yarns[hit.family as usize].radius;
                let shade = Occlusion::new((fabric, &bsdf.shadows, model), &near, a, [true; 2]);
                let z = hit.frame[2];
                let x = cross(b, z);
                let per_x = 1.0 / dot(x, x).sqrt();
                if per_x > 3.0 {
                    // Nearly along the ply, which turns on the way.
                    continue;
                }
                let shapes = ExitShape::usual();
                let lines = [0, 1].map(|kind| {
                    let (t, s) = (1.6 * number() - 0.8, 0.6 * number() - 0.3);
                    ExitLine { t, s, density: shapes[kind].density(t) }
                });
                let exits = [0, 1, 0].map(|kind: usize| lines[kind].density);
                let mut got = [1.0; EXIT_KINDS];
                shade.pass_plies(model.passed_lines().unwrap(), b, [0, 1, 0].map(|i| lines[i]), &exits, &mut got);
                assert_eq!(got[0], got[2]);
                count += 1.0;
                for kind in 0..2 {
                    let mut want = 0.0;
                    for i in 0..LINES {
                        let t = exits[kind].draw((i as f32 + 0.5) / LINES as f32);
                        let inner = std::array::from_fn(|i| {
                            near.center[i] + radius * (lines[kind].s * z[i] - t * per_x * x[i])
                        });
                        let from = exit(near.center, z, radius, inner, b);
                        let mut flight = fabric.flight(from, b, fabric.skip_own(&near, from, b));
                        let mut passes = 1.0;
                        while let Some(next) = flight.next_near() {
                            let away = (0..3).map(|i| (next.center[i] - from[i]).powi(2)).sum::<f32>().sqrt();
                            if next.id() != id || away > 20.0 * radius {
                                break;
                            }
                            passes *= model.r_d(next.hit.theta_i, next.hit.h_um);
                        }
                        want += passes / LINES as f32;
                    }
                    means[kind][0] += got[kind] / 1500.0;
                    means[kind][1] += want / 1500.0;
                    squares[kind] += (got[kind] - want).powi(2) / 1500.0;
                }
            }
            let rms = squares.map(f32::sqrt);
            println!("{plies} plies: what passes, found and followed {means:.4?}, rms difference {rms:.3?}");
            for ([got, want], rms) in means.into_iter().zip(rms) {
                assert!((got - want).abs() < 0.025 && rms < 0.18, "{plies} plies: {got}, {want}, {rms}");
                assert!(want > 0.2 && want < 0.9);
            }
        }
    }
}
