#!/usr/bin/env python3
"""Renders the pictures of cloths of the gallery into a folder, with an index of what was rendered how.

    scripts/gallery.py -o out/gallery                     all pictures
    scripts/gallery.py -o out/gallery --only slits,gaps   these pictures
    scripts/gallery.py -o out/gallery --quick             small and rough

The folder gets NAME.png, page/NAME.jpg, the cloths with their plies, the index gallery.json, and gallery.md.
A picture is skipped where its specs, models and flags are those of the index, and so is the making of a cloth.
Needs Python 3.11, Pillow, and the program: cargo build --release -p plywave-cli.
"""
import argparse
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

try:
    from PIL import Image, ImageDraw, ImageFont
except ImportError:  # --dry-run does without.
    Image = None

ROOT = Path(__file__).resolve().parent.parent
PLYWAVE = ROOT / "target/release/plywave"
FABRICS = (ROOT / "fabrics").resolve()
FONT = ROOT / "cli/fonts/DejaVuSans.ttf"
CLOTHS = FABRICS / "cloths"
INDEX = "gallery.json"
FIBER = re.compile(r"^fiber = .*$", re.MULTILINE)
# Models of the plies of cloths that are shown with speckle.
PLIES = {"satin": "polyester_bundle"}

# Pixels a side of a panel by the number of panels, samples a pixel, most scatterings of a path.
SIDES, SAMPLES, DEPTH = {1: 1024, 2: 640, 3: 480, 4: 400, 5: 320}, 48, 8
QUICK_SIDE, QUICK_SAMPLES = 128, 16
# Instances of the fiber from which the speckle of a ply is made.
INSTANCES, QUICK_INSTANCES = 200, 8
# Pixels between panels and below them, color and size of titles; most bytes of a JPEG, qualities to try.
BETWEEN, BELOW, INK, TEXT = 6, 28, (32, 32, 38), 15
PAGE_BYTES, PAGE_QUALITIES = 300_000, (92, 88, 82, 74, 64)

# Of a cloth of this ending, the models of its plies get speckle.
SPECKLE = "_speckle"

# Views of a cloth: name, setup, samples over the usual. Of each: width of the cloth [mm], stops (none:
# metered), caption.
VIEWS = (("close", "swatch", 1), ("front", "front", 1), ("drape", "drape", 1), ("back", "back", 2))
SHOWN = {
    "satin": (
        (2.2, 0, "Satin lining, close: floats of the warp over four picks, in bundles of filaments."),
        (10, 0, "Satin lining, flat, under a small lamp."),
        (400, None, "Satin lining over a ball, under a large lamp."),
        (16, -1, "Satin lining before a lamp: no line along the normal passes between its yarns.")),
    "organza": (
        (1.6, 0, "Silk organza, close: open plain weave of two-ply yarns."),
        (8, 0, "Silk organza in front of the dark."),
        (400, None, "Silk organza over a ball: a third of the cloth is open."),
        (16, -1.5, "Silk organza before a lamp: light through its gaps is diffracted.")),
    "jersey": (
        (4, 0, "Jersey, close: knit stitches of a single cotton yarn."),
        (20, 0, "Jersey, flat: columns of knit stitches."),
        (400, None, "Jersey over a ball."),
        (20, -1, "Jersey before a lamp: light comes through between the stitches.")),
    "rib": (
        (4, 0.5, "Rib, close: columns of knit and of purl stitches in turn."),
        (20, 0.5, "Rib, flat."),
        (400, None, "Rib over a ball."),
        (20, -0.5, "Rib before a lamp.")),
    "hopsack": (
        (5, 1, "Hopsack, close: pairs of two-ply woolen yarns in a basket weave."),
        (20, 1, "Hopsack, flat."),
        (400, None, "Hopsack over a ball."),
        (20, 0.5, "Hopsack before a lamp: dark yarns, so that the gaps alone show.")),
}

