"""Equals on the searched rows, told apart by rows that were held out."""

from dataclasses import replace

import numpy as np

from dynid.gap.analysis import on_one_clock
from dynid.gap.problem import make_problem
from dynid.gap.rivals import settled_rivals
from dynid.gap.stepwise_selection import SelectionOptions, StepwiseSelection
from dynid.progress import SILENT

NAMES = ("spring", "end_stop", "counterbalance")


def test_the_proof_decides_between_equals(twolinks, on_joint):
    """The searched rows end where the travel is small; a spring and a stop part only beyond."""

    def added(t, q, qd, qdd):
        return on_joint(1, 2.0 * np.maximum(0.0, q[:, 1] - 0.1))

    problem = make_problem(on_one_clock(twolinks.logs(added)), twolinks.base, None)
    near = [np.abs(s.q[:, 1] - 0.6) < 0.4 for s in problem.segments]
    poor = replace(problem, train=near, held=[~rows for rows in near])
    options = SelectionOptions(effects=NAMES, joints=(1,))
    stepwise = StepwiseSelection(poor, options, SILENT, delay=False)
    stepwise.run()
    (one,) = stepwise.selected
    told = replace(one, rivals=tuple((name, (1,)) for name in NAMES if name != one.name))
    (settled,) = settled_rivals(poor, [told])
    assert (settled.name, settled.rivals) == ("end_stop", ())
