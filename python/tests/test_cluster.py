"""The farm: the same bits as one machine, whatever dies or comes back damaged; nothing computed twice; bad input in one line."""

import base64
import contextlib
import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import zlib

import numpy as np
import pytest

import plywave
from plywave import Error

pytest.importorskip("distributed")
from plywave import cluster
from plywave import _plywave
from plywave.cluster import _farm, _items, _local, _workers

from conftest import TINY as SPEC
from soak_cluster import Killer

SMALL = {"quality": "preview", "paths": 6000, "instances": 2}


@pytest.fixture(scope="module")
def model():
    """What one machine makes."""
    return plywave.build(SPEC, **SMALL).to_bytes()


@pytest.fixture(scope="module")
def client():
    with cluster.connect(local=2) as client:
        yield client


@pytest.fixture(scope="module")
def inside():
    """Workers in this process, whose functions tests can change."""
    from distributed import Client

    with Client(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as client:
        yield client


def items():
    return [cluster.yarn_item(SPEC, name="tiny", **SMALL)]


class NoClient:
    """Fails whatever is asked of it."""

    def nthreads(self):
        return {"a": 1}

    def submit(self, *_, **__):
        raise AssertionError("something was computed")

    scatter = submit


def test_same_bits_and_nothing_twice(client, model, tmp_path):
    cache = cluster.Cache(tmp_path)
    told = []
    made = list(_farm.farm(items(), client, cache, told=lambda *args: told.append(args)))
    assert [one.data for one in made] == [model] and made[0].error == ""
    jobs = items()[0].jobs
    assert told[-1] == ("tiny", sum(job.shards for job in jobs), sum(job.shards for job in jobs))
    assert not made[0].facts["cached"] and made[0].facts["shards"] == told[-1][2]
    # A second farm on the cache asks nobody for anything.
    again = list(_farm.farm(items(), NoClient(), cluster.Cache(tmp_path)))
    assert [one.data for one in again] == [model] and again[0].facts["cached"]
    # Nor are shards of a changed yarn those of the first.
    other = cluster.yarn_item(SPEC.replace("radius_um", "radius_um ", 1), name="tiny", **SMALL)
    assert other.key != items()[0].key and cluster.Cache(tmp_path).shards(other.jobs[0]) == []


def test_shards_alone_are_enough(client, model, tmp_path):
    """What a farm that was stopped leaves is not computed again."""
    cache = cluster.Cache(tmp_path)
    list(_farm.farm(items(), client, cache))
    for name in os.listdir(tmp_path / "made"):
        os.remove(tmp_path / "made" / name)
    made = list(_farm.farm(items(), client, cache))
    assert made[0].data == model and made[0].facts["shards"] == 0


def test_damaged_caches_are_mended(client, model, tmp_path):
    list(_farm.farm(items(), client, cluster.Cache(tmp_path)))
    job = items()[0].jobs[0]
    folder = tmp_path / "shards" / job.digest[:2] / job.digest
    names = sorted(os.listdir(folder))
    flipped, cut = folder / names[1], folder / names[2]
    data = bytearray(flipped.read_bytes())
    data[len(data) // 2] ^= 1
    flipped.write_bytes(data)
    cut.write_bytes(cut.read_bytes()[:100])
    (folder / "notes.txt").write_text("mine")
    for name in os.listdir(tmp_path / "made"):
        path = tmp_path / "made" / name
        path.write_bytes(path.read_bytes()[:-1])
    cache = cluster.Cache(tmp_path)
    made = list(_farm.farm(items(), client, cache))
    assert made[0].data == model and cache.damaged >= 3
    assert made[0].facts["shards"] > 0


def test_caches_that_stay_damaged_are_told(client, tmp_path, monkeypatch):
    list(_farm.farm(items(), client, cluster.Cache(tmp_path)))
    for name in os.listdir(tmp_path / "made"):
        os.remove(tmp_path / "made" / name)
    monkeypatch.setattr(_farm._Farm, "bytes_of", lambda *_: None)
    (made,) = _farm.farm(items(), client, cluster.Cache(tmp_path), retries=2)
    assert made.data is None and made.error == "tiny: its shards in the cache are damaged repeatedly"


def test_two_farms_on_one_cache(client, model, tmp_path):
    results = []

    def one():
        results.append([made.data for made in _farm.farm(items(), client, cluster.Cache(tmp_path))])

    threads = [threading.Thread(target=one) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [[model], [model]]
    assert not [name for _, _, names in os.walk(tmp_path) for name in names if name.endswith(".tmp")]


@pytest.mark.slow(16)
def test_workers_that_die(tmp_path):
    """Killed while they start, as data are sent to them, and while they work: the same bits, and no shard twice."""
    sizes = {**SMALL, "paths": 200_000}
    with Killer(10, 0.4) as killer, cluster.connect(local=2) as client:
        killer.watch(client)
        cache, seed = cluster.Cache(tmp_path), 0
        # Models until enough have died.
        while killer.killed < killer.kills or not seed:
            seed += 1
            item = cluster.yarn_item(SPEC, name="tiny", seed=seed, **sizes)
            (made,) = _farm.farm([item], client, cache, retries=0)
            assert made.error == "" and made.facts["shards"] == item.jobs[0].shards
            assert made.data == plywave.build(SPEC, seed=seed, **sizes).to_bytes()
    assert killer.killed == 10 and killer.starting > 0, (killer.starting, killer.sending, killer.working)


def test_a_worker_dies_as_data_are_sent_to_it(client, model, tmp_path):
    scatter, pids = client.scatter, []

    def deadly(*args, workers, **options):
        if len(pids) < 2:
            pids.extend(client.run(os.getpid, workers=workers).values())
            os.kill(pids[-1], signal.SIGKILL)
        return scatter(*args, workers=workers, **options)

    client.scatter = deadly
    try:
        (made,) = _farm.farm(items(), client, cluster.Cache(tmp_path), retries=0)
    finally:
        del client.scatter
    assert made.data == model and len(pids) == 2


def test_farms_whose_workers_all_die_end(tmp_path):
    """Too many deaths without anything finished in between: one line, and what was finished is kept."""
    with cluster.connect(local=1) as client:
        with Killer(10**6, 0.01) as killer:
            killer._made.append(_workers.local_workers(client))
            with pytest.raises(Error, match="6 workers died in a row and nothing was finished.*; the last: .*exit code -9.*run it again") as told:
                list(_farm.farm(items(), client, cluster.Cache(tmp_path), deaths=5))
    assert "\n" not in str(told.value)


def test_workers_that_cannot_start_are_told(monkeypatch):
    monkeypatch.setattr(_local, "_CODE", "raise SystemExit('this Python is broken')")
    monkeypatch.setattr(_workers, "MAX_DEATHS", 3)
    begun = time.monotonic()
    with pytest.raises(Error, match="local = 2: no worker process starts within .* s; . of them died, the last with exit code 1: this Python is broken"):
        with cluster.connect(local=2):
            pass
    assert time.monotonic() - begun < 20


def test_items_fail_by_their_own_faults_alone(inside, model, tmp_path, monkeypatch):
    """An error that a task raises once is not the item's; the same one twice is, and the others go on."""
    run, first = _items.run_blocks, tmp_path / "first"

    def raises(description, extent, blocks):
        if '"seed":7' in description or not first.exists():
            first.touch()
            raise ZeroDivisionError("of the task")
        return run(description, extent, blocks)

    monkeypatch.setattr(_items, "run_blocks", raises)
    bad = cluster.yarn_item(SPEC, name="bad", **{**SMALL, "seed": 7})
    made = {one.item.name: one for one in _farm.farm([*items(), bad], inside, cluster.Cache(tmp_path))}
    assert made["tiny"].data == model and made["tiny"].error == ""
    assert made["bad"].data is None and made["bad"].error == "bad: ZeroDivisionError: of the task"
    # What plywave itself tells ends an item at once.
    monkeypatch.setattr(_items, "run_blocks", lambda *_: _plywave.json_of_toml("=", "spec"))
    (one,) = _farm.farm([cluster.yarn_item(SPEC, name="worse", **{**SMALL, "seed": 8})], inside, cluster.Cache(tmp_path), retries=100)
    assert one.data is None and one.error.startswith("spec") and one.facts["retries"] == 0


def test_words_for_workers_that_are_gone():
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    gone = [None, KilledWorker("task", None, 3), CommClosedError("x"), TimeoutError(), ConnectionResetError()]
    assert all(_farm.is_loss(error) for error in gone)
    assert not any(_farm.is_loss(error) for error in (Error("x"), MemoryError(), OSError(28, "No space left on device"), ModuleNotFoundError("plywave")))


def test_damaged_results_are_run_again(inside, model, tmp_path, monkeypatch):
    run, broken = _items.run_blocks, tmp_path / "broken"
    broken.mkdir()

    def breaks(description, extent, blocks):
        done = run(description, extent, blocks)
        for what in ("flipped", "missing"):
            try:
                (broken / what).mkdir()
            except FileExistsError:
                continue
            first, count, data = done.files[0]
            flipped = [(first, count, data[:-1] + bytes([data[-1] ^ 1]))] if what == "flipped" else []
            return done._replace(files=flipped + done.files[1:])
        return done

    monkeypatch.setattr(_items, "run_blocks", breaks)
    made = list(_farm.farm(items(), inside, cluster.Cache(tmp_path / "cache")))
    assert made[0].error == "" and made[0].data == model and made[0].facts["retries"] == 2

    def always(*args):
        return run(*args)._replace(files=[])

    monkeypatch.setattr(_items, "run_blocks", always)
    other = cluster.yarn_item(SPEC, name="tiny", **{**SMALL, "seed": 2})
    made = list(_farm.farm([other], inside, cluster.Cache(tmp_path), retries=1))
    assert made[0].data is None and "lost 2 times" in made[0].error


def test_other_kinds(client, tmp_path):
    sizes = {"lambdas": 2, "thetas": 2, "azimuths": 2}
    fiber = cluster.fiber_item(SPEC, "preview", name="fiber", **sizes)
    speckle = cluster.speckle_item(SPEC, name="speckle", instances=2)
    made = {one.item.kind: one.data for one in _farm.farm([fiber, speckle], client, cluster.Cache(tmp_path))}
    assert made["fiber"] == plywave.wave.tabulate(SPEC, "preview", **sizes).to_bytes()
    assert made["speckle"] == plywave.wave.speckle(SPEC, instances=2).to_bytes()


COMPARED = {"instances": 2, "lambda_um": [1.5, 2.0], "h_rel": [0.0], "tolerance": 1e-3, "paths": 500}


def test_comparisons(client, inside, tmp_path):
    """Waves against rays: a shard an instance and wavelength, the same bytes whoever runs them, a longer run from the shards of a shorter one."""
    item = cluster.compare_item(SPEC, name="both", **COMPARED)
    assert item.jobs[0].shards == 4 and (item.extension, item.name) == ("json", "both")
    cache = cluster.Cache(tmp_path)
    made = list(_farm.farm([item], client, cache))
    assert made[0].error == "" and made[0].facts["shards"] == 4
    report = json.loads(made[0].data)
    assert [case["lambda_um"] for case in report["cases"]] == [1.5, 2.0] and report["instances"] == 2
    assert all(0.0 < case["energies"]["wave_total"]["mean"] < 1.2 for case in report["cases"])
    other = list(_farm.farm([item], inside, cluster.Cache(tmp_path / "other")))
    assert other[0].data == made[0].data
    longer = cluster.compare_item(SPEC, name="both", **{**COMPARED, "instances": 3})
    assert longer.jobs[0].digest == item.jobs[0].digest and len(cache.shards(longer.jobs[0])) == 4
    made = list(_farm.farm([longer], client, cache))
    assert made[0].error == "" and json.loads(made[0].data)["instances"] == 3
    page = cluster.report("x", made, seconds=1.0, slots=2)
    assert "correlation of averages" in page and "3 instances" in page


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lambda_um": [0.01]}, ["lambda_um = 0.01", "0.1 to 20"]),
        ({"lambda_um": "red"}, ["lambda_um", "numbers"]),
        ({"h_rel": []}, ["h_rel", "1 to 16"]),
        ({"theta_i_deg": 85.0}, ["theta_i"]),
        ({"instances": 0}, ["instances = 0"]),
        ({"paths": 7}, ["paths = 7"]),
        ({"tolerance": 0.5}, ["tolerance = 0.5"]),
    ],
)
def test_bad_comparisons(options, words):
    with pytest.raises(Error) as refused:
        cluster.compare_item(SPEC, **{**COMPARED, **options})
    assert all(word in str(refused.value) for word in words) and "\n" not in str(refused.value)


def test_damaged_reports():
    for text in (b"", b"{}", b"[1]", b'{"cases": []}', b"\xff"):
        with pytest.raises(Error, match="both"):
            _farm.check_report(text, "both")


FAMILY = {**SPEC, "family": {"alpha_fiber": [0.1, 0.4]}} if isinstance(SPEC, dict) else SPEC + "\n[family]\nalpha_fiber = [0.1, 0.4]\n"


def test_families(client, tmp_path):
    item = cluster.family_item(FAMILY, nodes=2, **SMALL)
    # Two nodes, and the middle between them.
    assert len(item.jobs) == 3 and item.extension == "pwfam"
    cache = cluster.Cache(tmp_path)
    (made,) = cluster.farm([item], client, cache)
    assert made.data == plywave.build_family(FAMILY, nodes=2, most_nodes=2, **SMALL).to_bytes(), made.error
    family = plywave.Family.from_bytes(made.data)
    assert family.axes == {"alpha_fiber": (0.1, 0.4)}
    assert 0.0 < family.at(alpha_fiber=0.2).albedo(theta_i=0.3, h_um=0.0, sigma_per_um=0.0) <= 1.001
    with pytest.raises(Error, match="alpha_fiber = 0.5"):
        family.at(alpha_fiber=0.5)
    page = cluster.report("x", [made], seconds=1.0, slots=2)
    assert "0.1, 0.4" in page
    with pytest.raises(Error, match="nodes"):
        cluster.family_item(FAMILY, nodes=1, **SMALL)
    with pytest.raises(Error, match="family"):
        cluster.family_item(SPEC, **SMALL)


def test_jobs_keep_to_workers():
    queue = _farm._Queue()
    works = [_farm._Work(item) for item in ("x", "y", "z")]
    for work in works:
        queue.add([_farm._Task(work, 0, [(k, 1)]) for k in range(4)])
    taken = {"a": [], "b": []}
    for turn in range(14):
        worker = "ab"[turn % 2]
        task = queue.take(worker)
        if task is not None:
            taken[worker].append(task.work.item)
    assert sorted(taken["a"] + taken["b"]) == ["x"] * 4 + ["y"] * 4 + ["z"] * 4 and not queue
    # Each has a job of its own, in one go; the last one is shared, since nothing else is left.
    assert taken["a"][:4] == ["x"] * 4 and taken["b"][:4] == ["y"] * 4
    assert taken["a"][4:] == taken["b"][4:] == ["z"] * 2


def test_urls(client, model):
    cache = cluster.Cache("memory://plywave-tests/cache")
    (made,) = cluster.farm(items(), client, cache)
    assert made.data == model
    (again,) = cluster.farm(items(), NoClient(), cluster.Cache("memory://plywave-tests/cache"))
    assert again.data == model and again.facts["cached"]
    for job in items()[0].jobs:
        assert sum(count for _, count in cache.shards(job)) == job.shards
    with pytest.raises(Error, match="nothing://"):
        cluster.Cache("nothing://plywave-tests")


def test_versions(inside, monkeypatch, tmp_path):
    monkeypatch.setattr(_items, "version", lambda: "0.0.1")
    with pytest.raises(Error, match="plywave 0.0.1, here .*; install one version everywhere"):
        cluster.build([SPEC], inside)
    job = items()[0].jobs[0]
    old = job.description.replace(f'"program_version":"{plywave.__version__}"', '"program_version":"0.0.1"')
    assert old != job.description
    with pytest.raises(Error, match="0.0.1 cannot be run by plywave"):
        _items.run_blocks(old, 0, [(0, 1)])


def test_missing_blocks():
    job = _items.Job("simulate", "", 0, "", 11, 4)
    assert _farm.missing(job, [], False) == [(k, 1) for k in range(11)]
    wide = _items.Job("simulate", "", 0, "", 40, 4)
    assert _farm.missing(wide, [(0, 4), (9, 1)], True) == [(4, 4), (8, 1), (10, 1), (11, 1)] + [(k, 4) for k in range(12, 40, 4)]
    assert _farm.missing(wide, [(k, 4) for k in range(0, 40, 4)], True) == []


LIBRARY = """
name = "small"
quality = "preview"

[[yarn]]
spec = "yarn.toml"
paths = 6000
instances = 2
"""


ALL = (
    LIBRARY
    + """
[[family]]
spec = "family.toml"
nodes = 2
paths = 6000
instances = 2

[[fiber]]
spec = "yarn.toml"
name = "fiber"
rays = true
lambdas = 2
thetas = 2
azimuths = 2
ray_count = 2000
sigma_per_um = 0.01

[[speckle]]
spec = "yarn.toml"
name = "grain"
instances = 3

[[twin]]
cloth = "sheet.toml"
name = "sheet"
paths = 2000

[[compare]]
spec = "yarn.toml"
name = "both"
instances = 1
lambda_um = [2.0]
h_rel = [0.0]
tolerance = 1e-3
paths = 500
"""
)


SHEET = """
name = "sheet"
curves = { file = "curves.toml" }

[yarn]
model = "yarn.toml"
fiber = { like = "polyester", density_g_per_cm3 = 1.4 }
count = "45 dtex"
packing = 0.6
"""
CURVES = """
cell_um = [[200.0, 0.0], [0.0, 100.0]]
yarn = [{ kind = 0, number = 0, step = [0, 1], period = [1, 0] }]
curve = [{ yarn = 0, radius_um = 40.0, shift = [1, 0], control_um = [[0.0, 50.0, 0.0], [50.0, 50.0, 0.0], [100.0, 50.0, 0.0], [150.0, 50.0, 0.0]] }]
"""


def run(*args):
    return subprocess.run([sys.executable, "-m", "plywave.farm", *args], capture_output=True, text=True, timeout=300)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "yarn.toml").write_text(SPEC)
    for name, text in (("library", LIBRARY), ("sheet", SHEET), ("curves", CURVES)):
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


