//! Paths through a fabric of yarns on center lines.

use super::between::{CLASSES_A_KIND, InterYarn};
use super::flight::{Candidate, exit};
use super::hit::PlyHit;
use super::paths::{Escaped, Paths, Scattered};
use super::shade::{Occlusion, Shade};
use super::shadow::Shadows;
use super::{Fabric, YarnSet};
use crate::PlyModel;
use crate::gap::Slit;

/// Models of a fabric's yarns.
pub(crate) trait Yarns {
    /// The model of a yarn.
    fn model(&self, family: YarnSet, yarn: i32) -> &PlyModel;

    /// The slits of a ply there, whose light of 0.55 um stands for all.
    fn slit(&self, hit: &PlyHit) -> Option<&Slit>;
}

/// A fabric of yarns, its shadows and models.
struct FabricPaths<'a, Y>(&'a Fabric, &'a Shadows, &'a Y);

impl<Y: Yarns + Sync> Paths for FabricPaths<'_, Y> {
    // A fabric is traced whenever it is loaded.
    const BEAMS: usize = 1 << 18;

    fn place(&self, fractions: [f64; 2]) -> [f32; 2] {
        // Plies of twisted yarns are met at every turn.
        let spread = self.0.repeat_um().map(|r| r * (1 + (20_000.0 / r) as usize) as f64);
        [0, 1].map(|k| (fractions[k] * spread[k]) as f32)
    }

    fn path(&self, a: [f32; 3], at: [f32; 2], is_followed: bool, number: &mut dyn FnMut() -> f32) -> Option<Escaped> {
        path((self.0, self.1, self.2), (a, at), is_followed, number)
    }
}

/// The class of a first ply.
pub(crate) fn class(hit: &PlyHit) -> usize {
    CLASSES_A_KIND * (hit.family as usize) + usize::from(hit.is_double)
}

/// A path from direction `a` through a point of the middle plane, followed to its end or to its first ply;
/// none where it is dropped or lost.
fn path(
    (fabric, shadows, yarns): (&Fabric, &Shadows, &impl Yarns),
    (a, at): ([f32; 3], [f32; 2]),
    is_followed: bool,
    number: &mut dyn FnMut() -> f32,
) -> Option<Escaped> {
    let mut flight = fabric.flight_through(at, a);
    let mut d = a.map(|v| -v);
    let mut gone = Escaped::new();
    while !gone.is_over() {
        // The first ply that catches the beam.
        let near: Candidate = loop {
            let Some(near) = flight.next_near() else {
                gone.up = d[2] * a[2] > 0.0;
                return Some(gone);
            };
            let model = yarns.model(near.hit.family, near.hit.yarn);
            if number() >= model.r_d(near.hit.theta_i, near.hit.h_um) {
                break near;
            }
        };
        let hit = &near.hit;
        let model = yarns.model(hit.family, hit.yarn);
        let radius = fabric.yarns[hit.family as usize].radius;
        let (slit, kind, z) = (yarns.slit(hit), hit.family as usize, hit.frame[2]);
        let ply =
            Scattered { model, theta_i: hit.theta_i, h_um: hit.h_um, radius_um: radius, frame: hit.frame, slit, kind };
        let first = (gone.orders == 0)
            .then(|| (class(hit), Shade::Yarns(Occlusion::new((fabric, shadows, model), &near, a, [true; 2]))));
        let (t, s) = gone.scatter(&ply, first, (a, is_followed), &mut d, number)?;
        if !is_followed {
            return Some(gone);
        }
        let x = [d[1] * z[2] - d[2] * z[1], d[2] * z[0] - d[0] * z[2], d[0] * z[1] - d[1] * z[0]];
        let scale = -t * radius / (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt().max(1e-6);
        let inner = std::array::from_fn(|i| near.center[i] + scale * x[i] + s * radius * z[i]);
        let from = exit(near.center, z, radius, inner, d);
        flight = fabric.flight(from, d, fabric.skip_own(&near, from, d));
    }
    None
}

impl InterYarn {
    /// Of a fabric whose yarns have these models.
    pub(crate) fn new(fabric: &Fabric, shadows: &Shadows, yarns: &(impl Yarns + Sync)) -> InterYarn {
        InterYarn::of(&FabricPaths(fabric, shadows, yarns))
    }
}
