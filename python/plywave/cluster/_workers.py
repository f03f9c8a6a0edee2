"""Workers: a running scheduler, processes of this machine, or jobs of Slurm."""

from __future__ import annotations

import asyncio
import contextlib
import re
import threading
import time
import weakref
from importlib import import_module
from typing import Any, Dict, Iterator, List, Optional

from .. import _plywave
from .._plywave import Error
from .._threads import get_threads
from . import _items
from ._local import LocalWorkers

_INSTALL = "pip install plywave[cluster]"
_SLURM: Dict[str, Any] = {
    "queue": str,
    "account": str,
    "cores": int,
    "processes": int,
    "memory": str,
    "walltime": str,
    "python": str,
    "local_directory": str,
    "interface": str,
    "job_extra_directives": list,
    "job_script_prologue": list,
}

MAX_DEATHS = 200
"""Workers that may die in a row while nothing is finished."""

START_S = 60.0
"""Longest time to wait for the start of all processes of this machine [s]; then those that have started begin."""

_LOCAL: "weakref.WeakKeyDictionary[Any, LocalWorkers]" = weakref.WeakKeyDictionary()


def local_workers(client: Any) -> Optional[LocalWorkers]:
    """The processes that `connect` started for a client."""
    return _LOCAL.get(client)


@contextlib.contextmanager
def connect(
    scheduler: Optional[str] = None, local: Optional[int] = None, slurm: Optional[Dict[str, Any]] = None, jobs: int = 1, timeout_s: float = 10.0
) -> Iterator[Any]:
    """A Dask client whose workers run this version of plywave, for the time of a `with`; workers that were started for it end with it.

    Processes of this machine that die are replaced, and so are Slurm's jobs.

    Args:
        scheduler: Address of a running scheduler, "tcp://..".
        local: Else the number of processes on this machine; by default one per core.
        slurm: Else options of `dask_jobqueue.SLURMCluster`: queue, cores, memory, walltime, ..
        jobs: Number of Slurm jobs.
        timeout_s: Longest time to wait for the scheduler's answer [s].

    Raises:
        Error: without Dask, where no scheduler answers at the address, where no process starts, for workers of another version.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise Error(f"{error}: {_INSTALL}") from None
    with contextlib.ExitStack() as stack:
        if scheduler is not None:
            client = _client_of(distributed, scheduler, timeout_s)
        elif slurm is not None:
            _items.check_options(slurm, _SLURM, "slurm")
            try:
                jobqueue = import_module("dask_jobqueue")
            except ImportError as error:
                raise Error(f"{error}: {_INSTALL}") from None
            try:
                cluster = jobqueue.SLURMCluster(**{"cores": 1, "memory": "2GB", **slurm})
                stack.callback(_closed, cluster)
                cluster.scale(jobs=jobs)
            except (ValueError, RuntimeError, OSError) as error:
                raise Error(f"slurm: {error}") from None
            client = distributed.Client(cluster)
            stack.callback(_keep_jobs(cluster, jobs))
        else:
            count = get_threads() if local is None else local
            if not 1 <= count <= 1024:
                raise Error(f"local = {count}: give 1 to 1024 processes")
            cluster = distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0", protocol="tcp")
            stack.callback(_closed, cluster)
            client = distributed.Client(cluster)
            workers = LocalWorkers(cluster.scheduler_address, count)
            stack.callback(workers.close)
            _LOCAL[client] = workers
        stack.callback(_closed, client)
        if scheduler is None and slurm is None:
            _wait_for(client, workers, count)
        check_versions(client)
        yield client


def _closed(what: Any) -> None:
    """Closes a client or a cluster."""
    # Its peer may have ended, for which Dask raises errors of many kinds; there is nothing to lose.
    with contextlib.suppress(Exception):
        what.close()


def _keep_jobs(cluster: Any, jobs: int, every_s: float = 10.0) -> Any:
    """Requests ended jobs from Slurm again, every `every_s`; returns a function that stops this."""
    over = threading.Event()

    def keep() -> None:
        while not over.wait(every_s):
            # A job that Slurm refuses now is requested again the next time.
            with contextlib.suppress(Exception):
                cluster.scale(jobs=jobs)

    threading.Thread(target=keep, daemon=True).start()
    return over.set


def _wait_for(client: Any, workers: LocalWorkers, count: int) -> None:
    begun = time.monotonic()
    while True:
        there = len(client.nthreads())
        waited = time.monotonic() - begun
        if there == count or (there and waited > START_S):
            return
        if workers.deaths > MAX_DEATHS or waited > 3.0 * START_S:
            died = f"; {workers.deaths} of them died, the last with {workers.last_words}" if workers.deaths else ""
            raise Error(f"local = {count}: no worker process starts within {waited:.0f} s{died}")
        time.sleep(0.02)


def _client_of(distributed: Any, scheduler: str, timeout_s: float) -> Any:
    """A client of a running scheduler."""
    scheme, _, place = scheduler.rpartition("://")
    if not re.fullmatch(r"(tcp|tls|ws|wss|ucx)?", scheme) or not re.fullmatch(r".+:\d{1,5}", place):
        raise Error(f"scheduler = {scheduler}: no address of a scheduler; give tcp://HOST:PORT")
    begun = time.monotonic()
    nobody = f"scheduler = {scheduler}: no answer within {timeout_s:g} s"
    answers: List[Any] = []

    def ask() -> None:
        try:
            answers.append(asyncio.run(asyncio.wait_for(_identity(distributed, scheduler, timeout_s), timeout_s)))
        except Exception as error:  # noqa: BLE001 - what is no scheduler may send anything, and what is read of it may raise anything
            answers.append(error)

    # A thread, since the caller's may have a loop of its own, as in a notebook.
    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(timeout_s + 1.0)
    answer = answers[0] if answers else TimeoutError()
    if isinstance(answer, (TimeoutError, asyncio.TimeoutError, OSError)):
        raise Error(f"{nobody} ({type(answer).__name__}); is a Dask scheduler running there?")
    if scheme == "tls" and isinstance(answer, TypeError):
        raise Error(f"scheduler = {scheduler}: no certificates; set distributed.comm.tls in Dask's configuration")
    kind = answer.get("type") if isinstance(answer, dict) else None
    if kind != "Scheduler":
        what = f"a Dask {kind.lower()} answers" if isinstance(kind, str) else "what answers does not speak Dask's protocol"
        raise Error(f"scheduler = {scheduler}: {what}; give the address that `dask scheduler` prints, not that of its dashboard or of a worker")
    try:
        return distributed.Client(scheduler, timeout=max(1.0, timeout_s - (time.monotonic() - begun)))
    except (OSError, ValueError, RuntimeError, asyncio.TimeoutError) as error:
        raise Error(f"{nobody} ({_items.one_line(error)}); is it running?") from None


async def _identity(distributed: Any, address: str, timeout_s: float) -> Any:
    """What a Dask server says of itself."""
    security = distributed.Security().get_connection_args("client")
    comm = await import_module("distributed.comm").connect(address, timeout=timeout_s, **security)
    try:
        await comm.write({"op": "identity", "reply": True})
        return await comm.read()
    finally:
        comm.abort()


def check_versions(client: Any) -> None:
    """Refuses workers without plywave, or with another version of it.

    Raises:
        Error: naming the first such worker.
    """
    ours = _plywave.__version__
    for worker, theirs in client.run(_items.version, on_error="return").items():
        if isinstance(theirs, (OSError, TimeoutError, asyncio.TimeoutError, asyncio.CancelledError)):
            # It died while it was asked.
            continue
        if isinstance(theirs, BaseException):
            raise Error(f"worker {worker}: {_items.one_line(theirs)}; install plywave {ours} there")
        if theirs != ours:
            raise Error(f"worker {worker}: plywave {theirs}, here {ours}; install one version everywhere")
