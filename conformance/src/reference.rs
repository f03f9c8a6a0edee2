//! The reference implementation of the runtime's kernels, slow and simple: the model as [`super::PlyData`]
//! defines it, in f64, through [`plywave::ply::asg::Lobe`]. Tests compare the kernels with it.

use plywave::ply::asg::{Lobe, MU_MAX, MU_MIN, PARAMS, unit_energy};
use plywave::ply::cone::{ConeLobe, LobeKind};
use plywave::ply::{MIN_ENERGY, MIN_TRANSMITTANCE, PlyData, extended};

/// A lobe with its energy at each absorption.
struct Weighted {
    lobe: AnyLobe,
    refl: bool,
    energy: Vec<f64>,
}

/// A lobe of either kind.
pub(crate) enum AnyLobe {
    Round(Lobe),
    Cone(ConeLobe),
}

impl AnyLobe {
    fn from_parameters(family: LobeKind, p: &[f64]) -> AnyLobe {
        let bound = |x: f64, (low, high): (f64, f64)| x.clamp(low.ln(), high.ln());
        let [mu1, mu2] = family.bandwidths();
        match family {
            LobeKind::Round => AnyLobe::Round(clamp(Lobe::from_params(p))),
            LobeKind::Cone => {
                let lobe = ConeLobe::from_params(p);
                AnyLobe::Cone(ConeLobe { ln_mu1: bound(lobe.ln_mu1, mu1), ln_mu2: bound(lobe.ln_mu2, mu2), ..lobe })
            }
        }
    }

    /// Value of the lobe with energy 1 in direction `v`, for theta_i >= 0.
    fn unit(&self, theta_i: f64, v: [f64; 3]) -> f64 {
        match self {
            AnyLobe::Round(lobe) => Lobe { energy: 1.0, ..*lobe }.eval(v),
            AnyLobe::Cone(lobe) => ConeLobe { energy: 1.0, ..*lobe }.eval(theta_i, v),
        }
    }
}

/// The mixture of lobes at one incidence.
pub struct Mixture {
    lobes: Vec<Weighted>,
    flip: bool,
    theta_i: f64,
    /// Energy of f_refl.
    pub energy_refl: f64,
    /// Energy of f_high, one for each absorption.
    pub energy_high: Vec<f64>,
    /// Fraction of the beam that hits no fiber.
    pub r_d: f64,
}

/// Cell index and fraction of `x` on a uniform axis, clamped to it.
fn cell(x: f64, axis: &[f64]) -> (usize, f64) {
    let n = axis.len();
    let t = ((x - axis[0]) / (axis[n - 1] - axis[0]) * (n - 1) as f64).clamp(0.0, (n - 1) as f64);
    let i = (t as usize).min(n - 2);
    (i, t - i as f64)
}

/// Catmull-Rom weights of nodes i-1..=i+2 at fraction `f` of cell `i`.
pub(crate) fn catmull_rom(f: f64) -> [f64; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f3 + 2.0 * f2 - f), 0.5 * (3.0 * f3 - 5.0 * f2 + 2.0), 0.5 * (-3.0 * f3 + 4.0 * f2 + f), 0.5 * (f3 - f2)]
}

/// A spline with coefficients `of(node)` at (theta_i >= 0, h), as the sum over every basis function. The
/// three pieces of the quadratic basis function are written out, and coefficients beyond the ends are
/// extrapolated.
fn spline(theta_i: &[f64], h_um: &[f64], t: f64, h: f64, of: &dyn Fn(usize) -> f64) -> f64 {
    let basis = |x: f64| match x.abs() {
        a if a <= 0.5 => 0.75 - a * a,
        a if a <= 1.5 => 0.5 * (1.5 - a) * (1.5 - a),
        _ => 0.0,
    };
    let (rows, columns) = (theta_i.len() as isize, h_um.len() as isize);
    let step = |axis: &[f64]| (axis[axis.len() - 1] - axis[0]) / (axis.len() - 1) as f64;
    let (t, h) = (t.min(theta_i[theta_i.len() - 1]), h.clamp(h_um[0], h_um[h_um.len() - 1]));
    let inner = |m: isize, n: isize| of((m * columns + n) as usize);
    let along_h = |m: isize, n: isize| match n {
        -1 => 2.0 * inner(m, 0) - inner(m, 1),
        n if n == columns => 2.0 * inner(m, n - 1) - inner(m, n - 2),
        n => inner(m, n),
    };
    let mut sum = 0.0;
    for m in -1..=rows {
        for n in -1..=columns {
            let c = match m {
                -1 => along_h(1, columns - 1 - n),
                m if m == rows => 2.0 * along_h(m - 1, n) - along_h(m - 2, n),
                m => along_h(m, n),
            };
            sum += basis(t / step(theta_i) - m as f64) * basis((h - h_um[0]) / step(h_um) - n as f64) * c;
        }
    }
    sum
}

