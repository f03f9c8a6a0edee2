"""Rays through cylinders by vectors: Snell's law and Fresnel's formulas at every hit, in three dimensions.

Nothing here is shared with the models the kit tests: no cross section, no effective index, no lobes.
Directions are [n][3]; the fiber's axis is z; `wi` and `wo` point away from the fiber. Lengths are in radii.
"""
import numpy as np


def dot(a, b):
    return np.einsum("ni,ni->n", a, b)


def fresnel_vector(cos_i, eta):
    """Reflectance of unpolarized light at an index ratio eta (that beyond over that before), 1 where it is total."""
    eta = np.broadcast_to(eta, cos_i.shape)
    sin2_t = (1.0 - cos_i**2) / eta**2
    cos_t = np.sqrt(np.maximum(0.0, 1.0 - sin2_t))
    with np.errstate(invalid="ignore", divide="ignore"):
        rs = ((cos_i - eta * cos_t) / (cos_i + eta * cos_t)) ** 2
        rp = ((eta * cos_i - cos_t) / (eta * cos_i + cos_t)) ** 2
    return np.where(sin2_t >= 1.0, 1.0, np.nan_to_num(0.5 * (rs + rp), nan=1.0))


def fresnel_conductor(cos_i, eta, kappa):
    """Reflectance of a conductor, by complex arithmetic."""
    n = eta + 1j * kappa
    cos_t = np.sqrt(1.0 - (1.0 - cos_i.astype(complex) ** 2) / n**2)
    rs = (cos_i - n * cos_t) / (cos_i + n * cos_t)
    rp = (n * cos_i - cos_t) / (n * cos_i + cos_t)
    return 0.5 * (np.abs(rs) ** 2 + np.abs(rp) ** 2)


def reflect(d, n):
    return d - 2.0 * dot(d, n)[:, None] * n


def refract(d, n, eta):
    """Direction beyond a surface whose normal n faces the light that travels along d."""
    cos_i = -dot(d, n)[:, None]
    cos_t = np.sqrt(np.maximum(0.0, 1.0 - (1.0 - cos_i**2) / eta**2))
    return d / eta + (cos_i / eta - cos_t) * n


def start(theta, phi, h, a, b):
    """Where rays from (theta, phi) at offsets h of half the width first meet an ellipse of half axes a, b.

    Returns points, outward normals and directions of travel. A ray at h > 0 meets a circle at phi + asin h.
    """
    h = np.asarray(h, float)
    width = np.hypot(a * np.sin(phi), b * np.cos(phi))
    d = -np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])
    # On the unit circle x / a, y / b the light comes from one direction too.
    u = np.array([np.cos(phi) / a, np.sin(phi) / b])
    side = np.array([-np.sin(phi) / a, np.cos(phi) / b])
    line = np.outer(h * width, side)
    qa, qb, qc = u @ u, line @ u, np.einsum("ni,ni->n", line, line) - 1.0
    along = (-qb + np.sqrt(np.maximum(0.0, qb**2 - qa * qc))) / qa
    circle = line + along[:, None] * u
    point = np.stack([a * circle[:, 0], b * circle[:, 1], 0.0 * h], axis=1)
    return point, normal_at(point, a, b), np.tile(d, (len(h), 1))


def normal_at(point, a, b):
    n = np.stack([point[:, 0] / a**2, point[:, 1] / b**2, 0.0 * point[:, 0]], axis=1)
    return n / np.linalg.norm(n, axis=1)[:, None]


def across(point, d, a, b):
    """The next hit from inside, and the length of the way there."""
    x, y = point[:, 0] / a, point[:, 1] / b
    dx, dy = d[:, 0] / a, d[:, 1] / b
    length = -2.0 * (x * dx + y * dy) / (dx**2 + dy**2)
    return point + length[:, None] * d, length


def orders(theta, phi, h, eta, count, a=1.0, b=1.0):
    """Light of each order: [(energy at absorption 0, direction of leaving, way inside)] of R, TT, TRT, ...

    The way is in mean diameters 2 sqrt(ab), so that absorption times diameter tau leaves energy * exp(-tau way).
    """
    point, n, d = start(theta, phi, h, a, b)
    f = fresnel_vector(-dot(d, n), eta)
    found = [(f, reflect(d, n), np.zeros(len(f)))]
    energy, way = 1.0 - f, np.zeros(len(f))
    d = refract(d, n, eta)
    for _ in range(1, count):
        point, length = across(point, d, a, b)
        way = way + length / (2.0 * np.sqrt(a * b))
        n = -normal_at(point, a, b)
        f = fresnel_vector(-dot(d, n), 1.0 / eta)
        found.append((energy * (1.0 - f), refract(d, n, 1.0 / eta), way))
        energy, d = energy * f, reflect(d, n)
    return found


