//! A family's ply at one incidence. The numbers of this incidence are interpolated over the family, and they
//! define a mixture of lobes.
//!
//! The arithmetic is that of the model's reference implementation, in f64. It is written once, for numbers
//! with and without derivatives ([`Real`]).

use super::PlyFamily;
use super::data::{FamilyParam, FamilyParams};
use super::node_weights::{NodeWeights, cubic_taps, missed};
use super::num::{Dual, Real};
use crate::bsdf::{Bsdf, BsdfSample, Outcomes};
use crate::math::axis;
use crate::ply::asg::{MU_MAX, MU_MIN, PARAMS, unit_energy_gradient};
use crate::ply::data::energies::Taps;
use crate::ply::data::{MIN_ENERGY, MIN_TRANSMITTANCE};
use crate::ply::edge::{self, EdgeTables};
use crate::ply::{MAX_LOBES, MAX_PATHS, PlyData, PlyEnergies, PlyQuery};
use std::f64::consts::{FRAC_1_PI, TAU};

/// The numbers of a model at one incidence: lobe parameters, spectra and energies.
struct Parts<T> {
    refl: [[T; PARAMS]; MAX_LOBES],
    high: [[T; PARAMS]; MAX_LOBES],
    path: [[T; MAX_PATHS]; MAX_LOBES],
    r_d: T,
    share_refl: T,
    share_high: [T; MAX_PATHS],
}

fn parts<T: Real>(nodes: &[PlyData], place: &NodeWeights<T>, theta_i: f64, h_um: f64) -> Parts<T> {
    let d = &nodes[0];
    let (lr, lh, j) = (d.lobes_refl, d.lobes_high, d.path_um.len());
    let zero = T::from_f64(0.0);
    let mut out = Parts {
        refl: [[zero; PARAMS]; MAX_LOBES],
        high: [[zero; PARAMS]; MAX_LOBES],
        path: [[zero; MAX_PATHS]; MAX_LOBES],
        r_d: zero,
        share_refl: zero,
        share_high: [zero; MAX_PATHS],
    };
    let (rows, columns) = (cubic_taps(&d.theta_i, theta_i), cubic_taps(&d.h_um, h_um));
    let ((m, s), (n, t)) = (axis::locate(theta_i, &d.theta_i), axis::locate(h_um, &d.h_um));
    let block = (m / 2) * (d.h_um.len() / 2) + n / 2;
    let (s, t) = (0.5 * ((m % 2) as f64 + s), 0.5 * ((n % 2) as f64 + t));
    let blend = [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t];
    let e = &d.energies;
    let share = Taps::new(&e.share_theta_i, &e.share_h_um, theta_i, h_um);
    let add = |to: &mut T, w: T, v: f64| *to = *to + w * T::from_f64(v);
    for &(node, w) in &place.corners[..place.count] {
        if place.count > 1 && w.value() == 0.0 && !T::DERIVED {
            continue;
        }
        let d = &nodes[node];
        for l in 0..lr {
            for k in 0..PARAMS {
                let mut v = 0.0;
                for (m, wm) in rows {
                    for (n, wn) in columns {
                        v += wm * wn * d.refl[((m * d.h_um.len() + n) * lr + l) * PARAMS + k];
                    }
                }
                add(&mut out.refl[l][k], w, v);
            }
        }
        for l in 0..lh {
            let lobe = |c: usize| (block * 4 + c) * lh + l;
            for k in 0..PARAMS {
                let v = (0..4).map(|c| blend[c] * d.high[lobe(c) * PARAMS + k]).sum();
                add(&mut out.high[l][k], w, v);
            }
            for p in 0..j {
                let v = (0..4).map(|c| blend[c] * d.high_path[lobe(c) * j + p]).sum();
                add(&mut out.path[l][p], w, v);
            }
        }
        let e = &d.energies;
        add(&mut out.share_refl, w, share.value(&e.share_refl, 1, 0).max(0.0));
        for p in 0..j {
            add(&mut out.share_high[p], w, share.value(&e.share_high, j, p).max(0.0));
        }
    }
    let energies = |node: usize| -> &PlyEnergies { &nodes[node].energies };
    let rd = Taps::new(&e.miss_theta_i, &e.miss_h_um, theta_i, h_um);
    for (a, wa) in rd.weights[0].iter().enumerate() {
        for (b, wb) in rd.weights[1].iter().enumerate() {
            let c = missed(&place.pitch, &energies, (rd.at[0] + a) as isize - 1, (rd.at[1] + b) as isize - 1);
            out.r_d = out.r_d + T::from_f64(wa * wb) * c;
        }
    }
    out.r_d = out.r_d.within(0.0, 1.0);
    out
}

