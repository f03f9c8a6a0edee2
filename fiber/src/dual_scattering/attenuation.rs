//! Averages of a fiber's scattering over its azimuths, as functions of latitude: forward and backward shares,
//! their widths, and the light over the relative azimuth (Khungurn 2015, 3.1 and 5.1).

use super::lobe::{LobeTable, lobe_of_moments};
use super::{DualOptions, Stack, stack};
use crate::distributions::latitudes::{self, PARTS, cubic, measured, place};
use crate::range::{invalid, parameter};
use crate::{FiberModel, FiberQuery};
use plywave::frame::direction;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{PI, TAU};

/// Intervals between rows of light over the azimuth, on the axis of latitudes.
const ROWS: usize = 64;
/// Intervals of the relative azimuth from 0 to pi; an even number.
const AZIMUTHS: usize = 32;
/// Maximum error of a cubic through other latitudes at a measured a_f or a_b.
const MAX_MISSED: f64 = 5e-4;
const MODEL: &str = "dual scattering";

/// Averages over the azimuth at a latitude (Khungurn 2015, 3.1 and 5.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation<const N: usize> {
    /// a_f: share of the light that leaves on the far side, one for each wavelength.
    pub forward: [f32; N],
    /// a_b: share of the light that leaves on the near side, one for each wavelength.
    pub backward: [f32; N],
    /// Mean of theta_o + theta_i of forward light [rad], over all wavelengths together.
    pub forward_shift: f32,
    /// Standard deviation of theta_o + theta_i of forward light [rad].
    pub forward_width: f32,
    /// beta_f [rad]: width of the longitudinal lobe of forward light. It is the model's parameter of TT,
    /// whose lobe cos^2 narrows to `forward_width`. For a model without such a parameter it is the width of
    /// the Gaussian g whose light `g cos^2` has the mean and standard deviation above.
    pub forward_beta: f32,
    /// Mean of theta_o + theta_i of backward light [rad].
    pub backward_shift: f32,
    /// Standard deviation of theta_o + theta_i of backward light [rad].
    pub backward_width: f32,
}

impl<const N: usize> Attenuation<N> {
    const NONE: Attenuation<N> = Attenuation {
        forward: [0.0; N],
        backward: [0.0; N],
        forward_shift: 0.0,
        forward_width: 0.0,
        forward_beta: 0.0,
        backward_shift: 0.0,
        backward_width: 0.0,
    };

    /// The weighted sum of several averages; shares and widths are clamped to 0 or more.
    fn weighted(parts: &[(&Attenuation<N>, f64)]) -> Attenuation<N> {
        let sum = |of: &dyn Fn(&Attenuation<N>) -> f32| {
            parts.iter().map(|(a, weight)| weight * f64::from(of(a))).sum::<f64>() as f32
        };
        Attenuation {
            forward: std::array::from_fn(|n| sum(&|a| a.forward[n]).max(0.0)),
            backward: std::array::from_fn(|n| sum(&|a| a.backward[n]).max(0.0)),
            forward_shift: sum(&|a| a.forward_shift),
            forward_width: sum(&|a| a.forward_width).max(0.0),
            forward_beta: sum(&|a| a.forward_beta).max(0.0),
            backward_shift: sum(&|a| a.backward_shift),
            backward_width: sum(&|a| a.backward_width).max(0.0),
        }
    }

    /// Reflection and transmission of `count` layers, one for each wavelength.
    pub fn stack(&self, count: u32) -> [Stack; N] {
        std::array::from_fn(|n| stack(self.forward[n], self.backward[n], count))
    }

    /// sigma_b, the width of the neighbors' light [rad] (Khungurn 2015, 5.2), as printed, with the means of
    /// the shares over the wavelengths. The printed units are inconsistent: the denominator has widths where
    /// the numerator has roots of variances. Without backward light it is
    /// `(1 + 0.7 a_f^2) sqrt(2 beta_f^2 + beta_b^2)`, with the widths of forward and backward light.
    pub fn back_width(&self) -> f32 {
        let mean = |a: &[f32; N]| a.iter().sum::<f32>() / N.max(1) as f32;
        let (a_f, a_b) = (mean(&self.forward), mean(&self.backward));
        let (f, b) = (self.forward_width, self.backward_width);
        let (one, three) = ((2.0 * f * f + b * b).sqrt(), (2.0 * f * f + 3.0 * b * b).sqrt());
        let cube = a_b * a_b;
        (1.0 + 0.7 * a_f * a_f) * (one + cube * three) / (1.0 + cube * (2.0 * f + 3.0 * b))
    }
}

