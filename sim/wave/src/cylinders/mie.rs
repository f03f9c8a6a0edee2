//! Scattering by one circular cylinder, plain or of concentric layers, at oblique incidence: the closed form
//! that every other solver is compared with.
//!
//! Each order is a separate 2x2 problem (Bohren and Huffman 1983, chapter 8, for the plain cylinder); layers
//! by the recursion of `circle.rs`. The series is cut where the outside's J_n/H_n falls below rounding, so
//! only rounding remains.

use crate::cylinders::circle::{Circle, Response, order_for};
use crate::light::series::{AzimuthGrid, incident, minus_i_power};
use crate::special::{Sequence, power_of_two};
use crate::{Body, C64, Polarization, Scattered, SolverStats, Source, Wave, WaveError, WaveSolver};
use rayon::prelude::*;
use std::f64::consts::TAU;

const METHOD: &str = "mie";

/// Size of J_n/H_n below which orders are omitted.
const CUT: f64 = 1e-18;

/// One circular cylinder, solved in closed form.
///
/// Orders whose cylinder resonance is narrower than the cut are omitted: they are narrower than the rounding
/// of the wavelength.
pub struct MieSolver {
    wave: Wave,
    circle: Circle,
    response: Response,
}

/// Relative accuracy of the series: rounding, and the phase of the largest size parameter.
pub(crate) fn reachable(circle: &Circle, wave: &Wave) -> f64 {
    let x = circle
        .layers
        .iter()
        .map(|&(r, index)| wave.k_rho_in(index).norm() * r)
        .fold(wave.k_rho() * circle.radius_um(), f64::max);
    1e-13 + 4e-16 * x
}

/// Checks the requirements of all solvers on a wave.
pub(crate) fn check_wave(wave: &Wave) -> Result<(), WaveError> {
    let invalid = |key: &str, value: f64, hint: &str| {
        Err(WaveError::Invalid { key: key.into(), value: value.to_string(), hint: hint.into() })
    };
    if !(wave.lambda_um > 0.0 && wave.lambda_um.is_finite()) {
        return invalid("lambda_um", wave.lambda_um, "use a positive wavelength");
    }
    if !(wave.theta_i.abs() < std::f64::consts::FRAC_PI_2 && wave.theta_i.cos() > 1e-6) {
        return invalid("theta_i_deg", wave.theta_i.to_degrees(), "stay between -90 and 90 degrees");
    }
    Ok(())
}

impl MieSolver {
    /// Prepares the orders of `body`, a circle whose lumens, if any, are circles about the same center.
    ///
    /// # Errors
    /// [`WaveError::Unsupported`] for other outlines, [`WaveError::Invalid`] and [`WaveError::Overlap`] for
    /// bad numbers, [`WaveError::Unreachable`] if `tolerance` (relative, on the far field) is below rounding.
    pub fn new(body: &Body, wave: &Wave, tolerance: f64) -> Result<Self, WaveError> {
        check_wave(wave)?;
        let circle = Circle::new(body, "fiber[0]", METHOD)?;
        let reachable = reachable(&circle, wave);
        if tolerance.is_nan() || tolerance < reachable {
            return Err(WaveError::Unreachable { method: METHOD, asked: tolerance, reachable });
        }
        let x = wave.k_rho() * circle.radius_um();
        let top = order_for(x, CUT);
        let hankel = Sequence::hankel(C64::new(x, 0.0), top + 1);
        let response = Response::new(&circle, wave, &hankel, top)?;
        Ok(Self { wave: *wave, circle, response })
    }

