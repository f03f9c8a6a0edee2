//! Nodes of a check's integrals over the sphere: cells of latitude and azimuth, subdivided until they resolve
//! every lobe.
//!
//! A lobe decreases as `exp(-(p^2 + q^2))`. For a round lobe, p and q are its disc coordinates times the
//! roots of its bandwidths. For a cone they are its azimuth, and its sine of the latitude relative to the
//! cone, times the roots. Closed forms bound the slopes of p and q within a cell. Before any evaluation they
//! therefore show whether a cell is dark or small relative to the lobe's standard deviation. Cells are
//! subdivided only along the ridges of a lobe, so their number grows as the inverse of the lobe's width, not
//! as its square, and is bounded by the bandwidths allowed in files.

use crate::reference::AnyLobe;
use plywave::Bsdf;
use plywave::frame::direction;
use plywave::ply::asg::Lobe;
use plywave::ply::cone::{ConeLobe, GRAZING};
use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

/// Latitude and azimuth bins of the chi-square test.
pub(crate) const BINS: [usize; 2] = [24, 48];

/// Points and weights of Gauss-Legendre quadrature with 3 points on [0, 1].
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
/// Maximum length of a panel, in standard deviations of the resolved feature.
const PANEL_SD: f64 = 1.5;
/// Minimum number of panels of a bin along latitude and azimuth.
const MIN_PANELS: usize = 3;
/// p^2 + q^2 from which a lobe is dark: the sharpest, of bandwidth 1e7, has 3e-7 per sr of its energy there.
const DARK: f64 = 30.0;
/// Number of nodes that are evaluated together.
const BATCH: usize = 4096;

/// A panel of latitudes and azimuths, by its center and half of its sides [rad].
#[derive(Clone, Copy)]
struct Cell {
    theta: f64,
    phi: f64,
    half: [f64; 2],
}

impl Cell {
    /// The two halves of the cell along an axis.
    fn cut(self, axis: usize) -> [Cell; 2] {
        let mut half = self.half;
        half[axis] *= 0.5;
        [-half[axis], half[axis]].map(|by| match axis {
            0 => Cell { theta: self.theta + by, half, ..self },
            _ => Cell { phi: self.phi + by, half, ..self },
        })
    }
}

/// p or q over a cell: its value at the center, and bounds on its slopes along latitude and azimuth within
/// the cell [1/rad].
struct Phase {
    middle: f64,
    slope: [f64; 2],
}

impl Phase {
    /// Minimum absolute value over a cell.
    fn min_abs(&self, half: [f64; 2]) -> f64 {
        (self.middle.abs() - self.slope[0] * half[0] - self.slope[1] * half[1]).max(0.0)
    }
}

/// A lobe that the cells must resolve.
pub(super) enum Feature {
    /// Axes x, y, z of a round lobe, and the roots of its bandwidths along x and y.
    Round { frame: [[f64; 3]; 3], roots: [f64; 2] },
    /// A cone for light of the latitude `theta_i` >= 0; `is_mirrored` for an incidence with theta_i < 0.
    Cone { lobe: ConeLobe, theta_i: f64, is_mirrored: bool },
}

impl Feature {
    /// A feature from a round lobe.
    pub(super) fn round(lobe: &Lobe) -> Feature {
        Feature::turned(lobe, lobe.frame())
    }

    fn turned(lobe: &Lobe, frame: [[f64; 3]; 3]) -> Feature {
        Feature::Round { frame, roots: [lobe.ln_mu1, lobe.ln_mu2].map(|ln_mu| (0.5 * ln_mu).exp()) }
    }

    /// A feature from a lobe of a mixture.
    pub(super) fn from_lobe(lobe: &AnyLobe, theta_i: f64, is_mirrored: bool) -> Feature {
        match lobe {
            AnyLobe::Cone(lobe) => Feature::Cone { lobe: *lobe, theta_i, is_mirrored },
            AnyLobe::Round(lobe) if is_mirrored => Feature::turned(lobe, lobe.frame().map(|[x, y, z]| [-x, y, -z])),
            AnyLobe::Round(lobe) => Feature::round(lobe),
        }
    }