/// Light of a fiber in the azimuth `phi_o - phi_d`, for incident light spread over the half turn about phi_d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HalfTurn<const N: usize> {
    /// Energy [1/rad], one for each wavelength.
    pub(crate) energy: [f32; N],
    /// Center and width of the lobe in theta_o + theta_i [rad].
    pub(crate) shift: f32,
    pub(crate) width: f32,
}

impl<const N: usize> HalfTurn<N> {
    /// The weighted sum of several; energies and width are clamped to 0 or more.
    fn weighted(parts: &[(&HalfTurn<N>, f64)]) -> HalfTurn<N> {
        let sum = |of: &dyn Fn(&HalfTurn<N>) -> f32| {
            parts.iter().map(|(h, weight)| weight * f64::from(of(h))).sum::<f64>() as f32
        };
        HalfTurn {
            energy: std::array::from_fn(|n| sum(&|h| h.energy[n]).max(0.0)),
            shift: sum(&|h| h.shift),
            width: sum(&|h| h.width).max(0.0),
        }
    }

    fn mix(&self, other: &HalfTurn<N>, t: f32) -> HalfTurn<N> {
        let mut mixed = *self;
        (0..N).for_each(|n| mixed.energy[n] += t * (other.energy[n] - self.energy[n]));
        mixed.shift += t * (other.shift - self.shift);
        mixed.width += t * (other.width - self.width);
        mixed
    }
}

/// A fiber model prepared for dual scattering at N wavelengths.
///
/// ```
/// use plywave_fiber::dual_scattering::{DualOptions, DualScattering};
/// use plywave_fiber::{KhungurnFiber, KhungurnParameters};
/// use plywave::frame::direction;
/// use plywave_fiber::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let fiber: FiberModel = KhungurnFiber::new(KhungurnParameters::default())?.into();
/// let light = FiberQuery::new(direction(0.3, 0.0), [0.61, 0.55, 0.465]);
/// let dual = DualScattering::new(&fiber, &light, DualOptions { samples: 256, ..DualOptions::default() })?;
/// // A shadow ray that hit three fibers before it escaped, at these latitudes in their frames.
/// let mut occlusion = dual.unoccluded();
/// [0.3, 0.28, 0.33].map(|theta_d| occlusion.pass(&dual, theta_d, 1.0));
/// let at = dual.at(&fiber, &light, &occlusion);
/// assert!(at.eval(direction(-0.3, 3.0))[0] > 0.0);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DualScattering<const N: usize> {
    pub(crate) options: DualOptions,
    /// `[PARTS + 1]`: averages at the latitudes.
    latitudes: Vec<Attenuation<N>>,
    /// `[ROWS + 1][AZIMUTHS + 1]`: light in the relative azimuths.
    half_turns: Vec<HalfTurn<N>>,
    /// `[PARTS + 1]`: light of infinite neighbors.
    neighbors: Vec<HalfTurn<N>>,
    pub(crate) lobes: LobeTable,
}

impl<const N: usize> DualScattering<N> {
    /// Prepares a fiber model at the wavelengths and absorptions of a query, whose direction and offset are
    /// ignored.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if an option is outside its range, an input of the query is not finite, or
    /// the model scatters no light at all.
    pub fn new(model: &FiberModel, query: &FiberQuery<N>, options: DualOptions) -> Result<Self> {
        for value in query.lambda_um {
            parameter(MODEL, "lambda_um", value, [1e-3, 1e3])?;
        }
        for value in query.sigma_per_um {
            parameter(MODEL, "sigma_per_um", value, [0.0, 1e6])?;
        }
        let mut dual = Self::from_bsdf(|omega_i| model.at(&FiberQuery { omega_i, h_rel: None, ..*query }), options)?;
        if let Some(beta) = model.forward_beta() {
            dual.latitudes.iter_mut().for_each(|a| a.forward_beta = beta);
        }
        Ok(dual)
    }

