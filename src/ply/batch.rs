//! Many incidences at once: the lobes of W queries side by side in long arrays, so that every lane of a vector holds a lobe and
//! one query's chain of dependent steps hides behind the others'.

use super::Queries;
use super::kernel::{
    Energies, LANES, Lanes, Places, absorb, absorbed, halves, interpolate_high, interpolate_node, interpolate_refl,
    log_transmittances, mirrored, mixture, scales, sum, transmit,
};
use super::layout::Tables;
use crate::asg::PARAMS;

/// Queries in a chunk: their numbers, 13 KiB, stay in the first-level cache.
const W: usize = 16;

/// f at `queries`; 0 beyond their shortest array. L is as of [`mixture`].
#[inline(always)]
pub(super) fn eval<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    queries: &Queries<'_, N>,
    f: &mut [[f32; N]],
) {
    let mut scratch = Scratch {
        high: Lobes::new(tables.least_high),
        refl: Lobes::new(tables.least_refl),
        spectrum: [[[0.0; J]; H]; W],
        simulated: [(0.0, [0.0; J]); W],
        transmittance: [[[0.0; N]; J]; W],
    };
    for (chunk, f) in f.chunks_mut(W).enumerate() {
        let q = queries.from(chunk * W);
        if q.one_incidence(f.len()) {
            one_incidence::<FMA, H, R, L, J, N>(tables, &q, f);
        } else {
            many::<FMA, H, R, J, N>(tables, &q, &mut scratch, f);
        }
    }
}

#[inline(always)]
fn one_incidence<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    queries: &Queries<'_, N>,
    f: &mut [[f32; N]],
) {
    f.fill([0.0; N]);
    let Some((theta_i, h_um, sigma, _)) = queries.get(0) else { return };
    let Some(mixture) = mixture::<FMA, H, R, L, J, N>(tables, theta_i, h_um, &sigma) else { return };
    for (i, f) in f.iter_mut().enumerate() {
        let Some((_, _, _, wo)) = queries.get(i) else { return };
        let (refl, high) = mixture.eval::<FMA>(wo);
        *f = sum(refl, high);
    }
}

/// Numbers of W queries. Lobes of kind K have K lanes a query.
struct Lobes<const K: usize> {
    params: [[[f32; K]; W]; PARAMS],
    v: [[[f32; K]; W]; 3],
    least: [[f32; K]; W],
    energy: [[f32; K]; W],
    value: [[f32; K]; W],
}

impl<const K: usize> Lobes<K> {
    #[inline(always)]
    fn new(least: [f32; K]) -> Self {
        let zero = [[0.0; K]; W];
        Lobes { params: [zero; PARAMS], v: [zero; 3], least: [least; W], energy: zero, value: zero }
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

    #[inline(always)]
    fn eval<const FMA: bool>(&mut self, bounds: (f32, f32)) {
        let lane = |x: &[[f32; K]; W], at: usize| {
            x.as_flattened().as_chunks::<LANES>().0.get(at).copied().unwrap_or([0.0; LANES])
        };
        for at in 0..W * K / LANES {
            let p = &self.params;
            let lanes = Lanes {
                params: [
                    lane(&p[0], at),
                    lane(&p[1], at),
                    lane(&p[2], at),
                    lane(&p[3], at),
                    lane(&p[4], at),
                    lane(&p[5], at),
                ],
                v: [lane(&self.v[0], at), lane(&self.v[1], at), lane(&self.v[2], at)],
                least: lane(&self.least, at),
            };
            let (energy, value) = lanes.eval::<FMA>(bounds);
            self.energy.as_flattened_mut().as_chunks_mut::<LANES>().0[at] = energy;
            self.value.as_flattened_mut().as_chunks_mut::<LANES>().0[at] = value;
        }
    }
}

/// Numbers of W queries.
struct Scratch<const H: usize, const R: usize, const J: usize, const N: usize> {
    high: Lobes<H>,
    refl: Lobes<R>,
    spectrum: [[[f32; J]; H]; W],
    /// Energy of f_refl, spectrum of the energy of f_high.
    simulated: [(f32, [f32; J]); W],
    transmittance: [[[f32; N]; J]; W],
}

/// At most W queries.
#[inline(always)]
fn many<const FMA: bool, const H: usize, const R: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    queries: &Queries<'_, N>,
    s: &mut Scratch<H, R, J, N>,
    f: &mut [[f32; N]],
) {
    // Queries that are not there miss.
    let (mut theta_i, mut h_um) = ([f32::NAN; W], [0.0; W]);
    for q in 0..f.len().min(W) {
        if let Some(query) = queries.get(q) {
            (theta_i[q], h_um[q]) = (query.0, query.1);
        }
    }
    let places = Places::new(&tables.grid, &theta_i, &h_um);
    let mut hit = [false; W];
    for q in 0..f.len().min(W) {
        let p = &places.get(q);
        let Some((_, _, sigma, wo)) = queries.get(q).filter(|_| p.hit) else { continue };
        let Some(lobes) = interpolate_high::<FMA, H, R, J>(tables, p) else { continue };
        let Some(lobes_refl) = interpolate_refl::<FMA, H, R, J>(tables, p) else { continue };
        let Some(node) = interpolate_node::<FMA, J>(&tables.grid, &tables.nodes, p) else { continue };
        hit[q] = true;
        let v = mirrored(p.flip, wo);
        s.high.set(q, &lobes.params, v);
        s.refl.set(q, &lobes_refl, v);
        s.spectrum[q] = lobes.spectrum;
        s.simulated[q] = (node.refl, node.high);
        s.transmittance[q] = log_transmittances(&tables.path, &sigma);
    }
    transmit::<FMA>(s.transmittance.as_flattened_mut().as_flattened_mut());
    s.high.eval::<FMA>(tables.bandwidth);
    s.refl.eval::<FMA>(tables.bandwidth);
    for (q, f) in f.iter_mut().enumerate().take(W) {
        *f = [0.0; N];
        if hit[q] {
            let t = &s.transmittance[q];
            let high = absorb::<FMA, J, N>(&s.simulated[q].1, t);
            let energies = Energies { r_d: 0.0, refl: s.simulated[q].0, high };
            let energy = absorbed::<FMA, H, J, N>(tables.pairs, &s.high.energy[q], &s.spectrum[q], t);
            let mut value = absorbed::<FMA, H, J, N>(tables.pairs, &s.high.value[q], &s.spectrum[q], t);
            let (scale_refl, scale_high) = scales(&energies, halves(s.refl.energy[q]), &energy);
            for k in 0..N {
                value[k] *= scale_high[k];
            }
            *f = sum(halves(s.refl.value[q]) * scale_refl, value);
        }
    }
}
