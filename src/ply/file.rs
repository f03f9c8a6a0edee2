//! Ply model files: writing, reading and checking (`docs/reference/format/models.md`).

use super::data::ENERGY_TOLERANCE;
use super::data::drift;
use super::data::edge_lobes::{self, EdgeLobes};
use super::data::exits::{self, ExitOffsets};
use super::data::layer_factors::{self, LayerFactors};
use super::model::ReferenceValue;
use crate::frame::direction;
use crate::io::{Axis, Check, Document, FileKind, ModelLibrary, Provenance, Reader, Summary, Writer, invalid};
use crate::ply::asg::PARAMS;
use crate::ply::cone::{CONE_OFFSET_MAX, LobeKind};
use crate::ply::speckle::{NOISE_NAMES, NoiseSpectrum};
use crate::ply::{EnergiesAt, PlyData, PlyEnergies, PlyModel, PlyQuery};
use crate::{Bsdf, Result};
use std::path::Path;

/// Tensors of every model.
const NAMES: [&str; 14] = [
    "theta_i",
    "h_um",
    "sigma_per_um",
    "path_um",
    "miss_theta_i",
    "miss_h_um",
    "miss",
    "share_theta_i",
    "share_h_um",
    "share_refl",
    "share_high",
    "high_path",
    "error_refl",
    "error_high",
];

/// Names of the lobe tensors of f_refl and f_high, by kind of lobe. The names differ so that a reader of one
/// kind refuses files of the other.
const LOBES: [(LobeKind, [&str; 2]); 2] =
    [(LobeKind::Round, ["refl", "high"]), (LobeKind::Cone, ["cone_refl", "cone_high"])];

/// Names of the tensors of f_refl and of f_high.
fn lobe_names(family: LobeKind) -> [&'static str; 2] {
    LOBES[usize::from(family == LobeKind::Cone)].1
}

/// Maximum number of nodes of an axis of incidence.
const MAX_NODES: usize = 4095;
/// Minimum step of an axis of incidence [rad, um]: its inverse is finite in f32.
const MIN_STEP: f64 = 1e-6;

/// Keys of the JSON document besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct ModelKeys {
    /// Written for people who read the header; on loading, the names of the tensors determine it.
    #[serde(skip_deserializing)]
    family: &'static str,
    #[serde(skip_deserializing)]
    lobes_refl: usize,
    #[serde(skip_deserializing)]
    lobes_high: usize,
    /// Earlier files call it `golden`.
    #[serde(default, alias = "golden")]
    reference_values: Vec<ReferenceValue>,
}

impl PlyModel {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// Those of [`PlyData::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<PlyModel> {
        let path = path.as_ref();
        PlyModel::from_bytes(&crate::io::read_bytes(path)?, &path.display().to_string())
    }

    /// Reads and checks a model from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// Those of [`PlyData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<PlyModel> {
        let (data, reference_values) = read(bytes, name)?;
        Ok(PlyModel::from_parts(data, reference_values))
    }
}

impl ModelLibrary {
    /// Loads a model from its file, or a model of the library by its name.
    ///
    /// # Errors
    /// Those of [`ModelLibrary::read`] and [`PlyModel::from_bytes`].
    pub fn load(&self, path: impl AsRef<Path>) -> Result<PlyModel> {
        let (shown, bytes) = self.read(path)?;
        PlyModel::from_bytes(&bytes, &shown)
    }
}

impl PlyData {
    /// The sizes M, H, K, J: latitudes, offsets, absorptions and path lengths.
    pub fn sizes(&self) -> (usize, usize, usize, usize) {
        (self.theta_i.len(), self.h_um.len(), self.sigma_per_um.len(), self.path_um.len())
    }

    /// The model with its energies rounded as in a file, so that writing a loaded model gives the same bytes.
    fn as_stored(&self) -> PlyData {
        PlyData { energies: self.energies.rounded(), ..self.clone() }
    }

    /// Energies at the nodes of the lobes, `[M][H]`.
    pub fn node_energies(&self) -> Vec<EnergiesAt> {
        self.theta_i.iter().flat_map(|t| self.h_um.iter().map(|h| self.energies.at(*t, *h))).collect()
    }
}

impl Document for PlyData {
    const KIND: FileKind = FileKind::Model;
    type Keys = ModelKeys;

