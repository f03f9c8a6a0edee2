//! Response of one circular cylinder, plain or of concentric layers, order by order, for [`crate::MieSolver`]
//! and [`crate::MultipoleSolver`].
//!
//! About the cylinder's center the fields of order n vary as `exp(i n phi)`. Exciting light has axial
//! amplitudes `a J_n`, scattered light `c H_n`, with two components (e, h) each, and `c = T_n a`. Boundary
//! matching goes from the inside out and passes on, at each wall, the two equations `A W = B V` between its
//! continuous axial fields V = (e, h) and the other two continuous quantities of the module's head:
//!
//! ```text
//! W_1 = (k_0 eps d_rho e + (i n k_z / rho) h) / kappa^2      W_2 = (k_0 d_rho h - (i n k_z / rho) e) / kappa^2
//! ```
//!
//! In one medium of index m they decouple: with `V = (sum g_s / m, sum i s g_s)` and
//! `W = (m sum w_s, sum i s w_s)`, s = +-1, the circular parts obey `w_s = lambda_s g_s`,
//! `m lambda_s = k F_n'/(kappa F_n) - s n k_z / (rho kappa^2)`. At grazing latitudes in air the two terms
//! cancel for one s; written with F_{n-1} or F_{n+1} they do not, and the two rows of A and B, of very
//! different size then, are never mixed. J and H carry binary exponents throughout, so orders far above the
//! size parameter, thick lossy layers and thin ones need no special treatment. (Bohren and Huffman 1983, 8.4,
//! give the plain cylinder's T as b_nI, a_nII and a_nI, up to sign.)

use crate::special::{Sequence, power_of_two};
use crate::{Body, C64, Shape, Wave, WaveError};
use std::f64::consts::PI;

pub(crate) type M2 = [[C64; 2]; 2];

const I: C64 = C64::new(0.0, 1.0);
const ZERO: C64 = C64::new(0.0, 0.0);

/// A circular body: radii and indices from the outermost layer inwards.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Circle {
    pub center_um: [f64; 2],
    pub layers: Vec<(f64, C64)>,
}

impl Circle {
    /// `name` is the body's key in the scene, `fiber[2]`.
    pub fn new(body: &Body, name: &str, method: &'static str) -> Result<Self, WaveError> {
        let mut layers: Vec<(f64, C64)> = Vec::new();
        let mut at = Some(body);
        let mut key = name.to_string();
        while let Some(b) = at {
            let Shape::Circle { radius_um } = b.shape else {
                let what = format!("{key} is no circle");
                return Err(WaveError::Unsupported { method, what, hint: "use \"nystrom\"".into() });
            };
            let invalid = |field: &str, value: f64, hint: &str| {
                Err(WaveError::Invalid { key: format!("{key}.{field}"), value: value.to_string(), hint: hint.into() })
            };
            if !(radius_um > 0.0 && radius_um.is_finite()) {
                return invalid("radius_um", radius_um, "use a positive radius");
            }
            if !(b.eta > 0.0 && b.eta.is_finite()) {
                return invalid("eta", b.eta, "use a positive index");
            }
            if !(b.kappa >= 0.0 && b.kappa.is_finite()) {
                return invalid("kappa", b.kappa, "use 0 or more");
            }
            let off = (b.center_um[0] - body.center_um[0]).hypot(b.center_um[1] - body.center_um[1]);
            if !off.is_finite() {
                return invalid("center_um", off, "use finite numbers");
            }
            if let Some(&(outer, _)) = layers.last() {
                if off + radius_um >= outer {
                    let second = key.rsplit_once('.').map_or(name.to_string(), |k| k.0.to_string());
                    return Err(WaveError::Overlap { first: key, second });
                }
                if off > 1e-12 * outer {
                    let what = format!("{key} is off its fiber's center");
                    return Err(WaveError::Unsupported { method, what, hint: "use \"nystrom\"".into() });
                }
            }
            layers.push((radius_um, b.index()));
            key.push_str(".lumen");
            at = b.lumen.as_deref();
        }
        Ok(Self { center_um: body.center_um, layers })
    }

    /// Outer radius [um].
    pub fn radius_um(&self) -> f64 {
        self.layers[0].0
    }
}