SATIN, ORGANZA, JERSEY = "satin", "organza", "jersey"
# Comparisons: caption, scene, width of the cloth [mm], samples over the usual, and panels from left to right.
# Of each panel: title, cloth, stops, flags.
COMPARISONS = {
    "grazing": (
        "Cloth seen from ten degrees above its plane, against the light: satin, organza, jersey.", "grazing", 200, 2,
        [("satin", SATIN, 0, ""), ("organza", ORGANZA, 0.5, ""), ("jersey", JERSEY, 0, "")]),
    "layers": (
        "Jersey with and without what plies below and beside take of each other's light (Yu 2025, Fig. 13).",
        "swatch", 4, 1, [
            ("all", JERSEY, 0, "--smooth"), ("no layer below", JERSEY, 0, "--smooth --without layers"),
            ("no shadowing", JERSEY, 0, "--smooth --without shadowing"),
            ("neither", JERSEY, 0, "--smooth --without layers,shadowing")]),
    "gaps": (
        "Light through the gaps of organza before a lamp (Yu 2025, Fig. 14), straight on and diffracted.", "back",
        16, 2, [("straight", ORGANZA, -2, "--smooth --straight-gaps"), ("diffracted", ORGANZA, -2, "--smooth")]),
    "slits": (
        "Organza before a lamp, without and with slits of 3 um between fibers (Yu 2025, Fig. 16).", "back", 16, 2,
        [("no slits", ORGANZA, -0.5, "--smooth"),
         ("slits", ORGANZA, -0.5, "--smooth --slit-um 3 --slit-share 0.25")]),
    "speckle": (
        "Bundles of the satin under a lamp of half a degree, without and with speckle (Yu 2025, Fig. 15).",
        "swatch", 0.8, 1, [("smooth", SATIN + SPECKLE, 0, "--smooth"), ("speckle", SATIN + SPECKLE, 0, "")]),
}
# Scenes of a shop: name, setup, cloth, samples over the usual, caption.
SHOP = (
    ("curtain", "curtain", ORGANZA, 1, "Silk organza before a bright window."),
    ("folded", "folded", "denim", 1, "Denim, three folded sheets on each other."),
    ("ball", "ball", JERSEY, 1, "Jersey drawn around a ball."))
PICTURES = {
    f"{cloth}_{view}": (caption, setup, size_mm, samples, [("", cloth, stops, "")])
    for cloth, shown in SHOWN.items()
    for (view, setup, samples), (size_mm, stops, caption) in zip(VIEWS, shown, strict=True)
} | COMPARISONS | {
    f"shop_{name}": (caption, setup, None, samples, [("", cloth, None, "")])
    for name, setup, cloth, samples, caption in SHOP
}


