//! Writes a cloth as an OpenPBR 1.1 material in MaterialX 1.39, with textures over the repeat.

use super::maps::{Maps, Texel};
use super::material::{Material, RELIEF};
use super::textures::{Textures, by_kind, byte, packed, png_8, png_16, srgb};
use super::window_xml::escaped;
use crate::error::Error;
use std::fmt::Write;

/// Textures of a material: names relative to the material's folder, and bytes.
pub struct TextureFiles {
    /// The files.
    pub files: Vec<(String, Vec<u8>)>,
    /// Names of the files, in the order of [`TEXTURES`].
    pub names: [String; 8],
}

/// Contents of the textures, in the order of their names.
pub const TEXTURES: [&str; 8] =
    ["base_color", "transmission_color", "specular_color", "roughness", "anisotropy", "tangent", "normal", "opacity"];

/// Names of the textures beside a main file, in a folder named after its stem.
pub fn texture_names(stem: &str) -> [String; 8] {
    TEXTURES.map(|what| format!("{stem}_maps/{what}.png"))
}

/// Converts a name to one that MaterialX and USD accept: letters, digits and underscores.
pub fn identifier(name: &str) -> String {
    let mut out: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !out.starts_with(|c: char| c.is_ascii_alphabetic()) {
        out.insert_str(0, "cloth_");
    }
    out
}

impl TextureFiles {
    /// Textures of a material with these names, in the order of [`TEXTURES`]; `made_by` is the text about
    /// their origin.
    ///
    /// # Errors
    /// [`Error::Export`] for a texture that cannot be encoded.
    pub fn new(
        names: [String; 8],
        made_by: &str,
        maps: &Maps,
        material: &Material,
        textures: &Textures,
    ) -> Result<TextureFiles, Error> {
        let size = maps.size;
        let bytes_of = |channels: usize, numbers: Vec<u8>| png_8(size, channels, &numbers, made_by);
        let colors = |of: &[[f32; 3]]| bytes_of(3, of.iter().flat_map(srgb).collect());
        let by = |numbers: [f64; 2]| bytes_of(1, maps.texels.iter().map(|t| byte(by_kind(t, numbers))).collect());
        let across = |t: &Texel| packed([t.across[0], t.across[1], 0.0]).map(|v| byte(f64::from(v)));
        let [warp, weft] = material.glosses();
        let bytes = [
            colors(&textures.base)?,
            colors(&textures.transmission)?,
            colors(&textures.gloss)?,
            by([warp[0], weft[0]])?,
            by([warp[1], weft[1]])?,
            bytes_of(3, maps.texels.iter().flat_map(across).collect())?,
            png_16(size, 3, maps.texels.iter().flat_map(|t| packed(t.normal)), made_by)?,
            bytes_of(1, maps.texels.iter().map(|t| byte(maps.opacity(t, material.presence))).collect())?,
        ];
        Ok(TextureFiles { files: names.iter().cloned().zip(bytes).collect(), names })
    }
}

/// Nodes by which the color of transmission is taken once by graphs that square it.
const COLOR_ONCE: &str = "    <power name=\"transmission_color_map\" type=\"color3\">\n      <input name=\"in1\" type=\"color3\" nodename=\"transmission_color_image\" />\n      <input name=\"in2\" type=\"float\" interfacename=\"transmission_power\" />\n    </power>\n";

