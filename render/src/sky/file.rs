//! Loads skies from files: checks their limits, replaces invalid radiances, converts primaries, and reads
//! Radiance pictures. `exr.rs` reads OpenEXR.

use crate::memory_limit::open_file;
use crate::sky::exr::read_exr;
use crate::sky::picture::{MAX_TEXELS, Picture, check_shape, check_size, no_colors};
use crate::sky::primaries::Primaries;
use crate::{Environment, RenderError};
use glam::DVec3;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// Largest accepted file [bytes]: all texels as 32-bit floats in eight channels.
const MAX_BYTES: u64 = 32 * MAX_TEXELS;
/// Minimum size of a row of a Radiance picture [bytes].
const ROW_BYTES: u64 = 4;
/// The largest finite half float, which replaces infinite values.
const MAX_HALF: f32 = 65504.0;
/// Largest accepted radiance, far above that of the sun relative to its sky.
const MAX_RADIANCE: f32 = 1e12;
/// Largest negative value, relative to the color's largest component, that counts as rounding at the edge of
/// the sRGB gamut.
const EDGE: f64 = 1e-5;

impl Environment {
    /// Loads a picture in latitude and longitude, OpenEXR or Radiance (`.hdr`, `.pic`), with rows from the
    /// zenith down; also returns notes on assumptions and replaced values, one per line.
    ///
    /// An EXR has colors in channels `R`, `G`, `B`, in `Y`, `RY`, `BY`, or in a single channel that counts as
    /// gray, in a layer of any name. `layer` chooses one of several layers; the default is the unnamed layer
    /// or one whose name means all light. Values in other primaries (`chromaticities` of an EXR, `PRIMARIES`
    /// of a Radiance picture) are converted to linear sRGB, which is assumed for files without such a line.
    /// Negative values and NaN become 0, infinite half floats the largest half.
    ///
    /// # Errors
    /// [`RenderError::Picture`] for an unreadable file, more than 134 M texels, an aspect ratio far from 2,
    /// an EXR whose display window is far larger than its data window, degenerate primaries, missing colors,
    /// or an unknown `layer`; [`RenderError::TooLarge`]; [`RenderError::Io`].
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
        // In other primaries, a negative value may belong to a color inside sRGB.
        let min = if primaries.is_srgb() { 0.0 } else { -MAX_RADIANCE };
        notes.extend(replace_invalid(&mut values, width, min, is_half, &names));
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

/// Replaces invalid radiances; returns a note with their number and the first one.
fn replace_invalid(
    values: &mut [[f32; 3]],
    width: usize,
    min: f32,
    is_half: bool,
    names: &[String; 3],
) -> Option<String> {
    let mended = |v: f32| match v {
        v if v == f32::INFINITY => {
            if is_half {
                MAX_HALF
            } else {
                0.0
            }
        }
        v if v.is_nan() || v == f32::NEG_INFINITY => 0.0,
        // Adding 0 removes the sign of a zero.
        v => v.clamp(min, MAX_RADIANCE) + 0.0,
    };
    let (mut count, mut first) = (0u64, None);
    let gray = names[0] == names[1];
    for (at, texel) in values.iter_mut().enumerate() {
        for (k, v) in texel.iter_mut().enumerate() {
            let new = mended(*v);
            // NaN differs from every value, itself included.
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

/// Converts values from other primaries to linear sRGB, clamps negative results to 0, and returns a note.
fn convert(values: &mut [[f32; 3]], width: usize, primaries: Primaries) -> Result<String, String> {
    let to_srgb = primaries.to_srgb().ok_or_else(|| no_colors(primaries))?;
    let (mut count, mut first) = (0u64, None);
    for (at, texel) in values.iter_mut().enumerate() {
        // Grays keep their values bit for bit.
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

fn read_radiance(file: BufReader<File>, name: &str, bytes: u64) -> Result<Picture, RenderError> {
    let bad = |what: String| RenderError::Picture { file: name.into(), what };
    let decoder = HdrDecoder::new_nonstrict(file).map_err(|e| bad(e.to_string()))?;
    let (w, h) = decoder.dimensions();
    check_size(name, [w, h].map(u64::from), 12)?;
    check_shape(name, [w, h].map(u64::from))?;
    if u64::from(h) * ROW_BYTES > bytes {
        return Err(bad(format!("{w} x {h} texels do not fit into {bytes} bytes; the file is cut off")));
    }
    // Header lines contain the exposure factors of the radiances.
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

/// Primaries of a Radiance header: those of its last `PRIMARIES` line, or of sRGB if it has none.
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
