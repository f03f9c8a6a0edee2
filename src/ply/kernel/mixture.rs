//! The arithmetic of the runtime: the lobes of a model at one incidence side by side in the lanes of vectors,
//! and their sums.
//!
//! Every loop over lanes is contiguous, of constant length, and has a body long enough that the compiler
//! vectorizes it before it would unroll it. With T the transmittances of the J path lengths, e_l and p_l the
//! energy and spectrum of lobe l and G_l its value, `f_high = scale * sum_j T_j sum_l e_l G_l p_lj`, so the
//! sum over lobes is done once for all absorptions. Bandwidths here are t = mu log2 e, as `s = sqrt(t)`:
//! `exp(-mu1 u^2 - mu2 w^2) = 2^-((s1 u)^2 + (s2 w)^2)`.

use super::energy::interpolate_node;
use super::energy::{Core, DrawnBy, Energies, absorb, absorbed, halves, scales, transmittances};
use super::grid_cell::{locate, mirrored};
use super::interpolate::{interpolate_high, interpolate_refl};
use super::layout::Tables;
use super::lobe::{Axes, amplitudes, axes, disc_point, disc_share, project, root_width, shape, unit};
use crate::math::simd::{fma, max, min};
use crate::ply::asg::PARAMS;

/// f_refl and f_high per sigma in a direction, and the density of sampling it [1/sr].
pub(in crate::ply) type Values<const N: usize> = (f32, [f32; N], f32);

/// Rows of the tables, interpolated.
pub(in crate::ply) type Params<const L: usize> = [[f32; L]; PARAMS];

/// Shapes of the lobes of a [`Mixture`].
pub(in crate::ply) struct Shapes<const L: usize> {
    /// Sines and cosines of the angles.
    pub(in crate::ply) axes: [[f32; L]; PARAMS],
    /// sqrt(mu1 log2 e), sqrt(mu2 log2 e).
    pub(in crate::ply) s1: [f32; L],
    pub(in crate::ply) s2: [f32; L],
    /// Energy * sqrt(mu1 mu2) / pi.
    pub(in crate::ply) norm: [f32; L],
    /// Energy / energy of the lobe with amplitude 1.
    pub(in crate::ply) amplitude: [f32; L],
}

impl<const L: usize> Shapes<L> {
    #[inline(always)]
    fn axes(&self, i: usize) -> Axes {
        let a = &self.axes;
        Axes { theta: (a[0][i], a[1][i]), phi: (a[2][i], a[3][i]), xy: (a[4][i], a[5][i]) }
    }
}

/// The weights of the lobes at one incidence: H high-order and R reflection lanes, then empty ones up to L; J
/// path lengths, N absorptions.
pub(in crate::ply) struct Mixture<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> {
    /// Energy before the scale to the simulated energy.
    pub(in crate::ply) energy: [f32; L],
    /// Path-length spectra of the high-order lobes.
    spectrum: [[f32; J]; H],
    /// Transmittance of each path length.
    transmittance: [[f32; N]; J],
    /// Scale of the high-order lobes to the simulated energy.
    scale_high: [f32; N],
    /// Scale of the reflection lobes to the simulated energy.
    pub(in crate::ply) scale_refl: f32,
    /// Pairs of high-order lobes.
    pairs: usize,
    pub(in crate::ply) flip: bool,
    pub(in crate::ply) energies: Energies<N>,
}

/// The lobes at an incidence; `None` where the beam misses.
#[inline(always)]
pub(in crate::ply) fn mixture<
    const FMA: bool,
    const H: usize,
    const R: usize,
    const L: usize,
    const J: usize,
    const N: usize,
>(
    tables: &Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<(Mixture<H, R, L, J, N>, Shapes<L>)> {
    let (mut x, params) = weights::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma)?;
    let shapes = x.shapes::<FMA>(&params, tables.bandwidth);
    x.scale::<FMA>();
    Some((x, shapes))
}

/// [`mixture`] without the shapes of the lobes and without [`Mixture::scale`], which together with the scale
/// suffices to choose a lobe.
#[inline(always)]
pub(in crate::ply) fn weights<
    const FMA: bool,
    const H: usize,
    const R: usize,
    const L: usize,
    const J: usize,
    const N: usize,
