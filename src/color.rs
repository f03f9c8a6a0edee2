//! Color: from spectra to XYZ and sRGB for output, and from a color or a reflectance to the absorption
//! sigma(lambda) for input.
//!
//! Spectra are stored at 5 nm from 0.38 to 0.78 um. They are linear between the nodes and constant beyond the
//! ends. Integrals are sums over the nodes, the method of the CIE for 5 nm tables:
//! `X = sum of x_bar(lambda) S(lambda) / sum of y_bar(lambda)`, so a spectrum that is 1 everywhere has Y = 1.
//!
//! The white point of sRGB is that of the tabulated D65, (0.3127, 0.3290) to four digits, and the matrix
//! follows from it and from the primaries of ITU-R BT.709. A flat reflectance is therefore an exact gray. The
//! digits printed in IEC 61966-2-1 differ by at most 4e-4.

mod absorption;
mod difference;
mod natural;
mod tables;
mod upsample;
mod written;

pub use absorption::{AlbedoCurve, Clamped, SigmaSpectrum};
pub use difference::delta_e_2000;
pub use natural::Undyed;
pub use upsample::SmoothReflectance;
#[doc(hidden)]
pub use written::srgb_of_value;
pub use written::{SRGB_FORMS, srgb_of_numbers, srgb_of_text};

use tables::{D65, X_BAR, X10_BAR, Y_BAR, Y10_BAR, Z_BAR, Z10_BAR};

/// Number of nodes of a spectrum.
pub const SPECTRUM_NODES: usize = 81;
/// Wavelengths [um] that represent R, G and B in a host that renders in RGB: the dominant wavelengths of the
/// sRGB primaries. Diffraction and speckle use them; the color of the yarns does not depend on them.
pub const RGB_LAMBDA_UM: [f32; 3] = [0.612, 0.549, 0.464];

/// First and last wavelength of a spectrum [um].
pub const SPECTRUM_UM: [f64; 2] = [0.38, 0.78];

/// Wavelength of a node [um].
pub fn spectrum_lambda_um(node: usize) -> f64 {
    (380 + 5 * node) as f64 * 1e-3
}

/// Position of a wavelength [um] among the nodes, as node and fraction. Wavelengths beyond the nodes are
/// clamped to them, and NaN becomes the first node.
fn place(lambda_um: f64) -> (usize, f64) {
    let x = ((lambda_um - SPECTRUM_UM[0]) / 0.005).max(0.0).min((SPECTRUM_NODES - 1) as f64);
    let node = (x as usize).min(SPECTRUM_NODES - 2);
    (node, x - node as f64)
}

/// The color matching functions of the CIE 1931 standard observer at a wavelength [um]; 0 outside the table.
pub fn color_matching(lambda_um: f64) -> [f64; 3] {
    if !(SPECTRUM_UM[0]..=SPECTRUM_UM[1]).contains(&lambda_um) {
        return [0.0; 3];
    }
    let (i, t) = place(lambda_um);
    [&X_BAR, &Y_BAR, &Z_BAR].map(|bar| bar[i] + t * (bar[i + 1] - bar[i]))
}

/// XYZ of a spectrum of light; Y = 1 for a spectrum that is 1 at every wavelength.
pub fn xyz_of_light(light: impl Fn(f64) -> f64) -> [f64; 3] {
    sums(OBSERVER_2_DEG, |i| light(spectrum_lambda_um(i)), |_| 1.0)
}

/// XYZ of a reflectance under D65; Y = 1 for a reflectance that is 1 at every wavelength.
pub fn xyz_of_reflectance(reflectance: impl Fn(f64) -> f64) -> [f64; 3] {
    sums(OBSERVER_2_DEG, |i| reflectance(spectrum_lambda_um(i)), |i| D65[i])
}

/// XYZ of a reflectance under D65 for the standard observer of 1964 (10 degrees), which textile labs use; Y =
/// 1 for a reflectance that is 1 at every wavelength.
pub fn xyz_10_of_reflectance(reflectance: impl Fn(f64) -> f64) -> [f64; 3] {
    sums([&X10_BAR, &Y10_BAR, &Z10_BAR], |i| reflectance(spectrum_lambda_um(i)), |i| D65[i])
}

/// X, Y and Z per um of wavelength of a white surface under D65, at a wavelength [um], for hosts that sample
/// wavelengths. The integral of Y is 1. Outside the table the values are 0.
pub fn d65_xyz_density(lambda_um: f64) -> [f64; 3] {
    let (i, t) = place(lambda_um);
    let light = D65[i] + t * (D65[i + 1] - D65[i]);
    let white: f64 = D65.iter().zip(&Y_BAR).map(|(d, y)| d * y).sum();
    color_matching(lambda_um).map(|bar| bar * light / (0.005 * white))
}

