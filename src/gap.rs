//! Weave gaps: far-field diffraction of a Gaussian beam through a rectangular aperture (Yu 2025, 6.1, Eq. 11,
//! 12, 15).
//!
//! The aperture lies in the plane z = 0 of its own frame, with the beam's center at the origin. Light comes
//! from +z or from -z, and transmitted light leaves on the other side. K is the product of two
//! one-dimensional factors in closed form (`faddeeva.rs`) for arbitrary edges; it needs neither a table of
//! apertures nor the paper's color correction. There are two departures from the paper
//! (docs/explain/papers/yu_2025.md): |K|^2 replaces K^2, since K is complex for an aperture off the beam's
//! center; and the power on the aperture is that of the intensity, `integral exp(-2 r^2/w0^2)`.
//!
//! As in the paper, the beam's cross section in the plane of the aperture is a circle of waist w0 at any
//! tilt. The cross section of a real tilted beam is an ellipse, longer by 1/c_i, so a wide gap spreads tilted
//! light by a factor 1/c_i more than the beam itself does.
//!
//! f integrates to 1 in Kirchhoff's approximation if the aperture is many wavelengths wide and the light is
//! not grazing; [`Bsdf::albedo`] returns the actual integral. By Parseval's theorem it is the mean of
//! `(c_i + c_o)^2/(4 c_i c_o)` over the spectrum of the aperture, with evanescent frequencies counted as 0;
//! c_i and c_o are the cosines of the incident and the outgoing direction. The integral is below 1 by the
//! light that the aperture's edges diffract beyond the plane, to first order
//! `lambda/(2 pi^2) (q_x (1/c^2 + pi/(4 c)) + q_y (1 + pi/4)/c)`, with c the cosine of a tilt towards x, and
//! q of an axis the mean intensity at its two edges over the power between them
//! (docs/explain/papers/yu_2025.md). For 10 um in a beam of w0 = 10 um it is 0.7 % in green light at normal
//! incidence, 1.6 % at 1 rad, and 2.3 % at 1 rad and 0.78 um.
//!
//! At grazing incidence, the factor 1/c_i makes an aperture emit many times the incident light (2 um, c_i =
//! 0.001: 46 times). Two departures keep the integral at or below 1.005 for every aperture, tilt and
//! wavelength, and leave f unchanged up to a tilt of 1.2 rad (w0 = 10 um): c_i is at least `min_cosine`,
//! and the excess of a tilted beam without any aperture is divided out (`beam_excess`). Test:
//! `tests/it/gap_grazing.rs`.

mod apertures;
mod slit;
mod spectrum;

use crate::bsdf::Outcomes;
use crate::frame::is_direction;
use crate::math::faddeeva::{Factor, power_between};
use crate::spec::GaussianBeam;
use crate::{Bsdf, BsdfSample, Error, Result};
pub use apertures::Opening;
pub(crate) use apertures::{Apertures, EDGES, GapAt};
use multiversion::{multiversion, target::target_cfg_f};
pub use slit::{SLIT_MAX_UM, SLIT_SHARE, Slit};
pub(crate) use spectrum::{Axis, CELLS as SPECTRUM_CELLS, Range, Spectrum};
use std::f32::consts::TAU;

/// A rectangular aperture in the plane of a weave: its edges [um], relative to the beam's center.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aperture {
    /// West and east edge [um].
    pub x_um: [f32; 2],
    /// South and north edge [um].
    pub y_um: [f32; 2],
}

impl Aperture {
    /// An aperture with these edges.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an edge that is not finite, and for a second edge that is not beyond the first.
    pub fn new(x_um: [f32; 2], y_um: [f32; 2]) -> Result<Aperture> {
        for (key, [a, b]) in [("x_um", x_um), ("y_um", y_um)] {
            if !(a.is_finite() && b.is_finite() && a < b) {
                let hint = "expected two finite edges, the second greater than the first".to_string();
                let value = format!("[{a}, {b}]");
                return Err(Error::Invalid { file: "aperture".into(), key: key.into(), value, hint });
            }
        }
        Ok(Aperture { x_um, y_um })
    }

