"""Efficiency of the farm: the same work by one worker and by two, and what a task costs the scheduler.

    python python/tests/speed_cluster.py fabrics/polyester.toml --seeds 4 --quality preview

Workers are started before the clock. The overhead is the time of a farm with one worker less what the worker says it worked, over the latter.
"""

import argparse
import tempfile
import time

from plywave import cluster


def farmed(specs: "list[str]", seeds: int, quality: str, workers: int) -> "tuple[float, float, int]":
    items = [cluster.yarn_item(spec, quality, seed=1 + seed) for spec in specs for seed in range(seeds)]
    with cluster.connect(local=workers) as client, tempfile.TemporaryDirectory() as folder:
        # What a process does once is not the farm's: imports.
        client.run(lambda: __import__("plywave"))
        begun = time.monotonic()
        made = list(cluster.farm(items, client, cluster.Cache(folder)))
        wall = time.monotonic() - begun
    worked = sum(one.facts["shard_seconds"] + one.facts["finish_seconds"] for one in made)
    return wall, worked, sum(job.shards for item in items for job in item.jobs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specs", nargs="+")
    parser.add_argument("--quality", default="preview")
    parser.add_argument("--seeds", type=int, default=1, help="models of each spec")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    best = {1: float("inf"), 2: float("inf")}
    for _ in range(args.repeats):
        for workers in best:
            wall, worked, shards = farmed(args.specs, args.seeds, args.quality, workers)
            best[workers] = min(best[workers], wall)
            print(f"{workers} workers: {wall:.2f} s for {worked:.2f} s of work, {shards} shards; overhead {wall * workers / worked - 1.0:+.1%}", flush=True)
    print(f"two workers are {best[1] / best[2]:.3f} of one")


if __name__ == "__main__":
    main()