def digest(*parts):
    """Gives one hash of several byte strings."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()


def strip(images, titles):
    """Puts panels side by side, with titles below where there are several."""
    if len(images) == 1:
        return images[0]
    (width, height), x = images[0].size, 0
    page = Image.new("RGB", (len(images) * (width + BETWEEN) - BETWEEN, height + BELOW), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.truetype(str(FONT), TEXT)
    for image, title in zip(images, titles, strict=True):
        page.paste(image, (x, 0))
        draw.text((x + width // 2, height + BELOW // 2), title, INK, font, anchor="mm")
        x += width + BETWEEN
    return page


def save_jpeg(image, path):
    """Writes a JPEG at the best quality that fits into PAGE_BYTES."""
    for quality in PAGE_QUALITIES:
        image.save(path, quality=quality)
        if path.stat().st_size <= PAGE_BYTES:
            break


class Gallery:
    """A folder of pictures with its index; a dry one prints commands and leaves the disk alone."""

    def __init__(self, folder, quick, dry):
        self.folder, self.quick, self.dry = folder, quick, dry
        self.instances = QUICK_INSTANCES if quick else INSTANCES
        # The cloths that were looked at, by name.
        self.index, self.ready = {"cloths": {}, "pictures": {}}, {}
        if not dry and (folder / INDEX).is_file():
            self.index |= json.loads((folder / INDEX).read_text(encoding="utf-8"))

    def plywave(self, command):
        """Prints a command and runs it in the folder."""
        print(f"plywave {command}", flush=True)
        if not self.dry and (code := subprocess.run([PLYWAVE, *shlex.split(command)], cwd=self.folder).returncode):
            sys.exit(code)

    def write(self, name, text):
        """Writes a text into the folder, whole or not at all."""
        if not self.dry:
            part = self.folder / f"{name}.part"
            part.write_text(text, encoding="utf-8")
            os.replace(part, self.folder / name)

    def save(self):
        """Writes the index, and the page that shows its pictures in the gallery's order."""
        known = self.index["pictures"]
        self.index["pictures"] = {name: known[name] for name in PICTURES if name in known}
        page = "Generated by `scripts/gallery.py`; the commands run in this folder.\n"
        for name, entry in self.index["pictures"].items():
            lines = "\n".join(f"plywave {panel['command']}" for panel in entry["panels"])
            page += f"\n![{name}](page/{name}.jpg)\n\n{entry['caption']}\n\n```sh\n{lines}\n```\n"
        self.write(INDEX, json.dumps(self.index, indent=1) + "\n")
        self.write("gallery.md", page)

    def speckle(self, name):
        """Makes the model of the ply of a cloth with speckle; gives its path beside the cloth's spec."""
        ply = f"plies/{PLIES[name]}"
        self.plywave(f"wave speckle cloths/{name}.toml --instances {self.instances} --fresh -o cloths/{ply}.pws")
        self.plywave(f"noise cloths/{ply}.pws -m {PLIES[name]} -o cloths/{ply}{SPECKLE}.pwm")

    def cloth(self, cloth):
        """Makes a cloth file in the folder, unless it is there with the same inputs; gives their digest."""
        if cloth in self.ready:
            return self.ready[cloth]
        name, has_speckle = cloth.removesuffix(SPECKLE), cloth.endswith(SPECKLE)
        text = (CLOTHS / f"{name}.toml").read_text(encoding="utf-8")
        own = text
        if has_speckle:
            if name not in PLIES:
                sys.exit(f"{name}: not among the cloths that are shown with speckle")
            text = FIBER.sub(rf'\g<0>\nmodel = "plies/{PLIES[name]}{SPECKLE}.pwm"', text)
        made_of = [text.encode(), (FABRICS / "models/plies.json").read_bytes(), str(self.instances if has_speckle else 0).encode()]
        inputs, file = digest(*made_of), f"cloths/{cloth}.pwc"
        if self.index["cloths"].get(cloth) != inputs or not (self.dry or (self.folder / file).is_file()):
            self.write(f"cloths/{cloth}.toml", text)
            if has_speckle:
                self.write(f"cloths/{name}.toml", own)
                self.speckle(name)
            self.plywave(f"weave cloths/{cloth}.toml -o {file}")
            self.index["cloths"][cloth] = inputs
            self.save()
        self.ready[cloth] = inputs
        return inputs

    def shots(self, name):
        """Gives what each panel of a picture is rendered with: title, file, command, digest of its inputs."""
        _, setup, size_mm, samples, panels = PICTURES[name]
        side, usual = (QUICK_SIDE, QUICK_SAMPLES) if self.quick else (SIDES[len(panels)], SAMPLES)
        for k, (title, cloth, stops, flags) in enumerate(panels, 1):
            inputs, file = self.cloth(cloth), f"panels/{name}_{k}.png"
            size = f"--size-mm {size_mm}" if size_mm else ""
            exposure = "" if stops is None else f"--exposure {stops}"
            command = (f"render cloths/{cloth}.pwc --setup {setup} {size} --width {side}"
                       f" --height {side} --samples {samples * usual} --depth {DEPTH} {exposure}"
                       f" {flags} --no-exr -o {file}")
            yield {"title": title, "file": file, "command": " ".join(command.split()), "digest": inputs}

    def picture(self, name):
        """Renders a picture, unless it is there with the same inputs."""
        shots = list(self.shots(name))
        png, jpeg = self.folder / f"{name}.png", self.folder / f"page/{name}.jpg"
        if self.index["pictures"].pop(name, {}).get("panels") == shots and png.is_file() and jpeg.is_file():
            print(f"{name}: unchanged")
        else:
            self.save()  # Without this picture, until it is whole.
            for shot in shots:
                self.plywave(shot["command"])
            if not self.dry:
                images = [Image.open(self.folder / shot["file"]).convert("RGB") for shot in shots]
                image = strip(images, [shot["title"] for shot in shots])
                image.save(png)
                save_jpeg(image, jpeg)
        self.index["pictures"][name] = {"caption": PICTURES[name][0], "panels": shots}
        self.save()


def why_refused(folder):
    """Gives why a folder cannot be the output; nothing where it can."""
    if any((folder / part).resolve().is_relative_to(FABRICS) for part in ("", "cloths", "cloths/plies")):
        return "writes into the specs that the gallery reads; name another folder"
    if folder.exists() and not (folder / INDEX).is_file() and (folder.is_file() or any(folder.iterdir())):
        return f"is there, without {INDEX}; name another folder, or an empty one"
    return ""


def main():
    """Renders the pictures that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write")
    parser.add_argument("--only", metavar="NAME,NAME", help="these pictures only; an unknown name lists all")
    parser.add_argument("--quick", action="store_true", help="small pictures of few samples")
    parser.add_argument("--dry-run", action="store_true", help="print the commands and run none")
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(PICTURES)
    if unknown := [name for name in names if name not in PICTURES]:
        parser.error(f"--only {unknown[0]}: use some of {', '.join(PICTURES)}")
    if refused := why_refused(args.output.resolve()):
        parser.error(f"-o {args.output}: {refused}")
    if not args.dry_run:
        if Image is None or not PLYWAVE.is_file():
            sys.exit("needs Pillow (pip install pillow) and the program (cargo build --release -p plywave-cli)")
        for part in ("cloths/plies", "panels", "page"):
            (args.output / part).mkdir(parents=True, exist_ok=True)
    gallery = Gallery(args.output.resolve(), args.quick, args.dry_run)
    gallery.save()  # So that the folder is known as a gallery's, and a stopped run can go on in it.
    for name in PICTURES:
        if name in names:
            gallery.picture(name)


if __name__ == "__main__":
    main()
