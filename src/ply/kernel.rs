//! The arithmetic of the runtime: the lobes of a model at one incidence side by side in the lanes of vectors, and their sums.
//!
//! Every loop over lanes is contiguous, of constant length, and long enough a body that the compiler makes it vector code before
//! it would unroll it. With T the transmittances of the J path lengths, e_l and p_l the energy and spectrum of lobe l and G_l its
//! value, `f_high = scale * sum_j T_j sum_l e_l G_l p_lj`, so the sum over lobes is done once for all absorptions. Bandwidths
//! are t = mu log2 e here, as `s = sqrt(t)`: `exp(-mu1 u^2 - mu2 w^2) = 2^-((s1 u)^2 + (s2 w)^2)`.

use super::layout::{Grid, High, Node, Tables};
use super::reference::LEAST_TRANSMITTANCE;
use crate::asg::PARAMS;
use crate::simd::{exp2, exp2_within, fma, ln, max, min, signed, sin_cos_half_turns};
use std::f32::consts::{LN_2, LOG2_E, PI};

/// r_d, energy of f_refl and of f_high per sigma.
#[derive(Clone, Copy)]
pub(super) struct Energies<const N: usize> {
    pub(super) r_d: f32,
    pub(super) refl: f32,
    pub(super) high: [f32; N],
}

impl<const N: usize> Energies<N> {
    /// What a beam beyond the nodes meets: nothing.
    pub(super) const MISS: Self = Energies { r_d: 1.0, refl: 0.0, high: [0.0; N] };
}

/// What the lobes answer in one direction, and the light they leave.
#[derive(Clone, Copy)]
pub(super) struct Core<const N: usize> {
    pub(super) refl: f32,
    pub(super) high: [f32; N],
    /// Density of sampling the direction; 0 where it was not asked for.
    pub(super) pdf: f32,
    pub(super) r_d: f32,
    /// Chance that a sample is of the missed light.
    pub(super) missed: f32,
}

impl<const N: usize> Core<N> {
    /// Of a beam beyond the nodes.
    pub(super) const MISS: Self = Core { refl: 0.0, high: [0.0; N], pdf: 0.0, r_d: 1.0, missed: 1.0 };
}

/// Interpolation at one incidence.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Whether the beam is within the nodes.
    pub(super) hit: bool,
    /// Whether theta_i < 0: directions are mirrored on the way in and out.
    pub(super) flip: bool,
    /// Where the tables hold the cell's energies, its reflection lobes, and the block.
    node: u32,
    refl: u32,
    high: u32,
    /// Catmull-Rom weights of nodes -1..=2 of the cell along theta_i and h.
    wm: [f32; 4],
    wn: [f32; 4],
    /// Bilinear weights of the corners of the cell and of the block, theta_i the slower index.
    cell: [f32; 4],
    block: [f32; 4],
}

/// The place of any incidence, one beyond the nodes included, without a branch.
#[inline(always)]
pub(super) fn place<const FMA: bool>(grid: &Grid, theta_i: f32, h_um: f32) -> Place {
    let flip = theta_i < 0.0;
    let h = if flip { -h_um } else { h_um };
    let t = min(theta_i.abs() * grid.per_theta, grid.last_theta);
    let x = min(max((h + grid.h_last) * grid.per_h, 0.0), grid.last_h);
    let (m, n) = (min(t.floor(), grid.last_theta - 1.0), min(x.floor(), grid.last_h - 1.0));
    let (fm, fn_) = (t - m, x - n);
    let (half_m, half_n) = (0.5 * m, 0.5 * n);
    // 2^23 plus a whole number has that number in its low bits.
    let bits = |x: f32| (x + 8_388_608.0).to_bits() & 0x7f_ffff;
    let (row, column) = (bits(m), bits(n));
    Place {
        hit: h_um.abs() <= grid.h_last && !theta_i.is_nan(),
        flip,
        node: row * grid.nodes_h + column,
        refl: row * (grid.nodes_h + 2) + column,
        high: (row / 2) * (grid.nodes_h / 2) + column / 2,
        wm: catmull_rom::<FMA>(fm),
        wn: catmull_rom::<FMA>(fn_),
        cell: bilinear(fm, fn_),
        block: bilinear(half_m - half_m.floor() + 0.5 * fm, half_n - half_n.floor() + 0.5 * fn_),
    }
}

