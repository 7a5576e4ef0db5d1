"""Multi-start search for an exciting motion: L-BFGS with exact gradients, in processes of their own.

Every iterate keeps the joint limits, so whatever was best when the time is over or the person presses Ctrl-C is a plan.
Start k depends on the seed and on k only: when all starts finish in time, equal inputs give the equal plan.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.model.regressor import Model
from dynid.progress import SILENT, Progress
from dynid.trajectory.feasible import Shaping
from dynid.trajectory.objective import Objective, Problem

Floats = NDArray[np.float64]

#: Power of the p-norm and iterations of each stage: smooth costs first, the cost itself last.
STAGES = ((2.0, 60), (8.0, 60), (np.inf, 200))
#: Costs without extreme eigenvalues are smooth as they are.
SMOOTH_STAGES = ((np.inf, 250),)
#: A start is given up when its logarithmic cost is so much worse than the best one before the last stage.
HOPELESS = 0.35
#: Seconds between two reports of the best so far.
REPORT = 0.5


@dataclass(frozen=True)
class Search:
    """How long and how hard to search.

    Attributes:
        restarts: number of starts.
        seconds: time limit [s].
        seed: seed of the starts.
        processes: processes at work; the processor's cores when None.
    """

    restarts: int = 5
    seconds: float = 60.0
    seed: int = 0
    processes: int | None = None


@dataclass(frozen=True)
class Candidate:
    """A motion that the search found.

    Attributes:
        value: cost with penalties.
        coefficients: of the problem's basis, (k, n).
        start: number of the start.
    """

    value: float
    coefficients: Floats
    start: int


def optimise(problem: Problem, search: Search, progress: Progress = SILENT) -> list[Candidate]:
    """Search for the motion of least cost; Ctrl-C ends the search and keeps what was found.

    Returns:
        The best motion of every start, the best first.

    Raises:
        KeyboardInterrupt: interrupted before anything was found.
    """
    best: dict[int, tuple[float, Floats]] = {}
    begin = time.monotonic()
    with _workers(problem, search) as (reports, running):
        try:
            while any(process.is_alive() for process in running) or not reports.empty():
                left = begin + search.seconds - time.monotonic()
                if left <= 0 and best:
                    break
                # Why: in the first seconds of a very short search there may be nothing yet to keep.
                with suppress(queue.Empty):
                    start, value, x = reports.get(timeout=min(max(left, 0.1), 0.5))
                    best[start] = min(best.get(start, (np.inf, x)), (value, x), key=lambda pair: pair[0])
                if best:
                    least = min(value for value, _ in best.values())
                    done = min(time.monotonic() - begin, search.seconds)
                    progress.advance(done, search.seconds, f"best {describe(problem, least)}")
        except KeyboardInterrupt:
            if not best:
                raise
    shaping = Shaping(problem.basis, problem.limits, np.zeros(1))
    found = [Candidate(value, shaping.coefficients(x), start) for start, (value, x) in best.items()]
    return sorted(found, key=lambda candidate: candidate.value)


def describe(problem: Problem, value: float) -> str:
    """Return a cost in words."""
    cost = problem.cost
    if cost.kind == "condition":
        return f"condition number {np.exp(value):.1f}"
    if cost.kind == "i":
        return f"expected torque error {np.exp(value / 2) / np.sqrt(problem.model.robot.n):.2g}"
    return f"cost {np.exp(value):.3g}" if cost.kind == "paper" else f"-log det / p {value:.3f}"


@contextmanager
def _workers(problem: Problem, search: Search) -> Iterator[tuple[Any, list[Any]]]:
    """Run the search in processes that end with the block."""
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    # Why: the effect columns of a model are functions, which do not travel between processes; they are made anew.
    sent = replace(problem, model=Model(problem.model.robot, problem.model.rigid))
    count = max(1, min(search.processes or os.cpu_count() or 1, search.restarts))
    running = [context.Process(target=_work, args=(sent, search, k, count, reports), daemon=True) for k in range(count)]
    with _modest_children():
        for process in running:
            process.start()
    try:
        yield reports, running
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.join()
        reports.cancel_join_thread()
        reports.close()


@contextmanager
def _modest_children() -> Iterator[None]:
    """Let new processes do linear algebra in one thread, and leave Ctrl-C to the one that shows the progress.

    Matrices are small, and threads would fight for the cores. Ctrl-C reaches every process of the terminal; a child
    that is still importing would answer it with a traceback.
    """
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, handler)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _work(problem: Problem, search: Search, first: int, step: int, reports: Any) -> None:  # noqa: ANN401
    """Search from every ``step``-th start and report the best so far of each."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    objective = Objective(problem)
    best = np.inf
    for start in range(first, search.restarts, step):
        report = _Report(start, reports)
        x = objective.shaping.random(np.random.default_rng((search.seed, start)))
        best = min(best, descend(objective, x, best, report)[0])


class _Report:
    """Sends improvements of one start, not more often than a person can read."""

    def __init__(self, start: int, reports: Any) -> None:  # noqa: ANN401
        self._start, self._reports = start, reports
        self._best, self._sent = np.inf, 0.0

    def __call__(self, value: float, x: Floats, *, last: bool) -> None:
        now = time.monotonic()
        if value < self._best and (last or now - self._sent > REPORT):
            self._best, self._sent = value, now
            self._reports.put((self._start, value, x))


def descend(
    objective: Objective, x: Floats, best: float = np.inf, report: Callable[..., None] | None = None
) -> tuple[float, Floats]:
    """Go down from one start through the stages.

    Args:
        objective: what is made small.
        x: start.
        best: cost of the best motion so far; a start far from it is given up before the last stage.
        report: called with value and variables of improvements of the cost itself.

    Returns:
        The least cost met and its variables.
    """
    from scipy.optimize import minimize

    seen: tuple[float, Floats] = (np.inf, x)
    smooth = objective.problem.cost.kind in ("d", "i")

    def note(value: float, x: Floats, *, last: bool = False) -> None:
        nonlocal seen
        if value < seen[0]:
            seen = value, x.copy()
        if report is not None:
            report(*seen, last=last)

    for power, iterations in SMOOTH_STAGES if smooth else STAGES:
        if np.isinf(power) and not smooth and seen[0] > best + HOPELESS:
            break

        def measured(x: Floats, power: float = power) -> tuple[float, Floats]:
            value, gradient = objective(x, power)
            if np.isinf(power):
                note(value, x)
            return value, gradient

        x = minimize(measured, x, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxcor": 20}).x
        note(objective(x)[0], x, last=True)
    return seen
