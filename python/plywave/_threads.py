"""How many threads calls use."""

from __future__ import annotations

import os
from typing import Optional

from ._plywave import Error

_count: Optional[int] = None


def get_threads() -> int:
    """Number of threads that calls use: that of `set_threads`, else the environment's `PLYWAVE_THREADS`, else the cores this process may use."""
    if _count is not None:
        return _count
    told = os.environ.get("PLYWAVE_THREADS", "")
    if told.isdigit() and int(told) > 0:
        return int(told)
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def set_threads(count: Optional[int]) -> None:
    """Sets the number of threads that calls use; `None` for as many as there are cores. Results do not depend on it."""
    global _count
    if count is not None and (isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 1024):
        raise Error(f"threads = {count!r}: give 1 to 1024, or None for all cores")
    _count = count
