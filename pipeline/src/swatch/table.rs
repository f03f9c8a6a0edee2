//! The light of blocks of both pictures as a smooth function of a cloth's numbers.
//!
//! Cloths are woven for a middle count, twist and tension, and for two other nodes of each. For every cloth,
//! and for nodes of roughness, the mean BSDF of the blocks is evaluated at nodes of absorption, over points
//! of the cell. Between nodes the logarithms are interpolated: Lagrange polynomials of the logarithms,
//! Catmull-Rom splines of the absorption; what count, twist and tension change adds up. A fit evaluates the
//! table only.

use super::cloths::{SwatchCloth, SwatchFiber, SwatchNumbers};
use super::geometry::{SwatchGeometry, unit};
use super::photo::{BLOCKS, SIDE};
use super::spectrum::WeaveGuess;
use crate::error::Error;
use plywave::cloth::ClothOptions;
use plywave::{Bsdf, ClothModel, ClothQuery, PlyModel};
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;
use std::sync::Arc;

/// Nodes of absorption [1/um], and the offset of its logarithm.
const SIGMAS: [f32; 7] = [0.0, 0.0008, 0.002, 0.005, 0.012, 0.03, 0.09];
const SIGMA_0: f64 = 0.0008;
const NODES: usize = SIGMAS.len();
/// Points of a block.
const POINTS: usize = 768;
/// Points of the cell for the light that goes straight on.
const STRAIGHT_POINTS: usize = 1024;
/// Least light, so that logarithms are finite.
const DARK: f64 = 1e-7;

/// Coordinate of an absorption in the fit.
pub fn of_sigma(sigma_per_um: f64) -> f64 {
    (sigma_per_um + SIGMA_0).ln()
}

/// The absorption [1/um] of a coordinate.
pub fn sigma_of(x: f64) -> f64 {
    (x.exp() - SIGMA_0).max(0.0)
}

/// Range of the coordinate.
pub fn sigma_range() -> [f64; 2] {
    [of_sigma(0.0), of_sigma(f64::from(SIGMAS[NODES - 1]))]
}

/// A fraction of point `i` in dimension `k`: a lattice of irrational steps.
fn fraction(i: usize, k: usize) -> f64 {
    // Powers of the inverse of the root of x^5 = x + 1 (Roberts 2018, "The Unreasonable Effectiveness of
    // Quasirandom Sequences", for four dimensions).
    const STEP: f64 = 0.856_674_883_854_502_9;
    (0.5 + (i + 1) as f64 * STEP.powi(k as i32 + 1)).fract()
}

/// Unknowns: logarithms of count, twist, tension of the warp over that of the weft, and roughness; and the
/// coordinates of three absorptions.
pub const UNKNOWNS: usize = 7;
/// Those of them that cloths are woven for.
const WOVEN: usize = 3;
/// Index of the roughness.
const ALPHA: usize = WOVEN;
/// Parts of a step to which it is shortened where a cloth cannot be woven.
const STEPS: [f64; 3] = [1.0, 0.5, 0.25];
/// How often the count of the middle is lowered, and by how much, until the cloth can be woven.
const LOWER: (usize, f64) = (8, 0.15);

/// The table of a weave and an orientation.
pub struct LightTable {
    /// `[count, twist, tension, roughness]`: nodes, ascending.
    nodes: [Vec<f64>; WOVEN + 1],
    /// `[count, twist, tension]`: index of the middle node.
    middle: [usize; WOVEN],
    /// `[cloth][roughness]`, each `[picture][block][absorption]`: logarithms of the light. The first cloth
    /// has the middle of all axes; then come the other nodes of each axis with the middle of the others.
    light: Vec<Vec<f32>>,
    /// `[cloth]`: logarithms of mass [g/m2], width of the warp [um], thickness [um]; and the share of light
    /// that goes straight on along the normal.
    measures: Vec<[f64; 4]>,
}

