"""Ply models in Dr.Jit: f_refl + f_high of interpolated lobes, edge light (Yu 2025, Eq. 8 and 18).

The tables are those of the model files (docs/reference/format/models.md) and the formulas those of ``src/ply``: ``grid_cell.rs``, ``interpolate.rs``, ``energy.rs``, ``mixture.rs``, ``edge.rs``,
``exits.rs``; ``_lobes.py`` has a lobe's. The files of several models lie behind each other in the same tables; a number tells them apart at run time, so that a cloth of two kinds of yarns is one piece of code.
"""

import json
import math

import drjit as dr
import numpy as np

from ._kit import clamp
from ._lobes import LOG2_E, MU_MIN, disc_point, disc_share, kind_of, stored_mu, unit_mean

EDGE_MU_MAX = 1e7
MIN_ENERGY, MIN_TRANSMITTANCE = 1e-12, 1e-20
DARK, NARROW_MU = 101.0, 30.0
EXIT_LENGTH_UM, MAX_TAN = 150.0, 6.0

_TYPES = {"F64": "<f8", "F32": "<f4", "U8": "u1", "U64": "<u8", "U32": "<u4"}


def read_container(data, name):
    """Tensors and JSON document of a file in the format of docs/reference/format/models.md."""
    if len(data) < 8:
        raise ValueError(f"{name}: file: {len(data)} bytes: expected a plywave file")
    size = int.from_bytes(data[:8], "little")
    try:
        header = json.loads(data[8 : 8 + size])
        document = json.loads(header.pop("__metadata__")["plywave"])
    except (ValueError, KeyError, UnicodeDecodeError):
        raise ValueError(f"{name}: file: not a plywave file: make one with `plywave build`") from None
    tensors = {}
    for key, info in header.items():
        first, last = (8 + size + o for o in info["data_offsets"])
        tensors[key] = np.frombuffer(data[first:last], _TYPES[info["dtype"]]).reshape(info["shape"])
    return tensors, document


def _extended(a, axis):
    """The array with one more node beyond each end, extrapolated linearly."""
    first, second = (np.take(a, [i], axis) for i in (0, 1))
    last, before = (np.take(a, [i], axis) for i in (-1, -2))
    return np.concatenate([2 * first - second, a, 2 * last - before], axis)


def _bordered(c):
    """Spline coefficients of energies with one more beyond each end (src/ply/data/energies.rs)."""
    c = _extended(c.astype(np.float64), 1)
    # Mirror symmetry at theta_i = 0: c(-theta_i, h) = c(theta_i, -h).
    return np.concatenate([c[1:2, ::-1], c, 2 * c[-1:] - c[-2:-1]], 0)


def _stored(lobes):
    """Lobes with bandwidths stored as log2 sqrt(mu log2 e)."""
    lobes = lobes.astype(np.float64)
    lobes[..., 3:5] = 0.5 * (lobes[..., 3:5] * LOG2_E + math.log2(LOG2_E))
    return lobes


def mirrored(flip, v):
    """A direction of the mirrored incidence where ``flip`` holds."""
    return [dr.select(flip, -v[0], v[0]), v[1], dr.select(flip, -v[2], v[2])]