def pixels_of(png):
    """Width and height, and the values of an 8-bit RGB PNG without filters."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", png[16:24])
    at, data = 8, b""
    while at < len(png):
        length = struct.unpack(">I", png[at : at + 4])[0]
        data += png[at + 8 : at + 8 + length] if png[at + 4 : at + 8] == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(data), np.uint8).reshape(height, 1 + 3 * width)
    assert (rows[:, 0] == 0).all()
    return (width, height), rows[:, 1:].astype(float)


def test_command(folder, model):
    out = folder / "out"
    done = run(str(folder / "library.toml"), "-o", str(out), "--local", "2", "--price", "0.05")
    assert done.returncode == 0, done.stderr
    assert (out / "yarn.pwm").read_bytes() == model
    page = (out / "report.html").read_text()
    assert "yarn.pwm" in page and "errors of the fit" in page and "<svg" in page and "cost" in page and "http" not in page
    picture = base64.b64decode(page.split("data:image/png;base64,")[1].split('"')[0])
    size, pixels = pixels_of(picture)
    # Yarns and gaps, lit more here than there.
    assert size == (160, 160) and pixels.std() > 20.0 and (pixels == 0).mean() > 0.01
    again = run(str(folder / "library.toml"), "-o", str(out), "--local", "1")
    assert again.returncode == 0 and "in the cache" in again.stdout
    told = json.loads(run(str(folder / "library.toml"), "-o", str(out), "--local", "1", "--json").stdout)
    assert [one["name"] for one in told["files"]] == ["yarn.pwm"] and told["files"][0]["cached"]


def pictures(page):
    """Pictures of a page's files, by file."""
    found = {}
    for section in page.split("<section>")[1:]:
        name = section.split("<h2>")[1].split("</h2>")[0]
        found[name] = [pixels_of(base64.b64decode(part.split('"')[0])) for part in section.split("data:image/png;base64,")[1:]]
    return found


