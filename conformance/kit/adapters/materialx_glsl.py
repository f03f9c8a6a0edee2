#!/usr/bin/env python3
"""Adapter of MaterialX: the GLSL that it generates for WebGL 2, run in headless Chromium.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/materialx_glsl.py"

Needs `pip install MaterialX playwright` and Chromium (CHROMIUM, usually /usr/bin/chromium).

The shader that MaterialX writes for a node, a `surface` around it and one directional light is run as it is, a point of
a float texture for each direction. `wi` is the viewer's direction and `wo` the light's: the shader takes a fiber's
offset h from the viewer's normal. The light is the same for all points, so each point has a frame of its own.
"""
import base64
import functools
import os
import sys
from pathlib import Path

import MaterialX as mx
import numpy as np
from MaterialX import PyMaterialXGenGlsl as glsl
from MaterialX import PyMaterialXGenShader as gen
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from pipe import serve
from sphere import basis

LIGHT = np.array([0.0, 0.0, 1.0])
# Points a draw: the side of the texture.
SIDE = 256
IDENTITY = [float(i % 5 == 0) for i in range(16)]

# Vertices are points: pixel, normal, tangent, direction of the viewer. Outputs have the names of MaterialX's.
VERTEX = """#version 300 es
precision highp float;
in vec2 a_pixel; in vec3 a_normal; in vec3 a_tangent; in vec3 a_view;
out vec3 normalWorld; out vec3 tangentWorld; out vec3 bitangentWorld; out vec3 positionWorld;
void main() {
  gl_Position = vec4(a_pixel, 0.0, 1.0);
  gl_PointSize = 1.0;
  normalWorld = a_normal;
  tangentWorld = a_tangent;
  bitangentWorld = cross(a_normal, a_tangent);
  positionWorld = -a_view;
}
"""

# Makes a program of a shader, and draws points into a float texture.
SCRIPT = """
const gl = document.createElement("canvas").getContext("webgl2");
if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("no WebGL 2 with float targets");
const side = SIDE, programs = {};
const texture = gl.createTexture(), target = gl.createFramebuffer(), buffer = gl.createBuffer();
gl.bindTexture(gl.TEXTURE_2D, texture);
gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, side, side);
gl.bindFramebuffer(gl.FRAMEBUFFER, target);
gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
gl.viewport(0, 0, side, side);
gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
window.made = ({ name, vertex, fragment }) => {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  ["a_pixel", "a_normal", "a_tangent", "a_view"].forEach((attribute, k) => gl.bindAttribLocation(program, k, attribute));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  programs[name] = program;
};
const set = {
  [gl.FLOAT]: (at, v) => gl.uniform1f(at, v), [gl.INT]: (at, v) => gl.uniform1i(at, v), [gl.BOOL]: (at, v) => gl.uniform1i(at, v),
  [gl.FLOAT_VEC2]: (at, v) => gl.uniform2fv(at, v), [gl.FLOAT_VEC3]: (at, v) => gl.uniform3fv(at, v),
  [gl.FLOAT_VEC4]: (at, v) => gl.uniform4fv(at, v), [gl.FLOAT_MAT4]: (at, v) => gl.uniformMatrix4fv(at, false, v),
};
window.draw = ({ name, uniforms, points, count }) => {
  const program = programs[name], missing = [];
  gl.useProgram(program);
  for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
    const { name: uniform, type } = gl.getActiveUniform(program, k);
    if (uniform in uniforms && set[type]) set[type](gl.getUniformLocation(program, uniform), uniforms[uniform]);
    else missing.push(uniform);
  }
  if (missing.length) throw new Error("no values of " + missing);
  gl.bufferData(gl.ARRAY_BUFFER, Uint8Array.from(atob(points), (c) => c.charCodeAt(0)), gl.STREAM_DRAW);
  [2, 3, 3, 3].reduce((at, size, k) => {
    gl.enableVertexAttribArray(k);
    gl.vertexAttribPointer(k, size, gl.FLOAT, false, 44, at);
    return at + 4 * size;
  }, 0);
  gl.clearColor(NaN, NaN, NaN, NaN);
  gl.clear(gl.COLOR_BUFFER_BIT);
  gl.drawArrays(gl.POINTS, 0, count);
  const pixels = new Float32Array(4 * side * side);
  gl.readPixels(0, 0, side, side, gl.RGBA, gl.FLOAT, pixels);
  const bytes = new Uint8Array(pixels.buffer, 0, 16 * count);
  let text = "";
  for (let k = 0; k < bytes.length; k += 8192) text += String.fromCharCode(...bytes.subarray(k, k + 8192));
  return btoa(text);
};
""".replace("SIDE", str(SIDE))


