#!/usr/bin/env python3
"""Adapter of Blender's Cycles: BSDF nodes on fibers and planes, seen through pictures.

    python3 conformance/kit/conform.py "python3 conformance/kit/adapters/blender_cycles.py"

Needs `pip install bpy` (5.0 or later, for the camera that is a shader), which wants the Python of its wheel.

A picture has a pixel for each direction. Each pixel looks at a fiber or a plane of its own, which is turned so that
one sun lights it from `wo`; a camera shader reads the rays of all pixels, along `wi`, from two tables. There are no
bounces and no shadows, and the sun has an irradiance of 1, so that a pixel is the BSDF times its cosine, or f of a
fiber. `wi` is the viewer's direction, as in Cycles, where h is that of the viewer's ray.
"""
import contextlib
import hashlib
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from pipe import serve
from sphere import basis

# Kernel for scripts, part of Cycles' add-on.
import _cycles  # noqa: E402

SIDE = 96
RADIUS, HALF, AWAY, SPACING = 0.5, 1.0, 1.0, 3.6
# Offsets beyond this are asked here: a ray that touches the rim misses it by rounding.
RIM = 0.9995
# Spread of a pixel's ray [rad]. `hair, Huang` takes the mean over the offsets that a pixel covers: h +- 0.02,
# or all.
PIXEL = {"near": 0.02, "far": 4.0, "surface": 0.02}
CAMERA = """
shader table(output point position = 0, output vector direction = 0, output color throughput = 1,
  output vector dPdx = 0, output vector dPdy = 0, output vector dDdx = 0, output vector dDdy = 0)
{
  point r = camera_shader_raster_position();
  float s = (floor(r[0] * SIDE) + 0.5) / SIDE, t = (floor((1 - r[1]) * SIDE) + 0.5) / SIDE;
  color at = texture("AT.pfm", s, t, 0, 0, 0, 0, "interp", "closest", "wrap", "clamp");
  color to = texture("TO.pfm", s, t, 0, 0, 0, 0, "interp", "closest", "wrap", "clamp");
  position = point(at[0], at[1], -at[2]);
  direction = vector(to[0], to[1], -to[2]);
  vector side = abs(direction[0]) < 0.5 ? vector(1, 0, 0) : vector(0, 1, 0);
  dDdx = 4242.25 * normalize(cross(direction, side));
  dDdy = 4242.25 * normalize(cross(direction, dDdx));
}
""".replace("SIDE", str(SIDE))


def grey(x):
    return (float(x), float(x), float(x), 1.0)


def hair(p):
    # Absorption is per radius, tau over the diameter.
    return {
        "IOR": p["eta"], "Absorption Coefficient": grey(0.5 * p["tau"])[:3], "Offset": p["alpha"], "Roughness": p["beta_m"],
        "Radial Roughness": p["beta_n"],
    }


def huang(p):
    # One roughness, of the facets; the node takes its square root.
    return {"IOR": p["eta"], "Absorption Coefficient": grey(0.5 * p["tau"])[:3], "Offset": p["alpha"], "Roughness": p["beta_m"]}


def matte(p):
    return {"Color": grey(p["albedo"]), **({"Roughness": p["roughness"]} if "roughness" in p else {})}


def facets(p):
    # The nodes take the square root of GGX's alpha.
    found = {"Roughness": np.sqrt(p["alpha"])}
    if "kappa" in p:
        return {**found, "IOR": grey(p["eta"])[:3], "Extinction": grey(p["kappa"])[:3]}
    return {**found, **({"IOR": p["eta"]} if "eta" in p else {})}


def principled(p):
    names = {"metallic": "Metallic", "roughness": "Roughness", "diffuse_roughness": "Diffuse Roughness", "sheen": "Sheen Weight",
             "sheen_roughness": "Sheen Roughness", "coat": "Coat Weight", "transmission": "Transmission Weight"}
    return {"Base Color": grey(p["albedo"]), **{names[k]: v for k, v in p.items() if k in names}}