    fn one(&self, source: &Source, grid: &AzimuthGrid, n_phi_out: usize) -> Result<Scattered, WaveError> {
        let [x, y] = self.circle.center_um;
        let (k_rho, k0, cos) = (self.wave.k_rho(), self.wave.k0(), self.wave.theta_i.cos());
        let waves = source.plane_waves(&self.wave, x.hypot(y) + self.circle.radius_um())?;
        let top = self.response.top();
        let p = incident(&waves, k_rho, [x, y], top);
        let (e0, h0) = source.axial(&self.wave);
        let mut far = [vec![C64::new(0.0, 0.0); 2 * top + 1], vec![C64::new(0.0, 0.0); 2 * top + 1]];
        let (mut sca, mut abs, mut ext) = (0.0, 0.0, 0.0);
        for (i, p) in p.iter().enumerate() {
            let n = i as i64 - top as i64;
            let t = self.response.t_plain(n);
            let c = [0, 1].map(|r| (t[r][0] * e0 + t[r][1] * h0) * p / cos);
            sca += c[0].norm_sqr() + c[1].norm_sqr();
            // The optical theorem: the forward amplitude of plane wave m is the sum over n of its own
            // conj(p_n) c_n.
            ext += match source.pol {
                Polarization::Tm => -(p.conj() * c[0]).re,
                Polarization::Te => (p.conj() * c[1]).re,
            };
            let scale = power_of_two(-self.response.exponent(n));
            abs += self.response.absorbed_um(n, [p * e0 * scale, p * h0 * scale]);
            for r in 0..2 {
                far[r][i] = minus_i_power(n) * c[r];
            }
        }
        let mut f_u = grid.sum(&far[0]);
        let mut f_phi = grid.sum(&far[1]);
        for j in 0..n_phi_out {
            let [ux, uy] = grid.direction(j);
            let phase = C64::from_polar(1.0, -k_rho * (x * ux + y * uy));
            f_u[j] *= phase;
            f_phi[j] *= phase;
        }
        // Parseval: the integral of |F|^2 over azimuth is 2 pi times the sum over orders.
        let c_sca_um = 2.0 / (std::f64::consts::PI * k0) * TAU * sca;
        Ok(Scattered { f_u, f_phi, c_sca_um, c_abs_um: abs, c_ext_um: 4.0 / k0 * ext })
    }
}

impl WaveSolver for MieSolver {
    fn scatter(&self, sources: &[Source], n_phi_out: usize) -> Result<Vec<Scattered>, WaveError> {
        let grid = AzimuthGrid::new(n_phi_out);
        sources.par_iter().map(|s| self.one(s, &grid, n_phi_out)).collect()
    }

    fn stats(&self) -> SolverStats {
        let unknowns = 2 * (2 * self.response.top() + 1);
        SolverStats { unknowns, residual: 0.0, peak_bytes: unknowns * 16 * 16 }
    }
}

#[cfg(test)]
mod tests {
    //! References: an arbitrary-precision solve of all walls' equations at once, Bohren and Huffman's closed
    //! coefficients, and the ledger.
    use super::*;
    use crate::{BeamSource, Shape, extinction_width, scattering_width};

    pub(crate) fn body(center_um: [f64; 2], layers: &[(f64, f64, f64)]) -> Body {
        let (radius_um, eta, kappa) = layers[0];
        Body {
            shape: Shape::Circle { radius_um },
            center_um,
            rotation_rad: 0.0,
            eta,
            kappa,
            lumen: (layers.len() > 1).then(|| Box::new(body(center_um, &layers[1..]))),
        }
    }

    fn plane(phi_i: f64, pol: Polarization) -> Source {
        Source { phi_i, pol, beam: None }
    }

    const BOTH: [Polarization; 2] = [Polarization::Tm, Polarization::Te];

    /// `layers` as `(radius_um, eta, kappa)`; `f` as `[F_u, F_phi]` at azimuths 0 and 4 pi / 5 for TM, then
    /// for TE; `c` as `[C_sca, C_ext]`.
    struct Case {
        lambda_um: f64,
        theta_i: f64,
        phi_i: f64,
        layers: &'static [(f64, f64, f64)],
        f: [[C64; 2]; 4],
        c: [[f64; 2]; 2],
    }

