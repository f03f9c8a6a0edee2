//! A fiber's scattering from a table (Xia 2020, 5 and 6): wave or ray optics over the azimuth, and d'Eon's
//! M_0 over the latitude.
//!
//! ```text
//! f(wi, wo, lambda) = M_0(theta_i, theta_o) N(theta_i, phi_i, phi_o, lambda)
//! ```
//!
//! f is an energy density: its integral over wo is the scattered fraction of the power that the fiber
//! intercepts, which per length is `C_e cos theta_i` times the flux across `wi`. With Xia's BCSDF S = M_0 N
//! the radiance that leaves a curve of width C_e is therefore
//! `integral L_i f cos theta_i / cos theta_o d wi`, and a path tracer whose rays hit that width uses `f`
//! alone as "BSDF times cosine".
//!
//! The width C_e depends on direction and wavelength. A host intersects a cylinder of
//! [`TabulatedFiber::max_width_um`], and [`TabulatedBsdf::hit`] decides whether the ray's offset from the
//! center line is within C_e / 2 (Xia 2020, 6).
//!
//! Departures from Xia: the table is linear in `phi_r - phi_i` instead of phi_r, so the forward peak remains
//! a single peak between nodes. Slices are mixed by their intercepted power, weight times width, which
//! conserves that power. Interpolation over lambda is linear too.
//!
//! Not modeled are cuticle tilt and separate lobes (one M_0 serves all light), polarization, and the width of
//! the beam across the fiber.

use crate::FiberQuery;
use crate::distributions::longitudinal::{Latitude, Longitudinal};
use crate::table::table::{self, FiberTable};
use plywave::Document;
use plywave::bsdf::{DirectionSample, Outcomes};
use plywave::frame::is_direction;
use plywave::{Bsdf, BsdfSample, Result};
use std::f32::consts::{FRAC_PI_2, TAU};
use std::path::Path;

/// Maximum ratio of C_e to the geometric width (Xia 2020, 6).
pub const WIDTH_LIMIT: f64 = 6.0;
/// Number of azimuthal cells for each stored sum, for sampling.
const BLOCK: usize = 16;

/// A loaded fiber table, prepared for evaluation.
///
/// Directions are unit vectors in the fiber's frame that point away from the fiber: z along it, x and y along
/// the axes of the outline. No call allocates, fails or panics. Wavelengths and latitudes beyond the nodes
/// are clamped to them. If an input is not finite, or a component of a direction is beyond 1.001, f = 0 and
/// no ray hits the fiber.
#[derive(Clone, Debug)]
pub struct TabulatedFiber {
    table: FiberTable,
    longitudinal: Longitudinal,
    /// `[L][T][P]` C_e [um], clamped to [`WIDTH_LIMIT`] times the geometric width.
    width_um: Vec<f32>,
    /// `[L][T][P]` ratio of scattered to extinguished light.
    albedo: Vec<f32>,
    /// `[L][T][P][blocks]` sums over [`BLOCK`] cells of the mean of their two nodes.
    sums: Vec<f32>,
    /// Number of relative azimuths D.
    cells: usize,
    blocks: usize,
    max_width_um: f32,
    clamped: f64,
    lambda_first: f32,
    lambda_per_um: f32,
    phi_first: f32,
    phi_per_rad: f32,
    turn: f32,
}

/// Slices of the table and their shares of the power, which sum to 1.
type Corners = [(u32, f32); 8];

/// A tabulated fiber at a query: one lookup serves any number of outgoing directions.
#[derive(Clone, Copy, Debug)]
pub struct TabulatedBsdf<'a, const N: usize> {
    fiber: &'a TabulatedFiber,
    /// Cosine and sine of phi_i; for light along the fiber phi_i is 0.
    azimuth: [f32; 2],
    latitude: Latitude,
    /// Corners for each wavelength; all shares are 0 if the input is not finite.
    corners: [Corners; N],
    /// Whether the slices store the mirrored azimuth.
    mirrored: bool,
    albedo: [f32; N],
    width_um: [f32; N],
}

