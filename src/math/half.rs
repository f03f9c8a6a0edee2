//! Conversion between f32 and the bits of half precision (IEEE 754 binary16).

/// The nearest half-precision number, ties to even. Larger numbers are clamped to the largest finite one; NaN
/// stays NaN.
pub fn to_half(value: f32) -> u16 {
    let sign = ((value.to_bits() >> 16) & 0x8000) as u16;
    let v = value.abs();
    if v.is_nan() {
        return sign | 0x7e00;
    }
    if v >= 65504.0 {
        return sign | 0x7bff;
    }
    // Step of the last digit; below 2^-14 it is that of the smallest normal number.
    let exponent = ((v.to_bits() >> 23) as i32 - 127).max(-14);
    let step = f32::from_bits(((exponent - 10 + 127) as u32) << 23);
    let steps = (v / step).round_ties_even() as u32;
    // A carry out of the digits increments the exponent, as it should.
    sign | (((exponent + 14) as u32 * 1024) + steps) as u16
}

/// The number that these bits represent.
pub fn from_half(bits: u16) -> f32 {
    let (exponent, digits) = (i32::from((bits >> 10) & 31), f32::from(bits & 1023));
    let v = match exponent {
        0 => digits * f32::from_bits((127 - 24) << 23),
        31 if digits > 0.0 => f32::NAN,
        31 => f32::INFINITY,
        _ => (1024.0 + digits) * f32::from_bits(((exponent - 25 + 127) as u32) << 23),
    };
    if bits & 0x8000 != 0 { -v } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_come_back() {
        for bits in (0..=0xffffu32).map(|bits| bits as u16) {
            let v = from_half(bits);
            if v.is_finite() {
                assert_eq!(to_half(v), bits, "{v}");
            }
        }
        assert_eq!(from_half(0x3c00), 1.0);
        assert_eq!(from_half(0x0001), 2f32.powi(-24));
        assert_eq!(from_half(0x7bff), 65504.0);
        // A number half-way between two goes to the even one.
        assert_eq!(to_half(1.0 + 2f32.powi(-11)), 0x3c00);
        assert_eq!(to_half(1.0 + 3.0 * 2f32.powi(-11)), 0x3c02);
        assert_eq!(to_half(1e9), 0x7bff);
        assert!(from_half(to_half(f32::NAN)).is_nan());
    }
}
