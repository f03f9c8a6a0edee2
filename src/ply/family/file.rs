//! Family files: writing, reading and checking (`docs/reference/format/models.md`).

use super::data::{FamilyAxis, FamilyData, FamilyParam};
use crate::Result;
use crate::io::{Axis, Document, FileKind, Provenance, Reader, Summary, Writer, invalid};
use crate::ply::asg::PARAMS;
use crate::ply::data::drift::{self, NAMES as DRIFT};
use crate::ply::data::edge_lobes::{self, EdgeLobes};
use crate::ply::data::exits::NAMES as EXITS;
use crate::ply::{EXIT_KINDS, EXIT_TERMS, ExitDrift, ExitOffsets, LayerFactors, LobeKind, PlyData, PlyEnergies};

/// Names of the tensors of every family, without its axes.
const NAMES: [&str; 16] = [
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
    "refl",
    "high",
    "high_path",
    "error_refl",
    "error_high",
];
/// Names of the optional tensors.
const LAYERS: [&str; 2] = ["layer_forward", "layer_diffuse"];

/// A family file has no keys besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct FamilyKeys {}

impl Document for FamilyData {
    const KIND: FileKind = FileKind::Family;
    type Keys = FamilyKeys;

    fn names() -> Vec<&'static str> {
        let axes = FamilyParam::ALL.map(FamilyParam::name);
        [&NAMES[..], &axes, &LAYERS, &EXITS, &DRIFT, &edge_lobes::NAMES].concat()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.preset.clone(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<FamilyKeys> {
        Ok(FamilyKeys {})
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let unit = |p: FamilyParam| if p == FamilyParam::FiberPitch { "um" } else { "1" };
        let axes = self.axes.iter().map(|a| Axis::new(a.param.name(), unit(a.param), a.values.len())).collect();
        let all = |of: &dyn Fn(&PlyData) -> Vec<f64>| Summary::from_values(self.nodes.iter().flat_map(of));
        let statistics = serde_json::json!({
            "error_refl": all(&|d| d.error_refl.clone()),
            "error_high": all(&|d| d.error_high.clone()),
        });
        (axes, statistics)
    }

    fn tensors(&self, w: &mut Writer) {
        let first = &self.nodes[0];
        let (m, h, k, j) = first.sizes();
        let (n, bm, bh, lr, lh) = (self.nodes.len(), m / 2, h / 2, first.lobes_refl, first.lobes_high);
        for axis in &self.axes {
            w.f64(axis.param.name(), &[axis.values.len()], &axis.values);
        }
        w.f64("theta_i", &[m], &first.theta_i);
        w.f64("h_um", &[h], &first.h_um);
        w.f64("sigma_per_um", &[k], &first.sigma_per_um);
        w.f64("path_um", &[j], &first.path_um);
        let e = &first.energies;
        let [a, b, p, q] = [&e.miss_theta_i, &e.miss_h_um, &e.share_theta_i, &e.share_h_um].map(Vec::len);
        w.f64("miss_theta_i", &[a], &e.miss_theta_i);
        w.f64("miss_h_um", &[b], &e.miss_h_um);
        w.f64("share_theta_i", &[p], &e.share_theta_i);
        w.f64("share_h_um", &[q], &e.share_h_um);
        let (pitches, per_pitch) = self.pitches();
        let miss = self.nodes.iter().step_by(per_pitch).flat_map(|d| d.energies.miss.iter().map(|v| *v as f32));
        w.f32("miss", &[pitches, a, b], miss);
        let mut all = |name: &'static str, shape: &[usize], of: &dyn Fn(&PlyData) -> &[f64]| {
            let shape: Vec<usize> = std::iter::once(n).chain(shape.iter().copied()).collect();
            w.f32(name, &shape, self.nodes.iter().flat_map(of).map(|v| *v as f32));
        };
        all("share_refl", &[p, q], &|d| &d.energies.share_refl);
        all("share_high", &[p, q, j], &|d| &d.energies.share_high);
        all("refl", &[m, h, lr, PARAMS], &|d| &d.refl);
        all("high", &[bm, bh, 2, 2, lh, PARAMS], &|d| &d.high);
        all("high_path", &[bm, bh, 2, 2, lh, j], &|d| &d.high_path);
        all("error_refl", &[m, h], &|d| &d.error_refl);
        all("error_high", &[m, h, k], &|d| &d.error_high);
        if first.layers.is_some() {
            let forward = |d: &PlyData| d.layers.as_ref().map(|l| l.forward.clone()).unwrap_or_default();
            let diffuse = |d: &PlyData| d.layers.as_ref().map(|l| l.diffuse.clone()).unwrap_or_default();
            let shape = [n, 2 * m - 1, 2 * h - 1, 1 + j];
            w.f32(LAYERS[0], &shape, self.nodes.iter().flat_map(forward).map(|v| v as f32));
            w.f32(LAYERS[1], &[n, 2, 1 + j], self.nodes.iter().flat_map(diffuse).map(|v| v as f32));
        }
        if first.exits.is_some() {
            let mean = |d: &PlyData| d.exits.as_ref().map(|x| x.mean.clone()).unwrap_or_default();
            let shape = [n, m, h, EXIT_KINDS, EXIT_TERMS];
            w.f32(EXITS[0], &shape, self.nodes.iter().flat_map(mean).map(|v| v as f32));
            let length = |d: &PlyData| d.exits.as_ref().map(|x| x.length.to_vec()).unwrap_or_default();
            w.f32(EXITS[1], &[n, EXIT_KINDS], self.nodes.iter().flat_map(length).map(|v| v as f32));
            let drift = |of: &dyn Fn(&ExitDrift) -> &Vec<f64>| -> Vec<f64> {
                self.nodes.iter().filter_map(|d| d.exits.as_ref()).flat_map(|x| of(&x.drift).clone()).collect()
            };
            let (at, share) = drift::shapes(n * m, k);
            w.f32(DRIFT[0], &at, drift(&|d| &d.at).into_iter().map(|v| v as f32));
            w.f32(DRIFT[1], &share, drift(&|d| &d.share).into_iter().map(|v| v as f32));
        }
        if let Some(edge) = &first.edge {
            edge.write(w);
        }
    }