    fn names() -> Vec<&'static str> {
        let parts = [
            &NAMES[..],
            &LOBES[0].1,
            &LOBES[1].1,
            &layer_factors::NAMES,
            &exits::NAMES,
            &drift::NAMES,
            &edge_lobes::NAMES,
        ]
        .concat();
        parts.into_iter().chain(NOISE_NAMES).collect()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.preset.clone(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, name: &str) -> Result<ModelKeys> {
        let reference_values = reference_values(&PlyModel::from_data_named(self.as_stored(), name)?);
        Ok(ModelKeys {
            family: self.family.name(),
            lobes_refl: self.lobes_refl,
            lobes_high: self.lobes_high,
            reference_values,
        })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let (m, h, k, j) = self.sizes();
        let axes = vec![
            Axis::new("theta_i", "rad", m),
            Axis::new("h_um", "um", h),
            Axis::new("sigma_per_um", "1/um", k),
            Axis::new("path_um", "um", j),
            Axis::new("miss_theta_i", "rad", self.energies.miss_theta_i.len()),
            Axis::new("miss_h_um", "um", self.energies.miss_h_um.len()),
            Axis::new("share_theta_i", "rad", self.energies.share_theta_i.len()),
            Axis::new("share_h_um", "um", self.energies.share_h_um.len()),
        ];
        let nodes = self.as_stored().node_energies();
        let statistics = serde_json::json!({
            "r_d": Summary::from_values(nodes.iter().map(|e| e.r_d)),
            "energy_refl": Summary::from_values(nodes.iter().map(|e| e.refl)),
            "energy_high_sigma_0": Summary::from_values(nodes.iter().map(|e| e.high.iter().sum())),
            "error_refl": Summary::from_values(self.error_refl.iter().copied()),
            "error_high": Summary::from_values(self.error_high.iter().copied()),
        });
        (axes, statistics)
    }

    fn tensors(&self, w: &mut Writer) {
        let (m, h, k, j) = self.sizes();
        let (bm, bh, lr, lh) = (m / 2, h / 2, self.lobes_refl, self.lobes_high);
        w.f64("theta_i", &[m], &self.theta_i);
        w.f64("h_um", &[h], &self.h_um);
        w.f64("sigma_per_um", &[k], &self.sigma_per_um);
        w.f64("path_um", &[j], &self.path_um);
        self.energies.write(w, j);
        w.f64("error_refl", &[m, h], &self.error_refl);
        w.f64("error_high", &[m, h, k], &self.error_high);
        let [refl, high] = lobe_names(self.family);
        w.f32(refl, &[m, h, lr, PARAMS], self.refl.iter().map(|v| *v as f32));
        w.f32(high, &[bm, bh, 2, 2, lh, PARAMS], self.high.iter().map(|v| *v as f32));
        w.f32("high_path", &[bm, bh, 2, 2, lh, j], self.high_path.iter().map(|v| *v as f32));
        if let Some(layers) = &self.layers {
            layers.write(w, (m, h, j));
        }
        if let Some(exits) = &self.exits {
            exits.write(w, (m, h, k));
        }
        if let Some(edge) = &self.edge {
            edge.write(w);
        }
        if let Some(noise) = &self.noise {
            noise.write(w);
        }
    }