    /// p and q over a cell; `None` if the lobe is 0 in all of it.
    fn phases(&self, cell: &Cell) -> Option<[Phase; 2]> {
        let [h_theta, h_phi] = cell.half;
        let (st, ct) = cell.theta.sin_cos();
        let max_cos = (cell.theta.abs() - h_theta).max(0.0).cos();
        match self {
            Feature::Round { frame, roots } => {
                let (sp, cp) = cell.phi.sin_cos();
                let dot = |a: &[f64; 3], v: [f64; 3]| a[0] * v[0] + a[1] * v[1] + a[2] * v[2];
                let (v, by_theta, by_phi) =
                    ([ct * cp, ct * sp, st], [-st * cp, -st * sp, ct], [-ct * sp, ct * cp, 0.0]);
                // The second derivative of v has a length of at most 1.
                let change = h_theta + h_phi;
                if dot(&frame[2], v) + change <= 0.0 {
                    return None;
                }
                Some([0, 1].map(|k| Phase {
                    middle: roots[k] * dot(&frame[k], v),
                    slope: [
                        roots[k] * (dot(&frame[k], by_theta).abs() + change).min(1.0),
                        roots[k] * (dot(&frame[k], by_phi).abs() + change).min(max_cos),
                    ],
                }))
            }
            Feature::Cone { lobe, theta_i, is_mirrored } => {
                let (s, phi) = if *is_mirrored { (-st, PI - cell.phi) } else { (st, cell.phi) };
                let x = phi - lobe.phi_z;
                let x = x - TAU * (x / TAU).round();
                let g = theta_i.cos().max(GRAZING);
                let (r1, r2) = ((0.5 * lobe.ln_mu1).exp(), (0.5 * lobe.ln_mu2).exp() / g);
                let s0 = (g * (lobe.offset + lobe.slope * x.sin()) - theta_i.sin()).clamp(-1.0, 1.0);
                let lean = g * lobe.slope.abs() * (x.cos().abs() + h_phi).min(1.0);
                Some([
                    Phase { middle: r1 * x, slope: [0.0, r1] },
                    Phase { middle: r2 * (s - s0), slope: [r2 * max_cos, r2 * lean] },
                ])
            }
        }
    }

    /// Sides of a cell relative to the longest that resolve the lobe, along latitude and azimuth; 0 if the
    /// lobe is dark in the cell.
    fn excess(&self, cell: &Cell) -> [f64; 2] {
        let Some(phases) = self.phases(cell) else { return [0.0; 2] };
        if phases.iter().map(|p| p.min_abs(cell.half).powi(2)).sum::<f64>() > DARK {
            return [0.0; 2];
        }
        [0, 1].map(|axis| {
            // exp(-(slope x)^2) has the standard deviation 1 / (sqrt 2 slope).
            let slope = phases[0].slope[axis].hypot(phases[1].slope[axis]);
            2.0 * cell.half[axis] * SQRT_2 * slope / PANEL_SD
        })
    }
}

/// Sums for the integrals over the sphere of eval, and over each bin of the pdf.
struct CellSums<'a, B, const N: usize> {
    of: &'a B,
    integral: [f64; N],
    bins: Vec<f64>,
    wo: Vec<[f32; 3]>,
    area: Vec<(f64, usize)>,
    f: Vec<[f32; N]>,
    pdf: Vec<f32>,
}

impl<B: Bsdf<N>, const N: usize> CellSums<'_, B, N> {
    /// Adds a cell of a bin, subdivided where `features` require it.
    fn add(&mut self, cell: Cell, bin: usize, features: &[Feature]) {
        let excess =
            features.iter().map(|f| f.excess(&cell)).fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        if excess[0].max(excess[1]) > 1.0 {
            for half in cell.cut(usize::from(excess[1] > excess[0])) {
                self.add(half, bin, features);
            }
            return;
        }
        let [h_theta, h_phi] = cell.half;
        for (x, w) in GAUSS {
            let theta = cell.theta + (2.0 * x - 1.0) * h_theta;
            let row = 4.0 * h_theta * h_phi * w * theta.cos();
            for (x, w) in GAUSS {
                let phi = cell.phi + (2.0 * x - 1.0) * h_phi;
                self.wo.push(direction(theta as f32, phi as f32));
                self.area.push((row * w, bin));
            }
        }
        if self.wo.len() >= BATCH {
            self.flush();
        }
    }

    /// Evaluates the collected nodes.
    fn flush(&mut self) {
        self.f.resize(self.wo.len(), [0.0; N]);
        self.pdf.resize(self.wo.len(), 0.0);
        self.of.eval_batch(&self.wo, &mut self.f, &mut self.pdf);
        for ((area, bin), (f, pdf)) in self.area.drain(..).zip(self.f.iter().zip(&self.pdf)) {
            (0..N).for_each(|k| self.integral[k] += area * f64::from(f[k]));
            self.bins[bin] += area * f64::from(*pdf);
        }
        self.wo.clear();
    }
}

/// Integrals of eval over the sphere and of the pdf over each bin, by panels of at most 1.5 standard
/// deviations of the finest features: `sd_rad` along latitude and azimuth everywhere, and those of `features`
/// where they are.
pub(super) fn integrate<const N: usize>(
    s: &impl Bsdf<N>,
    sd_rad: [f64; 2],
    features: &[Feature],
) -> ([f64; N], Vec<f64>) {
    let width = PI / BINS[0] as f64;
    let panels = sd_rad.map(|sd| ((width / (PANEL_SD * sd)).ceil() as usize).max(MIN_PANELS));
    let half = panels.map(|panels| 0.5 * width / panels as f64);
    let mut sums = CellSums {
        of: s,
        integral: [0.0; N],
        bins: vec![0.0; BINS[0] * BINS[1]],
        wo: Vec::with_capacity(BATCH + 9),
        area: Vec::with_capacity(BATCH + 9),
        f: Vec::new(),
        pdf: Vec::new(),
    };
    for row in 0..BINS[0] * panels[0] {
        for column in 0..BINS[1] * panels[1] {
            let theta = (2 * row + 1) as f64 * half[0] - FRAC_PI_2;
            let cell = Cell { theta, phi: (2 * column + 1) as f64 * half[1], half };
            sums.add(cell, (row / panels[0]) * BINS[1] + column / panels[1], features);
        }
    }
    sums.flush();
    (sums.integral, sums.bins)
}

