//! Batches of queries with different incidences. The lobes of W queries are stored side by side in long
//! arrays: each lane of a vector holds one lobe, and the dependent steps of one query overlap with those of
//! the others.

use super::absorption::{Light, absorb_queries, by_path};
use super::energy::interpolate_node;
use super::grid_cell::GridCells;
use super::interpolate::{interpolate_high, interpolate_refl};
use super::layout::Tables;
use super::lobe::{Axes, amplitudes, project, root_width, shape, sin_cos};
use super::mixture::mixture;
use crate::math::simd::{fma, halves, max};
use crate::ply::asg::PARAMS;
use crate::ply::queries::Channels;

/// Queries in a chunk: their data, 13 KiB, fit the first-level cache.
const W: usize = 16;

/// f at `queries`, `[query][absorption]` flat; 0 beyond their shortest array. L is as in [`mixture`].
#[inline(always)]
pub(in crate::ply) fn eval<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    queries: &Channels<'_>,
    f: &mut [f32],
) {
    let mut scratch = Scratch {
        high: Lobes::new(tables.min_energy_high),
        refl: Lobes::new(tables.min_energy_refl),
        spectrum: [[[0.0; J]; H]; W],
        refl_energy: [0.0; W],
        light: Light { simulated: [[0.0; J]; W], all: [[0.0; J]; W], value: [[0.0; J]; W] },
    };
    for (chunk, f) in f.chunks_mut(W * queries.count.max(1)).enumerate() {
        let q = queries.from(chunk * W);
        if q.one_incidence(f.len() / queries.count.max(1)) {
            one_incidence::<FMA, H, R, L, J>(tables, &q, f);
        } else {
            many::<FMA, H, R, J>(tables, &q, &mut scratch, f);
        }
    }
}

#[inline(always)]
fn one_incidence<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    queries: &Channels<'_>,
    f: &mut [f32],
) {
    f.fill(0.0);
    let Some((theta_i, h_um, sigma, _)) = queries.get(0) else { return };
    let Some((mixture, shapes)) = mixture::<FMA, H, R, L, J>(tables, theta_i, h_um, sigma) else { return };
    for (i, f) in f.chunks_exact_mut(queries.count.max(1)).enumerate() {
        let Some((.., wo)) = queries.get(i) else { return };
        let refl = mixture.eval::<FMA, false>(&shapes, (sigma, None), wo, f).refl;
        f.iter_mut().for_each(|f| *f += refl);
    }
}

/// Lobe data of W queries, `[query][lobe]` with K lanes for each query.
struct Lobes<const K: usize> {
    params: [[[f32; K]; W]; PARAMS],
    v: [[[f32; K]; W]; 3],
    min_energy: [[f32; K]; W],
    /// Cosines of the angles. The sines overwrite the angles in `params`.
    cos: [[[f32; K]; W]; 3],
    value: [[f32; K]; W],
}

impl<const K: usize> Lobes<K> {
    #[inline(always)]
    fn new(min_energy: [f32; K]) -> Self {
        let zero = [[0.0; K]; W];
        Lobes { params: [zero; PARAMS], v: [zero; 3], min_energy: [min_energy; W], cos: [zero; 3], value: zero }
    }

    #[inline(always)]
    fn set(&mut self, q: usize, params: &[[f32; K]], v: [f32; 3]) {
        for (row, params) in self.params.iter_mut().zip(params) {
            row[q] = *params;
        }
        for c in 0..3 {
            self.v[c][q] = [v[c]; K];
        }
    }

