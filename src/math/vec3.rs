//! Vectors of three numbers, as arrays.

use std::ops::{Add, Mul, Sub};

/// Dot product, without fused operations, summed in the order of the components. SKIP
#[inline(always)]
pub fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
#[inline(always)]
pub fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// a - b.
#[inline(always)]
pub fn sub<T: Copy + Sub<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The unit vector along `a`; the zero vector stays 0.
pub fn unit(a: [f64; 3]) -> [f64; 3] {
    let scale = 1.0 / dot(a, a).max(f64::MIN_POSITIVE).sqrt();
    a.map(|v| v * scale)
}