#[cfg(test)]
mod tests {
    //! Closed forms: a lobe integrates to its energy, however narrow or long, with a bounded number of nodes.
    use super::*;
    use plywave::bsdf::{BsdfSample, Outcomes};
    use plywave::ply::EDGE_MU_MAX;
    use plywave::ply::asg::{MU_MAX, MU_MIN};
    use plywave::ply::cone::{CONE_MU_MIN, CONE_MU1_MAX, CONE_MU2_MAX};
    use std::cell::Cell as Count;

    /// One lobe, which counts its evaluations.
    struct Alone<'a> {
        lobe: AnyLobe,
        theta_i: f64,
        evaluations: &'a Count<usize>,
    }

    impl Bsdf<1> for Alone<'_> {
        fn eval(&self, w: [f32; 3]) -> [f32; 1] {
            self.evaluations.set(self.evaluations.get() + 1);
            let w = w.map(f64::from);
            let value = match &self.lobe {
                AnyLobe::Round(lobe) => lobe.eval(w),
                AnyLobe::Cone(lobe) => lobe.eval(self.theta_i, w),
            };
            [value as f32]
        }

        fn pdf(&self, w: [f32; 3]) -> f32 {
            self.eval(w)[0]
        }

        fn eval_pdf(&self, w: [f32; 3]) -> ([f32; 1], f32) {
            let value = self.eval(w);
            (value, value[0])
        }

        fn sample(&self, _: [f32; 3]) -> BsdfSample<1> {
            BsdfSample::Absorbed
        }

        fn albedo(&self) -> [f32; 1] {
            [1.0]
        }

        fn outcomes(&self) -> Outcomes {
            Outcomes::SCATTERED
        }
    }

    /// Error of the integral and of the sum of the bins, and the number of nodes.
    fn integral(lobe: AnyLobe, theta_i: f64) -> (f64, usize) {
        let evaluations = Count::new(0);
        let feature = Feature::from_lobe(&lobe, theta_i, false);
        let ([sum], bins) = integrate(&Alone { lobe, theta_i, evaluations: &evaluations }, [1.0; 2], &[feature]);
        ((sum - 1.0).abs().max((bins.iter().sum::<f64>() - 1.0).abs()), evaluations.get())
    }

    #[test]
    fn round_lobes_of_any_width_integrate_to_their_energy() {
        for (theta_z, phi_z, phi_xy) in [(0.0, 1.0, 0.0), (-0.9, 4.7124, 0.0), (0.6, 5.1, 0.7), (1.57, 2.0, 0.3)] {
            for mu1 in [MU_MIN, 30.0, MU_MAX, EDGE_MU_MAX] {
                for mu2 in [MU_MIN, 30.0, MU_MAX, EDGE_MU_MAX] {
                    let (ln_mu1, ln_mu2): (f64, f64) = (mu1.ln(), mu2.ln());
                    let lobe = Lobe { theta_z, phi_z, phi_xy, ln_mu1, ln_mu2, energy: 1.0 };
                    let (error, nodes) = integral(AnyLobe::Round(lobe), 0.0);
                    // The quadrature of the energy is itself accurate to 1e-4.
                    assert!(error < 4e-4, "{lobe:?}: off by {error} in {nodes} nodes");
                    assert!(nodes < 6_000_000, "{lobe:?}: {nodes} nodes");
                }
            }
        }
    }

    #[test]
    #[ignore = "slow: 25 s: cones of any width integrate to their energy"]
    fn cones_of_any_width_integrate_to_their_energy() {
        for theta_i in [0.0, 0.7, 1.55] {
            for (offset, slope) in [(0.0, 0.0), (0.3, -1.0), (-40.0, 0.0), (0.0, 40.0)] {
                for (mu1, mu2) in
                    [(CONE_MU_MIN, CONE_MU2_MAX), (CONE_MU1_MAX, CONE_MU2_MAX), (CONE_MU1_MAX, CONE_MU_MIN), (1.0, 1.0)]
                {
                    let (ln_mu1, ln_mu2): (f64, f64) = (mu1.ln(), mu2.ln());
                    let lobe = ConeLobe { offset, phi_z: 2.0, slope, ln_mu1, ln_mu2, energy: 1.0 };
                    let (error, nodes) = integral(AnyLobe::Cone(lobe), theta_i);
                    assert!(error < 1e-3, "{lobe:?} at {theta_i}: off by {error} in {nodes} nodes");
                    assert!(nodes < 30_000_000, "{lobe:?} at {theta_i}: {nodes} nodes");
                }
            }
        }
    }
}
