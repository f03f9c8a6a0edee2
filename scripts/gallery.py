#!/usr/bin/env python3
"""Renders the pictures of the gallery into a folder, with an index of what was rendered how.

    scripts/gallery.py -o out/gallery                      all pictures
    scripts/gallery.py -o out/gallery --only slits,twist   these pictures
    scripts/gallery.py -o out/gallery --quick              small and rough

The folder gets NAME.png, page/NAME.jpg, the fabrics and models, the index gallery.json, and gallery.md.
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
from pathlib import Path

try:
    from PIL import Image, ImageDraw, ImageFont
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
# Flags of `plywave build`: a fit is good enough for a picture, however large its errors are.
BUILD = "--preset preview --max-error-refl 10 --max-error-high 10 --fresh"
QUICK_BUILD = f"{BUILD} --paths 60000 --instances 4"
# Pixels between panels and below them, color and size of titles; most bytes of a JPEG, qualities to try.
BETWEEN, BELOW, INK, TEXT = 6, 28, (32, 32, 38), 15
PAGE_BYTES, PAGE_QUALITIES = 300_000, (92, 88, 82, 74, 64)

# Plies that are built: yarn spec, key of it, value. As many kidneys as circles still pack into the ply.
KIDNEY = '{ kind = "kidney", a_um = 9.6, b_um = 5.1, dent = 0.35, lumen = 0.5 }'
PLIES = {"polyester_kidneys": ("polyester", "shape", KIDNEY)} | {
    f"polyester_pitch_{um}": ("polyester", "fiber_pitch_um", f"{um}.0") for um in (300, 500, 1000, 4000)}

# Views of a fabric: name, setup, samples over the usual. Of each: width of the cloth [mm], stops, caption.
VIEWS = (("close", "swatch", 1), ("front", "front", 1), ("drape", "drape", 1), ("back", "back", 2))
CLOTHS = {
    "polyester_satin": (
        (2.2, 0, "Polyester satin, close: floats of the warp over four picks, and points where a pick binds an end."),
        (10, 0, "Polyester satin: points of binding in five-end satin order, under a small lamp."),
        (400, 0.3, "Polyester satin over a ball, under a large lamp: highlights follow the folds across the warp."),
        (16, -1, "Polyester satin before a lamp: gaps are few, and so narrow that they throw light to the sides.")),
    "cotton_twill": (
        (4.5, 0.8, "Denim, close: indigo ends of three plies over three white picks of four."),
        (16, 0.8, "Denim: the diagonal of a 3/1 twill."),
        (400, 0.8, "Denim over a ball."),
        (20, 1, "Denim before a lamp: light comes through where picks show between ends.")),
    "silk_organza": (
        (1.6, 0, "Silk organza, close: plain weave of single filament yarns, open between them."),
        (8, 0, "Silk organza in front of the dark."),
        (400, 0.5, "Silk organza over a ball: sheer where one layer hangs, denser at folds and toward grazing views."),
        (16, -1.5, "Silk organza before a lamp: yarns draw a cross, along warp and weft, about the blurred lamp.")),
    "wool_plain": (
        (5, 1.5, "Worsted, close: plain weave of two-ply wool, dyed charcoal."),
        (20, 1.5, "Worsted: plain weave of two-ply wool, dyed charcoal."),
        (400, 1.5, "Worsted over a ball."),
        (20, 0.5, "Worsted before a lamp: dark yarns, so that the gaps alone show.")),
    "cotton_plain": (
        (4, 0, "Bleached muslin, close: plain weave of two-ply cotton."),
        (16, 0, "Bleached muslin: bright and even, with small gaps."),
        (400, 0, "Bleached muslin over a ball."),
        (20, -1, "Bleached muslin before a lamp: the yarns glow as brightly as from the front.")),
}

SATIN, TWILL, ORGANZA = "polyester_satin", "cotton_twill", "silk_organza"
GAPS = "Light before a lamp (Yu 2025, Fig. 14): straight through the gaps it shows the lamp, diffracted it spreads."
# Comparisons: caption, scene, width of the cloth [mm], samples over the usual, and panels from left to right.
# Of each panel: title, cloth, stops, flags. FABRIC_of_PLY is a fabric with another ply for warp and weft.
COMPARISONS = {
    "grazing": (
        "Cloth seen from ten degrees above its plane, against the light: satin, denim, organza.", "grazing", 200, 2,
        [("satin", SATIN, 0, ""), ("denim", TWILL, 1, ""), ("organza", ORGANZA, 0.5, "")]),
    "layers": (
        "Denim with and without what yarns below and beside take of each other's light (Yu 2025, Fig. 13).",
        "swatch", 4.5, 1, [
            ("all", TWILL, 0.8, "--smooth"), ("no layer below", TWILL, 0.8, "--smooth --without layers"),
            ("no shadowing", TWILL, 0.8, "--smooth --without shadowing"),
            ("neither", TWILL, 0.8, "--smooth --without layers,shadowing")]),
    "gaps_silk_organza": (GAPS, "back", 16, 2, [
        ("straight", ORGANZA, -2, "--smooth --straight-gaps"), ("diffracted", ORGANZA, -2, "--smooth")]),
    "gaps_polyester_satin": (GAPS, "back", 16, 2, [
        ("straight", SATIN, -1, "--smooth --straight-gaps"), ("diffracted", SATIN, -1, "--smooth")]),
    "slits": (
        "Organza before a lamp, without and with slits of 3 um between fibers (Yu 2025, Fig. 16).", "back", 16, 2,
        [("no slits", ORGANZA, -0.5, "--smooth"),
         ("slits", ORGANZA, -0.5, "--smooth --slit-um 3 --slit-share 0.25")]),
    "noise_close": (
        "Yarns of the twill under a lamp of half a degree, without and with speckle (Yu 2025, Fig. 15).",
        "swatch", 1.1, 1, [("smooth", TWILL, 0, "--smooth"), ("speckle", TWILL, 0, "")]),
    "noise_silk": (
        "Yarns of the organza under a lamp of half a degree, without and with speckle.",
        "swatch", 0.8, 1, [("smooth", ORGANZA, 0, "--smooth"), ("speckle", ORGANZA, 0, "")]),
    "fiber_shapes": (
        "One satin, one absorption (0.003 per um): circles, fibers of cotton's outline, and cotton.", "drape", 400, 1,
        [(title, f"{SATIN}_of_{ply}", 0, "--smooth --sigma 0.003") for title, ply in (
            ("circles", "polyester"), ("kidneys", "polyester_kidneys"), ("cotton", "cotton"))]),
    "twist": (
        "Satin of plies whose fibers are twisted more and less; pitch in um.", "drape", 400, 1,
        [(f"{um} um", f"{SATIN}_of_polyester_pitch_{um}", 0, "--smooth") for um in (300, 500, 1000, 4000)]),
    "absorption": (
        "Satin of fibers that absorb more and more; sigma per um.", "drape", 400, 1,
        [(f"{sigma}", SATIN, 0, f"--smooth --sigma {sigma}") for sigma in (0, 0.001, 0.003, 0.01, 0.03)]),
}
PICTURES = {
    f"{fabric}_{view}": (caption, setup, size_mm, samples, [("", fabric, stops, "")])
    for fabric, shown in CLOTHS.items()
    for (view, setup, samples), (size_mm, stops, caption) in zip(VIEWS, shown, strict=True)
} | COMPARISONS


def changed_spec(yarn, key, value):
    """Gives the text of a yarn spec with another value of a key."""
    text = (FABRICS / f"{yarn}.toml").read_text(encoding="utf-8")
    text, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
    return text if found == 1 else sys.exit(f"{yarn}.toml: the key {key} is there {found} times, not once")


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
        self.index = {"models": {}, "pictures": {}}
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

    def model(self, name):
        """Copies a model that ships, or builds one of PLIES where its spec or flags changed; gives its bytes."""
        file = self.folder / f"fabrics/models/{name}.pwm"
        if name in PLIES:
            spec, flags = changed_spec(*PLIES[name]), QUICK_BUILD if self.quick else BUILD
            inputs = digest(spec.encode(), flags.encode())
            if self.index["models"].get(name) != inputs or not (self.dry or file.is_file()):
                self.write(f"fabrics/{name}.toml", spec)
                self.plywave(f"build fabrics/{name}.toml {flags} -o fabrics/models/{name}.pwm")
                self.index["models"][name] = inputs
                self.save()
        elif not self.dry:
            shutil.copyfile(FABRICS / f"models/{name}.pwm", file)
        return b"" if self.dry else file.read_bytes()

    def cloth(self, cloth):
        """Puts a fabric spec and its models into the folder; gives a digest of all of it."""
        fabric, _, ply = cloth.partition("_of_")
        text = (FABRICS / f"{fabric}.toml").read_text(encoding="utf-8")
        models = sorted(set(MODEL.findall(text))) or sys.exit(f"{fabric}.toml: no line {MODEL.pattern}")
        if ply:
            models, text = [ply], MODEL.sub(f'model = "models/{ply}.pwm"', text)
        self.write(f"fabrics/{cloth}.toml", text)
        return digest(text.encode(), *map(self.model, models))

    def shots(self, name):
        """Gives what each panel of a picture is rendered with: title, file, command, digest of its inputs."""
        _, setup, size_mm, samples, panels = PICTURES[name]
        side, usual = (QUICK_SIDE, QUICK_SAMPLES) if self.quick else (SIDES[len(panels)], SAMPLES)
        for k, (title, cloth, stops, flags) in enumerate(panels, 1):
            inputs, file = self.cloth(cloth), f"panels/{name}_{k}.png"
            command = (f"render fabrics/{cloth}.toml --setup {setup} --size-mm {size_mm} --width {side}"
                       f" --height {side} --samples {samples * usual} --depth {DEPTH} --exposure {stops}"
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
    if any((folder / part).resolve().is_relative_to(FABRICS) for part in ("", "fabrics", "fabrics/models")):
        return "writes into the fabrics that the gallery reads; name another folder"
    if folder.exists() and not (folder / INDEX).is_file() and (folder.is_file() or any(folder.iterdir())):
        return f"is there, without {INDEX}; name another folder, or an empty one"
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
    if refused := why_refused(args.output.resolve()):
        parser.error(f"-o {args.output}: {refused}")
    if not args.dry_run:
        if Image is None or not PLYWAVE.is_file():
            sys.exit("needs Pillow (pip install pillow) and the program (cargo build --release -p plywave-cli)")
        for part in ("fabrics/models", "panels", "page"):
            (args.output / part).mkdir(parents=True, exist_ok=True)
    gallery = Gallery(args.output.resolve(), args.quick, args.dry_run)
    gallery.save()  # So that the folder is known as a gallery's, and a stopped run can go on in it.
    for name in PICTURES:
        if name in names:
            gallery.picture(name)


if __name__ == "__main__":
    main()
