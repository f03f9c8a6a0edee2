//! Polynomials of a direction, to which the energies of inter-yarn scattering are fitted.
//!
//! `terms` evaluates 16 products of z and of cosines and sines of the azimuth up to fourth order; `few`
//! selects the 8 of lowest order, for quantities that depend little on the direction.

/// Number of polynomial terms of a direction.
pub const TERMS: usize = 16;
/// Number of terms for quantities that depend little on the direction.
pub const FEW: usize = 8;
/// Coefficients of all terms.
pub type Poly = [f32; TERMS];
/// Coefficients of the terms that [`few`] selects.
pub type Few = [f32; FEW];

/// Evaluates the terms at a direction; z counts as |z|.
#[inline(always)]
pub fn terms(w: [f32; 3]) -> Poly {
    let [x, y, z] = w;
    let z = z.abs();
    let (d, e) = (x * x - y * y, 2.0 * x * y);
    [1.0, z, z * z, z * z * z, x, y, x * z, y * z, d, e, d * z, e * z, d * z * z, e * z * z, d * d - e * e, 2.0 * d * e]
}

/// Selects the terms used for ratios of energies, which depend little on the direction.
#[inline(always)]
pub fn few(t: &Poly) -> Few {
    [t[0], t[1], t[2], t[3], t[4], t[5], t[8], t[9]]
}

/// Scalar product.
#[inline(always)]
pub fn dot<const T: usize>(a: &[f32; T], b: &[f32; T]) -> f32 {
    // Four partial sums are independent lanes; the compiler cannot reorder floating-point sums itself.
    let mut sums = [0.0; 4];
    for i in 0..T {
        sums[i % 4] += a[i] * b[i];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
