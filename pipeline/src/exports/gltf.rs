//! Writes a swatch as GLB: a flat piece of the cloth with sheen, anisotropy, specular, diffuse transmission
//! and normals.
//!
//! The axes x and y are those of the cloth, and the face looks along z; lengths are in meters. Texture
//! coordinates count repeats, with v downwards. The widths of GGX along and across the yarns are
//! `alpha_b = roughness^2` and `alpha_t = mix(alpha_b, 1, strength^2)` (KHR_materials_anisotropy). All yarns
//! have one direction: that of a texture would be filtered to a direction between warp and weft.

use super::Format;
use super::maps::Maps;
use super::material::{Material, RELIEF};
use super::textures::{Textures, byte, packed, png_8, png_16};
use crate::error::Error;
use plywave::color::srgb_encode;
use serde_json::{Value, json};
use std::f64::consts::FRAC_PI_2;

/// Roughness and anisotropy strength of glTF for the widths of a lobe.
fn gltf_gloss([across, along]: [f64; 2]) -> [f64; 2] {
    [along.sqrt(), ((across - along) / (1.0 - along).max(1e-6)).clamp(0.0, 1.0).sqrt()]
}

/// Bytes of a GLB: a swatch with `repeats` of the cloth along x and y.
///
/// # Errors
/// [`Error::Export`] for a texture that cannot be encoded.
pub fn glb(
    name: &str,
    maps: &Maps,
    material: &Material,
    textures: &Textures,
    repeats: [u32; 2],
    notes: &[String],
) -> Result<Vec<u8>, Error> {
    let (size, made_by) = (maps.size, &Format::Gltf.mark());
    let [roughness, strength] = gltf_gloss(material.shape.widths[0]);
    let is_open = material.presence < 0.999;
    // Transmitted diffuse light has a color of its own; the base color is for both parts.
    let base: Vec<u8> = maps
        .texels
        .iter()
        .zip(&textures.base)
        .flat_map(|(t, c)| {
            let [r, g, b] = c.map(|v| byte(srgb_encode(f64::from(v))));
            [r, g, b, byte(maps.opacity(t, material.presence))]
        })
        .collect();
    let through: Vec<u8> =
        textures.transmission.iter().flat_map(|c| c.map(|v| byte(srgb_encode(f64::from(v))))).collect();
    let shiny: Vec<u8> = textures.gloss.iter().flat_map(|c| c.map(|v| byte(srgb_encode(f64::from(v))))).collect();
    let images = [
        png_8(size, 4, &base, made_by)?,
        png_16(size, 3, maps.texels.iter().flat_map(|t| packed(t.normal)), made_by)?,
        png_8(size, 3, &through, made_by)?,
        png_8(size, 3, &shiny, made_by)?,
    ];
    // The vertices are four corners about the origin.
    let half = [0, 1].map(|k| 0.5e-6 * maps.size_um[k] as f32 * repeats[k] as f32);
    let (u, v) = (repeats[0] as f32, repeats[1] as f32);
    let corners = [(-1.0f32, -1.0f32, 0.0, v), (1.0, -1.0, u, v), (1.0, 1.0, u, 0.0), (-1.0, 1.0, 0.0, 0.0)];
    let mut bin: Vec<u8> = Vec::new();
    let mut views: Vec<Value> = Vec::new();
    let mut push = |bytes: &[u8], target: Option<u32>| {
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        bin.extend(bytes);
        views.push(view);
        views.len() - 1
    };
    let floats = |numbers: &[f32]| numbers.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let positions: Vec<f32> = corners.iter().flat_map(|c| [c.0 * half[0], c.1 * half[1], 0.0]).collect();
    let array = Some(34962);
    let at = push(&floats(&positions), array);
    let normal = push(&floats(&[0.0, 0.0, 1.0].repeat(4)), array);
    let tangent = push(&floats(&[1.0, 0.0, 0.0, 1.0].repeat(4)), array);
    let uv = push(&floats(&corners.iter().flat_map(|c| [c.2, c.3]).collect::<Vec<f32>>()), array);
    let index = push(&[0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>(), Some(34963));
    let images: Vec<Value> =
        images.iter().map(|png| json!({ "bufferView": push(png, None), "mimeType": "image/png" })).collect();
    // Reflectance along the normal is that of the index times the color, which may exceed 1.
    let f0 = ((material.ior - 1.0) / (material.ior + 1.0)).powi(2);
    let specular = textures.gloss_scale / (f0 * material.shape.level);
    let texture = |index: usize| json!({ "index": index });
    let fuzz = material.fuzz.map(|c| c.clamp(0.0, 1.0));
    let mut extensions = json!({
        "KHR_materials_ior": { "ior": material.ior },
        "KHR_materials_specular": {
            "specularFactor": material.shape.level, "specularColorFactor": [specular, specular, specular], "specularColorTexture": texture(3),
        },
        "KHR_materials_anisotropy": {
            "anisotropyStrength": strength, "anisotropyRotation": if material.axis == 1 { 0.0 } else { FRAC_PI_2 },
        },
        "KHR_materials_sheen": { "sheenColorFactor": fuzz, "sheenRoughnessFactor": material.shape.fuzz_roughness },
    });
    if textures.mix > 0.0 {
        extensions["KHR_materials_diffuse_transmission"] = json!({
            "diffuseTransmissionFactor": textures.mix, "diffuseTransmissionColorTexture": texture(2),
        });
    }
    let used: Vec<&String> = extensions.as_object().map(|o| o.keys().collect()).unwrap_or_default();
    let document = json!({
        "asset": { "version": "2.0", "generator": format!("{made_by}, version {}", env!("CARGO_PKG_VERSION")), "extras": { "notes": notes } },
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": name }],
        "meshes": [{ "name": name, "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3 }, "indices": 4, "material": 0,
        }] }],
        "accessors": [
            { "bufferView": at, "componentType": 5126, "count": 4, "type": "VEC3",
              "min": [-half[0], -half[1], 0.0], "max": [half[0], half[1], 0.0] },
            { "bufferView": normal, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": tangent, "componentType": 5126, "count": 4, "type": "VEC4" },
            { "bufferView": uv, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": index, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }],
        "images": images,
        "textures": (0..images.len()).map(|i| json!({ "source": i, "sampler": 0 })).collect::<Vec<Value>>(),
        "materials": [{
            "name": name,
            "doubleSided": true,
            "alphaMode": if is_open { "BLEND" } else { "OPAQUE" },
            "pbrMetallicRoughness": {
                "baseColorTexture": texture(0), "roughnessFactor": roughness, "metallicFactor": 0.0,
            },
            "normalTexture": { "index": 1, "scale": RELIEF },
            "extensions": extensions,
        }],
        "bufferViews": views,
        "buffers": [{ "byteLength": bin.len().next_multiple_of(4) }],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let total = 12 + 8 + text.len() + 8 + bin.len();
    out.extend(2u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    Ok(out)
}
