//! The tensors of a family: its axes, and models at the nodes that share their own axes.

use crate::Result;
use crate::io::invalid;
use crate::ply::{LobeKind, PlyData};
use crate::spec::YarnSpec;

/// A parameter that varies in a family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FamilyParam {
    /// Pitch of the fibers' helix [um].
    FiberPitch,
    /// Microfacet roughness of the fibers.
    Alpha,
    /// Refractive index of the fibers.
    Eta,
}

impl FamilyParam {
    /// All parameters, in the order of a family's axes.
    pub const ALL: [FamilyParam; 3] = [FamilyParam::FiberPitch, FamilyParam::Alpha, FamilyParam::Eta];

    /// The parameter's key in specs, which is also the name of its axis in files.
    pub fn name(self) -> &'static str {
        match self {
            FamilyParam::FiberPitch => "fiber_pitch_um",
            FamilyParam::Alpha => "alpha_fiber",
            FamilyParam::Eta => "eta",
        }
    }

    /// The parameter with this key; `None` if there is none.
    pub fn of_name(name: &str) -> Option<FamilyParam> {
        FamilyParam::ALL.into_iter().find(|p| p.name() == name)
    }
}

/// Parameters of one of a family's yarns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FamilyParams {
    /// Pitch of the fibers' helix [um].
    pub fiber_pitch_um: f64,
    /// Microfacet roughness of the fibers.
    pub alpha_fiber: f64,
    /// Refractive index of the fibers.
    pub eta: f64,
}

impl FamilyParams {
    /// The parameters of a spec. Without twist the pitch is 0.
    pub fn from_spec(spec: &YarnSpec) -> FamilyParams {
        FamilyParams {
            fiber_pitch_um: spec.ply.fiber_pitch_um.unwrap_or(0.0),
            alpha_fiber: spec.fiber.alpha_fiber,
            eta: spec.fiber.eta,
        }
    }

    /// The value of one parameter.
    pub fn get(&self, param: FamilyParam) -> f64 {
        match param {
            FamilyParam::FiberPitch => self.fiber_pitch_um,
            FamilyParam::Alpha => self.alpha_fiber,
            FamilyParam::Eta => self.eta,
        }
    }

    /// Sets one parameter.
    pub fn set(&mut self, param: FamilyParam, value: f64) {
        match param {
            FamilyParam::FiberPitch => self.fiber_pitch_um = value,
            FamilyParam::Alpha => self.alpha_fiber = value,
            FamilyParam::Eta => self.eta = value,
        }
    }

    /// The spec with these parameters and without the family's ranges.
    pub fn applied_to(&self, spec: &YarnSpec) -> YarnSpec {
        let mut spec = spec.clone();
        if spec.ply.fiber_pitch_um.is_some() {
            spec.ply.fiber_pitch_um = Some(self.fiber_pitch_um);
        }
        spec.fiber.alpha_fiber = self.alpha_fiber;
        spec.fiber.eta = self.eta;
        spec.family = None;
        spec
    }
}

/// One axis of a family.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyAxis {
    /// The parameter that varies.
    pub param: FamilyParam,
    /// The nodes, ascending; at least 2.
    pub values: Vec<f64>,
}

/// The tensors of a family file, as the fit computes them.
#[derive(Clone, Debug, PartialEq)]
pub struct FamilyData {
    /// Text of the yarn spec with its `[family]`, verbatim.
    pub spec_text: String,
    /// Version of the program that made the family.
    pub program_version: String,
    /// Name of the preset, for information.
    pub preset: String,
    /// Seed of the simulations, the same at all nodes.
    pub seed: u64,
    /// 1 to 3 axes, in the order of [`FamilyParam::ALL`].
    pub axes: Vec<FamilyAxis>,
    /// Models at the nodes, the last axis fastest. All have the same axes, path lengths and edge lobes.
    /// Models of the same pitch have the same r_d, and none has speckle.
    pub nodes: Vec<PlyData>,
}

/// Maximum number of nodes of an axis, and of a family.
const MAX_VALUES: usize = 64;
const MAX_NODES: usize = 1024;

impl FamilyData {
    /// The nodes of an axis; `None` if the parameter is not an axis.
    pub fn values(&self, param: FamilyParam) -> Option<&[f64]> {
        self.axes.iter().find(|axis| axis.param == param).map(|axis| axis.values.as_slice())
    }

    /// Number of nodes along pitch, which is 1 if pitch is not an axis, and number of nodes at each pitch.
    pub(super) fn pitches(&self) -> (usize, usize) {
        let count = self.values(FamilyParam::FiberPitch).map_or(1, <[f64]>::len);
        (count, self.nodes.len() / count.max(1))
    }

