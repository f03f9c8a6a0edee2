//! What a fiber does to light on the average over its azimuths, by latitude: how much it sends on and back, how wide, and its light over the relative azimuth.

use super::lobe::{LobeTable, lobe_of_moments};
use super::{DualBsdf, DualOptions, Occlusion, Stack, stack};
use crate::fiber::range::{invalid, parameter};
use crate::fiber::{FiberModel, FiberQuery};
use crate::frame::direction;
use crate::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Latitudes of the tables: centers of equal parts, the equator among them.
const LATITUDES: usize = 35;
/// Nodes of the relative azimuth from 0 to pi.
const AZIMUTHS: usize = 33;
const MODEL: &str = "dual scattering";

/// Averages over the azimuth at a latitude (Khungurn 2015, 3.1 and 5.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation<const N: usize> {
    /// a_f, share of the light that leaves on the far side, by wavelength.
    pub forward: [f32; N],
    /// a_b, on the near side.
    pub backward: [f32; N],
    /// Mean of theta_o + theta_i of the light that goes on, and its standard deviation [rad]; of all wavelengths together.
    pub forward_shift: f32,
    /// See there.
    pub forward_width: f32,
    /// Of the light that goes back.
    pub backward_shift: f32,
    /// See there.
    pub backward_width: f32,
}

impl<const N: usize> Attenuation<N> {
    const NONE: Attenuation<N> = Attenuation {
        forward: [0.0; N],
        backward: [0.0; N],
        forward_shift: 0.0,
        forward_width: 0.0,
        backward_shift: 0.0,
        backward_width: 0.0,
    };

    /// Light on `count` layers: what comes back and what passes, by wavelength.
    pub fn stack(&self, count: u32) -> [Stack; N] {
        std::array::from_fn(|n| stack(self.forward[n], self.backward[n], count))
    }

    /// sigma_b, the width of the neighbors' light [rad] (Khungurn 2015, 5.2): as printed, with means of the shares over the wavelengths. Its units do not agree: the denominator holds widths
    /// where the numerator has roots of variances. Where no light goes back it is `(1 + 0.7 a_f^2) sqrt(2 beta_f^2 + beta_b^2)`, of the widths of what goes on and back.
    pub fn back_width(&self) -> f32 {
        let mean = |a: &[f32; N]| a.iter().sum::<f32>() / N.max(1) as f32;
        let (a_f, a_b) = (mean(&self.forward), mean(&self.backward));
        let (f, b) = (self.forward_width, self.backward_width);
        let (one, three) = ((2.0 * f * f + b * b).sqrt(), (2.0 * f * f + 3.0 * b * b).sqrt());
        let cube = a_b * a_b;
        (1.0 + 0.7 * a_f * a_f) * (one + cube * three) / (1.0 + cube * (2.0 * f + 3.0 * b))
    }
}

/// Light of a fiber over the azimuth `phi_o - phi_d` where its incident light is spread over the half turn about phi_d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HalfTurn<const N: usize> {
    /// Energy [1/rad].
    pub(crate) energy: [f32; N],
    /// Middle of theta_o + theta_i and width of its lobe [rad].
    pub(crate) shift: f32,
    pub(crate) width: f32,
}

impl<const N: usize> HalfTurn<N> {
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
/// use plywave::fiber::dual_scattering::{DualOptions, DualScattering};
/// use plywave::fiber::{KhungurnFiber, KhungurnParameters};
/// use plywave::frame::direction;
/// use plywave::{FiberModel, FiberQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let fiber: FiberModel = KhungurnFiber::new(KhungurnParameters::default())?.into();
/// let light = FiberQuery::new(direction(0.3, 0.0), [0.61, 0.55, 0.465]);
/// let dual = DualScattering::new(&fiber, &light, DualOptions { samples: 256, ..DualOptions::default() })?;
/// // A shadow ray that met three fibers before it left, at the latitudes in their frames.
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
    latitudes: Vec<Attenuation<N>>,
    /// `[LATITUDES][AZIMUTHS]`.
    half_turns: Vec<HalfTurn<N>>,
    /// `[LATITUDES]`.
    neighbors: Vec<HalfTurn<N>>,
    pub(crate) lobes: LobeTable,
}

impl<const N: usize> DualScattering<N> {
    /// Of a fiber model at the wavelengths and absorptions of a query; its direction and offset do not matter.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for an option outside its range, a query that is not finite, or a model that scatters no light at all.
    pub fn new(model: &FiberModel, query: &FiberQuery<N>, options: DualOptions) -> Result<Self> {
        for value in query.lambda_um {
            parameter(MODEL, "lambda_um", value, [1e-3, 1e3])?;
        }
        for value in query.sigma_per_um {
            parameter(MODEL, "sigma_per_um", value, [0.0, 1e6])?;
        }
        Self::of(|omega_i| model.at(&FiberQuery { omega_i, h_rel: None, ..*query }), options)
    }

