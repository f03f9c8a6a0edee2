//! All terms of the model at once: what met fibers and what passed beside the ply, from one pass over the tables.

use super::edge::EdgeTables;
use super::kernel::{Mixture, mixture, unit, weights};
use super::layout::Tables;
use crate::PlyTerms;

impl<const N: usize> PlyTerms<N> {
    const NONE: Self = PlyTerms { refl: 0.0, high: [0.0; N], edge: [0.0; N], pdf: 0.0 };
}

/// Adds edge light of energy r_d.
#[inline(always)]
fn add_edge<const FMA: bool, const N: usize>(
    t: &mut PlyTerms<N>,
    edge: Option<&EdgeTables>,
    r_d: f32,
    place: (f32, f32, &[f32; N]),
    wo: [f32; 3],
) {
    if r_d > 0.0
        && let Some(edge) = edge
    {
        t.edge = edge.at::<FMA, N>(place.0, place.1, place.2).eval::<FMA>(wo);
        for f in &mut t.edge {
            *f *= r_d;
        }
    }
}

/// [`add_edge`], with its share of the density: `chance` is that of an edge sample.
#[inline(always)]
fn add_edge_pdf<const FMA: bool, const N: usize>(
    t: &mut PlyTerms<N>,
    edge: Option<&EdgeTables>,
    (r_d, chance): (f32, f32),
    place: (f32, f32, &[f32; N]),
    wo: [f32; 3],
) {
    if r_d > 0.0
        && let Some(edge) = edge
    {
        let (value, density) = edge.at::<FMA, N>(place.0, place.1, place.2).eval_pdf::<FMA>(wo);
        t.edge = value;
        for f in &mut t.edge {
            *f *= r_d;
        }
        t.pdf += chance * density;
    }
}

#[inline(always)]
pub(super) fn eval<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    edge: Option<&EdgeTables>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    lambda: &[f32; N],
    wo: [f32; 3],
) -> PlyTerms<N> {
    let (mut t, mut r_d) = (PlyTerms::NONE, 1.0);
    if let Some((m, x)) = mixture::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma) {
        (t.refl, t.high) = m.eval::<FMA>(&x, wo);
        r_d = m.missed();
    }
    add_edge::<FMA, N>(&mut t, edge, r_d, (theta_i, h_um, lambda), wo);
    t
}

/// Chance that a sample is of the edge light.
#[inline(always)]
fn edge_chance<const H: usize, const R: usize, const L: usize, const J: usize, const N: usize>(
    m: &Mixture<H, R, L, J, N>,
) -> f32 {
    let total = m.total();
    if total > 0.0 { m.missed() / total } else { 0.0 }
}

#[inline(always)]
pub(super) fn pdf<const FMA: bool, const H: usize, const R: usize, const L: usize, const J: usize, const N: usize>(
    tables: &Tables<H, R, J>,
    edge: Option<&EdgeTables>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    lambda: &[f32; N],
    wo: [f32; 3],
) -> PlyTerms<N> {
    let (mut t, mut missed) = (PlyTerms::NONE, (1.0, 1.0));
    if let Some((m, x)) = mixture::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma) {
        (t.refl, t.high, t.pdf) = m.eval_pdf::<FMA>(&x, &m.mean::<FMA>(), wo);
        missed = (m.missed(), edge_chance(&m));
    }
    add_edge_pdf::<FMA, N>(&mut t, edge, missed, (theta_i, h_um, lambda), wo);
    t
}

#[inline(always)]
pub(super) fn sample<
    const FMA: bool,
    const H: usize,
    const R: usize,
    const L: usize,
    const J: usize,
    const N: usize,
>(
    tables: &Tables<H, R, J>,
    edge: Option<&EdgeTables>,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    lambda: &[f32; N],
    u: [f32; 3],
) -> Option<([f32; 3], PlyTerms<N>)> {
    let u = unit(u);
    let place = (theta_i, h_um, lambda);
    let mut t = PlyTerms::NONE;
    let Some(mut m) = weights::<FMA, H, R, L, J, N>(tables, theta_i, h_um, sigma) else {
        let wo = edge?.at::<FMA, N>(theta_i, h_um, lambda).sample::<FMA>(u[0], [u[1], u[2]])?;
        add_edge_pdf::<FMA, N>(&mut t, edge, (1.0, 1.0), place, wo);
        return Some((wo, t));
    };
    let missed = (m.missed(), edge_chance(&m));
    if let Some((wo, (refl, high, pdf))) = m.sample::<FMA>(tables.bandwidth, u) {
        (t.refl, t.high, t.pdf) = (refl, high, pdf);
        add_edge_pdf::<FMA, N>(&mut t, edge, missed, place, wo);
        return Some((wo, t));
    }
    // The missed light is the last part of the unit interval: what is left of the number chooses the wavelength.
    if missed.1 <= 0.0 {
        return None;
    }
    let v = unit([1.0 - (1.0 - u[0]) / missed.1; 3])[0];
    let wo = edge?.at::<FMA, N>(theta_i, h_um, lambda).sample::<FMA>(v, [u[1], u[2]])?;
    m.scale::<FMA>();
    let x = m.shapes::<FMA>(tables.bandwidth);
    (t.refl, t.high, t.pdf) = m.eval_pdf::<FMA>(&x, &m.mean::<FMA>(), wo);
    add_edge_pdf::<FMA, N>(&mut t, edge, missed, place, wo);
    Some((wo, t))
}