@pytest.mark.slow(7)
def test_all_kinds_of_a_library(folder):
    """A file of every kind through the command, its cache at a URL: pictures on the page show what they should, and a second run computes nothing."""
    (folder / "family.toml").write_text(FAMILY)
    (folder / "library.toml").write_text(ALL)
    url = (folder / "shards_of_all").as_uri()
    out = folder / "out"
    arguments = (str(folder / "library.toml"), "-o", str(out), "--local", "2", "--cache", url, "--json")
    done = run(*arguments)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    names = ["yarn.pwm", "family.pwfam", "fiber.pwf", "grain.pws", "sheet.pwx", "both.json"]
    assert [one["name"] for one in told["files"]] == names and not any(one["cached"] or one["error"] for one in told["files"])
    assert (out / "family.pwfam").read_bytes() == plywave.build_family(FAMILY, nodes=2, most_nodes=2, **SMALL).to_bytes()
    # The cache is where the URL says, and nowhere else.
    assert (folder / "shards_of_all" / "made").is_dir() and not (out / "cache").exists()
    shown = pictures((out / "report.html").read_text())
    assert list(shown) == names and [len(found) for found in shown.values()] == [1, 1, 1, 1, 1, 0]
    for name, found in shown.items():
        for size, pixels in found:
            assert pixels.std() > 5.0, name
            assert 60 <= size[0] <= 640 and 60 <= size[1] <= 320, (name, size)
    # Three yarns of the family: rougher fibers, another cloth.
    (width, height), pixels = shown["family.pwfam"][0]
    smooth, rough = (pixels.reshape(height, width, 3)[:, at : at + height] for at in (0, 2 * height))
    assert width == 3 * height and np.abs(smooth - rough).mean() > 10.0
    again = json.loads(run(*arguments).stdout)
    assert all(one["cached"] for one in again["files"])