/// Places side by side.
pub(super) struct Places<const W: usize> {
    pub(super) hit: [u32; W],
    flip: [u32; W],
    at: [[u32; W]; 3],
    weights: [[f32; W]; 16],
}

impl<const W: usize> Places<W> {
    #[inline(always)]
    pub(super) fn new<const FMA: bool>(grid: &Grid, theta_i: &[f32; W], h_um: &[f32; W]) -> Self {
        let mut x = Places { hit: [0; W], flip: [0; W], at: [[0; W]; 3], weights: [[0.0; W]; 16] };
        for q in 0..W {
            let p = place::<FMA>(grid, theta_i[q], h_um[q]);
            x.hit[q] = u32::from(p.hit);
            x.flip[q] = u32::from(p.flip);
            (x.at[0][q], x.at[1][q], x.at[2][q]) = (p.node, p.refl, p.high);
            for k in 0..4 {
                x.weights[k][q] = p.wm[k];
                x.weights[4 + k][q] = p.wn[k];
                x.weights[8 + k][q] = p.cell[k];
                x.weights[12 + k][q] = p.block[k];
            }
        }
        x
    }

    /// Directions as at theta_i >= 0.
    #[inline(always)]
    pub(super) fn mirror(&self, v: &mut [[f32; W]; 3]) {
        for q in 0..W {
            [v[0][q], v[1][q], v[2][q]] = mirrored(self.flip[q] != 0, [v[0][q], v[1][q], v[2][q]]);
        }
    }

    #[inline(always)]
    pub(super) fn get(&self, q: usize) -> Place {
        let w = |k: usize| [self.weights[k][q], self.weights[k + 1][q], self.weights[k + 2][q], self.weights[k + 3][q]];
        Place {
            hit: self.hit[q] != 0,
            flip: self.flip[q] != 0,
            node: self.at[0][q],
            refl: self.at[1][q],
            high: self.at[2][q],
            wm: w(0),
            wn: w(4),
            cell: w(8),
            block: w(12),
        }
    }
}

/// Catmull-Rom weights of nodes -1..=2 of the cell at fraction `f`: four polynomials side by side.
#[inline(always)]
fn catmull_rom<const FMA: bool>(f: f32) -> [f32; 4] {
    const C: [[f32; 4]; 4] =
        [[0.0, 1.0, 0.0, 0.0], [-0.5, 0.0, 0.5, 0.0], [1.0, -2.5, 2.0, -0.5], [-0.5, 1.5, -1.5, 0.5]];
    let mut w = C[3];
    for c in [C[2], C[1], C[0]] {
        for i in 0..4 {
            w[i] = fma::<FMA>(w[i], f, c[i]);
        }
    }
    w
}

/// Bilinear weights, theta the slower index.
#[inline(always)]
fn bilinear(fm: f32, fn_: f32) -> [f32; 4] {
    [(1.0 - fm) * (1.0 - fn_), (1.0 - fm) * fn_, fm * (1.0 - fn_), fm * fn_]
}

/// `w[0] x[0] + .. + w[3] x[3]`.
#[inline(always)]
fn mix<const FMA: bool>(w: [f32; 4], x: [f32; 4]) -> f32 {
    fma::<FMA>(w[3], x[3], fma::<FMA>(w[2], x[2], fma::<FMA>(w[1], x[1], w[0] * x[0])))
}

/// The absorption that is any number: not a number counts as 0, the range is 0 to 1e6 per um.
#[inline(always)]
pub(super) fn clamped_sigma<const N: usize>(sigma: &[f32; N]) -> [f32; N] {
    let mut s = [0.0; N];
    for k in 0..N {
        s[k] = min(max(sigma[k], 0.0), 1e6);
    }
    s
}

/// Transmittance of a path from its binary logarithm.
#[inline(always)]
pub(super) fn transmittance<const FMA: bool>(log2: f32) -> f32 {
    exp2::<FMA>(log2) + LEAST_TRANSMITTANCE as f32
}

