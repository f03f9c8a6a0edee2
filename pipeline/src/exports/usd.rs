//! Writes a swatch as USD (.usda): a flat piece of the cloth with a material that references the MaterialX
//! document, and UsdPreviewSurface as the alternative. The reference is in a variant of `shading`: programs
//! that cannot read MaterialX select `preview`.

use super::maps::Maps;
use super::material::Material;
use super::openpbr::{TextureFiles, identifier};
use std::fmt::Write;

/// A quoted string.
fn quoted(text: &str) -> String {
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    format!("\"{}\"", clean.replace('\\', "\\\\").replace('"', "\\\""))
}

/// The USD document; `mtlx` is the name of the MaterialX file beside it.
pub fn usda(
    name: &str,
    mtlx: &str,
    maps: &Maps,
    material: &Material,
    mix: f64,
    files: &TextureFiles,
    repeats: [u32; 2],
    notes: &[String],
) -> String {
    let id = identifier(name);
    let half = [0, 1].map(|k| 0.5e-6 * maps.size_um[k] * f64::from(repeats[k]));
    let mut out = String::from("#usda 1.0\n(\n");
    let _ = write!(
        out,
        "    defaultPrim = \"{id}\"\n    doc = {}\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\ndef Xform \"{id}\"\n{{\n",
        quoted(&notes.join(" "))
    );
    let [x, y] = half;
    let [u, v] = repeats;
    let _ = write!(
        out,
        "    def Mesh \"Swatch\" (\n        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{\n        uniform bool doubleSided = 1\n        float3[] extent = [({:.9}, {:.9}, 0), ({x:.9}, {y:.9}, 0)]\n        int[] faceVertexCounts = [4]\n        int[] faceVertexIndices = [0, 1, 2, 3]\n        rel material:binding = </{id}/Cloth>\n        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (\n            interpolation = \"vertex\"\n        )\n        point3f[] points = [({:.9}, {:.9}, 0), ({x:.9}, {:.9}, 0), ({x:.9}, {y:.9}, 0), ({:.9}, {y:.9}, 0)]\n        texCoord2f[] primvars:st = [(0, 0), ({u}, 0), ({u}, {v}), (0, {v})] (\n            interpolation = \"vertex\"\n        )\n        uniform token subdivisionScheme = \"none\"\n    }}\n\n",
        -x, -y, -x, -y, -y, -x
    );
    let _ = write!(
        out,
        "    def Material \"Cloth\" (\n        variants = {{\n            string shading = \"materialx\"\n        }}\n        prepend variantSets = \"shading\"\n    )\n    {{\n        token outputs:surface.connect = </{id}/Cloth/Preview.outputs:surface>\n\n        def Shader \"Preview\"\n        {{\n            uniform token info:id = \"UsdPreviewSurface\"\n            color3f inputs:diffuseColor.connect = </{id}/Cloth/base_color.outputs:rgb>\n            float inputs:roughness.connect = </{id}/Cloth/roughness.outputs:r>\n            float inputs:opacity.connect = </{id}/Cloth/opacity.outputs:r>\n            normal3f inputs:normal.connect = </{id}/Cloth/normal.outputs:rgb>\n            float inputs:ior = {:.6}\n            float inputs:metallic = 0\n            token outputs:surface\n        }}\n\n        def Shader \"uv\"\n        {{\n            uniform token info:id = \"UsdPrimvarReader_float2\"\n            string inputs:varname = \"st\"\n            float2 outputs:result\n        }}\n",
        material.ior
    );
    let texture = |out: &mut String, what: &str, file: &str, outputs: &str, extra: &str, space: &str| {
        let _ = write!(
            out,
            "\n        def Shader \"{what}\"\n        {{\n            uniform token info:id = \"UsdUVTexture\"\n            asset inputs:file = @./{file}@\n            token inputs:sourceColorSpace = \"{space}\"\n            float2 inputs:st.connect = </{id}/Cloth/uv.outputs:result>\n            token inputs:wrapS = \"repeat\"\n            token inputs:wrapT = \"repeat\"\n{extra}            {outputs}\n        }}\n"
        );
    };
    let [base, _, _, roughness, _, _, normal, opacity] = &files.names;
    // The preview has no fuzz, so the light of the fuzz is added to the diffuse color.
    let brighter = [0, 1, 2].map(|c| {
        let diffuse = material.diffuse[0][c].max(1e-3);
        (1.0 - mix) * (diffuse + material.fuzz_energy[c]) / diffuse
    });
    let [r, g, b] = brighter;
    let scale = format!("            float4 inputs:scale = ({r:.6}, {g:.6}, {b:.6}, 1)\n");
    texture(&mut out, "base_color", base, "float3 outputs:rgb", &scale, "sRGB");
    texture(&mut out, "roughness", roughness, "float outputs:r", "", "raw");
    texture(&mut out, "opacity", opacity, "float outputs:r", "", "raw");
    let scale = "            float4 inputs:scale = (2, 2, 2, 1)\n            float4 inputs:bias = (-1, -1, -1, 0)\n";
    texture(&mut out, "normal", normal, "float3 outputs:rgb", scale, "raw");
    let _ = write!(
        out,
        "\n        variantSet \"shading\" = {{\n            \"materialx\" (\n                prepend references = @./{mtlx}@</MaterialX/Materials/{id}>\n            ) {{\n            }}\n            \"preview\" {{\n            }}\n        }}\n    }}\n}}\n"
    );
    out
}