WHITE, ALPHA, ETA = [0.0, 1.0, 1.0], [0.1, 0.8, 0.3], [1.1, 2.0, 1.5]
BETA = [0.15, 1.0, 0.3]
SHEEN = {"albedo": WHITE, "roughness": [0.1, 1.0, 0.5]}
HAIR = {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0], "beta_m": BETA, "beta_n": BETA}
HUANG = {"eta": [1.1, 2.0, 1.55], "tau": [0.0, 5.0, 0.0], "alpha": [-0.1, 0.1, 0.0], "beta_m": [0.3, 1.0, 0.5]}
PRINCIPLED = {"albedo": WHITE, "roughness": [0.3, 1.0, 0.5], "diffuse_roughness": [0.0, 1.0, 0.0], "metallic": [0.0, 1.0, 0.0],
              "sheen": [0.0, 1.0, 0.0], "sheen_roughness": [0.2, 1.0, 0.5], "coat": [0.0, 1.0, 0.0], "transmission": [0.0, 1.0, 0.0]}
ABSORPTION = {"parametrization": "ABSORPTION"}
# Node, its choices, maker of inputs, parameters [low, high, default], claims.
MODELS = {
    "hair, Chiang": ("HairPrincipled", {"model": "CHIANG", **ABSORPTION}, hair, HAIR, ["lossless", "smooth_cylinder", "chiang", "circular"]),
    "hair, Huang": ("HairPrincipled", {"model": "HUANG", **ABSORPTION}, huang, HUANG, []),
    "diffuse": ("Diffuse", {}, matte, {"albedo": WHITE, "roughness": [0.0, 1.0, 0.0]}, ["circular", "reciprocal"]),
    "translucent": ("Translucent", {}, matte, {"albedo": WHITE}, ["circular", "reciprocal", "two_sided"]),
    "sheen, microfiber": ("Sheen", {"distribution": "MICROFIBER"}, matte, SHEEN, ["circular"]),
    "sheen, Ashikhmin": ("Sheen", {"distribution": "ASHIKHMIN"}, matte, SHEEN, ["circular", "reciprocal"]),
    "glossy, GGX": ("Glossy", {"distribution": "GGX"}, facets, {"alpha": ALPHA}, ["circular", "reciprocal"]),
    "glossy, multiple GGX": ("Glossy", {"distribution": "MULTI_GGX"}, facets, {"alpha": ALPHA}, ["circular"]),
    "glass, GGX": ("Glass", {"distribution": "GGX"}, facets, {"eta": ETA, "alpha": ALPHA}, ["circular", "reciprocal", "two_sided"]),
    "glass, multiple GGX": ("Glass", {"distribution": "MULTI_GGX"}, facets, {"eta": ETA, "alpha": ALPHA}, ["circular", "two_sided", "lossless"]),
    "metallic, GGX": ("Metallic", {"distribution": "GGX", "fresnel_type": "PHYSICAL_CONDUCTOR"}, facets,
                      {"eta": [0.2, 3.0, 0.4], "kappa": [0.0, 7.0, 2.5], "alpha": ALPHA}, ["circular", "reciprocal"]),
    "principled": ("Principled", {"distribution": "MULTI_GGX"}, principled, PRINCIPLED, ["circular"]),
}
FIBERS = ("HairPrincipled",)
# Nodes whose value is a random estimate, with the evaluations of a picture. Its noise of about 1 % is evened
# out in integrals: no claim is made that is checked direction by direction.
DRAWN = {"hair, Huang": 1 << 19}
# Inputs whose defaults are others. Some models of a node lack some of them.
FIXED = {"HairPrincipled": {"Random Roughness": 0.0, "Coat": 0.0, "Aspect Ratio": 1.0}, "Glossy": {"Color": grey(1.0)}, "Glass": {"Color": grey(1.0)}}


@contextlib.contextmanager
def quiet():
    """Sends what Blender prints to the standard error: the standard output has the answers."""
    sys.stdout.flush()
    keep = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(keep, 1)
        os.close(keep)


