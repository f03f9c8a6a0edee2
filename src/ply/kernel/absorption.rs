//! Absorption: path-length spectra are attenuated by any number of absorptions, in blocks of four, and the
//! lobes of f_high are scaled to the simulated energy (see the head of `mixture.rs`).
//!
//! Let T_jk be the transmittance of path length j at absorption k, S the spectrum of the simulated energy and
//! A that of all lobes together. The lobes are then scaled by `sum_j T_jk S_j / sum_j T_jk A_j`.

use crate::math::simd::{exp2, fma, halves, max, min};
use crate::ply::data::MIN_TRANSMITTANCE;
use multiversion::{multiversion, target::target_cfg_f};

/// Clamps an absorption to [0, 1e6] per um; NaN becomes 0.
#[inline(always)]
pub(crate) fn clamped_sigma(sigma: f32) -> f32 {
    min(max(sigma, 0.0), 1e6)
}

/// Absorptions that are processed side by side.
const BLOCK: usize = 4;

/// Transmittances of the path lengths at a block of absorptions, `[path length][absorption]`.
pub(in crate::ply) type Transmittances<const J: usize> = [[f32; BLOCK]; J];

/// Transmittances of the path lengths for the first block of absorptions. A kernel begins with them because
/// the exponentials depend on no other result.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
pub(in crate::ply) fn first_transmittances<const J: usize>(path: &[f32; J], sigma: &[f32]) -> Transmittances<J> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    transmittances::<FMA, J>(path, &some(sigma))
}

#[inline(always)]
fn transmittances<const FMA: bool, const J: usize>(path: &[f32; J], sigma: &[f32; BLOCK]) -> Transmittances<J> {
    let mut t = [[0.0; BLOCK]; J];
    for j in 0..J {
        for k in 0..BLOCK {
            t[j][k] = sigma[k] * path[j];
        }
    }
    for t in t.as_flattened_mut() {
        *t = exp2::<FMA>(*t) + MIN_TRANSMITTANCE as f32;
    }
    t
}

/// The first block of absorptions, clamped. Absent ones are 0.
#[inline(always)]
fn some(sigma: &[f32]) -> [f32; BLOCK] {
    let mut some = match *sigma {
        [a, b, c, d, ..] => [a, b, c, d],
        [a, b, c] => [a, b, c, 0.0],
        [a, b] => [a, b, 0.0, 0.0],
        [a] => [a, 0.0, 0.0, 0.0],
        [] => [0.0; BLOCK],
    };
    for sigma in &mut some {
        *sigma = clamped_sigma(*sigma);
    }
    some
}

/// Writes as many numbers of a block as `to` holds. It matches patterns because the compiler would call
/// memcpy for a copy of unknown length.
#[inline(always)]
fn put(to: &mut [f32], [i, j, k, l]: &[f32; BLOCK]) {
    match to {
        [a, b, c, d, ..] => (*a, *b, *c, *d) = (*i, *j, *k, *l),
        [a, b, c] => (*a, *b, *c) = (*i, *j, *k),
        [a, b] => (*a, *b) = (*i, *j),
        [a] => *a = *i,
        [] => (),
    }
}

/// Adds as many numbers of a block as `to` holds.
#[inline(always)]
fn add(to: &mut [f32], [i, j, k, l]: &[f32; BLOCK]) {
    match to {
        [a, b, c, d, ..] => (*a, *b, *c, *d) = (*a + i, *b + j, *c + k, *d + l),
        [a, b, c] => (*a, *b, *c) = (*a + i, *b + j, *c + k),
        [a, b] => (*a, *b) = (*a + i, *b + j),
        [a] => *a += i,
        [] => (),
    }
}

/// The bits of the first numbers of a block, by their count. Comparisons with a count would be branches, and
/// the numbers between them no vectors.
const KEPT: [[u32; BLOCK]; BLOCK + 1] = {
    const ALL: u32 = u32::MAX;
    [[0; BLOCK], [ALL, 0, 0, 0], [ALL, ALL, 0, 0], [ALL, ALL, ALL, 0], [ALL; BLOCK]]
};

/// The first `count` numbers of a block, and zeros.
#[inline(always)]
fn kept(count: usize, numbers: &[f32; BLOCK]) -> [f32; BLOCK] {
    let (bits, mut kept) = (&KEPT[count.min(BLOCK)], [0.0; BLOCK]);
    for k in 0..BLOCK {
        kept[k] = f32::from_bits(numbers[k].to_bits() & bits[k]);
    }
    kept
}