>(
    tables: &Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<(Mixture<H, R, L, J, N>, Params<L>)> {
    let p = &locate::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return None;
    }
    let node = interpolate_node::<FMA, H, R, J>(tables, p)?;
    let refl = interpolate_refl::<FMA, H, R, J>(tables, p)?;
    let high = interpolate_high::<FMA, H, R, J>(tables, p)?;
    let transmittance = transmittances::<FMA, J, N>(&tables.path, sigma);
    let energies = Energies { r_d: node.r_d, refl: node.refl, high: absorb::<FMA, J, N>(&node.high, &transmittance) };
    let mut params = [[0.0; L]; PARAMS];
    let mut least = [0.0; L];
    for k in 0..PARAMS {
        params[k][..H].copy_from_slice(&high.params[k]);
        params[k][H..H + R].copy_from_slice(&refl[k]);
    }
    least[..H].copy_from_slice(&tables.least_high);
    least[H..H + R].copy_from_slice(&tables.least_refl);
    let mut x = Mixture {
        energy: [0.0; L],
        spectrum: high.spectrum,
        transmittance,
        scale_high: [0.0; N],
        scale_refl: 0.0,
        pairs: tables.pairs,
        flip: p.flip,
        energies,
    };
    for i in 0..L {
        x.energy[i] = max(params[5][i], least[i]);
    }
    Some((x, params))
}

/// The `len` numbers of `x` from `at` on.
#[inline(always)]
fn part<const A: usize>(x: &[f32], at: usize) -> &[f32; A] {
    x.get(at..).and_then(|x| x.first_chunk()).unwrap_or(&[0.0; A])
}

impl<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> Mixture<H, R, L, J, N> {
    /// Finds the factors that scale the lobes to the simulated energies.
    #[inline(always)]
    pub(in crate::ply) fn scale<const FMA: bool>(&mut self) {
        let (refl, high) = self.absorbed::<FMA>(&self.energy);
        (self.scale_refl, self.scale_high) = scales(&self.energies, refl, &high);
    }

    /// Axes, widths and amplitudes of the lobes.
    #[inline(always)]
    pub(in crate::ply) fn shapes<const FMA: bool>(&self, params: &Params<L>, bandwidth: (f32, f32)) -> Shapes<L> {
        let zero = [0.0; L];
        let mut x = Shapes { axes: [zero; PARAMS], s1: zero, s2: zero, norm: zero, amplitude: zero };
        for i in 0..L {
            let a = axes::<FMA>(params[0][i], params[1][i], params[2][i]);
            (x.axes[0][i], x.axes[1][i]) = a.theta;
            (x.axes[2][i], x.axes[3][i]) = a.phi;
            (x.axes[4][i], x.axes[5][i]) = a.xy;
        }
        for i in 0..L {
            let s1 = root_width::<FMA>(params[3][i], bandwidth);
            let s2 = root_width::<FMA>(params[4][i], bandwidth);
            let (norm, amplitude) = amplitudes::<FMA>(s1, s2);
            x.s1[i] = s1;
            x.s2[i] = s2;
            x.norm[i] = self.energy[i] * norm;
            x.amplitude[i] = self.energy[i] * amplitude;
        }
        x
    }

