//! Polynomials of a direction, in which inter-yarn scattering is fitted.

/// Polynomials of the direction.
pub const TERMS: usize = 16;
/// Polynomials of what depends little on it.
pub const FEW: usize = 8;
/// A polynomial of the direction for each pair of absorptions.
pub type Poly = [f32; TERMS];
/// The first terms of one.
pub type Few = [f32; FEW];

/// The polynomials at a direction; z counts as positive.
#[inline]
pub fn terms(w: [f32; 3]) -> Poly {
    let [x, y, z] = w;
    let z = z.abs();
    let (d, e) = (x * x - y * y, 2.0 * x * y);
    [1.0, z, z * z, z * z * z, x, y, x * z, y * z, d, e, d * z, e * z, d * z * z, e * z * z, d * d - e * e, 2.0 * d * e]
}

/// The terms that energies per caught energy have: they depend little on the direction.
#[inline]
pub fn few(t: &Poly) -> Few {
    [t[0], t[1], t[2], t[3], t[4], t[5], t[8], t[9]]
}

/// Scalar product.
#[inline]
pub fn dot<const T: usize>(a: &[f32; T], b: &[f32; T]) -> f32 {
    // Lanes apart: the compiler keeps the order of sums.
    let mut sums = [0.0; 4];
    for i in 0..T {
        sums[i % 4] += a[i] * b[i];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
