"""A soak of the farm: workers that are killed at random moments, and what comes out.

    python python/tests/soak_cluster.py --workers 4 --kills 20 --specs fabrics/polyester.toml fabrics/cotton.toml

Prints how many workers died, how many tasks were run again, how many shards the farm kept (each once), and whether the models have the bits of one machine's. Exit code 1 where not.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import threading
import time

import plywave
from plywave import cluster


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specs", nargs="+", required=True)
    parser.add_argument("--quality", default="preview")
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=2.0, help="mean time between two kills")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    want = [plywave.build(spec, args.quality).to_bytes() for spec in args.specs]
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