    /// Prepares any scattering function of a fiber; `at` returns it for light from a direction.
    ///
    /// # Errors
    /// Those of [`DualScattering::new`].
    pub fn from_bsdf<B: Bsdf<N>>(at: impl Fn([f32; 3]) -> B, options: DualOptions) -> Result<Self> {
        parameter(MODEL, "forward_density", options.forward_density, [0.0, 1.0])?;
        parameter(MODEL, "backward_density", options.backward_density, [0.0, 1.0])?;
        if !(64..=1_000_000).contains(&options.samples) {
            return Err(invalid(MODEL, "samples", options.samples, "use 64 to 1000000".into()));
        }
        if !(1..=1000).contains(&options.turns) {
            return Err(invalid(MODEL, "turns", options.turns, "use 1 to 1000".into()));
        }
        let rows = measured(
            |theta_i| Measured::new(&at, theta_i, &options),
            |row| row.averages.forward.iter().chain(&row.averages.backward).map(|x| f64::from(*x)).collect(),
            // With few samples, more nodes would not reduce the error.
            (8.0 / f64::from(options.samples)).max(MAX_MISSED),
        );
        if rows.iter().all(|(_, row)| row.averages.forward.iter().chain(&row.averages.backward).all(|x| *x == 0.0)) {
            return Err(invalid(MODEL, "albedo", 0, "the fiber scatters no light at these wavelengths".into()));
        }
        let latitudes: Vec<Attenuation<N>> = (0..=PARTS)
            .map(|node| Attenuation::weighted(&cubic(&rows, node).map(|(k, weight)| (&rows[k].1.averages, weight))))
            .collect();
        let neighbor = |a: &Attenuation<N>| HalfTurn {
            energy: std::array::from_fn(|n| options.backscattering.sum(a.forward[n], a.backward[n])),
            shift: 0.0,
            width: a.back_width(),
        };
        let half_turn = |k: usize| {
            let (row, d) = (k / (AZIMUTHS + 1), k % (AZIMUTHS + 1));
            let nodes = cubic(&rows, row * (PARTS / ROWS));
            HalfTurn::weighted(&nodes.map(|(k, weight)| (&rows[k].1.half_turns[d], weight)))
        };
        Ok(DualScattering {
            options,
            neighbors: latitudes.iter().map(neighbor).collect(),
            half_turns: (0..(ROWS + 1) * (AZIMUTHS + 1)).map(half_turn).collect(),
            latitudes,
            lobes: LobeTable::new(),
        })
    }

    /// Averages at a latitude [rad]. At the default number of samples a_f and a_b are accurate to 5e-4.
    pub fn attenuation(&self, theta: f32) -> Attenuation<N> {
        let (k, t) = place(theta, PARTS);
        let (a, b) = (&self.latitudes[k], &self.latitudes[k + 1]);
        let mix = |x: f32, y: f32| x + (y - x) * t;
        Attenuation {
            forward: std::array::from_fn(|n| mix(a.forward[n], b.forward[n])),
            backward: std::array::from_fn(|n| mix(a.backward[n], b.backward[n])),
            forward_shift: mix(a.forward_shift, b.forward_shift),
            forward_width: mix(a.forward_width, b.forward_width),
            forward_beta: mix(a.forward_beta, b.forward_beta),
            backward_shift: mix(a.backward_shift, b.backward_shift),
            backward_width: mix(a.backward_width, b.backward_width),
        }
    }

    /// Slope of `forward_shift` over the latitude.
    pub(crate) fn shift_slope(&self, theta: f32) -> f32 {
        let (k, _) = place(theta, PARTS);
        let rise = self.latitudes[k + 1].forward_shift - self.latitudes[k].forward_shift;
        rise / (latitudes::latitude(k + 1) - latitudes::latitude(k))
    }

    /// A_b at a latitude, one for each wavelength; linear between the nodes of the table.
    pub fn backscattered(&self, theta: f32) -> [f32; N] {
        self.neighbors(theta).energy
    }