/// Transmittances of the path lengths.
#[inline(always)]
fn transmittances<const FMA: bool, const J: usize, const N: usize>(path: &[f32; J], sigma: &[f32; N]) -> [[f32; N]; J] {
    let sigma = clamped_sigma(sigma);
    let mut t = [[0.0; N]; J];
    for j in 0..J {
        for k in 0..N {
            t[j][k] = sigma[k] * path[j];
        }
    }
    for t in t.as_flattened_mut() {
        *t = transmittance::<FMA>(*t);
    }
    t
}

/// r_d, energy of f_refl, spectrum of the energy of f_high, bilinear over the nodes.
#[inline(always)]
pub(super) fn interpolate_node<const FMA: bool, const J: usize>(nodes: &[[Node<J>; 2]], p: &Place) -> Option<Node<J>> {
    let [[a, c], [b, d]] = nodes.get(p.node as usize..)?.first_chunk()?;
    let w = p.cell;
    let mut high = [0.0; J];
    for j in 0..J {
        high[j] = mix::<FMA>(w, [a.high[j], b.high[j], c.high[j], d.high[j]]);
    }
    let r_d = mix::<FMA>(w, [a.r_d, b.r_d, c.r_d, d.r_d]);
    Some(Node { r_d, refl: mix::<FMA>(w, [a.refl, b.refl, c.refl, d.refl]), high })
}

/// Sum over path lengths of a spectrum times its transmittances.
#[inline(always)]
pub(super) fn absorb<const FMA: bool, const J: usize, const N: usize>(
    spectrum: &[f32; J],
    t: &[[f32; N]; J],
) -> [f32; N] {
    // Two sums halve the chain of dependent additions.
    let (mut even, mut odd) = ([0.0; N], [0.0; N]);
    for j in 0..J / 2 {
        for k in 0..N {
            even[k] = fma::<FMA>(spectrum[2 * j], t[2 * j][k], even[k]);
            odd[k] = fma::<FMA>(spectrum[2 * j + 1], t[2 * j + 1][k], odd[k]);
        }
    }
    for k in 0..N {
        even[k] += odd[k];
    }
    even
}

/// Exact energies at an incidence: what `albedo` and `r_d` report and what the lobes are scaled to.
#[inline(always)]
pub(super) fn energies<const FMA: bool, const H: usize, const R: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Option<Energies<N>> {
    let p = &place::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return None;
    }
    let node = interpolate_node::<FMA, J>(&tables.nodes, p)?;
    let t = transmittances::<FMA, J, N>(&tables.path, sigma);
    Some(Energies { r_d: node.r_d, refl: node.refl, high: absorb::<FMA, J, N>(&node.high, &t) })
}

/// Reflection lobes, bicubic over the nodes.
#[inline(always)]
pub(super) fn interpolate_refl<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &Place,
) -> Option<[[f32; R]; PARAMS]> {
    let nodes = tables.refl.get(p.refl as usize..)?.first_chunk::<4>()?;
    let node = |a: usize, b: usize| nodes[b].0[a].as_flattened();
    let mut sum = [[0.0; R]; PARAMS];
    for (i, value) in sum.as_flattened_mut().iter_mut().enumerate() {
        let along = |a: usize| mix::<FMA>(p.wn, [node(a, 0)[i], node(a, 1)[i], node(a, 2)[i], node(a, 3)[i]]);
        *value = mix::<FMA>(p.wm, [along(0), along(1), along(2), along(3)]);
    }
    Some(sum)
}

/// High-order lobes and their spectra, bilinear over the corners of the block, which spans two cells each way.
#[inline(always)]
pub(super) fn interpolate_high<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &Place,
) -> Option<High<H, J>> {
    let [a, b, c, d] = tables.high.get(p.high as usize)?;
    let w = p.block;
    let mut high = High { params: [[0.0; H]; PARAMS], spectrum: [[0.0; J]; H] };
    let (pa, pb) = (a.params.as_flattened(), b.params.as_flattened());
    let (pc, pd) = (c.params.as_flattened(), d.params.as_flattened());
    for (i, value) in high.params.as_flattened_mut().iter_mut().enumerate() {
        *value = mix::<FMA>(w, [pa[i], pb[i], pc[i], pd[i]]);
    }
    let (pa, pb) = (a.spectrum.as_flattened(), b.spectrum.as_flattened());
    let (pc, pd) = (c.spectrum.as_flattened(), d.spectrum.as_flattened());
    for (i, value) in high.spectrum.as_flattened_mut().iter_mut().enumerate() {
        *value = mix::<FMA>(w, [pa[i], pb[i], pc[i], pd[i]]);
    }
    Some(high)
}

