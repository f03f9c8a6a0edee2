//! Colour maps made in OKLab (Ottosson 2020): even steps in that space look even. The sequential map climbs in lightness from
//! black-violet to pale yellow; the diverging one has two arms of equal lightness that meet in a light gray.
//!
//! Both are a few control points, joined smoothly, then spaced anew by arc length, so that equal steps of the value are equal
//! steps of colour (tested).

use std::sync::LazyLock;

/// A colour of the figure, sRGB.
pub type Rgb = [u8; 3];

const ENTRIES: usize = 256;

/// Control points of the sequential map: lightness, chroma, hue [degrees] in OKLab.
const SEQUENTIAL: &[[f64; 3]] = &[
    [0.13, 0.030, 285.0],
    [0.27, 0.105, 294.0],
    [0.41, 0.150, 322.0],
    [0.55, 0.165, 362.0],
    [0.68, 0.165, 400.0],
    [0.81, 0.150, 432.0],
    [0.96, 0.075, 464.0],
];

/// Control points of the diverging map: negative arm, middle, positive arm.
const DIVERGING: &[[f64; 3]] = &[
    [0.34, 0.120, 262.0],
    [0.53, 0.145, 252.0],
    [0.75, 0.085, 240.0],
    [0.965, 0.000, 240.0],
    [0.75, 0.105, 45.0],
    [0.53, 0.165, 30.0],
    [0.34, 0.125, 22.0],
];

static SEQUENTIAL_TABLE: LazyLock<Vec<Rgb>> = LazyLock::new(|| table(SEQUENTIAL));
static DIVERGING_TABLE: LazyLock<Vec<Rgb>> = LazyLock::new(|| table(DIVERGING));

/// Colour of `t` in [0, 1] on the sequential map.
pub fn sequential(t: f64) -> Rgb {
    pick(&SEQUENTIAL_TABLE, t)
}

/// Colour of `t` in [-1, 1] on the diverging map: blue below zero, red above it.
pub fn diverging(t: f64) -> Rgb {
    pick(&DIVERGING_TABLE, 0.5 + 0.5 * t)
}

/// Black or white, whichever reads better on `background`.
pub fn ink_on(background: Rgb) -> Rgb {
    if oklab(background)[0] > 0.62 { [20, 20, 24] } else { [250, 250, 250] }
}

fn pick(table: &[Rgb], t: f64) -> Rgb {
    // A NaN becomes 0 by the cast.
    table[((t.clamp(0.0, 1.0) * (ENTRIES - 1) as f64).round() as usize).min(ENTRIES - 1)]
}

/// The control points joined by Catmull-Rom splines in OKLab, sampled finely, then evenly by arc length.
fn table(points: &[[f64; 3]]) -> Vec<Rgb> {
    let lab: Vec<[f64; 3]> = points
        .iter()
        .map(|&[l, c, h]| {
            let (sin, cos) = h.to_radians().sin_cos();
            [l, c * cos, c * sin]
        })
        .collect();
    let last = lab.len() - 1;
    let fine = 64 * last;
    let mut curve = Vec::with_capacity(fine + 1);
    let mut length = vec![0.0];
    for i in 0..=fine {
        let x = i as f64 * last as f64 / fine as f64;
        let k = (x as usize).min(last - 1);
        let t = x - k as f64;
        // The middle of a diverging map is a corner of the path: no tangent across it, arms stay straight there.
        let corner = |j: usize| j == 0 || j == last || points[j][1] == 0.0;
        let mut p = [0.0; 3];
        for a in 0..3 {
            let chord = lab[k + 1][a] - lab[k][a];
            let m0 = if corner(k) { chord } else { 0.5 * (lab[k + 1][a] - lab[k - 1][a]) };
            let m1 = if corner(k + 1) { chord } else { 0.5 * (lab[k + 2][a] - lab[k][a]) };
            let (t2, t3) = (t * t, t * t * t);
            p[a] = (2.0 * t3 - 3.0 * t2 + 1.0) * lab[k][a]
                + (t3 - 2.0 * t2 + t) * m0
                + (3.0 * t2 - 2.0 * t3) * lab[k + 1][a]
                + (t3 - t2) * m1;
        }
        if let Some(&q) = curve.last() {
            length.push(length[i - 1] + distance(p, q));
        }
        curve.push(p);
    }
    let total = length[fine];
    let mut i = 0;
    (0..ENTRIES)
        .map(|e| {
            let want = total * e as f64 / (ENTRIES - 1) as f64;
            while i + 1 < fine && length[i + 1] < want {
                i += 1;
            }
            let t = ((want - length[i]) / (length[i + 1] - length[i])).clamp(0.0, 1.0);
            let mix = |a: usize| curve[i][a] + t * (curve[i + 1][a] - curve[i][a]);
            srgb([mix(0), mix(1), mix(2)])
        })
        .collect()
}

