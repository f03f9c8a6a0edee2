#!/usr/bin/env python3
"""Draws the pictures of two jacquard cloths: fabrics/cloths/damask.png and textile/tests/data/brocade.png.

A pixel is an end and a row of picks. Shapes are given in centimeters of the cloth, with y upwards, and are painted on
a canvas of 4 x 4 samples a pixel, which repeats in both directions. The color of most samples is that of the pixel.
The same figures are made on each run. Needs Python 3.11 and no packages.

Usage: draft_pictures.py [FOLDER], by default the two folders.
"""
import struct
import sys
import zlib
from collections import Counter
from math import atan2, cos, hypot, pi, sin
from pathlib import Path

SAMPLES = 4


class Canvas:
    """Colors by index on a plane that repeats."""

    def __init__(self, ends, rows, ends_per_cm, rows_per_cm):
        self.size = (ends, rows)
        self.scale = (ends_per_cm * SAMPLES, rows_per_cm * SAMPLES)
        self.width, self.height = ends * SAMPLES, rows * SAMPLES
        self.lines = [bytearray(self.width) for _ in range(self.height)]

    def cm(self):
        return self.width / self.scale[0], self.height / self.scale[1]

    def fill(self, points, color):
        """Fills a polygon by the nonzero rule."""
        xs = [x * self.scale[0] for x, _ in points]
        ys = [y * self.scale[1] for _, y in points]
        for line in range(int(min(ys)) - 1, int(max(ys)) + 2):
            y, hits = line + 0.5, []
            for k in range(len(points)):
                y0, y1 = ys[k - 1], ys[k]
                if (y0 <= y) != (y1 <= y):
                    x = xs[k - 1] + (y - y0) / (y1 - y0) * (xs[k] - xs[k - 1])
                    hits.append((x, 1 if y1 > y0 else -1))
            hits.sort()
            winding, target = 0, self.lines[line % self.height]
            for (x, way), after in zip(hits, hits[1:]):
                winding += way
                if winding:
                    for at in range(round(x), round(after[0])):
                        target[at % self.width] = color

    def pixels(self):
        """`[row][end]` from the top: the most frequent color of each pixel's samples."""
        ends, rows = self.size
        made = []
        for row in reversed(range(rows)):
            lines = self.lines[row * SAMPLES : (row + 1) * SAMPLES]
            spans = [slice(end * SAMPLES, (end + 1) * SAMPLES) for end in range(ends)]
            counts = (Counter(b"".join(line[span] for line in lines)) for span in spans)
            made.append([max(sorted(count), key=count.get) for count in counts])
        return made


def cleaned(pixels, smallest):
    """The picture without spots of fewer pixels than `smallest`; these take the most frequent color around them."""
    rows, ends = len(pixels), len(pixels[0])
    around = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]
    seen = set()
    for start in ((row, end) for row in range(rows) for end in range(ends)):
        if start in seen:
            continue
        color, spot, border = pixels[start[0]][start[1]], {start}, Counter()
        stack = [start]
        while stack:
            y, x = stack.pop()
            for dy, dx in around:
                near = (y + dy) % rows, (x + dx) % ends
                if pixels[near[0]][near[1]] != color:
                    border[pixels[near[0]][near[1]]] += 1
                elif near not in spot:
                    spot.add(near)
                    stack.append(near)
        seen |= spot
        if len(spot) < smallest and border:
            for y, x in spot:
                pixels[y][x] = max(sorted(border), key=border.get)
    return pixels


def write_png(path, pixels, palette):
    """Writes an indexed PNG file of 4 bits a pixel, or of 1 for two colors."""
    bits = 1 if len(palette) <= 2 else 4
    per = 8 // bits
    data = bytearray()
    for row in pixels:
        row = row + [0] * (-len(row) % per)
        data.append(0)
        for at in range(0, len(row), per):
            byte = 0
            for value in row[at : at + per]:
                byte = byte << bits | value
            data.append(byte)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", len(pixels[0]), len(pixels), bits, 3, 0, 0, 0)),
        (b"PLTE", b"".join(bytes.fromhex(color[1:]) for color in palette)),
        (b"IDAT", zlib.compress(bytes(data), 9)),
        (b"IEND", b""),
    ]
    written = b"\x89PNG\r\n\x1a\n"
    for name, body in chunks:
        written += struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    path.write_bytes(written)


