"""A cache of shards and finished files by what they depend on."""

from __future__ import annotations

import hashlib
import json
import os
import re
import uuid
from importlib import import_module
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Set, Tuple

from .. import _plywave
from .._files import PathLike
from .._plywave import Error
from ._items import Item, Job

_NAME = re.compile(r"shard-(\d+)(?:-(\d+))?\.pwp$")


class Kept(NamedTuple):
    """A finished file."""

    data: bytes
    facts: Dict[str, Any]


class Cache:
    """A folder, or an fsspec URL: `shards/` by the SHA-256 of a job's description, `made/` by that of all that a file depends on.

    Files are written whole or not at all, so that several farms may use one cache at a time. What is read is checked; what is damaged counts as not there and is
    made again.
    """

    def __init__(self, path: PathLike) -> None:
        """Opens a cache, or makes it where there is none.

        Raises:
            Error: where it cannot be made.
        """
        self._name = os.fspath(path)
        try:
            self._fs, self._root = import_module("fsspec").core.url_to_fs(self._name)
            self._fs.makedirs(self._root, exist_ok=True)
        except (OSError, ValueError, ImportError) as error:
            raise Error(f"{self._name}: {error}; give a folder, or a URL that fsspec knows") from None
        self.damaged = 0
        """Files that were not whole."""

    def _write(self, path: str, data: bytes) -> None:
        # A name of its own, then a move: on a disk a name is taken at once or not at all.
        part = f"{path}.{uuid.uuid4().hex}.tmp"
        try:
            self._fs.makedirs(os.path.dirname(path), exist_ok=True)
            self._fs.pipe_file(part, data)
            self._fs.mv(part, path)
        except OSError as error:
            try:
                self._fs.rm_file(part)
            except OSError:
                pass
            raise Error(f"{path}: {error.strerror or error}; what was finished before is kept: run it again") from None

    def _read(self, path: str) -> Optional[bytes]:
        try:
            return bytes(self._fs.cat_file(path))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise Error(f"{path}: {error.strerror or error}") from None

    def _folder(self, job: Job) -> str:
        return f"{self._root}/shards/{job.digest[:2]}/{job.digest}"

    def _path(self, job: Job, first: int, count: int) -> str:
        return f"{self._folder(job)}/{_plywave.block_name(first, count)}"

    def shards(self, job: Job) -> List[Tuple[int, int]]:
        """Blocks of a job that are there and whole: first shard and number of shards, each shard once."""
        return sorted((first, count) for first, count, _ in self.whole(job))

    def whole(self, job: Job) -> Iterator[Tuple[int, int, bytes]]:
        """The same with their bytes, each read and checked once; groups first."""
        try:
            names = sorted(os.path.basename(str(name)) for name in self._fs.ls(self._folder(job), detail=False))
        except (FileNotFoundError, NotADirectoryError):
            return
        found = []
        for name in names:
            match = _NAME.fullmatch(name)
            if match:
                first = int(match[1])
                found.append((first, int(match[2]) - first + 1 if match[2] else 1))
        # Groups before their shards; what runs over the end is of a longer job.
        taken: Set[int] = set()
        for first, count in sorted(found, key=lambda block: (-block[1], block[0])):
            if first + count > job.shards or taken.intersection(range(first, first + count)):
                continue
            data = self.shard(job, first, count)
            if data is not None:
                yield first, count, data
                taken.update(range(first, first + count))

    def shard(self, job: Job, first: int, count: int) -> Optional[bytes]:
        """The bytes of a block, `None` where it is not there or damaged."""
        path = self._path(job, first, count)
        data = self._read(path)
        if data is None:
            return None
        try:
            _plywave.check_block(job.description, job.extent, first, count, data, path)
        except Error:
            self.damaged += 1
            return None
        return data

    def keep_shard(self, job: Job, first: int, count: int, data: bytes) -> None:
        """Keeps a block that has been checked."""
        self._write(self._path(job, first, count), data)

    def made(self, item: Item) -> Optional[Kept]:
        """An item's file, `None` where it is not there or damaged."""
        path = f"{self._root}/made/{item.key}.{item.extension}"
        data, facts = self._read(path), self._read(path + ".json")
        if data is None or facts is None:
            return None
        try:
            known = json.loads(facts)
            if known["sha256"] != hashlib.sha256(data).hexdigest():
                raise ValueError
        except (ValueError, KeyError, TypeError):
            self.damaged += 1
            return None
        return Kept(data, known)

    def keep(self, item: Item, data: bytes, facts: Dict[str, Any]) -> Kept:
        """Keeps an item's file, with facts about how it was made."""
        kept = Kept(data, {**facts, "sha256": hashlib.sha256(data).hexdigest()})
        path = f"{self._root}/made/{item.key}.{item.extension}"
        self._write(path, data)
        self._write(path + ".json", json.dumps(kept.facts, indent=1, sort_keys=True).encode())
        return kept
