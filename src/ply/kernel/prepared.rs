//! Prepared lobes at one incidence, for many directions: the factors that do not depend on the direction are
//! multiplied in advance.

use super::absorption::attenuate;
use super::energy::Rest;
use super::grid_cell::mirrored;
use super::lobe::{Axes, disc_point, disc_share, project, shape, unit};
use super::mixture::{Drawing, Mixture, Shapes};
use crate::math::simd::{fma, halves, min};
use crate::ply::asg::PARAMS;

/// The running sums of the lobes' energies, by which a sample chooses a lobe.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct Choice<const L: usize> {
    /// Running sums of the mean energies; infinite in empty lanes.
    sums: [f32; L],
    sum: f32,
    /// Scattered energy plus the missed light, and the reciprocal of that sum.
    total: f32,
    pub(in crate::ply) per_total: f32,
    r_d: f32,
    /// Probability of missed light.
    missed: f32,
}

impl<const L: usize> Choice<L> {
    /// Sums over the first `count` lanes; the energies times `mean` are the means over the absorptions.
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool>(
        energy: &[f32; L],
        mean: &[f32; L],
        count: usize,
        total: f32,
        r_d: f32,
    ) -> Self {
        let (mut sums, mut sum) = ([f32::INFINITY; L], 0.0);
        for i in 0..count {
            sum = fma::<FMA>(energy[i], mean[i], sum);
            sums[i] = sum;
        }
        let per_total = if total > 0.0 { 1.0 / total } else { 0.0 };
        Choice { sums, sum, total, per_total, r_d, missed: r_d * per_total }
    }

    /// Adds the missed light to f_refl and a density.
    #[inline(always)]
    pub(in crate::ply) fn rest(&self, refl: f32, pdf: f32) -> Rest {
        Rest { refl, pdf, r_d: self.r_d, missed: self.missed }
    }

    /// The lane that the number `u` chooses; `None` for missed light.
    #[inline(always)]
    pub(in crate::ply) fn lane(&self, u: f32) -> Option<usize> {
        let target = u * self.total;
        if target >= self.total - self.r_d || self.sum <= 0.0 {
            return None;
        }
        // Clamped as in `Mixture::choose`.
        let target = min(target, self.sum * (1.0 - f32::EPSILON));
        let mut passed = 0u32;
        for x in self.sums {
            passed += u32::from(x <= target);
        }
        Some(passed as usize & (L - 1))
    }
}

/// Lobes in L lanes: H high-order ones first, then those of f_refl.
#[derive(Clone, Copy, Debug)]
pub(in crate::ply) struct PreparedLobes<const H: usize, const L: usize> {
    /// Sines and cosines of the angles.
    axes: [[f32; L]; PARAMS],
    s1: [f32; L],
    s2: [f32; L],
    /// Amplitudes: of f_refl scaled to the simulated energy, of f_high before absorption.
    amplitude: [f32; L],
    /// Mean energy times sqrt(mu1 mu2) / pi, divided by the total energy.
    density: [f32; L],
    choice: Choice<L>,
    flip: bool,
}

impl<const H: usize, const L: usize> PreparedLobes<H, L> {
    #[inline(always)]
    pub(in crate::ply) fn new<const FMA: bool, const R: usize, const J: usize>(
        m: &Mixture<'_, H, R, L, J>,
        x: &Shapes<L>,
        drawing: &Drawing<L>,
    ) -> Self {
        let mean = drawing.mean;
        let choice = Choice::new::<FMA>(&m.energy, &mean, H + R, drawing.total, m.r_d);
        let mut prepared = PreparedLobes {
            axes: x.axes,
            s1: x.s1,
            s2: x.s2,
            amplitude: x.amplitude,
            density: [0.0; L],
            choice,
            flip: m.flip,
        };
        for i in H..L {
            prepared.amplitude[i] *= m.scale_refl;
        }
        let per_total = choice.per_total;
        for i in 0..L {
            prepared.density[i] = mean[i] * x.norm[i] * per_total;
        }
        prepared
    }

    /// Values in a direction; f_high for each absorption is written to `high`. The density is 0 unless `PDF`.
    /// `transmittance` is `[lobe][absorption]`, flat.
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool, const PDF: bool>(
        &self,
        transmittance: &[f32],
        wo: [f32; 3],
        high: &mut [f32],
    ) -> Rest {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(self.axes(i), v);
            let (su, sw) = (self.s1[i] * u, self.s2[i] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            value[i] = shape * self.amplitude[i];
            if PDF {
                // As in `Mixture::eval`.
                let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
                density[i] = shape * self.density[i] / disc_share::<FMA>(a);
            }
        }
        attenuate::<FMA, H>(value.first_chunk().unwrap_or(&[0.0; H]), transmittance, high);
        let mut refl = 0.0;
        for i in H..L {
            refl += value[i];
        }
        self.choice.rest(refl, if PDF { halves(density) } else { 0.0 })
    }

    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &self,
        transmittance: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let Some(i) = self.choice.lane(u[0]) else {
            high.fill(0.0);
            return (None, self.choice.rest(0.0, 0.0));
        };
        let disc = disc_point::<FMA>(self.s1[i], self.s2[i], u[1], u[2]);
        let wo = mirrored(self.flip, self.axes(i).direction(disc));
        (Some(wo), self.eval::<FMA, true>(transmittance, wo, high))
    }

    #[inline(always)]
    fn axes(&self, i: usize) -> Axes {
        let a = &self.axes;
        Axes { theta: (a[0][i], a[1][i]), phi: (a[2][i], a[3][i]), xy: (a[4][i], a[5][i]) }
    }
}
