//! Where inter-yarn light leaves a cloth: the map over places, from the paths that are followed.
//!
//! For the paths whose first ply they hit at one place and angle, the light that leaves is compared with the
//! energies and shapes of [`InterYarn`]: the ratio of the two is a regression on the functions of the light's
//! direction, with the ratio of all places as its prior. The mean of the ratio over the cell is a regression
//! over the directions of views of the shaded cloth.

use super::paths::{Escaped, FirstPlace};
use super::splines::{SplineSums, several};
use super::{Effort, Progress, parts};
use crate::error::SimError;
use nalgebra::{Matrix4, Vector4};
use plywave::ClothQuery;
use plywave::cloth::light::{
    ANGLES, FUNCTIONS, InterYarn, LitPlaces, MAP_NODES, MAPS, RATIOS, Ratios, SIGMA_PER_UM, functions,
};
use plywave::cloth::shade::{SHADOW_BYTES, SeveralSplines, SplinesAt};
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::math::half::{from_half, to_half};
use plywave::math::hash::SplitMix64;
use std::f32::consts::{PI, TAU};

/// `[map]`: variances over places of the ratio's coefficients, the prior's; those that satin has.
const VARIANCES: [[f64; FUNCTIONS]; MAPS] = [[0.04, 0.03, 0.03, 0.06], [0.25, 0.15, 0.15, 0.3]];
/// Directions of the light at which a path's expected light is evaluated, on each side.
const LIGHTS: usize = 6;
/// Smallest ratio in any direction, over that of the mean direction.
const MIN_RATIO: f32 = 0.02;
/// Number of parts of the paths, whose sums are joined in order.
const PARTS: usize = 64;
/// Number of parts of the views of one side, for the mean over the cell.
const HALF_PARTS: usize = 8;
/// Number of views of each side, and for [`Effort::Draft`].
const VIEWS: usize = 1 << 17;
const DRAFT_VIEWS: usize = 1 << 13;

/// A path that was followed, and the place of its first ply.
pub(super) struct Followed {
    a: [f32; 3],
    class: usize,
    at: FirstPlace,
    /// Direction in which it left after two plies or more, and its energies at the nodes of the map.
    left: Option<([f32; 3], [f32; MAPS])>,
}

impl Followed {
    /// `None` for a path whose first scatterer is no ply.
    pub fn new(a: [f32; 3], path: &Escaped) -> Option<Followed> {
        let left =
            (path.orders >= 2).then(|| (path.d, MAP_NODES.map(|node| path.weight[0][node] * path.weight[1][node])));
        Some(Followed { a, class: path.class, at: path.at?, left })
    }

    /// Number of the cell of the map that is nearest.
    fn cell(&self) -> usize {
        let (tables, between) = self.at.tables;
        let table = tables[usize::from(between >= 0.5)];
        table * ANGLES + (((self.at.angle + 1.0) * ANGLES as f32).round() as usize) % ANGLES
    }
}

/// Sums of one cell for light from one side and one node of absorption: of expected light, with products of
/// the functions; of the light that leaves; and of its squares.
#[derive(Clone, Copy, Default)]
struct Sums {
    expected: Matrix4<f64>,
    left: Vector4<f64>,
    squares: f64,
}

type SumsOfCell = [[Sums; MAPS]; 2];

fn add(sums: &mut SumsOfCell, of: &SumsOfCell) {
    for (sum, of) in sums.as_flattened_mut().iter_mut().zip(of.as_flattened()) {
        sum.expected += of.expected;
        sum.left += of.left;
        sum.squares += of.squares;
    }
}

fn vector(of: [f32; FUNCTIONS]) -> Vector4<f64> {
    Vector4::from(of.map(f64::from))
}

