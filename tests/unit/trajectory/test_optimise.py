"""The search gets better than where it starts, is repeatable, and keeps the best when it is interrupted."""

import time
from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import WrongUsage
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model
from dynid.progress import Silent
from dynid.robot import Joint, Limits, Robot
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import bounds
from dynid.trajectory.limits import check_trajectory
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.optimise import descend, optimise, start_variables
from dynid.trajectory.options import PlanOptions
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


def planar():
    """A problem of two joints, whose starts take a fraction of a second."""
    limits = Limits(position=(-2.0, 2.0), velocity=2.0, acceleration=6.0, torque=None)
    joints = tuple(Joint(f"joint_{k}", a=0.4, twist=1.2 * k, limits=limits) for k in (1, 2))
    model = build_model(Robot("two", "standard", joints))
    basis, limits = Quintic.even(4.0, 3), bounds(model.robot)
    return PlanProblem(model, reduce(model).base, basis, limits, Cost("condition"), samples=40)


def test_search_ends_far_below_its_start_and_inside_the_limits(lwr):
    here = problem(lwr)
    found = optimise(here, PlanOptions(restarts=1, seconds=60, processes=1))
    objective = ExcitationObjective(here)
    start = objective(start_variables(objective, 0, 0)).value
    # D-optimality is the mean over 62 parameters: 0.4 is a volume of the error ellipsoid smaller by exp(12).
    assert found.candidates[0].value < start - 0.4
    best = Trajectory(here.basis, found.candidates[0].coefficients)
    assert check_trajectory(best, lwr.robot, here.limits).violations == ()


def test_equal_seeds_give_equal_plans_and_other_seeds_others(lwr):
    found = [
        optimise(problem(lwr), PlanOptions(restarts=2, seconds=120, seed=seed, processes=processes))
        for seed, processes in ((3, 1), (3, 2), (4, 1))
    ]
    plans = [one.candidates[0].coefficients for one in found]
    assert np.array_equal(plans[0], plans[1])
    assert not np.allclose(plans[0], plans[2])


def test_starts_that_are_given_up_are_the_same_for_any_number_of_processes():
    found = [
        optimise(planar(), PlanOptions(restarts=10, seconds=300, processes=count))
        for count in (1, 2)
    ]
    assert [(one.ended, one.finished) for one in found] == [("all starts", 10)] * 2
    ranks = [[(c.start, c.evaluation, c.value) for c in one.candidates] for one in found]
    assert ranks[0] == ranks[1]


def test_a_start_is_given_up_only_when_it_is_far_from_the_best():
    objective = ExcitationObjective(planar())
    x = start_variables(objective, 0, 0)
    met = descend(objective, x)
    assert descend(objective, x, best=met.value).evaluation == met.evaluation
    assert (
        descend(objective, x, best=met.value - 10 * tuning.HOPELESS_COST).evaluation
        < met.evaluation
    )


def test_time_limit_is_kept_to_about_a_second(lwr):
    begin = time.monotonic()
    found = optimise(problem(lwr), PlanOptions(restarts=10_000, seconds=6, processes=1))
    assert (found.ended, len(found.candidates) > 0) == ("time", True)
    assert time.monotonic() - begin < 12


def test_what_a_search_stopped_by_its_time_found_is_made_again_to_the_last_bit(lwr):
    search = PlanOptions(restarts=10_000, seconds=6, seed=5, processes=2)
    stopped = optimise(problem(lwr), search)
    best = stopped.candidates[0]
    again = optimise(
        problem(lwr), replace(search, seconds=0.1, replay=(best.start, best.evaluation))
    )
    assert (stopped.ended, again.ended) == ("time", "replay")
    assert again.candidates[0].value == best.value
    assert np.array_equal(again.candidates[0].coefficients, best.coefficients)


def test_replay_of_numbers_that_no_such_search_ended_with_is_refused():
    with pytest.raises(WrongUsage, match="start 3 found no new best motion at evaluation 100000"):
        optimise(planar(), PlanOptions(replay=(3, 100_000)))


class Impatient(Silent):
    """Presses Ctrl-C as soon as something was found."""

    def advance(self, done, total, text=""):
        raise KeyboardInterrupt


def test_interrupt_keeps_the_best_so_far(lwr):
    found = optimise(problem(lwr), PlanOptions(restarts=100, seconds=300, processes=1), Impatient())
    assert (found.ended, len(found.candidates)) == ("interrupt", 1)
    assert np.isfinite(found.candidates[0].value)