/// The sum of the first `count` numbers of a block.
#[inline(always)]
fn sum(count: usize, numbers: &[f32; BLOCK]) -> f32 {
    let mut sum = 0.0;
    for k in 0..BLOCK {
        sum += if k < count { numbers[k] } else { 0.0 };
    }
    sum
}

/// Sums over path lengths of a spectrum times its transmittances, one for each absorption.
#[inline(always)]
fn absorb<const FMA: bool, const J: usize>(spectrum: &[f32; J], t: &[[f32; BLOCK]; J]) -> [f32; BLOCK] {
    // Two sums halve the chain of dependent additions.
    let (mut even, mut odd) = ([0.0; BLOCK], [0.0; BLOCK]);
    for j in 0..J / 2 {
        for k in 0..BLOCK {
            even[k] = fma::<FMA>(spectrum[2 * j], t[2 * j][k], even[k]);
            odd[k] = fma::<FMA>(spectrum[2 * j + 1], t[2 * j + 1][k], odd[k]);
        }
    }
    for k in 0..BLOCK {
        even[k] += odd[k];
    }
    even
}

/// Attenuates H lobes: `high[k] = sum_l value[l] transmittance[l][k]`, with `transmittance[lobe][absorption]`
/// flat.
#[inline(always)]
pub(in crate::ply) fn attenuate<const FMA: bool, const H: usize>(
    value: &[f32; H],
    transmittance: &[f32],
    high: &mut [f32],
) {
    // The numbers of absorptions that hosts use, as constants for vectorization.
    match high.len() {
        1 => attenuate_some::<FMA, H, 1>(value, transmittance, high),
        3 => attenuate_some::<FMA, H, 3>(value, transmittance, high),
        4 => attenuate_some::<FMA, H, 4>(value, transmittance, high),
        8 => attenuate_some::<FMA, H, 8>(value, transmittance, high),
        count => {
            for (k, high) in high.iter_mut().enumerate() {
                let mut sum = 0.0;
                for (l, value) in value.iter().enumerate() {
                    if let Some(transmittance) = transmittance.get(l * count + k) {
                        sum = fma::<FMA>(*value, *transmittance, sum);
                    }
                }
                *high = sum;
            }
        }
    }
}

#[inline(always)]
fn attenuate_some<const FMA: bool, const H: usize, const C: usize>(
    value: &[f32; H],
    transmittance: &[f32],
    high: &mut [f32],
) {
    let (Some(transmittance), Some(high)) =
        (transmittance.as_chunks::<C>().0.first_chunk::<H>(), high.first_chunk_mut::<C>())
    else {
        return;
    };
    let (mut even, mut odd) = ([0.0; C], [0.0; C]);
    for l in 0..H / 2 {
        for k in 0..C {
            even[k] = fma::<FMA>(value[2 * l], transmittance[2 * l][k], even[k]);
            odd[k] = fma::<FMA>(value[2 * l + 1], transmittance[2 * l + 1][k], odd[k]);
        }
    }
    for k in 0..C {
        high[k] = even[k] + odd[k];
    }
}

/// What is needed to scale the lobes of f_high to the simulated energy at any absorption.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Spectra<'a, const J: usize> {
    /// -log2 e times the path lengths [um].
    pub(in crate::ply) path: &'a [f32; J],
    /// Spectrum of the simulated energy.
    pub(in crate::ply) simulated: [f32; J],
    /// Spectrum of the energy of all lobes together.
    pub(in crate::ply) all: [f32; J],
    /// Transmittances of the first block of absorptions.
    pub(in crate::ply) first: Transmittances<J>,
}

/// Sums over the absorptions.
#[derive(Clone, Copy)]
pub(in crate::ply) struct OverSigma {
    /// Energy of f_high.
    pub(in crate::ply) energy: f32,
    /// Density of f_high.
    pub(in crate::ply) density: f32,
}

/// One block of absorptions: transmittances of the path lengths, scaled to the simulated energy, and the
/// energies of f_high.
#[derive(Clone, Copy)]
pub(in crate::ply) struct PathBlock<const J: usize> {
    transmittance: [[f32; BLOCK]; J],
    energy: [f32; BLOCK],
}

impl<const J: usize> PathBlock<J> {
    #[inline(always)]
    pub(in crate::ply) fn none() -> Self {
        PathBlock { transmittance: [[0.0; BLOCK]; J], energy: [0.0; BLOCK] }
    }
}