// Coefficients of the mean over s of 1 - exp(-1/b(s)) (see asg.rs) in x = (a + b)/2 and y = a b, a = (2 - mu1)/(2 + mu1) and b
// likewise of mu2: row j multiplies y^j. A minimax fit for bandwidths from MU_MIN to MU_MAX, relative error 9e-5 in f32 (tested);
// the 12-node quadrature, good to 1e-4 itself, costs ten times as much.
const MEAN_0: [f32; 11] = [
    0.86472696,
    -0.5413396,
    -1.0858794,
    -0.33280998,
    0.20640504,
    -3.191828,
    -0.32349062,
    10.540188,
    -7.891373,
    -42.007984,
    -28.1854,
];
const MEAN_1: [f32; 9] =
    [0.54242563, 0.51795506, -0.022908885, 3.760259, 1.3267359, -18.587229, 12.092752, 99.15994, 81.44035];
const MEAN_2: [f32; 7] = [0.008833905, -0.87465584, -0.9746874, 9.540781, -4.5728836, -78.518135, -82.348946];
const MEAN_3: [f32; 5] = [0.103313036, -1.2792708, 0.07296818, 23.176245, 33.99076];
const MEAN_4: [f32; 3] = [0.04638332, -1.8602276, -4.9093513];
const MEAN_5: [f32; 1] = [0.121228844];

/// Polynomial of even degree in x, constant term first, its even and odd powers apart: half the chain of Horner's rule.
#[inline(always)]
fn polynomial<const FMA: bool, const M: usize>(c: [f32; M], x: f32, x2: f32) -> f32 {
    let (mut even, mut odd) = (c[M - 1], c[M - 2]);
    for i in (0..M / 2).rev() {
        even = fma::<FMA>(even, x2, c[2 * i]);
    }
    for i in (0..M / 2 - 1).rev() {
        odd = fma::<FMA>(odd, x2, c[2 * i + 1]);
    }
    fma::<FMA>(odd, x, even)
}

/// Energy of a lobe with amplitude 1, times sqrt(mu1 mu2) / pi, of the bandwidths mu log2 e.
#[inline(always)]
fn unit_mean<const FMA: bool>(t1: f32, t2: f32) -> f32 {
    let (d1, d2) = (2.0 * LOG2_E + t1, 2.0 * LOG2_E + t2);
    let both = 1.0 / (d1 * d2);
    let (a, b) = ((2.0 * LOG2_E - t1) * (d2 * both), (2.0 * LOG2_E - t2) * (d1 * both));
    let (x, y) = (0.5 * (a + b), a * b);
    let (x2, y2) = (x * x, y * y);
    let p01 = fma::<FMA>(polynomial::<FMA, 9>(MEAN_1, x, x2), y, polynomial::<FMA, 11>(MEAN_0, x, x2));
    let p23 = fma::<FMA>(polynomial::<FMA, 5>(MEAN_3, x, x2), y, polynomial::<FMA, 7>(MEAN_2, x, x2));
    let p45 = fma::<FMA>(MEAN_5[0], y, polynomial::<FMA, 3>(MEAN_4, x, x2));
    fma::<FMA>(fma::<FMA>(p45, y2, p23), y2, p01)
}

/// Axes of a lobe: sines and cosines of theta_z, phi_z, phi_xy. The sign of the last pair does not matter to an even lobe.
#[derive(Clone, Copy)]
pub(super) struct Axes {
    pub(super) theta: (f32, f32),
    pub(super) phi: (f32, f32),
    pub(super) xy: (f32, f32),
}

/// Sine and cosine of x half turns.
#[inline(always)]
pub(super) fn sin_cos<const FMA: bool>(x: f32) -> (f32, f32) {
    let (s, c, sign) = sin_cos_half_turns::<FMA>(x);
    (signed(s, sign), signed(c, sign))
}