    /// Share of the light that infinite layers reflect, `a_b + A_b`, one for each wavelength: the reflectance
    /// of a thick swatch of aligned fibers.
    pub fn reflectance(&self, theta: f32) -> [f32; N] {
        let a = self.attenuation(theta);
        let neighbors = self.backscattered(theta);
        std::array::from_fn(|n| a.backward[n] + neighbors[n])
    }

    pub(crate) fn half_turn(&self, theta: f32, azimuth: f32) -> HalfTurn<N> {
        let (k, t) = place(theta, ROWS);
        let at = azimuth / PI * AZIMUTHS as f32;
        let d = (at as usize).min(AZIMUTHS - 1);
        let s = (at - d as f32).min(1.0);
        let row = |k: usize| {
            let nodes = &self.half_turns[k * (AZIMUTHS + 1) + d..][..2];
            nodes[0].mix(&nodes[1], s)
        };
        row(k).mix(&row(k + 1), t)
    }

    /// Light of infinite neighbors at a latitude: A_b in `energy`, and sigma_b in `width`.
    pub(crate) fn neighbors(&self, theta: f32) -> HalfTurn<N> {
        let (k, t) = place(theta, PARTS);
        self.neighbors[k].mix(&self.neighbors[k + 1], t)
    }
}

/// Measured scattering of light from one latitude.
struct Measured<const N: usize> {
    averages: Attenuation<N>,
    /// `[AZIMUTHS + 1]`: light in the relative azimuths.
    half_turns: Vec<HalfTurn<N>>,
}

impl<const N: usize> Measured<N> {
    fn new<B: Bsdf<N>>(at: &impl Fn([f32; 3]) -> B, theta_i: f32, options: &DualOptions) -> Measured<N> {
        let turns = options.turns;
        let each = options.samples.div_ceil(turns);
        let mut sides = [Moments::<N>::default(); 2];
        let mut albedo = [0.0; N];
        // Sums over each interval of the relative azimuth.
        let mut parts = [Moments::<N>::default(); AZIMUTHS];
        for turn in 0..turns {
            let phi_i = TAU * turn as f32 / turns as f32;
            let bsdf = at(direction(theta_i, phi_i));
            let (scattered, straight) = (bsdf.albedo(), bsdf.straight());
            (0..N).for_each(|n| albedo[n] += scattered[n] + straight[n]);
            for k in 0..each {
                let (w, weight) = match bsdf.sample(low_discrepancy(k, each, turn)) {
                    BsdfSample::Scattered(light) => (light.w, light.weight),
                    // Straight light passes the fiber.
                    BsdfSample::Straight { weight, .. } => (direction(-theta_i, phi_i + PI), weight),
                    BsdfSample::Absorbed => continue,
                };
                let along = w[2].clamp(-1.0, 1.0).asin() + theta_i;
                let relative = w[1].atan2(w[0]) - phi_i;
                let relative = (relative - TAU * (relative / TAU).round()).abs();
                // With phi_d anywhere in the near half turn, the probability that light leaves on that side
                // is 1 - |relative|/pi.
                let ahead = relative / PI;
                sides[0].add(&weight, ahead, along);
                sides[1].add(&weight, 1.0 - ahead, along);
                parts[((ahead * AZIMUTHS as f32) as usize).min(AZIMUTHS - 1)].add(&weight, 1.0, along);
            }
        }
        let [forward, backward] = &sides;
        // The samples give the directions of light, the model its total energy: an error of a lossless
        // fiber's albedo would change the full sum by its root.
        let total = (0..N).map(|n| forward.energy[n] + backward.energy[n]);
        let mut scale = [0.0; N];
        for (n, total) in total.enumerate() {
            let light = f64::from(albedo[n]) / f64::from(turns);
            scale[n] = if total > 0.0 && light.is_finite() { light / total } else { 0.0 };
        }
        let ([forward_shift, forward_width], [backward_shift, backward_width]) = (forward.spread(), backward.spread());
        let lobe = |[shift, width]: [f32; 2]| lobe_of_moments(f64::from(shift) - f64::from(theta_i), f64::from(width));
        let averages = Attenuation {
            forward: forward.energy(&scale),
            backward: backward.energy(&scale),
            forward_shift,
            forward_width,
            forward_beta: lobe([forward_shift, forward_width])[1] as f32,
            backward_shift,
            backward_width,
        };
        let half_turn = |d: usize| {
            let light = half_turn(&parts, d);
            let [middle, width] = lobe(light.spread());
            // The light of the intervals is spread over the half turn, on both sides.
            let energy = light.energy(&scale).map(|e| 0.5 * e / PI);
            HalfTurn { energy, shift: middle as f32 + theta_i, width: width as f32 }
        };
        Measured { averages, half_turns: (0..=AZIMUTHS).map(half_turn).collect() }
    }
}

