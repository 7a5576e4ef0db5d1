"""Where tasks run: one after another in this process, in workers of this machine, or on a Dask scheduler of the lab.

A task is a function with arguments; an argument may stand for what another task returns. Wherever they run, equal tasks
give equal results: nothing depends on how many workers there are or on who finishes first. A worker that dies loses
only what it was doing, which is done again elsewhere; so does a scheduler that goes away and comes back.
"""

from __future__ import annotations

import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Protocol

from dynid.children import variables
from dynid.errors import PackageMissing, SchedulerSilent, WorkersDied, WrongUsage
from dynid.progress import SILENT, Progress
from dynid.scratch import scratch_folder

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

#: Workers that may die under one task before it is taken to be what kills them.
DEATHS = 12
#: How long a scheduler that does not answer is waited for [s].
PATIENCE = 60.0
#: How long a first connection may take [s].
FIRST_ANSWER = 10.0
#: How often it is seen to that the workers of this machine are all there [s].
KEEP = 1.0
#: A worker that is away for so long is not being started again any more [s].
AWAY = 30
#: What a lab installs to have more than one worker.
PACKAGE = "pip install 'dynid[cluster]'"


@dataclass(frozen=True)
class Of:
    """Stands among the arguments of a task, or in a list among them, for what another task returns.

    Attributes:
        name: of that task.
    """

    name: str


@dataclass(frozen=True)
class Task:
    """A piece of work.

    Attributes:
        function: of a module, so that other processes find it.
        arguments: what it is called with.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()

    @property
    def needs(self) -> list[str]:
        """Names of the tasks whose results it is called with."""
        return [each.name for item in self.arguments for each in _listed(item) if isinstance(each, Of)]

    def with_results(self, found: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return the arguments with results in place of names."""
        return tuple(
            [_filled(each, found) for each in item] if isinstance(item, list) else _filled(item, found)
            for item in self.arguments
        )


def _listed(item: Any) -> Sequence[Any]:  # noqa: ANN401
    return item if isinstance(item, list) else [item]


def _filled(item: Any, found: Mapping[str, Any]) -> Any:  # noqa: ANN401
    return found[item.name] if isinstance(item, Of) else item


@dataclass(frozen=True)
class Done:
    """How a task ended.

    Attributes:
        name: of the task.
        value: what it returned.
        error: what it raised; None where it returned.
    """

    name: str
    value: Any = None
    error: BaseException | None = None


class Pool(Protocol):
    """Something that runs tasks."""

    @property
    def text(self) -> str:
        """What it is, for people."""

    def run(self, tasks: Mapping[str, Task], wanted: Sequence[str]) -> Iterator[Done]:
        """Run tasks, each of which stands behind those that it needs, and yield the wanted ones as they end."""


@dataclass(frozen=True)
class Here:
    """Runs tasks one after another in this process.

    Attributes:
        text: what it is, for people.
    """

    text: str = "one after another in this process"

    def run(self, tasks: Mapping[str, Task], wanted: Sequence[str]) -> Iterator[Done]:
        """Run tasks in their order; what no further task needs is let go."""
        found: dict[str, Any] = {}
        failed: dict[str, BaseException] = {}
        uses = Counter(name for task in tasks.values() for name in task.needs)
        for name, task in tasks.items():
            error = next((failed[need] for need in task.needs if need in failed), None)
            if error is None:
                try:
                    found[name] = task.function(*task.with_results(found))
                except Exception as raised:  # noqa: BLE001
                    error = raised
            if error is not None:
                failed[name] = error
            if name in wanted:
                yield Done(name, found.get(name), error)
            for need in task.needs:
                uses[need] -= 1
            for each in (*task.needs, name):
                if not uses[each]:
                    found.pop(each, None)