    /// Of any scattering function of a fiber: `at` gives it for light from a direction.
    ///
    /// # Errors
    /// As [`DualScattering::new`].
    pub fn of<B: Bsdf<N>>(at: impl Fn([f32; 3]) -> B, options: DualOptions) -> Result<Self> {
        parameter(MODEL, "forward_density", options.forward_density, [0.0, 1.0])?;
        parameter(MODEL, "backward_density", options.backward_density, [0.0, 1.0])?;
        if !(64..=1_000_000).contains(&options.samples) {
            return Err(invalid(MODEL, "samples", options.samples, "use 64 to 1000000".into()));
        }
        if !(1..=1000).contains(&options.turns) {
            return Err(invalid(MODEL, "turns", options.turns, "use 1 to 1000".into()));
        }
        let mut dual = DualScattering {
            options,
            latitudes: Vec::with_capacity(LATITUDES),
            half_turns: Vec::with_capacity(LATITUDES * AZIMUTHS),
            neighbors: Vec::with_capacity(LATITUDES),
            lobes: LobeTable::new(),
        };
        for k in 0..LATITUDES {
            let theta_i = (k as f32 + 0.5) / LATITUDES as f32 * PI - FRAC_PI_2;
            dual.measure(&at, theta_i);
        }
        if dual.latitudes.iter().all(|a| a.forward.iter().chain(&a.backward).all(|x| *x == 0.0)) {
            return Err(invalid(MODEL, "albedo", 0, "the fiber scatters no light at these wavelengths".into()));
        }
        Ok(dual)
    }

    /// Adds the tables' row of a latitude.
    fn measure<B: Bsdf<N>>(&mut self, at: &impl Fn([f32; 3]) -> B, theta_i: f32) {
        let DualOptions { samples, turns, .. } = self.options;
        let each = samples.div_ceil(turns);
        let mut sides = [Moments::<N>::default(), Moments::default()];
        let mut albedo = [0.0; N];
        let mut azimuths = vec![Moments::<N>::default(); AZIMUTHS];
        for turn in 0..turns {
            let phi_i = TAU * turn as f32 / turns as f32;
            let bsdf = at(direction(theta_i, phi_i));
            let (scattered, straight) = (bsdf.albedo(), bsdf.straight());
            (0..N).for_each(|n| albedo[n] += scattered[n] + straight[n]);
            for k in 0..each {
                let (w, weight) = match bsdf.sample(low_discrepancy(turn * each + k)) {
                    BsdfSample::Scattered(light) => (light.w, light.weight),
                    // Straight on: a fiber that lets light pass.
                    BsdfSample::Straight { weight, .. } => (direction(-theta_i, phi_i + PI), weight),
                    BsdfSample::Absorbed => continue,
                };
                let theta_o = w[2].clamp(-1.0, 1.0).asin();
                let relative = w[1].atan2(w[0]) - phi_i;
                let relative = (relative - TAU * (relative / TAU).round()).abs();
                // Of phi_d over the near half turn the light leaves on that side with the chance 1 - |relative|/pi.
                let ahead = relative / PI;
                sides[0].add(&weight, ahead, theta_o + theta_i);
                sides[1].add(&weight, 1.0 - ahead, theta_o + theta_i);
                for (d, azimuth) in azimuths.iter_mut().enumerate() {
                    // Light at phi_o - phi_i is spread over phi_o - phi_d within a quarter turn, either way around.
                    let delta = PI * d as f32 / (AZIMUTHS - 1) as f32;
                    let near = |x: f32| (x - TAU * (x / TAU).round()).abs() < FRAC_PI_2;
                    let count = f32::from(u8::from(near(relative - delta)) + u8::from(near(relative + delta)));
                    if count > 0.0 {
                        azimuth.add(&weight, 0.5 * count / PI, theta_o + theta_i);
                    }
                }
            }
        }
        let [forward, backward] = &sides;
        // The samples tell where light goes, the model how much there is: the full sum feels an error of a lossless fiber's albedo by its root.
        let total = (0..N).map(|n| forward.energy[n] + backward.energy[n]);
        let mut scale = [0.0; N];
        for (n, total) in total.enumerate() {
            let light = f64::from(albedo[n]) / f64::from(turns);
            scale[n] = if total > 0.0 && light.is_finite() { light / total } else { 0.0 };
        }
        let ([forward_shift, forward_width], [backward_shift, backward_width]) = (forward.spread(), backward.spread());
        self.latitudes.push(Attenuation {
            forward: forward.energy(&scale),
            backward: backward.energy(&scale),
            forward_shift,
            forward_width,
            backward_shift,
            backward_width,
        });
        let a = &self.latitudes[self.latitudes.len() - 1];
        let sum = self.options.backscattering;
        let energy = std::array::from_fn(|n| sum.sum(a.forward[n], a.backward[n]));
        self.neighbors.push(HalfTurn { energy, shift: 0.0, width: a.back_width() });
        for azimuth in &azimuths {
            let [shift, width] = azimuth.spread().map(f64::from);
            let [middle, width] = lobe_of_moments(shift - f64::from(theta_i), width);
            self.half_turns.push(HalfTurn {
                energy: azimuth.energy(&scale),
                shift: middle as f32 + theta_i,
                width: width as f32,
            });
        }
    }