/// Responses of orders 0..=n of one cylinder. All amplitudes are scaled at the wall by the power of two next
/// to |H_n|, so that nothing overflows: exciting `a / s_n`, scattered `c s_n`, s_n = 2^exponent.
#[derive(Clone, Debug)]
pub(crate) struct Response {
    orders: Vec<Order>,
    radius_um: f64,
}

/// One order n >= 0.
#[derive(Clone, Copy, Debug)]
struct Order {
    /// s_n^2 T_n in the basis (e, h).
    t: M2,
    /// Axial fields at the wall over `a / s_n`.
    inside: M2,
    /// `(Y - Y^H) / 2i` of the wall's admittance from within.
    loss: M2,
    /// log2 s_n.
    exponent: i32,
}

impl Response {
    /// Computes the orders up to n; `hankel` holds H of the outside at the wall, at least to order n + 1.
    pub fn new(circle: &Circle, wave: &Wave, hankel: &Sequence, top: usize) -> Result<Self, WaveError> {
        let radius_um = circle.radius_um();
        let outside = Medium::new(wave, C64::new(1.0, 0.0));
        let bessel = Sequence::bessel(outside.kappa * radius_um, top + 1);
        // From the core outwards: each medium with its functions at its inner wall (none for the core) and at
        // its outer wall.
        let mut layers = Vec::with_capacity(circle.layers.len());
        for (i, &(radius, index)) in circle.layers.iter().enumerate().rev() {
            let medium = Medium::new(wave, index);
            if medium.kappa.norm() < 1e-9 * wave.k0() {
                return Err(WaveError::Invalid {
                    key: "eta".into(),
                    value: index.re.to_string(),
                    hint: "light travels along this fiber at this latitude; move either a little".into(),
                });
            }
            let begin = circle.layers.get(i + 1).map(|l| l.0);
            let at = |r: f64, hankel: bool| {
                let z = medium.kappa * r;
                if hankel { Sequence::hankel(z, top + 1) } else { Sequence::bessel(z, top + 1) }
            };
            let inner = begin.map(|r| (r, at(r, false), at(r, true)));
            let outer = (radius, at(radius, false), inner.as_ref().map(|_| at(radius, true)));
            layers.push((medium, inner, outer));
        }
        let orders = (0..=top as i64)
            .map(|n| {
                let mut wall = CircleWall { a: [[ZERO; 2]; 2], b: [[ZERO; 2]; 2] };
                for (medium, inner, (radius, j_out, h_out)) in &layers {
                    let j = medium.wave_at(j_out, n, *radius);
                    wall = if let (Some((begin, j_in, h_in)), Some(h_out)) = (inner, h_out) {
                        let reflected = medium.reflect(&wall, j_in, h_in, n, *begin);
                        let h = medium.wave_at(h_out, n, *radius);
                        // J + H T without the exponents of J at the outer wall: T is scaled by H at the inner
                        // one.
                        let shift = h_out.get(n).exponent - 2 * h_in.get(n).exponent - j_out.get(n).exponent;
                        let weight = power_of_two(shift);
                        let (mut v, mut w) = ([[ZERO; 2]; 2], [[ZERO; 2]; 2]);
                        for s in 0..2 {
                            for c in 0..2 {
                                let t = reflected[s][c] * weight;
                                v[s][c] = h.value * t;
                                w[s][c] = h.lambda[s] * t;
                            }
                            v[s][s] += j.value;
                            w[s][s] += j.lambda[s];
                        }
                        medium.wall_of_fields(&v, &w)
                    } else {
                        medium.wall_of_core(&j)
                    };
                }
                let t = cartesian(&outside.reflect(&wall, &bessel, hankel, n, radius_um));
                // Fields at the wall: (A lambda_H - B)^-1 A (lambda_H - lambda_J) J_n a; the difference is
                // the Wronskian 2 i k_0 / (pi kappa^2 R H_n J_n).
                let h = outside.wave_at(hankel, n, radius_um);
                let (a, b) = outside.circular(&wall);
                let m = [0, 1].map(|r| [0, 1].map(|s| a[r][s] * h.lambda[s] - b[r][s] * h.value));
                let wronskian = 2.0 * I * outside.k / (PI * outside.kappa * outside.kappa * radius_um);
                let inside = cartesian(&multiply(&inverse(&m), &a).map(|row| row.map(|x| x * wronskian)));
                let y = multiply(&inverse(&wall.a), &wall.b);
                let (mut t, mut inside, mut y) = (t, inside, y);
                if outside.kz == 0.0 {
                    // At normal incidence e and h decouple exactly.
                    for m in [&mut t, &mut inside, &mut y] {
                        (m[0][1], m[1][0]) = (ZERO, ZERO);
                    }
                }
                let half = 0.5 * I;
                let loss = [0, 1].map(|r| [0, 1].map(|c| half * (y[c][r].conj() - y[r][c])));
                Order { t, inside, loss, exponent: hankel.get(n).exponent }
            })
            .collect();
        Ok(Self { orders, radius_um })
    }