/// Color matching functions of an observer.
type Observer = [&'static [f64; SPECTRUM_NODES]; 3];
const OBSERVER_2_DEG: Observer = [&X_BAR, &Y_BAR, &Z_BAR];

fn sums(bars: Observer, value: impl Fn(usize) -> f64, light: impl Fn(usize) -> f64) -> [f64; 3] {
    let (mut xyz, mut white) = ([0.0; 3], 0.0);
    for i in 0..SPECTRUM_NODES {
        let (v, light) = (value(i), light(i));
        white += light * bars[1][i];
        for (sum, bar) in xyz.iter_mut().zip(bars) {
            *sum += v * light * bar[i];
        }
    }
    xyz.map(|v| v / white)
}

/// XYZ of D65, with Y = 1.
pub fn white_d65() -> [f64; 3] {
    xyz_of_reflectance(|_| 1.0)
}

type Matrix = [[f64; 3]; 3];

fn times(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The inverse by cofactors. It is not finite for a singular matrix.
fn inverse(m: &Matrix) -> Matrix {
    let minor = |r: usize, c: usize| {
        let (r, s, c, d) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r][c] * m[s][d] - m[r][d] * m[s][c]
    };
    let det = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
    std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / det))
}

/// Matrix from linear RGB of these primaries to XYZ. The columns are the primaries, scaled so that (1, 1, 1)
/// is D65.
fn primaries_to_xyz(primaries: [[f64; 2]; 3]) -> Matrix {
    let columns = primaries.map(|[x, y]| [x / y, 1.0, (1.0 - x - y) / y]);
    let m: Matrix = std::array::from_fn(|r| std::array::from_fn(|c| columns[c][r]));
    let scale = times(&inverse(&m), white_d65());
    std::array::from_fn(|r| std::array::from_fn(|c| m[r][c] * scale[c]))
}

/// Matrix for the primaries of sRGB and BT.709.
fn rgb_to_xyz() -> Matrix {
    primaries_to_xyz([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
}

/// Matrix for the primaries of BT.2020.
fn rec2020_to_xyz() -> Matrix {
    primaries_to_xyz([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]])
}

/// Linear BT.2020 RGB from XYZ. Components of a color outside the gamut are below 0 or above 1.
pub fn linear_rec2020_of_xyz(xyz: [f64; 3]) -> [f64; 3] {
    times(&inverse(&rec2020_to_xyz()), xyz)
}

/// XYZ from linear BT.2020 RGB.
pub fn xyz_of_linear_rec2020(rgb: [f64; 3]) -> [f64; 3] {
    times(&rec2020_to_xyz(), rgb)
}

/// Linear sRGB from XYZ. Components of a color outside the gamut are below 0 or above 1.
pub fn linear_srgb_of_xyz(xyz: [f64; 3]) -> [f64; 3] {
    times(&inverse(&rgb_to_xyz()), xyz)
}

/// XYZ from linear sRGB.
pub fn xyz_of_linear_srgb(rgb: [f64; 3]) -> [f64; 3] {
    times(&rgb_to_xyz(), rgb)
}

/// Transfer function of sRGB (IEC 61966-2-1), from linear [0, 1] to encoded [0, 1]; odd about 0.
pub fn srgb_encode(linear: f64) -> f64 {
    let v = linear.abs();
    (if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }).copysign(linear)
}

/// The inverse of [`srgb_encode`].
pub fn srgb_decode(encoded: f64) -> f64 {
    let v = encoded.abs();
    (if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }).copysign(encoded)
}

/// CIELAB (1976) from XYZ, with D65 as the white.
pub fn lab_of_xyz(xyz: [f64; 3]) -> [f64; 3] {
    lab_under(xyz, white_d65())
}

/// CIELAB (1976) from XYZ of the observer of 1964, with that observer's D65 as the white.
pub fn lab_of_xyz_10(xyz: [f64; 3]) -> [f64; 3] {
    lab_under(xyz, xyz_10_of_reflectance(|_| 1.0))
}

fn lab_under(xyz: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    let f: [f64; 3] = std::array::from_fn(|i| lab_root(xyz[i] / white[i]).0);
    [116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])]
}

/// CIELAB's cube root with its linear start, and its slope.
fn lab_root(t: f64) -> (f64, f64) {
    const KNEE: f64 = 6.0 / 29.0;
    if t > KNEE * KNEE * KNEE {
        let root = t.cbrt();
        (root, 1.0 / (3.0 * root * root))
    } else {
        let slope = 1.0 / (3.0 * KNEE * KNEE);
        (slope * t + 4.0 / 29.0, slope)
    }
}