/// One lobe, prepared for evaluation in many directions.
#[derive(Clone, Copy, Debug)]
struct PreparedLobe<T, const N: usize> {
    frame: [[T; 3]; 3],
    mu: [T; 2],
    /// Amplitude divided by the energy.
    amplitude: T,
    /// Energy, one for each absorption.
    energy: [T; N],
}

/// The mixture at an incidence.
#[derive(Clone, Copy, Debug)]
struct Mixture<T, const N: usize> {
    lobes: [PreparedLobe<T, N>; 2 * MAX_LOBES],
    count: usize,
    flip: bool,
    r_d: T,
    albedo: [T; N],
}

impl<T: Real, const N: usize> Mixture<T, N> {
    /// The mixture of a beam that misses: no lobes, and r_d = 1.
    fn miss() -> Self {
        let zero = T::from_f64(0.0);
        let lobe = PreparedLobe { frame: [[zero; 3]; 3], mu: [zero; 2], amplitude: zero, energy: [zero; N] };
        Mixture { lobes: [lobe; 2 * MAX_LOBES], count: 0, flip: false, r_d: T::from_f64(1.0), albedo: [zero; N] }
    }

    fn new(family: &PlyFamily, params: [T; 3], theta_i: f64, h_um: f64, sigma: [T; N]) -> Self {
        let nodes = &family.data.nodes;
        let d = &nodes[0];
        let mut out = Mixture::miss();
        if theta_i.is_nan() || h_um.is_nan() || h_um.abs() > d.h_um[d.h_um.len() - 1] {
            return out;
        }
        out.flip = theta_i < 0.0;
        let h = if out.flip { -h_um } else { h_um };
        let p = parts(nodes, &family.axes.place(params), theta_i.abs(), h);
        let one = T::from_f64(1.0);
        let hit = one - p.r_d;
        let refl = hit * p.share_refl;
        let attenuated = |spectrum: &[T; MAX_PATHS], s: T| {
            let mut sum = T::from_f64(0.0);
            for (j, l) in d.path_um.iter().enumerate() {
                sum = sum + spectrum[j] * (-s * T::from_f64(*l)).exp();
            }
            sum
        };
        let (mut sum_refl, mut sum_high) = (T::from_f64(0.0), [T::from_f64(0.0); N]);
        out.count = d.lobes_refl + d.lobes_high;
        for l in 0..out.count {
            let of = if l < d.lobes_refl { &p.refl[l] } else { &p.high[l - d.lobes_refl] };
            out.lobes[l] = prepared(of);
            let energy = of[5].within(MIN_ENERGY, f64::MAX);
            if l < d.lobes_refl {
                out.lobes[l].energy = [energy; N];
                sum_refl = sum_refl + energy;
            } else {
                for k in 0..N {
                    let transmittance =
                        attenuated(&p.path[l - d.lobes_refl], sigma[k]) + T::from_f64(MIN_TRANSMITTANCE);
                    out.lobes[l].energy[k] = energy * transmittance;
                    sum_high[k] = sum_high[k] + energy * transmittance;
                }
            }
        }
        let mut gain_high = [T::from_f64(0.0); N];
        for k in 0..N {
            let high = hit * attenuated(&p.share_high, sigma[k]);
            out.albedo[k] = refl + high;
            gain_high[k] = high / sum_high[k];
        }
        let gain_refl = refl / sum_refl;
        for l in 0..out.count {
            for k in 0..N {
                let gain = if l < d.lobes_refl { gain_refl } else { gain_high[k] };
                out.lobes[l].energy[k] = out.lobes[l].energy[k] * gain;
            }
        }
        out.r_d = p.r_d;
        out
    }

    fn eval(&self, w: [f32; 3]) -> [T; N] {
        let v = self.turned(w);
        let mut f = [T::from_f64(0.0); N];
        for lobe in &self.lobes[..self.count] {
            let [x, y, z] = lobe.project(v);
            if z.value() > 0.0 {
                let shape = lobe.amplitude * z * (-(lobe.mu[0] * x * x + lobe.mu[1] * y * y)).exp();
                for k in 0..N {
                    f[k] = f[k] + lobe.energy[k] * shape;
                }
            }
        }
        f
    }

    /// Transforms a direction between the frame of the lobes and that of the ply; the transform is its own
    /// inverse. A vector whose length is far from 1 becomes 0, which gives no light.
    fn turned(&self, w: [f32; 3]) -> [f64; 3] {
        let v = w.map(f64::from);
        let square = v.iter().map(|v| v * v).sum::<f64>();
        if !(0.25..4.0).contains(&square) {
            return [0.0; 3];
        }
        if self.flip { [-v[0], v[1], -v[2]] } else { v }
    }
}

