"""The plugin ``plywave_fiber``: a fiber table on curves."""

import math

import drjit as dr
import mitsuba as mi

from . import _native
from ._base import check_keys, check_size, typed
from ._fiber import BETA_M, Fiber
from ._kit import Kit, clamp
from ._ply import read_container


def define(Calls):
    """Defines the plugin's class for the current variant."""

    class OneFiber(Calls):
        """``plywave_fiber``: a single fiber's table on a curve or a tube with uv."""

        PLUGIN, ALONG = "plywave_fiber", "one of which runs along the fiber"
        KEYS = {"filename", "width", "beta_m_rad", "axis", "rotation_deg", "id"}

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            name = "plywave_fiber"
            check_keys(name, props, self.KEYS)
            self.kit = Kit()
            filename = typed(name, props, "filename", str, None)
            if filename is None:
                raise ValueError(f"{name}: filename: absent: name a fiber's table (.pwf)")
            filename = str(mi.file_resolver().resolve(filename))
            self.width = typed(name, props, "width", str, "wave")
            if self.width not in ("wave", "curve"):
                raise ValueError(f"{name}: width: {self.width!r}: expected 'wave' or 'curve'")
            self.axis = typed(name, props, "axis", str, "v")
            if self.axis not in ("u", "v"):
                raise ValueError(f"{name}: axis: {self.axis!r}: expected 'u' or 'v', the texture coordinate that runs along the fiber")
            self.rotation = math.radians(typed(name, props, "rotation_deg", float, 0.0))
            tensors, document = read_container(_native.fiber_file(filename), filename)
            self.fiber = Fiber(self.kit, tensors, document)
            beta = typed(name, props, "beta_m_rad", float, float(document["beta_m_rad"]))
            if not BETA_M[0] <= beta <= BETA_M[1]:
                raise ValueError(f"{name}: beta_m_rad: {beta}: expected {BETA_M[0]} to {BETA_M[1]}")
            self.beta = self.kit.parameter(beta)
            F = mi.BSDFFlags
            sides = F.FrontSide | F.BackSide | F.Anisotropic | F.NonSymmetric
            components = [F.GlossyReflection | sides, F.GlossyTransmission | sides]
            self.setup(components + [F.Null | sides] if self.width == "wave" else components)

        def traverse(self, callback):
            callback.put("beta_m_rad", self.beta, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys=()):
            check_size("plywave_fiber", "beta_m_rad", self.beta, 1)

        def eval_attribute_1(self, name, si, active=True):
            # In scalar variants it is an array, which Mitsuba does not accept as a number.
            if name == "beta_m_rad" and not self.kit.jit:
                return self.kit.number_of(self.beta)
            return super().eval_attribute_1(name, si, active)

        def variance(self):
            beta = clamp(self.kit.number_of(self.beta), *BETA_M)
            return beta * beta

        def turned(self, si):
            """Cosine and sine of the azimuth of the normal in the frame of the outline."""
            around = si.uv.x if self.axis == "v" else si.uv.y
            sin, cos = dr.sincos(2.0 * math.pi * around + self.rotation)
            return cos, sin

        def to_fiber(self, turn, w):
            """Converts a direction from the shading frame to the fiber's: z along the fiber, x and y those of the
            outline.
            """
            cos, sin = turn
            along, beside = (w.y, w.x) if self.axis == "v" else (-w.x, w.y)
            return [cos * w.z - sin * beside, sin * w.z + cos * beside, along]

        def to_surface(self, turn, w):
            cos, sin = turn
            up, beside = cos * w[0] + sin * w[1], cos * w[1] - sin * w[0]
            return self.kit.Vector3f(beside, w[2], up) if self.axis == "v" else self.kit.Vector3f(-w[2], beside, up)

        def query(self, si):
            """The fiber at a hit, the rotation of its outline, and by wavelength 1 if the ray hits within the effective
            width, else 0.
            """
            turn = self.turned(si)
            wi = self.to_fiber(turn, si.wi)
            at = self.fiber.at(wi, self.lambda_um(si))
            hit = self.kit.S(1.0)
            if self.width == "wave":
                # The hit lies at the curve's radius from the axis, and that radius represents half of the
                # largest width.
                normal = self.to_fiber(turn, self.kit.Vector3f(0.0, 0.0, 1.0))
                x, y = at["azimuth"]
                offset = dr.abs(x * normal[1] - y * normal[0]) * self.fiber.max_width_um
                for k in range(self.kit.count):
                    hit[k] = dr.select(offset <= at["width_um"][k], 1.0, 0.0)
            return at, turn, hit

        def chances(self, at, hit):
            """Sampling weights by wavelength, and those of light that passes beside the fiber."""
            scattered = hit * at["albedo"]
            missed = self.kit.mean(self.kit.S(1.0) - hit)
            total = self.kit.mean(scattered) + missed
            return scattered, missed, dr.select(total > 0.0, 1.0 / dr.maximum(total, 1e-30), 0.0)

        def model_eval(self, si, wo, active):
            kit = self.kit
            at, turn, hit = self.query(si)
            f = hit * self.fiber.eval(at, self.variance(), self.to_fiber(turn, wo))
            _, _, per = self.chances(at, hit)
            pdf = per * kit.mean(f)
            return f, dr.detach(pdf) if kit.jit else pdf

        def model_sample(self, si, u, active):
            kit = self.kit
            at, turn, hit = self.query(si)
            scattered, missed, per = self.chances(at, hit)
            chance = per * missed
            straight = u[0] < chance
            first = dr.minimum((u[0] - chance) / dr.maximum(1.0 - chance, 1e-7), 0.99999994)
            w = self.fiber.draw(at, self.variance(), scattered, [dr.maximum(first, 0.0), u[1], u[2]])
            return self.to_surface(turn, w), straight, kit.S(1.0) - hit, chance

        def eval_null_transmission(self, si, active=True):
            return self.kit.S(1.0) - self.query(si)[2]

        def to_string(self):
            return f"plywave_fiber[largest width = {self.fiber.max_width_um} um]"

    return OneFiber
