"""Multi-start search for an exciting motion: L-BFGS with exact gradients, in processes of their own.

Every iterate keeps the joint limits, so whatever was best when the time is over or the person presses Ctrl-C is a plan.
What a start goes through depends on the seed and its number only, not on time, load or the number of processes. When
all starts finish, equal inputs give the equal plan; in any case start and evaluation of the best are its address, from
which ``Search.replay`` makes it again.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid import children
from dynid.errors import WrongUsage
from dynid.progress import SILENT, Progress
from dynid.trajectory import tuning
from dynid.trajectory.feasible import Shaping
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.options import PlanOptions

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MotionCandidate:
    """A motion that the search found.

    Attributes:
        value: cost with penalties.
        coefficients: of the problem's basis, (k, n).
        start: number of the start.
        evaluation: evaluation of that start at which it was met, from 1.
    """

    value: float
    coefficients: Floats
    start: int
    evaluation: int


End = Literal["all starts", "time", "interrupt", "replay"]


@dataclass(frozen=True)
class SearchOutcome:
    """What a search found.

    Attributes:
        candidates: the best motion of every start, the best first.
        finished: number of starts that went to their end.
        ended: why the search ended; after ``"all starts"`` and ``"replay"`` equal inputs give equal candidates.
    """

    candidates: tuple[MotionCandidate, ...]
    finished: int
    ended: End


@dataclass(frozen=True)
class BestMotion:
    """The best that one start has met so far.

    Attributes:
        value: cost with penalties.
        x: free variables.
        evaluation: which evaluation of the start it was, from 1.
    """

    value: float
    x: Floats
    evaluation: int


#: Sends the best so far of a start, None when the start is through.
Send = Callable[[tuple[int, BestMotion | None]], None]


def optimise(
    problem: PlanProblem,
    search: PlanOptions,
    progress: Progress = SILENT,
    limit: float | None = None,
) -> SearchOutcome:
    """Search for the motion of least cost; Ctrl-C ends the search and keeps what was found.

    Args:
        problem: what is planned.
        search: restarts, time limit, seed, processes, and what to make again.
        progress: told of the best so far.
        limit: time for the search [s]; all that ``search`` gives when None.

    Raises:
        KeyboardInterrupt: interrupted before anything was found.
        WrongUsage: the evaluation to replay is not one at which a best was met.
    """
    best: dict[int, BestMotion] = {}
    finished: set[int] = set()
    ended: End = "all starts" if search.replay is None else "replay"
    begin = time.monotonic()
    limit = (search.seconds if limit is None else limit) if search.replay is None else np.inf
    with _workers(problem, search) as (reports, running):
        try:
            while any(worker.running() for worker in running) or not reports.empty():
                left = begin + limit - time.monotonic()
                # Why: in the first seconds of a very short search there may be nothing yet to keep.
                if left <= 0 and best:
                    ended = "time"
                    break
                with suppress(queue.Empty):
                    report = reports.get(timeout=min(max(left, 0.1), 0.5))
                    if isinstance(report, Exception):
                        raise report
                    start, met = report
                    if met is None:
                        finished.add(start)
                    else:
                        best[start] = met
                if best:
                    least = min(met.value for met in best.values())
                    done = min(time.monotonic() - begin, limit)
                    progress.advance(done, limit, f"best {describe(problem, least)}")
        except KeyboardInterrupt:
            if not best:
                raise
            ended = "interrupt"
    if search.replay is not None:
        _require_met(search.replay, best)
    found = []
    for start, met in best.items():
        shaping = Shaping(problem.basis, problem.of_start(start).limits, np.zeros(1))
        found.append(MotionCandidate(met.value, shaping.coefficients(met.x), start, met.evaluation))
    return SearchOutcome(
        tuple(sorted(found, key=lambda one: (one.value, one.start))), len(finished), ended
    )


def _require_met(replay: tuple[int, int], best: dict[int, BestMotion]) -> None:
    """Refuse numbers that no search with these inputs can have ended with."""
    start, evaluation = replay
    if start not in best or best[start].evaluation != evaluation:
        raise WrongUsage(
            f"--replay {start}:{evaluation}: start {start} found no new best motion at evaluation {evaluation}",
            why="seed, options, robot file or the machine's arithmetic differ from those of the search",
            fix="give the numbers that the search printed, with the same seed and options",
        )


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
def _workers(
    problem: PlanProblem, search: PlanOptions
) -> Iterator[tuple[queue.SimpleQueue[Any], list[children.Worker]]]:
    """Run the search in processes that end with the block."""
    reports: queue.SimpleQueue[Any] = queue.SimpleQueue()
    most = tuning.LANES if search.replay is None else 1
    count = max(1, min(search.processes or os.cpu_count() or 1, search.restarts, most))
    running: list[children.Worker] = []
    try:
        running += [
            children.Worker(_search, (problem, search, k, count), reports) for k in range(count)
        ]
        yield reports, running
    finally:
        for worker in running:
            worker.end()


def _search(
    problem: PlanProblem,
    search: PlanOptions,
    first: int,
    step: int,
    send: Callable[[tuple[int, BestMotion | None]], None],
) -> None:
    """Search from the starts of every ``step``-th lane and send the best so far of each, None when one is through."""
    if search.replay is not None:
        start, last = search.replay
        objective = ExcitationObjective(problem.of_start(start))
        send((start, descend(objective, start_variables(objective, search.seed, start), last=last)))
        return
    best = np.full(tuning.LANES, np.inf)
    for start in range(search.restarts):
        lane = start % tuning.LANES
        if lane % step == first:
            objective = ExcitationObjective(problem.of_start(start))
            x = start_variables(objective, search.seed, start)
            best[lane] = min(
                best[lane], descend(objective, x, best[lane], _Report(start, send)).value
            )
            send((start, None))


def start_variables(objective: ExcitationObjective, seed: int, start: int) -> Floats:
    """Return the free variables from which a start goes down, (size,)."""
    return objective.shaping.random(np.random.default_rng((seed, start)))


class _Report:
    """Sends improvements of one start, not more often than a person can read."""

    def __init__(self, start: int, send: Send) -> None:
        self._start, self._send = start, send
        self._best, self._sent = np.inf, 0.0

    def __call__(self, met: BestMotion, *, last: bool) -> None:
        now = time.monotonic()
        if met.value < self._best and (last or now - self._sent > tuning.REPORT_INTERVAL_S):
            self._best, self._sent = met.value, now
            self._send((self._start, met))


class _Enough(Exception):
    """The evaluation that was wanted is done."""


def descend(
    objective: ExcitationObjective,
    x: Floats,
    best: float = np.inf,
    report: Callable[..., None] | None = None,
    last: int | None = None,
) -> BestMotion:
    """Go down from one start through the stages.

    Args:
        objective: what is made small.
        x: free variables of the start, (size,).
        best: cost of the best motion so far; a start far from it is given up before the last stage.
        report: called with improvements of the cost itself.
        last: evaluation at which to stop; None to go on to the end.

    Returns:
        The least cost met, with its variables.
    """
    seen = BestMotion(np.inf, x, 0)
    count = 0

    def measured(
        x: Floats, power: float, ease: float, *, last_of_stage: bool = False
    ) -> tuple[float, Floats]:
        nonlocal seen, count
        if count == last:
            raise _Enough
        count += 1
        found = objective(x, power, ease)
        if np.isinf(power):
            if found.full < seen.value:
                seen = BestMotion(found.full, x.copy(), count)
            if report is not None:
                report(seen, last=last_of_stage)
        return found.value, found.gradient

    with suppress(_Enough):
        smooth = objective.problem.cost.kind in ("d", "i")
        _stages(measured, x, lambda: seen.value > best + tuning.HOPELESS_COST, smooth)
    return seen


def _stages(
    measured: Callable[..., tuple[float, Floats]],
    x: Floats,
    hopeless: Callable[[], bool],
    smooth: bool,
) -> None:
    """Minimise through the stages of a cost."""
    from scipy.optimize import minimize

    for power, ease, iterations in tuning.SMOOTH_STAGES if smooth else tuning.STAGES:
        if np.isinf(power) and not smooth and hopeless():
            return
        options = {"maxiter": iterations, "maxcor": 20}
        x = minimize(
            measured, x, args=(power, ease), jac=True, method="L-BFGS-B", options=options
        ).x
        measured(x, np.inf, ease, last_of_stage=True)
