//! The arithmetic of the runtime: the lobes of a model at one incidence, side by side in the lanes of
//! vectors, and their sums.
//!
//! Every loop over lanes is contiguous and of constant length, with a body long enough that the compiler
//! vectorizes it before it would unroll it. Let T be the transmittances of the J path lengths, e_l and p_l
//! the energy and spectrum of lobe l, and G_l its value. Then `f_high = scale * sum_j T_j V_j` with
//! `V_j = sum_l e_l G_l p_lj`. The sums V over the lobes are the same at all absorptions, and a loop over any
//! number of absorptions follows them. The density of samples is linear in the lobes too and is summed in the
//! same way. Bandwidths here are t = mu log2 e, stored as `s = sqrt(t)`:
//! `exp(-mu1 u^2 - mu2 w^2) = 2^-((s1 u)^2 + (s2 w)^2)`.

use super::absorption::{LobeTransmittances, PathBlock, Spectra, by_path, first_transmittances};
use super::energy::{DrawnBy, Rest, interpolate_node};
use super::grid_cell::{locate, mirrored};
use super::interpolate::{interpolate_high, interpolate_refl};
use super::layout::Tables;
use super::lobe::{Axes, amplitudes, axes, disc_point, disc_share, project, root_width, shape, unit};
use crate::math::simd::{fma, halves, max, min};
use crate::ply::asg::PARAMS;

/// Interpolated parameters of the lobes, `[parameter][lane]`.
pub(in crate::ply) type Params<const L: usize> = [[f32; L]; PARAMS];

/// Shapes of the lobes of a [`Mixture`].
pub(in crate::ply) struct Shapes<const L: usize> {
    /// Sines and cosines of the angles.
    pub(in crate::ply) axes: [[f32; L]; PARAMS],
    /// sqrt(mu1 log2 e), sqrt(mu2 log2 e).
    pub(in crate::ply) s1: [f32; L],
    pub(in crate::ply) s2: [f32; L],
    /// Energy times sqrt(mu1 mu2) / pi.
    pub(in crate::ply) norm: [f32; L],
    /// Energy divided by the energy of the lobe with amplitude 1.
    pub(in crate::ply) amplitude: [f32; L],
}

impl<const L: usize> Shapes<L> {
    #[inline(always)]
    fn axes(&self, i: usize) -> Axes {
        let a = &self.axes;
        Axes { theta: (a[0][i], a[1][i]), phi: (a[2][i], a[3][i]), xy: (a[4][i], a[5][i]) }
    }
}

/// The weights of the lobes at one incidence, for J path lengths. H lanes hold high-order lobes and R hold
/// reflection lobes; the others up to L are empty.
pub(in crate::ply) struct Mixture<'a, const H: usize, const R: usize, const L: usize, const J: usize> {
    /// Energies before the scale to the simulated energy.
    pub(in crate::ply) energy: [f32; L],
    /// Path-length spectra of the high-order lobes.
    pub(in crate::ply) spectrum: [[f32; J]; H],
    pub(in crate::ply) r_d: f32,
    /// Simulated energy of f_refl.
    pub(in crate::ply) refl: f32,
    /// Scale of the high-order lobes to the simulated energy, computed before a slit removes its share.
    spectra: Spectra<'a, J>,
    /// Scale of the reflection lobes to the simulated energy.
    pub(in crate::ply) scale_refl: f32,
    /// Number of pairs of high-order lobes.
    pub(in crate::ply) pairs: usize,
    pub(in crate::ply) flip: bool,
}

/// The weights by which a sample chooses a lobe.
pub(in crate::ply) struct Drawing<const L: usize> {
    /// For each lane, the factor on a lobe's energy that gives its mean over the absorptions, scaled to the
    /// simulated energy.
    pub(in crate::ply) mean: [f32; L],
    /// The scattered energy, as mean over the absorptions, plus the missed light.
    pub(in crate::ply) total: f32,
}

/// The lobes at an incidence; `None` if the beam misses.
#[inline(always)]
pub(in crate::ply) fn mixture<'a, const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &'a Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32],
) -> Option<(Mixture<'a, H, R, L, J>, Shapes<L>)> {
    let (mut x, params) = weights::<FMA, H, R, L, J>(tables, theta_i, h_um, sigma)?;
    let shapes = x.shapes::<FMA>(&params, tables.bandwidth);
    x.scale::<FMA>();
    Some((x, shapes))
}

