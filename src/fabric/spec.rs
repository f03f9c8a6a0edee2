//! The fabric spec (TOML): the weave, and the yarns of warp and weft. Lengths in um; the unit is part of the key. Keys, ranges and relations are in
//! `check.rs`.

use super::check::{check_keys, check_model, check_relations, format_error, invalid};
use super::draft::Draft;
use super::wif::{self, Wif};
use super::yarn::YarnShape;
use super::{Fabric, Family};
use crate::{Error, Handedness, PlyModel, Result, YarnSpec};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest fabric spec that is read [bytes]: a draft of 4096 x 4096 in rows of text takes 17 MB.
const MAX_BYTES: u64 = 32 << 20;

/// A fabric spec, as `fabrics/cotton_twill.toml`. Unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FabricSpec {
    /// Name of the fabric, for the record.
    pub name: String,
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
    /// Path of the ply's model, relative to the spec.
    pub model: String,
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
    /// From the axis of a yarn to that of the next [um].
    pub spacing_um: f64,
    /// Amplitude of the yarn's height over the distance of the axes of touching yarns, [`YarnShape::crimp`].
    #[serde(default = "half")]
    pub crimp: f64,
    /// Color of the yarns [sRGB, 0 to 1].
    #[serde(default)]
    pub srgb: Option<[f64; 3]>,
    /// Absorption coefficient of the fibers [1/um], in place of a color.
    #[serde(default)]
    pub sigma_per_um: Option<f64>,
}

fn one() -> u32 {
    1
}

fn half() -> f64 {
    0.5
}

/// What a yarn is colored by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YarnColor {
    /// Neither the spec nor a WIF says anything: clear fibers.
    Undyed,
    /// A color [sRGB, 0 to 1].
    Srgb([f32; 3]),
    /// An absorption coefficient [1/um].
    Sigma(f32),
}

/// A fabric spec with what it refers to: all that a host needs to shade a fabric.
#[derive(Clone, Debug)]
pub struct LoadedFabric {
    /// The spec.
    pub spec: FabricSpec,
    /// The geometry.
    pub fabric: Fabric,
    /// Paths of the models of warp and weft.
    pub model_paths: [PathBuf; 2],
    /// Models of warp and weft; one and the same where the paths are.
    pub models: [Arc<PlyModel>; 2],
}

impl LoadedFabric {
    /// What is left out because a model does not hold it, a line each; none where the models are whole.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let mut add = |note: String| {
            if !notes.contains(&note) {
                notes.push(note);
            }
        };
        for (k, family) in Family::EACH.into_iter().enumerate() {
            let (name, plies) = (family.name(), self.spec.yarn(family).plies);
            let (data, model) = (self.models[k].data(), self.model_paths[k].display());
            // What cannot be read was refused when the fabric was loaded.
            let of = YarnSpec::parse(&data.spec_text, "").map_or(1, |ply| ply.yarn.plies);
            if plies > 1 && of == 1 {
                add(format!("{name}.plies = {plies}: {model} is of one ply, so each ply scatters as if it were alone"));
            }
            if data.edge.is_none() {
                add(format!("{model} has no edge lobes: light beside a ply goes straight on"));
            }
            if data.layers.is_none() {
                add(format!("{model} has no layer factors: where two yarns lie, the light is that of the upper one"));
            }
        }
        notes
    }
}

impl FabricSpec {
    /// Reads a spec from its text; `file` is for messages only. Files it names are not read.
    ///
    /// # Errors
    /// [`Error::Format`] when the text is not TOML, [`Error::Invalid`] for a key that is unknown, absent or out of range, and for a draft that binds
    /// a yarn nowhere.
    pub fn parse(text: &str, file: &str) -> Result<FabricSpec> {
        let table: toml::Table = toml::from_str(text).map_err(|e| {
            let at = e.span().and_then(|span| text.as_bytes().get(..span.start)).map(|head| {
                let line = 1 + head.iter().filter(|&&byte| byte == b'\n').count();
                format!("line {line}: ")
            });
            format_error(file, at.unwrap_or_default() + e.message())
        })?;
        check_keys(file, &table)?;
        let spec: FabricSpec =
            table.try_into().map_err(|e: toml::de::Error| format_error(file, e.message().to_string()))?;
        check_relations(file, &spec)?;
        Ok(spec)
    }

    /// Checks a spec that was made or changed in code, by the same rules as a parsed one.
    ///
    /// # Errors
    /// [`Error::Invalid`], with `file` as given.
    pub fn check(&self, file: &str) -> Result<()> {
        let table = toml::Table::try_from(self).map_err(|e| format_error(file, e.to_string()))?;
        check_keys(file, &table)?;
        check_relations(file, self)
    }

