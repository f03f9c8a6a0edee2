//! Wavelengths of a path, and the color of its light.

use crate::WAVELENGTHS;
use plywave::color;

/// Wavelengths of a picture [um].
pub const LAMBDA_RANGE_UM: [f32; 2] = [0.38, 0.78];

/// A value at each wavelength of a path.
pub(crate) type Light4 = [f32; WAVELENGTHS];

/// XYZ of light that has the illuminant's spectrum times `values` at the wavelengths of a path, drawn evenly
/// over the picture's range.
pub(crate) fn xyz<const N: usize>(lambda_um: [f32; N], values: [f32; N]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let scale = (LAMBDA_RANGE_UM[1] - LAMBDA_RANGE_UM[0]) / N.max(1) as f32;
    for k in 0..N {
        let matching = color::d65_xyz_density(f64::from(lambda_um[k]));
        for c in 0..3 {
            sum[c] += scale * values[k] * matching[c] as f32;
        }
    }
    sum
}