/// Textile measures between nodes.
#[derive(Clone, Copy, Debug)]
pub struct Measures {
    /// Mass per area [g/m2].
    pub g_per_m2: f64,
    /// Width of the warp yarn [um].
    pub width_um: f64,
    /// Thickness of the cloth [um].
    pub thickness_um: f64,
    /// Share of light that goes straight on along the normal.
    pub openness: f64,
}

/// What a table is made of.
pub struct TableInputs<'a> {
    /// The weave, with its orientation.
    pub guess: &'a WeaveGuess,
    /// The fiber.
    pub fiber: &'a SwatchFiber,
    /// Camera and lamps.
    pub geometry: &'a SwatchGeometry,
    /// Height of the picture over its width.
    pub aspect: f64,
    /// `[count, twist, tension]`: the middle of each axis, and how far the other nodes are from it.
    pub woven: [(f64, f64); WOVEN],
    /// Logarithms of roughnesses.
    pub ln_alpha: Vec<f64>,
}

/// Makes the table of a weave in its orientation.
///
/// # Errors
/// Those of the weaving, and [`Error::Interrupted`].
pub fn make_table(
    of: &TableInputs<'_>,
    go_on: &(dyn Fn() -> bool + Sync),
    tell: &mut dyn FnMut(usize, usize),
) -> Result<LightTable, Error> {
    let total = 2 * WOVEN + 1;
    let weave = |x: [f64; WOVEN]| {
        let [tex, turns_per_m, tension] = x.map(f64::exp);
        let numbers =
            SwatchNumbers { tex, turns_per_m, tension, alpha_fiber: of.fiber.alpha, srgb: None, uneven: None };
        SwatchCloth::new(of.guess, of.fiber, &numbers, go_on)
    };
    tell(0, total);
    let mut center = of.woven.map(|axis| axis.0);
    let mut tries = 0;
    let mut cloths = loop {
        match weave(center) {
            Ok(cloth) => break vec![cloth],
            Err(error) if tries == LOWER.0 || matches!(error, Error::Interrupted { .. }) => return Err(error),
            Err(_) => center[0] -= LOWER.1,
        }
        tries += 1;
    };
    let mut nodes: [Vec<f64>; WOVEN + 1] = Default::default();
    let mut middle = [0; WOVEN];
    for axis in 0..WOVEN {
        for sign in [-1.0, 1.0] {
            for part in STEPS {
                let mut x = center;
                x[axis] += sign * part * of.woven[axis].1;
                match weave(x) {
                    Ok(cloth) => {
                        cloths.push(cloth);
                        nodes[axis].push(x[axis]);
                        break;
                    }
                    Err(error @ Error::Interrupted { .. }) => return Err(error),
                    Err(_) => {}
                }
            }
            if sign < 0.0 {
                middle[axis] = nodes[axis].len();
                nodes[axis].push(center[axis]);
            }
            tell(2 * axis + if sign < 0.0 { 2 } else { 3 }, total);
        }
    }
    nodes[ALPHA] = of.ln_alpha.clone();
    let mut table = LightTable { nodes, middle, light: Vec::new(), measures: Vec::new() };
    for cloth in &cloths {
        if !go_on() {
            return Err(Error::Interrupted { left: 0, total: 0 });
        }
        let model = cloth.model(&ClothOptions::RAYS)?;
        for ln_alpha in &of.ln_alpha {
            table.light.push(light(&model, &cloth.strands(ln_alpha.exp())?, of));
        }
        let m = &cloth.measures;
        table.measures.push([m.mass_g_per_m2.ln(), m.yarns[0].width_um.ln(), m.thickness_um.ln(), straight(&model)]);
    }
    Ok(table)
}

