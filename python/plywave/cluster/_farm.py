"""The farm: which shards are missing, who runs them, what becomes of them."""

from __future__ import annotations

import base64
import json
import time
from collections import deque
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Callable, Deque, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple, Union

from .. import _plywave
from .._plywave import Error
from . import _items
from ._cache import Cache
from ._items import Item, Job
from ._workers import check_versions

Block = Tuple[int, int]
Key = Tuple[int, int]
Told = Callable[[str, int, int], Any]
"""Progress: an item's name, shards done, shards in all."""

TASKS_A_SLOT = 8
"""Tasks of all items for each core of the workers: what is left at the end is short, and what all shards of a job need is made on few workers."""

GROUPS_A_SLOT = 4
"""Groups for each core of the workers, of all items, from which on whole groups are run."""


LOOK_S = 0.5
"""How often workers are looked at while nothing comes [s]."""


class Made(NamedTuple):
    """What became of an item."""

    item: Item
    data: Optional[bytes]
    """The file; `None` where it could not be made."""
    error: str
    """Why not."""
    facts: Dict[str, Any]
    """`shards`, `shard_seconds`, `finish_seconds` of one core, `retries`, and whether it was `cached`: of the run that made it."""


@dataclass
class _Work:
    """An item on its way."""

    item: Item
    left: Dict[int, int] = field(default_factory=dict)
    """Shards of each job that are not there."""
    shards: int = 0
    seconds: float = 0.0
    retries: int = 0
    failed: str = ""


@dataclass
class _Task:
    """What one worker does: blocks of a job, or the end of an item."""

    work: _Work
    job: int
    blocks: List[Block]
    tries: int = 0
    worker: str = ""
    """Where it was sent."""

    @property
    def key(self) -> Key:
        return (id(self.work), self.job)


class _Queue:
    """Tasks that wait, by job: what all shards of a job need is made once on each worker that has some of them, so a job keeps to its workers while there are others."""

    def __init__(self) -> None:
        self.first: Deque[_Task] = deque()
        """Ends of items and tasks that were lost: taken by whoever comes."""
        self.by_job: Dict[Key, Deque[_Task]] = {}
        self.nobodys: Deque[Key] = deque()
        """Jobs that no worker has yet, in order."""
        self.homes: Dict[str, Set[Key]] = {}
        """Jobs of a worker."""

    def __bool__(self) -> bool:
        return bool(self.first or self.by_job)

    def add(self, tasks: Sequence[_Task]) -> None:
        for task in tasks:
            if task.key not in self.by_job:
                self.by_job[task.key] = deque()
                self.nobodys.append(task.key)
            self.by_job[task.key].append(task)

    def take(self, worker: str) -> Optional[_Task]:
        """The next task for a worker: of a job that it has, of one that nobody has, of any."""
        if self.first:
            return self.first.popleft()
        home = self.homes.setdefault(worker, set())
        home.intersection_update(self.by_job)
        while not home:
            if not self.by_job:
                return None
            key = self.nobodys.popleft() if self.nobodys else next(iter(self.by_job))
            if key in self.by_job:
                home.add(key)
        key = next(iter(home))
        task = self.by_job[key].popleft()
        if not self.by_job[key]:
            del self.by_job[key]
        return task


def missing(job: Job, there: Sequence[Block], groups: bool) -> List[Block]:
    """Blocks that are to be run: groups, where they are asked for and nothing of them is there, else single shards."""
    have: Set[int] = set()
    for first, count in there:
        have.update(range(first, first + count))
    blocks: List[Block] = []
    at = 0
    while at < job.shards:
        end = min(at - at % job.group + job.group, job.shards)
        if groups and at % job.group == 0 and have.isdisjoint(range(at, end)):
            blocks.append((at, end - at))
            at = end
            continue
        if at not in have:
            blocks.append((at, 1))
        at += 1
    return blocks


def check_report(data: bytes, name: str) -> None:
    """Refuses what is no report of a comparison."""
    try:
        report = json.loads(data)
        good = bool(report["instances"]) and all(case["resolutions"] and case["energies"] for case in report["cases"]) and bool(report["cases"])
    except (ValueError, TypeError, KeyError):
        good = False
    if not good:
        raise Error(f"{name}: no report of a comparison; make it again")


