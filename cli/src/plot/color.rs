//! Color maps of the figures, those of d3 as the crate `colorous` has them: inferno for densities, whose
//! lightness climbs evenly, and blue to red for signed differences.

/// A color of the figure, sRGB.
pub type Rgb = [u8; 3];

/// Color of `t` in [0, 1]; NaN counts as 0.
pub fn sequential(t: f64) -> Rgb {
    rgb(colorous::INFERNO.eval_continuous(if t.is_nan() { 0.0 } else { t }))
}

/// Color of `t` in [-1, 1]: blue below zero, red above it.
pub fn diverging(t: f64) -> Rgb {
    rgb(colorous::RED_BLUE.eval_continuous(if t.is_nan() { 0.5 } else { 0.5 - 0.5 * t }))
}

/// Black or white, whichever reads better on `background`: equal contrast by WCAG 2 lies at a luminance of
/// 0.18.
pub fn ink_on(background: Rgb) -> Rgb {
    if luminance(background) > 0.18 { [20, 20, 24] } else { [250, 250, 250] }
}

fn rgb(color: colorous::Color) -> Rgb {
    [color.r, color.g, color.b]
}

/// Relative luminance (ITU-R BT.709).
fn luminance(color: Rgb) -> f64 {
    let [r, g, b] = color.map(|v| plywave::color::srgb_decode(f64::from(v) / 255.0));
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE lightness over 100.
    fn lightness(color: Rgb) -> f64 {
        let y = luminance(color);
        if y > 0.008856 { 1.16 * y.cbrt() - 0.16 } else { 9.033 * y }
    }

    #[test]
    fn sequential_map_climbs_evenly_in_lightness() {
        let l: Vec<f64> = (0..=32).map(|i| lightness(sequential(f64::from(i) / 32.0))).collect();
        assert!(l[0] < 0.02 && l[32] > 0.95, "{l:?}");
        let mean = (l[32] - l[0]) / 32.0;
        // Its authors measured uniformity in CAM02-UCS, which differs from CIE lightness near black.
        assert!(l.windows(2).all(|w| (0.2..1.5).contains(&((w[1] - w[0]) / mean))), "{l:?}");
        assert_eq!(sequential(f64::NAN), sequential(0.0));
    }

    #[test]
    fn diverging_map_is_symmetric_in_lightness_about_white() {
        for i in 0..=16 {
            let t = f64::from(i) / 16.0;
            let (a, b) = (lightness(diverging(t)), lightness(diverging(-t)));
            assert!((a - b).abs() < 0.06, "t {t}: {a} {b}");
        }
        assert!(diverging(0.0).iter().all(|&v| v > 235), "{:?}", diverging(0.0));
        assert!(diverging(0.7)[0] > diverging(0.7)[2] && diverging(-0.7)[2] > diverging(-0.7)[0]);
    }
}