def curve(points, steps=24):
    """A smooth line through points (Catmull-Rom)."""
    padded = [points[0], *points, points[-1]]
    line = []
    for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:]):
        for k in range(steps):
            t = k / steps
            weights = (-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2)
            line.append(tuple(sum(w * p[i] for w, p in zip(weights, (a, b, c, d))) / 2 for i in (0, 1)))
    return [*line, points[-1]]


def normals(line):
    found = []
    for k in range(len(line)):
        (x0, y0), (x1, y1) = line[max(k - 1, 0)], line[min(k + 1, len(line) - 1)]
        length = hypot(x1 - x0, y1 - y0) or 1.0
        found.append(((y0 - y1) / length, (x1 - x0) / length))
    return found


def along(line, half):
    """Outline of a line whose half width at 0 to 1 of its points is `half`."""
    last = len(line) - 1
    sides = [(x, y, nx * half(k / last), ny * half(k / last)) for k, ((x, y), (nx, ny)) in enumerate(zip(line, normals(line)))]
    return [(x + dx, y + dy) for x, y, dx, dy in sides] + [(x - dx, y - dy) for x, y, dx, dy in reversed(sides)]


def ellipse(x, y, rx, ry, turn=0.0, count=40):
    c, s = cos(turn), sin(turn)
    ring = [(rx * cos(2 * pi * k / count), ry * sin(2 * pi * k / count)) for k in range(count)]
    return [(x + c * u - s * v, y + s * u + c * v) for u, v in ring]


def drop(x, y, angle, length, width):
    """A petal with its tip at (x, y), which points to `angle`."""
    line = [(x + cos(angle) * length * k / 20, y + sin(angle) * length * k / 20) for k in range(21)]
    return along(line, lambda t: width * sin(pi * t**1.6) ** 0.8)


def acanthus(spine, width, lobes, depth=0.45):
    """Outline of a leaf whose lobes lean towards its tip, and the lines of its veins."""
    line = curve(spine)
    last = len(line) - 1

    def half(t):
        body = width * min(1.0, (t + 0.02) / 0.25) ** 0.6 * (1 - t**2.2) ** 0.7
        phase = (t * lobes) % 1.0
        return body * (1 - depth + depth * sin(pi * phase**0.6) ** 0.7) if t < 0.93 else body

    across = normals(line)
    sides = ([], [])
    for k, ((x, y), (nx, ny)) in enumerate(zip(line, across)):
        reach = half(k / last)
        # A lobe leans forward as far as it stands out.
        fx, fy = ny * reach * 0.55, -nx * reach * 0.55
        sides[0].append((x + nx * reach + fx, y + ny * reach + fy))
        sides[1].append((x - nx * reach + fx, y - ny * reach + fy))
    veins = [line[int(0.04 * last) : int(0.9 * last)]]
    for lobe in range(1, lobes):
        k = int(last * (lobe + 0.05) / lobes)
        tip = min(last, int(last * (lobe + 0.42) / lobes))
        (x, y), (nx, ny), reach = line[k], across[tip], half(tip / last) * 0.62
        for side in (1, -1):
            fx, fy = ny * reach * 0.55, -nx * reach * 0.55
            to = (line[tip][0] + side * nx * reach + fx, line[tip][1] + side * ny * reach + fy)
            veins.append(curve([(x, y), ((x + to[0]) / 2 + side * nx * 0.01, (y + to[1]) / 2 + side * ny * 0.01), to], 8))
    return sides[0] + sides[1][::-1], veins


def mirrored(points):
    return [(-x, y) for x, y in points][::-1]