    /// Computes the energies and values of the lobes. Each arithmetic step is a separate loop over all lanes.
    /// Its chain of dependent operations is then short, so the processor overlaps many of them, and its
    /// constants stay in registers.
    #[inline(always)]
    fn eval<const FMA: bool>(&mut self, bounds: (f32, f32)) {
        let [theta, phi, xy, width1, width2, energy] = self.params.each_mut().map(|x| x.as_flattened_mut());
        let [v0, v1, v2] = self.v.each_ref().map(|x| x.as_flattened());
        let [cos_theta, cos_phi, cos_xy] = self.cos.each_mut().map(|x| x.as_flattened_mut());
        let (value, min_energy) = (self.value.as_flattened_mut(), self.min_energy.as_flattened());
        for (angle, cos) in [(&mut *theta, &mut *cos_theta), (&mut *phi, &mut *cos_phi), (&mut *xy, &mut *cos_xy)] {
            for (angle, cos) in angle.iter_mut().zip(cos) {
                (*angle, *cos) = sin_cos::<FMA>(*angle);
            }
        }
        for width in [&mut *width1, &mut *width2] {
            for width in width {
                *width = root_width::<FMA>(*width, bounds);
            }
        }
        for (((value, energy), min_energy), (s1, s2)) in
            value.iter_mut().zip(energy.iter_mut()).zip(min_energy).zip(width1.iter().zip(width2.iter()))
        {
            *energy = max(*energy, *min_energy);
            *value = *energy * amplitudes::<FMA>(*s1, *s2).1;
        }
        for i in 0..value.len() {
            let x = Axes { theta: (theta[i], cos_theta[i]), phi: (phi[i], cos_phi[i]), xy: (xy[i], cos_xy[i]) };
            let [u, w, cz] = project::<FMA>(x, [v0[i], v1[i], v2[i]]);
            let (u, w) = (width1[i] * u, width2[i] * w);
            value[i] *= shape::<FMA>(fma::<FMA>(u, u, w * w), cz);
        }
    }
}

/// Working memory for W queries.
struct Scratch<const H: usize, const R: usize, const J: usize> {
    high: Lobes<H>,
    refl: Lobes<R>,
    spectrum: [[[f32; J]; H]; W],
    /// Simulated energy of f_refl.
    refl_energy: [f32; W],
    light: Light<W, J>,
}

/// Evaluates at most W queries with different incidences.
#[inline(always)]
fn many<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    queries: &Channels<'_>,
    s: &mut Scratch<H, R, J>,
    f: &mut [f32],
) {
    let [x, y, z] = queries.wo;
    // Queries beyond the end of the arrays have a NaN latitude, so they miss.
    let mut theta_i = head(queries.theta_i, f32::NAN);
    let count = queries.count.max(1);
    let there = [queries.h_um.len(), queries.sigma.len() / count, x.len(), y.len(), z.len()];
    theta_i.iter_mut().skip(there.into_iter().fold(W, usize::min)).for_each(|t| *t = f32::NAN);
    let places = GridCells::new::<FMA>(&tables.grid, &theta_i, &head(queries.h_um, 0.0));
    let mut v = [head(x, 0.0), head(y, 0.0), head(z, 0.0)];
    places.mirror(&mut v);
    let mut hit = places.hit;
    for q in 0..W {
        let p = &places.get(q);
        let v = [v[0][q], v[1][q], v[2][q]];
        if let Some(high) = interpolate_high::<FMA, H, R, J>(tables, p)
            && let Some(refl) = interpolate_refl::<FMA, H, R, J>(tables, p)
            && let Some(node) = interpolate_node::<FMA, H, R, J>(tables, p)
        {
            s.spectrum[q] = high.spectrum;
            s.high.set(q, &high.params, v);
            s.refl.set(q, &refl, v);
            (s.refl_energy[q], s.light.simulated[q]) = (node.refl, node.high);
        } else {
            hit[q] = 0;
        }
    }
    s.high.eval::<FMA>(tables.bandwidth);
    s.refl.eval::<FMA>(tables.bandwidth);
    for q in 0..W {
        s.light.all[q] = by_path::<FMA, H, J>(tables.pairs, &s.high.params[5][q], &s.spectrum[q]);
        s.light.value[q] = by_path::<FMA, H, J>(tables.pairs, &s.high.value[q], &s.spectrum[q]);
    }
    for (q, f) in f.chunks_exact_mut(count).enumerate().take(W) {
        let refl = halves(s.refl.value[q]) * (s.refl_energy[q] / halves(s.refl.params[5][q]));
        f.fill(refl);
    }
    absorb_queries(&tables.path, &s.light, (queries.sigma, count), f);
    for (q, f) in f.chunks_exact_mut(count).enumerate().take(W) {
        if hit[q] == 0 {
            f.fill(0.0);
        }
    }
}

/// The first W entries of `x`, padded with `fill`.
#[inline(always)]
fn head<T: Copy>(x: &[T], fill: T) -> [T; W] {
    x.first_chunk().copied().unwrap_or_else(|| {
        let mut part = [fill; W];
        part.iter_mut().zip(x).for_each(|(part, x)| *part = *x);
        part
    })
}