impl<const J: usize> Spectra<'_, J> {
    /// Energies of f_high at a block of absorptions, and the factors that scale the lobes to them.
    #[inline(always)]
    fn scales<const FMA: bool>(&self, t: &Transmittances<J>) -> ([f32; BLOCK], [f32; BLOCK]) {
        let energy = absorb::<FMA, J>(&self.simulated, t);
        let all = absorb::<FMA, J>(&self.all, t);
        let mut scale = [0.0; BLOCK];
        for k in 0..BLOCK {
            scale[k] = energy[k] / all[k];
        }
        (energy, scale)
    }

    /// Writes f_high for each absorption to `high`, from `light`: its sums over the lobes by path length, and
    /// those of the density. Returns the sums over absorptions of energy and, if `PDF`, of density.
    #[inline(always)]
    pub(in crate::ply) fn absorb<const PDF: bool>(
        &self,
        light: [&[f32; J]; 2],
        sigma: &[f32],
        high: &mut [f32],
    ) -> OverSigma {
        let first = absorb_block::<PDF, J>((self, &self.first), light, sigma, high);
        self.absorb_more::<PDF>(first, light, sigma, high)
    }

    /// Adds the blocks after the first.
    #[inline(always)]
    fn absorb_more<const PDF: bool>(
        &self,
        mut over: OverSigma,
        light: [&[f32; J]; 2],
        sigma: &[f32],
        high: &mut [f32],
    ) -> OverSigma {
        let mut first = BLOCK;
        while first < sigma.len() {
            let sigma = after(sigma, first);
            let t = first_transmittances(self.path, sigma);
            let more = absorb_block::<PDF, J>((self, &t), light, sigma, after_mut(high, first));
            (over.energy, over.density) = (over.energy + more.energy, over.density + more.density);
            first += BLOCK;
        }
        over
    }

    /// [`Spectra::absorb`] with the density, if [`Spectra::transmittance`] computed the first block before.
    #[inline(always)]
    pub(in crate::ply) fn absorb_known(
        &self,
        block: &PathBlock<J>,
        light: [&[f32; J]; 2],
        sigma: &[f32],
        high: &mut [f32],
    ) -> OverSigma {
        let first = absorb_known::<J>(block, light, sigma.len(), high);
        self.absorb_more::<true>(first, light, sigma, high)
    }

    /// Sums over the absorptions of the scaled transmittances of the path lengths and of the energy of
    /// f_high. Writes the first block to `block`.
    #[inline(always)]
    pub(in crate::ply) fn transmittance(&self, sigma: &[f32], block: &mut PathBlock<J>) -> ([f32; J], f32) {
        let mut transmittance = [0.0; J];
        let mut energy = path_block::<J>((self, &self.first), sigma, block, &mut transmittance);
        let mut first = BLOCK;
        while first < sigma.len() {
            let mut block = PathBlock::none();
            let sigma = after(sigma, first);
            let t = first_transmittances(self.path, sigma);
            energy += path_block::<J>((self, &t), sigma, &mut block, &mut transmittance);
            first += BLOCK;
        }
        (transmittance, energy)
    }

    /// Writes the transmittances of the lobes with these spectra, scaled to the simulated energy, and the
    /// energies of f_high, for each absorption. Returns the sums over the first `count` absorptions: by lobe,
    /// and of the energy.
    #[inline(always)]
    pub(in crate::ply) fn of_lobes<const H: usize>(
        &self,
        spectra: &[[f32; J]; H],
        (sigma, count): (&[f32], usize),
        result: LobeTransmittances<'_>,
    ) -> ([f32; H], f32) {
        let mut sums = [0.0; H];
        if let (&[_], [energy]) = (sigma, &mut *result.energy) {
            *energy = lobes_of_one::<H, J>(self, spectra, &mut sums);
            for (to, sum) in result.lobes.iter_mut().zip(&sums) {
                *to = *sum;
            }
            return (sums, *energy);
        }
        let (mut first, mut energy) = (0, 0.0);
        while first < sigma.len() {
            let rows = (sigma.len(), first, count.saturating_sub(first));
            let to = LobeTransmittances { energy: after_mut(result.energy, first), lobes: &mut *result.lobes };
            let of = after(sigma, first);
            let more = if first == 0 { self.first } else { first_transmittances(self.path, of) };
            energy += lobes_block::<H, J>((self, &more), spectra, (of.len(), rows), to, &mut sums);
            first += BLOCK;
        }
        (sums, energy)
    }
}

