"""The search gets better than where it starts, is repeatable, and keeps the best when it is interrupted."""

import numpy as np
import pytest

from dynid import PlanOptions
from dynid.progress import Silent, heard_by
from dynid.trajectory.basis import Quintic
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import bounds, random_variables
from dynid.trajectory.limits import check_trajectory
from dynid.trajectory.objective import ExcitationObjective, PlanProblem, information
from dynid.trajectory.optimise import optimise
from dynid.trajectory.plan import Trajectory


def problem(base):
    return PlanProblem(
        base.model,
        base.reduction.base,
        Quintic.even(5.0, 3),
        bounds(base.robot, 0.1),
        Cost("d"),
        samples=40,
    )


def cost_of(here, trajectory):
    """The cost of a motion at the samples of the search."""
    t = here.basis.duration * (np.arange(here.samples) + 0.5) / here.samples
    motion = trajectory.motion(t)
    W = here.model.observer(here.columns).dense(motion.q, motion.qd, motion.qdd)
    return here.cost.value(information(here, W))[0]


def test_search_ends_far_below_its_start_and_inside_the_limits(lwr):
    here = problem(lwr)
    found = optimise(here, PlanOptions(restarts=1, processes=1), 60.0)
    objective = ExcitationObjective(here)
    x = random_variables(here.basis, here.limits, np.random.default_rng((0, 0)))
    # D-optimality is the mean over 62 parameters: 0.4 is a volume of the error ellipsoid smaller by exp(12).
    best = Trajectory(here.basis, found.candidates[0])
    assert cost_of(here, best) < objective(x).value - 0.4
    assert check_trajectory(best, lwr.robot, here.limits).violations == ()


@pytest.mark.slow
def test_equal_seeds_give_equal_plans_and_other_seeds_others(lwr):
    found = [
        optimise(problem(lwr), PlanOptions(restarts=2, seed=seed, processes=processes), 120.0)
        for seed, processes in ((3, 1), (3, 2), (4, 1))
    ]
    plans = [one.candidates[0] for one in found]
    assert np.array_equal(plans[0], plans[1])
    assert not np.allclose(plans[0], plans[2])


@pytest.mark.slow
def test_time_limit_ends_the_search_long_before_its_last_start(lwr):
    found = optimise(problem(lwr), PlanOptions(restarts=10_000, processes=1), 6.0)
    assert (found.ended, len(found.candidates) > 0) == ("time", True)
    assert found.finished < 1000


class Impatient(Silent):
    """Presses Ctrl-C as soon as something was found."""

    def advance(self, done, total, text=""):
        raise KeyboardInterrupt


def test_interrupt_keeps_the_best_so_far(lwr):
    with heard_by(Impatient()):
        found = optimise(problem(lwr), PlanOptions(restarts=100, processes=1), 300.0)
    assert (found.ended, len(found.candidates)) == ("interrupt", 1)
    assert np.isfinite(found.candidates[0]).all()
