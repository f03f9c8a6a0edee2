//! Fits edge lobes (Yu 2025, 6.1): one lobe for each (wavelength, e = R - |h|), fitted to the far field of a
//! beam that the half plane x > e cuts off.
//!
//! The aperture is `[e, d_cut] x [-d_cut, d_cut]` (Eq. 17), with the beam's center at the origin and normal
//! incidence. Pattern and lobe have equal energy, and the two bandwidths minimize their squared distance over
//! the hemisphere. At e = d_cut the aperture is closed; the node there is the limit of a narrow slit.
//!
//! The same bandwidths hold for tilted light: tilting changes nothing across the ply, and along it the longer
//! cross section of the tilted beam compensates for the foreshortened plane (test:
//! `lobes_hold_for_tilted_light`).

use crate::optimize::minimize::{MinimizeOptions, minimize_bounded};
use plywave::math::faddeeva::diffraction_factor;
use plywave::ply::asg::{MU_MIN, unit_energy_gradient};
use plywave::ply::{EDGE_MU_MAX, EdgeLobes, beam_mu};
use plywave::spec::{GaussianBeam, YarnSpec};
use std::f64::consts::FRAC_PI_2;

/// Axes of the table of edge lobes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeOptions {
    /// First and last wavelength [um].
    pub lambda_um: [f64; 2],
    /// Number of wavelengths, at least 2.
    pub lambdas: usize,
    /// Number of values of e from -d_cut to d_cut, at least 2.
    pub insides: usize,
}

impl Default for EdgeOptions {
    /// Visible light in steps of 0.05 um and e in steps of a sixteenth of d_cut: interpolation then adds less
    /// error than the lobe's own misfit.
    fn default() -> Self {
        EdgeOptions { lambda_um: [0.38, 0.78], lambdas: 9, insides: 33 }
    }
}

/// Lobes and their errors against the diffraction integral.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgeFit {
    /// The edge lobes for a model.
    pub lobes: EdgeLobes,
    /// `[L][E]`: relative L2 distance of the lobe from the integral, at equal energy.
    pub error: Vec<f64>,
}

/// Fits the edge lobes of a yarn's ply and beam.
pub fn fit_edge(spec: &YarnSpec, options: &EdgeOptions) -> EdgeFit {
    let [a, b] = spec.ply_radii_um();
    fit_edge_lobes(&spec.beam.beam(), a.max(b), options)
}

/// Fits the edge lobes of a ply with radius R [um] in a beam.
pub fn fit_edge_lobes(beam: &GaussianBeam, radius_um: f64, options: &EdgeOptions) -> EdgeFit {
    let axis = |low: f64, high: f64, n: usize| -> Vec<f64> {
        let n = n.max(2);
        (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect()
    };
    let lambda_um = axis(options.lambda_um[0], options.lambda_um[1], options.lambdas);
    let inside_um = axis(-beam.d_cut_um, beam.d_cut_um, options.insides);
    let (mut ln_mu, mut error) = (Vec::new(), Vec::new());
    for lambda in &lambda_um {
        let hemisphere = Hemisphere::new(beam, *lambda);
        // Each fit starts from the neighbor's bandwidths, the first from those of the uncut beam.
        let mut start = [beam_mu(beam.w0_um, *lambda).ln(); 2];
        for inside in &inside_um {
            let pattern = hemisphere.pattern(*inside);
            let (found, misfit) = hemisphere.fit(&pattern, start);
            ln_mu.extend(found);
            error.push(misfit);
            start = found;
        }
    }
    EdgeFit { lobes: EdgeLobes { radius_um, lambda_um, inside_um, ln_mu }, error }
}

/// Relative L2 distance of a lobe of these bandwidths from the integral at e = `inside_um`, both of energy 1.
pub fn edge_error(beam: &GaussianBeam, lambda_um: f64, inside_um: f64, ln_mu: [f64; 2]) -> f64 {
    let hemisphere = Hemisphere::new(beam, lambda_um);
    let pattern = hemisphere.pattern(inside_um);
    hemisphere.cost(&pattern, ln_mu, &mut [0.0; 2]).sqrt()
}

/// Smallest width [um] of an aperture, for the node at which it is closed.
const MIN_WIDTH_UM: f64 = 1e-3;

/// A quarter of the forward hemisphere (pattern and lobe are even in u and w), in the variables u and psi,
/// the angle about x, whose area element is that of the sphere. Nodes are [u^2, w^2, cosine, area].
struct Hemisphere<'a> {
    beam: &'a GaussianBeam,
    lambda_um: f64,
    rows: Vec<(f64, Vec<[f64; 4]>)>,
    /// Factor of the pattern along the ply, and cosines at the nodes.
    along: Vec<Vec<f64>>,
}

