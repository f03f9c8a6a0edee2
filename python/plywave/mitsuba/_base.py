"""Base of the three BSDF plugins: checks of keys and shapes, and the calls of ``mitsuba.BSDF``."""

import contextlib
import difflib
import math

import drjit as dr
import mitsuba as mi

#: Wavelengths that stand for the channels of linear sRGB [um] (``plywave::color::RGB_LAMBDA_UM``).
RGB_LAMBDA_UM = (0.612, 0.549, 0.464)


def check_keys(plugin, props, known):
    """Refuses keys that the plugin does not know, and suggests the most similar known key."""
    for key in props.keys():
        if key not in known and not key.startswith("_"):
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean '{near[0]}'?" if near else "known keys: " + ", ".join(sorted(known))
            raise ValueError(f"{plugin}: {key}: unknown key: {hint}")


def typed(plugin, props, key, kind, default):
    """Value of a key with one type; other types raise an error of one line."""
    if key not in props:
        return default
    value = props[key]
    names = {bool: "true or false", float: "a number", str: "a text"}
    ok = isinstance(value, kind) or (kind is float and isinstance(value, int) and not isinstance(value, bool))
    if not ok:
        raise ValueError(f"{plugin}: {key}: {value!r}: expected {names[kind]}")
    if kind is float and not math.isfinite(value):
        raise ValueError(f"{plugin}: {key}: {value!r}: expected a finite number")
    return float(value) if kind is float else value


def check_lengths(plugin, key, given, values):
    """Refuses values that are not two lengths above 0."""
    if len(values) != 2 or not all(math.isfinite(v) and v > 0.0 for v in values):
        raise ValueError(f"{plugin}: {key}: {given!r}: expected one or two numbers above 0 [um]; to_uv turns and mirrors the pattern")
    return values


def check_size(plugin, key, parameter, size):
    """Refuses a parameter whose number of values was changed: kernels would read beyond them."""
    if len(parameter) != size:
        raise ValueError(f"{plugin}: {key}: {len(parameter)} values: expected {size}")


def texture(plugin, props, key, default=None):
    """A texture, color or number that may exceed 1."""
    if key not in props:
        return None if default is None else props.get_unbounded_texture(key, default)
    value = props[key]
    if isinstance(value, (int, float)) and not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"{plugin}: {key}: {value!r}: expected a number that is not negative")
    try:
        return props.get_unbounded_texture(key)
    except Exception as e:
        raise ValueError(f"{plugin}: {key}: expected a number, a color or a texture: {str(e).splitlines()[-1]}") from None


#: Number of shapes that are searched in JIT variants, the first ones created.
MAX_SHAPES = 256


def shapes_of(bsdf, si):
    """Shapes with a BSDF, as far as they can be found: the hit shape in scalar variants, the first shapes that still
    exist in JIT variants.
    """
    if mi.variant().startswith("scalar"):
        return [] if si.shape is None else [si.shape]
    found = []
    for number in range(1, MAX_SHAPES + 1):
        try:
            shape = dr.reinterpret_array(mi.ShapePtr, mi.UInt32(number))[0]
        except RuntimeError:
            # No shape with this number has existed.
            break
        if shape is not None and bsdf in plugins_of(shape.bsdf()):
            found.append(shape)
    return found


def plugins_of(bsdf):
    """Plugins of this package in a BSDF: the BSDF itself, or those nested in ``mask``, ``twosided`` and the like."""
    if hasattr(bsdf, "PLUGIN"):
        return [bsdf]
    found = []

    class Within(mi.TraversalCallback):
        def put(self, name, value, flags, cpptype=None):
            if isinstance(value, mi.BSDF):
                found.extend(plugins_of(value))

    if bsdf is not None:
        # A foreign plugin may not support traversal; then it contains none of this package's plugins.
        with contextlib.suppress(TypeError, RuntimeError):
            bsdf.traverse(Within())
    return found


def misfit(bsdf, shape):
    """Reason why a plugin cannot be on a shape, in one line; ``None`` if it can."""
    kind, is_mesh = shape.class_name(), shape.is_mesh()
    name = shape.id() or kind
    # Mitsuba counts a rectangle as a mesh. It always has uv, but no method that says so.
    if isinstance(shape, mi.Mesh) and not shape.has_vertex_texcoords():
        return f"{name}: no texture coordinates: {bsdf.PLUGIN} needs uv, {bsdf.ALONG}"
    if bsdf.PLUGIN == "plywave_cloth":
        return f"{name}: a curve: {bsdf.PLUGIN} is for surfaces: use plywave_ply" if "Curve" in kind else None
    if kind == "LinearCurve":
        return f"{name}: a linearcurve: Mitsuba does not tell where it runs: use a bsplinecurve"
    if not is_mesh and kind not in ("BSplineCurve", "Cylinder"):
        return f"{name}: a {kind}: {bsdf.PLUGIN} is for curves: use a bsplinecurve, or a tube with uv"
    return None