impl TabulatedFiber {
    /// Reads and checks a fiber table.
    ///
    /// # Errors
    /// Those of [`FiberTable::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<TabulatedFiber> {
        Ok(TabulatedFiber::new(FiberTable::load(path)?))
    }

    /// Reads and checks a fiber table from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// Those of [`FiberTable::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<TabulatedFiber> {
        Ok(TabulatedFiber::new(FiberTable::from_bytes(bytes, name)?))
    }

    /// Builds a fiber from a table, without a file.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] if a file with it would be refused.
    pub fn from_table(table: FiberTable) -> Result<TabulatedFiber> {
        table.check("fiber table")?;
        Ok(TabulatedFiber::new(table))
    }

    fn new(table: FiberTable) -> TabulatedFiber {
        let (cells, p) = (table.phi_r_count(), table.phi_i.len());
        let blocks = cells.div_ceil(BLOCK);
        let slices = table.c_x_um.len();
        let limit = |s: usize| WIDTH_LIMIT * table.width_um[s % p];
        let width_um: Vec<f32> = (0..slices).map(|s| table.c_x_um[s].min(limit(s)) as f32).collect();
        let clamped = (0..slices).filter(|s| table.c_x_um[*s] > limit(*s)).count() as f64 / slices as f64;
        let mut sums = Vec::with_capacity(slices * blocks);
        let mut albedo = Vec::with_capacity(slices);
        for slice in table.azimuthal.chunks_exact(cells) {
            let mean = |j: usize| 0.5 * (f64::from(slice[j]) + f64::from(slice[(j + 1) % cells]));
            sums.extend((0..blocks).map(|b| (b * BLOCK..cells.min((b + 1) * BLOCK)).map(mean).sum::<f64>() as f32));
            albedo.push(((0..cells).map(mean).sum::<f64>() * std::f64::consts::TAU / cells as f64) as f32);
        }
        let l = table.lambda_um.len();
        let span = table.lambda_um[l - 1] - table.lambda_um[0];
        TabulatedFiber {
            longitudinal: Longitudinal::new(table.beta_m as f32),
            max_width_um: width_um.iter().copied().fold(0.0, f32::max),
            lambda_first: table.lambda_um[0] as f32,
            lambda_per_um: if l > 1 { ((l - 1) as f64 / span) as f32 } else { 0.0 },
            phi_first: table.phi_i[0] as f32,
            phi_per_rad: (1.0 / table.symmetry.step(p)) as f32,
            turn: TAU / table.symmetry.folds.max(1) as f32,
            table,
            width_um,
            albedo,
            sums,
            cells,
            blocks,
            clamped,
        }
    }

    /// The table as stored in the file.
    pub fn table(&self) -> &FiberTable {
        &self.table
    }

    /// The fiber with another longitudinal width [rad], clamped to [0.001, 2]; NaN becomes the minimum.
    pub fn with_beta_m(mut self, beta_m: f32) -> Self {
        self.table.beta_m = f64::from(beta_m).max(table::BETA_M.0).min(table::BETA_M.1);
        self.longitudinal = Longitudinal::new(self.table.beta_m as f32);
        self
    }

    /// Maximum C_e over all directions and wavelengths [um]: the diameter of the cylinder to intersect.
    pub fn max_width_um(&self) -> f32 {
        self.max_width_um
    }

    /// Share of the table's slices whose width is clamped to [`WIDTH_LIMIT`] times the geometric width.
    pub fn clamped_share(&self) -> f64 {
        self.clamped
    }

    /// The fiber at a query. If an input is not finite or `omega_i` is not a direction, no ray hits the fiber
    /// and no light is scattered.
    pub fn at<const N: usize>(&self, query: &FiberQuery<N>) -> TabulatedBsdf<'_, N> {
        let valid = is_direction(query.omega_i);
        let wi = if valid { query.omega_i } else { [1.0, 0.0, 0.0] };
        let latitude = Latitude::from_direction(wi);
        let azimuth = if latitude.cos > 0.0 { [wi[0] / latitude.cos, wi[1] / latitude.cos] } else { [1.0, 0.0] };
        let mut at = TabulatedBsdf {
            fiber: self,
            azimuth,
            latitude,
            corners: [[(0, 0.0); 8]; N],
            mirrored: false,
            albedo: [0.0; N],
            width_um: [0.0; N],
        };
        if !valid {
            return at;
        }
        let (nl, nt, np) = (self.table.lambda_um.len(), self.table.theta_i.len(), self.table.phi_i.len());
        let theta_i = latitude.sin.abs().atan2(latitude.cos);
        let (t, theta) = place(theta_i / FRAC_PI_2 * nt as f32 - 0.5, nt);
        let (p, phi, mirrored) = self.azimuth(azimuth[1].atan2(azimuth[0]), np);
        at.mirrored = mirrored;
        for n in 0..N {
            if !query.lambda_um[n].is_finite() {
                continue;
            }
            let (l, lambda) = place((query.lambda_um[n] - self.lambda_first) * self.lambda_per_um, nl);
            let corners = &mut at.corners[n];
            let mut width = 0.0;
            for (k, corner) in corners.iter_mut().enumerate() {
                let (a, b, c) = (k >> 2, k >> 1 & 1, k & 1);
                let slice = (l[a] * nt + t[b]) * np + p[c];
                let share = lambda[a] * theta[b] * phi[c] * self.width_um[slice];
                *corner = (slice as u32, share);
                width += share;
            }
            if width > 0.0 {
                corners.iter_mut().for_each(|(_, share)| *share /= width);
            }
            at.albedo[n] = corners.iter().map(|(slice, share)| share * self.albedo[*slice as usize]).sum();
            at.width_um[n] = width;
        }
        at
    }

    /// Nodes around the azimuth `phi`, their weights, and whether they store the mirrored azimuth.
    fn azimuth(&self, phi: f32, count: usize) -> ([usize; 2], [f32; 2], bool) {
        if self.table.symmetry.folds == 0 {
            return ([0, 0], [1.0, 0.0], false);
        }
        let x = (phi - self.phi_first).rem_euclid(self.turn);
        if self.table.symmetry.mirror_rad.is_none() {
            let at = x * self.phi_per_rad;
            let first = (at as usize).min(count - 1);
            let t = (at - first as f32).clamp(0.0, 1.0);
            return ([first, (first + 1) % count], [1.0 - t, t], false);
        }
        let mirrored = x > 0.5 * self.turn;
        let x = if mirrored { self.turn - x } else { x };
        let (nodes, weights) = place(x * self.phi_per_rad, count);
        (nodes, weights, mirrored)
    }
}

