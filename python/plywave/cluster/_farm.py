"""The farm: which shards are missing, who runs them, what becomes of them."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import time
from collections import deque
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Callable, Deque, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

from .. import _plywave
from .._plywave import Error
from . import _items
from ._cache import Cache
from ._items import Item, Job, one_line
from ._workers import MAX_DEATHS, check_versions, local_workers

Block = Tuple[int, int]
Key = Tuple[int, int]
Told = Callable[[str, int, int], Any]
"""Progress: an item's name, shards done, shards in all."""

TASKS_A_SLOT = 8
"""Tasks of all items for each core of the workers: the last tasks are short, and the data that all shards of a job share is made on few workers."""

GROUPS_A_SLOT = 4
"""Groups for each core of the workers, of all items, from which on whole groups are run."""


LOOK_S = 0.5
"""Interval between two looks at the workers [s]."""

SILENT_S = 60.0
"""Longest time to wait for an answer of the scheduler [s]."""

MIN_REST_S, MAX_REST_S = 0.2, 5.0
"""How long a worker that did not take its data gets nothing [s]: at first, doubled each time, at most the last."""

GOES_ON = "finished work is in the cache: run it again"


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
    """Tasks that were run again."""
    damaged: int = 0
    """How often its shards were found damaged in the cache."""
    failed: str = ""


@dataclass
class _Task:
    """What one worker does: blocks of a job, or the end of an item."""

    work: _Work
    job: int
    blocks: List[Block]
    faults: int = 0
    """How often it came back damaged, or raised an error."""
    raised: str = ""
    """The kind of error that it raised last."""
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
    """Blocks to run: with `groups`, each group of which no shard is there; else single shards."""
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
    deaths: int = MAX_DEATHS,
    told: Optional[Told] = None,
) -> Iterator[Made]:
    """Makes items, and gives each when it is done. The same bits come out whatever the workers are, how many of them die, and how often; what is in the cache is not
    computed again. What is lost with a worker is run again and never counts against its item.

    Args:
        items: What to make, in this order.
        client: A Dask client (`connect`).
        cache: Cache of shards and files.
        retries: How often to repeat a task whose result is damaged before its item fails. An item also fails when a task raises the same error twice, and at once for an error of plywave's own.
        deaths: How many workers may die in a row while nothing is finished.
        told: Called with an item's name, its finished shards and all of them.

    Raises:
        Error: where the cache cannot be written, the scheduler is gone or silent, more workers than `deaths` died in a row, and for workers of another version.
    """
    run = _Farm(client, cache, retries, deaths, told)
    try:
        yield from run.all(items)
    finally:
        run.stop()


def is_loss(error: Optional[BaseException]) -> bool:
    """Whether an error is Dask's word for a worker, or a result, that is gone; the others are of the task itself."""
    dasks = error is None or type(error).__module__.partition(".")[0] in ("dask", "distributed", "tornado")
    return dasks or isinstance(error, (ConnectionError, TimeoutError, asyncio.TimeoutError, asyncio.CancelledError))


