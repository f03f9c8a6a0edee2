"""A square of cloth that falls over a ball and comes to rest on it and on the floor, as a mesh with texture coordinates.

Position-based dynamics with small steps (Macklin et al. 2019), as ``plywave render --setup drape`` has it (render/src/surface/drape.rs), on a coarser sheet.

    python examples/mitsuba/drape.py drape.ply
"""

import sys

import numpy as np

BALL, FLOOR = 0.2, -0.2
RATE, STEPS, GRAVITY, LEFT_A_SECOND, FRICTION, BIAS, BEND = 1500.0, 3000, 4.0, 0.25, 0.45, 40.0, 150.0


def springs(cells):
    """Groups of springs that share no point: ends, length, softness."""
    side, cell = cells + 1, 1.0 / cells
    index = np.arange(side * side).reshape(side, side)
    for di, dj, softness in ((1, 0, 0.0), (0, 1, 0.0), (2, 0, BEND), (0, 2, BEND), (1, 1, BIAS), (1, -1, BIAS)):
        low = max(0, -dj)
        a = index[low : side - max(0, dj), : side - di]
        b = index[low + dj : side + min(0, dj) if dj < 0 else side, di:][: a.shape[0], : a.shape[1]]
        step = max(di, abs(dj))
        along = np.add.outer(np.arange(a.shape[0]) * (di == 0), np.arange(a.shape[1]) * (di > 0)) // step
        for odd in range(2):
            mask = along % 2 == odd
            yield a[mask], b[mask], cell * float(np.hypot(di, dj)), softness


def fallen(cells=64, lift=0.004):
    """Points ``[side, side, 3]`` of a sheet of width 1."""
    side = cells + 1
    groups = list(springs(cells))
    x, y = np.meshgrid(np.arange(side) / cells - 0.5, np.arange(side) / cells - 0.5)
    sin, cos = np.sin(0.35), np.cos(0.35)
    dip = 0.004 * np.sin(9 * x + 2 * y) * np.cos(7 * y)
    p = np.stack([cos * x - sin * y, sin * x + cos * y, BALL + lift + 0.01 + dip], -1).reshape(-1, 3)
    before, dt = p.copy(), 1.0 / RATE
    kept = LEFT_A_SECOND**dt

    def touch(p, before, which, normal, deep):
        p[which] += normal * deep[:, None]
        moved = p[which] - before[which]
        slid = moved - normal * (moved * normal).sum(1, keepdims=True)
        long = np.maximum(np.linalg.norm(slid, axis=1), 1e-12)
        p[which] -= slid * np.minimum(FRICTION * deep / long, 1.0)[:, None]

    for _ in range(STEPS):
        speed = (p - before) * kept
        before = p.copy()
        p += speed
        p[:, 2] -= GRAVITY * dt * dt
        for a, b, length, softness in groups:
            way = p[b] - p[a]
            long = np.maximum(np.sqrt((way * way).sum(1)), 1e-12)
            share = (0.5 * (long - length) / ((1 + softness) * long))[:, None] * way
            p[a] += share
            p[b] -= share
        out = np.linalg.norm(p, axis=1)
        inside = np.flatnonzero(out < BALL + lift)
        if inside.size:
            touch(p, before, inside, p[inside] / out[inside, None], BALL + lift - out[inside])
        below = np.flatnonzero(p[:, 2] < FLOOR + lift)
        if below.size:
            touch(p, before, below, np.array([[0.0, 0.0, 1.0]]).repeat(below.size, 0), FLOOR + lift - p[below, 2])
    return p.reshape(side, side, 3)


def finer(p, times=4):
    """Catmull-Rom between the points."""
    for axis in (0, 1):
        q = np.moveaxis(p, axis, 0)
        n = len(q) - 1
        x = np.linspace(0, n, times * n + 1)
        i = np.minimum(x.astype(int), n - 1)
        u = (x - i).reshape(-1, *[1] * (q.ndim - 1))
        a, b, c, d = (q[np.clip(i + k, 0, n)] for k in (-1, 0, 1, 2))
        q = b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))
        p = np.moveaxis(q, 0, axis)
    return p


def save(path, p):
    """As PLY with normals and uv from 0 to 1."""
    side = p.shape[0]
    du, dv = np.gradient(p, axis=1), np.gradient(p, axis=0)
    n = np.cross(du, dv)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    s, t = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    vertices = np.concatenate([p, n, s[..., None], t[..., None]], -1).reshape(-1, 8).astype("<f4")
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    records = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    records["n"], records["v"] = 3, faces
    names = "x y z nx ny nz u v".split()
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {side * side}", *(f"property float {x}" for x in names)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    with open(path, "wb") as file:
        file.write(("\n".join(head) + "\n").encode() + vertices.tobytes() + records.tobytes())


if __name__ == "__main__":
    save(sys.argv[1] if len(sys.argv) > 1 else "drape.ply", finer(fallen()))
