//! Writes a cloth as a material for Mitsuba 3: an XML file to include in a scene, with textures.
//!
//! A metallic `principled` is the glossy lobe, a `principledthin` the light through the cloth, blended with
//! diffuse light below a normal map and a mask of gaps. All yarns have one direction, as in glTF.

use super::Format;
use super::maps::Maps;
use super::material::{Material, RELIEF};
use super::openpbr::identifier;
use super::textures::{Textures, byte, packed, png_8, png_16, srgb};
use super::window_xml::escaped;
use crate::error::Error;
use std::fmt::Write;

/// Contents of the textures, in the order of their names.
const TEXTURES: [&str; 5] = ["diffuse", "translucent", "glossy", "normal", "opacity"];

/// Names of the textures beside a main file, in a folder named after its stem.
pub fn texture_names(stem: &str) -> [String; 5] {
    TEXTURES.map(|what| format!("{stem}_maps/{what}.png"))
}

/// Roughness and anisotropy of `principled`: the widths are `roughness^2 / aspect` along u and `roughness^2 *
/// aspect` along v, with `aspect = sqrt(1 - 0.9 anisotropic)`. The lobe is wide across the yarns, along u for
/// those of the warp; for the weft the anisotropy is negative.
fn principled([across, along]: [f64; 2], axis: usize) -> [f64; 2] {
    let aspect2 = if axis == 1 { along / across } else { across / along };
    [(across * along).powf(0.25), (1.0 - aspect2) / 0.9]
}

/// The XML file and its textures: names and bytes, the XML file first. `stem` is the start of the names of
/// textures, and a unit of texture coordinates is `mm_per_uv` of the cloth.
///
/// # Errors
/// [`Error::Export`] for a texture that cannot be encoded.
pub fn mitsuba(
    name: &str,
    stem: &str,
    maps: &Maps,
    material: &Material,
    textures: &Textures,
    mm_per_uv: f64,
    notes: &[String],
) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let (size, made_by) = (maps.size, &Format::Mitsuba.mark());
    let names = texture_names(stem);
    let colors = |of: &[[f32; 3]]| png_8(size, 3, &of.iter().flat_map(srgb).collect::<Vec<u8>>(), made_by);
    let flattened = |n: [f32; 3]| {
        let [x, y, z] = [RELIEF as f32 * n[0], RELIEF as f32 * n[1], n[2]];
        let length = (x * x + y * y + z * z).sqrt().max(1e-6);
        packed([x / length, y / length, z / length])
    };
    let opacity: Vec<u8> = maps.texels.iter().map(|t| byte(maps.opacity(t, material.presence))).collect();
    let bytes = [
        colors(&textures.base)?,
        colors(&textures.transmission)?,
        colors(&textures.gloss)?,
        png_16(size, 3, maps.texels.iter().flat_map(|t| flattened(t.normal)), made_by)?,
        png_8(size, 1, &opacity, made_by)?,
    ];
    let [u, v] = maps.size_um.map(|um| 1e3 * mm_per_uv / um);
    let texture = |parameter: &str, k: usize| {
        let raw = if k > 2 { "<boolean name=\"raw\" value=\"true\"/>" } else { "" };
        format!(
            "<texture type=\"bitmap\" name=\"{parameter}\"><string name=\"filename\" value=\"{}\"/>{raw}<transform name=\"to_uv\"><scale x=\"{u:.6}\" y=\"{v:.6}\"/></transform></texture>",
            escaped(&names[k])
        )
    };
    let [roughness, anisotropic] = principled(material.shape.widths[0], material.axis);
    let mut out = format!("<scene version=\"3.0.0\">\n<!-- {made_by}, version {} -->\n", env!("CARGO_PKG_VERSION"));
    for note in notes {
        let _ = writeln!(out, "<!-- {} -->", escaped(note).replace("--", "- -"));
    }
    let _ = write!(
        out,
        "<bsdf type=\"mask\" id=\"{}\">\n  {}\n  <bsdf type=\"normalmap\">\n    {}\n    <bsdf type=\"blendbsdf\">\n      <float name=\"weight\" value=\"{:.6}\"/>\n      <bsdf type=\"blendbsdf\">\n        <float name=\"weight\" value=\"{:.6}\"/>\n        <bsdf type=\"twosided\"><bsdf type=\"diffuse\">\n          {}\n        </bsdf></bsdf>\n        <bsdf type=\"principledthin\">\n          {}\n          <float name=\"diff_trans\" value=\"2.0\"/><float name=\"spec_trans\" value=\"0.0\"/>\n        </bsdf>\n      </bsdf>\n      <bsdf type=\"twosided\"><bsdf type=\"principled\">\n        {}\n        <float name=\"metallic\" value=\"1.0\"/><float name=\"roughness\" value=\"{roughness:.6}\"/><float name=\"anisotropic\" value=\"{anisotropic:.6}\"/>\n      </bsdf></bsdf>\n    </bsdf>\n  </bsdf>\n</bsdf>\n</scene>\n",
        identifier(name),
        texture("opacity", 4),
        texture("normalmap", 3),
        material.shape.level,
        textures.mix,
        texture("reflectance", 0),
        texture("base_color", 1),
        texture("base_color", 2),
    );
    let mut all = vec![(String::new(), out.into_bytes())];
    all.extend(names.into_iter().zip(bytes));
    Ok(all)
}