    /// Python 3.11, mpmath 1.3, 60 digits: per order, e, h and both W of the module's head are matched at
    /// every wall in one dense system, unscaled.
    /// ```text
    /// from mpmath import *
    /// mp.dps = 60
    /// H = lambda n, z: 2/(pi*1j)*exp(-1j*pi*n/2)*besselk(n, -1j*z)
    /// d = lambda f, n, z: (f(n-1, z) - f(n+1, z))/2
    /// def tn(n, lam, theta, layers):          # layers: (radius, index), outermost first
    ///     k0 = 2*pi/mpf(lam); kz = -k0*sin(mpf(theta))
    ///     med = [mpc(1)] + [mpc(m) for R, m in layers]; kap = [sqrt(k0**2*m*m - kz**2) for m in med]
    ///     cols = [(0, H, 0), (0, H, 1)]
    ///     for i in range(1, len(med)):
    ///         cols += [(i, besselj, 0), (i, besselj, 1)] + ([(i, H, 0), (i, H, 1)] if i < len(med)-1 else [])
    ///     def vw(i, f, pol, R):
    ///         z = kap[i]*R; v = f(n, z); dv = kap[i]*d(f, n, z); k2 = kap[i]**2; a = 1j*n*kz/R*v
    ///         return (v, 0, k0*med[i]**2*dv/k2, -a/k2) if pol == 0 else (0, v, a/k2, k0*dv/k2)
    ///     A = matrix(len(cols), len(cols)); B = matrix(len(cols), 2)
    ///     for w, (R, m) in enumerate(layers):
    ///         for c, (i, f, p) in enumerate(cols):
    ///             for r, x in enumerate(vw(i, f, p, mpf(R))): A[4*w+r, c] += ((i == w) - (i == w+1))*x
    ///     for p in (0, 1):
    ///         for r, x in enumerate(vw(0, besselj, p, mpf(layers[0][0]))): B[r, p] -= x
    ///     x = [lu_solve(A, B[:, p]) for p in (0, 1)]
    ///     return [[x[0][0], x[1][0]], [x[0][1], x[1][1]]]
    /// ```
    /// F then is `sum (-1)^n T_n (e0, h0) exp(i n (phi - phi_i)) / cos(theta)`, C_sca
    /// `4/k0 sum |T_n[:, pol]|^2`, C_ext `-4/k0 Re sum T_n[pol, pol]`.
    #[rustfmt::skip]
    #[allow(clippy::excessive_precision, reason = "digits as printed")]
    const CASES: &[Case] = &[
Case { lambda_um: 0.55, theta_i: 0.0, phi_i: 0.4, layers: &[(1.3, 1.55, 0.0)],
 f: [ [C64::new(0.62749577566705667, 1.2555327048779097), C64::new(0.0, 0.0)], [C64::new(0.9323867475096469, 0.02919343716653666), C64::new(0.0, 0.0)], [C64::new(0.0, 0.0), C64::new(-1.0574014094022923, 0.044826943906161959)], [C64::new(0.0, 0.0), C64::new(-1.9522500680106824, 2.0427039274284159)] ],
 c: [ [7.3565988541594759, 7.3565988541594759], [7.4361676521760516, 7.4361676521760516] ] },
Case { lambda_um: 0.55, theta_i: 0.6, phi_i: 0.4, layers: &[(1.3, 1.55, 0.02)],
 f: [ [C64::new(0.18237488975172748, -0.43932755903022404), C64::new(-0.013235928936066943, 0.38169954655359353)], [C64::new(0.31645267025553193, -2.1594827932763221), C64::new(0.12341394431127795, -1.0906728255362088)], [C64::new(-0.013235928936066943, 0.38169954655359353), C64::new(0.32324656580216584, -0.59363472548583667)], [C64::new(0.12341394431127795, -1.0906728255362088), C64::new(-0.29748468096691043, 1.5101346096567841)] ],
 c: [ [2.8994324761652919, 4.4307721023643261], [2.7405484397411234, 4.4116725604569909] ] },
Case { lambda_um: 0.55, theta_i: -1.1, phi_i: 2.0, layers: &[(1.3, 1.55, 0.0), (0.7, 1.0, 0.0)],
 f: [ [C64::new(-0.87845604812001547, -0.47204015969985532), C64::new(-1.9666151554897269, -0.47891726155064539)], [C64::new(0.57514103075883799, 0.15287260183284308), C64::new(0.92519784237075025, 0.28518344438489148)], [C64::new(-1.9666151554897269, -0.47891726155064539), C64::new(1.0792974365278457, -0.86213654416695228)], [C64::new(0.92519784237075025, 0.28518344438489148), C64::new(-1.8549110966152428, 0.1950862619694528)] ],
 c: [ [3.30526273137348, 3.30526273137348], [2.5333118137208802, 2.5333118137208802] ] },
Case { lambda_um: 0.4, theta_i: 0.3, phi_i: -1.0, layers: &[(0.9, 1.5, 0.01), (0.8, 0.2, 3.4), (0.3, 1.33, 0.0)],
 f: [ [C64::new(-0.59444093141076729, -2.3324327225919146), C64::new(0.044793058673441851, 0.025257186623034544)], [C64::new(0.67072528169279411, 0.27335121290707222), C64::new(-0.32902058752797441, 0.15269855716120802)], [C64::new(0.044793058673441851, 0.025257186623034544), C64::new(-0.47657491809619789, -2.692167845671045)], [C64::new(-0.32902058752797441, 0.15269855716120802), C64::new(-3.0585541750783834, 0.020584264271061377)] ],
 c: [ [4.0174951622683793, 4.3852935350866426], [3.1170253833305925, 3.3747600103572943] ] },
Case { lambda_um: 0.55, theta_i: 1.5533430342749532, phi_i: 0.4, layers: &[(1.3, 1.55, 0.01)],
 f: [ [C64::new(0.49570653848714606, 0.39861611060229369), C64::new(0.21175829409465353, 0.16533683319460571)], [C64::new(-0.2946409923340496, -0.26258383114928268), C64::new(-0.4824663303364052, -0.44890556346524482)], [C64::new(0.21175829409465353, 0.16533683319460571), C64::new(-0.50280889630471214, -0.38651661672676094)], [C64::new(-0.4824663303364052, -0.44890556346524482), C64::new(0.29018962443973674, 0.27559119981877394)] ],
 c: [ [0.19242305974267362, 0.20076468203798226], [0.1931365182287043, 0.19956805663743609] ] },
Case { lambda_um: 0.55, theta_i: 1.5533430342749532, phi_i: 0.4, layers: &[(1.3, 1.55, 0.01), (0.5, 1.0, 0.0)],
 f: [ [C64::new(0.49485716086738867, 0.35802615195786421), C64::new(0.20782970457741594, 0.15855032274070168)], [C64::new(-0.28679052357218665, -0.29150370521868136), C64::new(-0.48862956424367041, -0.45867186187350417)], [C64::new(0.20782970457741594, 0.15855032274070168), C64::new(-0.50403114986923106, -0.37089278679516659)], [C64::new(-0.48862956424367041, -0.45867186187350417), C64::new(0.28682572299342397, 0.28383733899206314)] ],
 c: [ [0.19387069053015562, 0.2006977922800795], [0.19539340554254152, 0.20228447474937647] ] },
    ];

