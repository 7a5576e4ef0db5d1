"""Multi-start search for an exciting motion: L-BFGS with exact gradients, in processes of their own.

Every iterate keeps the joint limits, so whatever was best when the time is over or the person presses Ctrl-C is a plan.
What a start goes through depends on the seed and its number only, not on time, load or the number of processes: when
all starts finish, equal inputs give the equal plan.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid import children
from dynid.progress import advance
from dynid.trajectory import tuning
from dynid.trajectory.feasible import coefficients, random_variables
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.options import PlanOptions

Floats = NDArray[np.float64]
End = Literal["all starts", "time", "interrupt"]
#: The least cost with penalties that a start has met, and its free variables, (size,).
Best = tuple[float, Floats]


@dataclass(frozen=True)
class SearchOutcome:
    """What a search found.

    Attributes:
        candidates: coefficients of the best motion of every start, (k, n) each, the best first.
        finished: number of starts that went to their end.
        ended: why the search ended; after ``"all starts"`` equal inputs give equal candidates.
    """

    candidates: tuple[Floats, ...]
    finished: int
    ended: End


def optimise(problem: PlanProblem, search: PlanOptions, limit: float) -> SearchOutcome:
    """Search for the motion of least cost; Ctrl-C ends the search and keeps what was found.

    Args:
        problem: what is planned.
        search: restarts, seed and processes.
        limit: time for the search [s].

    Raises:
        KeyboardInterrupt: interrupted before anything was found.
    """
    best: dict[int, Best] = {}
    finished = 0
    ended: End = "all starts"
    begin = time.monotonic()
    with _processes(problem, search) as (reports, running):
        try:
            while running:
                left = begin + limit - time.monotonic()
                # Why: in the first seconds of a very short search there may be nothing yet to keep.
                if left <= 0 and best:
                    ended = "time"
                    break
                with suppress(queue.Empty):
                    report = reports.get(timeout=min(max(left, 0.1), 0.5))
                    if isinstance(report, Exception):
                        raise report
                    if report is None:
                        running -= 1
                    else:
                        start, best[start], through = report
                        finished += through
                if best:
                    least = min(value for value, _ in best.values())
                    done = min(time.monotonic() - begin, limit)
                    advance(done, limit, f"best {describe(problem, least)}")
        except KeyboardInterrupt:
            if not best:
                raise
            ended = "interrupt"
    found = tuple(
        coefficients(problem.basis, problem.of_start(start).limits, best[start][1])
        for start in sorted(best, key=lambda start: (best[start][0], start))
    )
    return SearchOutcome(found, finished, ended)


def describe(problem: PlanProblem, value: float) -> str:
    """Return a cost in words."""
    cost = problem.cost
    if value > tuning.PENALISED_COST:
        return "none without collision yet"
    if cost.kind == "condition":
        return f"condition number {np.exp(value):.1f}"
    if cost.kind == "i":
        return f"expected torque error {np.exp(value / 2) / np.sqrt(problem.model.robot.n):.2g}"
    return f"cost {np.exp(value):.3g}" if cost.kind == "paper" else f"-log det / p {value:.3f}"


@contextmanager
def _processes(
    problem: PlanProblem, search: PlanOptions
) -> Iterator[tuple[queue.SimpleQueue[Any], int]]:
    """Run the search in processes that end with the block; yield their reports, None when one ends, and their number.

    Not by multiprocessing: it runs the script that called dynid once more in each process, so that every script would
    have to guard itself by ``if __name__ == "__main__"``.
    """
    reports: queue.SimpleQueue[Any] = queue.SimpleQueue()
    count = max(1, min(search.processes or os.cpu_count() or 1, search.restarts))
    # Matrices are small: threads of linear algebra would fight for the cores.
    modest = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    running: list[subprocess.Popen[bytes]] = []
    try:
        for k in range(count):
            # A session of its own: Ctrl-C reaches every process of the terminal.
            process = subprocess.Popen(
                children.python("from dynid.trajectory.optimise import serve; serve()"),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | modest,
                start_new_session=True,
            )
            running.append(process)
            task = (problem, search.seed, range(k, search.restarts, count))
            Thread(target=_follow, args=(process, task, reports), daemon=True).start()
        yield reports, count
    finally:
        for process in running:
            process.kill()
            process.wait()


def _follow(
    process: subprocess.Popen[bytes], task: object, reports: queue.SimpleQueue[Any]
) -> None:
    """Give a process its task and pass on what it reports, and None when it ends."""
    assert process.stdin is not None
    assert process.stdout is not None
    # A process that is killed leaves half an object, or a pipe that nobody reads.
    with suppress(OSError, EOFError, pickle.UnpicklingError), process.stdout as answers:
        with process.stdin as stream:
            pickle.dump(task, stream)
        while True:
            reports.put(pickle.load(answers))  # noqa: S301 - from a process of our own
    reports.put(None)


def serve() -> None:
    """Do the task on standard input and send reports to standard output; a failure is a ``RuntimeError``.

    A report is the number of a start, the best that it has met, and whether it is through.
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # A word that a library prints would be taken for a report.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def send(report: object) -> None:
        pickle.dump(report, answers)
        answers.flush()

    def tell(start: int, met: Best, *, through: bool = False) -> None:
        send((start, met, through))

    try:
        problem, seed, starts = pickle.load(sys.stdin.buffer)  # noqa: S301 - from our own process
        for start in starts:
            here = problem.of_start(start)
            x = random_variables(here.basis, here.limits, np.random.default_rng((seed, start)))
            found = descend(ExcitationObjective(here), x, partial(tell, start))
            tell(start, found, through=True)
    except BrokenPipeError:  # nobody reads reports any more
        os._exit(1)
    except Exception:  # noqa: BLE001 - work that failed would look like work that found nothing
        send(RuntimeError(traceback.format_exc()))


def descend(
    objective: ExcitationObjective, x: Floats, report: Callable[[Best], None] = lambda _: None
) -> Best:
    """Go down from one start through the stages.

    Args:
        objective: what is made small.
        x: free variables of the start, (size,).
        report: called with the best so far every now and then.

    Returns:
        The least cost met, and its free variables.
    """
    from scipy.optimize import minimize

    seen: Best = (np.inf, x)
    told = -np.inf

    def measured(x: Floats, power: float, ease: float) -> tuple[float, Floats]:
        nonlocal seen, told
        found = objective(x, power, ease)
        if np.isinf(power):
            if found.full < seen[0]:
                seen = (found.full, x.copy())
            if time.monotonic() - told > tuning.REPORT_INTERVAL_S:
                told = time.monotonic()
                report(seen)
        return found.value, found.gradient

    smooth = objective.problem.cost.kind in ("d", "i")
    for power, ease, iterations in tuning.SMOOTH_STAGES if smooth else tuning.STAGES:
        options = {"maxiter": iterations, "maxcor": 20}
        x = minimize(
            measured, x, args=(power, ease), jac=True, method="L-BFGS-B", options=options
        ).x
        measured(x, np.inf, ease)
    return seen