fn distance(p: [f64; 3], q: [f64; 3]) -> f64 {
    (0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f64>().sqrt()
}

/// OKLab to sRGB, clipped to the gamut.
fn srgb([l, a, b]: [f64; 3]) -> Rgb {
    let cube = |x: f64| x * x * x;
    let (lc, mc, sc) = (
        cube(l + 0.396_337_777_4 * a + 0.215_803_757_3 * b),
        cube(l - 0.105_561_345_8 * a - 0.063_854_172_8 * b),
        cube(l - 0.089_484_177_5 * a - 1.291_485_548_0 * b),
    );
    let linear = [
        4.076_741_662_1 * lc - 3.307_711_591_3 * mc + 0.230_969_929_2 * sc,
        -1.268_438_004_6 * lc + 2.609_757_401_1 * mc - 0.341_319_396_5 * sc,
        -0.004_196_086_3 * lc - 0.703_418_614_7 * mc + 1.707_614_701_0 * sc,
    ];
    linear.map(|c| {
        let v = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        (v * 255.0).round().clamp(0.0, 255.0) as u8
    })
}

/// sRGB to OKLab.
fn oklab(c: Rgb) -> [f64; 3] {
    let [r, g, b] = c.map(|v| {
        let v = v as f64 / 255.0;
        if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    });
    let l = (0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b).cbrt();
    let m = (0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b).cbrt();
    let s = (0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b).cbrt();
    [
        0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oklab_round_trips() {
        for c in [[0, 0, 0], [255, 255, 255], [200, 30, 90], [10, 240, 130]] {
            let got = srgb(oklab(c));
            assert!((0..3).all(|i| got[i].abs_diff(c[i]) <= 1), "{c:?} -> {got:?}");
        }
    }

    /// Steps of 8 entries have equal length in OKLab; eight bits and the gamut leave a little unevenness.
    fn unevenness(map: impl Fn(f64) -> Rgb, from: f64, to: f64) -> f64 {
        let n = 32;
        let steps: Vec<f64> = (0..n)
            .map(|i| {
                let at = |i: usize| oklab(map(from + (to - from) * i as f64 / n as f64));
                distance(at(i), at(i + 1))
            })
            .collect();
        let mean = steps.iter().sum::<f64>() / n as f64;
        steps.iter().map(|s| (s / mean - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn sequential_map_is_even_and_climbs_in_lightness() {
        let bad = unevenness(sequential, 0.0, 1.0);
        assert!(bad < 0.25, "largest departure of a step from the mean: {bad}");
        let l: Vec<f64> = (0..=64).map(|i| oklab(sequential(i as f64 / 64.0))[0]).collect();
        assert!(l.windows(2).all(|w| w[1] > w[0]), "{l:?}");
    }

    #[test]
    fn diverging_map_is_even_and_symmetric_in_lightness() {
        let bad = unevenness(diverging, -1.0, 1.0);
        assert!(bad < 0.35, "largest departure of a step from the mean: {bad}");
        for i in 0..=16 {
            let t = i as f64 / 16.0;
            let (a, b) = (oklab(diverging(t))[0], oklab(diverging(-t))[0]);
            assert!((a - b).abs() < 0.04, "t {t}: {a} {b}");
        }
        assert!(diverging(0.0).iter().all(|&v| v > 235), "{:?}", diverging(0.0));
    }
}