impl<T: Real, const N: usize> PreparedLobe<T, N> {
    fn project(&self, v: [f64; 3]) -> [T; 3] {
        self.frame.map(|a| a[0] * T::from_f64(v[0]) + a[1] * T::from_f64(v[1]) + a[2] * T::from_f64(v[2]))
    }
}

/// Axes and amplitude of a lobe, as in [`crate::ply::asg::Lobe::frame`].
fn prepared<T: Real, const N: usize>(p: &[T; PARAMS]) -> PreparedLobe<T, N> {
    let ((st, ct), (sp, cp), (sx, cx)) = (p[0].sin_cos(), p[1].sin_cos(), p[2].sin_cos());
    let (x, y) = ([-sp, cp, T::from_f64(0.0)], [-st * cp, -st * sp, ct]);
    let mix = |a: T, b: T| std::array::from_fn(|i| a * x[i] + b * y[i]);
    let ln = [p[3], p[4]].map(|x| x.within(MU_MIN.ln(), MU_MAX.ln()));
    let mu = ln.map(Real::exp);
    let (unit, d1, d2) = unit_energy_gradient(mu[0].value(), mu[1].value());
    // d(1/u) = -1/u (d1 d ln mu1 + d2 d ln mu2).
    let amplitude = ln[0].chain(1.0 / unit, -d1 / unit) + ln[1].chain(0.0, -d2 / unit);
    PreparedLobe {
        frame: [mix(cx, sx), mix(-sx, cx), [ct * cp, ct * sp, st]],
        mu,
        amplitude,
        energy: [T::from_f64(0.0); N],
    }
}

/// A ply of a family at a query ([`PlyFamily::on`]).
#[derive(Clone, Copy, Debug)]
pub struct FamilyPly<'a, const N: usize> {
    mixture: Mixture<f64, N>,
    edge: Option<&'a EdgeTables>,
    theta_i: f32,
    h_um: f32,
    lambda_um: [f32; N],
}

/// f_refl + f_high in a direction, and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FamilyGradient<const N: usize> {
    /// The value [1/sr].
    pub value: [f64; N],
    /// Derivatives by pitch [1/(sr um)], roughness and index, in the order of [`FamilyParam::ALL`].
    pub by_params: [[f64; N]; 3],
    /// Derivative of value k by absorption k [um/sr].
    pub by_sigma: [f64; N],
}

fn clean(sigma: f32) -> f64 {
    if sigma.is_nan() { 0.0 } else { f64::from(sigma).clamp(0.0, 1e6) }
}

pub(super) fn on<'a, const N: usize>(
    family: &'a PlyFamily,
    params: &FamilyParams,
    query: &PlyQuery<'_, N>,
) -> FamilyPly<'a, N> {
    let p = std::array::from_fn(|i| family.axes.within(i, params.get(FamilyParam::ALL[i])));
    let (theta_i, h_um) = (query.theta_i, query.h_um);
    FamilyPly {
        mixture: Mixture::new(family, p, f64::from(theta_i), f64::from(h_um), query.sigma_per_um.map(clean)),
        edge: if query.edge { family.edge.as_ref() } else { None },
        theta_i,
        h_um,
        lambda_um: query.lambda_um,
    }
}

pub(super) fn gradient<const N: usize>(
    family: &PlyFamily,
    params: &FamilyParams,
    query: &PlyQuery<'_, N>,
    wo: [f32; 3],
) -> FamilyGradient<N> {
    let p = std::array::from_fn(|i| {
        let requested = params.get(FamilyParam::ALL[i]);
        let value = family.axes.within(i, requested);
        if value == requested { Dual::variable(value, i) } else { Dual::from_f64(value) }
    });
    let sigma = query.sigma_per_um.map(|s| Dual::variable(clean(s), 3));
    let f = Mixture::new(family, p, f64::from(query.theta_i), f64::from(query.h_um), sigma).eval(wo);
    FamilyGradient {
        value: f.map(|f| f.v),
        by_params: std::array::from_fn(|i| f.map(|f| f.d[i])),
        by_sigma: f.map(|f| f.d[3]),
    }
}

