//! The twin of a cloth: path-traced scattering of its explicit fibers for some views, and the comparison of a
//! cloth model with it.
//!
//! `plywave twin` writes it, and `plywave check CLOTH --twin` compares with it. The twin shares no model with
//! the cloth: it contains only the fibers, their walls and the center lines of the yarns. Parallel light from
//! the view direction `a` falls uniformly on the cloth, from the face or from the back. The twin stores the
//! fraction of it that leaves in each direction `b`, as an energy density [1/sr] that includes the cosine at
//! `b`, like [`plywave::ClothModel`]'s `eval` with `wo = a`. Light that hits no fiber is stored separately as
//! `straight`.

mod compare;
mod file;

pub use compare::{Comparison, ComparisonOptions, Light, compare};

/// Bins of the whole sphere of equal solid angle: equal steps of z and of azimuth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SphereBins {
    /// Steps of z over [-1, 1]; even, so that no bin straddles the two halves. Row 0 is the lowest.
    pub rows: usize,
    /// Steps of the azimuth from x towards y over [0, 2 pi).
    pub columns: usize,
}

impl SphereBins {
    /// 12 rows of 48 bins in each half.
    pub const STANDARD: SphereBins = SphereBins { rows: 24, columns: 48 };

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.rows * self.columns
    }

    /// Whether there are no bins.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Solid angle of a bin [sr].
    pub fn solid_angle(&self) -> f64 {
        4.0 * std::f64::consts::PI / self.len().max(1) as f64
    }

    /// The bin that contains the unit direction `w`.
    pub fn bin(&self, w: [f32; 3]) -> usize {
        let row = ((0.5 * w[2] + 0.5).clamp(0.0, 1.0) * self.rows as f32) as usize;
        let turn = w[1].atan2(w[0]) / std::f32::consts::TAU;
        let column = ((turn - turn.floor()) * self.columns as f32) as usize;
        row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)
    }

    /// The direction at the fractions `u` of the bin's height and `v` of its width.
    pub fn direction(&self, bin: usize, u: f64, v: f64) -> [f32; 3] {
        let z = 2.0 * ((bin / self.columns) as f64 + u) / self.rows as f64 - 1.0;
        let (sin, cos) = (std::f64::consts::TAU * ((bin % self.columns) as f64 + v) / self.columns as f64).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        [(r * cos) as f32, (r * sin) as f32, z as f32]
    }

    /// Whether a bin lies in the half of the face's normal.
    pub fn is_up(&self, bin: usize) -> bool {
        2 * (bin / self.columns) >= self.rows
    }
}

/// Classes by the number of different yarns or plies that a path hit: 1, 2, and 3 or more.
pub const CLASSES: usize = 3;

/// The light that leaves the explicit fibers of a cloth. All arrays are flat, the last index fastest.
/// "Reflected" light leaves on the side of the cloth from which the light came, "transmitted" light on the
/// other.
#[derive(Clone, Debug, PartialEq)]
pub struct ClothTwin {
    /// The traced cloth: geometry of its yarns and the specs of their plies (docs/reference/format/cloth.md).
    pub spec_text: String,
    /// Program version that wrote it.
    pub program_version: String,
    /// Name of the cloth.
    pub name: String,
    /// Seed of the run.
    pub seed: u64,
    /// Size of one repeat along x and y [um].
    pub repeat_um: [f64; 2],
    /// Traced repeats along x and y.
    pub repeats: [u32; 2],
    /// `[view][3]`: unit directions from which the light comes, in the cloth's frame; light with z below 0
    /// hits the back.
    pub views: Vec<f64>,
    /// `[sigma][2]`: absorption coefficients of warp and weft [1/um].
    pub sigma_per_um: Vec<f64>,
    /// Bins of the outgoing sphere.
    pub bins: SphereBins,
    /// `[view]`: number of paths.
    pub paths: Vec<u64>,
    /// `[view]`: fraction that hit no fiber.
    pub straight: Vec<f64>,
    /// `[view]`: fraction in killed paths, whose end is unknown.
    pub killed: Vec<f64>,
    /// `[view]`: mean number of fiber walls that a path hit.
    pub interactions: Vec<f64>,
    /// `[view][sigma]`: reflected fraction.
    pub reflected: Vec<f64>,
    /// `[view][sigma]`: transmitted fraction, without the straight light.
    pub transmitted: Vec<f64>,
    /// `[view][sigma]`: standard errors of `reflected`.
    pub reflected_se: Vec<f64>,
    /// `[view][sigma]`: standard errors of `transmitted`.
    pub transmitted_se: Vec<f64>,
    /// `[view][sigma][half][class]`: reflected (0) and transmitted (1) light by the number of different yarns
    /// hit.
    pub by_yarns: Vec<f64>,
    /// `[view][sigma][half][class]`: reflected and transmitted light by the number of different plies hit.
    pub by_plies: Vec<f64>,
    /// `[view][sigma][row][column]`: mean energy density of a bin [1/sr].
    pub density: Vec<f32>,
    /// Variances of `density` [1/sr^2], in the same order.
    pub variance: Vec<f32>,
    /// `[view][sigma][y][x]`: reflected light by the point at which its line crosses the middle plane, over
    /// one repeat.
    pub image: Vec<f32>,
    /// Size of the image along x and y.
    pub image_size: [usize; 2],
}

impl ClothTwin {
    /// Number of views.
    pub fn view_count(&self) -> usize {
        self.views.len() / 3
    }

    /// Number of pairs of absorptions.
    pub fn sigma_count(&self) -> usize {
        self.sigma_per_um.len() / 2
    }

    /// Direction of a view.
    pub fn view(&self, view: usize) -> [f64; 3] {
        std::array::from_fn(|k| self.views[3 * view + k])
    }

    /// Absorptions of warp and weft [1/um].
    pub fn sigma(&self, sigma: usize) -> [f64; 2] {
        [self.sigma_per_um[2 * sigma], self.sigma_per_um[2 * sigma + 1]]
    }

    /// Energies of a view and a pair of absorptions.
    pub fn light(&self, view: usize, sigma: usize) -> Light {
        let at = view * self.sigma_count() + sigma;
        Light { reflected: self.reflected[at], transmitted: self.transmitted[at], straight: self.straight[view] }
    }

    /// Standard errors of the reflected and the transmitted light.
    pub fn standard_errors(&self, view: usize, sigma: usize) -> [f64; 2] {
        let at = view * self.sigma_count() + sigma;
        [self.reflected_se[at], self.transmitted_se[at]]
    }

    /// `[bin]`: densities [1/sr] and their variances of a view and a pair of absorptions.
    pub fn distribution(&self, view: usize, sigma: usize) -> (&[f32], &[f32]) {
        let n = self.bins.len();
        let at = (view * self.sigma_count() + sigma) * n;
        (&self.density[at..at + n], &self.variance[at..at + n])
    }
}
