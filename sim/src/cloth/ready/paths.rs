//! A path of light from ply to ply.
//!
//! A ply scatters as its model says; light leaves it as the model's exits lie; a line that passes a ply's rim
//! goes on. `follow.rs` finds the plies.

use plywave::PlyModel;
use plywave::cloth::making::{ClothShade, SIGMA_PER_UM, SIGMAS, Toward};
use plywave::ply::ExitsAt;

/// Most plies that scatter a path.
const MAX_ORDERS: usize = 64;
/// What f has over the density of its samples, at most.
const MAX_OVER: f32 = 2.0;
/// Directions of the first ply's light that are looked at.
const FIRSTS: usize = 4;
/// Steps of an even sequence of three numbers (Roberts 2018).
const EVEN: [f32; 3] = [0.819_172_5, 0.671_043_6, 0.549_700_5];
/// Most directions drawn for one that is kept.
const MAX_DRAWN: usize = 100;
/// A path of less energy is dropped.
const MIN_WEIGHT: f32 = 1e-4;

/// Light that has left the cloth.
pub(super) struct Escaped {
    /// Plies that scattered it.
    pub orders: usize,
    /// Class of the first ply; whether it sent the light up.
    pub class: usize,
    pub sent_up: bool,
    pub up: bool,
    /// Its direction, and the kinds of yarns that have scattered it, a bit each.
    pub d: [f32; 3],
    pub kinds: u8,
    /// Energies by node of absorption, of what the warp and what the weft leave of it.
    pub weight: [[f32; SIGMAS]; 2],
    /// What the first ply left of it.
    pub first: [f32; SIGMAS],
    /// Means over directions that the first ply may send light in: `[sent up, down]`, what other yarns catch
    /// by the table of shadows, and all that it scatters.
    pub caught: [[f32; SIGMAS]; 2],
    pub scattered: [f32; SIGMAS],
}

/// A ply that scatters a path.
pub(super) struct Scattered<'a> {
    pub model: &'a PlyModel,
    pub theta_i: f32,
    pub h_um: f32,
    pub radius_um: f32,
    pub frame: [[f32; 3]; 3],
    /// 0 for the warp or the only kind of yarn, 1 for the weft.
    pub kind: usize,
}

impl Escaped {
    /// A path that has met nothing yet.
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
            caught: [[0.0; SIGMAS]; 2],
            scattered: [0.0; SIGMAS],
        }
    }

    /// Whether nothing that counts is left of it, or it has gone on for long enough.
    pub(super) fn is_over(&self) -> bool {
        let most = self.weight.iter().map(|w| w.iter().fold(0.0f32, |m, v| m.max(*v))).product::<f32>();
        self.orders >= MAX_ORDERS || most < MIN_WEIGHT
    }

    /// A ply scatters the path, which comes from direction `a`, into direction `d`. Returns the offset over R
    /// at which the new line passes the ply's axis, `-t` along `d cross z`, and how far along the axis;
    /// `None` where no direction is found. `first` is the class and the shadows of a first ply, of which the
    /// light is looked at; a path that is not followed ends there. `passes` is the share of light in a
    /// direction that passes the hairs.
    pub(super) fn scatter(
        &mut self,
        scattered: &Scattered<'_>,
        first: Option<(usize, ClothShade<'_>)>,
        (a, is_followed): ([f32; 3], bool),
        d: &mut [f32; 3],
        passes: &dyn Fn([f32; 3]) -> f32,
        number: &mut dyn FnMut() -> f32,
    ) -> Option<(f32, f32)> {
        let Scattered { model, theta_i, h_um, radius_um, frame, kind } = *scattered;
        // Drawn for clear fibers, the first node's: their light is then neither lost nor made, and that of
        // others is less.
        let ply = model.by_first(theta_i, h_um, SIGMA_PER_UM);
        let energy = ply.albedo()[0].max(1e-12);
        let per_mean = 1.0 / (MAX_OVER * energy);
        let looks = 1.0 / (FIRSTS as f32 * energy);
        let exits = model.exits_at(theta_i, h_um, radius_um);
        let clear_shares = SIGMA_PER_UM.map(ExitsAt::clear_share);
        let to_cloth = |w: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| frame[0][i] * w[0] + frame[1][i] * w[1] + frame[2][i] * w[2])
        };
        if let Some((class, shade)) = first {
            self.class = class;
            // An even sequence, turned at random; what the density lacks is made good by weights.
            let turn = [number(), number(), number()];
            for i in 0..FIRSTS {
                let u = std::array::from_fn(|n| (turn[n] + i as f32 * EVEN[n]).fract());
                let Some((w, light)) = ply.sample(u) else { continue };
                let d = to_cloth(w);
                let free =
                    shade.toward(&Toward::new(d), exits.lines(model.exit_shapes(), w)).map(|free| free * passes(d));
                let (most, per) = (light.refl[0] + light.high[0], looks / light.pdf);
                for k in 0..SIGMAS {
                    let share = clear_shares[k];
                    let all = (light.refl[k] + light.high[k]).min(most);
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
        // Directions are drawn with a density near to f, and kept by what f has over it: weights would be
        // noise.
        let (w, light) = (0..MAX_DRAWN).find_map(|_| {
            let (w, light) = ply.sample([number(), number(), number()])?;
            (number() * light.pdf <= (light.refl[0] + light.high[0]) * per_mean).then_some((w, light))
        })?;
        let (lines, [refl, high]) = (exits.lines(model.exit_shapes(), w), [light.refl[0], light.high[0]]);
        *d = to_cloth(w);
        if self.orders == 0 {
            self.sent_up = d[2] * a[2] > 0.0;
            self.first = std::array::from_fn(|k| ((light.refl[k] + light.high[k]) / (refl + high)).min(1.0));
        }
        self.orders += 1;
        self.kinds |= 1 << kind;
        let density = |kind: usize| lines[kind].density;
        if number() * (refl + high) < refl {
            return Some((density(0).draw(number()), lines[0].s));
        }
        // Drawn for clear fibers.
        let [clear, dark] = [1, 2].map(density);
        let t = clear.draw(number());
        let dark = dark.at(t) / clear.at(t);
        for (k, weight) in self.weight[kind].iter_mut().enumerate() {
            *weight *= (light.high[k] / high).min(1.0) * (clear_shares[k] + (1.0 - clear_shares[k]) * dark);
        }
        Some((t, lines[1].s))
    }
}