/// Expected and found light of paths.
fn sums(inter_yarn: &InterYarn, paths: &[&Followed], seed: usize) -> SumsOfCell {
    let mut sums = SumsOfCell::default();
    for (number, path) in paths.iter().enumerate() {
        let sigma = MAP_NODES.map(|node| SIGMA_PER_UM[node]);
        let expected = inter_yarn.at::<MAPS>(path.a, &[(path.class, path.at.energy)], [sigma; 2], [1.0; 2]);
        for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
            for light in 0..LIGHTS {
                let even = |step: f64| (0.5 + (seed + number * LIGHTS + light) as f64 * step).fract() as f32;
                // Cosine-weighted directions.
                let (u, turn) = ((light as f32 + even(0.754_877_666)) / LIGHTS as f32, even(0.569_840_291));
                let (z, (sin, cos)) = (u.sqrt().max(1e-3), (TAU * turn).sin_cos());
                let across = (1.0 - z * z).sqrt();
                let b = [across * cos, across * sin, sign * z];
                let f = expected.eval(b).map(|f| f64::from(f * PI / z) / LIGHTS as f64);
                let t = vector(functions(b));
                (0..MAPS).for_each(|map| sums[side][map].expected += f[map] * t * t.transpose());
            }
        }
        if let Some((d, energies)) = path.left {
            let of = &mut sums[usize::from(d[2] < 0.0)];
            for (of, energy) in of.iter_mut().zip(energies.map(f64::from)) {
                of.left += energy * vector(functions(d));
                of.squares += energy * energy;
            }
        }
    }
    sums
}

/// Ratio of found to expected light of a map, with a prior; `weight` is the mean energy of a path that
/// leaves.
fn ratio(map: usize, sums: &Sums, prior: Vector4<f64>, weight: f64) -> Vector4<f64> {
    let per = Matrix4::from_diagonal(&Vector4::from(VARIANCES[map].map(|variance| weight / variance)));
    let normal = sums.expected + per;
    normal.cholesky().map_or(prior, |factor| factor.solve(&(sums.left + per * prior)))
}

/// Reduces the dependence on the direction until the ratio is above 0 everywhere.
fn not_negative(ratio: Vector4<f64>) -> [f32; FUNCTIONS] {
    let [c, x, y, z] = [0, 1, 2, 3].map(|i| ratio[i] as f32);
    let c = c.max(0.0);
    // Smallest value of x, y, |z| parts over the half sphere.
    let across = x.hypot(y);
    let least = if z < 0.0 { -across.hypot(z) } else { -across };
    let share = if least < 0.0 { ((1.0 - MIN_RATIO) * c.max(1e-3) / -least).min(1.0) } else { 1.0 };
    [c, share * x, share * y, share * z].map(|v| from_half(to_half(v)))
}

/// The map over places of a cloth, whose inter-yarn scattering is even.
pub(super) fn lit_places(
    data: &ClothData,
    paths: &[Followed],
    effort: Effort,
    progress: Progress<'_>,
) -> Result<LitPlaces, SimError> {
    let (inter_yarn, tables) = (&data.inter_yarn, data.shadows.free().len() / SHADOW_BYTES);
    let cells = tables * ANGLES;
    let mut sorted: Vec<&Followed> = paths.iter().collect();
    sorted.sort_by_key(|path| path.cell());
    let part = |i: usize| -> Vec<(usize, SumsOfCell)> {
        let [from, to] = [i, i + 1].map(|i| i * cells / PARTS);
        let first = sorted.partition_point(|path| path.cell() < from);
        let last = sorted.partition_point(|path| path.cell() < to);
        sorted[first..last]
            .chunk_by(|a, b| a.cell() == b.cell())
            .map(|of| (of[0].cell(), sums(inter_yarn, of, LIGHTS * first)))
            .collect()
    };
    let found = parts("places of light between plies", PARTS, progress, part)?.concat();
    let mut of_angles = [SumsOfCell::default(); ANGLES];
    found.iter().for_each(|(cell, sums)| add(&mut of_angles[cell % ANGLES], sums));
    let mut all = SumsOfCell::default();
    of_angles.iter().for_each(|of| add(&mut all, of));
    let weights = all.map(|of| of.map(|sums| sums.squares / sums.left[0].max(1e-12)));
    let one = Vector4::new(1.0, 0.0, 0.0, 0.0);
    let priors =
        of_angles.map(|of| [0, 1].map(|side| [0, 1].map(|map| ratio(map, &of[side][map], one, weights[side][map]))));
    let prior_ratios = priors.map(|prior| -> Ratios { prior.map(|of| of.map(not_negative)) });
    let mut map: Vec<[Ratios; ANGLES]> = vec![prior_ratios; tables];
    for (cell, sums) in &found {
        let prior = &priors[cell % ANGLES];
        map[cell / ANGLES][cell % ANGLES] = [0, 1].map(|side| {
            [0, 1].map(|map| not_negative(ratio(map, &sums[side][map], prior[side][map], weights[side][map])))
        });
    }
    let places = LitPlaces { map, mean: Vec::new() };
    let mean = means(data, &places, effort, progress)?;
    Ok(LitPlaces { mean, ..places })
}

