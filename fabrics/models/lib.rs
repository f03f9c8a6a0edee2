//! The ply models that ship, as the bytes of their files: an installed program finds `model = "polyester"`
//! without any file beside it.

/// A list of models by the names of their files.
macro_rules! models {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_bytes!(concat!($name, ".pwm")))),*]
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