    /// An aperture of this width and height [um] about the beam's center.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a size that is not positive and finite.
    pub fn centered(width_um: f32, height_um: f32) -> Result<Aperture> {
        Aperture::new([-0.5 * width_um, 0.5 * width_um], [-0.5 * height_um, 0.5 * height_um])
    }
}

/// Light through one aperture. A host prepares one for each aperture (about 20 us) and evaluates it at any
/// incidence and wavelength.
#[derive(Clone, Copy, Debug)]
pub struct Gap {
    x: Spectrum,
    y: Spectrum,
    passing: f32,
}

impl Gap {
    /// The gap of an aperture in a beam. Edges are clamped to +-d_cut. An aperture that is then empty, or
    /// whose edges are not in order, is dark: f = 0, and all light is missed.
    pub fn new(aperture: &Aperture, beam: &GaussianBeam) -> Gap {
        let w0 = beam.w0_um;
        let axis = |[a, b]: [f32; 2]| {
            // NaN gives an aperture of zero width.
            let edge = |x: f32| f64::from(x).max(-beam.d_cut_um).min(beam.d_cut_um);
            if a < b { [edge(a), edge(b)] } else { [0.0; 2] }
        };
        let (x, y) = (axis(aperture.x_um), axis(aperture.y_um));
        let share = |[a, b]: [f64; 2]| power_between(a, b, w0) / (w0 * (0.5 * std::f64::consts::PI).sqrt());
        Gap {
            x: Spectrum::new(x[0], x[1], w0),
            y: Spectrum::new(y[0], y[1], w0),
            passing: (share(x) * share(y)) as f32,
        }
    }

    /// Fraction of the beam's power that falls on the aperture.
    pub fn passing(&self) -> f32 {
        self.passing
    }

    /// The BSDF for light that comes from `xi_i` (unit, pointing away from the aperture) at N wavelengths
    /// [um]. Wavelengths are clamped to [0.05, 20]; NaN counts as 0.05. f is 0 if `xi_i` is not a direction
    /// or lies in the plane, and if `w` is not a direction.
    pub fn at<const N: usize>(&self, xi_i: [f32; 3], lambda_um: [f32; N]) -> GapBsdf<'_, N> {
        GapBsdf::new(Axis::new(&self.x), Axis::new(&self.y), xi_i, lambda_um)
    }
}

/// Clamps a wavelength to the valid range.
pub(crate) fn clamp_lambda(lambda_um: f32) -> f32 {
    crate::math::simd::min(crate::math::simd::max(lambda_um, 0.05), 20.0)
}

/// Smallest cosine of incidence in the denominator of f, as a fraction of the mean outgoing cosine for
/// incident light in the plane: see [`min_cosine`].
const MIN_SHARE: f32 = 0.37;
/// Largest mean outgoing cosine that it uses.
const MAX_MEAN_COSINE: f32 = 0.5;
/// Excess of a tilted beam's energy in Kirchhoff's approximation that remains uncorrected, and the relative
/// spread of c_o^2 at which the correction is capped: see [`beam_excess`].
const EXCESS_UNCORRECTED: f32 = 0.002;
const MAX_SPREAD: f32 = 0.4;
/// Share of the samples that is uniform over the hemisphere; it bounds f/pdf for light that leaves along the
/// plane.
const UNIFORM: f32 = 0.02;

/// A gap at one incidence and N wavelengths. f is relative to the power on the aperture.
#[derive(Clone, Copy, Debug)]
pub struct GapBsdf<'a, const N: usize> {
    x: Axis<'a>,
    y: Axis<'a>,
    xi_i: [f32; 3],
    lambda_um: [f32; N],
    /// Sign of xi_i's z; 0 if no light passes.
    side: f32,
    /// Propagating frequencies along x, per wavelength.
    across: [Range; N],
    /// Cosine of incidence, at least [`min_cosine`], per wavelength.
    c_i: [f32; N],
    /// 1 / (1 + [`beam_excess`]), per wavelength.
    share: [f32; N],
}

