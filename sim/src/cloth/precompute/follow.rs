//! Paths through a cloth: intersection of lines with its plies and hairs, until the light leaves.
//!
//! A ply lets a line pass between its fibers with probability `r_d`; the first one that does not scatters the
//! path. A path skips the ply that it has just left as long as the intersection lies near its exit along that
//! ply.

use super::drift::{Drift, along, turned};
use super::hairs::{InLayer, Through};
use super::paths::{Escaped, Scattered};
use plywave::cloth::LineHits;
use plywave::cloth::geometry::{ClothPlies, beyond, frame, start};
use plywave::cloth::light::{HairLayer, angle_of, class};
use plywave::cloth::shade::{ClothShade, ClothShadows, exit, is_own};
use plywave::math::vec3::{cross, dot};

/// The plies, shadows and hairs of a cloth that paths are traced through.
pub(super) struct ClothPaths<'a> {
    pub plies: &'a ClothPlies,
    pub shadows: &'a ClothShadows,
    pub hairs: Option<&'a HairLayer>,
    /// `[kind]`: displacements of its model.
    pub drifts: &'a [Option<Drift>],
}

impl ClothPaths<'_> {
    /// Point of the middle plane [um] at fractions of the cell's vectors, each 0 to 1.
    pub fn place(&self, fractions: [f64; 2]) -> [f32; 2] {
        let [a, b] = self.plies.lattice.cell_um;
        let [s, t] = fractions;
        [(s * a[0] + t * b[0]) as f32, (s * a[1] + t * b[1]) as f32]
    }

    /// Traces a path that comes from direction `a` through the point `at` of the middle plane [um], to its
    /// end or, unless `is_followed`, to its first ply. Returns `None` for a path that is dropped or lost.
    pub fn path(
        &self,
        a: [f32; 3],
        at: [f32; 2],
        is_followed: bool,
        number: &mut dyn FnMut() -> f32,
    ) -> Option<Escaped> {
        let ClothPlies { lines, lattice, kind_of, models, scale, .. } = self.plies;
        let mut d = a.map(|v| -v);
        let mut from = start(lines, at, a);
        let mut own = None;
        let mut hits = LineHits::default();
        let mut path = Escaped::new();
        let side = |w: [f32; 3]| usize::from(w[2] < 0.0);
        let mut layer = self.hairs.map(|hairs| InLayer { hairs, side: side(a), above: 0.0 });
        let passes = |d: [f32; 3]| self.hairs.map_or(1.0, |hairs| hairs.passes(d));
        loop {
            if let Some(layer) = layer.take() {
                match layer.follow(&mut path, &mut d, (a, is_followed), number) {
                    Through::Out => {
                        path.up = d[2] * a[2] > 0.0;
                        path.d = d;
                        return Some(path);
                    }
                    Through::In => own = None,
                    Through::FirstOrder => return Some(path),
                    Through::Over => return None,
                }
            }
            lines.hits_while(from, d, &mut hits, |hit| self.plies.passes(hit));
            // The first ply on the line that does not let it pass between its fibers.
            let first_hit = hits
                .as_slice()
                .iter()
                .enumerate()
                .find(|(_, hit)| own.is_none_or(|own| !is_own(lines, hit, own)) && number() >= self.plies.r_d(hit));
            let Some((depth, hit)) = first_hit else {
                if let Some(hairs) = self.hairs {
                    from = beyond(lines, from, d);
                    layer = Some(InLayer { hairs, side: side(d), above: 1.0 });
                    continue;
                }
                path.up = d[2] * a[2] > 0.0;
                path.d = d;
                return Some(path);
            };
            let kind = kind_of[hit.curve as usize];
            let (theta_i, h_um) = (hit.theta_i, scale[kind] * hit.h_um);
            let frame = frame(hit, d);
            let radius = hit.radius_um;
            let shade = ClothShade::new(self.shadows, hit, a, [true; 2]);
            let first = if path.orders == 0 {
                let follows = depth + 1 < hits.as_slice().len();
                Some((class(kind, depth, follows), shade, angle_of(hit, frame[1])))
            } else {
                None
            };
            let (model, drift) = (&models[kind], self.drifts[kind].as_ref());
            let ply = Scattered { model, drift, theta_i, h_um, radius_um: radius * scale[kind], frame, kind };
            let (t, s) = path.scatter(&ply, first, (a, is_followed), &mut d, &passes, number)?;
            if !is_followed {
                return Some(path);
            }
            let center: [f32; 3] = std::array::from_fn(|i| from[i] + hit.center_um[i]);
            let [start, end] = along(lines, lattice, (hit.curve as usize, hit.parameter), s * radius);
            let z = end.tangent;
            d = turned(d, start.tangent, z);
            let x = cross(d, z);
            let across = -t * radius / dot(x, x).sqrt().max(1e-6);
            let center = std::array::from_fn(|i| center[i] + end.center_um[i] - start.center_um[i]);
            own = Some((hit.curve, hit.cells, end.parameter));
            from = exit(center, z, radius, std::array::from_fn(|i| center[i] + across * x[i]), d);
            if path.is_over() {
                return None;
            }
        }
    }
}
