//! Wavelengths of a path, and the color of its light.
//!
//! Wavelengths are sampled in proportion to the XYZ response under the illuminant, because wavelengths at
//! the ends of the range contribute little (Radziszewski et al., "An Improved Technique for Full Spectral
//! Rendering", WSCG 2009).

use crate::WAVELENGTHS;
use plywave::color;
use std::sync::OnceLock;

/// Wavelengths of a picture [um].
pub const LAMBDA_RANGE_UM: [f32; 2] = [0.38, 0.78];
/// Number of nodes of the wavelength distribution, one per nanometer.
const NODES: usize = 401;
/// Fraction of wavelengths that are sampled uniformly.
const EVEN: f64 = 0.1;

/// A value at each wavelength of a path.
pub(crate) type Light4 = [f32; WAVELENGTHS];

/// Cumulative distribution of wavelengths at the nodes, linear between them.
fn shares() -> &'static [f32; NODES] {
    static SHARES: OnceLock<[f32; NODES]> = OnceLock::new();
    SHARES.get_or_init(|| {
        let [low, high] = LAMBDA_RANGE_UM.map(f64::from);
        let response =
            |at: f64| color::d65_xyz_density(low + (high - low) * at / (NODES - 1) as f64).iter().sum::<f64>();
        let mut sums = [0.0f64; NODES];
        for node in 1..NODES {
            sums[node] = sums[node - 1] + response(node as f64 - 0.5).max(0.0);
        }
        let all = sums[NODES - 1];
        let below = |node: usize| EVEN * node as f64 / (NODES - 1) as f64 + (1.0 - EVEN) * sums[node] / all;
        std::array::from_fn(|node| below(node) as f32)
    })
}

/// The wavelength [um] at which the cumulative distribution of wavelengths is `share`.
pub(crate) fn lambda_at(share: f32) -> f32 {
    let below = shares();
    let node = below.partition_point(|b| *b <= share).clamp(1, NODES - 1);
    let part = ((share - below[node - 1]) / (below[node] - below[node - 1])).clamp(0.0, 1.0);
    let [low, high] = LAMBDA_RANGE_UM;
    low + (high - low) * ((node - 1) as f32 + part) / (NODES - 1) as f32
}

/// The cumulative distribution of wavelengths and its density [1/um] at a wavelength.
pub(crate) fn share_below(lambda_um: f32) -> (f32, f32) {
    let (below, [low, high]) = (shares(), LAMBDA_RANGE_UM);
    let at = ((lambda_um - low) / (high - low)).clamp(0.0, 1.0) * (NODES - 1) as f32;
    let node = (at as usize).min(NODES - 2);
    let rise = below[node + 1] - below[node];
    (below[node] + (at - node as f32) * rise, rise * (NODES - 1) as f32 / (high - low))
}

/// XYZ of light whose spectrum is the illuminant's times `values`, given at wavelengths that were sampled by
/// [`lambda_at`].
pub(crate) fn xyz<const N: usize>(lambda_um: [f32; N], values: [f32; N]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for k in 0..N {
        let matching = color::d65_xyz_density(f64::from(lambda_um[k]));
        let scale = values[k] / (N as f32 * share_below(lambda_um[k]).1);
        for c in 0..3 {
            sum[c] += scale * matching[c] as f32;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The distribution and its inverse agree, and a value of 1 at uniformly drawn shares gives white.
    #[test]
    fn wavelengths_are_drawn_by_their_density() {
        let (mut sum, n) = ([0.0f64; 3], 40_000);
        for i in 0..n {
            let share = (i as f32 + 0.5) / n as f32;
            let lambda = lambda_at(share);
            let (back, density) = share_below(lambda);
            assert!((back - share).abs() < 1e-5 && density > 0.2, "{lambda}: {share} {back} {density}");
            let of = xyz([lambda], [1.0]);
            (0..3).for_each(|c| sum[c] += f64::from(of[c]) / f64::from(n));
        }
        let white = color::linear_srgb_of_xyz(sum);
        assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-3), "{white:?}");
        assert_eq!([lambda_at(0.0), lambda_at(1.0)], LAMBDA_RANGE_UM);
    }
}
