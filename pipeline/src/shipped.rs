//! The library of ply models, with the shipped models ([`plywave_models`]).

use plywave::io::ModelLibrary;
pub use plywave_models::MODELS as SHIPPED_MODELS;

/// [`ModelLibrary::usual`] with the shipped models.
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
