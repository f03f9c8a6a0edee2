"""A soak of the farm: workers, or whole farms, that are killed at random moments, and what comes out.

    python python/tests/soak_cluster.py --workers 4 --kills 40 --specs fabrics/polyester.toml fabrics/cotton.toml
    python python/tests/soak_cluster.py --workers 2 --kills 3 --at scatter --specs fabrics/polyester.toml
    python python/tests/soak_cluster.py --workers 2 --kills 20 --whole --specs fabrics/polyester.toml

Workers die while they start, while data are sent to them and while they work; with `--at`, only at one of these. Prints how many died when, how many tasks were run again, how many shards the farm kept (each once), and whether
the models have the bits of one machine's. With `--whole` the command, its scheduler and all its workers die together, in the middle of shards, merges and fits, and the same command goes on with
their cache. Exit code 1 where something is lost or differs.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time

import plywave
from plywave import cluster
from plywave.cluster import _workers

YOUNG_S = 1.0
"""A worker that dies so soon after its process began was starting [s]."""


class Killer:
    """Kills workers of this machine at random moments while a `with` lasts, from the start of the first one on; `watch` has it kill workers to which data are about to be sent as well."""

    def __init__(self, kills, seconds, seed=1, at=None):
        self.kills, self.seconds, self.rng, self.at = kills, seconds, random.Random(seed), at
        self.starting = self.sending = self.working = 0
        self._made, self._begun = [], {}
        self._over, self._lock = threading.Event(), threading.Lock()

    @property
    def killed(self):
        return self.starting + self.sending + self.working

    def __enter__(self):
        self._kind = _workers.LocalWorkers
        made = self._made

        class Watched(self._kind):
            def __init__(self, *args):
                super().__init__(*args)
                made.append(self)

        _workers.LocalWorkers = Watched
        self._keep_shard = keep_shard = cluster.Cache.keep_shard

        def keep(cache, *args):
            keep_shard(cache, *args)
            # Between two shards: one has just come.
            pids = [pid for workers in made for pid in workers.pids()]
            if self.at == "shards" and pids:
                self.working += self._kill(self.rng.choice(pids))

        cluster.Cache.keep_shard = keep
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
        _workers.LocalWorkers, cluster.Cache.keep_shard = self._kind, self._keep_shard

    def watch(self, client):
        scatter = client.scatter

        def deadly(*args, workers, **options):
            if self.at in (None, "scatter") and self.killed < self.kills and (self.at or self.rng.random() < 0.5):
                for pid in client.run(os.getpid, workers=workers, on_error="ignore").values():
                    self.sending += self._kill(pid)
            return scatter(*args, workers=workers, **options)

        client.scatter = deadly

    def _kill(self, pid):
        with self._lock:
            if self.killed >= self.kills:
                return False
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                return False
            return True

    def _run(self):
        then = time.monotonic()
        while not self._over.wait(0.02):
            now = time.monotonic()
            pids = [pid for workers in self._made for pid in workers.pids()]
            for pid in pids:
                self._begun.setdefault(pid, now)
            if self.at == "start":
                pids = [pid for pid in pids if now - self._begun[pid] < YOUNG_S]
            if pids and now >= then and self.at in (None, "start"):
                pid = self.rng.choice(pids)
                young = now - self._begun[pid] < YOUNG_S
                if self._kill(pid):
                    self.starting, self.working = self.starting + young, self.working + (not young)
                then = now + self.rng.expovariate(1.0 / self.seconds)


def die_whole(specs, quality, workers, kills, seconds, seed, want) -> int:
    rng, killed, whole = random.Random(seed), 0, True
    with tempfile.TemporaryDirectory() as folder:
        library = os.path.join(folder, "soak.toml")
        with open(library, "w", encoding="utf-8") as file:
            file.write(f'name = "soak"\nquality = "{quality}"\n')
            for spec in specs:
                file.write(f'[[yarn]]\nspec = "{os.path.abspath(spec)}"\n')
        begun, rounds = time.monotonic(), 0
        while killed < kills or not rounds:
            out = os.path.join(folder, str(rounds))
            command = [sys.executable, "-m", "plywave.farm", library, "-o", out, "--local", str(workers), "--json"]
            # A process group of its own, which dies at once.
            while True:
                run = subprocess.Popen(command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
                try:
                    told, errors = run.communicate(timeout=rng.expovariate(1.0 / seconds) if killed < kills else None)
                    break
                except subprocess.TimeoutExpired:
                    os.killpg(run.pid, signal.SIGKILL)
                    run.communicate()
                    killed += 1
            if run.returncode != 0:
                print(errors.decode(), file=sys.stderr)
                return 1
            files = json.loads(told)["files"]
            for one, data in zip(files, want):
                with open(os.path.join(out, one["name"]), "rb") as file:
                    whole &= file.read() == data
            again = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            whole &= not again["damaged"] and all(one["cached"] for one in again["files"])
            rounds += 1
    print(f"{killed} whole farms killed in {time.monotonic() - begun:.0f} s, {rounds} rounds of {len(specs)} models; the bits of one machine's, and a second run computes nothing: {whole}")
    return 0 if whole else 1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specs", nargs="+", required=True)
    parser.add_argument("--quality", default="preview")
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=2.0, help="mean time between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at", choices=("start", "scatter", "shards"), help="kill workers only while they start, as data are sent to them, or between shards")
    parser.add_argument("--whole", action="store_true", help="kill command, scheduler and workers together")
    args = parser.parse_args()
    want = [plywave.build(spec, args.quality).to_bytes() for spec in args.specs]
    if args.whole:
        return die_whole(args.specs, args.quality, args.workers, args.kills, args.seconds, args.seed, want)
    begun = time.monotonic()
    got, retries, rounds = [], 0, 0
    with tempfile.TemporaryDirectory() as folder, Killer(args.kills, args.seconds, args.seed, args.at) as killer, cluster.connect(local=args.workers) as client:
        killer.watch(client)
        # Until enough have died: each round has a cache of its own.
        while True:
            cache = cluster.Cache(os.path.join(folder, str(rounds)))
            items = [cluster.yarn_item(spec, args.quality) for spec in args.specs]
            made = {one.item.key: one for one in cluster.farm(items, client, cache)}
            got.append([made[item.key].data for item in items])
            retries += sum(one.facts["retries"] for one in made.values())
            lost = [job.digest for item in items for job in item.jobs if sum(n for _, n in cache.shards(job)) != job.shards]
            once = all(made[item.key].facts["shards"] == sum(job.shards for job in item.jobs) for item in items)
            rounds += 1
            if lost or not once or killer.killed >= args.kills:
                break
    same = all(data == want for data in got)
    print(f"{killer.killed} workers killed in {time.monotonic() - begun:.0f} s ({killer.starting} within {YOUNG_S:g} s of their start, {killer.sending} as data were sent to them)")
    print(f"{rounds} rounds of {len(items)} models, {retries} tasks run again; shards lost: {len(lost)}; each kept once: {once}; models with the bits of one machine's: {same}")
    return 0 if same and once and not lost and killer.killed >= args.kills else 1


if __name__ == "__main__":
    sys.exit(main())