#[inline(always)]
fn axes<const FMA: bool>(theta: f32, phi: f32, xy: f32) -> Axes {
    let (st, ct, sign_t) = sin_cos_half_turns::<FMA>(theta);
    let (sp, cp, sign_p) = sin_cos_half_turns::<FMA>(phi);
    let (sx, cx, _) = sin_cos_half_turns::<FMA>(xy);
    Axes {
        theta: (signed(st, sign_t), signed(ct, sign_t)),
        phi: (signed(sp, sign_p), signed(cp, sign_p)),
        xy: (sx, cx),
    }
}

/// Square root of a bandwidth times log2 e, from the number stored.
#[inline(always)]
pub(super) fn root_width<const FMA: bool>(stored: f32, bounds: (f32, f32)) -> f32 {
    exp2_within::<FMA>(min(max(stored, bounds.0), bounds.1))
}

/// `sqrt(mu1 mu2) / pi` and the amplitude of a lobe of energy 1.
#[inline(always)]
pub(super) fn amplitudes<const FMA: bool>(s1: f32, s2: f32) -> (f32, f32) {
    let norm = s1 * s2 * (1.0 / (PI * LOG2_E));
    (norm, norm / unit_mean::<FMA>(s1 * s1, s2 * s2))
}

/// Components of `v` along x, y and z of a lobe; the first two share an arbitrary sign.
#[inline(always)]
pub(super) fn project<const FMA: bool>(x: Axes, v: [f32; 3]) -> [f32; 3] {
    let ((st, ct), (sp, cp), (sx, cx)) = (x.theta, x.phi, x.xy);
    let across = fma::<FMA>(cp, v[1], -sp * v[0]);
    let along = fma::<FMA>(cp, v[0], sp * v[1]);
    let up = fma::<FMA>(ct, v[2], -st * along);
    let cz = fma::<FMA>(ct, along, st * v[2]);
    [fma::<FMA>(cx, across, sx * up), fma::<FMA>(cx, up, -sx * across), cz]
}

/// `cz 2^-q` in front of the lobe; the comparisons are false for what is not a number.
#[inline(always)]
pub(super) fn shape<const FMA: bool>(q: f32, cz: f32) -> f32 {
    let value = cz * exp2_within::<FMA>(-q);
    // Below 2^-100 a lobe is dark; products of it could be denormal, which is slow.
    if cz > 0.0 && cz < 2.0 && q < 100.0 { value } else { 0.0 }
}

/// Sum over the high-order lobes after absorption. Not scaled.
#[inline(always)]
pub(super) fn absorbed<const FMA: bool, const H: usize, const J: usize, const N: usize>(
    pairs: usize,
    value: &[f32; H],
    spectrum: &[[f32; J]; H],
    t: &[[f32; N]; J],
) -> [f32; N] {
    // Of as many turns as there are pairs of lobes, which the compiler does not know: it then keeps the path lengths in vectors.
    let (mut even, mut odd) = ([0.0; J], [0.0; J]);
    for (value, spectrum) in value.as_chunks::<2>().0.iter().zip(spectrum.as_chunks::<2>().0).take(pairs) {
        for j in 0..J {
            even[j] = fma::<FMA>(value[0], spectrum[0][j], even[j]);
            odd[j] = fma::<FMA>(value[1], spectrum[1][j], odd[j]);
        }
    }
    for j in 0..J {
        even[j] += odd[j];
    }
    absorb::<FMA, J, N>(&even, t)
}

/// f_refl and f_high per sigma in a direction, and the density of sampling it [1/sr].
pub(super) type Values<const N: usize> = (f32, [f32; N], f32);

/// Shapes of the lobes of a [`Mixture`].
pub(super) struct Shapes<const L: usize> {
    /// Sines and cosines of the angles.
    axes: [[f32; L]; PARAMS],
    /// sqrt(mu1 log2 e), sqrt(mu2 log2 e).
    s1: [f32; L],
    s2: [f32; L],
    /// Energy * sqrt(mu1 mu2) / pi.
    norm: [f32; L],
    /// Energy / energy of the lobe with amplitude 1.
    amplitude: [f32; L],
}

