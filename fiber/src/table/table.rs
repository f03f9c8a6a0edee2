//! The scattering table of a fiber and its file (`.pwf`, `docs/reference/format/models.md`).
//!
//! A table holds the azimuthal scattering N and the intercepted width C_x of Xia 2020, 5, from wave or ray
//! optics, over wavelength and incident direction.

use plywave::Result;
use plywave::io::{Axis, Check, Document, FileKind, Provenance, Reader, Summary, Writer, invalid};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Minimum and maximum longitudinal width [rad].
pub(crate) const BETA_M: (f64, f64) = (1e-3, 2.0);
/// Maximum difference between extinction and scattered plus absorbed light, relative to the extinction: the
/// error of a coarse solve, and Monte Carlo noise.
pub(crate) const LEDGER: f64 = 0.02;

/// The optics by which a table was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FiberSource {
    /// Wave optics; widths are extinction widths.
    Wave,
    /// Ray optics; widths are geometric.
    Ray,
}

/// Symmetry of an outline, which determines the range of azimuths that a table stores.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OutlineSymmetry {
    /// Rotation by 2 pi / folds leaves the outline unchanged; 0 for a circle, 1 for no such symmetry.
    pub folds: u32,
    /// Azimuth [rad], in [0, pi), of a line through the center about which the outline is mirror-symmetric;
    /// `None` if there is no such line.
    pub mirror_rad: Option<f64>,
}

impl OutlineSymmetry {
    /// A circle.
    pub const CIRCLE: OutlineSymmetry = OutlineSymmetry { folds: 0, mirror_rad: None };
    /// No symmetry.
    pub const NONE: OutlineSymmetry = OutlineSymmetry { folds: 1, mirror_rad: None };

    /// The `count` azimuths phi_i of a table [rad]. A circle has one. If there is a mirror line, they go from
    /// mirror line to mirror line with both ends, `mirror + pi k / (folds (count - 1))`. Otherwise they cover
    /// one period of the outline without its end, `2 pi k / (folds count)`.
    pub fn phi_i(&self, count: usize) -> Vec<f64> {
        let step = self.step(count);
        (0..count).map(|k| self.mirror_rad.unwrap_or(0.0) + step * k as f64).collect()
    }

    /// Distance between the azimuths of a table [rad].
    pub fn step(&self, count: usize) -> f64 {
        match (self.folds, self.mirror_rad) {
            (0, _) => TAU,
            (n, Some(_)) => PI / (f64::from(n) * (count - 1).max(1) as f64),
            (n, None) => TAU / (f64::from(n) * count.max(1) as f64),
        }
    }

    /// Number of azimuths that a table needs so that their density is that of `full` around the fiber; at
    /// least 2 between mirror lines.
    pub fn count(&self, full: usize) -> usize {
        match (self.folds as usize, self.mirror_rad) {
            (0, _) => 1,
            (n, Some(_)) => full.div_ceil(2 * n) + 1,
            (n, None) => full.div_ceil(n).max(1),
        }
    }
}

/// Scattering of a fiber for light of any direction and wavelength: Xia's N_wave and C_x, or their ray-optics
/// counterparts (Xia 2020, 5). Arrays are flat, last index fastest, with L wavelengths, T latitudes, P
/// azimuths and D relative azimuths.
///
/// The frame is the fiber's: z points along the fiber, x and y along the axes of the outline. Directions
/// point away from the fiber, and theta is the latitude above the plane of the cross section. A straight
/// fiber scatters light from theta_i and -theta_i alike, so theta_i >= 0 suffices.
#[derive(Clone, Debug, PartialEq)]
pub struct FiberTable {
    /// Text of the spec or scene that was computed, verbatim.
    pub spec_text: String,
    /// Version of the program that wrote the table.
    pub program_version: String,
    /// Name of the preset, for information.
    pub preset: String,
    /// Seed of the random numbers (rays only).
    pub seed: u64,
    /// The optics by which the table was computed.
    pub source: FiberSource,
    /// Symmetry of the outline.
    pub symmetry: OutlineSymmetry,
    /// Longitudinal width [rad]: M_0 has the variance beta_m^2. Xia's model takes it from another source, and
    /// a host may replace it.
    pub beta_m: f64,
    /// `[L]` wavelengths [um], uniform and ascending: centers of the averaged bands. A single wavelength
    /// represents all.
    pub lambda_um: Vec<f64>,
    /// `[T]` latitudes [rad]: centers of T equal intervals of [0, pi/2].
    pub theta_i: Vec<f64>,
    /// `[P]` azimuths [rad], from [`OutlineSymmetry::phi_i`].
    pub phi_i: Vec<f64>,
    /// `[P]` geometric width of the fiber seen from phi_i [um].
    pub width_um: Vec<f64>,
    /// `[L][T][P]` width over which the fiber intercepts light, C_e of Xia 2020, 5.1 [um]: the extinction
    /// divided by the irradiance on a plane through the axis, which is the incident flux times cos theta_i.
    /// For rays it is the geometric width.
    pub c_x_um: Vec<f64>,
    /// `[L][T][P]` the part of that width whose light is absorbed [um], computed directly and not as a
    /// difference.
    pub c_abs_um: Vec<f64>,
    /// `[L][T][P][D]` scattered intensity over the azimuth as a fraction of the extinguished power [1/rad],
    /// unpolarized (Xia 2020, Eq. 31), at `phi_r = phi_i + 2 pi j / D`, linear between these azimuths. D is
    /// at least 2.
    pub azimuthal: Vec<f32>,
}

