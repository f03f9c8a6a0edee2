//! Noise tiles from the spectrum of their field: some kilobytes in a file, instead of the tiles' megabytes.
//!
//! The amplitude of the light of one kind over (v, u) is a constant phasor and a periodic circular Gaussian
//! field whose power spectrum is that along u times that along v, `N = |sqrt(1 - b) + g|^2` with b the share
//! of the field (`plywave_fit::speckle`). Its harmonics are independent normal numbers:
//!
//! ```text
//! g[r][c] = sum over (p, q) of sqrt(b P_v[p] P_u[q]) n[p][q] exp(2 pi i (p r / V + q c / U))
//! ```
//!
//! P_u is stored. Along v the correlation is that of an illuminated length of Gaussian intensity exp(-2 z^2 /
//! w0^2), `exp(-q^2 / (2 s^2))` with `s = lambda / (pi w0)` in v (van Cittert and Zernike, Goodman 2007,
//! 4.4), so `P_v[p]` is proportional to `exp(-(2 pi p s / (V step))^2 / 2)`.
//!
//! n is a hash of seed, kind, tile and harmonic, and no step calls a function of the system's library, so all
//! machines make the same tiles.

use super::tiles::{self, NoiseTiles};
use crate::Result;
use crate::io::{Check, Reader, Writer, invalid};
use crate::math::fft::{Fft, LANES, Lanes};
use crate::math::hash::{GAMMA, mix64};
use crate::math::simd::{exp2, ln, signed, sin_cos_half_turns};
use multiversion::multiversion;
use std::f64::consts::{LOG2_E, PI, TAU};

/// Names of the tensors in a model file, besides those that tiles have too.
pub(crate) const NAMES: [&str; 5] = ["noise_spectrum", "noise_share", "noise_sizes", "noise_seed", "noise_w0_um"];
/// Smallest and largest number of nodes of a tile along an axis.
const SIDES: [usize; 2] = [16, 1 << 13];
/// Largest number of nodes of a tile: making it takes 12 bytes per node, and one tile of each kind is made at
/// a time.
const MAX_NODES: usize = 1 << 20;
/// Largest number of nodes of all tiles, a byte each and twice that temporarily. Together at most 64 MiB.
const MAX_BYTES: usize = 1 << 24;
/// Harmonics below this share of the greatest amplitude along v are omitted: far below a code's step.
const MIN_AMPLITUDE: f32 = 1e-6;

/// Parameters from which noise tiles are made.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseSpectrum {
    /// Number of tiles per kind, of nodes along v and along u: T, V, U, powers of two.
    pub sizes: [usize; 3],
    /// Seed of the normal numbers.
    pub seed: u64,
    /// `[2][U/2 + 1]`: for each kind the field's power at harmonics 0 to U/2 along u, >= 0; with all but the
    /// first and last counted twice they sum to 1.
    pub spectrum: Vec<f32>,
    /// `[2]`: for each kind the field's share b of the mean intensity, 0 to 1.
    pub share: [f64; 2],
    /// Waist of the beam on the ply [um].
    pub w0_um: f64,
    /// `[2][2]`: distance between the nodes along v and u.
    pub step: [[f64; 2]; 2],
    /// Wavelength at which the tiles are not stretched [um].
    pub lambda_um: f64,
    /// `[2][2]`: as [`NoiseTiles::fade`].
    pub fade: [[f64; 2]; 2],
    /// `[2][2]`: as [`NoiseTiles::contrast`].
    pub contrast: [[f64; 2]; 2],
}

impl NoiseSpectrum {
    /// s of the correlation `exp(-q^2 / (2 s^2))` along v for a beam of waist w0 at a wavelength.
    pub fn width_v(lambda_um: f64, w0_um: f64) -> f64 {
        lambda_um / (PI * w0_um)
    }