def grey(x):
    return [float(x)] * 3


def hair(p):
    # Absorption is per radius, tau over the diameter; an angle of 0.5 is none.
    return {
        "b.ior": p["eta"], "b.absorption_coefficient": grey(0.5 * p["tau"]), "b.cuticle_angle": 0.5 + p["alpha"] / np.pi,
        "r.longitudinal": p["beta_m"], "r.azimuthal": p["beta_n"],
    }


def color_and_roughness(p):
    return {"b.color": grey(p["albedo"]), "b.roughness": p["roughness"]}


def dielectric(p):
    return {"b.ior": p["eta"], "b.roughness": [p["alpha"]] * 2}


def conductor(p):
    return {"b.ior": grey(p["eta"]), "b.extinction": grey(p["kappa"]), "b.roughness": [p["alpha"]] * 2}


def schlick(p):
    return {"b.color0": grey(p["f0"]), "b.roughness": [p["alpha"]] * 2}


def open_pbr(p):
    return {
        "s.base_color": grey(p["albedo"]), "s.specular_roughness": p["roughness"], "s.base_diffuse_roughness": p["diffuse_roughness"],
        "s.base_metalness": p["metalness"], "s.fuzz_weight": p["fuzz"], "s.fuzz_roughness": p["fuzz_roughness"], "s.coat_weight": p["coat"],
    }


def open_pbr_thin(p):
    # A sheet that only scatters: no specular lobe, all of it subsurface.
    return {
        "s.subsurface_weight": 1.0, "s.subsurface_color": grey(p["albedo"]), "s.specular_weight": 0.0, "s.geometry_thin_walled": True,
        "s.subsurface_scatter_anisotropy": p["anisotropy"],
    }


def standard(p):
    return {
        "s.base": 1.0, "s.base_color": grey(p["albedo"]), "s.specular_roughness": p["roughness"], "s.metalness": p["metalness"],
        "s.sheen": p["sheen"], "s.sheen_roughness": p["sheen_roughness"], "s.coat": p["coat"],
    }


UNIT = [0.0, 1.0, 0.5]
WHITE, ALPHA = [0.0, 1.0, 1.0], [0.1, 0.8, 0.3]
BETA = [0.15, 1.0, 0.3]
HAIR = {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0], "beta_m": BETA, "beta_n": BETA}
MATTE = {"albedo": [0.1, 1.0, 1.0], "roughness": UNIT}
SHEEN = {"albedo": [0.1, 1.0, 1.0], "roughness": [0.1, 1.0, 0.5]}
CHIANG = ["lossless", "smooth_cylinder", "chiang", "circular"]
FLAT = ["circular", "reciprocal"]
# Lines of the generated shader that a twin of a model has otherwise.
# A lobe apart needs a tint of the later orders.
LATER = ("tint[3] = tint_TRT;", "tint[3] = vec3(u_later);")
DENSITY = ("(1.0 / 2.0 * M_PI)", "(0.5 / M_PI)")
OVER_PI = ("bsdf.response = F * closureData.occlusion * M_PI_INV;", "bsdf.response = F * closureData.occlusion;")
# The tilt belongs to the direction that is held, the viewer's: turned light loses no solid angle at the pole.
TILT = [("mx_hair_alpha_angles(alpha, sinThetaI, cosThetaI, angles);", "mx_hair_alpha_angles(alpha, sinThetaO, cosThetaO, angles);"),
        ("(angles[i].x, angles[i].y, sinThetaO, cosThetaO, vs[i].x)", "(angles[i].x, abs(angles[i].y), sinThetaI, cosThetaI, vs[i].x)")]