/// Distance between two colors in CIELAB, Delta E of 1976; about 2 is visible.
pub fn delta_e(xyz: [f64; 3], other: [f64; 3]) -> f64 {
    let (a, b) = (lab_of_xyz(xyz), lab_of_xyz(other));
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chromaticity(xyz: [f64; 3]) -> [f64; 2] {
        let sum: f64 = xyz.iter().sum();
        [xyz[0] / sum, xyz[1] / sum]
    }

    /// Published values: the integrals of the color matching functions (CVRL: 106.857 each at 5 nm), the
    /// white points of E and D65, and the peak of V.
    #[test]
    fn tables_have_the_published_integrals_and_white_points() {
        for bar in [&X_BAR, &Y_BAR, &Z_BAR] {
            let integral = 5.0 * bar.iter().sum::<f64>();
            assert!((integral - 106.857).abs() < 2e-3, "{integral}");
        }
        assert_eq!(color_matching(0.555)[1], 1.0);
        assert_eq!(color_matching(0.36), [0.0; 3]);
        for bar in [&X10_BAR, &Y10_BAR, &Z10_BAR] {
            let integral = 5.0 * bar.iter().sum::<f64>();
            assert!((integral - 116.66).abs() < 0.02, "{integral}");
        }
        // The published value is from 360 to 830 nm; here the range is 380 to 780 nm.
        let d65_10 = chromaticity(xyz_10_of_reflectance(|_| 1.0));
        assert!((d65_10[0] - 0.313_82).abs() < 4e-5 && (d65_10[1] - 0.331_00).abs() < 4e-5, "{d65_10:?}");
        let e = chromaticity(xyz_of_light(|_| 1.0));
        assert!((e[0] - 1.0 / 3.0).abs() < 1e-5 && (e[1] - 1.0 / 3.0).abs() < 1e-5, "{e:?}");
        let d65 = chromaticity(white_d65());
        assert!((d65[0] - 0.312_72).abs() < 1e-5 && (d65[1] - 0.329_03).abs() < 1e-5, "{d65:?}");
        // Illuminant A is Planck's law at 2848 K with c2 = 0.01435 m K: (0.44758, 0.40745).
        let planck = |l: f64| l.powi(-5) / (14350.0 / (l * 2848.0)).exp_m1();
        let a = chromaticity(xyz_of_light(planck));
        assert!((a[0] - 0.447_58).abs() < 3e-4 && (a[1] - 0.407_45).abs() < 3e-4, "{a:?}");
    }

    /// The matrix is that of IEC 61966-2-1 up to the difference of its white; a round trip preserves the
    /// color; white is (1, 1, 1).
    #[test]
    fn srgb_there_and_back() {
        let printed = [
            [0.412_456_4, 0.357_576_1, 0.180_437_5],
            [0.212_672_9, 0.715_152_2, 0.072_175],
            [0.019_333_9, 0.119_192, 0.950_304_1],
        ];
        for (row, want) in rgb_to_xyz().iter().flatten().zip(printed.iter().flatten()) {
            assert!((row - want).abs() < 4e-4, "{row} {want}");
        }
        assert!(linear_srgb_of_xyz(white_d65()).iter().all(|v| (v - 1.0).abs() < 1e-12));
        for rgb in [[0.2, 0.5, 0.9], [1.0, 0.0, 0.0], [-0.1, 0.3, 1.4]] {
            let back = linear_srgb_of_xyz(xyz_of_linear_srgb(rgb));
            assert!((0..3).all(|i| (back[i] - rgb[i]).abs() < 1e-12), "{back:?}");
        }
        for i in -20..=30 {
            let v = f64::from(i) / 20.0;
            assert!((srgb_decode(srgb_encode(v)) - v).abs() < 1e-12);
        }
        // The two branches agree to the digits of the standard.
        assert!((srgb_encode(0.003_130_8) - srgb_encode(0.003_130_9)).abs() < 2e-6);
        assert!((srgb_encode(0.214_041_14) - 0.5).abs() < 1e-7);
        let gray = xyz_of_reflectance(|_| 0.18);
        assert!((lab_of_xyz(gray)[0] - 49.496).abs() < 1e-3, "{:?}", lab_of_xyz(gray));
        assert!((lab_of_xyz(gray)[1]).abs() < 1e-9 && delta_e(gray, gray) == 0.0);
    }

    /// A table is linear between nodes; values outside are clamped to an end and NaN becomes the first node.
    #[test]
    fn wavelengths_have_their_place() {
        assert_eq!((place(0.38), place(0.78)), ((0, 0.0), (79, 1.0)));
        assert_eq!((place(f64::NAN), place(-1.0), place(f64::INFINITY)), ((0, 0.0), (0, 0.0), (79, 1.0)));
        let (node, t) = place(0.5525);
        assert!(node == 34 && (t - 0.5).abs() < 1e-9);
    }
}
