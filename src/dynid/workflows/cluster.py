"""Where work is done side by side: in processes of this machine, or by the workers of a Dask scheduler of the lab.

Dask hands out the work, starts a worker that died again, repeats what it was doing and finds a scheduler that came
back. What Dask leaves to others is here: scheduler and workers of this machine as a child process of dynid, which takes
work from nobody else and imports nothing of the script that called dynid.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from dynid.errors import PackageMissing, SchedulerSilent, WorkersDied, WrongUsage
from dynid.progress import SILENT, Progress
from dynid.scratch import scratch_folder
from dynid.workflows import tuning

if TYPE_CHECKING:
    from distributed import Client

#: What a lab installs to have more than one worker.
PACKAGE = "pip install 'dynid[cluster]'"


def mapped(
    client: Client | None,
    function: Callable[..., Any],
    *arguments: Iterable[Any],
    progress: Progress = SILENT,
) -> Iterator[tuple[int, Any, BaseException | None]]:
    """Call a function with each item of some lists, as ``map`` does, and yield the calls as they end.

    Args:
        client: of the scheduler whose workers do it; None to do one call after another in this process.
        function: of a module, so that other processes find it.
        arguments: lists of equal length, one for each argument.
        progress: reports when the scheduler was lost.

    Yields:
        The number of the call, what it returned, and what it raised; None where it returned.

    Raises:
        SchedulerSilent: the scheduler went away and did not come back.
    """
    left = dict(enumerate(zip(*arguments, strict=True)))
    if client is None:
        for number, call in left.items():
            value, error = None, None
            try:
                value = function(*call)
            except Exception as raised:  # noqa: BLE001
                error = raised
            yield number, value, error
        return
    from concurrent.futures import CancelledError

    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    while left:
        futures = client.map(function, *zip(*left.values(), strict=True), pure=False)
        numbers = dict(zip([future.key for future in futures], left, strict=True))
        # Why so many kinds: what a lost scheduler raises depends on who notices first.
        with suppress(OSError, TimeoutError, CancelledError):
            for future in as_completed(futures, loop=client.loop):
                if future.status not in ("finished", "error"):
                    break
                number, ended = numbers[future.key], future.exception()
                if isinstance(ended, KilledWorker):
                    last = ended.last_worker.address
                    ended = WorkersDied(
                        f"{ended.allowed_failures + 1} workers died under it, the last one at {last}"
                    )
                value = None if ended else future.result()
                del left[number]
                yield number, value, ended
        if left:
            progress.stage(
                "scheduler", "does not answer; what was not done is done again when it is back"
            )
            if client.status not in ("running", "connecting"):
                raise SchedulerSilent("the Dask scheduler went away and did not come back")


def current_client() -> Client | None:
    """Return the client that this thread uses (``with client.as_current()``), None without one."""
    distributed = sys.modules.get("distributed")
    try:
        return None if distributed is None else distributed.Client.current(allow_global=False)
    except ValueError:
        return None


@contextmanager
def opened(
    workers: int,
    *,
    scheduler: str | None = None,
    memory: int | None = None,
    dashboard: bool = False,
    progress: Progress = SILENT,
) -> Iterator[Client | None]:
    """Give a Dask client whose workers do what is mapped, and end every process of this machine with the block.

    Args:
        workers: processes on this machine; with one of them, and without Dask, there is no client.
        scheduler: address of a Dask scheduler, whose workers are used instead.
        memory: what a worker of this machine may take [bytes]; an equal share of the machine's when None.
        dashboard: whether Dask shows what the workers of this machine do.
        progress: reports where the work is done.

    Raises:
        PackageMissing: a scheduler is given, and Dask is not installed.
        SchedulerSilent: nothing answers at its address.
        WorkersDied: it has no worker, or none of this machine starts.
    """
    if scheduler is not None and (memory is not None or dashboard):
        what = "the memory of workers and the dashboard are the scheduler's"
        raise WrongUsage(what, fix="leave out --memory and --dashboard")
    if dashboard and find_spec("bokeh") is None:
        raise PackageMissing("--dashboard needs bokeh", fix="pip install bokeh")
    if find_spec("distributed") is None:
        if scheduler is not None:
            raise PackageMissing("--scheduler needs Dask", fix=PACKAGE)
        if workers > 1:
            progress.stage(
                "workers", f"one after another in this process; {workers} at a time with {PACKAGE}"
            )
    if find_spec("distributed") is None or (scheduler is None and workers == 1):
        yield None
        return
    from distributed import Client
    from distributed.security import Security
    from distributed.system import MEMORY_LIMIT
    from distributed.utils import silence_logging_cmgr

    most = memory or MEMORY_LIMIT // workers
    # Why certificates: everybody on this machine could otherwise run code as its user through the open port.
    security = None if scheduler else Security.temporary()
    place = nullcontext(scheduler) if scheduler else _local(workers, most, dashboard, security)
    with silence_logging_cmgr(logging.CRITICAL + 1), place as address:
        try:
            client = Client(
                address, timeout=tuning.SCHEDULER_PATIENCE, security=security, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise SchedulerSilent(
                f"no Dask scheduler answers at {address}", where=str(address)
            ) from error
        try:
            try:
                client.wait_for_workers(1, timeout=tuning.SCHEDULER_PATIENCE)
            except TimeoutError as error:
                what = f"no worker has started in {tuning.SCHEDULER_PATIENCE:g} s"
                raise WorkersDied(
                    what, why="without them no job is done", fix="--jobs 1"
                ) from error
            here = f"{workers} processes on this machine, each ended beyond {most / 1e9:.1f} GB"
            text = f"the workers of {scheduler}" if scheduler else here
            progress.stage("workers", f"{text}{f'; {client.dashboard_link}' if dashboard else ''}")
            yield client
        finally:
            with suppress(OSError, TimeoutError, RuntimeError):
                client.close(timeout=1)


@contextmanager
def _local(workers: int, memory: int, dashboard: bool, security: Any) -> Iterator[str]:  # noqa: ANN401
    """Give the address of a scheduler on this machine, which ends with the block."""
    from dynid.children import command, environment

    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    with (
        scratch_folder() as folder,
        subprocess.Popen(
            command(__name__),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment() | threads,
            start_new_session=True,
        ) as child,
    ):
        assert child.stdin is not None
        assert child.stdout is not None
        pickle.dump((workers, memory, dashboard, security, str(folder)), child.stdin)
        child.stdin.flush()
        yield child.stdout.readline().decode().strip()


def main() -> None:
    """Be the scheduler of this machine, and see to its workers, until the standard input ends."""
    import dask
    from distributed import LocalCluster
    from distributed.core import Status

    # What comes is from the process that started this one.
    workers, memory, dashboard, security, folder = pickle.load(sys.stdin.buffer)  # noqa: S301
    dask.config.set(tuning.DASK | ({} if dashboard else {"distributed.scheduler.http.routes": []}))
    cluster = LocalCluster(
        n_workers=0,
        threads_per_worker=1,
        host="127.0.0.1",
        memory_limit=memory,
        dashboard_address=f"127.0.0.1:{8787 if dashboard else 0}",
        scheduler_kwargs={"dashboard": dashboard},
        security=security,
        local_directory=folder,
    )
    os.write(1, f"{cluster.scheduler_address}\n".encode())
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    parent = threading.Thread(target=sys.stdin.buffer.read, daemon=True)
    parent.start()
    while parent.is_alive():
        # Why: Dask starts a worker anew that died at work, and not one that died while it was started.
        for name, nanny in list(cluster.workers.items()):
            if nanny.status in (Status.failed, Status.closed):
                cluster.workers.pop(name, None)
        cluster.scale(workers)
        parent.join(tuning.WORKERS_SEEN_TO)
    # Why at once: what the workers write takes its name only when it is whole.
    for nanny in cluster.workers.values():
        if nanny.pid is not None:
            with suppress(OSError):
                os.kill(nanny.pid, signal.SIGKILL)
    os._exit(0)


if __name__ == "__main__":
    main()
