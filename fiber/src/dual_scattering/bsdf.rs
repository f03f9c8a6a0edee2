//! Dual scattering at a shading point: the light that occluding fibers transmit, scattered by the fiber (F^G)
//! and by its neighbors (F^L) (Khungurn 2015, 3 to 6).

use super::{DualScattering, Spread};
use crate::distributions::longitudinal::Latitude;
use crate::incident::Incident;
use crate::{FiberModel, FiberQuery};
use plywave::Bsdf;
use plywave::frame::{direction, is_direction};
use plywave::math::erf::erf;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

impl<const N: usize> DualScattering<N> {
    /// The occlusion of a shading point with no fibers in front of it.
    pub fn unoccluded(&self) -> Occlusion<N> {
        Occlusion::new()
    }

    /// Dual scattering of light from `query.omega_i` that passed `occlusion`; `model` must be the one that
    /// this was prepared from.
    pub fn at<'a>(&'a self, model: &'a FiberModel, query: &FiberQuery<N>, occlusion: &Occlusion<N>) -> DualBsdf<'a, N> {
        DualBsdf::new(self, model, query, occlusion)
    }
}

/// Maximum width of spread light [rad]: it is uniform over the latitudes to 1 %.
const WIDEST: f32 = 6.0;
/// Maximum number of fibers behind that is used; more are practically infinite.
const MAX_BEHIND: u32 = 64;
/// Positive points and weights of Gauss-Legendre quadrature with 8 points on [-1, 1].
const LEGENDRE: [(f32, f32); 4] = [
    (0.183_434_64, 0.362_683_8),
    (0.525_532_4, 0.313_706_65),
    (0.796_666_5, 0.222_381_03),
    (0.960_289_86, 0.101_228_54),
];

/// The fibers that light passes on its way to a shading point: T_f without d_f, and sigma_f.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occlusion<const N: usize> {
    /// Number of fibers passed.
    pub fibers: f32,
    /// Product of a_f, one for each wavelength.
    pub transmitted: [f32; N],
    /// sigma_f^2 [rad^2].
    pub variance: f32,
    /// Mean latitude of the arriving light relative to straight light [rad]; 0 if
    /// [`super::DualOptions::drift`] is false.
    pub drift: f32,
    /// Number of fibers behind the shading point along the light, if the host counted them; A_b is then that
    /// of as many layers. `None` is infinite layers.
    pub behind: Option<u32>,
}

impl<const N: usize> Occlusion<N> {
    pub(crate) fn new() -> Self {
        Occlusion { fibers: 0.0, transmitted: [1.0; N], variance: 0.0, drift: 0.0, behind: None }
    }

    /// Passes `count` fibers, in whose frame the light comes from the latitude `theta_d` [rad] (Khungurn
    /// 2015, 3.1 and 3.2). The count may be a fraction, if only the mean density is known. If the count is
    /// not positive or an input is not finite, no fiber is passed.
    pub fn pass(&mut self, dual: &DualScattering<N>, theta_d: f32, count: f32) {
        if !(count > 0.0 && count.is_finite() && theta_d.is_finite()) {
            return;
        }
        self.fibers += count;
        // An integer number of equal steps of at most one fiber. After 64 fibers the variance has converged.
        let steps = count.ceil().min(64.0);
        let part = if count > steps { 1.0 } else { count / steps };
        let mut a = dual.attenuation(theta_d);
        for _ in 0..steps as u32 {
            let latitude = (theta_d + self.drift).max(-FRAC_PI_2).min(FRAC_PI_2);
            a = dual.attenuation(latitude);
            let retained = if dual.options.drift {
                self.drift -= part * a.forward_shift;
                (1.0 - part * dual.shift_slope(latitude)).max(0.0)
            } else {
                1.0
            };
            (0..N).for_each(|n| self.transmitted[n] *= a.forward[n].max(0.0).powf(part));
            let width = if dual.options.drift { a.forward_width } else { a.forward_beta };
            let variance = retained * retained * self.variance + part * width * width;
            self.variance = variance.min(WIDEST * WIDEST);
        }
        if count > steps {
            (0..N).for_each(|n| self.transmitted[n] *= a.forward[n].max(0.0).powf(count - steps));
            if !dual.options.drift {
                let variance = self.variance + (count - steps) * a.forward_beta * a.forward_beta;
                self.variance = variance.min(WIDEST * WIDEST);
            }
        }
    }

