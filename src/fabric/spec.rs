//! The fabric spec (TOML): the weave, and the yarns of warp and weft. Lengths in um; the unit is part of the
//! key. Keys, ranges and relations are in `rules.rs`, reading in `load.rs`.

use super::YarnSet;
use super::color_of::ColorOf;
use super::draft::Draft;
use super::query::Slits;
#[cfg(doc)]
use super::{wif::Wif, yarn::YarnShape};
use crate::gap::SLIT_SHARE;
use crate::spec::Handedness;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A fabric spec, as `fabrics/cotton_twill.toml`. Unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FabricSpec {
    /// Name of the fabric, for the record.
    pub name: String,
    /// What the colors are colors of.
    #[serde(default)]
    pub color_of: ColorOf,
    /// Which yarn is on top where.
    pub weave: WeaveSpec,
    /// Yarns along y.
    pub warp: YarnOfFabric,
    /// Yarns along x.
    pub weft: YarnOfFabric,
}

/// Weaves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum WeaveSpec {
    /// Over one, under one. An open one, as organza, has spacings wider than its yarns.
    Plain {},
    /// Each end over `up` picks, under `down`.
    Twill {
        /// Picks that an end passes over.
        up: usize,
        /// Picks that an end passes under.
        down: usize,
    },
    /// Warp satin of `n` ends, its binding points moved by `step` from pick to pick.
    Satin {
        /// Ends of the repeat.
        n: usize,
        /// Ends from one binding point to the next.
        step: usize,
    },
    /// Plain weave of groups of `n`.
    Basket {
        /// Yarns of a group.
        n: usize,
    },
    /// Two layers of straight yarns, warp above weft: no cloth, but the simplest case to hold a model to.
    /// Round yarns touch where the crimps add up to 1.
    Layers {},
    /// Any draft: rows of `X` (warp on top) and `.`, as seen, so that the last row is the first pick.
    Draft {
        /// Rows of one repeat, all of the same length.
        rows: Vec<String>,
    },
    /// A weavers' file, [`Wif`].
    Wif {
        /// Path of the file, relative to the spec.
        file: String,
    },
}

/// Yarns of warp or weft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YarnOfFabric {
    /// Path of the ply's model, relative to the spec, or its name in a [`crate::io::ModelLibrary`]; absent
    /// where `models` has several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Paths or names of several models by capital letters: stripes. Their plies have the same number, radius
    /// and beam.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub models: BTreeMap<String, String>,
    /// Letters of `models`, one for each yarn, in the order of ends or picks; the row repeats, whatever the
    /// repeat of the draft.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<String>,
    /// Plies of the yarn, 1 to 7.
    #[serde(default = "one")]
    pub plies: u32,
    /// Radius R of a ply [um]; absent: that of the spec in the model.
    #[serde(default)]
    pub ply_radius_um: Option<f64>,
    /// Pitch of the plies about the yarn's axis [um]; absent: parallel plies.
    #[serde(default)]
    pub ply_pitch_um: Option<f64>,
    /// Hand of the plies' helix.
    #[serde(default)]
    pub handedness: Handedness,
    /// From the axis of a yarn to that of the next [um]; absent: that of the WIF, which other weaves have
    /// none of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_um: Option<f64>,
    /// Amplitude of the yarn's height over the distance of the axes of touching yarns, [`YarnShape::crimp`];
    /// absent: one by which the yarn leans by
    /// [`super::USUAL_LEAN_DEG`] at most, 0.5 in loose weaves.
    #[serde(default)]
    pub crimp: Option<f64>,
    /// Color of the yarns [sRGB, 0 to 1].
    #[serde(default)]
    pub srgb: Option<[f64; 3]>,
    /// Absorption coefficient of the fibers [1/um], in place of a color.
    #[serde(default)]
    pub sigma_per_um: Option<f64>,
    /// Width of slits between the fibers [um] (Yu 2025, 7.3); absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slit_um: Option<f64>,
    /// Share of the forward light that goes through them, of yarns with slits; absent: [`SLIT_SHARE`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slit_share: Option<f64>,
}

impl YarnOfFabric {
    /// The slits between its fibers.
    pub fn slits(&self) -> Option<Slits> {
        let width_um = self.slit_um? as f32;
        Some(Slits { width_um, share: self.slit_share.map_or(SLIT_SHARE, |share| share as f32) })
    }

    /// Paths of the models, each once, and for each yarn of one repeat of the stripes the index of its model.
    pub fn stripes(&self) -> (Vec<&str>, Vec<usize>) {
        match (&self.model, &self.threads) {
            (Some(model), _) => (vec![model], vec![0]),
            (None, None) => (Vec::new(), Vec::new()),
            (None, Some(threads)) => {
                let (letters, names): (Vec<&str>, Vec<&str>) =
                    self.models.iter().map(|(letter, name)| (letter.as_str(), name.as_str())).unzip();
                let index = |c: char| letters.iter().position(|l| l.chars().eq([c]));
                (names, threads.chars().filter_map(index).collect())
            }
        }
    }
}

fn one() -> u32 {
    1
}

/// What a yarn is colored by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YarnColor {
    /// Neither the spec nor a WIF says anything: clear fibers, and opaque ones in their own color.
    Undyed,
    /// A color [sRGB, 0 to 1].
    Srgb([f32; 3]),
    /// An absorption coefficient [1/um].
    Sigma(f32),
}

impl FabricSpec {
    /// The yarns of a family.
    pub fn yarn(&self, family: YarnSet) -> &YarnOfFabric {
        match family {
            YarnSet::Warp => &self.warp,
            YarnSet::Weft => &self.weft,
        }
    }
}

impl WeaveSpec {
    /// The draft; `None` for a WIF, whose draft is in its file, and for counts out of range.
    pub fn draft(&self) -> Option<Draft> {
        match self {
            WeaveSpec::Plain {} => Some(Draft::plain()),
            WeaveSpec::Twill { up, down } => Draft::twill(*up, *down),
            WeaveSpec::Satin { n, step } => Draft::satin(*n, *step),
            WeaveSpec::Basket { n } => Draft::basket(*n),
            WeaveSpec::Layers {} => Some(Draft::layers()),
            WeaveSpec::Draft { rows } => {
                let up = |pick: usize, end: usize| {
                    rows.get(rows.len() - 1 - pick).and_then(|r| r.as_bytes().get(end)) == Some(&b'X')
                };
                Draft::from_fn(rows.len(), rows.first().map_or(0, String::len), up)
            }
            WeaveSpec::Wif { .. } => None,
        }
    }
}
