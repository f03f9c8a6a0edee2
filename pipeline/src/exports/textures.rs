//! A material's textures over the repeat, encoded as PNG.

use super::lobes::Engine;
use super::maps::{Maps, Texel};
use super::material::Material;
use crate::error::Error;
use plywave::color::srgb_encode;

/// Textures of a cloth: maps, and the numbers that scale them.
pub struct Textures {
    /// Color of the diffusely reflected light, for a renderer that gives it 1 - `mix` of the light.
    pub base: Vec<[f32; 3]>,
    /// Color of the diffusely transmitted light divided by `mix`, linear.
    pub transmission: Vec<[f32; 3]>,
    /// Color of the glossy lobe divided by `gloss_scale`, linear.
    pub gloss: Vec<[f32; 3]>,
    /// Fraction of the diffuse light that is assigned to transmission: as little as leaves no color above 1.
    pub mix: f64,
    /// Largest color of the glossy lobe.
    pub gloss_scale: f64,
    /// Fraction of the light that is lost where colors above 1 are clamped.
    pub cut: f64,
}

/// Fraction of the pixels whose colors may be clamped.
const BRIGHT: f64 = 0.02;
/// Number of steps by which light that is cut off is given back.
const STEPS: usize = 6;

impl Textures {
    /// Textures of a material whose mean over the maps is the fitted material.
    pub fn new(maps: &Maps, material: &Material) -> Textures {
        let mean = [0, 1].map(|half: usize| [0, 1, 2].map(|c| maps.mean(|t| t.light[half][c]).max(1e-6)));
        let scaled = |half: usize| -> Vec<[f64; 3]> {
            let of = |t: &Texel| -> [f64; 3] {
                std::array::from_fn(|c| {
                    let relative = if t.cover > 0.0 { f64::from(t.light[half][c]) / mean[half][c] } else { 1.0 };
                    (material.diffuse[half][c] * relative).max(0.0)
                })
            };
            maps.texels.iter().map(of).collect()
        };
        // Where a yarn is dark because others shade it, so is its gloss: relative to the mean of its kind.
        let brightness = |t: &Texel| f64::from(t.light[0].iter().sum::<f32>());
        let of_kind = [0.0, 1.0].map(|kind| {
            let share = |t: &Texel| f64::from(t.cover) * (1.0 - (f64::from(t.weft) - kind).abs());
            let sum = |of: &dyn Fn(&Texel) -> f64| maps.texels.iter().map(|t| share(t) * of(t)).sum::<f64>();
            (sum(&brightness) / sum(&|_| 1.0).max(1e-9)).max(1e-9)
        });
        let shiny = |t: &Texel| -> [f64; 3] {
            let relative = if t.cover > 0.0 { brightness(t) / by_kind(t, of_kind) } else { 1.0 };
            std::array::from_fn(|c| relative * by_kind(t, [material.gloss[0][c], material.gloss[1][c]]))
        };
        let gloss: Vec<[f64; 3]> = maps.texels.iter().map(shiny).collect();
        // Maximum over all but the brightest pixels.
        let bright = |colors: &[[f64; 3]]| {
            let mut all: Vec<f64> = colors.iter().map(|c| c.iter().copied().fold(0.0, f64::max)).collect();
            all.sort_by(f64::total_cmp);
            all[((1.0 - BRIGHT) * (all.len() - 1) as f64) as usize]
        };
        let (base, transmission) = (scaled(0), scaled(1));
        // Of the light that Mitsuba's glossy lobe leaves.
        let rest = if material.engine == Engine::Mitsuba { 1.0 - material.shape.level } else { 1.0 };
        let through = bright(&transmission) / rest;
        let above = bright(&base) / rest;
        // Both are cut off alike where the brightest pixels send out more light than comes in.
        let most = if material.engine == Engine::Cycles { through } else { through + above };
        let mix = if through > 1e-4 { through / most.max(1.0) } else { 0.0 };
        let level = material.shape.level;
        // Closures of Cycles are added: none takes light of another. Mitsuba blends them.
        let (gloss_scale, below, left) = match material.engine {
            Engine::OpenPbr => (1.0, mix, 1.0 - mix),
            Engine::Gltf => (bright(&gloss).clamp(1e-4, level), mix, 1.0 - mix),
            Engine::Cycles => (bright(&gloss).max(1e-4), mix, 1.0),
            Engine::Mitsuba => (level, mix * (1.0 - level), (1.0 - mix) * (1.0 - level)),
        };
        let (mut cut, mut all) = (0.0, 0.0);
        let mut over = |colors: &[[f64; 3]], weight: f64| -> Vec<[f32; 3]> {
            let sum = |of: &dyn Fn(f64) -> f64| -> [f64; 3] {
                let covers = maps.texels.iter().zip(colors).map(|(t, c)| (f64::from(t.cover), c));
                covers.fold([0.0; 3], |sum, (cover, c)| std::array::from_fn(|k| sum[k] + cover * of(c[k])))
            };
            let want = sum(&|v| v);
            let mut scale = [1.0; 3];
            // What is clamped in bright pixels is given to the others.
            for _ in 0..STEPS {
                let per = weight.max(1e-9);
                let got: [[f64; 3]; 3] = scale.map(|s| sum(&|v| per * (s * v / per).min(1.0)));
                scale = std::array::from_fn(|c| scale[c] * (want[c] / got[c][c].max(1e-12)).clamp(1.0, 2.0));
            }
            let one = |c: &[f64; 3]| -> [f32; 3] {
                std::array::from_fn(|k| {
                    let v = if weight > 0.0 { scale[k] * c[k] / weight } else { 0.0 };
                    v.min(1.0) as f32
                })
            };
            let out: Vec<[f32; 3]> = colors.iter().map(one).collect();
            for ((t, o), c) in maps.texels.iter().zip(&out).zip(colors) {
                let cover = f64::from(t.cover);
                (0..3).for_each(|k| (cut, all) = (cut + cover * (c[k] - weight * f64::from(o[k])), all + cover * c[k]));
            }
            out
        };
        let (base, transmission, gloss) = (over(&base, left), over(&transmission, below), over(&gloss, gloss_scale));
        Textures { base, transmission, gloss, mix, gloss_scale, cut: if all > 0.0 { cut / all } else { 0.0 } }
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
