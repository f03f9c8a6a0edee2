"""Progress: a bar, or a function of the caller's."""

from __future__ import annotations

import sys
import time
from typing import Any, Callable, Optional, Union

from ._plywave import Error

Progress = Union[bool, None, Callable[[str, str, int, int], Any]]
"""`True` for a bar, or a function of a stage's name, what it counts, done and in all."""


class _Bar:
    """A bar a stage: tqdm's where it is installed, which draws itself in notebooks too, else a line on stderr."""

    def __init__(self) -> None:
        try:
            from tqdm.auto import tqdm  # type: ignore[import-untyped,unused-ignore]
        except ImportError:
            tqdm = None
        self._tqdm: Any = tqdm
        self._bar: Any = None
        self._stage = ""
        self._told = 0.0

    def __call__(self, stage: str, unit: str, done: int, total: int) -> None:
        new = stage != self._stage
        if new:
            self.close()
            self._stage = stage
        if self._tqdm is not None:
            if new:
                self._bar = self._tqdm(total=total, desc=stage, unit=f" {unit}", unit_scale=True, leave=False)
            self._bar.total = total
            self._bar.update(done - self._bar.n)
            return
        now = time.monotonic()
        if not new and done < total and now - self._told < 0.25:
            return
        self._told = now
        share = done / total if total else 1.0
        sys.stderr.write(f"\r{stage:>9} [{'=' * int(32 * share):<32}] {100 * share:3.0f} %")
        sys.stderr.flush()

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        elif self._tqdm is None and self._stage:
            sys.stderr.write("\r" + " " * 56 + "\r")
            sys.stderr.flush()
        self._stage = ""


class Told:
    """What long work tells its progress to, for the time of a `with`."""

    def __init__(self, progress: Progress) -> None:
        if progress is not None and not isinstance(progress, bool) and not callable(progress):
            raise Error(f"progress = {progress!r}: give True, False, or a function of stage, unit, done and total")
        self._bar: Optional[_Bar] = _Bar() if progress is True else None
        self._call = progress if callable(progress) else self._bar

    def __enter__(self) -> Optional[Callable[[str, str, int, int], Any]]:
        return self._call

    def __exit__(self, *_: Any) -> None:
        if self._bar is not None:
            self._bar.close()
