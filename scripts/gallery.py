#!/usr/bin/env python3
"""Renders the pictures of the gallery into a folder, with an index of what was rendered how.

    scripts/gallery.py -o out/gallery                      all pictures
    scripts/gallery.py -o out/gallery --only slits,twist   these pictures
    scripts/gallery.py -o out/gallery --quick              small pictures of few samples
    scripts/gallery.py -o out/gallery --dry-run            prints the commands and runs none

The folder gets NAME.png, page/NAME.jpg, the fabrics and models, gallery.json (the index) and gallery.md.
A picture is skipped where its specs, models and flags are those of the index.
Needs Python 3.11, Pillow, and the program: cargo build --release -p plywave-cli.
"""
import argparse
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

try:
    from PIL import Image, ImageDraw, ImageFont
    from PIL.PngImagePlugin import PngInfo
except ImportError:  # --dry-run does without.
    Image = None

ROOT = Path(__file__).resolve().parent.parent
PLYWAVE = ROOT / "target/release/plywave"
FABRICS = (ROOT / "fabrics").resolve()
FONT = ROOT / "cli/fonts/DejaVuSans.ttf"
INDEX = "gallery.json"
MODEL = re.compile(r'^model = "models/(\w+)\.pwm"$', re.MULTILINE)

# Pixels a side of a panel by the number of panels, samples a pixel, most scatterings of a path.
SIDES, SAMPLES, DEPTH = {1: 1024, 2: 640, 3: 480, 4: 400, 5: 320}, 48, 8
QUICK_SIDE, QUICK_SAMPLES = 128, 16
# A fit of preview quality is good enough for a picture, however large its errors are.
BUILD = "--preset preview --max-error-refl 10 --max-error-high 10 --fresh"
QUICK_BUILD = BUILD + " --paths 60000 --instances 4"
# Pixels between panels and below them, color and size of titles; largest JPEG [bytes], qualities to try.
BETWEEN, BELOW, INK, TEXT = 6, 28, (32, 32, 38), 15
PAGE_BYTES, PAGE_QUALITIES = 300_000, (92, 88, 82, 74, 64)


class Panel(NamedTuple):
    """One render of a picture."""
    title: str
    fabric: str
    setup: str
    size_mm: float
    flags: str = ""
    # Stops by which the picture is brighter.
    exposure: float = 0
    # Samples a pixel over the usual.
    samples: int = 1
    # Model of warp and weft, in place of the fabric's own.
    ply: str = ""


# Plies that are built: yarn spec, key of it, and its value.
PLIES = {
    # The outline of cotton, at the size at which as many fibers as circles still pack into the ply.
    "polyester_kidneys": (
        "polyester", "shape", '{ kind = "kidney", a_um = 9.6, b_um = 5.1, dent = 0.35, lumen = 0.5 }'),
    **{f"polyester_pitch_{um}": ("polyester", "fiber_pitch_um", f"{um}.0") for um in (300, 500, 1000, 4000)},
}

# Views of each fabric: name, setup, samples over the usual.
VIEWS = (("close", "swatch", 1), ("front", "front", 1), ("drape", "drape", 1), ("back", "back", 2))
# Of each view: width of the cloth [mm], stops, caption.
CLOTHS = {
    "polyester_satin": (
        (2.2, 0, "Polyester satin, close: floats of the warp over four picks, and the points where a pick binds "
                 "an end. Lamp of half a degree."),
        (10, 0, "Polyester satin: points of binding in five-end satin order, under a small lamp."),
        (400, 0.3, "Polyester satin over a ball, under a large lamp: highlights follow the folds across the warp."),
        (16, -1, "Polyester satin before a lamp: next to no gaps, and those so narrow that they throw the lamp's "
                 "light far to the sides."),
    ),
    "cotton_twill": (
        (4.5, 0.8, "Denim, close: indigo ends of three plies over three white picks of four."),
        (16, 0.8, "Denim: the diagonal of a 3/1 twill."),
        (400, 0.8, "Denim over a ball."),
        (20, 1, "Denim before a lamp: light comes through where picks show between ends."),
    ),
    "silk_organza": (
        (1.6, 0, "Silk organza, close: plain weave of single filament yarns, open between them."),
        (8, 0, "Silk organza in front of the dark."),
        (400, 0.5, "Silk organza over a ball: sheer where one layer hangs, denser where folds overlap and toward "
                   "grazing views."),
        (16, -1.5, "Silk organza before a lamp: yarns scatter across themselves and draw a cross, along warp and "
                   "weft, about the blurred lamp."),
    ),
    "wool_plain": (
        (5, 1.5, "Worsted, close: plain weave of two-ply wool, dyed charcoal."),
        (20, 1.5, "Worsted: plain weave of two-ply wool, dyed charcoal."),
        (400, 1.5, "Worsted over a ball."),
        (20, 0.5, "Worsted before a lamp: dark yarns, so that the gaps alone show."),
    ),
    "cotton_plain": (
        (4, 0, "Bleached muslin, close: plain weave of two-ply cotton."),
        (16, 0, "Bleached muslin: bright and even, with small gaps."),
        (400, 0, "Bleached muslin over a ball."),
        (20, -1, "Bleached muslin before a lamp: the yarns glow as brightly as from the front."),
    ),
}