# Rough interfaces: the random walk on a Smith surface with GGX slopes and uniform heights, which
# loses no light
# (Heitz, Hanika, d'Eon and Dachsbacher 2016, "Multiple-Scattering Microfacet BSDFs with the Smith Model").


def smith_lambda(w, alpha):
    """Smith's Lambda of GGX for directions above (z > 0) and below."""
    tan2 = np.maximum(0.0, 1.0 - w[:, 2] ** 2) / np.maximum(w[:, 2] ** 2, 1e-18)
    root = np.sqrt(1.0 + alpha**2 * tan2)
    return 0.5 * (-1.0 + np.where(w[:, 2] > 0.0, root, -root))


def visible_normal(w, alpha, rng):
    """A facet's normal as seen from w (Dupuy and Benyoub 2023); w may lie below."""
    stretched = w * np.array([alpha, alpha, 1.0])
    stretched /= np.linalg.norm(stretched, axis=1)[:, None]
    phi = 2.0 * np.pi * rng.random(len(w))
    z = 1.0 - rng.random(len(w)) * (1.0 + stretched[:, 2])
    s = np.sqrt(np.clip(1.0 - z**2, 0.0, 1.0))
    m = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=1) + stretched
    m = m * np.array([alpha, alpha, 1.0])
    return m / np.maximum(np.linalg.norm(m, axis=1), 1e-300)[:, None]


def rough_surface(wi, alpha, eta, rng, max_bounces=200):
    """Directions after a walk on the surface: (w, crossed, bounces). wi is above and points away.

    eta is the index below over that above. Killed after max_bounces: bounces is then max_bounces.
    """
    w = -wi.copy()
    height = np.full(len(w), 1.0 - 1e-9)
    below = np.zeros(len(w), bool)
    bounces = np.zeros(len(w), int)
    active = np.arange(len(w))
    for _ in range(max_bounces):
        flip = np.where(below[active], -1.0, 1.0)
        local = w[active] * np.stack([np.ones(len(active))] * 2 + [flip], axis=1)
        c1 = np.clip(0.5 * (height[active] * flip + 1.0), 1e-12, 1.0)
        lam = smith_lambda(local, alpha)
        u = rng.random(len(active))
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            escape = np.where(local[:, 2] > 0.0, c1**lam, 0.0)
            leaves = (u >= 1.0 - escape) & (local[:, 2] > 0.0)
            c_next = c1 / (1.0 - u) ** (1.0 / lam)
        hit = ~leaves
        index = active[hit]
        if len(index) == 0:
            break
        local, flip = local[hit], flip[hit]
        height[index] = flip * (2.0 * np.clip(c_next[hit], 0.0, 1.0) - 1.0)
        m = visible_normal(-local, alpha, rng)
        ratio = np.where(below[index], 1.0 / eta, eta)
        f = fresnel_vector(np.clip(-dot(local, m), 0.0, 1.0), ratio)
        mirrored = rng.random(len(index)) < f
        after = np.where(mirrored[:, None], reflect(local, m), refract(local, m, ratio[:, None]))
        after /= np.linalg.norm(after, axis=1)[:, None]
        w[index] = after * np.stack([np.ones(len(index))] * 2 + [flip], axis=1)
        below[index] ^= ~mirrored
        bounces[index] += 1
        active = index
    return w, below, bounces


def frame(n):
    """Two tangents of normals across the axis z."""
    t = np.cross(np.array([0.0, 0.0, 1.0]), n)
    return t / np.linalg.norm(t, axis=1)[:, None], np.tile([0.0, 0.0, 1.0], (len(n), 1))


def rough_cylinder(theta, alpha, eta, count, rng, max_orders=60):
    """Rays at random offsets of a rough cylinder: order (0 is R), direction of leaving, way inside [diameters].

    Order max_orders marks rays that were stopped.
    """
    point, n, d = start(theta, 0.0, 2.0 * rng.random(count) - 1.0, 1.0, 1.0)
    order, way, out = np.full(count, max_orders), np.zeros(count), d.copy()
    active, inside = np.arange(count), False
    for k in range(max_orders):
        if len(active) == 0:
            break
        facing = -n if inside else n
        t, s = frame(facing)
        local = np.stack([-dot(d, t), -dot(d, s), -dot(d, facing)], axis=1)
        w, crossed, _ = rough_surface(local, alpha, 1.0 / eta if inside else eta, rng)
        world = w[:, :1] * t + w[:, 1:2] * s + w[:, 2:] * facing
        leaves = crossed if inside else ~crossed
        order[active[leaves]], out[active[leaves]] = k, world[leaves]
        stays = ~leaves
        active, d = active[stays], world[stays]
        point, length = across(point[stays], d, 1.0, 1.0)
        way[active] += 0.5 * length
        n, inside = normal_at(point, 1.0, 1.0), True
    return order, out, way