    #[test]
    fn agrees_with_arbitrary_precision() {
        for case in CASES {
            let wave = Wave { lambda_um: case.lambda_um, theta_i: case.theta_i };
            let solver = MieSolver::new(&body([0.0, 0.0], case.layers), &wave, 1e-12).unwrap();
            let out = solver.scatter(&BOTH.map(|pol| plane(case.phi_i, pol)), 5).unwrap();
            let scale = case.f.iter().flatten().map(|f| f.norm()).fold(0.0, f64::max);
            let allowed = 2e-14;
            for p in 0..2 {
                for (a, j) in [0, 2].into_iter().enumerate() {
                    let want = case.f[2 * p + a];
                    let err = (out[p].f_u[j] - want[0]).norm().max((out[p].f_phi[j] - want[1]).norm()) / scale;
                    assert!(
                        err < allowed,
                        "{:?} theta {} pol {p} azimuth {j}: error {err:e}",
                        case.layers,
                        case.theta_i
                    );
                }
                let [sca, ext] = case.c[p];
                for (got, want) in [(out[p].c_sca_um, sca), (out[p].c_ext_um, ext), (out[p].c_abs_um, ext - sca)] {
                    let err = (got - want).abs() / ext;
                    assert!(err < allowed, "{:?} theta {} pol {p}: {got}, want {want}", case.layers, case.theta_i);
                }
            }
        }
    }