class Cluster:
    """Runs tasks on the workers of a Dask scheduler.

    Args:
        connect: returns a client, and raises OSError where no scheduler answers.
        text: what it is, for people.
        progress: told when a scheduler was lost.
    """

    def __init__(self, connect: Callable[[], Client], text: str, progress: Progress = SILENT) -> None:
        self._connect, self.text, self._progress = connect, text, progress
        self._client: Client | None = connect()

    def run(self, tasks: Mapping[str, Task], wanted: Sequence[str]) -> Iterator[Done]:
        """Run tasks side by side; those that a lost worker or scheduler had are run again."""
        left = dict.fromkeys(wanted)
        deaths: Counter[str] = Counter()
        while left:
            for done in self._until_lost(tasks, list(left), deaths):
                del left[done.name]
                yield done
            if left:
                self._reconnect()

    def close(self) -> None:
        """Let the scheduler go."""
        if self._client is not None:
            with suppress(OSError, TimeoutError, RuntimeError):
                self._client.close(timeout=1)
            self._client = None

    def _until_lost(self, tasks: Mapping[str, Task], wanted: list[str], deaths: Counter[str]) -> Iterator[Done]:
        """Run tasks, and return early where the scheduler is lost."""
        from concurrent.futures import CancelledError

        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        assert self._client is not None
        mark = os.urandom(4).hex()
        futures: dict[str, Any] = {}
        names: dict[str, str] = {}
        try:
            for name in _needed(tasks, wanted):
                key = f"{tasks[name].function.__name__}-{mark}-{len(futures)}"
                names[key] = name
                futures[name] = self._client.submit(
                    tasks[name].function, *tasks[name].with_results(futures), key=key, pure=False
                )
            ended = as_completed([futures[name] for name in wanted], loop=self._client.loop)
            for future in ended:
                name = names[future.key]
                if future.status == "finished":
                    yield Done(name, future.result())
                elif future.status == "error":
                    error = future.exception()
                    if isinstance(error, KilledWorker):
                        deaths[name] += error.allowed_failures + 1
                        if deaths[name] <= DEATHS:
                            future.retry()
                            ended.add(future)
                            continue
                        error = WorkersDied(
                            f"{deaths[name]} workers died under it, the last one at {error.last_worker.address}"
                        )
                    yield Done(name, error=error)
                else:
                    return
        # Why so many kinds: what a lost scheduler raises depends on who notices first.
        except (OSError, TimeoutError, CancelledError):
            return

    def _reconnect(self) -> None:
        self._progress.stage("scheduler", "does not answer; what was not done is done again when it is back")
        self.close()
        end = time.monotonic() + PATIENCE
        while True:
            try:
                self._client = self._connect()
                return
            except SchedulerSilent:
                if time.monotonic() > end:
                    raise


def _needed(tasks: Mapping[str, Task], wanted: Sequence[str]) -> list[str]:
    """Return the tasks that the wanted ones rest on, and those, in the order in which they are given."""
    found, waiting = set(wanted), list(wanted)
    while waiting:
        fresh = [need for need in tasks[waiting.pop()].needs if need not in found]
        found.update(fresh)
        waiting += fresh
    return [name for name in tasks if name in found]


@contextmanager
def opened(
    workers: int,
    *,
    scheduler: str | None = None,
    memory: int | None = None,
    dashboard: bool = False,
    progress: Progress = SILENT,
) -> Iterator[Pool]:
    """Give what runs tasks, and end every process of it with the block.

    Args:
        workers: processes on this machine; with one of them tasks run in this process.
        scheduler: address of a Dask scheduler, whose workers are used instead.
        memory: what a worker of this machine may take [bytes]; an equal share of the machine's when None.
        dashboard: whether Dask shows what the workers of this machine do.
        progress: told where the tasks run.

    Raises:
        PackageMissing: a scheduler is given, and Dask is not installed.
        SchedulerSilent: nothing answers at its address.
    """
    there = find_spec("distributed") is not None
    if scheduler is not None:
        if not there:
            raise PackageMissing("--scheduler needs Dask", fix=PACKAGE)
        if memory is not None or dashboard:
            raise WrongUsage(
                "the memory of workers and the dashboard are the scheduler's", fix="leave out --memory and --dashboard"
            )
        with _remote(scheduler, progress) as pool:
            yield pool
    elif workers > 1 and there:
        with _local(workers, memory, dashboard, progress) as pool:
            yield pool
    else:
        if workers > 1:
            progress.stage("workers", f"{Here.text}; {workers} at a time with {PACKAGE}")
        yield Here()


@contextmanager
def _remote(address: str, progress: Progress) -> Iterator[Pool]:
    import dask

    with quiet_logs(), dask.config.set({"distributed.comm.timeouts.connect": FIRST_ANSWER}):
        pool = Cluster(lambda: _client(address), f"the workers of {address}", progress)
        progress.stage("workers", pool.text)
        try:
            yield pool
        finally:
            pool.close()


