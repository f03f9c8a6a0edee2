"""`Cloth.export`: files that are whole, facts and notes, bad options."""

import json
from pathlib import Path

import plywave
import pytest


CLOTH = Path(__file__).resolve().parents[2] / "fabrics/cloths/organza.toml"


@pytest.fixture(scope="module")
def organza():
    return plywave.Cloth(CLOTH)


def test_a_report_is_written(organza, tmp_path):
    told = organza.export(tmp_path / "o.json", "report", samples=1024, views=[(0.5, 0.0, True)], sigma_uv_per_um=1.0)
    report = json.loads((tmp_path / "o.json").read_text())
    assert told.files == [str(tmp_path / "o.json")] and len(report["rows"]) == 1
    row = report["rows"][0]
    assert 0.0 < row["reflected"]["se"] < 0.05 and row["transmitted"]["value"] > row["straight"]["value"] > 0.2
    assert told.facts["openness"] == report["normal"][0]["openness"]["value"] and report["upf"]["value"] > 1.0


def test_files_of_another_origin_stay(organza, tmp_path):
    options = {"samples": 1024, "views": [(0.0, 0.0, True)]}
    paths = [tmp_path / "o.html", tmp_path / "o.json"]
    assert organza.export(paths, "report", **options).files == [str(path) for path in paths]
    # Its own files are written again.
    organza.export(paths, "report", **options)
    (tmp_path / "o.md").write_text("notes")
    with pytest.raises(plywave.Error, match="o.md.*force"):
        organza.export([tmp_path / "o.csv", tmp_path / "o.md"], "report", **options)
    assert (tmp_path / "o.md").read_text() == "notes" and not (tmp_path / "o.csv").exists()
    organza.export(tmp_path / "o.md", "report", force=True, **options)
    assert "R" in (tmp_path / "o.md").read_text()


def test_what_a_format_leaves_out_is_told(organza, tmp_path):
    told = organza.export(tmp_path / "o.bsdf", "rgl", samples=1024)
    assert told.facts["straight_left_out"] > 0.1 and "left out" in told.notes[0]
    assert (tmp_path / "o.bsdf").read_bytes().startswith(b"tensor_file\0")


@pytest.mark.parametrize("name, to, options, words", [
    ("o.xml", "fbx", {}, "klems"),
    ("o.bsdf", "klems", {}, ".xml"),
    ("o.xml", "tensortree", {"squares": 12}, "8, 16 or 32"),
    ("o.md", "report", {"sigma_ir_per_um": -1.0}, "sigma_ir_per_um"),
])
def test_bad_exports_are_refused(organza, tmp_path, name, to, options, words):
    with pytest.raises(plywave.Error, match=words):
        organza.export(tmp_path / name, to, **options)
    assert list(tmp_path.iterdir()) == []


def test_other_colors_are_refused(organza, tmp_path):
    with pytest.raises(plywave.Error, match="colors of its spec"):
        organza.with_colors(0.0, 0.0).export(tmp_path / "o.xml", "klems")