impl<const L: usize> Shapes<L> {
    #[inline(always)]
    fn axes(&self, i: usize) -> Axes {
        let a = &self.axes;
        Axes { theta: (a[0][i], a[1][i]), phi: (a[2][i], a[3][i]), xy: (a[4][i], a[5][i]) }
    }
}

/// The weights of the lobes at one incidence: H high-order and R reflection lanes, then empty ones up to L; J path lengths, N absorptions.
pub(super) struct Mixture<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> {
    /// Rows of the tables, interpolated.
    pub(super) params: [[f32; L]; PARAMS],
    /// Energy before the scale to the simulated energy.
    pub(super) energy: [f32; L],
    /// Path-length spectra of the high-order lobes.
    spectrum: [[f32; J]; H],
    /// Transmittance of each path length.
    transmittance: [[f32; N]; J],
    /// What makes the high-order lobes add up to the simulated energy.
    scale_high: [f32; N],
    /// What makes the reflection lobes add up to the simulated energy.
    scale_refl: f32,
    /// Pairs of high-order lobes.
    pairs: usize,
    flip: bool,
    pub(super) energies: Energies<N>,
}

/// The lobes at an incidence; `None` where the beam misses.
#[inline(always)]
pub(super) fn mixture<
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
    let mut x = weights::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma)?;
    let shapes = x.shapes::<FMA>(tables.bandwidth);
    x.scale::<FMA>();
    Some((x, shapes))
}

/// [`mixture`] without the shapes of the lobes and without [`Mixture::scale`]: with that, enough to choose a lobe by.
#[inline(always)]
pub(super) fn weights<
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
) -> Option<Mixture<H, R, L, J, N>> {
    let p = &place::<FMA>(&tables.grid, theta_i, h_um);
    if !p.hit {
        return None;
    }
    let node = interpolate_node::<FMA, J>(&tables.nodes, p)?;
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
        params,
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
    Some(x)
}

/// What makes lobes of these sums of energies add up to the simulated energies.
#[inline(always)]
pub(super) fn scales<const N: usize>(energies: &Energies<N>, refl: f32, high: &[f32; N]) -> (f32, [f32; N]) {
    let mut scale = [0.0; N];
    for k in 0..N {
        scale[k] = energies.high[k] / high[k];
    }
    (energies.refl / refl, scale)
}

/// f_refl + f_high. (The standard `map` is not always inlined into code for other instruction sets than the default one.)
#[inline(always)]
pub(super) fn sum<const N: usize>(refl: f32, mut high: [f32; N]) -> [f32; N] {
    for f in &mut high {
        *f += refl;
    }
    high
}

/// Reflection part plus the mean of the high-order parts.
#[inline(always)]
fn mean_sum<const N: usize>(refl: f32, high: &[f32; N]) -> f32 {
    refl + high.iter().sum::<f32>() * (1.0 / N.max(1) as f32)
}

/// Sum by halves; the length is a power of 2.
#[inline(always)]
pub(super) fn halves<const J: usize>(mut x: [f32; J]) -> f32 {
    let mut n = J;
    while n > 1 {
        n /= 2;
        for j in 0..n {
            x[j] += x[j + n];
        }
    }
    x[0]
}

#[inline(always)]
pub(super) fn mirrored(flip: bool, w: [f32; 3]) -> [f32; 3] {
    if flip { crate::mirror_incidence(w) } else { w }
}

/// The `len` numbers of `x` from `at` on.
#[inline(always)]
fn part<const A: usize>(x: &[f32], at: usize) -> &[f32; A] {
    x.get(at..).and_then(|x| x.first_chunk()).unwrap_or(&[0.0; A])
}

impl<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize> Mixture<H, R, L, J, N> {
    /// Finds what makes the lobes add up to the simulated energies.
    #[inline(always)]
    pub(super) fn scale<const FMA: bool>(&mut self) {
        let (refl, high) = self.absorbed::<FMA>(&self.energy);
        (self.scale_refl, self.scale_high) = scales(&self.energies, refl, &high);
    }