/// Share of light that goes straight on along the normal, over the cell.
fn straight(cloth: &ClothModel) -> f64 {
    let [a, b] = cloth.cell_um();
    let one = |i: usize| {
        let [u, v] = [fraction(i, 0), fraction(i, 1)];
        let place = [0, 1].map(|k| (u * a[k] + v * b[k]) as f32);
        f64::from(cloth.at(&ClothQuery::new(place, [0.0, 0.0, 1.0], [0.55])).straight()[0])
    };
    (0..STRAIGHT_POINTS).map(one).sum::<f64>() / STRAIGHT_POINTS as f64
}

/// Logarithms of the light of both pictures, `[picture][block][absorption]`.
fn light(cloth: &ClothModel, strands: &[Arc<PlyModel>], of: &TableInputs<'_>) -> Vec<f32> {
    let [a, b] = cloth.cell_um();
    let seen = of.geometry.seen_mm();
    let turn_rad = of.guess.turn_rad as f32 + if of.guess.is_across { FRAC_PI_2 } else { 0.0 };
    let (s, c) = turn_rad.sin_cos();
    let block = |i: usize| -> [f32; NODES] {
        let (is_back, block) = (i / BLOCKS == 1, i % BLOCKS);
        let lamp = of.geometry.lamp_mm(is_back);
        let mut sums = [0.0f64; NODES];
        for point in 0..POINTS {
            let point = block * POINTS + point;
            let [x, y, u, v] = [0, 1, 2, 3].map(|k| fraction(point, k));
            let x_mm = ((block % SIDE) as f64 + x) / SIDE as f64 - 0.5;
            let y_mm = 0.5 - ((block / SIDE) as f64 + y) / SIDE as f64;
            let at_mm = [x_mm * seen, y_mm * seen * of.aspect];
            let wo = of.geometry.to_camera(at_mm);
            let to_lamp = [lamp[0] - at_mm[0], lamp[1] - at_mm[1], lamp[2]];
            let squared: f64 = to_lamp.iter().map(|v| v * v).sum();
            // A point of the cell, in the surface's axes.
            let place = [0, 1].map(|k| (u * a[k] + v * b[k]) as f32);
            let place = [c * place[0] - s * place[1], s * place[0] + c * place[1]];
            let query = ClothQuery {
                turn_rad,
                sigma_per_um: [Some(SIGMAS); 2],
                models: [0, 1].map(|kind: usize| Some(strands[kind.min(strands.len() - 1)].as_ref())),
                ..ClothQuery::new(place, wo, [0.55; NODES])
            };
            let f = cloth.at(&query).eval(unit(to_lamp));
            let scale = f64::from(of.geometry.lens(wo)) * of.geometry.camera_mm.powi(2) / squared;
            (0..NODES).for_each(|k| sums[k] += scale * f64::from(f[k]));
        }
        sums.map(|sum| (sum / POINTS as f64).max(DARK).ln() as f32)
    };
    (0..2 * BLOCKS).into_par_iter().flat_map_iter(block).collect()
}

/// Lagrange weights of nodes at x.
fn lagrange(nodes: &[f64], x: f64) -> Vec<f64> {
    let weight = |i: usize| {
        let others = nodes.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, n)| (x - n) / (nodes[i] - n)).product()
    };
    (0..nodes.len()).map(weight).collect()
}

/// Weights of four nodes of absorption about a coordinate, from the first of them.
fn sigma_weights(x: f64) -> (usize, [f64; 4]) {
    let at = |k: usize| of_sigma(f64::from(SIGMAS[k.min(NODES - 1)]));
    let cell = (1..NODES - 1).take_while(|k| at(*k) <= x).last().unwrap_or(0);
    let (x0, x1) = (at(cell), at(cell + 1));
    let (h, t) = (x1 - x0, ((x - x0) / (x1 - x0)).clamp(0.0, 1.0));
    let (t2, t3) = (t * t, t * t * t);
    let [p0, p1, m0, m1] = [2.0 * t3 - 3.0 * t2 + 1.0, 3.0 * t2 - 2.0 * t3, t3 - 2.0 * t2 + t, t3 - t2];
    // Slopes are those of the chord of the neighbors, one-sided at the ends.
    let mut weights = [0.0; 4];
    let first = cell.saturating_sub(1).min(NODES - 4);
    let mut add = |node: usize, w: f64| weights[node - first] += w;
    add(cell, p0);
    add(cell + 1, p1);
    for (node, m) in [(cell, m0), (cell + 1, m1)] {
        let (low, high) = (node.saturating_sub(1), (node + 1).min(NODES - 1));
        let slope = m * h / (at(high) - at(low));
        add(high, slope);
        add(low, -slope);
    }
    (first, weights)
}