    /// Whether no fiber has been passed.
    pub fn is_direct(&self) -> bool {
        self.fibers == 0.0
    }
}

/// F^G and d_b F^L as energy densities [1/sr].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DualTerms<const N: usize> {
    /// Light scattered by the fiber.
    pub global: [f32; N],
    /// Light that its neighbors reflect.
    pub local: [f32; N],
}

/// Dual scattering at a shading point for light from one direction, from [`DualScattering::at`].
#[derive(Clone, Copy, Debug)]
pub struct DualBsdf<'a, const N: usize> {
    dual: &'a DualScattering<N>,
    model: &'a FiberModel,
    query: FiberQuery<N>,
    /// Mean latitude of the arriving light.
    theta_d: f32,
    /// Cosine of the latitude of straight light.
    cos_d: f32,
    incident: Incident,
    /// T_f; 1 if no fiber has been passed.
    transmitted: [f32; N],
    sigma_f: f32,
    /// Share of the spread's Gaussian that lies between the poles.
    inside: f32,
    behind: Option<u32>,
    direct: bool,
}

impl<'a, const N: usize> DualBsdf<'a, N> {
    pub(crate) fn new(
        dual: &'a DualScattering<N>,
        model: &'a FiberModel,
        query: &FiberQuery<N>,
        occlusion: &Occlusion<N>,
    ) -> Self {
        let finite = occlusion.transmitted.iter().all(|t| t.is_finite() && *t >= 0.0)
            && occlusion.variance.is_finite()
            && occlusion.drift.is_finite()
            && occlusion.fibers.is_finite();
        let incident = Incident::new(query.omega_i, finite);
        let d = incident.latitude;
        let direct = occlusion.is_direct();
        let density = if direct { 1.0 } else { dual.options.forward_density };
        let theta_d = (d.sin.atan2(d.cos) + occlusion.drift).max(-FRAC_PI_2).min(FRAC_PI_2);
        let sigma_f = occlusion.variance.max(0.0).min(WIDEST * WIDEST).sqrt();
        let below = |end: f32| erf(f64::from(end / (sigma_f.max(1e-6) * std::f32::consts::SQRT_2))) as f32;
        DualBsdf {
            dual,
            model,
            query: *query,
            theta_d,
            cos_d: d.cos.max(1e-4),
            incident,
            transmitted: occlusion.transmitted.map(|t| density * t),
            sigma_f,
            inside: 0.5 * (below(FRAC_PI_2 - theta_d) + below(FRAC_PI_2 + theta_d)),
            behind: occlusion.behind,
            direct,
        }
    }

    /// Energy density in direction `w` [1/sr]: F^G and d_b F^L together, times `cos theta_o / cos theta_d`.
    /// It is 0 if an input is not a direction.
    pub fn eval(&self, w: [f32; 3]) -> [f32; N] {
        let DualTerms { global, local } = self.terms(w);
        std::array::from_fn(|n| global[n] + local[n])
    }

    /// The factor for the note's integrator (Khungurn 2015, Eq. 1): radiance towards `w` for incident
    /// radiance 1 [1/sr]. A host multiplies it by `L_d / p_emitter`.
    pub fn radiance(&self, w: [f32; 3]) -> [f32; N] {
        let cos_o = Latitude::from_direction(w).cos;
        let scale = if self.incident.valid && is_direction(w) { self.cos_d / cos_o.max(1e-4) } else { 0.0 };
        self.eval(w).map(|f| f * scale)
    }

    /// The two terms in direction `w`; 0 if an input is not a direction.
    pub fn terms(&self, w: [f32; 3]) -> DualTerms<N> {
        if !(self.incident.valid && is_direction(w)) {
            return DualTerms { global: [0.0; N], local: [0.0; N] };
        }
        let o = Latitude::from_direction(w);
        let theta_o = o.sin.atan2(o.cos);
        let azimuth = self.relative(w);
        let global = if self.direct { self.model.at(&self.query).eval(w) } else { self.spread_light(theta_o, azimuth) };
        DualTerms { global, local: self.neighbors(theta_o, azimuth) }
    }

