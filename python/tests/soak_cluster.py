"""A soak of the farm: workers, or whole farms, that are killed at random moments, and what comes out.

    python python/tests/soak_cluster.py --workers 4 --kills 20 --specs fabrics/polyester.toml fabrics/cotton.toml
    python python/tests/soak_cluster.py --workers 2 --kills 20 --whole --specs fabrics/polyester.toml

Prints how many workers died, how many tasks were run again, how many shards the farm kept (each once), and whether the models have the bits of one machine's. With `--whole` the command, its
scheduler and all its workers die together, in the middle of shards, merges and fits, and the same command goes on with their cache. Exit code 1 where something is lost or differs.
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
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=2.0, help="mean time between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--whole", action="store_true", help="kill command, scheduler and workers together")
    args = parser.parse_args()
    want = [plywave.build(spec, args.quality).to_bytes() for spec in args.specs]
    if args.whole:
        return die_whole(args.specs, args.quality, args.workers, args.kills, args.seconds, args.seed, want)
    rng, killed, over = random.Random(args.seed), [], threading.Event()
    with tempfile.TemporaryDirectory() as folder, cluster.connect(local=args.workers) as client:

        def kill() -> None:
            while len(killed) < args.kills and not over.wait(rng.expovariate(1.0 / args.seconds)):
                try:
                    pids = sorted(client.run(os.getpid, on_error="ignore").values())
                    if pids:
                        pid = rng.choice(pids)
                        os.kill(pid, signal.SIGKILL)
                        killed.append(pid)
                except (OSError, RuntimeError, TimeoutError):
                    pass

        killer = threading.Thread(target=kill)
        killer.start()
        begun = time.monotonic()
        got, retries, rounds = [], 0, 0
        # Until enough have died: each round has a cache of its own.
        while True:
            cache = cluster.Cache(os.path.join(folder, str(rounds)))
            items = [cluster.yarn_item(spec, args.quality) for spec in args.specs]
            made = {one.item.key: one for one in cluster.farm(items, client, cache, retries=1000)}
            got.append([made[item.key].data for item in items])
            retries += sum(one.facts["retries"] for one in made.values())
            lost = [job.digest for item in items for job in item.jobs if sum(n for _, n in cache.shards(job)) != job.shards]
            once = all(made[item.key].facts["shards"] == sum(job.shards for job in item.jobs) for item in items)
            rounds += 1
            if lost or not once or len(killed) >= args.kills:
                break
        over.set()
        killer.join()
    same = all(data == want for data in got)
    print(f"{len(killed)} workers killed in {time.monotonic() - begun:.0f} s, {rounds} rounds of {len(items)} models, {retries} tasks run again")
    print(f"shards lost: {len(lost)}; each kept once: {once}; models with the bits of one machine's: {same}")
    return 0 if same and once and not lost and len(killed) >= args.kills else 1


if __name__ == "__main__":
    sys.exit(main())