    /// Axes, widths and amplitudes of the lobes.
    #[inline(always)]
    pub(super) fn shapes<const FMA: bool>(&self, bandwidth: (f32, f32)) -> Shapes<L> {
        let (params, zero) = (&self.params, [0.0; L]);
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
    pub(super) fn weigh<const FMA: bool>(&self, value: &[f32; L]) -> (f32, [f32; N]) {
        let (refl, mut high) = self.absorbed::<FMA>(value);
        for k in 0..N {
            high[k] *= self.scale_high[k];
        }
        (refl * self.scale_refl, high)
    }

    /// f_refl and f_high per sigma [1/sr].
    #[inline(always)]
    pub(super) fn eval<const FMA: bool>(&self, x: &Shapes<L>, wo: [f32; 3]) -> (f32, [f32; N]) {
        let v = mirrored(self.flip, wo);
        let mut value = [0.0; L];
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(x.axes(i), v);
            let (u, w) = (x.s1[i] * u, x.s2[i] * w);
            value[i] = shape::<FMA>(fma::<FMA>(u, u, w * w), cz) * x.amplitude[i];
        }
        self.weigh::<FMA>(&value)
    }

    /// Mean scattered energy plus the missed: what a sample is chosen from.
    #[inline(always)]
    pub(super) fn total(&self) -> f32 {
        mean_sum(self.energies.refl, &self.energies.high) + self.energies.r_d
    }

    /// f_refl and f_high per sigma and the density of sampling `wo` [1/sr], missing included. `mean` is of [`Mixture::mean`].
    #[inline(always)]
    pub(super) fn eval_pdf<const FMA: bool>(&self, x: &Shapes<L>, mean: &[f32; L], wo: [f32; 3]) -> Values<N> {
        let v = mirrored(self.flip, wo);
        let (mut value, mut density) = ([0.0; L], [0.0; L]);
        for i in 0..L {
            let [u, w, cz] = project::<FMA>(x.axes(i), v);
            let (su, sw) = (x.s1[i] * u, x.s2[i] * w);
            let q = fma::<FMA>(su, su, sw * sw);
            let shape = shape::<FMA>(q, cz);
            // a(t) of the direction t of (u, w); at the axis, where t is undefined, any mean of mu1 and mu2 serves.
            let a = (q + 1e-30) / (fma::<FMA>(u, u, w * w) + 1e-30);
            value[i] = shape * x.amplitude[i];
            density[i] = shape * (mean[i] * x.norm[i]) / (1.0 - exp2::<FMA>(-a));
        }
        let (refl, high) = self.weigh::<FMA>(&value);
        let total = self.total();
        (refl, high, if total > 0.0 { halves(density) / total } else { 0.0 })
    }

    /// Density of sampling `wo` [1/sr], missing included.
    #[inline(always)]
    pub(super) fn pdf<const FMA: bool>(&self, x: &Shapes<L>, wo: [f32; 3]) -> f32 {
        self.eval_pdf::<FMA>(x, &self.mean::<FMA>(), wo).2
    }

