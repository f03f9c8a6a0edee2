//! One scattering event of a path from ply to ply, and the energies that the path carries.
//!
//! The direction is sampled from the ply's model, and the point of exit from the model's exit distributions.
//! Paths are drawn for clear fibers; the energy at each node of absorption follows as a weight. `follow.rs`
//! intersects the path with the plies.

use super::drift::Drift;
use plywave::PlyModel;
use plywave::cloth::light::{MAP_NODES, MAPS, SIGMA_PER_UM, SIGMAS};
use plywave::cloth::shade::{ClothShade, Toward};
use plywave::ply::ExitsAt;

/// Maximum scattering order: a path ends after so many plies.
const MAX_ORDERS: usize = 64;
/// Bound of f over the density of its samples; rejection sampling divides by it.
const MAX_OVER: f32 = 2.0;
/// Sampled outgoing directions of the first ply, from which its occluded and scattered energies are found.
const FIRSTS: usize = 4;
/// Steps of a low-discrepancy sequence in three dimensions (Roberts 2018).
const EVEN: [f32; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
/// Maximum number of directions drawn until one is accepted.
const MAX_DRAWN: usize = 100;
/// Largest tangent of a latitude, for light almost along a ply.
const MAX_TAN: f32 = 6.0;
/// Remaining weight below which a path is dropped.
const MIN_WEIGHT: f32 = 1e-4;

/// State of a path through the cloth; complete once the light has left the cloth.
pub(super) struct Escaped {
    /// Number of plies that scattered the path.
    pub orders: usize,
    /// Class of the first ply.
    pub class: usize,
    /// Whether the first ply scattered the path to the side that it came from.
    pub sent_up: bool,
    /// Whether the path leaves the cloth on the side that it came from.
    pub up: bool,
    /// Direction in which the path leaves.
    pub d: [f32; 3],
    /// Kinds of yarns that have scattered the path, one bit each.
    pub kinds: u8,
    /// `[warp, weft][sigma]`: remaining weight after absorption in the yarns of that kind.
    pub weight: [[f32; SIGMAS]; 2],
    /// `[sigma]`: remaining weight after the first ply.
    pub first: [f32; SIGMAS],
    /// Place on the first ply, if a ply scattered the path first.
    pub at: Option<FirstPlace>,
    /// `[sent up, down][sigma]`: energy that the first ply scatters and other yarns occlude, by the table of
    /// shadows.
    pub caught: [[f32; SIGMAS]; 2],
    /// `[sigma]`: all energy that the first ply scatters.
    pub scattered: [f32; SIGMAS],
}

/// Place on its first ply at which a path enters.
#[derive(Clone, Copy)]
pub(super) struct FirstPlace {
    /// Tables of shadows of the two places around it, and the position between them.
    pub tables: ([usize; 2], f32),
    /// Angle about the axis [turns].
    pub angle: f32,
    /// Energy that the ply scatters, over that of clear fibers, at the nodes of the map over places.
    pub energy: [f32; MAPS],
}

/// A ply that scatters a path, with the path's incidence on it.
pub(super) struct Scattered<'a> {
    pub model: &'a PlyModel,
    pub drift: Option<&'a Drift>,
    pub theta_i: f32,
    pub h_um: f32,
    pub radius_um: f32,
    pub frame: [[f32; 3]; 3],
    /// 0 for the warp or the only kind of yarn, 1 for the weft.
    pub kind: usize,
}

impl Escaped {
    /// A path that has hit no ply yet.
    pub(super) fn new() -> Escaped {
        Escaped {
            orders: 0,
            class: 0,
            sent_up: false,
            up: false,
            d: [0.0; 3],
            kinds: 0,
            weight: [[1.0; SIGMAS]; 2],
            first: [1.0; SIGMAS],
            at: None,
            caught: [[0.0; SIGMAS]; 2],
            scattered: [0.0; SIGMAS],
        }
    }

    /// Whether the path ends: its remaining weight is negligible or it has reached the maximum order.
    pub(super) fn is_over(&self) -> bool {
        let max = self.weight.iter().map(|w| w.iter().fold(0.0f32, |m, v| m.max(*v))).product::<f32>();
        self.orders >= MAX_ORDERS || max < MIN_WEIGHT
    }

