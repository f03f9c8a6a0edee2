"""The plugin ``plywave_ply``: a ply model on curves."""

import drjit as dr
import mitsuba as mi

from . import _native
from ._base import check_keys, texture, typed
from ._kit import Kit, cross3, dot3
from ._ply import Plies, read_container


def ply_frame(wi, axis):
    """Axes x, y, z of the ply frame (Yu 2025, Eq. 1) for light from ``wi``, as lists of three, and sine and cosine of
    the angle between ``wi`` and ``axis``.
    """
    x = cross3(wi, axis)
    squared = dot3(x, x)
    along = squared > 1e-10
    # If the ray runs along the ply, any axis across it serves as x.
    other = cross3([axis[1], axis[2], axis[0]], axis)
    x = [dr.select(along, a, b) for a, b in zip(x, other)]
    per = dr.rsqrt(dr.maximum(dot3(x, x), 1e-12))
    x = [a * per for a in x]
    sine = dr.select(along, dr.sqrt(dr.maximum(squared, 0.0)), 1e-5)
    return x, cross3(axis, x), axis, sine, dot3(wi, axis)


def define(Calls):
    """Defines the plugin's class for the current variant."""

    class Ply(Calls):
        """``plywave_ply``: a ply model on a curve or a tube with uv."""

        PLUGIN, ALONG = "plywave_ply", "one of which runs along the ply"
        KEYS = {"filename", "sigma_per_um", "edge", "axis", "id"}

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            name = "plywave_ply"
            check_keys(name, props, self.KEYS)
            self.kit = Kit()
            filename = typed(name, props, "filename", str, None)
            if filename is None:
                raise ValueError(f"{name}: filename: absent: name a ply model (.pwm)")
            filename = mi.file_resolver().resolve(filename)
            self.sigma = texture(name, props, "sigma_per_um", 0.0)
            self.axis = typed(name, props, "axis", str, "v")
            if self.axis not in ("u", "v"):
                raise ValueError(f"{name}: axis: {self.axis!r}: expected 'u' or 'v', the texture coordinate that runs along the ply")
            tensors, _ = read_container(_native.ply_file(str(filename)), str(filename))
            self.plies = Plies(self.kit, [tensors])
            self.h_last = float(tensors["h_um"][-1])
            self.radius = _native.ply_radius_um(str(filename))
            edge = typed(name, props, "edge", bool, True)
            self.is_edge = edge and self.plies.has_edge
            F = mi.BSDFFlags
            sides = F.FrontSide | F.BackSide | F.SpatiallyVarying | F.Anisotropic | F.NonSymmetric
            components = [F.GlossyReflection | sides, F.GlossyTransmission | sides]
            self.setup(components if self.is_edge else components + [F.Null | sides])

        def traverse(self, callback):
            callback.put("sigma_per_um", self.sigma, mi.ParamFlags.Differentiable)

        def query(self, si, active):
            """theta_i, h, sigma and the axes of the ply at a hit."""
            axis = [0.0, 1.0, 0.0] if self.axis == "v" else [1.0, 0.0, 0.0]
            if self.kit.jit:
                axis = [self.kit.Float(a) for a in axis]
            x, y, z, sine, cosine = ply_frame([si.wi.x, si.wi.y, si.wi.z], axis)
            theta_i = dr.atan2(cosine, sine)
            # The hit lies at the distance R from the axis along the normal.
            h = x[2] * (0.99999 * self.radius)
            return theta_i, h, dr.maximum(self.sigma.eval(si, active), 0.0), (x, y, z)

        def unrolled(self, sigma):
            return self.kit.jit and dr.grad_enabled(sigma)

        def terms(self, si, wo, active):
            """f_refl, f_high, f_edge and the sampling density."""
            kit, plies = self.kit, self.plies
            theta_i, h, sigma, frame = self.query(si, active)
            w = [wo.x, wo.y, wo.z]
            v = [dot3(a, w) for a in frame]
            e = plies.energies(0, theta_i, h)
            refl, high, density = plies.lobes(0, theta_i, h, sigma, v, e, self.unrolled(sigma))
            all_high = plies.high_energy(e[2], plies.transmittances(0, sigma))
            total = dr.detach(e[1] + kit.mean(all_high) + e[0]) if kit.jit else e[1] + kit.mean(all_high) + e[0]
            pdf, edge = density / total, kit.zero_s()
            if self.is_edge:
                edge, of_edge = plies.edge(0, theta_i, h, self.lambda_um(si), v)
                edge = edge * e[0]
                pdf = pdf + e[0] / total * of_edge
            return refl, high, edge, pdf

        def model_eval(self, si, wo, active):
            refl, high, edge, pdf = self.terms(si, wo, active)
            return self.kit.S(refl) + high + edge, dr.detach(pdf) if self.kit.jit else pdf

        def model_sample(self, si, u, active):
            kit, plies = self.kit, self.plies
            theta_i, h, sigma, frame = self.query(si, active)
            e = plies.energies(0, theta_i, h)
            scattered = e[1] + kit.mean(plies.high_energy(e[2], plies.transmittances(0, sigma)))
            total = scattered + e[0]
            remaining = u[0] * total
            missed = remaining >= scattered
            first = dr.select(missed, (remaining - scattered) / dr.maximum(e[0], 1e-30), remaining / dr.maximum(scattered, 1e-30))
            first = dr.minimum(first, 0.9999999)
            w = plies.draw(0, theta_i, h, sigma, e, [first, u[1], u[2]], False)
            if self.is_edge:
                of_edge = plies.edge_draw(0, theta_i, h, self.lambda_um(si), [first, u[1], u[2]])
                w = [dr.select(missed, a, b) for a, b in zip(of_edge, w)]
                missed = kit.bool(False)
            wo = [sum(frame[i][k] * w[i] for i in range(3)) for k in range(3)]
            return kit.Vector3f(*wo), missed, e[0], e[0] / total

        def eval_null_transmission(self, si, active=True):
            if self.is_edge:
                return self.kit.zero_s()
            theta_i, h, _, _ = self.query(si, active)
            return self.kit.S(self.plies.r_d(0, theta_i, h))

        def to_string(self):
            return f"plywave_ply[R = {self.radius} um]"

    return Ply