    /// By lane: what the energy of a lobe is multiplied by for its mean over the absorptions, scaled to the simulated energy.
    #[inline(always)]
    pub(super) fn mean<const FMA: bool>(&self) -> [f32; L] {
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

    /// The lane where the running sum of the mean energies passes `left`; `None` where there is no energy. The lanes before it
    /// are counted without a branch, which no processor could predict.
    #[inline(always)]
    fn choose<const FMA: bool>(&self, mean: &[f32; L], left: f32) -> Option<usize> {
        let (mut sums, mut sum) = ([f32::INFINITY; L], 0.0);
        for i in 0..H + R {
            sum = fma::<FMA>(self.energy[i], mean[i], sum);
            sums[i] = sum;
        }
        // Below the last sum, whatever was rounded: a lane with energy passes it.
        let left = min(left, sum * (1.0 - f32::EPSILON));
        let mut passed = 0u32;
        for x in sums {
            passed += u32::from(x <= left);
        }
        (sum > 0.0).then_some(passed as usize & (L - 1))
    }

    /// With what the lobes leave.
    #[inline(always)]
    pub(super) fn core(&self, refl: f32, high: [f32; N], pdf: f32) -> Core<N> {
        let (r_d, total) = (self.energies.r_d, self.total());
        Core { refl, high, pdf, r_d, missed: if total > 0.0 { r_d / total } else { 0.0 } }
    }

    /// A direction, f_refl, f_high and pdf there; `None` for the light that missed. Of a mixture whose lobes have no shapes yet: the lobe is
    /// chosen and the place on its disc drawn first, one long chain of scalar operations, and the processor fills its gaps with the
    /// shapes.
    #[inline(always)]
    pub(super) fn sample<const FMA: bool>(
        &mut self,
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
        self.sample_lobe::<FMA>(bandwidth, &mean, left, u)
    }

    /// [`Mixture::sample`] where the running sum of the energies passes `left`.
    #[inline(always)]
    pub(super) fn sample_lobe<const FMA: bool>(
        &self,
        bandwidth: (f32, f32),
        mean: &[f32; L],
        left: f32,
        u: [f32; 3],
    ) -> Option<([f32; 3], Values<N>)> {
        let i = self.choose::<FMA>(mean, left)?;
        let width = |k: usize| root_width::<FMA>(self.params[k][i], bandwidth);
        let disc = disc_point::<FMA>(width(3), width(4), u[1], u[2]);
        let x = self.shapes::<FMA>(bandwidth);
        let [u_, w_, cz] = disc;
        let Axes { theta: (st, ct), phi: (sp, cp), xy: (sx, cx) } = x.axes(i);
        let across = cx * u_ - sx * w_;
        let up = sx * u_ + cx * w_;
        let along = ct * cz - st * up;
        let z = st * cz + ct * up;
        let wo = mirrored(self.flip, [cp * along - sp * across, sp * along + cp * across, z]);
        Some((wo, self.eval_pdf::<FMA>(&x, mean, wo)))
    }
}

/// Numbers below 1, and 0 for what is not a number.
#[inline(always)]
pub(super) fn unit(u: [f32; 3]) -> [f32; 3] {
    let unit = |x: f32| min(max(x, 0.0), 1.0 - f32::EPSILON / 2.0);
    [unit(u[0]), unit(u[1]), unit(u[2])]
}

/// Components along x, y and z of a lobe of a direction drawn from it, by two uniform numbers.
#[inline(always)]
pub(super) fn disc_point<const FMA: bool>(s1: f32, s2: f32, u1: f32, u2: f32) -> [f32; 3] {
    // tan t = sqrt(mu1/mu2) tan(2 pi u1), in the same quadrant.
    let (s, c) = sin_cos::<FMA>(2.0 * u1);
    let (c, s) = (s2 * c, s1 * s);
    let n2 = 1.0 / (c * c + s * s);
    let a = ((s1 * c) * (s1 * c) + (s2 * s) * (s2 * s)) * n2;
    let drop = -ln::<FMA>(1.0 - u2 * (1.0 - exp2::<FMA>(-a)));
    let r2 = min(max(drop / (LN_2 * a), 0.0), 1.0 - f32::EPSILON);
    let r = (r2 * n2).sqrt();
    [r * c, r * s, (1.0 - r2).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asg::{MU_MAX, MU_MIN};

    /// The mean over s of 1 - exp(-1/b(s)) with many nodes.
    fn mean(mu1: f64, mu2: f64) -> f64 {
        let n = 2000;
        let node = |j: usize| {
            let s2 = (0.5 * std::f64::consts::PI * (j as f64 + 0.5) / n as f64).sin().powi(2);
            -(-1.0 / ((1.0 - s2) / mu1 + s2 / mu2)).exp_m1()
        };
        (0..n).map(node).sum::<f64>() / n as f64
    }

    #[test]
    fn unit_mean_matches_the_integral() {
        let step = (MU_MAX / MU_MIN).ln() / 60.0;
        for i in 0..=60 {
            for j in 0..=60 {
                let (mu1, mu2) = (MU_MIN * (step * f64::from(i)).exp(), MU_MIN * (step * f64::from(j)).exp());
                let want = mean(mu1, mu2);
                let (t1, t2) = (mu1 as f32 * LOG2_E, mu2 as f32 * LOG2_E);
                for got in [unit_mean::<true>(t1, t2), unit_mean::<false>(t1, t2)] {
                    let err = (f64::from(got) / want - 1.0).abs();
                    assert!(err < 1e-4, "mu {mu1} {mu2}: got {got}, want {want}, relative {err}");
                }
            }
        }
    }
}