def make_calls():
    """Returns the base class of the plugins for the current variant.

    A plugin defines ``model_eval(si, wo, active)``, which returns f and the sampling density, and ``model_sample(si,
    u, active)``, which returns a direction, whether light passes straight through, and the energy and probability of
    that. Plugins whose evaluation and sampling share work define ``model_drawn`` and ``model_both`` instead.
    """

    def numbers(sample1, sample2):
        sample2 = mi.Point2f(sample2)
        return [mi.Float(sample1), sample2.x, sample2.y]

    class Calls(mi.BSDF):
        #: Whether the plugin's shapes have been checked.
        is_fitted = False

        def say_misfit(self, si):
            """Warns once about a shape that the plugin cannot be on."""
            if self.is_fitted:
                return
            self.is_fitted = True
            for shape in shapes_of(self, si):
                if text := misfit(self, shape):
                    mi.Log(mi.LogLevel.Warn, text)

        def setup(self, components):
            self.m_components = list(components)
            flags = 0
            for c in components:
                flags |= int(c)
            self.m_flags = mi.BSDFFlags(flags) if not isinstance(components[0], int) else flags

        def lambda_um(self, si):
            """Wavelengths of the channels [um]."""
            if self.kit.spectral:
                return [si.wavelengths[k] * 1e-3 for k in range(self.kit.count)]
            return [RGB_LAMBDA_UM[min(k, 2)] for k in range(self.kit.count)]

        # Arguments may be of any type that Mitsuba converts, such as lists, as for its own BSDFs.

        def eval_pdf(self, ctx, si, wo, active=True):
            self.say_misfit(si)
            active = mi.Bool(active)
            f, pdf = self.model_eval(si, mi.Vector3f(wo), active)
            on = active & (pdf > 0.0)
            return dr.select(on, f, 0.0), dr.select(on, pdf, 0.0)

        def eval(self, ctx, si, wo, active=True):
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx, si, wo, active=True):
            return self.eval_pdf(ctx, si, wo, active)[1]

        def sample(self, ctx, si, sample1, sample2, active=True):
            self.say_misfit(si)
            active = mi.Bool(active)
            drawn, light = self.model_drawn(si, numbers(sample1, sample2), active)
            return self.sampled(si, drawn, light, active)

        def sampled(self, si, drawn, light, active):
            """The sample of a direction that was drawn, with f and density in that direction."""
            (wo, straight, energy, chance), (f, pdf) = drawn, light
            on = active & (pdf > 0.0)
            f, pdf = dr.select(on, f, 0.0), dr.select(on, pdf, 0.0)
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo = dr.select(straight, -si.wi, wo)
            bs.pdf = dr.select(straight, chance, pdf)
            bs.eta = 1.0
            null, glossy = int(mi.BSDFFlags.Null), int(mi.BSDFFlags.GlossyReflection)
            bs.sampled_type = dr.select(straight, mi.UInt32(null), mi.UInt32(glossy))
            bs.sampled_component = 0
            weight = dr.select(straight, self.kit.S(energy / dr.maximum(chance, 1e-30)), f / dr.maximum(pdf, 1e-30))
            return bs, dr.select(active & (bs.pdf > 0.0), weight, 0.0)

        def eval_pdf_sample(self, ctx, si, wo, sample1, sample2, active=True):
            self.say_misfit(si)
            active = mi.Bool(active)
            (f, pdf), drawn, light = self.model_both(si, mi.Vector3f(wo), numbers(sample1, sample2), active)
            bs, weight = self.sampled(si, drawn, light, active)
            on = active & (pdf > 0.0)
            return dr.select(on, f, 0.0), dr.select(on, pdf, 0.0), bs, weight

        def model_drawn(self, si, u, active):
            """A sampled direction, with f and sampling density in that direction."""
            with dr.suspend_grad():
                drawn = self.model_sample(si, u, active)
            return drawn, self.model_eval(si, drawn[0], self.kit.both(active, self.kit.no(drawn[1])))

        def model_both(self, si, wo, u, active):
            """Results of :meth:`model_eval` and :meth:`model_drawn` together."""
            return self.model_eval(si, wo, active), *self.model_drawn(si, u, active)

    return Calls