/// The two nodes around the position `at` in units of nodes, clamped to `count` nodes, and their weights.
fn place(at: f32, count: usize) -> ([usize; 2], [f32; 2]) {
    let last = count - 1;
    let at = at.clamp(0.0, last as f32);
    let first = (at as usize).min(last.saturating_sub(1));
    let t = at - first as f32;
    ([first, (first + 1).min(last)], [1.0 - t, t])
}

impl<const N: usize> TabulatedBsdf<'_, N> {
    /// C_e [um], one for each wavelength.
    pub fn width_um(&self) -> [f32; N] {
        self.width_um
    }

    /// Whether a ray hits the fiber at each wavelength, if it passes the center line at the distance
    /// `offset_um` on either side (Xia 2020, 6).
    pub fn hit(&self, offset_um: f32) -> [bool; N] {
        self.width_um.map(|width| offset_um.abs() <= 0.5 * width)
    }

    /// N(phi_o - phi_i) [1/rad] at the azimuth of `wo`, one for each wavelength.
    fn azimuthal(&self, wo: [f32; 3]) -> [f32; N] {
        let [x, y] = self.azimuth;
        let relative = (x * wo[1] - y * wo[0]).atan2(x * wo[0] + y * wo[1]);
        let relative = if self.mirrored { -relative } else { relative };
        let cells = self.fiber.cells;
        let at = relative.rem_euclid(TAU) * (cells as f32 / TAU);
        let j = (at as usize).min(cells - 1);
        let t = (at - j as f32).clamp(0.0, 1.0);
        let next = if j + 1 == cells { 0 } else { j + 1 };
        std::array::from_fn(|n| {
            let corners = &self.corners[n];
            (1.0 - t) * self.node(corners, j) + t * self.node(corners, next)
        })
    }

    fn node(&self, corners: &Corners, j: usize) -> f32 {
        let values = &self.fiber.table.azimuthal;
        corners.iter().map(|(slice, share)| share * values[*slice as usize * self.fiber.cells + j]).sum()
    }

    /// Sum of the albedos; a wavelength is sampled in proportion to its albedo.
    fn total(&self) -> f32 {
        self.albedo.iter().sum()
    }

    /// Density of samples where the scattering function is `f`.
    fn density(&self, f: &[f32; N]) -> f32 {
        let total = self.total();
        if total > 0.0 { f.iter().sum::<f32>() / total } else { 0.0 }
    }

    /// Samples a direction: first a wavelength, then its azimuth and the latitude.
    fn draw(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        let total = self.total();
        if !(total > 0.0 && u.iter().all(|v| (0.0..1.0).contains(v))) {
            return None;
        }
        let (mut remaining, mut chosen) = (u[0] * total, N - 1);
        for (n, albedo) in self.albedo.iter().enumerate() {
            if remaining < *albedo {
                chosen = n;
                break;
            }
            if n + 1 < N {
                remaining -= albedo;
            }
        }
        let albedo = self.albedo[chosen];
        // With one wavelength the number is used unchanged.
        let first = if N == 1 { u[0] } else { (remaining / albedo).min(1.0 - f32::EPSILON / 2.0) };
        if !(0.0..1.0).contains(&first) {
            return None;
        }
        let relative = self.invert(&self.corners[chosen], first);
        let latitude = self.fiber.longitudinal.sample(self.latitude, [u[1], u[2]]);
        let [x, y] = self.azimuth;
        let phi = y.atan2(x) + if self.mirrored { -relative } else { relative };
        let (sin, cos) = phi.sin_cos();
        Some([latitude.cos * cos, latitude.cos * sin, latitude.sin])
    }

    /// Relative azimuth below which the mixed slices contain the fraction `u` of their light [rad]. It is
    /// found by blocks, then by cells, then in closed form within a cell.
    fn invert(&self, corners: &Corners, u: f32) -> f32 {
        let (cells, blocks) = (self.fiber.cells, self.fiber.blocks);
        let block = |b: usize| -> f32 {
            corners.iter().map(|(slice, share)| share * self.fiber.sums[*slice as usize * blocks + b]).sum()
        };
        let mut remaining = u * (0..blocks).map(block).sum::<f32>();
        let mut b = 0;
        while b + 1 < blocks {
            let sum = block(b);
            if remaining < sum {
                break;
            }
            remaining -= sum;
            b += 1;
        }
        let end = cells.min((b + 1) * BLOCK);
        let mut j = b * BLOCK;
        let mut low = self.node(corners, j);
        // A remainder from rounding goes to the last cell with light.
        let mut chosen = (j, low, low, 0.0);
        while j < end {
            let high = self.node(corners, if j + 1 == cells { 0 } else { j + 1 });
            let sum = 0.5 * (low + high);
            if sum > 0.0 {
                chosen = (j, low, high, (remaining / sum).clamp(0.0, 1.0));
                if remaining < sum {
                    break;
                }
            }
            remaining -= sum;
            (j, low) = (j + 1, high);
        }
        let (j, low, high, x) = chosen;
        // Solves t (low + t (high - low) / 2) = x times the cell's whole mass.
        let root = (low * low + x * (high * high - low * low)).max(0.0).sqrt();
        let t = if low + root > 0.0 { x * (low + high) / (low + root) } else { x };
        (j as f32 + t.clamp(0.0, 1.0)) * TAU / cells as f32
    }
}