    /// Sums over the lobes of `value` by lane: reflection, and high-order after absorption. Not scaled.
    #[inline(always)]
    fn absorbed<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; N]) {
        let high = absorbed::<FMA, H, J, N>(self.pairs, part(value, 0), &self.spectrum, &self.transmittance);
        (halves::<R>(*part(value, H)), high)
    }

    /// [`Mixture::absorbed`], scaled to the simulated energies.
    #[inline(always)]
    pub(in crate::ply) fn weigh<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; N]) {
        let (refl, mut high) = self.absorbed::<FMA>(value);
        for k in 0..N {
            high[k] *= self.scale_high[k];
        }
        (refl * self.scale_refl, high)
    }

    /// f_refl and f_high per sigma [1/sr].
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool>(&self, x: &Shapes<L>, wo: [f32; 3]) -> (f32, [f32; N]) {
        let v = mirrored(self.flip, wo);
        let mut value = [0.0; L];
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(x.axes(i), v);
            let (u, w) = (x.s1[i] * u, x.s2[i] * w);
            value[i] = shape::<FMA>(fma::<FMA>(u, u, w * w), cz) * x.amplitude[i];
        }
        self.weigh::<FMA>(&value)
    }

    /// Mean scattered energy plus the missed light: the total from which a sample is chosen.
    #[inline(always)]
    pub(in crate::ply) fn total(&self) -> f32 {
        DrawnBy::Mean.total(&self.energies)
    }

    /// f_refl and f_high per sigma and the density of sampling `wo` [1/sr], including missed light. `mean` is
    /// from [`Mixture::mean`].
    #[inline(always)]
    pub(in crate::ply) fn eval_pdf<const FMA: bool>(&self, x: &Shapes<L>, mean: &[f32; L], wo: [f32; 3]) -> Values<N> {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(x.axes(i), v);
            let (su, sw) = (x.s1[i] * u, x.s2[i] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            // a(t) in the direction t of (u, w); at the axis, where t is undefined, any mean of mu1 and mu2
            // works.
            let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
            value[i] = shape * x.amplitude[i];
            density[i] = shape * (mean[i] * x.norm[i]) / disc_share::<FMA>(a);
        }
        let (refl, high) = self.weigh::<FMA>(&value);
        let total = self.total();
        (refl, high, if total > 0.0 { halves(density) / total } else { 0.0 })
    }

    /// By high-order lobe and absorption: the factor on the energy of a lobe, scaled to the simulated energy.
    #[inline(always)]
    pub(in crate::ply) fn left<const FMA: bool>(&self) -> [[f32; N]; H] {
        let mut left = [[0.0; N]; H];
        for (left, spectrum) in left.iter_mut().zip(&self.spectrum).take(2 * self.pairs) {
            *left = absorb::<FMA, J, N>(spectrum, &self.transmittance);
            for k in 0..N {
                left[k] *= self.scale_high[k];
            }
        }
        left
    }

    /// By lane: the factor that gives the mean of a lobe's energy over the absorptions, scaled to the
    /// simulated energy.
    #[inline(always)]
    pub(in crate::ply) fn mean<const FMA: bool>(&self) -> [f32; L] {
        let share = 1.0 / N.max(1) as f32;
        let mut by_path = [0.0; J];
        for j in 0..J {
            let mut sum = 0.0;
            for k in 0..N {
                sum = fma::<FMA>(self.scale_high[k], self.transmittance[j][k], sum);
            }
            by_path[j] = share * sum;
        }
        let mut mean = [0.0; L];
        for l in H..H + R {
            mean[l] = self.scale_refl;
        }
        for (mean, spectrum) in mean.iter_mut().zip(&self.spectrum).take(2 * self.pairs) {
            let mut product = [0.0; J];
            for j in 0..J {
                product[j] = spectrum[j] * by_path[j];
            }
            *mean = halves(product);
        }
        mean
    }

    /// The lane where the running sum of the mean energies exceeds `left`; `None` where there is no energy.
    /// The lanes before it are counted without a branch, which a processor could not predict.
    #[inline(always)]
    pub(in crate::ply) fn choose<const FMA: bool>(&self, mean: &[f32; L], left: f32) -> Option<usize> {
        let (mut sums, mut sum) = ([f32::INFINITY; L], 0.0);
        for i in 0..H + R {
            sum = fma::<FMA>(self.energy[i], mean[i], sum);
            sums[i] = sum;
        }
        // Below the last sum despite rounding: a lane with energy exceeds it.
        let left = min(left, sum * (1.0 - f32::EPSILON));
        let mut passed = 0u32;
        for x in sums {
            passed += u32::from(x <= left);
        }
        (sum > 0.0).then_some(passed as usize & (L - 1))
    }

    /// Joins values of the lobes with the missed light.
    #[inline(always)]
    pub(in crate::ply) fn core(&self, refl: f32, high: [f32; N], pdf: f32) -> Core<N> {
        let (r_d, total) = (self.energies.r_d, self.total());
        Core { refl, high, pdf, r_d, missed: if total > 0.0 { r_d / total } else { 0.0 } }
    }

    /// A direction, f_refl, f_high and pdf there; `None` for missed light. For a mixture that is not scaled
    /// and whose lobes have no shapes yet: the lobe and the point on its disc are sampled first, in one long
    /// chain of scalar operations, and the processor fills its gaps with the shapes.
    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &mut self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        u: [f32; 3],
    ) -> Option<([f32; 3], Values<N>)> {
        let u = unit(u);
        let total = self.total();
        let left = u[0] * total;
        if left >= total - self.energies.r_d {
            return None;
        }
        self.scale::<FMA>();
        let mean = self.mean::<FMA>();
        self.sample_lobe::<FMA>(params, bandwidth, &mean, left, u)
    }

    /// [`Mixture::sample`] in the lane where the running sum of the energies exceeds `left`.
    #[inline(always)]
    pub(in crate::ply) fn sample_lobe<const FMA: bool>(
        &self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        mean: &[f32; L],
        left: f32,
        u: [f32; 3],
    ) -> Option<([f32; 3], Values<N>)> {
        let i = self.choose::<FMA>(mean, left)?;
        let width = |k: usize| root_width::<FMA>(params[k][i], bandwidth);
        let disc = disc_point::<FMA>(width(3), width(4), u[1], u[2]);
        let x = self.shapes::<FMA>(params, bandwidth);
        let wo = mirrored(self.flip, x.axes(i).direction(disc));
        Some((wo, self.eval_pdf::<FMA>(&x, mean, wo)))
    }
}
