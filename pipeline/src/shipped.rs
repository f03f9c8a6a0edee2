//! The ply models that ship, compiled in, so that an installed program finds `model = "polyester"` without
//! any file beside it.

use plywave::io::ModelLibrary;

/// A list of models by the names of their files.
macro_rules! models {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_bytes!(concat!("../../fabrics/models/", $name, ".pwm")))),*]
    };
}

/// Name and file of every model that ships.
pub static SHIPPED_MODELS: &[(&str, &[u8])] = models![
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

/// [`ModelLibrary::usual`] with the models that ship.
pub fn model_library() -> ModelLibrary {
    ModelLibrary::usual().with_embedded(SHIPPED_MODELS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_of_the_folder_ships() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics/models");
        let there = ModelLibrary::none().with_folder(folder).names();
        let shipped = ModelLibrary::none().with_embedded(SHIPPED_MODELS);
        assert_eq!(shipped.names(), there);
        for name in there {
            let (shown, bytes) = shipped.read(&name).unwrap();
            assert_eq!((shown, bytes), (name.clone(), std::fs::read(format!("{folder}/{name}.pwm")).unwrap()));
        }
    }
}