    /// Makes the tiles: the same bits on every machine.
    pub fn tiles(&self) -> NoiseTiles {
        let count = self.sizes[0];
        let (mut tiles, mut code) = (Vec::with_capacity(2 * self.sizes.iter().product::<usize>()), Vec::new());
        for kind in 0..2 {
            let field = Field::new(self, kind);
            for tile in 0..count {
                let (coded, scale) = NoiseTiles::code_roots(&field.roots(tile));
                tiles.extend(coded);
                code.extend(scale);
            }
        }
        NoiseTiles {
            tiles,
            sizes: self.sizes,
            code,
            step: self.step,
            lambda_um: self.lambda_um,
            fade: self.fade,
            contrast: self.contrast,
        }
    }

    /// Values N at the nodes of a tile before coding, `[V][U]`, of mean 1; `kind` 0 for f_refl, 1 for f_high.
    /// Empty if there is no such tile.
    pub fn values(&self, kind: usize, tile: usize) -> Vec<f64> {
        if kind > 1 || tile >= self.sizes[0] {
            return Vec::new();
        }
        let roots = Field::new(self, kind).roots(tile);
        let mut values: Vec<f64> = roots.iter().map(|root| f64::from(*root).powi(2)).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        if mean > 0.0 {
            values.iter_mut().for_each(|v| *v /= mean);
        }
        values
    }

    pub(crate) fn write(&self, w: &mut Writer) {
        w.f32(NAMES[0], &[2, self.sizes[2] / 2 + 1], self.spectrum.iter().copied());
        w.f64(NAMES[1], &[2], &self.share);
        w.u64(NAMES[2], &[3], &self.sizes.map(|n| n as u64));
        w.u64(NAMES[3], &[1], &[self.seed]);
        w.f64(NAMES[4], &[1], &[self.w0_um]);
        tiles::write_frame(w, &self.step, self.lambda_um, &self.fade, &self.contrast);
    }

    pub(crate) fn read(r: &Reader<'_>) -> Result<NoiseSpectrum> {
        let sizes = r.u64(NAMES[2], &[3])?;
        let share = r.f64(NAMES[1], &[2])?;
        let (step, lambda_um, fade, contrast) = tiles::read_frame(r)?;
        let harmonics = r.shape(NAMES[0], 2)?[1];
        Ok(NoiseSpectrum {
            // The check refuses sizes beyond the machine's range.
            sizes: [0, 1, 2].map(|k| usize::try_from(sizes[k]).unwrap_or(usize::MAX)),
            seed: r.u64(NAMES[3], &[1])?[0],
            spectrum: r.f32(NAMES[0], &[2, harmonics])?,
            share: [share[0], share[1]],
            w0_um: r.f64(NAMES[4], &[1])?[0],
            step,
            lambda_um,
            fade,
            contrast,
        })
    }

    /// Checks the parts of noise that do not depend on its spectrum: sizes, steps, wavelength, waist,
    /// contrasts. The spectrum may be absent: a fit calls this before its work. `name` identifies the file in
    /// messages.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid), as saving would return.
    pub fn check_frame(&self, name: &str) -> Result<()> {
        let c = Check(name);
        let [count, rows, columns] = self.sizes;
        let refused = |hint: &str| Err(invalid(c.0, NAMES[2], format!("{:?}", self.sizes), hint));
        let [least, most] = SIDES;
        let side = |n: usize| n.is_power_of_two() && (least..=most).contains(&n);
        if !(count.is_power_of_two() && side(rows) && side(columns)) {
            return refused(&format!("expected powers of two, {least} to {most} nodes along v and u"));
        }
        if rows * columns > MAX_NODES {
            return refused(&format!("expected {MAX_NODES} values at most in a tile"));
        }
        if count.saturating_mul(2 * rows * columns) > MAX_BYTES {
            return refused(&format!("expected {MAX_BYTES} values at most"));
        }
        c.range(NAMES[4], &[self.w0_um], 1e-9, 1e9)?;
        tiles::check_frame(&c, &self.step, self.lambda_um, &self.fade, &self.contrast)
    }

