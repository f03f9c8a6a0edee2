# Makes this cloth in Blender 5.0, for Cycles: run `blender --python THIS_FILE`, open it in the text
# editor and run it, or import it and call build(). The node group works on any mesh with texture coordinates,
# whose u is the weft and whose v is the warp.
import os

import bpy

FOLDER = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else bpy.path.abspath("//")


def image(what):
    """Loads a texture and packs it into the .blend; colors are sRGB, other numbers are as they are."""
    path = os.path.join(FOLDER, CLOTH["textures"][what])
    if not os.path.isfile(path):
        raise FileNotFoundError(f"{path}: no such texture; keep the folder of textures beside the .py")
    data = bpy.data.images.load(path, check_existing=True)
    data.colorspace_settings.name = "sRGB" if what in ("diffuse", "translucent", "glossy") else "Non-Color"
    data.pack()
    return data


def node_group():
    """Makes the node group: repeats per texture coordinate and relief in, a closure out."""
    group = bpy.data.node_groups.new(CLOTH["name"], "ShaderNodeTree")
    interface, nodes, link = group.interface, group.nodes, group.links.new
    scale = interface.new_socket("Repeats per UV", in_out="INPUT", socket_type="NodeSocketVector")
    scale.default_value = (*CLOTH["repeats_per_uv"], 1.0)
    relief = interface.new_socket("Relief", in_out="INPUT", socket_type="NodeSocketFloat")
    relief.default_value, relief.min_value, relief.max_value = CLOTH["relief"], 0.0, 1.0
    interface.new_socket("Cloth", in_out="OUTPUT", socket_type="NodeSocketShader")
    place = [-1400, 0]

    def node(kind, **values):
        made = nodes.new(kind)
        place[0] += 40
        place[1] -= 60
        made.location = place
        for key, value in values.items():
            setattr(made, key, value)
        return made

    def vector(operation, a, b):
        made = node("ShaderNodeVectorMath", operation=operation)
        for k, value in enumerate((a, b)):
            if isinstance(value, tuple):
                made.inputs[k].default_value = value
            else:
                link(value, made.inputs[k])
        return made.outputs[0]

    def times(color, value):
        made = node("ShaderNodeVectorMath", operation="SCALE")
        link(color, made.inputs[0])
        if isinstance(value, float):
            made.inputs["Scale"].default_value = value
        else:
            link(value, made.inputs["Scale"])
        return made.outputs[0]

    source, sink = node("NodeGroupInput"), node("NodeGroupOutput")
    uv = vector("MULTIPLY", node("ShaderNodeTexCoord").outputs["UV"], source.outputs[0])
    textures = {}
    for what in CLOTH["textures"]:
        made = node("ShaderNodeTexImage", image=image(what), interpolation="Linear", extension="REPEAT", label=what)
        link(uv, made.inputs["Vector"])
        textures[what] = made.outputs["Color"]
    normal = node("ShaderNodeNormalMap", space="TANGENT")
    link(source.outputs[1], normal.inputs["Strength"])
    link(textures["normal"], normal.inputs["Color"])
    # The direction across the yarn, of the directions of u and v on the surface.
    along_u = node("ShaderNodeTangent", direction_type="UV_MAP").outputs[0]
    along_v = vector("CROSS_PRODUCT", node("ShaderNodeNewGeometry").outputs["Normal"], along_u)
    parts = node("ShaderNodeSeparateXYZ")
    link(vector("SUBTRACT", times(textures["across"], 2.0), (1.0, 1.0, 1.0)), parts.inputs[0])
    across = vector("ADD", times(along_u, parts.outputs[0]), times(along_v, parts.outputs[1]))
    negative = node("ShaderNodeMath", operation="MULTIPLY")
    link(textures["anisotropy"], negative.inputs[0])
    negative.inputs[1].default_value = -1.0

    glossy = node("ShaderNodeBsdfAnisotropic", distribution="GGX")
    link(times(textures["glossy"], CLOTH["glossy"]), glossy.inputs["Color"])
    link(textures["roughness"], glossy.inputs["Roughness"])
    link(negative.outputs[0], glossy.inputs["Anisotropy"])
    link(vector("NORMALIZE", across, (0.0, 0.0, 0.0)), glossy.inputs["Tangent"])
    sheen = node("ShaderNodeBsdfSheen", distribution="MICROFIBER")
    sheen.inputs["Color"].default_value = (*CLOTH["sheen"], 1.0)
    sheen.inputs["Roughness"].default_value = CLOTH["sheen_roughness"]
    diffuse = node("ShaderNodeBsdfDiffuse")
    link(textures["diffuse"], diffuse.inputs["Color"])
    translucent = node("ShaderNodeBsdfTranslucent")
    # A share of it falls with the viewer's cosine, which is 1 - facing.
    facing = node("ShaderNodeLayerWeight")
    facing.inputs["Blend"].default_value = 0.5
    link(normal.outputs[0], facing.inputs["Normal"])
    falls = node("ShaderNodeMath", operation="MULTIPLY")
    link(facing.outputs["Facing"], falls.inputs[0])
    falls.inputs[1].default_value = -CLOTH["facing"]
    stays = node("ShaderNodeMath", operation="ADD")
    link(falls.outputs[0], stays.inputs[0])
    stays.inputs[1].default_value = 1.0
    link(times(times(textures["translucent"], CLOTH["translucent"]), stays.outputs[0]), translucent.inputs["Color"])
    # Light that goes on forward: a rough refraction, whose index sets how far it spreads.
    forward = node("ShaderNodeBsdfRefraction", distribution="GGX")
    forward.inputs["Color"].default_value = (*CLOTH["forward"], 1.0)
    forward.inputs["Roughness"].default_value = CLOTH["forward_roughness"]
    forward.inputs["IOR"].default_value = CLOTH["forward_ior"]
    total = None
    for closure in (glossy, sheen, diffuse, translucent, forward):
        link(normal.outputs[0], closure.inputs["Normal"])
        if total is None:
            total = closure
            continue
        added = node("ShaderNodeAddShader")
        link(total.outputs[0], added.inputs[0])
        link(closure.outputs[0], added.inputs[1])
        total = added
    gaps = node("ShaderNodeMixShader")
    link(textures["opacity"], gaps.inputs[0])
    link(node("ShaderNodeBsdfTransparent").outputs[0], gaps.inputs[1])
    link(total.outputs[0], gaps.inputs[2])
    link(gaps.outputs[0], sink.inputs[0])
    return group


