//! Vectors that are no directions, which give no light.

use plywave::Bsdf;

/// Vectors that are not directions, from slightly too long to those whose squares overflow.
pub const NONE: [[f32; 3]; 9] = [
    [1e30, 0.0, -1e30],
    [1.9e19, 0.5, -0.5],
    [0.5, -1.9e19, -0.5],
    [0.5, 0.5, -1.9e19],
    [f32::MAX, f32::MAX, -f32::MAX],
    [f32::NAN, 0.6, -0.8],
    [0.0, f32::INFINITY, -0.8],
    [0.0, 0.6, f32::NEG_INFINITY],
    [0.0, -20.0, -20.0],
];

/// No light towards `w`, and no density.
pub fn dark<const N: usize>(at: &impl Bsdf<N>, w: [f32; 3], what: &str) {
    let (f, pdf) = at.eval_pdf(w);
    assert!(f == [0.0; N] && pdf == 0.0, "{what}: f = {f:?}, pdf = {pdf} in {w:?}");
    assert!(at.eval(w) == [0.0; N] && at.pdf(w) == 0.0, "{what}: {w:?}");
}
