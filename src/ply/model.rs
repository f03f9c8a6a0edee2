//! A loaded ply model.

use super::data::PlyData;
use super::data::exits::{EXIT_KINDS, ExitShape, ExitTables, ExitsAt};
use super::data::file::{self, ReferenceValue};
use super::edge;
use super::kernel::dispatch;
use super::kernel::layout::Layout;
use super::layers::LayerTables;
use super::lines::PassedLines;
use super::place::FibersAround;
use super::queries::Queries;
use super::query::PlyQuery;
use super::relief::Relief;
use crate::spec::YarnSpec;
use crate::speckle::NoiseField;
use crate::{Bsdf, Result};
use std::path::Path;

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
/// All angles are in radians, lengths in um, densities in 1/sr; every f is an energy density: BSDF times |cos
/// theta_o|. Directions are unit vectors in the ply frame and are not normalized. No call allocates, fails or
/// panics. Where |h| is beyond the nodes, or theta_i or h is NaN, the beam misses: f = 0 and r_d = 1.
/// |theta_i| beyond the nodes counts as the last node. Absorption is clamped to [0, 1e6]; NaN counts as 0. A
/// `wo` that is not finite, or far from unit, gives 0. Interpolated ln mu is clamped to
/// [`crate::ply::asg::MU_MIN`] and [`crate::ply::asg::MU_MAX`], lobe energies to 0 or more.
#[derive(Clone, Debug)]
pub struct PlyModel {
    data: PlyData,
    reference_values: Vec<ReferenceValue>,
    pub(super) layout: Layout,
    layers: Option<LayerTables>,
    exits: Option<ExitTables>,
    /// Present for a ply lit along single lines.
    passed: Option<PassedLines>,
    pub(super) edge: Option<edge::EdgeTables>,
    /// Of plies whose spec has fibers to show.
    pub(super) relief: Option<Relief>,
    pub(super) noise: Option<Box<NoiseField>>,
}

impl PlyModel {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// As [`PlyData::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<PlyModel> {
        let path = path.as_ref();
        PlyModel::from_bytes(&crate::io::read_bytes(path)?, &path.display().to_string())
    }

    /// Reads and checks a model from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// As [`PlyData::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<PlyModel> {
        let (data, reference_values) = file::read(bytes, name)?;
        Ok(PlyModel::from_parts(data, reference_values))
    }

    /// A model from tensors, without a file.
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

    /// A model from checked data.
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
            exits: ExitTables::new(&data),
            passed: None,
            edge,
            relief: spec.and_then(|spec| Relief::of_spec(&spec)),
            noise,
            data,
            reference_values,
        }
    }

    /// The same ply lit along single lines instead of a beam: r_d becomes the chance that a line misses all
    /// fibers, and the energies follow. For hosts that follow a line through several plies, and for
    /// [`crate::ClothQuery::models`]: a cloth uses its own plies this way.
    ///
    /// # Errors
    /// Errors of the spec in the model, which defines the beam.
    pub fn of_lines(&self) -> Result<PlyModel> {
        let mut data = self.data.clone();
        let spec = YarnSpec::parse(&data.spec_text, "model (its spec)")?;
        data.energies = data.energies.of_lines(spec.beam.beam().sd_um());
        data.bound_layers();
        let passed = Some(PassedLines::new(&data.energies));
        Ok(PlyModel { passed, ..PlyModel::from_parts(data, Vec::new()) })
    }

    /// A model whose data are those of single lines already, as [`PlyModel::of_lines`] leaves them.
    pub(crate) fn in_lines(self) -> PlyModel {
        PlyModel { passed: Some(PassedLines::new(&self.data.energies)), ..self }
    }

    /// Distribution of the exiting light across the ply, by kind.
    #[doc(hidden)]
    pub fn exit_shapes(&self) -> &[ExitShape; EXIT_KINDS] {
        match &self.exits {
            Some(exits) => &exits.shapes,
            None => ExitShape::usual(),
        }
    }

    /// Exit positions of light of an incidence on a ply of this radius [um].
    #[doc(hidden)]
    pub fn exits_at(&self, theta_i: f32, h_um: f32, radius_um: f32) -> ExitsAt {
        self.exits.as_ref().map_or_else(|| ExitsAt::unknown(theta_i, h_um / radius_um), |exits| exits.at(theta_i, h_um))
    }

    /// Light that passes a ply lit along single lines ([`PlyModel::of_lines`]).
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

    /// Values of eval stored in the file; empty for a model that is not from a file.
    pub fn reference_values(&self) -> &[ReferenceValue] {
        &self.reference_values
    }

    /// Greatest difference of eval from the stored values, relative to the greatest of them. 0 without stored
    /// values.
    pub fn reference_error(&self) -> f32 {
        let (mut error, mut peak) = (0.0f32, 0.0f32);
        for g in &self.reference_values {
            let got = self.uncached_at(&PlyQuery::lobes(g.theta_i, g.h_um, g.sigma_per_um)).eval(g.wo);
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

    /// f_refl + f_high [1/sr] (Yu 2025, Eq. 8) at each of many queries; 0 where an array of `queries` is
    /// shorter than `f`.
    pub fn eval_batch<const N: usize>(&self, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
        dispatch::batch(&self.layout, queries, f);
    }

    /// The fibers on the ply's surface, if its spec has a round ply of three fibers or more.
    pub fn relief(&self) -> Option<&Relief> {
        self.relief.as_ref()
    }

    /// The model's speckle noise, if it has some.
    #[inline]
    pub fn noise(&self) -> Option<&NoiseField> {
        self.noise.as_deref()
    }

    /// The model's speckle noise, for a host that requires it.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if the model has no noise; `file` names it in the message.
    pub fn require_noise(&self, file: &str) -> Result<&NoiseField> {
        let hint = "the model has no speckle noise; add it with `plywave noise`";
        self.noise().ok_or_else(|| crate::io::invalid(file, "noise_spectrum", "absent", hint))
    }
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlyModel>();
};