def damask(canvas):
    """A pomegranate between acanthus leaves in an ogee of pearls, set in half drop: figure 1 on ground 0."""
    width, height = canvas.cm()
    places = [(0.0, 0.0), (width / 2, height / 2)]

    def paint(points, color=1, both=False):
        for dx, dy in places:
            for shape in (points, mirrored(points)) if both else (points,):
                canvas.fill([(x + dx, y + dy) for x, y in shape], color)

    def line(points, half, color=1, both=False):
        paint(along(points, half if callable(half) else lambda t: half), color, both)

    def leaf(spine, wide, lobes, depth, vein=0.02):
        outline, veins = acanthus(spine, wide, lobes, depth)
        # A rim of ground keeps it apart from what lies below.
        line(outline + outline[:1], 0.035, 0, True)
        paint(outline, 1, True)
        for k, one in enumerate(veins if vein > 0 else []):
            line(one, lambda t: vein * (1.25 if k == 0 else 1.0) * (1 - 0.4 * t), 0, True)

    # The ogee: two lines with pearls between them, and leaflets along it on both sides.
    steps = 400
    turns = [2 * pi * k / steps for k in range(steps + 1)]
    edge = [(width / 4 * (1 + (cos(u) - 0.12 * cos(3 * u)) / 0.88), height * u / (2 * pi)) for u in turns]
    across = normals(edge)
    length = [0.0]
    for (x0, y0), (x1, y1) in zip(edge, edge[1:]):
        length.append(length[-1] + hypot(x1 - x0, y1 - y0))

    def at_share(share):
        return min(range(steps + 1), key=lambda k: abs(length[k] - share * length[-1]))

    leaflets = 24
    for n in range(leaflets):
        k = at_share((n + 0.5) / leaflets)
        (x, y), (nx, ny) = edge[k], across[k]
        if min(abs(y - node) for node in (0, height / 2, height)) < 0.36:
            continue
        for side in (1, -1):
            # Leaflets lean towards the crown on either side.
            up = 1 if nx < 0 else -1
            dx, dy = side * nx * 0.75 + up * ny * 0.66, side * ny * 0.75 - up * nx * 0.66
            x0, y0 = x + side * nx * 0.125, y + side * ny * 0.125
            tip = (x0 + dx * 0.18, y0 + dy * 0.18)
            middle = (x0 + dx * 0.09 + side * nx * 0.02, y0 + dy * 0.09 + side * ny * 0.02)
            line(curve([(x0, y0), middle, tip], 8), lambda t: 0.054 * sin(pi * min(1.0, t + 0.1)) ** 0.8, 1, True)
    for half, color in ((0.135, 0), (0.118, 1), (0.07, 0)):
        line(edge, half, color, True)
    pearls = 42
    for n in range(pearls):
        paint(ellipse(*edge[at_share((n + 0.5) / pearls)], 0.046, 0.052), 1, True)

    # Great leaves from the foot, whose tips curl inwards, and plumes within.
    foot = [(0.05, -1.1), (0.2, -0.98), (0.47, -0.76), (0.76, -0.42), (0.92, 0.0), (0.95, 0.36), (0.84, 0.56), (0.7, 0.5)]
    leaf(foot, 0.2, 6, 0.32)
    leaf([(0.05, -0.95), (0.24, -0.82), (0.46, -0.5), (0.57, -0.12), (0.6, 0.2), (0.53, 0.4)], 0.078, 5, 0.35, 0)
    # Over the fruit leaves arch outwards, and bear berries.
    leaf([(0.08, 0.6), (0.18, 0.8), (0.34, 0.9), (0.5, 0.86), (0.57, 0.72), (0.52, 0.64)], 0.092, 4, 0.35, 0)
    for x, y in ((0.8, 0.79), (0.9, 0.71), (0.79, 0.66)):
        paint(ellipse(x, y, 0.058, 0.066), 0, True)
        paint(ellipse(x, y, 0.042, 0.05), 1, True)
    # Sprays with three berries fill the sides.
    for x, y in ((0.42, 0.6), (0.49, 0.51), (0.39, 0.49)):
        paint(ellipse(x, y, 0.05, 0.06), 0, True)
        paint(ellipse(x, y, 0.034, 0.04), 1, True)
    # The crown: a fan of petals.
    for k in (-2, 2, -1, 1, 0):
        angle = pi / 2 + k * 0.33
        size = 0.66 - 0.09 * abs(k)
        paint(drop(0.0, 0.62, angle, size + 0.05, 0.108), 0)
        paint(drop(0.0, 0.64, angle, size, 0.078), 1)
        if k == 0:
            paint(drop(0.0, 0.64 + size * 0.42, angle, size * 0.42, 0.024), 0)

    # The fruit: a net with a dot in each mesh, in a double rim.
    right = curve([(0.0, -0.66), (0.17, -0.58), (0.34, -0.36), (0.4, -0.04), (0.35, 0.28), (0.22, 0.52), (0.0, 0.7)])

    def fruit(by):
        """Its outline with the rim moved inwards."""
        half = [(max(0.0, x * (1 - by / 0.4)), y * (1 - by / 0.68)) for x, y in right]
        return half + [(-x, y) for x, y in half[::-1]]

    for by, color in ((-0.105, 0), (-0.062, 1), (-0.005, 0), (0.045, 1)):
        paint(fruit(by), color)
    limit = fruit(0.11)[: len(right)]
    for i in range(-3, 4):
        for j in range(-6, 7):
            x, y = (i + (j % 2) / 2) * 0.225, j * 0.165 + 0.09
            widest = min(limit, key=lambda p: abs(p[1] - y))[0]
            if abs(x) <= widest and limit[0][1] < y < limit[-1][1]:
                paint([(x, y - 0.133), (x + 0.091, y), (x, y + 0.133), (x - 0.091, y)], 0)
                paint(ellipse(x, y, 0.042, 0.058), 1)

    # A calyx of three leaves holds it.
    for angle, size in ((pi / 2 + 0.8, 0.4), (pi / 2 - 0.8, 0.4), (pi / 2, 0.46)):
        paint(drop(0.0, -0.93, angle, size + 0.06, 0.14), 0)
        paint(drop(0.0, -0.91, angle, size, 0.105), 1)
        paint(drop(0.0, -0.85, angle, size * 0.6, 0.026), 0)

    for angle, size in ((pi / 2 + 0.9, 0.17), (pi / 2 - 0.9, 0.17), (pi / 2, 0.26)):
        paint(drop(0.0, -1.36, angle, size, 0.052), 1)

    # A rosette where ogees meet.
    x, y = 0.0, height / 2
    paint(ellipse(x, y, 0.36, 0.37), 0)
    for k in range(8):
        angle = pi / 8 + k * pi / 4
        paint(ellipse(x + 0.19 * cos(angle), y + 0.19 * sin(angle), 0.125, 0.064, angle), 1)
    for size, color in ((0.115, 0), (0.075, 1)):
        paint(ellipse(x, y, size, size), color)


