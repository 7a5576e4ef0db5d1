"""The search gets better than where it starts, is repeatable, and keeps the best when it is interrupted."""

import time

import numpy as np

from dynid.progress import Silent
from dynid.trajectory.basis import Quintic
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import bounds
from dynid.trajectory.limits import check
from dynid.trajectory.objective import Objective, Problem
from dynid.trajectory.optimise import Search, optimise
from dynid.trajectory.plan import Trajectory


def problem(base):
    return Problem(
        base.model, base.reduction.base, Quintic.even(5.0, 3), bounds(base.robot, 0.1), Cost("d"), samples=40
    )


def test_search_ends_far_below_its_start_and_inside_the_limits(lwr):
    here = problem(lwr)
    found = optimise(here, Search(restarts=1, seconds=60, processes=1))
    objective = Objective(here)
    start = objective(objective.shaping.random(np.random.default_rng((0, 0))))[0]
    # D-optimality is the mean over 62 parameters: 0.4 is a volume of the error ellipsoid smaller by exp(12).
    assert found[0].value < start - 0.4
    assert check(Trajectory(here.basis, found[0].coefficients), lwr.robot, here.limits).violations == ()


def test_equal_seeds_give_equal_plans_and_other_seeds_others(lwr):
    plans = [
        optimise(problem(lwr), Search(restarts=2, seconds=120, seed=seed, processes=processes))[0].coefficients
        for seed, processes in ((3, 1), (3, 2), (4, 1))
    ]
    assert np.array_equal(plans[0], plans[1])
    assert not np.allclose(plans[0], plans[2])


def test_time_limit_is_kept_to_about_a_second(lwr):
    begin = time.monotonic()
    assert optimise(problem(lwr), Search(restarts=10_000, seconds=6, processes=1))
    assert time.monotonic() - begin < 12


class Impatient(Silent):
    """Presses Ctrl-C as soon as something was found."""

    def advance(self, done, total, text=""):
        raise KeyboardInterrupt


def test_interrupt_keeps_the_best_so_far(lwr):
    found = optimise(problem(lwr), Search(restarts=100, seconds=300, processes=1), Impatient())
    assert len(found) == 1
    assert np.isfinite(found[0].value)
