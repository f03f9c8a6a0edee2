//! Primaries and white of a picture's colors, and the matrix from them to linear sRGB.
//!
//! The conversion goes through CIE XYZ. If the whites differ, Bradford's matrix adapts one to the other, so
//! that the picture's white and all its grays stay gray (Lindbloom, "Chromatic Adaptation"; ICC.1:2022, annex
//! E). Values that are CIE XYZ already, with the primaries and white of XYZ, are colorimetric: the gray of
//! D65 is gray in them, so they are not adapted.

use glam::{DMat3, DVec3};

/// Largest difference of chromaticities that counts as rounding.
const ROUNDING: f64 = 0.002;
/// Smallest determinant of primaries and smallest y of a white that count as nondegenerate.
const MIN: f64 = 1e-4;

/// Weights of red, green and blue in the luminance of linear sRGB, with the digits of ITU-R BT.709.
const BT_709_LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Bradford's matrix from XYZ to cone responses.
const BRADFORD: DMat3 = DMat3::from_cols(
    DVec3::new(0.8951, -0.7502, 0.0389),
    DVec3::new(0.2664, 1.7135, -0.0685),
    DVec3::new(-0.1614, 0.0367, 1.0296),
);

/// Chromaticities x, y of red, green, blue and white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Primaries(pub [[f64; 2]; 4]);

impl Primaries {
    /// Primaries of linear sRGB (ITU-R BT.709, D65).
    pub const SRGB: Primaries = Primaries([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]]);

    /// Whether the primaries are those of sRGB up to rounding.
    pub fn is_srgb(&self) -> bool {
        let pairs = self.0.iter().flatten().zip(Primaries::SRGB.0.iter().flatten());
        pairs.into_iter().all(|(a, b)| (a - b).abs() < ROUNDING)
    }

    /// XYZ of the white at luminance 1.
    fn white(&self) -> Option<DVec3> {
        let [x, y] = self.0[3];
        let white = DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        (y > MIN && white.is_finite()).then_some(white)
    }

    /// Matrix to XYZ; `None` for primaries on one line and for a white that they cannot mix.
    fn to_xyz(self) -> Option<DMat3> {
        let [red, green, blue] = [0, 1, 2].map(|k| {
            let [x, y] = self.0[k];
            DVec3::new(x, y, 1.0 - x - y)
        });
        let plain = DMat3::from_cols(red, green, blue);
        if !plain.is_finite() || plain.determinant().abs() < MIN {
            return None;
        }
        let shares = plain.inverse() * self.white()?;
        (shares.min_element() > 0.0 && shares.is_finite()).then(|| plain * DMat3::from_diagonal(shares))
    }

    /// Matrix to linear sRGB; `None` under the conditions of [`Primaries::luminance`] and for a degenerate
    /// white.
    pub fn to_srgb(self) -> Option<DMat3> {
        let (from, to) = (self.to_xyz()?, Primaries::SRGB.to_xyz()?.inverse());
        if from.abs_diff_eq(DMat3::IDENTITY, ROUNDING) {
            return Some(to * from);
        }
        let cones = BRADFORD * self.white()?;
        let scale = DMat3::from_diagonal(BRADFORD * Primaries::SRGB.white()? / cones);
        (cones.min_element() > 0.0).then(|| to * BRADFORD.inverse() * scale * BRADFORD * from)
    }

    /// Weights of red, green and blue in the luminance; `None` for primaries on one line and for a white that
    /// they cannot mix.
    pub fn luminance(self) -> Option<DVec3> {
        if self.is_srgb() {
            return Some(BT_709_LUMINANCE);
        }
        self.to_xyz().map(|m| m.row(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ITU-R BT.2020 with D65, ACES AP1 and AP0 with their white, CIE XYZ with the even spectrum.
    const BT_2020: Primaries = Primaries([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], [0.3127, 0.3290]]);
    const AP1: Primaries = Primaries([[0.713, 0.293], [0.165, 0.830], [0.128, 0.044], [0.32168, 0.33767]]);
    const AP0: Primaries = Primaries([[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]]);
    const XYZ: Primaries = Primaries([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]]);

    /// The matrices agree with published ones: ITU-R BT.2087 (from BT.2020), and the ACES transforms to Rec.
    /// 709 with Bradford's adaptation.
    #[test]
    fn matrices_are_the_published_ones() {
        for (primaries, rows) in [
            (BT_2020, [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]),
            (AP1, [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]),
            (AP0, [[2.52169, -1.13413, -0.38756], [-0.27648, 1.37272, -0.09624], [-0.01538, -0.15298, 1.16835]]),
        ] {
            let got = primaries.to_srgb().unwrap();
            for (k, row) in rows.into_iter().enumerate() {
                assert!((got.row(k) - DVec3::from(row)).abs().max_element() < 2e-4, "{primaries:?}: {got}");
            }
        }
    }

    #[test]
    fn grays_stay_gray() {
        let radiance = Primaries([[0.640, 0.330], [0.290, 0.600], [0.150, 0.060], [1.0 / 3.0, 1.0 / 3.0]]);
        for primaries in [BT_2020, AP1, AP0, radiance, Primaries::SRGB] {
            let gray = primaries.to_srgb().unwrap() * DVec3::splat(0.5);
            assert!((gray - 0.5).abs().max_element() < 1e-12, "{primaries:?}: {gray}");
        }
        // The XYZ of D65 (CIE 15) is gray in the primaries of XYZ.
        let gray = XYZ.to_srgb().unwrap() * (0.5 * DVec3::new(0.95047, 1.0, 1.08883));
        assert!((gray - 0.5).abs().max_element() < 2e-4, "{gray}");
        assert!((Primaries::SRGB.to_xyz().unwrap().row(1) - BT_709_LUMINANCE).abs().max_element() < 5e-5);
        assert!((XYZ.luminance().unwrap() - DVec3::Y).length() < 1e-12);
        assert!(Primaries::SRGB.is_srgb() && !radiance.is_srgb() && !AP1.is_srgb());
    }

    #[test]
    fn what_makes_no_colors_is_refused() {
        let with = |k: usize, place: [f64; 2]| {
            let mut list = Primaries::SRGB.0;
            list[k] = place;
            Primaries(list)
        };
        let line = Primaries([[0.1, 0.1], [0.2, 0.2], [0.4, 0.4], [0.3, 0.3]]);
        for bad in [line, with(3, [0.3, 0.0]), with(3, [0.7, 0.2]), with(0, [f64::NAN, 0.3]), with(3, [1e300, 1e-3])] {
            assert_eq!(bad.to_srgb(), None, "{bad:?}");
        }
    }
}