    /// Averages at a latitude [rad], linear between the tables'.
    pub fn attenuation(&self, theta: f32) -> Attenuation<N> {
        let (k, t) = place(theta);
        let (a, b) = (&self.latitudes[k], &self.latitudes[k + 1]);
        let mix = |x: f32, y: f32| x + (y - x) * t;
        Attenuation {
            forward: std::array::from_fn(|n| mix(a.forward[n], b.forward[n])),
            backward: std::array::from_fn(|n| mix(a.backward[n], b.backward[n])),
            forward_shift: mix(a.forward_shift, b.forward_shift),
            forward_width: mix(a.forward_width, b.forward_width),
            backward_shift: mix(a.backward_shift, b.backward_shift),
            backward_width: mix(a.backward_width, b.backward_width),
        }
    }

    /// Slope of `forward_shift` over the latitude.
    pub(crate) fn shift_slope(&self, theta: f32) -> f32 {
        let (k, _) = place(theta);
        (self.latitudes[k + 1].forward_shift - self.latitudes[k].forward_shift) * (LATITUDES as f32 / PI)
    }

    /// A_b at a latitude, by wavelength; linear between the tables'.
    pub fn backscattered(&self, theta: f32) -> [f32; N] {
        self.neighbors(theta).energy
    }

    /// Share of the light that endless layers send back, `a_b + A_b`, by wavelength: the reflectance of a thick swatch of aligned fibers.
    pub fn reflectance(&self, theta: f32) -> [f32; N] {
        let a = self.attenuation(theta);
        let neighbors = self.backscattered(theta);
        std::array::from_fn(|n| a.backward[n] + neighbors[n])
    }

    pub(crate) fn half_turn(&self, theta: f32, azimuth: f32) -> HalfTurn<N> {
        let (k, t) = place(theta);
        let at = azimuth / PI * (AZIMUTHS - 1) as f32;
        let d = (at as usize).min(AZIMUTHS - 2);
        let s = (at - d as f32).min(1.0);
        let row = |k: usize| {
            let nodes = &self.half_turns[k * AZIMUTHS + d..][..2];
            nodes[0].mix(&nodes[1], s)
        };
        row(k).mix(&row(k + 1), t)
    }

    /// Light of endless neighbors at a latitude: A_b, and the width sigma_b in `width`.
    pub(crate) fn neighbors(&self, theta: f32) -> HalfTurn<N> {
        let (k, t) = place(theta);
        self.neighbors[k].mix(&self.neighbors[k + 1], t)
    }

    /// The light path of a shading point that nothing stands before.
    pub fn unoccluded(&self) -> Occlusion<N> {
        Occlusion::new()
    }

    /// Dual scattering for light from `query.omega_i` that has passed `occlusion`, at a fiber of the model that this was made of.
    pub fn at<'a>(&'a self, model: &'a FiberModel, query: &FiberQuery<N>, occlusion: &Occlusion<N>) -> DualBsdf<'a, N> {
        DualBsdf::new(self, model, query, occlusion)
    }
}

/// Latitudes around `theta`, and the part between them. What is not a number counts as the first.
fn place(theta: f32) -> (usize, f32) {
    let at = ((theta + FRAC_PI_2) / PI * LATITUDES as f32 - 0.5).max(0.0).min((LATITUDES - 1) as f32);
    let k = (at as usize).min(LATITUDES - 2);
    (k, at - k as f32)
}

/// Points whose first k fill the cube evenly for every k (the additive recurrence of the root of x^4 = x + 1).
fn low_discrepancy(k: u32) -> [f32; 3] {
    const STEP: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_1];
    STEP.map(|a| ((0.5 + a * f64::from(k + 1)).fract() as f32).min(1.0 - f32::EPSILON / 2.0))
}

/// Sums over samples.
#[derive(Clone, Debug)]
struct Moments<const N: usize> {
    energy: [f64; N],
    /// Of all wavelengths: light, light times t, light times t^2.
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

    fn energy(&self, scale: &[f64; N]) -> [f32; N] {
        std::array::from_fn(|n| (self.energy[n] * scale[n]) as f32)
    }

    /// Mean and standard deviation; 0 without light.
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
