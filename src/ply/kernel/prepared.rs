//! Prepared lobes at one incidence, for many directions: factors that do not depend on the direction are
//! multiplied out, above all the sums over path lengths.

use super::energy::{Core, DrawnBy, Energies, halves};
use super::grid_cell::mirrored;
use super::lobe::{Axes, disc_point, disc_share, project, shape, unit};
use super::mixture::{Mixture, Shapes};
use crate::math::simd::{fma, min};
use crate::ply::asg::PARAMS;

/// Lobes in L lanes, H high-order ones first, then those of f_refl, for N absorptions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PreparedLobes<const H: usize, const L: usize, const N: usize> {
    /// Sines and cosines of the angles.
    axes: [[f32; L]; PARAMS],
    s1: [f32; L],
    s2: [f32; L],
    /// Amplitude of f_refl, scaled to the simulated energy; that of f_high, before absorption.
    amplitude: [f32; L],
    /// Mean energy times sqrt(mu1 mu2)/pi, over the total energy.
    density: [f32; L],
    /// Running sum of the mean energies, and the total; infinite in empty lanes.
    sums: [f32; L],
    sum: f32,
    /// By high-order lobe: the fraction that absorption leaves, scaled to the simulated energy.
    weight: [[f32; N]; H],
    flip: bool,
    total: f32,
    pub(in crate::ply) energies: Energies<N>,
}

impl<const H: usize, const L: usize, const N: usize> PreparedLobes<H, L, N> {
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool, const R: usize, const J: usize>(
        m: &Mixture<H, R, L, J, N>,
        x: &Shapes<L>,
        drawn_by: DrawnBy,
    ) -> Self {
        let weight = m.left::<FMA>();
        let total = drawn_by.total(&m.energies);
        let per_total = if total > 0.0 { 1.0 / total } else { 0.0 };
        let mut prepared = PreparedLobes {
            axes: x.axes,
            s1: x.s1,
            s2: x.s2,
            amplitude: x.amplitude,
            density: [0.0; L],
            sums: [f32::INFINITY; L],
            sum: 0.0,
            weight,
            flip: m.flip,
            total,
            energies: m.energies,
        };
        let (mut mean, share) = ([m.scale_refl; L], 1.0 / N.max(1) as f32);
        for l in 0..H {
            let mut sum = 0.0;
            for k in 0..N {
                sum += weight[l][k];
            }
            mean[l] = share * sum;
        }
        if drawn_by == DrawnBy::First {
            for l in 0..H {
                mean[l] = weight[l].first().copied().unwrap_or(0.0);
            }
        }
        for i in H..L {
            prepared.amplitude[i] *= m.scale_refl;
        }
        for i in 0..L {
            prepared.density[i] = mean[i] * x.norm[i] * per_total;
        }
        for i in 0..H + R {
            prepared.sum = fma::<FMA>(m.energy[i], mean[i], prepared.sum);
            prepared.sums[i] = prepared.sum;
        }
        prepared
    }

    /// f_refl and f_high from the values of the lobes.
    #[inline(always)]
    fn core<const FMA: bool>(&self, value: &[f32; L], pdf: f32) -> Core<N> {
        let (mut even, mut odd, mut refl) = ([0.0; N], [0.0; N], 0.0);
        for l in 0..H / 2 {
            for k in 0..N {
                even[k] = fma::<FMA>(value[2 * l], self.weight[2 * l][k], even[k]);
                odd[k] = fma::<FMA>(value[2 * l + 1], self.weight[2 * l + 1][k], odd[k]);
            }
        }
        for k in 0..N {
            even[k] += odd[k];
        }
        for i in H..L {
            refl += value[i];
        }
        let r_d = self.energies.r_d;
        Core { refl, high: even, pdf, r_d, missed: if self.total > 0.0 { r_d / self.total } else { 0.0 } }
    }

    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool>(&self, wo: [f32; 3]) -> Core<N> {
        let v = mirrored(self.flip, wo);
        let mut value = [0.0; L];
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(self.axes(i), v);
            let (u, w) = (self.s1[i] * u, self.s2[i] * w);
            value[i] = shape::<FMA>(fma::<FMA>(u, u, w * w), cz) * self.amplitude[i];
        }
        self.core::<FMA>(&value, 0.0)
    }

    #[inline(always)]
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(&self, wo: [f32; 3]) -> Core<N> {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(self.axes(i), v);
            let (su, sw) = (self.s1[i] * u, self.s2[i] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            // As in `Mixture::eval_pdf`.
            let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
            value[i] = shape * self.amplitude[i];
            density[i] = shape * self.density[i] / disc_share::<FMA>(a);
        }
        self.core::<FMA>(&value, halves(density))
    }

    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        let u = unit(u);
        let left = u[0] * self.total;
        if left >= self.total - self.energies.r_d || self.sum <= 0.0 {
            return (None, self.core::<FMA>(&[0.0; L], 0.0));
        }
        // As in `Mixture::choose`.
        let left = min(left, self.sum * (1.0 - f32::EPSILON));
        let mut passed = 0u32;
        for x in self.sums {
            passed += u32::from(x <= left);
        }
        let i = passed as usize & (L - 1);
        let [u, w, cz] = disc_point::<FMA>(self.s1[i], self.s2[i], u[1], u[2]);
        let wo = mirrored(self.flip, self.axes(i).direction([u, w, cz]));
        (Some(wo), self.eval_pdf::<FMA>(wo))
    }

    #[inline(always)]
    fn axes(&self, i: usize) -> Axes {
        let a = &self.axes;
        Axes { theta: (a[0][i], a[1][i]), phi: (a[2][i], a[3][i]), xy: (a[4][i], a[5][i]) }
    }
}
