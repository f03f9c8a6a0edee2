"""Workers: a scheduler that runs, processes of this machine, or jobs of Slurm."""

from __future__ import annotations

import contextlib
from importlib import import_module
from typing import Any, Dict, Iterator, Optional

from .. import _plywave
from .._plywave import Error
from .._threads import get_threads
from . import _items

_INSTALL = "pip install plywave[cluster]"
_SLURM: Dict[str, type] = {
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


@contextlib.contextmanager
def connect(
    scheduler: Optional[str] = None, local: Optional[int] = None, slurm: Optional[Dict[str, Any]] = None, jobs: int = 1, timeout_s: float = 10.0
) -> Iterator[Any]:
    """A Dask client whose workers run this version of plywave, for the time of a `with`; workers that were started for it end with it.

    Args:
        scheduler: Address of a scheduler that runs, "tcp://..".
        local: Else as many processes of this machine; by default one a core.
        slurm: Else options of `dask_jobqueue.SLURMCluster`: queue, cores, memory, walltime, ..
        jobs: Slurm jobs that are asked for.
        timeout_s: How long an answer may take [s].

    Raises:
        Error: without Dask, where the scheduler does not answer, for workers of another version.
    """
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise Error(f"{error}: {_INSTALL}") from None
    cluster: Any = None
    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=timeout_s)
        except (OSError, ValueError) as error:
            raise Error(f"scheduler = {scheduler}: no answer within {timeout_s:g} s ({type(error).__name__}); is it running?") from None
    elif slurm is not None:
        _items.check_options(slurm, _SLURM, "slurm")
        try:
            jobqueue = import_module("dask_jobqueue")
        except ImportError as error:
            raise Error(f"{error}: {_INSTALL}") from None
        try:
            cluster = jobqueue.SLURMCluster(**{"cores": 1, "memory": "2GB", **slurm})
            cluster.scale(jobs=jobs)
        except (ValueError, RuntimeError, OSError) as error:
            raise Error(f"slurm: {error}") from None
        client = distributed.Client(cluster)
    else:
        count = get_threads() if local is None else local
        if not 1 <= count <= 1024:
            raise Error(f"local = {count}: give 1 to 1024 processes")
        cluster = distributed.LocalCluster(n_workers=count, threads_per_worker=1, processes=True, dashboard_address=":0")
        client = distributed.Client(cluster)
    try:
        check_versions(client)
        yield client
    finally:
        client.close()
        if cluster is not None:
            cluster.close()


def check_versions(client: Any) -> None:
    """Refuses workers without plywave, or with another version of it.

    Raises:
        Error: naming the first such worker.
    """
    ours = _plywave.__version__
    for worker, theirs in client.run(_items.version, on_error="return").items():
        if isinstance(theirs, BaseException):
            raise Error(f"worker {worker}: {type(theirs).__name__}: {theirs}; install plywave {ours} there")
        if theirs != ours:
            raise Error(f"worker {worker}: plywave {theirs}, here {ours}; install one version everywhere")
