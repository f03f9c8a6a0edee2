//! Where inter-yarn light leaves a cloth: factors on it over places along the plies, around them, and over
//! the direction of the light.
//!
//! The energies of `inter_yarn.rs` depend on the directions alone. The light that the plies of a cloth
//! exchange is uneven: crests receive more of it than hollows, and under a lamp the flanks that face it. A
//! map holds, for each place of the shadow table, each angle about the ply's axis and each half of the
//! sphere, the ratio to those energies as a linear function of the light's direction, for clear and for dark
//! fibers. The mean of the ratio over the cell, as a function of the viewer's direction, is subtracted, so
//! that the light of the whole cell stays that of `inter_yarn.rs`.

use crate::cloth::geometry::lines::LineHit;
use crate::cloth::light::absorption::{LENGTH_UM, SIGMA_PER_UM};
use crate::cloth::shade::splines::{At, Several};
use crate::math::floor_fraction;
use crate::math::vec3::cross;
use std::f32::consts::TAU;

/// Number of angles about a ply's axis.
pub const ANGLES: usize = 8;
/// Number of functions of the light's direction: 1, x, y, |z|.
pub const FUNCTIONS: usize = 4;
/// Number of maps: for clear fibers and for dark ones.
pub const MAPS: usize = 2;
/// Nodes of absorption of the maps.
pub const MAP_NODES: [usize; MAPS] = [0, 5];

/// `[face, back][map][function]`: coefficients for light from the sides of the face and of the back.
pub type Ratios = [[[f32; FUNCTIONS]; MAPS]; 2];

/// Number of coefficients at a place and an angle.
pub const RATIOS: usize = 2 * MAPS * FUNCTIONS;

/// The map of a cloth.
#[derive(Clone, Debug, Default)]
pub struct LitPlaces {
    /// `[table of shadows][angle]`; empty if inter-yarn light is even.
    pub map: Vec<[Ratios; ANGLES]>,
    /// `[side of the viewer]`: mean over the cell of all coefficients, in splines of the viewer's direction.
    pub mean: Vec<Several<RATIOS>>,
}

/// The functions of the light's direction.
#[inline(always)]
pub fn functions([x, y, z]: [f32; 3]) -> [f32; FUNCTIONS] {
    [1.0, x, y, z.abs()]
}

/// Share of the map of clear fibers at an absorption.
#[inline(always)]
pub fn clear_map_share(sigma_per_um: f32) -> f32 {
    const DARK: f32 = 1.0 / (1.0 + SIGMA_PER_UM[MAP_NODES[1]] * LENGTH_UM);
    let v = 1.0 / (1.0 + sigma_per_um.clamp(0.0, 1e6) * LENGTH_UM);
    ((v - DARK) * (1.0 / (1.0 - DARK))).max(0.0)
}

/// Angle about the ply's axis, in turns from the face of the cloth, at which the line of a hit enters the
/// ply; `y` is the axis of the ply's frame towards the viewer ([`crate::cloth::geometry::frame`]).
#[inline(always)]
pub fn angle_of(hit: &LineHit, y: [f32; 3]) -> f32 {
    let z = hit.tangent;
    let x = cross(y, z);
    let across = (hit.h_um / hit.radius_um).clamp(-1.0, 1.0);
    let towards = (1.0 - across * across).sqrt();
    let n = |i: usize| towards * y[i] + across * x[i];
    crate::math::simd::atan2::<false>(n(0) * z[1] - n(1) * z[0], n(2)) / TAU
}

impl LitPlaces {
    /// Whether inter-yarn light is the same everywhere.
    pub fn is_even(&self) -> bool {
        self.map.is_empty()
    }

    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(self.map.as_slice()) + size_of_val(self.mean.as_slice())
    }

    /// Coefficients between the tables of two places, at an angle [turns].
    #[inline(always)]
    pub fn at(&self, (tables, between): ([usize; 2], f32), angle: f32) -> Ratios {
        let (low, t) = floor_fraction((angle + 1.0) * ANGLES as f32);
        let angles = [low as usize % ANGLES, (low as usize + 1) % ANGLES];
        let mut sum = [0.0; RATIOS];
        for (table, place_share) in tables.into_iter().zip([1.0 - between, between]) {
            let Some(row) = self.map.get(table) else { continue };
            for (angle, share) in angles.into_iter().zip([1.0 - t, t]) {
                let values = row[angle % ANGLES].as_flattened().as_flattened();
                let share = place_share * share;
                for i in 0..RATIOS {
                    sum[i] += share * values[i];
                }
            }
        }
        ratios(&sum)
    }

    /// Mean coefficients over the cell for a viewer in direction `a`, with the splines there.
    #[inline(always)]
    pub fn mean_at(&self, a: [f32; 3], splines: &At) -> Ratios {
        let mut mean = [0.0; RATIOS];
        if let Some(of) = self.mean.get(usize::from(a[2] < 0.0)) {
            splines.add(of, &mut mean);
        }
        ratios(&mean)
    }
}

/// Coefficients from a flat row.
#[inline(always)]
fn ratios(row: &[f32; RATIOS]) -> Ratios {
    let (of, _) = row.as_chunks::<FUNCTIONS>();
    [[of[0], of[1]], [of[2], of[3]]]
}

/// Coefficients of the plies that a line hits, weighted by the light that they intercept.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RatiosOfPlies {
    sum: Ratios,
    weight: f32,
}

impl RatiosOfPlies {
    #[inline(always)]
    pub(crate) fn add(&mut self, weight: f32, of: &Ratios) {
        let sums = self.sum.as_flattened_mut().as_flattened_mut();
        for (sum, value) in sums.iter_mut().zip(of.as_flattened().as_flattened()) {
            *sum += weight * value;
        }
        self.weight += weight;
    }

    /// Deviations from the mean over the cell, and these plies' share of `all` light that plies and hairs
    /// intercept.
    #[inline(always)]
    pub(crate) fn deviations(&self, mean: &Ratios, all: f32) -> (Ratios, f32) {
        let per = 1.0 / all.max(self.weight).max(f32::MIN_POSITIVE);
        let mut of = self.sum;
        let values = of.as_flattened_mut().as_flattened_mut();
        for (value, mean) in values.iter_mut().zip(mean.as_flattened().as_flattened()) {
            *value = per * (*value - self.weight * mean);
        }
        (of, per * self.weight)
    }
}