/// Smallest cosine of incidence in the denominator of f. More grazing light is clamped to it, so that no
/// aperture emits more light than arrives.
///
/// f integrates to `P/2 + c_i E[1/c_o]/4 + E[c_o]/(4 c_i)`, where P and E are the share and the means over
/// the propagating spectrum. As c_i goes to 0, the last term grows without bound: Kirchhoff's approximation
/// takes the field's slope in the aperture from the direction of incidence alone, but a field as narrow as
/// the aperture consists of many directions, of mean cosine E[c_o]. For incident light in the plane, half of
/// the spectrum propagates, and `c_o^2 = 2 lambda |f|` to first order, with f the frequency along its
/// direction, so `E[c_o] = sqrt(lambda/2) mean sqrt(|f|)`. The integral is 1 where c_i is about 0.35 E[c_o];
/// 0.37 holds for all apertures. Below that, c_i is constant.
fn min_cosine(x: &Spectrum, y: &Spectrum, xi_i: [f32; 3], lambda_um: f32) -> f32 {
    let f = (xi_i[0] * xi_i[0] * x.root_mean_4 + xi_i[1] * xi_i[1] * y.root_mean_4).sqrt();
    MIN_SHARE * crate::math::simd::min((0.5 * lambda_um * f).sqrt(), MAX_MEAN_COSINE)
}

/// Excess over 1 of a tilted beam's energy in Kirchhoff's approximation without any aperture, minus
/// [`EXCESS_UNCORRECTED`].
///
/// The mean of `(c_i + c_o)^2/(4 c_i c_o) = 1 + (c_o - c_i)^2/(4 c_i c_o)` is above 1. With
/// `c_o^2 = c_i^2 (1 + s z)`, z of unit variance and `s = lambda sin_i/(pi w0 c_i^2)`, it is
/// `1 + s^2/16 + 45 s^4/256` for the Gaussian z of a beam, to fourth order. From s = 0.4 on, the energy of
/// the beam's light beyond the plane exceeds the excess. At normal and moderate tilt the excess is below
/// [`EXCESS_UNCORRECTED`]: 0.0018 at 0.362, the cosine of 1.2 rad, for w0 = 10 um and lambda = 0.7 um.
fn beam_excess(spread: f32, xi_i: [f32; 3], lambda_um: f32) -> f32 {
    let (sine2, cosine2) = (xi_i[0] * xi_i[0] + xi_i[1] * xi_i[1], xi_i[2] * xi_i[2]);
    let s = crate::math::simd::min(lambda_um * spread * sine2.sqrt() / cosine2, MAX_SPREAD);
    let s2 = s * s;
    crate::math::simd::max(s2 / 16.0 + 45.0 / 256.0 * s2 * s2 - EXCESS_UNCORRECTED, 0.0)
}

/// [`crate::math::faddeeva::spectra`], compiled for several instruction sets.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
pub(crate) fn spectra<const N: usize>(factors: [&Factor; 2], f_per_um: [&[f32; N]; 2]) -> [[f32; N]; 2] {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    crate::math::faddeeva::spectra::<FMA, N>(factors, f_per_um)
}