/// A pattern at the nodes, normalized to energy 1, and the integral of its square.
struct Pattern {
    value: Vec<Vec<f64>>,
    norm2: f64,
}

/// Nodes and weights on [0, `end`]: 3-point Gauss panels of width `step`, growing with the distance from 0.
fn panels(step: f64, end: f64) -> Vec<(f64, f64)> {
    const GAUSS: [(f64, f64); 3] =
        [(0.112_701_665_379_258_31, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
    let mut nodes = Vec::new();
    let mut low = 0.0;
    while low < end {
        let high = (low + step.max(0.08 * low)).min(end);
        nodes.extend(GAUSS.map(|(x, w)| (low + x * (high - low), w * (high - low))));
        low = high;
    }
    nodes
}

fn square([re, im]: [f64; 2]) -> f64 {
    re * re + im * im
}

impl<'a> Hemisphere<'a> {
    fn new(beam: &'a GaussianBeam, lambda_um: f64) -> Self {
        // The panels are half a standard deviation of the uncut beam wide.
        let step = 0.5 / (2.0 * beam_mu(beam.w0_um, lambda_um)).sqrt();
        let columns = panels(step, FRAC_PI_2);
        let (d, w0) = (beam.d_cut_um, beam.w0_um);
        let (mut rows, mut along) = (Vec::new(), Vec::new());
        for (u, du) in panels(step, 1.0) {
            let reach = (1.0 - u * u).sqrt();
            let mut row = Vec::with_capacity(columns.len());
            let mut factors = Vec::with_capacity(columns.len());
            for (psi, dpsi) in &columns {
                let (w, c) = (reach * psi.sin(), reach * psi.cos());
                row.push([u * u, w * w, c, 4.0 * du * dpsi]);
                factors.push((1.0 + c).powi(2) * square(diffraction_factor(-d, d, w / lambda_um, w0)));
            }
            rows.push((u, row));
            along.push(factors);
        }
        Hemisphere { beam, lambda_um, rows, along }
    }

    fn pattern(&self, inside_um: f64) -> Pattern {
        let (d, w0) = (self.beam.d_cut_um, self.beam.w0_um);
        let low = inside_um.min(d - MIN_WIDTH_UM);
        let (mut energy, mut norm2) = (0.0, 0.0);
        let mut value: Vec<Vec<f64>> = Vec::with_capacity(self.rows.len());
        for ((u, row), along) in self.rows.iter().zip(&self.along) {
            let across = square(diffraction_factor(low, d, u / self.lambda_um, w0));
            let line: Vec<f64> = along.iter().map(|a| a * across).collect();
            for (v, node) in line.iter().zip(row) {
                energy += v * node[3];
                norm2 += v * v * node[3];
            }
            value.push(line);
        }
        value.iter_mut().flatten().for_each(|v| *v /= energy);
        Pattern { value, norm2: norm2 / (energy * energy) }
    }

    /// Squared relative distance of the lobe from the pattern, and its gradient.
    fn cost(&self, pattern: &Pattern, ln_mu: [f64; 2], gradient: &mut [f64]) -> f64 {
        let mu = ln_mu.map(f64::exp);
        let (unit, d1, d2) = unit_energy_gradient(mu[0], mu[1]);
        let (mut cost, mut g) = (0.0, [0.0; 2]);
        for ((_, row), line) in self.rows.iter().zip(&pattern.value) {
            // All nodes of a row share one factor of the exponential.
            let across = (-mu[0] * row[0][0]).exp() / unit;
            for ([u2, w2, c, area], v) in row.iter().zip(line) {
                let lobe = across * (-mu[1] * w2).exp() * c;
                let excess = lobe - v;
                cost += area * excess * excess;
                let slope = 2.0 * area * excess * lobe;
                g[0] -= slope * (d1 + mu[0] * u2);
                g[1] -= slope * (d2 + mu[1] * w2);
            }
        }
        gradient[0] = g[0] / pattern.norm2;
        gradient[1] = g[1] / pattern.norm2;
        cost / pattern.norm2
    }

    /// Best bandwidths, found from `start`, and the relative distance.
    fn fit(&self, pattern: &Pattern, start: [f64; 2]) -> ([f64; 2], f64) {
        let options = MinimizeOptions { iterations: 60, tolerance: 1e-9, memory: 5 };
        let (low, high) = ([MU_MIN.ln(); 2], [EDGE_MU_MAX.ln(); 2]);
        let best = minimize_bounded(&start, &low, &high, options, |x, g| self.cost(pattern, [x[0], x[1]], g));
        ([best.x[0], best.x[1]], best.cost.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEAM: GaussianBeam = GaussianBeam { w0_um: 10.0, lambda_um: 0.55, d_cut_um: 20.0 };

    #[test]
    fn gradient_matches_differences() {
        let hemisphere = Hemisphere::new(&BEAM, 0.6);
        let pattern = hemisphere.pattern(4.0);
        let x = [7.0, 8.3];
        let mut g = [0.0; 2];
        hemisphere.cost(&pattern, x, &mut g);
        for k in 0..2 {
            let h = 1e-5;
            let at = |s: f64| {
                let mut y = x;
                y[k] += s * h;
                hemisphere.cost(&pattern, y, &mut [0.0; 2])
            };
            let want = (at(1.0) - at(-1.0)) / (2.0 * h);
            assert!((g[k] - want).abs() < 1e-6 * want.abs().max(1e-3), "{k}: got {}, want {want}", g[k]);
        }
    }

    /// A beam far from the ply keeps its own divergence; a beam cut at its center spreads across the ply and
    /// not along it.
    #[test]
    fn uncut_beam_keeps_its_divergence() {
        let options = EdgeOptions { lambda_um: [0.45, 0.65], lambdas: 2, insides: 3 };
        let fit = fit_edge_lobes(&BEAM, 90.0, &options);
        for (l, lambda) in fit.lobes.lambda_um.iter().enumerate() {
            let node = |e: usize| [fit.lobes.ln_mu[(l * 3 + e) * 2], fit.lobes.ln_mu[(l * 3 + e) * 2 + 1]];
            let beam = beam_mu(BEAM.w0_um, *lambda).ln();
            let [open1, open2] = node(0);
            // The cut at 2 w0 removes the edge of the field, which widens the lobe a little.
            assert!((open1 - beam).abs() < 0.05 && (open2 - beam).abs() < 0.05, "{open1} {open2} {beam}");
            assert!(fit.error[l * 3] < 0.05, "{}", fit.error[l * 3]);
            let [half1, half2] = node(1);
            // Energy that the lobe cannot represent in the tails across the ply broadens it along the ply
            // too, by 6 %.
            assert!(half1 < beam - 0.5 && (half2 - beam).abs() < 0.2, "{half1} {half2} {beam}");
            assert!(node(2)[0] < 3.0, "a slit of no width spreads over all angles: {}", node(2)[0]);
        }
    }

    /// Relative L2 distance of the lobe from the integral for light at latitude `tilt`, whose cross section
    /// along the ply is longer by 1/cos(tilt).
    fn tilted_error(lobe: &plywave::ply::asg::Lobe, lambda: f64, inside: f64, tilt: f64) -> f64 {
        let (s, c) = tilt.sin_cos();
        let (d, w0) = (BEAM.d_cut_um, BEAM.w0_um);
        let lobe = plywave::ply::asg::Lobe { theta_z: -tilt, ..*lobe };
        let step = 0.5 / (2.0 * beam_mu(w0, lambda)).sqrt();
        let (mut power, mut energy, mut both, mut lobes) = (0.0, 0.0, 0.0, 0.0);
        for (u, du) in panels(step, 1.0) {
            let across = square(diffraction_factor(inside, d, u / lambda, w0));
            let reach = (1.0 - u * u).sqrt();
            for (psi, dpsi) in panels(step, FRAC_PI_2).into_iter().flat_map(|(p, w)| [(p, w), (-p, w)]) {
                let (w, z) = (reach * psi.sin(), reach * psi.cos());
                let wo = [u, -s * w - c * z, c * w - s * z];
                if wo[1] < 0.0 {
                    let along = square(diffraction_factor(-d / c, d / c, (s + wo[2]) / lambda, w0 / c));
                    let (f, g, area) = ((c - wo[1]).powi(2) * across * along, lobe.eval(wo), 2.0 * du * dpsi);
                    energy += area * f;
                    power += area * f * f;
                    both += area * f * g;
                    lobes += area * g * g;
                }
            }
        }
        ((lobes - 2.0 * both / energy + power / (energy * energy)) * energy * energy / power).sqrt()
    }

    #[test]
    fn lobes_hold_for_tilted_light() {
        let fit = fit_edge_lobes(&BEAM, 90.0, &EdgeOptions { lambda_um: [0.5, 0.6], lambdas: 2, insides: 9 });
        for inside in [-20.0, -5.0, 0.0, 10.0] {
            let lobe = fit.lobes.lobe(0.0, 90.0 - inside, 0.5);
            let straight = edge_error(&BEAM, 0.5, inside, [lobe.ln_mu1, lobe.ln_mu2]);
            for tilt in [0.0, 0.5, 1.0] {
                let tilted = tilted_error(&lobe, 0.5, inside, tilt);
                println!("e {inside}, tilt {tilt}: {tilted:.4}, straight {straight:.4}");
                assert!((tilted - straight).abs() < 0.01, "e {inside}, tilt {tilt}: {tilted}, straight {straight}");
            }
        }
    }

    /// Interpolated bandwidths are as accurate as fitted ones.
    #[test]
    fn interpolation_adds_little() {
        let fit = fit_edge_lobes(&BEAM, 90.0, &EdgeOptions::default());
        let (n, mut worst) = (fit.lobes.inside_um.len(), 0.0f64);
        for (lambda, e) in [(0.43, 4), (0.55, 12), (0.61, 16), (0.7, 22), (0.4, 28)] {
            let inside = 0.5 * (fit.lobes.inside_um[e] + fit.lobes.inside_um[e + 1]);
            let lobe = fit.lobes.lobe(0.0, 90.0 - inside, lambda);
            let got = edge_error(&BEAM, lambda, inside, [lobe.ln_mu1, lobe.ln_mu2]);
            let hemisphere = Hemisphere::new(&BEAM, lambda);
            let best = hemisphere.fit(&hemisphere.pattern(inside), [lobe.ln_mu1, lobe.ln_mu2]).1;
            worst = worst.max(got - best);
            assert!(got < best + 0.01, "lambda {lambda}, e {inside}: {got}, at best {best}");
        }
        println!("interpolation adds at most {worst:.4}");
        for (l, lambda) in fit.lobes.lambda_um.iter().enumerate() {
            let row: Vec<String> = fit.error[l * n..(l + 1) * n].iter().step_by(4).map(|e| format!("{e:.3}")).collect();
            println!("lambda {lambda:.2}: {}", row.join(" "));
        }
    }
}