    /// Parameters of a node, in a family of `spec`.
    pub fn params_of(&self, node: usize, spec: &YarnSpec) -> FamilyParams {
        let mut params = FamilyParams::from_spec(spec);
        let mut rest = node;
        for axis in self.axes.iter().rev() {
            params.set(axis.param, axis.values[rest % axis.values.len()]);
            rest /= axis.values.len();
        }
        params
    }

    /// Checks the axes, and returns the number of nodes.
    pub(super) fn check_axes(name: &str, axes: &[FamilyAxis]) -> Result<usize> {
        if axes.is_empty() {
            let hint = "expected one or more of fiber_pitch_um, alpha_fiber, eta";
            return Err(invalid(name, "axes of the family", 0, hint));
        }
        let c = crate::io::Check(name);
        let mut nodes = 1usize;
        for axis in axes {
            let key = axis.param.name();
            if !(2..=MAX_VALUES).contains(&axis.values.len()) {
                let hint = format!("expected 2 to {MAX_VALUES}");
                return Err(invalid(name, key, format!("{} values", axis.values.len()), &hint));
            }
            c.ascending(key, &axis.values)?;
            match axis.param {
                FamilyParam::FiberPitch => c.range(key, &axis.values, 0.01, 1e7)?,
                FamilyParam::Alpha => c.range(key, &axis.values, 0.0, 1.0)?,
                FamilyParam::Eta => c.range(key, &axis.values, 1e-3, 10.0)?,
            }
            nodes *= axis.values.len();
        }
        if nodes > MAX_NODES {
            return Err(invalid(name, "nodes of the family", nodes, &format!("expected at most {MAX_NODES}")));
        }
        Ok(nodes)
    }

    /// Checks that a family is valid.
    pub(super) fn check_all(&self, name: &str) -> Result<()> {
        let count = FamilyData::check_axes(name, &self.axes)?;
        if count != self.nodes.len() {
            return Err(invalid(name, "nodes of the family", self.nodes.len(), &format!("expected {count}")));
        }
        let spec = YarnSpec::parse(&self.spec_text, &format!("{name} (its spec)"))?;
        if self.values(FamilyParam::FiberPitch).is_some() && spec.ply.fiber_pitch_um.is_none() {
            return Err(invalid(name, "fiber_pitch_um", "an axis", "the family's spec has no twist"));
        }
        let (first, per_pitch) = (&self.nodes[0], self.pitches().1);
        for (i, node) in self.nodes.iter().enumerate() {
            node.check(name).map_err(|e| at_node(e, i))?;
            let e = &node.energies;
            let of_pitch = &self.nodes[i - i % per_pitch].energies;
            let same = [
                ("theta_i", node.theta_i == first.theta_i),
                ("h_um", node.h_um == first.h_um),
                ("sigma_per_um", node.sigma_per_um == first.sigma_per_um),
                ("path_um", node.path_um == first.path_um),
                ("lobes_refl", node.lobes_refl == first.lobes_refl),
                ("lobes_high", node.lobes_high == first.lobes_high),
                ("miss_theta_i", e.miss_theta_i == first.energies.miss_theta_i),
                ("miss_h_um", e.miss_h_um == first.energies.miss_h_um),
                ("share_theta_i", e.share_theta_i == first.energies.share_theta_i),
                ("share_h_um", e.share_h_um == first.energies.share_h_um),
                ("miss", e.miss == of_pitch.miss),
                ("edge", node.edge == first.edge),
                ("exits", node.exits.is_some() == first.exits.is_some()),
                ("layers", node.layers.is_some() == first.layers.is_some()),
                ("noise", node.noise.is_none()),
                ("family of lobes", node.family == LobeKind::Round),
            ];
            if let Some((what, _)) = same.into_iter().find(|(_, same)| !same) {
                let hint = "the nodes of a family share axes, path lengths, edge lobes and the r_d of their pitch, and have round lobes and no speckle";
                return Err(invalid(name, &format!("{what} of node {i}"), "not that of node 0", hint));
            }
        }
        Ok(())
    }
}

/// Adds the node to the key of an error about its tensors.
pub(super) fn at_node(error: crate::Error, node: usize) -> crate::Error {
    match error {
        crate::Error::Invalid { file, key, value, hint } => {
            crate::Error::Invalid { file, key: format!("{key} of node {node}"), value, hint }
        }
        other => other,
    }
}