const NAMES: [&str; 7] = ["lambda_um", "theta_i", "phi_i", "width_um", "c_x_um", "c_abs_um", "azimuthal"];

/// Keys of the JSON document besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct FiberKeys {
    source: FiberSource,
    symmetry: OutlineSymmetry,
    beta_m_rad: f64,
}

impl FiberTable {
    /// Centers of `count` equal intervals of [0, pi/2] [rad].
    pub fn theta_nodes(count: usize) -> Vec<f64> {
        (0..count).map(|m| FRAC_PI_2 * (m as f64 + 0.5) / count as f64).collect()
    }

    /// Number of relative azimuths D.
    pub fn phi_r_count(&self) -> usize {
        self.azimuthal.len() / self.c_x_um.len().max(1)
    }

    /// Ratio of scattered to extinguished light in slice `(l, t, p)`, given as one flat index.
    pub fn slice_albedo(&self, slice: usize) -> f64 {
        let d = self.phi_r_count();
        let sum: f64 = self.azimuthal[slice * d..(slice + 1) * d].iter().map(|v| f64::from(*v)).sum();
        sum * TAU / d as f64
    }

    /// Maximum of |scattered + absorbed - extinguished| relative to the extinguished light.
    pub fn ledger_error(&self) -> f64 {
        (0..self.c_x_um.len()).map(|s| self.ledger(s).abs()).fold(0.0, f64::max)
    }

    fn ledger(&self, slice: usize) -> f64 {
        self.slice_albedo(slice) + self.c_abs_um[slice] / self.c_x_um[slice] - 1.0
    }

    /// Checks that a table is valid. Reading and writing call this.
    pub(crate) fn check(&self, name: &str) -> Result<()> {
        let c = Check(name);
        let (l, t, p) = (self.lambda_um.len(), self.theta_i.len(), self.phi_i.len());
        for (axis, size) in [("lambda_um", l), ("theta_i", t), ("phi_i", p)] {
            if size == 0 {
                return Err(invalid(name, axis, "0 values", "expected at least 1"));
            }
        }
        c.len("c_x_um", self.c_x_um.len(), &[l, t, p])?;
        let d = self.phi_r_count();
        if d < 2 {
            return Err(invalid(name, "azimuthal", format!("{d} relative azimuths"), "expected at least 2"));
        }
        c.len("azimuthal", self.azimuthal.len(), &[l, t, p, d])?;
        c.range("beta_m_rad", &[self.beta_m], BETA_M.0, BETA_M.1)?;
        c.uniform("lambda_um", &self.lambda_um)?;
        c.range("lambda_um", &self.lambda_um, 1e-3, 1e3)?;
        self.check_symmetry(name)?;
        equal(name, "theta_i", &self.theta_i, &FiberTable::theta_nodes(t))?;
        equal(name, "phi_i", &self.phi_i, &self.symmetry.phi_i(p))?;
        c.len("width_um", self.width_um.len(), &[p])?;
        c.range("width_um", &self.width_um, 1e-6, 1e6)?;
        c.range("c_x_um", &self.c_x_um, 1e-12, 1e7)?;
        c.len("c_abs_um", self.c_abs_um.len(), &[l, t, p])?;
        c.range("c_abs_um", &self.c_abs_um, -1e7, 1e7)?;
        c.range_f32("azimuthal", &self.azimuthal, 0.0, f32::MAX)?;
        for s in 0..self.c_x_um.len() {
            let (albedo, absorbed) = (self.slice_albedo(s), self.c_abs_um[s] / self.c_x_um[s]);
            // NaN fails too.
            if !((albedo + absorbed - 1.0).abs() <= LEDGER && absorbed >= -LEDGER) {
                let key = format!("azimuthal[{}, {}, {}]", s / (t * p), s / p % t, s % p);
                let value = format!("{albedo} scattered, {absorbed} absorbed of 1 extinguished");
                return Err(invalid(
                    name,
                    &key,
                    value,
                    &format!("the sum must be 1 within {LEDGER}, no part negative"),
                ));
            }
        }
        Ok(())
    }

