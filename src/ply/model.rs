//! A loaded ply model: the checked tensors of a file or a fit, laid out for evaluation.
//!
//! A model holds the lobes of f_refl and f_high over incident latitude and beam offset, the energies that
//! they are scaled to, and optional tables: edge lobes, layer factors, exit positions, relief and speckle
//! noise (Yu 2025, Eq. 8, 18 and 23). The methods here build the tables and read them; [`PlyModel::at`]
//! evaluates.

use super::data::PlyData;
use super::data::exits::{EXIT_KINDS, ExitShape, ExitTables, ExitsAt};
use super::edge;
use super::kernel::dispatch;
use super::kernel::layout::Layout;
use super::layers::LayerTables;
use super::lines::PassedLines;
use super::place::FibersAround;
use super::queries::Queries;
use super::query::PlyQuery;
use super::relief::Relief;
use crate::Result;
use crate::ply::speckle::NoiseField;
use crate::spec::YarnSpec;

/// A value of eval stored with the model. A host in another language, or a later version of this one,
/// evaluates the same query to check that it computes the same.
///
/// The stored queries lie inside the cells of the grid, away from its nodes and from the borders of its
/// blocks. f_high is discontinuous at those borders, so there the rounding of theta_i and h alone would
/// decide which block is used.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(from = "ReferenceNumbers")]
pub struct ReferenceValue {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Beam offset [um].
    pub h_um: f32,
    /// Absorption [1/um].
    pub sigma_per_um: [f32; 4],
    /// Outgoing direction, unit.
    pub wo: [f32; 3],
    /// f_refl + f_high in direction `wo` [1/sr], one for each absorption.
    pub value: [f32; 4],
}

/// A [`ReferenceValue`] as stored in files. A number beyond the range of f32 becomes infinite, and the check
/// of the model reports it.
#[derive(serde::Deserialize)]
struct ReferenceNumbers {
    theta_i: f64,
    h_um: f64,
    sigma_per_um: [f64; 4],
    wo: [f64; 3],
    value: [f64; 4],
}

impl From<ReferenceNumbers> for ReferenceValue {
    fn from(n: ReferenceNumbers) -> ReferenceValue {
        ReferenceValue {
            theta_i: n.theta_i as f32,
            h_um: n.h_um as f32,
            sigma_per_um: n.sigma_per_um.map(|v| v as f32),
            wo: n.wo.map(|v| v as f32),
            value: n.value.map(|v| v as f32),
        }
    }
}

/// A loaded ply model, laid out for evaluation.
///
/// ```
/// use plywave::PlyModel;
///
/// # fn main() -> plywave::Result<()> {
/// let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm"));
/// let model = PlyModel::from_bytes(bytes, "polyester.pwm")?; // or PlyModel::load(path)
/// assert!(model.has_edge() && model.reference_error() < 1e-4);
/// # Ok(())
/// # }
/// ```
///
/// All angles are in radians, lengths in um and densities in 1/sr. Every f is an energy density: the BSDF
/// times |cos theta_o|. Directions are unit vectors in the ply frame and are not normalized. No call
/// allocates, fails or panics. Inputs out of range are handled as follows:
///
/// - If |h| is beyond the last node, or theta_i or h is NaN, the beam misses the ply: f = 0 and r_d = 1.
/// - |theta_i| is clamped to the last node.
/// - Absorption is clamped to [0, 1e6], and NaN is replaced by 0.
/// - An outgoing direction that is not finite, or whose length is far from 1, gives f = 0.
/// - Interpolated bandwidths are clamped to the range from [`MU_MIN`](crate::ply::asg::MU_MIN) to
///   [`MU_MAX`](crate::ply::asg::MU_MAX), and lobe energies to 0 or more.
#[derive(Clone, Debug)]
pub struct PlyModel {
    data: PlyData,
    reference_values: Vec<ReferenceValue>,
    pub(super) layout: Layout,
    layers: Option<LayerTables>,
    exits: Option<ExitTables>,
    /// r_d averaged over intervals of offsets; present only if the ply is lit along single lines.
    passed: Option<PassedLines>,
    pub(super) edge: Option<edge::EdgeTables>,
    /// Present if the spec describes a round ply of three fibers or more.
    pub(super) relief: Option<Relief>,
    pub(super) noise: Option<Box<NoiseField>>,
}

impl PlyModel {
    /// Builds a model from tensors, without a file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if a file with these tensors would be refused.
    pub fn from_data(data: PlyData) -> Result<PlyModel> {
        PlyModel::from_data_named(data, "model")
    }

    pub(super) fn from_data_named(data: PlyData, name: &str) -> Result<PlyModel> {
        data.check(name)?;
        Ok(PlyModel::from_parts(data, Vec::new()))
    }