    /// The yarns of a family.
    pub fn yarn(&self, family: Family) -> &YarnOfFabric {
        match family {
            Family::Warp => &self.warp,
            Family::Weft => &self.weft,
        }
    }

    /// Reads a spec, its WIF if it has one, and its models.
    ///
    /// # Errors
    /// As [`FabricSpec::parse`], [`Wif::parse`] and [`PlyModel::load`], [`Error::Io`] when a file cannot be read, and [`Error::Invalid`] for a
    /// spacing narrower than the yarn, for a number of plies that a model of a yarn is not of, and for a radius that is not that of the model's plies.
    pub fn load(path: impl AsRef<Path>) -> Result<LoadedFabric> {
        let path = path.as_ref();
        let file = path.display().to_string();
        let folder = path.parent().unwrap_or(Path::new(""));
        let text = String::from_utf8(read_bytes(path, MAX_BYTES)?).map_err(|_| Error::Format {
            file: file.clone(),
            what: "not text in UTF-8".into(),
            mend: "save it as UTF-8 text".into(),
        })?;
        let spec = FabricSpec::parse(&text, &file)?;
        let (draft, threads) = spec.draft_near(folder, &file)?;
        let model_paths = Family::EACH.map(|family| folder.join(&spec.yarn(family).model));
        let warp = Arc::new(PlyModel::load(&model_paths[0])?);
        let weft =
            if model_paths[0] == model_paths[1] { warp.clone() } else { Arc::new(PlyModel::load(&model_paths[1])?) };
        let models = [warp, weft];
        let mut shapes = Vec::with_capacity(2);
        for (k, family) in Family::EACH.into_iter().enumerate() {
            let name = format!("{} (its spec)", model_paths[k].display());
            let ply = YarnSpec::parse(&models[k].data().spec_text, &name)?;
            check_model(&file, family, spec.yarn(family), &model_paths[k].display().to_string(), &ply)?;
            shapes.push(spec.shape(family, &ply));
        }
        let shapes = [shapes[0], shapes[1]];
        let fabric = Fabric::named(draft, shapes, spec.colors(threads), &file)?;
        Ok(LoadedFabric { spec, fabric, model_paths, models })
    }

    /// Shape of the yarns of a family, of the plies of a yarn spec where the fabric's does not give their radius. Of an elliptical ply the greater
    /// semi-axis counts, which holds all of it.
    pub fn shape(&self, family: Family, ply: &YarnSpec) -> YarnShape {
        let yarn = self.yarn(family);
        let [a, b] = ply.ply_radii_um();
        YarnShape {
            plies: yarn.plies,
            ply_radius_um: yarn.ply_radius_um.unwrap_or(a.max(b)),
            ply_pitch_um: yarn.ply_pitch_um,
            handedness: yarn.handedness,
            spacing_um: yarn.spacing_um,
            crimp: yarn.crimp,
            d_cut_um: ply.beam.beam().d_cut_um,
        }
    }

    /// The draft and the WIF's colors of ends and picks, empty where there are none.
    fn draft_near(&self, folder: &Path, file: &str) -> Result<(Draft, [Vec<[f32; 3]>; 2])> {
        if let WeaveSpec::Wif { file } = &self.weave {
            let path = folder.join(file);
            let wif = Wif::parse(&read_bytes(&path, wif::MAX_BYTES)?, &path.display().to_string())?;
            return Ok((wif.draft, [wif.warp_srgb, wif.weft_srgb]));
        }
        let draft = self.weave.draft();
        let mend = "use a weave that is not from a file";
        Ok((draft.ok_or_else(|| invalid(file, "weave.kind", "no draft", mend))?, [Vec::new(), Vec::new()]))
    }

    /// Colors of one repeat of ends and picks, or of all of them: the spec's own go before a WIF's.
    fn colors(&self, threads: [Vec<[f32; 3]>; 2]) -> [Vec<YarnColor>; 2] {
        let [warp, weft] = threads;
        let of = |yarn: &YarnOfFabric, threads: Vec<[f32; 3]>| match (yarn.srgb, yarn.sigma_per_um) {
            (Some(srgb), _) => vec![YarnColor::Srgb(srgb.map(|c| c as f32))],
            (None, Some(sigma)) => vec![YarnColor::Sigma(sigma as f32)],
            (None, None) if threads.is_empty() => vec![YarnColor::Undyed],
            (None, None) => threads.into_iter().map(YarnColor::Srgb).collect(),
        };
        [of(&self.warp, warp), of(&self.weft, weft)]
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

/// The bytes of a file of at most `most` bytes.
fn read_bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let file = path.display().to_string();
    let io = |source| Error::Io { file: file.clone(), source };
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(io)?.take(most + 1).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > most {
        return Err(Error::Format {
            file,
            what: format!("larger than {most} bytes"),
            mend: "use a smaller file".into(),
        });
    }
    Ok(bytes)
}