    /// b_nI, a_nII and a_nI of Bohren and Huffman 1983, section 8.4, from the crate's own Bessel functions:
    /// T_ee = -b_nI, T_hh = -a_nII, |T_eh| = |a_nI|.
    #[test]
    fn coefficients_are_those_of_bohren_and_huffman() {
        // One call per order: the crate's sequences may return zeros at large Im z. The factor exp(-|Im z|)
        // of the functions inside cancels.
        let seq = |z: C64, n: usize, hankel: bool| -> Vec<C64> {
            let f = |n| if hankel { complex_bessel::hankel1(n, z) } else { complex_bessel::besselj_scaled(n, z) };
            (0..n).map(|n| f(n as f64).unwrap()).collect()
        };
        let prime = |f: &[C64], n: usize, z: C64| if n == 0 { -f[1] } else { f[n - 1] - f[n] * (n as f64) / z };
        for (size, theta, m) in [
            (0.3, 0.0, C64::new(1.5, 0.0)),
            (7.0, 0.5, C64::new(1.55, 0.0)),
            (12.0, -0.9, C64::new(1.55, 1e-3)),
            (40.0, 1.3, C64::new(1.3, 0.1)),
            (95.0, 0.2, C64::new(0.4, 2.0)),
        ] {
            let wave = Wave { lambda_um: TAU, theta_i: theta };
            let solver = MieSolver::new(&body([0.0, 0.0], &[(size, m.re, m.im)]), &wave, 1e-10).unwrap();
            // B and H's zeta is the angle between the light's direction and the axis; their xi and eta are
            // our arguments outside and inside.
            let cos_zeta = wave.kz();
            let (xi, eta) = (C64::new(size * wave.theta_i.cos(), 0.0), size * (m * m - cos_zeta * cos_zeta).sqrt());
            let top = (xi.re + 10.0) as usize;
            let (jx, hx, je) = (seq(xi, top + 2, false), seq(xi, top + 2, true), seq(eta, top + 2, false));
            for n in 0..top {
                let i = C64::new(0.0, 1.0);
                let (dj, dh, de) = (prime(&jx, n, xi), prime(&hx, n, xi), prime(&je, n, eta));
                let twist = n as f64 * cos_zeta * eta * je[n] * (xi * xi / (eta * eta) - 1.0);
                let (a, b) =
                    (i * xi * (xi * de * jx[n] - eta * je[n] * dj), xi * (m * m * xi * de * jx[n] - eta * je[n] * dj));
                let (c, d) = (twist * jx[n], twist * hx[n]);
                let (v, w) =
                    (xi * (m * m * xi * de * hx[n] - eta * je[n] * dh), i * xi * (eta * je[n] * dh - xi * de * hx[n]));
                let den = w * v + i * d * d;
                let (b_i, a_ii, a_i) = ((w * b + i * d * c) / den, -(a * v - i * c * d) / den, (c * v - b * d) / den);
                let t = solver.response.t_plain(n as i64);
                for (name, err) in [
                    ("b_nI", (t[0][0] + b_i).norm()),
                    ("a_nII", (t[1][1] + a_ii).norm()),
                    ("a_nI", (t[0][1].norm() - a_i.norm()).abs().max((t[1][0].norm() - a_i.norm()).abs())),
                ] {
                    assert!(err < 1e-12, "size {size} theta {theta} m {m} {name} order {n}: error {err:e}");
                }
            }
        }
    }

    /// Normal incidence, TM and TE, in the textbook form (Bohren and Huffman, 8.30 and 8.32) for a tiny
    /// lossless cylinder: limits of small x.
    #[test]
    fn small_cylinders_scatter_as_dipoles() {
        let wave = Wave { lambda_um: TAU, theta_i: 0.0 };
        let (x, m2) = (1e-3f64, 1.5f64 * 1.5);
        let solver = MieSolver::new(&body([0.0, 0.0], &[(x, 1.5, 0.0)]), &wave, 1e-10).unwrap();
        // b_0 -> -i pi x^2 (m^2 - 1) / 4, a_1 -> -i pi x^2 (m^2 - 1) / (m^2 + 1) / 4.
        let b0 = std::f64::consts::FRAC_PI_4 * x * x * (m2 - 1.0);
        let a1 = b0 / (m2 + 1.0);
        let (t0, t1) = (solver.response.t_plain(0), solver.response.t_plain(1));
        assert!((t0[0][0].im / b0 - 1.0).abs() < 1e-5, "{} {b0}", t0[0][0]);
        assert!((t1[1][1].im / a1 - 1.0).abs() < 1e-5, "{} {a1}", t1[1][1]);
        let out = solver.scatter(&BOTH.map(|pol| plane(0.0, pol)), 8).unwrap();
        for (o, want) in out.iter().zip([4.0 * b0 * b0, 8.0 * a1 * a1]) {
            assert!((o.c_sca_um / want - 1.0).abs() < 1e-4, "{} {want}", o.c_sca_um);
        }
    }