impl<const N: usize> Bsdf<N> for TabulatedBsdf<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        if !is_direction(w) {
            return [0.0; N];
        }
        let longitudinal = self.fiber.longitudinal.eval(self.latitude, Latitude::from_direction(w));
        self.azimuthal(w).map(|n| {
            let f = longitudinal * n;
            if f.is_finite() { f } else { 0.0 }
        })
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.density(&self.eval(w))
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        let f = self.eval(w);
        (f, self.density(&f))
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        match self.draw(u) {
            Some(w) => {
                let (f, pdf) = self.eval_pdf(w);
                if N == 1 {
                    // The density is f / albedo, so the weight is the albedo; this avoids a division of two
                    // values near 0.
                    BsdfSample::Scattered(DirectionSample { w, weight: self.albedo, pdf })
                } else {
                    BsdfSample::scattered(w, f, pdf)
                }
            }
            None => BsdfSample::Absorbed,
        }
    }

    /// Ratio of scattered to extinguished light; 1 for a lossless fiber.
    fn albedo(&self) -> [f32; N] {
        self.albedo
    }

    fn outcomes(&self) -> Outcomes {
        if self.total() > 0.0 { Outcomes::SCATTERED } else { Outcomes::ABSORBED }
    }
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<TabulatedFiber>();
};
