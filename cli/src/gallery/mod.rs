//! The gallery: pictures that show what the model does, the models and fabrics they are made of, and the pages that list them.

pub mod materials;
pub mod pages;
pub mod pictures;

/// A hash of bytes for telling settings apart (FNV-1a, 64 bits), in hex.
pub fn digest(bytes: &[u8]) -> String {
    plywave::math::hash::Fnv64::new().with(bytes).hex()
}
