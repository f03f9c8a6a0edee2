//! Absorption of undyed fibers in the visible.
//!
//! Reflectances of thick layers become K/S by Kubelka and Munk, and K/S becomes the absorption of the fiber
//! by what a thick pile of our own cloths has (`studies`, `measured -- thick`: 0.0046 per um for cotton,
//! 0.003 for wool, 0.0044 for silk, within a tenth up to K/S of 0.2). Between the wavelengths of the table
//! the logarithm is linear; beyond its ends it is constant towards the infrared and goes on towards the
//! ultraviolet.
//!
//! - Cellulose: cellulose powder, 0.891, 0.942, 0.960 and 0.964 at 450, 550, 650 and 850 nm (USGS splib07a,
//!   public domain). It is a lower bound: raw cotton and flax, not bleached, are yellower.
//! - Wool: an assumption about scoured merino, Y 65 and Y - Z 8 (D65, 10 degrees), as reflectances of 0.53,
//!   0.65 and 0.72; no spectrum is at hand.
//! - Silk: no spectrum is at hand. Degummed silk is yellower than cellulose and whiter than wool; its K/S is
//!   the geometric mean of these bounds, which are a factor of 5 to 8 away.

use serde::{Deserialize, Serialize};

/// Material of an undyed fiber.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Undyed {
    /// Cotton, flax, viscose and lyocell.
    Cellulose,
    /// Wool and hair.
    Wool,
    /// Silk.
    Silk,
}

/// Wavelengths [um] with K/S of cellulose and of wool.
const K_OVER_S: [[f64; 3]; 4] =
    [[0.45, 0.0067, 0.208], [0.55, 0.0018, 0.094], [0.65, 0.000_83, 0.054], [0.85, 0.000_67, 0.05]];

impl Undyed {
    /// Absorption of the fiber [1/um] at a wavelength [um].
    pub fn sigma_per_um(self, lambda_um: f64) -> f64 {
        let node = K_OVER_S[1..3].partition_point(|node| node[0] <= lambda_um);
        let ([from, a, b], [to, c, d]) = (K_OVER_S[node], K_OVER_S[node + 1]);
        let place = ((lambda_um - from) / (to - from)).min(1.0);
        let [cellulose, wool] = [a * (c / a).powf(place), b * (d / b).powf(place)];
        match self {
            Undyed::Cellulose => 0.0046 * cellulose,
            Undyed::Wool => 0.003 * wool,
            Undyed::Silk => 0.0044 * (cellulose * wool).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The spectra fall from blue to red, go through the table and are ordered.
    #[test]
    fn undyed_fibers_are_yellowish() {
        for node in K_OVER_S {
            assert!((Undyed::Cellulose.sigma_per_um(node[0]) / (0.0046 * node[1]) - 1.0).abs() < 1e-12);
            assert!((Undyed::Wool.sigma_per_um(node[0]) / (0.003 * node[2]) - 1.0).abs() < 1e-12);
        }
        for i in 0..100 {
            let lambda_um = 0.38 + 0.004 * f64::from(i);
            let all = [Undyed::Cellulose, Undyed::Silk, Undyed::Wool].map(|of| of.sigma_per_um(lambda_um));
            assert!(all[0] < all[1] && all[1] < all[2], "{lambda_um}: {all:?}");
            for of in [Undyed::Cellulose, Undyed::Silk, Undyed::Wool] {
                assert!(of.sigma_per_um(lambda_um) > of.sigma_per_um(lambda_um + 0.004), "{lambda_um}");
            }
        }
    }
}