def brocade(canvas):
    """A sprig of a rose, set in half drop: 0 ground, 1 gold, 2 rose, 3 green."""
    width, height = canvas.cm()
    gold, rose, green = 1, 2, 3

    def place(flip):
        """The second sprig of a repeat is half a repeat apart and turned to the other side."""
        shift = (width / 4, height * 0.25) if not flip else (width * 0.75, height * 0.75)
        return lambda points: [((-x if flip else x) + shift[0], y + shift[1]) for x, y in points]

    for flip in (False, True):
        at = place(flip)

        def paint(points, color):
            canvas.fill(at(points), color)

        def stem(points, half, color=green):
            paint(along(curve(points), lambda t: half * (1 - 0.35 * t)), color)

        def leaf(spine, wide):
            line = curve(spine)
            teeth = lambda t: wide * sin(pi * t**0.8) ** 0.8 * (0.86 + 0.14 * abs(sin(6 * pi * t)))
            paint(along(line, teeth), green)
            paint(along(line[3 : int(len(line) * 0.8)], lambda t: 0.022 * (1 - 0.5 * t)), gold)

        stem([(-0.2, -0.75), (-0.02, -0.45), (0.03, -0.12), (0.0, 0.1)], 0.034)
        stem([(-0.02, -0.45), (0.18, -0.3), (0.36, -0.1), (0.42, 0.1)], 0.028)
        stem([(0.0, -0.35), (-0.2, -0.26), (-0.4, -0.16)], 0.028)
        leaf([(-0.03, -0.5), (-0.2, -0.48), (-0.36, -0.38), (-0.5, -0.4)], 0.1)
        leaf([(-0.12, -0.62), (0.1, -0.64), (0.28, -0.56), (0.46, -0.62)], 0.1)
        leaf([(0.1, -0.36), (0.3, -0.34), (0.44, -0.26), (0.56, -0.28)], 0.075)
        # A bud on each side.
        for x, y, turn in ((0.42, 0.08, -0.35), (-0.4, -0.18, 0.75)):
            tip = lambda angle, size, wide, color: paint(drop(x, y, pi / 2 + angle + turn, size, wide), color)
            tip(0.0, 0.25, 0.085, rose)
            tip(0.28, 0.19, 0.035, green)
            tip(-0.28, 0.19, 0.035, green)
            tip(0.0, 0.13, 0.03, gold)
        # The rose: two rings of petals with gold edges, and a heart of gold.
        x0, y0 = 0.0, 0.36
        for k in range(5):
            angle = pi / 2 + 2 * pi * k / 5
            x, y = x0 + 0.2 * cos(angle), y0 + 0.2 * sin(angle)
            paint(drop(x0 + 0.12 * cos(angle + pi / 5), y0 + 0.12 * sin(angle + pi / 5), angle + pi / 5, 0.33, 0.06), green)
            paint(ellipse(x, y, 0.175, 0.195, angle), gold)
        for k in range(5):
            angle = pi / 2 + 2 * pi * k / 5
            x, y = x0 + 0.2 * cos(angle), y0 + 0.2 * sin(angle)
            paint(ellipse(x, y, 0.142, 0.165, angle), rose)
        for k in range(5):
            angle = pi / 2 + pi / 5 + 2 * pi * k / 5
            x, y = x0 + 0.1 * cos(angle), y0 + 0.1 * sin(angle)
            paint(ellipse(x, y, 0.112, 0.112, angle), gold)
            paint(ellipse(x, y, 0.08, 0.084, angle), rose)
        paint(ellipse(x0, y0, 0.078, 0.084), gold)
        paint(ellipse(x0, y0, 0.036, 0.05), green)
        # A small blossom between the sprigs, over and under it a lozenge.
        x0, y0 = 0.0, height / 2
        for side in (1, -1):
            paint(drop(x0 + side * 0.1, y0 - 0.02, pi / 2 - side * 1.25, 0.24, 0.065), green)
        for k in range(4):
            angle = pi / 4 + k * pi / 2
            paint(ellipse(x0 + 0.095 * cos(angle), y0 + 0.11 * sin(angle), 0.062, 0.068), gold)
        paint(ellipse(x0, y0, 0.06, 0.07), rose)
        for dy in (-0.42, 0.42):
            paint([(x0, y0 + dy - 0.1), (x0 + 0.07, y0 + dy), (x0, y0 + dy + 0.1), (x0 - 0.07, y0 + dy)], gold)


def main():
    root = Path(__file__).resolve().parent.parent
    cloths, tests = [Path(sys.argv[1])] * 2 if len(sys.argv) > 1 else [root / "fabrics/cloths", root / "textile/tests/data"]
    canvas = Canvas(240, 200, 80, 50)
    damask(canvas)
    write_png(cloths / "damask.png", cleaned(canvas.pixels(), 6), ["#ffffff", "#000000"])
    canvas = Canvas(128, 96, 50, 30)
    brocade(canvas)
    write_png(tests / "brocade.png", cleaned(canvas.pixels(), 4), ["#ffffff", "#d0a030", "#c02040", "#208040"])


if __name__ == "__main__":
    main()
