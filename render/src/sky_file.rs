//! Skies from files: their limits, invalid radiances and primaries; Radiance pictures. OpenEXR is in
//! `sky_exr.rs`.

use crate::primaries::Primaries;
use crate::room::{check_room, open_file};
use crate::sky_exr::read_exr;
use crate::{Environment, RenderError};
use glam::DVec3;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// Largest number of texels of an environment: 16384 x 8192.
const MAX_TEXELS: u64 = 1 << 27;
/// Largest file that is read [bytes]: all texels as 32-bit floats in eight channels.
const MAX_BYTES: u64 = 32 * MAX_TEXELS;
/// Bytes per texel of an environment: the colors, twice while they are read, and the running sums.
const TEXEL_BYTES: u64 = 32;
/// Least size of a row of a Radiance picture [bytes].
const ROW_BYTES: u64 = 4;
/// The largest finite half float, which replaces infinite values.
const MAX_HALF: f32 = 65504.0;
/// Largest radiance; far above the sun's over that of its sky.
const MAX_RADIANCE: f32 = 1e12;
/// Least and largest width over height; a picture in latitude and longitude has 2.
const ASPECTS: [f64; 2] = [0.5, 8.0];
/// Largest value below 0, over a color's largest, that counts as rounding of a color at the edge of sRGB.
const EDGE: f64 = 1e-5;

/// Linear values as in the file, before invalid radiances are replaced.
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

impl Environment {
    /// A picture in latitude and longitude: OpenEXR, or Radiance (`.hdr`, `.pic`), rows from the zenith down;
    /// with notes on assumptions and replaced values, a line each.
    ///
    /// An EXR has colors in channels `R`, `G`, `B`, in `Y`, `RY`, `BY`, or in one channel that counts as
    /// gray, in a layer of any name. Of several layers, `layer` chooses one; by default it is the one without
    /// a name or with a name for all light. Values of other primaries (`chromaticities` of an EXR,
    /// `PRIMARIES` of a Radiance picture) are converted to linear sRGB, which they are without such a line.
    /// Negative values and NaN count as 0, infinite half floats as the largest half.
    ///
    /// # Errors
    /// [`RenderError::Picture`] if the file cannot be read, has more than 134 M texels, a shape far from
    /// twice as wide as high, an EXR's display window far larger than its data, primaries that make no
    /// colors, no colors, or no such `layer`; [`RenderError::TooLarge`]; [`RenderError::Io`].
    pub fn load(path: &Path, layer: Option<&str>) -> Result<(Environment, Vec<String>), RenderError> {
        let name = path.display().to_string();
        let bad = |what: String| RenderError::Picture { file: name.clone(), what };
        let (mut file, bytes) = open_file(path, MAX_BYTES)?;
        let mut magic = Vec::new();
        let read = file.by_ref().take(4).read_to_end(&mut magic).and_then(|_| file.rewind());
        read.map_err(|source| RenderError::Io { file: name.clone(), source })?;
        let mut notes = Vec::new();
        let picture = if magic == [0x76, 0x2f, 0x31, 0x01] {
            read_exr(file, &name, bytes, layer, &mut notes)?
        } else if magic.starts_with(b"#?") {
            if let Some(layer) = layer {
                return Err(bad(format!("a Radiance picture has no layers, so none is named {layer}; leave it out")));
            }
            read_radiance(file, &name, bytes)?
        } else {
            return Err(bad("neither OpenEXR nor Radiance; convert it to an .exr or .hdr in linear light".into()));
        };
        let Picture { width, mut values, is_half, names, primaries } = picture;
        let height = values.len() / width.max(1);
        // Of other primaries, a value below 0 may belong to a color of sRGB.
        let least = if primaries.is_srgb() { 0.0 } else { -MAX_RADIANCE };
        notes.extend(mend(&mut values, width, least, is_half, &names));
        if !primaries.is_srgb() {
            notes.push(convert(&mut values, width, primaries).map_err(bad)?);
        }
        if width != 2 * height {
            notes.push(format!(
                "{width} x {height} texels are stretched over the sphere; a picture in latitude and longitude has twice as many columns as rows"
            ));
        }
        let sky = Environment::picture(width, values).map_err(|e| bad(e.to_string()))?;
        if sky.is_dark() {
            notes.push("black: no light comes from it".into());
        }
        Ok((sky, notes))
    }
}

/// Replaces invalid radiances; returns a line with their number and the first.
fn mend(values: &mut [[f32; 3]], width: usize, least: f32, is_half: bool, names: &[String; 3]) -> Option<String> {
    let mended = |v: f32| match v {
        v if v == f32::INFINITY => {
            if is_half {
                MAX_HALF
            } else {
                0.0
            }
        }
        v if v.is_nan() || v == f32::NEG_INFINITY => 0.0,
        // Without the sign of a zero.
        v => v.clamp(least, MAX_RADIANCE) + 0.0,
    };
    let (mut count, mut first) = (0u64, None);
    let gray = names[0] == names[1];
    for (at, texel) in values.iter_mut().enumerate() {
        for (k, v) in texel.iter_mut().enumerate() {
            let new = mended(*v);
            // NaN is unequal to all values.
            if new != *v && !(gray && k > 0) {
                count += 1;
                first.get_or_insert((at % width, at / width, k, *v, new));
            }
            *v = new;
        }
    }
    let (x, y, k, old, new) = first?;
    let name = &names[k];
    Some(if count == 1 {
        format!("{name} of pixel ({x}, {y}) is {old}, taken as {new}")
    } else {
        format!("{count} values are no radiances; the first, {name} of pixel ({x}, {y}), is {old}, taken as {new}")
    })
}

