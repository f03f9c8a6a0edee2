"""Formulas in the pages become MathML when the site is built: `$x$` in a line, `$$` around a paragraph of its own.

A hook of mkdocs. Code spans and blocks of code keep their dollars. Browsers draw MathML themselves, so that the site loads
no script.
"""
import re

from latex2mathml.converter import convert

CODE = re.compile(r"(^(?:```|~~~).*?^(?:```|~~~)[^\n]*$|`[^`\n]*`)", re.M | re.S)
DISPLAY = re.compile(r"^\$\$\n(.+?)\n\$\$$", re.M | re.S)
INLINE = re.compile(r"\$(?=\S)([^$\n]+?)(?<=\S)\$")


def on_page_markdown(markdown, **_):
    """The page with its formulas as MathML."""
    parts = CODE.split(markdown)
    for i in range(0, len(parts), 2):
        text = DISPLAY.sub(lambda m: convert(m[1].replace("\n", " "), display="block"), parts[i])
        parts[i] = INLINE.sub(lambda m: convert(m[1]), text)
    return "".join(parts)