impl LightTable {
    /// Smallest and largest coordinate along each axis.
    pub fn range(&self, axis: usize) -> [f64; 2] {
        let nodes = &self.nodes[axis];
        [nodes[0], nodes[nodes.len() - 1]]
    }

    /// Weights of the cloths.
    fn cloth_weights(&self, x: &[f64; UNKNOWNS]) -> Vec<f64> {
        let mut weights = vec![1.0];
        for axis in 0..WOVEN {
            let of_axis = lagrange(&self.nodes[axis], x[axis]);
            weights[0] += of_axis[self.middle[axis]] - 1.0;
            weights.extend(of_axis.iter().enumerate().filter(|(k, _)| *k != self.middle[axis]).map(|(_, w)| *w));
        }
        weights
    }

    /// Logarithms of the light at the unknowns:
    /// `[picture][block][channel]`.
    pub fn at(&self, x: &[f64; UNKNOWNS]) -> Vec<[f64; 3]> {
        let of_alpha = lagrange(&self.nodes[ALPHA], x[ALPHA]);
        let sigmas = [4, 5, 6].map(|k| sigma_weights(x[k]));
        let mut sums = vec![0.0f64; 2 * BLOCKS * NODES];
        for (cloth, w) in self.cloth_weights(x).into_iter().enumerate() {
            for (k, c) in of_alpha.iter().enumerate() {
                let light = &self.light[cloth * of_alpha.len() + k];
                sums.iter_mut().zip(light).for_each(|(sum, v)| *sum += w * c * f64::from(*v));
            }
        }
        sums.chunks_exact(NODES)
            .map(|of| sigmas.map(|(first, w)| (0..4).map(|k| w[k] * of[first + k]).sum::<f64>()))
            .collect()
    }

    /// Textile measures at the unknowns.
    pub fn measures(&self, x: &[f64; UNKNOWNS]) -> Measures {
        let mut sums = [0.0; 4];
        for (w, of) in self.cloth_weights(x).into_iter().zip(&self.measures) {
            (0..4).for_each(|k| sums[k] += w * of[k]);
        }
        let [mass, width, thickness, openness] = sums;
        Measures {
            g_per_m2: mass.exp(),
            width_um: width.exp(),
            thickness_um: thickness.exp(),
            openness: openness.clamp(0.0, 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both interpolations reproduce what they must: lines exactly, and nodes.
    #[test]
    fn interpolation_is_exact_for_lines() {
        let nodes = [0.3, 0.9, 2.0];
        for x in [0.3, 0.5, 1.4, 2.0] {
            let w = lagrange(&nodes, x);
            let line: f64 = w.iter().zip(nodes).map(|(w, n)| w * (2.0 * n - 1.0)).sum();
            assert!((line - (2.0 * x - 1.0)).abs() < 1e-12);
        }
        let [low, high] = sigma_range();
        for k in 0..50 {
            let x = low + (high - low) * f64::from(k) / 49.0;
            let (first, w) = sigma_weights(x);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let line: f64 = (0..4).map(|k| w[k] * of_sigma(f64::from(SIGMAS[first + k]))).sum();
            assert!((line - x).abs() < 0.25, "{x} {line}");
            assert!((of_sigma(sigma_of(x)) - x).abs() < 1e-9);
        }
    }
}
