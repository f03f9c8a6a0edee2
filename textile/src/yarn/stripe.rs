//! A stripe: consecutive yarns of one color.

/// Consecutive yarns of one color.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stripe {
    /// Number of yarns.
    pub count: usize,
    /// Their color [sRGB, 0 to 1].
    pub color: [f64; 3],
}