# I_0 has 10 terms up to 12, and half of its second term beyond.
BESSEL = [("for (int i = 0; i < 9 ; ++i)", "for (int i = 0; i < 16 ; ++i)"), ("1.0 / (8.0 * x))", "1.0 / (4.0 * x) + 1.0 / (8.0 * x * x))")]
CUT = [(f"roughness_{k} = clamp(roughness_{k}, 0.001, 1.0);", "") for k in ("R", "TT", "TRT")]
# Node, its fixed inputs, maker of inputs, parameters [low, high, default], claims, replaced lines.
MODELS = {
    "chiang_hair_bsdf": ("chiang_hair_bsdf", {}, hair, HAIR, CHIANG, []),
    "chiang_hair_bsdf, mended": ("chiang_hair_bsdf", {}, hair, HAIR, CHIANG, [DENSITY, OVER_PI, *CUT, *TILT, *BESSEL]),
    "oren_nayar_diffuse_bsdf": ("oren_nayar_diffuse_bsdf", {}, color_and_roughness, MATTE, FLAT, []),
    "oren_nayar_diffuse_bsdf, compensated": ("oren_nayar_diffuse_bsdf", {"energy_compensation": True}, color_and_roughness, MATTE, FLAT, []),
    "burley_diffuse_bsdf": ("burley_diffuse_bsdf", {}, color_and_roughness, MATTE, FLAT, []),
    "sheen_bsdf, conty_kulla": ("sheen_bsdf", {"mode": "conty_kulla"}, color_and_roughness, SHEEN, FLAT, []),
    "sheen_bsdf, zeltner": ("sheen_bsdf", {"mode": "zeltner"}, color_and_roughness, SHEEN, ["circular"], []),
    "dielectric_bsdf": ("dielectric_bsdf", {}, dielectric, {"eta": [1.1, 2.0, 1.5], "alpha": ALPHA}, ["circular"], []),
    "conductor_bsdf": ("conductor_bsdf", {}, conductor, {"eta": [0.2, 3.0, 0.4], "kappa": [0.0, 7.0, 2.5], "alpha": ALPHA}, ["circular"], []),
    "generalized_schlick_bsdf": ("generalized_schlick_bsdf", {}, schlick, {"f0": [0.0, 1.0, 1.0], "alpha": ALPHA}, ["circular"], []),
    "open_pbr_surface": ("open_pbr_surface", {}, open_pbr,
                         {"albedo": WHITE, "roughness": [0.3, 1.0, 0.5], "diffuse_roughness": [0.0, 1.0, 0.0], "metalness": [0.0, 1.0, 0.0],
                          "fuzz": [0.0, 1.0, 0.0], "fuzz_roughness": [0.2, 1.0, 0.5], "coat": [0.0, 1.0, 0.0]}, ["circular"], []),
    "open_pbr_surface, thin": ("open_pbr_surface", {}, open_pbr_thin, {"albedo": [0.1, 1.0, 1.0], "anisotropy": [-1.0, 1.0, 0.0]}, ["circular"], []),
    "standard_surface": ("standard_surface", {}, standard,
                         {"albedo": WHITE, "roughness": [0.3, 1.0, 0.5], "metalness": [0.0, 1.0, 0.0], "sheen": [0.0, 1.0, 0.0],
                          "sheen_roughness": [0.2, 1.0, 0.5], "coat": [0.0, 1.0, 0.0]}, ["circular"], []),
}
FIBERS = ("chiang_hair_bsdf",)


@functools.cache
def library():
    path = mx.FileSearchPath(str(Path(mx.__file__).parent))
    found = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), path, found)
    return found, path


def document(node, fixed):
    """A material of one node: a BSDF in a `surface`, or a surface shader."""
    data, _ = library()
    doc = mx.createDocument()
    doc.setDataLibrary(data)
    if node.endswith("_surface"):
        surface = doc.addNode(node, "s", "surfaceshader")
    else:
        made = doc.addNode(node, "b", "BSDF")
        for name, value in fixed.items():
            made.setInputValue(name, value)
        if node == "chiang_hair_bsdf":
            widths = doc.addNode("chiang_hair_roughness", "r", "multioutput")
            for lobe in ("R", "TT", "TRT"):
                at = made.addInput(f"roughness_{lobe}", "vector2")
                at.setConnectedNode(widths)
                at.setOutputString(f"roughness_{lobe}")
        surface = doc.addNode("surface", "s", "surfaceshader")
        surface.addInput("bsdf", "BSDF").setConnectedNode(made)
    return doc, doc.addMaterialNode("m", surface)


def generated(node, fixed):
    """The pixel shader and the values of its uniforms by name."""
    doc, material = document(node, fixed)
    generator = glsl.EsslShaderGenerator.create()
    context = gen.GenContext(generator)
    context.registerSourceCodeSearchPath(library()[1])
    generator.registerTypeDefs(doc)
    options = context.getOptions()
    options.hwSpecularEnvironmentMethod = gen.HwSpecularEnvironmentMethod.SPECULAR_ENVIRONMENT_NONE
    options.hwMaxActiveLightSources = 1
    gen.HwShaderGenerator.bindLightShader(doc.getNodeDef("ND_directional_light"), 1, context)
    # The stage points into the shader, which must live as long.
    shader = generator.generate("m", material, context)
    stage = shader.getStage(gen.PIXEL_STAGE)
    values = {"u_viewPosition": [0.0] * 3, "u_numActiveLightSources": 1, "u_later": 1.0, "u_refractionTwoSided": False}
    values.update({f"u_lightData[0].{k}": v for k, v in (("type", 1), ("direction", (-LIGHT).tolist()), ("color", [1.0] * 3), ("intensity", 1.0))})
    for block in stage.getUniformBlocks().values():
        for port in block:
            value = port.getValue()
            if value is not None and port.getVariable() not in values:
                values[port.getVariable()] = plain(value.getData())
    return stage.getSourceCode(), values