    /// |phi_o - phi_d|.
    fn relative(&self, w: [f32; 3]) -> f32 {
        let [across, side] = self.incident.relative(w);
        side.atan2(across).abs()
    }

    /// Visits latitudes of the arriving light with the weights of their flux, which sum to 1 except for
    /// [`Spread::Radiance`].
    fn each_latitude(&self, mut visit: impl FnMut(f32, f32)) {
        if self.sigma_f <= 0.0 {
            return visit(self.theta_d, 1.0);
        }
        let (low, high) = self.reach(self.theta_d, 5.0 * self.sigma_f);
        let half = 0.125 * (high - low);
        for panel in 0..4 {
            let center = low + (2 * panel + 1) as f32 * half;
            for (x, weight) in LEGENDRE {
                for theta in [center - half * x, center + half * x] {
                    let off = (theta - self.theta_d) / self.sigma_f;
                    let density = (-0.5 * off * off).exp() / (TAU.sqrt() * self.sigma_f * self.inside);
                    visit(theta, half * weight * density * self.measure(theta));
                }
            }
        }
    }

    /// The interval of latitudes within `far` of `middle`, clipped at the poles.
    fn reach(&self, middle: f32, far: f32) -> (f32, f32) {
        ((middle - far).max(-FRAC_PI_2), (middle + far).min(FRAC_PI_2))
    }

    /// F^G of light that passed fibers (Khungurn 2015, 4), from the tables.
    fn spread_light(&self, theta_o: f32, azimuth: f32) -> [f32; N] {
        let energy = self.convolve(theta_o, |theta| {
            let h = self.dual.half_turn(theta, azimuth);
            (h.energy, h.shift - theta, h.width)
        });
        std::array::from_fn(|n| self.transmitted[n] * energy[n])
    }

    /// d_b F^L (Khungurn 2015, 5.2 and 6).
    fn neighbors(&self, theta_o: f32, azimuth: f32) -> [f32; N] {
        // The overlap of the two half turns divided by pi^2, or of one half turn alone.
        let around = if !self.direct {
            (PI - azimuth).max(0.0) / (PI * PI)
        } else if azimuth < FRAC_PI_2 {
            1.0 / PI
        } else {
            0.0
        };
        let density = self.dual.options.backward_density * around;
        if density == 0.0 {
            return [0.0; N];
        }
        let energy = self.convolve(theta_o, |theta| {
            let neighbors = self.dual.neighbors(theta);
            (self.backscattered(theta, neighbors.energy), -theta, neighbors.width)
        });
        std::array::from_fn(|n| density * self.transmitted[n] * energy[n])
    }

    /// Integral over the latitudes theta_i of the arriving light's density times the lobe that `lobe` returns
    /// for theta_i as energies, mean and width.
    ///
    /// Both factors are nearly Gaussian in theta_i, and so is their product. Gauss quadrature covers 3.6
    /// standard deviations of it, clipped at the poles.
    fn convolve(&self, theta_o: f32, lobe: impl Fn(f32) -> ([f32; N], f32, f32)) -> [f32; N] {
        let (energy, mean, width) = lobe(self.theta_d);
        if self.sigma_f <= 0.0 {
            let along = self.dual.lobes.eval(theta_o, mean, width);
            return energy.map(|e| e * along);
        }
        let (variance, width2) = (self.sigma_f * self.sigma_f, (width * width).max(1e-5));
        // The lobe's mean moves as -theta_i.
        let middle = self.theta_d + (mean - theta_o) * variance / (variance + width2);
        let sd = (variance * width2 / (variance + width2)).sqrt();
        let (low, high) = self.reach(middle, 3.6 * sd);
        let mut sum = [0.0; N];
        if low >= high {
            return sum;
        }
        let (center, half) = (0.5 * (low + high), 0.5 * (high - low));
        for (x, weight) in LEGENDRE {
            for theta in [center - half * x, center + half * x] {
                let off = (theta - self.theta_d) / self.sigma_f;
                let (energy, mean, width) = lobe(theta);
                let density = (-0.5 * off * off).exp() * self.dual.lobes.eval(theta_o, mean, width);
                let scale = weight * density * self.measure(theta);
                (0..N).for_each(|n| sum[n] += scale * energy[n]);
            }
        }
        let scale = half / (TAU.sqrt() * self.sigma_f * self.inside);
        sum.map(|s| s * scale)
    }

