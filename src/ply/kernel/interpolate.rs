//! Lobes at an incidence, interpolated from those at the nodes (f_refl, Catmull-Rom) and at the corners of
//! the block (f_high, bilinear).

use super::energy::mix;
use super::grid_cell::GridCell;
use super::layout::{High, Tables};
use crate::ply::asg::PARAMS;

#[inline(always)]
pub(in crate::ply) fn interpolate_refl<const FMA: bool, const H: usize, const R: usize, const J: usize>(
    tables: &Tables<H, R, J>,
    p: &GridCell,
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