class _Farm:
    def __init__(self, client: Any, cache: Cache, retries: int, most_deaths: int, told: Optional[Told]) -> None:
        self.client, self.cache, self.retries, self.most_deaths, self.told = client, cache, retries, most_deaths, told
        self.tasks: Dict[str, _Task] = {}
        self.queue = _Queue()
        self.flying: Dict[str, int] = {}
        """Tasks that each worker has."""
        self.resting: Dict[str, Tuple[float, float]] = {}
        """Workers that did not take their data: until when they rest, and for how long [s]."""
        self.futures: Dict[str, Any] = {}
        self.ended: List[Made] = []
        """Items that were given up as their end was to be sent."""
        self.number = 0
        self.groups = False
        self.most_tasks = 1
        self.looked = 0.0
        self.local = local_workers(client)
        self.local_deaths = 0 if self.local is None else self.local.deaths
        self.deaths = 0
        """Workers that died, and what was lost with them, since something was finished."""
        self.last_words = ""

    def ask(self, call: Callable[[], Any]) -> Any:
        """What the scheduler answers."""
        try:
            return call()
        except (TimeoutError, asyncio.TimeoutError):
            raise Error(f"the scheduler has not answered for {SILENT_S:g} s; {GOES_ON}") from None
        except (OSError, RuntimeError, asyncio.CancelledError):
            raise Error(f"the connection to the scheduler is lost; {GOES_ON}") from None

    def threads(self) -> Dict[str, int]:
        """Threads of the workers that are there."""
        found: Dict[str, int] = self.ask(lambda: self.client.nthreads(callback_timeout=SILENT_S))
        return found

    def stop(self) -> None:
        if self.futures:
            # A scheduler that is gone has nothing to cancel.
            with contextlib.suppress(Exception):
                self.client.cancel(list(self.futures.values()), force=True)
        self.futures.clear()

    def all(self, items: Sequence[Item]) -> Iterator[Made]:
        left = []
        for item in items:
            kept = self.cache.made(item)
            if kept is None:
                left.append(item)
            else:
                yield Made(item, kept.data, "", {**kept.facts, "cached": True})
        if not left:
            return
        slots = max(1, sum(self.threads().values()))
        # Groups are added up on the worker: where all items together have enough of them, a group's bytes
        # travel in place of every shard's.
        groups = sum(-(-job.shards // job.group) for item in left for job in item.jobs)
        self.groups = groups >= GROUPS_A_SLOT * slots
        self.most_tasks = max(1, TASKS_A_SLOT * slots // max(1, len(left)))
        for item in left:
            self.begin(_Work(item))
        self.done = import_module("distributed").as_completed(with_results=False)
        self.fill()
        while self.futures or self.queue or self.ended:
            while self.ended:
                yield self.ended.pop()
            future = self.next()
            made = self.take(future) if future is not None else None
            if time.monotonic() - self.looked >= LOOK_S:
                self.look()
            self.fill()
            if made is not None:
                yield made

    def next(self) -> Any:
        """The next task that has ended; `None` after a while without one."""
        until = time.monotonic() + LOOK_S
        while time.monotonic() < until:
            if self.client.status == "closed":
                raise Error(f"the connection to the scheduler is lost; {GOES_ON}")
            while self.done.has_ready():
                future = next(self.done)
                # Others were called back.
                if self.futures.get(future.key) is future:
                    return future
            time.sleep(0.002)
        return None

    def look(self) -> None:
        """Counts workers that are gone, and takes back what was sent to them: Dask does not give it to one that comes after the last of them has died."""
        threads = self.threads()
        for worker in [worker for worker in self.flying if worker not in threads]:
            had = self.flying.pop(worker)
            # Those that `connect` started are counted where they are started.
            if had and self.local is None:
                self.lose(f"worker {worker} was lost")
        if self.local is not None and self.local.deaths > self.local_deaths:
            self.deaths += self.local.deaths - self.local_deaths - 1
            self.local_deaths = self.local.deaths
            self.lose(f"a worker ended with {self.local.last_words}")
        for key in [key for key, task in self.tasks.items() if task.worker not in threads]:
            future = self.futures[key]
            if future.done():
                # It came while this was looked at.
                continue
            self.ask(lambda: future.cancel(force=True))
            del self.futures[key]
            self.again(self.tasks.pop(key))
        self.looked = time.monotonic()

    def lose(self, words: str) -> None:
        """Counts a death; ends the farm where too many follow each other."""
        self.deaths, self.last_words = self.deaths + 1, words
        if self.deaths > self.most_deaths:
            names = sorted({task.work.item.name for task in self.tasks.values()} | {task.work.item.name for task in self.queue.first})
            left = f" (at work on {', '.join(names[:5])})" if names else ""
            raise Error(f"{self.deaths} workers died in a row and nothing was finished{left}; the last: {words}; {GOES_ON}")

    def again(self, task: _Task) -> None:
        """Has a task run again."""
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
        if not self.queue:
            return
        now = time.monotonic()
        for worker, count in sorted(self.threads().items(), key=lambda one: self.flying.get(one[0], 0) / max(1, one[1])):
            while self.flying.get(worker, 0) < 3 * count and self.resting.get(worker, (0.0, 0.0))[0] <= now:
                task = self.queue.take(worker)
                if task is None:
                    return
                if not task.work.failed and not self.submit(task, worker):
                    break

    def submit(self, task: _Task, worker: str) -> bool:
        """Sends a task, where the worker takes its data."""
        self.number += 1
        key = f"plywave-{task.work.item.name}-{task.job}-{self.number}"
        # A wish: where that worker dies, or has much to do while another has nothing, another one runs it.
        options = {"key": key, "pure": False, "retries": 0, "priority": -self.number, "workers": [worker], "allow_other_workers": True}
        if task.job < 0:
            shards = [self.bytes_of(job) for job in task.work.item.jobs]
            if any(found is None for found in shards):
                # Damaged since it was found whole: it is run again.
                self.mend(task.work)
                return True
            try:
                data = self.client.scatter(shards, workers=[worker], hash=False)
            except Exception as error:  # noqa: BLE001 - the worker died meanwhile: Dask has many words for that
                rest = min(max(2.0 * self.resting.get(worker, (0.0, 0.0))[1], MIN_REST_S), MAX_REST_S)
                self.resting[worker] = (time.monotonic() + rest, rest)
                self.again(task)
                self.lose(f"worker {worker} did not take its data, {one_line(error)}")
                return False
            self.resting.pop(worker, None)
            future = self.client.submit(_items.finish, task.work.item, data, **options)
        else:
            job = task.work.item.jobs[task.job]
            future = self.client.submit(_items.run_blocks, job.description, job.extent, task.blocks, **options)
        task.worker = worker
        self.flying[worker] = self.flying.get(worker, 0) + 1
        self.tasks[key], self.futures[key] = task, future
        self.done.add(future)
        return True

    def mend(self, work: _Work) -> None:
        """Has what is damaged in the cache of an item's shards run again."""
        work.retries, work.damaged = work.retries + 1, work.damaged + 1
        if work.damaged > self.retries:
            self.ended.append(self.give_up(work, f"{work.item.name}: its shards in the cache are damaged repeatedly"))
            return
        self.begin(work)

    def bytes_of(self, job: Job) -> Optional[List[Tuple[int, int, bytes]]]:
        files = list(self.cache.whole(job))
        return files if sum(count for _, count, _ in files) == job.shards else None

    def take(self, future: Any) -> Optional[Made]:
        """Takes up what a task left; gives its item where that is done or given up."""
        task = self.tasks.pop(future.key)
        del self.futures[future.key]
        if task.worker in self.flying:
            self.flying[task.worker] -= 1
        work = task.work
        if work.failed:
            return None
        result: Any = None
        if future.status == "finished":
            try:
                result = future.result()
            except Exception as error:  # noqa: BLE001 - the worker died with the result: whatever Dask calls that, it is run again
                self.died(task, error)
                return None
        else:
            why: Optional[BaseException] = None
            try:
                why = future.exception() if future.status == "error" else None
            except Exception as error:  # noqa: BLE001 - likewise
                self.died(task, error)
                return None
            if is_loss(why):
                self.died(task, why)
                return None
            # Of a worker without plywave, or with another version, the farm tells that.
            self.ask(lambda: check_versions(self.client))
            return self.give_up(work, str(why)) if isinstance(why, Error) else self.raised(task, why)
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
            return self.damaged(task, "damaged results")
        self.deaths = 0
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
            return self.damaged(task, one_line(error))
        self.deaths = 0
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

    def died(self, task: _Task, error: Optional[BaseException]) -> None:
        """A worker died with a task or its result."""
        self.again(task)
        self.lose(f"a task was lost, {one_line(error)}" if error is not None else "a task was lost")

    def damaged(self, task: _Task, words: str) -> Optional[Made]:
        """A worker returned a wrong or damaged result: another try."""
        task.faults += 1
        if task.faults > self.retries:
            return self.give_up(task.work, f"{task.work.item.name}: a task was lost {task.faults} times; last: {words}")
        self.again(task)
        return None

    def raised(self, task: _Task, error: Optional[BaseException]) -> Optional[Made]:
        """An error of the task itself: another worker may do better, once."""
        kind, task.faults = type(error).__name__, task.faults + 1
        if task.raised == kind or task.faults > self.retries:
            return self.give_up(task.work, f"{task.work.item.name}: {one_line(error)}")
        task.raised = kind
        self.again(task)
        return None

    def give_up(self, work: _Work, why: str) -> Made:
        work.failed = why
        return Made(work.item, None, why, {"shards": work.shards, "shard_seconds": work.seconds, "finish_seconds": 0.0, "retries": work.retries, "cached": False})