/// `[side of the viewer]`: mean of the map over the cell, in splines of the viewer's direction. It is a mean
/// over views of the shaded cloth, weighted by the energy of inter-yarn scattering, so that the map does not
/// change the mean of that energy.
fn means(
    data: &ClothData,
    places: &LitPlaces,
    effort: Effort,
    progress: Progress<'_>,
) -> Result<Vec<SeveralSplines<RATIOS>>, SimError> {
    let mut data = data.clone();
    data.inter_yarn.places = places.clone();
    let cloth = ClothModel::from_data(data, &ClothOptions::RAYS)?;
    let ([a, b], sigma) = (cloth.cell_um(), MAP_NODES.map(|node| SIGMA_PER_UM[node]));
    let views = if effort == Effort::Draft { DRAFT_VIEWS } else { VIEWS };
    let part = |i: usize| {
        // `[side of the light][map]`.
        let mut sums = [0, 1].map(|_| [0, 1].map(|_| SplineSums::<FUNCTIONS>::new()));
        let side = i / HALF_PARTS;
        let mut rng = SplitMix64(0x6d65_616e + i as u64);
        for k in (i % HALF_PARTS..views).step_by(HALF_PARTS) {
            // Half of the directions are uniform over the hemisphere, half are cosine-weighted.
            let even = |step: f64| (0.5 + k as f64 * step).fract();
            let u = even(0.754_877_666_246_692_8);
            let z = if (k / HALF_PARTS).is_multiple_of(2) { u.sqrt() } else { u }.max(2e-3);
            let (sin, cos) = (std::f64::consts::TAU * even(0.569_840_290_998_053_3)).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let wo = [(across * cos) as f32, (across * sin) as f32, if side == 0 { z } else { -z } as f32];
            let [s, t] = [rng.next_f64(), rng.next_f64()];
            let at = [0, 1].map(|i| (s * a[i] + t * b[i]) as f32);
            let query = ClothQuery { sigma_per_um: [Some(sigma); 2], ..ClothQuery::new(at, wo, [0.55; MAPS]) };
            let (energy, ratios, share) = cloth.at(&query).inter_yarn_at_place();
            if share <= 0.0 {
                continue;
            }
            let splines = SplinesAt::new(wo);
            for light in 0..2 {
                for map in 0..MAPS {
                    let ratio = ratios[side ^ light][map].map(|v| v / share);
                    sums[light][map].add_weighted(share * energy[side ^ light][map], &ratio, &splines);
                }
            }
        }
        sums
    };
    let found = parts("mean of light between plies", 2 * HALF_PARTS, progress, part)?;
    let of_side = |found: &[[[SplineSums<FUNCTIONS>; MAPS]; 2]]| {
        let mut all = [0, 1].map(|_| [0, 1].map(|_| SplineSums::<FUNCTIONS>::new()));
        for sums in found {
            all.as_flattened_mut().iter_mut().zip(sums.as_flattened()).for_each(|(all, sums)| all.join(sums));
        }
        let functions: Vec<_> = all.as_flattened().iter().flat_map(SplineSums::solve).collect();
        several::<RATIOS>(&functions).remove(0)
    };
    Ok(found.chunks(HALF_PARTS).map(of_side).collect())
}

#[cfg(test)]
mod tests {
    use super::super::follow::ClothPaths;
    use super::super::precompute;
    use super::*;
    use crate::cloth::make_cloth;
    use plywave::PlyModel;
    use plywave::cloth::geometry::ClothPlies;
    use plywave_textile::ClothSpec;
    use std::sync::Arc;

