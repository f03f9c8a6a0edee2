//! Yarn specs: a `[yarn]` in the language of cloths, the `[fiber]` and `[ply]` that it stands for, or a cloth
//! spec, of which the ply of the warp or of the only yarn is taken.

use crate::cloth_spec::ClothSpec;
use crate::yarn::keys::YARN;
use crate::yarn::resolve::{Use, resolve};
use crate::yarn::{fibers, old};
use plywave::Result;
use plywave::io::{AssetSource, Folder, read_text};
use plywave::spec::rules::{self, Key, KeyKind, Rules, invalid, optional, required};
use plywave::spec::{BlendSpec, YARN_RULES, YarnGeometry, YarnSpec};
use std::path::Path;
use toml::{Table, Value};

/// Largest yarn spec [bytes].
const MAX_BYTES: u64 = 4 << 20;

/// Tables that a yarn spec shares with the ply spec that it stands for.
const SHARED: [&str; 4] = ["beam", "absorption", "simulation", "family"];

/// Rules of a yarn spec in the language of cloths, apart from the shared tables.
const RULES: Rules = Rules {
    keys: &[
        required("name", KeyKind::Text),
        required("yarn", KeyKind::Table(YARN)),
        optional("blend", KeyKind::Table(BLEND), "fibers of one kind"),
    ],
    units: &["_per_um", "_um", "_mm", "_percent"],
    example: "fabrics/cotton.toml",
    foreign: &[(
        &["warp", "weft"],
        "this is a key of a cloth spec, which has [weave] or [curves] too; a yarn spec has one [yarn]",
    )],
};
const BLEND: &[Key] = &[
    required("fiber", KeyKind::Custom(fibers::RULE)),
    required("share", KeyKind::Number(0.01, 0.99)),
    optional("dye", KeyKind::Number(0.0, 10.0), "1.0"),
];

/// Reads a yarn spec from its text, and from `assets` a file that it may name. Returns the spec of the ply
/// and the text to embed in tables and models, which [`YarnSpec::parse`] parses to the same spec.
///
/// # Errors
/// [`plywave::Error::Format`] for text that is not TOML, [`plywave::Error::Invalid`] for a key that is
/// unknown, absent or out of range, and for keys that contradict each other.
pub fn load_yarn(text: &str, file: &str, assets: &dyn AssetSource) -> Result<(YarnSpec, String)> {
    let mut root: Table = toml::from_str(text).unwrap_or_default();
    if ["weave", "knit", "curves"].iter().any(|key| root.contains_key(*key)) {
        let cloth = ClothSpec::parse(text, file)?;
        let yarns = cloth.yarns();
        let Some(yarn) = yarns.first() else {
            return Err(invalid(file, "yarn", "(absent)", "this table must be given"));
        };
        let spec = yarn.ply(file, cloth.kind_name(0))?;
        let text = spec.to_text(file)?;
        return Ok((spec, text));
    }
    let is_label = |yarn: &Value| yarn.as_table().is_some_and(|yarn| yarn.contains_key("fiber"));
    if !root.get("yarn").is_some_and(is_label) {
        return YarnSpec::load_from(text, file, assets);
    }
    if let Some(yarn) = root.get("yarn").and_then(Value::as_table) {
        old::check(file, "yarn", yarn)?;
    }
    let shared: Vec<(String, Value)> =
        SHARED.iter().filter_map(|name| root.remove(*name).map(|value| ((*name).to_string(), value))).collect();
    rules::check(file, &root, &RULES)?;
    let Some(Value::Table(keys)) = root.get("yarn") else {
        return Err(invalid(file, "yarn", "(absent)", "this table must be given"));
    };
    let yarn = resolve(file, "yarn", keys, Use::Loose)?;
    let mut spec = yarn.ply(file, "yarn")?;
    spec.name = root.get("name").and_then(Value::as_str).unwrap_or_default().into();
    spec.ply.min_gap_um = 0.2;
    if let Some(Value::Table(blend)) = root.get("blend") {
        let of = |key: &str| blend.get(key).and_then(rules::number);
        let fiber = fibers::read(file, "blend.fiber", blend.get("fiber").unwrap_or(&Value::Boolean(false)))?;
        spec.blend =
            Some(BlendSpec { share: of("share").unwrap_or(0.5), dye: of("dye").unwrap_or(1.0), fiber: fiber.spec });
    }
    let (hand, turns) = yarn.strand_twist;
    spec.yarn = YarnGeometry {
        plies: yarn.plies,
        ply_pitch_um: (turns > 0.0).then(|| (1e6 / turns).round()),
        handedness: hand,
    };
    let mut low = Table::try_from(&spec).unwrap_or_default();
    low.extend(shared);
    rules::check(file, &low, &YARN_RULES)?;
    let spec: YarnSpec = rules::typed(low, file, &YARN_RULES)?;
    spec.check(file)?;
    let text = spec.to_text(file)?;
    Ok((spec, text))
}

/// Reads a yarn spec from a file; see [`load_yarn`]. A file that it names must lie in its folder or below.
///
/// # Errors
/// Those of [`load_yarn`], and [`plywave::Error::Io`] if a file cannot be read.
pub fn load_yarn_file(path: impl AsRef<Path>) -> Result<(YarnSpec, String)> {
    let path = path.as_ref();
    load_yarn(&read_text(path, MAX_BYTES)?, &path.display().to_string(), &Folder::of_file(path))
}