def plain(value):
    return value if isinstance(value, (bool, int, float, str)) else [float(x) for x in value]


class MaterialX:
    def __init__(self):
        args = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        self.playwright = sync_playwright().start()
        program = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        self.browser = self.playwright.chromium.launch(executable_path=program, args=args)
        self.page = self.browser.new_page()
        self.page.evaluate(f"() => {{ {SCRIPT} }}")

    def describe(self):
        models = []
        for name, (node, _, _, parameters, claims, _) in MODELS.items():
            fiber = node in FIBERS
            kind, fields = ("fiber", ["near"]) if fiber else ("surface", ["surface"])
            models.append(dict(name=name, kind=kind, fields=fields, lobes=fiber, methods=["eval"], parameters=parameters, claims=claims))
        return {"protocol": 1, "name": "MaterialX", "version": f"{mx.getVersionString()} ESSL", "models": models}

    @functools.cache
    def uniforms(self, name):
        """Compiles the shader of a model."""
        node, fixed, _, _, _, replaced = MODELS[name]
        text, values = generated(node, fixed)
        # Without an environment the code for refraction, which no light here reaches, names a uniform of it.
        more = "" if "bool u_refractionTwoSided" in text else "uniform bool u_refractionTwoSided;\n"
        if node in FIBERS:
            more, replaced = more + "uniform float u_later;\n", [LATER, *replaced]
        text = text.replace("in vec3 normalWorld;", more + "in vec3 normalWorld;", 1)
        for old, new in replaced:
            if text.count(old) != 1:
                raise ValueError(f"{name}: {old!r} is {text.count(old)} times in the shader: 1")
            text = text.replace(old, new)
        self.page.evaluate("(m) => made(m)", {"name": name, "vertex": VERTEX, "fragment": text})
        return values

    def frame(self, q):
        """Normal and tangent."""
        if MODELS[q["model"]][0] not in FIBERS:
            return np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        phi = np.arctan2(q["wi"][1], q["wi"][0]) + np.arcsin(np.clip(q["h"], -1.0, 1.0))
        return np.array([np.cos(phi), np.sin(phi), 0.0]), np.array([0.0, 0.0, 1.0])

    def drawn(self, name, uniforms, points):
        """Colors of points [n, 9]: normal, tangent, view."""
        out = []
        for begin in range(0, len(points), SIDE * SIDE):
            part = points[begin : begin + SIDE * SIDE]
            k = np.arange(len(part))
            pixel = (np.stack([k % SIDE, k // SIDE], axis=1) + 0.5) / SIDE * 2.0 - 1.0
            data = np.concatenate([pixel, part], axis=1).astype(np.float32)
            asked = {"name": name, "uniforms": uniforms, "points": base64.b64encode(data.tobytes()).decode(), "count": len(part)}
            found = np.frombuffer(base64.b64decode(self.page.evaluate("(m) => draw(m)", asked)), np.float32).reshape(-1, 4)
            out.append(found[:, 0])
        return np.concatenate(out)

    def eval(self, q, wo):
        name = q["model"]
        values = dict(self.uniforms(name))
        for key, value in MODELS[name][2](q["parameters"]).items():
            variable = key.replace(".", "_")
            if variable not in values:
                raise ValueError(f"{name}: no uniform {variable} in {sorted(values)}")
            values[variable] = value
        across, along = basis(wo)
        turn = lambda v: np.stack([across @ v, along @ v, wo @ v], axis=1)
        normal, tangent = self.frame(q)
        points = np.concatenate([turn(v) for v in (normal, tangent, np.array(q["wi"], float))], axis=1)
        if MODELS[name][0] not in FIBERS:
            return self.drawn(name, values, points)
        lobes = []
        for lobe in range(4):
            shares = {f"b_tint_{k}": grey(lobe == j) for j, k in enumerate(("R", "TT", "TRT"))}
            lobes.append(self.drawn(name, {**values, **shares, "u_later": float(lobe == 3)}, points))
        return np.stack(lobes, axis=1)


if __name__ == "__main__":
    serve(MaterialX())