    /// Paths of another seed leave with the light of the map, by angle about the plies, part of the curves,
    /// side of the light and absorption; and the mean over the cell stays as it is without the map.
    #[test]
    fn other_paths_have_the_light_of_the_map() {
        const GROUPS: usize = 4 * ANGLES;
        let folder = format!("{}/../fabrics", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(format!("{folder}/cloths/jersey.toml")).unwrap();
        let spec = ClothSpec::parse(&text, "jersey").unwrap();
        let none = &mut |file: &str| panic!("{file} is not to be read");
        let curves = make_cloth(&spec, "jersey", none, Effort::Near, &|_| true).unwrap().curves;
        let model = PlyModel::load(format!("{folder}/models/cotton_single.pwm")).unwrap();
        let data = precompute(&spec, &text, &curves, &[Arc::new(model)], Effort::Near, &|_| true).unwrap();
        let plies = ClothPlies::new(&data.curves, &data.models).unwrap();
        let drifts: Vec<_> = data.models.iter().map(|model| super::super::drift::Drift::new(model)).collect();
        let paths = ClothPaths { plies: &plies, shadows: &data.shadows, hairs: None, drifts: &drifts };
        let inter_yarn = data.inter_yarn.clone().along(plies.runs);
        let tables = inter_yarn.places.map.len();
        let sigma = MAP_NODES.map(|node| SIGMA_PER_UM[node]);
        let mut rng = SplitMix64(0x6c69_7421);
        // `[group][side of the light, map]`: light found, of the mean over places, of the map; squares of the
        // first.
        let mut sums = vec![[[0.0f64; 4]; 2 * MAPS]; GROUPS];
        for k in 0..400_000 {
            let (z, turn) = ((rng.next_f64() as f32).sqrt().max(0.02), TAU * rng.next_f64() as f32);
            let across = (1.0 - z * z).sqrt();
            let a = [across * turn.cos(), across * turn.sin(), if k % 2 == 0 { z } else { -z }];
            let at = paths.place([rng.next_f64(), rng.next_f64()]);
            let Some(path) = paths.path(a, at, true, &mut || rng.next_f64() as f32) else { continue };
            let Some(path) = Followed::new(a, &path) else { continue };
            let mut light = inter_yarn.at::<MAPS>(a, &[(path.class, path.at.energy)], [sigma; 2], [1.0; 2]);
            let even = light.energy;
            let of = inter_yarn.places.at(path.at.tables, path.at.angle);
            let mean = inter_yarn.places.mean_at(a, &SplinesAt::new(a));
            let less = |i: usize, map: usize| std::array::from_fn(|n| of[i][map][n] - mean[i][map][n]);
            let deviations = [0, 1].map(|i| [0, 1].map(|map| less(i, map)));
            light.set_place(&inter_yarn, (&deviations, 1.0), sigma);
            let group = path.cell() % ANGLES + ANGLES * (4 * (path.cell() / ANGLES) / tables);
            let side = usize::from(a[2] < 0.0);
            for half in 0..2 {
                for map in 0..MAPS {
                    let sums = &mut sums[group][(side ^ half) * MAPS + map];
                    let here = |d: [f32; 3]| usize::from(d[2] < 0.0) == side ^ half;
                    let left = path.left.filter(|(d, _)| here(*d)).map_or(0.0, |(_, left)| f64::from(left[map]));
                    sums[0] += left;
                    sums[3] += left * left;
                    sums[1] += f64::from(even[half][map]);
                    sums[2] += f64::from(light.energy[half][map]);
                }
            }
        }
        for i in 0..2 * MAPS {
            let all = sums.iter().fold([0.0; 4], |all, of| [0, 1, 2, 3].map(|n| all[n] + of[i][n]));
            let mean = sums.iter().map(|of| (of[i][0] / all[0]).powi(2)).sum::<f64>();
            // What the noise of the paths adds is taken off.
            let noise = all[3] / (all[0] * all[0]);
            let off = |n: usize| {
                let squares = sums.iter().map(|of| (of[i][0] / all[0] - of[i][n] / all[n]).powi(2)).sum::<f64>();
                ((squares - noise).max(0.0) / mean).sqrt()
            };
            println!("{i}: all {all:.1?}; off by {:.4} without the map, {:.4} with it", off(1), off(2));
            assert!((all[2] / all[1] - 1.0).abs() < 0.005, "the mean over the cell: {all:?}");
            // Few paths leave dark fibers: what noise adds is known to 0.1 of the light.
            let limit = if i % MAPS == 0 { 0.35 } else { 0.7 };
            assert!(off(1) > 0.1 && off(2) < limit * off(1), "{} without the map, {} with it", off(1), off(2));
        }
    }
}