impl<'a, const N: usize> GapBsdf<'a, N> {
    #[inline]
    pub(crate) fn new(x: Axis<'a>, y: Axis<'a>, xi_i: [f32; 3], lambda_um: [f32; N]) -> GapBsdf<'a, N> {
        let mut lambda = lambda_um;
        for l in &mut lambda {
            *l = clamp_lambda(*l);
        }
        let valid = is_direction(xi_i) && xi_i[2] != 0.0 && x.passes() && y.passes();
        let mut across = [x.range(0.0, 0.0); N];
        for (range, l) in across.iter_mut().zip(&lambda) {
            *range = x.range((xi_i[0] - 1.0) / l, (xi_i[0] + 1.0) / l);
        }
        let (of_x, of_y) = (x.table(), y.table());
        let c_i = lambda.map(|l| crate::math::simd::max(xi_i[2].abs(), min_cosine(of_x, of_y, xi_i, l)));
        let share = lambda.map(|l| 1.0 / (1.0 + beam_excess(of_x.beam_spread, xi_i, l)));
        let side = if valid { xi_i[2].signum() } else { 0.0 };
        GapBsdf { x, y, xi_i, lambda_um: lambda, side, across, c_i, share }
    }

    /// Whether no light passes.
    pub(crate) fn is_dark(&self) -> bool {
        self.side == 0.0 || N == 0
    }

    /// Whether light leaves in this direction; false if a component is beyond 1.001.
    fn leaves(&self, wo: [f32; 3]) -> bool {
        wo[2] * self.side < 0.0 && is_direction(wo)
    }

    /// Propagating frequencies along y for light with the component `xi_x`, at wavelength `k`.
    fn along(&self, xi_x: f32, k: usize) -> Range {
        let reach = (1.0 - xi_x * xi_x).max(0.0).sqrt();
        let per_lambda = 1.0 / self.lambda_um[k];
        self.y.range((self.xi_i[1] - reach) * per_lambda, (self.xi_i[1] + reach) * per_lambda)
    }

    /// The direction with these components in the plane. It is moved slightly out of the plane itself, where
    /// light would leave on neither side.
    fn leaving(&self, x: f32, y: f32) -> [f32; 3] {
        [x, y, -self.side * (1.0 - x * x - y * y).max(1e-12).sqrt()]
    }

    /// Samples components x and y of a direction: a wavelength uniformly, then f_x and f_y from its tabulated
    /// spectra, clipped to propagating frequencies.
    fn tabulated_sample(&self, u: [f32; 3]) -> (f32, f32) {
        let k = ((u[0] * N as f32) as usize).min(N.saturating_sub(1));
        let lambda = self.lambda_um[k];
        let x = (lambda * self.x.sample(&self.across[k], u[1]) - self.xi_i[0]).clamp(-1.0, 1.0);
        let y = lambda * self.y.sample(&self.along(x, k), u[2]) - self.xi_i[1];
        let reach = (1.0 - x * x).max(0.0).sqrt();
        (x, y.clamp(-reach, reach))
    }

    /// Density [1/sr] of [`GapBsdf::tabulated_sample`]; c_o is the outgoing cosine.
    fn tabulated_pdf(&self, wo: [f32; 3], c_o: f32) -> f32 {
        let mut sum = 0.0;
        for k in 0..N {
            let per_lambda = 1.0 / self.lambda_um[k];
            let (fx, fy) = ((self.xi_i[0] + wo[0]) * per_lambda, (self.xi_i[1] + wo[1]) * per_lambda);
            let x = self.x.pdf(&self.across[k], fx);
            let y = self.y.pdf(&self.along(wo[0], k), fy);
            sum += x * y * c_o * per_lambda * per_lambda;
        }
        sum / N.max(1) as f32
    }

    /// The spectrum of the aperture without Kirchhoff's cosines, scaled to an integral of 1 over the
    /// directions in which light can leave [1/sr]; and the density of [`GapBsdf::conserved_sample`] [1/sr].
    pub(crate) fn conserved(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let mut f = [0.0; N];
        if !self.leaves(wo) || N == 0 {
            return (f, 0.0);
        }
        let (fx, fy) = self.frequencies(wo);
        let [x, y] = spectra([&self.x.factor, &self.y.factor], [&fx, &fy]);
        let c_o = wo[2].abs().min(1.0);
        for k in 0..N {
            let mass = self.across[k].mass * self.along(wo[0], k).mass;
            if mass > 1e-12 {
                f[k] = x[k] * y[k] * c_o / (mass * self.lambda_um[k] * self.lambda_um[k]);
            }
        }
        let pdf = self.tabulated_pdf(wo, c_o);
        (f, if pdf.is_finite() { pdf } else { 0.0 })
    }

    /// Samples a direction from [`GapBsdf::conserved`], by numbers in [0, 1).
    pub(crate) fn conserved_sample(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        if self.is_dark() {
            return None;
        }
        let (x, y) = self.tabulated_sample(u);
        Some(self.leaving(x, y))
    }

    /// The direction of [`Bsdf::sample`].
    pub(crate) fn direction(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        if self.is_dark() {
            return None;
        }
        let u = u.map(crate::math::clamp_unit);
        let (x, y) = if u[0] < UNIFORM {
            // A uniform direction of the hemisphere has uniform height and azimuth.
            let (sin, cos) = (TAU * u[1]).sin_cos();
            let radius = (1.0 - u[2] * u[2]).max(0.0).sqrt();
            (radius * cos, radius * sin)
        } else {
            self.tabulated_sample([(u[0] - UNIFORM) / (1.0 - UNIFORM), u[1], u[2]])
        };
        Some(self.leaving(x, y))
    }

    /// Frequencies f_x and f_y of a direction, per wavelength [1/um].
    fn frequencies(&self, wo: [f32; 3]) -> ([f32; N], [f32; N]) {
        let (mut fx, mut fy) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            fx[k] = (self.xi_i[0] + wo[0]) / self.lambda_um[k];
            fy[k] = (self.xi_i[1] + wo[1]) / self.lambda_um[k];
        }
        (fx, fy)
    }

    /// Integral of f at wavelength `k`, summed over the cells of the tabulated spectra.
    fn energy(&self, k: usize) -> f64 {
        let (lambda, c_i) = (f64::from(self.lambda_um[k]), f64::from(self.c_i[k]));
        let (ix, iy) = (f64::from(self.xi_i[0]), f64::from(self.xi_i[1]));
        let mut sum = 0.0;
        let low_high = |i: f64, reach: f64| (((i - reach) / lambda) as f32, ((i + reach) / lambda) as f32);
        let (low, high) = low_high(ix, 1.0);
        self.x.table().for_cells(low, high, |low, high, mass_x| {
            let x = (0.5 * lambda * (f64::from(low) + f64::from(high)) - ix).clamp(-1.0, 1.0);
            let reach = (1.0 - x * x).sqrt();
            let (low, high) = low_high(iy, reach);
            let mut row = 0.0;
            self.y.table().for_cells(low, high, |low, high, mass_y| {
                // The integrals over xi_y of 1, 1/xi_z and xi_z.
                let integrals = |f: f32| {
                    let y = (lambda * f64::from(f) - iy).clamp(-reach, reach);
                    let angle = if reach > 0.0 { (y / reach).asin() } else { 0.0 };
                    [y, angle, 0.5 * (y * (reach * reach - y * y).max(0.0).sqrt() + reach * reach * angle)]
                };
                let (a, b) = (integrals(low), integrals(high));
                let width = b[0] - a[0];
                if width > 0.0 {
                    let mean = 0.5 + 0.25 * (c_i * (b[1] - a[1]) + (b[2] - a[2]) / c_i) / width;
                    row += f64::from(mass_y) * mean;
                }
            });
            sum += f64::from(mass_x) * row;
        });
        sum * f64::from(self.share[k])
    }
}