def farm(
    items: Sequence[Item],
    client: Any,
    cache: Cache,
    *,
    retries: int = 5,
    told: Optional[Told] = None,
) -> Iterator[Made]:
    """Makes items, and gives each when it is done. The same bits come out whatever the workers are, how many of them die, and how often; what is in the cache is not
    computed again.

    Args:
        items: What is to be made, the first first.
        client: A Dask client (`connect`).
        cache: Where shards and files are kept.
        retries: How often a task may be lost, or come back damaged, before its item is given up.
        told: Called with an item's name, its finished shards and all of them.

    Raises:
        Error: where the cache cannot be written, and for workers of another version.
    """
    run = _Farm(client, cache, retries, told)
    try:
        yield from run.all(items)
    finally:
        run.stop()


class _Farm:
    def __init__(self, client: Any, cache: Cache, retries: int, told: Optional[Told]) -> None:
        self.client, self.cache, self.retries, self.told = client, cache, retries, told
        self.tasks: Dict[str, _Task] = {}
        self.queue = _Queue()
        self.flying: Dict[str, int] = {}
        """Tasks that each worker has."""
        self.futures: Dict[str, Any] = {}
        self.number = 0
        self.groups = False
        self.most_tasks = 1

    def slots(self) -> int:
        return max(1, int(sum(self.client.nthreads().values())))

    def stop(self) -> None:
        if self.futures:
            try:
                self.client.cancel(list(self.futures.values()), force=True)
            except (OSError, RuntimeError, TimeoutError):
                # A scheduler that is gone has nothing to cancel.
                pass
        self.futures.clear()

    def all(self, items: Sequence[Item]) -> Iterator[Made]:
        left = []
        for item in items:
            kept = self.cache.made(item)
            if kept is None:
                left.append(item)
            else:
                yield Made(item, kept.data, "", {**kept.facts, "cached": True})
        # Groups are added up on the worker: where all items together have enough of them, a group's bytes travel in place of every shard's.
        groups = sum(-(-job.shards // job.group) for item in left for job in item.jobs)
        self.groups = groups >= GROUPS_A_SLOT * self.slots()
        self.most_tasks = max(1, TASKS_A_SLOT * self.slots() // max(1, len(left)))
        for item in left:
            self.begin(_Work(item))
        self.done = import_module("distributed").as_completed(with_results=False)
        self.fill()
        while self.futures or self.queue:
            future = self.next()
            made = self.take(future) if future is not None else None
            self.fill()
            if made is not None:
                yield made

    def next(self) -> Any:
        """The next task that has ended; `None` after a while without one."""
        until = time.monotonic() + LOOK_S
        while time.monotonic() < until:
            if self.client.status == "closed":
                raise Error("the scheduler is gone; what is finished is in the cache: run it again")
            while self.done.has_ready():
                future = next(self.done)
                # Others were called back.
                if self.futures.get(future.key) is future:
                    return future
            time.sleep(0.002)
        self.call_back()
        return None

    def call_back(self) -> None:
        """Takes back what was sent to workers that are gone: Dask does not give it to one that comes after the last of them has died."""
        threads = self.client.nthreads()
        for key in [key for key, task in self.tasks.items() if task.worker not in threads]:
            task, future = self.tasks.pop(key), self.futures.pop(key)
            if future.done():
                # It came while this was looked at.
                self.tasks[key], self.futures[key] = task, future
                continue
            future.cancel(force=True)
            self.flying[task.worker] -= 1
            task.work.retries += 1
            self.queue.first.append(task)

    def begin(self, work: _Work) -> None:
        """What of an item is missing."""
        for at, job in enumerate(work.item.jobs):
            blocks = missing(job, self.cache.shards(job), self.groups)
            work.left[at] = sum(count for _, count in blocks)
            size = max(1, -(-len(blocks) // self.most_tasks))
            self.queue.add([_Task(work, at, blocks[k : k + size]) for k in range(0, len(blocks), size)])
        if not any(work.left.values()):
            self.queue.first.append(_Task(work, -1, []))

    def fill(self) -> None:
        """Keeps workers busy, with no more in flight than they will soon take up."""
        threads = self.client.nthreads()
        for worker, count in sorted(threads.items(), key=lambda one: self.flying.get(one[0], 0) / max(1, one[1])):
            while self.flying.get(worker, 0) < 3 * count:
                task = self.queue.take(worker)
                if task is None:
                    return
                if not task.work.failed:
                    self.submit(task, worker)

    def submit(self, task: _Task, worker: str) -> None:
        self.number += 1
        key = f"plywave-{task.work.item.name}-{task.job}-{self.number}"
        # A wish: where that worker dies, or has much to do while another has nothing, another one runs it.
        options = {"key": key, "pure": False, "retries": 0, "priority": -self.number, "workers": [worker], "allow_other_workers": True}
        if task.job < 0:
            shards = [self.bytes_of(job) for job in task.work.item.jobs]
            if any(found is None for found in shards):
                # Damaged since it was found whole: it is run again.
                self.again(task.work)
                return
            # As one future: a worker that dies loses nothing that the scheduler cannot send again.
            data = self.client.scatter(shards, hash=False)
            future = self.client.submit(_items.finish, task.work.item, data, **options)
        else:
            job = task.work.item.jobs[task.job]
            future = self.client.submit(_items.run_blocks, job.description, job.extent, task.blocks, **options)
        task.worker = worker
        self.flying[worker] = self.flying.get(worker, 0) + 1
        self.tasks[key], self.futures[key] = task, future
        self.done.add(future)

    def again(self, work: _Work) -> None:
        work.retries += 1
        if work.retries > self.retries:
            work.failed = "its shards are damaged in the cache again and again"
            return
        self.begin(work)

    def bytes_of(self, job: Job) -> Optional[List[Tuple[int, int, bytes]]]:
        files = list(self.cache.whole(job))
        return files if sum(count for _, count, _ in files) == job.shards else None

    def take(self, future: Any) -> Optional[Made]:
        """Takes up what a task left; gives its item where that is done or given up."""
        task = self.tasks.pop(future.key)
        del self.futures[future.key]
        self.flying[task.worker] -= 1
        work = task.work
        if work.failed:
            return None
        result: Any = None
        if future.status == "finished":
            try:
                result = future.result()
            except Exception as error:  # noqa: BLE001 - the worker died with the result: whatever Dask calls that, it is run again
                return self.lost(task, error)
        else:
            why: Optional[BaseException] = None
            try:
                why = future.exception() if future.status == "error" else None
            except Exception as error:  # noqa: BLE001 - likewise
                why = error
            if isinstance(why, Error):
                check_versions(self.client)
                return self.give_up(work, str(why))
            return self.lost(task, why)
        if task.job < 0:
            return self.finished(task, result)
        job = work.item.jobs[task.job]
        whole = {(first, count) for first, count, _ in result.files} == set(task.blocks)
        for first, count, data in result.files:
            try:
                _plywave.check_block(job.description, job.extent, first, count, data, _plywave.block_name(first, count))
            except Error:
                whole = False
        if not whole:
            return self.lost(task, None)
        for first, count, data in result.files:
            self.cache.keep_shard(job, first, count, data)
            work.left[task.job] -= count
            work.shards += count
        work.seconds += result.seconds
        if self.told is not None:
            total = sum(job.shards for job in work.item.jobs)
            self.told(work.item.name, total - sum(work.left.values()), total)
        if not any(work.left.values()):
            self.queue.first.append(_Task(work, -1, []))
        return None

    def finished(self, task: _Task, result: Any) -> Optional[Made]:
        work = task.work
        try:
            if work.item.kind == "fiber":
                from .._fiber import Fiber

                Fiber.from_bytes(result.data)
            elif work.item.kind == "compare":
                check_report(result.data, work.item.name)
            else:
                _plywave.check_bytes(work.item.file_kind, result.data, work.item.name)
        except Error as error:
            return self.lost(task, error)
        facts = {
            "name": work.item.name,
            "version": _plywave.__version__,
            "shards": work.shards,
            "shard_seconds": work.seconds,
            "finish_seconds": result.seconds,
            "retries": work.retries,
            "picture": base64.b64encode(result.picture).decode() if result.picture else "",
            "finished": time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime()),
        }
        kept = self.cache.keep(work.item, result.data, facts)
        return Made(work.item, kept.data, "", {**kept.facts, "cached": False})

    def lost(self, task: _Task, error: Union[BaseException, None]) -> Optional[Made]:
        """A worker died, or what it sent is damaged: another try."""
        task.tries += 1
        task.work.retries += 1
        if task.tries > self.retries:
            why = f"{type(error).__name__}: {error}".splitlines()[0] if error is not None else "damaged results"
            return self.give_up(task.work, f"{task.work.item.name}: a task was lost {task.tries} times; last: {why}")
        self.queue.first.append(task)
        return None

    def give_up(self, work: _Work, why: str) -> Made:
        work.failed = why
        return Made(work.item, None, why, {"shards": work.shards, "shard_seconds": work.seconds, "finish_seconds": 0.0, "retries": work.retries, "cached": False})
