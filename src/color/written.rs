//! Colors as people write them, parsed to sRGB from 0 to 1.
//!
//! Three numbers up to 1 are fractions. If one of them is above 1, all three must be integers and are divided
//! by 255. So 1, 1, 1 is white, as three fractions, and 2, 1, 1 is nearly black.

/// The accepted forms, for messages.
pub const SRGB_FORMS: &str =
    "three numbers from 0 to 1, or three whole numbers up to 255, red, green and blue, or \"#rrggbb\" or \"#rgb\"";

/// sRGB of three numbers; `None` if they have neither form.
pub fn srgb_of_numbers(numbers: [f64; 3]) -> Option<[f64; 3]> {
    let all = |of: fn(f64) -> bool| numbers.iter().all(|v| of(*v));
    if all(|v| (0.0..=1.0).contains(&v)) {
        return Some(numbers);
    }
    all(|v| (0.0..=255.0).contains(&v) && v.fract() == 0.0).then(|| numbers.map(|v| v / 255.0))
}

/// sRGB of a text: hexadecimal digits with or without `#`, or three numbers separated by commas or spaces.
/// `None` if the text has neither form.
pub fn srgb_of_text(text: &str) -> Option<[f64; 3]> {
    let text = text.trim();
    let digits = text.strip_prefix('#').unwrap_or(text);
    if matches!(digits.len(), 3 | 6) && digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return srgb_of_digits(digits);
    }
    let numbers = text.split([',', ' ']).filter(|word| !word.is_empty()).map(|word| word.parse().ok());
    let numbers: Vec<f64> = numbers.collect::<Option<_>>()?;
    srgb_of_numbers(numbers.try_into().ok()?)
}

/// sRGB of three or six hexadecimal digits; a single digit is doubled.
fn srgb_of_digits(digits: &str) -> Option<[f64; 3]> {
    let per = digits.len() / 3;
    let mut srgb = [0.0; 3];
    for (k, value) in srgb.iter_mut().enumerate() {
        let byte = u8::from_str_radix(digits.get(k * per..(k + 1) * per)?, 16).ok()?;
        *value = f64::from(if per == 1 { 17 * byte } else { byte }) / 255.0;
    }
    Some(srgb)
}

/// sRGB of a TOML value: an array of numbers, or a text.
pub fn srgb_of_value(value: &toml::Value) -> Option<[f64; 3]> {
    let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
    match value {
        toml::Value::String(text) => srgb_of_text(text),
        toml::Value::Array(list) => {
            let numbers: Vec<f64> = list.iter().map(number).collect::<Option<_>>()?;
            srgb_of_numbers(numbers.try_into().ok()?)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_form_is_the_color_that_it_stands_for() {
        let bytes = |v: [u8; 3]| Some(v.map(|v| f64::from(v) / 255.0));
        for (text, want) in [
            ("#c81e28", bytes([200, 30, 40])),
            ("C81E28", bytes([200, 30, 40])),
            (" #c81e28 ", bytes([200, 30, 40])),
            ("200,30,40", bytes([200, 30, 40])),
            ("200, 30, 40", bytes([200, 30, 40])),
            ("200 30 40", bytes([200, 30, 40])),
            ("#abc", bytes([0xaa, 0xbb, 0xcc])),
            ("abc", bytes([0xaa, 0xbb, 0xcc])),
            ("0.5,0.25,1", Some([0.5, 0.25, 1.0])),
            // Up to 1 they are fractions: white, black, red. One number above 1 makes all of them parts of
            // 255.
            ("1,1,1", Some([1.0; 3])),
            ("0,0,0", Some([0.0; 3])),
            ("1,0,0", Some([1.0, 0.0, 0.0])),
            ("2,1,0", bytes([2, 1, 0])),
            ("255,255,255", Some([1.0; 3])),
        ] {
            assert_eq!(srgb_of_text(text), want, "{text}");
        }
        for text in [
            "",
            "#",
            "#ab",
            "#abcd",
            "#aabbccdd",
            "#aabbcg",
            "red",
            "0.5,0.5",
            "1,2,3,4",
            "0.5,0.5,1.5",
            "256,0,0",
            "-1,0,0",
            "nan,0,0",
            "200,30.5,40",
            "inf,0,0",
            "#äbc",
            "#é1",
            "#äöü",
        ] {
            assert_eq!(srgb_of_text(text), None, "{text}");
        }
    }
}