    pub(crate) fn check(&self, c: &Check<'_>) -> Result<()> {
        self.check_frame(c.0)?;
        let half = self.sizes[2] / 2;
        c.len(NAMES[0], self.spectrum.len(), &[2, half + 1])?;
        c.range_f32(NAMES[0], &self.spectrum, 0.0, 1.0)?;
        c.range(NAMES[1], &self.share, 0.0, 1.0)?;
        for (kind, powers) in self.spectrum.chunks_exact(half + 1).enumerate() {
            let sum = 2.0 * powers.iter().map(|p| f64::from(*p)).sum::<f64>() - f64::from(powers[0] + powers[half]);
            if (sum - 1.0).abs() > 1e-3 {
                return Err(invalid(c.0, &format!("{} [{kind}]", NAMES[0]), sum, "the powers must add up to 1"));
            }
        }
        Ok(())
    }
}

/// The field of one kind of light.
struct Field {
    rows: usize,
    columns: usize,
    start: u64,
    /// Harmonics along v that have power, and their amplitudes.
    lit: Vec<(usize, f32)>,
    /// Amplitudes along u, including the share's root.
    along_u: Vec<f32>,
    constant: f32,
    fft: [Fft; 2],
}

impl Field {
    fn new(of: &NoiseSpectrum, kind: usize) -> Field {
        let [_, rows, columns] = of.sizes;
        let share = of.share[kind];
        let per_step = TAU * NoiseSpectrum::width_v(of.lambda_um, of.w0_um) / (rows as f64 * of.step[kind][0]);
        let along_v = |p: usize| {
            // The root of the power.
            let x = per_step * p.min(rows - p) as f64;
            exp2::<false>((-0.25 * LOG2_E * x * x).max(-126.0) as f32)
        };
        let sum: f64 = (0..rows).map(|p| f64::from(along_v(p)).powi(2)).sum();
        let scale = (1.0 / sum).sqrt() as f32;
        let lit = (0..rows).map(|p| (p, along_v(p))).filter(|(_, a)| *a > MIN_AMPLITUDE);
        let powers = &of.spectrum[kind * (columns / 2 + 1)..];
        let along_u = |q: usize| (share * f64::from(powers[q.min(columns - q)])).sqrt() as f32;
        Field {
            rows,
            columns,
            start: mix64(of.seed ^ mix64(kind as u64 + 1)),
            lit: lit.map(|(p, a)| (p, a * scale)).collect(),
            along_u: (0..columns).map(along_u).collect(),
            constant: (1.0 - share).sqrt() as f32,
            fft: [Fft::new(rows), Fft::new(columns)],
        }
    }

    /// |amplitude| at the nodes of a tile, `[V][U]`.
    fn roots(&self, tile: usize) -> Vec<f32> {
        let (rows, columns, lit) = (self.rows, self.columns, self.lit.len());
        let start = mix64(self.start ^ mix64(tile as u64));
        // After the transforms along u: strips of nodes along u, each with the harmonics along v.
        let strips = columns / LANES;
        let (mut strip_re, mut strip_im) = (vec![[0.0; LANES]; strips * lit], vec![[0.0; LANES]; strips * lit]);
        let (mut re, mut im) = (vec![[0.0; LANES]; columns], vec![[0.0; LANES]; columns]);
        for (block, lit_rows) in self.lit.chunks(LANES).enumerate() {
            let (mut first, mut along_v) = ([0; LANES], [0.0; LANES]);
            for (l, (p, amplitude)) in lit_rows.iter().enumerate() {
                (first[l], along_v[l]) = ((p * columns) as u64, *amplitude);
            }
            for (q, along_u) in self.along_u.iter().enumerate() {
                (re[q], im[q]) = match *along_u > 0.0 {
                    true => normals(start, &first, q as u64, &along_v.map(|v| v * along_u)),
                    false => ([0.0; LANES], [0.0; LANES]),
                };
            }
            self.fft[1].inverse(&mut re, &mut im);
            for (c, (re, im)) in re.iter().zip(&im).enumerate() {
                let at = c / LANES * lit + block * LANES;
                for l in 0..lit_rows.len() {
                    (strip_re[at + l][c % LANES], strip_im[at + l][c % LANES]) = (re[l], im[l]);
                }
            }
        }
        let mut roots = vec![0.0; rows * columns];
        let (mut re, mut im) = (vec![[0.0; LANES]; rows], vec![[0.0; LANES]; rows]);
        for strip in 0..strips {
            re.fill([0.0; LANES]);
            im.fill([0.0; LANES]);
            let harmonics = strip_re[strip * lit..].iter().zip(&strip_im[strip * lit..]);
            for ((p, _), (from_re, from_im)) in self.lit.iter().zip(harmonics) {
                (re[*p], im[*p]) = (*from_re, *from_im);
            }
            self.fft[0].inverse(&mut re, &mut im);
            for (r, (re, im)) in re.iter().zip(&im).enumerate() {
                let to = &mut roots[r * columns + strip * LANES..][..LANES];
                for l in 0..LANES {
                    let re = re[l] + self.constant;
                    to[l] = (re * re + im[l] * im[l]).sqrt();
                }
            }
        }
        roots
    }
}

