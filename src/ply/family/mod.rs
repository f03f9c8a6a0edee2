//! A continuous family of plies in one file: any twist, roughness and index within its ranges, without a new
//! simulation. (The method of Yu 2025, 8.2, needs a new precomputation for each.)
//!
//! A family contains ply models at the nodes of a grid over some of `fiber_pitch_um`, `alpha_fiber` and
//! `eta`. Their lobes were fitted together, so that lobe l of one node corresponds to lobe l of every other,
//! and the fit included parameters between nodes. Between nodes all numbers of a model are multilinear in
//!
//! ```text
//! x = atan(2 pi R / pitch),      alpha_fiber,      eta
//! ```
//!
//! x is the tilt of the fibers at the ply's rim R. The model itself is linear in the same numbers within a
//! block of incidences, so the order of the two interpolations does not matter: [`PlyFamily::at`] computes a
//! whole model, [`PlyFamily::on`] interpolates only the numbers of one incidence, and both agree. The weights
//! are 0 or more and sum to 1, so bandwidths and energies stay within their ranges and spectra keep their
//! sum. Angles are not wrapped, and any interpolated angles define axes of unit length. Lobes store ratios of
//! energy, and the evaluator scales them to the interpolated energies, which are therefore exact.
//!
//! *Missed light* is not a linear function of x. A line of latitude theta rises by `tan(theta)` for each um
//! across the ply, and the cross section turns by `2 pi / pitch` for each um of height. Its hits therefore
//! depend on `tan(theta) / pitch` (except for the beam's divergence, and for the cross sections of tilted
//! fibers, which are longer). r_d at a pitch is therefore read from a node of pitch p' at the latitude
//! `atan(tan(theta) p' / pitch)`, which moves the ridge where light is parallel to the rim's fibers to its
//! correct latitude.

use crate::io::Document;
mod at;
mod data;
mod eval;
mod file;
mod node_weights;
mod num;

pub use data::{FamilyAxis, FamilyData, FamilyParam, FamilyParams};
pub use eval::{FamilyGradient, FamilyPly};

use super::PlyQuery;
use super::edge::EdgeTables;
use crate::Result;
use crate::io::FileKind;
use crate::spec::YarnSpec;
use std::path::Path;

/// A loaded family of ply models.
///
/// Units and the handling of invalid values are those of [`crate::PlyModel`]. No call except
/// [`PlyFamily::load`], [`PlyFamily::from_bytes`], [`PlyFamily::from_data`] and [`PlyFamily::at`] allocates,
/// fails or panics.
#[derive(Clone, Debug)]
pub struct PlyFamily {
    data: FamilyData,
    /// The yarn of the family's spec, without the ranges.
    spec: YarnSpec,
    axes: node_weights::Axes,
    edge: Option<EdgeTables>,
}

impl PlyFamily {
    /// Reads and checks a family file (`docs/reference/format/models.md`).
    ///
    /// # Errors
    /// Those of [`crate::ply::PlyData::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<PlyFamily> {
        let path = path.as_ref();
        let bytes = crate::io::read_file(path, FileKind::Family.most_bytes())?;
        PlyFamily::from_bytes(&bytes, &path.display().to_string())
    }

    /// Reads and checks a family from the bytes of its file; `name` identifies the file in errors.
    ///
    /// # Errors
    /// Those of [`PlyFamily::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<PlyFamily> {
        PlyFamily::named(FamilyData::from_bytes(bytes, name)?, name)
    }

    /// Builds a family from tensors, without a file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] if a file with these tensors would be refused.
    pub fn from_data(data: FamilyData) -> Result<PlyFamily> {
        data.check_all("family")?;
        PlyFamily::named(data, "family")
    }

    fn named(data: FamilyData, name: &str) -> Result<PlyFamily> {
        let mut spec = YarnSpec::parse(&data.spec_text, &format!("{name} (its spec)"))?;
        spec.family = None;
        let axes = node_weights::Axes::new(&data, &spec);
        let edge = data.nodes[0].edge.as_ref().map(EdgeTables::new);
        Ok(PlyFamily { data, spec, axes, edge })
    }

    /// The tensors as stored in the file.
    pub fn data(&self) -> &FamilyData {
        &self.data
    }

    /// The parameters of the yarn in the family's spec, which can be the base of others:
    /// `FamilyParams { alpha_fiber: 0.3, ..family.params() }`.
    pub fn params(&self) -> FamilyParams {
        FamilyParams::from_spec(&self.spec)
    }

    /// The spec of one of the family's yarns, which a simulation of it would use.
    pub fn spec_at(&self, params: &FamilyParams) -> YarnSpec {
        params.applied_to(&self.spec)
    }

    /// The ply with these parameters at a query, interpolated at this incidence alone, for parameters from a
    /// texture. Parameters outside their ranges are clamped. A parameter that is not an axis of the family,
    /// or is NaN, is replaced by the spec's value. Only the query's incidence, absorptions, wavelengths and
    /// `edge` are used; slits, speckle and second layers need a model ([`PlyFamily::at`]).
    pub fn on<const N: usize>(&self, params: &FamilyParams, query: &PlyQuery<'_, N>) -> FamilyPly<'_, N> {
        eval::on(self, params, query)
    }

    /// f_refl + f_high [1/sr] in direction `wo`, and its derivatives by the family's parameters and by the
    /// absorptions, as [`PlyFamily::on`] evaluates it without edge light. At a node, where the slope is
    /// discontinuous, the derivative is that of the cell above. Beyond a range it is 0.
    pub fn eval_gradient<const N: usize>(
        &self,
        params: &FamilyParams,
        query: &PlyQuery<'_, N>,
        wo: [f32; 3],
    ) -> FamilyGradient<N> {
        eval::gradient(self, params, query, wo)
    }
}