    fn read(r: &Reader<'_>, provenance: Provenance, keys: &ModelKeys) -> Result<PlyData> {
        for (i, g) in keys.reference_values.iter().enumerate() {
            let numbers = [g.theta_i, g.h_um].into_iter().chain(g.sigma_per_um).chain(g.wo).chain(g.value);
            if let Some(v) = numbers.into_iter().find(|v| !v.is_finite()) {
                return Err(invalid(r.file(), &format!("reference_values[{i}]"), v, "expected finite numbers"));
            }
        }
        let (m, h, k, j) = (
            r.shape("theta_i", 1)?[0],
            r.shape("h_um", 1)?[0],
            r.shape("sigma_per_um", 1)?[0],
            r.shape("path_um", 1)?[0],
        );
        let family = read_family(r)?;
        let [refl, high] = lobe_names(family);
        let (lr, lh) = (r.shape(refl, 4)?[2], r.shape(high, 6)?[4]);
        check_sizes(r.file(), (m, h, k, j), (lr, lh))?;
        let (bm, bh) = (m / 2, h / 2);
        Ok(PlyData {
            spec_text: provenance.spec,
            program_version: provenance.program_version,
            preset: provenance.preset,
            seed: provenance.seed,
            theta_i: r.f64("theta_i", &[m])?,
            h_um: r.f64("h_um", &[h])?,
            sigma_per_um: r.f64("sigma_per_um", &[k])?,
            path_um: r.f64("path_um", &[j])?,
            family,
            lobes_refl: lr,
            lobes_high: lh,
            energies: PlyEnergies::read(r, j)?,
            refl: r.f64(refl, &[m, h, lr, PARAMS])?,
            high: r.f64(high, &[bm, bh, 2, 2, lh, PARAMS])?,
            high_path: r.f64("high_path", &[bm, bh, 2, 2, lh, j])?,
            error_refl: r.f64("error_refl", &[m, h])?,
            error_high: r.f64("error_high", &[m, h, k])?,
            layers: LayerFactors::read(r, (m, h, j))?,
            exits: ExitOffsets::read(r, (m, h, k))?,
            edge: EdgeLobes::read(r)?,
            noise: NoiseSpectrum::read(r)?,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        PlyData::check(self, name)
    }
}

impl PlyData {
    /// Checks the parts of a model that do not depend on its lobes: the numbers of lobes, the axes, the
    /// absorption, the energies, and the edge lobes if there are any. Lobes, their spectra and their errors
    /// are not checked and may be absent, so a fit can call this before it starts. `name` identifies the
    /// model in messages.
    ///
    /// # Errors
    /// [`Error::Invalid`](crate::Error::Invalid), the same that saving returns.
    pub fn check_frame(&self, name: &str) -> Result<()> {
        let c = Check(name);
        let (m, h, k, j) = self.sizes();
        check_sizes(name, (m, h, k, j), (self.lobes_refl, self.lobes_high))?;
        c.theta_axis(&self.theta_i)?;
        c.h_axis(&self.h_um)?;
        for (key, axis) in [("theta_i[1]", &self.theta_i), ("h_um[1]", &self.h_um)] {
            if axis[1] - axis[0] < MIN_STEP {
                return Err(invalid(name, key, axis[1], &format!("expected steps of at least {MIN_STEP}")));
            }
        }
        c.sigma_axis(&self.sigma_per_um)?;
        c.ascending("path_um", &self.path_um)?;
        c.range("path_um", &self.path_um, 0.0, 1e9)?;
        self.energies.check(&c, [self.theta_i[m - 1], self.h_um[h - 1]], j)?;
        if let Some(edge) = &self.edge {
            edge.check(&c)?;
        }
        Ok(())
    }

    /// Checks that a model is valid. Reading and writing call this.
    pub(crate) fn check(&self, name: &str) -> Result<()> {
        self.check_frame(name)?;
        let c = Check(name);
        let (m, h, k, j) = self.sizes();
        let (bm, bh, lr, lh) = (m / 2, h / 2, self.lobes_refl, self.lobes_high);
        for (key, values, shape) in
            [("error_refl", &self.error_refl, &[m, h][..]), ("error_high", &self.error_high, &[m, h, k])]
        {
            c.len(key, values.len(), shape)?;
            c.range(key, values, 0.0, f64::MAX)?;
        }
        c.len("refl", self.refl.len(), &[m, h, lr, PARAMS])?;
        c.len("high", self.high.len(), &[bm, bh, 2, 2, lh, PARAMS])?;
        c.len("high_path", self.high_path.len(), &[bm, bh, 2, 2, lh, j])?;
        let [refl, high] = lobe_names(self.family);
        check_lobes(name, self.family, refl, &self.refl)?;
        check_lobes(name, self.family, high, &self.high)?;
        c.range("high_path", &self.high_path, 0.0, 1.0 + 1e-3)?;
        for (i, p) in self.high_path.chunks_exact(j).enumerate() {
            let sum: f64 = p.iter().sum();
            if (sum - 1.0).abs() > 1e-3 {
                return Err(invalid(name, &format!("high_path of lobe {i}"), sum, "a spectrum must add up to 1"));
            }
        }
        if let Some(exits) = &self.exits {
            exits.check(&c, (m, h, k))?;
        }
        if let Some(layers) = &self.layers {
            layers.check(&c, &self.energies, [&self.theta_i, &self.h_um], j)?;
        }
        if let Some(noise) = &self.noise {
            noise.check(&c)?;
        }
        Ok(())
    }
}

/// Checks the sizes M, H, K, J and the numbers of lobes before anything is computed with them.
fn check_sizes(name: &str, (m, h, k, j): (usize, usize, usize, usize), (lr, lh): (usize, usize)) -> Result<()> {
    for (axis, size) in [("theta_i", m), ("h_um", h)] {
        if size < 3 || size % 2 == 0 {
            return Err(invalid(name, axis, format!("{size} values"), "expected an odd number, at least 3"));
        }
        if size > MAX_NODES {
            return Err(invalid(name, axis, format!("{size} values"), &format!("expected at most {MAX_NODES}")));
        }
    }
    for (key, size, limit) in [
        ("sigma_per_um values", k, 1024),
        ("path_um values", j, crate::ply::MAX_PATHS),
        ("lobes_refl", lr, crate::ply::MAX_LOBES),
        ("lobes_high", lh, crate::ply::MAX_LOBES),
    ] {
        if size == 0 || size > limit {
            return Err(invalid(name, key, size, &format!("expected 1 to {limit}")));
        }
    }
    Ok(())
}

/// The kind of lobe that the tensors of a file have.
fn read_family(r: &Reader<'_>) -> Result<LobeKind> {
    let has = LOBES.map(|(_, names)| names.iter().any(|name| r.has(name)));
    if has == [true, true] {
        return Err(invalid(r.file(), "refl, cone_refl", "both", "a model is made of round lobes or of cones"));
    }
    Ok(LOBES[usize::from(has[1])].0)
}

/// Checks that angles are within +-100 rad, which f32 resolves to 1e-5, and that bandwidths and energies are
/// within their ranges.
fn check_lobes(name: &str, family: LobeKind, key: &str, lobes: &[f64]) -> Result<()> {
    // Rounding to f32 may move a bandwidth slightly past its bound.
    let [mu1, mu2] = family.bandwidths().map(|(low, high)| (low.ln() - 1e-5, high.ln() + 1e-5));
    let (shift, names) = match family {
        LobeKind::Round => (100.0, ["theta_z", "phi_z", "phi_xy", "ln_mu1", "ln_mu2", "energy"]),
        LobeKind::Cone => (CONE_OFFSET_MAX, ["offset", "phi_z", "slope", "ln_mu1", "ln_mu2", "energy"]),
    };
    let ranges = [(-shift, shift), (-100.0, 100.0), (-shift, shift), mu1, mu2, (0.0, 1.0 + ENERGY_TOLERANCE)];
    for (i, lobe) in lobes.chunks_exact(PARAMS).enumerate() {
        for (p, (low, high)) in ranges.iter().enumerate() {
            if !(lobe[p] >= *low && lobe[p] <= *high) {
                let key = format!("{key} lobe {i} {}", names[p]);
                return Err(invalid(name, &key, lobe[p], &format!("expected a value in [{low}, {high}]")));
            }
        }
    }
    Ok(())
}

/// The checked tensors and the reference values of a file.
pub(crate) fn read(bytes: &[u8], name: &str) -> Result<(PlyData, Vec<ReferenceValue>)> {
    let (data, keys): (PlyData, ModelKeys) = crate::io::document::with_keys(bytes, name)?;
    Ok((data, keys.reference_values))
}

/// A dozen values of eval: six incidences of both signs of theta_i, each inside a cell of the grid, in a
/// forward and a backward direction.
fn reference_values(model: &PlyModel) -> Vec<ReferenceValue> {
    let d = model.data();
    let sigma = d.sigma_per_um[d.sigma_per_um.len() - 1] as f32;
    // For theta_i and h: the cell as a fraction of all cells, and the position of the query in the cell; then
    // the sign of theta_i.
    const PLACES: [([f64; 2], [f64; 2], f32); 6] = [
        ([0.05, 0.35], [0.50, 0.45], 1.0),
        ([0.37, 0.70], [0.60, 0.30], 1.0),
        ([0.37, 0.30], [0.60, 0.55], -1.0),
        ([0.81, 0.40], [0.18, 0.65], 1.0),
        ([0.50, 0.60], [0.93, 0.25], 1.0),
        ([0.97, 0.45], [0.30, 0.60], -1.0),
    ];
    let inside = |axis: &[f64], [along, within]: [f64; 2]| {
        let cells = axis.len() - 1;
        let cell = ((along * cells as f64) as usize).min(cells - 1);
        (axis[cell] + within * (axis[cell + 1] - axis[cell])) as f32
    };
    let mut values = Vec::new();
    for (i, (t, x, sign)) in PLACES.into_iter().enumerate() {
        let (theta_i, h_um) = (sign * inside(&d.theta_i, t), inside(&d.h_um, x));
        for (theta_o, phi_o) in [(-theta_i, 4.7 + 0.1 * i as f32), (0.3 - theta_i, 1.2 + 0.5 * i as f32)] {
            let wo = direction(theta_o, phi_o);
            let sigma_per_um = [0.0, 0.1 * sigma, 0.5 * sigma, 2.0 * sigma];
            let value = model.at(&PlyQuery::lobes(theta_i, h_um, sigma_per_um)).eval(wo);
            values.push(ReferenceValue { theta_i, h_um, sigma_per_um, wo, value });
        }
    }
    values
}
