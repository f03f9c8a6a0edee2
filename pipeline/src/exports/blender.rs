//! Writes a cloth as a Python file for Blender: run in Blender, it makes a node group for Cycles, a material
//! and a swatch.
//!
//! The group adds closures: an anisotropic glossy one, sheen, diffuse and translucent light, mixed with
//! transparency where the cloth has gaps. Numbers stand in a dictionary at the head of the file; the code
//! below it is the same for all cloths ([`CODE`]).

use super::Format;
use super::lobes::FORWARD_WIDTH;
use super::maps::{Maps, Texel};
use super::material::{Material, RELIEF};
use super::textures::{Textures, by_kind, byte, packed, png_8, png_16, srgb};
use crate::error::Error;
use serde_json::json;

/// Code of the file, which reads the dictionary `CLOTH`.
const CODE: &str = include_str!("blender.py");

/// Contents of the textures, in the order of their names.
const TEXTURES: [&str; 8] =
    ["diffuse", "translucent", "glossy", "roughness", "anisotropy", "across", "normal", "opacity"];

/// Names of the textures beside a main file, in a folder named after its stem.
pub fn texture_names(stem: &str) -> [String; 8] {
    TEXTURES.map(|what| format!("{stem}_maps/{what}.png"))
}

/// Roughness and anisotropy of Cycles for the widths of a lobe across and along the yarn. The tangent lies
/// across the yarn, where the lobe is wide, which is a negative anisotropy.
fn cycles_gloss([across, along]: [f64; 2]) -> [f64; 2] {
    [(across * along).powf(0.25), 1.0 - (along / across).sqrt()]
}

/// The Python file and its textures: names and bytes, the Python file first. `stem` is the start of the names
/// of textures, and a unit of texture coordinates is `mm_per_uv` of the cloth.
///
/// # Errors
/// [`Error::Export`] for a texture that cannot be encoded.
pub fn blender(
    name: &str,
    stem: &str,
    maps: &Maps,
    material: &Material,
    textures: &Textures,
    (repeats, mm_per_uv): ([u32; 2], f64),
    notes: &[String],
) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let (size, made_by) = (maps.size, &Format::Blender.mark());
    let names = texture_names(stem);
    let colors = |of: &[[f32; 3]]| png_8(size, 3, &of.iter().flat_map(srgb).collect::<Vec<u8>>(), made_by);
    let one = |of: &dyn Fn(&Texel) -> f64| {
        png_8(size, 1, &maps.texels.iter().map(|t| byte(of(t))).collect::<Vec<u8>>(), made_by)
    };
    let [warp, weft] = material.shape.widths.map(cycles_gloss);
    let across = |t: &Texel| packed([t.across[0], t.across[1], 0.0]).map(|v| byte(f64::from(v)));
    let bytes = [
        colors(&textures.base)?,
        colors(&textures.transmission)?,
        colors(&textures.gloss)?,
        one(&|t| by_kind(t, [warp[0], weft[0]]))?,
        one(&|t| by_kind(t, [warp[1], weft[1]]))?,
        png_8(size, 3, &maps.texels.iter().flat_map(across).collect::<Vec<u8>>(), made_by)?,
        png_16(size, 3, maps.texels.iter().flat_map(|t| packed(t.normal)), made_by)?,
        one(&|t| maps.opacity(t, material.presence))?,
    ];
    let um_per_uv = 1e3 * mm_per_uv;
    let files: serde_json::Map<String, serde_json::Value> =
        TEXTURES.iter().zip(&names).map(|(what, name)| ((*what).into(), name.as_str().into())).collect();
    let cloth = json!({
        "name": name,
        "textures": files,
        "repeat_m": maps.size_um.map(|um| 1e-6 * um),
        "repeats_per_uv": maps.size_um.map(|um| um_per_uv / um),
        "swatch_repeats": repeats,
        "relief": RELIEF,
        "glossy": textures.gloss_scale,
        "translucent": textures.mix,
        "facing": material.facing.clamp(0.0, 1.0),
        "forward": material.forward,
        "forward_ior": material.forward_index,
        "forward_roughness": FORWARD_WIDTH.sqrt(),
        "sheen": material.fuzz,
        "sheen_roughness": material.shape.fuzz_roughness,
    });
    let mut text = format!("# {made_by}, version {}\n", env!("CARGO_PKG_VERSION"));
    for note in notes {
        text += &format!("# {}\n", note.replace(['\n', '\r'], " "));
    }
    // JSON of strings, numbers and lists is Python as well.
    let pretty = serde_json::to_string_pretty(&cloth).unwrap_or_default();
    text += &format!("CLOTH = {pretty}\n\n{CODE}");
    let mut out = vec![(String::new(), text.into_bytes())];
    out.extend(names.into_iter().zip(bytes));
    Ok(out)
}