SATIN, TWILL, ORGANZA = "polyester_satin", "cotton_twill", "silk_organza"
GAPS = ("Before a lamp (Yu 2025, Fig. 14): light that goes straight on through the gaps shows the lamp's outline; "
        "diffracted, it spreads.")
# Comparisons: caption and panels from left to right.
COMPARISONS = {
    "grazing": ("Cloth seen from ten degrees above its plane, against the light: satin, denim, organza.", [
        Panel("satin", SATIN, "grazing", 200, samples=2),
        Panel("denim", TWILL, "grazing", 200, exposure=1, samples=2),
        Panel("organza", ORGANZA, "grazing", 200, exposure=0.5, samples=2)]),
    "layers": (
        "Denim with and without what yarns take of each other's light (Yu 2025, Fig. 13): the layer below, and "
        "yarns beside. Without them, light that they would catch stays in the picture, and the valleys between "
        "yarns are as bright as the crowns.", [
            Panel("all", TWILL, "swatch", 4.5, "--smooth", 0.8),
            Panel("no layer below", TWILL, "swatch", 4.5, "--smooth --without layers", 0.8),
            Panel("no shadowing", TWILL, "swatch", 4.5, "--smooth --without shadowing", 0.8),
            Panel("neither", TWILL, "swatch", 4.5, "--smooth --without layers,shadowing", 0.8)]),
    "gaps_silk_organza": (GAPS, [
        Panel("straight", ORGANZA, "back", 16, "--smooth --straight-gaps", -2, 2),
        Panel("diffracted", ORGANZA, "back", 16, "--smooth", -2, 2)]),
    "gaps_polyester_satin": (GAPS, [
        Panel("straight", SATIN, "back", 16, "--smooth --straight-gaps", -1, 2),
        Panel("diffracted", SATIN, "back", 16, "--smooth", -1, 2)]),
    "slits": (
        "Organza before a lamp, without and with slits of 3 um between the fibers of its yarns, through which a "
        "quarter of the forward light goes (Yu 2025, Fig. 16): the cross turns orange, purple, blue and green "
        "outwards.", [
            Panel("no slits", ORGANZA, "back", 16, "--smooth", -0.5, 2),
            Panel("slits", ORGANZA, "back", 16, "--smooth --slit-um 3 --slit-share 0.25", -0.5, 2)]),
    "noise_close": (
        "A few yarns of the twill under a lamp of half a degree, without and with the speckle of single places on "
        "a ply (Yu 2025, Fig. 15). Polyester's clear round fibers have little of it.", [
            Panel("smooth", TWILL, "swatch", 1.1, "--smooth"), Panel("speckle", TWILL, "swatch", 1.1)]),
    "noise_silk": ("A few yarns of the organza under a lamp of half a degree, without and with speckle.", [
        Panel("smooth", ORGANZA, "swatch", 0.8, "--smooth"), Panel("speckle", ORGANZA, "swatch", 0.8)]),
    "fiber_shapes": (
        "One satin, one absorption of the fibers (0.003 per um): polyester, the same with fibers of cotton's "
        "outline, and cotton.", [
            Panel("circles", SATIN, "drape", 400, "--smooth --sigma 0.003", ply="polyester"),
            Panel("kidneys", SATIN, "drape", 400, "--smooth --sigma 0.003", ply="polyester_kidneys"),
            Panel("cotton", SATIN, "drape", 400, "--smooth --sigma 0.003", ply="cotton")]),
    "twist": ("Satin of plies whose fibers are twisted more and less; pitch in um.", [
        Panel(f"{um} um", SATIN, "drape", 400, "--smooth", ply=f"polyester_pitch_{um}")
        for um in (300, 500, 1000, 4000)]),
    "absorption": ("Satin of fibers that absorb more and more; sigma per um.", [
        Panel(f"{sigma}", SATIN, "drape", 400, f"--smooth --sigma {sigma}")
        for sigma in (0, 0.001, 0.003, 0.01, 0.03)]),
}

