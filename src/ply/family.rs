//! A continuous family of plies in one file: any twist, roughness and index of its ranges without a new
//! simulation (Yu 2025, 8.2, calls each a new precomputation).
//!
//! A family has ply models at the nodes of a grid over some of `fiber_pitch_um`, `alpha_fiber` and `eta`.
//! Their lobes were fitted together, so that lobe l of a node is lobe l of every other, and parameters
//! between nodes were part of the fit. Between nodes all numbers of a model are multilinear in
//!
//! ```text
//! x = atan(2 pi R / pitch),      alpha_fiber,      eta
//! ```
//!
//! x being the angle by which fibers at the ply's rim R lean. The model itself is linear in the same numbers
//! within a block of incidences, so that the order of the two interpolations does not matter:
//! [`PlyFamily::at`] makes a whole model, [`PlyFamily::on`] interpolates only what one incidence needs, and
//! both agree. Weights are never negative and add up to 1, so that bandwidths and energies stay within their
//! ranges and spectra keep their sum; angles are not wrapped, and any angles are axes of unit length. Lobes
//! carry ratios of energy: the evaluator scales them to the interpolated energies, which the model therefore
//! has exactly.
//!
//! *Missed light* is no linear function of x. A line of latitude theta rises by `tan(theta)` for each um
//! across the ply, and the section turns by `2 pi / pitch` for each um of height: what it meets depends on
//! `tan(theta) / pitch` (but for the beam's divergence, and for sections of leaning fibers, which grow). So
//! r_d at a pitch is taken from a node of pitch p' at the latitude `atan(tan(theta) p' / pitch)`: the ridge
//! at which light runs parallel to the rim's fibers moves as it should.

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

/// A loaded family.
///
/// Units and odd values as in [`crate::PlyModel`]. No call but [`PlyFamily::load`],
/// [`PlyFamily::from_bytes`], [`PlyFamily::from_data`] and [`PlyFamily::at`] allocates, fails or panics.
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
    /// As [`crate::ply::PlyData::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<PlyFamily> {
        let path = path.as_ref();
        let bytes = crate::io::read_file(path, FileKind::Family.most_bytes())?;
        PlyFamily::from_bytes(&bytes, &path.display().to_string())
    }

    /// Reads and checks a family from the bytes of its file; `name` stands for the file in errors.
    ///
    /// # Errors
    /// As [`PlyFamily::load`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<PlyFamily> {
        PlyFamily::named(FamilyData::from_bytes(bytes, name)?, name)
    }

    /// A family of tensors that need not have been in a file.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] when a file with them would be refused.
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

    /// The parameters of the yarn that the family's spec describes, to change some of:
    /// `FamilyParams { alpha_fiber: 0.3, ..family.params() }`.
    pub fn params(&self) -> FamilyParams {
        FamilyParams::from_spec(&self.spec)
    }

    /// The spec of one of the family's yarns, which a simulation of it would have.
    pub fn spec_at(&self, params: &FamilyParams) -> YarnSpec {
        params.applied_to(&self.spec)
    }

    /// The ply of these parameters at a query, interpolated for this incidence alone: for parameters that a
    /// texture gives. Parameters outside their ranges count as the nearest within, those that are no axis of
    /// the family as the spec's; what is not a number counts as the spec's too. Of the query incidence,
    /// absorptions, wavelengths and `edge` count; slits, speckle and second layers need a model
    /// ([`PlyFamily::at`]).
    pub fn on<const N: usize>(&self, params: &FamilyParams, query: &PlyQuery<'_, N>) -> FamilyPly<'_, N> {
        eval::on(self, params, query)
    }

    /// f_refl + f_high [1/sr] in direction `wo` and its derivatives by the family's parameters and by the
    /// absorptions, as [`PlyFamily::on`] without edge light evaluates it. At a node, where the slope jumps,
    /// it is that of the cell above. Beyond a range the derivative is 0.
    pub fn eval_gradient<const N: usize>(
        &self,
        params: &FamilyParams,
        query: &PlyQuery<'_, N>,
        wo: [f32; 3],
    ) -> FamilyGradient<N> {
        eval::gradient(self, params, query, wo)
    }
}