    /// Highest order.
    pub fn top(&self) -> usize {
        self.orders.len() - 1
    }

    /// log2 s_n.
    pub fn exponent(&self, n: i64) -> i32 {
        self.orders[n.unsigned_abs() as usize].exponent
    }

    /// `s_n^2 T_n`: from scaled exciting to scaled scattered amplitudes (e, h).
    pub fn t(&self, n: i64) -> M2 {
        mirrored(self.orders[n.unsigned_abs() as usize].t, n)
    }

    /// `T_n` itself.
    pub fn t_plain(&self, n: i64) -> M2 {
        let scale = power_of_two(-self.exponent(n));
        self.t(n).map(|row| row.map(|x| x * scale * scale))
    }

    /// Absorbed power per length over the incident |S| [um] of order n excited by `a / s_n`: the flux of
    /// `E x H*` through the wall, -2 pi R Im V* Y V, from the fields inside.
    pub fn absorbed_um(&self, n: i64, a: [C64; 2]) -> f64 {
        let order = &self.orders[n.unsigned_abs() as usize];
        let v = apply(&mirrored(order.inside, n), a);
        let w = apply(&mirrored(order.loss, n), v);
        -2.0 * PI * self.radius_um * (v[0].conj() * w[0] + v[1].conj() * w[1]).re
    }
}

/// Order -n from order n: e is even and h odd under y -> -y.
fn mirrored(mut m: M2, n: i64) -> M2 {
    if n < 0 {
        (m[0][1], m[1][0]) = (-m[0][1], -m[1][0]);
    }
    m
}

/// Wavenumbers in one medium [1/um].
struct Medium {
    index: C64,
    /// k_0 index.
    k: C64,
    kz: f64,
    kappa: C64,
}

/// A radial function and its admittance, without the exponent of the function.
struct RadialWave {
    value: C64,
    /// `lambda_s F_n / index` for s = +1, -1.
    lambda: [C64; 2],
}

impl Medium {
    fn new(wave: &Wave, index: C64) -> Self {
        Self { index, k: wave.k0() * index, kz: wave.kz(), kappa: wave.k_rho_in(index) }
    }

    /// F_n and lambda_s F_n at a wall of radius `r`, n >= 0.
    fn wave_at(&self, f: &Sequence, n: i64, r: f64) -> RadialWave {
        let at = f.get(n);
        let other = |m: i64| {
            let v = f.get(m);
            v.mantissa * power_of_two(v.exponent - at.exponent)
        };
        let slope = self.k / self.kappa;
        let lambda = [1.0, -1.0].map(|s| {
            // k +- s k_z = kappa^2 / (k -+ s k_z), without the cancellation.
            let rest = n as f64 / (r * (self.k + self.kz.abs())) * at.mantissa;
            let l = if s * self.kz < 0.0 { slope * other(n - 1) - rest } else { rest - slope * other(n + 1) };
            l / self.index
        });
        RadialWave { value: at.mantissa, lambda }
    }

    /// The equations of a wall for this medium's circular parts, `A w = B g`.
    fn circular(&self, wall: &CircleWall) -> (M2, M2) {
        let m = self.index;
        let part = |row: [C64; 2], scale: C64| {
            let (even, odd) = (row[0] * scale, I * row[1]);
            [even + odd, even - odd]
        };
        (wall.a.map(|row| part(row, m)), wall.b.map(|row| part(row, 1.0 / m)))
    }

