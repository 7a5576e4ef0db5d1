"""Multi-start search for an exciting motion: L-BFGS with exact gradients, in processes of their own.

Every iterate keeps the joint limits, so whatever was best when the time is over or the person presses Ctrl-C is a plan.
What a start goes through depends on the seed and its number only, not on time, load or the number of processes: when
all starts finish, equal inputs give the equal plan.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import chain
from queue import Empty, SimpleQueue
from subprocess import Popen
from threading import Thread
from typing import Any, Literal

import numpy as np

from dynid.arrays import Floats
from dynid.progress import advance
from dynid.trajectory import tuning
from dynid.trajectory.child import answers, working
from dynid.trajectory.feasible import coefficients, random_variables
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.options import PlanOptions

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
    with ExitStack() as stack:
        reports, running = _follow(stack, problem, search)
        try:
            while running:
                left = begin + limit - time.monotonic()
                # Why: in the first seconds of a very short search there may be nothing yet to keep.
                if left <= 0 and best:
                    ended = "time"
                    break
                with suppress(Empty):
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
    candidates = tuple(
        coefficients(problem.basis, problem.of_start(start).limits, best[start][1])
        for start in sorted(best, key=lambda start: (best[start][0], start))
    )
    return SearchOutcome(candidates, finished, ended)


def describe(problem: PlanProblem, value: float) -> str:
    """Return a cost in words."""
    if value > tuning.PENALISED_COST:
        return "none without collision yet"
    if problem.cost.kind == "i":
        return f"expected torque error {np.exp(value / 2) / np.sqrt(problem.model.robot.n):.2g}"
    return f"cost {np.exp(value):.3g}"


def _follow(
    stack: ExitStack, problem: PlanProblem, search: PlanOptions
) -> tuple[SimpleQueue[Any], int]:
    """Run the search in processes that end with a stack; return their reports, None when one ends, and their number."""
    reports: SimpleQueue[Any] = SimpleQueue()

    def follow(process: Popen[bytes]) -> None:
        for report in chain(answers(process), [None]):
            reports.put(report)

    count = max(1, min(search.processes or os.cpu_count() or 1, search.restarts))
    for k in range(count):
        task = (problem, search.seed, range(k, search.restarts, count))
        process = stack.enter_context(working(search_starts, task))
        Thread(target=follow, args=(process,), daemon=True).start()
    return reports, count


def search_starts(
    task: tuple[PlanProblem, int, Sequence[int]], send: Callable[[object], None]
) -> None:
    """Search from starts of a seed; send the number of each, the best that it has met, and whether it is through."""
    problem, seed, starts = task
    for start in starts:
        here = problem.of_start(start)
        x = random_variables(here.basis, here.limits, np.random.default_rng((seed, start)))

        def tell(met: Best, start: int = start, *, through: bool = False) -> None:
            send((start, met, through))

        tell(descend(ExcitationObjective(here), x, tell), through=True)


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

    seen = (np.inf, x)
    reported = -np.inf

    def measured(x: Floats, power: float, ease: float) -> tuple[float, Floats]:
        nonlocal seen, reported
        cost = objective(x, power, ease)
        if np.isinf(power):
            if cost.full < seen[0]:
                seen = (cost.full, x.copy())
            if time.monotonic() - reported > tuning.REPORT_INTERVAL_S:
                reported = time.monotonic()
                report(seen)
        return cost.value, cost.gradient

    smooth = objective.problem.cost.kind in ("d", "i")
    for power, ease, iterations in tuning.SMOOTH_STAGES if smooth else tuning.STAGES:
        options = {"maxiter": iterations, "maxcor": 20}
        x = minimize(
            measured, x, args=(power, ease), jac=True, method="L-BFGS-B", options=options
        ).x
        measured(x, np.inf, ease)
    return seen
