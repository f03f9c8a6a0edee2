//! Pixel values of a picture as stored in its file, and limits on its size.

use crate::RenderError;
use crate::memory_limit::check_memory;
use crate::sky::primaries::Primaries;

/// Largest number of texels of an environment: 16384 x 8192.
pub(crate) const MAX_TEXELS: u64 = 1 << 27;
/// Bytes per texel of an environment: the colors, twice during reading, and the cumulative sums.
pub(crate) const TEXEL_BYTES: u64 = 32;
/// Smallest and largest accepted aspect ratio; a picture in latitude and longitude has 2.
pub(crate) const ASPECTS: [f64; 2] = [0.5, 8.0];

/// Linear values as stored in the file, before invalid radiances are replaced.
pub(crate) struct Picture {
    pub width: usize,
    /// `values[y][x]`, rows from the top.
    pub values: Vec<[f32; 3]>,
    /// Whether the values are half floats, whose largest value replaces infinity.
    pub is_half: bool,
    /// Names of the channels.
    pub names: [String; 3],
    /// Primaries of the values.
    pub primaries: Primaries,
}

/// Message for primaries that lie on one line or cannot mix their white.
pub(crate) fn no_colors(primaries: Primaries) -> String {
    let [red, green, blue, white] = primaries.0;
    format!(
        "its primaries {red:?}, {green:?}, {blue:?} and white {white:?} make no colors; correct them, or save it as linear sRGB"
    )
}

/// Refuses a picture whose aspect ratio is far from 2.
pub(crate) fn check_shape(name: &str, [w, h]: [u64; 2]) -> Result<(), RenderError> {
    let [low, high] = ASPECTS;
    if (low..=high).contains(&(w as f64 / h.max(1) as f64)) {
        return Ok(());
    }
    let what = format!(
        "{w} x {h} texels; a sky in latitude and longitude is twice as wide as high, and from {low} to {high} times is read"
    );
    Err(RenderError::Picture { file: name.into(), what })
}

/// Refuses a picture that has too many texels or does not fit in memory.
pub(crate) fn check_size(name: &str, [w, h]: [u64; 2], sample_bytes: u64) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let texels = w.saturating_mul(h);
    if texels == 0 {
        return Err(bad(format!("{w} x {h} texels; use a picture of at least one")));
    }
    if texels > MAX_TEXELS {
        return Err(bad(format!("{w} x {h} texels; use a picture of at most {MAX_TEXELS}")));
    }
    check_memory(&format!("{name}: a sky of {w} x {h} texels"), texels.saturating_mul(sample_bytes + TEXEL_BYTES))
}
