//! Writes a swatch as GLB: a flat piece of the cloth with sheen, anisotropy, specular, diffuse transmission
//! and normals.
//!
//! The axes x and y are those of the cloth, and the face looks along z; lengths are in meters. Texture
//! coordinates count repeats, with v downwards. The roughness of glTF follows from that of OpenPBR by
//! `alpha_b = roughness^2` along the yarn and `alpha_t = mix(alpha_b, 1, strength^2)` across it
//! (KHR_materials_anisotropy). The texture stores the directions of yarns as colors that can be filtered:
//! across warp is red, across weft green.

use super::Format;
use super::maps::Maps;
use super::material::{Gloss, Material};
use super::outputs::mark;
use super::textures::{Textures, by_kind, byte, packed, png_8, png_16};
use crate::error::Error;
use plywave::color::srgb_encode;
use serde_json::{Value, json};

/// Roughness and anisotropy strength of glTF for a lobe.
fn gltf_gloss(gloss: &Gloss) -> [f64; 2] {
    let r2 = gloss.roughness * gloss.roughness;
    let keep = 1.0 - gloss.anisotropy;
    let across = (r2 * (2.0 / (1.0 + keep * keep)).sqrt()).min(1.0);
    let along = keep * across;
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
    let (size, made_by) = (maps.size, &mark(Format::Gltf));
    let glosses = material.gloss.map(|g| gltf_gloss(&g));
    let strongest = glosses[0][1].max(glosses[1][1]).max(1e-6);
    let is_open = maps.cover() < 0.999;
    // Transmitted diffuse light has a color of its own; the base color is for both parts.
    let base: Vec<u8> = maps
        .texels
        .iter()
        .zip(&textures.base)
        .flat_map(|(t, c)| {
            let [r, g, b] = c.map(|v| byte(srgb_encode(f64::from(v))));
            [r, g, b, byte(f64::from(t.cover))]
        })
        .collect();
    let rough: Vec<u8> =
        maps.texels.iter().flat_map(|t| [255, byte(by_kind(t, [glosses[0][0], glosses[1][0]])), 0]).collect();
    let across: Vec<u8> = maps
        .texels
        .iter()
        .flat_map(|t| {
            let [x, y, _] = packed([t.across[0], t.across[1], 0.0]).map(|v| byte(f64::from(v)));
            [x, y, byte(by_kind(t, [glosses[0][1], glosses[1][1]]) / strongest)]
        })
        .collect();
    let through: Vec<u8> =
        textures.transmission.iter().flat_map(|c| c.map(|v| byte(srgb_encode(f64::from(v))))).collect();
    let images = [
        png_8(size, 4, &base, made_by)?,
        png_8(size, 3, &rough, made_by)?,
        png_16(size, 3, maps.texels.iter().flat_map(|t| packed(t.normal)), made_by)?,
        png_8(size, 3, &across, made_by)?,
        png_8(size, 3, &through, made_by)?,
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
    let f0 = material.gloss[0].f0;
    let texture = |index: usize| json!({ "index": index });
    let fuzz = material.fuzz_color.map(|c| (c * material.fuzz[0]).clamp(0.0, 1.0));
    let mut extensions = json!({
        "KHR_materials_ior": { "ior": Material::index(f0).max(1.0) },
        "KHR_materials_specular": { "specularFactor": 1.0 },
        "KHR_materials_anisotropy": {
            "anisotropyStrength": strongest, "anisotropyRotation": 0.0, "anisotropyTexture": texture(3),
        },
        "KHR_materials_sheen": { "sheenColorFactor": fuzz, "sheenRoughnessFactor": material.fuzz[1] },
    });
    if textures.mix > 0.0 {
        extensions["KHR_materials_diffuse_transmission"] = json!({
            "diffuseTransmissionFactor": textures.mix, "diffuseTransmissionColorTexture": texture(4),
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
                "baseColorTexture": texture(0), "metallicRoughnessTexture": texture(1), "metallicFactor": 0.0,
            },
            "normalTexture": texture(2),
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