impl Mixture {
    /// The model `d` at an incidence; `None` if the beam misses (|h| is beyond the nodes, or an input is
    /// NaN).
    pub fn new(d: &PlyData, theta_i: f64, h_um: f64, sigma: &[f64]) -> Option<Mixture> {
        let (nm, nh, _, nj) = d.sizes();
        if theta_i.is_nan() || h_um.is_nan() || h_um.abs() > d.h_um[nh - 1] {
            return None;
        }
        let flip = theta_i < 0.0;
        let (m, fm) = cell(theta_i.abs(), &d.theta_i);
        let (n, fn_) = cell(if flip { -h_um } else { h_um }, &d.h_um);
        let sigma: Vec<f64> = sigma.iter().map(|s| if s.is_nan() { 0.0 } else { s.clamp(0.0, 1e6) }).collect();
        let e = &d.energies;
        let h = if flip { -h_um } else { h_um };
        let shares = |of: &dyn Fn(usize) -> f64| spline(&e.share_theta_i, &e.share_h_um, theta_i.abs(), h, of);
        let r_d = spline(&e.miss_theta_i, &e.miss_h_um, theta_i.abs(), h, &|i| e.miss[i]);
        let energy_refl = (1.0 - r_d) * shares(&|i| e.share_refl[i]);
        let spectrum: Vec<f64> = (0..nj).map(|j| (1.0 - r_d) * shares(&|i| e.share_high[i * nj + j])).collect();
        let energy_high: Vec<f64> =
            sigma.iter().map(|s| spectrum.iter().zip(&d.path_um).map(|(e, l)| e * (-s * l).exp()).sum()).collect();

        let mut lobes = Vec::new();
        let (wm, wn) = (catmull_rom(fm), catmull_rom(fn_));
        for l in 0..d.lobes_refl {
            let mut p = [0.0; PARAMS];
            for (k, v) in p.iter_mut().enumerate() {
                let node = |i: usize, j: usize| d.refl[((i * nh + j) * d.lobes_refl + l) * PARAMS + k];
                for (a, wa) in wm.iter().enumerate() {
                    for (b, wb) in wn.iter().enumerate() {
                        let row = |i: usize| extended(n as isize + b as isize - 1, nh, &|j| node(i, j));
                        *v += wa * wb * extended(m as isize + a as isize - 1, nm, &row);
                    }
                }
            }
            let lobe = AnyLobe::from_parameters(d.family, &p);
            lobes.push(Weighted { lobe, refl: true, energy: vec![p[5].max(MIN_ENERGY); sigma.len()] });
        }
        let block = (m / 2) * (nh / 2) + n / 2;
        let (gm, gn) = (0.5 * ((m % 2) as f64 + fm), 0.5 * ((n % 2) as f64 + fn_));
        let weights = [(1.0 - gm) * (1.0 - gn), (1.0 - gm) * gn, gm * (1.0 - gn), gm * gn];
        for l in 0..d.lobes_high {
            let (mut p, mut path) = ([0.0; PARAMS], vec![0.0; nj]);
            for (c, w) in weights.iter().enumerate() {
                let at = (block * 4 + c) * d.lobes_high + l;
                for k in 0..PARAMS {
                    p[k] += w * d.high[at * PARAMS + k];
                }
                for j in 0..nj {
                    path[j] += w * d.high_path[at * nj + j];
                }
            }
            let lobe = AnyLobe::from_parameters(d.family, &p);
            let transmittance = |s: &f64| (0..nj).map(|j| path[j] * (-s * d.path_um[j]).exp()).sum::<f64>();
            let energy = p[5].max(MIN_ENERGY);
            let energy = sigma.iter().map(|s| energy * (transmittance(s) + MIN_TRANSMITTANCE)).collect();
            lobes.push(Weighted { lobe, refl: false, energy });
        }
        for refl in [true, false] {
            for k in 0..sigma.len() {
                let want = if refl { energy_refl } else { energy_high[k] };
                let sum: f64 = lobes.iter().filter(|l| l.refl == refl).map(|l| l.energy[k]).sum();
                lobes.iter_mut().filter(|l| l.refl == refl).for_each(|l| l.energy[k] *= want / sum);
            }
        }
        Some(Mixture {
            lobes,
            flip,
            theta_i: theta_i.abs().min(0.5 * std::f64::consts::PI),
            energy_refl,
            energy_high,
            r_d,
        })
    }