def _client(address: str) -> Client:
    from distributed import Client

    try:
        return Client(address, timeout=FIRST_ANSWER, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise SchedulerSilent(f"no Dask scheduler answers at {address}", where=address) from error


@contextmanager
def _local(workers: int, memory: int | None, dashboard: bool, progress: Progress) -> Iterator[Pool]:
    import dask
    from distributed import Client, LocalCluster
    from distributed.security import Security
    from distributed.system import MEMORY_LIMIT

    if dashboard and find_spec("bokeh") is None:
        raise PackageMissing("--dashboard needs bokeh", fix="pip install bokeh")
    with quiet_logs(), scratch_folder() as folder, dask.config.set(_settings(dashboard)):
        most = MEMORY_LIMIT // workers if memory is None else memory
        # Why certificates: everybody on this machine could otherwise run code as its user through the open port.
        cluster = LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            memory_limit=most,
            dashboard_address="127.0.0.1:8787" if dashboard else "127.0.0.1:0",
            scheduler_kwargs={"dashboard": dashboard},
            security=Security.temporary(),
            silence_logs=logging.CRITICAL,
            local_directory=str(folder),
        )
        stop = Event()
        keeper = Thread(target=_keep, args=(cluster, workers, stop), daemon=True)
        keeper.start()
        try:
            _wait_for_one(cluster)
            text = f"{workers} processes on this machine, each ended beyond {most / 1e9:.1f} GB"
            pool = Cluster(lambda: Client(cluster, set_as_default=False), text, progress)
            progress.stage("workers", f"{text}{f'; {cluster.dashboard_link}' if dashboard else ''}")
            yield pool
            pool.close()
        except BaseException:
            stop.set()
            _end_workers(cluster)
            raise
        finally:
            stop.set()
            keeper.join()
            with suppress(OSError, TimeoutError, RuntimeError):
                cluster.close(timeout=2)


def _keep(cluster: LocalCluster, workers: int, stop: Event) -> None:
    """Start the workers, and anew those that died while they were started, which nobody else does."""
    from distributed.core import Status

    while True:
        for name, nanny in list(cluster.workers.items()):
            if nanny.status in (Status.failed, Status.closed):
                cluster.workers.pop(name, None)
        cluster.scale(workers)
        if stop.wait(KEEP):
            return


def _wait_for_one(cluster: LocalCluster) -> None:
    """Wait until a worker is there.

    Raises:
        WorkersDied: none has come.
    """
    end = time.monotonic() + PATIENCE
    while not cluster.scheduler_info["workers"]:
        if time.monotonic() > end:
            what = f"no worker has started in {PATIENCE:g} s"
            raise WorkersDied(what, why="without them no job is done", fix="--jobs 1")
        time.sleep(0.05)


def _settings(dashboard: bool) -> dict[str, Any]:
    routes: dict[str, Any] = {} if dashboard else {"distributed.scheduler.http.routes": []}
    return routes | {
        "distributed.worker.http.routes": [],
        "distributed.worker.profile.enabled": dashboard,
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.deploy.lost-worker-timeout": f"{AWAY}s",
        # Why nothing but the last: a task holds its memory itself, so a worker that waits for less would wait for ever.
        "distributed.worker.memory.target": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        "distributed.worker.memory.terminate": 0.95,
        # Why slower than usual: processes that only wait would take a tenth of a core.
        "distributed.worker.memory.monitor-interval": "500ms",
        "distributed.admin.tick.interval": "500ms",
        "distributed.admin.system-monitor.interval": "5s",
        # Why without Dask's limit for giving memory back to the system: arrays then cost a third more processor.
        "distributed.nanny.pre-spawn-environ": {
            **{f"{name}_NUM_THREADS": 1 for name in ("OMP", "OPENBLAS", "MKL")},
            "PYTHONSAFEPATH": variables()["PYTHONSAFEPATH"],
        },
    }


def _end_workers(cluster: LocalCluster) -> None:
    """End the workers at once: what they write takes its name only when it is whole."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
        if nanny.pid is not None:
            with suppress(OSError):
                os.kill(nanny.pid, 9)


@contextmanager
def quiet_logs() -> Iterator[None]:
    """Keep Dask's own log off the terminal: what matters of it is an error of a task, or a stage."""
    import distributed  # noqa: F401

    # Why each by name: Dask gives them levels of their own.
    families = ("distributed", "asyncio", "tornado")
    names = [*families, *(name for name in logging.root.manager.loggerDict if name.split(".")[0] in families)]
    logs = [logging.getLogger(name) for name in names]
    before = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in zip(logs, before, strict=True):
            log.setLevel(level)