    fn read(r: &Reader<'_>, provenance: Provenance, _: &FamilyKeys) -> Result<FamilyData> {
        let mut axes = Vec::new();
        for param in FamilyParam::ALL {
            if r.has(param.name()) {
                let size = r.shape(param.name(), 1)?[0];
                axes.push(FamilyAxis { param, values: r.f64(param.name(), &[size])? });
            }
        }
        let n = FamilyData::check_axes(r.file(), &axes)?;
        let pitches = axes.iter().find(|a| a.param == FamilyParam::FiberPitch).map_or(1, |a| a.values.len());
        let size = |name: &str| r.shape(name, 1).map(|shape| shape[0]);
        let (m, h, k, j) = (size("theta_i")?, size("h_um")?, size("sigma_per_um")?, size("path_um")?);
        let (lr, lh) = (r.shape("refl", 5)?[3], r.shape("high", 7)?[5]);
        let (a, b) = (size("miss_theta_i")?, size("miss_h_um")?);
        let (p, q) = (size("share_theta_i")?, size("share_h_um")?);
        // Sizes are read from tensors in the file, which also holds tensors of their products. A size of 0
        // would leave a node without numbers.
        let sizes = [("theta_i", m), ("h_um", h), ("sigma_per_um", k), ("path_um", j), ("refl", lr), ("high", lh)];
        if let Some((name, _)) = sizes.into_iter().find(|(_, size)| *size == 0) {
            return Err(invalid(r.file(), name, "0 values", "expected some"));
        }
        let (bm, bh) = (m / 2, h / 2);
        let theta_i = r.f64("theta_i", &[m])?;
        let h_um = r.f64("h_um", &[h])?;
        let sigma_per_um = r.f64("sigma_per_um", &[k])?;
        let path_um = r.f64("path_um", &[j])?;
        let grids = [
            r.f64("miss_theta_i", &[a])?,
            r.f64("miss_h_um", &[b])?,
            r.f64("share_theta_i", &[p])?,
            r.f64("share_h_um", &[q])?,
        ];
        let miss = r.f64("miss", &[pitches, a, b])?;
        let share_refl = r.f64("share_refl", &[n, p, q])?;
        let share_high = r.f64("share_high", &[n, p, q, j])?;
        let refl = r.f64("refl", &[n, m, h, lr, PARAMS])?;
        let high = r.f64("high", &[n, bm, bh, 2, 2, lh, PARAMS])?;
        let high_path = r.f64("high_path", &[n, bm, bh, 2, 2, lh, j])?;
        let error_refl = r.f64("error_refl", &[n, m, h])?;
        let error_high = r.f64("error_high", &[n, m, h, k])?;
        let layers = if LAYERS.iter().any(|name| r.has(name)) {
            let forward = r.f64(LAYERS[0], &[n, (2 * m).saturating_sub(1), (2 * h).saturating_sub(1), 1 + j])?;
            Some((forward, r.f64(LAYERS[1], &[n, 2, 1 + j])?))
        } else {
            None
        };
        let exits = if r.has(EXITS[0]) {
            let mean = r.f64(EXITS[0], &[n, m, h, EXIT_KINDS, EXIT_TERMS])?;
            Some((mean, r.f64(EXITS[1], &[n, EXIT_KINDS])?, ExitDrift::read(r, n * m, k)?))
        } else {
            None
        };
        let edge = EdgeLobes::read(r)?;
        let part = |values: &[f64], of: usize, at: usize| -> Vec<f64> {
            let len = values.len() / of;
            values[at * len..(at + 1) * len].to_vec()
        };
        let nodes = (0..n)
            .map(|i| PlyData {
                spec_text: String::new(),
                program_version: provenance.program_version.clone(),
                preset: provenance.preset.clone(),
                seed: provenance.seed,
                theta_i: theta_i.clone(),
                h_um: h_um.clone(),
                sigma_per_um: sigma_per_um.clone(),
                path_um: path_um.clone(),
                lobes_refl: lr,
                lobes_high: lh,
                family: LobeKind::Round,
                energies: PlyEnergies {
                    miss_theta_i: grids[0].clone(),
                    miss_h_um: grids[1].clone(),
                    miss: part(&miss, pitches, i / (n / pitches)),
                    share_theta_i: grids[2].clone(),
                    share_h_um: grids[3].clone(),
                    share_refl: part(&share_refl, n, i),
                    share_high: part(&share_high, n, i),
                },
                refl: part(&refl, n, i),
                high: part(&high, n, i),
                high_path: part(&high_path, n, i),
                error_refl: part(&error_refl, n, i),
                error_high: part(&error_high, n, i),
                layers: layers.as_ref().map(|(forward, diffuse)| LayerFactors {
                    forward: part(forward, n, i),
                    diffuse: part(diffuse, n, i),
                }),
                exits: exits.as_ref().map(|(mean, lengths, drift)| ExitOffsets {
                    mean: part(mean, n, i),
                    length: std::array::from_fn(|kind| lengths[EXIT_KINDS * i + kind]),
                    drift: ExitDrift { at: part(&drift.at, n, i), share: part(&drift.share, n, i) },
                }),
                edge: edge.clone(),
                noise: None,
            })
            .collect();
        Ok(FamilyData {
            spec_text: provenance.spec,
            program_version: provenance.program_version,
            preset: provenance.preset,
            seed: provenance.seed,
            axes,
            nodes,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        self.check_all(name)
    }
}