def material():
    """Makes a material of the node group."""
    made = bpy.data.materials.new(CLOTH["name"])
    made.use_nodes = True
    nodes = made.node_tree.nodes
    nodes.clear()
    group, out = nodes.new("ShaderNodeGroup"), nodes.new("ShaderNodeOutputMaterial")
    group.node_tree, group.location, group.width = node_group(), (-300, 0), 220
    made.node_tree.links.new(group.outputs[0], out.inputs["Surface"])
    return made


def swatch(made):
    """Makes a flat swatch of whole repeats in the plane z = 0 [m], with x along the weft."""
    half = [0.5 * m * n for m, n in zip(CLOTH["repeat_m"], CLOTH["swatch_repeats"])]
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    mesh = bpy.data.meshes.new(CLOTH["name"])
    mesh.from_pydata([(x * half[0], y * half[1], 0.0) for x, y in corners], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    for loop, (x, y) in zip(layer.data, corners):
        uv = [0.5 * (k + 1) * n / per for k, n, per in zip((x, y), CLOTH["swatch_repeats"], CLOTH["repeats_per_uv"])]
        loop.uv = uv
    mesh.materials.append(made)
    mesh.update()
    made_object = bpy.data.objects.new(CLOTH["name"], mesh)
    bpy.context.scene.collection.objects.link(made_object)
    return made_object


def build():
    """Makes the node group, the material and a swatch, and gives the swatch."""
    return swatch(material())


if __name__ == "__main__":
    build()
