"""`plywave.swatch`: what it refuses, and that it can be stopped. Fits are tested with the program."""

import struct
import zlib

import plywave
import pytest


def png(path, side):
    """A gray picture of dots."""
    rows = b"".join(b"\0" + bytes(90 if (x + y) % 5 == 0 else 60 for x in range(side)) for y in range(side))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
    return path


def test_bad_pictures_and_words_are_refused(tmp_path):
    front, back = png(tmp_path / "front.png", 96), png(tmp_path / "back.png", 128)
    with pytest.raises(plywave.Error, match="no such file"):
        plywave.swatch(front, tmp_path / "none.png")
    with pytest.raises(plywave.Error, match="96 x 96 and 128 x 128 pixels"):
        plywave.swatch(front, back)
    for words, line in [
        ({"weave": "tweed"}, "swatch: weave = tweed"),
        ({"fiber": "gold"}, "a metal has no absorption to fit"),
        ({"g_per_m2": 9999.0}, "swatch: g_per_m2 = 9999: no cloth has that; give 5 to 2000 g/m2"),
        ({"count": "7 cats"}, "swatch: count = 7 cats"),
    ]:
        with pytest.raises(plywave.Error, match=line):
            plywave.swatch(front, front, **words)


def test_exceptions_of_progress_stop_the_fit(tmp_path):
    front = png(tmp_path / "front.png", 96)

    def fail(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        plywave.swatch(front, front, progress=fail)