/// [`mixture`] without the shapes of the lobes and before [`Mixture::scale`]. Once scaled, it suffices to
/// choose a lobe.
#[inline(always)]
pub(in crate::ply) fn weights<'a, const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &'a Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32],
) -> Option<(Mixture<'a, H, R, L, J>, Params<L>)> {
    let first = first_transmittances(&tables.path, sigma);
    let p = &locate::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return None;
    }
    let node = interpolate_node::<FMA, H, R, J>(tables, p)?;
    let refl = interpolate_refl::<FMA, H, R, J>(tables, p)?;
    let high = interpolate_high::<FMA, H, R, J>(tables, p)?;
    let mut params = [[0.0; L]; PARAMS];
    let mut min_energy = [0.0; L];
    for k in 0..PARAMS {
        params[k][..H].copy_from_slice(&high.params[k]);
        params[k][H..H + R].copy_from_slice(&refl[k]);
    }
    min_energy[..H].copy_from_slice(&tables.min_energy_high);
    min_energy[H..H + R].copy_from_slice(&tables.min_energy_refl);
    let mut x = Mixture {
        energy: [0.0; L],
        spectrum: high.spectrum,
        r_d: node.r_d,
        refl: node.refl,
        spectra: Spectra { path: &tables.path, simulated: node.high, all: [0.0; J], first },
        scale_refl: 0.0,
        pairs: tables.pairs,
        flip: p.flip,
    };
    for i in 0..L {
        x.energy[i] = max(params[5][i], min_energy[i]);
    }
    Some((x, params))
}

/// The `A` numbers of `x` from index `at` on; zeros beyond the end.
#[inline(always)]
fn part<const A: usize>(x: &[f32], at: usize) -> &[f32; A] {
    x.get(at..).and_then(|x| x.first_chunk()).unwrap_or(&[0.0; A])
}

