//! Light between layers of fibers that each transmit a_f and reflect a_b (Khungurn 2015, 5.1 and 7).

/// The numbers of backscatterings that are included in A_b.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backscattering {
    /// One and three: A_1 + A_3 (Khungurn 2015, 5.1).
    OneAndThree,
    /// All orders (Khungurn 2015, 7, corrected).
    Full,
}

impl Backscattering {
    /// A_b of layers with the shares `forward` and `backward`, in [0, 1]. If the shares sum to more than 1,
    /// as in models that do not conserve energy, they are scaled to a sum of 1.
    ///
    /// Full: light that has passed fiber 0 (a_f) arrives at fiber 1 from above and leaves at the top with the
    /// probability `x = 2 a_f a_b / (S + sqrt(S^2 - 4 a_f^2 a_b^2))`, `S = 1 - a_f^2 - a_b^2`. This is the
    /// root of the note's quadratic in a form without cancellation, where
    /// `S^2 - 4 a_f^2 a_b^2 = (1 - (a_f + a_b)^2) (1 - (a_f - a_b)^2)`. A_b is therefore `a_f x`; the note's
    /// last line has `a_f a_0^+`, which counts fiber 0 twice.
    pub fn sum(self, forward: f32, backward: f32) -> f32 {
        let (f, b) = bounded(forward, backward);
        let sum = match self {
            Backscattering::OneAndThree => {
                // a_b^2 / (1 - a_f^2) is at most 1.
                let rest = (1.0 - f * f).max(1e-12);
                let one = b * f * f / rest;
                one + one * (b / rest) * (b / rest)
            }
            Backscattering::Full => {
                let s = (1.0 - f) * (1.0 + f) - b * b;
                let root = ((1.0 - (f + b)) * (1.0 + f + b) * (1.0 - (f - b).powi(2))).max(0.0).sqrt();
                if b > 0.0 && s + root > 0.0 { (2.0 * f * f * b / (s + root)).min(f) } else { 0.0 }
            }
        };
        sum as f32
    }
}

/// The shares in f64, clamped to 0 or more and scaled to a sum of at most 1.
fn bounded(forward: f32, backward: f32) -> (f64, f64) {
    let [f, b] = [forward, backward].map(|share| f64::from(share.max(0.0).min(1e6)));
    let scale = 1.0 / (f + b).max(1.0);
    (f * scale, b * scale)
}

/// Reflection and transmission of a stack of layers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stack {
    /// Reflected share.
    pub reflected: f32,
    /// Transmitted share.
    pub transmitted: f32,
}

/// A stack of `count` equal layers, added one at a time: `R' = a_b + a_f^2 R / (1 - a_b R)`,
/// `T' = a_f T / (1 - a_b R)`. With 0 layers all light passes. As the count grows, R tends to `a_b + A_b` of
/// [`Backscattering::Full`].
pub fn stack(forward: f32, backward: f32, count: u32) -> Stack {
    let (f, b) = bounded(forward, backward);
    let (mut r, mut t) = (0.0, 1.0);
    for _ in 0..count {
        let between = 1.0 / (1.0 - b * r).max(1e-12);
        (r, t) = (b + f * f * r * between, f * t * between);
    }
    Stack { reflected: r as f32, transmitted: t as f32 }
}
