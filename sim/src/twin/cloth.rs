//! The traced cloth: the geometry of a fabric's yarns and the specs of their plies. It is built from a loaded
//! fabric or from its own text, without models.

use crate::error::SimError;
use plywave::Error;
use plywave::fabric::{Draft, Fabric, LoadedFabric, YarnSet, YarnShape};
use plywave::spec::{Handedness, YarnSpec};
use serde::{Deserialize, Serialize};

/// Largest overlap of the tubes about two yarns [um]: fibers are packed some tenths of a micrometer within
/// their ply.
pub const OVERLAP_TOLERANCE_UM: f64 = 0.5;

/// A cloth of explicit fibers.
#[derive(Clone, Debug)]
pub struct TwinCloth {
    /// Name of the fabric.
    pub name: String,
    /// Geometry of the fabric.
    pub fabric: Fabric,
    /// Specs of the yarns' plies.
    pub yarns: Vec<YarnSpec>,
    /// For warp and weft, the index of the spec of each yarn in one repeat of their stripes.
    pub threads: [Vec<usize>; 2],
    text: String,
}

/// The text of a cloth, as JSON.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: String,
    /// Rows of the draft from the first pick on, X where the warp is on top.
    draft: Vec<String>,
    warp: TextYarn,
    weft: TextYarn,
    /// Texts of the yarn specs.
    yarns: Vec<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TextYarn {
    plies: u32,
    ply_radius_um: f64,
    ply_pitch_um: Option<f64>,
    handedness: Handedness,
    spacing_um: f64,
    crimp: f64,
    threads: Vec<usize>,
}

impl TwinCloth {
    /// The cloth of a fabric; of its models only the texts of their specs are used.
    ///
    /// # Errors
    /// [`SimError::YarnsIntersect`], [`SimError::YarnBends`], and those of the yarn specs.
    pub fn from_loaded(loaded: &LoadedFabric) -> Result<TwinCloth, SimError> {
        let texts = loaded.models.iter().map(|model| model.data().spec_text.clone()).collect();
        TwinCloth::new(&loaded.spec.name, loaded.fabric.clone(), texts, loaded.threads.clone())
    }

    /// A cloth from a fabric's geometry, the texts of its yarns' specs, and for warp and weft the spec index
    /// of each yarn in one repeat of their stripes.
    ///
    /// # Errors
    /// As [`TwinCloth::from_loaded`].
    pub fn new(
        name: &str,
        fabric: Fabric,
        specs: Vec<String>,
        threads: [Vec<usize>; 2],
    ) -> Result<TwinCloth, SimError> {
        let yarns = specs.iter().map(|text| YarnSpec::parse(text, "yarn")).collect::<Result<Vec<_>, _>>()?;
        if threads.iter().any(|t| t.is_empty() || t.iter().any(|at| *at >= yarns.len())) {
            return Err(refuse("threads", format!("{threads:?}"), format!("use indices below {}", yarns.len())));
        }
        check(&fabric)?;
        let draft = fabric.draft();
        let rows = (0..draft.picks())
            .map(|pick| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect::<String>());
        let [warp, weft] = YarnSet::EACH.map(|family| {
            let YarnShape { plies, ply_radius_um, ply_pitch_um, handedness, spacing_um, crimp, .. } =
                *fabric.shape(family);
            let threads = threads[family as usize].clone();
            TextYarn { plies, ply_radius_um, ply_pitch_um, handedness, spacing_um, crimp, threads }
        });
        let text = Text { name: name.into(), draft: rows.collect(), warp, weft, yarns: specs };
        // Strings, finite numbers and lists: nothing that JSON cannot hold.
        let text = serde_json::to_string(&text).unwrap_or_default();
        Ok(TwinCloth { name: name.into(), fabric, yarns, threads, text })
    }

    /// A cloth from its own text.
    ///
    /// # Errors
    /// As [`TwinCloth::from_loaded`], and [`SimError::Merge`] for other text.
    pub fn parse(text: &str) -> Result<TwinCloth, SimError> {
        let Text { name, draft: rows, warp, weft, yarns } =
            serde_json::from_str(text).map_err(|e| SimError::Merge {
                what: format!("the text of the cloth: {e}"),
                hint: "read it with the program that wrote it".into(),
            })?;
        let up = |pick: usize, end: usize| rows[pick].as_bytes().get(end) == Some(&b'X');
        let draft = Draft::from_fn(rows.len(), rows.first().map_or(0, String::len), up)
            .ok_or_else(|| refuse("draft", format!("{} rows", rows.len()), "use 1 to 4096 rows".into()))?;
        let (shapes, threads): (Vec<YarnShape>, Vec<Vec<usize>>) = [warp, weft]
            .into_iter()
            .map(|yarn| {
                let TextYarn { plies, ply_radius_um, ply_pitch_um, handedness, spacing_um, crimp, threads } = yarn;
                let d_cut_um = 0.0;
                let shape = YarnShape { plies, ply_radius_um, ply_pitch_um, handedness, spacing_um, crimp, d_cut_um };
                (shape, threads)
            })
            .unzip();
        let fabric = Fabric::new(draft, [shapes[0], shapes[1]])?;
        TwinCloth::new(&name, fabric, yarns, [threads[0].clone(), threads[1].clone()])
    }

    /// Its text: all that the fibers depend on, except the seed.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The first key that affects the fibers in which a fabric differs from this cloth; `None` if they are
    /// the same.
    pub fn difference(&self, loaded: &LoadedFabric) -> Option<&'static str> {
        if self.fabric.draft() != loaded.fabric.draft() {
            return Some("weave");
        }
        let shape = |fabric: &Fabric, family| YarnShape { d_cut_um: 0.0, ..*fabric.shape(family) };
        for (family, name) in [(YarnSet::Warp, "warp"), (YarnSet::Weft, "weft")] {
            if shape(&self.fabric, family) != shape(&loaded.fabric, family) {
                return Some(name);
            }
        }
        for (family, name) in [(YarnSet::Warp, "warp.model"), (YarnSet::Weft, "weft.model")] {
            let count = self.threads[family as usize].len().max(loaded.threads[family as usize].len());
            for yarn in 0..count {
                let text = &loaded.model_of(family, yarn as i32).data().spec_text;
                let ours = &self.yarns[self.spec_index(family, yarn)];
                if !YarnSpec::parse(text, name).is_ok_and(|y| y.fiber == ours.fiber && y.ply == ours.ply) {
                    return Some(name);
                }
            }
        }
        None
    }

    /// Index of the spec of a yarn.
    pub fn spec_index(&self, family: YarnSet, yarn: usize) -> usize {
        let threads = &self.threads[family as usize];
        threads[yarn % threads.len()]
    }
}

fn refuse(key: &str, value: String, hint: String) -> SimError {
    Error::Invalid { file: "cloth".into(), key: key.into(), value, hint }.into()
}

/// Refuses yarns that intersect, and those that bend more sharply than their own width allows.
fn check(fabric: &Fabric) -> Result<(), SimError> {
    let overlap = fabric.largest_overlap();
    if overlap.depth_um > OVERLAP_TOLERANCE_UM {
        return Err(SimError::YarnsIntersect { overlap, crimps: YarnSet::EACH.map(|f| fabric.shape(f).crimp) });
    }
    for family in YarnSet::EACH {
        let (radius_um, half_um) = (fabric.least_bend_radius_um(family), 0.5 * fabric.shape(family).width_um());
        if radius_um < half_um {
            return Err(SimError::YarnBends { family: family.name(), radius_um, half_um });
        }
    }
    Ok(())
}