def test_mutated_libraries(folder):
    rng = random.Random(7)
    (folder / "family.toml").write_text(FAMILY)
    good = ALL
    words = ["0", "-1", "1e9", "1e308", "nan", "inf", "99999999999999999999", "true", "[]", "{}", "'x'", "yarn.toml", "[[yarn]]", "=", "", "\x00", "\u2028"]
    read = 0
    for _ in range(1500):
        lines = good.split("\n")
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(lines))
            kind = rng.randrange(5)
            if kind == 0:
                key, equals, _ = lines[at].partition("=")
                lines[at] = key + equals + " " + rng.choice(words)
            elif kind == 1:
                lines.insert(rng.randrange(len(lines) + 1), lines[at])
            elif kind == 2 and len(lines) > 1:
                del lines[at]
            elif kind == 3:
                text = lines[at]
                cut = rng.randint(0, len(text))
                lines[at] = text[:cut] + rng.choice(words) + text[cut + rng.randint(0, 2) :]
            else:
                other = rng.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
        (folder / "mutated.toml").write_text("\n".join(lines), encoding="utf-8")
        try:
            assert cluster.Library(folder / "mutated.toml").items
            read += 1
        except plywave.Error as error:
            assert len(str(error).splitlines()) == 1 and len(str(error)) < 2000, error
    assert 50 < read < 1400, read


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LIBRARY.replace("paths", "pahts"), ["yarn[1].pahts = 6000", "did you mean paths?"]),
        (LIBRARY.replace("6000", "'many'"), ["yarn[1].paths = 'many'", "give a whole number"]),
        (LIBRARY + "speckle = 1.5\n", ["yarn[1].speckle = 1.5", "give true or false or a whole number"]),
        (LIBRARY + "speckle = -1\n", ["yarn[1]", "speckle = -1"]),
        (LIBRARY + "[[compare]]\nspec = 'yarn.toml'\nlambda_um = true\n", ["compare[1].lambda_um = True", "give a number or a list"]),
        (LIBRARY.replace('quality = "preview"', 'quality = "good"'), ['quality = "good"', '"preview"']),
        (LIBRARY.replace("yarn.toml", "none.toml"), ["none.toml"]),
        (LIBRARY + LIBRARY[LIBRARY.index("[[") :], ["yarn.pwm is made twice"]),
        (LIBRARY + "farms = 3\n", ["farms = 3", "unknown key"]),
        ('name = "x"\n', ["nothing to make"]),
        ("name = \n", ["line 1"]),
        ('yarn = "yarn.toml"\n', ["yarn", "[[yarn]]"]),
    ],
)
def test_bad_libraries(folder, text, words):
    (folder / "library.toml").write_text(text)
    done = run(str(folder / "library.toml"), "-o", str(folder / "out"))
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and len(lines) == 1 and lines[0].startswith("error: "), done.stderr
    assert all(word in lines[0] for word in words), lines[0]
    assert not (folder / "out").exists()