    /// Builds a model from data that are checked already.
    pub(super) fn from_parts(data: PlyData, reference_values: Vec<ReferenceValue>) -> PlyModel {
        let edge = data.edge.as_ref().map(edge::EdgeTables::new);
        let spec = YarnSpec::parse(&data.spec_text, "model (its spec)").ok();
        let noise = data.noise.as_ref().map(|noise| {
            let last_um = data.h_um.last().copied().unwrap_or(0.0);
            let around = match &spec {
                Some(spec) => FibersAround::of_spec(spec, last_um - spec.beam.beam().d_cut_um),
                None => FibersAround::of_beam(noise.w0_um, last_um),
            };
            Box::new(noise.field(around))
        });
        PlyModel {
            layout: Layout::new(&data),
            layers: LayerTables::new(&data),
            exits: data.exits.as_ref().map(|exits| ExitTables::new(exits, &data.theta_i, &data.h_um)),
            passed: None,
            edge,
            relief: spec.and_then(|spec| Relief::of_spec(&spec)),
            noise,
            data,
            reference_values,
        }
    }

    /// The same ply lit along single lines instead of a beam: r_d becomes the probability that a line misses
    /// all fibers, and the energies of the lobes are scaled accordingly. A host that follows a line through
    /// several plies needs this model, and so does [`crate::ClothQuery::models`]; a cloth converts its own
    /// plies.
    ///
    /// The beam that is removed is the one that the spec in the model defines.
    ///
    /// # Errors
    /// If the spec in the model does not parse.
    pub fn of_lines(&self) -> Result<PlyModel> {
        let mut data = self.data.clone();
        let spec = YarnSpec::parse(&data.spec_text, "model (its spec)")?;
        data.energies = data.energies.of_lines(spec.beam.beam().sd_um());
        data.bound_layers();
        let passed = Some(PassedLines::new(&data.energies));
        Ok(PlyModel { passed, ..PlyModel::from_parts(data, Vec::new()) })
    }

    /// Marks a model whose energies already describe single lines, as [`PlyModel::of_lines`] computes them.
    pub(crate) fn in_lines(self) -> PlyModel {
        PlyModel { passed: Some(PassedLines::new(&self.data.energies)), ..self }
    }

    /// Distribution of the light that leaves the ply over the positions across it, by kind of light.
    #[doc(hidden)]
    pub fn exit_shapes(&self) -> &[ExitShape; EXIT_KINDS] {
        match &self.exits {
            Some(exits) => &exits.shapes,
            None => ExitShape::usual(),
        }
    }

    /// Positions where the light of one incidence leaves a ply of this radius [um].
    #[doc(hidden)]
    #[inline(always)]
    pub fn exits_at(&self, theta_i: f32, h_um: f32, radius_um: f32) -> ExitsAt {
        match &self.exits {
            Some(exits) => exits.at(theta_i, h_um),
            None => ExitsAt::unknown(theta_i, h_um / radius_um),
        }
    }

    /// The mean of r_d over intervals of offsets, if the ply is lit along single lines
    /// ([`PlyModel::of_lines`]).
    pub(crate) fn passed_lines(&self) -> Option<&PassedLines> {
        self.passed.as_ref()
    }

    pub(crate) fn layer_tables(&self) -> Option<&LayerTables> {
        self.layers.as_ref()
    }

    /// The tensors as stored in the file.
    pub fn data(&self) -> &PlyData {
        &self.data
    }

    /// The values of eval stored in the file; empty for a model that was not loaded from a file.
    pub fn reference_values(&self) -> &[ReferenceValue] {
        &self.reference_values
    }

    /// Maximum difference between eval and the stored values, relative to the largest stored value; 0 if no
    /// values are stored.
    pub fn reference_error(&self) -> f32 {
        let (mut error, mut peak) = (0.0f32, 0.0f32);
        for g in &self.reference_values {
            let got = self.uncached_at(&PlyQuery::lobes(g.theta_i, g.h_um, g.sigma_per_um)).lit().eval(g.wo);
            for (got, want) in got.iter().zip(g.value) {
                error = error.max((got - want).abs());
                peak = peak.max(want.abs());
            }
        }
        if error == 0.0 { 0.0 } else { error / peak }
    }

    /// Whether the model has edge lobes.
    pub fn has_edge(&self) -> bool {
        self.edge.is_some()
    }

    /// Evaluates f_refl + f_high [1/sr] (Yu 2025, Eq. 8) at many queries. If an array of `queries` is shorter
    /// than `f`, the values beyond its end are set to 0.
    pub fn eval_batch<const N: usize>(&self, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
        dispatch::batch(&self.layout, queries, f);
    }

    /// The fibers on the ply's surface, if its spec has a round ply of three fibers or more.
    pub fn relief(&self) -> Option<&Relief> {
        self.relief.as_ref()
    }

    /// The model's speckle noise, if it has any.
    #[inline]
    pub fn noise(&self) -> Option<&NoiseField> {
        self.noise.as_deref()
    }

    /// The model's speckle noise, for a host that cannot do without it.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if the model has no noise; the message names `file`.
    pub fn require_noise(&self, file: &str) -> Result<&NoiseField> {
        let hint = "the model has no speckle noise; add it with `plywave noise`";
        self.noise().ok_or_else(|| crate::io::invalid(file, "noise_spectrum", "absent", hint))
    }
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlyModel>();
};