impl<const N: usize> FamilyPly<'_, N> {
    /// Fraction of the beam that hits no fiber.
    pub fn r_d(&self) -> f32 {
        self.mixture.r_d as f32
    }

    /// Mean energy of a lobe over the absorptions.
    fn mean(&self, lobe: usize) -> f64 {
        self.mixture.lobes[lobe].energy.iter().sum::<f64>() / N.max(1) as f64
    }

    /// Energies of all lobes and of the missed light.
    fn total(&self) -> f64 {
        (0..self.mixture.count).map(|l| self.mean(l)).sum::<f64>() + self.mixture.r_d
    }
}

impl<const N: usize> Bsdf<N> for FamilyPly<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        let mut f = self.mixture.eval(w).map(|f| f as f32);
        if let Some(tables) = self.edge {
            let (edge, _) = edge::eval_pdf(tables, self.theta_i, self.h_um, &self.lambda_um, w);
            for k in 0..N {
                f[k] += self.mixture.r_d as f32 * edge[k];
            }
        }
        f
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        let (total, v) = (self.total(), self.mixture.turned(w));
        if total <= 0.0 {
            return 0.0;
        }
        let mut pdf = 0.0;
        for l in 0..self.mixture.count {
            let lobe = &self.mixture.lobes[l];
            let [x, y, z] = lobe.project(v);
            if z > 0.0 {
                let (q, r2) = (lobe.mu[0] * x * x + lobe.mu[1] * y * y, x * x + y * y);
                let a = (q + 1e-30) / (r2 + 1e-30);
                let norm = (lobe.mu[0] * lobe.mu[1]).sqrt() * FRAC_1_PI;
                pdf += self.mean(l) * norm * (-q).exp() / -(-a).exp_m1() * z;
            }
        }
        if let Some(tables) = self.edge {
            let (_, density) = edge::eval_pdf(tables, self.theta_i, self.h_um, &self.lambda_um, w);
            pdf += self.mixture.r_d * f64::from(density);
        }
        (pdf / total) as f32
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        let total = self.total();
        if total <= 0.0 {
            return BsdfSample::Absorbed;
        }
        let u = u.map(|u| f64::from(if u >= 0.0 { u.min(1.0 - f32::EPSILON) } else { 0.0 }));
        let mut remaining = u[0] * total;
        for l in 0..self.mixture.count {
            let mean = self.mean(l);
            if remaining < mean {
                let w = self.drawn(l, u[1], u[2]);
                let (f, pdf) = self.eval_pdf(w);
                return BsdfSample::scattered(w, f, pdf);
            }
            remaining -= mean;
        }
        let Some(tables) = self.edge else {
            return BsdfSample::straight(self.straight(), self.outcomes().straight);
        };
        let again = (remaining / self.mixture.r_d.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0 - 1e-7) as f32;
        match edge::sample(tables, self.theta_i, self.h_um, &self.lambda_um, [again, u[1] as f32, u[2] as f32]) {
            Some(w) => {
                let (f, pdf) = self.eval_pdf(w);
                BsdfSample::scattered(w, f, pdf)
            }
            None => BsdfSample::Absorbed,
        }
    }

    fn albedo(&self) -> [f32; N] {
        let edge = if self.edge.is_some() { self.mixture.r_d } else { 0.0 };
        self.mixture.albedo.map(|a| (a + edge) as f32)
    }

    fn straight(&self) -> [f32; N] {
        [if self.edge.is_some() { 0.0 } else { self.mixture.r_d as f32 }; N]
    }

    fn outcomes(&self) -> Outcomes {
        let r_d = self.mixture.r_d;
        let scattered = self.total() - r_d;
        if self.edge.is_some() {
            Outcomes::in_proportion((scattered + r_d) as f32, 0.0)
        } else {
            Outcomes::in_proportion(scattered as f32, r_d as f32)
        }
    }
}

impl<const N: usize> FamilyPly<'_, N> {
    /// Samples a direction of a lobe, as the runtime's kernels do.
    fn drawn(&self, l: usize, u1: f64, u2: f64) -> [f32; 3] {
        let PreparedLobe { frame, mu: [mu1, mu2], .. } = self.mixture.lobes[l];
        let (s, c) = (TAU * u1).sin_cos();
        let (x, y) = (mu2.sqrt() * c, mu1.sqrt() * s);
        let n2 = 1.0 / (x * x + y * y);
        let a = (mu1 * x * x + mu2 * y * y) * n2;
        let r2 = (-(u2 * (-a).exp_m1()).ln_1p() / a).clamp(0.0, 1.0 - 1e-12);
        let r = (r2 * n2).sqrt();
        let p = [r * x, r * y, (1.0 - r2).sqrt()];
        let v: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| p[k] * frame[k][i]).sum());
        let v = v.map(|v| v as f32);
        if self.mixture.flip { [-v[0], v[1], -v[2]] } else { v }
    }
}