    /// A wall within which this medium extends to the center: `F w_s = lambda_s F g_s`.
    fn wall_of_core(&self, j: &RadialWave) -> CircleWall {
        let m = self.index;
        let row = |s: usize, scale: C64, f: C64| [f * scale, if s == 0 { -I * f } else { I * f }];
        CircleWall { a: [0, 1].map(|s| row(s, 1.0 / m, j.value)), b: [0, 1].map(|s| row(s, m, j.lambda[s])) }.balanced()
    }

    /// A wall with the circular parts `v, w` of two independent solutions within, a column each: W V^-1 as
    /// A^-1 B by reciprocity: it equals its own transpose up to the sign of the off-diagonal elements.
    fn wall_of_fields(&self, v: &M2, w: &M2) -> CircleWall {
        let m = self.index;
        let rows = |x: &M2, scale: C64| [0, 1].map(|c| [(x[0][c] + x[1][c]) * scale, -I * (x[0][c] - x[1][c])]);
        CircleWall { a: rows(v, 1.0 / m), b: rows(w, m) }.balanced()
    }

    /// Reflection of J into H at a wall, from this medium outside of it, `s_n^2 T` in circular parts.
    fn reflect(&self, wall: &CircleWall, bessel: &Sequence, hankel: &Sequence, n: i64, r: f64) -> M2 {
        let (j, h) = (self.wave_at(bessel, n, r), self.wave_at(hankel, n, r));
        let (a, b) = self.circular(wall);
        // J carries exponent j, H exponent h: s J = 2^(j + h) mantissa.
        let weight = power_of_two(bessel.get(n).exponent + hankel.get(n).exponent);
        let left = [0, 1].map(|r| [0, 1].map(|s| a[r][s] * h.lambda[s] - b[r][s] * h.value));
        let right = [0, 1].map(|r| [0, 1].map(|s| (b[r][s] * j.value - a[r][s] * j.lambda[s]) * weight));
        multiply(&inverse(&left), &right)
    }
}

/// Two equations `A W = B V` at a wall.
struct CircleWall {
    a: M2,
    b: M2,
}

impl CircleWall {
    /// Rows scaled to size 1.
    fn balanced(mut self) -> Self {
        for r in 0..2 {
            let size = self.a[r].iter().chain(&self.b[r]).map(|x| x.norm()).fold(0.0, f64::max);
            for x in self.a[r].iter_mut().chain(&mut self.b[r]) {
                *x /= size;
            }
        }
        self
    }
}

/// `C c C^-1`: a matrix on circular parts as one on (e, h).
fn cartesian(c: &M2) -> M2 {
    let [[pp, pm], [mp, mm]] = *c;
    let half = 0.5;
    [
        [half * (pp + pm + mp + mm), -half * I * (pp - pm + mp - mm)],
        [half * I * (pp + pm - mp - mm), half * (pp - pm - mp + mm)],
    ]
}

fn multiply(a: &M2, b: &M2) -> M2 {
    [0, 1].map(|i| [0, 1].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

fn apply(a: &M2, v: [C64; 2]) -> [C64; 2] {
    [0, 1].map(|i| a[i][0] * v[0] + a[i][1] * v[1])
}

fn inverse(m: &M2) -> M2 {
    let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    [[m[1][1] / det, -m[0][1] / det], [-m[1][0] / det, m[0][0] / det]]
}

/// Orders above which `|J_n / H_n|` at x is below `cut`, the size of a cylinder's scattering off any
/// resonance.
pub(crate) fn order_for(x: f64, cut: f64) -> usize {
    // Beyond x both depend on alpha, cosh(alpha) = n/x: |J_n / H_n| ~ exp(-2 n (alpha - tanh alpha)) / 2
    // (Debye, DLMF 10.19.3).
    let mut n = x.ceil().max(1.0);
    loop {
        let alpha = (n / x).acosh();
        if 2.0 * n * (alpha - alpha.tanh()) > -cut.ln() {
            return n as usize + 2;
        }
        n += 1.0;
    }
}
