//! What ships, as the bytes of its files: an installed program finds `model = "polyester"` without any file
//! beside it, and `plywave new` writes specs from it.

/// A list of models by the names of their files.
macro_rules! models {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_bytes!(concat!("models/", $name, ".pwm")))),*]
    };
}

/// Name and file of every model that ships.
pub static MODELS: &[(&str, &[u8])] = models![
    "alpaca",
    "cotton",
    "cotton_2ply",
    "cotton_3ply",
    "cotton_4ply",
    "cotton_bundle_ne40",
    "cotton_bundle_ne7",
    "cotton_single",
    "flax_bundle",
    "glass",
    "glass_bundle",
    "gold",
    "polyester",
    "polyester_3ply",
    "polyester_bundle",
    "silk",
    "silk_single",
    "viscose",
    "wool",
    "wool_2ply",
    "worsted_bundle",
    "worsted_single",
];

/// Files by their paths.
macro_rules! files {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_bytes!($path))),*]
    };
}

/// Path, below this folder, and bytes of every spec of a yarn and of a cloth that ships, and of the files that
/// they name.
pub static SPECS: &[(&str, &[u8])] = files![
    "alpaca.toml",
    "cotton.toml",
    "cotton_2ply.toml",
    "cotton_3ply.toml",
    "cotton_4ply.toml",
    "cotton_family.toml",
    "glass.toml",
    "gold.toml",
    "polyester.toml",
    "polyester_3ply.toml",
    "polyester_family.toml",
    "silk.toml",
    "viscose.toml",
    "wool.toml",
    "wool_2ply.toml",
    "cloths/cable.toml",
    "cloths/damask.png",
    "cloths/damask.toml",
    "cloths/denim.toml",
    "cloths/flannel.toml",
    "cloths/gabardine.toml",
    "cloths/glass.toml",
    "cloths/gold.toml",
    "cloths/herringbone.toml",
    "cloths/hopsack.toml",
    "cloths/houndstooth.toml",
    "cloths/jersey.toml",
    "cloths/lace.toml",
    "cloths/linen.toml",
    "cloths/melton.toml",
    "cloths/organza.toml",
    "cloths/percale.toml",
    "cloths/rib.toml",
    "cloths/satin.toml",
    "cloths/tartan.toml",
];

/// Specs of the plies of the models that ship, by name, as a JSON object.
pub static PLIES: &str = include_str!("models/plies.json");

/// Families of bundles from which `plywave swatch` takes the models of yarns, by name.
pub static FAMILIES: &[(&str, &[u8])] = &[
    ("cotton_bundle", include_bytes!("families/cotton_bundle.pwfam")),
    ("polyester_bundle", include_bytes!("families/polyester_bundle.pwfam")),
];
