"""`plywave-farm LIBRARY.toml`: all files of a library, made by Dask workers, and a page that shows them (docs/howto/cluster.md)."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import sys
import time
from importlib import import_module
from typing import Any, Dict, List, Optional

from . import _plywave
from ._plywave import Error

_NUMBERS = {"cores", "processes"}


def main(argv: Optional[List[str]] = None) -> int:
    """The command. Exit codes: 0 done, 1 something of the library could not be made, 2 bad input, 130 interrupted."""
    try:
        return _run(_parse(argv))
    except Error as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; finished work is in the cache, and the same command continues", file=sys.stderr)
        return 130


def _parse(argv: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="plywave farm", description="Makes the files of a library on Dask workers, in shards that are never computed twice, and a report page (docs/howto/cluster.md)."
    )
    parser.add_argument("library", metavar="LIBRARY.toml", help="library file: what to make")
    parser.add_argument("-o", "--output", metavar="FOLDER", help="folder for the files and report.html; by default the library's name")
    parser.add_argument("--cache", metavar="FOLDER|URL", help="cache of shards and files; by default FOLDER/cache")
    workers = parser.add_mutually_exclusive_group()
    workers.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="address of a running Dask scheduler")
    workers.add_argument("--local", metavar="N", type=int, help="number of processes on this machine; by default one per core")
    workers.add_argument("--slurm", metavar="KEY=VALUE,..", help="run Slurm jobs with these options: queue, account, cores, processes, memory, walltime, python, ..")
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="number of Slurm jobs")
    parser.add_argument("--timeout", metavar="SECONDS", type=float, default=10.0, help="longest time to wait for the scheduler's answer")
    parser.add_argument("--retries", metavar="N", type=int, default=5, help="how often to repeat a task whose result is damaged before its file fails")
    parser.add_argument("--price", metavar="PRICE", type=float, help="price of a core for an hour; the report then shows costs")
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    return parser.parse_args(argv)


def _slurm(text: str) -> Dict[str, Any]:
    options: Dict[str, Any] = {}
    for pair in text.split(","):
        key, equals, value = pair.partition("=")
        if not equals:
            raise Error(f"--slurm: {pair!r}: write KEY=VALUE, separated by commas")
        key = key.strip().replace("-", "_")
        if key in _NUMBERS and not value.strip().isdigit():
            raise Error(f"--slurm: {key} = {value}: give a whole number")
        options[key] = int(value) if key in _NUMBERS else value.strip()
    return options


def _run(args: argparse.Namespace) -> int:
    try:
        from .cluster import Cache, Library, connect, farm, report
    except ImportError as error:
        raise Error(f"{error}: pip install plywave[cluster]") from None
    _only_our_lines()
    if args.retries < 0 or args.jobs < 1 or not args.timeout > 0.0:
        raise Error("give --retries 0 or more, --jobs 1 or more, --timeout above 0")
    library = Library(args.library)
    folder = args.output or library.name
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise Error(f"{folder}: {error.strerror or error}") from None
    cache = Cache(args.cache or os.path.join(folder, "cache"))
    told = _Lines(args.quiet or args.json)
    made = []
    with connect(args.scheduler, args.local, _slurm(args.slurm) if args.slurm else None, args.jobs, args.timeout) as client:
        if not (args.quiet or client.nthreads()):
            print("note: no workers yet; waiting for the first", file=sys.stderr)
        begun = time.monotonic()
        for one in farm(library.items, client, cache, retries=args.retries, told=told):
            made.append(one)
            if one.data is not None:
                _plywave.write_file(os.path.join(folder, f"{one.item.name}.{one.item.extension}"), one.data)
            told.done(one)
        seconds, slots = time.monotonic() - begun, 1
        # All is made; a scheduler that ends now only leaves the number of cores unknown.
        with contextlib.suppress(OSError, RuntimeError):
            slots = max(slots, sum(client.nthreads().values()))
    order = {item.key: at for at, item in enumerate(library.items)}
    made.sort(key=lambda one: order[one.item.key])
    page = report(library.name, made, seconds=seconds, slots=slots, price_per_core_hour=args.price, damaged=cache.damaged)
    _plywave.write_file(os.path.join(folder, "report.html"), page.encode())
    if args.json:
        files = [{**{key: fact for key, fact in one.facts.items() if key != "picture"}, "name": f"{one.item.name}.{one.item.extension}", "key": one.item.key, "error": one.error or None} for one in made]
        print(json.dumps({"library": library.name, "seconds": seconds, "slots": slots, "damaged": cache.damaged, "files": files}, indent=1))
    elif not args.quiet:
        print(f"{folder}: {sum(one.data is not None for one in made)} of {len(made)} files, report.html; {seconds:.1f} s with {slots} cores")
    return 1 if any(one.data is None for one in made) else 0


def _only_our_lines() -> None:
    """Silences Dask's log, which prints pages for every worker that dies."""
    # It sets the levels of its loggers when it is imported.
    with contextlib.suppress(ImportError):
        import_module("distributed")
    for name in [*logging.root.manager.loggerDict, "asyncio", "tornado"]:
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


class _Lines:
    """A line for every file that is done; a line that changes on terminals."""

    def __init__(self, quiet: bool) -> None:
        self.quiet, self.bar = quiet, sys.stderr.isatty() and not quiet

    def __call__(self, name: str, done: int, total: int) -> None:
        if self.bar:
            sys.stderr.write(f"\r\x1b[K{name}: {done} of {total} shards")
            sys.stderr.flush()

    def done(self, one: Any) -> None:
        if self.bar:
            sys.stderr.write("\r\x1b[K")
        if one.data is None:
            print(f"error: {one.error}", file=sys.stderr)
        elif not self.quiet:
            work = one.facts.get("shard_seconds", 0.0) + one.facts.get("finish_seconds", 0.0)
            print(f"{one.item.name}.{one.item.extension}: {'in the cache' if one.facts.get('cached') else f'{work:.1f} s of one core'}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