/// The numbers from index `first` on.
#[inline(always)]
fn after(x: &[f32], first: usize) -> &[f32] {
    x.get(first..).unwrap_or(&[])
}

#[inline(always)]
fn after_mut(x: &mut [f32], first: usize) -> &mut [f32] {
    x.get_mut(first..).unwrap_or(&mut [])
}

/// Results for each absorption: the transmittances of the lobes, `[lobe][absorption]` flat and scaled to the
/// simulated energy, and the energies of f_high.
pub(in crate::ply) struct LobeTransmittances<'a> {
    pub(in crate::ply) energy: &'a mut [f32],
    pub(in crate::ply) lobes: &'a mut [f32],
}

// The following are functions of their own, not inlined: inlined beside the lobes, the compiler would
// vectorize neither.

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn absorb_block<'a, const PDF: bool, const J: usize>(
    (of, t): (&Spectra<'a, J>, &Transmittances<J>),
    light: [&[f32; J]; 2],
    sigma: &[f32],
    high: &mut [f32],
) -> OverSigma {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let (energy, scale) = of.scales::<FMA>(t);
    let mut value = absorb::<FMA, J>(light[0], t);
    for k in 0..BLOCK {
        value[k] *= scale[k];
    }
    put(high, &value);
    let mut density = [0.0; BLOCK];
    if PDF {
        density = absorb::<FMA, J>(light[1], t);
        for k in 0..BLOCK {
            density[k] *= scale[k];
        }
    }
    OverSigma { energy: sum(sigma.len(), &energy), density: sum(sigma.len(), &density) }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn absorb_known<const J: usize>(
    block: &PathBlock<J>,
    light: [&[f32; J]; 2],
    count: usize,
    high: &mut [f32],
) -> OverSigma {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    put(high, &absorb::<FMA, J>(light[0], &block.transmittance));
    OverSigma {
        energy: sum(count, &block.energy),
        density: sum(count, &absorb::<FMA, J>(light[1], &block.transmittance)),
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn path_block<'a, const J: usize>(
    (of, t): (&Spectra<'a, J>, &Transmittances<J>),
    sigma: &[f32],
    block: &mut PathBlock<J>,
    transmittance: &mut [f32; J],
) -> f32 {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let (energy, scale) = of.scales::<FMA>(t);
    let scale = kept(sigma.len(), &scale);
    for j in 0..J {
        for k in 0..BLOCK {
            block.transmittance[j][k] = t[j][k] * scale[k];
        }
    }
    block.energy = energy;
    add_rows(&block.transmittance, transmittance);
    sum(sigma.len(), &energy)
}

/// Adds the sums over a block's absorptions.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
#[inline(never)]
fn add_rows<const J: usize>(t: &Transmittances<J>, sums: &mut [f32; J]) {
    for j in 0..J {
        let [a, b, c, d] = t[j];
        sums[j] += (a + b) + (c + d);
    }
}

/// Writes the transmittance of each lobe at a single absorption; returns the energy of f_high.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
fn lobes_of_one<'a, const H: usize, const J: usize>(
    of: &Spectra<'a, J>,
    spectra: &[[f32; J]; H],
    transmittance: &mut [f32; H],
) -> f32 {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let t = &of.first;
    let (energy, scale) = of.scales::<FMA>(t);
    let mut by_path = [0.0; J];
    for j in 0..J {
        by_path[j] = scale[0] * t[j][0];
    }
    for (transmittance, spectrum) in transmittance.iter_mut().zip(spectra) {
        let mut product = [0.0; J];
        for j in 0..J {
            product[j] = by_path[j] * spectrum[j];
        }
        *transmittance = halves(product);
    }
    energy[0]
}

/// Writes the transmittances of the lobes at one block of absorptions. The numbers are: absorptions from the
/// block's first on; all absorptions; the index of the block's first; and how many from there on are included
/// in the sums.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn lobes_block<'a, const H: usize, const J: usize>(
    (of, t): (&Spectra<'a, J>, &Transmittances<J>),
    spectra: &[[f32; J]; H],
    (block, (all, first, count)): (usize, (usize, usize, usize)),
    to: LobeTransmittances<'a>,
    sums: &mut [f32; H],
) -> f32 {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let mut t = *t;
    let (energy, scale) = of.scales::<FMA>(&t);
    put(to.energy, &energy);
    for j in 0..J {
        for k in 0..BLOCK {
            t[j][k] *= scale[k];
        }
    }
    let count = count.min(block);
    for (l, spectrum) in spectra.iter().enumerate() {
        let value = absorb::<FMA, J>(spectrum, &t);
        sums[l] += sum(count, &value);
        put(after_mut(to.lobes.get_mut(l * all..(l + 1) * all).unwrap_or(&mut []), first), &value);
    }
    sum(count, &energy)
}

/// Spectra of W queries: of the simulated energy, of the energy of all lobes together, and of their values.
pub(in crate::ply) struct Light<const W: usize, const J: usize> {
    pub(in crate::ply) simulated: [[f32; J]; W],
    pub(in crate::ply) all: [[f32; J]; W],
    pub(in crate::ply) value: [[f32; J]; W],
}

/// Adds f_high of W queries at each of `count` absorptions to `f`, `[query][absorption]` flat. `sigma` has as
/// many numbers.
#[inline(always)]
pub(in crate::ply) fn absorb_queries<const W: usize, const J: usize>(
    path: &[f32; J],
    light: &Light<W, J>,
    (sigma, count): (&[f32], usize),
    f: &mut [f32],
) {
    let mut first = 0;
    while first < count {
        let (mut of, mut high) = ([[0.0; BLOCK]; W], [[0.0; BLOCK]; W]);
        for (of, sigma) in of.iter_mut().zip(sigma.chunks_exact(count)) {
            *of = some(after(sigma, first));
        }
        block_of_queries(path, light, &of, &mut high);
        for (f, high) in f.chunks_exact_mut(count).zip(&high) {
            add(after_mut(f, first), high);
        }
        first += BLOCK;
    }
}

/// f_high of W queries at a block of absorptions each.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn block_of_queries<const W: usize, const J: usize>(
    path: &[f32; J],
    light: &Light<W, J>,
    sigma: &[[f32; BLOCK]; W],
    high: &mut [[f32; BLOCK]; W],
) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    // Path lengths come first: the lanes of a vector are absorptions of consecutive queries.
    let mut t = [[[0.0; BLOCK]; W]; J];
    for j in 0..J {
        for (t, sigma) in t[j].as_flattened_mut().iter_mut().zip(sigma.as_flattened()) {
            *t = exp2::<FMA>(*sigma * path[j]) + MIN_TRANSMITTANCE as f32;
        }
    }
    let (mut energy, mut all) = ([[0.0; BLOCK]; W], [[0.0; BLOCK]; W]);
    for q in 0..W {
        let mut of = [[0.0; BLOCK]; J];
        for j in 0..J {
            of[j] = t[j][q];
        }
        energy[q] = absorb::<FMA, J>(&light.simulated[q], &of);
        all[q] = absorb::<FMA, J>(&light.all[q], &of);
        high[q] = absorb::<FMA, J>(&light.value[q], &of);
    }
    let (energy, all) = (energy.as_flattened(), all.as_flattened());
    for ((high, energy), all) in high.as_flattened_mut().iter_mut().zip(energy).zip(all) {
        *high *= energy / all;
    }
}

