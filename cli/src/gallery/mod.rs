//! The gallery: pictures that show what the model does, the models and fabrics they are made of, and the pages that list them.

pub mod materials;
pub mod pages;
pub mod pictures;

/// A hash of bytes for telling settings apart (FNV-1a, 64 bits), in hex.
pub fn digest(bytes: &[u8]) -> String {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}
