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
    "glass",
    "gold",
    "polyester",
    "polyester_3ply",
    "silk",
    "viscose",
    "wool",
    "wool_2ply",
];

/// Files by their paths.
macro_rules! files {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_bytes!($path))),*]
    };
}

/// Path, below this folder, and bytes of every spec of a yarn and of a cloth that ships, and of the models of
/// the cloths' plies.
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
    "cloths/denim.toml",
    "cloths/flannel.toml",
    "cloths/gabardine.toml",
    "cloths/glass.toml",
    "cloths/gold.toml",
    "cloths/hopsack.toml",
    "cloths/jersey.toml",
    "cloths/linen.toml",
    "cloths/melton.toml",
    "cloths/organza.toml",
    "cloths/percale.toml",
    "cloths/rib.toml",
    "cloths/satin.toml",
    "cloths/plies/cotton_bundle_ne40.pwm",
    "cloths/plies/cotton_bundle_ne40.toml",
    "cloths/plies/cotton_bundle_ne7.pwm",
    "cloths/plies/cotton_bundle_ne7.toml",
    "cloths/plies/cotton_single.pwm",
    "cloths/plies/cotton_single.toml",
    "cloths/plies/flax_bundle.pwm",
    "cloths/plies/flax_bundle.toml",
    "cloths/plies/glass_bundle.pwm",
    "cloths/plies/glass_bundle.toml",
    "cloths/plies/polyester_bundle.pwm",
    "cloths/plies/polyester_bundle.toml",
    "cloths/plies/silk_single.pwm",
    "cloths/plies/silk_single.toml",
    "cloths/plies/worsted_bundle.pwm",
    "cloths/plies/worsted_bundle.toml",
    "cloths/plies/worsted_single.pwm",
    "cloths/plies/worsted_single.toml",
];