    fn check_symmetry(&self, name: &str) -> Result<()> {
        let s = &self.symmetry;
        let p = self.phi_i.len();
        if s.folds > 360 {
            return Err(invalid(name, "symmetry.folds", s.folds, "expected 0 (a circle) to 360"));
        }
        if let Some(mirror) = s.mirror_rad {
            Check(name).range("symmetry.mirror_rad", &[mirror], 0.0, PI)?;
        }
        let fits = match (s.folds, s.mirror_rad) {
            (0, mirror) => p == 1 && mirror.is_none(),
            (_, Some(_)) => p >= 2,
            _ => true,
        };
        if fits {
            return Ok(());
        }
        let hint = "expected 1 and no mirror for a circle, 2 or more with a mirror";
        Err(invalid(name, "phi_i", format!("{p} values with symmetry {s:?}"), hint))
    }
}

impl Document for FiberTable {
    const KIND: FileKind = FileKind::Fiber;
    type Keys = FiberKeys;

    fn names() -> Vec<&'static str> {
        NAMES.to_vec()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.preset.clone(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<FiberKeys> {
        Ok(FiberKeys { source: self.source, symmetry: self.symmetry, beta_m_rad: self.beta_m })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let (l, t, p, d) = (self.lambda_um.len(), self.theta_i.len(), self.phi_i.len(), self.phi_r_count());
        let slices = || 0..self.c_x_um.len();
        let axes = vec![
            Axis::new("lambda_um", "um", l),
            Axis::new("theta_i", "rad", t),
            Axis::new("phi_i", "rad", p),
            Axis::new("phi_r - phi_i", "rad", d),
        ];
        let statistics = serde_json::json!({
            "c_x_um": Summary::from_values(self.c_x_um.iter().copied()),
            "c_x_over_width": Summary::from_values(slices().map(|s| self.c_x_um[s] / self.width_um[s % p])),
            "albedo": Summary::from_values(slices().map(|s| self.slice_albedo(s))),
            "ledger": Summary::from_values(slices().map(|s| self.ledger(s))),
        });
        (axes, statistics)
    }

    fn tensors(&self, w: &mut Writer) {
        let (l, t, p, d) = (self.lambda_um.len(), self.theta_i.len(), self.phi_i.len(), self.phi_r_count());
        w.f64("lambda_um", &[l], &self.lambda_um);
        w.f64("theta_i", &[t], &self.theta_i);
        w.f64("phi_i", &[p], &self.phi_i);
        w.f64("width_um", &[p], &self.width_um);
        w.f64("c_x_um", &[l, t, p], &self.c_x_um);
        w.f64("c_abs_um", &[l, t, p], &self.c_abs_um);
        w.f32("azimuthal", &[l, t, p, d], self.azimuthal.iter().copied());
    }

    fn read(r: &Reader<'_>, provenance: Provenance, keys: &FiberKeys) -> Result<FiberTable> {
        let shape = r.shape("azimuthal", 4)?;
        let [l, t, p, d] = [shape[0], shape[1], shape[2], shape[3]];
        Ok(FiberTable {
            spec_text: provenance.spec,
            program_version: provenance.program_version,
            preset: provenance.preset,
            seed: provenance.seed,
            source: keys.source,
            symmetry: keys.symmetry,
            beta_m: keys.beta_m_rad,
            lambda_um: r.f64("lambda_um", &[l])?,
            theta_i: r.f64("theta_i", &[t])?,
            phi_i: r.f64("phi_i", &[p])?,
            width_um: r.f64("width_um", &[p])?,
            c_x_um: r.f64("c_x_um", &[l, t, p])?,
            c_abs_um: r.f64("c_abs_um", &[l, t, p])?,
            azimuthal: r.f32("azimuthal", &[l, t, p, d])?,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        FiberTable::check(self, name)
    }
}

/// Checks that an axis equals the one that its rule yields, up to rounding.
fn equal(name: &str, key: &str, axis: &[f64], rule: &[f64]) -> Result<()> {
    match axis.iter().zip(rule).position(|(a, b)| (a - b).abs() > 1e-9 || a.is_nan()) {
        None => Ok(()),
        Some(i) => Err(invalid(name, &format!("{key}[{i}]"), axis[i], &format!("expected {}", rule[i]))),
    }
}
