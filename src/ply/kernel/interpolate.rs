//! Lobes at an incidence, interpolated from those at the nodes (f_refl, Catmull-Rom) and at the corners of
//! the block (f_high, bilinear).

use super::energy::{mix, some};
use super::grid_cell::GridCell;
use super::layout::{High, Refl, Tables};
use crate::ply::asg::PARAMS;

#[inline(always)]
pub(in crate::ply) fn interpolate_refl<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &GridCell,
) -> Option<[[f32; R]; PARAMS]> {
    let [a, b, c, d]: &[Refl<R>; 4] = some(&tables.refl, p.refl)?;
    // Along h first: the nodes along theta_i are consecutive, and fill the widest vectors.
    let (a, b) = (a.0.as_flattened().as_flattened(), b.0.as_flattened().as_flattened());
    let (c, d) = (c.0.as_flattened().as_flattened(), d.0.as_flattened().as_flattened());
    let mut along_h = [[[0.0; R]; PARAMS]; 4];
    for (i, value) in along_h.as_flattened_mut().as_flattened_mut().iter_mut().enumerate() {
        *value = mix::<FMA>(p.wn, [a[i], b[i], c[i], d[i]]);
    }
    let [a, b, c, d] = &along_h;
    let (a, b, c, d) = (a.as_flattened(), b.as_flattened(), c.as_flattened(), d.as_flattened());
    let mut sum = [[0.0; R]; PARAMS];
    for (i, value) in sum.as_flattened_mut().iter_mut().enumerate() {
        *value = mix::<FMA>(p.wm, [a[i], b[i], c[i], d[i]]);
    }
    Some(sum)
}

/// High-order lobes and their spectra, bilinear between the corners of the block, which spans two cells each
/// way.
#[inline(always)]
pub(in crate::ply) fn interpolate_high<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &GridCell,
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