class Plies:
    """Tables of one or several ply models on the device."""

    def __init__(self, kit, files):
        """Loads ``files``, the tensors of each model from :func:`read_container`."""
        self.kit = kit
        # Tensors of both kinds of lobes have the same name here.
        files = [{"is_cone": float("cone_refl" in f)} | {key.removeprefix("cone_"): value for key, value in f.items()} for f in files]
        self.refl_lobes = max(f["refl"].shape[2] for f in files)
        self.high_lobes = max(f["high"].shape[4] for f in files)
        self.paths = 4 * -(-max(len(f["path_um"]) for f in files) // 4)
        self.has_edge = all("edge_ln_mu" in f for f in files)
        self.some_edge = any("edge_ln_mu" in f for f in files)
        tables = {name: [] for name in ("miss", "shares", "refl", "high", "path", "exits", "edge", "edge_least")}
        starts = {name: 0 for name in tables}
        head = []

        def add(name, values, unit):
            """Appends values to a table; returns the number of units before them."""
            values = np.ascontiguousarray(values, np.float64).ravel()
            at, starts[name] = starts[name], starts[name] + len(values) // unit
            tables[name].append(values)
            return at

        for f in files:
            m, h = len(f["theta_i"]), len(f["h_um"])
            theta_last, h_last = float(f["theta_i"][-1]), float(f["h_um"][-1])
            j, lr, lh = len(f["path_um"]), f["refl"].shape[2], f["high"].shape[4]
            n = {"theta_last": theta_last, "h_last": h_last, "is_cone": f["is_cone"]}
            n |= {"last_t": m - 1, "last_h": h - 1, "per_t": (m - 1) / theta_last, "per_h": (h - 1) / (2 * h_last)}
            for kind in ("miss", "share"):
                rows, columns = len(f[f"{kind}_theta_i"]), len(f[f"{kind}_h_um"])
                n |= {f"{kind}_row": columns + 2, f"{kind}_last_t": rows - 1, f"{kind}_last_h": columns - 1}
                n |= {f"{kind}_per_t": (rows - 1) / theta_last, f"{kind}_per_h": (columns - 1) / (2 * h_last)}
            n["miss_at"] = add("miss", _bordered(f["miss"]), 1)
            # Layout of a node: fractions by path length, then f_refl, in packets of four.
            width = self.paths + 4
            shares = np.zeros((n["share_last_t"] + 3, n["share_last_h"] + 3, width))
            for p in range(j):
                shares[..., p] = _bordered(f["share_high"][..., p])
            shares[..., self.paths] = _bordered(f["share_refl"])
            n["share_at"] = add("shares", shares, 4)
            refl = np.zeros((m + 2, h + 2, self.refl_lobes, 8))
            refl[:, :, :lr, :6] = _extended(_extended(_stored(f["refl"]), 0), 1)
            refl[:, :, :lr, 6] = MIN_ENERGY
            n["refl_at"] = add("refl", refl, 4)
            high = np.zeros(((m - 1) // 2, (h - 1) // 2, 4, self.high_lobes, 8 + self.paths))
            high[:, :, :, :lh, :6] = _stored(f["high"]).reshape(*high.shape[:2], 4, lh, 6)
            high[:, :, :, :lh, 6] = MIN_ENERGY
            high[:, :, :, :lh, 8 : 8 + j] = f["high_path"].reshape(*high.shape[:2], 4, lh, j)
            n["high_at"] = add("high", high, 4)
            path = np.zeros(self.paths)
            path[:j] = -LOG2_E * f["path_um"]
            n["path_at"] = add("path", path, 4)
            n["exits"] = float("exit_offset" in f)
            exits = np.zeros((m, h, 3, 8))
            if n["exits"]:
                exits[..., :5] = f["exit_offset"]
            n["exits_at"] = add("exits", exits, 4)
            n["edge"] = float("edge_ln_mu" in f)
            if n["edge"]:
                lam, inside = f["edge_lambda_um"], f["edge_inside_um"]
                mu = 0.5 * (f["edge_ln_mu"].astype(np.float64) * LOG2_E + math.log2(LOG2_E))
                ls, es = len(lam), len(inside)
                n |= {"edge_radius": float(f["edge_radius_um"][0]), "lam_first": lam[0], "lam_per": (ls - 1) / (lam[-1] - lam[0])}
                n |= {"lam_last": ls - 1, "in_first": inside[0], "in_per": (es - 1) / (inside[-1] - inside[0]), "in_last": es - 1}
                by_e = mu.transpose(1, 0, 2)
                cells = np.stack([np.concatenate([by_e[e, :-1], by_e[e, 1:]], -1) for e in range(es)])
                cells = np.stack([cells[:-1], cells[1:]], 2)
                n["edge_at"] = add("edge", cells, 4)
                least = np.exp2(2 * np.minimum(by_e[:-1], by_e[1:]).min(1))
                n["edge_least_at"] = add("edge_least", least, 2)
            else:
                n |= dict.fromkeys(("edge_radius", "lam_first", "lam_per", "lam_last", "in_first", "in_per", "in_last"), 1.0)
                n |= {"edge_at": 0, "edge_least_at": 0}
            head.append(n)
        for name in ("edge", "edge_least"):
            if not tables[name]:
                tables[name] = [np.zeros(8)]
        self.tables = {name: kit.floats(np.concatenate(values)) for name, values in tables.items()}
        self._same, self._head = {}, {}
        for key in head[0]:
            values = [n[key] for n in head]
            if all(v == values[0] for v in values):
                self._same[key] = values[0]
            else:
                self._head[key] = kit.words(values) if key.endswith(("_at", "_row")) else kit.floats(values)

    def number(self, key, m):
        """A number of model ``m``: a constant if all models have the same number."""
        if key in self._same:
            return self._same[key]
        if key.endswith(("_at", "_row")):
            return self.kit.take_word(self._head[key], m)
        return self.kit.take(self._head[key], m)

    # Energies

    def _taps(self, kind, m, theta, h):
        """First node, and weights along theta_i and along h (src/ply/kernel/grid_cell.rs)."""
        kit = self.kit
        number = lambda key: self.number(f"{kind}_{key}", m)
        t = dr.minimum(theta * number("per_t"), number("last_t"))
        x = clamp((h + self.number("h_last", m)) * number("per_h"), 0.0, number("last_h"))
        row = dr.minimum(dr.floor(t + 0.5), number("last_t"))
        column = dr.minimum(dr.floor(x + 0.5), number("last_h"))

        def spline(f):
            low, high = 0.5 - f, 0.5 + f
            return [0.5 * low * low, 0.75 - f * f, 0.5 * high * high]

        at = kit.uint(row) * number("row") + kit.uint(column)
        return at, spline(t - row), spline(x - column)

    def energies(self, m, theta_i, h_um):
        """r_d, the energy of f_refl, and the path-length spectrum of f_high; they account for beams outside the nodes."""
        kit = self.kit
        flip = theta_i < 0.0
        theta, h = dr.abs(theta_i), dr.select(flip, -h_um, h_um)
        at, wt, wh = self._taps("miss", m, theta, h)
        at += self.number("miss_at", m)
        row = self.number("miss_row", m)
        r_d = 0.0
        for a in range(3):
            r_d += wt[a] * sum(wh[b] * kit.take(self.tables["miss"], at + a * row + b) for b in range(3))
        r_d = clamp(r_d, 0.0, 1.0)
        hit = dr.abs(h_um) <= self.number("h_last", m)
        r_d = dr.select(hit, r_d, 1.0)
        at, wt, wh = self._taps("share", m, theta, h)
        row, packets = self.number("share_row", m), self.paths // 4 + 1
        sums = [0.0] * (4 * packets)
        for a in range(3):
            for b in range(3):
                node = kit.packets(self.tables["shares"], self.number("share_at", m) + (at + a * row + b) * packets, packets)
                w = wt[a] * wh[b]
                sums = [s + w * x for s, x in zip(sums, node)]
        met = 1.0 - r_d
        shares = [dr.maximum(s, 0.0) * met for s in sums]
        return r_d, shares[self.paths], shares[: self.paths]

    def r_d(self, m, theta_i, h_um):
        """The fraction of light that passes a ply."""
        kit = self.kit
        flip = theta_i < 0.0
        theta, h = dr.abs(theta_i), dr.select(flip, -h_um, h_um)
        at, wt, wh = self._taps("miss", m, theta, h)
        at += self.number("miss_at", m)
        row = self.number("miss_row", m)
        r_d = 0.0
        for a in range(3):
            r_d += wt[a] * sum(wh[b] * kit.take(self.tables["miss"], at + a * row + b) for b in range(3))
        return dr.select(dr.abs(h_um) <= self.number("h_last", m), clamp(r_d, 0.0, 1.0), 1.0)

    def transmittances(self, m, sigma):
        """Transmittances of the path lengths, by absorption."""
        path = self.kit.packets(self.tables["path"], self.number("path_at", m), self.paths // 4)
        sigma = clamp(sigma, 0.0, 1e6)
        return [dr.exp2(dr.maximum(sigma * p, -126.0)) + MIN_TRANSMITTANCE for p in path]

    def high_energy(self, spectrum, through):
        return sum(e * t for e, t in zip(spectrum, through))

    # Lobes

    def _cell(self, m, theta_i, h_um):
        """Position of an incidence among the nodes of the lobes: first packets and weights."""
        kit = self.kit
        flip = theta_i < 0.0
        theta, h = dr.abs(theta_i), dr.select(flip, -h_um, h_um)
        last_t, last_h = self.number("last_t", m), self.number("last_h", m)
        t = dr.minimum(theta * self.number("per_t", m), last_t)
        x = clamp((h + self.number("h_last", m)) * self.number("per_h", m), 0.0, last_h)
        row, column = dr.minimum(dr.floor(t), last_t - 1.0), dr.minimum(dr.floor(x), last_h - 1.0)
        ft, fx = t - row, x - column

        def catmull_rom(f):
            f2, f3 = f * f, f * f * f
            return [
                0.5 * (2.0 * f2 - f3 - f),
                0.5 * (3.0 * f3 - 5.0 * f2 + 2.0),
                0.5 * (4.0 * f2 - 3.0 * f3 + f),
                0.5 * (f3 - f2),
            ]

        half_t, half_x = 0.5 * row, 0.5 * column
        bt, bx = dr.floor(half_t), dr.floor(half_x)
        gt, gx = half_t - bt + 0.5 * ft, half_x - bx + 0.5 * fx
        block = [(1 - gt) * (1 - gx), (1 - gt) * gx, gt * (1 - gx), gt * gx]
        columns = kit.uint(last_h) + 3
        at_refl = kit.uint(row) * columns + kit.uint(column)
        at_high = kit.uint(bt) * kit.uint(0.5 * last_h) + kit.uint(bx)
        return {
            "flip": flip,
            "refl": self.number("refl_at", m) + at_refl * (2 * self.refl_lobes),
            "row": columns * (2 * self.refl_lobes),
            "high": self.number("high_at", m) + at_high * (4 * self.high_lobes * (2 + self.paths // 4)),
            "wt": catmull_rom(ft),
            "wx": catmull_rom(fx),
            "block": block,
        }

    def _refl(self, cell, l):
        """Parameters and smallest energy of reflection lobe ``l``."""
        sums = [0.0] * 8
        for a in range(4):
            for b in range(4):
                at = cell["refl"] + a * cell["row"] + (b * self.refl_lobes + l) * 2
                w = cell["wt"][a] * cell["wx"][b]
                sums = [s + w * x for s, x in zip(sums, self.kit.packets(self.tables["refl"], at, 2))]
        return sums

    def _high(self, cell, l):
        """Parameters, smallest energy and path lengths of high-order lobe ``l``."""
        packets = 2 + self.paths // 4
        sums = [0.0] * (4 * packets)
        for c in range(4):
            at = cell["high"] + (c * self.high_lobes + l) * packets
            node = self.kit.packets(self.tables["high"], at, packets)
            sums = [s + cell["block"][c] * x for s, x in zip(sums, node)]
        return sums

    def lobes(self, m, theta_i, h_um, sigma, v, energies, unrolled):
        """f_refl, f_high and the sum of densities of :meth:`lobes_towards` in one direction."""
        ((refl, high, _, density),) = self.lobes_towards(m, theta_i, h_um, sigma, [v], energies, unrolled)
        return refl, high, density

    def lobes_towards(self, m, theta_i, h_um, sigma, directions, energies, unrolled, slit=None):
        """f_refl, f_high and the light of a slit in each of these directions of the ply frame [1/sr], and the sum over
        lobes of mean energy times density there; divided by the mean energy, it is the density of :meth:`draw`.
        ``energies`` come from :meth:`energies`; ``slit`` is a ``Slit`` of ``_gaps.py``.
        """
        kit = self.kit
        cell, lobe = self._cell(m, theta_i, h_um), kind_of(self.number("is_cone", m), theta_i)
        through = self.transmittances(m, sigma)
        towards = [lobe.toward(mirrored(cell["flip"], v)) for v in directions]

        def refl(l, sum_e, sums):
            p = self._refl(cell, l)
            e, frame = dr.maximum(p[5], p[6]), lobe.frame(p)
            lights = (lobe.value(frame, v) for v in towards)
            return sum_e + e, [(sum_g + e * g, sum_d + e * d) for (sum_g, sum_d), (g, d) in zip(sums, lights)]

        zero = kit.float(0.0)
        state = (zero, [(zero, zero) for _ in directions])
        e, of_refl = kit.times(self.refl_lobes, state, refl, unrolled, "reflection lobes")
        scale_refl = energies[1] / e

        def high(l, sum_e, taken, sums):
            p = self._high(cell, l)
            left, frame = sum((x * t for x, t in zip(p[8:], through)), kit.zero_s()) * dr.maximum(p[5], p[6]), lobe.frame(p)
            sum_e = sum_e + left
            if slit is not None:
                part = slit.takes(lobe.forward(frame))
                taken, left = taken + part * left, (1.0 - part) * left
            lights = (lobe.value(frame, v) for v in towards)
            return sum_e, taken, [(sum_g + left * g, sum_d + left * d) for (sum_g, sum_d), (g, d) in zip(sums, lights)]

        zero = kit.zero_s()
        state = (zero, zero, [(zero, zero) for _ in directions])
        e, taken, of_high = kit.times(self.high_lobes, state, high, unrolled, "high-order lobes")
        scale = self.high_energy(energies[2], through) / e
        taken, lights = scale * taken, []
        for v, (a, b), (g, d) in zip(directions, of_refl, of_high):
            light, density = (zero, 0.0) if slit is None else slit.eval(theta_i, v)
            lights.append((scale_refl * a, scale * g, taken * light, scale_refl * b + kit.mean(scale * d) + kit.mean(taken) * density))
        return lights

    def draw(self, m, theta_i, h_um, sigma, energies, u, unrolled, slit=None):
        """Samples a direction of the ply frame from the lobes and from the light that a slit takes from them, with three
        numbers in [0, 1).
        """
        kit = self.kit
        cell = self._cell(m, theta_i, h_um)
        through = self.transmittances(m, sigma)
        high = self.high_energy(energies[2], through) * (1.0 / kit.count)
        total = energies[1] + sum(high[k] for k in range(kit.count))
        left = u[0] * total
        is_refl = left < energies[1]
        remaining = dr.select(is_refl, left, left - energies[1])
        # First the channel is drawn, then one of its lobes: together in proportion to the lobe's mean energy.
        path, found = [t[kit.count - 1] for t in through], kit.bool(False)
        below, of = kit.float(0.0), high[kit.count - 1]
        sum_before = kit.float(0.0)
        for k in range(kit.count - 1):
            here = kit.both(~found if kit.jit else not found, remaining < sum_before + high[k])
            path = [dr.select(here, t[k], p) for t, p in zip(through, path)]
            below, of = dr.select(here, sum_before, below), dr.select(here, high[k], of)
            found = found | here
            sum_before = sum_before + high[k]
        below = dr.select(found, below, sum_before)
        number = dr.select(is_refl, remaining / dr.maximum(energies[1], 1e-30), (remaining - below) / dr.maximum(of, 1e-30))
        number = clamp(number, 0.0, 0.99999994)
        zero = kit.float(0.0)

        def pick(p, weight, sum_w, number, kept):
            sum_w = sum_w + weight
            share = dr.select(sum_w > 0.0, weight / dr.maximum(sum_w, 1e-38), 0.0)
            here = number < share
            number = dr.select(here, number / dr.maximum(share, 1e-38), (number - share) / dr.maximum(1.0 - share, 1e-7))
            kept = [dr.select(here, x, k) for x, k in zip(p[:5], kept)]
            return sum_w, clamp(number, 0.0, 0.99999994), kept

        def refl(l, sum_w, number, kept):
            p = self._refl(cell, l)
            return pick(p, dr.select(is_refl, dr.maximum(p[5], p[6]), 0.0), sum_w, number, kept)

        def of_high(l, sum_w, number, kept):
            p = self._high(cell, l)
            weight = dr.maximum(p[5], p[6]) * sum(x * t for x, t in zip(p[8:], path))
            return pick(p, dr.select(is_refl, 0.0, weight), sum_w, number, kept)

        state = (zero, number, [zero] * 5)
        state = kit.times(self.refl_lobes, state, refl, unrolled, "choice of a reflection lobe")
        _, number, p = kit.times(self.high_lobes, state, of_high, unrolled, "choice of a high-order lobe")
        lobe = kind_of(self.number("is_cone", m), theta_i)
        frame = lobe.frame(p)
        w = mirrored(cell["flip"], lobe.draw(frame, u[1], u[2]))
        if slit is None:
            return w
        part = dr.select(is_refl, 0.0, slit.takes(lobe.forward(frame)))
        of_slit = slit.draw(theta_i, [clamp(number / dr.maximum(part, 1e-30), 0.0, 0.9999999), u[1], u[2]])
        return [dr.select(number < part, a, b) for a, b in zip(of_slit, w)]

    # Light beside the ply

    def _edge_cell(self, m, h_um):
        number = lambda key: self.number(key, m)
        t = clamp((number("edge_radius") - dr.abs(h_um) - number("in_first")) * number("in_per"), 0.0, number("in_last"))
        e = dr.minimum(dr.floor(t), number("in_last") - 1.0)
        return self.kit.uint(e), t - e

    def _edge_widths(self, m, e, fraction, lam):
        kit, number = self.kit, lambda key: self.number(key, m)
        t = clamp((lam - number("lam_first")) * number("lam_per"), 0.0, number("lam_last"))
        l = dr.minimum(dr.floor(t), number("lam_last") - 1.0)
        f = t - l
        at = number("edge_at") + (e * kit.uint(number("lam_last")) + kit.uint(l)) * 2
        c = kit.packets(self.tables["edge"], at, 2)
        row = [c[i] + fraction * (c[4 + i] - c[i]) for i in range(4)]
        bounds = (stored_mu(MU_MIN), stored_mu(EDGE_MU_MAX))
        return [dr.exp2(clamp(row[i] + f * (row[2 + i] - row[i]), *bounds)) for i in range(2)]

    def edge(self, m, theta_i, h_um, lam, v):
        """Edge light of energy 1 by wavelength [1/sr], and the density of :meth:`edge_draw`, for a model with edge
        lobes.
        """
        kit = self.kit
        e, fraction = self._edge_cell(m, h_um)
        s, c = dr.sincos(clamp(theta_i, -0.5 * math.pi, 0.5 * math.pi))
        u, w, cz = v[0], c * v[2] - s * v[1], -c * v[1] - s * v[2]
        at = (self.number("edge_least_at", m) + e) * 2
        least = [kit.take(self.tables["edge_least"], at), kit.take(self.tables["edge_least"], at + 1)]
        lit = kit.both(cz > 0.0, least[0] * u * u + least[1] * w * w < DARK)
        is_close = dr.minimum(least[0], least[1]) >= NARROW_MU
        value, pdf = kit.zero_s(), 0.0
        for k in range(kit.count):
            s1, s2 = self._edge_widths(m, e, fraction, lam[k])
            su, sw = s1 * u, s2 * w
            q = su * su + sw * sw
            shape = dr.select(kit.both(lit, q < 100.0), cz * dr.exp2(-dr.minimum(q, 120.0)), 0.0)
            norm = s1 * s2 * (1.0 / (math.pi * LOG2_E))
            a = (q + 1e-30) / (u * u + w * w + 1e-30)
            value[k] = shape * norm / dr.select(is_close, 1.0, unit_mean(s1 * s1, s2 * s2))
            pdf += shape * norm / dr.select(is_close, 1.0, disc_share(a))
        return value, pdf * (1.0 / kit.count)

    def edge_draw(self, m, theta_i, h_um, lam, u):
        """Samples a direction of edge light; the first number chooses the wavelength."""
        kit = self.kit
        which = kit.uint(dr.minimum(u[0] * kit.count, kit.count - 1.0))
        chosen = lam[0]
        for k in range(1, kit.count):
            chosen = dr.select(which == k, lam[k], chosen)
        e, fraction = self._edge_cell(m, h_um)
        s1, s2 = self._edge_widths(m, e, fraction, chosen)
        x, y, z = disc_point(s1, s2, u[1], u[2])
        s, c = dr.sincos(clamp(theta_i, -0.5 * math.pi, 0.5 * math.pi))
        return [x, -s * y - c * z, c * y - s * z]

    # Exit positions

    def exits(self, m, theta_i, h_um, radius):
        """Coefficients of the mean exit offsets of the three kinds of light, ``[3][5]``, and the tangent of the latitude
        (src/ply/data/exits.rs).
        """
        kit = self.kit
        theta, flip = dr.abs(theta_i), theta_i < 0.0
        h = dr.select(flip, -h_um, h_um)
        last_t, last_h = self.number("last_t", m), self.number("last_h", m)
        t = clamp(theta * self.number("per_t", m), 0.0, last_t)
        x = clamp((h + self.number("h_last", m)) * self.number("per_h", m), 0.0, last_h)
        row, column = dr.minimum(dr.floor(t), last_t - 1.0), dr.minimum(dr.floor(x), last_h - 1.0)
        ft, fx = t - row, x - column
        columns = kit.uint(last_h) + 1
        at = kit.uint(row) * columns + kit.uint(column)
        weights = [(1 - ft) * (1 - fx), (1 - ft) * fx, ft * (1 - fx), ft * fx]
        sums = [0.0] * 24
        for node, w in zip([at, at + 1, at + columns, at + columns + 1], weights):
            values = kit.packets(self.tables["exits"], self.number("exits_at", m) + node * 6, 6)
            sums = [s + w * x for s, x in zip(sums, values)]
        mean = []
        h_rel = clamp(h_um / radius, -1.0, 1.0)
        known = self.number("exits", m) > 0.5
        for k in range(3):
            c = sums[8 * k : 8 * k + 5]
            c = [dr.select(flip, -x, x) if i % 2 == 0 else x for i, x in enumerate(c)]
            none = [0.0, dr.sqrt(dr.maximum(1.0 - h_rel * h_rel, 1e-12)), -h_rel, 0.0, 0.0] if k == 0 else [0.0] * 5
            mean.append([dr.select(known, x, y) for x, y in zip(c, none)])
        s, c = dr.sincos(theta_i)
        return mean, s / dr.maximum(c, 1.0 / MAX_TAN)


def exit_lines(exits, v):
    """(t, s) of the three kinds of light in direction ``v`` of the ply frame."""
    mean, tan_i = exits
    squared = v[0] * v[0] + v[1] * v[1]
    per = dr.select(squared > 1e-8, dr.rsqrt(dr.maximum(squared, 1e-8)), 0.0)
    x, y = v[0] * per, v[1] * per
    terms = [1.0, x, y, x * y, x * x - y * y]
    tan = clamp(v[2] * per, -MAX_TAN, MAX_TAN)
    lines = []
    for c in mean:
        t = clamp(sum(a * b for a, b in zip(c, terms)), -1.0, 1.0)
        px, py = -c[2], c[1]
        lines.append((t, py * tan_i - (px * x + py * y) * tan))
    return lines


def clear_share(sigma):
    return 1.0 / (1.0 + EXIT_LENGTH_UM * clamp(sigma, 0.0, 1e6))
