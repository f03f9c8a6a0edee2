//! Plane waves as cylindrical waves about a center, and Fourier series on the azimuth grid.

use crate::{C64, PlaneWave};
use std::f64::consts::{PI, TAU};

/// Multiplications by a phase factor before the phase is computed again, which keeps it to 1e-14.
const REFRESH: usize = 32;

/// Amplitudes p_n, n = -top..=top, of
/// `sum_m A_m exp(-i k_rho x . u_m) = sum_n p_n J_n(k_rho rho) exp(i n phi)` about `center_um`.
///
/// `p_n = sum_m A_m exp(-i k_rho center . u_m) (-i)^n exp(-i n phi_m)`, where u_m is the unit vector at the
/// azimuth that the wave comes from (DLMF 10.12.1).
pub(crate) fn incident(waves: &[PlaneWave], k_rho: f64, center_um: [f64; 2], top: usize) -> Vec<C64> {
    let mut p = vec![C64::new(0.0, 0.0); 2 * top + 1];
    for w in waves {
        let (sin, cos) = w.phi_i.sin_cos();
        let at_center = w.amplitude * C64::from_polar(1.0, -k_rho * (center_um[0] * cos + center_um[1] * sin));
        let angle = -w.phi_i - 0.5 * PI;
        let step = C64::from_polar(1.0, angle);
        for (start, chunk) in p.chunks_mut(REFRESH).enumerate() {
            let n = (start * REFRESH) as f64 - top as f64;
            let mut term = at_center * C64::from_polar(1.0, n * angle);
            for value in chunk {
                *value += term;
                term *= step;
            }
        }
    }
    p
}

/// The series `sum_n c_n exp(i n phi_j)`, n = -top..=top, at `phi_j = 2 pi j / size`.
pub(crate) struct AzimuthGrid {
    roots: Vec<C64>,
}

impl AzimuthGrid {
    pub fn new(size: usize) -> Self {
        Self { roots: (0..size).map(|j| C64::from_polar(1.0, TAU * j as f64 / size as f64)).collect() }
    }

    /// Azimuth j as `[cos, sin]`.
    pub fn direction(&self, j: usize) -> [f64; 2] {
        [self.roots[j].re, self.roots[j].im]
    }

    pub fn sum(&self, coeffs: &[C64]) -> Vec<C64> {
        let size = self.roots.len();
        let top = (coeffs.len() / 2) as i64;
        // Orders that agree modulo the grid's size alias.
        let mut folded = vec![C64::new(0.0, 0.0); size];
        for (i, c) in coeffs.iter().enumerate() {
            folded[(i as i64 - top).rem_euclid(size as i64) as usize] += c;
        }
        let mut out = vec![C64::new(0.0, 0.0); size];
        for (n, c) in folded.into_iter().enumerate().filter(|(_, c)| *c != C64::new(0.0, 0.0)) {
            let mut at = 0;
            for value in &mut out {
                *value += c * self.roots[at];
                at += n;
                if at >= size {
                    at -= size;
                }
            }
        }
        out
    }
}

/// (-i)^n.
pub(crate) fn minus_i_power(n: i64) -> C64 {
    [C64::new(1.0, 0.0), C64::new(0.0, -1.0), C64::new(-1.0, 0.0), C64::new(0.0, 1.0)][n.rem_euclid(4) as usize]
}