PICTURES = {
    f"{fabric}_{view}": (caption, [Panel("", fabric, setup, size_mm, "", exposure, samples)])
    for fabric, shown in CLOTHS.items()
    for (view, setup, samples), (size_mm, exposure, caption) in zip(VIEWS, shown, strict=True)
} | COMPARISONS


def changed_spec(yarn, key, value):
    """Gives the text of a yarn spec with another value of a key."""
    text = (FABRICS / f"{yarn}.toml").read_text(encoding="utf-8")
    text, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
    return text if found == 1 else sys.exit(f"{yarn}.toml: the key {key} is there {found} times, not once")


def strip(images, titles):
    """Puts panels side by side with their titles below."""
    width = sum(image.width + BETWEEN for image in images) - BETWEEN
    height = max(image.height for image in images)
    page = Image.new("RGB", (width, height + BELOW), "white")
    draw, font, x = ImageDraw.Draw(page), ImageFont.truetype(str(FONT), TEXT), 0
    for image, title in zip(images, titles, strict=True):
        page.paste(image, (x, 0))
        draw.text((x + image.width // 2, height + BELOW // 2), title, INK, font, anchor="mm")
        x += image.width + BETWEEN
    return page


def save_jpeg(image, path):
    """Writes a JPEG at the best quality that fits into PAGE_BYTES."""
    for quality in PAGE_QUALITIES:
        image.save(path, quality=quality)
        if path.stat().st_size <= PAGE_BYTES:
            break


class Gallery:
    """A folder with pictures and their index."""

    def __init__(self, folder, quick, dry):
        self.folder, self.quick, self.dry = folder, quick, dry
        self.index = {"models": {}, "pictures": {}}
        if not dry and (folder / INDEX).is_file():
            self.index |= json.loads((folder / INDEX).read_text(encoding="utf-8"))

    def plywave(self, words):
        """Prints a command and runs it in the folder."""
        print(shlex.join(["plywave", *words]), flush=True)
        if not self.dry and (code := subprocess.run([PLYWAVE, *words], cwd=self.folder).returncode):
            sys.exit(code)

    def write(self, name, text):
        """Writes a text into the folder, whole or not at all."""
        if not self.dry:
            part = self.folder / f"{name}.part"
            part.write_text(text, encoding="utf-8")
            os.replace(part, self.folder / name)

    def save(self):
        """Writes the index and the page that shows its pictures, in the gallery's order."""
        known = self.index["pictures"]
        self.index["pictures"] = {name: known[name] for name in PICTURES if name in known}
        self.write(INDEX, json.dumps(self.index, indent=1) + "\n")
        page = "Generated by `scripts/gallery.py`; the commands run in this folder.\n"
        for name, entry in self.index["pictures"].items():
            lines = "\n".join(f"plywave {panel['command']}" for panel in entry["panels"])
            page += f"\n![{name}](page/{name}.jpg)\n\n{entry['caption']}\n\n```sh\n{lines}\n```\n"
        self.write("gallery.md", page)

    def model(self, name):
        """Copies a model that ships, or builds one of PLIES whose spec or flags have changed."""
        file = f"fabrics/models/{name}.pwm"
        if name not in PLIES:
            if not self.dry:
                shutil.copyfile(FABRICS / f"models/{name}.pwm", self.folder / file)
            return
        spec, flags = changed_spec(*PLIES[name]), QUICK_BUILD if self.quick else BUILD
        inputs = hashlib.sha256(f"{flags}\n{spec}".encode()).hexdigest()
        if self.index["models"].get(name) != inputs or not (self.dry or (self.folder / file).is_file()):
            self.write(f"fabrics/{name}.toml", spec)
            self.plywave(["build", f"fabrics/{name}.toml", *flags.split(), "-o", file])
            self.index["models"][name] = inputs
            self.save()

    def cloth(self, fabric, ply):
        """Writes a fabric spec and its models into the folder; gives its path and a digest of all of it."""
        text = (FABRICS / f"{fabric}.toml").read_text(encoding="utf-8")
        models = [ply] if ply else sorted(set(MODEL.findall(text)))
        text, found = MODEL.subn(f'model = "models/{ply}.pwm"' if ply else r"\g<0>", text)
        if not found:
            sys.exit(f"{fabric}.toml: no line of the form {MODEL.pattern}")
        name = f"fabrics/{fabric}_of_{ply}.toml" if ply else f"fabrics/{fabric}.toml"
        self.write(name, text)
        digest = hashlib.sha256(text.encode())
        for model in models:
            self.model(model)
            if not self.dry:
                file = self.folder / f"fabrics/models/{model}.pwm"
                digest.update(hashlib.sha256(file.read_bytes()).digest())
        return name, digest.hexdigest()

    def shot(self, panel, file, panels):
        """Gives what a panel is rendered with: title, command, and digest of its fabric and models."""
        spec, digest = self.cloth(panel.fabric, panel.ply)
        side, samples = (QUICK_SIDE, QUICK_SAMPLES) if self.quick else (SIDES[panels], SAMPLES)
        command = (
            f"render {spec} --setup {panel.setup} --size-mm {panel.size_mm} --width {side} --height {side} "
            f"--samples {samples * panel.samples} --depth {DEPTH} --exposure {panel.exposure} {panel.flags} "
            f"--no-exr -o {file}")
        return {"title": panel.title, "command": " ".join(command.split()), "digest": digest}

    def picture(self, name, caption, panels):
        """Renders a picture unless it is there with the same inputs."""
        files = [f"panels/{name}_{k}.png" for k in range(1, len(panels) + 1)] if panels[1:] else [f"{name}.png"]
        shots = [self.shot(panel, file, len(panels)) for panel, file in zip(panels, files, strict=True)]
        png, jpeg = self.folder / f"{name}.png", self.folder / f"page/{name}.jpg"
        there = self.index["pictures"].pop(name, {}).get("panels") == shots and png.is_file() and jpeg.is_file()
        entry = {"caption": caption, "panels": shots}
        if there:
            print(f"{name}: unchanged")
        else:
            # Until it is whole, the picture is not in the index.
            self.save()
            for shot in shots:
                self.plywave(shot["command"].split())
        if not there and not self.dry:
            self.compose(entry, name, [self.folder / file for file in files])
        self.index["pictures"][name] = entry
        self.save()

    def compose(self, entry, name, files):
        """Makes the PNG of several panels, with the commands as text, and the JPEG of a picture."""
        images = [Image.open(file).convert("RGB") for file in files]
        image = images[0]
        if len(images) > 1:
            image, about = strip(images, [shot["title"] for shot in entry["panels"]]), PngInfo()
            about.add_text("Title", name)
            about.add_text("Description", entry["caption"])
            for k, shot in enumerate(entry["panels"], 1):
                about.add_text(f"panel {k}", f"plywave {shot['command']}")
            image.save(self.folder / f"{name}.png", pnginfo=about)
        save_jpeg(image, self.folder / f"page/{name}.jpg")


def why_refused(folder):
    """Gives why a folder cannot be the output; nothing where it can."""
    if any((folder / part).resolve().is_relative_to(FABRICS) for part in ("", "fabrics", "fabrics/models")):
        return "writes into the fabrics that the gallery reads; name another folder"
    if folder.exists() and not folder.is_dir():
        return "is a file; name a folder"
    if folder.is_dir() and any(folder.iterdir()) and not (folder / INDEX).is_file():
        return f"is a folder without {INDEX}; name another one, or an empty one"
    return ""


def main():
    """Renders the pictures that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write")
    parser.add_argument("--only", metavar="NAME,NAME", help="these pictures only; an unknown name lists all")
    parser.add_argument("--quick", action="store_true", help="small pictures of few samples, rough models")
    parser.add_argument("--dry-run", action="store_true", help="print the commands and run none")
    args = parser.parse_args()
    names = args.only.split(",") if args.only else list(PICTURES)
    if unknown := [name for name in names if name not in PICTURES]:
        parser.error(f"--only {unknown[0]}: use some of {', '.join(PICTURES)}")
    folder = args.output.resolve()
    if refused := why_refused(folder):
        parser.error(f"-o {args.output}: {refused}")
    if not args.dry_run:
        if Image is None or not PLYWAVE.is_file():
            sys.exit("needs Pillow (pip install pillow) and the program (cargo build --release -p plywave-cli)")
        for part in ("fabrics/models", "panels", "page"):
            (folder / part).mkdir(parents=True, exist_ok=True)
    gallery = Gallery(folder, args.quick, args.dry_run)
    gallery.save()
    for name in PICTURES:
        if name in names:
            gallery.picture(name, *PICTURES[name])


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