    /// Energy, the grid's integral and the optical theorem written out, from tiny to huge, up to grazing
    /// latitudes, lossless and metallic, hollow.
    #[test]
    fn ledger_closes() {
        let (mut worst, mut absorbed) = (0.0f64, 0.0f64);
        for layers in [
            &[(1.0, 1.55, 0.0)][..],
            &[(1.0, 1.55, 1e-4)],
            &[(1.0, 1.33, 5.0)],
            &[(1.0, 0.7, 0.0)],
            &[(1.0, 1.55, 0.0), (0.6, 1.0, 0.0)],
            &[(1.0, 1.5, 0.3), (0.95, 1.7, 0.0), (0.2, 1.0, 0.0), (0.1, 2.0, 0.1)],
        ] {
            for size in [1e-2, 1.0, 30.0, 2000.0] {
                for theta_i in [0.0, 0.4, -1.2, 1.55, 1.570] {
                    let wave = Wave { lambda_um: TAU / size, theta_i };
                    let solver = MieSolver::new(&body([0.3, -0.8], layers), &wave, 1e-11).unwrap();
                    let out = solver.scatter(&BOTH.map(|pol| plane(0.7, pol)), 7).unwrap();
                    for (o, pol) in out.iter().zip(BOTH) {
                        assert!(o.c_sca_um > 0.0 && o.c_abs_um.is_finite());
                        // The optical theorem takes a real part that may be far below |F|, so allow for the
                        // rounding of |F|. The roundings of a layered wall's admittance show beside the tiny
                        // C_ext of thin cylinders at grazing latitudes.
                        let size_f = o.f_u.iter().chain(&o.f_phi).map(|f| f.norm()).fold(0.0, f64::max);
                        let floor = if layers.len() > 1 { 1e-15 } else { 0.0 } + 2e-15 * 4.0 / wave.k0() * size_f;
                        let err = ((o.c_sca_um + o.c_abs_um - o.c_ext_um).abs() - floor).max(0.0) / o.c_ext_um;
                        worst = worst.max(err);
                        assert!(err < 2e-13, "{layers:?} size {size} theta {theta_i} {pol:?}: {o:?} error {err:e}");
                        if layers == [(1.0, 1.55, 0.0)] {
                            assert!(
                                o.c_abs_um.abs() < 1e-15 * o.c_ext_um,
                                "plain and lossless: absorbs {}",
                                o.c_abs_um
                            );
                        } else if layers.iter().all(|l| l.2 == 0.0) {
                            absorbed = absorbed.max(o.c_abs_um.abs() / o.c_ext_um);
                            assert!(
                                o.c_abs_um.abs() < 2e-13 * o.c_ext_um + floor,
                                "{layers:?}: absorbs {}",
                                o.c_abs_um
                            );
                        }
                    }
                }
            }
        }
        println!("largest absorbed part of a hollow lossless cylinder {absorbed:.1e}");
        println!("largest ledger error {worst:.1e}");
    }

    /// The sums over orders are the integral and the theorem of the module's head; also for a beam.
    #[test]
    fn widths_are_those_of_the_definitions() {
        let wave = Wave { lambda_um: 0.6, theta_i: 0.5 };
        let solver = MieSolver::new(&body([1.0, 2.0], &[(1.5, 1.5, 0.01)]), &wave, 1e-10).unwrap();
        for pol in BOTH {
            for beam in [None, Some(BeamSource { w0_um: 2.5, h_um: 0.9 })] {
                let source = Source { phi_i: 0.8, pol, beam };
                let o = &solver.scatter(&[source], 400).unwrap()[0];
                let err = (scattering_width(&wave, &o.f_u, &o.f_phi) / o.c_sca_um - 1.0).abs();
                assert!(err < 1e-12, "C_sca off by {err:e}");
                let waves = source.plane_waves(&wave, 4.0).unwrap();
                // Forward amplitudes by trigonometric interpolation from the grid.
                let forward: Vec<(C64, C64)> = waves
                    .iter()
                    .map(|w| {
                        let at = |f: &[C64]| {
                            let n = f.len();
                            let angle = w.phi_i + std::f64::consts::PI;
                            (0..n)
                                .map(|j| {
                                    let half = 0.5 * (angle - TAU * j as f64 / n as f64);
                                    // Dirichlet kernel of an even number of points.
                                    f[j] * (n as f64 * half).sin() / half.tan() / n as f64
                                })
                                .sum::<C64>()
                        };
                        (at(&o.f_u), at(&o.f_phi))
                    })
                    .collect();
                let want = extinction_width(&wave, pol, &waves, &forward);
                assert!((o.c_ext_um / want - 1.0).abs() < 1e-11, "C_ext {} want {want}", o.c_ext_um);
                let sum = o.c_sca_um + o.c_abs_um;
                assert!((sum / o.c_ext_um - 1.0).abs() < 1e-12, "{sum} {}", o.c_ext_um);
            }
        }
    }

