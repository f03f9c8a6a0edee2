//! plywave in a browser: ply and cloth models from the bytes of their files, and progressive pictures of
//! cloths.
//!
//! `wasm-bindgen` generates classes and types for the public items (`viewer/README.md`). Errors are
//! JavaScript errors whose message is a sentence for the user. An instance has one thread; several instances,
//! each in a worker of its own, share a picture by tiles ([`Picture`]).

mod cloth;
mod picture;
mod ply;
mod traced;

pub use cloth::Cloth;
pub use picture::Picture;
pub use ply::Ply;
pub use traced::Traced;

use wasm_bindgen::prelude::wasm_bindgen;

/// Version of plywave.
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_string()
}

/// Kind of a file according to its first bytes: `ply`, `cloth`, `table`, or `undefined` for other files.
#[wasm_bindgen(js_name = kindOf)]
pub fn kind_of(bytes: &[u8]) -> Option<String> {
    // The JSON header follows its length, which takes 8 bytes (docs/reference/format).
    let length = u64::from_le_bytes(*bytes.first_chunk::<8>()?);
    let header = bytes.get(8..8usize.checked_add(usize::try_from(length).ok()?)?)?;
    let has = |word: &str| header.windows(word.len()).any(|w| w == word.as_bytes());
    match () {
        () if has("control_um") => Some("cloth".into()),
        () if has("plywave-table") => Some("table".into()),
        () if has("high_path") => Some("ply".into()),
        () => None,
    }
}

/// Largest number of characters of an error.
const LONGEST: usize = 300;

/// A JavaScript error with a message of one line.
fn failed(error: impl std::fmt::Display) -> wasm_bindgen::JsError {
    wasm_bindgen::JsError::new(&plywave::one_line(&error.to_string(), LONGEST))
}

/// Directions of a map of the sphere: rows of equal colatitude from the pole z, each direction at the center
/// of its cell; their number is `rows * columns`.
fn sphere(rows: usize, columns: usize) -> Vec<[f32; 3]> {
    let mut directions = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        let (sin, cos) = (std::f32::consts::PI * (row as f32 + 0.5) / rows as f32).sin_cos();
        for column in 0..columns {
            let phi = std::f32::consts::TAU * (column as f32 + 0.5) / columns as f32;
            directions.push([sin * phi.cos(), sin * phi.sin(), cos]);
        }
    }
    directions
}