impl<const N: usize> Bsdf<N> for GapBsdf<'_, N> {
    /// Evaluates Yu 2025, Eq. 15, as an energy density [1/sr].
    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        let mut f = [0.0; N];
        if !self.leaves(wo) {
            return f;
        }
        let (fx, fy) = self.frequencies(wo);
        let [x, y] = spectra([&self.x.factor, &self.y.factor], [&fx, &fy]);
        let c_o = wo[2].abs().min(1.0);
        for k in 0..N {
            let both = self.c_i[k] + c_o;
            let cosines = 0.25 * self.share[k] * both * both / self.c_i[k];
            f[k] = cosines / (self.lambda_um[k] * self.lambda_um[k]) * x[k] * y[k];
        }
        f
    }

    fn pdf(&self, wo: [f32; 3]) -> f32 {
        if !self.leaves(wo) || N == 0 {
            return 0.0;
        }
        let c_o = wo[2].abs().min(1.0);
        let pdf = (1.0 - UNIFORM) * self.tabulated_pdf(wo, c_o) + UNIFORM / TAU;
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Samples a wavelength uniformly, then f_x and f_y from its spectra, clipped to propagating frequencies.
    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match self.direction(u) {
            Some(w) => BsdfSample::scattered(w, self.eval(w), self.pdf(w)),
            None => BsdfSample::Absorbed,
        }
    }

    /// Integral of f; it takes about 2 ms per wavelength and serves checks and a host's preparation.
    fn albedo(&self) -> [f32; N] {
        let mut energy = [0.0; N];
        if self.side != 0.0 {
            for (k, energy) in energy.iter_mut().enumerate() {
                *energy = self.energy(k) as f32;
            }
        }
        energy
    }

    fn outcomes(&self) -> Outcomes {
        if self.is_dark() { Outcomes::ABSORBED } else { Outcomes::SCATTERED }
    }
}