    /// Moving the cylinder multiplies F by the phases of both paths; turning the light turns the field; a
    /// layer of the core's index has no effect.
    #[test]
    fn moves_turns_and_idle_layers() {
        let wave = Wave { lambda_um: 0.5, theta_i: -0.7 };
        let n = 12;
        let here = MieSolver::new(&body([0.0, 0.0], &[(1.1, 1.6, 0.02)]), &wave, 1e-10).unwrap();
        let there = MieSolver::new(&body([3.0, -2.0], &[(1.1, 1.6, 0.02), (0.9, 1.6, 0.02)]), &wave, 1e-10).unwrap();
        for pol in BOTH {
            let a = &here.scatter(&[plane(0.0, pol)], n).unwrap()[0];
            let b = &there.scatter(&[plane(TAU / 12.0 * 5.0, pol)], n).unwrap()[0];
            let size = a.f_u.iter().chain(&a.f_phi).map(|f| f.norm()).fold(0.0, f64::max);
            for j in 0..n {
                let u = |phi: f64| 3.0 * phi.cos() - 2.0 * phi.sin();
                let phi = TAU * ((j + 5) % n) as f64 / n as f64;
                let phase = C64::from_polar(1.0, -wave.k_rho() * (u(phi) + u(TAU / 12.0 * 5.0)));
                for (x, y) in [(&a.f_u, &b.f_u), (&a.f_phi, &b.f_phi)] {
                    assert!((x[j] * phase - y[(j + 5) % n]).norm() < 1e-12 * size, "{} {}", x[j], y[(j + 5) % n]);
                }
            }
            assert!((a.c_abs_um - b.c_abs_um).abs() < 1e-12 * a.c_ext_um);
        }
    }

    #[test]
    fn bad_bodies_are_refused() {
        let wave = Wave { lambda_um: 0.5, theta_i: 0.0 };
        let new = |b: &Body| MieSolver::new(b, &wave, 1e-6).err().unwrap();
        assert!(
            matches!(new(&body([0.0, 0.0], &[(1.0, 1.5, -0.1)])), WaveError::Invalid { key, .. } if key == "fiber[0].kappa")
        );
        assert!(matches!(new(&body([0.0, 0.0], &[(1.0, 1.5, 0.0), (1.0, 1.0, 0.0)])), WaveError::Overlap { .. }));
        let mut off = body([0.0, 0.0], &[(1.0, 1.5, 0.0), (0.2, 1.0, 0.0)]);
        off.lumen.as_mut().unwrap().center_um = [0.1, 0.0];
        assert!(matches!(new(&off), WaveError::Unsupported { .. }));
        off.shape = Shape::Ellipse { a_um: 1.0, b_um: 2.0 };
        assert!(matches!(new(&off), WaveError::Unsupported { .. }));
        let fine = body([0.0, 0.0], &[(1.0, 1.5, 0.0)]);
        assert!(matches!(MieSolver::new(&fine, &wave, 1e-15), Err(WaveError::Unreachable { .. })));
        assert!(matches!(
            MieSolver::new(&fine, &Wave { lambda_um: -1.0, theta_i: 0.0 }, 1e-6),
            Err(WaveError::Invalid { .. })
        ));
        assert!(matches!(
            MieSolver::new(&fine, &Wave { lambda_um: 1.0, theta_i: 1.6 }, 1e-6),
            Err(WaveError::Invalid { .. })
        ));
    }
}