/// Energies of f_high at each absorption, from their spectrum.
#[inline(always)]
pub(super) fn energies_by_sigma<const FMA: bool, const J: usize>(
    spectrum: &[f32; J],
    path: &[f32; J],
    sigma: &[f32],
    energies: &mut [f32],
) {
    if !sigma.is_empty() {
        put(energies, &absorb::<FMA, J>(spectrum, &transmittances::<FMA, J>(path, &some(sigma))));
        if sigma.len() > BLOCK {
            more_energies(spectrum, path, sigma, energies);
        }
    }
}

/// Energies beyond the first block of absorptions.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
fn more_energies<const J: usize>(spectrum: &[f32; J], path: &[f32; J], sigma: &[f32], energies: &mut [f32]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    for (sigma, energies) in sigma.chunks(BLOCK).zip(energies.chunks_mut(BLOCK)).skip(1) {
        put(energies, &absorb::<FMA, J>(spectrum, &transmittances::<FMA, J>(path, &some(sigma))));
    }
}

/// Sum over the high-order lobes of `value` times the lobe's spectrum, by path length.
#[inline(always)]
pub(in crate::ply) fn by_path<const FMA: bool, const H: usize, const J: usize>(
    pairs: usize,
    value: &[f32; H],
    spectrum: &[[f32; J]; H],
) -> [f32; J] {
    // The loop runs over pairs of lobes. The compiler does not know their number and therefore keeps the path
    // lengths in vectors.
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
    even
}
