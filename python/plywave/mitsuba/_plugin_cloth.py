"""The plugin ``plywave_cloth``: positions from uv, colors, light of the plies that a line hits, the mean over the cell,
samples.
"""

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from . import _kernel_calls, _light, _native, _through
from ._base import check_keys, check_lengths, check_size, texture, typed
from ._curves import Curves
from ._far import Far
from ._gaps import Gaps, Slits
from ._kit import Kit, clamp, cross3, detached, dot3
from ._relief import Relief
from ._speckle import Speckle

#: ``BSDFFlags::NeedsDifferentials`` of Mitsuba's bsdf.h, which its Python enumeration lacks.
NEEDS_DIFFERENTIALS = 0x20000
#: Switches and their default values.
SWITCHES = {"layers": True, "shadowing": True, "edges": True, "slits": True, "uneven": True, "relief": True, "speckle": False, "far": False}
YARNS = ("warp_", "weft_")
COLORS = ("color", "sigma_per_um")
KEYS = {"filename", "um_per_uv", "rotation_deg", "to_uv", "footprint_um", "footprint_rad", "footprint_scale", "id", "gaps", "native"}
KEYS |= set(SWITCHES) | {f"{yarn}{what}" for yarn in ("", *YARNS) for what in COLORS}


def define(Calls):
    """Defines the plugin's class for the current variant."""

    class Cloth(Calls):
        """``plywave_cloth``: a cloth on a surface with uv."""

        PLUGIN, ALONG = "plywave_cloth", "along whose u the cloth's x runs"

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            name, kit = self.PLUGIN, Kit()
            self.kit = kit
            check_keys(name, props, KEYS)
            on = {key: typed(name, props, key, bool, default) for key, default in SWITCHES.items()}
            gaps = typed(name, props, "gaps", str, "diffracted")
            if gaps not in ("straight", "diffracted"):
                raise ValueError(f"{name}: gaps: {gaps!r}: expected 'straight' or 'diffracted'")
            filename = typed(name, props, "filename", str, None)
            if filename is None:
                raise ValueError(f"{name}: filename: give a cloth file (.pwc), made with `plywave weave SPEC -o CLOTH.pwc`, or a cloth spec (.toml)")
            self.read_footprint(props, on["far"] or on["relief"] or on["speckle"])
            tables = _native.ClothTables(str(mi.file_resolver().resolve(filename)), gaps == "diffracted", **on)
            self.calls = _kernel_calls.calls_of(kit, tables) if typed(name, props, "native", bool, True) else None
            for note in tables.notes():
                mi.Log(mi.LogLevel.Info, f"{name}: {note}")
            tensors = tables.tensors()
            self.cloth = Curves(kit, tensors)
            self.gaps = Gaps(kit, tensors["apertures"], float(tensors["gap"][1])) if gaps == "diffracted" else None
            self.slits = Slits(kit, tensors["slit_share"], tensors["slits"]) if tensors["slits"].size else None
            self.speckle = Speckle(kit, tensors["noise"]) if on["speckle"] else None
            if self.speckle is not None and not self.speckle.some:
                raise ValueError(f"{name}: speckle: true: no model of the cloth has speckle noise; add it with `plywave noise`")
            relief = Relief(kit, tensors) if on["relief"] else None
            self.relief = relief if relief is not None and relief.some else None
            if on["far"] and "far_f" not in tensors:
                raise ValueError(f"{name}: far: true: the cloth file has no far view: make it anew with `plywave weave`")
            self.far = Far(kit, tensors, self.cloth, self.cloth.along_y) if on["far"] else None
            self.longest_um = max((a * a + b * b) ** 0.5 for a, b in self.cloth.cell)
            self.read_place(props)
            rgb, spectrum = tensors["dye_rgb"], tensors["dye_spectrum"]
            self.dyes, self.is_dyed = kit.parameter(spectrum if kit.spectral else np.pad(rgb, ((0, 0), (0, 1)))), False
            self.own_dyes = np.array(self.dyes)
            self.dye_table, self.dye_count = kit.table_of(self.dyes), len(self.dyes)
            self.read_colors(props)
            F = mi.BSDFFlags
            sides = F.FrontSide | F.BackSide | F.SpatiallyVarying | F.Anisotropic | F.NonSymmetric
            components = [int(part | sides) for part in (F.GlossyReflection, F.GlossyTransmission, F.Null)]
            if on["far"] and self.footprint_um is None and self.footprint_rad is None:
                components = [c | NEEDS_DIFFERENTIALS for c in components]
            self.setup(components)

        def read_footprint(self, props, used):
            """Reads the keys of the far view, of relief and of speckle."""
            name = self.PLUGIN
            footprint = [self.length(props, f"footprint_{key}", used) for key in ("um", "rad", "scale")]
            if self.kit.jit:
                # The values are memory and not constants of the kernel, which other values would recompile.
                footprint = [None if x is None else dr.opaque(mi.Float, x) for x in footprint]
            self.footprint_um, self.footprint_rad, self.footprint_scale = footprint
            if self.footprint_um is not None and self.footprint_rad is not None:
                raise ValueError(f"{name}: footprint_rad: given with footprint_um: give one of them")

        def read_place(self, props):
            """Reads the placement of the pattern in uv."""
            name, kit = self.PLUGIN, self.kit
            scale = props["um_per_uv"] if "um_per_uv" in props else 1e5
            self.um_per_uv = self.pair("um_per_uv", scale)
            if kit.jit:
                dr.make_opaque(self.um_per_uv)
                self.last, self.probe = None, mi.Float(0.0)
                dr.enable_grad(self.probe)
            self.rotation = math.radians(typed(name, props, "rotation_deg", float, 0.0))
            self.turn = (math.cos(self.rotation), math.sin(self.rotation))
            self.to_uv = None
            if "to_uv" in props:
                to_uv = props["to_uv"]
                matrix = getattr(to_uv, "matrix", None)
                if matrix is None:
                    raise ValueError(f"{name}: to_uv: {to_uv!r}: expected a transform")
                m = [[float(_number(matrix[i][j])) for j in range(len(matrix))] for i in range(2)]
                self.to_uv = [[m[i][0], m[i][1], m[i][-1]] for i in range(2)]
                stretch = abs(self.scale_of_uv())
                if not (math.isfinite(stretch) and stretch > 0.0):
                    raise ValueError(f"{name}: to_uv: {self.to_uv}: expected a transform that can be inverted")
            self.turn_directions()

        def read_colors(self, props):
            """Reads the textures of the yarns."""
            name = self.PLUGIN
            self.yarns = YARNS if self.cloth.kinds > 1 else ("",)
            if self.cloth.kinds == 1:
                for key in (f"{yarn}{what}" for yarn in YARNS for what in COLORS):
                    if key in props:
                        raise ValueError(f"{name}: {key}: all yarns of this cloth are alike: use '{key.split('_', 1)[1]}'")
            # A texture belongs to one kind of yarn, or else to all kinds.
            given = [yarn if any(f"{yarn}{what}" in props for what in COLORS) else "" for yarn in self.yarns]
            for yarn in given:
                if f"{yarn}color" in props and f"{yarn}sigma_per_um" in props:
                    raise ValueError(f"{name}: {yarn}color: given with {yarn}sigma_per_um: give one of them")
            made = {key: texture(name, props, key) for yarn in given for key in (f"{yarn}{what}" for what in COLORS)}
            self.textures = {key: value for key, value in made.items() if value is not None}
            self.colors, self.sigmas = ([self.textures.get(f"{yarn}{what}") for yarn in given] for what in COLORS)

        def length(self, props, key, used):
            """A footprint parameter, at least 0."""
            name = self.PLUGIN
            value = typed(name, props, key, float, None)
            if value is None:
                return None
            if not used:
                raise ValueError(f"{name}: {key}: given without far, relief and speckle: set one of them to true")
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}: {key}: {value}: expected a number that is not negative")
            return value

        def pair(self, key, value):
            """Two numbers, or one for both, as a differentiable point."""
            try:
                values = [value, value] if isinstance(value, (int, float)) else [float(_number(v)) for v in value]
            except (TypeError, ValueError):
                values = []
            # Mitsuba parses a text of two numbers as three.
            return mi.Point2f(*check_lengths(self.PLUGIN, key, value, values[:2]))

        def traverse(self, callback):
            callback.put("um_per_uv", self.um_per_uv, mi.ParamFlags.Differentiable | mi.ParamFlags.Discontinuous)
            callback.put("dyes_per_um", self.dyes, mi.ParamFlags.Differentiable)
            for key, value in self.textures.items():
                callback.put(key, value, mi.ParamFlags.Differentiable)

        def parameters_changed(self, keys=()):
            name, kit = self.PLUGIN, self.kit
            if kit.jit:
                dr.make_opaque(self.um_per_uv)
            scales = self.scales()
            check_lengths(name, "um_per_uv", scales, scales)
            check_size(name, "dyes_per_um", self.dyes, self.dye_count)
            self.dye_table = kit.table_of(self.dyes)
            if not keys or "dyes_per_um" in keys:
                self.is_dyed = not np.array_equal(np.array(detached(self.dyes)), self.own_dyes)
            self.turn_directions()

        def scales(self):
            """Lengths of cloth per unit of u and of v [um], as Python numbers."""
            return [float(_number(detached(v))) for v in (self.um_per_uv.x, self.um_per_uv.y)]

        def turn_directions(self):
            """Orientation of the pattern on the surface: the image of u's direction, and whether the pattern is
            mirrored.
            """
            (a, b, _), (c, d, _) = self.to_uv or ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
            x, y = self.scales()
            turn = self.rotation - math.atan2(c * y, a * x)
            self.direction_turn, self.is_mirrored = (math.cos(turn), math.sin(turn)), a * d - b * c < 0.0

        # Inputs of a query

        def place(self, si):
            """Position in the cloth's plane [um]."""
            u, v = si.uv.x, si.uv.y
            if self.to_uv is not None:
                (a, b, c), (d, e, f) = self.to_uv
                u, v = a * u + b * v + c, d * u + e * v + f
            x, y = u * self.um_per_uv.x, v * self.um_per_uv.y
            c, s = self.turn
            return [x * c + y * s, y * c - x * s]

        def to_pattern(self, si, w):
            """Converts a direction from the shading frame to the pattern's frame. The pattern is mirrored where uv is."""
            x, y = w.x, dr.select(self.runs_round(si), -w.y, w.y)
            c, s = self.direction_turn
            return [x * c + y * s, y * c - x * s, w.z]

        def to_surface(self, si, w):
            c, s = self.direction_turn
            x, y = w[0] * c - w[1] * s, w[1] * c + w[0] * s
            return self.kit.Vector3f(x, dr.select(self.runs_round(si), -y, y), w[2])

        def runs_round(self, si):
            """Whether the pattern is mirrored on the surface."""
            handed = dr.dot(dr.cross(si.dp_du, si.dp_dv), si.sh_frame.n)
            return handed > 0.0 if self.is_mirrored else handed < 0.0

        def scale_of_uv(self):
            """Factor by which ``to_uv`` scales areas."""
            if self.to_uv is None:
                return 1.0
            (a, b, _), (c, d, _) = self.to_uv
            return abs(a * d - b * c)

        def footprint(self, si):
            """Diameter of the area of cloth that a query represents [um]: the given footprint; or that of a pixel's
            angle at the length of the ray; or that of the ray differentials, if the mean over the cell needs them;
            else 0. It is the geometric mean of the axes of the footprint's ellipse on the cloth.
            """
            kit, scale = self.kit, 1.0 if self.footprint_scale is None else self.footprint_scale
            footprint = self.footprint_um
            if self.footprint_rad is not None:
                # The ellipse has the axes l and l / cos, where l is the pixel's width at the length of the
                # ray; areas are converted from the surface to the cloth by those of the same piece of uv.
                per_uv = dr.norm(dr.cross(si.dp_du, si.dp_dv)) * dr.maximum(dr.abs(si.wi.z), 1e-3)
                um2_per_uv = dr.abs(self.um_per_uv.x * self.um_per_uv.y) * self.scale_of_uv()
                squared = si.t * si.t * um2_per_uv / dr.maximum(per_uv, 1e-30)
                footprint = self.footprint_rad * dr.sqrt(dr.detach(squared) if kit.jit else squared)
            elif footprint is None and self.far is None:
                footprint = kit.float(0.0)
            elif footprint is None:
                (a, b), (c, d) = ((1.0, 0.0), (0.0, 1.0)) if self.to_uv is None else (row[:2] for row in self.to_uv)
                x, y = ([a * v.x + b * v.y, c * v.x + d * v.y] for v in (si.duv_dx, si.duv_dy))
                area = (x[0] * y[1] - x[1] * y[0]) * self.um_per_uv.x * self.um_per_uv.y
                footprint = dr.sqrt(dr.abs(dr.detach(area) if kit.jit else area))
            return scale * footprint

        def far_share(self, footprint):
            """Weight of the mean over the cell in the result (``ClothModel::far_at``)."""
            kit = self.kit
            t = clamp(footprint * (2.0 / self.longest_um) - 1.0, 0.0, 1.0)
            # NaN counts as no footprint.
            return kit.float(dr.select(t > 0.0, t * t * (3.0 - 2.0 * t), 0.0))

        def sigma_of_color(self, reflectance):
            """Absorptions that give the cloth a color: the inverse of its brightness (src/color/absorption.rs)."""
            kit, out = self.kit, self.kit.zero_s()
            for k in range(kit.count):
                out[k] = self.cloth.sigma_of_brightness(reflectance[k])
            return out

        def dye(self, si, dye):
            kit, out = self.kit, self.kit.zero_s()
            if not kit.spectral:
                values = kit.packets(self.dye_table, dye, 1)
                for k in range(kit.count):
                    out[k] = values[min(k, 2)]
                return out
            for k in range(kit.count):
                x = dr.minimum(dr.maximum((si.wavelengths[k] * 1e-3 - 0.38) * 200.0, 0.0), 80.0)
                node = dr.minimum(dr.floor(x), 79.0)
                at = dye * 81 + kit.uint(node)
                low, high = kit.take(self.dye_table, at), kit.take(self.dye_table, at + 1)
                out[k] = low + (x - node) * (high - low)
            return out

        def mean_at(self, si, own, wo):
            """The mean over the cell seen from ``wo``, with the colors at the point."""
            shares = self.cloth.dye_shares
            dyed = lambda kind: [(share, self.dye(si, self.kit.uint(dye))) for dye, share in shares[kind]]
            return self.far.at(wo, [dyed(kind) if sigma is None else [(1.0, sigma)] for kind, sigma in enumerate(own)], self.gaps)

        def own_sigmas(self, si, active):
            """Absorptions at a point of the kinds of yarns whose yarns all share one absorption."""
            kit, own = self.kit, []
            for kind, (color, sigma) in enumerate(zip(self.colors, self.sigmas)):
                if sigma is not None:
                    own.append(dr.maximum(sigma.eval(si, active), 0.0))
                elif color is not None:
                    own.append(self.sigma_of_color(color.eval(si, active)))
                elif len(self.cloth.dye_shares[kind]) > 1:
                    own.append(None)
                else:
                    own.append(self.dye(si, kit.uint(self.cloth.dye_mean[kind])))
            return own

        def sigma_of(self, si, own, hit, corner):
            """Absorptions of the yarn that a line hits; yarn numbers are relative to the cell ``corner``."""
            sigmas = [self.dye(si, self.cloth.dye_of(kind, hit, corner)) if sigma is None else sigma for kind, sigma in enumerate(own)]
            return sigmas[0] if len(own) == 1 else dr.select(hit["kind"] == 0, *sigmas)

        def slit_of(self, si, hit, at):
            """The slit of a hit ply, for a cloth with slits."""
            return None if self.slits is None else self.slits.at(hit["kind"] == 0, at["is_double"], self.lambda_um(si))

        # Light

        def is_native(self):
            """Whether the library answers: it knows neither gradients nor dyes other than the file's."""
            if self.calls is None or self.is_dyed:
                return False
            # In scopes that suspend gradients too, so that all calls of a picture are answered alike.
            given = [self.um_per_uv, self.dyes, *(value for of in self.textures.values() for _, value in mi.traverse(of))]
            return not any(v.index_ad for v in _through.variables(given))

        def asked(self, si, active):
            """Inputs of the library's queries at a point."""
            own = [detached(sigma) if color is not None or of is not None else None for sigma, color, of in zip(self.own_sigmas(si, active), self.colors, self.sigmas)]
            return self.place(si), self.to_pattern(si, si.wi), self.footprint(si), own, self.lambda_um(si) if self.kit.spectral else None

        walked, chosen_ply, plies_light = _through.walked, _light.chosen_ply, _light.plies_light

        def directions(self, si, *wo):
            """Converts directions from the shading frame to the pattern's frame, without gradients."""
            return [[dr.detach(x) if self.kit.jit else x for x in self.to_pattern(si, w)] for w in wo]

        def model_eval(self, si, wo, active):
            if self.is_native():
                return self.calls.eval_pdf(self.asked(si, active), self.to_pattern(si, wo), active)
            return self.light(si, self.walked(si, active), self.directions(si, wo))[0]

        def light(self, si, at, directions):
            """f and sampling density in each of these directions of the pattern, from the hits of the line and from the
            mean over the cell.
            """
            near = [self.near_light(si, at, b, sums) for b, sums in zip(directions, self.plies_light(si, at, directions))]
            if self.far is None:
                return near
            share, out = at["far_share"], []
            is_far, is_near = share > 0.0, share < 1.0
            for b, (f, pdf) in zip(directions, near):
                mean, density = self.far.eval(at["far"], b, self.lambda_um(si), self.gaps)
                density = dr.detach(density) if self.kit.jit else density
                f = dr.select(is_near, (1.0 - share) * f, 0.0) + dr.select(is_far, share * mean, 0.0)
                out.append((f, dr.select(is_near, (1.0 - share) * pdf, 0.0) + dr.select(is_far, share * density, 0.0)))
            return out

        def near_light(self, si, at, b, sums):
            kit, cloth = self.kit, self.cloth
            f, density = sums
            is_up = b[2] * at["up_sign"] >= 0.0
            if cloth.hairs is not None:
                f = f * cloth.hairs.free(at["hairs"], b) + cloth.hairs.eval(at["hairs"], is_up, b)
            f = f + cloth.inter_yarn_eval(at["about"], at["up"], at["down"], is_up, b)
            pdf = at["per_ply"] * density + cloth.inter_yarn_pdf(at["about"], at["chances"][2:4], is_up, b)
            if cloth.hairs is not None:
                pdf = pdf + dr.select(is_up, *at["chances"][4:]) * (0.5 / math.pi)
            if cloth.plies.some_edge and cloth.options["edges"]:
                main = at["main"]
                theta_i, h, x, z = main["q"][0], main["q"][1], main["q"][2:5], main["q"][5:8]
                v = [dot3(a, b) for a in (x, cross3(z, x), z)]
                light, density = cloth.plies.edge(main["model"], theta_i, h, self.lambda_um(si), v)
                f = f + dr.select(at["is_edge"], at["passing"] * light, kit.zero_s())
                pdf = pdf + dr.select(at["is_edge"], at["chances"][1] * density, 0.0)
            if self.gaps is not None:
                light, density = self.gaps.eval(at["spectra"], at["wo"], self.lambda_um(si), b)
                f = f + dr.select(at["is_aperture"], at["passing"] * light, kit.zero_s())
                pdf = pdf + dr.select(at["is_aperture"], at["chances"][1] * density, 0.0)
            return f, dr.detach(pdf) if kit.jit else pdf

        def model_drawn(self, si, u, active):
            if self.is_native():
                wo, straight, pdf, f = self.calls.sample(self.asked(si, active), u, active)
                return (self.to_surface(si, wo), straight, f, pdf), (f, pdf)
            at = self.walked(si, active, is_last=True)
            with dr.suspend_grad():
                drawn = self.drawn(si, at, u)
            return drawn, self.light(si, at, self.directions(si, drawn[0]))[0]

        def model_both(self, si, wo, u, active):
            if self.is_native():
                return self.model_eval(si, wo, active), *self.model_drawn(si, u, active)
            at = self.walked(si, active, is_last=True)
            with dr.suspend_grad():
                drawn = self.drawn(si, at, u)
            first, second = self.light(si, at, self.directions(si, wo, drawn[0]))
            return first, drawn, second

        def drawn(self, si, at, u):
            """Samples a direction from the hits of the line or from the mean over the cell; also returns whether light
            passes straight through, its energy and its probability.
            """
            if self.far is None:
                b, straight, energy, chance = self.near_drawn(si, at, u)
                return self.to_surface(si, b), straight, energy, chance
            kit, share, mean = self.kit, at["far_share"], at["far"]
            is_far = u[0] < share
            rest = clamp((u[0] - share) / dr.maximum(1.0 - share, 1e-7), 0.0, 0.9999999)
            b, straight, energy, chance = self.near_drawn(si, at, [rest, u[1], u[2]])
            first = dr.minimum(u[0] / dr.maximum(share, 1e-30), 0.9999999)
            w, through = self.far.draw(mean, self.lambda_um(si), self.gaps, [first, u[1], u[2]])
            b = [dr.select(is_far, x, y) for x, y in zip(w, b)]
            straight = dr.select(is_far, kit.both(through, mean["chance"] > 0.0), straight)
            wo = [dr.select(straight, -x, y) for x, y in zip(at["wo"], b)]
            energy, chance = self.passing_of(at), (1.0 - share) * chance + share * mean["chance"]
            return self.to_surface(si, wo), straight, energy, chance

        def passing_of(self, at):
            """Energy of the light that passes straight through."""
            near = dr.select(at["is_edge"] | at["is_aperture"], 0.0, at["passing"])
            if self.far is None:
                return near
            share = at["far_share"]
            return dr.select(share < 1.0, (1.0 - share) * near, 0.0) + share * at["far"]["straight"]

        def near_drawn(self, si, at, u):
            kit, cloth = self.kit, self.cloth
            remaining, found = u[0], kit.bool(False)
            first = []
            for chance in at["chances"]:
                here = kit.both(kit.no(found), remaining < chance)
                first.append((here, dr.minimum(remaining / dr.maximum(chance, 1e-30), 0.9999999)))
                remaining = dr.select(found | here, remaining, remaining - chance)
                found = found | here
            chosen, main = self.chosen_ply(si, at, _another(kit, u)), at["main"]

            def to_cloth(q, w):
                x, z = q[2:5], q[5:8]
                y = cross3(z, x)
                return [x[i] * w[0] + y[i] * w[1] + z[i] * w[2] for i in range(3)]

            theta_i, h = chosen["q"][:2]
            energies = cloth.plies.energies(chosen["model"], theta_i, h)
            sigma = self.sigma_of(si, at["own"], chosen["hit"], at["corner"])
            w = cloth.plies.draw(chosen["model"], theta_i, h, sigma, energies, [first[0][1], u[1], u[2]], False, chosen["slit"])
            b = to_cloth(chosen["q"], w)
            if cloth.plies.some_edge and cloth.options["edges"]:
                q = main["q"]
                w = cloth.plies.edge_draw(main["model"], q[0], q[1], self.lambda_um(si), [first[1][1], u[1], u[2]])
                b = [dr.select(first[1][0], x, y) for x, y in zip(to_cloth(q, w), b)]
            if self.gaps is not None:
                w = self.gaps.draw(at["spectra"], at["wo"], self.lambda_um(si), [first[1][1], u[1], u[2]])
                b = [dr.select(kit.both(first[1][0], at["is_aperture"]), x, y) for x, y in zip(w, b)]
            number = dr.select(first[2][0], first[2][1], first[3][1])
            w = cloth.inter_yarn_draw(at["about"], first[2][0], at["up_sign"], [number, u[1], u[2]])
            b = [dr.select(first[2][0] | first[3][0], x, y) for x, y in zip(w, b)]
            if cloth.hairs is not None:
                (up, _), (down, _) = first[4:]
                w = cloth.hairs.draw(dr.select(up, at["up_sign"], -at["up_sign"]), u[1:])
                b = [dr.select(up | down, x, y) for x, y in zip(w, b)]
            straight = kit.both(kit.no(found), at["straight"] > 0.0)
            b = [dr.select(found, x, -y) for x, y in zip(b, at["wo"])]
            return b, straight, at["passing"], at["straight"]

        def eval_null_transmission(self, si, active=True):
            if self.is_native():
                active = mi.Bool(active)
                return self.kit.S(dr.select(active, self.calls.straight(self.asked(si, active), active), 0.0))
            return self.kit.S(self.passing_of(self.walked(si, active)))

        def to_string(self):
            return f"plywave_cloth[cell = {self.cloth.cell} um, um_per_uv = {self.um_per_uv}]"

    return Cloth


def _number(x):
    """Python number of a scalar or of an array with one element."""
    return x if isinstance(x, (int, float)) else np.asarray(x).ravel()[0]


def _another(kit, u):
    """A random number from the bits of two others."""
    if kit.jit:
        bits = [dr.reinterpret_array(kit.UInt, kit.Float(x)) for x in u[:2]]
        return mi.sample_tea_float32(bits[0], bits[1], 4)
    bits = [int(np.float32(x).view(np.uint32)) for x in u[:2]]
    return float(mi.sample_tea_float32(bits[0], bits[1], 4))