/// Spreads light at `phi_o - phi_i` over `phi_o - phi_d` within a quarter turn, in both directions, and
/// returns its part at node `d`.
fn half_turn<const N: usize>(parts: &[Moments<N>; AZIMUTHS], d: usize) -> Moments<N> {
    const QUARTER: usize = AZIMUTHS / 2;
    let mut sum = Moments::default();
    for (k, part) in parts.iter().enumerate() {
        // |relative - delta| and |relative + delta|; the latter may wrap around.
        let near = (k + QUARTER >= d && k < d + QUARTER) as u8;
        let across = (k + d < QUARTER || k + d >= AZIMUTHS + QUARTER) as u8;
        sum.merge(part, f64::from(near + across));
    }
    sum
}

/// `count` points that fill the cube evenly (Hammersley points with Sobol's second dimension), shifted for
/// each rotation of a fiber.
fn low_discrepancy(k: u32, count: u32, turn: u32) -> [f32; 3] {
    const PER_TURN: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_1];
    const WHOLE: f64 = 4_294_967_296.0;
    let (mut second, mut direction, mut bits) = (0u32, 1u32 << 31, k);
    while bits != 0 {
        if bits & 1 == 1 {
            second ^= direction;
        }
        bits >>= 1;
        direction ^= direction >> 1;
    }
    let half = 0.5 / f64::from(count);
    let point = [f64::from(k.reverse_bits()) / WHOLE, f64::from(second) / WHOLE, f64::from(k) / f64::from(count)];
    std::array::from_fn(|j| {
        let moved = (point[j] + half + f64::from(turn) * PER_TURN[j]).fract() as f32;
        moved.min(1.0 - f32::EPSILON / 2.0)
    })
}

/// Sums over samples.
#[derive(Clone, Copy, Debug)]
struct Moments<const N: usize> {
    energy: [f64; N],
    /// Sums over all wavelengths of light, light times t, and light times t^2, where t is theta_o + theta_i.
    along: [f64; 3],
}

impl<const N: usize> Default for Moments<N> {
    fn default() -> Self {
        Moments { energy: [0.0; N], along: [0.0; 3] }
    }
}

impl<const N: usize> Moments<N> {
    fn add(&mut self, weight: &[f32; N], share: f32, t: f32) {
        let (share, t) = (f64::from(share), f64::from(t));
        let mut sum = 0.0;
        for n in 0..N {
            let light = share * f64::from(weight[n]);
            self.energy[n] += light;
            sum += light;
        }
        self.along[0] += sum;
        self.along[1] += sum * t;
        self.along[2] += sum * t * t;
    }

    fn merge(&mut self, other: &Moments<N>, times: f64) {
        (0..N).for_each(|n| self.energy[n] += times * other.energy[n]);
        (0..3).for_each(|k| self.along[k] += times * other.along[k]);
    }

    fn energy(&self, scale: &[f64; N]) -> [f32; N] {
        std::array::from_fn(|n| (self.energy[n] * scale[n]) as f32)
    }

    /// Mean and standard deviation of t; 0 if there is no light.
    fn spread(&self) -> [f32; 2] {
        let [light, first, second] = self.along;
        if light <= 0.0 || light.is_nan() {
            return [0.0; 2];
        }
        let mean = first / light;
        [mean as f32, (second / light - mean * mean).max(0.0).sqrt() as f32]
    }
}

impl<const N: usize> Default for Attenuation<N> {
    fn default() -> Self {
        Attenuation::NONE
    }
}