    /// A_b of the fibers behind; `endless`, if their number is unknown.
    fn backscattered(&self, theta: f32, endless: [f32; N]) -> [f32; N] {
        let Some(count) = self.behind else { return endless };
        let a = self.dual.attenuation(theta);
        let stack = a.stack(count.min(MAX_BEHIND) + 1);
        std::array::from_fn(|n| (stack[n].reflected - a.backward[n]).max(0.0))
    }

    /// Flux of light from the latitude `theta` relative to the quantity that the spread conserves.
    fn measure(&self, theta: f32) -> f32 {
        match self.dual.options.spread {
            Spread::Flux => 1.0,
            Spread::Radiance => theta.cos() / self.cos_d,
        }
    }

    /// Integral of f over the sphere, up to the tables' errors: light scattered by the fiber, and by its
    /// neighbors.
    pub fn energy(&self) -> DualTerms<N> {
        if !self.incident.valid {
            return DualTerms { global: [0.0; N], local: [0.0; N] };
        }
        let (mut global, mut local) = ([0.0; N], [0.0; N]);
        self.each_latitude(|theta, weight| {
            let a = self.dual.attenuation(theta);
            let neighbors = self.backscattered(theta, self.dual.backscattered(theta));
            for n in 0..N {
                global[n] += self.transmitted[n] * weight * (a.forward[n] + a.backward[n]);
                local[n] += self.transmitted[n] * weight * self.dual.options.backward_density * neighbors[n];
            }
        });
        if self.direct {
            global = self.model.at(&self.query).albedo();
        }
        DualTerms { global, local }
    }

    /// F^G as in [`DualBsdf::terms`], by quadrature of the model's f over `steps` latitudes and `2 steps`
    /// azimuths. This is the brute-force reference for the tables.
    pub fn global(&self, w: [f32; 3], steps: u32) -> [f32; N] {
        if !(self.incident.valid && is_direction(w)) {
            return [0.0; N];
        }
        if self.direct {
            return self.model.at(&self.query).eval(w);
        }
        let (low, high) = self.reach(self.theta_d, 6.0 * self.sigma_f);
        let [x, y] = self.incident.azimuth();
        let phi_d = y.atan2(x);
        let (mut sum, mut total) = ([0.0f64; N], 0.0f64);
        for i in 0..steps {
            let theta = low + (i as f32 + 0.5) / steps as f32 * (high - low);
            let off = (theta - self.theta_d) / self.sigma_f.max(1e-6);
            let weight = (-0.5 * off * off).exp();
            total += f64::from(weight);
            let measure = self.measure(theta);
            for j in 0..2 * steps {
                let phi = phi_d + PI * ((j as f32 + 0.5) / (2 * steps) as f32 - 0.5);
                // The mean over rotations of the fiber equals that over rotations of the light.
                for turn in 0..self.dual.options.turns {
                    let turn = TAU * turn as f32 / self.dual.options.turns as f32;
                    let query = FiberQuery { omega_i: direction(theta, phi + turn), h_rel: None, ..self.query };
                    let (sin, cos) = turn.sin_cos();
                    let f = self.model.at(&query).eval([w[0] * cos - w[1] * sin, w[0] * sin + w[1] * cos, w[2]]);
                    (0..N).for_each(|n| sum[n] += f64::from(weight * measure * f[n]));
                }
            }
        }
        let scale = 1.0 / (total * f64::from(2 * steps * self.dual.options.turns));
        std::array::from_fn(|n| self.transmitted[n] * (sum[n] * scale) as f32)
    }
}