    /// The lobes, for theta_i >= 0.
    pub(crate) fn lobes(&self) -> impl Iterator<Item = &AnyLobe> {
        self.lobes.iter().map(|l| &l.lobe)
    }

    /// |theta_i| [rad], at most pi/2.
    pub(crate) fn theta_i(&self) -> f64 {
        self.theta_i
    }

    /// Whether directions are mirrored before evaluation ([`plywave::frame::mirror_incidence`]): theta_i < 0.
    pub(crate) fn is_mirrored(&self) -> bool {
        self.flip
    }

    /// f_refl, and f_high for each absorption, in direction `wo` [1/sr].
    pub fn eval_split(&self, wo: [f64; 3]) -> (f64, Vec<f64>) {
        let v = if self.flip { [-wo[0], wo[1], -wo[2]] } else { wo };
        let (mut refl, mut high) = (0.0, vec![0.0; self.energy_high.len()]);
        for l in &self.lobes {
            let g = l.lobe.unit(self.theta_i, v);
            if l.refl {
                refl += g * l.energy.first().copied().unwrap_or(0.0);
            } else {
                high.iter_mut().zip(&l.energy).for_each(|(f, e)| *f += g * e);
            }
        }
        (refl, high)
    }

    /// Density with which `wo` is sampled, among all outcomes including missed light.
    pub fn pdf(&self, wo: [f64; 3]) -> f64 {
        let v = if self.flip { [-wo[0], wo[1], -wo[2]] } else { wo };
        let mean = |e: &[f64]| e.iter().sum::<f64>() / e.len().max(1) as f64;
        let total = self.energy_refl + mean(&self.energy_high) + self.r_d;
        if total <= 0.0 {
            return 0.0;
        }
        let density = |l: &Weighted| {
            let lobe = match &l.lobe {
                AnyLobe::Round(lobe) => lobe,
                AnyLobe::Cone(_) => return l.lobe.unit(self.theta_i, v),
            };
            let [x, y, z] = lobe.frame();
            let dot = |a: [f64; 3]| a[0] * v[0] + a[1] * v[1] + a[2] * v[2];
            let (u, w, cz) = (dot(x), dot(y), dot(z));
            let (mu1, mu2) = (lobe.ln_mu1.exp(), lobe.ln_mu2.exp());
            let (q, r2) = (mu1 * u * u + mu2 * w * w, u * u + w * w);
            let a = (q + 1e-30) / (r2 + 1e-30);
            let norm = (mu1 * mu2).sqrt() / std::f64::consts::PI;
            if cz > 0.0 { norm * (-q).exp() / -(-a).exp_m1() * cz } else { 0.0 }
        };
        self.lobes.iter().map(|l| mean(&l.energy) / total * density(l)).sum()
    }
}

/// Clamps interpolated bandwidths to the bounds of a lobe.
fn clamp(lobe: Lobe) -> Lobe {
    let bound = |x: f64| x.clamp(MU_MIN.ln(), MU_MAX.ln());
    Lobe { ln_mu1: bound(lobe.ln_mu1), ln_mu2: bound(lobe.ln_mu2), ..lobe }
}

/// Energy of a lobe of amplitude 1, for comparisons.
pub fn unit(lobe: &Lobe) -> f64 {
    unit_energy(lobe.ln_mu1.exp(), lobe.ln_mu2.exp())
}
