"""Worker processes of this machine, each of which is replaced when it dies."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from typing import IO, Any, Dict, List, Optional

MIN_WAIT_S, MAX_WAIT_S = 0.1, 3.0
"""Wait before a worker that died young is replaced [s]: the least, doubled by each death, at most the last."""

YOUNG_S = 10.0
"""A worker that has lived so long is replaced at once when it dies [s]."""

# The search path is ours, so that a package which is not installed is found too.
_CODE = "import sys; sys.path[:] = {path!r}; from plywave.cluster._local import work; work({address!r}, {folder!r})"


class _Place:
    """Room for one worker: who has it, or when the next one starts."""

    def __init__(self) -> None:
        self.process: Optional[subprocess.Popen[bytes]] = None
        self.log: Optional[IO[bytes]] = None
        self.begun = 0.0
        self.not_before = 0.0
        self.wait_s = 0.0


class LocalWorkers:
    """So many worker processes of one thread each, for a scheduler. They end with this process, however it ends."""

    def __init__(self, address: str, count: int) -> None:
        self.deaths = 0
        """Workers that have died so far, those that were starting included."""
        self.last_words = ""
        """How the last of them ended, in one line."""
        self._address = address
        self._folder = tempfile.TemporaryDirectory(prefix="plywave-workers-")
        self._places = [_Place() for _ in range(count)]
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()

    def pids(self) -> List[int]:
        """Processes that run, those that are still starting included."""
        with self._lock:
            return [place.process.pid for place in self._places if place.process is not None and place.process.poll() is None]

    def close(self) -> None:
        """Ends all workers and deletes what they left on disk."""
        self._over.set()
        self._keeper.join()
        for place in self._places:
            if place.process is not None:
                place.process.kill()
        for place in self._places:
            if place.process is not None:
                place.process.wait()
                self._forget(place)
        try:
            self._folder.cleanup()
        except OSError:
            # A file of a worker that the system still holds; the system clears temporary files.
            pass

    def _keep(self) -> None:
        while not self._over.is_set():
            with self._lock:
                for place in self._places:
                    if place.process is not None and place.process.poll() is not None:
                        self._died(place, f"exit code {place.process.returncode}")
                    if place.process is None and time.monotonic() >= place.not_before:
                        self._start(place)
            self._over.wait(0.05)

    def _start(self, place: _Place) -> None:
        code = _CODE.format(path=sys.path, address=self._address, folder=self._folder.name)
        # A task has one core; what a task leaves behind lies where `close` deletes it.
        threads = {key: "1" for key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        place.begun = time.monotonic()
        try:
            place.log = tempfile.TemporaryFile()
            place.process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.PIPE,
                stdout=place.log,
                stderr=place.log,
                env={**os.environ, **threads, "TMPDIR": self._folder.name},
            )
        except OSError as error:
            self._died(place, f"it cannot be started: {error.strerror or error}")

    def _died(self, place: _Place, how: str) -> None:
        self.deaths += 1
        words = _last_line(place.log)
        self.last_words = f"{how}: {words}" if words else how
        lived = time.monotonic() - place.begun
        place.wait_s = min(max(2.0 * place.wait_s, MIN_WAIT_S), MAX_WAIT_S) if lived < YOUNG_S else 0.0
        place.not_before = time.monotonic() + place.wait_s
        self._forget(place)

    @staticmethod
    def _forget(place: _Place) -> None:
        if place.process is not None and place.process.stdin is not None:
            place.process.stdin.close()
        if place.log is not None:
            place.log.close()
        place.process = place.log = None


def _last_line(log: Optional[IO[bytes]]) -> str:
    if log is None:
        return ""
    log.seek(max(0, log.seek(0, os.SEEK_END) - 4000))
    lines = log.read().decode(errors="replace").split("\n")
    return next((line.strip()[:300] for line in reversed(lines) if line.strip()), "")


def work(address: str, folder: str) -> None:
    """The main function of a worker process."""
    import asyncio

    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Without a limit of memory: Dask pauses a worker that is beyond its limit, and for good where its task
    # needs more.
    options: Dict[str, Any] = {"nthreads": 1, "local_directory": folder, "memory_limit": 0, "host": "127.0.0.1"}

    async def run() -> None:
        from distributed import Worker

        async with Worker(address, **options) as worker:
            await worker.finished()

    asyncio.run(run())


def _end_with_parent() -> None:
    """The parent holds the other end of the standard input, which closes when it ends in any way."""
    sys.stdin.buffer.read()
    os._exit(0)