impl<const H: usize, const R: usize, const L: usize, const J: usize> Mixture<'_, H, R, L, J> {
    /// Computes the factors that scale the lobes to the simulated energies.
    #[inline(always)]
    pub(in crate::ply) fn scale<const FMA: bool>(&mut self) {
        let (refl, high) = self.sum::<FMA>(&self.energy);
        (self.scale_refl, self.spectra.all) = (self.refl / refl, high);
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

    /// Sums of `value[lane]` over the lobes, not scaled: over the reflection lobes, and over the high-order
    /// lobes by path length.
    #[inline(always)]
    pub(in crate::ply) fn sum<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; J]) {
        let high = by_path::<FMA, H, J>(self.pairs, part(value, 0), &self.spectrum);
        (halves::<R>(*part(value, H)), high)
    }

    /// Writes f_high for each absorption [1/sr] to `high`, from values and densities by lane, and returns the
    /// other values. The density is computed only if `PDF`. `block` is the first block of absorptions, if it
    /// is known.
    #[inline(always)]
    pub(in crate::ply) fn absorb<const FMA: bool, const PDF: bool>(
        &self,
        (value, density): (&[f32; L], &[f32; L]),
        (sigma, block): (&[f32], Option<&PathBlock<J>>),
        high: &mut [f32],
    ) -> Rest {
        let (refl, by_path) = self.sum::<FMA>(value);
        let (density_refl, density_by_path) = if PDF { self.sum::<FMA>(density) } else { (0.0, [0.0; J]) };
        let light = [&by_path, &density_by_path];
        let of = match block {
            Some(block) => self.spectra.absorb_known(block, light, sigma, high),
            None => self.spectra.absorb::<PDF>(light, sigma, high),
        };
        let share = 1.0 / sigma.len().max(1) as f32;
        let total = self.r_d + (self.refl + of.energy * share);
        let per_total = if total > 0.0 { 1.0 / total } else { 0.0 };
        let density = if PDF { fma::<FMA>(density_refl, self.scale_refl, of.density * share) } else { 0.0 };
        Rest { refl: refl * self.scale_refl, pdf: density * per_total, r_d: self.r_d, missed: self.r_d * per_total }
    }

    /// Values for missed light: the lobes contribute nothing.
    #[inline(always)]
    pub(in crate::ply) fn dark(&self, drawing: &Drawing<L>) -> Rest {
        let missed = if drawing.total > 0.0 { self.r_d / drawing.total } else { 0.0 };
        Rest { refl: 0.0, pdf: 0.0, r_d: self.r_d, missed }
    }

    /// The weights by which a sample chooses a lobe, as mean over the absorptions. Writes the first block of
    /// absorptions to `block`.
    #[inline(always)]
    pub(in crate::ply) fn drawing(&self, sigma: &[f32], block: &mut PathBlock<J>) -> Drawing<L> {
        let (transmittance, energy) = self.spectra.transmittance(sigma, block);
        let share = 1.0 / sigma.len().max(1) as f32;
        let mut mean = self.reflected();
        for (mean, spectrum) in mean.iter_mut().zip(&self.spectrum).take(2 * self.pairs) {
            let mut product = [0.0; J];
            for j in 0..J {
                product[j] = spectrum[j] * transmittance[j];
            }
            *mean = share * halves(product);
        }
        Drawing { mean, total: self.r_d + (self.refl + energy * share) }
    }

    /// [`Mixture::drawing`] by the mean or by the first absorption. Also writes the transmittances of the
    /// lobes.
    #[inline(always)]
    pub(in crate::ply) fn drawing_by(&self, sigma: &[f32], by: DrawnBy, lobes: LobeTransmittances<'_>) -> Drawing<L> {
        let count = if by == DrawnBy::First { sigma.len().min(1) } else { sigma.len() };
        let (sums, energy) = self.spectra.of_lobes(&self.spectrum, (sigma, count), lobes);
        let share = 1.0 / count.max(1) as f32;
        let mut mean = self.reflected();
        for l in 0..H {
            mean[l] = share * sums[l];
        }
        Drawing { mean, total: self.r_d + (self.refl + energy * share) }
    }

    /// The factors on the lobes of f_refl, by lane; 0 in other lanes.
    #[inline(always)]
    fn reflected(&self) -> [f32; L] {
        let mut mean = [0.0; L];
        for l in H..H + R {
            mean[l] = self.scale_refl;
        }
        mean
    }

    /// Writes f_high for each absorption [1/sr] to `high`, and returns the other values. The density of
    /// sampling `wo`, among all outcomes including missed light, is computed only if `PDF`.
    #[inline(always)]
    pub(in crate::ply) fn eval<const FMA: bool, const PDF: bool>(
        &self,
        x: &Shapes<L>,
        sigma: (&[f32], Option<&PathBlock<J>>),
        wo: [f32; 3],
        high: &mut [f32],
    ) -> Rest {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(x.axes(i), v);
            let (su, sw) = (x.s1[i] * u, x.s2[i] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            value[i] = shape * x.amplitude[i];
            if PDF {
                // a(t) in the direction t of (u, w). On the axis t is undefined, and any mean of mu1 and mu2
                // serves.
                let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
                density[i] = shape * x.norm[i] / disc_share::<FMA>(a);
            }
        }
        self.absorb::<FMA, PDF>((&value, &density), sigma, high)
    }

    /// The lane at which the running sum of the mean energies exceeds `target`; `None` if there is no energy.
    /// The lanes before it are counted without a branch, which a processor could not predict.
    #[inline(always)]
    pub(in crate::ply) fn choose<const FMA: bool>(&self, mean: &[f32; L], target: f32) -> Option<usize> {
        let (mut sums, mut sum) = ([f32::INFINITY; L], 0.0);
        for i in 0..H + R {
            sum = fma::<FMA>(self.energy[i], mean[i], sum);
            sums[i] = sum;
        }
        // Clamped below the last sum despite rounding, so that a lane with energy exceeds it.
        let target = min(target, sum * (1.0 - f32::EPSILON));
        let mut passed = 0u32;
        for x in sums {
            passed += u32::from(x <= target);
        }
        (sum > 0.0).then_some(passed as usize & (L - 1))
    }

    /// Samples a direction and evaluates f_refl, f_high and the density there; the direction is `None` for
    /// missed light. The mixture must be scaled, and its lobes have no shapes yet. The lobe and the point on
    /// its disc are sampled first, in one long chain of scalar operations, whose latency the processor hides
    /// by computing the shapes.
    #[inline(always)]
    pub(in crate::ply) fn sample<const FMA: bool>(
        &self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        sigma: &[f32],
        u: [f32; 3],
        high: &mut [f32],
    ) -> (Option<[f32; 3]>, Rest) {
        let u = unit(u);
        let mut block = PathBlock::none();
        let drawing = self.drawing(sigma, &mut block);
        let target = u[0] * drawing.total;
        if target < drawing.total - self.r_d
            && let Some((wo, x)) = self.sample_lobe::<FMA>(params, bandwidth, &drawing.mean, target, u)
        {
            return (Some(wo), self.eval::<FMA, true>(&x, (sigma, Some(&block)), wo, high));
        }
        high.fill(0.0);
        (None, self.dark(&drawing))
    }

    /// A direction of the lobe at which the running sum of the energies exceeds `target`, and the shapes of
    /// all lobes.
    #[inline(always)]
    pub(in crate::ply) fn sample_lobe<const FMA: bool>(
        &self,
        params: &Params<L>,
        bandwidth: (f32, f32),
        mean: &[f32; L],
        target: f32,
        u: [f32; 3],
    ) -> Option<([f32; 3], Shapes<L>)> {
        let i = self.choose::<FMA>(mean, target)?;
        let width = |k: usize| root_width::<FMA>(params[k][i], bandwidth);
        let disc = disc_point::<FMA>(width(3), width(4), u[1], u[2]);
        let x = self.shapes::<FMA>(params, bandwidth);
        Some((mirrored(self.flip, x.axes(i).direction(disc)), x))
    }
}