def table(path, values):
    """Writes three floats a pixel; the first row of a .pfm is the lowest."""
    pixels = np.zeros((SIDE * SIDE, 3), "<f4")
    pixels[: len(values)] = values
    path.write_bytes(b"PF\n%d %d\n-1.0\n" % (SIDE, SIDE) + pixels.reshape(SIDE, SIDE, 3)[::-1].tobytes())


class Cycles:
    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kit-cycles-"))
        self.objects, self.count, self.materials = {}, 0, {}
        with quiet():
            self.scene()

    def scene(self):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        c = scene.cycles
        c.samples, c.use_denoising, c.max_bounces, c.use_adaptive_sampling = 1, False, 0, False
        c.pixel_filter_type, c.filter_width, c.sample_clamp_direct, c.blur_glossy = "BOX", 0.01, 0.0, 0.0
        scene.render.film_transparent, scene.render.use_persistent_data = True, True
        scene.render.threads_mode, scene.render.threads = "FIXED", 2
        scene.render.resolution_x = scene.render.resolution_y = SIDE
        scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
        scene.render.filepath = str(self.folder / "picture.exr")
        scene.cycles_curves.shape = "THICK_LINEAR"
        scene.world = bpy.data.worlds.new("dark")
        for node in scene.world.node_tree.nodes:
            if node.type == "BACKGROUND":
                node.inputs["Strength"].default_value = 0.0
        self.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.camera.data.type, self.camera.data.custom_mode = "CUSTOM", "INTERNAL"
        self.camera.data.clip_start = 1e-6
        scene.collection.objects.link(self.camera)
        scene.camera = self.camera
        # A sun shines along its -z: light comes from +z.
        lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        lamp.data.energy, lamp.data.angle, lamp.data.use_shadow = 1.0, 0.0, False
        scene.collection.objects.link(lamp)
        source, compiled = self.folder / "table.osl", self.folder / "table.oso"
        source.write_text(CAMERA)
        if not _cycles.osl_compile(str(source), str(compiled)):
            raise RuntimeError("the camera's shader does not compile")
        self.code = compiled.read_text()

    def describe(self):
        models = []
        for name, (node, _, _, parameters, claims) in MODELS.items():
            kind, fields = ("fiber", ["near"]) if node in FIBERS else ("surface", ["surface"])
            fields = ["near", "far"] if name in DRAWN else fields
            models.append(dict(name=name, kind=kind, fields=fields, methods=["eval"], parameters=parameters, claims=claims))
        return {"protocol": 1, "name": "Blender Cycles", "version": bpy.app.version_string, "models": models}

    def material(self, name):
        """A material of one node, and the node."""
        if name not in self.materials:
            kind, choices, _, _, _ = MODELS[name]
            made = bpy.data.materials.new(name)
            made.use_nodes = True
            tree = made.node_tree
            tree.nodes.clear()
            node = tree.nodes.new(f"ShaderNodeBsdf{kind}")
            for key, value in choices.items():
                setattr(node, key, value)
            for key, value in FIXED.get(kind, {}).items():
                if node.inputs.get(key):
                    node.inputs[key].default_value = value
            output = tree.nodes.new("ShaderNodeOutputMaterial")
            tree.links.new(node.outputs[0], output.inputs["Surface"])
            self.materials[name] = (made, node)
        return self.materials[name]

    def placed(self, wo, fiber):
        """An object of fibers or planes, each turned so that its own `wo` is the sun's +z; frames and places."""
        key = (fiber, wo.tobytes())
        if key not in self.objects:
            if len(self.objects) > 24:
                _, (old, _, _) = self.objects.popitem()
                data = old.data
                bpy.data.objects.remove(old)
                (bpy.data.hair_curves if isinstance(data, bpy.types.Curves) else bpy.data.meshes).remove(data)
            across, along = basis(wo)
            # Rows are the world's axes in the object's frame: a vector v of the kit is turn @ v.
            turn = np.stack([across, along, wo], axis=1)
            edge = int(np.ceil(len(wo) ** (1.0 / 3.0)))
            k = np.arange(len(wo))
            place = (np.stack([k % edge, k // edge % edge, k // edge**2], axis=1) - 0.5 * (edge - 1)) * SPACING
            made = fibers(turn, place) if fiber else planes(turn, place)
            thing = bpy.data.objects.new("things", made)
            bpy.context.scene.collection.objects.link(thing)
            self.objects[key] = (thing, turn, place)
        return self.objects[key]

    def eval(self, q, wo):
        found = [self.picture(q, wo[k : k + SIDE * SIDE]) for k in range(0, len(wo), SIDE * SIDE)]
        return np.concatenate(found)

    def picture(self, q, wo):
        with quiet():
            name, wi = q["model"], np.array(q["wi"], float)
            fiber = MODELS[name][0] in FIBERS
            thing, turn, place = self.placed(wo, fiber)
            made, node = self.material(name)
            for key, value in MODELS[name][2](q["parameters"]).items():
                node.inputs[key].default_value = value
            if not thing.data.materials:
                thing.data.materials.append(made)
            thing.data.materials[0] = made
            for other, _, _ in self.objects.values():
                other.hide_render = other is not thing
            phi = np.arctan2(wi[1], wi[0]) + np.arcsin(np.clip(q["h"], -RIM, RIM))
            seen = RADIUS * np.array([np.cos(phi), np.sin(phi), 0.0]) if fiber else np.zeros(3)
            at, to = place + turn @ (seen + AWAY * wi), np.broadcast_to(-wi, (len(wo), 3))
            self.look(at, np.einsum("kij,kj->ki", turn, to), PIXEL[q["field"]])
            bpy.context.scene.cycles.samples = max(1, DRAWN.get(name, 1) // (SIDE * SIDE))
            bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(bpy.context.scene.render.filepath)
            pixels = np.empty(4 * SIDE * SIDE, np.float32)
            image.pixels.foreach_get(pixels)
            bpy.data.images.remove(image)
        pixels = pixels.reshape(SIDE, SIDE, 4)[::-1].reshape(-1, 4)[: len(wo)]
        # Along the fiber, or in the plane, a ray meets nothing.
        edge_on = abs(wi[2]) > 0.99999 if fiber else abs(wi[2]) < 1e-6
        if np.any(pixels[:, 3] < 0.5) and not edge_on:
            raise ValueError(f"{int(np.sum(pixels[:, 3] < 0.5))} of {len(wo)} rays meet nothing")
        return pixels[:, 0]

    def look(self, at, to, spread):
        """Sets the rays in the compiled shader. Tables have new names, as a file that was read is kept."""
        self.count += 1
        code = self.code.replace("4242.25", f"{spread:g}")
        for word, values in (("AT", at), ("TO", to)):
            path = self.folder / f"{word}{self.count}.pfm"
            table(path, values)
            code = code.replace(f'"{word}.pfm"', f'"{path}"')
            (self.folder / f"{word}{self.count - 1}.pfm").unlink(missing_ok=True)
        self.camera.data.custom_bytecode = code
        self.camera.data.custom_bytecode_hash = hashlib.md5(code.encode()).hexdigest()
        self.camera.data.update_tag()


def fibers(turn, place):
    """Straight curves of two points, from the root to the tip."""
    made = bpy.data.hair_curves.new("fibers")
    made.add_curves([2] * len(place))
    made.set_types(type="POLY")
    axis = turn[:, :, 2]
    ends = np.stack([place - HALF * axis, place + HALF * axis], axis=1)
    made.attributes["position"].data.foreach_set("vector", ends.astype(np.float32).ravel())
    radius = made.attributes.get("radius") or made.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(2 * len(place), RADIUS, np.float32))
    return made


def planes(turn, place):
    """Squares whose normal is the kit's z."""
    made = bpy.data.meshes.new("planes")
    x, y = 0.5 * turn[:, :, 0], 0.5 * turn[:, :, 1]
    corners = np.stack([place - x - y, place + x - y, place + x + y, place - x + y], axis=1).reshape(-1, 3)
    made.from_pydata(corners.tolist(), [], np.arange(len(corners)).reshape(-1, 4).tolist())
    return made


if __name__ == "__main__":
    serve(Cycles())