/// Converts values of other primaries to linear sRGB, cuts them at 0 and says so.
fn convert(values: &mut [[f32; 3]], width: usize, primaries: Primaries) -> Result<String, String> {
    let to_srgb = primaries.to_srgb().ok_or_else(|| no_colors(primaries))?;
    let (mut count, mut first) = (0u64, None);
    for (at, texel) in values.iter_mut().enumerate() {
        // Grays stay the same to the last bit.
        if texel[0] != texel[1] || texel[1] != texel[2] {
            let srgb = to_srgb * DVec3::from(texel.map(f64::from));
            if srgb.min_element() < -EDGE * srgb.max_element().max(0.0) {
                count += 1;
                first.get_or_insert((at % width, at / width, srgb));
            }
            *texel = srgb.as_vec3().to_array();
        }
        *texel = texel.map(|v| v.clamp(0.0, MAX_RADIANCE));
    }
    let mut note = "its colors are converted from its own primaries to those of sRGB".to_string();
    if let Some((x, y, [r, g, b])) = first.map(|(x, y, srgb)| (x, y, srgb.to_array())) {
        note += &format!(
            "; {count} of {} texels are outside of sRGB and cut at 0: the first, ({x}, {y}), is ({r:.4}, {g:.4}, {b:.4})",
            values.len()
        );
    }
    Ok(note)
}

/// What is said of primaries that lie on one line, or do not mix their white.
pub(crate) fn no_colors(primaries: Primaries) -> String {
    let [red, green, blue, white] = primaries.0;
    format!(
        "its primaries {red:?}, {green:?}, {blue:?} and white {white:?} make no colors; correct them, or save it as linear sRGB"
    )
}

/// Refuses a picture far from twice as wide as high.
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

/// Refuses a picture that is too large.
pub(crate) fn check_size(name: &str, [w, h]: [u64; 2], sample_bytes: u64) -> Result<(), RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let texels = w.saturating_mul(h);
    if texels == 0 {
        return Err(bad(format!("{w} x {h} texels; use a picture of at least one")));
    }
    if texels > MAX_TEXELS {
        return Err(bad(format!("{w} x {h} texels; use a picture of at most {MAX_TEXELS}")));
    }
    check_room(&format!("{name}: a sky of {w} x {h} texels"), texels.saturating_mul(sample_bytes + TEXEL_BYTES))
}

fn read_radiance(file: BufReader<File>, name: &str, bytes: u64) -> Result<Picture, RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let decoder = HdrDecoder::new_nonstrict(file).map_err(|e| bad(e.to_string()))?;
    let (w, h) = decoder.dimensions();
    check_size(name, [w, h].map(u64::from), 12)?;
    check_shape(name, [w, h].map(u64::from))?;
    if u64::from(h) * ROW_BYTES > bytes {
        return Err(bad(format!("{w} x {h} texels do not fit into {bytes} bytes; the file is cut off")));
    }
    // Header lines give the factors of the radiances.
    let about = decoder.metadata();
    let by = about.exposure.unwrap_or(1.0);
    let (r, g, b) = about.color_correction.unwrap_or((1.0, 1.0, 1.0));
    if let Some(wrong) = [by, r, g, b].into_iter().find(|v| !(v.is_finite() && *v > 0.0)) {
        return Err(bad(format!("EXPOSURE or COLORCORR is {wrong}; it is a finite number above 0")));
    }
    let primaries = radiance_primaries(&about.custom_attributes).map_err(bad)?;
    let image = image::DynamicImage::from_decoder(decoder).map_err(|e| bad(e.to_string()))?;
    let mut values = image.into_rgb32f().into_raw().as_chunks().0.to_vec();
    for texel in &mut values {
        *texel = [texel[0] / (by * r), texel[1] / (by * g), texel[2] / (by * b)];
    }
    let names = ["R", "G", "B"].map(String::from);
    Ok(Picture { width: w as usize, values, is_half: false, names, primaries })
}

/// Primaries of a Radiance header: those of its last `PRIMARIES` line, or of sRGB without one.
fn radiance_primaries(lines: &[(String, String)]) -> Result<Primaries, String> {
    let Some((_, line)) = lines.iter().rev().find(|(key, _)| key == "PRIMARIES") else {
        return Ok(Primaries::SRGB);
    };
    let numbers: Option<Vec<f64>> = line.split_ascii_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[rx, ry, gx, gy, bx, by, wx, wy]) => Ok(Primaries([[rx, ry], [gx, gy], [bx, by], [wx, wy]])),
        _ => {
            let shown: String = line.chars().take(60).collect();
            Err(format!("PRIMARIES={shown}; give eight numbers, x and y of red, green, blue and white"))
        }
    }
}