/// Complex normal numbers of the harmonics `first + column` times `size`, whose square is their variance (Box
/// and Muller 1958).
#[multiversion(targets("x86_64+avx2", "x86_64+sse4.1"))]
fn normals(start: u64, first: &[u64; LANES], column: u64, size: &Lanes) -> (Lanes, Lanes) {
    let mut bits = [0; LANES];
    for l in 0..LANES {
        bits[l] = mix64(start.wrapping_add((first[l] + column + 1).wrapping_mul(GAMMA)));
    }
    let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        const UNIT: f32 = 1.0 / (1u32 << 24) as f32;
        // In (0, 1], and half turns in [0, 2).
        let u = ((bits[l] >> 40) as i32 + 1) as f32 * UNIT;
        let turn = (bits[l] as i32 & 0xff_ffff) as f32 * (2.0 * UNIT);
        let radius = (-ln::<false>(u)).max(0.0).sqrt() * size[l];
        let (sin, cos, sign) = sin_cos_half_turns::<false>(turn);
        (re[l], im[l]) = (radius * signed(cos, sign), radius * signed(sin, sign));
    }
    (re, im)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::Fnv64;

    fn spectrum(share: f64) -> NoiseSpectrum {
        let (rows, columns) = (32, 64);
        let mut spectrum = vec![0.0; 2 * (columns / 2 + 1)];
        for kind in spectrum.chunks_exact_mut(columns / 2 + 1) {
            (kind[0], kind[1], kind[5], kind[columns / 2]) = (0.2, 0.25, 0.125, 0.05);
        }
        NoiseSpectrum {
            sizes: [2, rows, columns],
            seed: 5,
            spectrum,
            share: [share, 1.0],
            w0_um: 10.0,
            step: [[0.0025, 0.01], [0.003, 0.02]],
            lambda_um: 0.4,
            fade: [[1.0, 0.0]; 2],
            contrast: [[1.0; 2]; 2],
        }
    }

    /// Agrees with the sum over all harmonics of the module text, in f64.
    #[test]
    fn tiles_are_the_sum_of_their_harmonics() {
        let s = spectrum(0.6);
        s.check(&Check("s")).unwrap();
        let [_, rows, columns] = s.sizes;
        for (kind, tile) in [(0, 0), (1, 1)] {
            let share = s.share[kind];
            let start = mix64(mix64(s.seed ^ mix64(kind as u64 + 1)) ^ mix64(tile as u64));
            let width = NoiseSpectrum::width_v(s.lambda_um, s.w0_um) / s.step[kind][0];
            let power_v = |p: usize| (-0.5 * (TAU * p.min(rows - p) as f64 / rows as f64 * width).powi(2)).exp();
            let sum: f64 = (0..rows).map(power_v).sum();
            let power_u = |q: usize| f64::from(s.spectrum[kind * (columns / 2 + 1) + q.min(columns - q)]);
            let normal = |p: usize, q: usize| {
                let bits = mix64(start.wrapping_add(((p * columns + q + 1) as u64).wrapping_mul(GAMMA)));
                let unit = f64::from(1 << 24);
                let (u, turn) = (((bits >> 40) + 1) as f64 / unit, (bits & 0xff_ffff) as f64 / unit);
                ((-u.ln()).sqrt(), TAU * turn)
            };
            let got = Field::new(&s, kind).roots(tile);
            for (r, c) in [(0, 0), (3, 17), (31, 63), (16, 32)] {
                let (mut re, mut im) = ((1.0 - share).sqrt(), 0.0);
                for p in 0..rows {
                    for q in 0..columns {
                        let size = (share * power_v(p) / sum * power_u(q)).sqrt();
                        let (radius, angle) = normal(p, q);
                        let angle = angle + TAU * ((p * r) as f64 / rows as f64 + (q * c) as f64 / columns as f64);
                        (re, im) = (re + size * radius * angle.cos(), im + size * radius * angle.sin());
                    }
                }
                let (got, want) = (f64::from(got[r * columns + c]), re.hypot(im));
                assert!((got - want).abs() < 1e-5, "kind {kind} at {r}, {c}: got {got}, want {want}");
            }
        }
    }

    /// Over seeds, mean and variance at the nodes are the closed forms; kinds and tiles are independent.
    #[test]
    fn nodes_have_the_contrast_of_the_share() {
        let s = spectrum(0.5);
        let (mut sums, mut n) = ([[0.0; 2]; 2], 0.0);
        let (mut kinds, mut tiles) = (0.0, 0.0);
        for seed in 0..400 {
            let s = NoiseSpectrum { seed, ..s.clone() };
            let roots = [0, 1].map(|kind| Field::new(&s, kind).roots(0));
            let other = Field::new(&s, 1).roots(1);
            // Far apart on the tile.
            for i in [0, 16 * 64 + 32] {
                let [a, b] = [0, 1].map(|kind: usize| f64::from(roots[kind][i]).powi(2));
                for (sums, v) in sums.iter_mut().zip([a, b]) {
                    *sums = [sums[0] + v, sums[1] + (v - 1.0).powi(2)];
                }
                (kinds, tiles) =
                    (kinds + (a - 1.0) * (b - 1.0), tiles + (f64::from(other[i]).powi(2) - 1.0) * (b - 1.0));
                n += 1.0;
            }
        }
        for (sums, share) in sums.iter().zip([0.5, 1.0]) {
            let want = share * (2.0 - share);
            let (mean, variance) = (sums[0] / n, sums[1] / n);
            // Five standard errors; the fourth moment of an exponential variable is 9.
            assert!((mean - 1.0f64).abs() < 5.0 * (want / n).sqrt(), "mean {mean}");
            assert!((variance - want).abs() < 5.0 * (8.0f64 / n).sqrt() * want, "variance {variance}, want {want}");
        }
        assert!((kinds / n).abs() < 5.0 / n.sqrt() && (tiles / n).abs() < 5.0 / n.sqrt(), "{kinds} {tiles} of {n}");
    }

    /// A file contains no tiles, so they must never change: on any machine, in any version.
    #[test]
    fn tiles_are_the_same_everywhere() {
        let tiles = spectrum(0.5).tiles();
        assert_eq!(tiles, spectrum(0.5).tiles());
        let scales: Vec<u8> = tiles.code.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(Fnv64::new().with(&tiles.tiles).with(&scales).hex(), "13b1234c51515275");
        tiles.check(&Check("tiles")).unwrap();
    }

    /// No field, or a field of one harmonic, is not a special case.
    #[test]
    fn spectra_at_their_borders_make_tiles() {
        let half = spectrum(0.0).sizes[2] / 2 + 1;
        let mut line = spectrum(0.0);
        line.spectrum[half..].fill(0.0);
        line.spectrum[half] = 1.0;
        line.w0_um = 1e-9;
        line.check(&Check("line")).unwrap();
        let tiles = line.tiles();
        tiles.check(&Check("tiles")).unwrap();
        assert!(tiles.tile(0, 1).iter().all(|v| *v == 1.0));
        assert!(tiles.tile(1, 0).iter().all(|v| (v - 1.0).abs() < 1e-5));
        for w0_um in [1e-9, 1e9] {
            NoiseSpectrum { w0_um, ..spectrum(0.7) }.tiles().check(&Check("tiles")).unwrap();
        }
    }
}