    /// Scatters the path, which entered the cloth from direction `a`, at a ply into the new direction `d`.
    ///
    /// Returns `(t, s)`, both over the ply's radius R: the new line passes the axis at the offset `-t` along
    /// `d cross z`, and is nearest to it at `s` along the curve. Returns `None` if no direction is accepted.
    /// `first` is the class, the shadows and the angle of incidence about the axis of a first ply, whose
    /// occluded and scattered energies are then sampled; a path that is not followed ends there.
    /// `passes` is the transmittance of the layer of hairs in a direction.
    pub(super) fn scatter(
        &mut self,
        scattered: &Scattered<'_>,
        first: Option<(usize, ClothShade<'_>, f32)>,
        (a, is_followed): ([f32; 3], bool),
        d: &mut [f32; 3],
        passes: &dyn Fn([f32; 3]) -> f32,
        number: &mut dyn FnMut() -> f32,
    ) -> Option<(f32, f32)> {
        let Scattered { model, drift, theta_i, h_um, radius_um, frame, kind } = *scattered;
        // Paths are drawn for the clear fibers of the first node, whose energy is then conserved; the
        // weights of the other nodes are at most 1.
        let ply = model.by_first(theta_i, h_um, SIGMA_PER_UM);
        let energy = ply.albedo()[0].max(1e-12);
        let per_mean = 1.0 / (MAX_OVER * energy);
        let per_sample = 1.0 / (FIRSTS as f32 * energy);
        let exits = model.exits_at(theta_i, h_um, radius_um);
        let clear_shares = SIGMA_PER_UM.map(ExitsAt::clear_share);
        let to_cloth = |w: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| frame[0][i] * w[0] + frame[1][i] * w[1] + frame[2][i] * w[2])
        };
        if let Some((class, shade, angle)) = first {
            self.class = class;
            let energies = ply.albedo();
            self.at = Some(FirstPlace {
                tables: shade.tables(),
                angle,
                energy: MAP_NODES.map(|node| energies[node] / energy),
            });
            // A low-discrepancy sequence with a random shift; weights of f over the density correct for it.
            let turn = [number(), number(), number()];
            for i in 0..FIRSTS {
                let u = std::array::from_fn(|n| (turn[n] + i as f32 * EVEN[n]).fract());
                let Some((w, light)) = ply.sample(u) else { continue };
                let d = to_cloth(w);
                let free =
                    shade.toward(&Toward::new(d), model.exit_shapes(), exits.lines(w)).map(|free| free * passes(d));
                let (clear, per) = (light.refl[0] + light.high[0], per_sample / light.pdf);
                for k in 0..SIGMAS {
                    let share = clear_shares[k];
                    let all = (light.refl[k] + light.high[k]).min(clear);
                    let out = light.refl[k] * free[0] + light.high[k] * (free[2] + share * (free[1] - free[2]));
                    self.scattered[k] += per * all;
                    self.caught[usize::from(d[2] * a[2] < 0.0)][k] += per * (all - out);
                }
            }
        }
        if !is_followed {
            self.orders = 1;
            return Some((0.0, 0.0));
        }
        // Directions are drawn with a density close to f and accepted in proportion to f over it, since
        // weights would add noise.
        let (w, light) = (0..MAX_DRAWN).find_map(|_| {
            let (w, light) = ply.sample([number(), number(), number()])?;
            (number() * light.pdf <= (light.refl[0] + light.high[0]) * per_mean).then_some((w, light))
        })?;
        let (lines, [refl, high]) = (exits.lines(w), [light.refl[0], light.high[0]]);
        *d = to_cloth(w);
        if self.orders == 0 {
            self.sent_up = d[2] * a[2] > 0.0;
            self.first = std::array::from_fn(|k| ((light.refl[k] + light.high[k]) / (refl + high)).min(1.0));
        }
        self.orders += 1;
        self.kinds |= 1 << kind;
        let density = |kind: usize| model.exit_shapes()[kind].density(lines[kind].mean);
        if number() * (refl + high) < refl {
            return Some((density(0).draw(number()), lines[0].s));
        }
        // Offset and displacement are drawn for clear fibers; the weights of the other nodes follow from the
        // ratio.
        let [clear, dark] = [1, 2].map(density);
        let t = clear.draw(number());
        let dark = dark.at(t) / clear.at(t);
        let drift = drift.map(|drift| drift.draw(theta_i, w[2], [number(), number()]));
        let drift_weights = drift.map_or([1.0; SIGMAS], |drift| drift.weights);
        for (k, weight) in self.weight[kind].iter_mut().enumerate() {
            *weight *=
                (light.high[k] / high).min(1.0) * (clear_shares[k] + (1.0 - clear_shares[k]) * dark) * drift_weights[k];
        }
        // Displacements run between the points at which lines cross the cylinder, each half a chord from
        // where its line is nearest to the axis.
        let half_chord = |t: f32, axial: f32| {
            let across = (1.0 - axial * axial).max(1.0 / (1.0 + MAX_TAN * MAX_TAN)).sqrt();
            (1.0 - t * t).max(0.0).sqrt() * axial / across
        };
        let displaced = drift.map_or(0.0, |drift| drift.over_r);
        Some((t, half_chord(h_um / radius_um, theta_i.sin()) + displaced - half_chord(t, w[2])))
    }
}
