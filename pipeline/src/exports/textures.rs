//! A material's textures over the repeat, encoded as PNG.

use super::maps::{Maps, Texel};
use super::material::Material;
use crate::error::Error;
use plywave::color::srgb_encode;

/// Textures of a cloth: maps, and the numbers that scale them.
pub struct Textures {
    /// Base color: the color of the diffusely reflected light divided by 1 - `mix`, linear.
    pub base: Vec<[f32; 3]>,
    /// Color of the diffusely transmitted light divided by `mix`, linear.
    pub transmission: Vec<[f32; 3]>,
    /// Fraction of the diffuse light that is assigned to transmission, such that neither color exceeds 1.
    pub mix: f64,
    /// Fraction of the diffuse light that is lost where colors above 1 are clamped.
    pub cut: f64,
}

/// Fraction of the pixels whose colors may be clamped.
const BRIGHT: f64 = 0.02;

impl Textures {
    /// Textures of a material whose mean over the maps is the fitted material.
    pub fn new(maps: &Maps, material: &Material) -> Textures {
        let scaled = |half: usize| -> Vec<[f64; 3]> {
            let mean = [0, 1, 2].map(|c| maps.mean(|t| t.light[half][c]).max(1e-6));
            let of = |t: &Texel| -> [f64; 3] {
                std::array::from_fn(|c| {
                    let relative = if t.cover > 0.0 { f64::from(t.light[half][c]) / mean[c] } else { 1.0 };
                    (material.diffuse[half][c] * relative).max(0.0)
                })
            };
            maps.texels.iter().map(of).collect()
        };
        let colors = [scaled(0), scaled(1)];
        // Maximum over all but the brightest pixels.
        let bright = |colors: &[[f64; 3]]| {
            let mut all: Vec<f64> = colors.iter().map(|c| c.iter().copied().fold(0.0, f64::max)).collect();
            all.sort_by(f64::total_cmp);
            all[((1.0 - BRIGHT) * (all.len() - 1) as f64) as usize]
        };
        let [above, below] = [bright(&colors[0]), bright(&colors[1])];
        let mix = if below > 1e-4 { (below / (above + below)).clamp(0.01, 0.99) } else { 0.0 };
        let (mut cut, mut all) = (0.0, 0.0);
        let mut over = |colors: &[[f64; 3]], weight: f64| -> Vec<[f32; 3]> {
            let one = |c: &[f64; 3]| {
                c.map(|v| {
                    let v = if weight > 0.0 { v / weight } else { 0.0 };
                    cut += weight * (v - 1.0).max(0.0);
                    all += weight * v;
                    v.min(1.0) as f32
                })
            };
            colors.iter().map(one).collect()
        };
        let (base, transmission) = (over(&colors[0], 1.0 - mix), over(&colors[1], mix));
        Textures { base, transmission, mix, cut: if all > 0.0 { cut / all } else { 0.0 } }
    }
}

/// Converts 0 to 1 to a byte.
pub fn byte(v: f64) -> u8 {
    (255.0 * v.clamp(0.0, 1.0)).round() as u8
}

/// Converts a linear color to sRGB bytes.
pub fn srgb(c: &[f32; 3]) -> [u8; 3] {
    c.map(|v| byte(srgb_encode(f64::from(v))))
}

/// Encodes a PNG with 1, 3 or 4 channels of eight bits; `made_by` is the text about its origin.
///
/// # Errors
/// [`Error::Export`] if encoding fails.
pub fn png_8(size: [usize; 2], channels: usize, numbers: &[u8], made_by: &str) -> Result<Vec<u8>, Error> {
    encode(size, channels, png::BitDepth::Eight, numbers, made_by)
}

/// Encodes a PNG of sixteen bits from numbers between 0 and 1.
///
/// # Errors
/// Those of [`png_8`].
pub fn png_16(
    size: [usize; 2],
    channels: usize,
    numbers: impl Iterator<Item = f32>,
    made_by: &str,
) -> Result<Vec<u8>, Error> {
    let bytes: Vec<u8> = numbers.flat_map(|v| ((65535.0 * v.clamp(0.0, 1.0)).round() as u16).to_be_bytes()).collect();
    encode(size, channels, png::BitDepth::Sixteen, &bytes, made_by)
}

fn encode(
    size: [usize; 2],
    channels: usize,
    depth: png::BitDepth,
    bytes: &[u8],
    made_by: &str,
) -> Result<Vec<u8>, Error> {
    let mut out = Vec::new();
    let failed = |e: png::EncodingError| Error::Export { file: "texture".into(), what: e.to_string() };
    let mut encoder = png::Encoder::new(&mut out, size[0] as u32, size[1] as u32);
    encoder.set_color(match channels {
        1 => png::ColorType::Grayscale,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    encoder.set_depth(depth);
    encoder.add_text_chunk("Software".into(), made_by.into()).map_err(failed)?;
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(bytes).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(out)
}

/// Interpolates the numbers of warp and weft by a pixel's fraction of weft.
pub fn by_kind(texel: &Texel, numbers: [f64; 2]) -> f64 {
    let weft = f64::from(texel.weft);
    numbers[0] + weft * (numbers[1] - numbers[0])
}

/// Maps the components of a unit vector from [-1, 1] to [0, 1].
pub fn packed(v: [f32; 3]) -> [f32; 3] {
    v.map(|v| 0.5 + 0.5 * v)
}