/// The MaterialX document. A unit of the surface's texture coordinates is `mm_per_uv` of the cloth, or one
/// repeat.
pub fn mtlx(
    name: &str,
    maps: &Maps,
    material: &Material,
    textures: &Textures,
    files: &TextureFiles,
    mm_per_uv: Option<f64>,
    notes: &[String],
) -> String {
    let id = identifier(name);
    let tiling = maps.size_um.map(|um| mm_per_uv.map_or(1.0, |mm| 1e3 * mm / um));
    let mut out = String::from("<?xml version=\"1.0\"?>\n<materialx version=\"1.39\" colorspace=\"lin_rec709\">\n");
    for note in notes {
        let _ = writeln!(out, "  <!-- {} -->", escaped(note).replace("--", "- -"));
    }
    let _ = writeln!(out, "  <nodegraph name=\"NG_{id}\">");
    let _ = writeln!(
        out,
        "    <input name=\"uv_scale\" type=\"vector2\" value=\"{:.6}, {:.6}\" doc=\"Repeats of the cloth in a unit of the texture coordinates\" />",
        tiling[0], tiling[1]
    );
    out.push_str("    <input name=\"transmission_power\" type=\"float\" value=\"0.5\" doc=\"0.5 for the graph of OpenPBR 1.1.1 in MaterialX 1.39.5, which takes the color of thin-walled subsurface twice; 1 for graphs that take it once, as the specification does\" />\n");
    let kinds = ["color3", "color3", "color3", "float", "float", "vector3", "vector3", "float"];
    for ((what, kind), file) in TEXTURES.into_iter().zip(kinds).zip(&files.names) {
        let space = if kind == "color3" { " colorspace=\"srgb_texture\"" } else { "" };
        let _ = write!(
            out,
            "    <tiledimage name=\"{what}_image\" type=\"{kind}\">\n      <input name=\"file\" type=\"filename\" value=\"{}\"{space} />\n      <input name=\"uvtiling\" type=\"vector2\" interfacename=\"uv_scale\" />\n    </tiledimage>\n",
            escaped(file)
        );
        if kind == "vector3" {
            let _ = write!(
                out,
                "    <normalmap name=\"{what}_map\" type=\"vector3\">\n      <input name=\"in\" type=\"vector3\" nodename=\"{what}_image\" />\n{}    </normalmap>\n",
                if what == "normal" {
                    format!("      <input name=\"scale\" type=\"float\" value=\"{RELIEF}\" />\n")
                } else {
                    String::new()
                }
            );
        }
        if what == "transmission_color" {
            out.push_str(COLOR_ONCE);
        }
    }
    for (what, kind) in TEXTURES.into_iter().zip(kinds) {
        let made = kind == "vector3" || what == "transmission_color";
        let node = format!("{what}_{}", if made { "map" } else { "image" });
        let _ = writeln!(out, "    <output name=\"{what}\" type=\"{kind}\" nodename=\"{node}\" />");
    }
    out.push_str("  </nodegraph>\n");
    let _ = writeln!(out, "  <open_pbr_surface name=\"SR_{id}\" type=\"surfaceshader\">");
    let mut input = |name: &str, kind: &str, from: Result<&str, String>| {
        let _ = match from {
            Ok(output) => {
                writeln!(out, "    <input name=\"{name}\" type=\"{kind}\" nodegraph=\"NG_{id}\" output=\"{output}\" />")
            }
            Err(value) => writeln!(out, "    <input name=\"{name}\" type=\"{kind}\" value=\"{value}\" />"),
        };
    };
    let number = |v: f64| Err(format!("{v:.6}"));
    input("base_weight", "float", number(1.0));
    input("base_color", "color3", Ok("base_color"));
    // The weight scales the reflectance of the fibers' index along the normal.
    let f0 = ((material.ior - 1.0) / (material.ior + 1.0)).powi(2);
    input("specular_weight", "float", number(material.shape.level / f0));
    input("specular_color", "color3", Ok("specular_color"));
    input("specular_roughness", "float", Ok("roughness"));
    input("specular_roughness_anisotropy", "float", Ok("anisotropy"));
    input("specular_ior", "float", number(material.ior));
    input("subsurface_weight", "float", number(textures.mix));
    input("subsurface_color", "color3", Ok("transmission_color"));
    // In a thin-walled material, all subsurface light is transmitted.
    input("subsurface_scatter_anisotropy", "float", number(1.0));
    let (weight, [r, g, b]) = material.weighted_fuzz();
    input("fuzz_weight", "float", number(weight));
    input("fuzz_color", "color3", Err(format!("{r:.6}, {g:.6}, {b:.6}")));
    input("fuzz_roughness", "float", number(material.shape.fuzz_roughness));
    input("geometry_thin_walled", "boolean", Err("true".into()));
    input("geometry_opacity", "float", Ok("opacity"));
    input("geometry_normal", "vector3", Ok("normal"));
    input("geometry_tangent", "vector3", Ok("tangent"));
    let _ = write!(
        out,
        "  </open_pbr_surface>\n  <surfacematerial name=\"{id}\" type=\"material\">\n    <input name=\"surfaceshader\" type=\"surfaceshader\" nodename=\"SR_{id}\" />\n  </surfacematerial>\n</materialx>\n"
    );
    out
}
