//! A whole ply model for one of a family's yarns: all tensors of the nodes blended by the parameters'
//! weights.

use super::PlyFamily;
use super::data::{FamilyParam, FamilyParams};
use super::node_weights::{NodeWeights, missed};
use crate::Result;
use crate::io::invalid;
use crate::ply::{ExitDrift, ExitOffsets, LayerFactors, LobeKind, PlyData, PlyEnergies, PlyModel};

/// The file name in errors about parameters.
const PARAMS: &str = "parameters of the family";

impl PlyFamily {
    /// The model with these parameters, as if it had been fitted to a simulation of them. It has no speckle,
    /// and its errors are interpolated between those of the nodes.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if a parameter is outside its range, or if it is not an axis of the family
    /// and differs from the spec's value.
    pub fn at(&self, params: &FamilyParams) -> Result<PlyModel> {
        Ok(PlyModel::from_parts(self.data_at(params)?, Vec::new()))
    }

    /// The tensors of [`PlyFamily::at`], which can be saved as a model file.
    ///
    /// # Errors
    /// Those of [`PlyFamily::at`].
    pub fn data_at(&self, params: &FamilyParams) -> Result<PlyData> {
        let mut at = [0.0; 3];
        for (i, param) in FamilyParam::ALL.into_iter().enumerate() {
            let value = params.get(param);
            match self.axes.range(i) {
                Some([low, high]) if !(low..=high).contains(&value) => {
                    return Err(invalid(PARAMS, param.name(), value, &format!("expected {low} to {high}")));
                }
                None if value != self.axes.usual(i) => {
                    let usual = self.axes.usual(i);
                    let hint = format!("it does not vary in this family: expected {usual}");
                    return Err(invalid(PARAMS, param.name(), value, &hint));
                }
                _ => at[i] = value,
            }
        }
        let place = self.axes.place(at);
        let text = self.spec_at(params).to_text(PARAMS)?;
        Ok(self.blended(&place, text))
    }

    fn blended(&self, place: &NodeWeights<f64>, spec_text: String) -> PlyData {
        let nodes = &self.data.nodes;
        let first = &nodes[0];
        let blend = |of: &dyn Fn(&PlyData) -> &[f64]| -> Vec<f64> {
            let mut sum = vec![0.0; of(first).len()];
            for &(node, w) in place.corners[..place.count].iter().filter(|c| c.1 > 0.0) {
                sum.iter_mut().zip(of(&nodes[node])).for_each(|(sum, v)| *sum += w * v);
            }
            sum
        };
        let energies_of = |node: usize| -> &PlyEnergies { &nodes[node].energies };
        let (rows, columns) = (first.energies.miss_theta_i.len(), first.energies.miss_h_um.len());
        let mut miss = Vec::with_capacity(rows * columns);
        for m in 0..rows {
            for n in 0..columns {
                miss.push(missed(&place.pitch, &energies_of, m as isize, n as isize));
            }
        }
        let energies = PlyEnergies {
            miss,
            share_refl: blend(&|d| &d.energies.share_refl),
            share_high: blend(&|d| &d.energies.share_high),
            ..first.energies.clone()
        };
        let empty: &[f64] = &[];
        let layers = first.layers.as_ref().map(|_| LayerFactors {
            forward: blend(&|d| d.layers.as_ref().map_or(empty, |l| &l.forward)),
            diffuse: blend(&|d| d.layers.as_ref().map_or(empty, |l| &l.diffuse)),
        });
        let exits = first.exits.as_ref().map(|_| {
            let mean = blend(&|d| d.exits.as_ref().map_or(empty, |x| &x.mean));
            let length = blend(&|d| d.exits.as_ref().map_or(empty, |x| &x.length));
            let at = blend(&|d| d.exits.as_ref().map_or(empty, |x| &x.drift.at));
            let share = blend(&|d| d.exits.as_ref().map_or(empty, |x| &x.drift.share));
            ExitOffsets { mean, length: std::array::from_fn(|kind| length[kind]), drift: ExitDrift { at, share } }
        });
        let mut data = PlyData {
            spec_text,
            program_version: self.data.program_version.clone(),
            preset: self.data.preset.clone(),
            seed: self.data.seed,
            theta_i: first.theta_i.clone(),
            h_um: first.h_um.clone(),
            sigma_per_um: first.sigma_per_um.clone(),
            path_um: first.path_um.clone(),
            lobes_refl: first.lobes_refl,
            lobes_high: first.lobes_high,
            family: LobeKind::Round,
            energies,
            refl: blend(&|d| &d.refl),
            high: blend(&|d| &d.high),
            high_path: blend(&|d| &d.high_path),
            error_refl: blend(&|d| &d.error_refl),
            error_high: blend(&|d| &d.error_high),
            layers,
            exits,
            edge: first.edge.clone(),
            noise: None,
        };
        data.bound_layers();
        data
    }
}