@pytest.mark.parametrize(("value", "same"), [("true", True), ("false", False), ("0", False), ("3", 3)])
def test_speckle_in_libraries(folder, value, same):
    (folder / "library.toml").write_text(LIBRARY + f"speckle = {value}\n")
    (item,) = cluster.Library(folder / "library.toml").items
    assert item.key == cluster.yarn_item(folder / "yarn.toml", speckle=same, **SMALL).key


def test_dead_scheduler(folder):
    begun = time.monotonic()
    done = run(str(folder / "library.toml"), "-o", str(folder / "out"), "--scheduler", "tcp://127.0.0.1:9", "--timeout", "1")
    assert done.returncode == 2 and "tcp://127.0.0.1:9: no answer" in done.stderr and len(done.stderr.splitlines()) == 1
    assert time.monotonic() - begun < 60


@pytest.mark.parametrize("says", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-OpenSSH\r\n", b"\x05" + bytes(12), b"-ERR\r\n", None])
def test_what_is_no_scheduler_is_told(says):
    """A port that is silent, speaks first, answers, or hangs up: one line within the time."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        kept = []

        def serve():
            with contextlib.suppress(OSError):
                while True:
                    kept.append(server.accept()[0])
                    if says is None:
                        kept.pop().close()
                    elif says:
                        kept[-1].sendall(says)

        threading.Thread(target=serve, daemon=True).start()
        begun = time.monotonic()
        with pytest.raises(Error, match=f"scheduler = tcp://127.0.0.1:{server.getsockname()[1]}: ") as told:
            with cluster.connect(f"tcp://127.0.0.1:{server.getsockname()[1]}", timeout_s=1.0):
                pass
        assert time.monotonic() - begun < 10.0 and "\n" not in str(told.value), told.value
        for one in kept:
            one.close()


def test_other_addresses_are_told(client):
    worker = next(iter(client.nthreads()))
    for address, words in [(worker, "a Dask worker answers"), (client.dashboard_link.replace("/status", ""), "give tcp://HOST:PORT"), ("nonsense", "give tcp://HOST:PORT")]:
        with pytest.raises(Error, match=words) as told:
            with cluster.connect(address, timeout_s=1.0):
                pass
        assert "\n" not in str(told.value)
    # The scheduler's own is taken, from within a running loop too, as in a notebook.
    with cluster.connect(client.cluster.scheduler_address) as other:
        assert other.nthreads() == client.nthreads()


def test_jobs_that_ended_are_asked_for_again():
    asked = []

    class Slurm:
        def scale(self, jobs):
            asked.append(jobs)
            raise RuntimeError("the queue is closed")

    stop = _workers._keep_jobs(Slurm(), 3, every_s=0.01)
    until = time.monotonic() + 10.0
    while len(asked) < 3 and time.monotonic() < until:
        time.sleep(0.01)
    stop()
    assert asked[:3] == [3, 3, 3]


def test_bad_slurm(folder):
    done = run(str(folder / "library.toml"), "-o", str(folder / "out"), "--slurm", "qeue=x")
    assert done.returncode == 2 and "did you mean queue?" in done.stderr.splitlines()[-1]
